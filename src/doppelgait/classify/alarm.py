"""Metrics of an alarm over a day: false triggers, time to detect and missed entries.

A day is a plan of episodes, each with its hours a day. It is built as a dataset of windows, whose
tracks are classified as those of a stream are. The alarm of a track is raised by two windows in
succession that reach the threshold, and stays.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from doppelgait.classify.data import all_rows, list_windows
from doppelgait.classify.learned import Seen, find_windows_before
from doppelgait.classify.model import Model, describe_outside_conditions
from doppelgait.classify.options import AlarmOptions, takes_options
from doppelgait.classify.scores import clopper_pearson_interval
from doppelgait.classify.timeline import check_window, follow_rows
from doppelgait.core.config import validate
from doppelgait.core.errors import ConfigError
from doppelgait.core.units import FloatArray
from doppelgait.dataset.build import build_dataset
from doppelgait.dataset.config import PlanConfig, load_plan
from doppelgait.dataset.open import Dataset, open_dataset
from doppelgait.dataset.resolve import make_example_id, resolve_example

THRESHOLDS = (0.5, 0.8, 0.9, 0.95, 0.99, 0.999, 0.9999)
"""Alarm thresholds that are scored in addition to that of the model."""


def load_day(plan: Any = None, repeats: int | None = None) -> tuple[PlanConfig, Path | None]:
    """Load the plan of a day, and the folder of its motion files."""
    plan = "home-alarm-day" if plan is None else plan
    day, folder = (plan, None) if isinstance(plan, PlanConfig) else load_plan(plan)
    if repeats is not None:
        section = day.dataset.model_copy(update={"examples_per_class": repeats})
        episodes = tuple(episode.model_copy(update={"examples": None}) for episode in day.episodes)
        day = day.model_copy(update={"dataset": section, "episodes": episodes})
    if not day.episodes:
        raise ConfigError(f"{plan}: is a plan of classes; a day of an alarm needs [[episodes]]")
    return day, folder


@takes_options(AlarmOptions)
def score_alarm(model: Model, *, on_progress: Any = None, **options: Any) -> dict[str, Any]:
    """Simulate days as a dataset of windows, classify it and score the alarm."""
    chosen, facts = AlarmOptions(**options), model.of_tracks.facts
    day, folder = load_day(chosen.day, chosen.repeats)
    with TemporaryDirectory() as scratch:
        dataset = build_day(day, model, chosen.directory or Path(scratch), folder=folder, on_progress=on_progress)
        probability = follow_rows(dataset, model)[:, facts.classes.index(str(facts.alarm))]
        return score_day(day, answer_day(dataset, probability), model)


def build_day(
    day: PlanConfig, model: Model, directory: Path, *, folder: Path | None = None, on_progress: Any = None
) -> Dataset:
    """Build the dataset of a day for the windows of a model."""
    facts = model.of_tracks.facts
    if facts.alarm is None:
        raise ConfigError(f"model {facts.dataset_name}: has no alarm; train with --alarm-class")
    learned = {name: span for name, span in facts.conditions.items() if name == "carrier_hz"}
    seen = {"carrier_hz": resolve_example(day, 0, folder or Path()).run.radar.carrier_hz}
    if other := describe_outside_conditions(seen, learned):
        hint = "name a plan with this radar, from 'dataset plan home-alarm-day --toml'"
        raise ConfigError(f"--day {day.dataset.name}: {other[0]}; {hint}")
    window_s, hop_s = check_window(None, None, model)
    plan = day.model_dump(mode="python") | {"analysis": facts.analysis}
    fields = ["pictures" if facts.features == "track" else "signature"]
    plan["dataset"] |= {"window_s": window_s, "hop_s": hop_s, "fields": fields}
    build_dataset(validate(PlanConfig, plan, where=day.dataset.name), directory, folder=folder, on_progress=on_progress)
    return open_dataset(directory)


def answer_day(dataset: Dataset, probability: FloatArray) -> pd.DataFrame:
    """Tabulate a classifier's answers (n,) to episodes, confirmed after every window."""
    sections = dataset.plan_config.episodes
    labels = {make_example_id(one.label, 0).rpartition("-")[0]: one.label for one in sections}
    seen, scenes = list_windows(all_rows(dataset, ())), dataset.index["scene_id"].astype(str)
    table = pd.DataFrame({"scene": scenes, "label": scenes.str.rpartition("-")[0].map(labels)})
    table = table.assign(track=[one.track for one in seen], stop_s=[one.stop_s for one in seen])
    return table.assign(score=np.where(np.isfinite(probability), confirm(probability, seen), -np.inf))


def find_triggers(answers: pd.DataFrame, threshold: float) -> pd.DataFrame:
    """Return the time at which the alarm of each track is raised: once, as it stays."""
    return answers[answers["score"] >= threshold].groupby(["scene", "track"], as_index=False)[["stop_s"]].min()


def confirm(probability: FloatArray, seen: Sequence[Seen]) -> FloatArray:
    """Return the lower probability of each window and the one before, else 0."""
    kept, found = np.flatnonzero(np.isfinite(probability)), np.zeros(probability.size)
    _, before = find_windows_before([seen[number] for number in kept.tolist()])
    values = probability[kept]
    found[kept] = np.where(before >= 0, np.minimum(values, values[before]), 0.0)
    return found


def score_day(day: PlanConfig, answers: pd.DataFrame, model: Model) -> dict[str, Any]:
    """Score the alarm over a day, by threshold."""
    facts = model.of_tracks.facts
    own = facts.alarm_threshold
    chosen = sorted({*THRESHOLDS, *([] if own is None else [own])})
    scores = [score_at_threshold(day, answers, each) | {"model": each == own} for each in chosen]
    repeats = day.dataset.examples_per_class
    return {"day": day.dataset.name, "alarm": facts.alarm, "repeats": repeats, "thresholds": scores}


def score_at_threshold(day: PlanConfig, answers: pd.DataFrame, threshold: float) -> dict[str, Any]:
    """Score the alarm over a day at a threshold of its probability."""
    kinds, first_s = [], list[float]()
    false, animal = list[tuple[int, float]](), list[tuple[int, float]]()  # counts and their weights
    animal_hours = sum(s.animals * s.hours_per_day for s in day.episodes if not s.should_trigger)
    raised = find_triggers(answers, threshold).groupby("scene")["stop_s"].agg(["size", "min"])
    recordings = answers.groupby("scene", sort=False)["label"].first().to_frame().join(raised)
    recordings = recordings.fillna({"size": 0, "min": math.inf}).astype({"size": int})
    for section in day.episodes:
        own = recordings[recordings["label"] == section.label]
        hours, sizes = len(own) * section.duration_s / 3600.0, own["size"].tolist()
        kinds.append(
            {
                "label": section.label,
                "hours": hours,
                "recordings": len(own),
                "triggered": int(np.count_nonzero(sizes)),
                "per_hour": sum(sizes) / hours if hours else 0.0,
                "should_trigger": section.should_trigger,
            }
        )
        if section.should_trigger:
            first_s += own["min"].tolist()
            continue
        false += [(size, section.hours_per_day / hours) for size in sizes]
        if section.animals:
            animal += [(size, section.hours_per_day / hours / animal_hours) for size in sizes]
    entries, missed = len(first_s), sum(map(math.isinf, first_s))
    found: dict[str, Any] = {
        "threshold": threshold,
        "false_per_day": estimate_weighted_count(*np.reshape(false, (-1, 2)).T),
        "entries": entries,
        "missed": missed,
        "seconds_to_detect": None,
        "by_episode": kinds,
    }
    if entries:
        reached = np.quantile(first_s, (0.5, 0.9), method="inverted_cdf").tolist()
        found["seconds_to_detect"] = [each if math.isfinite(each) else None for each in reached]
        found["missed_low"], found["missed_high"] = clopper_pearson_interval(float(missed), entries)
    if animal:
        found["false_per_animal_hour"] = estimate_weighted_count(*np.transpose(animal))
    return found


def estimate_weighted_count(counts: npt.ArrayLike, weights: npt.ArrayLike) -> dict[str, float]:
    """Return a weighted sum of counts, with 95 % by a gamma law (Fay and Feuer 1997)."""
    from scipy.stats import gamma

    n, w = np.asarray(counts, dtype=np.float64), np.asarray(weights, dtype=np.float64)
    if not n.size:
        return {"value": 0.0, "low": 0.0, "high": math.inf}
    total, variance, most = float(n @ w), float(n**2 @ w**2), float(w.max())
    low = float(gamma.ppf(0.025, total**2 / variance, scale=variance / total)) if total else 0.0
    mean, scale = total + most, (variance + most**2) / (total + most)
    return {"value": total, "low": low, "high": float(gamma.isf(0.025, mean / scale, scale=scale))}


def format_day(found: Mapping[str, Any]) -> list[dict[str, str]]:
    """Format the scores of a day, a row per threshold."""
    rows = []
    for one in found["thresholds"]:
        seconds = ["more" if s is None else f"{s:.1f}" for s in one["seconds_to_detect"] or ()]
        shares = " ({missed_low:.0%} to {missed_high:.0%})".format(**one) if one["entries"] else ""
        rows.append(
            {
                "threshold": f"{one['threshold']:.4g}" + (" (the model's)" if one["model"] else ""),
                "false triggers a day": _format_rate(one["false_per_day"]),
                "per animal-hour": _format_rate(one.get("false_per_animal_hour")),
                "missed entries": f"{one['missed']} of {one['entries']}{shares}",
                "time to detect (s)": ", 90 % in ".join(seconds) or "-",
            }
        )
    return rows


def format_episodes(found: Mapping[str, Any]) -> list[dict[str, str]]:
    """Format recordings that triggered, by kind."""
    names = [f"at {one['threshold']:.4g}" for one in found["thresholds"]]
    return [
        {
            "episode": kinds[0]["label"],
            "should trigger": "yes" if kinds[0]["should_trigger"] else "no",
            "recordings": str(kinds[0]["recordings"]),
            **{name: str(kind["triggered"]) for name, kind in zip(names, kinds, strict=True)},
        }
        for kinds in zip(*(one["by_episode"] for one in found["thresholds"]), strict=True)
    ]


def _format_rate(found: Mapping[str, float] | None) -> str:
    if found is None:
        return "-"
    digits = 1 if not math.isfinite(found["value"]) or found["high"] >= 10 else 2
    return f"{found['value']:.{digits}f} ({found['low']:.{digits}f} to {found['high']:.{digits}f})"
