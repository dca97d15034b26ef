"""Recorded motions, each read once a process and without its warnings."""

import warnings
from functools import cache
from pathlib import Path
from typing import Any

from doppelgait.core.errors import DoppelgaitWarning
from doppelgait.motion import Motion
from doppelgait.motion.readers import read


@cache
def read_quietly(path: Path, **options: Any) -> Motion:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DoppelgaitWarning)
        return read(path, **options)
