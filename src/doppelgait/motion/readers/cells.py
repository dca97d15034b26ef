"""Text of marker tables: decoded, and turned into numbers with the line named where a cell is none."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import MotionError

FloatArray = npt.NDArray[np.float64]
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
