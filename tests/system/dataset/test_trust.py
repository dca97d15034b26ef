"""Damage and mix-ups of a dataset's files: each is found by build, status, open or verify, and none is a traceback."""

import json
import os
import platform
import shutil
import sys

import numpy as np
import pytest

import processes
from dataset_plans import dataset_hash, mini_plan
from doppelgait.core.errors import DatasetError, DoppelgaitError
from doppelgait.dataset import open_dataset
from doppelgait.dataset.build import build_dataset, read_dataset_status
from doppelgait.dataset.finish import SUMS
from doppelgait.dataset.verify import verify_dataset
from shared_work import made_once

FLIPS = int(os.environ.get("DOPPELGAIT_FLIPS", "60"))


def build(folder, **changes):
    return build_dataset(mini_plan(**changes), folder, executor="serial")


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    return made_once(tmp_path_factory, "dataset-trust", build)


@pytest.fixture
def copy(built, tmp_path):
    return shutil.copytree(built, tmp_path / "copy")


def failed(folder):
    found = verify_dataset(folder, share=0.0, rng=np.random.default_rng(1))
    return {check.name for check in found.checks if check.status in ("failed", "skipped")}


@pytest.fixture(scope="module")
def usual(built):
    """Checks that so small a dataset fails whole: both classes differ in their cross section."""
    return failed(built)


def test_files_of_another_plan_are_no_part_and_a_shard_is_built_again(copy, built, tmp_path, usual):
    build(tmp_path / "other", noise={"kind": "snr", "snr_db": {"uniform": [30, 40]}})
    name = "train-00000-of-00001"
    for ending in ("h5", "json"):
        shutil.copy(tmp_path / "other" / "shards" / f"{name}.{ending}", copy / "shards")
    state = read_dataset_status(copy).shards[name]
    assert state == "damaged"
    assert {"files", "shards"} <= failed(copy) - usual
    dataset = open_dataset(copy)
    with pytest.raises(DatasetError, match=r"it is of dataset '\w{16}', not of \w{16}"):
        dataset["train"].array("signature", 0)
    index = (copy / "index.parquet").read_bytes()
    text_of_no_utf8 = index.replace(b"boulic", b"boul\xffc")
    other = (tmp_path / "other" / "index.parquet").read_bytes()
    for content, says in ((text_of_no_utf8, "is damaged"), (other, r"index\.parquet: belongs to dataset")):
        (copy / "index.parquet").write_bytes(content)
        assert {"files", "index"} <= failed(copy)
        with pytest.raises(DatasetError, match=says):
            open_dataset(copy)
    (copy / "index.parquet").write_bytes(index)
    (copy / "notes.txt").write_text("mine")
    report = build(copy)
    assert (report.n_built, report.n_reused) == (2, 2)
    check = verify_dataset(copy, share=0.0, rng=np.random.default_rng(1)).check("files")
    assert (check.status, check.summary) == ("warning", "no part of the dataset: notes.txt")
    (copy / "notes.txt").unlink()
    assert dataset_hash(copy) == dataset_hash(built)
    assert failed(copy) == usual


@pytest.mark.parametrize("schema", [2, 4])
def test_a_dataset_of_another_schema_is_not_touched_by_a_build(copy, schema):
    description = json.loads((copy / "dataset.json").read_text())
    (copy / "dataset.json").write_text(json.dumps({**description, "schema_version": schema, "complete": False}))
    (copy / "shards" / "test-00000-of-00001.json").unlink()
    before = dataset_hash(copy)
    with pytest.raises(DatasetError, match=f"in format version {schema}; this one reads 3"):
        build(copy)
    assert dataset_hash(copy) == before


DEEP = '{"rows": ' + "[" * 100_000 + "]" * 100_000 + "}"


@pytest.mark.parametrize(
    ("name", "content", "check"),
    [
        ("splits/train.txt", b"human-\xff\n", "splits"),
        ("index.parquet", b"PAR1 is no index PAR1", "index"),
        ("shards/train-00000-of-00001.json", DEEP.encode(), "shards"),
        ("shards/train-00000-of-00001.json", b"[]", "shards"),
        ("shards/train-00000-of-00001.json", b'{"dataset": 1e999, "rows": {}}', "shards"),
        ("README.md", b"another card", "files"),
        (SUMS, b"", "files"),
        (SUMS, b"\xff\xfe", "files"),
    ],
)
def test_damage_is_a_finding_and_the_next_build_repairs_it(copy, built, usual, name, content, check):
    (copy / name).write_bytes(content)
    assert {"files", check} <= failed(copy)
    build(copy)
    assert dataset_hash(copy) == dataset_hash(built)
    assert failed(copy) == usual


@pytest.mark.parametrize(
    "change",
    [
        {"shards": {"train": 10_000_000}}, {"shards": {"train": -1}}, {"shards": [1]}, {"shards": {"../x": 1}},
        {"config": []}, {"id": 3}, {"name": None}, {"n_examples": "many"}, {"schema_version": 3.5}, None,
    ],
)  # fmt: skip
def test_a_description_that_makes_no_sense_is_one_line(copy, change):
    description = json.loads((copy / "dataset.json").read_text())
    (copy / "dataset.json").write_text(DEEP if change is None else json.dumps({**description, **change}))
    for look in (failed, read_dataset_status) if change else (failed, read_dataset_status, open_dataset, build):
        with pytest.raises(DatasetError, match=r"dataset\.json"):
            look(copy)


def test_every_flip_of_a_bit_is_found(built, tmp_path, usual):
    """At random places of every file: the list of the hashes and the log are files, too."""
    copy, rng = shutil.copytree(built, tmp_path / "copy"), np.random.default_rng(24)
    files = sorted(path for path in copy.rglob("*") if path.is_file())
    assert len(files) == len(["card", "log", "hash of the log", "description", "index", "hashes"]) + 3 + 2 * 2
    missed = []
    for number in range(FLIPS):
        path = files[number % len(files)]
        whole = path.read_bytes()
        if not whole:  # the list of a split without rows
            continue
        at, bit = int(rng.integers(len(whole))), int(rng.integers(8))
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 1 << bit]) + whole[at + 1 :])
        try:
            if "files" not in failed(copy):
                missed.append((path.name, at, bit))
        except DoppelgaitError:
            pass
        path.write_bytes(whole)
    assert missed == []
    assert failed(copy) == usual


CONTENTS = """
import json, sys
from dataset_plans import tiny_plan
from doppelgait.dataset.build import build_dataset
build_dataset(tiny_plan(), sys.argv[1], executor="serial")
print(json.loads(open(sys.argv[1] + "/dataset.json").read())["contents_sha256"])
"""


@pytest.mark.skipif(platform.machine() != "x86_64" or sys.platform != "linux", reason="kernels of OpenBLAS for x86-64")
@pytest.mark.release
def test_the_hash_of_the_contents_does_not_depend_on_the_kernels_for_matrices(tmp_path):
    found = {
        kernels: processes.python(CONTENTS, tmp_path / kernels, OPENBLAS_CORETYPE=kernels).stdout
        for kernels in ("Prescott", "Haswell")
    }
    assert found["Prescott"] == found["Haswell"]
    assert len(found["Haswell"]) == 65
