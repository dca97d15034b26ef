"""Skeletons: joint orders of body models, and files of Kinect, Xsens and animation programs (glTF)."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from doppelgait.core.config import read_toml
from doppelgait.core.documents import CELL_BYTES, check_cost, parse_json
from doppelgait.core.errors import MotionError
from doppelgait.core.units import FloatArray
from doppelgait.motion.readers.bvh import check_skeleton_cost, forward_kinematics
from doppelgait.motion.readers.points import check_rate, connect_kept
from doppelgait.motion.readers.text import (
    Points,
    Times,
    check_size,
    find_frame_rate,
    list_head_lines,
    point_format,
    read_lines,
)
from doppelgait.motion.skeleton import list_points

MAX_NODES = 5000


@cache
def read_skeletons() -> dict[str, tuple[tuple[int, ...], dict[str, str]]]:
    """Return the numbers of joints of body models, and the joints in order with parts."""
    tables = read_toml(Path(__file__).with_name("skeletons.toml"))[0]
    return {name: (tuple(table["counts"]), list_points(table["joints"])) for name, table in tables.items()}


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
    # of a frame: number of bodies; of each: a line of states, number of joints, a line per joint
    lines, parts = read_lines(path), read_skeletons()["kinect"][1]
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
                if n_joints != len(parts) or [len(row) for row in rows] != [12] * n_joints:
                    raise ValueError(f"{len(rows)} joints")
                # the last value of a joint is 0 if it is not tracked
                bodies.setdefault(name, {})[frame] = [
                    [float(word) if row[11] != "0" else np.nan for word in row[:3]] for row in rows
                ]
                at += 2 + n_joints
    except (ValueError, IndexError) as error:
        raise MotionError(
            f"{path}: is truncated or damaged near line {at + 1} ({error}); a frame holds bodies of "
            f"{len(parts)} joints with 12 values"
        ) from None
    if not bodies:
        raise MotionError(f"{path}: holds {n_frames} frames without a body")
    check_cost(path, 24.0 * n_frames * len(parts) * len(bodies), MotionError)
    position = np.full((n_frames, len(bodies), len(parts), 3), np.nan)
    for n, frames in enumerate(bodies.values()):
        position[list(frames), n] = list(frames.values())
    return Points(
        [f"{body}:{joint}" for body in bodies for joint in parts],
        position.reshape(n_frames, -1, 3),
        unit="m",
        rate_hz=KINECT_HZ,
        usual_up="y",
        parts=parts,
        device="Kinect v2",
    )


@point_format("mvnx", rb"(?s)(?=<).*<mvnx", (".mvnx",))
def parse_mvnx(path: Path) -> Points:
    """Read the origins of the segments of an Xsens MVNX file."""
    check_size(path)
    labels: list[str] = []
    frames: list[list[float]] = []
    times_ms: list[float] = []
    rates: list[str] = []
    parser: Any = ElementTree.XMLPullParser(["start", "end"])
    try:
        with path.open("rb") as file:
            while block := file.read(2**16):
                # entities can grow without limit; they are declared before the root
                if not rates and b"<!DOCTYPE" in block.upper():
                    raise MotionError(f"{path}: declares a document type, which is not read")
                parser.feed(block)
                for event, element in parser.read_events():
                    tag = element.tag.rsplit("}", 1)[-1]
                    if event == "start" and tag == "subject":
                        rates.append(element.get("frameRate", ""))
                    elif event == "end" and tag == "segments":  # not those of the fingers
                        labels += [child.get("label", "") for child in element if child.tag.endswith("segment")]
                    elif event == "end" and tag == "frame" and element.get("type", "normal") == "normal":
                        for child in (child for child in element if child.tag.rsplit("}", 1)[-1] == "position"):
                            frames.append(list(map(float, (child.text or "").split())))
                            times_ms.append(float(element.get("time") or "nan"))
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
    time_s = np.array(times_ms) / 1e3
    is_timed = bool(np.isfinite(time_s).all())
    return Points(
        labels,
        np.array(frames).reshape(len(frames), -1, 3),
        unit="m",
        rate_hz=rates[0],
        times=Times(time_s, range(len(frames)), 1e-3, 1e-3) if is_timed else None,
    )


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
    check_size(path)
    content = path.read_bytes()
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
    if len(nodes) > MAX_NODES:
        raise ValueError(f"it has {len(nodes)} nodes; up to {MAX_NODES} are read")
    tracks: dict[tuple[int, str], FloatArray] = {}
    for channel in animation["channels"]:
        sampler, target = samplers[channel["sampler"]], channel["target"]
        if target["path"] in ("translation", "rotation", "scale") and "node" in target:
            tracks[target["node"], target["path"]] = _interpolate(
                keys_s[channel["sampler"]],
                _read_accessor(scene, binary, sampler["output"]),
                sampler.get("interpolation", "LINEAR"),
                start_s + np.arange(n_frames) / rate,
                target["path"] == "rotation",
            )
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
