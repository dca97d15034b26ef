"""Checks that every narrow-band waveform shows the same walk."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.radar import Radar
from doppelgait_conformance import theory
from doppelgait_conformance.bench import Bench, Complex, simulate_baseband
from doppelgait_conformance.radars import make_narrow_radar

Float = npt.NDArray[np.float64]

SPEED_MPS = 1.2
DURATION_S = 4.0
CENTRE_M = 16.0
CPI = 61
HOP = 10
N_DOPPLER = 128
PADDED = 16
STEPS_HZ = (0.8, 4.0)
"""Range, Hz, of the step frequency of a walk."""


def same_signature(bench: Bench, radar: Radar) -> float:
    """Return 1 minus the signatures' correlation."""
    return float(1.0 - np.corrcoef(_simulate_signature(bench, radar).ravel(), compute_wanted_signature().ravel())[0, 1])


def same_gait(bench: Bench, radar: Radar) -> float:
    """Compare torso speed and step frequency, % (equivalence iv)."""
    mine, wanted, prf_hz = (
        _simulate_signature(bench, radar),
        compute_wanted_signature(),
        make_narrow_radar(radar.waveform.kind).prf_hz,
    )
    speed = abs(torso_doppler_hz(mine, prf_hz) / torso_doppler_hz(wanted, prf_hz) - 1.0)
    steps = abs(step_frequency_hz(mine, prf_hz) / step_frequency_hz(wanted, prf_hz) - 1.0)
    return 100.0 * max(speed, steps)


def _simulate_signature(bench: Bench, radar: Radar) -> Float:
    narrow = make_narrow_radar(radar.waveform.kind)
    return compute_signature(simulate_baseband(bench, walk(narrow.prf_hz), narrow)[1])


@lru_cache(maxsize=1)
def compute_wanted_signature() -> Float:
    """Compute the signature of the walk's summed phasors."""
    radar = make_narrow_radar("cw")
    scene = walk(radar.prf_hz)
    range_m = scene["range"].values
    level_v = theory.echo_v(radar, range_m=range_m, gain_m2=scene["rcs"].values * scene["path_gain"].values)
    phase_rad = radar.transmit_phase_rad - 4.0 * np.pi * range_m / theory.wavelength_m(radar)
    return compute_signature((level_v * np.exp(1j * phase_rad)).sum(axis=1, keepdims=True))


@lru_cache(maxsize=1)
def walk(prf_hz: float) -> xr.Dataset:
    """Simulate the scatterer table of an approaching person."""
    from doppelgait.motion import boulic_walk
    from doppelgait.scene import Scene, Target, assemble

    scene = Scene([Target(boulic_walk(speed_mps=SPEED_MPS, duration_s=DURATION_S), range_m=CENTRE_M)])
    return assemble(scene, np.arange(round(DURATION_S * prf_hz)) / prf_hz, angles=False)


def compute_signature(bins: Complex) -> Float:
    """Compute the share of power (time, Doppler) in Hann windows."""
    starts = np.arange(0, bins.shape[0] - CPI + 1, HOP)
    frames = bins[starts[:, None] + np.arange(CPI)] * np.hanning(CPI)[None, :, None]
    spectrum = np.fft.fftshift(np.fft.fft(frames, N_DOPPLER, axis=1), axes=1)
    power = (np.abs(spectrum) ** 2).sum(axis=2)
    return np.asarray(power / power.sum(axis=1, keepdims=True))


def torso_doppler_hz(share: Float, prf_hz: float) -> float:
    """Return the interpolated peak of the mean Doppler spectrum."""
    place = _find_peak(share.mean(axis=0), 1, N_DOPPLER - 1)
    return float((place - N_DOPPLER // 2) * prf_hz / N_DOPPLER)


def step_frequency_hz(share: Float, prf_hz: float) -> float:
    """Return the strongest frequency of the spectrum's width."""
    doppler = np.arange(N_DOPPLER) - N_DOPPLER // 2
    width = np.sqrt(share @ doppler**2 - (share @ doppler) ** 2)
    size = PADDED * width.size
    spectrum = np.abs(np.fft.rfft((width - width.mean()) * np.hanning(width.size), size))
    step_hz = prf_hz / HOP / size
    low, high = (round(limit / step_hz) for limit in STEPS_HZ)
    return float(_find_peak(spectrum, low, high) * step_hz)


def _find_peak(values: Float, low: int, high: int) -> float:
    n = low + int(values[low:high].argmax())
    left, top, right = values[n - 1 : n + 2]
    return float(n + 0.5 * (left - right) / (left - 2.0 * top + right))
