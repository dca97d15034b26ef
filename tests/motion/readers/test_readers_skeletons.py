"""Kinect, Xsens and glTF files that these tests write themselves."""

import itertools
import pickle
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from doppelgait.core.errors import DoppelgaitWarning, MotionError
from doppelgait.motion.readers import read
from motion_files import BODY_M, BONES, CUBIC, KEYS_S, KINECT, RATE_HZ, SPIN, glb, kinect, mvnx, write_movement
from walking_body import NAMES


def test_kinect_joints_are_read_at_its_usual_rate(tmp_path: Path) -> None:
    path = tmp_path / "S001.skeleton"
    path.write_text(kinect(BODY_M))
    with pytest.warns(DoppelgaitWarning, match=r"30\.0 Hz, that of Kinect v2, is assumed"):
        assert read(path, clean=False).rate_hz == 30.0
    motion = read(path, clean=False, rate_hz=RATE_HZ)
    truth = BODY_M[:, : len(KINECT)].copy()
    truth[:2] = np.nan
    np.testing.assert_allclose(motion.position_m[:, KINECT], truth, atol=1e-6)
    assert (motion.report["up_axis"], motion.facts.subject) == ("y", "7")
    path.write_text(kinect(BODY_M).replace(" 2\n", "\n\n", 1))
    with pytest.raises(MotionError, match="truncated or damaged near line"):
        read(path, clean=False, rate_hz=RATE_HZ)
    path.write_text(kinect(BODY_M).replace("\n7 ", "\n9 ", 3))  # a body that is seen for a moment
    motion = read(path, clean=False, rate_hz=RATE_HZ)
    assert (motion.facts.subject, motion.report["notes"]) == (
        "7",
        ["subject '9', seen in 3 of 40 frames, was left out"],
    )
    path.write_text(kinect(BODY_M).replace("\n7 ", "\n9 ", 20))
    with pytest.raises(MotionError, match=r"several subjects: .*9 \(25 points\).*subject="):
        read(path, clean=False, rate_hz=RATE_HZ)


def test_segments_of_xsens_are_read_without_calibration_poses(tmp_path: Path) -> None:
    path = tmp_path / "walk.mvnx"
    path.write_text(mvnx(BODY_M))
    motion = read(path, clean=False)
    np.testing.assert_allclose(motion.position_m, np.nan_to_num(BODY_M), atol=1e-6)
    assert (motion.markers, motion.rate_hz, motion.report["length_unit"]) == (NAMES, RATE_HZ, "m")
    for old, new, says in (
        ("<mvnx", '<!DOCTYPE mvnx [<!ENTITY a "aaaa">]><mvnx', "document type"),
        ("</mvnx>", "", "no complete MVNX file"),
        (' label="LFHD"', "", "read"),
        ("</segments>", '</segments><fingers><segment label="LFHD"/></fingers>', "read"),
        ("<segment id=", "<segment/><segment id=", "export one subject with the position of every segment"),
        ('time="50"', 'time="60"', "time steps by|evenly spaced"),
        ('time="50"', 'time="5o"', "no complete MVNX file"),
    ):
        path.write_text(mvnx(BODY_M).replace(old, new, 1))
        if says == "read":
            assert read(path, clean=False).markers[0] == "LFHD" if new else "point_1"
            continue
        with pytest.raises(MotionError, match=says):
            read(path, clean=False)


def pose(time_s: float) -> np.ndarray:
    """Positions of the nine joints in metres, y up, by formulas."""
    place, frame = {0: np.zeros(3)}, {0: 0.01 * Rotation.from_euler("x", -90, degrees=True).as_matrix()}
    own = {
        4: Rotation.from_rotvec(time_s * SPIN.as_rotvec()).as_matrix(),
        7: Rotation.from_euler("x", 0.3 * (int(time_s / 0.25 + 1e-6) % 2)).as_matrix(),
        8: np.diag([1.0, 1.0, 2.0]),
    }
    for n, (parent, at) in list(enumerate(BONES.values()))[1:10]:
        offset = CUBIC @ time_s ** np.arange(4) if n == 1 else np.array(at)
        place[n] = place[parent] + frame[parent] @ offset
        frame[n] = frame[parent] @ own.get(n, np.eye(3))
    return np.array([place[n] for n in range(1, 10)])


@pytest.mark.parametrize(("rate_hz", "rotations"), [(None, "f4"), (50.0, "f4"), (50.0, "i2")])
def test_animations_are_interpolated_as_gltf_states(tmp_path: Path, rate_hz: float | None, rotations: str) -> None:
    path = glb(tmp_path / "walk.glb", rotations=rotations)
    motion = read(path, clean=False, **({"rate_hz": rate_hz} if rate_hz else {}))
    order = [list(BONES)[1:10].index(name) for name in motion.markers]
    truth = np.array([pose(t) for t in motion.time_s])[:, order][..., [2, 0, 1]]
    np.testing.assert_allclose(motion.position_m, truth, atol=2e-4 if rotations == "i2" else 2e-6)
    assert (motion.rate_hz, motion.n_frames, len(order)) == (rate_hz or 4.0, 101 if rate_hz else 9, 9)
    assert motion.markers[:5] == ["Hips", "Spine", "LeftUpLeg", "RightUpLeg", "Head"]  # by depth, then as in the file


@pytest.mark.parametrize(
    ("scene", "says"),
    [
        ({"animations": []}, "holds the animations none"),
        ({"animations": [{"name": "a"}, {"name": "b"}]}, "the animations a, b; name one: key="),
        ({"extensionsRequired": ["EXT_meshopt_compression"]}, "export it without compression"),
        ({"buffers": [{"uri": "walk.bin", "byteLength": 9}]}, r"save all in one \.glb"),
        ({"nodes": [{"children": [1]}, {"children": [0]}]}, "the nodes form no tree"),
        ({"accessors": []}, "damaged or unusual glTF"),
        ({"how": "SMOOTH"}, "the interpolation 'SMOOTH' is unknown"),
    ],
)
def test_what_a_gltf_file_lacks_is_named(tmp_path: Path, scene: dict[str, Any], says: str) -> None:
    with pytest.raises(MotionError, match=says):
        read(glb(tmp_path / "walk.glb", **scene), clean=False)


def test_uneven_keys_need_a_rate_and_damaged_files_are_refused(tmp_path: Path) -> None:
    path = glb(tmp_path / "walk.glb", times_s=KEYS_S**1.2)
    with pytest.raises(MotionError, match="keys are not evenly spaced in time; give the rate"):
        read(path, clean=False)


def write_pandas(path: Path, *, coords: str = "xyz", layout: str = "fixed", names: Any = None) -> Path:
    """The layouts that pandas writes with format="fixed" and with "table" (with PyTables)."""
    levels = [["net"], ["Eva", "Jim"], NAMES, list(coords)]
    values = np.stack([BODY_M, BODY_M + 1.0], axis=1)[..., : len(coords)].reshape(len(BODY_M), -1)
    with h5py.File(path, "w") as file:
        group = file.create_group("df_with_missing")
        if layout != "fixed":
            kind = np.dtype([("index", "i8"), ("values_block_0", "f8", (values.shape[1],))])
            gaps = {"names": kind.names, "formats": ["i8", kind[1]], "offsets": [0, 16], "itemsize": kind.itemsize + 8}
            rows = np.zeros(len(values), gaps if layout == "gaps" else kind)
            rows["values_block_0"] = values
            group["table"] = rows
            names = list(itertools.product(*levels)) if names is None else names
            group["table"].attrs["values_block_0_kind"] = np.bytes_(pickle.dumps(names, 0))
            return path
        codes = np.indices([len(level) for level in levels]).reshape(4, -1)
        for n, (level, code) in enumerate(zip(levels, codes, strict=True)):
            group[f"block0_items_level{n}"] = [text.encode() for text in level]
            group[f"block0_items_label{n}"] = code.astype("i1")
        group["block0_values"] = values
    return path


def write_sleap(path: Path, *, image: bool = False) -> Path:
    tracks = np.stack([BODY_M, BODY_M + 5.0], axis=1)
    with h5py.File(path, "w") as file:
        file["tracks"] = tracks.T[:2].swapaxes(0, 2) if image else tracks
        file["node_names"], file["track_names"] = NAMES, ["Eva", "Jim"]
    return path


@pytest.mark.parametrize(
    ("write", "options", "says"),
    [
        (lambda p: write_movement(p, axes=("time", "space", "keypoints", "individuals"), fps=RATE_HZ), {}, ""),
        (lambda p: write_movement(p, axes=("time", "individual", "keypoint", "space"), time_unit="seconds"), {}, ""),
        (lambda p: write_movement(p, axes=("time", "space", "keypoint", "individual")), {}, "no frame rate"),
        (lambda p: write_movement(p, axes=("time", "space", "keypoint", "individual"), space="xy"), {}, "Triangulate"),
        (lambda p: write_movement(p, axes=("time", "space", "keypoint", "individual"), more=1), {}, "names 34 points"),
        (write_sleap, {"rate_hz": RATE_HZ}, ""),
        (lambda p: write_sleap(p, image=True), {"rate_hz": RATE_HZ}, "image coordinates; triangulate"),
        (write_pandas, {"rate_hz": RATE_HZ}, ""),
        (write_pandas, {}, "states no frame rate; give the frame rate: rate_hz="),
        (lambda p: write_pandas(p, coords="xy"), {}, "triangulate"),
        (lambda p: write_pandas(p, layout="table"), {"rate_hz": RATE_HZ}, ""),
        (lambda p: write_pandas(p, layout="gaps"), {"rate_hz": RATE_HZ}, "compound type with gaps"),
        (lambda p: write_pandas(p, layout="table", names=[Path]), {"rate_hz": RATE_HZ}, "hold GLOBAL, not only texts"),
    ],
)
def test_keypoints_of_hdf5_files(tmp_path: Path, write: Any, options: dict[str, Any], says: str) -> None:
    path = write(tmp_path / "walk.h5")
    if says:
        with pytest.raises(MotionError, match=says):
            read(path, clean=False, units="m", **options)
        return
    with pytest.raises(MotionError, match=r"several subjects: Eva .*, Jim"):
        read(path, clean=False, units="m", **options)
    motion = read(path, clean=False, units="m", subject="Eva", **options)
    np.testing.assert_allclose(motion.position_m, BODY_M, atol=1e-9)
    assert (motion.markers, motion.rate_hz, motion.facts.subject) == (NAMES, RATE_HZ, "Eva")
