"""Tables of markers: TRC files with five header lines, and csv, tsv or ACCAD text with a row of names."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from doppelgait.core.documents import CELL_BYTES, check_cost
from doppelgait.core.errors import MotionError, warn_caller
from doppelgait.core.units import FloatArray
from doppelgait.motion.readers.points import check_amount, convert_unit_to_metres
from doppelgait.motion.readers.text import (
    MAX_DIGITS,
    Points,
    Row,
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
    rows = read_rows(path, delimiter=" ")
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
"""Patterns of ``HeadX`` and ``x_Head``. They apply only to triples of adjacent columns, since other
names also end in x."""
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
        # unseen points at the end of a row may lack their cells; a row that ends within a point is damaged
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
    """Return the points that columns name, each with its columns by axis; each repetition is another point."""
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
            alien = _ALIEN_UNIT.fullmatch(title)
            if alien:
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
    if units and len({convert_unit_to_metres(name, where=str(path)) for name in (units, *stated)}) > 1:
        notes.append(f"the column names give {', '.join(stated)}; units={units} was not used for these")
        warn_caller(f"{path}: {notes[-1]}")
    each = np.array([name or default for name in header.units]).reshape(-1, 3).tolist()
    times = None
    if header.time_column is not None and rate_hz is None:
        title = header.titles[header.time_column]
        times = read_times(path, frames, header.time_column, title, factor=header.time_factor)
    return Points(header.labels, position, each=each, times=times, notes=notes)
