"""Models trained and tested on the folds of an evaluation."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from doppelgait import __version__
from doppelgait.classify.data import Rows, Table
from doppelgait.classify.learned import LabelledRows, Learned, select_features
from doppelgait.classify.model import (
    Calibration,
    Facts,
    Model,
    calibrate,
    conditions_of_rows,
    find_detection_threshold,
    find_training_conditions,
    row_weights,
)
from doppelgait.classify.novelty import learn_novelty
from doppelgait.classify.open_set import blocked_rows
from doppelgait.classify.scores import (
    DETECTED_SHARE,
    Answers,
)
from doppelgait.classify.training import BASELINES, MEMBERS, find_kind, fit, join, standardise_columns
from doppelgait.classify.validate import Fold
from doppelgait.core.interrupt import raise_if_stopped

SHUFFLES = 5
"""Shuffles of a feature for its importance."""
LEAST_PROBABILITY = 1e-12


@dataclass(frozen=True, eq=False)
class Run:
    """Results of one model over all folds."""

    answers: Answers
    models: list[Model]
    held_loss: float
    importance: dict[str, float]

    @property
    def calibrated(self) -> bool:
        """True if a calibration was fitted in every fold."""
        return all(model.calibration.n_rows > 0 for model in self.models)


def run_all(
    rows: Rows,
    tables: Mapping[str, Table],
    folds: Sequence[Fold],
    *,
    seed: int,
    n_seeds: int,
    on_progress: Callable[[int, int], None] | None,
) -> tuple[dict[str, Run], dict[str, list[Run]]]:
    """Train and test all models, with every seed."""
    # train all models for one seed after another, and the baselines once
    jobs = [(name, seed + k) for k in range(n_seeds) for name in tables if k == 0 or name not in BASELINES]
    by_seed: dict[str, list[Run]] = {name: [] for name in tables}
    for number, (name, own_seed) in enumerate(jobs):

        def tick(done: int, before: int = number * len(folds)) -> None:
            if on_progress is not None:
                on_progress(before + done, len(jobs) * len(folds))

        members = [[by_seed[each][-1].models] for each in MEMBERS if by_seed.get(each)] if name == "ensemble" else []
        by_seed[name].append(run_model(rows, tables[name], name, folds, own_seed, tick, members))
    runs = {name: found[0] for name, found in by_seed.items()}
    if "ensemble" in runs and n_seeds > 1:
        members = [[run.models for run in by_seed[each]] for each in MEMBERS if each in by_seed]
        runs["ensemble"] = run_model(rows, tables["ensemble"], "ensemble", folds, seed, lambda done: None, members)
    return runs, by_seed


def run_model(
    rows: Rows,
    table: Table,
    name: str,
    folds: Sequence[Fold],
    seed: int,
    tick: Callable[[int], None],
    members: Sequence[Sequence[Sequence[Model]]] = (),
) -> Run:
    """Train on every fold and predict its test rows.
    An ensemble combines its ``members``, which are trained on the same folds, by kind, seed and fold.
    """
    models, parts, losses, importance = [], [], [], []
    for number, fold in enumerate(folds):
        model = learn(rows, table, name, fold, seed=seed, members=[[each[number] for each in kind] for kind in members])
        models.append(model)
        if fold.test.size:
            values, index = table.values[fold.test], rows.index.iloc[fold.test]
            probability = model.probability(values)
            blocked = blocked_rows(rows, fold.test, values, model)
            threshold = np.nan if model.facts.alarm_threshold is None else model.facts.alarm_threshold
            parts.append(
                Answers(
                    index,
                    rows.labels[fold.test],
                    rows.groups[fold.test],
                    rows.classes,
                    probability,
                    np.full(fold.test.size, threshold),
                    ~blocked & (probability.max(axis=1) >= model.facts.abstain_below),
                    rows.alarm,
                )
            )
            shuffled = name not in BASELINES and not members  # those of an ensemble are shown
            importance.append(_compute_importance(rows, table, model, fold, seed) if shuffled else {})
        held = model.probability(table.values[fold.held])[np.arange(fold.held.size), rows.labels[fold.held]]
        losses.append(float(-np.log(np.maximum(held, LEAST_PROBABILITY)).mean()) if held.size else np.inf)
        tick(number + 1)
    mean = {key: float(np.mean([part[key] for part in importance])) for key in importance[0]}
    # The answers of all folds, in the order of the rows.
    order = np.argsort(np.concatenate([fold.test for fold in folds if fold.test.size]), kind="stable")
    names = ("labels", "groups", "probability", "threshold", "decided")
    columns = {key: np.concatenate([getattr(part, key) for part in parts])[order] for key in names}
    index = pd.concat([part.index for part in parts]).iloc[order]
    answers = Answers(index=index, classes=rows.classes, alarm=rows.alarm, **columns)
    return Run(answers, models, float(np.mean(losses)), mean)


def learn(
    rows: Rows, table: Table, name: str, fold: Fold, *, seed: int, members: Sequence[Sequence[Model]] = ()
) -> Model:
    """Train a model on a fold and calibrate it.
    The held-out rows give the calibration and the threshold of the alarm.
    """
    kind, n_classes = find_kind(name), len(rows.classes)
    train, held = (LabelledRows(table.values[part], rows.labels[part]) for part in (fold.train, fold.held))
    if members:
        learned: Learned = join([[each.learned for each in kind] for kind in members], held, n_classes=n_classes)
    else:
        learned = fit(kind, train, held, n_classes=n_classes, seed=seed)
    calibration = Calibration(1.0, np.zeros(n_classes), 0)
    if kind.learner != "majority" and held.labels.size:
        calibration = calibrate(learned.log_probability(held.values), held.labels)
    threshold = people = None
    if rows.alarm in rows.classes:
        is_alarm = held.labels == rows.classes.index(rows.alarm)
        probability = calibration(learned.log_probability(held.values))[:, rows.classes.index(rows.alarm)]
        found = find_detection_threshold(probability, is_alarm, DETECTED_SHARE)
        if np.isfinite(found):
            threshold, people = found, int(np.unique(rows.groups[fold.held][is_alarm]).size)
    # Span of every feature, NaN where it is never known, and the share of rows in which it is unknown.
    lowest, highest, unknown = np.full(len(table.names), np.nan), np.full(len(table.names), np.nan), np.zeros(0)
    if table.names:
        values = select_features(train.values)
        unknown = np.isnan(values).mean(axis=0)
        known = unknown < 1
        lowest[known] = np.nanmin(values[:, known], axis=0)
        highest[known] = np.nanmax(values[:, known], axis=0)
    first = rows.datasets[0].description
    config = first.get("config") or {}
    facts = Facts(
        name=name,
        features=f"{kind.features}+signature" if members and table.values.dtype == object else kind.features,
        names=table.names,
        classes=rows.classes,
        dataset_id=str(first["id"]),
        dataset_name=str(first.get("name", "")),
        version=__version__,
        n_train=fold.train.size,
        n_held=fold.held.size,
        seed=seed,
        analysis=dict(config.get("analysis") or {}),
        conditions=find_training_conditions(conditions_of_rows(rows), fold.train),
        alarm=rows.alarm if rows.alarm in rows.classes else None,
    ).model_copy(update={"alarm_threshold": threshold, "alarm_people": people})
    novelty = None
    if table.names and name not in BASELINES:
        plain = train._replace(values=select_features(train.values))
        novelty = learn_novelty(standardise_columns(plain.values), plain, held)
    return Model(facts, learned, calibration, lowest, highest, unknown, novelty)


def _compute_importance(rows: Rows, table: Table, model: Model, fold: Fold, seed: int) -> dict[str, float]:
    """Compute the log-loss rise when features are shuffled.
    Mean of 5 shuffles among the test rows; largest first.
    """
    values, labels = table.values[fold.test], rows.labels[fold.test]
    weights = row_weights(labels, len(rows.classes))

    def loss(inputs: Any) -> float:
        found = model.probability(inputs)[np.arange(labels.size), labels]
        return float(-(weights * np.log(np.maximum(found, LEAST_PROBABILITY))).mean())

    generator, whole = np.random.default_rng(seed), loss(values) if table.names else 0.0
    lost = {}
    for number, name in enumerate(table.names):
        raise_if_stopped()
        found = []
        for _ in range(SHUFFLES):
            shuffled = values.copy()
            shuffled[:, number] = generator.permutation(shuffled[:, number])
            found.append(loss(shuffled) - whole)
        lost[name] = float(np.mean(found))
    return dict(sorted(lost.items(), key=lambda entry: -entry[1]))
