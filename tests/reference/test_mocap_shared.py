"""The clinical walks and the horse of the shared test data: read right, or refused with a reason."""

import csv
from pathlib import Path

import numpy as np
import pytest

from doppelgait.core.errors import DoppelgaitWarning, MotionError
from doppelgait.motion.clean import find_body_centre
from doppelgait.motion.describe import describe_recording
from doppelgait.motion.readers import read
from doppelgait.motion.skeleton import HUMAN_PARTS

pytestmark = pytest.mark.shared

SPEED_MPS = {"walk": (1.45, 1.75), "trot": (2.8, 3.05)}
STRIDE_HZ = {"walk": (0.88, 1.1), "trot": (1.39, 1.56)}
EXCHANGED = "Horse1_M2_trot2_kinematics.csv"
"""The left fore hoof is on the right, so the trot has the footfalls of a pace."""
CUT_OFF = "Horse1_M3_trot2_kinematics.csv"
"""Its last line holds 20 of 23 cells."""


def _files(shared: Path, folder: str) -> dict[str, Path]:
    with (shared / "data" / "mocap" / folder / "manifest.csv").open(newline="", encoding="utf-8") as file:
        return {row["file"]: shared / "data" / "mocap" / row["file"] for row in csv.DictReader(file)}


def test_all_horse_trials_are_read_with_speed_stride_and_gait(shared: Path) -> None:
    paths = _files(shared, "horse")
    assert len(paths) == 14
    for path in paths.values():
        if path.name == CUT_OFF:
            with pytest.raises(MotionError, match="line 1201 has 20 cells"):
                read(path, units="mm")
            continue
        if path.name == EXCHANGED:
            exchanged = "left_fore_paw and right_fore_paw are on each other's side"
            with pytest.warns(DoppelgaitWarning, match="treadmill"), pytest.warns(DoppelgaitWarning, match=exchanged):
                read(path, units="mm")
            continue
        gait = "walk" if "walk" in path.name else "trot"
        with pytest.warns(DoppelgaitWarning, match="walks on a treadmill"):
            read(path, units="mm")
        motion = read(path, units="mm", treadmill=True, segment="longest")
        low, high = SPEED_MPS[gait]
        travel = find_body_centre(motion.position_m)[[0, -1], :2]
        assert low < float(np.linalg.norm(travel[1] - travel[0])) / motion.duration_s < high, path.name
        assert motion.facts.gait == gait, path.name
        low, high = STRIDE_HZ[gait]
        assert low < motion.facts.stride_frequency_hz < high, path.name
        assert 1.2 < motion.facts.height_m < 1.35
        hooves = ("left_fore_paw", "right_fore_paw", "left_hind_paw", "right_hind_paw")
        assert motion.parts == ["head", "trunk", "trunk", *hooves]


def test_the_horse_without_a_unit_is_refused_with_what_to_do(shared: Path) -> None:
    with pytest.raises(MotionError, match="'HeadX' names no length unit; give it: units='mm'"):
        read(_files(shared, "horse")["horse/vhdc-csv/Horse1_M1_walk1_kinematics.csv"])


@pytest.mark.release
def test_all_clinical_walks_are_read(shared: Path) -> None:
    paths = _files(shared, "clinic")
    assert len(paths) == 41
    for path in paths.values():
        facts = describe_recording(path)
        cleaned = facts["cleaned"]
        assert round(facts["frame_rate_hz"]) == 60
        assert 0.45 < cleaned["mean_speed_mps"] < 1.6, path.name
        assert cleaned["stature_m"] == pytest.approx(1.76, abs=0.01), path.name  # one skeleton for all of them
        assert any(segment["gait"] == "walk" for segment in facts["segments"]), path.name
        assert set(read(path).parts) <= set(HUMAN_PARTS), path.name


@pytest.mark.parametrize("name", ["D1_047z_KAN01_002", "D1_053_KAN01_001", "D1_071_KAN02_002"])
def test_dogs_that_turn_back_and_stand_are_not_mirrored(shared: Path, name: str) -> None:
    notes = read(shared / "data" / "mocap" / "dog" / "mann-bvh" / f"{name}.bvh").report["notes"]
    assert not any("side" in note for note in notes)
