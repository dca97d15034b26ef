"""Alarm metrics of a day: closed forms of intervals, triggers counted by hand, a day that runs."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2

from doppelgait.classify import shipped_model
from doppelgait.classify.alarm import (
    Day,
    Episode,
    alarm_scores,
    day_table,
    draw_scene,
    episode_table,
    read_day,
    run_day,
    score_day,
    weighted_poisson,
)
from doppelgait.core.errors import ConfigError


@pytest.mark.parametrize("count", [0, 1, 3, 20])
def test_the_interval_of_one_count_is_that_of_poisson(count):
    found = weighted_poisson([count], [0.5])
    low = 0.0 if count == 0 else chi2.ppf(0.025, 2 * count) / 2
    assert found == pytest.approx(
        {"value": 0.5 * count, "low": 0.5 * low, "high": 0.5 * chi2.isf(0.025, 2 * count + 2) / 2}
    )


def test_the_interval_of_weighted_counts_holds_the_truth():
    rng, means, weights = np.random.default_rng(0), np.array([2.0, 0.5, 6.0]), np.array([1.0, 4.0, 0.3])
    spans = [weighted_poisson(rng.poisson(means), weights) for _ in range(2000)]
    inside = np.mean([span["low"] <= means @ weights <= span["high"] for span in spans])
    assert 0.94 <= inside <= 0.995  # conservative, as the paper says


def decision(track, stop_s, probability, *, blocked=False):
    return SimpleNamespace(track=track, stop_s=stop_s, probabilities={"human": probability, "animal": 1 - probability},
                           window=SimpleNamespace(blocked=blocked))  # fmt: skip


def test_a_track_counts_from_its_first_evidence_and_keeps_its_score():
    found = alarm_scores([
        decision(0, 4.0, 0.9, blocked=True), decision(0, 5.0, 0.7), decision(1, 5.0, 0.2),
        decision(0, 6.0, 0.99, blocked=True), decision(1, 7.0, 0.3),
    ], "human")  # fmt: skip
    assert found[0].tolist() == [4, 5, 6, 7]
    assert found[1] == pytest.approx([0.0, 0.7, 0.7, 0.3])


def test_triggers_are_rises():
    one = Episode("x", np.arange(6.0), np.array([0.9, 0.9, 0.2, 0.8, 0.1, 0.9]))
    assert one.triggers(0.8).tolist() == [0, 3, 5]
    assert one.triggers(0.95).size == 0


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
    assert (own["entries"], own["missed"], own["seconds_to_detect"]) == (2, 1, [4.0, 4.0])
    at_once = next(one for one in found["thresholds"] if one["threshold"] == 0.99)
    assert at_once["false_per_day"]["value"] == 0
    assert at_once["seconds_to_detect"] is None
    assert [row["threshold"] for row in day_table(found)][1] == "0.6 (the model's)"
    assert episode_table(found)[2] == {
        "episode": "fan", "should trigger": "no", "recordings": "2", "at 0.5": "2", "at 0.6": "2", "at 0.8": "2",
        "at 0.9": "2", "at 0.95": "0", "at 0.99": "0",
    }  # fmt: skip


def test_every_scene_of_the_built_in_day_can_be_drawn():
    day = read_day()
    for number, section in enumerate(day.episodes):
        for turn in range(3):
            run = draw_scene(day, section, 3 * number + turn)
            kinds = [type(effect).__name__ for effect in run.environment]
            assert kinds == ["GroundBounce", *(["Screen"] if "behind a sofa" in section.label else [])]
    assert 20 <= sum(section.hours_per_day for section in day.episodes) <= 48  # some go on at the same time
    assert sum(section.should_trigger for section in day.episodes) == 4


@pytest.mark.slow
def test_a_person_triggers_and_a_fan_does_not():
    day = read_day()
    chosen = tuple(one for one in day.episodes if one.label in ("a person comes in and goes again", "fan"))
    found = score_day(*(lambda short: (short, run_day(short, shipped_model("x4")), shipped_model("x4")))(
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
