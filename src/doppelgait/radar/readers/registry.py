"""How a recording format is declared: names of functions, looked up when they are first needed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from doppelgait.core.errors import ConfigError
from doppelgait.core.registry import Registry
from doppelgait.radar.recording import Recording


@dataclass(frozen=True)
class RecordingReader:
    """A format of radar recordings.

    Parameters
    ----------
    sniff : str
        ``"module:function"`` with ``function(path) -> bool``: does this file or folder look like the format? Cheap,
        by content; it is asked about everything, also about what does not exist.
    read : str
        ``"module:function"`` with ``function(path, **options) -> Recording``; its options are keyword-only.
    suffixes : tuple of str
        Usual endings, lower case, for error messages.
    """

    sniff: str
    read: str
    suffixes: tuple[str, ...]

    def matches(self, path: Path) -> bool:
        """Whether a file or folder looks like this format; what cannot be opened does not."""
        try:
            return bool(load_function(self.sniff)(path))
        except OSError:
            return False

    def reader(self) -> Callable[..., Recording]:
        """The function that reads."""
        return load_function(self.read)


RECORDING_READERS: Registry[RecordingReader] = Registry("doppelgait.recordings", "recording reader")
"""Recording formats by name."""


def load_function(reference: str) -> Callable[..., Any]:
    """Function named ``"module:function"``; one that does not exist is a :class:`ConfigError`."""
    module, _, name = reference.partition(":")
    try:
        function: Callable[..., Any] = getattr(import_module(module), name)
    except (ImportError, AttributeError, ValueError) as error:
        raise ConfigError(f"the recording reader {reference!r} cannot be loaded: {error}") from None
    return function
