"""Models by name: what each looks at and how it learns."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import numpy as np

from doppelgait.classify.learned import Constant, IntArray, Learned, Linear, Part, Trees
from doppelgait.classify.model import class_weights
from doppelgait.core.errors import ConfigError, DatasetError
from doppelgait.core.plugins import Group, plugin
from doppelgait.core.worker import one_blas_thread


class Trainer(Protocol):
    """What a plug-in of the group ``classifier`` is: a function that trains."""

    def __call__(self, train: Part, held: Part, *, n_classes: int, seed: int) -> Learned:
        """Train on the first rows; the others, of other movers, only say when to stop."""


CLASSIFIERS: Group[Trainer] = Group(
    "classifier", built_in=("doppelgait.classify.training", "doppelgait.classify.network")
)
"""Classifiers by name. Facts: ``features`` (``six``, ``extended``, ``speed``, ``signature``, ...) is what one looks at,
``learner`` what it is called in reports, ``baseline`` whether it is for comparison only."""

BUILT_IN = ("six-logistic", "six-boosting", "extended-logistic", "extended-boosting", "signature-network")
BASELINES = ("chance", "nuisance", "speed")
"""Reported with every score: the most frequent class, the nuisance parameters alone, and the speed alone."""


class Kind(NamedTuple):
    """What a model looks at, and how it learns."""

    features: str
    learner: str


def model_names() -> list[str]:
    """Names of the classifiers that are no baselines: the built-in ones, then those of other packages."""
    return [*BUILT_IN, *(item.name for item in CLASSIFIERS.values() if item.name not in BUILT_IN + BASELINES)]


BOOSTING = {
    "max_iter": 150, "learning_rate": 0.08, "max_leaf_nodes": 15, "min_samples_leaf": 10, "l2_regularization": 1.0,
    "early_stopping": False,
}  # fmt: skip
"""Chosen once, before any test set was looked at."""


def kind_of(name: str) -> Kind:
    """Model of a name; an unknown one is a :class:`ConfigError`."""
    if name not in CLASSIFIERS:
        raise ConfigError(f"--models: model {name!r} is not known; allowed are {', '.join(model_names())}")
    facts = CLASSIFIERS[name].facts
    return Kind(facts["features"], facts.get("learner", name))


def fit(kind: Kind, train: Part, held: Part, *, n_classes: int, seed: int) -> Learned:
    """Train a model.

    Parameters
    ----------
    kind : Kind
    train : Part
        At least one row of every class.
    held : Part
        Rows of other movers; only the network looks at them, to stop in time. May be empty.
    n_classes : int
    seed : int
        Same seed, same rows, same machine: same model.

    Raises
    ------
    DatasetError
        If torch is needed and missing.
    """
    trainers = {item.facts.get("learner", item.name): item.run for item in CLASSIFIERS.values()}
    return trainers[kind.learner](train, held, n_classes=n_classes, seed=seed)


@plugin("classifier", "chance", features="nothing", learner="majority", baseline=True)
def train_majority(train: Part, held: Part, *, n_classes: int, seed: int) -> Constant:
    """Be certain of the most frequent class; the first of them if there are several."""
    shares = np.full(n_classes, 1e-9)
    shares[np.bincount(train.labels, minlength=n_classes).argmax()] = 1.0
    return Constant(np.log(shares / shares.sum()))


@plugin("classifier", "six-logistic", features="six", learner="logistic")
@plugin("classifier", "extended-logistic", features="extended", learner="logistic")
def train_logistic(train: Part, held: Part, *, n_classes: int, seed: int) -> Linear:
    """Fit a logistic regression on standardised features."""
    from sklearn.impute import SimpleImputer
    from sklearn.linear_model import LogisticRegression
    from sklearn.preprocessing import StandardScaler

    imputer = SimpleImputer(strategy="median", add_indicator=True, keep_empty_features=True)
    scaler, model = StandardScaler(), LogisticRegression(max_iter=2000)
    columns = scaler.fit_transform(imputer.fit_transform(train.values))
    model.fit(columns, train.labels, sample_weight=class_weights(train.labels, n_classes))
    weight, bias = model.coef_, model.intercept_
    if n_classes == 2:
        weight, bias = np.vstack([np.zeros_like(weight), weight]), np.array([0.0, bias[0]])
    told = np.asarray(imputer.indicator_.features_, dtype=np.int64)
    return Linear(imputer.statistics_, told, scaler.mean_, scaler.scale_, weight, bias)


@plugin("classifier", "six-boosting", features="six", learner="boosting")
@plugin("classifier", "extended-boosting", features="extended", learner="boosting")
@plugin("classifier", "nuisance", features="nuisance", learner="boosting", baseline=True)
@plugin("classifier", "speed", features="speed", learner="boosting", baseline=True)
def train_boosting(train: Part, held: Part, *, n_classes: int, seed: int) -> Learned:
    """Fit boosted decision trees, which take unknown features as they are."""
    from sklearn.ensemble import HistGradientBoostingClassifier

    known = np.flatnonzero(~np.isnan(train.values).all(axis=0))  # scikit-learn has no bins for what is never known
    if not known.size:
        return train_majority(train, held, n_classes=n_classes, seed=seed)
    model, values = HistGradientBoostingClassifier(**BOOSTING, random_state=seed), train.values[:, known]
    with one_blas_thread():  # of some thousand rows, threads that wait for each other take longer than one
        model.fit(values, train.labels, sample_weight=class_weights(train.labels, n_classes))
        expected = model.predict_proba(values)
    # Nodes of all trees in one list, of a model that saw these columns.
    trees = [[tree.nodes for tree in one_round] for one_round in model._predictors]
    nodes = [part for one_round in trees for part in one_round]
    first = np.cumsum([0, *(part.size for part in nodes[:-1])])
    shift = np.repeat(first, [part.size for part in nodes])
    every = np.concatenate(nodes)
    leaf = every["is_leaf"] > 0

    def whole(values: Any) -> IntArray:
        return np.where(leaf, 0, values).astype(np.int64)

    found = Trees(
        feature=np.where(leaf, -1, known[np.where(leaf, 0, every["feature_idx"])]),
        threshold=np.where(leaf, 0.0, every["num_threshold"]),
        value=np.where(leaf, every["value"], 0.0),
        unknown_left=whole(every["missing_go_to_left"]),
        left=whole(every["left"].astype(np.int64) + shift),
        right=whole(every["right"].astype(np.int64) + shift),
        root=first.reshape(len(trees), len(trees[0])).astype(np.int64),
        start=np.ravel(model._baseline_prediction).astype(np.float64),
    )
    if not np.allclose(np.exp(found.log_probability(train.values)), expected, atol=1e-9):
        raise DatasetError("this version of scikit-learn keeps its trees in another way; install another one")
    return found
