"""Columns of the index as a matrix for scikit-learn."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from fnmatch import fnmatchcase
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from doppelgait.core.errors import DatasetError
from doppelgait.features import FEATURE_UNITS

UNIT_OF_SUFFIX = {
    "mps": "m/s", "hz": "Hz", "m2": "m^2", "v2": "V^2", "deg": "deg", "rad": "rad", "db": "dB", "m": "m", "s": "s",
}  # fmt: skip
"""Unit of a column from the end of its name; others have the unit 1."""

Rows = npt.NDArray[Any]


@dataclass(frozen=True, eq=False)
class Features:
    """Features of examples; unpacks as ``X, y, groups``.

    Parameters
    ----------
    X : ndarray of float64, shape (n, n_features)
        NaN where undetermined.
    y : ndarray of str, shape (n,)
        Labels.
    groups : ndarray of str, shape (n,)
        Whoever shares a group shares a subject or a scene: keep each group in one fold.
    names, units : tuple of str
        One per column of X.
    ids : ndarray of str, shape (n,)
    """

    X: npt.NDArray[np.float64]
    y: npt.NDArray[np.str_]
    groups: npt.NDArray[np.str_]
    names: tuple[str, ...]
    units: tuple[str, ...]
    ids: npt.NDArray[np.str_]

    def __iter__(self) -> Iterator[Rows]:
        """X, y and groups, in this order."""
        return iter((self.X, self.y, self.groups))

    def __len__(self) -> int:
        return len(self.y)


def feature_matrix(index: pd.DataFrame, names: str | Sequence[str], without_flags: Sequence[str]) -> Features:
    """Features of the rows of an index; see :meth:`doppelgait.dataset.Dataset.features`."""
    columns = feature_columns(index, names)
    rows = index if not without_flags else index[~_flagged(index, without_flags)]
    matrix = np.empty((len(rows), len(columns)), dtype=np.float64)
    for place, column in enumerate(columns.values()):
        if not pd.api.types.is_numeric_dtype(rows[column]):
            raise DatasetError(
                f"{column}: holds {rows[column].dtype} values, which are no feature; name number columns"
            )
        matrix[:, place] = rows[column].to_numpy(dtype=np.float64, na_value=np.nan)
    group = "group" if "group" in rows else "subject"  # schema version 1 had one target per scene
    texts = {name: rows[name].to_numpy(dtype=str) for name in ("label", group, "id")}
    units = tuple(FEATURE_UNITS.get(name) or unit_of(name) for name in columns)
    return Features(matrix, texts["label"], texts[group], tuple(columns), units, texts["id"])


def feature_columns(index: pd.DataFrame, names: str | Sequence[str]) -> dict[str, str]:
    """Columns of the index by feature name: of a set (``six``, ``extended``), or as listed."""
    six = {name: f"feature_{name}" for name in FEATURE_UNITS}
    if names == "six":
        return six
    if names == "extended":
        further = [str(c) for c in index.columns if str(c).startswith("extended_")]
        return {**six, "gait_frequency_hz": "gait_frequency_hz", **{name: name for name in further}}
    if isinstance(names, str) or not names:
        raise DatasetError(f"features: {names!r} is not allowed; it must be 'six', 'extended' or a list of columns")
    for name in names:
        if name not in index:
            raise DatasetError(f"features: no column {name!r}{nearest(name, map(str, index.columns))}")
    return {name: name for name in names}


def _flagged(index: pd.DataFrame, patterns: Sequence[str]) -> npt.NDArray[np.bool_]:
    """Rows with a flag that fits one of the patterns."""
    texts = index["flags"].fillna("").to_numpy(dtype=object)
    fits = {
        text: any(fnmatchcase(flag, pattern) for flag in text.split(";") for pattern in patterns)
        for text in set(texts)
    }  # fmt: skip
    return np.array([fits[text] for text in texts], dtype=bool)


def unit_of(column: str) -> str:
    """Unit of a column, which the end of its name tells."""
    return UNIT_OF_SUFFIX.get(column.rpartition("_")[2], "1")


def nearest(name: str, known: Iterable[str]) -> str:
    """``; near in spelling are ...`` for the end of an error message, or how many names there are."""
    names = sorted(known)
    close = get_close_matches(name, names, n=5, cutoff=0.5)
    if close:
        return f"; near in spelling: {', '.join(close)}"
    if len(names) <= 8:
        return f"; there are {', '.join(names) or 'none'}"
    return f"; there are {len(names)}, from {names[0]} to {names[-1]}"
