"""Scores of probabilities against labels, with intervals.

The intervals allow for rows of one target that are not independent.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pandas as pd

from doppelgait.classify.data import Rows, collect_inputs, read_numbers, take_rows
from doppelgait.classify.learned import FloatArray, Inputs, IntArray
from doppelgait.classify.model import Model, blocked_rows, find_detection_threshold, row_weights

Groups = npt.NDArray[np.str_]
Bools = npt.NDArray[np.bool_]

LEVEL = 0.95
REPLICATES = 2000
FEW_GROUPS = 20  # number of targets in a class below which the interval is exact
CALIBRATION_BINS = 15  # of the calibration error
MAX_DOTS, MIN_IN_BIN = 10, 10  # bins of the calibration diagram, and rows in each
DETECTED_SHARE = 0.95
FALSE_SHARE, LEAST_DETECTED = 0.002, 0.8  # of tracks: share of recordings without a person, and least of people
MOST_POINTS = 200  # maximum number of stored points of a ROC curve
MOST_BINS = 12
NOT_ALL = "not all classes are tested"
"""Entry instead of an interval if only recalls exist, but no balanced accuracy."""

BREAKDOWNS = ("truth_gait", "motion_kind", "source", "subject", "session")
MOST_VALUES = 40


def balanced_accuracy(labels: IntArray, right: Bools, n_classes: int) -> float:
    """Return the mean recall, NaN if a class is absent."""
    counts, hits = (np.bincount(labels, weights=each, minlength=n_classes) for each in (None, right))
    return float((hits / np.where(counts > 0, counts, np.nan)).mean())


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


def score_balanced(answers: Answers, seed: int) -> dict[str, Any]:
    """Return the balanced accuracy with its interval, ``bootstrap`` or ``exact``."""
    labels, right, groups, n_classes = answers.labels, answers.right, answers.groups, len(answers.classes)
    members = [labels == number for number in range(n_classes)]
    if not all(member.any() for member in members):
        return {"value": None, "low": None, "high": None, "interval": NOT_ALL}
    plain = all(np.unique(groups[member]).size >= FEW_GROUPS and 0 < right[member].mean() < 1 for member in members)
    if plain:
        weights = weight_groups(labels, groups, np.random.default_rng(seed))
        hits = np.stack([weights[:, member] @ right[member].astype(np.float64) for member in members])
        counts = np.stack([weights[:, member].sum(axis=1) for member in members])
        low, high = np.quantile((hits / np.maximum(counts, 1e-12)).mean(axis=0), [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    else:
        level = 1.0 - (1.0 - LEVEL) / n_classes
        low, high = np.mean([wilson_interval(right[member], groups[member], level) for member in members], axis=0)
    ends = {"low": float(low), "high": float(high), "interval": "bootstrap" if plain else "exact"}
    return {"value": balanced_accuracy(labels, right, n_classes), **ends}


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


def auc_interval(scores: FloatArray, positive: Bools, groups: Groups, *, seed: int) -> tuple[float, float] | None:
    """Return the AUC's bootstrap interval over targets, or None."""
    few = min(np.unique(groups[positive]).size, np.unique(groups[~positive]).size) < FEW_GROUPS
    if few or auc(scores, positive) in (0.0, 1.0):
        return None
    return bootstrap_auc(scores, positive, groups, seed=seed, count=500)


def bootstrap_auc(scores: FloatArray, positive: Bools, groups: Groups, *, seed: int, count: int) -> tuple[float, float]:
    """Return the ends of the AUC's interval over resampled groups."""
    rng = np.random.default_rng(seed)
    weights = weight_groups(positive.astype(np.int64), groups, rng, count=count)
    low, high = np.nanquantile([auc(scores, positive, row) for row in weights], [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return float(low), float(high)


def bin_reliability(
    confidence: FloatArray, right: Bools, weights: FloatArray, edges: FloatArray
) -> list[dict[str, float]]:
    """Return confidence and accuracy in bins of confidence."""
    place = np.clip(np.searchsorted(edges, confidence, side="right") - 1, 0, max(edges.size - 2, 0))
    averaged = {"confidence": confidence, "accuracy": right}
    return [
        {name: float(np.average(values[inside], weights=weights[inside])) for name, values in averaged.items()}
        | {"share": float(weights[inside].sum() / weights.sum()), "n": int(inside.sum())}
        for inside in (place == number for number in np.unique(place))
    ]


def score_calibration(confidence: FloatArray, right: Bools, weights: FloatArray, lowest: float) -> dict[str, Any]:
    """Return the calibration diagram and the expected calibration error."""
    # equal widths, as usual, for the error; equal counts for the diagram: no dot is of few rows
    bins = bin_reliability(confidence, right, weights, np.linspace(lowest, 1.0, CALIBRATION_BINS + 1))
    error = sum(entry["share"] * abs(entry["confidence"] - entry["accuracy"]) for entry in bins)
    shares = np.linspace(0.0, 1.0, min(max(right.size // MIN_IN_BIN, 1), MAX_DOTS) + 1)
    dots = bin_reliability(confidence, right, weights, np.unique(np.quantile(confidence, shares)))
    return {"expected_calibration_error": float(error), "reliability": dots}


@dataclass(frozen=True, eq=False, kw_only=True)
class Answers(Rows):
    """Predictions of a model for test rows."""

    probability: FloatArray
    threshold: FloatArray
    decided: Bools

    @property
    def guesses(self) -> IntArray:
        """Most likely class of every row, shape (n,)."""
        return np.asarray(self.probability.argmax(axis=1), dtype=np.int64)

    @property
    def right(self) -> Bools:
        """Rows with the correct class as the most likely one."""
        return np.asarray(self.guesses == self.labels)


def answer_rows(model: Model, rows: Rows, values: Inputs) -> Answers:
    """Predict rows, and decide where nothing prevents it."""
    probability, threshold = model.probability(values), model.facts.alarm_threshold
    return Answers(
        **vars(rows),
        probability=probability,
        threshold=np.full(len(rows), np.nan if threshold is None else threshold),
        decided=~blocked_rows(rows, values, model) & (probability.max(axis=1) >= model.facts.abstain_below),
    )


def compute_scores(answers: Answers, *, seed: int) -> dict[str, Any]:
    """Compute every overall score of a model, for JSON."""
    from sklearn.metrics import confusion_matrix

    classes, n_classes, labels = answers.classes, len(answers.classes), answers.labels
    weights = row_weights(labels, n_classes)
    recalls = {name: score_share(answers.right[:0], answers.groups[:0]) for name in classes} | score_recalls(answers)
    wrong = answers.probability - np.eye(n_classes)[labels]
    detected = classes
    if n_classes <= 2:  # one curve, of the alarm class if it exists
        detected = (answers.alarm,) if answers.alarm in classes else classes[:1]
    return {
        "balanced_accuracy": score_balanced(answers, seed),
        "accuracy": float(answers.right.mean()),
        "recall": recalls,
        "confusion": confusion_matrix(labels, answers.guesses, labels=range(n_classes)).tolist(),
        "roc": {name: _compute_curve(answers, classes.index(name), seed) for name in detected},
        "brier": float(np.average(0.5 * (wrong**2).sum(axis=1), weights=weights)),
        **score_calibration(answers.probability.max(axis=1), answers.right, weights, 1.0 / n_classes),
        "alarm": find_alarm_point(answers),
        "decided": {
            "share": float(answers.decided.mean()),
            "n": int(answers.decided.sum()),
            "balanced_accuracy": score_balanced(take_rows(answers, answers.decided), seed),
        },
    }


def _compute_curve(answers: Answers, number: int, seed: int) -> dict[str, Any]:
    from sklearn.metrics import roc_curve

    probability, positive = answers.probability[:, number], answers.labels == number
    if not 0 < positive.sum() < positive.size:
        return {"auc": float("nan"), "low": None, "high": None, "false": [], "true": []}
    low, high = auc_interval(probability, positive, answers.groups, seed=seed) or (None, None)
    false, true, _ = roc_curve(positive, probability, drop_intermediate=False)
    kept = np.unique(np.linspace(0, false.size - 1, MOST_POINTS).round().astype(int))
    points = {"false": false[kept].tolist(), "true": true[kept].tolist()}
    return {"auc": auc(probability, positive), "low": low, "high": high, **points}


def score_share(right: Bools, groups: Groups) -> dict[str, Any]:
    """Return a share of rows with its exact interval."""
    low, high = wilson_interval(right, groups)
    counts = {"n": right.size, "movers": np.unique(groups).size}
    return {"value": float(right.mean()) if right.size else float("nan"), "low": low, "high": high, **counts}


def score_recalls(answers: Answers, hits: Bools | None = None) -> dict[str, Any]:
    """Return the share of every present class that is right, or is hit."""
    hits = answers.right if hits is None else hits
    members = {name: answers.labels == number for number, name in enumerate(answers.classes)}
    present = {name: own for name, own in members.items() if own.any()}
    return {name: score_share(hits[own], answers.groups[own]) for name, own in present.items()}


def find_alarm_point(answers: Answers) -> dict[str, Any] | None:
    """Compute the share of every class that triggers at 95 % detection, or None."""
    if answers.alarm not in answers.classes:
        return None
    number = answers.classes.index(answers.alarm)
    probability, positive = answers.probability[:, number], answers.labels == number
    if not 0 < positive.sum() < positive.size:
        return None
    thresholds = {"curve": np.full(len(answers), find_detection_threshold(probability, positive, DETECTED_SHARE))}
    if np.isfinite(answers.threshold).all():
        thresholds["held"] = answers.threshold  # of the held-out rows, as in use
    rates = {key: score_recalls(answers, probability >= threshold) for key, threshold in thresholds.items()}
    return {"detected_share": DETECTED_SHARE, **rates}


class Condition(NamedTuple):
    """A condition of which accuracy is plotted."""

    name: str
    words: str
    columns: tuple[str, ...]
    step: float


_SPEEDS = ("truth_ground_speed_mps", "quality_ground_speed_mps", "feature_torso_velocity_mps")
CONDITIONS = (
    Condition("snr", "SNR of the signature (dB)", ("quality_snr_mu_db", "snr_frame_db"), 5.0),
    Condition("aspect", "angle between motion and line of sight (°)", ("truth_aspect_deg", "quality_aspect_deg"), 15.0),
    Condition("observation", "observation time (s)", ("quality_observation_s", "observation_s"), 1.0),
    Condition("speed", "speed (m/s)", _SPEEDS, 0.5),
)


def find_condition_values(index: pd.DataFrame, condition: Condition) -> tuple[str, FloatArray]:
    """Return a condition's best known column and values."""
    for column in condition.columns:
        values = read_numbers(index.get(column, pd.Series(np.nan, index.index)))
        values = np.where(np.isfinite(values), values, np.nan)
        if np.isfinite(values).mean() >= 0.5:
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


def open_set_scores(model: Model, tested: Inputs, unknown: Rows) -> dict[str, Any]:
    """Score the abstention from every unknown kind."""
    values = collect_inputs(unknown, model.facts.features).values
    answers, kinds, found = answer_rows(model, unknown, values), unknown.index["label"].to_numpy(dtype=str), {}
    doubt = [-model.probability(tested).max(axis=1), -answers.probability.max(axis=1)]
    measures = dict[str, list[FloatArray]]()
    if model.novelty is not None:
        measures["auc"] = [model.novelty.distance(each) for each in (tested, values)]
    measures["auc_of_probability"] = doubt
    for kind in np.unique(kinds).tolist():
        own = take_rows(answers, kinds == kind)
        novel = np.arange(len(tested) + len(own)) >= len(tested)
        areas = {key: auc(np.append(far[0], far[1][kinds == kind]), novel) for key, far in measures.items()}
        shares = {name: float((own.decided & (own.guesses == n)).mean()) for n, name in enumerate(own.classes)}
        found[kind] = {"n": len(own), "auc": None, **areas, "decided": shares}
    return found


def score_conditions(answers: Mapping[str, Answers], notes: list[str], seed: int) -> dict[str, Any]:
    """Compute the accuracy of every model in bins of every known, varying condition."""
    index, found = next(iter(answers.values())).index, {}
    for condition in CONDITIONS:
        column, values = find_condition_values(index, condition)
        edges = make_bin_edges(values, condition.step)
        if not column:
            columns = ", ".join(condition.columns)
            notes.append(f"There is no accuracy by {condition.words}, because none of {columns} is known.")
            continue
        if edges.size < 3:
            ends = f"{edges[0]:g} to {edges[-1]:g}"
            notes.append(f"The accuracy by {condition.words} is one value, because {column} is {ends} in all rows.")
        models: dict[str, list[dict[str, Any]]] = {name: [] for name in answers if name != "chance"}
        for low, high in pairwise(edges.tolist()):
            inside = (values >= low) & (values < high)
            for name, bins in models.items() if inside.any() else ():
                own = take_rows(answers[name], inside)
                span = {"from": low, "to": high, "n": len(own)}
                bins.append({**span, **score_balanced(own, seed), "recall": score_recalls(own)})
        found[condition.name] = {"words": condition.words, "column": column, "models": models}
    return found


def score_breakdowns(answers: Mapping[str, Answers]) -> dict[str, Any]:
    """Compute every class's accuracy by columns with a few different values."""
    index, found = next(iter(answers.values())).index, {}
    for column in BREAKDOWNS:
        texts = index.get(column, pd.Series("", index.index)).fillna("unknown").astype(str).to_numpy(dtype=str)
        values = np.unique(texts).tolist()
        if 2 <= len(values) <= MOST_VALUES:
            found[column] = {
                model: [
                    {**share, "value": value, "label": name, "share_value": share["value"]}
                    for value in values
                    for name, share in score_recalls(take_rows(part, texts == value)).items()
                ]
                for model, part in answers.items()
            }
    return found
