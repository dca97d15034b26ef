"""Errors and the warning of doppelgait."""

from __future__ import annotations

import difflib
import os
import re
import sys
import warnings
from collections.abc import Callable, Iterable
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")

_PACKAGE = str(Path(__file__).parents[1]) + os.sep

MAX_TEXT = 2000
"""Maximum number of characters of an error message. The middle of a longer message is left out."""
CONTROLS = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u200b-\u200f\u2028-\u202e\u2060-\u2069\ud800-\udfff]")
"""Characters of files that steer a terminal or change the order of a text, and half characters."""


def escape_controls(text: object) -> str:
    """Return a text with control characters, but tabs and ends of lines, as Python writes them."""
    return CONTROLS.sub(lambda found: found[0].encode("unicode_escape").decode(), str(text))


def list_choices(known: Iterable[str], name: object) -> str:
    """List known names, and the one that a wrong name nearly is, in any case of letters."""
    names = [*known]
    folded = {each.lower(): each for each in names}
    near = difflib.get_close_matches(str(name).lower(), folded, n=1)
    return ", ".join(names) + (f"; did you mean {folded[near[0]]}?" if near else "")


class DoppelgaitError(Exception):
    """Base of every error raised on purpose: what is wrong, what is allowed and what to do."""

    exit_code = 2
    """Exit status of the command line: 2 for wrong usage or input, 1 for a failed operation."""

    def __init__(self, text: object = "") -> None:
        said = escape_controls(text)  # it may quote a file with arbitrary content
        super().__init__(said if len(said) <= MAX_TEXT else f"{said[: MAX_TEXT - 500]} [...] {said[-400:]}")


class ConfigError(DoppelgaitError):
    """Parameter, configuration key or combination that is not allowed."""

    faults: tuple[Any, ...] = ()
    """Faults of a table, one per key (:class:`doppelgait.core.config.Fault`)."""


class MotionError(DoppelgaitError):
    """Motion recording that is unreadable or unusable as a target."""


class RecordingError(DoppelgaitError):
    """Radar recording that cannot be read or written."""


class AnalysisError(DoppelgaitError):
    """Recording that cannot be analysed with these settings."""


class DatasetError(DoppelgaitError):
    """Dataset that cannot be planned, built, opened or extended."""


class OutputError(DoppelgaitError):
    """Result that cannot be computed in memory or written; an existing file stays unchanged."""

    exit_code = 1


def explain_memory(function: Callable[P, T]) -> Callable[P, T]:
    """Turn a lack of memory into one sentence: a decorator of outermost functions."""

    @wraps(function)
    def run(*values: P.args, **options: P.kwargs) -> T:
        try:
            return function(*values, **options)
        except MemoryError as error:
            reason = str(error)[:200] or "no memory is left"
            raise OutputError(f"this computer does not have enough memory: {reason}") from None

    return run


class DoppelgaitWarning(UserWarning):
    """Warning about a result that may be unexpected, such as aliasing or dropped markers."""


def warn_caller(text: str) -> None:
    """Issue a :class:`DoppelgaitWarning` at the line that called doppelgait."""
    frame, level = sys._getframe(1), 2
    while frame.f_back is not None and frame.f_code.co_filename.startswith(_PACKAGE):
        frame, level = frame.f_back, level + 1
    warnings.warn(escape_controls(text), DoppelgaitWarning, stacklevel=level)
