"""Targets of radars without range: motion and breathing."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from doppelgait.core.frames import Frames
from doppelgait.core.units import FloatArray
from doppelgait.pipeline.result import Result
from doppelgait.pipeline.target import OPPOSITE_MPS, analyze_gated
from doppelgait.pipeline.verdicts import SIGNIFICANT, TrackStrip, align_power, judge_body, mark_result
from doppelgait.processing import Analysis, Gate, noise_floor_v2
from doppelgait.processing.bursts import make_frame_gate
from doppelgait.processing.clutter import remove_from_frames
from doppelgait.processing.detect import Detector
from doppelgait.processing.detect.maps import compute_maps, noise_factor
from doppelgait.processing.receiver import MAX_SECOND_SHARE, NO_DIRECTION, add_flags, read_flags, remove_mains_lines
from doppelgait.processing.signature import compute_signature
from doppelgait.processing.track import Tracker
from doppelgait.processing.track_segments import SegmentationSettings, TrackSegment, find_track_segments

FAR_M = 100.0  # start of a path integrated from velocity; straight motion is steady there
SMOOTHED_S = 0.5
"""Time of the median filter for Doppler peaks; a limb is the strongest for a shorter time."""
OPPOSITE_S, OPPOSITE_SHARE, OPPOSITE_LEVEL = 1.0, 0.8, 0.2
"""Time, its smallest share with power on both sides, and smallest power ratio, above that of an uneven receiver."""
SURE_PFA = 1e-6


@dataclass(frozen=True)
class Motion:
    """Doppler spectra per scan. Shapes: time_s (J,); velocity_mps (K,); power_v2 (J, K)."""

    time_s: FloatArray
    velocity_mps: FloatArray
    power_v2: npt.NDArray[np.float32]
    floor_v2: float

    def moves(self, detector: Detector) -> npt.NDArray[np.bool_]:
        """Return True for scans above the noise."""
        fast = np.abs(self.velocity_mps) >= detector.slow_mps
        return np.asarray(
            self.power_v2[:, fast].max(axis=1, initial=0.0) > noise_factor(detector.peak_pfa) * self.floor_v2
        )

    def peaks_mps(self) -> FloatArray:
        """Return the velocity of every scan's strongest cell, smoothed."""
        peaks = self.velocity_mps[self.power_v2.argmax(axis=1)]
        half = SMOOTHED_S / 2.0
        return np.array([np.median(peaks[np.abs(self.time_s - t) <= half + 1e-9]) for t in self.time_s])


def transform_motion(clean: Frames, detector: Detector, *, wavelength_m: float) -> Motion:
    """Transform a one-bin recording, with or without bursts."""
    if clean.slow_time.burst_pulses is not None:
        mu = compute_signature(clean, make_frame_gate(clean), Analysis(), wavelength_m=wavelength_m)
        return Motion(mu.axis("time"), mu.axis("velocity"), mu.values, noise_floor_v2(mu))
    blocks = list(compute_maps(clean, detector, wavelength_m=wavelength_m))
    velocity_mps = blocks[0].velocity_mps
    sides = slice(velocity_mps.size // 2 if NO_DIRECTION in read_flags(clean.facts) else 0, None)
    return Motion(
        np.concatenate([maps.time_s for maps in blocks]),
        velocity_mps[sides],
        np.concatenate([maps.power_v2[:, sides, 0] for maps in blocks]),
        float(np.mean([maps.floor_v2[0] for maps in blocks])),
    )


def correct_receiver(frames: Frames, detector: Detector, *, wavelength_m: float) -> Frames:
    """Remove mains lines; without range and with one output, reduce I and Q to one real series."""
    frames = remove_mains_lines(frames)
    if frames.n_bins > 1:
        return frames
    frames = frames.find_bursts()
    angle_rad = find_output(frames, detector, wavelength_m=wavelength_m)
    if angle_rad is None:
        return frames
    series = _project(frames, complex(math.cos(angle_rad), -math.sin(angle_rad)))
    return add_flags(series, NO_DIRECTION)


def _project(frames: Frames, weight: complex) -> Frames:
    return frames.map_tiles(lambda values, first: (values * np.complex64(weight)).real.astype(np.complex64))


def find_output(frames: Frames, detector: Detector, *, wavelength_m: float) -> float | None:
    """Return the direction of all echoes in I and Q, or None."""
    # a moving body turns in the plane of two outputs, but along a line if Q repeats I or is empty
    clean = remove_from_frames(frames, kind="mean") if frames.slow_time.burst_pulses is None else frames
    weights = (1.0, -1.0j, 1.0 - 1.0j)  # I, Q, and I + Q for the product of both
    motions = [transform_motion(_project(clean, w), detector, wavelength_m=wavelength_m) for w in weights]
    powers, floors_v2 = [motion.power_v2.astype(np.float64) for motion in motions], [m.floor_v2 for m in motions]
    total_v2, floor_v2 = powers[0] + powers[1], floors_v2[0] + floors_v2[1]
    echo = (total_v2 > noise_factor(SURE_PFA) * floor_v2) & (np.abs(motions[0].velocity_mps) >= detector.slow_mps)
    stated = bool(frames.facts.get("one_output"))
    if not echo.any() and not stated:
        return None
    cells = echo if echo.any() else total_v2 > 0.0
    # every cell counts alike, so that a strong vibration does not hide a weak body
    i, q, both = (
        float(np.mean((power_v2[cells] - noise_v2) / total_v2[cells]))
        for power_v2, noise_v2 in zip(powers, floors_v2, strict=True)
    )
    product = (both - i - q) / 2.0
    spread = math.hypot(i - q, 2.0 * product)
    if not stated and i + q - spread > MAX_SECOND_SHARE * (i + q + spread):
        return None
    return math.atan2(2.0 * product, i - q) / 2.0


def find_motion(motion: Motion, detector: Detector, tracker: Tracker) -> list[tuple[float, float]]:
    """Find the intervals in which something moves."""
    moves = motion.moves(detector)
    times_s = motion.time_s[moves]
    found = []
    for group in np.split(times_s, np.flatnonzero(np.diff(times_s) > tracker.delete_s) + 1) if times_s.size else []:
        inside = (motion.time_s >= group[0]) & (motion.time_s <= group[-1])
        lasting = group[-1] - group[0] >= tracker.min_duration_s
        if lasting and moves[inside].mean() >= tracker.confirm_hits / tracker.confirm_scans:
            found.append((float(group[0]), float(group[-1])))
    return found


def has_both_directions(strip: TrackStrip, floor_v2: float) -> bool:
    """Return True if bodies approach and recede at the same time."""
    towards = strip.power_v2[:, strip.velocity_mps >= OPPOSITE_MPS].max(axis=1, initial=0.0)
    away = strip.power_v2[:, strip.velocity_mps <= -OPPOSITE_MPS].max(axis=1, initial=0.0)
    slow = strip.power_v2[:, np.abs(strip.velocity_mps) < OPPOSITE_MPS].max(axis=1, initial=0.0)
    weaker, stronger = np.minimum(towards, away), np.maximum(towards, away)
    both = (weaker > noise_factor(SURE_PFA) * floor_v2) & (weaker > OPPOSITE_LEVEL * stronger) & (stronger > slow)
    length = max(1, round(OPPOSITE_S / float(np.diff(strip.time_s).min(initial=OPPOSITE_S))))
    shares = np.convolve(both, np.ones(length) / length, mode="valid") if both.size >= length else np.zeros(1)
    return bool(shares.max() >= OPPOSITE_SHARE - 1e-9)


def analyze_motion(
    clean: Frames,
    motion: Motion,
    times: list[tuple[float, float]],
    analysis: Analysis,
    settings: SegmentationSettings,
    *,
    wavelength_m: float,
) -> Result:
    """Analyse all motion in a recording without range."""
    pieces: list[TrackSegment] = []
    peaks_mps = motion.peaks_mps()
    for start_s, stop_s in times:
        # the integral of the strongest Doppler is a path far from the radar, divided like a track
        inside = np.flatnonzero((motion.time_s >= start_s) & (motion.time_s <= stop_s))
        continuous = clean.slow_time.burst_pulses is None  # some bursts a second do not show a rest
        rests = _find_rests(motion.time_s[inside], peaks_mps[inside], settings) if continuous else []
        for walk in np.split(inside, rests):
            range_m = integrate_path(motion.time_s[walk], peaks_mps[walk])
            pieces += find_track_segments(motion.time_s[walk], range_m, settings=settings)
    usable = [piece for piece in pieces if piece.usable]
    flags: tuple[str, ...] = ()
    spans = [(piece.start_s, piece.stop_s) for piece in usable]
    if not usable:
        reasons = sorted({piece.reason for piece in pieces}) or ["too_short"]
        flags = tuple(f"no_steady_piece:{reason}" for reason in reasons)
        spans = [max(times, key=lambda span: span[1] - span[0])]
    gate = _make_whole_gate(clean, times[0][0], times[-1][1])
    results = []
    for start_s, stop_s in spans:
        part = _make_whole_gate(clean, start_s, stop_s)
        result = analyze_gated(part.crop(clean), wavelength_m, part, analysis)
        quality = {**result.quality, "start_s": part.start_s, "stop_s": part.stop_s}
        results.append(replace(result, quality=quality, flags=(*result.flags, *flags)))
    longest = max(results, key=lambda one: one.quality["stop_s"] - one.quality["start_s"])
    strip = observe_motion(motion, times[0][0], times[-1][1])
    facts = {"track_start_s": times[0][0], "track_stop_s": times[-1][1], "n_pieces": len(usable)}
    directed = NO_DIRECTION not in read_flags(clean.facts)
    facts["both_directions"] = float(directed and has_both_directions(strip, motion.floor_v2))
    quality, segments = {**longest.quality, **facts}, tuple(results) if usable else ()
    found = replace(longest, quality=quality, gate_limits=gate, segments=segments)
    return mark_result(found, judge_body(found, strip, align_power(strip)[np.newaxis]))


def integrate_path(times_s: FloatArray, velocity_mps: FloatArray) -> FloatArray:
    """Integrate a velocity to ranges far from the radar."""
    way_m = np.concatenate([[0.0], np.cumsum(np.diff(times_s) * (velocity_mps[1:] + velocity_mps[:-1]) / 2.0)])
    return np.asarray(FAR_M - way_m + max(0.0, float(way_m.max()) - FAR_M / 2.0))


def observe_motion(motion: Motion, start_s: float, stop_s: float) -> TrackStrip:
    """Return all motion of an interval as that of one target."""
    inside = (motion.time_s >= start_s) & (motion.time_s <= stop_s)
    time_s, power_v2, velocity_mps = motion.time_s[inside], motion.power_v2[inside], motion.peaks_mps()[inside]
    excess_v2 = np.where(power_v2 > SIGNIFICANT * motion.floor_v2, power_v2 - motion.floor_v2, 0.0)
    return TrackStrip(
        time_s, integrate_path(time_s, velocity_mps), velocity_mps, excess_v2.astype(np.float64), motion.velocity_mps
    )


def _find_rests(times_s: FloatArray, velocity_mps: FloatArray, settings: SegmentationSettings) -> list[int]:
    # without range, a body that stops may be one that passes by: only a rest separates them
    rests = np.concatenate([[False], np.abs(velocity_mps) < settings.still_mps, [False]])
    edges = np.flatnonzero(np.diff(rests)).reshape(-1, 2)
    lasting = times_s[edges[:, 1] - 1] - times_s[edges[:, 0]] >= settings.min_piece_s
    return [int(n) for n in edges[lasting].ravel() if 0 < n < times_s.size]


def _make_whole_gate(clean: Frames, start_s: float, stop_s: float) -> Gate:
    """Make a gate over one bin, keeping bursts whole."""
    bursts_s, range_m = clean.slow_time.split_bursts(), float(clean.range_m[0])
    first = max(int(np.searchsorted(bursts_s[:, 0], start_s, side="right")) - 1, 0)
    inside = bursts_s[first : int(np.searchsorted(bursts_s[:, -1], stop_s)) + 1].ravel()
    return Gate.fixed(range_m - 0.5, range_m + 0.5, time_s=inside, source="track")
