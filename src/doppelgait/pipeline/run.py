"""A run as configuration: the scene file, resolved and carried out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from doppelgait.core.config import FrozenModel, apply_overrides, line_note, read_toml, validate
from doppelgait.core.errors import ConfigError
from doppelgait.core.rng import generator_for
from doppelgait.pipeline.fused import FusedExample, run_fused
from doppelgait.pipeline.simulate import simulate, with_lowest_prf
from doppelgait.processing import Analysis
from doppelgait.radar.config import Radar, changed_preset
from doppelgait.radar.recording import Recording
from doppelgait.scene import Scene
from doppelgait.scene.spec import SceneSpec, build_scene

AUTO_PRF_START_HZ = 1000.0


class NoiseSpec(FrozenModel):
    """Receiver noise of a run.

    Parameters
    ----------
    kind : {"thermal", "snr", "none"}
        ``thermal``: from the radar's noise figure and bandwidth (E-18). ``snr``: as much as gives ``snr_db``.
    snr_db : float
        Wanted SNR_frame: time mean of the strongest bin's power over the noise power.
    """

    kind: Literal["thermal", "snr", "none"] = "thermal"
    snr_db: float = Field(default=20.0, ge=-100, le=200)


class RunSpec(FrozenModel):
    """Everything that makes one recording and its analysis.

    Parameters
    ----------
    scene : SceneSpec
    radar : Radar
    auto_prf : bool
        Take the lowest frame rate at which nothing aliases (``prf_hz = "auto"``); for reproducing the report only.
    noise : NoiseSpec
    analysis : Analysis
    seed : int
        Root of all random streams.
    example : int
        Number of the example in a dataset; picks its streams.
    """

    scene: SceneSpec
    radar: Radar
    auto_prf: bool = False
    noise: NoiseSpec = NoiseSpec()
    analysis: Analysis = Analysis()
    seed: int = Field(default=0, ge=0)
    example: int = Field(default=0, ge=0)


SECTIONS = ("seed", "duration_s", "radar_position_m", "radar", "targets", "noise", "analysis")


def parse_run(table: Mapping[str, Any], *, where: str = "scene", text: str = "") -> RunSpec:
    """Run specification from the tables of a scene file.

    Parameters
    ----------
    table : mapping
        Keys ``targets`` (list), ``radar`` (``preset`` and changes, or all parameters), and optionally ``noise``,
        ``analysis``, ``seed``, ``duration_s``, ``radar_position_m``.
    where, text : str
        File name and text for error messages.

    Raises
    ------
    ConfigError
        Naming the dotted key, its line, the value and what is allowed.
    """
    unknown = sorted(set(table) - set(SECTIONS))
    if unknown:
        places = ", ".join(key + line_note(text, [key]) for key in unknown)
        raise ConfigError(f"{where}: {places}: unknown key; allowed are {', '.join(SECTIONS)}")
    radar, auto_prf = parse_radar(table.get("radar", {"preset": "x4"}), where=where, text=text)
    scene = {key: table[key] for key in ("targets", "radar_position_m", "duration_s") if key in table}
    rest = {key: table[key] for key in ("noise", "analysis", "seed") if key in table}
    parsed = validate(SceneSpec, scene, where=where, text=text)
    return validate(RunSpec, {"scene": parsed, "radar": radar, "auto_prf": auto_prf, **rest}, where=where, text=text)


def parse_radar(table: Any, *, where: str = "radar", text: str = "") -> tuple[Radar, bool]:
    """Radar of a ``[radar]`` table, and whether its frame rate is ``"auto"``."""
    if isinstance(table, str):
        table = {"preset": table}
    if not isinstance(table, Mapping):
        raise ConfigError(f"{where}: radar must be a preset's name or a table, not {table!r}")
    values = dict(table)
    auto_prf = values.get("prf_hz") == "auto"
    if auto_prf:
        values["prf_hz"] = AUTO_PRF_START_HZ
    preset = values.pop("preset", None)
    if preset is not None:
        try:
            values = changed_preset(str(preset), values)
        except ConfigError as error:
            raise ConfigError(f"{where}: radar.preset{line_note(text, ['radar', 'preset'])}: {error}") from None
    return validate(Radar, values, where=where, text=text, section=("radar",)), auto_prf


def load_run(path: str | Path, *, overrides: Sequence[str] = ()) -> RunSpec:
    """Run specification of a scene file with ``KEY=VALUE`` overrides put in."""
    table, text = read_toml(path)
    return parse_run(apply_overrides(table, overrides), where=str(path), text=text)


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
    scene, radar, drawn = _inputs(spec, folder)
    recording = simulate(scene, radar, angles=angles, **drawn)
    return Recording(**{**vars(recording), "seed": spec.seed})


def run_example(spec: RunSpec, *, folder: Path | None = None, gate_error_m: float = 0.0) -> FusedExample:
    """Simulate and analyse what a specification describes, in its truth gates, without making the data matrix.

    Parameters
    ----------
    spec : RunSpec
    folder : Path, optional
        Folder that relative motion paths start from.
    gate_error_m : float
        Range error of the gates.
    """
    scene, radar, drawn = _inputs(spec, folder)
    return run_fused(scene, radar, spec.analysis, gate_error_m=gate_error_m, **drawn)


def _inputs(spec: RunSpec, folder: Path | None) -> tuple[Scene, Radar, dict[str, Any]]:
    """Scene, radar and the random arguments of a specification; every stream comes from its seed and example number."""
    scene = build_scene(spec.scene, folder=folder, rng=generator_for(spec.seed, "motion", spec.example))
    radar = with_lowest_prf(scene, spec.radar, cpi_s=spec.analysis.cpi_s) if spec.auto_prf else spec.radar
    rng = None if spec.noise.kind == "none" else generator_for(spec.seed, "noise", spec.example)
    snr_db = spec.noise.snr_db if spec.noise.kind == "snr" else None
    return scene, radar, {"rng": rng, "snr_db": snr_db, "scene_rng": generator_for(spec.seed, "scene", spec.example)}
