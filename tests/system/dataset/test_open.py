"""Opened datasets against plain h5py, pandas and NumPy."""

import json
import multiprocessing
import os
import pickle
import sys
from dataclasses import replace
from fnmatch import fnmatchcase

import h5py
import numpy as np
import pandas as pd
import pytest
from sklearn.utils.class_weight import compute_class_weight

import doppelgait as dg
import processes
from doppelgait.core.config import convert_to_json
from doppelgait.core.errors import DatasetError
from doppelgait.core.labels import BASEBAND, CADENCE_MAP, SIGNATURE, check_signal
from doppelgait.dataset import Example, open_dataset, plan_dataset, shard_files
from doppelgait.dataset.example import parse_unit, read_carrier_hz, read_radar
from doppelgait.dataset.rows import POOL_SHARDS, shuffled_rows
from doppelgait.features import FEATURE_UNITS
from doppelgait.features.extended import list_features
from tiny_dataset import sum_signatures, tiny_plan

X4_WAVELENGTH_M = 299_792_458.0 / 7.29e9


def stored(folder, index, number, name):
    """What plain h5py finds for a row."""
    row = index.iloc[number]
    with h5py.File(folder / "shards" / f"{row['shard']}.h5") as file:
        found = file[name]
        return found[int(row["row"])] if isinstance(found, h5py.Dataset) else found[str(row["row"])][:]


def test_example_is_what_h5py_reads_with_the_librarys_labels(folder, dataset):
    index = pd.read_parquet(folder / "index.parquet")
    units = {"time": "s", "doppler": "Hz", "cadence": "Hz", "slow_time": "s", "range": "m"}
    for number in (0, 5, 11):
        example = dataset[index["id"][number]]
        assert (example.id, example.label) == (index["id"][number], index["label"][number])
        assert set(example.arrays) == set(dataset.description["fields"])
        for name, array in example.arrays.items():
            assert np.array_equal(array.values, stored(folder, index, number, name))
            assert array.name == name
            for dim in set(array.dims) - {"scatterer"}:
                assert np.array_equal(
                    array[dim].values, stored(folder, index, number, f"{name}_{dim}_{units[dim].lower()}")
                )
                assert array[dim].attrs["units"] == units[dim]
        doppler_hz = stored(folder, index, number, "signature_doppler_hz")
        np.testing.assert_allclose(example.signature.velocity.values, doppler_hz * X4_WAVELENGTH_M / 2, rtol=1e-12)
        check_signal(example.signature, SIGNATURE)
        check_signal(example.cadence_map, CADENCE_MAP)
        check_signal(example.baseband, BASEBAND)
        for name, value in example.features.items():
            assert value == pytest.approx(index[f"feature_{name}"][number], nan_ok=True)
        assert example.row["snr_frame_db"] == index["snr_frame_db"][number]


def test_radar_of_a_later_class_is_that_of_its_simulation():
    table = tiny_plan().model_dump(mode="json") | {
        "radar": {"preset": "x4", "prf_hz": {"cycle": [800, 900, 1000, 1100]}}
    }
    table["classes"] = [{**section, "examples": 6 - n} for n, section in enumerate(table["classes"])]
    plan = plan_dataset(dg.dataset.PlanConfig.model_validate(table))
    for entry in plan.examples:
        found = read_radar({"config": table}, {"id": entry.id, "scene_id": entry.id})
        assert found.prf_hz == plan.example(entry.number).run.radar.prf_hz


@pytest.mark.parametrize("description", [{}, {"config": {}}, {"origin": "imported", "config": {"classes": []}}])
def test_radar_that_no_plan_tells(description):
    row = {"id": "walk-1", "scene_id": "walk-1", "prf_hz": 500.0}
    with pytest.raises(DatasetError, match="walk-1: the dataset does not state its radar"):
        read_radar(description, row)
    assert np.isnan(read_carrier_hz(description, row))
    assert read_carrier_hz(description, row | {"carrier_hz": 24e9}) == 24e9


def test_field_that_is_not_kept(dataset, mixed):
    with pytest.raises(DatasetError, match="keeps no cadence_map; it keeps signature, baseband"):
        _ = mixed.example(0).cadence_map
    with pytest.raises(DatasetError, match="keeps no 'envelope'; it keeps signature, cadence_map"):
        dataset.array("envelope", 0)


def test_features_for_scikit_learn(dataset):
    index, train = dataset.index, dataset["train"]
    for X, y, groups in (train.features(), train.arrays("signature")):
        assert len(X) == len(train) == 6
        assert list(y) == list(train.index["label"])
        assert list(groups) == list(train.index["group"])
    found = dataset.features()
    np.testing.assert_array_equal(found.X, index[[f"feature_{name}" for name in FEATURE_UNITS]].to_numpy())
    assert (found.names, found.units) == (tuple(FEATURE_UNITS), tuple(FEATURE_UNITS.values()))
    assert list(found.ids) == list(dataset.arrays("signature").ids) == list(index["id"])
    assert len(found) == 12
    named = dataset.features(["snr_frame_db", "truth_aspect_deg", "rcs_total_m2"])
    np.testing.assert_array_equal(named.X, index[["snr_frame_db", "truth_aspect_deg", "rcs_total_m2"]].to_numpy())
    assert named.units == ("dB", "deg", "m^2")
    assert parse_unit("extended_limb_share") == "1"


def test_extended_features_hold_nothing_that_only_a_simulation_knows(dataset):
    found = dataset.features("extended")
    names = [name for name in dataset.index.columns if name.startswith("extended_")]
    assert found.names == (*FEATURE_UNITS, "gait_frequency_hz", *names)
    assert len(names) > 20
    assert not [
        n for n in found.names if n.startswith(("truth", "snr", "rcs", "radar", "gate", "prf", "quality", "sd_"))
    ]
    units = {f"extended_{name}": unit for name, unit, _ in list_features()}
    assert {name: unit for name, unit in zip(found.names, found.units, strict=True) if name in units} == units


def test_rows_without_flags(dataset):
    patterns = ["no_such_*", "harmonic_ratio_3:*"]
    keep = [
        not any(fnmatchcase(flag, p) for flag in flags.split(";") for p in patterns)
        for flags in dataset.index["quality_flags"]
    ]
    assert 0 < sum(keep) < len(keep)
    assert list(dataset.features(without_flags=patterns).ids) == list(dataset.index["id"][keep])


def test_select(dataset):
    part = dataset.select("truth_range_m < 3.5 and label == 'dog'")
    index = dataset.index
    assert list(part.index["id"]) == list(index["id"][(index["truth_range_m"] < 3.5) & (index["label"] == "dog")])
    assert 0 < len(part) < 6
    number = list(index["id"]).index(part.index["id"][0])
    assert np.array_equal(part.array("signature", 0), dataset.array("signature", number))
    assert len(dataset.select("prf_hz < 0")) == 0
    for strange in ({"label": "cat"}, {"label": ["dog", "cat"]}, {"split": "tset"}):
        with pytest.raises(DatasetError, match=r"select: (label|split) '(cat|tset)' is not one of"):
            dataset.select(**strange)
    split = dataset.select("truth_range_m > 0", label=["dog", "human"], split="test")
    assert list(split.index["id"]) == list(dataset["test"].index["id"])
    assert (dataset[0].id, dataset[-1].id) == (index["id"].iloc[0], index["id"].iloc[-1])
    with pytest.raises(DatasetError, match=r"no column 'lable'; near in spelling: label"):
        dataset.select("prf_hz > 0", lable="dog")


@pytest.mark.parametrize(
    ("read", "argument", "message"),
    [
        ("select", "truth_aspct_deg < 30", "no column 'truth_aspct_deg'; near in spelling: truth_aspect_deg"),
        ("select", "label ==", "is no query"),
        ("select", "truth_range_m + 1", "is no condition"),
        ("select", "label == 'dog' and truth_range_m", "and, or need a condition on both sides"),
        ("__getitem__", "validation", "no split 'validation'; there are test, train"),
        ("__getitem__", "humn-000001", "neither .* here; the splits are train, test; near in spelling: human-000001"),
        ("__getitem__", 999, r"no example 999, only 0 to \d+$"),
        ("features", ["truth_aspct_deg"], "no column 'truth_aspct_deg'; near in spelling: truth_aspect_deg"),
        ("features", ["x"], "no column 'x'.*; dataset.index.columns lists all"),
        ("features", ["label"], "label: holds .* values, which are not features"),
        ("features", "seven", "'seven' is not allowed; it must be 'six', 'extended' or a list"),
        ("features", [], "is not allowed"),
    ],
)
def test_wrong_queries_keys_and_names_are_one_error(dataset, read, argument, message):
    with pytest.raises(DatasetError, match=message):
        getattr(dataset, read)(argument)


def put_description(folder, **changes):
    description = json.loads((folder / "dataset.json").read_text()) | changes
    (folder / "dataset.json").write_text(json.dumps(description))


def test_classes_are_numbered_as_another_dataset_has_them(folder):
    dataset = open_dataset(folder, classes=["cat", "dog", "human"])
    assert dict(zip(dataset.index["label"], dataset.class_numbers(), strict=True)) == {"human": 2, "dog": 1}
    assert list(dataset.class_weights()) == ["cat", "dog", "human"]
    for wrong in (["dog"], ["dog", "dog", "human"], "dog"):
        with pytest.raises(DatasetError, match="classes = "):
            open_dataset(folder, classes=wrong)


@pytest.mark.parametrize(("version", "remedy"), [(99, "install"), (2, "make it again")])
def test_another_schema_is_refused(copy, version, remedy):
    put_description(copy, schema_version=version)
    with pytest.raises(DatasetError, match=f"is a dataset in format version {version}; this one reads 3; {remedy}"):
        open_dataset(copy)


@pytest.mark.parametrize("name", ["dataset.json", "index.parquet"])
def test_missing_and_damaged_files(copy, name):
    (copy / name).write_bytes(b"{")
    with pytest.raises(DatasetError, match=r"copy: is damaged"):
        open_dataset(copy)
    (copy / name).unlink()
    with pytest.raises(DatasetError, match=f"no finished dataset here .*{name}"):
        open_dataset(copy)


def test_damaged_shard_is_named(copy):
    dataset = open_dataset(copy)
    path = copy / "shards" / f"{dataset.index['shard'][0]}.h5"
    path.write_bytes(path.read_bytes()[:5000])
    with pytest.raises(DatasetError, match=rf"{path.name}: signature of row 0 cannot be read: .*dataset verify"):
        dataset.array("signature", 0)
    path.unlink()
    with pytest.raises(DatasetError, match=f"{path.name}: signature of row 0 cannot be read"):
        dataset.array("signature", 0)


def test_batches_hold_every_example_once(dataset):
    seen = []
    for batch in dataset.batches(["signature", "baseband"], 5, np.random.default_rng(1)):
        assert set(batch) == {"signature", "baseband", "label", "number"}
        for place, number in enumerate(batch["number"]):
            assert np.array_equal(batch["signature"][place], dataset.array("signature", number))
            assert np.array_equal(batch["baseband"][place], dataset.array("baseband", number))
            assert batch["label"][place] == dataset.description["classes"][dataset.index["label"][number]]
        seen.extend(batch["number"])
    assert sorted(seen) == list(range(12))
    assert seen != sorted(seen)
    again, other, unshuffled = (
        [n for batch in dataset.batches(batch_size=4, **options) for n in batch["number"]]
        for options in ({"rng": np.random.default_rng(1)}, {"rng": np.random.default_rng(2)}, {"shuffle": False})
    )
    assert again == seen != other
    assert unshuffled == list(range(12))


def test_wrong_batches(dataset, mixed):
    with pytest.raises(DatasetError, match="shuffling needs rng"):
        dataset.batches()
    with pytest.raises(DatasetError, match="batch_size: 0 is not allowed"):
        dataset.batches(batch_size=0, shuffle=False)
    with pytest.raises(DatasetError, match=r"signature: human-000000 has the shape .*, human-000001 .*one shape"):
        next(mixed.select("label == 'human'").batches(shuffle=False))


def test_shuffle_opens_every_shard_once():
    n_shards, rows = 5 * POOL_SHARDS + 3, 7
    index = pd.DataFrame({"shard": np.repeat([f"s{n}" for n in range(n_shards)], rows)})
    order = shuffled_rows(index, np.random.default_rng(3))
    assert sorted(order) == list(range(n_shards * rows))
    pools = [set(index["shard"][order[k : k + POOL_SHARDS * rows]]) for k in range(0, len(order), POOL_SHARDS * rows)]
    assert [len(pool) for pool in pools] == [POOL_SHARDS] * 5 + [3]
    assert len(set.union(*pools)) == n_shards


def open_shards(folder):
    links = [os.path.realpath(f"/proc/self/fd/{n}") for n in os.listdir("/proc/self/fd")]
    return [path for path in links if path.startswith(str(folder)) and path.endswith(".h5")]


@pytest.mark.skipif(not os.path.isdir("/proc/self/fd"), reason="needs /proc")
def test_open_files_are_bounded(folder, monkeypatch):
    monkeypatch.setattr(shard_files, "MAX_OPEN", 2)
    dataset = open_dataset(folder)
    already = len(open_shards(folder.resolve()))
    for number in range(len(dataset)):
        dataset.array("signature", number)
        assert len(open_shards(folder.resolve())) - already <= 2
    assert dataset.index["shard"].nunique() == 4
    dataset.files.close()
    assert len(open_shards(folder.resolve())) == already


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_reads_in_other_processes(dataset, method):
    if method not in multiprocessing.get_all_start_methods():
        pytest.skip(f"no {method} here")
    expected = sum_signatures(dataset)  # files are open in this process
    with multiprocessing.get_context(method).Pool(2) as pool:
        assert pool.map_async(sum_signatures, [dataset] * 4).get(processes.LIMIT_S) == [expected] * 4
    assert sum_signatures(pickle.loads(pickle.dumps(dataset))) == expected
    if method == "fork":  # open files are left to the parent
        assert dataset.files._get_files()
        process = multiprocessing.get_context("fork").Process(target=lambda: os._exit(len(dataset.files._get_files())))
        process.start()
        processes.join(process)
        assert process.exitcode == 0
        assert sum_signatures(dataset) == expected


def test_without_torch_one_error(dataset, monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    monkeypatch.delitem(sys.modules, "doppelgait.dataset.torch_data", raising=False)
    with pytest.raises(DatasetError, match=r"torch is not installed: pip install 'doppelgait\[torch\]'"):
        dataset.torch()
    with pytest.raises(DatasetError, match="torch is not installed"):
        dataset.torch_iterable(seed=1)


@pytest.mark.parametrize(
    ("change", "reason"),
    [({"origin": "imported"}, "arrays of measured recordings"), ({"data_version": 7}, "has data version 7")],
)
def test_an_example_that_cannot_be_simulated_again_has_no_specification(dataset, change, reason):
    other = replace(dataset, description=dataset.description | change)
    with pytest.raises(DatasetError, match=reason):
        _ = other.example(0).specification
    with pytest.raises(DatasetError, match="has no specification"):
        _ = Example({"id": "one"}, {}).specification


def test_result_and_truth_of_an_example_are_those_of_its_row(dataset):
    example, result = dataset.example(0), dataset.result(0)
    config = dataset.description["config"]["analysis"]
    assert all(getattr(result.analysis, name) == value for name, value in config.items())
    assert result.label == example.label
    assert result.signature is not None
    row = convert_to_json(result.to_row())
    row["quality_flags"] = row.pop("flags")
    assert {name: row[name] for name in row if name in example.row} == {
        name: example.row[name] for name in row if name in example.row
    }
    assert set(row) <= set(example.row)
    assert example.truth["range_m"] == example.row["truth_range_m"]


def test_arrays_of_all_rows_are_those_of_each_and_pictures_have_one_shape(dataset, mixed):
    for data, field, dtype in (
        (dataset, "signature", np.float32), (dataset, "baseband", np.complex64), (mixed, "signature", np.float32),
    ):  # fmt: skip
        values = data.arrays(field).values
        assert isinstance(values, list) == (data is mixed)
        assert {each.dtype.type for each in values} == {dtype}
        assert all(np.array_equal(values[number], data.array(field, number)) for number in range(len(data)))
    (batch,) = mixed.batches(as_=dg.classify.Patch(n_time=32), shuffle=False)
    assert batch["signature"].shape == (8, 64, 32)
    pictures = mixed.arrays("signature", as_="picture").values
    assert all(
        np.array_equal(each, dg.classify.patch(row.signature)) for each, row in zip(pictures, mixed, strict=True)
    )
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
    dogs = part.index.astype({"label": "category"})[lambda index: index["label"] == "dog"]
    for index in (dogs, dogs.astype({"label": str})):
        assert replace(dataset, index=index).class_weights() == {"human": 0.0, "dog": 1.0}
