"""Entries of the reproduction: what the report states, what is read, the verdict and the outcome."""

from __future__ import annotations

import math
import pkgutil
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from importlib import import_module
from typing import TYPE_CHECKING, Any

from doppelgait.core.errors import ConfigError

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from doppelgait.reproduce.material import Material

KINDS = ("agrees", "set", "differs", "not stated")
"""What a number may be beside the report's: within its tolerance; set here as the report has it; outside; or nothing
to compare it with."""


@dataclass(frozen=True)
class Reading:
    """One number read off what was made.

    Attributes
    ----------
    name : str
        The quantity, in words.
    ours : float
        What is measured here; NaN if it could not be measured.
    unit : str
        "Hz", "m/s", ...; "1" for pure numbers.
    stated : float, optional
        What the report states; None where it states no number.
    tolerance : float, optional
        How far ``ours`` may lie from ``stated`` and still agree, absolute, in ``unit``. It comes from how exactly the
        report states the number (a value printed, a value read off an axis), not from what is measured here. Exact
        agreement is asked for by None.
    note : str
        Why they differ, or where the number comes from.
    given : bool
        Set as the report has it, or a fact of the model that stands in: that it is as stated shows nothing, so it never
        counts as agreeing. It still differs where it is not as stated.
    """

    name: str
    ours: float
    unit: str
    stated: float | None = None
    tolerance: float | None = None
    note: str = ""
    given: bool = False

    @property
    def kind(self) -> str:
        """One of `KINDS`."""
        if self.stated is None:
            return "not stated"
        if not abs(self.ours - self.stated) <= (self.tolerance or 0.0):
            return "differs"
        return "set" if self.given else "agrees"

    @property
    def agrees(self) -> bool | None:
        """Whether the number lies within the tolerance; None where the report states none or the number was set."""
        return {"agrees": True, "differs": False}.get(self.kind)


def verdict(readings: Sequence[Reading]) -> str:
    """What the readings say of an entry as a whole, in words that begin a judgement.

    Returns
    -------
    str
        "Agrees" if every number compared with the report does, "Differs in part" or "Differs" if some or all do not;
        "Set as stated" if all that the report states was set here, "Not compared" if it states no number.
    """
    kinds = {reading.kind for reading in readings}
    if "differs" in kinds:
        return "Differs in part" if "agrees" in kinds else "Differs"
    if "agrees" in kinds:
        return "Agrees"
    return "Set as stated" if "set" in kinds else "Not compared"


def judged(readings: Sequence[Reading], text: str) -> str:
    """A judgement that begins with the verdict on the readings and names those that differ."""
    differing = [reading.name for reading in readings if reading.kind == "differs"]
    return f"{'Differs in: ' + '; '.join(differing) + '. ' if differing else verdict(readings) + ': '}{text}"


@dataclass(frozen=True)
class Made:
    """What making an entry gives.

    Attributes
    ----------
    figure : Figure, optional
        Drawing of the entry; None for a table.
    readings : sequence of Reading
    judgement : str
        One to three sentences: it agrees, or why it does not.
    table : DataFrame, optional
        Table shown on the page beside or instead of the figure.
    """

    figure: Figure | None
    readings: Sequence[Reading]
    judgement: str
    table: pd.DataFrame | None = None


@dataclass(frozen=True)
class Entry:
    """A figure or table of the report.

    Attributes
    ----------
    number : str
        As in the report: "fig-4.13", "table-3.2".
    title : str
        What it shows, in our words.
    stated : str
        What the report says about it, in our words.
    make : callable
        Makes it from the material of the run.
    """

    number: str
    title: str
    stated: str
    make: Callable[[Material], Made]


@dataclass(frozen=True)
class Outcome:
    """An entry after its making.

    Attributes
    ----------
    entry : Entry
    made : Made, optional
        None if it could not be made; ``error`` says why.
    used : sequence of str
        Movers it was made from: "model: ..." or "recording: ...".
    remarks : sequence of str
        Warnings while it was made.
    seconds : float
        Time it took, drawing among it; what is shared counts for the first that needs it.
    error : str
    """

    entry: Entry
    made: Made | None
    used: Sequence[str] = ()
    remarks: Sequence[str] = ()
    seconds: float = 0.0
    error: str = ""

    @property
    def readings(self) -> Sequence[Reading]:
        """Numbers read, none if it could not be made."""
        return self.made.readings if self.made else ()

    def count_kind(self, kind: str) -> int:
        """Readings of one of `KINDS`."""
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
        """Everything but the figure and the table, for JSON; NaN is None."""
        return {
            "number": self.entry.number,
            "title": self.entry.title,
            "stated": self.entry.stated,
            "made": self.made is not None,
            "error": self.error or None,
            "made_from": list(self.used),
            "readings": [_reading_as_dict(reading) for reading in self.readings],
            "judgement": self.made.judgement if self.made else None,
            "remarks": list(self.remarks),
            "seconds": round(self.seconds, 3),
            "figure": self.figure_path,
            "table": self.table_path,
        }


def _reading_as_dict(reading: Reading) -> dict[str, Any]:
    plain = {name: _finite(value) for name, value in vars(reading).items()}
    return {**plain, "agrees": reading.agrees, "kind": reading.kind}


def _finite(value: str | float | None) -> str | float | None:
    """Texts and truths as they are, numbers as plain floats, what is no finite number as None."""
    if value is None or isinstance(value, (str, bool)):
        return value
    return float(value) if math.isfinite(value) else None


CHAPTERS = re.compile(r"(chapter\d|appendix)")
"""Modules of this package that hold entries, by the start of their names; each has a tuple ``ENTRIES``."""


def all_entries() -> tuple[Entry, ...]:
    """Every entry, chapter by chapter; within a chapter figures come first, then tables."""
    package = import_module("doppelgait.reproduce")
    names = sorted(module.name for module in pkgutil.iter_modules(package.__path__) if CHAPTERS.match(module.name))
    found: list[Entry] = []
    for name in names:
        found += getattr(import_module(f"doppelgait.reproduce.{name}"), "ENTRIES", ())
    return tuple(sorted(found, key=lambda entry: place_of(entry.number)))


def place_of(number: str) -> tuple[int, str, int]:
    """Place in the report of an entry's number: chapter, kind and number in the chapter; appendices come last."""
    kind, _, rest = number.partition("-")
    chapter, _, within = rest.partition(".")
    return int(chapter) if chapter.isdigit() else 100 + ord(chapter), kind, int(within)


def pick(entries: Sequence[Entry], only: Sequence[str]) -> tuple[Entry, ...]:
    """The entries of these numbers, in the order of the report; all if none is given.

    Raises
    ------
    ConfigError
        If a number is not known; the message names the nearest ones.
    """
    by_number = {entry.number: entry for entry in entries}
    for number in only:
        if number not in by_number:
            near = get_close_matches(number, by_number, n=3, cutoff=0.0)
            raise ConfigError(
                f"--only {number}: is not among the {len(by_number)} figures and tables that are made; nearest are "
                f"{', '.join(near)} (write fig-4.13 or table-3.2)"
            )
    return tuple(entry for entry in entries if not only or entry.number in only)
