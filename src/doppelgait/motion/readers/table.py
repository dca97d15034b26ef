"""Delimited marker tables: a row of names, then a row of coordinates for every frame (csv, tsv, ACCAD text)."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import DoppelgaitWarning, MotionError
from doppelgait.core.plugins import plugin
from doppelgait.motion.axes import body_extent
from doppelgait.motion.motion import Motion
from doppelgait.motion.readers.cells import Row, decode, read_lines, to_numbers
from doppelgait.motion.readers.frame_times import check_rate, last_digit, rate_of_times
from doppelgait.motion.readers.points import check_amount, points_to_motion
from doppelgait.motion.readers.table_header import Header, content_lines, is_marker_header, read_header, split_rows
from doppelgait.motion.readers.trc import sniff_trc
from doppelgait.motion.units import metres_per_unit

FloatArray = npt.NDArray[np.float64]

HEADER_BYTES = 2**20
"""Column names of many points are longer than the head that is given to :func:`sniff_table`."""
ACCAD_UNIT = "mm"
ACCAD_MISSING = -9999.99
BODY_M = (0.1, 10.0)


def sniff_table(path: Path, head: bytes) -> bool:
    """Whether a file looks like a marker table: text whose column names are coordinates of points."""
    if b"\0" in head or sniff_trc(path, head) or head.lstrip()[:1] in (b"{", b"["):
        return False
    if head.count(b"\n") < 3:
        with path.open("rb") as file:
            head = file.read(HEADER_BYTES)
    try:
        rows, _ = split_rows(path, [line for _, line in content_lines(decode(head).splitlines())[:2]])
    except MotionError:
        return False
    return is_marker_header(rows)


@plugin("motion_reader", "table", sniff=sniff_table, suffixes=(".csv", ".tsv", ".txt"))
def read_table(
    path: Path,
    *,
    subject: str | None = None,
    units: str | None = None,
    up_axis: str | None = None,
    rate_hz: float | None = None,
    missing: float | None = None,
) -> Motion:
    """Points of a delimited table, not cleaned.

    Column names: ``time_s`` (or ``time_ms``, ``Time``) and ``NAME_x_m, NAME_y_m, NAME_z_m`` (what ``doppelgait motion
    convert`` writes), ``NAME_x``, ``NAME:X``, ``NAME X (mm)``; or a row of names over a row ``X, Y, Z``; or those of
    ACCAD (``Field``, ``Time``, ``NAME:X``: mm, -9999.99 where a marker was not seen). Tabs, ``;`` or ``,`` part the
    cells; with ``;`` a decimal comma is read. Blank cells are gaps. Times without a unit are in s.

    Parameters
    ----------
    path : Path
        An existing file.
    subject : str, optional
        Prefix of the wanted points; needed only when several subjects were recorded.
    units : str, optional
        ``"mm"``, ``"cm"``, ``"m"``, ``"in"`` or ``"ft"``, for columns whose name holds no unit.
    up_axis : str, optional
        ``"x"``, ``"y"``, ``"z"``, ``"-x"``, ``"-y"`` or ``"-z"``; default: found.
    rate_hz : float, optional
        Frames per second, up to 10000; needed when there is no time column.
    missing : float, optional
        A point whose three cells are this number was not seen.

    Returns
    -------
    Motion
        Motion (time, marker, space) in m, z up, NaN for gaps; ``report`` tells what was read and left out.

    Raises
    ------
    MotionError
        If the table cannot be read right; names line and column.
    """
    rows, delimiter = split_rows(path, read_lines(path))
    if not rows:
        raise MotionError(f"{path}: holds no rows")
    header = read_header(path, rows)
    frames = rows[header.next_row :]
    check_amount(path, len(frames), len(header.labels))
    _check_widths(path, frames, len(header.titles))
    comma = delimiter == ";"
    rate = _rate(path, header, frames, rate_hz, comma)
    columns = [i for places in header.columns for i in places]
    titles = [header.titles[i] for i in columns]
    position = to_numbers(path, frames, columns, titles, decimal_comma=comma).reshape(len(frames), -1, 3)
    _blank_missing(position, _missing(path, header, missing))
    notes = [f"columns left out: {', '.join(header.left_out)}"] if header.left_out else []
    names = _units(path, header, units, notes)
    position *= np.array([[metres_per_unit(name, where=str(path)) for name in point] for point in names])
    if header.is_accad and units is None:
        _check_size(path, position)
    flat = [name for point in names for name in point]
    return points_to_motion(
        path,
        position,
        header.labels,
        file_format="table",
        rate_hz=rate,
        length_unit=max(dict.fromkeys(flat), key=flat.count),
        up_axis=up_axis,
        subject=subject,
        notes=notes,
    )


def _check_widths(path: Path, frames: Sequence[Row], n_columns: int) -> None:
    for line, cells in frames:
        if len(cells) < n_columns or any(cell.strip() for cell in cells[n_columns:]):
            raise MotionError(
                f"{path}: line {line} has {len(cells)} cells, its header names {n_columns} columns. Correct the line "
                "or, if the file is cut off there, remove it."
            )


def _rate(path: Path, header: Header, frames: Sequence[Row], rate_hz: float | None, comma: bool) -> float:
    if rate_hz is not None:
        return check_rate(path, rate_hz, said="was given")
    column = header.time_column
    if column is None:
        raise MotionError(
            f"{path}: has no column of times (time_s, time_ms or Time); give the frame rate: rate_hz=..., or add one"
        )
    time_s = to_numbers(path, frames, [column], [header.titles[column]], decimal_comma=comma)[:, 0] * header.time_factor
    printed = [cells[column].replace(",", ".") for _, cells in frames]
    return rate_of_times(
        path, time_s, [line for line, _ in frames], digit_s=last_digit(printed, time_s, header.time_factor)
    )


def _missing(path: Path, header: Header, missing: float | None) -> float | None:
    if missing is None:
        return ACCAD_MISSING if header.is_accad else None
    if isinstance(missing, bool) or not isinstance(missing, int | float):
        raise MotionError(f"{path}: missing={missing!r} is no number; give the one that marks a point as not seen")
    return float(missing)


def _blank_missing(position: FloatArray, missing: float | None) -> None:
    if missing is not None:
        position[(position == missing).all(axis=2)] = np.nan


def _units(path: Path, header: Header, units: str | None, notes: list[str]) -> list[list[str]]:
    """Unit of every coordinate: that in its name, else the given one."""
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
        given = metres_per_unit(units, where=str(path))
        if any(metres_per_unit(name, where=str(path)) != given for name in stated):
            notes.append(f"the column names give {', '.join(sorted(stated))}; units={units} was not used for those")
            warnings.warn(f"{path}: {notes[-1]}", DoppelgaitWarning, stacklevel=4)
    return [[name or default for name in point] for point in header.units]


def _check_size(path: Path, position_m: FloatArray) -> None:
    size = float(np.nan_to_num(body_extent(position_m)).max())
    if not BODY_M[0] < size < BODY_M[1]:
        raise MotionError(
            f"{path}: its points would span {size:.3g} m if it is in mm, as ACCAD files are; give the true unit: "
            "units='cm' or 'm'"
        )
