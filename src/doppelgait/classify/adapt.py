"""Adaptation of a trained model to a few own recordings.

A model learnt from simulation often ranks real targets well and decides at the wrong place: its probabilities are
shifted. Two numbers move that place, and a handful of recordings is enough for them; without labels one number does,
where it is known how frequent the classes are among the recordings.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.classify.data import Rows
from doppelgait.classify.learned import FloatArray, Inputs, IntArray, log_softmax
from doppelgait.classify.model import Calibration, Model, class_weights
from doppelgait.classify.scores import balanced_accuracy, expected_calibration_error, reliability

COUNTS = (0, 1, 2, 5, 10, 20)
"""Recordings of each class in the curve of :func:`adaptation_curve`."""
REPEATS = 50
SLOPE_SD, SHIFT_SD = 0.5, 2.0
"""Standard deviations of the logarithm of the slope and of the shift before any recording is seen, assumed: a slope is
within a factor of 1.6, a shift within 2 of log odds, in two of three cases. One recording then weighs about as much as
what was learnt, twenty decide."""


def adapt(model: Model, values: Inputs, labels: IntArray) -> Model:
    """Adapt a model's probabilities to labelled recordings.

    p' = softmax(slope log p + shift) of greatest posterior probability: every row counts once, classes alike; slope and
    shift have a normal prior about 1 and 0. Nothing else of the model changes, nor does the order of its answers where
    there are two classes.

    Parameters
    ----------
    model : Model
    values : ndarray
        Inputs of own recordings, as for :meth:`doppelgait.classify.model.Model.probability`.
    labels : ndarray of int, shape (n,)
        Numbers of the model's classes; a class may be missing.

    Returns
    -------
    Model
        The same one where there are no rows.
    """
    from scipy.optimize import minimize

    if not labels.size:
        return model
    log_p = np.log(np.maximum(model.probability(values), 1e-12))
    weights = class_weights(labels, log_p.shape[1])

    def loss(parameters: FloatArray) -> float:
        shift = np.concatenate([[0.0], parameters[1:]])
        found = log_softmax(np.exp(parameters[0]) * log_p + shift)[np.arange(labels.size), labels]
        prior = (parameters[0] / SLOPE_SD) ** 2 + ((parameters[1:] / SHIFT_SD) ** 2).sum()
        return float(-(weights * found).sum() + prior / 2.0)

    best = minimize(loss, np.zeros(log_p.shape[1]), method="L-BFGS-B").x
    return _moved(model, float(np.exp(best[0])), best[1:], labels.size)


def adapt_unlabelled(
    model: Model, values: Inputs, recordings: npt.NDArray[np.str_], shares: npt.ArrayLike | None = None
) -> Model:
    """Adapt a model's probabilities to recordings without labels.

    p' = softmax(log p + shift), so that the mean of p' over the recordings comes to the shares of the classes: the
    shift minimises n times the cross-entropy of the mean against the shares, with the normal prior of :func:`adapt`.
    Each of the n recordings counts once, however many rows it has.
    Without the shares nobody can tell a model that is off from classes that are rare: wrong shares move the decision to
    a wrong place.

    Parameters
    ----------
    model : Model
    values : ndarray
        Inputs of the rows of own recordings.
    recordings : ndarray of str
        Recording of every row.
    shares : array_like, shape (n_classes,), optional
        Of the classes among the recordings, summing to 1; by default all alike.

    Returns
    -------
    Model
        The same one where there are no rows.
    """
    from scipy.optimize import minimize

    log_p = np.log(np.maximum(model.probability(values), 1e-12))
    if not len(log_p):
        return model
    count = log_p.shape[1]
    share = np.full(count, 1.0 / count) if shares is None else np.asarray(shares, dtype=np.float64)

    _, number, counts = np.unique(recordings, return_inverse=True, return_counts=True)
    weights = 1.0 / counts[number] / len(counts)

    def loss(parameters: FloatArray) -> float:
        mean = weights @ np.exp(log_softmax(log_p + np.concatenate([[0.0], parameters])))
        return float(-len(counts) * (share @ np.log(mean)) + ((parameters / SHIFT_SD) ** 2).sum() / 2.0)

    best = minimize(loss, np.zeros(count - 1), method="L-BFGS-B").x
    return _moved(model, 1.0, best, len(log_p))


def _moved(model: Model, slope: float, shift: FloatArray, n_own: int) -> Model:
    """Put slope and shift on top of a model's calibration."""
    before = model.calibration
    moved = slope * before.shift + np.concatenate([[0.0], shift])
    calibration = Calibration(slope * before.slope, moved - moved[0], before.n_rows)
    facts = model.facts.model_copy(update={"n_own": model.facts.n_own + int(n_own)})
    return replace(model, calibration=calibration, facts=facts)


def recordings_of(rows: Rows) -> npt.NDArray[np.str_]:
    """Return the recording of every row; its id where none is named."""
    return rows.index["recording" if "recording" in rows.index else "id"].to_numpy(dtype=str)


def draw_own(rows: Rows, n: int, rng: np.random.Generator) -> tuple[IntArray, IntArray] | None:
    """Draw n recordings of each class to adapt to.

    Returns
    -------
    tuple of ndarray of int, or None
        Rows of those recordings, and the rows of all movers who are in none of them, which may be scored; None where
        not every class has so many recordings and somebody left.
    """
    names = recordings_of(rows)
    own: list[int] = []
    for number in range(len(rows.classes)):
        candidates = np.flatnonzero(rows.labels == number)
        # mover by mover, so that as few movers as possible are lost to the score
        movers = rng.permutation(np.unique(rows.groups[candidates]))
        ordered = [name for mover in movers for name in
                   rng.permutation(np.unique(names[candidates][rows.groups[candidates] == mover]))]  # fmt: skip
        if len(ordered) < n:
            return None
        own += candidates[np.isin(names[candidates], ordered[:n])].tolist()
    drawn = np.array(sorted(own), dtype=np.int64)
    scored = np.flatnonzero(~np.isin(rows.groups, rows.groups[drawn]))
    if np.unique(rows.labels[scored]).size < len(rows.classes):
        return None
    return drawn, scored


def adaptation_curve(
    model: Model, rows: Rows, values: Inputs, rng: np.random.Generator, *, counts: Sequence[int] = COUNTS,
) -> list[dict[str, Any]]:  # fmt: skip
    """Score a model against the number of own recordings.

    Every count is drawn :data:`REPEATS` times; scored are only movers of whom nothing was drawn.

    Returns
    -------
    list of dict
        By count: ``n``; mean ``balanced_accuracy``, with ``low`` and ``high`` between which 80 % of the draws lie;
        ``reliability`` and ``expected_calibration_error`` of all draws together; ``unlabelled``, the mean balanced
        accuracy where the same recordings are used without their labels. A count that leaves nobody to score is left
        out.
    """
    curve, recordings = [], recordings_of(rows)
    for n in counts:
        found = [draw_own(rows, n, rng) for _ in range(REPEATS if n else 1)]
        accuracies, unlabelled, sure, hits, shares = [], [], [], [], []
        for drawn in found:
            if drawn is None:
                break
            own, scored = drawn
            adapted = adapt(model, values[own], rows.labels[own])
            probability: npt.NDArray[np.float64] = adapted.probability(values[scored])
            right = probability.argmax(axis=1) == rows.labels[scored]
            accuracies.append(balanced_accuracy(rows.labels[scored], right, len(rows.classes)))
            blind = adapt_unlabelled(model, values[own], recordings[own]).probability(values[scored]).argmax(axis=1)
            unlabelled.append(balanced_accuracy(rows.labels[scored], blind == rows.labels[scored], len(rows.classes)))
            sure.append(probability.max(axis=1))
            hits.append(right)
            shares.append(class_weights(rows.labels[scored], len(rows.classes)))
        if len(accuracies) == len(found):
            low, high = np.quantile(accuracies, (0.1, 0.9))
            drawn_rows = [np.concatenate(each) for each in (sure, hits, shares)]
            bins = reliability(drawn_rows[0], drawn_rows[1], drawn_rows[2], 1.0 / len(rows.classes))
            curve.append({
                "n": n, "balanced_accuracy": float(np.mean(accuracies)), "low": float(low), "high": float(high),
                "unlabelled": float(np.mean(unlabelled)),
                "expected_calibration_error": expected_calibration_error(bins), "reliability": bins,
            })  # fmt: skip
    return curve
