"""The X-band study on the real figures, and one simulated image next to its recording."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

pytestmark = pytest.mark.shared

MEASURED_MPS = {
    "human__NormalToward": 1.13,
    "human__NormalAway": 1.20,
    "human__PocketAway": 1.35,
    "human__SwingingArmsTowards": 1.20,
    "human__TowardPaintgun": 1.38,
    "dog__LinkWalkingToward": 1.10,
    "dog__LinkWalkAway2": 2.68,
}
"""Torso speeds read from the same figures by another program."""


@pytest.fixture(scope="module")
def sensor() -> ModuleType:
    return import_module("xband_sensor")


@pytest.fixture(scope="module")
def real(sensor: ModuleType, shared: Path) -> dict[str, np.ndarray]:
    levels = sensor.real_levels(shared / "data" / "radar" / "fmcw_xband_manga")
    return {p.key: sensor.measures.towards(levels[p.key], direction=p.direction) for p in sensor.PAIRS}


def test_torso_speeds(sensor: ModuleType, real: dict[str, np.ndarray]) -> None:
    for key, speed_mps in MEASURED_MPS.items():
        assert sensor.measures.torso_speed_mps(real[key]) == pytest.approx(speed_mps, abs=0.1), key


def test_joints_of_bursts_show_where_the_display_puts_them(real: dict[str, np.ndarray]) -> None:
    """Columns of a quiet band against their place in a burst: the strongest is at the joint, 24 of 32."""
    quiet = np.mean([image[150:220, :608].mean(axis=0) for image in real.values()], axis=0)
    assert abs(int(quiet.reshape(19, 32).mean(axis=0).argmax()) - 24) <= 2


def test_a_simulation_is_nearer_than_other_people_are(sensor: ModuleType, real: dict[str, np.ndarray]) -> None:
    pair = sensor.PAIRS[0]
    own = real[pair.key]
    model, rcs = sensor.MODELS["human"]["human"]
    measures = sensor.measures
    levels = sensor.simulate_levels(
        pair, model, rcs, speed_mps=measures.torso_speed_mps(own), noise_db=measures.noise_db(own)
    )
    others = [real[p.key] for p in sensor.PAIRS if p.label == "human" and p is not pair]
    apart = measures.profile_distance(own, levels, ground=False)[0]
    assert apart < np.mean([measures.profile_distance(own, other, ground=False)[0] for other in others])
    assert measures.modulation_hz(levels) == pytest.approx(measures.modulation_hz(own), rel=0.1)
    assert measures.noise_db(levels) == pytest.approx(measures.noise_db(own), abs=0.5)
