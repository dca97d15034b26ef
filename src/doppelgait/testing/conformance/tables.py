"""Scatterer tables of the checks."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.core.labels import SCATTERER_VARIABLES
from doppelgait.radar.parameters import Radar
from doppelgait.testing.conformance import theory

Float = npt.NDArray[np.float64]
DIMS = ("slow_time", "scatterer")


def table(
    range_m: npt.ArrayLike,
    *,
    slow_time_s: npt.ArrayLike | None = None,
    **values: npt.ArrayLike,
) -> xr.Dataset:
    """Scatterer table of ranges (I, L), or (I,) for one scatterer; 1 m^2 at rest unless ``values`` say otherwise."""
    ranges_m = np.asarray(range_m, dtype=float)
    ranges_m = ranges_m[:, None] if ranges_m.ndim == 1 else ranges_m
    given = {"range": ranges_m, "radial_velocity": 0.0, "rcs": 1.0, "path_gain": 1.0, **values}
    columns = {}
    for name, value in given.items():
        array = np.asarray(value, dtype=float)
        array = array[:, None] if array.ndim == 1 else array
        columns[name] = (DIMS, np.array(np.broadcast_to(array, ranges_m.shape)), {"units": SCATTERER_VARIABLES[name]})
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
    """Range at a fraction of the frame, in the middle of a bin (of a cw radar as it is); 1 m or more."""
    wanted_m = radar.range_start_m + fraction * (radar.range_stop_m - radar.range_start_m)
    wanted_m = max(wanted_m, 1.0)
    if radar.waveform.kind == "cw":
        return wanted_m
    axis_m = theory.range_axis_m(radar)
    return float(axis_m[np.abs(axis_m - wanted_m).argmin()])


def speed_mps(radar: Radar) -> float:
    """A speed at 0.6 of the unambiguous one, lambda f_p / 4."""
    return 0.6 * theory.wavelength_m(radar) * radar.prf_hz / 4.0


def approach(radar: Radar, *, start_m: float, stop_m: float, n_pulses: int, velocity_mps: float) -> xr.Dataset:
    """Table of one scatterer that goes from start to stop at its velocity (positive where stop is nearer)."""
    range_m = np.linspace(start_m, stop_m, n_pulses)
    duration_s = abs(stop_m - start_m) / abs(velocity_mps)
    times_s = np.linspace(0.0, duration_s, n_pulses)
    return table(range_m, slow_time_s=times_s, radial_velocity=math.copysign(abs(velocity_mps), start_m - stop_m))
