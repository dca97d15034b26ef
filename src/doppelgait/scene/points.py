"""Other points of the same motion: ellipsoid centres, joints, merged markers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.core.labels import MOTION, SPACE, axis, make_array


def with_points(
    motion: xr.DataArray, position_m: npt.NDArray[Any], markers: Sequence[str], parts: Sequence[str], **report: Any
) -> xr.DataArray:
    """Motion of other points (T, P, 3) at the times and with the facts of ``motion``; ``report`` joins its report."""
    coords = {
        "time": axis(motion, "time"),
        "marker": list(markers),
        "space": list(SPACE),
        "part": ("marker", list(parts)),
    }
    facts = {key: value for key, value in motion.attrs.items() if key != "units"}
    facts["report"] = {**facts.get("report", {}), **report}
    return make_array(MOTION, position_m, coords, facts)


def mean_points(motion: xr.DataArray, groups: Sequence[Sequence[int]]) -> npt.NDArray[np.float64]:
    """Mean positions of groups of points, shape (T, G, 3), m. A spline through means is the mean of the splines."""
    values = motion.values
    return np.stack([values[:, list(group)].mean(axis=1) for group in groups], axis=1)
