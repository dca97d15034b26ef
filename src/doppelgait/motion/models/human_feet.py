"""Feet that do not slide, and their legs.

A gait's curves define the path of a free ankle. In stance, the foot is on the floor instead and
rolls from heel to toe with the pitch of the gait. In swing, the difference fades from one stance to
the next, so that the swing keeps its shape. The knee follows from hip and ankle.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import ConfigError
from doppelgait.core.units import FloatArray, cosine, sine
from doppelgait.motion.models.human_body import POINTS, Sizes
from doppelgait.motion.models.quadruped_limbs import solve_two_links
from doppelgait.motion.models.strides import Values

Advance = Callable[[FloatArray, int], FloatArray]
"""Function that returns the distance travelled in m at phases in cycles (order 0), or its slope per cycle (order 1)."""

MAX_EXTENSION = 0.99
"""Maximum extension of a leg relative to its length. The knee flexion is then 16 degrees or more."""
FOOT = (0.108, 0.0252)
"""Distance from the ankle to the tip of the toes, and height of the ankle above the tip, as shares
of the stature (means of recordings). The foot rotates about the tip when it rises."""
MIDDLE = 0.8
"""Position of the point ``toe`` between ankle (0) and tip (1). It is midway between ball and tip,
because the point has the cross section of the whole foot."""
STANDING_RAD = math.asin(FOOT[1] / FOOT[0])
"""Slope of the line from ankle to tip with a flat sole."""
ANKLE = 0.034 / FOOT[0]
"""Height of the ankle above the sole (median of recordings), relative to the distance from ankle to tip."""
TIP = ANKLE - FOOT[1] / FOOT[0]
"""Height of the tip above the sole, relative to the distance from ankle to tip."""
HEEL = 0.45
"""Distance from the heel to the point below the ankle, relative to the distance from ankle to tip (assumed)."""
LEVEL_RAD = math.radians(1.5)
"""Measured slope of the sole below which it is flat on the floor."""
SWING_REACH = (0.75, 0.88)
"""Horizontal distance of a swinging ankle from its hip, relative to the leg's reach: up to the
first value it is not changed, and it stays below the second."""
CLEARANCE_M = 0.03
"""Smoothing height of a swing in which the toe would cross the floor. Its clearance is then half of this or more."""
OFFSET = {"left": 0.5, "right": 0.0}
"""Leg phase minus body phase: the right foot lands at 0, the left at 0.5."""

Hips = Mapping[str, FloatArray]
"""Positions of the hips by side, (3, B, n) in m. B is the number of examples; their values are columns, (B, 1)."""

_GRID = np.arange(400) / 400
_PRINTS = np.linspace(-0.5, 1.0, 301)
_NUDGE = 1e-5


@dataclass(frozen=True)
class GaitStyle:
    """Cycle of a gait: stride, timing, sole and pose."""

    name: str
    stride_m: FloatArray
    period_s: FloatArray
    duty: FloatArray
    foot: Callable[[FloatArray], FloatArray]
    pose: Callable[[FloatArray], FloatArray]
    hips: Callable[[FloatArray], Hips]


def place_feet(
    points_m: FloatArray,
    phase: FloatArray,
    advance: Advance,
    style: GaitStyle,
    size_m: Sizes,
    left_ahead_m: Values = 0.0,
) -> None:
    """Place figures on feet that do not slide. Shapes: points_m (17, 3, B, n); phase (B, n)."""
    # segment lengths are kept. A flat sole is at z = 0.
    cycle, leg = np.floor(phase[:, :1]) + _GRID, _sample_leg_phases(style.duty)
    in_place = style.hips(np.concatenate([cycle, leg - OFFSET["left"], leg - OFFSET["right"]], axis=1))
    ends = {"left": slice(_GRID.size, -leg.shape[1]), "right": slice(-leg.shape[1], None)}
    feet = make_feet(style, {side: in_place[side][..., ends[side]] for side in ends}, size_m, left_ahead_m)
    reach_m = MAX_EXTENSION * (size_m["thigh"] + size_m["shank"])
    # Frames and a whole cycle in one call: between the frames' phases, too, the legs must reach the hips.
    count, every = phase.shape[1], np.concatenate([phase, cycle], axis=1)
    way_m, rises_m, found = advance(every, 0), [], {}
    for side, foot in feet.items():
        hip_m = np.concatenate([points_m[_number(side, "hip")], in_place[side][..., : _GRID.size]], axis=2)
        hip_m[0, :, count:] += way_m[:, count:]
        ahead, up, slope = style.foot(every + foot.offset)
        own = np.stack([ahead + way_m, hip_m[1], up, slope - STANDING_RAD])
        place, pitch, swings = compute_foot_path(foot, own, every, advance)
        # a swinging foot beyond the legs' reach, as of very fast runners, is moved closer; a standing one is not
        away_m = place[:2, swings] - hip_m[:2, swings]
        far = np.hypot(*away_m) / np.broadcast_to(reach_m, swings.shape)[swings]
        far = np.maximum(far, 1e-9)
        near, width = SWING_REACH[0], SWING_REACH[1] - SWING_REACH[0]
        shortened = np.where(far > near, near + width * np.tanh((far - near) / width), far)
        place[:2, swings] += away_m * (shortened / far - 1.0)
        toe_m, pitch = place[..., :count].copy(), pitch[:, :count]
        toe_m[0] += MIDDLE * size_m["foot"] * cosine(pitch)
        toe_m[2] += MIDDLE * size_m["foot"] * sine(pitch)
        found[side] = place[..., :count], toe_m
        # the hips are raised until a leg is extended
        leg_m = place - hip_m
        room = reach_m**2 - leg_m[0] ** 2 - leg_m[1] ** 2
        if (room.min(axis=1, keepdims=True) <= (0.4 * reach_m) ** 2).any():
            raise ConfigError(
                "the steps are too long for the legs; lower speed_mps, walk_ratio, step_length_sd or length_asymmetry"
            )
        rises_m.append((leg_m[2] + np.sqrt(room)).min(axis=1))
    points_m[:, 2] += np.minimum(*rises_m)[:, None]
    for side, (ankle_m, toe_m) in found.items():
        hip_m = points_m[_number(side, "hip")]
        top_m, low_m = (place.transpose(1, 2, 0) for place in (hip_m, ankle_m))
        knee_m = solve_two_links(top_m, low_m, size_m["thigh"], size_m["shank"], bend=1.0).transpose(2, 0, 1)
        for joint, place in (("knee", knee_m), ("ankle", ankle_m), ("toe", toe_m)):
            points_m[_number(side, joint)] = place


def _number(side: str, joint: str) -> int:
    return POINTS.index(f"{side}_{joint}")


@dataclass(frozen=True)
class Foot:
    """Motion of a foot. Rows: ankle x, y, z in m, slope from ankle to toe in rad, (4, B, 1)."""

    offset: float
    duty: FloatArray
    length_m: Values
    print_m: FloatArray
    landing: tuple[FloatArray, FloatArray]
    leaving: tuple[FloatArray, FloatArray]


def _sample_leg_phases(duty: FloatArray) -> FloatArray:
    """Return sample phases of stance, touchdown and lift-off, (B, 106)."""
    # stance has a hundred steps. Touchdown and lift-off have a neighbour on both sides.
    around = np.array([0.0, -_NUDGE, _NUDGE])
    stance = duty * np.arange(100) / 99
    return np.concatenate([stance, np.broadcast_to(around, (len(duty), 3)), duty + around], axis=1)


def make_feet(style: GaitStyle, hips: Hips, size_m: Sizes, left_ahead_m: Values) -> dict[str, Foot]:
    """Make a gait's feet and place their footprints. Hips are those at _sample_leg_phases."""
    cycles, reach_m = _sample_leg_phases(style.duty), MAX_EXTENSION * (size_m["thigh"] + size_m["shank"])
    ahead, up, slope = style.foot(cycles)
    roll, way_m = _roll_sole(slope, size_m["foot"]), style.stride_m * cycles[:, :100]
    feet = {}
    for side, hip in hips.items():
        error = roll - np.stack([ahead, hip[1], up, slope - STANDING_RAD])
        ends = [
            (at[..., :1], (at[..., 2:] - at[..., 1:2]) / (2 * _NUDGE)) for at in (error[..., -6:-3], error[..., -3:])
        ]
        beside_m = np.ascontiguousarray(hip[1, :, :100]).mean(axis=1, keepdims=True)
        room_m2 = reach_m**2 - (beside_m - hip[1, :, :100]) ** 2
        print_m = np.zeros((4, *beside_m.shape))
        print_m[0] = _find_best_print(hip[0, :, :100] + way_m, hip[2, :, :100], roll[..., :100], room_m2, reach_m)
        print_m[0] += left_ahead_m if side == "left" else -left_ahead_m
        print_m[1] = beside_m
        feet[side] = Foot(OFFSET[side], style.duty, size_m["foot"], print_m, *ends)
    return feet


def _find_best_print(
    hip_x: FloatArray, hip_z: FloatArray, roll: FloatArray, room_m2: FloatArray, reach_m: Values
) -> FloatArray:
    """Find the footprints with the highest hip, (B, 1)."""
    # the leg must reach the footprint during the whole stance
    places = _PRINTS * reach_m

    def highest(at: FloatArray) -> FloatArray:
        room = room_m2[:, None] - (at[..., None] + roll[0][:, None] - hip_x[:, None]) ** 2
        heights = np.where(room > 0, roll[2][:, None] + np.sqrt(np.maximum(room, 0.0)) - hip_z[:, None], -np.inf)
        return np.asarray(heights.min(axis=2))

    coarse = highest(places[:, ::10])
    near = 10 * coarse.argmax(axis=1)[:, None] + np.arange(-10, 11)
    if np.isneginf(coarse).all(axis=1).any():
        near = np.broadcast_to(np.arange(_PRINTS.size), (len(places), _PRINTS.size))
    near_m = np.take_along_axis(places, np.clip(near, 0, _PRINTS.size - 1), 1)
    return np.take_along_axis(near_m, highest(near_m).argmax(axis=1)[:, None], 1)


def _roll_sole(sole: FloatArray, foot_m: Values) -> FloatArray:
    """Return ankle and pitch relative to the footprint, (4, ..., n)."""
    # they follow from the slope of the sole in stance
    beyond = np.maximum(np.abs(sole) - LEVEL_RAD, 0.0)
    turned = np.sign(sole) * beyond**2 / (beyond + LEVEL_RAD)  # smooth when the sole becomes level
    up, slope = np.maximum(turned, 0.0), STANDING_RAD - np.minimum(turned, 0.0)
    heel_m, height_m = HEEL * foot_m, ANKLE * foot_m
    return np.stack(
        [
            heel_m * (cosine(up) - 1) - height_m * sine(up) + foot_m * (math.cos(STANDING_RAD) - cosine(slope)),
            np.zeros_like(sole),
            heel_m * sine(up) + height_m * (cosine(up) - 1) + foot_m * (sine(slope) + TIP),
            turned - STANDING_RAD,
        ]
    )


def compute_foot_path(
    foot: Foot, own: FloatArray, phase: FloatArray, advance: Advance
) -> tuple[FloatArray, FloatArray, npt.NDArray[np.bool_]]:
    """Return the path of a foot over the floor. Shapes: own (4, B, n); phase (B, n)."""
    # in swing, the gait's own path is corrected by a cubic that matches value and slope of the
    # adjacent stances
    number = np.floor(phase + foot.offset)
    cycles, first = phase + foot.offset - number, number.min(axis=1, keepdims=True)
    # values of each step are computed once; frames select their columns
    step = (number - first).astype(np.intp)
    lands = first + np.arange(step.max() + 1) - foot.offset
    leaves, width = lands + foot.duty, 1 - foot.duty
    lands_m = advance(lands, 0)
    step += np.arange(len(step))[:, None] * lands.shape[1]

    def of_steps(rows: FloatArray, way_m: FloatArray | float) -> FloatArray:
        found = np.repeat(rows, lands.shape[1], axis=2)
        found[0] += way_m
        return found

    # cubic Hermite from value and slope at lift-off (share 0) to those at touchdown (share 1),
    # which move the gait's own path onto the floor in the adjacent stances
    leaving = of_steps(foot.print_m + foot.leaving[0], lands_m - advance(leaves, 0))
    landing = of_steps(foot.print_m + foot.landing[0], 0.0)
    from_slope = width * of_steps(foot.leaving[1], -advance(leaves, 1))
    to_slope = width * of_steps(foot.landing[1], -advance(lands + 1, 1))
    risen = landing - leaving
    cubic = np.stack([leaving, from_slope, 3 * risen - 2 * from_slope - to_slope, from_slope + to_slope - 2 * risen])
    swings = cycles >= foot.duty
    stands, length_m = ~swings, np.broadcast_to(foot.length_m, phase.shape)
    c_0, c_1, c_2, c_3 = cubic.reshape(4, 4, -1).take(step[swings], axis=2)
    share = ((cycles - foot.duty) / width)[swings]
    rows = own[:, swings] + (((c_3 * share + c_2) * share + c_1) * share + c_0)
    sole, tip = rows[3] + STANDING_RAD, length_m[swings] * (sine(rows[3]) - TIP)
    heel_m = -length_m[swings] * (HEEL * sine(sole) + ANKLE * cosine(sole))
    # raise a swinging foot smoothly if it would touch the floor, except at the ends of the swing
    rounding = CLEARANCE_M * 16 * (share * (1 - share)) ** 2
    for point_m in (heel_m, tip):  # heel and toe of the sole relative to the ankle
        depth = -rows[2] - point_m
        rows[2] += (depth + np.sqrt(depth * depth + rounding * rounding)) / 2
    stance = _roll_sole(own[3, stands] + STANDING_RAD, length_m[stands])
    stance[0] += (lands_m + foot.print_m[0]).take(step[stands])
    stance[1:] += np.broadcast_to(foot.print_m[1:], (3, *phase.shape))[:, stands]
    both = np.empty_like(own)
    both[:, swings], both[:, stands] = rows, stance
    return both[:3], both[3], swings
