"""Damaged copies of a file, and what a reader makes of them."""

import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import xarray as xr

from doppelgait.core.errors import DoppelgaitWarning, MotionError
from doppelgait.motion.readers import read


def damaged_copies(path: Path, *, start: int, count: int, rng: np.random.Generator) -> Iterator[Path]:
    """The file, cut off or with one byte changed, in turn; nothing before byte ``start`` is touched."""
    whole = path.read_bytes()
    copy = path.with_name(f"damaged{path.suffix}")
    for trial in range(count):
        at = int(rng.integers(start, len(whole)))
        copy.write_bytes(whole[:at] + (bytes([int(rng.integers(256))]) + whole[at + 1 :] if trial % 2 else b""))
        yield copy


def read_or_refusal(path: Path) -> tuple[xr.DataArray | None, str]:
    """The motion, or the text of the MotionError; anything else that is raised is a fault of the reader."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DoppelgaitWarning)
        try:
            return read(path, clean=False), ""
        except MotionError as error:
            return None, str(error)


def check_damaged_copies(whole: Path, *, start: int, n_frames: int) -> None:
    """300 copies: each is a motion of at most so many frames or refused by its name, and both occur."""
    motions = 0
    for copy in damaged_copies(whole, start=start, count=300, rng=np.random.default_rng(1)):
        motion, refusal = read_or_refusal(copy)
        assert copy.name in refusal or (motion is not None and motion.n_frames <= n_frames)
        motions += motion is not None
    assert 0 < motions < 300
