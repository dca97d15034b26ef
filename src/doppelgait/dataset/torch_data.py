"""Datasets for torch; the only module that imports it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import DatasetError

try:
    import torch
    from torch.utils.data import Dataset as MapDataset
    from torch.utils.data import IterableDataset, get_worker_info
except ImportError:
    raise DatasetError("torch is not installed; install it, or use batches() without it") from None

if TYPE_CHECKING:
    from doppelgait.dataset.example import Example

Transform = Callable[[Any], Any]
Item = tuple[Any, int]


class StoredExamples(Protocol):
    """Interface that :class:`TorchExamples` needs of :class:`doppelgait.dataset.Dataset`."""

    def __len__(self) -> int: ...

    def array(self, field: str, number: int) -> npt.NDArray[Any]:
        """Read a stored array of a row."""
        ...

    def class_numbers(self) -> npt.NDArray[np.int64]:
        """Return the class of every row."""
        ...


class NumberedExamples(Protocol):
    """Interface that :class:`TorchStream` needs of :class:`doppelgait.dataset.ExampleStream`."""

    def numbered(self) -> Iterator[tuple[int, Example]]:
        """Yield examples with their numbers."""
        ...

    def part(self, number: int, count: int) -> NumberedExamples:
        """Return the share of one of several workers."""
        ...

    def class_number(self, label: str) -> int:
        """Return the number of a class."""
        ...


def as_item(arrays: Mapping[str, npt.NDArray[Any]], transform: Transform | None, target: int) -> Item:
    """Make the item of a loader.

    It is ``(tensor, target)`` for one field, ``({field: tensor}, target)`` for several.
    """
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
    """Map-style dataset; every worker opens its own files.

    See :meth:`doppelgait.dataset.Dataset.torch`.
    """

    def __init__(
        self,
        dataset: StoredExamples,
        fields: tuple[str, ...],
        transform: Transform | None,
        target: Literal["label", "index"],
    ) -> None:
        check_request(fields, target)
        self.dataset, self.fields, self.transform = dataset, fields, transform
        self.targets = dataset.class_numbers() if target == "label" else np.arange(len(dataset))

    def __len__(self) -> int:
        return len(self.dataset)

    def __getitem__(self, number: int) -> Item:
        if not -len(self) <= number < len(self):
            raise IndexError(number)
        arrays = {name: self.dataset.array(name, number) for name in self.fields}
        return as_item(arrays, self.transform, int(self.targets[number]))


class TorchStream(IterableDataset[Item]):  # type: ignore[misc, unused-ignore]  # torch may be missing
    """Endless dataset whose numbers a loader's workers share.

    See :meth:`ExampleStream.torch`.
    """

    def __init__(
        self, stream: NumberedExamples, fields: tuple[str, ...], transform: Transform | None,
        target: Literal["label", "index"],
    ) -> None:  # fmt: skip
        check_request(fields, target)
        self.stream, self.fields, self.transform, self.target = stream, fields, transform, target

    def __iter__(self) -> Iterator[Item]:
        info = get_worker_info()
        stream = self.stream if info is None else self.stream.part(info.id, info.num_workers)
        for number, example in stream.numbered():
            arrays = {name: example.arrays[name].values for name in self.fields}
            target = number if self.target == "index" else self.stream.class_number(example.label)
            yield as_item(arrays, self.transform, target)
