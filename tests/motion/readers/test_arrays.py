"""npz and JSON joint positions that these tests write themselves."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from doppelgait.core.errors import DoppelgaitWarning, MotionError
from doppelgait.motion.readers import read
from doppelgait.motion.readers.arrays import read_skeletons
from doppelgait.motion.skeleton import HUMAN_PARTS
from walking_body import NAMES, walking_body

BODY_M = walking_body()


def write(path: Path, **content: Any) -> Path:
    """One file, npz or JSON by its ending; entries that are None are left out."""
    content = {"positions": BODY_M, "names": NAMES, "rate_hz": 100.0, "units": "m", **content}
    content = {name: value for name, value in content.items() if value is not None}
    if path.suffix == ".npz":
        np.savez_compressed(path, **content)
    else:
        plain = {name: np.asarray(v).tolist() if isinstance(v, np.ndarray) else v for name, v in content.items()}
        path.write_text(json.dumps(plain))
    return path


@pytest.fixture(params=["w.npz", "w.json"])
def file(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    return tmp_path / request.param


@pytest.mark.parametrize(("unit", "metres"), [("mm", 1e-3), ("cm", 1e-2), ("m", 1.0), ("in", 0.0254)])
def test_units_give_the_same_motion(file: Path, unit: str, metres: float) -> None:
    motion = read(write(file, positions=BODY_M / metres, units=unit), clean=False)
    np.testing.assert_allclose(motion.position_m, BODY_M, atol=1e-12)
    assert (motion.markers, motion.rate_hz) == (NAMES, 100.0)
    report = motion.report
    assert (report["format"], report["length_unit"], report["up_axis"]) == (file.suffix[1:], unit, "z")
    other = read(write(file, positions=BODY_M / metres, units=None), clean=False, units=unit)
    np.testing.assert_allclose(other.position_m, BODY_M, atol=1e-12)


@pytest.mark.parametrize("position_key", ["positions", "joints", "Jtr"])
@pytest.mark.parametrize("rate_key", ["rate_hz", "mocap_framerate", "mocap_frame_rate", "fps"])
def test_keys(file: Path, position_key: str, rate_key: str) -> None:
    content = {"positions": None, "rate_hz": None, position_key: BODY_M, rate_key: 120, "markers": BODY_M + 1.0}
    motion = read(write(file, **content), clean=False)
    assert motion.rate_hz == 120.0
    np.testing.assert_allclose(motion.position_m, BODY_M, atol=1e-12)
    motion = read(file, clean=False, key="markers", rate_hz=50.0)
    np.testing.assert_allclose(motion.position_m, BODY_M + 1.0, atol=1e-12)
    assert motion.rate_hz == 50.0
    with pytest.raises(MotionError, match=r"has no key 'dots'; it holds .*markers"):
        read(file, clean=False, key="dots")


def test_gaps(file: Path) -> None:
    body: Any = BODY_M.copy()
    body[3, 2, 1] = np.nan
    if file.suffix == ".json":
        body = body.tolist()
        body[3][2] = [None, None, None]
    motion = read(write(file, positions=body), clean=False)
    assert np.argwhere(np.isnan(motion.position_m).any(axis=2)).tolist() == [[3, 2]]
    assert np.isnan(motion.position_m[3, 2]).all()


def column(skeleton: str, shape: tuple[int, ...]) -> np.ndarray:
    """A column of joints, y up, the head highest, that moves along x."""
    height = {"head": 1.6, "torso": 1.2, "forearm": 1.0, "hand": 0.9, "arm": 1.1, "thigh": 0.5, "shank": 0.1}
    parts = [*read_skeletons()[skeleton][1].values()][: shape[1]]
    body = np.zeros(shape)
    body[:, :, 0] = 0.05 * np.arange(shape[0])[:, None]
    body[:, :, 1] = [next((h for word, h in height.items() if part.endswith(word)), 0.05) for part in parts]
    return body


@pytest.mark.parametrize("n_joints", [22, 24])
def test_smpl_joints_only_when_asked(file: Path, n_joints: int) -> None:
    write(file, positions=column("smpl", (30, n_joints, 3))[..., [2, 0, 1]], names=None)
    motion = read(file, clean=False, skeleton="smpl")
    assert motion.markers == list(read_skeletons()["smpl"][1])[:n_joints]
    assert motion.positions.part.sel(marker="left_wrist").item() == "left_forearm"
    assert motion.report["up_axis_from"] == "body parts"
    with pytest.warns(DoppelgaitWarning, match=f"none of its {n_joints} points.*'smpl'"):
        bare = read(file, clean=False, up_axis="z")
    assert bare.markers == [f"point_{i + 1}" for i in range(n_joints)]
    assert set(bare.parts) == {""}


def test_smpl_joints_are_those_of_the_published_order() -> None:
    # parents of the SMPL tree (Loper et al. 2015): every joint follows the one that carries it
    parents = [-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21]
    names = list(read_skeletons()["smpl"][1])
    spine = "spine3 spine2 spine1 pelvis"
    for chain in (
        "left_foot left_ankle left_knee left_hip pelvis",
        f"right_hand right_wrist right_elbow right_shoulder right_collar {spine}",
        f"head neck {spine}",
    ):
        joints = chain.split()
        carriers = [names[parents[names.index(joint)]] for joint in joints[:-1]]
        assert carriers == joints[1:]
    for counts, parts in read_skeletons().values():
        assert (max(counts), set(parts.values()) <= set(HUMAN_PARTS)) == (len(parts), True)


@pytest.mark.parametrize(
    ("shape", "options", "says"),
    [
        ((30, 22, 3), {"rate_hz": 20.0, "skeleton": "smpl"}, ""),
        ((30, 17, 3), {"rate_hz": 20.0, "skeleton": "h36m"}, ""),
        ((30, 33, 4), {"rate_hz": 20.0, "skeleton": "mediapipe"}, ""),
        ((30, 22, 3), {}, "names no frame rate .*rate_hz="),
        ((30, 17, 3), {"rate_hz": 20.0, "skeleton": "smpl"}, r"known are .*'h36m' \(17\)"),
        ((30, 263), {"rate_hz": 20.0, "skeleton": "smpl"}, "263 features of a motion model"),
        ((22, 3), {"rate_hz": 20.0}, r"has the shape \(22, 3\)"),
    ],
)
def test_joints_in_npy_files(tmp_path: Path, shape: tuple[int, ...], options: dict[str, Any], says: str) -> None:
    path = tmp_path / "w.npy"
    body = np.zeros(shape) if says else column(options["skeleton"], shape)
    np.save(path, body.astype(np.float32))
    if says:
        with pytest.raises(MotionError, match=says):
            read(path, clean=False, **options)
        return
    motion = read(path, clean=False, units="m", **options)
    np.testing.assert_allclose(motion.position_m[..., 2], body[..., 1], atol=1e-6)
    assert (motion.markers, motion.rate_hz) == (list(read_skeletons()[options["skeleton"]][1])[: shape[1]], 20.0)


def test_body_model_parameters_alone_are_refused_with_the_way_out(tmp_path: Path) -> None:
    path = tmp_path / "amass.npz"
    np.savez(path, poses=np.zeros((50, 156)), trans=np.zeros((50, 3)), betas=np.zeros(16), mocap_framerate=120.0)
    with pytest.raises(MotionError, match=r"SMPL body model.*cannot be posed without that model.*smplx.*numpy\.savez"):
        read(path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"rate_hz": None}, "names no frame rate .*rate_hz="),
        ({"rate_hz": 0.0}, "rate_hz declares a frame rate of 0 Hz"),
        ({"rate_hz": "fast"}, "rate_hz declares a frame rate of 'fast' Hz"),
        ({"fps": 60.0}, "states rate_hz=100 and fps=60; give the true one"),
        ({"units": "furlong"}, "'furlong' is not a known unit of length; set units to"),
        ({"units": 3.0}, "units is 3.0; it must be text"),
        ({"names": NAMES[:-1]}, "names holds 15 entries for 16 points"),
        ({"positions": BODY_M[:, :, :2]}, r"'positions' has the shape \(40, 16, 2\)"),
        ({"positions": BODY_M.reshape(40, -1)}, r"'positions' has the shape \(40, 48\)"),
        ({"positions": BODY_M[:, :1], "names": ["a"]}, r"holds 1 point\(s\)"),
        ({"positions": BODY_M[:2]}, r"holds 2 frame\(s\)"),
        ({"joints": BODY_M}, "holds positions and joints; name the array of positions: key="),
        (
            {"names": None, "skeleton": "smpl"},
            r"16 points, not those of skeleton='smpl'; known are 'smpl' \(22 or 24\)",
        ),
        ({"names": None, "skeleton": "bones"}, "skeleton='bones' is not allowed"),
        ({"skeleton": "smpl"}, r"names its points \(names\); leave out skeleton"),
        ({"positions": None, "dots": BODY_M}, "has no array of positions.*it holds .*dots.*key="),
    ],
)
def test_what_is_wrong_is_named(file: Path, content: dict[str, Any], message: str) -> None:
    options = {"skeleton": content["skeleton"]} if "skeleton" in content else {}
    with pytest.raises(MotionError, match=message) as error:
        read(write(file, **content), clean=False, **options)
    assert file.name in str(error.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"rate_hz": 10,\n "positions": [[1, 2}', "line 2 column"),
        ('{"rate_hz": 10, "positions": [[[0,0,0]],[[0,0,0]],[[0,0,0],[1,1,1]]]}', r"positions\[2\] holds 2 points"),
        (
            '{"rate_hz": 10, "positions": [[[0,0,0]],[[0,0]],[[0,0,0]]]}',
            r"positions\[1\]\[0\] is not a list of x, y and z",
        ),
        ('{"rate_hz": 10, "positions": [[[0,0,"1.5"]]]}', r"positions\[0, 0, 2\] holds '1.5'; write a number"),
        ('{"rate_hz": 10, "positions": {"a": 1}}', "'positions' is not an array of numbers"),
        ('{"rate_hz": 10, "positions": null}', "'positions' has the shape"),
        ('{"positions": ' + "[" * 100_000, "not JSON"),
    ],
)
def test_damaged_json(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "w.json"
    path.write_text(text)
    with pytest.raises(MotionError, match=message):
        read(path, clean=False)


def test_pickled_objects_are_never_loaded(tmp_path: Path) -> None:
    path = tmp_path / "w.npz"
    np.savez(path, positions=np.array([{"a": 1}], dtype=object), rate_hz=10.0)
    with pytest.raises(MotionError, match="holds Python objects, which are never unpickled"):
        read(path, clean=False)
    np.savez(path, positions=BODY_M, rate_hz=100.0, units="m", extra=np.array([{"a": 1}], dtype=object))
    assert read(path, clean=False).positions.sizes["marker"] == 16
