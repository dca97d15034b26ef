"""Random streams, one for every (seed, example, purpose).

No draw shifts another.
"""

from __future__ import annotations

import operator
import zlib
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from doppelgait.core.errors import ConfigError

PURPOSES = ("plan", "motion", "scene", "noise", "gate", "impairments", "split", "batches")
"""Purposes of the streams. The position in this tuple is part of the stream's key: append only."""


@dataclass(frozen=True)
class Streams:
    """Random streams of one example, independent of each other.

    Parameters
    ----------
    seed : int
        Root of all streams, 0 or larger; as ``seed`` in a scene file and ``--seed`` of the command line.
    example : int
        Number of the example in a dataset, 0 or larger.

    Raises
    ------
    ConfigError
        If the seed or the example is no integer or below 0.

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
        """Make an independent generator for one purpose.

        Parameters
        ----------
        purpose : str
            One of :data:`PURPOSES`.
        key : str
            Further name, such as the dotted key of a parameter: adding a parameter then shifts no other.

        Returns
        -------
        numpy.random.Generator
            The same stream for the same values, whatever else was sampled before or in whichever process.
        """
        name = (zlib.crc32(key.encode()),) if key else ()
        spawn_key = (PURPOSES.index(purpose), self.example, *name)
        return np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=spawn_key))


def rng(seed: int) -> Streams:
    """Make the random streams of a single run.

    The bytes are the same as with ``seed`` in a scene file and ``--seed``.

    Raises
    ------
    ConfigError
        If the seed is no integer or below 0.

    Examples
    --------
    >>> import doppelgait as dg
    >>> dg.rng(1).generator("noise").normal() == dg.rng(1).generator("noise").normal()
    True
    """
    return Streams(seed)


RandomSource: TypeAlias = "Streams | np.random.Generator"
"""Source of random numbers of one purpose: streams, or a generator to continue."""


def as_generator(source: RandomSource, purpose: str) -> np.random.Generator:
    """Return the generator of a purpose.

    A generator is returned unchanged, to continue at its state.
    """
    return source.generator(purpose) if isinstance(source, Streams) else source
