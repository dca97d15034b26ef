"""From the nodes of a joint hierarchy to a motion: which nodes are points of the body, their unit and upward axis."""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import DoppelgaitWarning, MotionError
from doppelgait.motion.axes import find_up_axis, metres_per_unit, turn_z_up
from doppelgait.motion.motion import Motion, make_motion
from doppelgait.motion.readers.hierarchy import Joints
from doppelgait.motion.readers.points import by_reason
from doppelgait.motion.skeleton import guess_species, parts_of

FloatArray = npt.NDArray[np.float64]

MIN_FRAMES = 3
MAX_RATE_HZ = 10_000.0
CMU_METRES = 0.0254 / 0.45
"""Length unit of the CMU skeletons: their ASF files say ``length 0.45``, one unit is 1/0.45 inch."""
SAME_PLACE = 1e-4
"""Nodes nearer than this part of the skeleton's size in every frame are one point."""
STILL = 1e-3
"""A root that moves less than this part of the skeleton's size never moves."""
METRIC = {"m": 1.0, "cm": 0.01, "mm": 0.001}
INCHES = {"in": 0.0254, "cmu": CMU_METRES}
"""Units that only skeletons of people come in."""
SIZES_M = {"human": ((1.2, 3.0), 2.1), "dog": ((0.4, 3.2), 1.4), "": ((0.4, 3.2), 2.0)}
"""Usual and typical size of a skeleton: its longest chain of bones, from hand to toe or from nose to hind paw."""
_HELPER = re.compile(r"(?i)(nub|footsteps?|helper|dummy|effector|locator)(_end)?$")
_ROOT = re.compile(r"(?i)^(joint[_ ]?)?(root|reference|world|scene|armature)$")
_BONE = re.compile(r"^b_")


def joint_motion(
    path: Path,
    joints: Joints,
    *,
    kind: str,
    rate_hz: float,
    rate_from: str,
    unit: str | float | None,
    unit_from: str,
    up_axis: str | None,
    declared_axis: str = "y",
    subject: str = "",
    report: Mapping[str, Any] | None = None,
) -> Motion:
    """Motion of the joints that are points of the body, not cleaned.

    Parameters
    ----------
    path : Path
        The file, for messages.
    joints : Joints
        All nodes, in the file's unit and axes.
    kind : str
        Name of the format.
    rate_hz : float
        Frames per second.
    rate_from, unit_from : str
        Where rate and unit come from, for the report.
    unit : str, float or None
        Name of the length unit or metres per unit; None to find it from the size of the skeleton.
    up_axis : str or None
        Upward axis as the caller wants it; None to find it.
    declared_axis : str
        Axis letter that points up by the convention of the format.
    subject : str
        Person or animal, where known.
    report : mapping, optional
        More to report.

    Raises
    ------
    MotionError
        If there are too few frames, no points, or an option is not allowed.
    """
    rate = _checked_rate(path, rate_hz, rate_from)
    _check_positions(path, joints.position)
    reasons = sort_joints(joints, skeleton_size(joints.parents, bone_lengths(joints)))
    kept = [j for j in range(len(joints.names)) if j not in reasons]
    if not kept:
        raise MotionError(f"{path}: holds no joints of a body: {', '.join(sorted(set(reasons.values())))}")
    names = _unique([joints.names[j].strip() or f"point_{j + 1}" for j in kept])
    parts = parts_of(names)
    kind_of_body = guess_species(joints.names)
    unit_facts = _unit(path, skeleton_size(*_kept_tree(joints, kept)), unit, unit_from, kind_of_body)
    position = joints.position[:, kept] * unit_facts["metres_per_unit"]
    # a dog that sits or lies does not tell by its parts what is up
    axis_facts = _axis(position, parts if kind_of_body == "human" else [""] * len(parts), up_axis, declared_axis)
    facts = {
        "format": kind,
        "frame_rate_hz": rate,
        "frame_rate_from": rate_from,
        "n_frames": len(position),
        "points_in_file": len(joints.names),
        **unit_facts,
        **axis_facts,
        **(report or {}),
        "dropped": by_reason(joints.names, reasons),
    }
    return make_motion(
        _to_z_up(position, axis_facts["up_axis"]),
        rate_hz=rate,
        markers=names,
        parts=parts,
        facts={
            "source": path.name,
            "kind": "recording",
            "subject": subject,
            "species": _sure_species(joints.names, kind_of_body),
        },
        report=facts,
    )


def _check_positions(path: Path, position: FloatArray) -> None:
    if len(position) < MIN_FRAMES:
        raise MotionError(
            f"{path}: holds {len(position)} frame(s), a static pose; a motion needs {MIN_FRAMES} or more, because a "
            "velocity cannot be formed from fewer"
        )
    if not np.isfinite(position).all():
        raise MotionError(f"{path}: holds offsets or positions that are too large to be those of a body")


def sort_joints(joints: Joints, size: float) -> dict[int, str]:
    """Reason why a node is no point of the body, by index; nodes that are have no entry.

    Parameters
    ----------
    joints : Joints
        All nodes.
    size : float
        Of the skeleton, in the file's unit.
    """
    reasons = {j: "rig helper (by its name)" for j, name in enumerate(joints.names) if _HELPER.search(name)}
    bones = [j for j, name in enumerate(joints.names) if _BONE.match(name)]
    # 3ds Max rigs call the bones that carry the body b_...; what else is there drives them or hangs on them
    if 2 * len(bones) > len(joints.names):
        others = set(range(len(joints.names))) - set(bones)
        reasons |= {j: "rig helper (not one of the b_ bones)" for j in sorted(others - set(reasons))}
    reasons |= _root_without_body(joints, reasons, size)
    return reasons | _same_place(joints, [j for j in range(len(joints.names)) if j not in reasons], size)


def _root_without_body(joints: Joints, reasons: Mapping[int, str], size: float) -> dict[int, str]:
    """The root, where it only carries the body: one joint, at a distance, and it never moves or says so by its name."""
    children = [j for j, parent in enumerate(joints.parents) if parent == 0 and j not in reasons]
    if len(children) != 1 or len(joints.names) < 3 or 0 in reasons:
        return {}
    root = joints.position[:, 0]
    if np.linalg.norm(joints.position[:, children[0]] - root, axis=1).max() < SAME_PLACE * size:
        return {}
    if _ROOT.match(joints.names[0]):
        return {0: "root node, no joint of the body (by its name)"}
    still = np.linalg.norm(np.ptp(root, axis=0)) < STILL * size
    moves = np.linalg.norm(np.ptp(joints.position[:, children[0]], axis=0)) >= STILL * size
    return {0: "root node, no joint of the body (it never moves)"} if still and moves else {}


def _same_place(joints: Joints, kept: Sequence[int], size: float) -> dict[int, str]:
    """Nodes that lie on an earlier one in every frame."""
    reasons: dict[int, str] = {}
    first = joints.position[0]
    for n, j in enumerate(kept):
        near = np.linalg.norm(first[list(kept[:n])] - first[j], axis=1) <= SAME_PLACE * size
        for i in (i for i, close in zip(kept, near, strict=False) if close and i not in reasons):
            gap = np.linalg.norm(joints.position[:, i] - joints.position[:, j], axis=1).max()
            if gap <= SAME_PLACE * size:
                reasons[j] = f"same place as {joints.names[i]}"
                break
    return reasons


def bone_lengths(joints: Joints) -> FloatArray:
    """Median distance of each node from its parent in the file's unit, shape (J,); 0 for the root."""
    parents = np.array([max(parent, 0) for parent in joints.parents])
    lengths = np.median(np.linalg.norm(joints.position - joints.position[:, parents], axis=2), axis=0)
    return np.where(np.array(joints.parents) < 0, 0.0, lengths)


def skeleton_size(parents: Sequence[int], lengths: FloatArray) -> float:
    """Longest way from one end of a hierarchy to another along its bones, whatever the pose.

    Parameters
    ----------
    parents : sequence of int, length J
        A parent comes before its children; -1 for a root.
    lengths : ndarray, shape (J,)
        Of each node's bone.
    """
    depth = np.zeros(len(parents))
    size = 0.0
    for j in range(len(parents) - 1, -1, -1):
        parent = parents[j]
        size = max(size, float(depth[j]))
        if parent >= 0:
            way = float(depth[j] + lengths[j])
            size = max(size, float(depth[parent]) + way)
            depth[parent] = max(float(depth[parent]), way)
    return size


def _kept_tree(joints: Joints, kept: Sequence[int]) -> tuple[list[int], FloatArray]:
    """Parents and bone lengths among the kept nodes; where all ancestors were dropped, the first kept node is taken."""
    number = {j: n for n, j in enumerate(kept)}
    parents: list[int] = []
    for n, j in enumerate(kept):
        parent = joints.parents[j]
        while parent >= 0 and parent not in number:
            parent = joints.parents[parent]
        parents.append(number[parent] if parent >= 0 else min(n, 1) - 1)
    tree = Joints(tuple(joints.names[j] for j in kept), tuple(parents), joints.position[:, list(kept)])
    return parents, bone_lengths(tree)


def _checked_rate(path: Path, rate_hz: float, rate_from: str) -> float:
    rate = float(rate_hz)
    if not 0.0 < rate <= MAX_RATE_HZ:
        raise MotionError(
            f"{path}: the frame rate of {rate:g} Hz ({rate_from}) must be above 0 and at most {MAX_RATE_HZ:g} Hz. "
            "Give the true one: rate_hz=..."
        )
    return rate


def _unit(path: Path, size: float, unit: str | float | None, unit_from: str, species: str) -> dict[str, Any]:
    """Length unit and what to report about it; the size of the skeleton decides where the file does not."""
    if unit is None:
        return _guess_unit(path, size, species)
    if isinstance(unit, str):
        name, metres = unit, CMU_METRES if unit.lower() == "cmu" else metres_per_unit(unit, where=str(path))
    else:
        name, metres = f"{unit:.6g} m", float(unit)
    low, high = SIZES_M[species][0]
    if not low / 2.0 < size * metres < 2.0 * high:
        _warn(
            f"{path}: with {name} ({unit_from}) the skeleton measures {size * metres:.3g} m along its bones, usual are "
            f"{low:g} to {high:g} m. If that is wrong, give the unit: units='cm', 'm', 'in', 'mm' or 'cmu'."
        )
    return {"length_unit": name, "metres_per_unit": metres, "length_unit_from": unit_from}


def _guess_unit(path: Path, size: float, species: str) -> dict[str, Any]:
    """The unit that makes the skeleton most nearly as large as is typical; it warns where that is not certain: where
    others fit too, none fits, or the names do not tell what body it is.
    """
    (low, high), typical = SIZES_M[species]
    known = METRIC if species == "dog" else METRIC | INCHES
    fits = [name for name, metres in known.items() if low <= size * metres <= high]
    best = min(known, key=lambda name: abs(np.log(max(size, 1e-300) * known[name] / typical)))
    if fits != [best] or not species:
        others = f"; {' or '.join(name for name in fits if name != best)} is possible too" if set(fits) - {best} else ""
        _warn(
            f"{path}: names no length unit and its skeleton measures {size:.4g} along its bones, so {best} is taken"
            f"{others}. If that is wrong, give the unit: units='cm', 'm', 'in', 'mm' or 'cmu' (1/0.45 inch)."
        )
    return {"length_unit": best, "metres_per_unit": known[best], "length_unit_from": "size of the skeleton"}


def _axis(position: FloatArray, parts: Sequence[str], up_axis: str | None, declared: str) -> dict[str, str]:
    if up_axis is not None:
        return {"up_axis": up_axis, "up_axis_from": "option"}
    found = find_up_axis(position, parts, declared=declared)
    return {**found, "up_axis_from": "convention" if found["up_axis_from"] == "file" else found["up_axis_from"]}


def _to_z_up(position: FloatArray, up_axis: str) -> FloatArray:
    """Rotate to z up; y-up skeletons face along z, which becomes x, as in the C3D files of the same recordings."""
    return position[..., [2, 0, 1]] if up_axis == "y" else turn_z_up(position, up_axis)


def _sure_species(names: Sequence[str], kind_of_body: str) -> str:
    """Species where the names leave no doubt: those of a person, or of an animal that is called a dog."""
    called_dog = any(re.search(r"(?i)(^|[^a-z])dog([^a-z]|$)", name) for name in names)
    return "" if kind_of_body == "dog" and not called_dog else kind_of_body


def _unique(names: Sequence[str]) -> list[str]:
    found: list[str] = []
    for name in names:
        number, wanted = 2, name
        while wanted in found:
            wanted, number = f"{name}_{number}", number + 1
        found.append(wanted)
    return found


def _warn(text: str) -> None:
    warnings.warn(text, DoppelgaitWarning, stacklevel=6)
