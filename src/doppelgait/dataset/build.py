"""Build a dataset: shards in parallel, resumable; then the index, the description and the card."""

from __future__ import annotations

import json
import multiprocessing
import os
import platform
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pandas as pd

from doppelgait import __version__
from doppelgait.core.errors import DatasetError, OutputError
from doppelgait.core.worker import prepare_worker, worker_environment
from doppelgait.dataset.card import dataset_card
from doppelgait.dataset.config import PlanConfig
from doppelgait.dataset.describe import differences
from doppelgait.dataset.plan import DATA_VERSION, ShardSpec, dataset_id, plan_examples, plan_shards
from doppelgait.dataset.shard import build_shard, file_sha256, write_atomically
from doppelgait.features import FEATURE_UNITS

SCHEMA_VERSION = 1

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class BuildReport:
    """What a build did.

    Parameters
    ----------
    directory : Path
    dataset_id : str
    n_examples, n_built, n_reused : int
        Examples in the dataset; of these made now; of these found built.
    failures : list of dict
        Examples that failed and are not in the dataset, with reason and specification; the next build tries them again.
    seconds : float
    bytes : int
        Size of all shards.
    """

    directory: Path
    dataset_id: str
    n_examples: int
    n_built: int
    n_reused: int
    failures: list[dict[str, Any]]
    seconds: float
    bytes: int


def build_dataset(
    plan: PlanConfig, directory: str | Path, *, folder: Path | None = None, workers: int | None = None,
    on_progress: Progress | None = None,
) -> BuildReport:  # fmt: skip
    """Build a dataset, or finish one that was begun; shards that are whole and without failures are not made again.

    Parameters
    ----------
    plan : PlanConfig
    directory : path
        Folder of the dataset; made if missing.
    folder : Path, optional
        Folder that relative motion paths start from.
    workers : int, optional
        Processes; the number of processors by default. The result's bytes do not depend on it.
    on_progress : callable, optional
        Called with (examples done, examples in total).

    Raises
    ------
    DatasetError
        If the folder holds a dataset of another configuration, or the plan cannot be split.
    OutputError
        If the folder cannot be written.
    ConfigError
        If the plan gives examples that are not allowed; nothing is written then.
    """
    began = time.monotonic()
    target, source = Path(directory), folder or Path.cwd()
    shards = list(plan_shards(plan, plan_examples(plan, folder=source)))
    identity = dataset_id(plan, source)
    _prepare(target, plan, identity)
    records = {s.name: record for s in shards if (record := finished_record(target, s)) is not None}
    reused = sum(len(record["rows"]) for record in records.values())
    missing = [s for s in shards if s.name not in records]
    total = sum(len(s.examples) for s in shards)
    done = reused
    for shard, record in _run(missing, target, source, workers or os.cpu_count() or 1):
        records[shard.name] = record
        done += len(shard.examples)
        _log(target, {"shard": shard.name, "examples": len(shard.examples), "seconds": time.monotonic() - began})
        if on_progress is not None:
            on_progress(done, total)
    return _finish(target, plan, identity, [records[s.name] for s in shards], reused, began)


def _run(
    shards: list[ShardSpec], target: Path, source: Path, workers: int
) -> Iterator[tuple[ShardSpec, dict[str, Any]]]:
    arguments = (str(target / "shards"), str(source))
    try:
        if workers <= 1 or len(shards) <= 1:
            for shard in shards:
                yield shard, build_shard(shard, *arguments)
        else:
            yield from _run_processes(shards, arguments, min(workers, len(shards)))
    except OSError as error:
        raise OutputError(f"{target}: cannot be written: {error}; what was built so far is kept") from None


def _run_processes(
    shards: list[ShardSpec], arguments: tuple[str, str], workers: int
) -> Iterator[tuple[ShardSpec, dict[str, Any]]]:
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=spawn, initializer=prepare_worker) as pool:
        with worker_environment():  # a submission starts a process while fewer than ``workers`` are there
            futures = {pool.submit(build_shard, shard, *arguments): shard for shard in shards}
        try:
            for future in as_completed(futures):
                yield futures[future], future.result()
        except BaseException:
            pool.shutdown(wait=True, cancel_futures=True)
            raise


def _prepare(target: Path, plan: PlanConfig, identity: str) -> None:
    description = target / "dataset.json"
    try:
        if description.is_file():
            _refuse_other(target, json.loads(description.read_text()), plan, identity)
        elif target.is_dir() and any(p.name != "dataset.json.partial" for p in target.iterdir()):
            raise DatasetError(f"{target}: is not empty and holds no dataset; choose another folder with -o")
        target.mkdir(parents=True, exist_ok=True)
        write_atomically(description, _describe(plan, identity, complete=False))
        (target / "shards").mkdir(exist_ok=True)
        for leftover in (target / "shards").glob("*.partial"):
            leftover.unlink()
    except ValueError as error:
        raise DatasetError(f"{description}: is damaged: {error}; delete the folder or choose another with -o") from None
    except OSError as error:
        raise OutputError(f"{target}: cannot be written: {error}") from None


def _refuse_other(target: Path, found: dict[str, Any], plan: PlanConfig, identity: str) -> None:
    if found.get("id") == identity:
        return
    changes = list(differences(found.get("config", {}), plan.model_dump(mode="json")))
    shown = "; ".join(changes[:6]) + (f"; and {len(changes) - 6} more" if len(changes) > 6 else "")
    reason = shown or "other motion files or another data version"
    raise DatasetError(
        f"{target}: holds dataset {found.get('id')} of another configuration ({reason}); "
        "build into another folder with -o, or delete this one"
    )


def _describe(plan: PlanConfig, identity: str, *, complete: bool) -> bytes:
    description = {
        "id": identity,
        "name": plan.dataset.name,
        "complete": complete,
        "schema_version": SCHEMA_VERSION,
        "data_version": DATA_VERSION,
        "classes": {c.label: number for number, c in enumerate(plan.classes)},
        "features": FEATURE_UNITS,
        "fields": {name: FIELD_FACTS[name] for name in plan.dataset.fields},
        "config": plan.model_dump(mode="json"),
        "doppelgait_version": __version__,
    }
    return (json.dumps(description, indent=2) + "\n").encode()


FIELD_FACTS = {
    "signature": {"dims": ["time", "doppler"], "units": "V^2", "dtype": "float32"},
    "cadence_map": {"dims": ["cadence", "doppler"], "units": "1", "dtype": "float32"},
    "baseband": {"dims": ["slow_time", "range"], "units": "V", "dtype": "complex64"},
}


def finished_record(target: Path, shard: ShardSpec) -> dict[str, Any] | None:
    """Record of a shard that is built, whole and without failed examples, else None."""
    path = target / "shards" / f"{shard.name}.h5"
    try:
        record: dict[str, Any] = json.loads(path.with_suffix(".json").read_text())
        known = {row["id"] for row in record["rows"]}
        whole = known == {e.id for e in shard.examples} and file_sha256(path) == record["sha256"]
    except (OSError, ValueError, KeyError):
        return None
    return record if whole else None


def _finish(
    target: Path, plan: PlanConfig, identity: str, records: list[dict[str, Any]], reused: int, began: float
) -> BuildReport:
    index = make_index(records)
    failures = [failure for record in records for failure in record["failures"]]
    partial = target / "index.parquet.partial"
    try:
        index.to_parquet(partial, index=False)
        os.replace(partial, target / "index.parquet")
        write_atomically(target / "README.md", dataset_card(plan, identity, index).encode())
        write_atomically(target / "dataset.json", _describe(plan, identity, complete=not failures))
    except OSError as error:
        raise OutputError(f"{target}: cannot be written: {error}; the shards are whole, run the build again") from None
    return BuildReport(
        directory=target,
        dataset_id=identity,
        n_examples=len(index),
        n_built=len(index) - reused,
        n_reused=reused,
        failures=failures,
        seconds=time.monotonic() - began,
        bytes=sum(record["bytes"] for record in records),
    )


TEXT_COLUMNS = ("truth_gait", "quality_gait_decision")


def make_index(records: Iterable[dict[str, Any]]) -> pd.DataFrame:
    """Index table of all shards, one row per example, numbers as float64 with NaN for unknown."""
    rows = [{**row, "shard_sha256": record["sha256"]} for record in records for row in record["rows"]]
    table = pd.DataFrame(rows)
    numeric = ("feature_", "quality_", "truth_", "sd_", "extended_")
    for name in [c for c in table.columns if c not in TEXT_COLUMNS]:
        if name.startswith(numeric) or name.endswith(("_hz", "_db")):
            table[name] = pd.to_numeric(table[name]).astype("float64")
    return table


def _log(target: Path, entry: dict[str, Any]) -> None:
    stamp = {"time": datetime.now(UTC).isoformat(timespec="seconds"), "host": platform.node()}
    with (target / "build.jsonl").open("a") as handle:
        handle.write(json.dumps({**stamp, **entry}) + "\n")
