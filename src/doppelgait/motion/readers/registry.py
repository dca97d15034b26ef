"""How a motion reader is declared, and the one ``read`` that picks it by content."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from doppelgait.core.registry import Registry
from doppelgait.motion.motion import Motion


@dataclass(frozen=True)
class MotionReader:
    """A motion file format.

    Parameters
    ----------
    sniff : callable
        ``sniff(path, head) -> bool``: does this file look like the format? ``head`` is its first 4096 bytes.
    read : callable
        ``read(path, **options) -> motion`` with every physical marker in metres, z up, NaN for gaps.
    suffixes : tuple of str
        Usual endings, lower case, for error messages.
    """

    sniff: Callable[[Path, bytes], bool]
    read: Callable[..., Motion]
    suffixes: tuple[str, ...]


MOTION_READERS: Registry[MotionReader] = Registry("doppelgait.motion_readers", "motion reader")
"""Motion file formats by name."""

ReadOptions = dict[str, Any]
