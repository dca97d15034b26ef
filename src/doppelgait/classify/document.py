"""An evaluation as one document: who learnt and was tested, every model's scores, accuracy against conditions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from doppelgait import __version__
from doppelgait.classify.data import Rows
from doppelgait.classify.scorecard import (
    BREAKDOWNS,
    CONDITIONS,
    MOST_VALUES,
    Answers,
    bin_edges,
    breakdown,
    condition_values,
    curve,
    scorecard,
)
from doppelgait.classify.training import BASELINES, kind_of
from doppelgait.classify.validate import Fold
from doppelgait.core.config import json_value


def document_of(
    rows: Rows, folds: Sequence[Fold], answers: Mapping[str, Answers], notes: Sequence[str], *, seed: int
) -> dict[str, Any]:
    """Scores of all models, for JSON; None for unknown.

    Parameters
    ----------
    rows : Rows
    folds : sequence of Fold
    answers : mapping
        Of every model, by name; all about the same rows.
    notes : sequence of str
        What the reader must know of the rows and what was left out.
    seed : int
        Of the bootstrap.
    """
    tested = next(iter(answers.values()))
    said = list(notes) + [
        f"nobody of {name} is tested" for number, name in enumerate(rows.classes) if not (tested.labels == number).any()
    ]
    document = {
        "doppelgait_version": __version__,
        "seed": seed,
        "classes": list(rows.classes),
        "dataset": _dataset_facts(rows, 0),
        "test_dataset": _dataset_facts(rows, 1) if len(rows.datasets) > 1 else None,
        "folds": [_fold_facts(rows, fold) for fold in folds],
        "tested": {name: int((tested.labels == n).sum()) for n, name in enumerate(rows.classes)},
        "models": {name: {"kind": _kind(name), **scorecard(found, seed=seed)} for name, found in answers.items()},
        "conditions": _conditions(answers, said, seed),
        "breakdowns": _breakdowns(answers),
        "notes": said,
    }
    plain: dict[str, Any] = json_value(document)
    return plain


def _kind(name: str) -> dict[str, Any]:
    kind = kind_of(name)
    return {"features": kind.features, "learner": kind.learner, "baseline": name in BASELINES}


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


def _fold_facts(rows: Rows, fold: Fold) -> dict[str, Any]:
    facts: dict[str, Any] = {"name": fold.name}
    for name in ("train", "held", "test"):
        part = getattr(fold, name)
        facts[name] = {"n": int(part.size), "movers": int(np.unique(rows.groups[part]).size)}
    return facts


def _conditions(answers: Mapping[str, Answers], notes: list[str], seed: int) -> dict[str, Any]:
    """Accuracy of every model against every condition that is known and differs."""
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


def _breakdowns(answers: Mapping[str, Answers]) -> dict[str, Any]:
    """Share right by gait, kind of motion, source and mover, where there are several and not too many."""
    tested, found = next(iter(answers.values())), {}
    for column in BREAKDOWNS:
        if column not in tested.index:
            continue
        texts = tested.index[column].fillna("unknown").astype(str).to_numpy(dtype=str)
        if 2 <= np.unique(texts).size <= MOST_VALUES:
            found[column] = {name: breakdown(part, texts) for name, part in answers.items() if name not in BASELINES}
    return found


def answers_table(rows: Rows, answers: Mapping[str, Answers]) -> pd.DataFrame:
    """One line per tested row: identity, and each model's probabilities, class and whether it was decided."""
    tested = next(iter(answers.values()))
    columns: dict[str, Any] = {"id": tested.index["id"], "label": tested.index["label"], "mover": tested.groups}
    for name, found in answers.items():
        for number, label in enumerate(rows.classes):
            columns[f"{name}:{label}"] = np.round(found.probability[:, number], 6)
        columns[f"{name}:class"] = np.array(rows.classes)[found.guesses]
        columns[f"{name}:decided"] = found.decided
    return pd.DataFrame({key: np.asarray(values) for key, values in columns.items()})
