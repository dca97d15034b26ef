"""Objects in notebooks: facts, and a picture by a plug-in of the higher layer ``viz``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from doppelgait.core.plugins import DRAWING, Group

DRAWINGS: Group[Any] = Group(DRAWING, ("doppelgait.viz.objects",), listed=False)


def plot(name: str, value: Any, *, ax: Any = None, **settings: Any) -> Any:
    """Plot an object by the named function, on axes or a new figure of pyplot; return the axes."""
    return DRAWINGS[name].run(value, ax=DRAWINGS["axes"].run() if ax is None else ax, **settings)


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
    return str(DRAWINGS["html"].run(title, facts, name, value))
