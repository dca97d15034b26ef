"""Detection without truth: moving bodies and breathing persons."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from doppelgait.core.config import FrozenModel
from doppelgait.core.errors import AnalysisError, warn_caller
from doppelgait.core.frames import Frames
from doppelgait.core.samples import Samples
from doppelgait.core.units import FloatArray
from doppelgait.features import GaitFeatures
from doppelgait.pipeline import rangeless
from doppelgait.pipeline.result import Result, TargetList
from doppelgait.pipeline.target import analyze_gated, analyze_targets, compute_gated, mark_other_bodies
from doppelgait.pipeline.verdicts import judge
from doppelgait.processing import Analysis, Gate
from doppelgait.processing.breathing import BreathingSettings, BreathingTarget, explain_no_breathing, find_breathing
from doppelgait.processing.bursts import average_bursts
from doppelgait.processing.clutter import (
    clean_frames,
    measure_removed,
    predict_torso_share_removed,
    remove_common_phase,
    remove_from_frames,
    sum_pulses,
)
from doppelgait.processing.config import MIN_CPI_PULSES
from doppelgait.processing.detect import Detector
from doppelgait.processing.detect.maps import compute_maps, noise_factor
from doppelgait.processing.detect.scans import detect_bodies
from doppelgait.processing.receiver import read_flags
from doppelgait.processing.track import Track, Tracker, split_tracks, track
from doppelgait.processing.track.live import Scan
from doppelgait.processing.track_segments import SegmentationSettings, find_track_segments
from doppelgait.radar import Radar

OTHER_SIGN = "of a body whose range and Doppler contradict each other: conjugate the samples"
NEAR_M = 1.0  # distance between a breath and a track below which both are of the same body
LEAST_RANGE_M = 0.01
LOST_SHARE = 0.02
"""Share of lost and filled frames above which the bandwidth is flagged; 1 % of single frames widens it by 3 %."""
CLUTTER_SHARE = 0.2  # of a gate's power removed with the clutter, above which the torso may be, too
STILL_REACH_M = 0.3
SAME_PLACE_M = 0.6  # distance from the end of a track to the start of a later one that may be of the same body
LONGEST_REST_S = 10.0  # of a body between two tracks, unless a person breathes there in between
STILL_SPEED_MPS, MIN_REST_S = 0.1, 2.0
REST_SPEED_MPS, START_SPEED_MPS = 0.6, 1.0
"""Highest speeds before and after a rest; a body that starts has moved for some time when it is first detected."""
EDGE_M = 0.5  # distance from an end of the range frame below which a lost body has left the frame
TRACK_SD_QUANTILE = 0.25
"""Quantile of the range errors that is the error of a track; scans in another body's detection have larger errors."""


class Tracking(FrozenModel):
    """Parameters of ``gate = "track"``.

    detector: Clutter, thresholds and clusters of one scan.
    tracker: Association of detections with tracks from scan to scan.
    pieces: Division of a track into segments of steady motion.
    breathing: Detection of people who keep still, by their breathing.
    """

    detector: Detector = Detector()
    tracker: Tracker = Tracker()
    pieces: SegmentationSettings = SegmentationSettings()
    breathing: BreathingSettings = BreathingSettings()


def track_targets(frames: Frames, radar: Radar, source: str, analysis: Analysis, tracking: Tracking) -> TargetList:
    """Detect and analyse all bodies: moving ones first, in order of appearance."""
    wavelength_m = radar.wavelength_m
    if frames.samples.in_memory:
        frames = frames.with_samples(Samples(frames.matrix))  # computed once
    unknown = np.flatnonzero(np.concatenate([~np.isfinite(tile).all(axis=1) for _, tile in frames.read_tiles()]))
    if unknown.size:
        raise AnalysisError(
            f"{source}: {unknown.size} of {frames.n_pulses} frames have values that are not finite (first: "
            f"frame {unknown[0]}); remove those frames or fill them"
        )
    frames = rangeless.correct_receiver(frames, tracking.detector, wavelength_m=wavelength_m)
    if frames.n_bins == 1:
        return _analyze_without_range(frames, wavelength_m, analysis, tracking)
    frames = frames.find_bursts()
    raw = remove_common_phase(frames)
    in_bursts, prf_hz = raw.slow_time.burst_pulses is not None, raw.slow_time.pulse_rate_hz
    clean = remove_from_frames(raw, kind="mean") if in_bursts else clean_frames(raw, analysis)
    scans, tracks = None, list[Track]()
    if not in_bursts and prf_hz * tracking.detector.cpi_s < MIN_CPI_PULSES:
        warn_caller(
            f"frame rate {prf_hz:g} Hz: radial speeds are unambiguous to {wavelength_m * prf_hz / 4:.2g} m/s only and "
            f"{tracking.detector.cpi_s:g} s have fewer than {MIN_CPI_PULSES} frames; only people who keep still are "
            "detected, and no moving bodies"
        )
    else:
        scans = detect_bodies(raw, tracking.detector, wavelength_m=wavelength_m, in_phase=True)
        tracks = track(scans, tracking.tracker, velocity_span_mps=wavelength_m * prf_hz / 2)
        tracks = split_tracks(tracks, clean, wavelength_m=wavelength_m, cpi_s=tracking.detector.cpi_s)
        # who passes close to the radar is smoothed through 0
        tracks = [replace(one, range_m=np.maximum(one.range_m, LEAST_RANGE_M)) for one in tracks]
    persons, breath_needs = _find_persons(frames, wavelength_m, tracking)
    if not tracks and not persons:
        nothing_moves = _explain_missing_track(raw, scans, wavelength_m, tracking)
        return TargetList(reason=f"{nothing_moves}; {breath_needs or 'no range bin shows steady breathing for 12 s'}")
    tracks = _link(tracks, persons, raw.range_m)
    seen = _Seen(raw, clean, sum_pulses(raw), wavelength_m, persons, analysis, tracking)
    still = [
        _analyze_breathing(clean, wavelength_m, person, analysis)
        for person in persons
        if not any((np.abs(found.range_m - person.range_m) < NEAR_M).any() for found in tracks)
    ]
    make_gate = partial(Gate.from_track, time_s=raw.slow_time.time_s, cpi_s=tracking.detector.cpi_s)
    limits: dict[str, Any] = {"span_m": analysis.gate_span_m, "doppler_hz": analysis.gate_doppler_hz}
    gates = [*(make_gate(found, **limits) for found in tracks), *(result.gate for result in still)]
    moving = [
        _flag_lost_frames(_analyze_track(seen, found, gate, [other for other in gates if other is not gate]), frames)
        for found, gate in zip(tracks, gates, strict=False)
    ]
    return TargetList(judge([*moving, *still], clean, analysis, radar))


def _flag_lost_frames(result: Result, frames: Frames) -> Result:
    # a recorder that loses frames repeats the last one or stores zeros: jumps wide in Doppler
    times_s = frames.slow_time.time_s
    first, stop = np.searchsorted(times_s, [result.quality["start_s"], result.quality["stop_s"]])
    repeated, before = 0, np.empty((0, frames.n_bins), dtype=np.complex64)
    for _, values in frames.take_pulses(slice(first, stop)).read_tiles():
        repeated += int((values[1:] == values[:-1]).all(axis=1).sum()) + int((values[:1] == before).all(axis=1).sum())
        before = values[-1:]
    share = repeated / (stop - first - 1) if stop - first > 1 else 0.0
    segments = tuple(_flag_lost_frames(segment, frames) for segment in result.segments)
    quality, flags = {**result.quality, "lost_frame_share": share}, result.flags
    if share > LOST_SHARE:
        flags = (*flags, f"doppler_bandwidth:{100 * share:.0f}_per_cent_of_the_frames_were_lost")
    return replace(result, quality=quality, flags=flags, segments=segments)


def _analyze_without_range(frames: Frames, wavelength_m: float, analysis: Analysis, tracking: Tracking) -> TargetList:
    kind = "none" if frames.slow_time.burst_pulses is not None else analysis.clutter
    clean = remove_from_frames(frames, kind=kind, time_s=analysis.clutter_time_s)
    motion = rangeless.transform_motion(clean, tracking.detector, wavelength_m=wavelength_m)
    times = rangeless.find_motion(motion, tracking.detector, tracking.tracker)
    if times:
        found = rangeless.analyze_motion(clean, motion, times, analysis, tracking.pieces, wavelength_m=wavelength_m)
        return TargetList([found])
    persons, needs = _find_persons(frames, wavelength_m, tracking)
    if persons:
        return TargetList([_analyze_breathing(clean, wavelength_m, persons[0], analysis)])
    moves = int(motion.moves(tracking.detector).sum())
    return TargetList(
        reason=f"{moves} of {motion.time_s.size} scans have Doppler above the noise at {tracking.detector.slow_mps:g} "
        f"m/s or more, too few for a motion of {tracking.tracker.min_duration_s:g} s; "
        f"{'; '.join([needs or 'no steady breathing for 12 s', *read_flags(frames.facts)])}"
    )


def _find_persons(frames: Frames, wavelength_m: float, tracking: Tracking) -> tuple[list[BreathingTarget], str]:
    """Find people who breathe, or return why they cannot be found."""
    slow = average_bursts(frames)
    needs = explain_no_breathing(slow.slow_time)
    return [] if needs else find_breathing(slow, wavelength_m=wavelength_m, settings=tracking.breathing), needs


def _explain_missing_track(raw: Frames, scans: Sequence[Scan] | None, wavelength_m: float, tracking: Tracking) -> str:
    if scans is None:
        return f"moving bodies cannot be detected at {raw.slow_time.rate_hz:.3g} frames/s"
    detector, tracker = tracking.detector, tracking.tracker
    seen = f"{sum(bool(scan.detections) for scan in scans)} of {len(scans)} scans have detections"
    span_mps = wavelength_m * raw.slow_time.pulse_rate_hz / 2
    still = tracker.model_copy(update={"still_travel_m": 0.0})
    if track([_mirror(scan) for scan in scans], tracker, velocity_span_mps=span_mps):
        return f"{seen} {OTHER_SIGN}"
    if resting := track(scans, still, velocity_span_mps=span_mps):
        most_m = max(float(np.ptp(one.range_m)) for one in resting)
        return (
            f"{seen}, but the detected bodies do not move (at most {most_m:.2f} m of travel, "
            f"{resting[0].range_m.mean():.2f} m from the radar), like clutter and people at rest; "
            f"set tracking.tracker.still_travel_m=0 to report them"
        )
    if brief := track(scans, still.model_copy(update={"min_duration_s": 0.0}), velocity_span_mps=span_mps):
        longest_s = max(one.last_s - one.first_s for one in brief)
        return f"{seen}, but none for {tracker.min_duration_s:g} s (longest {longest_s:.1f} s)"
    if span_mps / 2 <= detector.slow_mps:
        return f"{seen}; speeds are unambiguous to {span_mps / 2:.2g} m/s only, below walking speed"
    best = (1e-30, "")
    for maps in compute_maps(remove_from_frames(raw, kind=detector.clutter), detector, wavelength_m=wavelength_m):
        snr = maps.power_v2 / np.maximum(maps.floor_v2, 1e-300)
        snr[:, np.abs(maps.velocity_mps) < detector.slow_mps] = 0.0  # residual clutter
        scan, doppler, number = np.unravel_index(int(snr.argmax()), snr.shape)
        place = f"{maps.range_m[number]:.2f} m, {maps.velocity_mps[doppler]:.2f} m/s, {maps.time_s[scan]:.1f} s"
        best = max(best, (float(snr[scan, doppler, number]), place))
    return (
        f"{seen}, and never {tracker.confirm_hits} of {tracker.confirm_scans} consecutive scans at one place: the "
        f"strongest cell faster than {detector.slow_mps:g} m/s is {10.0 * math.log10(best[0]):.1f} dB "
        f"above the noise ({best[1]}), and a body needs {10.0 * math.log10(noise_factor(detector.peak_pfa)):.1f} dB"
    )


def _mirror(scan: Scan) -> Scan:
    return Scan(scan.time_s, tuple(replace(one, velocity_mps=-one.velocity_mps) for one in scan.detections))


def _link(tracks: list[Track], persons: Sequence[BreathingTarget], range_m: FloatArray) -> list[Track]:
    """Join the tracks of a body before and after a rest."""
    # the first ends at rest, the second starts there, and no third fits in place of either
    low_m, high_m = float(range_m[0]) + EDGE_M, float(range_m[-1]) - EDGE_M

    def follows(early: Track, late: Track) -> bool:
        place_m, rest_s = float(early.range_m[-1]), late.first_s - early.last_s
        if rest_s <= 0 or abs(float(late.range_m[0]) - place_m) > SAME_PLACE_M or not low_m < place_m < high_m:
            return False
        if abs(float(early.velocity_mps[-1])) > REST_SPEED_MPS or abs(float(late.velocity_mps[0])) > START_SPEED_MPS:
            return False
        return rest_s <= LONGEST_REST_S or any(
            abs(person.range_m - place_m) < NEAR_M and person.start_s < late.first_s and person.stop_s > early.last_s
            for person in persons
        )

    left = sorted(tracks, key=lambda one: one.first_s)
    joined: list[Track] = []
    while left:
        first = left.pop(0)
        later = [one for one in left if follows(first, one)]
        if len(later) == 1 and sum(follows(one, later[0]) for one in [*joined, first, *left]) == 1:
            left.remove(later[0])
            left.insert(0, first.append_track(later[0]))
        else:
            joined.append(first)
    return joined


def _describe_breath(found: Track, persons: Sequence[BreathingTarget]) -> dict[str, float]:
    moves = np.flatnonzero(found.measured & (np.abs(found.velocity_mps) > STILL_SPEED_MPS))
    if moves.size < 2:
        return {}
    longest = int(np.argmax(np.diff(found.times_s[moves])))
    before, after = int(moves[longest]), int(moves[longest + 1])
    start_s, stop_s = float(found.times_s[before]), float(found.times_s[after])
    if stop_s - start_s < MIN_REST_S:
        return {}
    place_m = float(found.range_m[before])
    near = [one for one in persons if abs(one.range_m - place_m) < NEAR_M]
    own = [one for one in near if one.start_s < stop_s and one.stop_s > start_s]
    facts = {"still_start_s": start_s, "still_stop_s": stop_s}
    return facts | (_summarise_breath(own[0]) if own else {})


def _summarise_breath(person: BreathingTarget) -> dict[str, float]:
    names = ("rate_hz", "displacement_m", "snr_db", "confidence")
    return {f"breathing_{name}": getattr(person, name) for name in names}


class _Seen(NamedTuple):
    """Values that the analyses of all tracks share; ``total`` is the sum of the raw pulses."""

    raw: Frames
    clean: Frames
    total: npt.NDArray[np.complex128]
    wavelength_m: float
    persons: Sequence[BreathingTarget]
    analysis: Analysis
    tracking: Tracking


def _analyze_track(seen: _Seen, found: Track, gate: Gate, others: Sequence[Gate]) -> Result:
    raw, clean, total, _, persons, analysis, tracking = seen
    range_sd_m = float(np.quantile(found.range_sd_m, TRACK_SD_QUANTILE))
    segments = find_track_segments(found.times_s, found.range_m, range_sd_m=range_sd_m, settings=tracking.pieces)
    usable = [segment for segment in segments if segment.usable]
    cleaned = analysis.clutter not in ("none", "auto") and clean.slow_time.burst_pulses is None
    measured = measure_removed(raw, clean, gate, total=total) if cleaned else None
    analyze_segment = partial(_analyze_segment, seen, found, measured, others)
    results = [analyze_segment(gate.during(segment.start_s, segment.stop_s)) for segment in usable]
    facts = {
        "track_start_s": found.first_s,
        "track_stop_s": found.last_s,
        "track_confirmed_at_s": found.confirmed_at_s,
        "track_confidence": found.confidence,
        "track_range_m": float(found.range_m.mean()),
        "n_pieces": len(results),
        **_describe_breath(found, persons),
    }
    if not results:
        whole = analyze_segment(gate)
        reasons = sorted({segment.reason for segment in segments}) or ["too_short"]
        flags = (*whole.flags, *(f"no_steady_piece:{reason}" for reason in reasons))
        return replace(whole, quality={**whole.quality, **facts}, flags=flags)
    longest = results[max(range(len(usable)), key=lambda n: usable[n].stop_s - usable[n].start_s)]
    return replace(longest, quality={**longest.quality, **facts}, gate_limits=gate, segments=tuple(results))


def _analyze_segment(
    seen: _Seen, found: Track, measured: tuple[FloatArray, FloatArray] | None, others: Sequence[Gate], gate: Gate
) -> Result:
    clean, wavelength_m, analysis = seen.clean, seen.wavelength_m, seen.analysis
    gated = compute_gated(gate.crop(clean), wavelength_m, gate, analysis, None)
    result = analyze_targets([mark_other_bodies(gated, others)])[0]
    start_s, stop_s = gate.start_s, gate.stop_s
    flags = list(result.flags)
    removed = 0.0
    if measured is not None:  # the share, otherwise predicted
        block_s, share = measured
        share = share[(block_s >= start_s) & (block_s <= stop_s) & np.isfinite(share)]
        by_gain = predict_torso_share_removed(
            gate,
            gate.time_s,
            kind=analysis.clutter,
            wavelength_m=wavelength_m,
            prf_hz=clean.slow_time.rate_hz,
            n_pulses=clean.n_pulses,
            clutter_time_s=analysis.clutter_time_s,
        )
        removed = max(float(share.mean()) if share.size else 0.0, float(by_gain.mean()))
    if removed > CLUTTER_SHARE:
        flags.append(f"clutter_removal_took_{100 * removed:.0f}_per_cent:a_torso_without_radial_speed_may_be_gone")
    quality = {"start_s": start_s, "stop_s": stop_s, "clutter_share_removed": removed}
    return replace(result, quality={**result.quality, **quality}, flags=tuple(dict.fromkeys(flags)))


def _analyze_breathing(clean: Frames, wavelength_m: float, person: BreathingTarget, analysis: Analysis) -> Result:
    prf_hz = clean.slow_time.rate_hz
    slow = analysis.model_copy(update={"cpi_s": max(analysis.cpi_s, 3 * MIN_CPI_PULSES / prf_hz)})
    low_m, high_m = person.range_m - STILL_REACH_M, person.range_m + STILL_REACH_M
    gate = Gate.fixed(low_m, high_m, time_s=clean.slow_time.time_s, source="track")
    result = analyze_gated(clean, wavelength_m, gate, slow)
    quality = {
        **_summarise_breath(person),
        "track_range_m": person.range_m,
        "start_s": person.start_s,
        "stop_s": person.stop_s,
        **{name: result.quality[name] for name in ("observation_s", "noise_floor_v2") if name in result.quality},
    }
    return replace(
        result,
        features=GaitFeatures(torso_velocity_mps=0.0),
        gait_frequency_hz=None,
        torso_doppler_hz=0.0,
        n_periods=None,
        quality=quality,
        flags=("keeps_still:found_by_breathing", "gait:none"),
    )
