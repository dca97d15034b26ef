"""Faults of a figure that a reader sees: labels without words or units, missing colour bars, texts that overlap."""

import io
import itertools
import re

from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.text import Text

UNIT = re.compile(r"\(.+\)")
PURE = re.compile(
    r"ratio|share|accuracy|confidence|amplitude|magnitude|weight|number|class$|efficiency|duty|asymmetry|periods"
)
"""Numbers without a unit."""
SYMBOL = re.compile(r"[A-Za-zµ]_[A-Za-zµ0-9]|[₀-₉]|_")
NEAR_PX = 1.0


def drawn_texts(figure: Figure) -> list[Text]:
    """Texts of a drawn figure without tick labels beyond the ends of an axis."""
    hidden: set[Text] = set()
    for axis in figure.findobj(Axis):
        low, high = sorted(axis.get_view_interval())
        margin = 1e-6 * (high - low)
        shown = axis.axes.get_visible() and axis.axes.axison
        for tick in (*axis.get_major_ticks(), *axis.get_minor_ticks()):
            if not (low - margin <= tick.get_loc() <= high + margin) or not shown:
                hidden |= {tick.label1, tick.label2}
    return [
        text for text in figure.findobj(Text)
        if text.get_visible() and text.get_text().strip() and text not in hidden
        and (text.axes is None or text.axes.get_visible())
    ]  # fmt: skip


def faults(figure: Figure, form: str = "svg") -> list[str]:
    """Return the faults of a figure in words; write it as SVG or PDF."""
    figure.canvas.draw()
    found = []
    width, height = figure.canvas.get_width_height()
    boxes = [(text, text.get_window_extent()) for text in drawn_texts(figure)]
    for text, box in boxes:
        if box.x0 < -NEAR_PX or box.y0 < -NEAR_PX or box.x1 > width + NEAR_PX or box.y1 > height + NEAR_PX:
            found.append(f"{text.get_text()!r} leaves the canvas")
    for (one, first), (other, second) in itertools.combinations(boxes, 2):
        slanted = {one.get_rotation() % 90, other.get_rotation() % 90} != {0}
        over_x = min(first.x1, second.x1) - max(first.x0, second.x0)
        over_y = min(first.y1, second.y1) - max(first.y0, second.y0)
        if not slanted and over_x > NEAR_PX and over_y > NEAR_PX:
            found.append(f"{one.get_text()!r} overlaps {other.get_text()!r}")
    for axis in figure.findobj(Axis):
        label = axis.label.get_text() if axis.axes.get_visible() and axis.axes.axison else ""
        if label and not UNIT.search(label) and not PURE.search(label):
            found.append(f"label {label!r} has no unit")
        if SYMBOL.search(label):
            found.append(f"label {label!r} has a symbol or the name of a variable")
    maps = [axes for axes in figure.axes if axes.images]
    if maps and not any(axes.get_label() == "<colorbar>" for axes in figure.axes):
        found.append("a map has no colour bar")
    file = io.BytesIO()
    figure.savefig(file, format=form)
    assert len(file.getvalue()) > 1000
    return found
