"""The labels as a table of text, as spreadsheets write it: comma, semicolon or tab, UTF-8 or UTF-16."""

from __future__ import annotations

import codecs
import csv
import io
from dataclasses import dataclass
from pathlib import Path

from doppelgait.core.errors import ConfigError

DELIMITERS = ",;\t"


@dataclass(frozen=True)
class LabelTable:
    """Lines of a file of labels.

    Parameters
    ----------
    name : str
        Of the file, for messages.
    columns : tuple of str
        In the file's order, in small letters.
    rows : tuple of (int, dict)
        Line in the file and cells by column, stripped; empty lines are left out.
    """

    name: str
    columns: tuple[str, ...]
    rows: tuple[tuple[int, dict[str, str]], ...]


def read_table(path: Path, *, needed: tuple[str, ...]) -> LabelTable:
    """Table of a CSV file whose first line names the columns.

    Parameters
    ----------
    path : Path
    needed : tuple of str
        Columns that must be there; they also tell which delimiter is the right one.

    Raises
    ------
    ConfigError
        If the file cannot be read, is no text, has no such columns, or a line has more or fewer cells than the first.
    """
    text = _text(path)
    lines = _cells(path, text, _delimiter(path, text, needed))
    if not lines:
        raise ConfigError(f"{path}: is empty; the first line names the columns: {','.join(needed)},subject,...")
    _, header = lines[0]
    width = max((n for n, name in enumerate(header, start=1) if name), default=0)
    columns = tuple(name.lower() for name in header[:width])
    _check_header(path, columns, needed)
    rows = []
    for line, cells in lines[1:]:
        while len(cells) > width and not cells[-1]:
            cells.pop()  # delimiters at the end, as spreadsheets leave them
        if len(cells) != width:
            raise ConfigError(
                f"{path}: line {line} has {len(cells)} cells, the first line names {width} columns; put text that "
                "holds the delimiter between double quotes"
            )
        rows.append((line, dict(zip(columns, cells, strict=True))))
    if not rows:
        raise ConfigError(f"{path}: has no line after that of the columns")
    return LabelTable(path.name, columns, tuple(rows))


def _text(path: Path) -> str:
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror or error}") from None
    wide = content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    try:
        return content.decode("utf-16" if wide else "utf-8-sig")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise ConfigError(
            f"{path}: line {line} is no {'UTF-16' if wide else 'UTF-8'} text; save it as CSV in UTF-8"
        ) from None


def _delimiter(path: Path, text: str, needed: tuple[str, ...]) -> str:
    """The delimiter that splits the first line into the needed columns; else the one that gives most columns."""
    found = {one: _cells(path, text, one, most=1) for one in DELIMITERS}
    headers = {one: lines[0][1] if lines else [] for one, lines in found.items()}
    fitting = [one for one, header in headers.items() if set(needed) <= {name.lower() for name in header}]
    return fitting[0] if fitting else max(headers, key=lambda one: len(headers[one]))


def _cells(path: Path, text: str, delimiter: str, *, most: int | None = None) -> list[tuple[int, list[str]]]:
    """Lines that hold anything, with their numbers; a line is numbered by its start."""
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter, skipinitialspace=True, strict=True)
    lines: list[tuple[int, list[str]]] = []
    before = 0
    try:
        for cells in reader:
            stripped = [cell.strip() for cell in cells]
            if any(stripped):
                lines.append((before + 1, stripped))
            before = reader.line_num
            if most is not None and len(lines) >= most:
                break
    except csv.Error as error:
        raise ConfigError(f"{path}: line {before + 1} is no CSV: {error}") from None
    return lines


def _check_header(path: Path, columns: tuple[str, ...], needed: tuple[str, ...]) -> None:
    shown = ", ".join(name or "(no name)" for name in columns)
    for name in needed:
        if name not in columns:
            raise ConfigError(
                f"{path}: line 1 names no column {name!r}; it names {shown}; {' and '.join(needed)} are needed"
            )
    for place, name in enumerate(columns):
        if not name:
            raise ConfigError(f"{path}: column {place + 1} has no name in line 1; name it or delete it")
        if name in columns[:place]:
            raise ConfigError(f"{path}: line 1 names the column {name!r} twice")
