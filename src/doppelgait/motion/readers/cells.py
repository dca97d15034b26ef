"""Text of marker tables: decoded, and turned into numbers with the line named where a cell is none."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import MotionError

FloatArray = npt.NDArray[np.float64]


def read_text(path: Path) -> str:
    """Text of a file, whatever ends its lines and whether it is UTF-8 or Latin-1.

    Raises
    ------
    MotionError
        If the file is too large.
    """
    return "\n".join(read_lines(path))


def parse_rows(
    path: Path, text: str, at: int, *, n_columns: int, n_rows: int | None = None, separator: str = " "
) -> FloatArray:
    """Table of numbers from a place in a text to its end.

    Parameters
    ----------
    path : Path
        For messages.
    text : str
        The whole file, so that messages can count its lines.
    at : int
        Index of the first character of the table.
    n_columns : int
        Values in a row.
    n_rows : int, optional
        Declared number of rows; default: as many as there are.
    separator : str
        Between values: ``" "`` for any white space, or ``","`` with one row a line.

    Returns
    -------
    ndarray, shape (T, n_columns)

    Raises
    ------
    MotionError
        If values are missing, superfluous, no numbers or not finite; it names the first such line.
    """
    lines = [text[at:]] if separator == " " else [line for line in text[at:].split("\n") if line.strip()]
    values = _parse_numbers(separator.join(lines), separator)
    whole = values.size % n_columns == 0 if n_rows is None else values.size == n_rows * n_columns
    if separator != " ":
        whole = whole and all(line.count(separator) == n_columns - 1 for line in lines)
    if not whole or not values.size or not np.isfinite(values).all():
        raise MotionError(_fault(path, text, at, n_columns, n_rows, separator))
    return values.reshape(-1, n_columns)


def _parse_numbers(body: str, separator: str) -> FloatArray:
    """All numbers of a text; none when something in it is no number."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # given for what cannot be parsed
        try:
            return np.fromstring(body, sep=separator)
        except (DeprecationWarning, ValueError):
            return np.empty(0)


def _fault(path: Path, text: str, at: int, n_columns: int, n_rows: int | None, separator: str) -> str:
    first_line = text.count("\n", 0, at) + 1
    row = 0
    for number, line in enumerate(text[at:].split("\n"), start=first_line):
        words = line.split(None if separator == " " else separator)
        if not line.strip():
            continue
        row += 1
        where = f"{path}, line {number}: frame {row}"
        bad = next((word for word in words if not _is_finite(word)), None)
        if bad is not None:
            return f"{where} holds {bad[:30]!r}, which is no finite number"
        if len(words) != n_columns:
            return f"{where} holds {len(words)} values, {n_columns} are needed; the file is cut off or damaged"
    if n_rows is None or row == 0:
        return f"{path}: holds no frames"
    return f"{path}: declares {n_rows} frames but holds {row}; cut off, or the number of frames in it is wrong"


def _is_finite(word: str) -> bool:
    try:
        return bool(np.isfinite(float(word)))
    except ValueError:
        return False


Row = tuple[int, list[str]]
"""Line number, from 1, and the cells of that line."""

MAX_BYTES = 2**30
_BLANK = {"", "na", "n/a", "null", "none", "-"}


def decode(raw: bytes) -> str:
    """Text of a table, UTF-8 with or without byte-order mark, else Latin-1."""
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


def read_lines(path: Path) -> list[str]:
    """Lines of a text file, whatever ends them.

    Raises
    ------
    MotionError
        If the file is larger than 1 GiB.
    """
    size = path.stat().st_size
    if size > MAX_BYTES:
        raise MotionError(f"{path}: has {size} bytes; tables of up to {MAX_BYTES} bytes are read")
    return decode(path.read_bytes()).replace("\r\n", "\n").replace("\r", "\n").split("\n")


def to_numbers(
    path: Path, rows: Sequence[Row], columns: Sequence[int], titles: Sequence[str], *, decimal_comma: bool = False
) -> FloatArray:
    """Cells as numbers, shape (rows, columns); blank cells, ``na``, ``n/a``, ``null``, ``none`` and ``-`` become NaN.

    Parameters
    ----------
    path : Path
        For messages.
    rows : sequence of (int, list of str)
        Line numbers and cells; every row has all columns.
    columns : sequence of int
        Indices of the wanted cells.
    titles : sequence of str
        Name of each wanted column, for messages.
    decimal_comma : bool
        Whether numbers are written ``1,5``.

    Raises
    ------
    MotionError
        If a cell is text; names line and column.
    """
    values = np.empty((len(rows), len(columns)))
    for k, (line, cells) in enumerate(rows):
        wanted = [cells[i] for i in columns]
        if decimal_comma:
            wanted = [cell.replace(",", ".") for cell in wanted]
        try:
            values[k] = list(map(float, wanted))
        except ValueError:
            values[k] = [_number(path, line, title, cell) for title, cell in zip(titles, wanted, strict=True)]
    values[~np.isfinite(values)] = np.nan
    return values


def _number(path: Path, line: int, title: str, cell: str) -> float:
    word = cell.strip()
    if word.lower() in _BLANK:
        return np.nan
    try:
        return float(word)
    except ValueError:
        raise MotionError(
            f"{path}: line {line}, column {title!r}: {word[:40]!r} is no number. Correct it, or leave the cell blank "
            "where the point was not seen."
        ) from None
