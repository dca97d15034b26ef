"""Dataset files compared with records, index and plan, and rows with those of other splits."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from doppelgait.core.documents import read_document
from doppelgait.core.errors import DoppelgaitError
from doppelgait.core.files import hash_file
from doppelgait.core.own_hdf5 import get_own_member, open_hdf5
from doppelgait.dataset.config import SPLITS, list_some
from doppelgait.dataset.finish import (
    LOG,
    LOG_SUM,
    SINGLE_FILES,
    SUMS,
    compute_dataset_id,
    count_shards,
    format_checksums,
    list_shard_names,
    read_record,
)
from doppelgait.dataset.lock import list_running_builds
from doppelgait.dataset.open import read_index
from doppelgait.dataset.plan import list_names
from doppelgait.dataset.shard_files import INDEX_NAMES, ShardFiles, decode, describe_fields, hash_contents
from doppelgait.dataset.verify.contents import Check, Contents, Files, judge
from doppelgait.features import FEATURE_UNITS


def read_files(directory: Path, description: Mapping[str, Any], tick: Callable[[], None]) -> Files:
    """Read index and shards, and compare them."""
    files, names = Files(), list_shard_names(description["shards"])
    path, identity = directory / "index.parquet", str(description["id"])
    if path.exists():
        try:
            files.index = read_index(path, identity, description["classes"])
        except Exception as error:  # Arrow raises various errors for damaged files
            files.fault = f"index.parquet cannot be read: {' '.join(str(error).split())}"
    elif description.get("complete"):
        files.fault = "index.parquet is missing, though the dataset is marked as complete"
    places: dict[Any, Any] = {} if files.index is None else files.index.groupby("shard", sort=False).indices
    reader = ShardFiles(directory / "shards", identity)
    for name in names:
        tick()
        path = directory / "shards" / f"{name}.h5"
        rows = places.get(name, np.empty(0, dtype=int))
        if not path.exists() and not path.with_suffix(".json").exists():
            files.missing.append(name)
            if rows.size:
                files.different[name] = "the index has rows of it, the shard is not there"
            continue
        try:
            files.hashes[name] = hash_file(path)
            record = read_record(path.with_suffix(".json"))
            fault = _find_fault(path, record, files.hashes[name], reader)
            failed = {failure["id"]: failure["reason"] for failure in record["failures"]}
        except FileNotFoundError as error:
            fault = f"{Path(error.filename).name} is missing"
        except Exception as error:  # HDF5 and JSON raise various errors for damaged files
            fault = f"cannot be read: {error}"
        if fault:
            files.damaged[name] = fault
            continue
        files.whole.append(name)
        files.failed |= failed
        files.contents.append(record["contents_sha256"])
        if files.index is not None and (difference := _describe_difference(files.index.iloc[rows], record)):
            files.different[name] = difference
    for name in sorted(set(map(str, places)) - set(names)):
        files.different[name] = "the index has rows of it, the plan has no such shard"
    order = np.concatenate([places[name] for name in names if name in places] or [np.empty(0, dtype=int)])
    if not files.different and not np.array_equal(order, np.arange(order.size)):
        files.different["index.parquet"] = "its rows are in another order than the shards"
    return files


def _find_fault(path: Path, record: Mapping[str, Any], sha256: str, reader: ShardFiles) -> str:
    """Return the first fault of a shard or its record, or ""."""
    if record["dataset"] != reader.identity:
        return f"is of dataset {record['dataset']}"
    if sha256 != record["sha256"]:
        return "the file is not the one that its record describes (another hash)"
    rows = record["rows"]
    with open_hdf5(path, members=False) as file:
        ids = [text.decode() for text in get_own_member(file, "id")[:]]
        split = str(file.attrs["split"])
    if ids != [row["id"] for row in rows]:
        return "holds other ids than its record"
    if [row["row"] for row in rows] != list(range(len(ids))) or {row["shard"] for row in rows} - {path.stem}:
        return "its record counts the rows differently"
    if {row["split"] for row in rows} - {split} or not path.stem.startswith(f"{split}-"):
        return f"is of split {split} and has rows of another"
    contents = hash_contents(rows, (reader.read_row(path.stem, number) for number in range(len(rows))))
    reader.close()
    if contents != record["contents_sha256"]:
        return "specification, whole numbers or arrays are not those that its record was made of"
    return ""


def _describe_difference(part: pd.DataFrame, record: Mapping[str, Any]) -> str:
    # the first difference of index rows and a record, or ""
    rows = record["rows"]
    ids = [row["id"] for row in rows]
    listed = part["id"].tolist()
    if listed != ids:
        return f"the index has rows {list_some(listed) or 'none'} of it, the shard {list_some(ids) or 'none'}"
    if len(part) and set(part["shard_sha256"]) != {record["sha256"]}:
        return "the index has another hash of it"
    for column in dict.fromkeys(name for row in rows for name in row):
        stored = part.get(INDEX_NAMES.get(column, column), pd.Series([None] * len(rows)))
        found = [None if value != value else value for value in stored.tolist()]
        expected = [row.get(column) for row in rows]
        if found != expected:
            name, *values = next(cells for cells in zip(ids, found, expected, strict=True) if cells[1] != cells[2])
            return f"{column} of {name} is {values[0]} in the index, {values[1]} in the shard's record"
    return ""


def check_files(contents: Contents) -> Check:
    """Check the hash of every file, and their list."""
    directory = contents.directory
    try:
        content = read_document(directory / SUMS)
        if f"  {LOG}\n".encode() not in content:  # up to version 0.2 with the log
            content += read_document(directory / LOG_SUM)
    except (OSError, ValueError) as error:
        is_finished = contents.complete or (directory / SUMS).exists()
        words = f"{SUMS} or {LOG_SUM} cannot be read: {error}; build the dataset again"
        return Check("failed" if is_finished else "skipped", words)
    lines = content.decode(errors="replace").splitlines(keepends=True)
    stated = {name.rstrip(): sha256 for sha256, _, name in (line.partition("  ") for line in lines)}
    known = {f"shards/{name}.h5": sha256 for name, sha256 in contents.files.hashes.items()}
    shards = (f"shards/{name}.{kind}" for name in contents.names for kind in ("h5", "json"))
    wrong = []
    for name in (LOG, *SINGLE_FILES, *shards):
        try:
            known[name] = known.get(name) or hash_file(directory / name)
        except OSError:
            wrong.append(f"{name} cannot be read")
        else:
            if name not in stated:
                wrong.append(f"{SUMS} has no {name}")
            elif stated[name] != known[name]:
                wrong.append(f"{name} is not the file that the dataset was finished with")
    if not wrong and sorted(lines) != sorted(format_checksums(known).splitlines(keepends=True)):
        wrong.append(f"{SUMS} is damaged")
    numbers = {"files": len(known), "different": len(wrong)}
    if wrong:
        return Check("failed", f"{list_some(wrong)}; build the dataset again", numbers)
    there = {path.relative_to(directory).as_posix() for path in directory.rglob("*") if not path.is_dir()}
    foreign = [name for name in sorted(there - {*known, SUMS, LOG_SUM}) if not name.endswith((".partial", ".lock"))]
    if foreign:
        return Check("warning", f"no part of the dataset: {list_some(foreign)}", numbers)
    return Check("passed", f"{len(known)} files, each with the hash it was finished with", numbers)


def check_shards(contents: Contents) -> Check:
    """Check the shards against their records."""
    files, names = contents.files, contents.names
    numbers = {"shards": len(names), "whole": len(files.whole), "missing": files.missing, "damaged": files.damaged}
    parts = [f"{len(files.whole)} of {len(names)} shards are there and whole"]
    if files.damaged:
        parts.append("damaged: " + list_some([f"{name} ({reason})" for name, reason in files.damaged.items()]))
    if files.missing:
        words = "missing, though the dataset is marked as complete" if contents.complete else "not built yet"
        parts.append(f"{words}: {list_some(files.missing)}")
    wrong = files.damaged or (contents.complete and files.missing)
    return Check("failed" if wrong else "passed", "; ".join(parts), numbers)


def check_contents(contents: Contents) -> Check:
    """Check the hash of all contents against that of the finished dataset."""
    files = contents.files
    if files.missing or files.damaged or not contents.complete:
        return Check("failed" if contents.complete else "skipped", "not every shard is there, or not complete")
    digest = hashlib.sha256("".join(files.contents).encode()).hexdigest()
    is_same = digest == contents.description.get("contents_sha256")
    words = f"{digest[:16]}: specification, whole numbers and arrays as when the dataset was finished"
    return judge("" if is_same else "not what the dataset was finished with: build it again", words)


def check_index(contents: Contents) -> Check:
    """Check the index against the records, value by value."""
    files = contents.files
    if files.index is None:
        words = "no index.parquet yet; the rows are those of the shards' records"
        return Check("failed" if files.fault else "skipped", files.fault or words)
    numbers = {"rows": len(files.index), "columns": len(files.index.columns), "different": files.different}
    fault = list_some([f"{name}: {difference}" for name, difference in files.different.items()])
    return judge(fault, f"{len(files.index)} rows, each value as in the shards' records", numbers)


def check_split_lists(contents: Contents) -> Check:
    """Check ``splits/*.txt`` against the index."""
    index = contents.files.index
    if index is None:
        return Check("skipped", "no index.parquet yet, so no lists")
    splits = {split: index["id"][index["split"] == split].tolist() if len(index) else [] for split in SPLITS}
    wrong = []
    for split, ids in splits.items():
        try:
            listed = read_document(contents.directory / "splits" / f"{split}.txt").decode().splitlines()
        except (OSError, UnicodeDecodeError):
            wrong.append(f"splits/{split}.txt cannot be read")
            continue
        if listed != ids:
            other = list_some(sorted(set(listed) ^ set(ids))) or "another order"
            wrong.append(f"splits/{split}.txt differs from the index: {other}")
    counts: dict[str, Any] = {split: len(ids) for split, ids in splits.items()}
    words = ", ".join(f"{split} {count}" for split, count in counts.items())
    return judge("; ".join(wrong), f"lists as in the index: {words}", counts)


def check_leftovers(contents: Contents) -> Check:
    """Check for half-written files."""
    directory = contents.directory
    running = [str(holder) for holder in list_running_builds(directory)]
    partial = sorted(str(path.relative_to(directory)) for path in directory.rglob("*.partial"))
    numbers = {"partial": partial, "running": running}
    if running:
        return Check("skipped", f"a build is at work here: {list_some(running)}", numbers)
    fault = f"half-written files: {list_some(partial)}; run dataset status" if partial else ""
    return judge(fault, "no half-written file", numbers)


MAX_LOST = 0.05
"""Maximum share of failed examples of a class in a split. Failures that depend on the motion would bias the class."""


def check_identity(contents: Contents) -> Check:
    """Hash configuration and source files again to check the ``id``."""
    plan, stated = contents.require_plan(), contents.description
    try:
        identity = compute_dataset_id(plan.config, plan.folder)
    except DoppelgaitError as error:
        return Check("skipped", f"cannot be hashed again: {error}")
    wrong = []
    if identity != stated["id"]:
        wrong.append(f"id is {stated['id']}, configuration and source files give {identity}")
    shards = count_shards(shard.name for shard in plan.shards())
    for name, value in {"shards": shards, "fields": describe_fields(plan.config.dataset.fields)}.items():
        if stated[name] != value:
            wrong.append(f"{name} is {stated[name]}, the configuration gives {value}")
    numbers = {"stated": stated["id"], "found": identity}
    return judge("; ".join(wrong), f"{identity}, as configuration and source files give it", numbers)


def check_rows(contents: Contents) -> Check:
    """Check label, split, group and subjects of every row."""
    plan = contents.require_plan()
    labels = [section.label for section in plan.config.sections]
    planned = {e.id: (labels[e.class_number], e.split, e.group, e.subjects[0]) for e in plan.examples}
    wrong = []
    columns = ("id", "scene_id", "label", "split", "group", "subject")
    for name, scene, *found in zip(*(contents.index[column].tolist() for column in columns), strict=True):
        expected = planned.get(scene)
        if expected is None:
            wrong.append(f"{name}: is not in the plan")
        elif tuple(found) != expected and (
            (name == scene and not plan.config.episodes) or tuple(found[1:3]) != expected[1:3]
        ):
            wrong.append(f"{name}: is {'/'.join(found)}, planned {'/'.join(expected)}")
    numbers = {"rows": len(contents.index), "different": len(wrong)}
    words = f"{len(contents.index)} rows with label, split, group and subject as planned"
    return judge(list_some(wrong), words, numbers)


def check_balance(contents: Contents) -> Check:
    """Check the examples of every class in every split."""
    index, failed = contents.index, contents.files.failed
    if contents.plan is None:
        found: dict[Any, int] = index.groupby(["label", "split"]).size().to_dict()
        there = {f"{label}/{split}": count for (label, split), count in found.items()}
        words = f"{contents.no_plan}; found " + ", ".join(f"{name} {count}" for name, count in there.items())
        return Check("not applicable" if contents.measured else "skipped", words, {"counts": there})
    plan, present = contents.plan, set(index["scene_id"])
    if absent := len(contents.files.missing) + len(contents.files.damaged):
        return Check("skipped", f"{absent} shards are not here; {len(present)} examples are")
    labels = [section.label for section in plan.config.sections]
    planned = Counter((labels[e.class_number], e.split) for e in plan.examples)
    lost = [entry for entry in plan.examples if entry.id not in present]
    gone = Counter((labels[e.class_number], e.split) for e in lost)
    silent = [entry.id for entry in lost if entry.id not in failed]
    counts = {label: {split: planned[label, split] - gone[label, split] for split in SPLITS} for label in labels}
    numbers: dict[str, Any] = {"counts": counts, "failed": failed, "absent": silent}
    if silent:
        return Check("failed", f"neither present nor listed as failed: {list_some(silent)}", numbers)
    if not lost:
        listed = "; ".join(f"{label} {' '.join(map(str, row.values()))}" for label, row in counts.items())
        return Check("passed", f"as planned in train, validation, test: {listed}", numbers)
    reasons = list_some([f"{name}: {reason}" for name, reason in list(failed.items())[:2]])
    words = f"{len(lost)} examples failed ({reasons})"
    bent = [f"{label} in {split}" for (label, split), n in gone.items() if n > MAX_LOST * planned[label, split]]
    if bent:
        return Check("failed", f"{words}, of {list_some(bent)} more than {100 * MAX_LOST:.0f} %", numbers)
    return Check("warning", words, numbers)


Float32Array = npt.NDArray[np.float32]

SHAPE = (24, 32)
"""Numbers of cells in time and Doppler of averaged signatures for a first comparison."""
ALIKE = 0.999
CANDIDATE = 0.98
"""Correlation of the small pictures above which two signatures are compared in full."""
MAX_CANDIDATES = 2000
MAX_COMPARED = 60_000
"""Maximum number of rows that are compared for similarity; a larger dataset is sampled at random.
All rows are compared for identity."""

KINDS = {"group": "groups", "subject": "subjects", "recording": "recordings", "scene_id": "scenes"}


def check_groups(contents: Contents) -> Check:
    """Check that no subject or other group crosses splits."""
    # of a blended motion every subject and every recording counts
    index = contents.index
    torn: dict[str, list[str]] = {}
    for key in KINDS:
        names = pd.DataFrame({"name": list(list_names(index, key)), "split": index["split"]}).explode("name")
        splits = names.groupby("name")["split"].unique()
        found = [f"{name} ({', '.join(sorted(within))})" for name, within in splits.items() if len(within) > 1]
        if found:
            torn[key] = found
    numbers = {"in_two_splits": torn, "groups": int(index["group"].nunique())}
    if torn:
        listed = (f"{KINDS[key]} in more than one split: {list_some(names)}" for key, names in torn.items())
        return Check("failed", "; ".join(listed), numbers)
    models = index[index["source"] == "model"]
    same = int((models.groupby("motion")["split"].transform("nunique") > 1).sum()) if len(models) else 0
    if same:
        words = f"{same} rows of models have the parameters of a row in another split; sample their parameters"
        return Check("warning", words, {**numbers, "same_walkers": same})
    return Check("passed", f"{numbers['groups']} groups, each in one split", numbers)


def check_duplicates(contents: Contents) -> Check:
    """Find signatures that occur in two splits."""
    # identical: equal bytes, of all rows; near: differing in level and rounding only
    index = contents.index
    splits = index["split"].to_numpy(dtype=str)
    if len(set(splits)) < 2:
        return Check("not applicable", "rows of one split only")
    if "signature" not in contents.description["fields"]:
        values = index[[f"feature_{name}" for name in FEATURE_UNITS]].to_numpy(dtype=np.float64)
        known = np.flatnonzero(np.isfinite(values[:, :2]).all(axis=1))
        digests = {int(n): values[n].tobytes() for n in known}
        same = _find_equal(digests, splits)
        numbers: dict[str, Any] = {"rows": known.size, "compared_for_likeness": known.size, "identical": len(same)}
        fault = _describe_pairs(index, [(first, second, "identical") for first, second in same])
        found = judge(fault, f"no identical ones among {known.size} rows' features", numbers)
        return replace(found, summary=f"no signatures are kept; of the features: {found.summary}")
    chosen = contents.random["pairs"].choice(len(index), min(len(index), MAX_COMPARED), replace=False)
    digests, pictures = _read(contents, set(chosen.tolist()))
    same = _find_equal(digests, splits)
    has_target = (index["source"] != "none").to_numpy(dtype=bool)
    rows = np.array([n for n in sorted(pictures) if has_target[n]], dtype=np.int64)
    # for every row the most similar row in each later split, if it is similar enough
    parts = [part for split in SPLITS if len(part := rows[splits[rows] == split])]
    nearest = [pair for part, later in combinations(parts, 2) for pair in _find_nearest(later, part, pictures)]
    candidates = sorted(nearest, reverse=True)[:MAX_CANDIDATES]
    near, dataset, identical = [], contents.dataset, {frozenset(pair) for pair in same}
    for _, first, second in candidates:
        if frozenset((first, second)) in identical:
            continue
        one, two = (np.sqrt(np.maximum(dataset.array("signature", n), 0.0)) for n in (first, second))
        if one.shape == two.shape:
            correlation = float(_scale_to_unit(one.ravel()) @ _scale_to_unit(two.ravel()))
            if correlation > ALIKE:
                near.append((correlation, first, second))
    dataset.files.close()
    numbers = {
        "rows": len(index),
        "compared_for_likeness": len(rows),
        "candidates": len(candidates),
        "identical": len(same),
        "near_identical": len(near),
        "most_alike": max((value for value, *_ in candidates), default=None),
    }
    pairs = [(first, second, "identical") for first, second in same]
    pairs += [(first, second, f"{value:.5f}") for value, first, second in sorted(near, reverse=True)]
    words = f"no identical ones among {len(index)} signatures, no near-identical ones in different splits"
    if len(rows) < len(index):
        words += f" among {len(rows)} of them"
    return judge(_describe_pairs(index, pairs), words, numbers)


def _describe_pairs(index: pd.DataFrame, pairs: Sequence[tuple[int, int, str]]) -> str:
    ids, splits = index["id"].to_numpy(dtype=str), index["split"].to_numpy(dtype=str)
    listed = [f"{ids[a]} ({splits[a]}) and {ids[b]} ({splits[b]}) {how}" for a, b, how in pairs]
    return f"in different splits: {list_some(listed)}" if listed else ""


def _read(contents: Contents, chosen: set[int]) -> tuple[dict[int, bytes], dict[int, Float32Array]]:
    """Hash every row's signature, and picture the chosen rows."""
    files, facts = contents.dataset.files, contents.description["fields"]["signature"]
    digests: dict[int, bytes] = {}
    pictures: dict[int, Float32Array] = {}
    last = None
    for number, (shard, row) in enumerate(zip(contents.index["shard"], contents.index["row"], strict=True)):
        if shard != last:
            contents.tick()
            last = shard
        stored = files.read(shard, "signature", int(row))
        if stored is None or stored.size == 0:
            continue
        digests[number] = hashlib.blake2b(stored.tobytes(), digest_size=16).digest()
        if number in chosen:
            pictures[number] = make_picture(decode(stored, facts))
    files.close()
    return digests, pictures


def make_picture(power: npt.NDArray[Any]) -> Float32Array:
    """Average a signature into :data:`SHAPE` cells for comparison."""
    # dB above the median, mean removed, norm 1, flat
    small = _average(_average(np.asarray(power, dtype=np.float32), SHAPE[0]).T, SHAPE[1]).T
    level = np.maximum(small, max(float(np.median(small)), 1e-37))
    return _scale_to_unit(10.0 * np.log10(level).ravel())


def _average(values: npt.NDArray[Any], count: int) -> npt.NDArray[Any]:
    size = values.shape[0]
    starts = np.arange(count) * size // count
    if size < count:
        return np.asarray(values[starts])
    sums = np.add.reduceat(values, starts, axis=0)
    return np.asarray(sums / np.diff(np.append(starts, size))[:, None])


def _scale_to_unit(values: npt.NDArray[Any]) -> Float32Array:
    centred = values - values.mean()
    norm = float(np.linalg.norm(centred))
    return np.asarray(centred / norm if norm > 0 else centred, dtype=np.float32)


def _find_equal(digests: dict[int, bytes], splits: npt.NDArray[np.str_]) -> list[tuple[int, int]]:
    """Return the first pair across splits per digest."""
    numbers = list(digests)
    rows = pd.DataFrame({"number": numbers, "digest": list(digests.values()), "split": splits[numbers]})
    first = rows.drop_duplicates(["digest", "split"]).groupby("digest", sort=False)["number"].agg(list)
    return [(found[0], found[1]) for found in first if len(found) > 1]


def _find_nearest(
    rows: npt.NDArray[np.int64], others: npt.NDArray[np.int64], pictures: dict[int, Float32Array]
) -> Iterator[tuple[float, int, int]]:
    """Yield the nearest of ``others`` to each of ``rows``."""
    from sklearn.metrics import pairwise_distances_argmin_min

    left, table = (np.stack([pictures[int(n)] for n in part]) for part in (rows, others))
    nearest, distances = pairwise_distances_argmin_min(left, table)  # block by block
    likeness = 1.0 - distances**2 / 2.0  # of vectors of norm 1
    for n in np.flatnonzero(likeness > CANDIDATE):
        yield float(likeness[n]), int(others[nearest[n]]), int(rows[n])
