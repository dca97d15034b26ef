"""Configuration of a run: scene file and simulation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import Field, model_validator

from doppelgait.core.config import (
    FrozenModel,
    apply_overrides,
    as_table,
    format_line_note,
    read_toml,
    validate,
    write_toml,
)
from doppelgait.core.errors import ConfigError
from doppelgait.core.rng import Streams
from doppelgait.pipeline.radar_table import FITTED_KEYS, Conditions, Noise, parse_radar
from doppelgait.pipeline.simulate import choose_lowest_prf, simulate
from doppelgait.processing import Analysis
from doppelgait.radar.impairments import Impairments
from doppelgait.radar.parameters import Radar
from doppelgait.radar.recording import Recording
from doppelgait.scene import PlacedScene, Scene, place
from doppelgait.scene.environment import Environment
from doppelgait.scene.scene import resolve_file_paths


class Run(FrozenModel):
    """Configuration of one recording and its analysis.

    Parameters
    ----------
    scene : Scene
    radar : Radar or str
        A string is the name of a preset or the ``.toml`` file of a radar.
    auto_prf : bool
        Use the lowest frame rate without aliasing (``prf_hz = "auto"``); only for reproducing the report.
    noise, environment, impairments
        As for :class:`doppelgait.Conditions`.
    analysis : Analysis
    seed : int
        Seed of all random streams.
    example : int
        Number of the example in a dataset; it selects the random streams of the example.
    """

    scene: Scene
    radar: Radar
    auto_prf: bool = False
    noise: Noise = Noise()
    environment: Environment = ()
    impairments: Impairments = ()
    analysis: Analysis = Analysis()
    seed: int = Field(default=0, ge=0)
    example: int = Field(default=0, ge=0)

    if TYPE_CHECKING:  # a type checker would reject the short forms of parameters

        def __init__(self, *, scene: Scene, radar: Radar | str, **parameters: Any) -> None: ...

    @model_validator(mode="before")
    @classmethod
    def _read_radar(cls, data: Any) -> Any:
        if isinstance(data, Mapping) and isinstance(data.get("radar"), str):
            known = {key: data[key] for key in ("seed", "example") if isinstance(data.get(key), int) and data[key] >= 0}
            try:
                parsed = parse_radar(data["radar"], where="", **known)
                return {**parsed, **data, "radar": parsed["radar"]}
            except ConfigError as error:
                raise ValueError(str(error)) from None
        return data

    @classmethod
    def from_toml(cls, path: str | Path, *, overrides: Sequence[str] = ()) -> Run:
        """Read a scene file and apply ``KEY=VALUE`` overrides.

        Relative paths of motion files start from its folder. Errors name the key and its line.
        """
        table, text = read_toml(path)
        folder = Path(path).parent
        run = parse_run(apply_overrides(table, overrides), where=str(path), text=text, folder=folder)
        return run.model_copy(update={"scene": resolve_file_paths(run.scene, folder.resolve())})

    def to_toml(self) -> str:
        """Convert the run to the text of a scene file for :meth:`from_toml`."""
        self.scene.to_toml()  # rejects motions that exist only in memory
        table = as_table(self)
        scene, auto_prf = table.pop("scene"), table.pop("auto_prf", False)
        if auto_prf:
            table["radar"]["prf_hz"] = "auto"
        return write_toml({**scene, **table})

    @property
    def conditions(self) -> Conditions:
        """Noise, environment and impairments."""
        return Conditions(noise=self.noise, environment=self.environment, impairments=self.impairments)

    @property
    def streams(self) -> Streams:
        """Random streams of the run."""
        return Streams(self.seed, self.example)


SCENE_KEYS = tuple(Scene.model_fields)
SECTIONS = ("seed", "example", *SCENE_KEYS, "radar", "noise", *FITTED_KEYS, "analysis")


def parse_run(table: Mapping[str, Any], *, where: str = "scene", text: str = "", folder: Path | None = None) -> Run:
    """Parse a run from a scene file's tables.

    Parameters
    ----------
    table : mapping
        Keys ``targets`` (list), ``radar`` (``preset`` and changes, or all parameters), and
        optionally the other keys of :class:`doppelgait.scene.Scene` and of :class:`Run`. A list
        ``environment`` or ``impairments`` replaces the one of the radar's preset.
    where, text : str
        File name and text for error messages.
    folder : Path, optional
        Folder to which the path of a preset file is relative; the working folder by default.

    Raises
    ------
    ConfigError
        With the dotted key, its line, its value and the allowed values.
    """
    unknown = sorted(set(table) - set(SECTIONS))
    if "dataset" in unknown:
        raise ConfigError(f"{where}: is a plan, not a scene: doppelgait dataset build {where}")
    if unknown:
        places = ", ".join(key + format_line_note(text, [key]) for key in unknown)
        raise ConfigError(f"{where}: {places}: unknown key; allowed are {', '.join(SECTIONS)}")
    known = {key: table[key] for key in ("seed", "example") if isinstance(table.get(key), int) and table[key] >= 0}
    radar = parse_radar(table.get("radar", {"preset": "x4"}), where=where, text=text, folder=folder, **known)
    scene = {key: table[key] for key in SCENE_KEYS if key in table}
    rest = {key: table[key] for key in ("noise", *FITTED_KEYS, "analysis", "seed", "example") if key in table}
    parsed = validate(Scene, scene, where=where, text=text)
    return validate(Run, {"scene": parsed, **radar, **rest}, where=where, text=text)


def run_simulation(
    run: Run, *, folder: Path | None = None, angles: bool = True, path: str | Path | None = None
) -> Recording:
    """Simulate a run; equal runs give equal bytes.

    Parameters
    ----------
    run : Run
    folder : Path, optional
        Folder to which motion paths are relative.
    angles, path
        As for :func:`doppelgait.pipeline.simulate`.

    Examples
    --------
    >>> import doppelgait as dg
    >>> scene = dg.Scene([dg.Target({"kind": "boulic", "speed_mps": 1.2}, label="human")], duration_s=3.0)
    >>> run = dg.Run(scene=scene, radar=dg.Radar.preset("x4", prf_hz=640.0), seed=1)
    >>> dg.pipeline.run_simulation(run).n_pulses
    1920
    """
    return simulate_placed(run, place(run.scene, run.streams, folder=folder), angles=angles, path=path)


def simulate_placed(run: Run, scene: PlacedScene, *, angles: bool = True, path: str | Path | None = None) -> Recording:
    """Simulate a run whose scene is placed."""
    streams, radar = run.streams, run.radar
    if run.auto_prf:
        radar = choose_lowest_prf(scene, radar, cpi_s=run.analysis.cpi_s)
    return simulate(scene, radar, angles=angles, rng=streams, conditions=run.conditions, path=path)
