"""Labels of recordings: a file of labels, whose every mistake is reported, or names of files."""

from __future__ import annotations

import codecs
import csv
import hashlib
import io
import math
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from fnmatch import fnmatchcase
from functools import cache, partial
from itertools import islice
from pathlib import Path
from typing import Any, NoReturn

from doppelgait.core.config import apply_overrides, read_toml
from doppelgait.core.documents import read_document
from doppelgait.core.errors import ConfigError, warn_caller
from doppelgait.core.files import hash_file, list_files
from doppelgait.dataset.config import SPLITS, list_some, parse_gate, suggest_names
from doppelgait.pipeline.pictures import SETTINGS_NAME, SUFFIXES, find_settings_file, is_picture
from doppelgait.processing.gate import GateChoice
from doppelgait.radar.readers.dca1000 import find_config
from doppelgait.radar.xethru.records import META_NAME

PAIRS = (("_RE.txt", "_IM.txt"), (".sigmf-meta", ".sigmf-data"))
WITH_SIDECAR = (".npy", ".npz", ".bin", *SUFFIXES)
"""Suffixes of recordings that a settings file of the same stem may describe."""


def find_recordings(folder: Path, pattern: str) -> list[str]:
    """Find recordings in a folder by name or pattern."""
    # os.path: a name may be too long or have a zero byte
    name = pattern if os.path.exists(folder / pattern) else pattern.replace("\\", "/")
    if Path(name).is_absolute() or ".." in Path(name).parts:
        raise ConfigError(f"{pattern!r} is not allowed: it must be a path inside {folder}, relative to it")
    found = [folder / name] if os.path.exists(folder / name) else []
    if not found and any(sign in name for sign in "*?["):
        try:
            found = sorted(folder.glob(name))
        except ValueError as error:
            raise ConfigError(f"{pattern!r} is not a pattern: {error}; ** must stand alone between slashes") from None
    if not found:
        place = (folder / name).parent
        names = (path.name for path in (place if os.path.isdir(place) else folder).iterdir())
        raise ConfigError(f"{pattern!r}: is not in {folder}{suggest_names(Path(name).name, names)}")
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


def list_recording_files(path: Path) -> tuple[Path, ...]:
    """Return all files of a recording, by its format's names."""
    if path.is_dir():
        return tuple(list_files(path))
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


def read_rows(path: Path) -> list[tuple[int, dict[str, str]]]:
    """Read lines of a CSV file and their numbers; the first line names the columns."""
    try:
        content = read_document(path)
    except (OSError, ValueError) as error:
        raise ConfigError(f"{path}: cannot be read: {getattr(error, 'strerror', '') or error}") from None
    wide = content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    try:
        text = content.decode("utf-16" if wide else "utf-8-sig")
    except UnicodeDecodeError as error:
        line, code = content[: error.start].count(b"\n") + 1, "UTF-16" if wide else "UTF-8"
        raise ConfigError(f"{path}: line {line} is not {code} text; save it as CSV in UTF-8") from None
    headers = {sign: next(_split_cells(path, text, sign), (1, []))[1] for sign in ",;\t"}
    fitting = (sign for sign, header in headers.items() if set(NEEDED) <= {name.lower() for name in header})
    delimiter = next(fitting, max(headers, key=lambda sign: len(headers[sign])))
    lines = list(_split_cells(path, text, delimiter))
    if not lines:
        raise ConfigError(f"{path}: is empty; the first line names the columns: {','.join(NEEDED)},subject,...")
    columns = [name.lower() for name in lines[0][1]]
    while columns and not columns[-1]:  # spreadsheets add empty cells at the end
        columns.pop()
    for name in NEEDED:
        if name not in columns:
            shown = ", ".join(name or "(no name)" for name in columns)
            raise ConfigError(
                f"{path}: line 1 names no column {name!r}; it names {shown}; {' and '.join(NEEDED)} are needed"
            )
    for place, name in enumerate(columns):
        if not name:
            raise ConfigError(f"{path}: column {place + 1} has no name in line 1; name it or delete it")
        if name in columns[:place]:
            raise ConfigError(f"{path}: line 1 names the column {name!r} twice")
    if not lines[1:]:
        raise ConfigError(f"{path}: has no line after the column names")
    rows = []
    for line, cells in lines[1:]:
        kept = cells if any(cells[len(columns) :]) else cells[: len(columns)]
        if len(kept) != len(columns):
            raise ConfigError(
                f"{path}: line {line} has {len(kept)} cells, the first line names {len(columns)} "
                "columns; put text that holds the delimiter between double quotes"
            )
        rows.append((line, dict(zip(columns, kept, strict=True))))
    return rows


def _split_cells(path: Path, text: str, delimiter: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the cells of non-empty lines with the numbers of the lines."""
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter, skipinitialspace=True, strict=True)
    before = 0
    try:
        for cells in reader:
            stripped = [cell.strip() for cell in cells]
            if any(stripped):
                yield before + 1, stripped
            before = reader.line_num
    except csv.Error as error:
        raise ConfigError(f"{path}: line {before + 1} is not CSV: {error}") from None


NEEDED = ("file", "label")
TEXTS = ("subject", "split", "session", "licence", "citation")
COLUMNS = (*NEEDED, *TEXTS, "start_s", "stop_s", "gate", "nobody")
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

    @property
    def span_s(self) -> tuple[float, float]:
        """Start and end in the recording."""
        return self.start_s or 0.0, math.inf if self.stop_s is None else self.stop_s


def read_labels(path: str | Path, folder: str | Path, *, gate: GateChoice = "track") -> list[LabelEntry]:
    """Read a label file, entries in line order."""
    source, rows = Path(path), read_rows(Path(path))
    names = {}
    for column in rows[0][1]:
        own = column.startswith((OPTION, TRUTH, META)) and not column.endswith((OPTION, TRUTH, META))
        close = get_close_matches(column, COLUMNS, n=1, cutoff=NEAR_COLUMN)
        if close and not own and column not in COLUMNS:
            raise ConfigError(
                f"{source.name}: line 1, column {column!r}: is not known; rename it {close[0]}, or "
                f"{META}{column} to keep it"
            )
        names[column] = column if own or column in COLUMNS else META + column
    find = cache(partial(find_recordings, Path(folder)))
    entries: list[LabelEntry] = []
    faults = []
    for line, cells in rows:
        try:
            entries += _make_entries(line, {names[column]: cell for column, cell in cells.items()}, find, gate)
        except ConfigError as error:
            faults.append(f"line {line}, {error}")
    faults += islice(_find_conflicts(entries), MOST_CONFLICTS)
    if faults:
        raise ConfigError(f"{source.name}: {list_some(faults, SHOWN_FAULTS, '; ')}")
    first: dict[str, int] = {}
    for entry in entries:
        first.setdefault(entry.label, entry.line)
    folded: dict[str, str] = {}
    for label, line in first.items():
        if close := get_close_matches(label.lower(), folded, n=1, cutoff=NEAR_LABEL):
            other = folded[close[0]]
            warn_caller(
                f"{source.name}: labels {other!r} (line {first[other]}) and {label!r} (line "
                f"{line}) are near in spelling and count as two classes"
            )
        folded[label.lower()] = label
    return entries


def _make_entries(
    line: int, cells: Mapping[str, str], find: Callable[[str], list[str]], gate: GateChoice
) -> list[LabelEntry]:
    def refuse(name: str, words: str) -> NoReturn:
        raise ConfigError(f"{name}: {cells[name]!r} is not allowed; {words}")

    def read_number(name: str) -> float | None:
        try:
            value = float(cells.get(name) or 0.0)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            refuse(name, "it must be a number with a decimal point, or empty")
        return value if cells.get(name) else None

    if not LABEL.fullmatch(cells["label"]):
        refuse("label", "it needs one or more letters, digits, spaces, _ . or -")
    start_s, stop_s = read_number("start_s"), read_number("stop_s")
    for name, value in (("start_s", start_s), ("stop_s", stop_s)):
        if value is not None and value < 0:
            refuse(name, "it must be 0 s or more, from the start of the recording")
    if stop_s is not None and stop_s <= (start_s or 0.0):
        raise ConfigError(f"stop_s: {stop_s:g} is not allowed; it must be after start_s = {start_s or 0.0:g}")
    if cells.get("split", SPLITS[0]) not in SPLITS:
        refuse("split", f"allowed are {', '.join(SPLITS)}")
    if not cells["file"]:
        raise ConfigError("file: is empty")
    try:
        recordings = find(cells["file"])
    except ConfigError as error:
        raise ConfigError(f"file: {error}") from None
    is_empty = cells.get("nobody", "").lower()
    if is_empty not in YES + NO:
        refuse("nobody", "allowed are yes, no or nothing")
    options = {name.removeprefix(OPTION): cell for name, cell in cells.items() if name.startswith(OPTION) and cell}
    further: dict[str, Any] = {
        name: cell for name, cell in cells.items() if name.startswith(META) or name in TEXT_TRUTHS
    }
    further |= {name: read_number(name) for name in cells if name.startswith(TRUTH) and name not in TEXT_TRUTHS}
    entry = LabelEntry(
        line,
        "",
        cells["label"],
        parse_gate(cells.get("gate") or gate, where="gate"),
        start_s,
        stop_s,
        **{name: cells.get(name, "") for name in TEXTS},
        nobody=is_empty in YES,
        options=apply_overrides({}, [f"{name}={cell}" for name, cell in options.items()]),
        further=further,
    )
    return [replace(entry, recording=recording) for recording in recordings]


def _find_conflicts(entries: Sequence[LabelEntry]) -> Iterator[str]:
    """Yield contradictions of two lines about one recording part."""
    by_recording: dict[str, list[LabelEntry]] = {}
    for entry in entries:
        by_recording.setdefault(entry.recording, []).append(entry)
    for same in by_recording.values():
        running: list[LabelEntry] = []  # entries that have not ended
        parts: dict[str, LabelEntry] = {}
        for entry in sorted(same, key=lambda entry: entry.span_s[0]):
            other = parts.setdefault(str((entry.span_s, entry.gate, sorted(entry.options.items()))), entry)
            if other is not entry:
                first, second = sorted((other, entry), key=lambda entry: entry.line)
                yield (
                    f"line {second.line}, file: {second.recording!r} is already in line "
                    f"{first.line}; each part of a recording can be listed once"
                )
                continue
            running = [other for other in running if entry.span_s[0] < other.span_s[1]]
            for other in running:
                if (other.gate, other.options) == (entry.gate, entry.options) and other.label != entry.label:
                    first, second = sorted((other, entry), key=lambda entry: entry.line)
                    yield (
                        f"line {second.line}, file: {second.recording!r} is {second.label!r} and in line {first.line} "
                        f"{first.label!r} at the same time; give each its own start_s and stop_s, or its own gate"
                    )
            running.append(entry)


PARTS = ("label", "subject", "session")
TOKEN = re.compile(r"\{(\w+)\}|(\*\*/)|(\*)")


NAME_FORMS: dict[str, Any] = read_toml(Path(__file__).with_name("names.toml"))[0]
"""File name templates of published sets, with labels and citation."""


def read_names(folder: str | Path, names: str, *, gate: GateChoice = "track") -> list[LabelEntry]:
    """Read labels and subjects from file names."""
    source = Path(folder)
    if not source.is_dir():
        raise ConfigError(f"{source}: no such folder of recordings")
    form = NAME_FORMS.get(names, {})
    template, labels = form.get("template", names), form.get("labels", {})
    pattern, suffix = _compile(names, template), Path(template).suffix
    files = (path for path in list_files(source) if path.name.endswith(suffix))
    paths = sorted(path.relative_to(source).as_posix() for path in files)
    entries: list[LabelEntry] = []
    unfit, unknown = [], []
    for path in paths:
        found = pattern.fullmatch(path)
        if found is None:
            unfit.append(path)
            continue
        parts = found.groupdict()
        label = labels.get(parts["label"], "" if labels else parts["label"])
        if not LABEL.fullmatch(label):
            unknown.append(f"{path} ({parts['label']!r})")
            continue
        facts: dict[str, Any] = {**parts, "label": label, "gate": gate, "citation": form.get("citation", "")}
        entries.append(LabelEntry(len(entries) + 1, path, **facts))
    if unknown:
        allowed = (
            ", ".join(f"{code} ({label})" for code, label in labels.items())
            or "letters, digits, spaces, _ . and -; rename it, or write a file of labels"
        )
        raise ConfigError(f"{source}: {list_some(unknown, SHOWN_FAULTS)}: is no label; allowed are {allowed}")
    if not entries:
        seen = f"{len(unfit)} files end in {suffix!r}, the first is {unfit[0]}" if unfit else f"none ends in {suffix!r}"
        raise ConfigError(f"{source}: no file fits {template}: {seen}")
    if unfit:
        listed = list_some(unfit, SHOWN_FAULTS)
        warn_caller(f"{source}: {len(unfit)} files do not fit {template} and are left out: {listed}")
    return entries


def label_entries(
    folder: Path,
    labels: Path | None,
    names: str | None,
    classes: Sequence[str],
    *,
    gate: GateChoice,
    options: Mapping[str, Any] | None = None,
) -> Path | list[LabelEntry]:
    """Choose labels of files or names, with classes."""
    if labels is not None and names is None and not (classes or options):
        return labels
    if (labels is None) == (names is None):
        raise ConfigError("set --labels, or set --names if the file names contain the labels")
    entries = (
        read_labels(labels, folder, gate=gate) if labels is not None else read_names(folder, names or "", gate=gate)
    )
    return [replace(one, options={**(options or {}), **one.options}) for one in relabel(entries, classes)]


def relabel(entries: Sequence[LabelEntry], classes: Sequence[str]) -> list[LabelEntry]:
    """Rename labels, or leave their recordings out."""
    labels = list(dict.fromkeys(entry.label for entry in entries))
    there = f"the labels are {', '.join(labels)}"
    renamed: dict[str, str] = {}
    for text in classes:
        old, sign, new = (part.strip() for part in text.partition("="))
        if not sign or not old or (new and not LABEL.fullmatch(new)):
            raise ConfigError(
                f"--label {text!r} is not allowed; it must be LABEL=CLASS, with nothing after = to leave out"
            )
        fitting = [label for label in labels if fnmatchcase(label, old)]
        if not fitting:
            raise ConfigError(f"--label {text!r}: fits no label; {there}")
        renamed = {**dict.fromkeys(fitting, new), **renamed}
    left = [replace(entry, label=renamed.get(entry.label, entry.label)) for entry in entries]
    if not any(entry.label for entry in left):
        raise ConfigError(f"--label {', '.join(classes)}: leaves out every recording; {there}")
    return [entry for entry in left if entry.label]


def _compile(names: str, template: str) -> re.Pattern[str]:
    known = f"known are {', '.join(NAME_FORMS)}, or a template such as {{label}}/{{subject}}_*.png"
    parts = [match[1] for match in TOKEN.finditer(template) if match[1]]
    if "label" not in parts:
        raise ConfigError(f"--names {names!r} is not allowed: it has no {{label}}; {known}")
    if wrong := [part for part in parts if part not in PARTS or parts.count(part) > 1]:
        raise ConfigError(
            f"--names {names!r} is not allowed: {{{wrong[0]}}} must be one of {', '.join(PARTS)}, each once; {known}"
        )
    text, end = "", 0
    for match in TOKEN.finditer(template):
        text += re.escape(template[end : match.start()])
        text += f"(?P<{match[1]}>[^/]+?)" if match[1] else "(?:.*/)?" if match[2] else "[^/]*"
        end = match.end()
    return re.compile(text + re.escape(template[end:]))
