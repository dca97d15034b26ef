"""Every classifier keeps its contract, and the contract check is able to fail."""

import numpy as np
import pytest

from doppelgait.classify import training
from doppelgait.classify.learned import Constant, Part
from doppelgait.classify.training import (
    BASELINES,
    BUILT_IN,
    CLASSIFIERS,
    kind_of,
    train_boosting,
    train_logistic,
    train_svm,
)
from doppelgait.core import plugins
from doppelgait.core.errors import ConfigError, DatasetError, DoppelgaitWarning
from doppelgait.testing import check_classifier


@pytest.mark.parametrize("name", [*BUILT_IN[:-1], *BASELINES])
def test_built_in_classifiers_keep_the_contract(name):
    check_classifier(name)


@pytest.fixture
def registered():
    """Register a classifier for one test."""
    names = []

    def register(train, **facts):
        name = f"broken-{len(names)}"
        plugins.plugin("classifier", name, **{"features": "six", **facts})(train)
        names.append(name)
        return name

    yield register
    for name in names:
        plugins._REGISTERED["classifier"].pop(name)


def random_model(train, held, *, n_classes, seed):
    return Constant(np.log(np.random.default_rng().dirichlet(np.ones(n_classes))))


def certain_model(train, held, *, n_classes, seed):
    return Constant(np.log(np.full(n_classes, 1.0 / n_classes)))


def half_model(train, held, *, n_classes, seed):
    return Constant(np.full(n_classes, -2.0))


def careless_model(train, held, *, n_classes, seed):
    train.values[:] = 0.0
    return certain_model(train, held, n_classes=n_classes, seed=seed)


@pytest.mark.parametrize(
    ("train", "words"),
    [
        (random_model, "another model"),
        (certain_model, "of rows right"),
        (half_model, "do not add up"),
        (careless_model, "changes its inputs"),
        (lambda *_, **__: None, "not one of"),
    ],
)
def test_the_contract_check_can_fail(registered, train, words):
    with pytest.raises(AssertionError, match=words):
        check_classifier(registered(train))


def test_features_of_a_classifier_are_checked(registered):
    with pytest.raises(AssertionError, match="the fact features"):
        check_classifier(registered(train_logistic, features="smell"))
    with pytest.raises(AssertionError, match="is not registered"):
        check_classifier("oracle")


def test_an_unknown_model_is_refused_with_those_that_are_known():
    with pytest.raises(ConfigError, match="model 'oracle' is not known; allowed are six-logistic, six-boosting"):
        kind_of("oracle")
    assert all(name in CLASSIFIERS for name in (*BUILT_IN, *BASELINES))


@pytest.mark.parametrize("attribute", ["_predictors", "_baseline_prediction"])
def test_another_scikit_learn_gives_one_clear_error(attribute, monkeypatch):
    """Its trees have no public form; a version that stores them elsewhere must not fail with an AttributeError."""
    from sklearn.ensemble import HistGradientBoostingClassifier

    original = HistGradientBoostingClassifier.fit

    def fit(self, *args, **kwargs):
        predict = original(self, *args, **kwargs).predict_proba(args[0])
        delattr(self, attribute)
        self.predict_proba = lambda values: predict
        return self

    monkeypatch.setattr(HistGradientBoostingClassifier, "fit", fit)
    rows = Part(np.random.default_rng(0).normal(size=(40, 3)), np.arange(40) % 2)
    with pytest.raises(DatasetError, match=f"scikit-learn .*{attribute}.*--models six-logistic"):
        train_boosting(rows, rows, n_classes=2, seed=0)


def test_logistic_regression_separates_products_and_ratios():
    """Two classes of hyperbolas x y = 1 and 1.5, which no plane between x and y separates."""
    rng = np.random.default_rng(1)
    labels = np.arange(400) % 2
    x = np.exp(rng.uniform(-1.5, 1.5, 400))
    y = np.where(labels, 1.5, 1.0) / x * np.exp(0.05 * rng.normal(size=400))
    signed = rng.normal(size=400)
    values = np.column_stack([x, y, signed])
    values[::40, 0] = np.nan
    model = train_logistic(Part(values, labels), Part(values[:0], labels[:0]), n_classes=2, seed=0)
    assert (model.floor > 0).tolist() == [True, True, False]  # what can be negative has no logarithm
    known = ~np.isnan(x) & ~np.isnan(values[:, 0])
    assert ((model.log_probability(values).argmax(axis=1) == labels)[known]).mean() > 0.97
    assert np.isfinite(model.log_probability(np.array([[0.0, -1.0, -5.0], [np.nan] * 3]))).all()


def rings(count, seed):
    """Three rings around the origin, of which each holds the smaller ones: no plane separates them."""
    rng = np.random.default_rng(seed)
    labels = np.arange(count) % 3
    radius, angle = labels + 1.0 + 0.1 * rng.normal(size=count), rng.uniform(0, 2 * np.pi, count)
    return Part(np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]), labels)


def test_support_vector_machine_separates_rings():
    train, nobody, test = rings(300, 0), rings(0, 0), rings(3000, 1)  # 3000 are several times ROWS_AT_A_TIME
    found = train_svm(train, nobody, n_classes=3, seed=0).log_probability(test.values)
    assert (found.argmax(axis=1) == test.labels).mean() > 0.98
    logistic = train_logistic(train, nobody, n_classes=3, seed=0).log_probability(test.values)
    assert (logistic.argmax(axis=1) == test.labels).mean() < 0.6


def test_support_vector_machine_uses_a_random_choice_of_too_many_rows(monkeypatch):
    monkeypatch.setattr(training, "SVM_MOST_ROWS", 30)
    train, nobody = rings(300, 0), rings(0, 0)
    few = np.flatnonzero((train.labels != 2) | (np.arange(300) < 9))  # three of the third class
    with pytest.warns(DoppelgaitWarning, match="of 203 training rows at most 10 of each class"):
        one, two, other = (
            train_svm(Part(train.values[few], train.labels[few]), nobody, n_classes=3, seed=seed) for seed in (0, 0, 1)
        )
    assert len(one.support) <= 23
    assert np.array_equal(one.support, two.support)
    assert not np.array_equal(one.support, other.support)
    known = {tuple(row) for row in (one.support * one.scale + one.mean).round(9)}
    assert known <= {tuple(row) for row in train.values[few].round(9)}
