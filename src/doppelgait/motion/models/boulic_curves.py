"""Driving curves of the Boulic/Chen walk: body offsets and joint angles over one cycle.

Symbols: q relative speed V/L in 1/s (L leg length), p phase in cycles, 0 at initial contact of the right leg.
Joint curves are those of the right side; the left side is half a cycle later. Regimes: A below q = 0.5,
B to 1.3, C to 3.
Source: Boulic et al. 1990; Chen 2011.
"""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import pairwise
from typing import Literal

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import ConfigError
from doppelgait.motion.models.curves import Curve, periodic_pchip_curve

FloatArray = npt.NDArray[np.float64]
OffsetSigns = Literal["continuous", "published", "pendulum"]
Knots = list[tuple[float, float]]

SLOWEST_FAST = 1.3
TOP_RELATIVE_SPEED = 3.0
SAME_KNOT = 1e-6
"""Knots closer than this many cycles are one: two of the hip coincide at q = 1.3."""


def check_relative_speed(relative_speed: float) -> float:
    """The relative speed q = V/L if the model holds for it, 0 < q <= 3; else a :class:`ConfigError`."""
    if not 0 < relative_speed <= TOP_RELATIVE_SPEED * (1 + 1e-9):
        raise ConfigError(
            f"relative speed (speed / leg length): {relative_speed:.4g} per second is not allowed: "
            f"must be above 0 and at most {TOP_RELATIVE_SPEED:g}"
        )
    return relative_speed


def cycle_duration_s(relative_speed: float) -> float:
    """Stride time T = 1.346 / sqrt(q)."""
    return 1.346 / math.sqrt(relative_speed)


def support_fraction(relative_speed: float) -> float:
    """Share of the cycle for which a foot is on the ground: s = 0.752 - 0.143 / T."""
    return 0.752 - 0.143 / cycle_duration_s(relative_speed)


def _sin(cycles: FloatArray) -> FloatArray:
    return np.asarray(np.sin(2 * np.pi * cycles))


def _cos(cycles: FloatArray) -> FloatArray:
    return np.asarray(np.cos(2 * np.pi * cycles))


def body_offset(phase: FloatArray, relative_speed: float, *, signs: OffsetSigns = "continuous") -> FloatArray:
    """Offset of the body from uniform motion, in units of the offset scale k.

    Parameters
    ----------
    phase : ndarray, shape (n,)
        Cycles.
    relative_speed : float
        q, 0 < q <= 3.
    signs : str
        The published lateral and fore-aft amplitudes change sign at q = 0.5. ``"published"`` keeps that;
        ``"continuous"`` uses the sign of the middle regime below 0.5 too; ``"pendulum"`` is that with the
        fore-aft sign turned, so that the body is fastest in double support.

    Returns
    -------
    ndarray, shape (n, 3)
        x forward, y left, z up.
    """
    q = relative_speed
    slow = q < 0.5
    lateral = -0.128 * (q - q * q) if slow else -0.032
    fore_aft = -0.084 * (q - q * q) if slow else -0.021
    if signs == "published" and slow:
        lateral, fore_aft = -lateral, -fore_aft
    elif signs == "pendulum":
        fore_aft = -fore_aft
    vertical = 0.015 * q
    return np.stack(
        [
            fore_aft * _sin(2 * phase + 2 * (0.625 - support_fraction(q))),
            lateral * _sin(phase - 0.1),
            -vertical + vertical * _sin(2 * phase - 0.35),
        ],
        axis=-1,
    )


def pelvic_list_deg(phase: FloatArray, relative_speed: float) -> FloatArray:
    """Pelvic list l(p): negative = left side lower; 0 at p = 0 and 0.5."""
    p = np.mod(phase, 1.0)
    half = np.mod(p, 0.5)
    drop = np.where(half < 0.15, 1 - _cos(10 * half / 3), 1 + _cos(10 * (half - 0.15) / 7))
    return np.asarray(np.where(p < 0.5, -1.0, 1.0) * 1.66 * relative_speed * drop)


def trunk_angles_deg(phase: FloatArray, relative_speed: float) -> dict[str, FloatArray]:
    """Trunk pitch, pelvic torsion and list, thorax torsion by name, each of shape (n,), in degrees."""
    q = relative_speed
    pitch = 8 * q - 8 * q * q if q < 0.5 else 2.0
    thorax = [(0.1, 4 * q / 3), (0.4, -1.5 * q), (0.6, -4 * q / 3), (0.9, 1.5 * q)]
    return {
        "trunk_pitch": -pitch + pitch * _sin(2 * phase - 0.1),
        "pelvic_torsion": -4 * q * _cos(phase),
        "pelvic_list": pelvic_list_deg(phase, q),
        "thorax_torsion": periodic_pchip(thorax, phase),
    }


def limb_angles_deg(phase: FloatArray, relative_speed: float) -> dict[str, FloatArray]:
    """Flexion of hip, knee, ankle, shoulder, elbow of one side by name, in degrees, shaped like ``phase``."""
    q = relative_speed
    angles = {joint: periodic_pchip(knots, phase) for joint, knots in joint_knots(q).items()}
    angles["shoulder"] = 3 - 0.5 * 9.88 * q - 9.88 * q * _cos(phase)
    return angles


def joint_knots(relative_speed: float) -> dict[str, Knots]:
    """Control points (phase, degrees) of hip, knee, ankle and elbow at a relative speed."""
    q, s = relative_speed, support_fraction(relative_speed)
    if q < 0.5:
        return {
            "hip": [(-0.1, 50 * q), (0.5, -30 * q)],
            "knee": [(0.17, 3), (0.4, 3), (0.75, 140 * q), (1, 3)],
            "ankle": [(0, -3), (0.08, -3 - 30 * q), (0.5, -3 + 22 * q), (s, -3 - 34 * q), (0.85, -3)],
            "elbow": [(0.05, 3 + 6 * q), (0.5, 3 + 34 * q), (0.9, 3 + 10 * q)],
        }
    if q < SLOWEST_FAST:
        w = (q - 0.5) / 0.8
        return {
            "hip": [(-0.1, 25), (0.5, -15)],
            "knee": [(0.17, 3), (0.4, 3), (0.75, 70), (1, 3)],
            "ankle": [(0, -3), (0.08, -18), (0.5, 8), (s, -20), (0.85, -3)],
            "elbow": [(0.05, 6 + 8 * w), (0.5 + 0.01 * w, 20 + 24 * w), (0.9, 8 + 9 * w)],
        }
    u = (q - SLOWEST_FAST) / 1.7
    return {
        "hip": [(-0.1 + 0.2 * u, 25 + 5 * u), (0.5, -15), (0.9, 25 + 6 * u)],
        "knee": [
            (0.17 - 0.05 * u, 3 + 22 * u), (0.4, 3), (0.75 - 0.05 * u, 70 - 5 * u), (1 - 0.03 * u, 3 + 3 * u),
        ],
        "ankle": [
            (0, -3 + 5 * u), (0.08, -18 + 4 * u), (0.5 - 0.1 * u, 8 - 3 * u),
            (s, -20 - 8 * u), (0.85, -3 + 5 * u),
        ],
        "elbow": [(0.05, 14 - 6 * u), (0.51 + 0.04 * u, 44 + 26 * u), (0.9 - 0.1 * u, 17 - 6 * u)],
    }  # fmt: skip


def periodic_pchip(knots: Knots, phase: FloatArray) -> FloatArray:
    """Shape-preserving cubic (Fritsch-Carlson) through knots that repeat every cycle."""
    return _pchip(tuple(knots))(np.mod(phase, 1.0))


@lru_cache(maxsize=256)
def _pchip(knots: tuple[tuple[float, float], ...]) -> Curve:
    """The curve; a motion asks for the same few again and again."""
    one = sorted((float(np.mod(p, 1.0)), float(value)) for p, value in knots)
    kept = [one[0]] + [b for a, b in pairwise(one) if b[0] - a[0] > SAME_KNOT]
    if kept[0][0] + 1 - kept[-1][0] <= SAME_KNOT:
        kept.pop()
    return periodic_pchip_curve(*zip(*kept, strict=True))
