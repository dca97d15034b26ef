"""Errors of velocity, bandwidth, step length and limb-torso ratio.

Over the examples of the gait frequency study.

    python studies/feature_errors.py [--mocap FOLDER] [--trials N] [--processes P] [--out TABLE.csv]

N examples of the models and all recorded targets of FOLDER (as recorded and looped, at four aspects), the same as in
``studies/gait_frequency.py``, in the truth gate at SNR_mu infinite, 20, 10, 5 and 0 dB; the report's method at infinite
and 10 dB. Truths: v_m is the mean radial velocity of the body's centre; the step length |that| over the true f_mu; the
bandwidth either the span of all scatterers' Doppler over the whole time (what the report's gate is set by), or that of
the true envelopes: 95th percentile over time of the highest less 5th of the lowest Doppler, as B_mu is defined. The
limb-torso ratio has no truth: it is compared with itself, for 128 and 512 Doppler bins and without noise and at 5 dB.
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
from acceptance_tables import FAILURE, markdown
from gait_frequency import SNR_MU_DB, Example, observe, run_study, signatures

from doppelgait.core.errors import DoppelgaitError
from doppelgait.core.labels import read_axis
from doppelgait.pipeline.analyze import analyze_signature
from doppelgait.processing import Analysis, Gate
from doppelgait.radar.recording import Recording

RHO_BINS = 512
REPORT_HOP = 16
"""Of the report's method, which takes 1: its columns are 10 ms wide and more, f_mu moves by less than its bin."""
RUNS = (
    ("standard", Analysis(extended=False), SNR_MU_DB),
    (f"K {RHO_BINS}", Analysis(extended=False, doppler_bins=RHO_BINS), (math.inf,)),
    ("liland2018", Analysis(method="liland2018", hop=REPORT_HOP), (math.inf, 10.0)),
)
TIME_PERCENTILES = (5.0, 95.0)
RHO_LIMITS = (("K 128 -> 512", ("standard", math.inf), (f"K {RHO_BINS}", math.inf), 2.0),
              ("no noise -> 5 dB", ("standard", math.inf), ("standard", 5.0), 10.0))  # fmt: skip
BY = ["method", "snr_mu_db", "who", "gait"]


def run_example(example: Example) -> list[dict[str, Any]]:
    """Return one row per method and noise level.

    None where the target cannot be observed.
    """
    warnings.simplefilter("ignore")
    try:
        recording = observe(example)
        return [{**facts(example, recording), **row} for row in estimates(example, recording)]
    except DoppelgaitError:
        return []


def facts(example: Example, recording: Recording) -> dict[str, Any]:
    """Return the truth of an example."""
    truth = recording.truth[0]
    velocity_mps = float(truth.centre_velocity_mps.mean())
    doppler_hz = truth.doppler_hz(recording.radar.wavelength_m)
    low, high = (
        np.percentile(doppler_hz.min(axis=1), TIME_PERCENTILES[0]),
        np.percentile(doppler_hz.max(axis=1), TIME_PERCENTILES[1]),
    )
    return {
        "number": example.number, "who": example.source, "gait": f"{example.label} {truth.gait}",
        "angle_deg": min(example.aspect_deg, 180.0 - example.aspect_deg), "true_mps": velocity_mps,
        "truth_hz": truth.gait_frequency_hz, "true_step_m": abs(velocity_mps) / truth.gait_frequency_hz,
        "true_ground_step_m": truth.ground_speed_mps / truth.gait_frequency_hz,
        "span_hz": float(np.ptp(doppler_hz)), "envelope_hz": float(high - low),
        "seconds": recording.n_pulses / recording.radar.prf_hz,
    }  # fmt: skip


def estimates(example: Example, recording: Recording) -> Iterator[dict[str, Any]]:
    """Measure the features of every method at every level."""
    for method, analysis, levels_db in RUNS:
        gate = Gate.from_truth(
            recording.truth[0],
            read_axis(recording.baseband, "slow_time"),
            analysis,
            wavelength_m=recording.radar.wavelength_m,
        )
        for level_db, mu in signatures(example, recording, analysis, levels_db):
            result = analyze_signature(mu, gate, analysis, label=example.label)
            features = result.features
            yield {
                "method": method, "snr_mu_db": level_db, "found_hz": result.gait_frequency_hz,
                "v_mps": features.torso_velocity_mps, "b_hz": features.doppler_bandwidth_hz,
                "step_m": features.step_length_m, "rho": features.limb_torso_ratio,
                "ground_step_m": result.quality.get("ground_step_length_m"),
            }  # fmt: skip


def velocity_errors(rows: pd.DataFrame) -> pd.DataFrame:
    """Tabulate the errors of v_m, m/s.

    Against the mean radial velocity of the centre: n, missing, bias, rms and median error.
    """
    off = rows["v_mps"].astype(float) - rows["true_mps"]
    along = off * np.sign(rows["true_mps"])  # positive: too fast
    return _errors(rows.assign(off=off, along=along), "along", "m/s")


def _errors(rows: pd.DataFrame, name: str, unit: str, by: list[str] = BY) -> pd.DataFrame:
    grouped = rows.groupby(by, dropna=False)[name]
    found = pd.DataFrame({
        "n": grouped.count(), "missing": grouped.apply(lambda e: int(e.isna().sum())),
        f"bias {unit}": grouped.mean(), f"rms {unit}": grouped.apply(lambda e: math.sqrt((e**2).mean())),
        f"median {unit}": grouped.apply(lambda e: e.abs().median()),
    })  # fmt: skip
    return found.round(3).reset_index()


def bandwidth_errors(rows: pd.DataFrame) -> pd.DataFrame:
    """Tabulate bias and correlation of B_mu.

    Against the true span and the true envelopes, bias in % of the truth.
    """
    found = []
    for key, cell in rows[rows["b_hz"].notna()].groupby(BY):
        measured = cell["b_hz"].astype(float)
        row: dict[str, Any] = dict(zip(BY, key, strict=True)) | {"n": len(cell)}
        for name in ("span", "envelope"):
            truth = cell[f"{name}_hz"]
            row[f"bias from {name} Hz"] = round(float((measured - truth).mean()), 1)
            row[f"ratio to {name}"] = round(float((measured / truth).median()), 2)
            row[f"correlation with {name}"] = _correlation(measured, truth)
        found.append(row)
    return pd.DataFrame(found)


def _correlation(one: pd.Series, other: pd.Series) -> float:
    return round(float(np.corrcoef(one, other)[0, 1]), 3) if len(one) > 2 else math.nan


def step_errors(rows: pd.DataFrame) -> pd.DataFrame:
    """Tabulate the errors of the radial step length L_m, m.

    All, and those with the right f_mu.
    """
    off = rows["step_m"].astype(float).abs() - rows["true_step_m"]
    right = (rows["found_hz"].astype(float) / rows["truth_hz"] - 1.0).abs() <= FAILURE
    every = _errors(rows.assign(off=off), "off", "m")
    known = _errors(rows.assign(off=off.where(right)), "off", "m")
    columns = {name: f"{name}, f_mu right" for name in ("n", "rms m", "median m")}
    return every.merge(known[[*BY, *columns]].rename(columns=columns), on=BY)


def ground_step_errors(rows: pd.DataFrame) -> pd.DataFrame:
    """Tabulate the errors of the step length over ground (E-34b), m."""
    own = rows[(rows["method"] == "standard") & (rows["seconds"] >= 3)]
    return _errors(own.assign(off=own["ground_step_m"].astype(float) - own["true_ground_step_m"]), "off", "m")


def ratio_repeats(rows: pd.DataFrame) -> pd.DataFrame:
    """Tabulate the changes of rho, %.

    Of the mean over the examples of a gait, and of single ones.
    """
    wide = rows.pivot_table(index=["who", "gait", "number"], columns=["method", "snr_mu_db"], values="rho")
    found = []
    for name, before, after, limit in RHO_LIMITS:
        for (who, gait), cell in wide.groupby(["who", "gait"]):
            both = cell[[before, after]].dropna()
            change = 100.0 * (both[after] / both[before] - 1.0)
            mean = 100.0 * (both[after].mean() / both[before].mean() - 1.0)
            found.append({
                "change": name, "who": who, "gait": gait, "n": len(both), "of the mean %": round(mean, 2),
                "demand": f"<= {limit:g} %", "met?": "met" if abs(mean) <= limit else "not met",
                "median of |single| %": round(change.abs().median(), 2),
                "single within %": round(100.0 * (change.abs() <= limit).mean()),
            })  # fmt: skip
    return pd.DataFrame(found)


def with_classes(rows: pd.DataFrame) -> pd.DataFrame:
    """Append the rows with the class in place of the gait."""
    return pd.concat([rows.assign(gait=rows["gait"].str.split().str[0] + " all"), rows], ignore_index=True)


def tables(rows: pd.DataFrame) -> Iterator[tuple[str, pd.DataFrame]]:
    """Yield title and table."""
    rows = with_classes(rows)
    rated = rows[rows["method"].isin(["standard", "liland2018"])]
    front = rated[rated["angle_deg"] <= 45]
    yield "Torso velocity, all aspects", velocity_errors(rated)
    yield "Torso velocity, to 45 degrees", velocity_errors(front)
    yield "Doppler bandwidth, to 45 degrees", bandwidth_errors(front)
    yield "Step length (radial), to 45 degrees", step_errors(front)
    yield "Step length over ground, all aspects, from 3 s on", ground_step_errors(rated)
    yield "rho, to 45 degrees", ratio_repeats(rows[rows["angle_deg"] <= 45])


def main() -> None:
    """Run the study and print its tables."""
    start = time.perf_counter()
    examples, rows = run_study(run_example, __doc__, "--trials")
    print(f"{len(examples)} examples, {rows['number'].nunique()} observed, {len(rows)} estimates")
    for title, table in tables(rows):
        print(f"\n## {title}\n\n{markdown(table)}")
    print(f"\n{time.perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main()
