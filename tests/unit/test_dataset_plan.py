"""The plan: distributions, splits, identity, shards; nothing is simulated."""

from __future__ import annotations

import numpy as np
import pytest

from doppelgait.core.config import validate
from doppelgait.core.errors import ConfigError, DatasetError
from doppelgait.dataset.config import DatasetSection, PlanConfig, load_plan, plan_names
from doppelgait.dataset.plan import assign_splits, dataset_id, plan_examples, plan_shards
from doppelgait.dataset.sampling import resolve


def draw(value, example=0, key="k"):
    return resolve(value, seed=1, example=example, key=key)


def test_distributions_stay_in_their_limits_and_have_their_means():
    uniform = [draw({"uniform": [2, 4]}, n) for n in range(400)]
    assert min(uniform) >= 2
    assert max(uniform) <= 4
    assert np.mean(uniform) == pytest.approx(3, abs=0.1)
    log = [draw({"log_uniform": [0.1, 1.6]}, n) for n in range(400)]
    assert np.median(log) == pytest.approx(0.4, rel=0.15)
    normal = [draw({"normal": [1.7, 0.1]}, n) for n in range(400)]
    assert np.std(normal) == pytest.approx(0.1, rel=0.1)
    assert max(abs(v - 1.7) for v in normal) <= 0.3 + 1e-12
    assert {draw({"choice": ["a", "b"]}, n) for n in range(50)} == {"a", "b"}


def test_a_choice_of_tables_is_resolved_inside():
    drawn = [draw({"choice": [{"kind": "x", "v": {"uniform": [0, 1]}}, {"kind": "y"}]}, n) for n in range(50)]
    assert {d["kind"] for d in drawn} == {"x", "y"}
    assert all(0 <= d["v"] <= 1 for d in drawn if d["kind"] == "x")


def test_a_key_has_its_own_stream():
    alone = resolve({"a": {"uniform": [0, 1]}}, seed=1, example=3, key="t")["a"]
    together = resolve({"new": {"uniform": [0, 1]}, "a": {"uniform": [0, 1]}}, seed=1, example=3, key="t")
    assert together["a"] == alone
    assert together["new"] != alone


@pytest.mark.parametrize(
    ("value", "says"),
    [
        ({"uniform": [2]}, "two numbers"),
        ({"uniform": [4, 2]}, "must not exceed"),
        ({"log_uniform": [0, 1]}, "positive"),
        ({"normal": [1, -1]}, "standard deviation"),
        ({"choice": []}, "at least one"),
        ({"uniform": ["a", 1]}, "two numbers"),
    ],
)
def test_wrong_distributions_are_named(value, says):
    with pytest.raises(ConfigError, match=f"target.range_m: .*{says}"):
        draw(value, key="target.range_m")


def plan(**changes):
    table = {
        "dataset": {"name": "small", "examples_per_class": 20, "shard_size": 7},
        "classes": [
            {"label": "human", "motion": {"kind": "boulic", "speed_mps": {"uniform": [0.8, 1.4]}}},
            {"label": "dog", "motion": {"kind": "quadruped"}},
        ],
        "scene": {"duration_s": 2.0},
        **changes,
    }
    return validate(PlanConfig, table, where="plan")


def test_every_example_is_resolved_and_its_subject_is_in_one_split():
    examples = plan_examples(plan())
    assert len(examples) == 40
    assert len({e.id for e in examples}) == 40
    assert len({e.run.example for e in examples}) == 40
    speeds = [e.run.scene.targets[0].motion["speed_mps"] for e in examples if e.label == "human"]
    assert len(set(speeds)) == 20
    by_subject = {}
    for e in examples:
        by_subject.setdefault(e.subject, set()).add(e.split)
    assert all(len(splits) == 1 for splits in by_subject.values())
    for label in ("human", "dog"):
        splits = [e.split for e in examples if e.label == label]
        assert [splits.count(s) for s in ("train", "validation", "test")] == [14, 3, 3]


def test_planning_twice_gives_the_same_and_another_seed_another_plan():
    assert plan_examples(plan()) == plan_examples(plan())
    other = plan(dataset={"name": "small", "examples_per_class": 20, "seed": 7})
    assert plan_examples(other)[0].run.scene != plan_examples(plan())[0].run.scene


def test_shards_hold_each_example_once_and_one_split_each():
    examples = plan_examples(plan())
    shards = list(plan_shards(plan(), examples))
    assert sorted(e.id for s in shards for e in s.examples) == sorted(e.id for e in examples)
    assert all({e.split for e in s.examples} == {s.split} for s in shards)
    assert all(len(s.examples) <= 7 for s in shards)
    assert all(len({e.label for e in s.examples}) == 2 for s in shards)


def test_too_few_subjects_for_a_split_are_refused():
    section = validate(DatasetSection, {"name": "x", "examples_per_class": 2})
    with pytest.raises(DatasetError, match="'dog' has 2 subjects, too few"):
        assign_splits(section, "dog", ["a", "b"])


def test_identity_follows_the_configuration_only(tmp_path):
    assert dataset_id(plan(), tmp_path) == dataset_id(plan(), tmp_path / "elsewhere")
    assert dataset_id(plan(noise={"kind": "none"}), tmp_path) != dataset_id(plan(), tmp_path)


def test_identity_follows_the_motion_files(tmp_path):
    classes = [{"label": "a", "motion": {"kind": "file", "path": {"choice": ["one.c3d", "two.c3d"]}}}]
    (tmp_path / "one.c3d").write_bytes(b"1")
    (tmp_path / "two.c3d").write_bytes(b"2")
    before = dataset_id(plan(classes=classes), tmp_path)
    (tmp_path / "two.c3d").write_bytes(b"3")
    assert dataset_id(plan(classes=classes), tmp_path) != before
    (tmp_path / "two.c3d").unlink()
    with pytest.raises(ConfigError, match=r"two\.c3d: cannot be read"):
        dataset_id(plan(classes=classes), tmp_path)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"radar": {"preset": "x4", "prf_hz": "auto"}}, "tells the speed"),
        ({"target": {"label": "human"}}, "belongs into"),
        ({"scene": {"gravity": 1}}, "allowed are duration_s"),
        ({"noise": {"kind": "loud"}}, "noise.kind"),
        ({"analysis": {"hops": 1}}, "analysis.hops"),
        ({"target": {"range_m": -1}}, "targets.0.range_m"),
        ({"typo": 1}, "typo.*unknown key"),
    ],
)
def test_wrong_plans_are_refused_with_the_key(changes, says):
    with pytest.raises(ConfigError, match=says):
        plan_examples(plan(**changes))


def test_shares_must_sum_to_one():
    with pytest.raises(ConfigError, match=r"fractions.*sum to 1"):
        plan(dataset={"name": "x", "examples_per_class": 4, "fractions": {"train": 0.5, "test": 0.1}})


def test_built_in_plans_load_and_an_unknown_name_lists_them(tmp_path):
    assert "home-alarm" in plan_names()
    loaded, _ = load_plan("home-alarm")
    assert loaded.dataset.name == "home-alarm"
    with pytest.raises(ConfigError, match="home-alarm"):
        load_plan(tmp_path / "nothing.toml")


def test_home_alarm_keeps_every_nuisance_outside_the_classes():
    loaded, _ = load_plan("home-alarm", overrides=["dataset.examples_per_class=40"])
    assert all(set(section.model_dump()) == {"label", "motion"} for section in loaded.classes)
    examples = plan_examples(loaded)
    assert {e.run.radar.prf_hz for e in examples} == {1300.0}
    assert {e.run.scene.duration_s for e in examples} == {2.5}
    assert {e.run.analysis.gate_span_m for e in examples} == {1.6}
