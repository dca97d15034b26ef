"""Continuous wave: one complex sample per frame, no range."""

from __future__ import annotations

import numpy as np
import xarray as xr

from doppelgait.radar.config import Radar
from doppelgait.radar.link import path_phase_rad, scatterer_arrays
from doppelgait.radar.waveforms.protocol import Samples, Waveform, no_coupling, no_gain, unchanged


def check(radar: Radar) -> None:
    """Nothing beyond what every radar needs."""


def span_m(radar: Radar) -> float:
    """The frame's span, which the one range bin stands for; the radar itself sees every range."""
    return radar.range_stop_m - radar.range_start_m


def middle_m(radar: Radar) -> float:
    """Middle of the frame, the range that the one bin is labelled with."""
    return 0.5 * (radar.range_start_m + radar.range_stop_m)


def one(radar: Radar) -> int:
    """One sample, one bin."""
    return 1


def synthesise(scatterers: xr.Dataset, radar: Radar) -> Samples:
    """Sum of a exp(j(theta + phi - 4 pi R / lambda)) over all scatterers, at whatever range."""
    range_m, amplitude_v = scatterer_arrays(scatterers, radar)
    turns = range_m * (2.0 / radar.wavelength_m)
    phase_rad = -2.0 * np.pi * (turns - np.rint(turns)) + radar.transmit_phase_rad
    extra_rad = path_phase_rad(scatterers)
    if extra_rad is not None:
        phase_rad += extra_rad
    total = (amplitude_v * np.exp(1j * phase_rad)).sum(axis=1, keepdims=True)
    return np.asarray(total, dtype=np.complex64)


def noise_bandwidth_hz(radar: Radar) -> float:
    """Noise bandwidth of a sample that averages over its frame: the frame rate."""
    return radar.prf_hz


def no_limit(radar: Radar) -> float:
    """Range at which echoes fold: none."""
    return float("inf")


def figures(radar: Radar) -> dict[str, float]:
    """Nothing further."""
    return {}


CW = Waveform(
    check=check,
    n_samples=one,
    n_range_bins=one,
    first_bin_m=middle_m,
    bin_spacing_m=span_m,
    synthesise=synthesise,
    compress=unchanged,
    resolution_m=span_m,
    noise_bandwidth_hz=noise_bandwidth_hz,
    noise_gain=no_gain,
    unambiguous_range_m=no_limit,
    coupling_s=no_coupling,
    figures=figures,
    takes=("noise_bandwidth_hz",),
)
