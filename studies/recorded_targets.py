"""Recorded targets compared with models of the same size and speed.

By true Doppler lines and signatures.

    python studies/recorded_targets.py MOTION_FOLDER OUT_FOLDER

MOTION_FOLDER holds the recordings named below; what is missing is left out and said. Every pair is walked head-on to
the same radar, looped over whole strides to the same time, with the same radar cross section law and no noise.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from doppelgait import viz
from doppelgait.motion.loop import loop
from doppelgait.motion.models import quadruped_gait
from doppelgait.motion.models.human import human_gait
from doppelgait.motion.motion import Motion
from doppelgait.motion.readers import read
from doppelgait.motion.retime import travel_speed_mps
from doppelgait.pipeline import analyze, simulate
from doppelgait.pipeline.analyze import Result
from doppelgait.processing import Analysis
from doppelgait.radar import Radar
from doppelgait.radar.recording import Recording
from doppelgait.scene import Scene, Target
from doppelgait.viz.signatures import plot_signature
from doppelgait.viz.style import name_axes

OBSERVATION_S = 3.0
RADAR = Radar.preset("x4-long", prf_hz=1600)
"""Unambiguous to 16 m/s: a paw in a gallop at 4.5 m/s comes near 12."""
DB_RANGE = 40.0


@dataclass(frozen=True)
class Pair:
    """One recording and its model.

    Parameters
    ----------
    name : str
    path : str
        Below the motion folder.
    start_s, stop_s : float
        Straight segment at constant velocity.
    label : str
    model : callable
        ``model(speed_mps, height_m, duration_s) -> motion``.
    height_m : float, optional
        Stature or withers height of the recorded target, where the recording does not tell.
    """

    name: str
    path: str
    start_s: float
    stop_s: float
    label: str
    model: Callable[[float, float, float], Motion]
    height_m: float


def person(gait: str) -> Callable[[float, float, float], Motion]:
    """Make the model of a person in a gait."""
    return lambda speed, height, seconds: human_gait(gait=gait, speed_mps=speed, height_m=height, duration_s=seconds)


def dog(gait: str) -> Callable[[float, float, float], Motion]:
    """Make the model of a dog in a gait."""
    return lambda speed, height, seconds: quadruped_gait(
        gait=gait, speed_mps=speed, withers_m=height, duration_s=seconds
    )


PAIRS = (
    Pair("person-walking", "human/c3d/cmu_07_01.c3d", 0.0, 2.6, "human", person("walk"), 1.75),
    Pair("person-running", "human/cmu-expmap/running_1.txt", 0.0, 1.35, "human", person("run"), 1.75),
    Pair("dog-walking", "dog/tencent-bvh/dog_quad_walkrun_005.bvh", 1.55, 4.0, "dog", dog("walk"), 0.57),
    Pair("dog-trotting", "dog/tencent-bvh/dog_idle_004.bvh", 7.85, 10.7, "dog", dog("trot"), 0.57),
    Pair("dog-galloping", "dog/tencent-bvh/dog_quad_walkrun_005.bvh", 4.95, 6.2, "dog", dog("transverse_gallop"), 0.57),
)


def observe(motion: Motion, label: str) -> tuple[Recording, Result]:
    """Simulate the target head-on, its middle at 12 m."""
    scene = Scene([Target(motion, label=label, range_m=14.0)], duration_s=OBSERVATION_S)
    recording = simulate(scene, RADAR, angles=False)
    return recording, analyze(recording, gate="truth", analysis=Analysis())[0]


def figures_of(recording: Recording, result: Result) -> dict[str, float | None]:
    """Return the compared numbers.

    The fastest part is the true one, the 99.9th percentile over points and time.
    """
    speeds = recording.truth[0].scatterers["radial_velocity"].values
    return {
        "speed m/s": recording.truth[0].ground_speed_mps,
        "stride Hz": recording.truth[0].stride_frequency_hz,
        "fastest m/s": float(np.percentile(speeds, 99.9)),
        "slowest m/s": float(np.percentile(speeds, 0.1)),
        "f_mu Hz": result.gait_frequency_hz,
        "v_m m/s": result.features.torso_velocity_mps,
        "B_mu Hz": result.features.doppler_bandwidth_hz,
        "rho": result.features.limb_torso_ratio,
    }


def draw_pair(title: str, observed: dict[str, tuple[Recording, Result]]) -> Figure:
    """Plot signatures and true Doppler lines of recording and model."""
    figure = Figure(figsize=(13, 9), layout="constrained")
    panels = figure.subplots(2, 2, sharex=True, sharey=True)
    limits_hz = shared_limits_hz([recording for recording, _ in observed.values()])
    for column, (name, (recording, result)) in enumerate(observed.items()):
        lines = viz.scatterer_doppler(recording.truth[0].scatterers, wavelength_m=RADAR.wavelength_m)
        for row, truth in enumerate((None, lines)):
            axes = panels[row, column]
            plot_signature(axes, result.signature, truth_doppler=truth, db_range=DB_RANGE, doppler_hz=limits_hz)
            name_axes(axes, title=f"{name}: {title}" if row == 0 else "", x="time (s)", y="Doppler (Hz)")
    return figure


def shared_limits_hz(recordings: list[Recording]) -> tuple[float, float]:
    """Return Doppler limits that hold all lines."""
    lines = np.concatenate([r.truth[0].doppler_hz(RADAR.wavelength_m).ravel() for r in recordings])
    return float(lines.min()) - 60.0, float(lines.max()) + 60.0


def compare(pair: Pair, folder: Path) -> tuple[Figure, dict[str, dict[str, float | None]]]:
    """Make figure and numbers of one pair."""
    clip = read(folder / pair.path, start_s=pair.start_s, stop_s=pair.stop_s)
    real = loop(clip, duration_s=OBSERVATION_S, variation=0.0)
    model = pair.model(travel_speed_mps(real), pair.height_m, OBSERVATION_S)
    observed = {"recorded": observe(real, pair.label), "model": observe(model, pair.label)}
    for motion in (real, model):
        assert motion.time_s[-1] >= OBSERVATION_S - 1e-9
    return draw_pair(pair.name, observed), {name: figures_of(*o) for name, o in observed.items()}


def print_numbers(name: str, numbers: dict[str, dict[str, Any]]) -> None:
    """Format two columns: recorded, model."""
    print(name)
    for key in next(iter(numbers.values())):
        cells = [f"{row[key]:10.3f}" if row[key] is not None else f"{'-':>10s}" for row in numbers.values()]
        print(f"  {key:12s}" + "".join(cells))


def main() -> None:
    """Read, compare and plot."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("motion_folder", type=Path)
    parser.add_argument("out_folder", type=Path)
    arguments = parser.parse_args()
    arguments.out_folder.mkdir(parents=True, exist_ok=True)
    for pair in PAIRS:
        if not (arguments.motion_folder / pair.path).is_file():
            print(f"{pair.name}: left out, there is no {arguments.motion_folder / pair.path}")
            continue
        figure, numbers = compare(pair, arguments.motion_folder)
        viz.save_figure(figure, arguments.out_folder / f"{pair.name}.png")
        print_numbers(pair.name, numbers)


if __name__ == "__main__":
    main()
