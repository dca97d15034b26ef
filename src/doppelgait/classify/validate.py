"""Training and test rows, with every target on one side.

So are all targets that share a scene.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from doppelgait.classify.data import Rows, select_split
from doppelgait.classify.learned import IntArray
from doppelgait.core.errors import ConfigError, DatasetError
from doppelgait.dataset.splits import list_names, parse_source

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
    """Return the dataset's own splits.
    They are tested on the other dataset, if there is one.
    """
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
    """Split all rows into stratified folds of whole groups.
    Each row is tested once.
    """
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
    """Make folds that each leave out a column's value.
    For example a source, an animal or a kind of motion. Groups with a row on both sides are only tested.
    """
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
    """Hold back a fifth of the groups for calibration.
    None where a class has fewer than 5 groups.
    """
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
    """Refuse folds with a group on two sides.
    Raises :class:`DatasetError`: the dataset was not split by target.
    """
    for fold in folds:
        trained = np.concatenate([fold.train, fold.held])
        both = np.intersect1d(rows.groups[trained], rows.groups[fold.test])
        if both.size:
            raise DatasetError(f"{fold.name}: {both[0]} is in the training and in the test data; split by target")
