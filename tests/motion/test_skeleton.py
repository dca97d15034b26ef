"""Names of markers and the body parts they belong to."""

from pathlib import Path

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
