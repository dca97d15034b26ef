"""Recordings of Acconeer's A121 sensor (60.5 GHz) as HDF5 of the vendor's exploration tool.

A frame is a series of sweeps, and a sweep has one complex value per range point; the sensor may sleep between frames.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import numpy.typing as npt
from pydantic import AliasChoices, BeforeValidator, Field

from doppelgait.core.config import FrozenModel, validate
from doppelgait.core.documents import check_cost, parse_json
from doppelgait.core.errors import ConfigError, RecordingError, warn_caller
from doppelgait.core.own_hdf5 import FAULTS, find_signature, open_hdf5
from doppelgait.core.plugins import plugin
from doppelgait.core.readers import Limits
from doppelgait.core.units import SPEED_OF_LIGHT_MPS, FloatArray
from doppelgait.radar.measured import Positive, choose_number, label_measured, make_radar, place_frames
from doppelgait.radar.readers.arrays import join_parts
from doppelgait.radar.recording import Recording

APPROXIMATE_STEP_M = 2.5e-3
"""Spacing of the range points if the sensor did not report it (vendor's constant)."""
MAX_VALUES = 500_000_000
MAX_TEXT_BYTES = 1 << 24
TICK_WRAP = 2**32
OR_ZERO = BeforeValidator(lambda value: None if value == 0 else value)
"""A stored 0 stands for "does not apply"."""
Rate = Annotated[float | None, Field(gt=0, le=1e6), OR_ZERO]


class Subsweep(FrozenModel, extra="ignore"):
    """Settings of one subsweep."""

    start_point: int = Field(ge=-100_000, le=100_000)
    num_points: int = Field(ge=1, le=100_000)
    step_length: int = Field(ge=1, le=100_000)
    profile: Literal["PROFILE_1", "PROFILE_2", "PROFILE_3", "PROFILE_4", "PROFILE_5"]
    hwaas: int = Field(ge=1, le=100_000)
    receiver_gain: int = Field(ge=0, le=1000)

    @property
    def fwhm_m(self) -> float:
        """Full width at half maximum of the amplitude of one echo."""
        return ENVELOPE_FWHM_M[int(self.profile[-1])]


class Settings(FrozenModel, extra="ignore"):
    """Settings of sensor, metadata and server that are needed to read the frames."""

    subsweeps: tuple[Subsweep, ...] = Field(min_length=1)
    sweeps_per_frame: int = Field(ge=1, le=100_000)
    continuous_sweep_mode: bool = False
    sweep_rate: Rate = None
    frame_rate: Rate = None
    max_sweep_rate: Rate = None
    base_step_length_m: float | None = Field(default=None, gt=0, le=0.1)
    ticks_per_second: Annotated[float | None, Field(gt=0, le=1e12), OR_ZERO] = None


@dataclass(frozen=True)
class Entry:
    """One sensor's frames (frames, sweeps, points) of one session."""

    values: npt.NDArray[np.complex64]
    ticks: npt.NDArray[np.int64]
    settings: Settings
    n_saturated: int
    n_delayed: int


def _read_entry(path: Path, file: Any, session: int, group: int, entry: int) -> Entry:
    generation = _read_text(file["generation"])
    if generation != "a121":
        raise RecordingError(f"{path}: is of sensor generation {generation!r}; only 'a121' is read")
    base = file["session"] if "session" in file else _open_numbered(path, file["sessions"], "session", session)
    node = _open_numbered(path, _open_numbered(path, base, "group", group), "entry", entry)
    sensor_id = str(int(node["sensor_id"][()]))
    sensors = parse_json(_read_text(base["session_config"]))["groups"][group]
    if sensor_id not in sensors:
        raise ValueError(f"the configuration of group {group} does not name sensor {sensor_id}")
    metadata = parse_json(_read_text(node["metadata"])) if "metadata" in node else {}
    server = parse_json(_read_text(file["server_info"])) if "server_info" in file else {}
    keys = {"max_sweep_rate": metadata, "base_step_length_m": metadata, "ticks_per_second": server}
    settings = validate(Settings, {**sensors[sensor_id], **{key: table.get(key) for key, table in keys.items()}})
    result, dataset = node["result"], node["result/frame"]
    shape, n_points = tuple(dataset.shape), sum(subsweep.num_points for subsweep in settings.subsweeps)
    wanted, n_values = (settings.sweeps_per_frame, n_points), math.prod(shape)
    if len(shape) != 3 or shape[0] < 1 or shape[1:] != wanted or dataset.dtype.names != ("real", "imag"):
        raise ValueError(
            f"frames are {dataset.dtype} of shape {shape}, its configuration says pairs of real and imag of shape "
            f"(frames, {wanted[0]}, {wanted[1]})"
        )
    if n_values > MAX_VALUES:
        raise ValueError(f"frames hold {n_values:,} values, at most {MAX_VALUES:,} are read")
    check_cost(path, 8 * n_values, RecordingError)
    pairs = dataset[()]
    flags = ("data_saturated", "frame_delayed")
    marked = [int(np.count_nonzero(result[name][()])) if name in result else 0 for name in flags]
    return Entry(join_parts(pairs["real"], pairs["imag"]), _read_ticks(result, shape[0]), settings, *marked)


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


def _read_ticks(result: Any, n_frames: int) -> npt.NDArray[np.int64]:
    """Return the times of the frames in ticks. The counter of some boards wraps at 2^32."""
    if "tick" not in result:
        return np.empty(0, dtype=np.int64)
    ticks = np.asarray(result["tick"][()], dtype=np.int64)
    if ticks.shape != (n_frames,):
        raise ValueError(f"there are {ticks.size} ticks for {n_frames} frames")
    falls = np.concatenate(([0], np.diff(ticks))) < -TICK_WRAP // 2
    return ticks + TICK_WRAP * np.cumsum(falls)


CARRIER_HZ = 60.5e9
ENVELOPE_FWHM_M = {1: 0.04, 2: 0.07, 3: 0.14, 4: 0.19, 5: 0.32}
"""Full width at half maximum of the amplitude of one echo, by profile (vendor's constants)."""
INT16_CODES = 2**15
LATE_TICKS = 1.5
"""Maximum deviation of integer ticks from a straight line for evenly spaced frames."""


def _list_root_names(path: Path, head: bytes) -> set[str]:
    if find_signature(head) is None:
        return set()
    try:
        with open_hdf5(path, members=False) as file:
            return set(file)
    except FAULTS:
        return set()


def sniff_acconeer(path: Path, head: bytes) -> bool:
    """Return whether a file is HDF5 of Acconeer's exploration tool."""
    names = _list_root_names(path, head)
    return "generation" in names and not names.isdisjoint({"sessions", "session"})


def list_subsweeps(path: Path) -> list[dict[str, Any]]:
    """List the first entry's subsweeps as reader options; none of a damaged file."""
    try:
        part = _open(path, 0, 0, 0)
    except RecordingError:
        return []
    return [{"subsweep": number} for number in range(len(part.settings.subsweeps))]


Number = Annotated[int, Limits(-1)]


@plugin("radar_reader", "acconeer", sniff=sniff_acconeer, suffixes=(".h5",), parts=list_subsweeps)
def read_acconeer(
    path: Path,
    *,
    session: Number = 0,
    group: Number = 0,
    entry: Number = 0,
    subsweep: int | None = None,
    sweep_rate_hz: Positive | None = None,
    conjugate: bool = True,
    full_scale_v: Positive = 1.0,
) -> Recording:
    """Read a recording of an A121 sensor."""
    scale_v = full_scale_v / INT16_CODES
    part = _open(path, session, group, entry)
    subsweeps = part.settings.subsweeps
    listed = "; ".join(
        f"{n}: profile {one.profile[-1]}, {one.num_points} points from point {one.start_point} every {one.step_length}"
        for n, one in enumerate(subsweeps)
    )
    number = choose_number(path, "subsweep", subsweep, len(subsweeps), f" ({listed})")
    chosen = subsweeps[number]
    if part.n_saturated:
        warn_caller(
            f"{path}: the sensor reports saturation in {part.n_saturated} of {len(part.values)} frames; lower its "
            "receiver gain"
        )
    slow_time_s, prf_hz, notes = _find_sweep_times(path, part, sweep_rate_hz)
    per_frame, step_m = part.settings.sweeps_per_frame, part.settings.base_step_length_m or APPROXIMATE_STEP_M
    first = sum(earlier.num_points for earlier in subsweeps[:number])  # subsweeps are consecutive
    samples = part.values[:, :, first : first + chosen.num_points].reshape(slow_time_s.size, -1) * scale_v
    points = chosen.start_point + chosen.step_length * np.arange(chosen.num_points)
    notes += [
        f"carrier {CARRIER_HZ / 1e9:g} GHz and an echo {chosen.fwhm_m:g} m wide (profile {chosen.profile[-1]}) are "
        "the vendor's constants; the pulse is taken as Gaussian",
        "ranges are the sensor's own, without its offset of some centimetres",
        f"levels: one count is taken as {scale_v:.4g} V; gain {chosen.receiver_gain}, {chosen.hwaas} averages of the "
        "sensor are not undone",
        f"the samples are {'conjugated' if conjugate else 'not conjugated'}, so that an approaching target has "
        "positive Doppler",
    ]
    if len(subsweeps) > 1:
        notes.append(f"subsweep {number} of {len(subsweeps)}")
    if part.settings.base_step_length_m is None:
        notes.append(f"the step of the range points is not stored: {step_m:g} m is taken")
    if part.n_delayed:
        notes.append(f"the sensor reports {part.n_delayed} of {len(part.values)} frames as late")
    return _label_pulses(
        path,
        samples.conj() if conjugate else samples,
        np.asarray(step_m * points, dtype=np.float64),
        step_m * chosen.step_length,
        chosen.fwhm_m,
        name=f"Acconeer A121, profile {chosen.profile[-1]}, {chosen.hwaas} averages",
        prf_hz=prf_hz,
        volts_per_unit=scale_v,
        slow_time_s=slow_time_s,
        notes=notes,
        attrs={"burst_pulses": per_frame} if per_frame > 1 and not part.settings.continuous_sweep_mode else {},
    )


def _label_pulses(
    path: Path,
    values: npt.NDArray[Any],
    range_m: FloatArray,
    spacing_m: float,
    fwhm_m: float,
    *,
    slow_time_s: FloatArray,
    notes: list[str],
    attrs: Mapping[str, Any],
    **facts: Any,
) -> Recording:
    """Make a recording of an impulse radar, as which a pulsed coherent radar is modelled, of the profile's width."""
    # the amplitude exp(-(2 dR / c)^2 / (2 tau^2)) has the full width c tau sqrt(2 ln 2) at half maximum
    start_m = max(float(range_m[0]), 0.0)
    radar = make_radar(
        path,
        carrier_hz=CARRIER_HZ,
        sample_rate_hz=SPEED_OF_LIGHT_MPS / (2 * spacing_m),
        range_start_m=start_m,
        range_stop_m=start_m + spacing_m * range_m.size,
        pulse_sigma_s=fwhm_m / (SPEED_OF_LIGHT_MPS * math.sqrt(2 * math.log(2))),
        **facts,
    )
    return label_measured(path, values, radar=radar, slow_time_s=slow_time_s, range_m=range_m, notes=notes, attrs=attrs)


def _open(path: Path, *which: int) -> Entry:
    try:
        with open_hdf5(path, soft_links=True) as file:
            return _read_entry(path, file, *which)
    except (*FAULTS, ConfigError) as error:
        raise RecordingError(f"{path}: is damaged or not a recording of an A121 sensor: {error}") from None


def _find_sweep_times(path: Path, part: Entry, sweep_rate_hz: float | None) -> tuple[FloatArray, float, list[str]]:
    """Return sweep times, sweep rate within a frame, and notes on assumptions."""
    (n_frames, per_frame, _), settings = part.values.shape, part.settings
    if settings.continuous_sweep_mode:
        rate_hz = sweep_rate_hz or settings.sweep_rate
        if rate_hz is None:
            raise RecordingError(f"{path}: sweeps are continuous but no sweep rate is stored; give sweep_rate_hz")
        elapsed, notes = int(part.ticks[-1] - part.ticks[0]) if part.ticks.size else 0, []
        if elapsed > 0 and settings.ticks_per_second is not None:
            # the recorder's clock, to compare with the stored rate
            ticks_hz = (part.ticks.size - 1) * per_frame * settings.ticks_per_second / elapsed
            notes.append(f"sweeps are timed by the sweep rate; by the recorder's ticks it is {ticks_hz:.6g} Hz")
        return np.arange(n_frames * per_frame) / rate_hz, rate_hz, notes
    if n_frames * per_frame < 2:
        raise RecordingError(f"{path}: has a single sweep, which cannot show motion")
    frame_s, notes = _find_frame_times(path, part)
    if per_frame == 1:
        return frame_s, (n_frames - 1) / float(frame_s[-1] - frame_s[0]), notes
    rate_hz = sweep_rate_hz or settings.sweep_rate or settings.max_sweep_rate
    if rate_hz is None:
        raise RecordingError(f"{path}: neither a sweep rate nor the sensor's highest is stored; give sweep_rate_hz")
    if not sweep_rate_hz and not settings.sweep_rate:
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


def _find_frame_times(path: Path, part: Entry) -> tuple[FloatArray, list[str]]:
    """Return the start of every frame by the recorder's ticks, even except for rounding."""
    ticks, tick_hz, frame_hz = part.ticks, part.settings.ticks_per_second, part.settings.frame_rate
    if len(part.values) == 1:
        return np.zeros(1), []
    if ticks.size > 1 and tick_hz and (np.diff(ticks) > 0).all():
        number = np.arange(ticks.size)
        slope = float(ticks[-1] - ticks[0]) / (ticks.size - 1)
        even = np.abs(ticks - ticks[0] - slope * number).max() <= LATE_TICKS
        counts = slope * number if even else (ticks - ticks[0]).astype(np.float64)
        if not even:
            warn_caller(
                f"{path}: frames came late or are missing; their times are the recorder's ticks and not evenly spaced"
            )
        note = f"times of frames are the recorder's ticks, {tick_hz / slope:.6g} frames/s"
        return np.asarray(counts / tick_hz, dtype=np.float64), [note]
    if frame_hz is None:
        raise RecordingError(f"{path}: its ticks do not rise and no frame rate is stored: the times are unknown")
    note = f"its ticks are not usable: frames are assumed evenly spaced at the stored {frame_hz:g} Hz"
    return np.arange(len(part.values)) / frame_hz, [note]


SPARSE_ZERO = 2**15  # value of the sparse service without an echo


class A111Settings(FrozenModel, extra="ignore"):
    """Settings of the session and of the sensor."""

    range_start_m: float = Field(validation_alias=AliasChoices("range_start_m", "actual_range_start_m"))
    range_length_m: float | None = Field(default=None, gt=0)
    step_length_m: Annotated[float | None, Field(gt=0, le=1), OR_ZERO] = None
    update_rate: Rate = None
    sweep_rate: Rate = None
    profile: Any = ""


def sniff_a111(path: Path, head: bytes) -> bool:
    """Return whether a file is a record of the A111 sensor, the layout without a generation."""
    names = _list_root_names(path, head)
    return "generation" not in names and names >= {"mode", "session_info", "data"}


@plugin("radar_reader", "acconeer-a111", sniff=sniff_a111, suffixes=(".h5",))
def read_a111(
    path: Path,
    *,
    sensor: int = 0,
    frame_rate_hz: Positive | None = None,
    sweep_rate_hz: Positive | None = None,
    conjugate: bool = True,
    full_scale_v: Positive = 1.0,
) -> Recording:
    """Read the IQ or sparse service of an A111 sensor; the sparse one is real and has no direction."""
    try:
        with open_hdf5(path) as file:
            mode = _read_text(file["mode"]).lower()
            if mode not in ("iq", "sparse"):
                raise RecordingError(f"{path}: is of the service {mode!r}, which has no phase; record IQ or sparse")
            session = parse_json(_read_text(file["session_info"]))
            config = parse_json(_read_text(file["sensor_config_dump"])) if "sensor_config_dump" in file else {}
            shape, n_dims = file["data"].shape, 3 if mode == "iq" else 4
            kind = file["data"].dtype.kind
            if kind not in "iufc" or len(shape) != n_dims or not 1 <= min(shape) <= math.prod(shape) <= MAX_VALUES:
                raise ValueError(f"data of the service {mode} have the shape {shape}, or are no numbers")
            number = choose_number(path, "sensor", sensor, shape[1])
            check_cost(path, 16 * math.prod(shape), RecordingError)
            data = file["data"][:, number]
        settings = validate(A111Settings, {**session, **{key: config.get(key) for key in ("update_rate", "profile")}})
        step_m = settings.step_length_m or (settings.range_length_m or math.nan) / (shape[-1] - 1)
        if not step_m > 0:
            raise ValueError("neither step_length_m nor range_length_m is stored")
    except (*FAULTS, ConfigError) as error:
        raise RecordingError(f"{path}: is damaged or not a recording of an A111 sensor: {error}") from None
    rate_hz, sweep_hz = frame_rate_hz or settings.update_rate, sweep_rate_hz or settings.sweep_rate
    if rate_hz is None:
        raise RecordingError(
            f"{path}: states no update_rate, so that the time of its frames is unknown; give frame_rate_hz"
        )
    is_sparse, n_sweeps = mode == "sparse", 1 if mode == "iq" else shape[2]
    if n_sweeps > 1 and (sweep_hz is None or n_sweeps / sweep_hz > 1.0 / rate_hz * (1 + 1e-9)):
        raise RecordingError(
            f"{path}: {n_sweeps} sweeps at {sweep_hz} Hz do not fit into a frame of {1 / rate_hz:.4g} s; give the true "
            "sweep_rate_hz or frame_rate_hz"
        )
    times_s, prf_hz, attrs = place_frames(shape[0], n_sweeps, 1.0 / rate_hz, sweep_hz or rate_hz)
    profile = next((n for n in ENVELOPE_FWHM_M if str(settings.profile).endswith(str(n))), 2)
    scale_v = full_scale_v / INT16_CODES
    values = data.reshape(-1, shape[-1])
    values = (values - float(SPARSE_ZERO)) * scale_v if is_sparse else values * full_scale_v
    return _label_pulses(
        path,
        values.conj() if conjugate else values,
        settings.range_start_m + step_m * np.arange(shape[-1]),
        step_m,
        ENVELOPE_FWHM_M[profile],
        name=f"Acconeer A111, {mode} service, profile {profile}",
        prf_hz=prf_hz,
        volts_per_unit=scale_v,
        slow_time_s=times_s,
        notes=[
            f"{shape[0]} frames at {rate_hz:g} Hz; carrier {CARRIER_HZ / 1e9:g} GHz; profile {profile} as of an A121",
            f"levels: one count is taken as {scale_v:.4g} V" if is_sparse else f"levels: 1 is {full_scale_v:g} V",
        ],
        attrs={**attrs, **({"one_output": True} if is_sparse else {})},
    )
