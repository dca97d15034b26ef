"""What one entry of an A121 file holds, checked: values, times and settings."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import RecordingError

APPROXIMATE_STEP_M = 2.5e-3
"""Distance of two neighbouring range points where the sensor did not report it (vendor's constant)."""
MAX_VALUES = 500_000_000
TICK_WRAP = 2**32


@dataclass(frozen=True)
class Subsweep:
    """Settings of one subsweep.

    Parameters
    ----------
    start_point, num_points, step_length : int
        First range point, their number, and points from one to the next.
    profile : int
        1 (short pulse) to 5 (long).
    hwaas : int
        Averages that the sensor takes.
    receiver_gain : int
        0 (lowest) to 23.
    """

    start_point: int
    num_points: int
    step_length: int
    profile: int
    hwaas: int
    receiver_gain: int


@dataclass(frozen=True)
class Entry:
    """One sensor's frames of one session.

    Parameters
    ----------
    values : ndarray, shape (frames, sweeps, points)
        complex64, counts.
    ticks : ndarray, shape (frames,)
        Times of the frames, int64, risen above their wrap at 2^32.
    ticks_per_second : float, optional
    sweeps_per_frame : int
    continuous : bool
        No pause between the last sweep of a frame and the first of the next.
    sweep_rate_hz, frame_rate_hz, max_sweep_rate_hz : float, optional
        As asked for, and the most that the sensor can do with these settings; None where not stored.
    step_m : float
        Distance of neighbouring range points.
    step_assumed : bool
    subsweeps : tuple of Subsweep
    n_saturated, n_delayed : int
        Frames that the sensor marked.
    """

    values: npt.NDArray[np.complex64]
    ticks: npt.NDArray[np.int64]
    ticks_per_second: float | None
    sweeps_per_frame: int
    continuous: bool
    sweep_rate_hz: float | None
    frame_rate_hz: float | None
    max_sweep_rate_hz: float | None
    step_m: float
    step_assumed: bool
    subsweeps: tuple[Subsweep, ...]
    n_saturated: int
    n_delayed: int

    def columns(self, number: int) -> slice:
        """Points of a subsweep among those of a sweep: subsweeps follow one another."""
        first = sum(one.num_points for one in self.subsweeps[:number])
        return slice(first, first + self.subsweeps[number].num_points)


def open_entry(path: Path, file: Any, *, session: int, group: int, entry: int) -> Entry:
    """Read one entry of an open file; anything missing is an error of h5py, ValueError or RecordingError."""
    generation = _text(file["generation"])
    if generation != "a121":
        raise RecordingError(f"{path}: is of sensor generation {generation!r}; only 'a121' is read")
    base = file["session"] if "session" in file else _numbered(path, file["sessions"], "session", session)
    node = _numbered(path, _numbered(path, base, "group", group), "entry", entry)
    config = _sensor_config(json.loads(_text(base["session_config"])), group, str(int(node["sensor_id"][()])))
    metadata = json.loads(_text(node["metadata"])) if "metadata" in node else {}
    subsweeps = tuple(_subsweep(one) for one in config["subsweeps"])
    per_frame = _whole(config, "sweeps_per_frame", 1, 100_000)
    values = _frames(node["result/frame"], per_frame, sum(one.num_points for one in subsweeps))
    step_m = _optional(metadata, "base_step_length_m", 0.1)
    server = json.loads(_text(file["server_info"])) if "server_info" in file else {}
    return Entry(
        values=values,
        ticks=_ticks(node["result"], values.shape[0]),
        ticks_per_second=_optional(server, "ticks_per_second", 1e12),
        sweeps_per_frame=per_frame,
        continuous=bool(config.get("continuous_sweep_mode", False)),
        sweep_rate_hz=_optional(config, "sweep_rate", 1e6),
        frame_rate_hz=_optional(config, "frame_rate", 1e6),
        max_sweep_rate_hz=_optional(metadata, "max_sweep_rate", 1e6),
        step_m=step_m or APPROXIMATE_STEP_M,
        step_assumed=step_m is None,
        subsweeps=subsweeps,
        n_saturated=_count_marked(node["result"], "data_saturated"),
        n_delayed=_count_marked(node["result"], "frame_delayed"),
    )


def _numbered(path: Path, node: Any, kind: str, number: int) -> Any:
    name = f"{kind}_{number}"
    if name in node:
        return node[name]
    there = sorted(key for key in node if str(key).startswith(f"{kind}_"))
    raise RecordingError(f"{path}: holds no {name}; there is {', '.join(there[:20]) or f'no {kind} at all'}")


def _text(dataset: Any) -> str:
    value = dataset[()]
    return value.decode("utf-8") if isinstance(value, bytes) else str(value)


def _sensor_config(session_config: Mapping[str, Any], group: int, sensor_id: str) -> Mapping[str, Any]:
    sensors = session_config["groups"][group]
    if sensor_id not in sensors:
        raise ValueError(f"the configuration of group {group} does not name sensor {sensor_id}")
    config: Mapping[str, Any] = sensors[sensor_id]
    return config


def _subsweep(config: Mapping[str, Any]) -> Subsweep:
    profile = str(config["profile"]).removeprefix("PROFILE_")
    if profile not in ("1", "2", "3", "4", "5"):
        raise ValueError(f"profile is {config['profile']!r}, must be PROFILE_1 to PROFILE_5")
    return Subsweep(
        start_point=_whole(config, "start_point", -100_000, 100_000),
        num_points=_whole(config, "num_points", 1, 100_000),
        step_length=_whole(config, "step_length", 1, 100_000),
        profile=int(profile),
        hwaas=_whole(config, "hwaas", 1, 100_000),
        receiver_gain=_whole(config, "receiver_gain", 0, 1000),
    )


def _whole(config: Mapping[str, Any], key: str, least: int, most: int) -> int:
    value = config[key]
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
        raise ValueError(f"{key} is {value!r}, must be a whole number from {least} to {most}")
    return value


def _optional(config: Mapping[str, Any], key: str, most: float) -> float | None:
    """A positive number; None where it is missing, null or 0, by which the vendor means "does not apply"."""
    value = config.get(key)
    if value is None or value == 0:
        return None
    if (
        isinstance(value, bool)
        or not isinstance(value, int | float)
        or not (math.isfinite(value) and 0 < value <= most)
    ):
        raise ValueError(f"{key} is {value!r}, must be a number above 0 and up to {most:g}")
    return float(value)


def _frames(dataset: Any, per_frame: int, n_points: int) -> npt.NDArray[np.complex64]:
    shape = tuple(dataset.shape)
    if len(shape) != 3 or shape[0] < 1 or shape[1:] != (per_frame, n_points):
        raise ValueError(f"frames have shape {shape}, its configuration says (frames, {per_frame}, {n_points})")
    if math.prod(shape) > MAX_VALUES:
        raise ValueError(f"frames hold {math.prod(shape):,} values, at most {MAX_VALUES:,} are read")
    if dataset.dtype.names != ("real", "imag"):
        raise ValueError(f"frames are {dataset.dtype}, must be pairs of real and imag")
    pairs = dataset[()]
    values = np.empty(shape, dtype=np.complex64)
    values.real, values.imag = pairs["real"], pairs["imag"]
    return values


def _ticks(result: Any, n_frames: int) -> npt.NDArray[np.int64]:
    """Times of the frames; the counter of some boards starts again after 2^32."""
    if "tick" not in result:
        return np.empty(0, dtype=np.int64)
    ticks = np.asarray(result["tick"][()], dtype=np.int64)
    if ticks.shape != (n_frames,):
        raise ValueError(f"there are {ticks.size} ticks for {n_frames} frames")
    falls = np.concatenate(([0], np.diff(ticks))) < -TICK_WRAP // 2
    return ticks + TICK_WRAP * np.cumsum(falls)


def _count_marked(result: Any, name: str) -> int:
    return int(np.count_nonzero(result[name][()])) if name in result else 0
