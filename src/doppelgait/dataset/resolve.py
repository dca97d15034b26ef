"""Resolved examples of a plan, pure functions of configuration and number."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

from doppelgait.core.config import FrozenModel, format_canonical_json
from doppelgait.core.documents import parse_json
from doppelgait.core.draws import Turn, compile_draws, resolve
from doppelgait.core.errors import ConfigError, DoppelgaitError, warn_caller
from doppelgait.core.rng import Streams
from doppelgait.dataset.config import AUTO_PRF_REFUSED, ORACLE_REFUSED, EpisodeSection, PlanConfig, shorten
from doppelgait.dataset.motions import (
    BOTH,
    EMPTY_SCENE,
    PHANTOM_SPEED_MPS,
    check_motion,
    find_source_entry,
    find_subject,
    list_recording_paths,
)
from doppelgait.motion.motion import Motion
from doppelgait.motion.readers import read
from doppelgait.pipeline import Run, parse_run
from doppelgait.pipeline.radar_table import FixedRadar, RadarFile, parse_radar
from doppelgait.radar.presets import read_preset

UNSEEN_M2 = 1e-30
"""Radar cross section of the body that an empty scene's gate follows: 300 dB below a person."""

STORED_KEYS = {"file", "values"}
"""Keys of a radar file stored with its values, ``preset = { file = "my-radar.toml", values = { ...
} }``; a dataset then needs no file of its radar."""

Draw = Callable[[Any, str], Any]
Compiled = dict[tuple[int, str], Callable[[Turn], Any]]
"""Compiled values of a plan by class and key; the examples of a batch share them."""


class RowSpec(FrozenModel):
    """One target of an example, one row of the index."""

    id: str
    label: str
    subject: str  # ``person/NAME`` if ``[[sources]]`` names it, else ``file/PATH``, or ``model/ID`` without one
    source: str  # ``model``, ``recording`` or ``none``
    # Motion files and licences from ``[[sources]]``; of a blended motion both, or unknown.
    recording: str = ""
    licence: str = ""
    others: tuple[str, ...] = ()  # further subjects of a blended motion, in the group of the first


class ExampleSpec(FrozenModel):
    """One planned example without distributions."""

    id: str  # of the scene; its first row has the same
    split: str  # empty, as the group, where the example belongs to no built dataset
    group: str
    gate_error_m: float  # of the truth gates
    rows: tuple[RowSpec, ...]  # one per target, in the order of the scene's; one for an empty scene
    run: Run
    is_episode: bool = False

    @property
    def label(self) -> str:
        """Class of the first row, empty without one."""
        return self.rows[0].label if self.rows else ""


def find_class(plan: PlanConfig, number: int) -> tuple[int, int]:
    """Return an example's class number and number within the class."""
    rest = number
    for place, section in enumerate(plan.sections):
        count = plan.count_class_examples(section)
        if rest < count:
            return place, rest
        rest -= count
    place = rest % len(plan.sections)
    return place, plan.count_class_examples(plan.sections[place]) + rest // len(plan.sections)


def make_example_id(label: str, number: int) -> str:
    """Return the identifier of the ``number``-th example of a class."""
    return f"{label.replace(' ', '_')}-{number:06d}"


def resolve_rows(
    plan: PlanConfig, number: int, folder: Path, draw: Draw
) -> tuple[tuple[RowSpec, ...], list[dict[str, Any]]]:
    """Return the rows of an example and their targets."""
    place, within = find_class(plan, number)
    section, name = plan.sections[place], make_example_id(plan.sections[place].label, within)
    if isinstance(section, EpisodeSection):
        bodies = draw(section.targets, "targets")
        if not isinstance(bodies, list):
            raise ConfigError(f"targets: {shorten(bodies)} is not allowed: must be a list of tables")
        for count, body in enumerate(bodies):
            key = f"episodes.{place}.targets.{count}"
            if not isinstance(body, Mapping) or not (isinstance(label := body.get("label"), str) and label):
                raise ConfigError(f"{key}: {shorten(body)} is not allowed: needs a label, a motion and a place")
            if not isinstance(body.get("background", False), bool):
                raise ConfigError(f"{key}.background: {shorten(body['background'])} is not allowed: true or false")
            motion = body.get("motion")
            motion = check_motion({"kind": motion} if isinstance(motion, str) else motion, folder, key=f"{key}.motion")
            bodies[count] = {**draw(plan.target, f"targets.{count}.target"), **body, "motion": motion}
        return _name_rows(plan, name, [body for body in bodies if not body.get("background")]), bodies
    key = f"classes.{place}.motion"
    try:
        motion = draw(section.motion, "motion")  # the key also names the random stream
    except ConfigError as error:
        raise ConfigError(f"classes.{place}.{error}") from None
    if isinstance(motion, Mapping) and motion.get("kind") == EMPTY_SCENE and "speed_mps" not in motion:
        motion = {**motion, "speed_mps": draw(PHANTOM_SPEED_MPS, "motion.speed_mps")}
    motion = check_motion(motion, folder, key=key)
    alone = motion["kind"] == EMPTY_SCENE  # a row of an empty scene must not show a target
    targets: list[dict[str, Any]] = [{"label": section.label, "motion": motion}]
    for count, companion in enumerate([] if alone else _sample_list(plan.companions, draw, "companions")):
        known = isinstance(companion, Mapping) and companion.get("label")
        if not known or not isinstance(companion.get("motion"), Mapping):
            raise ConfigError(f"companions.{count}: {shorten(companion)} is not allowed: needs label and motion")
        check_motion(companion["motion"], folder, key=f"companions.{count}.motion")
        placement = draw(plan.target, f"companions.{count}.target")
        targets.append({**placement, **companion})
    return _name_rows(plan, name, targets), targets


def _name_rows(plan: PlanConfig, name: str, targets: Sequence[Mapping[str, Any]]) -> tuple[RowSpec, ...]:
    rows = []
    for count, target in enumerate(targets):
        row_id = name if count == 0 else f"{name}-c{count}"
        motion = target["motion"]
        recordings = list_recording_paths(motion)
        entries = [find_source_entry(path, plan.sources) for path in recordings]
        licences = list(dict.fromkeys("" if entry is None else entry.licence for entry in entries))
        others = [find_subject({"kind": "file", "path": path}, row_id, plan.sources) for path in recordings[1:]]
        subject = find_subject(motion, row_id, plan.sources)
        rows.append(
            RowSpec.model_construct(  # as checked above
                id=row_id,
                label=str(target["label"]),
                subject=subject,
                others=tuple(other for other in others if other != subject),
                source="recording" if recordings else "none" if motion["kind"] == EMPTY_SCENE else "model",
                recording=BOTH.join(dict.fromkeys(recordings)),
                licence=" AND ".join(licences) if all(licences) else "",
            )
        )
    return tuple(rows)


def make_sampler(plan: PlanConfig, number: int, compiled: Compiled) -> Draw:
    """Make the function that samples values of an example."""
    # cycles advance with the number within the class, in the same order for every class
    place, within = find_class(plan, number)
    turn = Turn(within, Streams(plan.dataset.seed, number))

    def draw(value: Any, key: str) -> Any:
        if (place, key) not in compiled:
            compiled[place, key] = compile_draws(value, key)
        drawn = compiled[place, key](turn)
        if key.rpartition(".")[2] in ("scene", "target", "noise", "analysis") and not isinstance(drawn, Mapping):
            raise ConfigError(f"{key}: {shorten(drawn)} is not allowed; it must be a table")
        return drawn

    return draw


@lru_cache(maxsize=4)
def _parse_fixed_radar(text: str, folder: Path) -> FixedRadar | None:
    # the radar that all examples share, from its table in JSON; None if it is drawn or faulty
    table = replace_radar_files(parse_json(text))
    with suppress(ConfigError):  # the error of an example names it
        if resolve(table, seed=0, example=0, key="radar") == table:
            radar = parse_radar(table, where="", folder=folder)
            return radar if isinstance(radar, FixedRadar) else None
    return None


def resolve_example(
    plan: PlanConfig, number: int, folder: Path, *, split: str = "", group: str = "", compiled: Compiled | None = None
) -> ExampleSpec:
    """Resolve an example of a plan: sample every distribution."""
    place, within = find_class(plan, number)
    draw = make_sampler(plan, number, {} if compiled is None else compiled)
    section = plan.sections[place]
    name = make_example_id(section.label, within)
    try:
        rows, targets = resolve_rows(plan, number, folder, draw)
        run = _run_spec(plan, number, targets, folder, draw)
    except ConfigError as error:
        noun = "episode" if plan.episodes else "class"
        raise ConfigError(f"{noun} {section.label!r}: example {name}: {error}") from None
    error_m = float(Streams(plan.dataset.seed, number).generator("gate").normal(0.0, plan.dataset.gate_error_sd_m))
    facts: dict[str, Any] = {"split": split, "group": group, "gate_error_m": error_m, "is_episode": bool(plan.episodes)}
    return ExampleSpec.model_construct(id=name, rows=rows, run=run, **facts)


def _run_spec(plan: PlanConfig, number: int, targets: list[dict[str, Any]], folder: Path, draw: Draw) -> Run:
    # all but motions and the keys in ``dataset.leaks`` is sampled independently of the class
    section = plan.sections[place := find_class(plan, number)[0]]
    fixed = _parse_fixed_radar(json.dumps(plan.radar, default=str), folder)
    scene, changes = draw(plan.scene, "scene"), {}
    environment = None if plan.environment is None else _sample_list(plan.environment, draw, "environment")
    if isinstance(section, EpisodeSection):
        scene = {**scene, "duration_s": section.duration_s}
        environment = [*(environment or ()), *_sample_list(section.environment, draw, "episode.environment")]
    else:
        changes = section.target
        first = {**draw({**plan.target, **section.target}, "target"), **targets[0]}
        if section.motion.get("kind") == EMPTY_SCENE or targets[0]["motion"]["kind"] == EMPTY_SCENE:
            phantom = {"kind": "point", "speed_mps": targets[0]["motion"]["speed_mps"]}
            first |= {"motion": phantom, "rcs": {"kind": "equal", "total_m2": UNSEEN_M2}}
        targets = [first, *targets[1:]]
    background = _sample_list(plan.background, draw, "background")
    for count, target in enumerate(background):
        if not isinstance(target, Mapping) or not isinstance(target.get("motion"), Mapping):
            raise ConfigError(f"background.{count}: {shorten(target)} is not allowed: needs motion = {{ kind = ... }}")
        if target["motion"].get("kind") == "file":
            raise ConfigError(f"background.{count}.motion: a recording is not allowed here, it would have no subject")
    noise = draw(plan.noise, "noise")
    table = {
        **scene,
        "targets": [*targets, *({**target, "background": True} for target in background)],
        # sampling leaves a stored radar file unchanged: it has its own random streams
        "radar": fixed or draw(replace_radar_files(plan.radar), "radar"),
        "noise": {k: value for k, value in noise.items() if k != "snr_db" or noise.get("kind") == "snr"},
        **({} if environment is None else {"environment": environment}),
        **({} if plan.impairments is None else {"impairments": _sample_list(plan.impairments, draw, "impairments")}),
        "analysis": draw(plan.analysis, "analysis"),
        "seed": plan.dataset.seed,
        "example": number,  # also names the streams of a preset's own distributions
    }
    try:
        run = parse_run(table, where="", folder=folder)
    except ConfigError as error:  # with the keys of the plan

        def name_key(found: re.Match[str]) -> str:
            if isinstance(section, EpisodeSection):
                return f"episodes.{place}.{found[0]}"
            if found[1] != "0":
                return f"{'companions' if int(found[1]) < len(targets) else 'background'}: {found[2]}"
            if found[2] == "motion":
                return f"classes.{place}.motion"
            return f"{f'classes.{place}.' if found[2] in changes else ''}target.{found[2]}"

        raise ConfigError(re.sub(r"\btargets\.(\d+)\.(\w+)", name_key, str(error))) from None
    # check for forbidden values here, where every distribution is resolved
    if run.auto_prf and "radar.prf_hz" not in plan.dataset.leaks:
        raise ConfigError(AUTO_PRF_REFUSED)
    if run.analysis.method == "liland2018":
        raise ConfigError(ORACLE_REFUSED)
    return run


def _sample_list(values: Any, draw: Draw, key: str) -> list[Any]:
    # without the entries that become {}
    entries = draw(values, key)
    if not isinstance(entries, list):
        raise ConfigError(f"{key}: {shorten(entries)} is not allowed: must be a list of tables")
    return [entry for entry in entries if entry != {}]


def store_radar_files(plan: PlanConfig, folder: Path) -> PlanConfig:
    """Replace the names of a plan's radar files by their values."""

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


def replace_radar_files(
    value: Any, change: Callable[[Any], Any] = lambda named: named, *, in_preset: bool = False
) -> Any:
    """Replace the radar files under ``preset`` or among its choices."""
    if isinstance(value, Mapping):
        if in_preset and set(value) == STORED_KEYS and isinstance(value["values"], Mapping):
            return change(RadarFile(str(value["file"]), value["values"]))
        return {k: replace_radar_files(v, change, in_preset=in_preset or k == "preset") for k, v in value.items()}
    if isinstance(value, list):
        return [replace_radar_files(inner, change, in_preset=in_preset) for inner in value]
    return change(value) if in_preset and isinstance(value, str) and value.endswith(".toml") else value


MAX_READ = 20  # number of motion files that are read for their warnings
OF_A_CLIP = ("kind", "path", "hybrid", "segment", "loop_to_s", "loop_variation")
"""Keys of a motion without effect on what is read of its file."""


def warn_of_recordings(examples: Sequence[ExampleSpec], *, folder: Path) -> None:
    """Read the first motion files of a plan for their warnings."""
    motions = [target.motion for example in examples for target in example.run.scene.targets]
    files = {m["path"]: m for m in reversed(motions) if isinstance(m, Mapping) and m.get("kind") == "file"}
    for path, motion in sorted(files.items())[:MAX_READ]:
        options = {name: value for name, value in motion.items() if name not in OF_A_CLIP}
        with suppress(DoppelgaitError):  # the build leaves the example out, and reports the reason
            read(folder / path, **options)


def warn_of_equal_bodies(examples: Sequence[ExampleSpec]) -> None:
    """Warn of classes whose modelled bodies all have the same parameters."""
    motions: dict[str, list[str]] = {}
    for example in examples:
        for row, target in zip(example.rows, example.run.scene.targets, strict=False):  # background comes last
            if row.source == "model" and target.vary is None and not isinstance(target.motion, Motion):
                body = {**target.motion, "height_m": target.height_m}
                motions.setdefault(row.label, []).append(format_canonical_json(body))
    equal = [label for label, found in motions.items() if len(found) > 1 and len(set(found)) == 1]
    if equal:
        warn_caller(
            f"class {', '.join(equal)}: every example has the same motion parameters, so that training and test data "
            "have the same body; sample them, for example speed_mps = { uniform = [0.8, 1.6] }"
        )


def warn_of_unused_snr(noise: Mapping[str, Any]) -> None:
    """Warn if a plan states an SNR that its noise ignores."""
    kind = noise.get("kind", "thermal")
    if "snr_db" in noise and kind in ("thermal", "none"):
        warn_caller(f"noise.snr_db: is not used with noise.kind = {kind!r}; set noise.kind = 'snr' to use it")
