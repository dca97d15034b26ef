"""Draws from the distributions of a plan."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from doppelgait.core.errors import ConfigError
from doppelgait.core.rng import Streams

LARGEST = 1e100
"""Of a number of a distribution: their sums and differences are numbers, too."""
Drawer = Callable[[list[Any], np.random.Generator], Any]
CYCLE = "cycle"
_PLAIN = (str, int, float, type(None))
"""Values without a distribution inside; most of a plan."""


def _uniform(values: list[Any], rng: np.random.Generator) -> float:
    low, high = _two_numbers("uniform", values)
    if low > high:
        raise ConfigError(f"uniform = {values}: the first number must not exceed the second")
    return float(rng.uniform(low, high))


def _log_uniform(values: list[Any], rng: np.random.Generator) -> float:
    low, high = _two_numbers("log_uniform", values)
    if not 0 < low <= high:
        raise ConfigError(f"log_uniform = {values}: needs two positive rising numbers")
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


def _normal(values: list[Any], rng: np.random.Generator) -> float:
    mean, spread = _two_numbers("normal", values)
    if spread < 0:
        raise ConfigError(f"normal = {values}: needs a mean and a standard deviation of 0 or more")
    return float(mean + spread * np.clip(rng.standard_normal(), -3.0, 3.0))


def _choice(values: list[Any], rng: np.random.Generator) -> Any:
    if not isinstance(values, list) or not values:
        raise ConfigError(f"choice = {values}: needs a list of at least one value")
    return values[int(rng.integers(len(values)))]


def _two_numbers(name: str, values: Any) -> tuple[float, float]:
    numbers = (
        isinstance(values, list)
        and len(values) == 2
        and all(isinstance(v, int | float) and not isinstance(v, bool) for v in values)
    )
    if not numbers or not all(abs(v) <= LARGEST for v in values):
        raise ConfigError(f"{name} = {values}: needs two numbers of {LARGEST:g} at most")
    return float(values[0]), float(values[1])


DISTRIBUTIONS: dict[str, Drawer] = {
    "uniform": _uniform,
    "log_uniform": _log_uniform,
    "normal": _normal,
    "choice": _choice,
}
"""``{ uniform = [low, high] }``, ``{ log_uniform = [low, high] }``, ``{ normal = [mean, sd] }`` (cut at 3 sd),
``{ choice = [a, b, ...] }``. Beside these ``{ cycle = [a, b, ...] }`` takes the values in turn, by example number."""


def resolve(value: Any, *, seed: int, example: int, key: str, turn: int | None = None) -> Any:
    """Sample every distribution inside a value of a plan.

    Parameters
    ----------
    value : table, list or plain value
    seed : int
        Root seed of the dataset.
    example : int
        Number of the example.
    key : str
        Dotted key of the value; names its stream and appears in errors.
    turn : int, optional
        Place in a ``cycle``; the number of the example by default.

    Returns
    -------
    The value with each distribution replaced by one draw.

    Raises
    ------
    ConfigError
        If a distribution's numbers are not allowed; the message names the key.
    """
    return _sample(value, Streams(seed, example), key, example if turn is None else turn)


def _sample(value: Any, streams: Streams, key: str, turn: int) -> Any:
    if isinstance(value, _PLAIN):
        return value
    if isinstance(value, Mapping):
        if len(value) == 1:
            ((name, numbers),) = value.items()
            if name == CYCLE:
                if not isinstance(numbers, list) or not numbers:
                    raise ConfigError(f"{key}: cycle = {numbers}: needs at least one value")
                return _sample(numbers[turn % len(numbers)], streams, f"{key}.{CYCLE}", turn)
            if name in DISTRIBUTIONS:
                try:
                    drawn = DISTRIBUTIONS[name](numbers, streams.generator("plan", key))
                except ConfigError as error:
                    raise ConfigError(f"{key}: {error}") from None
                return _sample(drawn, streams, f"{key}.{name}", turn)
        return {k: _sample(v, streams, f"{key}.{k}", turn) for k, v in value.items()}
    if isinstance(value, list):
        return [_sample(v, streams, f"{key}.{n}", turn) for n, v in enumerate(value)]
    return value


def middle(value: Any, key: str = "") -> Any:
    """Replace every distribution inside a value by its middle.

    The mean of ``normal`` and ``uniform``, the geometric one of ``log_uniform``, the first entry of a list.

    Raises
    ------
    ConfigError
        If a distribution's numbers are not allowed; the message names the key.
    """
    if isinstance(value, Mapping):
        if len(value) == 1 and (name := next(iter(value))) in DISTRIBUTIONS:
            numbers = value[name]
            try:
                DISTRIBUTIONS[name](numbers, np.random.default_rng(0))  # what no draw would take is refused
            except ConfigError as error:
                raise ConfigError(f"{key}: {error}" if key else str(error)) from None
            first, last = numbers[0], numbers[-1]
            if name in ("choice", "normal"):
                return middle(first, key)
            return (first + last) / 2.0 if name == "uniform" else math.sqrt(first * last)
        if len(value) == 1 and CYCLE in value:
            entries = value[CYCLE]
            return middle(entries[0], key) if isinstance(entries, list) and entries else entries
        return {k: middle(v, f"{key}.{k}" if key else k) for k, v in value.items()}
    return [middle(v, f"{key}.{n}") for n, v in enumerate(value)] if isinstance(value, list) else value
