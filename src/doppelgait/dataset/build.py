"""Build a dataset from a plan.

Any executor can build the shards, in parts if requested. A stopped build can be resumed.
"""

from __future__ import annotations

import json
import platform
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from doppelgait import __version__
from doppelgait.core.documents import parse_json, read_document
from doppelgait.core.errors import ConfigError, DatasetError, OutputError, explain_memory
from doppelgait.core.files import hash_file
from doppelgait.core.interrupt import raise_if_stopped, stop_in_order
from doppelgait.dataset.config import PlanConfig, Progress
from doppelgait.dataset.executors import check_executor, run_shards
from doppelgait.dataset.finish import (
    DATA_VERSION,
    LOG,
    SUMS,
    Header,
    compute_dataset_id,
    count_shards,
    find_dataset,
    finish_dataset,
    make_index,
    plan_header,
    write_description,
)
from doppelgait.dataset.lock import PATTERN, Part, build_lock, list_running_builds
from doppelgait.dataset.plan import Shard, plan_dataset, sample_examples
from doppelgait.dataset.resolve import warn_of_recordings
from doppelgait.dataset.shard import BuildContext, ExampleMaker, build_shard

__all__ = ["BuildReport", "build_dataset", "make_index"]

CHECKED_EXAMPLES = 200
"""Number of examples, spread over the plan, that are resolved before anything is written, to find errors early."""
RELEASE = (__version__, DATA_VERSION)
LEFTOVERS = ("*.partial", PATTERN)
"""Files of builds that run or were killed."""


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


@dataclass
class _Tally:
    """Count the examples of own shards and the finished shards."""

    built: int = 0
    reused: int = 0
    failed: int = 0
    bytes: int = 0


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
    from doppelgait.dataset.verify.leakage import warn_of_default_rcs, warn_of_leaks

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
    job = Job(target, plan_header(plan.config, identity, source), maker, shards, mine)
    try:
        find_dataset(target, job.header, ignored=LEFTOVERS)
        target.mkdir(parents=True, exist_ok=True)
        with _stop_in_order(target), build_lock(target, chosen):
            tally = build_missing(job, executor, workers, on_progress)
            _remove_unfinished_files(job)
            own = {shard.name for shard in mine}
            others = [shard for shard in shards if shard.name not in own]
            missing = sum(_read_complete_record(job, shard) is None for shard in others)
            totals = None
            if not missing:
                names = [shard.name for shard in shards]
                totals = finish_dataset(target, job.header, names, max_failed_share=max_failed_share)
    except OSError as error:
        raise OutputError(f"{target}: cannot be written: {error}; what was built so far is kept") from None
    planned = sum(len(shard.examples) for shard in (shards if totals else mine))
    failed = totals.n_failed if totals else tally.failed
    return BuildReport(
        directory=target,
        dataset_id=identity,
        n_examples=planned - failed,
        n_built=tally.built,
        n_reused=tally.reused,
        n_rows=totals.rows if totals else 0,
        n_failed=failed,
        failures=totals.failures if totals else [],
        missing=missing,
        too_many_failed=failed > max_failed_share * planned,
        seconds=time.monotonic() - began,
        bytes=totals.bytes if totals else tally.bytes,
    )


def build_missing(
    job: Job, executor: str = "serial", workers: int | None = None, on_progress: Progress | None = None
) -> _Tally:
    """Build the own shards that are not complete."""
    began, tally = time.monotonic(), _Tally()
    find_dataset(job.target, job.header, ignored=LEFTOVERS)  # check again, now that no other build can write
    missing = []
    for shard in job.own:
        record = _read_complete_record(job, shard)
        if record is None or record["failures"]:
            missing.append(shard)
        else:
            tally.reused += len(shard.examples)
            tally.bytes += record["bytes"]
    if not missing and (job.target / "dataset.json").is_file():
        return tally
    counts = count_shards(shard.name for shard in job.shards)
    (job.target / SUMS).unlink(missing_ok=True)
    write_description(job.target, job.header.describe(counts, complete=False))
    (job.target / "shards").mkdir(exist_ok=True)
    _remove_unfinished_files(job)
    done, total = tally.reused, sum(len(shard.examples) for shard in job.own)
    work = partial(_build_one, context=job.maker, release=RELEASE)
    try:
        with closing(run_shards(work, missing, executor=executor, workers=workers)) as results:
            for shard, made in results:
                size, failed = len(shard.examples), made["failed"]
                if not (job.target / "shards" / f"{shard.name}.json").is_file():
                    raise DatasetError(
                        f"{job.target}: shard {shard.name} was built but is missing; every worker must have "
                        "access to this folder"
                    )
                tally.built += size - failed
                tally.failed += failed
                tally.bytes += made["bytes"]
                if job.header.origin == "simulated":  # an import has logged every recording
                    seconds = round(time.monotonic() - began, 3)
                    log_entry(job.target, {"shard": shard.name, "examples": size, "failed": failed, "seconds": seconds})
                done += size
                if on_progress is not None:
                    on_progress(done, total)
    finally:
        _remove_unfinished_files(job)
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


def _read_complete_record(job: Job, shard: Shard) -> dict[str, Any] | None:
    """Return a complete dataset shard's record, else None."""
    raise_if_stopped()
    path = job.target / "shards" / f"{shard.name}.h5"
    try:
        record: dict[str, Any] = parse_json(read_document(path.with_suffix(".json")))
        known = {row["scene_id"] for row in record["rows"]} | {failure["id"] for failure in record["failures"]}
        whole = (
            (record["dataset"], record["shard"]) == (job.header.id, shard.name)
            and known == {entry.id for entry in shard.examples}
            and len(record["contents_sha256"]) == 64
            and hash_file(path) == record["sha256"]
            and path.stat().st_size == record["bytes"]
        )
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None
    return record if whole else None


def _remove_unfinished_files(job: Job) -> None:
    """Remove half-written files, only own ones while other parts run."""
    own = {shard.name for shard in job.own}
    # list the files before the locks: a writer has its lock before its files
    leftovers = list(job.target.rglob("*.partial"))
    alone = len(list_running_builds(job.target)) <= 1
    for leftover in leftovers:
        if alone or leftover.name.partition(".")[0] in own:
            leftover.unlink(missing_ok=True)


@contextmanager
def _stop_in_order(target: Path) -> Iterator[None]:
    """Stop the block in order on Ctrl-C or termination."""
    try:
        with stop_in_order():
            yield
    except KeyboardInterrupt:
        raise KeyboardInterrupt(
            f"{target}: stopped; finished shards are kept, and the same command continues the build"
        ) from None


def log_entry(target: Path, entry: Mapping[str, Any]) -> None:
    """Append a line to the build log."""
    stamp = {"time": datetime.now(UTC).isoformat(timespec="seconds"), "host": platform.node()}
    with (target / LOG).open("a") as handle:
        handle.write(json.dumps({**stamp, **entry}) + "\n")
