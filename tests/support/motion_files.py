"""Files of motion-capture programs, as several versions of each program write them."""

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from scipy.spatial.transform import Rotation

from walking_body import NAMES, walking_body, y_up

RATE_HZ = 80.0
BODY_M = walking_body(rate_hz=RATE_HZ)
BODY_M[5:7, 2] = np.nan
Text = Callable[[np.ndarray], str]


def lines(*rows: list[Any], separator: str = ",", end: str = "\r\n") -> str:
    cells = [
        ["" if cell != cell else f"{cell:.6f}" if isinstance(cell, float) else str(cell) for cell in row]
        for row in rows
    ]
    return end.join([separator.join(row) for row in cells] + [""])


def frames(body: np.ndarray, *, first: int = 0, time: bool = True, extra: int = 0) -> list[list[Any]]:
    """Rows of frame number, time, ``extra`` other values and positions."""
    lead = [[k + first, *([k / RATE_HZ] if time else []), *[0.5] * extra] for k in range(len(body))]
    return [[*start, *row] for start, row in zip(lead, body.reshape(len(body), -1).tolist(), strict=True)]


def thrice(names: list[str]) -> list[str]:
    return [name for name in names for _ in "xyz"]


def motive(version: str, unit: str, metres: float, *, kind: str = "Marker", bones: bool = False) -> Text:
    """Version 1.2 has no titles of the header rows, 1.24 a column of time codes; bones have quaternions."""

    def write(body: np.ndarray) -> str:
        body = y_up(body) / metres
        stamp, titled = version >= "1.24", version != "1.2"
        lead = [["", title if titled else ""] + [""] * stamp for title in ("Type", "Name", "ID", "")]
        names = [f"Jim:{name}" for name in NAMES]
        blocks = [thrice([kind] * 16), thrice(names), [f'"{n // 3:04X}"' for n in range(48)], ["Position"] * 48]
        axes = list("XYZ" * 16)
        if bones:
            for block, cell in zip(blocks, (["Bone"] * 7, ["Jim:Hip"] * 7, ["1"] * 7), strict=False):
                block[:0] = cell
            blocks[3][:0] = ["Rotation"] * 4 + ["Position"] * 3
            axes[:0] = list("XYZWXYZ")
            for block, cell in zip([*blocks, axes], ("Marker", "Unlabeled 1189", "9", "Position", ""), strict=True):
                block += [cell] * 3
            axes[-3:] = list("XYZ")
        head = f"Format Version,{version},Take Name,walk,Capture Frame Rate,240,Export Frame Rate,{RATE_HZ:.6f},"
        head += f"Total Exported Frames,{len(body)},Length Units,{unit},Coordinate Space,Global"
        data = frames(body, extra=7 if bones else 0)
        for k, row in enumerate(data):
            row[2:2] = [f"15:26:46:{k}"] if stamp else []
            row += [1.0, 2.0, 3.0] if bones and k % 2 else [""] * 3 * bones
        columns = ["Frame", "Time (Seconds)", *["TimeCode"] * stamp]
        rows = [start + block for start, block in zip(lead, blocks, strict=True)]
        return lines([head], [], *rows, columns + axes, *data)

    return write


DEVICES = "Devices\n800\n,,Force\nFrame,Sub Frame,Fx\n,,N\n" + "".join(
    f"{k},{n},1.5\n" for k in range(9) for n in range(10)
)
OUTPUTS = "\nModel Outputs\n80\n,,Jim:LKneeAngles\nFrame,Sub Frame,X,Y,Z\n,,deg,deg,deg\n301,0,1.0,2.0,3.0\n"


def nexus(separator: str, *, around: bool, old: bool = False) -> Text:
    """With other blocks around the trajectories, or of version 1: no subframes, no units, the rate with its unit."""

    def write(body: np.ndarray) -> str:
        head = [["Field #" if old else "Frame,Sub Frame", *"XYZ" * 16], [",", *["mm"] * 48]][: 1 if old else 2]
        data = [[row[0], *[0] * (not old), *row[1:]] for row in frames(1e3 * body, first=301, time=False)]
        names = "," * (not old) + "".join(f",Jim:{name},," for name in NAMES)
        title = f"TRAJECTORIES\n{RATE_HZ:g},Hz\n" if old else f"Trajectories\n{RATE_HZ:g}\n"
        text = title + names + "\n" + lines(*head, *data, end="\n")
        return (f"{DEVICES}\n{text}{OUTPUTS}" if around else text).replace(",", separator)

    return write


def qualisys(*, columns: int = 0, types: bool = False, gap: str = "0.000", kind: str = "3D") -> Text:
    def write(body: np.ndarray) -> str:
        data = [row[:columns] + [gap if c != c else c for c in row[2:]] for row in frames(1e3 * body, first=1)]
        facts = f"NO_OF_FRAMES={len(body)} NO_OF_MARKERS=16 FREQUENCY={RATE_HZ:g} DATA_INCLUDED={kind}"
        head = [fact.split("=") for fact in facts.split()] + [
            ["MARKER_NAMES" if kind == "3D" else "BODY_NAMES", *NAMES]
        ]
        if columns == 2:
            head.append(["Frame", "Time", *[f"{name} {axis}" for name in NAMES for axis in "XYZ"]])
        if types:  # newer versions also end each line with a tab
            head.append(["TRAJECTORY_TYPES", *["Measured"] * 16])
        return lines(*[[*row, *[""] * types] for row in [*head, *data]], separator="\t")

    return write


def visual3d(body: np.ndarray) -> str:
    names = ["TIME", *thrice(["KNEE"]), *thrice(NAMES)]
    kinds = ["FRAME_NUMBERS", *["LINK_MODEL_BASED"] * 3, *["TARGET"] * 48]
    head = [["", *["a.c3d"] * 52], ["", *names], ["", *kinds], ["", *["ORIGINAL"] * 52], ["ITEM", "X", *"XYZ" * 17]]
    return lines(*head, *frames(body, first=1, extra=3), separator="\t")


def opensim(form: str, name: str = "ModelMarkerLocations") -> Text:
    def write(body: np.ndarray) -> str:
        head = [[name], ["version=3"], *([["DataType=Vec3"], ["units=m"]] if form == "Vec3" else []), ["endheader"]]
        labels = [form.format(name=n, axis=a, n="xyz".index(a) + 1) for n in NAMES for a in "xyz"]
        data = [row[1:] for row in frames(y_up(np.nan_to_num(body, nan=0.1)), first=1)]
        data = [["nan" if np.isnan(body[k, i // 3, 0]) else c for i, c in enumerate(r[1:])] for k, r in enumerate(data)]
        if form == "Vec3":
            labels, data = NAMES, [[",".join(str(c) for c in r[i : i + 3]) for i in range(0, 48, 3)] for r in data]
        rows = [[k / RATE_HZ, *row] for k, row in enumerate(data)]
        return lines(*head, ["time", *labels], *rows, separator="\t", end="\n")

    return write


def deeplabcut(*, individuals: bool = False, coords: str = "xyz") -> Text:
    def write(body: np.ndarray) -> str:
        names = [name for name in NAMES for _ in coords]
        data = [
            row[:1] + [c for k in range(16) for c in (*row[3 * k + 1 : 3 * k + 4], 0.9)[: len(coords)]]
            for row in frames(100 * body, time=False)
        ]
        levels = {"scorer": ["net"], "individuals": ["Rex"], "bodyparts": names, "coords": [*coords] * 16}
        rows = [[level, *(cells * len(names))[: len(names)]] for level, cells in levels.items()]
        rows = [[cell.replace("l", "likelihood") if cell == "l" else cell for cell in row] for row in rows] + data
        if not individuals:
            del rows[1]
        else:
            others = [["net"] * 3, ["Tom"] * 3, ["nose"] * 3, list("xyz")]
            rows = [row + (others[k] if k < 4 else [1.0, 2.0, 3.0]) for k, row in enumerate(rows)]
        return lines(*rows, end="\n")

    return write


def anipose(body: np.ndarray) -> str:
    columns = [f"{name}_{end}" for name in NAMES for end in ("x", "y", "z", "error", "ncams", "score")]
    data = [
        [c for i in range(0, 48, 3) for c in (*row[i : i + 3], 1.2, 3, 0.9)] + [k]
        for k, row in enumerate(body.reshape(len(body), -1).tolist())
    ]
    return lines([*columns, "fnum"], *data, end="\n")


def trc(body: np.ndarray) -> str:
    keys = ["DataRate", "CameraRate", "NumFrames", "NumMarkers", "Units"]
    head = [["PathFileType", 4, "(X/Y/Z)"], keys, [RATE_HZ, RATE_HZ, len(body), 16, "mm"]]
    names = ["Frame#", "Time", *[c for name in NAMES for c in (name, "", "")]]
    axes = ["", "", *[f"{axis}{n + 1}" for n in range(16) for axis in "XYZ"]]
    return lines(*head, names, axes, [], *frames(1e3 * y_up(body), first=1), separator="\t")


KINECT = [3, 4, 7, 8, 11, 12, 15, 16, 19]
"""Joints of Kinect v2 in the place of the first points of the body: head, shoulders, hands, hips, feet."""


def kinect(body: np.ndarray) -> str:
    """One body, in two frames after it another that leaves again; the last value of a lost joint is 0."""
    rows: list[list[Any]] = [[len(body)]]
    for k, points in enumerate(y_up(body)):
        joints = np.zeros((25, 3)) + np.nanmean(points, axis=0)
        joints[KINECT] = points[: len(KINECT)]
        words = [
            [*(0.0 if c != c else float(c) for c in j), *[0] * 8, 2 if np.isfinite(j).all() else 0] for j in joints
        ]
        rows += [[int(k > 1)]] if k < 2 else [[1], [7, *[0] * 9], [25], *words]
    return lines(*rows, separator=" ", end="\n")


def mvnx(body: np.ndarray) -> str:
    segments = "".join(f'<segment id="{n + 1}" label="{name}"><points/></segment>' for n, name in enumerate(NAMES))
    poses = '<frame type="tpose"><position>' + "0 " * 48 + "</position></frame>"
    rows = [" ".join(f"{0.0 if c != c else c:.6f}" for c in frame.ravel()) for frame in body]
    normal = [
        f'<frame time="{k / RATE_HZ * 1e3:.0f}" type="normal"><orientation>1 0</orientation>'
        f"<position>{row}</position></frame>"
        for k, row in enumerate(rows)
    ]
    return (
        '<?xml version="1.0"?><mvnx version="4" xmlns="http://www.xsens.com/mvn/mvnx"><!-- MVN -->'
        f'<subject label="Jim" frameRate="{RATE_HZ:g}"><segments>{segments}</segments><frames>{poses}\n'
        + "\n".join(normal)
        + "</frames></subject></mvnx>"
    )


TEXTS: dict[str, tuple[str, Text, dict[str, Any]]] = {
    "motive": ("csv", motive("1.23", "Meters", 1.0), {}),
    "motive bones": ("csv", motive("1.25", "Centimeters", 0.01, bones=True), {}),
    "motive without titles": ("csv", motive("1.2", "Millimeters", 1e-3, kind="Rigid Body"), {}),
    "nexus": ("csv", nexus(",", around=False), {}),
    "nexus old": ("csv", nexus(",", around=False, old=True), {}),
    "nexus blocks": ("txt", nexus("\t", around=True), {}),
    "qualisys": ("tsv", qualisys(), {}),
    "qualisys frames": ("tsv", qualisys(columns=1, gap=""), {}),
    "qualisys columns": ("tsv", qualisys(columns=2, gap="NULL"), {}),
    "qualisys types": ("tsv", qualisys(types=True), {}),
    "qualisys tabs": ("tsv", qualisys(columns=1, types=True, gap="NULL"), {}),
    "qualisys times": ("tsv", qualisys(columns=2, types=True), {}),
    "visual3d": ("txt", visual3d, {}),
    "opensim": ("sto", opensim("{name}_t{axis}"), {}),
    "opensim bodies": ("sto", opensim("{name}_{axis}"), {}),
    "opensim flat": ("mot", opensim("/markerset/{name}|location_{n}"), {}),
    "opensim vectors": ("sto", opensim("Vec3"), {}),
    "deeplabcut": ("csv", deeplabcut(), {"units": "cm", "rate_hz": RATE_HZ}),
    "deeplabcut individuals": (
        "csv",
        deeplabcut(individuals=True, coords="xyzl"),
        {"units": "cm", "rate_hz": RATE_HZ, "subject": "Rex"},
    ),
    "trc": ("trc", trc, {}),
    "table": ("csv", anipose, {"units": "m", "rate_hz": RATE_HZ}),
}


JOINTS: dict[str, tuple[str, Text, dict[str, Any]]] = {
    "kinect": ("skeleton", kinect, {"rate_hz": RATE_HZ}),
    "mvnx": ("mvnx", mvnx, {}),
}

BONES = {
    "Armature": (-1, (0.0, 0.0, 0.0)),
    "Hips": (0, (0.0, 0.0, 90.0)),
    "Spine": (1, (0.0, 0.0, 30.0)),
    "Head": (2, (0.0, 0.0, 45.0)),
    "LeftUpLeg": (1, (10.0, 0.0, 0.0)),
    "LeftLeg": (4, (0.0, 0.0, -42.0)),
    "LeftFoot": (5, (0.0, 0.0, -42.0)),
    "RightUpLeg": (1, (-10.0, 0.0, 0.0)),
    "RightLeg": (7, (0.0, 0.0, -42.0)),
    "RightFoot": (8, (0.0, 0.0, -42.0)),
    "Camera": (-1, (5.0, 5.0, 5.0)),
}
KEYS_S = np.linspace(0.0, 2.0, 9)
CUBIC = np.array([[0.0, 3.0, -2.0, 5.0], [0.0, -90.0, 20.0, -4.0], [90.0, 1.0, 2.0, -1.0]])
SPIN = Rotation.from_euler("xyz", [0.8, 0.3, 0.2])


def glb(path: Path, *, times_s: np.ndarray = KEYS_S, rotations: str = "f4", how: str = "LINEAR", **scene: Any) -> Path:
    """A skeleton in cm below an armature: cubic travel, steady swing, a leg that steps, and a key of scale."""
    powers = np.vander(times_s, 4, increasing=True)
    slopes = np.stack([np.zeros_like(times_s), np.ones_like(times_s), 2 * times_s, 3 * times_s**2], axis=1)
    travel = np.stack([slopes @ CUBIC.T, powers @ CUBIC.T, slopes @ CUBIC.T], axis=1).reshape(-1, 3)
    swing = Rotation.from_rotvec(times_s[:, None] * SPIN.as_rotvec()).as_quat()
    swing[::2] *= -1.0  # the same rotations
    steps = Rotation.from_euler("x", 0.3 * (np.arange(len(times_s)) % 2)[:, None]).as_quat()
    arrays = [times_s[:, None], travel, swing, steps]
    tracks = [(1, "translation", "CUBICSPLINE"), (4, "rotation", how), (7, "rotation", "STEP")]
    binary, views, accessors = b"", [], []
    for n, values in enumerate(arrays):
        stored = values.astype("<f4")
        if n >= 2 and rotations == "i2":
            stored = np.rint(values * 32767).astype("<i2")
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": stored.nbytes})
        kind = {"f": 5126, "i": 5122}[stored.dtype.kind]
        size = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}[values.shape[1]]
        accessors.append({"bufferView": n, "componentType": kind, "count": len(values), "type": size})
        binary += stored.tobytes()
    nodes: list[dict[str, Any]] = [{"name": name, "translation": at} for name, (_, at) in BONES.items()]
    for n, (parent, _) in enumerate(BONES.values()):
        if parent >= 0:
            nodes[parent].setdefault("children", []).append(n)
    nodes[0] |= {"rotation": Rotation.from_euler("x", -90, degrees=True).as_quat().tolist(), "scale": [0.01] * 3}
    nodes[8] = {**nodes[8], "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 2, 0, *nodes[8].pop("translation"), 1]}
    samplers = [{"input": 0, "output": n + 1, "interpolation": how} for n, (_, _, how) in enumerate(tracks)]
    channels = [{"sampler": n, "target": {"node": node, "path": what}} for n, (node, what, _) in enumerate(tracks)]
    content = {
        **{"asset": {"version": "2.0"}, "nodes": nodes, "skins": [{"joints": list(range(1, 10))}]},
        **{"buffers": [{"byteLength": len(binary)}], "bufferViews": views, "accessors": accessors},
        "animations": [{"name": "walk", "samplers": samplers, "channels": channels}],
        **scene,
    }
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    chunks = [struct.pack("<I", len(c)) + kind + c for kind, c in ((b"JSON", text), (b"BIN\0", binary))]
    path.write_bytes(b"glTF" + struct.pack("<II", 2, 12 + sum(map(len, chunks))) + b"".join(chunks))
    return path


def write_movement(path: Path, *, axes: tuple[str, ...], space: str = "xyz", more: int = 0, **attributes: Any) -> Path:
    sizes = {"time": len(BODY_M), "space": len(space), "keypoints": 16, "individuals": 2}
    position = np.stack([BODY_M, BODY_M + 1.0])[..., : len(space)]  # individuals, time, keypoints, space
    order = ["individuals", "time", "keypoints", "space"]
    with h5py.File(path, "w") as file:
        file["position"] = position.transpose(
            [order.index(axis.rstrip("s") + "s" * (axis != "time" and axis != "space")) for axis in axes]
        )
        labels = {"space": list(space), "keypoints": NAMES + ["tail"] * more, "individuals": ["Eva", "Jim"]}
        for n, axis in enumerate(axes):
            key = next(name for name in sizes if name.rstrip("s") == axis.rstrip("s"))
            file[axis] = np.arange(sizes[key]) / RATE_HZ if axis == "time" else labels[key]
            file[axis].make_scale(axis)
            file["position"].dims[n].attach_scale(file[axis])
            file[axis].attrs["_Netcdf4Dimid"] = np.int32(n)
        file["position"].attrs["_Netcdf4Coordinates"] = np.arange(4, dtype=np.int32)
        file.attrs.update(attributes)
    return path
