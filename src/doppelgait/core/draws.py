"""Random draws from the distributions of a plan."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import cache, partial
from typing import Any, NamedTuple, NoReturn

import numpy as np

from doppelgait.core.errors import ConfigError, list_choices
from doppelgait.core.rng import Streams

LARGEST = 1e100
"""Largest magnitude of a distribution's numbers, so that their sums and differences stay finite."""
CYCLE = "cycle"
TIMES = "times"
Sibling = Callable[[str], Any]
"""Function that returns the sampled value of another key of the same table."""


class Turn(NamedTuple):
    """Turn of an example in cycles, and its streams; None takes middles."""

    number: int = 0
    streams: Streams | None = None


Draw = Callable[[Turn, Sibling | None], Any]
Law = tuple[Callable[[np.random.Generator], Any], Any]
"""Compiled distribution: the function that samples it, and its middle."""


def _make_uniform(name: str, values: Any) -> Law:
    low, high = _check_two_numbers(name, values)
    if low > high:
        raise ConfigError(f"{name} = {values}: the first number must not exceed the second")
    return lambda rng: low + (high - low) * rng.random(), (low + high) / 2.0


def _make_log_uniform(name: str, values: Any) -> Law:
    low, high = _check_two_numbers(name, values)
    if not 0 < low <= high:
        raise ConfigError(f"{name} = {values}: needs two positive rising numbers")
    first, last = math.log(low), math.log(high)
    return lambda rng: math.exp(first + (last - first) * rng.random()), math.sqrt(low * high)


def _make_normal(name: str, values: Any) -> Law:
    mean, spread = _check_two_numbers(name, values)
    if spread < 0:
        raise ConfigError(f"{name} = {values}: needs a mean and a standard deviation of 0 or more")
    return lambda rng: mean + spread * min(max(rng.standard_normal(), -3.0), 3.0), values[0]


def _make_choice(name: str, values: Any) -> Law:
    if not isinstance(values, list) or not values:
        raise ConfigError(f"{name} = {values}: needs {'a list of ' * (name != CYCLE)}at least one value")
    return lambda rng: int(rng.integers(len(values))), 0


def _check_two_numbers(name: str, values: Any) -> tuple[float, float]:
    numbers = values if isinstance(values, list) else []
    if [type(number) in (int, float) and -LARGEST <= number <= LARGEST for number in numbers] == [True, True]:
        return float(values[0]), float(values[1])
    raise ConfigError(f"{name} = {values}: needs two numbers of {LARGEST:g} at most")


DISTRIBUTIONS: dict[str, Callable[[str, Any], Law]] = {
    "uniform": _make_uniform,
    "log_uniform": _make_log_uniform,
    "normal": _make_normal,
    "choice": _make_choice,
}
"""``{ uniform = [low, high] }``, ``{ log_uniform = [low, high] }``, ``{ normal = [mean, sd] }``
(clipped at 3 sd), ``{ choice = [a, b, ...] }``. In addition, ``{ cycle = [a, b, ...] }`` uses the
values in turn, by example number. ``{ uniform = [low, high], times = "KEY" }`` multiplies the draw
by the value of another key of the same table; ``times`` does not change the draw itself."""


def resolve(value: Any, *, seed: int, example: int, key: str, turn: int | None = None) -> Any:
    """Sample every distribution inside a value of a plan, each from the stream of its key."""
    return compile_draws(value, key)(Turn(example if turn is None else turn, Streams(seed, example)))


def replace_by_middle(value: Any, key: str = "") -> Any:
    """Replace every distribution inside a value by its middle."""
    return compile_draws(value, key)(Turn())


def compile_draws(value: Any, key: str) -> Callable[[Turn], Any]:
    """Compile a plan's value; an example then only draws its numbers."""
    draw = _compile(value, key)
    return (lambda _: value) if draw is None else lambda turn: draw(turn, None)


def _compile(value: Any, key: str) -> Draw | None:
    """Compile a value; return None if nothing is drawn."""
    if isinstance(value, (dict, Mapping)):  # the usual one first: the other test is slow
        try:
            law = _parse_law(value)
            if law is not None:
                return _compile_law(*law, key)
            _refuse_misspelt_law(value, key)
        except ConfigError as error:  # an example that samples this value fails
            return partial(_raise, str(error))
        return _compile_table(value, key)
    draws = [_compile(inner, f"{key}.{n}") for n, inner in enumerate(value)] if isinstance(value, list) else []
    if not any(draws):
        return None
    return lambda turn, sibling: [
        inner if draw is None else draw(turn, sibling) for inner, draw in zip(value, draws, strict=True)
    ]


def _raise(message: str, turn: Turn, sibling: Sibling | None) -> NoReturn:
    raise ConfigError(message)


def _compile_law(name: str, values: Any, factor: Any, key: str) -> Draw:
    try:
        sample, middle = DISTRIBUTIONS.get(name, _make_choice)(name, values)
    except ConfigError as error:
        raise ConfigError(f"{key}: {error}" if key else str(error)) from None
    compile_outcome = cache(lambda n: _compile(values[n], f"{key}.{name}".lstrip(".")))  # only those drawn

    def draw(turn: Turn, sibling: Sibling | None) -> Any:
        if turn.streams is None:
            outcome = middle
        elif name == CYCLE:
            outcome = turn.number % len(values)
        else:
            outcome = sample(turn.streams.generator("plan", key))
        if name in (CYCLE, "choice"):
            inner = compile_outcome(outcome)
            outcome = values[outcome] if inner is None else inner(turn, sibling)
        return outcome if factor is None else _multiply(outcome, factor, key, sibling)

    return draw


def _compile_table(table: Mapping[str, Any], key: str) -> Draw | None:
    """Compile a table; a value that another multiplies (``times``) is sampled first."""
    draws = {name: _compile(inner, f"{key}.{name}" if key else name) for name, inner in table.items()}
    varying = {name: draw for name, draw in draws.items() if draw is not None}

    def sample(turn: Turn, _: Sibling | None) -> dict[str, Any]:
        values, left = dict(table), dict(varying)
        begun: list[str] = []

        def value_of(name: str) -> Any:
            if name not in table:
                known = ", ".join(str(other) for other in table if other not in begun) or "none"
                raise ConfigError(f"is not a key of the same table; its other keys are {known}")
            if name in begun:
                raise ConfigError(f"is circular: {' -> '.join([*begun, name])}")
            if name in left:
                begun.append(name)
                values[name] = left[name](turn, value_of)
                del left[begun.pop()]
            return values[name]

        for name in varying:
            value_of(name)
        return values

    return sample if varying else None


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
        if "?" in (words := list_choices(known, name)):
            raise ConfigError(f"{key}: {name!r} is no distribution; known are {words}")


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
