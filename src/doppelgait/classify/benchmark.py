"""``doppelgait-bench-1``: alarms on frozen data.

A part of the benchmark is a dataset: its plan is frozen by its identity, which the data version and
the contents of recorded motion enter. A classifier is a function of the dataset to learn from and
of one to answer about. It returns the probability of a person after the window of every row, NaN where
the window is no evidence, from this and earlier windows of the recording alone.
"""

from __future__ import annotations

import hashlib
import runpy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from doppelgait.classify.alarm import answer_day, score_at_threshold
from doppelgait.classify.data import (
    ALARM_CLASS,
    SHARED,
    Rows,
    all_rows,
    collect_inputs,
    collect_rows,
    mark_shared,
    number_tracks,
)
from doppelgait.classify.evaluation import hold_back
from doppelgait.classify.learned import FloatArray, Inputs, LabelledRows, Learned, to_levels
from doppelgait.classify.model import ECHOES, Calibration, calibrate, mark_flagged, row_weights
from doppelgait.classify.model_file import open_model
from doppelgait.classify.network import NO_TORCH, is_torch_installed
from doppelgait.classify.options import BenchmarkOptions, takes_options
from doppelgait.classify.report import format_interval, format_number
from doppelgait.classify.scores import auc, auc_interval, score_calibration
from doppelgait.classify.timeline import follow_rows, fuse_rows
from doppelgait.classify.training import find_kind, fit
from doppelgait.core.config import validate
from doppelgait.core.errors import ConfigError, DatasetError
from doppelgait.dataset.build import build_dataset
from doppelgait.dataset.config import PlanConfig, load_plan
from doppelgait.dataset.finish import compute_dataset_id
from doppelgait.dataset.motions import expand_folders
from doppelgait.dataset.open import Dataset, open_dataset
from doppelgait.features import measure_windows
from doppelgait.processing.patches import N_SLICES

NAME = "doppelgait-bench-1"
MISSED = 0.05  # share of entries that are missed at the rate of false alarms in the table
LAW = {"total_m2": {"log_uniform": [0.015, 1.6]}}  # cross section of people and animals in the part ``matched``
MEASURED = "^(feature|extended|sd|quality|gait|window|carrier|prf)_|^(shard|row|split|track)$"
Answer = Callable[[Dataset, Dataset], FloatArray]


@dataclass(frozen=True)
class Part:
    """Plan of a part: built-in name, what differs, and its identity."""

    plan: str
    identity: str
    overrides: tuple[str, ...] = ()
    matched: bool = False
    recorded: bool = False


_TRAIN = ("dataset.examples_per_class=20", "dataset.seed=1001", "dataset.hop_s=1.25")
_MATCHED = ("dataset.examples_per_class=5", "dataset.seed=1002", "dataset.hop_s=0.5")
_FIELDS = 'dataset.fields=["pictures", "ti_frames"]'
PARTS: Mapping[str, Part] = {
    "train": Part("home-alarm-life", "4f2b64ef2dab7f04", (*_TRAIN, _FIELDS)),
    "life": Part(
        "home-alarm-test", "beedfd4892cdd97c", ("dataset.examples_per_class=12", "dataset.hop_s=0.5", _FIELDS)
    ),
    "matched": Part("home-alarm-test", "aaea7712806d8f1c", (*_MATCHED, _FIELDS), matched=True),
    "recorded": Part("home-alarm-recorded", "addd4243c9ea31a8", ("dataset.hop_s=0.5", _FIELDS), recorded=True),
}
"""``life`` has kinds that are unknown to ``train``, ``matched`` the same at levels that do not give the class, and
``recorded`` people and dogs of motion capture, whose files the user has."""


def load_part(name: str, folder: Path | None = None, changes: Sequence[str] = ()) -> PlanConfig:
    """Load the plan of a part; without changes, check that it is the frozen one."""
    part = PARTS[name]
    plan = load_plan(part.plan, overrides=[f"dataset.name={NAME}-{name}", *part.overrides, *changes])[0]
    if part.matched:
        plain = plan.model_dump(mode="python", exclude_unset=True)
        plan = validate(PlanConfig, {**plain, "episodes": match_levels(plain["episodes"])}, where=name)
    found = compute_dataset_id(expand_folders(plan, folder or Path()), folder or Path())
    if not changes and part.identity not in ("", found):
        raise ConfigError(f"{NAME}, {name}: identity {found}, not {part.identity}: other data cannot be compared")
    return plan


def match_levels(value: Any) -> Any:
    """Replace the cross section of people and animals, wherever a plan has them, by one law."""
    if isinstance(value, Mapping):
        found = {key: match_levels(each) for key, each in value.items()}
        return {**found, "rcs": LAW} if found.get("label") in ("human", "animal") else found
    return [match_levels(each) for each in value] if isinstance(value, list | tuple) else value


def build_part(
    name: str, directory: Path, *, folder: Path | None = None, changes: Sequence[str] = (), on_progress: Any = None
) -> Dataset:
    """Build a part of the benchmark, or what is missing of it."""
    plan = load_part(name, folder, changes)
    build_dataset(plan, directory, folder=folder, on_progress=on_progress, max_failed_share=0.02)
    return open_dataset(directory)


def identify_contents(dataset: Dataset) -> str:
    """Return the hash of rows and arrays, 16 hex digits; empty while examples are missing."""
    sums = dataset.directory / "SHA256SUMS"
    lines = sums.read_text(encoding="utf-8").splitlines() if sums.is_file() else []
    kept = sorted(line for line in lines if line.split()[-1].startswith(("index.parquet", "shards")))
    return hashlib.sha256("\n".join(kept).encode()).hexdigest()[:16] if kept else ""


def score_part(dataset: Dataset, probability: FloatArray) -> dict[str, Any]:
    """Score answers: the end of every track, and the alarm where five of a hundred entries are missed."""
    given = np.asarray(probability, dtype=object)
    probability = pd.to_numeric(pd.Series(given.ravel()), errors="coerce").to_numpy(dtype=np.float64)
    known, missing = np.isfinite(probability), pd.isna(given.ravel())
    right = missing | (np.abs(probability - 0.5) <= 0.5)
    if given.shape != (len(dataset),) or not known.any() or not right.all():
        raise ConfigError(
            f"a classifier must answer {len(dataset)} rows of {dataset.directory} by 0 to 1, or some by NaN"
        )
    index = dataset.index.assign(p=probability, number=number_tracks(all_rows(dataset, ())))
    index = index[known & ~mark_shared(index)].sort_values("window_stop_s")
    ends = index.groupby("number").tail(1)
    values, human = ends["p"].to_numpy(dtype=np.float64), (ends["label"] == ALARM_CLASS).to_numpy(dtype=bool)
    scenes, right = ends["scene_id"].to_numpy(dtype=str), (values >= 0.5) == human
    weights = row_weights(human.astype(np.int64), 2)
    calibrated = score_calibration(np.maximum(values, 1.0 - values), right, weights, 0.5)
    low, high = auc_interval(values, human, scenes, seed=0) or (None, None)
    day, answers = dataset.plan_config, answer_day(dataset, probability)
    wanted = answers["label"].isin([one.label for one in day.episodes if one.should_trigger])
    best = answers[wanted].groupby("scene")["score"].max().clip(lower=1e-12).sort_values()
    return {
        "tracks": len(ends),
        "auc": {"value": auc(values, human), "low": low, "high": high},
        "expected_calibration_error": calibrated["expected_calibration_error"],
        "alarm": score_at_threshold(day, answers, float(best.iloc[int(MISSED * len(best))])),
    }


# Classifiers ---------------------------------------------------------------------------------------------------------


def open_classifier(name: str) -> Answer:
    """Return a classifier: a baseline, ``FILE.py:FUNCTION``, or a model by name or file."""
    if name == "spectrogram" and not is_torch_installed():
        raise DatasetError(NO_TORCH)
    if name in BASELINES:
        return partial(answer_baseline, name)
    path, _, function = name.rpartition(":")
    if path.endswith(".py"):
        found: Answer = runpy.run_path(path).get(function) if Path(path).is_file() else None  # type: ignore[assignment]
        if not callable(found):
            raise ConfigError(f"--classifier {name}: no such file or function (FILE.py:FUNCTION)")

        def answer_blind(train: Dataset, test: Dataset) -> FloatArray:
            index = test.index.filter(regex=MEASURED).assign(label="hidden")  # names tell the kinds
            names = {key: pd.factorize(test.index[key])[0].astype(str) for key in ("id", "scene_id")}
            facts = {**test.description, "classes": {"hidden": 0}, "config": None}
            return found(train, replace(test, index=index.assign(**names), description=facts))

        return answer_blind
    model = open_model(name).of_tracks
    if ALARM_CLASS not in model.facts.classes or "signature" in model.facts.features:
        raise ConfigError(f"--classifier {name}: must have the class {ALARM_CLASS}, and use no signatures")
    return lambda _, test: follow_rows(test, model)[:, model.facts.classes.index(ALARM_CLASS)]


@cache
def train_baseline(name: str, train: Dataset) -> tuple[Learned, Calibration]:
    """Train a baseline on single windows."""
    rows, (measure, trainer) = collect_rows(train), BASELINES[name]
    values = measure(rows)
    sides = next(hold_back(rows, np.arange(len(rows)), 0))
    parts = [LabelledRows(values[side], rows.labels[side]) for side in sides]
    learned = fit(find_kind(trainer), *parts, n_classes=len(rows.classes), seed=0)
    return learned, calibrate(learned.log_probability(parts[1].values), parts[1].labels)


def answer_baseline(name: str, train: Dataset, test: Dataset) -> FloatArray:
    """Answer by a trained baseline; the answers to single windows are fused by track."""
    (learned, calibration), (measure, trainer) = train_baseline(name, train), BASELINES[name]
    rows, followed = all_rows(test, collect_rows(train).classes), trainer == "track-network"
    kept = ~mark_flagged(test.index, ECHOES, SHARED if followed else None)
    probability = np.full((len(rows), len(rows.classes)), np.nan)
    probability[kept] = calibration(learned.log_probability(measure(rows)[kept]))
    if not followed:
        probability = fuse_rows(rows, probability, calibration.n_rows)
    return probability[:, rows.classes.index(ALARM_CLASS)]


def _measure_stored(rows: Rows, field: str, measure: Callable[[Any], Inputs], n_values: int = 0) -> Inputs:
    # values (n, n_values) of a stored array of every row, NaN where it is empty; or objects, None
    found = np.full((len(rows), n_values), np.nan) if n_values else np.empty(len(rows), dtype=object)
    for number, (origin, place) in enumerate(zip(rows.origin.tolist(), rows.place.tolist(), strict=True)):
        values = rows.datasets[origin].stored(place, field)
        if values is not None and values.size:
            found[number] = measure(values)
    return found


BASELINES: Mapping[str, tuple[Callable[[Rows], Inputs], str]] = {
    "brightness": (  # six order statistics of the levels, which show no gait
        lambda rows: _measure_stored(rows, "pictures", lambda v: np.quantile(v, (0.1, 0.25, 0.5, 0.75, 0.9, 0.99)), 6),
        "extended-boosting",
    ),
    "four-numbers": (
        lambda rows: _measure_stored(rows, "ti_frames", lambda v: measure_windows(v)[0], 8),
        "extended-boosting",
    ),
    "six-features": (lambda rows: collect_inputs(rows, "six").values, "extended-boosting"),
    "spectrogram": (
        lambda rows: _measure_stored(rows, "pictures", lambda v: to_levels(v[0, N_SLICES // 2]).T),
        "signature-network",
    ),
    "track": (lambda rows: collect_inputs(rows, "track").values, "track-network"),
}
"""Baselines: what they measure in a window, and how they are trained on ``train``."""


@takes_options(BenchmarkOptions)
def score_classifiers(folder: Path, *, report: Callable[[str], Any], **options: Any) -> dict[str, Any]:
    """Build the benchmark in a folder and score classifiers on it."""
    chosen, built, identities = BenchmarkOptions(**options), {}, []
    answers = {name: open_classifier(name) for name in chosen.classifier or BASELINES}
    used = [name for name, part in PARTS.items() if chosen.recordings or not part.recorded]
    used = used if any(name in BASELINES or ".py:" in name for name in answers) else used[1:]
    changes = ["dataset.examples_per_class=1"] if chosen.rehearse else []
    folder = folder / "rehearsal" if chosen.rehearse else folder
    for name in used:  # faults come before hours of work
        load_part(name, chosen.recordings, changes)
    build = partial(build_part, folder=chosen.recordings, changes=changes)
    for name in used:
        with report(name) as tell:
            one = built[name] = build(name, folder / name, on_progress=tell)
        identities.append({"part": name, "identity": one.description["id"], "contents": identify_contents(one)})
    train = built.pop("train", next(iter(built.values())))
    scores = {
        name: {part: score_part(dataset, answer(train, dataset)) for part, dataset in built.items()}
        for name, answer in answers.items()
    }
    return {"benchmark": NAME, "parts": identities, "scores": scores}


def format_scores(name: str, scores: Mapping[str, Mapping[str, Any]]) -> dict[str, str]:
    """Format a row of the table, of the scores of parts."""
    row = {"classifier": name}
    for part, found in scores.items():
        area, rate = found["auc"], found["alarm"].get("false_per_animal_hour")
        row[f"{part}: AUC"] = format_interval(area)
        row[f"{part}: ECE"] = format_number(found["expected_calibration_error"])
        row[f"{part}: false/h"] = "-" if rate is None else "{value:.1f} ({low:.1f} to {high:.1f})".format(**rate)
    return row
