"""Configuration of a dataset: plan or imported recordings."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from difflib import get_close_matches
from itertools import zip_longest
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, BeforeValidator, Field, NonNegativeFloat, field_validator, model_validator

from doppelgait.core.config import FrozenModel, apply_overrides, read_toml, validate
from doppelgait.core.errors import ConfigError, list_choices
from doppelgait.pipeline import Tracking
from doppelgait.processing import Analysis, Gate
from doppelgait.processing.gate import GateChoice
from doppelgait.scene.scene import Scene, Target

SHOWN_LENGTH = 60  # maximum number of characters of a value in a message
_TAIL = 20
_ABSENT = object()


def shorten(value: Any) -> str:
    """Format a value as JSON of at most :data:`SHOWN_LENGTH` characters."""
    text = json.dumps(value, ensure_ascii=False, default=str)
    return text if len(text) <= SHOWN_LENGTH else f"{text[: SHOWN_LENGTH - _TAIL - 3]}...{text[-_TAIL:]}"


def list_some(names: Sequence[Any], shown: int = 5, joint: str = ", ") -> str:
    """List the first few of many names, and count the others."""
    listed = joint.join(map(str, names[:shown]))
    return f"{listed}{joint.rstrip(', ')} and {len(names) - shown} more" if len(names) > shown else listed


def list_differences(old: Any, new: Any, key: str = "") -> Iterator[str]:
    """Yield dotted keys with differing values, ``key: old -> new``."""
    if isinstance(old, dict) and isinstance(new, dict):
        for name in sorted(set(old) | set(new)):
            yield from list_differences(
                old.get(name, _ABSENT), new.get(name, _ABSENT), f"{key}.{name}" if key else name
            )
    elif isinstance(old, list) and isinstance(new, list):
        for number, (before, after) in enumerate(zip_longest(old, new, fillvalue=_ABSENT)):
            yield from list_differences(before, after, f"{key}.{number}")
    elif old != new:
        before, after = ("absent" if value is _ABSENT else shorten(value) for value in (old, new))
        yield f"{key}: {before} -> {after}"


def suggest_names(name: str, known: Iterable[str]) -> str:
    """Return a hint of similar names, or their number, for messages."""
    names = sorted(known)
    close = get_close_matches(name, names, n=5, cutoff=0.5)
    if close:
        return f"; near in spelling: {', '.join(close)}"
    if len(names) <= 8:
        return f"; there are {', '.join(names) or 'none'}"
    return f"; there are {len(names)}, from {names[0]} to {names[-1]}"


SCENE_KEYS = tuple(name for name in Scene.model_fields if name != "targets")
Split = Literal["train", "validation", "test"]
SPLITS: tuple[Split, ...] = ("train", "validation", "test")
Progress = Callable[[int, int], None]
"""Function that is told how many are done, of how many."""
PLANS = Path(__file__).with_name("plans")
MAX_SHARDS = 200_000  # maximum number of shards of a dataset; each shard has two files
LEAKS = (
    *(f"target.{name}" for name in Target.model_fields if name not in ("motion", "label", "background")),
    "radar.prf_hz",
    "scene.duration_s",
)
"""Keys that a plan can name in ``dataset.leaks``."""
AUTO_PRF_REFUSED = (
    "radar.prf_hz = 'auto' is not allowed in a dataset: it reveals the speed to every feature; a "
    "plan that reproduces a published dataset must list it in dataset.leaks"
)
ORACLE_REFUSED = (
    "analysis.method = 'liland2018' is not allowed in a dataset: its gate uses the class for the range span and the "
    "truth for the Doppler band, which reveals both to every feature; use 'standard'"
)


class FieldSpec(FrozenModel):
    """Array to store in addition to a row's features.

    name: Name of the array (:data:`doppelgait.dataset.shard_files.FIELDS`).
    dtype: ``full``: single precision. ``half`` (signature and cadence map): 10 log10 in float16,
        under a third of the size on disk, with an error of at most 1.5 % of the value (0.0625 dB).
        The default is ``half`` for a signature, else ``full``.
    hop: Keep every ``hop``-th column (or pulse).
    """

    name: Literal[
        "signature", "cadence_map", "ti_frames", "pictures", "baseband", "truth_range_m", "truth_radial_velocity_mps"
    ]
    dtype: Literal["full", "half"] | None = None
    hop: int = Field(default=1, ge=1, le=10_000)

    @property
    def is_half(self) -> bool:
        """True if powers are stored in half precision, dB."""
        return self.name == "signature" if self.dtype is None else self.dtype == "half"

    @model_validator(mode="after")
    def _can_be(self) -> Self:
        if self.dtype == "half" and self.name not in ("signature", "cadence_map"):
            raise ValueError(f"dtype: 'half' is not allowed for {self.name}; it is for signature and cadence_map")
        if self.hop > 1 and self.name in ("cadence_map", "pictures"):
            raise ValueError(f"hop: {self.name} has no columns in time; leave it out")
        if self.hop > 1 and self.name == "baseband":
            raise ValueError(
                "hop: keeping every n-th pulse of the baseband would alias; leave it out, or lower radar.prf_hz"
            )
        return self


def _list_field_specs(fields: Any, allowed: Sequence[str] = ()) -> Any:
    if not isinstance(fields, list | tuple):  # the validation of the model rejects other values
        return fields
    specs = [{"name": one} if isinstance(one, str) else one for one in fields]
    stated = [one.get("name") if isinstance(one, dict) else getattr(one, "name", None) for one in specs]
    names = [name for name in stated if isinstance(name, str)]
    if len(set(names)) < len(names):
        raise ValueError(f"names a field twice: {', '.join(names)}")
    if unknown := [name for name in names if allowed and name not in allowed]:
        raise ValueError(f"{unknown[0]!r} is not one of {', '.join(allowed)}, the fields of recordings")
    return specs


class SplitSection(FrozenModel):
    """``[dataset.split]``: assignment of subjects to splits.

    A subject and all subjects that share a scene with it are in one split.

    strategy: ``stratified``: the shares are exact for every class. ``stable``: a hash of the
        subject's name sets its split, so that subjects added later do not move the others; the
        shares are correct on average.
    sources: Leave one source out: ``{ recording = "test" }`` puts every recorded subject into test;
        ``model`` and ``recording`` are the sources.
    subjects: Subjects assigned by name, with ``*`` and ``?``: ``{ test = ["cmu-07", "dog-*"] }``.
    """

    strategy: Literal["stratified", "stable"] = "stratified"
    sources: dict[Literal["model", "recording"], Split] = Field(default_factory=dict)
    subjects: dict[Split, tuple[str, ...]] = Field(default_factory=dict)


class SourceSection(FrozenModel):
    r"""``[[sources]]``: subjects, licences and citations of motion files.

    The first entry that matches a file applies.

    files: Motion files as written in the plan; ``*`` stands for any text, including folders.
    subject: Regular expression; its first group in a file's path names the person or animal
        (``"cmu_(\d+)_"``). By default every file is a separate subject.
    licence: Name of the licence, from SPDX if it is listed there; empty if unknown. Unknown and
        non-commercial licences block a release.
    citation: Citation that users of the dataset must include.
    """

    files: str = Field(min_length=1)
    subject: str | None = None
    licence: str = ""
    citation: str = ""

    @field_validator("subject")
    @classmethod
    def _has_a_group(cls, subject: str | None) -> str | None:
        try:
            groups = 1 if subject is None else re.compile(subject).groups
        except re.error as error:
            raise ValueError(f"is not a regular expression: {error}") from None
        if groups < 1:
            raise ValueError("needs a group in round brackets that matches the name of the subject")
        return subject


def _sum_to_one(shares: dict[Split, float]) -> dict[Split, float]:
    if abs(sum(shares.values()) - 1.0) > 1e-9:
        raise ValueError(f"shares must sum to 1, not {sum(shares.values()):g}; a split that is not stated has no share")
    return shares


Shares = Annotated[dict[Split, NonNegativeFloat], AfterValidator(_sum_to_one)]


class DatasetSection(FrozenModel):
    """``[dataset]``: size, seed, splits and stored arrays.

    name: Name of the dataset; letters, digits and ``. _ -``.
    seed: Root of every random stream.
    examples_per_class: Number of examples of every class that does not set ``examples``.
    fractions: Share of the subjects of every class in train, validation and test; sums to 1.
    split: Assignment of subjects to train, validation and test.
    shard_size: Examples in one shard file. The shard is the unit of work, of resuming and of
        hashing.
    gate: ``truth``: centred on the true range of the body plus an error that is independent of the
        class. ``track``: found by tracking, as in a measured recording; a target without a track
        has no features and the flag ``not_tracked``.
    gate_error_sd_m: Standard deviation of the range error of the truth gate, the same for every
        class.
    window_s: Length of the windows of episodes, whose gates are always those of tracks.
    hop_s: Time between the starts of consecutive windows of episodes.
    fields: Arrays to store in addition to the features: names, or tables (:class:`FieldSpec`).
    leaks: Keys that may reveal the class in this plan, to reproduce a published dataset:
        ``target.KEY`` may differ by class (``[classes.target]``), ``radar.prf_hz`` may be
        ``"auto"``, ``scene.duration_s`` may be left out (every recording then has its full length).
        The card lists them and ``verify`` does not judge them.
    """

    name: str = Field(max_length=200, pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")
    seed: int = Field(default=2018, ge=0)
    examples_per_class: int = Field(ge=1, le=10_000_000)
    fractions: Shares = Field(default_factory=lambda: dict(zip(SPLITS, (0.7, 0.15, 0.15), strict=True)))
    split: SplitSection = SplitSection()
    shard_size: int = Field(default=50, ge=1, le=100_000)
    gate: Literal["truth", "track"] = "truth"
    gate_error_sd_m: float = Field(default=0.2, ge=0, le=1)
    window_s: float = Field(default=2.5, ge=0.5, le=600)
    hop_s: float = Field(default=0.625, ge=0.05, le=600)
    fields: Annotated[tuple[FieldSpec, ...], BeforeValidator(_list_field_specs)] = (FieldSpec(name="signature"),)
    leaks: tuple[Literal[LEAKS], ...] = ()  # type: ignore[valid-type]


Label = Annotated[str, Field(min_length=1, pattern=r"^[A-Za-z0-9 _.-]+$")]


class ClassSection(FrozenModel):
    """``[[classes]]``: a label and the motion of its targets.

    label: Name of the class; letters, digits, space and ``_ . -``.
    motion: Motion as in a scene file, with distributions: ``{ kind = "boulic", speed_mps = {
        uniform = [0.6, 2.0] } }``; a ``{ choice = [...] }`` of several such tables mixes sources.
        ``{ kind = "folder", path = "dogs" }`` takes the straight segments of all motion files of a
        folder in turn (:mod:`doppelgait.dataset.motions`). ``"none"`` is an empty scene, with or
        without background; the gate follows a virtual body without echo.
    examples: Number of examples of this class; ``dataset.examples_per_class`` by default.
    target: Keys that replace those of ``[target]`` in this class; each must be named in
        ``dataset.leaks``.
    """

    label: Label
    motion: Annotated[dict[str, Any], BeforeValidator(lambda stated: {"kind": "none"} if stated == "none" else stated)]
    target: dict[str, Any] = Field(default_factory=dict)
    examples: int | None = Field(default=None, ge=1, le=10_000_000)


class EpisodeSection(FrozenModel):
    """``[[episodes]]``: a kind of episode of life: bodies that come, move about and go.

    Every track in every window of its recordings is a row. It has the label of the body that it
    follows, or ``thing`` without one, and the number of its track.

    label: Name of the kind; letters, digits, space and ``_ . -``.
    targets: Targets as in a scene file, with label, motion and place, after the keys of
        ``[target]``; values may be distributions.
    duration_s: Length of one recording.
    environment: Effects as in a scene file, applied after those of the plan.
    examples: Number of recordings; ``dataset.examples_per_class`` by default.
    should_trigger: Whether a person is present who should trigger the alarm.
    animals: Number of animals that move, for triggers per animal-hour.
    hours_per_day: Hours per day of such episodes: the weight of their false triggers.
    """

    label: Label
    targets: list[dict[str, Any]] | dict[str, Any]
    duration_s: float = Field(ge=3, le=600)
    environment: list[Any] | dict[str, Any] = Field(default_factory=list)
    examples: int | None = Field(default=None, ge=1, le=10_000_000)
    should_trigger: bool = False
    animals: int = Field(default=0, ge=0, le=10)
    hours_per_day: float = Field(default=1.0, gt=0, le=24)


class PlanConfig(FrozenModel):
    """Dataset plan.

    Everything outside ``[[classes]]`` applies to all classes equally, so that it cannot distinguish
    them. Exceptions are the keys in ``dataset.leaks``. All tables but ``dataset`` and ``sources``
    may hold distributions.

    dataset: Name, size, seed, splits and stored arrays of the dataset.
    classes: Labels of the classes and motion of their targets.
    episodes: Kinds of episodes, instead of classes; they have no companions.
    scene: Duration, and position and orientation of the radar: keys of a scene file other than
        ``targets``.
    target: Placement and radar cross section: keys of a scene file's ``[[targets]]`` without motion
        and label.
    companions: Further targets of every scene, with label, motion and place: ``[[targets]]``
        entries of a scene file. Each is a separate row with its own label and subject, in the split
        of its scene.
    background: Confusers, which scatter but are not targets (a fan, a curtain): ``[[targets]]``
        entries of a scene file, with motion.
    sources: Subjects, licences and citations of the motion files.
    environment: Walls, reflections and screens, as in a scene file. In this and the other lists of
        targets and impairments, an entry that is sampled as an empty table is left out: ``{ choice
        = [{ kind = "wall", ... }, {}] }``.
    impairments: Receiver errors in the order of their application, as in a scene file.
    radar: As in a scene file: ``preset`` and changes, or all parameters. ``prf_hz = "auto"`` is
        refused, because it reveals the speed to the features, except where ``dataset.leaks`` names
        ``radar.prf_hz``.
    noise: Receiver noise, as in a scene file. Plans with an empty class (``motion = "none"``) allow
        ``thermal`` only, because a wanted SNR needs a target.
    analysis: Computation of the signature and the features, as in a scene file. ``method =
        "liland2018"`` is refused, because its gate reveals the class and the truth to the features.
    """

    dataset: DatasetSection
    classes: tuple[ClassSection, ...] = ()
    episodes: tuple[EpisodeSection, ...] = ()
    scene: dict[str, Any] = Field(default_factory=dict)
    target: dict[str, Any] = Field(default_factory=dict)
    radar: dict[str, Any] = Field(default_factory=lambda: {"preset": "x4"})
    noise: dict[str, Any] = Field(default_factory=dict)
    sources: tuple[SourceSection, ...] = ()
    companions: list[Any] | dict[str, Any] = Field(default_factory=list)
    background: list[Any] | dict[str, Any] = Field(default_factory=list)
    environment: list[Any] | dict[str, Any] | None = None
    impairments: list[Any] | dict[str, Any] | None = None
    analysis: dict[str, Any] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _check(self) -> Self:
        if bool(self.classes) == bool(self.episodes):
            raise ValueError("classes, episodes: a plan has one of them: [[classes]] or [[episodes]]")
        self._check_episodes()
        labels = [section.label for section in self.sections]
        if len({label.replace(" ", "_") for label in labels}) < len(labels):
            raise ValueError(f"labels must differ by more than a space for a _, got {labels}")
        for number, section in enumerate(self.classes):
            for key in section.target:
                if f"target.{key}" not in self.dataset.leaks:
                    raise ValueError(
                        f"classes.{number}.target.{key}: is not allowed, because it reveals the class; move it to "
                        "[target], or list it in dataset.leaks if the plan reproduces a published dataset"
                    )
        if self.radar.get("prf_hz") == "auto" and "radar.prf_hz" not in self.dataset.leaks:
            raise ValueError(AUTO_PRF_REFUSED)
        if self.analysis.get("method") == "liland2018":
            raise ValueError(ORACLE_REFUSED)
        for key, place in (("motion", "[[classes]]"), ("label", "[[classes]]"), ("background", "[[background]]")):
            if key in self.target:
                raise ValueError(f"target.{key}: belongs in {place}")
        empty = [c.label for c in self.classes if c.motion.get("kind") == "none"]
        if empty and self.noise.get("kind", "thermal") != "thermal":
            raise ValueError(
                f"noise.kind: {shorten(self.noise['kind'])} is not allowed with motion = 'none' "
                f"(class {empty[0]!r}): an SNR needs a target; use 'thermal'"
            )
        unknown = set(self.scene) - set(SCENE_KEYS)
        if unknown:
            raise ValueError(f"scene.{min(unknown)}: unknown key; allowed are {', '.join(SCENE_KEYS)}")
        return self

    def _check_episodes(self) -> None:
        fields = {spec.name for spec in self.dataset.fields}
        if not self.episodes:
            if "pictures" in fields and self.dataset.gate == "truth":
                raise ValueError("dataset.fields: pictures need tracks: [[episodes]], or dataset.gate = 'track'")
            return
        if self.dataset.leaks:
            raise ValueError("dataset.leaks: is for [[classes]]; the targets of episodes are not judged")
        if "duration_s" in self.scene:
            raise ValueError("scene.duration_s: belongs in [[episodes]]")
        if self.companions:
            raise ValueError("companions: belong among the targets of [[episodes]]")
        if self.noise.get("kind", "thermal") != "thermal":
            raise ValueError(f"noise.kind: {shorten(self.noise['kind'])} is not allowed here: episodes need 'thermal'")
        if truth := sorted(name for name in fields if name.startswith("truth_")):
            raise ValueError(f"dataset.fields: {truth[0]} is for [[classes]]; rows of episodes may follow no body")
        window_s, hop_s = self.dataset.window_s, self.dataset.hop_s
        if hop_s > window_s:
            raise ValueError(f"dataset.hop_s: {hop_s:g} is longer than window_s = {window_s:g}")
        if short := [one.label for one in self.episodes if one.duration_s < window_s]:
            raise ValueError(f"episodes: {short[0]!r}: duration_s is below dataset.window_s = {window_s:g}")

    @property
    def sections(self) -> Sequence[ClassSection | EpisodeSection]:
        """Classes, or kinds of episodes."""
        return self.classes or self.episodes

    def count_class_examples(self, section: ClassSection | EpisodeSection) -> int:
        """Return the number of examples of a class."""
        return section.examples or self.dataset.examples_per_class

    def count_examples(self) -> int:
        """Return the number of examples of all classes."""
        return sum(map(self.count_class_examples, self.sections))


def plan_names() -> list[str]:
    """List the names of the built-in plans.

    See Also
    --------
    load_plan : load a plan.

    Examples
    --------
    >>> import doppelgait as dg
    >>> dg.dataset.plan_names()[:3]
    ['home-alarm', 'home-alarm-day', 'home-alarm-life']
    """
    return sorted(path.stem for path in PLANS.glob("*.toml"))


def load_plan(plan: str | Path, *, overrides: Sequence[str] = ()) -> tuple[PlanConfig, Path]:
    """Load a plan by TOML file or built-in name.

    The function also returns the folder that relative motion paths start from.

    Raises
    ------
    ConfigError
        If the file or name does not exist, or a key is not allowed.

    See Also
    --------
    plan_names : names of the built-in plans.

    Examples
    --------
    >>> import doppelgait as dg
    >>> config, folder = dg.dataset.load_plan("liland2018")
    >>> [section.label for section in config.classes]
    ['human', 'dog', 'walker']
    """
    name = str(plan)
    if name in plan_names() and not Path(name).is_file():
        table, text = read_toml(PLANS / f"{name}.toml")
        folder = Path.cwd()
    elif name and os.path.exists(name):
        table, text = read_toml(name)
        folder = Path(name).resolve().parent
    else:
        known = list_choices(plan_names(), name)
        raise ConfigError(f"{name}: neither a file nor a built-in plan; built-in plans are: {known}")
    if "targets" in table and "dataset" not in table:
        raise ConfigError(f"{name}: is a scene, not a plan: doppelgait simulate {name}")
    return validate(PlanConfig, apply_overrides(table, overrides), where=name, text=text), folder


FIELDS_OF_RECORDINGS = ("signature", "cadence_map", "ti_frames", "baseband")


def parse_gate(value: Any, *, where: str = "") -> GateChoice:
    """Parse a gate: ``"track"``, ``"1.2:2.8"`` or two ranges in m."""
    return Gate.parse(value, names=("track",), lowest_m=0.0, where=where)


class ImportConfig(FrozenModel):
    """Configuration of an import of labelled recordings.

    gate: Default range gate for recordings whose label has none: tracked, or between two ranges in
        m. A recording without range (a continuous-wave radar) needs two ranges; any two within its
        frame are valid.
    window_s: Length of the windows that recordings are split into. A remainder shorter than a
        window is left out. By default a recording, or its part from ``start_s`` to ``stop_s``, is
        one example.
    hop_s: Time between the starts of consecutive windows; by default the windows are adjacent.
    fields: Arrays to store in addition to the features: ``signature``, ``cadence_map``,
        ``ti_frames``, ``baseband``.
    split: Split of all rows, or shares of the subjects of every class. The default is the column
        ``split`` of the labels, or ``test`` without this column.
    seed: Seed of the assignment of subjects to splits, used if ``split`` has shares.
    shard_size: Recordings in one shard file.
    analysis: Parameters of the signature and the features.
    tracking: Parameters of detection and tracking, for ``gate = "track"``.
    """

    gate: Literal["track"] | tuple[float, float] = "track"
    window_s: float | None = Field(default=None, gt=0, le=86_400)
    hop_s: float | None = Field(default=None, gt=0, le=86_400)
    fields: Annotated[
        tuple[FieldSpec, ...], BeforeValidator(lambda fields: _list_field_specs(fields, FIELDS_OF_RECORDINGS))
    ] = (FieldSpec(name="signature"),)
    split: Split | dict[Split, float] | None = None
    seed: int = Field(default=2018, ge=0)
    shard_size: int = Field(default=50, ge=1, le=100_000)
    analysis: Analysis = Analysis()
    tracking: Tracking = Tracking()

    @field_validator("gate", mode="before")
    @classmethod
    def _is_a_gate(cls, gate: Any) -> GateChoice:
        try:
            return parse_gate(gate)
        except ConfigError as error:
            raise ValueError(str(error)) from None

    @field_validator("split", mode="before")
    @classmethod
    def _is_a_split(cls, split: Any) -> Any:
        if not isinstance(split, dict) and (split is None or split in SPLITS):
            return split
        known = isinstance(split, dict) and split and set(split) <= set(SPLITS)
        if not known or not all(isinstance(share, int | float) and share >= 0 for share in split.values()):
            raise ValueError(f"must be one of {', '.join(SPLITS)}, or shares of 0 or more for these")
        return _sum_to_one(split)

    @model_validator(mode="after")
    def _check_hop(self) -> Self:
        if self.hop_s is not None and self.window_s is None:
            raise ValueError("hop_s: is the step between windows; set window_s, too")
        return self

    @property
    def step_s(self) -> float | None:
        """Step between the starts of windows, s."""
        return self.hop_s or self.window_s
