"""Joint angles with a skeleton in another file: ASF/AMC (Acclaim), and exponential maps of prediction studies."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, Self

import numpy as np
from pydantic import Field, StrictInt, model_validator

from doppelgait.core.config import FrozenModel, validate
from doppelgait.core.documents import CELL_BYTES, check_cost, parse_json
from doppelgait.core.errors import ConfigError, MotionError
from doppelgait.core.units import FloatArray
from doppelgait.motion.readers.bvh import check_skeleton_cost, forward_kinematics, make_euler_rotations
from doppelgait.motion.readers.text import Points, is_finite, parse_rows, point_format, read_text

Section = list[tuple[int, list[str]]]  # statements: line number and words

INCH_M = 0.0254
MAX_BONES = 1000


@dataclass(frozen=True)
class Bone:
    """A bone; its point is its far end. Shapes: vector (3,); axes (3, 3)."""

    name: str
    parent: int
    vector: FloatArray
    axes: FloatArray
    order: str
    freedoms: tuple[str, ...]


@dataclass(frozen=True)
class Skeleton:
    """An ASF skeleton. Shapes: origin (3,)."""

    bones: tuple[Bone, ...]
    origin: FloatArray
    metres_per_unit: float
    degrees: bool


def read_asf(path: Path) -> Skeleton:
    """Parse an ASF file without limits, masses and skin."""
    try:
        text = read_text(path)
    except OSError as error:
        raise MotionError(f"{path}: the skeleton cannot be read: {error.strerror or error}") from None
    # statements of each section, without comments; one may follow the section's name on its line
    sections: dict[str, Section] = {}
    current: Section = []
    for number, line in enumerate(text.split("\n"), start=1):
        words = line.split("#", 1)[0].split()
        if words and words[0].startswith(":"):
            current = sections.setdefault(words[0][1:].lower(), [])
            words = words[1:]
        if words:
            current.append((number, words))
    for needed in ("root", "bonedata", "hierarchy"):
        if needed not in sections:
            raise MotionError(f"{path}: has no section :{needed}; it is not a complete ASF skeleton")
    units = {words[0].lower(): (line, words[1:]) for line, words in sections.get("units", [])}
    length = _parse_numbers(path, *units.get("length", (0, ["1"])), count=1)[0]
    if not length > 0.0:
        raise MotionError(f"{path}: has the length unit {length:g}; it must be above 0")
    degrees = not " ".join(units.get("angle", (0, ["deg"]))[1]).lower().startswith("rad")
    # the root, and the position that its translation is added to
    stated = {words[0].lower(): (line, words[1:]) for line, words in sections["root"]}
    axis_line, axis_words = stated.get("axis", (0, ["XYZ"]))
    order = "".join(axis_words).lower()
    at, turned = stated.get("orientation", (axis_line, ["0"] * 3))
    axes = _turn(path, at, order, turned, degrees)
    origin = np.array(_parse_numbers(path, *stated.get("position", (0, ["0"] * 3)), count=3))
    values = stated.get("order", (0, ["TX", "TY", "TZ", "RX", "RY", "RZ"]))
    root = Bone("root", -1, np.zeros(3), axes, order, _parse_freedoms(path, *values, "rx ry rz tx ty tz"))
    bones = {"root": root} | _parse_bones(path, sections["bonedata"], degrees)
    parents = _parse_parents(path, sections["hierarchy"], bones)
    # sort the bones so that parents come before children
    ordered, waiting = {"root": bones["root"]}, [name for name in bones if name != "root"]
    while waiting:
        for name in waiting:
            if parents.get(name) in ordered:
                ordered[name] = replace(bones[name], parent=[*ordered].index(parents[name]))
        if len(left := [name for name in waiting if name not in ordered]) == len(waiting):
            raise MotionError(f"{path}: the bones {', '.join(left[:5])} are not connected to the root")
        waiting = left
    return Skeleton(tuple(ordered.values()), origin, INCH_M / length, degrees)


def _parse_numbers(path: Path, line: int, words: Sequence[str], *, count: int) -> list[float]:
    if len(words) != count or not all(map(is_finite, words)):
        raise MotionError(f"{path}, line {line}: {count} number(s) are needed, not {' '.join(words)[:60]!r}")
    return [float(word) for word in words]


def _turn(path: Path, line: int, order: str, words: Sequence[str], degrees: bool) -> FloatArray:
    """Return the rotation by three angles, the first letter applied first."""
    if sorted(order) != ["x", "y", "z"]:
        raise MotionError(
            f"{path}, line {line}: the axis order {order.upper()!r} is not one of x, y and z in any order"
        )
    angles = np.array(_parse_numbers(path, line, words, count=3))[["xyz".index(axis) for axis in order[::-1]]]
    return make_euler_rotations(order[::-1], np.radians(angles) if degrees else angles)


def _parse_freedoms(path: Path, line: int, words: Sequence[str], allowed: str) -> tuple[str, ...]:
    found = tuple(word.lower() for word in words)
    if not set(found) <= set(allowed.split()) or len(set(found)) < len(found):
        raise MotionError(
            f"{path}, line {line}: the degrees of freedom {' '.join(words)!r}; read are {allowed}, each once"
        )
    return found


def _parse_bones(path: Path, section: Section, degrees: bool) -> dict[str, Bone]:
    bones: dict[str, Bone] = {}
    entry: dict[str, tuple[int, list[str]]] | None = None
    for line, words in section:
        word = words[0].lower()
        if word == "begin":
            entry = {"begin": (line, [])}
        elif word == "end" and entry is not None:
            # one bone from its statements by first word
            bone_line = entry["begin"][0]
            for needed in ("name", "direction", "length"):
                if not entry.get(needed, (0, []))[1]:
                    raise MotionError(f"{path}, line {bone_line}: this bone has no {needed}")
            direction = np.array(_parse_numbers(path, *entry["direction"], count=3))
            norm = float(np.linalg.norm(direction))
            vector = (
                direction / norm * _parse_numbers(path, *entry["length"], count=1)[0] if norm > 0.0 else np.zeros(3)
            )
            axis_line, axis_words = entry.get("axis", (bone_line, ["0", "0", "0", "XYZ"]))
            order = axis_words[3].lower() if len(axis_words) == 4 else "xyz"
            axes = _turn(path, axis_line, order, axis_words[:3], degrees)
            freedoms = _parse_freedoms(path, *entry.get("dof", (bone_line, [])), "rx ry rz")
            bone = Bone(" ".join(entry["name"][1]), -1, vector, axes, order, freedoms)
            if bone.name in bones or bone.name == "root" or len(bones) >= MAX_BONES:
                raise MotionError(f"{path}, line {line}: bone {bone.name!r} is repeated, or there are too many bones")
            bones[bone.name] = bone
            entry = None
        elif entry is not None and word not in entry:
            entry[word] = (line, words[1:])
    if entry is not None:
        raise MotionError(f"{path}, line {entry['begin'][0]}: this bone has no end; the file is truncated")
    return bones


def _parse_parents(path: Path, section: Section, bones: Mapping[str, Bone]) -> dict[str, str]:
    parents: dict[str, str] = {}
    for line, words in section:
        if words[0].lower() in ("begin", "end"):
            continue
        for name in words:
            if name not in bones:
                raise MotionError(f"{path}, line {line}: the hierarchy names {name!r}, which is not a bone of the file")
        for child in words[1:]:
            if child in parents or child == "root":
                raise MotionError(f"{path}, line {line}: {child!r} has two parents")
            parents[child] = words[0]
    return parents


def find_asf(path: Path, named: str) -> Path:
    """Find a motion file's skeleton in its folder."""
    neighbours = sorted(file for file in path.parent.iterdir() if file.suffix.lower() == ".asf")
    begins = [f for f in neighbours if re.match(re.escape(f.stem.lower()) + r"(?![0-9a-z])", path.stem.lower())]
    by_comment = [f for f in neighbours if f.name.lower() == named.lower()]
    for found in (sorted(begins, key=lambda f: -len(f.stem))[:1], by_comment, neighbours):
        if len(found) == 1:
            return found[0]
    problem = f"several are possible: {', '.join(f.name for f in neighbours[:8])}" if neighbours else "there is none"
    raise MotionError(
        f"{path}: an AMC file needs the ASF skeleton of its subject in its folder; {problem}. Give it: "
        "skeleton='FILE.asf'"
    )


CMU_RATE_HZ = 120.0
_NAMED = "#!oml:asf"
_AMC = rb"(?ims)(?!.*:bonedata)(?:.*^)?[ \t]*:(fully-specified|degrees|radians)\b"


@point_format("amc", _AMC, (".amc",), skeleton=True)
def parse_amc(path: Path, *, skeleton: str | Path | None = None, rate_hz: float | None = None) -> Points:
    """Read the root and the bones' ends of an AMC motion; ltibia is the left ankle."""
    text = read_text(path)
    start = re.search(r"(?m)^[ \t]*\d+[ \t]*$", text)
    if start is None:
        raise MotionError(f"{path}: holds no frames; a frame must begin with a line that holds its number")
    head = text[: start.start()].lower()
    degrees = False if ":radians" in head else True if ":degrees" in head else None
    comments = [line for line in text[: start.start()].split("\n") if line.lower().startswith(_NAMED)]
    named = comments[0][len(_NAMED) :].replace("\\", "/").rsplit("/", 1)[-1].strip() if comments else ""
    values = _parse_frames(path, text, start.start())
    asf = Path(skeleton) if skeleton is not None else find_asf(path, named)
    body = read_asf(asf)
    assumed = f"the format states no frame rate; {CMU_RATE_HZ:g} Hz, that of CMU, is assumed"
    return Points(
        [bone.name for bone in body.bones],
        _compute_positions(path, body, values, body.degrees if degrees is None else degrees),
        unit=body.metres_per_unit,
        unit_from="skeleton",
        rate_hz=CMU_RATE_HZ,
        rate_from="assumed",
        declared_up="y",
        subject=asf.stem,
        report={"skeleton": asf.name},
        notes=[assumed] if rate_hz is None else [],
        parents=[bone.parent for bone in body.bones],
    )


def _parse_frames(path: Path, text: str, at: int) -> dict[str, FloatArray]:
    """Parse the values of every bone; all frames have the bones of the first."""
    check_cost(path, CELL_BYTES * (text.count(" ") + text.count("\t")), MotionError)
    first: list[list[str]] = []
    statements: list[tuple[int, list[str]]] = []
    n, n_frames, frame = 0, 0, ""
    for number, line in enumerate(text[at:].split("\n"), start=text.count("\n", 0, at) + 1):
        words = line.split()
        if len(words) == 1 and words[0].isdigit():
            if n < len(first):
                raise MotionError(f"{path}, line {number}: frame {frame} ends after {n} of {len(first)} bones")
            n, n_frames, frame = 0, n_frames + 1, words[0]
            continue
        if not words:
            continue
        if n_frames == 1:
            first.append(words)
        if n >= len(first) or words[0] != first[n][0] or len(words) != len(first[n]):
            wanted = f"{first[n][0]} with {len(first[n]) - 1} value(s)" if n < len(first) else "the next frame"
            raise MotionError(
                f"{path}, line {number}: {line.strip()[:60]!r} in frame {frame}, where frame 1 has {wanted}"
            )
        statements.append((number, words))
        n += 1
    if not first:
        raise MotionError(f"{path}: its first frame holds no bones")
    if n < len(first):
        raise MotionError(f"{path}: ends inside frame {frame}, after {n} of {len(first)} bones; it is truncated")
    values, names = np.full((1, 1), np.nan), [words[0] for words in first]
    with suppress(ValueError):
        values = np.array([float(word) for _, words in statements for word in words[1:]]).reshape(n_frames, -1)
    if len(set(names)) < len(names) or not np.isfinite(values).all():
        for k, (number, words) in enumerate(statements):
            if words[0] in names[: k if k < n else 0] or not all(map(is_finite, words[1:])):
                raise MotionError(
                    f"{path}, line {number}: {' '.join(words)[:60]!r} repeats a bone or does not hold finite numbers"
                )
    columns = np.cumsum([0, *(len(words) - 1 for words in first)])
    return {name: values[:, columns[k] : columns[k + 1]] for k, name in enumerate(names)}


def _compute_positions(path: Path, skeleton: Skeleton, content: Mapping[str, FloatArray], degrees: bool) -> FloatArray:
    """Compute the positions of root and bone ends, in the unit and the axes of the skeleton."""
    freedoms = {bone.name: bone.freedoms for bone in skeleton.bones}
    for name, values in content.items():
        if name not in freedoms or values.shape[1] != len(freedoms[name]):
            has = f"has {len(freedoms[name])} degree(s) of freedom" if name in freedoms else "is not a bone"
            raise MotionError(
                f"{path}: gives {name!r} {values.shape[1]} value(s), but it {has} of its skeleton. Give the skeleton "
                "that belongs to the motion: skeleton='FILE.asf'"
            )
    n_frames = len(next(iter(content.values())))
    check_skeleton_cost(path, len(skeleton.bones), n_frames)
    rotation = np.empty((len(skeleton.bones), n_frames, 3, 3))
    translation = np.empty((len(skeleton.bones), n_frames, 3))
    for j, bone in enumerate(skeleton.bones):
        values = content.get(bone.name, np.zeros((n_frames, len(bone.freedoms))))
        angles, moved = np.zeros((2, n_frames, 3))
        for n, axis in enumerate(bone.order[::-1]):
            if f"r{axis}" in bone.freedoms:
                angles[:, n] = values[:, bone.freedoms.index(f"r{axis}")]
        for n, axis in enumerate("xyz"):
            if f"t{axis}" in bone.freedoms:
                moved[:, n] = values[:, bone.freedoms.index(f"t{axis}")]
        turned = make_euler_rotations(bone.order[::-1], np.radians(angles) if degrees else angles)
        rotation[j] = bone.axes @ turned @ bone.axes.T
        # the end of a bone rotates with the bone itself
        translation[j] = rotation[j] @ bone.vector
        if bone.parent < 0:
            translation[j] = skeleton.origin + moved
    return forward_kinematics([bone.parent for bone in skeleton.bones], translation, rotation)


COLUMNS = (99, 117)
"""Values in a frame: a translation, and rotation vectors of 32 (Human3.6M) or 38 (CMU) joints."""
SKELETON = "skeleton.json"


class ExpmapSkeleton(FrozenModel):
    """Skeleton in JSON that gives the numbers their meaning; a joint comes after its parent."""

    joint_names: list[str] = Field(min_length=1)
    parents: list[StrictInt]
    offsets: list[tuple[float, float, float]]
    metres_per_unit: float | None = Field(None, gt=0.0)
    frame_rate_hz: float | None = Field(None, gt=0.0)
    up_axis: Literal["x", "y", "z"] = "y"

    @model_validator(mode="after")
    def _check_joints(self) -> Self:
        n = len(self.joint_names)
        if len(self.parents) != n or any(not min(j, 1) - 1 <= p < j for j, p in enumerate(self.parents)):
            raise ValueError(f"parents must hold {n} indices, -1 for the first joint and a smaller index for any other")
        if len(self.offsets) != n:
            raise ValueError(f"offsets must hold three numbers for each of the {n} joints")
        return self


def sniff_expmap(path: Path, head: bytes) -> bool:
    """Return True if the first line has 99 or 117 numbers."""
    words = head.removeprefix(b"\xef\xbb\xbf").lstrip().split(b"\n", 1)[0].rstrip(b"\r").split(b",")
    try:
        return len(words) in COLUMNS and all(np.isfinite(float(word)) for word in words)
    except ValueError:
        return False


@point_format("expmap", sniff_expmap, (".txt",), skeleton=True)
def parse_expmap(path: Path, *, skeleton: str | Path | None = None) -> Points:
    """Read the joints of an exponential-map recording."""
    from scipy.spatial.transform import Rotation

    file = path.with_name(SKELETON) if skeleton is None else Path(skeleton)
    if not file.is_file():
        raise MotionError(
            f"{path}: holds joint angles only; a skeleton with joint_names, parents and offsets is needed, and "
            f"there is no {file}. Put it there or give it: skeleton='FILE.json'"
        )
    try:
        content = parse_json(read_text(file))
        if not isinstance(content, dict):
            raise ValueError("it is no object with joint_names, parents and offsets")
        known = {key: content[key] for key in ExpmapSkeleton.model_fields if key in content}
        body = validate(ExpmapSkeleton, known)
    except (ConfigError, OSError, ValueError) as error:
        raise MotionError(f"{file}: the skeleton cannot be read: {error}") from None
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
    vectors = values[:, 3:].reshape(len(values), n_joints, 3).swapaxes(0, 1)
    rotation = Rotation.from_rotvec(-vectors.reshape(-1, 3)).as_matrix().reshape(*vectors.shape, 3)
    translation = np.repeat(np.array(body.offsets)[:, np.newaxis], len(values), axis=1)
    translation[0] = values[:, :3]
    return Points(
        body.joint_names,
        forward_kinematics(body.parents, translation, rotation),
        unit=body.metres_per_unit,
        unit_from="skeleton",
        rate_hz=body.frame_rate_hz,
        rate_from="skeleton",
        declared_up=body.up_axis,
        report={"skeleton": file.name},
        parents=body.parents,
        root_turns=values[:, 3:6],
    )
