"""Hybrids of shared recordings: of one skeleton, of real markers and of a dog."""

import warnings
from pathlib import Path

import numpy as np
import pytest

from doppelgait.core.errors import DoppelgaitWarning, MotionError
from doppelgait.motion import Motion, blend, loop, retarget
from doppelgait.motion.hybrid import find_speed_limits, measure_foot_slide
from doppelgait.motion.retime import travel_speed_mps
from recorded import read_quietly

pytestmark = pytest.mark.shared


def _read(shared: Path, file: str) -> Motion:
    return read_quietly(shared / "data" / "mocap" / file, segment="longest")


PAIRS = [
    ("clinic/SubjectB4_Cycle1.bvh", "clinic/SubjectC9_Cycle1.bvh"),
    ("human/amc/cmu_07_01.amc", "human/amc/cmu_02_02.amc"),
    ("human/c3d/cmu_07_01.c3d", "human/c3d/cmu_07_12.c3d"),
    ("dog/mann-bvh/D1_053_KAN01_001.bvh", "dog/mann-bvh/D1_ex01_KAN01_001.bvh"),
]


@pytest.mark.parametrize(("first", "second"), PAIRS)
def test_two_recordings_make_a_target_between_them(shared: Path, first: str, second: str) -> None:
    clips = [_read(shared, file) for file in (first, second)]
    speeds = [travel_speed_mps(clip) for clip in clips]
    mixed = blend(*clips, share=0.5)
    facts = mixed.report["hybrid"]
    assert facts["length_error_m"] < 2e-3
    assert measure_foot_slide(mixed) < max(map(measure_foot_slide, clips)) + 0.01
    assert 0.95 * min(speeds) < travel_speed_mps(mixed) < 1.1 * max(speeds)
    assert mixed.facts.source == " + ".join(clip.facts.source for clip in clips)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DoppelgaitWarning)
        looped = loop(mixed, duration_s=6.0)
    assert measure_foot_slide(looped) < max(map(measure_foot_slide, clips)) + 0.03


@pytest.mark.parametrize("file", [first for first, _ in PAIRS])
def test_a_recording_goes_faster_without_sliding(shared: Path, file: str) -> None:
    clip = _read(shared, file)
    wanted = min(1.1, find_speed_limits(clip)[1])
    made = retarget(clip, speed_factor=wanted, size_factor=1.05)
    assert travel_speed_mps(made) == pytest.approx(travel_speed_mps(clip) * wanted * np.sqrt(1.05), rel=5e-3)
    assert measure_foot_slide(made) < measure_foot_slide(clip) + 0.01


def test_recordings_with_other_markers_are_not_blended(shared: Path) -> None:
    clips = [_read(shared, file) for file in ("human/c3d/cmu_07_01.c3d", "clinic/SubjectB4_Cycle1.bvh")]
    with pytest.raises(MotionError, match=r"they share \d+ of 41 and \d+ points.*same markers or joints"):
        blend(*clips, share=0.5)
