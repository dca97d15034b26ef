"""Errors and the warning of doppelgait."""

from __future__ import annotations

import os
import sys
import warnings
from pathlib import Path
from typing import Any

_PACKAGE = str(Path(__file__).parents[1]) + os.sep

MAX_TEXT = 2000
"""Maximum number of characters of an error message. The middle of a longer message is left out."""


class DoppelgaitError(Exception):
    """Base of every error raised on purpose: what is wrong, what is allowed and what to do."""

    exit_code = 2
    """Exit status of the command line: 2 for wrong usage or input, 1 for a failed operation."""

    def __init__(self, text: object = "") -> None:
        said = str(text)  # it may quote a file with arbitrary content
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
    """Result that cannot be written; an existing file stays unchanged."""

    exit_code = 1


class DoppelgaitWarning(UserWarning):
    """Warning about a result that may be unexpected, such as aliasing or dropped markers."""


def warn_caller(text: str) -> None:
    """Issue a :class:`DoppelgaitWarning` at the line that called doppelgait."""
    frame, level = sys._getframe(1), 2
    while frame.f_back is not None and frame.f_code.co_filename.startswith(_PACKAGE):
        frame, level = frame.f_back, level + 1
    warnings.warn(text, DoppelgaitWarning, stacklevel=level)
