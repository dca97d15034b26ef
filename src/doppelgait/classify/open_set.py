"""Scores of abstention from kinds outside the training data."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.classify.data import Rows, collect_inputs
from doppelgait.classify.learned import FloatArray
from doppelgait.classify.model import BLOCKING, Model, conditions_of_rows, find_blocking_flag, mark_outside
from doppelgait.classify.scores import auc
from doppelgait.core.errors import DatasetError
from doppelgait.dataset.open import Dataset


def unknown_rows(dataset: Dataset, known: Rows) -> Rows:
    """Collect the rows of classes outside the training data.
    Their class numbers have no meaning.
    """
    index = dataset.index[~dataset.index["label"].isin(known.classes)]
    if index.empty:
        raise DatasetError(
            f"--unknown {dataset.directory}: has only the classes {', '.join(known.classes)}, "
            "which the models are trained on"
        )
    count, place = len(index), index.index.to_numpy(dtype=np.int64)
    group = "group" if "group" in index else "subject"
    nothing = np.zeros(count, dtype=np.int64)
    return Rows(
        (dataset,),
        index.reset_index(drop=True),
        nothing,
        place,
        known.classes,
        nothing,
        index[group].to_numpy(dtype=str),
    )


def blocked_rows(rows: Rows, part: npt.NDArray[np.int64], values: Any, model: Model) -> npt.NDArray[np.bool_]:
    """Mark rows without a decision whatever the probability, shape (n,).
    The cause is a blocking flag, or features, conditions or a distance outside the training data.
    """
    texts = rows.index["quality_flags"].iloc[part].fillna("").tolist()
    flagged = [find_blocking_flag(text.split(";"), BLOCKING) is not None for text in texts]
    blocked = np.array(flagged, dtype=bool) | model.mark_outside(values).any(axis=1)
    blocked |= model.rank(values) < model.facts.novel_below
    for condition, found in conditions_of_rows(rows).items():
        blocked |= mark_outside(found[part], condition, model.facts.conditions)
    return np.asarray(blocked)


def open_set_scores(model: Model, tested: Any, unknown: Rows) -> dict[str, Any]:
    """Score the abstention from every unknown kind."""
    table = collect_inputs(unknown, model.facts.features)
    known_rank, known_sure = _score_novelty(model, tested)
    rank, sure = _score_novelty(model, table.values)
    blocked = blocked_rows(unknown, np.arange(len(unknown)), table.values, model)
    decided = ~blocked & (sure >= model.facts.abstain_below)
    guesses = model.probability(table.values).argmax(axis=1)
    found: dict[str, Any] = {}
    labels = unknown.index["label"].to_numpy(dtype=str)
    for label in np.unique(labels):
        own = labels == label
        novel = np.concatenate([np.zeros(len(known_sure), dtype=bool), np.ones(int(own.sum()), dtype=bool)])
        shares = {
            name: float((decided & (guesses == number))[own].mean()) for number, name in enumerate(unknown.classes)
        }
        found[str(label)] = {
            "n": int(own.sum()),
            "auc": None if rank is None or known_rank is None else auc(np.concatenate([known_rank, rank[own]]), novel),
            "auc_of_probability": auc(-np.concatenate([known_sure, sure[own]]), novel),
            "decided": shares,
        }
    return found


def _score_novelty(model: Model, values: Any) -> tuple[FloatArray | None, FloatArray]:
    """Return distance if measured, and highest probability."""
    far = None if model.novelty is None else model.novelty.distance(values)
    return far, np.asarray(model.probability(values).max(axis=1))
