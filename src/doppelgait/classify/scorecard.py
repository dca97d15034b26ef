"""All that is said about one model's answers: overall, by class, by condition, by kind of motion, and as an alarm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from doppelgait.classify import scores
from doppelgait.classify.calibrate import class_weights
from doppelgait.classify.learned import FloatArray, IntArray

ALARM_CLASS = "human"
DETECTED_SHARE = 0.95
MOST_POINTS = 200
"""Of a ROC curve."""
MOST_BINS = 12
NOT_ALL = "not all classes are tested"
"""In place of an interval where there is no balanced accuracy, only recalls."""


@dataclass(frozen=True, eq=False)
class Answers:
    """What a model said about rows that it did not learn from.

    Parameters
    ----------
    index : DataFrame
        The rows tested.
    labels : ndarray of int, shape (n,)
    groups : ndarray of str, shape (n,)
    classes : tuple of str
    probability : ndarray, shape (n, n_classes)
    threshold : ndarray, shape (n,)
        Of the alarm class, set on held rows; NaN where there was none.
    decided : ndarray of bool, shape (n,)
        Rows about which a decision was given.
    """

    index: pd.DataFrame
    labels: IntArray
    groups: scores.Groups
    classes: tuple[str, ...]
    probability: FloatArray
    threshold: FloatArray
    decided: scores.Bools

    @property
    def guesses(self) -> IntArray:
        """Most likely class of every row."""
        return np.asarray(self.probability.argmax(axis=1), dtype=np.int64)

    @property
    def right(self) -> scores.Bools:
        """Rows whose most likely class is theirs."""
        return np.asarray(self.guesses == self.labels)


def scorecard(answers: Answers, *, seed: int) -> dict[str, Any]:
    """Every overall score of a model, for JSON; intervals are of 95 %.

    Parameters
    ----------
    answers : Answers
    seed : int
        Of the bootstrap.
    """
    n_classes = len(answers.classes)
    weights = class_weights(answers.labels, n_classes)
    bins = scores.reliability(answers.probability.max(axis=1), answers.right, weights, 1.0 / n_classes)
    return {
        "balanced_accuracy": _balanced(answers, np.ones(len(answers.labels), dtype=bool), seed),
        "accuracy": float(answers.right.mean()),
        "recall": {name: _share(answers, answers.labels == n) for n, name in enumerate(answers.classes)},
        "confusion": scores.confusion(answers.labels, answers.guesses, n_classes).tolist(),
        "roc": {name: _roc(answers, name, seed) for name in _positives(answers.classes)},
        "brier": scores.brier(answers.probability, answers.labels, weights),
        "expected_calibration_error": scores.expected_calibration_error(bins),
        "reliability": bins,
        "alarm": alarm_point(answers),
        "decided": {
            "share": float(answers.decided.mean()),
            "n": int(answers.decided.sum()),
            "balanced_accuracy": _balanced(answers, answers.decided, seed),
        },
    }


def _positives(classes: Sequence[str]) -> list[str]:
    """Classes that are told from all others: of two only one, which is the one to detect if it is there."""
    if len(classes) > 2:
        return list(classes)
    return [ALARM_CLASS if ALARM_CLASS in classes else classes[0]]


def _balanced(answers: Answers, chosen: scores.Bools, seed: int) -> dict[str, Any]:
    labels, right = answers.labels[chosen], answers.right[chosen]
    n_classes = len(answers.classes)
    if np.unique(labels).size < n_classes:
        return {"value": None, "low": None, "high": None, "interval": NOT_ALL}
    found = scores.balanced_interval(labels, right, answers.groups[chosen], n_classes, np.random.default_rng(seed))
    value = scores.balanced_accuracy(labels, right, n_classes)
    return {"value": value, "low": found.low, "high": found.high, "interval": found.method}


def _share(answers: Answers, chosen: scores.Bools) -> dict[str, Any]:
    """Share of some rows that is right; the interval is exact, every mover one trial."""
    low, high = scores.share_interval(answers.right[chosen], answers.groups[chosen])
    count = int(chosen.sum())
    return {
        "value": float(answers.right[chosen].mean()) if count else float("nan"),
        "low": low,
        "high": high,
        "n": count,
        "movers": int(np.unique(answers.groups[chosen]).size),
    }


def _roc(answers: Answers, name: str, seed: int) -> dict[str, Any]:
    number = answers.classes.index(name)
    probability, positive = answers.probability[:, number], answers.labels == number
    if not 0 < positive.sum() < positive.size:
        return {"auc": float("nan"), "low": None, "high": None, "false": [], "true": []}
    low, high = scores.auc_interval(probability, positive, answers.groups, np.random.default_rng(seed)) or (None, None)
    false, true = scores.roc(probability, positive)
    kept = np.unique(np.linspace(0, false.size - 1, MOST_POINTS).round().astype(int))
    area = scores.auc(probability, positive)
    return {"auc": area, "low": low, "high": high, "false": false[kept].tolist(), "true": true[kept].tolist()}


def alarm_point(answers: Answers) -> dict[str, Any] | None:
    """Who triggers an alarm that detects 95 % of people; None where there is no such class or no threshold.

    ``held``: with the threshold that the held rows gave, as in use. ``curve``: read off the test rows' own ROC curve.
    """
    if ALARM_CLASS not in answers.classes:
        return None
    number = answers.classes.index(ALARM_CLASS)
    probability, positive = answers.probability[:, number], answers.labels == number
    if not 0 < positive.sum() < positive.size:
        return None
    from doppelgait.classify.calibrate import detection_threshold

    own = detection_threshold(probability, positive, DETECTED_SHARE)
    found: dict[str, Any] = {"detected_share": DETECTED_SHARE, "curve": _triggered(answers, probability >= own)}
    if np.isfinite(answers.threshold).all():
        found["held"] = _triggered(answers, probability >= answers.threshold)
    return found


def _triggered(answers: Answers, triggers: scores.Bools) -> dict[str, Any]:
    """Share of every class that triggers."""
    found = {}
    for number, name in enumerate(answers.classes):
        member = answers.labels == number
        if member.any():
            low, high = scores.share_interval(triggers[member], answers.groups[member])
            found[name] = {"value": float(triggers[member].mean()), "low": low, "high": high, "n": int(member.sum())}
    return found


@dataclass(frozen=True)
class Condition:
    """A condition that accuracy is shown against.

    Parameters
    ----------
    name, words : str
    columns : tuple of str
        Columns of the index that hold it, the best first.
    step : float
        Width of a bin.
    """

    name: str
    words: str
    columns: tuple[str, ...]
    step: float


CONDITIONS = (
    Condition("snr", "SNR of the signature (dB)", ("quality_snr_mu_db", "snr_frame_db"), 5.0),
    Condition("aspect", "angle between motion and line of sight (°)", ("truth_aspect_deg", "quality_aspect_deg"), 15.0),
    Condition("observation", "observation time (s)", ("quality_observation_s", "observation_s"), 1.0),
    Condition(
        "speed", "speed (m/s)",
        ("truth_ground_speed_mps", "quality_ground_speed_mps", "feature_torso_velocity_mps"), 0.5,
    ),
)  # fmt: skip


def condition_values(index: pd.DataFrame, condition: Condition) -> tuple[str, FloatArray]:
    """The first column that is known of half of the rows or more, and its values; the angle from 0 to 90 degrees."""
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


def bin_edges(values: FloatArray, step: float) -> FloatArray:
    """Edges at whole steps, doubled until 12 bins take in all known values."""
    known = values[np.isfinite(values)]
    if not known.size:
        return np.zeros(0)
    while True:
        low, high = np.floor(known.min() / step), np.floor(known.max() / step) + 1
        if high - low <= MOST_BINS:
            return np.asarray(np.arange(low, high + 1) * step)
        step *= 2.0


def curve(answers: Answers, values: FloatArray, edges: FloatArray, *, seed: int) -> list[dict[str, Any]]:
    """Balanced accuracy in every bin with rows of all classes, with its interval; recalls of every class there is."""
    found = []
    for low, high in pairwise(edges.tolist()):
        inside = (values >= low) & (values < high)
        if inside.any():
            found.append({
                "from": float(low), "to": float(high), "n": int(inside.sum()),
                **_balanced(answers, inside, seed),
                "recall": {
                    name: _share(answers, inside & (answers.labels == n))
                    for n, name in enumerate(answers.classes)
                    if (inside & (answers.labels == n)).any()
                },
            })  # fmt: skip
    return found


BREAKDOWNS = ("truth_gait", "motion_kind", "source", "subject", "session")
MOST_VALUES = 40


def breakdown(answers: Answers, texts: npt.NDArray[np.str_]) -> list[dict[str, Any]]:
    """Share right of every class at every value of a column."""
    return [
        {"value": value, "label": name, **{f"share_{k}" if k == "value" else k: v for k, v in shares.items()}}
        for value in np.unique(texts).tolist()
        for number, name in enumerate(answers.classes)
        if (member := (texts == value) & (answers.labels == number)).any()
        for shares in (_share(answers, member),)
    ]
