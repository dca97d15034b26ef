"""Text tables: TRC, tables with a row of names, exports of motion capture and pose estimation."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from doppelgait.core.documents import CELL_BYTES, check_cost
from doppelgait.core.errors import MotionError, warn_caller
from doppelgait.core.units import FloatArray
from doppelgait.motion.clean import MIN_MARKERS
from doppelgait.motion.readers.points import check_amount, convert_unit_to_metres, is_unlabelled
from doppelgait.motion.readers.text import (
    BLANK,
    MAX_DIGITS,
    Points,
    Row,
    Times,
    is_finite,
    is_other,
    list_head_lines,
    note_frames,
    point_format,
    read_lines,
    read_times,
    starts_with,
    to_numbers,
    trim_cells,
)

TRC = rb"(?i)PathFileType"
HEADER_LINES = 12
FIRST = 2  # number of cells before the first coordinate: frame number and time


@point_format("trc", TRC, (".trc",))
def parse_trc(path: Path) -> Points:
    """Read the markers of a TRC file."""
    # blank cells and points at exactly 0, 0, 0 are gaps
    lines = read_lines(path)
    mark = re.search(r"(?im)^ *frame#? *([;,])", "\n".join(lines[:HEADER_LINES]))
    rows = [(n, [cell.strip() for cell in cells]) for n, cells in split_rows(path, lines, mark[1] if mark else " ")]
    at = next((i for i, (_, cells) in enumerate(rows[:HEADER_LINES]) if cells[0].lower().startswith("frame")), -1)
    if at < 1:
        raise MotionError(
            f"{path}: has no line that starts with Frame# and Time and names the markers (TRC: the fourth line)"
        )
    header, names = _parse_header([cells for _, cells in rows[:at]]), rows[at][1][FIRST:]
    axes = trim_cells(rows[at + 1][1]) if at + 1 < len(rows) else []
    has_axes = bool(axes) and all(cell[:1].lower() in ("", "x", "y", "z") for cell in axes)
    rows = rows[at + 1 + has_axes :]
    # with tabs, a name takes three cells; with blanks, one
    labels = trim_cells([name for name in names if name] if "" not in names[:3] else names[::3])
    named = max(len(labels), sum(1 for cell in axes if cell) // 3 if has_axes else 0)
    # points of the fullest row: unlabelled points follow those that the header names
    n_points = max(named, (max((len(trim_cells(cells)) for _, cells in rows), default=0) - FIRST) // 3)
    n_cells = FIRST + 3 * n_points
    labels += [""] * (n_points - len(labels))
    notes = [] if header else ["values of the header do not match its keys; they were not used"]
    notes += note_frames(path, header.get("numframes", ""), len(rows))
    if is_other(points := header.get("nummarkers", ""), n_points):
        notes.append(f"declares {points[:MAX_DIGITS]} markers but holds {n_points}")
    titles = [f"{label or f'point {i + 1}'} {axis}" for i, label in enumerate(labels) for axis in "XYZ"]
    return Points(
        [label or f"unlabelled {i + 1}" for i, label in enumerate(labels)],
        read_columns(path, rows, range(FIRST, n_cells), titles, least=FIRST + 3 * named, most=n_cells, missing=0.0),
        unit=header.get("units", ""),
        rate_hz=header.get("datarate", "").replace(",", "."),
        times=read_times(path, rows, 1, "Time") if any(cells[1] for _, cells in rows) else None,
        usual_up="y",
        notes=notes,
    )


def _parse_header(lines: list[list[str]]) -> dict[str, str]:
    """Parse the header values below the keys, if they match."""
    at = next((i for i, cells in enumerate(lines) if cells and cells[0].lower() == "datarate"), -1)
    if at < 0 or at + 1 >= len(lines):
        return {}
    keys, values = (trim_cells(lines[i]) for i in (at, at + 1))
    keys = [key.lower() for key in keys if key]
    if len(values) != len(keys):
        # some writers put two tabs between values
        values = " ".join(values).split()
    return dict(zip(keys, values, strict=True)) if len(values) == len(keys) else {}


_UNIT = r"mm|cm|dm|m|in|ft|milli\w+|centi\w+|met(?:er|re)s?|inch(?:es)?|feet|foot"
_COORDINATE = re.compile(rf"(?i)(.+?)\s*[_.: ]\s*([xyz])(?:\s*[\[(]\s*({_UNIT})\s*[\])]|[_ ]({_UNIT}))?")
_ALIEN_UNIT = re.compile(r"(?i)(.+?)\s*[_.: ]\s*([xyz])(?:\s*[\[(]\s*([^\])]{1,20}?)\s*[\])]|[_ ]([a-z]+))")
_GLUED = (
    re.compile(rf"(?i)(?P<name>.*?)(?P<axis>[xyz])(?:\s*[\[(]\s*(?P<unit>{_UNIT})\s*[\])]|_(?P<bare>{_UNIT}))?"),
    re.compile(rf"(?i)(?P<axis>[xyz])[_.: ]?(?P<name>.+?)(?:\s*[\[(]\s*(?P<unit>{_UNIT})\s*[\])]|_(?P<bare>{_UNIT}))?"),
)
"""Patterns of ``HeadX`` and ``x_Head``, only for triples of columns: other names also end in x."""
_AXIS = re.compile(rf"(?i)([xyz])\d*(?:\s*[\[(]?({_UNIT})[\])]?)?")
_TIME = re.compile(r"(?i)(?:time|t|timestamp)(?:[_ ]?[\[(]?\s*(s|sec|seconds?|ms|msec|milliseconds?)\s*[\])]?)?")
_FRAME = re.compile(r"(?i)(?:frames?|field|index|samples?|sub ?frame|#)?(?:#|[_ ]?(?:no|number|nr)\.?)?")
MAX_TITLE = 400  # maximum number of characters of a column name
FORM = "time_s, NAME_x_m, NAME_y_m, NAME_z_m, then the next point (m may be mm, cm, in, ft)"
Column = tuple[str, str]  # name of a point, and x, y or z


@dataclass(frozen=True)
class Header:
    """Meaning of the column names of a table."""

    titles: tuple[str, ...]
    next_row: int
    labels: tuple[str, ...]
    columns: tuple[int, ...]  # three of each point
    units: tuple[str, ...]  # of each of these columns
    time_column: int | None
    time_factor: float
    left_out: tuple[str, ...]

    @property
    def is_accad(self) -> bool:
        """True if the column names are those of ACCAD: ``Field``, ``Time``, ``NAME:X``."""
        first = [title.lower() for title in self.titles[:2]]
        return first == ["field", "time"] and all(":" in self.titles[i] for i in self.columns)


def _list_content_lines(lines: Sequence[str]) -> list[tuple[int, str]]:
    """Return numbered lines without blanks and comments. A comment starts with ``# ``."""
    return [(i + 1, line) for i, line in enumerate(lines) if line.strip(' \t,;"') and not line.startswith("# ")]


def split_rows(path: Path, lines: Sequence[str], delimiter: str = "") -> list[Row]:
    """Split the content lines into numbered rows of cells."""
    # " " is a tab or, in a line without one, blanks; the default is the most frequent of tab, ; and , in the first
    numbered = _list_content_lines(lines)
    if not numbered:
        return []
    delimiter = delimiter or max("\t;,", key=numbered[0][1].count)
    blanks = "\t " if delimiter == " " else delimiter
    check_cost(path, CELL_BYTES * sum(max(map(line.count, blanks)) for _, line in numbered), MotionError)
    rows: list[Row] = []
    for number, line in numbered:
        try:
            if delimiter == " ":
                cells = line.split("\t" if "\t" in line else None)
            elif '"' in line:
                cells = next(csv.reader([line], delimiter=delimiter, strict=True))
            else:
                cells = line.split(delimiter)
        except csv.Error as error:
            raise MotionError(f"{path}: line {number}: a quoted cell is damaged ({error}). Correct it.") from None
        # blanks matter only in names, and patterns are fast on short ones; stripping all takes longer than reading
        rows.append((number, [" ".join(cell[:MAX_TITLE].split()) for cell in cells] if len(rows) < 2 else cells))
    return rows


def read_rows(path: Path, n_head: int = 1, delimiter: str = "") -> list[Row]:
    """Read the rows of a file whose first lines show the delimiter."""
    lines = read_lines(path)
    delimiter = delimiter or max("\t;,", key="".join(lines[:n_head]).count)
    return [(line, [cell.strip() for cell in cells]) for line, cells in split_rows(path, lines, delimiter)]


def read_columns(
    path: Path,
    rows: Sequence[Row],
    columns: Sequence[int],
    titles: Sequence[str],
    *,
    least: int | None = None,
    most: int | None = None,
    missing: float | None = None,
) -> FloatArray:
    """Read three columns per point as positions (T, P, 3)."""
    check_amount(path, len(rows), len(columns) // 3)
    check_cost(path, CELL_BYTES * len(rows) * len(columns), MotionError)  # a short row is extended to the longest
    n_cells = max(columns) + 1
    filled: list[Row] = []
    for line, cells in rows:
        lacking = max(n_cells - len(cells), 0)
        # unseen points at its end may lack their cells; a row that ends within a point is damaged
        if (lacking % 3 if least is None else len(cells) < least) or (most and any(map(str.strip, cells[most:]))):
            raise MotionError(
                f"{path}: line {line} has {len(cells)} cells; its header names {least or n_cells} columns. Correct the "
                "line or, if the file is truncated there, remove it."
            )
        filled.append((line, cells + [""] * lacking if lacking else cells))
    position = to_numbers(path, filled, columns, titles).reshape(len(rows), -1, 3)
    if missing is not None:
        position[(position == missing).all(axis=2)] = np.nan
    return position


def find_points(columns: Sequence[Column | None]) -> list[tuple[str, dict[str, int]]]:
    """Return points with their columns by axis; each repetition of a name is another point."""
    points: list[tuple[str, dict[str, int]]] = []
    latest: dict[str, dict[str, int]] = {}
    for i, column in enumerate(columns):
        if column is None:
            continue
        name, axis = column
        if axis in latest.get(name, {axis: 0}):
            latest[name] = {}
            points.append((name, latest[name]))
        latest[name][axis] = i
    return points


def read_header(path: Path, rows: Sequence[Row]) -> Header:
    """Interpret the column names of a table."""
    two = not any(_COORDINATE.fullmatch(cell) for cell in rows[0][1]) and _has_axis_row(rows)
    titles = _join_titles(path, rows) if two else trim_cells(rows[0][1])
    spelled = titles if any(_COORDINATE.fullmatch(title) for title in titles) else _split_triples(titles)
    matches = [_COORDINATE.fullmatch(title) for title in spelled]
    points = find_points([(match[1], match[2].lower()) if match else None for match in matches])
    labels = [name for name, _ in points]
    if not labels:
        line = rows[0][0]
        for title in titles:
            if alien := _ALIEN_UNIT.fullmatch(title):
                raise MotionError(
                    f"{path}: line {line}: column {title!r} names the unit {alien[3] or alien[4]!r}, not a known "
                    "unit of length; use mm, cm, dm, m, in or ft"
                )
        raise MotionError(f"{path}: line {line} names no coordinates of points; name the columns {FORM}")
    for label, axes in points:
        if lacking := [axis for axis in "xyz" if axis not in axes]:
            have = ", ".join(titles[i] for i in axes.values())
            raise MotionError(
                f"{path}: line {rows[0][0]}: point {label!r} has no {lacking[0]} column (it has {have}); every point "
                "needs x, y and z"
            )
    columns = tuple(axes[axis] for _, axes in points for axis in "xyz")
    units = ["" if match is None else (match[3] or match[4] or "").lower() for match in matches]
    rest = sorted(set(range(len(titles))) - set(columns))
    times = [i for i in rest if _TIME.fullmatch(titles[i])]
    if len(times) > 1:
        raise MotionError(f"{path}: has {len(times)} columns of times: {', '.join(titles[i] for i in times)}; keep one")
    unit = _TIME.fullmatch(titles[times[0]]) if times else None
    return Header(
        titles=tuple(titles),
        next_row=1 + two,
        labels=tuple(labels),
        columns=columns,
        units=tuple(units[i] for i in columns),
        time_column=times[0] if times else None,
        time_factor=1e-3 if unit and (unit[1] or "s").lower().startswith("m") else 1.0,
        left_out=tuple(titles[i] for i in rest if i not in times and not _FRAME.fullmatch(titles[i])),
    )


def _split_triples(titles: Sequence[str]) -> list[str]:
    """Rename triples of columns to ``NAME x (UNIT)``."""
    # triples are HeadX, HeadY, HeadZ, X1, Y1, Z1 or X, Y, Z. Other titles are kept.
    spelled, n_points, i = list(titles), 0, 0
    while i + 2 < len(titles):
        for form in _GLUED:
            three = [match for match in map(form.fullmatch, titles[i : i + 3]) if match]
            names = {match["name"].strip(" _.:") for match in three}
            if "".join(match["axis"] for match in three).lower() == "xyz" and len(names) == 1:
                n_points += 1
                name = names.pop()
                name = f"point_{name or n_points}" if not name or name.isdecimal() else name
                units = [match["unit"] or match["bare"] for match in three]
                spelled[i : i + 3] = [
                    f"{name} {a}" + (f" ({u})" if u else "") for a, u in zip("xyz", units, strict=True)
                ]
                i += 2
                break
        i += 1
    return spelled


def _has_axis_row(rows: Sequence[Row]) -> bool:
    return len(rows) > 1 and sum(bool(_AXIS.fullmatch(cell)) for cell in rows[1][1]) >= 3


def _join_titles(path: Path, rows: Sequence[Row]) -> list[str]:
    """Join rows of names and axes into titles."""
    # a name is above its first coordinate or above all three
    axes = trim_cells(rows[1][1])
    names = rows[0][1] + [""] * (len(axes) - len(rows[0][1]))
    titles, name = [], ""
    for i, cell in enumerate(axes):
        match = _AXIS.fullmatch(cell)
        if not match:
            titles.append(cell or names[i])
            continue
        name = names[i] or name
        if not name:
            raise MotionError(f"{path}: line {rows[0][0]}: no point name is above column {i + 1} ({cell})")
        titles.append(f"{name} {match[1]}" + (f" ({match[2]})" if match[2] else ""))
    return titles


ACCAD_UNIT = "mm"
ACCAD_MISSING = -9999.99


def sniff_table(path: Path, head: bytes) -> bool:
    """Return True if the column names are coordinates of points."""
    if b"\0" in head or starts_with(head, TRC) or head.lstrip()[:1] in (b"{", b"["):
        return False
    lines = list_head_lines(path, head, 3)
    try:
        rows = split_rows(path, [line for _, line in _list_content_lines(lines)[:2]])
    except MotionError:
        return False
    # the first rows name coordinates of points, even if in an unknown unit
    if not rows:
        return False
    one = [cell for cell in rows[0][1] if _COORDINATE.fullmatch(cell) or _ALIEN_UNIT.fullmatch(cell)]
    return bool(one) or _has_axis_row(rows) or _split_triples(rows[0][1]) != rows[0][1]


@point_format("table", sniff_table, (".csv", ".tsv", ".txt"))
def parse_table(
    path: Path, *, units: str | None = None, rate_hz: float | None = None, missing: float | None = None
) -> Points:
    """Read the points of a delimited table."""
    # the column of times is time_s, time_ms or Time; without a unit, times are in s
    rows = split_rows(path, read_lines(path))
    if not rows:
        raise MotionError(f"{path}: holds no rows")
    header = read_header(path, rows)
    frames = rows[header.next_row :]
    if header.time_column is None and rate_hz is None:
        lacks_unit = units is None and "" in header.units
        raise MotionError(
            f"{path}: has no column of times (time_s, time_ms or Time); give the frame rate: rate_hz=..., or add one"
            + (". It names no length unit either: units='mm', 'cm' or 'm'" if lacks_unit else "")
        )
    titles, n_columns = [header.titles[i] for i in header.columns], len(header.titles)
    if missing is None and header.is_accad:
        missing = ACCAD_MISSING
    position = read_columns(path, frames, header.columns, titles, least=n_columns, most=n_columns, missing=missing)
    notes = [f"columns left out: {', '.join(header.left_out)}"] if header.left_out else []
    default = units or (ACCAD_UNIT if header.is_accad else "")
    if "" in header.units and not default:
        raise MotionError(
            f"{path}: column {titles[header.units.index('')]!r} names no length unit; give it: units='mm', 'cm' or "
            "'m', or name the columns NAME_x_mm, NAME_y_mm, NAME_z_mm"
        )
    stated = sorted({*header.units} - {""})
    if units and len({convert_unit_to_metres(path, name) for name in (units, *stated)}) > 1:
        notes.append(f"the column names give {', '.join(stated)}; units={units} was not used for these")
        warn_caller(f"{path}: {notes[-1]}")
    each = np.array([name or default for name in header.units]).reshape(-1, 3).tolist()
    times = None
    if header.time_column is not None and rate_hz is None:
        title = header.titles[header.time_column]
        times = read_times(path, frames, header.time_column, title, factor=header.time_factor)
    return Points(header.labels, position, each=each, times=times, notes=notes)


def find_whole_points(columns: Sequence[Column | None]) -> tuple[list[str], list[int]]:
    """Return the names of the points with x, y and z, and their columns."""
    whole = [(name, axes) for name, axes in find_points(columns) if len(axes) == 3]
    return [name for name, _ in whole], [axes[a] for _, axes in whole for a in "xyz"]


def _arrange(
    path: Path, columns: Sequence[Column | None], rows: Sequence[Row], **limits: Any
) -> tuple[list[str], FloatArray]:
    """Return names and positions (T, P, 3) of the points that columns hold."""
    labels, used = find_whole_points(columns)
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
    first, second = (re.split("[,;\t]", line)[0] for line in list_head_lines(path, head, 2)[:2])
    return first == "scorer" and second in ("individuals", "bodyparts")


@point_format("deeplabcut", sniff_deeplabcut, (".csv",))
def parse_deeplabcut(path: Path) -> Points:
    """Read the keypoints of a three-dimensional DeepLabCut table."""
    rows = read_rows(path)
    at = next((i for i, (_, cells) in enumerate(rows[:5]) if cells[0] == "coords"), -1)
    if at < 0:
        raise MotionError(f"{path}: has no row coords below scorer and bodyparts")
    columns = name_keypoints(path, {cells[0]: cells[1:] for _, cells in rows[: at + 1]})
    at += any(not is_finite(cells[0]) and not any(cells[1:]) for _, cells in rows[at + 1 : at + 2])  # name of the index
    return Points(*_arrange(path, [None, *columns], rows[at + 1 :]))


def name_keypoints(path: Path, levels: Mapping[str, Sequence[str]]) -> list[Column | None]:
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
