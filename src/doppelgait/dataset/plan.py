"""Dataset plan -> fully resolved examples. Nothing is simulated and no motion file is read here."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from doppelgait.core.config import FrozenModel, canonical_json
from doppelgait.core.errors import ConfigError, DatasetError
from doppelgait.core.rng import generator_for
from doppelgait.dataset.config import AUTO_PRF_REFUSED, ORACLE_REFUSED, SPLITS, DatasetSection, PlanConfig
from doppelgait.dataset.describe import shorten
from doppelgait.dataset.motions import check_motion, motion_files, refuse_two_spellings, subject_of
from doppelgait.dataset.sampling import resolve
from doppelgait.pipeline import RunSpec, parse_run
from doppelgait.pipeline.run import TWIN_KEYS

DATA_VERSION = 4
"""What a configuration means in bytes. It is part of every dataset's identity and raised by hand whenever the same
configuration gives other bytes (a draw, a kernel, a stored type), so that a dataset is never finished with examples of
another making. 1: first form. 2: compiled kernels for geometry, noise and signature; splits by subject names.
3: another order of operations in amplitudes, tracks, the short-time transform and the cadence map; features from the
columns of the lossless hop. 4: gait frequency by limbs, harmonics and a decision between step and stride."""


class ExampleSpec(FrozenModel):
    """One planned example: no distribution left.

    Parameters
    ----------
    id : str
    label, subject, split : str
        All examples of one subject are in one split. The subject is ``file/PATH`` for a recording, ``model/ID`` for a
        draw of a model's parameters.
    gate_error_m : float
        Range error of the gate.
    run : RunSpec
    """

    id: str
    label: str
    subject: str
    split: str
    gate_error_m: float
    run: RunSpec


class ShardSpec(FrozenModel):
    """The examples of one shard file."""

    name: str
    split: str
    fields: tuple[str, ...]
    examples: tuple[ExampleSpec, ...]


def plan_examples(plan: PlanConfig, *, folder: Path | None = None) -> list[ExampleSpec]:
    """All examples of a plan, in order.

    Parameters
    ----------
    plan : PlanConfig
    folder : Path, optional
        Folder that relative motion paths start from; the working folder by default.

    Raises
    ------
    ConfigError
        If a drawn value is not allowed or a motion file is missing; the message names the class, the example and the
        key.
    DatasetError
        If a class cannot have a subject in every split that is asked for, or a recording would be in two splits.
    """
    source, total = folder or Path(), plan.dataset.examples_per_class
    examples = []
    for number, section in enumerate(plan.classes):
        ids = [_example_id(section.label, i) for i in range(total)]
        motions = [_draw_motion(plan, number, number * total + i, ids[i], source) for i in range(total)]
        subjects = [subject_of(motion, example_id) for motion, example_id in zip(motions, ids, strict=True)]
        splits = assign_splits(plan.dataset, section.label, list(dict.fromkeys(subjects)))
        for i, (motion, subject) in enumerate(zip(motions, subjects, strict=True)):
            names = {"id": ids[i], "label": section.label, "subject": subject, "split": splits[subject]}
            examples.append(_resolve_example(plan, motion, number * total + i, names, source))
    refuse_two_spellings(motion_files(section.motion for section in plan.classes), source)
    _refuse_two_splits(examples)
    return examples


def _example_id(label: str, number: int) -> str:
    return f"{label.replace(' ', '_')}-{number:06d}"


def _draw_motion(plan: PlanConfig, class_number: int, index: int, example_id: str, folder: Path) -> dict[str, Any]:
    section = plan.classes[class_number]
    try:
        motion = resolve(section.motion, seed=plan.dataset.seed, example=index, key="motion")
        check_motion(motion, folder, key=f"classes.{class_number}.motion")
    except ConfigError as error:
        raise ConfigError(f"class {section.label!r}: example {example_id}: {error}") from None
    return dict(motion)


def _resolve_example(
    plan: PlanConfig, motion: dict[str, Any], index: int, names: dict[str, str], folder: Path
) -> ExampleSpec:
    """Example of a drawn motion; everything else is drawn by a rule that never sees the class."""
    seed = plan.dataset.seed

    def draw(table: Any, key: str) -> Any:
        return resolve(table, seed=seed, example=index, key=key)

    try:
        table = {
            **draw(plan.scene, "scene"),
            "targets": [
                {**draw(plan.target, "target"), "label": names["label"], "motion": motion},
                *_background(plan, draw),
            ],
            "radar": draw(plan.radar, "radar"),
            "noise": draw(plan.noise, "noise"),
            **_conditions(plan, draw),
            "analysis": draw(plan.analysis, "analysis"),
            "seed": seed,
        }
        run = parse_run(table, where=f"example {names['id']}", folder=folder)
        _refuse_leaks(run)
    except ConfigError as error:
        raise ConfigError(f"class {names['label']!r}: {error}") from None
    error_m = float(generator_for(seed, "gate", index).normal(0.0, plan.dataset.gate_error_sd_m))
    return ExampleSpec(**names, gate_error_m=error_m, run=run.model_copy(update={"example": index}))


def _conditions(plan: PlanConfig, draw: Callable[[Any, str], Any]) -> dict[str, Any]:
    """Environment and impairments of one example; those that the plan leaves out stay the preset's."""
    return {key: _drawn_list(plan, key, draw) for key in TWIN_KEYS if getattr(plan, key) is not None}


def _background(plan: PlanConfig, draw: Callable[[Any, str], Any]) -> list[dict[str, Any]]:
    """Background movers of one example as targets of a scene file."""
    movers = _drawn_list(plan, "background", draw)
    for number, mover in enumerate(movers):
        if not isinstance(mover, Mapping) or not isinstance(mover.get("motion"), Mapping):
            raise ConfigError(f"background.{number}: {shorten(mover)} is not allowed: needs motion = {{ kind = ... }}")
        if mover["motion"].get("kind") == "file":
            raise ConfigError(f"background.{number}.motion: a recording is not allowed here, it would have no subject")
    return [{**mover, "background": True} for mover in movers]


def _drawn_list(plan: PlanConfig, key: str, draw: Callable[[Any, str], Any]) -> list[Any]:
    """A list of the plan with every distribution drawn, without the entries drawn as ``{}``."""
    drawn = draw(getattr(plan, key), key)
    if not isinstance(drawn, list):
        raise ConfigError(f"{key}: {shorten(drawn)} is not allowed: must be a list of tables")
    return [entry for entry in drawn if entry != {}]


def _refuse_leaks(run: RunSpec) -> None:
    """What a plan may not hold, in whichever way it was written: here every distribution is drawn."""
    if run.auto_prf:
        raise ConfigError(AUTO_PRF_REFUSED)
    if run.analysis.method == "liland2018":
        raise ConfigError(ORACLE_REFUSED)


def _refuse_two_splits(examples: list[ExampleSpec]) -> None:
    first: dict[str, ExampleSpec] = {}
    for example in examples:
        other = first.setdefault(example.subject, example)
        if other.split != example.split:
            raise DatasetError(
                f"{example.subject}: is in {other.split} for class {other.label!r} and in {example.split} for class "
                f"{example.label!r}; name a recording in one class only"
            )


def assign_splits(dataset: DatasetSection, label: str, subjects: list[str]) -> dict[str, str]:
    """Split of every subject of a class: ranked by a hash of seed and name, then cut at the planned fractions.

    Raises
    ------
    DatasetError
        If a split with a share above 0 would hold no subject of this class.
    """
    ranked = sorted(subjects, key=lambda s: hashlib.sha256(f"{dataset.seed}/{s}".encode()).digest())
    splits: dict[str, str] = {}
    done, share = 0, 0.0
    for split in SPLITS:
        if not dataset.fractions.get(split):
            continue
        share += dataset.fractions[split]
        end = round(share * len(ranked))
        if end <= done:
            raise DatasetError(
                f"class {label!r} has {len(ranked)} subjects, too few for a share of {dataset.fractions[split]:g} in "
                f"{split}; plan more examples, name more recordings or set dataset.fractions"
            )
        splits.update(dict.fromkeys(ranked[done:end], split))
        done = end
    return splits


def plan_shards(plan: PlanConfig, examples: list[ExampleSpec]) -> Iterator[ShardSpec]:
    """Shards of one split each, examples of all classes interleaved so that every shard is mixed."""
    for split in SPLITS:
        chosen = sorted((e for e in examples if e.split == split), key=lambda e: (e.id.rpartition("-")[2], e.label))
        count = -(-len(chosen) // plan.dataset.shard_size)
        for number in range(count):
            part = chosen[number * plan.dataset.shard_size : (number + 1) * plan.dataset.shard_size]
            name = f"{split}-{number:05d}-of-{count:05d}"
            yield ShardSpec(name=name, split=split, fields=plan.dataset.fields, examples=tuple(part))


def dataset_id(plan: PlanConfig, folder: Path) -> str:
    """Identity of the dataset: hash of canonical configuration, source files and data version; 16 hex digits."""
    digest = hashlib.sha256(f"{DATA_VERSION}\n{canonical_json(plan)}\n".encode())
    sources = {"motion file": motion_files(s.motion for s in plan.classes), "preset file": _preset_files(plan.radar)}
    for noun, paths in sources.items():
        for path in paths:
            try:
                digest.update(hashlib.sha256((folder / path).read_bytes()).digest())
            except OSError as error:
                raise ConfigError(f"{noun} {path}: cannot be read: {error}") from None
    return digest.hexdigest()[:16]


def _preset_files(value: Any) -> Iterator[str]:
    """Files of sensor twins that a radar table names, under ``preset`` or among its choices."""
    if isinstance(value, Mapping):
        value = [inner for key, inner in value.items() if key != "name"]
    if isinstance(value, list):
        for inner in value:
            yield from _preset_files(inner)
    elif isinstance(value, str) and value.endswith(".toml"):
        yield value
