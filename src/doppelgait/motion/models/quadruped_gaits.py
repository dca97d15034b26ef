"""Gaits and builds of a quadruped as data.

The module also has the laws of speed, stride and duty factor. Lengths are in units of the hip height h, a share of the
withers height. Phases are in cycles after touchdown of the left hind foot. Values of walk, pace, trot and gallop are
between those of two dogs in motion capture, a medium-sized one and a Labrador, if both have the gait. Canter,
transverse gallop and bound are approximations (assumed) from the literature on dogs and cursorial mammals, with the
limbs of the gallop.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Literal

from doppelgait.motion.models.quadruped_curves import RecordedGait

GaitName = Literal["walk", "pace", "trot", "canter", "gallop", "transverse_gallop", "bound"]
GaitChoice = Literal["auto", "walk", "pace", "trot", "canter", "gallop", "transverse_gallop", "bound"]


@dataclass(frozen=True)
class Girdle:
    """Motion of the hind or fore limbs in a gait."""

    duty_offset: float
    clearance: float
    clearance_at: float
    reach: float
    swing_peak: float = 1.0


@dataclass(frozen=True)
class Gait:
    """Gait of a quadruped (E-07)."""

    touchdown: dict[str, float]
    froude: tuple[float, float, float]
    stride_factor: float
    harmonic: int
    curves: RecordedGait
    sway: float
    hind: Girdle
    fore: Girdle
    ripple: float = 1.0
    stride_power: float = 0.3


GAITS: dict[str, Gait] = {
    # Lateral sequence, four beats, each fore foot a sixth of a stride after its hind foot.
    "walk": Gait(
        touchdown={"left_hind": 0.0, "left_fore": 0.17, "right_hind": 0.5, "right_fore": 0.67},
        froude=(0.05, 0.5, 0.2),
        stride_factor=2.45,
        stride_power=0.23,
        harmonic=2,
        curves="walk",
        sway=0.025,
        hind=Girdle(-0.08, 0.08, 0.50, 0.08),
        fore=Girdle(-0.01, 0.10, 0.52, 0.2),
    ),
    # Both feet of a side together, the fore foot slightly late (measured at Fr 0.1 to 0.5).
    "pace": Gait(
        touchdown={"left_hind": 0.0, "left_fore": 0.02, "right_hind": 0.5, "right_fore": 0.52},
        froude=(0.1, 1.0, 0.4),
        stride_factor=2.45,
        stride_power=0.23,
        harmonic=2,
        curves="pace",
        sway=0.025,
        hind=Girdle(-0.065, 0.08, 0.50, -0.03),
        fore=Girdle(-0.01, 0.10, 0.52, 0.175),
    ),
    # Diagonal pairs, the forefoot slightly before its hind foot (measured), left and right exactly half a stride
    # apart; the trunk is lowest in the middle of each stance.
    "trot": Gait(
        touchdown={"left_hind": 0.0, "left_fore": 0.43, "right_hind": 0.5, "right_fore": 0.93},
        froude=(0.3, 2.5, 1.0),
        stride_factor=2.6,
        harmonic=2,
        curves="trot",
        sway=0.035,
        hind=Girdle(-0.095, 0.14, 0.50, 0),
        fore=Girdle(-0.03, 0.19, 0.50, 0.19),
    ),
    # Right lead, three beats: left hind, then right hind with left fore, then right fore, then a short suspension.
    "canter": Gait(
        touchdown={"left_hind": 0.0, "left_fore": 0.275, "right_hind": 0.275, "right_fore": 0.55},
        froude=(1.0, 5.0, 2.0),
        stride_factor=2.7,
        harmonic=1,
        curves="gallop",
        sway=0.025,
        hind=Girdle(-0.02, 0.24, 0.48, 0),
        fore=Girdle(0, 0.28, 0.50, 0.16),
    ),
    # Rotary: right hind, left hind, left fore, right fore, then one gathered suspension (measured).
    "gallop": Gait(
        touchdown={"left_hind": 0.0, "left_fore": 0.163, "right_hind": 0.832, "right_fore": 0.344},
        froude=(1.2, 10.0, 4.0),
        stride_factor=2.7,
        harmonic=1,
        curves="gallop",
        sway=0.025,
        hind=Girdle(-0.055, 0.34, 0.45, 0),
        fore=Girdle(-0.045, 0.38, 0.50, 0.16),
    ),
    # Right lead both behind and in front: left hind, right hind, left fore, right fore; limbs as in the rotary gallop.
    "transverse_gallop": Gait(
        touchdown={"left_hind": 0.0, "left_fore": 0.40, "right_hind": 0.15, "right_fore": 0.55},
        froude=(1.2, 10.0, 4.0),
        stride_factor=2.7,
        harmonic=1,
        curves="gallop",
        sway=0.025,
        hind=Girdle(-0.055, 0.34, 0.45, 0),
        fore=Girdle(-0.045, 0.38, 0.50, 0.16),
    ),
    # Both feet of each pair land simultaneously, without left-right difference; limbs as in the rotary gallop.
    "bound": Gait(
        touchdown={"left_hind": 0.0, "left_fore": 0.45, "right_hind": 0.0, "right_fore": 0.45},
        froude=(1.0, 6.0, 2.5),
        stride_factor=2.7,
        harmonic=1,
        curves="gallop",
        sway=0.0,
        hind=Girdle(-0.02, 0.30, 0.45, 0),
        fore=Girdle(0, 0.34, 0.50, 0.16),
    ),
}
"""All gaits by name. A new gait needs an entry here and its name in :data:`GaitName`."""

GAITS_BY_SPEED: tuple[GaitName, ...] = ("walk", "trot", "gallop")
"""Gaits of a dog in order of speed. Each is used up to the end of its range of Froude numbers."""


def pick_gait(froude: float) -> GaitName:
    """Return a dog's gait at a Froude number.
    It is a walk up to 0.5, a trot up to 2.5, and a gallop above.
    """
    fits = (name for name in GAITS_BY_SPEED if froude <= GAITS[name].froude[1] * (1 + 1e-9))
    return next(fits, GAITS_BY_SPEED[-1])


BuildName = Literal[
    "standard",
    "chihuahua",
    "jack_russell",
    "beagle",
    "border_collie",
    "labrador",
    "german_shepherd",
    "great_dane",
    "dachshund",
    "cat",
    "horse",
    "cow",
]

GRAVITY_MPS2 = 9.81
SWING_TIME_S, SWING_HEIGHT_M = 0.35, 0.46
"""Duration of a swing, from rest to rest, and the hip height at which it was measured. It is nearly equal in all
gaits."""
DUTY_LIMITS = (0.15, 0.75)
WITHERS_PER_CUBE_ROOT_MASS = 0.175
"""Withers height in m over the cube root of the mass in kg (assumed; 0.15 to 0.20 for common breeds)."""


@dataclass(frozen=True)
class Build:
    """Size and proportions of an animal.
    Lengths are relative to those of the standard dog of the same hip height.
    """

    withers_m: float
    mass_kg: float
    species: str = "dog"
    withers_range_m: tuple[float, float] = (0.15, 0.9)
    hip: float = 0.8
    trunk: float = 1.0
    limbs: float = 1.0
    head: float = 1.0
    tail: float = 1.0
    stride: dict[str, float] = field(default_factory=dict)
    duty_offset: float = 0.0
    walk_lag: float = 0.17
    source: str = "assumed: height and mass in the middle of the breed standard, standard proportions"


BUILDS: dict[str, Build] = {
    "standard": Build(
        0.50,
        (0.50 / WITHERS_PER_CUBE_ROOT_MASS) ** 3,
        source="assumed: those of one measured dog and of breed standards",
    ),
    "chihuahua": Build(0.20, 2.5),
    "jack_russell": Build(0.28, 6.5),
    "beagle": Build(0.37, 10.5),
    "border_collie": Build(0.52, 17.0),
    "labrador": Build(0.56, 30.0),
    "german_shepherd": Build(
        0.61,
        33.0,
        trunk=1.12,
        source="breed standard: trunk 1.11 to 1.25 of the height; height and mass assumed",
    ),
    "great_dane": Build(0.80, 62.0),
    "dachshund": Build(
        0.22,
        9.0,
        trunk=1.8,
        head=1.7,
        tail=1.7,
        source="assumed: short-legged, hip height about half the trunk length",
    ),
    "cat": Build(
        0.25,
        4.5,
        species="cat",
        hip=0.92,
        trunk=1.1,
        limbs=1.15,
        tail=2.0,
        stride={"walk": 1.09, "pace": 1.09, "trot": 1.155},
        duty_offset=-0.04,
        walk_lag=0.30,
        source="assumed: crouched limbs, hip height 0.74 of the straight limb, longer strides, diagonal couplets",
    ),
    # One recorded horse, 1.28 m high, has 0.92 of a dog's stride at its Froude number in the walk (of 2.45 Fr^0.23) and
    # 0.78 in the trot (of 2.6 Fr^0.3); 17 m/s at 2.4 strides per second of a racehorse give 0.80 in the gallop.
    "horse": Build(
        1.55,
        480.0,
        species="horse",
        withers_range_m=(0.7, 1.8),
        head=1.2,
        walk_lag=0.24,
        stride={
            "walk": 0.92,
            "pace": 0.92,
            "trot": 0.78,
            "canter": 0.80,
            "gallop": 0.80,
            "transverse_gallop": 0.80,
            "bound": 0.80,
        },
        source="strides of walk and trot and the lag measured on one horse; mass, head and gallop assumed",
    ),
    "cow": Build(
        1.45,
        650.0,
        species="cow",
        withers_range_m=(0.8, 1.8),
        trunk=1.15,
        walk_lag=0.24,
        stride={
            "walk": 0.92,
            "pace": 0.92,
            "trot": 0.78,
            "canter": 0.80,
            "gallop": 0.80,
            "transverse_gallop": 0.80,
            "bound": 0.80,
        },
        source="assumed: a large dairy cow; gaits as those of the horse",
    ),
}
"""All builds by name. A new build needs an entry here and its name in :data:`BuildName`."""


def hip_height_m(build: Build, withers_m: float) -> float:
    """Return the standing height h of the hip joint."""
    return build.hip * withers_m


def froude_speed_mps(froude: float, hip_m: float) -> float:
    """Return the speed of Froude number Fr = V^2/(g h)."""
    return math.sqrt(froude * GRAVITY_MPS2 * hip_m)


def froude_number(speed_mps: float, hip_m: float) -> float:
    """Return the Froude number Fr = V^2/(g h)."""
    return speed_mps**2 / (GRAVITY_MPS2 * hip_m)


def stride_length_m(gait: Gait, speed_mps: float, hip_m: float) -> float:
    """Return the stride length L = c h Fr^p.
    By dynamic similarity, p = 0.3 (Alexander and Jayes 1983); in the pace and the walk it is smaller (measured).
    """
    return gait.stride_factor * hip_m * math.pow(froude_number(speed_mps, hip_m), gait.stride_power)


def duty_factor(girdle: Girdle, stride_frequency_hz: float, hip_m: float) -> float:
    """Return a paw's duty factor, 1 - t_swing f.
    The girdle adds an offset; the result stays within limits.
    """
    swing_s = SWING_TIME_S * math.sqrt(hip_m / SWING_HEIGHT_M)
    duty = 1 - swing_s * stride_frequency_hz + girdle.duty_offset
    return min(max(duty, DUTY_LIMITS[0]), DUTY_LIMITS[1])


def mass_kg(build: Build, withers_m: float) -> float:
    """Return the body mass at another height.
    Geometric similarity is assumed, M ~ withers^3.
    """
    return build.mass_kg * (withers_m / build.withers_m) ** 3


def fit_gait_to_build(name: str, build: Build, asymmetry: float = 0.0) -> Gait:
    """Return a gait adapted to a build.
    Its right feet are ``asymmetry`` strides late.
    """
    gait = GAITS[name]
    touchdown = dict(gait.touchdown)
    if name == "walk":
        touchdown |= {f"{side}_fore": touchdown[f"{side}_hind"] + build.walk_lag for side in ("left", "right")}
    touchdown |= {foot: phase + asymmetry for foot, phase in touchdown.items() if foot.startswith("right")}
    stride_factor = gait.stride_factor * build.stride.get(name, 1.0)
    hind, fore = gait.hind, gait.fore
    if gait.harmonic == 2:
        hind, fore = (replace(g, duty_offset=g.duty_offset + build.duty_offset) for g in (hind, fore))
    return replace(gait, touchdown=touchdown, stride_factor=stride_factor, hind=hind, fore=fore)
