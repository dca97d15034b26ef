"""What one writes first: the equations in NumPy, and the transforms that SciPy has.

"Obvious NumPy": float64, one scatterer at a time, a loop over frames that transforms the gated bins, the same K.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from doppelgait.core.units import SPEED_OF_LIGHT_MPS
from doppelgait.radar import Radar


def obvious_synthesis(table: xr.Dataset, radar: Radar, amplitude_v: Any) -> Any:
    """E-18, one scatterer at a time."""
    axis = radar.range_axis_m()
    sigma_m = SPEED_OF_LIGHT_MPS * radar.sigma_s / 2
    out = np.zeros((table.sizes["slow_time"], axis.size), dtype=np.complex128)
    for scatterer in range(table.sizes["scatterer"]):
        range_m = table["range"].values[:, scatterer]
        pulse = np.exp(-0.5 * ((axis[None, :] - range_m[:, None]) / sigma_m) ** 2)
        phase = np.exp(-4j * np.pi * range_m / radar.wavelength_m)
        out += (amplitude_v[:, scatterer] * phase)[:, None] * pulse
    return out


def obvious_signature(baseband: Any, first_bin: Any, n_bins: int, window: Any, n_doppler: int) -> Any:
    """E-24 and E-27, a loop over columns; bins are in the gate wholly or not at all."""
    out = np.empty((first_bin.size, n_doppler))
    for j in range(first_bin.size):
        gated = baseband[j : j + window.size, first_bin[j] : first_bin[j] + n_bins]
        spectrum = np.fft.fft(gated * window[:, None], n_doppler, axis=0)
        out[j] = np.fft.fftshift((np.abs(spectrum) ** 2).sum(axis=1))
    return out


def obvious_edge_signature(baseband: Any, low: Any, high: Any, window: Any, n_doppler: int) -> Any:
    """Compute the same, but weight a bin by its share inside the gate.

    ``low`` and ``high`` are the edges of the gate in bins.
    """
    out = np.empty((low.size, n_doppler))
    for j in range(low.size):
        bins = np.arange(int(np.rint(low[j])), int(np.rint(high[j])) + 1)
        share = np.clip(np.minimum(bins + 0.5, high[j]) - np.maximum(bins - 0.5, low[j]), 0.0, 1.0)
        spectrum = np.fft.fft(baseband[j : j + window.size, bins] * window[:, None], n_doppler, axis=0)
        out[j] = np.fft.fftshift((np.abs(spectrum) ** 2) @ share)
    return out


def obvious_noise(baseband: Any, rms_v: float, generator: np.random.Generator) -> Any:
    """E-18, complex normals of the generator added to a whole data matrix."""
    parts = generator.standard_normal((2, *baseband.shape))
    return baseband + rms_v / np.sqrt(2) * (parts[0] + 1j * parts[1])


def scipy_spectrogram(gated: Any, window: Any, n_doppler: int) -> Any:
    """Signature of a gate of fixed place (bins, pulses) by ``scipy.signal.spectrogram``, all bins in one call."""
    from scipy.signal import spectrogram

    power = spectrogram(
        gated, window=window.astype(np.float32), nperseg=window.size, noverlap=window.size - 1, nfft=n_doppler,
        detrend=False, return_onesided=False, mode="psd",
    )[2]  # fmt: skip
    return np.fft.fftshift(power.sum(axis=0), axes=0).T


def scipy_spectrogram_by_bin(gated: Any, window: Any, n_doppler: int) -> Any:
    """Compute the same with one call a bin: less memory, faster."""
    return sum(scipy_spectrogram(row[None], window, n_doppler) for row in gated)


def scipy_short_time_fft(gated: Any, window: Any, n_doppler: int) -> Any:
    """Compute the same by ``scipy.signal.ShortTimeFFT``, all bins in one call.

    Only columns with the window inside the recording.
    """
    from scipy.signal import ShortTimeFFT

    transform = ShortTimeFFT(
        window.astype(np.float32), hop=1, fs=1.0, fft_mode="centered", mfft=n_doppler, phase_shift=None
    )
    half = window.size // 2
    spectrum = transform.stft(gated, p0=half, p1=gated.shape[-1] - half, axis=-1)
    return (spectrum.real**2 + spectrum.imag**2).sum(axis=0).T
