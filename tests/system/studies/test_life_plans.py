"""The plans of life, for training and for a blind test: recordings can be drawn, and no kind is in both."""

from pathlib import Path

import pytest

from doppelgait.dataset.config import load_plan
from doppelgait.dataset.resolve import resolve_example

PLANS = Path(__file__).parents[3] / "tools" / "plans"
NAMES = ("home-alarm-test", "home-alarm-life", PLANS / "life-more.toml", PLANS / "life-wide.toml")


@pytest.mark.parametrize("name", NAMES)
def test_every_kind_can_be_drawn(name):
    plan, folder = load_plan(name)
    for number in range(0, sum(map(plan.count_class_examples, plan.episodes)), 5):
        example = resolve_example(plan, number, folder)
        assert {row.label for row in example.rows} <= {"human", "animal", "thing", "vacuum", "fan", "curtain"}


def test_no_kind_of_the_blind_test_is_a_kind_of_training():
    plans = (load_plan(name)[0] for name in NAMES)
    blind, *others = ({episode.label for episode in plan.episodes} for plan in plans)
    assert len(blind) >= 50
    assert len(set.union(*others)) >= 140
    assert not blind & set.union(*others)
