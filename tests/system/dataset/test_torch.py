"""Datasets and streams behind a torch DataLoader; skipped where torch is not installed."""

from __future__ import annotations

import pickle
from itertools import islice

import numpy as np
import pytest

from doppelgait.core.errors import DatasetError
from doppelgait.dataset import open_dataset
from doppelgait.dataset.stream import stream_examples
from tiny_dataset import built, mixed_plan, tiny_plan

torch = pytest.importorskip("torch")
PLAN = tiny_plan(fields=["signature"])


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    return open_dataset(built(tmp_path_factory, tiny_plan()))


def test_items(dataset):
    data = dataset["train"].torch()
    assert isinstance(data, torch.utils.data.Dataset)
    assert len(data) == 6
    for number, (tensor, label) in enumerate(data):
        assert tensor.dtype == torch.float32
        assert np.array_equal(tensor.numpy(), dataset["train"].array("signature", number))
        assert label == dataset.description["classes"][dataset["train"].index["label"][number]]
    assert torch.equal(data[-1][0], data[5][0])
    with pytest.raises(IndexError):
        data[6]


def test_several_fields_transform_and_row_numbers(dataset):
    data = dataset.torch(
        ["signature", "baseband"], transform=lambda x: {k: 2 * v for k, v in x.items()}, target="index"
    )
    inputs, number = data[4]
    assert number == 4
    assert inputs["baseband"].dtype == torch.complex64
    for name, tensor in inputs.items():
        assert np.array_equal(tensor.numpy(), 2 * dataset.array(name, 4))


@pytest.mark.parametrize("context", [None, "spawn"])
@pytest.mark.parametrize("workers", [0, 2])
def test_loader_gives_every_example_once(dataset, workers, context):
    data = dataset.torch(target="index")
    data[0]  # files are open before workers start
    options = {"multiprocessing_context": context} if workers else {}
    loader = torch.utils.data.DataLoader(data, batch_size=5, shuffle=True, num_workers=workers, **options)
    seen = {}
    for tensors, numbers in loader:
        seen |= dict(zip(numbers.tolist(), tensors.numpy(), strict=True))
    assert sorted(seen) == list(range(12))
    for number, values in seen.items():
        assert np.array_equal(values, dataset.array("signature", number))


def test_can_be_pickled_without_the_index(dataset):
    data = dataset.torch()
    copy = pickle.loads(pickle.dumps(data))
    assert torch.equal(copy[7][0], data[7][0])
    assert list(data.dataset.index.columns) == ["id", "label", "shard", "row"]


def test_wrong_requests(dataset):
    with pytest.raises(DatasetError, match="keeps no 'envelope'"):
        dataset.torch(["envelope"])
    with pytest.raises(DatasetError, match="names no field"):
        dataset.torch([])
    with pytest.raises(DatasetError, match="target: 'subject' is not allowed"):
        dataset.torch(target="subject")


@pytest.mark.parametrize("workers", [0, 1, 2, 3])
def test_workers_share_the_stream(workers):
    expected = {n: e.signature.values for n, e in islice(stream_examples(PLAN).numbered(), 8)}
    data = stream_examples(PLAN).torch(target="index")
    assert isinstance(data, torch.utils.data.IterableDataset)
    loader = torch.utils.data.DataLoader(data, batch_size=None, num_workers=workers)
    seen = {number: tensor.numpy() for tensor, number in islice(loader, 8)}
    assert sorted(seen) == sorted(expected) == list(range(12, 20))
    for number, values in seen.items():
        assert np.array_equal(values, expected[number])


def test_stream_labels_and_transform():
    data = stream_examples(PLAN).torch(transform=lambda x: x.sum())
    sums, labels = zip(*islice(data, 4), strict=True)
    assert labels == (0, 1, 0, 1)
    assert all(value.shape == () for value in sums)


def test_stream_of_several_targets(tmp_path_factory):
    dataset = open_dataset(built(tmp_path_factory, mixed_plan()))
    items = list(islice(stream_examples(mixed_plan().model_copy(), start=0).torch(target="index"), 4))
    assert [number for _, number in items] == [0, 0, 1, 1]
    for number, (tensor, _) in enumerate(items):
        assert np.array_equal(tensor.numpy(), dataset.array("signature", number))
