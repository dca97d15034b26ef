"""Flat tables: Parquet with or without arrays, and CSV."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from doppelgait.dataset.export.rows import arrays_of, flat_index, splits_of
from doppelgait.dataset.feature_matrix import unit_of
from doppelgait.dataset.open import Dataset

if TYPE_CHECKING:
    import pyarrow as pa

VALUES = "_values"
ROW_GROUP = 100
"""Rows of a group of a Parquet file with arrays, which are in memory together."""


def write_csv(dataset: Dataset, folder: Path, fields: tuple[str, ...], done: Callable[[int], None]) -> None:
    """``index.csv``: one line per row with a header; empty for unknown; every number as exactly as it is."""
    table = flat_index(dataset)
    table.to_csv(folder / "index.csv", index=False, lineterminator="\n")
    done(len(table))


def write_parquet(dataset: Dataset, folder: Path, fields: tuple[str, ...], done: Callable[[int], None]) -> None:
    """One ``SPLIT.parquet`` per split: the index, and every field as a list ``FIELD_values`` with its ``FIELD_shape``.

    Rows of an array follow each other (C order); a complex number is two numbers, so that its shape ends with 2. Axes
    are lists, too. Units stand in the metadata of the columns, the description of the fields in that of the file.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = flat_index(dataset)
    for split, rows in splits_of(dataset):
        writer = None
        try:
            for first in range(0, rows.size, ROW_GROUP if fields else rows.size):
                part = rows[first : first + ROW_GROUP] if fields else rows
                group = pa.Table.from_pandas(table.iloc[part], schema=_index_schema(table), preserve_index=False)
                for name, column in _array_columns(dataset, part, fields).items():
                    group = group.append_column(name, column)
                group = _with_units(group, dataset)
                writer = writer or pq.ParquetWriter(folder / f"{split}.parquet", group.schema, compression="zstd")
                writer.write_table(group)
                done(len(part))
        finally:
            if writer is not None:
                writer.close()


def _index_schema(table: pd.DataFrame) -> pa.Schema:
    """Types of the whole table: a column that is empty in one split has the same type in all."""
    import pyarrow as pa

    return pa.Schema.from_pandas(table, preserve_index=False)


def _array_columns(dataset: Dataset, rows: npt.NDArray[np.int64], fields: tuple[str, ...]) -> dict[str, pa.ListArray]:
    import pyarrow as pa

    found = [arrays_of(dataset, int(row), fields) for row in rows] if fields else []
    columns: dict[str, Any] = {}
    for name in dict.fromkeys(name for arrays in found for name in arrays):
        values = [_real(arrays.get(name, np.empty(0))) for arrays in found]
        columns[f"{name}{VALUES}" if name in fields else name] = _list_column([v.ravel() for v in values])
        if name in fields:
            columns[f"{name}_shape"] = pa.array([v.shape for v in values], type=pa.list_(pa.int64()))
    return columns


def _real(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Complex numbers as pairs along a new last axis."""
    return np.ascontiguousarray(values)[..., None].view(values.real.dtype) if values.dtype.kind == "c" else values


def _list_column(values: list[npt.NDArray[Any]]) -> pa.ListArray:
    import pyarrow as pa

    offsets = np.concatenate([[0], np.cumsum([v.size for v in values])]).astype(np.int32)
    return pa.ListArray.from_arrays(offsets, np.concatenate(values))


def _with_units(table: pa.Table, dataset: Dataset) -> pa.Table:
    """Table with the unit of every column of numbers in its metadata."""
    import pyarrow as pa

    fields = dataset.description["fields"]
    shapes = {f"{name}_shape" for name in fields}
    columns = []
    for column in table.schema:
        number = pa.types.is_floating(column.type) or (pa.types.is_list(column.type) and column.name not in shapes)
        field = column.name.removesuffix(VALUES)
        unit = fields[field]["units"] if field in fields and field != column.name else unit_of(column.name)
        columns.append(column.with_metadata({"unit": unit}) if number else column)
    facts = json.dumps({"id": dataset.description["id"], "classes": dataset.description["classes"], "fields": fields})
    return table.cast(pa.schema(columns, metadata={**(table.schema.metadata or {}), b"doppelgait": facts.encode()}))
