"""Simulated sensors of known distributions, to test the fit of kinds.

A dozen units each record a person who walks in a room, all with the faults of one population; the fit knows neither.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import DoppelgaitWarning
from doppelgait.pipeline import parse_run, run_simulation
from doppelgait.radar import Radar, Recording
from doppelgait.radar.fit import Estimate, PooledQuantity, SensorKind, SensorMeasurement, fit_sensor

UNITS = 12
SECONDS, PRF_HZ = 4.0, 500.0
POPULATION = {
    "noise_figure_db": (9.0, 1.0), "gain_db": (0.0, 1.5), "iq_gain_db": (0.8, 0.4), "iq_phase_deg": (4.0, 2.0),
    "white_rad": (0.02, 0.004), "drop_probability": (0.02, 0.006),
}  # fmt: skip
"""Mean and standard deviation of every quantity over the units."""
LOST_TOGETHER = 2.0


@dataclass(frozen=True)
class Unit:
    """One simulated sensor: its own values and what it recorded."""

    values: dict[str, float]
    recording: Recording


def make_unit(seed: int, number: int) -> Unit:
    """Sample a sensor of the population, and simulate its recording."""
    rng = np.random.default_rng([seed, number])
    values = {name: float(rng.normal(mean, sd)) for name, (mean, sd) in POPULATION.items()}
    preset = Radar.preset("x4")
    run: dict[str, Any] = {
        "duration_s": SECONDS,
        "seed": int(rng.integers(2**31)),
        "radar": {
            "preset": "x4", "prf_hz": PRF_HZ, "noise_figure_db": values["noise_figure_db"],
            "receiver_gain_db": preset.receiver_gain_db + values["gain_db"],
        },
        "targets": [
            {
                "label": "human", "motion": {"kind": "human", "speed_mps": float(rng.uniform(0.6, 0.9))},
                "range_m": float(rng.uniform(3.0, 4.5)), "aspect_deg": float(rng.uniform(-30, 30)),
            }
        ],
        "impairments": [
            {"kind": "leakage", "delay_m": 0.05, "isolation_db": 40.0},
            {"kind": "static_clutter", "rcs_per_metre_m2": 0.002},
            {"kind": "phase_noise", "white_rad": values["white_rad"], "walk_rad_per_sqrt_min": 0.05},
            {"kind": "iq_imbalance", "gain_db": values["iq_gain_db"], "phase_deg": values["iq_phase_deg"]},
            {"kind": "dropped_frames", "probability": values["drop_probability"], "mean_length": LOST_TOGETHER},
        ],
    }  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DoppelgaitWarning)
        recording = run_simulation(parse_run(run), angles=False)
    return Unit(values, recording)


def fit_units(seed: int, count: int = UNITS) -> tuple[list[Unit], SensorKind]:
    """Simulate units and fit the kind, knowing only the data sheet's radar."""
    units = [make_unit(seed, number) for number in range(count)]
    sheet = Radar.preset("x4", prf_hz=PRF_HZ)
    recordings = [
        Recording.from_baseband(unit.recording.baseband, sheet, source=f"unit {number}")
        for number, unit in enumerate(units)
    ]
    return units, fit_sensor(recordings)


def own_score(one: SensorMeasurement, name: str, truth: float) -> float:
    """Return the error of one unit's estimate over its uncertainty."""
    found: Estimate | None = one.estimates.get(name)
    return math.nan if found is None else (found.value - truth) / found.sd


def population_scores(kind: SensorKind) -> dict[str, tuple[float, float, bool]]:
    """Return scores of means and spreads by quantity.

    Score of the mean, spread over truth, and whether the truth is within the spread's interval. The gain of a data
    sheet is not measured but relative: its mean counts against that of these units.
    """
    scores = {}
    for name, (mean, sd) in POPULATION.items():
        pooled: PooledQuantity | None = kind.pooled.get(name)
        if pooled is None or math.isnan(pooled.spread):  # shown by fewer than three units
            continue
        if name == "gain_db":
            mean = math.nan
        low, high = pooled.low, pooled.high
        scores[name] = ((pooled.mean.value - mean) / pooled.mean.sd, pooled.spread / sd, low <= sd <= high)
    return scores


def summary(scores: npt.NDArray[np.float64]) -> str:
    """Return mean, root mean square and the share within two of scores."""
    good = scores[np.isfinite(scores)]
    if not good.size:
        return "-"
    rms, within = float(np.sqrt(np.mean(good**2))), float(np.mean(np.abs(good) <= 2))
    return f"{good.mean():+.2f}, {rms:.2f}, {100 * within:.0f} %"
