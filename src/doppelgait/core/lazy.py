"""Pulses and scatterer rows that are read or computed on demand.

A recording of ten minutes has a gigabyte of samples. Code that needs all of them processes one tile after another.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr
from xarray.backends import BackendArray
from xarray.core.indexing import ExplicitIndexer, IndexingSupport, LazilyIndexedArray, explicit_indexing_adapter

LONG_PULSES = 1 << 15
"""Approximate number of pulses of a tile. Longer recordings are processed in tiles."""


class _Source(BackendArray):
    """Rows on demand, indexed by xarray."""

    def __init__(self, shape: tuple[int, ...], dtype: Any, rows: Callable[[int, int], npt.NDArray[Any]]) -> None:
        self.shape, self.dtype, self._rows = shape, np.dtype(dtype), rows

    def __getitem__(self, key: ExplicitIndexer) -> npt.NDArray[Any]:
        return np.asarray(explicit_indexing_adapter(key, self.shape, IndexingSupport.BASIC, self._take))

    def _take(self, key: tuple[Any, ...]) -> npt.NDArray[Any]:
        wanted, *columns = key
        if not isinstance(wanted, slice):
            row = int(wanted) % self.shape[0]
            return np.asarray(self._rows(row, row + 1)[(0, *columns)])
        first, stop, step = wanted.indices(self.shape[0])
        if step < 0:
            return self._take((slice(None), *columns))[wanted]
        return np.asarray(self._rows(first, max(first, stop))[(slice(None, None, step), *columns)])


def lazy_rows(
    shape: tuple[int, ...], rows: Callable[[int, int], npt.NDArray[Any]], dtype: Any = np.complex64
) -> LazilyIndexedArray:
    """Make values for a labelled array from a row function; nothing is cached."""
    return LazilyIndexedArray(_Source(shape, dtype, rows))


def read_pulses(array: xr.DataArray | xr.Variable, first: int, stop: int) -> Any:
    """Return some pulses of an array, whose first dimension is slow time."""
    variable = array.variable if isinstance(array, xr.DataArray) else array
    data: Any = variable._data
    return data[first:stop] if isinstance(data, np.ndarray) else np.asarray(variable[first:stop].values)


def read_tiles(array: xr.DataArray | xr.Variable, multiple: int = 1) -> Iterator[tuple[int, Any]]:
    """Yield the first pulse and the values of every tile, of a multiple of ``multiple`` pulses but for the last."""
    size = max(LONG_PULSES // multiple, 1) * multiple
    for first in range(0, array.sizes["slow_time"], size):
        yield first, read_pulses(array, first, first + size)


def take_every_row(array: xr.DataArray | xr.Variable, step: int) -> npt.NDArray[Any]:
    """Return every ``step``-th row of an array, from the first."""
    return np.concatenate([tile[-first % step :: step].copy() for first, tile in read_tiles(array)])
