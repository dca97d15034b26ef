"""Folds of an evaluation, and models trained and tested on them.

Every target, and all targets that share a scene, are on one side of a fold.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from doppelgait import __version__
from doppelgait.classify.data import Rows, Table, select_split, take_rows
from doppelgait.classify.learned import IntArray, LabelledRows, Learned, select_features
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
from doppelgait.classify.scores import DETECTED_SHARE, Answers, answer_rows
from doppelgait.classify.training import BASELINES, MEMBERS, find_kind, fit, join, learn_novelty, standardise_columns
from doppelgait.core.errors import ConfigError, DatasetError
from doppelgait.core.interrupt import raise_if_stopped
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

    fewest = min(np.unique(rows.groups[rows.labels == number]).size for number in range(len(rows.classes)))
    if not 2 <= n_folds <= fewest:
        raise ConfigError(f"--cv {n_folds}: must be from 2 to {fewest}, the targets of the smallest class")
    splitter = StratifiedGroupKFold(n_folds, shuffle=True, random_state=seed)
    folds = []
    for number, (learn, test) in enumerate(splitter.split(rows.labels, rows.labels, rows.groups)):
        train, held = hold_back(rows, learn, seed)
        _check_all_classes(rows, train, f"fold {number}")
        folds.append(Fold(f"fold {number}", train, held, test))
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
            continue
        train, held = hold_back(rows, learn, seed)
        folds.append(Fold(f"without {name}", train, held, test))
    if not folds:
        raise ConfigError(f"--leave-out {column}: {'; '.join(notes)}")
    return folds, notes


def hold_back(rows: Rows, learn: IntArray, seed: int) -> tuple[IntArray, IntArray]:
    """Hold back a fifth of the groups for calibration."""
    from sklearn.model_selection import StratifiedGroupKFold

    labels, groups = rows.labels[learn], rows.groups[learn]
    fewest = min(np.unique(groups[labels == number]).size for number in np.unique(labels))
    if fewest < HELD_FOLDS:
        return learn, np.empty(0, dtype=np.int64)
    splitter = StratifiedGroupKFold(HELD_FOLDS, shuffle=True, random_state=seed)
    train, held = next(iter(splitter.split(labels, labels, groups)))
    return learn[train], learn[held]


def _check_all_classes(rows: Rows, learn: IntArray, words: str) -> None:
    missing = [name for number, name in enumerate(rows.classes) if not (rows.labels[learn] == number).any()]
    if missing:
        raise DatasetError(f"{words} has no row of {', '.join(missing)}: these classes cannot be trained")


def refuse_shared(rows: Rows, folds: Sequence[Fold]) -> None:
    """Refuse folds with a group on two sides."""
    for fold in folds:
        trained = np.concatenate([fold.train, fold.held])
        both = np.intersect1d(rows.groups[trained], rows.groups[fold.test])
        if both.size:
            raise DatasetError(f"{fold.name}: {both[0]} is in the training and in the test data; split by target")


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
    """Train on every fold and predict its test rows."""
    # an ensemble combines its ``members``, of the same folds, by kind, seed and fold
    models, parts, losses, importance = [], [], [], []
    for number, fold in enumerate(folds):
        model = learn(rows, table, name, fold, seed=seed, members=[[each[number] for each in kind] for kind in members])
        models.append(model)
        if fold.test.size:
            parts.append(answer_rows(model, take_rows(rows, fold.test), table.values[fold.test]))
            shuffled = name not in BASELINES and not members  # those of an ensemble are shown
            importance.append(_compute_importance(rows, table, model, fold, seed) if shuffled else {})
        held = model.probability(table.values[fold.held])[np.arange(fold.held.size), rows.labels[fold.held]]
        losses.append(float(-np.log(np.maximum(held, LEAST_PROBABILITY)).mean()) if held.size else np.inf)
        tick(number + 1)
    mean = {key: float(np.mean([part[key] for part in importance])) for key in importance[0]}
    # The answers of all folds, in the order of the rows.
    tested = np.concatenate([fold.test for fold in folds])
    columns: dict[str, Any] = {
        key: np.concatenate([getattr(part, key) for part in parts])[np.argsort(tested, kind="stable")]
        for key in ("probability", "threshold", "decided")
    }
    answers = Answers(**vars(take_rows(rows, np.sort(tested))), **columns)
    return Run(answers, models, float(np.mean(losses)), mean)


def learn(
    rows: Rows, table: Table, name: str, fold: Fold, *, seed: int, members: Sequence[Sequence[Model]] = ()
) -> Model:
    """Train a model on a fold and calibrate it."""
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
    # Span of every feature, NaN if never known, and the share of rows in which it is unknown.
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
    """Compute the log-loss rise when features are shuffled."""
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
