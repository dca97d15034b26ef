"""Readers of files, for motion and radar alike: one protocol, one choice, one set of errors.

A reader is a function ``(path, **options)`` with keyword-only options, registered by ``plugin(GROUP, NAME, sniff=...,
suffixes=(...))``. ``sniff(path, head) -> bool`` decides by the first 4096 bytes; ``head`` is empty for a folder and for
a name without a file. A format without a mark of its own has ``by_name=(...)``: suffixes that choose it where no
sniffer takes the file. ``parts(path)`` lists the options of each recording in a file of several.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from numbers import Integral, Real
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, NamedTuple, TypeVar, Union, get_args, get_origin

from doppelgait.core.errors import ConfigError, DoppelgaitError
from doppelgait.core.keys import TABLES
from doppelgait.core.plugins import Group, Plugin, read_head

T = TypeVar("T")


class OtherFile(NamedTuple):
    """Kind of file that no reader takes, by suffix or first bytes, and what to use instead."""

    suffixes: tuple[str, ...]
    what: str
    remedy: str | Callable[[Path], str]
    magic: tuple[bytes, ...] = ()


def read_other_files(tables: Mapping[str, Any], **remedies: Callable[[Path], str]) -> tuple[OtherFile, ...]:
    """Return kinds of other files by tables of data; first bytes are Latin-1."""
    return tuple(
        OtherFile(
            tuple(table["suffixes"]),
            table["what"],
            table.get("remedy") or remedies[name],
            tuple(start.encode("latin-1") for start in table.get("magic", ())),
        )
        for name, table in tables.items()
    )


OTHER_FILES = read_other_files(TABLES["others"])  # they belong to no domain
WORDS = {bool: "true or false", int: "a whole number", float: "a number", str: "a text"}


def check_reader(reader: Plugin[Any]) -> None:
    """Check that a reader declares how its files are recognised."""
    try:
        inspect.signature(reader.facts["sniff"]).bind(Path(), b"")
        (*_, _) = reader.facts["suffixes"]
    except (LookupError, TypeError, ValueError):
        raise ConfigError(
            f"the {reader.group.replace('_', ' ')} {reader.name!r} needs sniff=..., a function (path, head) -> bool, "
            "and suffixes=(...)"
        ) from None


def list_options(run: Callable[..., Any]) -> list[str]:
    """Return the keyword-only options of a reader."""
    return [p.name for p in inspect.signature(run).parameters.values() if p.kind is p.KEYWORD_ONLY]


def find_readers(
    group: Group[T], path: Path, options: Sequence[str] = (), *, others: Sequence[OtherFile] = (), by_name: bool = True
) -> list[str]:
    """Return the readers of a file by its content, otherwise by its name and the options."""
    head, names = read_head(path), []
    for reader in group.values():
        with suppress(OSError):
            if reader.facts["sniff"](path, head):
                names.append(reader.name)
    if names or not head or not by_name or any(head.startswith(other.magic) for other in others):
        return names
    named = [r for r in group.values() if path.name.lower().endswith(tuple(r.facts.get("by_name", ())) or "\0")]
    fitting = [r.name for r in named if set(options) <= set(list_options(r.run))]  # type: ignore[arg-type]
    return fitting or [reader.name for reader in named]


def choose_reader(
    group: Group[T],
    path: Path,
    options: Mapping[str, Any],
    *,
    noun: str,
    error: type[DoppelgaitError],
    others: Sequence[OtherFile] = (),
    format: str | None = None,
    further: Sequence[str] = (),
) -> Plugin[T]:
    """Choose the reader of a file and check its options."""
    listed = ", ".join(f"{reader.name} ({', '.join(reader.facts['suffixes'])})" for reader in group.values())
    try:
        names = find_readers(group, path, list(options), others=(*others, *OTHER_FILES)) if format is None else [format]
        if format is not None and format not in group:
            raise error(f"{path}: format = {format!r} is not known; known are: {listed}")
        if len(names) > 1:
            several = [f"{name} (options {', '.join(list_options(group[name].run))})" for name in names]  # type: ignore[arg-type]
            raise error(f"{path}: could be {' or '.join(several)}; the reader is ambiguous: format='{names[0]}'")
        if not path.exists() and (not names or not path.parent.is_dir()):
            raise error(f"{path}: no such file")
        if not names:
            raise error(f"{path}: {_describe_unknown(path, noun, (*others, *OTHER_FILES), listed)}")
    except OSError as fault:
        raise error(f"{path}: cannot be read: {fault.strerror or fault}") from None
    reader = group[names[0]]
    allowed = list_options(reader.run)  # type: ignore[arg-type]
    if unknown := sorted(set(options) - set(allowed)):
        has = ", ".join([*further, *allowed])
        raise error(
            f"{path}: the {reader.name} reader has no option {', '.join(unknown)}; "
            + (f"allowed are {has}" if has else "it has none")
        )
    check_options(path, reader.run, options, error=error)  # type: ignore[arg-type]
    return reader


def _describe_unknown(path: Path, noun: str, others: Sequence[OtherFile], listed: str) -> str:
    if path.is_dir():
        return f"is a folder, not a {noun}; give one file"
    head = read_head(path)
    if not head:
        return "is empty (0 bytes)"
    marked = [other for other in others if head.startswith(other.magic)]
    for other in marked or [other for other in others if path.name.lower().endswith(other.suffixes)]:
        remedy = other.remedy if isinstance(other.remedy, str) else other.remedy(path)
        return f"is {other.what}, which has no known {noun} format; {remedy}"
    return f"its content has no known {noun} format; known are: {listed}"


def check_options(
    path: Path, run: Callable[..., Any], options: Mapping[str, Any], *, error: type[DoppelgaitError]
) -> None:
    """Check the types of options by the annotations of a function."""
    try:
        parameters = inspect.signature(run, eval_str=True).parameters
    except NameError:  # another package names types that it imports for type checkers only
        return
    for name, value in options.items():
        check_value(path, name, value, parameters[name].annotation if name in parameters else Any, error=error)


class Limits(NamedTuple):
    """Limits of a number, ``Annotated[float, Limits(0, 1e6)]``: above 0, at most 1e6."""

    above: float = -math.inf
    most: float = math.inf

    def __str__(self) -> str:
        texts = [f"above {self.above:g}"] if self.above > -math.inf else []
        texts += [f"at most {self.most:g}"] if self.most < math.inf else []
        return " " + " and ".join(texts) if texts else ""


def check_value(path: Path, name: str, value: Any, kind: Any, *, error: type[DoppelgaitError]) -> None:
    """Check the annotated type of a value, and its limits."""
    members = get_args(kind) if get_origin(kind) in (Union, UnionType) else (kind,)
    if any(_is_of_type(value, member) for member in members):
        return
    limits = {base: str(limit) for base, limit in (get_args(m) for m in members if get_origin(m) is Annotated)}
    words = [f"{text}{limits.get(base, '')}" for base, text in WORDS.items() if base in (*members, *limits)]
    words += [repr(choice) for member in members if get_origin(member) is Literal for choice in get_args(member)]
    raise error(f"{path}: {name} = {repr(value)[:80]} is not allowed; it must be {' or '.join(words) or kind}")


def _is_of_type(value: Any, kind: Any) -> bool:
    """Return whether a value has a type; of types that are not understood, every value has."""
    if get_origin(kind) is Annotated:
        base, limits = get_args(kind)
        return _is_of_type(value, base) and math.isfinite(value) and limits.above < value <= limits.most
    if kind in (int, float):
        return isinstance(value, Integral if kind is int else Real) and not isinstance(value, bool)
    if get_origin(kind) is Literal:
        return value in get_args(kind)
    return kind in (Any, inspect.Parameter.empty) or not isinstance(kind, type) or isinstance(value, kind)
