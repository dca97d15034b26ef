"""Names of markers and the body parts they belong to."""

import pytest

from doppelgait.motion import skeleton
from doppelgait.motion.models.quadruped import PART_OF_POINT


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


def test_bare_name() -> None:
    assert skeleton.strip_subject("a:b:LFIN ") == "LFIN"


def test_complete_set_needs_nine_tenths() -> None:
    markers = sorted(skeleton.list_marker_sets()["CMU 41"])
    assert skeleton.complete_set(f"J:{m.lower()}" for m in markers[4:]) == frozenset(markers)
    assert skeleton.complete_set(markers[5:]) == frozenset()


SETS = """
cmu-bvh, human; torso Hips LHipJoint LeftUpLeg RightUpLeg LowerBack Spine Spine1 Neck Neck1
LeftShoulder LeftArm; left_thigh LeftLeg; left_shank LeftFoot; left_foot LeftToeBase
LeftToeBase_End; right_thigh RightLeg; right_shank RightFoot; right_foot RightToeBase; head Head;
left_upper_arm LeftForeArm; left_forearm LeftHand; left_hand LeftFingerBase LeftHandIndex1 LThumb;
right_upper_arm RightForeArm; right_forearm RightHand; right_hand RThumb

amc, human; torso root lhipjoint lowerback upperback thorax lowerneck upperneck lclavicle;
left_thigh lfemur; left_shank ltibia; left_foot lfoot ltoes; right_thigh rfemur; right_shank
rtibia; right_foot rfoot; head head; left_upper_arm lhumerus; left_forearm lradius lwrist;
left_hand lhand lfingers lthumb; right_upper_arm rhumerus; right_forearm rradius; right_hand rhand

bandai, human; torso joint_Root Hips Spine Chest Neck Shoulder_L UpperArm_L UpperLeg_L UpperLeg_R;
head Head; left_upper_arm LowerArm_L; left_forearm Hand_L; left_hand Hand_L_End; right_upper_arm
LowerArm_R; right_forearm Hand_R; left_thigh LowerLeg_L; left_shank Foot_L; left_foot Toes_L;
right_thigh LowerLeg_R; right_shank Foot_R; right_foot Toes_R

smpl, human; torso pelvis left_hip spine1 neck left_collar left_shoulder; left_thigh left_knee;
right_thigh right_knee; left_shank left_ankle; right_shank right_ankle; left_foot left_foot;
right_foot right_foot; head head; left_upper_arm left_elbow; right_upper_arm right_elbow;
left_forearm left_wrist; right_forearm right_wrist; left_hand left_hand; right_hand right_hand

dog-bvh, dog; trunk Hips Spine LeftShoulder LeftUpLeg; neck Neck; head Head Head_End;
left_fore_upper LeftArm LeftForeArm; left_fore_lower LeftHand; left_fore_paw LeftHand_End;
left_hind_upper LeftLeg; left_hind_lower LeftFoot; left_hind_paw LeftFoot_End; right_hind_paw
RightFoot_End; tail Tail Tail1

rig-dog, dog; trunk Bip01 b_Hips b_Spine3 b_LeftClav b_LeftLegUpper; neck b__Neck b__Neck2; head
b_Head; left_fore_upper b_LeftArm b_LeftForeArm; left_fore_lower b_LeftHand; left_fore_paw
b__LeftFinger; tail b_Tail001; left_hind_upper b_LeftLeg; left_hind_lower b_LeftLeg1 b_LeftAnkle;
left_hind_paw b_LeftToe b_LeftToe002; - Dog_Jaw Dog_LeftArmor002

trc, -; torso R.ASIS L.Iliac.Crest R.Clavicle S2; right_thigh R.GTR R.Knee R.Knee.Medial;
left_shank L.HF L.TT L.Ankle; left_foot L.Heel; right_foot R.MT2; left_upper_arm L.Biceps;
left_thigh L.TH4; right_shank R.SH4

prefixed, -; torso Skeleton_Hip2; head Skeleton_Head1; left_upper_arm Skeleton_LUArm1; left_hand
Skeleton_LHand3; right_thigh Skeleton_RThigh2; right_shank Skeleton_RShin1; right_foot
Skeleton_RFoot2

opencap, -; torso r.ASIS_study C7_study r_shoulder_study RHJC_study midHip Neck; right_thigh
r_knee_study r_mknee_study r_thigh1_study; left_shank L_ankle_study L_mankle_study L_sh1_study;
left_foot L_toe_study L_5meta_study L_calc_study LBigToe LSmallToe; right_upper_arm r_lelbow_study
r_melbow_study; left_forearm L_mwrist_study

halpe, -; head Nose LEye REar Head; torso Neck Hip CHip LHip LShoulder; left_foot LBigToe LSmallToe
LHeel

mediapipe, -; head left_eye_inner mouth_left right_ear; left_hand left_pinky left_index left_thumb;
left_shank left_ankle; left_foot left_heel left_foot_index; right_foot RIGHT_FOOT_INDEX; torso
LEFT_SHOULDER left_hip

gait2392, -; torso V.Sacral R.Acromium Sternum; right_thigh R.Thigh.Upper R.Thigh.Rear R.Knee.Lat;
left_shank L.Shank.Front L.Ankle.Med; left_foot L.Toe.Tip L.Midfoot.Sup L.Heel; head Top.Head
R.Temple; left_upper_arm L.Bicep L.Elbow.Lat; right_forearm R.Wrist.Med

rajagopal, -; torso RACR LASH RPSH S2 LHJC RSJC; right_upper_arm RUA1 RLEL RMEL REJC; left_forearm
LFAsuperior LFAradius LFAulna; left_thigh LTH3 LLFC LMFC; right_shank RTB1 RLMAL RMMAL; left_foot
LCAL LMT5 LTOE

optitrack, -; head HeadTop HeadSide; torso BackTop BackLeft WaistLFront WaistRBack Chest
LShoulderTop Ab; left_upper_arm LUArmHigh LElbowOut; right_forearm RWristIn RFArm; left_hand
LHandOut; left_thigh LThigh LKneeIn; right_shank RShin RAnkleOut; left_foot LToeTip LHeel

motive bones, -; torso Hip Ab Chest LShoulder LUArm RThigh LThigh; left_upper_arm LFArm;
left_forearm LHand; left_thigh LShin; left_shank LFoot; right_shank RFoot; right_foot RToe;
right_thigh RShin

biomech, -; torso CV7 TV2 SJN SXS LCAJ LIAS; left_upper_arm LHLE LHGT; right_forearm RRSP RUSP;
left_thigh LFTC LFLE LFAX; right_shank RTTC RFAL RTAM RSK1; left_foot LFCC LFM1 LDP1; left_hand
LHM2

qualisys, -; head HeadL HeadFront; torso SpineTop SpineThoracic12 BackL WaistLFront WaistR
WaistBack LSips ChestLow; left_upper_arm LArm LElbowIn; right_hand RHandIn RHand2; left_thigh
LThighFrontLow LKneeOut; right_shank RShinFrontHigh RAnkleIn; left_foot LForefootOut LForefoot5
LHeelBack

vicon legs, -; torso LASI SACR; left_thigh LTHAP LKAX LKD1 LKNM; right_shank RTIAD RMED; left_foot
LTOE LHEE

kinect, -; torso SpineBase ShoulderLeft HipRight HipCenter SpineShoulder; left_upper_arm ElbowLeft;
left_hand HandTipLeft ThumbLeft; right_thigh KneeRight; left_shank AnkleLeft; right_foot FootRight
FOOT_RIGHT; torso CLAVICLE_LEFT

xsens, -; torso Pelvis L3 T12 RightUpperArm LeftUpperLeg; right_upper_arm RightForeArm;
left_forearm LeftHand; left_thigh LeftLowerLeg; left_shank LeftFoot; left_foot LeftToe

superanimal, dog; head upper_jaw right_earend left_antler_base mouth_end_left; neck neck_end
throat_base; trunk back_base back_end belly_bottom body_middle_left tail_base; tail tail_end;
left_fore_upper front_left_thai; right_fore_lower front_right_knee; left_fore_paw front_left_paw;
left_hind_upper back_left_thai; left_hind_lower back_left_knee; right_hind_paw back_right_paw

animal pose, dog; trunk Root_of_tail L_Hip; left_fore_upper L_Shoulder L_Elbow L_F_Elbow;
right_fore_paw R_F_Paw; left_hind_upper L_Knee L_B_Elbow; left_hind_lower L_B_Knee; right_hind_paw
R_B_Paw right_back_paw; right_fore_lower R_F_Knee
"""
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
