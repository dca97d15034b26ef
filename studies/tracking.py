"""Tracks of one or two targets, found without truth.

    python studies/tracking.py --page

Question: how near are tracks to the true ranges, do they keep to one body, and do empty scenes have any?

Every run samples speeds, heights and positions with its own seed, simulates the scene for the preset `x4`, adds white
noise at four levels (SNR_frame: mean power of the strongest bin over that of the noise), detects bodies (`find_scans`)
and tracks them (`track`). The true range of the body centre is used only to judge. Input "sampled" feeds the tracker
alone with detections that are sampled from the truth: errors, misses, false detections, and one merged detection for
bodies closer than 0.8 m. GOSPA and OSPA have a cutoff of 1 m; the gate IoU is that of gates of 1.6 m. Brackets are 95
% bootstrap intervals over runs. It takes about 4 minutes of one core.

Not shown: rooms with clutter and reflections ([limits of tracks](gate_limits.md), [everyday scenes](everyday.md)), and
real recordings.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr
from harness import FloatArray, bootstrap_interval, finish, make_parser, quiet, run_jobs

from doppelgait.motion.models import quadruped_gait
from doppelgait.motion.models.human import human_gait
from doppelgait.motion.motion import Motion
from doppelgait.pipeline import simulate
from doppelgait.processing import Gate
from doppelgait.processing.detect.scans import find_scans
from doppelgait.processing.track import Track, Tracker, track
from doppelgait.processing.track.live import Detection, Scan
from doppelgait.radar import Radar, Recording, add_noise
from doppelgait.scene import Scene, Target
from doppelgait.testing.tracking import compare_tracks

RADAR = Radar.preset("x4")
LEVELS_DB = (30.0, 20.0, 10.0, 5.0)
SPAN_M = 1.6
CUTOFF_M = 1.0
SEED = 6300
MERGE_M, MERGE_MPS = 0.8, 2.0
"""Simulated detections closer than this are one, as boxes of people overlap in Doppler."""
RANGE_SD_M, VELOCITY_SD_MPS, DETECTED, FALSE_PER_SCAN, SLOWEST_MPS = 0.07, 0.25, 0.93, 1.0, 0.2


def person(rng: np.random.Generator, speed_mps: float, seconds: float) -> Motion:
    """Sample a walker of random stature, or a runner at high speed."""
    return human_gait(speed_mps=speed_mps, height_m=rng.uniform(1.55, 1.95), duration_s=1.8 * seconds)


def dog(rng: np.random.Generator, speed_mps: float, seconds: float) -> Motion:
    """Sample a trotting dog of random height."""
    return quadruped_gait(gait="trot", speed_mps=speed_mps, withers_m=rng.uniform(0.35, 0.6), duration_s=1.8 * seconds)


def one_walker(rng: np.random.Generator) -> Scene:
    """Make a scene of one oblique person, approaching or receding."""
    speed, away = rng.uniform(0.7, 1.5), bool(rng.integers(2))
    start = (2.0, rng.uniform(-1, 1)) if away else (8.8, rng.uniform(-1, 1))
    heading = (0.0 if away else 180.0) + rng.uniform(-20, 20)
    walker = Target(person(rng, speed, 4.5), label="human", start_position_m=start, heading_deg=heading)
    return Scene([walker], duration_s=4.5)


Place = tuple[tuple[float, float], float]


def pair(
    rng: np.random.Generator, seconds: float, first: Place, second: Place, *, speeds: tuple[float, ...],
    other: str = "dog",
) -> Scene:  # fmt: skip
    """Make a scene of a person and another body: start and heading of both, and the ranges of their speeds."""
    speed, other_speed = rng.uniform(*speeds[:2]), rng.uniform(*speeds[2:])
    motions = person(rng, speed, seconds), (dog if other == "dog" else person)(rng, other_speed, seconds)
    targets = [
        Target(motion, label=label, start_position_m=start_m, heading_deg=heading_deg)
        for motion, label, (start_m, heading_deg) in zip(motions, ("human", other), (first, second), strict=True)
    ]
    return Scene(targets, duration_s=seconds)


def crossing(rng: np.random.Generator) -> Scene:
    """Make a scene of two people who pass each other in range."""
    return pair(rng, 5.0, ((8.2, 0.5), 180), ((2.0, -0.5), 0), speeds=(0.8, 1.3, 0.8, 1.3), other="human")


def person_and_dog(rng: np.random.Generator) -> Scene:
    """Make a scene of an approaching person and a receding dog."""
    return pair(rng, 4.0, ((7.5, 0.4), 180), ((3.0, -0.4), 0), speeds=(0.8, 1.2, 1.3, 1.6))


def dog_overtakes(rng: np.random.Generator) -> Scene:
    """Make a scene of a dog that overtakes a person; for two seconds they are one detection."""
    return pair(rng, 5.0, ((7.0, 0.4), 180), ((9.0, -0.4), 180), speeds=(0.6, 0.9, 1.3, 1.6))


def stop_and_turn(rng: np.random.Generator) -> Scene:
    """Make a scene of a person who stops, turns and returns."""
    speed = rng.uniform(0.9, 1.2)
    path = {"kind": "turn_around", "out_m": rng.uniform(2.5, 3.5), "turn_s": rng.uniform(1.0, 2.0)}
    walker = Target(person(rng, speed, 10.0), label="human", start_position_m=(3.0, 0.3), heading_deg=0, path=path)
    return Scene([walker], duration_s=9.0)


def stop_and_go(rng: np.random.Generator) -> Scene:
    """Make a scene of a person who stops and goes on. The stop lasts 2 to 4 s."""
    stops = [{"at_m": rng.uniform(2.0, 3.0), "pause_s": rng.uniform(2.0, 4.0)}]
    walker = Target(
        person(rng, rng.uniform(0.9, 1.2), 10.0), label="human", start_position_m=(8.8, 0.3), heading_deg=180,
        path={"kind": "stop_and_go", "stops": stops},
    )  # fmt: skip
    return Scene([walker], duration_s=9.0)


def empty(rng: np.random.Generator) -> Scene:
    """Make an empty scene."""
    return Scene([], duration_s=10.0)


SCENES: dict[str, Callable[[np.random.Generator], Scene]] = {
    "one walker": one_walker, "crossing": crossing, "person + dog": person_and_dog,
    "dog overtakes": dog_overtakes, "stop and turn": stop_and_turn,
    "stop and go": stop_and_go, "empty": empty,
}  # fmt: skip


@dataclass(frozen=True)
class Truth:
    """Return true ranges and radial velocities, shape (I, N)."""

    slow_time_s: FloatArray
    range_m: FloatArray
    velocity_mps: FloatArray

    def at(self, times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Interpolate ranges and velocities to other times."""
        columns = range(self.range_m.shape[1])
        ranges = [np.interp(times_s, self.slow_time_s, self.range_m[:, n]) for n in columns]
        velocities = [np.interp(times_s, self.slow_time_s, self.velocity_mps[:, n]) for n in columns]
        shape = (times_s.size, len(columns))
        return np.reshape(np.transpose(ranges), shape), np.reshape(np.transpose(velocities), shape)


def judge(tracks: list[Track], truth: Truth, scans: list[Scan]) -> dict[str, float]:
    """Compare tracks with the truth at the times of the scans."""
    times_s = np.array([scan.time_s for scan in scans])
    true_m, _ = truth.at(times_s)
    found_m = np.full((times_s.size, len(tracks)), np.nan)
    for n, one in enumerate(tracks):
        found_m[np.searchsorted(times_s, one.times_s - 1e-6), n] = one.range_m
    result = compare_tracks(found_m, true_m, cutoff=CUTOFF_M)
    overlap, tracked, bias, parts, delay = [], [], [], [], []
    for n in range(true_m.shape[1]):
        near = [m for m in range(len(tracks)) if result.purity[m] >= 0.5 and result.owner[m] == n]
        parts.append(len(near))
        iou, share = _iou([tracks[m] for m in near], truth, n)
        overlap.append(iou)
        tracked.append(iou / share if share else np.nan)
        errors = np.concatenate([found_m[:, m] - true_m[:, n] for m in near]) if near else np.array([np.nan])
        bias.append(np.nanmean(errors))
        delay.append(min((tracks[m].confirmed_at_s for m in near), default=np.nan) - times_s[0])
    return {
        "gospa": result.gospa, "ospa": result.ospa, "rms_m": result.rms, "bias_m": _mean(bias),
        "completeness": _mean(result.completeness), "iou": _mean(overlap), "iou_while_tracked": _mean(tracked),
        "switches": result.switches, "parts": _mean(parts), "false_tracks": int((result.purity < 0.5).sum()),
        "delay_s": _mean(delay), "seconds": float(np.ptp(times_s)),
    }  # fmt: skip


def _iou(tracks: list[Track], truth: Truth, number: int) -> tuple[float, float]:
    """Return the mean IoU and the share of gated time."""
    best = np.zeros(truth.slow_time_s.size)
    inside = np.zeros(best.size, dtype=bool)
    for one in tracks:
        gate = Gate.from_track(one, span_m=SPAN_M, time_s=truth.slow_time_s)
        both_m = SPAN_M - np.abs(np.interp(truth.slow_time_s, gate.time_s, gate.centre_m) - truth.range_m[:, number])
        gated = (truth.slow_time_s >= gate.start_s) & (truth.slow_time_s <= gate.stop_s)
        best = np.maximum(best, np.where(gated & (both_m > 0), both_m / (2 * SPAN_M - both_m), 0.0))
        inside |= (truth.slow_time_s >= one.first_s - 0.05) & (truth.slow_time_s <= one.last_s + 0.05)
    return float(best.mean()), float(inside.mean())


def _mean(values: npt.ArrayLike) -> float:
    array = np.asarray(values, dtype=float)
    return float(np.nanmean(array)) if np.isfinite(array).any() else float("nan")


def draw_scans(truth: Truth, rng: np.random.Generator) -> list[Scan]:
    """Simulate detections at 10 Hz with errors, misses, false ones, and one for two bodies that are close."""
    times_s = np.arange(0.05, truth.slow_time_s[-1] - 0.05, 0.1)
    ranges, velocities = truth.at(times_s)
    scans = []
    for t, r, v in zip(times_s, ranges, velocities, strict=True):
        seen = (rng.random(r.size) < DETECTED) & (np.abs(v) > SLOWEST_MPS)
        places = zip(r[seen], v[seen], strict=True)
        bodies = [_sample_detection(a, b, rng) for a, b in places]
        false = [
            _sample_detection(rng.uniform(0.5, 9.5), rng.uniform(-6, 6), rng)
            for _ in range(rng.poisson(FALSE_PER_SCAN))
        ]
        scans.append(Scan(float(t), (*_merge(bodies), *(replace(d, power_v2=0.05) for d in false))))
    return scans


def _sample_detection(range_m: float, velocity_mps: float, rng: np.random.Generator) -> Detection:
    r = range_m + RANGE_SD_M * rng.standard_normal()
    v = velocity_mps + VELOCITY_SD_MPS * rng.standard_normal()
    return Detection(r, v, 1.0, RANGE_SD_M, VELOCITY_SD_MPS, r - 0.3, r + 0.3, v - 1.0, v + 1.2, 30)


def _merge(bodies: list[Detection]) -> list[Detection]:
    if len(bodies) < 2:
        return bodies
    a, b = bodies
    if abs(a.range_m - b.range_m) > MERGE_M or abs(a.velocity_mps - b.velocity_mps) > MERGE_MPS:
        return bodies
    r, v = (a.range_m + b.range_m) / 2, (a.velocity_mps + b.velocity_mps) / 2
    box = (
        min(a.range_low_m, b.range_low_m), max(a.range_high_m, b.range_high_m),
        min(a.velocity_low_mps, b.velocity_low_mps), max(a.velocity_high_mps, b.velocity_high_mps),
    )  # fmt: skip
    return [Detection(r, v, 2.0, 0.15, 0.4, *box, 60)]


def noisy_copy(baseband: xr.DataArray, level_db: float, rng: np.random.Generator) -> xr.DataArray:
    """Add receiver noise at SNR_frame, in an empty scene 1 V^2."""
    signal_v2 = float((np.abs(baseband.values) ** 2).max(axis=1).mean())
    return add_noise(baseband, noise_power_v2=signal_v2 / 10 ** (level_db / 10) if signal_v2 > 0 else 1.0, rng=rng)


def run_scene(job: tuple[str, int]) -> list[dict[str, Any]]:
    """Simulate a scene and score its tracks at every level."""
    quiet()
    name, number = job
    rng = np.random.default_rng([SEED, list(SCENES).index(name), number])
    recording = simulate(SCENES[name](rng), RADAR, angles=False)
    truth = truth_of(recording)
    cases = {"sampled": draw_scans(truth, rng)} if truth.range_m.size else {}
    for level_db in LEVELS_DB if truth.range_m.size else LEVELS_DB[:1]:
        baseband = noisy_copy(recording.baseband, level_db, rng)
        cases[f"{level_db:g} dB"] = find_scans(baseband, wavelength_m=RADAR.wavelength_m)
    span_mps = RADAR.wavelength_m * RADAR.prf_hz / 2
    return [
        {
            "scene": name,
            "input": case,
            **judge(track(scans, Tracker(), velocity_span_mps=span_mps), truth, scans),
        }
        for case, scans in cases.items()
    ]


def truth_of(recording: Recording) -> Truth:
    """Return the true ranges and velocities of all bodies."""
    times_s, truths = recording.slow_time_s, recording.truth
    shape = (times_s.size, len(truths))
    ranges = np.reshape(np.transpose([t.centre_range_m for t in truths]), shape)
    velocities = np.reshape(np.transpose([t.centre_velocity_mps for t in truths]), shape)
    return Truth(times_s, ranges, velocities)


def tabulate(rows: pd.DataFrame) -> pd.DataFrame:
    """Average the scores of all runs by scene and input."""
    found = []
    for (name, case), own in rows.groupby(["scene", "input"], sort=False):
        mean = {key: f"{_mean(own[key]):.3f}" for key in ("gospa", "ospa", "rms_m", "bias_m")}
        low, high = bootstrap_interval(own["gospa"])
        found.append(
            {
                "scene": name,
                "input": case,
                "n": len(own),
                "GOSPA (m)": f"{mean['gospa']} ({low:.3f} to {high:.3f})",
                "OSPA (m)": mean["ospa"],
                "rms (m)": mean["rms_m"],
                "bias (m)": mean["bias_m"],
                "tracked": f"{_mean(own['completeness']):.1%}",
                "gate IoU": _mean(own["iou"]),
                "while tracked": _mean(own["iou_while_tracked"]),
                "runs without switch": f"{np.mean(own['switches'] == 0):.0%}",
                "tracks per body": _mean(own["parts"]),
                "false tracks/min": own["false_tracks"].sum() / own["seconds"].sum() * 60,
                "confirmed after (s)": _mean(own["delay_s"]),
            }
        )
    return pd.DataFrame(found)


def main() -> None:
    """Simulate, track and score."""
    parser = make_parser(__doc__)
    parser.add_argument("--runs", type=int, default=24)
    options = parser.parse_args()
    jobs = list(product(SCENES, range(options.runs)))
    rows = pd.DataFrame(run_jobs(run_scene, jobs, rows=options.rows, processes=options.processes))
    finish(__file__, __doc__, {f"{options.runs} runs a scene": tabulate(rows)}, page=options.page)


if __name__ == "__main__":
    main()
