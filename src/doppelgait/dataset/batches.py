"""Batches of arrays in random order, without a deep-learning library."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from doppelgait.core.errors import DatasetError
from doppelgait.dataset.shard_files import MAX_OPEN

if TYPE_CHECKING:
    from doppelgait.dataset.open import Dataset

POOL_SHARDS = MAX_OPEN // 2
"""Shards whose rows are shuffled together."""


def shuffled_rows(index: pd.DataFrame, rng: np.random.Generator) -> npt.NDArray[np.int64]:
    """Rows of an index in a random order that opens every shard file once.

    The shards are put in random order; the rows of :data:`POOL_SHARDS` of them at a time are shuffled together. A
    dataset of that many shards or fewer is shuffled as a whole. Shards hold all classes in turn, so a pool is mixed.

    Parameters
    ----------
    index : DataFrame
    rng : Generator

    Returns
    -------
    ndarray of int, shape (n,)
    """
    codes, shards = pd.factorize(index["shard"])
    place_of_shard = rng.permutation(len(shards))
    pool = place_of_shard[codes] // POOL_SHARDS
    order = rng.permutation(len(index))
    return order[np.argsort(pool[order], kind="stable")]


def batches_of(
    dataset: Dataset, fields: Sequence[str], batch_size: int, rng: np.random.Generator | None, *, shuffle: bool
) -> Iterator[dict[str, npt.NDArray[Any]]]:
    """Batches of a dataset; see :meth:`doppelgait.dataset.Dataset.batches`."""
    dataset.check_fields(fields)
    if batch_size < 1:
        raise DatasetError(f"batch_size: {batch_size} is not allowed; it must be 1 or larger")
    if shuffle and rng is None:
        raise DatasetError("batches: shuffling needs rng, for example numpy.random.default_rng(1); or shuffle=False")
    rows = shuffled_rows(dataset.index, rng) if shuffle and rng is not None else np.arange(len(dataset))
    return _read(dataset, fields, batch_size, rows)


def _read(
    dataset: Dataset, fields: Sequence[str], batch_size: int, rows: npt.NDArray[np.int64]
) -> Iterator[dict[str, npt.NDArray[Any]]]:
    numbers = dataset.class_numbers()
    for first in range(0, len(rows), batch_size):
        part = rows[first : first + batch_size]
        arrays = {name: stack(dataset, name, part) for name in fields}
        yield {**arrays, "label": numbers[part], "number": part}


def stack(dataset: Dataset, field: str, rows: npt.NDArray[np.int64]) -> npt.NDArray[Any]:
    """Arrays of some rows as one array (row, ...); different shapes are a :class:`DatasetError`."""
    values = [dataset.array(field, int(row)) for row in rows]
    for row, value in zip(rows, values, strict=True):
        if value.shape != values[0].shape:
            first, other = (dataset.index["id"].iloc[int(place)] for place in (rows[0], row))
            raise DatasetError(
                f"{field}: {first} has the shape {values[0].shape}, {other} {value.shape}; select examples of one "
                "shape, or read them one by one"
            )
    return np.stack(values)
