"""Confusers in a home: robot vacuum, curtain, fan."""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np
from pydantic import Field, model_validator

from doppelgait.core.config import FrozenModel
from doppelgait.core.plugins import plugin
from doppelgait.core.rng import RandomSource
from doppelgait.core.units import FloatArray, cosine, sine
from doppelgait.motion.models.primitives import check_clearance, make_gaitless_motion, rotor
from doppelgait.motion.models.registry import generate, parse_parameters
from doppelgait.motion.models.strides import sample_times_s, stack_columns
from doppelgait.motion.motion import Motion

FRAMES_PER_TURN = 16
"""Minimum number of frames per turn of a brush or blade. The error of a spline is then 1 % of the tip speed."""
RIM_POINTS = 8
BRUSH_ARMS = 3
MASS_KG = {"vacuum": 3.5, "curtain": 1.5, "fan": 3.0}
"""Assumed masses. They determine the radar cross section if none is set."""


class VacuumConfig(FrozenModel):
    """Parameters of :func:`robot_vacuum`.

    Parameters
    ----------
    speed_mps : float
        Speed V of the centre, 0 to 1.
    turn_deg_per_s : float
        Rate w of turning to the left, -180 to 180.
    radius_m : float
        Radius of the rim, 0.05 to 0.5.
    height_m : float
        Height of the shell, 0.02 to 0.3; the rim is at half of it.
    brush_hz : float
        Turns of the brush per second f, 0 (no brush) to 20.
    brush_radius_m : float
        Length r of the brush's arms.
    rate_hz : float
        Frames per second, 16 per turn of the brush or more.
    """

    kind: Literal["vacuum"] = "vacuum"

    speed_mps: float = Field(0.3, ge=0, le=1)
    turn_deg_per_s: float = Field(0.0, ge=-180, le=180)
    radius_m: float = Field(0.17, ge=0.05, le=0.5)
    height_m: float = Field(0.09, ge=0.02, le=0.3)
    brush_hz: float = Field(0.0, ge=0, le=20)
    brush_radius_m: float = Field(0.07, gt=0, le=0.2)
    rate_hz: float = Field(250.0, ge=1, le=100_000)

    @model_validator(mode="after")
    def _check_frame_rate(self) -> VacuumConfig:
        _check_turns(self.rate_hz, self.brush_hz, "brush_hz")
        return self


class CurtainConfig(FrozenModel):
    """Parameters of :func:`curtain`.

    Parameters
    ----------
    sway_hz : float
        Frequency f, above 0 to 2; 0.2 to 0.6 in a draught (assumed).
    amplitude_m : float
        Amplitude a of the hem, 0 to 0.5. Above the hem, it is proportional to the distance d from the rail.
    phase_deg : float
        Lag phi from one side to the other.
    width_m : float
        Width W of the cloth.
    drop_m : float
        Height D of the cloth.
    rail_height_m : float
        Height of the rail, at least the drop.
    columns : int
        Number of points from side to side.
    rows : int
        Number of points from top to bottom; the last row is on the hem.
    rate_hz : float
        Frames per second.
    """

    kind: Literal["curtain"] = "curtain"

    sway_hz: float = Field(0.4, gt=0, le=2)
    amplitude_m: float = Field(0.05, ge=0, le=0.5)
    phase_deg: float = Field(120.0, ge=-720, le=720)
    width_m: float = Field(1.2, gt=0, le=10)
    drop_m: float = Field(1.8, gt=0, le=5)
    rail_height_m: float = Field(2.0, gt=0, le=6)
    columns: int = Field(5, ge=1, le=50)
    rows: int = Field(4, ge=1, le=50)
    rate_hz: float = Field(250.0, ge=20, le=100_000)

    @model_validator(mode="after")
    def _check_height(self) -> CurtainConfig:
        check_clearance("rail_height_m", self.rail_height_m, "drop_m", self.drop_m, "curtain would reach")
        return self


class FanConfig(FrozenModel):
    """Parameters of :func:`fan`.

    Parameters
    ----------
    radius_m : float
        Distance of the blades' tips from the hub, above 0 to 1.
    rotation_hz : float
        Turns per second, above 0 to 60.
    blades : int
        Number of blades, 3 to 5.
    hub_height_m : float
        Height of the hub, at least the radius.
    rate_hz : float
        Frames per second, 16 per turn or more.
    """

    kind: Literal["fan"] = "fan"

    radius_m: float = Field(0.2, gt=0, le=1)
    rotation_hz: float = Field(15.0, gt=0, le=60)
    blades: int = Field(3, ge=3, le=5)
    hub_height_m: float = Field(1.1, gt=0, le=4)
    rate_hz: float = Field(1000.0, ge=1, le=100_000)

    @model_validator(mode="after")
    def _check_fan(self) -> FanConfig:
        check_clearance("hub_height_m", self.hub_height_m, "radius_m", self.radius_m, "blades would turn")
        _check_turns(self.rate_hz, self.rotation_hz, "rotation_hz")
        return self


def _check_turns(rate_hz: float, rotation_hz: float, key: str) -> None:
    if rate_hz < FRAMES_PER_TURN * rotation_hz:
        raise ValueError(
            f"rate_hz: {rate_hz:g} is not allowed: must be at least {FRAMES_PER_TURN} times {key} = {rotation_hz:g}"
        )


def robot_vacuum(*, duration_s: float = 5.0, rng: RandomSource | None = None, **parameters: Any) -> Motion:
    """Generate a flat round robot vacuum.

    The robot starts at the origin along +x and turns at a constant rate w, so that its centre is on
    a straight line or on a circle of radius V/w. Its rim rotates with it. A side brush is optional:
    three arms rotate about a point of the rim, ahead and to the right. The speed of a tip relative
    to that point is 2 pi (f + w/2 pi) r, where f are the turns per second relative to the robot.

    Parameters
    ----------
    **parameters
        Fields of :class:`VacuumConfig`.

    Returns
    -------
    Motion
        Motion of ``"centre"``, ``"rim_1"``, ... and ``"brush_1"``, ...

    Raises
    ------
    ConfigError
        If a parameter is outside its range.

    Examples
    --------
    >>> import doppelgait as dg
    >>> motion = dg.motion.robot_vacuum(duration_s=2.0)
    >>> path = motion.positions.sel(marker="centre")
    >>> round(float(path[-1, 0] - path[0, 0]), 2)  # path along x in 2 s, m
    0.6
    """
    return generate(parse_parameters(VacuumConfig, parameters, where="robot_vacuum"), duration_s=duration_s, rng=rng)


def curtain(*, duration_s: float = 10.0, rng: RandomSource | None = None, **parameters: Any) -> Motion:
    """Generate a curtain that sways in front of a window.

    Points move along x by a (d/D) sin(2 pi f t - phi y/W), under a rail along y.

    Parameters
    ----------
    **parameters
        Fields of :class:`CurtainConfig`.

    Returns
    -------
    Motion
        Motion of the points ``"cloth_1_1"`` (column, row), ...

    Raises
    ------
    ConfigError
        If a parameter is outside its range.

    Examples
    --------
    >>> import doppelgait as dg
    >>> motion = dg.motion.curtain(duration_s=2.0)
    >>> depth = motion.position_m[:, -1].max(axis=0) - motion.position_m[:, -1].min(axis=0)
    >>> depth.round(2)  # space that a point of the cloth moves in, m
    array([0.09, 0.  , 0.  ])
    """
    return generate(parse_parameters(CurtainConfig, parameters, where="curtain"), duration_s=duration_s, rng=rng)


def fan(*, duration_s: float = 5.0, rng: RandomSource | None = None, **parameters: Any) -> Motion:
    """Generate a fan that blows along +x.

    It is a rotor in the plane (y, z) with a stand at rest.

    The tips move at 2 pi rotation_hz radius_m, 19 m/s by default, which few radars' frame rates can show.

    Parameters
    ----------
    **parameters
        Fields of :class:`FanConfig`.

    Returns
    -------
    Motion
        Motion of ``"hub"``, ``"blade_1"``, ..., ``"stand"`` (half way up) and ``"foot"``.

    Raises
    ------
    ConfigError
        If a parameter is outside its range.

    Examples
    --------
    >>> import doppelgait as dg
    >>> motion = dg.motion.fan(duration_s=2.0)
    >>> motion.rate_hz, motion.facts.gait_frequency_hz  # the blades pass 45 times per second
    (1000.0, 45.0)
    """
    return generate(parse_parameters(FanConfig, parameters, where="fan"), duration_s=duration_s, rng=rng)


@plugin("motion_model", parameters=VacuumConfig)
def _generate_vacuum(config: VacuumConfig, duration_s: float, rng: np.random.Generator | None = None) -> Motion:
    (times_s,), _ = sample_times_s([duration_s], config.rate_hz)
    turn = math.radians(config.turn_deg_per_s)
    heading = turn * times_s
    # x = V t sinc, y = V t (1 - cos)/angle: both are also valid for a straight line.
    distance, half = config.speed_mps * times_s, heading / 2
    chord = distance * np.sinc(half / np.pi)
    centre = stack_columns(chord * cosine(half), chord * sine(half), config.height_m)
    points = {"centre": centre}
    drop = np.array([0.0, 0.0, -config.height_m / 2])
    for k in range(RIM_POINTS):
        points[f"rim_{k + 1}"] = centre + drop + _round(heading + 2 * np.pi * k / RIM_POINTS, config.radius_m)
    hub = centre + drop * 2 + _round(heading - np.pi / 4, config.radius_m)
    for k in range(BRUSH_ARMS if config.brush_hz > 0 else 0):
        angle = heading + 2 * np.pi * (config.brush_hz * times_s + k / BRUSH_ARMS)
        points[f"brush_{k + 1}"] = hub + _round(angle, config.brush_radius_m)
    rate = {"gait_frequency_hz": BRUSH_ARMS * config.brush_hz} if config.brush_hz > 0 else {}
    return _make_confuser("vacuum", points, config.rate_hz, height_m=config.height_m, **rate)


@plugin("motion_model", parameters=CurtainConfig)
def _generate_curtain(config: CurtainConfig, duration_s: float, rng: np.random.Generator | None = None) -> Motion:
    (times_s,), _ = sample_times_s([duration_s], config.rate_hz)
    points = {}
    for column, across in enumerate(np.linspace(-0.5, 0.5, config.columns) if config.columns > 1 else [0.0]):
        lag = math.radians(config.phase_deg) * across
        wave = config.amplitude_m * sine(2 * np.pi * config.sway_hz * times_s - lag)
        for row in range(config.rows):
            down = (row + 1) / config.rows
            place = stack_columns(down * wave, across * config.width_m, config.rail_height_m - down * config.drop_m)
            points[f"cloth_{column + 1}_{row + 1}"] = place
    rate = {"gait_frequency_hz": config.sway_hz} if config.amplitude_m > 0 else {}
    return _make_confuser("curtain", points, config.rate_hz, height_m=config.rail_height_m, **rate)


@plugin("motion_model", parameters=FanConfig)
def _generate_fan(config: FanConfig, duration_s: float, rng: np.random.Generator | None = None) -> Motion:
    turning = rotor(plane="yz", duration_s=duration_s, **config.model_dump(exclude={"kind"}))
    points = {name: turning.position_m[:, n] for n, name in enumerate(turning.markers)}
    still = np.zeros(turning.n_frames)
    points |= {"stand": stack_columns(still, 0.0, config.hub_height_m / 2), "foot": stack_columns(still, 0.0, 0.0)}
    top_m = config.hub_height_m + config.radius_m
    return _make_confuser(
        "fan", points, config.rate_hz, height_m=top_m, gait_frequency_hz=turning.facts.gait_frequency_hz
    )


def _round(angle_rad: FloatArray, radius_m: float) -> FloatArray:
    return radius_m * np.stack([cosine(angle_rad), sine(angle_rad), np.zeros_like(angle_rad)], axis=1)


def _make_confuser(kind: str, points: dict[str, FloatArray], rate_hz: float, **facts: Any) -> Motion:
    return make_gaitless_motion(kind, points, rate_hz, report={"mass_kg": "assumed"}, mass_kg=MASS_KG[kind], **facts)
