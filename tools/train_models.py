"""Train the models that ship with the package, on synthetic data alone.

    python tools/train_models.py --work FOLDER [--workers 2] [--tracks]

Needs ``pip install 'doppelgait[torch]'`` and 20 minutes of two cores; ``--tracks`` trains one network of tracks
for all radars, some 6 hours. Written are the model files and cards of the package.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from doppelgait.classify.data import collect_inputs, collect_rows
from doppelgait.classify.evaluation import Fold, describe_model, evaluate, hold_back
from doppelgait.classify.learned import LabelledRows, Learned
from doppelgait.classify.model import Model
from doppelgait.classify.model_file import load_shipped_model, read_model_cards, save_model
from doppelgait.classify.network import train_track_network
from doppelgait.core.files import hash_file
from doppelgait.dataset import build_dataset, load_plan, open_dataset
from doppelgait.dataset.config import PlanConfig
from doppelgait.dataset.finish import DATA_VERSION
from doppelgait.dataset.open import Dataset

MODELS = Path(__file__).parents[1] / "src" / "doppelgait" / "classify" / "models"
PLANS = Path(__file__).parent / "plans"
LIFE, MORE, WIDE = "home-alarm-life", str(PLANS / "life-more.toml"), str(PLANS / "life-wide.toml")
RECORDINGS: dict[str, list[tuple[str, int, int, float]]] = {
    "x4": [(LIFE, seed, 20, 0.625 if seed < 103 else 1.25) for seed in range(101, 106)]
    + [(MORE, 111, 20, 1.25), (MORE, 112, 20, 1.25), (WIDE, 4001, 5, 1.25)],
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
WINDOWS = {"x4": 2000, "fmcw-24": 1000, "fmcw-60": 1500}  # examples of a class
TABLES = ("balanced_accuracy", "auc", "brier", "expected_calibration_error")


def plan_of(name: str, n_examples: int) -> PlanConfig:
    """Return the plan of windows that a model is trained on."""
    return load_plan(PLANS / f"windows-{name}.toml", overrides=[f"dataset.examples_per_class={n_examples}"])[0]


def life_of(name: str, plan: str, seed: int, n_recordings: int, hop_s: float) -> PlanConfig:
    """Return the plan of windows of life of a radar."""
    table = {"name": f'"home-alarm-life-{name}-{seed}"', "examples_per_class": n_recordings}
    stated = [f"dataset.{key}={value}" for key, value in {**table, "seed": seed, "hop_s": hop_s}.items()]
    return load_plan(plan, overrides=stated + OVERRIDES.get(name, []))[0]


def describe(model: Model) -> dict[str, Any]:
    """Return what a card says of every model."""
    conditions = {key: list(span) for key, span in model.facts.conditions.items()}
    return {"n_train": model.facts.n_train, "conditions": conditions}


def write(model: Model, card: dict[str, Any]) -> None:
    """Write a model of the package and its card."""
    path = save_model(model, MODELS / f"{card['name']}.npz")
    card |= {"sha256": hash_file(path)}
    path.with_suffix(".json").write_text(json.dumps(card, indent=2) + "\n", encoding="utf-8")


def train(dataset: Dataset, name: str) -> None:
    """Train the models of single windows on a dataset."""
    found = evaluate(dataset, models=["ensemble"], keep=True)
    model, scores = found.models["ensemble"], found.document["models"]["ensemble"]
    card = {
        "name": name,
        "data_version": DATA_VERSION,
        "licence": "Apache-2.0",
        "trained_on": "synthetic recordings of gait models alone; no motion capture, no recording of a radar",
        "dataset": dataset.description["id"],
        "classes": list(model.facts.classes),
        **describe(model),
        "synthetic_test": {key: scores[key] for key in TABLES if key in scores},
        "track": read_model_cards()[name]["track"],
    }
    write(replace(model, track=load_shipped_model(name).track), card)


def train_tracks(work: Path, workers: int | None) -> None:
    """Train the network of tracks on all datasets of life, for the models of all radars."""
    plans, datasets = [(name, *plan) for name, plans in RECORDINGS.items() for plan in plans], []
    for plan in plans:
        target = work / f"home-alarm-life-{plan[0]}-{plan[2]}"
        build_dataset(life_of(*plan), target, workers=workers, max_failed_share=0.02)
        datasets.append(open_dataset(target))
    rows = collect_rows(*datasets)
    table, of_radar = collect_inputs(rows, "track"), np.array([plan[0] for plan in plans])[rows.origin]
    everything, answers = np.arange(len(rows)), np.full((len(rows), len(rows.classes)), np.nan)

    def fit(part: Any) -> Learned:
        known, none = (LabelledRows(table.values[n], rows.labels[n]) for n in (part, part[:0]))
        return train_track_network(known, none, n_classes=answers.shape[1], seed=0)

    for part, held in islice(hold_back(rows, everything, 0), N_TURNS):
        answers[held] = fit(part).log_probability(table.values[held])
    network = fit(everything)
    for name in RECORDINGS:
        own = np.flatnonzero(of_radar == name)
        held = own[np.isfinite(answers[own, 0])]
        parts, known = Fold(name, own, held, own[:0]), answers[held]
        track = describe_model(rows, table, "track-network", parts, network, seed=0, answers=known)
        card = {"track": {"datasets": [one.description["id"] for one in datasets], **describe(track)}}
        write(replace(load_shipped_model(name), track=track), read_model_cards()[name] | card)


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work", type=Path, required=True, help="folder that keeps the datasets")
    parser.add_argument("--workers", type=int)
    parser.add_argument("--tracks", action="store_true", help="train the network of tracks alone")
    options = parser.parse_args()
    if options.tracks:
        train_tracks(options.work, options.workers)
    for name in WINDOWS if not options.tracks else ():
        target = options.work / f"shipped-{name}-{WINDOWS[name]}"
        build_dataset(plan_of(name, WINDOWS[name]), target, workers=options.workers, max_failed_share=0.02)
        train(open_dataset(target), name)


if __name__ == "__main__":
    main()
