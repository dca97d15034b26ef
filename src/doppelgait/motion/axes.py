"""Upward axis of a recording, rotated to z."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import MotionError
from doppelgait.motion.skeleton import FOOT_PARTS

FloatArray = npt.NDArray[np.float64]

_METRES = {"mm": 1e-3, "cm": 1e-2, "dm": 1e-1, "m": 1.0, "in": 0.0254, "ft": 0.3048}
# files spell units in several languages, and some truncate the word to four letters
_WORDS = {"mill": "mm", "cent": "cm", "mete": "m", "metr": "m", "inch": "in", "foot": "ft", "feet": "ft"}


def convert_unit_to_metres(name: str, *, where: str) -> float:
    """Return the conversion factor from a length unit to metres."""
    word = name.strip().lower()
    factor = _METRES.get(_WORDS.get(word[:4], word))
    if factor is None:
        allowed = ", ".join(_METRES)
        raise MotionError(f"{where}: the unit {name!r} is not a known unit of length; set units to one of {allowed}")
    return factor


AXES = ("x", "y", "z", "-x", "-y", "-z")
"""Allowed names of the upward direction."""

_ROTATIONS = {
    "z": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "y": ((1, 0, 0), (0, 0, -1), (0, 1, 0)),
    "x": ((0, 1, 0), (0, 0, 1), (1, 0, 0)),
    "-z": ((1, 0, 0), (0, -1, 0), (0, 0, -1)),
    "-y": ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
    "-x": ((0, 1, 0), (0, 0, -1), (-1, 0, 0)),
}
"""Rotation matrix by upward axis. The rows are the new x, y and z in the old axes; none of them mirrors the body."""


def turn_z_up(position: FloatArray, up_axis: str) -> FloatArray:
    """Rotate positions so that ``up_axis`` becomes z. Shapes: position (T, P, 3)."""
    if up_axis not in _ROTATIONS:
        raise MotionError(f"up_axis={up_axis!r} is not allowed; use one of {', '.join(AXES)}")
    return np.asarray(position @ np.array(_ROTATIONS[up_axis], dtype=float).T)


def find_up_axis(position: FloatArray, parts: Sequence[str], *, declared: str = "") -> dict[str, Any]:
    """Find the upward axis of an upright body. Shapes: position (T, P, 3)."""
    # if feet, torso and head are known, the axis from the feet to the others is used
    typical = _compute_median(position, axis=0)
    # from the feet to head and torso; the mean of all points replaces an unknown end
    feet = [i for i, part in enumerate(parts) if part in FOOT_PARTS]
    body = [i for i, part in enumerate(parts) if part in ("head", "torso", "trunk")]
    head = [i for i, part in enumerate(parts) if part == "head"]
    lift = np.zeros(3)
    if feet or head:
        upper = typical[body if feet and body else head] if (feet and body) or head else typical
        lower = typical[feet] if feet else typical
        lift = np.nan_to_num(_compute_median(upper, axis=0) - _compute_median(lower, axis=0))
    order = np.argsort(-np.abs(lift))
    if abs(lift[order[0]]) > 1.5 * abs(lift[order[1]]):
        return {"up_axis": _name(int(order[0]), lift[order[0]]), "up_axis_from": "body parts"}
    extent, travel = np.nan_to_num(measure_body_extent(position)), np.zeros(3)
    centre = _compute_median(position, axis=1)
    seen = centre[np.isfinite(centre).all(axis=1)]
    if seen.size:  # travel along each axis, without the outermost 2 % of the frames at either end
        travel = np.percentile(seen, 98, axis=0) - np.percentile(seen, 2, axis=0)
    # z is preferred if axes are equal, since most systems use it
    other, axis = sorted(
        sorted((2, 1, 0), key=lambda k: round(float(travel[k]), 9))[:2], key=lambda k: float(extent[k])
    )
    stated = "xyz".find(declared) if declared else -1
    if stated >= 0 and not (extent[axis] > 2.0 * extent[stated] and travel[axis] <= travel[stated]):
        return {"up_axis": _name(stated, _find_height_sign(position, typical, stated)), "up_axis_from": "file"}
    if stated < 0 and extent[axis] < 1.3 * extent[other]:
        return {"up_axis": "z", "up_axis_from": "assumed"}
    return {"up_axis": _name(axis, _find_height_sign(position, typical, axis)), "up_axis_from": "motion"}


def _name(axis: int, sign: float) -> str:
    return ("" if sign >= 0 else "-") + "xyz"[axis]


def _compute_median(values: FloatArray, axis: int) -> FloatArray:
    # a column of NaN is a valid result here
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        return np.asarray(np.nanmedian(values, axis=axis))


def measure_body_extent(position: FloatArray) -> FloatArray:
    """Return the body's typical extent per axis. Shapes: position (T, P, 3)."""
    # it is the median over time of the distance between the outermost points, shape (3,)
    low = np.where(np.isnan(position), np.inf, position).min(axis=1)
    high = np.where(np.isnan(position), -np.inf, position).max(axis=1)
    return _compute_median(np.where(high >= low, high - low, np.nan), axis=0)


def _find_height_sign(position: FloatArray, typical: FloatArray, axis: int) -> float:
    """Return +1 for an upward or unknown axis, else -1."""
    # the floor of nearly every laboratory is at 0. Otherwise, points that come to rest at times are
    # taken for feet.
    height = typical[:, axis][np.isfinite(typical[:, axis])]
    if height.size < 3:
        return 1.0
    low, high = float(height.min()), float(height.max())
    if low > -0.15 * (high - low):
        return 1.0
    if high < 0.15 * (high - low):
        return -1.0
    speed = np.linalg.norm(np.diff(position, axis=0), axis=2)
    seen = np.isfinite(speed).sum(axis=0) >= 10
    if seen.sum() < 3:
        return 1.0
    slowest = np.nanpercentile(speed[:, seen], 15, axis=0)
    still = slowest < 0.25 * np.nanmedian(speed[:, seen])
    if not still.any() or still.all():
        return 1.0
    return float(np.sign(typical[seen, axis][~still].mean() - typical[seen, axis][still].mean())) or 1.0
