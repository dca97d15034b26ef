"""Style of the figures, as that of doppelgait.viz."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

BLUE, ORANGE, GREEN, PURPLE = "#0072b2", "#e69f00", "#009e73", "#cc79a7"
SKY, VERMILLION, YELLOW = "#56b4e9", "#d55e00", "#f0e442"
LINE_COLOURS = (SKY, ORANGE, "#ffffff", PURPLE, YELLOW, GREEN)
LINE, SHADE, GRID, REFERENCE, ACCENT = "#1f3b57", "#9ecae1", "#e0e0e0", "#606060", "#c1121f"
DOPPLER_LABEL, CADENCE_LABEL = "Doppler frequency (Hz)", "cadence (Hz)"


def make_figure(*, width_in: float = 10.5, height_in: float = 5.5) -> Figure:
    """Make an empty figure without global state."""
    figure = Figure(figsize=(width_in, height_in), dpi=110, layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def make_axes(*, width_in: float = 10.5, height_in: float = 5.5) -> tuple[Figure, Axes]:
    """Make a figure with one pair of axes."""
    figure = make_figure(width_in=width_in, height_in=height_in)
    return figure, figure.add_subplot()


def make_panels(
    across: int, down: int = 1, *, width_in: float = 12.0, height_in: float = 4.4
) -> tuple[Figure, list[Axes]]:
    """Make a figure with rows of axes."""
    figure = make_figure(width_in=width_in, height_in=height_in)
    return figure, list(figure.subplots(down, across, squeeze=False).flat)


def name_axes(axes: Axes, *, title: str, x: str, y: str) -> None:
    """Set title and axis labels."""
    axes.set_title(title, fontsize=11.5, loc="left")
    axes.set_xlabel(x, fontsize=10)
    axes.set_ylabel(y, fontsize=10)
    axes.tick_params(labelsize=9)


def draw_grid(axes: Axes) -> None:
    """Draw the grid behind everything else."""
    axes.grid(color=GRID, lw=0.6)
    axes.set_axisbelow(True)


def place_legend_below(figure: Figure, axes: Axes) -> None:
    """Put the legend of some axes below the figure."""
    axes.legend_ = None
    _strengthen(
        figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=6, fontsize=9, frameon=False)
    )


def legend_under(axes: Axes, *, columns: int = 1) -> None:
    """Put the legend of one panel below its labels."""
    style: dict[str, Any] = {"fontsize": 8.5, "frameon": False, "borderaxespad": 0.0}
    if axes.get_legend_handles_labels()[0]:
        _strengthen(axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=columns, **style))


def _strengthen(legend: Any) -> None:
    for handle in legend.legend_handles:
        if isinstance(handle, Line2D):
            handle.set(linewidth=max(handle.get_linewidth(), 1.5), alpha=1.0)
        else:
            handle.set(sizes=[30.0], alpha=1.0)


def mark_harmonics(
    axes: Axes, found_hz: Sequence[float | None], cadence_hz: npt.NDArray[np.float64], level: npt.NDArray[np.float64]
) -> None:
    """Mark the gait frequency and its harmonics by number; the legend has their values."""
    for number, value in enumerate(found_hz, start=1):
        if value is None or not np.isfinite(value) or value > axes.get_xlim()[1]:
            continue
        height = float(np.interp(value, cadence_hz, level))
        label = f"{number}: {'gait frequency' if number == 1 else 'harmonic'}, {value:.2f} Hz"
        axes.plot([value], [height], marker="o", color=ACCENT, ms=5, ls="none", label=label)
        style: dict[str, Any] = {"xytext": (0, 7), "textcoords": "offset points", "fontsize": 9, "color": ACCENT}
        axes.annotate(str(number), (value, height), ha="center", va="bottom", **style)
