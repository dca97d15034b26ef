"""What all forms of export share: splits, plain rows and arrays with their axes."""

from __future__ import annotations

from collections.abc import Iterator
from urllib.parse import quote

import numpy as np
import numpy.typing as npt
import pandas as pd

from doppelgait.dataset.config import SPLITS
from doppelgait.dataset.example import axis_name
from doppelgait.dataset.open import Dataset

PLACES = ("shard", "row", "shard_sha256")
"""Columns that say where a row's arrays are in the dataset itself."""


def splits_of(dataset: Dataset) -> Iterator[tuple[str, npt.NDArray[np.int64]]]:
    """Splits that have rows, and those rows."""
    for split in SPLITS:
        rows = np.flatnonzero((dataset.index["split"] == split).to_numpy(dtype=bool))
        if rows.size:
            yield split, rows


def flat_index(dataset: Dataset) -> pd.DataFrame:
    """The index without places in shard files, with ``class_number`` behind the label."""
    table = dataset.index.drop(columns=[name for name in PLACES if name in dataset.index])
    table.insert(list(table.columns).index("label") + 1, "class_number", dataset.class_numbers())
    return table


def arrays_of(dataset: Dataset, row: int, fields: tuple[str, ...]) -> dict[str, npt.NDArray[np.generic]]:
    """Arrays of a row in linear units and their axes by name; a field without axes in its shard comes alone."""
    arrays: dict[str, npt.NDArray[np.generic]] = {}
    for name in fields:
        arrays[name] = dataset.array(name, row)
        for dim in dataset.description["fields"][name]["dims"]:
            axis = axis_name(name, dim)
            values = None if axis is None else dataset.stored(row, axis)
            if axis is not None and values is not None:
                arrays[axis] = values
    return arrays


def file_name(example_id: str) -> str:
    """Name for the files of an example: its id, with everything but letters, digits, ``_`` and ``-`` escaped."""
    return quote(example_id, safe="").replace(".", "%2E").replace("~", "%7E")
