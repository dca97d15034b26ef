"""Joints of body models: positions in npy, npz (AMASS), JSON, HDF5, Kinect and Xsens files."""

from __future__ import annotations

import pickletools
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from doppelgait.core.config import read_toml
from doppelgait.core.documents import CELL_BYTES, check_cost, parse_json
from doppelgait.core.errors import MotionError, warn_caller
from doppelgait.core.npz import NPY_MAGIC, is_npz, load_npy, load_npz
from doppelgait.core.own_hdf5 import FAULTS, SIGNATURE, get_attribute, open_hdf5
from doppelgait.core.plugins import read_head
from doppelgait.motion.readers.points import check_amount, check_rate
from doppelgait.motion.readers.table import find_whole_points, name_keypoints
from doppelgait.motion.readers.text import Points, Times, check_size, list_head_lines, point_format, read_lines
from doppelgait.motion.skeleton import list_points


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


POSITION_KEYS = ("positions", "joints", "Jtr")
NAME_KEYS = ("names", "joint_names")
RATE_KEYS = ("rate_hz", "mocap_framerate", "mocap_frame_rate", "fps")
UNIT_KEY = "units"
FEATURES = (251, 263)  # values of a frame of HumanML3D and KIT-ML, which are no positions


def sniff_arrays(path: Path, head: bytes) -> bool:
    """Return True if a file looks like npy, npz or motion JSON."""
    # an npz file is a zip archive with a .npy file as its first member
    text = head.removeprefix(b"\xef\xbb\xbf").lstrip()
    keys = (*POSITION_KEYS, *RATE_KEYS)
    return (
        head.startswith(NPY_MAGIC)
        or is_npz(head)
        or (text[:1] == b"{" and b'"asset"' not in text and any(f'"{key}"'.encode() in text for key in keys))
    )


@point_format("arrays", sniff_arrays, (".npy", ".npz", ".json"))
def parse_arrays(
    path: Path,
    *,
    key: str | None = None,
    skeleton: str | None = None,
    units: str | None = None,
    rate_hz: float | None = None,
) -> Points:
    """Read the positions of npy, npz or JSON files."""
    head = read_head(path)
    kind = "npy" if head.startswith(NPY_MAGIC) else "npz" if is_npz(head) else "json"
    if kind == "npy":
        content: dict[str, Any] = {POSITION_KEYS[0]: load_npy(path, MotionError)}
    elif kind == "npz":
        wanted = (*POSITION_KEYS, *NAME_KEYS, *RATE_KEYS, UNIT_KEY, *([key] if key else []))
        content = dict(load_npz(path, wanted, MotionError, lone=False))
    else:
        content = _load_json(path)
    # positions (T, P, 3), NaN where not finite
    name = _find_position_key(path, content, key)
    value = content[name]
    if isinstance(value, np.ndarray) and value.dtype.kind not in "fiu":
        raise MotionError(f"{path}: {name!r} holds {value.dtype} values; positions are real numbers")
    try:
        if isinstance(value, list):
            entries = np.array(value, dtype=object)
            for k in (k for k, number in enumerate(entries.flat) if isinstance(number, str | bool)):
                raise MotionError(
                    f"{path}: {name}{list(map(int, np.unravel_index(k, entries.shape)))} holds {entries.flat[k]!r}; "
                    "write a number, or null where a point was not seen"
                )
        array = np.asarray(value, dtype=np.float64)
    except (ValueError, TypeError, OverflowError):
        raise MotionError(f"{path}: {_describe_unevenness(name, value)}") from None
    if skeleton == "mediapipe" and array.ndim == 3 and array.shape[2] == 4:
        array = array[..., :3]  # the last value of a landmark is its visibility
    if array.ndim == 2 and array.shape[1] in FEATURES:
        raise MotionError(f"{path}: holds {array.shape[1]} features of a motion model; read the file of its joints")
    if array.ndim != 3 or array.shape[2] != 3:
        raise MotionError(
            f"{path}: {name!r} has the shape {array.shape}; it must be (frames, points, 3). Reshape it, or name "
            "another array: key='...'"
        )
    position = np.where(np.isfinite(array), array, np.nan)
    check_amount(path, *position.shape[:2])
    rate = _read_rate_hz(path, content) if rate_hz is None else None
    labels = _find_labels(path, content, position.shape[1], skeleton)
    stated = _convert_to_scalar(content.get(UNIT_KEY, ""))
    if isinstance(stated, bytes):
        stated = stated.decode("latin-1")
    if not units and not isinstance(stated, str):
        raise MotionError(f"{path}: {UNIT_KEY} is {stated!r}; it must be text such as 'm' or 'mm'")
    parts = read_skeletons()[skeleton or "smpl"][1]
    return Points(labels, position, unit=units or stated, rate_hz=rate, parts=parts, report={"format": kind})


def _load_json(path: Path) -> dict[str, Any]:
    check_size(path)
    try:
        content = parse_json(path.read_bytes())
    except ValueError as error:  # a fault of syntax has line and column, one of UTF-8 the byte
        raise MotionError(f"{path}: is not JSON of a motion: {error}") from None
    if not isinstance(content, dict):
        raise MotionError(f"{path}: is not a JSON object with the keys rate_hz, names, positions and units")
    return content


def _find_position_key(path: Path, content: Mapping[str, Any], key: str | None) -> str:
    held = ", ".join(content) or "nothing"
    if key is not None:
        if key not in content:
            raise MotionError(f"{path}: has no key {key!r}; it holds {held}")
        return key
    found = [name for name in POSITION_KEYS if name in content]
    if len(found) > 1:
        raise MotionError(f"{path}: holds {' and '.join(found)}; name the array of positions: key='{found[0]}'")
    if found:
        return found[0]
    if "poses" in content:
        raise MotionError(
            f"{path}: holds parameters of the SMPL body model (poses, trans, betas) but no positions, and they cannot "
            "be posed without that model, which is not part of doppelgait (licence at smpl.is.tue.mpg.de). Compute the "
            "joints with it, for example with the package smplx, and save them: "
            "numpy.savez('walk.npz', positions=joints, rate_hz=120), joints (frames, 22 or 24, 3) in m; read that with "
            "skeleton='smpl'."
        )
    raise MotionError(
        f"{path}: has no array of positions ({', '.join(POSITION_KEYS)}); it holds {held}. Name it: key='...'"
    )


def _describe_unevenness(name: str, frames: Any) -> str:
    """Describe the first irregular entry of nested lists."""
    lengths = [len(frame) if isinstance(frame, list) else -1 for frame in frames] if isinstance(frames, list) else []
    for t, length in enumerate(lengths):
        if length != lengths[0] or length < 0:
            return f"{name}[{t}] holds {max(length, 0)} points, {name}[0] holds {max(lengths[0], 0)}; all must be equal"
        for p, point in enumerate(frames[t]):
            if not isinstance(point, list) or len(point) != 3:
                return f"{name}[{t}][{p}] is not a list of x, y and z; write [null, null, null] for a gap"
    return f"{name!r} is not an array of numbers (frames, points, 3)"


def _read_rate_hz(path: Path, content: Mapping[str, Any]) -> float:
    rates = {
        name: check_rate(path, _convert_to_scalar(content[name]), said=f"{name} declares")
        for name in RATE_KEYS
        if content.get(name) is not None
    }
    if not rates:
        raise MotionError(
            f"{path}: names no frame rate ({', '.join(RATE_KEYS)}); give it: rate_hz=... (frames per second)"
        )
    if len(set(rates.values())) > 1:
        stated = " and ".join(f"{name}={rate:g}" for name, rate in rates.items())
        raise MotionError(f"{path}: states {stated}; give the true one: rate_hz=...")
    return next(iter(rates.values()))


def _convert_to_scalar(value: Any) -> Any:
    return value.item() if isinstance(value, np.ndarray) and value.size == 1 else value


def _find_labels(path: Path, content: Mapping[str, Any], n_points: int, skeleton: str | None) -> list[str]:
    """Return one label per point, from the file or of SMPL."""
    models = read_skeletons()
    allowed = ", ".join(f"{name!r} ({' or '.join(map(str, counts))})" for name, (counts, _) in models.items())
    if skeleton not in (None, *models):
        raise MotionError(f"{path}: skeleton={skeleton!r} is not allowed; allowed are {allowed}, with so many joints")
    key = next((name for name in NAME_KEYS if content.get(name) is not None), "")
    if key and skeleton:
        raise MotionError(f"{path}: names its points ({key}); leave out skeleton={skeleton!r}")
    if skeleton:
        counts, parts = models[skeleton]
        if n_points not in counts:
            raise MotionError(
                f"{path}: holds {n_points} points, not those of skeleton={skeleton!r}; known are {allowed}"
            )
        return list(parts)[:n_points]
    if not key and n_points in (count for counts, _ in models.values() for count in counts):
        warn_caller(f"{path}: names none of its {n_points} points. If they are joints of a model, give it: {allowed}")
    if not key:
        return [""] * n_points
    names = content[key].tolist() if isinstance(content[key], np.ndarray) else content[key]
    if isinstance(names, list):
        names = [name.decode("utf-8", "replace") if isinstance(name, bytes) else name for name in names]
        # a lone surrogate (half a character) in a name cannot be encoded
        names = [name.encode("utf-8", "replace").decode() if isinstance(name, str) else name for name in names]
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names) or len(names) != n_points:
        count = f"{len(names)} entries" if isinstance(names, list) else "no list"
        raise MotionError(f"{path}: {key} holds {count} for {n_points} points; it must be one text each")
    return names


def sniff_keypoints(path: Path, head: bytes) -> bool:
    """Return True if HDF5 holds a table of pandas, or positions of movement."""
    if not head.startswith(SIGNATURE):
        return False
    from h5py import Group, HardLink

    try:
        with open_hdf5(path, members=False) as file:
            names = list(file)
            tracks = "tracks" in names and (len(names) == 1 or "node_names" in names)
            if tracks or {"position", "space"} <= set(names):
                return True
            own = len(names) == 1 and isinstance(file.get(names[0], getlink=True), HardLink)
            return own and isinstance(file[names[0]], Group) and bool({"table", "block0_values"} & set(file[names[0]]))
    except FAULTS:
        return False


@point_format("keypoints", sniff_keypoints, (".h5", ".nc"))
def parse_keypoints(path: Path) -> Points:
    """Read three-dimensional keypoints of DeepLabCut (HDF5 of pandas), movement (netCDF) or SLEAP-Anipose."""
    try:
        with open_hdf5(path, soft_links=True) as file:
            if "tracks" in file:
                return _parse_sleap(path, file)
            return _parse_movement(path, file) if "position" in file else _parse_pandas(path, file[next(iter(file))])
    except FAULTS as error:
        raise MotionError(f"{path}: its keypoints cannot be read: {error}") from None


def _read_texts(dataset: Any) -> list[str]:
    return [text.decode("utf-8", "replace") if isinstance(text, bytes) else str(text) for text in dataset[:]]


def _parse_sleap(path: Path, file: Any) -> Points:
    """Parse tracks (frames, animals, nodes, 3), unlike those of one camera, (animals, 2, ...)."""
    shape = file["tracks"].shape
    if len(shape) != 4 or shape[3] != 3:
        raise MotionError(
            f"{path}: holds tracks of SLEAP with the shape {shape}, image coordinates; triangulate those of two or "
            "more calibrated cameras (sleap-anipose), which gives tracks (frames, animals, nodes, 3)"
        )
    nodes, owners = (_read_texts(file[name]) if name in file else [] for name in ("node_names", "track_names"))
    owners = owners if len(owners) == shape[1] else [str(n + 1) for n in range(shape[1])]
    labels = [f"{owner}:{node}" if len(owners) > 1 else node for owner in owners for node in nodes or [""] * shape[2]]
    return Points(labels, np.asarray(file["tracks"][:], dtype=np.float64).reshape(shape[0], -1, 3))


def _parse_pandas(path: Path, group: Any) -> Points:
    """Parse the values and the names of the columns, of the layouts table and fixed."""
    if "table" in group:
        if "values_block_1" in group["table"].dtype.names:
            raise ValueError("it holds columns of several types; write it as .csv")
        names = _parse_tuples(bytes(get_attribute(group["table"], "values_block_0_kind")))
        values = np.asarray(group["table"].fields("values_block_0")[:], dtype=np.float64)
    else:
        levels = [name for name in sorted(group) if name.startswith("block0_items_level")]
        codes = [group[name.replace("level", "label")][:] for name in levels]
        texts = [_read_texts(group[name]) for name in levels]
        names = [[text[n] for text, n in zip(texts, row, strict=True)] for row in zip(*codes, strict=True)]
        values = np.asarray(group["block0_values"][:], dtype=np.float64)
    # three levels, or four with individuals; scorer is the first
    titles = ("individuals", "bodyparts", "coords")[-max(len(names[0]) - 1, 0) :] if names else ()
    columns = list(zip(*names, strict=True))[1:]
    labels, used = find_whole_points(name_keypoints(path, dict(zip(titles, columns, strict=True))))
    return Points(labels, values[:, used].reshape(len(values), -1, 3))


def _parse_tuples(data: bytes) -> list[list[str]]:
    """Return the tuples of texts of a pickled list, which is parsed and never unpickled."""
    found: list[list[str]] = []
    open_texts: list[str] = []
    memo: dict[Any, str] = {}
    for code, value, _ in pickletools.genops(data):
        if code.name == "MARK":
            open_texts = []
        elif code.name == "UNICODE":
            open_texts.append(str(value))
        elif code.name == "PUT" and open_texts:
            memo[value] = open_texts[-1]
        elif code.name == "GET":
            open_texts.append(memo[value])
        elif code.name == "TUPLE":
            found.append(open_texts)
        elif code.name not in ("LIST", "PUT", "APPEND", "STOP"):
            raise ValueError(f"the names of its columns hold {code.name}, not only texts")
    return found


def _parse_movement(path: Path, file: Any) -> Points:
    """Parse positions along time, space, keypoints and individuals, in any order."""
    scale_names = ("time", "space", "keypoint", "keypoints", "individual", "individuals")
    scales = {int(get_attribute(file[name], "_Netcdf4Dimid")): name for name in scale_names if name in file}
    order = [scales[int(n)] for n in get_attribute(file["position"], "_Netcdf4Coordinates")]
    axes = {name.removesuffix("s"): n for n, name in enumerate(order)}
    names = {axis: _read_texts(file[order[n]]) for axis, n in axes.items() if axis != "time"}
    if names.get("space") != ["x", "y", "z"]:
        raise MotionError(
            f"{path}: has the axes {', '.join(axes)} with space {', '.join(names.get('space', []))}; three-dimensional "
            "positions have x, y and z. Triangulate the keypoints of two or more calibrated cameras"
        )
    wanted = [axes[axis] for axis in ("time", "individual", "keypoint", "space")]
    position = np.asarray(file["position"][:], dtype=np.float64).transpose(wanted)
    labels = [f"{owner}:{name}" for owner in names["individual"] for name in names["keypoint"]]
    if position.shape[1:] != (len(names["individual"]), len(names["keypoint"]), 3):
        raise MotionError(f"{path}: names {len(labels)} points; its positions are {position.shape}")
    fps, seconds = get_attribute(file, "fps"), np.asarray(file["time"][:], dtype=np.float64)
    is_timed = get_attribute(file, "time_unit") in ("seconds", b"seconds") and np.isfinite(seconds).all()
    digit_s = 1e-9 * max(float(np.abs(seconds).max(initial=0.0)), 1.0)
    return Points(
        labels,
        position.reshape(len(position), -1, 3),
        rate_hz=None if fps is None else float(np.asarray(fps).ravel()[0]),
        times=Times(seconds, range(len(seconds)), digit_s, digit_s) if is_timed else None,
    )
