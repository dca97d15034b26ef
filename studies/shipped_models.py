"""Models that ship with the package, tested on recorded targets.

    python studies/shipped_models.py MOTION_FOLDER OUT --page

Question: how many recorded people and dogs do the shipped models recognise under the conditions of their own plans?

For every model (`tools/train_models.py`) people and dogs of motion capture are simulated with its own plan: radar,
rooms, noise. Nothing is chosen by the scores. With `--write` the scores go into the model's card. Complete datasets in
OUT are taken as they are: empty it after a change of the package. It takes about 5 minutes of one core.

Not shown: real recordings.
"""

from __future__ import annotations

import json
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from classification import CLASSES, SOURCES, with_half
from harness import finish, make_parser, markdown

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
    table["classes"] = [CLASSES[0], CLASSES[1] | {"label": "animal"}]
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
        decided=sure & ~blocked_rows(rows, values, model),
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
    """Test every model and write the table."""
    parser = make_parser(__doc__, motion_folder="folder of the recordings", out="folder for the datasets")
    parser.add_argument("--examples", type=int, default=300, help="of a class")
    parser.add_argument("--write", action="store_true", help="write the scores into the cards")
    options = parser.parse_args()
    folder, lines = options.motion_folder.absolute(), []
    for name, card in read_model_cards().items():
        rows = answers(load_shipped_model(name), recorded(name, folder, options.out, options.examples), folder)
        found: dict[str, Any] = {"all": summary(rows)}
        found |= {half: summary(part) for half, part in rows.groupby("half")}
        found["by_gait"] = {
            " ".join(map(str, key)): {"rows": len(part), "right": round(float(part["right"].mean()), 3)}
            for key, part in rows.groupby(["label", "truth_gait"])
        }
        for part in ("all", "held", "tuning"):
            own = [f"{own['right']} ({own['movers']} subjects)" for own in (found[part]["human"], found[part]["dog"])]
            lines.append((name, part, *own, found[part]["human"]["decided"], found[part]["dog"]["decided"]))
        lines += [(name, gait, own["right"], own["rows"], "", "") for gait, own in found["by_gait"].items()]
        if options.write:
            path = FOLDER / f"{name}.json"
            path.write_text(json.dumps(card | {"recorded_movers": found}, indent=2) + "\n", encoding="utf-8")
    head = ("model", "rows", "people right, or of this gait", "dogs right, or rows", "people decided", "dogs decided")
    finish(__file__, __doc__, {"Share of recorded targets": markdown(head, lines)}, page=options.page)


if __name__ == "__main__":
    main()
