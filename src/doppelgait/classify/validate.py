"""Who learns and who is tested: movers, and all who share a scene with them, are on one side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from doppelgait.classify.data import Rows, split_of
from doppelgait.classify.learned import IntArray
from doppelgait.core.errors import ConfigError, DatasetError

HELD_FOLDS = 5
"""One in so many groups is held back for calibration where there is no validation split."""
MOST_LEFT_OUT = 50


@dataclass(frozen=True, eq=False)
class Fold:
    """Rows by what they are for.

    Parameters
    ----------
    name : str
    train, held, test : ndarray of int
        To learn from; to stop in time, calibrate and set thresholds; to be tested on.
    """

    name: str
    train: IntArray
    held: IntArray
    test: IntArray


def own_splits(rows: Rows, *, seed: int) -> tuple[Fold, list[str]]:
    """The dataset's own splits, or those to learn from and all rows of the other dataset to test on.

    Rows of the other dataset whose recording, mover or motion is also learnt from are left out.

    Returns
    -------
    Fold
    list of str
        What the reader must know of it.

    Raises
    ------
    DatasetError
        If there is nothing to learn from or nothing to be tested on.
    """
    train, held, notes = _learning_rows(rows, seed)
    first = rows.datasets[0].directory
    if len(rows.datasets) == 1:
        test, words = split_of(rows, "test"), f"{first}: has no rows in the split test"
        if not test.size:
            raise DatasetError(f"{words}; give another dataset (--test) or cross-validate (--cv 5)")
        return Fold("test split", train, held, test), notes
    other = np.flatnonzero(rows.origin == 1)
    known = _known(rows, np.concatenate([train, held]), other)
    if known.any():
        notes.append(
            f"{int(known.sum())} of {other.size} rows of the test dataset left out: movers that are learnt from"
        )
    if known.all():
        raise DatasetError(f"--test {rows.datasets[1].directory}: all of its movers are learnt from, nothing is left")
    return Fold("other dataset", train, held, other[~known]), notes


def _learning_rows(rows: Rows, seed: int) -> tuple[IntArray, IntArray, list[str]]:
    train, held = split_of(rows, "train"), split_of(rows, "validation")
    _all_classes(rows, train, f"{rows.datasets[0].directory}: the split train")
    if held.size:
        return train, held, []
    train, held = hold_back(rows, train, seed)
    return train, held, [f"no validation split: {held.size} rows of train were held back for calibration"]


def _known(rows: Rows, learnt: IntArray, other: IntArray) -> npt.NDArray[np.bool_]:
    """Which rows have a group, a recording or a motion that is learnt from."""
    known = np.isin(rows.groups[other], rows.groups[learnt])
    for column in ("motion", "recording"):
        if column in rows.index:
            texts = rows.index[column].fillna("").to_numpy(dtype=str)
            known |= np.isin(texts[other], texts[learnt]) & (texts[other] != "")
    return np.asarray(known)


def cross_validation(rows: Rows, n_folds: int, *, seed: int) -> list[Fold]:
    """Folds over all rows that keep groups together and classes in proportion; each row is tested once.

    Raises
    ------
    ConfigError
        If there are fewer groups of a class than folds, or fewer than two folds.
    """
    from sklearn.model_selection import StratifiedGroupKFold

    fewest = min(np.unique(rows.groups[rows.labels == number]).size for number in range(len(rows.classes)))
    if not 2 <= n_folds <= fewest:
        raise ConfigError(f"--cv {n_folds}: must be from 2 to {fewest}, the movers of the smallest class")
    splitter = StratifiedGroupKFold(n_folds, shuffle=True, random_state=seed)
    folds = []
    for number, (learn, test) in enumerate(splitter.split(rows.labels, rows.labels, rows.groups)):
        train, held = hold_back(rows, learn, seed)
        _all_classes(rows, train, f"fold {number}")
        folds.append(Fold(f"fold {number}", train, held, test))
    return folds


def leave_out(rows: Rows, column: str, *, seed: int) -> tuple[list[Fold], list[str]]:
    """Folds that each leave out what has one value of a column: a source, an animal, a kind of motion.

    Groups with a row on both sides are tested only. Values without which a class could not be learnt are passed over.

    Raises
    ------
    ConfigError
        If the column is not there, has one value or too many, or no value can be left out.
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
    """Rows to learn from and a fifth of the groups that is held back; none where a class has fewer than 5 groups."""
    from sklearn.model_selection import StratifiedGroupKFold

    labels, groups = rows.labels[learn], rows.groups[learn]
    fewest = min(np.unique(groups[labels == number]).size for number in np.unique(labels))
    if fewest < HELD_FOLDS:
        return learn, np.empty(0, dtype=np.int64)
    splitter = StratifiedGroupKFold(HELD_FOLDS, shuffle=True, random_state=seed)
    train, held = next(iter(splitter.split(labels, labels, groups)))
    return learn[train], learn[held]


def _all_classes(rows: Rows, learn: IntArray, words: str) -> None:
    missing = [name for number, name in enumerate(rows.classes) if not (rows.labels[learn] == number).any()]
    if missing:
        raise DatasetError(f"{words} has nobody of {', '.join(missing)}: nothing to learn them from")


def refuse_shared(rows: Rows, folds: Sequence[Fold]) -> None:
    """A :class:`DatasetError` if a group is on two sides of a fold: the dataset was not split by mover."""
    for fold in folds:
        learnt = np.concatenate([fold.train, fold.held])
        both = np.intersect1d(rows.groups[learnt], rows.groups[fold.test])
        if both.size:
            raise DatasetError(f"{fold.name}: {both[0]} is learnt from and tested on; split by mover")
