"""Static clutter out of the baseband, before anything else looks at it."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.core.labels import BASEBAND, axis, check_signal, sampling_rate_hz
from doppelgait.processing.config import Analysis


def remove_clutter(baseband: xr.DataArray, analysis: Analysis) -> xr.DataArray:
    r"""Baseband without what stands still, by ``analysis.clutter``.

    ``mean`` takes off every range bin's time mean: a notch of width :math:`1 / T_o` at 0 Hz, which leaves all that
    moves by more than half a wavelength in the recording. ``exponential`` takes off a running mean

    .. math:: c_i = c_{i-1} + \alpha (y_i - c_{i-1}), \quad \alpha = 1 - e^{-1 / (f_p \tau)}, \quad c_0 = \bar y

    over the time constant :math:`\tau` (``clutter_time_s``), which follows slow drift too and is a high-pass with its
    3 dB point at :math:`1 / 2 \pi \tau`; :math:`c_0` is the mean of the first :math:`\tau`. Slower motion fades with
    it: at 2 s and 7.29 GHz that of below 1.6 mm/s, so that breathing stays and the torso of a person who crosses at 90
    degrees loses only what lies within 0.08 Hz of 0.

    Parameters
    ----------
    baseband : DataArray (slow_time, range)
    analysis : Analysis

    Returns
    -------
    DataArray (slow_time, range)
        The same object for ``clutter = "none"``.
    """
    check_signal(baseband, BASEBAND)
    if analysis.clutter == "none":
        return baseband
    values = baseband.values
    if analysis.clutter == "mean":
        return baseband.copy(data=values - values.mean(axis=0, dtype=np.complex128).astype(np.complex64))
    return baseband.copy(
        data=_without_running_mean(values, analysis.clutter_time_s * sampling_rate_hz(axis(baseband, "slow_time")))
    )


def _without_running_mean(values: npt.NDArray[np.complex64], pulses: float) -> npt.NDArray[np.complex64]:
    from scipy.signal import lfilter

    alpha = -math.expm1(-1.0 / pulses)
    start = values[: max(round(pulses), 1)].mean(axis=0, dtype=np.complex128)
    mean, _ = lfilter([alpha], [1.0, alpha - 1.0], values, axis=0, zi=(1.0 - alpha) * start[None, :])
    return np.asarray(values - mean, dtype=np.complex64)
