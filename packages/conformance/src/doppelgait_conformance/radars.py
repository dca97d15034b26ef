"""Radars and scatterer tables of the checks."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait import ConfigError
from doppelgait.radar import Radar
from doppelgait_conformance import theory

Float = npt.NDArray[np.float64]
DIMS = ("slow_time", "scatterer")
UNITS = {"range": "m", "radial_velocity": "m/s", "rcs": "m^2", "path_gain": "1"}
"""Units of the columns of a scatterer table; the others are angles, rad."""


def make_table(
    range_m: npt.ArrayLike, *, slow_time_s: npt.ArrayLike | None = None, **values: npt.ArrayLike
) -> xr.Dataset:
    """Make a scatterer table of ranges (I, L) or (I,)."""
    ranges_m = np.asarray(range_m, dtype=float)
    ranges_m = ranges_m[:, None] if ranges_m.ndim == 1 else ranges_m
    wanted = {"range": ranges_m, "radial_velocity": 0.0, "rcs": 1.0, "path_gain": 1.0, **values}
    columns = {}
    for name, value in wanted.items():
        array = np.asarray(value, dtype=float)
        array = array[:, None] if array.ndim == 1 else array
        columns[name] = (DIMS, np.array(np.broadcast_to(array, ranges_m.shape)), {"units": UNITS.get(name, "rad")})
    n_pulses, n_scatterers = ranges_m.shape
    times_s = np.arange(n_pulses) / 1000.0 if slow_time_s is None else np.asarray(slow_time_s, dtype=float)
    return xr.Dataset(
        columns,
        coords={
            "slow_time": ("slow_time", times_s, {"units": "s"}),
            "target": ("scatterer", np.zeros(n_scatterers, dtype=int)),
            "marker": ("scatterer", np.array([f"point{n}" for n in range(n_scatterers)], dtype=str)),
            "part": ("scatterer", np.array(["torso"] * n_scatterers, dtype=str)),
        },
    )


def place_m(radar: Radar, fraction: float) -> float:
    """Return the range at a fraction of the frame."""
    wanted_m = radar.range_start_m + fraction * (radar.range_stop_m - radar.range_start_m)
    wanted_m = max(wanted_m, 1.0)
    if radar.waveform.kind == "cw":
        return wanted_m
    axis_m = theory.range_axis_m(radar)
    return float(axis_m[np.abs(axis_m - wanted_m).argmin()])


def speed_mps(radar: Radar) -> float:
    """Return 0.6 of the unambiguous speed lambda f_p / 4."""
    return 0.6 * theory.wavelength_m(radar) * radar.prf_hz / 4.0


def make_approach(radar: Radar, *, start_m: float, stop_m: float, n_pulses: int, velocity_mps: float) -> xr.Dataset:
    """Make the table of a scatterer at constant velocity."""
    range_m = np.linspace(start_m, stop_m, n_pulses)
    duration_s = abs(stop_m - start_m) / abs(velocity_mps)
    times_s = np.linspace(0.0, duration_s, n_pulses)
    return make_table(range_m, slow_time_s=times_s, radial_velocity=math.copysign(abs(velocity_mps), start_m - stop_m))


COMMON: dict[str, Any] = {
    "carrier_hz": 7.29e9,
    "prf_hz": 1000.0,
    "range_stop_m": 9.6,
    "transmit_phase_rad": 0.4,
    "tx_power_dbm": 6.0,
    "tx_gain_dbi": 4.0,
    "rx_gain_dbi": 3.0,
    "receiver_gain_db": 10.0,
    "noise_figure_db": 7.0,
}
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
"""Bandwidths, Hz, at which a walking body is at most one range cell deep."""


def list_suite_radars(*waveforms: str) -> dict[str, Radar]:
    """Return the suite's radars by waveform."""
    for waveform in waveforms:
        check_waveform(waveform)
    return {name: Radar(waveform=name, **COMMON, **WIDE[name]) for name in waveforms or theory.WAVEFORMS}


def make_narrow_radar(waveform: str) -> Radar:
    """Make a narrow-band radar for the comparison of waveforms."""
    return Radar(waveform=waveform, **NARROW_COMMON, **NARROW[waveform])


def change_radar(radar: Radar, **changes: Any) -> Radar:
    """Return the radar with other parameters, checked again."""
    return Radar.model_validate({**radar.model_dump(), **changes})


def check_waveform(waveform: str) -> None:
    """Refuse a waveform without theory (:class:`ConfigError`)."""
    if waveform not in theory.WAVEFORMS:
        raise ConfigError(
            f"conformance: there is no theory for waveform {waveform!r}; known are {', '.join(theory.WAVEFORMS)}"
        )
