"""Random streams for every (seed, example, purpose), none of which changes another."""

from __future__ import annotations

import operator
import zlib
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from doppelgait.core.errors import ConfigError

PURPOSES = ("plan", "motion", "scene", "noise", "gate", "impairments", "split", "batches")
"""Purposes of the streams. The index in this tuple is part of the stream's key, so new purposes are appended."""


@dataclass(frozen=True)
class Streams:
    """Random streams of one example, independent of each other.

    Parameters
    ----------
    seed : int
        Root of all streams, 0 or larger: ``seed`` of a scene file or ``--seed`` of the command line.
    example : int
        Number of the example in a dataset, 0 or larger.

    Raises
    ------
    ConfigError
        If the seed or the example is not an integer, or below 0.

    Examples
    --------
    >>> from doppelgait.core.rng import Streams
    >>> first, again = Streams(2018).generator("noise"), Streams(2018).generator("noise")
    >>> bool(first.integers(100) == again.integers(100))
    True
    """

    seed: int
    example: int = 0

    def __post_init__(self) -> None:
        for name in ("seed", "example"):
            value = getattr(self, name)
            try:
                number = operator.index(value)
            except TypeError:
                number = -1
            if number < 0:
                raise ConfigError(f"{name}: {value!r} is not allowed; it must be an integer, 0 or larger")
            object.__setattr__(self, name, number)

    def generator(self, purpose: str, key: str = "") -> np.random.Generator:
        """Make the generator of a purpose, one of :data:`PURPOSES`, independent of all others.

        ``key`` is a further name, such as the key of a parameter: a new one leaves other draws unchanged.
        """
        name = [zlib.crc32(key.encode())] if key else []
        sequence = np.random.SeedSequence(self.seed, spawn_key=(PURPOSES.index(purpose), self.example, *name))
        return np.random.Generator(np.random.PCG64(sequence))


def rng(seed: int) -> Streams:
    """Make the :class:`Streams` of a single run, those of ``seed`` in a scene file and of ``--seed``.

    Examples
    --------
    >>> import doppelgait as dg
    >>> dg.rng(1).generator("noise").normal() == dg.rng(1).generator("noise").normal()
    True
    """
    return Streams(seed)


RandomSource: TypeAlias = "Streams | np.random.Generator"
"""Source of random numbers: streams, or a generator that is continued."""


def as_generator(source: RandomSource, purpose: str) -> np.random.Generator:
    """Return the generator of a purpose; a generator is returned unchanged."""
    return source.generator(purpose) if isinstance(source, Streams) else source


def draw_key(rng: np.random.Generator) -> int:
    """Draw the key of one receiver noise (E-18)."""
    return int(rng.integers(0, 2**64, dtype=np.uint64))
