"""Every recording that a manifest of the shared test data describes: read as its manifest says."""

from pathlib import Path

import numpy as np
import pytest

from checkout import SHARED
from doppelgait.motion.describe import describe_motion
from doppelgait.motion.readers import cut_part
from recorded import read_manifests, read_quietly

pytestmark = pytest.mark.shared

MARKERS = ("c3d", "trc", "accad-txt")
SKELETONS = ("bvh", "amc", "cmu-expmap")
FOLDERS = ("human", "rat", "dog")
ROWS = read_manifests(SHARED, *FOLDERS, formats=MARKERS + SKELETONS) if SHARED.is_dir() else {}
POINTS = {"amc": 31, "cmu-expmap": 28, "bvh-cmu": 28, "bvh": 21, "bvh-mann": 26, "bvh-tencent": 40}
"""Points that are left of a skeleton, by format."""
PLUG_IN_GAIT = "btk_pig_walk_full.c3d"
"""Its manifest counts CentreOfMassFloor as a marker; it is the centre of mass put on the floor, a model output."""
SWAGGER, RUN = "accad_swagger1.txt", "accad_run1.txt"
GHOSTS = (PLUG_IN_GAIT, "cmu_07_12.c3d")  # the ghost marker of 07_12 makes most of its gaps
WITHOUT_FIRST_FRAME = "cmu_131_01.bvh"
"""Its manifest leaves frame 0 out as a T-pose, as in other CMU conversions; here it is part of the recording."""


def _read(name):
    return read_quietly(SHARED / "data" / "mocap" / ROWS[name]["file"], clean=False)


def _number(name, key):
    return float(ROWS[name][key])


def _segment(name):
    """First and last frame of the one straight segment; the manifest counts the frames of the file."""
    moved = int(ROWS[name]["format"] == "cmu-expmap" or name == "cmu_12_01.bvh")
    first, last = (int(_number(name, key)) - moved for key in ("seg_start_frame", "seg_end_frame"))
    return max(first, 0), last


def test_there_are_recordings():
    assert len(ROWS) == 84


@pytest.mark.parametrize("name", ROWS)
def test_recording_has_the_counts_and_the_size_of_its_manifest(name):
    row, motion = ROWS[name], _read(name)
    facts, kind = describe_motion(motion), row["format"]
    points = len(motion.markers) + sum(map(len, motion.report["dropped"].values()))
    assert facts["points_in_file"] == points == int(row["points_in_file"])
    # the manifests of tables have frames by the last printed time: 120.0008 where 120 explains all of them
    assert facts["frame_rate_hz"] == pytest.approx(_number(name, "frame_rate_hz"), rel=1e-5 * (kind != "c3d"))
    assert facts["metres_per_unit"] == pytest.approx(_number(name, "metres_per_unit"), rel=1e-6)
    assert facts["up_axis"] == row["up_axis"]
    extra_s = (name == WITHOUT_FIRST_FRAME) / motion.rate_hz
    assert facts["duration_s"] == pytest.approx(_number(name, "duration_s") + extra_s, abs=1e-3)
    if name != PLUG_IN_GAIT and kind != "bvh-tencent":  # its manifest counts helpers beyond nose, paws and tail
        is_table = kind in ("trc", "accad-txt")
        assert facts["height_m"] == pytest.approx(_number(name, "height_m"), abs=3e-3 if is_table else 2e-3)
        lowest_m = _number(name, "lowest_point_m")
        assert facts["lowest_point_m"] == pytest.approx(lowest_m, abs=3e-3 if kind in MARKERS else 1e-3)
    if kind not in MARKERS:
        assert np.isfinite(motion.position_m).all()
        assert len(motion.markers) == POINTS[kind]
        return
    assert facts["points_measured"] == int(row["points_measured"]) - (name == PLUG_IN_GAIT)
    assert facts["n_frames"] == int(row["n_frames"])
    assert facts["up_axis_from"] == "body parts" or kind == "c3d"
    if name not in GHOSTS:  # without the ghost of a heel in the swagger
        gaps = _number(name, "gap_fraction")
        assert facts["gap_fraction"] == pytest.approx(gaps, abs=2e-3 if name == SWAGGER else 1e-4)
        assert facts["points_with_gaps"] == int(row["points_with_gaps"])
        assert facts["points_all_missing"] == int(row["points_all_missing"])
    if name != "neurokin_rat_runway15.c3d":  # another limit there
        assert facts["stationary_points"] == int(row["stationary_points"])


@pytest.mark.parametrize("name", [name for name, row in ROWS.items() if row["stride_hz"] and name != RUN])
def test_stride_agrees_with_the_manifest(name):
    first, last = _segment(name)
    rate_hz = _number(name, "frame_rate_hz")
    facts = describe_motion(cut_part(Path(name), _read(name), first / rate_hz, last / rate_hz))
    assert facts["stride_hz"] == pytest.approx(_number(name, "stride_hz"), abs=0.1)
    assert facts["step_hz"] == pytest.approx(2 * facts["stride_hz"])


def test_one_walk_in_three_formats():
    c3d, bones, maps = (_read(name).positions for name in ("cmu_07_01.c3d", "cmu_07_01.amc", "walking_4.txt"))
    for bone, joint, marker in (("ltibia", "LeftFoot", "LANK"), ("rtibia", "RightFoot", "RANK")):
        ankle = c3d.sel(marker=marker).values
        apart_m = np.linalg.norm(bones.sel(marker=bone).values - ankle, axis=1).mean()
        assert apart_m == pytest.approx(0.048, abs=0.001)
        # the maps use the skeleton of another, larger person
        assert np.linalg.norm(maps.sel(marker=joint).values - ankle, axis=1).mean() < 0.08
