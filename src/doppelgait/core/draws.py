"""Random draws from the distributions of a plan."""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from doppelgait.core.errors import ConfigError
from doppelgait.core.rng import Streams

LARGEST = 1e100
"""Largest magnitude of a distribution's numbers, so that their sums and differences stay finite."""
Drawer = Callable[[list[Any], np.random.Generator], Any]
CYCLE = "cycle"
TIMES = "times"
Sibling = Callable[[str], Any]
"""Function that returns the sampled value of another key of the same table."""
_PLAIN = (str, int, float, type(None))
"""Types of values that cannot contain a distribution."""


def _sample_uniform(values: list[Any], rng: np.random.Generator) -> float:
    low, high = _check_two_numbers("uniform", values)
    if low > high:
        raise ConfigError(f"uniform = {values}: the first number must not exceed the second")
    return float(rng.uniform(low, high))


def _sample_log_uniform(values: list[Any], rng: np.random.Generator) -> float:
    low, high = _check_two_numbers("log_uniform", values)
    if not 0 < low <= high:
        raise ConfigError(f"log_uniform = {values}: needs two positive rising numbers")
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


def _sample_normal(values: list[Any], rng: np.random.Generator) -> float:
    mean, spread = _check_two_numbers("normal", values)
    if spread < 0:
        raise ConfigError(f"normal = {values}: needs a mean and a standard deviation of 0 or more")
    return float(mean + spread * np.clip(rng.standard_normal(), -3.0, 3.0))


def _sample_choice(values: list[Any], rng: np.random.Generator) -> Any:
    if not isinstance(values, list) or not values:
        raise ConfigError(f"choice = {values}: needs a list of at least one value")
    return values[int(rng.integers(len(values)))]


def _check_two_numbers(name: str, values: Any) -> tuple[float, float]:
    numbers = values if isinstance(values, list) else []
    if [type(number) in (int, float) and -LARGEST <= number <= LARGEST for number in numbers] == [True, True]:
        return float(values[0]), float(values[1])
    raise ConfigError(f"{name} = {values}: needs two numbers of {LARGEST:g} at most")


DISTRIBUTIONS: dict[str, Drawer] = {
    "uniform": _sample_uniform,
    "log_uniform": _sample_log_uniform,
    "normal": _sample_normal,
    "choice": _sample_choice,
}
"""``{ uniform = [low, high] }``, ``{ log_uniform = [low, high] }``, ``{ normal = [mean, sd] }``
(clipped at 3 sd), ``{ choice = [a, b, ...] }``. In addition, ``{ cycle = [a, b, ...] }`` uses the values in turn, by
example number. ``{ uniform = [low, high], times = "KEY" }`` multiplies the draw by the value of another key of the same
table; ``times`` does not change the draw itself."""


def resolve(value: Any, *, seed: int, example: int, key: str, turn: int | None = None) -> Any:
    """Sample every distribution inside a value of a plan."""
    return sample(Streams(seed, example), example if turn is None else turn, value, key)


def sample(streams: Streams, turn: int, value: Any, key: str, sibling: Sibling | None = None) -> Any:
    """Sample every distribution inside a value, each from the stream of its key."""
    if isinstance(value, _PLAIN):
        return value
    if isinstance(value, (dict, Mapping)):  # the usual one first: the other test is slow
        law = _parse_law(value)
        if law is None:
            _refuse_misspelt_law(value, key)
            return _sample_table(value, key, partial(sample, streams, turn))
        name, numbers, factor = law
        if name == CYCLE:
            if not isinstance(numbers, list) or not numbers:
                raise ConfigError(f"{key}: cycle = {numbers}: needs at least one value")
            outcome = numbers[turn % len(numbers)]
        else:
            try:
                outcome = DISTRIBUTIONS[name](numbers, streams.generator("plan", key))
            except ConfigError as error:
                raise ConfigError(f"{key}: {error}") from None
        if not isinstance(outcome, _PLAIN):
            outcome = sample(streams, turn, outcome, f"{key}.{name}", sibling)
        return outcome if factor is None else _multiply(outcome, factor, key, sibling)
    if isinstance(value, list):
        return [sample(streams, turn, v, f"{key}.{n}", sibling) for n, v in enumerate(value)]
    return value


def _parse_law(table: Mapping[str, Any]) -> tuple[str, Any, Any] | None:
    """Parse a distribution of a plan; return None for other tables."""
    count = len(table)
    if count == 1 or (count == 2 and TIMES in table):
        for name in table:
            if name == CYCLE or name in DISTRIBUTIONS:
                return name, table[name], None if count == 1 else table[TIMES]
    return None


def _refuse_misspelt_law(table: Mapping[str, Any], key: str) -> None:
    if len(table) > 2:
        return
    known = (*DISTRIBUTIONS, CYCLE)
    names = [name for name, numbers in table.items() if isinstance(numbers, list) and set(table) <= {name, TIMES}]
    for name in names:
        if near := difflib.get_close_matches(str(name), known, n=1, cutoff=0.75):
            raise ConfigError(
                f"{key}: {name!r} is no distribution; known are {', '.join(known)}; did you mean {near[0]}?"
            )


def _sample_table(table: Mapping[str, Any], key: str, sample: Callable[[Any, str, Sibling], Any]) -> dict[str, Any]:
    """Sample the values of a table; one that another multiplies (``times``) comes first."""
    found: dict[str, Any] = {}
    begun: list[str] = []

    def value_of(name: str) -> Any:
        if name in found:
            return found[name]
        if name not in table:
            known = ", ".join(str(other) for other in table if other not in begun) or "none"
            raise ConfigError(f"is not a key of the same table; its other keys are {known}")
        if name in begun:
            raise ConfigError(f"is circular: {' -> '.join([*begun, name])}")
        begun.append(name)
        found[name] = sample(table[name], f"{key}.{name}" if key else name, value_of)
        begun.pop()
        return found[name]

    for name, inner in table.items():
        if isinstance(inner, _PLAIN):  # the most frequent case
            found[name] = inner
        elif name not in found:
            value_of(name)
    return {name: found[name] for name in table}


def _multiply(value: Any, name: Any, key: str, sibling: Sibling | None) -> float:
    said = f"{key}: {TIMES} = {name!r}"
    if not isinstance(name, str) or sibling is None:
        raise ConfigError(f'{said}: is not allowed; it must name a key of the same table, as in {TIMES} = "height_m"')
    try:
        factor = sibling(name)
    except ConfigError as error:
        text = str(error)
        raise ConfigError(f"{said}: {text}" if text.startswith(("is not a key", "is circular")) else text) from None
    for words, number in (("its draw is", value), (f"{name} is", factor)):
        if not isinstance(number, int | float) or isinstance(number, bool):
            raise ConfigError(f"{said}: {words} {number!r}, which is not a number")
    return float(value * factor)


def replace_by_middle(value: Any, key: str = "", sibling: Sibling | None = None) -> Any:
    """Replace every distribution inside a value by its middle."""
    if isinstance(value, list):
        return [replace_by_middle(v, f"{key}.{n}", sibling) for n, v in enumerate(value)]
    law = _parse_law(value) if isinstance(value, Mapping) else None
    if law is None:
        return _sample_table(value, key, replace_by_middle) if isinstance(value, Mapping) else value
    name, numbers, factor = law
    if name == CYCLE:
        found = replace_by_middle(numbers[0], key, sibling) if isinstance(numbers, list) and numbers else numbers
    else:
        try:
            DISTRIBUTIONS[name](numbers, np.random.default_rng(0))  # raises for numbers that are not allowed
        except ConfigError as error:
            raise ConfigError(f"{key}: {error}" if key else str(error)) from None
        first, last = numbers[0], numbers[-1]
        if name in ("choice", "normal"):
            found = replace_by_middle(first, key, sibling)
        else:
            found = (first + last) / 2.0 if name == "uniform" else math.sqrt(first * last)
    return found if factor is None else _multiply(found, factor, key, sibling)
