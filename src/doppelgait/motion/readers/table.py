"""Tables of markers: TRC files, and csv, tsv or ACCAD text.

A TRC file starts with five header lines. The first row of other tables holds names, and each
further row the coordinates of one frame.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from doppelgait.core.documents import CELL_BYTES, check_cost
from doppelgait.core.errors import MotionError, warn_caller
from doppelgait.motion.readers.points import check_amount, convert_unit_to_metres, measure_body_extent
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
    to_numbers,
    trim_cells,
)

FloatArray = npt.NDArray[np.float64]


START = b"PathFileType"
HEADER_LINES = 12
FIRST = 2
"""Number of cells before the first coordinate: frame number and time."""


def sniff_trc(path: Path, head: bytes) -> bool:
    """Return True if a file begins with PathFileType."""
    return head.removeprefix(b"\xef\xbb\xbf").lstrip()[: len(START)].lower() == START.lower()


@point_format("trc", sniff_trc, (".trc",))
def parse_trc(path: Path) -> Points:
    """Read the markers of a TRC file."""
    # blank cells and points at exactly 0, 0, 0 are gaps
    texts = read_lines(path)
    check_cost(path, CELL_BYTES * sum(max(text.count("\t"), text.count(" ")) for text in texts), MotionError)
    lines = [[cell.strip() for cell in (text.split("\t") if "\t" in text else text.split())] for text in texts]
    at = next((i for i, cells in enumerate(lines[:HEADER_LINES]) if cells and cells[0].lower().startswith("frame")), -1)
    if at < 1:
        raise MotionError(
            f"{path}: has no line that starts with Frame# and Time and names the markers (TRC: the fourth line)"
        )
    header, names = _parse_header(lines[:at]), lines[at][FIRST:]
    axes = trim_cells(lines[at + 1]) if at + 1 < len(lines) else []
    has_axes = bool(axes) and all(cell[:1].lower() in ("", "x", "y", "z") for cell in axes)
    rows = [(i + 1, cells) for i, cells in enumerate(lines) if i >= at + 1 + has_axes and any(cells)]
    # with tabs, a name takes three cells; with blanks, one
    labels = trim_cells([name for name in names if name] if "" not in names[:3] else names[::3])
    named = max(len(labels), sum(1 for cell in axes if cell) // 3 if has_axes else 0)
    # points of the fullest row: unlabelled points follow those that the header names
    lengths = [len(trim_cells(cells)) for _, cells in rows]
    n_points = max(named, (max(lengths, default=0) - FIRST) // 3)
    n_cells = FIRST + 3 * n_points
    check_cost(path, CELL_BYTES * len(rows) * 3 * n_points, MotionError)  # a short row is extended to the longest
    for (line, cells), length in zip(rows, lengths, strict=True):
        if len(cells) < FIRST + 3 * named or length > n_cells:
            raise MotionError(
                f"{path}: line {line} has {max(length, len(cells))} cells; {FIRST} and three for each of {named} "
                f"markers are {FIRST + 3 * named}. The file may be truncated. Correct the line or remove it."
            )
    check_amount(path, len(rows), n_points)
    rows = [(line, cells[:n_cells] + [""] * (n_cells - len(cells))) for line, cells in rows]
    labels += [""] * (n_points - len(labels))
    notes = [] if header else ["values of the header do not match its keys; they were not used"]
    notes += note_frames(path, header.get("numframes", ""), len(rows))
    if is_other(points := header.get("nummarkers", ""), n_points):
        notes.append(f"declares {points[:MAX_DIGITS]} markers but holds {n_points}")
    titles = [f"{label or f'point {i + 1}'} {axis}" for i, label in enumerate(labels) for axis in "XYZ"]
    position = to_numbers(path, rows, range(FIRST, n_cells), titles).reshape(len(rows), -1, 3)
    position[(position == 0.0).all(axis=2)] = np.nan
    return Points(
        [label or f"unlabelled {i + 1}" for i, label in enumerate(labels)],
        position,
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
MAX_TITLE = 400
"""Maximum number of characters of a column name."""
FORM = "time_s, NAME_x_m, NAME_y_m, NAME_z_m, then the next point (m may be mm, cm, in, ft)"


Column = tuple[str, str]
"""Name of a point, and x, y or z."""


@dataclass(frozen=True)
class Header:
    """Meaning of the column names of a table."""

    titles: tuple[str, ...]
    next_row: int
    labels: tuple[str, ...]
    columns: tuple[tuple[int, int, int], ...]
    units: tuple[tuple[str, str, str], ...]
    time_column: int | None
    time_factor: float
    left_out: tuple[str, ...]

    @property
    def is_accad(self) -> bool:
        """True if the column names are those of ACCAD: ``Field``, ``Time``, ``NAME:X``."""
        first = [title.lower() for title in self.titles[:2]]
        return first == ["field", "time"] and all(":" in self.titles[c[0]] for c in self.columns)


def _list_content_lines(lines: Sequence[str]) -> list[tuple[int, str]]:
    """Return numbered lines without blanks and comments. A comment starts with ``# ``."""
    return [(i + 1, line) for i, line in enumerate(lines) if line.strip(' \t,;"') and not line.startswith("# ")]


def split_rows(path: Path, lines: Sequence[str], delimiter: str = "") -> list[Row]:
    """Split the content lines into numbered rows of cells."""
    # the delimiter is the most frequent of tab, ; and , in the first line
    numbered = _list_content_lines(lines)
    if not numbered:
        return []
    delimiter = delimiter or max("\t;,", key=numbered[0][1].count)
    check_cost(path, CELL_BYTES * sum(line.count(delimiter) for _, line in numbered), MotionError)
    rows: list[Row] = []
    for number, line in numbered:
        try:
            quoted = '"' in line
            cells = next(csv.reader([line], delimiter=delimiter, strict=True)) if quoted else line.split(delimiter)
        except csv.Error as error:
            raise MotionError(f"{path}: line {number}: a quoted cell is damaged ({error}). Correct it.") from None
        # blanks matter only in names, and stripping millions of numbers takes longer than reading
        # them patterns are fast on short names only
        rows.append((number, [" ".join(cell[:MAX_TITLE].split()) for cell in cells] if len(rows) < 2 else cells))
    return rows


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
    columns = tuple((axes["x"], axes["y"], axes["z"]) for _, axes in points)
    units = ["" if match is None else (match[3] or match[4] or "").lower() for match in matches]
    used = {i for places in columns for i in places}
    rest = [i for i in range(len(titles)) if i not in used]
    times = [i for i in rest if _TIME.fullmatch(titles[i])]
    if len(times) > 1:
        raise MotionError(f"{path}: has {len(times)} columns of times: {', '.join(titles[i] for i in times)}; keep one")
    unit = _TIME.fullmatch(titles[times[0]]) if times else None
    return Header(
        titles=tuple(titles),
        next_row=1 + two,
        labels=tuple(labels),
        columns=columns,
        units=tuple((units[x], units[y], units[z]) for x, y, z in columns),
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
    """Return True if the second row is X, Y, Z, ..."""
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
BODY_M = (0.1, 10.0)


def sniff_table(path: Path, head: bytes) -> bool:
    """Return True if the column names are coordinates of points."""
    if b"\0" in head or sniff_trc(path, head) or head.lstrip()[:1] in (b"{", b"["):
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
    check_amount(path, len(frames), len(header.labels))
    n_columns = len(header.titles)
    for line, cells in frames:
        if len(cells) < n_columns or any(cell.strip() for cell in cells[n_columns:]):
            raise MotionError(
                f"{path}: line {line} has {len(cells)} cells; its header names {n_columns} columns. Correct the line "
                "or, if the file is truncated there, remove it."
            )
    if header.time_column is None and rate_hz is None:
        lacks_unit = units is None and any("" in point for point in header.units)
        raise MotionError(
            f"{path}: has no column of times (time_s, time_ms or Time); give the frame rate: rate_hz=..., or add one"
            + (". It names no length unit either: units='mm', 'cm' or 'm'" if lacks_unit else "")
        )
    columns = [i for places in header.columns for i in places]
    titles = [header.titles[i] for i in columns]
    position = to_numbers(path, frames, columns, titles).reshape(len(frames), -1, 3)
    if missing is None and header.is_accad:
        missing = ACCAD_MISSING
    if missing is not None:
        position[(position == float(missing)).all(axis=2)] = np.nan
    notes = [f"columns left out: {', '.join(header.left_out)}"] if header.left_out else []
    names = _find_coordinate_units(path, header, units, notes)
    if header.is_accad and units is None:
        size = float(np.nan_to_num(measure_body_extent(position * 1e-3)).max())
        if not BODY_M[0] < size < BODY_M[1]:
            raise MotionError(
                f"{path}: its points would span {size:.3g} m if it is in mm, as ACCAD files are; give the true unit: "
                "units='cm' or 'm'"
            )
    times = None
    if header.time_column is not None and rate_hz is None:
        title = header.titles[header.time_column]
        times = read_times(path, frames, header.time_column, title, factor=header.time_factor)
    return Points(header.labels, position, each=names, times=times, notes=notes)


def _find_coordinate_units(path: Path, header: Header, units: str | None, notes: list[str]) -> list[list[str]]:
    """Return the unit of each coordinate, named or default."""
    stated = {name for point in header.units for name in point if name}
    default = units or (ACCAD_UNIT if header.is_accad else "")
    bare = [i for i, point in enumerate(header.units) if "" in point]
    if bare and not default:
        place = header.columns[bare[0]][header.units[bare[0]].index("")]
        raise MotionError(
            f"{path}: column {header.titles[place]!r} names no length unit; give it: units='mm', 'cm' or 'm', or name "
            "the columns NAME_x_mm, NAME_y_mm, NAME_z_mm"
        )
    if units is not None and stated:
        wanted_m = convert_unit_to_metres(units, where=str(path))
        if any(convert_unit_to_metres(name, where=str(path)) != wanted_m for name in stated):
            notes.append(f"the column names give {', '.join(sorted(stated))}; units={units} was not used for these")
            warn_caller(f"{path}: {notes[-1]}")
    return [[name or default for name in point] for point in header.units]
