"""Contract checks of features, classifiers and exporters."""

from __future__ import annotations

import math
import pickle
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from doppelgait.testing.contracts import require, require_close, require_registered

if TYPE_CHECKING:
    import xarray as xr

    from doppelgait.dataset import Dataset


def check_feature(name: str) -> None:
    """Check the contract of a feature, :data:`doppelgait.features.FEATURES`.

    An ``AssertionError`` names the broken rule: registration, a plain number or None, the same
    value for the same signature, a signature that is left alone, no dependence on the level of the
    signal, no value without a signal.

    >>> import doppelgait as dg
    >>> dg.testing.check_feature("limb_share")
    """
    from dataclasses import replace

    from doppelgait.core.plugins import Plugin
    from doppelgait.features import FEATURES, Observation
    from doppelgait.pipeline.target import observe
    from doppelgait.processing import Analysis

    label = require_registered(FEATURES, "feature", name)
    feature: Plugin[Any] = FEATURES[name]
    needs = feature.facts.get("needs", ())

    def measure(observed: Observation) -> float | None:
        if observed.describe_missing(needs):
            return None
        before = observed.power_v2.copy(), observed.aligned.values.copy()
        value = feature.run(observed)
        unchanged = np.array_equal(before[0], observed.power_v2) and np.array_equal(before[1], observed.aligned.values)
        require(unchanged, f"{label}: changes the signature")
        text = f"{label}: gives {value!r}; it must be a number or None"
        require(value is None or (isinstance(value, int | float | np.number) and np.ndim(value) == 0), text)
        return None if value is None else float(value)

    mu = _make_walking_signature()
    first, louder = (observe(mu.copy(data=mu.values * gain), Analysis()) for gain in (np.float32(1), np.float32(4)))
    value = measure(first)
    same = all(_is_same_number(value, measure(seen)) for seen in (first, observe(mu, Analysis())))
    require(same, f"{label}: changes from call to call")
    text = f"{label}: four times the power changes {value} to"
    require(_is_same_number(value, loud := measure(louder)), f"{text} {loud}")
    if "set_f" in feature.facts:
        return
    empty = replace(first, extraction=replace(first.extraction, torso_doppler_hz=None))
    require(empty.describe_missing(needs) is not None, f"{label}: is measured without a signal")


def _is_same_number(one: float | None, other: float | None) -> bool:
    if one is None or other is None:
        return one is other
    return math.isclose(one, other, rel_tol=1e-3, abs_tol=1e-6) or (math.isnan(one) and math.isnan(other))


@lru_cache(maxsize=1)
def _make_walking_signature() -> xr.DataArray:
    """Simulate the signature of a walk inside the frame."""
    from doppelgait.core.rng import Streams
    from doppelgait.motion import boulic_walk
    from doppelgait.pipeline import analyze, simulate
    from doppelgait.radar import Radar
    from doppelgait.scene import Scene, Target

    scene = Scene([Target(boulic_walk(speed_mps=1.3, duration_s=3.1), label="human", range_m=6.0)], duration_s=3.0)
    recording = simulate(scene, Radar.preset("x4"), rng=Streams(5), snr_db=25.0, angles=False)
    return analyze(recording, gate="truth")[0].signature


def check_classifier(name: str, *, seed: int = 0) -> None:
    """Check the contract of a classifier, :data:`doppelgait.classify.training.Trainer`.

    It is trained on artificial rows from ``seed``. An ``AssertionError`` names the broken rule:
    registration, a result in one of the forms that a model file keeps, probabilities of two and of
    three classes, unknown values, no held-out rows, the same model for the same seed, inputs left
    alone, classes that are easily separated.

    >>> import doppelgait as dg
    >>> dg.testing.check_classifier("six-logistic")
    """
    from doppelgait.classify.learned import LabelledRows, Learned
    from doppelgait.classify.training import CLASSIFIERS

    label = require_registered(CLASSIFIERS, "classifier", name)
    train = CLASSIFIERS[name].run
    features, baseline = CLASSIFIERS[name].facts.get("features"), CLASSIFIERS[name].facts.get("baseline", False)
    for n_classes in (2, 3):
        rows, held = (_classifier_rows(str(features), n_classes, number, seed) for number in (48, 24))
        before = pickle.dumps(rows.values)
        learned = train(rows, held, n_classes=n_classes, seed=1)
        require(isinstance(learned, Learned), f"{label}: gives {type(learned).__name__}, not one of {Learned}")
        require(pickle.dumps(rows.values) == before, f"{label}: training changes its inputs")
        found = learned.log_probability(held.values)
        shape = (held.labels.size, n_classes)
        require(found.shape == shape, f"{label}: log_probability gives the shape {found.shape}, not {shape}")
        require(np.isfinite(found).all(), f"{label}: a log-probability is not finite")
        require_close(
            np.exp(found).sum(axis=1), np.ones(len(found)), f"{label}: probabilities do not add up to 1", 1e-6
        )
        again = train(rows, held, n_classes=n_classes, seed=1).log_probability(held.values)
        require(np.array_equal(found, again), f"{label}: the same seed and rows give another model")
        empty = LabelledRows(held.values[:0], held.labels[:0])
        alone = train(rows, empty, n_classes=n_classes, seed=1).log_probability(held.values)
        require(np.isfinite(alone).all(), f"{label}: without held-out rows a log-probability is not finite")
        if not baseline:
            whole = np.array([row is not None and not np.isnan(row[:1].astype(float)).any() for row in held.values])
            right = float((found.argmax(axis=1) == held.labels)[whole].mean())
            require(right > 0.8, f"{label}: only {right:.0%} of rows right, where the classes are far apart")


def _classifier_rows(features: str, n_classes: int, count: int, seed: int) -> Any:
    """Make rows of well-separated classes, a few with missing values."""
    from doppelgait.classify.learned import LabelledRows, Seen, join_inputs
    from doppelgait.processing.patches import N_CELLS, N_COLUMNS, N_SLICES, Patch

    rng = np.random.default_rng([seed, n_classes, count])
    labels = np.arange(count, dtype=np.int64) % n_classes
    if features == "signature":
        patch = Patch()
        values = np.empty(count, dtype=object)
        band = patch.n_velocity // (n_classes + 1)
        for number, label in enumerate(labels):
            levels = rng.uniform(0.0, 0.2, (patch.n_velocity, patch.n_time)).astype(np.float32)
            levels[: band * (label + 1)] += np.float32(0.7)
            values[number] = levels
        values[-1] = None
        return LabelledRows(values, labels)
    width = {"six": 6, "extended": 9, "track": 9, "speed": 1, "nuisance": 5, "nothing": 0}[features]
    table = rng.standard_normal((count, width)) + 6.0 * labels[:, None]
    if width > 1:
        table[rng.random(table.shape) < 0.05] = np.nan
        table[:, -1] = np.nan  # always unknown
    if features == "track":
        pictures = rng.integers(0, 40, (count, 1, N_SLICES, N_COLUMNS, N_CELLS), dtype=np.uint8)
        tracks = np.arange(count) // (2 * n_classes) * n_classes + labels
        table = join_inputs(table, np.fromiter(map(Seen, pictures, tracks.tolist(), range(count)), dtype=object))
    return LabelledRows(table, labels)


def check_exporter(kind: str, dataset: Dataset) -> None:
    """Check the contract of an exporter, :data:`doppelgait.dataset.export.EXPORTERS`.

    ``dataset`` has rows and keeps the fields that the exporter needs. An ``AssertionError`` names
    the broken rule: registration, parameters with defaults, the number of rows that are done,
    files that do not depend on when they are written, nothing outside of the folder.

    >>> import doppelgait as dg
    >>> from doppelgait.dataset import PlanConfig
    >>> walk = {"label": "human", "motion": {"kind": "boulic"}}
    >>> table = {"name": "tiny", "examples_per_class": 2, "fractions": {"train": 0.5, "test": 0.5}}
    >>> scene, target = {"duration_s": 1.0}, {"range_m": 3.0}
    >>> parts = {"dataset": table, "scene": scene, "target": target, "classes": [walk]}
    >>> plan = PlanConfig.model_validate(parts)
    >>> report = dg.dataset.build_dataset(plan, "tiny", executor="serial")
    >>> dg.testing.check_exporter("csv", dg.open_dataset("tiny"))
    """
    from doppelgait.core.files import hash_file
    from doppelgait.dataset.export import EXPORTERS, export_dataset

    def hashes(folder: Path) -> dict[str, str]:
        return {str(p.relative_to(folder)): hash_file(p) for p in sorted(folder.rglob("*")) if p.is_file()}

    name = require_registered(EXPORTERS, "exporter", kind)
    parameters = EXPORTERS.parse(kind)  # all of them need a default
    require(EXPORTERS.parse(parameters.model_dump(mode="json")) == parameters, f"{name}: other parameters after JSON")
    require(len(dataset) > 0, f"{name}: the dataset of the check has no rows")
    before = hashes(dataset.directory)
    with TemporaryDirectory() as folder:
        found, done = [], {"rows": 0}
        for attempt in ("one", "two"):
            done["rows"] = 0
            report = export_dataset(
                dataset, Path(folder) / attempt, form=kind, on_progress=lambda rows, _: done.update(rows=rows)
            )
            require(done["rows"] == len(dataset), f"{name}: counts {done['rows']} of {len(dataset)} rows as done")
            require(report.n_files > 2, f"{name}: writes no file")
            require(sorted(p.name for p in Path(folder).iterdir())[-1] == attempt, f"{name}: leaves files elsewhere")
            found.append(hashes(Path(folder) / attempt))
        require(found[0] == found[1], f"{name}: the same dataset gives other files")
    require(hashes(dataset.directory) == before, f"{name}: changes the dataset")
