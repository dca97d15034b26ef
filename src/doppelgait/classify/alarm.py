"""Metrics of an alarm over a day.

These are false triggers, time to detect and missed entries. A day is a plan of episodes, each with
its hours a day. It is built as a dataset of windows, whose tracks are classified as those of a
stream are (:mod:`doppelgait.classify.timeline`). The alarm of a track is raised by two windows in
succession that reach the threshold, and stays.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from doppelgait.classify.data import all_rows, list_windows
from doppelgait.classify.learned import Seen, find_windows_before
from doppelgait.classify.model import Model
from doppelgait.classify.scores import clopper_pearson_interval
from doppelgait.classify.timeline import check_window, follow_rows
from doppelgait.core.config import validate
from doppelgait.core.errors import ConfigError
from doppelgait.core.units import FloatArray
from doppelgait.dataset.build import build_dataset
from doppelgait.dataset.config import PlanConfig, load_plan
from doppelgait.dataset.open import Dataset, open_dataset
from doppelgait.dataset.resolve import make_example_id

THRESHOLDS = (0.5, 0.8, 0.9, 0.95, 0.99, 0.999, 0.9999)
"""Alarm thresholds that are scored in addition to that of the model."""


@dataclass(frozen=True)
class Episode:
    """Confirmed scores of the alarm in one recording, by track: times and scores."""

    label: str
    tracks: Mapping[int, tuple[FloatArray, FloatArray]]

    def find_triggers(self, threshold: float) -> FloatArray:
        """Return the times at which the alarm of each track is raised: once, as it stays."""
        over = [times_s[scores >= threshold] for times_s, scores in self.tracks.values()]
        return np.array(sorted(times_s[0] for times_s in over if times_s.size), dtype=np.float64)


def load_day(plan: str | Path | None = None, repeats: int | None = None) -> tuple[PlanConfig, Path]:
    """Load the plan of a day, and the folder of its motion files."""
    day, folder = load_plan(plan or "home-alarm-day")
    if repeats is not None:
        section = day.dataset.model_copy(update={"examples_per_class": repeats})
        episodes = tuple(episode.model_copy(update={"examples": None}) for episode in day.episodes)
        day = day.model_copy(update={"dataset": section, "episodes": episodes})
    if not day.episodes:
        raise ConfigError(f"{plan}: is a plan of classes; a day of an alarm needs [[episodes]]")
    return day, folder


def run_day(
    day: PlanConfig,
    model: Model,
    *,
    folder: Path | None = None,
    directory: Path | None = None,
    on_progress: Callable[[int, int], None] | None = None,
) -> list[Episode]:
    """Simulate a day as a dataset of windows, and classify it."""
    with TemporaryDirectory() as scratch:
        dataset = build_day(day, model, directory or Path(scratch), folder=folder, on_progress=on_progress)
        facts = model.of_tracks.facts
        return answer_day(dataset, follow_rows(dataset, model)[:, facts.classes.index(str(facts.alarm))])


def build_day(
    day: PlanConfig,
    model: Model,
    directory: Path,
    *,
    folder: Path | None = None,
    on_progress: Callable[[int, int], None] | None = None,
) -> Dataset:
    """Build the dataset of a day for the windows of a model."""
    facts = model.of_tracks.facts
    if facts.alarm is None:
        raise ConfigError(
            f"model {facts.dataset_name}: has no alarm: its classes are {', '.join(facts.classes)}; train with "
            "--alarm-class"
        )
    window_s, hop_s = check_window(None, None, model)
    plan = day.model_dump(mode="python")
    plan["dataset"] |= {"window_s": window_s, "hop_s": hop_s}
    plan["dataset"]["fields"] = ["pictures" if facts.features == "track" else "signature"]
    plan["analysis"] = facts.analysis
    build_dataset(validate(PlanConfig, plan, where=day.dataset.name), directory, folder=folder, on_progress=on_progress)
    return open_dataset(directory)


def answer_day(dataset: Dataset, probability: FloatArray) -> list[Episode]:
    """Collect a classifier's answers (n,) to a dataset of episodes."""
    labels = {
        make_example_id(section.label, 0).rpartition("-")[0]: section.label for section in dataset.plan_config.episodes
    }
    seen, scenes = list_windows(all_rows(dataset, ())), dataset.index["scene_id"].to_numpy(dtype=str)
    confirmed, tracks = confirm(probability, seen), dict[str, dict[int, list[int]]]()
    for number, (scene, one) in enumerate(zip(scenes.tolist(), seen, strict=True)):
        own = tracks.setdefault(scene, {})
        if np.isfinite(probability[number]):
            own.setdefault(one.track, []).append(number)
    episodes = []
    for scene, found in tracks.items():
        ordered = {track: sorted(own, key=lambda n: seen[n].stop_s) for track, own in found.items()}
        times = {track: (np.array([seen[n].stop_s for n in own]), confirmed[own]) for track, own in ordered.items()}
        episodes.append(Episode(labels[scene.rpartition("-")[0]], times))
    return episodes


def confirm(probability: FloatArray, seen: Sequence[Seen]) -> FloatArray:
    """Return the lower probability of each window and the one before, else 0."""
    kept, found = np.flatnonzero(np.isfinite(probability)), np.zeros(probability.size)
    _, before = find_windows_before([seen[number] for number in kept.tolist()])
    values = probability[kept]
    found[kept] = np.where(before >= 0, np.minimum(values, values[before]), 0.0)
    return found


def score_day(day: PlanConfig, episodes: Sequence[Episode], model: Model) -> dict[str, Any]:
    """Score the alarm over a day, by threshold."""
    own = model.of_tracks.facts.alarm_threshold
    chosen = sorted({*THRESHOLDS, *(() if own is None else (own,))})
    return {
        "day": day.dataset.name,
        "alarm": model.of_tracks.facts.alarm,
        "repeats": day.dataset.examples_per_class,
        "thresholds": [
            score_at_threshold(day, episodes, threshold) | {"model": threshold == own} for threshold in chosen
        ],
    }


def score_at_threshold(day: PlanConfig, episodes: Sequence[Episode], threshold: float) -> dict[str, Any]:
    """Score the alarm over a day at a threshold of its probability."""
    by_label: dict[str, list[FloatArray]] = {}
    for one in episodes:
        by_label.setdefault(one.label, []).append(one.find_triggers(threshold))
    counts, per_day, per_animal, kinds, first_s = [], [], [], [], []
    for section in day.episodes:
        times = by_label[section.label]
        hours, count = len(times) * section.duration_s / 3600.0, sum(each.size for each in times)
        kinds.append(
            {
                "label": section.label,
                "hours": hours,
                "recordings": len(times),
                "triggered": sum(each.size > 0 for each in times),
                "per_hour": count / hours,
                "should_trigger": section.should_trigger,
            }
        )
        if section.should_trigger:
            first_s += [float(each[0]) if each.size else math.inf for each in times]
        else:
            counts += [each.size for each in times]
            per_day += [section.hours_per_day / hours] * len(times)
            per_animal += [section.hours_per_day / hours if section.animals else 0.0] * len(times)
    animal_hours = sum(s.animals * s.hours_per_day for s in day.episodes if not s.should_trigger)
    entries, missed = len(first_s), sum(math.isinf(each) for each in first_s)
    found: dict[str, Any] = {
        "threshold": threshold,
        "false_per_day": estimate_weighted_count(counts, per_day),
        "entries": entries,
        "missed": missed,
        "seconds_to_detect": None,
        "by_episode": kinds,
    }
    if entries:
        reached = np.quantile(first_s, (0.5, 0.9), method="inverted_cdf")
        found["seconds_to_detect"] = [float(each) if math.isfinite(each) else None for each in reached]
        found["missed_low"], found["missed_high"] = clopper_pearson_interval(float(missed), entries)
    if animal_hours:
        with_animals = [number for number, weight in enumerate(per_animal) if weight]
        found["false_per_animal_hour"] = estimate_weighted_count(
            [counts[number] for number in with_animals], [per_animal[number] / animal_hours for number in with_animals]
        )
    return found


def estimate_weighted_count(counts: Sequence[int], weights: Sequence[float], share: float = 0.95) -> dict[str, float]:
    """Return a weighted sum of counts with its interval.
    The interval is the gamma approximation of Fay and Feuer (Statistics in Medicine 16, 1997),
    exact for counts of 0 and 1 and equal weights.
    """
    from scipy.stats import gamma

    if not len(counts):
        return {"value": 0.0, "low": 0.0, "high": math.inf}
    n, w = np.asarray(counts, dtype=np.float64), np.asarray(weights, dtype=np.float64)
    total, variance, most = float(n @ w), float(n**2 @ w**2), float(w.max())
    tail = (1.0 - share) / 2.0
    low = 0.0 if total == 0 else float(gamma.ppf(tail, total**2 / variance, scale=variance / total))
    upper_mean, upper_variance = total + most, variance + most**2
    scale = upper_variance / upper_mean
    return {"value": total, "low": low, "high": float(gamma.isf(tail, upper_mean / scale, scale=scale))}


def format_day(found: Mapping[str, Any]) -> list[dict[str, str]]:
    """Format the scores of a day, a row per threshold."""
    rows = []
    for one in found["thresholds"]:
        seconds = one["seconds_to_detect"]
        animal = one.get("false_per_animal_hour")
        rows.append(
            {
                "threshold": f"{one['threshold']:.4g}" + (" (the model's)" if one["model"] else ""),
                "false triggers a day": _format_interval(one["false_per_day"]),
                "per animal-hour": "-" if animal is None else _format_interval(animal),
                "missed entries": f"{one['missed']} of {one['entries']}"
                + (f" ({one['missed_low']:.0%} to {one['missed_high']:.0%})" if one["entries"] else ""),
                "time to detect (s)": "-"
                if seconds is None
                else f"{_format_seconds(seconds[0])}, 90 % in {_format_seconds(seconds[1])}",
            }
        )
    return rows


def format_episodes(found: Mapping[str, Any]) -> list[dict[str, str]]:
    """Format recordings that triggered, by kind."""
    rows = []
    for number, kind in enumerate(found["thresholds"][0]["by_episode"]):
        row = {
            "episode": kind["label"],
            "should trigger": "yes" if kind["should_trigger"] else "no",
            "recordings": str(kind["recordings"]),
        }
        for one in found["thresholds"]:
            row[f"at {one['threshold']:.4g}"] = str(one["by_episode"][number]["triggered"])
        rows.append(row)
    return rows


def _format_seconds(value: float | None) -> str:
    return "more" if value is None else f"{value:.1f}"


def _format_interval(found: Mapping[str, float]) -> str:
    digits = 1 if not math.isfinite(found["value"]) or found["high"] >= 10 else 2
    return f"{found['value']:.{digits}f} ({found['low']:.{digits}f} to {found['high']:.{digits}f})"
