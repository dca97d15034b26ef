"""Measures of pictures whose answer is known."""

from types import ModuleType

import numpy as np
import pytest


def picture(study: ModuleType, torso_mps: float, *, noise_db: float = -30.0, limb: float = 1.5) -> np.ndarray:
    """A line 0.22 m/s thick that waves, and limbs of -20 dB up to a speed, every second column."""
    velocity, columns = study.VELOCITY_MPS, np.arange(600)
    line = torso_mps + 0.1 * np.sin(2.0 * np.pi * columns / 20.0)
    level = np.full((velocity.size, columns.size), noise_db)
    ahead = velocity[:, np.newaxis] * np.sign(torso_mps)
    level[(ahead > 0.3) & (ahead < limb * abs(torso_mps)) & (columns % 2 == 0)] = -20.0
    level[np.abs(velocity[:, np.newaxis] - line) < 0.11] = -10.0
    return level


@pytest.mark.parametrize("torso_mps", [1.2, -1.2])
def test_measures_of_a_drawn_picture(study: ModuleType, torso_mps: float) -> None:
    found = study.measure_picture(picture(study, torso_mps, limb=2.3), torso_mps)
    assert found["thickness"] == pytest.approx(0.22, abs=0.04)
    assert found["envelope"] == pytest.approx(2.3, abs=0.05)
    assert found["wave"] == pytest.approx(0.1 / np.sqrt(2.0) / 1.2, rel=0.25)  # limbs hold the centroid back
    assert found["fill"] == pytest.approx(5.0, abs=0.5)
    assert [found[f"{times} V"] for times in ("1.5", "2", "2.5")] == pytest.approx([5.0, 5.0, 0.0], abs=0.01)
    assert found["verticality"] == pytest.approx(1.0)


def test_speeds_beyond_the_axis_are_unknown(study: ModuleType) -> None:
    found = study.measure_picture(picture(study, 2.6), 2.6)
    assert np.isnan([found["2 V"], found["2.5 V"], found["verticality"]]).all()


def test_like_is_alike_in_speed_noise_and_level(study: ModuleType) -> None:
    real = {"V": 1.2, "noise": -30.0, "over ground": 0.0}
    assert study.resemble(real | {"V": 1.3, "noise": -32.0, "over ground": 2.0}, real)
    for name, value in {"V": 1.4, "noise": -34.0, "over ground": 4.0}.items():
        assert not study.resemble(real | {name: value}, real)


def test_coverage_and_counts(study: ModuleType) -> None:
    """Real figures from the law of the simulated ones lie outside 10 % of the time; shifted ones all the time."""
    rng = np.random.default_rng(0)
    names = (*study.MEASURES, "verticality", "line")

    def draw(count: int, shift: float) -> list[dict[str, float]]:
        same = {"V": 1.2, "noise": -30.0, "over ground": 0.0}
        return [dict(zip(names, rng.normal(shift, 1.0, len(names)), strict=True)) | same for _ in range(count)]

    made = {label: draw(2000, 0.0) for label in ("human", "dog")}
    cover, medians, counts = study.compare({"human": draw(200, 0.0), "dog": draw(50, 5.0)}, made).values()
    rows = [line.strip("| ").split(" | ") for line in cover.split("\n")[2:]]
    assert 7 <= int(rows[0][3]) <= 13
    assert int(rows[1][3]) >= 95
    assert "8 of 8" in medians
    assert "0 of 8" in medians
    first, second = (float(cell.split(" (")[0]) for cell in counts.split("\n")[2].strip("| ").split(" | ")[1:])
    assert first == pytest.approx(8 * 0.683, abs=0.2)
    assert second == pytest.approx(first, abs=0.3)
