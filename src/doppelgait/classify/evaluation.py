"""Evaluation of models: folds, training and testing on them, and all scores.

Every target, and all targets that share a scene, are on one side of a fold.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from doppelgait import __version__
from doppelgait.classify import scores, training
from doppelgait.classify.adapt import adapt_to_rows
from doppelgait.classify.alarm import confirm, run_day, score_day
from doppelgait.classify.data import Rows, Table, collect_inputs, collect_rows, select_split, take_rows, unknown_rows
from doppelgait.classify.learned import (
    LEAST_FAR,
    FloatArray,
    Inputs,
    IntArray,
    LabelledRows,
    Learned,
    TrackNetwork,
    join_inputs,
    select_features,
)
from doppelgait.classify.model import (
    BLOCKING,
    ECHOES,
    LEAST_ROWS,
    WIDEST,
    Calibration,
    Facts,
    Model,
    accepted_range,
    calibrate,
    conditions_of_rows,
    find_detection_threshold,
    find_training_conditions,
    format_span,
    mark_flagged,
    mark_outside,
    row_weights,
)
from doppelgait.classify.scores import DETECTED_SHARE, Answers
from doppelgait.classify.training import BASELINES, DEFAULT, MEMBERS
from doppelgait.core.config import convert_to_json
from doppelgait.core.errors import ConfigError, DatasetError, explain_memory
from doppelgait.core.interrupt import raise_if_stopped
from doppelgait.dataset.config import PlanConfig
from doppelgait.dataset.open import Dataset
from doppelgait.dataset.splits import list_names, parse_source

SHUFFLES = 5  # shuffles of a feature for its importance
LEAST_PROBABILITY = 1e-12
HELD_FOLDS = 5
"""One in so many groups is held back for calibration where there is no validation split."""
MOST_LEFT_OUT = 100


@dataclass(frozen=True, eq=False)
class Fold:
    """Rows for training, validation and testing."""

    name: str
    train: IntArray
    held: IntArray
    test: IntArray


def choose_folds(
    rows: Rows, *, n_folds: int | None = None, left_out: str | None = None, seed: int
) -> tuple[list[Fold], list[str]]:
    """Return the folds of a cross-validation, or the dataset's own splits, with notes."""
    values = {"--cv": n_folds, "--leave-out": left_out, "--test": rows.datasets[1:] or None}
    options = [name for name, value in values.items() if value is not None]
    if len(options) > 1:
        raise ConfigError(f"{' and '.join(options)}: use one of them")
    if n_folds is not None:
        folds, notes = split_into_folds(rows, n_folds, seed=seed), list[str]()
    elif left_out is not None:
        folds, notes = leave_out(rows, left_out, seed=seed)
    else:
        fold, notes = use_own_splits(rows, seed=seed)
        folds = [fold]
    for fold in folds:
        both = np.intersect1d(rows.groups[np.concatenate([fold.train, fold.held])], rows.groups[fold.test])
        if both.size:
            raise DatasetError(f"{fold.name}: {both[0]} is in the training and in the test data; split by target")
    return folds, notes


def use_own_splits(rows: Rows, *, seed: int) -> tuple[Fold, list[str]]:
    """Return the dataset's own splits."""
    first = rows.datasets[0].directory
    train, held, notes = select_split(rows, "train"), select_split(rows, "validation"), []
    _check_all_classes(rows, train, f"{first}: the split train")
    if not held.size:
        train, held = hold_back(rows, train, seed)
        notes.append(f"no validation split: {held.size} rows of train were held back for calibration")
    if len(rows.datasets) == 1:
        test, words = select_split(rows, "test"), f"{first}: has no rows in the split test"
        if not test.size:
            raise DatasetError(f"{words}; give another dataset (--test) or cross-validate (--cv 5)")
        return Fold("test split", train, held, test), notes
    other = np.flatnonzero(rows.origin == 1)
    trained = np.concatenate([train, held])
    known = np.isin(rows.groups[other], rows.groups[trained])
    for column in ("subject", "recording", "motion"):
        names = list_names(rows.index, column)
        seen = {name for number in trained for name in names[number]}
        if column == "subject":  # a sampled body is another one in every dataset
            seen = {name for name in seen if parse_source(name) != "model"}
        known |= np.array([not seen.isdisjoint(names[number]) for number in other], dtype=bool)
    if "scene_id" in rows.index:
        scenes = rows.index["scene_id"].iloc[other]
        known |= scenes.isin(scenes[known].dropna()).to_numpy(dtype=bool)
    if known.any():
        notes.append(
            f"{int(known.sum())} of {other.size} rows of the test dataset left out: targets of the training data"
        )
    if known.all():
        raise DatasetError(f"{rows.datasets[1].directory}: all of its targets are in the training data, no row is left")
    return Fold("other dataset", train, held, other[~known]), notes


def split_into_folds(rows: Rows, n_folds: int, *, seed: int) -> list[Fold]:
    """Split all rows into stratified folds of whole groups."""
    from sklearn.model_selection import StratifiedGroupKFold

    fewest = _count_fewest_groups(rows.labels, rows.groups)
    if not 2 <= n_folds <= fewest:
        raise ConfigError(f"--cv {n_folds}: must be from 2 to {fewest}, the targets of the smallest class")
    splitter = StratifiedGroupKFold(n_folds, shuffle=True, random_state=seed)
    folds = []
    for number, (learn, test) in enumerate(splitter.split(rows.labels, rows.labels, rows.groups)):
        folds.append(Fold(f"fold {number}", *hold_back(rows, learn, seed), test))
        _check_all_classes(rows, folds[-1].train, folds[-1].name)
    return folds


def leave_out(rows: Rows, column: str, *, seed: int) -> tuple[list[Fold], list[str]]:
    """Make folds that each leave out a column's value."""
    if column not in rows.index:
        raise ConfigError(
            f"--leave-out {column}: the index has no such column; for example source, subject, motion_kind"
        )
    values = rows.index[column].fillna("unknown").astype(str).to_numpy(dtype=str)
    names = np.unique(values)
    if not 2 <= names.size <= MOST_LEFT_OUT:
        raise ConfigError(f"--leave-out {column}: has {names.size} values; it must have 2 to {MOST_LEFT_OUT}")
    folds, notes = [], []
    for name in names.tolist():
        test = np.flatnonzero(values == name)
        learn = np.flatnonzero((values != name) & ~np.isin(rows.groups, rows.groups[test]))
        if np.unique(rows.labels[learn]).size < len(rows.classes):
            notes.append(f"{column} {name}: not left out, a class has nothing else to learn from")
        else:
            folds.append(Fold(f"without {name}", *hold_back(rows, learn, seed), test))
    if not folds:
        raise ConfigError(f"--leave-out {column}: {'; '.join(notes)}")
    return folds, notes


def _count_fewest_groups(labels: IntArray, groups: scores.Groups) -> int:
    return min(np.unique(groups[labels == number]).size for number in np.unique(labels))


def hold_back(rows: Rows, learn: IntArray, seed: int) -> tuple[IntArray, IntArray]:
    """Hold back a fifth of the groups for calibration."""
    from sklearn.model_selection import StratifiedGroupKFold

    labels, groups = rows.labels[learn], rows.groups[learn]
    fewest = _count_fewest_groups(labels, groups)
    if fewest < HELD_FOLDS:
        return learn, np.empty(0, dtype=np.int64)
    splitter = StratifiedGroupKFold(HELD_FOLDS, shuffle=True, random_state=seed)
    train, held = next(iter(splitter.split(labels, labels, groups)))
    return learn[train], learn[held]


def _check_all_classes(rows: Rows, learn: IntArray, words: str) -> None:
    present = np.unique(rows.labels[learn])
    missing = [name for number, name in enumerate(rows.classes) if number not in present]
    if missing:
        raise DatasetError(f"{words} has no row of {', '.join(missing)}: these classes cannot be trained")


Progress = Callable[[int, int], None]
Members = Sequence[Sequence[Model]]
"""Trained members of an ensemble, by kind and fold."""


@dataclass(frozen=True, eq=False)
class Run:
    """Results of one model over all folds."""

    answers: Answers
    models: list[Model]
    held_loss: float
    importance: dict[str, float]


def run_all(
    rows: Rows, tables: Mapping[str, Table], folds: Sequence[Fold], on_progress: Progress, *, seed: int
) -> dict[str, Run]:
    """Train and test all models."""
    done, runs = count(1), dict[str, Run]()

    def tick() -> None:
        on_progress(next(done), len(tables) * len(folds))

    for name in tables:
        members = [runs[member].models for member in MEMBERS if member in runs] if name == "ensemble" else []
        runs[name] = run_model(rows, tables[name], name, folds, seed, tick, members)
    return runs


def run_model(
    rows: Rows, table: Table, name: str, folds: Sequence[Fold], seed: int, tick: Callable[[], None], members: Members
) -> Run:
    """Train on every fold and predict its test rows."""
    models, parts, losses, importance = [], [], [], []
    for number, fold in enumerate(folds):
        model = learn(rows, table, name, fold, seed=seed, members=[kind[number] for kind in members])
        models.append(model)
        if fold.test.size:
            parts.append(scores.answer_rows(model, take_rows(rows, fold.test), table.values[fold.test]))
            # those of an ensemble are shown; for a network of tracks it would take hours
            shuffled = name not in BASELINES and not members and not isinstance(model.learned, TrackNetwork)
            importance.append(_rank_features(rows, table, model, fold, seed) if shuffled else {})
        own = _compute_losses(model, table.values[fold.held], rows.labels[fold.held])
        losses.append(float(own.mean()) if own.size else np.inf)
        tick()
    mean = {key: float(np.mean([part[key] for part in importance])) for key in importance[0]}
    # The answers of all folds, in the order of the rows.
    tested = np.concatenate([fold.test for fold in folds])
    order = np.argsort(tested, kind="stable")
    columns: dict[str, Any] = {
        key: np.concatenate([getattr(part, key) for part in parts])[order]
        for key in ("probability", "threshold", "decided")
    }
    answers = Answers(**vars(take_rows(rows, tested[order])), **columns)
    return Run(answers, models, float(np.mean(losses)), mean)


def learn(rows: Rows, table: Table, name: str, fold: Fold, *, seed: int, members: Sequence[Model] = ()) -> Model:
    """Train a model on a fold and calibrate it."""
    kind, n_classes = training.find_kind(name), len(rows.classes)
    train, held = (LabelledRows(table.values[part], rows.labels[part]) for part in (fold.train, fold.held))
    if members:
        learned: Learned = training.join([each.learned for each in members], held, n_classes=n_classes)
    else:
        learned = training.fit(kind, train, held, n_classes=n_classes, seed=seed)
    return describe_model(rows, table, name, fold, learned, seed=seed, joined=bool(members))


def describe_model(
    rows: Rows, table: Table, name: str, fold: Fold, learned: Learned, *, seed: int, joined: bool = False
) -> Model:
    """Calibrate what was trained on a fold, and describe its valid conditions."""
    kind, n_classes = training.find_kind(name), len(rows.classes)
    train, held = (LabelledRows(table.values[part], rows.labels[part]) for part in (fold.train, fold.held))
    of_tracks = isinstance(learned, TrackNetwork)
    answers, groups = learned.log_probability(held.values), rows.groups[fold.held]
    if of_tracks:  # the windows that are evidence in a stream
        kept = np.array([each.pictures is not None for each in held.values[:, -1]], dtype=bool)
        kept &= ~mark_flagged(rows.index.iloc[fold.held], ECHOES)
        answers, groups, held = answers[kept], groups[kept], LabelledRows(held.values[kept], held.labels[kept])
    majority = kind.learner == "majority"
    calibration = Calibration(1.0, np.zeros(n_classes), 0) if majority else calibrate(answers, held.labels)
    threshold = people = None
    alarm = rows.alarm if rows.alarm in rows.classes else None
    if alarm is not None:
        number = rows.classes.index(alarm)
        is_alarm = held.labels == number
        probability = calibration(answers)[:, number]
        if of_tracks:  # an alarm stays, so that the highest confirmed probability of a target of two windows counts
            probability = confirm(probability, held.values[:, -1].tolist())
            is_alarm &= probability > 0.0
            groups, target = np.unique(groups[is_alarm], return_inverse=True)
            highest = np.zeros(groups.size)
            np.maximum.at(highest, target, probability[is_alarm])
            probability, is_alarm = highest, np.ones(groups.size, dtype=bool)
        found = find_detection_threshold(probability, is_alarm, DETECTED_SHARE)
        if np.isfinite(found):
            threshold, people = found, int(np.unique(groups[is_alarm]).size)
    # Span of every feature, NaN if never known, and the share of rows in which it is unknown.
    values = select_features(train.values) if table.names else np.zeros((train.labels.size, 0))
    spans = [reduce(values, initial=np.nan) for reduce in (np.fmin.reduce, np.fmax.reduce)]
    if of_tracks:  # the network limits its features, and any of them may be unknown
        spans, values = (
            [np.full(values.shape[1], sign * WIDEST) for sign in (-1.0, 1.0)],
            np.full_like(values[:1], np.nan),
        )
    first = rows.datasets[0].description
    config = first.get("config") or {}
    facts = Facts(
        name=name,
        features=f"{kind.features}+signature" if joined and table.values.dtype == object else kind.features,
        names=table.names,
        classes=rows.classes,
        dataset_id=str(first["id"]),
        dataset_name=str(first.get("name", "")),
        version=__version__,
        n_train=fold.train.size,
        n_held=fold.held.size,
        seed=seed,
        analysis=dict(config.get("analysis") or {}),
        conditions=find_training_conditions(conditions_of_rows(rows), fold.train, of_tracks=of_tracks),
        blocking=ECHOES if of_tracks else BLOCKING,
        window_s=config["dataset"]["window_s"] if of_tracks and config.get("episodes") else None,
        alarm=alarm,
        alarm_threshold=threshold,
        alarm_people=people,
    )
    novelty = None
    if table.names and name not in BASELINES and not of_tracks:
        novelty = training.learn_novelty(training.standardise_columns(values), LabelledRows(values, train.labels), held)
    return Model(facts, learned, calibration, spans[0], spans[1], np.isnan(values).mean(axis=0), novelty)


def _compute_losses(model: Model, values: Inputs, labels: IntArray) -> FloatArray:
    """Return the log loss of every row."""
    found = model.probability(values)[np.arange(labels.size), labels]
    return np.asarray(-np.log(np.maximum(found, LEAST_PROBABILITY)))


def _rank_features(rows: Rows, table: Table, model: Model, fold: Fold, seed: int) -> dict[str, float]:
    """Compute the log-loss rise when features are shuffled."""
    values, labels = table.values[fold.test], rows.labels[fold.test]
    weights = row_weights(labels, len(rows.classes))

    def loss(inputs: Any) -> float:
        return float((weights * _compute_losses(model, inputs, labels)).mean())

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


def make_document(
    rows: Rows, folds: Sequence[Fold], runs: Mapping[str, Run], notes: Sequence[str], *, seed: int
) -> dict[str, Any]:
    """Collect all models' scores for JSON, None for unknown."""
    answers, models = {name: run.answers for name, run in runs.items()}, {}
    tested = {name: int((next(iter(answers.values())).labels == n).sum()) for n, name in enumerate(rows.classes)}
    absent = [name for name, count in tested.items() if not count]
    said = [*notes, *(f"no target of class {name} is tested" for name in absent)]
    for name, run in runs.items():
        kind = training.find_kind(name)
        models[name] = {
            "kind": {"features": kind.features, "learner": kind.learner, "baseline": name in BASELINES},
            **scores.compute_scores(run.answers, seed=seed),
            "held_log_loss": run.held_loss if np.isfinite(run.held_loss) else None,
            "calibrated": all(model.calibration.n_rows > 0 for model in run.models),
            "importance": run.importance,
        }
    sides = [{key: getattr(fold, key) for key in ("train", "held", "test")} for fold in folds]
    document = {
        "doppelgait_version": __version__,
        "seed": seed,
        "classes": list(rows.classes),
        "dataset": _describe_dataset(rows.datasets[0]),
        "test_dataset": _describe_dataset(rows.datasets[1]) if len(rows.datasets) > 1 else None,
        "folds": [
            {"name": fold.name}
            | {key: {"n": part.size, "movers": np.unique(rows.groups[part]).size} for key, part in side.items()}
            for fold, side in zip(folds, sides, strict=True)
        ],
        "tested": tested,
        "models": models,
        "conditions": scores.score_conditions(answers, said, seed),
        "breakdowns": scores.score_breakdowns({name: part for name, part in answers.items() if name not in BASELINES}),
        "notes": said,
    }
    plain: dict[str, Any] = convert_to_json(document)
    return plain


def _describe_dataset(part: Dataset) -> dict[str, Any]:
    known = {key: part.description.get(key) for key in ("id", "name", "config")}
    origin = part.description.get("origin", "simulated")
    return {"directory": str(part.directory), "origin": origin, "n_rows": len(part), **known}


def tabulate_answers(runs: Mapping[str, Run]) -> pd.DataFrame:
    """Tabulate probabilities, class and decision per tested row."""
    tested = next(iter(runs.values())).answers
    columns: dict[str, Any] = {"id": tested.index["id"], "label": tested.index["label"], "mover": tested.groups}
    for name, found in ((name, run.answers) for name, run in runs.items()):
        for number, label in enumerate(found.classes):
            columns[f"{name}:{label}"] = np.round(found.probability[:, number], 6)
        columns[f"{name}:class"] = np.array(found.classes)[found.guesses]
        columns[f"{name}:decided"] = found.decided
    return pd.DataFrame({key: np.asarray(values) for key, values in columns.items()})


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Scores, predictions and trained models of an evaluation.

    Parameters
    ----------
    document : dict
        All scores, for JSON; None for unknown.
    answers : DataFrame
        One line per tested row: id, label, and for every model the probabilities, the class and
        whether it is decided.
    best : str or None
        The ensemble if there is one, else the model with the lowest log loss on the held-out rows,
        or the only model; None if no rows are held out to choose by.
    models : dict
        Trained models by name, as scored; after a cross-validation trained on all rows, and only
        with ``keep``.
    """

    document: dict[str, Any]
    answers: pd.DataFrame
    best: str | None
    models: dict[str, Model]


@explain_memory
def evaluate(
    dataset: Dataset,
    *,
    other: Dataset | None = None,
    models: Sequence[str] | None = None,
    n_folds: int | None = None,
    left_out: str | None = None,
    own: Dataset | None = None,
    unknown: Dataset | None = None,
    motion_folder: Path | None = None,
    seed: int = 0,
    keep: bool = False,
    alarm_class: str | None = None,
    day: PlanConfig | None = None,
    on_progress: Callable[[int, int], None] | None = None,
) -> Evaluation:
    """Train and score models.

    Parameters
    ----------
    dataset : Dataset
        Training data. The models are tested on its split ``test`` unless one of the next three
        parameters is set.
    other : Dataset, optional
        Other test data: all rows except those of targets in the training data.
    models : sequence of str, optional
        Names, by default :data:`doppelgait.classify.training.DEFAULT`, as far as the dataset has
        the inputs. Members of an ensemble, and chance, nuisance parameters and speed are added.
    n_folds : int, optional
        Number of folds of a cross-validation over all rows; a target is in one of them.
    left_out : str, optional
        Leave one value of this column out at a time, for example ``source``.
    own : Dataset, optional
        Your own recordings, to test on and to adapt the models to; those returned are adapted to all.
    unknown : Dataset, optional
        Rows of further classes, on which the models should abstain; they are scored separately.
    motion_folder : Path, optional
        Folder of the motion files of the plan, from which the nuisance parameters are sampled.
    seed : int
        Seed of folds, training and bootstrap.
    keep : bool
        After a cross-validation train each model once more, on all rows.
    alarm_class : str, optional
        Class that triggers the alarm; ``human`` by default.
    day : PlanConfig, optional
        Score the alarm of the kept model over a day (:func:`doppelgait.classify.alarm.run_day`).
    on_progress : callable, optional
        Called with (models trained, models to train).

    Raises
    ------
    DatasetError
        If there is only one class or no test data, or the other dataset lacks features or has
        further classes.
    ConfigError
        If models or options are unknown or exclude each other; or if no model can be chosen to
        keep.

    See Also
    --------
    write_report : write the scores as a page with figures.

    Examples
    --------
    >>> import doppelgait as dg
    >>> plan, folder = dg.dataset.load_plan("home-alarm", overrides=["dataset.examples_per_class=8"])
    >>> report = dg.dataset.build_dataset(plan, "tiny", executor="serial")
    >>> found = dg.classify.evaluate(dg.open_dataset("tiny"), models=["six-logistic"])
    >>> found.document["tested"]
    {'human': 1, 'dog': 1}
    """
    rows = _collect_test_rows(dataset, other, own)
    rows = replace(rows, alarm=_choose_alarm_class(rows, alarm_class, needed=day is not None))
    strangers = None if unknown is None else unknown_rows(unknown, rows)
    for option, other_data in (("--adapt", own), ("--unknown", unknown)):
        if other_data is not None and (n_folds or left_out):
            raise ConfigError(f"{option}: needs one model for all rows; leave --cv and --leave-out out")
    folds, notes = choose_folds(rows, n_folds=n_folds, left_out=left_out, seed=seed)
    tables, skipped = _load_tables(rows, models, motion_folder)
    trained = [name for name in tables if name not in BASELINES]
    if not trained:
        raise DatasetError(f"{dataset.directory}: no model can be trained: {'; '.join(skipped)}")
    whole = folds
    if keep and (n_folds or left_out):
        train, held = hold_back(rows, np.arange(len(rows)), seed)
        whole = [*folds, Fold("all rows", train, held, np.empty(0, dtype=np.int64))]
    # Refuse to keep the best of several models if no held-out rows exist.
    if keep and len(trained) > 1 and "ensemble" not in trained and not all(fold.held.size for fold in whole):
        raise ConfigError(
            f"--save: no rows can be held out to choose among {', '.join(trained)}: a class has too few targets; "
            "name the one model to keep (--models), or add more data"
        )
    progress = on_progress or (lambda done, total: None)
    runs = run_all(rows, tables, whole, progress, seed=seed)
    best = _choose_best({name: runs[name] for name in trained})
    outside = _find_outside(rows, folds)
    notes += [*skipped, *_list_limits(rows, folds, {name: runs[name] for name in trained}, outside)]
    document = make_document(rows, folds, runs, notes, seed=seed)
    document |= {"kept": best, "outside_conditions": outside}
    kept = {name: run.models[-1] for name, run in runs.items() if len(folds) == 1 or len(whole) > len(folds)}
    part = folds[0].test
    for name in trained if own is not None or strangers is not None else ():
        entry, tested, remarks = document["models"][name], tables[name].values[part], list[str]()
        if own is not None:
            adapted = adapt_to_rows(kept[name], take_rows(rows, part), tested, seed=seed)
            kept[name], entry["adaptation"], remarks = adapted
        if strangers is not None:
            entry["unknown"] = scores.open_set_scores(kept[name], tested, strangers)
        document["notes"] += [f"{name}: {remark}" for remark in remarks]
    if day is not None and best is not None and best in kept:
        document["alarm_day"] = {"model": best, **score_day(day, run_day(day, kept[best]), kept[best])}
    return Evaluation(document, tabulate_answers(runs), best, kept)


def _list_limits(rows: Rows, folds: Sequence[Fold], runs: Mapping[str, Run], outside: Mapping[str, Any]) -> list[str]:
    """List what too few held-out rows, a missing class or other conditions prevent."""
    notes = []
    bare = [name for name, run in runs.items() if not all(model.calibration.n_rows for model in run.models)]
    if bare:
        notes.append(f"{', '.join(bare)}: not calibrated, because a class has fewer than {LEAST_ROWS} held-out rows")
    if rows.alarm not in rows.classes:
        notes.append(f"no class {rows.alarm}, so that no model has an alarm; name its class by --alarm-class")
    fewest = min(fold.held.size for fold in folds)
    if fewest < LEAST_FAR:
        notes.append(
            f"{fewest} held-out rows: no model can reject targets by their distance from the training data; this needs "
            f"{LEAST_FAR}"
        )
    return notes + [
        f"{name}: {part['n']} of {part['of']} tested rows have {format_span(*part['tested'])}, outside the "
        f"accepted range, {format_span(*accepted_range(name, *part['learnt']))} (training range "
        f"{format_span(*part['learnt'])}): no decision there; other scores count them"
        for name, part in outside.items()
    ]


def _collect_test_rows(dataset: Dataset, other: Dataset | None, own: Dataset | None) -> Rows:
    """Collect all rows."""
    if own is None:
        return collect_rows(dataset) if other is None else collect_rows(dataset, other)
    if other is not None:
        raise ConfigError("--adapt and --test: use one of them; --adapt tests on recordings that it does not adapt to")
    rows = collect_rows(dataset, own)
    missing = [name for name in rows.classes if not (own.index["label"] == name).any()]
    if missing:
        raise DatasetError(
            f"--adapt {own.directory}: contains no {', '.join(missing)}, so that the shift of the decision is unknown; "
            f"label recordings of every class ({', '.join(rows.classes)})"
        )
    return rows


def _choose_alarm_class(rows: Rows, alarm_class: str | None, *, needed: bool) -> str:
    """Return the class of the alarm, if named or needed."""
    alarm, classes = alarm_class or rows.alarm, ", ".join(rows.classes)
    if alarm_class is not None and alarm not in rows.classes:
        raise ConfigError(f"--alarm-class {alarm_class}: is no class; there are {classes}")
    if needed and alarm not in rows.classes:
        raise ConfigError(f"--alarm: no class {alarm}; name one of {classes} by --alarm-class")
    return alarm


def _choose_best(trained: Mapping[str, Run]) -> str | None:
    """Choose the model to keep, None without held-out rows."""
    if "ensemble" in trained:
        return "ensemble"
    losses = {name: run.held_loss for name, run in trained.items()}
    best = min(losses, key=lambda name: losses[name])
    return best if len(trained) == 1 or np.isfinite(losses[best]) else None


def _find_outside(rows: Rows, folds: Sequence[Fold]) -> dict[str, dict[str, Any]]:
    """Find conditions of tested rows outside the training range."""
    found = conditions_of_rows(rows)
    outside: dict[str, dict[str, Any]] = {}
    n_tested = sum(fold.test.size for fold in folds)
    for fold in folds:
        trained = find_training_conditions(found, fold.train)
        for name, values in found.items():
            far = values[fold.test][mark_outside(values[fold.test], name, trained)]
            if far.size:
                entry = outside.setdefault(name, {"n": 0, "of": n_tested, "learnt": [], "tested": []})
                entry["n"] += far.size
                for key, span in (("learnt", trained[name]), ("tested", far.tolist())):
                    entry[key] = [min([*entry[key], *span]), max([*entry[key], *span])]
    return outside


def _load_tables(
    rows: Rows, models: Sequence[str] | None, motion_folder: Path | None
) -> tuple[dict[str, Table], list[str]]:
    """Collect the inputs of every model, with notes on those that have none."""
    from doppelgait.classify.network import NO_TORCH, is_torch_installed

    load = cache(lambda features: collect_inputs(rows, features, motion_folder=motion_folder))
    tables: dict[str, Table] = {}
    skipped = []
    wanted = list(dict.fromkeys(models or DEFAULT))
    if "ensemble" in wanted:  # the ensemble follows its members
        wanted = [*(name for name in dict.fromkeys([*wanted, *MEMBERS]) if name != "ensemble"), "ensemble"]
    for name in [*BASELINES, *wanted]:
        kind = training.find_kind(name)
        try:
            if kind.learner == "network" and not is_torch_installed():
                raise DatasetError(NO_TORCH)
            if name != "ensemble":
                tables[name] = load(kind.features)
                continue
            members = [tables[each] for each in MEMBERS if each in tables]
            if len(members) < 2:
                raise DatasetError(f"{rows.datasets[0].directory}: fewer than two of {', '.join(MEMBERS)}")
            first, *_, last = members  # signatures are last
            tables[name] = first if last.names else Table(join_inputs(first.values, last.values), first.names)
        except DatasetError as error:
            if models is not None and name in models:
                raise
            skipped.append(f"{name} left out: {error}")
    return tables, [*dict.fromkeys(table.note for table in tables.values() if table.note), *skipped]
