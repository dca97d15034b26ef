"""Datasets and streams behind a torch DataLoader; skipped where torch is not installed."""

import pickle
from itertools import islice

import numpy as np
import pytest

from doppelgait.core.errors import ConfigError, DoppelgaitError
from doppelgait.dataset.stream import stream_examples
from tiny_dataset import mixed_plan

torch = pytest.importorskip("torch")


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
    copy = pickle.loads(pickle.dumps(data))  # without most of the index
    assert torch.equal(copy[5][0], data[5][0])
    assert set(data.read.args[0].index.columns) == {"id", "shard", "row", "scene_id", "prf_hz", "carrier_hz"}


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


@pytest.mark.parametrize(
    ("method", "options", "message"),
    [
        ("torch", {"fields": []}, "names no field"),
        ("torch", {"target": "subject"}, "target: 'subject' is not allowed"),
        ("torch", {"fields": ["baseband"], "as_": "picture"}, "only the field signature has a picture"),
        ("torch_iterable", {"seed": -1}, "seed: -1 is not allowed"),
    ],
)
def test_wrong_requests(dataset, method, options, message):
    with pytest.raises(DoppelgaitError, match=message):
        getattr(dataset, method)(**options)
    with pytest.raises(ConfigError, match=r"epoch: 1\.5 is not allowed"):
        dataset.torch_iterable(seed=1).set_epoch(1.5)


def test_pictures_have_one_shape(mixed):
    data = mixed.torch(as_="picture")
    ((batch, labels),) = torch.utils.data.DataLoader(data, batch_size=8, num_workers=1)
    assert batch.shape == (8, 64, 64)
    assert batch.dtype == torch.float32
    assert torch.equal(batch, torch.from_numpy(mixed.arrays("signature", as_="picture").values))
    assert labels.tolist() == mixed.class_numbers().tolist()
    stream = stream_examples(mixed_plan(), start=0).torch(as_="picture", target="index")
    pictures = [picture for picture, _ in islice(stream, 4)]
    assert torch.allclose(torch.stack(pictures), batch[:4], atol=0.2)  # the dataset keeps them in half precision


@pytest.mark.parametrize("options", [{}, {"persistent_workers": True}, {"multiprocessing_context": "spawn"}])
def test_epochs_have_orders_of_their_own(dataset, options):
    data = dataset.torch_iterable(seed=11, target="index")
    assert isinstance(data, torch.utils.data.IterableDataset)
    assert len(data) == 12
    loader = torch.utils.data.DataLoader(data, batch_size=None, num_workers=2, **options)

    def order(epoch):
        data.set_epoch(epoch)
        return [int(number) for _, number in loader]

    first, second, again = order(0), order(1), order(0)
    assert first == again != second
    assert sorted(second) == list(range(12))
    data.set_epoch(1)
    assert [int(number) for _, number in data] == second
    assert all(np.array_equal(tensor.numpy(), dataset.array("signature", number)) for tensor, number in data)
