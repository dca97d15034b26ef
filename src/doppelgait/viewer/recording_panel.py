"""What is shown of a recording before any analysis: range against time, bodies, truth, facts."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.core.labels import axis
from doppelgait.processing import burst_pulses_of
from doppelgait.processing.sound import why_silent
from doppelgait.radar.recording import Recording, TargetTruth
from doppelgait.viewer.images import axis_facts, image_facts
from doppelgait.viewer.payload import pack
from doppelgait.viewer.query import Gate
from doppelgait.viewer.run import Run
from doppelgait.viewer.settings import Clutter

Arrays = dict[str, npt.NDArray[Any]]

MOST_LINE_POINTS = 2000
TRUTH_FACTS = (
    "label", "gait", "subject", "height_m", "ground_speed_mps", "stride_frequency_hz", "step_frequency_hz",
    "gait_frequency_hz",
)  # fmt: skip


def recording_payload(run: Run, gate: Gate | None, *, clutter: Clutter | None = None) -> bytes:
    """Payload of ``api/recording``.

    Parameters
    ----------
    run : Run
    gate : str, (float, float) or None
    clutter : {"kept", "removed"}, optional
        Whether range against time shows what stands still, or only what moves; by default as it is analysed in that
        gate.
    """
    recording = run.recording
    if recording is None:
        known = {"name": run.name, "kind": run.kind, "facts": [], "notes": run.notes, "reason": run.reason}
        empty = dict.fromkeys(("duration_s", "start_s", "prf_hz", "wavelength_m", "range_time", "scene"))
        return pack({**known, **empty, "bodies": [], "truth": [], "no_sound": run.reason}, {})
    baseband = run.clean_baseband(gate, clutter)
    times_s = axis(baseband, "slow_time")
    arrays: Arrays = {}
    facts: dict[str, Any] = {
        "name": run.name,
        "kind": run.kind,
        "facts": list(_facts(recording)),
        "notes": [*run.notes, *recording.notes],
        "reason": None,
        "duration_s": recording.observation_s,
        "start_s": times_s[0],
        "prf_hz": recording.radar.prf_hz,
        "wavelength_m": recording.radar.wavelength_m,
        "clutter": run.analysis(gate, clutter).clutter,
        "no_sound": why_silent(recording.baseband),
        "range_time": _range_time(baseband, arrays),
        "scene": _scene(recording),
        "bodies": [
            _body(number, truth, arrays) for number, truth in enumerate(recording.truth) if truth.body is not None
        ],
        "truth": [_truth(number, truth, recording, arrays) for number, truth in enumerate(recording.truth)],
    }
    return pack(facts, arrays)


def _facts(recording: Recording) -> Iterator[tuple[str, str]]:
    radar, baseband = recording.radar, recording.baseband
    range_m = axis(baseband, "range")
    yield "radar", radar.name or radar.waveform
    yield "carrier", f"{radar.carrier_hz / 1e9:.4g} GHz"
    yield from _time_facts(recording)
    if range_m.size > 1:
        yield "range", f"{range_m[0]:.2f} to {range_m[-1]:.2f} m, {range_m.size} bins"
    yield "unambiguous speed", f"± {radar.wavelength_m * radar.prf_hz / 4:.3g} m/s"
    if np.isfinite(recording.snr_frame_db):
        yield "SNR in a frame", f"{recording.snr_frame_db:.1f} dB"
    if recording.seed is not None:
        yield "seed", str(recording.seed)


def _time_facts(recording: Recording) -> Iterator[tuple[str, str]]:
    """Rate and number of frames; of a recording in bursts, of the bursts and of the frames in them."""
    times_s, prf_hz = axis(recording.baseband, "slow_time"), recording.radar.prf_hz
    pulses = burst_pulses_of(recording.baseband)
    if pulses is None:
        yield "frame rate", f"{prf_hz:.4g} Hz"
        yield "duration", f"{recording.observation_s:.2f} s, {times_s.size} frames"
        return
    starts_s = times_s[::pulses]
    yield "frame rate", f"{prf_hz:.4g} Hz within a burst"
    yield "bursts", f"{starts_s.size} of {pulses} frames"
    if starts_s.size > 1:
        yield "burst rate", f"{1 / np.median(np.diff(starts_s)):.4g} Hz"
    yield "duration", f"{recording.observation_s:.2f} s, {times_s.size} frames"


def _range_time(baseband: xr.DataArray, arrays: Arrays) -> dict[str, Any] | None:
    """Magnitudes over range and time; None for a radar without range."""
    range_m = axis(baseband, "range")
    if range_m.size < 2:
        return None
    values = baseband.values
    facts, arrays["range_time"] = image_facts(
        "range_time",
        values.real**2 + values.imag**2,
        axis_facts("time", "s", axis(baseband, "slow_time")),
        axis_facts("range", "m", range_m),
        unit="dB re 1 V",
    )
    return facts


def _scene(recording: Recording) -> dict[str, Any] | None:
    if recording.radar_position_m is None:
        return None
    return {
        "radar_position_m": recording.radar_position_m,
        "azimuth_deg": recording.radar_azimuth_deg,
        "tilt_deg": recording.radar_tilt_deg,
    }


def _body(number: int, truth: TargetTruth, arrays: Arrays) -> dict[str, Any]:
    from doppelgait.motion.bones import bones_of
    from doppelgait.viz.body import part_group

    assert truth.body is not None
    points, bones = f"body_{number}_points", f"body_{number}_bones"
    arrays[points] = truth.body.values.astype(np.float32)
    arrays[bones] = bones_of(truth.body.values)
    return {
        "label": truth.label,
        "target": number,
        "time": axis_facts("time", "s", axis(truth.body, "time")),
        "points": points,
        "parts": [part_group(str(part)) for part in axis(truth.body, "part")],
        "bones": bones,
    }


def _truth(number: int, truth: TargetTruth, recording: Recording, arrays: Arrays) -> dict[str, Any]:
    times_s = axis(truth.scatterers, "slow_time")
    step = max(1, -(-times_s.size // MOST_LINE_POINTS))
    time = axis_facts("time", "s", times_s[::step])
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
    """True Doppler of every body part at each ``step``-th pulse, with the part's group.

    Scatterers of one part are averaged: a picture has no room for all of them.

    Returns
    -------
    groups : list of str, length L
    lines : ndarray, shape (L, I / step)
        Hz.
    """
    from doppelgait.core.units import velocity_to_doppler_hz
    from doppelgait.viz.body import part_group

    velocity_mps = truth.scatterers["radial_velocity"].values[::step]
    names = [str(part) for part in axis(truth.scatterers, "part")]
    parts = sorted(dict.fromkeys(names), key=lambda part: (part_group(part), part))
    columns = [[n for n, name in enumerate(names) if name == part] for part in parts]
    lines = [
        np.asarray(velocity_to_doppler_hz(velocity_mps[:, chosen].mean(axis=1), wavelength_m)) for chosen in columns
    ]
    values = np.stack(lines) if lines else np.empty((0, velocity_mps.shape[0]))
    return [part_group(part) for part in parts], values.astype(np.float32)
