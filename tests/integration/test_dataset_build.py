"""Building: same bytes for any worker count, resume, failures, refusals, reading back."""

from __future__ import annotations

import json

import h5py
import numpy as np
import pandas as pd
import pytest

from doppelgait.core.config import validate
from doppelgait.core.errors import DatasetError, OutputError
from doppelgait.dataset import build_dataset, load_plan, open_dataset
from doppelgait.dataset.config import PlanConfig
from doppelgait.dataset.shard import file_sha256


def small_plan(**changes):
    table = {
        "dataset": {
            "name": "small",
            "examples_per_class": 4,
            "shard_size": 3,
            "fractions": {"train": 0.5, "test": 0.5},
            "fields": ["signature", "cadence_map", "baseband"],
        },
        "classes": [
            {"label": "human", "motion": {"kind": "boulic", "speed_mps": {"uniform": [0.9, 1.4]}}},
            {"label": "dog", "motion": {"kind": "quadruped", "gait": "trot"}},
        ],
        "scene": {"duration_s": 1.5},
        "target": {"range_m": {"uniform": [4, 5]}},
        "noise": {"kind": "snr", "snr_db": {"uniform": [10, 20]}},
        **changes,
    }
    return validate(PlanConfig, table, where="plan")


def hashes(folder):
    return {p.name: file_sha256(p) for p in sorted((folder / "shards").glob("*.h5"))}


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    folder = tmp_path_factory.mktemp("built")
    report = build_dataset(small_plan(), folder, workers=1)
    return folder, report


def test_the_report_and_the_files_agree(built):
    folder, report = built
    assert (report.n_examples, report.n_built, report.n_reused, report.failures) == (8, 8, 0, [])
    description = json.loads((folder / "dataset.json").read_text())
    assert description["complete"]
    assert description["id"] == report.dataset_id
    assert description["classes"] == {"human": 0, "dog": 1}
    index = pd.read_parquet(folder / "index.parquet")
    assert len(index) == 8
    assert index["label"].value_counts().to_dict() == {"human": 4, "dog": 4}
    assert not list(folder.rglob("*.partial"))


def test_two_processes_give_the_same_bytes(built, tmp_path):
    folder, _ = built
    build_dataset(small_plan(), tmp_path, workers=2)
    assert hashes(tmp_path) == hashes(folder)
    assert (tmp_path / "index.parquet").read_bytes() == (folder / "index.parquet").read_bytes()
    assert (tmp_path / "dataset.json").read_bytes() == (folder / "dataset.json").read_bytes()


def test_a_second_build_makes_nothing(built, monkeypatch):
    folder, _ = built
    monkeypatch.setattr("doppelgait.dataset.build.build_shard", lambda *a: pytest.fail("built again"))
    report = build_dataset(small_plan(), folder, workers=1)
    assert (report.n_built, report.n_reused) == (0, 8)


def test_a_damaged_a_missing_and_a_half_written_shard_are_made_again(built, tmp_path):
    folder, _ = built
    build_dataset(small_plan(), tmp_path, workers=1)
    shards = sorted((tmp_path / "shards").glob("*.h5"))
    shards[0].write_bytes(shards[0].read_bytes()[:-10])
    shards[1].unlink()
    (tmp_path / "shards" / "train-00000-of-00009.h5.partial").write_bytes(b"rest of a killed run")
    report = build_dataset(small_plan(), tmp_path, workers=1)
    assert report.n_built > 0
    assert hashes(tmp_path) == hashes(folder)
    assert not list(tmp_path.rglob("*.partial"))


def test_another_configuration_in_the_same_folder_is_refused_with_the_difference(built):
    folder, _ = built
    before = hashes(folder)
    with pytest.raises(DatasetError, match=r"scene\.duration_s: 1\.5 -> 2\.0"):
        build_dataset(small_plan(scene={"duration_s": 2.0}), folder, workers=1)
    assert hashes(folder) == before


def test_a_foreign_folder_is_not_touched(tmp_path):
    (tmp_path / "thesis.doc").write_text("mine")
    with pytest.raises(DatasetError, match="holds no dataset"):
        build_dataset(small_plan(), tmp_path, workers=1)
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.doc"]


def test_a_failing_example_is_recorded_and_the_others_are_kept(tmp_path):
    classes = [
        {"label": "human", "motion": {"kind": "boulic"}},
        {"label": "ghost", "motion": {"kind": "file", "path": "missing.c3d"}},
    ]
    (tmp_path / "missing.c3d").write_bytes(b"not a C3D file")
    report = build_dataset(small_plan(classes=classes), tmp_path / "d", folder=tmp_path, workers=1)
    assert report.n_examples == 4
    assert len(report.failures) == 4
    assert all("missing.c3d" in f["reason"] and "Traceback" not in f["reason"] for f in report.failures)
    assert not json.loads((tmp_path / "d" / "dataset.json").read_text())["complete"]


def test_a_full_disk_is_one_error_and_keeps_what_was_built(tmp_path, monkeypatch):
    import doppelgait.dataset.shard as shard

    def no_space(path):
        raise OSError(28, "No space left on device")

    real = shard._sync
    monkeypatch.setattr(shard, "_sync", lambda path: no_space(path) if path.name.startswith("t") else real(path))
    with pytest.raises(OutputError, match="No space left"):
        build_dataset(small_plan(), tmp_path, workers=1)
    monkeypatch.undo()
    assert build_dataset(small_plan(), tmp_path, workers=1).n_examples == 8


def test_features_arrays_and_truth_read_back(built):
    folder, _ = built
    dataset = open_dataset(folder)
    X, y, groups = dataset["train"].features()
    assert X.shape == (4, 6)
    assert set(y) == {"human", "dog"}
    assert len(set(groups)) == 4
    assert len(dataset.select("label == 'dog'")) == 4
    array = dataset.array("signature", 0)
    assert array.dtype == np.float32
    assert array.ndim == 2
    assert np.isfinite(array).all()
    assert dataset.array("baseband", 0).dtype == np.complex64
    walkers = dataset.select("label == 'human'").index
    assert (walkers["gait_frequency_hz"] / walkers["truth_gait_frequency_hz"] - 1).abs().max() < 0.1


def test_a_shard_is_readable_with_plain_h5py(built):
    folder, _ = built
    index = pd.read_parquet(folder / "index.parquet")
    row = index.iloc[3]
    with h5py.File(folder / "shards" / f"{row['shard']}.h5") as file:
        assert file["id"].asstr()[row["row"]] == row["id"]
        assert file["signature"].shape[0] == len(file["id"])


def test_open_dataset_says_what_is_missing(tmp_path, built):
    with pytest.raises(DatasetError, match="build it first"):
        open_dataset(tmp_path)
    dataset = open_dataset(built[0])
    with pytest.raises(DatasetError, match="no split 'valid'"):
        dataset["valid"]
    with pytest.raises(DatasetError, match="keeps no 'truth'"):
        dataset.array("truth", 0)


def test_home_alarm_stays_inside_the_frame_and_never_aliases(tmp_path):
    plan, folder = load_plan("home-alarm", overrides=["dataset.examples_per_class=8", "dataset.shard_size=8"])
    report = build_dataset(plan, tmp_path, folder=folder, workers=1)
    index = open_dataset(tmp_path).index
    assert report.failures == []
    assert set(index["warnings"]) == {""}
