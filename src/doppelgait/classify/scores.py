"""Scores of probabilities against labels, with intervals that know that rows of one mover are no independent trials."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from doppelgait.classify.learned import FloatArray, IntArray

Groups = npt.NDArray[np.str_]
Bools = npt.NDArray[np.bool_]

LEVEL = 0.95
REPLICATES = 2000
FEW_GROUPS = 20
"""With fewer movers in a class the interval is the exact one."""
CALIBRATION_BINS = 15


class Interval(NamedTuple):
    """A 95 % interval and how it was found: ``exact`` or ``bootstrap``."""

    low: float
    high: float
    method: str


def confusion(labels: IntArray, guesses: IntArray, n_classes: int) -> IntArray:
    """Rows by their class (first axis) and by what they were taken for."""
    counts = np.bincount(labels * n_classes + guesses, minlength=n_classes**2)
    return counts.reshape(n_classes, n_classes).astype(np.int64)


def recalls(labels: IntArray, right: Bools, n_classes: int) -> FloatArray:
    """Share of every class that is right; NaN for a class that does not occur."""
    counts = np.bincount(labels, minlength=n_classes)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.bincount(labels, weights=right, minlength=n_classes) / counts)


def balanced_accuracy(labels: IntArray, right: Bools, n_classes: int) -> float:
    """Mean of the recalls of all classes; NaN where one does not occur: the recall of one alone is no accuracy."""
    return float(recalls(labels, right, n_classes).mean())


def clopper_pearson(hits: float, n: float, level: float = LEVEL) -> tuple[float, float]:
    """Exact interval of a share: hits among n trials (Clopper and Pearson 1934); (0, 1) without trials."""
    from scipy.stats import beta

    tail = (1.0 - level) / 2.0
    low = float(beta.ppf(tail, hits, n - hits + 1.0)) if hits > 0 else 0.0
    high = float(beta.ppf(1.0 - tail, hits + 1.0, n - hits)) if n > hits else 1.0
    return low, high


def share_interval(right: Bools, groups: Groups, level: float = LEVEL) -> tuple[float, float]:
    """Exact interval of a share of rows, as if every mover were one trial: wide enough where its rows are all alike."""
    count = np.unique(groups).size
    return clopper_pearson(float(right.mean()) * count, float(count), level) if count else (0.0, 1.0)


def balanced_interval(
    labels: IntArray, right: Bools, groups: Groups, n_classes: int, rng: np.random.Generator
) -> Interval:
    """Interval of the balanced accuracy.

    With 20 movers or more in every class that occurs and both hits and errors there: percentiles of a bootstrap over
    movers, those of each class (or set of classes) for themselves. Otherwise, where a bootstrap would be too sure: the
    mean of exact intervals of every class's share at the level that holds for all of them together.
    """
    present = np.unique(labels)
    if not present.size:
        return Interval(0.0, 1.0, "exact")
    members = [labels == number for number in present]
    plain = all(
        np.unique(groups[member]).size >= FEW_GROUPS and 0 < right[member].mean() < 1 for member in members
    )  # fmt: skip
    if plain:
        weights = group_weights(labels, groups, rng)
        hits = np.stack([weights[:, member] @ right[member].astype(np.float64) for member in members])
        counts = np.stack([weights[:, member].sum(axis=1) for member in members])
        low, high = np.quantile((hits / np.maximum(counts, 1e-12)).mean(axis=0), [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
        return Interval(float(low), float(high), "bootstrap")
    level = 1.0 - (1.0 - LEVEL) / present.size
    bounds = [share_interval(right[member], groups[member], level) for member in members]
    low, high = np.mean(bounds, axis=0)
    return Interval(float(low), float(high), "exact")


def group_weights(labels: IntArray, groups: Groups, rng: np.random.Generator, *, count: int = REPLICATES) -> FloatArray:
    """How often every row is in each bootstrap sample of groups, drawn among those with the same classes.

    Returns
    -------
    ndarray, shape (count, n)
    """
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
    """Probability that a positive row scores higher than a negative one, ties counting half; NaN with one kind."""
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
    """Percentiles of a bootstrap over movers; None where a kind has fewer than 20 of them or nothing overlaps."""
    few = min(np.unique(groups[positive]).size, np.unique(groups[~positive]).size) < FEW_GROUPS
    if few or auc(scores, positive) in (0.0, 1.0):
        return None
    weights = group_weights(positive.astype(np.int64), groups, rng, count=500)
    low, high = np.quantile([auc(scores, positive, row) for row in weights], [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return float(low), float(high)


def roc(scores: FloatArray, positive: Bools) -> tuple[FloatArray, FloatArray]:
    """Share of negative and of positive rows at or above every threshold, from (0, 0) to (1, 1)."""
    order = np.argsort(-scores, kind="stable")
    last = np.append(np.flatnonzero(np.diff(scores[order])), scores.size - 1)
    hits, alarms = np.cumsum(positive[order])[last], np.cumsum(~positive[order])[last]
    found = [np.concatenate([[0.0], counts / max(counts[-1], 1)]) for counts in (alarms, hits)]
    return found[0], found[1]


def brier(probability: FloatArray, labels: IntArray, weights: FloatArray) -> float:
    """Mean squared error of the probabilities, half the sum over classes: from 0 to 1."""
    wrong = probability.copy()
    wrong[np.arange(labels.size), labels] -= 1.0
    return float(np.average(0.5 * (wrong**2).sum(axis=1), weights=weights))


def reliability(confidence: FloatArray, right: Bools, weights: FloatArray, lowest: float) -> list[dict[str, float]]:
    """Confidence and share that is right in 15 even bins from the lowest possible confidence to 1; no empty ones."""
    edges = np.linspace(lowest, 1.0, CALIBRATION_BINS + 1)
    place = np.clip(np.searchsorted(edges, confidence, side="right") - 1, 0, CALIBRATION_BINS - 1)
    found = []
    for number in np.unique(place):
        inside = place == number
        found.append({
            "confidence": float(np.average(confidence[inside], weights=weights[inside])),
            "accuracy": float(np.average(right[inside], weights=weights[inside])),
            "share": float(weights[inside].sum() / weights.sum()),
            "n": int(inside.sum()),
        })  # fmt: skip
    return found


def expected_calibration_error(bins: list[dict[str, float]]) -> float:
    """Mean distance of confidence and accuracy over the bins of :func:`reliability`, by their share of the rows."""
    return float(sum(entry["share"] * abs(entry["confidence"] - entry["accuracy"]) for entry in bins))
