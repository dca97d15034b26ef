"""Random people, dogs, horses and cows of the sim-to-real studies.

One law for every class in all that is not the motion: speed, direction, place, cross section, noise. A speed is drawn
first and sizes are drawn until the gait exists at it, so that the classes share the law of speeds.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from xband_measures import FloatArray

from doppelgait.core.errors import ConfigError
from doppelgait.motion import make_motion
from doppelgait.motion.models import human_gait, quadruped_gait
from doppelgait.motion.models.quadruped_gaits import BUILDS, GAITS
from doppelgait.motion.motion import Motion
from doppelgait.motion.retime import fit_spline
from doppelgait.scene.rcs import RcsSpec

CLASSES = ("human", "dog")
LARGE = "large"
"""Class of horses and cows."""
ATTEMPTS = 40
DOGS = [name for name, build in BUILDS.items() if build.species == "dog"]
QUADRUPEDS = {"dog": (DOGS, (0.25, 0.75), 3.0, 45.0, 0.0), LARGE: (["horse", "cow"], (1.2, 1.7), 1.5, 30.0, 0.9)}
"""Builds, heights of the withers, most of rate (Hz) and sweep (deg) of the tail, and the slowest walk (m/s): not every
large animal of the model can walk slower. A slower one is this walk, slowed, so that the law of speeds stays."""
RATE_HZ = 150.0


def draw_speed_mps(rng: np.random.Generator, low_mps: float, high_mps: float) -> float:
    """Sample a speed, uniform in its logarithm."""
    return float(np.exp(rng.uniform(math.log(low_mps), math.log(high_mps))))


def person(speed_mps: float, seconds: float, rng: np.random.Generator) -> Motion:
    """Sample a walking or running person of any size and style."""
    hands = ("free", "free", "pockets", "carrying")
    style: dict[str, Any] = {
        "start_phase": float(rng.random()), "height_m": float(np.clip(rng.normal(1.70, 0.10), 1.4, 2.0)),
        "walk_ratio": float(np.clip(np.exp(0.08 * rng.standard_normal()), 0.75, 1.3)),
        "arm_swing": float(rng.uniform(0.2, 1.4)),
        "left_hand": hands[rng.integers(4)], "right_hand": hands[rng.integers(4)],
        "step_time_sd": float(rng.uniform(0, 0.04)), "step_length_sd": float(rng.uniform(0, 0.04)),
        "pace_sd": float(rng.uniform(0, 0.1)),
        "time_asymmetry": float(rng.uniform(-0.05, 0.05)), "length_asymmetry": float(rng.uniform(-0.05, 0.05)),
    }  # fmt: skip
    return human_gait(speed_mps=speed_mps, duration_s=seconds, rng=rng, rate_hz=RATE_HZ, **style)


def quadruped(label: str, speed_mps: float, seconds: float, rng: np.random.Generator) -> Motion:
    """Sample a dog, or a horse or a cow, of any size and build in a gait that is possible at its speed."""
    builds, withers_m, tail_hz, tail_deg, slowest_mps = QUADRUPEDS[label]
    slower = speed_mps / max(speed_mps, slowest_mps)
    style: dict[str, Any] = {
        "start_phase": float(rng.random()), "build": builds[rng.integers(len(builds))],
        "withers_m": float(rng.uniform(*withers_m)),
        "gait": "auto" if rng.random() < 0.6 else list(GAITS)[rng.integers(len(GAITS))],
        "stride_variation": float(rng.uniform(0, 0.04)), "asymmetry": float(rng.uniform(-0.03, 0.03)),
        "pace_sd": float(rng.uniform(0, 0.1)),
        "tail_frequency_hz": float(rng.uniform(0, tail_hz)), "tail_sweep_deg": float(rng.uniform(0, tail_deg)),
    }  # fmt: skip
    motion = quadruped_gait(speed_mps=speed_mps / slower, duration_s=seconds, rng=rng, rate_hz=RATE_HZ, **style)
    return motion if slower == 1 else hurried(motion, seconds, lambda times_s: np.full_like(times_s, slower))


Maker = Callable[..., Motion]
MAKERS: dict[str, Maker] = {"human": person, **{label: partial(quadruped, label) for label in QUADRUPEDS}}


def until_possible(make: Callable[[], Motion]) -> Motion:
    """Return the first sample that is a possible gait."""
    for _ in range(ATTEMPTS - 1):
        try:
            return make()
        except ConfigError:
            continue
    return make()


def make_model_motion(label: str, speed_mps: float, seconds: float, rng: np.random.Generator) -> Motion:
    """Sample a model target that lasts some seconds."""
    return until_possible(lambda: MAKERS[label](speed_mps, seconds, rng))


def hurried(motion: Motion, seconds: float, pace: Callable[[FloatArray], FloatArray]) -> Motion:
    """Resample a motion at a varying pace for a duration."""
    times_s = np.arange(0.0, seconds + 1.0 / RATE_HZ, 1.0 / RATE_HZ)
    own_s = np.concatenate([[0.0], np.cumsum(pace(times_s)[:-1])]) / RATE_HZ
    if own_s[-1] > float(motion.time_s[-1]):
        raise ConfigError(f"a motion of {float(motion.time_s[-1]):.1f} s is too short for {own_s[-1]:.1f} s")
    facts = {key: getattr(motion.facts, key) for key in ("source", "kind", "species", "gait", "mass_kg", "height_m")}
    facts["stride_frequency_hz"] = float(own_s[-1] / times_s[-1]) * motion.facts.stride_frequency_hz
    position_m = fit_spline(motion).at(own_s)[0].reshape(own_s.size, *motion.positions.shape[1:])
    return make_motion(position_m, rate_hz=RATE_HZ, markers=motion.markers, parts=motion.parts, facts=facts)


def subject_of(path: Path) -> str:
    """Return the subject of a motion file. The folder of a dog, the subject number of a CMU file, else the file."""
    if path.parent.name in ("mann-bvh", "tencent-bvh"):
        return path.parent.name
    parts = path.stem.replace("cmu_", "").split("_")
    return f"cmu-{parts[0]}" if parts[0].isdigit() else path.stem


def draw_rcs(rng: np.random.Generator) -> RcsSpec:
    """Sample the cross section of a target, 0.015 to 1.6 m^2, independent of its class; the same number of draws."""
    hidden = rng.random() < 0.7
    total_m2, correlation_s = (float(np.exp(rng.uniform(*np.log(ends)))) for ends in ((0.015, 1.6), (0.03, 0.3)))
    around: dict[str, Any] = {"total_m2": total_m2}
    if rng.random() < 0.8:
        around |= {"fluctuation": "swerling1", "correlation_s": correlation_s}
    return RcsSpec(kind="auto", occlusion=hidden, **around)
