"""Track gates compared with true gates: features and energy.

    python studies/gates.py [--part features energy] [--draws 3] [--figures FOLDER]

Every run draws its target with its own seed; static clutter lies 20 dB above the mean echo unless a table says
otherwise. SNR_frame: mean power of the strongest bin over that of the noise. The truth is used only to judge. Prints
markdown.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt
import xarray as xr
from matplotlib.figure import Figure
from tracking import SCENES, Truth

from doppelgait import viz
from doppelgait.core.labels import read_axis
from doppelgait.motion.models import quadruped_gait
from doppelgait.motion.models.human import human_gait
from doppelgait.motion.motion import Motion
from doppelgait.motion.retime import travel_speed_mps
from doppelgait.pipeline import Result, analyze, simulate
from doppelgait.pipeline.target import analyze_gated
from doppelgait.processing import Analysis, Gate, remove_clutter
from doppelgait.processing.clutter import remove_static_clutter
from doppelgait.processing.common_phase import remove_common_phase
from doppelgait.processing.detect import Detector, find_scans
from doppelgait.processing.track import Track, track
from doppelgait.radar import Radar
from doppelgait.radar.recording import Recording
from doppelgait.radar.simulate import synthesise
from doppelgait.scene import Scene, Target
from doppelgait.viz.style import name_axes, place_legend_below

SEED = 7300
SPAN_M = 1.6
CLUTTER_OVER_ECHO_DB = 20.0
X4, X4_LONG = Radar.preset("x4"), Radar.preset("x4-long")
FloatArray = npt.NDArray[np.float64]
Rng = np.random.Generator
MODELS: dict[str, tuple[Callable[..., Motion], dict[str, object]]] = {
    "person walks": (human_gait, {"gait": "walk", "speed_mps": (0.8, 1.6), "height_m": (1.55, 1.95)}),
    "person runs": (human_gait, {"gait": "run", "speed_mps": (2.4, 3.4), "height_m": (1.55, 1.95)}),
    "dog walks": (quadruped_gait, {"gait": "walk", "froude": (0.15, 0.3), "withers_m": (0.35, 0.65)}),
    "dog trots": (quadruped_gait, {"gait": "trot", "froude": (0.5, 1.0), "withers_m": (0.35, 0.65)}),
    "dog gallops": (quadruped_gait, {"gait": "canter", "froude": (1.5, 2.2), "withers_m": (0.35, 0.65)}),
}  # fmt: skip


def complex_noise(rng: Rng, shape: tuple[int, ...], power_v2: float) -> npt.NDArray[np.complex64]:
    """Sample circular white noise."""
    parts = rng.standard_normal((2, *shape), dtype=np.float32) * np.float32(np.sqrt(power_v2 / 2.0))
    return np.asarray(parts[0] + 1j * parts[1], dtype=np.complex64)


def make_motion(kind: str, rng: Rng, seconds: float) -> Motion:
    """Sample a motion of one kind."""
    model, options = MODELS[kind]
    sampled = {name: rng.uniform(*v) if isinstance(v, tuple) else v for name, v in options.items()}
    return model(**sampled, duration_s=seconds)


def walk_past(kind: str, radar: Radar, aspect_deg: float, rng: Rng) -> Recording:
    """Simulate one approaching target without noise.

    For as long as the frame holds it, 8 s at most.
    """
    motion = make_motion(kind, rng, 9.0)
    speed_mps = travel_speed_mps(motion)
    first_m = radar.range_stop_m - 1.2
    depth_m = (first_m - 1.8) / max(np.cos(np.deg2rad(aspect_deg)), 0.3)
    seconds = float(min(8.0 if radar is X4_LONG else 5.0, depth_m / speed_mps))
    target = Target(motion, label="target", start_position_m=(min(first_m, 1.8 + speed_mps * seconds + 0.5), 0.0),
                    heading_deg=180.0 - aspect_deg)  # fmt: skip
    return simulate(Scene([target], duration_s=seconds), radar, angles=False)


def spoilt(
    baseband: xr.DataArray, level_db: float, rng: Rng, clutter_db: float | None = CLUTTER_OVER_ECHO_DB
) -> xr.DataArray:
    """Add white noise at SNR_frame and static clutter in every bin."""
    echo_v2 = float((np.abs(baseband.values) ** 2).max(axis=1).mean())
    values = baseband.values + complex_noise(rng, baseband.shape, echo_v2 / 10 ** (level_db / 10))
    if clutter_db is not None:
        values = values + complex_noise(rng, baseband.shape[1:], echo_v2 * 10 ** (clutter_db / 10))
    return baseband.copy(data=values.astype(np.complex64))


def truth_of(recording: Recording) -> Truth:
    """Return the true ranges and velocities of all bodies."""
    ranges = np.transpose([one.centre_range_m for one in recording.truth])
    velocities = np.transpose([one.centre_velocity_mps for one in recording.truth])
    return Truth(recording.slow_time_s, ranges, velocities)


def tracks_in(baseband: xr.DataArray, radar: Radar, detector: Detector | None = None) -> list[Track]:
    """Track with the defaults."""
    scans = find_scans(baseband, detector, wavelength_m=radar.wavelength_m)
    return track(scans, velocity_span_mps=radar.wavelength_m * radar.prf_hz / 2)


# Features ---------------------------------------------------------------------------------------------------------

NAMES = (
    "torso_velocity_mps", "doppler_bandwidth_hz", "step_length_m", "harmonic_ratio_2", "harmonic_ratio_3",
    "limb_torso_ratio", "gait_frequency_hz",
)  # fmt: skip
SIGNS = ("v_m", "B_mu", "L_m", "beta_1", "beta_2", "rho", "f_mu")
ASPECTS_DEG = (0.0, 15.0, 30.0, 45.0)
LEVELS_DB = (30.0, 20.0, 10.0)


@dataclass(frozen=True)
class Pair:
    """Return seven values by the track gate and by a true gate.

    NaN for null; ``way`` names the difference.
    """

    radar: str
    kind: str
    level_db: float
    way: Literal["gate", "whole"]
    by_track: FloatArray
    by_truth: FloatArray


def seven(result: Result | None) -> FloatArray:
    """Return the six features and the gait frequency, NaN for null."""
    if result is None:
        return np.full(len(NAMES), np.nan)
    features = [getattr(result.features, name) for name in NAMES[:-1]]
    return np.array([np.nan if v is None else v for v in [*features, result.gait_frequency_hz]], dtype=float)


def pairs_of(recording: Recording, kind: str, radar: str, level_db: float, rng: Rng) -> Iterator[Pair]:
    """Compare the track gate with true gates.

    Of the same time and data, and without clutter.
    """
    state = rng.bit_generator.state
    cluttered = recording.with_baseband(spoilt(recording.baseband, level_db, rng))
    rng.bit_generator.state = state  # the same noise without the clutter
    bare = recording.with_baseband(spoilt(recording.baseband, level_db, rng, clutter_db=None))
    found = [r for r in analyze(cluttered, analysis=Analysis(extended=False)) if _follows(r, recording)]
    best = max(found, key=lambda r: float(np.ptp(r.gate.time_s)), default=None)
    whole = analyze(bare, gate="truth", analysis=Analysis(extended=False))[0]
    yield Pair(radar, kind, level_db, "whole", seven(best), seven(whole))
    if best is not None:
        settings = Analysis(clutter="median", extended=False)
        clean = remove_clutter(remove_common_phase(cluttered.baseband), settings)
        gate = Gate.from_truth(recording.truth[0], recording.slow_time_s, settings)
        gate = gate.during(best.quality["start_s"], best.quality["stop_s"])
        true = analyze_gated(gate.crop(clean), recording.radar.wavelength_m, gate, settings, None)
        yield Pair(radar, kind, level_db, "gate", seven(best), seven(true))


def _follows(result: Result, recording: Recording) -> bool:
    """Check that the gate of a result follows the body.

    Nearer than 0.8 m for most of its time.
    """
    gate = result.gate
    centre_m = (gate.low_m + gate.high_m) / 2
    times_s = recording.slow_time_s
    true_m = np.interp(gate.time_s, times_s, recording.truth[0].centre_range_m)
    return bool(np.median(np.abs(centre_m - true_m)) < 0.8)


def print_features(draws: int) -> None:
    """Tabulate the differences per feature, by level and target."""
    pairs: list[Pair] = []
    for radar_number, radar in enumerate((X4, X4_LONG)):
        for kind_number, kind in enumerate(MODELS):
            for aspect_deg in ASPECTS_DEG:
                for draw in range(draws):
                    rng = np.random.default_rng([SEED, 1, radar_number, kind_number, int(aspect_deg), draw])
                    recording = walk_past(kind, radar, aspect_deg, rng)
                    for level_db in LEVELS_DB:
                        pairs += pairs_of(recording, kind, ("x4", "x4-long")[radar_number], level_db, rng)
    for way, title in (
        ("gate", "only the gate differs"),
        ("whole", "whole ways: clutter and track, no clutter and truth"),
    ):
        chosen = [p for p in pairs if p.way == way]
        print(f"\n### Features, {title}\n\n{FEATURE_HEADER}")
        for level_db in LEVELS_DB:
            _print_rows(f"{level_db:g} dB", [p for p in chosen if p.level_db == level_db])
        for radar_name in ("x4", "x4-long"):
            _print_rows(radar_name, [p for p in chosen if p.radar == radar_name])
        for kind in MODELS:
            _print_rows(kind, [p for p in chosen if p.kind == kind])


FEATURE_HEADER = (
    "| set | feature | n | median difference % | rms % | rms of the middle 95 % | within 2 / 5 / 10 % "
    "| null by track alone / truth alone / both |\n" + "|---" * 8 + "|"
)


def _print_rows(name: str, pairs: list[Pair]) -> None:
    by_track, by_truth = np.array([p.by_track for p in pairs]), np.array([p.by_truth for p in pairs])
    for n, sign in enumerate(SIGNS):
        a, b = by_track[:, n], by_truth[:, n]
        both = np.isfinite(a) & np.isfinite(b)
        off = (a[both] - b[both]) / np.abs(b[both])
        inner = np.sort(np.abs(off))[: max(1, round(0.95 * off.size))]
        share = " / ".join(f"{100 * np.mean(np.abs(off) <= limit):.0f}" for limit in (0.02, 0.05, 0.1))
        gone = np.isnan(a), np.isnan(b)
        nulls = f"{(gone[0] & ~gone[1]).sum()} / {(~gone[0] & gone[1]).sum()} / {(gone[0] & gone[1]).sum()}"
        print(
            f"| {name} | {sign} | {off.size} | {100 * np.median(off):+.2f} | {100 * np.sqrt(np.mean(off**2)):.1f} "
            f"| {100 * np.sqrt(np.mean(inner**2)):.1f} | {share} | {nulls} |"
        )


# Energy in the gate -----------------------------------------------------------------------------------------------


def share_inside(baseband: xr.DataArray, gate: xr.Dataset | None) -> tuple[float, float]:
    """Return the share of energy of a single target in a gate.

    Over the time of the gate, and over the whole recording.
    """
    power = np.abs(baseband.values).astype(np.float64) ** 2
    total = power.sum()
    if gate is None:
        return np.nan, 0.0
    part = gate.crop(baseband)
    bins = np.arange(part.sizes["range"])
    low, high = gate.edges(read_axis(part, "range"), read_axis(part, "slow_time"), sharp=False)
    # a cell at the edge counts by the share of it that is inside (E-27)
    inside = np.clip(np.minimum(bins + 0.5, high[:, None]) - np.maximum(bins - 0.5, low[:, None]), 0.0, 1.0)
    energy = np.abs(part.values).astype(np.float64) ** 2
    kept = (energy * inside).sum()
    return float(kept / energy.sum()), float(kept / total)


def print_energy(draws: int) -> None:
    """Tabulate the share of energy in track gates and true gates."""
    print("\n### Energy of the target's echo inside the gate (1.6 m)\n")
    print(
        "| scene | SNR_frame dB | targets | tracked | truth gate: median / worst | track gate while tracked: ",
        end="",
    )
    print("median / worst | of the whole recording |\n" + "|---" * 7 + "|")
    for name in ("one walker", "crossing", "person + dog", "stop and turn", "stop and go"):
        rows: dict[float, list[tuple[float, float, float]]] = {20.0: [], 10.0: []}
        for run in range(4 * draws):
            rng = np.random.default_rng([SEED, 2, list(SCENES).index(name), run])
            scene = SCENES[name](rng)
            recording = simulate(scene, X4, angles=False)
            truth = truth_of(recording)
            lone = [synthesise(one.scatterers, X4) for one in recording.truth]
            for level_db, found in rows.items():
                tracks = tracks_in(spoilt(recording.baseband, level_db, rng), X4)
                for number, baseband in enumerate(lone):
                    true = Gate.around(truth.slow_time_s, truth.range_m[:, number], span_m=SPAN_M, source="truth")
                    best = own_track(tracks, truth, number)
                    gate = None if best is None else Gate.from_track(best, span_m=SPAN_M, time_s=truth.slow_time_s)
                    found.append((share_inside(baseband, true)[0], *share_inside(baseband, gate)))
        for level_db, found in rows.items():
            table = 100 * np.array(found)
            low = np.nanmin(table, axis=0)
            middle = np.nanmedian(table, axis=0)
            cells = " | ".join(f"{middle[n]:.1f} / {low[n]:.1f} %" for n in range(3))
            n_tracked = np.isfinite(table[:, 1]).sum()
            print(f"| {name} | {level_db:g} | {len(found)} | {n_tracked} | {cells} |", flush=True)


def own_track(tracks: list[Track], truth: Truth, number: int) -> Track | None:
    """Return the longest track of a body.

    The body is the nearest one, within 0.8 m, for most of its time.
    """
    own = []
    for one in tracks:
        apart_m = np.abs(truth.at(one.times_s)[0] - one.range_m[:, None])
        if np.mean((apart_m.argmin(axis=1) == number) & (apart_m.min(axis=1) < 0.8)) > 0.5:
            own.append(one)
    return max(own, key=lambda one: one.last_s - one.first_s, default=None)


# Figures -------------------------------------------------------------------------------------------------------------


def draw_gates(name: str, run: int) -> Figure:
    """Plot range against time with true gates and track gates.

    After clutter removal.
    """
    rng = np.random.default_rng([SEED, 6, list(SCENES).index(name), run])
    recording = simulate(SCENES[name](rng), X4, angles=False)
    baseband = spoilt(recording.baseband, 20.0, rng)
    clean = remove_static_clutter(remove_common_phase(baseband), kind="median")
    times_s, range_m = read_axis(clean, "slow_time"), read_axis(clean, "range")
    figure = Figure(figsize=(8, 4.5), layout="constrained")
    axes = figure.subplots()
    level_db = 20 * np.log10(np.abs(clean.values[::20]) + 1e-30)
    top_db = float(level_db.max())
    axes.pcolormesh(times_s[::20], range_m, level_db.T, vmin=top_db - 40, vmax=top_db, cmap="Greys", rasterized=True)
    for number, truth in enumerate(recording.truth):
        gate = Gate.around(times_s, truth.centre_range_m, span_m=SPAN_M, source="truth")
        for edge, limit_m in (("low", gate.low_m), ("high", gate.high_m)):
            label = "truth gate" if edge == "low" and number == 0 else None
            axes.plot(times_s, limit_m, color="black", lw=1, ls="--", label=label)
    for number, one in enumerate(tracks_in(baseband, X4)):
        gate = Gate.from_track(one, span_m=SPAN_M, time_s=times_s)
        axes.fill_between(gate.time_s, gate.low_m, gate.high_m, color=f"C{number}", alpha=0.3,
                          lw=0, label=f"track gate {number + 1}")  # fmt: skip
    axes.set_xlim(times_s[0], times_s[-1])
    name_axes(axes, title=f"{name}, SNR_frame 20 dB", x="time (s)", y="range (m)")
    place_legend_below(figure, axes)
    return figure


PARTS = {"features": print_features, "energy": print_energy}


def main() -> None:
    """Print the selected tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--part", nargs="+", choices=list(PARTS), default=list(PARTS))
    parser.add_argument("--draws", type=int, default=3)
    parser.add_argument("--figures", type=Path)
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    started_s = time.perf_counter()
    for name in arguments.part:
        PARTS[name](arguments.draws)
        print(f"\n{time.perf_counter() - started_s:.0f} s", flush=True)
    if arguments.figures:
        arguments.figures.mkdir(parents=True, exist_ok=True)
        for name in ("crossing", "stop and go"):
            viz.save_figure(draw_gates(name, 0), arguments.figures / f"gates-{name.replace(' ', '-')}.png")


if __name__ == "__main__":
    main()
