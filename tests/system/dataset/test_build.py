"""Building: resume, failures, recordings in index and card, bodies at rest; same bytes: test_executors.py."""

import json

import numpy as np
import pandas as pd
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from dataset_plans import dataset_hash, mini_plan, tiny_plan, whole_dataset
from doppelgait.core.errors import DatasetError
from doppelgait.core.worker import limit_blas_threads
from doppelgait.dataset import build, build_dataset, shard
from doppelgait.motion import boulic_walk


def test_a_second_build_makes_failed_examples_again_and_a_third_nothing(tmp_path, monkeypatch):
    build_dataset(mini_plan(), tmp_path / "whole", workers=1)
    real_example, real_shard, made = shard.simulate_example, build.build_shard, []

    def fail_once(example, *arguments, **options):
        if example.id == "dog-000001":
            raise DatasetError("no luck")
        return real_example(example, *arguments, **options)

    monkeypatch.setattr(shard, "simulate_example", fail_once)
    first = build_dataset(mini_plan(), tmp_path / "d", workers=1)
    assert [failure["id"] for failure in first.failures] == ["dog-000001"]
    assert (first.n_examples, first.n_built, first.n_reused) == (3, 3, 0)
    monkeypatch.setattr(shard, "simulate_example", real_example)
    monkeypatch.setattr(build, "build_shard", lambda s, *a: made.append(s) or real_shard(s, *a))
    again = [build_dataset(mini_plan(), tmp_path / "d", workers=1) for _ in range(2)]
    assert [(report.n_built, report.n_reused, report.failures) for report in again] == [(2, 2, []), (0, 4, [])]
    assert len(made) == 1
    assert dataset_hash(tmp_path / "d") == dataset_hash(tmp_path / "whole")


def test_recordings_are_in_the_index_and_the_card(tmp_path, tmp_path_factory, monkeypatch):
    monkeypatch.setattr("doppelgait.motion.readers.read", lambda path, **options: boulic_walk(duration_s=2.0))
    (tmp_path / "one.c3d").write_bytes(b"1")
    (tmp_path / "two.c3d").write_bytes(b"2")
    classes = [
        {"label": "human", "motion": {"kind": "file", "path": {"choice": ["one.c3d", "two.c3d"]}}},
        {"label": "dog", "motion": {"kind": "quadruped"}},
    ]
    plan = tiny_plan(dataset={"examples_per_class": 4}, classes=classes)
    report = build_dataset(plan, tmp_path / "d", folder=tmp_path, workers=1)
    assert json.loads((tmp_path / "d" / "dataset.json").read_text())["id"] == report.dataset_id
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
    model_card = (whole_dataset(tmp_path_factory) / "README.md").read_text()
    assert "It contains no recording of a person or animal" in model_card
    assert "Boulic" in model_card
    assert "licences" not in model_card


@pytest.mark.filterwarnings("error")
def test_a_body_that_stands_still_has_no_aspect(tmp_path):
    plan = tiny_plan(dataset={"examples_per_class": 4}, classes=[{"label": "rest", "motion": {"kind": "breathing"}}])
    build_dataset(plan, tmp_path, workers=1)
    assert pd.read_parquet(tmp_path / "index.parquet")["truth_aspect_deg"].isna().all()


def test_examples_that_overlap_in_one_process_keep_their_one_blas_thread():
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
