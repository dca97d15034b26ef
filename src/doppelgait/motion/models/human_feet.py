"""Feet that stay where they land: footprints on the floor, and legs that reach them.

A gait's curves say where the ankle would go. In stance it is put on the floor instead, with the foot rolling from heel
to toe; in swing the difference fades from one stance to the next, so that the swing keeps the gait's own shape. The
knee follows from hip and ankle.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import ConfigError
from doppelgait.motion.models.human_body import POINTS
from doppelgait.motion.models.quadruped_limbs import two_link
from doppelgait.motion.models.strides import columns

FloatArray = npt.NDArray[np.float64]
Advance = Callable[[FloatArray, int], FloatArray]
"""Way done in m at phases in cycles (derivative order 0), or its slope per cycle (order 1)."""

STRETCH = 0.99
"""A leg is never straighter than this share of its length: a knee flexed by 16 degrees or more."""
FLAT = (0.15, 0.4)
"""Shares of stance at which the sole comes down and the heel begins to rise (assumed)."""
CLEARANCE_M = 0.03
"""Rounding of the swing where the toe would go through the floor: it passes at half of this or more."""
OFFSET = {"left": 0.5, "right": 0.0}
"""Leg phase minus body phase: the right foot lands at 0, the left at 0.5."""

_GRID = np.arange(400) / 400
_NUDGE = 1e-5


@dataclass(frozen=True)
class Style:
    """What a gait does in one cycle.

    Parameters
    ----------
    name : str
        ``"walk"`` or ``"run"``.
    stride_m, period_s : float
        Mean length and time of a stride.
    duty : float
        Share of the cycle for which a foot is on the ground.
    sole_deg : (float, float, float)
        Angle of the sole, toe up positive, when it lands, while it stands, when it leaves.
    pose : callable
        Phases in cycles, shape (n,), to points in place, (n, 17, 3) in m, about the base of the spine.
    """

    name: str
    stride_m: float
    period_s: float
    duty: float
    sole_deg: tuple[float, float, float]
    pose: Callable[[FloatArray], FloatArray]


def place_feet(
    points_m: FloatArray, phase: FloatArray, advance: Advance, style: Style, size_m: Mapping[str, float]
) -> FloatArray:
    """Put a figure on the floor, its feet still while they stand; segment lengths stay.

    Parameters
    ----------
    points_m : ndarray, shape (n, 17, 3)
        The style's pose at the phases, moved forward by ``advance``.
    phase : ndarray, shape (n,)
        Cycles.
    advance : callable
        See :data:`Advance`.
    style : Style
        The gait.
    size_m : mapping of float
        ``thigh``, ``shank`` and ``foot``.

    Returns
    -------
    ndarray, shape (n, 17, 3)
        Sole on z = 0 while flat; the trunk as high as the legs reach all the time.

    Raises
    ------
    ConfigError
        If the step is too long for the legs.
    """
    cycle, leg = np.floor(phase[0]) + _GRID, _leg_phases(style.duty)
    poses = style.pose(np.concatenate([cycle, *(leg - offset for offset in OFFSET.values())]))
    whole, *of_legs = np.split(poses, [cycle.size, cycle.size + leg.size])
    whole[:, :, 0] += advance(cycle, 0)[:, None]
    reach_m = STRETCH * (size_m["thigh"] + size_m["shank"])
    # Frames and a whole cycle in one go: the hips must not be higher between the frames' phases than legs reach.
    count, every, both = phase.size, np.concatenate([phase, cycle]), np.concatenate([points_m, whole])
    rise_m, result = np.inf, points_m.copy()
    for side, pose in zip(OFFSET, of_legs, strict=True):
        hip, ankle, toe = (_number(side, joint) for joint in ("hip", "ankle", "toe"))
        place, pitch = ankle_and_pitch(make_foot(style, side, pose, size_m), _rows(both, side), every, advance)
        sole = columns(np.cos(pitch[:count]), 0.0, np.sin(pitch[:count]))
        result[:, ankle], result[:, toe] = place[:count], place[:count] + size_m["foot"] * sole
        # the hips are raised until a leg is stretched
        leg_m = place - both[:, hip]
        room = reach_m**2 - leg_m[:, 0] ** 2 - leg_m[:, 1] ** 2
        if room.min() <= (0.4 * reach_m) ** 2:
            raise ConfigError(
                "the steps are too long for the legs; lower speed_mps, walk_ratio, step_length_sd or length_asymmetry"
            )
        rise_m = min(rise_m, float((leg_m[:, 2] + np.sqrt(room)).min()))
    legs = [_number(side, joint) for side in OFFSET for joint in ("ankle", "toe")]
    result[:, [n for n in range(len(POINTS)) if n not in legs], 2] += rise_m
    for side in OFFSET:
        ends = result[:, _number(side, "hip")], result[:, _number(side, "ankle")]
        result[:, _number(side, "knee")] = two_link(*ends, size_m["thigh"], size_m["shank"], bend=1.0)
    return result


def _number(side: str, joint: str) -> int:
    return POINTS.index(f"{side}_{joint}")


@dataclass(frozen=True)
class Foot:
    """One foot through a cycle; rows are (x, y, z of the ankle in m, pitch of the sole in rad).

    Parameters
    ----------
    offset : float
        Leg phase minus body phase.
    duty : float
        Share of the cycle on the ground.
    length_m : float
        From ankle to toe.
    roll : callable
        Leg phases (n,) in stance to rows against the footprint, (n, 4).
    print_m : ndarray, shape (4,)
        Footprint against the way done when the foot lands.
    landing, leaving : (ndarray, ndarray), shape (4,)
        Roll less the gait's own row in place at that moment, and the slope of this difference per cycle.
    """

    offset: float
    duty: float
    length_m: float
    roll: Callable[[FloatArray], FloatArray]
    print_m: FloatArray
    landing: tuple[FloatArray, FloatArray]
    leaving: tuple[FloatArray, FloatArray]


def _leg_phases(duty: float) -> FloatArray:
    """Stance in a hundred steps, then touchdown and lift-off with a neighbour on either side each."""
    around = np.array([0.0, -_NUDGE, _NUDGE])
    return np.concatenate([duty * np.arange(100) / 99, around, duty + around])


def make_foot(style: Style, side: str, points: FloatArray, size_m: Mapping[str, float]) -> Foot:
    """Foot of a gait that takes ``points`` at :func:`_leg_phases`, its print placed so that the trunk sinks least."""
    duty, cycles = style.duty, _leg_phases(style.duty)
    stance = cycles[:100]
    roll = partial(_roll, duty=duty, sole_rad=np.radians(style.sole_deg), foot_m=size_m["foot"])
    error = roll(cycles) - _rows(points, side)
    hip = points[:100, _number(side, "hip")] + style.stride_m * np.outer(stance, [1, 0, 0])
    beside_m = float(points[:100, _number(side, "ankle"), 1].mean())
    ahead_m = _best_print(hip, roll(stance), beside_m, STRETCH * (size_m["thigh"] + size_m["shank"]))
    ends = [(at[0], (at[2] - at[1]) / (2 * _NUDGE)) for at in (error[-6:-3], error[-3:])]
    return Foot(OFFSET[side], duty, size_m["foot"], roll, np.array([ahead_m, beside_m, 0.0, 0.0]), *ends)


def _rows(points: FloatArray, side: str) -> FloatArray:
    ankle, toe = (points[:, _number(side, joint)] for joint in ("ankle", "toe"))
    pitch = np.arctan2(toe[:, 2] - ankle[:, 2], toe[:, 0] - ankle[:, 0])
    return columns(ankle[:, 0], ankle[:, 1], ankle[:, 2], pitch)


def _best_print(hip: FloatArray, roll: FloatArray, side_m: float, reach_m: float) -> float:
    """Place of the footprint along the way for which the hip can be highest all through stance.

    The height is concave in the place, as the least of arcs of circles: a coarse look tells where to look closely.
    """
    places = np.linspace(-0.5, 1.0, 301) * reach_m
    room_m2 = reach_m**2 - (side_m - hip[:, 1]) ** 2

    def highest(asked: FloatArray) -> FloatArray:
        room = room_m2 - (asked[:, None] + roll[:, 0] - hip[:, 0]) ** 2
        heights = np.where(room > 0, roll[:, 2] + np.sqrt(np.maximum(room, 0.0)) - hip[:, 2], -np.inf)
        return np.asarray(heights.min(axis=1))

    coarse = highest(places[::10])
    if np.isneginf(coarse).all():
        return float(places[np.argmax(highest(places))])
    near = 10 * int(np.argmax(coarse))
    places = places[max(near - 10, 0) : near + 11]
    return float(places[np.argmax(highest(places))])


def _roll(cycles: FloatArray, *, duty: float, sole_rad: FloatArray, foot_m: float) -> FloatArray:
    """Ankle and pitch against the footprint: the toe comes down about the ankle, then the heel rises about the toe."""
    landing, standing, leaving = sole_rad
    down, up = FLAT[0] * duty, FLAT[1] * duty
    early = np.maximum(1 - cycles / down, 0.0) ** 2
    late = np.maximum((cycles - up) / (duty - up), 0.0) ** 2
    heel = standing + (leaving - standing) * late
    pitch = heel + (landing - standing) * early
    return columns(foot_m * (1 - np.cos(heel)), 0.0, -foot_m * np.sin(heel), pitch)


def ankle_and_pitch(foot: Foot, own: FloatArray, phase: FloatArray, advance: Advance) -> tuple[FloatArray, FloatArray]:
    """Path of a foot over the floor.

    In swing the gait's own path is corrected by a cubic that takes up value and slope of the stances around it.

    Parameters
    ----------
    foot : Foot
        The foot.
    own : ndarray, shape (n, 4)
        The gait's own rows, moved forward.
    phase : ndarray, shape (n,)
        Body phases.
    advance : callable
        See :data:`Advance`.

    Returns
    -------
    ankle_m : ndarray, shape (n, 3)
    pitch_rad : ndarray, shape (n,)
        Angle of the sole, toe up positive.
    """
    number = np.floor(phase + foot.offset)
    cycles, lands = phase + foot.offset - number, number - foot.offset
    stance = _forward(advance(lands, 0)) + foot.print_m + foot.roll(cycles)
    leaving = _correction(foot, foot.leaving, lands, lands + foot.duty, advance)
    landing = _correction(foot, foot.landing, lands + 1, lands + 1, advance)
    # cubic Hermite from value and slope at lift-off (share 0) to those at touchdown (share 1)
    width = 1 - foot.duty
    share = ((cycles - foot.duty) / width)[:, None]
    left = 1 - share
    values = left**2 * (1 + 2 * share) * leaving[0] + share**2 * (3 - 2 * share) * landing[0]
    correction = values + width * (left**2 * share * leaving[1] - share**2 * left * landing[1])
    swing = _clear_of_the_floor(own + correction, share[:, 0], foot.length_m)
    both = np.where((cycles < foot.duty)[:, None], stance, swing)
    return both[:, :3], both[:, 3]


def _clear_of_the_floor(rows: FloatArray, share: FloatArray, foot_m: float) -> FloatArray:
    """Raise a foot in swing where it would go through the floor, smoothly, and not at the ends of the swing."""
    rounding = CLEARANCE_M * 16 * (share * (1 - share)) ** 2
    lifted = rows.copy(order="K")
    for point_m in (0.0, foot_m):
        depth = -lifted[:, 2] - point_m * np.sin(rows[:, 3])
        lifted[:, 2] += (depth + np.hypot(depth, rounding)) / 2
    return lifted


def _forward(way_m: FloatArray) -> FloatArray:
    return columns(way_m, 0.0, 0.0, 0.0)


def _correction(
    foot: Foot, error: tuple[FloatArray, FloatArray], lands: FloatArray, at: FloatArray, advance: Advance
) -> tuple[FloatArray, FloatArray]:
    """What brings the gait's own path onto the floor at phases of stances that began at ``lands``, and its slope."""
    value = _forward(advance(lands, 0) - advance(at, 0)) + foot.print_m + error[0]
    return value, error[1] - _forward(advance(at, 1))
