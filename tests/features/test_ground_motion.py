"""Ground speed and aspect from the range history (E-34b), and the flags that follow."""

from __future__ import annotations

import numpy as np
import pytest

from doppelgait.core.rng import rng
from doppelgait.features import ground_motion
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


@pytest.mark.parametrize("aspect_deg", [5, 30, 60, 90, 120, 175])
@pytest.mark.parametrize("speed_mps", [0.8, 1.6])
def test_straight_motion_is_recovered(speed_mps, aspect_deg):
    found = ground_motion(TIMES_S, straight_track(speed_mps, aspect_deg))
    assert found.ground_speed_mps == pytest.approx(speed_mps, rel=2e-3)
    assert found.aspect_deg == pytest.approx(aspect_deg, abs=1.0)


def test_outliers_hardly_count():
    track = straight_track(1.2, 60)
    track[::25] += 0.6
    found = ground_motion(TIMES_S, track)
    assert found.ground_speed_mps == pytest.approx(1.2, rel=0.03)
    assert found.aspect_deg == pytest.approx(60, abs=3)


def test_three_seconds_are_needed_and_a_standing_body_has_no_aspect():
    assert ground_motion(TIMES_S[:200], straight_track(1.2, 60)[:200]).ground_speed_mps is None
    bent_wrongly = np.sqrt(36.0 - 0.1 * (TIMES_S - 2.5) ** 2)
    assert ground_motion(TIMES_S, bent_wrongly).aspect_deg is None


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


def test_two_targets_that_pass_each_other_are_flagged():
    walk = boulic_walk(speed_mps=1.2, duration_s=3.0)
    apart = Scene([Target(walk, range_m=3.5), Target(walk, range_m=8.0)])
    meeting = Scene([Target(walk, range_m=5.0), Target(walk, range_m=5.0, aspect_deg=180.0)])
    for scene, flagged in ((apart, False), (meeting, True)):
        results = analyze(simulate(scene, Radar.preset("x4-long")), gate="truth")
        assert all(("gates_overlap" in r.flags) == flagged for r in results)


def test_an_aliased_recording_leaves_a_trace():
    walk = boulic_walk(speed_mps=1.5, duration_s=3.0)
    with pytest.warns(UserWarning, match="aliasing"):
        recording = simulate(Scene([Target(walk)]), Radar.preset("x4", prf_hz=200))
    assert any(flag.startswith("doppler_band_full") for flag in analyze(recording, gate="truth")[0].flags)
