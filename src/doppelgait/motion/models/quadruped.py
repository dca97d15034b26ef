"""Dog, cat, horse or cow from footfalls.

Paws do not slide, the trunk heaves, and the limbs have joints. All points follow from the paths of
trunk and paws, in units of the hip height h: x is forward, y left and z up. Proportions are those
of one measured dog and of breed standards, scaled by a build. Gaits and builds of a batch of B
animals are columns. Shapes: phases (B, n); points (B, n, 3), of both sides (2, B, n, 3).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator

from doppelgait.core.config import FrozenModel
from doppelgait.core.plugins import plugin
from doppelgait.core.units import FloatArray, cosine, exponential, logarithm, sine
from doppelgait.motion.models.curves import find_swing_curve, join_trunk_curves, segment_elevation_rad
from doppelgait.motion.models.quadruped_gaits import (
    BUILDS,
    GAITS,
    TABLES,
    BuildName,
    GaitChoice,
    GaitName,
    duty_factor,
    fit_gait_to_build,
    froude_number,
    froude_speed_mps,
    hip_height_m,
    pick_gait,
    stride_length_m,
)
from doppelgait.motion.models.registry import model_function
from doppelgait.motion.models.strides import (
    STRIDE_CORRELATION,
    Columns,
    Curve,
    Landings,
    Rngs,
    Values,
    fit_cubic_spline,
    make_column,
    make_gait_motions,
    sample_series,
    scale_points,
    solve_two_links,
    stack_columns,
    sum_steps,
    time_even_strides,
)
from doppelgait.motion.motion import Motion
from doppelgait.motion.skeleton import SIDES, list_points

_WORDS = TABLES["points"]
PART_OF_POINT = list_points(" ".join([_WORDS["middle"], *(_WORDS["sided"].replace("*", side) for side in SIDES)]))
"""Points of the dog in order, and the body part of each."""
POINTS = tuple(PART_OF_POINT)


def compute_paw_path(cycles: FloatArray, girdle: Any, duty: Values, swing: Curve) -> tuple[FloatArray, FloatArray]:
    """Return the path of a paw over the ground."""
    turn = np.floor(cycles)
    share = np.clip((cycles - turn - duty) / (1 - duty), 0.0, 1.0)
    at = girdle.clearance_at  # share of the swing at which the paw is highest
    rise, fall = logarithm(share / at), logarithm((1 - share) / (1 - at))
    height = girdle.clearance * exponential(5 * at * rise + 5 * (1 - at) * fall)
    return turn + swing(share), height


Points = dict[str, FloatArray]

BODY = SimpleNamespace(**TABLES["body"])
"""Lengths, places and limits of the standard dog's figure."""
TRUNK_Z = (BODY.hip_z + BODY.fore_z) / 2
TRUNK_POINTS: dict[str, list[float]] = TABLES["trunk_points"]
LEFT = np.array([[[1.0]], [[-1.0]]])  # signs of y of the two sides
_TRUNK_X, _TRUNK_HEIGHT = np.array([*TRUNK_POINTS.values()]).T[..., None, None]
_WHOLE_CYCLE = np.arange(120) / 120


def point_down(angle_rad: FloatArray) -> FloatArray:
    """Return unit vectors that point down at angle 0. A positive angle is forward."""
    return stack_columns(sine(angle_rad), 0.0, -cosine(angle_rad))


@dataclass(frozen=True)
class FootfallCourse:
    """Distance and footfalls. Landings (B, K), each row up to its size, count from first (B, 1)."""

    stride: FloatArray
    first: FloatArray
    sizes: npt.NDArray[np.intp]
    landings: Mapping[str, FloatArray]
    advance: Curve | None = None

    def distance(self, phase: FloatArray) -> FloatArray:
        """Distance in units of h at phases in cycles."""
        return self.stride * phase if self.advance is None else self.advance(phase)


def make_regular_course(phase: FloatArray, gait: Columns, stride: FloatArray) -> FootfallCourse:
    """Return the courses of equal strides over phases."""
    first = np.floor(phase.min(axis=1, keepdims=True)) - 2
    sizes = (np.ceil(phase.max(axis=1, keepdims=True)) + 3.0 - first)[:, 0].astype(np.intp)
    numbers = first + np.arange(sizes.max())
    landings = {foot: numbers + find_touchdowns(gait, foot) for foot in gait.touchdown[0]}
    return FootfallCourse(stride, first, sizes, landings)


def find_touchdowns(gait: Columns, foot: str) -> FloatArray:
    """Return the phases at which a foot lands, (B, 1)."""
    return np.array([[touchdown[foot]] for touchdown in gait.touchdown])


def compute_trunk_motion(
    phase: FloatArray, distance: FloatArray, gait: Columns, build: Columns, stride: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the trunk at standing height, and the swings of neck and tail."""
    # the trunk has (x, y, roll, yaw, rise) of hind and fore girdle, (2, 5, B, n), in degrees
    *girdles, neck, tail = join_trunk_curves(gait.curves, gait.touchdown)(phase)
    trunk = np.array(girdles).reshape(2, 5, *phase.shape)
    trunk[:, :4] *= gait.ripple
    trunk[:, 0] = distance + stride * trunk[:, 0] + BODY.girdle_x * np.stack([-build.trunk, build.trunk])
    return trunk, neck, tail


def place_on_trunk(x: FloatArray, y: Values, height: Values, trunk: FloatArray, build: Columns) -> FloatArray:
    """Return the path of a point that stands at (x, y, height) with the trunk's middle at x = 0."""
    half, standing = BODY.girdle_x * build.trunk, height - TRUNK_Z
    # pelvis and thorax are rigid and have the pitch of the line between the girdles; the loin between them bends
    share = np.clip(0.5 + x / (2 * BODY.bend_x * build.trunk), 0.0, 1.0)
    first, last = trunk[:, :, None]
    ahead, aside, roll, yaw, rise = first + share * (last - first)
    sin = (last[4] - first[4]) / (2 * half)
    along, roll, yaw = x - half * (2 * share - 1), np.radians(roll), np.radians(yaw)
    across, up = y * cosine(roll) - standing * sine(roll), y * sine(roll) + standing * cosine(roll)
    along, up = along * np.sqrt(1 - sin**2) - up * sin, along * sin + up * np.sqrt(1 - sin**2)
    ahead = ahead + along * cosine(yaw) - across * sine(yaw)
    return stack_columns(ahead, aside + along * sine(yaw) + across * cosine(yaw), TRUNK_Z + rise + up)


Ride = tuple[FloatArray, FootfallCourse]
"""Phases in cycles, and the course that they refer to."""


def compute_paws(
    rides: Sequence[Ride], gait: Columns, build: Columns, end: str, duty: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the paths of both paws of a girdle, in mid-stance below it plus the reach."""
    girdle = getattr(gait, end)
    parts = []
    for phase, course in rides:
        if course.advance is None:
            lands = np.stack([find_touchdowns(gait, f"{side}_{end}") for side in SIDES])
            cycles = phase - lands
            print_at = course.stride * (np.floor(cycles) + lands + duty / 2)
            parts.append((cycles, print_at, np.broadcast_to(course.stride, cycles.shape)))
            continue
        lands = np.stack([course.landings[f"{side}_{end}"] for side in SIDES])
        count, numbers = lands.shape[-1], np.broadcast_to(course.first + np.arange(lands.shape[-1]), lands.shape)
        clocks = fit_cubic_spline(lands.reshape(-1, count), numbers.reshape(-1, count), np.tile(course.sizes, 2))
        cycles = clocks(np.concatenate([phase, phase])).reshape(2, *phase.shape)
        place = (np.floor(cycles) - course.first).astype(np.intp)
        place += count * np.arange(2 * len(phase)).reshape(2, -1, 1)
        prints = course.advance(lands + duty / 2)
        print_at = prints.take(place)
        parts.append((cycles, print_at, prints.take(place + 1) - print_at))
    cycles, print_at, step = (np.concatenate(part, axis=-1) for part in zip(*parts, strict=True))
    advance, height = compute_paw_path(cycles, girdle, duty, find_swing_curve(gait.curves, end, girdle.swing_peak))
    x = print_at + (advance - np.floor(cycles)) * step
    x += girdle.reach + build.trunk * (BODY.girdle_x if end == "fore" else -BODY.girdle_x)
    return cycles, stack_columns(x, BODY.track_y * LEFT, height)


def compute_limb_ends(
    rides: Sequence[Ride], gait: Columns, build: Columns, duty: Mapping[str, FloatArray], trunk: FloatArray
) -> Points:
    """Return paws, carpi, hocks and trunk joints of a trunk at standing height, (2, B, n, 3)."""
    limbs, girdle_x = build.limbs[..., None], BODY.girdle_x * build.trunk
    cycles, paw = compute_paws(rides, gait, build, "hind", duty["hind"])
    (along,) = point_down(segment_elevation_rad(gait.curves, ["metatarsus"], cycles, duty["hind"]))
    result = {"hind_paw": paw, "hock": paw - BODY.metatarsus * limbs * along}
    result["hip"] = place_on_trunk(-girdle_x, BODY.hip_y * LEFT, BODY.hip_z, trunk, build)
    cycles, paw = compute_paws(rides, gait, build, "fore", duty["fore"])
    along, scapula = point_down(segment_elevation_rad(gait.curves, ["manus", "scapula"], cycles, duty["fore"]))
    result |= {"fore_paw": paw, "carpus": paw - BODY.manus * limbs * along}
    top = place_on_trunk(girdle_x + BODY.scapula_x, BODY.scapula_y * LEFT, BODY.scapula_z, trunk, build)
    return result | {"ribs": top, "shoulder": top + BODY.scapula * limbs * scapula}


CHAINS = (
    ("shoulder", "carpus", BODY.humerus, BODY.forearm, "elbow", -1.0),
    ("hip", "hock", BODY.femur, BODY.tibia, "knee", 1.0),
)
"""Chains of two links: joint at the trunk, lower end, lengths, joint between them and its bend."""


def compute_crouch(ends: Points, limbs: FloatArray) -> FloatArray:
    """Return the trunk's lowering, (B, 1), with which every limb reaches its paw."""
    lower = np.zeros_like(limbs)
    for top, bottom, first, second, *_ in CHAINS:
        line = ends[top] - ends[bottom]
        room = (BODY.max_extension * limbs * (first + second)) ** 2 - line[..., 0] ** 2 - line[..., 1] ** 2
        missing = (line[..., 2] - np.sqrt(np.maximum(room, 0.0))).max(axis=(0, 2))
        lower = np.maximum(lower, missing[:, None])
    return np.asarray(np.minimum(lower, BODY.deepest_crouch))


def move_along_limb(top: FloatArray, bottom: FloatArray, length: FloatArray) -> None:
    """Move the trunk joint along a nearly straight or folded limb, in place."""
    # a scapula glides over the ribs and a back bends
    line = top - bottom
    share = np.sqrt((line * line).sum(axis=-1)) / length
    far, near = share > BODY.straight[0], share < BODY.folded[0]
    for where, (free, limit) in ((far, BODY.straight), (near, BODY.folded)):
        if where.any():
            more = limit - free
            wanted = free + more * np.tanh((share[where] - free) / more)
            top[where] = bottom[where] + line[where] * (wanted / share[where])[:, None]


def compute_all_points(
    phase: FloatArray,
    gait: Columns,
    build: Columns,
    course: FootfallCourse,
    duty: Mapping[str, FloatArray],
    carriage: Any,
    wag_rad: FloatArray,
) -> Points:
    """Return the dogs' points by name, (B, n, 3)."""
    # carriage: mean elevations neck_deg and tail_deg; wag_rad: angle of the tail to the left
    # frames and a whole cycle of equal strides, in which all limbs must reach their paws
    count, even = phase.shape[1], replace(course, advance=None)
    cycle = np.broadcast_to(_WHOLE_CYCLE, (len(phase), _WHOLE_CYCLE.size))
    distance = np.concatenate([course.distance(phase), even.distance(cycle)], axis=1)
    whole = np.concatenate([phase, cycle], axis=1)
    trunk, nod, lift = compute_trunk_motion(whole, distance, gait, build, course.stride)
    ends = compute_limb_ends(((phase, course), (cycle, even)), gait, build, duty, trunk)
    size = build.limbs
    lowered = compute_crouch({name: place[:, :, count:] for name, place in ends.items()}, size)
    ends = {name: place[:, :, :count] for name, place in ends.items()}
    ends["ribs"][..., 2] -= lowered
    for top, bottom, first, second, joint, bend in CHAINS:
        ends[top][..., 2] -= lowered
        move_along_limb(ends[top], ends[bottom], size * (first + second))
        ends[joint] = solve_two_links(ends[top], ends[bottom], size * first, size * second, bend=bend)
    trunk = trunk[..., :count]
    trunk[:, 4] -= lowered
    fixed = place_on_trunk(build.trunk * _TRUNK_X, 0.0, _TRUNK_HEIGHT, trunk, build)
    points: Points = dict(zip(TRUNK_POINTS, fixed, strict=True))
    neck_base, tail, head = points["neck_base"], points["tail"], build.head[..., None]
    elevation = np.radians(carriage.neck_deg + gait.ripple * nod[:, :count])
    along = stack_columns(cosine(elevation), 0.0, sine(elevation))
    skull = math.radians(BODY.skull_deg)
    points["neck"] = neck_base + head * BODY.neck / 2 * along
    points["head"] = neck_base + head * BODY.neck * along
    points["nose"] = points["head"] + head * BODY.skull * np.array([math.cos(skull), 0.0, math.sin(skull)])
    length, wag = BODY.tail * build.tail, wag_rad
    elevation = np.radians(carriage.tail_deg + lift[:, :count])
    free = BODY.tail_yield_rad - tail[..., 2] / length  # below it, the tail yields to the floor
    yielding = free - BODY.tail_yield_rad * np.tanh((free - elevation) / BODY.tail_yield_rad)
    elevation = np.where(elevation < free, yielding, elevation)
    level = cosine(elevation)
    back = length[..., None] * stack_columns(-level * cosine(wag), level * sine(wag), sine(elevation))
    points |= {"tail_middle": tail + back / 2, "tail_tip": tail + back}
    return points | {f"{side}_{name}": place[row] for name, place in ends.items() for row, side in enumerate(SIDES)}


class QuadrupedConfig(FrozenModel):
    """Four-legged animal of :func:`quadruped_gait`, in one straight gait.

    gait: ``"walk"`` (lateral sequence, Froude number 0.025 to 0.5), ``"pace"`` (0.1 to 1),
        ``"trot"`` (0.3 to 2.5), ``"canter"`` (1 to 5), ``"gallop"`` (rotary, 1.2 to 10),
        ``"transverse_gallop"`` (1.2 to 10), ``"bound"`` (1 to 6), or ``"auto"``: walk up to a
        Froude number of 0.5, trot up to 2.5, then gallop.
    speed_mps: Mean forward speed V. Set either this or ``froude``.
    froude: Froude number of the speed; by default the gait's usual one (trot 1, gallop 4).
    build: Proportions, mass and usual size, a key of
        :data:`doppelgait.motion.models.quadruped_gaits.BUILDS`: ``"standard"``, breeds of dog,
        ``"cat"``, ``"horse"``, ``"cow"``.
    withers_m: Height of the withers when standing: 0.15 to 0.9, for a horse 0.7 to 1.8, for a cow
        0.8 to 1.8. The default is that of the build (standard 0.5).
    start_phase: Phase at the start in strides, 0 (left hind foot lands) to below 1.
    stride_variation: Standard deviation of the stride time over its mean; usual are 0.03 to 0.05.
    pace_sd: Standard deviation of the speed of strides over its mean; usual are 0.04 to 0.1.
    step_length_sd: Standard deviation of the length of half a stride over its mean.
    footfall_sd: Standard deviation of the landing time of a foot, in strides.
    asymmetry: Delay of the landing of both right feet in strides. The frequencies in the facts
        remain those of the gait (f_mu by E-07), although half strides then differ.
    length_asymmetry: (first - second) / mean of the half strides from the left hind foot's landing.
    trunk_ripple: Surge, sway, yaw and roll of the trunk and swing of the neck over the recorded ones.
    stride_ratio: Stride length relative to the gait's at this speed; two dogs differ by 14 %.
    hind_swing_peak: Maximum speed of a swinging hind paw relative to that of the recorded dog.
    fore_swing_peak: Maximum speed of a swinging fore paw relative to that of the recorded dog.
    neck_deg: Mean elevation of the neck.
    tail_deg: Mean elevation of the tail.
    tail_frequency_hz: Frequency of the sideways swing of the tail. The motion repeats every stride
        only if it is a multiple of the stride frequency.
    tail_sweep_deg: Maximum sideways angle of the tail to both sides.
    rate_hz: Frames per second.
    """

    kind: Literal["quadruped"] = "quadruped"
    gait: GaitChoice = "trot"
    speed_mps: float | None = Field(None, gt=0)
    froude: float | None = Field(None, gt=0)
    build: BuildName = "standard"
    withers_m: float | None = Field(None, gt=0)
    start_phase: float = Field(0.0, ge=0, lt=1)
    stride_variation: float = Field(0.0, ge=0, le=0.1)
    pace_sd: float = Field(0.0, ge=0, le=0.15)
    step_length_sd: float = Field(0.0, ge=0, le=0.15)
    footfall_sd: float = Field(0.0, ge=0, le=0.04)
    asymmetry: float = Field(0.0, ge=-0.05, le=0.05)
    length_asymmetry: float = Field(0.0, ge=-0.4, le=0.4)
    trunk_ripple: float = Field(1.0, ge=0, le=2)
    stride_ratio: float = Field(1.0, ge=0.8, le=1.25)
    hind_swing_peak: float = Field(1.0, ge=0.8, le=1.2)
    fore_swing_peak: float = Field(1.0, ge=0.8, le=1.2)
    neck_deg: float = Field(42.0, ge=-40, le=80)
    tail_deg: float = Field(-35.0, ge=-80, le=80)
    tail_frequency_hz: float = Field(1.7, ge=0, le=5)
    tail_sweep_deg: float = Field(30.0, ge=0, le=60)
    rate_hz: float = Field(250.0, ge=50, le=10_000)

    @model_validator(mode="after")
    def _check_speed(self) -> QuadrupedConfig:
        if self.speed_mps is not None and self.froude is not None:
            raise ValueError("give speed_mps or froude, not both")
        if self.gait == "auto" and self.speed_mps is None and self.froude is None:
            raise ValueError("gait: 'auto' depends on the speed: give speed_mps or froude, or name the gait")
        lowest, highest = BUILDS[self.build].withers_range_m
        if not lowest <= self.actual_withers_m <= highest:
            raise ValueError(
                f"withers_m: {self.actual_withers_m:g} is not allowed: {lowest:g} to {highest:g} m "
                f"for a {BUILDS[self.build].species}"
            )
        low, high, _ = GAITS[self.actual_gait].froude
        slowest, fastest = (froude_speed_mps(fr, self.hip_m) for fr in (low, high))
        if not slowest * (1 - 1e-9) <= self.actual_speed_mps <= fastest * (1 + 1e-9):
            if self.froude is not None:
                hint = "" if self.gait == "auto" else '; set gait = "auto" to derive the gait from froude'
                raise ValueError(
                    f"froude: {self.froude:.4g} is not allowed: the Froude number of a {self.actual_gait} is "
                    f"{low:g} to {high:g}{hint}"
                )
            raise ValueError(
                f"speed_mps: {self.actual_speed_mps:.4g} is not allowed: a {BUILDS[self.build].species} with "
                f"withers_m = {self.actual_withers_m:g} moves at {slowest:.3g} to {fastest:.3g} m/s in a "
                f"{self.actual_gait} (Froude number {low:g} to {high:g})"
            )
        return self

    @property
    def actual_withers_m(self) -> float:
        """Withers height, by default that of the build."""
        return BUILDS[self.build].withers_m if self.withers_m is None else self.withers_m

    @property
    def hip_m(self) -> float:
        """Hip height."""
        return hip_height_m(BUILDS[self.build], self.actual_withers_m)

    @property
    def actual_gait(self) -> GaitName:
        """The gait; ``"auto"`` is resolved by speed."""
        if self.gait != "auto":
            return self.gait
        return pick_gait(froude_number(self.actual_speed_mps, self.hip_m))

    @property
    def actual_speed_mps(self) -> float:
        """The speed, or that of the Froude number; by default the gait's usual one."""
        if self.speed_mps is not None:
            return self.speed_mps
        froude = GAITS[self.actual_gait].froude[2] if self.froude is None else self.froude
        return froude_speed_mps(froude, self.hip_m)


def _is_varied(config: QuadrupedConfig) -> bool:
    return any((config.pace_sd, config.step_length_sd, config.footfall_sd, config.length_asymmetry))


@model_function(QuadrupedConfig)
@plugin("motion_model", parameters=QuadrupedConfig, alike=_is_varied)
def quadruped_gait(parameters: Sequence[QuadrupedConfig], durations_s: Sequence[float], rngs: Rngs) -> list[Motion]:
    """Generate a four-legged animal in one straight gait.

    Stride length L = c h Fr^p with Fr = V^2/(g h) and a dog's h = 0.8 withers heights (p = 0.3,
    Alexander and Jayes 1983; in walk and pace 0.23); stride frequency f = V/L. A paw is at rest for
    the share 1 - t_swing f plus an offset of the gait, t_swing = 0.35 s (h/0.46 m)^0.5 L/L_dog.
    Trunk, neck, tail, paws and limbs follow the mean curves of one recorded dog.

    The points are those of :data:`POINTS`, along +x from about x = 0, with paws on z = 0 in stance.

    >>> import doppelgait as dg
    >>> motion = dg.motion.quadruped_gait(duration_s=2.0)
    >>> motion.facts.species, motion.facts.gait, round(motion.facts.stride_frequency_hz, 2)
    ('dog', 'trot', 1.9)
    """
    columns, builds = Columns(parameters), [BUILDS[config.build] for config in parameters]
    gaits = [
        fit_gait_to_build(c.actual_gait, build, c.asymmetry, c.trunk_ripple, c.hind_swing_peak, c.fore_swing_peak)
        for c, build in zip(parameters, builds, strict=True)
    ]
    hip_m = columns.hip_m
    paces = zip(gaits, columns.actual_speed_mps.ravel().tolist(), hip_m.ravel().tolist(), strict=True)
    stride_m = columns.stride_ratio * make_column([stride_length_m(*pace) for pace in paces])
    timing, drift = time_even_strides(durations_s, columns, stride_m / columns.actual_speed_mps, rngs)
    phase, gait = timing.phase, Columns(gaits)
    course = make_regular_course(phase, gait, stride_m / hip_m)
    if _is_varied(parameters[0]):
        course = _vary_course(course, columns, phase, drift, rngs)
    wag_rad = np.radians(columns.tail_sweep_deg) * sine(2 * np.pi * columns.tail_frequency_hz * timing.times_s)
    stride_hz = columns.actual_speed_mps / stride_m
    duty = {end: duty_factor(getattr(gait, end), stride_hz, hip_m) for end in ("hind", "fore")}
    points = compute_all_points(phase, gait, Columns(builds), course, duty, columns, wag_rad)
    position_m = scale_points([points[name] for name in POINTS], hip_m)
    position_m[..., 0] -= (hip_m * course.distance(phase[:, :1]))[..., None]
    landings: list[Landings] = []
    facts: list[dict[str, Any]] = []
    reports = []
    for row, (config, build, (first, last)) in enumerate(zip(parameters, builds, phase[:, [0, -1]], strict=True)):
        own = {foot: course.landings[foot][row, : course.sizes[row]] for foot in gaits[row].touchdown}
        landings.append({foot: at[(at >= first - 1e-9) & (at <= last + 1e-9)] for foot, at in own.items()})
        withers_m = config.actual_withers_m
        mass_kg = build.mass_kg * (withers_m / build.withers_m) ** 3
        body = {"species": build.species, "height_m": withers_m, "mass_kg": mass_kg}
        facts.append({"gait": config.actual_gait, "harmonic": gaits[row].harmonic, **body})
        mass = f"assumed: {build.mass_kg:.3g} kg at withers_m = {build.withers_m:g}, with the cube of the height"
        reports.append({"mass_kg": mass, "proportions": build.source})
    return make_gait_motions(position_m, timing, parameters, landings, PART_OF_POINT, facts, reports)


def _vary_course(
    regular: FootfallCourse, columns: Columns, phase: FloatArray, drift: Curve, rngs: Rngs
) -> FootfallCourse:
    """Return courses whose half strides and landings vary as autoregressive sequences."""
    first = np.floor(2 * phase[:, :1]) - 8
    sizes = (np.ceil(2 * phase[:, -1:]) + 8 - first)[:, 0].astype(int)
    halves = first + np.arange(sizes.max())
    length_sd, sd, feet = columns.step_length_sd, columns.footfall_sd, [*regular.landings]
    kinds = [("step_length_sd", length_sd, sizes, STRIDE_CORRELATION)]
    kinds += [("footfall_sd", sd, regular.sizes, STRIDE_CORRELATION)] * len(feet)
    longer, *late = sample_series(kinds, rngs)
    landings = {foot: regular.landings[foot] + sd * series for foot, series in zip(feet, late, strict=True)}
    lengths = regular.stride / 2 * (1 + columns.length_asymmetry * np.where(halves % 2, -0.5, 0.5))
    lengths += regular.stride / 2 * length_sd * longer
    knots = (first + np.arange(sizes.max() + 1)) / 2
    lengths += regular.stride * np.diff(drift(knots))
    way = fit_cubic_spline(knots, sum_steps(lengths), sizes + 1)
    return replace(regular, landings=landings, advance=way)
