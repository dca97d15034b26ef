"""Figures of features, signatures and recordings of several kinds."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
import numpy.typing as npt
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Bbox

from doppelgait.core.errors import AnalysisError
from doppelgait.viz import style
from doppelgait.viz.maps import (
    Shown,
    add_colour_bar,
    add_velocity_axis,
    check_signature,
    compute_level_db,
    doppler_limits_hz,
    finish_axes,
    level_limits_db,
    plot_map,
    wavelength_m,
)
from doppelgait.viz.ranges import Limits, choose_reference
from doppelgait.viz.ranges import signature as plot_signature

if TYPE_CHECKING:
    import pandas as pd

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

BINS = (8, 30)
TAIL = 0.002
"""Share of the values at each end that is in the first and last bin, so that outliers do not widen a histogram."""


def _select_columns(
    table: pd.DataFrame, names: Sequence[str], by: str
) -> tuple[dict[str, FloatArray], npt.NDArray[np.str_]]:
    missing = [name for name in (*names, by) if name not in table.columns]
    if missing:
        raise AnalysisError(f"the table has no columns {missing}; it has {[str(name) for name in table.columns]}")
    if len(table) == 0:
        raise AnalysisError("the table has no rows: nothing to plot")
    try:
        values = {name: np.asarray(table[name].to_numpy(dtype=float, na_value=np.nan)) for name in names}
    except (TypeError, ValueError) as error:
        raise AnalysisError(f"the columns {list(names)} must be numbers: {error}") from None
    classes = table[by].fillna("unknown").astype(str).to_numpy(dtype=str)
    return values, np.where(classes == "", "unknown", classes)


def _count(name: str, known: BoolArray, members: BoolArray) -> str:
    left_out = int((members & ~known).sum())
    return f"{name} (n = {int((members & known).sum())}" + (f", {left_out} left out)" if left_out else ")")


def feature_scatter(
    table: pd.DataFrame,
    *,
    x: str,
    y: str,
    by: str = "label",
    title: str | None = None,
    ax: Axes | None = None,
    **shown: Unpack[Shown],
) -> Figure:
    """Plot one feature against another by class (report's Fig. 5.8).

    Parameters
    ----------
    table : DataFrame
        One row per example.
    x, y : str
        Columns; the suffix of the name determines the unit on the axis. Rows with None or NaN are
        left out, and the legend has their number.
    by : str
        Column of the class.
    **shown : bool
        ``legend``, False to leave it out.

    Raises
    ------
    AnalysisError
        If columns are missing or hold no numbers, or the table is empty.

    Examples
    --------
    >>> import pandas as pd
    >>> from doppelgait import viz
    >>> table = pd.DataFrame({"label": ["human", "dog"], "step_length_m": [0.7, 0.4]})
    >>> figure = viz.feature_scatter(table, x="step_length_m", y="step_length_m")
    >>> figure.axes[0].get_xlabel()
    'step length, radial (m)'
    """
    values, classes = _select_columns(table, (x, y), by)
    known = np.isfinite(values[x]) & np.isfinite(values[y])
    axes = style.make_axes(ax, width_in=9.5, height_in=6.0)[1]
    size = float(np.clip(4000.0 / len(classes), 5.0, 26.0))
    for name, colour in style.choose_class_colours(classes.tolist()).items():
        members = classes == name
        chosen = members & known
        label = _count(name, known, members)
        axes.scatter(values[x][chosen], values[y][chosen], s=size, color=colour, alpha=0.65, lw=0, label=label)
    x_label, y_label = style.label_quantity(x), style.label_quantity(y)
    words = f"{style.describe_quantity(y)[0]} against {style.describe_quantity(x)[0]}"
    words = words[0].upper() + words[1:] if title is None else title
    return finish_axes(axes, ax, words, x_label, y_label, **shown)


def feature_matrix(
    table: pd.DataFrame,
    *,
    features: Sequence[str] = style.FEATURE_NAMES,
    by: str = "label",
    title: str = "Features by class",
) -> Figure:
    """Plot the distribution of every feature by class.

    Each is a small histogram (the report's Fig. 5.9).

    Parameters
    ----------
    table : DataFrame
        One row per example.
    features : sequence of str
        1 to 12 columns; the six features by default. None and NaN are left out, and the panel has
        their number.
    by : str
        Column of the class.

    Returns
    -------
    Figure
        Share of the known values of a class per bin; the first and last bins contain the outermost
        0.2 %.

    Raises
    ------
    AnalysisError
        If columns are missing or hold no numbers, or the table is empty.

    Examples
    --------
    >>> import pandas as pd
    >>> from doppelgait import viz
    >>> table = pd.DataFrame({"label": ["human", "dog"], "step_length_m": [0.7, 0.4]})
    >>> figure = viz.feature_matrix(table, features=["step_length_m"])
    >>> figure.axes[0].get_title(loc="left"), figure.axes[0].get_xlabel()
    ('dog (n = 1), human (n = 1)', 'step length, radial (m)')
    """
    if not 1 <= len(features) <= 12:
        raise AnalysisError(f"features are {len(features)} columns; 1 to 12 fit on a page")
    values, classes = _select_columns(table, features, by)
    across = min(3, len(features))
    down = -(-len(features) // across)
    figure = style.make_figure(width_in=12.0, height_in=1.2 + 2.9 * down)
    panels = list(figure.subplots(down, across, squeeze=False).flat)
    for axes, name in zip(panels, features, strict=False):
        column = values[name]
        known = np.isfinite(column)
        edges = make_bin_edges(column[known], len(table))
        for label, colour in style.choose_class_colours(classes.tolist()).items():
            members = classes == label
            inside = np.clip(column[members & known], edges[0], edges[-1])
            counts = np.histogram(inside, edges)[0]
            look: Any = {"fill": True, "facecolor": (colour, 0.15), "edgecolor": colour, "lw": 1.6}
            axes.stairs(100.0 * counts / max(inside.size, 1), edges, label=label, **look)
        style.draw_grid(axes)
        style.name_axes(axes, title="", x=style.label_quantity(name), y="share of class (%)")
        words = ", ".join(
            _count(label, known, classes == label) for label in style.choose_class_colours(classes.tolist())
        )
        axes.set_title("\n".join(textwrap.wrap(words, 56)), fontsize="small", loc="left")
    for axes in panels[len(features) :]:
        axes.set_visible(False)
    figure.suptitle(title, x=0.01, ha="left")
    style.place_legend(panels[0])
    return figure


def make_bin_edges(known: FloatArray, n_rows: int) -> FloatArray:
    """Return the edges of 8 to 30 histogram bins."""
    bins = int(np.clip(math.sqrt(2.0 * n_rows), *BINS))
    if not known.size:
        return np.linspace(0.0, 1.0, bins + 1)
    low, high = (float(level) for level in np.quantile(known, [TAIL, 1.0 - TAIL]))
    if not high > low:
        reach = max(abs(low) * 0.05, 0.5)
        low, high = low - reach, high + reach
    return np.linspace(low, high, bins + 1)


def contact_sheet(
    signatures: Sequence[xr.DataArray],
    *,
    titles: Sequence[str],
    db_range: float | None = None,
    columns: int | None = None,
    doppler_hz: Limits | None = None,
) -> Figure:
    """Plot many signatures on one page with the same scale.

    Parameters
    ----------
    signatures : sequence of DataArray (time, doppler)
        1 to 64 signatures, all raw or all normalised.
    titles : sequence of str
        One title per signature.
    db_range : float, optional
        Dynamic range below the strongest cell of all signatures in dB; by default down to the
        noise, at most 40 dB.
    columns : int, optional
        Signatures in a row; about square by default.
    doppler_hz : (float, float), optional
        Doppler limits; by default limits that include the occupied part of every signature.

    Raises
    ------
    AnalysisError
        If there are no or too many signatures, titles do not match, or units differ.

    Examples
    --------
    >>> import doppelgait as dg
    >>> recording = dg.data.sample()
    >>> result = dg.analyze(recording, gate="truth")[0]
    >>> figure = dg.viz.contact_sheet([result.signature], titles=["human"])
    >>> figure.axes[0].get_title(loc="left")
    'human'
    """
    arrays = [check_signature(array) for array in signatures]
    if not 1 <= len(arrays) <= 64 or len(titles) != len(arrays):
        raise AnalysisError(
            f"a contact sheet takes 1 to 64 signatures and one title each; got {len(arrays)} and {len(titles)}"
        )
    if columns is not None and columns < 1:
        raise AnalysisError(f"columns is {columns}; it must be 1 or more")
    units = sorted({str(array.attrs["units"]) for array in arrays})
    if len(units) > 1:
        raise AnalysisError(f"signatures in units {units} have no common dB scale; pass all raw or all normalised")
    levels = np.concatenate([compute_level_db(array.values).ravel() for array in arrays])
    limits_db = level_limits_db(levels, db_range)
    across = min(columns or math.ceil(math.sqrt(len(arrays))), len(arrays))
    down = math.ceil(len(arrays) / across)
    figure = style.make_figure(width_in=12.0, height_in=1.4 + 2.1 * down)
    grid = figure.subplots(down, across, sharex=True, sharey=True, squeeze=False)
    panels = list(grid.flat)
    occupied = np.array([doppler_limits_hz(array) for array in arrays])
    limits_hz = doppler_hz or (float(occupied[:, 0].min()), float(occupied[:, 1].max()))
    ends_s: list[float] = []
    bare: Any = {"colorbar": False, "velocity_axis": False, "legend": False}
    for axes, array, title in zip(panels, arrays, titles, strict=False):
        plot_signature(array, db_range=limits_db, doppler_hz=limits_hz, title=title, ax=axes, **bare)
        ends_s += axes.get_xlim()
        axes.set(xlabel="", ylabel="")
        axes.set_facecolor("#eeeeee")
    panels[0].set_xlim(min(ends_s), max(ends_s))
    for number, axes in enumerate(panels):
        axes.set_visible(number < len(arrays))
        axes.tick_params(labelbottom=number + across >= len(arrays))
    figure.supxlabel(style.TIME_LABEL)
    figure.supylabel(style.DOPPLER_LABEL)
    for number in range(across - 1, len(arrays), across):
        add_velocity_axis(panels[number], wavelength_m(arrays[0]))
        style.fit_labels(panels[number])
    image = (panels[0].images or panels[0].collections)[0]
    add_colour_bar(image, *panels, quantity="power", reference=choose_reference(arrays[0]))
    return figure


def signature_normalisation(
    signature: xr.DataArray,
    *,
    normalised: xr.DataArray,
    db_range: float | None = None,
    doppler_hz: Limits | None = None,
) -> Figure:
    """Plot a signature before and after normalisation (report's Fig. 4.9).

    Parameters
    ----------
    signature : DataArray (time, doppler)
        Raw, V^2.
    normalised : DataArray (time, doppler)
        The same signature, normalised.
    db_range : float, optional
        Dynamic range of both maps in dB; by default down to the noise of each, at most 40 dB.
    doppler_hz : (float, float), optional
        Doppler limits of both maps; by default those of the normalised signature.

    Raises
    ------
    AnalysisError
        If an array does not conform to its schema.

    Examples
    --------
    >>> import doppelgait as dg
    >>> recording = dg.data.sample()
    >>> result = dg.analyze(recording, gate="truth")[0]
    >>> figure = dg.viz.signature_normalisation(
    ...     result.signature, normalised=dg.processing.normalise(result.signature, 0.0)
    ... )
    >>> figure.axes[0].get_title(loc="left"), figure.axes[0].get_xlabel()
    ('(a) signature', 'time (s)')
    """
    limits_hz = doppler_hz or doppler_limits_hz(check_signature(normalised))
    figure = style.make_figure(width_in=12.5, height_in=5.0)
    pair = figure.subplots(1, 2, sharey=True)
    looks: Any = {"db_range": db_range, "doppler_hz": limits_hz, "legend": False}
    plot_signature(signature, ax=pair[0], title="(a) signature", velocity_axis=False, **looks)
    plot_signature(normalised, ax=pair[1], title="(b) columns normalised", **looks)
    pair[1].set_ylabel("")
    return figure


TABLE_TITLE = "AUC (95 % interval); for each statistic, distance in standard deviations (AUC of this statistic alone)"

Picture = tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], str]


def plot_domains(
    pictures: Mapping[str, Sequence[Picture]], table: Sequence[Mapping[str, str]], *, title: str
) -> Figure:
    """Plot recordings of every kind, with a table below."""
    columns = max(len(row) for row in pictures.values())
    figure = style.make_figure(width_in=11.0, height_in=2.6 * len(pictures) + 0.24 * len(table) + 0.8)
    heights = [2.6] * len(pictures) + [0.24 * len(table) + 0.4]
    grid = figure.add_gridspec(len(pictures) + 1, columns, height_ratios=heights)
    figure.suptitle(title, x=0.01, ha="left")
    for line, (kind, shown) in enumerate(pictures.items()):
        for column, (level_db, axis, label) in enumerate(shown):
            axes = figure.add_subplot(grid[line, column])
            level_db = level_db - np.median(level_db)
            numbers = np.arange(len(level_db)) + 0.5
            image = plot_map(axes, numbers, axis, level_db.T, (-10.0, 25.0))
            axes.set_title(kind if column == 0 else "", loc="left")
            axes.set_ylabel(label if column == 0 else "")
            step = "pulse number" if label == style.RANGE_LABEL else "window number"
            axes.set_xlabel(step if line == len(pictures) - 1 else "")
            axes.xaxis.set_major_locator(MaxNLocator(4, integer=True))
    figure.colorbar(image, ax=figure.axes, aspect=40, pad=0.02).set_label("level above the median (dB)")
    axes = figure.add_subplot(grid[-1, :])
    axes.axis("off")
    axes.set_title(TABLE_TITLE, fontsize="small", loc="left")
    names = list(table[0])
    cells = [[row[name] for name in names] for row in table]
    made = axes.table(cellText=cells, colLabels=names, loc="upper center", cellLoc="left", bbox=Bbox.unit())
    made.auto_set_font_size(False)
    made.set_fontsize(8)
    for cell in made.get_celld().values():
        cell.set_linewidth(0.3)
    return figure
