"""Mean curves of recorded walkers and runners, as the tables of the person's model.

    python studies/motion_curves.py MOTION_FOLDER

Fits a straight line in V / sqrt(g l) to every harmonic of the curves of one half of the people, by subject, and prints
the tables of ``doppelgait.motion.models.human_curves``.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import numpy.typing as npt
from recorded_motion import Cycle, find_clips, is_tuning, measure_cycle

from doppelgait.core.errors import DoppelgaitError

N_HARMONICS = 9
TOUCHDOWN_SPEED = 0.75
"""A foot lands where its ankle's forward speed over V falls through this."""
DECIMALS = {"pelvis_speed": 3, "neck_speed": 3, "ankle_speed": 2, "ankle_height": 3, "foot_pitch": 1}


def landing_phase(cycle: Cycle) -> float:
    """Return the phase at which the foot lands after it is furthest ahead."""
    speed = cycle.speed["own_ankle"]
    for number in range(15):
        if speed[number] >= TOUCHDOWN_SPEED > speed[number + 1]:
            return (number + (speed[number] - TOUCHDOWN_SPEED) / (speed[number] - speed[number + 1])) / 100
    return 0.025


def curves_of(cycle: Cycle) -> dict[str, npt.NDArray[np.float64]]:
    """Return the curves that the model has, over the cycle."""
    curves = {
        "pelvis_speed": cycle.speed["pelvis"] - 1,
        "ankle_speed": cycle.speed["own_ankle"] - 1,
        "ankle_height": cycle.height_m["own_ankle"] / cycle.leg_m,
    }
    if "neck" in cycle.speed:
        curves["neck_speed"] = cycle.speed["neck"] - 1
    if "own_tip" in cycle.speed:
        rise_m = cycle.height_m["own_tip"] - cycle.height_m["own_ankle"]
        pitch = np.degrees(np.arctan2(rise_m, cycle.ahead_m["own_tip"] - cycle.ahead_m["own_ankle"]))
        standing = slice(25, 35) if cycle.speed_mps < 2.1 else slice(12, 20)
        curves["foot_pitch"] = pitch - np.median(pitch[standing])
    return curves


def fit_tables(cycles: list[Cycle]) -> dict[str, tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]]:
    """Fit mean and slope of every curve, at 20 phases of a cycle or 10 of a step."""
    middle = float(np.mean([cycle.dimensionless_speed for cycle in cycles]))
    harmonics: dict[str, list[tuple[float, npt.NDArray[np.complex128]]]] = {}
    for cycle in cycles:
        turn = np.exp(2j * np.pi * np.arange(N_HARMONICS + 1) * landing_phase(cycle))
        for name, curve in curves_of(cycle).items():
            found = np.fft.rfft(curve)[: N_HARMONICS + 1] / 50 * turn
            found[0] /= 2
            harmonics.setdefault(name, []).append((cycle.dimensionless_speed - middle, found))
    tables = {}
    for name, rows in harmonics.items():
        design = np.stack([np.ones(len(rows)), [speed for speed, _ in rows]], axis=1)
        fitted = np.linalg.lstsq(design, np.array([row for _, row in rows]), rcond=None)[0]
        n_phases = 20
        if name in ("pelvis_speed", "neck_speed"):  # the same in every step
            fitted[:, 0], fitted[:, 1::2], n_phases = 0, 0, 10
        phase = np.arange(n_phases) / 20
        turns = np.exp(2j * np.pi * np.outer(phase, np.arange(N_HARMONICS + 1)))
        mean, slope = (turns @ row for row in fitted)
        tables[name] = (mean.real, slope.real)
    return tables


def main() -> None:
    """Read the tuning half and print its tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("motion_folder", type=Path)
    folder = parser.parse_args().motion_folder
    cycles: dict[str, list[Cycle]] = {"walk": [], "run": []}
    for clip in find_clips(folder):
        if not is_tuning(clip, folder):
            continue
        try:
            cycle = measure_cycle(clip.read(folder))
        except DoppelgaitError as error:
            print(f"left out: {error}")
            continue
        usable = cycle is not None and np.isfinite(cycle.leg_m) and cycle.speed_mps > 0.5
        if usable and cycle is not None and cycle.speed["own_ankle"].max() < 4.5:  # a jump of the skeleton
            cycles[clip.gait].append(cycle)
    for gait, found in cycles.items():
        speeds = [cycle.dimensionless_speed for cycle in found]
        print(
            f"{gait}: {len(found)} clips, V/sqrt(gl) {min(speeds):.2f}, mean {np.mean(speeds):.3f}, {max(speeds):.2f}"
        )
        for name, table in fit_tables(found).items():
            for row in table:
                print(f"  {name}: " + ", ".join(f"{value:.{DECIMALS[name]}f}" for value in row))


if __name__ == "__main__":
    main()
