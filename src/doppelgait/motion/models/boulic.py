"""Walking person of Boulic et al. (1990) with 17 points.

The form is that of Chen (2011), with lengths in units of the leg length L = 0.491 H: with q = V/L,
the stride length is 1.346 sqrt(q) L and the stride time 1.346 / sqrt(q) s.

Symbols: q is the relative speed in 1/s, p the phase in cycles, 0 at initial contact of the right
leg; the left side is half a cycle later. Regimes: slow below q = 0.5, middle to 1.3, fast to 3.
Shapes: phases are (n,) with a number q, or (..., B, n) with a column of them, (B, 1), for a batch.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator

from doppelgait.core.config import FrozenModel
from doppelgait.core.errors import ConfigError
from doppelgait.core.plugins import plugin
from doppelgait.core.units import FloatArray, cosine, sine
from doppelgait.motion.models.human_body import (
    LENGTHS,
    PEOPLE,
    Sizes,
    compute_figure_points,
    make_person_motions,
    place_lower_body,
)
from doppelgait.motion.models.registry import model_function
from doppelgait.motion.models.strides import Columns, Rngs, Values, fit_periodic_pchip, time_even_strides
from doppelgait.motion.motion import Motion

Knots = list[tuple[float, float]]

SLOWEST_FAST = 1.3
TOP_RELATIVE_SPEED = 3.0
SAME_KNOT = 1e-6
"""Minimum distance of two different knots in cycles. Two knots of the hip coincide at q = 1.3."""


def cycle_duration_s(relative_speed: Values) -> Any:
    """Return the stride time T = 1.346 / sqrt(q)."""
    return 1.346 / np.sqrt(relative_speed)


def compute_support_fraction(relative_speed: Values) -> Any:
    """Return a foot's duty factor, 0.752 - 0.143 / T."""
    return 0.752 - 0.143 / cycle_duration_s(relative_speed)


def _sine(cycles: FloatArray) -> FloatArray:
    return np.asarray(sine(2 * np.pi * cycles))


def _cosine(cycles: FloatArray) -> FloatArray:
    return np.asarray(cosine(2 * np.pi * cycles))


def _share(phase: FloatArray) -> FloatArray:
    # the result is exactly equal to NumPy's remainder, which takes many times as long
    return np.asarray(phase - np.floor(phase))


def compute_body_offset(
    phase: FloatArray, relative_speed: Values, *, signs: npt.ArrayLike = "continuous"
) -> FloatArray:
    """Return the body's offset from uniform motion over the scale k, (3, ..., n)."""
    q, signs = relative_speed, np.asarray(signs)
    slow = np.less(q, 0.5)
    lateral = np.where(slow, -0.128 * (q - q * q), -0.032)
    fore_aft = np.where(slow, -0.084 * (q - q * q), -0.021)
    published = (signs == "published") & slow
    lateral = np.where(published, -lateral, lateral)
    fore_aft = np.where(published | (signs == "pendulum"), -fore_aft, fore_aft)
    vertical = 0.015 * q
    ahead = fore_aft * _sine(2 * phase + 2 * (0.625 - compute_support_fraction(q)))
    up = -vertical + vertical * _sine(2 * phase - 0.35)
    return np.stack([ahead, lateral * _sine(phase - 0.1), up])


def pelvic_list_deg(phase: FloatArray, relative_speed: Values) -> FloatArray:
    """Return the pelvic list l(p), negative with the left side lower. It is 0 at p = 0 and 0.5."""
    p = _share(phase)
    first = p < 0.5
    half = np.where(first, p, p - 0.5)
    # down over 0.15 cycles and up over 0.35, each with half a period of a cosine
    drop = 1 - _cosine(np.where(half < 0.15, half / 0.3, 0.5 + (half - 0.15) / 0.7))
    return np.asarray(np.where(first, -1.66 * relative_speed, 1.66 * relative_speed) * drop)


def lean_deg(relative_speed: Values) -> FloatArray:
    """Mean forward lean of the trunk."""
    q = relative_speed
    return np.where(np.less(q, 0.5), 8 * q - 8 * q * q, 2.0)


def trunk_angles_deg(phase: FloatArray, relative_speed: Values) -> dict[str, FloatArray]:
    """Return pelvis and trunk angles by name, degrees."""
    q, pitch = relative_speed, lean_deg(relative_speed)
    torsion = [[(0.1, 4 * v / 3), (0.4, -1.5 * v), (0.6, -4 * v / 3), (0.9, 1.5 * v)] for v in np.ravel(q).tolist()]
    return {
        "trunk_pitch": -pitch + pitch * _sine(2 * phase - 0.1),
        "pelvic_torsion": -4 * q * _cosine(phase),
        "pelvic_list": pelvic_list_deg(phase, q),
        "thorax_torsion": interpolate_periodic(torsion, phase),
    }


def limb_angles_deg(phase: FloatArray, relative_speed: Values) -> dict[str, FloatArray]:
    """Return the joint flexion of one side by name, degrees."""
    q = relative_speed
    joints = {joint: _interpolate_joint(joint, phase, q) for joint in ("hip", "knee", "ankle", "elbow")}
    return joints | {"shoulder": 3 - 0.5 * 9.88 * q - 9.88 * q * _cosine(phase)}


def _interpolate_joint(joint: str, phase: FloatArray, relative_speed: Values) -> FloatArray:
    return interpolate_periodic([find_joint_knots(q)[joint] for q in np.ravel(relative_speed).tolist()], phase)


@lru_cache(maxsize=1024)  # every joint of an example needs them
def find_joint_knots(relative_speed: float) -> dict[str, Knots]:
    """Return the joint curves' control points (phase, degrees)."""
    q, support = relative_speed, compute_support_fraction(relative_speed)
    regime, x = ("slow", q) if q < 0.5 else ("middle", (q - 0.5) / 0.8)
    if q >= SLOWEST_FAST:
        regime, x = "fast", (q - SLOWEST_FAST) / 1.7
    return {
        joint: [(support if at == "support" else at + d_at * x, angle + slope * x) for at, d_at, angle, slope in rows]
        for joint, rows in PEOPLE["knots"][regime].items()
    }


def interpolate_periodic(knots: Sequence[Knots], phase: FloatArray) -> FloatArray:
    """Interpolate the periodic knots of examples by shape-preserving cubics (Fritsch-Carlson)."""
    rows = []
    for own in knots:  # in the order of their phases, each once
        ordered = sorted((p % 1.0, float(value)) for p, value in own)
        rows.append([ordered[0]] + [b for a, b in pairwise(ordered) if b[0] - a[0] > SAME_KNOT])
        if rows[-1][0][0] + 1 - rows[-1][-1][0] <= SAME_KNOT:
            rows[-1].pop()
    at = _share(phase).reshape(-1, len(rows), phase.shape[-1])
    found = np.empty(at.shape)
    for count in {len(row) for row in rows}:
        alike = [number for number, row in enumerate(rows) if len(row) == count]
        curves = fit_periodic_pchip(*np.array([rows[number] for number in alike]).transpose(2, 0, 1))
        found[:, alike] = curves(at[:, alike])
    return found.reshape(phase.shape)


Form = Literal["consistent", "pendulum", "chen2011"]

LEG_LENGTH = LENGTHS["thigh"] + LENGTHS["shank"]

_SIGNS: dict[Form, str] = {"consistent": "continuous", "pendulum": "pendulum", "chen2011": "published"}
_WHOLE_CYCLE = np.arange(1000) / 1000


class BoulicConfig(FrozenModel):
    """Walking person of :func:`boulic_walk` (Boulic et al. 1990; Chen 2011).

    speed_mps: Mean forward speed V, above 0 and at most 3 leg lengths per second (2.58 m/s at 1.75
        m).
    height_m: Stature H. The height of the figure, without that of the feet, is 0.909 H.
    form: ``"consistent"``: all lengths in units of the leg length. ``"pendulum"``: the same with
        the opposite fore-aft sway, so that the body is fastest in double support. ``"chen2011"``:
        the published program, with body offsets and advance in metres: the speed is V/L m/s.
    start_phase: Phase at the start in cycles, 0 (right foot lands) to below 1.
    stride_variation: Standard deviation of the stride time over its mean; healthy adults 0.02.
    pace_sd: Standard deviation of the speed of strides over its mean; healthy adults 0.04.
    rate_hz: Frames per second.
    """

    kind: Literal["boulic"] = "boulic"
    speed_mps: float = Field(1.2, gt=0)
    height_m: float = Field(1.75, ge=0.6, le=2.4)
    form: Form = "consistent"
    start_phase: float = Field(0.0, ge=0, lt=1)
    stride_variation: float = Field(0.0, ge=0, le=0.1)
    pace_sd: float = Field(0.0, ge=0, le=0.15)
    rate_hz: float = Field(250.0, ge=50, le=10_000)

    @model_validator(mode="after")
    def _check_speed(self) -> BoulicConfig:
        top_mps = TOP_RELATIVE_SPEED * LEG_LENGTH * self.height_m
        if self.speed_mps > top_mps * (1 + 1e-9):
            raise ValueError(
                f"speed_mps: {self.speed_mps:g} is not allowed: a walker of height_m = {self.height_m:g} "
                f"moves at above 0 and at most {top_mps:.3g} m/s (3 leg lengths per second)"
            )
        return self


@model_function(BoulicConfig)
@plugin("motion_model", parameters=BoulicConfig)
def boulic_walk(parameters: Sequence[BoulicConfig], durations_s: Sequence[float], rngs: Rngs) -> list[Motion]:
    """Generate a walking person (Boulic et al. 1990; Chen 2011).

    The person moves along +x from x = 0; the lowest foot point of the cycle is at z = 0. The points
    are those of ``human_body.POINTS``.

    >>> import doppelgait as dg
    >>> motion = dg.motion.boulic_walk(speed_mps=1.2, duration_s=2.0)
    >>> round(motion.facts.gait_frequency_hz, 2), round(motion.facts.height_m, 2)  # steps per second, stature
    (1.76, 1.75)
    """
    columns = Columns(parameters)
    leg_m = LEG_LENGTH * columns.height_m
    q = columns.speed_mps / leg_m
    forms = np.array(columns.form)[:, None]
    scale_m = np.where(forms == "chen2011", 1.0, leg_m)
    timing, drift = time_even_strides(durations_s, columns, cycle_duration_s(q), rngs)
    phase, height_m = timing.phase, columns.height_m
    signs = np.array([_SIGNS[config.form] for config in parameters])[:, None]
    points = compute_boulic_points(phase, q, height_m, offset_scale_m=scale_m, offset_signs=signs)
    way = phase + drift(phase)
    points[..., 0] += (1.346 * np.sqrt(q) * scale_m * (way - way[:, :1]))[..., None]
    size_m = {name: fraction * height_m for name, fraction in LENGTHS.items()}
    points[..., 2] -= find_floor_m(q, size_m, offset_scale_m=scale_m, offset_signs=signs)[..., None]
    return make_person_motions(points, timing, parameters, ["walk"] * len(q))


def find_floor_m(q: FloatArray, size_m: Sizes, *, offset_scale_m: Values, offset_signs: npt.ArrayLike) -> FloatArray:
    """Return the height of the lowest point of a whole cycle, (B, 1)."""
    cycle = np.broadcast_to(_WHOLE_CYCLE, (len(q), _WHOLE_CYCLE.size))
    both = np.stack([cycle + 0.5, cycle])
    pelvis = {name: np.radians(angle) for name, angle in trunk_angles_deg(cycle, q).items()}
    legs = {joint: np.radians(_interpolate_joint(joint, both, q)) for joint in ("hip", "knee", "ankle")}
    offset_m = offset_scale_m * compute_body_offset(cycle, q, signs=offset_signs)
    height_m = place_lower_body(pelvis, legs, size_m)[:, 2] + offset_m[2]
    return np.asarray(height_m.min(axis=(0, 2))[:, None])


def compute_boulic_points(
    phase: npt.ArrayLike,
    relative_speed: Values,
    height_m: Values,
    *,
    offset_scale_m: Values,
    offset_signs: npt.ArrayLike = "continuous",
) -> FloatArray:
    """Return the points in place (Boulic et al. 1990; Chen 2011), (n, 17, 3), m."""
    # the origin is the base of the average spine; the unit k of offsets is L in consistent units
    p, q = np.atleast_1d(np.asarray(phase, dtype=float)), relative_speed
    for each in np.ravel(q):
        if not 0 < each <= TOP_RELATIVE_SPEED * (1 + 1e-9):
            raise ConfigError(
                f"relative speed (speed / leg length): {each:.4g} per second is not allowed: "
                f"must be above 0 and at most {TOP_RELATIVE_SPEED:g}"
            )
    trunk = {name: np.radians(angle) for name, angle in trunk_angles_deg(p, q).items()}
    limbs = {name: np.radians(angle) for name, angle in limb_angles_deg(np.stack([p + 0.5, p]), q).items()}
    size = {name: fraction * height_m for name, fraction in LENGTHS.items()}
    points = compute_figure_points(trunk, limbs, size)
    points += offset_scale_m * compute_body_offset(p, q, signs=offset_signs)
    return points.transpose(*range(2, points.ndim), 0, 1)
