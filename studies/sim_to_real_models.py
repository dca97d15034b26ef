"""Models of the X-band study, trained on synthetic examples alone.

Learners, calibration, ensemble and exact intervals are those of :mod:`doppelgait.classify`. Of the synthetic targets a
fifth is held back; they stop the network's training, calibrate the probabilities and set the novelty threshold.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from sim_to_real_inputs import SIX, Inputs
from xband_measures import FloatArray

from doppelgait.classify.learned import Inputs as Values
from doppelgait.classify.learned import LabelledRows, Learned, join_inputs
from doppelgait.classify.model import Calibration, calibrate
from doppelgait.classify.network import Training, train_network
from doppelgait.classify.scorer import standardise
from doppelgait.classify.scores import auc, balanced_accuracy
from doppelgait.classify.training import Kind, fit, join
from doppelgait.processing.patches import Patch

Bools = npt.NDArray[np.bool_]

REAL = "real/"
"""Begins the group of every real recording; no model is trained on such a row."""
HELD_OF = 5
SHRINKAGE = 0.1
"""Of a covariance towards that of independent columns; a round number, assumed."""
SETTINGS = Training(most_epochs=25, patience=6, gain_db=2.0, noise_db=3.0, stretch=1.0, widening=0.0)
"""Gain and noise are varied by the images already; more would hide a picture of 20 dB. The carrier is known and the
speeds are drawn, so that no axis is stretched."""
MODELS = {
    "six, logistic": Kind("six", "logistic"),
    "six, boosting": Kind("six", "boosting"),
    "extended, logistic": Kind("extended", "logistic"),
    "extended, boosting": Kind("extended", "boosting"),
    "network": Kind("signature", "network"),
    "ensemble": Kind("all", "ensemble"),
    "speed alone": Kind("speed", "boosting"),
    "chance": Kind("nothing", "majority"),
}
MEMBERS = ("extended, logistic", "extended, boosting", "network")
"""Models whose calibrated log-odds the ensemble averages."""


@dataclass(frozen=True, eq=False)
class Fitted:
    """A trained model."""

    features: str
    names: tuple[str, ...]
    classes: tuple[str, ...]
    learned: Learned
    calibration: Calibration
    held_accuracy: float

    def probability(self, inputs: Inputs) -> FloatArray:
        """Return calibrated probabilities, shape (n, n_classes)."""
        return self.calibration(self.learned.log_probability(values_of(inputs, self.features, self.names)))


def values_of(inputs: Inputs, features: str, names: Sequence[str]) -> Values:
    """Return the inputs of a model with these features."""
    if features == "signature":
        return inputs.levels
    if features == "all":
        return join_inputs(inputs.matrix(names), inputs.levels)
    return inputs.matrix(names) if names else np.zeros((len(inputs), 0))


def told_names(inputs: Inputs, features: str) -> tuple[str, ...]:
    """Return the features of a set that vary; trees need variation."""
    if features in ("signature", "nothing"):
        return ()
    columns = {name: inputs.columns[name] for name in names_of(inputs, features)}
    return tuple(name for name, values in columns.items() if np.unique(values[np.isfinite(values)]).size > 1)


def names_of(inputs: Inputs, features: str) -> list[str]:
    """Return the features of a set. The six, the speed, or all of the analysis."""
    everything = list(inputs.columns)
    return {"six": list(SIX), "speed": [SIX[0]], "extended": everything, "all": everything}[features]


def numbers_of(labels: npt.NDArray[np.str_], classes: Sequence[str]) -> npt.NDArray[np.int64]:
    """Return the number of the class of every label."""
    return np.array([classes.index(label) for label in labels.tolist()], dtype=np.int64)


def held_rows(inputs: Inputs) -> Bools:
    """Hold out every fifth target."""
    _, first, number = np.unique(inputs.groups, return_index=True, return_inverse=True)
    order = np.argsort(np.argsort(first))
    return np.asarray(order[number] // 2 % HELD_OF == HELD_OF - 1)


def refuse_real(inputs: Inputs) -> None:
    """Refuse real recordings among training examples (ValueError)."""
    real = [group for group in inputs.groups.tolist() if group.startswith(REAL)]
    if real:
        raise ValueError(f"{real[0]} is a real recording; models learn from synthetic examples alone")


def train_all(
    inputs: Inputs, patch: Patch, *, classes: tuple[str, ...], seed: int = 0, network: bool = True
) -> dict[str, Fitted]:  # fmt: skip
    """Train every model on the same synthetic examples."""
    refuse_real(inputs)
    held, n_classes = held_rows(inputs), len(classes)
    labels, found = numbers_of(inputs.labels, classes), {}
    members: list[Learned] = []
    for name, kind in MODELS.items():
        if kind.learner == "network" and not network:
            continue
        features = "extended" if kind.features == "all" and not network else kind.features
        names = told_names(inputs, features)
        values = values_of(inputs, features, names)
        learn, kept = LabelledRows(values[~held], labels[~held]), LabelledRows(values[held], labels[held])
        if kind.learner == "network":
            learned: Learned = train_network(learn, kept, n_classes=n_classes, seed=seed, spec=patch, settings=SETTINGS)
        elif kind.learner == "ensemble":
            learned = join(members, kept, n_classes=n_classes)
        else:
            learned = fit(kind, learn, kept, n_classes=n_classes, seed=seed)
        members += [learned] if name in MEMBERS else []
        raw = learned.log_probability(kept.values)
        flat = Calibration(1.0, np.zeros(n_classes), 0)
        calibration = flat if kind.learner == "majority" else calibrate(raw, kept.labels)
        right = calibration(raw).argmax(axis=1) == kept.labels
        accuracy = balanced_accuracy(kept.labels, right, n_classes)
        found[name] = Fitted(features, names, classes, learned, calibration, accuracy)
    return found


def novelty_of(fitted: Mapping[str, Fitted], learn: Inputs, held: Inputs) -> Callable[[Inputs], FloatArray]:
    """Return a novelty score, fitted to synthetic rows alone.

    Squared Mahalanobis distance of the standardised features from the nearest class, and the same of the network's last
    layer. The larger of both counts, each by the share of held rows that are as far, as -log of that share.
    """
    linear = fitted["extended, logistic"]
    own = linear.learned.arrays
    views: list[Callable[[Inputs], FloatArray]] = [lambda inputs: standardise(own, inputs.matrix(linear.names))]
    if "network" in fitted:
        views.append(lambda inputs: last_layer(fitted["network"].learned, inputs.levels))
    labels = numbers_of(learn.labels, linear.classes)
    distances = [class_distance(view(learn), labels) for view in views]
    known = [np.sort(distance(view(held))) for view, distance in zip(views, distances, strict=True)]

    def judge(inputs: Inputs) -> FloatArray:
        parts = []
        for view, distance, far in zip(views, distances, known, strict=True):
            found = distance(view(inputs))
            beyond = far.size - np.searchsorted(far, found)
            tail = (1.0 + beyond) / (1.0 + far.size)
            parts.append(-np.log(tail) + 1e-6 * found / far[-1])
        return np.asarray(np.max(parts, axis=0))

    return judge


def class_distance(columns: FloatArray, labels: npt.NDArray[np.int64]) -> Callable[[FloatArray], FloatArray]:
    """Return the squared Mahalanobis distance from the nearest class. By the covariance within classes."""
    means = np.array([columns[labels == number].mean(axis=0) for number in range(labels.max() + 1)])
    rest = columns - means[labels]
    covariance = rest.T @ rest / len(rest)
    size = covariance.shape[0]
    ridge = SHRINKAGE * float(np.trace(covariance)) / size * np.eye(size)
    inverse = np.linalg.inv((1.0 - SHRINKAGE) * covariance + ridge)

    def distance(found: FloatArray) -> FloatArray:
        apart = found[:, None] - means
        return np.asarray(np.einsum("nkd,de,nke->nk", apart, inverse, apart).min(axis=1))

    return distance


def last_layer(network: Learned, levels: npt.NDArray[Any]) -> FloatArray:
    """Return the inputs of a network's last layer, shape (n, n_last)."""
    count = network.arrays["weight"].shape[1]
    weight = np.eye(count + 1, count, dtype=np.float32)  # one score that is 0 undoes the normalisation of the others
    last = {"weight": weight, "bias": np.zeros(count + 1, dtype=np.float32)}
    scores = replace(network, arrays={**network.arrays, **last}).log_probability(levels)
    return np.asarray(scores[:, :-1] - scores[:, -1:])


def domain_auc(synthetic: Inputs, real: Inputs, *, features: str, most: int = 400, seed: int = 0) -> float:
    """Return the AUC of synthetic against real recordings.

    By logistic regression, cross-validated in 5 folds. 0.5 is not at all. A measure of distance: no model of it says
    anything about a class.
    """
    from sklearn.model_selection import StratifiedKFold

    rows = np.random.default_rng(seed).permutation(len(synthetic))[:most]
    names = names_of(synthetic, features)
    values = np.concatenate([synthetic.take(rows).matrix(names), real.matrix(names)])
    labels = np.repeat([0, 1], [rows.size, len(real)])
    scores = np.empty(labels.size)
    for learn, test in StratifiedKFold(5, shuffle=True, random_state=seed).split(values, labels):
        found = fit(
            Kind(features, "logistic"),
            LabelledRows(values[learn], labels[learn]),
            LabelledRows(values[:0], labels[:0]),
            n_classes=2,
            seed=seed,
        )
        scores[test] = found.log_probability(values[test])[:, 1]
    return auc(scores, labels == 1)
