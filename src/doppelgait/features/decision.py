"""Step or stride: which multiple of the strongest repetition is f_mu, and how exactly it is known (E-07, E-33)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from doppelgait.features.autocorrelation import lag_products
from doppelgait.features.limbs import Rows

FloatArray = npt.NDArray[np.float64]

HIGHEST_HZ = 8.0
LAG_TOLERANCE, NEAR_POINTS = 0.05, 9
N_HARMONICS = 6
HIGHEST_HARMONIC_HZ = 14.0
LOWEST_HZ = 0.5
SEARCH = 0.06
"""Half width of the search for the exact frequency, relative."""
FINE_STEPS = 97
TOP = 6
"""The top of the sum is this many steps either side."""
WIDTH_DROP = 0.02
PADDING = 8
TAPER_FROM_S = 4.0


@dataclass(frozen=True)
class Candidate:
    """A frequency that f_mu could be.

    Parameters
    ----------
    frequency_hz : float
    score : float
        ``n(1/f) - n(1/(2f))`` of the limbs' autocorrelation, -2 to 2: large where the limbs repeat after one period
        and do the opposite after half of it.
    """

    frequency_hz: float
    score: float


@dataclass(frozen=True)
class Decision:
    """f_mu among half, once and twice the strongest repetition.

    Parameters
    ----------
    frequency_hz : float
    code : {"as_found", "doubled", "no_limbs"}
        ``doubled``: the limbs repeat after half the period, so the strongest repetition is a stride of two like steps
        (the sway of the trunk). ``as_found``: they do not. ``no_limbs``: no Doppler row beyond the torso stands above
        the noise, or the record is too short to tell.
    half_period : float or None
        n of the limbs at half the period of the strongest repetition: above 0 doubles.
    one_period : float or None
        n of the limbs at its period.
    candidates : tuple of Candidate
    """

    frequency_hz: float
    code: str
    half_period: float | None = None
    one_period: float | None = None
    candidates: tuple[Candidate, ...] = ()

    @property
    def margin(self) -> float | None:
        """|n(T/2)| over the greater of |n(T/2)| and n(T)."""
        if self.half_period is None or self.one_period is None:
            return None
        scale = max(abs(self.half_period), self.one_period)
        return abs(self.half_period) / scale if scale > 0 else 0.0


def decide(frequency_hz: float, autocorrelation: FloatArray, rate_hz: float) -> Decision:
    """Choose f_mu from the strongest repetition and the limbs' autocorrelation.

    People, and dogs that walk, pace or trot, take two like steps a stride: f_mu = 2 f_stride. The trunk sways once per
    stride, and in side views this outweighs the steps in the signature as a whole. Limbs seen relative to the torso
    tell: after half a stride the other leg does what the first one did, so ``n(T/2) > 0``, where T is the period found;
    if T is already that of a step, or the gait a gallop, forward and backward swing face each other and ``n(T/2) < 0``.
    The strongest repetition of people and dogs is f_stride or f_mu and not above, so that half of it is never taken.

    Parameters
    ----------
    frequency_hz : float
        Strongest repetition of the signature as a whole.
    autocorrelation : ndarray
        n of the limbs at all lags.
    rate_hz : float
        Lags per second.
    """
    half, one = (near_lag(autocorrelation, share * rate_hz / frequency_hz) for share in (0.5, 1.0))
    if half is None or not autocorrelation[1:].any():
        return Decision(frequency_hz, "no_limbs")
    candidates = tuple(
        Candidate(factor * frequency_hz, long - short)
        for factor in (0.5, 1.0, 2.0)
        if (long := near_lag(autocorrelation, rate_hz / (factor * frequency_hz))) is not None
        and (short := near_lag(autocorrelation, 0.5 * rate_hz / (factor * frequency_hz))) is not None
    )
    doubled = half > 0.0 and 2.0 * frequency_hz <= HIGHEST_HZ
    chosen = 2.0 * frequency_hz if doubled else frequency_hz
    return Decision(chosen, "doubled" if doubled else "as_found", half, one, candidates)


def near_lag(autocorrelation: FloatArray, lag: float) -> float | None:
    """Largest value within 5 % of a lag (which may lie between samples); None where the record is too short."""
    from doppelgait.core.kernels.periodicity import highest_between

    last = autocorrelation.size - 1
    if lag > last:
        return None
    low, high = lag * (1.0 - LAG_TOLERANCE), min(lag * (1.0 + LAG_TOLERANCE), last)
    return highest_between(autocorrelation, low, high, NEAR_POINTS)


def power_spectrum(rows: Rows) -> tuple[FloatArray, FloatArray]:
    """Frequencies and power of the rows over time, summed over the rows, zero-padded; tapered from 4 s on (E-30).

    As the transform of the sum of the rows' autocorrelations, which costs one transform instead of one a row.
    """
    from scipy import fft

    n_columns = rows.values.shape[0]
    position = (np.arange(n_columns) + 1) / (n_columns + 1)
    long = n_columns / rows.rate_hz > TAPER_FROM_S - 0.05
    tapered = rows.values * (0.5 - 0.5 * np.cos(2.0 * np.pi * position))[:, None] if long else rows.values
    products = lag_products(tapered, 0, n_columns)
    length = fft.next_fast_len(PADDING * n_columns, real=True)
    power = 2.0 * fft.rfft(products, length).real - products[0]
    return np.arange(power.size) * (rows.rate_hz / length), np.maximum(power, 0.0)


def refine_on_harmonics(frequency_hz: float, spectra: list[tuple[FloatArray, FloatArray]]) -> tuple[float, float]:
    """The frequency whose harmonics hold most power, and the curvature of that sum: a multi-harmonic fit.

    For white noise and resolved harmonics the maximum of ``sum_h S(h f)`` is the least-squares fit of a periodic signal
    (Quinn and Thomson 1991). Each spectrum counts by its share of power above 0.5 Hz.

    Parameters
    ----------
    frequency_hz : float
        Within 6 % of the wanted one.
    spectra : list of (frequencies, power)

    Returns
    -------
    tuple of float
        Frequency in Hz, from a parabola through the top, and the distance in Hz at which that parabola has fallen by
        2 %; NaN where the sum has no top within 6 %.
    """
    from doppelgait.core.kernels.periodicity import add_between

    trial_hz = frequency_hz * np.linspace(1.0 - SEARCH, 1.0 + SEARCH, FINE_STEPS)
    total = np.zeros(FINE_STEPS)
    for axis_hz, power in spectra:
        counted = float(power[np.searchsorted(axis_hz, LOWEST_HZ, side="right") :].sum())
        highest = min(HIGHEST_HARMONIC_HZ, float(axis_hz[-1]) / (1.0 + SEARCH))
        n = min(N_HARMONICS, int(highest / frequency_hz))
        if counted > 0 and n > 0:
            for harmonic in range(1, n + 1):
                add_between(power, harmonic * trial_hz / float(axis_hz[1]), 1.0 / counted, total)
    best = int(total.argmax())
    if not 0 < best < FINE_STEPS - 1 or not total.any():
        return frequency_hz, math.nan
    near = slice(max(best - TOP, 0), best + TOP + 1)
    step_hz = float(trial_hz[1] - trial_hz[0])
    powers = np.vander(np.arange(near.start, min(near.stop, FINE_STEPS)) - float(best), 3)
    fitted = np.linalg.solve(powers.T @ powers, powers.T @ total[near])
    bend, slope, height = fitted / (step_hz**2, step_hz, 1.0)
    if bend >= 0 or height <= 0:
        return float(trial_hz[best]), math.nan
    reach_hz = step_hz * TOP
    offset_hz = float(np.clip(-slope / (2.0 * bend), -reach_hz, reach_hz))
    return float(trial_hz[best]) + offset_hz, math.sqrt(WIDTH_DROP * float(height) / float(-bend))
