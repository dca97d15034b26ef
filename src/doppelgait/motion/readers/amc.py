"""ASF/AMC files (Acclaim, the CMU database): points are the root and the far ends of the bones."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import MotionError
from doppelgait.core.plugins import plugin
from doppelgait.motion.motion import Motion
from doppelgait.motion.readers.asf import Bone, Skeleton, find_asf, read_asf
from doppelgait.motion.readers.cells import read_text
from doppelgait.motion.readers.hierarchy import Joints, euler_rotations, forward_kinematics
from doppelgait.motion.readers.joint_points import joint_motion

FloatArray = npt.NDArray[np.float64]

CMU_RATE_HZ = 120.0
MAX_WORD = 100
_KEYWORD = re.compile(rb"(?im)^[ \t]*:(fully-specified|degrees|radians)\b")
_NAMED = re.compile(r"(?im)^#!OML:ASF\s+(?:.*[\\/])?([^\\/\n]+?)\s*$")


@dataclass(frozen=True)
class AmcContent:
    """An AMC file as written.

    Parameters
    ----------
    values : dict
        Values of each bone by its name, shape (T, n).
    degrees : bool or None
        Whether angles are degrees; None when the file does not say.
    named : str
        File name of the skeleton in its comment, or ``""``.
    """

    values: dict[str, FloatArray]
    degrees: bool | None
    named: str


def sniff_amc(path: Path, head: bytes) -> bool:
    """Whether a file looks like AMC: a line ``:FULLY-SPECIFIED``, ``:DEGREES`` or ``:RADIANS``, and no skeleton."""
    return _KEYWORD.search(head) is not None and b":bonedata" not in head.lower()


@plugin("motion_reader", "amc", sniff=sniff_amc, suffixes=(".amc",))
def read_amc(
    path: Path,
    *,
    skeleton: str | Path | None = None,
    units: str | None = None,
    up_axis: str | None = None,
    rate_hz: float | None = None,
) -> Motion:
    """Root and bone ends of an AMC motion, not cleaned.

    A point has the name of the bone whose far end it is: ``ltibia`` is the left ankle.

    Parameters
    ----------
    path : Path
        An existing AMC file.
    skeleton : path-like, optional
        ASF file of the subject; default: found beside the motion.
    units : str, optional
        ``"mm"``, ``"cm"``, ``"m"``, ``"in"``, ``"ft"`` or ``"cmu"`` (1/0.45 inch); default: what the skeleton says.
    up_axis : str, optional
        ``"x"``, ``"y"``, ``"z"``, ``"-x"``, ``"-y"`` or ``"-z"``; default: found; y is the convention.
    rate_hz : float, optional
        Frames per second, up to 10000; default: 120, the rate of nearly all of the CMU database, since the format
        states none (some of its trials have 60).

    Returns
    -------
    Motion
        Motion (time, marker, space) in m, z up, x and y as in the CMU database's C3D files.

    Raises
    ------
    MotionError
        If motion or skeleton cannot be read right, or do not belong together.
    """
    content = read_amc_content(path)
    asf = Path(skeleton) if skeleton is not None else find_asf(path, content.named)
    body = read_asf(asf)
    notes = (
        [] if rate_hz is not None else [f"the format states no frame rate; {CMU_RATE_HZ:g} Hz, that of CMU, is taken"]
    )
    return joint_motion(
        path,
        Joints(
            tuple(bone.name for bone in body.bones),
            tuple(bone.parent for bone in body.bones),
            amc_positions(path, body, content),
        ),
        kind="amc",
        rate_hz=CMU_RATE_HZ if rate_hz is None else rate_hz,
        rate_from="assumed" if rate_hz is None else "option",
        unit=body.metres_per_unit if units is None else units,
        unit_from="skeleton" if units is None else "option",
        up_axis=up_axis,
        subject=asf.stem,
        report={"skeleton": asf.name, "notes": notes},
    )


def read_amc_content(path: Path) -> AmcContent:
    """Parse an AMC file.

    Raises
    ------
    MotionError
        If it is damaged; the message names the line.
    """
    text = read_text(path)
    start = re.search(r"(?m)^[ \t]*\d+[ \t]*$", text)
    if start is None:
        raise MotionError(f"{path}: holds no frames; a frame begins with its number on a line of its own")
    head = text[: start.start()].lower()
    degrees = False if ":radians" in head else True if ":degrees" in head else None
    named = _NAMED.search(text[: start.start()])
    return AmcContent(_parse_frames(path, text, start.start()), degrees, named[1] if named else "")


def _parse_frames(path: Path, text: str, at: int) -> dict[str, FloatArray]:
    """Values by bone. All frames have the same words at the same places, so that one table holds them."""
    second = re.compile(r"(?m)^[ \t]*\d+[ \t]*$").search(text, text.index("\n", at) if "\n" in text[at:] else len(text))
    lines = [line.split() for line in text[at : second.start() if second else len(text)].split("\n")[1:]]
    lines = [words for words in lines if words]
    names = [words[0] for words in lines]
    lengths = [len(words) for words in lines]
    values = _frame_table(text[at:].split(), names, lengths)
    if values is None:
        raise MotionError(_fault(path, text, at, lines))
    columns = np.cumsum([1, *(length - 1 for length in lengths)])
    return {name: values[:, columns[n] : columns[n + 1]] for n, name in enumerate(names)}


def _frame_table(words: list[str], names: list[str], lengths: list[int]) -> FloatArray | None:
    """Frame number and values of each frame; None when not every frame is made like the first one."""
    size = 1 + sum(lengths)
    # a word of a megabyte would make every cell of the table as long
    if len(words) % size or not names or len(set(names)) < len(names) or max(map(len, words)) > MAX_WORD:
        return None
    places = np.cumsum([1, *lengths])[:-1]
    table = np.array(words).reshape(-1, size)
    if (table[:, places] != names).any():
        return None
    try:
        values = np.delete(table, places, axis=1).astype(np.float64)
    except ValueError:
        return None
    return values if np.isfinite(values).all() else None


def _fault(path: Path, text: str, at: int, first: Sequence[Sequence[str]]) -> str:
    """First line that does not look like the one at the same place in the first frame."""
    if not first:
        return f"{path}: its first frame holds no bones"
    n = len(first)
    frame = "?"
    for number, line in enumerate(text[at:].split("\n"), start=text.count("\n", 0, at) + 1):
        words = line.split()
        if not words:
            continue
        if len(words) == 1 and words[0].isdigit():
            if n < len(first):
                return f"{path}, line {number}: frame {frame} ends after {n} of {len(first)} bones"
            n, frame = 0, words[0]
            continue
        if n >= len(first) or words[0] != first[n][0] or len(words) != len(first[n]):
            wanted = f"{first[n][0]} with {len(first[n]) - 1} value(s)" if n < len(first) else "the next frame"
            return f"{path}, line {number}: {line.strip()[:60]!r} in frame {frame}, where frame 1 has {wanted}"
        if words[0] in {row[0] for row in first[:n]} or not all(map(_is_finite, words[1:])):
            return f"{path}, line {number}: {line.strip()[:60]!r} repeats a bone or holds no finite number"
        n += 1
    return f"{path}: ends inside of frame {frame}, after {n} of {len(first)} bones; it is cut off"


def _is_finite(word: str) -> bool:
    try:
        return bool(np.isfinite(float(word)))
    except ValueError:
        return False


def amc_positions(path: Path, skeleton: Skeleton, content: AmcContent) -> FloatArray:
    """Positions of the root and of all bone ends in the skeleton's unit and axes, shape (T, J, 3).

    A bone turns by ``C M C^-1`` in its parent's frame: C its axes, M its angles in the order of its axes, the first
    letter first. Bones without values, or without a degree of freedom, keep their rest pose.

    Parameters
    ----------
    path : Path
        The AMC file, for messages.
    skeleton : Skeleton
        The subject's bones.
    content : AmcContent
        The motion.

    Raises
    ------
    MotionError
        If the motion holds a bone, or a number of values, that the skeleton does not.
    """
    degrees = skeleton.degrees if content.degrees is None else content.degrees
    freedoms = {bone.name: bone.freedoms for bone in skeleton.bones}
    for name, values in content.values.items():
        if name not in freedoms or values.shape[1] != len(freedoms[name]):
            has = f"has {len(freedoms[name])} degree(s) of freedom" if name in freedoms else "is no bone"
            raise MotionError(
                f"{path}: gives {name!r} {values.shape[1]} value(s), but it {has} of its skeleton. Give the skeleton "
                "that belongs to the motion: skeleton='FILE.asf'"
            )
    n_frames = len(next(iter(content.values.values())))
    rotation = np.empty((len(skeleton.bones), n_frames, 3, 3))
    translation = np.empty((len(skeleton.bones), n_frames, 3))
    for j, bone in enumerate(skeleton.bones):
        values = content.values.get(bone.name, np.zeros((n_frames, len(bone.freedoms))))
        rotation[j] = _bone_rotations(bone, values, degrees)
        # the end of a bone turns with the bone itself
        translation[j] = rotation[j] @ bone.vector
        if bone.parent < 0:
            translation[j] = skeleton.origin + _translations(bone, values)
    return forward_kinematics([bone.parent for bone in skeleton.bones], translation, rotation)


def _bone_rotations(bone: Bone, values: FloatArray, degrees: bool) -> FloatArray:
    angles = np.zeros((len(values), 3))
    for n, axis in enumerate(bone.order[::-1]):
        if f"r{axis}" in bone.freedoms:
            angles[:, n] = values[:, bone.freedoms.index(f"r{axis}")]
    motion = euler_rotations(bone.order[::-1], np.radians(angles) if degrees else angles)
    return np.asarray(bone.axes @ motion @ bone.axes.T)


def _translations(bone: Bone, values: FloatArray) -> FloatArray:
    moved = np.zeros((len(values), 3))
    for axis in range(3):
        if f"t{'xyz'[axis]}" in bone.freedoms:
            moved[:, axis] = values[:, bone.freedoms.index(f"t{'xyz'[axis]}")]
    return moved
