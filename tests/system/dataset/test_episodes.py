"""Datasets of episodes of life: every track of every window is a row with the label of the body that it follows."""

from pathlib import Path

import numpy as np
import pytest

from doppelgait.core.errors import ConfigError
from doppelgait.dataset import build_dataset, open_dataset
from doppelgait.dataset.config import PlanConfig, load_plan
from doppelgait.dataset.feasibility import find_limits
from doppelgait.dataset.plan import collect_nuisance, plan_dataset, sample_examples
from doppelgait.dataset.resolve import resolve_example
from doppelgait.dataset.shard import build_episode, find_body
from doppelgait.dataset.verify import verify_dataset
from doppelgait.dataset.verify.leakage import refuse_leaks
from doppelgait.dataset.windows import analyze_window, cut_windows
from doppelgait.pipeline.run import simulate_placed
from doppelgait.scene import place
from doppelgait.viewer.examples import ExampleRuns

WALKER = {
    "label": "human", "motion": {"kind": "boulic", "speed_mps": {"uniform": [1.0, 1.3]}}, "enter_s": 2.0,
    "start_position_m": [0.0, 0.0], "heading_deg": 0,
    "path": {"kind": "wander", "room_m": [2.0, 7.0, -1.5, 1.5], "door_m": [7.5, 0.0], "way": {"uniform": [0, 1]}},
}  # fmt: skip
VACUUM = {
    "label": "vacuum", "motion": {"kind": "vacuum", "speed_mps": 0.4}, "background": True,
    "start_position_m": [4.5, 0.5], "heading_deg": 170,
}  # fmt: skip
EPISODES = [
    {"label": "a person comes in", "targets": [WALKER], "duration_s": 8, "should_trigger": True},
    {"label": "nobody", "targets": [], "duration_s": 3.75},
]
PLAN = {
    "dataset": {
        "name": "life", "examples_per_class": 2, "fields": ["pictures"], "fractions": {"test": 1.0},
        "window_s": 2.5, "hop_s": 1.25, "shard_size": 2,
    },
    "scene": {"radar_position_m": [0.0, 0.0, 1.5]},
    "radar": {"preset": "x4", "prf_hz": 500},
    "noise": {"kind": "thermal"},
    "episodes": EPISODES,
}  # fmt: skip


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    folder = tmp_path_factory.mktemp("episodes") / "life"
    report = build_dataset(PlanConfig(**PLAN), folder, executor="serial")
    assert (report.n_built, report.n_failed) == (4, 0)
    return open_dataset(folder)


def test_rows_are_the_tracks_of_the_windows_with_the_label_of_their_body(built):
    index = built.index
    people = index[index["label"] == "human"]
    assert set(people["scene_id"]) == {"a_person_comes_in-000000", "a_person_comes_in-000001"}
    assert (people["window_stop_s"] - people["window_start_s"] == 2.5).all()
    assert (people["window_start_s"] % 1.25 == 0).all()
    assert (people["window_stop_s"] > 2.0).all()  # nobody is there before
    assert people.groupby("scene_id")["track"].nunique().eq(1).all()
    assert people["truth_range_m"].between(1.5, 8.0).all()  # of the window
    assert people["truth_range_m"].nunique() == len(people)
    assert (people["subject"] == "model/" + people["scene_id"]).all()


def test_a_recording_without_a_track_is_one_row_that_says_so(built):
    empty = built.index[built.index["scene_id"].str.startswith("nobody")]
    assert empty["quality_flags"].tolist() == ["not_tracked"] * 2
    assert empty["label"].tolist() == ["thing"] * 2
    assert empty["truth_range_m"].isna().all()


def test_pictures_are_kept_to_the_byte(built):
    example = next(example for example in built if example.label == "human")
    plan = plan_dataset(built_plan := PlanConfig(**PLAN))
    run = plan.example(0).run
    recording = simulate_placed(run, place(run.scene, run.streams), angles=False)
    number = int(example.id.rpartition("-w")[2][:4])
    window = [*cut_windows(recording, built_plan.dataset.window_s, built_plan.dataset.hop_s)][number]
    (result,) = [one for one in analyze_window(window, run.analysis) if find_body(one, window.recording) == 0]
    assert result.pictures.shape == (1, 11, 32, 64)
    np.testing.assert_allclose(example.arrays["pictures"], result.pictures, atol=0.5 / 255)
    assert example.arrays["pictures"].max() == 1.0


def test_a_track_of_no_body_is_a_thing():
    plan = plan_dataset(PlanConfig(**PLAN | {"episodes": [EPISODES[0] | {"targets": [VACUUM]}]}))
    made = build_episode(plan.example(0), plan.config.dataset, plan.folder)
    assert {row["label"] for row in made.rows} == {"thing"}
    assert not any("not_tracked" in row["flags"] for row in made.rows)


def test_a_body_that_no_track_followed_has_a_row():
    sleeper = {"label": "human", "motion": "breathing", "start_position_m": [4.0, 0.0], "heading_deg": 0}
    plan = plan_dataset(PlanConfig(**PLAN | {"episodes": [EPISODES[0] | {"targets": [WALKER, sleeper]}]}))
    rows = build_episode(plan.example(0), plan.config.dataset, plan.folder).rows
    (missed,) = [row for row in rows if "not_tracked" in row["flags"].split(";")]
    assert (missed["label"], missed["id"], missed["motion_kind"]) == (
        "human",
        "a_person_comes_in-000000-c1",
        "breathing",
    )
    assert missed["truth_range_m"] == pytest.approx(4.0, abs=0.3)


def test_kinds_of_other_lengths_and_targets_are_no_leak():
    plan, _ = load_plan("home-alarm-day")
    examples = [*sample_examples(plan_dataset(plan))]
    refuse_leaks(examples, np.random.default_rng(0))
    assert not {"scene.duration_s", "target.rcs.total_m2"} & {*collect_nuisance(examples[0])}


def test_the_viewer_opens_a_row_as_its_window(built):
    row = next(name for name, label in zip(built.index["id"], built.index["label"], strict=True) if label == "human")
    run = ExampleRuns(built).run(row)
    assert run.reason == ""
    assert run.load().observation_s == pytest.approx(2.5)
    assert len(run.stored()) == 1


def test_the_card_and_the_feasibility_know_that_gates_are_tracks(built):
    card = (built.directory / "README.md").read_text()
    assert "analysed in windows of 2.5 s, one every 1.25 s" in card
    assert "plus a random error" not in card
    (limits,) = find_limits(plan_dataset(PlanConfig(**PLAN)).example(0), Path())
    assert "gate cut off" not in limits.limits
    assert 1.0 < limits.range_m < 9.0
    empty = [{**one, "targets": []} for one in PLAN["episodes"]]
    assert find_limits(plan_dataset(PlanConfig(**PLAN | {"episodes": empty})).example(0), Path()) == []


def test_verify_accepts_episodes(built):
    report = verify_dataset(built.directory, rng=np.random.default_rng(0))
    assert {check.name: check.status for check in report.checks if check.status == "failed"} == {}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"classes": [{"label": "a", "motion": {"kind": "boulic"}}]}, "a plan has one of them"),
        ({"episodes": []}, "a plan has one of them"),
        ({"companions": [{"label": "dog", "motion": {"kind": "boulic"}}]}, "companions: belong among the targets"),
        ({"episodes": [EPISODES[0] | {"duration_s": 3}], "dataset": PLAN["dataset"] | {"window_s": 4}}, "below"),
        ({"episodes": [EPISODES[0], EPISODES[0]]}, "labels must differ"),
        ({"episodes": [EPISODES[0] | {"label": "a/b"}]}, "may contain letters"),
        ({"dataset": PLAN["dataset"] | {"leaks": ["target.rcs"]}}, "dataset.leaks: is for"),
        ({"dataset": PLAN["dataset"] | {"hop_s": 3.0}}, "dataset.hop_s: 3 is longer"),
        ({"dataset": PLAN["dataset"] | {"fields": ["truth_range_m"]}}, "dataset.fields: truth_range_m"),
        ({"scene": {"duration_s": 4}}, "scene.duration_s: belongs in"),
        ({"noise": {"kind": "snr", "snr_db": 10}}, "noise.kind"),
    ],
)
def test_a_plan_of_episodes_that_is_impossible_is_refused(change, message):
    with pytest.raises(ConfigError, match=message):
        PlanConfig(**PLAN | change)


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"height_m": {"uniform": [7, 8]}}, "height_m"),
        ({"motion": "bolic"}, "motion"),
        ({"motion": {"speed_mps": 1.0}}, "motion"),
        ({"motion": {"kind": "file", "path": "no.bvh"}}, r"motion\.path"),
        ({"background": "false"}, "background"),
    ],
)
def test_a_fault_names_the_key_of_the_episode(change, key):
    plan = plan_dataset(PlanConfig(**PLAN | {"episodes": [EPISODES[0] | {"targets": [WALKER]}]}))
    episode = EPISODES[0] | {"targets": [WALKER | change]}
    with pytest.raises(ConfigError, match=rf"episodes\.0\.targets\.0\.{key}"):
        resolve_example(PlanConfig(**PLAN | {"episodes": [episode]}), 0, plan.folder)


@pytest.mark.parametrize("body", [WALKER | {"label": ""}, {"motion": "boulic"}, "a person"])
def test_a_body_without_label_or_table_is_refused(body):
    episode = EPISODES[0] | {"targets": {"choice": [[body]]}}
    with pytest.raises(ConfigError, match=r"episodes\.0\.targets\.0: .*needs a label"):
        resolve_example(PlanConfig(**PLAN | {"episodes": [episode]}), 0, Path())
