"""Micro-Doppler bandwidth B_mu (E-35) and power envelopes (E-35b)."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.core.labels import SIGNATURE, Plain, check_signal, read_axis
from doppelgait.features.measures import compute_quantile

FloatArray = npt.NDArray[np.float64]

POWER_QUANTILES = (0.01, 0.99)
DETECTION_SIGMAS = 4.0
WIDTH_LEVEL = 0.03
"""Share of the body's power, 15 dB below: feet in full swing reach it, noise of a person at 5 m does not."""
WIDTH_SHARE = 0.05
"""A Doppler shift belongs to the body that exceeds the level for this share of the time."""
LEAST_NOISE_SIGMAS = 1.0
"""Below this many standard deviations of a cell of noise the width's level is lost in noise."""


def envelopes_hz(signature: xr.DataArray | Plain, floor_v2: float) -> tuple[FloatArray, FloatArray]:
    """Compute lower and upper Doppler envelope of every column.

    NaN where nothing stands above the noise; shapes (J,).

    Power quantiles 1 % and 99 % over Doppler of the cells that noise alone exceeds as seldom as a normal variable
    exceeds 4 standard deviations (E-35b).
    """
    from doppelgait.core.kernels.features import power_quantiles

    check_signal(signature, SIGNATURE)
    threshold = floor_v2 * compute_noise_quantile(max(1.0, float(signature.attrs["n_gate_bins"])))
    low, high = np.empty((2, signature.shape[0]))
    values = np.ascontiguousarray(signature.values)
    power_quantiles(values, float(threshold), float(floor_v2), *POWER_QUANTILES, low, high)
    doppler_hz = read_axis(signature, "doppler")
    bin_hz = float(doppler_hz[1] - doppler_hz[0])
    return doppler_hz[0] + bin_hz * low, doppler_hz[0] + bin_hz * high


@lru_cache(maxsize=256)
def compute_noise_quantile(n_bins: float) -> float:
    """Compute a cell's noise threshold over its mean.

    Noise exceeds it with the probability of 4 normal standard deviations.

    A cell sums N_g exponential variables: a gamma distribution. E-35's own 1 + 4 / sqrt(N_g) takes it for a normal one,
    which it nears for large N_g only: with 2 bins noise exceeds that 130 times as often as meant, and the bandwidth
    of a radar with few bins in the gate becomes that of the noise.
    """
    from scipy.special import gammainccinv, ndtr

    return float(gammainccinv(n_bins, float(ndtr(-DETECTION_SIGMAS)))) / n_bins


def strongest_cells_v2(signature: xr.DataArray | Plain) -> npt.NDArray[Any]:
    """Find every column's strongest cell, V^2."""
    cells = signature.values
    found = cells[np.arange(cells.shape[0]), cells.argmax(axis=1)]  # max along rows takes twice as long
    return np.asarray(found)


def width_level_v2(strongest_v2: npt.NDArray[Any], floor_v2: float, range_weight: FloatArray) -> FloatArray:
    """Compute the level of B_mu per column (E-35), V^2.

    It is 3 % of the body's power, which is the median over time of the columns' strongest cells with range removed.

    Parameters
    ----------
    strongest_v2 : ndarray, shape (J,)
        Strongest cell of every column of mu, V^2.
    floor_v2 : float
        Noise floor nu.
    range_weight : ndarray, shape (J,)
        Fourth power of the range over its mean (E-28).
    """
    excess = (strongest_v2 - float(floor_v2)) * range_weight
    return np.asarray(WIDTH_LEVEL * max(compute_quantile(excess, 0.5), 0.0) / range_weight)


def raised_by_noise_v2(level_v2: FloatArray, floor_v2: float, n_bins: float) -> FloatArray:
    """Raise the level of B_mu by the noise (E-35).

    Shape (J,). Of the mean of n exponential variables a share of 5 % exceeds nu by kappa; noise and level add as
    powers of independent fluctuations, sqrt(L^2 + kappa^2).
    """
    return np.asarray(np.hypot(level_v2, floor_v2 * _compute_noise_excess(n_bins)))


@lru_cache(maxsize=256)
def _compute_noise_excess(n_bins: float) -> float:
    from scipy.special import gammainccinv

    return float(gammainccinv(n_bins, WIDTH_SHARE)) / n_bins - 1.0


def width_of_bins(share: FloatArray) -> float | None:
    """Measure the Doppler bins above the level (E-35).

    They are above it often enough; None where none is. The run holds the bin of the largest share; its ends are
    interpolated to 5 % of the time.

    Parameters
    ----------
    share : ndarray, shape (K,)
        Share of the time during which each bin exceeds the level.
    """
    from doppelgait.core.kernels.columns import run_above

    width = run_above(np.ascontiguousarray(share), WIDTH_SHARE)
    return None if width < 0.0 else width


def bandwidth_threshold_hz(mean_spectrum: FloatArray, doppler_hz: FloatArray, *, threshold: float) -> float:
    """Measure the mean Doppler spectrum's width above a level.

    The width is contiguous from the peak, Hz.

    Parameters
    ----------
    mean_spectrum : ndarray, shape (K,)
        D_1.
    doppler_hz : ndarray, shape (K,)
    threshold : float
        t_mu, share of the peak power; crossings are interpolated linearly in dB.
    """
    level = mean_spectrum / mean_spectrum.max()
    peak = int(level.argmax())
    return _interpolate_crossing(level, doppler_hz, peak, +1, threshold) - _interpolate_crossing(
        level, doppler_hz, peak, -1, threshold
    )


def _interpolate_crossing(level: FloatArray, doppler_hz: FloatArray, start: int, step: int, threshold: float) -> float:
    k = start
    while 0 <= k + step < level.size and level[k + step] >= threshold:
        k += step
    if not 0 <= k + step < level.size:
        return float(doppler_hz[k])
    inside, outside = math.log(level[k]), math.log(max(level[k + step], 1e-300))
    share = (inside - math.log(threshold)) / (inside - outside)
    return float(doppler_hz[k] + share * (doppler_hz[k + step] - doppler_hz[k]))


def single_tone_width_hz(*, cpi_s: float, window_steepness: float, threshold: float) -> float:
    """Compute a constant Doppler line's width (E-35).

    2 sqrt(-ln t) / (2 pi sigma_w T_d / 2).
    """
    return math.sqrt(-math.log(threshold)) / (math.pi * window_steepness * cpi_s / 2.0)
