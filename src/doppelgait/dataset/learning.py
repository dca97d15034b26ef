"""Arrays, pictures, batches and weights of rows for training."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr

from doppelgait.core.config import convert_to_json
from doppelgait.core.errors import DatasetError
from doppelgait.core.interrupt import raise_if_stopped
from doppelgait.core.rng import RandomSource, Streams, as_generator
from doppelgait.dataset.example import label_arrays, read_carrier_hz
from doppelgait.dataset.shard_files import MAX_OPEN
from doppelgait.processing.patches import Levels, Patch, cut, levels_of

Array = npt.NDArray[Any]
As = Literal["array", "picture"] | Patch
"""Form of the arrays: stored arrays, or pictures of the default or of another format."""

MB = 1_000_000
AXIS_COLUMNS = ("scene_id", "prf_hz", "carrier_hz")
"""Columns of the index that the axes of a signature need."""


class StoredExamples(Protocol):
    """Interface that this module needs of :class:`doppelgait.dataset.Dataset`."""

    @property
    def directory(self) -> Path:
        """Folder of the dataset."""

    @property
    def description(self) -> dict[str, Any]:
        """Content of ``dataset.json``."""

    @property
    def index(self) -> pd.DataFrame:
        """One row per example and target."""

    def __len__(self) -> int: ...

    def array(self, field: str, number: int) -> Array:
        """Read an array of a row, in linear units."""

    def stored(self, number: int, name: str) -> Array | None:
        """Read an array of a row, as stored."""

    def shape(self, number: int, name: str) -> tuple[int, ...] | None:
        """Return the shape of an array of a row without reading it."""

    def check_fields(self, fields: Sequence[str]) -> None:
        """Raise a :class:`DatasetError` if a field is not kept."""

    def class_numbers(self) -> npt.NDArray[np.int64]:
        """Return the class number of every row."""


@dataclass(frozen=True, eq=False)
class LabelledArrays:
    """Arrays of examples; unpacks as ``values, y, groups``.

    Parameters
    ----------
    values : ndarray, shape (n, ...), or list of ndarray
        Values of the rows; a list if their shapes differ.
    y : ndarray of str, shape (n,)
        Labels.
    groups : ndarray of str, shape (n,)
        Group of each row. Rows of a group share a subject or a scene: keep each group in one fold.
    ids : ndarray of str, shape (n,)
    """

    values: Array | list[Array]
    y: npt.NDArray[np.str_]
    groups: npt.NDArray[np.str_]
    ids: npt.NDArray[np.str_]

    def __iter__(self) -> Iterator[Array | list[Array]]:
        """Iterate over values, y and groups, in this order."""
        return iter((self.values, self.y, self.groups))

    def __len__(self) -> int:
        return len(self.y)


def read_signature(dataset: StoredExamples, number: int) -> xr.DataArray | None:
    """Read a row's signature alone, None if absent."""
    index = dataset.index
    row = convert_to_json({name: index[name].iloc[number] for name in ("id", *AXIS_COLUMNS) if name in index})
    facts = {"signature": dataset.description["fields"]["signature"]}
    carrier_hz = read_carrier_hz(dataset.description, row)
    return label_arrays(facts, row, partial(dataset.stored, number), carrier_hz=carrier_hz).get("signature")


def make_picture(signature: xr.DataArray | None, patch: Patch) -> Levels:
    """Convert the middle of a signature to a picture in dB, (n_velocity, n_time)."""
    whole = levels_of(signature, patch)
    if whole is None:
        return np.zeros((patch.n_velocity, patch.n_time), dtype=np.float32)
    return cut(whole, (whole.shape[1] - patch.n_time) // 2, patch) * np.float32(patch.range_db)


def picture_format(as_: As, fields: Sequence[str]) -> Patch | None:
    """Return the format of the pictures, None for arrays."""
    if as_ == "array":
        return None
    if not (as_ == "picture" or isinstance(as_, Patch)):
        raise DatasetError(f"as_: {as_!r} is not allowed; it must be 'array', 'picture' or a doppelgait.classify.Patch")
    for name in fields:
        if name != "signature":
            raise DatasetError(f"as_: only the field signature has a picture; read {name} with as_='array'")
    return as_ if isinstance(as_, Patch) else Patch()


def read_fields(dataset: StoredExamples, fields: Sequence[str], number: int, patch: Patch | None) -> dict[str, Array]:
    """Read the fields of a row, as arrays or as pictures."""
    if patch is None:
        return {name: dataset.array(name, number) for name in fields}
    return {name: make_picture(read_signature(dataset, number), patch) for name in fields}


POOL_SHARDS = MAX_OPEN // 2
"""Number of shards that are shuffled together."""


def shuffled_rows(index: pd.DataFrame, rng: np.random.Generator) -> npt.NDArray[np.int64]:
    """Shuffle rows so that shard files open once."""
    # rows of a few shards at a time are shuffled together, so that files open once
    codes, shards = pd.factorize(index["shard"])
    place_of_shard = rng.permutation(len(shards))
    pool = place_of_shard[codes] // POOL_SHARDS
    order = rng.permutation(len(index))
    return order[np.argsort(pool[order], kind="stable")]


def batches_of(
    dataset: StoredExamples, fields: Sequence[str], batch_size: int, rng: RandomSource | None, *, shuffle: bool, as_: As
) -> Iterator[dict[str, npt.NDArray[Any]]]:
    """Yield batches; see :meth:`doppelgait.dataset.Dataset.batches`."""
    dataset.check_fields(fields)
    patch = picture_format(as_, fields)
    if batch_size < 1:
        raise DatasetError(f"batch_size: {batch_size} is not allowed; it must be 1 or larger")
    if shuffle and rng is None:
        raise DatasetError("batches: shuffling needs rng, for example doppelgait.rng(1); or shuffle=False")
    rows = np.arange(len(dataset))
    if shuffle and rng is not None:
        rows = shuffled_rows(dataset.index, as_generator(rng, "batches"))
    return _read(dataset, fields, batch_size, rows, patch)


def _read(
    dataset: StoredExamples, fields: Sequence[str], batch_size: int, rows: npt.NDArray[np.int64], patch: Patch | None
) -> Iterator[dict[str, npt.NDArray[Any]]]:
    numbers = dataset.class_numbers()
    for first in range(0, len(rows), batch_size):
        part = rows[first : first + batch_size]
        arrays = {name: stack(dataset, name, part, patch) for name in fields}
        yield {**arrays, "label": numbers[part], "number": part}


def stack(
    dataset: StoredExamples, field: str, rows: npt.NDArray[np.int64], patch: Patch | None = None
) -> npt.NDArray[Any]:
    """Stack the arrays of rows as one, (row, ...)."""
    values = [read_fields(dataset, [field], int(row), patch)[field] for row in rows]
    for row, value in zip(rows, values, strict=True):
        if value.shape != values[0].shape:
            first, other = (dataset.index["id"].iloc[int(place)] for place in (rows[0], row))
            raise DatasetError(
                f"{field}: {first} has the shape {values[0].shape}, {other} {value.shape}; select examples of one "
                "shape, read them one by one, or read signatures as pictures (as_='picture')"
            )
    return np.stack(values)


def epoch_rows(index: pd.DataFrame, seed: int | None, epoch: int, worker: int, workers: int) -> npt.NDArray[np.int64]:
    """Return the rows of one worker in one epoch, each once."""
    rows = np.arange(len(index))
    if seed is not None:
        rows = shuffled_rows(index, Streams(seed, epoch).generator("batches"))
    return rows[worker::workers]


def collect_arrays(dataset: StoredExamples, field: str, as_: As, memory_mb: float) -> LabelledArrays:
    """Read a field of all rows; see :meth:`doppelgait.dataset.Dataset.arrays`."""
    dataset.check_fields([field])
    patch = picture_format(as_, [field])
    if patch is None:
        shapes = [dataset.shape(number, field) or () for number in range(len(dataset))]
        facts = dataset.description["fields"][field]
        dtype = np.dtype(facts["dtype"] if facts.get("scale", "linear") == "linear" else np.float32)
    else:
        shapes = [(patch.n_velocity, patch.n_time)] * len(dataset)
        dtype = np.dtype(np.float32)
    need_mb = sum(map(math.prod, shapes)) * dtype.itemsize / MB
    if not need_mb <= memory_mb:
        raise DatasetError(
            f"arrays: {field} of {len(dataset):,} rows would take {need_mb:,.1f} MB, memory_mb is {memory_mb:,g}; "
            "select fewer rows, use batches() or torch(), or raise memory_mb"
        )
    values: Array | list[Array]
    values = np.empty((len(dataset), *shapes[0]), dtype) if len({*shapes}) == 1 else [np.empty(0)] * len(dataset)
    for number in range(len(dataset)):
        raise_if_stopped()
        values[number] = read_fields(dataset, [field], number, patch)[field]
    index = dataset.index
    group = "group" if "group" in index else "subject"  # schema version 1 had one target per scene
    return LabelledArrays(values, *(index[name].to_numpy(dtype=str) for name in ("label", group, "id")))


def balanced_weights(counts: npt.NDArray[np.int64]) -> npt.NDArray[np.float64]:
    """Return weights of mean 1 that balance all present classes."""
    present = counts > 0
    weights = np.zeros(counts.size)
    weights[present] = counts.sum() / (present.sum() * counts[present])
    return weights
