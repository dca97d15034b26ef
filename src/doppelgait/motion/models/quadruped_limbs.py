"""Trunk, neck, tail and limbs of a quadruped.

All points follow from the paths of trunk and paws.

Lengths are in units of the hip height h; x forward, y left, z up. Proportions are those of one measured dog and of
breed standards; a build scales them.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import ConfigError
from doppelgait.motion.models.quadruped_gaits import Build, Extremes, Gait, Girdle
from doppelgait.motion.models.strides import columns

FloatArray = npt.NDArray[np.float64]

LIFT_RAMP = 0.15
"""Share of the swing in which a paw speeds up after lift-off, and slows down before touchdown."""


def paw_path(cycles: FloatArray, girdle: Girdle, duty: float) -> tuple[FloatArray, FloatArray]:
    """Return the path of a paw over the ground.

    Parameters
    ----------
    cycles : ndarray
        Strides since a touchdown of this paw; any real number.
    girdle : Girdle
        Its shape.
    duty : float
        Duty factor.

    Returns
    -------
    advance : ndarray
        Distance from the first footfall in strides: constant in stance, one more after each swing. Speed and its
        rate are continuous; both are zero at lift-off and touchdown.
    height : ndarray
        In units of h: zero in stance, highest ``girdle.clearance``.
    """
    turn = np.floor(cycles)
    swing = np.clip((cycles - turn - duty) / (1 - duty), 0.0, 1.0)
    early, late = 5 * girdle.clearance_at, 5 * (1 - girdle.clearance_at)
    top = girdle.clearance_at**early * (1 - girdle.clearance_at) ** late
    height = girdle.clearance / top * swing**early * (1 - swing) ** late
    # The paw leaves the ground quickly (short ramps up to an even speed) and is fastest as it passes under the body (a
    # bell on top), which keeps the stroke of the limb near the measured one.
    even = (1 - girdle.swing_peak / 2) / (0.5 - LIFT_RAMP)
    bell = swing / 2 - np.sin(2 * np.pi * swing) / (4 * np.pi)
    # distance at an even speed of 1 with half-cosine ramps at either end
    first = np.minimum(swing, LIFT_RAMP)
    last = np.maximum(swing - (1 - LIFT_RAMP), 0.0)
    cruise = np.clip(swing - LIFT_RAMP, 0.0, 1 - 2 * LIFT_RAMP)
    rise = first / 2 - LIFT_RAMP / (2 * np.pi) * np.sin(np.pi * first / LIFT_RAMP)
    fall = last / 2 + LIFT_RAMP / (2 * np.pi) * np.sin(np.pi * last / LIFT_RAMP)
    ramped = rise + cruise + fall
    return turn + (even * ramped + (girdle.swing_peak - even) * bell), height


Points = dict[str, FloatArray]

FEMUR, TIBIA, METATARSUS = 0.42, 0.47, 0.28
SCAPULA, HUMERUS, FOREARM, MANUS = 0.36, 0.40, 0.47, 0.19
NECK, SKULL, TAIL = 0.37, 0.45, 0.63

GIRDLE_X, HIP_Z, SCAPULA_Z = 0.52, 1.0, 1.19
TRUNK_Z = (HIP_Z + SCAPULA_Z) / 2
HIP_Y, SCAPULA_Y, TRACK_Y = 0.125, 0.14, 0.12
"""Half widths: hips, tops of the scapulae, paws."""
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
NECK_DEG, SKULL_DEG, TAIL_DEG = 42.0, -22.0, -35.0
"""Mean elevation above the horizontal of neck and skull, and of the tail behind the dog."""

STRETCH = 0.965
"""A limb is never straighter than this share of its full length; the trunk is lowered until that holds."""
LIMBS = tuple((side, end) for end in ("fore", "hind") for side in ("left", "right"))


def two_link(start: FloatArray, end: FloatArray, first: float, second: float, *, bend: float) -> FloatArray:
    """Return the middle joint of two links, shape (n, 3).

    They go from ``start`` to ``end``.

    Parameters
    ----------
    start, end : ndarray, shape (n, 3)
        Ends of the chain, no farther apart than its length and no closer than the difference of the links.
    first, second : float
        Lengths of the links.
    bend : float
        +1: the joint points forward, -1: backward, seen down the chain.
    """
    line = end - start
    distance = np.linalg.norm(line, axis=1, keepdims=True)
    along = (distance**2 + first**2 - second**2) / (2 * distance)
    aside = np.sqrt(np.maximum(first**2 - along**2, 0.0))
    # The bend lies in the plane of the limb and of the direction of travel: across the chain, not sideways.
    across = columns(-line[:, 2], 0.0, line[:, 0])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return np.asarray(start + line / distance * along + bend * across * aside)


def elevation_rad(cycles: FloatArray, extremes_deg: Extremes, duty: float) -> FloatArray:
    """Return the elevation of a segment, in half cosines.

    It swings between its lowest and highest value; ``cycles`` count from touchdown.
    """
    (low_at, low), (high_at, high) = extremes_deg
    since_low = np.mod(cycles - duty - low_at * (1 - duty), 1.0)
    rise = (high_at - low_at) * (1 - duty)
    rises = since_low < rise
    wave = np.cos(np.where(rises, np.pi * since_low / rise, np.pi * (since_low - rise) / (1 - rise)))
    np.negative(wave, out=wave, where=rises)
    return np.radians((low + high) / 2 + (high - low) / 2 * wave)


def hanging(angle_rad: FloatArray) -> FloatArray:
    """Return unit vectors that point down at angle 0, (n, 3).

    They swing forward with the angle.
    """
    return columns(np.sin(angle_rad), 0.0, -np.cos(angle_rad))


def trunk_motion(phase: FloatArray, gait: Gait, build: Build) -> tuple[FloatArray, tuple[FloatArray, FloatArray]]:
    """Return the trunk's offset, and cosine and sine of its pitch.

    The offset (n, 3) is that of its centre from uniform motion at standing height.

    Each girdle heaves as the gait says; pitch, positive nose up, is what the two heaves make of it.
    """

    def wave(zero: float) -> FloatArray:
        return np.asarray(np.cos(2 * np.pi * gait.harmonic * (phase - zero)))

    hind, fore = (-g.heave * wave(g.lowest) for g in (gait.hind, gait.fore))
    rate = 2 * np.pi * gait.harmonic
    surge = gait.surge * np.sin(rate * (phase - gait.surge_fastest))
    sway = gait.sway * np.cos(2 * np.pi * (phase - gait.hind.lowest))
    pitch = np.arcsin((fore - hind) / (2 * GIRDLE_X * build.trunk))
    return columns(surge, sway, (hind + fore) / 2), (np.cos(pitch), np.sin(pitch))


def on_trunk(x: float, y: float, height: float, centre: FloatArray, turn: tuple[FloatArray, FloatArray]) -> FloatArray:
    """Return the path of a point fixed to the trunk.

    The point is named by its position when the dog stands with the middle of its trunk at x = 0.

    ``turn`` is cosine and sine of the trunk's pitch.
    """
    z = height - TRUNK_Z
    cosine, sine = turn
    return np.asarray(centre + columns(x * cosine - z * sine, y, TRUNK_Z + x * sine + z * cosine))


def paws(phase: FloatArray, gait: Gait, build: Build, stride: float, duty: dict[str, float]) -> Points:
    """Return the path of each paw over the ground.

    The trunk's mean position is ``stride`` times the phase.
    """
    result = {}
    for side, end in LIMBS:
        girdle, touchdown = getattr(gait, end), gait.touchdown[f"{side}_{end}"]
        advance, height = paw_path(phase - touchdown, girdle, duty[end])
        middle = girdle.reach + build.trunk * (GIRDLE_X if end == "fore" else -GIRDLE_X)
        x = middle + stride * (touchdown + duty[end] / 2 + advance)
        result[f"{side}_{end}_paw"] = columns(x, TRACK_Y if side == "left" else -TRACK_Y, height)
    return result


def limb_ends(phase: FloatArray, gait: Gait, build: Build, stride: float, duty: dict[str, float]) -> Points:
    """Return paw, carpus or hock, and trunk joint of all limbs.

    The trunk is at standing height.
    """
    centre, turn = trunk_motion(phase, gait, build)
    girdle_x = GIRDLE_X * build.trunk
    centre[:, 0] += stride * phase
    result = paws(phase, gait, build, stride, duty)
    for side, end in LIMBS:
        sign = 1.0 if side == "left" else -1.0
        cycles, paw = phase - gait.touchdown[f"{side}_{end}"], result[f"{side}_{end}_paw"]
        foot = hanging(elevation_rad(cycles, getattr(gait, end).foot_deg, duty[end]))
        if end == "hind":
            result[f"{side}_hock"] = paw - METATARSUS * build.limbs * foot
            result[f"{side}_hip"] = on_trunk(-girdle_x, sign * HIP_Y, HIP_Z, centre, turn)
        else:
            result[f"{side}_carpus"] = paw - MANUS * build.limbs * foot
            top = on_trunk(girdle_x, sign * SCAPULA_Y, SCAPULA_Z, centre, turn)
            scapula = hanging(elevation_rad(cycles, gait.scapula_deg, duty[end]))
            result[f"{side}_shoulder"] = top + SCAPULA * build.limbs * scapula
    return result


def crouch(gait: Gait, build: Build, stride: float, duty: dict[str, float]) -> float:
    """Return by how much the trunk must be lowered.

    Then every limb reaches its paw all through the stride.

    Raises
    ------
    ConfigError
        If no height does: a step too long for the limb, or a limb folded beyond what its joints allow.
    """
    ends = limb_ends(np.arange(720) / 720, gait, build, stride, duty)
    chains = [(f"{side}_hip", f"{side}_hock", FEMUR, TIBIA) for side in ("left", "right")]
    chains += [(f"{side}_shoulder", f"{side}_carpus", HUMERUS, FOREARM) for side in ("left", "right")]
    lower, folded = 0.0, []
    for top, bottom, *links in chains:
        first, second = (build.limbs * link for link in links)
        line = ends[top] - ends[bottom]
        room = (STRETCH * (first + second)) ** 2 - line[:, 0] ** 2 - line[:, 1] ** 2
        if room.min() <= 0:
            raise ConfigError(f"the step is too long for the limb: {top} to {bottom}")
        lower = max(lower, float((line[:, 2] - np.sqrt(room)).max()))
        folded.append((line, abs(first - second)))
    if any((np.hypot(line[:, 0], line[:, 2] - lower) <= 1.05 * least).any() for line, least in folded):
        raise ConfigError("the limb would have to fold up completely")
    return lower


def all_points(
    phase: FloatArray,
    gait: Gait,
    build: Build,
    *,
    stride: float,
    duty: dict[str, float],
    lowered: float,
    wag_rad: FloatArray,
) -> Points:
    """Return all points of the dog by name, (n, 3).

    They are in units of h; the trunk's middle is at ``stride`` times the phase.

    Parameters
    ----------
    phase : ndarray, shape (n,)
        Strides.
    gait : Gait
        What it does.
    build : Build
        Its proportions.
    stride : float
        Stride length.
    duty : dict
        Duty factor of ``"hind"`` and ``"fore"`` paws.
    lowered : float
        See :func:`crouch`.
    wag_rad : ndarray, shape (n,)
        Angle of the tail to the left.
    """
    centre, turn = trunk_motion(phase, gait, build)
    centre += columns(stride * phase, 0.0, -lowered)
    points = {name: on_trunk(build.trunk * x, 0.0, z, centre, turn) for name, (x, z) in TRUNK_POINTS.items()}
    neck_base, tail_base = points["neck_base"], points["tail_base"]
    nod = np.cos(2 * np.pi * gait.harmonic * (phase - gait.neck_highest))
    elevation = np.radians(NECK_DEG + gait.neck_deg * nod)
    along = columns(np.cos(elevation), 0.0, np.sin(elevation))
    skull = math.radians(SKULL_DEG)
    points["neck"] = neck_base + build.head * NECK / 2 * along
    points["head"] = neck_base + build.head * NECK * along
    points["nose"] = points["head"] + build.head * SKULL * np.array([math.cos(skull), 0.0, math.sin(skull)])
    drop, length = math.radians(TAIL_DEG), TAIL * build.tail
    back = columns(-math.cos(drop) * np.cos(wag_rad), math.cos(drop) * np.sin(wag_rad), math.sin(drop))
    points |= {"tail_middle": tail_base + length / 2 * back, "tail_tip": tail_base + length * back}
    ends = limb_ends(phase, gait, build, stride, duty)
    for name in [name for name in ends if name.endswith(("hip", "shoulder"))]:
        ends[name] = ends[name] - [0.0, 0.0, lowered]
    size = build.limbs
    for side in ("left", "right"):
        hip, hock, shoulder, carpus = (ends[f"{side}_{p}"] for p in ("hip", "hock", "shoulder", "carpus"))
        ends[f"{side}_elbow"] = two_link(shoulder, carpus, size * HUMERUS, size * FOREARM, bend=-1.0)
        ends[f"{side}_knee"] = two_link(hip, hock, size * FEMUR, size * TIBIA, bend=1.0)
    return points | ends
