"""Pictures, orders and weights of rows for training."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr

from doppelgait.core.errors import DatasetError
from doppelgait.core.rng import Streams
from doppelgait.dataset.shard_files import MAX_OPEN
from doppelgait.processing.patches import Levels, Patch, cut, levels_of

Array = npt.NDArray[Any]
As = Literal["array", "picture"] | Patch
"""Form of the arrays: stored arrays, or pictures of the default or of another format."""


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


POOL_SHARDS = MAX_OPEN // 2  # number of shards that are shuffled together


def shuffled_rows(index: pd.DataFrame, rng: np.random.Generator) -> npt.NDArray[np.int64]:
    """Shuffle rows so that shard files open once."""
    # rows of a few shards at a time are shuffled together, so that files open once
    codes, shards = pd.factorize(index["shard"])
    place_of_shard = rng.permutation(len(shards))
    pool = place_of_shard[codes] // POOL_SHARDS
    order = rng.permutation(len(index))
    return order[np.argsort(pool[order], kind="stable")]


def epoch_rows(index: pd.DataFrame, seed: int | None, epoch: int, worker: int, workers: int) -> npt.NDArray[np.int64]:
    """Return the rows of one worker in one epoch, each once."""
    rows = np.arange(len(index))
    if seed is not None:
        rows = shuffled_rows(index, Streams(seed, epoch).generator("batches"))
    return rows[worker::workers]


def balanced_weights(counts: npt.NDArray[np.int64]) -> npt.NDArray[np.float64]:
    """Return weights of mean 1 that balance all present classes."""
    present = counts > 0
    weights = np.zeros(counts.size)
    weights[present] = counts.sum() / (present.sum() * counts[present])
    return weights
