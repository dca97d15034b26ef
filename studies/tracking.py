"""Tracks without truth, in scenes with none, one or two targets.

    python studies/tracking.py OUT_FOLDER [--runs 24]

Every run draws speeds, heights and places with its own seed, simulates the scene for the preset `x4`, adds white noise
at four levels (SNR_frame), finds bodies (`find_scans`) and follows them (`track`). The true range of the body centre
is used only to judge. The input "drawn" feeds the tracker alone with detections drawn from the truth: errors, misses,
false detections, and one merged detection for bodies closer than 0.8 m. Prints markdown and draws range against time.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import xarray as xr
from matplotlib.figure import Figure

from doppelgait import viz
from doppelgait.motion.models import quadruped_gait
from doppelgait.motion.models.human import human_gait
from doppelgait.motion.motion import Motion
from doppelgait.pipeline import simulate
from doppelgait.processing import Gate
from doppelgait.processing.detect.scans import find_scans
from doppelgait.processing.detections import Detection, Scan
from doppelgait.processing.track import Track, Tracker, track
from doppelgait.radar import Radar, add_noise
from doppelgait.scene import Scene, Target
from doppelgait.testing.tracking import compare_tracks, range_iou
from doppelgait.viz.style import name_axes, place_legend_below

RADAR = Radar.preset("x4")
LEVELS_DB = (30.0, 20.0, 10.0, 5.0)
SPAN_M = 1.6
CUTOFF_M = 1.0
SEED = 6300
MERGE_M, MERGE_MPS = 0.8, 2.0
"""Simulated detections closer than this are one, as boxes of people overlap in Doppler."""
RANGE_SD_M, VELOCITY_SD_MPS, DETECTED, FALSE_PER_SCAN, SLOWEST_MPS = 0.07, 0.25, 0.93, 1.0, 0.2

FloatArray = npt.NDArray[np.float64]


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


def crossing(rng: np.random.Generator) -> Scene:
    """Make a scene of two people who pass each other in range.

    The crossing of the report's Figure 3.15.
    """
    seconds = 5.0
    coming, going = rng.uniform(0.8, 1.3, size=2)
    return Scene(
        [
            Target(person(rng, coming, seconds), label="human", start_position_m=(8.2, 0.5), heading_deg=180),
            Target(person(rng, going, seconds), label="human", start_position_m=(2.0, -0.5), heading_deg=0),
        ],
        duration_s=seconds,
    )


def person_and_dog(rng: np.random.Generator) -> Scene:
    """Make a scene of an approaching person and a receding dog."""
    seconds = 4.0
    coming, going = rng.uniform(0.8, 1.2), rng.uniform(1.3, 1.6)
    return Scene(
        [
            Target(person(rng, coming, seconds), label="human", start_position_m=(7.5, 0.4), heading_deg=180),
            Target(dog(rng, going, seconds), label="dog", start_position_m=(3.0, -0.4), heading_deg=0),
        ],
        duration_s=seconds,
    )


def dog_overtakes(rng: np.random.Generator) -> Scene:
    """Make a scene of a dog that overtakes a person.

    For two seconds they are one detection.
    """
    seconds = 5.0
    slow, fast = rng.uniform(0.6, 0.9), rng.uniform(1.3, 1.6)
    return Scene(
        [
            Target(person(rng, slow, seconds), label="human", start_position_m=(7.0, 0.4), heading_deg=180),
            Target(dog(rng, fast, seconds), label="dog", start_position_m=(9.0, -0.4), heading_deg=180),
        ],
        duration_s=seconds,
    )


def stop_and_turn(rng: np.random.Generator) -> Scene:
    """Make a scene of a person who stops, turns and returns."""
    speed = rng.uniform(0.9, 1.2)
    path = {"kind": "turn_around", "out_m": rng.uniform(2.5, 3.5), "turn_s": rng.uniform(1.0, 2.0)}
    walker = Target(person(rng, speed, 10.0), label="human", start_position_m=(3.0, 0.3), heading_deg=0, path=path)
    return Scene([walker], duration_s=9.0)


def stop_and_go(rng: np.random.Generator) -> Scene:
    """Make a scene of a person who stops and goes on.

    The stop lasts 2 to 4 s.
    """
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


@dataclass(frozen=True)
class Verdict:
    """Scores of one run."""

    gospa: float
    ospa: float
    rms_m: float
    bias_m: float
    completeness: float
    iou: float
    iou_while_tracked: float
    switches: int
    parts: float
    false_tracks: int
    delay_s: float
    seconds: float


def judge(tracks: list[Track], truth: Truth, scans: list[Scan]) -> Verdict:
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
    return Verdict(
        result.gospa, result.ospa, result.rms, _mean(bias), _mean(result.completeness), _mean(overlap), _mean(tracked),
        result.switches, _mean(parts), int((result.purity < 0.5).sum()), _mean(delay), float(np.ptp(times_s)),
    )  # fmt: skip


def _iou(tracks: list[Track], truth: Truth, number: int) -> tuple[float, float]:
    """Return the mean IoU and the share of gated time."""
    reference = Gate.around(truth.slow_time_s, truth.range_m[:, number], span_m=SPAN_M, source="truth")
    each = [range_iou(Gate.from_track(t, span_m=SPAN_M, time_s=truth.slow_time_s), reference) for t in tracks]
    best = np.max(each, axis=0) if each else np.zeros(truth.slow_time_s.size)
    inside = np.zeros(best.size, dtype=bool)
    for one in tracks:
        inside |= (truth.slow_time_s >= one.first_s - 0.05) & (truth.slow_time_s <= one.last_s + 0.05)
    return float(best.mean()), float(inside.mean())


def _mean(values: npt.ArrayLike) -> float:
    array = np.asarray(values, dtype=float)
    return float(np.nanmean(array)) if np.isfinite(array).any() else float("nan")


def draw_scans(truth: Truth, rng: np.random.Generator) -> list[Scan]:
    """Simulate detections from the truth at 10 Hz.

    With errors, misses, false ones, and one for two bodies that are close.
    """
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


@dataclass(frozen=True)
class Run:
    """Data of the figure of one run."""

    truth: Truth
    scans: list[Scan]
    tracks: list[Track]


def run_all(name: str, runs: int, settings: Tracker) -> tuple[dict[str, list[Verdict]], dict[str, Run]]:
    """Run a scene at every level; return scores and the first run."""
    verdicts: dict[str, list[Verdict]] = {}
    shown: dict[str, Run] = {}
    span_mps = RADAR.wavelength_m * RADAR.prf_hz / 2
    for number in range(runs):
        rng = np.random.default_rng([SEED, list(SCENES).index(name), number])
        recording = simulate(SCENES[name](rng), RADAR, angles=False)
        truth = _truth_of(recording.truth, recording.slow_time_s)
        cases = {"drawn": draw_scans(truth, rng)} if truth.range_m.size else {}
        for level_db in LEVELS_DB if truth.range_m.size else LEVELS_DB[:1]:
            baseband = noisy_copy(recording.baseband, level_db, rng)
            cases[f"{level_db:g} dB"] = find_scans(baseband, wavelength_m=RADAR.wavelength_m)
        for case, scans in cases.items():
            tracks = track(scans, settings, velocity_span_mps=span_mps)
            verdicts.setdefault(case, []).append(judge(tracks, truth, scans))
            shown.setdefault(case, Run(truth, scans, tracks))
    return verdicts, shown


def _truth_of(truths: list, slow_time_s: FloatArray) -> Truth:
    shape = (slow_time_s.size, len(truths))
    ranges = np.reshape(np.transpose([t.centre_range_m for t in truths]), shape)
    velocities = np.reshape(np.transpose([t.centre_velocity_mps for t in truths]), shape)
    return Truth(slow_time_s, ranges, velocities)


HEADER = (
    "| scene | input | n | GOSPA (m) | OSPA (m) | rms (m) | bias (m) | tracked | gate IoU | IoU while tracked "
    "| runs without switch | tracks per body | false tracks/min | confirmed after (s) |"
)


def row(name: str, case: str, verdicts: list[Verdict]) -> str:
    """Format one line of the table."""
    mean = {key: _mean([getattr(v, key) for v in verdicts]) for key in Verdict.__dataclass_fields__}
    minutes = sum(v.seconds for v in verdicts) / 60
    quiet = np.mean([v.switches == 0 for v in verdicts])
    false = sum(v.false_tracks for v in verdicts) / minutes
    return (
        f"| {name} | {case} | {len(verdicts)} | {mean['gospa']:.3f} | {mean['ospa']:.3f} | {mean['rms_m']:.3f} "
        f"| {mean['bias_m']:+.3f} | {mean['completeness']:.1%} | {mean['iou']:.2f} | {mean['iou_while_tracked']:.2f} "
        f"| {quiet:.0%} | {mean['parts']:.2f} | {false:.2f} | {mean['delay_s']:.2f} |"
    )


def draw(name: str, shown: dict[str, Run]) -> Figure:
    """Plot range against time, one panel per input.

    Detections grey, truth black, tracks in colour.
    """
    figure = Figure(figsize=(4.2 * len(shown), 4.2), layout="constrained")
    panels = np.atleast_1d(figure.subplots(1, len(shown), sharey=True))
    for axes, (case, run) in zip(panels, shown.items(), strict=True):
        axes.plot(run.truth.slow_time_s, run.truth.range_m, color="black", lw=1)
        places = [(scan.time_s, d.range_m) for scan in run.scans for d in scan.detections]
        if places:
            axes.plot(*np.transpose(places), ".", color="0.6", ms=3, label="detections")
        for number, one in enumerate(run.tracks):
            axes.plot(one.times_s, one.range_m, lw=2.5, alpha=0.7, label=f"track {number + 1}")
        name_axes(axes, title=f"{name}, {case}", x="time (s)", y="range (m)")
        axes.set_ylim(0, 10)
    place_legend_below(figure, panels[0])
    return figure


def main() -> None:
    """Simulate, track, score and plot."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out_folder", type=Path)
    parser.add_argument("--runs", type=int, default=24)
    parser.add_argument("--scene", choices=list(SCENES), action="append")
    arguments = parser.parse_args()
    arguments.out_folder.mkdir(parents=True, exist_ok=True)
    warnings.simplefilter("ignore")
    started_s = time.perf_counter()
    print(HEADER + "\n|" + " --- |" * HEADER.count(" | ") + " --- |")
    for name in arguments.scene or SCENES:
        verdicts, shown = run_all(name, arguments.runs, Tracker())
        for case, each in verdicts.items():
            print(row(name, case, each), flush=True)
        viz.save_figure(draw(name, shown), arguments.out_folder / f"{name.replace(' ', '-')}.png")
    print(f"\n{time.perf_counter() - started_s:.0f} s")


if __name__ == "__main__":
    main()
