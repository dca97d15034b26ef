"""Summary of a plan: counts, subjects, size, time."""

from __future__ import annotations

import os
import tempfile
import time
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from doppelgait.core.config import format_canonical_json
from doppelgait.core.files import open_atomically
from doppelgait.dataset.config import SPLITS
from doppelgait.dataset.motions import find_source_entry, find_subject, list_recording_paths
from doppelgait.dataset.plan import Plan, Shard
from doppelgait.dataset.shard import BuildContext, build_shard
from doppelgait.dataset.splits import parse_source

PILOT_EXAMPLES = 8
ROW_BYTES = 5000  # an index row and its copy in the shard's record


@dataclass(frozen=True)
class PlanSummary:
    """Summary of the dataset that a plan will make."""

    name: str
    dataset_id: str
    n_examples: int
    n_shards: int
    counts: list[dict[str, Any]]
    subjects: list[dict[str, Any]]
    files: list[dict[str, Any]]
    n_checked: int
    estimate: dict[str, Any]

    def as_dict(self) -> dict[str, Any]:
        """Return the fields by name, as values for JSON."""
        return asdict(self)


def summarise(plan: Plan, identity: str, *, n_checked: int, pilot: int = PILOT_EXAMPLES) -> PlanSummary:
    """Summarise a plan: examples, subjects, files and duration."""
    sections = list(enumerate(plan.config.sections))
    examples = Counter((entry.class_number, entry.split) for entry in plan.examples)
    counts = [
        {"class": section.label, **{split: examples[number, split] for split in SPLITS}} for number, section in sections
    ]
    different = {(e.class_number, parse_source(e.subjects[0]), e.split, e.subjects[0]) for e in plan.examples}
    sources = Counter(key[:3] for key in different)
    subjects = [
        {"class": section.label, "source": source, **{split: sources[number, source, split] for split in SPLITS}}
        for number, section in sections
        for source in ("model", "recording")
        if any(sources[number, source, split] for split in SPLITS)
    ]
    files = []
    if any(parse_source(subject) != "model" for entry in plan.examples for subject in entry.subjects):
        used = Counter(
            path
            for example in map(plan.example, range(len(plan.examples)))
            for target in example.run.scene.targets[: len(example.rows)]
            for path in list_recording_paths(target.motion)
        )
        for recording, count in sorted(used.items()):
            subject = find_subject({"kind": "file", "path": recording}, "", plan.config.sources)
            entry = find_source_entry(recording, plan.config.sources)
            licence = entry.licence if entry is not None and entry.licence else "unknown"
            files.append({"file": recording, "subject": subject, "examples": count, "licence": licence})
    return PlanSummary(
        name=plan.config.dataset.name,
        dataset_id=identity,
        n_examples=len(plan.examples),
        n_shards=sum(1 for _ in plan.shards()),
        counts=counts,
        subjects=subjects,
        files=files,
        n_checked=n_checked,
        estimate=_estimate_cost(plan, min(pilot, len(plan.examples))) if pilot else {},
    )


def _estimate_cost(plan: Plan, count: int) -> dict[str, Any]:
    """Build ``count`` examples for an estimate of time and size."""
    total = len(plan.examples)
    entries = tuple(plan.examples[place * total // count] for place in range(count))
    with tempfile.TemporaryDirectory() as directory:
        (Path(directory) / "shards").mkdir()
        context = BuildContext(plan.config, str(plan.folder), directory)
        context.make(entries[:1])  # the first one loads the libraries
        began = time.process_time()
        record = build_shard(Shard("pilot", entries[0].split, entries), context)
        seconds = (time.process_time() - began) / count
    size, processors = record["bytes"] / count, os.cpu_count() or 1
    return {
        "pilot_examples": count,
        "pilot_failures": len(record["failures"]),
        "pilot_failure": next((f"{failure['id']}: {failure['reason']}" for failure in record["failures"]), ""),
        "seconds_per_example": seconds,
        "bytes_per_example": size,
        "total_bytes": (size + ROW_BYTES) * total,
        "processors": processors,
        "total_seconds": seconds * total / processors,
    }


def write_specs(plan: Plan, path: Path) -> None:
    """Write every resolved example, one line of JSON each."""
    with open_atomically(path) as partial, partial.open("w", encoding="utf-8") as handle:
        for number in range(len(plan.examples)):
            handle.write(format_canonical_json(plan.example(number)) + "\n")
