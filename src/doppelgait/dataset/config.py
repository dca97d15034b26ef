"""The dataset plan as a configuration file."""

from __future__ import annotations

import re
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import Field, field_validator, model_validator

from doppelgait.core.config import FrozenModel, apply_overrides, read_toml, validate
from doppelgait.core.errors import ConfigError
from doppelgait.scene.target import SceneParameters

SCENE_KEYS = tuple(SceneParameters.model_fields)
SPLITS = ("train", "validation", "test")
AUTO_PRF_REFUSED = "radar.prf_hz = 'auto' is not allowed in a dataset: it tells the speed to every feature"
ORACLE_REFUSED = (
    "analysis.method = 'liland2018' is not allowed in a dataset: its gate takes the span from the class and the "
    "Doppler band from the truth, which tells both to every feature; use 'standard'"
)


class DatasetSection(FrozenModel):
    """``[dataset]``: size, seed, splits and what is kept.

    Parameters
    ----------
    name : str
    seed : int
        Root of every random stream.
    examples_per_class : int
    fractions : table
        Share of the subjects of every class in train, validation and test; sums to 1.
    shard_size : int
        Examples in one shard file: the unit of work, of resume and of hashing.
    gate_error_sd_m : float
        Standard deviation of the range error of the gate, the same for every class.
    fields : list
        Arrays to keep beside the features.
    """

    name: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")
    seed: int = Field(default=2018, ge=0)
    examples_per_class: int = Field(ge=1, le=10_000_000)
    fractions: dict[str, float] = Field(default_factory=lambda: {"train": 0.7, "validation": 0.15, "test": 0.15})
    shard_size: int = Field(default=50, ge=1, le=100_000)
    gate_error_sd_m: float = Field(default=0.2, ge=0, le=1)
    fields: tuple[Literal["signature", "cadence_map", "baseband"], ...] = ("signature",)

    @field_validator("fractions")
    @classmethod
    def _sum_to_one(cls, fractions: dict[str, float]) -> dict[str, float]:
        if set(fractions) - set(SPLITS) or any(v < 0 for v in fractions.values()):
            raise ValueError(f"must hold shares of 0 or more for {', '.join(SPLITS)} only")
        if abs(sum(fractions.values()) - 1.0) > 1e-9:
            raise ValueError(f"must sum to 1, not {sum(fractions.values()):g}")
        return fractions


class ClassSection(FrozenModel):
    """``[[classes]]``: a label and how its targets move.

    Parameters
    ----------
    label : str
    motion : table
        As in a scene file, with distributions: ``{ kind = "boulic", speed_mps = { uniform = [0.6, 2.0] } }``; a
        ``{ choice = [...] }`` of several such tables mixes sources.
    """

    label: str = Field(min_length=1)
    motion: dict[str, Any]

    @field_validator("label")
    @classmethod
    def _plain(cls, label: str) -> str:
        if not re.fullmatch(r"[A-Za-z0-9 _.-]+", label):
            raise ValueError("may hold letters, digits, space and _ . - only")
        return label


class PlanConfig(FrozenModel):
    """A dataset plan; what is outside ``[[classes]]`` holds for every class alike, so that it cannot tell them apart.

    Parameters
    ----------
    dataset : DatasetSection
    classes : list of ClassSection
    scene : table
        ``duration_s``, ``radar_position_m`` and the radar's orientation.
    target : table
        Placement and radar cross section: keys of a scene file's ``[[targets]]`` without motion and label.
    background : list
        Movers that scatter but are no target (a fan, a curtain): ``[[targets]]`` entries of a scene file, motion
        included.
    environment, impairments : list
        As in a scene file. In these and in ``background`` an entry that is drawn as an empty table
        (``{ choice = [{ kind = "wall", ... }, {}] }``) is left out.
    radar, noise, analysis : table
        As in a scene file. All tables may hold distributions. ``radar.prf_hz = "auto"`` and the oracle gate of
        ``analysis.method = "liland2018"`` are refused: both tell the features what they should find.
    """

    dataset: DatasetSection
    classes: tuple[ClassSection, ...] = Field(min_length=1)
    scene: dict[str, Any] = Field(default_factory=dict)
    target: dict[str, Any] = Field(default_factory=dict)
    radar: dict[str, Any] = Field(default_factory=lambda: {"preset": "x4"})
    noise: dict[str, Any] = Field(default_factory=dict)
    background: list[Any] | dict[str, Any] = Field(default_factory=list)
    environment: list[Any] | dict[str, Any] | None = None
    impairments: list[Any] | dict[str, Any] | None = None
    analysis: dict[str, Any] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _check(self) -> Self:
        labels = [c.label for c in self.classes]
        if len({label.replace(" ", "_") for label in labels}) < len(labels):
            raise ValueError(f"classes: labels must differ by more than a space for a _, got {labels}")
        if self.radar.get("prf_hz") == "auto":
            raise ValueError(AUTO_PRF_REFUSED)
        if self.analysis.get("method") == "liland2018":
            raise ValueError(ORACLE_REFUSED)
        for key, place in (("motion", "[[classes]]"), ("label", "[[classes]]"), ("background", "[[background]]")):
            if key in self.target:
                raise ValueError(f"target.{key}: belongs into {place}")
        unknown = set(self.scene) - set(SCENE_KEYS)
        if unknown:
            raise ValueError(f"scene.{min(unknown)}: unknown key; allowed are {', '.join(SCENE_KEYS)}")
        return self


def plan_names() -> list[str]:
    """Names of the built-in plans."""
    folder = resources.files("doppelgait.dataset.plans")
    return sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml"))


def load_plan(plan: str | Path, *, overrides: Sequence[str] = ()) -> tuple[PlanConfig, Path]:
    """Plan of a TOML file or of a built-in name, and the folder that relative motion paths start from.

    Raises
    ------
    ConfigError
        If there is no such file or name, or a key is not allowed.
    """
    name = str(plan)
    if name in plan_names() and not Path(name).is_file():
        with resources.as_file(resources.files("doppelgait.dataset.plans") / f"{name}.toml") as path:
            table, text = read_toml(path)
        folder = Path.cwd()
    elif Path(name).is_file():
        table, text = read_toml(name)
        folder = Path(name).resolve().parent
    else:
        raise ConfigError(f"{name}: neither a file nor a built-in plan; built-in are: {', '.join(plan_names())}")
    return validate(PlanConfig, apply_overrides(table, overrides), where=name, text=text), folder
