"""Single points of known range and velocity in front of the radar: what the illustrations of chapters 2 and 3 need."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.core.labels import SCATTERER_VARIABLES
from doppelgait.core.units import slow_time_axis_s
from doppelgait.radar import Radar, synthesise


def point_table(
    radar: Radar, n_frames: int, *, range_m: npt.ArrayLike, velocity_mps: npt.ArrayLike, rcs_m2: npt.ArrayLike = 1.0
) -> xr.Dataset:
    """Scatterer table of points at constant radial velocity.

    Parameters
    ----------
    radar : Radar
        Gives the frame rate.
    n_frames : int
    range_m : array_like, shape (L,)
        Ranges in the middle of the frames.
    velocity_mps : array_like, shape (L,)
        Positive approaching.
    rcs_m2 : array_like, shape (L,) or scalar

    Returns
    -------
    Dataset (slow_time, scatterer)
    """
    time_s = slow_time_axis_s(n_frames, radar.prf_hz)
    ranges, speeds, sections = np.broadcast_arrays(
        *(np.atleast_1d(np.asarray(values, dtype=float)) for values in (range_m, velocity_mps, rcs_m2))
    )
    way_m = (time_s - time_s[-1] / 2)[:, None] * speeds
    values = {
        "range": ranges - way_m,
        "radial_velocity": np.broadcast_to(speeds, way_m.shape),
        "rcs": np.broadcast_to(sections, way_m.shape),
        "path_gain": np.ones_like(way_m),
    }
    dims = ("slow_time", "scatterer")
    return xr.Dataset(
        {name: (dims, array, {"units": SCATTERER_VARIABLES[name]}) for name, array in values.items()},
        coords={
            "slow_time": ("slow_time", time_s, {"units": "s"}),
            "target": ("scatterer", np.arange(ranges.size)),
            "marker": ("scatterer", np.array([f"point {n}" for n in range(ranges.size)])),
            "part": ("scatterer", np.full(ranges.size, "")),
        },
    )


def slow_time_signal(radar: Radar, table: xr.Dataset, *, range_m: float) -> npt.NDArray[np.complex128]:
    """Noise-free samples of the range bin at a range over the frames, V."""
    baseband = synthesise(table, radar)
    return np.asarray(baseband.sel(range=range_m, method="nearest").values, dtype=np.complex128)
