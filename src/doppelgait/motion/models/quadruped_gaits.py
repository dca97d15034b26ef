"""Gaits of a dog as data, the size and timing rules that hold for all of them, and the path of a paw.

Lengths are in units of the hip height h, phases in cycles after touchdown of the left hind foot, shares in units of
the stride. Values marked "measured" are summary numbers of one medium-sized dog in motion capture; all others are
approximations from the literature on dogs and cursorial mammals, and stand here as parameters, assumed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
GaitName = Literal["trot", "gallop"]
Extremes = tuple[tuple[float, float], tuple[float, float]]

GRAVITY_MPS2 = 9.81
HIP_HEIGHT_PER_WITHERS = 0.8
"""Hip height over withers height, assumed."""
SWING_TIME_S, SWING_HEIGHT_M = 0.30, 0.46
"""A swing takes 0.30 s at a hip height of 0.46 m, nearly the same in every gait (measured)."""
DUTY_LIMITS = (0.15, 0.75)
LIFT_RAMP = 0.15
"""Share of the swing in which a paw speeds up after lift-off, and slows down before touchdown."""
WITHERS_PER_CUBE_ROOT_MASS = 0.175
"""Withers height in m over the cube root of the mass in kg, assumed: 0.15 to 0.20 over common breeds."""


@dataclass(frozen=True)
class Girdle:
    """What one pair of limbs, hind or fore, does in a gait.

    Parameters
    ----------
    duty_offset : float
        Added to the duty factor that the swing-time rule gives.
    swing_peak : float
        Highest forward speed of the paw in swing over its mean speed in swing, above 1 and at most 2.
    clearance : float
        Highest point of the paw's path.
    clearance_at : float
        Where in the swing it is reached, 0.4 to 0.6.
    reach : float
        How far ahead of the proximal joint the middle of the stance lies.
    heave : float
        Amplitude of the girdle's vertical motion; it is lowest at phase ``lowest``.
    lowest : float
        Cycles.
    foot_deg : tuple
        Elevation of metatarsus or manus: (share of the swing, degrees) of its lowest and of its highest
        value; 0 = straight down, positive = lower end ahead. A share below 0 or above 1 lies in stance.
    """

    duty_offset: float
    swing_peak: float
    clearance: float
    clearance_at: float
    reach: float
    heave: float
    lowest: float
    foot_deg: Extremes


@dataclass(frozen=True)
class Gait:
    """A gait.

    Parameters
    ----------
    touchdown : dict
        Phase at which each foot lands.
    froude : tuple
        Allowed range and usual value of V^2/(g h): (lowest, highest, default).
    stride_factor : float
        c of the stride length L/h = c Fr^0.3.
    harmonic : int
        Trunk cycles per stride: 2 when left and right are half a stride apart, else 1.
    fundamental : int
        Fundamental of the radar signature over the stride frequency (E-07).
    surge, surge_fastest : float
        Amplitude of the trunk's fore-aft motion and the phase at which it is fastest.
    sway : float
        Amplitude of its sideways motion, once per stride.
    neck_deg, neck_highest : float
        Amplitude of the neck's elevation and the phase at which it is highest.
    scapula_deg : tuple
        Elevation of the scapula, in the form of :attr:`Girdle.foot_deg`.
    hind, fore : Girdle
        The two pairs of limbs.
    """

    touchdown: dict[str, float]
    froude: tuple[float, float, float]
    stride_factor: float
    harmonic: int
    fundamental: int
    surge: float
    surge_fastest: float
    sway: float
    neck_deg: float
    neck_highest: float
    scapula_deg: Extremes
    hind: Girdle
    fore: Girdle


GAITS: dict[str, Gait] = {
    # Diagonal pairs, the forefoot a little before its hind foot (measured), left and right exactly half a stride
    # apart; trunk lowest in the middle of each stance.
    "trot": Gait(
        touchdown={"left_hind": 0.0, "left_fore": 0.43, "right_hind": 0.5, "right_fore": 0.93},
        froude=(0.3, 2.5, 1.0),
        stride_factor=2.5,
        harmonic=2,
        fundamental=2,
        surge=0.03,
        surge_fastest=0.45,
        sway=0.035,
        neck_deg=5.0,
        neck_highest=0.08,
        scapula_deg=((0.03, 18.0), (0.66, 59.0)),
        hind=Girdle(-0.085, 1.34, 0.14, 0.50, -0.05, 0.0625, 0.19, ((0.15, -31.0), (0.85, 32.0))),
        fore=Girdle(-0.02, 1.69, 0.19, 0.50, 0.07, 0.050, 0.17, ((0.24, -50.0), (0.75, 64.0))),
    ),
    # Rotary: right hind, left hind, left fore, right fore, then one gathered suspension (measured).
    "gallop": Gait(
        touchdown={"left_hind": 0.0, "left_fore": 0.163, "right_hind": 0.832, "right_fore": 0.344},
        froude=(1.2, 10.0, 4.0),
        stride_factor=2.7,
        harmonic=1,
        fundamental=1,
        surge=0.08,
        surge_fastest=0.80,
        sway=0.025,
        neck_deg=16.0,
        neck_highest=0.91,
        scapula_deg=((-0.05, 2.0), (0.72, 66.0)),
        hind=Girdle(-0.065, 1.34, 0.34, 0.45, 0.01, 0.125, 0.02, ((0.19, -46.0), (1.04, 47.0))),
        fore=Girdle(-0.03, 1.56, 0.38, 0.50, 0.05, 0.110, 0.41, ((0.20, -53.0), (0.76, 71.0))),
    ),
}
"""All gaits; a further one is a further entry."""


def hip_height_m(withers_m: float) -> float:
    """Standing height h of the hip joint."""
    return HIP_HEIGHT_PER_WITHERS * withers_m


def froude_speed_mps(froude: float, withers_m: float) -> float:
    """Speed V of a Froude number Fr = V^2/(g h)."""
    return math.sqrt(froude * GRAVITY_MPS2 * hip_height_m(withers_m))


def stride_length_m(gait: Gait, speed_mps: float, withers_m: float) -> float:
    """Stride length L = c h Fr^0.3 (dynamic similarity, Alexander and Jayes 1983)."""
    hip_m = hip_height_m(withers_m)
    return gait.stride_factor * hip_m * math.pow(speed_mps**2 / (GRAVITY_MPS2 * hip_m), 0.3)


def duty_factor(girdle: Girdle, stride_frequency_hz: float, hip_m: float) -> float:
    """Share of the stride for which a paw is on the ground: 1 - t_swing f, offset by girdle, within limits."""
    swing_s = SWING_TIME_S * math.sqrt(hip_m / SWING_HEIGHT_M)
    duty = 1 - swing_s * stride_frequency_hz + girdle.duty_offset
    return min(max(duty, DUTY_LIMITS[0]), DUTY_LIMITS[1])


def mass_from_withers_kg(withers_m: float) -> float:
    """Body mass of a dog of usual build, assumed: withers = 0.175 m (M / kg)^(1/3)."""
    return (withers_m / WITHERS_PER_CUBE_ROOT_MASS) ** 3


def paw_path(cycles: FloatArray, girdle: Girdle, duty: float) -> tuple[FloatArray, FloatArray]:
    """Path of a paw over the ground.

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
    return turn + _swing_progress(swing, girdle.swing_peak), height


def _swing_progress(share: FloatArray, peak: float) -> FloatArray:
    """Distance 0..1 over time 0..1 with the highest speed ``peak`` at half time.

    The paw leaves the ground quickly (short ramps up to an even speed) and is fastest as it passes under the body
    (a bell on top), which keeps the stroke of the limb near the measured one.
    """
    even = (1 - peak / 2) / (0.5 - LIFT_RAMP)
    bell = share / 2 - np.sin(2 * np.pi * share) / (4 * np.pi)
    return even * _ramped_distance(share, LIFT_RAMP) + (peak - even) * bell


def _ramped_distance(share: FloatArray, ramp: float) -> FloatArray:
    """Distance at speed 1 but for half-cosine ramps of length ``ramp`` at either end of time 0..1."""
    first = np.minimum(share, ramp)
    last = np.maximum(share - (1 - ramp), 0.0)
    cruise = np.clip(share - ramp, 0.0, 1 - 2 * ramp)
    rise = first / 2 - ramp / (2 * np.pi) * np.sin(np.pi * first / ramp)
    fall = last / 2 + ramp / (2 * np.pi) * np.sin(np.pi * last / ramp)
    return np.asarray(rise + cruise + fall)
