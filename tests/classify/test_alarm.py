"""Alarm metrics of a day: closed forms of intervals, triggers counted by hand, a day that runs."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2

from doppelgait.classify import classify_over_time, load_shipped_model
from doppelgait.classify.alarm import (
    Day,
    Episode,
    estimate_weighted_count,
    format_day,
    format_episodes,
    read_day,
    run_day,
    sample_scene,
    score_alarm,
    score_day,
)
from doppelgait.core.errors import ConfigError
from doppelgait.pipeline import simulate


@pytest.mark.parametrize("count", [0, 1, 3, 20])
def test_the_interval_of_one_count_is_that_of_poisson(count):
    counts = [1] * count + [0] * 5
    found = estimate_weighted_count(counts, [0.5] * len(counts))
    low = 0.0 if count == 0 else chi2.ppf(0.025, 2 * count) / 2
    assert found == pytest.approx(
        {"value": 0.5 * count, "low": 0.5 * low, "high": 0.5 * chi2.isf(0.025, 2 * count + 2) / 2}
    )


@pytest.mark.parametrize("cluster", [1, 4])
def test_the_interval_of_weighted_counts_holds_the_truth(cluster):
    # 20 recordings of each of three kinds; those that trigger do so once, or four times
    rng, shares, weights = np.random.default_rng(0), np.repeat([0.1, 0.03, 0.3], 20), np.repeat([1.0, 4.0, 0.3], 20)
    spans = [estimate_weighted_count(cluster * (rng.random(60) < shares), weights) for _ in range(2000)]
    inside = np.mean([span["low"] <= cluster * shares @ weights <= span["high"] for span in spans])
    assert 0.94 <= inside <= 0.999  # conservative, as the paper says


def test_several_triggers_of_one_recording_are_one_event():
    assert (
        estimate_weighted_count([4, 0], [1.0, 1.0])["high"] > estimate_weighted_count([1, 1, 1, 1], [1.0] * 4)["high"]
    )
    assert estimate_weighted_count([], []) == {"value": 0.0, "low": 0.0, "high": np.inf}


def decision(track, probability, *, alone=0.5, blocked=False, alarm=True):
    def both(p):
        return {"human": p, "animal": 1 - p}

    return SimpleNamespace(track=track, probabilities=both(probability),
                           window=SimpleNamespace(blocked=blocked, alarm=alarm, probabilities=both(alone)))  # fmt: skip


def test_the_score_is_what_the_alarm_of_a_stream_compares():
    found = score_alarm([
        (4.0, [decision(0, 0.5, alone=0.9, blocked=True), decision(1, 0.5, alone=0.99, blocked=True, alarm=None)]),
        (5.0, [decision(0, 0.7), decision(1, 0.2)]),
        (6.0, [decision(0, 0.99, blocked=True)]),
        (7.0, []),
        (8.0, [decision(1, 0.3)]),
    ], "human")  # fmt: skip
    assert found[0].tolist() == [4, 5, 6, 7, 8]
    assert found[1] == pytest.approx([0.9, 0.7, 0.7, 0.0, 0.3])


def test_two_alarms_with_an_empty_room_between_are_two():
    windows = [(1.0, [decision(0, 0.99)]), (2.0, []), (3.0, [decision(1, 0.99)])]
    assert Episode("x", *score_alarm(windows, "human")).find_triggers(0.9).tolist() == [1.0, 3.0]


@pytest.mark.release
def test_triggers_at_the_models_threshold_are_the_rises_of_the_alarm_of_a_stream():
    day, model = read_day(), load_shipped_model("x4")
    chosen = tuple(one for one in day.episodes if one.label == "a person and a dog cross the room")
    day = day.model_copy(update={"repeats": 2, "episodes": chosen})
    for number, episode in enumerate(run_day(day, model)):
        run = sample_scene(day, chosen[0], number)
        recording = simulate(run.scene, run.radar, rng=run.streams, conditions=run.conditions, angles=False)
        alarmed = {}
        for one in classify_over_time(recording, model):
            alarmed[one.stop_s] = alarmed.get(one.stop_s, False) or bool(one.alarm)
        over = np.array([alarmed.get(time_s, False) for time_s in episode.times_s])
        assert over.any() == bool((episode.scores >= model.facts.alarm_threshold).any())
        np.testing.assert_array_equal(over, episode.scores >= model.facts.alarm_threshold)


def test_triggers_are_rises():
    one = Episode("x", np.arange(6.0), np.array([0.9, 0.9, 0.2, 0.8, 0.1, 0.9]))
    assert one.find_triggers(0.8).tolist() == [0, 3, 5]
    assert one.find_triggers(0.95).size == 0


def test_rates_by_hand():
    episodes = [
        {"label": "entry", "should_trigger": True, "hours_per_day": 1, "duration_s": 10, "targets": []},
        {"label": "dog", "animals": 2, "hours_per_day": 6, "duration_s": 18, "targets": []},
        {"label": "fan", "hours_per_day": 3, "duration_s": 18, "targets": []},
    ]
    day = Day(name="d", repeats=2, scene={}, episodes=tuple(episodes))
    times, quiet, loud = np.array([3.0, 4.0]), np.zeros(2), np.array([0.0, 0.9])
    made = [Episode("entry", times, loud), Episode("entry", times, quiet), Episode("dog", times, loud),
            Episode("dog", times, quiet), Episode("fan", times, loud), Episode("fan", times, loud)]  # fmt: skip
    model = SimpleNamespace(facts=SimpleNamespace(alarm="human", alarm_threshold=0.6))
    found = score_day(day, made, model)
    own = next(one for one in found["thresholds"] if one["model"])
    # 36 s of each kind: 1 of the dog is 100 an hour, of which 6 h; 2 of the fan 200 an hour, of which 3 h
    assert own["false_per_day"]["value"] == pytest.approx(100 * 6 + 200 * 3)
    assert own["false_per_animal_hour"]["value"] == pytest.approx(100 * 6 / 12)
    assert (own["entries"], own["missed"], own["seconds_to_detect"]) == (2, 1, [4.0, None])
    at_once = next(one for one in found["thresholds"] if one["threshold"] == 0.99)
    assert at_once["false_per_day"]["value"] == 0
    assert at_once["seconds_to_detect"] == [None, None]
    assert [row["threshold"] for row in format_day(found)][1] == "0.6 (the model's)"
    assert format_episodes(found)[2] == {
        "episode": "fan", "should trigger": "no", "recordings": "2", "at 0.5": "2", "at 0.6": "2", "at 0.8": "2",
        "at 0.9": "2", "at 0.95": "0", "at 0.99": "0",
    }  # fmt: skip


def test_every_scene_of_the_built_in_day_can_be_drawn():
    day = read_day()
    for number, section in enumerate(day.episodes):
        for turn in range(3):
            run = sample_scene(day, section, 3 * number + turn)
            kinds = [type(effect).__name__ for effect in run.environment]
            assert kinds == ["GroundBounce", *(["Screen"] if "behind a sofa" in section.label else [])]
    assert 20 <= sum(section.hours_per_day for section in day.episodes) <= 48  # some go on at the same time
    assert sum(section.should_trigger for section in day.episodes) == 4


def test_a_person_triggers_and_a_fan_does_not():
    day = read_day()
    durations_s = {"a person comes in and goes again": 14.0, "fan": 20.0}
    chosen = tuple(
        one.model_copy(update={"duration_s": durations_s[one.label]})
        for one in day.episodes
        if one.label in durations_s
    )
    found = score_day(*(lambda short: (short, run_day(short, load_shipped_model("x4")), load_shipped_model("x4")))(
        day.model_copy(update={"repeats": 1, "episodes": chosen})
    ))  # fmt: skip
    own = next(one for one in found["thresholds"] if one["model"])
    assert own["missed"] == 0
    assert own["false_per_day"]["value"] == 0
    assert 0 < own["seconds_to_detect"][0] < 14


def test_a_model_without_an_alarm_is_told(tmp_path):
    model = SimpleNamespace(facts=SimpleNamespace(alarm=None, dataset_name="garden", classes=("cat", "dog")))
    with pytest.raises(
        ConfigError, match="model garden: has no alarm: its classes are cat, dog; train with --alarm-class"
    ):
        run_day(read_day(), model)
    (tmp_path / "day.toml").write_text("name = 'x'\nscene = {}\nepisode = 3\n")
    with pytest.raises(ConfigError, match=r"day\.toml.*episode"):
        read_day(tmp_path / "day.toml")
