"""Building: same bytes for any worker count, resume, failures, refusals, reading back."""

import json

import pandas as pd
import pytest

from dataset_plans import tiny_plan
from doppelgait.core.errors import DatasetError
from doppelgait.core.files import hash_file
from doppelgait.dataset import build_dataset
from doppelgait.motion import boulic_walk


def small_plan(**changes):
    """8 examples of 1.5 s."""
    fields = ["signature", "cadence_map", "baseband"]
    dataset = {"name": "small", "examples_per_class": 4, "fields": fields}
    scene = changes.pop("scene", {"duration_s": 1.5})
    return tiny_plan(dataset=dataset, scene=scene, target={"range_m": {"uniform": [4, 5]}}, **changes)


def hashes(folder):
    return {p.name: hash_file(p) for p in sorted((folder / "shards").glob("*.h5"))}


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


def test_another_configuration_in_the_same_folder_is_refused_with_the_difference(built):
    folder, _ = built
    before = hashes(folder)
    with pytest.raises(DatasetError, match=r"scene\.duration_s: 1\.5 -> 2\.0"):
        build_dataset(small_plan(scene={"duration_s": 2.0}), folder, workers=1)
    assert hashes(folder) == before


def test_a_second_build_tries_failed_examples_again_and_only_their_shards(built, tmp_path, monkeypatch):
    import doppelgait.dataset.build as build
    import doppelgait.dataset.shard as shard

    real_example, real_shard, tried = shard.simulate_example, build.build_shard, []

    def fails_once(example, *arguments, **options):
        if example.id == "dog-000002":
            raise DatasetError("no luck")
        return real_example(example, *arguments, **options)

    monkeypatch.setattr(shard, "simulate_example", fails_once)
    first = build_dataset(small_plan(), tmp_path, workers=1)
    assert [f["id"] for f in first.failures] == ["dog-000002"]
    assert (first.n_examples, first.n_built, first.n_reused) == (7, 7, 0)
    monkeypatch.setattr(shard, "simulate_example", real_example)
    monkeypatch.setattr(build, "build_shard", lambda s, *a: tried.append(s) or real_shard(s, *a))
    second = build_dataset(small_plan(), tmp_path, workers=1)
    assert second.failures == []
    assert len(tried) == 1
    assert second.n_built == len(tried[0].examples)
    assert second.n_reused == 8 - len(tried[0].examples)
    assert hashes(tmp_path) == hashes(built[0])
    assert json.loads((tmp_path / "dataset.json").read_text())["complete"]


def walker(path, *, speed_mps=1.2, **options):
    return boulic_walk(speed_mps=speed_mps, duration_s=3.0)


def test_recordings_are_in_the_index_and_the_card(built, tmp_path, monkeypatch):
    monkeypatch.setattr("doppelgait.motion.readers.read", walker)
    (tmp_path / "one.c3d").write_bytes(b"1")
    (tmp_path / "two.c3d").write_bytes(b"2")
    classes = [
        {"label": "human", "motion": {"kind": "file", "path": {"choice": ["one.c3d", "two.c3d"]}}},
        {"label": "dog", "motion": {"kind": "quadruped"}},
    ]
    build_dataset(small_plan(classes=classes), tmp_path / "d", folder=tmp_path, workers=1)
    index = pd.read_parquet(tmp_path / "d" / "index.parquet")
    people, dogs = index[index["label"] == "human"], index[index["label"] == "dog"]
    assert set(people["source"]) == {"recording"}
    assert set(people["recording"]) == {"one.c3d", "two.c3d"}
    assert list(people["subject"]) == [f"file/{name}" for name in people["recording"]]
    assert (people.groupby("recording")["split"].nunique() == 1).all()
    assert set(dogs["source"]) == {"model"}
    assert set(dogs["recording"]) == {""}
    card = (tmp_path / "d" / "README.md").read_text()
    for text in ("of 4 examples is from recordings", "`one.c3d`", "`two.c3d`", "their licences apply", "Dog motion"):
        assert text in card
    assert "contains no recording" not in card
    assert "Boulic" not in card
    model_card = (built[0] / "README.md").read_text()
    assert "It contains no recording of a person or animal" in model_card
    assert "Boulic" in model_card
    assert "licences" not in model_card


@pytest.mark.filterwarnings("error")
def test_a_body_that_stands_still_has_no_aspect(tmp_path):
    build_dataset(small_plan(classes=[{"label": "rest", "motion": {"kind": "breathing"}}]), tmp_path, workers=1)
    assert pd.read_parquet(tmp_path / "index.parquet")["truth_aspect_deg"].isna().all()


def test_examples_that_overlap_in_one_process_keep_their_one_blas_thread():
    import numpy as np
    from threadpoolctl import threadpool_info, threadpool_limits

    from doppelgait.core.worker import limit_blas_threads

    def threads():
        return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}

    assert np.ones(2) @ np.ones(2) == 2
    with threadpool_limits(2, user_api="blas"):
        first, second = limit_blas_threads(), limit_blas_threads()
        first.__enter__()
        second.__enter__()
        first.__exit__(None, None, None)
        assert threads() == {1}
        second.__exit__(None, None, None)
        assert threads() == {2}
