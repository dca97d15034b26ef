"""Pulses and scatterer rows on demand: ten minutes have a gigabyte, processed by tiles."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt


class LateModule:
    """Module that is imported when a name of it is used: xarray and pandas take 0.27 s."""

    def __init__(self, module: str) -> None:
        self._module = module

    def __getattr__(self, name: str) -> Any:
        return getattr(__import__(self._module), name)


if TYPE_CHECKING:
    import xarray
    from xarray.core.indexing import LazilyIndexedArray

    xr = xarray
else:
    xr = LateModule("xarray")

LONG_PULSES = 1 << 15  # about the pulses of a tile; longer recordings are processed in tiles


@dataclass(frozen=True)
class LateRows:
    """Rows (pulse, ...) that ``rows(first, stop)`` reads or computes at every access."""

    shape: tuple[int, ...]
    rows: Callable[[int, int], npt.NDArray[Any]]
    dtype: Any

    def __getitem__(self, key: Any) -> Any:
        """Return some pulses, or the rows on demand of some columns."""
        if isinstance(key, slice):
            first, stop, step = key.indices(self.shape[0])
            return self.rows(first, max(first, stop))[::step] if step > 0 else self.rows(0, self.shape[0])[key]
        columns = key[1]
        width = len(range(*columns.indices(self.shape[1]))) if isinstance(columns, slice) else len(columns)
        return LateRows((self.shape[0], width), partial(_take_columns, self.rows, columns), self.dtype)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> npt.NDArray[Any]:
        return np.asarray(self.rows(0, self.shape[0]), dtype=dtype)

    def read(self, key: tuple[Any, ...]) -> npt.NDArray[Any]:
        """Return the values of an index of numbers and slices."""
        pulses, *columns = key
        if isinstance(pulses, slice):
            return np.asarray(self[pulses][(slice(None), *columns)])
        row = int(pulses) % self.shape[0]
        return np.asarray(self.rows(row, row + 1)[(0, *columns)])


def _take_columns(rows: Callable[[int, int], npt.NDArray[Any]], columns: Any, first: int, stop: int) -> Any:
    return rows(first, stop)[:, columns]


@cache
def _define_source() -> type:
    from xarray.backends import BackendArray
    from xarray.core.indexing import IndexingSupport, explicit_indexing_adapter

    class Source(BackendArray):
        """Rows on demand, indexed by xarray."""

        def __init__(self, late: LateRows) -> None:
            self.shape, self.dtype, self._late = late.shape, np.dtype(late.dtype), late

        def __reduce__(self) -> tuple[Any, ...]:
            return _make_source, (self._late,)

        def __getitem__(self, key: Any) -> npt.NDArray[Any]:
            return np.asarray(explicit_indexing_adapter(key, self.shape, IndexingSupport.BASIC, self._late.read))

    return Source


def _make_source(late: LateRows) -> Any:
    return _define_source()(late)


def lazy_rows(late: LateRows) -> LazilyIndexedArray:
    """Make values for a labelled array from rows on demand."""
    from xarray.core.indexing import LazilyIndexedArray

    return LazilyIndexedArray(_make_source(late))


def read_pulses(array: Any, first: int, stop: int) -> Any:
    """Return some pulses of an array, labelled or not, whose first dimension is slow time."""
    variable = getattr(array, "variable", array)
    data = getattr(variable, "_data", variable)
    return data[first:stop] if isinstance(data, np.ndarray | LateRows) else np.asarray(variable[first:stop].values)


def read_tiles(array: Any, multiple: int = 1) -> Iterator[tuple[int, Any]]:
    """Yield first pulse and values of every tile, of a multiple of ``multiple`` pulses."""
    size = max(LONG_PULSES // multiple, 1) * multiple
    for first in range(0, array.shape[0], size):
        yield first, read_pulses(array, first, first + size)


def take_every_row(array: Any, step: int) -> npt.NDArray[Any]:
    """Return every ``step``-th row of an array, from the first."""
    return np.concatenate([tile[-first % step :: step].copy() for first, tile in read_tiles(array)])
