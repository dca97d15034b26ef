"""Dataset files compared with records, index and plan."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from doppelgait.core.config import validate
from doppelgait.core.documents import parse_json
from doppelgait.core.errors import DoppelgaitError
from doppelgait.core.files import hash_file
from doppelgait.core.own_hdf5 import get_own_member, open_hdf5
from doppelgait.dataset.config import SPLITS, PlanConfig, list_some
from doppelgait.dataset.finish import LOG, SUMS, compute_dataset_id, count_shards, format_checksums
from doppelgait.dataset.lock import list_running_builds
from doppelgait.dataset.shard_files import INDEX_NAMES, ShardFiles, describe_fields, hash_contents
from doppelgait.dataset.verify.contents import Check, Contents, convert_to_plain


@dataclass(frozen=True)
class ShardFindings:
    """Findings about the shards."""

    whole: tuple[str, ...]
    missing: tuple[str, ...]
    damaged: dict[str, str]
    unlisted: dict[str, str]
    failed: dict[str, str]
    hashes: dict[str, str]
    contents: list[str]


def look_at_shards(
    directory: Path, identity: str, names: Sequence[str], index: pd.DataFrame | None, tick: Callable[[], None]
) -> ShardFindings:
    """Compare shards with their records, and these with the index."""
    findings = ShardFindings((), (), {}, {}, {}, {}, [])
    files = ShardFiles(directory / "shards", identity)
    places = {} if index is None else index.groupby("shard", sort=False).indices
    whole, missing = [], []
    for name in names:
        tick()
        path = directory / "shards" / f"{name}.h5"
        if not path.exists() and not path.with_suffix(".json").exists():
            missing.append(name)
            if len(places.get(name, ())):
                findings.unlisted[name] = "the index has rows of it, the shard is not there"
            continue
        record, reason = _record(path, identity, files, findings)
        if record is None:
            findings.damaged[name] = reason
            continue
        whole.append(name)
        if index is not None:
            difference = _describe_difference(index.iloc[places.get(name, [])], record)
            if difference:
                findings.unlisted[name] = difference
    if index is not None:
        for name in sorted(set(map(str, places)) - set(names)):
            findings.unlisted[name] = "the index has rows of it, the plan has no such shard"
        rows = np.concatenate([places[name] for name in names if name in places] or [np.empty(0, dtype=int)])
        if not findings.unlisted and not np.array_equal(rows, np.arange(rows.size)):
            findings.unlisted["index.parquet"] = "its rows are in another order than the shards"
    return replace(findings, whole=tuple(whole), missing=tuple(missing))


def _record(path: Path, identity: str, files: ShardFiles, findings: ShardFindings) -> tuple[dict[str, Any] | None, str]:
    """Return an intact shard's record, or its fault."""
    try:
        findings.hashes[path.stem] = hash_file(path)
        record = parse_json(path.with_suffix(".json").read_text())
        if record["dataset"] != identity:
            return None, f"is of dataset {record['dataset']}"
        if findings.hashes[path.stem] != record["sha256"]:
            return None, "the file is not the one that its record describes (another hash)"
        rows = record["rows"]
        with open_hdf5(path, members=False) as file:
            ids = [text.decode() for text in get_own_member(file, "id")[:]]
            split = str(file.attrs["split"])
        if ids != [row["id"] for row in rows]:
            return None, "holds other ids than its record"
        if [row["row"] for row in rows] != list(range(len(ids))) or {row["shard"] for row in rows} - {path.stem}:
            return None, "its record counts the rows differently"
        if {row["split"] for row in rows} - {split} or not path.stem.startswith(f"{split}-"):
            return None, f"is of split {split} and has rows of another"
        contents = hash_contents(rows, (files.read_row(path.stem, number) for number in range(len(rows))))
        files.close()
        if contents != record["contents_sha256"]:
            return None, "specification, whole numbers or arrays are not those that its record was made of"
        failures = {failure["id"]: failure["reason"] for failure in record["failures"]}
    except FileNotFoundError as error:
        return None, f"{Path(error.filename).name} is missing"
    except Exception as error:  # HDF5 and JSON raise various errors for damaged files
        return None, f"cannot be read: {error}"
    findings.contents.append(contents)
    findings.failed.update(failures)
    return record, ""


def _describe_difference(part: pd.DataFrame, record: Mapping[str, Any]) -> str:
    """Describe the first difference of index rows and a record, or ""."""
    rows = record["rows"]
    ids = [row["id"] for row in rows]
    if part["id"].tolist() != ids:
        return (
            f"the index has rows {list_some(part['id'].tolist()) or 'none'} of it, the shard {list_some(ids) or 'none'}"
        )
    if len(part) and set(part["shard_sha256"]) != {record["sha256"]}:
        return "the index has another hash of it"
    for column in dict.fromkeys(name for row in rows for name in row):
        expected = [row.get(column) for row in rows]
        name = INDEX_NAMES.get(column, column)
        found = convert_to_plain(part[name]) if name in part.columns else [None] * len(rows)
        if found != expected:
            place = next(n for n, (a, b) in enumerate(zip(found, expected, strict=True)) if a != b)
            return f"{column} of {ids[place]} is {found[place]} in the index, {expected[place]} in the shard's record"
    return ""


def check_shards(findings: ShardFindings, *, complete: bool) -> Check:
    """Check the shards against their records."""
    total = len(findings.whole) + len(findings.missing) + len(findings.damaged)
    numbers = {
        "shards": total,
        "whole": len(findings.whole),
        "missing": list(findings.missing),
        "damaged": findings.damaged,
    }
    parts = [f"{len(findings.whole)} of {total} shards are there and whole"]
    if findings.damaged:
        parts.append("damaged: " + list_some([f"{name} ({reason})" for name, reason in findings.damaged.items()]))
    if findings.missing:
        words = "missing, though the dataset is marked as complete" if complete else "not built yet"
        parts.append(f"{words}: {list_some(findings.missing)}")
    wrong = bool(findings.damaged) or (complete and bool(findings.missing))
    return Check("shards", "failed" if wrong else "passed", "; ".join(parts), numbers)


def check_index(findings: ShardFindings, index: pd.DataFrame | None, reason: str) -> Check:
    """Check the index against the records, value by value."""
    if index is None:
        status: Any = "failed" if reason else "skipped"
        return Check("index", status, reason or "no index.parquet yet; the rows are those of the shards' records")
    numbers = {"rows": len(index), "columns": len(index.columns), "different": findings.unlisted}
    if findings.unlisted:
        listed = list_some([f"{name}: {difference}" for name, difference in findings.unlisted.items()])
        return Check("index", "failed", listed, numbers)
    return Check("index", "passed", f"{len(index)} rows, each value as in the shards' records", numbers)


def check_split_lists(directory: Path, index: pd.DataFrame | None) -> Check:
    """Check ``splits/*.txt`` against the index."""
    if index is None:
        return Check("splits", "skipped", "no index.parquet yet, so no lists")
    wrong, counts = [], {}
    for split in SPLITS:
        path = directory / "splits" / f"{split}.txt"
        ids = index["id"][index["split"] == split].tolist() if len(index) else []
        counts[split] = len(ids)
        try:
            found = path.read_text().splitlines()
        except (OSError, UnicodeDecodeError):
            wrong.append(f"splits/{split}.txt cannot be read")
            continue
        if found != ids:
            other = sorted(set(found) ^ set(ids))
            wrong.append(f"splits/{split}.txt differs from the index: {list_some(other) if other else 'another order'}")
    known = set(index["split"]) - set(SPLITS) if len(index) else set()
    wrong += [f"the index has a split {name!r}" for name in sorted(known)]
    listed = ", ".join(f"{split} {count}" for split, count in counts.items())
    return Check(
        "splits", "failed" if wrong else "passed", "; ".join(wrong) or f"lists as in the index: {listed}", counts
    )


def check_files(directory: Path, names: Sequence[str], shards: Mapping[str, str], *, complete: bool) -> Check:
    """Check the hash of every file, and their list."""
    path = directory / SUMS
    if not path.exists():
        words = f"{SUMS} is missing" + (", though the dataset says it is complete; build it again" if complete else "")
        return Check("files", "failed" if complete else "skipped", words)
    listed = [line.partition("  ") for line in path.read_bytes().decode(errors="replace").splitlines()]
    stated = {name: sha256 for sha256, _, name in listed}
    single = (LOG, "README.md", "dataset.json", "index.parquet", *(f"splits/{split}.txt" for split in SPLITS))
    known = {f"shards/{name}.h5": sha256 for name, sha256 in shards.items()}
    wrong = []
    for name in dict.fromkeys((*single, *(f"shards/{name}.{kind}" for name in names for kind in ("h5", "json")))):
        try:
            found = known.get(name) or hash_file(directory / name)
        except OSError:
            if name != LOG or name in stated:
                wrong.append(f"{name} cannot be read")
        else:
            known[name] = found
            if name not in stated:
                wrong.append(f"{SUMS} has no {name}")
            elif stated[name] != found:
                wrong.append(f"{name} is not the file that the dataset was finished with")
    if not wrong and path.read_bytes() != format_checksums(known).encode():
        wrong.append(f"{SUMS} is damaged")
    numbers = {"files": len(known), "different": len(wrong)}
    if wrong:
        return Check("files", "failed", f"{list_some(wrong)}; build the dataset again", numbers)
    ours = {*known, SUMS}
    there = sorted(path.relative_to(directory).as_posix() for path in directory.rglob("*") if not path.is_dir())
    foreign = [name for name in there if name not in ours and not name.endswith((".partial", ".lock"))]
    if foreign:
        return Check("files", "warning", f"no part of the dataset: {list_some(foreign)}", numbers)
    return Check("files", "passed", f"{len(known)} files, each with the hash it was finished with", numbers)


def check_leftovers(directory: Path) -> Check:
    """Check for half-written files."""
    running = [str(holder) for holder in list_running_builds(directory)]
    found = sorted(str(path.relative_to(directory)) for path in directory.rglob("*.partial"))
    numbers = {"partial": found, "running": running}
    if running:
        return Check("leftovers", "skipped", f"a build is at work here: {list_some(running)}", numbers)
    if found:
        return Check("leftovers", "failed", f"half-written files: {list_some(found)}; run dataset status", numbers)
    return Check("leftovers", "passed", "no half-written file", numbers)


MOST_LOST = 0.05
"""Maximum share of failed examples of a class in a split. Failures that depend on the motion would bias the class."""


def check_identity(contents: Contents) -> Check:
    """Hash configuration and source files again to check the ``id``."""
    if contents.plan is None or contents.unlike:
        status = contents.no_plan_status if contents.plan is None else "skipped"
        return Check("identity", status, contents.no_plan or f"cannot be hashed again: {contents.unlike}")
    stated = contents.description["id"]
    try:
        config = validate(PlanConfig, contents.description["config"], where="dataset.json")
        found = compute_dataset_id(config, contents.plan.folder)
    except DoppelgaitError as error:
        return Check("identity", "skipped", f"cannot be hashed again: {error}")
    wrong = [] if found == stated else [f"id is {stated}, configuration and source files give {found}"]
    shards = count_shards(shard.name for shard in contents.plan.shards())
    for name, value in {"shards": shards, "fields": describe_fields(config.dataset.fields)}.items():
        if contents.description[name] != value:
            wrong.append(f"{name} is {contents.description[name]}, the configuration gives {value}")
    numbers = {"stated": stated, "found": found}
    summary = f"{stated}, as configuration and source files give it"
    return Check("identity", "failed" if wrong else "passed", "; ".join(wrong) or summary, numbers)


def check_rows(contents: Contents) -> Check:
    """Check label, split, group and subjects of every row."""
    if contents.plan is None:
        return Check("rows", contents.no_plan_status, contents.no_plan)
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
    summary = list_some(wrong) or f"{len(contents.index)} rows with label, split, group and subject as planned"
    return Check("rows", "failed" if wrong else "passed", summary, numbers)


def check_balance(contents: Contents, *, missing_shards: int) -> Check:
    """Check the examples of every class in every split."""
    if contents.plan is None:
        found: Any = contents.index.groupby(["label", "split"]).size() if len(contents.index) else {}
        there = {f"{label}/{split}": int(count) for (label, split), count in dict(found).items()}
        words = f"{contents.no_plan}; found " + ", ".join(f"{name} {count}" for name, count in there.items())
        return Check("class balance", contents.no_plan_status, words, {"counts": there})
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
        return Check("class balance", "failed", f"neither present nor listed as failed: {list_some(silent)}", numbers)
    listed = "; ".join(f"{label} " + " ".join(f"{n}" for n in row.values()) for label, row in counts.items())
    if not lost:
        return Check("class balance", "passed", f"as planned in train, validation, test: {listed}", numbers)
    bent = [f"{label} in {split}" for (label, split), n in gone.items() if n > MOST_LOST * planned[label, split]]
    reasons = list_some([f"{name}: {reason}" for name, reason in list(contents.failed.items())[:2]])
    words = (
        f"{len(lost)} examples failed ({reasons}), of {list_some(bent)} more than {100 * MOST_LOST:.0f} %"
        if bent
        else (f"{len(lost)} examples failed ({reasons})")
    )
    return Check("class balance", "failed" if bent else "warning", words, numbers)
