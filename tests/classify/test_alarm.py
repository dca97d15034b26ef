"""Alarm metrics of a day: closed forms of intervals, triggers counted by hand, a day that runs."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from scipy.stats import chi2

from doppelgait.classify import alarm, classify_over_time, evaluation, load_shipped_model
from doppelgait.classify.data import Rows, list_windows, mark_shared
from doppelgait.classify.learned import Seen
from doppelgait.classify.timeline import follow_rows
from doppelgait.core.errors import ConfigError
from doppelgait.dataset import build_dataset, open_dataset
from doppelgait.dataset.config import PlanConfig
from doppelgait.dataset.resolve import resolve_example
from doppelgait.pipeline.run import simulate_placed
from doppelgait.scene.placement import place


@pytest.mark.parametrize("count", [0, 1, 3, 20])
def test_the_interval_of_one_count_is_that_of_poisson(count):
    counts = [1] * count + [0] * 5
    found = alarm.estimate_weighted_count(counts, [0.5] * len(counts))
    low = 0.0 if count == 0 else chi2.ppf(0.025, 2 * count) / 2
    assert found == pytest.approx(
        {"value": 0.5 * count, "low": 0.5 * low, "high": 0.5 * chi2.isf(0.025, 2 * count + 2) / 2}
    )


@pytest.mark.parametrize("cluster", [1, 4])
def test_the_interval_of_weighted_counts_holds_the_truth(cluster):
    # 20 recordings of each of three kinds; those that trigger do so once, or four times
    rng, shares, weights = np.random.default_rng(0), np.repeat([0.1, 0.03, 0.3], 20), np.repeat([1.0, 4.0, 0.3], 20)
    spans = [alarm.estimate_weighted_count(cluster * (rng.random(60) < shares), weights) for _ in range(2000)]
    inside = np.mean([span["low"] <= cluster * shares @ weights <= span["high"] for span in spans])
    assert 0.94 <= inside <= 0.999  # conservative, as the paper says
    assert alarm.estimate_weighted_count([], []) == {"value": 0.0, "low": 0.0, "high": np.inf}


def a_model(**facts):
    model = SimpleNamespace(facts=SimpleNamespace(**facts))
    model.of_tracks = model
    return model


@pytest.mark.release
def test_triggers_at_the_models_threshold_are_the_rises_of_the_alarm_of_a_stream(tmp_path):
    (day, folder), model = alarm.load_day(repeats=2), load_shipped_model("x4")
    chosen = tuple(one for one in day.episodes if one.label == "a person and a dog cross the room")
    dataset = alarm.build_day(day.model_copy(update={"episodes": chosen}), model, tmp_path / "day", folder=folder)
    assert mark_shared(dataset.index).any()
    human = model.of_tracks.facts.classes.index("human")
    answers = alarm.answer_day(dataset, follow_rows(dataset, model)[:, human])
    triggers = alarm.find_triggers(answers, model.of_tracks.facts.alarm_threshold)
    for number, scene in enumerate(answers["scene"].unique()):
        run, raised = resolve_example(dataset.plan_config, number, folder).run, {}
        recording = simulate_placed(run, place(run.scene, run.streams, folder=folder), angles=False)
        for one in classify_over_time(recording, model):
            if one.alarm:
                raised.setdefault(one.track, one.stop_s)
        assert sorted(raised.values()) == sorted(triggers.loc[triggers["scene"] == scene, "stop_s"])


def test_a_classifier_from_outside_is_scored_by_its_answers_to_tracks(tmp_path):
    # ten lines: the louder the track, the likelier a person; every second window is no evidence
    def by_level(dataset):
        snr_db = dataset.index["quality_snr_mu_db"].to_numpy(dtype=float)
        return np.where(np.arange(snr_db.size) % 2, np.nan, 1.0 / (1.0 + np.exp(-snr_db)))

    target = {"label": "human", "range_m": 5.0, "motion": {"kind": "boulic", "speed_mps": 1.0}}
    entry = {"label": "comes in", "should_trigger": True, "hours_per_day": 1, "duration_s": 4.0, "targets": [target]}
    empty = {"label": "no one", "hours_per_day": 1, "duration_s": 4.0, "targets": []}
    dataset = {"name": "d", "examples_per_class": 1, "fractions": {"test": 1.0}}
    plan = {"dataset": dataset, "noise": {"kind": "thermal"}, "episodes": [entry, empty]}
    build_dataset(PlanConfig.model_validate(plan), tmp_path / "d", executor="serial")
    dataset = open_dataset(tmp_path / "d")
    answers = alarm.answer_day(dataset, by_level(dataset)).sort_values("stop_s")
    assert answers.groupby("label")["score"].max()["no one"] == -np.inf
    times_s, scores = answers.loc[np.isfinite(answers["score"]), ["stop_s", "score"]].to_numpy().T
    assert (np.diff(times_s) > 1.0).all()
    assert scores[0] == 0.0  # one window alone raises no alarm
    assert (scores[1:] > 0.5).all()


def test_a_track_raises_its_alarm_once_and_keeps_it():
    table = {"stop_s": [*np.arange(6.0), 1.0], "score": [0.9, 0.9, 0.2, 0.8, 0.1, 0.9, 0.8]}
    one = pd.DataFrame(table).assign(scene="x", track=[0] * 6 + [1])
    assert alarm.find_triggers(one, 0.8)["stop_s"].tolist() == [0, 1]
    assert alarm.find_triggers(one, 0.95).empty


def test_two_windows_in_succession_confirm_an_alarm():
    probability, stops_s = np.array([0.9, 0.8, 0.2, np.nan, 0.9, 0.7]), [3.0, 1.0, 2.0, 2.5, 4.0, 1.0]
    seen = [Seen(None, track, stop_s) for track, stop_s in zip([0, 0, 0, 0, 0, 1], stops_s, strict=True)]
    assert alarm.confirm(probability, seen).tolist() == [0.2, 0.0, 0.2, 0.0, 0.9, 0.0]
    # what a shared gate shows confirms no window of the track alone
    shared = [Seen(None, 0, float(n), n in (1, 2)) for n in range(5)]
    assert alarm.confirm(np.array([0.1, 0.8, 0.9, 0.7, 0.6]), shared).tolist() == [0.0, 0.1, 0.8, 0.1, 0.6]


def test_a_shared_gate_shows_a_person_if_one_of_both_is():
    names = ("window_start_s", "track", "label", "quality_flags", "quality_track_range_m")
    shared = "low_confidence;gates_overlap"
    rows = [
        (0.0, 0, 0, "gates_overlap", 2.0), (0.0, 1, 1, shared, 2.2), (0.0, 2, 1, shared, 5.0), (0.0, 3, 1, shared, 5.3),
        (1.0, 0, 0, "low_confidence", 2.0), (1.0, 1, 1, shared, 2.2),
    ]  # fmt: skip
    index = pd.DataFrame(rows, columns=names).assign(scene_id="s", window_stop_s=2.5)
    labels, nothing = index["label"].to_numpy(), np.zeros(len(index), dtype=np.int64)
    seen = list_windows(Rows((), index, nothing, nothing, ("human", "animal"), labels, np.array(["s"] * 6)))
    assert [one.shared for one in seen] == [True, True, True, True, False, True]
    assert [one.shown for one in seen] == [0, 0, -1, -1, -1, -1]


def test_rates_by_hand():
    episodes = [
        {"label": "entry", "should_trigger": True, "hours_per_day": 1, "duration_s": 10, "targets": []},
        {"label": "dog", "animals": 2, "hours_per_day": 6, "duration_s": 18, "targets": []},
        {"label": "fan", "hours_per_day": 3, "duration_s": 18, "targets": []},
    ]
    day = PlanConfig(dataset={"name": "d", "examples_per_class": 2}, episodes=tuple(episodes))
    kinds = [("entry", 0.9), ("entry", 0.0), ("dog", 0.9), ("dog", 0.0), ("fan", 0.9), ("fan", 0.9)]
    rows = [(str(n), label, 3.0 + k, k * score) for n, (label, score) in enumerate(kinds) for k in (0, 1)]
    made = pd.DataFrame(rows, columns=("scene", "label", "stop_s", "score")).assign(track=0)
    model = a_model(alarm="human", alarm_threshold=0.6)
    found = alarm.score_day(day, made, model)
    own = next(one for one in found["thresholds"] if one["model"])
    # 36 s of each kind: 1 of the dog is 100 an hour, of which 6 h; 2 of the fan 200 an hour, of which 3 h
    assert own["false_per_day"]["value"] == pytest.approx(100 * 6 + 200 * 3)
    assert own["false_per_animal_hour"]["value"] == pytest.approx(100 * 6 / 12)
    assert (own["entries"], own["missed"], own["seconds_to_detect"]) == (2, 1, [4.0, None])
    at_once = next(one for one in found["thresholds"] if one["threshold"] == 0.99)
    assert at_once["false_per_day"]["value"] == 0
    assert at_once["seconds_to_detect"] == [None, None]
    assert [row["threshold"] for row in alarm.format_day(found)][1] == "0.6 (the model's)"
    assert alarm.format_episodes(found)[2] == {
        "episode": "fan", "should trigger": "no", "recordings": "2", "at 0.5": "2", "at 0.6": "2", "at 0.8": "2",
        "at 0.9": "2", "at 0.95": "0", "at 0.99": "0", "at 0.999": "0", "at 0.9999": "0",
    }  # fmt: skip


def test_every_scene_of_the_built_in_day_can_be_drawn():
    day, folder = alarm.load_day(repeats=3)
    for number in range(3 * len(day.episodes)):
        run, section = resolve_example(day, number, folder).run, day.episodes[number // 3]
        kinds = [type(effect).__name__ for effect in run.environment]
        assert kinds == ["GroundBounce", *(["Screen"] if "behind a sofa" in section.label else [])]
        assert run.scene.duration_s == section.duration_s
    assert 20 <= sum(section.hours_per_day for section in day.episodes) <= 48  # some go on at the same time
    assert sum(section.should_trigger for section in day.episodes) == 4


def test_a_person_triggers_and_a_fan_does_not():
    day, model = alarm.load_day(repeats=1)[0], load_shipped_model("x4")
    durations_s = {"a person comes in and goes again": 14.0, "fan": 20.0}
    episodes = [one for one in day.episodes if one.label in durations_s]
    chosen = tuple(one.model_copy(update={"duration_s": durations_s[one.label]}) for one in episodes)
    day = day.model_copy(update={"episodes": chosen})
    own = next(one for one in alarm.score_alarm(model, day=day)["thresholds"] if one["model"])
    assert own["missed"] == 0
    assert own["false_per_day"]["value"] == 0
    assert 0 < own["seconds_to_detect"][0] < 14


def test_a_model_without_an_alarm_is_told():
    model = a_model(alarm=None, dataset_name="garden", classes=("cat", "dog"))
    with pytest.raises(ConfigError, match="model garden: has no alarm; train with --alarm-class"):
        alarm.score_alarm(model)
    with pytest.raises(ConfigError, match=r"--day home-alarm-day: carrier_hz 7\.29e\+09 is outside"):
        alarm.score_alarm(load_shipped_model("fmcw-60"))
    with pytest.raises(ConfigError, match="home-alarm: is a plan of classes; a day of an alarm needs"):
        alarm.load_day("home-alarm")
    with pytest.raises(ConfigError, match="neither a file nor a built-in plan"):
        alarm.load_day("")
    with pytest.raises(ConfigError, match="--repeats 0: must be 1 or more"):
        alarm.score_alarm(model, repeats=0)


def test_the_threshold_of_tracks_bounds_false_alarms_too():
    people, pets = np.linspace(0.65, 0.999, 100), np.linspace(0.0, 0.7, 1000)
    probability = np.repeat(np.concatenate([people, pets, [0.95]]), 2)  # a pet beside a person rings at 0.95
    groups = np.repeat([*(f"p{n}" for n in range(100)), *(f"a{n}" for n in range(1000)), "p0"], 2)
    is_person = np.repeat([True] * 100 + [False] * 1001, 2)
    seen = [Seen(None, n // 2, float(n % 2)) for n in range(probability.size)]
    reached = evaluation.find_alarm_threshold(probability, is_person, groups, seen)
    assert tuple(reached.values()) == (pytest.approx(pets[-2], abs=1e-9), 100, 0.14)  # one of 999 pets above 0 may
    at_95 = evaluation.find_alarm_threshold(probability, is_person, groups)
    assert (at_95["alarm_threshold"], at_95["alarm_missed"]) == (pytest.approx(people[5]), 0.05)
    few = evaluation.find_alarm_threshold(np.minimum(2 * probability, 1.0), is_person, groups, seen)
    assert few["alarm_missed"] <= 0.2  # however sure of pets the network is
