"""Adaptation of motions to scenes: height, position, resampling, variation."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field

from doppelgait._core import native
from doppelgait.core.config import FrozenModel
from doppelgait.core.errors import MotionError
from doppelgait.core.units import FloatArray, cosine, sine
from doppelgait.motion.motion import Motion, require_motion
from doppelgait.motion.skeleton import BODY_CENTRE_PARTS

ScalingMode = Literal["uniform", "froude", "z_only"]

STILL_BELOW_M = 0.2
"""Minimum travel of the body centre with a direction. A body that travels less faces +x."""


def body_centre_m(motion: Motion, frames: slice | list[int] = slice(None)) -> FloatArray:
    """Return the mean position of torso or trunk, or of all points without them."""
    values = motion.position_m[frames]
    central = [n for n, part in enumerate(motion.parts) if part in BODY_CENTRE_PARTS] or range(values.shape[1])
    total = np.array(values[:, central[0]], dtype=np.float64)
    for point in central[1:]:
        total += values[:, point]
    return total / len(central)


def _net_travel_m(motion: Motion, last: int = -1) -> FloatArray:
    # on the ground, from the first frame to another one, by default the last
    before, after = body_centre_m(motion, [0, last])[:, :2]
    return np.asarray(after - before)


def travel_heading_rad(motion: Motion) -> float:
    """Return the direction of net travel from +x to +y, 0 for a body that stays in place."""
    net = _net_travel_m(motion)
    return math.atan2(net[1], net[0]) if math.hypot(*net) > STILL_BELOW_M else 0.0


def travel_speed_mps(motion: Motion, *, first_s: float = math.inf) -> float:
    """Return the net ground speed of the body centre, of the first seconds or of all."""
    times = motion.time_s
    last = int(np.searchsorted(times, times[0] + first_s, side="right")) - 1
    return float(math.hypot(*_net_travel_m(motion, last)) / (times[last] - times[0]))


def scale_to_height(
    motion: Motion, *, height_m: float, mode: ScalingMode = "uniform", recorded_height_m: float | None = None
) -> Motion:
    """Scale a body to another height (E-01).

    The fixed point is the floor below its starting position.

    Parameters
    ----------
    motion : Motion
        Motion with the floor at z = 0.
    height_m : float
        Wanted stature (people) or withers height (dogs, cats), positive.
    mode : {"uniform", "froude", "z_only"}
        Scale all coordinates; also times by the square root (dynamic similarity); or only heights.
    recorded_height_m : float, optional
        Height of the recorded subject. The default is the motion's own ``height_m``, or for
        ``z_only`` the highest point if that is unknown.

    Raises
    ------
    MotionError
        If the recorded height is unknown.

    Examples
    --------
    >>> import doppelgait as dg
    >>> walk = dg.motion.boulic_walk(duration_s=2.0)
    >>> dg.motion.scale_to_height(walk, height_m=1.9).facts.height_m
    1.9
    """
    require_motion(motion)
    recorded = motion.facts.height_m if recorded_height_m is None else recorded_height_m
    if mode == "z_only" and not recorded > 0:
        recorded = float(motion.position_m[..., 2].max())  # the report always uses the highest marker
    if not recorded > 0:
        raise MotionError(
            f"{motion.facts.source}: the recorded subject's height is unknown (no head is known among its points, and "
            f"no hips, knees and ankles), so it cannot be scaled to {height_m} m; leave out height_m, state "
            "facts.height_m of the motion, or give recorded_height_m to scale_to_height"
        )
    factor = height_m / recorded
    anchor = np.array([*_interpolate_centre(motion, 0.0)[:2], 0.0])
    position_m = motion.position_m.copy(order="K")
    if mode == "z_only":
        position_m[..., 2] *= factor
    else:
        position_m[...] = anchor + factor * (motion.position_m - anchor)
    scaled = motion.with_positions(position_m).with_facts(height_m=height_m, mass_kg=motion.facts.mass_kg * factor**3)
    if mode != "froude":
        return scaled
    slower, times = math.sqrt(factor), scaled.time_s
    positions = scaled.positions.assign_coords(time=times[0] + (times - times[0]) * slower)
    positions.coords["time"].attrs["units"] = "s"
    positions.attrs["rate_hz"] = scaled.rate_hz / slower
    footfalls = {
        foot: [times[0] + (t - times[0]) * slower for t in touchdowns]
        for foot, touchdowns in scaled.facts.footfalls.items()
    }
    facts = scaled.facts.with_frequencies(lambda hz: hz / slower)
    return replace(scaled, positions=positions, facts=replace(facts, footfalls=footfalls))


def place(motion: Motion, *, position_m: tuple[float, float], heading_deg: float, at_s: float) -> Motion:
    """Rotate and move a motion: at ``at_s``, its body centre is above the position."""
    turn = math.radians(heading_deg) - travel_heading_rad(motion)
    pivot, points = _interpolate_centre(motion, at_s), np.ascontiguousarray(motion.position_m, dtype=np.float64)
    moved = np.empty(points.shape)
    cos, sin, ends_m = math.cos(turn), math.sin(turn), (*map(float, pivot[:2]), *map(float, position_m[:2]))
    native.turn_and_move(points.reshape(-1, 3), cos, sin, *ends_m, moved.reshape(-1, 3))
    return motion.with_positions(moved)


def _interpolate_centre(motion: Motion, at_s: float) -> FloatArray:
    """Interpolate the body centre at a time after the first frame, shape (3,)."""
    times = motion.time_s
    frame = float(np.interp(times[0] + at_s, times, np.arange(times.size)))
    before, share = int(frame), frame - int(frame)
    # at a frame, a gap in the next one has no effect
    centre = body_centre_m(motion, slice(before, before + (2 if share else 1)))
    return np.asarray(centre[0] + share * (centre[-1] - centre[0]))


def resample(motion: Motion, time_s: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Resample positions and velocities by a cubic spline (E-02)."""
    return fit_spline(motion).points(check_times(motion, time_s))


@dataclass(frozen=True)
class Spline:
    """Cubic spline through frames. Values and moments (second derivatives) have shape (T, 3 P)."""

    values: FloatArray
    moments: FloatArray
    step_s: float

    def at(self, times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return values and slopes at times, both (I, C). Times are relative to the first frame."""
        value, slope = np.empty((2, times_s.size, self.values.shape[1]))
        native.positions_and_velocities(self.values, self.moments, self.step_s, times_s, value, slope)
        return value, slope

    def points(self, times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return positions and velocities of points at times, both (I, P, 3)."""
        shape = times_s.size, self.values.shape[1] // 3, 3
        value, slope = self.at(times_s)
        return value.reshape(shape), slope.reshape(shape)


def fit_spline(motion: Motion, columns: npt.NDArray[Any] | None = None) -> Spline:
    """Fit a cubic spline to columns over the frames, by default the motion's points (E-02)."""
    columns = motion.position_m.reshape(motion.n_frames, -1) if columns is None else columns
    if columns.shape[0] < 4 or not np.isfinite(columns).all():
        source = motion.facts.source
        raise MotionError(f"{source}: needs 4 frames or more without gaps to be resampled; clean it first")
    values = np.ascontiguousarray(columns, dtype=np.float64)
    moments = np.empty_like(values)
    step_s = motion.duration_s / (values.shape[0] - 1)
    native.spline_moments(values, step_s, moments)
    return Spline(values, moments, step_s)


def fit_centre(motion: Motion) -> Spline:
    """Fit a spline to the body centre; 3 columns."""
    return fit_spline(motion, body_centre_m(motion))


def check_times(motion: Motion, time_s: npt.ArrayLike) -> FloatArray:
    """Return times after the first frame as float64; MotionError outside the motion."""
    wanted = np.ascontiguousarray(time_s, dtype=np.float64)
    lasts = motion.duration_s
    if wanted.size and (wanted.min() < 0 or wanted.max() > lasts + 1e-9):
        raise MotionError(
            f"{motion.facts.source}: lasts {lasts:.3f} s, but {wanted.max():.3f} s are wanted; shorten "
            "duration_s or use a longer motion"
        )
    return wanted


ARM_PARTS = ("_upper_arm", "_forearm", "_hand")
FORE_PARTS = ("_fore_upper", "_fore_lower", "_fore_paw")
TURN_MARGIN = 0.35
"""Maximum lead of a clock in strides: the timing and three standard deviations of the noise."""
SLOWEST_STRIDE_S = 2.5


class Variation(FrozenModel):
    """Change of a body's motion from its model or recording.

    limb_swing: Factor of the swing of the legs (of an animal: all four) about the trunk.
    arm_swing: Factor of the swing of a person's arms.
    trunk_ripple: Factor of the deviations of the trunk from uniform motion.
    ripple_once_m: Amplitude of a random movement of the whole body at the stride frequency.
    ripple_twice_m: Amplitude of such a movement at twice the stride frequency.
    pitch_deg: Amplitude of the pitch of trunk, head and arms at twice the stride frequency.
    yaw_deg: Amplitude of the yaw of trunk, head and arms at the stride frequency.
    pace: Factor of the stride frequency at equal speed; the swing of the legs is shorter by it.
    swing_timing: Share of a stride by which all limbs lead and lag, which changes the stance time.
    fore_timing: Share of a stride by which the forelimbs (a person's arms) are delayed.
    phase_noise: Standard deviation of the stride clock from stride to stride, in strides.
    """

    limb_swing: float = Field(default=1.0, ge=0.3, le=2.0)
    arm_swing: float = Field(default=1.0, ge=0.0, le=2.5)
    trunk_ripple: float = Field(default=1.0, ge=0.0, le=3.0)
    ripple_once_m: float = Field(default=0.0, ge=0.0, le=0.05)
    ripple_twice_m: float = Field(default=0.0, ge=0.0, le=0.05)
    pitch_deg: float = Field(default=0.0, ge=0.0, le=15.0)
    yaw_deg: float = Field(default=0.0, ge=0.0, le=15.0)
    pace: float = Field(default=1.0, ge=0.6, le=1.6)
    swing_timing: float = Field(default=0.0, ge=-0.12, le=0.12)
    fore_timing: float = Field(default=0.0, ge=-0.12, le=0.12)
    phase_noise: float = Field(default=0.0, ge=0.0, le=0.05)

    def needed_s(self, duration_s: float) -> float:
        """Return the duration of the motion that a varied one needs."""
        return duration_s * self.pace + 2.0 * TURN_MARGIN * SLOWEST_STRIDE_S


def vary(motion: Motion, variation: Variation, rng: np.random.Generator) -> Motion:
    """Vary a motion."""
    stride_hz = motion.facts.stride_frequency_hz
    if not stride_hz > 0:
        raise MotionError(f"{motion.label}: cannot be varied, since its stride frequency is unknown; omit target.vary")
    margin_s = TURN_MARGIN / stride_hz
    lasts_s = (motion.duration_s - 2.0 * margin_s) / variation.pace
    if lasts_s * motion.rate_hz < 4:
        raise MotionError(
            f"{motion.label}: {motion.duration_s:.2f} s are too short to be varied; the lead of the clocks needs "
            f"{2.0 * margin_s:.2f} s more than the scene"
        )
    times_s = np.arange(math.floor(lasts_s * motion.rate_hz + 1e-6) + 1) / motion.rate_hz
    new_hz = stride_hz * variation.pace
    turns = 2.0 * np.pi * rng.random(6)
    # the clock of strides: the timing varies within a stride, the noise from stride to stride
    strides = new_hz * times_s
    deviations = variation.phase_noise * np.clip(rng.normal(size=math.ceil(strides[-1]) + 2), -2.0, 2.0)
    noise = np.interp(strides, np.arange(deviations.size), deviations)
    clock = strides + variation.swing_timing * sine(2.0 * np.pi * strides + turns[0]) + noise
    limb_s = clock / stride_hz + margin_s
    trunk_s = limb_s - variation.swing_timing * sine(2 * np.pi * new_hz * times_s + turns[0]) / stride_hz
    # the path: even motion from the first to the last position of the centre
    centre_m, old_s = body_centre_m(motion), motion.time_s - motion.time_s[0]
    slope = np.polynomial.polynomial.polyfit(old_s, centre_m, 1)

    def about_way(at_s: FloatArray, points: npt.NDArray[np.bool_]) -> FloatArray:
        even_m: FloatArray = slope[0] + slope[1] * at_s[:, None]
        columns = motion.position_m.take(np.flatnonzero(points), axis=1).reshape(old_s.size, -1)
        spline, position_m = fit_spline(motion, columns), np.empty((at_s.size, columns.shape[1]))
        native.values_between(spline.values, spline.moments, spline.step_s, check_times(motion, at_s), position_m)
        return _add_to_points(position_m.reshape(at_s.size, -1, 3), -even_m)

    parts = motion.parts
    fore = np.array([part.endswith(FORE_PARTS + ARM_PARTS) for part in parts])
    arms = np.array([part.endswith(ARM_PARTS) for part in parts])
    central = np.array([part in (*BODY_CENTRE_PARTS, "head", "neck", "tail") for part in parts])
    trunk = np.array([part in BODY_CENTRE_PARTS for part in parts])
    if not trunk.any():
        trunk[:] = True
    found = np.empty((times_s.size, len(parts), 3))
    for points, at_s in ((~fore, limb_s), (fore, limb_s + variation.fore_timing / stride_hz)):
        found[:, points & ~central] = about_way(at_s, points & ~central)
    still = about_way(trunk_s, central | trunk)
    found[:, central] = still[:, central[central | trunk]]
    ripple_m = still[:, trunk[central | trunk]].mean(axis=1)
    swing_m = _add_to_points(found, -ripple_m)
    place_m = swing_m.mean(axis=0)
    swing_m -= place_m
    along = slope[1] / max(float(np.linalg.norm(slope[1])), 1e-9)
    shorter_m = np.where(arms | central, 0.0, 1.0 / variation.pace - 1.0) * (swing_m @ along)
    factor = np.where(arms, variation.arm_swing, np.where(central, 1.0, variation.limb_swing))
    for axis in range(3):
        swing_m[..., axis] += shorter_m * along[axis]
    body_m = place_m + np.repeat(factor[:, None], 3, axis=1) * swing_m
    upper_m = body_m[:, arms | central]
    for degrees, times, turn, pivot in (
        (variation.pitch_deg, 2, turns[3], (-along[1], along[0], 0.0)),
        (variation.yaw_deg, 1, turns[4], (0.0, 0.0, 1.0)),
    ):
        angle_rad = math.radians(degrees) * sine(2.0 * np.pi * times * new_hz * times_s + turn)
        # rotation about an axis through the origin (Rodrigues)
        cos, sin, ahead_m = cosine(angle_rad)[:, None], sine(angle_rad)[:, None], upper_m @ np.array(pivot)
        turned_m = np.empty_like(upper_m)
        for axis in range(3):
            first, second = (axis + 1) % 3, (axis + 2) % 3
            across_m = pivot[first] * upper_m[..., second] - pivot[second] * upper_m[..., first]
            turned_m[..., axis] = upper_m[..., axis] * cos + across_m * sin + ahead_m * pivot[axis] * (1.0 - cos)
        upper_m = turned_m
    body_m[:, arms | central] = upper_m
    mean_m = ripple_m.mean(axis=0)
    ripple_m = mean_m + variation.trunk_ripple * (ripple_m - mean_m)
    for times, size_m, turn in ((1, variation.ripple_once_m, turns[1]), (2, variation.ripple_twice_m, turns[2])):
        way = rng.normal(size=3)
        wave = sine(2.0 * np.pi * times * new_hz * times_s + turn)
        ripple_m = ripple_m + size_m * wave[:, None] * way / np.linalg.norm(way)
    position_m = slope[0] + slope[1] * (times_s[:, None] + margin_s) + ripple_m
    footfalls = {}
    for foot, falls_s in motion.facts.footfalls.items():
        own_s = np.interp(np.asarray(falls_s), limb_s, times_s, left=np.nan, right=np.nan)
        footfalls[foot] = own_s[np.isfinite(own_s)].tolist()
    facts = motion.facts.with_frequencies(lambda hz: hz * variation.pace)
    return motion.remake(_add_to_points(body_m, position_m), replace(facts, footfalls=footfalls))


def _add_to_points(points_m: FloatArray, way_m: FloatArray) -> FloatArray:
    """Add a way (T, 3) to all points (T, P, 3), in place."""
    for axis in range(3):  # a broadcast along the points takes several times as long
        points_m[..., axis] += way_m[:, axis, None]
    return points_m
