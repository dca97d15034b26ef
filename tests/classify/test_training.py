"""Every classifier keeps its contract, and the contract check is able to fail."""

import numpy as np
import pytest

from doppelgait.classify.learned import LabelledRows, Learned, join_inputs, select_features
from doppelgait.classify.model import calibrate
from doppelgait.classify.model_file import load_model, save_model
from doppelgait.classify.network import CHANNELS
from doppelgait.classify.training import (
    BASELINES,
    CLASSIFIERS,
    find_kind,
    fit,
    join,
    train_boosting,
    train_logistic,
)
from doppelgait.core import plugins
from doppelgait.core.errors import ConfigError, DatasetError
from doppelgait.processing.patches import Patch
from doppelgait.testing import check_classifier
from export_models import export_model_of, inputs_of, random_network


@pytest.mark.filterwarnings("ignore:torch is not installed")  # its network of tracks is then smaller
@pytest.mark.parametrize(
    "name", [*(name for name in CLASSIFIERS if name not in ("signature-network", *BASELINES)), *BASELINES]
)
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


def constant(shares):
    return Learned("constant", {"log_share": np.log(shares)})


def certain_model(train, held, *, n_classes, seed):
    return constant(np.full(n_classes, 1.0 / n_classes))


def careless_model(train, held, *, n_classes, seed):
    train.values[:] = 0.0
    return certain_model(train, held, n_classes=n_classes, seed=seed)


@pytest.mark.parametrize(
    ("train", "words"),
    [
        (lambda *_, n_classes, **__: constant(np.random.default_rng().dirichlet(np.ones(n_classes))), "another model"),
        (certain_model, "of rows right"),
        (lambda *_, n_classes, **__: constant(np.full(n_classes, 0.1)), "do not add up"),
        (careless_model, "changes its inputs"),
        (lambda *_, **__: None, "not one of"),
    ],
)
def test_the_contract_check_can_fail(registered, train, words):
    with pytest.raises(AssertionError, match=words):
        check_classifier(registered(train))


def test_features_of_a_classifier_are_checked(registered):
    with pytest.raises(ConfigError, match="features = 'smell'; allowed are six, extended"):
        registered(train_logistic, features="smell")
    with pytest.raises(AssertionError, match="is not registered"):
        check_classifier("oracle")


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
    rows = LabelledRows(np.random.default_rng(0).normal(size=(40, 3)), np.arange(40) % 2)
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
    model = train_logistic(LabelledRows(values, labels), LabelledRows(values[:0], labels[:0]), n_classes=2, seed=0)
    assert (model.arrays["floor"] > 0).tolist() == [True, True, False]  # what can be negative has no logarithm
    known = ~np.isnan(x) & ~np.isnan(values[:, 0])
    assert ((model.log_probability(values).argmax(axis=1) == labels)[known]).mean() > 0.97
    assert np.isfinite(model.log_probability(np.array([[0.0, -1.0, -5.0], [np.nan] * 3]))).all()


def two_views(count, seed):
    """Rows of two features and levels, none of which tells the classes on its own."""
    rng = np.random.default_rng(seed)
    labels = np.arange(count) % 2
    features = rng.normal(size=(count, 2)) + 0.8 * labels[:, None]
    pictures = np.empty(count, dtype=object)
    for number, label in enumerate(labels):
        pictures[number] = (rng.random((64, 64)) * (0.3 + 0.4 * label)).astype(np.float32)
    return LabelledRows(join_inputs(features, pictures), labels)


@pytest.fixture(scope="module")
def joined():
    """An ensemble of three members, and the rows that it was calibrated on."""
    train, held = two_views(200, 0), two_views(60, 1)
    features = [LabelledRows(select_features(part.values), part.labels) for part in (train, held)]
    members = [
        fit(find_kind(name), *features, n_classes=2, seed=0) for name in ("extended-logistic", "extended-boosting")
    ]
    return join([*members, random_network(np.random.default_rng(0), 2, Patch(), CHANNELS)], held, n_classes=2), held


def test_an_ensemble_is_the_mean_of_the_calibrated_log_odds_of_its_members(joined):
    (found, held), asked = joined, two_views(30, 2)
    views = [select_features, select_features, lambda values: values[:, -1]]
    odds = []
    for member, view in zip(found.members, views, strict=True):
        calibration = calibrate(member.log_probability(view(held.values)), held.labels)
        p = calibration(member.log_probability(view(asked.values)))
        odds.append(np.log(p[:, 1] / p[:, 0]))
    p = np.exp(found.log_probability(asked.values))
    assert np.log(p[:, 1] / p[:, 0]) == pytest.approx(np.mean(odds, axis=0))
    assert p.sum(axis=1) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda arrays: arrays.update(slopes=np.array([1.0, -1.0, 1.0])), "slopes holds numbers that are not above 0"),
        (lambda arrays: arrays.update(shifts=np.zeros((3, 3))), "shifts has the shape"),
        (lambda arrays: arrays.update({"member.0.bias": np.zeros(5)}), "bias has the shape"),
        (lambda arrays: arrays.update({"member.2.kernel.0": np.zeros((4, 2, 3, 3))}), r"kernel.0 has the shape"),
        (lambda arrays: arrays.pop("member.1.root"), "root"),
    ],
)
def test_an_ensemble_is_kept_as_one_file_and_a_tampered_one_is_refused(tmp_path, change, says):
    model = export_model_of("ensemble")
    values = inputs_of(model, 30, 20)[2]
    path = save_model(model, tmp_path / "e.npz")
    again = load_model(path)
    assert np.array_equal(again.probability(values), model.probability(values))
    first = path.read_bytes()
    assert save_model(again, path).read_bytes() == first
    with np.load(path) as archive:
        arrays = dict(archive)
    change(arrays)
    np.savez(path, **arrays)
    with pytest.raises(DatasetError, match=says):
        load_model(path)
