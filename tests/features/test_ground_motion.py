"""Ground speed and aspect from the range history (E-34b), and the flags that follow."""

import numpy as np
import pytest

from doppelgait.core.rng import rng
from doppelgait.features import estimate_ground_motion
from doppelgait.motion import boulic_walk, quadruped_gait
from doppelgait.pipeline import analyze, simulate
from doppelgait.radar import Radar
from doppelgait.scene import Scene, Target

TIMES_S = np.arange(0, 5, 0.01)


def straight_track(speed_mps, aspect_deg, range_m=6.0, height_m=0.3):
    """Ranges of straight motion that has this aspect at mid-observation, seen from above by ``height_m``."""
    angle = np.radians(aspect_deg)
    t = TIMES_S - TIMES_S.mean()
    x, y = range_m - speed_mps * np.cos(angle) * t, speed_mps * np.sin(angle) * t
    return np.sqrt(x**2 + y**2 + height_m**2)


@pytest.mark.parametrize("aspect_deg", [0, 5, 30, 60, 90, 120, 175])
@pytest.mark.parametrize("speed_mps", [1.0, 1.6])
def test_straight_motion_is_recovered_within_its_uncertainty(speed_mps, aspect_deg):
    found = estimate_ground_motion(TIMES_S, straight_track(speed_mps, aspect_deg))
    assert found.ground_speed_mps == pytest.approx(speed_mps, abs=found.ground_speed_sd_mps)
    assert found.ground_speed_mps == pytest.approx(speed_mps, rel=0.03)
    # no speed across is less than none: near the line of sight the mean lies beside it
    assert found.aspect_deg == pytest.approx(aspect_deg, abs=1.6 * found.aspect_sd_deg)
    if 30 <= aspect_deg <= 120:
        assert found.aspect_deg == pytest.approx(aspect_deg, abs=4)


LEVELS = ([0.01, 0.01], [0.04, 0.06], [0.12, 0.06], [0.12, 0.3], [0.12, 0.9])
SHARES = (0.23, 0.44, 0.12, 0.06, 0.15)


def wander(source, times, levels):
    """Paths along the range of velocities with these levels and correlation times of 0.7 and 2.5 s."""
    fine = np.linspace(times[0], times[-1], 90)
    path = np.zeros(times.size)
    for level, memory_s in zip(levels, (0.7, 2.5), strict=True):
        like = np.exp(-0.5 * ((fine[:, None] - fine) / memory_s) ** 2) + 1e-9 * np.eye(fine.size)
        velocity = level * np.linalg.cholesky(like) @ source.standard_normal(fine.size)
        path += np.interp(times, fine, np.cumsum(velocity) * (fine[1] - fine[0]))
    return path


@pytest.mark.parametrize("duration_s", [2.0, 5.0])
def test_coverage_on_paths_that_wander_as_the_model_says(duration_s):
    """Brute force: 400 bodies of any direction, with range errors that last for half a second."""
    within = []
    times = np.arange(0, duration_s, 0.1)
    for seed in range(400):
        source = np.random.default_rng(seed)
        speed, range_m, angle = 1.1 * np.exp(source.normal(0, 0.6)), source.uniform(3.0, 7.0), source.uniform(0, np.pi)
        t = times - times.mean()
        clean = np.hypot(range_m - speed * np.cos(angle) * t, speed * np.sin(angle) * t)
        clean += wander(source, times, LEVELS[source.choice(5, p=SHARES)])
        if clean.min() < 0.3:
            continue
        errors_m = lasting_errors(source, times.size, sd_m=0.02)
        found = estimate_ground_motion(times, clean + errors_m, range_sd_m=0.02)
        if found.aspect_deg is not None:
            off = abs(found.aspect_deg - np.degrees(angle)) / found.aspect_sd_deg
            within.append([off < 1, off < 2])
    assert len(within) > 25
    one, two = np.mean(within, axis=0)
    assert 0.55 < one < 0.88  # tails are heavier than those of a Gaussian
    assert two > 0.8


def lasting_errors(source, n, *, sd_m):
    """Gaussian errors of which those within half a second, 5 ranges, are alike: a moving mean of white ones."""
    white = source.normal(0, 1, n + 4)
    return sd_m * np.convolve(white, np.ones(5), "valid") / np.sqrt(5)


def test_braking_in_the_last_second_is_no_walk_past_the_radar():
    """Straight towards the radar, 1.3 m/s, and to rest in the last 0.8 s: as if it passed at 2.2 m, to a parabola."""
    times = np.arange(0, 3.5, 0.1)
    speed = 1.3 * np.clip((3.5 - times) / 0.8, 0, 1)
    range_m = 6 - np.concatenate([[0], np.cumsum(speed[1:] + speed[:-1]) * 0.05])
    found = estimate_ground_motion(times, range_m, range_sd_m=0.02)
    assert found.aspect_sd_deg > 10 or found.aspect_deg < 25
    assert "speed" in found.uncertain or found.ground_speed_mps == pytest.approx(1.16, abs=0.15)


def test_a_speed_near_the_line_of_sight_has_no_sure_aspect():
    """|v_g| is at least |v_r|: in 1.8 s at 7 m the direction is open, the speed is not."""
    times = np.arange(0, 1.8, 0.1)
    found = estimate_ground_motion(times, 8 - 1.3 * times, range_sd_m=0.02)
    assert found.ground_speed_mps == pytest.approx(1.3, rel=0.1)
    assert list(found.uncertain) == ["aspect"]
    assert found.aspect_sd_deg > 10


def test_an_uncertain_aspect_is_named():
    """At 3 s and 9 m an error of 6 cm hides every speed across below 1 m/s."""
    times = np.arange(0, 3, 0.1)
    found = estimate_ground_motion(times, 9 - 0.8 * times, range_sd_m=0.06)
    assert "aspect_deg:uncertain_by_more_than_10_degrees" in found.uncertain.values()
    assert "ground_speed_mps:uncertain_by_more_than_10_per_cent" in found.uncertain.values()
    assert (found.aspect_deg is None) == (found.aspect_sd_deg > 30.0)
    assert estimate_ground_motion(times[:11], 9 - 0.8 * times[:11], range_sd_m=0.06).aspect_deg is None


def test_outliers_hardly_count():
    track = straight_track(1.2, 60)
    track[::25] += 0.6
    found = estimate_ground_motion(TIMES_S, track)
    assert found.ground_speed_mps == pytest.approx(1.2, rel=0.03)
    assert found.aspect_deg == pytest.approx(60, abs=3)


def test_a_second_is_needed_and_a_body_that_bends_its_way_has_no_aspect():
    assert estimate_ground_motion(TIMES_S[:90], straight_track(1.2, 60)[:90]).ground_speed_sd_mps is None
    bent_wrongly = np.sqrt(36.0 - 1.0 * (TIMES_S - 2.5) ** 2)
    assert estimate_ground_motion(TIMES_S, bent_wrongly).aspect_deg is None


@pytest.mark.parametrize("motion", [boulic_walk(speed_mps=1.2), quadruped_gait(gait="trot", withers_m=0.5)])
@pytest.mark.parametrize("aspect_deg", [20.0, 75.0])
def test_a_side_view_is_flagged_and_its_ground_speed_given(motion, aspect_deg):
    scene = Scene([Target(motion, aspect_deg=aspect_deg, range_m=6.0)])
    result = analyze(simulate(scene, Radar.preset("x4-long"), rng=rng(1), snr_db=20.0), gate="truth")[0]
    sideways = [flag for flag in result.flags if flag.startswith("aspect_beyond_53_deg")]
    assert bool(sideways) == (aspect_deg == 75.0)
    if sideways:
        assert "low_confidence" in result.flags
    speed = float(np.ptp(motion.position_m[:, :, 0].mean(axis=1)) / np.ptp(motion.time_s))
    assert result.quality["ground_speed_mps"] == pytest.approx(speed, rel=0.05)
    assert result.quality["aspect_deg"] == pytest.approx(aspect_deg, abs=4)
    expected_m = result.quality["ground_speed_mps"] / result.gait_frequency_hz
    assert result.quality["ground_step_length_m"] == pytest.approx(expected_m)


def test_an_aliased_recording_leaves_a_trace():
    walk = boulic_walk(speed_mps=1.5, duration_s=3.0)
    with pytest.warns(UserWarning, match="aliasing"):
        recording = simulate(Scene([Target(walk)]), Radar.preset("x4", prf_hz=200))
    assert any(flag.startswith("doppler_band_full") for flag in analyze(recording, gate="truth")[0].flags)
