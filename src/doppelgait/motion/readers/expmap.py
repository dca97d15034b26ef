"""Exponential-map text files with their skeleton.

The CMU and Human3.6M motions of motion-prediction studies have this form.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from doppelgait.core.documents import parse_json
from doppelgait.core.errors import MotionError
from doppelgait.core.plugins import plugin
from doppelgait.motion.motion import Motion
from doppelgait.motion.readers.joints import (
    REST_POSE_NOTE,
    Joints,
    check_skeleton_cost,
    forward_kinematics,
    has_rest_pose,
    make_joint_motion,
    make_vector_rotations,
)
from doppelgait.motion.readers.text import parse_rows, read_text

FloatArray = npt.NDArray[np.float64]

COLUMNS = (99, 117)
"""Values in a frame: a translation and a rotation vector for each of 32 (Human3.6M) or 38 (CMU) joints."""
SKELETON = "skeleton.json"


@dataclass(frozen=True)
class ExpmapSkeleton:
    """Skeleton that defines the meaning of a file's numbers. Shapes: offsets (J, 3)."""

    joint_names: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: FloatArray
    metres_per_unit: float | None
    frame_rate_hz: float | None
    up_axis: str


def sniff_expmap(path: Path, head: bytes) -> bool:
    """Return True if the first line has 99 or 117 numbers."""
    words = head.removeprefix(b"\xef\xbb\xbf").lstrip().split(b"\n", 1)[0].rstrip(b"\r").split(b",")
    try:
        return len(words) in COLUMNS and all(np.isfinite(float(word)) for word in words)
    except ValueError:
        return False


@plugin("motion_reader", "expmap", sniff=sniff_expmap, suffixes=(".txt",))
def read_expmap(
    path: Path,
    *,
    skeleton: str | Path | None = None,
    units: str | None = None,
    up_axis: str | None = None,
    rate_hz: float | None = None,
) -> Motion:
    """Read the joints of an exponential-map recording, not cleaned."""
    # a rest pose before the recording is left out
    file = path.with_name(SKELETON) if skeleton is None else Path(skeleton)
    if not file.is_file():
        raise MotionError(
            f"{path}: holds joint angles only; a skeleton with joint_names, parents and offsets is needed, and "
            f"there is no {file}. Put it there or give it: skeleton='FILE.json'"
        )
    body = _read_expmap_skeleton(file)
    text = read_text(path)
    n_joints = len(body.parents)
    columns = text.lstrip().split("\n", 1)[0].count(",") + 1
    if columns != 3 + 3 * n_joints:
        raise MotionError(
            f"{path}: has {columns} columns, its skeleton {file} of {n_joints} joints needs {3 + 3 * n_joints}. Give "
            "the right one: skeleton='FILE.json'"
        )
    values = parse_rows(path, text, 0, n_columns=columns, separator=",")
    check_skeleton_cost(path, n_joints, len(values))
    # compute the positions (T, J, 3) of all joints
    expmap_n_joints = len(body.parents)
    vectors = values[:, 3:].reshape(len(values), expmap_n_joints, 3).swapaxes(0, 1)
    translation = np.repeat(body.offsets[:, np.newaxis], len(values), axis=1)
    translation[0] = values[:, :3]
    position = forward_kinematics(body.parents, translation, make_vector_rotations(-vectors))
    rest_pose = has_rest_pose(values[:, 3:6], position)
    rate = body.frame_rate_hz if rate_hz is None else rate_hz
    if rate is None:
        raise MotionError(f"{file}: states no frame_rate_hz; give the rate: rate_hz=...")
    return make_joint_motion(
        path,
        Joints(body.joint_names, body.parents, position[1:] if rest_pose else position),
        kind="expmap",
        rate_hz=rate,
        rate_from="skeleton" if rate_hz is None else "option",
        unit=body.metres_per_unit if units is None else units,
        unit_from="skeleton" if units is None else "option",
        up_axis=up_axis,
        declared_axis=body.up_axis,
        report={"skeleton": file.name},
        notes=[REST_POSE_NOTE] if rest_pose else [],
    )


def _read_expmap_skeleton(path: Path) -> ExpmapSkeleton:
    """Read and check a skeleton in JSON."""
    try:
        content = parse_json(read_text(path))
    except (OSError, ValueError) as error:
        raise MotionError(f"{path}: the skeleton cannot be read: {error}") from None
    if not isinstance(content, dict):
        raise MotionError(f"{path}: the skeleton must be an object with joint_names, parents and offsets")
    names = content.get("joint_names")
    if not isinstance(names, list) or not names or not all(isinstance(name, str) for name in names):
        raise MotionError(f"{path}: joint_names must be a list of names")
    parents = content.get("parents")
    if not (
        isinstance(parents, list)
        and len(parents) == len(names)
        and all(type(parent) is int for parent in parents)
        and parents[0] == -1
        and all(0 <= parent < j for j, parent in enumerate(parents) if j)
    ):
        raise MotionError(
            f"{path}: parents must hold {len(names)} indices, -1 for the first joint and a smaller index for any other"
        )
    try:
        offsets = np.array(content.get("offsets"), dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        offsets = np.empty(0)
    if offsets.shape != (len(names), 3) or not np.isfinite(offsets).all():
        raise MotionError(f"{path}: offsets must hold three numbers for each of the {len(names)} joints")
    up_axis = content.get("up_axis", "y")
    if up_axis not in ("x", "y", "z"):
        raise MotionError(f"{path}: up_axis is {up_axis!r}; allowed are 'x', 'y' and 'z'")
    positive: list[float | None] = []
    for key in ("metres_per_unit", "frame_rate_hz"):
        value = content.get(key)
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if value is not None and not (number and 0.0 < value < float("inf")):
            raise MotionError(f"{path}: {key} is {value!r}; it must be a number above 0")
        positive.append(None if value is None else float(value))
    return ExpmapSkeleton(tuple(names), tuple(parents), offsets, positive[0], positive[1], up_axis)
