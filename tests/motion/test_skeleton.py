"""Names of markers and the body parts they belong to."""

import pytest

from doppelgait.motion.models.quadruped import PART_OF_POINT
from doppelgait.motion.skeleton import (
    BOULIC_PARTS,
    DOG_PARTS,
    HUMAN_PARTS,
    KNOWN_SETS,
    complete_set,
    find_part,
    find_parts,
    guess_species,
    strip_subject,
)


@pytest.mark.parametrize(
    ("marker", "part"),
    [
        ("LFHD", "head"), ("liu:RBHD", "head"), ("C7", "torso"), ("LSHO", "torso"), ("RBWT", "torso"),
        ("LUPA", "left_upper_arm"), ("RELB", "right_upper_arm"), ("LFRM", "left_forearm"), ("RFRA", "right_forearm"),
        ("lwra", "left_forearm"), ("RFIN", "right_hand"), ("LTHI", "left_thigh"), ("RKNE", "right_thigh"),
        ("LTIB", "left_shank"), ("RSHN", "right_shank"), ("LANK", "left_shank"), ("RHEE", "right_foot"),
        ("LTOE", "left_foot"), ("Subject1:LMT5", "left_foot"), ("r heel", "right_foot"), ("L.Knee", "left_thigh"),
        ("L_FAL", "left_shank"), ("RShoulder", "torso"), ("left_toe", "left_foot"), ("base", "torso"),
        ("", ""), ("Marker_7", ""), ("Stick", ""), ("*12", ""), ("L", ""),
    ],
)  # fmt: skip
def test_part_of(marker: str, part: str) -> None:
    assert find_part(marker) == part


@pytest.mark.parametrize("name", sorted(KNOWN_SETS))
def test_every_marker_of_a_known_set_has_a_part(name: str) -> None:
    assert {find_part(marker) for marker in KNOWN_SETS[name]} <= set(HUMAN_PARTS)
    assert len({find_part(marker) for marker in KNOWN_SETS[name]}) == len(HUMAN_PARTS)


def test_known_sets_have_their_published_size() -> None:
    assert len(KNOWN_SETS["CMU 41"]) == 41
    assert len(KNOWN_SETS["Plug-in Gait"]) == 39


def test_boulic_points_map_to_themselves() -> None:
    assert len(BOULIC_PARTS) == 17
    assert set(BOULIC_PARTS.values()) <= set(HUMAN_PARTS)
    assert {name: find_part(name) for name in BOULIC_PARTS} == BOULIC_PARTS


def test_sides_are_mirror_images() -> None:
    for name in KNOWN_SETS["CMU 41"] | KNOWN_SETS["Plug-in Gait"]:
        if name.startswith("L"):
            assert find_part("R" + name[1:]) == find_part(name).replace("left", "right")


def test_bare_name() -> None:
    assert strip_subject("a:b:LFIN ") == "LFIN"


def test_complete_set_needs_nine_tenths() -> None:
    markers = sorted(KNOWN_SETS["CMU 41"])
    assert complete_set(f"J:{m.lower()}" for m in markers[4:]) == KNOWN_SETS["CMU 41"]
    assert complete_set(markers[5:]) == frozenset()


CMU_BVH = {
    "Hips": "torso", "LHipJoint": "torso", "LeftUpLeg": "torso", "LeftLeg": "left_thigh", "LeftFoot": "left_shank",
    "LeftToeBase": "left_foot", "LeftToeBase_End": "left_foot", "RightUpLeg": "torso", "RightLeg": "right_thigh",
    "RightFoot": "right_shank", "RightToeBase": "right_foot", "LowerBack": "torso", "Spine": "torso", "Spine1": "torso",
    "Neck": "torso", "Neck1": "torso", "Head": "head", "LeftShoulder": "torso", "LeftArm": "torso",
    "LeftForeArm": "left_upper_arm", "LeftHand": "left_forearm", "LeftFingerBase": "left_hand",
    "LeftHandIndex1": "left_hand", "LThumb": "left_hand", "RightForeArm": "right_upper_arm",
    "RightHand": "right_forearm", "RThumb": "right_hand",
}  # fmt: skip
CMU_AMC = {
    "root": "torso", "lhipjoint": "torso", "lfemur": "left_thigh", "ltibia": "left_shank", "lfoot": "left_foot",
    "ltoes": "left_foot", "rfemur": "right_thigh", "rtibia": "right_shank", "rfoot": "right_foot",
    "lowerback": "torso", "upperback": "torso", "thorax": "torso", "lowerneck": "torso", "upperneck": "torso",
    "head": "head", "lclavicle": "torso", "lhumerus": "left_upper_arm", "lradius": "left_forearm",
    "lwrist": "left_forearm", "lhand": "left_hand", "lfingers": "left_hand", "lthumb": "left_hand",
    "rhumerus": "right_upper_arm", "rradius": "right_forearm", "rhand": "right_hand",
}  # fmt: skip
BANDAI = {
    "joint_Root": "torso", "Hips": "torso", "Spine": "torso", "Chest": "torso", "Neck": "torso", "Head": "head",
    "Shoulder_L": "torso", "UpperArm_L": "torso", "LowerArm_L": "left_upper_arm", "Hand_L": "left_forearm",
    "Hand_L_End": "left_hand", "LowerArm_R": "right_upper_arm", "Hand_R": "right_forearm", "UpperLeg_L": "torso",
    "LowerLeg_L": "left_thigh", "Foot_L": "left_shank", "Toes_L": "left_foot", "UpperLeg_R": "torso",
    "LowerLeg_R": "right_thigh", "Foot_R": "right_shank", "Toes_R": "right_foot",
}  # fmt: skip
SMPL = {
    "pelvis": "torso", "left_hip": "torso", "spine1": "torso", "left_knee": "left_thigh", "right_knee": "right_thigh",
    "left_ankle": "left_shank", "right_ankle": "right_shank", "left_foot": "left_foot", "right_foot": "right_foot",
    "neck": "torso", "left_collar": "torso", "head": "head", "left_shoulder": "torso", "left_elbow": "left_upper_arm",
    "right_elbow": "right_upper_arm", "left_wrist": "left_forearm", "right_wrist": "right_forearm",
    "left_hand": "left_hand", "right_hand": "right_hand",
}  # fmt: skip
DOG_BVH = {
    "Hips": "trunk", "Spine": "trunk", "Neck": "neck", "Head": "head", "Head_End": "head", "LeftShoulder": "trunk",
    "LeftArm": "left_fore_upper", "LeftForeArm": "left_fore_upper", "LeftHand": "left_fore_lower",
    "LeftHand_End": "left_fore_paw", "LeftUpLeg": "trunk", "LeftLeg": "left_hind_upper", "LeftFoot": "left_hind_lower",
    "LeftFoot_End": "left_hind_paw", "RightFoot_End": "right_hind_paw", "Tail": "tail", "Tail1": "tail",
}  # fmt: skip
RIG_DOG = {
    "Bip01": "trunk", "b_Hips": "trunk", "b_Spine3": "trunk", "b__Neck": "neck", "b__Neck2": "neck", "b_Head": "head",
    "b_LeftClav": "trunk", "b_LeftArm": "left_fore_upper", "b_LeftForeArm": "left_fore_upper",
    "b_LeftHand": "left_fore_lower", "b__LeftFinger": "left_fore_paw", "b_Tail001": "tail", "b_LeftLegUpper": "trunk",
    "b_LeftLeg": "left_hind_upper", "b_LeftLeg1": "left_hind_lower", "b_LeftAnkle": "left_hind_lower",
    "b_LeftToe": "left_hind_paw", "b_LeftToe002": "left_hind_paw", "Dog_Jaw": "", "Dog_LeftArmor002": "",
}  # fmt: skip
TRC = {
    "R.ASIS": "torso", "L.Iliac.Crest": "torso", "R.GTR": "right_thigh", "R.Knee": "right_thigh", "L.HF": "left_shank",
    "L.TT": "left_shank", "L.Ankle": "left_shank", "R.Knee.Medial": "right_thigh", "L.Heel": "left_foot",
    "R.MT2": "right_foot", "L.Biceps": "left_upper_arm", "R.Clavicle": "torso", "S2": "torso", "L.TH4": "left_thigh",
    "R.SH4": "right_shank",
}  # fmt: skip
PREFIXED = {
    "Skeleton_Hip2": "torso", "Skeleton_Head1": "head", "Skeleton_LUArm1": "left_upper_arm",
    "Skeleton_LHand3": "left_hand", "Skeleton_RThigh2": "right_thigh", "Skeleton_RShin1": "right_shank",
    "Skeleton_RFoot2": "right_foot",
}  # fmt: skip


@pytest.mark.parametrize(
    ("joints", "species"),
    [
        (CMU_BVH, "human"), (CMU_AMC, "human"), (BANDAI, "human"), (SMPL, "human"), (BOULIC_PARTS, "human"),
        (DOG_BVH, "dog"), (RIG_DOG, "dog"), (PART_OF_POINT, "dog"), (TRC, ""), (PREFIXED, ""),
    ],
    ids=["cmu-bvh", "amc", "bandai", "smpl", "boulic", "dog-bvh", "rig-dog", "quadruped", "trc", "prefixed"],
)  # fmt: skip
def test_parts_and_species_of_whole_sets(joints: dict[str, str], species: str) -> None:
    assert dict(zip(joints, find_parts(joints), strict=True)) == joints
    assert guess_species(joints) == species
    assert find_parts([f"anna:{name}" for name in joints]) == list(joints.values())


@pytest.mark.parametrize("name", sorted(KNOWN_SETS))
def test_marker_sets_are_people(name: str) -> None:
    markers = sorted(KNOWN_SETS[name])
    assert guess_species(markers) == "human"
    assert find_parts(markers) == [find_part(marker) for marker in markers]


def test_one_name_means_another_part_in_another_body() -> None:
    assert find_part("LeftHand") == "left_hand"
    assert find_part("LeftHand", "dog") == "left_fore_paw"
    assert find_part("left_elbow", "dog") == "left_fore_upper"
    assert {find_part(part) for part in HUMAN_PARTS} == set(HUMAN_PARTS)
    assert {find_part(part, "dog") for part in DOG_PARTS} == set(DOG_PARTS)


def test_few_or_strange_names_do_not_tell_the_species() -> None:
    assert guess_species([]) == guess_species(["RHip", "RKnee", "RAnkle", "LHip", "LKnee", "LAnkle"]) == ""
    assert find_parts([]) == []
    assert find_parts(["Channel1", "Channel2", "*12", ""]) == [""] * 4
