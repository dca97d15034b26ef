"""Parameters of a request: which are allowed, and what they may be."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence

from doppelgait.core.errors import ConfigError

Pairs = Sequence[tuple[str, str]]


def single(query: Pairs, allowed: Collection[str]) -> dict[str, str]:
    """Parameters by name, each known and given once.

    Raises
    ------
    ConfigError
        Naming the parameter that is not known here, or comes twice.
    """
    found: dict[str, str] = {}
    for key, value in query:
        if not allowed:
            raise ConfigError(f"{key!r} is not known here: this address takes no parameters")
        if key not in allowed:
            from doppelgait.dataset.example import nearest

            hint = nearest(key, list(allowed))
            raise ConfigError(f"{key!r} is not known here{hint}; allowed are {', '.join(allowed)}")
        if key in found:
            raise ConfigError(f"{key}: comes twice; give it once")
        found[key] = value
    return found


def number_of(key: str, value: str, *, least: float = -math.inf, most: float = math.inf) -> float:
    """A finite number between two limits.

    Raises
    ------
    ConfigError
        Naming the parameter ``key``, if it is none.
    """
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    if not math.isfinite(number) or not least <= number <= most:
        allowed = f" from {least:g} to {most:g}" if math.isfinite(least) else ""
        raise ConfigError(f"{key}: {value!r} is not allowed; it must be a number{allowed}")
    return number


def whole_of(parameters: Mapping[str, str], key: str, default: int, *, least: int, most: int) -> int:
    """A whole number between two limits; a ``default`` outside of them stands for none.

    Raises
    ------
    ConfigError
        Naming the parameter ``key``, if it is none, or missing without a default.
    """
    if key not in parameters and not least <= default <= most:
        raise ConfigError(f"{key}: is missing; it must be a whole number from {least} to {most}")
    value = parameters.get(key, str(default))
    plain = value.isascii() and value.isdigit() and len(value) <= 12
    if not plain or not least <= int(value) <= most:
        raise ConfigError(f"{key}: {value!r} is not allowed; it must be a whole number from {least} to {most}")
    return int(value)


Gate = str | tuple[float, float]


def gate_of(text: str) -> Gate:
    """Gate of a request or of ``--gate``: a name, or two ranges in metres.

    Raises
    ------
    ConfigError
        If it is neither ``track``, ``truth`` nor two rising ranges.
    """
    if text in ("track", "truth"):
        return text
    low, colon, high = text.partition(":")
    try:
        limits = number_of("gate", low), number_of("gate", high)
    except ConfigError:
        limits = (0.0, 0.0)
    if not colon or limits[0] >= limits[1]:
        raise ConfigError(
            f"gate: {text!r} is not allowed; it must be track, truth or FROM:TO in m, for example 1.2:2.8"
        )
    return limits
