"""Scores against hand-computed values, scikit-learn and SciPy; calibration; intervals that know targets."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import binom
from sklearn import metrics

from doppelgait.classify import scores
from doppelgait.classify.model import calibrate, find_detection_threshold, row_weights
from doppelgait.classify.scorer import log_softmax


def test_against_sklearn():
    rng = np.random.default_rng(3)
    labels, groups = rng.integers(0, 3, 400), rng.integers(0, 90, 400).astype(str)
    probability = rng.dirichlet([1, 1, 1], 400)
    probability[:, 1] = np.round(probability[:, 1], 1)  # ties
    guesses, weights = probability.argmax(axis=1), rng.random(400)
    assert scores.balanced_accuracy(labels, guesses == labels, 3) == pytest.approx(
        metrics.balanced_accuracy_score(labels, guesses)
    )
    assert np.isnan(scores.balanced_accuracy(labels, guesses == labels, 4))
    assert np.isnan(scores.auc(probability[:, 1], labels >= 0))
    for positive, weight in ((labels == 1, None), (labels == 1, weights)):
        expected = metrics.roc_auc_score(positive, probability[:, 1], sample_weight=weight)
        assert scores.auc(probability[:, 1], positive, weight) == pytest.approx(expected)
    low, high = scores.auc_interval(probability[:, 1], labels == 1, groups, seed=3)
    assert low < scores.auc(probability[:, 1], labels == 1) < high


@pytest.mark.parametrize(("hits", "n"), [(0, 7), (7, 7), (3, 11), (150, 152)])
def test_exact_interval_has_the_tails_it_says(hits, n):
    low, high = scores.clopper_pearson_interval(hits, n)
    if hits:
        assert binom.sf(hits - 1, n, low) == pytest.approx(0.025)
    else:
        assert low == 0
    if hits < n:
        assert binom.cdf(hits, n, high) == pytest.approx(0.025)
    else:
        assert high == 1


def test_an_interval_counts_targets_not_rows():
    right = np.array([True] * 90 + [False] * 10)
    alone, herd = np.arange(100).astype(str), np.repeat(np.arange(10), 10).astype(str)
    assert scores.wilson_interval(right, alone) == pytest.approx(scores.clopper_pearson_interval(90, 100))
    assert scores.wilson_interval(right, herd) == pytest.approx(scores.clopper_pearson_interval(9, 10))


def score_balanced(labels, right, groups, seed=0):
    answers = SimpleNamespace(labels=labels, right=right, groups=groups, classes=("dog", "human"))
    return scores.score_balanced(answers, seed)


def test_no_error_is_no_certainty():
    labels, groups = np.repeat([0, 1], 30), np.arange(60).astype(str)
    found = score_balanced(labels, np.ones(60, dtype=bool), groups)
    assert found["interval"] == "exact"
    assert found["low"] == pytest.approx(scores.clopper_pearson_interval(30, 30, 0.975)[0])
    assert found["high"] == 1


def test_bootstrap_over_targets_covers_as_often_as_it_says():
    """Rows of a target are all right or all wrong: an interval over rows would cover about half as often."""
    rng, hits, trials = np.random.default_rng(1), 0, 40
    labels, groups = np.repeat([0, 1], 200), np.repeat(np.arange(80), 5).astype(str)
    for seed in range(trials):
        right = (rng.random(80) < 0.8).repeat(5)
        found = score_balanced(labels, right, groups, seed)
        assert found["interval"] == "bootstrap"
        hits += found["low"] <= 0.8 <= found["high"]
    assert hits / trials > 0.88


def test_groups_of_two_classes_are_drawn_whole():
    labels, groups = np.array([0, 1, 0, 1, 0, 1]), np.array(["a", "a", "b", "b", "c", "d"])
    weights = scores.weight_groups(labels, groups, np.random.default_rng(0), count=200)
    assert np.array_equal(weights[:, 0], weights[:, 1])
    assert np.array_equal(weights[:, 2], weights[:, 3])
    assert (weights[:, 0] + weights[:, 2] == 2).all()  # among those with both classes
    assert (weights[:, 4] == 1).all()
    assert (weights[:, 5] == 1).all()


def test_calibration_error_by_hand():
    confidence = np.array([0.99, 0.98, 0.52, 0.51])
    found = scores.score_calibration(confidence, np.array([True, False, True, True]), np.ones(4), 0.5)
    assert found["expected_calibration_error"] == pytest.approx(0.5 * (1 - 0.515) + 0.5 * (0.985 - 0.5))
    assert [(b["n"], b["accuracy"]) for b in found["reliability"]] == [(4, 0.75)]  # too few for two bins


def test_bins_of_the_calibration_diagram_have_equal_counts_unless_confidences_are_equal():
    near_one, equal = 1.0 - 0.5 * np.random.default_rng(0).random(257) ** 4, np.repeat([0.6, 0.9, 1.0], [10, 10, 80])
    for confidence, counts in ((near_one, [25, 25, 25, *[26] * 7]), (equal, [10, 10, 80])):
        found = scores.score_calibration(confidence, confidence > 0.8, np.ones(confidence.size), 0.5)["reliability"]
        assert sorted(b["n"] for b in found) == counts
        assert sum(b["n"] * b["confidence"] for b in found) == pytest.approx(confidence.sum())


def test_calibration_weighs_classes_alike_and_leaves_few_rows_alone():
    labels = np.array([0] * 900 + [1] * 100)
    uninformed = np.full((1000, 2), np.log(0.5))
    assert calibrate(uninformed, labels)(uninformed)[0] == pytest.approx([0.5, 0.5], abs=0.005)
    few = calibrate(uninformed[:5], np.array([0, 0, 0, 0, 1]))
    assert (few.slope, few.n_rows) == (1.0, 0)


def test_calibration_of_separated_rows_stays_finite():
    scores_ = log_softmax(np.column_stack([np.zeros(40), np.repeat([-30.0, 30.0], 20)]))
    found = calibrate(scores_, np.repeat([0, 1], 20))(scores_)
    assert 0.9 < found[0, 0] < 0.99  # Platt's targets: 21 of 22
    assert found[0, 0] == pytest.approx(21 / 22, abs=0.01)


def test_calibration_undoes_a_known_distortion():
    rng = np.random.default_rng(0)
    truth = rng.normal(size=(6000, 3)) * 1.5
    labels = np.array([rng.choice(3, p=p) for p in np.exp(log_softmax(truth))])
    found = calibrate(log_softmax(2.0 * truth + [0.0, 1.0, -1.0]), labels)
    assert found.slope == pytest.approx(0.5, rel=0.08)
    assert found.shift == pytest.approx([0.0, -0.5, 0.5], abs=0.15)


def test_class_weights():
    weights = row_weights(np.array([0, 0, 0, 2]), 3)
    assert weights.tolist() == pytest.approx([2 / 3, 2 / 3, 2 / 3, 2.0])


def test_detection_threshold_by_hand():
    probability = np.array([0.9, 0.8, 0.7, 0.1, 0.95])
    positive = np.array([True, True, True, True, False])
    assert find_detection_threshold(probability, positive, 0.75) == 0.7
    assert find_detection_threshold(probability, positive, 0.95) == 0.1
    assert np.isnan(find_detection_threshold(probability, np.zeros(5, dtype=bool), 0.95))
