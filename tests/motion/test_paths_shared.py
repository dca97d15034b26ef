"""Recorded walks of the shared test data laid on paths."""

import pytest

from doppelgait.core.errors import MotionError
from doppelgait.motion.follow import follow
from doppelgait.motion.paths import StopAndGoPath, StraightPath
from doppelgait.motion.readers import read

pytestmark = pytest.mark.shared


def test_a_recording_whose_steps_are_not_known_cannot_stop(shared):
    motion = read(shared / "data" / "mocap" / "human" / "c3d" / "cmu_07_01.c3d")
    motion = motion.with_facts(step_frequency_hz=float("nan"), stride_frequency_hz=float("nan"))
    with pytest.raises(MotionError, match="cannot stop: it needs points on the feet, and a gait of known step"):
        follow(motion, StopAndGoPath(stops=[{"at_m": 2.0, "pause_s": 1.0}]))


def test_a_recording_that_turns_is_not_laid_on_a_path(shared):
    motion = read(shared / "data" / "mocap" / "human" / "c3d" / "cmu_82_08.c3d")
    with pytest.raises(MotionError, match=r"cmu_82_08\.c3d: its body is up to .* from straight and even travel"):
        follow(motion, StraightPath())
