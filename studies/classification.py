"""Recorded test data and scores of the studies of classifiers.

Datasets are built after ``plans/evidence.toml``. The reference conditions (:func:`easy`) were written down before any
score. The *held* half are people and the dog that the models were not made of (:func:`with_half`).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from recorded_motion import Clip, is_tuning

from doppelgait.classify.evaluation import Evaluation
from doppelgait.classify.scores import CONDITIONS, balanced_accuracy, find_condition_values
from doppelgait.core.config import validate
from doppelgait.dataset import build_dataset, load_plan, open_dataset
from doppelgait.dataset.config import PlanConfig
from doppelgait.dataset.open import Dataset

PLAN = Path(__file__).parent / "plans" / "evidence.toml"
MAIN_S = 4.0
SIZE = 1500
"""Examples of a class."""
SOURCES = [
    {"files": "human/*/cmu_*", "subject": r"/(cmu_\d+)_", "licence": ""},
    {"files": "human/*/bandai2_*", "subject": "/(bandai2)_", "licence": ""},
    {"files": "clinic/*", "subject": r"Subject([A-D]\d+)_", "licence": ""},
    {"files": "dog/*", "subject": "dog/([a-z]+)-", "licence": ""},
]
"""Who is who in the recordings; a file of none of these is a subject of its own."""
CLASSES = [
    {"label": "human", "motion": {"choice": [{"kind": "folder", "path": path} for path in ("human", "clinic")]}},
    {"label": "dog", "motion": {"kind": "folder", "path": "dog"}},
]
TUNING_DOG = "mann"
"""The dog that the quadruped's curves were made of."""
MIN_PERIODS, WIDEST_DEG, MIN_SNR_DB = 3.0, 30.0, 15.0
HALVES = ("held", "tuning")


def easy(index: pd.DataFrame) -> pd.Series:
    """Mark rows with 3 periods or more, within 30 degrees, SNR_mu of 15 dB or more."""
    aspect = CONDITIONS[1]
    _, aspect_deg = find_condition_values(index, aspect)
    periods = index["truth_gait_frequency_hz"] * index["observation_s"]
    near = pd.Series(aspect_deg <= WIDEST_DEG, index=index.index)
    return (periods >= MIN_PERIODS) & near & (index["quality_snr_mu_db"] >= MIN_SNR_DB)


def with_half(index: pd.DataFrame, folder: Path) -> pd.DataFrame:
    """Add the half of each recording to the index: held or tuning."""

    def half(label: str, recording: str) -> str:
        tuning = TUNING_DOG in recording if label == "dog" else is_tuning(Clip(recording, ""), folder)
        return "tuning" if tuning else "held"

    return index.assign(half=[half(*row) for row in zip(index["label"], index["recording"], strict=True)])


def build_recorded(folder: Path, out: Path, *, share: float) -> Dataset:
    """Build or resume the dataset of all straight segments of all recordings, each several times."""
    target = out / f"mocap-{MAIN_S:g}s"
    if (target / "dataset.json").is_file() and open_dataset(target).description.get("complete"):
        return open_dataset(target)
    count = max(int(SIZE * share), 20)
    plan, _ = load_plan(PLAN, overrides=[f"scene.duration_s={MAIN_S}", f"dataset.examples_per_class={count}"])
    table = plan.model_dump(mode="python")
    table["dataset"].update(name="evidence-mocap", seed=2026, fractions={"test": 1.0})
    table.update(classes=CLASSES, sources=SOURCES)
    plan = validate(PlanConfig, table, where="evidence-mocap")
    build_dataset(plan, target, folder=folder, max_failed_share=0.02)
    return open_dataset(target)


def joined(found: Evaluation, tested: Dataset) -> pd.DataFrame:
    """Return the tested rows with the predictions of every model, columns ``right:NAME`` and ``p:NAME``."""
    answers = found.answers.set_index("id")
    index = tested.index.set_index("id").loc[answers.index]
    for name in found.document["models"]:
        index[f"right:{name}"] = answers[f"{name}:class"] == answers["label"]
        index[f"p:{name}"] = answers[f"{name}:human"]
    return index


def score(index: pd.DataFrame, name: str) -> float:
    """Return the balanced accuracy of some rows."""
    labels = (index["label"] == "dog").to_numpy(dtype=np.int64)
    return float(balanced_accuracy(labels, index[f"right:{name}"].to_numpy(dtype=bool), 2))
