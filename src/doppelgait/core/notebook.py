"""Objects in notebooks: facts, and a picture by a plug-in of the higher layer ``viz``."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping
from html import escape
from typing import Any

from doppelgait.core.plugins import DRAWING, Group

DRAWINGS: Group[Any] = Group(DRAWING, ("doppelgait.viz.objects",), listed=False)
PICTURE_IN = (5.2, 3.2)  # width and height of the picture


def plot(name: str, value: Any, *, ax: Any = None, **settings: Any) -> Any:
    """Plot an object by the named function; return its axes, by default those of a new figure of pyplot."""
    if ax is None:
        from matplotlib import pyplot

        ax = pyplot.subplots(figsize=(10.5, 5.5), layout="constrained")[1]
    return DRAWINGS[name].run(value, ax=ax, **settings)


def show_text(title: str, facts: Mapping[str, str]) -> str:
    """Format an object as one to five lines of text; three dots replace further facts."""
    lines = [""]
    for word in (f"{name} {value}" for name, value in facts.items() if value):
        if lines[-1] and len(lines[-1]) + len(word) > 88:
            lines.append("")
        lines[-1] += (", " if lines[-1] else "") + word
    shown = [title, *filter(None, lines)]
    return "\n  ".join(shown if len(shown) <= 5 else [*shown[:4], f"{shown[4]}, ..."])


def show_html(title: str, facts: Mapping[str, str], name: str, value: Any) -> str:
    """Format an object as a small table and, if the plot has a name, an inline PNG."""
    rows = "".join(
        f'<tr><th style="text-align:left">{escape(key)}</th><td style="text-align:left">{escape(text)}</td></tr>'
        for key, text in facts.items()
        if text
    )
    picture = ""
    if name:
        figure = DRAWINGS[name].run(value).figure
        figure.set_size_inches(*PICTURE_IN)
        image = io.BytesIO()
        figure.savefig(image, format="png", dpi=80, metadata={"Software": None})
        content = base64.b64encode(image.getvalue()).decode()
        picture = f'<img alt="{escape(title)}" src="data:image/png;base64,{content}">'
    return (
        f"<div><strong>{escape(title)}</strong>"
        f'<div style="display:flex;gap:1em;align-items:flex-start"><table>{rows}</table>'
        f"{picture}</div></div>"
    )
