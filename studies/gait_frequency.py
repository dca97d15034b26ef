"""Gait frequency and features of models and recorded targets, with their stated uncertainties.

    python studies/gait_frequency.py --mocap MOTION_FOLDER --page
    python studies/gait_frequency.py --mocap MOTION_FOLDER --fit

Question: how often is the gait frequency right, is its confidence reliable, how large are the errors of the features,
and do the stated standard deviations cover them?

Every example is one target on a straight path, observed by the preset `x4-long` in the truth gate, four of five with
the body of surfaces, one of points. Receiver noise is set so that the signature has the wanted SNR_mu: the median over
time of the strongest clean cell of a column, over the mean noise floor. Recorded targets are all straight segments of
the folder's recordings in which the footfalls give a gait, once as recorded and once looped to 5 s. Half A (the first
650 models, every second file in the order of names) sets the weights of the posterior, half B reports. The list of
terms and the signs allowed to their weights were chosen with both halves and the real X-band images in view. Truth is
the least-squares beat of the footfalls over the observed time, as in the labels of a dataset; where the time between
steps changes by more than 3 % from start to end the cadence drifts. The truth of v_m is the mean radial velocity of the
body's centre, that of L_m its size over the true f_mu; B_mu and rho have no truth of their own and are compared with
their values without noise; at SNR_mu 0 dB noise changes them in every record, and deviations are not tabulated.

`--fit` prints the weights: those of highest posterior at the true frequency over half A at all noise levels; walkers
and runners of the models, dogs, and people and dogs as recorded and looped count alike, views beyond 60 degrees and
less than 1.5 periods 0.3. It takes about 11 minutes of one core.

Not shown: two bodies in one gate, tracked gates, and aspects beyond 80 degrees.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr
from harness import finish, make_parser, quiet, run_jobs

import doppelgait
from doppelgait.core.errors import DoppelgaitError
from doppelgait.features.gait_frequency import GRID_HZ, LEAST_PERIODS, compute_terms, measure_target_rhythms
from doppelgait.motion.gait import add_gait_facts, find_steps, fit_beat_hz
from doppelgait.motion.loop import loop
from doppelgait.motion.models import boulic_walk, human_gait, quadruped_gait
from doppelgait.motion.models.quadruped_gaits import GAITS
from doppelgait.motion.motion import Motion
from doppelgait.motion.readers import read
from doppelgait.motion.retime import travel_speed_mps
from doppelgait.motion.segments import crop, find_segments
from doppelgait.pipeline import simulate
from doppelgait.pipeline.target import analyze_signature
from doppelgait.pipeline.target import observe as observe_signature
from doppelgait.processing import Analysis, Gate, crop_to_frame, decimate, signature
from doppelgait.radar import Radar, add_noise
from doppelgait.radar.recording import Recording
from doppelgait.scene import Scene, Target

SNR_MU_DB = (math.inf, 20.0, 10.0, 5.0, 0.0)
REPORT_SNR_DB = (math.inf, 10.0)
SPEEDS_MPS = (0.4, 4.0)
GRAVITY_MPS2 = 9.81
HIP_SHARE = 0.8
"""Hip height over withers height of a standing dog."""
SIDE_VIEW_SHARE = 0.15
"""Share of the examples at 60 to 80 degrees; the others are at 0 to 60."""
LOOPED_S = 5.0
MIN_PERIODS = 1.0
MODELS_OF_HALF_A = 650
DRIFT = 0.03
FIT_SNR_DB = (math.inf, 20.0, 10.0, 5.0)
NEAR = 0.04
PENALTY = 3e-4
"""On the square of the weights of standardised terms."""
MARGIN_M = 2.0
FEATURES = (
    "torso_velocity_mps",
    "gait_frequency_hz",
    "step_length_m",
    "harmonic_ratio_2",
    "doppler_bandwidth_hz",
    "limb_torso_ratio",
)
NOISE_ONLY = ("doppler_bandwidth_hz", "limb_torso_ratio")
"""Compared with their values without noise."""


@dataclass(frozen=True)
class Example:
    """One target under given observation conditions."""

    number: int
    source: str
    label: str
    half: str
    body: tuple[Any, ...]
    aspect_deg: float
    seconds: float


def model_examples(count: int, *, first: int = 0) -> list[Example]:
    """Sample examples of the models. A third people of the full model, a sixth walkers of the plain one, half dogs."""
    return [_model_example(number) for number in range(first, first + count)]


def _model_example(number: int) -> Example:
    rng = np.random.default_rng([7, number])
    kind = ("human", "boulic", "dog", "human", "dog", "dog")[number % 6]
    side_view = rng.random() < SIDE_VIEW_SHARE
    aspect_deg = float(rng.uniform(60, 80) if side_view else rng.uniform(0, 60))
    if rng.random() < 0.3:
        aspect_deg = 180.0 - aspect_deg
    seconds = float(rng.uniform(2.0, 8.0))
    make = {"human": _person, "boulic": _plain_walker, "dog": _dog}[kind]
    body = make(rng, number)
    half = "A" if number < MODELS_OF_HALF_A else "B"
    return Example(number, "model", "dog" if kind == "dog" else "human", half, body, aspect_deg, seconds)


def _person(rng: np.random.Generator, number: int) -> tuple[Any, ...]:
    height_m = float(rng.uniform(1.5, 1.95))
    gait = "walk" if number % 12 < 6 else "run"
    speed = rng.uniform(0.4, 2.0) if gait == "walk" else rng.uniform(2.1, 4.0)
    return "human", {
        "gait": gait, "height_m": height_m, "speed_mps": float(speed), "start_phase": float(rng.random()),
        "step_time_sd": float(rng.uniform(0, 0.03)), "step_length_sd": float(rng.uniform(0, 0.03)),
        "time_asymmetry": float(rng.uniform(-0.05, 0.05)), "length_asymmetry": float(rng.uniform(-0.05, 0.05)),
        "arm_swing": float(rng.uniform(0.3, 1.3)),
    }  # fmt: skip


def _plain_walker(rng: np.random.Generator, number: int) -> tuple[Any, ...]:
    height_m, speed = float(rng.uniform(1.5, 1.95)), float(rng.uniform(0.4, 2.0))
    return "boulic", {
        "height_m": height_m, "speed_mps": speed, "start_phase": float(rng.random()),
        "stride_variation": float(rng.uniform(0, 0.03)),
    }  # fmt: skip


def _dog(rng: np.random.Generator, number: int) -> tuple[Any, ...]:
    gait = list(GAITS)[number // 2 % len(GAITS)]
    withers_m = float(rng.uniform(0.25, 0.65))
    hip_m = HIP_SHARE * withers_m
    lowest, highest = (math.sqrt(froude * GRAVITY_MPS2 * hip_m) for froude in GAITS[gait].froude[:2])
    speed = float(rng.uniform(max(lowest, SPEEDS_MPS[0]) * 1.01, min(highest, SPEEDS_MPS[1]) * 0.99))
    return "quadruped", {
        "gait": gait, "withers_m": withers_m, "speed_mps": speed, "start_phase": float(rng.random()),
        "stride_variation": float(rng.uniform(0, 0.04)), "asymmetry": float(rng.uniform(-0.02, 0.02)),
        "tail_frequency_hz": float(rng.uniform(0, 3)),
    }  # fmt: skip


MODELS = {"human": human_gait, "boulic": boulic_walk, "quadruped": quadruped_gait}


def recorded_examples(folder: Path, *, first: int, aspects_deg: tuple[float, ...] = (0, 25, 45, 60)) -> list[Example]:
    """Make examples of every usable recorded segment at each aspect. As it is and looped."""
    examples: list[Example] = []
    files = sorted(path for kind in ("human", "dog") for path in (folder / kind).rglob("*") if path.is_file())
    for place, path in enumerate(files):
        label, half = path.relative_to(folder).parts[0], "AB"[place % 2]
        for stretch, motion in stretches(path).items():
            for source, seconds in (("recorded", math.inf), ("looped", LOOPED_S)):
                long_enough = min(motion.duration_s, seconds) * motion.facts.gait_frequency_hz >= MIN_PERIODS
                for aspect_deg in aspects_deg if long_enough else ():
                    body = (str(path), stretch)
                    examples.append(Example(first + len(examples), source, label, half, body, aspect_deg, seconds))
    return examples


@lru_cache(maxsize=256)
def stretches(path: Path) -> dict[int, Motion]:
    """Return the straight segments of a recording with a known gait. Empty where the file cannot be read."""
    try:
        motion = read(path)
        found = {n: add_gait_facts(crop(motion, s)) for n, s in enumerate(find_segments(motion), start=1)}
    except (DoppelgaitError, ValueError):
        return {}
    return {n: m for n, m in found.items() if _gait_is_known(m)}


def _gait_is_known(motion: Motion) -> bool:
    facts = motion.facts
    return facts.stride_from == "footfalls" and bool(facts.gait) and facts.gait_frequency_hz > 0


def motion_of(example: Example) -> Motion:
    """Return the motion of the target."""
    if example.source == "model":
        model, parameters = example.body
        return MODELS[model](**parameters, duration_s=example.seconds + 0.1, rng=np.random.default_rng(example.number))
    path, stretch = example.body
    motion = stretches(Path(path))[stretch]
    return motion if example.source == "recorded" else loop(motion, duration_s=LOOPED_S, variation=0.0)


def rate_over_window(motion: Motion, seconds: float) -> tuple[float, float]:
    """Measure f_mu over the observed time, or the motion's own without even strides, and its relative change."""
    times = [np.sort(steps.overtaken_s - motion.time_s[0]) for steps in find_steps(motion).values()]
    times = [one[(one >= 0) & (one <= seconds)] for one in times]
    times = [one for one in times if one.size > 1]
    facts = motion.facts
    stride_hz = fit_beat_hz(times)
    if sum(one.size - 1 for one in times) < 2 or not math.isfinite(stride_hz):
        return facts.gait_frequency_hz, math.nan
    between, middle = (np.concatenate([step(one) for one in times]) for step in (np.diff, lambda t: t[1:] + t[:-1]))
    between /= np.maximum(np.round(between * stride_hz), 1.0)  # a missed footfall
    slope = np.polyfit(middle / 2.0, between, 1)[0] if between.size >= 4 and np.ptp(middle) > 0 else math.nan
    return stride_hz * facts.gait_frequency_hz / facts.stride_frequency_hz, abs(slope) * seconds / between.mean()


def observe(example: Example) -> Recording:
    """Simulate the noise-free recording within the range of the target."""
    motion = motion_of(example)
    seconds = min(example.seconds, motion.duration_s)
    rcs = "body_parts" if example.number % 5 == 0 else "auto"
    target = Target(motion, label=example.label, aspect_deg=example.aspect_deg, rcs=rcs)
    scene = Scene([target], duration_s=seconds)
    reach_m = travel_speed_mps(motion) * seconds
    stop_m = min(40.0, 5.0 + reach_m + 2 * MARGIN_M)
    radar = Radar.preset("x4-long", range_stop_m=stop_m)
    return simulate(scene, radar, rng=doppelgait.rng(example.number), snr_db=math.inf, angles=False)


def signatures(
    example: Example, recording: Recording, analysis: Analysis, levels_db: tuple[float, ...]
) -> Iterator[tuple[float, xr.DataArray]]:
    """Compute the signature at each SNR_mu."""
    truth = recording.truth[0]
    gate = Gate.from_truth(truth, recording.slow_time_s, analysis, wavelength_m=recording.radar.wavelength_m)
    wavelength_m = recording.radar.wavelength_m
    clean = signature(recording.baseband, gate, analysis, wavelength_m=wavelength_m)
    top_v2 = float(np.median(clean.values.max(axis=1)))
    n_bins = clean.attrs["n_gate_bins"] / recording.independent_bin_share  # the attribute counts independent bins
    cell_gain = clean.attrs["window_energy"] * n_bins
    for place, snr_db in enumerate(levels_db):
        if math.isinf(snr_db):
            yield snr_db, clean
            continue
        noise_v2 = top_v2 / 10 ** (snr_db / 10) / cell_gain
        rng = np.random.default_rng([11, example.number, place])
        baseband = add_noise(recording.baseband, noise_power_v2=noise_v2, rng=rng)
        yield snr_db, signature(baseband, gate, analysis, wavelength_m=wavelength_m)


def run_example(example: Example) -> list[dict[str, Any]]:
    """Return one row per method and noise level. None where the target cannot be observed."""
    quiet()
    try:
        recording = observe(example)
    except DoppelgaitError:
        return []
    truth = recording.truth[0]
    seconds = recording.n_pulses / recording.radar.prf_hz
    truth_hz, drift = rate_over_window(motion_of(example), seconds)
    facts = {
        **{name: getattr(example, name) for name in ("number", "source", "label", "half", "aspect_deg")},
        "gait": truth.gait, "speed_mps": truth.ground_speed_mps, "truth_hz": truth_hz, "drift": drift,
        "seconds": seconds, "true_mps": float(truth.centre_velocity_mps.mean()),
    }  # fmt: skip
    rows = []
    # a hop of 8 pulses moves the report's estimate by nothing that its bin of 1 / T_o shows, at an eighth the time
    methods = (("standard", Analysis(), SNR_MU_DB), ("liland2018", Analysis(method="liland2018", hop=8), REPORT_SNR_DB))
    for method, analysis, levels in methods:
        for snr_db, mu in signatures(example, recording, analysis, levels):
            gate = Gate.from_truth(truth, recording.slow_time_s, analysis, wavelength_m=recording.radar.wavelength_m)
            result = analyze_signature(mu, gate, analysis, label=example.label)
            rows.append({**facts, "method": method, "snr_mu_db": snr_db, **_result_columns(result)})
    return rows


def _result_columns(result: Any) -> dict[str, Any]:
    values = {**result.features.as_dict(), "gait_frequency_hz": result.gait_frequency_hz}
    return {
        "found_hz": result.gait_frequency_hz,
        "confidence": result.quality.get("gait_confidence"),
        "low_confidence": "low_confidence" in result.flags,
        **{name: values.get(name) for name in FEATURES},
        **{f"sd_{name}": result.standard_deviation.get(name) for name in FEATURES},
    }


def tabulate(rows: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Return the tables; half A is left out of all but the requirements."""
    rows = rated(rows)
    reported = rows[rows["half"] == "B"]
    front = reported[reported["view"] == "0-45"]
    own = reported[reported["method"] == "standard"]
    by = ["method", "snr_mu_db", "source", "label"]
    few = front[(front["periods"] >= 3) & front["snr_mu_db"].isin(REPORT_SNR_DB)]
    shown = front[(front["method"] == "standard") & front["snr_mu_db"].isin(REPORT_SNR_DB)]
    return {
        "f_mu by periods, to 45 degrees, %": _shares(shown, [*by[1:], "observed", "cadence"]),
        "f_mu by gait, to 45 degrees, 3 periods and more, %": _shares(few, [*by, "gait"]),
        "f_mu by view, 5 periods and more, %": _shares(reported[reported["periods"] >= 5], [*by, "view"]),
        "Reliability of the confidence, %": reliability(own),
        "Requirements on f_mu": acceptance(rows[rows["method"] == "standard"]),
        "Errors of features, to 45 degrees": feature_errors(front),
        "Errors within one and two stated standard deviations, to 45 degrees, %": coverage(own[own["view"] == "0-45"]),
    }


def feature_errors(rows: pd.DataFrame) -> pd.DataFrame:
    """Tabulate bias and rms of v_m and L_m, and the median change of B_mu and rho by noise."""
    found = []
    for (method, source, label, snr_db), own in rows.groupby(["method", "source", "label", "snr_mu_db"]):
        speed = (own["torso_velocity_mps"].astype(float) - own["true_mps"]) * np.sign(own["true_mps"])
        right = own[own["error"] < 0.1]
        step = right["step_length_m"].astype(float).abs() - right["true_mps"].abs() / right["truth_hz"]
        found.append(
            {
                "method": method,
                "targets": f"{source} {label}",
                "SNR_mu dB": f"{snr_db:g}",
                "n": len(own),
                "v_m bias m/s": f"{speed.mean():+.3f}",
                "v_m rms m/s": f"{math.sqrt((speed**2).mean()):.3f}",
                "L_m rms m, f_mu right": f"{math.sqrt((step**2).mean()):.3f}",
                **{
                    f"{sign} against no noise %": 100
                    * float((own[name].astype(float) / own[f"clean_{name}"]).median() - 1)
                    for name, sign in (("doppler_bandwidth_hz", "B_mu"), ("limb_torso_ratio", "rho"))
                },
            }
        )
    return pd.DataFrame(found)


def coverage(rows: pd.DataFrame) -> pd.DataFrame:
    """Tabulate the shares of errors within one and two stated standard deviations; wrong octaves are left out."""
    right = rows[rows["error"] < 0.1]
    truths = {
        "torso_velocity_mps": right["true_mps"],
        "gait_frequency_hz": right["truth_hz"],
        "step_length_m": np.sign(right["step_length_m"].astype(float)) * right["true_mps"].abs() / right["truth_hz"],
        "harmonic_ratio_2": pd.Series(2.0, right.index),
        "doppler_bandwidth_hz": right["clean_doppler_bandwidth_hz"],
        "limb_torso_ratio": right["clean_limb_torso_ratio"],
    }
    found = []
    for name, truth in truths.items():
        own = right["snr_mu_db"]
        noisy = (np.isfinite(own) & (own > 0.0)) | (name not in NOISE_ONLY)
        score = ((right[name].astype(float) - truth) / right[f"sd_{name}"].astype(float)).abs()[noisy].dropna()
        kind = (right["source"] + " " + right["label"])[score.index]
        cells = score.groupby(kind).agg(
            lambda z: f"{100 * (z <= 1).mean():.0f} / {100 * (z <= 2).mean():.0f} ({z.size})"
        )
        found.append({"feature": name, **cells})
    return pd.DataFrame(found)


def rated(rows: pd.DataFrame) -> pd.DataFrame:
    """Add errors, periods, and groups of views and periods to the rows."""
    ratio = rows["found_hz"].astype(float) / rows["truth_hz"]
    aspect_deg = np.minimum(rows["aspect_deg"], 180.0 - rows["aspect_deg"])
    periods = rows["truth_hz"] * rows["seconds"]
    octave = (np.abs(np.log2(ratio)) > 0.9) & (np.abs(np.log2(ratio)) < 1.1)
    return rows.assign(
        error=np.abs(ratio - 1.0), octave=octave, null=ratio.isna(), angle_deg=aspect_deg, periods=periods,
        view=pd.cut(aspect_deg, [-1, 45, 55, 65, 90], labels=["0-45", "45-55", "55-65", "65-80"]).astype(str),
        observed=pd.cut(periods, [0, 2, 3, 5, 1e3], labels=["1-2", "2-3", "3-5", "5-"]).astype(str),
        cadence=np.select([rows["drift"] > DRIFT, rows["drift"] <= DRIFT], ["drifts", "steady"], "unknown"),
        who=rows["source"] + np.where(rows["half"] == "", "", " " + rows["half"]),
        **{f"clean_{name}": _without_noise(rows, name) for name in NOISE_ONLY},
    )  # fmt: skip


def _without_noise(rows: pd.DataFrame, name: str) -> pd.Series:
    """Return the value of the same example and method without noise."""
    clean = rows[np.isinf(rows["snr_mu_db"])].set_index(["number", "method"])[name].astype(float)
    return pd.Series(clean.reindex(pd.MultiIndex.from_frame(rows[["number", "method"]])).to_numpy(), rows.index)


def _shares(rows: pd.DataFrame, by: list[str]) -> pd.DataFrame:
    marks = rows.assign(within_2=rows["error"] < 0.02, within_5=rows["error"] < 0.05, within_10=rows["error"] < 0.1)
    grouped = marks.groupby(by, observed=True, dropna=False)
    shares = grouped[["within_2", "within_5", "within_10", "octave", "null"]].mean().mul(100).round(1)
    shares.insert(0, "n", grouped.size())
    return shares.reset_index()


def reliability(rows: pd.DataFrame) -> pd.DataFrame:
    """Compare the confidence with the share that is within 5 %.

    By level; the last row of each set has the mean distance of the two, weighted by n.
    """
    rows = rows[~rows["null"]]
    confidence = rows["confidence"].astype(float)
    level = pd.cut(confidence, [0.0, 0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 0.98, 1.0]).astype(str)
    marks = rows.assign(level=level, confidence=100 * confidence, right=100.0 * (rows["error"] < 0.05))
    by_level = marks.groupby(["who", "level"])[["confidence", "right"]].mean()
    by_level.insert(0, "n", marks.groupby(["who", "level"]).size())
    apart = (by_level["confidence"] - by_level["right"]).abs() * by_level["n"]
    total = by_level["n"].groupby("who").sum()
    means = pd.DataFrame(
        {"n": total, "confidence": math.nan, "right": math.nan, "apart": apart.groupby("who").sum() / total}
    )
    means.index = pd.MultiIndex.from_product([means.index, ["all"]], names=["who", "level"])
    return pd.concat([by_level, means]).sort_index().round(1).reset_index()


def fit_example(example: Example) -> list[dict[str, Any]]:
    """Return truth, weight and terms of the posterior at each noise level."""
    quiet()
    try:
        recording = observe(example)
    except DoppelgaitError:
        return []
    seconds = recording.n_pulses / recording.radar.prf_hz
    truth_hz, _ = rate_over_window(motion_of(example), seconds)
    doubtful = truth_hz * seconds < 1.5 or min(example.aspect_deg, 180.0 - example.aspect_deg) > 60.0
    rows = []
    for _, mu in signatures(example, recording, Analysis(), FIT_SNR_DB):
        seen = observe_signature(crop_to_frame(decimate(mu))[0], Analysis())
        rhythms = measure_target_rhythms([(seen.aligned, seen.excess, seen.floor_v2)])
        (evidence,), (prior,) = compute_terms(rhythms, np.array([seen.line_mps.mean()]))
        terms = np.concatenate([evidence.reshape(-1, GRID_HZ.size), prior]).astype(np.float32)
        person = example.source == "model" and example.label == "human"
        kind = f"{example.body[0]} {example.body[1].get('gait')}" if person else f"{example.source} {example.label}"
        found = {"truth_hz": truth_hz, "weight": 0.3 if doubtful else 1.0, "kind": kind, "seconds": seconds}
        rows.append(found | {"terms": terms})
    return rows


SIGNS = (1, -1, -1, 0, 1, 0, 1, 1, -1)
"""Of the nine weights of a set of rows; 0 is free."""


def fit_weights(rows: pd.DataFrame) -> npt.NDArray[np.float64]:
    """Fit the weights of the posterior by penalised maximum likelihood, every kind alike; shape (59,)."""
    from scipy.optimize import minimize

    rows = rows.assign(weight=rows["weight"] / rows.groupby("kind")["weight"].transform("sum"))
    terms = np.stack(rows["terms"].to_list())
    spread = terms.std(axis=(0, 2))[:, np.newaxis] + 1e-6
    terms = (terms - terms.mean(axis=(0, 2))[:, np.newaxis]) / spread
    near = np.abs(np.log(GRID_HZ / rows["truth_hz"].to_numpy()[:, np.newaxis])) < NEAR
    shut = np.where(GRID_HZ * rows["seconds"].to_numpy()[:, np.newaxis] < LEAST_PERIODS, -50.0, 0.0)
    known = near.any(axis=1)
    terms, near, shut, weight = terms[known], near[known], shut[known], rows["weight"].to_numpy()[known]
    weight = (weight / weight.sum())[:, np.newaxis]

    def loss(weights: npt.NDArray[np.float64]) -> tuple[float, npt.NDArray[np.float64]]:
        odds = np.einsum("d,ndf->nf", weights.astype(np.float32), terms, optimize=True) + shut
        odds = np.exp(odds - odds.max(axis=1, keepdims=True))
        every, right = odds.sum(axis=1, keepdims=True), (odds * near).sum(axis=1, keepdims=True) + 1e-12
        slope = weight * (odds / every - odds * near / right)
        gradient = np.einsum("nf,ndf->d", slope.astype(np.float32), terms, optimize=True).astype(np.float64)
        value = -float((weight * np.log(right / every)).sum())
        return value + PENALTY * float(weights @ weights), gradient + 2.0 * PENALTY * weights

    limits = {1: (0.0, None), -1: (None, 0.0), 0: (None, None)}
    bounds = [limits[sign] for sign in (*6 * SIGNS, *5 * (0,))]
    found = minimize(loss, np.zeros(len(bounds)), jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": 150})
    return np.asarray(found.x / spread[:, 0])


def acceptance(rows: pd.DataFrame) -> pd.DataFrame:
    """Tabulate the requirements on f_mu with results and n. For the models and both halves of the recorded targets."""
    found = []
    for who in sorted(set(rows["who"])):
        for name, bad, most in demands(rows[rows["who"] == who]):
            share = round(100.0 * float(bad.mean()), 2) if len(bad) else math.nan
            met = "-" if math.isnan(share) else "met" if share <= most else "not met"
            found.append((who, name, len(bad), share, most, met))
    names = ["who", "demand", "n", "percent", "at most", "result"]
    return pd.DataFrame(found, columns=names)


def demands(rows: pd.DataFrame) -> Iterator[tuple[str, pd.Series, float]]:
    """Yield name, failures and allowed percentage of every requirement."""
    fails, off_2, off_5 = (~(rows["error"] <= most) for most in (0.1, 0.02, 0.05))
    angle, snr, seconds, periods = rows["angle_deg"], rows["snr_mu_db"], rows["seconds"], rows["periods"]
    front, wide = angle <= 30, (angle <= 45) & (periods >= 5)
    people = (rows["label"] == "human") & angle.between(60, 75) & (seconds >= 3) & (snr == 20)
    yield "fails, to 30 deg, >= 10 dB, >= 2 s", fails[front & (snr >= 10) & (seconds >= 2)], 1.0
    yield "fails, to 30 deg, >= 10 dB, >= 3 periods", fails[front & (snr >= 10) & (periods >= 3)], 0.5
    yield "fails, 40-50 deg, 20 dB, >= 3 s", fails[angle.between(40, 50) & (snr == 20) & (seconds >= 3)], 3.0
    yield "fails, to 30 deg, 5 dB, >= 2 s", fails[front & (snr == 5) & (seconds >= 2)], 3.0
    yield "people fail, 60-75 deg, >= 3 s, 20 dB", fails[people], 15.0
    estimated = (angle >= 60) & (seconds >= 3) & ~rows["null"]
    yield "beyond 60 deg, >= 3 s, not flagged", ~rows["low_confidence"][estimated], 5.0
    yield "off by 2 %, to 45 deg, >= 5 periods, no noise", off_2[wide & np.isinf(snr)], 1.0
    yield "off by 5 %, to 45 deg, >= 5 periods, 10 dB", off_5[wide & (snr == 10)], 5.0
    yield "octave, to 45 deg, >= 5 periods, >= 10 dB", rows["octave"][wide & (snr >= 10)], 0.5


def main() -> None:
    """Run the study and write its tables, or print the weights of a fit."""
    parser = make_parser(__doc__)
    parser.add_argument("--mocap", type=Path, help="folder with human/ and dog/ recordings")
    parser.add_argument("--examples", type=int, default=1400, help="of the models")
    parser.add_argument("--fit", action="store_true", help="print the weights of the posterior instead")
    options = parser.parse_args()
    examples = model_examples(options.examples)
    if options.mocap:
        examples += recorded_examples(options.mocap, first=len(examples))
    if options.fit:
        chosen = [example for example in examples if example.half == "A"]
        weights = fit_weights(pd.DataFrame(run_jobs(fit_example, chosen, processes=options.processes)))
        print(np.array2string(weights[:-5].reshape(-1, 9), precision=3), np.array2string(weights[-5:], precision=3))
        return
    rows = pd.DataFrame(run_jobs(run_example, examples, rows=options.rows, processes=options.processes))
    finish(__file__, __doc__, tabulate(rows), page=options.page)


if __name__ == "__main__":
    main()
