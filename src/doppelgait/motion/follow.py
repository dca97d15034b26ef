"""Straight, steady gaits on paths over the ground.

The phase of the gait follows the distance travelled.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace

import numpy as np

from doppelgait.core.errors import ConfigError, MotionError
from doppelgait.core.units import FloatArray
from doppelgait.motion.motion import Motion, MotionFacts, PathFacts, require_motion
from doppelgait.motion.paths import (
    Curve,
    CurveElement,
    Layout,
    Pace,
    Path,
    Stop,
    compute_stillness,
    distance_m,
    find_points,
    first_time_s,
    join,
    lay_out,
    smooth_heading_rad,
    spot_turn_rad,
)
from doppelgait.motion.retime import STILL_BELOW_M, Spline, fit_centre, fit_spline
from doppelgait.motion.skeleton import FOOT_PARTS

SPEED_BAND = 0.3
"""Largest relative change of a gait's speed. Beyond it, stride length and posture would change."""
UNEVEN_M, UNEVEN_SHARE = 0.15, 0.05
"""Largest distance of a steady body from even travel: a constant and a share of the path."""
SUPPORT_STRIDES = 0.12
"""Share of a stride over which the feet's speed is averaged: the double support of a walk."""
_SAMPLES_PER_STRIDE = 400
BLOCK_FRAMES = 1 << 15
"""Number of frames that are placed on a path at a time. An hour has a million frames."""


@dataclass(frozen=True)
class Gait:
    """Straight motion in a frame that travels below the mean body centre."""

    motion: Motion
    spline: Spline
    speed_mps: float
    lasts_s: float

    def offsets_m(self, time_s: FloatArray) -> FloatArray:
        """Return the points relative to the travelling origin."""
        position = self.spline.points(np.ascontiguousarray(time_s))[0]
        position[..., 0] -= self.speed_mps * time_s[:, None]
        return position


@dataclass(frozen=True)
class Course:
    """Gait on a path, with the path's curve and pace."""

    gait: Gait
    path: Path
    curve: Curve
    pace: Pace

    def phase_time_s(self, time_s: FloatArray) -> FloatArray:
        """Return the straight-motion time of equal distance (E-02b)."""
        # the distance is that of the body, which may be offset from the path
        gone_m = distance_m(self.pace, time_s)
        if self.path.side_m:
            headings = smooth_heading_rad(self.curve, np.append(gone_m, 0.0) + self.path.ahead_m)
            gone_m = gone_m - self.path.side_m * (headings[:-1] - headings[-1])
        return np.asarray(gone_m / self.gait.speed_mps)


def follow(
    motion: Motion,
    path: Path,
    *,
    start_position_m: tuple[float, float] = (0.0, 0.0),
    heading_deg: float = 0.0,
    duration_s: float | None = None,
) -> Motion:
    r"""Make a motion follow a path (E-02b).

    .. math:: x(t) = c(s) + R_z(\psi(s)) [\, x_0(\tau) - V \tau \,], \qquad \tau = s(t) / V

    with c the ground curve, s(t) the distance travelled, psi the tangent averaged over 0.5 m and
    x_0 the straight motion of mean speed V. The stride length is constant. Stops are moved by at
    most a quarter stride, to the phase in which the feet are slowest. A body at rest fades to a
    standing posture. In a turn on the spot, it rotates rigidly.

    Parameters
    ----------
    motion : Motion
        Motion that travels straight and steadily, without gaps.
    path : Path
        One of the path kinds (:mod:`doppelgait.motion.paths`).
    start_position_m : (float, float)
        Ground position of the path's origin. The mean line of the body centre starts on the path.
    heading_deg : float
        Direction of the path's x axis, from +x towards +y.
    duration_s : float, optional
        Duration of the result; by default until the path or the motion ends.

    Returns
    -------
    Motion
        At the motion's frame rate. Footfalls are moved in time; stride, step and gait frequency are
        means over the time not paused. ``facts.path`` describes the path.

    Raises
    ------
    MotionError
        If the motion is not straight and steady or cannot stop, or it or the path is too short.
    ConfigError
        If the speed on the path is more than 30 % from the motion's, or stops are too close.

    Examples
    --------
    >>> import doppelgait as dg
    >>> motion = dg.motion.boulic_walk(speed_mps=1.2, duration_s=4.0)
    >>> path = dg.motion.make_path({"kind": "arc", "radius_m": 2.0, "turn_deg": 90.0})
    >>> walk = dg.motion.follow(motion, path, duration_s=2.0)
    >>> walk.positions.sel(marker="head").values[-1].round(1)  # 2.4 m along the arc
    array([1.8, 1.3, 1.7])
    """
    require_motion(motion)
    gait, layout = _rotate_to_x(motion), lay_out(path)
    pace = _find_pace(gait, path, layout)
    # the curve in the world frame; a turn on the spot divides its line where the body stops
    turns = {stop.at_m: stop.turn_rad for stop in pace.stops if stop.turn_rad}
    lengths_m = np.diff([0.0, *turns, math.inf]).tolist()
    elements = [CurveElement(m, turn_rad=rad) for m, rad in zip(lengths_m, [0.0, *turns.values()], strict=True)]
    x, y = layout.start_m
    heading_rad = math.radians(heading_deg)
    cosine, sine = math.cos(heading_rad), math.sin(heading_rad)
    start_m = (start_position_m[0] + x * cosine - y * sine, start_position_m[1] + x * sine + y * cosine)
    curve = join(elements if turns else layout.elements, start_m=start_m, heading_rad=heading_rad + layout.heading_rad)
    for bend in curve.curvature_per_m:
        if bend * path.side_m != 0:
            what = f"side_m = {path.side_m:g} on an arc of radius {1 / abs(bend):.3g} m"
            _check_speed(pace.speed_mps * (1 - bend * path.side_m), gait, what)
    course = Course(gait, path, curve, pace)
    frames = _count_frames(course, duration_s)
    times_s = np.arange(frames) / motion.rate_hz
    position = np.empty((frames, len(motion.markers), 3))
    for first in range(0, frames, BLOCK_FRAMES):
        block_s, points = times_s[first : first + BLOCK_FRAMES], position[first : first + BLOCK_FRAMES]
        # the motion's points on the path (E-02b)
        along_m = distance_m(pace, block_s) + path.ahead_m
        heading = smooth_heading_rad(curve, along_m) + spot_turn_rad(pace, block_s)
        offset = gait.offsets_m(np.clip(course.phase_time_s(block_s), 0.0, gait.lasts_s))
        for number, stop in enumerate(pace.stops):
            still = compute_stillness(pace, number, block_s)[:, None, None]
            # the standing posture: mean of the frozen one and of that half a stride away
            frozen_s, half_s = stop.at_m / gait.speed_mps, 0.5 / motion.facts.stride_frequency_hz
            other_s = frozen_s + half_s if frozen_s + half_s <= gait.lasts_s else max(frozen_s - half_s, 0.0)
            standing_m = np.asarray(gait.offsets_m(np.array([frozen_s, other_s])).mean(axis=0))
            offset += still * (standing_m - offset)
        offset[..., 1] += path.side_m
        origin = find_points(curve, along_m)
        cosines, sines = np.cos(heading)[:, None], np.sin(heading)[:, None]
        points[..., 0] = origin[:, :1] + cosines * offset[..., 0] - sines * offset[..., 1]
        points[..., 1] = origin[:, 1:] + sines * offset[..., 0] + cosines * offset[..., 1]
        points[..., 2] = offset[..., 2]
    facts, followed = _make_facts(course, times_s)
    made = motion.remake(position, facts, start_s=float(motion.time_s[0]))
    return made.with_report(path=asdict(followed))


def steady_speed_mps(motion: Motion) -> float:
    """Return the speed of a straight, steady motion over whole strides, if known."""
    return _rotate_to_x(motion).speed_mps


def _rotate_to_x(motion: Motion) -> Gait:
    """Rotate a straight motion to +x through the origin, or raise MotionError."""
    lasts_s = motion.duration_s
    centre = fit_centre(motion)
    # over all whole strides, or over the whole motion if strides are unknown
    stride_hz = float(motion.facts.stride_frequency_hz)
    strides = math.floor(lasts_s * stride_hz + 1e-6) if stride_hz > 0 else 0
    last_s = min(strides / stride_hz, lasts_s) if strides else lasts_s
    times_s = np.linspace(0.0, last_s, _SAMPLES_PER_STRIDE * max(strides, 1) + 1)
    ground_m = centre.at(times_s)[0][:, :2]
    velocity_mps = (ground_m[-1] - ground_m[0]) / times_s[-1]
    speed_mps = math.hypot(*velocity_mps)
    if speed_mps * lasts_s < STILL_BELOW_M:
        raise MotionError(
            f"{motion.facts.source}: travels {speed_mps * lasts_s:.2f} m in {lasts_s:.2f} s; a path needs a motion "
            "that travels, such as a walk"
        )
    start_m = (ground_m - velocity_mps * times_s[:, None])[:-1].mean(axis=0)
    along = velocity_mps / speed_mps
    turn = np.array([[along[0], along[1]], [-along[1], along[0]]])
    position_m = motion.position_m.copy(order="K")
    for first in range(0, len(position_m), BLOCK_FRAMES):
        ground = position_m[first : first + BLOCK_FRAMES, :, :2]
        ground[:] = (ground - start_m) @ turn.T
    body = motion.with_positions(position_m)
    gait = Gait(motion, fit_spline(body), speed_mps, lasts_s)
    centre_m = fit_centre(body).values
    even_m = speed_mps * np.linspace(0.0, lasts_s, len(centre_m))
    off_m = float(np.hypot(centre_m[:, 0] - even_m, centre_m[:, 1]).max())
    if off_m > UNEVEN_M + UNEVEN_SHARE * speed_mps * lasts_s:
        raise MotionError(
            f"{motion.facts.source}: its body is up to {off_m:.2f} m away from straight and even travel; a "
            "path needs a straight, steady segment: select one with start_s and stop_s"
        )
    return gait


def _find_pace(gait: Gait, path: Path, layout: Layout) -> Pace:
    """Return the pace on a path, with stops."""
    speed_mps = path.speed_mps or gait.speed_mps
    _check_speed(speed_mps, gait, "speed_mps")
    reach_m = math.inf
    if layout.open_ended and layout.stops:  # half a stride before the end, for the standing posture
        reach_m = gait.speed_mps * (gait.lasts_s - 0.5 / gait.motion.facts.stride_frequency_hz)
    reached = [stop for stop in layout.stops if stop.at_m <= reach_m]
    if not reached:
        return Pace(speed_mps)
    ramp_s = math.pi * speed_mps / (2 * layout.acceleration_mps2)
    stops = tuple(Stop(_stop_phase_s(gait, s.at_m) * gait.speed_mps, s.pause_s, s.turn_rad) for s in reached)
    rests_m = [-speed_mps * ramp_s / 2, *(stop.at_m for stop in stops)]
    gap_m, needs_m = float(np.diff(rests_m).min()), speed_mps * ramp_s
    if gap_m < needs_m - 1e-9:
        raise ConfigError(
            f"path: a stop needs {needs_m / 2:.2f} m to slow down at acceleration_mps2 = {layout.acceleration_mps2:g} "
            f"and as much to set off, at {speed_mps:.2f} m/s; move the stops apart or raise acceleration_mps2"
        )
    return Pace(speed_mps, ramp_s, stops)


def _check_speed(speed_mps: float, gait: Gait, what: str) -> None:
    low, high = ((1 + sign * SPEED_BAND) * gait.speed_mps for sign in (-1, 1))
    if not low * (1 - 1e-9) <= speed_mps <= high * (1 + 1e-9):
        raise ConfigError(
            f"path: {what} makes {speed_mps:.3g} m/s of a motion at {gait.speed_mps:.3g} m/s; allowed are {low:.3g} to "
            f"{high:.3g} m/s, within 30 %: use a motion of about that speed"
        )


def _stop_phase_s(gait: Gait, at_m: float) -> float:
    """Find the time of the slowest feet near a distance."""
    # at this time the body is at most a quarter stride from that distance
    source, facts = gait.motion.facts.source, gait.motion.facts
    feet = [n for n, part in enumerate(gait.motion.parts) if part in FOOT_PARTS]
    if not feet or not facts.step_frequency_hz > 0:
        raise MotionError(
            f"{source}: cannot stop: it needs points on the feet, and a gait of known step frequency and "
            f"mirrored half strides (walk, trot, run), not {facts.gait or 'an unknown one'}"
        )
    quarter_s, wanted_s = 0.25 / facts.stride_frequency_hz, at_m / gait.speed_mps
    if wanted_s + quarter_s > gait.lasts_s:
        raise MotionError(
            f"{source}: travels {gait.speed_mps * gait.lasts_s:.2f} m, too short for a stop at {at_m:.2f} m; use a "
            "longer motion or stop earlier"
        )
    step_s = 4 * quarter_s / _SAMPLES_PER_STRIDE
    quarter, support = _SAMPLES_PER_STRIDE // 4, round(SUPPORT_STRIDES * _SAMPLES_PER_STRIDE / 2)
    times_s = wanted_s + step_s * np.arange(-quarter - support, quarter + support + 1)
    velocity = gait.spline.points(np.clip(times_s, 0.0, gait.lasts_s))[1][:, feet]
    # averaged, since a swinging foot is at rest for a moment at its turning point
    moving = np.convolve(np.sqrt((velocity**2).sum(axis=-1)).sum(axis=1), np.ones(2 * support + 1), mode="valid")
    return max(float(times_s[support + moving.argmin()]), 0.0)


def _count_frames(course: Course, wanted_s: float | None) -> int:
    """Return the number of frames until the wanted time, or the end of path or motion."""
    gait, rate_hz = course.gait, course.gait.motion.rate_hz
    slowest_mps = (1 - SPEED_BAND) ** 2 * gait.speed_mps
    stops_s = sum(course.pace.ramp_s + stop.pause_s for stop in course.pace.stops)
    bound_s = gait.lasts_s * gait.speed_mps / slowest_mps + stops_s + 1.0
    motion_s = float(first_time_s(course.phase_time_s, gait.lasts_s * (1 - 1e-12), stop_s=bound_s)[0])
    path_s = course.curve.length_m / course.pace.speed_mps + stops_s
    if wanted_s is None:
        return max(math.floor(min(motion_s, path_s) * rate_hz + 1e-6) + 1, 2)
    last = math.ceil(wanted_s * rate_hz - 1e-6)
    if last / rate_hz > path_s + 1 / rate_hz:
        raise MotionError(
            f"path kind {course.path.kind!r}: is {course.curve.length_m:.2f} m long and takes {path_s:.3f} s, but "
            f"{wanted_s:g} s are wanted; lengthen the path or shorten duration_s"
        )
    if last / rate_hz > motion_s + 1e-6:
        raise MotionError(
            f"{gait.motion.facts.source}: lasts {motion_s:.3f} s on its path, but {wanted_s:g} s are wanted; "
            "shorten duration_s or use a longer motion"
        )
    return last + 1


def _make_facts(course: Course, times_s: FloatArray) -> tuple[MotionFacts, PathFacts]:
    last_s, motion = float(times_s[-1]), course.gait.motion
    stops = [(course.pace.rest_s(number), stop) for number, stop in enumerate(course.pace.stops)]
    paused_s = sum(min(max(last_s - rest_s, 0.0), stop.pause_s) for rest_s, stop in stops)
    end_s = float(course.phase_time_s(times_s[-1:])[0])
    factor = end_s / (last_s - paused_s)
    # equal paces result in exactly equal numbers
    facts = motion.facts
    if not math.isclose(factor, 1.0, rel_tol=1e-9):
        facts = facts.with_frequencies(lambda hz: factor * hz)
    length_m = end_s * course.gait.speed_mps
    stops_m = tuple(stop.at_m for rest_s, stop in stops if rest_s <= last_s)
    followed = PathFacts(course.path.kind, length_m, length_m / last_s, paused_s, stops_m)
    start_s = float(motion.time_s[0])
    footfalls = {}
    for foot, touchdowns in facts.footfalls.items():
        phases_s = np.array([t - start_s for t in touchdowns if t - start_s <= end_s + 1e-9], dtype=float)
        reached_s = first_time_s(course.phase_time_s, phases_s, stop_s=last_s) if phases_s.size else phases_s
        footfalls[foot] = [start_s + float(t) for t in reached_s]
    return replace(facts, path=followed, footfalls=footfalls), followed
