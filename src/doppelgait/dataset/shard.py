"""One shard: simulate, analyse and write its examples, all or nothing."""

from __future__ import annotations

import hashlib
import json
import math
import os
import traceback
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr
from threadpoolctl import threadpool_limits

from doppelgait.core.config import FrozenModel, canonical_json
from doppelgait.core.errors import DoppelgaitError, DoppelgaitWarning
from doppelgait.core.labels import axis
from doppelgait.dataset.motions import recording_of
from doppelgait.dataset.plan import ExampleSpec, ShardSpec
from doppelgait.pipeline import run_example, run_simulation
from doppelgait.pipeline.fused import FusedExample
from doppelgait.radar.recording import TargetTruth

STORED_DTYPES = {"signature": "<f4", "cadence_map": "<f4", "baseband": "<c8"}


def build_shard(shard: ShardSpec, directory: str, folder: str) -> dict[str, Any]:
    """Build one shard file and its record; returns the record.

    Parameters
    ----------
    shard : ShardSpec
    directory : str
        Folder ``shards`` of the dataset.
    folder : str
        Folder that relative motion paths start from.

    Returns
    -------
    dict
        ``shard``, ``sha256``, ``bytes``, ``rows`` (index rows) and ``failures`` (id, reason, spec). The same is in
        ``NAME.json`` beside the shard, written last: a shard counts as built only with it.
    """
    rows: list[dict[str, Any]] = []
    failures: list[dict[str, str]] = []
    arrays: list[dict[str, npt.NDArray[Any]]] = []
    for example in shard.examples:
        try:
            with threadpool_limits(1):  # the bytes of a matrix product depend on the number of threads
                row, stored = build_example(example, shard.fields, Path(folder))
        except Exception as error:
            failures.append({"id": example.id, "reason": _reason(error), "spec": canonical_json(example)})
            continue
        rows.append({**row, "shard": shard.name, "row": len(arrays)})
        arrays.append(stored)
    path = Path(directory) / f"{shard.name}.h5"
    partial = path.with_suffix(".h5.partial")
    _write_shard(partial, shard, [row["id"] for row in rows], arrays)
    record = {
        "shard": shard.name,
        "sha256": file_sha256(partial),
        "bytes": partial.stat().st_size,
        "rows": rows,
        "failures": failures,
    }
    os.replace(partial, path)
    write_atomically(path.with_suffix(".json"), json.dumps(record, allow_nan=False).encode())
    return record


def _reason(error: Exception) -> str:
    if isinstance(error, DoppelgaitError):
        return str(error)
    return "internal error: " + "".join(traceback.format_exception_only(error)).strip()


def build_example(
    example: ExampleSpec, fields: tuple[str, ...], folder: Path
) -> tuple[dict[str, Any], dict[str, npt.NDArray[Any]]]:
    """Index row and stored arrays of one example."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", DoppelgaitWarning)
        made = run_example(example.run, folder=folder, gate_error_m=example.gate_error_m)
    messages = [str(w.message).partition(":")[0] for w in caught if issubclass(w.category, DoppelgaitWarning)]
    result = made.results[0]
    sources = {"signature": result.signature, "cadence_map": result.cadence_map}
    if "baseband" in fields:
        sources["baseband"] = _baseband(example, folder)
    stored = {name: sources[name].values.astype(STORED_DTYPES[name]) for name in fields}
    if "signature" in fields:
        stored["signature_time_s"] = axis(result.signature, "time")
        stored["signature_doppler_hz"] = axis(result.signature, "doppler")
    return index_row(example, made, messages), stored


def _baseband(example: ExampleSpec, folder: Path) -> xr.DataArray:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DoppelgaitWarning)  # already known from the fused path
        return run_simulation(example.run, folder=folder, angles=False).baseband


def index_row(example: ExampleSpec, made: FusedExample, messages: list[str]) -> dict[str, Any]:
    """One row of the index: identity, resolved parameters, truth, features and diagnostics; None for unknown."""
    target = example.run.scene.targets[0]
    truth, result, prf_hz = made.truth[0], made.results[0], example.run.radar.prf_hz
    motion_file = recording_of(target.motion)
    row = {
        "id": example.id,
        "scene_id": example.id,
        "label": example.label,
        "split": example.split,
        "subject": example.subject,
        "source": "recording" if motion_file else "model",
        "recording": motion_file,
        "motion_kind": target.motion["kind"],
        "motion": canonical_json(target.motion),
        "prf_hz": prf_hz,
        "observation_s": made.n_pulses / prf_hz,
        "environment": _listed(example.run.environment),
        "impairments": _listed(example.run.impairments),
        "radar_height_m": example.run.scene.radar_position_m[2],
        "rcs_total_m2": float(truth.scatterers["rcs"].values.sum(axis=1).mean()),
        "snr_frame_db": made.snr_frame_db,
        "gate_error_m": example.gate_error_m,
        "gate": result.gate,
        **truth_columns(truth),
        **{f"feature_{k}": v for k, v in result.features.as_dict().items()},
        "gait_frequency_hz": result.gait_frequency_hz,
        "torso_doppler_hz": result.torso_doppler_hz,
        "n_periods": result.n_periods,
        **{f"quality_{k}": v for k, v in result.quality.items()},
        **{f"sd_{k}": v for k, v in result.standard_deviation.items()},
        **{f"extended_{k}": v for k, v in result.extended.items()},
        "flags": ";".join(result.flags),
        "warnings": ";".join(messages),
    }
    return {key: None if isinstance(v, float) and not math.isfinite(v) else v for key, v in row.items()}


def _listed(specs: Sequence[FrozenModel]) -> str:
    """Environment or impairments of an example as one line of JSON."""
    return json.dumps([spec.model_dump(mode="json") for spec in specs], sort_keys=True, separators=(",", ":"))


def truth_columns(truth: TargetTruth) -> dict[str, Any]:
    """Columns of the index that only a simulation knows; their names begin with ``truth_``."""
    aspect_rad = truth.centre_aspect_rad[np.isfinite(truth.centre_aspect_rad)]  # unknown while the body stands still
    return {
        "truth_gait": truth.gait,
        "truth_height_m": truth.height_m,
        "truth_ground_speed_mps": truth.ground_speed_mps,
        "truth_radial_velocity_mps": float(truth.centre_velocity_mps.mean()),
        "truth_range_m": float(truth.centre_range_m.mean()),
        "truth_aspect_deg": float(np.degrees(aspect_rad.mean())) if aspect_rad.size else math.nan,
        "truth_gait_frequency_hz": truth.gait_frequency_hz,
        "truth_step_frequency_hz": truth.step_frequency_hz,
        "truth_stride_frequency_hz": truth.stride_frequency_hz,
    }


def _write_shard(path: Path, shard: ShardSpec, ids: list[str], arrays: list[dict[str, npt.NDArray[Any]]]) -> None:
    """One dataset per field, (example, ...), one chunk per example; or one per example where shapes differ."""
    import h5py

    with h5py.File(path, "w", track_order=True) as file:
        file.attrs["split"] = shard.split
        file.create_dataset("id", data=np.array(ids, dtype=h5py.string_dtype()), track_times=False)
        for name in arrays[0] if arrays else ():
            values = [entry[name] for entry in arrays]
            options = {"compression": "gzip", "compression_opts": 1, "shuffle": True, "track_times": False}
            if len({v.shape for v in values}) == 1:
                file.create_dataset(name, data=np.stack(values), chunks=(1, *values[0].shape), **options)
            else:
                for number, value in enumerate(values):
                    file.create_dataset(f"{name}/{number}", data=value, **options)
    _sync(path)


def write_atomically(path: Path, content: bytes) -> None:
    """Write a small file so that it is complete or absent."""
    partial = path.with_name(path.name + ".partial")
    partial.write_bytes(content)
    _sync(partial)
    os.replace(partial, path)


def _sync(path: Path) -> None:
    with path.open("rb+") as handle:
        os.fsync(handle.fileno())


def file_sha256(path: Path) -> str:
    """SHA-256 of a file, hex."""
    with path.open("rb") as handle:
        return hashlib.file_digest(handle, "sha256").hexdigest()
