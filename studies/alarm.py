"""The alarm, over days of kinds that it has not seen.

    python studies/alarm.py MOTION_FOLDER OUT --page

Question: how often do the shipped models raise the alarm for an animal, and whom do they miss?

Two days are simulated. The kinds of the first (`home-alarm-test`) were written by someone who knew neither the kinds
of the training nor any rule; nothing was chosen on it; of its animals there are more recordings. The second has
recorded people and dogs that walk about (`home-alarm-recorded`); the two dogs are different kinds. A false alarm is a
track that raises the alarm in a recording that should not; an entry is missed if no track raises it. Rates are per
hour of an animal in the recording; a kind counts by its hours a day. Thresholds are that of the training data and
round numbers. The X4's days are parts of the benchmark ([how to](../howto/benchmark.md)). "x4 in C" is the network of
the [export](../howto/export.md) (8 bits, no features), on the package's windows. It takes five hours.

Not shown: real radar, and recorded bodies in front of other radars than the X4.
"""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import pandas as pd
from harness import finish, make_parser, markdown

from doppelgait.classify import benchmark as bench
from doppelgait.classify.alarm import answer_day, format_day, score_at_threshold, score_day
from doppelgait.classify.c_code import drop_features, round_kernels
from doppelgait.classify.model_file import load_shipped_model
from doppelgait.classify.report import format_interval
from doppelgait.classify.timeline import follow_rows
from doppelgait.dataset import Dataset, build_dataset, open_dataset

sys.path.insert(0, str(Path(__file__).parents[1] / "tools"))

SEEDS = range(4712, 4721)  # of more days of the animals of `life`
RUNS = (("x4", "life"), ("x4 in C", "life"), ("x4", "recorded"), ("fmcw-24", "life"), ("fmcw-60", "life"))
REPEATS = {"x4": 12, "fmcw-24": 4, "fmcw-60": 3}
"""Recordings of a kind: fewer for other radars than that of the benchmark."""


def build_animals(seed: int, out: Path, folder: Path) -> Dataset:
    """Build the recordings of animals alone of a day of `life` of another seed."""
    plan = bench.load_part("life", folder, [f"dataset.seed={seed}", f'dataset.name="animals-{seed}"'])
    kinds = tuple(one for one in plan.episodes if one.animals and not one.should_trigger)
    build_dataset(plan.model_copy(update={"episodes": kinds}), out, folder=folder, max_failed_share=0.02)
    return open_dataset(out)


def measure(radar: str, name: str, folder: Path, out: Path) -> dict[str, list[Any]]:
    """Return the rows of a radar's day in the three tables."""
    train_models: Any = import_module("train_models")
    model, is_x4 = load_shipped_model(radar.partition(" ")[0]).of_tracks, radar.startswith("x4")
    if radar.endswith("in C"):
        model = replace(model, learned=round_kernels(drop_features(model.learned)))
    changes = [] if is_x4 else [f"dataset.examples_per_class={REPEATS[radar]}", *train_models.OVERRIDES[radar]]
    dataset = bench.build_part(name, out / (name if is_x4 else f"{name}-{radar}"), folder=folder, changes=changes)
    day, datasets = dataset.plan_config, [dataset]
    if is_x4 and name == "life":  # more of its animals
        datasets += [build_animals(seed, out / f"animals-{seed}", folder) for seed in SEEDS]
    human = model.facts.classes.index("human")
    answers = [follow_rows(each, model)[:, human] for each in datasets]
    pairs = enumerate(zip(datasets, answers, strict=True))  # recordings of other seeds have equal names
    parts = [answer_day(*pair).assign(scene=lambda table, n=n: f"{n}/" + table["scene"]) for n, pair in pairs]
    episodes = pd.concat(parts, ignore_index=True)
    ends = bench.score_part(dataset, answers[0])
    at_5 = score_at_threshold(day, episodes, ends["alarm"]["threshold"])
    scored = score_day(day, episodes, model)["thresholds"]
    own = next(scores for scores in scored if scores["model"])
    animals = {one.label: one.animals for one in day.episodes if not one.should_trigger}
    hours = sum(kind["hours"] * animals.get(kind["label"], 0) for kind in own["by_episode"])
    rows = format_day({"thresholds": [*scored, at_5 | {"model": False}]})
    rows[-1]["threshold"] += " (5 % missed)"
    error = f"{ends['expected_calibration_error']:.3f}"
    kinds = [
        [radar, kind["label"], "yes" if kind["should_trigger"] else "no", kind["recordings"], kind["triggered"]]
        for kind in own["by_episode"]
        if kind["triggered"] != (kind["recordings"] if kind["should_trigger"] else 0)
    ]
    return {
        "rates": [{"model": radar, "day": name, "animal-hours": f"{hours:.1f}", **row} for row in rows],
        "kinds": kinds,
        "tracks": [[radar, name, str(ends["tracks"]), format_interval(ends["auc"]), error]],
    }


def main() -> None:
    """Build the days, score the models and write the page."""
    parser = make_parser(__doc__, motion_folder="folder of the recordings", out="folder for the datasets")
    options = parser.parse_args()
    rows: dict[str, list[Any]] = {"rates": [], "kinds": [], "tracks": []}
    for radar, name in RUNS:
        kept = options.out / f"{radar}-{name}.json"  # hours of work
        if not kept.is_file():
            found = measure(radar, name, options.motion_folder.absolute(), options.out)
            kept.write_text(json.dumps(found), encoding="utf-8")
        for table, part in json.loads(kept.read_text(encoding="utf-8")).items():
            rows[table] += part
    tables = {
        "Rates": pd.DataFrame(rows["rates"]).drop(columns="false triggers a day"),
        "Kinds with errors, at the model's threshold": markdown(
            ("model", "kind", "should trigger", "recordings", "triggered"), rows["kinds"]
        ),
        "At the end of a track": markdown(("model", "day", "tracks", "AUC", "ECE"), rows["tracks"]),
    }
    finish(__file__, __doc__, tables, page=options.page)


if __name__ == "__main__":
    main()
