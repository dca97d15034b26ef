"""Files of strangers: nothing in an HDF5 file of ours is read from another file."""

import json
import shutil

import h5py
import numpy as np
import pandas as pd
import pytest

from dataset_plans import put_index
from doppelgait.core.errors import AnalysisError, DatasetError, RecordingError
from doppelgait.core.own_hdf5 import get_own_member
from doppelgait.dataset import open_dataset
from doppelgait.pipeline.result_files import read_results
from doppelgait.radar import read_recording


def led_out(group, name, outside):
    """Put the values of another file in the place of a dataset; other ways out: ``tests/core/test_own_hdf5.py``."""
    values = group[name][:]
    del group[name]
    outside.write_bytes(values.tobytes())
    group.create_dataset(name, values.shape, values.dtype, external=[(str(outside), 0, values.nbytes)])


@pytest.mark.parametrize(
    ("file", "name", "read", "error"),
    [("walk.h5", "baseband", read_recording, RecordingError),
     ("walk.h5", "truth/0/range_m", read_recording, RecordingError),
     ("result.h5", "targets/0/signature", read_results, AnalysisError)],
)  # fmt: skip
def test_recordings_and_results_hold_their_values_themselves(files, tmp_path, file, name, read, error):
    path = tmp_path / file
    shutil.copy(files / file, path)
    read(path)
    with h5py.File(path, "a") as content:
        led_out(content, name, tmp_path / "outside")
    with pytest.raises(error, match=r"are in another file, which is not read"):
        read(path)


def test_shards_hold_their_values_themselves(copy, tmp_path):
    dataset = open_dataset(copy)
    with h5py.File(copy / "shards" / f"{dataset.index['shard'][0]}.h5", "a") as file:
        led_out(file, "signature", tmp_path / "outside")
        truth = file["truth_range_m"]
        assert isinstance(truth, h5py.Group)  # one dataset a row, as they differ in length
        led_out(truth, "0", tmp_path / "further")
    for name in ("signature", "truth_range_m"):
        with pytest.raises(DatasetError, match=r"are in another file"):
            dataset.array(name, 0)
    assert dataset.array("baseband", 0).size


def test_parts_of_a_dataset_are_no_links_out_of_its_folder(copy, tmp_path):
    (tmp_path / "linked").symlink_to(copy)
    assert open_dataset(tmp_path / "linked").array("signature", 0).size  # the whole of it may lie anywhere
    (copy / "shards").rename(tmp_path / "elsewhere")
    (copy / "shards").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(DatasetError, match="outside the folder of the dataset"):
        open_dataset(copy).array("signature", 0)
    for name in ("dataset.json", "index.parquet"):
        (copy / name).rename(tmp_path / name)
        (copy / name).symlink_to(tmp_path / name)
        with pytest.raises(DatasetError, match=f"{name} is a link that leads out of the folder"):
            open_dataset(copy)
        (copy / name).unlink()
        (tmp_path / name).rename(copy / name)


def test_names_with_slashes_are_no_names(tmp_path):
    with h5py.File(tmp_path / "inner.h5", "w") as file:
        file["inner/values"] = np.arange(3)
        assert get_own_member(file, "nothing") is None
        with pytest.raises(ValueError, match="not allowed as a name"):
            get_own_member(file, "inner/values")


@pytest.mark.parametrize(("changes", "words"), [
    ({"name": None}, "name: "),
    ({"id": 3}, "id: 3"),
    ({"classes": ["human", "dog"]}, "classes: ["),
    ({"classes": {"human": "0", "dog": 1}}, "classes.human: '0'"),
    ({"fields": ["signature"]}, "fields: ["),
    ({"fields": {"signature": 3}}, "fields.signature: 3"),
    ({"fields": {"signature": {"dims": "time", "units": "1", "dtype": "half"}}}, "fields.signature.dims"),
    ({"config": 3}, "config: 3"),
    ({"config": {"classes": 3}}, "classes: 3"),
    ({"config": {"classes": [{"label": "a"}]}}, "config: dataset"),
    ({"config": {"classes": [{"label": "a", "examples": "x"}], "dataset": {}}}, "is required; classes.0.examples: 'x'"),
])  # fmt: skip
def test_a_damaged_description_is_named(copy, changes, words):
    description = json.loads((copy / "dataset.json").read_text())
    description = {key: value for key, value in {**description, **changes}.items() if value is not None}
    (copy / "dataset.json").write_text(json.dumps(description))
    with pytest.raises(DatasetError, match=r"is damaged: dataset\.json: ") as caught:
        open_dataset(copy)
    assert words in str(caught.value)


def without(name):
    return lambda index: index.drop(columns=[name])


def with_column(name, make):
    return lambda index: index.assign(**{name: [make(n) for n in range(len(index))]})


@pytest.mark.parametrize(("change", "words"), [
    *[(without(name), f"no column '{name}'") for name in ("id", "label", "split", "shard", "row")],
    (with_column("id", lambda n: [n]), "column 'id' must hold a text"),
    (with_column("id", lambda n: b"x"), "column 'id' must hold a text"),
    (with_column("id", lambda n: pd.Timestamp(n)), "column 'id' must hold a text"),
    (with_column("id", lambda n: None if n == 3 else f"{n}"), "column 'id' must hold a text"),
    (with_column("row", lambda n: n - 1), "column 'row' must hold a whole number from 0"),
    (with_column("row", lambda n: n + 0.5), "column 'row' must hold a whole number from 0"),
    (with_column("split", lambda n: "holdout"), "split 'holdout' is not one of train, validation, test"),
    (with_column("label", lambda n: "cow"), "label 'cow' is not one of human, dog"),
])  # fmt: skip
def test_a_damaged_index_is_named(copy, change, words):
    put_index(copy, change(pd.read_parquet(copy / "index.parquet")))
    with pytest.raises(DatasetError, match=r"is damaged: index\.parquet: ") as caught:
        open_dataset(copy)
    assert words in str(caught.value)
