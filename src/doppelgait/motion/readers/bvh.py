"""Joint hierarchies: BVH files, and animations in glTF files.

Vectors are columns: a child's frame is ``G_child = G_parent @ R_child`` and its origin
``p_child = p_parent + G_parent @ t_child``.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from doppelgait.core.documents import check_cost, parse_json, read_document
from doppelgait.core.errors import MotionError
from doppelgait.core.units import FloatArray
from doppelgait.motion.readers.points import check_rate, connect_kept
from doppelgait.motion.readers.text import (
    MAX_BYTES,
    Points,
    Times,
    find_frame_rate,
    is_finite,
    parse_rows,
    point_format,
    read_text,
)


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


_CHANNEL = re.compile(r"(?i)^([xyz])(position|rotation)$")
_LINE = re.compile(r"\s*+([^\n]*+)")
_FRAMES = re.compile(r"(?i)^frames\s*+:?+\s*+(\S+)$")
_FRAME_TIME = re.compile(r"(?i)^frame\s++time\s*+:?+\s*+(\S+)$")
MAX_NODES, MAX_GLB_NODES = 1000, 5000


@dataclass
class Node:
    """A joint or an end site."""

    name: str
    parent: int
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    channels: list[str] = field(default_factory=list)


def parse_hierarchy(path: Path, text: str) -> tuple[list[Node], int]:
    """Parse the nodes of a BVH file, and return where its motion begins."""
    split = re.search(r"(?im)^[ \t]*MOTION[ \t\r]*$", text)
    if split is None:
        raise MotionError(f"{path}: has no line MOTION; the file ends before its motion begins")
    nodes: list[Node] = []
    open_nodes: list[int] = []  # nodes with an open brace
    for number, line in enumerate(text[: split.start()].split("\n"), start=1):
        for statement in re.split(r"([{}])", line):
            if words := statement.split():
                try:
                    _run_statement(words, nodes, open_nodes)
                except ValueError as error:
                    raise MotionError(f"{path}, line {number}: {error}") from None
    if not nodes:
        raise MotionError(f"{path}: its hierarchy holds no ROOT")
    if open_nodes:
        raise MotionError(f"{path}: the hierarchy ends inside {nodes[open_nodes[-1]].name!r}: a '}}' is missing")
    return nodes, split.end()


def _run_statement(words: list[str], nodes: list[Node], open_nodes: list[int]) -> None:
    """Execute one statement of the hierarchy."""
    # statements declare, open, describe and close nodes
    word = words[0].upper()
    if word in ("ROOT", "JOINT", "END"):
        if word == "ROOT" and nodes:
            raise ValueError(
                f"a second ROOT, {' '.join(words[1:])!r}; a file may hold only one body. "
                "Save each body to its own file."
            )
        if word != "ROOT" and not open_nodes:
            raise ValueError(f"{' '.join(words)!r} outside a ROOT")
        if len(nodes) >= MAX_NODES:
            raise ValueError(f"more than {MAX_NODES} joints")
        parent = open_nodes[-1] if open_nodes else -1
        name = f"{nodes[parent].name}_End" if word == "END" else " ".join(words[1:])
        nodes.append(Node(name or f"joint_{len(nodes) + 1}", parent))
    elif word == "{":
        if not nodes or len(nodes) - 1 in open_nodes:
            raise ValueError("'{' without a joint before it")
        open_nodes.append(len(nodes) - 1)
    elif word == "}":
        if not open_nodes:
            raise ValueError("'}' closes nothing")
        open_nodes.pop()
    elif word in ("OFFSET", "CHANNELS"):
        if not open_nodes or open_nodes[-1] != len(nodes) - 1:
            raise ValueError(f"{word} outside a joint")
        if word == "OFFSET":
            if len(words) != 4 or not all(map(is_finite, words[1:])):
                raise ValueError(f"OFFSET needs three numbers, but has {' '.join(words[1:])!r}")
            x, y, z = map(float, words[1:])
            nodes[-1].offset = x, y, z
        else:
            nodes[-1].channels = _parse_channels(words[1:])
    elif word != "HIERARCHY":
        raise ValueError(
            f"{' '.join(words)[:60]!r} is not a statement of a BVH hierarchy; allowed are ROOT, "
            "JOINT, End Site, OFFSET, CHANNELS and braces"
        )


def _parse_channels(words: list[str]) -> list[str]:
    """Parse the channel names: ``"px"`` for Xposition, ``"rx"`` for Xrotation."""
    found = [_CHANNEL.match(word) for word in words[1:]]
    names = [match[2][0].lower() + match[1].lower() for match in found if match]
    places = [name for name in names if name[0] == "p"]  # only rotations may repeat an axis
    if not words or words[0] != str(len(names)) or None in found or len(set(places)) < len(places):
        raise ValueError(
            f"CHANNELS {' '.join(words)!r} is invalid; it needs the number of channels and as "
            "many names of Xposition, Yposition, Zposition, Xrotation, Yrotation and Zrotation"
        )
    return names


def _parse_motion_head(path: Path, text: str, at: int) -> tuple[int, float, int]:
    found: list[str] = []
    for pattern, wanted in ((_FRAMES, "Frames: N"), (_FRAME_TIME, "Frame Time: SECONDS")):
        line = next(_LINE.finditer(text, at))
        at = line.end()
        match = pattern.match(line[1].strip())
        if match is None:
            number = text.count("\n", 0, line.start(1)) + 1
            raise MotionError(f"{path}, line {number}: {wanted!r} is needed here, not {line[1].strip()[:40]!r}")
        found.append(match[1])
    try:
        return int(found[0]), float(found[1]), at
    except ValueError:
        raise MotionError(f"{path}: Frames {found[0]!r} and Frame Time {found[1]!r} must be numbers") from None


@point_format("bvh", rb"(?i)HIERARCHY", (".bvh",), skeleton=True)
def parse_bvh(path: Path, *, rate_hz: float | None = None) -> Points:
    """Read the joints of a BVH file."""
    text = read_text(path)
    nodes, at = parse_hierarchy(path, text)
    n_frames, step_s, at = _parse_motion_head(path, text, at)
    n_channels = sum(len(node.channels) for node in nodes)
    if n_channels == 0:
        raise MotionError(f"{path}: none of its {len(nodes)} joints has a channel, so nothing moves")
    values = parse_rows(path, text, at, n_rows=n_frames, n_columns=n_channels)
    if rate_hz is None and not 0.0 < step_s < float("inf"):
        raise MotionError(
            f"{path}: declares a Frame Time of {step_s:g} s; it must be above 0. Give the true rate: rate_hz=..."
        )
    check_skeleton_cost(path, len(nodes), len(values))
    turns = [n for n, channel in enumerate(nodes[0].channels) if channel[0] == "r"]
    return Points(
        [node.name for node in nodes],
        compute_bvh_positions(nodes, values),
        rate_hz=1.0 / step_s if rate_hz is None else rate_hz,
        rate_from="file",
        declared_up="y",
        parents=[node.parent for node in nodes],
        root_turns=values[:, turns],
    )


def compute_bvh_positions(nodes: Sequence[Node], values: FloatArray) -> FloatArray:
    """Compute the positions (T, J, 3) of all nodes, in the unit and the axes of the file."""
    translation, rotation = np.empty((len(nodes), len(values), 3)), np.empty((len(nodes), len(values), 3, 3))
    first = 0
    for j, node in enumerate(nodes):
        translation[j] = node.offset
        turns = []
        for n, channel in enumerate(node.channels, start=first):
            if channel[0] == "p":
                translation[j, :, "xyz".index(channel[1])] = values[:, n]
            else:
                turns.append((channel[1], n))
        angles_rad = np.radians(values[:, [n for _, n in turns]])
        rotation[j] = make_euler_rotations("".join(axis for axis, _ in turns), angles_rad)
        first += len(node.channels)
    return forward_kinematics([node.parent for node in nodes], translation, rotation)


@point_format("glb", rb"glTF", (".glb",), skeleton=True)
def parse_glb(path: Path, *, key: str | None = None, rate_hz: float | None = None) -> Points:
    """Read the joints of an animation in a binary glTF file."""
    # key is the name of the animation, rate_hz the rate to sample it at
    try:
        scene, binary = _split_glb(path)
        animations = scene.get("animations", [])
        names = [str(animation.get("name", n)) for n, animation in enumerate(animations)]
        if not animations or (key is None and len(names) > 1) or (key is not None and key not in names):
            raise MotionError(
                f"{path}: holds the animations {', '.join(names) or 'none'}; "
                + ("name one: key='...'" if names else "export an animation of the skeleton")
            )
        return _animate(path, scene, binary, animations[names.index(key) if key else 0], rate_hz)
    except (KeyError, IndexError, TypeError, AttributeError, ValueError, struct.error) as error:
        raise MotionError(f"{path}: is a damaged or unusual glTF file: {error!r}") from None


def _split_glb(path: Path) -> tuple[dict[str, Any], bytes]:
    content = read_document(path, MAX_BYTES, MotionError)
    at, chunks = 12, {}
    while at + 8 <= len(content):
        length, kind = struct.unpack_from("<I4s", content, at)
        chunks[kind] = content[at + 8 : at + 8 + length]
        at += 8 + length
    scene = parse_json(chunks[b"JSON"].rstrip(b"\0"))
    if "EXT_meshopt_compression" in scene.get("extensionsRequired", []):
        raise MotionError(f"{path}: is compressed (meshopt); export it without compression")
    return scene, chunks.get(b"BIN\0", b"")


_COMPONENTS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5126: "<f4"}
_SIZES = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}


def _read_accessor(scene: Mapping[str, Any], binary: bytes, number: int) -> FloatArray:
    """Read an accessor as an array (count, components); integers are normalised."""
    accessor = scene["accessors"][number]
    if "sparse" in accessor:
        raise ValueError("sparse accessors of animations are not supported")
    view = scene["bufferViews"][accessor["bufferView"]]
    if view["buffer"] != 0 or "uri" in scene["buffers"][0]:
        raise ValueError("the keys are in another file; save all in one .glb")
    kind, n = np.dtype(_COMPONENTS[accessor["componentType"]]), _SIZES[accessor["type"]]
    start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    count, stride = int(accessor["count"]), view.get("byteStride", n * kind.itemsize)
    if min(start, count - 1, stride - 1) < 0 or start + (count - 1) * stride + n * kind.itemsize > len(binary):
        raise ValueError("an accessor exceeds the binary chunk")
    values = np.ndarray((count, n), kind, binary, start, (stride, kind.itemsize)).astype(np.float64)
    return values if kind.kind == "f" else np.maximum(values / np.iinfo(kind).max, -1.0)


def _interpolate(keys_s: FloatArray, values: FloatArray, how: str, times_s: FloatArray, rotates: bool) -> FloatArray:
    """Interpolate the keys of a sampler as glTF 2.0 states (appendix C)."""
    from scipy.spatial.transform import Rotation, Slerp

    times_s = np.clip(times_s, keys_s[0], keys_s[-1])
    k = np.searchsorted(keys_s, times_s, side="right") - 1
    if how == "CUBICSPLINE":
        into, values, out = np.moveaxis(values.reshape(len(keys_s), 3, -1), 1, 0)
    elif how not in ("LINEAR", "STEP"):
        raise ValueError(f"the interpolation {how!r} is unknown; known are LINEAR, STEP and CUBICSPLINE")
    if how == "STEP" or len(keys_s) == 1:
        return values[k]
    if how == "LINEAR" and rotates:
        return np.asarray(Slerp(keys_s, Rotation.from_quat(values))(times_s).as_quat())
    k = np.minimum(k, len(keys_s) - 2)
    step_s = np.diff(keys_s)[k, np.newaxis]
    s = (times_s - keys_s[k])[:, np.newaxis] / step_s
    if how == "LINEAR":
        return np.asarray(values[k] + s * (values[k + 1] - values[k]))
    first = (2 * s**3 - 3 * s**2 + 1) * values[k] + (s**3 - 2 * s**2 + s) * step_s * out[k]
    return np.asarray(first + (3 * s**2 - 2 * s**3) * values[k + 1] + (s**3 - s**2) * step_s * into[k + 1])


def _animate(
    path: Path, scene: Mapping[str, Any], binary: bytes, animation: Mapping[str, Any], rate_hz: float | None
) -> Points:
    """Sample an animation at a rate: joints of the largest skin, or all nodes."""
    from scipy.spatial.transform import Rotation

    nodes, samplers = scene["nodes"], animation["samplers"]
    keys_s = [_read_accessor(scene, binary, sampler["input"])[:, 0] for sampler in samplers]
    if rate_hz is None:
        longest_s = max(keys_s, key=len)
        try:
            rate = find_frame_rate(path, Times(longest_s, range(len(longest_s)), 1e-5, 1e-5))[0]
        except (MotionError, ZeroDivisionError):
            raise MotionError(
                f"{path}: its {len(longest_s)} keys are not evenly spaced in time; give the rate to sample at: "
                "rate_hz=..."
            ) from None
    else:
        rate = check_rate(path, rate_hz, said="was given")
    start_s, stop_s = min(keys[0] for keys in keys_s), max(keys[-1] for keys in keys_s)
    n_frames = int((stop_s - start_s) * rate + 1e-3) + 1
    check_skeleton_cost(path, len(nodes), n_frames)
    if len(nodes) > MAX_GLB_NODES:
        raise ValueError(f"it has {len(nodes)} nodes; up to {MAX_GLB_NODES} are read")
    tracks: dict[tuple[int, str], FloatArray] = {}
    times_s = start_s + np.arange(n_frames) / rate
    for channel in animation["channels"]:
        sampler, target, what = samplers[channel["sampler"]], channel["target"], channel["target"]["path"]
        if what in ("translation", "rotation", "scale") and "node" in target:
            keys, values = keys_s[channel["sampler"]], _read_accessor(scene, binary, sampler["output"])
            how = sampler.get("interpolation", "LINEAR")
            tracks[target["node"], what] = _interpolate(keys, values, how, times_s, what == "rotation")
    above = {child: n for n, node in enumerate(nodes) for child in node.get("children", ())}
    order: list[int] = []
    level = [n for n in range(len(nodes)) if n not in above]
    while level and len(order) < len(nodes):  # parents first
        order += level
        level = sorted(child for n in level for child in nodes[n].get("children", ()))
    if level or len(order) != len(nodes):
        raise ValueError("the nodes form no tree")
    place = {n: j for j, n in enumerate(order)}
    translation, linear = np.empty((len(nodes), n_frames, 3)), np.empty((len(nodes), n_frames, 3, 3))
    for j, n in enumerate(order):
        if "matrix" in nodes[n]:
            matrix = np.array(nodes[n]["matrix"], dtype=np.float64).reshape(4, 4).T
            translation[j], linear[j] = matrix[:3, 3], matrix[:3, :3]
            continue
        moved, turned, scaled = (
            np.asarray(tracks.get((n, what), nodes[n].get(what, rest)), dtype=np.float64)
            for what, rest in (("translation", (0, 0, 0)), ("rotation", (0, 0, 0, 1)), ("scale", (1, 1, 1)))
        )
        translation[j], linear[j] = moved, Rotation.from_quat(turned).as_matrix() * scaled[..., np.newaxis, :]
    parents = [place[above[n]] if n in above else -1 for n in order]
    position = forward_kinematics(parents, translation, linear)
    bones = set(max((skin["joints"] for skin in scene.get("skins", ())), key=len, default=order))
    kept = [j for j, n in enumerate(order) if n in bones]
    return Points(
        [str(nodes[order[j]].get("name", f"node_{order[j]}")) for j in kept],
        position[:, kept],
        unit="m",
        unit_from="format",
        rate_hz=rate,
        rate_from="file",
        declared_up="y",
        parents=connect_kept(parents, kept),
    )
