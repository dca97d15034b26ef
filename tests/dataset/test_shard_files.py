"""Stored arrays: precision, hops and what comes back."""

import json

import h5py
import numpy as np
import pytest

from doppelgait.core.errors import DatasetError
from doppelgait.dataset.config import FieldSpec, load_plan
from doppelgait.dataset.example import label_arrays
from doppelgait.dataset.finish import read_description, read_records, tally
from doppelgait.dataset.plan import plan_dataset
from doppelgait.dataset.shard import BuildContext, build_planned
from doppelgait.dataset.shard_files import DB_FLOOR, ShardFiles, decode, describe_fields, encode


def test_a_row_is_made_without_labels(monkeypatch):
    config, folder = load_plan("home-alarm", overrides=["dataset.examples_per_class=12"])
    plan = plan_dataset(config, folder=folder)
    monkeypatch.setattr("doppelgait.core.labels.make_array", None)
    (((_, arrays),),) = build_planned([plan.examples[0]], BuildContext(plan.config, str(plan.folder), ""))
    assert arrays["signature"].size


@pytest.mark.parametrize("level", [1e-16, 1e-13, 1e-6, 1.0])
def test_half_precision_is_within_what_is_promised_and_the_default_of_signatures(level):
    values = (level * np.random.default_rng(1).chisquare(2, (400, 64))).astype(np.float32)
    spec = FieldSpec(name="signature")
    stored = encode(values, spec)
    assert stored.nbytes * 2 == values.nbytes
    back = decode(stored, describe_fields([spec])["signature"])
    error = np.abs(back / values - 1)
    assert error.max() < 0.015
    assert back.dtype == np.float32


@pytest.mark.parametrize(
    ("spec", "values", "stored"),
    [
        ({"name": "signature", "dtype": "full"}, [[0.1, 1 / 3]], [[np.float32(0.1), np.float32(1 / 3)]]),
        ({"name": "cadence_map", "dtype": "half"}, [[0.0, 1.0]], [[DB_FLOOR, 0.0]]),  # silence stays silence
        ({"name": "signature", "dtype": "full", "hop": 3}, [[0.0], [1.0], [2.0], [3.0]], [[0.0], [3.0]]),
    ],
)
def test_what_is_stored_comes_back_in_full_precision_every_nth_column(spec, values, stored):
    field = FieldSpec(**spec)
    encoded = encode(np.array(values, dtype=np.float32), field)
    assert encoded.tolist() == stored
    facts = describe_fields([field])[field.name]
    assert (facts["scale"], facts["hop"]) == ("db" if field.is_half else "linear", field.hop)
    assert decode(encoded, facts).tolist() == np.array(values, dtype=np.float32)[:: field.hop].tolist()


def test_a_file_instead_of_the_folder_is_told(tmp_path):
    path = tmp_path / "walk.h5"
    path.write_bytes(b"")
    with pytest.raises(DatasetError, match=r"walk\.h5: is a file; name the folder of a dataset$"):
        read_description(path)


@pytest.mark.parametrize(
    "values",
    [np.zeros(7), np.zeros((2, 3, 4)), np.zeros((2, 3), dtype="S3"), np.array(3.0)],
    ids=["1", "3", "text", "0"],
)
def test_an_array_with_other_axes_than_its_field_is_one_error(values):
    facts = {
        "signature": {"dims": ["time", "doppler"], "units": "V^2", "dtype": "float32", "scale": "linear", "hop": 1}
    }
    stored = {"signature": values}
    with pytest.raises(DatasetError, match=r"x-1: signature has \d axes of .* in its shard, not \['time', 'doppler'\]"):
        label_arrays(facts, {"id": "x-1", "prf_hz": 1000.0}, stored.get, carrier_hz=7e9)


def test_an_array_that_fills_the_memory_is_not_read(tmp_path):
    (tmp_path / "shards").mkdir()
    with h5py.File(tmp_path / "shards" / "train-00000-of-00001.h5", "w") as file:
        file.create_dataset("signature", (1, 100_000, 200_000), "f4", chunks=(1, 50, 50))
    with pytest.raises(DatasetError, match="would take 128,000 MB of memory"):
        ShardFiles(tmp_path / "shards").read("train-00000-of-00001", "signature", 0)


@pytest.mark.parametrize(
    "change",
    [{"shard": None}, {"bytes": []}, {"failures": {}}, {"sha256": 3}]
    + [{"rows": [row]} for row in ({}, {"label": ["a"]}, {"label": "a", "scene_id": [1]})]
    + [{"failures": [{key: 1}]} for key in ("id", "reason")],
)
def test_a_damaged_record_is_one_error(tmp_path, change):
    record = {"shard": "a", "sha256": "b", "bytes": 1, "failures": [], "rows": [{"label": "human"}]}
    (tmp_path / "shards").mkdir()
    place = tmp_path / "shards" / "train-00000-of-00001.json"
    place.write_text(json.dumps(record))
    assert tally(read_records(tmp_path, [place.stem])).rows == 1
    place.write_text(json.dumps({**record, **change}))
    with pytest.raises(DatasetError, match=f"train-00000-of-00001.json: {next(iter(change))} is missing or damaged"):
        tally(read_records(tmp_path, [place.stem]))
