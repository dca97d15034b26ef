"""Test the models that ship with the package on recorded targets.

    python studies/shipped_models.py MOTION_FOLDER OUT_FOLDER [--examples 300] [--write]

For every model (``tools/train_models.py``) people and dogs of motion capture are simulated with its own plan: radar,
rooms, noise. Nothing is chosen by the scores. With ``--write`` the table goes into the model's card.

Complete datasets in OUT_FOLDER are taken as they are: empty it after a change of the package.
"""

from __future__ import annotations

import argparse
import json
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from classification import CLASSES, SOURCES, with_half

from doppelgait.classify.data import collect_inputs, collect_rows
from doppelgait.classify.model import Model, blocked_rows
from doppelgait.classify.model_file import FOLDER, load_shipped_model, read_model_cards
from doppelgait.core.config import validate
from doppelgait.dataset import build_dataset, open_dataset
from doppelgait.dataset.config import PlanConfig
from doppelgait.dataset.open import Dataset

sys.path.insert(0, str(Path(__file__).parents[1] / "tools"))


def recorded(name: str, folder: Path, out: Path, n_examples: int) -> Dataset:
    """Build recorded people and dogs under the conditions of a model's plan."""
    target = out / f"recorded-{name}-{n_examples}"
    train_models: Any = import_module("train_models")
    table = train_models.plan_of(name, n_examples).model_dump(mode="python")
    table["dataset"].update(name=f"recorded-{name}", seed=2026, fractions={"test": 1.0})
    table["classes"] = [CLASSES[0], CLASSES[1] | {"label": train_models.ANIMAL}]
    table["sources"] = SOURCES
    # a galloping dog leaves the frame of a short radar: its examples fail and are left out
    build_dataset(validate(PlanConfig, table, where=name), target, folder=folder, max_failed_share=0.5)
    return open_dataset(target)


def answers(model: Model, tested: Dataset, folder: Path) -> pd.DataFrame:
    """Return the tested rows with ``right``, ``decided`` and ``half``."""
    rows = collect_rows(tested)
    order = [model.facts.classes.index(label) for label in rows.classes]
    values = collect_inputs(rows, model.facts.features).values
    probability = model.probability(values)[:, order]
    sure = probability.max(axis=1) >= model.facts.abstain_below
    index = rows.index.assign(
        right=probability.argmax(axis=1) == rows.labels,
        decided=sure & ~blocked_rows(rows, np.arange(len(rows)), values, model),
    )
    dogs = index["label"].replace({"animal": "dog"})
    return with_half(index.assign(label=dogs), folder)


def summary(rows: pd.DataFrame) -> dict[str, Any]:
    """Return recalls, and the share decided with its own recall, by class; the mean of both classes."""
    found: dict[str, Any] = {}
    for label, part in rows.groupby("label"):
        sure = part[part["decided"]]
        found[str(label)] = {
            "rows": len(part), "movers": int(part["subject"].nunique()), "right": round(float(part["right"].mean()), 3),
            "decided": round(float(part["decided"].mean()), 3),
            "right_of_decided": round(float(sure["right"].mean()), 3) if len(sure) else None,
        }  # fmt: skip
    found["balanced_accuracy"] = round(float(np.mean([part["right"] for part in found.values()])), 3)
    return found


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("motion_folder", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--examples", type=int, default=300, help="of a class")
    parser.add_argument("--write", action="store_true", help="write the scores into the cards")
    options = parser.parse_args()
    folder = options.motion_folder.absolute()
    for name, card in read_model_cards().items():
        rows = answers(load_shipped_model(name), recorded(name, folder, options.out, options.examples), folder)
        found: dict[str, Any] = {"all": summary(rows)}
        found |= {half: summary(part) for half, part in rows.groupby("half")}
        found["by_gait"] = {
            " ".join(map(str, key)): {"rows": len(part), "right": round(float(part["right"].mean()), 3)}
            for key, part in rows.groupby(["label", "truth_gait"])
        }
        print(name, json.dumps(found, indent=2))
        if options.write:
            path = FOLDER / f"{name}.json"
            path.write_text(json.dumps(card | {"recorded_movers": found}, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
