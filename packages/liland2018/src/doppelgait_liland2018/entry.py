"""Entries of the reproduction: statements, readings, verdict and outcome."""

from __future__ import annotations

import math
import pkgutil
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from importlib import import_module
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from doppelgait import ConfigError
from doppelgait_liland2018.material import Material

KINDS = ("agrees", "set", "differs", "not stated")
"""Kinds of a reading: within the tolerance of the report's number; set as the report has it; outside; nothing to
compare."""


@dataclass(frozen=True)
class Reading:
    """One number measured in a reproduced entry."""

    name: str
    ours: float
    unit: str
    stated: float | None = None
    tolerance: float | None = None
    note: str = ""
    fixed: bool = False

    @property
    def kind(self) -> str:
        """One of `KINDS`."""
        if self.stated is None:
            return "not stated"
        if not abs(self.ours - self.stated) <= (self.tolerance or 0.0):
            return "differs"
        return "set" if self.fixed else "agrees"

    @property
    def agrees(self) -> bool | None:
        """True within tolerance; None without both numbers."""
        return {"agrees": True, "differs": False}.get(self.kind)


def compare_statement(words: str, holds: bool | np.bool_, *, note: str = "", fixed: bool = False) -> Reading:
    """Compare a statement of the report, without a number, with what is measured."""
    return Reading(f"{words} (1: yes)", float(holds), "1", 1.0, note=note, fixed=fixed)


def summarise_readings(readings: Sequence[Reading]) -> str:
    """Summarise the readings of an entry in words."""
    kinds = {reading.kind for reading in readings}
    if "differs" in kinds:
        return "Differs in part" if "agrees" in kinds else "Differs"
    if "agrees" in kinds:
        return "Agrees"
    return "Set as stated" if "set" in kinds else "Not compared"


def format_judgement(readings: Sequence[Reading], text: str) -> str:
    """Format a judgement with verdict and differences."""
    differing = [reading.name for reading in readings if reading.kind == "differs"]
    return f"{'Differs in: ' + '; '.join(differing) + '. ' if differing else summarise_readings(readings) + ': '}{text}"


@dataclass(frozen=True)
class EntryResult:
    """Figure, readings and judgement of an entry."""

    figure: Figure | None
    readings: Sequence[Reading]
    judgement: str
    table: pd.DataFrame | None = None


Make = Callable[["Material"], EntryResult]


@dataclass(frozen=True)
class Entry:
    """A figure or table of the report."""

    number: str
    title: str
    stated: str
    make: Make


ENTRIES: dict[str, Entry] = {}
"""Entries of the imported chapters by number."""


def entry(number: str, title: str, stated: str) -> Callable[[Make], Make]:
    """Register the function that makes a figure or table, with what the report states of it."""

    def register(make: Make) -> Make:
        ENTRIES[number] = Entry(number, title, stated, make)
        return make

    return register


def judge(
    figure: Figure | None, readings: Sequence[Reading], text: str, table: pd.DataFrame | None = None
) -> EntryResult:
    """Make the result of an entry with its judgement."""
    return EntryResult(figure, readings, format_judgement(readings, text), table)


STORED_NAMES = {"fixed": "given"}
"""Names in ``readings.json`` that differ from those of :class:`Reading`."""


@dataclass(frozen=True)
class Outcome:
    """An entry with its outcome."""

    entry: Entry
    made: EntryResult | None
    used: Sequence[str] = ()
    remarks: Sequence[str] = ()
    seconds: float = 0.0
    error: str = ""

    @property
    def readings(self) -> Sequence[Reading]:
        """Readings of the entry, empty if it failed."""
        return self.made.readings if self.made else ()

    def count_kind(self, kind: str) -> int:
        """Count the readings of one of `KINDS`."""
        return sum(reading.kind == kind for reading in self.readings)

    @property
    def figure_path(self) -> str | None:
        """Path of the figure in the output folder."""
        return f"figures/{self.entry.number}.png" if self.made and self.made.figure is not None else None

    @property
    def table_path(self) -> str | None:
        """Path of the table in the output folder."""
        return f"tables/{self.entry.number}.csv" if self.made and self.made.table is not None else None

    def as_dict(self) -> dict[str, Any]:
        """Return all but figure and table for JSON."""
        return {
            "number": self.entry.number,
            "title": self.entry.title,
            "stated": self.entry.stated,
            "made": self.made is not None,
            "error": self.error or None,
            "made_from": list(self.used),
            "readings": [
                {
                    **{STORED_NAMES.get(name, name): _convert_finite(value) for name, value in vars(one).items()},
                    "agrees": one.agrees,
                    "kind": one.kind,
                }
                for one in self.readings
            ],
            "judgement": self.made.judgement if self.made else None,
            "remarks": list(self.remarks),
            "seconds": round(self.seconds, 3),
            "figure": self.figure_path,
            "table": self.table_path,
        }


def _convert_finite(value: str | float | None) -> str | float | None:
    """Convert to a float, None if not finite."""
    if value is None or isinstance(value, (str, bool)):
        return value
    return float(value) if math.isfinite(value) else None


CHAPTERS = re.compile(r"(chapter\d|appendix)")
"""Modules of this package that hold entries, by the start of their names."""


def collect_entries() -> tuple[Entry, ...]:
    """Return every entry, chapter by chapter, figures before tables."""
    package = import_module("doppelgait_liland2018")
    names = sorted(module.name for module in pkgutil.iter_modules(package.__path__) if CHAPTERS.match(module.name))
    for name in names:
        import_module(f"doppelgait_liland2018.{name}")
    return tuple(sorted(ENTRIES.values(), key=lambda entry: place_of(entry.number)))


def place_of(number: str) -> tuple[int, str, int]:
    """Return a number's sort key: chapter, kind, position."""
    kind, _, rest = number.partition("-")
    chapter, _, within = rest.partition(".")
    return int(chapter) if chapter.isdigit() else 100 + ord(chapter), kind, int(within)


def pick(entries: Sequence[Entry], only: Sequence[str]) -> tuple[Entry, ...]:
    """Select entries by number, in report order."""
    by_number = {entry.number: entry for entry in entries}
    for number in only:
        if number not in by_number:
            near = get_close_matches(number, by_number, n=3, cutoff=0.0)
            raise ConfigError(
                f"--only {number}: is not among the {len(by_number)} figures and tables that are made; nearest are "
                f"{', '.join(near)} (write fig-4.13 or table-3.2)"
            )
    return tuple(entry for entry in entries if not only or entry.number in only)
