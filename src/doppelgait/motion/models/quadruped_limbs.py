"""Trunk, neck, tail and limbs of a quadruped.

All points follow from the paths of trunk and paws. Lengths are in units of the hip height h. x is forward, y left and z
up. Proportions are those of one measured dog and of breed standards, scaled by a build.

Gaits and builds are those of a batch of B animals, as columns (:class:`doppelgait.motion.models.strides.Columns`).
Shapes: phases (B, n); points (B, n, 3), of both sides (2, B, n, 3).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.units import FloatArray, cosine, exponential, logarithm, sine
from doppelgait.motion.models.curves import find_swing_curve, join_trunk_curves, segment_elevation_rad
from doppelgait.motion.models.strides import Columns, Curve, Values, fit_cubic_spline, stack_columns


def compute_paw_path(cycles: FloatArray, girdle: Any, duty: Values, swing: Curve) -> tuple[FloatArray, FloatArray]:
    """Return the path of a paw over the ground."""
    turn = np.floor(cycles)
    share = np.clip((cycles - turn - duty) / (1 - duty), 0.0, 1.0)
    at = girdle.clearance_at  # share of the swing at which the paw is highest
    rise, fall = logarithm(share / at), logarithm((1 - share) / (1 - at))
    height = girdle.clearance * exponential(5 * at * rise + 5 * (1 - at) * fall)
    return turn + swing(share), height


Points = dict[str, FloatArray]

FEMUR, TIBIA, METATARSUS = 0.455, 0.51, 0.305
SCAPULA, HUMERUS, FOREARM, MANUS = 0.23, 0.435, 0.51, 0.205
NECK, SKULL, TAIL = 0.37, 0.45, 0.63

GIRDLE_X, HIP_Z, FORE_Z = 0.52, 1.08, 1.19
TRUNK_Z = (HIP_Z + FORE_Z) / 2
SCAPULA_X, SCAPULA_Z = 0.07, 1.11
"""Top of the scapula, about which it swings: distance ahead of the girdle, and height."""
HIP_Y, SCAPULA_Y, TRACK_Y = 0.125, 0.14, 0.12
"""Half widths of hips, tops of the scapulae and paws."""
TRUNK_POINTS = {
    "neck_base": (0.62, 1.12),
    "withers": (0.42, 1.25),
    "chest": (0.40, 0.68),
    "back": (-0.05, 1.21),
    "belly": (-0.10, 0.80),
    "rump": (-0.56, 1.20),
    "tail_base": (-0.70, 1.08),
}
"""Points fixed to the trunk in the median plane: (x, height) when the dog stands."""
SKULL_DEG = -22.0
"""Elevation of the skull above the horizontal."""
SWAY_LAG = 0.13
"""Strides from the landing of the left hind foot to the leftmost position of the trunk."""

MAX_EXTENSION, DEEPEST_CROUCH = 0.95, 0.16
"""Maximum extension of a limb relative to its length, and maximum lowering of the trunk in units of h to achieve it."""
STRAIGHT, FOLDED = (0.93, 0.97), (0.40, 0.30)
"""Distance of a limb's ends relative to its length: value from which the joint at the trunk moves, and limit."""
SIDES = ("left", "right")
LEFT, BOTH = np.array([[[1.0]], [[-1.0]]]), np.ones((2, 1, 1))
"""Signs of y of the two sides, and factors of values that are equal on both sides."""
_TRUNK_X, _TRUNK_HEIGHT = np.array([*TRUNK_POINTS.values()]).T[..., None, None]
_WHOLE_CYCLE = np.arange(120) / 120


def solve_two_links(start: FloatArray, end: FloatArray, first: Values, second: Values, *, bend: float) -> FloatArray:
    """Return the middle joint of two links. Shapes: start, end (..., 3)."""
    # the links connect start and end
    line = end - start
    x, y, z = line[..., 0], line[..., 1], line[..., 2]
    level = x * x + z * z
    square = level + y * y
    first_2, second_2 = first**2, second**2
    along = (square + (first_2 - second_2)) / (2 * square)  # share of the line
    # The bend is in the plane of the limb and the direction of travel, perpendicular to the chain.
    across = bend * np.sqrt(np.maximum(first_2 - along * along * square, 0.0) / level)
    return np.asarray(start + stack_columns(x * along - z * across, y * along, z * along + x * across))


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


Trunk = tuple[FloatArray, FloatArray, FloatArray]
"""Path of the trunk's centre, (B, n, 3), and cosine and sine of its pitch, positive with the nose up."""


def compute_trunk_motion(
    phase: FloatArray, distance: FloatArray, gait: Columns, build: Columns, stride: FloatArray
) -> tuple[Trunk, FloatArray, FloatArray]:
    """Return the path of the trunk at standing height."""
    # the surge of the trunk and the heaves of its girdles are the recorded ones. The pitch follows
    # from the two heaves.
    surge, hind, fore, neck, tail = join_trunk_curves(gait.curves, gait.touchdown)(phase)
    sway = gait.sway * cosine(2 * np.pi * (phase - find_touchdowns(gait, "left_hind") - SWAY_LAG))
    sin = (fore - hind) / (2 * GIRDLE_X * build.trunk)
    centre = stack_columns(distance + gait.ripple * stride * surge, sway, (hind + fore) / 2)
    return (centre, np.sqrt(1 - sin**2), sin), neck, tail


def place_on_trunk(x: Values, y: Values, height: Values, trunk: Trunk) -> FloatArray:
    """Return the path of a point on the trunk."""
    # the point is defined by its position when the dog stands with the middle of its trunk at x = 0
    z = height - TRUNK_Z
    centre, cos, sin = trunk
    found = stack_columns(x * cos - z * sin, y, TRUNK_Z + x * sin + z * cos)
    found += centre
    return found


Ride = tuple[FloatArray, FootfallCourse]
"""Phases in cycles, and the course that they refer to."""


def compute_paws(
    rides: Sequence[Ride], gait: Columns, build: Columns, end: str, duty: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the paths of both paws of one girdle."""
    # in the middle of its stance, a paw is below its girdle, shifted by the reach of the gait
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
    x += girdle.reach + build.trunk * (GIRDLE_X if end == "fore" else -GIRDLE_X)
    return cycles, stack_columns(x, TRACK_Y * LEFT, height)


def compute_limb_ends(
    rides: Sequence[Ride], gait: Columns, build: Columns, duty: Mapping[str, FloatArray], trunk: Trunk
) -> Points:
    """Return paw, carpus or hock, and trunk joint."""
    # the trunk is at standing height. Each array is (2, B, n, 3), left and right.
    limbs = build.limbs[..., None]
    cycles, paw = compute_paws(rides, gait, build, "hind", duty["hind"])
    (along,) = point_down(segment_elevation_rad(gait.curves, ["metatarsus"], cycles, duty["hind"]))
    result = {"hind_paw": paw, "hock": paw - METATARSUS * limbs * along}
    result["hip"] = place_on_trunk(-GIRDLE_X * build.trunk * BOTH, HIP_Y * LEFT, HIP_Z, trunk)
    cycles, paw = compute_paws(rides, gait, build, "fore", duty["fore"])
    along, scapula = point_down(segment_elevation_rad(gait.curves, ["manus", "scapula"], cycles, duty["fore"]))
    result |= {"fore_paw": paw, "carpus": paw - MANUS * limbs * along}
    top = place_on_trunk((GIRDLE_X * build.trunk + SCAPULA_X) * BOTH, SCAPULA_Y * LEFT, SCAPULA_Z, trunk)
    return result | {"shoulder": top + SCAPULA * limbs * scapula}


CHAINS = (("hip", "hock", FEMUR, TIBIA), ("shoulder", "carpus", HUMERUS, FOREARM))
"""Chains of two links between a joint at the trunk and the lower end, on both sides."""


def compute_crouch(ends: Points, limbs: FloatArray) -> FloatArray:
    """Return the lowering of the trunk for the limbs, (B, 1)."""
    # every limb then reaches its paw at all positions of ends
    lower = np.zeros_like(limbs)
    for top, bottom, first, second in CHAINS:
        line = ends[top] - ends[bottom]
        room = (MAX_EXTENSION * limbs * (first + second)) ** 2 - line[..., 0] ** 2 - line[..., 1] ** 2
        missing = (line[..., 2] - np.sqrt(np.maximum(room, 0.0))).max(axis=(0, 2))
        lower = np.maximum(lower, missing[:, None])
    return np.minimum(lower, DEEPEST_CROUCH)


def move_along_limb(top: FloatArray, bottom: FloatArray, length: FloatArray) -> None:
    """Move a trunk joint along its limb, in place."""
    # it moves if the limb is nearly straight or folded, since a scapula glides over the ribs and a
    # back bends
    line = top - bottom
    share = np.sqrt((line * line).sum(axis=-1)) / length
    far, near = share > STRAIGHT[0], share < FOLDED[0]
    for where, (free, limit) in ((far, STRAIGHT), (near, FOLDED)):
        if where.any():
            more = limit - free
            wanted = free + more * np.tanh((share[where] - free) / more)
            top[where] = bottom[where] + line[where] * (wanted / share[where])[:, None]


TAIL_YIELD_RAD = 0.25
"""Angle above its lowest possible elevation at which a tail begins to yield (assumed)."""


def lift_above_floor(elevation_rad: FloatArray, height: FloatArray) -> FloatArray:
    """Lift a rod smoothly off the floor. Height is that of its upper end relative to its length."""
    free = TAIL_YIELD_RAD - height
    yielding = free - TAIL_YIELD_RAD * np.tanh((free - elevation_rad) / TAIL_YIELD_RAD)
    return np.where(elevation_rad < free, yielding, elevation_rad)


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
    # the carriage has mean elevations neck_deg and tail_deg; wag_rad is the angle of the tail to the left, (B, n)
    # they are in units of h. The trunk is lowered until all limbs reach their paws.
    # frames and a whole cycle of equal strides in one call: in the cycle, all limbs must reach their paws
    count, even = phase.shape[1], replace(course, advance=None)
    cycle = np.broadcast_to(_WHOLE_CYCLE, (len(phase), _WHOLE_CYCLE.size))
    distance = np.concatenate([course.distance(phase), even.distance(cycle)], axis=1)
    trunk, nod, lift = compute_trunk_motion(
        np.concatenate([phase, cycle], axis=1), distance, gait, build, course.stride
    )
    ends = compute_limb_ends(((phase, course), (cycle, even)), gait, build, duty, trunk)
    size = build.limbs
    lowered = compute_crouch({name: place[:, :, count:] for name, place in ends.items()}, size)
    ends = {name: place[:, :, :count] for name, place in ends.items()}
    for top, bottom, first, second in CHAINS:
        ends[top][..., 2] -= lowered
        move_along_limb(ends[top], ends[bottom], size * (first + second))
    ends["elbow"] = solve_two_links(ends["shoulder"], ends["carpus"], size * HUMERUS, size * FOREARM, bend=-1.0)
    ends["knee"] = solve_two_links(ends["hip"], ends["hock"], size * FEMUR, size * TIBIA, bend=1.0)
    centre, cos, sin = (part[:, :count] for part in trunk)
    centre[..., 2] -= lowered
    fixed = place_on_trunk(build.trunk * _TRUNK_X, 0.0, _TRUNK_HEIGHT, (centre, cos, sin))
    points: Points = dict(zip(TRUNK_POINTS, fixed, strict=True))
    neck_base, tail_base, head = points["neck_base"], points["tail_base"], build.head[..., None]
    elevation = np.radians(carriage.neck_deg + gait.ripple * nod[:, :count])
    along = stack_columns(cosine(elevation), 0.0, sine(elevation))
    skull = math.radians(SKULL_DEG)
    points["neck"] = neck_base + head * NECK / 2 * along
    points["head"] = neck_base + head * NECK * along
    points["nose"] = points["head"] + head * SKULL * np.array([math.cos(skull), 0.0, math.sin(skull)])
    length, wag = TAIL * build.tail, wag_rad
    elevation = lift_above_floor(np.radians(carriage.tail_deg + lift[:, :count]), tail_base[..., 2] / length)
    level = cosine(elevation)
    back = length[..., None] * stack_columns(-level * cosine(wag), level * sine(wag), sine(elevation))
    points |= {"tail_middle": tail_base + back / 2, "tail_tip": tail_base + back}
    return points | {f"{side}_{name}": place[row] for name, place in ends.items() for row, side in enumerate(SIDES)}
