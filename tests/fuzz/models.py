"""Model files with damage: refused, or a model that gives probabilities."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from readers import Target, main_file

from doppelgait.classify.learned import Learned, join_inputs
from doppelgait.classify.model_file import load_model, load_shipped_model, save_model

LARGEST_PICTURE = 128 * 128


def model_seeds(folder: Path) -> None:
    """Models of every kind: the parts of one that comes with the package."""
    whole = load_shipped_model("x4")
    assert whole.learned.kind == "ensemble"
    log_share = np.log(np.full(len(whole.facts.classes), 1.0 / len(whole.facts.classes)))
    parts = [*whole.learned.members, Learned("constant", {"log_share": log_share})]
    for name, part in {part.kind: part for part in parts}.items():
        facts, spans, novelty = whole.facts, (whole.lowest, whole.highest, whole.unknown), whole.novelty
        if name == "network":
            facts, spans, novelty = facts.replace(features="signature", names=()), (np.zeros(0),) * 3, None
        else:
            facts = facts.replace(features="extended")
        (folder / name).mkdir(parents=True)
        model = replace(whole, facts=facts, learned=part, lowest=spans[0], highest=spans[1], unknown=spans[2],
                        novelty=novelty)  # fmt: skip
        save_model(model, folder / name / "model.npz")
    (folder / "ensemble").mkdir()
    arrays = {name: values[[0, -1]] for name, values in whole.learned.arrays.items()}
    few = replace(whole.learned, arrays=arrays, members=whole.learned.members[:1] + whole.learned.members[-1:])
    save_model(replace(whole, learned=few), folder / "ensemble" / "model.npz")


def run_model(folder: Path) -> None:
    """Load a model and let it decide on a few rows, one of them without any feature."""
    model = load_model(main_file(folder, ""))
    rng = np.random.default_rng(0)
    features: Any = np.vstack(
        [rng.normal(1.0, 1.0, (2, len(model.facts.names))), np.full(len(model.facts.names), np.nan)]
    )
    networks = [part for part in (model.learned, *model.learned.members) if part.kind == "network"]
    if any(part.patch.n_velocity * part.patch.n_time > LARGEST_PICTURE for part in networks):
        return
    values = features
    if networks:
        pictures = np.empty(3, dtype=object)
        for number in range(2):
            pictures[number] = rng.random((networks[0].patch.n_velocity, networks[0].patch.n_time)).astype(np.float32)
        same = {(part.patch.n_velocity, part.patch.n_time) for part in networks}
        if len(same) > 1:
            return
        values = join_inputs(features, pictures) if model.learned.members else pictures
    probability = model.probability(values)
    assert probability.shape == (3, len(model.facts.classes)), f"shape {probability.shape}"
    assert np.isfinite(probability).all(), "probabilities are not finite"
    assert np.allclose(probability.sum(axis=1), 1.0), "probabilities do not sum to 1"
    assert np.isfinite(model.rank(values)).all(), "ranks are not finite"
    model.describe_outside(values[:1])


TARGETS = {"model": Target(model_seeds, run_model, 20)}
