"""Datasets for torch; the only module that imports it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import ConfigError, DatasetError
from doppelgait.core.rng import Streams
from doppelgait.dataset.learning import StoredExamples, epoch_rows, make_picture, read_fields
from doppelgait.processing.patches import Patch

try:
    import torch
    from torch.utils.data import Dataset as MapDataset
    from torch.utils.data import IterableDataset, get_worker_info
except ImportError:
    raise DatasetError("torch is not installed: pip install 'doppelgait[torch]', or use batches() without it") from None

if TYPE_CHECKING:
    from doppelgait.dataset.example import Example

Transform = Callable[[Any], Any]
Item = tuple[Any, int]


class NumberedExamples(Protocol):
    """Interface that :class:`TorchStream` needs of :class:`doppelgait.dataset.ExampleStream`."""

    def iterate_numbered(self) -> Iterator[tuple[int, Example]]:
        """Yield examples with their numbers."""

    def part(self, number: int, count: int) -> NumberedExamples:
        """Return the share of one of several workers."""

    def class_number(self, label: str) -> int:
        """Return the number of a class."""


def as_item(arrays: Mapping[str, npt.NDArray[Any]], transform: Transform | None, target: int) -> Item:
    """Make ``(tensor, target)``, or ``({field: tensor}, target)`` of several fields."""
    tensors = {name: torch.from_numpy(np.ascontiguousarray(values)) for name, values in arrays.items()}
    inputs = next(iter(tensors.values())) if len(tensors) == 1 else tensors
    return (inputs if transform is None else transform(inputs)), target


def check_request(fields: Sequence[str], target: str) -> None:
    """Raise a :class:`DatasetError` without fields or for an unknown target."""
    if not fields:
        raise DatasetError("fields: names no field; name at least one")
    if target not in ("label", "index"):
        raise DatasetError(f"target: {target!r} is not allowed; it must be 'label' or 'index'")


class TorchExamples(MapDataset[Item]):  # type: ignore[misc, unused-ignore]  # torch may be missing
    """Map-style dataset; every worker opens its own files."""

    def __init__(
        self,
        dataset: StoredExamples,
        fields: tuple[str, ...],
        patch: Patch | None,
        transform: Transform | None,
        target: Literal["label", "index"],
    ) -> None:
        check_request(fields, target)
        self.dataset, self.fields, self.patch, self.transform = dataset, fields, patch, transform
        self.targets = dataset.class_numbers() if target == "label" else np.arange(len(dataset))

    def __len__(self) -> int:
        return len(self.dataset)

    def __getitem__(self, number: int) -> Item:
        if not -len(self) <= number < len(self):
            raise IndexError(number)
        arrays = read_fields(self.dataset, self.fields, number, self.patch)
        return as_item(arrays, self.transform, int(self.targets[number]))


class IterableExamples(IterableDataset[Item]):  # type: ignore[misc, unused-ignore]  # torch may be missing
    """Dataset with rows that a loader's workers share."""

    def __init__(self, examples: TorchExamples, seed: int | None) -> None:
        Streams(0 if seed is None else seed)  # check here and not in a worker
        self.examples, self.seed = examples, seed
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
        info = get_worker_info()
        worker, workers = (0, 1) if info is None else (info.id, info.num_workers)
        for number in epoch_rows(self.examples.dataset.index, self.seed, int(self.epoch), worker, workers).tolist():
            yield self.examples[number]


class TorchStream(IterableDataset[Item]):  # type: ignore[misc, unused-ignore]  # torch may be missing
    """Endless dataset with numbers that a loader's workers share."""

    def __init__(
        self,
        stream: NumberedExamples,
        fields: tuple[str, ...],
        patch: Patch | None,
        transform: Transform | None,
        target: Literal["label", "index"],
    ) -> None:
        check_request(fields, target)
        self.stream, self.fields, self.patch = stream, fields, patch
        self.transform, self.target = transform, target

    def __iter__(self) -> Iterator[Item]:
        info = get_worker_info()
        stream = self.stream if info is None else self.stream.part(info.id, info.num_workers)
        for number, example in stream.iterate_numbered():
            arrays: dict[str, npt.NDArray[Any]]
            if self.patch is None:
                arrays = {name: example.arrays[name].values for name in self.fields}
            else:
                arrays = {name: make_picture(example.arrays.get(name), self.patch) for name in self.fields}
            target = number if self.target == "index" else self.stream.class_number(example.label)
            yield as_item(arrays, self.transform, target)
