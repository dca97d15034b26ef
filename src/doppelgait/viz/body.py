"""Body parts in figures: groups, their colours, and lines over time coloured by them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import xarray as xr
from matplotlib.axes import Axes

from doppelgait.core.errors import AnalysisError

FloatArray = npt.NDArray[np.float64]

PART_COLOURS = {
    "torso": "#c1121f",
    "head": "#cc79a7",
    "neck": "#cc79a7",
    "left arm": "#e69f00",
    "right arm": "#56b4e9",
    "left foreleg": "#e69f00",
    "right foreleg": "#56b4e9",
    "left leg": "#009e73",
    "right leg": "#0072b2",
    "left hind leg": "#009e73",
    "right hind leg": "#0072b2",
    "tail": "#8c564b",
    "other": "#808080",
}
"""Colour of every group of body parts, the same in all figures; left warm or green, right blue."""

FEET = ("foot", "paw")
LIMB_ORDER = ("thigh", "upper_arm", "upper", "shank", "forearm", "lower", "foot", "hand", "paw")
"""Endings of the parts of a limb from the body outwards."""
LIMB_PARTS = frozenset(
    f"{side}_{rest}"
    for side in ("left", "right")
    for rest in (
        *("upper_arm", "forearm", "hand", "thigh", "shank", "foot"),
        *(f"{limb}_{end}" for limb in ("fore", "hind") for end in ("upper", "lower", "paw")),
    )
)
TORSO = ("torso", "trunk")
THIN, BOLD = 0.7, 2.2


def part_group(part: str) -> str:
    """Group of a body part of :mod:`doppelgait.motion.skeleton`; ``"other"`` when unknown."""
    if part in TORSO:
        return "torso"
    side, _, rest = part.partition("_")
    if side in ("left", "right"):
        limb = rest.partition("_")[0]
        name = {"upper": "arm", "forearm": "arm", "hand": "arm", "fore": "foreleg", "hind": "hind leg"}.get(limb, "leg")
        return f"{side} {name}"
    return part if part in PART_COLOURS else "other"


def limb_rank(part: str) -> int:
    """Place of a part in its limb, from the body outwards."""
    return next(rank for rank, ending in enumerate(LIMB_ORDER) if part.endswith(ending))


def part_colour(part: str) -> str:
    """Colour of a body part."""
    return PART_COLOURS[part_group(part)]


def bold_name(part: str) -> str | None:
    """Legend entry of a part whose mean is drawn bold (torso, feet, paws); None for all others."""
    if part in TORSO:
        return "torso"
    return part.replace("_", " ") if part.endswith(FEET) else None


@dataclass(frozen=True)
class PartLines:
    """Lines over time with the body part of each.

    Parameters
    ----------
    time_s : ndarray, shape (T,)
    values : ndarray, shape (T, L)
    parts : tuple of str, length L
    target : ndarray of int, shape (L,)
        Which of the targets in the array each line belongs to, from 0.
    """

    time_s: FloatArray
    values: FloatArray
    parts: tuple[str, ...]
    target: npt.NDArray[np.int64]


def part_lines(array: xr.DataArray) -> PartLines:
    """Lines of an array (slow_time, scatterer) with the coordinate ``part``.

    Raises
    ------
    AnalysisError
        If it has other dimensions, no part or no values.
    """
    name = array.name or "scatterers"
    if array.dims != ("slow_time", "scatterer") or "slow_time" not in array.coords:
        raise AnalysisError(
            f"{name}: dimensions are {array.dims}, must be ('slow_time', 'scatterer') with slow_time in s"
        )
    if "part" not in array.coords:
        raise AnalysisError(f"{name}: coordinate 'part' (body part of every scatterer) is missing")
    if array.size == 0:
        raise AnalysisError(f"{name}: nothing to draw, its shape is {array.shape}")
    count = array.sizes["scatterer"]
    target = array.coords["target"].values if "target" in array.coords else np.zeros(count, dtype=np.int64)
    return PartLines(
        time_s=np.asarray(array.coords["slow_time"].values, dtype=np.float64),
        values=np.asarray(array.values, dtype=np.float64),
        parts=tuple(str(part) for part in array.coords["part"].values),
        target=np.unique(np.asarray(target), return_inverse=True)[1].astype(np.int64),
    )


def draw_part_lines(axes: Axes, lines: PartLines, *, width: float = THIN, bold: float = BOLD) -> None:
    """Every line thin in its part's colour; the mean of the torso and of every foot bold.

    ``bold=0`` leaves the bold lines out. Targets after the first are dashed.
    """
    for number in dict.fromkeys(lines.target.tolist() if bold else ()):
        first = number == 0
        names = [bold_name(part) if lines.target[n] == number else None for n, part in enumerate(lines.parts)]
        for name in dict.fromkeys(name for name in names if name):
            chosen = [n for n, other in enumerate(names) if other == name]
            axes.plot(
                lines.time_s, mean_ignoring_nan(lines.values, chosen), color=part_colour(lines.parts[chosen[0]]),
                lw=bold, ls=_dash(number), label=f"{name} (mean)" if first else None, zorder=3,
            )  # fmt: skip
    labelled: set[str] = set()
    for column, part in enumerate(lines.parts):
        group = part_group(part)
        label = group if group not in labelled else None
        labelled.add(group)
        axes.plot(
            lines.time_s, lines.values[:, column], color=PART_COLOURS[group], lw=width, alpha=0.8,
            ls=_dash(int(lines.target[column])), label=label,
        )  # fmt: skip


def _dash(number: int) -> str:
    return ("-", "--", ":", "-.")[number % 4]


def mean_ignoring_nan(values: FloatArray, columns: Sequence[int]) -> FloatArray:
    """Mean over some columns, NaN only where all of them are; shape (T,)."""
    chosen = values[:, list(columns)]
    known = np.isfinite(chosen)
    count = known.sum(axis=1)
    total = np.where(known, chosen, 0.0).sum(axis=1)
    mean = np.full(total.shape, np.nan)
    np.divide(total, count, out=mean, where=count > 0)
    return mean
