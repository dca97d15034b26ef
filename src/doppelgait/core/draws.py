"""Draw from the distributions in a table of a plan."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from doppelgait.core.errors import ConfigError
from doppelgait.core.rng import Streams

Drawer = Callable[[list[Any], np.random.Generator], Any]
CYCLE = "cycle"


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
    if not values:
        raise ConfigError("choice = []: needs at least one value")
    return values[int(rng.integers(len(values)))]


def _two_numbers(name: str, values: Any) -> tuple[float, float]:
    numbers = (
        isinstance(values, list)
        and len(values) == 2
        and all(isinstance(v, int | float) and not isinstance(v, bool) for v in values)
    )
    if not numbers:
        raise ConfigError(f"{name} = {values}: needs two numbers")
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
    if isinstance(value, Mapping):
        if len(value) == 1 and CYCLE in value:
            entries = value[CYCLE]
            if not isinstance(entries, list) or not entries:
                raise ConfigError(f"{key}: cycle = {entries}: needs at least one value")
            entry = entries[(example if turn is None else turn) % len(entries)]
            return resolve(entry, seed=seed, example=example, key=f"{key}.{CYCLE}", turn=turn)
        if len(value) == 1 and next(iter(value)) in DISTRIBUTIONS:
            ((name, numbers),) = value.items()
            try:
                drawn = DISTRIBUTIONS[name](numbers, Streams(seed, example).generator("plan", key))
            except ConfigError as error:
                raise ConfigError(f"{key}: {error}") from None
            return resolve(drawn, seed=seed, example=example, key=f"{key}.{name}", turn=turn)
        return {k: resolve(v, seed=seed, example=example, key=f"{key}.{k}", turn=turn) for k, v in value.items()}
    if isinstance(value, list):
        return [resolve(v, seed=seed, example=example, key=f"{key}.{n}", turn=turn) for n, v in enumerate(value)]
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
