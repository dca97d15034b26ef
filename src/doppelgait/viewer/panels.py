"""Panels of a recording and of its targets: pictures, lines, features, sound."""

from __future__ import annotations

import io
import math
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from hashlib import sha256
from time import monotonic
from typing import Any, get_args

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait import processing
from doppelgait.core.errors import AnalysisError, ConfigError, DoppelgaitError
from doppelgait.core.frames import Frames, SlowTime
from doppelgait.core.labels import read_axis
from doppelgait.core.lazy import LateRows, lazy_rows, take_every_row
from doppelgait.core.units import power_to_db
from doppelgait.pipeline import Result
from doppelgait.pipeline.target import ALIGNED
from doppelgait.processing import Analysis, range_doppler
from doppelgait.processing.bursts import make_frame_gate
from doppelgait.processing.config import MIN_CPI_PULSES
from doppelgait.processing.gate import GateChoice
from doppelgait.processing.signature import plan_for
from doppelgait.processing.sound import Channels, explain_silence, make_doppler_sound, write_wav
from doppelgait.radar.recording import Recording, TargetTruth
from doppelgait.viewer import payload
from doppelgait.viewer.run import Run, TargetView, clutter_key, make_gate_picture
from doppelgait.viewer.settings import Changes, parse_number, parse_whole

Arrays = dict[str, npt.NDArray[Any]]

MOST_LINE_POINTS = 2000
END_PULSES = 64  # at each end of a recording, which identify it
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


def make_recording_payload(run: Run, gate: GateChoice | None, changes: Changes = ()) -> bytes:
    """Make the payload of ``api/recording``."""
    recording = run.recording
    known: dict[str, Any] = {"name": run.name, "kind": run.kind, "content": identify_content(run)}
    if recording is None:
        known |= {"facts": [], "notes": run.notes, "reason": run.reason}
        empty = dict.fromkeys(("duration_s", "start_s", "range_time", "signature", "scene"))
        return payload.pack({**known, **empty, "bodies": [], "truth": [], "no_sound": run.reason}, {})
    clean, analysis = run.clean_frames(gate, changes), run.analysis(gate, changes)
    times_s, ranges, arrays, signature = clean.slow_time.time_s, Arrays(), Arrays(), None
    with ThreadPoolExecutor(1) as pool:  # each picture reads the whole recording
        range_time = pool.submit(_make_range_time, clean, ranges)
        if run.kind == "recording":  # of all ranges, until the targets have been tracked
            with suppress(AnalysisError):
                hop = payload.find_block_size(clean.n_pulses, payload.MOST[0])
                hop = max(hop, plan_for(clean.slow_time, analysis).hop)
                coarse = analysis.model_copy(update={"hop": hop})
                signature, arrays["signature"] = make_gate_picture(
                    clean, make_frame_gate(clean), coarse, recording.radar.wavelength_m
                )
    arrays = {**ranges, **arrays}
    facts: dict[str, Any] = {
        **known,
        "facts": list(_list_facts(recording)),
        "notes": [*run.notes, *recording.notes],
        "reason": None,
        "duration_s": recording.observation_s,
        "start_s": times_s[0],
        "clutter": analysis.clutter,
        "analysis": run.analysis_facts(gate, changes),
        "no_sound": explain_silence(recording.frames),
        "range_time": range_time.result(),
        "signature": signature,
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
    return payload.pack(facts, arrays)


def identify_content(run: Run) -> str:
    """Return a key of what is shown, for annotations: two files may have one name."""
    if run.recording is None:
        parts = [repr([run.name, *(view.result.features for view in (run.stored or tuple)())]).encode()]
    else:
        frames = run.recording.frames
        n, last = frames.n_pulses, max(frames.n_pulses - END_PULSES, 0)
        ends = frames.read(0, END_PULSES), frames.read(last, n)
        arrays = frames.slow_time.time_s, frames.range_m, *ends
        parts = [np.ascontiguousarray(one).tobytes() for one in arrays]
    return sha256(b"".join(parts)).hexdigest()[:16]


def _make_range_time(clean: Frames, arrays: Arrays) -> dict[str, Any] | None:
    """Encode range against time; None without range."""
    if clean.n_bins < 2:
        return None
    time = payload.describe_axis("time", "s", clean.slow_time.time_s)
    ranges = payload.describe_axis("range", "m", clean.range_m)
    image, arrays["range_time"] = payload.encode_image("range_time", _make_power(clean), time, ranges, unit="dB re 1 V")
    return image


def _make_power(clean: Frames) -> xr.DataArray:
    def rows(first: int, stop: int) -> npt.NDArray[np.float32]:
        values = clean.read(first, stop)
        return np.asarray(values.real**2 + values.imag**2)

    return clean.label().copy(data=lazy_rows(LateRows(clean.shape, rows, np.float32)))


def make_detail_payload(
    run: Run, gate: GateChoice | None, parameters: Mapping[str, str], changes: Changes = ()
) -> bytes:
    """Make the payload of ``api/detail``: pictures of a span of time, on a finer grid."""
    start_s, stop_s = (parse_number(key, parameters.get(key, "")) for key in ("from", "to"))
    clean, analysis = run.clean_frames(gate, changes), run.analysis(gate, changes)
    chosen = make_frame_gate(clean)
    if "target" in parameters:
        targets = run.targets(gate, changes)
        number = parse_whole(parameters, "target", 0, least=0, most=len(targets) - 1)
        chosen = targets[number].result.gate
    facts, arrays = dict[str, Any](range_time=None, signature=None), dict[str, Any]()
    if clean.slow_time.burst_pulses is None:  # a burst is a column, and cannot be divided
        margin_s = analysis.cpi_s / 2.0
        part = clean.take_pulses(clean.slow_time.find_pulses(start_s - margin_s, stop_s + margin_s))
        if not part.n_pulses or stop_s <= start_s:  # of two recordings one is shorter
            return payload.pack(facts, arrays)
        with suppress(AnalysisError):  # shorter than a processing interval, or without the target
            hop = min(max(part.n_pulses // payload.MOST[0], 1), plan_for(part.slow_time, analysis).hop)
            fine = analysis.model_copy(update={"hop": hop})
            facts["signature"], arrays["signature"] = make_gate_picture(
                part, chosen, fine, run.require_recording().radar.wavelength_m
            )
        facts["range_time"] = _make_range_time(part, arrays)
    return payload.pack(facts, arrays)


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
    from doppelgait.motion.skeleton import find_bones
    from doppelgait.viz.motion import find_part_group

    assert truth.body is not None
    points, bones = f"body_{number}_points", f"body_{number}_bones"
    arrays[points] = truth.body.values.astype(np.float32)
    arrays[bones] = find_bones(truth.body.values)
    return {
        "label": truth.label,
        "target": number,
        "time": payload.describe_axis("time", "s", read_axis(truth.body, "time")),
        "points": points,
        "parts": [find_part_group(str(part)) for part in read_axis(truth.body, "part")],
        "bones": bones,
    }


def _describe_truth(number: int, truth: TargetTruth, recording: Recording, arrays: Arrays) -> dict[str, Any]:
    times_s = read_axis(truth.scatterers, "slow_time")
    step = max(1, -(-times_s.size // MOST_LINE_POINTS))
    time = payload.describe_axis("time", "s", times_s[::step])
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
    """Return the true mean Doppler of body parts, (L, I / step)."""
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
SLOW_PULSES = 3 * MIN_CPI_PULSES  # fewest pulses of a frame's processing interval
ONE_BIN = "this radar has no range: see its signature"
IN_BURSTS = "this recording has bursts of pulses; its signature has one column per burst"


def make_range_doppler_payload(
    run: Run, gate: GateChoice | None, *, start: int, count: int, changes: Changes = ()
) -> bytes:
    """Make the payload of ``api/range-doppler``."""
    reason = explain_missing_maps(run)
    if reason is not None:
        return payload.pack({"frames": None, "reason": reason}, {})
    clean = run.clean_frames(gate, changes)
    analysis = make_frame_analysis(clean.slow_time, run.analysis(gate, changes))
    wavelength_m = run.require_recording().radar.wavelength_m
    strongest_v = run.keep(f"strongest, {clutter_key(analysis)}", lambda: find_strongest_v(clean))
    transform = plan_for(clean.slow_time, analysis)
    columns = np.arange(0, transform.n_columns, math.ceil(transform.n_columns / MOST_FRAMES))
    bound = strongest_v * float(transform.window.sum())  # of all frames: their levels have one code
    top = float(power_to_db(bound**2)) if bound > 0 else 0.0
    low_high = (top - payload.DEEPEST_DB, top)
    if start >= columns.size:
        raise ConfigError(f"from: {start} is not allowed; this recording has frames 0 to {columns.size - 1}")
    wanted = columns[start : start + count]
    cube = _compute_cube(clean, analysis, wavelength_m, wanted)
    levels = payload.level_db(cube.transpose("time", "range", "doppler").values)
    doppler_hz = read_axis(cube, "doppler")
    ranges = payload.describe_axis("range", "m", read_axis(cube, "range"))
    rows = payload.describe_doppler(doppler_hz, float(2.0 * read_axis(cube, "velocity")[0] / doppler_hz[0]))
    # The resolution of a screen is enough: the strongest cell of every block.
    blocks = [payload.find_block_size(size, most) for size, most in zip(levels.shape[1:], MOST_PARTS, strict=True)]
    levels = payload.find_block_maxima(levels, 1, *blocks)
    ranges, rows = (payload.average_axis(facts, block) for facts, block in zip((ranges, rows), blocks, strict=True))
    slow_time = clean.slow_time
    times_s = slow_time.start_s + transform.compute_centre_pulses()[columns] / slow_time.rate_hz
    header = {
        "time": payload.describe_axis("time", "s", times_s),
        "from": start,
        "count": int(wanted.size),
        "range": ranges,
        "doppler": rows,
        "db": low_high,
        "unit": "dB re 1 V²",
        "cpi_s": analysis.cpi_s,
        "clutter": analysis.clutter,
        "frames": "frames",
        "reason": None,
    }
    return payload.pack(header, {"frames": payload.encode(levels, *low_high)})


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


def _compute_cube(
    clean: Frames, analysis: Analysis, wavelength_m: float, columns: npt.NDArray[np.int64]
) -> xr.DataArray:
    blocks = range_doppler(clean.label(), analysis, wavelength_m=wavelength_m, columns=columns)
    return xr.concat(list(blocks), dim="time")


DECIDE_S = 0.5  # longest time, s, of an answer with decisions; the page asks again for the rest


def make_decisions(run: Run, gate: GateChoice | None, start: int) -> dict[str, Any]:
    """Return the answer of ``api/decisions``: those of ``classify``, from a number on."""
    from doppelgait.classify.decide import choose_model
    from doppelgait.classify.timeline import decide_windows
    from doppelgait.viewer.live_page import describe_decision, describe_model

    none: dict[str, Any] = {"stop_s": None, "complete": False, "reason": "", "marks": []}
    end_s = monotonic() + DECIDE_S

    def begin() -> tuple[Any, dict[str, Any], list[Any]]:
        recording, chosen = run.require_recording(), gate or run.settings.gate
        model = run.settings.model or choose_model(recording)
        about = describe_model(model.of_tracks if chosen == "track" else model)
        return decide_windows(recording, model, gate=chosen), {**about, **none}, []

    try:
        windows, facts, marks = run.keep(f"decisions, {gate}", begin)
    except DoppelgaitError as error:
        return {**none, "complete": True, "reason": str(error)}
    try:
        while not facts["complete"] and monotonic() < end_s:
            window, decisions = next(windows, (None, []))
            marks += [describe_decision(one, facts["shown_class"]) for one in decisions]
            facts |= {"complete": True} if window is None else {"stop_s": window.stop_s}
    except DoppelgaitError as error:
        facts |= {"complete": True, "reason": str(error)}
    return {**facts, "marks": marks[start:]}


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
    limits = targets[number].result.gate_limits if targets else None
    if limits is None:
        raise AnalysisError(f"{run.name}: there is no target with a gate to listen to")
    rate_hz, samples = make_doppler_sound(frames, limits, run.analysis(gate, changes), pitch=pitch, channels=channels)
    file = io.BytesIO()
    write_wav(file, rate_hz, samples)
    return file.getvalue()


MOST_GATE_POINTS = 2000
HARMONIC_NAMES = ("2nd", "3rd")
NO_TARGET = "no target is detected: this recording has no steady motion and no breathing; try another gate"


def make_targets_payload(
    run: Run, gate: GateChoice | None, changes: Changes = (), *, segment: tuple[int, int] | None = None
) -> bytes:
    """Make the payload of ``api/targets``."""
    arrays: Arrays = {}
    # Stored targets are shown as stored, independently of the request.
    applied = () if gate is None and run.stored is not None else changes
    done = run.analysis(gate, applied)
    facts = {"clutter": done.clutter, "analysis": run.analysis_facts(gate, applied)}
    try:
        targets, notes = run.analyse(gate, changes)
    except AnalysisError as error:
        return payload.pack({**facts, "targets": [], "reason": str(error), "notes": [], "failed": True}, {})
    views = targets if segment is None else select_segment(targets, *segment)
    shown = [_describe_target(number, view, done.method, arrays) for number, view in enumerate(views)]
    reason = None if shown else NO_TARGET
    return payload.pack(
        {**facts, "targets": shown, "reason": reason, "notes": [*_note_limits(gate, views), *notes]}, arrays
    )


def _note_limits(gate: GateChoice | None, views: Sequence[TargetView]) -> list[str]:
    """Note the range used of a gate beyond the frame."""
    limits = views[0].result.gate_limits if views else None
    if not isinstance(gate, tuple) or limits is None or limits.source != "given":
        return []
    used_m = float(limits.low_m.min()), float(limits.high_m.max())
    if np.allclose(used_m, gate, rtol=0.0, atol=1e-6):
        return []
    frame = "extends beyond the recorded frame"
    return [f"gate {gate[0]:g} to {gate[1]:g} m {frame}: {used_m[0]:.2f} to {used_m[1]:.2f} m is used"]


def select_segment(targets: Sequence[TargetView], number: int, segment: int) -> list[TargetView]:
    """Replace a target's view by that of another segment."""
    if number >= len(targets):
        known = f"there are targets 0 to {len(targets) - 1}" if targets else "there is no target"
        raise ConfigError(f"segment: {number}:{segment} is not allowed; {known}")
    views = targets[number].segment_views
    if segment >= len(views):
        known = f"has segments 0 to {len(views) - 1}" if views else "is shown as a whole"
        raise ConfigError(f"segment: {number}:{segment} is not allowed; target {number} {known}")
    shown = replace(views[segment], segment_views=views, track_picture=targets[number].track_picture)
    return [*targets[:number], shown, *targets[number + 1 :]]


def _describe_target(number: int, view: TargetView, method: str, arrays: Arrays) -> dict[str, Any]:
    prefix, result = f"target_{number}_", view.result
    signature, cadence_map = (_get_array(result, name) for name in ("signature", "cadence_map"))
    pictures: dict[str, dict[str, Any] | None] = {"signature": None, "cadence_map": None}
    if view.track_picture is not None:
        facts, arrays[f"{prefix}signature"] = view.track_picture
        pictures["signature"] = {**facts, "array": f"{prefix}signature"}
    elif signature is not None:
        pictures["signature"], arrays[f"{prefix}signature"] = payload.signature_picture(signature, f"{prefix}signature")
    lines = view.segment_views if view.track_picture is not None else (view,)
    main_lines = [_main_line(line.result, f"{prefix}main_line_{n}", arrays) for n, line in enumerate(lines)]
    if cadence_map is not None:
        cadence = payload.describe_axis("cadence", "Hz", read_axis(cadence_map, "cadence"))
        name = f"{prefix}cadence_map"
        power = np.square(cadence_map.values)
        pictures["cadence_map"], arrays[name] = payload.doppler_picture(cadence_map, power, cadence, name, "dB re 1")
    spectrum = _describe_spectrum(result, f"{prefix}cadence_spectrum", method, arrays)
    gate_limits = None
    if result.gate_limits is not None:
        gate = result.gate_limits
        count = gate.time_s.size
        chosen = np.unique(np.linspace(0, count - 1, min(count, MOST_GATE_POINTS)).round().astype(int))
        limits = {"time": gate.time_s, "low": gate.low_m, "high": gate.high_m}
        arrays.update({f"{prefix}gate_{key}": values[chosen].astype(np.float32) for key, values in limits.items()})
        gate_limits = {key: f"{prefix}gate_{key}" for key in limits}
    return {
        "number": number,
        "label": result.label,
        "gate": result.gate_source,
        "features": {
            **result.features.as_dict(),
            "gait_frequency_hz": result.gait_frequency_hz,
            "torso_doppler_hz": result.torso_doppler_hz,
        },
        "standard_deviation": result.standard_deviation,
        "quality": result.quality,
        "extended": result.extended,
        "flags": result.flags,
        "truth": view.truth,
        "signature": pictures["signature"],
        "main_lines": [line for line in main_lines if line is not None],
        "aligned": is_aligned(result, method),
        "cadence_map": pictures["cadence_map"],
        "cadence_spectrum": spectrum,
        "gate_limits": gate_limits,
        "segments": view.spans,
        "segment": view.segment,
    }


def _get_array(result: Result, name: str) -> xr.DataArray | None:
    array = result.arrays.get(name)
    return array if array is not None and array.size else None


def _main_line(result: Result, name: str, arrays: Arrays) -> dict[str, Any] | None:
    """Describe a segment's main line at the picture's columns."""
    line_hz, signature = result.arrays.get("main_line_hz"), result.arrays.get("signature")
    if signature is None or signature.sizes["time"] == 0 or line_hz is None:
        return None
    times_s = read_axis(signature, "time")
    block = payload.find_block_size(times_s.size, payload.MOST[0])
    at = np.arange(0, times_s.size, block) + (block - 1) / 2
    columns = np.arange(times_s.size)
    arrays[name] = np.interp(at, columns, line_hz).astype(np.float32)
    return {"x": payload.describe_axis("time", "s", np.interp(at, columns, times_s)), "values": name}


def is_aligned(result: Result, method: str) -> bool | None:
    """Return True if the map's Doppler is relative."""
    cadence_map, signature = result.arrays.get("cadence_map"), result.arrays.get("signature")
    if method == "liland2018" or cadence_map is None:
        return None if cadence_map is None else False
    if ALIGNED in cadence_map.attrs:
        return bool(cadence_map.attrs[ALIGNED])
    if signature is None or signature.sizes["time"] < 2:
        return None
    return processing.needs_alignment(signature)  # stored by an older version, or in a dataset


def _describe_spectrum(result: Result, name: str, method: str, arrays: Arrays) -> dict[str, Any] | None:
    """Describe the cadence spectrum in dB with its peaks."""
    spectrum, f_mu_hz = _get_array(result, "cadence_spectrum"), result.gait_frequency_hz
    if spectrum is None:
        return None
    values = np.square(spectrum.values) if method == "liland2018" else spectrum.values
    arrays[name] = payload.level_db(values).astype(np.float32)
    ratios = (1.0, result.features.harmonic_ratio_2, result.features.harmonic_ratio_3)
    named_hz = {
        label: ratio * f_mu_hz
        for label, ratio in zip(("f_mu", *HARMONIC_NAMES), ratios, strict=True)
        if ratio is not None and f_mu_hz is not None
    }
    return {
        "x": payload.describe_axis("cadence", "Hz", read_axis(spectrum, "cadence")),
        "db": name,
        "unit": "dB re 1",
        "peaks": [{"hz": hz, "name": label} for label, hz in named_hz.items()],
    }
