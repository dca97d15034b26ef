"""Evaluation of models: scores, accuracy by condition, trained models."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from doppelgait import __version__
from doppelgait.classify.data import Rows, Table, rows_of, table_of
from doppelgait.classify.learned import Learned, Part, features_in, join_inputs
from doppelgait.classify.model import (
    LEAST_ROWS,
    Calibration,
    Facts,
    Model,
    calibrate,
    class_weights,
    conditions_of_rows,
    conditions_outside,
    detection_threshold,
    learnt_conditions,
    span_words,
)
from doppelgait.classify.novelty import learn_novelty
from doppelgait.classify.open_set import blocked_rows, open_set_scores, unknown_rows
from doppelgait.classify.scores import (
    ALARM_CLASS,
    BREAKDOWNS,
    CONDITIONS,
    DETECTED_SHARE,
    MOST_VALUES,
    Answers,
    balanced_accuracy,
    bin_edges,
    breakdown,
    condition_values,
    curve,
    scorecard,
)
from doppelgait.classify.training import BASELINES, DEFAULT, MEMBERS, fit, join, kind_of, standard_columns
from doppelgait.classify.validate import Fold, cross_validation, hold_back, leave_out, own_splits, refuse_shared
from doppelgait.core.config import json_value
from doppelgait.core.errors import ConfigError, DatasetError
from doppelgait.dataset.open import Dataset


def document_of(
    rows: Rows, folds: Sequence[Fold], answers: Mapping[str, Answers], notes: Sequence[str], *, seed: int
) -> dict[str, Any]:
    """Collect the scores of all models for JSON; None for unknown.

    Parameters
    ----------
    rows : Rows
    folds : sequence of Fold
    answers : mapping
        Of every model, by name; all about the same rows.
    notes : sequence of str
        Remarks on the rows and on what was left out.
    seed : int
        Of the bootstrap.
    """
    tested = next(iter(answers.values()))
    said = list(notes) + [
        f"nobody of {name} is tested" for number, name in enumerate(rows.classes) if not (tested.labels == number).any()
    ]
    models = {}
    for name, found in answers.items():
        kind = kind_of(name)
        facts = {"features": kind.features, "learner": kind.learner, "baseline": name in BASELINES}
        models[name] = {"kind": facts, **scorecard(found, seed=seed)}
    fold_facts = []
    for fold in folds:
        parts = {key: getattr(fold, key) for key in ("train", "held", "test")}
        counts = {key: {"n": int(p.size), "movers": int(np.unique(rows.groups[p]).size)} for key, p in parts.items()}
        fold_facts.append({"name": fold.name, **counts})
    breakdowns = {}
    for column in BREAKDOWNS:
        if column not in tested.index:
            continue
        texts = tested.index[column].fillna("unknown").astype(str).to_numpy(dtype=str)
        if 2 <= np.unique(texts).size <= MOST_VALUES:  # several values, and not too many
            shares = {name: breakdown(part, texts) for name, part in answers.items() if name not in BASELINES}
            breakdowns[column] = shares
    document = {
        "doppelgait_version": __version__,
        "seed": seed,
        "classes": list(rows.classes),
        "dataset": _dataset_facts(rows, 0),
        "test_dataset": _dataset_facts(rows, 1) if len(rows.datasets) > 1 else None,
        "folds": fold_facts,
        "tested": {name: int((tested.labels == n).sum()) for n, name in enumerate(rows.classes)},
        "models": models,
        "conditions": _accuracy_by_condition(answers, said, seed),
        "breakdowns": breakdowns,
        "notes": said,
    }
    plain: dict[str, Any] = json_value(document)
    return plain


def _dataset_facts(rows: Rows, number: int) -> dict[str, Any]:
    part = rows.datasets[number]
    return {
        "directory": str(part.directory),
        "id": part.description.get("id"),
        "name": part.description.get("name"),
        "origin": part.description.get("origin", "simulated"),
        "n_rows": len(part),
        "config": part.description.get("config"),
    }


def _accuracy_by_condition(answers: Mapping[str, Answers], notes: list[str], seed: int) -> dict[str, Any]:
    """Compute the accuracy of every model by known, varying condition."""
    tested, found = next(iter(answers.values())), {}
    for condition in CONDITIONS:
        column, values = condition_values(tested.index, condition)
        edges = bin_edges(values, condition.step)
        if not column:
            notes.append(f"accuracy against {condition.words}: none of {', '.join(condition.columns)} is known")
            continue
        if edges.size < 3:
            notes.append(f"accuracy against {condition.words}: {column} is {edges[0]:g} to {edges[-1]:g} in all rows")
        curves = {name: curve(part, values, edges, seed=seed) for name, part in answers.items() if name != "chance"}
        found[condition.name] = {"words": condition.words, "column": column, "models": curves}
    return found


def answers_table(rows: Rows, answers: Mapping[str, Answers]) -> pd.DataFrame:
    """Tabulate probabilities, class and decision of every model per tested row."""
    tested = next(iter(answers.values()))
    columns: dict[str, Any] = {"id": tested.index["id"], "label": tested.index["label"], "mover": tested.groups}
    for name, found in answers.items():
        for number, label in enumerate(rows.classes):
            columns[f"{name}:{label}"] = np.round(found.probability[:, number], 6)
        columns[f"{name}:class"] = np.array(rows.classes)[found.guesses]
        columns[f"{name}:decided"] = found.decided
    return pd.DataFrame({key: np.asarray(values) for key, values in columns.items()})


SHUFFLES = 5
"""Shuffles of a feature for its importance."""
LEAST_PROBABILITY = 1e-12


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Scores, predictions and trained models of an evaluation.

    Parameters
    ----------
    document : dict
        All scores, for JSON; None for unknown.
    answers : DataFrame
        One line per tested row: id, label, and of every model the probabilities, the class and whether it is decided.
    best : str or None
        The ensemble if there is one, else the model with the lowest log loss on the held-out rows, a mean over seeds,
        or the only one; None where no rows are held out to choose by.
    models : dict
        Trained models by name, as scored; after a cross-validation trained on all rows, and only with ``keep``.
    """

    document: dict[str, Any]
    answers: pd.DataFrame
    best: str | None
    models: dict[str, Model]


@dataclass(frozen=True, eq=False)
class _Run:
    """Results of one model over all folds."""

    answers: Answers
    models: list[Model]
    held_loss: float
    importance: dict[str, float]

    @property
    def calibrated(self) -> bool:
        return all(model.calibration.n_rows > 0 for model in self.models)


def evaluate(
    dataset: Dataset, *, other: Dataset | None = None, models: Sequence[str] | None = None, n_folds: int | None = None,
    left_out: str | None = None, unknown: Dataset | None = None, motion_folder: Path | None = None, seed: int = 0,
    n_seeds: int = 1, keep: bool = False, on_progress: Callable[[int, int], None] | None = None,
) -> Evaluation:  # fmt: skip
    """Train and score models.

    Parameters
    ----------
    dataset : Dataset
        Training data; tested on its own split ``test`` unless one of the next three is used.
    other : Dataset, optional
        Test data instead: all rows but those of targets in the training data.
    models : sequence of str, optional
        Of :data:`doppelgait.classify.training.CLASSIFIERS`; by default :data:`doppelgait.classify.training.DEFAULT`, as
        far as the dataset has the inputs. The members of an ensemble are evaluated with it, and chance, nuisance
        parameters and speed alone always.
    n_folds : int, optional
        Number of folds of a cross-validation over all rows; the rows of a target are never separated.
    left_out : str, optional
        Leave one value of this column out at a time, for example ``source``.
    unknown : Dataset, optional
        Rows of further classes, which the models should abstain from: scored beside the tested rows.
    motion_folder : Path, optional
        Folder of the motion files of the plan, from which the nuisance parameters are sampled.
    seed : int
        Seed of folds, training and bootstrap.
    n_seeds : int
        Train with so many seeds, from ``seed`` on. The ensemble joins the members of all seeds; every other model is
        that of the first seed, and its scores of all seeds stand beside it.
    keep : bool
        After a cross-validation train each model once more, on all rows.
    on_progress : callable, optional
        Called with (models trained, models to train).

    Returns
    -------
    Evaluation

    Raises
    ------
    DatasetError
        If there is one class alone, nothing to test on, or the other dataset lacks features or has further classes.
    ConfigError
        If models or options are unknown or exclude each other; or if no model can be chosen to keep.
    """
    rows = rows_of(dataset, other)
    strangers = None if unknown is None else unknown_rows(unknown, rows)
    if strangers is not None and (n_folds or left_out):
        raise ConfigError("--unknown: needs one model for all rows; leave --cv and --leave-out out")
    folds, notes = _choose_folds(rows, n_folds, left_out, seed)
    refuse_shared(rows, folds)
    tables, skipped = _load_tables(rows, models, motion_folder)
    if not any(name not in BASELINES for name in tables):
        raise DatasetError(f"{dataset.directory}: no model can be trained: {'; '.join(skipped)}")
    whole = folds
    if keep and (n_folds or left_out):
        train, held = hold_back(rows, np.arange(len(rows)), seed)
        whole = [*folds, Fold("all rows", train, held, np.empty(0, dtype=np.int64))]
    if keep:
        # Refuse to keep the best of several models where there is nothing to choose by.
        names = [name for name in tables if name not in BASELINES]
        if len(names) > 1 and "ensemble" not in names and not all(fold.held.size for fold in whole):
            raise ConfigError(
                f"--save: no rows can be held back to choose among {', '.join(names)}: a class has too few targets; "
                "name the one model to keep (--models), or give more data"
            )
    # all models of one seed after the other, the baselines once
    jobs = [(name, seed + k) for k in range(n_seeds) for name in tables if k == 0 or name not in BASELINES]
    by_seed: dict[str, list[_Run]] = {name: [] for name in tables}
    for number, (name, own_seed) in enumerate(jobs):

        def tick(done: int, before: int = number * len(whole)) -> None:
            if on_progress is not None:
                on_progress(before + done, len(jobs) * len(whole))

        members = [[by_seed[each][-1].models] for each in MEMBERS if by_seed.get(each)] if name == "ensemble" else []
        by_seed[name].append(_run_model(rows, tables[name], name, whole, own_seed, tick, members))
    runs = {name: found[0] for name, found in by_seed.items()}
    if "ensemble" in runs and n_seeds > 1:
        members = [[run.models for run in by_seed[each]] for each in MEMBERS if each in by_seed]
        runs["ensemble"] = _run_model(rows, tables["ensemble"], "ensemble", whole, seed, lambda done: None, members)
    trained = [name for name in runs if name not in BASELINES]
    losses = {name: float(np.mean([run.held_loss for run in by_seed[name]])) for name in trained}
    best: str | None = "ensemble" if "ensemble" in runs else min(losses, key=lambda name: losses[name])
    if best != "ensemble" and len(trained) > 1 and not np.isfinite(losses[best or ""]):
        best = None
    answers = {name: run.answers for name, run in runs.items()}
    outside = _find_outside(rows, folds)
    said = [*notes, *skipped]
    bare = [name for name in trained if not runs[name].calibrated]
    if bare:
        said.append(f"{', '.join(bare)}: not calibrated, a class has fewer than {LEAST_ROWS} held rows")
    said += [
        f"{name}: {part['n']} of {part['of']} tested rows have {span_words(*part['tested'])}, outside what was "
        f"learnt, {span_words(*part['learnt'])}: no decision there; other scores count them"
        for name, part in outside.items()
    ]
    document = document_of(rows, folds, answers, said, seed=seed)
    for name, run in runs.items():
        document["models"][name]["held_log_loss"] = run.held_loss if np.isfinite(run.held_loss) else None
        document["models"][name]["calibrated"] = run.calibrated
        document["models"][name]["importance"] = run.importance
        if n_seeds > 1 and name not in BASELINES:
            document["models"][name]["seeds"] = [_score_of_seed(each.answers) for each in by_seed[name]]
        if strangers is not None and name not in BASELINES:
            tested = tables[name].values[folds[0].test]
            document["models"][name]["unknown"] = open_set_scores(run.models[0], tested, strangers)
    document |= {"n_seeds": n_seeds, "kept": best, "outside_conditions": outside}
    kept = {name: run.models[-1] for name, run in runs.items() if len(folds) == 1 or len(whole) > len(folds)}
    return Evaluation(document, answers_table(rows, answers), best, kept)


def _score_of_seed(answers: Answers) -> float | None:
    """Return the balanced accuracy of one seed; None where a class is not tested."""
    value = balanced_accuracy(answers.labels, answers.right, len(answers.classes))
    return value if np.isfinite(value) else None


def _find_outside(rows: Rows, folds: Sequence[Fold]) -> dict[str, dict[str, Any]]:
    """Find conditions of tested rows outside the training range, over all folds."""
    found = conditions_of_rows(rows)
    all_of_them: dict[str, dict[str, Any]] = {}
    for fold in folds:
        for name, part in conditions_outside(found, fold.train, fold.test).items():
            before = all_of_them.setdefault(name, {**part, "n": 0, "of": sum(f.test.size for f in folds)})
            before["n"] += part["n"]
            for key in ("learnt", "tested"):
                before[key] = [min(before[key][0], part[key][0]), max(before[key][1], part[key][1])]
    return all_of_them


def _choose_folds(rows: Rows, n_folds: int | None, left_out: str | None, seed: int) -> tuple[list[Fold], list[str]]:
    options = [name for name, value in (("--cv", n_folds), ("--leave-out", left_out)) if value is not None]
    options += ["--test"] if len(rows.datasets) > 1 else []
    if len(options) > 1:
        raise ConfigError(f"{' and '.join(options)}: take one of them")
    if n_folds is not None:
        return cross_validation(rows, n_folds, seed=seed), []
    if left_out is not None:
        return leave_out(rows, left_out, seed=seed)
    fold, notes = own_splits(rows, seed=seed)
    return [fold], notes


def _load_tables(
    rows: Rows, models: Sequence[str] | None, motion_folder: Path | None
) -> tuple[dict[str, Table], list[str]]:
    """Load the inputs of the baselines and of every model.

    Unavailable ones are skipped unless they are named in ``models``.
    """
    from doppelgait.classify.network import NO_TORCH, torch_is_there

    made: dict[str, Table] = {}
    tables: dict[str, Table] = {}
    skipped = []
    wanted = list(dict.fromkeys(models or DEFAULT))
    if "ensemble" in wanted:  # after its members
        wanted = [*(name for name in dict.fromkeys([*wanted, *MEMBERS]) if name != "ensemble"), "ensemble"]
    for name in [*BASELINES, *wanted]:
        kind = kind_of(name)
        try:
            if kind.learner == "network" and not torch_is_there():
                raise DatasetError(NO_TORCH)
            if name == "ensemble":
                members = [tables[each] for each in MEMBERS if each in tables]
                if len(members) < 2:
                    raise DatasetError(f"{rows.datasets[0].directory}: fewer than two of {', '.join(MEMBERS)}")
                pictures = [table.values for table in members if not table.names]
                values = join_inputs(members[0].values, pictures[0]) if pictures else members[0].values
                tables[name] = Table(values, members[0].names)
                continue
            if kind.features not in made:
                made[kind.features] = table_of(rows, kind.features, motion_folder=motion_folder)
        except DatasetError as error:
            if models is not None and name in models:
                raise
            skipped.append(f"{name} left out: {error}")
            continue
        tables[name] = made[kind.features]
    return tables, [*(part.note for part in made.values() if part.note), *skipped]


def _run_model(
    rows: Rows, table: Table, name: str, folds: Sequence[Fold], seed: int, tick: Callable[[int], None],
    members: Sequence[Sequence[Sequence[Model]]] = (),
) -> _Run:  # fmt: skip
    """Train on every fold and predict its test rows.

    An ensemble is joined of its ``members``, trained on the same folds: by kind, seed and fold.
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
            parts.append(Answers(
                index, rows.labels[fold.test], rows.groups[fold.test], rows.classes, probability,
                np.full(fold.test.size, threshold), ~blocked & (probability.max(axis=1) >= model.facts.abstain_below),
            ))  # fmt: skip
            shuffled = name not in BASELINES and not members  # those of an ensemble are shown
            importance.append(_importance(rows, table, model, fold, seed) if shuffled else {})
        held = model.probability(table.values[fold.held])[np.arange(fold.held.size), rows.labels[fold.held]]
        losses.append(float(-np.log(np.maximum(held, LEAST_PROBABILITY)).mean()) if held.size else np.inf)
        tick(number + 1)
    mean = {key: float(np.mean([part[key] for part in importance])) for key in importance[0]}
    # The answers of all folds, in the order of the rows.
    order = np.argsort(np.concatenate([fold.test for fold in folds if fold.test.size]), kind="stable")
    names = ("labels", "groups", "probability", "threshold", "decided")
    columns = {key: np.concatenate([getattr(part, key) for part in parts])[order] for key in names}
    answers = Answers(index=pd.concat([part.index for part in parts]).iloc[order], classes=rows.classes, **columns)
    return _Run(answers, models, float(np.mean(losses)), mean)


def learn(
    rows: Rows, table: Table, name: str, fold: Fold, *, seed: int, members: Sequence[Sequence[Model]] = ()
) -> Model:
    """Train a model on a fold and calibrate it.

    The held-out rows give the calibration and the threshold of the alarm.

    Parameters
    ----------
    rows : Rows
    table : Table
        Inputs of the model.
    name : str
        Name of a model or a baseline.
    fold : Fold
        Its test rows are not used.
    seed : int
    members : sequence of sequences of Model
        Of an ensemble: trained already, by kind and seed.
    """
    kind, n_classes = kind_of(name), len(rows.classes)
    train, held = (Part(table.values[part], rows.labels[part]) for part in (fold.train, fold.held))
    if members:
        learned: Learned = join([[each.learned for each in kind] for kind in members], held, n_classes=n_classes)
    else:
        learned = fit(kind, train, held, n_classes=n_classes, seed=seed)
    calibration = Calibration(1.0, np.zeros(n_classes), 0)
    if kind.learner != "majority" and held.labels.size:
        calibration = calibrate(learned.log_probability(held.values), held.labels)
    threshold = people = None
    if ALARM_CLASS in rows.classes:
        is_alarm = held.labels == rows.classes.index(ALARM_CLASS)
        probability = calibration(learned.log_probability(held.values))[:, rows.classes.index(ALARM_CLASS)]
        found = detection_threshold(probability, is_alarm, DETECTED_SHARE)
        if np.isfinite(found):
            threshold, people = found, int(np.unique(rows.groups[fold.held][is_alarm]).size)
    # Span of every feature, NaN where it is never known, and the share of rows in which it is unknown.
    lowest, highest, unknown = np.full(len(table.names), np.nan), np.full(len(table.names), np.nan), np.zeros(0)
    if table.names:
        values = features_in(train.values)
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
        conditions=learnt_conditions(conditions_of_rows(rows), fold.train),
        alarm=ALARM_CLASS if ALARM_CLASS in rows.classes else None,
    ).model_copy(update={"alarm_threshold": threshold, "alarm_people": people})
    novelty = None
    if table.names and name not in BASELINES:
        plain = train._replace(values=features_in(train.values))
        novelty = learn_novelty(standard_columns(plain.values), plain, held)
    return Model(facts, learned, calibration, lowest, highest, unknown, novelty)


def _importance(rows: Rows, table: Table, model: Model, fold: Fold, seed: int) -> dict[str, float]:
    """Compute the rise of the log loss when a feature is shuffled.

    Mean of 5 shuffles among the test rows; largest first.
    """
    values, labels = table.values[fold.test], rows.labels[fold.test]
    weights = class_weights(labels, len(rows.classes))

    def loss(inputs: Any) -> float:
        found = model.probability(inputs)[np.arange(labels.size), labels]
        return float(-(weights * np.log(np.maximum(found, LEAST_PROBABILITY))).mean())

    generator, whole = np.random.default_rng(seed), loss(values) if table.names else 0.0
    lost = {}
    for number, name in enumerate(table.names):
        found = []
        for _ in range(SHUFFLES):
            shuffled = values.copy()
            shuffled[:, number] = generator.permutation(shuffled[:, number])
            found.append(loss(shuffled) - whole)
        lost[name] = float(np.mean(found))
    return dict(sorted(lost.items(), key=lambda entry: -entry[1]))
