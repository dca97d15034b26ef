"""A Zarr store, version 3 of the format: one group per split, arrays over examples, as xarray reads them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from doppelgait.core.errors import DatasetError
from doppelgait.core.labels import COORDINATE_UNITS
from doppelgait.dataset.batches import stack
from doppelgait.dataset.example import axis_name
from doppelgait.dataset.export.rows import file_name, flat_index, splits_of
from doppelgait.dataset.feature_matrix import unit_of
from doppelgait.dataset.fields import AXIS_UNITS
from doppelgait.dataset.open import Dataset

EXAMPLES_PER_FILE = 64
"""Examples in one file (a Zarr shard); each is a chunk of its own in it."""


def write_zarr(dataset: Dataset, folder: Path, fields: tuple[str, ...], done: Callable[[int], None]) -> None:
    """``dataset.zarr`` with the groups ``SPLIT/index`` and ``SPLIT/FIELD``.

    Every column of the index is an array (example). A field is an array (example, ...) with the dimensions of the
    library and its axes beside it: a coordinate of its dimension where all examples of the split share it, else an
    array (example, ...) with the unit in its name. Where the shapes of a field differ in a split, every example has a
    group ``SPLIT/FIELD/ID`` instead.

    Raises
    ------
    DatasetError
        If zarr is not installed.
    """
    try:
        import zarr
    except ImportError:
        raise DatasetError("zarr is not installed; install it with pip install 'doppelgait[zarr]'") from None
    table = flat_index(dataset)
    root = zarr.create_group(folder / "dataset.zarr", zarr_format=3)
    for split, rows in splits_of(dataset):
        index = root.create_group(f"{split}/index")
        for name in table.columns:
            _write_column(index, str(name), table[name].iloc[rows])
        for name in fields:
            write = _write_stacked if _one_shape(dataset, name, rows) else _write_ragged
            write(root.create_group(f"{split}/{name}"), dataset, name, rows)
        done(rows.size)


def _write_column(group: Any, name: str, values: pd.Series[Any]) -> None:
    if pd.api.types.is_numeric_dtype(values):
        attributes = {"units": unit_of(name)} if pd.api.types.is_float_dtype(values) else {}
        _whole(group, name, values.to_numpy(), ("example",), attributes)
    else:
        texts = values.fillna("").to_numpy(dtype=object).astype(np.dtypes.StringDType())
        _whole(group, name, texts, ("example",), {})


def _one_shape(dataset: Dataset, field: str, rows: npt.NDArray[np.int64]) -> bool:
    return len({dataset.shape(int(row), field) for row in rows}) == 1


def _write_stacked(group: Any, dataset: Dataset, field: str, rows: npt.NDArray[np.int64]) -> None:
    _write_column(group, "id", dataset.index["id"].iloc[rows])
    _write_axes(group, dataset, field, rows)
    facts = dataset.description["fields"][field]
    target: Any = None
    for first in range(0, rows.size, EXAMPLES_PER_FILE):
        block = stack(dataset, field, rows[first : first + EXAMPLES_PER_FILE])
        if target is None:
            shape = block.shape[1:]
            target = group.create_array(
                field, shape=(rows.size, *shape), dtype=block.dtype, chunks=(1, *shape),
                shards=(EXAMPLES_PER_FILE, *shape), dimension_names=("example", *facts["dims"]),
                attributes={"units": facts["units"]},
            )  # fmt: skip
        target[first : first + len(block)] = block


def _write_axes(group: Any, dataset: Dataset, field: str, rows: npt.NDArray[np.int64]) -> None:
    for dim in dataset.description["fields"][field]["dims"]:
        axes = [values for row in rows if (values := _axis(dataset, field, dim, int(row))) is not None]
        if len(axes) < rows.size:
            continue  # scatterers have no axis
        attributes = {"units": COORDINATE_UNITS[dim]}
        if all(np.array_equal(values, axes[0]) for values in axes):
            _whole(group, dim, axes[0], (dim,), attributes)
        else:
            _whole(group, f"{dim}_{AXIS_UNITS[dim]}", np.stack(axes), ("example", dim), attributes)


def _write_ragged(group: Any, dataset: Dataset, field: str, rows: npt.NDArray[np.int64]) -> None:
    facts = dataset.description["fields"][field]
    for row in map(int, rows):
        own = group.create_group(file_name(str(dataset.index["id"].iat[row])))
        for dim in facts["dims"]:
            axis = _axis(dataset, field, dim, row)
            if axis is not None:
                _whole(own, dim, axis, (dim,), {"units": COORDINATE_UNITS[dim]})
        _whole(own, field, dataset.array(field, row), tuple(facts["dims"]), {"units": facts["units"]})


def _axis(dataset: Dataset, field: str, dim: str, row: int) -> npt.NDArray[Any] | None:
    name = axis_name(field, dim)
    return None if name is None else dataset.stored(row, name)


def _whole(
    group: Any, name: str, values: npt.NDArray[Any], dims: tuple[str, ...], attributes: dict[str, str]
) -> None:  # fmt: skip
    """Write a small array as one chunk."""
    array = group.create_array(
        name,
        shape=values.shape,
        dtype=values.dtype,
        chunks=tuple(max(1, n) for n in values.shape),
        dimension_names=dims,
        attributes=attributes,
    )
    array[...] = values
