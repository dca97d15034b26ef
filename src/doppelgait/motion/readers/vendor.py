"""Exports of motion-capture and pose-estimation programs: text tables with a header, and HDF5."""

from __future__ import annotations

import pickletools
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from doppelgait.core.errors import MotionError
from doppelgait.core.own_hdf5 import FAULTS, SIGNATURE, get_attribute, open_hdf5
from doppelgait.core.units import FloatArray
from doppelgait.motion.clean import MIN_MARKERS
from doppelgait.motion.readers.points import check_amount, is_unlabelled
from doppelgait.motion.readers.table import Column, find_points, read_columns, read_header, read_rows, split_rows
from doppelgait.motion.readers.text import (
    BLANK,
    Points,
    Row,
    Times,
    is_finite,
    list_head_lines,
    note_frames,
    point_format,
    read_lines,
    read_times,
    to_numbers,
    trim_cells,
)


def _find_whole_points(columns: Sequence[Column | None]) -> tuple[list[str], list[int]]:
    """Return the names of the points with x, y and z, and their columns."""
    whole = [(name, axes) for name, axes in find_points(columns) if len(axes) == 3]
    return [name for name, _ in whole], [axes[a] for _, axes in whole for a in "xyz"]


def _arrange(
    path: Path, columns: Sequence[Column | None], rows: Sequence[Row], **limits: Any
) -> tuple[list[str], FloatArray]:
    """Return names and positions (T, P, 3) of the points that columns hold."""
    labels, used = _find_whole_points(columns)
    titles = [f"{name} {axis}" for name in labels for axis in "xyz"]
    return labels, read_columns(path, rows, used, titles, **limits)


MOTIVE_KINDS = ("marker", "bone marker", "rigid body marker", "bone", "rigid body")
"""Kinds of points of Motive, the best first: measured markers before those of a solved body."""


@point_format("motive", rb'(?i)"?format version"?[,;\t]', (".csv",))
def parse_motive(path: Path) -> Points:
    """Read the markers, bones or rigid bodies of a Motive CSV export."""
    rows = read_rows(path)
    header = {key.lower(): value for key, value in zip(rows[0][1][::2], rows[0][1][1::2], strict=False)}
    at = next((i for i, (_, cells) in enumerate(rows[:12]) if cells[0].lower() == "frame"), -1)
    if at < 4:
        raise MotionError(f"{path}: has no header of types, names and axes above Frame")
    # older versions write no titles in front of the rows of types and names
    titled = {[*cells, ""][1].lower(): cells for _, cells in rows[at - 1 : 0 : -1]}
    types, names = (titled.get(key, rows[n][1]) for key, n in (("type", 1), ("name", 2)))
    columns: dict[str, list[Column | None]] = {}
    n_columns = len(rows[at][1])
    for i, (kind, name, meaning, axis) in enumerate(zip(types, names, rows[at - 1][1], rows[at][1], strict=False)):
        if meaning.lower() == "position" and axis.lower() in ("x", "y", "z"):
            columns.setdefault(kind.lower(), [None] * n_columns)[i] = (name, axis.lower())
    counts = {kind: len({c[0] for c in held if c and not is_unlabelled(c[0])}) for kind, held in columns.items()}
    kinds = [kind for kind in (*MOTIVE_KINDS, *counts) if counts.get(kind, 0) >= MIN_MARKERS]
    if not kinds:
        listed = ", ".join(f"{count} of type {kind}" for kind, count in counts.items()) or "none"
        raise MotionError(f"{path}: a body needs {MIN_MARKERS} named points or more; it has {listed}")
    space = header.get("coordinate space", "global")
    if space.lower() not in ("global", "world") and "marker" not in kinds[0]:
        raise MotionError(f"{path}: its {kinds[0]} positions are {space!r}; export them as Global")
    rows, title = rows[at + 1 :], rows[at][1][1]
    labels, position = _arrange(path, columns[kinds[0]], rows)
    others = [f"{counts[kind]} of type {kind}" for kind in counts if kind != kinds[0]]
    return Points(
        labels,
        position,
        unit=header.get("length units", ""),
        rate_hz=header.get("export frame rate", "").replace(",", "."),
        times=read_times(path, rows, 1, title) if title.lower().startswith("time") else None,
        usual_up="y",
        notes=[
            *note_frames(path, header.get("total exported frames", ""), len(rows)),
            *([f"points left out: {', '.join(others)}"] if others else []),
        ],
    )


NEXUS_BLOCKS = ("trajectories", "devices", "model outputs", "joints", "segments", "events", "imu")


def sniff_nexus(path: Path, head: bytes) -> bool:
    """Return True if a block of Nexus and a rate are first."""
    title, rate = [line.strip('",;\t ') for line in list_head_lines(path, head, 2)[:2]]
    return title.lower() in NEXUS_BLOCKS and is_finite(re.split("[,;\t]", rate)[0])


@point_format("nexus", sniff_nexus, (".csv", ".txt"))
def parse_nexus(path: Path) -> Points:
    """Read the block Trajectories of a Nexus export."""
    rows = read_rows(path, 5)
    titles = [i for i, (_, cells) in enumerate(rows) if cells[0].lower() in NEXUS_BLOCKS and not any(cells[1:])]
    at = next((i for i in titles if rows[i][1][0].lower() == "trajectories"), -1)
    if at < 0:
        held = ", ".join(rows[i][1][0] for i in titles)
        raise MotionError(f"{path}: holds {held}, but no block Trajectories; export it")
    block = rows[at : next((i for i in titles if i > at), len(rows))]
    frames = [row for row in block[4:] if is_finite(row[1][0])]
    if not frames:
        raise MotionError(f"{path}: its block Trajectories holds no frames")
    header = read_header(path, block[2:4])
    position = read_columns(path, frames, header.columns, [header.titles[i] for i in header.columns])
    # older versions have no row of units
    units = ([] if block[4] in frames else block[4][1]) + [""] * len(header.titles)
    each = np.array([units[i] or "mm" for i in header.columns]).reshape(-1, 3).tolist()
    rate = block[1][1][0].replace(",", ".")
    # numbers of frames that are skipped show as uneven times
    step_s = 1.0 / float(rate) if is_finite(rate) and float(rate) > 0.0 else 1.0
    time_s = to_numbers(path, frames, [0], ["Frame"])[:, 0] * step_s
    times = Times(time_s, [line for line, _ in frames], 1e-6 * step_s, 1e-6 * step_s)
    return Points(header.labels, position, each=each, rate_hz=rate, times=times)


MAX_KEYS = 40  # maximum number of lines of a header of Qualisys


@point_format("qualisys", rb"NO_OF_FRAMES\t", (".tsv",))
def parse_qualisys(path: Path) -> Points:
    """Read the markers of a Qualisys TSV export."""
    rows = read_rows(path, delimiter="\t")
    keys = [cells[0] for _, cells in rows[:MAX_KEYS]]
    header = {key: trim_cells(cells[1:]) for key, (_, cells) in zip(keys, rows, strict=False)}
    value = {key: values[0] for key, values in header.items() if values}
    names = header.get("MARKER_NAMES", [])
    if not names:
        kind = "rigid bodies" if "BODY_NAMES" in header else "a skeleton" if "SOLVER" in header else "no markers"
        raise MotionError(f"{path}: holds {kind}; export the 3D data of the markers as TSV")
    frames = rows[keys.index("MARKER_NAMES") + 1 :]
    # rows of types and of column names may follow; a point that is not seen may be NULL
    while frames and any(not is_finite(c.replace(",", ".")) and c.lower() not in BLANK for c in frames[0][1][:2]):
        frames = frames[1:]
    check_amount(path, len(frames), len(names))
    # frame numbers are integers, coordinates have decimals; lines may end with a tab
    lead = 1 if frames[0][1][0].isdecimal() else 0
    lead += lead and max(len(trim_cells(cells)) for _, cells in frames) > 3 * len(names) + 1
    columns = [None] * lead + [(f"{name}\t{n}", axis) for n, name in enumerate(names) for axis in "xyz"]
    labels, position = _arrange(path, columns, frames, most=len(columns), missing=0.0)
    return Points(
        [label.rsplit("\t", 1)[0] for label in labels],
        position,
        unit="mm",
        rate_hz=value.get("FREQUENCY", "").replace(",", "."),
        times=read_times(path, frames, 1, "Time") if lead == 2 else None,
        notes=note_frames(path, value.get("NO_OF_FRAMES", ""), len(frames)),
    )


VISUAL3D_POINTS = ("TARGET", "LANDMARK")


def sniff_visual3d(path: Path, head: bytes) -> bool:
    """Return True if the fifth line starts with ITEM."""
    return head[:1] == b"\t" and list_head_lines(path, head, 5)[4].startswith("ITEM\t")


@point_format("visual3d", sniff_visual3d, (".txt",))
def parse_visual3d(path: Path) -> Points:
    """Read the targets and landmarks of a Visual3D text export."""
    rows = read_rows(path, delimiter="\t")
    files, names, kinds, _, axes = (cells for _, cells in rows[:5])
    if len(held := dict.fromkeys(filter(None, files))) > 1:
        raise MotionError(f"{path}: holds {len(held)} recordings ({', '.join(held)}); export one")
    columns: list[Column | None] = [
        (name, axis.lower()) if kind in VISUAL3D_POINTS and axis in ("X", "Y", "Z") else None
        for name, kind, axis in zip(names, kinds, axes, strict=False)
    ]
    if not any(columns):
        raise MotionError(
            f"{path}: holds {', '.join(sorted(set(kinds) - {''}))}; positions are {' and '.join(VISUAL3D_POINTS)}"
        )
    labels, position = _arrange(path, columns, rows[5:])
    time = names.index("TIME") if "TIME" in names else None
    times = None if time is None else read_times(path, rows[5:], time, "TIME")
    return Points(labels, position, unit="m", times=times)


_OPENSIM_AXIS = re.compile(r"(?i)(.+?)_[tp]?([xyz])")
_NO_POSITION = re.compile(r"(?i)veloc|accel|force|moment|error")


@point_format("opensim", rb"(?ims)(.*^)?endheader[ \t\r]*$", (".sto", ".mot"))
def parse_opensim(path: Path) -> Points:
    """Read marker locations or body positions of an OpenSim storage file."""
    lines = read_lines(path)
    end = next(i for i, line in enumerate(lines) if line.strip().lower() == "endheader")
    header = dict(line.split("=", 1) for line in lines[:end] if "=" in line)
    kind, is_vector = header.get("DataType", "double").strip(), header.get("DataType", "").strip() == "Vec3"
    values = [line.replace(",", "\t") for line in lines[end + 1 :]] if is_vector else lines[end + 1 :]
    rows = split_rows(path, [""] * (end + 1) + values, " ")
    titles = [cell.strip() for cell in rows[0][1]] if rows else []
    names = [re.sub(r"\|\w*?(?=_[123]$|$)", "", title.rsplit("/", 1)[-1]) for title in titles]
    columns: list[Column | None] = [None]
    for name in names[1:]:
        match = _OPENSIM_AXIS.fullmatch(name)
        flat = [f"{name[:-1]}{n}" for n in "123"]  # of a table of vectors that was flattened
        if is_vector:
            columns += [(name, axis) for axis in "xyz"]
        elif match:
            columns.append((match[1], match[2].lower()))
        else:
            columns.append((name[:-2], "xyz"[flat.index(name)]) if name in flat and {*flat} <= {*names} else None)
    if kind not in ("double", "Vec3") or not any(columns) or _NO_POSITION.search(lines[0]):
        raise MotionError(
            f"{path}: holds {lines[0].strip() or 'values'} ({', '.join(titles[1:4])}, ...), no positions; "
            "let OpenSim report the marker locations, or export the markers as TRC"
        )
    labels, position = _arrange(path, columns, rows[1:])
    times = read_times(path, rows[1:], 0, titles[0])
    return Points(labels, position, unit=header.get("units", "m").strip(), times=times, usual_up="y")


def sniff_deeplabcut(path: Path, head: bytes) -> bool:
    """Return True if the first rows are scorer, individuals or bodyparts, and coords."""
    return [re.split("[,;\t]", line)[0] for line in list_head_lines(path, head, 2)[:2]] in (
        ["scorer", "individuals"],
        ["scorer", "bodyparts"],
    )


@point_format("deeplabcut", sniff_deeplabcut, (".csv",))
def parse_deeplabcut(path: Path) -> Points:
    """Read the keypoints of a three-dimensional DeepLabCut table."""
    rows = read_rows(path)
    at = next((i for i, (_, cells) in enumerate(rows[:5]) if cells[0] == "coords"), -1)
    if at < 0:
        raise MotionError(f"{path}: has no row coords below scorer and bodyparts")
    columns = _name_keypoints(path, {cells[0]: cells[1:] for _, cells in rows[: at + 1]})
    at += any(not is_finite(cells[0]) and not any(cells[1:]) for _, cells in rows[at + 1 : at + 2])  # name of the index
    return Points(*_arrange(path, [None, *columns], rows[at + 1 :]))


def _name_keypoints(path: Path, levels: Mapping[str, Sequence[str]]) -> list[Column | None]:
    """Return the columns with the levels individuals, bodyparts and coords."""
    if not {"bodyparts", "coords"} <= set(levels):
        raise MotionError(f"{path}: its columns have no levels bodyparts and coords")
    if "z" not in levels["coords"]:
        raise MotionError(
            f"{path}: holds image coordinates (x and y in pixels); triangulate the keypoints of two or more calibrated "
            "cameras, and read the file of three-dimensional keypoints"
        )
    owners = levels.get("individuals", [""] * len(levels["bodyparts"]))
    names = [f"{owner}:{name}" if owner else name for owner, name in zip(owners, levels["bodyparts"], strict=False)]
    return [(n, a) if a in ("x", "y", "z") else None for n, a in zip(names, levels["coords"], strict=False)]


def sniff_keypoints(path: Path, head: bytes) -> bool:
    """Return True if HDF5 holds a table of pandas, or positions of movement."""
    if not head.startswith(SIGNATURE):
        return False
    from h5py import Group, HardLink

    try:
        with open_hdf5(path, members=False) as file:
            names = list(file)
            if {"position", "space"} <= set(names):
                return True
            own = len(names) == 1 and isinstance(file.get(names[0], getlink=True), HardLink)
            return own and isinstance(file[names[0]], Group) and bool({"table", "block0_values"} & set(file[names[0]]))
    except FAULTS:
        return False


@point_format("keypoints", sniff_keypoints, (".h5", ".nc"))
def parse_keypoints(path: Path) -> Points:
    """Read three-dimensional keypoints of DeepLabCut (HDF5 of pandas) or of movement (netCDF)."""
    try:
        with open_hdf5(path, soft_links=True) as file:
            return _parse_movement(path, file) if "position" in file else _parse_pandas(path, file[next(iter(file))])
    except FAULTS as error:
        raise MotionError(f"{path}: its keypoints cannot be read: {error}") from None


def _read_texts(dataset: Any) -> list[str]:
    return [text.decode("utf-8", "replace") if isinstance(text, bytes) else str(text) for text in dataset[:]]


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
    labels, used = _find_whole_points(_name_keypoints(path, dict(zip(titles, columns, strict=True))))
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
    fps, seconds = get_attribute(file, "fps"), np.asarray(file["time"][:], dtype=np.float64)
    is_timed = get_attribute(file, "time_unit") in ("seconds", b"seconds") and np.isfinite(seconds).all()
    digit_s = 1e-9 * max(float(np.abs(seconds).max(initial=0.0)), 1.0)
    return Points(
        labels,
        position.reshape(len(position), -1, 3),
        rate_hz=None if fps is None else float(np.asarray(fps).ravel()[0]),
        times=Times(seconds, range(len(seconds)), digit_s, digit_s) if is_timed else None,
    )
