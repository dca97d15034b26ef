"""Few own recordings move the place where a model decides, and never score themselves."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.special import expit

from doppelgait.classify import adapt as adaptation
from doppelgait.classify.data import Rows
from doppelgait.classify.learned import Learned
from doppelgait.classify.model import Calibration, Facts, Model
from doppelgait.core.errors import DatasetError

NONE = np.zeros(0)


@pytest.fixture
def model():
    """Log odds of the second class are the feature itself."""
    own = dict.fromkeys(("median", "mean", "floor"), np.zeros(1))
    own |= {"told": np.zeros(0, dtype=np.int64), "scale": np.ones(1)}
    learned = Learned("linear", own | {"weight": np.array([[0.0], [1.0]]), "bias": np.zeros(2)})
    facts = Facts(
        name="six-logistic", features="six", names=("step_length_m",), classes=("human", "dog"), dataset_id="x",
        dataset_name="x", version="0", n_train=9, n_held=9, seed=0, analysis={}, conditions={},
    )  # fmt: skip
    return Model(facts, learned, Calibration(1.0, np.zeros(2), 9), NONE, NONE, NONE)


def own_rows(n_targets=30, *, offset=3.0, seed=0, per_target=4):
    """Classes 4 apart in log odds, all of them shifted: ranked well, decided wrongly."""
    rng = np.random.default_rng(seed)
    groups = np.repeat([f"m{k}" for k in range(n_targets)], per_target)
    labels = np.repeat(np.arange(n_targets) % 2, per_target)
    values = (offset + 4.0 * (labels - 0.5) + rng.normal(size=labels.size))[:, None]
    index = pd.DataFrame({"id": [f"e{k}" for k in range(labels.size)],
                          "recording": [f"r{k // 2}" for k in range(labels.size)]})  # fmt: skip
    nothing = np.zeros(labels.size, dtype=np.int64)
    return Rows((), index, nothing, np.arange(labels.size), ("human", "dog"), labels, groups), values


def ids(rows):
    return rows.index["id"].to_numpy(dtype=str)


def test_nothing_seen_changes_nothing(model):
    assert adaptation.adapt(model, np.zeros((0, 1)), np.zeros(0, dtype=np.int64), np.zeros(0, dtype=str)) is model


def test_it_is_the_most_likely_slope_and_shift(model):
    """Against a search of the posterior on a grid, on top of a calibration that was there."""
    model = replace(model, calibration=Calibration(0.7, np.array([0.0, 0.4]), 9))
    rows, values = own_rows(4, seed=2, per_target=1)
    found = adaptation.adapt(model, values, rows.labels, ids(rows))
    before = 0.7 * values[:, 0] + 0.4
    slopes, shifts = np.linspace(-1.5, 1.5, 601), np.linspace(-6, 6, 601)
    odds = np.exp(slopes)[:, None, None] * before + shifts[None, :, None]
    likely = np.log(expit(np.where(rows.labels == 1, odds, -odds))).sum(axis=2)
    likely -= (slopes[:, None] / adaptation.SLOPE_SD) ** 2 / 2 + (shifts / adaptation.SHIFT_SD) ** 2 / 2
    k, m = np.unravel_index(likely.argmax(), likely.shape)
    assert found.calibration.slope == pytest.approx(0.7 * np.exp(slopes[k]), rel=0.01)
    assert found.calibration.shift[1] == pytest.approx(np.exp(slopes[k]) * 0.4 + shifts[m], abs=0.03)


def test_a_long_recording_counts_once(model):
    rows, values = own_rows(6, seed=3, per_target=1)
    names = ids(rows)
    once = adaptation.adapt(model, values, rows.labels, names)
    longer = [np.concatenate([each, np.repeat(each[:1], 60, axis=0)]) for each in (values, rows.labels, names)]
    again = adaptation.adapt(model, *longer)
    assert again.calibration.slope == pytest.approx(once.calibration.slope, rel=1e-3)
    assert again.calibration.shift == pytest.approx(once.calibration.shift, abs=1e-3)


def test_a_class_that_is_missing_moves_nothing(model):
    rows, values = own_rows(6)
    human = rows.labels == 0
    with pytest.raises(DatasetError, match="own recordings contain no dog; add some of every class"):
        adaptation.adapt(model, values[human], rows.labels[human], ids(rows)[human])


def test_the_same_targets_trigger_the_alarm_as_before(model):
    rows, values = own_rows(20, seed=5)
    for alarm in ("human", "dog"):
        facts = model.facts.model_copy(update={"alarm": alarm, "alarm_threshold": 0.7})
        before = replace(model, facts=facts)
        column = facts.classes.index(alarm)
        after = adaptation.adapt(before, values, rows.labels, ids(rows))
        assert after.facts.alarm_threshold != pytest.approx(0.7, abs=0.01)
        triggers = [one.probability(values)[:, column] >= one.facts.alarm_threshold for one in (before, after)]
        assert 0 < triggers[0].sum() < len(values)
        assert (triggers[0] == triggers[1]).all()


def test_a_blank_recording_is_one_of_its_own():
    rows, _ = own_rows(2, per_target=2)
    rows.index["recording"] = ["", "a", None, "a"]
    assert adaptation.list_row_recordings(rows).tolist() == ["e0", "a", "e2", "a"]


def test_targets_who_are_drawn_are_not_scored():
    rows, _ = own_rows(12)
    rng = np.random.default_rng(0)
    for n in (1, 3, 5):
        own, scored = adaptation.sample_own_rows(rows, n, rng)
        assert not set(rows.groups[own]) & set(rows.groups[scored])
        names = rows.index["recording"].to_numpy()
        for number in (0, 1):
            mine = own[rows.labels[own] == number]
            assert len(set(names[mine])) == n
            assert len(set(rows.groups[mine])) == -(-n // 2)  # two recordings of each target
    assert adaptation.sample_own_rows(rows, 0, rng)[1].size == 48
    assert adaptation.sample_own_rows(rows, 13, rng) is None  # there are 12
    assert adaptation.sample_own_rows(rows, 12, rng) is None  # nobody would be left


def test_a_shifted_threshold_is_found_by_few_recordings(model, monkeypatch):
    monkeypatch.setattr(adaptation, "REPEATS", 10)
    rows, values = own_rows()
    curve = adaptation.score_adaptation(model, rows, values, np.random.default_rng(1), counts=(0, 2, 10, 500))
    assert [point["n"] for point in curve] == [0, 2, 10]
    scores = [point["balanced_accuracy"] for point in curve]
    assert scores[0] < 0.7
    assert scores[0] + 0.15 < scores[1]
    assert scores[2] > 0.95
    errors = [point["expected_calibration_error"] for point in curve]
    assert errors[2] < errors[0] / 3
    assert curve[0]["low"] == curve[0]["high"] == scores[0]


def test_without_a_change_the_same_targets_score_as_before(model, monkeypatch):
    """Few targets are left to score: their score differs from that of all, and says nothing about the adaptation."""
    monkeypatch.setattr(adaptation, "adapt", lambda model, *_: model)
    rows, values = own_rows(6, seed=7, offset=1.5)
    for point in adaptation.score_adaptation(model, rows, values, np.random.default_rng(1), counts=(0, 1, 2)):
        assert point["balanced_accuracy"] == point["before"]
        assert point["movers"] == 6 - (2 if point["n"] else 0)
