"""Cleaning of the shared test data: what is found in good recordings, and segments found without names."""

from pathlib import Path

import pytest

from recorded import read_quietly

pytestmark = pytest.mark.shared

JUMPING = {"cmu_07_01.c3d": ["LTOE"], "cmu_16_07.c3d": ["LFIN"]}
"""Single frames that lie 4 cm beside the path: too little for a spike, too much for a limb."""
GOOD = (
    "btk_coda_walk.c3d", "btk_pig_walk_full.c3d", "c3dorg_ist_walk_metres.c3d", "cmu_02_01.c3d", "cmu_07_01.c3d",
    "cmu_07_12.c3d", "cmu_16_07.c3d", "cmu_16_08.c3d", "cmu_77_02.c3d", "cmu_82_08.c3d", "ezc3d_qualisys_walk.c3d",
    "ktk_optitrack_walk_legs.c3d", "opensim_walking2.c3d",
)  # fmt: skip


@pytest.mark.parametrize("name", GOOD)
def test_good_recordings_raise_no_false_alarm(shared: Path, name: str) -> None:
    report = read_quietly(shared / "data/mocap/human/c3d" / name).report
    assert report["swaps_repaired"] == []
    assert [jump["point"] for jump in report["jumps"]] == JUMPING.get(name, [])
    for reason in report["dropped"]:
        assert not reason.startswith(("at the place of", "short-lived", "far away"))


def test_second_names_of_the_same_markers_are_dropped(shared: Path) -> None:
    dropped = read_quietly(shared / "data/c3d-edge-cases/phoenix_golfswing.c3d").report["dropped"]
    doubles = {reason: names for reason, names in dropped.items() if reason.startswith("at the place of")}
    assert doubles == {f"at the place of Channel{n}": [f"Channel{n + 8}"] for n in (807, 808, 809, 810, 823)}
