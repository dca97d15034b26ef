"""Compare real recordings with those simulated from a sensor model.

A classifier that separates them well reveals deficiencies of the sensor model. Its inputs describe
the sensor and not the classes of targets.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from doppelgait.classify.scores import auc, bootstrap_auc
from doppelgait.core.errors import AnalysisError
from doppelgait.core.labels import BASEBAND, make_array
from doppelgait.core.units import FloatArray, power_to_db
from doppelgait.dataset.config import PlanConfig
from doppelgait.dataset.resolve import resolve_example
from doppelgait.pipeline import parse_run, run_simulation
from doppelgait.radar.fit.measure import compute_windowed_power
from doppelgait.radar.parameters import Radar
from doppelgait.radar.recording import Recording

WINDOW = 32  # pulses in a window of a continuous recording; otherwise each burst is a window
BANDS = 8  # number of Doppler bands of a window, from the minimum to the maximum frequency
MOST_WINDOWS = 60  # maximum number of windows of a recording, evenly spread
FOLDS = 5
FEW = 4
"""Number of recordings of a kind below which parts of recordings are held out instead of whole recordings."""
REPLICATES = 500
LEVELS = ("static", "moving", "largest", "constant")
"""Prefixes of the statistics that depend on the scale of the file; the others depend only on the shape of the data."""


def simulate_like(
    recordings: Sequence[Recording],
    preset: str | Path,
    *,
    plan: PlanConfig | None = None,
    folder: Path | None = None,
    seed: int = 0,
) -> list[Recording]:
    """Simulate a recording like each real one."""
    found, source = [], str(Path(preset).absolute()) if str(preset).endswith(".toml") else str(preset)
    for number, real in enumerate(recordings):
        times_s, own = real.slow_time_s - real.slow_time_s[0], Radar.preset(source)
        # simulate without pauses, then select the pulses of the recording
        radar: dict[str, Any] = {"preset": source, "prf_hz": real.radar.prf_hz}
        radar |= {"burst_pulses": None, "burst_period_s": None} if own.burst_pulses else {}
        if real.n_range_bins > 1:
            start_m = max(float(real.range_m[0]), 0.0)
            stop_m = start_m + (real.n_range_bins - 0.5) * own.bin_spacing_m
            radar |= {"range_start_m": start_m, "range_stop_m": stop_m}
        duration_s = float(times_s[-1]) + 2.0 / real.radar.prf_hz
        if plan is None:
            run = parse_run({"duration_s": duration_s, "radar": radar, "seed": seed, "example": number})
        else:
            dataset = plan.dataset.model_copy(update={"seed": seed})
            scene = {**plan.scene, "duration_s": duration_s}
            of_one = plan.model_copy(update={"dataset": dataset, "radar": radar, "scene": scene})
            # beyond the examples of the plan the classes alternate
            beyond = sum(plan.count_class_examples(section) for section in plan.sections) + number
            run = resolve_example(of_one, beyond, folder or Path()).run
        made = run_simulation(run, folder=folder, angles=False)
        chosen = np.minimum(np.round(times_s * real.radar.prf_hz).astype(int), made.n_pulses - 1)
        coords = {"slow_time": real.slow_time_s, "range": made.range_m}
        facts = {name: value for name, value in real.facts.items() if name == "burst_pulses"}
        baseband = make_array(BASEBAND, made.samples.matrix[chosen], coords, facts)
        found.append(Recording.from_baseband(baseband, run.radar, source=f"simulated {number}"))
    return found


def split_windows(recording: Recording, *, most: int = WINDOW) -> npt.NDArray[np.complex128]:
    """Split a recording into windows of pulses."""
    pulses = recording.n_pulses
    window = int(recording.facts.get("burst_pulses", min(most, pulses // 4)))
    if window < 8 or pulses < 2 * window:
        raise AnalysisError(
            f"{recording.source}: {pulses} pulses are too few to compare: 32 are needed, or two bursts of at least 8"
        )
    samples = np.asarray(recording.samples.matrix, dtype=np.complex128)
    return samples[: pulses // window * window].reshape(-1, window, recording.n_range_bins)


def measure_windows(recording: Recording) -> list[dict[str, float]]:
    """Return the statistics of windows for the classifier."""
    windows, samples = split_windows(recording), recording.samples.matrix
    parts = windows[np.unique(np.linspace(0, len(windows) - 1, min(len(windows), MOST_WINDOWS)).astype(int))]
    f_hz, power, spectra = compute_windowed_power(parts, recording.radar.prf_hz)
    full = max(float(np.abs(samples.real).max()), float(np.abs(samples.imag).max()))
    means, steps = parts.mean(axis=1), np.diff(parts, axis=1)
    rest, size = np.abs(parts - means[:, None]), np.maximum(np.abs(parts.real), np.abs(parts.imag))
    moving = np.mean(rest**2, axis=1)
    many = moving.shape[1] >= 4
    found: dict[str, FloatArray] = {}
    for share in (0.1, 0.5, 0.9) if many else (0.5,):
        for name, level in (("static", np.abs(means) ** 2), ("moving", moving)):
            found[f"{name} level, {100 * share:.0f} % of the bins"] = _db(np.quantile(level, share, axis=1))
    found["largest value"] = _db(size.max(axis=(1, 2)) ** 2)
    if not many:
        constant = parts.mean(axis=(1, 2))
        found["constant, I"], found["constant, Q"] = constant.real, constant.imag
    relative = power[:, np.argsort(f_hz)] / np.maximum(power.mean(axis=1, keepdims=True), 1e-300)
    for band, values in enumerate(np.array_split(np.median(relative, axis=2), BANDS, axis=1)):
        found[f"Doppler band {band + 1} of {BANDS}"] = _db(np.mean(values, axis=1))
    best = spectra[np.arange(len(parts)), 1:, np.argmax(moving, axis=1)]
    square = np.sum(best * best[:, ::-1], axis=1) / np.maximum(np.sum(np.abs(best) ** 2, axis=1), 1e-300)
    found["circularity, I over Q"], found["circularity, I times Q"] = square.real, square.imag
    spread = np.maximum(np.mean(rest**2, axis=(1, 2)) ** 2, 1e-300)
    found["spread of the size"] = np.mean(rest**4, axis=(1, 2)) / spread
    found["values at the largest"] = np.mean(size > 0.999 * full, axis=(1, 2))
    found["repeated pulses"] = np.mean(np.abs(steps).max(axis=2) == 0, axis=1)
    if many:
        unit = steps / np.sqrt(np.maximum(np.mean(np.abs(steps) ** 2, axis=1, keepdims=True), 1e-300))
        for lag, words in ((1, "1 bin"), (2, "2 bins")):
            products = np.mean(unit[:, :, lag:] * unit[:, :, :-lag].conj(), axis=1).real
            found[f"correlation, {words} apart"] = np.median(products, axis=1)
    return [dict(zip(found, row, strict=True)) for row in np.column_stack(list(found.values())).tolist()]


def _db(power: FloatArray) -> FloatArray:
    return np.asarray(power_to_db(np.maximum(power, 1e-30)), dtype=np.float64)


@dataclass(frozen=True)
class Comparison:
    """Real against simulated recordings."""

    auc: tuple[float, float, float]
    auc_of_shape: tuple[float, float, float]
    auc_linear: float
    distances: dict[str, tuple[float, float]]
    n_real: int
    n_synthetic: int
    held_out: str


def compare_recordings(real: Sequence[Recording], synthetic: Sequence[Recording], *, seed: int = 0) -> Comparison:
    """Separate real from simulated windows by a trained classifier."""
    from scipy.stats import wasserstein_distance
    from sklearn.ensemble import HistGradientBoostingClassifier
    from sklearn.linear_model import LogisticRegression
    from sklearn.model_selection import StratifiedGroupKFold, cross_val_predict
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    few, tables = min(len(real), len(synthetic)) < FEW, []
    for label, recordings in enumerate((synthetic, real)):
        for number, recording in enumerate(recordings):
            one = pd.DataFrame(measure_windows(recording))
            piece = np.arange(len(one)) * FOLDS // len(one) if few else np.zeros(len(one), dtype=int)
            names = [f"{label}-{number:05d}-{k}" for k in piece]
            tables.append(one.set_index([[bool(label)] * len(one), names]))
    table = pd.concat(tables).dropna(axis="columns")
    values = table.to_numpy(dtype=np.float64)
    positive, group = (table.index.get_level_values(level).to_numpy() for level in (0, 1))
    folds = min(FOLDS, *(np.unique(group[side]).size for side in (positive, ~positive)))
    if folds < 2:
        raise AnalysisError("nothing can be held out: two windows of real recordings and two of simulated are needed")
    cut = StratifiedGroupKFold(folds, shuffle=True, random_state=seed)

    def predict(model: Any, columns: Any = slice(None)) -> FloatArray:
        """Return window scores from models trained without the window's group."""
        used = values[:, columns]
        return np.asarray(cross_val_predict(model, used, positive, groups=group, cv=cut, method="decision_function"))

    def measure(scores: FloatArray) -> tuple[float, float, float]:
        return auc(scores, positive), *bootstrap_auc(scores, positive, group, seed=seed, count=REPLICATES)

    boosting = HistGradientBoostingClassifier(max_iter=100, learning_rate=0.1, max_depth=3, random_state=seed)
    distances = {}
    for name, column in zip(map(str, table), values.T, strict=True):
        spread = math.sqrt((column[positive].var() + column[~positive].var()) / 2.0)
        apart = wasserstein_distance(column[positive], column[~positive])
        alone = auc(column, positive)
        distances[name] = (apart / spread if spread > 0 else 0.0, max(alone, 1.0 - alone))
    return Comparison(
        auc=measure(predict(boosting)),
        auc_of_shape=measure(predict(boosting, [not name.startswith(LEVELS) for name in distances])),
        auc_linear=auc(predict(make_pipeline(StandardScaler(), LogisticRegression(max_iter=1000))), positive),
        distances=dict(sorted(distances.items(), key=lambda item: -item[1][0])),
        n_real=len(real),
        n_synthetic=len(synthetic),
        held_out="parts of recordings" if few else "recordings",
    )


def plot_recording(recording: Recording) -> tuple[FloatArray, FloatArray, str]:
    """Return a picture of a recording for display."""
    if recording.n_range_bins >= 8 and "burst_pulses" not in recording.facts:
        samples = np.asarray(recording.samples.matrix, dtype=np.complex128)
        moving = np.abs(samples - samples.mean(axis=0)) ** 2
        return power_to_db(np.maximum(moving, 1e-30)), recording.range_m, "range (m)"
    f_hz, power, _ = compute_windowed_power(split_windows(recording, most=64), recording.radar.prf_hz)
    strongest = power[:, :, int(np.argmax(power.sum(axis=(0, 1))))]
    order = np.argsort(f_hz)
    return power_to_db(np.maximum(strongest[:, order], 1e-30)), f_hz[order], "Doppler frequency (Hz)"


def comparison_rows(found: Mapping[str, Comparison], most: int = 12) -> list[dict[str, str]]:
    """Tabulate AUC, what was held out, and distances."""
    span, distance = "{:.2f} ({:.2f} to {:.2f})".format, "{:.2f} ({:.2f})".format
    cells = {
        "AUC, all statistics": [span(*one.auc) for one in found.values()],
        "AUC, without levels": [span(*one.auc_of_shape) for one in found.values()],
        "AUC, linear": [f"{one.auc_linear:.2f}" for one in found.values()],
        "tested on unseen": [one.held_out for one in found.values()],
    }
    for name in list(list(found.values())[-1].distances)[:most]:
        cells[name] = [distance(*one.distances[name]) if name in one.distances else "-" for one in found.values()]
    return [{"": words} | dict(zip(found, row, strict=True)) for words, row in cells.items()]
