"""Motion tables of planned examples: checked, and whose motion they are. Files are looked for, never read."""

from __future__ import annotations

import hashlib
import inspect
import re
from collections.abc import Iterable, Mapping, Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from pydantic import Field

from doppelgait.core.config import FrozenModel, validate
from doppelgait.core.errors import ConfigError
from doppelgait.dataset.config import SourceSection
from doppelgait.dataset.describe import shorten

NOBODY = "none"
"""Motion kind of an example without a target."""
PHANTOM_SPEED_MPS = {"uniform": [0.4, 2.0]}
"""How fast the gate of an example without a target moves, unless the plan says so."""


def recording_of(motion: Mapping[str, Any]) -> str:
    """Recording that a resolved motion table takes, its path as written; empty for a model."""
    return str(motion["path"]) if motion["kind"] == "file" else ""


def source_entry(recording: str, sources: Sequence[SourceSection]) -> SourceSection | None:
    """The first entry of ``[[sources]]`` that fits a recording."""
    return next((entry for entry in sources if fnmatchcase(recording, entry.files)), None)


def subject_of(motion: Mapping[str, Any], row_id: str, sources: Sequence[SourceSection] = ()) -> str:
    """Whose motion it is: as ``[[sources]]`` says, else the recording; a model's draw is its own subject.

    Raises
    ------
    ConfigError
        If the expression of the source does not match.
    """
    recording = recording_of(motion)
    if not recording:
        return f"model/{row_id}"
    entry = source_entry(recording, sources)
    if entry is None or entry.subject is None:
        return f"file/{recording}"
    match = re.search(entry.subject, recording)
    if match is None or not match[1]:
        raise ConfigError(
            f"sources.{list(sources).index(entry)}.subject: {entry.subject!r} finds no subject in {recording!r}"
        )
    return f"person/{match[1]}"


class Phantom(FrozenModel):
    """Options of motion ``none``.

    Parameters
    ----------
    speed_mps : float
        Speed of the gate over ground.
    """

    speed_mps: float = Field(ge=0, le=10)


def check_motion(motion: Any, folder: Path, *, key: str) -> None:
    """Check a resolved motion table without generating or reading anything.

    Parameters
    ----------
    motion : table
    folder : Path
        Folder that relative motion paths start from.
    key : str
        Dotted key of the table, for messages.

    Raises
    ------
    ConfigError
        If the kind, a parameter or an option is not known or not allowed, or a file is missing.
    """
    from doppelgait.motion.models import MOTION_MODELS

    if not isinstance(motion, Mapping) or not isinstance(motion.get("kind"), str):
        needs = 'needs kind = "NAME" (a motion model, or "file" with path = "...")'
        raise ConfigError(f"{key}: {shorten(motion)} is not allowed: {needs}")
    kind = motion["kind"]
    options = {name: value for name, value in motion.items() if name != "kind"}
    if kind == "folder":
        raise ConfigError(f"{key}.kind: a folder is allowed in [[classes]] only; name a file")
    if kind == "file":
        _check_file(options, folder, key)
    elif kind == NOBODY:
        validate(Phantom, options, section=tuple(key.split(".")))
    elif kind not in MOTION_MODELS:
        known = ", ".join(["file", NOBODY, *MOTION_MODELS])
        raise ConfigError(f"{key}.kind: {kind!r} is not allowed: known are {known}")
    else:
        try:
            validate(MOTION_MODELS[kind].config, options, section=tuple(key.split(".")))
        except ConfigError as error:
            raise ConfigError(f"{error} (motion is {shorten(motion)})") from None


def _check_file(options: dict[str, Any], folder: Path, key: str) -> None:
    path = options.pop("path", None)
    if not isinstance(path, str) or not path:
        raise ConfigError(f'{key}.path: {shorten(path)} is not allowed: kind "file" needs path = "..."')
    if not (folder / path).is_file():
        raise ConfigError(f"{key}.path: {path!r} is not allowed: there is no such file in {folder.resolve()}")
    allowed = _file_options()
    for name in sorted(set(options) - set(allowed)):
        raise ConfigError(
            f"{key}.{name}: {shorten(options[name])} is not allowed: unknown key; allowed are path, "
            f"{', '.join(allowed)}"
        )


def _file_options() -> list[str]:
    """Options of all readers: which of them takes a file is known only from its content."""
    from doppelgait.motion.readers import MOTION_READERS, read

    functions = [read, *(MOTION_READERS[name].read for name in MOTION_READERS)]
    parameters = [p for function in functions for p in inspect.signature(function).parameters.values()]
    return list(dict.fromkeys(p.name for p in parameters if p.kind is p.KEYWORD_ONLY))


def motion_files(motions: Iterable[Mapping[str, Any]]) -> list[str]:
    """Paths of all motion files that motion tables name, drawn or not, as written and sorted."""
    found: set[str] = set()

    def walk(value: Any) -> None:
        if isinstance(value, Mapping):
            if "file" in _strings(value.get("kind")):
                found.update(_strings(value.get("path")))
            for inner in value.values():
                walk(inner)
        elif isinstance(value, list):
            for inner in value:
                walk(inner)

    for motion in motions:
        walk(motion)
    return sorted(found)


def _strings(value: Any) -> list[str]:
    """The text, or every text that a ``choice`` or ``cycle`` can give."""
    if isinstance(value, str):
        return [value]
    if isinstance(value, Mapping):
        lists = [value.get(name) for name in ("choice", "cycle")]
        return [text for entries in lists if isinstance(entries, list) for e in entries for text in _strings(e)]
    return []


def refuse_two_spellings(paths: Iterable[str], folder: Path) -> None:
    """A :class:`ConfigError` if two paths lead to one file: it would be two subjects, perhaps in two splits."""
    seen: dict[Path, str] = {}
    for path in paths:
        first = seen.setdefault((folder / path).resolve(), path)
        if first != path:
            raise ConfigError(f"motion files {first!r} and {path!r} are the same file; write its path in one way")


def refuse_copies(paths: Iterable[str], folder: Path, sources: Sequence[SourceSection]) -> None:
    """A :class:`ConfigError` if files of equal content would be different subjects, perhaps in two splits."""
    by_size: dict[int, list[str]] = {}
    for path in paths:
        if (folder / path).is_file():
            by_size.setdefault((folder / path).stat().st_size, []).append(path)
    seen: dict[str, str] = {}
    for path in (path for group in by_size.values() if len(group) > 1 for path in group):
        first = seen.setdefault(hashlib.sha256((folder / path).read_bytes()).hexdigest(), path)
        if subject_of({"kind": "file", "path": first}, "", sources) != subject_of(
            {"kind": "file", "path": path}, "", sources
        ):
            raise ConfigError(
                f"motion files {first!r} and {path!r} hold the same; leave one out, or give both one subject in "
                "[[sources]]"
            )
