"""The 17 points of a person from joint angles: the kinematic chain that walking and running share."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from doppelgait.motion.skeleton import BOULIC_PARTS

FloatArray = npt.NDArray[np.float64]

POINTS = tuple(BOULIC_PARTS)
"""Names of the points in the published order."""


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
    lower, upper = {"base": np.zeros((count, 3))}, _spine(count, size_m)
    for row, (side, sigma) in enumerate((("left", 1.0), ("right", -1.0))):
        angle = {name: both[row] for name, both in limbs_rad.items()}
        lower |= {f"{side}_{name}": xyz for name, xyz in _leg(angle, sigma, size_m).items()}
        upper |= {f"{side}_{name}": xyz for name, xyz in _arm(angle, sigma, size_m).items()}
    halves = _turn_pelvis(_columns(lower), trunk_rad), _turn_upper_body(_columns(upper), trunk_rad)
    order = [[*lower, *upper].index(name) for name in POINTS]
    return np.asarray(np.concatenate(halves, axis=1)[:, order])


def _columns(points: dict[str, FloatArray]) -> FloatArray:
    return np.stack(list(points.values()), axis=1)


def _spine(count: int, size: Mapping[str, float]) -> dict[str, FloatArray]:
    up = np.array([0.0, 0.0, 1.0])
    return {
        "neck": np.tile(size["torso"] * up, (count, 1)),
        "head": np.tile((size["torso"] + size["head"]) * up, (count, 1)),
    }


def _leg(angle: dict[str, FloatArray], sigma: float, size: Mapping[str, float]) -> dict[str, FloatArray]:
    shank = angle["hip"] - angle["knee"]
    # The foot is a rod at right angles to the shank when the ankle is at zero.
    foot = shank + angle["ankle"] + np.pi / 2
    hip = np.tile([0.0, sigma * size["half_hip"], 0.0], (shank.size, 1))
    knee = hip + size["thigh"] * _hanging(angle["hip"])
    ankle = knee + size["shank"] * _hanging(shank)
    return {"hip": hip, "knee": knee, "ankle": ankle, "toe": ankle + size["foot"] * _hanging(foot)}


def _arm(angle: dict[str, FloatArray], sigma: float, size: Mapping[str, float]) -> dict[str, FloatArray]:
    forearm = angle["shoulder"] + angle["elbow"]
    shoulder = np.tile([0.0, sigma * size["half_shoulder"], size["torso"]], (forearm.size, 1))
    elbow = shoulder + size["upper_arm"] * _hanging(angle["shoulder"])
    return {"shoulder": shoulder, "elbow": elbow, "hand": elbow + size["forearm"] * _hanging(forearm)}


def _hanging(angle_rad: FloatArray) -> FloatArray:
    """Unit vectors that hang straight down at angle 0 and swing forward with it, shape (n, 3)."""
    return np.stack([np.sin(angle_rad), np.zeros_like(angle_rad), -np.cos(angle_rad)], axis=-1)


def _turn_pelvis(xyz: FloatArray, trunk: Mapping[str, FloatArray]) -> FloatArray:
    return _rotate(_rotate(xyz, trunk["pelvic_list"], axis=0), -trunk["pelvic_torsion"], axis=2)


def _turn_upper_body(xyz: FloatArray, trunk: Mapping[str, FloatArray]) -> FloatArray:
    return _rotate(_rotate(xyz, -trunk["trunk_pitch"], axis=1), -trunk["thorax_torsion"], axis=2)


def _rotate(xyz: FloatArray, angle_rad: FloatArray, *, axis: int) -> FloatArray:
    """Right-handed rotation of points (n, k, 3) about a coordinate axis through the origin by n angles."""
    first, second = (axis + 1) % 3, (axis + 2) % 3
    cosine, sine = np.cos(angle_rad)[:, None], np.sin(angle_rad)[:, None]
    turned = xyz.copy()
    turned[..., first] = cosine * xyz[..., first] - sine * xyz[..., second]
    turned[..., second] = sine * xyz[..., first] + cosine * xyz[..., second]
    return turned
