"""Features of many examples: one against another, and six at once by class."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from doppelgait.core.errors import AnalysisError
from doppelgait.viz.style import (
    FEATURE_NAMES,
    class_colours,
    legend_below,
    name_axes,
    new_axes,
    new_figure,
    quantity_label,
)

if TYPE_CHECKING:
    import pandas as pd

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

BINS = 30
TAIL = 0.002
"""Share at either end that a histogram's first and last bin take in, so that single outliers do not flatten it."""


def _columns(table: pd.DataFrame, names: Sequence[str], by: str) -> tuple[dict[str, FloatArray], npt.NDArray[np.str_]]:
    missing = [name for name in (*names, by) if name not in table.columns]
    if missing:
        raise AnalysisError(f"the table has no columns {missing}; it has {[str(name) for name in table.columns]}")
    if len(table) == 0:
        raise AnalysisError("the table has no rows: nothing to draw")
    try:
        values = {name: np.asarray(table[name].to_numpy(dtype=float, na_value=np.nan)) for name in names}
    except (TypeError, ValueError) as error:
        raise AnalysisError(f"the columns {list(names)} must hold numbers: {error}") from None
    classes = table[by].fillna("unknown").astype(str).to_numpy(dtype=str)
    return values, np.where(classes == "", "unknown", classes)


def _count(name: str, known: BoolArray, members: BoolArray) -> str:
    left_out = int((members & ~known).sum())
    return f"{name} (n = {int((members & known).sum())}" + (f", {left_out} left out)" if left_out else ")")


def feature_scatter(table: pd.DataFrame, *, x: str, y: str, by: str = "label", title: str | None = None) -> Figure:
    """One feature against another by class (the report's Fig. 5.8).

    Parameters
    ----------
    table : DataFrame
        One row per example.
    x, y : str
        Columns; the unit on the axis comes from the name's ending. Rows where one is None or NaN are left out and
        counted in the legend.
    by : str
        Column of the class.
    title : str, optional

    Returns
    -------
    Figure

    Raises
    ------
    AnalysisError
        If columns are missing or hold no numbers, or the table is empty.
    """
    values, classes = _columns(table, (x, y), by)
    known = np.isfinite(values[x]) & np.isfinite(values[y])
    figure, axes = new_axes(width_in=9.5, height_in=6.0)
    size = float(np.clip(4000.0 / len(classes), 5.0, 26.0))
    for name, colour in class_colours(classes.tolist()).items():
        members = classes == name
        chosen = members & known
        axes.scatter(
            values[x][chosen], values[y][chosen], s=size, color=colour, alpha=0.65, lw=0,
            label=_count(name, known, members),
        )  # fmt: skip
    axes.grid(color="#e0e0e0", lw=0.6)
    axes.set_axisbelow(True)
    x_label, y_label = quantity_label(x), quantity_label(y)
    words = f"{y_label.rpartition(' (')[0]} against {x_label.rpartition(' (')[0]}"
    name_axes(axes, title=title or words[0].upper() + words[1:], x=x_label, y=y_label)
    legend_below(figure, axes)
    return figure


def feature_matrix(
    table: pd.DataFrame, *, features: Sequence[str] = FEATURE_NAMES, by: str = "label", title: str = "Features by class"
) -> Figure:
    """Distribution of every feature by class, one small histogram each (the report's Fig. 5.9).

    Parameters
    ----------
    table : DataFrame
        One row per example.
    features : sequence of str
        Columns, 1 to 12; the six features by default. None and NaN are left out and counted in the panel.
    by : str
        Column of the class.
    title : str

    Returns
    -------
    Figure
        Share of the class's known values per bin; the end bins hold the outermost 0.2 % and all beyond.

    Raises
    ------
    AnalysisError
        If columns are missing or hold no numbers, or the table is empty.
    """
    if not 1 <= len(features) <= 12:
        raise AnalysisError(f"features are {len(features)} columns; 1 to 12 fit on a page")
    values, classes = _columns(table, features, by)
    across = min(3, len(features))
    down = -(-len(features) // across)
    figure = new_figure(width_in=12.0, height_in=1.2 + 2.9 * down)
    panels = list(figure.subplots(down, across, squeeze=False).flat)
    for axes, name in zip(panels, features, strict=False):
        _histogram(axes, values[name], classes)
        name_axes(axes, title="", x=quantity_label(name), y="share of class (%)")
    for axes in panels[len(features) :]:
        axes.set_visible(False)
    figure.suptitle(title, fontsize=11.5, x=0.01, ha="left")
    return figure


def _histogram(axes: Axes, values: FloatArray, classes: npt.NDArray[np.str_]) -> None:
    known = np.isfinite(values)
    edges = bin_edges(values[known])
    for name, colour in class_colours(classes.tolist()).items():
        members = classes == name
        inside = np.clip(values[members & known], edges[0], edges[-1])
        counts = np.histogram(inside, edges)[0]
        axes.stairs(
            100.0 * counts / max(inside.size, 1), edges, color=colour, fill=True, alpha=0.4, lw=1.2, edgecolor=colour,
            label=_count(name, known, members),
        )  # fmt: skip
    axes.set_ylim(0.0, 1.3 * max(axes.get_ylim()[1], 1e-9))
    axes.legend(fontsize=8.5, frameon=False, loc="upper right")
    axes.grid(color="#e8e8e8", lw=0.6)
    axes.set_axisbelow(True)


def bin_edges(known: FloatArray) -> FloatArray:
    """Edges of 30 bins between the outer quantiles of the values; around them if all are the same, shape (31,)."""
    if not known.size:
        return np.linspace(0.0, 1.0, BINS + 1)
    low, high = (float(level) for level in np.quantile(known, [TAIL, 1.0 - TAIL]))
    if not high > low:
        reach = max(abs(low) * 0.05, 0.5)
        low, high = low - reach, high + reach
    return np.linspace(low, high, BINS + 1)
