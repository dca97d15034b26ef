"""Models of the sim-to-real studies, trained on synthetic examples alone.

Learners, calibration and exact intervals are those of :mod:`doppelgait.classify`. Of the synthetic movers a fifth is
held back; they stop the network's training, calibrate the probabilities and rank the models. Nothing else is chosen.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from sim_to_real_inputs import SIX, Inputs
from xband_measures import FloatArray

from doppelgait.classify.learned import Inputs as Values
from doppelgait.classify.learned import Learned, Part
from doppelgait.classify.model import Calibration, calibrate
from doppelgait.classify.network import Training, train_network
from doppelgait.classify.patches import Patch
from doppelgait.classify.scores import auc, balanced_accuracy, clopper_pearson
from doppelgait.classify.training import Kind, fit

Bools = npt.NDArray[np.bool_]

PERSON = "human"
REAL = "real/"
"""Begins the group of every real recording; no model is trained on such a row."""
HELD_OF = 5
FEW_SUBJECTS = 10
SETTINGS = Training(most_epochs=25, patience=6, gain_db=2.0, noise_db=3.0)
"""Gain and noise are varied by the images already; more would hide a picture of 20 dB."""
MODELS = {
    "six, logistic": Kind("six", "logistic"),
    "six, boosting": Kind("six", "boosting"),
    "extended, logistic": Kind("extended", "logistic"),
    "extended, boosting": Kind("extended", "boosting"),
    "network": Kind("signature", "network"),
    "speed alone": Kind("speed", "boosting"),
    "chance": Kind("nothing", "majority"),
}
BASELINES = ("speed alone", "chance")


@dataclass(frozen=True, eq=False)
class Fitted:
    """A model that separates people from everything else.

    Parameters
    ----------
    features : str
        What it looks at.
    names : tuple of str
        Features in their order; none for pictures.
    learned : Learned
    calibration : Calibration
    held_loss : float
        Mean negative log-probability of the true class of the held movers.
    held_accuracy : float
        Balanced, of the same.
    """

    features: str
    names: tuple[str, ...]
    learned: Learned
    calibration: Calibration
    held_loss: float
    held_accuracy: float

    def of_person(self, inputs: Inputs) -> FloatArray:
        """Return the calibrated probability of a person, shape (n,)."""
        return self.calibration(self.learned.log_probability(values_of(inputs, self.features, self.names)))[:, 1]


def values_of(inputs: Inputs, features: str, names: Sequence[str]) -> Values:
    """Return the inputs of a model with these features."""
    if features == "signature":
        return inputs.levels
    return inputs.matrix(names) if names else np.zeros((len(inputs), 0))


def told_names(inputs: Inputs, features: str) -> tuple[str, ...]:
    """Return the features of a set that vary; trees need variation."""
    if features in ("signature", "nothing"):
        return ()
    columns = {name: inputs.columns[name] for name in names_of(inputs, features)}
    return tuple(name for name, values in columns.items() if np.unique(values[np.isfinite(values)]).size > 1)


def names_of(inputs: Inputs, features: str) -> list[str]:
    """Return the features of a set.

    The six, the speed, all of the analysis, or the Doppler profile.
    """
    profile = [name for name in inputs.columns if name.startswith("profile_")]
    sets = {
        "six": list(SIX), "speed": [SIX[0]], "profile": profile,
        "extended": [name for name in inputs.columns if name not in profile],
    }  # fmt: skip
    return sets[features]


def numbers_of(labels: npt.NDArray[np.str_]) -> npt.NDArray[np.int64]:
    """Return 1 for people, 0 for all others."""
    return np.asarray(labels == PERSON, dtype=np.int64)


def held_rows(inputs: Inputs) -> Bools:
    """Hold out every fifth target.

    Every fifth row where a class has too few targets (motion capture).
    """
    few = min(np.unique(inputs.groups[inputs.labels == label]).size for label in np.unique(inputs.labels))
    if few < FEW_SUBJECTS:
        return np.asarray(np.arange(len(inputs)) // 2 % HELD_OF == HELD_OF - 1)
    _, first, number = np.unique(inputs.groups, return_index=True, return_inverse=True)
    order = np.argsort(np.argsort(first))
    return np.asarray(order[number] // 2 % HELD_OF == HELD_OF - 1)


def refuse_real(inputs: Inputs) -> None:
    """Refuse real recordings among training examples (ValueError)."""
    real = [group for group in inputs.groups.tolist() if group.startswith(REAL)]
    if real:
        raise ValueError(f"{real[0]} is a real recording; models learn from synthetic examples alone")


def train(kind: Kind, inputs: Inputs, patch: Patch, *, seed: int = 0) -> Fitted:
    """Train a model on synthetic examples.

    Parameters
    ----------
    kind : Kind
    inputs : Inputs
        Synthetic, of both classes.
    patch : Patch
        What the levels were made with.
    seed : int

    Raises
    ------
    ValueError
        If a real recording is among them.
    """
    refuse_real(inputs)
    held = held_rows(inputs)
    names = told_names(inputs, kind.features)
    values, labels = values_of(inputs, kind.features, names), numbers_of(inputs.labels)
    learn, kept = Part(values[~held], labels[~held]), Part(values[held], labels[held])
    if kind.learner == "network":
        learned: Learned = train_network(learn, kept, n_classes=2, seed=seed, spec=patch, settings=SETTINGS)
    else:
        learned = fit(kind, learn, kept, n_classes=2, seed=seed)
    raw = learned.log_probability(kept.values)
    flat = Calibration(1.0, np.zeros(2), 0)
    calibration = flat if kind.learner == "majority" else calibrate(raw, kept.labels)
    told = calibration(raw)
    loss = float(-np.log(np.maximum(told[np.arange(kept.labels.size), kept.labels], 1e-12)).mean())
    right = told.argmax(axis=1) == kept.labels
    return Fitted(kind.features, names, learned, calibration, loss, balanced_accuracy(kept.labels, right, 2))


def select_kinds(kinds: Mapping[str, Kind], names: Iterable[str] | None = None, *, network: bool) -> dict[str, Kind]:
    """Select models by name, without the networks unless they are wanted."""
    chosen = {name: kinds[name] for name in (kinds if names is None else names)}
    return {name: kind for name, kind in chosen.items() if network or kind.learner != "network"}


def train_all(kinds: Mapping[str, Kind], inputs: Inputs, patch: Patch, *, seed: int = 0) -> dict[str, Fitted]:
    """Train every model on the same examples."""
    return {name: train(kind, inputs, patch, seed=seed) for name, kind in kinds.items()}


def best_of(models: Mapping[str, Fitted]) -> str:
    """Return the best model on held-out synthetic targets."""
    return min((name for name in models if name not in BASELINES), key=lambda name: models[name].held_loss)


@dataclass(frozen=True)
class Share:
    """A share with its exact 95 % interval."""

    hits: int
    count: int

    def __str__(self) -> str:
        low, high = clopper_pearson(self.hits, self.count)
        return f"{self.hits}/{self.count} ({100 * low:.0f} to {100 * high:.0f} %)"


def right_of(probability: FloatArray, labels: npt.NDArray[np.str_], wanted: Sequence[str]) -> Share:
    """Count right decisions of some classes at probability one half."""
    chosen = np.isin(labels, list(wanted))
    return Share(int(((probability > 0.5) == (labels == PERSON))[chosen].sum()), int(chosen.sum()))


def domain_auc(synthetic: Inputs, real: Inputs, *, features: str, most: int = 400, seed: int = 0) -> float:
    """Return the AUC of synthetic against real recordings.

    By logistic regression, cross-validated in 5 folds.

    0.5 is not at all. A measure of distance: no model of it says anything about a class.
    """
    from sklearn.model_selection import StratifiedKFold

    rows = np.random.default_rng(seed).permutation(len(synthetic))[:most]
    names = names_of(synthetic, features)
    values = np.concatenate([synthetic.take(rows).matrix(names), real.matrix(names)])
    labels = np.repeat([0, 1], [rows.size, len(real)])
    scores = np.empty(labels.size)
    for learn, test in StratifiedKFold(5, shuffle=True, random_state=seed).split(values, labels):
        found = fit(Kind(features, "logistic"), Part(values[learn], labels[learn]), Part(values[:0], labels[:0]),
                    n_classes=2, seed=seed)  # fmt: skip
        scores[test] = found.log_probability(values[test])[:, 1]
    return auc(scores, labels == 1)


def apart(synthetic: FloatArray, real: FloatArray) -> tuple[float, float]:
    """Return Kolmogorov-Smirnov distance and relative shift of a feature.

    The shift is that of the medians over the synthetic middle spread.
    """
    from scipy.stats import ks_2samp

    one, other = synthetic[np.isfinite(synthetic)], real[np.isfinite(real)]
    if one.size < 2 or other.size < 2:
        return float("nan"), float("nan")
    spread = float(np.subtract(*np.percentile(one, (75, 25)))) / 1.349
    shift = float(np.median(other) - np.median(one)) / spread if spread > 0 else float("nan")
    return float(ks_2samp(one, other).statistic), shift
