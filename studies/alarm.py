"""The alarm, over days of kinds that it has not seen.

    python studies/alarm.py MOTION_FOLDER OUT --page

Question: how often do the shipped models raise the alarm for an animal, and whom do they miss?

Two days are simulated for every radar. The kinds of the first (`home-alarm-test`) were written by someone who knew
neither the kinds of the training nor any rule; nothing was chosen on it. The second has recorded people and dogs that
walk about (`home-alarm-recorded`); the two dogs are different kinds. A false alarm is
a track that raises the alarm in a recording that should not; an entry is missed if no track raises it. Rates are per
hour of an animal in the recording. Thresholds are that of the training data and round numbers.
It takes 40 minutes of one core.

Not shown: real radar.
"""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from harness import finish, make_parser, markdown

from doppelgait.classify.alarm import Episode, answer_day, build_day, score_day
from doppelgait.classify.model import Model
from doppelgait.classify.model_file import load_shipped_model
from doppelgait.classify.timeline import follow_rows
from doppelgait.dataset.config import PlanConfig, load_plan

sys.path.insert(0, str(Path(__file__).parents[1] / "tools"))

DAYS = ("home-alarm-test", "home-alarm-recorded")
REPEATS = {"x4": 20, "fmcw-24": 5, "fmcw-60": 2}
"""Recordings of a kind: as many as two hours allow."""


def list_scores(day: PlanConfig, episodes: list[Episode], model: Model) -> list[tuple[str, ...]]:
    """Return a row for every threshold: rates with their intervals, and the time to detect."""
    rows = []
    for scores in score_day(day, episodes, model)["thresholds"]:
        rate, seconds = scores.get("false_per_animal_hour"), scores["seconds_to_detect"]
        alarms = [format(rate[key], ".2f") for key in ("value", "low", "high")] if rate else ["-"] * 3
        missed = [format(scores[key], ".0%") for key in ("missed_low", "missed_high")]
        rows.append(
            (
                f"{scores['threshold']:.4g}" + (" (own)" if scores["model"] else ""),
                f"{alarms[0]} ({alarms[1]} to {alarms[2]})",
                f"{scores['missed']} of {scores['entries']} ({missed[0]} to {missed[1]})",
                "-" if seconds[0] is None else f"{seconds[0]:.1f}",
            )
        )
    return rows


def measure_calibration(episodes: list[Episode], day: PlanConfig) -> tuple[float, int]:
    """Return the expected error of the last probability of tracks, in recordings of one class, and their number."""
    animals = {section.label: section.animals for section in day.episodes}
    wanted = {section.label: section.should_trigger for section in day.episodes}
    ends = [
        (scores[-1], wanted[episode.label])
        for episode in episodes
        if not (wanted[episode.label] and animals[episode.label])
        for _, scores in episode.tracks.values()
    ]
    probability, human = np.array(ends, dtype=np.float64).T
    weight = np.where(human > 0, 0.5 / max(human.sum(), 1.0), 0.5 / max((1.0 - human).sum(), 1.0))
    bins = np.minimum((probability * 10.0).astype(np.int64), 9)
    sums = [np.bincount(bins, weights=weight * values, minlength=10) for values in (probability, human)]
    return float(np.abs(sums[0] - sums[1]).sum()), len(ends)


def main() -> None:
    """Build the days, score the models and write the page."""
    parser = make_parser(__doc__, motion_folder="folder of the recordings", out="folder for the datasets")
    parser.add_argument("--radars", nargs="+", default=list(REPEATS))
    options = parser.parse_args()
    train_models: Any = import_module("train_models")
    rates, kinds, calibrations = [], [], []
    for radar in options.radars:
        model = load_shipped_model(radar)
        for name in DAYS:
            count = f"dataset.examples_per_class={REPEATS[radar]}"
            day, _ = load_plan(name, overrides=[count, *train_models.OVERRIDES.get(radar, [])])
            folder = options.motion_folder.absolute()
            dataset = build_day(day, model, options.out / f"{name}-{radar}", folder=folder)
            human = model.of_tracks.facts.classes.index("human")
            episodes = answer_day(dataset, follow_rows(dataset, model)[:, human])
            hours = sum(s.animals * s.duration_s * day.count_class_examples(s) / 3600.0 for s in day.episodes
                        if not s.should_trigger)  # fmt: skip
            rates += [(radar, name, f"{hours:.1f}", *row) for row in list_scores(day, episodes, model)]
            error, n_tracks = measure_calibration(episodes, day)
            calibrations.append((radar, name, f"{error:.3f}", n_tracks))
            own = next(scores for scores in score_day(day, episodes, model)["thresholds"] if scores["model"])
            kinds += [
                (radar, kind["label"], "yes" if kind["should_trigger"] else "no", kind["recordings"], kind["triggered"])
                for kind in own["by_episode"]
                if kind["triggered"] != (kind["recordings"] if kind["should_trigger"] else 0)
            ]
    head = ("model", "day", "animal-hours", "threshold", "false alarms per animal-hour", "missed entries", "median s")
    tables = {
        "Rates": markdown(head, rates),
        "Kinds with errors, at the model's threshold": markdown(
            ("model", "kind", "should trigger", "recordings", "triggered"), kinds
        ),
        "Expected calibration error at the end of a track": markdown(("model", "day", "error", "tracks"), calibrations),
    }
    finish(__file__, __doc__, tables, page=options.page)


if __name__ == "__main__":
    main()
