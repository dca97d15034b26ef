"""One shard: simulate, analyse and write its examples, all or nothing."""

from __future__ import annotations

import hashlib
import io
import json
import os
import platform
import traceback
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
import numpy.typing as npt
from threadpoolctl import ThreadpoolController

from doppelgait.core.config import canonical_json
from doppelgait.core.errors import DoppelgaitError, DoppelgaitWarning
from doppelgait.core.labels import axis
from doppelgait.dataset.config import FieldSpec, PlanConfig
from doppelgait.dataset.fields import AXIS_UNITS, FIELDS, encode
from doppelgait.dataset.matching import match_tracks, strongest_track
from doppelgait.dataset.plan import PlannedExample, Shard
from doppelgait.dataset.resolve import ExampleSpec, resolve_example
from doppelgait.dataset.rows import index_rows
from doppelgait.pipeline import TargetResult, analyze, run_example, run_simulation
from doppelgait.pipeline.fused import FusedExample
from doppelgait.radar.recording import Recording

Arrays = Mapping[str, npt.NDArray[Any]]

_limiting = Lock()
_limits: list[Any] = []
"""The limit that holds, then one entry for everybody who needs it."""


@dataclass(frozen=True)
class BuildContext:
    """What every shard of a dataset has in common.

    Parameters
    ----------
    config : PlanConfig
        With its folders expanded.
    folder : str
        Folder that relative motion paths start from.
    directory : str
        Folder of the dataset.
    """

    config: PlanConfig
    folder: str
    directory: str


def build_shard(shard: Shard, context: BuildContext) -> dict[str, Any]:
    """Build one shard file and its record; returns the record.

    Parameters
    ----------
    shard : Shard
    context : BuildContext

    Returns
    -------
    dict
        ``shard``, ``sha256``, ``bytes``, ``rows`` (index rows) and ``failures`` (id, reason, spec). The same is in
        ``NAME.json`` beside the shard, written last: a shard counts as built only with it.
    """
    rows: list[dict[str, Any]] = []
    failures: list[dict[str, str]] = []
    arrays: list[Arrays] = []
    for entry in shard.examples:
        try:
            found = build_planned(entry, context)
        except Exception as error:
            failures.append({"id": entry.id, "reason": _reason(error), "spec": _spec_text(entry, context)})
            continue
        for row, stored in found:
            rows.append({**row, "shard": shard.name, "row": len(arrays)})
            arrays.append(stored)
    path = Path(context.directory) / "shards" / f"{shard.name}.h5"
    partial = _partial(path)
    try:
        write_shard(partial, shard.split, [row["id"] for row in rows], arrays)
        record = {
            "shard": shard.name,
            "sha256": file_sha256(partial),
            "bytes": partial.stat().st_size,
            "rows": rows,
            "failures": failures,
        }
        os.replace(partial, path)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise
    write_atomically(path.with_suffix(".json"), json.dumps(record, allow_nan=False).encode())
    return record


def _reason(error: Exception) -> str:
    if isinstance(error, DoppelgaitError):
        return str(error)
    return "internal error: " + "".join(traceback.format_exception_only(error)).strip()


def _spec_text(entry: PlannedExample, context: BuildContext) -> str:
    """The resolved example, or its number where it cannot be resolved."""
    try:
        return canonical_json(resolve_example(context.config, entry.number, Path(context.folder)))
    except DoppelgaitError:
        return json.dumps({"number": entry.number})


def build_planned(entry: PlannedExample, context: BuildContext) -> list[tuple[dict[str, Any], Arrays]]:
    """Rows and stored arrays of a planned example."""
    folder = Path(context.folder)
    example = resolve_example(context.config, entry.number, folder, split=entry.split, group=entry.group)
    settings = context.config.dataset
    with _one_blas_thread():
        return build_example(example, settings.fields, folder, gate=settings.gate)


@contextmanager
def _one_blas_thread() -> Iterator[None]:
    """One thread in all matrix products of this process, whose bytes depend on their number, until nobody needs it.

    A cluster's worker may begin an example while one that it was told to give up still runs: the first of them to end
    must not give the other its threads back.
    """
    with _limiting:
        if not _limits:
            _limits.append(_threads().limit(limits=1))
        _limits.append(None)
    try:
        yield
    finally:
        with _limiting:
            _limits.pop()
            if len(_limits) == 1:
                _limits.pop().restore_original_limits()


@lru_cache(maxsize=1)
def _threads() -> ThreadpoolController:
    """Controller of all BLAS of this process; finding them takes 5 ms, so once. SciPy's must be loaded to be found."""
    import scipy.linalg  # noqa: F401

    return ThreadpoolController()


def build_example(
    example: ExampleSpec, fields: Sequence[FieldSpec], folder: Path, *, gate: str = "truth"
) -> list[tuple[dict[str, Any], Arrays]]:
    """Index row and stored arrays of every target of an example.

    Parameters
    ----------
    example : ExampleSpec
    fields : sequence of FieldSpec
    folder : Path
        Folder that relative motion paths start from.
    gate : {"truth", "track"}
    """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", DoppelgaitWarning)
        made, results, recording = _simulate(example, fields, folder, gate)
    found = (str(w.message).partition(":")[0] for w in caught if issubclass(w.category, DoppelgaitWarning))
    rows = index_rows(example, made, results, list(dict.fromkeys(found)))
    return [
        (row, _stored(result, made, number, recording, fields))
        for number, (row, result) in enumerate(zip(rows, results, strict=True))
    ]


def _simulate(
    example: ExampleSpec, fields: Sequence[FieldSpec], folder: Path, gate: str
) -> tuple[FusedExample, Sequence[TargetResult | None], Recording | None]:
    """Truth, one result per row, and the recording where it had to be made."""
    if gate == "truth":
        made = run_example(example.run, folder=folder, gate_error_m=example.gate_error_m)
        if all(field.name != "baseband" for field in fields):
            return made, made.results, None
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DoppelgaitWarning)  # already known from the fused path
            return made, made.results, run_simulation(example.run, folder=folder, angles=False)
    recording = run_simulation(example.run, folder=folder, angles=False)
    tracked = analyze(recording, gate="track", analysis=example.run.analysis)
    n_pulses = recording.baseband.sizes["slow_time"]
    made = FusedExample(tracked, recording.truth, n_pulses, recording.noise_power_v2, recording.snr_frame_db)
    if example.rows[0].source == "none" and len(example.rows) == 1:
        return made, strongest_track(tracked), recording
    seconds = n_pulses / example.run.radar.prf_hz
    return made, match_tracks(tracked, recording.truth, seconds), recording


def _stored(
    result: TargetResult | None, made: FusedExample, number: int, recording: Recording | None,
    fields: Sequence[FieldSpec],
) -> Arrays:  # fmt: skip
    """Arrays of one row; those of a target that no track follows are empty."""
    stored: dict[str, npt.NDArray[Any]] = {}
    for spec in fields:
        if spec.name in ("signature", "cadence_map"):
            signal = None if result is None else getattr(result, spec.name)
        elif spec.name == "baseband":
            signal = None if recording is None else recording.baseband
        else:
            signal = made.truth[number].scatterers[spec.name.removeprefix("truth_").rpartition("_")[0]]
        if signal is None:
            stored[spec.name] = encode(np.empty((0, 0)), spec)
            continue
        stored[spec.name] = encode(signal.values, spec)
        for place, dim in enumerate(FIELDS[spec.name]["dims"]):
            if dim in AXIS_UNITS:
                values = axis(signal, dim)
                stored[f"{spec.name}_{dim}_{AXIS_UNITS[dim]}"] = values[:: spec.hop] if place == 0 else values
    return stored


def write_shard(path: Path, split: str, ids: list[str], arrays: Sequence[Arrays]) -> None:
    """One dataset per field, (row, ...), one chunk per row; or one per row where shapes differ."""
    import h5py

    image = io.BytesIO()  # a full disk then meets one plain write, not the middle of HDF5
    with h5py.File(image, "w", track_order=True) as file:
        file.attrs["split"] = split
        file.create_dataset("id", data=np.array(ids, dtype=h5py.string_dtype()), track_times=False)
        file.flush()
        for name in dict.fromkeys(name for entry in arrays for name in entry):
            values = {number: entry[name] for number, entry in enumerate(arrays) if name in entry}
            options = {"compression": "gzip", "compression_opts": 1, "shuffle": True, "track_times": False}
            if len(values) == len(arrays) and len({v.shape for v in values.values()}) == 1:
                shape = next(iter(values.values())).shape
                chunks = {} if 0 in shape else {"chunks": (1, *shape), **options}
                file.create_dataset(name, data=np.stack(list(values.values())), **chunks)
                file.flush()  # in this order, and not when Python gets round to closing them: the bytes are the same
                continue
            for number, value in values.items():
                file.create_dataset(f"{name}/{number}", data=value, **({} if value.size == 0 else options))
                file.flush()
    path.write_bytes(image.getbuffer())
    _sync(path)


def write_atomically(path: Path, content: bytes) -> None:
    """Write a small file so that it is complete or absent."""
    partial = _partial(path)
    try:
        partial.write_bytes(content)
        _sync(partial)
        os.replace(partial, path)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise


def _partial(path: Path) -> Path:
    """Name to write to first; a worker left over from a killed build must not write into that of its successor."""
    return path.with_name(f"{path.name}.{platform.node()}-{os.getpid()}.partial")


def _sync(path: Path) -> None:
    with path.open("rb+") as handle:
        os.fsync(handle.fileno())


def file_sha256(path: Path) -> str:
    """SHA-256 of a file, hex."""
    with path.open("rb") as handle:
        return hashlib.file_digest(handle, "sha256").hexdigest()
