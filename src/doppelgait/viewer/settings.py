"""Parameters of requests and command line, and settings."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from doppelgait.core.config import validate
from doppelgait.core.errors import ConfigError
from doppelgait.pipeline import Tracking
from doppelgait.processing import Analysis
from doppelgait.processing.gate import GateChoice

if TYPE_CHECKING:
    from doppelgait.classify.model import Model

Pairs = Sequence[tuple[str, str]]


def parse_parameters(query: Pairs, allowed: Collection[str]) -> dict[str, str]:
    """Return parameters by name, each known and present once."""
    found: dict[str, str] = {}
    for key, value in query:
        if not allowed:
            raise ConfigError(f"{key!r} is not known here: this address takes no parameters")
        if key not in allowed:
            from doppelgait.dataset.config import suggest_names

            hint = suggest_names(key, list(allowed))
            raise ConfigError(f"{key!r} is not known here{hint}; allowed are {', '.join(allowed)}")
        if key in found:
            raise ConfigError(f"{key}: comes twice; give it once")
        found[key] = value
    return found


def parse_number(key: str, value: str, *, least: float = -math.inf, most: float = math.inf) -> float:
    """Parse a finite number between two limits."""
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    if not math.isfinite(number) or not least <= number <= most:
        allowed = f" from {least:g} to {most:g}" if math.isfinite(least) else ""
        raise ConfigError(f"{key}: {value!r} is not allowed; it must be a number{allowed}")
    return number


def parse_whole(parameters: Mapping[str, str], key: str, default: int, *, least: int, most: int) -> int:
    """Parse an integer between two limits; it is required if ``default`` is outside them."""
    if key not in parameters and not least <= default <= most:
        raise ConfigError(f"{key}: is missing; it must be a whole number from {least} to {most}")
    value = parameters.get(key, str(default))
    plain = value.isascii() and value.isdigit() and len(value) <= 12
    if not plain or not least <= int(value) <= most:
        raise ConfigError(f"{key}: {value!r} is not allowed; it must be a whole number from {least} to {most}")
    return int(value)


Changes = tuple[tuple[str, Any], ...]
"""Names and values of the analysis parameters of a request; they replace those of the run."""
CHANGEABLE = ("clutter", "cpi_s", "window_steepness", "hop")
"""Analysis parameters that a request may change."""


def parse_changes(parameters: Mapping[str, str]) -> Changes:
    """Parse the analysis parameters of a request."""
    found: dict[str, Any] = {}
    for key in CHANGEABLE:
        if key in parameters:
            text = parameters[key]
            found[key] = text if key == "clutter" else int(text) if text.isdecimal() else parse_number(key, text)
    validate(Analysis, found)
    return tuple(found.items())


@dataclass(frozen=True)
class Settings:
    """Settings for reading and analysing recordings."""

    analysis: Analysis = field(default_factory=Analysis)
    tracking: Tracking = field(default_factory=Tracking)
    gate: GateChoice = "track"
    options: Mapping[str, Any] = field(default_factory=dict)
    gate_asked: bool = False
    motion_folder: Path | None = None
    model: Model | None = None
