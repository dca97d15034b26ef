"""The 24 GHz sensor model and the measure of its profile, where the answer is known."""

from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad

from doppelgait.motion import make_motion
from doppelgait.motion.models import human_gait
from doppelgait.radar import Radar
from doppelgait.radar.measured import label_measured
from doppelgait.scene.rcs import RcsSpec
from doppelgait.scene.scatterers import View

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


def test_points_lie_on_ellipsoids_by_area(sensor: ModuleType) -> None:
    """A ball and a spheroid of revolution: shares of points against integrals of the surface."""
    axes = np.array([[0.2, 0.2, 0.2], [0.1, 0.1, 0.5]])
    unit, segment = sensor.area_points(axes, 20_000, np.random.default_rng(3))

    def ring(z_m: float) -> float:
        return 2 * np.pi * 0.1 * np.sqrt(1 - (z_m / 0.5) ** 2 + (0.1 * z_m / 0.25) ** 2)

    area = quad(ring, -0.5, 0.5)[0]
    assert (segment == 1).mean() == pytest.approx(area / (area + 4 * np.pi * 0.2**2), abs=0.02)
    middle = np.abs(unit[segment == 1, 2] * 0.5) < 0.2
    assert middle.mean() == pytest.approx(quad(ring, -0.2, 0.2)[0] / area, abs=0.02)
    assert np.abs(unit[segment == 0].mean(axis=0)).max() < 0.03


def test_skin_keeps_its_shape_and_faces_the_radar(sensor: ModuleType) -> None:
    motion = human_gait(speed_mps=1.2, duration_s=2.0, rate_hz=150.0)
    times_s = np.linspace(0.0, 1.5, 200)
    ahead, behind = (
        sensor.scatter_surface(View(motion, times_s, np.array([x_m, 0.0, 1.0])), RcsSpec(total_m2=0.7))
        for x_m in (30.0, -30.0)
    )
    points, rcs_m2 = ahead
    assert rcs_m2.sum(axis=1) == pytest.approx(0.7, rel=0.15)
    assert rcs_m2.min() >= 0.0
    # convex skin is seen from one of two opposite sides
    assert ((rcs_m2 > 1e-3) & (behind[1] > 1e-3)).mean() < 0.01
    # what is seen lies before the middle of each part, on the radar's side
    offset_m = points.position_m[0, :, 0] - np.median(points.position_m[0, :, 0])
    assert np.average(offset_m, weights=rcs_m2[0]) > np.average(offset_m, weights=behind[1][0]) + 0.05
    shank = [n for n, part in enumerate(points.parts) if part == "left_shank"]
    place_m = points.position_m[:, shank]
    apart_m = np.linalg.norm(place_m[:, :, None] - place_m[:, None], axis=-1)
    assert np.ptp(apart_m, axis=0).max() < 1e-6
    ankle_m = motion.position_m[:, motion.markers.index("left_ankle")]
    to_ankle_m = np.linalg.norm(place_m - ankle_m[:, None], axis=-1)
    assert np.ptp(to_ankle_m, axis=0).max() < 0.01


def test_joints_are_found_by_the_names_of_a_skeleton(sensor: ModuleType) -> None:
    names = sorted(
        {
            name.format(s=side[0].lower(), S=side[0], Side=side)
            for name in sensor.JOINTS[1].values()
            for side in ("Left", "Right")
        }
    )
    place_m = np.tile(np.arange(len(names), dtype=float)[None, :, None], (10, 1, 3))
    motion = make_motion(place_m, rate_hz=100.0, markers=names, parts=[""] * len(names), facts={"height_m": 1.7})
    found = sensor.joints_of(motion)
    joint_m = dict(zip(found.markers, found.position_m[0, :, 0].tolist(), strict=True))
    assert names[int(joint_m["left_hip"])] == "UpperLeg_L"
    assert names[int(joint_m["right_hand"])] == "Hand_R"
    assert names[int(joint_m["base"])] == "Hips"
    assert sensor.joints_of(motion.with_points(place_m[:, 1:], names[1:], [""] * (len(names) - 1))) is None


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
