"""Micro-Doppler bandwidth B_mu in its two forms (E-35)."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.core.labels import SIGNATURE, axis, check_signal
from doppelgait.features.measures import quantile

FloatArray = npt.NDArray[np.float64]

POWER_QUANTILES = (0.01, 0.99)
TIME_SHARES = (0.05, 0.95)
DETECTION_SIGMAS = 4.0


def envelopes_hz(signature: xr.DataArray, floor_v2: float) -> tuple[FloatArray, FloatArray]:
    """Compute lower and upper Doppler envelope of every column.

    NaN where nothing stands above the noise; shapes (J,).

    Power quantiles 1 % and 99 % over Doppler of the cells that noise alone exceeds as seldom as a normal variable
    exceeds 4 standard deviations (E-35).
    """
    from doppelgait.core.kernels.features import power_quantiles

    check_signal(signature, SIGNATURE)
    threshold = floor_v2 * noise_quantile(max(1.0, float(signature.attrs["n_gate_bins"])))
    low, high = np.empty((2, signature.shape[0]))
    values = np.ascontiguousarray(signature.values)
    power_quantiles(values, float(threshold), float(floor_v2), *POWER_QUANTILES, low, high)
    doppler_hz = axis(signature, "doppler")
    bin_hz = float(doppler_hz[1] - doppler_hz[0])
    return doppler_hz[0] + bin_hz * low, doppler_hz[0] + bin_hz * high


@lru_cache(maxsize=256)
def noise_quantile(n_bins: float) -> float:
    """Compute the noise threshold of a cell over its mean.

    Noise exceeds it with the probability of 4 normal standard deviations.

    A cell sums N_g exponential variables: a gamma distribution. E-35's own 1 + 4 / sqrt(N_g) takes it for a normal one,
    which it nears for large N_g only: with 2 bins noise exceeds that 130 times as often as meant, and the bandwidth
    of a radar with few bins in the gate becomes that of the noise.
    """
    from scipy.special import gammainccinv, ndtr

    return float(gammainccinv(n_bins, float(ndtr(-DETECTION_SIGMAS)))) / n_bins


def bandwidth_envelope_hz(signature: xr.DataArray, floor_v2: float) -> float | None:
    """Compute the micro-Doppler bandwidth from percentiles of envelopes (E-35).

    It is the 95th percentile over time of the upper envelope minus the 5th of the lower.

    None where less than half of the columns stand above the noise.
    """
    return bandwidth_of_hz(*envelopes_hz(signature, floor_v2))


def bandwidth_of_hz(low_hz: FloatArray, high_hz: FloatArray) -> float | None:
    """Compute :func:`bandwidth_envelope_hz` from the envelopes."""
    seen = np.isfinite(low_hz)
    if seen.mean() < 0.5:
        return None
    return quantile(high_hz[seen], TIME_SHARES[1]) - quantile(low_hz[seen], TIME_SHARES[0])


def bandwidth_threshold_hz(mean_spectrum: FloatArray, doppler_hz: FloatArray, *, threshold: float) -> float:
    """Measure the mean Doppler spectrum's width above a share of its peak.

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
    return _crossing(level, doppler_hz, peak, +1, threshold) - _crossing(level, doppler_hz, peak, -1, threshold)


def _crossing(level: FloatArray, doppler_hz: FloatArray, start: int, step: int, threshold: float) -> float:
    k = start
    while 0 <= k + step < level.size and level[k + step] >= threshold:
        k += step
    if not 0 <= k + step < level.size:
        return float(doppler_hz[k])
    inside, outside = math.log(level[k]), math.log(max(level[k + step], 1e-300))
    share = (inside - math.log(threshold)) / (inside - outside)
    return float(doppler_hz[k] + share * (doppler_hz[k + step] - doppler_hz[k]))


def single_tone_width_hz(*, cpi_s: float, window_steepness: float, threshold: float) -> float:
    """Compute the threshold width of one constant Doppler line (E-35).

    2 sqrt(-ln t) / (2 pi sigma_w T_d / 2).
    """
    return math.sqrt(-math.log(threshold)) / (math.pi * window_steepness * cpi_s / 2.0)
