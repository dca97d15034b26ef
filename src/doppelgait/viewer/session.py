"""What the page needs to know first: what was opened, colours, names of features."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from doppelgait import __version__
from doppelgait.features import FEATURE_UNITS
from doppelgait.viewer.query import Gate
from doppelgait.viewer.run import Run
from doppelgait.viewer.settings import Settings
from doppelgait.viewer.source import Opened, can_track

COLOUR_MAPS = ("magma", "viridis", "inferno", "cividis", "gray", "turbo")
KNOWN_CLASSES = ("human", "dog", "cat")


def session_facts(opened: Opened | None, settings: Settings) -> dict[str, Any]:
    """Content of ``api/session``."""
    from doppelgait.viewer.try_it import controls

    browser = None if opened is None else opened.browser
    run = None if opened is None else opened.run
    summary = None if browser is None else browser.summary()
    classes = sorted({*KNOWN_CLASSES, *(summary["classes"] if summary else ())})
    return {
        "version": __version__,
        "kind": "none" if opened is None else opened.kind,
        "name": "" if opened is None else opened.name,
        "path_name": "" if opened is None else opened.path_name,
        **_looks(tuple(classes)),
        "gates": gates_of(run),
        "default_gate": gate_text(settings.gate if run is None else run.settings.gate),
        "feature_names": _feature_names(),
        "dataset": summary,
        "try_controls": controls(),
    }


def gates_of(run: Run | None) -> list[str]:
    """Named gates that can be asked for without an error."""
    if run is None or run.recording is None:
        return []
    named = {"track": can_track(run.recording), "truth": bool(run.recording.truth)}
    return [name for name, possible in named.items() if possible]


def gate_text(gate: Gate) -> str:
    """Gate as a request has it."""
    return gate if isinstance(gate, str) else f"{gate[0]:g}:{gate[1]:g}"


@cache
def _looks(classes: tuple[str, ...]) -> dict[str, Any]:
    """Colours of maps, body parts and classes, the same as in the figures."""
    from doppelgait.viz.body import PART_COLOURS
    from doppelgait.viz.style import MAP_COLOURS, class_colours

    return {
        "colour_maps": {name: _colour_table(name) for name in COLOUR_MAPS},
        "default_map": MAP_COLOURS,
        "part_colours": dict(PART_COLOURS),
        "class_colours": class_colours(classes),
    }


def _colour_table(name: str) -> str:
    """256 colours as one text of hexadecimal digits."""
    from matplotlib import colormaps

    table: bytes = colormaps[name](np.arange(256), bytes=True)[:, :3].tobytes()
    return table.hex()


def _feature_names() -> list[tuple[str, str, str]]:
    from doppelgait.viz.style import quantity

    further = {"gait_frequency_hz": "Hz", "torso_doppler_hz": "Hz"}
    return [(name, quantity(name)[0], unit) for name, unit in {**FEATURE_UNITS, **further}.items()]
