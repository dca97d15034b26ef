"""Page of real and simulated recordings side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Bbox

from doppelgait.viz.style import MAP_COLOURS, RANGE_LABEL, make_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TABLE_TITLE = "AUC (95 % interval); for each statistic, distance in standard deviations (AUC of this statistic alone)"

Picture = tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], str]


def plot_domains(
    pictures: Mapping[str, Sequence[Picture]], table: Sequence[Mapping[str, str]], *, title: str
) -> Figure:
    """Plot recordings of every kind, with a table below."""
    columns = max(len(row) for row in pictures.values())
    figure = make_figure(width_in=11.0, height_in=2.6 * len(pictures) + 0.24 * len(table) + 0.8)
    heights = [2.6] * len(pictures) + [0.24 * len(table) + 0.4]
    grid = figure.add_gridspec(len(pictures) + 1, columns, height_ratios=heights)
    figure.suptitle(title, fontsize=12, x=0.01, ha="left")
    for line, (kind, shown) in enumerate(pictures.items()):
        for column, (level_db, axis, label) in enumerate(shown):
            axes = figure.add_subplot(grid[line, column])
            level_db = level_db - np.median(level_db)
            extent = (0.0, float(len(level_db)), float(axis[0]), float(axis[-1]))
            image = axes.imshow(
                level_db.T,
                origin="lower",
                aspect="auto",
                extent=extent,
                vmin=-10.0,
                vmax=25.0,
                cmap=MAP_COLOURS,
                interpolation="nearest",
            )
            axes.set_title(kind if column == 0 else "", fontsize=10, loc="left")
            axes.set_ylabel(label if column == 0 else "", fontsize=9)
            step = "pulse number" if label == RANGE_LABEL else "window number"
            axes.set_xlabel(step if line == len(pictures) - 1 else "", fontsize=9)
            axes.xaxis.set_major_locator(MaxNLocator(4, integer=True))
            axes.tick_params(labelsize=8)
    figure.colorbar(image, ax=figure.axes, aspect=40, pad=0.02).set_label("level above the median (dB)", fontsize=9)
    axes = figure.add_subplot(grid[-1, :])
    axes.axis("off")
    axes.set_title(TABLE_TITLE, fontsize=9, loc="left")
    names = list(table[0])
    cells = [[row[name] for name in names] for row in table]
    made = axes.table(cellText=cells, colLabels=names, loc="upper center", cellLoc="left", bbox=Bbox.unit())
    made.auto_set_font_size(False)
    made.set_fontsize(8)
    for cell in made.get_celld().values():
        cell.set_linewidth(0.3)
    return figure
