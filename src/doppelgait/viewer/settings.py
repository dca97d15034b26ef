"""How the viewer analyses recordings, from what the command line says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from doppelgait.core.config import apply_overrides, validate
from doppelgait.pipeline import Tracking
from doppelgait.processing import Analysis
from doppelgait.viewer.query import Gate, gate_of

Clutter = Literal["kept", "removed"]
"""What a request may ask of what stands still."""


@dataclass(frozen=True)
class Settings:
    """How recordings are read and analysed.

    Parameters
    ----------
    gate : str or (float, float)
        Gate that is shown first.
    gate_asked : bool
        Whether the user named that gate: of a recording that cannot be tracked all ranges are shown otherwise.
    analysis : Analysis
    tracking : Tracking
    options : mapping
        What a recording's file does not tell.
    motion_folder : Path, optional
        Where the motion files of a dataset's plan are; without, none is opened.
    """

    gate: Gate = "track"
    analysis: Analysis = field(default_factory=Analysis)
    tracking: Tracking = field(default_factory=Tracking)
    options: Mapping[str, Any] = field(default_factory=dict)
    gate_asked: bool = False
    motion_folder: Path | None = None


def parse_settings(gate: str | None, changes: Sequence[str], options: Sequence[str]) -> Settings:
    """Settings from ``--gate``, ``--set KEY=VALUE`` and ``--option KEY=VALUE``.

    Raises
    ------
    ConfigError
        If one of them is not allowed.
    """
    table = apply_overrides({}, changes)
    tracking = validate(Tracking, table.pop("tracking", {}), where="tracking")
    analysis = validate(Analysis, table, where="analysis")
    return Settings(
        gate=gate_of(gate or "track"), analysis=analysis, tracking=tracking, options=apply_overrides({}, options),
        gate_asked=gate is not None,
    )  # fmt: skip
