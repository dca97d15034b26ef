"""How commands speak: JSON, tables, progress, warnings and errors."""

from __future__ import annotations

import json
import re
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from doppelgait.core.errors import ConfigError, DoppelgaitWarning, RecordingError

ASKS = re.compile(r"\bgive (?!a |one )|name it,|(?=\b[a-z_]+ must be given)")
"""Where a reader's message begins to ask for options: ``give subsweep=0 to 3``, ``give carrier_hz``."""
WANTED = re.compile(r"\b(?P<name>[a-z][a-z_]*) ?= ?(?P<value>'[^']*'|\.\.\.|\w+)|\b(?P<bare>[a-z]+(?:_[a-z]+)+)")


def print_json(document: Any) -> None:
    """One JSON document on standard output."""
    print(json.dumps(document, indent=2, allow_nan=False))


def say(text: str) -> None:
    """A line for people, on standard error."""
    print(text, file=sys.stderr)


def print_table(rows: Sequence[Mapping[str, Any]]) -> None:
    """Aligned table on standard output; columns in the order of the first row."""
    if not rows:
        return
    names = list(rows[0])
    cells = [names, *[["" if row.get(n) is None else str(row.get(n)) for n in names] for row in rows]]
    widths = [max(len(line[i]) for line in cells) for i in range(len(names))]
    for line in cells:
        print("  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip())


def number(value: float | None, digits: int = 3) -> str:
    """A number for people; ``-`` for None."""
    return "-" if value is None else f"{value:.{digits}g}" if abs(value) >= 1e4 else f"{value:.{digits}f}"


@contextmanager
def reader_options() -> Iterator[None]:
    """Errors of a reader that ask for an option, with how this is given to a command."""
    try:
        yield
    except RecordingError as error:
        text = str(error)
        asks = ASKS.search(text)
        wanted = dict.fromkeys(_as_option(match) for match in WANTED.finditer(text, asks.end())) if asks else {}
        if not wanted:
            raise
        raise RecordingError(f"{text}; here: {' '.join(wanted)}") from None


def _as_option(match: re.Match[str]) -> str:
    value = (match["value"] or "...").strip("'")
    return f"--option {match['name'] or match['bare']}={value}"


def show_warnings_plainly() -> None:
    """Warnings of doppelgait as one line each, said once, without file and line of the source."""
    usual = warnings.showwarning
    said: set[str] = set()

    def show(message: Any, category: Any, *rest: Any, **more: Any) -> None:
        if isinstance(category, type) and issubclass(category, DoppelgaitWarning):
            if str(message) not in said:
                said.add(str(message))
                say(f"warning: {message}")
        else:
            usual(message, category, *rest, **more)

    warnings.showwarning = show
    warnings.simplefilter("always", DoppelgaitWarning)


@contextmanager
def progress(what: str, *, quiet: bool = False) -> Iterator[Callable[[int, int], None] | None]:
    """Progress of long work as ``on_progress(done, total)``: a bar on a terminal, plain lines elsewhere."""
    if quiet:
        yield None
    elif sys.stderr.isatty():
        with _bar(what) as advance:
            yield advance
    else:
        yield _lines(what)


@contextmanager
def _bar(what: str) -> Iterator[Callable[[int, int], None]]:
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(),
    )
    began = time.monotonic()
    with Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task(what, total=None, rate="")

        def advance(done: int, total: int) -> None:
            rate = done / max(time.monotonic() - began, 1e-9)
            bar.update(task, completed=done, total=total, rate=f"{rate:.1f}/s")

        yield advance


def _lines(what: str) -> Callable[[int, int], None]:
    began = time.monotonic()
    last_tenth = 0

    def advance(done: int, total: int) -> None:
        nonlocal last_tenth
        tenth = 10 * done // max(total, 1)
        if tenth == last_tenth:
            return
        last_tenth = tenth
        seconds = time.monotonic() - began
        left = seconds / done * (total - done)
        say(f"{what}: {done} of {total}, {done / max(seconds, 1e-9):.1f} per second, {left:.0f} s left")

    return advance


def duration_text(seconds: float) -> str:
    """A time for people: seconds, minutes or hours."""
    for unit, length in (("h", 3600.0), ("min", 60.0)):
        if seconds >= 2 * length:
            return f"{seconds / length:.1f} {unit}"
    return f"{seconds:.0f} s"


def check_output(path: Path, suffix: str) -> Path:
    """Path of a file to write; wrong ending or missing folder is an error before any work is done."""
    if path.suffix.lower() != suffix:
        raise ConfigError(f"-o {path}: must end in {suffix}")
    if not path.resolve().parent.is_dir():
        raise ConfigError(f"-o {path}: the folder {path.parent} does not exist; make it first")
    return path
