"""Recorded walks of the shared test data laid on paths."""

import numpy as np
import pytest

from doppelgait.core.errors import MotionError
from doppelgait.motion.follow import follow, steady_speed_mps
from doppelgait.motion.paths import ArcPath, StopAndGoPath, StraightPath
from doppelgait.motion.readers import read
from doppelgait.motion.retime import body_centre_m

pytestmark = pytest.mark.shared


@pytest.mark.parametrize(
    ("name", "speed_mps"), [("cmu_02_01", 1.17), ("cmu_07_01", 1.37), ("ezc3d_qualisys_walk", 1.46)]
)
def test_a_recorded_walk_goes_round_a_circle(shared, name, speed_mps):
    motion = read(shared / "data" / "mocap" / "human" / "c3d" / f"{name}.c3d")
    assert steady_speed_mps(motion) == pytest.approx(speed_mps, rel=0.03)
    straight = follow(motion, StraightPath())
    np.testing.assert_allclose(
        np.diff(straight.position_m, axis=0)[..., 2], np.diff(motion.position_m, axis=0)[..., 2], atol=1e-9
    )
    moved = np.linalg.norm(np.diff(straight.position_m, axis=0), axis=-1)
    np.testing.assert_allclose(moved, np.linalg.norm(np.diff(motion.position_m, axis=0), axis=-1), atol=1e-9)
    round_the_circle = follow(motion, ArcPath(radius_m=2.0, turn_deg=40))
    frames = round_the_circle.n_frames
    t = np.arange(frames) / motion.rate_hz
    body = body_centre_m(straight)[:frames]
    predicted = np.hypot(2.0 - body[:, 1], body[:, 0] - steady_speed_mps(motion) * t)
    centre = body_centre_m(round_the_circle)[:, :2] - [0, 2.0]
    np.testing.assert_allclose(np.hypot(*centre.T), predicted, atol=1e-6)


def test_a_recording_whose_steps_are_not_known_cannot_stop(shared):
    motion = read(shared / "data" / "mocap" / "human" / "c3d" / "cmu_07_01.c3d")
    motion = motion.with_facts(step_frequency_hz=float("nan"), stride_frequency_hz=float("nan"))
    with pytest.raises(MotionError, match="cannot stop: it needs points on the feet, and a gait of known step"):
        follow(motion, StopAndGoPath(stops=[{"at_m": 2.0, "pause_s": 1.0}]))


def test_a_recording_that_turns_is_not_laid_on_a_path(shared):
    motion = read(shared / "data" / "mocap" / "human" / "c3d" / "cmu_82_08.c3d")
    with pytest.raises(MotionError, match=r"cmu_82_08\.c3d: its body is up to .* from straight and even travel"):
        follow(motion, StraightPath())
