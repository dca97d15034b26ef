"""Random streams: one for every (seed, example, purpose), so that no draw shifts another."""

from __future__ import annotations

import operator
import zlib

import numpy as np

from doppelgait.core.errors import ConfigError

PURPOSES = ("plan", "motion", "scene", "noise", "gate", "impairments", "split")
"""What streams are for. The position in this tuple is part of the stream's key: append only."""


def rng(seed: int) -> np.random.Generator:
    """Generator for a single run, from an integer seed (0 or larger).

    Raises
    ------
    ConfigError
        If the seed is no integer or below 0.
    """
    try:
        number = operator.index(seed)
    except TypeError:
        number = -1
    if number < 0:
        raise ConfigError(f"seed: {seed!r} is not allowed; it must be an integer, 0 or larger")
    return np.random.default_rng(number)


def generator_for(root_seed: int, purpose: str, index: int, key: str = "") -> np.random.Generator:
    """Independent generator of one purpose of one example.

    Parameters
    ----------
    root_seed : int
        Seed of the whole dataset, 0 or larger.
    purpose : str
        One of :data:`PURPOSES`.
    index : int
        Number of the example, 0 or larger.
    key : str
        Further name, such as the dotted key of a drawn parameter: adding a parameter then shifts no other.

    Returns
    -------
    numpy.random.Generator
        The same stream for the same values, whatever else was drawn before or in whichever process.
    """
    name = (zlib.crc32(key.encode()),) if key else ()
    spawn_key = (PURPOSES.index(purpose), index, *name)
    return np.random.default_rng(np.random.SeedSequence(root_seed, spawn_key=spawn_key))
