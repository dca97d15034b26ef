"""Joint hierarchies: forward kinematics and length unit.

Vectors are columns: a child's frame is ``G_child = G_parent @ R_child`` and its origin
``p_child = p_parent + G_parent @ t_child``.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from doppelgait.core.documents import check_cost
from doppelgait.core.errors import MotionError, warn_caller
from doppelgait.core.units import FloatArray
from doppelgait.motion.readers.points import (
    BodyPoints,
    LengthUnit,
    check_amount,
    check_labels,
    convert_unit_to_metres,
    make_names_unique,
)
from doppelgait.motion.skeleton import find_parts, guess_species


def make_euler_rotations(axes: str, angles_rad: FloatArray) -> FloatArray:
    """Multiply axis rotations, ``R_axes[0] @ R_axes[1] @ ...``. Shapes: angles_rad (..., n); returns (..., 3, 3)."""
    # the last axis rotates a vector first; SciPy takes twice the time
    rotation = np.broadcast_to(np.eye(3), (*angles_rad.shape[:-1], 3, 3))
    for n, axis in enumerate(axes):
        turn = np.zeros(rotation.shape)
        k = "xyz".index(axis)
        i, j = (k + 1) % 3, (k + 2) % 3
        turn[..., k, k] = 1.0
        turn[..., i, i] = turn[..., j, j] = np.cos(angles_rad[..., n])
        turn[..., j, i] = np.sin(angles_rad[..., n])
        turn[..., i, j] = -turn[..., j, i]
        rotation = rotation @ turn if n else turn
    return rotation


def forward_kinematics(parents: Sequence[int], translation: FloatArray, rotation: FloatArray) -> FloatArray:
    """Compute the positions of all nodes of a hierarchy."""
    # p_j = p_parent + G_parent @ t_j, G_j = G_parent @ R_j
    position = np.array(translation)
    frame = np.array(rotation)
    with np.errstate(over="ignore", invalid="ignore"):  # invalid values of a damaged file; its reader checks the result
        for j, parent in enumerate(parents):
            if parent >= 0:
                position[j] = position[parent] + (frame[parent] @ translation[j, :, :, None])[..., 0]
                frame[j] = frame[parent] @ rotation[j]
    return np.ascontiguousarray(position.transpose(1, 0, 2))


POSE_BYTES = 240
"""Bytes of a joint in a frame: position and rotation, in the parent's frame and in that of the body, as doubles."""


def check_skeleton_cost(path: Path, n_joints: int, n_frames: int) -> None:
    """Refuse a hierarchy with poses that take too much memory."""
    # joints without values take no space in the file
    check_cost(path, POSE_BYTES * n_joints * n_frames, MotionError, what=f"{n_joints:,} joints in {n_frames:,} frames")


def has_rest_pose(root_rotation: FloatArray, position: FloatArray) -> bool:
    """Return True if the first frame is a rest pose. Shapes: root_rotation (T, k); position (T, J, 3)."""
    # conversions of the CMU database have one
    if len(position) < 3 or root_rotation[0].any() or not root_rotation[1].any():
        return False
    step = np.linalg.norm(np.diff(position, axis=0), axis=2).max(axis=1)
    return bool(step[0] > 5.0 * np.median(step[1:]))


REST_POSE_NOTE = "frame 0 is a rest pose put in front of the recording; left out"


CMU_METRES = 0.0254 / 0.45
"""Length unit of the CMU skeletons: their ASF files state ``length 0.45``, so that one unit is 1/0.45 inch."""
SAME_PLACE = 1e-4  # maximum distance of two nodes that are one point, relative to the skeleton's size
STILL = 1e-3  # minimum movement of a root that moves, relative to the skeleton's size
METRIC = {"m": 1.0, "cm": 0.01, "mm": 0.001}
INCHES = {"in": 0.0254, "cmu": CMU_METRES}  # units that only skeletons of people have
SIZES_M = {"human": ((1.2, 3.0), 2.1), "dog": ((0.4, 3.2), 1.4), "": ((0.4, 3.2), 2.0)}
"""Usual and typical size of a skeleton: its longest chain of bones, from hand to toe or from nose to hind paw."""
_HELPER = re.compile(r"(?i)(nub|footsteps?|helper|dummy|effector|locator)(_end)?$")
_ROOT = re.compile(r"(?i)^(joint[_ ]?)?(root|reference|world|scene|armature)$")
_BONE = re.compile(r"^b_")


def pick_joints(path: Path, names: Sequence[str], parents: Sequence[int], position: FloatArray) -> BodyPoints:
    """Select the joints that are points of the body. Shapes: position (T, J, 3)."""
    check_labels(path, names)
    check_amount(path, len(position))
    if not (np.abs(position) < 1e100).all():  # squares of larger ones overflow
        raise MotionError(f"{path}: holds offsets or positions that are too large to be those of a body")
    # reasons to leave out a node
    size = measure_skeleton(parents, _measure_bone_lengths(parents, position))
    reasons = {j: "rig helper (by its name)" for j, name in enumerate(names) if _HELPER.search(name)}
    bones = [j for j, name in enumerate(names) if _BONE.match(name)]
    # the bones of the body have names b_... in 3ds Max rigs; other nodes control them or are attached to them
    if 2 * len(bones) > len(names):
        others = set(range(len(names))) - set(bones)
        reasons |= {j: "rig helper (not one of the b_ bones)" for j in sorted(others - set(reasons))}
    # the root, if it is not a joint of the body: one child at a distance, and it never moves or has such a name
    children = [j for j, parent in enumerate(parents) if parent == 0 and j not in reasons]
    if len(children) == 1 and len(names) >= 3 and 0 not in reasons:
        root, child = position[:, 0], position[:, children[0]]
        if np.linalg.norm(child - root, axis=1).max() >= SAME_PLACE * size:
            still = np.linalg.norm(np.ptp(root, axis=0)) < STILL * size
            if _ROOT.match(names[0]):
                reasons[0] = "root node, no joint of the body (by its name)"
            elif still and np.linalg.norm(np.ptp(child, axis=0)) >= STILL * size:
                reasons[0] = "root node, no joint of the body (it never moves)"
    # nodes that coincide with an earlier one in every frame
    rest = [j for j in range(len(names)) if j not in reasons]
    for n, j in enumerate(rest):
        near = np.linalg.norm(position[0, rest[:n]] - position[0, j], axis=1) <= SAME_PLACE * size
        for i in (i for i, close in zip(rest, near, strict=False) if close and i not in reasons):
            if np.linalg.norm(position[:, i] - position[:, j], axis=1).max() <= SAME_PLACE * size:
                reasons[j] = f"same place as {names[i]}"
                break
    kept = [j for j in range(len(names)) if j not in reasons]
    if not kept:
        raise MotionError(f"{path}: holds no joints of a body: {', '.join(sorted(set(reasons.values())))}")
    points = make_names_unique([names[j].strip() or f"point_{j + 1}" for j in kept])
    species = guess_species(names)
    if species == "dog" and not any(re.search(r"(?i)(^|[^a-z])dog([^a-z]|$)", name) for name in names):
        species = ""  # joint names of an animal fit several species; those of a person are unambiguous
    return BodyPoints(names, kept, points, find_parts(points), reasons, species=species, is_skeleton=True)


def _measure_bone_lengths(parents: Sequence[int], position: FloatArray) -> FloatArray:
    """Return each node's median distance from its parent, in the unit of the file; 0 for the root."""
    above = np.array([max(parent, 0) for parent in parents])
    lengths = np.median(np.linalg.norm(position - position[:, above], axis=2), axis=0)
    return np.where(np.array(parents) < 0, 0.0, lengths)


def measure_skeleton(parents: Sequence[int], lengths: FloatArray) -> float:
    """Return the longest path along the bones. Shapes: lengths (J,)."""
    # the path is from one end to another and does not depend on the pose
    depth = np.zeros(len(parents))
    size = 0.0
    for j in range(len(parents) - 1, -1, -1):
        parent = parents[j]
        size = max(size, float(depth[j]))
        if parent >= 0:
            length = float(depth[j] + lengths[j])
            size = max(size, float(depth[parent]) + length)
            depth[parent] = max(float(depth[parent]), length)
    return size


def connect_kept(parents: Sequence[int], kept: Sequence[int]) -> list[int]:
    """Return the next kept ancestor of each kept node, or the first."""
    number = {j: n for n, j in enumerate(kept)}
    above: list[int] = []
    for n, j in enumerate(kept):
        parent = parents[j]
        while parent >= 0 and parent not in number:
            parent = parents[parent]
        above.append(number[parent] if parent >= 0 else min(n, 1) - 1)
    return above


def find_skeleton_unit(
    path: Path,
    body: BodyPoints,
    parents: Sequence[int],
    position: FloatArray,
    unit: str | float | None,
    unit_from: str,
) -> LengthUnit:
    """Return the stated length unit, or guess it. Shapes: position (T, J, 3)."""
    above = connect_kept(parents, body.kept)
    size = measure_skeleton(above, _measure_bone_lengths(above, position[:, body.kept]))
    species = guess_species(body.labels)
    (low, high), typical = SIZES_M[species]
    if unit is not None:
        if isinstance(unit, str):
            name, metres = unit, CMU_METRES if unit.lower() == "cmu" else convert_unit_to_metres(unit, where=str(path))
        else:
            name, metres = f"{unit:.6g} m", float(unit)
        if not low / 2.0 < size * metres < 2.0 * high:
            warn_caller(
                f"{path}: with {name} ({unit_from}) the skeleton measures {size * metres:.3g} m along its bones; usual "
                f"are {low:g} to {high:g} m. If that is wrong, give the unit: units='cm', 'm', 'in', 'mm' or 'cmu'."
            )
        return LengthUnit(name, metres, unit_from)
    known = METRIC if species == "dog" else METRIC | INCHES
    fits = [name for name, metres in known.items() if low <= size * metres <= high]
    best = min(known, key=lambda name: abs(np.log(max(size, 1e-300) * known[name] / typical)))
    if fits != [best] or not species:
        others = f"; {' or '.join(name for name in fits if name != best)} also fits" if set(fits) - {best} else ""
        warn_caller(
            f"{path}: names no length unit and its skeleton measures {size:.4g} along its bones; {best} is assumed"
            f"{others}. If that is wrong, give the unit: units='cm', 'm', 'in', 'mm' or 'cmu' (1/0.45 inch)."
        )
    return LengthUnit(best, known[best], "size of the skeleton")
