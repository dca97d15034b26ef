"""Damaged copies of a recording, and what its reader makes of them."""

import warnings

import numpy as np

from doppelgait.core.errors import DoppelgaitWarning, RecordingError


def mutate(whole: bytes, rng: np.random.Generator, *, start: int = 0) -> bytes:
    """The bytes, cut off, with one changed, or with some cut out; nothing before byte ``start`` is touched."""
    at = int(rng.integers(start, len(whole)))
    kind = int(rng.integers(3))
    if kind == 0:
        return whole[:at]
    if kind == 1:
        return whole[:at] + bytes([int(rng.integers(256))]) + whole[at + 1 :]
    return whole[:at] + whole[at + int(rng.integers(1, 40)) :]


def outcomes(reader, path, whole: bytes, *, count: int, seed: int, start: int = 0) -> tuple[int, int]:
    """How many damaged copies were read and how many refused; any other error passes through."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(count):
        path.write_bytes(mutate(whole, rng, start=start))
        found.append(read_or_refusal(reader, path))
    refusals = [text for text in found if isinstance(text, str)]
    assert all(str(path.parent) in text for text in refusals)
    for recording in (one for one in found if not isinstance(one, str)):
        assert np.isfinite(recording.baseband.values).all()
        assert (np.diff(recording.baseband.slow_time.values) > 0).all()
    return count - len(refusals), len(refusals)


def read_or_refusal(reader, path):
    """The recording, or the text of the RecordingError."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DoppelgaitWarning)
        try:
            return reader(path)
        except RecordingError as error:
            return str(error)
