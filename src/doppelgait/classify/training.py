"""Classifiers by name, with their inputs and training functions."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from doppelgait.classify.learned import (
    FloatArray,
    Inputs,
    LabelledRows,
    Learned,
    Novelty,
    select_features,
    select_inputs,
)
from doppelgait.classify.model import calibrate, row_weights
from doppelgait.classify.scorer import take_logarithms
from doppelgait.core.errors import ConfigError, DatasetError
from doppelgait.core.plugins import Group, Plugin, plugin
from doppelgait.core.worker import limit_blas_threads

MEMBERS = ("extended-logistic", "extended-boosting", "signature-network")
"""Models that the ensemble averages: straight boundaries, boxes, and pictures."""
DEFAULT = ("six-logistic", *MEMBERS, "ensemble")  # models that are trained where none is named
BASELINES = ("chance", "nuisance", "speed")
"""Reported with every score: all classes alike, the nuisance parameters, and the speed alone."""

BOOSTING = {
    "max_iter": 150,
    "learning_rate": 0.08,
    "max_leaf_nodes": 15,
    "min_samples_leaf": 10,
    "l2_regularization": 1.0,
    "early_stopping": False,
}
"""Chosen once, before any test set was used."""

NODE_FIELDS = {"is_leaf": bool, "feature_idx": int, "num_threshold": float, "value": float}
NODE_FIELDS |= dict.fromkeys(("missing_go_to_left", "left", "right"), int)
LOG_FLOOR = 0.03
"""Smallest value that the logarithm distinguishes, over the median. A round number for the scale of
what is nearly zero, assumed; recordings of both halves were in view when it was set."""
LEVELS = 500  # maximum number of stored quantiles of the held-out distances
SHRINKAGE = 0.05
"""Share of the identity in the covariance of the standardised columns, assumed: a column without
spread in training counts as one with a fifth of the usual spread."""

_OTHER_TREES = (
    "scikit-learn {version} stores the trees of HistGradientBoostingClassifier in another form ({reason}); install "
    "another version, or train models without trees: --models six-logistic"
)


Trainer = Callable[..., Learned]
"""A plug-in: ``(train, held, *, n_classes, seed)``; held rows only decide when to stop."""

INPUTS = ("six", "extended", "speed", "signature", "extended+signature", "track", "nuisance", "nothing")


def check_classifier(item: Plugin[Any]) -> None:
    """Refuse a classifier without known inputs when it is registered."""
    if (features := item.facts.get("features")) not in INPUTS:
        raise ConfigError(f"classifier {item.name!r}: features = {features!r}; allowed are {', '.join(INPUTS)}")


CLASSIFIERS: Group[Trainer] = Group(
    "classifier", built_in=("doppelgait.classify.training", "doppelgait.classify.network"), check=check_classifier
)
"""Classifiers by name. Facts: ``features`` (``six``, ``extended``, ``speed``, ``signature``, ...) are its inputs,
``learner`` its name in reports, ``baseline`` marks one that is for comparison only."""


class Kind(NamedTuple):
    """Inputs and training method of a model."""

    features: str
    learner: str


def find_kind(name: str) -> Kind:
    """Return inputs and method of a known model."""
    if name not in CLASSIFIERS:
        allowed = ", ".join(item.name for item in CLASSIFIERS.values() if item.name not in BASELINES)
        raise ConfigError(f"--models: model {name!r} is not known; allowed are {allowed}")
    facts = CLASSIFIERS[name].facts
    return Kind(facts["features"], facts.get("learner", name))


def fit(kind: Kind, train: LabelledRows, held: LabelledRows, *, n_classes: int, seed: int) -> Learned:
    """Train a model."""
    trainers = {item.facts.get("learner", item.name): item.run for item in CLASSIFIERS.values()}
    return trainers[kind.learner](train, held, n_classes=n_classes, seed=seed)


@plugin("classifier", "ensemble", features="extended")
def train_ensemble(train: LabelledRows, held: LabelledRows, *, n_classes: int, seed: int) -> Learned:
    """Train the members and join them."""
    names = [name for name in MEMBERS if name != "signature-network" or train.values.dtype == object]
    learned = []
    for name in names:
        signatures = name == "signature-network"
        views = (part.values[:, -1] if signatures else select_features(part.values) for part in (train, held))
        parts = map(LabelledRows, views, (train.labels, held.labels))
        learned.append(fit(find_kind(name), *parts, n_classes=n_classes, seed=seed))
    return join(learned, held, n_classes=n_classes)


def join(members: Sequence[Learned], held: LabelledRows, *, n_classes: int) -> Learned:
    """Join models to an ensemble, calibrated on held-out rows."""
    calibrations = []
    for member in members:
        values = select_inputs(member, held.values)
        answers = member.log_probability(values) if held.labels.size else np.zeros((0, n_classes))
        calibrations.append(calibrate(answers, held.labels))
    arrays = {f"{name}s": np.array([getattr(found, name) for found in calibrations]) for name in ("slope", "shift")}
    arrays["weights"] = np.full(len(members), 1.0 / len(members))
    return Learned("ensemble", arrays, members=tuple(members))


@plugin("classifier", "chance", features="nothing", learner="majority", baseline=True)
def train_majority(train: LabelledRows, held: LabelledRows, *, n_classes: int, seed: int) -> Learned:
    """Answer that all classes are alike."""
    return Learned("constant", {"log_share": np.full(n_classes, -np.log(n_classes))})


@plugin("classifier", "six-logistic", features="six", learner="logistic")
@plugin("classifier", "extended-logistic", features="extended", learner="logistic")
def train_logistic(train: LabelledRows, held: LabelledRows, *, n_classes: int, seed: int) -> Learned:
    """Fit a logistic regression on standardised features."""
    from sklearn.linear_model import LogisticRegression

    standard, columns = standardise_columns(train.values)
    model = LogisticRegression(max_iter=2000)
    model.fit(columns, train.labels, sample_weight=row_weights(train.labels, n_classes))
    weight, bias = model.coef_, model.intercept_
    if n_classes == 2:
        weight, bias = np.vstack([np.zeros_like(weight), weight]), np.array([0.0, bias[0]])
    return Learned("linear", {**standard, "weight": weight, "bias": bias})


def standardise_columns(values: Inputs) -> tuple[dict[str, Any], FloatArray]:
    """Standardise features; return the arrays of standardisation with floors, and the columns."""
    from sklearn.impute import SimpleImputer
    from sklearn.preprocessing import StandardScaler

    known = [column[~np.isnan(column)] for column in values.T]
    floor = np.array([LOG_FLOOR * np.median(column) if column.size and column.min() >= 0 else 0.0 for column in known])
    imputer, scaler = SimpleImputer(strategy="median", add_indicator=True, keep_empty_features=True), StandardScaler()
    columns = scaler.fit_transform(imputer.fit_transform(take_logarithms(values, floor)))
    told = np.asarray(imputer.indicator_.features_, dtype=np.int64)
    of_columns = {"median": imputer.statistics_, "told": told, "mean": scaler.mean_, "scale": scaler.scale_}
    return of_columns | {"floor": floor}, columns


@plugin("classifier", "six-boosting", features="six", learner="boosting")
@plugin("classifier", "extended-boosting", features="extended", learner="boosting")
@plugin("classifier", "nuisance", features="nuisance", learner="boosting", baseline=True)
@plugin("classifier", "speed", features="speed", learner="boosting", baseline=True)
def train_boosting(train: LabelledRows, held: LabelledRows, *, n_classes: int, seed: int) -> Learned:
    """Fit boosted decision trees, which accept unknown features."""
    import sklearn
    from sklearn.ensemble import HistGradientBoostingClassifier

    known = np.flatnonzero(~np.isnan(train.values).all(axis=0))  # scikit-learn has no bins for what is never known
    if not known.size:
        return train_majority(train, held, n_classes=n_classes, seed=seed)
    model, values = HistGradientBoostingClassifier(**BOOSTING, random_state=seed), train.values[:, known]
    with limit_blas_threads():  # of some thousand rows, threads that wait for each other take longer than one
        model.fit(values, train.labels, sample_weight=row_weights(train.labels, n_classes))
        expected = model.predict_proba(values)
    # A model is kept as plain arrays, but scikit-learn has no public access to these trees. Its
    # private attributes are read here and nowhere else; a version that stores other ones gives one
    # clear error, here or by the comparison.
    try:
        trees = [[tree.nodes for tree in one_round] for one_round in model._predictors]
        every = np.concatenate([part for one_round in trees for part in one_round])
        columns: Iterator[Any] = (every[name].astype(kind) for name, kind in NODE_FIELDS.items())
        leaf, feature, threshold, value, unknown_left, *children = columns
        start = np.ravel(model._baseline_prediction).astype(np.float64)
    except (AttributeError, ValueError) as error:
        raise DatasetError(_OTHER_TREES.format(version=sklearn.__version__, reason=error)) from error
    # Nodes of all trees in one list, of a model that saw these columns.
    sizes = [part.size for one_round in trees for part in one_round]
    first = np.cumsum([0, *sizes[:-1]])
    left, right = (np.where(leaf, 0, child + np.repeat(first, sizes)) for child in children)
    arrays = {
        "feature": np.where(leaf, -1, known[np.where(leaf, 0, feature)]),
        "threshold": np.where(leaf, 0.0, threshold),
        "value": np.where(leaf, value, 0.0),
        "unknown_left": np.where(leaf, 0, unknown_left),
        "left": left,
        "right": right,
        "root": first.reshape(len(trees), len(trees[0])).astype(np.int64),
        "start": start,
    }
    found = Learned("trees", arrays)
    if not np.allclose(np.exp(found.log_probability(train.values)), expected, atol=1e-9):
        raise DatasetError(_OTHER_TREES.format(version=sklearn.__version__, reason="other probabilities"))
    return found


def learn_novelty(train: LabelledRows, held: LabelledRows) -> Novelty:
    """Fit the distribution of training rows about their class means."""
    standard, columns = standardise_columns(train.values)
    classes, labels = np.unique(train.labels, return_inverse=True)
    centre = np.array([columns[labels == number].mean(axis=0) for number in range(classes.size)])
    about = columns - centre[labels]
    covariance = (1.0 - SHRINKAGE) * about.T @ about / len(about) + SHRINKAGE * np.eye(columns.shape[1])
    whitening = np.linalg.cholesky(np.linalg.inv(covariance))
    arrays = {**standard, "centre": centre, "whitening": whitening}
    far = np.sort(Novelty(arrays).distance(held.values)) if held.labels.size else np.zeros(0)
    if far.size > LEVELS:
        far = np.quantile(far, (np.arange(LEVELS) + 0.5) / LEVELS)
    return Novelty({**arrays, "held": far})
