"""Scores of probabilities against labels, with intervals.

The intervals allow for rows of one target that are not independent.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pandas as pd

from doppelgait.classify.data import ALARM_CLASS, Rows, collect_inputs
from doppelgait.classify.learned import FloatArray, IntArray
from doppelgait.classify.model import Model, blocked_rows, find_detection_threshold, row_weights

Groups = npt.NDArray[np.str_]
Bools = npt.NDArray[np.bool_]

LEVEL = 0.95
REPLICATES = 2000
FEW_GROUPS = 20  # number of targets in a class below which the interval is exact
CALIBRATION_BINS = 15


class Interval(NamedTuple):
    """A 95 % interval and its method: ``exact`` or ``bootstrap``."""

    low: float
    high: float
    method: str


def count_confusion(labels: IntArray, guesses: IntArray, n_classes: int) -> IntArray:
    """Count rows by true (first axis) and predicted class."""
    counts = np.bincount(labels * n_classes + guesses, minlength=n_classes**2)
    return counts.reshape(n_classes, n_classes).astype(np.int64)


def compute_recalls(labels: IntArray, right: Bools, n_classes: int) -> FloatArray:
    """Return every class's recall, NaN where absent."""
    counts = np.bincount(labels, minlength=n_classes)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.bincount(labels, weights=right, minlength=n_classes) / counts)


def balanced_accuracy(labels: IntArray, right: Bools, n_classes: int) -> float:
    """Return the mean recall, NaN if a class is absent."""
    return float(compute_recalls(labels, right, n_classes).mean())


def clopper_pearson_interval(hits: float, n: float, level: float = LEVEL) -> tuple[float, float]:
    """Return a share's exact interval (Clopper and Pearson 1934)."""
    from scipy.stats import beta

    tail = (1.0 - level) / 2.0
    low = float(beta.ppf(tail, hits, n - hits + 1.0)) if hits > 0 else 0.0
    high = float(beta.ppf(1.0 - tail, hits + 1.0, n - hits)) if n > hits else 1.0
    return low, high


def wilson_interval(right: Bools, groups: Groups, level: float = LEVEL) -> tuple[float, float]:
    """Return a share's exact interval, a trial per target."""
    count = np.unique(groups).size
    return clopper_pearson_interval(float(right.mean()) * count, float(count), level) if count else (0.0, 1.0)


def balanced_interval(
    labels: IntArray, right: Bools, groups: Groups, n_classes: int, rng: np.random.Generator
) -> Interval:
    """Return the interval of the balanced accuracy."""
    present = np.unique(labels)
    if not present.size:
        return Interval(0.0, 1.0, "exact")
    members = [labels == number for number in present]
    plain = all(np.unique(groups[member]).size >= FEW_GROUPS and 0 < right[member].mean() < 1 for member in members)
    if plain:
        weights = weight_groups(labels, groups, rng)
        hits = np.stack([weights[:, member] @ right[member].astype(np.float64) for member in members])
        counts = np.stack([weights[:, member].sum(axis=1) for member in members])
        low, high = np.quantile((hits / np.maximum(counts, 1e-12)).mean(axis=0), [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
        return Interval(float(low), float(high), "bootstrap")
    level = 1.0 - (1.0 - LEVEL) / present.size
    bounds = [wilson_interval(right[member], groups[member], level) for member in members]
    low, high = np.mean(bounds, axis=0)
    return Interval(float(low), float(high), "exact")


def weight_groups(labels: IntArray, groups: Groups, rng: np.random.Generator, *, count: int = REPLICATES) -> FloatArray:
    """Sample bootstrap weights of rows by group."""
    names, member = np.unique(groups, return_inverse=True)
    n_classes = int(labels.max()) + 1
    has = np.zeros((names.size, n_classes), dtype=bool)
    has[member, labels] = True
    stratum = np.unique(has, axis=0, return_inverse=True)[1].ravel()
    weights = np.empty((count, names.size))
    for number in np.unique(stratum):
        inside = np.flatnonzero(stratum == number)
        weights[:, inside] = rng.multinomial(inside.size, np.full(inside.size, 1.0 / inside.size), size=count)
    return weights[:, member]


def auc(scores: FloatArray, positive: Bools, weights: FloatArray | None = None) -> float:
    """Return the area under the ROC curve."""
    # the probability that a positive row scores higher than a negative one, ties counting half
    weight = np.ones(scores.size) if weights is None else weights
    _, place = np.unique(scores, return_inverse=True)
    size = int(place.max()) + 1 if scores.size else 0
    above = np.bincount(place, weights=weight * positive, minlength=size)
    below = np.bincount(place, weights=weight * ~positive, minlength=size)
    total = above.sum() * below.sum()
    if not total > 0:
        return float("nan")
    return float((above * (np.cumsum(below) - below / 2.0)).sum() / total)


def auc_interval(
    scores: FloatArray, positive: Bools, groups: Groups, rng: np.random.Generator
) -> tuple[float, float] | None:
    """Return the AUC's bootstrap interval over targets, or None."""
    few = min(np.unique(groups[positive]).size, np.unique(groups[~positive]).size) < FEW_GROUPS
    if few or auc(scores, positive) in (0.0, 1.0):
        return None
    weights = weight_groups(positive.astype(np.int64), groups, rng, count=500)
    low, high = np.quantile([auc(scores, positive, row) for row in weights], [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return float(low), float(high)


def roc(scores: FloatArray, positive: Bools) -> tuple[FloatArray, FloatArray]:
    """Return false and true positive rates."""
    order = np.argsort(-scores, kind="stable")
    last = np.append(np.flatnonzero(np.diff(scores[order])), scores.size - 1)
    hits, alarms = np.cumsum(positive[order])[last], np.cumsum(~positive[order])[last]
    found = [np.concatenate([[0.0], counts / max(counts[-1], 1)]) for counts in (alarms, hits)]
    return found[0], found[1]


def brier(probability: FloatArray, labels: IntArray, weights: FloatArray) -> float:
    """Return the Brier score, from 0 to 1."""
    wrong = probability.copy()
    wrong[np.arange(labels.size), labels] -= 1.0
    return float(np.average(0.5 * (wrong**2).sum(axis=1), weights=weights))


def bin_reliability(confidence: FloatArray, right: Bools, weights: FloatArray, lowest: float) -> list[dict[str, float]]:
    """Return confidence and accuracy in bins of confidence."""
    edges = np.linspace(lowest, 1.0, CALIBRATION_BINS + 1)
    place = np.clip(np.searchsorted(edges, confidence, side="right") - 1, 0, CALIBRATION_BINS - 1)
    found = []
    for number in np.unique(place):
        inside = place == number
        found.append(
            {
                "confidence": float(np.average(confidence[inside], weights=weights[inside])),
                "accuracy": float(np.average(right[inside], weights=weights[inside])),
                "share": float(weights[inside].sum() / weights.sum()),
                "n": int(inside.sum()),
            }
        )
    return found


def expected_calibration_error(bins: list[dict[str, float]]) -> float:
    """Return the expected calibration error over bins of :func:`bin_reliability`."""
    return float(sum(entry["share"] * abs(entry["confidence"] - entry["accuracy"]) for entry in bins))


DETECTED_SHARE = 0.95
MOST_POINTS = 200  # maximum number of stored points of a ROC curve
MOST_BINS = 12
NOT_ALL = "not all classes are tested"
"""Entry instead of an interval if only recalls exist, but no balanced accuracy."""


@dataclass(frozen=True, eq=False)
class Answers:
    """Predictions of a model for test rows."""

    index: pd.DataFrame
    labels: IntArray
    groups: Groups
    classes: tuple[str, ...]
    probability: FloatArray
    threshold: FloatArray
    decided: Bools
    alarm: str = ALARM_CLASS

    @property
    def guesses(self) -> IntArray:
        """Most likely class of every row, shape (n,)."""
        return np.asarray(self.probability.argmax(axis=1), dtype=np.int64)

    @property
    def right(self) -> Bools:
        """Rows with the correct class as the most likely one."""
        return np.asarray(self.guesses == self.labels)


def compute_scores(answers: Answers, *, seed: int) -> dict[str, Any]:
    """Compute every overall score of a model, for JSON."""
    n_classes = len(answers.classes)
    weights = row_weights(answers.labels, n_classes)
    bins = bin_reliability(answers.probability.max(axis=1), answers.right, weights, 1.0 / n_classes)
    detected = answers.classes
    if n_classes <= 2:  # one curve, of the alarm class if it exists
        detected = (answers.alarm,) if answers.alarm in answers.classes else answers.classes[:1]
    curves: dict[str, dict[str, Any]] = {}
    for name in detected:
        number = answers.classes.index(name)
        probability, positive = answers.probability[:, number], answers.labels == number
        if not 0 < positive.sum() < positive.size:
            curves[name] = {"auc": float("nan"), "low": None, "high": None, "false": [], "true": []}
            continue
        low, high = auc_interval(probability, positive, answers.groups, np.random.default_rng(seed)) or (None, None)
        false, true = roc(probability, positive)
        kept = np.unique(np.linspace(0, false.size - 1, MOST_POINTS).round().astype(int))
        area, points = auc(probability, positive), {"false": false[kept].tolist(), "true": true[kept].tolist()}
        curves[name] = {"auc": area, "low": low, "high": high, **points}
    return {
        "balanced_accuracy": _score_balanced(answers, np.ones(len(answers.labels), dtype=bool), seed),
        "accuracy": float(answers.right.mean()),
        "recall": {name: _score_share(answers, answers.labels == n) for n, name in enumerate(answers.classes)},
        "confusion": count_confusion(answers.labels, answers.guesses, n_classes).tolist(),
        "roc": curves,
        "brier": brier(answers.probability, answers.labels, weights),
        "expected_calibration_error": expected_calibration_error(bins),
        "reliability": bins,
        "alarm": find_alarm_point(answers),
        "decided": {
            "share": float(answers.decided.mean()),
            "n": int(answers.decided.sum()),
            "balanced_accuracy": _score_balanced(answers, answers.decided, seed),
        },
    }


def _score_balanced(answers: Answers, chosen: Bools, seed: int) -> dict[str, Any]:
    labels, right = answers.labels[chosen], answers.right[chosen]
    n_classes = len(answers.classes)
    if np.unique(labels).size < n_classes:
        return {"value": None, "low": None, "high": None, "interval": NOT_ALL}
    found = balanced_interval(labels, right, answers.groups[chosen], n_classes, np.random.default_rng(seed))
    value = balanced_accuracy(labels, right, n_classes)
    return {"value": value, "low": found.low, "high": found.high, "interval": found.method}


def _score_share(answers: Answers, chosen: Bools) -> dict[str, Any]:
    """Return the accuracy of some rows with its exact interval."""
    low, high = wilson_interval(answers.right[chosen], answers.groups[chosen])
    count = int(chosen.sum())
    return {
        "value": float(answers.right[chosen].mean()) if count else float("nan"),
        "low": low,
        "high": high,
        "n": count,
        "movers": int(np.unique(answers.groups[chosen]).size),
    }


def find_alarm_point(answers: Answers) -> dict[str, Any] | None:
    """Compute alarm rates at 95 % detection, or None."""
    # ``held``: with the threshold of the held-out rows, as in use
    if answers.alarm not in answers.classes:
        return None
    number = answers.classes.index(answers.alarm)
    probability, positive = answers.probability[:, number], answers.labels == number
    if not 0 < positive.sum() < positive.size:
        return None
    own = find_detection_threshold(probability, positive, DETECTED_SHARE)
    found: dict[str, Any] = {
        "detected_share": DETECTED_SHARE,
        "curve": _compute_alarm_rates(answers, probability >= own),
    }
    if np.isfinite(answers.threshold).all():
        found["held"] = _compute_alarm_rates(answers, probability >= answers.threshold)
    return found


def _compute_alarm_rates(answers: Answers, triggers: Bools) -> dict[str, Any]:
    """Return the share of every class that triggers."""
    found = {}
    for number, name in enumerate(answers.classes):
        member = answers.labels == number
        if member.any():
            low, high = wilson_interval(triggers[member], answers.groups[member])
            found[name] = {"value": float(triggers[member].mean()), "low": low, "high": high, "n": int(member.sum())}
    return found


@dataclass(frozen=True)
class Condition:
    """A condition of which accuracy is plotted."""

    name: str
    words: str
    columns: tuple[str, ...]
    step: float


CONDITIONS = (
    Condition("snr", "SNR of the signature (dB)", ("quality_snr_mu_db", "snr_frame_db"), 5.0),
    Condition("aspect", "angle between motion and line of sight (°)", ("truth_aspect_deg", "quality_aspect_deg"), 15.0),
    Condition("observation", "observation time (s)", ("quality_observation_s", "observation_s"), 1.0),
    Condition(
        "speed",
        "speed (m/s)",
        ("truth_ground_speed_mps", "quality_ground_speed_mps", "feature_torso_velocity_mps"),
        0.5,
    ),
)


def find_condition_values(index: pd.DataFrame, condition: Condition) -> tuple[str, FloatArray]:
    """Return a condition's best known column and values."""
    for column in condition.columns:
        if column not in index:
            continue
        values = pd.to_numeric(index[column], errors="coerce").to_numpy(dtype=np.float64, na_value=np.nan)
        values = np.where(np.isfinite(values), values, np.nan)
        if np.isfinite(values).mean() < 0.5:
            continue
        if condition.name == "aspect":
            values = np.degrees(np.arccos(np.abs(np.cos(np.radians(values)))))
        return column, np.abs(values) if condition.name == "speed" else values
    return "", np.full(len(index), np.nan)


def make_bin_edges(values: FloatArray, step: float) -> FloatArray:
    """Return even bin edges, 12 bins at most."""
    known = values[np.isfinite(values)]
    if not known.size:
        return np.zeros(0)
    while True:
        low, high = np.floor(known.min() / step), np.floor(known.max() / step) + 1
        if high - low <= MOST_BINS:
            return np.asarray(np.arange(low, high + 1) * step)
        step *= 2.0


def score_bins(answers: Answers, values: FloatArray, edges: FloatArray, *, seed: int) -> list[dict[str, Any]]:
    """Return balanced accuracy and recalls in bins of a condition."""
    found = []
    for low, high in pairwise(edges.tolist()):
        inside = (values >= low) & (values < high)
        if inside.any():
            found.append(
                {
                    "from": float(low),
                    "to": float(high),
                    "n": int(inside.sum()),
                    **_score_balanced(answers, inside, seed),
                    "recall": {
                        name: _score_share(answers, inside & (answers.labels == n))
                        for n, name in enumerate(answers.classes)
                        if (inside & (answers.labels == n)).any()
                    },
                }
            )
    return found


BREAKDOWNS = ("truth_gait", "motion_kind", "source", "subject", "session")
MOST_VALUES = 40


def score_groups(answers: Answers, texts: npt.NDArray[np.str_]) -> list[dict[str, Any]]:
    """Return every class's accuracy per value of a column."""
    return [
        {"value": value, "label": name, **{f"share_{k}" if k == "value" else k: v for k, v in shares.items()}}
        for value in np.unique(texts).tolist()
        for number, name in enumerate(answers.classes)
        if (member := (texts == value) & (answers.labels == number)).any()
        for shares in (_score_share(answers, member),)
    ]


def open_set_scores(model: Model, tested: Any, unknown: Rows) -> dict[str, Any]:
    """Score the abstention from every unknown kind."""
    table = collect_inputs(unknown, model.facts.features)
    known_rank, known_sure = _score_novelty(model, tested)
    rank, sure = _score_novelty(model, table.values)
    blocked = blocked_rows(unknown, np.arange(len(unknown)), table.values, model)
    decided = ~blocked & (sure >= model.facts.abstain_below)
    guesses = model.probability(table.values).argmax(axis=1)
    found: dict[str, Any] = {}
    labels = unknown.index["label"].to_numpy(dtype=str)
    for label in np.unique(labels):
        own = labels == label
        novel = np.concatenate([np.zeros(len(known_sure), dtype=bool), np.ones(int(own.sum()), dtype=bool)])
        shares = {
            name: float((decided & (guesses == number))[own].mean()) for number, name in enumerate(unknown.classes)
        }
        found[str(label)] = {
            "n": int(own.sum()),
            "auc": None if rank is None or known_rank is None else auc(np.concatenate([known_rank, rank[own]]), novel),
            "auc_of_probability": auc(-np.concatenate([known_sure, sure[own]]), novel),
            "decided": shares,
        }
    return found


def _score_novelty(model: Model, values: Any) -> tuple[FloatArray | None, FloatArray]:
    """Return distance if measured, and highest probability."""
    far = None if model.novelty is None else model.novelty.distance(values)
    return far, np.asarray(model.probability(values).max(axis=1))
