"""Treadmill recordings: belt speed and the motion over ground."""

import numpy as np
import pytest

from doppelgait.core.errors import MotionError
from doppelgait.motion.clean import clean_motion
from doppelgait.motion.models import human_gait
from doppelgait.motion.motion import Motion
from doppelgait.motion.ground import belt_velocity_mps, move_over_ground

SPEED_MPS = 1.3


def walk() -> Motion:
    return human_gait(speed_mps=SPEED_MPS, height_m=1.8, duration_s=4.0, rate_hz=120)


def on_treadmill(motion: Motion) -> Motion:
    back = np.zeros((motion.n_frames, 1, 3))
    back[:, 0, 0] = SPEED_MPS * motion.time_s
    return motion.with_positions(motion.position_m - back)


def test_the_belt_gives_the_speed_back() -> None:
    moved = move_over_ground(clean_motion(on_treadmill(walk())))
    travel = (moved.position_m[-1] - moved.position_m[0]).mean(axis=0)
    assert travel[0] / moved.duration_s == pytest.approx(SPEED_MPS, rel=0.03)
    assert moved.report["belt_speed_mps"] == pytest.approx(SPEED_MPS, rel=0.03)


def test_a_treadmill_is_noted_and_a_walk_over_ground_is_not() -> None:
    notes = clean_motion(on_treadmill(walk())).report["notes"]
    assert sum("treadmill" in note for note in notes) == 1
    assert not any("treadmill" in note for note in clean_motion(walk()).report["notes"])


def test_a_walk_over_ground_and_a_standing_body_have_no_belt() -> None:
    motion = walk()
    still = motion.with_positions(np.repeat(motion.position_m[:1], motion.n_frames, axis=0))
    for one in (motion, still):
        assert belt_velocity_mps(one.position_m, one.parts, rate_hz=one.rate_hz) is None
    with pytest.raises(MotionError, match="no treadmill belt"):
        move_over_ground(motion)
