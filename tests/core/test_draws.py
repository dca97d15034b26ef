"""Distributions in tables, where nothing draws them: their middle."""

import pytest

from doppelgait.core.draws import replace_by_middle, resolve
from doppelgait.core.errors import ConfigError


def test_the_middle_of_every_distribution() -> None:
    table = {
        "a": {"normal": [3.0, 2.0]}, "b": [{"uniform": [1.0, 5.0]}, 7], "c": {"log_uniform": [1.0, 100.0]},
        "d": {"choice": ["x", "y"]}, "e": {"cycle": [{"normal": [1.0, 0.0]}]}, "f": "text",
    }  # fmt: skip
    middles = {"a": 3.0, "b": [3.0, 7], "c": pytest.approx(10.0), "d": "x", "e": 1.0, "f": "text"}
    assert replace_by_middle(table) == middles
    with pytest.raises(ConfigError, match="needs two numbers"):
        replace_by_middle({"normal": [1.0]})


def test_the_middle_is_the_mean_of_many_draws() -> None:
    for value in ({"normal": [3.0, 2.0]}, {"uniform": [1.0, 5.0]}):
        sampled = [resolve(value, seed=1, example=n, key="k") for n in range(4000)]
        assert sum(sampled) / len(sampled) == pytest.approx(replace_by_middle(value), abs=0.15)
