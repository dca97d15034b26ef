"""Output of commands: JSON, tables, progress, errors."""

from __future__ import annotations

import json
import re
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from enum import StrEnum
from functools import lru_cache
from pathlib import Path
from threading import Timer
from time import monotonic
from typing import Annotated, Any

import typer

from doppelgait.core.errors import ConfigError, DoppelgaitWarning, OutputError, RecordingError, escape_controls
from doppelgait.core.interrupt import raise_if_stopped, stop_in_order

ASKS = re.compile(r"\bgive (?!a |one )|; set (?=[a-z]+_)|name it,|(?=\b[a-z_]+ must be given)")
"""Start of the text in a reader's error that names missing options: ``give subsweep=0 to 3``, ``give carrier_hz``."""
EXPLAINED = re.compile(r" \((?!and )[^()]*\)")
"""Remark on the value of an option; it may name other quantities."""
PROGRESS_DELAY_S = 1.0
"""Minimum duration, s, of work for which progress is shown."""
WANTED = re.compile(r"\b(?P<name>[a-z][a-z_]*) ?= ?(?P<value>'[^']*'|\.\.\.|\w+)|\b(?P<bare>[a-z]+(?:_[a-z]+)+)")


def print_json(document: Any) -> None:
    """Print one JSON document on standard output."""
    print(json.dumps(document, indent=2, allow_nan=False))


def print_text(text: str = "", end: str = "\n") -> None:
    """Print text on standard output; control characters that it quotes from files are escaped."""
    print(escape_controls(text), end=end)


def print_message(text: str) -> None:
    """Print a status line on standard error; threads do not mix their lines."""
    print(f"{escape_controls(text)}\n", end="", file=sys.stderr)


print_warning = lru_cache(1000)(lambda text: print_message(f"warning: {text}"))  # each once


def print_table(rows: Sequence[Mapping[str, Any]]) -> None:
    """Print an aligned table on standard output."""
    if not rows:
        return
    names = list(rows[0])
    texts = [names, *[["" if row.get(n) is None else str(row.get(n)) for n in names] for row in rows]]
    cells = [[escape_controls(text).replace("\n", "\\n") for text in line] for line in texts]
    widths = [max(len(line[i]) for line in cells) for i in range(len(names))]
    for line in cells:
        print_text("  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip())


def print_tables(tables: Sequence[Sequence[Mapping[str, Any]]]) -> None:
    """Print tables with an empty line between them."""
    for number, rows in enumerate(filter(None, tables)):
        if number:
            print_text()
        print_table(rows)


def format_number(value: float | None, digits: int = 3) -> str:
    """Format a number for a table; ``-`` for None."""
    return "-" if value is None else f"{value:.{digits}g}" if abs(value) >= 1e4 else f"{value:.{digits}f}"


@contextmanager
def explain_reader_options() -> Iterator[None]:
    """Extend a reader's error with needed command-line options."""
    try:
        yield
    except RecordingError as error:
        text = re.sub(r"(?<=\w)\.$", "", str(error))
        plain = EXPLAINED.sub("", text)
        asks = ASKS.search(plain)
        wanted: dict[str, None] = {}
        for match in WANTED.finditer(plain, asks.end()) if asks else ():
            value = (match["value"] or "...").strip("'")
            wanted[f"--option {match['name'] or match['bare']}={value}"] = None
        if not wanted:
            raise
        raise RecordingError(f"{text}; here: {' '.join(wanted)}") from None


def show_warnings_plainly() -> None:
    """Print each warning of doppelgait once, on one line."""
    usual = warnings.showwarning

    def show(message: Any, category: Any, *rest: Any, **more: Any) -> None:
        if isinstance(category, type) and issubclass(category, DoppelgaitWarning):
            print_warning(str(message))
        else:
            usual(message, category, *rest, **more)

    warnings.showwarning = show
    warnings.simplefilter("always", DoppelgaitWarning)


@contextmanager
def report_progress(what: str, *, quiet: bool = False) -> Iterator[Callable[[int, int], None]]:
    """Report long work as ``on_progress(done, total)``: a bar on a terminal, otherwise lines."""
    lines = _report_tenths(what) if not sys.stderr.isatty() else _show_bar(what)
    with stop_in_order(), nullcontext(None) if quiet else lines as report:

        def on_progress(done: int, total: int) -> None:
            raise_if_stopped()
            if report is not None:
                report(done, total)

        yield on_progress


@contextmanager
def _report_tenths(what: str) -> Iterator[Callable[[int, int], None]]:
    began, last_tenth = monotonic(), 0

    def print_tenth(done: int, total: int) -> None:
        nonlocal last_tenth
        tenth = 10 * done // max(total, 1)
        seconds = monotonic() - began
        if tenth == last_tenth or seconds < PROGRESS_DELAY_S:
            return
        last_tenth = tenth
        left = seconds / done * (total - done)
        print_message(f"{what}: {done} of {total}, {done / max(seconds, 1e-9):.1f} per second, {left:.0f} s left")

    yield print_tenth


@contextmanager
def _show_bar(what: str) -> Iterator[Callable[[int, int], None]]:
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(),
    )
    began = monotonic()
    bar = Progress(*columns, console=Console(stderr=True))
    task = bar.add_task(what, total=None, rate="")

    def advance(done: int, total: int) -> None:
        rate = done / max(monotonic() - began, 1e-9)
        bar.update(task, completed=done, total=total, rate=f"{rate:.1f}/s")

    timer = Timer(PROGRESS_DELAY_S, bar.start)  # the first report can take a long time
    timer.daemon = True
    timer.start()
    try:
        yield advance
    finally:
        timer.cancel()
        timer.join()
        if bar.live.is_started:
            bar.stop()


def format_duration(seconds: float) -> str:
    """Format a duration in seconds, minutes or hours."""
    for unit, length in (("h", 3600.0), ("min", 60.0)):
        if seconds >= 2 * length:
            return f"{seconds / length:.1f} {unit}"
    return f"{seconds:.0f} s"


FigureFormat = StrEnum("FigureFormat", ["png", "svg", "pdf"])
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]
FigureOption = Annotated[FigureFormat, typer.Option("--format", help="Format of the figures.")]
PageFigureOption = Annotated[FigureFormat, typer.Option("--format", help="Further format of the figures.")]


def make_folder(folder: Path, name: str = "") -> None:
    """Make a folder for output; ``name`` is its option for the message."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{name}{folder}: cannot be created: {error}") from None


def check_output(path: Path, *suffixes: str, option: str = "-o") -> Path:
    """Return the path of a writable file."""
    if path.suffix.lower() not in suffixes:
        raise ConfigError(f"{option} {path}: must end in {' or '.join(suffixes)}")
    if not path.resolve().parent.is_dir():
        raise ConfigError(f"{option} {path}: the folder {path.parent} does not exist; make it first")
    return path
