"""The 17 points of a person from joint angles: the kinematic chain that walking and running share."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Literal

import numpy as np
import numpy.typing as npt

from doppelgait.motion.skeleton import BOULIC_PARTS

FloatArray = npt.NDArray[np.float64]

Limbs = dict[str, FloatArray]
Curves = Callable[[FloatArray], Limbs]
"""Leg phases of left and right, (2, n), to flexions in degrees by joint, each (2, n)."""
Hands = Literal["free", "pockets", "carrying"]

HELD = {"pockets": (-12.0, 45.0, 0.15), "carrying": (5.0, 90.0, 0.1)}
"""Mean shoulder and elbow flexion in degrees, and the share of the swing that is left (assumed)."""

_CYCLE = np.arange(200) / 200


def swing_arms(curves: Curves, *, factor: float, hands: tuple[Hands, Hands]) -> Curves:
    """Joint curves with another arm swing.

    Parameters
    ----------
    curves : callable
        The gait's own.
    factor : float
        Swing of shoulder and elbow about their means relative to the gait's own; exactly its own at 1.
    hands : (str, str)
        Left and right: ``"free"``; ``"pockets"`` or ``"carrying"``: see :data:`HELD`.
    """
    if factor == 1 and hands == ("free", "free"):
        return curves
    means = {joint: curves(np.stack([_CYCLE, _CYCLE]))[joint].mean() for joint in ("shoulder", "elbow")}

    def changed(phase: FloatArray) -> Limbs:
        limbs = dict(curves(phase))
        for number, joint in enumerate(("shoulder", "elbow")):
            rows = []
            for hand, own in zip(hands, limbs[joint], strict=True):
                held = HELD.get(hand)
                mean, share = (held[number], held[2]) if held else (means[joint], 1.0)
                rows.append(mean + factor * share * (own - means[joint]))
            limbs[joint] = np.stack(rows)
        return limbs

    return changed


Place = tuple[npt.ArrayLike, npt.ArrayLike, npt.ArrayLike]

POINTS = tuple(BOULIC_PARTS)
"""Names of the points in the published order."""

_SIDES = ("left", "right")
_LOWER = [POINTS.index(n) for n in ("base", *(f"{s}_{p}" for s in _SIDES for p in ("hip", "knee", "ankle", "toe")))]
_UPPER = [
    POINTS.index(n) for n in ("neck", "head", *(f"{s}_{p}" for s in _SIDES for p in ("shoulder", "elbow", "hand")))
]
"""Points that turn with the pelvis, and those that turn with the upper body, in the order they are made in."""


def figure_points(
    trunk_rad: Mapping[str, FloatArray], limbs_rad: Mapping[str, FloatArray], size_m: Mapping[str, float]
) -> FloatArray:
    """Points of the figure about the base of its spine (Chen 2011).

    Parameters
    ----------
    trunk_rad : mapping of ndarray, shape (n,)
        ``trunk_pitch`` (negative leans forward), ``pelvic_torsion``, ``pelvic_list``, ``thorax_torsion``.
    limbs_rad : mapping of ndarray, shape (2, n)
        Flexion of ``hip``, ``knee``, ``ankle``, ``shoulder``, ``elbow``; left, then right.
    size_m : mapping of float
        Segment lengths, keys as :data:`doppelgait.motion.models.boulic.LENGTHS`.

    Returns
    -------
    ndarray, shape (n, 17, 3)
        Metres in the order of :data:`POINTS`; x forward, y left, z up.
    """
    count = limbs_rad["hip"].shape[1]
    lower, upper = (
        _columns(_pelvis_and_legs(limbs_rad, size_m), count),
        _columns(_spine_and_arms(limbs_rad, size_m), count),
    )
    _rotate(lower, trunk_rad["pelvic_list"], axis=0)
    _rotate(lower, -trunk_rad["pelvic_torsion"], axis=2)
    _rotate(upper, -trunk_rad["trunk_pitch"], axis=1)
    _rotate(upper, -trunk_rad["thorax_torsion"], axis=2)
    result = np.empty((count, len(POINTS), 3))
    result[:, _LOWER], result[:, _UPPER] = lower.T, upper.T
    return result


def _columns(points: Sequence[Place], count: int) -> FloatArray:
    """Coordinates of points as (3, k, n): whole columns are turned at a time."""
    found = np.empty((3, len(points), count))
    for number, point in enumerate(points):
        for row, part in zip(found[:, number], point, strict=True):
            row[...] = part
    return found


def _pelvis_and_legs(limbs: Mapping[str, FloatArray], size: Mapping[str, float]) -> list[Place]:
    """Base of the spine, then hip, knee, ankle and toe of the left and the right side."""
    found: list[Place] = [(0.0, 0.0, 0.0)]
    shank = limbs["hip"] - limbs["knee"]
    # The foot is a rod at right angles to the shank when the ankle is at zero.
    foot = shank + limbs["ankle"] + np.pi / 2
    links = ((limbs["hip"], size["thigh"]), (shank, size["shank"]), (foot, size["foot"]))
    x, z = _hanging((0.0, 0.0), links)
    for row, beside in enumerate((size["half_hip"], -size["half_hip"])):
        found += [(0.0, beside, 0.0), *((x_k[row], beside, z_k[row]) for x_k, z_k in zip(x, z, strict=True))]
    return found


def _spine_and_arms(limbs: Mapping[str, FloatArray], size: Mapping[str, float]) -> list[Place]:
    """Neck and head, then shoulder, elbow and hand of the left and the right side."""
    top = size["torso"]
    found: list[Place] = [(0.0, 0.0, top), (0.0, 0.0, top + size["head"])]
    links = ((limbs["shoulder"], size["upper_arm"]), (limbs["shoulder"] + limbs["elbow"], size["forearm"]))
    x, z = _hanging((0.0, top), links)
    for row, beside in enumerate((size["half_shoulder"], -size["half_shoulder"])):
        found += [(0.0, beside, top), *((x_k[row], beside, z_k[row]) for x_k, z_k in zip(x, z, strict=True))]
    return found


def _hanging(
    start: tuple[float, float], links: Sequence[tuple[FloatArray, float]]
) -> tuple[list[FloatArray], list[FloatArray]]:
    """Ends (x, z) of links one below the other that hang straight down at angle 0 and swing forward with it."""
    ends_x, ends_z = [], []
    x, z = (np.asarray(part) for part in start)
    for angle_rad, length in links:
        x, z = x + length * np.sin(angle_rad), z - length * np.cos(angle_rad)
        ends_x.append(x)
        ends_z.append(z)
    return ends_x, ends_z


def _rotate(xyz: FloatArray, angle_rad: FloatArray, *, axis: int) -> None:
    """Right-handed rotation of points (3, k, n), in place, about a coordinate axis through the origin by n angles."""
    first, second = (axis + 1) % 3, (axis + 2) % 3
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    turned = cosine * xyz[first] - sine * xyz[second]
    xyz[second] = sine * xyz[first] + cosine * xyz[second]
    xyz[first] = turned
