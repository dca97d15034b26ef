"""TRC files (Motion Analysis, OpenSim): marker positions as text.

The file starts with five header lines.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from doppelgait.core.cost import CELL_BYTES, check_cost
from doppelgait.core.errors import MotionError, warn_caller
from doppelgait.core.plugins import plugin
from doppelgait.motion.axes import convert_unit_to_metres
from doppelgait.motion.motion import Motion
from doppelgait.motion.readers.points import (
    LengthUnit,
    check_amount,
    check_rate,
    find_unit,
    make_point_motion,
    pick_markers,
)
from doppelgait.motion.readers.text import Row, find_frame_rate, find_last_digit, read_lines, to_numbers, trim_cells

FloatArray = npt.NDArray[np.float64]

START = b"PathFileType"
HEADER_LINES = 12
FIRST = 2
"""Number of cells before the first coordinate: frame number and time."""


@dataclass(frozen=True)
class _Content:
    """Header values by lower-case key, labels and data rows."""

    header: dict[str, str]
    labels: list[str]
    rows: list[Row]


LONGEST_NUMBER = 18
"""Maximum number of digits of a number of frames or markers that is parsed."""


def sniff_trc(path: Path, head: bytes) -> bool:
    """Return True if a file begins with PathFileType."""
    return head.removeprefix(b"\xef\xbb\xbf").lstrip()[: len(START)].lower() == START.lower()


@plugin("motion_reader", "trc", sniff=sniff_trc, suffixes=(".trc",))
def read_trc(
    path: Path,
    *,
    subject: str | None = None,
    units: str | None = None,
    up_axis: str | None = None,
    rate_hz: float | None = None,
) -> Motion:
    """Read the markers of a TRC file, not cleaned."""
    # blank cells and points at exactly 0, 0, 0 are gaps
    content = _parse_trc(path)
    check_amount(path, len(content.rows), len(content.labels))
    notes, n_frames = [], len(content.rows)
    declared = content.header.get("numframes", "")
    if not content.header:
        notes.append("values of the header do not match its keys; they were not used")
    if _is_other(declared, n_frames):
        notes.append(f"declares {declared[:LONGEST_NUMBER]} frames but holds {n_frames}")
        warn_caller(f"{path}: {notes[-1]}; it may be truncated. The existing frames are read.")
    points = content.header.get("nummarkers", "")
    if _is_other(points, len(content.labels)):
        notes.append(f"declares {points[:LONGEST_NUMBER]} markers but holds {len(content.labels)}")
    rate = check_rate(path, rate_hz, said="was given") if rate_hz is not None else _find_rate(path, content, notes)
    titles = [f"{label or f'point {i + 1}'} {axis}" for i, label in enumerate(content.labels) for axis in "XYZ"]
    columns = range(FIRST, FIRST + len(titles))
    position = to_numbers(path, content.rows, columns, titles).reshape(len(content.rows), -1, 3)
    position[(position == 0.0).all(axis=2)] = np.nan
    unit = find_unit(path, units or content.header.get("units", ""), position)
    return make_point_motion(
        path,
        position,
        pick_markers(path, [label or f"unlabelled {i + 1}" for i, label in enumerate(content.labels)], subject=subject),
        file_format="trc",
        rate_hz=rate,
        unit=LengthUnit(unit, convert_unit_to_metres(unit, where=str(path))),
        up_axis=up_axis,
        usual_up="y",
        notes=notes,
    )


def _parse_trc(path: Path) -> _Content:
    """Parse header, labels and rows."""
    texts = read_lines(path)
    check_cost(path, CELL_BYTES * sum(max(text.count("\t"), text.count(" ")) for text in texts), MotionError)
    lines = [[cell.strip() for cell in (text.split("\t") if "\t" in text else text.split())] for text in texts]
    at = next((i for i, cells in enumerate(lines[:HEADER_LINES]) if cells and cells[0].lower().startswith("frame")), -1)
    if at < 1:
        raise MotionError(
            f"{path}: has no line that starts with Frame# and Time and names the markers (TRC: the fourth line)"
        )
    names = lines[at][FIRST:]
    axes = trim_cells(lines[at + 1]) if at + 1 < len(lines) else []
    has_axes = bool(axes) and all(cell[:1].lower() in ("", "x", "y", "z") for cell in axes)
    first_row = at + 1 + has_axes
    rows = [(i + 1, cells) for i, cells in enumerate(lines) if i >= first_row and any(cells)]
    # with tabs, a name takes three cells; with blanks, one
    labels = [name for name in names if name] if "" not in names[:3] else names[::3]
    while labels and not labels[-1]:
        labels.pop()
    named = max(len(labels), sum(1 for cell in axes if cell) // 3 if has_axes else 0)
    # points of the fullest row: unlabelled points follow those that the header names
    line, cells = max(rows, key=lambda row: len(trim_cells(row[1])), default=(0, []))
    extra = len(trim_cells(cells)) - FIRST - 3 * named
    if extra > 0 and extra % 3:
        raise MotionError(
            f"{path}: line {line} has {len(trim_cells(cells))} cells; {FIRST} and three for each of {named} markers "
            f"are {FIRST + 3 * named}. Correct the line or remove it."
        )
    n_points = named + max(extra, 0) // 3
    check_cost(path, CELL_BYTES * len(rows) * 3 * n_points, MotionError)  # a short row is extended to the longest
    for line, cells in rows:
        if len(cells) < FIRST + 3 * named:
            raise MotionError(
                f"{path}: line {line} has {len(cells)} cells; {FIRST} and three for each of {named} markers are "
                f"{FIRST + 3 * named}. The file may be truncated. Correct the line or remove it."
            )
    return _Content(
        _parse_header(lines[:at]),
        labels + [""] * (n_points - len(labels)),
        [(line, cells + [""] * (FIRST + 3 * n_points - len(cells))) for line, cells in rows],
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


def _find_rate(path: Path, content: _Content, notes: list[str]) -> float:
    declared = content.header.get("datarate", "")
    lines = [line for line, _ in content.rows]
    printed = [cells[1] for _, cells in content.rows]
    if not any(printed):
        return check_rate(path, declared or None, said="has no times and declares")
    time_s = to_numbers(path, content.rows, [1], ["Time"])[:, 0]
    try:
        header_hz = float(declared)
    except ValueError:
        header_hz = 0.0
    header_hz = header_hz if 0.0 < header_hz < float("inf") else 0.0
    rate = find_frame_rate(path, time_s, lines, digit_s=find_last_digit(printed, time_s), declared_hz=header_hz or None)
    if rate != header_hz:
        notes.append(f"the header states {declared or 'no rate'} Hz, the times {rate:g} Hz; the times were used")
        warn_caller(f"{path}: {notes[-1]}. If that is wrong, give the rate: rate_hz=...")
    return rate


def _is_other(declared: str, count: int) -> bool:
    """Return True if a header states another number. Numbers may have thousands of digits."""
    return declared.isdecimal() and (len(declared) > LONGEST_NUMBER or int(declared) != count)
