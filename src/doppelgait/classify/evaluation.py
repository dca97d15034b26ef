"""Evaluation of models: folds, training and testing on them, and all scores.

Every target, and all targets that share a scene, are on one side of a fold.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from doppelgait import __version__
from doppelgait.classify import scores, training
from doppelgait.classify.adapt import adapt_to_rows
from doppelgait.classify.alarm import confirm, score_alarm
from doppelgait.classify.data import (
    Rows,
    Table,
    all_rows,
    collect_answers,
    collect_inputs,
    collect_rows,
    select_split,
    take_rows,
)
from doppelgait.classify.learned import (
    LEAST_FAR,
    FloatArray,
    IntArray,
    LabelledRows,
    Learned,
    Seen,
    join_inputs,
    select_features,
)
from doppelgait.classify.model import (
    ABSTAIN_BELOW,
    BLOCKING,
    ECHOES,
    LEAST_ROWS,
    OF_RADAR,
    USUAL,
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
from doppelgait.classify.options import Options, takes_options
from doppelgait.classify.scores import DETECTED_SHARE, FALSE_SHARE, LEAST_DETECTED, Answers
from doppelgait.classify.training import BASELINES, DEFAULT, MEMBERS, Kind
from doppelgait.core.config import convert_to_json
from doppelgait.core.errors import ConfigError, DatasetError, explain_memory
from doppelgait.core.interrupt import raise_if_stopped
from doppelgait.dataset.config import PlanConfig
from doppelgait.dataset.open import Dataset, open_dataset
from doppelgait.dataset.plan import list_names, parse_source

SHUFFLES = 5  # shuffles of a feature for its importance
LEAST_PROBABILITY = 1e-12
HELD_FOLDS = 5  # one in so many groups is held back where there is no validation split
MOST_LEFT_OUT = 100


class Fold(NamedTuple):
    """Rows for training, validation and testing."""

    name: str
    train: IntArray
    held: IntArray
    test: IntArray


def choose_folds(rows: Rows, options: Options) -> tuple[list[Fold], list[str]]:
    """Return the folds of a cross-validation, or the dataset's own splits, with notes."""
    crossed = options.n_folds is not None or options.left_out is not None
    folds, notes = (split_into_folds if crossed else use_own_splits)(rows, options)
    for fold in folds:
        both = np.intersect1d(rows.groups[np.concatenate([fold.train, fold.held])], rows.groups[fold.test])
        if both.size:
            raise DatasetError(f"{fold.name}: {both[0]} is in the training and in the test data; split by target")
    return folds, notes


def use_own_splits(rows: Rows, options: Options) -> tuple[list[Fold], list[str]]:
    """Return the dataset's own splits."""
    first = rows.datasets[0].directory
    train, held, notes = select_split(rows, "train"), select_split(rows, "validation"), []
    if train.size or options.answers is None or options.models:
        _check_all_classes(rows, train, f"{first}: the split train")
    else:
        notes.append("There are no rows in the split train, so that no baseline is trained.")
    if train.size and not held.size:
        train, held = next(hold_back(rows, train, options.seed))
        notes.append(f"There is no validation split: {held.size} rows of train were held back for calibration.")
    if len(rows.datasets) == 1:
        test, words = select_split(rows, "test"), f"{first}: has no rows in the split test"
        if not test.size:
            raise DatasetError(f"{words}; give another dataset (--test) or cross-validate (--cv 5)")
        return [Fold("test split", train, held, test)], notes
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
            f"{int(known.sum())} of {other.size} rows of the test dataset were left out, because their targets are in "
            "the training data."
        )
    if known.all():
        raise DatasetError(f"{rows.datasets[1].directory}: all of its targets are in the training data, no row is left")
    return [Fold("other dataset", train, held, other[~known])], notes


def split_into_folds(rows: Rows, options: Options) -> tuple[list[Fold], list[str]]:
    """Make stratified folds of whole groups, or a fold without each value of a column."""
    from sklearn.model_selection import StratifiedGroupKFold

    column, folds, notes = options.left_out, list[Fold](), list[str]()
    if column is None:
        n_folds, fewest = options.n_folds or 0, _count_fewest_groups(rows.labels, rows.groups)
        if not 2 <= n_folds <= fewest:
            raise ConfigError(f"--cv {n_folds}: must be from 2 to {fewest}, the targets of the smallest class")
        splitter = StratifiedGroupKFold(n_folds, shuffle=True, random_state=options.seed)
        sides = enumerate(splitter.split(rows.labels, rows.labels, rows.groups))
        tests = {f"fold {number}": test for number, (_, test) in sides}
    elif column not in rows.index:
        raise ConfigError(
            f"--leave-out {column}: the index has no such column; for example source, subject, motion_kind"
        )
    else:
        values = rows.index[column].fillna("unknown").astype(str).to_numpy(dtype=str)
        tests = {f"without {name}": np.flatnonzero(values == name) for name in np.unique(values).tolist()}
        if not 2 <= len(tests) <= MOST_LEFT_OUT:
            raise ConfigError(f"--leave-out {column}: has {len(tests)} values; it must have 2 to {MOST_LEFT_OUT}")
    for name, test in tests.items():
        learn = np.flatnonzero(~np.isin(rows.groups, rows.groups[test]))
        if column is not None and np.unique(rows.labels[learn]).size < len(rows.classes):
            value = name.removeprefix("without ")
            notes.append(f"{column} {value} was not left out, because a class has nothing else to learn from.")
            continue
        folds.append(Fold(name, *next(hold_back(rows, learn, options.seed)), test))
        _check_all_classes(rows, folds[-1].train, name)
    if not folds:
        raise ConfigError(f"--leave-out {column}: {' '.join(notes)}")
    return folds, notes


def _count_fewest_groups(labels: IntArray, groups: scores.Groups) -> int:
    return min(np.unique(groups[labels == number]).size for number in np.unique(labels))


def hold_back(rows: Rows, learn: IntArray, seed: int) -> Iterator[tuple[IntArray, IntArray]]:
    """Yield in turn what learns, and a fifth of kinds or groups for calibration."""
    from sklearn.model_selection import StratifiedGroupKFold

    labels, groups = rows.labels[learn], rows.groups[learn]
    if all((part.description.get("config") or {}).get("episodes") for part in rows.datasets):
        # a home has kinds of episode that no plan has: the confidence in those is what counts
        kinds = rows.index["scene_id"].iloc[learn].str.rpartition("-")[0].to_numpy(dtype=str)
        crossed = len({*zip(groups, kinds, strict=True)}) > len({*groups})  # in several kinds
        groups = groups if crossed or _count_fewest_groups(labels, kinds) < HELD_FOLDS else kinds
    if _count_fewest_groups(labels, groups) < HELD_FOLDS:
        yield learn, np.empty(0, dtype=np.int64)
        return
    splitter = StratifiedGroupKFold(HELD_FOLDS, shuffle=True, random_state=seed)
    for train, held in splitter.split(labels, labels, groups):
        yield learn[train], learn[held]


def _check_all_classes(rows: Rows, learn: IntArray, words: str) -> None:
    present = np.unique(rows.labels[learn])
    missing = [name for number, name in enumerate(rows.classes) if number not in present]
    if missing:
        raise DatasetError(f"{words} has no row of {', '.join(missing)}: these classes cannot be trained")


class Run(NamedTuple):
    """Results of one model over all folds."""

    answers: Answers
    models: list[Model]
    held_loss: float
    importance: dict[str, float]

    @property
    def is_calibrated(self) -> bool:
        """True if the probabilities of all folds are calibrated."""
        return bool(self.models) and all(model.calibration.n_rows > 0 for model in self.models)


def run_model(
    rows: Rows,
    table: Table,
    name: str,
    folds: Sequence[Fold],
    seed: int,
    members: Sequence[Run],
    tick: Callable[[], None],
) -> Run:
    """Train on every fold and predict its test rows."""
    models, parts, losses, importance = [], [], [], []
    for number, fold in enumerate(folds):
        model = learn(rows, table, name, fold, seed=seed, members=[member.models[number] for member in members])
        models.append(model)
        if fold.test.size:
            parts.append(scores.answer_rows(model, take_rows(rows, fold.test), table.values[fold.test]))
            # those of an ensemble are shown; for a network of tracks it would take hours
            shuffled = name not in BASELINES and not members and model.learned.kind != "track"
            importance.append(_rank_features(rows, table, model, fold, seed) if shuffled else {})
        own = _compute_losses(model.probability(table.values[fold.held]), rows.labels[fold.held])
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
    return describe_model(rows, table, name, fold, learned, seed=seed)


def find_alarm_threshold(
    probability: FloatArray, is_alarm: scores.Bools, groups: scores.Groups, seen: Sequence[Seen] | None = None
) -> dict[str, Any]:
    """Find the probability that raises the alarm, the number of people behind it, and the share who stay below."""
    if seen is not None:  # an alarm stays, so that the highest confirmed probability of a target of two windows counts
        probability = confirm(probability, seen)
        among = np.isin(groups, groups[is_alarm])  # of a recording with people, an alarm is right
        of_one = pd.DataFrame({"group": groups, "is_alarm": is_alarm, "highest": probability})
        of_one = of_one[(probability > 0.0) & (is_alarm | ~among)].groupby("group", as_index=False).max()
        groups, is_alarm, probability = (of_one[name].to_numpy() for name in of_one)
    found = find_detection_threshold(probability, is_alarm, DETECTED_SHARE)
    if not np.isfinite(found):
        return {}
    if seen is not None:  # of the others even fewer may raise it than of people may be missed
        rare = np.nextafter(find_detection_threshold(probability, ~is_alarm, FALSE_SHARE), 1.0)
        found = max(found, min(rare, find_detection_threshold(probability, is_alarm, LEAST_DETECTED)))
    people, missed = np.unique(groups[is_alarm]).size, (probability[is_alarm] < found).mean()
    return {"alarm_threshold": float(found), "alarm_people": people, "alarm_missed": float(missed)}


def describe_model(
    rows: Rows, table: Table, name: str, fold: Fold, learned: Learned, *, seed: int, answers: FloatArray | None = None
) -> Model:
    """Calibrate what was trained on a fold, by its or other answers to the held rows."""
    kind, n_classes = training.find_kind(name), len(rows.classes)
    train, held = (LabelledRows(table.values[part], rows.labels[part]) for part in (fold.train, fold.held))
    of_tracks = learned.kind == "track"
    answers = learned.log_probability(held.values) if answers is None else answers
    groups = rows.groups[fold.held]
    if of_tracks:  # the windows that are evidence in a stream
        kept = np.array([each.pictures is not None for each in held.values[:, -1]], dtype=bool)
        kept &= ~mark_flagged(rows.index.iloc[fold.held], ECHOES)
        answers, groups, held = answers[kept], groups[kept], LabelledRows(held.values[kept], held.labels[kept])
    majority = kind.learner == "majority"
    calibration = Calibration(1.0, np.zeros(n_classes), 0) if majority else calibrate(answers, held.labels)
    at: dict[str, Any] = {}
    alarm = rows.alarm if rows.alarm in rows.classes else None
    if alarm is not None:
        number = rows.classes.index(alarm)
        seen = held.values[:, -1].tolist() if of_tracks else None
        at = find_alarm_threshold(calibration(answers)[:, number], held.labels == number, groups, seen)
    # Span of every feature, NaN if never known, and the share of rows in which it is unknown.
    values = select_features(train.values) if table.names else np.zeros((train.labels.size, 0))
    spans = [reduce(values, initial=np.nan) for reduce in (np.fmin.reduce, np.fmax.reduce)]
    if of_tracks:  # the network limits its features, and any of them may be unknown
        spans = [np.full_like(spans[0], sign * WIDEST) for sign in (-1.0, 1.0)]
        values = np.full_like(values[:1], np.nan)
    first = rows.datasets[0].description
    config = first.get("config") or {}
    facts = Facts(
        name=name,
        features=f"{kind.features}+signature" if name == "ensemble" and table.values.dtype == object else kind.features,
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
        usual=tuple(flag for flag in OF_RADAR if mark_flagged(rows.index.iloc[fold.train], (flag,)).mean() > USUAL),
        window_s=config["dataset"]["window_s"] if of_tracks and config.get("episodes") else None,
        alarm=alarm,
        **at,
    )
    novelty = None
    if table.names and name not in BASELINES and not of_tracks:
        novelty = training.learn_novelty(LabelledRows(values, train.labels), held)
    return Model(facts, learned, calibration, spans[0], spans[1], np.isnan(values).mean(axis=0), novelty)


def _compute_losses(probability: FloatArray, labels: IntArray) -> FloatArray:
    found = probability[np.arange(labels.size), labels]
    return np.asarray(-np.log(np.maximum(found, LEAST_PROBABILITY)))


def run_answers(rows: Rows, probability: FloatArray, fold: Fold) -> Run:
    """Take the user's own probabilities as those of a model; validation rows with answers give its threshold."""
    held = np.intersect1d(fold.held, np.flatnonzero(rows.index["split"] == "validation"))
    held = held[np.isfinite(probability[held, 0])]
    own, labels, tested, found = probability[held], rows.labels[held], probability[fold.test], dict[str, Any]()
    if rows.alarm in rows.classes:
        number = rows.classes.index(rows.alarm)
        found = find_alarm_threshold(own[:, number], labels == number, rows.groups[held])
    threshold, decided = np.full(len(tested), found.get("alarm_threshold", np.nan)), tested.max(axis=1) >= ABSTAIN_BELOW
    part = vars(take_rows(rows, fold.test))
    answers = Answers(**part, probability=tested, threshold=threshold, decided=decided)
    return Run(answers, [], float(_compute_losses(own, labels).mean()) if held.size else np.inf, {})


def _rank_features(rows: Rows, table: Table, model: Model, fold: Fold, seed: int) -> dict[str, float]:
    values, labels = table.values[fold.test], rows.labels[fold.test]
    rng = np.random.default_rng(seed)
    weights, lost = row_weights(labels, len(rows.classes)), dict[str, float]()
    whole = (weights * _compute_losses(model.probability(values), labels)).mean() if table.names else 0.0
    for number, name in enumerate(table.names):
        raise_if_stopped()
        found, shuffled = [], values.copy()
        for _ in range(SHUFFLES):
            shuffled[:, number] = rng.permutation(values[:, number])
            found.append((weights * _compute_losses(model.probability(shuffled), labels)).mean() - whole)
        lost[name] = float(np.mean(found))
    return dict(sorted(lost.items(), key=lambda entry: -entry[1]))


def make_document(
    rows: Rows, folds: Sequence[Fold], runs: Mapping[str, Run], notes: Sequence[str], *, seed: int
) -> dict[str, Any]:
    """Collect all models' scores for JSON, None for unknown."""
    answers, models = {name: run.answers for name, run in runs.items()}, {}
    tested = {name: int((next(iter(answers.values())).labels == n).sum()) for n, name in enumerate(rows.classes)}
    said = [*notes, *(f"No target of class {name} is tested." for name, count in tested.items() if not count)]
    for name, run in runs.items():
        kind = training.find_kind(name) if run.models else Kind("own", "own")
        models[name] = {
            "kind": {"features": kind.features, "learner": kind.learner, "baseline": name in BASELINES},
            **scores.compute_scores(run.answers, seed=seed),
            "held_log_loss": run.held_loss if np.isfinite(run.held_loss) else None,
            "calibrated": run.is_calibrated,
            "importance": run.importance,
        }
    nuisance = models["nuisance"]["balanced_accuracy"] if "nuisance" in models else {"low": None}
    if (nuisance["low"] or 0.0) > 1.0 / len(rows.classes):
        said.append(
            f"The nuisance parameters alone reach a balanced accuracy of {nuisance['value']:.2f}: "
            "give level, range and speed one distribution for all classes; a network learns these."
        )
    datasets = [
        {"directory": str(one.directory), "origin": one.description.get("origin", "simulated"), "n_rows": len(one)}
        | {key: one.description.get(key) for key in ("id", "name", "config")}
        for one in rows.datasets
    ]
    sides = [{key: getattr(fold, key) for key in ("train", "held", "test")} for fold in folds]
    document: dict[str, Any] = {
        "doppelgait_version": __version__,
        "seed": seed,
        "classes": list(rows.classes),
        "dataset": datasets[0],
        "test_dataset": datasets[1] if len(datasets) > 1 else None,
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
    return {key: convert_to_json(value) for key, value in document.items()}


def tabulate_answers(runs: Mapping[str, Run]) -> pd.DataFrame:
    """Tabulate probabilities, class and decision per tested row."""
    tested = next(iter(runs.values())).answers
    columns: dict[str, Any] = {"id": tested.index["id"], "label": tested.index["label"], "mover": tested.groups}
    for name, run in runs.items():
        found, probability = run.answers, np.round(run.answers.probability, 6).T
        columns |= {f"{name}:{label}": own for label, own in zip(found.classes, probability, strict=True)}
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
@takes_options(Options)
def evaluate(
    dataset: Dataset | str | Path,
    *,
    keep: bool = False,
    day: PlanConfig | str | Path | None = None,
    on_progress: Callable[[int, int], None] | None = None,
    **options: Any,
) -> Evaluation:
    """Train and score models.

    Parameters
    ----------
    dataset : Dataset or path
        Training data. The models are tested on its split ``test`` unless ``other``, ``own``,
        ``n_folds`` or ``left_out`` is set.
    keep : bool
        After a cross-validation train each model once more, on all rows.
    day : PlanConfig or path, optional
        Score the kept model's alarm over a day (:func:`doppelgait.classify.alarm.score_alarm`).
    on_progress : callable, optional
        Called with (models trained, models to train).
    **options

    Raises
    ------
    DatasetError
        If there is only one class or no test data, or the other dataset lacks features or has
        further classes.
    ConfigError
        If models or options are unknown or exclude each other; or if no model can be chosen to
        keep.

    Examples
    --------
    >>> import doppelgait as dg
    >>> plan, folder = dg.dataset.load_plan("home-alarm", overrides=["dataset.examples_per_class=8"])
    >>> report = dg.dataset.build_dataset(plan, "tiny", executor="serial")
    >>> found = dg.classify.evaluate(dg.open_dataset("tiny"), models=["six-logistic"])
    >>> found.document["tested"]
    {'human': 1, 'dog': 1}
    >>> dg.classify.write_report(found, "report")[-1].name
    'index.html'
    """
    chosen = Options(**options)
    rows, unknown = _collect_test_rows(dataset, chosen, needed=day is not None)
    folds, notes = choose_folds(rows, chosen)
    tables, skipped = _load_tables(rows, chosen)
    trained = [name for name in tables if name not in BASELINES]
    if chosen.answers is not None and not trained and (keep or day is not None):
        raise ConfigError("--answers: are of no model to save or to score as an alarm; name one to train by --models")
    if not trained and chosen.answers is None:
        reason = " ".join(skipped) or "baselines are always scored; name a model, too"
        raise DatasetError(f"{rows.datasets[0].directory}: no model can be trained: {reason}")
    whole, seed = folds, chosen.seed
    if keep and (chosen.n_folds or chosen.left_out):
        sides = next(hold_back(rows, np.arange(len(rows)), seed))
        whole = [*folds, Fold("all rows", *sides, np.empty(0, dtype=np.int64))]
    # Refuse to keep the best of several models if no held-out rows exist.
    if keep and len(trained) > 1 and "ensemble" not in trained and not all(fold.held.size for fold in whole):
        raise ConfigError(
            f"--save: no rows are left to choose among {', '.join(trained)}; name one (--models), or add more data"
        )
    done, total, runs = count(1), len(tables) * len(whole), dict[str, Run]()
    own = Path(chosen.answers).stem if isinstance(chosen.answers, str | Path) else "own"
    if chosen.answers is not None:
        own = f"own-{own}" if own in training.CLASSIFIERS else own
        runs[own] = run_answers(rows, collect_answers(chosen.answers, rows, folds[0].test), folds[0])
        notes.append(
            f"{own} has your own probabilities, not calibrated, and decides from 0.8 on; the alarm's threshold is "
            "from answers to validation, if any. Whether it has learned from tested targets is not known."
        )
    tick = (lambda: on_progress(next(done), total)) if on_progress else (lambda: None)
    for name in tables:
        members = [runs[member] for member in MEMBERS if member in runs] if name == "ensemble" else []
        runs[name] = run_model(rows, tables[name], name, whole, seed, members, tick)
    losses = {name: runs[name].held_loss for name in trained}
    best = "ensemble" if "ensemble" in trained else min(losses, key=lambda name: losses[name], default=None)
    if best != "ensemble" and len(trained) > 1 and not np.isfinite(losses[str(best)]):
        best = None  # without held-out rows
    outside = _find_outside(rows, folds)
    notes += [*skipped, *_list_limits(rows, folds, {name: runs[name] for name in trained}, outside)]
    document = make_document(rows, folds, runs, notes, seed=seed)
    document |= {"kept": best, "own": own if own in runs else None, "outside_conditions": outside}
    kept = {name: runs[name].models[-1] for name in tables if len(folds) == 1 or len(whole) > len(folds)}
    part, said = folds[0].test, dict[str, list[str]]()
    for name in trained if chosen.own is not None or unknown is not None else ():
        entry, tested, remarks = document["models"][name], tables[name].values[part], list[str]()
        if chosen.own is not None:
            adapted = adapt_to_rows(kept[name], take_rows(rows, part), tested, seed=seed)
            kept[name], entry["adaptation"], remarks = adapted
        if unknown is not None:
            entry["unknown"] = scores.open_set_scores(kept[name], tested, unknown)
        for remark in remarks:
            said.setdefault(remark, []).append(name)
    document["notes"] += [f"{', '.join(names)}: {remark}" for remark, names in said.items()]
    if day is not None and best is not None and best in kept:
        try:
            document["alarm_day"] = {"model": best, **score_alarm(kept[best], day=day)}
        except ConfigError as error:  # the models are trained: nothing is lost
            document["notes"].append(f"The alarm has no scores: {error}")
    return Evaluation(document, tabulate_answers(runs), best, kept)


def _collect_test_rows(dataset: Dataset | str | Path, options: Options, *, needed: bool) -> tuple[Rows, Rows | None]:
    """Collect all rows, with the class of their alarm, and those of unknown kinds."""
    named = (dataset, options.other, options.own, options.unknown)
    first, other, own, unknown = (open_dataset(each) if isinstance(each, str | Path) else each for each in named)
    rows = collect_rows(*(each for each in (first, other, own) if each is not None))
    classes, alarm = ", ".join(rows.classes), options.alarm_class or rows.alarm
    missing = [name for name in rows.classes if own is not None and not (own.index["label"] == name).any()]
    if missing:
        raise DatasetError(
            f"--adapt {own.directory}: contains no {', '.join(missing)}; label recordings of every class ({classes})"
        )
    if (needed or options.alarm_class is not None) and alarm not in rows.classes:
        raise ConfigError(f"--alarm-class {alarm}: is no class; there are {classes}")
    rows = replace(rows, alarm=alarm)
    if unknown is None:
        return rows, None
    index = unknown.index[~unknown.index["label"].isin(rows.classes)]
    if index.empty:
        raise DatasetError(
            f"--unknown {unknown.directory}: has only the classes {classes}, which the models are trained on"
        )
    return rows, all_rows(unknown, rows.classes, index)


def _list_limits(rows: Rows, folds: Sequence[Fold], runs: Mapping[str, Run], outside: Mapping[str, Any]) -> list[str]:
    """List what too few held-out rows, a missing class or other conditions prevent."""
    notes = []
    if bare := [name for name, run in runs.items() if not run.is_calibrated]:
        models = ", ".join(bare)
        notes.append(f"{models} are not calibrated, because a class has fewer than {LEAST_ROWS} held-out rows.")
    if rows.alarm not in rows.classes:
        notes.append(f"There is no class {rows.alarm}, so that no model has an alarm; name its class by --alarm-class.")
    fewest = min(fold.held.size for fold in folds)
    if runs and fewest < LEAST_FAR:
        notes.append(f"With {fewest} held-out rows nothing is rejected by distance; this needs {LEAST_FAR}.")
    return notes + [
        f"{part['n']} of {part['of']} tested rows have a {name} of {format_span(*part['tested'])}, outside the "
        f"accepted range, {format_span(*accepted_range(name, *part['learnt']))} (training range "
        f"{format_span(*part['learnt'])}). No model decides on them, but the other scores count them."
        for name, part in outside.items()
    ]


def _find_outside(rows: Rows, folds: Sequence[Fold]) -> dict[str, dict[str, Any]]:
    found, outside = conditions_of_rows(rows), dict[str, dict[str, Any]]()
    for fold in folds:
        for name, span in find_training_conditions(found, fold.train).items():
            values = found[name][fold.test]
            far = values[mark_outside(values, name, {name: span})]
            if far.size:
                entry = outside.setdefault(name, {"n": 0, "of": 0, "learnt": [], "tested": []})
                entry |= {"n": entry["n"] + far.size, "of": sum(each.test.size for each in folds)}
                for key, own in (("learnt", span), ("tested", far.tolist())):
                    entry[key] = [min([*entry[key], *own]), max([*entry[key], *own])]
    return outside


def _load_tables(rows: Rows, options: Options) -> tuple[dict[str, Table], list[str]]:
    """Collect the inputs of every model, with notes on those that have none."""
    from doppelgait.classify.network import NO_TORCH, is_torch_installed

    load = cache(lambda features: collect_inputs(rows, features, motion_folder=options.motion_folder))
    tables, skipped = dict[str, Table](), []
    wanted = dict.fromkeys(options.models or (DEFAULT if options.answers is None else ()))
    if not wanted and not select_split(rows, "train").size:  # only the answers of the user are scored
        return {}, []
    if "ensemble" in wanted:  # the ensemble follows its members
        wanted = dict.fromkeys([*(name for name in [*wanted, *MEMBERS] if name != "ensemble"), "ensemble"])
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
            if name in (options.models or ()):
                raise
            skipped.append(f"{name} was left out: {error}.")
    return tables, [*dict.fromkeys(table.note for table in tables.values() if table.note), *skipped]
