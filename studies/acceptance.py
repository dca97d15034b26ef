"""Accuracy requirements of the gait features, and the report's method.

    python studies/acceptance.py [--mocap FOLDER] [--trials N] [--processes P] [--parts LIST] [--out TABLE.csv]

Five gaits (walking and running people; dogs that walk, trot and gallop) pass the preset ``x4-long`` straight on, the
middle of the way at 5 m or as much more as keeps 2 m distance, in the truth gate unless tracked; three of ten go away.
SNR_mu is the median over time of the strongest clean cell of a column, over the mean noise floor. N trials a cell are a
fifth for each gait. Parts: ``table`` (the report's method against ours, psi 0), ``models``, ``tracked`` (no truth gate:
ground speed and aspect flags), ``labels`` (one motion under two class tags), ``mocap`` (recordings in FOLDER: each
stretch as recorded where it is long enough, else looped over whole strides; approaching or receding in turn, both at
psi 0 and 3 s, where demands are made of each gait), ``wide`` (bandwidth at a frame rate at which nothing aliases).
"""

from __future__ import annotations

import math
import sys
import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from acceptance_tables import REPORT_S, acceptance, by_cell, markdown, report_demands, report_table
from gait_frequency import GRAVITY_MPS2, HIP_SHARE, LOOPED_S, MARGIN_M, MODELS, Example, signatures, stretches
from row_runs import collect_rows, make_parser

from doppelgait.core.errors import DoppelgaitError
from doppelgait.features import GaitFeatures
from doppelgait.motion.loop import loop
from doppelgait.motion.motion import Motion
from doppelgait.motion.retime import travel_speed_mps
from doppelgait.pipeline import analyze, simulate
from doppelgait.pipeline.analyze import Result, analyze_signature
from doppelgait.processing import Analysis, Gate
from doppelgait.radar import Radar, add_noise
from doppelgait.radar.recording import Recording
from doppelgait.scene import Scene, Target
from doppelgait.scene.rcs import RcsSpec

GAITS = ("human walk", "human run", "dog walk", "dog trot", "dog gallop")
FROUDE = {"walk": (0.08, 0.3), "trot": (0.5, 1.2), "gallop": (1.8, 2.8)}
LEVELS_DB = (60.0, 20.0, 10.0, 5.0, 0.0)
STANDARD = Analysis(extended=False)
EXTENDED = Analysis()
LILAND = Analysis(method="liland2018", hop=8)
"""A hop of 8 pulses moves the report's estimate by nothing that its bin of 1 / T_o shows, at an eighth of the time."""
RECEDING_SHARE = 0.3
RHO_BINS = 512
TRACKED_DB = 15.0
WIDE_HZ = 2000.0
"""Frame rate at which no foot aliases; the preset's 1000 Hz holds 10.3 m/s, which runners' feet and dogs' paws pass."""
PARTS = ("table", "models", "tracked", "labels", "mocap", "wide")


@dataclass(frozen=True)
class Trial:
    """One target in one cell.

    Parameters
    ----------
    part : str
    example : Example
        ``aspect_deg`` may be that of a receding target; ``label`` and ``target`` as in the study of gait frequency.
    cell_deg : float
        Aspect of the cell, 0 to 90.
    levels_db : tuple of float
        SNR_mu.
    occluded : bool
        Ellipsoids that hide each other instead of points that do not.
    """

    part: str
    example: Example
    cell_deg: float
    levels_db: tuple[float, ...]
    occluded: bool = False


def target_of(gait: str, rng: np.random.Generator) -> tuple[str, dict[str, Any]]:
    """Sample model and parameters of one target of a gait.

    From the ranges of the reference measurements.
    """
    species, name = gait.split()
    start = {"gait": name, "start_phase": float(rng.random())}
    if species == "human":
        low, high = (0.6, 2.0) if name == "walk" else (2.5, 4.0)
        uneven = float(np.clip(rng.normal(0.0, 0.05), -0.15, 0.15))
        return "human", {
            **start, "height_m": float(rng.uniform(1.55, 1.95)), "speed_mps": float(rng.uniform(low, high)),
            "step_time_sd": 0.02, "step_length_sd": 0.02, "length_asymmetry": uneven,
            "arm_swing": float(np.clip(rng.normal(1.0, 0.05), 0.0, 2.0)),
        }  # fmt: skip
    withers_m = float(rng.uniform(0.25, 0.6))
    low, high = (math.sqrt(froude * GRAVITY_MPS2 * HIP_SHARE * withers_m) for froude in FROUDE[name])
    speed_mps = float(rng.uniform(low, high))
    return "quadruped", {**start, "withers_m": withers_m, "speed_mps": speed_mps, "stride_variation": 0.03}


def cells(part: str) -> Iterator[tuple[float, float, tuple[float, ...], int, bool]]:
    """Return the cells of a part.

    Aspect, seconds, SNR_mu levels, multiple of the usual number of trials, and True where limbs hide each other.
    """
    if part == "table":
        yield from ((0.0, seconds, LEVELS_DB, 1, False) for seconds in REPORT_S)
    elif part == "tracked":
        yield from (
            (psi, seconds, (TRACKED_DB,), 1, False) for psi in (0.0, 30.0, 60.0, 75.0, 90.0) for seconds in (3.0, 5.0)
        )
    elif part == "labels":
        yield 20.0, 2.0, (10.0,), 1, False
    elif part == "wide":
        yield 0.0, 3.0, (20.0,), 5, False
    else:
        own_cell = 5 if part == "models" else 2  # more where a demand is made of each gait
        yield 0.0, 3.0, (60.0, 20.0, 10.0, 5.0), own_cell, False
        front = [(psi, seconds) for psi in (0.0, 15.0, 30.0) for seconds in (1.5, 2.0, 3.0, 5.0)]
        yield from ((*cell, (20.0, 10.0, 5.0), 1, False) for cell in front if cell != (0.0, 3.0))
        side = [(psi, seconds) for psi in (45.0, 60.0, 75.0) for seconds in (3.0, 5.0)]
        yield from ((*cell, (20.0,), 1, False) for cell in side)
        yield from ((45.0, seconds, (20.0,), 1, True) for seconds in ((3.0, 5.0) if part == "models" else ()))


def model_trials(part: str, trials: int) -> list[Trial]:
    """Make trials of the models, the same number of each gait."""
    found: list[Trial] = []
    for psi, seconds, levels_db, times, occluded in cells(part):
        for n in range(max(1, round(times * trials / len(GAITS))) * len(GAITS)):
            number = 100_000 * (PARTS.index(part) + 1) + len(found)
            rng = np.random.default_rng([23, number])
            gait = GAITS[n % len(GAITS)]
            aspect_deg = 180.0 - psi if rng.random() < RECEDING_SHARE else psi
            body = target_of(gait, rng)
            example = Example(number, "model", gait.split()[0], "", body, aspect_deg, seconds)
            found.append(Trial(part, example, psi, levels_db, occluded))
    return found


def mocap_trials(folder: Path) -> list[Trial]:
    """Make trials of every usable recorded segment in every cell.

    Approaching or receding in turn; in order, so that each file is read once.
    """
    found: list[Trial] = []
    for path in sorted(path for kind in ("human", "dog") for path in (folder / kind).rglob("*") if path.is_file()):
        label = path.relative_to(folder).parts[0]
        for stretch, motion in stretches(path).items():
            seconds_recorded = float(np.ptp(motion.time_s))
            for psi, seconds, levels_db, times, occluded in cells("mocap"):
                source = "recorded" if seconds_recorded >= seconds else "looped"
                ways = (psi, 180.0 - psi) if times == 2 else ((psi, 180.0 - psi)[len(found) % 2],)
                for aspect_deg in ways:
                    number = 900_000 + len(found)
                    example = Example(number, source, label, "", (str(path), stretch), aspect_deg, seconds)
                    found.append(Trial("mocap", example, psi, levels_db, occluded))
    return found


@lru_cache(maxsize=2)
def looped(path: str, stretch: int) -> Motion:
    """Loop a segment to the longest time."""
    return loop(stretches(Path(path))[stretch], duration_s=LOOPED_S, variation=0.0)


def motion_of(example: Example) -> Motion:
    """Return the motion of the target.

    It is as long as the example or longer.
    """
    if example.source == "model":
        kind, parameters = example.body
        rng = np.random.default_rng([24, example.number])
        make: Any = MODELS[kind]
        motion: Motion = make(**parameters, duration_s=example.seconds + 0.1, rng=rng)
        return motion
    path, stretch = example.body
    return looped(path, stretch) if example.source == "looped" else stretches(Path(path))[stretch]


def observe(trial: Trial, *, label: str | None = None) -> Recording:
    """Simulate the noise-free recording."""
    motion, seconds = motion_of(trial.example), trial.example.seconds
    rcs = RcsSpec(kind="ellipsoids", occlusion=True) if trial.occluded else RcsSpec()
    target = Target(motion, label=label or trial.example.label, aspect_deg=trial.example.aspect_deg, rcs=rcs)
    stop_m = min(40.0, 5.0 + travel_speed_mps(motion) * seconds + 2 * MARGIN_M)
    prf_hz = {"wide": WIDE_HZ}.get(trial.part, 1000.0)
    radar = Radar.preset("x4-long", range_stop_m=stop_m, prf_hz=prf_hz)
    return simulate(Scene([target], duration_s=seconds), radar, angles=False)


def run_trial(trial: Trial) -> list[dict[str, Any]]:
    """Return one row per method and noise level.

    None where the target cannot be observed.
    """
    warnings.simplefilter("ignore")
    try:
        recording = observe(trial)
        run = {"table": compared, "tracked": tracked, "labels": relabelled}.get(trial.part, measured)
        return [{**facts(trial, recording), **row} for row in run(trial, recording)]
    except DoppelgaitError as error:
        print(f"{trial.example.body}: {error}", file=sys.stderr)
        return []


def facts(trial: Trial, recording: Recording) -> dict[str, Any]:
    """Return the facts of a trial."""
    truth, example = recording.truth[0], trial.example
    gait = "gallop" if truth.gait == "transverse_gallop" else truth.gait
    doppler_hz = truth.doppler_hz(recording.radar.wavelength_m)
    return {
        "part": trial.part, "number": example.number, "source": example.source, "gait": f"{example.label} {gait}",
        "mover": str(example.body), "psi_deg": trial.cell_deg, "seconds": example.seconds,
        "occluded": trial.occluded, "truth_hz": truth.gait_frequency_hz,
        "periods": truth.gait_frequency_hz * example.seconds, "true_mps": float(truth.centre_velocity_mps.mean()),
        "ground_mps": truth.ground_speed_mps, "span_hz": float(np.ptp(doppler_hz)),
    }  # fmt: skip


def measured(trial: Trial, recording: Recording) -> Iterator[dict[str, Any]]:
    """Measure our features at every level.

    At the highest also with a longer transform.
    """
    yield from rows_of(trial, recording, "standard", STANDARD, trial.levels_db)
    if trial.levels_db[0] == LEVELS_DB[0]:
        longer = STANDARD.model_copy(update={"doppler_bins": RHO_BINS})
        yield from rows_of(trial, recording, f"K {RHO_BINS}", longer, trial.levels_db[:1])


def compared(trial: Trial, recording: Recording) -> Iterator[dict[str, Any]]:
    """Measure our features and the report's."""
    for method, analysis in (("standard", STANDARD), ("liland2018", LILAND)):
        yield from rows_of(trial, recording, method, analysis, trial.levels_db)


def rows_of(
    trial: Trial, recording: Recording, method: str, analysis: Analysis, levels_db: tuple[float, ...]
) -> Iterator[dict[str, Any]]:
    """Measure the features by one method."""
    gate = Gate.from_truth(
        recording.truth[0], recording.slow_time_s, analysis, wavelength_m=recording.radar.wavelength_m
    )
    for level_db, mu in signatures(trial.example, recording, analysis, levels_db):
        result = analyze_signature(mu, gate, analysis, label=trial.example.label)
        yield {"method": method, "snr_mu_db": level_db, **found_in(result)}


def found_in(result: Result | None) -> dict[str, Any]:
    """Return the numbers of a result; none without a track."""
    quality = result.quality if result else {}
    features = result.features if result else GaitFeatures()
    return {
        "found_hz": result.gait_frequency_hz if result else None,
        "flagged": result is not None and "low_confidence" in result.flags,
        "v_mps": features.torso_velocity_mps, "b_hz": features.doppler_bandwidth_hz,
        "rho": features.limb_torso_ratio, "speed_mps": quality.get("ground_speed_mps"),
    }  # fmt: skip


def tracked(trial: Trial, recording: Recording) -> Iterator[dict[str, Any]]:
    """Return the result of the track nearest to the target, if any."""
    noise_v2 = noise_for(trial, recording)
    rng = np.random.default_rng([25, trial.example.number])
    baseband = add_noise(recording.baseband, noise_power_v2=noise_v2, rng=rng)
    seen = recording.with_baseband(baseband, truth=())
    results = analyze(seen, gate="track", analysis=STANDARD)
    middle_m = float(np.median(recording.truth[0].centre_range_m))
    nearest = min(results, key=lambda r: abs(float(np.median(r.gate.low_m)) - middle_m), default=None)
    yield {"method": "standard", "snr_mu_db": trial.levels_db[0], "tracks": len(results), **found_in(nearest)}


def noise_for(trial: Trial, recording: Recording) -> float:
    """Return the noise power per sample for the first level."""
    _, clean = next(iter(signatures(trial.example, recording, STANDARD, (math.inf,))))
    top_v2 = float(np.median(clean.values.max(axis=1)))
    n_bins = clean.attrs["n_gate_bins"] / recording.independent_bin_share  # the attribute counts independent bins
    cell_gain = clean.attrs["window_energy"] * n_bins
    return float(top_v2 / 10 ** (trial.levels_db[0] / 10) / cell_gain)


def relabelled(trial: Trial, recording: Recording, analysis: Analysis = EXTENDED) -> Iterator[dict[str, Any]]:
    """Check that features do not depend on the class label.

    They are the same to the last bit.
    """
    other = observe(trial, label="dog" if trial.example.label == "human" else "human")
    level_db = trial.levels_db[0]
    bits = []
    for seen in (recording, other):
        gate = Gate.from_truth(seen.truth[0], seen.slow_time_s, analysis, wavelength_m=seen.radar.wavelength_m)
        _, mu = next(iter(signatures(trial.example, seen, analysis, (level_db,))))
        result = analyze_signature(mu, gate, analysis, label=seen.truth[0].label)
        further = np.array([np.nan if v is None else v for v in result.extended.values()])
        bits.append(result.features.vector().tobytes() + further.tobytes())
    yield {"method": "standard", "snr_mu_db": level_db, "same_bits": bits[0] == bits[1], **found_in(result)}


def report(part: str, rows: pd.DataFrame) -> None:
    """Print the tables of one part."""
    bodies = rows["mover"].nunique()
    print(f"\n## {part}: {rows['number'].nunique()} recordings of {bodies} targets, {len(rows)} rows\n")
    if part == "table":
        print(markdown(report_table(rows)), "\n")
        print(markdown(report_demands(rows)))
        return
    print(markdown(acceptance(rows)))
    if part in ("models", "mocap"):
        print(f"\nf_mu off by more than 10 %, in % (n)\n\n{markdown(by_cell(rows))}")


def main() -> None:
    """Run the study and print its tables."""
    parser = make_parser(__doc__, "--trials", 100, "trials of the models in a cell")
    parser.add_argument("--parts", default=",".join(PARTS))
    options = parser.parse_args()
    start, kept = time.perf_counter(), []
    for part in options.parts.split(","):
        if part == "mocap" and not options.mocap:
            continue
        trials = mocap_trials(options.mocap) if part == "mocap" else model_trials(part, options.count)
        rows = collect_rows(run_trial, trials, processes=options.processes, chunksize=16)
        report(part, rows)
        kept.append(rows)
        if options.out:
            pd.concat(kept).to_csv(options.out, index=False)
    print("\nGate IoU and misses: see studies/detection.py; segments: studies/track_segments.py (docs/tracking.md).")
    print(f"{time.perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main()
