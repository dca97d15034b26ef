"""What all range bins share: the phase and gain of whole frames, measured on what stands still."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

ComplexArray = npt.NDArray[np.complex128]
FloatArray = npt.NDArray[np.float64]

APART_M = 0.75
"""Bins nearer than this to a bin do not count for it: they may show the same body."""
LEAST_WEIGHT = 1e3
"""Power of the static echoes over their own fluctuation that makes a reference; its phase is good to 0.02 rad."""
PASSES = 3


def without_common_gain(values: ComplexArray, range_m: FloatArray) -> ComplexArray:
    r"""Slow-time series of all bins, each divided by the complex gain that the bins elsewhere have in common.

    The gain of frame i for bin n is

    .. math:: g_{i,n} = \sum_m w_m y_{i,m} \bar y_m^* / \sum_m w_m |\bar y_m|^2, \qquad
              w_m = 1 / \overline{|y_m - \bar y_m|^2}

    over the bins m at least 0.75 m away, so that a body's own motion is never in its own reference. Three passes: the
    weights become those of the corrected series. Bins whose reference is too weak, or that fluctuate more with it than
    without, are left as they are.

    Parameters
    ----------
    values : ndarray, shape (I, N)
        Static echoes still in it.
    range_m : ndarray, shape (N,)

    Returns
    -------
    ndarray, shape (I, N)
    """
    corrected = values
    own_power = np.maximum(np.var(values, axis=0), 1e-300)
    for _ in range(PASSES):
        gain, weight = _reference(values, corrected, range_m)
        trial = values / gain
        better = (weight >= LEAST_WEIGHT) & (np.var(trial, axis=0) < own_power)
        corrected = np.where(better, trial, values)
    return corrected


def _reference(values: ComplexArray, corrected: ComplexArray, range_m: FloatArray) -> tuple[ComplexArray, FloatArray]:
    """Gain of every frame and bin, shape (I, N), and the weight behind it, shape (N,)."""
    mean = corrected.mean(axis=0)
    weight = 1.0 / np.maximum(np.var(corrected, axis=0), 1e-300 + 1e-14 * np.abs(mean) ** 2)
    far = (np.abs(range_m[:, None] - range_m) >= APART_M).astype(np.float64)
    strength = (weight * np.abs(mean) ** 2) @ far
    gain = (values * (weight * mean.conj())) @ far / np.maximum(strength, 1e-300)
    return np.where((strength >= LEAST_WEIGHT) & (np.abs(gain) > 0.1), gain, 1.0), strength
