"""Train the models that ship with the package, on synthetic data alone.

    python tools/train_models.py [NAME ...] [--work FOLDER] [--examples N] [--workers 2]
    python tools/train_models.py --tracks --work FOLDER

Needs ``pip install 'doppelgait[torch]'`` and 20 minutes of two cores; no recording is used. Written are the model files
and cards of the package. With ``--tracks`` one network of tracks is trained for all radars (some 4 hours).
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import replace
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from doppelgait.classify.data import collect_inputs, collect_rows, take_rows
from doppelgait.classify.evaluation import Fold, describe_model, evaluate, hold_back_in_turn
from doppelgait.classify.learned import LabelledRows, TrackNetwork
from doppelgait.classify.model_file import load_shipped_model, read_model_cards, save_model
from doppelgait.classify.network import train_track_network
from doppelgait.dataset import build_dataset, load_plan, open_dataset
from doppelgait.dataset.config import PlanConfig
from doppelgait.dataset.finish import DATA_VERSION
from doppelgait.dataset.open import Dataset

MODELS = Path(__file__).parents[1] / "src" / "doppelgait" / "classify" / "models"
PLANS = Path(__file__).parent / "plans"
LIFE, MORE = "home-alarm-life", str(PLANS / "life-more.toml")
RECORDINGS: dict[str, list[tuple[str, int, int, float]]] = {
    "x4": [(LIFE, seed, 20, 0.625 if seed < 103 else 1.25) for seed in range(101, 106)]
    + [(MORE, seed, 20, 1.25) for seed in (111, 112)],
    "fmcw-24": [(LIFE, 201, 12, 1.25), (MORE, 211, 8, 1.25)],
    "fmcw-60": [(LIFE, 301, 10, 1.25)],
}
"""Plan, seed, recordings of every kind and hop in s of the datasets of life."""
_WANDER = "white_rad = { uniform = [0, 0.006] }, drift_rad_per_min = { uniform = [-1, 1] }"
WANDER = f'impairments=[{{ kind = "phase_noise", {_WANDER} }}]'
OVERRIDES = {
    "fmcw-24": ['radar={ preset = "ancortek-24", sweep_s = 0.0005, prf_hz = { choice = [1000, 2000] } }', WANDER],
    "fmcw-60": ['radar={ preset = { choice = ["ti-60", "infineon-60"] } }', WANDER],
}
N_TURNS = 3  # of five networks, each of which learns four fifths of the kinds, for the calibration
TABLES = ("balanced_accuracy", "auc", "brier", "expected_calibration_error")


def plan_of(name: str, n_examples: int) -> PlanConfig:
    """Return the plan of windows that a model is trained on."""
    return load_plan(PLANS / f"windows-{name}.toml", overrides=[f"dataset.examples_per_class={n_examples}"])[0]


def life_of(name: str, plan: str, seed: int, n_recordings: int, hop_s: float) -> PlanConfig:
    """Return the plan of windows of life of a radar."""
    table = {"name": f'"home-alarm-life-{name}-{seed}"', "examples_per_class": n_recordings}
    stated = [f"dataset.{key}={value}" for key, value in {**table, "seed": seed, "hop_s": hop_s}.items()]
    return load_plan(plan, overrides=stated + OVERRIDES.get(name, []))[0]


def train(dataset: Dataset, folder: Path, name: str) -> dict[str, Any]:
    """Train on a dataset, write the model, return its card."""
    began = time.process_time()
    found = evaluate(dataset, models=["ensemble"], keep=True)
    seconds = time.process_time() - began
    model, path = found.models["ensemble"], folder / f"{name}.npz"
    save_model(replace(model, track=load_shipped_model(name).track), path)
    rows = collect_rows(dataset)
    tested = np.flatnonzero((rows.index["split"] == "test").to_numpy())
    values = collect_inputs(take_rows(rows, tested), model.facts.features).values
    began = time.process_time()
    model.probability(values)
    scores = found.document["models"]["ensemble"]
    return {
        "name": name,
        "data_version": DATA_VERSION,
        "licence": "Apache-2.0",
        "trained_on": "synthetic recordings of gait models alone; no motion capture, no recording of a radar",
        "dataset": dataset.description["id"],
        "classes": list(model.facts.classes),
        "n_train": model.facts.n_train,
        "conditions": {key: list(span) for key, span in model.facts.conditions.items()},
        "synthetic_test": {key: scores[key] for key in TABLES if key in scores},
        "training_s": round(seconds, 1),
        "size_kb": round(path.stat().st_size / 1000.0, 1),
        "decision_ms": round(1e3 * (time.process_time() - began) / tested.size, 3),
    }


def train_tracks(work: Path, workers: int | None) -> None:
    """Train the network of tracks on all datasets of life, and put it into the models of all radars."""
    plans, datasets = [(name, *plan) for name, plans in RECORDINGS.items() for plan in plans], []
    for plan in plans:
        target = work / f"home-alarm-life-{plan[0]}-{plan[2]}"
        build_dataset(life_of(*plan), target, workers=workers, max_failed_share=0.02)
        datasets.append(open_dataset(target))
    rows = collect_rows(*datasets)
    table, of_radar = collect_inputs(rows, "track"), np.array([plan[0] for plan in plans])[rows.origin]
    everything, n_classes = np.arange(len(rows)), len(rows.classes)
    answers = np.full((len(rows), n_classes), np.nan)

    def fit(part: Any) -> TrackNetwork:
        known, none = (LabelledRows(table.values[some], rows.labels[some]) for some in (part, part[:0]))
        return train_track_network(known, none, n_classes=n_classes, seed=0)

    for part, held in islice(hold_back_in_turn(rows, everything, 0), N_TURNS):
        answers[held] = fit(part).log_probability(table.values[held])
    network = fit(everything)
    for name in RECORDINGS:
        own = np.flatnonzero(of_radar == name)
        held = own[np.isfinite(answers[own, 0])]
        fold = Fold(name, own, held, own[:0])
        track = describe_model(rows, table, "track-network", fold, network, seed=0, answers=answers[held])
        path = MODELS / f"{name}.npz"
        save_model(replace(load_shipped_model(name), track=track), path)
        card = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
        conditions = {key: list(span) for key, span in track.facts.conditions.items()}
        card["track"] = {"datasets": [each.description["id"] for each in datasets], "n_train": track.facts.n_train}
        card |= {"track": card["track"] | {"conditions": conditions}, "size_kb": round(path.stat().st_size / 1e3, 1)}
        path.with_suffix(".json").write_text(json.dumps(card, indent=2) + "\n", encoding="utf-8")


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", default=list(RECORDINGS), help=f"of {', '.join(RECORDINGS)}")
    parser.add_argument("--work", type=Path, help="folder that keeps the datasets")
    parser.add_argument("--examples", type=int, help="of a class, in place of 2000, 1000 and 1500")
    parser.add_argument("--workers", type=int)
    parser.add_argument("--tracks", action="store_true", help="train the network of tracks alone")
    options = parser.parse_args()
    with TemporaryDirectory() as scratch:
        if options.tracks:
            train_tracks(options.work or Path(scratch), options.workers)
            return
        for name in options.names:
            n_examples = options.examples or {"x4": 2000, "fmcw-24": 1000, "fmcw-60": 1500}[name]
            target = (options.work or Path(scratch)) / f"shipped-{name}-{n_examples}"
            build_dataset(plan_of(name, n_examples), target, workers=options.workers,
                                   max_failed_share=0.02)  # fmt: skip
            card = train(open_dataset(target), MODELS, name) | {"track": read_model_cards()[name]["track"]}
            (MODELS / f"{name}.json").write_text(json.dumps(card, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
