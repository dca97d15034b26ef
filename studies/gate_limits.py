"""Limits of tracks: weakest walker, false tracks, loss of the torso.

    python studies/gate_limits.py [--part weakest false torso] [--draws 3] [--minutes 4]

Every run draws its target with its own seed. SNR_frame: mean power of the strongest bin over that of the noise. The
truth is used only to judge. Prints markdown.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import xarray as xr
from gates import MODELS, SEED, SPAN_M, X4, own_track, spoilt, tracks_in, truth_of, walk_past

from doppelgait.core.labels import read_axis
from doppelgait.core.rng import Streams
from doppelgait.motion.models.confusers import fan
from doppelgait.motion.models.human import human_gait
from doppelgait.pipeline import analyze, simulate
from doppelgait.pipeline.conditions import Conditions
from doppelgait.processing import Analysis, Gate
from doppelgait.processing.clutter import ClutterKind, predict_torso_share_removed, remove_static_clutter
from doppelgait.processing.detect import Detector, find_scans
from doppelgait.processing.track import track
from doppelgait.radar.impairments import ThermalNoise, noise_power_per_sample_v2
from doppelgait.radar.recording import Recording
from doppelgait.radar.simulate import synthesise
from doppelgait.scene import Scene, Target

FloatArray = npt.NDArray[np.float64]
Rng = np.random.Generator


# The weakest walker -----------------------------------------------------------------------------------------------

SWEEP_DB = (15.0, 12.5, 10.0, 7.5, 5.0, 2.5, 0.0, -2.5, -5.0)


def print_weakest(draws: int) -> None:
    """Tabulate tracked runs and tracked time.

    Runs in which one track covers 90 % of the walk.
    """
    print("\n### Tracks kept against SNR_frame (x4, static clutter 20 dB above the echo)\n")
    print("| target | n | " + " | ".join(f"{level_db:g} dB" for level_db in SWEEP_DB) + " | 90 % of runs from |")
    print("|---" * (len(SWEEP_DB) + 3) + "|")
    runs = 8 * draws
    for kind_number, kind in enumerate(list(MODELS)[:4]):
        covered = np.zeros((runs, len(SWEEP_DB)))
        for run in range(runs):
            rng = np.random.default_rng([SEED, 3, kind_number, run])
            recording = walk_past(kind, X4, float(rng.uniform(0.0, 45.0)), rng)
            times_s = recording.slow_time_s
            truth = truth_of(recording)
            for n, level_db in enumerate(SWEEP_DB):
                best = own_track(tracks_in(spoilt(recording.baseband, level_db, rng), X4), truth, 0)
                seconds = 0.0 if best is None else best.last_s - best.first_s + 0.1
                covered[run, n] = min(1.0, seconds / (times_s[-1] - times_s[0]))
        kept = (covered >= 0.9).mean(axis=0)
        cells = " | ".join(f"{100 * k:.0f} / {100 * t:.0f} %" for k, t in zip(kept, covered.mean(axis=0), strict=True))
        fails = np.flatnonzero(kept < 0.9)
        lowest = SWEEP_DB[fails[0] - 1] if fails.size and fails[0] else np.nan if fails.size else SWEEP_DB[-1]
        print(f"| {kind} | {runs} | {cells} | {lowest:g} dB |", flush=True)


# False tracks -----------------------------------------------------------------------------------------------------

PHASE: dict[str, object] = {"kind": "phase_noise", "white_rad": 0.004}
DRIFT = PHASE | {"drift_rad_per_min": 1.0, "walk_rad_per_sqrt_min": 0.5}
JITTER: list[dict[str, object]] = [
    {"kind": "frame_jitter", "sd_s": 1e-5}, {"kind": "dropped_frames", "probability": 0.001},
]  # fmt: skip
OFFICE: dict[str, object] = {
    "kind": "static_clutter", "in_units": True, "levels": [[0.85, -51], [2.0, -60], [4.0, -68], [8.0, -80]],
}  # fmt: skip
FAN_M = 4.0
"""Range of the fan, which is seen from the side: its blades come and go."""


def clutter_at(level_db: float) -> dict[str, object]:
    """Add static clutter above the thermal noise of the X4.

    The same at all ranges.
    """
    noise_db = 10 * np.log10(noise_power_per_sample_v2(ThermalNoise(), X4))
    return {"kind": "static_clutter", "levels": [[0.0, float(noise_db) + level_db]]}


def rooms() -> dict[str, tuple[list[Target], list[dict[str, object]]]]:
    """Make empty rooms with confusers and impairments."""
    rotor = Target(fan(duration_s=62.0), start_position_m=(3.5, 2.0), heading_deg=60.0, background=True)
    leak: dict[str, object] = {"kind": "leakage"}
    return {
        "noise": ([], []),
        "clutter 20 dB above noise, phase noise 4 mrad": ([], [clutter_at(20), PHASE]),
        "clutter 30 dB, phase noise 4 mrad": ([], [clutter_at(30), PHASE]),
        "clutter 40 dB, phase noise 4 mrad": ([], [clutter_at(40), PHASE]),
        "the same, frame jitter 10 us, 0.1 % dropped": ([], [clutter_at(40), PHASE, *JITTER]),
        "clutter 40 dB, clock drifts 1 rad/min and walks 0.5 rad": ([], [clutter_at(40), DRIFT]),
        "measured office and direct path, the same clock": ([], [leak, OFFICE, DRIFT]),
        "clutter 30 dB, phase noise 4 mrad, fan at 4 m": ([rotor], [clutter_at(30), PHASE]),
    }


def print_false(minutes: int) -> None:
    """Tabulate false tracks per minute in empty rooms.

    Also without the alignment of phases, by the mean.
    """
    print(
        "\n### False tracks\n\n| room without a body | minutes | detections/min | tracks/min | of them at the fan ",
        end="",
    )
    print("| tracks/min by the mean, phases as they are |\n" + "|---" * 6 + "|")
    for number, (name, (bodies, impairments)) in enumerate(rooms().items()):
        count, found, before = 0, [], 0
        for minute in range(minutes):
            rng = Streams(int(np.random.default_rng([SEED, 4, number, minute]).integers(2**31)))
            made = simulate(Scene(bodies, duration_s=60.0), X4, rng=rng, angles=False,
                            conditions=Conditions(impairments=impairments))  # fmt: skip
            scans = find_scans(made.baseband, wavelength_m=X4.wavelength_m)
            count += sum(len(scan.detections) for scan in scans)
            found += track(scans, velocity_span_mps=X4.wavelength_m * X4.prf_hz / 2)
            still = remove_static_clutter(made.baseband, kind="mean")
            before += len(tracks_in(still, X4, Detector(clutter="none")))
        at_fan = sum(bool(bodies) and abs(float(np.median(one.range_m)) - FAN_M) < 0.8 for one in found)
        print(
            f"| {name} | {minutes} | {count / minutes:.0f} | {len(found) / minutes:.2f} | {at_fan} "
            f"| {before / minutes:.2f} |", flush=True,
        )  # fmt: skip


# Torsos that cross ------------------------------------------------------------------------------------------------

KINDS: tuple[ClutterKind, ...] = ("mean", "median", "exponential", "mti")
NEAR_S = 0.1


def crossing_at_90(rng: Rng, seconds: float, slowest_mps: float, fastest_mps: float) -> Recording:
    """Simulate a person who crosses the line of sight at mid-time."""
    speed_mps, range_m = rng.uniform(slowest_mps, fastest_mps), rng.uniform(3.0, 6.0)
    motion = human_gait(gait="walk", speed_mps=speed_mps, height_m=rng.uniform(1.6, 1.9), duration_s=seconds + 1.0)
    start_m = (range_m, -speed_mps * seconds / 2)
    target = Target(motion, label="human", start_position_m=start_m, heading_deg=90.0)
    return simulate(Scene([target], duration_s=seconds), X4, angles=False)


def torso_of(recording: Recording) -> xr.DataArray:
    """Simulate the noise-free echo of the trunk alone."""
    table = recording.truth[0].scatterers
    own = np.flatnonzero(table["part"].values == "torso")
    return synthesise(table.isel(scatterer=own), recording.radar)


def print_torso(draws: int) -> None:
    """Tabulate the energy of the trunk lost to clutter methods.

    Measured, closed form, and the flag of the analysis.
    """
    print("\n### Trunk of a person who crosses at 90 degrees: energy lost (median, 10th to 90th percentile)\n")
    print(
        "| speed m/s, recording s | clutter | n | measured within 0.1 s of the crossing, dB | closed form there, dB ",
        end="",
    )
    print("| measured, whole recording, dB | closed form, dB | flagged `clutter_removal_took_` |\n" + "|---" * 8 + "|")
    for case, (slowest_mps, fastest_mps, seconds) in enumerate(((0.8, 1.5, 5.0), (0.8, 1.5, 15.0), (0.3, 0.5, 5.0))):
        rows: dict[ClutterKind, list[list[float]]] = {kind: [] for kind in KINDS}
        for run in range(4 * draws):
            rng = np.random.default_rng([SEED, 5, case, run])
            recording = crossing_at_90(rng, seconds, slowest_mps, fastest_mps)
            cluttered = recording.with_baseband(spoilt(recording.baseband, 20.0, rng))
            for kind, found in rows.items():
                results = analyze(cluttered, analysis=Analysis(clutter=kind, extended=False))
                flags = [f for r in results for one in (r, *r.segments) for f in one.flags]
                flagged = any(flag.startswith("clutter_removal_took_") for flag in flags)
                found.append([*losses_db(recording, kind), float(flagged), float(bool(results))])
        for kind, found in rows.items():
            table = np.array(found)
            low, middle, high = np.quantile(table, [0.1, 0.5, 0.9], axis=0)
            cells = " | ".join(f"{middle[n]:.1f} ({low[n]:.1f} to {high[n]:.1f})" for n in range(4))
            print(
                f"| {slowest_mps:g}-{fastest_mps:g}, {seconds:g} | {kind} | {len(found)} | {cells} "
                f"| {table[:, 4].sum():.0f} of {table[:, 5].sum():.0f} found |", flush=True,
            )  # fmt: skip


def losses_db(recording: Recording, kind: ClutterKind) -> list[float]:
    """Return the loss of the trunk near the crossing and overall.

    Measured and closed form.
    """
    before = torso_of(recording)
    after = remove_static_clutter(before, kind=kind)
    truth, times_s = recording.truth[0], read_axis(before, "slow_time")
    gate = Gate.around(times_s, truth.centre_range_m, span_m=SPAN_M, source="truth")
    energy = (np.abs(before.values) ** 2).sum(axis=1)
    left = (np.abs(after.values) ** 2).sum(axis=1)
    share = predict_torso_share_removed(
        gate, times_s, kind=kind, wavelength_m=X4.wavelength_m, prf_hz=X4.prf_hz, n_pulses=times_s.size
    )
    near = np.abs(times_s - times_s.mean()) <= NEAR_S
    found = []
    for part in (near, np.ones(near.size, dtype=bool)):
        closed = (energy[part] * (1.0 - share[part])).sum() / energy[part].sum()
        found += [-10 * np.log10(left[part].sum() / energy[part].sum()), -10 * np.log10(closed)]
    return [float(v) for v in found]


def main() -> None:
    """Print the selected tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parts: dict[str, Callable[[], None]] = {
        "weakest": lambda: print_weakest(arguments.draws),
        "false": lambda: print_false(arguments.minutes),
        "torso": lambda: print_torso(arguments.draws),
    }
    parser.add_argument("--part", nargs="+", choices=list(parts), default=list(parts))
    parser.add_argument("--draws", type=int, default=3)
    parser.add_argument("--minutes", type=int, default=4, help="of every room without a body")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    started_s = time.perf_counter()
    for name in arguments.part:
        parts[name]()
        print(f"\n{time.perf_counter() - started_s:.0f} s", flush=True)


if __name__ == "__main__":
    main()
