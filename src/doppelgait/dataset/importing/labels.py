"""``labels.csv``: what recordings show, line by line, with every mistake named."""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from functools import cache, partial
from pathlib import Path
from typing import Any

from doppelgait.core.config import apply_overrides
from doppelgait.core.errors import ConfigError, DoppelgaitWarning
from doppelgait.dataset.config import SPLITS
from doppelgait.dataset.importing.config import Gate, parse_gate
from doppelgait.dataset.importing.files import find_recordings
from doppelgait.dataset.importing.table import LabelTable, read_table

COLUMNS = (
    "file", "label", "subject", "split", "start_s", "stop_s", "gate", "nobody", "licence", "citation", "session",
)  # fmt: skip
NEEDED = ("file", "label")
OPTION, TRUTH, META = "option.", "truth_", "meta_"
TEXT_TRUTHS = ("truth_gait",)
YES, NO = ("yes", "true", "1", "x"), ("no", "false", "0", "")
LABEL = re.compile(r"[A-Za-z0-9 _.-]+")
SHOWN_FAULTS = 8
NEAR_COLUMN, NEAR_LABEL = 0.75, 0.8
"""How alike, from 0 to 1, two spellings must be for one to be taken for a slip of the other."""


@dataclass(frozen=True)
class LabelEntry:
    """One recording, or a part of it, as its line labels it.

    Parameters
    ----------
    line : int
        Line in the file of labels.
    recording : str
        Path in the folder, with slashes.
    label : str
    gate : "track" or (float, float)
    start_s, stop_s : float, optional
        The part that is meant, from the start of the recording; all of it by default.
    subject, split, session, licence, citation : str
        Empty where not told.
    nobody : bool
        Whether nobody is there: then it is right to find nothing.
    options : dict
        For the reader of the format.
    further : dict
        Columns that are kept as they are: ``meta_*`` (text) and ``truth_*`` (numbers, None where not told).
    """

    line: int
    recording: str
    label: str
    gate: Gate = "track"
    start_s: float | None = None
    stop_s: float | None = None
    subject: str = ""
    split: str = ""
    session: str = ""
    licence: str = ""
    citation: str = ""
    nobody: bool = False
    options: Mapping[str, Any] = field(default_factory=dict)
    further: Mapping[str, Any] = field(default_factory=dict)

    def overlaps(self, other: LabelEntry) -> bool:
        """Whether both mean the same time and place of one recording."""
        same_place = self.gate == other.gate and self.options == other.options
        return same_place and (self.start_s or 0.0) < _end(other) and (other.start_s or 0.0) < _end(self)


def _end(entry: LabelEntry) -> float:
    return math.inf if entry.stop_s is None else entry.stop_s


def read_labels(path: str | Path, folder: str | Path, *, gate: Gate = "track") -> list[LabelEntry]:
    """Entries of a file of labels, one per recording and line, in the order of the lines.

    Parameters
    ----------
    path : path
        CSV with comma, semicolon or tab. Columns: ``file`` (or a pattern for several) and ``label``; optional
        ``subject``, ``split``, ``start_s``, ``stop_s``, ``gate`` (``track`` or ``1.2:2.8``), ``nobody`` (``yes``),
        ``licence``, ``citation``, ``session``, ``option.NAME`` for the reader, ``truth_NAME`` for what was measured by
        hand (numbers). Others are kept as ``meta_NAME``.
    folder : path
        Where the recordings are.
    gate : "track" or (float, float)
        Of lines without one.

    Raises
    ------
    ConfigError
        With all mistakes: line, column, value, what is allowed.
    """
    table = read_table(Path(path), needed=NEEDED)
    names = {column: _meaning(table.name, column) for column in table.columns}
    find = cache(partial(find_recordings, Path(folder)))
    entries: list[LabelEntry] = []
    faults = []
    for line, cells in table.rows:
        try:
            entries += _entries(line, {names[column]: cell for column, cell in cells.items()}, find, gate)
        except ConfigError as error:
            faults.append(f"line {line}, {error}")
    faults += _conflicts(entries)
    if faults:
        more = f"; and {len(faults) - SHOWN_FAULTS} more" if len(faults) > SHOWN_FAULTS else ""
        raise ConfigError(f"{table.name}: " + "; ".join(faults[:SHOWN_FAULTS]) + more)
    _warn_of_spellings(table, entries)
    return entries


def _meaning(name: str, column: str) -> str:
    """Name that a column is kept under; one that nearly is one of ours is a mistake."""
    if column in COLUMNS or (column.startswith((OPTION, TRUTH, META)) and not column.endswith((OPTION, TRUTH, META))):
        return column
    if close := get_close_matches(column, COLUMNS, n=1, cutoff=NEAR_COLUMN):
        raise ConfigError(
            f"{name}: line 1, column {column!r}: is not known; call it {close[0]}, or {META}{column} to keep it"
        )
    return META + column


def _entries(line: int, cells: Mapping[str, str], find: Callable[[str], list[str]], gate: Gate) -> list[LabelEntry]:
    label = cells["label"]
    if not LABEL.fullmatch(label):
        raise ConfigError(f"label: {label!r} is not allowed; it needs one or more letters, digits, spaces, _ . or -")
    start_s, stop_s = (_seconds(name, cells.get(name, "")) for name in ("start_s", "stop_s"))
    if stop_s is not None and stop_s <= (start_s or 0.0):
        raise ConfigError(f"stop_s: {stop_s:g} is not allowed; it must be after start_s = {start_s or 0.0:g}")
    if "split" in cells and cells["split"] not in SPLITS:
        raise ConfigError(f"split: {cells['split']!r} is not allowed; allowed are {', '.join(SPLITS)}")
    try:
        recordings = find(_filled("file", cells["file"]))
    except ConfigError as error:
        raise ConfigError(f"file: {error}") from None
    texts = {name: cells.get(name, "") for name in ("subject", "split", "session", "licence", "citation")}
    return [
        LabelEntry(
            line, recording, label, _gate(cells.get("gate", ""), gate), start_s, stop_s, **texts,
            nobody=_yes(cells.get("nobody", "")), options=_options(cells), further=_further(cells),
        )
        for recording in recordings
    ]  # fmt: skip


def _filled(name: str, cell: str) -> str:
    if not cell:
        raise ConfigError(f"{name}: is empty")
    return cell


def _seconds(name: str, cell: str) -> float | None:
    value = _number(name, cell)
    if value is not None and value < 0:
        raise ConfigError(f"{name}: {cell!r} is not allowed; it must be 0 s or more, from the start of the recording")
    return value


def _number(name: str, cell: str) -> float | None:
    if not cell:
        return None
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ConfigError(f"{name}: {cell!r} is not allowed; it must be a number with a decimal point, or empty")
    return value


def _gate(cell: str, usual: Gate) -> Gate:
    try:
        return parse_gate(cell) if cell else usual
    except ValueError as error:
        raise ConfigError(f"gate: {cell!r} is not allowed; it {error}") from None


def _yes(cell: str) -> bool:
    if cell.lower() not in YES + NO:
        raise ConfigError(f"nobody: {cell!r} is not allowed; allowed are yes, no or nothing")
    return cell.lower() in YES


def _options(cells: Mapping[str, str]) -> dict[str, Any]:
    given = [f"{name.removeprefix(OPTION)}={cell}" for name, cell in cells.items() if name.startswith(OPTION) and cell]
    return apply_overrides({}, given)


def _further(cells: Mapping[str, str]) -> dict[str, Any]:
    kept: dict[str, Any] = {name: cell for name, cell in cells.items() if name.startswith(META) or name in TEXT_TRUTHS}
    for name, cell in cells.items():
        if name.startswith(TRUTH) and name not in TEXT_TRUTHS:
            kept[name] = _number(name, cell)
    return kept


def _conflicts(entries: Sequence[LabelEntry]) -> Iterator[str]:
    """What two lines say of the same part of one recording."""
    by_recording: dict[str, list[LabelEntry]] = {}
    for entry in entries:
        by_recording.setdefault(entry.recording, []).append(entry)
    for same in by_recording.values():
        going_on: list[LabelEntry] = []
        for entry in sorted(same, key=lambda one: one.start_s or 0.0):
            going_on = [other for other in going_on if (entry.start_s or 0.0) < _end(other)]
            for other in going_on:
                if entry.overlaps(other) and (_is_same(entry, other) or entry.label != other.label):
                    yield _conflict(*sorted((other, entry), key=lambda one: one.line))
            going_on.append(entry)


def _is_same(entry: LabelEntry, other: LabelEntry) -> bool:
    return (entry.start_s or 0.0, entry.stop_s) == (other.start_s or 0.0, other.stop_s)


def _conflict(first: LabelEntry, second: LabelEntry) -> str:
    where = f"line {second.line}, file: {second.recording!r}"
    if _is_same(first, second):
        return f"{where} is already in line {first.line}; each part of a recording can be there once"
    return (
        f"{where} is {second.label!r} and in line {first.line} {first.label!r} at the same time; give each its own "
        "start_s and stop_s, or its own gate"
    )


def _warn_of_spellings(table: LabelTable, entries: Sequence[LabelEntry]) -> None:
    """A warning for labels so alike that one may be a slip of the other."""
    first: dict[str, int] = {}
    for entry in entries:
        first.setdefault(entry.label, entry.line)
    folded: dict[str, str] = {}
    for label, line in first.items():
        close = get_close_matches(label.lower(), folded, n=1, cutoff=NEAR_LABEL)
        if close:
            other = folded[close[0]]
            warnings.warn(
                f"{table.name}: labels {other!r} (line {first[other]}) and {label!r} (line {line}) are near in "
                "spelling and count as two classes",
                DoppelgaitWarning,
                stacklevel=4,
            )
        folded[label.lower()] = label
