"""Panels of a recording: range-time map, bodies, sound."""

from __future__ import annotations

import io
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, get_args

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.core.errors import AnalysisError, ConfigError
from doppelgait.core.frames import Frames, SlowTime
from doppelgait.core.labels import read_axis
from doppelgait.core.lazy import lazy_rows, take_every_row
from doppelgait.core.units import power_to_db
from doppelgait.processing import Analysis, range_doppler
from doppelgait.processing.config import MIN_CPI_PULSES
from doppelgait.processing.gate import GateChoice
from doppelgait.processing.signature import plan_for
from doppelgait.processing.sound import Channels, explain_silence, make_doppler_sound, write_wav
from doppelgait.radar.recording import Recording, TargetTruth
from doppelgait.viewer.payload import (
    DEEPEST_DB,
    describe_axis,
    describe_doppler,
    encode,
    encode_image,
    level_db,
    pack,
    shown_range_db,
)
from doppelgait.viewer.run import Run, clutter_key
from doppelgait.viewer.settings import Changes, parse_number, parse_whole

Arrays = dict[str, npt.NDArray[Any]]

MOST_LINE_POINTS = 2000
TRUTH_FACTS = (
    "label",
    "gait",
    "subject",
    "height_m",
    "ground_speed_mps",
    "stride_frequency_hz",
    "step_frequency_hz",
    "gait_frequency_hz",
)


def make_recording_payload(run: Run, gate: GateChoice | None, *, changes: Changes = ()) -> bytes:
    """Make the payload of ``api/recording``."""
    recording = run.recording
    if recording is None:
        known = {"name": run.name, "kind": run.kind, "facts": [], "notes": run.notes, "reason": run.reason}
        empty = dict.fromkeys(("duration_s", "start_s", "prf_hz", "wavelength_m", "range_time", "scene"))
        return pack({**known, **empty, "bodies": [], "truth": [], "no_sound": run.reason}, {})
    clean = run.clean_frames(gate, changes)
    times_s, range_m, range_time = clean.slow_time.time_s, clean.range_m, None
    arrays: Arrays = {}
    if range_m.size > 1:
        range_time, arrays["range_time"] = encode_image(
            "range_time",
            _make_power(clean),
            describe_axis("time", "s", times_s),
            describe_axis("range", "m", range_m),
            unit="dB re 1 V",
        )
    facts: dict[str, Any] = {
        "name": run.name,
        "kind": run.kind,
        "facts": list(_list_facts(recording)),
        "notes": [*run.notes, *recording.notes],
        "reason": None,
        "duration_s": recording.observation_s,
        "start_s": times_s[0],
        "prf_hz": recording.radar.prf_hz,
        "wavelength_m": recording.radar.wavelength_m,
        "clutter": run.analysis(gate, changes).clutter,
        "analysis": run.analysis_facts(gate, changes),
        "no_sound": explain_silence(recording.frames),
        "range_time": range_time,
        "scene": None
        if recording.radar_position_m is None
        else {
            "radar_position_m": recording.radar_position_m,
            "azimuth_deg": recording.radar_azimuth_deg,
            "tilt_deg": recording.radar_tilt_deg,
        },
        "bodies": [
            _describe_body(number, truth, arrays)
            for number, truth in enumerate(recording.truth)
            if truth.body is not None
        ],
        "truth": [_describe_truth(number, truth, recording, arrays) for number, truth in enumerate(recording.truth)],
    }
    return pack(facts, arrays)


def _make_power(clean: Frames) -> xr.DataArray:
    def rows(first: int, stop: int) -> npt.NDArray[np.float32]:
        values = clean.read(first, stop)
        return np.asarray(values.real**2 + values.imag**2)

    return clean.label().copy(data=lazy_rows(clean.shape, rows, np.float32))


def _list_facts(recording: Recording) -> Iterator[tuple[str, str]]:
    radar, range_m = recording.radar, recording.range_m
    yield "radar", radar.name or radar.waveform.kind
    yield "carrier", f"{radar.carrier_hz / 1e9:.4g} GHz"
    slow_time = recording.frames.slow_time.find_bursts()
    times_s, prf_hz, pulses = slow_time.time_s, radar.prf_hz, slow_time.burst_pulses
    if pulses is None:
        yield "frame rate", f"{prf_hz:.4g} Hz"
    else:
        starts_s = times_s[::pulses]
        yield "frame rate", f"{prf_hz:.4g} Hz within a burst"
        yield "bursts", f"{starts_s.size} of {pulses} frames"
        if starts_s.size > 1:
            yield "burst rate", f"{1 / np.median(np.diff(starts_s)):.4g} Hz"
    yield "duration", f"{recording.observation_s:.2f} s, {times_s.size} frames"
    if range_m.size > 1:
        yield "range", f"{range_m[0]:.2f} to {range_m[-1]:.2f} m, {range_m.size} bins"
    yield "unambiguous speed", f"± {radar.wavelength_m * radar.prf_hz / 4:.3g} m/s"
    if np.isfinite(recording.snr_frame_db):
        yield "SNR in a frame", f"{recording.snr_frame_db:.1f} dB"
    if recording.seed is not None:
        yield "seed", str(recording.seed)


def _describe_body(number: int, truth: TargetTruth, arrays: Arrays) -> dict[str, Any]:
    from doppelgait.motion.rigid import find_bones
    from doppelgait.viz.motion import find_part_group

    assert truth.body is not None
    points, bones = f"body_{number}_points", f"body_{number}_bones"
    arrays[points] = truth.body.values.astype(np.float32)
    arrays[bones] = find_bones(truth.body.values)
    return {
        "label": truth.label,
        "target": number,
        "time": describe_axis("time", "s", read_axis(truth.body, "time")),
        "points": points,
        "parts": [find_part_group(str(part)) for part in read_axis(truth.body, "part")],
        "bones": bones,
    }


def _describe_truth(number: int, truth: TargetTruth, recording: Recording, arrays: Arrays) -> dict[str, Any]:
    times_s = read_axis(truth.scatterers, "slow_time")
    step = max(1, -(-times_s.size // MOST_LINE_POINTS))
    time = describe_axis("time", "s", times_s[::step])
    groups, lines_hz = part_lines_hz(truth, recording.radar.wavelength_m, step)
    range_name, doppler_name = f"truth_{number}_range", f"truth_{number}_doppler"
    arrays[range_name] = truth.centre_range_m[::step].astype(np.float32)
    arrays[doppler_name] = lines_hz
    return {
        **{fact: getattr(truth, fact) for fact in TRUTH_FACTS},
        "range": range_name,
        "time": time,
        "doppler": {"time": time, "parts": groups, "values": doppler_name},
    }


def part_lines_hz(truth: TargetTruth, wavelength_m: float, step: int) -> tuple[list[str], npt.NDArray[np.float32]]:
    """Return true body-part Doppler at each ``step``-th pulse.
    Scatterers of one part are averaged, because a picture has no room for all of them. Shapes: lines (L, I / step).
    """
    from doppelgait.core.units import velocity_to_doppler_hz
    from doppelgait.viz.motion import find_part_group

    velocity_mps = take_every_row(truth.scatterers["radial_velocity"], step)
    names = [str(part) for part in read_axis(truth.scatterers, "part")]
    parts = sorted(dict.fromkeys(names), key=lambda part: (find_part_group(part), part))
    columns = [[n for n, name in enumerate(names) if name == part] for part in parts]
    lines = [
        np.asarray(velocity_to_doppler_hz(velocity_mps[:, chosen].mean(axis=1), wavelength_m)) for chosen in columns
    ]
    values = np.stack(lines) if lines else np.empty((0, velocity_mps.shape[0]))
    return [find_part_group(part) for part in parts], values.astype(np.float32)


MOST_FRAMES = 600
MOST_PER_REQUEST = 256
MOST_PARTS = (300, 256)
"""Largest numbers of range bins and Doppler rows of a frame; more are combined by their maximum."""
LOOKED_AT = 8
"""Number of frames that determine the levels."""
SLOW_PULSES = 3 * MIN_CPI_PULSES
"""Fewest pulses of a frame's processing interval."""
ONE_BIN = "this radar has no range: see its signature"
IN_BURSTS = "this recording has bursts of pulses; its signature has one column per burst"


@dataclass(frozen=True)
class ShownFrames:
    """Frames of a recording with common levels."""

    columns: npt.NDArray[np.int64]
    db: tuple[float, float]
    shown_db: tuple[float, float]


def make_range_doppler_payload(
    run: Run, gate: GateChoice | None, *, start: int, count: int, changes: Changes = ()
) -> bytes:
    """Make the payload of ``api/range-doppler``."""
    reason = explain_missing_maps(run)
    if reason is not None:
        return pack({"frames": None, "reason": reason}, {})
    clean = run.clean_frames(gate, changes)
    analysis = make_frame_analysis(clean.slow_time, run.analysis(gate, changes))
    wavelength_m = run.require_recording().radar.wavelength_m
    strongest_v = run.keep(f"strongest, {clutter_key(analysis)}", lambda: find_strongest_v(clean))
    frames = run.keep(
        f"frames, {analysis.model_dump_json()}", lambda: plan_frames(clean, analysis, wavelength_m, strongest_v)
    )
    if start >= frames.columns.size:
        raise ConfigError(f"from: {start} is not allowed; this recording has frames 0 to {frames.columns.size - 1}")
    wanted = frames.columns[start : start + count]
    cube = _compute_cube(clean, analysis, wavelength_m, wanted)
    levels = level_db(cube.transpose("time", "range", "doppler").values)
    doppler_hz = read_axis(cube, "doppler")
    ranges = describe_axis("range", "m", read_axis(cube, "range"))
    rows = describe_doppler(doppler_hz, float(2.0 * read_axis(cube, "velocity")[0] / doppler_hz[0]))
    # The resolution of a screen is enough: the strongest cell of every block.
    for dim, facts in ((1, ranges), (2, rows)):
        block = math.ceil(levels.shape[dim] / MOST_PARTS[dim - 1])
        if block > 1:
            levels = np.maximum.reduceat(levels, np.arange(0, levels.shape[dim], block), axis=dim)
            first, step = facts["first"] + (block - 1) / 2 * facts["step"], block * facts["step"]
            facts.update({"first": first, "step": step, "n": levels.shape[dim], "block": block})
    slow_time = clean.slow_time
    centres = plan_for(slow_time, analysis).compute_centre_pulses()[frames.columns]
    times_s = slow_time.start_s + centres / slow_time.rate_hz
    header = {
        "time": describe_axis("time", "s", times_s),
        "from": start,
        "count": int(wanted.size),
        "range": ranges,
        "doppler": rows,
        "db": frames.db,
        "shown_db": frames.shown_db,
        "unit": "dB re 1 V²",
        "cpi_s": analysis.cpi_s,
        "clutter": analysis.clutter,
        "frames": "frames",
        "reason": None,
    }
    return pack(header, {"frames": encode(levels, *frames.db)})


def explain_missing_maps(run: Run) -> str | None:
    """Return why a run has no range-Doppler maps, or None."""
    if run.recording is None:
        return run.reason
    frames = run.recording.frames.find_bursts()
    if frames.n_bins < 2:
        return ONE_BIN
    if frames.slow_time.burst_pulses is not None:
        return IN_BURSTS
    try:
        plan_for(frames.slow_time, make_frame_analysis(frames.slow_time, run.analysis(None)))
    except AnalysisError as error:
        return str(error)
    return None


def make_frame_analysis(slow_time: SlowTime, analysis: Analysis) -> Analysis:
    """Return the analysis of the frames."""
    least_s = SLOW_PULSES / slow_time.rate_hz
    return analysis if analysis.cpi_s >= least_s else analysis.model_copy(update={"cpi_s": least_s})


def find_strongest_v(clean: Frames) -> float:
    """Return the largest amplitude of a recording, reading it in tiles."""
    return max(float(np.abs(values).max()) for _, values in clean.read_tiles())


def plan_frames(clean: Frames, analysis: Analysis, wavelength_m: float, strongest_v: float) -> ShownFrames:
    """Choose the intervals to show, and common levels.
    The upper limit of the levels is that of all echoes in phase.
    """
    transform = plan_for(clean.slow_time, analysis)
    step = math.ceil(transform.n_columns / MOST_FRAMES)
    columns = np.arange(0, transform.n_columns, step)
    looked_at = columns[np.unique(np.linspace(0, columns.size - 1, LOOKED_AT).round().astype(int))]
    levels = level_db(_compute_cube(clean, analysis, wavelength_m, looked_at).values)
    known = levels[np.isfinite(levels)]
    highest = float(known.max()) if known.size else 0.0
    bound = strongest_v * float(transform.window.sum())
    top = float(power_to_db(bound**2)) if bound > 0 else 0.0
    low, high = shown_range_db(levels, highest)
    return ShownFrames(columns, (top - DEEPEST_DB, top), (low, high))


def _compute_cube(
    clean: Frames, analysis: Analysis, wavelength_m: float, columns: npt.NDArray[np.int64]
) -> xr.DataArray:
    blocks = range_doppler(clean.label(), analysis, wavelength_m=wavelength_m, columns=columns)
    return xr.concat(list(blocks), dim="time")


MOST_PITCH = 1e6


def make_sound_wav(run: Run, gate: GateChoice | None, parameters: Mapping[str, str], changes: Changes = ()) -> bytes:
    """Make a target's WAV file of the recording's length."""
    pitch = parse_number("pitch", parameters["pitch"], least=0.0, most=MOST_PITCH) if "pitch" in parameters else None
    channels = parameters.get("channels", get_args(Channels)[0])
    if channels not in get_args(Channels):
        raise ConfigError(f"channels: {channels!r} is not allowed; it must be {' or '.join(get_args(Channels))}")
    frames = run.require_recording().frames
    silent = explain_silence(frames)
    if silent is not None:  # independent of the analysis
        raise AnalysisError(silent)
    targets = run.targets(gate, changes)
    number = parse_whole(parameters, "target", 0, least=0, most=max(len(targets) - 1, 0))
    limits = targets[number].gate_limits if targets else None
    if limits is None:
        raise AnalysisError(f"{run.name}: there is no target with a gate to listen to")
    rate_hz, samples = make_doppler_sound(frames, limits, run.analysis(gate, changes), pitch=pitch, channels=channels)
    file = io.BytesIO()
    write_wav(file, rate_hz, samples)
    return file.getvalue()
