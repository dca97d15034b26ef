"""Micro-Doppler bandwidth B_mu (E-35) and power envelopes (E-35b)."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait._core import native
from doppelgait.core.labels import SIGNATURE, Signal, measures_signal
from doppelgait.core.units import FloatArray

POWER_QUANTILES = (0.01, 0.99)
DETECTION_SHARE = 3.167124183311986e-05  # of noise cells above their threshold, at 4 standard deviations
WIDTH_LEVEL = 0.03
"""Level of the bandwidth as a share (-15 dB) of the body's power.
Feet in full swing are above this level; the noise for a person at 5 m is below it."""
WIDTH_SHARE = 0.05  # share of the time for which a Doppler shift of the body must exceed the level
LEAST_NOISE_SIGMAS = 1.0  # lowest level of the bandwidth, in standard deviations of a noise cell


def envelopes_hz(signature: Signal, floor_v2: float) -> tuple[FloatArray, FloatArray]:
    """Compute lower and upper Doppler envelope of every column (E-35b)."""
    threshold = floor_v2 * compute_noise_quantile(max(1.0, float(signature.attrs["n_gate_bins"])), DETECTION_SHARE)
    low, high = np.empty((2, signature.shape[0]))
    native.power_quantiles(signature.values, float(threshold), float(floor_v2), *POWER_QUANTILES, low, high)
    doppler_hz = signature.axis("doppler")
    bin_hz = float(doppler_hz[1] - doppler_hz[0])
    return doppler_hz[0] + bin_hz * low, doppler_hz[0] + bin_hz * high


@lru_cache(maxsize=256)
def compute_noise_quantile(n_bins: float, share: float) -> float:
    """Compute the level over its mean that a share of noise exceeds (E-35)."""
    from scipy.special import gammainccinv

    return float(gammainccinv(n_bins, share)) / n_bins


@measures_signal(SIGNATURE)
def strongest_cells_v2(signature: Signal) -> npt.NDArray[Any]:
    """Find every column's strongest cell, V^2."""
    cells = signature.values
    found = cells[np.arange(cells.shape[0]), cells.argmax(axis=1)]  # max(axis=1) takes twice as long
    return np.asarray(found)


def compute_snr_db(strongest_v2: npt.NDArray[Any], floor_v2: float) -> float:
    """Compute the signature SNR in dB; it is infinite without noise."""
    peak = compute_quantile(strongest_v2, 0.5)
    if peak <= floor_v2:
        return -np.inf
    return 10.0 * math.log10((peak - floor_v2) / floor_v2) if floor_v2 > 0 else np.inf


def compute_quantile(values: npt.NDArray[np.floating[Any]], share: float) -> float:
    """Compute quantiles of values without NaN."""
    # the result equals np.quantile
    return float(native.quantile(values, share))


def width_level_v2(strongest_v2: npt.NDArray[Any], floor_v2: float, range_weight: FloatArray) -> float:
    """Compute the level of B_mu at mean range (E-35), V^2."""
    # the level is 3 % of the body's power. Shapes: strongest_v2 (J,); range_weight (J,) (E-28)
    excess = (strongest_v2 - float(floor_v2)) * range_weight
    return WIDTH_LEVEL * max(compute_quantile(excess, 0.5), 0.0)


def raised_by_noise_v2(level_v2: FloatArray, floor_v2: float, n_bins: float) -> FloatArray:
    """Raise the level of B_mu by the noise (E-35)."""
    # the mean of n exponential variables exceeds nu + kappa for 5 % of the time
    return np.asarray(np.hypot(level_v2, floor_v2 * (compute_noise_quantile(n_bins, WIDTH_SHARE) - 1.0)))


def width_of_bins(share: FloatArray) -> FloatArray:
    """Measure the width in Doppler bins above the level (E-35), NaN without any: share (..., K)."""
    # its ends are interpolated to the level; where it does not end it reaches the end of the axis
    widths = np.empty(share.shape[:-1])
    native.widths_above(share.reshape(-1, share.shape[-1]), WIDTH_SHARE, widths.reshape(-1))
    return widths


def bandwidth_threshold_hz(mean_spectrum: FloatArray, doppler_hz: FloatArray, *, threshold: float) -> float:
    """Measure the width of a mean Doppler spectrum around its peak, Hz."""
    level = mean_spectrum / mean_spectrum.max()
    peak = int(level.argmax())
    upper_hz, lower_hz = (_interpolate_crossing(level, doppler_hz, peak, step, threshold) for step in (1, -1))
    return upper_hz - lower_hz


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
    """Compute the width of a line of constant Doppler (E-35)."""
    # the width is 2 sqrt(-ln t) / (2 pi sigma_w T_d / 2)
    return math.sqrt(-math.log(threshold)) / (math.pi * window_steepness * cpi_s / 2.0)
