"""A run as configuration: the scene file, resolved and carried out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from pydantic import Field

from doppelgait.core.config import FrozenModel, apply_overrides, line_note, read_toml, validate
from doppelgait.core.errors import ConfigError
from doppelgait.core.rng import Streams
from doppelgait.pipeline.echoes import Conditions, Noise
from doppelgait.pipeline.simulate import simulate, with_lowest_prf
from doppelgait.processing import Analysis
from doppelgait.radar.impairments import Impairments
from doppelgait.radar.parameters import Radar
from doppelgait.radar.presets import changed_preset, preset_table
from doppelgait.radar.recording import Recording
from doppelgait.scene import Scene
from doppelgait.scene.environment import Environment
from doppelgait.scene.spec import SceneSpec, build_scene

AUTO_PRF_START_HZ = 1000.0


class RunSpec(FrozenModel):
    """Everything that makes one recording and its analysis.

    Parameters
    ----------
    scene : SceneSpec
    radar : Radar
    auto_prf : bool
        Take the lowest frame rate at which nothing aliases (``prf_hz = "auto"``); for reproducing the report only.
    noise : Noise
    environment : list
        Walls, bounces and the like (:mod:`doppelgait.scene.environment`), in order.
    impairments : list
        What the receiver does to its samples (:mod:`doppelgait.radar.impairments`), in order.
    analysis : Analysis
    seed : int
        Root of all random streams.
    example : int
        Number of the example in a dataset; picks its streams.
    """

    scene: SceneSpec
    radar: Radar
    auto_prf: bool = False
    noise: Noise = Noise()
    environment: Environment = ()
    impairments: Impairments = ()
    analysis: Analysis = Analysis()
    seed: int = Field(default=0, ge=0)
    example: int = Field(default=0, ge=0)


SCENE_KEYS = tuple(SceneSpec.model_fields)
TWIN_KEYS = ("environment", "impairments")
SECTIONS = ("seed", *SCENE_KEYS, "radar", "noise", *TWIN_KEYS, "analysis")


def parse_run(table: Mapping[str, Any], *, where: str = "scene", text: str = "", folder: Path | None = None) -> RunSpec:
    """Run specification from the tables of a scene file.

    Parameters
    ----------
    table : mapping
        Keys ``targets`` (list), ``radar`` (``preset`` and changes, or all parameters), and optionally the other keys
        of :class:`doppelgait.scene.spec.SceneSpec` and of :class:`RunSpec`. A list ``environment`` or ``impairments``
        replaces the one of the radar's preset.
    where, text : str
        File name and text for error messages.
    folder : Path, optional
        Folder that the path of a preset file starts from; the working folder by default.

    Raises
    ------
    ConfigError
        Naming the dotted key, its line, the value and what is allowed.
    """
    unknown = sorted(set(table) - set(SECTIONS))
    if unknown:
        places = ", ".join(key + line_note(text, [key]) for key in unknown)
        raise ConfigError(f"{where}: {places}: unknown key; allowed are {', '.join(SECTIONS)}")
    twin = parse_radar(table.get("radar", {"preset": "x4"}), where=where, text=text, folder=folder)
    scene = {key: table[key] for key in SCENE_KEYS if key in table}
    rest = {key: table[key] for key in ("noise", *TWIN_KEYS, "analysis", "seed") if key in table}
    parsed = validate(SceneSpec, scene, where=where, text=text)
    return validate(RunSpec, {"scene": parsed, **twin, **rest}, where=where, text=text)


def parse_radar(table: Any, *, where: str = "radar", text: str = "", folder: Path | None = None) -> dict[str, Any]:
    """What a ``[radar]`` table gives a run: ``radar``, ``auto_prf`` and the lists of a sensor twin's preset."""
    if isinstance(table, str):
        table = {"preset": table}
    if not isinstance(table, Mapping):
        raise ConfigError(f"{where}: radar must be a preset's name or a table, not {table!r}")
    values = dict(table)
    preset = values.pop("preset", None)
    auto_prf = values.get("prf_hz") == "auto"
    if auto_prf:
        del values["prf_hz"]
        values |= {} if preset is not None else {"prf_hz": AUTO_PRF_START_HZ}
    lists = {}
    if preset is not None:
        try:
            place = _preset_place(str(preset), folder)
            values = changed_preset(place, values)
            lists = {key: value for key, value in preset_table(place).items() if key in TWIN_KEYS}
        except ConfigError as error:
            raise ConfigError(f"{where}: radar.preset{line_note(text, ['radar', 'preset'])}: {error}") from None
    radar = validate(Radar, values, where=where, text=text, section=("radar",))
    return {"radar": radar, "auto_prf": auto_prf, **lists}


def _preset_place(preset: str, folder: Path | None) -> str:
    """Name of a preset, or the path of its file seen from the folder of the scene file."""
    return str((folder or Path()) / preset) if preset.endswith(".toml") else preset


def load_run(path: str | Path, *, overrides: Sequence[str] = ()) -> RunSpec:
    """Run specification of a scene file with ``KEY=VALUE`` overrides put in."""
    table, text = read_toml(path)
    return parse_run(apply_overrides(table, overrides), where=str(path), text=text, folder=Path(path).parent)


def run_simulation(spec: RunSpec, *, folder: Path | None = None, angles: bool = True) -> Recording:
    """Simulate the recording that a specification describes; same specification, same bytes.

    Parameters
    ----------
    spec : RunSpec
    folder : Path, optional
        Folder that relative motion paths start from.
    angles : bool
        As for :func:`doppelgait.pipeline.simulate`.
    """
    scene, radar, streams, conditions = _inputs(spec, folder)
    recording = simulate(scene, radar, angles=angles, rng=streams, conditions=conditions)
    return replace(recording, seed=spec.seed)


def _inputs(spec: RunSpec, folder: Path | None) -> tuple[Scene, Radar, Streams, Conditions]:
    """Scene, radar, random streams and conditions of a specification."""
    streams = Streams(spec.seed, spec.example)
    scene = build_scene(spec.scene, folder=folder, rng=streams.generator("motion"))
    radar = with_lowest_prf(scene, spec.radar, cpi_s=spec.analysis.cpi_s) if spec.auto_prf else spec.radar
    conditions = Conditions(noise=spec.noise, environment=spec.environment, impairments=spec.impairments)
    return scene, radar, streams, conditions
