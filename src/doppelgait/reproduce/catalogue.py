"""All figures and tables that are made again, in the order of the report, and picking some by number."""

from __future__ import annotations

import pkgutil
import re
from collections.abc import Sequence
from difflib import get_close_matches
from importlib import import_module

from doppelgait.core.errors import ConfigError
from doppelgait.reproduce.entry import Entry

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
