"""Common style of figures, and their files."""

from __future__ import annotations

import io
import re
from collections.abc import Iterable, Sequence
from copy import deepcopy
from pathlib import Path
from threading import Lock
from typing import Any, Literal
from weakref import WeakKeyDictionary

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.axis import Axis, XAxis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure, FigureBase, SubFigure
from matplotlib.image import AxesImage
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.text import Text
from matplotlib.ticker import MaxNLocator

from doppelgait.core.config import check_choice, check_type
from doppelgait.core.errors import AnalysisError
from doppelgait.core.files import open_atomically
from doppelgait.core.labels import STEP_LENGTHS

DPI = 110
FIGURE_FORMATS = {"png": ("Software",), "svg": ("Date", "Creator"), "pdf": ("CreationDate", "Creator", "Producer")}
"""Formats of figure files, each with the metadata that are left out because they depend on date and version."""
FILE_SETTINGS: Any = {"svg.hashsalt": "doppelgait", "pdf.fonttype": 42}
"""The names of parts of an SVG file are otherwise random; journals refuse fonts of type 3."""
PAPER_IN, PAPER_PT, PAPER_DPI = (3.5, 7.2), 8, 300
"""Widths of one column and of two, text and resolution of a journal."""
_SETTINGS_LOCK = Lock()
_MADE_IN: WeakKeyDictionary[Figure, tuple[float, ...]] = WeakKeyDictionary()
"""Size of every figure made here: a user chose another size."""
MAP_COLOURS = "magma"
"""Colour map of levels, perceptually uniform from black, so that an empty scene is dark."""
OVERLAY_COLOURS = "gray"
"""Colour map below lines that are coloured by body part."""
SHARE_COLOURS = "Blues"
"""Colour map of shares from 0 to 1, below black or white numbers."""

BLUE, ORANGE, GREEN, PURPLE = "#0072b2", "#e69f00", "#009e73", "#cc79a7"
SKY, VERMILLION, YELLOW = "#56b4e9", "#d55e00", "#f0e442"
"""Colours of Okabe and Ito (2008) for all categories; they are distinct in every colour-vision deficiency."""
LINE_COLOURS = (SKY, ORANGE, "#ffffff", PURPLE, YELLOW, GREEN)
"""Colours of lines on a map, with a black edge."""
SERIES_COLOURS = (BLUE, VERMILLION, GREEN, PURPLE, SKY, ORANGE)
"""Colours of lines and markers on white."""
LINE, SHADE, GRID, REFERENCE = "#1f3b57", "#9ecae1", "#e0e0e0", "#606060"
"""Colours of a single curve, a band, the grid, and reference lines."""
ACCENT = "#c1121f"
"""Colour of marks and text on a curve."""
CLASS_COLOURS = {"human": BLUE, "dog": ORANGE, "cat": GREEN}
OTHER_CLASS_COLOURS = (PURPLE, SKY, VERMILLION, "#444444")
ON_MAPS = {BLUE: SKY}
"""Colours that are too dark for a map, and those that replace them there."""
TARGET_STYLES = ("-", "--", ":", "-.")
"""Line styles of the first, second, ... target of a class."""

TIME_LABEL, RANGE_LABEL = "time (s)", "range (m)"
DOPPLER_LABEL = "Doppler frequency (Hz)"
FROM_LINE_LABEL = "Doppler frequency from the main line (Hz)"
VELOCITY_LABEL = "radial velocity (m/s), approaching positive"
FROM_TORSO_LABEL = "from the torso (m/s), approaching positive"
SHORTER = (
    (r"\), .*| re maximum\)", ")"),
    (r"Doppler frequency from the", "Doppler from"),
    (r"Doppler (?=from)", ""),
    (r"Doppler frequency", "Doppler"),
    (r"radial |normalised ", ""),
)
"""What shortens the label of a short axis, until it fits."""
CADENCE_LABEL = "cadence (Hz)"
LEVEL_LABEL = "level (dB re maximum)"

UNIT_OF_SUFFIX = {"mps": "m/s", "hz": "Hz", "m": "m", "s": "s", "db": "dB", "deg": "°", "m2": "m²", "kg": "kg"}
QUANTITY_NAMES = {
    "torso_velocity_mps": "torso velocity",
    "doppler_bandwidth_hz": "Doppler bandwidth",
    "step_length_m": STEP_LENGTHS["step_length_m"],
    "harmonic_ratio_2": "second harmonic ratio",
    "harmonic_ratio_3": "third harmonic ratio",
    "limb_torso_ratio": "limb-torso ratio",
    "snr_mu_db": "SNR of the signature",
    "n_periods": "observed periods",
}
SHORT_WORDS = {"doppler": "Doppler", "sd": "standard deviation", "snr": "SNR"}
FEATURE_NAMES = tuple(QUANTITY_NAMES)[:6]
"""The six features in their order (E-39)."""
QUANTITY_NAMES |= STEP_LENGTHS


def describe_quantity(name: str) -> tuple[str, str]:
    """Return description and unit of a column from its name."""
    stem, _, suffix = name.rpartition("_")
    unit = UNIT_OF_SUFFIX.get(suffix, "1") if stem else "1"
    words = " ".join(SHORT_WORDS.get(word, word) for word in (stem if unit != "1" else name).split("_"))
    return QUANTITY_NAMES.get(name, words), unit


def describe_flag(flag: str) -> str:
    """Return a quality flag in words, quantities as in tables."""
    name, colon, words = flag.partition(":")
    words = words.replace("_", " ").replace(" db ", " dB ").replace(" per cent", " %")
    return f"{describe_quantity(name)[0]}: {words}" if colon else name.replace("_", " ")


def label_quantity(name: str) -> str:
    """Return the axis label of a column: description and unit."""
    words, unit = describe_quantity(name)
    return words if unit == "1" else f"{words} ({unit})"


def choose_class_colours(classes: Iterable[str]) -> dict[str, str]:
    """Return the colour of every class."""
    names = sorted(set(classes))
    others = [name for name in names if name not in CLASS_COLOURS]
    extra = {name: OTHER_CLASS_COLOURS[n % len(OTHER_CLASS_COLOURS)] for n, name in enumerate(others)}
    return {name: CLASS_COLOURS.get(name) or extra[name] for name in names}


def map_lines(labels: Sequence[str]) -> list[tuple[str, str]]:
    """Return colour and line style of targets on a map."""
    known = [next((name for name in CLASS_COLOURS if name in label.split()), "") for label in labels]
    looks = []
    for number, name in enumerate(known):
        colour = CLASS_COLOURS.get(name, LINE_COLOURS[number % len(LINE_COLOURS)])
        style = TARGET_STYLES[known[:number].count(name) % len(TARGET_STYLES)] if name else "-"
        looks.append((ON_MAPS.get(colour, colour), style))
    return looks


def make_figure(*, width_in: float = 10.5, height_in: float = 5.5, compressed: bool = False) -> Figure:
    """Make an empty figure without global state."""
    layout: Literal["compressed", "constrained"] = "compressed" if compressed else "constrained"
    figure = Figure(figsize=(width_in, height_in), dpi=DPI, layout=layout, facecolor="white")
    FigureCanvasAgg(figure)
    return keep_size(figure)


def keep_size(figure: Figure) -> Figure:
    """Note the size of a figure, which no user chose."""
    _MADE_IN[figure] = tuple(figure.get_size_inches())
    return figure


def make_axes(ax: Axes | None = None, *, width_in: float = 10.5, height_in: float = 5.5) -> tuple[Figure, Axes]:
    """Make a figure with one pair of axes."""
    if ax is not None:
        check_type(ax, Axes, "ax", "make axes with matplotlib.pyplot.subplots()")
        return ax.get_figure(root=True) or ax.figure, ax  # type: ignore[return-value]
    figure = make_figure(width_in=width_in, height_in=height_in)
    return figure, figure.add_subplot()


def name_axes(axes: Axes, *, title: str, x: str, y: str) -> None:
    """Set title and axis labels, the same everywhere."""
    axes.set_title(title, loc="left")
    axes.set_xlabel(x)
    axes.set_ylabel(y)


def draw_grid(axes: Axes) -> None:
    """Draw the grid behind everything else, the same everywhere."""
    axes.grid(color=GRID, lw=0.6)
    axes.set_axisbelow(True)


def write_note(axes: Axes, text: str, at: tuple[float, float], colour: str, **look: Any) -> None:
    """Write a short text next to a point of the axes."""
    axes.annotate(text, at, color=colour, **{"ha": "center", "va": "bottom", **look})


def place_legend(axes: Axes, where: Literal["figure", "inside"] = "figure", *, columns: int = 6) -> None:
    """Put a legend below the figure or inside the axes."""
    handles, labels = axes.get_legend_handles_labels()
    if not handles:
        return
    if where == "inside":
        legend = axes.legend(handles, labels)
        legend.set_in_layout(False)  # else the layout shrinks the axes around a long entry
    else:
        legend = _place_below(axes.figure, handles, labels, columns)
    # Thin lines and small or pale marks of a legend are not readable.
    for handle in legend.legend_handles:
        if isinstance(handle, Line2D):
            handle.set(linewidth=max(handle.get_linewidth(), 1.5), alpha=1.0)
        elif isinstance(handle, PathCollection):
            handle.set(sizes=[30.0], alpha=1.0)


def _place_below(figure: Figure | SubFigure, handles: Any, labels: Sequence[str], columns: int, **look: Any) -> Legend:
    look |= {"frameon": False, "handlelength": 1.5, "columnspacing": 1.2, "handletextpad": 0.5}
    while True:
        legend = figure.legend(handles, labels, loc="outside lower center", ncols=columns, **look)
        if columns == 1 or legend.get_window_extent().width < figure.bbox.width:
            return legend
        legend.remove()
        columns -= 1


def fit_labels(axes: Axes) -> None:
    """Shorten labels that are longer than their axis, and leave out ticks that touch."""
    for axis in axes.findobj(Axis):
        side, locator = "width" if isinstance(axis, XAxis) else "height", axis.get_major_locator()
        length = 0.97 * getattr(axes.bbox, side)
        for long, short in SHORTER:
            if getattr(axis.label.get_window_extent(), side) > length:
                axis.label.set_text(re.sub(long, short, axis.label.get_text()))
        texts = [text for text in axis.get_ticklabels() if text.get_text()]
        sizes = [getattr(text.get_window_extent(), side) for text in texts]
        if len(sizes) * 1.3 * max(sizes, default=0.0) > length and isinstance(locator, MaxNLocator):
            locator.set_params(nbins=max(1, int(length / (1.3 * max(sizes)))))


def _copy(figure: Figure) -> Figure:
    canvas = figure.canvas  # pyplot would show a copy that has its window
    FigureCanvasAgg(figure)
    try:
        return deepcopy(figure)
    finally:
        figure.set_canvas(canvas)


def fit_to_paper(figure: Figure) -> Figure:
    """Return a copy for a journal, which keeps a size that the user chose."""
    copy = _copy(figure)
    copy.set_dpi(PAPER_DPI)
    for axis in copy.findobj(Axis):
        for label in axis.get_ticklabels()[:1]:
            axis.set_tick_params(labelsize=min(label.get_fontsize(), PAPER_PT))
    for text in copy.findobj(Text):
        text.set_fontsize(min(text.get_fontsize(), PAPER_PT))
    if _MADE_IN.get(figure) == tuple(figure.get_size_inches()):
        _resize(copy)
    copy.draw_without_rendering()
    for axes in copy.axes:
        fit_labels(axes)
    return copy


def _resize(copy: Figure) -> None:
    width_in, height_in = copy.get_size_inches()
    panels = [axes for axes in copy.axes if axes.get_label() != "<colorbar>"]
    new_in = PAPER_IN[len(panels) > 1]
    copy.set_size_inches(new_in, max(new_in * height_in / width_in, 0.7 * PAPER_IN[0]))
    copy.suptitle("")
    if len(panels) == 1:  # the caption has the title, but not those of several panels
        panels[0].set_title("", loc="left")
    owners: Any = copy.findobj(FigureBase)
    for owner in owners:
        for legend in list(owner.legends):
            labels = [text.get_text() for text in legend.get_texts()]
            owner.legends.remove(legend)
            below = _place_below(owner, legend.legend_handles, labels, 3, fontsize=PAPER_PT)
            if owner is copy:
                below_in = below.get_window_extent().height / PAPER_DPI
                copy.set_figheight(copy.get_figheight() + below_in)


def save_figure(figure: Figure, path: str | Path, *, dpi: float | None = None, style: str = "screen") -> Path:
    """Write a figure as PNG, SVG or PDF, atomically.

    The figure itself does not change. The same input gives the same bytes, provided that the
    figure was not rendered before: each rendering repeats the layout and may shift panels by a
    fraction of a pixel.

    Parameters
    ----------
    figure : Figure
    path : str or Path
        Path that ends in ``.png``, ``.svg`` or ``.pdf``; the folder must exist.
    dpi : float, optional
        Pixels per inch; the figure's own by default.
    style : {"screen", "paper"}
        ``paper``: text of at most 8 pt, 300 dpi. A figure of doppelgait is 3.5 inches wide without
        a title, 7.2 with several panels; one that you made, or gave a size, keeps size and titles.

    Returns
    -------
    Path
        The file written.

    Raises
    ------
    AnalysisError
        If the name has another extension.
    OutputError
        If the file cannot be written; an older file of this name then stays unchanged.

    Examples
    --------
    >>> import doppelgait as dg
    >>> recording = dg.data.sample()
    >>> result = dg.analyze(recording, gate="truth")[0]
    >>> dg.viz.save_figure(dg.viz.signature(result.signature), "signature.png").name
    'signature.png'
    """
    target = Path(path)
    form = target.suffix.lower().removeprefix(".")
    if form not in FIGURE_FORMATS:
        raise AnalysisError(f"{target}: end the name of a figure in .png, .svg or .pdf")
    check_choice(style, ("screen", "paper"), "style")
    figure = figure.figure  # that of axes, as ``plot`` returns
    copy = fit_to_paper(figure) if style == "paper" else _copy(figure)
    if form != "png":  # maps keep the resolution of their data
        for picture in copy.findobj(AxesImage):
            picture.set_interpolation("none")
    image = io.BytesIO()
    with _SETTINGS_LOCK, rc_context(FILE_SETTINGS):
        undated = dict.fromkeys(FIGURE_FORMATS[form])
        copy.savefig(image, format=form, dpi=dpi or copy.dpi, metadata=undated)
    with open_atomically(target) as partial:
        partial.write_bytes(image.getvalue())
    return target
