"""Radar of a run: a preset or file, and changes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from doppelgait.core.config import format_line_note, validate
from doppelgait.core.draws import CYCLE, DISTRIBUTIONS, resolve
from doppelgait.core.errors import ConfigError, list_choices
from doppelgait.pipeline.conditions import Conditions
from doppelgait.radar.parameters import Radar
from doppelgait.radar.presets import change_preset, read_preset

AUTO_PRF_START_HZ = 1000.0
FITTED_KEYS = ("environment", "impairments")


class RadarFile(NamedTuple):
    """Name and table of a radar file that was read before."""

    file: str
    values: Mapping[str, Any]


class FixedRadar(dict[str, Any]):
    """Parsed radar whose preset draws nothing: it serves every example."""


def parse_radar(
    table: Any, *, where: str = "radar", text: str = "", folder: Path | None = None, seed: int = 0, example: int = 0
) -> dict[str, Any]:
    """Parse the ``[radar]`` table of a run.

    Returns ``radar``, ``auto_prf`` and the lists of a calibrated preset. Distributions in a preset's file are sampled
    here. Each has a random stream that is derived from seed, example and key.
    """
    if isinstance(table, FixedRadar):
        return table
    if isinstance(table, str):
        table = {"preset": table}
    if not isinstance(table, Mapping):
        raise ConfigError(f"{where}: radar must be a preset's name or a table, not {table!r}")
    values = dict(table)
    preset: Any = values.pop("preset", None)
    auto_prf = values.get("prf_hz") == "auto"
    if auto_prf:
        del values["prf_hz"]
        values |= {} if preset is not None else {"prf_hz": AUTO_PRF_START_HZ}
    found: dict[str, Any] = {}
    stated: Mapping[str, Any] = found
    if preset is not None:
        try:
            if isinstance(preset, RadarFile):
                preset, source, stated = preset.file, preset.file, preset.values
            else:
                source = str(preset)
                if source.endswith(".toml"):  # the path starts from the folder of the scene file
                    source = str((folder or Path()) / source)
                stated = read_preset(source)
            found = resolve(stated, seed=seed, example=example, key="preset")
            own = sorted({*Radar.model_fields, *FITTED_KEYS})
            for key, value in found.items():
                if key not in own:
                    raise ConfigError(f"{key}: unknown key; allowed are {list_choices(own, key)}")
                if isinstance(value, Mapping) and key not in ("waveform", "antenna"):
                    laws = ", ".join((*DISTRIBUTIONS, CYCLE))
                    raise ConfigError(f"{key} = {value}: needs a number, or a table with one of {laws}")
            values = change_preset(source, values, sampled=found)
        except ConfigError as error:
            place = f"{where + ': ' if where else ''}radar.preset {preset}{format_line_note(text, ['radar', 'preset'])}"
            raise ConfigError(f"{place}: {str(error).removeprefix('preset.')}") from None
    radar = validate(Radar, values, where=where, text=text, section=("radar",))
    lists = {key: value for key, value in found.items() if key in FITTED_KEYS}
    return (FixedRadar if found == stated else dict)(radar=radar, auto_prf=auto_prf, **lists)


def read_radar(radar: str | Path, *, seed: int = 0, example: int = 0) -> tuple[Radar, Conditions]:
    """Read a radar preset or file, and its conditions."""
    found = parse_radar(str(radar), where="", seed=seed, example=example)
    return found["radar"], Conditions(**{key: found[key] for key in FITTED_KEYS if key in found})
