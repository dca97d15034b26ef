"""A walking person: the model of Boulic et al. 1990 in the form of Chen 2011, 17 points.

The equations are those of the two publications with the units made consistent: relative lengths are in
units of the leg length L = 0.491 H, so that a person of stature H at speed V has q = V/L, a stride of
1.346 sqrt(q) L and a stride time of 1.346 / sqrt(q) s.
"""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator

from doppelgait.core.config import FrozenModel, validate
from doppelgait.core.plugins import plugin
from doppelgait.core.rng import Streams
from doppelgait.motion.models.boulic_curves import (
    TOP_RELATIVE_SPEED,
    OffsetSigns,
    body_offset,
    check_relative_speed,
    cycle_duration_s,
    limb_angles_deg,
    trunk_angles_deg,
)
from doppelgait.motion.models.human_chain import POINTS, figure_points
from doppelgait.motion.models.registry import generate
from doppelgait.motion.models.strides import (
    footfall_times_s,
    mean_stride_frequency_hz,
    phase_at,
    sample_times_s,
    stride_clock,
)
from doppelgait.motion.motion import Motion, MotionFacts, make_motion
from doppelgait.motion.skeleton import BOULIC_PARTS

FloatArray = npt.NDArray[np.float64]
Form = Literal["consistent", "pendulum", "chen2011"]

LENGTHS = {
    "head": 0.130, "half_shoulder": 0.1295, "torso": 0.288, "half_hip": 0.0955, "thigh": 0.245,
    "shank": 0.246, "foot": 0.143, "upper_arm": 0.188, "forearm": 0.152,
}  # fmt: skip
"""Segment lengths as fractions of the stature."""
LEG_LENGTH = LENGTHS["thigh"] + LENGTHS["shank"]

_FEET = [n for n, name in enumerate(POINTS) if name.endswith(("ankle", "toe"))]
_SIGNS: dict[Form, OffsetSigns] = {
    "consistent": "continuous",
    "pendulum": "pendulum",
    "chen2011": "published",
}
_WHOLE_CYCLE = np.arange(1000) / 1000
_BODY_MASS_INDEX = 23.0


class BoulicConfig(FrozenModel):
    """Parameters of :func:`boulic_walk`.

    Parameters
    ----------
    speed_mps : float
        Mean forward speed V, above 0 and at most 3 leg lengths per second (2.58 m/s at 1.75 m).
    height_m : float
        Stature H, 0.6 to 2.4. The figure itself, without foot height, is 0.909 H high.
    form : str
        ``"consistent"``: all lengths in units of the leg length. ``"pendulum"``: the same with the fore-aft
        sway turned over, fastest in double support. ``"chen2011"``: as the published program, with body
        offsets in metres and an advance of 1.346 sqrt(q) metres per cycle: it then moves at q = V/L metres
        per second, not at V.
    start_phase : float
        Cycles, 0 (right foot lands) to below 1.
    stride_variation : float
        Standard deviation of the stride time relative to its mean, 0 to 0.1; healthy adults 0.02. The
        advance per stride stays, so that the speed varies with it.
    rate_hz : float
        Frames per second, 50 to 10000.
    """

    kind: Literal["boulic"] = "boulic"

    speed_mps: float = Field(1.2, gt=0)
    height_m: float = Field(1.75, ge=0.6, le=2.4)
    form: Form = "consistent"
    start_phase: float = Field(0.0, ge=0, lt=1)
    stride_variation: float = Field(0.0, ge=0, le=0.1)
    rate_hz: float = Field(250.0, ge=50, le=10_000)

    @model_validator(mode="after")
    def _speed_fits_the_leg(self) -> BoulicConfig:
        top_mps = TOP_RELATIVE_SPEED * LEG_LENGTH * self.height_m
        if self.speed_mps > top_mps * (1 + 1e-9):
            raise ValueError(
                f"speed_mps: {self.speed_mps:g} is not allowed: a walker of height_m = {self.height_m:g} "
                f"goes above 0 and at most {top_mps:.3g} m/s (3 leg lengths per second)"
            )
        return self


def boulic_walk(
    *, duration_s: float = 5.0, rng: np.random.Generator | Streams | None = None, **parameters: Any
) -> Motion:
    """Walking person after Boulic et al. 1990; Chen 2011.

    Parameters
    ----------
    duration_s : float
        Time to cover; the last frame is at or just after it.
    rng : numpy.random.Generator or Streams, optional
        Needed when ``stride_variation`` is above 0.
    **parameters
        Fields of :class:`BoulicConfig`.

    Returns
    -------
    Motion
        Motion (time, marker, space) of :data:`POINTS`: travels along +x from x = 0, the lowest foot point of
        the cycle on z = 0.

    Raises
    ------
    ConfigError
        If a parameter is outside its range.
    """
    return generate(validate(BoulicConfig, parameters, where="boulic_walk"), duration_s=duration_s, rng=rng)


@plugin("motion_model", parameters=BoulicConfig)
def _generate(config: BoulicConfig, duration_s: float, rng: np.random.Generator | None) -> Motion:
    leg_m = LEG_LENGTH * config.height_m
    q = config.speed_mps / leg_m
    scale_m = 1.0 if config.form == "chen2011" else leg_m
    times_s = sample_times_s(duration_s, config.rate_hz)
    clock = stride_clock(
        times_s[-1],
        period_s=cycle_duration_s(q),
        start_phase=config.start_phase,
        variation=config.stride_variation,
        rng=rng,
    )
    phase = phase_at(clock, times_s)
    points, lowest_m = _over_the_floor(phase, q, config, scale_m)
    points[:, :, 0] += (1.346 * math.sqrt(q) * scale_m * (phase - phase[0]))[:, None]
    points[:, :, 2] -= lowest_m
    stride_hz = mean_stride_frequency_hz(times_s, phase)
    facts = MotionFacts(
        source="boulic",
        kind="boulic",
        species="human",
        gait="walk",
        height_m=config.height_m,
        mass_kg=_BODY_MASS_INDEX * config.height_m**2,
        stride_frequency_hz=stride_hz,
        step_frequency_hz=2 * stride_hz,
        gait_frequency_hz=2 * stride_hz,
        footfalls=footfall_times_s(clock, {"left_foot": 0.5, "right_foot": 0.0}, times_s[-1]),
    )
    parts = list(BOULIC_PARTS.values())
    return make_motion(
        points, rate_hz=config.rate_hz, markers=POINTS, parts=parts, facts=facts,
        report={"mass_kg": "assumed: body mass index 23 kg/m^2"},
    )  # fmt: skip


def _over_the_floor(phase: FloatArray, q: float, config: BoulicConfig, scale_m: float) -> tuple[FloatArray, float]:
    """Points in place at the given phases, and the lowest height of any foot point over a whole cycle."""
    both = np.concatenate([_WHOLE_CYCLE, phase])
    signs = _SIGNS[config.form]
    points = boulic_points(both, q, config.height_m, offset_scale_m=scale_m, offset_signs=signs)
    return points[_WHOLE_CYCLE.size :], float(points[: _WHOLE_CYCLE.size, _FEET, 2].min())


def boulic_points(
    phase: npt.ArrayLike,
    relative_speed: float,
    height_m: float,
    *,
    offset_scale_m: float,
    offset_signs: OffsetSigns = "continuous",
) -> FloatArray:
    """Points of the walker in place, without forward motion (Boulic et al. 1990; Chen 2011).

    Parameters
    ----------
    phase : array_like, shape (n,)
        Cycles; 0 is initial contact of the right leg. Any real number.
    relative_speed : float
        q = V/L in 1/s, 0 < q <= 3.
    height_m : float
        Stature H.
    offset_scale_m : float
        Length k that the body offsets are in units of: L to be consistent, 1 m in the published program.
    offset_signs : str
        See :func:`doppelgait.motion.models.boulic_curves.body_offset`.

    Returns
    -------
    ndarray, shape (n, 17, 3)
        Metres in the order of :data:`POINTS`; origin at the base of the spine of the average posture.

    Raises
    ------
    ConfigError
        If ``relative_speed`` is outside its range.
    """
    q = check_relative_speed(relative_speed)
    p = np.atleast_1d(np.asarray(phase, dtype=float))
    trunk = {name: np.radians(angle) for name, angle in trunk_angles_deg(p, q).items()}
    limbs = {name: np.radians(angle) for name, angle in limb_angles_deg(np.stack([p + 0.5, p]), q).items()}
    size = {name: fraction * height_m for name, fraction in LENGTHS.items()}
    offset_m = offset_scale_m * body_offset(p, q, signs=offset_signs)
    return np.asarray(figure_points(trunk, limbs, size) + offset_m[:, None])
