"""Ground speed and aspect from the range history (E-34b), and the flags that follow."""

import numpy as np
import pytest

from doppelgait.core.rng import rng
from doppelgait.features import estimate_ground_motion
from doppelgait.features.ground_motion import ACCELERATION_SD_MPS2
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
@pytest.mark.parametrize("speed_mps", [0.8, 1.6])
def test_straight_motion_is_recovered_within_its_uncertainty(speed_mps, aspect_deg):
    found = estimate_ground_motion(TIMES_S, straight_track(speed_mps, aspect_deg))
    assert found.ground_speed_mps == pytest.approx(speed_mps, abs=found.ground_speed_sd_mps)
    assert found.ground_speed_mps == pytest.approx(speed_mps, rel=0.03)
    # no speed across is less than none: near the line of sight the mean lies beside it
    assert found.aspect_deg == pytest.approx(aspect_deg, abs=1.6 * found.aspect_sd_deg)
    if 30 <= aspect_deg <= 120:
        assert found.aspect_deg == pytest.approx(aspect_deg, abs=4)


@pytest.mark.parametrize("aspect_deg", [0.0, 20.0, 45.0, 90.0, 135.0, 180.0])
def test_coverage_on_straight_paths_with_errors_that_last_for_half_a_second(aspect_deg):
    """Brute force: 300 noisy straight walks each; at 0 and 180 degrees speeds across are below the error."""
    within = []
    times = np.arange(0, 4.5, 0.1)
    for seed in range(300):
        source = np.random.default_rng(seed)
        speed, range_m = source.uniform(0.6, 1.8), source.uniform(3.0, 7.0)
        angle, t = np.radians(aspect_deg), times - times.mean()
        # a part of the speed that wanders as the constants assume
        along = speed * np.cos(angle) * t + 0.5 * source.normal(0, ACCELERATION_SD_MPS2) * t**2
        clean = np.hypot(range_m - along, speed * np.sin(angle) * t)
        found = estimate_ground_motion(times, clean + lasting_errors(source, times.size, sd_m=0.02), range_sd_m=0.02)
        if found.reason in ("", "too_uncertain") and found.ground_speed_mps is not None:
            off = (
                (found.ground_speed_mps - speed) / found.ground_speed_sd_mps,
                (found.aspect_deg - aspect_deg) / found.aspect_sd_deg,
            )
            within.append([abs(one) < k for one in off for k in (1, 2)])
    assert len(within) > 150
    speed_1, speed_2, aspect_1, aspect_2 = np.mean(within, axis=0)
    assert speed_1 > 0.55
    assert speed_2 > 0.9
    assert aspect_2 > 0.9
    if 20 <= aspect_deg <= 135:
        assert aspect_1 > 0.55
        assert speed_1 < 0.93


def lasting_errors(source, n, *, sd_m):
    """Gaussian errors of which those within half a second, 5 ranges, are alike: a moving mean of white ones."""
    white = source.normal(0, 1, n + 4)
    return sd_m * np.convolve(white, np.ones(5), "valid") / np.sqrt(5)


OTHER_PATHS = {
    "stop": lambda t: 8 - 1.2 * np.minimum(t, 2.2),
    "sudden start": lambda t: 4 + 1.2 * np.maximum(t - 2.0, 0),
    "turn": lambda t: 4 + 1.2 * np.abs(t - 2.5),
    "turn, smooth": lambda t: 4 + 1.2 * np.sqrt((t - 2.5) ** 2 + 0.1),
    "turn away from the radar's side": lambda t: 7 - 1.2 * np.abs(t - 2.5),
    "circle beside the radar": lambda t: 5 + 1.5 * np.sin(1.3 / 1.5 * t + 0.5),
    "corner": lambda t: np.where(t < 2.5, 7.5 - 1.4 * t, np.hypot(4.0, 1.4 * (t - 2.5))),
}


@pytest.mark.parametrize("name", OTHER_PATHS)
def test_power_other_paths_have_no_aspect(name):
    """Five seconds, ranges as good as a tracker's: 2 cm, alike within half a second."""
    times = np.arange(0, 5, 0.1)
    named = 0
    for seed in range(40):
        errors_m = lasting_errors(np.random.default_rng(seed), times.size, sd_m=0.02)
        found = estimate_ground_motion(times, OTHER_PATHS[name](times) + errors_m, range_sd_m=0.02)
        named += found.reason == "path_is_not_straight"
        assert (found.ground_speed_mps is None) == bool(found.reason)
    assert named >= 38


def test_false_rejection_of_straight_paths_is_rare():
    times, rejected = np.arange(0, 5, 0.1), 0
    for seed in range(400):
        source = np.random.default_rng(seed)
        angle, t = source.uniform(0, np.pi), times - 2.5
        clean = np.hypot(5 - 1.2 * np.cos(angle) * t, 1.2 * np.sin(angle) * t)
        errors_m = lasting_errors(source, times.size, sd_m=0.02)
        rejected += estimate_ground_motion(times, clean + errors_m, range_sd_m=0.02).reason == "path_is_not_straight"
    assert rejected <= 4


def test_an_uncertain_aspect_is_not_told():
    """At 3 s and 9 m an error of 6 cm hides every speed across below 1 m/s."""
    times = np.arange(0, 3, 0.1)
    found = estimate_ground_motion(times, 9 - 0.8 * times, range_sd_m=0.06)
    assert (found.ground_speed_mps, found.aspect_deg, found.reason) == (None, None, "too_uncertain")
    assert found.ground_speed_sd_mps > 0.1 * 0.8
    assert estimate_ground_motion(times, 9 - 0.8 * times, range_sd_m=0.01).reason == ""


def test_outliers_hardly_count():
    track = straight_track(1.2, 60)
    track[::25] += 0.6
    found = estimate_ground_motion(TIMES_S, track)
    assert found.ground_speed_mps == pytest.approx(1.2, rel=0.03)
    assert found.aspect_deg == pytest.approx(60, abs=3)


def test_three_seconds_are_needed_and_a_standing_body_has_no_aspect():
    assert estimate_ground_motion(TIMES_S[:200], straight_track(1.2, 60)[:200]).ground_speed_mps is None
    bent_wrongly = np.sqrt(36.0 - 1.0 * (TIMES_S - 2.5) ** 2)
    assert estimate_ground_motion(TIMES_S, bent_wrongly).reason == "path_is_not_straight"


@pytest.mark.parametrize("gate", ["truth", "track"])
def test_a_recording_of_three_seconds_is_long_enough(gate):
    scene = Scene([Target(boulic_walk(speed_mps=1.2, duration_s=3.0), aspect_deg=75.0)], duration_s=3.0)
    (result,) = analyze(simulate(scene, Radar.preset("x4"), rng=rng(1), snr_db=20.0), gate=gate)
    assert result.quality["ground_speed_mps"] == pytest.approx(1.2, rel=0.15)
    assert "low_confidence" in result.flags
    short = Scene([Target(boulic_walk(speed_mps=1.2, duration_s=2.5), aspect_deg=75.0)], duration_s=2.5)
    (result,) = analyze(simulate(short, Radar.preset("x4"), rng=rng(1), snr_db=20.0), gate=gate)
    assert result.quality["ground_speed_mps"] is None


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
