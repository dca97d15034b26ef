"""Analysis of a recording: signature, cadence map and features."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from doppelgait.core.config import check_type
from doppelgait.core.errors import AnalysisError, ConfigError, explain_memory
from doppelgait.core.frames import Frames
from doppelgait.pipeline.rangeless import correct_receiver
from doppelgait.pipeline.result import Result, TargetList
from doppelgait.pipeline.target import MAX_SHARED, SHARED, Gated, analyze_targets, compute_gated, mark_other_bodies
from doppelgait.pipeline.tracking import LOST_SHARE, Tracking, track_targets
from doppelgait.pipeline.verdicts import is_echo
from doppelgait.processing import Analysis, Gate
from doppelgait.processing.clutter import clean_frames
from doppelgait.processing.detect import Detector
from doppelgait.processing.gate import GateChoice
from doppelgait.radar.readers import read_recording
from doppelgait.radar.recording import Recording


@explain_memory
def analyze(
    recording: Recording | str | Path,
    *,
    gate: GateChoice | Gate | str = "track",
    analysis: Analysis | None = None,
    tracking: Tracking | None = None,
    gate_error_m: float = 0.0,
) -> TargetList:
    """Analyse a recording, simulated or measured.

    Parameters
    ----------
    recording : Recording, str or Path
        A path is read as by :func:`doppelgait.radar.read_recording`.
    gate : {"track", "truth"}, (float, float), text such as ``"1.2:2.8"``, or Gate
        ``track`` (the default) detects and tracks moving bodies without any truth, and detects motionless people by
        breathing; it removes static clutter even if ``analysis`` does not require it. ``truth`` uses the true range of
        the body in a simulated recording, and no other truth. Two numbers are a fixed gate between these ranges in m. A
        :class:`doppelgait.processing.Gate` is used unchanged.
    analysis : Analysis, optional
        Parameters; the defaults of :class:`doppelgait.processing.Analysis`.
    tracking : Tracking, optional
        Parameters of ``track``.
    gate_error_m : float
        Constant range error added to a truth gate, like the error of a tracker.

    Returns
    -------
    TargetList of Result
        One result per target of the truth or per track, or one result for a fixed gate. If nothing
        is detected, the list is empty and its ``reason`` states why.

    Raises
    ------
    AnalysisError
        If the recording has no truth for the gate, or is too short.
    ConfigError
        If an argument is not allowed.
    RecordingError
        If the file cannot be read.

    See Also
    --------
    simulate : simulate a recording.

    Examples
    --------
    >>> import doppelgait as dg
    >>> recording = dg.data.sample()
    >>> result = dg.analyze(recording, gate="truth")[0]
    >>> round(result.features.torso_velocity_mps, 1)
    1.2
    """
    if isinstance(recording, str | Path):
        recording = read_recording(recording)
    check_type(recording, Recording, "recording", "give a path, or doppelgait.radar.read_recording(PATH)")
    check_type(analysis, (Analysis, type(None)), "analysis", "make one with doppelgait.Analysis(...)")
    if not isinstance(gate, Gate):
        gate = Gate.parse(gate, where="gate")
    check_type(tracking, (Tracking, type(None)), "tracking", "make it with doppelgait.pipeline.Tracking(...)")
    check_type(gate_error_m, (float, int), "gate_error_m", "give a number of m")
    if not math.isfinite(gate_error_m) or (gate_error_m != 0 and gate != "truth"):
        raise ConfigError(f"gate_error_m: {gate_error_m} is not allowed; it must be a finite number, with gate='truth'")
    pieces = recording.split_at_pauses()
    if len(pieces) > 1:
        parts = [_analyze_piece(piece, gate, analysis, tracking, gate_error_m) for piece in pieces]
        return join_pieces(parts, has_range=recording.n_range_bins > 1)
    recording = pieces[0]
    settings = (analysis or Analysis()).resolved(gate)
    if gate == "track":
        frames, radar, source = recording.frames, recording.radar, recording.source
        del recording  # tracking does not use the truth, which is large
        found = track_targets(frames, radar, source, settings, tracking or Tracking())
        return TargetList(flag_filled(flag_overlaps(found), frames), reason=found.reason)
    gated = compute_signatures(recording, gate, settings, gate_error_m)
    marked = [mark_other_bodies(one, [other.gate for other in gated if other is not one]) for one in gated]
    results = analyze_together([marked])[0]
    return TargetList(flag_filled(results, recording.frames))


def _analyze_piece(piece: Recording, gate: Gate | GateChoice, *settings: Any) -> TargetList:
    """Analyse a part between pauses; one that is too short has no targets."""
    analysis, tracking, gate_error_m = settings
    try:
        return analyze(piece, gate=gate, analysis=analysis, tracking=tracking, gate_error_m=gate_error_m)
    except AnalysisError as error:
        start_s, stop_s = piece.slow_time_s[[0, -1]]
        return TargetList(reason=f"from {start_s:.4g} to {stop_s:.4g} s: {error}")


def join_pieces(pieces: Sequence[TargetList], *, has_range: bool) -> TargetList:
    """Join the results of one body around a pause; the values are those of the longest part."""
    bodies: list[list[Result]] = []
    for piece in pieces:
        free = list(bodies)
        for result in piece:
            fits = [body for body in free if _continues(body[-1], result, has_range=has_range)]
            if len(fits) == 1:
                free.remove(fits[0])
                fits[0].append(result)
            else:
                bodies.append([result])
    joined = []
    for body in bodies:
        segments = tuple(segment for part in body for segment in part.segments or (part,))
        longest = max(body, key=lambda part: np.ptp(part.gate.time_s))
        quality = {**longest.quality, "n_pieces": len(segments)}
        joined.append(longest if len(body) == 1 else replace(longest, segments=segments, quality=quality))
    reasons = list(dict.fromkeys(piece.reason for piece in pieces if piece.reason))
    more = [f"{len(reasons) - 2} further parts have no target either"] if len(reasons) > 3 else reasons[2:]
    return TargetList(joined, reason="; ".join([*reasons[:2], *more]))


def _continues(before: Result, after: Result, *, has_range: bool) -> bool:
    """Return True if targets before and after a pause may be one."""
    if before.label != after.label or before.gate_source != after.gate_source:
        return False
    if before.gate_source != "track":
        return True
    pause_s = float(after.gate.time_s[0] - before.gate.time_s[-1])
    if pause_s > MAX_PAUSE_S:
        return False
    speed_mps, later_mps = (one.features.torso_velocity_mps or 0.0 for one in (before, after))
    if not has_range:  # the same direction and speed are all that is known
        return speed_mps * later_mps == 0.0 or 1.0 / SAME_SPEED < later_mps / speed_mps < SAME_SPEED
    ends_m = [float(one.gate.centre_at(one.gate.time_s)[n]) for one, n in ((before, -1), (after, 0))]
    return abs(ends_m[1] - ends_m[0] + speed_mps * pause_s) <= NEAR_M + abs(speed_mps) * pause_s / 2


MAX_PAUSE_S, SAME_SPEED = 5.0, 1.3
"""Longest pause of a walker in a room of some metres, and largest ratio of the speeds of one body without range."""
NEAR_M = 1.0
"""Distance from where a body is expected after a pause below which a target is the same body."""


def compute_signatures(
    recording: Recording, gate: Gate | GateChoice, settings: Analysis, gate_error_m: float
) -> list[Gated]:
    """Compute the signatures of a recording's targets, in gates of their truth or a given one."""
    frames, times_s, wavelength_m = recording.frames, recording.slow_time_s, recording.radar.wavelength_m
    if gate != "truth":
        frames = correct_receiver(frames, Detector(), wavelength_m=wavelength_m)
    if isinstance(gate, tuple):
        gate = Gate.fixed(*gate, time_s=times_s, range_m=recording.range_m)
    gates: list[tuple[Gate, str | None]]  # with target labels
    if isinstance(gate, Gate):
        gates = [(gate, None)]
    elif not (bodies := [truth for truth in recording.truth if np.isfinite(truth.centre_range_m).any()]):
        raise AnalysisError(
            f"{recording.source}: has no truth of a body; use gate track or a range, for example 1.2:2.8"
        )
    else:
        about = partial(Gate.from_truth, wavelength_m=wavelength_m, error_m=gate_error_m)
        gates = [(about(truth, times_s, settings), truth.label or None) for truth in bodies]
    if settings.clutter != "none":  # static clutter is removed from bins that the gates touch
        range_m, sharp = frames.range_m, settings.sharp_edges
        touched = [own.touched_bins(*own.edges(range_m, times_s, sharp=sharp), range_m) for own, _ in gates]
        bins = slice(min(cells.start for cells in touched), max(cells.stop for cells in touched))
        frames = clean_frames(frames, settings, bins=bins)
    return [compute_gated(frames, wavelength_m, own, settings, label) for own, label in gates]


def analyze_together(recordings: Sequence[Sequence[Gated]]) -> list[TargetList]:
    """Analyse the targets of many recordings together."""
    results = iter(analyze_targets([target for targets in recordings for target in targets]))
    return [TargetList(flag_overlaps([next(results) for _ in targets])) for targets in recordings]


def flag_filled(results: Sequence[Result], frames: Frames) -> Sequence[Result]:
    """Flag the bandwidth, beyond twice the share the velocity, beyond a third the gait, where pulses were filled."""
    share = float(frames.facts.get("lost_frame_share", 0.0))
    if share <= LOST_SHARE:
        return results
    limits = {"doppler_bandwidth": LOST_SHARE, "torso_velocity": 2.0 * LOST_SHARE, "gait_frequency": 1.0 / 3.0}
    flags = tuple(
        f"{name}:{100 * share:.0f}_per_cent_of_the_frames_were_lost" for name, limit in limits.items() if share > limit
    )
    return [
        replace(one, flags=(*one.flags, *flags), segments=tuple(flag_filled(one.segments, frames))) for one in results
    ]


def flag_overlaps(results: Sequence[Result]) -> list[Result]:
    """Flag results with ``gates_overlap`` where another target shares range."""
    flagged = []
    for number, result in enumerate(results):
        times_s, about = result.gate.time_s, result.quality
        counted = not result.segments or (times_s >= about["start_s"]) & (times_s <= about["stop_s"])
        others = (other for other in results if other is not result)
        near = [other for other in others if (result.gate.shares(other.gate) & counted).any()]
        found = {"own_echo_in_gate" if is_echo(other, number) else "gates_overlap" for other in near}
        if about.get(SHARED, 1.0) <= MAX_SHARED:  # what is left out is short, and the rest stands for the whole
            found = set()
        flagged.append(replace(result, flags=(*result.flags, *sorted(found))) if found else result)
    return flagged
