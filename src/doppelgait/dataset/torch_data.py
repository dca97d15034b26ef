"""Datasets for torch; the only module that imports it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import ConfigError, DatasetError

try:
    import torch
    from torch.utils.data import Dataset as MapDataset
    from torch.utils.data import IterableDataset, get_worker_info
except ImportError:
    raise DatasetError("torch is not installed: pip install 'doppelgait[torch]', or use batches() without it") from None

Arrays = Mapping[str, npt.NDArray[Any]]
Transform = Callable[[Any], Any]
Item = tuple[Any, int]


def check_request(fields: Sequence[str], target: str) -> None:
    """Raise a :class:`DatasetError` without fields or for an unknown target."""
    if not fields:
        raise DatasetError("fields: names no field; name at least one")
    if target not in ("label", "index"):
        raise DatasetError(f"target: {target!r} is not allowed; it must be 'label' or 'index'")


def make_item(arrays: Arrays, transform: Transform | None, target: int) -> Item:
    """Make ``(tensor, target)``, or ``({field: tensor}, target)`` of several fields."""
    tensors = {name: torch.from_numpy(np.ascontiguousarray(values)) for name, values in arrays.items()}
    inputs = next(iter(tensors.values())) if len(tensors) == 1 else tensors
    return (inputs if transform is None else transform(inputs)), target


def find_worker() -> tuple[int, int]:
    """Return this worker of a loader and the number of workers."""
    info = get_worker_info()
    return (0, 1) if info is None else (info.id, info.num_workers)


class TorchExamples(MapDataset[Item]):  # type: ignore[misc, unused-ignore]  # torch may be missing
    """Map-style dataset; every worker opens its own files."""

    def __init__(
        self, read: Callable[[int], Arrays], targets: npt.NDArray[np.int64], transform: Transform | None
    ) -> None:
        self.read, self.targets, self.transform = read, targets, transform

    def __len__(self) -> int:
        return len(self.targets)

    def __getitem__(self, number: int) -> Item:
        if not -len(self) <= number < len(self):
            raise IndexError(number)
        return make_item(self.read(number), self.transform, int(self.targets[number]))


class IterableExamples(IterableDataset[Item]):  # type: ignore[misc, unused-ignore]  # torch may be missing
    """Dataset with rows, by (epoch, worker, workers), that a loader's workers share."""

    def __init__(self, examples: TorchExamples, rows: Callable[[int, int, int], npt.NDArray[np.int64]]) -> None:
        self.examples, self.rows = examples, rows
        # shared, so that persistent workers read changes
        self.epoch = torch.zeros((), dtype=torch.int64).share_memory_()

    def set_epoch(self, epoch: int) -> None:
        """Set the epoch, 0 or larger, of the next iteration."""
        if not isinstance(epoch, int) or epoch < 0:
            raise ConfigError(f"epoch: {epoch!r} is not allowed; it must be an integer, 0 or larger")
        self.epoch.fill_(epoch)

    def __len__(self) -> int:
        return len(self.examples)

    def __iter__(self) -> Iterator[Item]:
        return (self.examples[number] for number in self.rows(int(self.epoch), *find_worker()).tolist())


class TorchStream(IterableDataset[Item]):  # type: ignore[misc, unused-ignore]  # torch may be missing
    """Endless dataset, read by (worker, workers), that a loader's workers share."""

    def __init__(self, read: Callable[[int, int], Iterator[tuple[Arrays, int]]], transform: Transform | None) -> None:
        self.read, self.transform = read, transform

    def __iter__(self) -> Iterator[Item]:
        return (make_item(arrays, self.transform, target) for arrays, target in self.read(*find_worker()))
