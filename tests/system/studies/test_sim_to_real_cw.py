"""The 24 GHz sensor model and the measure of its profile, where the answer is known."""

from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from doppelgait.radar import Radar
from doppelgait.radar.measured import label_measured

TORSO_MPS = 1.6


@pytest.fixture(scope="module")
def sensor() -> ModuleType:
    return import_module("sim_to_real_cw_sensor")


def lines(
    sensor: ModuleType, levels_db: dict[float, float], *, torso_mps: float = TORSO_MPS, size_v: float = 0.1,
    bursts: int = 15,
) -> Any:  # fmt: skip
    """Return a recording of steady lines at multiples of the torso's speed."""
    times_s = sensor.TIMES_S[: bursts * sensor.PULSES]
    radar = Radar.preset("infineon-24")
    hertz = 2.0 * torso_mps / radar.wavelength_m
    values = sum(
        size_v * 10.0 ** (level / 20.0) * np.exp(2j * np.pi * ratio * hertz * times_s + 1j * ratio)
        for ratio, level in levels_db.items()
    )
    noise = np.random.default_rng(1).normal(scale=1e-5, size=(2, times_s.size))
    values = values + noise[0] + 1j * noise[1]
    return label_measured(
        Path("lines"), np.asarray(values)[:, None], radar=radar, slow_time_s=times_s, range_m=np.array([5.0]),
        attrs={"burst_pulses": sensor.PULSES},
    )  # fmt: skip


def test_the_profile_is_that_of_lines_of_known_strength(study: ModuleType, sensor: ModuleType) -> None:
    found = study.measure(lines(sensor, {1.0: 0.0, 1.5: -14.0, 2.0: -21.0, 2.5: -28.0, 3.0: -33.0}))
    assert found.torso_mps == pytest.approx(TORSO_MPS, abs=0.02)
    assert found.profile_db == pytest.approx(np.tile([-14.0, -21.0, -28.0, -33.0], (sensor.BURSTS, 1)), abs=0.5)
    assert found.level_db == pytest.approx(20 * np.log10(0.1 / 0.5) + 0.23, abs=0.2)


@pytest.mark.parametrize("change", [{"torso_mps": 0.3}, {"torso_mps": 3.1}, {"size_v": 0.55}, {"size_v": 1e-6}])
def test_bursts_that_say_nothing_of_a_profile_are_left_out(
    study: ModuleType, sensor: ModuleType, change: dict[str, float]
) -> None:
    assert np.isnan(study.measure(lines(sensor, {1.0: 0.0}, **change)).profile_db).all()


def test_a_recording_counts_once_however_long_it_is(study: ModuleType, sensor: ModuleType) -> None:
    weak, strong = (
        lines(sensor, {1.0: 0.0, **dict.fromkeys(study.RATIOS, level)}, bursts=bursts)
        for level, bursts in ((-30.0, 5), (-10.0, 15))
    )
    fast = [study.Seen(one, "walk", "x") for one in (weak, strong)]
    assert study.profile_db(fast) == pytest.approx([-20.0] * 4, abs=0.5)


def test_a_simulation_is_fixed_by_its_number_and_has_the_stated_noise(study: ModuleType, sensor: ModuleType) -> None:
    plan = sensor.Plan(motion="models")
    (one, kind, _), (again, _, _), (other, _, _) = (sensor.recording_of(plan, number) for number in (1, 1, 5))
    assert kind == "walk"
    assert np.array_equal(one.samples.matrix, again.samples.matrix)
    assert not np.array_equal(one.samples.matrix, other.samples.matrix)
    found = study.measure(one)
    edge_db = [level for hertz, level in sensor.NOISE_DB if hertz >= 1300.0]
    assert np.median(found.noise_db[~found.clipped]) == pytest.approx(np.mean(edge_db), abs=1.5)
    first = round(sensor.LEVEL_AT_S / sensor.PERIOD_S)
    assert found.level_db[first] == pytest.approx(sensor.LEVEL_DB, abs=4 * sensor.LEVEL_SD_DB)
