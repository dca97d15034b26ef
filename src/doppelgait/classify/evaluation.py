"""Evaluation of models: scores, accuracy by condition, trained models."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from doppelgait import __version__
from doppelgait.classify.adapt import adapt_to_nameless_rows, adapt_to_rows
from doppelgait.classify.alarm import Day, run_day, score_day
from doppelgait.classify.data import Rows, Table, collect_inputs, collect_rows, take_rows, unknown_rows
from doppelgait.classify.learned import LEAST_FAR, join_inputs
from doppelgait.classify.model import (
    LEAST_ROWS,
    Model,
    accepted_range,
    conditions_of_rows,
    find_training_conditions,
    format_span,
    mark_outside,
)
from doppelgait.classify.runs import (
    Fold,
    Run,
    hold_back,
    leave_out,
    refuse_shared,
    run_all,
    split_into_folds,
    use_own_splits,
)
from doppelgait.classify.scores import (
    BREAKDOWNS,
    CONDITIONS,
    MOST_VALUES,
    Answers,
    balanced_accuracy,
    compute_scores,
    find_condition_values,
    make_bin_edges,
    open_set_scores,
    score_bins,
    score_groups,
)
from doppelgait.classify.training import BASELINES, DEFAULT, MEMBERS, find_kind
from doppelgait.core.config import convert_to_json
from doppelgait.core.errors import ConfigError, DatasetError
from doppelgait.dataset.open import Dataset

UNLABELLED = "unlabelled"  # label of the user's recordings with unknown content


def make_document(
    rows: Rows, folds: Sequence[Fold], answers: Mapping[str, Answers], notes: Sequence[str], *, seed: int
) -> dict[str, Any]:
    """Collect all models' scores for JSON, None for unknown."""
    tested = next(iter(answers.values()))
    said = list(notes) + [
        f"no target of class {name} is tested"
        for number, name in enumerate(rows.classes)
        if not (tested.labels == number).any()
    ]
    models = {}
    for name, found in answers.items():
        kind = find_kind(name)
        facts = {"features": kind.features, "learner": kind.learner, "baseline": name in BASELINES}
        models[name] = {"kind": facts, **compute_scores(found, seed=seed)}
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
        if 2 <= np.unique(texts).size <= MOST_VALUES:  # plot only columns with a few different values
            shares = {name: score_groups(part, texts) for name, part in answers.items() if name not in BASELINES}
            breakdowns[column] = shares
    document = {
        "doppelgait_version": __version__,
        "seed": seed,
        "classes": list(rows.classes),
        "dataset": _describe_dataset(rows, 0),
        "test_dataset": _describe_dataset(rows, 1) if len(rows.datasets) > 1 else None,
        "folds": fold_facts,
        "tested": {name: int((tested.labels == n).sum()) for n, name in enumerate(rows.classes)},
        "models": models,
        "conditions": _compute_accuracy_by_condition(answers, said, seed),
        "breakdowns": breakdowns,
        "notes": said,
    }
    plain: dict[str, Any] = convert_to_json(document)
    return plain


def _describe_dataset(rows: Rows, number: int) -> dict[str, Any]:
    part = rows.datasets[number]
    return {
        "directory": str(part.directory),
        "id": part.description.get("id"),
        "name": part.description.get("name"),
        "origin": part.description.get("origin", "simulated"),
        "n_rows": len(part),
        "config": part.description.get("config"),
    }


def _compute_accuracy_by_condition(answers: Mapping[str, Answers], notes: list[str], seed: int) -> dict[str, Any]:
    """Compute the accuracy of every model by known, varying condition."""
    tested, found = next(iter(answers.values())), {}
    for condition in CONDITIONS:
        column, values = find_condition_values(tested.index, condition)
        edges = make_bin_edges(values, condition.step)
        if not column:
            notes.append(f"accuracy against {condition.words}: none of {', '.join(condition.columns)} is known")
            continue
        if edges.size < 3:
            notes.append(f"accuracy against {condition.words}: {column} is {edges[0]:g} to {edges[-1]:g} in all rows")
        curves = {
            name: score_bins(part, values, edges, seed=seed) for name, part in answers.items() if name != "chance"
        }
        found[condition.name] = {"words": condition.words, "column": column, "models": curves}
    return found


def tabulate_answers(rows: Rows, answers: Mapping[str, Answers]) -> pd.DataFrame:
    """Tabulate probabilities, class and decision per tested row."""
    tested = next(iter(answers.values()))
    columns: dict[str, Any] = {"id": tested.index["id"], "label": tested.index["label"], "mover": tested.groups}
    for name, found in answers.items():
        for number, label in enumerate(rows.classes):
            columns[f"{name}:{label}"] = np.round(found.probability[:, number], 6)
        columns[f"{name}:class"] = np.array(rows.classes)[found.guesses]
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
        a mean over seeds, or the only model; None if no rows are held out to choose by.
    models : dict
        Trained models by name, as scored; after a cross-validation trained on all rows, and only
        with ``keep``.
    """

    document: dict[str, Any]
    answers: pd.DataFrame
    best: str | None
    models: dict[str, Model]


def evaluate(
    dataset: Dataset,
    *,
    other: Dataset | None = None,
    models: Sequence[str] | None = None,
    n_folds: int | None = None,
    left_out: str | None = None,
    own: Dataset | None = None,
    own_shares: Mapping[str, float] | None = None,
    unknown: Dataset | None = None,
    motion_folder: Path | None = None,
    seed: int = 0,
    n_seeds: int = 1,
    keep: bool = False,
    alarm_class: str | None = None,
    day: Day | None = None,
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
        Of :data:`doppelgait.classify.training.CLASSIFIERS`; by default
        :data:`doppelgait.classify.training.DEFAULT`, as far as the dataset has the inputs. The
        members of an ensemble are evaluated with it, and chance, nuisance parameters and speed
        alone always.
    n_folds : int, optional
        Number of folds of a cross-validation over all rows; the rows of a target are never
        separated.
    left_out : str, optional
        Leave one value of this column out at a time, for example ``source``.
    own : Dataset, optional
        Your own recordings, to test on and to adapt the models to
        (:func:`doppelgait.classify.adapt.score_adaptation`); the models returned are adapted to all
        of them. Where all are labelled :data:`UNLABELLED`, nothing of them is tested, and the
        models are adapted to the shares of the classes among them
        (:func:`doppelgait.classify.adapt.adapt_unlabelled`).
    own_shares : mapping, optional
        Share of every class among own recordings without labels, with sum 1; equal by default.
    unknown : Dataset, optional
        Rows of further classes, on which the models should abstain; they are scored separately.
    motion_folder : Path, optional
        Folder of the motion files of the plan, from which the nuisance parameters are sampled.
    seed : int
        Seed of folds, training and bootstrap.
    n_seeds : int
        Number of training seeds, starting at ``seed``. The ensemble combines the members of all
        seeds; every other model is that of the first seed, and the scores of all seeds are reported
        in addition.
    keep : bool
        After a cross-validation train each model once more, on all rows.
    alarm_class : str, optional
        Class that triggers the alarm; ``human`` by default.
    day : Day, optional
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
    rows, nameless = _collect_test_rows(dataset, other, own, own_shares)
    rows = replace(rows, alarm=_choose_alarm_class(rows, alarm_class, needed=day is not None))
    strangers = None if unknown is None else unknown_rows(unknown, rows)
    for option, other_data in (("--adapt", own), ("--unknown", unknown)):
        if other_data is not None and (n_folds or left_out):
            raise ConfigError(f"{option}: needs one model for all rows; leave --cv and --leave-out out")
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
        # Refuse to keep the best of several models if no held-out rows exist.
        names = [name for name in tables if name not in BASELINES]
        if len(names) > 1 and "ensemble" not in names and not all(fold.held.size for fold in whole):
            raise ConfigError(
                f"--save: no rows can be held out to choose among {', '.join(names)}: a class has too few targets; "
                "name the one model to keep (--models), or add more data"
            )
    runs, by_seed = run_all(rows, tables, whole, seed=seed, n_seeds=n_seeds, on_progress=on_progress)
    trained = [name for name in runs if name not in BASELINES]
    best = _choose_best({name: by_seed[name] for name in trained})
    answers = {name: run.answers for name, run in runs.items()}
    outside = _find_outside(rows, folds)
    said = [*notes, *skipped]
    bare = [name for name in trained if not runs[name].calibrated]
    if bare:
        said.append(f"{', '.join(bare)}: not calibrated, because a class has fewer than {LEAST_ROWS} held-out rows")
    if rows.alarm not in rows.classes:
        said.append(f"no class {rows.alarm}, so that no model has an alarm; name its class by --alarm-class")
    fewest = min(fold.held.size for fold in folds)
    if fewest < LEAST_FAR:
        said.append(
            f"{fewest} held-out rows: no model can reject targets by their distance from the training data; this needs "
            f"{LEAST_FAR}"
        )
    said += [
        f"{name}: {part['n']} of {part['of']} tested rows have {format_span(*part['tested'])}, outside the "
        f"accepted range, {format_span(*accepted_range(name, *part['learnt']))} (training range "
        f"{format_span(*part['learnt'])}): no decision there; other scores count them"
        for name, part in outside.items()
    ]
    document = make_document(rows, folds, answers, said, seed=seed)
    for name, run in runs.items():
        document["models"][name]["held_log_loss"] = run.held_loss if np.isfinite(run.held_loss) else None
        document["models"][name]["calibrated"] = run.calibrated
        document["models"][name]["importance"] = run.importance
        if n_seeds > 1 and name not in BASELINES:
            by_answers = [each.answers for each in by_seed[name]]
            values = [balanced_accuracy(each.labels, each.right, len(each.classes)) for each in by_answers]
            document["models"][name]["seeds"] = [value if np.isfinite(value) else None for value in values]
    document |= {"n_seeds": n_seeds, "kept": best, "outside_conditions": outside}
    kept = {name: run.models[-1] for name, run in runs.items() if len(folds) == 1 or len(whole) > len(folds)}
    if own is not None or strangers is not None:
        part = folds[0].test
        for name in trained:
            further, kept[name], notes = _score_further(
                kept[name],
                take_rows(rows, part),
                tables[name].values[part],
                strangers,
                nameless,
                seed=seed,
                adapted=own is not None,
                shares=own_shares,
            )
            document["models"][name] |= further
            document["notes"] += [f"{name}: {note}" for note in notes]
    if day is not None and best is not None and best in kept:
        document["alarm_day"] = {"model": best, **score_day(day, run_day(day, kept[best]), kept[best])}
    return Evaluation(document, tabulate_answers(rows, answers), best, kept)


def _collect_test_rows(
    dataset: Dataset, other: Dataset | None, own: Dataset | None, shares: Mapping[str, float] | None
) -> tuple[Rows, Rows | None]:
    """Collect all rows, and separately own rows without labels."""
    blank = None if own is None else own.index["label"].to_numpy(dtype=str) == UNLABELLED
    if shares is not None and (blank is None or not blank.any()):
        raise ConfigError(f"--share: needs --adapt and recordings labelled {UNLABELLED!r}")
    if own is None or blank is None:
        return collect_rows(dataset, other), None
    if other is not None:
        raise ConfigError("--adapt and --test: use one of them; --adapt tests on recordings that it does not adapt to")
    if not blank.any():
        rows = collect_rows(dataset, own)
        missing = [name for name in rows.classes if not (own.index["label"] == name).any()]
        if missing:
            raise DatasetError(
                f"--adapt {own.directory}: contains no {', '.join(missing)}, so that the shift of the decision is "
                f"unknown; label recordings of every class ({', '.join(rows.classes)}), or label all {UNLABELLED!r}"
            )
        return rows, None
    if not blank.all():
        raise DatasetError(
            f"--adapt {own.directory}: {blank.sum()} of {blank.size} rows are {UNLABELLED!r}; label all or none"
        )
    rows = collect_rows(dataset)
    if shares is not None:
        listed = ", ".join(f"{name}={share:g}" for name, share in shares.items())
        whole = abs(sum(shares.values()) - 1.0) < 1e-6 and min(shares.values(), default=0.0) > 0
        if set(shares) != set(rows.classes) or not whole:
            raise ConfigError(
                f"--share: {listed}: must name every class ({', '.join(rows.classes)}), each above 0, together 1"
            )
    return rows, unknown_rows(own, rows)


def _choose_alarm_class(rows: Rows, alarm_class: str | None, *, needed: bool) -> str:
    """Return the class of the alarm, if named or needed."""
    if alarm_class is not None and alarm_class not in rows.classes:
        raise ConfigError(f"--alarm-class {alarm_class}: is no class; there are {', '.join(rows.classes)}")
    alarm = alarm_class or rows.alarm
    if needed and alarm not in rows.classes:
        raise ConfigError(f"--alarm: no class {alarm}; name one of {', '.join(rows.classes)} by --alarm-class")
    return alarm


def _choose_best(trained: Mapping[str, Sequence[Run]]) -> str | None:
    """Choose the model to keep, None without held-out rows."""
    if "ensemble" in trained:
        return "ensemble"
    losses = {name: float(np.mean([run.held_loss for run in runs])) for name, runs in trained.items()}
    best = min(losses, key=lambda name: losses[name])
    return best if len(trained) == 1 or np.isfinite(losses[best]) else None


def _score_further(
    model: Model,
    tested: Rows,
    values: Any,
    strangers: Rows | None,
    nameless: Rows | None,
    *,
    seed: int,
    adapted: bool,
    shares: Mapping[str, float] | None,
) -> tuple[dict[str, Any], Model, list[str]]:
    """Score adaptation, then abstention on unknown kinds, with remarks."""
    found: dict[str, Any] = {}
    notes: list[str] = []
    if adapted and nameless is None:
        model, found["adaptation"], notes = adapt_to_rows(model, tested, values, np.random.default_rng(seed))
    elif nameless is not None:
        inputs = collect_inputs(nameless, model.facts.features).values
        model, notes = adapt_to_nameless_rows(model, nameless, inputs, shares)
    if strangers is not None:
        found["unknown"] = open_set_scores(model, values, strangers)
    return found, model, notes


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


def _choose_folds(rows: Rows, n_folds: int | None, left_out: str | None, seed: int) -> tuple[list[Fold], list[str]]:
    options = [name for name, value in (("--cv", n_folds), ("--leave-out", left_out)) if value is not None]
    options += ["--test"] if len(rows.datasets) > 1 else []
    if len(options) > 1:
        raise ConfigError(f"{' and '.join(options)}: use one of them")
    if n_folds is not None:
        return split_into_folds(rows, n_folds, seed=seed), []
    if left_out is not None:
        return leave_out(rows, left_out, seed=seed)
    fold, notes = use_own_splits(rows, seed=seed)
    return [fold], notes


def _load_tables(
    rows: Rows, models: Sequence[str] | None, motion_folder: Path | None
) -> tuple[dict[str, Table], list[str]]:
    from doppelgait.classify.network import NO_TORCH, is_torch_installed

    made: dict[str, Table] = {}
    tables: dict[str, Table] = {}
    skipped = []
    wanted = list(dict.fromkeys(models or DEFAULT))
    if "ensemble" in wanted:  # the ensemble follows its members
        wanted = [*(name for name in dict.fromkeys([*wanted, *MEMBERS]) if name != "ensemble"), "ensemble"]
    for name in [*BASELINES, *wanted]:
        kind = find_kind(name)
        try:
            if kind.learner == "network" and not is_torch_installed():
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
                made[kind.features] = collect_inputs(rows, kind.features, motion_folder=motion_folder)
        except DatasetError as error:
            if models is not None and name in models:
                raise
            skipped.append(f"{name} left out: {error}")
            continue
        tables[name] = made[kind.features]
    return tables, [*(part.note for part in made.values() if part.note), *skipped]
