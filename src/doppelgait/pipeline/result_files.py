"""Results of a recording as an HDF5 file and as JSON."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.config import convert_to_json, format_canonical_json, validate
from doppelgait.core.documents import parse_json
from doppelgait.core.errors import AnalysisError, ConfigError
from doppelgait.core.files import FileKind, create_hdf5, open_own_hdf5
from doppelgait.core.labels import PART_POWER, check_signal
from doppelgait.core.own_hdf5 import h5py, read_stated_format
from doppelgait.features import FEATURE_UNITS
from doppelgait.pipeline.result import (
    GROUPS,
    LABELLED_ARRAYS,
    NUMBERS,
    PLAIN_AXES,
    Result,
    TargetList,
    describe_array,
    join_array,
    make_result,
)
from doppelgait.processing import Gate
from doppelgait.radar import Radar
from doppelgait.radar.recording import Recording

RESULT = FileKind(
    "doppelgait-result",
    2,
    "a result of doppelgait analyze",
    AnalysisError,
    oldest=2,
    remedy="make it again: doppelgait analyze RECORDING -o {name}",
)


@dataclass(frozen=True)
class Results:
    """Results of one recording, as stored in a file, with the recording's source."""

    source: str
    radar: Radar
    targets: tuple[Result, ...]


def describe_results(recording: Recording, results: Sequence[Result]) -> dict[str, Any]:
    """Build the document that ``doppelgait analyze --json`` prints, with None if not finite.

    An empty list of targets has a ``reason``. ``n_bodies`` excludes echoes and things.
    """
    facts = {
        "file": recording.source,
        "n_pulses": recording.n_pulses,
        "n_range_bins": recording.n_range_bins,
        "observation_s": recording.observation_s,
        "snr_frame_db": recording.snr_frame_db,
        "noise_power_v2": recording.noise_power_v2,
        "seed": recording.seed,
        "radar": recording.radar.model_dump(mode="json"),
    }
    reason = {"reason": results.reason} if isinstance(results, TargetList) and not results else {}
    targets = [result.to_json(arrays=False) for result in results]
    counted = TargetList(results)
    counts = {"n_bodies": counted.n_bodies, "n_unknown": counted.n_unknown}
    document: dict[str, Any] = convert_to_json({"recording": facts, **counts, "targets": targets, **reason})
    return document


def write_results(path: str | Path, recording: Recording, results: Sequence[Result]) -> None:
    """Write results to an HDF5 file, atomically.

    Each target is a group ``targets/<number>``. Label, gate source, features and numbers are
    attributes (empty if undetermined), further mappings are JSON, arrays are datasets with their
    coordinates under ``axes``, and segments are groups of the same form. The links ``time_s``,
    ``doppler_hz`` and ``cadence_hz`` point to the axes of signature and cadence map.

    Raises
    ------
    OutputError
        If the file cannot be written; an older file of this name then stays unchanged.
    ConfigError
        If ``results`` is a single result.

    Examples
    --------
    >>> import doppelgait as dg
    >>> recording = dg.data.sample()
    >>> result = dg.analyze(recording, gate="truth")[0]
    >>> from doppelgait.pipeline import read_results, write_results
    >>> write_results("results.h5", recording, [result])
    >>> read_results("results.h5").targets[0].label
    'human'
    """
    if isinstance(results, Result):
        raise ConfigError(
            "write_results takes a list of results; write one as write_results(path, recording, [result])"
        )
    with create_hdf5(path, RESULT) as file:
        file.attrs.update(source=recording.source, radar=format_canonical_json(recording.radar))
        file.create_group("targets", track_order=True)
        for number, result in enumerate(results):
            _write_result(file.create_group(f"targets/{number}", track_order=True), result, {})


def _write_result(group: Any, result: Result, written: dict[Any, Any]) -> None:
    plain = result.to_json(arrays=False)
    for name, value in {**plain["features"], **{name: plain[name] for name in NUMBERS}}.items():
        group.attrs[name] = h5py.Empty("f8") if value is None else value
    group.attrs["label"] = h5py.Empty("S1") if result.label is None else result.label
    group.attrs["gate"] = result.gate_source
    for name in ("flags", *GROUPS):
        group.attrs[name] = json.dumps(plain[name])
    group.attrs["analysis"] = format_canonical_json(result.analysis)
    group.attrs["arrays"] = json.dumps(list(result.arrays))  # so that a missing array is detected
    for name, array in result.arrays.items():
        members = describe_array(array)
        axes, values = members.pop("coords", {}), members.pop("values")
        if members:
            members["units"] = members["attrs"]["units"]
        _write_values(group, name, values, members, written)
        folder = group.create_group(f"axes/{name}", track_order=True) if members else None
        for key, axis in axes.items():
            _write_values(folder, key, axis.pop("values"), axis, written)
    for name, axis in PLAIN_AXES.items():  # for other readers, under names with their units
        if axis in group:
            group[name] = group[axis]
    if result.gate_limits is not None:
        gate = group.create_group("gate_limits", track_order=True)
        gate.attrs.update(source=result.gate.source, span_m=result.gate.span_m)
        gate.attrs["doppler_hz"] = result.gate.doppler_hz or h5py.Empty("f8")
        for name in ("time_s", "centre_m"):
            _write_values(gate, name, getattr(result.gate, name), {}, written)
    for number, segment in enumerate(result.segments):
        _write_result(group.create_group(f"segments/{number}", track_order=True), segment, written)


def _write_values(
    group: Any, name: str, values: npt.NDArray[Any], facts: Mapping[str, Any], written: dict[Any, Any]
) -> None:
    # arrays have common axes, and a target has those of its longest segment
    values = np.ascontiguousarray(values)
    text = {key: value if isinstance(value, str) else json.dumps(value) for key, value in facts.items()}
    content = hashlib.blake2b(values.reshape(-1).view(np.uint8).data).digest()
    key = (values.dtype.str, values.shape, content, tuple(sorted(text.items())))
    if key in written:
        group[name] = written[key]
        return
    written[key] = group.create_dataset(name, data=values, track_times=False)
    written[key].attrs.update(text)


def _read_values(stored: Any) -> dict[str, Any]:
    facts = {key: str(text) for key, text in stored.attrs.items()}
    return {
        "values": stored[()],
        **{key: parse_json(text) if key in ("dims", "attrs") else text for key, text in facts.items()},
    }


def is_result_file(path: str | Path) -> bool:
    """Return True for an HDF5 file of results."""
    return read_stated_format(path) == RESULT.format


def read_results(path: str | Path) -> Results:
    """Read results from a file of :func:`write_results`.

    Raises
    ------
    AnalysisError
        If the file is missing, damaged, of another version or no result file, or if it links to another file.
    """
    with open_own_hdf5(path, RESULT) as file:
        return Results(
            source=str(file.attrs["source"]),
            radar=validate(Radar, parse_json(file.attrs["radar"]), where="radar"),
            targets=tuple(_read_result(file["targets"][name]) for name in sorted(file["targets"], key=int)),
        )


def _read_result(group: Any) -> Result:
    def number(name: str) -> float | int | None:
        value = group.attrs[name]
        return None if isinstance(value, h5py.Empty) else value.item()

    schemas = {**LABELLED_ARRAYS, "part_power": PART_POWER}  # parts are measured on request
    arrays: dict[str, Any] = {}
    for name in parse_json(group.attrs["arrays"]):
        members = _read_values(group[name])
        if name in schemas:
            members["coords"] = {key: _read_values(axis) for key, axis in group[f"axes/{name}"].items()}
        arrays[name] = check_signal(join_array(members), schemas[name]) if name in schemas else members["values"]
    if {"signature", "main_line_hz"} <= set(arrays):
        line, columns = arrays["main_line_hz"], arrays["signature"].sizes["time"]
        if line.shape != (columns,):
            raise ValueError(f"main_line_hz has shape {line.shape}, the signature {columns} columns")
    gate = None
    if "gate_limits" in group:
        limits, band_hz = group["gate_limits"], group["gate_limits"].attrs["doppler_hz"]
        gate = Gate(
            limits["time_s"][()],
            limits["centre_m"][()],
            float(limits.attrs["span_m"]),
            None if isinstance(band_hz, h5py.Empty) else (float(band_hz[0]), float(band_hz[1])),
            str(limits.attrs["source"]),
        )
    label, stored = group.attrs["label"], group.get("segments", {})
    plain = {
        "analysis": parse_json(group.attrs["analysis"]),
        "label": None if isinstance(label, h5py.Empty) else str(label),
        "gate": str(group.attrs["gate"]),
        "features": {name: number(name) for name in FEATURE_UNITS},
        **{name: number(name) for name in NUMBERS},
        **{name: parse_json(group.attrs[name]) for name in (*GROUPS, "flags")},
    }
    return make_result(plain, arrays, gate, [_read_result(stored[name]) for name in sorted(stored, key=int)])
