"""File of labels, ``labels.csv``: parser that reports every mistake."""

from __future__ import annotations

import codecs
import csv
import hashlib
import io
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from functools import cache, partial
from itertools import islice
from pathlib import Path
from typing import Any

from doppelgait.core.config import apply_overrides
from doppelgait.core.errors import ConfigError, warn_caller
from doppelgait.core.files import hash_file
from doppelgait.dataset.config import SPLITS, list_some, parse_gate
from doppelgait.pipeline.pictures import SETTINGS_NAME, SUFFIXES, find_settings_file, is_picture
from doppelgait.processing.gate import GateChoice
from doppelgait.radar.readers.dca1000 import find_config
from doppelgait.radar.xethru.records import META_NAME

PAIRS = (("_RE.txt", "_IM.txt"), (".sigmf-meta", ".sigmf-data"))
WITH_SIDECAR = (".npy", ".npz", ".bin", *SUFFIXES)
"""Suffixes of recordings that a settings file of the same stem may describe."""


def find_recordings(folder: Path, pattern: str) -> list[str]:
    """Find recordings in a folder by name or pattern."""
    name = pattern if _path_exists(folder / pattern) else pattern.replace("\\", "/")
    if Path(name).is_absolute() or ".." in Path(name).parts:
        raise ConfigError(f"{pattern!r} is not allowed: it must be a path inside {folder}, relative to it")
    found = [folder / name] if _path_exists(folder / name) else []
    if not found and any(sign in name for sign in "*?["):
        try:
            found = sorted(folder.glob(name))
        except ValueError as error:
            raise ConfigError(f"{pattern!r} is not a pattern: {error}; ** must stand alone between slashes") from None
    if not found:
        place = (folder / name).parent
        names = sorted(path.name for path in (place if _path_exists(place) and place.is_dir() else folder).iterdir())
        close = get_close_matches(Path(name).name, names, n=3, cutoff=0.6)
        hint = f"; near in spelling: {', '.join(close)}" if close else f"; it contains {len(names)} other recordings"
        raise ConfigError(f"{pattern!r}: is not in {folder}{hint}")
    recordings = set()
    for path in found:  # use the main file of the recording, whichever of its files was named
        for main, other in PAIRS:
            partner = path.with_name(path.name.removesuffix(other) + main)
            if path.name.endswith(other) and partner.is_file():
                path = partner
        if path.suffix in (".toml", ".json"):
            path = next((path.with_suffix(end) for end in WITH_SIDECAR if path.with_suffix(end).is_file()), path)
        if path.name == SETTINGS_NAME or path.suffix == ".cfg":  # search all recordings in the folder
            continue
        recordings.add(path.relative_to(folder).as_posix())
    if not recordings:
        raise ConfigError(f"{pattern!r}: is a settings file, not a recording")
    return sorted(recordings)


def _path_exists(path: Path) -> bool:
    try:
        return path.exists()
    except (OSError, ValueError):  # the name is too long or has a zero byte
        return False


def list_recording_files(path: Path) -> tuple[Path, ...]:
    """Return all files of a recording, by its format's names."""
    if path.is_dir():
        return tuple(sorted(inner for inner in path.rglob("*") if inner.is_file()))
    for pair in PAIRS:
        for end in pair:
            if path.name.endswith(end):
                both = (path.with_name(path.name.removesuffix(end) + other) for other in pair)
                return tuple(sorted(one for one in both if one.is_file()))
    if is_picture(path):
        about = find_settings_file(path)
        return (path,) if about is None else (path, about)
    described = find_config(path) if path.suffix == ".bin" else path.with_suffix(".toml")
    if path.suffix in WITH_SIDECAR and described is not None and described.is_file():
        return path, described
    meta = path.with_name(META_NAME)
    if path.suffix == ".dat" and meta.is_file():
        return tuple(sorted({path, meta})) if path != meta else tuple(sorted(path.parent.glob("xethru_*.dat")))
    return (path,)


def hash_recording(folder: Path, recording: str) -> str:
    """Hash names and bytes of a recording's files (SHA-256, hex)."""
    digest = hashlib.sha256()
    for path in list_recording_files(folder / recording):
        try:
            content = hash_file(path)
        except OSError:
            content = "unreadable"
        name = path.relative_to(folder).as_posix() if path.is_relative_to(folder) else path.name
        digest.update(f"{name}\n{content}\n".encode())
    return digest.hexdigest()


DELIMITERS = ",;\t"


@dataclass(frozen=True)
class LabelTable:
    """Lines of a label file."""

    name: str
    columns: tuple[str, ...]
    rows: tuple[tuple[int, dict[str, str]], ...]


def read_table(path: Path, *, needed: tuple[str, ...]) -> LabelTable:
    """Read a CSV file with column names in the first line."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror or error}") from None
    wide = content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    try:
        text = content.decode("utf-16" if wide else "utf-8-sig")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise ConfigError(
            f"{path}: line {line} is not {'UTF-16' if wide else 'UTF-8'} text; save it as CSV in UTF-8"
        ) from None
    firsts = {one: _split_cells(path, text, one, most=1) for one in DELIMITERS}
    headers = {one: lines[0][1] if lines else [] for one, lines in firsts.items()}
    fitting = [one for one, header in headers.items() if set(needed) <= {name.lower() for name in header}]
    delimiter = fitting[0] if fitting else max(headers, key=lambda one: len(headers[one]))
    lines = _split_cells(path, text, delimiter)
    if not lines:
        raise ConfigError(f"{path}: is empty; the first line names the columns: {','.join(needed)},subject,...")
    _, header = lines[0]
    width = max((n for n, name in enumerate(header, start=1) if name), default=0)
    columns = tuple(name.lower() for name in header[:width])
    for name in needed:
        if name not in columns:
            shown = ", ".join(name or "(no name)" for name in columns)
            raise ConfigError(
                f"{path}: line 1 names no column {name!r}; it names {shown}; {' and '.join(needed)} are needed"
            )
    for place, name in enumerate(columns):
        if not name:
            raise ConfigError(f"{path}: column {place + 1} has no name in line 1; name it or delete it")
        if name in columns[:place]:
            raise ConfigError(f"{path}: line 1 names the column {name!r} twice")
    rows = []
    for line, cells in lines[1:]:
        while len(cells) > width and not cells[-1]:
            cells.pop()  # spreadsheets add delimiters at the end
        if len(cells) != width:
            raise ConfigError(
                f"{path}: line {line} has {len(cells)} cells, the first line names {width} columns; put text that "
                "holds the delimiter between double quotes"
            )
        rows.append((line, dict(zip(columns, cells, strict=True))))
    if not rows:
        raise ConfigError(f"{path}: has no line after the column names")
    return LabelTable(path.name, columns, tuple(rows))


def _split_cells(path: Path, text: str, delimiter: str, *, most: int | None = None) -> list[tuple[int, list[str]]]:
    """Split a CSV text into non-empty lines with their numbers."""
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
        raise ConfigError(f"{path}: line {before + 1} is not CSV: {error}") from None
    return lines


COLUMNS = (
    "file",
    "label",
    "subject",
    "split",
    "start_s",
    "stop_s",
    "gate",
    "nobody",
    "licence",
    "citation",
    "session",
)
NEEDED = ("file", "label")
OPTION, TRUTH, META = "option.", "truth_", "meta_"
TEXT_TRUTHS = ("truth_gait",)
YES, NO = ("yes", "true", "1", "x"), ("no", "false", "0", "")
LABEL = re.compile(r"[A-Za-z0-9 _.-]+")
SHOWN_FAULTS = 8
MOST_CONFLICTS = 1000
"""Maximum number of reported contradictions, because any two lines may contradict each other."""
NEAR_COLUMN, NEAR_LABEL = 0.75, 0.8
"""Similarity, from 0 to 1, at which two spellings are reported as a possible typing error."""


@dataclass(frozen=True)
class LabelEntry:
    """Recording, or part of it, with its label."""

    line: int  # in the file of labels
    recording: str  # path in the folder, with slashes
    label: str
    gate: GateChoice = "track"
    start_s: float | None = None  # from the start of the recording; by default the whole recording
    stop_s: float | None = None
    subject: str = ""
    split: str = ""
    session: str = ""
    licence: str = ""
    citation: str = ""
    nobody: bool = False  # the scene is empty, so that no target is expected
    options: Mapping[str, Any] = field(default_factory=dict)  # for the reader of the format
    # Columns that are stored unchanged: ``meta_*`` (text) and ``truth_*`` (numbers or None).
    further: Mapping[str, Any] = field(default_factory=dict)

    def overlaps(self, other: LabelEntry) -> bool:
        """Return True if both mean the same time and place."""
        same_place = self.gate == other.gate and self.options == other.options
        return same_place and (self.start_s or 0.0) < _read_end_s(other) and (other.start_s or 0.0) < _read_end_s(self)


def _read_end_s(entry: LabelEntry) -> float:
    return math.inf if entry.stop_s is None else entry.stop_s


def read_labels(path: str | Path, folder: str | Path, *, gate: GateChoice = "track") -> list[LabelEntry]:
    """Read a label file, entries in line order."""
    table = read_table(Path(path), needed=NEEDED)
    names = {}
    for column in table.columns:
        own = column.startswith((OPTION, TRUTH, META)) and not column.endswith((OPTION, TRUTH, META))
        close = get_close_matches(column, COLUMNS, n=1, cutoff=NEAR_COLUMN)
        if close and not own and column not in COLUMNS:
            raise ConfigError(
                f"{table.name}: line 1, column {column!r}: is not known; rename it {close[0]}, or {META}{column} to "
                "keep it"
            )
        names[column] = column if own or column in COLUMNS else META + column
    find = cache(partial(find_recordings, Path(folder)))
    entries: list[LabelEntry] = []
    faults = []
    for line, cells in table.rows:
        try:
            entries += _make_entries(line, {names[column]: cell for column, cell in cells.items()}, find, gate)
        except ConfigError as error:
            faults.append(f"line {line}, {error}")
    faults += islice(_find_conflicts(entries), MOST_CONFLICTS)
    if faults:
        raise ConfigError(f"{table.name}: {list_some(faults, SHOWN_FAULTS, '; ')}")
    first: dict[str, int] = {}
    for entry in entries:
        first.setdefault(entry.label, entry.line)
    folded: dict[str, str] = {}
    for label, line in first.items():
        if close := get_close_matches(label.lower(), folded, n=1, cutoff=NEAR_LABEL):
            other = folded[close[0]]
            warn_caller(
                f"{table.name}: labels {other!r} (line {first[other]}) and {label!r} (line {line}) are near in "
                "spelling and count as two classes"
            )
        folded[label.lower()] = label
    return entries


def _make_entries(
    line: int, cells: Mapping[str, str], find: Callable[[str], list[str]], gate: GateChoice
) -> list[LabelEntry]:
    label = cells["label"]
    if not LABEL.fullmatch(label):
        raise ConfigError(f"label: {label!r} is not allowed; it needs one or more letters, digits, spaces, _ . or -")
    start_s, stop_s = (_number(name, cells.get(name, "")) for name in ("start_s", "stop_s"))
    for name, value in (("start_s", start_s), ("stop_s", stop_s)):
        if value is not None and value < 0:
            raise ConfigError(
                f"{name}: {cells[name]!r} is not allowed; it must be 0 s or more, from the start of the recording"
            )
    if stop_s is not None and stop_s <= (start_s or 0.0):
        raise ConfigError(f"stop_s: {stop_s:g} is not allowed; it must be after start_s = {start_s or 0.0:g}")
    if "split" in cells and cells["split"] not in SPLITS:
        raise ConfigError(f"split: {cells['split']!r} is not allowed; allowed are {', '.join(SPLITS)}")
    if not cells["file"]:
        raise ConfigError("file: is empty")
    try:
        recordings = find(cells["file"])
    except ConfigError as error:
        raise ConfigError(f"file: {error}") from None
    is_empty = cells.get("nobody", "").lower()
    if is_empty not in YES + NO:
        raise ConfigError(f"nobody: {cells['nobody']!r} is not allowed; allowed are yes, no or nothing")
    changes = [
        f"{name.removeprefix(OPTION)}={cell}" for name, cell in cells.items() if name.startswith(OPTION) and cell
    ]
    further: dict[str, Any] = {
        name: cell for name, cell in cells.items() if name.startswith(META) or name in TEXT_TRUTHS
    }
    for name, cell in cells.items():
        if name.startswith(TRUTH) and name not in TEXT_TRUTHS:
            further[name] = _number(name, cell)
    texts = {name: cells.get(name, "") for name in ("subject", "split", "session", "licence", "citation")}
    return [
        LabelEntry(
            line,
            recording,
            label,
            parse_gate(cells.get("gate") or gate, where="gate"),
            start_s,
            stop_s,
            **texts,
            nobody=is_empty in YES,
            options=apply_overrides({}, changes),
            further=further,
        )
        for recording in recordings
    ]


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


def _find_conflicts(entries: Sequence[LabelEntry]) -> Iterator[str]:
    """Yield contradictions of two lines about one recording part."""
    by_recording: dict[str, list[LabelEntry]] = {}
    for entry in entries:
        by_recording.setdefault(entry.recording, []).append(entry)
    for same in by_recording.values():
        going_on: list[LabelEntry] = []
        parts: dict[str, LabelEntry] = {}
        for entry in sorted(same, key=lambda one: one.start_s or 0.0):
            part = str((entry.start_s or 0.0, entry.stop_s, entry.gate, sorted(entry.options.items())))
            if (other := parts.setdefault(part, entry)) is not entry:
                first, second = sorted((other, entry), key=lambda one: one.line)
                yield (
                    f"line {second.line}, file: {second.recording!r} is already in line {first.line}; each part of a "
                    "recording can be listed once"
                )
                continue
            going_on = [other for other in going_on if (entry.start_s or 0.0) < _read_end_s(other)]
            for other in going_on:
                if not entry.overlaps(other) or entry.label == other.label:
                    continue
                first, second = sorted((other, entry), key=lambda one: one.line)
                yield (
                    f"line {second.line}, file: {second.recording!r} is {second.label!r} and in line {first.line} "
                    f"{first.label!r} at the same time; give each its own start_s and stop_s, or its own gate"
                )
            going_on.append(entry)
