"""Dataset plan -> fully resolved examples. Nothing is simulated here; a pure function of the configuration."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from doppelgait.core.config import FrozenModel, canonical_json
from doppelgait.core.errors import ConfigError, DatasetError
from doppelgait.core.rng import generator_for
from doppelgait.dataset.config import SPLITS, DatasetSection, PlanConfig
from doppelgait.dataset.sampling import resolve
from doppelgait.pipeline import RunSpec, parse_run

DATA_VERSION = 1
"""Raised by hand whenever the same configuration gives other bytes."""


class ExampleSpec(FrozenModel):
    """One planned example: no distribution left.

    Parameters
    ----------
    id : str
    label, subject, split : str
        ``subject`` is the person or animal; all examples of one subject are in one split.
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


def plan_examples(plan: PlanConfig) -> list[ExampleSpec]:
    """All examples of a plan, in order.

    Raises
    ------
    ConfigError
        If a drawn value is not allowed; the message names the example and the key.
    DatasetError
        If a class cannot have a subject in every split that is asked for.
    """
    total = plan.dataset.examples_per_class
    examples = []
    for number, section in enumerate(plan.classes):
        splits = assign_splits(plan.dataset, section.label, [_example_id(section.label, i) for i in range(total)])
        for i in range(total):
            example_id = _example_id(section.label, i)
            examples.append(_resolve_example(plan, number, number * total + i, example_id, splits[example_id]))
    return examples


def _example_id(label: str, number: int) -> str:
    return f"{label.replace(' ', '_')}-{number:06d}"


def _resolve_example(plan: PlanConfig, class_number: int, index: int, example_id: str, split: str) -> ExampleSpec:
    seed = plan.dataset.seed

    def draw(table: Any, key: str) -> Any:
        return resolve(table, seed=seed, example=index, key=key)

    section = plan.classes[class_number]
    target = {**draw(plan.target, "target"), "label": section.label, "motion": draw(section.motion, "motion")}
    table = {
        **draw(plan.scene, "scene"),
        "targets": [target],
        "radar": draw(plan.radar, "radar"),
        "noise": draw(plan.noise, "noise"),
        "analysis": draw(plan.analysis, "analysis"),
        "seed": seed,
    }
    try:
        run = parse_run(table, where=f"example {example_id}")
    except ConfigError as error:
        raise ConfigError(f"class {section.label!r}: {error}") from None
    error_m = float(generator_for(seed, "gate", index).normal(0.0, plan.dataset.gate_error_sd_m))
    return ExampleSpec(
        id=example_id,
        label=section.label,
        subject=f"model/{example_id}",
        split=split,
        gate_error_m=error_m,
        run=run.model_copy(update={"example": index}),
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
                f"{split}; plan more examples or set dataset.fractions"
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
    """Identity of the dataset: hash of canonical configuration, motion files and data version; 16 hex digits."""
    digest = hashlib.sha256(f"{DATA_VERSION}\n{canonical_json(plan)}\n".encode())
    for path in motion_files(plan):
        try:
            digest.update(hashlib.sha256((folder / path).read_bytes()).digest())
        except OSError as error:
            raise ConfigError(f"motion file {path}: cannot be read: {error}") from None
    return digest.hexdigest()[:16]


def motion_files(plan: PlanConfig) -> list[str]:
    """Paths of all motion files that the plan names, sorted."""
    found: set[str] = set()

    def walk(value: Any) -> None:
        if isinstance(value, dict):
            if value.get("kind") == "file":
                path = value.get("path")
                found.update(path["choice"] if isinstance(path, dict) and "choice" in path else [str(path)])
            for inner in value.values():
                walk(inner)
        elif isinstance(value, list):
            for inner in value:
                walk(inner)

    for section in plan.classes:
        walk(section.motion)
    return sorted(found)
