"""Calibration of feature uncertainties over repeated simulated examples.

Their errors over the stated standard deviations.

    python studies/feature_quality.py [--movers N] [--repeats N] [--processes P] [--out TABLE.csv]

Every target (models of walking and running people and of dogs in seven gaits) is observed several times by the preset
``x4-long`` in the truth gate, each time with another phase, other strides and other noise: 2 to 6 s, SNR_frame 5, 10,
20 and 30 dB, up to 30 degrees from the line of sight. Velocity, gait frequency and step length are compared with the
truth. Bandwidth and limb-torso ratio have no truth of their own: they are compared with their mean over the repeats at
the same SNR. Harmonic ratios are compared with the whole number. Examples whose gait frequency is off by more than 10 %
count as failures and are left out: no uncertainty covers a wrong octave. The targets are not those that the constants
of ``doppelgait.features.uncertainty`` were chosen with.
"""

from __future__ import annotations

import argparse
import math
import time
import warnings
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

import doppelgait.features as feature_layer
from doppelgait.core.errors import DoppelgaitError
from doppelgait.core.rng import Streams
from doppelgait.features import Extraction, Observation
from doppelgait.features.extended import measure_extended
from doppelgait.features.uncertainty import estimate_uncertainties
from doppelgait.motion.models import boulic_walk, human_gait, quadruped_gait
from doppelgait.motion.models.quadruped_gaits import GAITS
from doppelgait.pipeline import analyze, simulate
from doppelgait.processing import Analysis
from doppelgait.radar import Radar
from doppelgait.scene import Scene, Target

SNR_DB = (5.0, 10.0, 20.0, 30.0)
SEED = 8
FAILURE_SHARE = 0.1
HIP_SHARE, GRAVITY_MPS2 = 0.8, 9.81
MODELS = {"human": human_gait, "boulic": boulic_walk, "quadruped": quadruped_gait}
TRUTHS = {
    "torso_velocity_mps": "true_velocity_mps",
    "gait_frequency_hz": "true_frequency_hz",
    "step_length_m": "true_step_m",
    "harmonic_ratio_2": "true_harmonic_2",
}
REPEATED = ("doppler_bandwidth_hz", "limb_torso_ratio")

_extract = feature_layer.extract
_last: list[Any] = []


def _extract_and_keep(evidence: Any, **settings: Any) -> Any:
    """Keep the intermediates of features, which results do not carry."""
    extraction = _extract(evidence, **settings)
    _last[:] = [evidence, extraction]
    return extraction


def sample_target(number: int) -> tuple[str, dict[str, Any], float, float]:
    """Sample model, parameters, seconds and aspect of a target."""
    rng = np.random.default_rng([SEED, number])
    seconds, aspect_deg = float(rng.uniform(2, 6)), float(rng.uniform(0, 30))
    if rng.random() < 0.3:
        aspect_deg = 180.0 - aspect_deg
    kind = ("human", "quadruped", "boulic", "quadruped", "human", "quadruped")[number % 6]
    make = {"human": _person, "boulic": _plain_walker, "quadruped": _dog}[kind]
    return kind, make(rng, number), seconds, aspect_deg


def _person(rng: np.random.Generator, number: int) -> dict[str, Any]:
    gait = "walk" if number % 12 < 6 else "run"
    low, high = (0.5, 2.0) if gait == "walk" else (2.1, 4.0)
    sd = {"step_time_sd": float(rng.uniform(0, 0.03)), "step_length_sd": float(rng.uniform(0, 0.03))}
    uneven = {"time_asymmetry": float(rng.uniform(-0.05, 0.05)), "length_asymmetry": float(rng.uniform(-0.05, 0.05))}
    body = {"height_m": float(rng.uniform(1.5, 1.95)), "arm_swing": float(rng.uniform(0.3, 1.3))}
    return {"gait": gait, "speed_mps": float(rng.uniform(low, high)), **body, **sd, **uneven}


def _plain_walker(rng: np.random.Generator, _number: int) -> dict[str, Any]:
    return {
        "height_m": float(rng.uniform(1.5, 1.95)), "speed_mps": float(rng.uniform(0.5, 2)),
        "stride_variation": float(rng.uniform(0, 0.03)),
    }  # fmt: skip


def _dog(rng: np.random.Generator, number: int) -> dict[str, Any]:
    gait, withers_m = list(GAITS)[number // 2 % len(GAITS)], float(rng.uniform(0.25, 0.65))
    lowest, highest = (math.sqrt(f * GRAVITY_MPS2 * HIP_SHARE * withers_m) for f in GAITS[gait].froude[:2])
    speed_mps = float(rng.uniform(max(lowest, 0.4) * 1.01, min(highest, 4.0) * 0.99))
    return {
        "gait": gait, "withers_m": withers_m, "speed_mps": speed_mps, "stride_variation": float(rng.uniform(0, 0.04)),
        "asymmetry": float(rng.uniform(-0.02, 0.02)), "tail_frequency_hz": float(rng.uniform(0, 3)),
    }  # fmt: skip


def observe(number: int, repeat: int, snr_db: float) -> dict[str, Any]:
    """Observe a target once: values, standard deviations and truth.

    Only its numbers where it cannot be observed.
    """
    warnings.simplefilter("ignore")
    feature_layer.extract = _extract_and_keep
    kind, parameters, seconds, aspect_deg = sample_target(number)
    rng = np.random.default_rng([SEED + 1, number, repeat, round(snr_db)])
    phase = float(rng.random())
    reach_m = parameters["speed_mps"] * seconds
    radar = Radar.preset("x4-long", range_stop_m=min(40.0, 9.0 + reach_m))
    gait = parameters.get("gait", "walk")
    facts = {"number": number, "snr_db": snr_db, "mover": f"{kind} {gait}", "seconds": seconds}
    try:
        motion = MODELS[kind](**parameters, start_phase=phase, duration_s=seconds + 0.1, rng=rng)
        scene = Scene([Target(motion, label=kind, aspect_deg=aspect_deg)], duration_s=seconds)
        made = simulate(scene, radar, rng=Streams(int(rng.integers(2**31))), snr_db=snr_db, angles=False)
        analyze(made, gate="truth", analysis=Analysis(hop=8))
    except DoppelgaitError:
        return facts
    return {**facts, **_measured_values(*_last), **_true_values(made.truth[0])}


def _measured_values(observed: Observation, extraction: Extraction) -> dict[str, Any]:
    known = replace(observed, extraction=extraction)
    sd = estimate_uncertainties(known)
    without = replace(observed, extraction=replace(extraction, gait_frequency_hz=None))
    no_gait = estimate_uncertainties(without)["torso_velocity_mps"]
    extended = measure_extended(known).values
    values = {**extraction.features.as_dict(), "gait_frequency_hz": extraction.gait_frequency_hz, **extended}
    return {**values, **{f"sd_{name}": value for name, value in sd.items()}, "sd_without_gait": no_gait}


def _true_values(truth: Any) -> dict[str, float]:
    velocity_mps = float(truth.centre_velocity_mps.mean())
    return {
        "true_velocity_mps": velocity_mps, "true_frequency_hz": truth.gait_frequency_hz,
        "true_step_m": abs(velocity_mps) / truth.gait_frequency_hz, "true_harmonic_2": 2.0,
    }  # fmt: skip


def run_all(n_targets: int, n_repeats: int, processes: int) -> pd.DataFrame:
    """Run all observations."""
    jobs = [(number, repeat, snr_db) for number in range(n_targets) for snr_db in SNR_DB for repeat in range(n_repeats)]
    if processes == 1:
        return pd.DataFrame([observe(*job) for job in jobs])
    with ProcessPoolExecutor(processes) as pool:
        return pd.DataFrame(pool.map(observe, *zip(*jobs, strict=True), chunksize=8))


def scores(table: pd.DataFrame) -> pd.DataFrame:
    """Return errors over standard deviations, one column per feature.

    Only examples with the right gait frequency.
    """
    right = table[(table["gait_frequency_hz"] / table["true_frequency_hz"] - 1).abs() <= FAILURE_SHARE].copy()
    found = right[["number", "snr_db", "mover"]].copy()
    found["periods"] = pd.cut(right["seconds"] * right["true_frequency_hz"], [0, 5, 8, 99]).astype(str)
    for name, truth in TRUTHS.items():
        found[name] = (right[name] - right[truth]) / right[f"sd_{name}"]
    found["velocity_without_gait"] = (right["torso_velocity_mps"] - right["true_velocity_mps"]) / right[
        "sd_without_gait"
    ]
    for name in REPEATED:
        values = right[name].astype(float).where(right[f"sd_{name}"].notna())
        group = values.groupby([right["number"], right["snr_db"]])
        n = group.transform("count")
        error = (values - group.transform("mean")) * np.sqrt(n / (n - 1)).where(n > 2)
        found[name] = error / right[f"sd_{name}"]
    return found.astype({name: float for name in _score_rows(found)})


def _score_rows(found: pd.DataFrame) -> list[str]:
    return [name for name in found.columns if name not in ("number", "snr_db", "mover", "periods")]


def summary(found: pd.DataFrame, by: str | None = None) -> pd.DataFrame:
    """Tabulate number, bias, standard deviation and coverage of the scores.

    Coverage of +-2; by feature and a column.
    """
    rows = []
    for value, part in found.groupby(by) if by else [("all", found)]:
        for name in _score_rows(found):
            z = part[name].replace([np.inf, -np.inf], np.nan).dropna()
            rows.append({
                "feature": name, by or "by": value, "n": z.size, "mean": z.mean(), "sd": z.std(),
                "within_2": (z.abs() <= 2).mean(),
            })  # fmt: skip
    return pd.DataFrame(rows).round({"mean": 2, "sd": 2, "within_2": 3})


def _print(table: pd.DataFrame) -> None:
    usable = table["true_velocity_mps"].notna()
    null = table["gait_frequency_hz"].isna() & usable
    wrong = (table["gait_frequency_hz"] / table["true_frequency_hz"] - 1).abs() > FAILURE_SHARE
    print(f"{usable.sum()} examples; no gait frequency {null.sum()}, off by more than 10 % {wrong.sum()}")
    found = scores(table)
    print(summary(found).to_string(index=False))
    for by in ("snr_db", "periods", "mover"):
        wide = summary(found, by).pivot(index="feature", columns=by, values=["sd", "within_2"])
        for statistic in ("sd", "within_2"):
            print(f"\n{statistic} by {by}\n{wide[statistic].to_string()}")


def main() -> None:
    """Run the study and print its tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--movers", type=int, default=120)
    parser.add_argument("--repeats", type=int, default=4)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--out")
    options = parser.parse_args()
    start = time.perf_counter()
    table = run_all(options.movers, options.repeats, options.processes)
    _print(table)
    print(f"{time.perf_counter() - start:.0f} s")
    if options.out:
        table.to_csv(options.out, index=False)


if __name__ == "__main__":
    main()
