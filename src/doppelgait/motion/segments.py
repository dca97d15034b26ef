"""Straight segments at constant velocity, which divide a long recording into several examples."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from doppelgait._core import native
from doppelgait.core.errors import MotionError
from doppelgait.motion.gait import GaitFacts, is_quadruped, measure_gait, smooth_path
from doppelgait.motion.motion import Motion, require_motion

GRID_S = 0.05
"""Time grid of the starts and ends of segments."""


@dataclass(frozen=True)
class SegmentLimits:
    """Limits of straightness and of constant speed."""

    smoothing_s: float = 0.5
    lateral_m: float = 0.12
    speed_deviation: float = 0.20
    min_duration_s: float = 1.0
    min_length_m: float = 1.0
    min_speed_mps: float = 0.4


PERSON = SegmentLimits()
QUADRUPED = SegmentLimits(smoothing_s=0.35, lateral_m=0.15, speed_deviation=0.25, min_duration_s=0.8, min_length_m=0.6)


@dataclass(frozen=True)
class Segment:
    """A straight segment at constant velocity."""

    start_s: float
    stop_s: float
    mean_speed_mps: float
    straightness: float
    lateral_m: float
    speed_deviation: float
    heading_deg: float
    gait: GaitFacts

    @property
    def duration_s(self) -> float:
        """Time from the first to the last frame."""
        return self.stop_s - self.start_s


def find_segments(motion: Motion, *, limits: SegmentLimits | None = None) -> list[Segment]:
    """Find all straight segments at constant velocity.

    The body centre is the mean of the moving points. In a segment, its ground path, averaged over ``smoothing_s``, is
    within ``lateral_m`` of the chord, and its speed within ``speed_deviation`` of the mean speed. The longest segment
    is selected first. Segments do not overlap and are returned in order of time.

    Parameters
    ----------
    motion : Motion
        Motion (time, marker, space) in m, z up. It should be cleaned; gaps are bridged by straight lines.
    limits : SegmentLimits, optional
        Limits. The defaults are those of a quadruped if the motion has paws or a species other than
        human, otherwise those of a person.

    Returns
    -------
    list of Segment
        Segments; the list is empty if there are none.

    See Also
    --------
    loop : extend a segment to any duration.

    Examples
    --------
    >>> import doppelgait as dg
    >>> motion = dg.motion.boulic_walk(duration_s=4.0)
    >>> [(round(one.duration_s, 1), round(one.mean_speed_mps, 1)) for one in dg.motion.find_segments(motion)]
    [(4.0, 1.2)]
    """
    require_motion(motion)
    limits = limits or (QUADRUPED if is_quadruped(motion) else PERSON)
    position = motion.position_m
    rate = motion.rate_hz
    path = smooth_path(position, rate_hz=rate, smoothing_s=limits.smoothing_s)
    if len(path) < 3 or not np.isfinite(path).all():
        return []
    grid = np.arange(0, len(path), max(1, round(GRID_S * rate)))
    speed = np.linalg.norm(np.gradient(path, 1.0 / rate, axis=0), axis=1)
    # ends (inclusive) of the longest allowed segment, then of those before and after it
    coarse_path, coarse_speed = path[grid], speed[grid]
    step_s = float(grid[1] if grid.size > 1 else 1) / rate
    shortest = max(2, math.ceil(limits.min_duration_s / step_s - 1e-9))
    allowed = limits.lateral_m, limits.speed_deviation, limits.min_length_m, limits.min_speed_mps, shortest
    found, waiting = [], [(0, len(coarse_path))]
    while waiting:
        first, stop = waiting.pop()
        start, end = native.longest_stretch(*coarse_path[first:stop].T, coarse_speed[first:stop], step_s, *allowed)
        if start >= 0:
            found.append((first + start, first + end))
            waiting += [(first, first + start), (first + end + 1, stop)]
    times, segments = motion.time_s, []
    for first, last in ((int(grid[a]), int(grid[b])) for a, b in sorted(found)):
        part, pace = path[first : last + 1], speed[first : last + 1]
        offset = part - part[0]
        distance = float(np.linalg.norm(offset[-1]))
        along = offset[-1] / distance
        segments.append(
            Segment(
                start_s=float(times[first]),
                stop_s=float(times[last]),
                mean_speed_mps=distance * rate / (last - first),
                straightness=min(1.0, distance / float(np.linalg.norm(np.diff(part, axis=0), axis=1).sum())),
                lateral_m=float(np.abs(offset[:, 0] * along[1] - offset[:, 1] * along[0]).max()),
                speed_deviation=float(np.abs(pace / pace.mean() - 1).max()),
                heading_deg=math.degrees(math.atan2(along[1], along[0])),
                gait=measure_gait(motion.frames(first, last + 1)),
            )
        )
    return segments


def crop(motion: Motion, segment: Segment) -> Motion:
    """Extract one segment of a motion."""
    # the result starts at time 0. Known facts are kept, and footfalls are shifted.
    times, rate = motion.time_s, motion.rate_hz
    if segment.start_s < times[0] - 0.5 / rate or segment.stop_s > times[-1] + 0.5 / rate:
        raise MotionError(
            f"{motion.facts.source or 'motion'}: the segment from {segment.start_s:g} to {segment.stop_s:g} s is "
            f"not in this motion, which lasts from {times[0]:g} to {times[-1]:g} s; find segments in the same motion"
        )
    first, last = (round((t - times[0]) * rate) for t in (segment.start_s, segment.stop_s))
    report = {"segment_from_s": float(times[first]), "segment_to_s": float(times[last])}
    return motion.cut(first, last + 1).with_report(**report)
