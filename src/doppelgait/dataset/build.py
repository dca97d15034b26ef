"""Build a dataset from a plan, and report the state of its folder."""

from __future__ import annotations

import json
import platform
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np

from doppelgait import __version__
from doppelgait.core.errors import ConfigError, DatasetError, OutputError, explain_memory
from doppelgait.core.interrupt import stop_in_order
from doppelgait.dataset.config import SPLITS, PlanConfig, Progress
from doppelgait.dataset.executors import check_executor, run_shards
from doppelgait.dataset.finish import (
    DATA_VERSION,
    SUMS,
    Header,
    Record,
    Totals,
    compute_dataset_id,
    count_shards,
    find_dataset,
    find_shard,
    finish_dataset,
    list_shard_names,
    open_log,
    plan_header,
    read_description,
    write_description,
)
from doppelgait.dataset.lock import PATTERN, Part, build_lock, list_running_builds, read_lock
from doppelgait.dataset.plan import Shard, plan_dataset, sample_examples
from doppelgait.dataset.resolve import warn_of_recordings
from doppelgait.dataset.shard import BuildContext, ExampleMaker, build_shard
from doppelgait.dataset.verify.leakage import warn_of_default_rcs, warn_of_leaks

CHECKED_EXAMPLES = 200
"""Number of examples, spread over the plan, that are resolved before anything is written, to find errors early."""
RELEASE = (__version__, DATA_VERSION)
LEFTOVERS = ("*.partial", PATTERN)  # files of builds that run or were killed


@dataclass(frozen=True)
class BuildReport:
    """Report of a build.

    Parameters
    ----------
    n_examples, n_built, n_reused : int
        Examples in the dataset, examples built now, and examples reused. While other parts are
        missing, the counts cover only this part.
    n_rows : int
        Rows of the index, one per target; 0 while shards of other parts are missing.
    n_failed : int
        Examples that failed and are not in the dataset; the next build tries them again.
    failures : list of dict
        The first 100 failures: id, reason and specification. The records next to the shards contain all of them.
    missing : int
        Shards of other parts that do not exist yet; the dataset is finished at 0.
    too_many_failed : bool
        Whether more failed than ``max_failed_share`` allows.
    seconds : float
    bytes : int
        Size of the shards.
    """

    directory: Path
    dataset_id: str
    n_examples: int
    n_built: int
    n_reused: int
    n_rows: int
    n_failed: int
    failures: list[dict[str, Any]]
    missing: int
    too_many_failed: bool
    seconds: float
    bytes: int


@dataclass(frozen=True)
class Job:
    """Dataset that this process builds, from a plan or from recordings."""

    target: Path
    header: Header
    maker: ExampleMaker
    shards: Sequence[Shard]
    own: Sequence[Shard]
    part: Part | None = None
    max_failed_share: float = 0.0


@explain_memory
def build_dataset(
    config: PlanConfig,
    directory: str | Path,
    *,
    folder: Path | None = None,
    executor: str = "processes",
    workers: int | None = None,
    part: str | None = None,
    max_failed_share: float = 0.0,
    on_progress: Progress | None = None,
) -> BuildReport:
    """Build a dataset, or resume an interrupted build.

    Shards that are complete and without failures are not built again.

    Parameters
    ----------
    directory : path
        Folder of the dataset; created if missing.
    folder : Path, optional
        Folder that relative motion paths start from.
    executor : str
        ``serial``, ``processes``, ``dask`` or ``dask://HOST:PORT``, see
        :func:`doppelgait.dataset.executors.run_shards`. The result's bytes do not depend on it.
    workers : int, optional
        Processes; the number of processors by default.
    part : str, optional
        ``I/N``: build every N-th shard from the I-th, for the I-th of N jobs that share the folder. The job that finds
        all shards complete finishes the dataset; so does a build without ``part``.
    max_failed_share : float
        Share of examples that may fail in a complete dataset, from 0 to 1.
    on_progress : callable, optional
        Called with (examples done, examples in total) of this part.

    Raises
    ------
    DatasetError
        If the folder contains a dataset of another configuration, another build uses it, the plan
        cannot be split, or workers die repeatedly.
    OutputError
        If the folder cannot be written or the disk is full; finished shards are kept.
    ConfigError
        If the plan has examples that are not allowed (nothing is written then), or the executor or part does not exist.
    KeyboardInterrupt
        On Ctrl-C or termination, after the current example, with a message on how to resume.
        Finished shards are kept. A second signal ends the process at once.

    See Also
    --------
    stream_examples : simulate examples without a folder.
    doppelgait.open_dataset : open the dataset.

    Examples
    --------
    >>> import doppelgait as dg
    >>> plan, folder = dg.dataset.load_plan("home-alarm", overrides=["dataset.examples_per_class=8"])
    >>> report = dg.dataset.build_dataset(plan, "walks", executor="serial")
    >>> report.n_built, report.n_failed
    (16, 0)
    """
    began = time.monotonic()
    check_executor(executor)
    chosen = None if part is None else Part.parse(part)
    if not 0 <= max_failed_share <= 1:
        raise ConfigError(f"max_failed_share = {max_failed_share}: is not allowed; must be from 0 to 1")
    target, source = Path(directory).absolute(), (folder or Path.cwd()).absolute()
    plan = plan_dataset(config, folder=source)
    examples = list(sample_examples(plan, CHECKED_EXAMPLES))
    if not (target / "dataset.json").is_file():
        leaks = plan.config.dataset.leaks
        warn_of_recordings(examples, folder=source)
        warn_of_leaks(examples, np.random.default_rng(0), leaks=leaks)
        warn_of_default_rcs(examples, np.random.default_rng(0), folder=source, leaks=leaks)
    shards = tuple(plan.shards())
    mine = shards if chosen is None else shards[chosen.number - 1 :: chosen.among]
    identity = compute_dataset_id(plan.config, source)
    maker = BuildContext(plan.config, str(source), str(target), identity)
    job = Job(target, plan_header(plan.config, identity, source), maker, shards, mine, chosen, max_failed_share)
    try:
        find_dataset(target, job.header, ignored=LEFTOVERS)
        target.mkdir(parents=True, exist_ok=True)
        with stop_in_order():
            tally, missing, totals = build_job(job, executor, workers, on_progress)
    except OSError as error:
        raise OutputError(f"{target}: cannot be written: {error}; what was built so far is kept") from None
    except KeyboardInterrupt:
        raise KeyboardInterrupt(
            f"{target}: stopped; finished shards are kept, and the same command continues the build"
        ) from None
    planned = sum(len(shard.examples) for shard in (mine if missing else shards))
    return BuildReport(
        directory=target,
        dataset_id=identity,
        n_examples=planned - totals.n_failed,
        n_built=tally["built"],
        n_reused=tally["reused"],
        n_rows=totals.rows,
        n_failed=totals.n_failed,
        failures=totals.failures,
        missing=missing,
        too_many_failed=totals.n_failed > max_failed_share * planned,
        seconds=time.monotonic() - began,
        bytes=totals.bytes,
    )


def build_job(
    job: Job, executor: str = "serial", workers: int | None = None, on_progress: Progress | None = None
) -> tuple[Counter[str], int, Totals]:
    """Build the own shards of a job, and finish its dataset if none of other parts is missing."""
    with build_lock(job.target, job.part):
        try:
            tally = _build_missing(job, executor, workers, on_progress)
        finally:
            _remove_unfinished_files(job)
        own = {shard.name for shard in job.own}
        missing = sum(_read_complete_record(job, shard) is None for shard in job.shards if shard.name not in own)
        if missing:
            return tally, missing, Totals(bytes=tally["bytes"], n_failed=tally["failed"])
        names = [shard.name for shard in job.shards]
        return tally, 0, finish_dataset(job.target, job.header, names, max_failed_share=job.max_failed_share)


def _build_missing(job: Job, executor: str, workers: int | None, on_progress: Progress | None) -> Counter[str]:
    """Build the own shards that are not complete; count examples built, reused and failed, and bytes."""
    began, tally = time.monotonic(), Counter[str]()
    find_dataset(job.target, job.header, ignored=LEFTOVERS)  # check again, now that no other build can write
    missing = []
    for shard in job.own:
        record = _read_complete_record(job, shard)
        if record is None or record["failures"]:
            missing.append(shard)
        else:
            tally.update(reused=len(shard.examples), bytes=record["bytes"])
    if not missing and (job.target / "dataset.json").is_file():
        return tally
    counts = count_shards(shard.name for shard in job.shards)
    (job.target / SUMS).unlink(missing_ok=True)
    write_description(job.target, job.header.describe(counts, complete=False))
    (job.target / "shards").mkdir(exist_ok=True)
    _remove_unfinished_files(job)  # the disk may be full of them
    done, total = tally["reused"], sum(len(shard.examples) for shard in job.own)
    work = partial(_build_one, context=job.maker, release=RELEASE)
    with closing(run_shards(work, missing, executor=executor, workers=workers)) as results:
        for shard, made in results:
            size, failed = len(shard.examples), made["failed"]
            if not (job.target / "shards" / f"{shard.name}.json").is_file():
                raise DatasetError(
                    f"{job.target}: shard {shard.name} was built but is missing; every worker "
                    "must have access to this folder"
                )
            tally.update(made, built=size - failed)
            seconds = round(time.monotonic() - began, 3)
            log_entry(job.target, {"shard": shard.name, "examples": size, "failed": failed, "seconds": seconds})
            done += size
            if on_progress is not None:
                on_progress(done, total)
    return tally


def _build_one(shard: Shard, *, context: ExampleMaker, release: tuple[str, int]) -> dict[str, Any]:
    if release != RELEASE:
        raise DatasetError(
            f"a worker has doppelgait {RELEASE}, this build {release}; install the same version everywhere"
        )
    try:
        record = build_shard(shard, context)
    except (OSError, RuntimeError) as error:  # HDF5 raises RuntimeError if a file cannot be closed
        raise OutputError(
            f"{context.directory}: shard {shard.name} cannot be written: {' '.join(str(error).split())}; "
            "what was built so far is kept"
        ) from None
    return {"failed": len(record["failures"]), "bytes": record["bytes"]}


def _read_complete_record(job: Job, shard: Shard) -> Record | None:
    state, record = find_shard(job.target, shard.name, job.header.id)
    if state != "done" or len(record["contents_sha256"]) != 64:
        return None
    known = {row.get("scene_id") for row in record["rows"]} | {failure.get("id") for failure in record["failures"]}
    return record if known == {entry.id for entry in shard.examples} else None


def _remove_unfinished_files(job: Job) -> None:
    """Remove half-written files, only own ones while other parts run."""
    own = {shard.name for shard in job.own}
    # list the files before the locks: a writer has its lock before its files
    leftovers = list(job.target.rglob("*.partial"))
    alone = len(list_running_builds(job.target)) <= 1
    for leftover in leftovers:
        if alone or leftover.name.partition(".")[0] in own:
            leftover.unlink(missing_ok=True)


def log_entry(target: Path, entry: Mapping[str, Any]) -> None:
    """Append a line to the build log."""
    stamp = {"time": datetime.now(UTC).isoformat(timespec="seconds"), "host": platform.node()}
    with open_log(target) as handle:
        handle.write(json.dumps({**stamp, **entry}) + "\n")


@dataclass(frozen=True)
class Status:
    """State of a dataset's folder."""

    directory: Path
    id: str
    name: str
    complete: bool
    n_planned: int
    n_examples: int  # in shards that are done, as the failed ones
    n_failed: int
    shards: Mapping[str, Literal["done", "missing", "damaged"]]
    running: tuple[str, ...]
    removed: tuple[str, ...]


def read_dataset_status(directory: str | Path, *, quick: bool = False) -> Status:
    """Report the status of a dataset."""
    folder = Path(directory)
    description = read_description(folder)
    running = list_running_builds(folder)
    counts = description.get("shards")
    if not counts:  # from the names of the shards that are there
        found = (path.stem.split("-") for path in sorted((folder / "shards").glob("*-*-of-*.h5")))
        named = (parts for parts in found if len(parts) == 4 and parts[0] in SPLITS and parts[3].isdecimal())
        counts = {split: int(count) for split, _, _, count in named}
    removed = []
    for path in () if running else sorted([*folder.rglob("*.partial"), *folder.glob(PATTERN)]):
        holder = read_lock(path) if path.suffix == ".lock" else None
        if (holder is None or not holder.alive) and not path.is_dir():
            path.unlink(missing_ok=True)
            removed.append(str(path.relative_to(folder)))
    shards, examples, n_failed = {}, set(), 0
    for name in list_shard_names(counts):
        shards[name], record = find_shard(folder, name, description["id"], quick=quick)
        examples |= {(name, row.get("scene_id")) for row in record.get("rows", ())}
        n_failed += len(record.get("failures", ()))
    return Status(
        directory=folder,
        id=description["id"],
        name=description["name"],
        complete=bool(description.get("complete")),
        n_planned=int(description.get("n_examples", 0)),
        n_examples=len(examples),
        n_failed=n_failed,
        shards=shards,
        running=tuple(str(holder) for holder in running),
        removed=tuple(removed),
    )
