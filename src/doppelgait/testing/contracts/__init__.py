"""Contract checks of plug-ins: rules that the rest relies on."""

from __future__ import annotations

from typing import Any

import numpy as np


def require(condition: Any, text: str) -> None:
    """Raise an ``AssertionError`` with ``text`` unless the condition holds."""
    if not condition:
        raise AssertionError(text)


def require_registered(group: Any, what: str, name: Any) -> str:
    """Require a plug-in of a group; return what messages call it."""
    label = f"{what} {name!r}"
    require(name in group, f"{label} is not registered; known are {', '.join(group)}")
    return label


def require_close(actual: Any, wanted: Any, text: str, rtol: float = 1e-4) -> None:
    """Require two arrays to be almost equal."""
    scale = float(np.abs(wanted).max(initial=0.0)) or 1.0
    worst = float(np.abs(np.asarray(actual) - np.asarray(wanted)).max(initial=0.0)) / scale
    require(worst <= rtol, f"{text} (differs by {worst:.2g} of the largest value)")
