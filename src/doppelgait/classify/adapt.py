"""Adaptation of a trained model to a few own recordings.

A model trained on simulation often ranks real targets well, but its probabilities are shifted, so
that its decision threshold is wrong. Two parameters correct the threshold, and a few recordings
suffice to fit them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from doppelgait.classify import scores
from doppelgait.classify.data import Rows, take_rows
from doppelgait.classify.learned import Inputs, IntArray
from doppelgait.classify.model import (
    Calibration,
    Model,
    blocked_rows,
    conditions_of_rows,
    fit_calibration,
    mark_outside,
    row_weights,
)
from doppelgait.core.errors import DatasetError

COUNTS = (0, 1, 2, 5, 10, 20)  # numbers of recordings per class in the curve of score_adaptation
REPEATS = 50
SLOPE_SD, SHIFT_SD = 0.5, 2.0
"""Assumed prior standard deviations of the logarithm of the slope and of the shift: a slope is within a factor of 1.6,
a shift within 2 of log odds, in two of three cases. One recording then has about the weight of the training data;
twenty recordings dominate. The number of rows of a recording has no effect on its weight."""


def adapt(model: Model, values: Inputs, labels: IntArray, recordings: scores.Groups) -> Model:
    """Adapt a model's probabilities to labelled recordings."""
    if not labels.size:
        return model
    classes = model.facts.classes
    missing = [name for number, name in enumerate(classes) if not (labels == number).any()]
    if missing:
        raise DatasetError(
            f"own recordings contain no {', '.join(missing)}; add some of every class ({', '.join(classes)})"
        )
    _, number, counts = np.unique(recordings, return_inverse=True, return_counts=True)
    share = 1.0 / counts[number]  # over each recording these sum to 1
    of_class = np.bincount(labels, weights=share, minlength=len(classes))
    weights = share * of_class.sum() / (len(classes) * of_class[labels])
    log_p = np.log(np.maximum(model.probability(values), 1e-12))
    targets = weights[:, None] * np.eye(len(classes))[labels]
    moved = fit_calibration(log_p, targets, SLOPE_SD, SHIFT_SD)
    before, facts = model.calibration, model.facts
    threshold = facts.alarm_threshold
    if threshold is not None and facts.alarm is not None:
        asked = np.where(np.array(classes) == facts.alarm, threshold, 1.0 - threshold)
        found = moved(np.log(np.maximum(asked[None], 1e-12)))[0, classes.index(facts.alarm)]
        threshold = float(found) if len(classes) == 2 else None
    facts = facts.model_copy(update={"n_own": facts.n_own + len(log_p), "alarm_threshold": threshold})
    shift = moved.slope * before.shift + moved.shift
    calibration = Calibration(moved.slope * before.slope, shift, before.n_rows)
    return replace(model, calibration=calibration, facts=facts)


def list_row_recordings(rows: Rows) -> scores.Groups:
    """Return every row's recording, its id where unnamed."""
    ids = rows.index["id"].astype(str)
    named = rows.index.get("recording", ids).fillna("").astype(str)
    return named.where(named != "", ids).to_numpy(dtype=str)


def sample_own_rows(rows: Rows, n: int, rng: np.random.Generator) -> tuple[IntArray, IntArray] | None:
    """Sample n recordings of each class to adapt to."""
    names, own = list_row_recordings(rows), list[int]()
    for number in range(len(rows.classes)):
        candidates = np.flatnonzero(rows.labels == number)
        # sample by target, so that as many targets as possible remain to score
        ordered = list[str]()
        for target in rng.permutation(np.unique(rows.groups[candidates])):
            ordered += rng.permutation(np.unique(names[candidates][rows.groups[candidates] == target])).tolist()
        if len(ordered) < n:
            return None
        own += candidates[np.isin(names[candidates], ordered[:n])].tolist()
    sampled = np.array(sorted(own), dtype=np.int64)
    scored = np.flatnonzero(~np.isin(rows.groups, rows.groups[sampled]))
    return (sampled, scored) if np.unique(rows.labels[scored]).size == len(rows.classes) else None


def score_adaptation(
    model: Model, rows: Rows, values: Inputs, rng: np.random.Generator, *, counts: Sequence[int] = COUNTS
) -> list[dict[str, Any]]:
    """Score a model against the number of own recordings."""
    curve, recordings, count = [], list_row_recordings(rows), len(rows.classes)
    for n in counts:
        samples = [sample_own_rows(rows, n, rng) for _ in range(REPEATS if n else 1)]
        if any(sample is None for sample in samples):
            continue
        draws, answers = [], []
        for own, scored in filter(None, samples):
            labels = rows.labels[scored]
            adapted = adapt(model, values[own], rows.labels[own], recordings[own])
            found = [each.probability(values[scored]) for each in (adapted, model)]
            right = [each.argmax(axis=1) == labels for each in found]
            accuracies = [scores.balanced_accuracy(labels, each, count) for each in right]
            draws.append([*accuracies, np.unique(rows.groups[scored]).size])
            answers.append((found[0].max(axis=1), right[0], row_weights(labels, count)))
        means = np.mean(draws, axis=0).tolist()
        spread = np.quantile(draws, (0.1, 0.9), axis=0)[:, 0].tolist()
        sure, hits, weights = (np.concatenate(part) for part in zip(*answers, strict=True))
        names = ("balanced_accuracy", "low", "high", "before", "movers")
        point = {"n": n, **dict(zip(names, [means[0], *spread, *means[1:]], strict=True))}
        curve.append(point | scores.score_calibration(sure, hits, weights, 1.0 / count))
    return curve


def adapt_to_rows(
    model: Model, rows: Rows, values: Inputs, *, seed: int = 0
) -> tuple[Model, list[dict[str, Any]], list[str]]:
    """Adapt a model to own rows, with the curve of its scores and remarks."""
    notes, blocked = [], blocked_rows(rows, values, model)
    if blocked.any():
        found, trained = conditions_of_rows(rows), model.facts.conditions
        counts = {name: int(mark_outside(each, name, trained).sum()) for name, each in found.items()}
        worst = ", ".join(f"{name} outside the training range in {count}" for name, count in counts.items() if count)
        notes.append(
            f"{int(blocked.sum())} of {len(rows)} own rows are not used, because the model makes no decision on them"
            + (f" ({worst})." if worst else ".")
        )
    rows, values = take_rows(rows, ~blocked), values[~blocked]
    if np.unique(rows.labels).size < len(rows.classes):
        return model, [], [*notes, "It is not adapted, because a class has no own recording left."]
    curve = score_adaptation(model, rows, values, np.random.default_rng(seed))
    if gone := [str(n) for n in COUNTS if n not in {point["n"] for point in curve}]:
        notes.append(
            f"There is no score after {', '.join(gone)} own recordings of a class, because there are too few, or no "
            "target would be left to score."
        )
    if "subject" in rows.index and rows.index["subject"].astype(str).str.startswith("file/").all():
        notes.append(
            "The own recordings name no subject, so that each counts as a separate target, though a target may be in "
            "several."
        )
    return adapt(model, values, rows.labels, list_row_recordings(rows)), curve, notes
