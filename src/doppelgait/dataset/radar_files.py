"""Radar files of a plan, stored with their values.

A dataset then needs no file of its radar. The stored form of ``preset = "my-radar.toml"`` is
``preset = { file = "my-radar.toml", values = { ... } }``.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from doppelgait.core.documents import parse_json
from doppelgait.core.errors import ConfigError
from doppelgait.dataset.config import PlanConfig
from doppelgait.pipeline.radar_table import RadarFile
from doppelgait.radar.presets import read_preset

_STORED_KEYS = {"file", "values"}


def store_radar_files(plan: PlanConfig, folder: Path) -> PlanConfig:
    """Replace the names of a plan's radar files by their values.
    A plan without such files is returned unchanged.
    """

    def store(named: str | RadarFile) -> dict[str, Any]:
        if isinstance(named, RadarFile):
            return {"file": named.file, "values": dict(named.values)}
        try:
            values = read_preset(folder / named)
        except ConfigError as error:
            raise ConfigError(f"radar.preset {named}: {error}") from None
        return {"file": named, "values": parse_json(json.dumps(values, default=str))}

    radar = replace_radar_files(plan.radar, store)
    return plan if radar == plan.radar else plan.model_copy(update={"radar": radar})


def list_radar_files(radar: Mapping[str, Any]) -> list[str | RadarFile]:
    """List the radar files of a ``[radar]`` table.
    A file is a name, or stored with its values.
    """
    found: list[str | RadarFile] = []
    replace_radar_files(radar, found.append)
    return found


def load_radar_files(radar: Mapping[str, Any]) -> Any:
    """Make an object of each stored radar file.
    Sampling a plan leaves such an object unchanged: the distributions of a radar file have their own random streams.
    """
    return replace_radar_files(radar, lambda named: named)


def replace_radar_files(value: Any, change: Callable[[Any], Any], *, in_preset: bool = False) -> Any:
    """Replace the radar files of a table.
    They are under ``preset`` or among its choices.
    """
    if isinstance(value, Mapping):
        if in_preset and set(value) == _STORED_KEYS and isinstance(value["values"], Mapping):
            return change(RadarFile(str(value["file"]), value["values"]))
        return {k: replace_radar_files(v, change, in_preset=in_preset or k == "preset") for k, v in value.items()}
    if isinstance(value, list):
        return [replace_radar_files(inner, change, in_preset=in_preset) for inner in value]
    return change(value) if in_preset and isinstance(value, str) and value.endswith(".toml") else value
