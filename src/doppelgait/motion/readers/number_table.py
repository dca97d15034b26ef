"""Tables of numbers in text files, parsed at once; the line of a fault is looked for only when there is one."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import MotionError
from doppelgait.motion.readers.cells import read_lines

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
