"""Recordings of Acconeer's A121 sensor (60.5 GHz pulsed coherent radar).

They are HDF5 files of the vendor's exploration tool.

A frame is a series of sweeps, and a sweep has one complex value per range point; the sensor may sleep between frames.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.documents import check_cost, parse_json
from doppelgait.core.errors import RecordingError, warn_caller
from doppelgait.core.own_hdf5 import FAULTS, is_hdf5, open_hdf5
from doppelgait.core.plugins import plugin
from doppelgait.core.units import SPEED_OF_LIGHT_MPS
from doppelgait.radar.measured import check_number, label_measured, make_radar
from doppelgait.radar.recording import Recording

APPROXIMATE_STEP_M = 2.5e-3
"""Spacing of the range points if the sensor did not report it (vendor's constant)."""
MAX_VALUES = 500_000_000
MAX_TEXT_BYTES = 1 << 24
TICK_WRAP = 2**32


@dataclass(frozen=True)
class Subsweep:
    """Settings of one subsweep."""

    start_point: int
    num_points: int
    step_length: int
    profile: int
    hwaas: int
    receiver_gain: int


@dataclass(frozen=True)
class Entry:
    """One sensor's frames (frames, sweeps, points) of one session."""

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
        """Return the points of a subsweep in a sweep. Subsweeps are consecutive."""
        first = sum(one.num_points for one in self.subsweeps[:number])
        return slice(first, first + self.subsweeps[number].num_points)


def open_entry(path: Path, file: Any, *, session: int, group: int, entry: int) -> Entry:
    """Read one entry of an open file."""
    generation = _read_text(file["generation"])
    if generation != "a121":
        raise RecordingError(f"{path}: is of sensor generation {generation!r}; only 'a121' is read")
    base = file["session"] if "session" in file else _open_numbered(path, file["sessions"], "session", session)
    node = _open_numbered(path, _open_numbered(path, base, "group", group), "entry", entry)
    session_config = parse_json(_read_text(base["session_config"]))
    sensor_id = str(int(node["sensor_id"][()]))
    sensors = session_config["groups"][group]
    if sensor_id not in sensors:
        raise ValueError(f"the configuration of group {group} does not name sensor {sensor_id}")
    config: Mapping[str, Any] = sensors[sensor_id]
    metadata = parse_json(_read_text(node["metadata"])) if "metadata" in node else {}
    subsweeps = tuple(_parse_subsweep(one) for one in config["subsweeps"])
    per_frame = _parse_whole(config, "sweeps_per_frame", 1, 100_000)
    dataset = node["result/frame"]
    n_points = sum(one.num_points for one in subsweeps)
    shape = tuple(dataset.shape)
    if len(shape) != 3 or shape[0] < 1 or shape[1:] != (per_frame, n_points):
        raise ValueError(f"frames have shape {shape}, its configuration says (frames, {per_frame}, {n_points})")
    if math.prod(shape) > MAX_VALUES:
        raise ValueError(f"frames hold {math.prod(shape):,} values, at most {MAX_VALUES:,} are read")
    if dataset.dtype.names != ("real", "imag"):
        raise ValueError(f"frames are {dataset.dtype}, must be pairs of real and imag")
    check_cost(path, 8 * math.prod(shape), RecordingError)
    pairs = dataset[()]
    values = np.empty(shape, dtype=np.complex64)
    values.real, values.imag = pairs["real"], pairs["imag"]
    step_m = _parse_optional(metadata, "base_step_length_m", 0.1)
    server = parse_json(_read_text(file["server_info"])) if "server_info" in file else {}
    return Entry(
        values=values,
        ticks=_read_ticks(node["result"], values.shape[0]),
        ticks_per_second=_parse_optional(server, "ticks_per_second", 1e12),
        sweeps_per_frame=per_frame,
        continuous=bool(config.get("continuous_sweep_mode", False)),
        sweep_rate_hz=_parse_optional(config, "sweep_rate", 1e6),
        frame_rate_hz=_parse_optional(config, "frame_rate", 1e6),
        max_sweep_rate_hz=_parse_optional(metadata, "max_sweep_rate", 1e6),
        step_m=step_m or APPROXIMATE_STEP_M,
        step_assumed=step_m is None,
        subsweeps=subsweeps,
        n_saturated=_count_marked(node["result"], "data_saturated"),
        n_delayed=_count_marked(node["result"], "frame_delayed"),
    )


def _open_numbered(path: Path, node: Any, kind: str, number: int) -> Any:
    name = f"{kind}_{number}"
    if name in node:
        return node[name]
    there = sorted(key for key in node if str(key).startswith(f"{kind}_"))
    raise RecordingError(f"{path}: holds no {name}; there is {', '.join(there[:20]) or f'no {kind} at all'}")


def _read_text(dataset: Any) -> str:
    if dataset.size != 1 or dataset.dtype.itemsize > MAX_TEXT_BYTES:
        raise ValueError(f"{dataset.name} is {dataset.dtype} of shape {dataset.shape}, must be one text")
    value = dataset[()]
    return value.decode("utf-8") if isinstance(value, bytes) else str(value)


def _parse_subsweep(config: Mapping[str, Any]) -> Subsweep:
    profile = str(config["profile"]).removeprefix("PROFILE_")
    if profile not in ("1", "2", "3", "4", "5"):
        raise ValueError(f"profile is {config['profile']!r}, must be PROFILE_1 to PROFILE_5")
    return Subsweep(
        start_point=_parse_whole(config, "start_point", -100_000, 100_000),
        num_points=_parse_whole(config, "num_points", 1, 100_000),
        step_length=_parse_whole(config, "step_length", 1, 100_000),
        profile=int(profile),
        hwaas=_parse_whole(config, "hwaas", 1, 100_000),
        receiver_gain=_parse_whole(config, "receiver_gain", 0, 1000),
    )


def _parse_whole(config: Mapping[str, Any], key: str, least: int, most: int) -> int:
    value = config[key]
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
        raise ValueError(f"{key} is {value!r}, must be a whole number from {least} to {most}")
    return value


def _parse_optional(config: Mapping[str, Any], key: str, most: float) -> float | None:
    """Return a positive number, or None for a missing value, null or 0 ("does not apply")."""
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


def _read_ticks(result: Any, n_frames: int) -> npt.NDArray[np.int64]:
    """Return the times of the frames in ticks. The counter of some boards wraps at 2^32."""
    if "tick" not in result:
        return np.empty(0, dtype=np.int64)
    ticks = np.asarray(result["tick"][()], dtype=np.int64)
    if ticks.shape != (n_frames,):
        raise ValueError(f"there are {ticks.size} ticks for {n_frames} frames")
    falls = np.concatenate(([0], np.diff(ticks))) < -TICK_WRAP // 2
    return ticks + TICK_WRAP * np.cumsum(falls)


def _count_marked(result: Any, name: str) -> int:
    return int(np.count_nonzero(result[name][()])) if name in result else 0


CARRIER_HZ = 60.5e9
ENVELOPE_FWHM_M = {1: 0.04, 2: 0.07, 3: 0.14, 4: 0.19, 5: 0.32}
"""Full width at half maximum of the amplitude of one echo, by profile (vendor's constants)."""
INT16_CODES = 2**15
LATE_TICKS = 1.5
"""Maximum deviation of integer ticks from a straight line for evenly spaced frames."""


def sniff_acconeer(path: Path, head: bytes) -> bool:
    """Return whether a file is HDF5 of Acconeer's exploration tool."""
    if not head or not is_hdf5(path):
        return False
    try:
        with open_hdf5(path, members=False) as file:
            return "generation" in file and ("sessions" in file or "session" in file)
    except FAULTS:
        return False


def list_subsweeps(path: Path) -> list[dict[str, Any]]:
    """List the first entry's subsweeps as reader options; none of a damaged file."""
    try:
        part = _open(path, session=0, group=0, entry=0)
    except RecordingError:
        return []
    return [{"subsweep": number} for number in range(len(part.subsweeps))]


@plugin("radar_reader", "acconeer", sniff=sniff_acconeer, suffixes=(".h5",), parts=list_subsweeps)
def read_acconeer(
    path: str | Path,
    *,
    session: int = 0,
    group: int = 0,
    entry: int = 0,
    subsweep: int | None = None,
    sweep_rate_hz: float | None = None,
    conjugate: bool = True,
    full_scale_v: float = 1.0,
) -> Recording:
    """Read a recording of an A121 sensor."""
    file = Path(path)
    scale_v = check_number(file, "full_scale_v", full_scale_v, above=0, most=1e6) / INT16_CODES
    if sweep_rate_hz is not None:
        check_number(file, "sweep_rate_hz", sweep_rate_hz, above=0, most=1e6)
    part = _open(file, session=session, group=group, entry=entry)
    number = 0 if subsweep is None and len(part.subsweeps) == 1 else subsweep
    if isinstance(number, bool) or not isinstance(number, int) or not 0 <= number < len(part.subsweeps):
        listed = "; ".join(
            f"{n}: profile {one.profile}, {one.num_points} points from point {one.start_point} every {one.step_length}"
            for n, one in enumerate(part.subsweeps)
        )
        said = "holds several subsweeps" if subsweep is None else f"subsweep = {subsweep!r} is not allowed"
        raise RecordingError(f"{file}: {said}; give subsweep=0 to {len(part.subsweeps) - 1} ({listed})")
    chosen = part.subsweeps[number]
    if part.n_saturated:
        warn_caller(
            f"{file}: the sensor reports saturation in {part.n_saturated} of {part.values.shape[0]} frames; lower its "
            "receiver gain"
        )
    slow_time_s, prf_hz, notes = _find_sweep_times(file, part, sweep_rate_hz)
    paused = part.sweeps_per_frame > 1 and not part.continuous
    # the pulsed coherent radar is modelled as an impulse radar with an echo of the profile's width: the amplitude
    # exp(-(2 dR / c)^2 / (2 tau^2)) has the full width c tau sqrt(2 ln 2) at half maximum
    spacing_m = part.step_m * chosen.step_length
    start_m = part.step_m * chosen.start_point
    radar = make_radar(
        file,
        name=f"Acconeer A121, profile {chosen.profile}, {chosen.hwaas} averages",
        carrier_hz=CARRIER_HZ,
        prf_hz=prf_hz,
        sample_rate_hz=SPEED_OF_LIGHT_MPS / (2 * spacing_m),
        range_start_m=max(start_m, 0.0),
        range_stop_m=max(start_m, 0.0) + spacing_m * chosen.num_points,
        pulse_sigma_s=ENVELOPE_FWHM_M[chosen.profile] / (SPEED_OF_LIGHT_MPS * math.sqrt(2 * math.log(2))),
        volts_per_unit=scale_v,
    )
    samples = part.values[:, :, part.columns(number)].reshape(slow_time_s.size, chosen.num_points) * scale_v
    notes += _list_notes(part, chosen, number, scale_v=scale_v, conjugate=conjugate)
    points = chosen.start_point + chosen.step_length * np.arange(chosen.num_points)
    return label_measured(
        file,
        samples.conj() if conjugate else samples,
        radar=radar,
        slow_time_s=slow_time_s,
        range_m=np.asarray(part.step_m * points, dtype=np.float64),
        notes=notes,
        attrs={"burst_pulses": part.sweeps_per_frame} if paused else {},
    )


def _open(path: Path, **which: int) -> Entry:
    if not path.is_file():
        raise RecordingError(f"{path}: no such file")
    if not is_hdf5(path):
        raise RecordingError(f"{path}: is not an HDF5 file; only files of Acconeer's exploration tool are read")
    for name, value in which.items():
        if isinstance(value, bool) or not isinstance(value, int) or value < 0:
            raise RecordingError(f"{path}: {name} = {value!r} is not allowed; it must be a whole number from 0")
    try:
        with open_hdf5(path, soft_links=True) as file:
            return open_entry(path, file, **which)
    except FAULTS as error:
        raise RecordingError(f"{path}: is damaged or not a recording of an A121 sensor: {error}") from None


def _find_sweep_times(
    path: Path, part: Entry, sweep_rate_hz: float | None
) -> tuple[npt.NDArray[np.float64], float, list[str]]:
    """Return sweep times, sweep rate within a frame, and notes on assumptions."""
    n_frames, per_frame = part.values.shape[:2]
    if part.continuous:
        rate_hz = sweep_rate_hz or part.sweep_rate_hz
        if rate_hz is None:
            raise RecordingError(f"{path}: sweeps are continuous but no sweep rate is stored; give sweep_rate_hz")
        # sweep rate by the recorder's clock, to compare with the stored one
        elapsed = int(part.ticks[-1] - part.ticks[0]) if part.ticks.size > 1 else 0
        notes = []
        if elapsed > 0 and part.ticks_per_second is not None:
            found_hz = (part.ticks.size - 1) * part.sweeps_per_frame * part.ticks_per_second / elapsed
            notes.append(f"sweeps are timed by the sweep rate; by the recorder's ticks it is {found_hz:.6g} Hz")
        return np.arange(n_frames * per_frame) / rate_hz, rate_hz, notes
    if n_frames * per_frame < 2:
        raise RecordingError(f"{path}: has a single sweep, which cannot show motion")
    frame_s, notes = _find_frame_times(path, part)
    if per_frame == 1:
        return frame_s, (n_frames - 1) / float(frame_s[-1] - frame_s[0]), notes
    rate_hz = sweep_rate_hz or part.sweep_rate_hz or part.max_sweep_rate_hz
    if rate_hz is None:
        raise RecordingError(f"{path}: neither a sweep rate nor the sensor's highest is stored; give sweep_rate_hz")
    if not sweep_rate_hz and not part.sweep_rate_hz:
        notes.append(
            f"the sweep rate was not configured: the maximum for these settings, {rate_hz:.6g} Hz, is assumed; "
            "velocities scale with it"
        )
    if n_frames > 1 and (per_frame - 1) / rate_hz >= np.diff(frame_s).min():
        raise RecordingError(
            f"{path}: {per_frame} sweeps at {rate_hz:.6g} Hz take longer than from one frame to the next "
            f"({np.diff(frame_s).min():.4g} s); give the true sweep_rate_hz"
        )
    return (frame_s[:, None] + np.arange(per_frame) / rate_hz).ravel(), rate_hz, notes


def _find_frame_times(path: Path, part: Entry) -> tuple[npt.NDArray[np.float64], list[str]]:
    """Return the start of every frame by the recorder's ticks, even except for rounding."""
    ticks = part.ticks
    if part.values.shape[0] == 1:
        return np.zeros(1), []
    if ticks.size > 1 and part.ticks_per_second and (np.diff(ticks) > 0).all():
        number = np.arange(ticks.size)
        slope = float(ticks[-1] - ticks[0]) / (ticks.size - 1)
        even = np.abs(ticks - ticks[0] - slope * number).max() <= LATE_TICKS
        counts = slope * number if even else (ticks - ticks[0]).astype(np.float64)
        if not even:
            warn_caller(
                f"{path}: frames came late or are missing; their times are the recorder's ticks and not evenly spaced"
            )
        return np.asarray(counts / part.ticks_per_second, dtype=np.float64), [
            f"times of frames are the recorder's ticks, {part.ticks_per_second / slope:.6g} frames/s"
        ]
    if part.frame_rate_hz is None:
        raise RecordingError(f"{path}: its ticks do not rise and no frame rate is stored: the times are unknown")
    note = f"its ticks are not usable: frames are assumed evenly spaced at the stored {part.frame_rate_hz:g} Hz"
    return np.arange(part.values.shape[0]) / part.frame_rate_hz, [note]


def _list_notes(part: Entry, chosen: Subsweep, number: int, *, scale_v: float, conjugate: bool) -> list[str]:
    profile_m = ENVELOPE_FWHM_M[chosen.profile]
    notes = [
        f"carrier {CARRIER_HZ / 1e9:g} GHz and an echo {profile_m:g} m wide (profile {chosen.profile}) are the "
        "vendor's constants; the pulse is taken as Gaussian",
        "ranges are the sensor's own, without its offset of some centimetres",
        f"levels: one count is taken as {scale_v:.4g} V; gain {chosen.receiver_gain}, {chosen.hwaas} averages of the "
        "sensor are not undone",
        f"the samples are {'conjugated' if conjugate else 'not conjugated'}, so that an approaching target has "
        "positive Doppler",
    ]
    if len(part.subsweeps) > 1:
        notes.append(f"subsweep {number} of {len(part.subsweeps)}")
    if part.step_assumed:
        notes.append(f"the step of the range points is not stored: {part.step_m:g} m is taken")
    if part.n_delayed:
        notes.append(f"the sensor reports {part.n_delayed} of {part.values.shape[0]} frames as late")
    return notes


SPARSE_ZERO = 2**15
"""Value of the sparse service without an echo."""


def sniff_a111(path: Path, head: bytes) -> bool:
    """Return whether a file is a record of the A111 sensor, the layout without a generation."""
    if not head or not is_hdf5(path):
        return False
    try:
        with open_hdf5(path, members=False) as file:
            return "generation" not in file and all(name in file for name in ("mode", "session_info", "data"))
    except FAULTS:
        return False


@plugin("radar_reader", "acconeer-a111", sniff=sniff_a111, suffixes=(".h5",))
def read_a111(
    path: Path,
    *,
    sensor: int = 0,
    frame_rate_hz: float | None = None,
    sweep_rate_hz: float | None = None,
    conjugate: bool = True,
    full_scale_v: float = 1.0,
) -> Recording:
    """Read the IQ or the sparse service of an A111 sensor; the sparse one is real and has no direction."""
    scale_v = check_number(path, "full_scale_v", full_scale_v, above=0, most=1e6) / INT16_CODES
    try:
        with open_hdf5(path) as file:
            mode = _read_text(file["mode"]).lower()
            if mode not in ("iq", "sparse"):
                raise RecordingError(f"{path}: is of the service {mode!r}, which has no phase; record IQ or sparse")
            session = parse_json(_read_text(file["session_info"]))
            config = parse_json(_read_text(file["sensor_config_dump"])) if "sensor_config_dump" in file else {}
            shape, n_dims = file["data"].shape, 3 if mode == "iq" else 4
            if len(shape) != n_dims or min(shape) < 1 or math.prod(shape) > MAX_VALUES:
                raise ValueError(f"data of the service {mode} have the shape {shape}")
            if not 0 <= sensor < shape[1]:
                raise RecordingError(f"{path}: sensor = {sensor} is not allowed; it must be 0 to {shape[1] - 1}")
            check_cost(path, 16 * math.prod(shape), RecordingError)
            data = file["data"][:, sensor]
        start_m = float(session.get("range_start_m", session.get("actual_range_start_m")))
        step_m = _parse_optional(session, "step_length_m", 1.0)
        step_m = step_m or float(session["range_length_m"]) / (shape[-1] - 1)
        rate_hz = frame_rate_hz or _parse_optional(config, "update_rate", 1e6)
        sweep_hz = sweep_rate_hz or _parse_optional(session, "sweep_rate", 1e6)
    except FAULTS as error:
        raise RecordingError(f"{path}: is damaged or not a recording of an A111 sensor: {error}") from None
    if rate_hz is None:
        raise RecordingError(
            f"{path}: states no update_rate, so that the time of its frames is unknown; give frame_rate_hz"
        )
    n_sweeps = 1 if mode == "iq" else shape[2]
    if n_sweeps > 1 and (sweep_hz is None or n_sweeps / sweep_hz > 1.0 / rate_hz * (1 + 1e-9)):
        raise RecordingError(
            f"{path}: {n_sweeps} sweeps at {sweep_hz} Hz do not fit into a frame of {1 / rate_hz:.4g} s; give the true "
            "sweep_rate_hz or frame_rate_hz"
        )
    prf_hz = rate_hz if n_sweeps == 1 or sweep_hz is None else sweep_hz
    values = data.reshape(-1, shape[-1]) if mode == "iq" else data.reshape(-1, shape[-1]) - float(SPARSE_ZERO)
    profile = next((n for n in ENVELOPE_FWHM_M if str(config.get("profile", "")).endswith(str(n))), 2)
    radar = make_radar(
        path,
        name=f"Acconeer A111, {mode} service, profile {profile}",
        carrier_hz=CARRIER_HZ,
        prf_hz=prf_hz,
        sample_rate_hz=SPEED_OF_LIGHT_MPS / (2 * step_m),
        range_start_m=max(start_m, 0.0),
        range_stop_m=max(start_m, 0.0) + step_m * shape[-1],
        pulse_sigma_s=ENVELOPE_FWHM_M[profile] / (SPEED_OF_LIGHT_MPS * math.sqrt(2 * math.log(2))),
        volts_per_unit=scale_v,
    )
    times_s = (np.arange(shape[0])[:, None] / rate_hz + np.arange(n_sweeps) / prf_hz).ravel()
    is_burst = n_sweeps > 1 and n_sweeps / prf_hz < (1.0 - 1e-3) / rate_hz
    notes = [
        f"{shape[0]} frames at {rate_hz:g} Hz; carrier {CARRIER_HZ / 1e9:g} GHz; profile {profile} as of an A121",
        f"levels: one count is taken as {scale_v:.4g} V" if mode == "sparse" else f"levels: 1 is {full_scale_v:g} V",
    ]
    scaled = values * (scale_v if mode == "sparse" else full_scale_v)
    return label_measured(
        path,
        scaled.conj() if conjugate else scaled,
        radar=radar,
        slow_time_s=times_s,
        range_m=start_m + step_m * np.arange(shape[-1]),
        notes=notes,
        attrs={
            **({"one_output": True} if mode == "sparse" else {}),
            **({"burst_pulses": n_sweeps} if is_burst else {}),
        },
    )
