"""Height of recorded bodies: measured, estimated from the legs, or unknown."""

import math
from pathlib import Path

import numpy as np
import pytest

from doppelgait.core.errors import MotionError
from doppelgait.motion import Motion
from doppelgait.motion.clean import clean_motion
from doppelgait.motion.describe import describe_recording
from doppelgait.motion.models import human_gait, quadruped_gait
from doppelgait.motion.readers import read
from doppelgait.motion.retime import scale_to_height, travel_speed_mps
from doppelgait.motion.skeleton import find_parts, measure_height

LEGS = ("left_hip", "left_knee", "left_ankle", "left_toe", "right_hip", "right_knee", "right_ankle", "right_toe")


def recorded(motion: Motion, markers: tuple[str, ...] | None = None) -> Motion:
    """Return some points of a model's motion as an uncleaned recording of unknown height."""
    chosen = [i for i, name in enumerate(motion.markers) if markers is None or name in markers]
    names, parts = [motion.markers[i] for i in chosen], [motion.parts[i] for i in chosen]
    return motion.with_points(motion.position_m[:, chosen], names, parts).with_facts(height_m=math.nan)


WALK = human_gait(speed_mps=1.2, height_m=1.75, duration_s=4.0, rate_hz=120)


def test_a_pair_of_legs_keeps_its_speed_when_it_is_scaled_to_its_own_stature() -> None:
    legs = clean_motion(recorded(WALK, LEGS))
    assert legs.facts.height_m == pytest.approx(1.75, rel=0.05)
    assert any("estimated from the legs" in note for note in legs.report["notes"])
    assert travel_speed_mps(scale_to_height(legs, height_m=1.75)) == pytest.approx(1.2, rel=0.06)


def test_without_head_and_whole_legs_the_height_is_unknown_and_scaling_is_refused() -> None:
    shanks = clean_motion(recorded(WALK, LEGS[1:4] + LEGS[5:]))
    assert math.isnan(shanks.facts.height_m)
    assert any("height is unknown" in note for note in shanks.report["notes"])
    with pytest.raises(MotionError, match=r"height is unknown \(no head.*leave out height_m"):
        scale_to_height(shanks, height_m=1.75)


def test_a_head_is_measured_and_not_noted() -> None:
    whole = clean_motion(recorded(WALK))
    assert whole.facts.height_m == pytest.approx(np.median(WALK.position_m[:, WALK.markers.index("head"), 2]), rel=0.02)
    assert not any("height" in note for note in whole.report["notes"])


def test_a_skeleton_whose_head_is_the_lower_end_of_the_skull_is_as_high_as_its_legs_suggest() -> None:
    bones = {"hip": "UpLeg", "knee": "Leg", "ankle": "Foot", "toe": "ToeBase"}
    names = ["Head", "Spine", *(f"{side.title()}{bone}" for side in ("left", "right") for bone in bones.values())]
    chosen = ["neck", "base", *(f"{side}_{joint}" for side in ("left", "right") for joint in bones)]
    points = [WALK.markers.index(name) for name in chosen]
    parts = ["head", *(WALK.parts[i] for i in points[1:])]
    skeleton = WALK.with_points(WALK.position_m[:, points], names, parts).with_facts(height_m=math.nan)
    cleaned = clean_motion(skeleton)
    assert cleaned.facts.height_m == pytest.approx(1.75, rel=0.05)
    assert any("joints of the head end at 1." in note for note in cleaned.report["notes"])


@pytest.mark.parametrize("sofa_m", [0.0, 0.4])
def test_withers_are_measured_above_the_animal_s_own_paws(sofa_m: float) -> None:
    walk = quadruped_gait(gait="walk", withers_m=0.5, duration_s=4.0)
    position = walk.position_m.copy()
    # one step down from the sofa at the end: the floor of the room is lower than the sofa
    position[..., 2] += np.where(walk.time_s < 3.4, sofa_m, 0.0)[:, np.newaxis]
    dog = clean_motion(recorded(walk.with_positions(position)))
    assert dog.facts.height_m == pytest.approx(0.5, rel=0.06)


def test_a_dog_that_mostly_lies_has_the_withers_it_has_when_it_stands() -> None:
    walk = quadruped_gait(gait="walk", withers_m=0.5, duration_s=6.0)
    position = walk.position_m.copy()
    position[walk.time_s > 2.0, :, 2] *= 0.3
    assert clean_motion(recorded(walk.with_positions(position))).facts.height_m == pytest.approx(0.5, rel=0.06)


def test_a_part_of_a_recording_has_the_height_of_the_whole() -> None:
    """All but the paws is higher by a quarter for a second: the part shows nothing else."""
    walk = recorded(quadruped_gait(gait="walk", withers_m=0.5, duration_s=6.0))
    position = walk.position_m.copy()
    rears = np.flatnonzero((walk.time_s > 3.0) & (walk.time_s < 4.2))
    above = [i for i, part in enumerate(walk.parts) if not part.endswith("_paw")]
    position[np.ix_(rears, above, [2])] *= 1.25
    whole = walk.with_positions(position)
    part = whole.frames(int(rears[5]), int(rears[-5]))
    height_m = clean_motion(whole).facts.height_m
    assert height_m == pytest.approx(0.5, rel=0.06)
    assert clean_motion(part).facts.height_m > 1.15 * height_m
    assert clean_motion(part, whole=whole).facts.height_m == pytest.approx(height_m)
    # a recording that cannot be cleaned says nothing
    seen_once = whole.with_positions(np.where(np.arange(whole.n_frames)[:, None, None] == 0, position, np.nan))
    assert clean_motion(part, whole=seen_once).facts.height_m == clean_motion(part).facts.height_m


@pytest.mark.shared
@pytest.mark.parametrize(("name", "start_s"), [("D1_ex04_KAN02_001", 9.75), ("D1_ex04_KAN02_002", 6.6)])
def test_a_dog_that_jumps_is_no_taller(shared: Path, name: str, start_s: float) -> None:
    file = shared / "data" / "mocap" / "dog" / "mann-bvh" / f"{name}.bvh"
    part = {"start_s": start_s, "stop_s": start_s + 1.0}
    height_m = read(file, **part).facts.height_m
    assert height_m == read(file).facts.height_m
    assert describe_recording(file, **part)["cleaned"]["stature_m"] == height_m


@pytest.mark.release
@pytest.mark.shared
def test_one_dog_has_one_withers_height_in_all_its_recordings(shared: Path) -> None:
    files = sorted((shared / "data" / "mocap" / "dog" / "mann-bvh").glob("*.bvh"))
    heights = [read(path).facts.height_m for path in files]
    assert len(heights) == 19
    assert min(heights) > 0.42
    assert max(heights) < 0.47


@pytest.mark.shared
@pytest.mark.parametrize(
    ("name", "height_m"),
    [
        ("c3d/btk_coda_walk.c3d", 1.54),
        ("c3d/c3dorg_ist_walk_metres.c3d", 1.56),
        ("trc/bmc_walk1.trc", 1.82),
        ("c3d/c3dorg_walk_13markers.c3d", math.nan),
        ("c3d/ktk_optitrack_walk_legs.c3d", math.nan),
        ("trc/opensim_moco_markers_walk.trc", math.nan),
    ],
)
def test_headless_recordings(shared: Path, name: str, height_m: float) -> None:
    found = read(shared / "data" / "mocap" / "human" / name).facts.height_m
    assert found == pytest.approx(height_m, abs=0.01, nan_ok=True)


@pytest.mark.shared
def test_a_skeleton_has_one_stature_whatever_the_posture(shared: Path) -> None:
    files = sorted((shared / "data" / "mocap" / "human" / "bvh").glob("bandai2_*.bvh"))
    assert [read(path).facts.height_m for path in files] == pytest.approx([1.631] * 14, abs=0.01)


@pytest.mark.parametrize(
    ("first", "head_m", "height_m"), [("spine1", 1.58, 1.75), ("spine_base", 1.58, 1.75), ("T8", 1.58, 1.58)]
)
def test_joints_of_body_models_end_below_the_skull(first: str, head_m: float, height_m: float) -> None:
    """The hips of a person of 1.75 m are 0.491 of it above the ankles (Drillis and Contini 1966)."""
    leg_m = 1.75 * (0.245 + 0.246)
    heights = {"hip": 0.08 + leg_m, "knee": 0.08 + leg_m / 2, "ankle": 0.08}
    points = {f"{side}_{name}": z for side in ("left", "right") for name, z in heights.items()} | {
        first: 1.2,
        "head": head_m,
    }
    position = np.zeros((5, len(points), 3)) + np.array([[0.0, 0.0, z] for z in points.values()])
    assert measure_height(position, list(points), find_parts(points))[0] == pytest.approx(height_m, abs=0.01)
