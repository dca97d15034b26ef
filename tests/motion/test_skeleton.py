"""Names of markers and the body parts they belong to."""

import math
from pathlib import Path

import numpy as np
import pytest

from doppelgait.core.errors import MotionError
from doppelgait.motion import Motion, make_motion, skeleton
from doppelgait.motion.clean import clean_motion
from doppelgait.motion.describe import describe_recording
from doppelgait.motion.hybrid import check_hybrid, measure_foot_slide
from doppelgait.motion.models import boulic_walk, human_gait, quadruped_gait
from doppelgait.motion.models.quadruped import PART_OF_POINT
from doppelgait.motion.readers import read
from doppelgait.motion.retime import scale_to_height, travel_speed_mps
from doppelgait.motion.skeleton import find_bones, find_parts, measure_height, measure_pair_lengths
from walking_body import BONES


@pytest.mark.parametrize(
    ("marker", "part"),
    [
        ("LFHD", "head"), ("liu:RBHD", "head"), ("C7", "torso"), ("LSHO", "torso"), ("RBWT", "torso"),
        ("LUPA", "left_upper_arm"), ("RELB", "right_upper_arm"), ("LFRM", "left_forearm"), ("RFRA", "right_forearm"),
        ("lwra", "left_forearm"), ("RFIN", "right_hand"), ("LTHI", "left_thigh"), ("RKNE", "right_thigh"),
        ("LTIB", "left_shank"), ("RSHN", "right_shank"), ("LANK", "left_shank"), ("RHEE", "right_foot"),
        ("LTOE", "left_foot"), ("Subject1:LMT5", "left_foot"), ("r heel", "right_foot"), ("L.Knee", "left_thigh"),
        ("L_FAL", "left_shank"), ("RShoulder", "torso"), ("left_toe", "left_foot"), ("base", "torso"),
        ("", ""), ("Marker_7", ""), ("Stick", ""), ("*12", ""), ("L", ""), ("a:b:LFIN ", "left_hand"),
    ],
)  # fmt: skip
def test_part_of(marker: str, part: str) -> None:
    assert skeleton.find_part(marker) == part


@pytest.mark.parametrize(("name", "size"), [("CMU 41", 41), ("Plug-in Gait", 39)])
def test_known_sets_are_people_with_all_parts_in_mirror_images(name: str, size: int) -> None:
    markers = sorted(skeleton.list_marker_sets()[name])
    parts = [skeleton.find_part(marker) for marker in markers]
    assert len(markers) == size
    assert set(parts) == set(skeleton.HUMAN_PARTS)
    assert skeleton.find_parts(markers) == parts
    assert skeleton.guess_species(markers) == "human"
    left = [(marker, part) for marker, part in zip(markers, parts, strict=True) if marker.startswith("L")]
    assert all(skeleton.find_part("R" + marker[1:]) == part.replace("left", "right") for marker, part in left)


def test_complete_set_needs_nine_tenths() -> None:
    markers = sorted(skeleton.list_marker_sets()["CMU 41"])
    assert skeleton.complete_set(f"J:{m.lower()}" for m in markers[4:]) == frozenset(markers)
    assert skeleton.complete_set(markers[5:]) == frozenset()


SETS = Path(__file__).with_name("marker_sets.txt").read_text(encoding="utf-8")
"""Set and species, then parts, each with its names; ``-`` is none."""


@pytest.mark.parametrize("text", SETS.strip().split("\n\n"), ids=lambda text: text.partition(",")[0])
def test_parts_and_species_of_whole_sets(text: str) -> None:
    title, *groups = text.split(";")
    wanted = {marker: part.strip("-") for part, *markers in map(str.split, groups) for marker in markers}
    assert dict(zip(wanted, skeleton.find_parts(wanted), strict=True)) == wanted
    assert skeleton.guess_species(wanted) == title.partition(", ")[2].strip("-")
    assert skeleton.find_parts([f"anna:{marker}" for marker in wanted]) == list(wanted.values())


@pytest.mark.parametrize(("points", "species"), [(skeleton.BOULIC_PARTS, "human"), (PART_OF_POINT, "dog")])
def test_points_of_models_have_their_parts(points: dict[str, str], species: str) -> None:
    assert dict(zip(points, skeleton.find_parts(points), strict=True)) == points
    assert skeleton.guess_species(points) == species
    assert set(points.values()) <= {*skeleton.HUMAN_PARTS, *skeleton.DOG_PARTS}


def test_one_name_means_another_part_in_another_body() -> None:
    assert skeleton.find_part("LeftHand") == "left_hand"
    assert skeleton.find_part("LeftHand", "dog") == "left_fore_paw"
    assert skeleton.find_part("left_elbow", "dog") == "left_fore_upper"
    assert {skeleton.find_part(part) for part in skeleton.HUMAN_PARTS} == set(skeleton.HUMAN_PARTS)
    assert {skeleton.find_part(part, "dog") for part in skeleton.DOG_PARTS} == set(skeleton.DOG_PARTS)


def test_few_or_strange_names_do_not_tell_the_species() -> None:
    assert (
        skeleton.guess_species([])
        == skeleton.guess_species(["RHip", "RKnee", "RAnkle", "LHip", "LKnee", "LAnkle"])
        == ""
    )
    assert skeleton.find_parts([]) == []
    assert skeleton.find_parts(["Channel1", "Channel2", "*12", ""]) == [""] * 4


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


@pytest.mark.parametrize("case", ["level", "sofa", "lies"])
def test_withers_are_measured_above_the_animal_s_own_paws(case: str) -> None:
    walk = quadruped_gait(gait="walk", withers_m=0.5, duration_s=6.0)
    position = walk.position_m.copy()
    if case == "sofa":  # one step down at the end: the floor of the room is lower than the sofa
        position[walk.time_s < 5.1, :, 2] += 0.4
    elif case == "lies":
        position[walk.time_s > 2.0, :, 2] *= 0.3
    dog = clean_motion(recorded(walk.with_positions(position)))
    assert dog.facts.height_m == pytest.approx(0.5, rel=0.06)


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


def test_foot_slide_of_a_known_slide() -> None:
    """One foot rests for half of each second and slides forward at a tenth of the body's 1 m/s while it does."""
    time_s = np.arange(0.0, 6.0, 0.005)
    speeds = [np.where((time_s + shift) % 1.0 < 0.5, 0.1, 1.9) for shift in (0.0, 0.5)]
    feet = [np.cumsum(speed) * 0.005 for speed in speeds]
    x = np.stack([time_s, *feet], axis=1)
    position = np.stack([x, np.broadcast_to([0.0, 0.1, -0.1], x.shape), np.broadcast_to([1.0, 0.0, 0.0], x.shape)], 2)
    walk = make_motion(
        position, rate_hz=200, markers=["c7", "l", "r"], parts=["torso", "left_foot", "right_foot"], facts={}
    )
    assert measure_foot_slide(walk) == pytest.approx(0.1, rel=0.02)


def _checked_pairs(lengths_m: list[float], wanted_m: list[float]) -> Motion:
    """Check bars at rest on top of each other."""
    ends = np.concatenate([[[0.0, n, 1.0], [length, n, 1.0]] for n, length in enumerate(lengths_m)])
    still = make_motion(
        np.repeat(ends[np.newaxis], 20, axis=0),
        rate_hz=20.0,
        markers=[f"m{n}" for n in range(len(ends))],
        parts=[""] * len(ends),
    )
    pairs = np.arange(len(ends), dtype=np.int32).reshape(-1, 2)
    wanted = np.repeat([wanted_m], 20, axis=0)
    return check_hybrid(still, [still], pairs, wanted, still.position_m, {})


def test_the_length_that_is_furthest_beyond_its_own_limit_counts() -> None:
    """0.9 mm of 50 mm is allowed (1 mm), 5.5 mm of 1 m is not (5 mm)."""
    assert _checked_pairs([0.0509, 1.0045], [0.05, 1.0]).report["hybrid"]["length_error_m"] == pytest.approx(4.5e-3)
    with pytest.raises(MotionError, match=r"m2 and m3 would be 5\.5 mm nearer or further"):
        _checked_pairs([0.0509, 1.0055], [0.05, 1.0])


def test_feet_that_no_longer_rest_are_refused() -> None:
    walk = human_gait(speed_mps=1.2, duration_s=4.0)
    feet = [n for n, part in enumerate(walk.parts) if part.endswith("foot")]
    position = walk.position_m.copy()
    position[:, feet] = position[:, :1] + np.array([0.0, 0.1, -0.8])
    glides, pairs = walk.with_positions(position), np.array([[0, 1]], dtype=np.int32)
    assert math.isnan(measure_foot_slide(glides))
    with pytest.raises(MotionError, match="no foot would rest on the ground"):
        check_hybrid(glides, [walk], pairs, measure_pair_lengths(position, pairs), position, {})


def test_a_hand_that_passes_the_thigh_is_not_joined_to_it() -> None:
    time_s = np.linspace(0.0, 2.0, 100)
    swing = 0.6 * np.sin(2 * np.pi * time_s)
    hip, shoulder = np.array([0.0, 0.0, 0.9]), np.array([0.0, 0.0, 1.45])
    hand = shoulder + 0.56 * np.stack([np.sin(swing), 0 * swing, -np.cos(swing)], axis=1)
    points = np.stack([np.tile(hip, (100, 1)), np.tile(shoulder, (100, 1)), hand], axis=1)
    assert np.linalg.norm(points[:, 2] - points[:, 0], axis=1).min() < 0.02
    assert find_bones(points).tolist() == [[0, 1], [1, 2]]


def test_bones_are_those_of_the_model_but_for_points_that_are_never_seen() -> None:
    motion = boulic_walk(speed_mps=1.2, height_m=1.75, duration_s=3.0)
    walk, names = motion.position_m.copy(), motion.markers
    whole = find_bones(walk)
    assert len(whole) == len(names) - 1
    found = {frozenset((names[a], names[b])) for a, b in whole}
    assert {frozenset((a, b)) for a, b, _ in BONES} - {frozenset(("base", "neck"))} <= found
    walk[100:200, 3] = np.nan
    assert find_bones(walk).tolist() == whole.tolist()
    walk[:, 3] = np.nan
    assert 3 not in find_bones(walk)
    assert len(find_bones(walk)) == len(whole) - 1
    assert find_bones(np.zeros((10, 1, 3))).shape == (0, 2)
