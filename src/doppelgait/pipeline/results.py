"""Analysis results on disk (HDF5) and as JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import xarray as xr

from doppelgait.core.config import canonical_json
from doppelgait.core.files import atomic_path
from doppelgait.core.labels import axis
from doppelgait.pipeline.analyze import TargetResult
from doppelgait.processing import Analysis
from doppelgait.radar.recording import Recording

FORMAT = "doppelgait-result"
FORMAT_VERSION = 1


def result_as_dict(result: TargetResult) -> dict[str, Any]:
    """One target's result as the charter's JSON: features, gait frequency, quality and flags; None for unknown."""
    return {
        "label": result.label,
        "gate": result.gate,
        "features": {name: _json_number(value) for name, value in result.features.as_dict().items()},
        "gait_frequency_hz": _json_number(result.gait_frequency_hz),
        "torso_doppler_hz": _json_number(result.torso_doppler_hz),
        "n_periods": _json_number(result.n_periods),
        "quality": {name: _json_number(value) for name, value in result.quality.items()},
        "flags": list(result.flags),
        "standard_deviation": {name: _json_number(value) for name, value in result.standard_deviation.items()},
        "extended": {name: _json_number(value) for name, value in result.extended.items()},
        **({"pieces": [result_as_dict(piece) for piece in result.pieces]} if result.pieces else {}),
    }


def analysis_as_dict(recording: Recording, results: Sequence[TargetResult]) -> dict[str, Any]:
    """The document that ``doppelgait analyze --json`` prints."""
    slow_time_s = axis(recording.baseband, "slow_time")
    facts = {
        "file": recording.source,
        "n_pulses": int(slow_time_s.size),
        "n_range_bins": int(recording.baseband.sizes["range"]),
        "observation_s": float(slow_time_s.size / recording.radar.prf_hz),
        "snr_frame_db": _json_number(recording.snr_frame_db),
        "noise_power_v2": _json_number(recording.noise_power_v2),
        "seed": recording.seed,
        "radar": recording.radar.model_dump(mode="json"),
    }
    return {"recording": facts, "targets": [result_as_dict(result) for result in results]}


def _json_number(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def write_results(path: str | Path, recording: Recording, results: Sequence[TargetResult], analysis: Analysis) -> None:
    """Write results to one HDF5 file; it appears complete or not at all.

    Raises
    ------
    OutputError
        If it cannot be written; an older file of that name is then untouched.
    """
    with atomic_path(path) as partial:
        _write_hdf5(partial, recording, results, analysis)


def _write_hdf5(path: Path, recording: Recording, results: Sequence[TargetResult], analysis: Analysis) -> None:
    import h5py

    with h5py.File(path, "w", track_order=True) as file:
        file.attrs.update(format=FORMAT, format_version=FORMAT_VERSION, source=recording.source)
        file.attrs.update(radar=canonical_json(recording.radar), analysis=canonical_json(analysis))
        for number, result in enumerate(results):
            group = file.create_group(f"targets/{number}", track_order=True)
            _write_target(group, result)


def _write_target(group: Any, result: TargetResult) -> None:
    plain = result_as_dict(result)
    group.attrs["label"] = plain["label"] or ""
    group.attrs["gate"] = plain["gate"]
    numbers = {**plain["features"], **{k: plain[k] for k in ("gait_frequency_hz", "torso_doppler_hz", "n_periods")}}
    for name, value in numbers.items():
        group.attrs[name] = math.nan if value is None else value
    for name in ("quality", "standard_deviation", "extended"):
        group.attrs[name] = canonical_json(plain[name])
    group.attrs["pieces"] = json.dumps(plain.get("pieces", []))
    group.attrs["flags"] = json.dumps(plain["flags"])
    for name in ("signature", "cadence_map", "cadence_spectrum"):
        write_array(group, name, getattr(result, name))
    limits = {name: variable.values for name, variable in result.gate_limits.data_vars.items()}
    gate = group.create_group("gate_limits", track_order=True)
    for name, values in {"time_s": axis(result.gate_limits, "time"), **limits}.items():
        gate.create_dataset(str(name), data=values, track_times=False)


AXIS_SUFFIX = {"s": "_s", "Hz": "_hz", "m": "_m"}


def write_array(group: Any, name: str, array: xr.DataArray) -> None:
    """Write a labelled array: its values under ``name``, each axis once per group (``time_s``, ``doppler_hz``)."""
    dataset = group.create_dataset(name, data=array.values, track_times=False)
    for key, value in plain_attributes(array.attrs).items():
        dataset.attrs[key] = value
    dataset.attrs["dims"] = json.dumps([str(dim) for dim in array.dims])
    for dim in array.dims:
        units = array.coords[dim].attrs["units"]
        axis = f"{dim}{AXIS_SUFFIX[units]}"
        if axis not in group:
            group.create_dataset(axis, data=array.coords[dim].values, track_times=False).attrs["units"] = units


def plain_attributes(attrs: Mapping[Any, Any]) -> dict[str, Any]:
    """Attributes that HDF5 can hold."""
    return {str(key): value for key, value in attrs.items() if isinstance(value, str | int | float)}
