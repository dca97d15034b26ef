"""What follows from a radar's parameters."""

from __future__ import annotations

import math

from doppelgait.core.units import power_to_db, watt_to_dbm
from doppelgait.radar.config import Radar
from doppelgait.radar.link import echo_amplitude_v, noise_power_v2, received_power_w
from doppelgait.radar.waveforms import waveform_of

CPI_S = 0.1
"""Processing interval that the velocity resolution is given for."""
RANGE_M = 5.0
"""Range that power and SNR of 1 m^2 are given for."""


def derived_quantities(radar: Radar) -> dict[str, float]:
    """Derived quantities of a radar by name, the unit at the end of each; what the waveform has not is left out."""
    waveform = waveform_of(radar)
    values = {
        "wavelength_m": radar.wavelength_m,
        **waveform.figures(radar),
        "range_resolution_m": radar.range_resolution_m,
        "bin_spacing_m": radar.bin_spacing_m,
        "n_range_bins": radar.n_range_bins,
        "range_stop_m": radar.range_stop_m,
        "unambiguous_range_m": waveform.unambiguous_range_m(radar),
        "unambiguous_velocity_mps": radar.unambiguous_velocity_mps,
        "velocity_resolution_100ms_mps": radar.wavelength_m / (2.0 * CPI_S),
        "averages_per_frame": radar.averages_per_frame,
        **_levels(radar),
    }
    if radar.waveform == "cw":
        del values["range_resolution_m"], values["bin_spacing_m"]
    return {name: value for name, value in values.items() if math.isfinite(value)}


def _levels(radar: Radar) -> dict[str, float]:
    """Noise in one bin, and echo power and single-frame SNR of 1 m^2 at 5 m, on its bin's middle (E-14, E-18)."""
    noise_v2 = noise_power_v2(radar)
    power_w = received_power_w(radar, range_m=RANGE_M, rcs_m2=1.0)
    echo_v = echo_amplitude_v(radar, range_m=RANGE_M, rcs_m2=1.0)
    return {
        "noise_power_v2": noise_v2,
        "noise_level_dbv": float(power_to_db(noise_v2)),
        "received_power_1m2_5m_dbm": float(watt_to_dbm(power_w)),
        "snr_1m2_5m_db": float(power_to_db(echo_v**2 / noise_v2)),
    }
