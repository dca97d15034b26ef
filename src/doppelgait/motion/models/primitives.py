"""Primitives, a breathing and a crawling person, and the confusers of a home."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
from pydantic import Field, model_validator

from doppelgait.core.config import FrozenModel
from doppelgait.core.plugins import plugin
from doppelgait.core.units import FloatArray, cosine, sine
from doppelgait.motion.models.human_body import LENGTHS, PEOPLE, POINTS, make_person_motions
from doppelgait.motion.models.registry import ModelFunction, model_function
from doppelgait.motion.models.strides import (
    Columns,
    Curve,
    Rngs,
    Values,
    sample_times_s,
    scale_points,
    solve_two_links,
    stack_columns,
    time_even_strides,
)
from doppelgait.motion.motion import Motion, make_motion

Plane = Literal["xy", "xz", "yz"]
Body = tuple[dict[str, FloatArray], dict[str, Any]]
"""Points over time by name, (T, 3), and facts of the motion."""
FRAMES_PER_TURN = 16
"""Minimum frames per turn of a brush or blade: a spline's error is then 1 % of the tip speed."""
RIM_POINTS = 8
BRUSH_ARMS = 3
ASSUMED_MASS = {"mass_kg": "assumed"}
"""Report of a confuser. Its mass determines the radar cross section if none is set."""


def gaitless_model(
    model: type[FrozenModel],
    *,
    duration_s: float = 5.0,
    parts: list[str] | None = None,
    report: Mapping[str, str] | None = None,
    **facts: Any,
) -> Callable[[Callable[[Any, FloatArray], Body]], ModelFunction]:
    """Register a gaitless model by the function that places its points."""
    kind = model.model_fields["kind"].default

    def wrap(place: Callable[[Any, FloatArray], Body]) -> ModelFunction:
        @plugin("motion_model", parameters=model)
        @wraps(place)
        def run(config: Any, duration_s: float, rng: np.random.Generator | None = None) -> Motion:
            (times_s,), _ = sample_times_s([duration_s], config.rate_hz)
            points, own = place(config, times_s)
            return make_motion(
                np.stack([*points.values()], axis=1),
                rate_hz=config.rate_hz,
                markers=[*points],
                parts=parts or [""] * len(points),
                facts={"source": kind, "kind": kind, **facts, **own},
                report=report,
            )

        return model_function(model, duration_s=duration_s)(run)

    return wrap


def _require_at_least(key: str, other: str, why: str, factor: int = 1) -> Any:
    """Make a check of a parameter against a multiple of another one."""

    def check(config: Any) -> Any:
        value, least = getattr(config, key), getattr(config, other)
        if value < factor * least and getattr(config, "plane", "") != "xy":  # a level rotor needs no height
            raise ValueError(f"{key}: {value:g} is not allowed: {why} {other} = {least:g}")
        return config

    return model_validator(mode="after")(check)


def _require_height(key: str, other: str, motion: str) -> Any:
    return _require_at_least(key, other, f"the {motion} through the floor; must be at least")


def _require_rate(other: str) -> Any:
    return _require_at_least("rate_hz", other, f"must be at least {FRAMES_PER_TURN} times", FRAMES_PER_TURN)


class PointConfig(FrozenModel):
    """Point of :func:`moving_point`, on a straight line.

    speed_mps: Speed V along +x, 0 (a point at rest) to 1000.
    height_m: Height above the floor.
    rate_hz: Frames per second.
    """

    kind: Literal["point"] = "point"
    speed_mps: float = Field(1.0, ge=0, le=1000)
    height_m: float = Field(1.0, ge=0, le=1000)
    rate_hz: float = Field(250.0, ge=1, le=100_000)


@gaitless_model(PointConfig)
def moving_point(config: PointConfig, times_s: FloatArray) -> Body:
    """Generate a point on a straight line.

    Its position is x = V t at a constant height. The only point is ``"point"``.

    >>> import doppelgait as dg
    >>> motion = dg.motion.moving_point(duration_s=2.0)
    >>> (motion.position_m[-1, 0] - motion.position_m[0, 0]).round(2)  # displacement in 2 s, m
    array([2., 0., 0.])
    """
    return {"point": stack_columns(config.speed_mps * times_s, 0.0, config.height_m)}, {}


class PendulumConfig(FrozenModel):
    """Swinging point of :func:`pendulum`.

    length_m: Length l, above 0.
    amplitude_deg: Largest angle a, 0 to 180 degrees.
    frequency_hz: Full swings per second f, above 0.
    pivot_height_m: Height of the pivot, at least the length.
    rate_hz: Frames per second.
    """

    kind: Literal["pendulum"] = "pendulum"
    length_m: float = Field(0.8, gt=0, le=100)
    amplitude_deg: float = Field(30.0, ge=0, le=180)
    frequency_hz: float = Field(1.0, gt=0, le=100)
    pivot_height_m: float = Field(1.0, ge=0, le=1000)
    rate_hz: float = Field(250.0, ge=1, le=100_000)

    _check_height = _require_height("pivot_height_m", "length_m", "pendulum would swing")


@gaitless_model(PendulumConfig)
def pendulum(config: PendulumConfig, times_s: FloatArray) -> Body:
    """Generate a point that swings in x under a pivot.

    The pivot is above x = 0. The angle of the point ``"bob"`` from the vertical is a sin(2 pi f t),
    positive forward. The maximum speed is 2 pi f a l, at the lowest point.

    >>> import doppelgait as dg
    >>> motion = dg.motion.pendulum(duration_s=2.0)
    >>> round(motion.facts.gait_frequency_hz, 2)
    1.0
    """
    angle = np.radians(config.amplitude_deg) * sine(2 * np.pi * config.frequency_hz * times_s)
    x, z = config.length_m * sine(angle), config.pivot_height_m - config.length_m * cosine(angle)
    return {"bob": stack_columns(x, 0.0, z)}, {"gait_frequency_hz": config.frequency_hz}


class RotorConfig(FrozenModel):
    """Hub with rotating blade tips of :func:`rotor`.

    radius_m: Distance of the tips from the hub, above 0.
    rotation_hz: Turns per second, above 0.
    blades: Number of blades.
    plane: Plane of rotation: ``"xy"`` (level), ``"xz"`` or ``"yz"``.
    hub_height_m: Height of the hub; at least the radius unless level.
    rate_hz: Frames per second.
    """

    kind: Literal["rotor"] = "rotor"
    radius_m: float = Field(0.3, gt=0, le=100)
    rotation_hz: float = Field(2.0, gt=0, le=1000)
    blades: int = Field(2, ge=1, le=64)
    plane: Plane = "xz"
    hub_height_m: float = Field(1.0, ge=0, le=1000)
    rate_hz: float = Field(250.0, ge=1, le=100_000)

    _check_height = _require_height("hub_height_m", "radius_m", "blades would turn")


@gaitless_model(RotorConfig)
def rotor(config: RotorConfig, times_s: FloatArray) -> Body:
    """Generate a hub at rest with rotating blade tips.

    The hub is above x = 0. Blade k is at the angle 2 pi (rotation_hz t + k / blades), from the
    plane's first axis to its second. The points are ``"hub"``, ``"blade_1"``, ...

    >>> import doppelgait as dg
    >>> motion = dg.motion.rotor(duration_s=2.0)
    >>> motion.markers, round(motion.facts.gait_frequency_hz, 2)  # blades passing per second
    (['hub', 'blade_1', 'blade_2'], 4.0)
    """
    return _place_blades(config, config.plane, times_s)


def _place_blades(config: RotorConfig | FanConfig, plane: Plane, times_s: FloatArray) -> Body:
    points = {"hub": stack_columns(np.zeros_like(times_s), 0.0, config.hub_height_m)}
    for blade in range(config.blades):
        angle = 2 * np.pi * (config.rotation_hz * times_s + blade / config.blades)
        points[f"blade_{blade + 1}"] = points["hub"] + _place_round(angle, config.radius_m, plane)
    return points, {"gait_frequency_hz": config.blades * config.rotation_hz}


class BreathingConfig(FrozenModel):
    """Head and torso of :func:`breathing_person`.

    height_m: Stature.
    breathing_hz: Breaths per second f.
    amplitude_m: Amplitude a of the two chest points. The abdomen moves half as far (assumed).
    rate_hz: Frames per second.
    """

    kind: Literal["breathing"] = "breathing"
    height_m: float = Field(1.75, ge=0.4, le=2.4)
    breathing_hz: float = Field(0.25, gt=0, le=2)
    amplitude_m: float = Field(0.005, ge=0, le=0.05)
    rate_hz: float = Field(250.0, ge=1, le=10_000)


@gaitless_model(
    BreathingConfig,
    duration_s=20.0,
    parts=[part for part, *_ in PEOPLE["breathing"].values()],
    report={"mass_kg": "assumed: body mass index 23 kg/m^2", "proportions": "assumed"},
    species="human",
    gait="stand",
)
def breathing_person(config: BreathingConfig, times_s: FloatArray) -> Body:
    """Generate head and torso of a breathing person.

    The person stands still, facing +x; the chest moves as a sin(2 pi f t) in x.

    >>> import doppelgait as dg
    >>> motion = dg.motion.breathing_person(duration_s=2.0)
    >>> round(motion.facts.gait_frequency_hz, 2)  # breaths per second
    0.25
    """
    chest_m = config.amplitude_m * sine(2 * np.pi * config.breathing_hz * times_s)
    size_m = config.height_m
    points = {
        name: stack_columns(x * size_m + share * chest_m, y * size_m, z * size_m)
        for name, (_, x, y, z, share) in PEOPLE["breathing"].items()
    }
    return points, {"height_m": size_m, "mass_kg": 23.0 * size_m**2, "gait_frequency_hz": config.breathing_hz}


class VacuumConfig(FrozenModel):
    """Flat round robot of :func:`robot_vacuum`.

    speed_mps: Speed V of the centre.
    turn_deg_per_s: Rate w of turning to the left.
    radius_m: Radius of the rim.
    height_m: Height of the shell; the rim is at half of it.
    brush_hz: Turns of the brush per second f, 0 (no brush) to 20.
    brush_radius_m: Length r of the brush's arms.
    rate_hz: Frames per second, 16 per turn of the brush or more.
    """

    kind: Literal["vacuum"] = "vacuum"
    speed_mps: float = Field(0.3, ge=0, le=1)
    turn_deg_per_s: float = Field(0.0, ge=-180, le=180)
    radius_m: float = Field(0.17, ge=0.05, le=0.5)
    height_m: float = Field(0.09, ge=0.02, le=0.3)
    brush_hz: float = Field(0.0, ge=0, le=20)
    brush_radius_m: float = Field(0.07, gt=0, le=0.2)
    rate_hz: float = Field(250.0, ge=1, le=100_000)

    _check_rate = _require_rate("brush_hz")


@gaitless_model(VacuumConfig, report=ASSUMED_MASS, mass_kg=3.5)
def robot_vacuum(config: VacuumConfig, times_s: FloatArray) -> Body:
    """Generate a flat round robot vacuum.

    It starts at the origin along +x and turns at a constant rate w. The three arms of an optional
    side brush rotate about a point of the rim, ahead and to the right, with tip speeds of
    2 pi (f + w/2 pi) r. The points are ``"centre"``, ``"rim_1"``, ... and ``"brush_1"``, ...

    >>> import doppelgait as dg
    >>> motion = dg.motion.robot_vacuum(duration_s=2.0)
    >>> path = motion.positions.sel(marker="centre")
    >>> round(float(path[-1, 0] - path[0, 0]), 2)  # path along x in 2 s, m
    0.6
    """
    turn = math.radians(config.turn_deg_per_s)
    heading = turn * times_s
    # x = V t sinc, y = V t (1 - cos)/angle: both are also valid for a straight line.
    distance, half = config.speed_mps * times_s, heading / 2
    chord = distance * np.sinc(half / np.pi)
    centre = stack_columns(chord * cosine(half), chord * sine(half), config.height_m)
    points = {"centre": centre}
    drop = np.array([0.0, 0.0, -config.height_m / 2])
    for k in range(RIM_POINTS):
        points[f"rim_{k + 1}"] = centre + drop + _place_round(heading + 2 * np.pi * k / RIM_POINTS, config.radius_m)
    hub = centre + drop * 2 + _place_round(heading - np.pi / 4, config.radius_m)
    for k in range(BRUSH_ARMS if config.brush_hz > 0 else 0):
        angle = heading + 2 * np.pi * (config.brush_hz * times_s + k / BRUSH_ARMS)
        points[f"brush_{k + 1}"] = hub + _place_round(angle, config.brush_radius_m)
    rate = {"gait_frequency_hz": BRUSH_ARMS * config.brush_hz} if config.brush_hz > 0 else {}
    return points, {"height_m": config.height_m, **rate}


def _place_round(angle_rad: FloatArray, radius_m: float, plane: Plane = "xy") -> FloatArray:
    along = {plane[0]: cosine(angle_rad), plane[1]: sine(angle_rad)}
    return radius_m * np.stack([along.get(axis, np.zeros_like(angle_rad)) for axis in "xyz"], axis=1)


class CurtainConfig(FrozenModel):
    """Swaying cloth of :func:`curtain`.

    sway_hz: Frequency f; 0.2 to 0.6 in a draught (assumed).
    amplitude_m: Amplitude a of the hem; above it, proportional to the distance d from the rail.
    phase_deg: Lag phi from one side to the other.
    width_m: Width W of the cloth.
    drop_m: Height D of the cloth.
    rail_height_m: Height of the rail, at least the drop.
    columns: Number of points from side to side.
    rows: Number of points from top to bottom; the last row is on the hem.
    rate_hz: Frames per second.
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

    _check_height = _require_height("rail_height_m", "drop_m", "curtain would reach")


@gaitless_model(CurtainConfig, duration_s=10.0, report=ASSUMED_MASS, mass_kg=1.5)
def curtain(config: CurtainConfig, times_s: FloatArray) -> Body:
    """Generate a curtain that sways in front of a window.

    Points move along x by a (d/D) sin(2 pi f t - phi y/W), under a rail along y. They are
    ``"cloth_1_1"`` (column, row), ...

    >>> import doppelgait as dg
    >>> motion = dg.motion.curtain(duration_s=2.0)
    >>> depth = motion.position_m[:, -1].max(axis=0) - motion.position_m[:, -1].min(axis=0)
    >>> depth.round(2)  # space that a point of the cloth moves in, m
    array([0.09, 0.  , 0.  ])
    """
    points = {}
    for column, across in enumerate(np.linspace(-0.5, 0.5, config.columns) if config.columns > 1 else [0.0]):
        lag = math.radians(config.phase_deg) * across
        wave = config.amplitude_m * sine(2 * np.pi * config.sway_hz * times_s - lag)
        for row in range(config.rows):
            down = (row + 1) / config.rows
            cloth = stack_columns(down * wave, across * config.width_m, config.rail_height_m - down * config.drop_m)
            points[f"cloth_{column + 1}_{row + 1}"] = cloth
    rate = {"gait_frequency_hz": config.sway_hz} if config.amplitude_m > 0 else {}
    return points, {"height_m": config.rail_height_m, **rate}


class FanConfig(FrozenModel):
    """Rotor on a stand of :func:`fan`.

    radius_m: Distance of the blades' tips from the hub.
    rotation_hz: Turns per second.
    blades: Number of blades.
    hub_height_m: Height of the hub, at least the radius.
    rate_hz: Frames per second, 16 per turn or more.
    """

    kind: Literal["fan"] = "fan"
    radius_m: float = Field(0.2, gt=0, le=1)
    rotation_hz: float = Field(15.0, gt=0, le=60)
    blades: int = Field(3, ge=3, le=5)
    hub_height_m: float = Field(1.1, gt=0, le=4)
    rate_hz: float = Field(1000.0, ge=1, le=100_000)

    _check_height = _require_height("hub_height_m", "radius_m", "blades would turn")
    _check_rate = _require_rate("rotation_hz")


@gaitless_model(FanConfig, report=ASSUMED_MASS, mass_kg=3.0)
def fan(config: FanConfig, times_s: FloatArray) -> Body:
    """Generate a fan that blows along +x.

    It is a rotor in the plane (y, z) with a stand at rest: ``"hub"``, ``"blade_1"``, ...,
    ``"stand"`` (half way up) and ``"foot"``. The tips move at 19 m/s by default.

    >>> import doppelgait as dg
    >>> motion = dg.motion.fan(duration_s=2.0)
    >>> motion.rate_hz, motion.facts.gait_frequency_hz  # the blades pass 45 times per second
    (1000.0, 45.0)
    """
    points, facts = _place_blades(config, "yz", times_s)
    still = np.zeros_like(times_s)
    points |= {"stand": stack_columns(still, 0.0, config.hub_height_m / 2), "foot": stack_columns(still, 0.0, 0.0)}
    return points, {"height_m": config.hub_height_m + config.radius_m, **facts}


CRAWL = SimpleNamespace(**PEOPLE["crawl"])
"""Gait of a crawling person, which is assumed."""


class CrawlConfig(FrozenModel):
    """Person of :func:`crawling_person`, on hands and knees.

    speed_mps: Mean forward speed V.
    height_m: Stature H.
    mass_kg: Body mass; by default that of a body mass index of 23.
    start_phase: Phase at the start in cycles, 0 (right hand and left knee touch down) to below 1.
    stride_variation: Standard deviation of the stride time relative to its mean.
    pace_sd: Standard deviation of the speed of strides relative to its mean.
    rate_hz: Frames per second.
    """

    kind: Literal["crawl"] = "crawl"
    speed_mps: float = Field(0.4, ge=0.1, le=0.8)
    height_m: float = Field(1.75, ge=0.9, le=2.1)
    mass_kg: float | None = Field(None, gt=0, le=400)
    start_phase: float = Field(0.0, ge=0, lt=1)
    stride_variation: float = Field(0.0, ge=0, le=0.1)
    pace_sd: float = Field(0.0, ge=0, le=0.1)
    rate_hz: float = Field(250.0, ge=50, le=10_000)

    @model_validator(mode="after")
    def _check_speed(self) -> CrawlConfig:
        top_mps = (0.36 / CRAWL.duty) ** 2 / CRAWL.stride_ratio * self.height_m
        if self.speed_mps > top_mps:
            raise ValueError(
                f"speed_mps: {self.speed_mps:g} is not allowed: a person of height_m = {self.height_m:g} crawls at "
                f"{top_mps:.2g} m/s at most"
            )
        return self


@model_function(CrawlConfig)
@plugin("motion_model", parameters=CrawlConfig)
def crawling_person(parameters: Sequence[CrawlConfig], durations_s: Sequence[float], rngs: Rngs) -> list[Motion]:
    """Generate a person who crawls on hands and knees.

    Diagonal limbs move together, with the stride frequency f = sqrt(V/(0.36 H)) (assumed, like all
    proportions of the gait). Hands and knees rest on the floor for 65 % of a stride. The points are
    the 17 of the Boulic walk, along +x over z = 0.

    >>> import doppelgait as dg
    >>> motion = dg.motion.crawling_person(duration_s=2.0)
    >>> head = motion.positions.sel(marker="head", space="z")
    >>> round(float(head.mean()), 1), round(motion.facts.gait_frequency_hz, 1)  # height in m, cycles per second
    (0.7, 1.6)
    """
    columns = Columns(parameters)
    height_m = columns.height_m
    stride_hz = np.sqrt(columns.speed_mps / (CRAWL.stride_ratio * height_m))
    timing, drift = time_even_strides(durations_s, columns, 1 / stride_hz, rngs)
    stride_m = columns.speed_mps / stride_hz
    points = compute_crawling_points(timing.phase, stride_m / height_m, drift)
    position_m = scale_points([points[name] for name in POINTS], height_m)
    start = timing.phase[:, :1]
    position_m[..., 0] -= (stride_m * (start + drift(start)))[..., None]
    report = {"gait": "assumed: timing and proportions"}
    return make_person_motions(position_m, timing, parameters, ["crawl"] * len(parameters), CRAWL.touchdown, report)


def place_limb(phase: FloatArray, touchdown: float, drift: Curve) -> tuple[FloatArray, FloatArray]:
    """Return place and lift of a stepping limb."""
    # the place is in strides, the lift from 0 to 1
    cycles = phase - touchdown
    number = np.floor(cycles)
    share = np.clip((cycles - number - CRAWL.duty) / (1 - CRAWL.duty), 0.0, 1.0)
    swing, middle = share**2 * share * (10 - 15 * share + 6 * share**2), touchdown + CRAWL.duty / 2
    late = drift(number + middle)
    late += swing * (drift(number + 1 + middle) - late)
    return number + swing + touchdown + CRAWL.duty / 2 + late, sine(np.pi * share) ** 2


def compute_crawling_points(phase: FloatArray, stride: Values, drift: Curve) -> dict[str, FloatArray]:
    """Return the crawlers' points by name, in statures, (..., n, 3)."""
    size, way = LENGTHS, phase + drift(phase)
    x = stride * way
    reach = CRAWL.arm_reach * (size["upper_arm"] + size["forearm"])
    rise = np.sqrt(reach**2 - (CRAWL.duty * stride / 2) ** 2) - size["thigh"]
    along = np.sqrt(size["torso"] ** 2 - rise**2)
    points = {"base": stack_columns(x, 0.0, size["thigh"]), "neck": stack_columns(x + along, 0.0, size["thigh"] + rise)}
    points["head"] = points["neck"] + size["head"] * np.array([math.cos(0.6), 0.0, math.sin(0.6)])
    for side, sigma in (("left", 1.0), ("right", -1.0)):
        shoulder = points["neck"] + np.array([0.0, sigma * size["half_shoulder"], 0.0])
        place, lift = place_limb(phase, CRAWL.touchdown[f"{side}_hand"], drift)
        ahead = points["neck"][..., 0] - x + stride * place
        hand = stack_columns(ahead, sigma * size["half_shoulder"], CRAWL.hand_lift * lift)
        elbow = solve_two_links(shoulder, hand, size["upper_arm"], size["forearm"], bend=-1.0)
        # the thigh rotates about the hip over the resting knee, which rises slightly at both ends
        hip = points["base"] + np.array([0.0, sigma * size["half_hip"], 0.0])
        ahead = stride * (place_limb(phase, CRAWL.touchdown[f"{side}_knee"], drift)[0] - way)
        knee = hip + stack_columns(ahead, 0.0, -np.sqrt(size["thigh"] ** 2 - ahead**2))
        ankle = knee - [size["shank"], 0.0, 0.0]
        limbs = {"shoulder": shoulder, "elbow": elbow, "hand": hand, "hip": hip, "knee": knee, "ankle": ankle}
        points |= {f"{side}_{name}": xyz for name, xyz in limbs.items()}
        points[f"{side}_toe"] = ankle - [size["foot"], 0.0, 0.0]
    return points
