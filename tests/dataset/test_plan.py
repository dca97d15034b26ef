"""The plan: distributions, splits, identity, shards; nothing is simulated."""

import warnings
from typing import Literal

import numpy as np
import pandas as pd
import pytest

from checkout import ROOT
from doppelgait.core import plugins
from doppelgait.core.config import FrozenModel, validate
from doppelgait.core.draws import replace_by_middle, resolve
from doppelgait.core.errors import ConfigError, DatasetError, DoppelgaitError, DoppelgaitWarning
from doppelgait.dataset import plan as planning
from doppelgait.dataset.card import blocks_release
from doppelgait.dataset.config import DatasetSection, PlanConfig, load_plan, plan_names
from doppelgait.dataset.finish import compute_dataset_id, plan_header, plan_plugins
from doppelgait.dataset.resolve import warn_of_equal_bodies, warn_of_unused_snr
from doppelgait.dataset.verify import leakage


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


CHILD = {"height_m": {"uniform": [1.0, 1.5]}, "speed_mps": {"uniform": [0.5, 0.8], "times": "height_m"}}


@pytest.mark.parametrize("turned", [False, True], ids=["after", "before"])
def test_times_changes_no_draw_by_more_than_its_factor(turned):
    table = dict(reversed(CHILD.items())) if turned else CHILD
    alone = draw({"height_m": CHILD["height_m"], "speed_mps": {"uniform": [0.5, 0.8]}})
    together = draw(table)
    assert list(together) == list(table)
    assert together["height_m"] == alone["height_m"]
    assert together["speed_mps"] == alone["speed_mps"] * alone["height_m"]


def test_times_takes_plain_numbers_choices_cycles_and_products():
    choice = {"choice": [{"uniform": [1, 1]}, {"uniform": [2, 2], "times": "b"}]}
    table = {"a": {"cycle": [1, 2], "times": "b"}, "b": 10, "c": {"normal": [1, 0], "times": "a"}, "d": choice}
    found = [draw(table, n) for n in range(30)]
    assert found[3]["a"] == 20.0
    assert found[3]["c"] == 20.0
    assert {d["d"] for d in found} == {1.0, 20.0}


@pytest.mark.parametrize(
    ("table", "says"),
    [
        ({"v": {"uniform": [0, 1], "times": "height"}, "height_m": 1}, "k.v: times = 'height': is not a key"),
        ({"v": {"choice": [1], "times": "w"}, "w": {"choice": [1], "times": "v"}}, "k.w: times = 'v': is circular"),
        ({"v": {"uniform": [0, 1], "times": "v"}}, "is circular: v -> v"),
        ({"v": {"uniform": [0, 1], "times": "gait"}, "gait": "walk"}, "gait is 'walk', which is not a number"),
        ({"v": {"choice": ["a"], "times": "w"}, "w": 1}, "its draw is 'a', which is not a number"),
        ({"v": {"uniform": [0, 1], "times": 2}}, "k.v: times = 2: is not allowed; it must name a key of"),
        ({"uniform": [0, 1], "times": "w"}, "k: times = 'w': is not allowed"),
    ],
)
def test_wrong_factors_are_named(table, says):
    with pytest.raises(ConfigError) as refused:
        draw(table)
    assert says in str(refused.value)
    with pytest.raises(ConfigError) as refused:
        replace_by_middle(table, "k")
    assert says in str(refused.value)


def test_the_middle_of_a_product_is_the_product_of_the_middles():
    assert replace_by_middle(CHILD) == pytest.approx({"height_m": 1.25, "speed_mps": 0.65 * 1.25})


@pytest.mark.parametrize(
    ("value", "says"),
    [
        ({"uniform": [2]}, "two numbers"),
        ({"uniform": [4, 2]}, "must not exceed"),
        ({"log_uniform": [0, 1]}, "positive"),
        ({"normal": [1, -1]}, "standard deviation"),
        ({"choice": []}, "at least one"),
        ({"uniform": ["a", 1]}, "two numbers"),
        ({"choice": 3}, "choice = 3: needs a list"),
        ({"cycle": 3}, "cycle = 3: needs"),
        ({"uniform": [-1e308, 1e308]}, r"needs two numbers of 1e\+100 at most"),
        ({"uniform": [float("nan"), 1.0]}, "two numbers"),
        ({"log_uniform": [1.0, float("inf")]}, "two numbers"),
        ({"normal": [1e308, 1e308]}, "two numbers"),
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


def examples_of(config, folder=None):
    laid_out = planning.plan_dataset(config, folder=folder)
    return [laid_out.example(n) for n in range(len(laid_out.examples))]


def test_every_example_is_resolved_and_its_subject_is_in_one_split():
    examples = examples_of(plan())
    assert len(examples) == 40
    assert len({e.id for e in examples}) == 40
    assert len({e.run.example for e in examples}) == 40
    speeds = [e.run.scene.targets[0].motion["speed_mps"] for e in examples if e.label == "human"]
    assert len(set(speeds)) == 20
    assert examples_of(plan()) == examples
    other = plan(dataset={"name": "small", "examples_per_class": 20, "seed": 7})
    assert examples_of(other)[0].run.scene != examples[0].run.scene
    by_subject = {}
    for e in examples:
        by_subject.setdefault(e.group, set()).add(e.split)
    assert all(len(splits) == 1 for splits in by_subject.values())
    for label in ("human", "dog"):
        splits = [e.split for e in examples if e.label == label]
        assert [splits.count(s) for s in ("train", "validation", "test")] == [14, 3, 3]


def test_identity_follows_the_configuration_and_the_motion_files_only(tmp_path):
    assert compute_dataset_id(plan(), tmp_path) == compute_dataset_id(plan(), tmp_path / "elsewhere")
    assert compute_dataset_id(plan(noise={"kind": "none"}), tmp_path) != compute_dataset_id(plan(), tmp_path)
    of_files = plan(classes=[{"label": "a", "motion": files(tmp_path, "one.c3d", "two.c3d")}])
    before = compute_dataset_id(of_files, tmp_path)
    (tmp_path / "two.c3d").write_bytes(b"3")
    assert compute_dataset_id(of_files, tmp_path) != before
    (tmp_path / "two.c3d").unlink()
    with pytest.raises(ConfigError, match=r"two\.c3d: cannot be read"):
        compute_dataset_id(of_files, tmp_path)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"target": {"label": "human"}}, "belongs in"),
        ({"scene": {"gravity": 1}}, r"scene.gravity: unknown key; allowed are .*duration_s"),
        ({"noise": {"kind": "loud"}}, "noise.kind"),
        ({"analysis": {"hops": 1}}, "analysis.hops"),
        ({"target": {"range_m": -1}}, ": target.range_m: -1"),
        ({"target": {"range_mm": 3}}, ": target.range_mm: unknown key"),
        ({"companions": [{"label": "a", "motion": {"kind": "boulic"}, "range_mm": 3}]}, ": companions: range_mm: unkn"),
        ({"background": [{"motion": {"kind": "fan"}, "range_mm": 3}]}, ": background: range_mm: unknown key"),
        ({"typo": 1}, "typo.*unknown key"),
        ({"classes": [{"label": name, "motion": {"kind": "boulic"}} for name in ("a b", "a_b")]}, "labels must differ"),
        ({"dataset": {"name": "x", "examples_per_class": 4, "fractions": {"test": 0.6}}}, "fractions.*sum to 1"),
    ],
)
def test_wrong_plans_are_refused_with_the_key(changes, says):
    with pytest.raises(ConfigError, match=says):
        examples_of(plan(**changes))


def test_an_snr_is_unused_with_thermal_noise_and_warned_of():
    """``--set noise.kind=thermal`` cannot remove the key, and older datasets have both."""
    thermal = plan(noise={"kind": "thermal", "snr_db": {"uniform": [3.0, 9.0]}})
    assert {example.run.noise.kind for example in examples_of(thermal)} == {"thermal"}
    with pytest.warns(DoppelgaitWarning, match=r"noise.snr_db: is not used with noise.kind = 'thermal'"):
        warn_of_unused_snr(thermal.noise)
    warn_of_unused_snr({"kind": "snr", "snr_db": 3.0})
    warn_of_unused_snr({"kind": {"choice": ["snr", "thermal"]}, "snr_db": 3.0})
    warn_of_unused_snr({"kind": "thermal"})


@pytest.mark.parametrize(
    "changes",
    [
        {"target": {"key" + "y" * 100_000: 1}},
        {"dataset": {"name": "x" * 100_000, "examples_per_class": 4}},
        {"target": {f"key{number}": 1 for number in range(5000)}},
    ],
    ids=range(3),
)
def test_messages_are_short_however_long_the_names_are(changes):
    with pytest.raises(DoppelgaitError) as refused:
        examples_of(plan(**changes))
    assert len(str(refused.value)) <= 2000


@pytest.mark.parametrize("wrap", [lambda value: value, lambda value: {"choice": [value]}], ids=["plain", "drawn"])
def test_leaks_are_refused_however_they_are_written(wrap):
    with pytest.raises(ConfigError, match="'auto' is not allowed in a dataset: it reveals the speed"):
        examples_of(plan(radar={"preset": "x4", "prf_hz": wrap("auto")}))
    with pytest.raises(ConfigError, match="'liland2018' is not allowed in a dataset: its gate"):
        examples_of(plan(analysis={"method": wrap("liland2018")}))


def test_only_a_plan_that_names_its_leaks_may_have_them():
    def set_by_class(leaks):
        dog = {"label": "dog", "motion": {"kind": "quadruped"}, "target": {"rcs": {"total_m2": 0.2}}}
        return plan(
            classes=[{"label": "human", "motion": {"kind": "boulic"}}, dog], radar={"preset": "x4", "prf_hz": "auto"},
            target={"rcs": {"kind": "equal", "total_m2": 1.0}, "range_m": 5.0},
            dataset={"name": "x", "examples_per_class": 60, "leaks": leaks},
        )  # fmt: skip

    with pytest.raises(ConfigError, match=r"classes\.1\.target\.rcs: is not allowed, because it reveals the class"):
        set_by_class(["radar.prf_hz"])
    with pytest.raises(ConfigError, match="'auto' is not allowed in a dataset"):
        set_by_class(["target.rcs"])
    with pytest.raises(ConfigError, match=r"leaks\.0: 'target\.label' .*must be 'target\.rcs', .*radar\.prf_hz"):
        set_by_class(["target.label"])
    config = set_by_class(["target.rcs", "radar.prf_hz"])
    examples = examples_of(config)
    assert {(e.label, e.run.scene.targets[0].rcs.total_m2) for e in examples} == {("human", 1.0), ("dog", 0.2)}
    assert {e.run.scene.targets[0].range_m for e in examples} == {5.0}
    with pytest.raises(DatasetError, match=r"target\.rcs"):
        leakage.refuse_leaks(examples, np.random.default_rng(0))
    leakage.refuse_leaks(examples, np.random.default_rng(0), leaks=config.dataset.leaks)


@pytest.mark.parametrize(
    ("motion", "says"),
    [
        ({"kind": "boulic", "speed": {"uniform": [1.5, 1.5]}}, r"\.speed: unknown key.*1\.5"),
        ({"kind": "boulic", "speed_mps": {"uniform": [-2, -2]}}, r"\.speed_mps: -2\.0 is not allowed"),
        ({"kind": "quadruped", "gait": "hop"}, r"\.gait: 'hop' is not allowed"),
        ({"kind": "quadruped", "froude": 9}, r"\.froude: 9 is not allowed: .*set gait = \"auto\""),
        ({"kind": "quadruped", "gait": "auto", "froude": 99}, r"\.froude: 99 is not allowed: [^;]*$"),
        ({"kind": "boulic", "speed_mps": {"unifrom": [2, 1]}}, r"\.speed_mps: 'unifrom' is no .*did you mean uniform"),
        ({"kind": "boulic", "speed_mps": CHILD["speed_mps"]}, r"\.speed_mps: times = 'height_m'"),
        ({"kind": "unicorn"}, r"\.kind: 'unicorn' is not allowed: known are file, .*boulic"),
        ({"speed_mps": 1}, r": \{\"speed_mps\": 1\} is not allowed: needs kind"),
        ({"choice": ["boulic"]}, r": \"boulic\" is not allowed: needs kind"),
        ({"kind": "file"}, r"\.path: null is not allowed"),
        ({"kind": "file", "path": "no.c3d"}, r"\.path: 'no\.c3d' is not allowed: there is no"),
        ({"kind": "file", "path": "a.c3d", "speed": 1}, r"\.speed: 1 is not .*start_s.*units"),
        ({"kind": "boulic", "speed_mps": {"uniform": [1]}}, r"\.speed_mps: uniform = \[1\]: needs two"),
    ],
)
def test_a_wrong_motion_is_refused_while_planning(tmp_path, motion, says):
    (tmp_path / "a.c3d").touch()
    classes = [{"label": "human", "motion": {"kind": "boulic"}}, {"label": "dog", "motion": motion}]
    with pytest.raises(ConfigError, match=rf"class 'dog': example dog-000000: classes\.1\.motion{says}"):
        examples_of(plan(classes=classes), folder=tmp_path)


def files(tmp_path, *names):
    for name in names:
        (tmp_path / name).write_text(name)
    return {"kind": "file", "path": {"choice": list(names)}}


def test_a_recording_cannot_be_two_subjects_through_two_spellings(tmp_path):
    names = [f"{n}.c3d" for n in range(8)]
    twice = {**files(tmp_path, *names), "path": {"choice": [*names, "./0.c3d"]}}
    with pytest.raises(ConfigError, match=r"'\./0\.c3d' and '0\.c3d' are the same file"):
        examples_of(plan(classes=[{"label": "a", "motion": twice}]), folder=tmp_path)


def test_built_in_plans_load_and_an_unknown_name_lists_them(tmp_path):
    assert "home-alarm" in plan_names()
    loaded, _ = load_plan("home-alarm")
    assert loaded.dataset.name == "home-alarm"
    for name in (tmp_path / "nothing.toml", "x" * 300, "x\0"):
        with pytest.raises(ConfigError, match="neither a file nor a built-in plan; built-in plans are: home-alarm"):
            load_plan(name)


STRIDE_SETTINGS = {
    "human": ("pace_sd", "step_time_sd", "step_length_sd", "time_asymmetry", "length_asymmetry"),
    "quadruped": ("pace_sd", "stride_variation", "step_length_sd", "asymmetry", "length_asymmetry"),
    "boulic": ("pace_sd", "stride_variation"),
    "crawl": ("pace_sd", "stride_variation"),
}
"""Settings of the variation and asymmetry of strides, in one order; the same number moves a dog more than a person."""


LIMP = "{'uniform': [-0.4, 0.4]}"
"""Unequal lengths of one of the slow people and dogs."""


@pytest.mark.parametrize("plan", ["home-alarm", "home-alarm-wide", str(ROOT / "studies/plans/evidence.toml")])
def test_settings_of_uneven_strides_have_the_same_laws_for_people_and_dogs(plan):
    laws: dict[str, list[list[str]]] = {}
    for part in load_plan(plan)[0].classes:
        for motion in part.motion["choice"]:
            laws.setdefault(motion["kind"], []).append([str(motion[name]) for name in STRIDE_SETTINGS[motion["kind"]]])
    assert laws.keys() == STRIDE_SETTINGS.keys()
    people, dogs = laws.pop("human"), laws.pop("quadruped")
    assert {*map(tuple, people)} == {*map(tuple, dogs)}
    assert sum(law[4] == LIMP for law in people) == sum(law[4] == LIMP for law in dogs) == 1
    assert all(law == dogs[0][: len(law)] for kind in laws.values() for law in kind)


def section(**changes):
    return validate(DatasetSection, {"name": "x", "examples_per_class": 2, **changes}, where="dataset")


def subjects(count):
    return [f"model/{n}" for n in range(count)]


def test_a_stable_split_moves_nobody_when_subjects_are_added_and_keeps_the_shares():
    stable = section(split={"strategy": "stable"})
    before, after = (planning.assign_splits(stable, {"dog": subjects(count)}) for count in (400, 1000))
    assert all(after[name] == split for name, split in before.items())
    share = sum(split == "train" for split in after.values()) / len(after)
    assert share == pytest.approx(0.7, abs=4 * (0.7 * 0.3 / 1000) ** 0.5)
    ranked = [planning.assign_splits(section(), {"dog": subjects(count)}) for count in (400, 1000)]
    assert any(ranked[1][name] != split for name, split in ranked[0].items())  # exact shares cost that


def test_subjects_by_hand_and_one_source_left_out():
    names = [*subjects(40), "person/cmu-07", "person/cmu-08", "file/rex.bvh"]
    by_hand = section(split={"subjects": {"test": ["cmu-*"], "train": ["rex.bvh"]}})
    splits = planning.assign_splits(by_hand, {"a": names})
    assert [splits[name] for name in names[-3:]] == ["test", "test", "train"]
    left_out = section(fractions={"train": 0.8, "validation": 0.2}, split={"sources": {"recording": "test"}})
    splits = planning.assign_splits(left_out, {"a": names})
    assert {splits[name] for name in names[-3:]} == {"test"}
    assert "test" not in {splits[name] for name in names[:-3]}
    with pytest.raises(DatasetError, match=r"'b' has 40 subjects.*none is in test"):
        planning.assign_splits(left_out, {"a": names, "b": subjects(40)})


def test_a_leaky_split_is_refused_and_names_the_groups():
    torn = section(split={"subjects": {"test": ["cmu-*"], "train": ["cmu-07"]}})
    with pytest.raises(DatasetError, match=r"in two splits person/cmu-07: test and train"):
        planning.assign_splits(torn, {"a": ["person/cmu-07", "person/cmu-08", *subjects(20)]})
    with pytest.raises(DatasetError, match=r"'rex' fits no subject; there are model/0, model/1"):
        planning.assign_splits(section(split={"subjects": {"test": ["rex"]}}), {"a": subjects(20)})


def test_sources_say_who_is_in_a_recording_and_on_what_terms(tmp_path):
    motion = files(tmp_path, *(f"cmu_{who:02d}_{take}.c3d" for who in range(8) for take in "ab"))
    whose = plan(
        dataset={"name": "small", "examples_per_class": 60},
        classes=[{"label": "human", "motion": motion}],
        sources=[{"files": "cmu*", "subject": r"cmu_(\d+)_", "licence": "CC-BY-NC-4.0", "citation": "X"}],
    )
    rows = [example.rows[0] for example in examples_of(whose, folder=tmp_path)]
    assert {(row.subject, row.licence) for row in rows} == {(f"person/{n:02d}", "CC-BY-NC-4.0") for n in range(8)}
    wrong = plan(classes=whose.model_dump()["classes"], sources=[{"files": "*", "subject": "dog_(.)"}])
    with pytest.raises(ConfigError, match=r"sources\.0\.subject: 'dog_\(\.\)' finds no subject in 'cmu_"):
        planning.plan_dataset(wrong, folder=tmp_path)
    with pytest.raises(ConfigError, match="needs a group in round brackets"):
        plan(sources=[{"files": "*", "subject": "cmu"}])


COMPANION = {"label": "dog", "motion": {"kind": "quadruped"}, "range_m": 4.0}


def test_companions_are_rows_of_their_own_in_the_split_of_their_scene():
    with_dog = plan(companions=[{"choice": [COMPANION, {}]}])
    examples = examples_of(with_dog)
    counts = [len(e.rows) for e in examples]
    assert 5 < counts.count(2) < 35
    pair = next(e for e in examples if len(e.rows) == 2)
    assert [row.id for row in pair.rows] == [pair.id, f"{pair.id}-c1"]
    assert [t.label for t in pair.run.scene.targets] == [row.label for row in pair.rows]
    laid_out = planning.plan_dataset(with_dog)
    assert all(len(entry.subjects) == len(e.rows) for entry, e in zip(laid_out.examples, examples, strict=True))
    with pytest.raises(ConfigError, match=r"companions\.0: .* is not allowed: needs label and motion"):
        planning.plan_dataset(plan(companions=[{"label": "dog"}]))


def test_nobody_is_a_class_with_a_gate_and_without_an_echo_or_a_companion():
    empty = plan(
        target={"range_m": {"uniform": [4, 6]}},
        companions=[{"label": "dog", "motion": {"kind": "quadruped"}}],
        classes=[{"label": "human", "motion": {"kind": "boulic"}}, {"label": "empty", "motion": "none"}],
        noise={"kind": "thermal"},
    )
    examples = examples_of(empty)
    pairs, found = ([e for e in examples if e.label == label] for label in ("human", "empty"))
    assert {e.rows[0].source for e in found} == {"none"}
    assert {len(e.rows) for e in found} == {1}
    speeds = [e.run.scene.targets[0].motion["speed_mps"] for e in found]
    assert 0.4 <= min(speeds) < 0.8 < 1.6 < max(speeds) <= 2.0
    assert all(e.run.scene.targets[0].rcs.total_m2 < 1e-20 for e in found)
    ranges_m = [[target.range_m for target in e.run.scene.targets] for e in pairs]  # drawn from one law, apart
    assert all(4 <= mine <= 6 and 4 <= its <= 6 and mine != its for mine, its in ranges_m)
    with pytest.raises(ConfigError, match=r"noise\.kind: \"snr\" is not allowed with motion = 'none'"):
        plan(classes=[{"label": "empty", "motion": "none"}], noise={"kind": "snr"})


@pytest.mark.parametrize(
    ("field", "says"),
    [
        ({"name": "signature", "dtype": "tiny"}, "dtype"),
        ({"name": "baseband", "dtype": "half"}, "'half' is not allowed for baseband"),
        ({"name": "baseband", "hop": 2}, "would alias"),
        ({"name": "cadence_map", "hop": 2}, "no columns in time"),
        ("range", "name"),
        *((field, "fields") for field in (3, None, [], {"name": []}, {"name": {}})),
    ],
)
def test_wrong_fields_are_refused(field, says):
    with pytest.raises(ConfigError, match=says):
        section(fields=[field])
    with pytest.raises(ConfigError, match="names a field twice"):
        section(fields=["signature", {"name": "signature"}])


def test_a_tiny_plan_with_the_default_seed_is_not_refused_by_chance():
    """The gate errors of this plan happen to differ by class: balanced accuracy 0.83 with p = 0.0008."""
    config = plan(dataset={"name": "x", "examples_per_class": 20}, target={"range_m": {"uniform": [3, 6]}})
    assert config.dataset.seed == 2018
    sampled = examples_of(config)
    leakage.refuse_leaks(sampled, np.random.default_rng(0))
    errors_m = pd.DataFrame([{"label": e.label, "group": e.group, "gate_error_m": e.gate_error_m} for e in sampled])
    found = leakage.guess_classes(errors_m, np.random.default_rng(0))
    assert found.accuracy > 0.75
    assert not found.leaks


def test_a_leak_is_refused_or_a_warning_of_the_build_without_the_gate_error():
    near = {"label": "human", "motion": {"kind": "boulic"}, "range_m": {"uniform": [2.5, 3]}}
    leaky, honest = (
        examples_of(plan(target={"range_m": {"uniform": [4, 6]}, "rcs": {"total_m2": 0.5}}, companions=companions))
        for companions in ([near], [])
    )
    with pytest.raises(DatasetError, match=r"target\.range_m") as refused:
        leakage.refuse_leaks(leaky, np.random.default_rng(0))
    assert "gate_error_m" not in str(refused.value)
    with pytest.warns(DoppelgaitWarning, match=r"target\.range_m.*trained on it"):
        leakage.warn_of_leaks(leaky, np.random.default_rng(0))
    leakage.warn_of_leaks(honest, np.random.default_rng(0))


def test_cross_sections_by_body_mass_are_a_warning_that_names_the_key(tmp_path):
    def warned(rcs, leaks=()):
        config = plan(
            dataset={"name": "x", "examples_per_class": 20, "leaks": list(leaks)},
            target={"range_m": {"uniform": [3, 6]}, **rcs},
        )
        with warnings.catch_warnings(record=True) as seen:
            warnings.simplefilter("always")
            leakage.warn_of_default_rcs(examples_of(config), np.random.default_rng(0), folder=tmp_path, leaks=leaks)
        return [str(w.message) for w in seen]

    (message,) = warned({})
    assert "rcs_total_m2 (dog 0." in message
    assert "set [target] rcs = " in message
    assert "'target.rcs' in dataset.leaks" in message
    assert len(warned({"rcs": {"fluctuation": "swerling1"}})) == 1
    assert not warned({"rcs": {"total_m2": {"log_uniform": [0.1, 1.6]}}})
    rare = plan(
        dataset={"name": "x", "examples_per_class": 300},
        classes=[
            {"label": "human", "motion": {"kind": "boulic", "speed_mps": {"uniform": [0.8, 1.4]}}},
            {"label": "dog", "motion": {"kind": "quadruped"}, "examples": 12},
        ],
    )
    with pytest.warns(DoppelgaitWarning, match="rcs_total_m2"):
        leakage.warn_of_default_rcs(examples_of(rare), np.random.default_rng(0), folder=tmp_path)
    assert not warned({}, leaks=["target.rcs"])


def test_equal_bodies_of_a_class_are_a_warning_that_names_it():
    alike = {"label": "human", "motion": {"kind": "boulic"}}
    with pytest.warns(DoppelgaitWarning, match=r"class human: every example has the same motion parameters"):
        warn_of_equal_bodies(examples_of(plan(classes=[alike])))
    sampled = {"label": "human", "motion": {"kind": "boulic", "speed_mps": {"uniform": [0.8, 1.6]}}}
    warn_of_equal_bodies(examples_of(plan(classes=[sampled, {"label": "empty", "motion": "none"}], noise={})))
    for target in ({"height_m": {"uniform": [1.0, 1.4]}}, {"vary": {"pace": {"uniform": [0.9, 1.1]}}}):
        warn_of_equal_bodies(examples_of(plan(classes=[alike], target=target)))


def test_copies_of_a_file_are_one_subject_or_refused(tmp_path):
    motion = files(tmp_path, *(f"{n}.c3d" for n in range(8)))
    (tmp_path / "1.c3d").write_text("0.c3d")
    section = {"dataset": {"name": "x", "examples_per_class": 60}, "classes": [{"label": "a", "motion": motion}]}
    for sources in ([], [{"files": "[01].c3d", "subject": "(.)"}]):
        with pytest.raises(ConfigError, match=r"motion files '0\.c3d' and '1\.c3d' have the same content"):
            planning.plan_dataset(plan(**section, sources=sources), folder=tmp_path)
    same = [{"files": "[01].c3d", "subject": "([.]c3d)"}]
    planning.plan_dataset(plan(**section, sources=same), folder=tmp_path)


FREE = ["CC0-1.0", "CC-BY-4.0", "CC BY 4.0", "cc-by-sa-4.0", "MIT", "Apache-2.0", "own", "MIT AND CC-BY-4.0"]
BLOCKED = ["", "unknown", "CC-BY-NC-4.0", "CC BY-ND 4.0", "proprietary", "research use only", "none found", "TODO"]


@pytest.mark.parametrize("licence", [*FREE, *BLOCKED, "MIT AND CC-BY-NC-4.0"])
def test_licences_that_do_not_allow_a_release_block_it(licence):
    assert blocks_release(licence) == (licence not in FREE)


class Ripple(FrozenModel):
    kind: Literal["ripple"] = "ripple"
    depth: float = 0.5


def foreign(monkeypatch, group, name, run=None, *, version="1", parameters=None, **facts):
    """Register a plug-in as if it came with another package, one that is installed."""
    item = plugins.Plugin(group, name, run, parameters, version, "numpy", facts)
    monkeypatch.setitem(plugins._REGISTERED, group, {**plugins._REGISTERED.get(group, {}), name: item})


def test_plugins_of_other_packages_are_part_of_the_identity_where_they_are_used(tmp_path, monkeypatch):
    used = plan(impairments={"choice": [[], [{"kind": "ripple"}]]})
    plain, before = compute_dataset_id(plan(), tmp_path), compute_dataset_id(used, tmp_path)
    foreign(monkeypatch, "impairment", "ripple", parameters=Ripple)
    assert compute_dataset_id(plan(), tmp_path) == plain
    first = compute_dataset_id(used, tmp_path)
    assert first != before
    (found,) = plan_plugins(used, tmp_path)
    assert found["parameters"] == {"kind": "'ripple'", "depth": "0.5"}
    assert {key: found[key] for key in ("group", "name", "version", "package", "release")} == {
        "group": "impairment", "name": "ripple", "version": "1", "package": "numpy", "release": np.__version__
    }  # fmt: skip
    assert plan_header(used, first, tmp_path).describe({}, complete=False)["plugins"] == [found]
    assert "plugins" not in plan_header(plan(), plain, tmp_path).describe({}, complete=False)
    foreign(monkeypatch, "impairment", "ripple", parameters=Ripple, version="2")
    assert compute_dataset_id(used, tmp_path) not in (first, before)


def test_features_and_readers_of_other_packages_are_used_unasked(tmp_path, monkeypatch):
    (tmp_path / "a.odd").write_text("odd 1")
    files = plan(classes=[{"label": "a", "motion": {"kind": "file", "path": "a.odd"}}])
    plain, before = compute_dataset_id(plan(), tmp_path), compute_dataset_id(files, tmp_path)
    foreign(monkeypatch, "motion_reader", "odd", sniff=lambda path, head: head.startswith(b"odd"))
    assert compute_dataset_id(plan(), tmp_path) == plain
    assert compute_dataset_id(files, tmp_path) != before
    (tmp_path / "a.odd").write_text("even")
    assert plan_plugins(files, tmp_path) == []
    foreign(monkeypatch, "feature", "ripple_rate")
    assert [item["name"] for item in plan_plugins(plan(), tmp_path)] == ["ripple_rate"]
