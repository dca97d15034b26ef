"""The alarm, over days of kinds that it has not seen.

    python studies/alarm.py MOTION_FOLDER OUT --page

Question: how often do the shipped models raise the alarm for an animal, and whom do they miss?

Two days are simulated. The kinds of the first (`home-alarm-test`) were written by someone who knew
neither the kinds of the training nor any rule; nothing was chosen on it. The second has recorded people and dogs that
walk about (`home-alarm-recorded`); the two dogs are different kinds. A false alarm is
a track that raises the alarm in a recording that should not; an entry is missed if no track raises it. Rates are per
hour of an animal in the recording. Thresholds are that of the training data and round numbers.
The days of the X4 are parts of the benchmark ([how to](../howto/benchmark.md)). It takes an hour of one core.

Not shown: real radar, recorded bodies in front of other radars than the X4, and the model for 60 GHz.
"""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path
from typing import Any

from harness import finish, make_parser, markdown

from doppelgait.classify import benchmark as bench
from doppelgait.classify.alarm import answer_day, score_day
from doppelgait.classify.model_file import load_shipped_model
from doppelgait.classify.report import format_interval
from doppelgait.classify.timeline import follow_rows

sys.path.insert(0, str(Path(__file__).parents[1] / "tools"))

DAYS = ("life", "recorded")  # parts of the benchmark
REPEATS = {"x4": [], "fmcw-24": ["dataset.examples_per_class=4"]}
"""Recordings of a kind for other radars than that of the benchmark: as many as two hours allow."""


def list_scores(found: list[dict[str, Any]]) -> list[tuple[str, ...]]:
    """Return a row for every threshold: rates with their intervals, and the time to detect."""
    rows: list[tuple[str, ...]] = []
    for scores in found:
        rate, seconds = scores.get("false_per_animal_hour"), scores["seconds_to_detect"]
        alarms = [format(rate[key], ".2f") for key in ("value", "low", "high")] if rate else ["-"] * 3
        missed = [format(scores[key], ".0%") for key in ("missed_low", "missed_high")]
        rows.append(
            (
                f"{scores['threshold']:.4g}" + scores["words"],
                f"{alarms[0]} ({alarms[1]} to {alarms[2]})",
                f"{scores['missed']} of {scores['entries']} ({missed[0]} to {missed[1]})",
                "-" if seconds[0] is None else f"{seconds[0]:.1f}",
            )
        )
    return rows


def main() -> None:
    """Build the days, score the models and write the page."""
    parser = make_parser(__doc__, motion_folder="folder of the recordings", out="folder for the datasets")
    parser.add_argument("--radars", nargs="+", default=list(REPEATS))
    options = parser.parse_args()
    train_models: Any = import_module("train_models")
    rates, kinds, tracks = [], [], []
    for radar in options.radars:
        model = load_shipped_model(radar)
        for name in DAYS if radar == "x4" else DAYS[:1]:
            changes = [] if radar == "x4" else [*REPEATS[radar], *train_models.OVERRIDES[radar]]
            place = options.out / (name if radar == "x4" else f"{name}-{radar}")
            dataset = bench.build_part(name, place, folder=options.motion_folder.absolute(), changes=changes)
            day = dataset.plan_config
            human = model.of_tracks.facts.classes.index("human")
            probability = follow_rows(dataset, model)[:, human]
            episodes, ends = answer_day(dataset, probability), bench.score_part(dataset, probability)
            hours = sum(s.animals * s.duration_s * day.count_class_examples(s) / 3600.0 for s in day.episodes
                        if not s.should_trigger)  # fmt: skip
            scored = score_day(day, episodes, model)["thresholds"]
            own = next(scores for scores in scored if scores["model"])
            words = [" (own)" if one is own else "" for one in scored] + [" (5 % missed)"]
            shown = [one | {"words": text} for one, text in zip([*scored, ends["alarm"]], words, strict=True)]
            rates += [(radar, name, f"{hours:.1f}", *row) for row in list_scores(shown)]
            area, error = format_interval(ends["auc"]), f"{ends['expected_calibration_error']:.3f}"
            tracks.append((radar, name, str(ends["tracks"]), area, error))
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
        "At the end of a track": markdown(("model", "day", "tracks", "AUC", "ECE"), tracks),
    }
    finish(__file__, __doc__, tables, page=options.page)


if __name__ == "__main__":
    main()
