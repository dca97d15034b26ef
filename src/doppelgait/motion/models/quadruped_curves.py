"""Measured mean curves of a dog's body and limbs.

The curves are means over the strides of one recorded dog. ``studies/dog_curves.py`` makes the tables and tests them on
a second dog. Curves of the trunk are from 45 strides in the pace, 5 in the walk, 4 in the trot and 6 in the gallop;
curves of the limbs are from at least twice as many. Canter, transverse gallop and bound use the curves of the gallop,
shifted to the phases of their footfalls.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping
from functools import cache
from typing import Literal

import numpy as np
import numpy.typing as npt

from doppelgait.motion.models.human_curves import CycleCurve
from doppelgait.motion.models.strides import Curve, fit_cubic_hermite

FloatArray = npt.NDArray[np.float64]
TrunkCurve = Literal["surge", "hind_heave", "fore_heave", "neck", "tail"]
Segment = Literal["scapula", "manus", "metatarsus"]
RecordedGait = Literal["walk", "pace", "trot", "gallop"]

MEASURED_DUTY = {"walk": (0.48, 0.575), "pace": (0.48, 0.535), "trot": (0.22, 0.375), "gallop": (0.18, 0.26)}
"""Share of the stride in which hind and fore paws are at rest in the recordings."""
MEASURED_LANDING = {"walk": (0.0, 0.12), "pace": (0.0, 0.02), "trot": (0.0, 0.40), "gallop": (-0.085, 0.23)}
"""Phase at which the hind and the fore pair land, after the left hind foot: that of the left foot, or in the gallop the
mean of both feet."""
N_HARMONICS = {"scapula": 6, "manus": 6, "metatarsus": 6, "neck": 2, "tail": 2}
"""Number of harmonics by curve. Curves of the trunk have 4."""

SWINGS: dict[tuple[str, str], tuple[float, ...]] = {
    ("walk", "hind"): (0.00, 0.10, 0.37, 0.79, 1.18, 1.46, 1.64, 1.72, 1.71, 1.55, 1.11, 0.38, 0.00),
    ("walk", "fore"): (0.00, 0.09, 0.46, 0.97, 1.30, 1.58, 1.84, 1.84, 1.55, 1.19, 0.82, 0.37, 0.00),
    ("pace", "hind"): (0.00, 0.11, 0.41, 0.90, 1.26, 1.45, 1.62, 1.70, 1.66, 1.47, 1.03, 0.38, 0.00),
    ("pace", "fore"): (0.00, 0.09, 0.47, 0.98, 1.32, 1.66, 1.95, 1.87, 1.47, 1.07, 0.76, 0.35, 0.00),
    ("trot", "hind"): (0.00, 0.19, 0.51, 0.94, 1.34, 1.56, 1.61, 1.58, 1.47, 1.31, 1.03, 0.46, 0.00),
    ("trot", "fore"): (0.00, 0.14, 0.54, 1.00, 1.34, 1.67, 1.89, 1.81, 1.46, 1.08, 0.74, 0.32, 0.00),
    ("gallop", "hind"): (0.00, 0.24, 0.66, 0.99, 1.23, 1.38, 1.44, 1.49, 1.52, 1.44, 1.11, 0.49, 0.00),
    ("gallop", "fore"): (0.00, 0.19, 0.72, 1.32, 1.67, 1.76, 1.67, 1.45, 1.20, 0.98, 0.71, 0.33, 0.00),
}
"""Forward speed of a paw relative to its mean in swing, at equal steps from lift-off to landing."""

CURVES: dict[tuple[str, str], tuple[float, ...]] = {
    ("walk", "surge"): (-0.128, -0.148, -0.040, 0.122, 0.191, 0.120, 0.006, -0.039, -0.030, -0.055),
    ("walk", "hind_heave"): (-0.007, -0.019, -0.020, -0.011, 0.001, 0.009, 0.013, 0.015, 0.014, 0.006),
    ("walk", "fore_heave"): (0.015, 0.018, 0.013, 0.001, -0.012, -0.019, -0.016, -0.009, 0.000, 0.008),
    ("walk", "neck"): (-1.7, -2.1, -1.7, -0.7, 0.6, 1.7, 2.1, 1.7, 0.7, -0.6),
    ("walk", "tail"): (9.2, 0.5, -8.3, -14.0, -14.3, -9.2, -0.5, 8.3, 14.0, 14.3),
    ("walk", "scapula"): (55, 54, 52, 49, 47, 44, 41, 38, 34, 30, 27, 25, 26, 30, 35, 40, 46, 50, 52, 54),
    ("walk", "manus"): (50, 48, 49, 48, 45, 42, 38, 34, 28, 22, 15, 7, -3, -17, -30, -30, -9, 26, 51, 56),
    ("walk", "metatarsus"): (31, 30, 26, 22, 17, 11, 6, 1, -4, -10, -16, -24, -29, -27, -20, -10, 3, 17, 26, 30),
    ("pace", "surge"): (-0.047, 0.031, 0.117, 0.147, 0.094, 0.000, -0.070, -0.094, -0.093, -0.083),
    ("pace", "hind_heave"): (0.002, -0.004, -0.007, -0.006, -0.003, -0.001, 0.001, 0.004, 0.007, 0.007),
    ("pace", "fore_heave"): (0.032, 0.022, 0.003, -0.016, -0.029, -0.030, -0.021, -0.004, 0.015, 0.029),
    ("pace", "neck"): (-1.3, -0.1, 1.1, 1.9, 2.0, 1.3, 0.1, -1.1, -1.9, -2.0),
    ("pace", "tail"): (7.1, 3.6, -1.3, -5.7, -7.9, -7.1, -3.6, 1.3, 5.7, 7.9),
    ("pace", "scapula"): (55, 54, 52, 49, 46, 43, 39, 34, 30, 25, 22, 21, 24, 30, 36, 42, 47, 50, 52, 54),
    ("pace", "manus"): (49, 48, 49, 48, 45, 40, 36, 30, 24, 17, 9, 0, -13, -28, -40, -33, -2, 37, 57, 56),
    ("pace", "metatarsus"): (27, 25, 22, 16, 11, 6, 1, -5, -11, -18, -26, -32, -32, -24, -12, 0, 11, 20, 25, 26),
    ("trot", "surge"): (-0.061, -0.054, -0.051, -0.050, -0.021, 0.045, 0.102, 0.096, 0.030, -0.037),
    ("trot", "hind_heave"): (0.019, -0.011, -0.039, -0.053, -0.046, -0.019, 0.015, 0.041, 0.051, 0.042),
    ("trot", "fore_heave"): (0.021, -0.002, -0.023, -0.035, -0.036, -0.023, 0.000, 0.023, 0.038, 0.037),
    ("trot", "neck"): (-0.2, 0.4, 0.8, 0.9, 0.6, 0.2, -0.4, -0.8, -0.9, -0.6),
    ("trot", "tail"): (0.2, 2.4, 3.8, 3.6, 2.1, -0.2, -2.4, -3.8, -3.6, -2.1),
    ("trot", "scapula"): (54, 51, 47, 41, 34, 27, 23, 18, 14, 12, 12, 16, 23, 32, 42, 50, 54, 55, 56, 56),
    ("trot", "manus"): (54, 52, 54, 55, 54, 51, 44, 33, 18, 0, -20, -39, -53, -52, -29, 6, 38, 59, 67, 62),
    ("trot", "metatarsus"): (25, 23, 21, 15, 4, -8, -20, -28, -34, -34, -29, -19, -6, 6, 16, 23, 26, 28, 28, 27),
    ("gallop", "surge"): (
        -0.106,
        -0.042,
        0.054,
        0.128,
        0.139,
        0.101,
        0.057,
        0.041,
        0.047,
        0.050,
        0.037,
        0.011,
        -0.018,
        -0.043,
        -0.061,
        -0.066,
        -0.063,
        -0.066,
        -0.088,
        -0.114,
    ),
    ("gallop", "hind_heave"): (
        -0.148,
        -0.123,
        -0.088,
        -0.049,
        -0.009,
        0.029,
        0.057,
        0.072,
        0.081,
        0.090,
        0.100,
        0.103,
        0.095,
        0.078,
        0.056,
        0.026,
        -0.019,
        -0.075,
        -0.125,
        -0.151,
    ),
    ("gallop", "fore_heave"): (
        0.071,
        0.084,
        0.082,
        0.064,
        0.038,
        0.013,
        -0.012,
        -0.039,
        -0.067,
        -0.088,
        -0.098,
        -0.093,
        -0.076,
        -0.049,
        -0.016,
        0.014,
        0.034,
        0.041,
        0.044,
        0.054,
    ),
    ("gallop", "neck"): (
        5.6,
        1.6,
        -2.9,
        -7.1,
        -10.4,
        -12.4,
        -12.9,
        -11.8,
        -9.5,
        -6.5,
        -3.2,
        0.1,
        3.2,
        5.9,
        8.2,
        10.0,
        11.1,
        11.5,
        10.7,
        8.8,
    ),
    ("gallop", "tail"): (
        -15.7,
        -17.8,
        -18.5,
        -19.1,
        -19.8,
        -20.5,
        -20.1,
        -17.2,
        -11.1,
        -1.8,
        9.5,
        20.7,
        29.5,
        33.9,
        32.8,
        26.7,
        17.1,
        6.2,
        -3.7,
        -11.1,
    ),
    ("gallop", "scapula"): (47, 39, 30, 22, 17, 15, 18, 23, 31, 39, 47, 54, 60, 63, 65, 64, 62, 60, 57, 53),
    ("gallop", "manus"): (61, 61, 60, 52, 33, 9, -16, -39, -54, -57, -46, -24, 6, 34, 56, 71, 78, 77, 71, 65),
    ("gallop", "metatarsus"): (39, 36, 26, 6, -17, -34, -42, -43, -40, -33, -24, -12, 0, 12, 23, 32, 38, 40, 40, 40),
}
"""Values at equal steps of phase over a stride (20) or half of it (10).

Curves of the trunk are functions of the phase after the left hind foot: ``surge`` is the forward speed over V, less 1;
heaves are heights of hip and neck base about their means, relative to the hip height; ``neck`` and ``tail`` are
elevations about their means, in degrees. Curves of segments are elevations in degrees, as functions of the phase after
their own foot: 0 is straight down, and positive angles have the lower end ahead.
"""


def find_trunk_curve(gait: RecordedGait, name: TrunkCurve, touchdown: Mapping[str, float]) -> tuple[CycleCurve, float]:
    """Return a trunk curve and its first phase.
    The phases of neck and front heave are relative to the fore feet, the others to the hind feet.
    """
    end = "fore" if name in ("fore_heave", "neck") else "hind"
    landing = touchdown[f"left_{end}"]
    if gait == "gallop":
        both = sum(cmath.exp(2j * math.pi * touchdown[f"{side}_{end}"]) for side in ("left", "right"))
        landing = cmath.phase(both) / (2 * math.pi)
    return _make_curve(gait, name), landing - MEASURED_LANDING[gait][end == "fore"]


TRUNK_CURVES: tuple[TrunkCurve, ...] = ("surge", "hind_heave", "fore_heave", "neck", "tail")


def join_trunk_curves(gait: RecordedGait, touchdown: Mapping[str, float]) -> CycleCurve:
    """Join the trunk curves, each at its first phase.
    The curves are those of :func:`find_trunk_curve` in the order of :data:`TRUNK_CURVES`.
    """
    terms, begins = np.zeros((len(TRUNK_CURVES), 5), dtype=complex), np.empty((len(TRUNK_CURVES), 1))
    for row, name in enumerate(TRUNK_CURVES):
        curve, begins[row] = find_trunk_curve(gait, name, touchdown)
        terms[row, : curve.coefficients.size] = curve.coefficients
    return CycleCurve(terms * np.exp(-2j * np.pi * begins * np.arange(5)))


def segment_elevation_rad(gait: RecordedGait, segment: Segment, cycles: FloatArray, duty: float) -> FloatArray:
    """Return the measured elevation of a limb's segment.
    Stance and swing of the recording are scaled to those of the duty factor.
    """
    of_recording = MEASURED_DUTY[gait][segment != "metatarsus"]
    own = cycles - np.floor(cycles)
    # a cubic on both sides of lift-off with the same slope at all three knots, so that the speed is continuous
    stance, swing = of_recording / duty, (1 - of_recording) / (1 - duty)
    slope = 2 * stance * swing / (stance + swing)
    swings = own >= duty
    width = np.where(swings, 1 - duty, duty)
    share = np.where(swings, own - duty, own) / width
    rise = np.where(swings, 1 - of_recording, of_recording)
    eased = share * share * (3 - 2 * share)
    bow = slope * width * share * (1 - share) * (1 - 2 * share)
    at = np.where(swings, of_recording, 0.0) + rise * eased + bow
    return np.radians(_make_curve(gait, segment)(at))


@cache
def find_swing_curve(gait: RecordedGait, end: str, peak: float) -> Curve:
    """Return the path of a swinging paw, 0 to 1.
    The path is a function of the share of the swing.
    """
    speed = np.array(SWINGS[gait, end])
    peaked = speed**2 / (speed**2).mean() * speed.mean()
    speed = speed + (peak - 1) * speed.max() / (peaked.max() - speed.max()) * (peaked - speed)
    step = 1 / (speed.size - 1)
    ways = step / 2 * (speed[:-1] + speed[1:])
    ways[1:-1] -= step**2 / 12 * np.diff(np.gradient(speed, step))[1:-1]  # for a smooth speed, except at the ends
    way = np.concatenate([[0.0], np.cumsum(ways)])
    return fit_cubic_hermite(np.linspace(0, 1, speed.size), way / way[-1], speed / way[-1])


@cache
def _make_curve(gait: str, name: str) -> CycleCurve:
    samples = CURVES[gait, name]
    count = N_HARMONICS.get(name, 4)
    terms = np.fft.rfft(np.tile(samples, 20 // len(samples)))[: count + 1] / 10
    terms[0] /= 2
    if name == "surge":
        terms = np.concatenate([[0.0], terms[1:] / (2j * np.pi * np.arange(1, count + 1))])
    return CycleCurve(terms)
