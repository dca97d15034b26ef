import numpy as np
import pytest

from doppelgait.motion.models import breathing_person, moving_point, pendulum, rotor


def test_a_point_moves_at_constant_velocity():
    motion = moving_point(speed_mps=1.5, height_m=0.7, duration_s=2, rate_hz=100)
    assert motion.positions.shape == (201, 1, 3)
    np.testing.assert_allclose(motion.position_m[:, 0, 0], 1.5 * motion.time_s, atol=1e-12)
    assert np.ptp(motion.position_m[:, 0, 1:], axis=0) == pytest.approx([0, 0])
    assert tuple(motion.position_m[0, 0]) == (0, 0, 0.7)
    assert np.isnan(motion.facts.gait_frequency_hz)
    assert np.ptp(moving_point(speed_mps=0).position_m) == 1.0, "at rest: x = y = 0 and z = 1"


def test_the_last_frame_is_at_or_just_after_the_duration():
    for duration_s in (0.004, 1.0, 1.001, 5.0):
        time_s = moving_point(duration_s=duration_s).time_s
        assert duration_s - 1e-9 <= time_s[-1] < duration_s + 1 / 250


def test_a_pendulum_swings_about_its_pivot_with_a_known_speed():
    motion = pendulum(length_m=0.5, amplitude_deg=40, frequency_hz=2, pivot_height_m=0.9, rate_hz=5000, duration_s=3)
    x, y, z = motion.position_m[:, 0].T
    np.testing.assert_allclose(np.hypot(x, z - 0.9), 0.5, atol=1e-12)
    assert np.abs(y).max() == 0
    assert x.max() == pytest.approx(0.5 * np.sin(np.radians(40)), rel=1e-5)
    # Exact maximum of l cos(a sin) a w cos: at the lowest point.
    peak_mps = 0.5 * np.radians(40) * 2 * np.pi * 2
    assert np.diff(x).max() * 5000 == pytest.approx(peak_mps, rel=1e-4)
    assert np.diff(x)[0] > 0
    crossings = motion.time_s[1:][(x[:-1] < 0) & (x[1:] >= 0)]
    np.testing.assert_allclose(np.diff(crossings), 0.5, atol=3e-4)
    assert motion.facts.gait_frequency_hz == 2


@pytest.mark.parametrize("plane", ["xy", "xz", "yz"])
def test_a_rotor_turns_its_blades_in_its_plane(plane):
    motion = rotor(radius_m=0.2, rotation_hz=3, blades=4, plane=plane, hub_height_m=0.8, rate_hz=1200, duration_s=1)
    assert motion.markers == ["hub", "blade_1", "blade_2", "blade_3", "blade_4"]
    arms = motion.position_m[:, 1:] - motion.position_m[:, :1]
    np.testing.assert_allclose(np.linalg.norm(arms, axis=2), 0.2, atol=1e-12)
    across = next(axis for axis in range(3) if "xyz"[axis] not in plane)
    assert np.abs(arms[:, :, across]).max() == 0
    assert np.ptp(motion.positions.sel(marker="hub").values, axis=0) == pytest.approx([0, 0, 0])
    np.testing.assert_allclose(motion.position_m[100], motion.position_m[500], atol=1e-12)
    assert np.abs(motion.position_m[100] - motion.position_m[300]).max() > 0.1
    # A quarter turn takes the first blade to where the second began.
    np.testing.assert_allclose(motion.position_m[100, 1], motion.position_m[0, 2], atol=1e-12)
    assert motion.facts.gait_frequency_hz == 12


def test_a_breathing_person_moves_the_chest_alone():
    motion = breathing_person(duration_s=8, amplitude_m=0.005)
    travel = np.ptp(motion.position_m, axis=0)
    moving = dict(zip(motion.positions.marker.values, travel[:, 0], strict=True))
    assert moving["left_chest"] == moving["right_chest"] == pytest.approx(0.01, rel=1e-4)
    assert moving["abdomen"] == pytest.approx(0.005, rel=1e-4)
    assert moving["head"] == moving["neck"] == moving["pelvis"] == 0
    assert travel[:, 1:].max() == 0
    chest = motion.positions.sel(marker="left_chest", space="x").values
    assert np.argmax(np.abs(np.fft.rfft(chest[:-1] - chest[:-1].mean()))) == 2, "0.25 Hz in 8 s"
    assert chest[125] > chest[0], "breathes in first, towards +x"
    assert (motion.facts.species, motion.facts.gait_frequency_hz) == ("human", 0.25)
