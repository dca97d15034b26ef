"""Radar presets: TOML files with a source per value."""

from __future__ import annotations

import os
from collections.abc import Mapping
from copy import deepcopy
from functools import lru_cache
from pathlib import Path
from typing import Any

from doppelgait.core.config import check_type, format_line_note, read_toml
from doppelgait.core.draws import replace_by_middle
from doppelgait.core.errors import ConfigError, list_choices

CONDITIONS = ("environment", "impairments")
"""Keys of a preset's file that are not parameters of the radar."""


def list_preset_names() -> list[str]:
    """Return the names of all presets; the example of :func:`read_full_preset` shows one."""
    return sorted(path.stem for path in Path(__file__).parent.glob("*.toml"))


def change_preset(
    name: str | Path, changes: Mapping[str, Any], *, sampled: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """Return the parameters of a preset with some changed."""
    try:
        found = replace_by_middle(read_preset(name)) if sampled is None else sampled
    except ConfigError as error:
        raise ConfigError(f"preset {name}: {error}") from None
    return _change({key: value for key, value in found.items() if key not in CONDITIONS}, changes)


def _change(table: dict[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Change the table of a preset by the rules of :func:`change_preset`."""
    before = table.get("waveform", "impulse")
    table.update(changes)
    waveform = table.get("waveform", "impulse")
    if isinstance(waveform, Mapping):
        own = before if isinstance(before, Mapping) else {"kind": before}
        table["waveform"] = waveform = waveform if "kind" in waveform else {**own, **waveform}
        waveform = waveform["kind"]
    if waveform == "impulse":
        for key, other in (("pulse_sigma_s", "bandwidth_hz"), ("bandwidth_hz", "pulse_sigma_s")):
            if key in changes and other not in changes:
                table.pop(other, None)
    return table


def read_full_preset(name: str | Path) -> dict[str, Any]:
    """Return a preset's file with its lists of environment and impairments.

    A file may be based on another preset: ``preset = "x4"`` and the changed values.

    Parameters
    ----------
    name : str or Path
        A name of :func:`list_preset_names`, or a path that ends in ``.toml``.

    Raises
    ------
    ConfigError
        If the name is unknown, or the file is missing or not TOML.

    Examples
    --------
    >>> import doppelgait as dg
    >>> "x4" in dg.radar.list_preset_names()
    True
    >>> dg.radar.read_full_preset("x4")["carrier_hz"]
    7290000000.0
    """
    return deepcopy(read_preset(name))


def read_preset(name: str | Path) -> dict[str, Any]:
    """Return the table of a preset, which is shared and must not be changed."""
    return _read_file(Path(name)) if str(name).lower().endswith(".toml") else _parse_built_in(str(name))


def _read_file(path: Path, above: tuple[Path, ...] = ()) -> dict[str, Any]:
    """Read a radar file; one with the key ``preset`` changes that preset."""
    table, text = read_toml(path)
    if "preset" not in table:
        return table
    changes = {key: value for key, value in table.items() if key != "preset"}
    name = table["preset"]
    try:
        check_type(name, str, "its value", "name a preset or a file that ends in .toml")
        within, chain = name.lower().endswith(".toml"), (*above, path.resolve())
        if within and (path.parent / name).resolve() in chain:
            raise ConfigError("the file is based on itself")
        start = _read_file(path.parent / name, chain) if within else read_preset(name)
    except ConfigError as error:
        raise ConfigError(f"{path}: preset{format_line_note(text, ['preset'])}: {error}") from None
    return _change(dict(start), changes)


@lru_cache(maxsize=64)
def _parse_built_in(name: str) -> dict[str, Any]:
    """Parse the table of a built-in preset once. Planning needs it for every example."""
    if name not in (names := list_preset_names()):
        is_odd = os.path.exists(name) and not os.path.isfile(name)
        words = f"{name!r} is no regular file" if is_odd else f"unknown radar preset {name!r}"
        titles = {each: _parse_built_in(each)["name"].lower().replace(",", "") for each in names}
        near = (each for each, title in titles.items() if name.lower() in (each, *title.split()))
        known = list_choices(names, next(near, name))
        raise ConfigError(f"{words}; known are: {known}; or give the path of a file that ends in .toml")
    return read_toml(Path(__file__).with_name(f"{name}.toml"))[0]
