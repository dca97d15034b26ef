"""Exported datasets, each read back with the plain reader of its form."""

import csv
import errno
import io
import json
import resource
import shutil
import sys
import tarfile
from typing import Literal

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from dataset_plans import put_index
from doppelgait.core.config import FrozenModel
from doppelgait.core.errors import ConfigError, DatasetError, OutputError
from doppelgait.dataset import export, open_dataset
from doppelgait.dataset.export import EXPORTERS, PLACES, Zarr, export_dataset, make_file_name, refuse_unreleasable
from doppelgait.dataset.open import Dataset
from doppelgait.radar import Radar, read_recording
from doppelgait.testing import check_exporter

INSTALLED = [form for form in EXPORTERS if form not in ("zarr", "xarray")]


def changed(dataset, folder, row, **values):
    """Copy of a dataset with values of one row of its index changed."""
    shutil.copytree(dataset.directory, folder)
    index = pd.read_parquet(folder / "index.parquet")
    for name, value in values.items():
        index.loc[row, name] = value
    put_index(folder, index)
    return open_dataset(folder)


def expected_table(dataset):
    table = dataset.index.drop(columns=list(PLACES))
    numbers = table["label"].map({"human": 0, "dog": 1})
    table.insert(3, "class_number", numbers)
    return table


def test_csv_is_the_index(dataset, tmp_path):
    export_dataset(dataset, tmp_path / "out", form="csv")
    expected = expected_table(dataset)
    with (tmp_path / "out" / "index.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == list(expected)
    for place, row in enumerate(rows):
        for name, text in row.items():
            value = expected[name].iloc[place]
            assert (text == "" and (pd.isna(value) or value == "")) or type(value)(text) == value


def test_parquet_with_arrays(dataset, tmp_path):
    fields = ["signature", "baseband", "truth_range_m"]
    export_dataset(dataset, tmp_path / "out", form={"kind": "parquet", "rows_per_group": 4}, fields=fields)
    table = pq.read_table(tmp_path / "out" / "test.parquet")
    assert table.num_rows == 6
    assert table.schema.field("signature_values").metadata[b"unit"] == b"V^2"
    for row in table.to_pylist():
        example = dataset[row["id"]]
        for name in fields:
            values = np.array(row[f"{name}_values"], dtype=np.float32).reshape(row[f"{name}_shape"])
            values = values.view(np.complex64)[..., 0] if name == "baseband" else values
            assert np.array_equal(values, example.arrays[name].values)
        assert np.array_equal(row["signature_doppler_hz"], example.signature.doppler.values)
        assert row["truth_range_m"] == example.row["truth_range_m"]  # the column of the index, beside the array


def test_parquet_keeps_types_where_a_split_has_no_values(dataset, tmp_path):
    """The types of a column do not depend on what a split happens to hold."""
    empty = Dataset(dataset.directory, dataset.description, dataset.index.copy(), dataset.files)
    gait = empty.index["truth_gait"].astype(object)  # as a table of older pandas has it
    empty.index["truth_gait"] = gait.where(empty.index["split"] != "test", None)
    export_dataset(empty, tmp_path / "out", form="parquet")
    types = [pq.read_schema(tmp_path / "out" / f"{s}.parquet").field("truth_gait").type for s in ("train", "test")]
    assert types[0] == types[1]
    assert pa.types.is_large_string(types[0]) or pa.types.is_string(types[0])


def test_pictures_of_signatures_are_a_field(mixed, tmp_path):
    """They have one shape where the signatures have two."""
    values = mixed.arrays("signature", as_="picture").values
    export_dataset(mixed, tmp_path / "out", form="huggingface", fields=["picture"])
    tables = [pd.read_parquet(path) for path in sorted((tmp_path / "out").glob("*.parquet"))]
    found = {row["id"]: np.stack(row["picture"]) for table in tables for row in table.to_dict("records")}
    assert all(np.array_equal(found[name], picture) for name, picture in zip(mixed.index["id"], values, strict=True))
    assert '"array2_d": {"shape": [64, 64]' in (tmp_path / "out" / "README.md").read_text()
    described = json.loads((tmp_path / "out" / "dataset.json").read_text())["fields"]["picture"]
    assert (described["units"], described["patch"]["range_db"]) == ("1", 40.0)
    assert not open_dataset(mixed.directory).description["fields"].get("picture")


def test_huggingface_by_pandas(dataset, tmp_path):
    some = without_track(dataset, 0)
    export_dataset(some, tmp_path / "out", form="huggingface", fields=["signature", "baseband"])
    for split in ("train", "test"):
        rows = pd.read_parquet(tmp_path / "out" / f"{split}.parquet").set_index("id")
        for example in some[split]:
            values = rows["signature"][example.id]
            there = "signature" in example.arrays
            assert np.array_equal(np.stack(values), example.signature.values) if there else values is None
    text, card = ((folder / "README.md").read_text() for folder in (tmp_path / "out", dataset.directory))
    assert '"path": "train.parquet"' in text
    assert f'"array3_d": {{"shape": {[*dataset[0].baseband.shape, 2]}, "dtype": "float32"}}' in text
    assert text.partition("# tiny")[2] == card.partition("# tiny")[2]


def without_track(dataset, row):
    """The dataset, a target of which has no track."""

    class Files(type(dataset.files)):
        def read(self, shard, name, number):
            values = super().read(shard, name, number)
            gone = (shard, number) == (dataset.index["shard"][row], dataset.index["row"][row]) and "sign" in name
            return values if not gone else np.empty((0, 0), "f4") if name == "signature" else None

        def shape(self, shard, name, number):
            values = self.read(shard, name, number)
            return None if values is None else values.shape

    files = Files(dataset.files.folder, dataset.files.identity)
    return Dataset(dataset.directory, dataset.description, dataset.index, files)


@pytest.mark.filterwarnings("error")
def test_xarray_is_one_dataset(dataset, mixed, tmp_path):
    zarr = pytest.importorskip("zarr")
    import xarray as xr

    for number, source in enumerate((without_track(dataset, 0), mixed)):
        export_dataset(source, tmp_path / f"{number}", form="xarray")
        with xr.open_zarr(tmp_path / f"{number}" / "dataset.zarr", chunks=None) as found:
            assert set(found.data_vars) == {n + "_values" * (n in source.index) for n in source.description["fields"]}
            assert found["signature"].dims == ("example", "time", "doppler")
            assert found["baseband"].attrs["units"] == "V"
            for row, example in enumerate(source):
                one = found.isel(example=row)
                assert [str(one[name].values) for name in ("id", "label", "split")] == [
                    example.row[name] for name in ("id", "label", "split")
                ]
                if "signature" not in example.arrays:
                    assert np.isnan(one["signature"].values).all()
                for name, array in example.arrays.items():
                    stored = one[name + "_values" * (name in source.index)].values
                    inside = tuple(map(slice, array.shape))
                    assert np.array_equal(stored[inside], array.values)
                    assert np.isnan(stored).sum() == stored.size - array.size  # filled up
                for dim, unit in (("time", "s"), ("doppler", "hz")) if "signature" in example.arrays else ():
                    axis = one[dim if number == 0 else f"{dim}_{unit}"].values
                    assert np.array_equal(axis[~np.isnan(axis)], example.signature[dim].values)
    group = zarr.open_group(tmp_path / "0" / "dataset.zarr", mode="a", use_consolidated=False)
    export._write_whole(group, "untracked", np.empty((0, 0)), ("picture", "slice", "column", "cell"))
    assert group["untracked"].shape == (0, 0)


def members(path):
    with tarfile.open(path) as tar:
        return {m.name: tar.extractfile(m).read() for m in tar.getmembers()}


def test_webdataset_by_plain_tarfile(dataset, tmp_path):
    export_dataset(dataset, tmp_path / "out", form={"kind": "webdataset", "examples_per_tar": 4})
    assert sorted(p.name for p in (tmp_path / "out").glob("*.tar")) == [
        "test-000000.tar", "test-000001.tar", "train-000000.tar", "train-000001.tar",
    ]  # fmt: skip
    files = {name: data for path in (tmp_path / "out").glob("*.tar") for name, data in members(path).items()}
    assert len([name for name in files if name.endswith(".cls")]) == len(dataset)
    for example in dataset:
        for name, array in example.arrays.items():
            assert np.array_equal(np.load(io.BytesIO(files[f"{example.id}.{name}.npy"])), array.values)
        doppler_hz = np.load(io.BytesIO(files[f"{example.id}.signature_doppler_hz.npy"]))
        assert np.array_equal(doppler_hz, example.signature.doppler.values)
        row = {k: v for k, v in example.row.items() if k not in PLACES}
        found = json.loads(files[f"{example.id}.json"])
        assert found == row | {"class_number": {"human": 0, "dog": 1}[example.label]}
        assert files[f"{example.id}.cls"] == str(found["class_number"]).encode()


def test_webdataset_by_its_own_package(dataset, tmp_path):
    webdataset = pytest.importorskip("webdataset")
    export_dataset(dataset["train"], tmp_path / "out", form="webdataset", fields=["signature"])
    url = str(tmp_path / "out" / "train-000000.tar")
    samples = list(webdataset.WebDataset(url, shardshuffle=False).decode())
    assert [s["__key__"] for s in samples] == list(dataset["train"].index["id"])
    for sample in samples:
        assert np.array_equal(sample["signature.npy"], dataset[sample["__key__"]].signature.values)
        assert sample["json"]["label"] == ("human", "dog")[sample["cls"]]


def test_names_of_files_are_unique_and_have_one_dot_less():
    ids = ["a.b-1", "a_b-1", "a%2Eb-1", "a b-1", "ä/b~c"]
    names = [make_file_name(i) for i in ids]
    assert len(set(names)) == len(ids)
    assert not any(set(name) & set("./~ ") for name in names)
    assert make_file_name("human-000001") == "human-000001"


def test_zarr_by_xarray(dataset, tmp_path):
    pytest.importorskip("zarr")
    import xarray as xr

    export_dataset(
        dataset, tmp_path / "out", form=Zarr(examples_per_file=4), fields=["signature", "baseband", "truth_range_m"]
    )
    store = tmp_path / "out" / "dataset.zarr"
    assert json.loads((store / "zarr.json").read_text())["zarr_format"] == 3
    expected = expected_table(dataset)
    for split in ("train", "test"):
        part = dataset[split]
        index = xr.open_zarr(store, group=f"{split}/index", consolidated=False, chunks=None)
        for name in expected:
            values = expected.loc[expected["split"] == split, name]
            if pd.api.types.is_numeric_dtype(values):
                np.testing.assert_array_equal(index[name].values, values.to_numpy())
            else:
                assert list(map(str, index[name].values)) == list(values.fillna(""))
        for field in ("signature", "baseband"):
            found = xr.open_zarr(store, group=f"{split}/{field}", consolidated=False, chunks=None)
            for number, example in enumerate(part):
                array = example.arrays[field]
                assert found[field].dims == ("example", *array.dims)
                assert found[field].attrs["units"] == array.attrs["units"]
                assert np.array_equal(found[field].values[number], array.values)
                assert str(found["id"].values[number]) == example.id
                for dim in array.dims:
                    assert np.array_equal(found[dim].values, array[dim].values)
        for example in part:  # people and dogs have different numbers of scatterers
            one = xr.open_zarr(store, group=f"{split}/truth_range_m/{example.id}", consolidated=False, chunks=None)
            assert np.array_equal(one["truth_range_m"].values, example.arrays["truth_range_m"].values)


def test_without_zarr_one_error(dataset, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "zarr", None)
    with pytest.raises(DatasetError, match=r"zarr is not installed; .*doppelgait\[zarr\]"):
        export_dataset(dataset, tmp_path / "out", form="zarr")
    assert not list(tmp_path.iterdir())


def test_sigmf_by_our_reader(dataset, tmp_path):
    export_dataset(dataset["test"], tmp_path / "out", form="sigmf")
    assert len(list((tmp_path / "out").rglob("*.sigmf-meta"))) == 6
    for example in dataset["test"]:
        found = read_recording(tmp_path / "out" / "test" / f"{example.id}.sigmf-meta")
        assert np.array_equal(found.baseband.values, example.baseband.values)
        np.testing.assert_allclose(found.baseband.slow_time.values, example.baseband.slow_time.values, atol=1e-12)
        assert np.array_equal(found.baseband.range.values, example.baseband.range.values)
        assert found.radar == Radar.preset("x4")
        assert found.snr_frame_db == pytest.approx(example.row["snr_frame_db"])


def test_sigmf_has_one_recording_per_scene(mixed, tmp_path):
    export_dataset(mixed, tmp_path / "out", form="sigmf")
    paths = sorted((tmp_path / "out").rglob("*.sigmf-meta"))
    assert [path.name.partition(".")[0] for path in paths] == sorted(set(mixed.index["scene_id"]))
    assert len(mixed) == 2 * len(paths) == 8
    for path in paths:
        meta = json.loads(path.read_text())
        assert [a["core:label"] for a in meta["annotations"]] == ["human", "dog"]
        rows = mixed.index[mixed.index["scene_id"] == path.name.partition(".")[0]]
        assert meta["global"]["doppelgait:prf_hz"] == pytest.approx(rows["prf_hz"].iloc[0])


def test_description_and_card_go_with_the_files(dataset, tmp_path):
    calls = []
    report = export_dataset(dataset["train"], tmp_path / "out", form="csv", on_progress=lambda *c: calls.append(c))
    description = json.loads((tmp_path / "out" / "dataset.json").read_text())
    assert description["export"]["rows"] == {"train": 6}
    assert description["export"]["form"] == "csv"
    assert {k: v for k, v in description.items() if k != "export"} == dataset.description
    assert (tmp_path / "out" / "source-card.md").read_text() == (dataset.directory / "README.md").read_text()
    assert calls[-1] == (6, 6)
    files = [p for p in (tmp_path / "out").rglob("*") if p.is_file()]
    assert (report.n_rows, report.n_files, report.bytes) == (6, len(files), sum(p.stat().st_size for p in files))


def test_nothing_is_overwritten(dataset, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine.txt").write_text("mine")
    with pytest.raises(DatasetError, match="exists already; nothing is overwritten"):
        export_dataset(dataset, tmp_path / "out", form="csv")
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["mine.txt"]
    (tmp_path / "new.partial").mkdir()  # of something else
    export_dataset(dataset, tmp_path / "new", form="csv")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["new", "new.partial", "out"]


@pytest.mark.parametrize("form", INSTALLED)
def test_full_disk_is_one_error_and_leaves_nothing(dataset, tmp_path, form):
    """A limit on the size of files stands for the disk: writing fails in the middle of a file."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    size = 8_000
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, limits[1]))
    try:
        with pytest.raises(OutputError, match=r"out: cannot be written: \[Errno.*; no partial export remains"):
            export_dataset(dataset, tmp_path / "out", form=form)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("stop", [OSError(errno.ENOSPC, "No space left on device"), KeyboardInterrupt()])
def test_an_end_in_the_last_step_leaves_nothing(dataset, tmp_path, monkeypatch, stop):
    def fail(*arguments):
        raise stop

    monkeypatch.setattr("doppelgait.dataset.export.shutil.copyfile", fail)
    with pytest.raises((OutputError, KeyboardInterrupt), match=r"No space left on device|^$"):
        export_dataset(dataset["test"], tmp_path / "out", form="webdataset")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"form": "hdf4"},
            "form kind 'hdf4' is not allowed: known are csv, huggingface, parquet, sigmf, webdataset, xarray, zarr",
        ),
        ({"form": {"kind": "zarr", "examples_per_file": 0}}, "form kind 'zarr': examples_per_file: 0 is not allowed"),
        ({"form": "csv", "fields": ["signature"]}, "csv holds no arrays only, not 'signature'"),
        ({"form": "sigmf", "fields": ["signature"]}, "sigmf holds baseband only, not 'signature'"),
        ({"form": "sigmf", "fields": []}, "sigmf needs baseband"),
        ({"form": "parquet", "fields": ["envelope"]}, "keeps no 'envelope'"),
    ],
)
def test_wrong_requests(dataset, tmp_path, options, message):
    with pytest.raises((ConfigError, DatasetError), match=message):
        export_dataset(dataset, tmp_path / "out", **options)
    with pytest.raises(DatasetError, match="nothing to export"):
        export_dataset(dataset.select("prf_hz < 0"), tmp_path / "out", form="csv")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("form", list(EXPORTERS))
def test_every_exporter_keeps_its_contract(dataset, form):
    if form not in INSTALLED:
        pytest.importorskip("zarr")
    check_exporter(form, dataset["test"])


class Lines(FrozenModel):
    """One line of text per row."""

    kind: Literal["lines"] = "lines"
    end: str = "\n"


@pytest.mark.parametrize(
    ("fault", "says"),
    [("silent", "counts 0 of"), ("clock", "gives other files"), ("outside", "leaves files"), ("vandal", "changes the")],
)
def test_a_broken_exporter_is_caught(dataset, tmp_path, register, fault, says):
    copy = tmp_path / "copy"
    shutil.copytree(dataset.directory, copy)
    ticks = iter(range(100))

    @register("exporter", parameters=Lines)
    def write_broken(dataset, folder, fields, parameters, done):
        (folder / "a.txt").write_text(str(next(ticks)) if fault == "clock" else "a")
        if fault == "outside":
            (folder.parent / "z.txt").write_text("z")
        if fault == "vandal":
            (dataset.directory / "README.md").write_text("mine")
        if fault != "silent":
            done(len(dataset))

    with pytest.raises(AssertionError, match=rf"exporter 'lines': .*{says}"):
        check_exporter("lines", open_dataset(copy))


@pytest.mark.parametrize("licence", ["CC-BY-NC-4.0", "", "for research only", "CC-BY-4.0"])
def test_release_is_refused_by_name(dataset, tmp_path, licence):
    recorded = changed(dataset, tmp_path / "copy", 1, source="recording", recording="dogs/rex.bvh", licence=licence)
    if licence == "CC-BY-4.0":
        refuse_unreleasable(recorded)
        return
    named = licence or "licence unknown"
    with pytest.raises(DatasetError, match=rf"cannot be released, .*: dogs/rex.bvh \({named}\); state"):
        export_dataset(recorded, tmp_path / "out", form="csv", release=True)
    export_dataset(recorded, tmp_path / "out", form="csv")
    assert (tmp_path / "out" / "index.csv").is_file()


def test_release_counts_everybody_in_a_scene(mixed, tmp_path):
    """The echo of a companion is in the signature of the other, so leaving out its row does not help."""
    row = int(np.flatnonzero(mixed.index["label"] == "dog")[0])
    scene = mixed.index["scene_id"][row]
    blocked = changed(mixed, tmp_path / "copy", row, source="recording", recording="rex.bvh", licence="CC-BY-NC-4.0")
    with pytest.raises(DatasetError, match=r"rex\.bvh"):
        refuse_unreleasable(blocked.select("label == 'human'"))
    refuse_unreleasable(blocked.select(f"scene_id != '{scene}'"))
