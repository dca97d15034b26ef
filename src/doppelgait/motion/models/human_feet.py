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
from doppelgait.motion.models.human_body import POINTS
from doppelgait.motion.models.quadruped_limbs import solve_two_links
from doppelgait.motion.models.strides import stack_columns

FloatArray = npt.NDArray[np.float64]
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
"""Positions of the hips by side, (n, 3) in m."""

_GRID = np.arange(400) / 400
_PRINTS = np.linspace(-0.5, 1.0, 301)
_NUDGE = 1e-5


@dataclass(frozen=True)
class GaitStyle:
    """Cycle of a gait: stride, timing, sole and pose."""

    name: str
    stride_m: float
    period_s: float
    duty: float
    foot: Callable[[FloatArray], FloatArray]
    pose: Callable[[FloatArray], FloatArray]
    hips: Callable[[FloatArray], Hips]


def place_feet(
    points_m: FloatArray,
    phase: FloatArray,
    advance: Advance,
    style: GaitStyle,
    size_m: Mapping[str, float],
    left_ahead_m: float = 0.0,
) -> None:
    """Place a figure on feet that do not slide. Shapes: points_m (n, 17, 3); phase (n,)."""
    # segment lengths are kept. A flat sole is at z = 0.
    cycle, leg = np.floor(phase[0]) + _GRID, _sample_leg_phases(style.duty)
    in_place = style.hips(np.concatenate([cycle, leg - OFFSET["left"], leg - OFFSET["right"]]))
    of_legs = {"left": in_place["left"][cycle.size : -leg.size], "right": in_place["right"][-leg.size :]}
    feet = make_feet(style, of_legs, size_m, left_ahead_m)
    reach_m = MAX_EXTENSION * (size_m["thigh"] + size_m["shank"])
    # Frames and a whole cycle in one call: between the frames' phases, too, the legs must reach the hips.
    count, every = phase.size, np.concatenate([phase, cycle])
    way_m, rise_m, found = advance(every, 0), np.inf, {}
    for side, foot in feet.items():
        hip_m = np.concatenate([points_m[:, _number(side, "hip")], in_place[side][: cycle.size]])
        hip_m[count:, 0] += way_m[count:]
        own = style.foot(every + foot.offset)
        own = stack_columns(own[:, 0] + way_m, hip_m[:, 1], own[:, 1], own[:, 2] - STANDING_RAD)
        place, pitch, swings = compute_foot_path(foot, own, every, advance)
        # a swinging foot beyond the legs' reach, as of very fast runners, is moved closer; a standing one is not
        away_m = place[:, :2] - hip_m[:, :2]
        far = np.maximum(np.hypot(away_m[:, 0], away_m[:, 1]) / reach_m, 1e-9)
        near, width = SWING_REACH[0], SWING_REACH[1] - SWING_REACH[0]
        shortened = np.where(swings & (far > near), near + width * np.tanh((far - near) / width), far)
        place[:, :2] += away_m * (shortened / far - 1.0)[:, None]
        sole = stack_columns(np.cos(pitch[:count]), 0.0, np.sin(pitch[:count]))
        found[side] = place[:count], place[:count] + MIDDLE * size_m["foot"] * sole
        # the hips are raised until a leg is extended
        leg_m = place - hip_m
        room = reach_m**2 - leg_m[:, 0] ** 2 - leg_m[:, 1] ** 2
        if room.min() <= (0.4 * reach_m) ** 2:
            raise ConfigError(
                "the steps are too long for the legs; lower speed_mps, walk_ratio, step_length_sd or length_asymmetry"
            )
        rise_m = min(rise_m, float((leg_m[:, 2] + np.sqrt(room)).min()))
    points_m[:, :, 2] += rise_m
    for side, (ankle_m, toe_m) in found.items():
        hip_m = points_m[:, _number(side, "hip")]
        knee_m = solve_two_links(hip_m, ankle_m, size_m["thigh"], size_m["shank"], bend=1.0)
        for joint, place in (("knee", knee_m), ("ankle", ankle_m), ("toe", toe_m)):
            points_m[:, _number(side, joint)] = place


def _number(side: str, joint: str) -> int:
    return POINTS.index(f"{side}_{joint}")


@dataclass(frozen=True)
class Foot:
    """Motion of a foot through a cycle.
    Rows are (x, y, z of the ankle in m, slope of the line from ankle to toe in rad).
    """

    offset: float
    duty: float
    length_m: float
    print_m: FloatArray
    landing: tuple[FloatArray, FloatArray]
    leaving: tuple[FloatArray, FloatArray]


def _sample_leg_phases(duty: float) -> FloatArray:
    """Return sample phases of stance, touchdown and lift-off."""
    # stance has a hundred steps. Touchdown and lift-off have a neighbour on both sides.
    around = np.array([0.0, -_NUDGE, _NUDGE])
    return np.concatenate([duty * np.arange(100) / 99, around, duty + around])


def make_feet(style: GaitStyle, hips: Hips, size_m: Mapping[str, float], left_ahead_m: float) -> dict[str, Foot]:
    """Make a gait's feet and place their footprints. Hips are those at _sample_leg_phases."""
    cycles, reach_m = _sample_leg_phases(style.duty), MAX_EXTENSION * (size_m["thigh"] + size_m["shank"])
    own = style.foot(cycles)
    roll, way_m = _roll_sole(own[:, 2], size_m["foot"]), style.stride_m * cycles[:100]
    feet = {}
    for side, hip in hips.items():
        error = roll - stack_columns(own[:, 0], hip[:, 1], own[:, 1], own[:, 2] - STANDING_RAD)
        ends = [(at[0], (at[2] - at[1]) / (2 * _NUDGE)) for at in (error[-6:-3], error[-3:])]
        moving, beside_m = hip[:100] + stack_columns(way_m, 0.0, 0.0), float(hip[:100, 1].mean())
        ahead_m = left_ahead_m if side == "left" else -left_ahead_m
        print_m = np.array([ahead_m + _find_best_print(moving, roll[:100], beside_m, reach_m), beside_m, 0.0, 0.0])
        feet[side] = Foot(OFFSET[side], style.duty, size_m["foot"], print_m, *ends)
    return feet


def _find_best_print(hip: FloatArray, roll: FloatArray, side_m: float, reach_m: float) -> float:
    """Find the footprint with the highest hip."""
    # the leg must reach the footprint during the whole stance
    places = _PRINTS * reach_m
    room_m2 = reach_m**2 - (side_m - hip[:, 1]) ** 2

    def highest(at: FloatArray) -> FloatArray:
        room = room_m2 - (at[:, None] + roll[:, 0] - hip[:, 0]) ** 2
        heights = np.where(room > 0, roll[:, 2] + np.sqrt(np.maximum(room, 0.0)) - hip[:, 2], -np.inf)
        return np.asarray(heights.min(axis=1))

    coarse = highest(places[::10])
    if np.isneginf(coarse).all():
        return float(places[np.argmax(highest(places))])
    near = 10 * int(np.argmax(coarse))
    places = places[max(near - 10, 0) : near + 11]
    return float(places[np.argmax(highest(places))])


def _roll_sole(sole: FloatArray, foot_m: float) -> FloatArray:
    """Return ankle and pitch relative to the footprint, (n, 4)."""
    # they follow from the slope of the sole in stance
    beyond = np.maximum(np.abs(sole) - LEVEL_RAD, 0.0)
    turned = np.sign(sole) * beyond**2 / (beyond + LEVEL_RAD)  # smooth when the sole becomes level
    up, slope = np.maximum(turned, 0.0), STANDING_RAD - np.minimum(turned, 0.0)
    heel_m, height_m = HEEL * foot_m, ANKLE * foot_m
    return stack_columns(
        heel_m * (np.cos(up) - 1) - height_m * np.sin(up) + foot_m * (math.cos(STANDING_RAD) - np.cos(slope)),
        0.0,
        heel_m * np.sin(up) + height_m * (np.cos(up) - 1) + foot_m * (np.sin(slope) + TIP),
        turned - STANDING_RAD,
    )


def compute_foot_path(
    foot: Foot, own: FloatArray, phase: FloatArray, advance: Advance
) -> tuple[FloatArray, FloatArray, npt.NDArray[np.bool_]]:
    """Return the path of a foot over the floor."""
    # in swing, the gait's own path is corrected by a cubic that matches value and slope of the
    # adjacent stances
    number = np.floor(phase + foot.offset)
    cycles, first = phase + foot.offset - number, number.min()
    # values of each step are computed once; frames select their columns
    step = (number - first).astype(np.intp)
    lands = first + np.arange(step.max() + 1) - foot.offset
    leaves, width = lands + foot.duty, 1 - foot.duty
    lands_m = advance(lands, 0)

    def of_steps(row: FloatArray, way_m: FloatArray | float) -> FloatArray:
        found = np.repeat(row[:, None], lands.size, axis=1)
        found[0] += way_m
        return found

    # cubic Hermite from value and slope at lift-off (share 0) to those at touchdown (share 1), which move the gait's
    # own path onto the floor in the adjacent stances
    leaving = of_steps(foot.print_m + foot.leaving[0], lands_m - advance(leaves, 0))
    landing = of_steps(foot.print_m + foot.landing[0], 0.0)
    from_slope = width * of_steps(foot.leaving[1], -advance(leaves, 1))
    to_slope = width * of_steps(foot.landing[1], -advance(lands + 1, 1))
    risen = landing - leaving
    cubic = np.stack([leaving, from_slope, 3 * risen - 2 * from_slope - to_slope, from_slope + to_slope - 2 * risen])
    c_0, c_1, c_2, c_3 = cubic.take(step, axis=2)
    share = (cycles - foot.duty) / width
    rows = own.T + (((c_3 * share + c_2) * share + c_1) * share + c_0)
    sole, tip = rows[3] + STANDING_RAD, foot.length_m * (np.sin(rows[3]) - TIP)
    heel_m = -foot.length_m * (HEEL * np.sin(sole) + ANKLE * np.cos(sole))
    # raise a swinging foot smoothly if it would touch the floor, except at the ends of the swing
    rounding = CLEARANCE_M * 16 * (share * (1 - share)) ** 2
    for point_m in (heel_m, tip):  # heel and toe of the sole relative to the ankle
        depth = -rows[2] - point_m
        rows[2] += (depth + np.sqrt(depth * depth + rounding * rounding)) / 2
    swings = cycles >= foot.duty
    stance = _roll_sole(own[:, 3] + STANDING_RAD, foot.length_m).T
    stance[0] += (lands_m + foot.print_m[0]).take(step)
    stance[1:] += foot.print_m[1:, None]
    both = np.where(swings, rows, stance)
    return both[:3].T, both[3], swings
