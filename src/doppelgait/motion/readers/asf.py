"""ASF skeletons (Acclaim): bones with their direction, length and axes, and which hangs on which."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import MotionError
from doppelgait.motion.readers.cells import read_text
from doppelgait.motion.readers.hierarchy import euler_rotations

FloatArray = npt.NDArray[np.float64]
Section = list[tuple[int, list[str]]]
"""Statements: line number and words."""

INCH_M = 0.0254
MAX_BONES = 1000


@dataclass(frozen=True)
class Bone:
    """A bone; its point is its far end.

    Parameters
    ----------
    name : str
        ``"root"`` for the root, whose length is 0.
    parent : int
        Index of the bone that it hangs on, -1 for the root.
    vector : ndarray, shape (3,)
        From its beginning to its end in the rest pose, in the file's unit.
    axes : ndarray, shape (3, 3)
        Rotation of the frame in which its angles are given.
    order : str
        Axis letters, the one that turns first in front.
    freedoms : tuple of str
        What its values in a motion mean: ``"rx"``, ``"ry"``, ``"rz"``, for the root also ``"tx"``, ``"ty"``, ``"tz"``.
    """

    name: str
    parent: int
    vector: FloatArray
    axes: FloatArray
    order: str
    freedoms: tuple[str, ...]


@dataclass(frozen=True)
class Skeleton:
    """An ASF skeleton.

    Parameters
    ----------
    bones : tuple of Bone
        The root first, parents before children.
    origin : ndarray, shape (3,)
        Place of the root, added to its translation.
    metres_per_unit : float
        0.0254 m / ``length``: the values are inches times that number.
    degrees : bool
        Whether its angles are degrees.
    """

    bones: tuple[Bone, ...]
    origin: FloatArray
    metres_per_unit: float
    degrees: bool


def read_asf(path: Path) -> Skeleton:
    """Parse an ASF file; limits, masses and skin are left out.

    Raises
    ------
    MotionError
        If it cannot be read or is damaged; the message names the line.
    """
    try:
        text = read_text(path)
    except OSError as error:
        raise MotionError(f"{path}: the skeleton cannot be read: {error.strerror or error}") from None
    sections = _sections(text)
    for needed in ("root", "bonedata", "hierarchy"):
        if needed not in sections:
            raise MotionError(f"{path}: has no section :{needed}; it is no whole ASF skeleton")
    units = {words[0].lower(): (line, words[1:]) for line, words in sections.get("units", [])}
    length = _numbers(path, *units.get("length", (0, ["1"])), count=1)[0]
    if not length > 0.0:
        raise MotionError(f"{path}: has the length unit {length:g}; it must be above 0")
    degrees = not " ".join(units.get("angle", (0, ["deg"]))[1]).lower().startswith("rad")
    root, origin = _root(path, sections["root"], degrees)
    bones = {"root": root} | _bones(path, sections["bonedata"], degrees)
    parents = _parents(path, sections["hierarchy"], bones)
    return Skeleton(_in_order(path, bones, parents), origin, INCH_M / length, degrees)


def _sections(text: str) -> dict[str, Section]:
    """Statements of each section, without comments; a statement may follow the section's name on its line."""
    sections: dict[str, Section] = {}
    current: Section = []
    for number, line in enumerate(text.split("\n"), start=1):
        words = line.split("#", 1)[0].split()
        if words and words[0].startswith(":"):
            current = sections.setdefault(words[0][1:].lower(), [])
            words = words[1:]
        if words:
            current.append((number, words))
    return sections


def _numbers(path: Path, line: int, words: Sequence[str], *, count: int) -> list[float]:
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if len(values) != count or not np.isfinite(values).all():
        raise MotionError(f"{path}, line {line}: {count} number(s) are needed, not {' '.join(words)[:60]!r}")
    return values


def _axis_frame(path: Path, line: int, words: Sequence[str], degrees: bool) -> tuple[FloatArray, str]:
    """Rotation and order from ``axis 0 0 20 XYZ``: the first letter turns first."""
    order = words[3].lower() if len(words) == 4 else "xyz"
    if sorted(order) != ["x", "y", "z"]:
        raise MotionError(
            f"{path}, line {line}: the axis order {order.upper()!r} is not one of x, y and z in any order"
        )
    return _turn(order, _numbers(path, line, words[:3], count=3), degrees), order


def _turn(order: str, angles: Sequence[float], degrees: bool) -> FloatArray:
    """Rotation by the x, y and z angles in that order, the first letter first."""
    radians = np.radians(angles) if degrees else np.asarray(angles)
    return euler_rotations(order[::-1], radians[["xyz".index(axis) for axis in order[::-1]]])


def _root(path: Path, section: Section, degrees: bool) -> tuple[Bone, FloatArray]:
    found = {words[0].lower(): (line, words[1:]) for line, words in section}
    line, words = found.get("axis", (0, ["XYZ"]))
    order = "".join(words).lower()
    if sorted(order) != ["x", "y", "z"]:
        raise MotionError(
            f"{path}, line {line}: the axis order {order.upper()!r} is not one of x, y and z in any order"
        )
    axes = _turn(order, _numbers(path, *found.get("orientation", (0, ["0"] * 3)), count=3), degrees)
    origin = np.array(_numbers(path, *found.get("position", (0, ["0"] * 3)), count=3))
    line, words = found.get("order", (0, ["TX", "TY", "TZ", "RX", "RY", "RZ"]))
    freedoms = _freedoms(path, line, words, "rx ry rz tx ty tz")
    return Bone("root", -1, np.zeros(3), axes, order, freedoms), origin


def _freedoms(path: Path, line: int, words: Sequence[str], allowed: str) -> tuple[str, ...]:
    found = tuple(word.lower() for word in words)
    if not set(found) <= set(allowed.split()) or len(set(found)) < len(found):
        raise MotionError(
            f"{path}, line {line}: the degrees of freedom {' '.join(words)!r}; read are {allowed}, each once"
        )
    return found


def _bones(path: Path, section: Section, degrees: bool) -> dict[str, Bone]:
    bones: dict[str, Bone] = {}
    entry: dict[str, tuple[int, list[str]]] | None = None
    for line, words in section:
        word = words[0].lower()
        if word == "begin":
            entry = {"begin": (line, [])}
        elif word == "end" and entry is not None:
            bone = _bone(path, entry, degrees)
            if bone.name in bones or bone.name == "root" or len(bones) >= MAX_BONES:
                raise MotionError(f"{path}, line {line}: bone {bone.name!r} is there twice, or there are too many")
            bones[bone.name] = bone
            entry = None
        elif entry is not None and word not in entry:
            entry[word] = (line, words[1:])
    if entry is not None:
        raise MotionError(f"{path}, line {entry['begin'][0]}: this bone has no end; the file is cut off")
    return bones


def _bone(path: Path, entry: Mapping[str, tuple[int, list[str]]], degrees: bool) -> Bone:
    line = entry["begin"][0]
    for needed in ("name", "direction", "length"):
        if not entry.get(needed, (0, []))[1]:
            raise MotionError(f"{path}, line {line}: this bone has no {needed}")
    direction = np.array(_numbers(path, *entry["direction"], count=3))
    norm = float(np.linalg.norm(direction))
    vector = direction / norm * _numbers(path, *entry["length"], count=1)[0] if norm > 0.0 else np.zeros(3)
    axes, order = _axis_frame(path, *entry.get("axis", (line, ["0", "0", "0", "XYZ"])), degrees)
    freedoms = _freedoms(path, *entry.get("dof", (line, [])), "rx ry rz")
    return Bone(" ".join(entry["name"][1]), -1, vector, axes, order, freedoms)


def _parents(path: Path, section: Section, bones: Mapping[str, Bone]) -> dict[str, str]:
    parents: dict[str, str] = {}
    for line, words in section:
        if words[0].lower() in ("begin", "end"):
            continue
        for name in words:
            if name not in bones:
                raise MotionError(f"{path}, line {line}: the hierarchy names {name!r}, which is no bone of the file")
        for child in words[1:]:
            if child in parents or child == "root":
                raise MotionError(f"{path}, line {line}: {child!r} hangs on two bones")
            parents[child] = words[0]
    return parents


def _in_order(path: Path, bones: Mapping[str, Bone], parents: Mapping[str, str]) -> tuple[Bone, ...]:
    """Bones with the index of their parent, in the order of the file as far as parents come first."""
    placed = {"root": 0}
    ordered = [bones["root"]]
    waiting = [name for name in bones if name != "root"]
    found = True
    while waiting and found:
        found = False
        for name in waiting:
            if parents.get(name) in placed:
                placed[name], found = len(ordered), True
                ordered.append(replace(bones[name], parent=placed[parents[name]]))
        waiting = [name for name in waiting if name not in placed]
    if waiting:
        raise MotionError(f"{path}: the bones {', '.join(waiting[:5])} do not hang on the root")
    return tuple(ordered)


def find_asf(path: Path, named: str) -> Path:
    """The skeleton of a motion file, among the ASF files beside it.

    It is the one whose name begins the motion's name (``07.asf`` for ``07_01.amc``), else the one that the motion's
    first line names, else the only one.

    Parameters
    ----------
    path : Path
        The AMC file.
    named : str
        File name of the skeleton in the comment of the AMC file, or ``""``.

    Raises
    ------
    MotionError
        If there is none, or it is not clear which one it is.
    """
    beside = sorted(file for file in path.parent.iterdir() if file.suffix.lower() == ".asf")
    begins = [f for f in beside if re.match(re.escape(f.stem.lower()) + r"(?![0-9a-z])", path.stem.lower())]
    by_comment = [f for f in beside if f.name.lower() == named.lower()]
    for found in (sorted(begins, key=lambda f: -len(f.stem))[:1], by_comment, beside):
        if len(found) == 1:
            return found[0]
    problem = f"several could be meant: {', '.join(f.name for f in beside[:8])}" if beside else "there is none"
    raise MotionError(
        f"{path}: an AMC file needs the ASF skeleton of its subject beside it; {problem}. Give it: skeleton='FILE.asf'"
    )
