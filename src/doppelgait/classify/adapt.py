"""Adaptation of a trained model to a few own recordings.

A model trained on simulation often ranks real targets well, but its probabilities are shifted, so
that its decision threshold is wrong. Two parameters correct the threshold, and a few recordings
suffice to fit them. Without labels one parameter is fitted from the known class frequencies among
the recordings.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.classify.data import Rows, take_rows
from doppelgait.classify.learned import FloatArray, Inputs, IntArray
from doppelgait.classify.model import Calibration, Model, blocked_rows, conditions_of_rows, mark_outside, row_weights
from doppelgait.classify.scorer import log_softmax
from doppelgait.classify.scores import balanced_accuracy, bin_reliability, expected_calibration_error
from doppelgait.core.errors import DatasetError

COUNTS = (0, 1, 2, 5, 10, 20)  # numbers of recordings per class in the curve of score_adaptation
REPEATS = 50
SLOPE_SD, SHIFT_SD = 0.5, 2.0
"""Assumed prior standard deviations of the logarithm of the slope and of the shift: a slope is within a factor of 1.6,
a shift within 2 of log odds, in two of three cases. One recording then has about the weight of the training data;
twenty recordings dominate. The number of rows of a recording has no effect on its weight."""


def adapt(model: Model, values: Inputs, labels: IntArray, recordings: npt.NDArray[np.str_]) -> Model:
    """Adapt a model's probabilities to labelled recordings."""
    # p' = softmax(slope log p + shift), of maximum posterior probability
    from scipy.optimize import minimize

    if not labels.size:
        return model
    classes = model.facts.classes
    missing = [name for number, name in enumerate(classes) if not (labels == number).any()]
    if missing:
        raise DatasetError(
            f"own recordings contain no {', '.join(missing)}; add some of every class ({', '.join(classes)}), or label "
            "all of them unlabelled"
        )
    log_p = np.log(np.maximum(model.probability(values), 1e-12))
    share = _weight_recordings(recordings)
    of_class = np.bincount(labels, weights=share, minlength=len(classes))
    weights = share * of_class.sum() / (len(classes) * of_class[labels])

    def loss(parameters: FloatArray) -> float:
        shift = np.concatenate([[0.0], parameters[1:]])
        found = log_softmax(np.exp(parameters[0]) * log_p + shift)[np.arange(labels.size), labels]
        prior = (parameters[0] / SLOPE_SD) ** 2 + ((parameters[1:] / SHIFT_SD) ** 2).sum()
        return float(-(weights * found).sum() + prior / 2.0)

    best = minimize(loss, np.zeros(log_p.shape[1]), method="L-BFGS-B").x
    return _shift_calibration(model, float(np.exp(best[0])), best[1:], labels.size)


def adapt_unlabelled(
    model: Model, values: Inputs, recordings: npt.NDArray[np.str_], shares: npt.ArrayLike | None = None
) -> Model:
    """Adapt a model's probabilities to recordings without labels."""
    # each recording has the same weight for any number of rows; shares (n_classes,)
    from scipy.optimize import minimize

    log_p = np.log(np.maximum(model.probability(values), 1e-12))
    if not len(log_p):
        return model
    count = log_p.shape[1]
    share = np.full(count, 1.0 / count) if shares is None else np.asarray(shares, dtype=np.float64)

    weights = _weight_recordings(recordings)
    n_recordings = float(weights.sum())

    def loss(parameters: FloatArray) -> float:
        mean = weights @ np.exp(log_softmax(log_p + np.concatenate([[0.0], parameters]))) / n_recordings
        return float(-n_recordings * (share @ np.log(mean)) + ((parameters / SHIFT_SD) ** 2).sum() / 2.0)

    best = minimize(loss, np.zeros(count - 1), method="L-BFGS-B").x
    return _shift_calibration(model, 1.0, best, len(log_p))


def _weight_recordings(recordings: npt.NDArray[np.str_]) -> FloatArray:
    """Return row weights that sum to 1 over each recording."""
    _, number, counts = np.unique(recordings, return_inverse=True, return_counts=True)
    return np.asarray(1.0 / counts[number], dtype=np.float64)


def _shift_calibration(model: Model, slope: float, shift: FloatArray, n_own: int) -> Model:
    """Apply slope and shift after a model's calibration."""
    before, facts = model.calibration, model.facts
    moved = slope * before.shift + np.concatenate([[0.0], shift])
    calibration = Calibration(slope * before.slope, moved - moved[0], before.n_rows)
    threshold = facts.alarm_threshold
    if threshold is not None and facts.alarm is not None:
        towards = float(shift[0]) * (1.0 if facts.classes.index(facts.alarm) else -1.0)
        limited = min(max(threshold, 1e-12), 1.0 - 1e-12)
        odds = slope * math.log(limited / (1.0 - limited)) + towards
        threshold = 1.0 / (1.0 + math.exp(-odds)) if len(facts.classes) == 2 else None
    facts = facts.model_copy(update={"n_own": facts.n_own + int(n_own), "alarm_threshold": threshold})
    return replace(model, calibration=calibration, facts=facts)


def list_row_recordings(rows: Rows) -> npt.NDArray[np.str_]:
    """Return every row's recording, its id where unnamed."""
    named = rows.index["recording"].fillna("").astype(str) if "recording" in rows.index else None
    if named is not None and (named != "").all():
        return named.to_numpy(dtype=str)
    ids = rows.index["id"].astype(str)
    return (ids if named is None else named.where(named != "", ids)).to_numpy(dtype=str)


def sample_own_rows(rows: Rows, n: int, rng: np.random.Generator) -> tuple[IntArray, IntArray] | None:
    """Sample n recordings of each class to adapt to."""
    names = list_row_recordings(rows)
    own: list[int] = []
    for number in range(len(rows.classes)):
        candidates = np.flatnonzero(rows.labels == number)
        # sample by target, so that as many targets as possible remain to score
        targets = rng.permutation(np.unique(rows.groups[candidates]))
        ordered = [
            name
            for target in targets
            for name in rng.permutation(np.unique(names[candidates][rows.groups[candidates] == target]))
        ]
        if len(ordered) < n:
            return None
        own += candidates[np.isin(names[candidates], ordered[:n])].tolist()
    sampled = np.array(sorted(own), dtype=np.int64)
    scored = np.flatnonzero(~np.isin(rows.groups, rows.groups[sampled]))
    if np.unique(rows.labels[scored]).size < len(rows.classes):
        return None
    return sampled, scored


def score_adaptation(
    model: Model,
    rows: Rows,
    values: Inputs,
    rng: np.random.Generator,
    *,
    counts: Sequence[int] = COUNTS,
) -> list[dict[str, Any]]:
    """Score a model against the number of own recordings."""
    curve, recordings, count = [], list_row_recordings(rows), len(rows.classes)
    for n in counts:
        found = [sample_own_rows(rows, n, rng) for _ in range(REPEATS if n else 1)]
        if any(sample is None for sample in found):
            continue
        scores, sure, hits, shares = [], [], [], []
        for own, scored in (sample for sample in found if sample is not None):
            labels = rows.labels[scored]
            adapted = adapt(model, values[own], rows.labels[own], recordings[own])
            blind = adapt_unlabelled(model, values[own], recordings[own])
            probability: npt.NDArray[np.float64] = adapted.probability(values[scored])
            right = [probability.argmax(axis=1) == labels]
            right += [other.probability(values[scored]).argmax(axis=1) == labels for other in (model, blind)]
            scores.append(
                [*(balanced_accuracy(labels, each, count) for each in right), np.unique(rows.groups[scored]).size]
            )
            sure.append(probability.max(axis=1))
            hits.append(right[0])
            shares.append(row_weights(labels, count))
        accuracy, before, unlabelled, n_targets = np.mean(scores, axis=0)
        low, high = np.quantile([score[0] for score in scores], (0.1, 0.9))
        bins = bin_reliability(np.concatenate(sure), np.concatenate(hits), np.concatenate(shares), 1.0 / count)
        curve.append(
            {
                "n": n,
                "balanced_accuracy": float(accuracy),
                "low": float(low),
                "high": float(high),
                "before": float(before),
                "unlabelled": float(unlabelled),
                "movers": float(n_targets),
                "expected_calibration_error": expected_calibration_error(bins),
                "reliability": bins,
            }
        )
    return curve


def adapt_to_rows(
    model: Model, rows: Rows, values: Inputs, rng: np.random.Generator
) -> tuple[Model, list[dict[str, Any]], list[str]]:
    """Adapt a model to labelled rows."""
    used, notes = _select_decidable(model, rows, values)
    part, inputs = take_rows(rows, used), values[used]
    if np.unique(part.labels).size < len(rows.classes):
        return model, [], [*notes, "not adapted: a class has no own recording left"]
    curve = score_adaptation(model, part, inputs, rng)
    if gone := [str(n) for n in COUNTS if n not in {point["n"] for point in curve}]:
        notes.append(
            f"no score after {', '.join(gone)} own recordings of a class: too few, or no target would be left to score"
        )
    if "subject" in part.index and part.index["subject"].astype(str).str.startswith("file/").all():
        notes.append(
            "own recordings name no subject: each counts as a separate target, though a target may be in several"
        )
    return adapt(model, inputs, part.labels, list_row_recordings(part)), curve, notes


def adapt_to_nameless_rows(
    model: Model, rows: Rows, values: Inputs, shares: Mapping[str, float] | None
) -> tuple[Model, list[str]]:
    """Adapt a model to rows without labels, with remarks."""
    used, notes = _select_decidable(model, rows, values)
    if not used.size:
        return model, [*notes, "not adapted: no own row is left"]
    assumed = {name: 1.0 / len(rows.classes) for name in rows.classes} if shares is None else shares
    names = list_row_recordings(take_rows(rows, used))
    words = ", ".join(f"{share:.0%} {name}" for name, share in assumed.items())
    notes.append(f"adapted to {np.unique(names).size} recordings without labels, as if {words}; scores are from before")
    return adapt_unlabelled(model, values[used], names, [assumed[name] for name in rows.classes]), notes


def _select_decidable(model: Model, rows: Rows, values: Inputs) -> tuple[IntArray, list[str]]:
    """Return the rows that the model decides on."""
    blocked = blocked_rows(rows, values, model)
    if not blocked.any():
        return np.arange(len(rows)), []
    outside = {
        name: mark_outside(found, name, model.facts.conditions) for name, found in conditions_of_rows(rows).items()
    }
    worst = [f"{name} outside the training range in {int(far.sum())}" for name, far in outside.items() if far.any()]
    words = f" ({', '.join(worst)})" if worst else ""
    return np.flatnonzero(~blocked), [
        f"{int(blocked.sum())} of {len(rows)} own rows are not used, because the model makes no decision on them{words}"
    ]
