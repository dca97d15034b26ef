"""Analysis results on disk (HDF5) and as JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.core.config import canonical_json, validate
from doppelgait.core.errors import AnalysisError, DoppelgaitError
from doppelgait.core.files import atomic_path
from doppelgait.core.labels import (
    CADENCE_MAP,
    CADENCE_SPECTRUM,
    COORDINATE_UNITS,
    SIGNATURE,
    Schema,
    make_array,
)
from doppelgait.core.own_hdf5 import check_own
from doppelgait.core.units import doppler_to_velocity_mps
from doppelgait.features import FEATURE_UNITS
from doppelgait.pipeline.analyze import TargetResult
from doppelgait.processing import Analysis, Gate
from doppelgait.radar.parameters import Radar
from doppelgait.radar.recording import Recording

FORMAT = "doppelgait-result"
FORMAT_VERSION = 2


def result_as_dict(result: TargetResult) -> dict[str, Any]:
    """One target's result as the charter's JSON: features, gait frequency, quality and flags; None for unknown."""
    return {
        "label": result.label,
        "gate": result.gate.source,
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
    slow_time_s = recording.slow_time_s
    facts = {
        "file": recording.source,
        "n_pulses": int(slow_time_s.size),
        "n_range_bins": int(recording.n_range_bins),
        "observation_s": recording.observation_s,
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
    numbers = {**plain["features"], **{k: plain[k] for k in ("gait_frequency_hz", "torso_doppler_hz", "n_periods")}}
    for name, value in numbers.items():
        group.attrs[name] = math.nan if value is None else value
    for name in ("quality", "standard_deviation", "extended"):
        group.attrs[name] = canonical_json(plain[name])
    group.attrs["pieces"] = json.dumps(plain.get("pieces", []))
    group.attrs["flags"] = json.dumps(plain["flags"])
    for name in ("signature", "cadence_map", "cadence_spectrum"):
        write_array(group, name, getattr(result, name))
    group.create_dataset("main_line_hz", data=result.main_line_hz, track_times=False)
    _write_gate(group.create_group("gate", track_order=True), result.gate)


def _write_gate(group: Any, gate: Gate) -> None:
    group.attrs.update(source=gate.source, span_m=gate.span_m)
    if gate.doppler_hz is not None:
        group.attrs["doppler_hz"] = gate.doppler_hz
    for name in ("time_s", "centre_m"):
        group.create_dataset(name, data=getattr(gate, name), track_times=False)


def _read_gate(group: Any) -> Gate:
    band_hz = group.attrs.get("doppler_hz")
    return Gate(
        group["time_s"][:], group["centre_m"][:], float(group.attrs["span_m"]),
        None if band_hz is None else (float(band_hz[0]), float(band_hz[1])), str(group.attrs["source"]),
    )  # fmt: skip


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


@dataclass(frozen=True)
class StoredTarget:
    """One target of a result file.

    Parameters
    ----------
    facts : dict
        As of :func:`result_as_dict`.
    signature : DataArray (time, doppler)
    cadence_map : DataArray (cadence, doppler)
    cadence_spectrum : DataArray (cadence)
    gate : Gate
    main_line_hz : ndarray, shape (J,), or None
        At the columns of the signature; files of older versions have none.
    """

    facts: dict[str, Any]
    signature: xr.DataArray
    cadence_map: xr.DataArray
    cadence_spectrum: xr.DataArray
    gate: Gate
    main_line_hz: npt.NDArray[np.float64] | None


@dataclass(frozen=True)
class StoredResults:
    """What a result file holds.

    Parameters
    ----------
    source : str
        Recording that was analysed.
    radar : Radar
    analysis : Analysis
    targets : tuple of StoredTarget
    """

    source: str
    radar: Radar
    analysis: Analysis
    targets: tuple[StoredTarget, ...]


STORED_ARRAYS: dict[str, Schema] = {
    "signature": SIGNATURE,
    "cadence_map": CADENCE_MAP,
    "cadence_spectrum": CADENCE_SPECTRUM,
}
STORED_NUMBERS = ("gait_frequency_hz", "torso_doppler_hz", "n_periods")


def sniff_results(path: str | Path) -> bool:
    """Whether a file is HDF5 and says that it holds results."""
    import h5py

    try:
        with h5py.File(path, "r") as file:
            return bool(file.attrs.get("format") == FORMAT)
    except (OSError, RuntimeError, ValueError, TypeError, LookupError):
        return False


def read_results(path: str | Path) -> StoredResults:
    """Read a file of :func:`write_results`.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    StoredResults
        Arrays with their dimensions and velocity as coordinates; those along time beside it are not stored.

    Raises
    ------
    AnalysisError
        If the file is missing, is no result file, is damaged, or takes values from another file.
    """
    import h5py

    if not Path(path).is_file():
        raise AnalysisError(f"{path}: no such file")
    try:
        with h5py.File(path, "r") as file:
            return _read_hdf5(file)
    except (OSError, LookupError, ValueError, TypeError, AttributeError, RuntimeError, DoppelgaitError) as error:
        raise AnalysisError(
            f"{path}: is damaged or no result of doppelgait analyze: {error}; analyse the recording again"
        ) from None


def _read_hdf5(file: Any) -> StoredResults:
    if file.attrs.get("format") != FORMAT:
        raise ValueError(f"attribute format is {file.attrs.get('format')!r}, must be {FORMAT!r}")
    if int(file.attrs["format_version"]) != FORMAT_VERSION:
        raise ValueError(f"format_version is {file.attrs['format_version']}, this program reads {FORMAT_VERSION}")
    check_own(file)
    numbers = sorted(file.get("targets", {}), key=int)
    return StoredResults(
        source=str(file.attrs["source"]),
        radar=validate(Radar, json.loads(file.attrs["radar"]), where="radar"),
        analysis=validate(Analysis, json.loads(file.attrs["analysis"]), where="analysis"),
        targets=tuple(_read_target(file[f"targets/{number}"]) for number in numbers),
    )


def _read_target(group: Any) -> StoredTarget:
    features = {name: _stored_number(group.attrs[name]) for name in FEATURE_UNITS}
    facts = {
        "label": str(group.attrs["label"]) or None,
        "gate": str(group["gate"].attrs["source"]),
        "features": features,
        **{name: _stored_number(group.attrs[name]) for name in STORED_NUMBERS},
        **{name: json.loads(group.attrs[name]) for name in ("quality", "flags", "standard_deviation", "extended")},
    }
    pieces = json.loads(group.attrs["pieces"])
    gate = _read_gate(group["gate"])
    line = group["main_line_hz"][:] if "main_line_hz" in group else None
    arrays = {name: _read_array(group, name, schema) for name, schema in STORED_ARRAYS.items()}
    if line is not None and line.shape != (arrays["signature"].sizes["time"],):
        raise ValueError(f"main_line_hz has shape {line.shape}, the signature {arrays['signature'].shape}")
    return StoredTarget(
        facts={**facts, **({"pieces": pieces} if pieces else {})},
        gate=gate,
        main_line_hz=line,
        **arrays,
    )


def _stored_number(value: Any) -> float | None:
    return float(value) if math.isfinite(value) else None


def _read_array(group: Any, name: str, schema: Schema) -> xr.DataArray:
    stored = group[name]
    attrs = {key: value.item() if isinstance(value, np.generic) else value for key, value in stored.attrs.items()}
    if json.loads(attrs.pop("dims")) != list(schema.dims):
        raise ValueError(f"{name} has dimensions {stored.attrs['dims']}, must be {schema.dims}")
    coords: dict[str, Any] = {dim: group[f"{dim}{AXIS_SUFFIX[COORDINATE_UNITS[dim]]}"][:] for dim in schema.dims}
    if "doppler" in coords:
        wavelength_m = float(group["signature"].attrs["wavelength_m"])
        coords["velocity"] = ("doppler", doppler_to_velocity_mps(coords["doppler"], wavelength_m))
    return make_array(schema, stored[:], coords, attrs)
