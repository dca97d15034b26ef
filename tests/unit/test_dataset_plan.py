"""The plan: distributions, splits, identity, shards; nothing is simulated."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import ks_2samp

from doppelgait.core.config import validate
from doppelgait.core.errors import ConfigError, DatasetError
from doppelgait.dataset.config import DatasetSection, PlanConfig, load_plan, plan_names
from doppelgait.dataset.describe import differences, shorten
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
        ({"target": {"label": "human"}}, "belongs into"),
        ({"scene": {"gravity": 1}}, r"scene.gravity: unknown key; allowed are .*duration_s"),
        ({"noise": {"kind": "loud"}}, "noise.kind"),
        ({"analysis": {"hops": 1}}, "analysis.hops"),
        ({"target": {"range_m": -1}}, "targets.0.range_m"),
        ({"typo": 1}, "typo.*unknown key"),
    ],
)
def test_wrong_plans_are_refused_with_the_key(changes, says):
    with pytest.raises(ConfigError, match=says):
        plan_examples(plan(**changes))


@pytest.mark.parametrize("wrap", [lambda value: value, lambda value: {"choice": [value]}], ids=["plain", "drawn"])
def test_leaks_are_refused_however_they_are_written(wrap):
    with pytest.raises(ConfigError, match="'auto' is not allowed in a dataset: it tells the speed"):
        plan_examples(plan(radar={"preset": "x4", "prf_hz": wrap("auto")}))
    with pytest.raises(ConfigError, match="'liland2018' is not allowed in a dataset: its gate"):
        plan_examples(plan(analysis={"method": wrap("liland2018")}))


def with_dog_motion(motion):
    return plan(classes=[{"label": "human", "motion": {"kind": "boulic"}}, {"label": "dog", "motion": motion}])


@pytest.mark.parametrize(
    ("motion", "says"),
    [
        ({"kind": "boulic", "speed": {"uniform": [1.5, 1.5]}}, r"classes\.1\.motion\.speed: unknown key.*1\.5"),
        (
            {"kind": "boulic", "speed_mps": {"uniform": [-2, -2]}},
            r"classes\.1\.motion\.speed_mps: -2\.0 is not allowed",
        ),
        ({"kind": "quadruped", "gait": "hop"}, r"classes\.1\.motion\.gait: 'hop' is not allowed"),
        ({"kind": "quadruped", "froude": 9}, r"classes\.1\.motion: speed_mps.*\"froude\": 9"),
        ({"kind": "unicorn"}, r"classes\.1\.motion\.kind: 'unicorn' is not allowed: known are file, .*boulic"),
        ({"speed_mps": 1}, r"classes\.1\.motion: \{\"speed_mps\": 1\} is not allowed: needs kind"),
        ({"choice": ["boulic"]}, r"classes\.1\.motion: \"boulic\" is not allowed: needs kind"),
        ({"kind": "file"}, r"classes\.1\.motion\.path: null is not allowed"),
        (
            {"kind": "file", "path": "no.c3d"},
            r"classes\.1\.motion\.path: 'no\.c3d' is not allowed: there is no",
        ),
        (
            {"kind": "file", "path": "a.c3d", "speed": 1},
            r"classes\.1\.motion\.speed: 1 is not .*start_s.*units",
        ),
        ({"kind": "boulic", "speed_mps": {"uniform": [1]}}, r"motion\.speed_mps: uniform = \[1\]: needs two numbers"),
    ],
)
def test_a_wrong_motion_is_refused_while_planning(tmp_path, motion, says):
    (tmp_path / "a.c3d").touch()
    with pytest.raises(ConfigError, match=rf"class 'dog': example dog-000000: {says}"):
        plan_examples(with_dog_motion(motion), folder=tmp_path)


def files(tmp_path, *names):
    for name in names:
        (tmp_path / name).touch()
    return {"kind": "file", "path": {"choice": list(names)}}


def test_all_examples_of_a_recording_are_in_one_split_beside_draws_of_a_model(tmp_path):
    recorded = files(tmp_path, *(f"{n}.c3d" for n in range(6)))
    mixed = plan(
        dataset={"name": "small", "examples_per_class": 60},
        classes=[{"label": "dog", "motion": {"choice": [recorded, recorded, {"kind": "quadruped"}]}}],
    )
    examples = plan_examples(mixed, folder=tmp_path)
    splits = {}
    for e in examples:
        motion = e.run.scene.targets[0].motion
        wanted = f"file/{motion['path']}" if motion["kind"] == "file" else f"model/{e.id}"
        assert e.subject == wanted
        splits.setdefault(e.subject, set()).add(e.split)
    assert all(len(found) == 1 for found in splits.values())
    of_files = [found for subject, found in splits.items() if subject.startswith("file/")]
    assert len(of_files) == 6
    assert len(set.union(*of_files)) > 1  # recordings are not all in one split by accident
    assert {e.split for e in examples} == {"train", "validation", "test"}


def test_too_few_recordings_for_a_split_name_the_class(tmp_path):
    two = plan(classes=[{"label": "dog", "motion": files(tmp_path, "a.c3d", "b.c3d")}])
    with pytest.raises(DatasetError, match=r"class 'dog' has 2 subjects, too few .*name more recordings"):
        plan_examples(two, folder=tmp_path)


def test_a_recording_cannot_be_in_two_splits_through_two_classes(tmp_path):
    names = [f"{n}.c3d" for n in range(12)]
    classes = [
        {"label": "a", "motion": files(tmp_path, *names)},
        {"label": "b", "motion": files(tmp_path, *names[:8])},
    ]
    shared = plan(dataset={"name": "small", "examples_per_class": 80}, classes=classes)
    with pytest.raises(DatasetError, match=r"file/\d\.c3d: is in \w+ for class 'a' and in \w+ for class 'b'"):
        plan_examples(shared, folder=tmp_path)


def test_a_recording_cannot_be_two_subjects_through_two_spellings(tmp_path):
    names = [f"{n}.c3d" for n in range(8)]
    twice = {**files(tmp_path, *names), "path": {"choice": [*names, "./0.c3d"]}}
    with pytest.raises(ConfigError, match=r"'\./0\.c3d' and '0\.c3d' are the same file"):
        plan_examples(plan(classes=[{"label": "a", "motion": twice}]), folder=tmp_path)


def test_labels_that_give_the_same_ids_are_refused():
    with pytest.raises(ConfigError, match="labels must differ"):
        plan(classes=[{"label": name, "motion": {"kind": "boulic"}} for name in ("a b", "a_b")])


def test_differences_are_short_and_say_what_is_absent():
    old = {"classes": [{"label": "a"}], "seed": 1, "gone": {"x": 0}}
    new = {"classes": [{"label": "a"}, {"label": "b", "motion": {"kind": "k" * 500}}], "seed": None}
    found = list(differences(old, new))
    assert [text.partition(": ")[0] for text in found] == ["classes.1", "gone", "seed"]
    assert found[0].startswith('classes.1: absent -> {"label": "b"')
    assert found[1:] == ['gone: {"x": 0} -> absent', "seed: 1 -> null"]
    assert all(len(text) < 160 for text in found)
    assert len(shorten("x" * 500)) == 60
    assert shorten([1, 2]) == "[1, 2]"


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
    variation = {e.run.scene.targets[0].motion["stride_variation"] for e in examples}
    assert variation == {0.02}


NUISANCES = {
    "range_m": lambda e: e.run.scene.targets[0].range_m,
    "bearing_deg": lambda e: e.run.scene.targets[0].bearing_deg,
    "aspect_deg": lambda e: e.run.scene.targets[0].aspect_deg,
    "radar_height_m": lambda e: e.run.scene.radar_position_m[2],
    "rcs_total_m2": lambda e: e.run.scene.targets[0].rcs.total_m2,
    "snr_db": lambda e: e.run.noise.snr_db,
    "gate_error_m": lambda e: e.gate_error_m,
}


@pytest.fixture(scope="module")
def many_examples():
    loaded, _ = load_plan("home-alarm", overrides=["dataset.examples_per_class=1500"])
    examples = plan_examples(loaded)
    return [[e for e in examples if e.label == label] for label in ("human", "dog")]


@pytest.mark.parametrize("name", NUISANCES)
def test_a_nuisance_has_the_same_law_for_every_class(many_examples, name):
    people, dogs = ([NUISANCES[name](e) for e in of_class] for of_class in many_examples)
    assert len(set(people)) == len(set(dogs)) == 1500
    assert ks_2samp(people, dogs).pvalue > 1e-3


def test_the_comparison_of_laws_sees_a_gate_error_that_grows_with_the_class(many_examples):
    people, dogs = ([e.gate_error_m for e in of_class] for of_class in many_examples)
    assert ks_2samp(people, 2 * np.array(dogs)).pvalue < 1e-9
