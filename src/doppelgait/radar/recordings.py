"""Radar recordings on disk, as plain HDF5."""

from __future__ import annotations

import json
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from doppelgait.core.config import format_canonical_json, validate
from doppelgait.core.documents import parse_json
from doppelgait.core.errors import RecordingError
from doppelgait.core.files import FileKind, create_hdf5, open_own_hdf5
from doppelgait.core.labels import MOTION, SCATTERER_VARIABLES, ScattererTable, Signal, describe_points
from doppelgait.core.lazy import LateRows, read_tiles
from doppelgait.core.own_hdf5 import FAULTS, SIGNATURE, open_hdf5, read_stamp
from doppelgait.core.plugins import plugin
from doppelgait.core.samples import Samples
from doppelgait.radar.measured import check_finite
from doppelgait.radar.parameters import Radar
from doppelgait.radar.readers import read_recording
from doppelgait.radar.recording import (
    CENTRE_ARRAYS,
    NAN,
    Recording,
    TargetTruth,
    list_further_facts,
    make_baseband_facts,
)

__all__ = ["read_hdf5", "read_recording", "sniff_hdf5", "write_recording"]

RECORDING = FileKind("doppelgait-recording", 1, "a doppelgait recording", RecordingError)
STORED_BYTES = 1 << 26
"""Maximum size of samples that are read at once, bytes; larger ones are read on demand."""

UNIT_SUFFIX = {"m": "_m", "m/s": "_mps", "rad": "_rad", "m^2": "_m2", "1": ""}
TRUTH_FACTS = [fact.name for fact in fields(TargetTruth) if fact.type in ("str", "float")]
POSE = {"radar_position_m": (3,), "radar_azimuth_deg": (), "radar_tilt_deg": ()}
"""Shapes of the attributes for position and direction of the radar."""
STORED_VARIABLES = ("range", "radial_velocity", "rcs", "path_gain", "path_phase", "aspect")
OPTIONAL_VARIABLES = ("path_gain", "path_phase", "aspect")


@plugin("radar_writer", "doppelgait", suffix=".h5")
def write_recording(recording: Recording, path: str | Path) -> None:
    """Write a recording to a file, atomically.

    Raises
    ------
    OutputError
        If the file cannot be written (no folder, no permission, disk full); an existing file then does not change.
    """
    with create_hdf5(path, RECORDING) as file:
        file.attrs["radar"] = format_canonical_json(recording.radar)
        file.attrs.update(noise_power_v2=recording.noise_power_v2, snr_frame_db=recording.snr_frame_db)
        if recording.seed is not None:
            file.attrs["seed"] = recording.seed
        if recording.notes:
            file.attrs["notes"] = json.dumps(recording.notes)
        _put(file, "baseband", recording.frames.get_values(), "V", "<c8")
        file["baseband"].attrs.update(list_further_facts(recording))
        _put(file, "slow_time_s", recording.slow_time_s, "s")
        _put(file, "range_m", recording.range_m, "m")
        if recording.radar_position_m is not None:
            file.attrs.update({name: getattr(recording, name) for name in POSE})
        for number, truth in enumerate(recording.truth):
            group = file.create_group(f"truth/{number}", track_order=True)
            for fact in TRUTH_FACTS:
                group.attrs[fact] = getattr(truth, fact)
            for name in ("marker", "part"):
                group.attrs[name] = json.dumps([str(value) for value in np.asarray(truth.table[name])])
            for name in CENTRE_ARRAYS:
                units = {"m": "m", "mps": "m/s", "rad": "rad"}[name.rsplit("_", 1)[1]]
                _put(group, name, getattr(truth, name), units)
            for name in (n for n in STORED_VARIABLES if n in truth.table):
                units, values = SCATTERER_VARIABLES[name], truth.table[name]
                first = np.asarray(values[0:1])
                if name in ("rcs", "path_gain") and all((x == first).all() for _, x in read_tiles(values)):
                    values = first
                _put(group, name + UNIT_SUFFIX[units], values, units, "<f8")
            if (kept := vars(truth)["body"]) is not None:
                body = Signal.of(kept, MOTION)
                for name in ("marker", "part"):
                    group.attrs[f"body_{name}"] = json.dumps([str(value) for value in body.axis(name)])
                _put(group, "body_time_s", body.axis("time"), "s")
                _put(group, "body_position_m", body.values.astype("<f4"), "m")


def _put(group: Any, name: str, values: Any, units: str, dtype: str | None = None) -> None:
    """Write values (slow_time, ...), long ones tile by tile."""
    dataset = group.create_dataset(name, values.shape, dtype or values.dtype, track_times=False)
    for first, tile in read_tiles(values):
        dataset[first : first + tile.shape[0]] = tile
    dataset.attrs["units"] = units


def sniff_hdf5(path: Path, head: bytes) -> bool:
    """Return whether a file is a doppelgait recording, or a damaged HDF5 file without a format."""
    if not head.startswith(SIGNATURE):
        return False
    try:
        with open_hdf5(path, members=False) as content:
            return bool(content.attrs.get("format") == RECORDING.format)
    except FAULTS:
        return True


@plugin("radar_reader", "doppelgait", sniff=sniff_hdf5, suffixes=(".h5",))
def read_hdf5(path: Path) -> Recording:
    """Read a recording written by :func:`write_recording`."""
    with open_own_hdf5(path, RECORDING) as file:
        radar = validate(Radar, parse_json(file.attrs["radar"]), where="radar")
        slow_time_s, range_m = (_open_numbers(file, name)[:] for name in ("slow_time_s", "range_m"))
        attrs = {k: v.item() if isinstance(v, np.generic) else v for k, v in file["baseband"].attrs.items()}
        further = {**make_baseband_facts(radar), **attrs}
        found = file["baseband"]
        wanted = (*slow_time_s.shape, *range_m.shape)
        if found.shape != wanted or len(wanted) != 2 or found.dtype.kind != "c":
            raise ValueError(
                f"baseband holds {found.dtype} values of shape {found.shape}, must be complex values of shape {wanted} "
                "by slow_time_s and range_m"
            )
        stored = 8 * found.size > STORED_BYTES
        rows = StoredRows(path, "baseband", "c8", read_stamp(path)) if stored else None
        with np.errstate(over="ignore", invalid="ignore"):  # values beyond single precision raise an error later
            values = found if stored else found[:].astype(np.complex64)
        check_finite(path, values)
        numbers_of = {name: np.asarray(file.attrs[name], dtype=np.float64) for name in POSE if name in file.attrs}
        pose = {name: values.reshape(POSE[name]).tolist() for name, values in numbers_of.items()}
        if "radar_position_m" in pose:
            pose["radar_position_m"] = tuple(pose["radar_position_m"])
        return Recording(
            Samples(values) if rows is None else Samples.stored(found.shape, rows),
            radar,
            slow_time_s,
            range_m,
            facts={name: value for name, value in further.items() if name not in ("units", "radar")},
            truth=[
                _read_truth(file[f"truth/{number}"], slow_time_s, int(number), path if stored else None)
                for number in sorted(file.get("truth", {}), key=int)
            ],
            noise_power_v2=float(file.attrs.get("noise_power_v2", NAN)),
            snr_frame_db=float(file.attrs.get("snr_frame_db", NAN)),
            seed=int(file.attrs["seed"]) if "seed" in file.attrs else None,
            source=path.name,
            notes=[str(note) for note in parse_json(file.attrs.get("notes", "[]"))],
            **pose,
        )


def _open_numbers(group: Any, name: str) -> Any:
    """Return a dataset of real numbers; pandas has no index of half precision."""
    if (dtype := group[name].dtype).kind not in "fiu" or dtype == np.float16:
        raise ValueError(f"{name} holds {dtype} values, must be real numbers of single or double precision")
    return group[name]


def _read_names(group: Any, key: str) -> list[str]:
    """Return a list of names in an attribute."""
    names = parse_json(group.attrs[key])
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise ValueError(f"{key} must be a list of names, not {str(names)[:40]}")
    return names


@dataclass(frozen=True)
class StoredRows:
    """Rows of a dataset in a file that must stay unchanged."""

    path: Path
    name: str
    dtype: str
    stamp: tuple[int, int, int]

    def __call__(self, first: int, stop: int) -> Any:
        """Return the rows from ``first`` to before ``stop``."""
        try:
            if read_stamp(self.path) != self.stamp:
                raise ValueError("it was changed after it was opened")
            with open_hdf5(self.path, members=False) as file:
                return np.asarray(file[self.name][first:stop], dtype=self.dtype)
        except FAULTS as error:
            raise RecordingError(f"{self.path}: pulses {first} to {stop} cannot be read: {error}") from None


def _read_truth(group: Any, slow_time_s: Any, number: int, path: Path | None) -> TargetTruth:
    """Read the truth of one target; with a ``path``, values are read on demand."""
    parts, markers = (_read_names(group, key) for key in ("part", "marker"))
    if len(parts) != len(markers):
        raise ValueError(f"{len(markers)} markers have {len(parts)} parts")
    shape = (len(slow_time_s), len(parts))

    def values_of(key: str) -> Any:
        stored = _open_numbers(group, key)
        if path is None or stored.shape != shape:
            return np.broadcast_to(stored[:], shape)
        return LateRows(shape, StoredRows(path, f"{group.name}/{key}", "f8", read_stamp(path)), np.float64)

    keys = {name: name + UNIT_SUFFIX[SCATTERER_VARIABLES[name]] for name in STORED_VARIABLES}
    values = {name: values_of(key) for name, key in keys.items() if name not in OPTIONAL_VARIABLES or key in group}
    columns = {"marker": np.array(markers, dtype=str), "part": np.array(parts, dtype=str)}
    scatterers: Any = ScattererTable(slow_time_s, values, {"target": np.full(shape[1], number), **columns})
    stored = {fact: group.attrs[fact] for fact in TRUTH_FACTS}
    facts: dict[str, Any] = {k: str(v) if isinstance(v, str | bytes) else float(v) for k, v in stored.items()}
    centre = {name: _open_numbers(group, name)[:] for name in CENTRE_ARRAYS}
    body: Any = None  # recordings of earlier versions have no body
    if "body_position_m" in group:
        markers, parts = (_read_names(group, f"body_{key}") for key in ("marker", "part"))
        positions, times = (_open_numbers(group, f"body_{name}")[:] for name in ("position_m", "time_s"))
        body = describe_points(positions.astype(np.float32), times, markers, parts)
    return TargetTruth(scatterers=scatterers, body=body, **centre, **facts)
