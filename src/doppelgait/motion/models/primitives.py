"""Targets with known results: point, pendulum, rotor, breathing person."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from pydantic import Field, model_validator

from doppelgait.core.config import FrozenModel
from doppelgait.core.plugins import plugin
from doppelgait.core.rng import RandomSource
from doppelgait.core.units import FloatArray, cosine, sine
from doppelgait.motion.models.registry import generate, parse_parameters
from doppelgait.motion.models.strides import sample_times_s, stack_columns
from doppelgait.motion.motion import Motion, make_motion

Plane = Literal["xy", "xz", "yz"]


def check_clearance(key: str, height_m: float, lower_key: str, lower_m: float, motion: str) -> None:
    """Raise an error if a body would move through the floor."""
    if height_m < lower_m:
        raise ValueError(
            f"{key}: {height_m:g} is not allowed: the {motion} through the floor; "
            f"must be at least {lower_key} = {lower_m:g}"
        )


class PointConfig(FrozenModel):
    """Parameters of :func:`moving_point`.

    Parameters
    ----------
    speed_mps : float
        Speed V along +x, 0 (a point at rest) to 1000.
    height_m : float
        Height above the floor, 0 to 1000.
    rate_hz : float
        Frames per second.
    """

    kind: Literal["point"] = "point"

    speed_mps: float = Field(1.0, ge=0, le=1000)
    height_m: float = Field(1.0, ge=0, le=1000)
    rate_hz: float = Field(250.0, ge=1, le=100_000)


class PendulumConfig(FrozenModel):
    """Parameters of :func:`pendulum`.

    Parameters
    ----------
    length_m : float
        Length l, above 0.
    amplitude_deg : float
        Largest angle a, 0 to 180 degrees.
    frequency_hz : float
        Full swings per second f, above 0.
    pivot_height_m : float
        Height of the pivot, at least the length.
    rate_hz : float
        Frames per second.
    """

    kind: Literal["pendulum"] = "pendulum"

    length_m: float = Field(0.8, gt=0, le=100)
    amplitude_deg: float = Field(30.0, ge=0, le=180)
    frequency_hz: float = Field(1.0, gt=0, le=100)
    pivot_height_m: float = Field(1.0, ge=0, le=1000)
    rate_hz: float = Field(250.0, ge=1, le=100_000)

    @model_validator(mode="after")
    def _check_height(self) -> PendulumConfig:
        check_clearance("pivot_height_m", self.pivot_height_m, "length_m", self.length_m, "pendulum would swing")
        return self


class RotorConfig(FrozenModel):
    """Parameters of :func:`rotor`.

    Parameters
    ----------
    radius_m : float
        Distance of the tips from the hub, above 0.
    rotation_hz : float
        Turns per second, above 0.
    blades : int
        Number of blades, 1 to 64.
    plane : str
        Plane of rotation: ``"xy"`` (level), ``"xz"`` or ``"yz"``.
    hub_height_m : float
        Height of the hub; at least the radius unless level.
    rate_hz : float
        Frames per second.
    """

    kind: Literal["rotor"] = "rotor"

    radius_m: float = Field(0.3, gt=0, le=100)
    rotation_hz: float = Field(2.0, gt=0, le=1000)
    blades: int = Field(2, ge=1, le=64)
    plane: Plane = "xz"
    hub_height_m: float = Field(1.0, ge=0, le=1000)
    rate_hz: float = Field(250.0, ge=1, le=100_000)

    @model_validator(mode="after")
    def _check_height(self) -> RotorConfig:
        if self.plane != "xy":
            check_clearance("hub_height_m", self.hub_height_m, "radius_m", self.radius_m, "blades would turn")
        return self


class BreathingConfig(FrozenModel):
    """Parameters of :func:`breathing_person`.

    Parameters
    ----------
    height_m : float
        Stature, 0.4 to 2.4.
    breathing_hz : float
        Breaths per second f, above 0 to 2.
    amplitude_m : float
        Amplitude a of the two chest points, 0 to 0.05. The abdomen moves half as far (assumed);
        other points are at rest.
    rate_hz : float
        Frames per second.
    """

    kind: Literal["breathing"] = "breathing"

    height_m: float = Field(1.75, ge=0.4, le=2.4)
    breathing_hz: float = Field(0.25, gt=0, le=2)
    amplitude_m: float = Field(0.005, ge=0, le=0.05)
    rate_hz: float = Field(250.0, ge=1, le=10_000)


def moving_point(*, duration_s: float = 5.0, rng: RandomSource | None = None, **parameters: Any) -> Motion:
    """Generate a point on a straight line.

    Its position is x = V t at a constant height.

    Parameters
    ----------
    **parameters
        Fields of :class:`PointConfig`.

    Returns
    -------
    Motion
        Motion of one point, ``"point"``.

    Raises
    ------
    ConfigError
        If a parameter is outside its range.

    Examples
    --------
    >>> import doppelgait as dg
    >>> motion = dg.motion.moving_point(duration_s=2.0)
    >>> (motion.position_m[-1, 0] - motion.position_m[0, 0]).round(2)  # displacement in 2 s, m
    array([2., 0., 0.])
    """
    return generate(parse_parameters(PointConfig, parameters, where="moving_point"), duration_s=duration_s, rng=rng)


def pendulum(*, duration_s: float = 5.0, rng: RandomSource | None = None, **parameters: Any) -> Motion:
    """Generate a point that swings in x under a pivot.

    The pivot is above x = 0. The angle from the vertical is a sin(2 pi f t), positive forward. The frequency is a
    parameter and does not follow from gravity. The maximum speed is 2 pi f a l, at the lowest point.

    Parameters
    ----------
    **parameters
        Fields of :class:`PendulumConfig`.

    Returns
    -------
    Motion
        Motion of one point, ``"bob"``.

    Raises
    ------
    ConfigError
        If a parameter is outside its range.

    Examples
    --------
    >>> import doppelgait as dg
    >>> motion = dg.motion.pendulum(duration_s=2.0)
    >>> round(motion.facts.gait_frequency_hz, 2)
    1.0
    """
    return generate(parse_parameters(PendulumConfig, parameters, where="pendulum"), duration_s=duration_s, rng=rng)


def rotor(*, duration_s: float = 5.0, rng: RandomSource | None = None, **parameters: Any) -> Motion:
    """Generate a hub at rest with rotating blade tips.

    The hub is above x = 0, and the rate is constant. Blade k is at the angle 2 pi (rotation_hz t +
    k / blades), from the plane's first axis to its second. The maximum speed is 2 pi rotation_hz
    radius_m. The signature repeats ``blades`` times per turn.

    Parameters
    ----------
    **parameters
        Fields of :class:`RotorConfig`.

    Returns
    -------
    Motion
        Motion of the points ``"hub"``, ``"blade_1"``, ...

    Raises
    ------
    ConfigError
        If a parameter is outside its range.

    Examples
    --------
    >>> import doppelgait as dg
    >>> motion = dg.motion.rotor(duration_s=2.0)
    >>> motion.markers, round(motion.facts.gait_frequency_hz, 2)  # blades passing per second
    (['hub', 'blade_1', 'blade_2'], 4.0)
    """
    return generate(parse_parameters(RotorConfig, parameters, where="rotor"), duration_s=duration_s, rng=rng)


def breathing_person(*, duration_s: float = 20.0, rng: RandomSource | None = None, **parameters: Any) -> Motion:
    """Generate head and torso of a breathing person.

    The person stands still, facing +x; the chest moves as a sin(2 pi f t) in x.

    Parameters
    ----------
    **parameters
        Fields of :class:`BreathingConfig`.

    Returns
    -------
    Motion
        Motion of six points.

    Raises
    ------
    ConfigError
        If a parameter is outside its range.

    Examples
    --------
    >>> import doppelgait as dg
    >>> motion = dg.motion.breathing_person(duration_s=2.0)
    >>> round(motion.facts.gait_frequency_hz, 2)  # breaths per second
    0.25
    """
    return generate(
        parse_parameters(BreathingConfig, parameters, where="breathing_person"), duration_s=duration_s, rng=rng
    )


@plugin("motion_model", parameters=PointConfig)
def _generate_point(config: PointConfig, duration_s: float, rng: np.random.Generator | None = None) -> Motion:
    (times_s,), _ = sample_times_s([duration_s], config.rate_hz)
    xyz = stack_columns(config.speed_mps * times_s, 0.0, config.height_m)
    return make_gaitless_motion("point", {"point": xyz}, config.rate_hz)


@plugin("motion_model", parameters=PendulumConfig)
def _generate_pendulum(config: PendulumConfig, duration_s: float, rng: np.random.Generator | None = None) -> Motion:
    (times_s,), _ = sample_times_s([duration_s], config.rate_hz)
    angle = np.radians(config.amplitude_deg) * sine(2 * np.pi * config.frequency_hz * times_s)
    x, z = config.length_m * sine(angle), config.pivot_height_m - config.length_m * cosine(angle)
    return make_gaitless_motion(
        "pendulum", {"bob": stack_columns(x, 0.0, z)}, config.rate_hz, gait_frequency_hz=config.frequency_hz
    )


@plugin("motion_model", parameters=RotorConfig)
def _generate_rotor(config: RotorConfig, duration_s: float, rng: np.random.Generator | None = None) -> Motion:
    (times_s,), _ = sample_times_s([duration_s], config.rate_hz)
    points = {"hub": stack_columns(np.zeros_like(times_s), 0.0, config.hub_height_m)}
    first, second = ("xyz".index(axis) for axis in config.plane)
    for blade in range(config.blades):
        angle = 2 * np.pi * (config.rotation_hz * times_s + blade / config.blades)
        tip = points["hub"].copy()
        tip[:, first] += config.radius_m * cosine(angle)
        tip[:, second] += config.radius_m * sine(angle)
        points[f"blade_{blade + 1}"] = tip
    return make_gaitless_motion("rotor", points, config.rate_hz, gait_frequency_hz=config.blades * config.rotation_hz)


_STANDING = {
    "head": ("head", 0.0, 0.0, 0.93, 0.0),
    "neck": ("torso", 0.0, 0.0, 0.82, 0.0),
    "left_chest": ("torso", 0.06, 0.06, 0.73, 1.0),
    "right_chest": ("torso", 0.06, -0.06, 0.73, 1.0),
    "abdomen": ("torso", 0.06, 0.0, 0.60, 0.5),
    "pelvis": ("torso", 0.0, 0.0, 0.53, 0.0),
}
"""Part, position as fractions of the stature (x, y, z), and share of the chest's motion by point (assumed)."""


@plugin("motion_model", parameters=BreathingConfig)
def _generate_breathing(config: BreathingConfig, duration_s: float, rng: np.random.Generator | None = None) -> Motion:
    (times_s,), _ = sample_times_s([duration_s], config.rate_hz)
    chest_m = config.amplitude_m * sine(2 * np.pi * config.breathing_hz * times_s)
    size_m = config.height_m
    points = {
        name: stack_columns(x * size_m + share * chest_m, y * size_m, z * size_m)
        for name, (_, x, y, z, share) in _STANDING.items()
    }
    return make_gaitless_motion(
        "breathing",
        points,
        config.rate_hz,
        parts=[row[0] for row in _STANDING.values()],
        species="human",
        gait="stand",
        height_m=size_m,
        mass_kg=23.0 * size_m**2,
        gait_frequency_hz=config.breathing_hz,
        report={"mass_kg": "assumed: body mass index 23 kg/m^2", "proportions": "assumed"},
    )


def make_gaitless_motion(
    kind: str,
    points: dict[str, FloatArray],
    rate_hz: float,
    *,
    parts: list[str] | None = None,
    report: Mapping[str, str] | None = None,
    **facts: object,
) -> Motion:
    """Make the motion of a model without gait from its points."""
    return make_motion(
        np.stack(list(points.values()), axis=1),
        rate_hz=rate_hz,
        markers=list(points),
        parts=parts or [""] * len(points),
        facts={"source": kind, "kind": kind, **facts},
        report=report,
    )
