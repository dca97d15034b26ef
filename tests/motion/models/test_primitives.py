import numpy as np
import pytest

from doppelgait.motion.models import breathing_person, curtain, fan, moving_point, pendulum, robot_vacuum, rotor
from doppelgait.motion.models.human_body import LENGTHS, POINTS
from doppelgait.motion.models.primitives import CRAWL, crawling_person

INDEX = {name: n for n, name in enumerate(POINTS)}


def velocity(motion):
    return np.gradient(motion.position_m, motion.time_s, axis=0)[2:-2]


def test_a_vacuum_goes_straight_or_in_a_circle():
    straight = robot_vacuum(speed_mps=0.3, duration_s=4)
    np.testing.assert_allclose(straight.positions.sel(marker="centre", space="x"), 0.3 * straight.time_s, atol=1e-12)
    assert straight.markers == ["centre", *[f"rim_{k}" for k in range(1, 9)]]
    turning = robot_vacuum(speed_mps=0.3, turn_deg_per_s=45, duration_s=8)
    radius_m, angle = 0.3 / np.radians(45), np.radians(45) * turning.time_s
    centre = turning.position_m[:, 0, :2]
    expected = radius_m * np.stack([np.sin(angle), 1 - np.cos(angle)], axis=-1)  # to the left
    np.testing.assert_allclose(centre, expected, atol=1e-12)
    rim = turning.position_m[:, 1:9, :2] - centre[:, None]
    np.testing.assert_allclose(np.hypot(rim[..., 0], rim[..., 1]), 0.17, atol=1e-12)


def test_brush_tips_have_their_speed():
    motion = robot_vacuum(speed_mps=0, turn_deg_per_s=0, brush_hz=5, brush_radius_m=0.08, rate_hz=4000)
    tips = velocity(motion)[:, 9:]
    np.testing.assert_allclose(np.linalg.norm(tips, axis=2), 2 * np.pi * 5 * 0.08, rtol=1e-4)
    assert motion.facts.gait_frequency_hz == 15
    # On the move the fastest is the sum of the two.
    moving = robot_vacuum(speed_mps=0.3, brush_hz=5, brush_radius_m=0.08, rate_hz=4000)
    assert np.linalg.norm(velocity(moving)[:, 9:], axis=2).max() == pytest.approx(0.3 + 2 * np.pi * 0.4, rel=1e-4)


def test_a_curtain_sways_from_its_rail_with_a_lag_across():
    motion = curtain(sway_hz=0.5, amplitude_m=0.06, phase_deg=180, columns=3, rows=4, duration_s=8, rate_hz=100)
    assert motion.positions.shape[1] == 12
    x = motion.positions.sel(space="x").values.reshape(-1, 3, 4)
    for row in range(4):
        assert np.ptp(x[:, 1, row]) / 2 == pytest.approx(0.06 * (row + 1) / 4, rel=1e-3)
    np.testing.assert_allclose(x[:, 0, 3], -x[:, 2, 3], atol=1e-12, err_msg="the sides are 180 degrees apart")
    np.testing.assert_allclose(x[200:, 0], x[:-200, 0], atol=1e-12, err_msg="period 2 s")
    assert np.ptp(motion.positions.sel(space=["y", "z"]).values, axis=0).max() == 0
    assert np.abs(velocity(motion)[:, :, 0]).max() == pytest.approx(2 * np.pi * 0.5 * 0.06, rel=1e-3)
    assert motion.facts.gait_frequency_hz == 0.5
    assert motion.positions.sel(space="z").values.min() == pytest.approx(0.2)


@pytest.mark.parametrize("blades", [3, 4, 5])
def test_a_fan_turns_at_its_tip_speed_on_a_stand(blades):
    motion = fan(radius_m=0.2, rotation_hz=12, blades=blades, rate_hz=20_000, duration_s=0.5)
    moving = velocity(motion)
    tips = [n for n, name in enumerate(motion.markers) if str(name).startswith("blade")]
    assert len(tips) == blades
    np.testing.assert_allclose(np.linalg.norm(moving[:, tips], axis=2), 2 * np.pi * 12 * 0.2, rtol=1e-4)
    still = [n for n in range(motion.positions.shape[1]) if n not in tips]
    assert np.ptp(motion.position_m[:, still], axis=0).max() == 0
    assert np.ptp(motion.position_m[..., 0]) == 0, "the plane is across x"
    assert motion.facts.gait_frequency_hz == 12 * blades


def test_a_crawler_keeps_its_segments_and_its_limbs_stand_still():
    motion = crawling_person(speed_mps=0.4, duration_s=6, rate_hz=1000, pace_sd=0.08, rng=np.random.default_rng(1))
    sizes = {"thigh": ("hip", "knee"), "shank": ("knee", "ankle"), "foot": ("ankle", "toe")}
    sizes |= {"upper_arm": ("shoulder", "elbow"), "forearm": ("elbow", "hand")}
    for bone, (a, b) in sizes.items():
        for side in ("left", "right"):
            line = motion.position_m[:, INDEX[f"{side}_{a}"]] - motion.position_m[:, INDEX[f"{side}_{b}"]]
            np.testing.assert_allclose(np.linalg.norm(line, axis=1), 1.75 * LENGTHS[bone], atol=1e-12)
    assert motion.positions.sel(space="z").values.min() > -1e-12
    stride_s = 0.85 / motion.facts.stride_frequency_hz  # of a stride faster than the mean
    for limb, landings in motion.facts.footfalls.items():
        path = motion.position_m[:, INDEX[limb]]
        for landed in [t for t in landings if t + CRAWL.duty * stride_s < 6]:
            still = (motion.time_s >= landed) & (motion.time_s <= landed + CRAWL.duty * stride_s)
            assert np.ptp(path[still, :2], axis=0).max() < 1e-9, limb
            assert path[still, 2].max() < 0.03 * 1.75, limb


@pytest.mark.parametrize("speed_mps", [0.2, 0.4, 0.6])
def test_a_crawler_goes_at_its_speed_low_and_with_diagonal_limbs(speed_mps):
    motion = crawling_person(speed_mps=speed_mps, duration_s=6)
    base = motion.positions.sel(marker="base", space="x").values
    assert (base[-1] - base[0]) / float(motion.time_s[-1]) == pytest.approx(speed_mps, rel=1e-9)
    assert motion.positions.sel(space="z").values.max() < 0.5 * 1.75
    falls = motion.facts.footfalls
    assert falls["right_hand"] == falls["left_knee"]
    gap = (falls["left_hand"][0] - falls["right_hand"][0]) * motion.facts.stride_frequency_hz
    assert gap == pytest.approx(0.5, abs=1e-9)
    steps = [
        np.abs(np.diff(crawling_person(duration_s=2, rate_hz=r).position_m, n=2, axis=0)).max() * r for r in (500, 4000)
    ]
    assert steps[1] < 0.2 * steps[0], "velocity has no jumps"


def test_a_point_moves_at_constant_velocity():
    motion = moving_point(speed_mps=1.5, height_m=0.7, duration_s=2, rate_hz=100)
    assert motion.positions.shape == (201, 1, 3)
    np.testing.assert_allclose(motion.position_m[:, 0, 0], 1.5 * motion.time_s, atol=1e-12)
    assert np.ptp(motion.position_m[:, 0, 1:], axis=0) == pytest.approx([0, 0])
    assert tuple(motion.position_m[0, 0]) == (0, 0, 0.7)
    assert np.isnan(motion.facts.gait_frequency_hz)
    assert np.ptp(moving_point(speed_mps=0).position_m) == 1.0, "at rest: x = y = 0 and z = 1"


def test_a_pendulum_swings_about_its_pivot_with_a_known_speed():
    motion = pendulum(length_m=0.5, amplitude_deg=40, frequency_hz=2, pivot_height_m=0.9, rate_hz=1000, duration_s=3)
    angle = np.radians(40) * np.sin(2 * np.pi * 2 * motion.time_s)
    expected = np.stack([0.5 * np.sin(angle), 0 * angle, 0.9 - 0.5 * np.cos(angle)], axis=-1)
    np.testing.assert_allclose(motion.position_m[:, 0], expected, atol=1e-12)
    assert motion.facts.gait_frequency_hz == 2


@pytest.mark.parametrize("plane", ["xy", "xz", "yz"])
def test_a_rotor_turns_its_blades_in_its_plane(plane):
    motion = rotor(radius_m=0.2, rotation_hz=3, blades=4, plane=plane, hub_height_m=0.8, rate_hz=1200, duration_s=1)
    assert motion.markers == ["hub", "blade_1", "blade_2", "blade_3", "blade_4"]
    np.testing.assert_allclose(motion.position_m[:, 0], np.tile([0, 0, 0.8], (1201, 1)), atol=1e-12)
    arms = motion.position_m[:, 1:] - motion.position_m[:, :1]
    angle = 2 * np.pi * 3 * motion.time_s[:, None] + np.arange(4) * np.pi / 2
    expected = np.zeros((1201, 4, 3))
    expected[..., ["xyz".index(axis) for axis in plane]] = 0.2 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    np.testing.assert_allclose(arms, expected, atol=1e-12)
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
