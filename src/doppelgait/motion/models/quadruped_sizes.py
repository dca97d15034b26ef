"""Size of a quadruped and what follows from it: named builds, and the laws of speed, stride and duty factor.

Lengths are in units of the hip height h, a share of the withers height.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

from doppelgait.motion.models.quadruped_gaits import GAITS, Gait, Girdle

BuildName = Literal[
    "standard", "chihuahua", "jack_russell", "beagle", "border_collie", "labrador", "german_shepherd", "great_dane",
    "dachshund", "cat",
]  # fmt: skip

GRAVITY_MPS2 = 9.81
SWING_TIME_S, SWING_HEIGHT_M = 0.30, 0.46
"""A swing takes 0.30 s at a hip height of 0.46 m, nearly the same in every gait (measured)."""
DUTY_LIMITS = (0.15, 0.75)
WITHERS_PER_CUBE_ROOT_MASS = 0.175
"""Withers height in m over the cube root of the mass in kg, assumed: 0.15 to 0.20 over common breeds."""


@dataclass(frozen=True)
class Build:
    """Size and proportions by name; lengths relative to those of the standard dog of the same hip height.

    Parameters
    ----------
    withers_m : float
        Usual height of the withers.
    mass_kg : float
        Mass at that height; it goes with the cube of the height.
    species : str
        ``"dog"`` or ``"cat"``.
    hip : float
        Hip height over withers height.
    trunk, limbs, head, tail : float
        Length of the trunk, of all limb segments, of neck and skull, of the tail.
    stride : float
        Stride length at the same Froude number, relative to that of the standard dog, in walk, pace and trot.
    duty_offset : float
        Added to the duty factors of walk, pace and trot.
    walk_lag : float
        Share of a stride by which the fore foot follows the hind foot of its side in a walk.
    source : str
        Where the values come from.
    """

    withers_m: float
    mass_kg: float
    species: str = "dog"
    hip: float = 0.8
    trunk: float = 1.0
    limbs: float = 1.0
    head: float = 1.0
    tail: float = 1.0
    stride: float = 1.0
    duty_offset: float = 0.0
    walk_lag: float = 0.17
    source: str = "assumed: height and mass in the middle of the breed standard, standard proportions"


BUILDS: dict[str, Build] = {
    "standard": Build(
        0.50, (0.50 / WITHERS_PER_CUBE_ROOT_MASS) ** 3,
        source="assumed: those of one measured dog and of breed standards",
    ),
    "chihuahua": Build(0.20, 2.5),
    "jack_russell": Build(0.28, 6.5),
    "beagle": Build(0.37, 10.5),
    "border_collie": Build(0.52, 17.0),
    "labrador": Build(0.56, 30.0),
    "german_shepherd": Build(
        0.61, 33.0, trunk=1.12,
        source="breed standard: trunk 1.11 to 1.25 of the height; height and mass assumed",
    ),
    "great_dane": Build(0.80, 62.0),
    "dachshund": Build(
        0.22, 9.0, trunk=1.8, head=1.7, tail=1.7,
        source="assumed: short-legged, hip height about half the trunk length",
    ),
    "cat": Build(
        0.25, 4.5, species="cat", hip=0.92, trunk=1.1, limbs=1.15, tail=2.0,
        stride=1.20, duty_offset=-0.04, walk_lag=0.30,
        source="assumed: crouched limbs, hip height 0.74 of the straight limb, longer strides, diagonal couplets",
    ),
}  # fmt: skip
"""All builds; a further one is a further entry and its name in :data:`BuildName`."""


def hip_height_m(build: Build, withers_m: float) -> float:
    """Standing height h of the hip joint."""
    return build.hip * withers_m


def froude_speed_mps(froude: float, hip_m: float) -> float:
    """Speed V of a Froude number Fr = V^2/(g h)."""
    return math.sqrt(froude * GRAVITY_MPS2 * hip_m)


def froude_number(speed_mps: float, hip_m: float) -> float:
    """Froude number Fr = V^2/(g h)."""
    return speed_mps**2 / (GRAVITY_MPS2 * hip_m)


def stride_length_m(gait: Gait, speed_mps: float, hip_m: float) -> float:
    """Stride length L = c h Fr^0.3 (dynamic similarity, Alexander and Jayes 1983)."""
    return gait.stride_factor * hip_m * math.pow(froude_number(speed_mps, hip_m), 0.3)


def duty_factor(girdle: Girdle, stride_frequency_hz: float, hip_m: float) -> float:
    """Share of the stride for which a paw is on the ground: 1 - t_swing f, offset by girdle, within limits."""
    swing_s = SWING_TIME_S * math.sqrt(hip_m / SWING_HEIGHT_M)
    duty = 1 - swing_s * stride_frequency_hz + girdle.duty_offset
    return min(max(duty, DUTY_LIMITS[0]), DUTY_LIMITS[1])


def mass_kg(build: Build, withers_m: float) -> float:
    """Body mass of a build at another height: geometric similarity, M ~ withers^3, assumed."""
    return build.mass_kg * (withers_m / build.withers_m) ** 3


def fitted_gait(name: str, build: Build, asymmetry: float = 0.0) -> Gait:
    """A gait as a build performs it, its right feet ``asymmetry`` strides late."""
    gait = GAITS[name]
    touchdown = dict(gait.touchdown)
    if name == "walk":
        touchdown |= {f"{side}_fore": touchdown[f"{side}_hind"] + build.walk_lag for side in ("left", "right")}
    touchdown |= {foot: phase + asymmetry for foot, phase in touchdown.items() if foot.startswith("right")}
    landed = replace(gait, touchdown=touchdown)
    return _with_strides_of(build, landed) if gait.harmonic == 2 else landed


def _with_strides_of(build: Build, gait: Gait) -> Gait:
    hind, fore = (replace(g, duty_offset=g.duty_offset + build.duty_offset) for g in (gait.hind, gait.fore))
    return replace(gait, stride_factor=gait.stride_factor * build.stride, hind=hind, fore=fore)
