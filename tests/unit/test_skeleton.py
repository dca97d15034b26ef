"""Names of markers and the body parts they belong to."""

from __future__ import annotations

import pytest

from doppelgait.motion.skeleton import BOULIC_PARTS, HUMAN_PARTS, KNOWN_SETS, bare_name, complete_set, part_of


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
    assert part_of(marker) == part


@pytest.mark.parametrize("name", sorted(KNOWN_SETS))
def test_every_marker_of_a_known_set_has_a_part(name: str) -> None:
    assert {part_of(marker) for marker in KNOWN_SETS[name]} <= set(HUMAN_PARTS)
    assert len({part_of(marker) for marker in KNOWN_SETS[name]}) == len(HUMAN_PARTS)


def test_known_sets_have_their_published_size() -> None:
    assert len(KNOWN_SETS["CMU 41"]) == 41
    assert len(KNOWN_SETS["Plug-in Gait"]) == 39


def test_boulic_points_map_to_themselves() -> None:
    assert len(BOULIC_PARTS) == 17
    assert set(BOULIC_PARTS.values()) <= set(HUMAN_PARTS)
    assert {name: part_of(name) for name in BOULIC_PARTS} == BOULIC_PARTS


def test_sides_are_mirror_images() -> None:
    for name in KNOWN_SETS["CMU 41"] | KNOWN_SETS["Plug-in Gait"]:
        if name.startswith("L"):
            assert part_of("R" + name[1:]) == part_of(name).replace("left", "right")


def test_bare_name() -> None:
    assert bare_name("a:b:LFIN ") == "LFIN"


def test_complete_set_needs_nine_tenths() -> None:
    markers = sorted(KNOWN_SETS["CMU 41"])
    assert complete_set(f"J:{m.lower()}" for m in markers[4:]) == KNOWN_SETS["CMU 41"]
    assert complete_set(markers[5:]) == frozenset()
