"""Every BVH, AMC and exponential-map file of the shared test data: read as its manifest says."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import uniform_filter1d

from doppelgait.motion import Motion
from doppelgait.motion.describe import describe_motion
from doppelgait.motion.readers import cut_part, read
from recorded import read_manifests

pytestmark = pytest.mark.shared

AMC = [f"cmu_{name}.amc" for name in ("02_02", "02_03", "03_01", "07_01", "07_05", "07_10", "09_06")]
EXPMAP = [
    *(f"running_{n}.txt" for n in range(1, 6)),
    *(f"walking_{n}.txt" for n in range(2, 5)),
    *(f"walking-extra_{n}.txt" for n in (13, 15, 17, 22, 27, 29, 33, 37, 41, 48)),
]
CMU_BVH = ["cmu_12_01.bvh", "cmu_131_01.bvh"]
BANDAI = [
    f"bandai2_{gait}_{style}_001.bvh"
    for gait in ("walk", "run")
    for style in ("normal", "masculine", "feminine", "youthful", "elderly", "exhausted", "active")
]
MANN = [
    f"D1_{name}.bvh"
    for name in (
        "005_KAN01_001", "007_KAN01_001", "008_KAN01_001", "009_KAN01_001", "010_KAN01_001", "010_KAN01_002",
        "010_KAN01_004", "045_KAN01_001", "047z_KAN01_002", "047z_KAN01_005", "053_KAN01_001", "058_KAN01_001",
        "059_KAN01_001", "071_KAN02_002", "ex01_KAN01_001", "ex03_KAN02_013", "ex03_KAN02_014", "ex04_KAN02_001",
        "ex04_KAN02_002",
    )
]  # fmt: skip
TENCENT = ["dog_idle_004.bvh", *(f"dog_quad_walkrun_00{n}.bvh" for n in (1, 5, 7))]
DOGS = [*MANN, *TENCENT]
FILES = [*AMC, *EXPMAP, *CMU_BVH, *BANDAI, *DOGS]

POINTS = {"amc": 31, "txt": 28, "cmu": 28, "ban": 21, "D1_": 26, "dog": 40}
"""Points that are left, by suffix or beginning of the name."""
STANDS = "D1_005_KAN01_001.bvh"
WITHOUT_FIRST_FRAME = "cmu_131_01.bvh"
"""Its manifest leaves frame 0 out as a T-pose, as in other CMU conversions; here it is part of the recording."""


def _rows(shared: Path) -> dict[str, dict[str, str]]:
    return read_manifests(shared, "human", "dog", formats=("bvh", "amc", "cmu-expmap"))


@cache
def _read(shared: Path, name: str) -> Motion:
    return read(shared / "data" / "mocap" / _rows(shared)[name]["file"], clean=False)


def _path(position: np.ndarray, rate_hz: float, window_s: float) -> np.ndarray:
    """Horizontal path of the mean of all points, averaged over a window, as the manifests were made."""
    width = max(1, round(window_s * rate_hz)) | 1
    centre = position[:, :, :2].mean(axis=1)
    edge = min(width // 2, len(centre) - 1)
    longer = np.pad(centre, ((edge, edge), (0, 0)), mode="reflect", reflect_type="odd")
    return uniform_filter1d(longer, width, axis=0)[edge : edge + len(centre)]


def test_tables_name_every_file(shared: Path) -> None:
    assert sorted(FILES) == sorted(_rows(shared))


@pytest.mark.parametrize("name", FILES)
def test_recording_has_the_counts_of_its_manifest(shared: Path, name: str) -> None:
    row, motion = _rows(shared)[name], _read(shared, name)
    report = motion.report
    assert report["points_in_file"] == int(row["points_in_file"])
    assert len(motion.markers) == POINTS.get(name[-3:], POINTS.get(name[:3], 0))
    assert len(motion.markers) + sum(map(len, report["dropped"].values())) == report["points_in_file"]
    assert report["metres_per_unit"] == pytest.approx(float(row["metres_per_unit"]), rel=1e-6)
    assert report["up_axis"] == row["up_axis"]
    assert motion.rate_hz == pytest.approx(float(row["frame_rate_hz"]), rel=1e-5)
    frame_s = 1.0 / motion.rate_hz
    extra = frame_s if name == WITHOUT_FIRST_FRAME else 0.0
    assert motion.n_frames * frame_s == pytest.approx(float(row["duration_s"]) + extra, abs=1e-3)
    assert np.isfinite(motion.position_m).all()
    if name not in TENCENT:  # its manifest counts helpers beyond nose, paws and tail
        facts = describe_motion(motion)
        assert facts["height_m"] == pytest.approx(float(row["height_m"]), abs=2e-3)
        assert facts["lowest_point_m"] == pytest.approx(float(row["lowest_point_m"]), abs=1e-3)


@pytest.mark.parametrize("name", [name for name in FILES if name != STANDS])
def test_travel_agrees_with_the_manifest(shared: Path, name: str) -> None:
    row, motion = _rows(shared)[name], _read(shared, name)
    path = _path(motion.position_m, motion.rate_hz, 0.35 if name in DOGS else 0.5)
    length = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
    net = float(np.linalg.norm(path[-1] - path[0]))
    assert length == pytest.approx(float(row["path_length_m"]), rel=0.02)
    # who comes back to the start has a displacement of a few millimetres of the centre's definition
    assert net == pytest.approx(float(row["net_displacement_m"]), rel=0.02, abs=0.03)
    assert net / length == pytest.approx(float(row["straightness"]), abs=0.012)
    facts = describe_motion(motion)
    assert facts["mean_speed_mps"] == pytest.approx(float(row["mean_speed_mps"]), rel=0.02, abs=0.003)
    if row["seg_speed_mps"]:
        # the manifest counts the frames of the file
        moved = int(name in EXPMAP or name == "cmu_12_01.bvh")
        first, last = (int(float(row[key])) - moved for key in ("seg_start_frame", "seg_end_frame"))
        last = min(last, len(path) - 1)
        first = max(first, 0)
        speed = float(np.linalg.norm(path[last] - path[first])) * motion.rate_hz / (last - first)
        assert speed == pytest.approx(float(row["seg_speed_mps"]), rel=0.02)


@pytest.mark.parametrize("name", [name for name in FILES if name != STANDS])
def test_stride_agrees_with_the_manifest(shared: Path, name: str) -> None:
    row, rate = _rows(shared)[name], float(_rows(shared)[name]["frame_rate_hz"])
    moved = int(name in EXPMAP or name == "cmu_12_01.bvh")
    first, last = (int(float(row[key])) - moved for key in ("seg_start_frame", "seg_end_frame"))
    motion = cut_part(Path(name), _read(shared, name), max(first, 0) / rate, last / rate)
    assert describe_motion(motion)["stride_hz"] == pytest.approx(float(row["stride_hz"]), abs=0.1)


def test_one_walk_in_three_formats(shared: Path) -> None:
    c3d = read(shared / "data" / "mocap" / "human" / "c3d" / "cmu_07_01.c3d", clean=False)
    bones, maps = _read(shared, "cmu_07_01.amc"), _read(shared, "walking_4.txt")
    for bone, joint, marker in (("ltibia", "LeftFoot", "LANK"), ("rtibia", "RightFoot", "RANK")):
        ankle = c3d.positions.sel(marker=marker).values
        apart_m = np.linalg.norm(bones.positions.sel(marker=bone).values - ankle, axis=1).mean()
        assert apart_m == pytest.approx(0.048, abs=0.001)
        # the maps use the skeleton of another, larger person
        assert np.linalg.norm(maps.positions.sel(marker=joint).values - ankle, axis=1).mean() < 0.08
    facts = [describe_motion(motion) for motion in (c3d, bones, maps)]
    for other in facts[1:]:
        assert other["mean_speed_mps"] == pytest.approx(facts[0]["mean_speed_mps"], rel=0.01)
        assert other["step_hz"] == pytest.approx(facts[0]["step_hz"], abs=0.03)
