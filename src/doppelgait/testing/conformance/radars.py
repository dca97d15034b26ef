"""Radars that the suite uses unless others are given: one of every waveform, with equal carrier and frame rate."""

from __future__ import annotations

from typing import Any

from doppelgait.core.errors import ConfigError
from doppelgait.radar.parameters import Radar
from doppelgait.testing.conformance import theory

COMMON: dict[str, Any] = {
    "carrier_hz": 7.29e9, "prf_hz": 1000.0, "range_stop_m": 9.6, "transmit_phase_rad": 0.4, "tx_power_dbm": 6.0,
    "tx_gain_dbi": 4.0, "rx_gain_dbi": 3.0, "receiver_gain_db": 10.0, "noise_figure_db": 7.0,
}  # fmt: skip
SWEEP = {"bandwidth_hz": 1e9, "sweep_s": 8e-4, "sample_rate_hz": 160e3}
WIDE: dict[str, dict[str, Any]] = {
    "impulse": {"bandwidth_hz": 1.4e9, "sample_rate_hz": 3e9, "pulse_rate_hz": 64e3},
    "rectangular": {"sweep_s": 1e-9, "sample_rate_hz": 3e9},
    "lfm": {"bandwidth_hz": 1e9, "sweep_s": 2e-7, "sample_rate_hz": 3e9},
    "fmcw": SWEEP,
    "stepped": SWEEP,
    "cw": {},
}

NARROW_COMMON = {**COMMON, "prf_hz": 600.0, "range_start_m": 7.0, "range_stop_m": 25.0}
NARROW_SWEEP = {"bandwidth_hz": 50e6, "sweep_s": 1e-4, "sample_rate_hz": 640e3}
NARROW: dict[str, dict[str, Any]] = {
    "impulse": {"bandwidth_hz": 60e6, "sample_rate_hz": 150e6},
    "rectangular": {"sweep_s": 30e-9, "sample_rate_hz": 150e6},
    "lfm": {"bandwidth_hz": 50e6, "sweep_s": 1e-6, "sample_rate_hz": 150e6},
    "fmcw": NARROW_SWEEP,
    "stepped": NARROW_SWEEP,
    "cw": {},
}
"""Bands so small that a walking body is one cell deep or less."""


def suite_radars(*waveforms: str) -> dict[str, Radar]:
    """Radars of the suite by waveform; all, or those named.

    Raises
    ------
    ConfigError
        If there is no theory for a waveform.
    """
    for waveform in waveforms:
        check_waveform(waveform)
    return {name: Radar(waveform=name, **COMMON, **WIDE[name]) for name in waveforms or theory.WAVEFORMS}


def narrow_radar(waveform: str) -> Radar:
    """Radar of a small band for the comparison of waveforms."""
    return Radar(waveform=waveform, **NARROW_COMMON, **NARROW[waveform])


def changed(radar: Radar, **changes: Any) -> Radar:
    """The radar with other parameters, checked again."""
    return Radar.model_validate({**radar.model_dump(), **changes})


def check_waveform(waveform: str) -> None:
    """Refuse a waveform without theory (:class:`ConfigError`)."""
    if waveform not in theory.WAVEFORMS:
        raise ConfigError(
            f"conformance: there is no theory for waveform {waveform!r}; known are {', '.join(theory.WAVEFORMS)}"
        )
