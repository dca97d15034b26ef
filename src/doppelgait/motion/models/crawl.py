"""Person who crawls on hands and knees."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from doppelgait.core.config import FrozenModel
from doppelgait.core.plugins import plugin
from doppelgait.core.units import FloatArray, sine
from doppelgait.motion.models.human_body import LENGTHS, POINTS, make_person_motions
from doppelgait.motion.models.registry import model_function
from doppelgait.motion.models.strides import (
    Columns,
    Curve,
    Rngs,
    Values,
    scale_points,
    solve_two_links,
    stack_columns,
    time_even_strides,
)
from doppelgait.motion.motion import Motion

TOUCHDOWN = {"right_hand": 0.0, "left_knee": 0.0, "left_hand": 0.5, "right_knee": 0.5}
"""Phases in cycles at which hands and knees touch down, in diagonal pairs."""
DUTY = 0.65
"""Share of the stride in which a limb is on the floor (assumed)."""
STRIDE_RATIO = 0.36
"""Stride length over frequency in statures per Hz: 0.8 Hz at 0.4 m/s and 1.75 m (assumed)."""
HAND_LIFT = 0.04
"""Height of the hand in mid-swing over the stature (assumed); knees slide forward on the floor."""
ARM_REACH = 0.95
"""Largest distance of hand and shoulder over the length of the arm."""


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
        top_mps = (0.36 / DUTY) ** 2 / STRIDE_RATIO * self.height_m
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
    stride_hz = np.sqrt(columns.speed_mps / (STRIDE_RATIO * height_m))
    timing, drift = time_even_strides(durations_s, columns, 1 / stride_hz, rngs)
    stride_m = columns.speed_mps / stride_hz
    points = compute_crawling_points(timing.phase, stride_m / height_m, drift)
    position_m = scale_points([points[name] for name in POINTS], height_m)
    start = timing.phase[:, :1]
    position_m[..., 0] -= (stride_m * (start + drift(start)))[..., None]
    report = {"gait": "assumed: timing and proportions"}
    return make_person_motions(position_m, timing, parameters, ["crawl"] * len(parameters), TOUCHDOWN, report)


def place_limb(phase: FloatArray, touchdown: float, drift: Curve) -> tuple[FloatArray, FloatArray]:
    """Return place and lift of a stepping limb."""
    # the place is in strides, the lift from 0 to 1
    cycles = phase - touchdown
    number = np.floor(cycles)
    share = np.clip((cycles - number - DUTY) / (1 - DUTY), 0.0, 1.0)
    swing, middle = share**2 * share * (10 - 15 * share + 6 * share**2), touchdown + DUTY / 2
    late = drift(number + middle)
    late += swing * (drift(number + 1 + middle) - late)
    return number + swing + touchdown + DUTY / 2 + late, sine(np.pi * share) ** 2


def compute_crawling_points(phase: FloatArray, stride: Values, drift: Curve) -> dict[str, FloatArray]:
    """Return the crawlers' points by name, in statures, (..., n, 3)."""
    size, way = LENGTHS, phase + drift(phase)
    x = stride * way
    reach = ARM_REACH * (size["upper_arm"] + size["forearm"])
    rise = np.sqrt(reach**2 - (DUTY * stride / 2) ** 2) - size["thigh"]
    along = np.sqrt(size["torso"] ** 2 - rise**2)
    points = {"base": stack_columns(x, 0.0, size["thigh"]), "neck": stack_columns(x + along, 0.0, size["thigh"] + rise)}
    points["head"] = points["neck"] + size["head"] * np.array([math.cos(0.6), 0.0, math.sin(0.6)])
    for side, sigma in (("left", 1.0), ("right", -1.0)):
        shoulder = points["neck"] + np.array([0.0, sigma * size["half_shoulder"], 0.0])
        place, lift = place_limb(phase, TOUCHDOWN[f"{side}_hand"], drift)
        ahead = points["neck"][..., 0] - x + stride * place
        hand = stack_columns(ahead, sigma * size["half_shoulder"], HAND_LIFT * lift)
        elbow = solve_two_links(shoulder, hand, size["upper_arm"], size["forearm"], bend=-1.0)
        # the thigh rotates about the hip over the resting knee, which rises slightly at both ends
        hip = points["base"] + np.array([0.0, sigma * size["half_hip"], 0.0])
        ahead = stride * (place_limb(phase, TOUCHDOWN[f"{side}_knee"], drift)[0] - way)
        knee = hip + stack_columns(ahead, 0.0, -np.sqrt(size["thigh"] ** 2 - ahead**2))
        ankle = knee - [size["shank"], 0.0, 0.0]
        limbs = {"shoulder": shoulder, "elbow": elbow, "hand": hand, "hip": hip, "knee": knee, "ankle": ankle}
        points |= {f"{side}_{name}": xyz for name, xyz in limbs.items()}
        points[f"{side}_toe"] = ankle - [size["foot"], 0.0, 0.0]
    return points
