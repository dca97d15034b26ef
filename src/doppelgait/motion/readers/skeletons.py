"""Skeletons: joint orders of body models, and files of Kinect, Xsens and animation programs.

Kinect v2 (NTU RGB+D) and Xsens MVNX files hold positions. A glTF file (GLB) holds a hierarchy with keys of translation,
rotation and scale.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt

from doppelgait.core.documents import CELL_BYTES, check_cost, parse_json
from doppelgait.core.errors import MotionError
from doppelgait.core.plugins import plugin
from doppelgait.motion.motion import Motion
from doppelgait.motion.readers.joints import Joints, check_skeleton_cost, forward_kinematics, make_joint_motion
from doppelgait.motion.readers.text import (
    MAX_BYTES,
    Points,
    Times,
    find_frame_rate,
    list_head_lines,
    point_format,
    read_lines,
)
from doppelgait.motion.skeleton import list_points

FloatArray = npt.NDArray[np.float64]


def _list_limbs(side: str) -> tuple[str, str]:
    """Return the joints of one arm and of one leg."""
    arm = f"{side}_shoulder:torso {side}_elbow:{side}_upper_arm {side}_wrist:{side}_forearm"
    return arm, f"{side}_hip:torso {side}_knee:{side}_thigh {side}_ankle:{side}_shank"


(_LEFT_ARM, _LEFT_LEG), (_RIGHT_ARM, _RIGHT_LEG) = map(_list_limbs, ("left", "right"))
SKELETONS: Mapping[str, tuple[tuple[int, ...], Mapping[str, str]]] = {
    # Loper et al. 2015; SMPL-H and SMPL-X share the first 22 joints
    "smpl": (
        (22, 24),
        list_points(
            "pelvis:torso *_hip:torso spine1:torso *_knee:*_thigh spine2:torso *_ankle:*_shank spine3:torso "
            "*_foot:*_foot neck:torso *_collar:torso head:head *_shoulder:torso *_elbow:*_upper_arm *_wrist:*_forearm "
            "*_hand:*_hand"
        ),
    ),
    # Ionescu et al. 2014: the joints that pose estimators use
    "h36m": (
        (17,),
        list_points(
            f"pelvis:torso {_RIGHT_LEG} {_LEFT_LEG} spine:torso thorax:torso nose:head head:head {_LEFT_ARM} "
            + _RIGHT_ARM
        ),
    ),
    "kinect": (
        (25,),
        list_points(
            f"spine_base:torso spine_mid:torso neck:torso head:head {_LEFT_ARM} left_hand:left_hand {_RIGHT_ARM} "
            f"right_hand:right_hand {_LEFT_LEG} left_foot:left_foot {_RIGHT_LEG} right_foot:right_foot "
            "spine_shoulder:torso left_hand_tip:left_hand left_thumb:left_hand right_hand_tip:right_hand "
            "right_thumb:right_hand"
        ),
    ),
    "mediapipe": (
        (33,),
        list_points(
            "nose:head left_eye_inner:head left_eye:head left_eye_outer:head right_eye_inner:head right_eye:head "
            "right_eye_outer:head *_ear:head mouth_left:head mouth_right:head *_shoulder:torso *_elbow:*_upper_arm "
            "*_wrist:*_forearm *_pinky:*_hand *_index:*_hand *_thumb:*_hand *_hip:torso *_knee:*_thigh *_ankle:*_shank "
            "*_heel:*_foot *_foot_index:*_foot"
        ),
    ),
}
"""Numbers of joints of body models, and their joints in order, with parts. A joint belongs to the part above it, like a
skin marker on it."""

KINECT_JOINTS = list(SKELETONS["kinect"][1])
KINECT_HZ = 30.0


def sniff_kinect(path: Path, head: bytes) -> bool:
    """Return True if a file has counts of frames and bodies, and a body with 25 joints."""
    if b"\0" in head or not head[:1].isdigit():
        return False
    lines = [line.split() for line in list_head_lines(path, head, 4)]
    bodies = [n for n, words in enumerate(lines) if len(words) == 10][:1]
    counts = lines[: bodies[0]] if bodies else []
    # frames without a body are a line 0
    return len(counts) >= 2 and all(len(w) == 1 and w[0].isdigit() for w in counts) and lines[len(counts) + 1] == ["25"]


@point_format("kinect", sniff_kinect, (".skeleton",))
def parse_kinect(path: Path) -> Points:
    """Read the joints of Kinect v2 in a file of NTU RGB+D."""
    # of each frame: number of bodies; of each body: a line of states, number of joints, and a line per joint
    lines = read_lines(path)
    check_cost(path, CELL_BYTES * 12 * len(lines), MotionError)
    bodies: dict[str, dict[int, list[list[float]]]] = {}
    at = 1
    try:
        n_frames = int(lines[0])
        for frame in range(n_frames):
            n_bodies, at = int(lines[at]), at + 1
            for _ in range(n_bodies):
                name, n_joints = lines[at].split()[0], int(lines[at + 1])
                rows = [line.split() for line in lines[at + 2 : at + 2 + n_joints]]
                if n_joints != len(KINECT_JOINTS) or len(rows) != n_joints:
                    raise ValueError(f"{len(rows)} joints")
                # the last value of a joint is 0 if it is not tracked
                bodies.setdefault(name, {})[frame] = [
                    [float(word) if row[11] != "0" else np.nan for word in row[:3]] for row in rows
                ]
                at += 2 + n_joints
    except (ValueError, IndexError) as error:
        raise MotionError(
            f"{path}: is truncated or damaged near line {at + 1} ({error}); a frame holds bodies of "
            f"{len(KINECT_JOINTS)} joints with 12 values"
        ) from None
    if not bodies:
        raise MotionError(f"{path}: holds {n_frames} frames without a body")
    check_cost(path, 24.0 * n_frames * len(KINECT_JOINTS) * len(bodies), MotionError)
    position = np.full((n_frames, len(bodies), len(KINECT_JOINTS), 3), np.nan)
    for n, frames in enumerate(bodies.values()):
        position[list(frames), n] = list(frames.values())
    return Points(
        [f"{body}:{joint}" for body in bodies for joint in KINECT_JOINTS],
        position.reshape(n_frames, -1, 3),
        unit="m",
        rate_hz=KINECT_HZ,
        usual_up="y",
        parts=SKELETONS["kinect"][1],
        rate_from="Kinect v2",
    )


def sniff_mvnx(path: Path, head: bytes) -> bool:
    """Return True if an XML file has the root mvnx."""
    return head.removeprefix(b"\xef\xbb\xbf").lstrip()[:1] == b"<" and b"<mvnx" in head


@point_format("mvnx", sniff_mvnx, (".mvnx",))
def parse_mvnx(path: Path) -> Points:
    """Read the origins of the segments of an Xsens MVNX file."""
    if path.stat().st_size > MAX_BYTES:
        raise MotionError(f"{path}: has {path.stat().st_size} bytes; files of up to {MAX_BYTES} bytes are read")
    labels: list[str] = []
    frames: list[list[float]] = []
    times_ms: list[str] = []
    rates: list[str] = []
    parser: Any = ElementTree.XMLPullParser(["start", "end"])
    try:
        with path.open("rb") as file:
            while block := file.read(2**16):
                # entities can grow without limit, and no motion needs any; they are declared before the root
                if not rates and b"<!DOCTYPE" in block.upper():
                    raise MotionError(f"{path}: declares a document type; export it again without one")
                parser.feed(block)
                for event, element in parser.read_events():
                    tag = element.tag.rsplit("}", 1)[-1]
                    if event == "start" and tag == "subject":
                        rates.append(element.get("frameRate", ""))
                    elif event == "end" and tag == "segments":  # not those of the fingers
                        labels += [child.get("label", "") for child in element if child.tag.endswith("segment")]
                    elif event == "end" and tag == "frame":
                        _add_frame(element, frames, times_ms)
                    if event == "end" and tag in ("frame", "segments"):
                        element.clear()
        parser.close()
    except (ElementTree.ParseError, ValueError) as error:
        raise MotionError(f"{path}: is no complete MVNX file: {error}; export it again") from None
    if len(rates) != 1 or not frames or {len(frame) for frame in frames} != {3 * len(labels)}:
        raise MotionError(
            f"{path}: holds {len(rates)} subjects, {len(labels)} segments and {len(frames)} frames with positions; "
            "export one subject with the position of every segment"
        )
    time_s = np.array([float(word or "nan") for word in times_ms]) / 1e3
    is_timed = bool(np.isfinite(time_s).all())
    return Points(
        labels,
        np.array(frames).reshape(len(frames), -1, 3),
        unit="m",
        rate_hz=rates[0],
        times=Times(time_s, range(len(frames)), 1e-3, 1e-3) if is_timed else None,
    )


def _add_frame(element: ElementTree.Element, frames: list[list[float]], times_ms: list[str]) -> None:
    """Add the positions and the time of a frame that is no calibration pose."""
    position = next((child for child in element if child.tag.rsplit("}", 1)[-1] == "position"), None)
    if element.get("type", "normal") == "normal" and position is not None:
        frames.append(list(map(float, (position.text or "").split())))
        times_ms.append(element.get("time", ""))


def sniff_glb(path: Path, head: bytes) -> bool:
    """Return True if a file is a binary glTF container."""
    return head[:4] == b"glTF"


@plugin("motion_reader", "glb", sniff=sniff_glb, suffixes=(".glb",))
def read_glb(
    path: Path,
    *,
    key: str | None = None,
    units: str | None = None,
    up_axis: str | None = None,
    rate_hz: float | None = None,
) -> Motion:
    """Read the joints of an animation in a binary glTF file, uncleaned."""
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
        return _animate(path, scene, binary, animations[names.index(key) if key else 0], units, up_axis, rate_hz)
    except (KeyError, IndexError, TypeError, AttributeError, ValueError, struct.error) as error:
        raise MotionError(f"{path}: is a damaged or unusual glTF file: {type(error).__name__} {error}") from None


def _split_glb(path: Path) -> tuple[dict[str, Any], bytes]:
    """Return the JSON and the binary chunk."""
    if path.stat().st_size > MAX_BYTES:
        raise MotionError(f"{path}: has {path.stat().st_size} bytes; files of up to {MAX_BYTES} bytes are read")
    content = path.read_bytes()
    at, chunks = 12, {}
    while at + 8 <= len(content):
        length, kind = struct.unpack_from("<I4s", content, at)
        chunks[kind] = content[at + 8 : at + 8 + length]
        at += 8 + length
    if "EXT_meshopt_compression" in (scene := parse_json(chunks[b"JSON"].rstrip(b"\0"))).get("extensionsRequired", []):
        raise MotionError(f"{path}: is compressed (EXT_meshopt_compression); export it without compression")
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


def _interpolate(keys_s: FloatArray, values: FloatArray, how: str, times_s: FloatArray, spherical: bool) -> FloatArray:
    """Interpolate the keys of a sampler as glTF 2.0 states (appendix C)."""
    tangents = values.reshape(len(keys_s), 3, -1) if how == "CUBICSPLINE" else None
    values = values if tangents is None else tangents[:, 1]
    k = np.clip(np.searchsorted(keys_s, times_s, side="right") - 1, 0, max(len(keys_s) - 2, 0))
    after = np.minimum(k + 1, len(keys_s) - 1)
    step_s = np.maximum(keys_s[after] - keys_s[k], 1e-12)
    s = np.clip((times_s - keys_s[k]) / step_s, 0.0, 1.0)[:, np.newaxis]
    first, second = values[k], values[after]
    if how == "STEP":
        return np.where(s < 1.0, first, second)
    if tangents is not None:
        out, into = tangents[k, 2] * step_s[:, np.newaxis], tangents[after, 0] * step_s[:, np.newaxis]
        result = (2 * s**3 - 3 * s**2 + 1) * first + (s**3 - 2 * s**2 + s) * out
        return np.asarray(result + (3 * s**2 - 2 * s**3) * second + (s**3 - s**2) * into)
    if not spherical:
        return first + s * (second - first)
    cosine = (first * second).sum(axis=1, keepdims=True)
    second, angle = np.where(cosine < 0.0, -second, second), np.arccos(np.clip(np.abs(cosine), 0.0, 1.0))
    sine = np.maximum(np.sin(angle), 1e-9)
    first_share, share = (np.where(angle < 1e-6, x, np.sin(x * angle) / sine) for x in (1.0 - s, s))
    return np.asarray(first_share * first + share * second)


def _make_rotations(quaternion: FloatArray) -> FloatArray:
    """Convert quaternions x, y, z, w to matrices. Shapes: (..., 4) to (..., 3, 3)."""
    x, y, z, w = np.moveaxis(quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def _animate(
    path: Path,
    scene: Mapping[str, Any],
    binary: bytes,
    animation: Mapping[str, Any],
    units: str | None,
    up_axis: str | None,
    rate_hz: float | None,
) -> Motion:
    """Sample an animation and compute the positions of the joints of the skin, or of all nodes."""
    nodes, samplers = scene["nodes"], animation["samplers"]
    keys_s = [_read_accessor(scene, binary, sampler["input"])[:, 0] for sampler in samplers]
    start_s, stop_s = min(keys[0] for keys in keys_s), max(keys[-1] for keys in keys_s)
    rate = rate_hz
    if rate is None:
        densest_s = max(keys_s, key=len)
        try:
            rate = find_frame_rate(path, Times(densest_s, range(len(densest_s)), 1e-5, 1e-5))[0]
        except (MotionError, ZeroDivisionError):
            raise MotionError(
                f"{path}: its {len(densest_s)} keys are not evenly spaced in time; give the rate to sample the "
                "animation at: rate_hz=..."
            ) from None
    n_frames = int((stop_s - start_s) * rate + 1e-3) + 1
    check_skeleton_cost(path, len(nodes), n_frames)
    times_s = start_s + np.arange(n_frames) / rate
    parent = {child: n for n, node in enumerate(nodes) for child in node.get("children", ())}
    order = _sort_nodes(len(nodes), parent)
    values: dict[tuple[int, str], FloatArray] = {}
    for channel in animation["channels"]:
        sampler, what = samplers[channel["sampler"]], channel["target"]["path"]
        if what in ("translation", "rotation", "scale") and "node" in channel["target"]:
            values[channel["target"]["node"], what] = _interpolate(
                keys_s[channel["sampler"]],
                _read_accessor(scene, binary, sampler["output"]),
                sampler.get("interpolation", "LINEAR"),
                times_s,
                what == "rotation",
            )
    translation, linear = np.empty((len(nodes), n_frames, 3)), np.empty((len(nodes), n_frames, 3, 3))
    for j, n in enumerate(order):
        matrix = np.array(nodes[n].get("matrix", np.eye(4)), dtype=np.float64).reshape(4, 4).T
        translation[j] = values.get((n, "translation"), nodes[n].get("translation", matrix[:3, 3]))
        linear[j] = matrix[:3, :3]
        if "matrix" not in nodes[n]:
            turned = _make_rotations(np.asarray(values.get((n, "rotation"), nodes[n].get("rotation", (0, 0, 0, 1.0)))))
            scaled = np.asarray(values.get((n, "scale"), nodes[n].get("scale", (1.0, 1.0, 1.0))))
            linear[j] = turned * scaled[..., np.newaxis, :]
    place = {n: j for j, n in enumerate(order)}
    position = forward_kinematics([place.get(parent.get(n, -1), -1) for n in order], translation, linear)
    bones = set(max((skin["joints"] for skin in scene.get("skins", ())), key=len, default=order))
    kept = [n for n in order if n in bones]
    parents: list[int] = []
    for n in kept:
        above = parent.get(n, -1)
        while above >= 0 and above not in bones:
            above = parent.get(above, -1)
        parents.append(kept.index(above) if above >= 0 else -1 if not parents else 0)
    return make_joint_motion(
        path,
        Joints(
            tuple(str(nodes[n].get("name", f"node_{n}")) for n in kept),
            tuple(parents),
            position[:, [place[n] for n in kept]],
        ),
        kind="glb",
        rate_hz=rate,
        rate_from="file" if rate_hz is None else "option",
        unit=units or "m",
        unit_from="option" if units else "format",
        up_axis=up_axis,
    )


def _sort_nodes(n_nodes: int, parent: Mapping[int, int]) -> list[int]:
    """Sort nodes so that parents come first."""
    children: dict[int, list[int]] = {}
    for n in range(n_nodes):
        children.setdefault(parent.get(n, -1), []).append(n)
    order, waiting = [], [-1]
    while waiting:
        below = children.get(waiting.pop(), [])
        order += below
        waiting += below
    if len(order) != n_nodes or len(set(order)) != n_nodes:
        raise ValueError("the nodes form no tree")
    return order
