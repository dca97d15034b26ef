"""Mistakes in plans: each is one short error, whatever stands where."""

import copy

import pytest

import tiny_dataset
from doppelgait.core.config import validate
from doppelgait.core.errors import ConfigError, DoppelgaitError
from doppelgait.dataset.config import PlanConfig
from doppelgait.dataset.plan import plan_dataset


def resolve_example(table):
    return plan_dataset(validate(PlanConfig, table, where="plan")).example(0)


def changed(key, value):
    table = copy.deepcopy(tiny_dataset.tiny_plan().model_dump(mode="json", exclude_none=True))
    *path, last = key.split(".")
    node = table
    for part in path:
        node = node[part]
    node[last] = value
    return table


@pytest.mark.parametrize(
    "fields", [[3], [None], [[]], [{"name": []}], [{"name": {}}, {"name": {}}], ["signature", 3.0]]
)
def test_fields_that_are_none(fields):
    with pytest.raises(ConfigError, match=r"dataset\.fields"):
        resolve_example(changed("dataset.fields", fields))


def test_messages_are_short_however_long_the_names_are():
    for table in (
        changed("target.key" + "y" * 100_000, 1),
        changed("dataset.name", "x" * 100_000),
        {**changed("target.range_m", 1.0), **{f"key{number}": 1 for number in range(5000)}},
    ):
        with pytest.raises(DoppelgaitError) as refused:
            resolve_example(table)
        assert len(str(refused.value)) <= 2000
