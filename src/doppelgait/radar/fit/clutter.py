"""Static clutter as a profile of mean level over range."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from doppelgait.radar.fit.estimate import DB_PER_NEPER, Estimate

ComplexArray = npt.NDArray[np.complex128]
FloatArray = npt.NDArray[np.float64]

MAX_KNOTS = 20
CELLS_PER_KNOT = 4.0
"""Independent cells that one knot rests on, so that it is known to about 2 dB."""
KNOT_EXPONENT = 1.5
"""Knots stand denser near the radar, where the direct path falls steeply."""


@dataclass(frozen=True)
class ClutterProfile:
    """Mean clutter level over range, linear in dB between knots.

    Parameters
    ----------
    range_m : ndarray, shape (M,)
        Knots.
    level_db : ndarray, shape (M,)
        rms of |y| there, dB re 1 V.
    sd_db : ndarray, shape (M,)
        Standard uncertainty as the level of an ensemble of rooms, of which this room is one.
    """

    range_m: FloatArray
    level_db: FloatArray
    sd_db: FloatArray

    def at(self, range_m: npt.ArrayLike) -> FloatArray:
        """Level at any range, dB re 1 V; held constant beyond the ends."""
        return np.asarray(np.interp(np.asarray(range_m, dtype=float), self.range_m, self.level_db))


def clutter_profile(
    echo_v: ComplexArray, *, range_m: FloatArray, noise_power_v2: float, resolution_m: float
) -> ClutterProfile:
    """Profile under which the measured static powers are most likely if each cell is complex Gaussian.

    Powers are then exponential with mean mu(R); log mu is piecewise linear between knots and fitted by Fisher scoring.
    Unlike a smoothed mean it neither smears the steep near end nor falls low, as a mean of dB values does by 2.5 dB.

    Parameters
    ----------
    echo_v : ndarray, shape (N,)
        Static echo per bin, V.
    range_m : ndarray, shape (N,)
        Range of the bins.
    noise_power_v2 : float
        Noise power left in ``echo_v`` (that of a frame over the number of frames); taken off.
    resolution_m : float
        Half-power width of an echo; neighbouring bins within it are not independent.
    """
    spacing = float(np.mean(np.diff(range_m)))
    sigma = resolution_m / (2.0 * math.sqrt(math.log(2.0)))
    per_cell = max(1.0, sigma * math.sqrt(2.0 * math.pi) / spacing)
    count = int(np.clip(len(range_m) / per_cell / CELLS_PER_KNOT, 2, MAX_KNOTS))
    knots = range_m[0] + (range_m[-1] - range_m[0]) * np.linspace(0.0, 1.0, count) ** KNOT_EXPONENT
    power = np.maximum(np.abs(echo_v) ** 2 - noise_power_v2, 0.1 * noise_power_v2)
    basis = np.stack([np.interp(range_m, knots, row) for row in np.eye(count)], axis=1)
    inverse = np.linalg.pinv(basis.T @ basis)
    logs = _score(np.maximum(power, np.finfo(float).tiny), basis, np.asarray(inverse, dtype=np.float64))
    sd = DB_PER_NEPER * np.sqrt(np.diag(inverse) * per_cell)
    return ClutterProfile(knots, DB_PER_NEPER * logs, sd)


def _score(power: FloatArray, basis: FloatArray, inverse: FloatArray) -> FloatArray:
    """Fisher scoring for exponential powers with log mean ``basis @ logs``; steps are limited, the cost is convex."""
    logs = np.asarray(inverse @ basis.T @ np.log(power), dtype=np.float64) + np.euler_gamma
    for _ in range(200):
        ratio = power * np.exp(-np.clip(basis @ logs, -700.0, 700.0))
        step = np.clip(inverse @ basis.T @ (ratio - 1.0), -1.0, 1.0)
        logs = logs + step
        if np.max(np.abs(step)) < 1e-9:
            break
    return logs


@dataclass(frozen=True)
class Leakage:
    """Strongest static echo near the radar, and a constant over all ranges.

    Parameters
    ----------
    range_m : float
        Range of the strongest bin below 1 m; NaN for frames that start farther away.
    level_db : Estimate
        Its level, dB re 1 V.
    constant_v : Estimate
        Size of the complex constant that all bins share (direct current, or an echo that is none), V.
    """

    range_m: float
    level_db: Estimate
    constant_v: Estimate


NEAR_M = 1.0
"""Up to here a static echo counts as leakage from transmitter to receiver."""


def leakage(echo_v: ComplexArray, *, range_m: FloatArray, noise_power_v2: float, per_cell: float = 2.0) -> Leakage:
    """Direct path and constant of the static echo.

    Parameters
    ----------
    echo_v : ndarray, shape (N,)
    range_m : ndarray, shape (N,)
    noise_power_v2 : float
        Noise power left in ``echo_v``.
    per_cell : float
        Bins per independent cell.
    """
    near = range_m < NEAR_M
    level, place = Estimate(-math.inf, math.inf), math.nan
    if near.any():
        strongest = int(np.argmax(np.abs(echo_v) * near))
        power = float(np.abs(echo_v[strongest]) ** 2)
        place = float(range_m[strongest])
        if power > 0:
            level = Estimate(DB_PER_NEPER * math.log(power), 2.0 * DB_PER_NEPER * math.sqrt(noise_power_v2 / 2 / power))
    far = echo_v[~near] if (~near).sum() >= 4 else echo_v
    weights = 1.0 / (np.abs(far - np.median(far.real) - 1j * np.median(far.imag)) ** 2 + _typical(far))
    constant = np.sum(weights * far) / np.sum(weights)
    scatter = float(np.sqrt(np.sum(weights**2 * np.abs(far - constant) ** 2) * per_cell) / np.sum(weights))
    return Leakage(place, level, Estimate(float(abs(constant)), scatter))


def _typical(echo_v: ComplexArray) -> float:
    return float(np.median(np.abs(echo_v) ** 2)) + np.finfo(float).tiny
