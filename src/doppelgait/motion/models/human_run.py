"""A runner's timing, trunk and joint curves against speed.

No published set of equations was at hand: timing is a table of usual values, the rise and fall follows from it by
mechanics, joint curves are control points with usual amplitudes. Speeds are those of an adult of 1.75 m; others run
dynamically similar, V ~ sqrt(H), f ~ 1/sqrt(H).
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np
import numpy.typing as npt

from doppelgait.motion.models.boulic_curves import periodic_pchip

FloatArray = npt.NDArray[np.float64]

ADULT_M = 1.75
G_MPS2 = 9.81
SLOWEST_RUN_MPS, FASTEST_RUN_MPS = 1.8, 9.0
"""Range of running speeds of an adult of 1.75 m."""
WALK_RUN_MPS = 2.0
"""Speed at which that adult goes over from walking to running (Froude number 0.47 of the leg)."""

_STEPS = ((2.2, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0), (2.55, 2.75, 2.88, 3.0, 3.2, 3.45, 3.8, 4.2))
_DUTY = ((2.2, 3.0, 4.0, 5.0, 7.0, 9.0), (0.40, 0.35, 0.30, 0.30, 0.25, 0.21))
_SWING_KNEE = ((3.0, 9.0), (90.0, 125.0))
_SWING_HIP = ((2.2, 3.0, 9.0), (32.0, 37.0, 55.0))
_ARM_SWING = ((2.2, 9.0), (20.0, 30.0))


def adult_speed_mps(speed_mps: float, height_m: float) -> float:
    """Speed at which an adult of 1.75 m moves dynamically similar (equal Froude numbers)."""
    return speed_mps * math.sqrt(ADULT_M / height_m)


def run_step_frequency_hz(speed_mps: float, height_m: float = ADULT_M) -> float:
    """Steps per second of a runner, by a table against speed; below 2.2 m/s (at 1.75 m) its first slope goes on."""
    return _table(_STEPS, adult_speed_mps(speed_mps, height_m)) * math.sqrt(ADULT_M / height_m)


def run_duty_factor(speed_mps: float, height_m: float = ADULT_M) -> float:
    """Share of the stride for which a runner's foot is on the ground, by a table against speed."""
    return _table(_DUTY, adult_speed_mps(speed_mps, height_m))


def _table(table: tuple[tuple[float, ...], tuple[float, ...]], at: float) -> float:
    x, y = table
    if at < x[0]:
        return y[0] + (at - x[0]) * (y[1] - y[0]) / (x[1] - x[0])
    return float(np.interp(at, x, y))


def run_height_m(phase: npt.ArrayLike, stride_s: float, duty: float) -> FloatArray:
    """Height of a runner's body against that at touchdown, from the half-sine ground force (Morin et al. 2005).

    In stance z'' = A sin(pi t/t_c) - g with A = pi g t_step/(2 t_c), which carries the weight over a step; in flight
    z'' = -g. Position, velocity and acceleration are continuous; the rise and fall over a step is
    ``A t_c^2/pi^2 - g t_c^2/8 + g t_f^2/8``.

    Parameters
    ----------
    phase : array_like
        Cycles; a foot lands at 0 and 0.5.
    stride_s : float
        Stride time.
    duty : float
        Below 0.5.

    Returns
    -------
    ndarray
        Metres, shaped like ``phase``.
    """
    half = np.mod(np.asarray(phase, dtype=float), 0.5)
    contact_s, step_s = duty * stride_s, stride_s / 2
    force = math.pi * G_MPS2 * step_s / (2 * contact_s)
    t = half * stride_s
    stance = G_MPS2 * t * (contact_s - t) / 2 - force * (contact_s / math.pi) ** 2 * np.sin(math.pi * t / contact_s)
    flight = G_MPS2 * (t - contact_s) * (step_s - t) / 2
    return np.asarray(np.where(half < duty, stance, flight))


def run_offset_m(phase: FloatArray, leg_m: float, stride_s: float, duty: float) -> FloatArray:
    """Offset of the body from uniform motion, (n, 3): sideways over the standing leg (assumed), up and down."""
    sway = -0.012 * leg_m * np.sin(2 * np.pi * (phase - 0.1))
    return np.stack([np.zeros_like(phase), sway, run_height_m(phase, stride_s, duty)], axis=-1)


def run_trunk_deg(phase: FloatArray, adult_mps: float) -> dict[str, FloatArray]:
    """Trunk angles, named and signed as in :func:`doppelgait.motion.models.boulic_curves.trunk_angles_deg`.

    The trunk leans 5 to 10 degrees; turns of pelvis and shoulders are assumed.
    """
    lean = float(np.interp(adult_mps, (2.2, 9.0), (5.0, 10.0)))
    turn = np.cos(2 * np.pi * phase)
    return {
        "trunk_pitch": np.full_like(phase, -lean),
        "pelvic_torsion": -8.0 * turn,
        "pelvic_list": -3.0 * np.sin(2 * np.pi * phase),
        "thorax_torsion": 12.0 * turn,
    }


def run_limbs_deg(phase: FloatArray, adult_mps: float, duty: float) -> dict[str, FloatArray]:
    """Flexion of the joints of one side, shaped like ``phase``; 0 is its touchdown.

    In swing the knee flexes by 90 degrees at 3 m/s to 125 at 9, the thigh comes 37 to 55 degrees forward; the elbow is
    at 80 to 100 degrees, the upper arm swings 40 to 60 degrees in all, against the leg.
    """
    knee, hip, arm = (float(_table(table, adult_mps)) for table in (_SWING_KNEE, _SWING_HIP, _ARM_SWING))
    swing = partial(_after, duty)
    curves = {
        "hip": [(0.0, 0.6 * hip), (duty, -24.0), (swing(0.7), hip)],
        "knee": [(0.0, 22.0), (0.45 * duty, 40.0), (duty, 25.0), (swing(0.45), knee), (swing(0.95), 20.0)],
        "ankle": [(0.0, 0.0), (0.55 * duty, 20.0), (duty, -18.0), (swing(0.5), 10.0)],
    }
    angles = {joint: periodic_pchip(knots, phase) for joint, knots in curves.items()}
    back = np.cos(2 * np.pi * (phase - 0.03))
    angles["shoulder"] = -12.0 - arm * back
    angles["elbow"] = 90.0 - 10.0 * back
    return angles


def run_sole_deg(adult_mps: float) -> tuple[float, float, float]:
    """Angle of the sole when it lands, stands and leaves: on the heel up to 3 m/s, ever more on the forefoot from 3.5.

    All assumed.
    """
    landing = float(np.interp(adult_mps, (3.0, 3.5, 7.0), (12.0, 0.0, -25.0)))
    return landing, min(landing, 0.0), -65.0


def _after(duty: float, share: float) -> float:
    """Leg phase at a share of swing."""
    return duty + share * (1 - duty)
