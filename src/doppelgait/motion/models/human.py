"""Person who walks or runs like recorded people.

Trunk, pelvis, arms, ankles and feet follow curves measured on recorded people, and feet do not
slide: in stance, the foot rolls from heel to toe; in swing, the difference from the curves fades
from one stance to the next. A walk has the step length, timing and sway of Boulic et al. (1990). A
run has usual timing for an adult of 1.75 m (others by dynamic similarity); its height is mechanics.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from types import SimpleNamespace
from typing import Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator

from doppelgait.core.config import FrozenModel
from doppelgait.core.errors import ConfigError
from doppelgait.core.plugins import plugin
from doppelgait.core.units import FloatArray, arcsine, cosine, sine
from doppelgait.motion.models import boulic
from doppelgait.motion.models.curves import ARM_CURVES, SLOWEST_ARMS, join_curves, make_measured_curve, walk_duty
from doppelgait.motion.models.human_body import (
    ADULT_M,
    CHILD_M,
    PEOPLE,
    POINTS,
    Body,
    Curves,
    Hands,
    Sizes,
    compute_figure_points,
    find_segment_lengths,
    make_person_motions,
    place_left_hip,
    place_legless_points,
    swing_arms,
)
from doppelgait.motion.models.registry import model_function
from doppelgait.motion.models.strides import (
    Columns,
    Curve,
    Rngs,
    Timing,
    Values,
    fit_cubic_spline,
    make_column,
    sample_times_s,
    solve_two_links,
    step_series,
    time_even_strides,
)
from doppelgait.motion.motion import GRAVITY_MPS2, Motion

Advance = Callable[[FloatArray, int], FloatArray]
"""Function of phases that returns the distance travelled in m (order 0), or its slope (order 1)."""

FOOT, RUN = SimpleNamespace(**PEOPLE["foot"]), SimpleNamespace(**PEOPLE["run"])
STANDING_RAD = math.asin(FOOT.rise / FOOT.length)
"""Slope of the line from ankle to tip with a flat sole."""
ANKLE, TIP = FOOT.ankle / FOOT.length, FOOT.ankle / FOOT.length - FOOT.rise / FOOT.length
"""Heights of ankle and tip above the sole, relative to the distance from ankle to tip."""
LEVEL_RAD = math.radians(FOOT.level_deg)
OFFSET = {"left": 0.5, "right": 0.0}
"""Leg phase minus body phase: the right foot lands at 0, the left at 0.5."""

Hips = Mapping[str, FloatArray]
"""Positions of the hips by side, (3, B, n) in m, of B examples."""

_GRID = np.arange(400) / 400
_PRINTS = np.linspace(-0.5, 1.0, 301)
_NUDGE = 1e-5


@dataclass(frozen=True)
class GaitStyle:
    """Cycle of a gait: stride, timing, sole and pose."""

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
    cycle, leg = np.floor(phase[:, :1]) + _GRID, _sample_leg_phases(style.duty)
    in_place = style.hips(np.concatenate([cycle, leg - OFFSET["left"], leg - OFFSET["right"]], axis=1))
    ends = {"left": slice(_GRID.size, -leg.shape[1]), "right": slice(-leg.shape[1], None)}
    feet = make_feet(style, {side: in_place[side][..., ends[side]] for side in ends}, size_m, left_ahead_m)
    reach_m = FOOT.max_extension * (size_m["thigh"] + size_m["shank"])
    # frames and a whole cycle: between the frames' phases, too, the legs must reach the hips
    count, every = phase.shape[1], np.concatenate([phase, cycle], axis=1)
    way_m, rises_m, found = advance(every, 0), [], {}
    for side, foot in feet.items():
        hip_m = np.concatenate([points_m[_number(side, "hip")], in_place[side][..., : _GRID.size]], axis=2)
        hip_m[0, :, count:] += way_m[:, count:]
        ahead, up, slope = style.foot(every + foot.offset)
        own = np.stack([ahead + way_m, hip_m[1], up, slope - STANDING_RAD])
        place, pitch, swings = compute_foot_path(foot, own, every, advance)
        # a swinging foot beyond the legs' reach, as of fast runners, is moved closer
        away_m = place[:2, swings] - hip_m[:2, swings]
        far = np.hypot(*away_m) / np.broadcast_to(reach_m, swings.shape)[swings]
        far = np.maximum(far, 1e-9)
        near, width = FOOT.swing_reach[0], FOOT.swing_reach[1] - FOOT.swing_reach[0]
        shortened = np.where(far > near, near + width * np.tanh((far - near) / width), far)
        place[:2, swings] += away_m * (shortened / far - 1.0)
        toe_m, pitch = place[..., :count].copy(), pitch[:, :count]
        toe_m[0] += size_m["foot"] * cosine(pitch)
        toe_m[2] += size_m["foot"] * sine(pitch)
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
    """Return phases of stance (100), touchdown and lift-off with neighbours (3), (B, 106)."""
    around = np.array([0.0, -_NUDGE, _NUDGE])
    stance = duty * np.arange(100) / 99
    return np.concatenate([stance, np.broadcast_to(around, (len(duty), 3)), duty + around], axis=1)


def make_feet(style: GaitStyle, hips: Hips, size_m: Sizes, left_ahead_m: Values) -> dict[str, Foot]:
    """Make a gait's feet and place their footprints. Hips are those at _sample_leg_phases."""
    cycles, reach_m = _sample_leg_phases(style.duty), FOOT.max_extension * (size_m["thigh"] + size_m["shank"])
    ahead, up, slope = style.foot(cycles)
    roll, way_m = _roll_sole(slope, size_m["foot"]), style.stride_m * cycles[:, :100]
    feet = {}
    for side, hip in hips.items():
        error = roll - np.stack([ahead, hip[1], up, slope - STANDING_RAD])
        around = error[..., -6:-3], error[..., -3:]
        ends = [(at[..., :1], (at[..., 2:] - at[..., 1:2]) / (2 * _NUDGE)) for at in around]
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
    """Find the footprints with the highest hip that the leg always reaches, (B, 1)."""
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
    """Return ankle and pitch relative to the footprint from a sole's slope, (4, ..., n)."""
    beyond = np.maximum(np.abs(sole) - LEVEL_RAD, 0.0)
    turned = np.sign(sole) * beyond**2 / (beyond + LEVEL_RAD)  # smooth when the sole becomes level
    up, slope = np.maximum(turned, 0.0), STANDING_RAD - np.minimum(turned, 0.0)
    heel_m, height_m = FOOT.heel * foot_m, ANKLE * foot_m
    ahead = heel_m * (cosine(up) - 1) - height_m * sine(up) + foot_m * (math.cos(STANDING_RAD) - cosine(slope))
    rise = heel_m * sine(up) + height_m * (cosine(up) - 1) + foot_m * (sine(slope) + TIP)
    return np.stack([ahead, np.zeros_like(sole), rise, turned - STANDING_RAD])


def compute_foot_path(
    foot: Foot, own: FloatArray, phase: FloatArray, advance: Advance
) -> tuple[FloatArray, FloatArray, npt.NDArray[np.bool_]]:
    """Return the path of a foot over the floor. Shapes: own (4, B, n); phase (B, n)."""
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

    # from value and slope at lift-off (share 0) to those at touchdown (share 1), which move the gait's own
    # path onto the floor; slopes fade faster than in a cubic, so that the middle is not faster than measured
    leaving = of_steps(foot.print_m + foot.leaving[0], lands_m - advance(leaves, 0))
    landing = of_steps(foot.print_m + foot.landing[0], 0.0)
    from_slope = width * of_steps(foot.leaving[1], -advance(leaves, 1))
    to_slope = width * of_steps(foot.landing[1], -advance(lands + 1, 1))
    errors = np.stack([leaving, landing - leaving, from_slope, to_slope])
    swings = cycles >= foot.duty
    stands, length_m = ~swings, np.broadcast_to(foot.length_m, phase.shape)
    begin, risen, from_slope, to_slope = errors.reshape(4, 4, -1).take(step[swings], axis=2)
    share = ((cycles - foot.duty) / width)[swings]
    left, square = 1 - share, share * share
    rows = own[:, swings] + begin + square * (1 + 2 * left) * risen
    rows += share * (left * left) ** 2 * from_slope - left * square * square * to_slope
    sole, tip = rows[3] + STANDING_RAD, length_m[swings] * (sine(rows[3]) - TIP)
    heel_m = -length_m[swings] * (FOOT.heel * sine(sole) + ANKLE * cosine(sole))
    # raise a swinging foot smoothly if it would touch the floor, except at the ends of the swing
    rounding = FOOT.clearance_m * 16 * (share * (1 - share)) ** 2
    for point_m in (heel_m, tip):  # heel and toe of the sole relative to the ankle
        depth = -rows[2] - point_m
        rows[2] += (depth + np.sqrt(depth * depth + rounding * rounding)) / 2
    stance = _roll_sole(own[3, stands] + STANDING_RAD, length_m[stands])
    stance[0] += (lands_m + foot.print_m[0]).take(step[stands])
    stance[1:] += np.broadcast_to(foot.print_m[1:], (3, *phase.shape))[:, stands]
    both = np.empty_like(own)
    both[:, swings], both[:, stands] = rows, stance
    return both[:3], both[3], swings


def adult_speed_mps(speed_mps: float, height_m: float) -> float:
    """Return the dynamically similar speed of a 1.75 m adult. The Froude numbers are equal."""
    return speed_mps * math.sqrt(ADULT_M / height_m)


def interpolate_run(table: Sequence[Sequence[float]], adult_mps: FloatArray) -> FloatArray:
    """Interpolate a table of runs at speeds of an adult."""
    x, y = table  # below the first value, the first slope is extrapolated
    below = y[0] + (adult_mps - x[0]) * (y[1] - y[0]) / (x[1] - x[0])
    return np.where(adult_mps < x[0], below, np.interp(adult_mps, x, y))


def run_height_m(phase: npt.ArrayLike, stride_s: Values, duty: Values) -> FloatArray:
    """Return the height of a runner's body relative to touchdown."""
    # half-sine ground force (Morin et al. 2005): in stance z'' = A sin(pi t/t_c) - g with
    # A = pi g t_step/(2 t_c), which supports the weight over a step; in flight z'' = -g
    half = np.mod(np.asarray(phase, dtype=float), 0.5)
    contact_s, step_s = duty * stride_s, stride_s / 2
    force = math.pi * GRAVITY_MPS2 * step_s / (2 * contact_s)
    t = half * stride_s
    stance = GRAVITY_MPS2 * t * (contact_s - t) / 2 - force * (contact_s / math.pi) ** 2 * sine(math.pi * t / contact_s)
    flight = GRAVITY_MPS2 * (t - contact_s) * (step_s - t) / 2
    return np.asarray(np.where(half < duty, stance, flight))


OfPhase = Callable[[FloatArray], FloatArray]
GaitName = Literal["auto", "walk", "run"]


class HumanConfig(FrozenModel):
    """Walking or running person of :func:`human_gait`.

    gait: ``"walk"``, ``"run"`` or ``"auto"``: a run above 2 m/s at 1.75 m, or that Froude number.
    speed_mps: Mean forward speed V. Walk: above 0 to 3 leg lengths per second (2.58 m/s at 1.75 m);
        run: 1.8 to 9 m/s at 1.75 m, and as the square root of the stature.
    height_m: Stature H.
    mass_kg: Body mass; by default that of a body mass index of 23.
    body: ``"adult"``: Boulic's proportions and times at every stature. ``"child"``, 0.9 to 1.6 m: a
        child's proportions, and the walk of an adult of 1.75 m at the same Froude number, with
        times as the square root of the leg.
    foot_lock: Use the measured motion of trunk and feet, with feet at rest on the floor. If false,
        a walk is that of Boulic et al. 1990 (:func:`doppelgait.motion.models.boulic.boulic_walk`),
        with sliding feet.
    walk_ratio: Step length over step frequency, over the model's; people 1 +- 0.16 (sd).
    trunk_ripple: Fore-aft motion of the trunk within a step over the measured one; people 1 +- 0.2.
    lean_deg: Further lean of the trunk, forward positive.
    swing_peak: Deviation of a swinging foot's speed over the measured one; people 1 +- 0.24.
    trunk_asymmetry: (left - right) / mean of the trunk ripple before a landing; people 0 +- 0.4.
    arm_swing: Swing of shoulders and elbows relative to the gait's own; people 0.3 to 2.
    arm_asymmetry: (left - right) / mean of the swing of the arms; people 0.15 +- 0.28.
    left_hand: State of the left hand: ``"free"``, ``"pockets"``, ``"carrying"`` (in front),
        ``"bag"`` (the arm hangs down), ``"phone"`` (at the ear) or ``"pushing"``.
    right_hand: State of the right hand, with the same values as ``left_hand``.
    step_time_sd: Standard deviation of the time of a step over its mean; healthy adults 0.025.
    step_length_sd: Standard deviation of the length of a step over its mean; healthy adults 0.014.
    pace_sd: Standard deviation of a drift of the speed within seconds, mostly by longer steps.
    time_asymmetry: (left - right) / mean of the time of the step before a landing; adults +- 0.02.
    length_asymmetry: (left - right) / mean of the length of that step; adults +- 0.06.
    start_phase: Phase at the start in cycles, 0 (right foot lands) to below 1.
    rate_hz: Frames per second.
    """

    kind: Literal["human"] = "human"
    gait: GaitName = "auto"
    speed_mps: float = Field(1.2, gt=0)
    height_m: float = Field(1.75, ge=0.6, le=2.4)
    mass_kg: float | None = Field(None, gt=0, le=400)
    body: Body = "adult"
    foot_lock: bool = True
    walk_ratio: float = Field(1.0, ge=0.7, le=1.4)
    trunk_ripple: float = Field(1.0, ge=0, le=2.5)
    trunk_asymmetry: float = Field(0.0, ge=-2, le=2)
    lean_deg: float = Field(0.0, ge=-15, le=25)
    swing_peak: float = Field(1.0, ge=0.5, le=1.5)
    arm_swing: float = Field(1.0, ge=0, le=2)
    arm_asymmetry: float = Field(0.0, ge=-2, le=2)
    left_hand: Hands = "free"
    right_hand: Hands = "free"
    step_time_sd: float = Field(0.0, ge=0, le=0.1)
    step_length_sd: float = Field(0.0, ge=0, le=0.1)
    pace_sd: float = Field(0.0, ge=0, le=0.15)
    time_asymmetry: float = Field(0.0, ge=-0.4, le=0.4)
    length_asymmetry: float = Field(0.0, ge=-0.4, le=0.4)
    start_phase: float = Field(0.0, ge=0, lt=1)
    rate_hz: float = Field(250.0, ge=50, le=10_000)

    @model_validator(mode="after")
    def _check_speed(self) -> HumanConfig:
        if self.body == "child" and not CHILD_M[0] <= self.height_m <= CHILD_M[1]:
            raise ValueError(
                f"height_m: {self.height_m:g} is not allowed with body = 'child': must be {CHILD_M[0]:g} to "
                f"{CHILD_M[1]:g} m; use body = 'adult'"
            )
        if self.actual_gait == "run" and not self.foot_lock:
            raise ValueError("foot_lock: False is not allowed for a run; its feet are always placed on the floor")
        low, high = self.speed_range_mps
        if not low * (1 - 1e-9) <= self.speed_mps <= high * (1 + 1e-9):
            raise ValueError(
                f"speed_mps: {self.speed_mps:g} is not allowed: a person of height_m = {self.height_m:g} moves at "
                f"{'above 0' if low == 0 else f'{low:.3g}'} to {high:.3g} m/s in a {self.actual_gait}"
            )
        return self

    @property
    def actual_gait(self) -> Literal["walk", "run"]:
        """The gait; ``"auto"`` is a run above 2 m/s for 1.75 m, and at the same Froude number."""
        if self.gait != "auto":
            return self.gait
        return "run" if adult_speed_mps(self.speed_mps, self.height_m) > RUN.above_mps else "walk"

    @property
    def speed_range_mps(self) -> tuple[float, float]:
        """Lowest and highest speed; 0 is excluded."""
        if self.actual_gait == "run":
            scale = math.sqrt(self.height_m / ADULT_M)
            return RUN.speeds_mps[0] * scale, RUN.speeds_mps[1] * scale
        leg_m, tempo = _find_leg_and_tempo(self)
        return 0.0, boulic.TOP_RELATIVE_SPEED * leg_m * tempo


def _find_style(config: HumanConfig) -> tuple[Callable[[Sequence[HumanConfig], Columns, Sizes], GaitStyle], bool]:
    """Return how a gait is made, and if its steps vary."""
    walk_style = _walk_style if config.foot_lock else _make_boulic_style
    make_style = _run_style if config.actual_gait == "run" else walk_style
    return make_style, any((config.step_time_sd, config.step_length_sd, config.pace_sd, config.time_asymmetry))


@model_function(HumanConfig)
@plugin("motion_model", parameters=HumanConfig, alike=_find_style)
def human_gait(parameters: Sequence[HumanConfig], durations_s: Sequence[float], rngs: Rngs) -> list[Motion]:
    """Generate a walking or running person.

    Trunk, ankles and feet follow the mean of recorded people. A run has a flight phase. With
    ``foot_lock=False`` and otherwise default values, a walk is that of Boulic et al. 1990.

    The points are the 17 of the Boulic walk, along +x from x = 0 over z = 0.

    >>> import doppelgait as dg
    >>> motion = dg.motion.human_gait(speed_mps=1.2, duration_s=2.0)
    >>> round(motion.facts.gait_frequency_hz, 2), round(motion.facts.height_m, 2)  # steps per second, stature
    (1.76, 1.75)
    """
    make_style, varied = _find_style(parameters[0])
    columns = Columns(parameters)
    lengths = [find_segment_lengths(config.body, config.height_m) for config in parameters]
    size_m = {name: make_column([own[name] for own in lengths]) * columns.height_m for name in lengths[0]}
    if parameters[0].foot_lock:
        size_m["foot"] = FOOT.length * columns.height_m  # to the tip
    style = make_style(parameters, columns, size_m)
    # phase as a function of time, and distance as a function of phase if it is not linear
    path: Curve | None = None
    if varied:
        times_s, counts = sample_times_s(durations_s, columns.rate_hz)
        lasts_s, stride_m = times_s[:, -1:], style.stride_m
        steps_s, phases, path_m, sizes = step_series(lasts_s, columns, style.period_s, stride_m, rngs)
        clock, path = fit_cubic_spline(steps_s, phases, sizes), fit_cubic_spline(phases, path_m, sizes)
        timing = Timing(times_s, counts, clock, clock(times_s))
    else:
        timing, _ = time_even_strides(durations_s, columns, style.period_s, rngs)
    phase = timing.phase

    def advance(cycles: FloatArray, order: int) -> FloatArray:
        if path is not None:
            return path(cycles, order)
        if order == 0:
            return np.asarray(style.stride_m * (cycles - phase[:, :1]))
        return np.broadcast_to(style.stride_m, cycles.shape)

    points = style.pose(phase)
    points[:, 0] += advance(phase, 0)
    if parameters[0].foot_lock:
        place_feet(points, phase, advance, style, size_m, columns.length_asymmetry * style.stride_m / 8)
    gaits = [config.actual_gait for config in parameters]
    return make_person_motions(points.transpose(2, 3, 0, 1), timing, parameters, gaits)


def _find_leg_and_tempo(config: HumanConfig) -> tuple[float, float]:
    """Return leg length and tempo over Boulic's: 1, or by Froude number for a child."""
    lengths = find_segment_lengths(config.body, config.height_m)
    leg_m = (lengths["thigh"] + lengths["shank"]) * config.height_m
    adult = find_segment_lengths("adult", ADULT_M)
    adult_m = (adult["thigh"] + adult["shank"]) * ADULT_M
    return leg_m, 1.0 if config.body == "adult" else math.sqrt(adult_m / leg_m)


def _make_boulic_style(parameters: Sequence[HumanConfig], columns: Columns, size_m: Sizes) -> GaitStyle:
    """Make the walk of Boulic et al. 1990. Its feet slide."""
    leg_m, stride_m, period_s, q = _walk_timing(parameters, columns)
    limbs = _add_arms(columns, lambda phase: boulic.limb_angles_deg(phase, q))
    floor_m = boulic.find_floor_m(q, size_m, offset_scale_m=leg_m, offset_signs="continuous")

    def pose(phase: FloatArray) -> FloatArray:
        trunk = _convert_to_radians(boulic.trunk_angles_deg(phase, q))
        points = compute_figure_points(trunk, _convert_to_radians(limbs(np.stack([phase + 0.5, phase]))), size_m)
        points += leg_m * boulic.compute_body_offset(phase, q)
        points[:, 2] -= floor_m
        return points

    return GaitStyle(stride_m, period_s, boulic.compute_support_fraction(q), np.zeros_like, pose, lambda phase: {})


def _walk_timing(parameters: Sequence[HumanConfig], columns: Columns) -> tuple[FloatArray, ...]:
    """Return columns of leg in m, stride in m, stride time in s and relative speed q."""
    leg_m, tempo = map(make_column, zip(*map(_find_leg_and_tempo, parameters), strict=True))
    q = columns.speed_mps / leg_m / tempo
    longer = np.sqrt(columns.walk_ratio)
    return leg_m, 1.346 * np.sqrt(q) * leg_m * longer, boulic.cycle_duration_s(q) / tempo * longer, q


def _walk_style(parameters: Sequence[HumanConfig], columns: Columns, size_m: Sizes) -> GaitStyle:
    leg_m, stride_m, period_s, q = _walk_timing(parameters, columns)
    speed = columns.speed_mps / np.sqrt(GRAVITY_MPS2 * leg_m)
    height = make_measured_curve("walk", "pelvis_height", speed)

    def sway(phase: FloatArray) -> FloatArray:
        sway_m = leg_m * boulic.compute_body_offset(phase, q)
        sway_m[2] = leg_m * height(phase)
        return sway_m

    lean_deg = boulic.lean_deg(q)
    motion = _make_measured_motion(columns, "walk", stride_m, stride_m, size_m, sway=sway, lean_deg=lean_deg)
    return GaitStyle(stride_m, period_s, walk_duty(speed), *motion)


def _run_style(parameters: Sequence[HumanConfig], columns: Columns, size_m: Sizes) -> GaitStyle:
    adult_mps = make_column([adult_speed_mps(config.speed_mps, config.height_m) for config in parameters])
    steps_hz = interpolate_run(RUN.steps, adult_mps) * np.sqrt(ADULT_M / columns.height_m)
    period_s, duty = 2 / steps_hz * np.sqrt(columns.walk_ratio), interpolate_run(RUN.duty, adult_mps)
    leg_m, stride_m = size_m["thigh"] + size_m["shank"], columns.speed_mps * period_s

    def sway(phase: FloatArray) -> FloatArray:
        aside_m = -0.012 * leg_m * sine(2 * np.pi * (phase - 0.1))  # assumed, over the standing leg
        return np.stack([np.zeros_like(phase), aside_m, run_height_m(phase, period_s, duty)])

    lean_deg, arm_swing = np.interp(adult_mps, (2.2, 9.0), (5.0, 10.0)), np.interp(adult_mps, *RUN.arm_swing)
    reach_m = stride_m * duty / RUN.recorded_duty
    motion = _make_measured_motion(
        columns, "run", stride_m, reach_m, size_m, sway=sway, lean_deg=lean_deg, arm_swing=arm_swing
    )
    return GaitStyle(stride_m, period_s, RUN.rest * duty, *motion)


def _make_measured_motion(
    columns: Columns,
    gait: Literal["walk", "run"],
    stride_m: FloatArray,
    reach_m: FloatArray,
    size_m: Sizes,
    *,
    sway: OfPhase,
    lean_deg: FloatArray,
    arm_swing: Values = 1.0,
) -> tuple[OfPhase, OfPhase, Callable[[FloatArray], Hips]]:
    """Make foot, pose and hips from measured curves and the gait's own sway and lean."""
    leg_m = size_m["thigh"] + size_m["shank"]
    speed = columns.speed_mps / np.sqrt(GRAVITY_MPS2 * leg_m)
    curve = partial(make_measured_curve, gait)
    way = partial(curve, dimensionless_speed=speed, integral=True)
    pelvis_way, neck_way = (way(name, asymmetry=columns.trunk_asymmetry) for name in ("pelvis_speed", "neck_speed"))
    both_ways = join_curves(pelvis_way, neck_way)
    foot_curves = join_curves(way("ankle_speed"), curve("ankle_height", speed), curve("foot_pitch", speed))
    shoulder, elbow, torsion = (curve(name, np.maximum(speed, SLOWEST_ARMS)) for name in ARM_CURVES)
    both_turns = join_curves(curve("pelvic_list", speed), curve("pelvic_torsion", speed))
    arms = _add_arms(columns, lambda phase: {"shoulder": shoulder(phase), "elbow": elbow(phase)}, arm_swing)
    ripple_m = columns.trunk_ripple * stride_m

    def tilt(phase: FloatArray) -> dict[str, FloatArray]:
        listing, turned = both_turns(phase + OFFSET["left"])
        return {"pelvic_list": listing, "pelvic_torsion": turned}

    def pose(phase: FloatArray) -> FloatArray:
        pelvis_m, neck_m = ripple_m * both_ways(phase)
        angles, base_m = tilt(phase), sway(phase)
        base_m[0] = pelvis_m
        ahead = (neck_m - pelvis_m) / size_m["torso"]  # of the neck, relative to the pelvis
        angles["thorax_torsion"] = torsion(phase + OFFSET["left"])
        angles["trunk_pitch"] = -lean_deg - columns.lean_deg - np.degrees(arcsine(np.clip(ahead, -0.5, 0.5)))
        trunk_rad, arms_rad = _convert_to_radians(angles), _convert_to_radians(arms(np.stack([phase + 0.5, phase])))
        return place_legless_points(base_m, place_left_hip(trunk_rad, size_m), trunk_rad, arms_rad, size_m)

    def hips(phase: FloatArray) -> Hips:
        base_m = sway(phase)
        base_m[0] = ripple_m * pelvis_way(phase)
        left_m = place_left_hip(_convert_to_radians(tilt(phase)), size_m)
        return {"left": base_m + left_m, "right": base_m - left_m}

    def foot(phase: FloatArray) -> FloatArray:
        ankle, height, pitch_deg = foot_curves(phase)
        return np.stack([reach_m * columns.swing_peak * ankle, leg_m * height, np.radians(pitch_deg)])

    return foot, pose, hips


def _add_arms(columns: Columns, curves: Curves, swing: Values = 1.0) -> Curves:
    left, right = (swing * columns.arm_swing * (1 + side * columns.arm_asymmetry / 2) for side in (1, -1))
    return swing_arms(curves, factors=(left, right), hands=(columns.left_hand, columns.right_hand))


def _convert_to_radians(angles_deg: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    return {name: np.radians(angle) for name, angle in angles_deg.items()}
