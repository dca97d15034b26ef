"""Pictures, arrays and class weights of built datasets; behind torch in test_torch.py."""

import numpy as np
import pytest
from sklearn.utils.class_weight import compute_class_weight

import doppelgait as dg
from doppelgait.core.errors import DatasetError


def test_batches_of_pictures_have_one_shape_whatever_the_pulse_rate(mixed):
    assert len({mixed.array("signature", number).shape for number in range(len(mixed))}) > 1
    (batch,) = mixed.batches(as_="picture", shuffle=False)
    assert batch["signature"].shape == (8, 64, 64)
    assert batch["signature"].dtype == np.float32
    for number, picture in enumerate(batch["signature"]):
        np.testing.assert_allclose(picture, 40.0 * dg.classify.patch(mixed.example(number).signature), rtol=1e-6)
    (batch,) = mixed.batches(as_=dg.classify.Patch(n_time=32), shuffle=False)
    assert batch["signature"].shape == (8, 64, 32)


def test_pictures_of_other_fields_are_refused(dataset):
    for read in (
        lambda: dataset.batches(["baseband"], as_="picture", shuffle=False),
        lambda: dataset.arrays("baseband", as_="picture"),
    ):
        with pytest.raises(DatasetError, match="only the field signature has a picture"):
            read()


def test_arrays_of_all_rows_with_labels_and_groups(dataset):
    train = dataset["train"]
    values, y, groups = found = train.arrays("signature")
    assert values.shape[0] == len(found) == len(train) == 6
    assert values.dtype == np.float32
    for number in range(len(train)):
        assert np.array_equal(values[number], train.array("signature", number))
    of_features = train.features()
    assert np.array_equal(y, of_features.y)
    assert np.array_equal(groups, of_features.groups)
    assert np.array_equal(found.ids, of_features.ids)
    assert train.arrays("baseband").values.dtype == np.complex64


def test_arrays_of_several_shapes_are_a_list_and_pictures_are_not(mixed):
    found = mixed.arrays("signature")
    assert isinstance(found.values, list)
    for number, values in enumerate(found.values):
        assert np.array_equal(values, mixed.array("signature", number))
    assert mixed.arrays("signature", as_="picture").values.shape == (8, 64, 64)
    assert len(mixed.select("label == 'cat'").arrays("signature").values) == 0


def test_arrays_stay_within_their_memory(dataset, mixed, monkeypatch):
    for part, as_ in ((dataset, "array"), (mixed, "array"), (mixed, "picture")):
        values = part.arrays("signature", as_=as_).values
        need_mb = sum(one.nbytes for one in values) / 1e6
        part.arrays("signature", as_=as_, memory_mb=need_mb)
        with monkeypatch.context() as patched:
            patched.setattr(type(part), "array", None)  # nothing is read
            with pytest.raises(
                DatasetError, match=rf"signature of {len(part)} rows would take .* MB, memory_mb is .*; select fewer"
            ):
                part.arrays("signature", as_=as_, memory_mb=0.999 * need_mb)
    with pytest.raises(DatasetError, match="keeps no 'envelope'"):
        dataset.arrays("envelope")


def test_class_weights_are_those_of_scikit_learn(dataset):
    part = dataset.select("label == 'dog' or id == 'human-000001' or id == 'human-000002'")
    y = part.features().y
    classes = np.unique(y)
    expected = dict(zip(classes, compute_class_weight("balanced", classes=classes, y=y), strict=True))
    weights = part.class_weights()
    assert list(weights) == ["human", "dog"] == sorted(weights, key=dataset.description["classes"].get)
    assert weights == pytest.approx(expected)
    assert dataset.select("label == 'dog'").class_weights() == {"human": 0.0, "dog": 1.0}
