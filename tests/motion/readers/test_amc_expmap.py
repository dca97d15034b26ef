"""Exponential-map reading on files that these tests write themselves."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from doppelgait.core.errors import MotionError
from doppelgait.motion.readers import read

N_JOINTS = 38
UNIT_M = 0.05


def skeleton() -> dict[str, Any]:
    draw = np.random.default_rng(3)
    parents = [-1, *(int(draw.integers(max(0, j - 3), j)) for j in range(1, N_JOINTS))]
    return {
        "joint_names": [f"j{j}" for j in range(N_JOINTS)],
        "parents": parents,
        "offsets": [[0.0, 0.0, 0.0], *draw.normal(size=(N_JOINTS - 1, 3)).round(3).tolist()],
        "metres_per_unit": UNIT_M,
        "frame_rate_hz": 100,
        "up_axis": "y",
    }


def frames(n_frames: int = 30) -> np.ndarray:
    time = np.arange(n_frames)[:, None] / 100.0
    draw = np.random.default_rng(4)
    amplitude, phase = draw.normal(scale=0.6, size=3 * N_JOINTS), draw.uniform(0, 6, 3 * N_JOINTS)
    place = np.hstack([0 * time, 18 + 0 * time, 20 * time])
    return np.hstack([place, amplitude * np.sin(2 * np.pi * time + phase)])


def write(folder: Path, values: np.ndarray, body: dict[str, Any] | None = None, name: str = "walk.txt") -> Path:
    (folder / "skeleton.json").write_text(json.dumps(body or skeleton()))
    path = folder / name
    path.write_text("\n".join(",".join(f"{x:.9g}" for x in row) for row in values))
    return path


def test_positions_agree_with_a_row_vector_walk(tmp_path: Path) -> None:
    values, body = frames(), skeleton()
    motion = read(write(tmp_path, values), clean=False, up_axis="z")
    for t in (0, 7, 29):
        turned, place = [], []
        for j, parent in enumerate(body["parents"]):
            own = Rotation.from_rotvec(values[t, 3 + 3 * j : 6 + 3 * j]).as_matrix()
            turned.append(own @ turned[parent] if j else own)
            place.append(np.array(body["offsets"][j]) @ turned[parent] + place[parent] if j else values[t, :3])
        np.testing.assert_allclose(motion.position_m[t], np.array(place) * UNIT_M, atol=1e-7)


def test_rate_unit_and_skeleton_can_be_given(tmp_path: Path) -> None:
    path = write(tmp_path, frames())
    motion = read(path, clean=False)
    report = motion.report
    assert (motion.rate_hz, report["metres_per_unit"], report["skeleton"]) == (100.0, UNIT_M, "skeleton.json")
    body = (tmp_path / "skeleton.json").rename(tmp_path / "body.json")
    other = read(path, clean=False, units="cm", rate_hz=50.0, up_axis="y", skeleton=str(body))
    np.testing.assert_allclose(other.position_m, motion.position_m / 5)
    assert other.rate_hz == 50.0
    with pytest.raises(MotionError, match=r"walk.txt: holds joint angles only; .*skeleton="):
        read(path)


def test_a_rest_pose_in_front_is_left_out(tmp_path: Path) -> None:
    values = frames()
    values[0, 3:] = 0.0
    motion = read(write(tmp_path, values), clean=False)
    assert motion.n_frames == 29
    assert "rest pose" in motion.report["notes"][0]
    values[:, 3:6] = 0.0
    assert read(write(tmp_path, values), clean=False).positions.sizes["time"] == 30


@pytest.mark.parametrize(
    ("key", "value", "pattern"),
    [
        ("joint_names", ["a"], "parents must hold 1 indices"),
        ("parents", [-1] * N_JOINTS, "parents must hold 38 indices"),
        ("parents", [0, *range(N_JOINTS - 1)], "parents must hold 38 indices"),
        ("offsets", [[0, 0]] * N_JOINTS, "offsets.0.2: is required"),
        ("offsets", [[0, 0, 0]], "offsets must hold three numbers"),
        ("metres_per_unit", True, "metres_per_unit: True is not allowed"),
        ("frame_rate_hz", "fast", "frame_rate_hz: 'fast' is not allowed"),
        ("frame_rate_hz", None, "states no frame rate; give the frame rate: rate_hz="),
    ],
)
def test_a_wrong_skeleton_is_named(tmp_path: Path, key: str, value: object, pattern: str) -> None:
    with pytest.raises(MotionError, match=pattern) as error:
        read(write(tmp_path, frames(), {**skeleton(), key: value}))
    assert ("skeleton.json" if value is not None else "walk.txt") in str(error.value)


def test_a_skeleton_that_is_no_json_is_named(tmp_path: Path) -> None:
    path = write(tmp_path, frames())
    for text in ("{", "[]", "[" * 100_000):
        (tmp_path / "skeleton.json").write_text(text)
        with pytest.raises(MotionError, match=r"skeleton.json: the skeleton cannot be read"):
            read(path)


@pytest.mark.parametrize(
    ("row", "pattern"),
    [
        (lambda words: words[:-2], "line 5: frame 5 holds 115 values, but 117 are needed"),
        (lambda words: [*words[:-2], "\n".join(words[-2:])], "line 5: frame 5 holds 116 values"),
        (lambda words: [*words[:3], "", *words[4:]], "line 5: frame 5 holds '', which is not a finite number"),
    ],
)
def test_damaged_frames_are_named_by_line(tmp_path: Path, row: Any, pattern: str) -> None:
    path = write(tmp_path, frames())
    lines = path.read_text().split("\n")
    lines[4] = ",".join(row(lines[4].split(",")))
    path.write_text("\n".join(lines))
    with pytest.raises(MotionError, match=pattern):
        read(path)


def test_another_skeleton_is_refused(tmp_path: Path) -> None:
    body = skeleton()
    small = {**body, **{key: body[key][:32] for key in ("joint_names", "parents", "offsets")}}
    with pytest.raises(MotionError, match=r"has 117 columns, its skeleton .* of 32 joints needs 99"):
        read(write(tmp_path, frames(), small))
    assert read(write(tmp_path, frames()[:, :99], small), clean=False).positions.sizes["marker"] == 32
