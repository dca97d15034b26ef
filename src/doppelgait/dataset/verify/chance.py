"""How well classes can be guessed from a table of parameters, and how likely that is by chance.

The classifier is a Bayes classifier on cells: quantile bins of every parameter and coarser ones of every pair, their
log-likelihood ratios added up. Each parameter and pair counts by how much of its G statistic exceeds twice its degrees
of freedom, so that those without any say stay silent. Cells do not depend on the labels; learning is counting, and a
thousand permutations of the labels, each learned anew, are a few matrix products.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import combinations
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

Float32Array = npt.NDArray[np.float32]
IntArray = npt.NDArray[np.int64]

FOLDS = 5
BINS, PAIR_BINS = 6, 3
MOST_PAIRED = 40
"""Of more parameters no pairs are looked at."""
PRIOR_ROWS = 2.0
"""Rows that every class is given beforehand, spread as all rows are."""
ABOVE_CHANCE = 0.1
"""Allowed part of the way from chance to certainty: 0.55 balanced accuracy of two classes, 0.4 of three."""
LEVEL = 1e-3
PERMUTATIONS = 1000
"""1 in 1001 is below the level: none of them may do as well."""
AT_A_TIME = 100
LEAST_GROUPS = 5


@dataclass(frozen=True)
class Guess:
    """How well classes were guessed.

    Parameters
    ----------
    n_rows, n_parameters : int
    accuracy, allowed : float
        Mean balanced accuracy of the folds, and what is allowed; NaN where nothing could be judged.
    p_value : float
        Share of permutations that do as well, this one counted.
    telling : tuple of (str, float)
        Parameters by the balanced accuracy that each gives alone, largest first.
    reason : str
        Why nothing could be judged.
    """

    n_rows: int
    n_parameters: int
    accuracy: float
    allowed: float
    p_value: float = 1.0
    telling: tuple[tuple[str, float], ...] = ()
    reason: str = ""

    @property
    def leaks(self) -> bool:
        """Whether the classes can be told, beyond chance."""
        return self.accuracy > self.allowed and self.p_value < LEVEL

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        known = {**asdict(self), "telling": dict(self.telling)}
        return {name: None if value != value else value for name, value in known.items()}


@dataclass(frozen=True)
class Cells:
    """Cells of the rows of a table.

    Parameters
    ----------
    members : ndarray of float32, shape (n, n_cells)
        1 in the cell of every term that a row is in.
    starts : ndarray of int, shape (n_terms,)
        First cell of every term: a parameter or a pair.
    """

    members: Float32Array
    starts: IntArray


def guess_classes(table: pd.DataFrame, rng: np.random.Generator) -> Guess:
    """Guess ``label`` from all other columns but ``group``, in folds that keep groups together.

    Parameters
    ----------
    table : DataFrame
        Numbers and texts; a missing value is a value.
    rng : Generator
        For folds and permutations.
    """
    names = [str(name) for name in table.columns if name not in ("label", "group")]
    labels, _ = pd.factorize(table["label"], sort=True)
    groups, _ = pd.factorize(table["group"])
    n_classes = int(labels.max()) + 1
    allowed = 1.0 / n_classes + ABOVE_CHANCE * (1.0 - 1.0 / n_classes)
    fewest = min(len(set(groups[labels == n].tolist())) for n in range(n_classes))
    if fewest < LEAST_GROUPS:
        words = f"too few groups: {fewest} in the smallest class, {LEAST_GROUPS} are needed"
        return Guess(len(table), len(names), float("nan"), allowed, reason=words)
    folds = rng.permutation(int(groups.max()) + 1)[groups] % FOLDS
    columns = [table[name] for name in names]
    cells = cells_of(columns)
    accuracy = float(scores(cells, folds, labels[:, None])[0])
    better = 0
    for start in range(0, PERMUTATIONS, AT_A_TIME):
        count = min(AT_A_TIME, PERMUTATIONS - start)
        drawn = np.column_stack([permuted(labels, groups, rng) for _ in range(count)])
        better += int((scores(cells, folds, drawn) >= accuracy - 1e-12).sum())
    alone = [
        (name, float(scores(cells_of([c]), folds, labels[:, None])[0])) for name, c in zip(names, columns, strict=True)
    ]
    telling = sorted(alone, key=lambda entry: -entry[1])
    return Guess(len(table), len(names), accuracy, allowed, (better + 1) / (PERMUTATIONS + 1), tuple(telling))


def cells_of(columns: Sequence[pd.Series]) -> Cells:
    """Cells of every column and, of up to :data:`MOST_PAIRED`, of every pair."""
    terms = [bins_of(column, BINS) for column in columns]
    if len(columns) <= MOST_PAIRED:
        coarse = [bins_of(column, PAIR_BINS) for column in columns]
        terms += [one * (PAIR_BINS + 1) + two for one, two in combinations(coarse, 2)]
    parts, starts, first = [], [], 0
    for term in terms:
        _, place = np.unique(term, return_inverse=True)
        parts.append((place[:, None] == np.arange(place.max() + 1)).astype(np.float32))
        starts.append(first)
        first += parts[-1].shape[1]
    return Cells(np.hstack(parts), np.array(starts, dtype=np.int64))


def bins_of(column: pd.Series, count: int) -> IntArray:
    """Quantile bin of every value, from 1; 0 where it is missing. Few different values have a bin each."""
    if pd.api.types.is_bool_dtype(column) or pd.api.types.is_numeric_dtype(column):
        values = column.to_numpy(dtype=np.float64, na_value=np.nan)
    else:
        codes, _ = pd.factorize(column.where(column.isna(), column.astype(str)), sort=True)
        values = np.where(codes < 0, np.nan, codes.astype(np.float64))
    known = ~np.isnan(values)
    edges = np.unique(values[known])[1:]
    if edges.size >= count:
        edges = np.unique(np.quantile(values[known], np.arange(1, count) / count))
    return np.where(known, 1 + np.searchsorted(edges, values, side="right"), 0)


def scores(cells: Cells, folds: IntArray, labels: IntArray) -> npt.NDArray[np.float64]:
    """Mean balanced accuracy of the folds, each guessed from the others, for each column of labels (n, n_columns)."""
    n_classes = int(labels.max()) + 1
    found = []
    for fold in range(FOLDS):
        test = folds == fold
        if test.any() and not test.all():
            levels = _levels(cells, test, labels[~test], n_classes)
            found.append(balanced_accuracy(labels[test], levels.argmax(axis=0), n_classes))
    return np.asarray(np.mean(found, axis=0))


def _levels(cells: Cells, test: npt.NDArray[np.bool_], labels: IntArray, n_classes: int) -> Float32Array:
    """Log-likelihood ratio of every class against all rows, for the rows of a fold; shape (n_classes, n_test, P)."""
    train = cells.members[~test]
    spread = (train.mean(axis=0) + 1e-6)[:, None]
    ratios, strength = [], np.zeros((len(cells.starts), labels.shape[1]), dtype=np.float32)
    for number in range(n_classes):
        member = (labels == number).astype(np.float32)
        counts = train.T @ member
        ratio = np.log((counts + PRIOR_ROWS * spread) / (member.sum(axis=0) + PRIOR_ROWS) / spread)
        strength += 2.0 * np.add.reduceat(counts * ratio, cells.starts, axis=0)
        ratios.append(ratio)
    sizes = np.diff(np.append(cells.starts, cells.members.shape[1]))
    freedom = ((sizes - 1) * (n_classes - 1))[:, None]
    weight = np.maximum(1.0 - 2.0 * freedom / np.maximum(strength, 1e-9), 0.0).repeat(sizes, axis=0)
    return np.stack([cells.members[test] @ (weight * ratio).astype(np.float32) for ratio in ratios])


def balanced_accuracy(labels: IntArray, guesses: IntArray, n_classes: int) -> npt.NDArray[np.float64]:
    """Mean over the classes that occur of the share of their rows that is right, for each column."""
    hits, present = np.zeros(labels.shape[1]), np.zeros(labels.shape[1])
    for number in range(n_classes):
        member = labels == number
        count = member.sum(axis=0)
        hits += (member & (guesses == number)).sum(axis=0) / np.maximum(count, 1)
        present += count > 0
    return np.asarray(hits / present)


def permuted(labels: IntArray, groups: IntArray, rng: np.random.Generator) -> IntArray:
    """Labels permuted over groups: among groups of one label each, and within groups of several."""
    n_groups = int(groups.max()) + 1
    low, high = np.full(n_groups, labels.max()), np.zeros(n_groups, dtype=labels.dtype)
    np.minimum.at(low, groups, labels)
    np.maximum.at(high, groups, labels)
    given = low.copy()
    given[low == high] = rng.permutation(low[low == high])
    pure = (low == high)[groups]
    drawn = np.where(pure, given[groups], labels)
    for group in np.flatnonzero(low != high):
        members = np.flatnonzero(groups == group)
        drawn[members] = rng.permutation(labels[members])
    return drawn
