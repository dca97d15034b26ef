"""A dataset against its plan: identity, who is in which row, how many of each class in each split."""

from __future__ import annotations

from collections import Counter
from typing import Any

from doppelgait.core.config import validate
from doppelgait.core.errors import DoppelgaitError
from doppelgait.dataset.config import SPLITS, PlanConfig
from doppelgait.dataset.fields import facts_of
from doppelgait.dataset.finish import count_shards
from doppelgait.dataset.identity import dataset_id
from doppelgait.dataset.verify.contents import Contents
from doppelgait.dataset.verify.report import Check, some

MOST_LOST = 0.05
"""Share of a class in a split that may be missing as failed: a failure that depends on the motion bends the class."""


def check_identity(contents: Contents) -> Check:
    """``id`` of ``dataset.json`` against its configuration and the source files, hashed again."""
    if contents.plan is None or contents.unlike:
        return Check("identity", "skipped", contents.no_plan or f"cannot be hashed again: {contents.unlike}")
    stated = contents.description["id"]
    try:
        config = validate(PlanConfig, contents.description["config"], where="dataset.json")
        found = dataset_id(config, contents.plan.folder)
    except DoppelgaitError as error:
        return Check("identity", "skipped", f"cannot be hashed again: {error}")
    wrong = [] if found == stated else [f"id is {stated}, configuration and source files give {found}"]
    shards = count_shards(shard.name for shard in contents.plan.shards())
    for name, value in {"shards": shards, "fields": facts_of(config.dataset.fields)}.items():
        if contents.description[name] != value:
            wrong.append(f"{name} is {contents.description[name]}, the configuration gives {value}")
    numbers = {"stated": stated, "found": found}
    summary = f"{stated}, as configuration and source files give it"
    return Check("identity", "failed" if wrong else "passed", "; ".join(wrong) or summary, numbers)


def check_rows(contents: Contents) -> Check:
    """Label, split, group and subjects of every row against the plan."""
    if contents.plan is None:
        return Check("rows", "skipped", contents.no_plan)
    planned = {}
    for entry in contents.plan.examples:
        label = contents.plan.config.classes[entry.class_number].label
        planned[entry.id] = (label, entry.split, entry.group, entry.subjects[0])
    wrong = []
    columns = ("id", "scene_id", "label", "split", "group", "subject")
    for name, scene, *found in zip(*(contents.index[column].tolist() for column in columns), strict=True):
        expected = planned.get(scene)
        if expected is None:
            wrong.append(f"{name}: is not in the plan")
        elif tuple(found) != expected and (name == scene or tuple(found[1:3]) != expected[1:3]):
            wrong.append(f"{name}: is {'/'.join(found)}, planned {'/'.join(expected)}")
    numbers = {"rows": len(contents.index), "different": len(wrong)}
    summary = some(wrong) or f"{len(contents.index)} rows with label, split, group and subject as planned"
    return Check("rows", "failed" if wrong else "passed", summary, numbers)


def check_balance(contents: Contents, *, missing_shards: int) -> Check:
    """Examples of every class in every split against the plan; those that failed are named."""
    if contents.plan is None:
        return _without_plan(contents)
    if missing_shards:
        words = f"{missing_shards} shards are not here; {len(set(contents.index['scene_id']))} examples are"
        return Check("class balance", "skipped", words)
    labels = [section.label for section in contents.plan.config.classes]
    present = set(contents.index["scene_id"])
    planned = Counter((labels[e.class_number], e.split) for e in contents.plan.examples)
    lost = [(labels[e.class_number], e) for e in contents.plan.examples if e.id not in present]
    gone = Counter((label, entry.split) for label, entry in lost)
    silent = [entry.id for _, entry in lost if entry.id not in contents.failed]
    counts = {label: {split: planned[label, split] - gone[label, split] for split in SPLITS} for label in labels}
    numbers: dict[str, Any] = {"counts": counts, "failed": dict(contents.failed), "absent": silent}
    if silent:
        return Check("class balance", "failed", f"neither there nor named as failed: {some(silent)}", numbers)
    listed = "; ".join(f"{label} " + " ".join(f"{n}" for n in row.values()) for label, row in counts.items())
    if not lost:
        return Check("class balance", "passed", f"as planned in train, validation, test: {listed}", numbers)
    bent = [f"{label} in {split}" for (label, split), n in gone.items() if n > MOST_LOST * planned[label, split]]
    reasons = some([f"{name}: {reason}" for name, reason in list(contents.failed.items())[:2]])
    words = f"{len(lost)} examples failed ({reasons}), of {some(bent)} more than {100 * MOST_LOST:.0f} %" if bent else (
        f"{len(lost)} examples failed ({reasons})"
    )  # fmt: skip
    return Check("class balance", "failed" if bent else "warning", words, numbers)


def _without_plan(contents: Contents) -> Check:
    counts: Any = contents.index.groupby(["label", "split"]).size() if len(contents.index) else {}
    listed = {f"{label}/{split}": int(count) for (label, split), count in dict(counts).items()}
    words = f"{contents.no_plan}; found " + ", ".join(f"{name} {count}" for name, count in listed.items())
    return Check("class balance", "skipped", words, {"counts": listed})
