"""Damaged copies of a file, and what a reader makes of them."""

import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from doppelgait.core.errors import DoppelgaitWarning, MotionError, RecordingError
from doppelgait.motion.readers import read


def mutate(whole: bytes, rng: np.random.Generator, *, start: int = 0) -> bytes:
    """The bytes, cut off, longer, shorter, or some changed to any value or to one that hurts; none before ``start``."""
    at, kind = int(rng.integers(start, len(whole))), int(rng.integers(5))
    if kind == 0:
        return whole[:at]
    if kind == 1:
        return whole[:at] + rng.bytes(int(rng.integers(1, 40))) + whole[at:]
    if kind == 2:
        return whole[:at] + whole[at + int(rng.integers(1, 40)) :]
    changed = bytearray(whole)
    for first in rng.integers(start, len(whole), int(rng.integers(1, 4))).tolist():
        new = rng.bytes(1) if kind == 3 else bytes([rng.choice([0, 1, 0x7F, 0x80, 0xFF])]) * int(rng.integers(1, 9))
        changed[first : first + len(new)] = new
    return bytes(changed)


def damaged_copies(path: Path, *, start: int, count: int, rng: np.random.Generator) -> Iterator[Path]:
    """A copy of the file that is damaged anew each time."""
    copy = path.with_name(f"damaged{path.suffix}")
    for _ in range(count):
        copy.write_bytes(mutate(path.read_bytes(), rng, start=start))
        yield copy


def read_or_refusal(reader: Callable[[Path], Any], path: Path, error: type[Exception]) -> tuple[Any, str]:
    """What is read, or the text of the error; anything else that is raised is a fault of the reader."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DoppelgaitWarning)
        try:
            return reader(path), ""
        except error as refusal:
            return None, str(refusal)


def check_damaged_copies(whole: Path, *, start: int, n_frames: range, count: int = 300, **options: Any) -> None:
    """Copies: each is a motion of so many frames or refused by its name, and both occur."""
    motions = 0
    for copy in damaged_copies(whole, start=start, count=count, rng=np.random.default_rng(1)):
        motion, refusal = read_or_refusal(lambda path: read(path, clean=False, **options), copy, MotionError)
        assert copy.name in refusal or (motion is not None and motion.n_frames in n_frames)
        motions += motion is not None
    assert 0 < motions < count


def outcomes(reader: Callable[[Path], Any], path: Path, *, count: int, seed: int) -> tuple[int, int]:
    """How many damaged recordings in the place of a good one were read and how many refused by their folder."""
    whole, rng, n_refused = path.read_bytes(), np.random.default_rng(seed), 0
    for _ in range(count):
        path.write_bytes(mutate(whole, rng))
        recording, refusal = read_or_refusal(reader, path, RecordingError)
        if recording is None:
            assert str(path.parent) in refusal
            n_refused += 1
        else:
            assert np.isfinite(recording.baseband.values).all()
            assert (np.diff(recording.baseband.slow_time.values) > 0).all()
    path.write_bytes(whole)
    return count - n_refused, n_refused
