"""Text of motion files: lines, tables, frame rates."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from doppelgait.core.documents import CELL_BYTES, check_cost
from doppelgait.core.errors import MotionError
from doppelgait.motion.readers.points import MAX_RATE_HZ, MIN_RATE_HZ

FloatArray = npt.NDArray[np.float64]


def read_text(path: Path) -> str:
    """Read a UTF-8 or Latin-1 text file."""
    return "\n".join(read_lines(path))


def parse_rows(
    path: Path, text: str, at: int, *, n_columns: int, n_rows: int | None = None, separator: str = " "
) -> FloatArray:
    """Parse a table of numbers up to the end. Shapes: returns (T, n_columns)."""
    lines = [text[at:]] if separator == " " else [line for line in text[at:].split("\n") if line.strip()]
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # raised for values that cannot be parsed
        try:
            values = np.fromstring(separator.join(lines), sep=separator)
        except (DeprecationWarning, ValueError):
            values = np.empty(0)
    whole = values.size % n_columns == 0 if n_rows is None else values.size == n_rows * n_columns
    if separator != " ":
        whole = whole and all(line.count(separator) == n_columns - 1 for line in lines)
    if not whole or not values.size or not np.isfinite(values).all():
        raise MotionError(_find_row_fault(path, text, at, n_columns, n_rows, separator))
    return values.reshape(-1, n_columns)


def _find_row_fault(path: Path, text: str, at: int, n_columns: int, n_rows: int | None, separator: str) -> str:
    """Describe the first unreadable row of a table."""
    first_line = text.count("\n", 0, at) + 1
    row = 0
    for number, line in enumerate(text[at:].split("\n"), start=first_line):
        words = line.split(None if separator == " " else separator)
        if not line.strip():
            continue
        row += 1
        where = f"{path}, line {number}: frame {row}"
        bad = next((word for word in words if not is_finite(word)), None)
        if bad is not None:
            return f"{where} holds {bad[:30]!r}, which is not a finite number"
        if len(words) != n_columns:
            return f"{where} holds {len(words)} values, but {n_columns} are needed; the file is truncated or damaged"
    if n_rows is None or row == 0:
        return f"{path}: holds no frames"
    return f"{path}: declares {n_rows} frames but holds {row}; it is truncated, or its number of frames is wrong"


def is_finite(word: str) -> bool:
    """Return True if a word is a finite number."""
    try:
        return bool(np.isfinite(float(word)))
    except ValueError:
        return False


Row = tuple[int, list[str]]
"""Line number, from 1, and cells of the line."""

MAX_BYTES = 2**30
_BLANK = {"", "na", "n/a", "null", "none", "-"}


def decode(raw: bytes) -> str:
    """Decode a table's text as UTF-8 or, if that fails, as Latin-1."""
    # a byte-order mark is removed
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


def read_lines(path: Path) -> list[str]:
    """Read the lines of a text file."""
    size = path.stat().st_size
    if size > MAX_BYTES:
        raise MotionError(f"{path}: has {size} bytes; tables of up to {MAX_BYTES} bytes are read")
    raw = path.read_bytes()
    check_cost(path, CELL_BYTES * (raw.count(b"\n") + raw.count(b"\r")), MotionError)
    return decode(raw).replace("\r\n", "\n").replace("\r", "\n").split("\n")


def trim_cells(cells: Sequence[str]) -> list[str]:
    """Return the cells without blank cells at the end."""
    last = max((i for i, cell in enumerate(cells) if cell), default=-1)
    return list(cells[: last + 1])


def to_numbers(
    path: Path, rows: Sequence[Row], columns: Sequence[int], titles: Sequence[str], *, decimal_comma: bool = False
) -> FloatArray:
    """Convert cells to numbers, shape (rows, columns)."""
    # blank cells, na, n/a, null, none and - become NaN
    values = np.empty((len(rows), len(columns)))
    for k, (line, cells) in enumerate(rows):
        wanted = [cells[i] for i in columns]
        if decimal_comma:
            wanted = [cell.replace(",", ".") for cell in wanted]
        try:
            values[k] = list(map(float, wanted))
        except ValueError:
            for n, (title, cell) in enumerate(zip(titles, wanted, strict=True)):
                word = cell.strip()
                try:
                    values[k, n] = np.nan if word.lower() in _BLANK else float(word)
                except ValueError:
                    raise MotionError(
                        f"{path}: line {line}, column {title!r}: {word[:40]!r} is not a number. Correct it, or leave "
                        "the cell blank where the point was not seen."
                    ) from None
    values[~np.isfinite(values)] = np.nan
    return values


JITTER = 0.01
"""Maximum time error of a frame, in frames. A larger one causes a false velocity."""
COARSEST = 0.4
"""Maximum rounding of a printed time, in frames. A missing frame appears as 0.5."""
INSTEAD = "or give rate_hz= if the frames are evenly spaced nevertheless"


def find_frame_rate(
    path: Path, time_s: FloatArray, lines: Sequence[int], *, digit_s: float, declared_hz: float | None = None
) -> float:
    """Determine the frame rate from frame times. Shapes: time_s (T,)."""
    # it is the declared rate if the times agree with it
    step = np.diff(time_s)
    if np.isnan(time_s).any():
        raise MotionError(f"{path}: line {lines[int(np.isnan(time_s).argmax())]} has no time. Add it, {INSTEAD}.")
    if not (step > 0).all():
        k = int((step <= 0).argmax())
        raise MotionError(
            f"{path}: line {lines[k + 1]}: the time does not increase ({time_s[k]:g} s, then {time_s[k + 1]:g} s). "
            f"Correct it, {INSTEAD}."
        )
    fit = (len(time_s) - 1) / float(time_s[-1] - time_s[0])
    candidates = [declared_hz or 0.0, *(round(fit, decimals) for decimals in range(7))]
    rate = next((hz for hz in candidates if hz > 0 and _offset_s(time_s, hz) <= _rounding_s(digit_s, hz)), fit)
    if not MIN_RATE_HZ <= rate <= MAX_RATE_HZ:
        raise MotionError(
            f"{path}: its times step by {1 / fit:.6g} s, {fit:.4g} frames a second; allowed are {MIN_RATE_HZ:g} to "
            f"{MAX_RATE_HZ:g}. If they are not in seconds, give the rate: rate_hz=..."
        )
    if _offset_s(time_s, rate) > max(_rounding_s(digit_s, rate), JITTER / rate):
        odd = int(np.abs(step - np.median(step)).argmax())
        raise MotionError(
            f"{path}: line {lines[odd + 1]}: the time steps by {step[odd]:.6g} s, but most frames are "
            f"{np.median(step):.6g} s apart. Frames must be evenly spaced: add missing frames with blank cells, "
            f"resample, {INSTEAD}."
        )
    return rate


def _offset_s(time_s: FloatArray, rate_hz: float) -> float:
    """Return the largest deviation from even times."""
    # the even times are fitted for the smallest maximum deviation
    return float(np.ptp(time_s - np.arange(len(time_s)) / rate_hz)) / 2.0


def _rounding_s(digit_s: float, rate_hz: float) -> float:
    """Return the largest deviation that rounding explains."""
    return min(0.5 * digit_s * (1.0 + 1e-6), COARSEST / rate_hz)


def find_last_digit(cells: Sequence[str], time_s: FloatArray, factor: float = 1.0) -> float:
    """Return the unit of a time column's last printed digit, s."""
    # it is at least 1e-8 of the largest time
    decimals = max((len(cell.strip().partition(".")[2]) for cell in cells if "e" not in cell.lower()), default=15)
    # large numbers printed to nine significant digits have fewer decimals
    return max(10.0**-decimals * factor, 1e-8 * float(np.abs(np.nan_to_num(time_s)).max()))
