"""Mean curves of recorded walkers and runners, as the tables of the person's model.

    python studies/motion_curves.py MOTION_FOLDER

Fits a straight line in sqrt(g l) / V to every harmonic of the curves of one half of the people, by subject, and prints
the tables of ``doppelgait.motion.models.curves``. It takes half a minute of one core.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from harness import make_parser
from recorded_motion import Cycle, find_clips, is_tuning, measure_cycle

from doppelgait.core.errors import DoppelgaitError
from doppelgait.motion.models.curves import ARM_CURVES, SLOWEST_ARMS

N_HARMONICS = 9
LANDING_SPEED, LIFTING_SPEED = 0.3, 0.2
"""A foot lands where its ankle's forward speed over V falls through the first: while the sole comes down about the heel
the model's ankle moves at 0.2 V to 0.3 V, and whatever recorded ankles move beyond that makes its swing too fast. It is
lifted where the speed of its tip rises through the second, which is what smoothing leaves of its start from rest."""
DECIMALS = dict.fromkeys((*ARM_CURVES, "foot_pitch", "pelvic_list", "pelvic_torsion"), 1)
DECIMALS |= {"pelvis_speed": 3, "neck_speed": 3, "ankle_speed": 2, "ankle_height": 3, "pelvis_height": 4}
HALF_SHOULDER, HALF_HIP = 0.1295 / 0.491, 0.0955 / 0.491
"""Of the model's figure, over the leg length."""


def landing_phase(cycle: Cycle) -> float:
    """Return the phase at which the foot lands after it is furthest ahead."""
    return _crossing(-cycle.speed["own_ankle"], -LANDING_SPEED, 0)


def lifting_phase(cycle: Cycle) -> float:
    """Return the phase at which the tip of the foot leaves the floor."""
    return _crossing(cycle.speed["own_tip"], LIFTING_SPEED, 20)


def _crossing(curve: npt.NDArray[np.float64], level: float, first: int) -> float:
    """Return the first phase from one on at which a curve rises through a level."""
    number = first + int(np.flatnonzero((curve[first:-1] < level) & (curve[first + 1 :] >= level))[0])
    return (number + float((level - curve[number]) / (curve[number + 1] - curve[number]))) / 100


def curves_of(cycle: Cycle) -> dict[str, npt.NDArray[np.float64]]:
    """Return the curves that the model has, over the cycle."""

    def angle_deg(upper: str, lower: str) -> npt.NDArray[np.float64]:
        down_m = cycle.height_m[upper] - cycle.height_m[lower]
        return np.degrees(np.arctan2(cycle.ahead_m[lower] - cycle.ahead_m[upper], down_m))

    curves = {
        "pelvis_speed": cycle.speed["pelvis"] - 1,
        "ankle_speed": cycle.speed["own_ankle"] - 1,
        "ankle_height": cycle.height_m["own_ankle"] / cycle.leg_m,
    }
    if "neck" in cycle.speed:
        curves["neck_speed"] = cycle.speed["neck"] - 1
    if "own_hip" in cycle.height_m:
        above_m = (cycle.height_m["own_hip"] - cycle.height_m["other_hip"]) / 2
        ahead_m = (cycle.ahead_m["own_hip"] - cycle.ahead_m["other_hip"]) / 2
        curves["pelvis_height"] = (cycle.height_m["own_hip"] - above_m) / cycle.leg_m  # that of a run is mechanics
        curves["pelvic_list"] = np.degrees(np.arcsin(above_m / (HALF_HIP * cycle.leg_m)))
        curves["pelvic_torsion"] = np.degrees(np.arcsin(ahead_m / (HALF_HIP * cycle.leg_m)))
    if "own_tip" in cycle.speed:
        pitch = angle_deg("own_ankle", "own_tip")
        curves["foot_pitch"] = pitch - np.median(pitch[slice(25, 35) if cycle.speed_mps < 2.1 else slice(12, 20)])
    if {"own_shoulder", "own_elbow", "own_hand"} <= cycle.speed.keys():
        curves["shoulder"] = angle_deg("own_shoulder", "own_elbow")
        curves["elbow"] = angle_deg("own_elbow", "own_hand") - curves["shoulder"]
        ahead_m = (cycle.ahead_m["own_shoulder"] - cycle.ahead_m["other_shoulder"]) / 2
        curves["thorax_torsion"] = np.degrees(np.arcsin(ahead_m / (HALF_SHOULDER * cycle.leg_m)))
    return curves


def fit_tables(cycles: list[Cycle]) -> dict[str, tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]]:
    """Fit mean and slope of every curve, at 20 phases of a cycle or 10 of a step."""
    middle = float(np.mean([1 / cycle.dimensionless_speed for cycle in cycles]))
    harmonics: dict[str, list[tuple[float, npt.NDArray[np.complex128]]]] = {}
    for cycle in cycles:
        turn = np.exp(2j * np.pi * np.arange(N_HARMONICS + 1) * landing_phase(cycle))
        for name, curve in curves_of(cycle).items():
            found = np.fft.rfft(curve)[: N_HARMONICS + 1] / 50 * turn
            found[0] /= 2
            slowest = SLOWEST_ARMS if name in ARM_CURVES else 0.0
            slowness = 1 / max(cycle.dimensionless_speed, slowest) - middle
            harmonics.setdefault(name, []).append((slowness, found))
    tables = {}
    for name, rows in harmonics.items():
        design = np.stack([np.ones(len(rows)), [slowness for slowness, _ in rows]], axis=1)
        fitted = np.linalg.lstsq(design, np.array([row for _, row in rows]), rcond=None)[0]
        n_phases = 20
        if name in ("pelvis_speed", "neck_speed", "pelvis_height"):  # the same in every step
            fitted[:, 0], fitted[:, 1::2], n_phases = 0, 0, 10
            # people are not in phase: the mean of their amplitudes, not the smaller amplitude of their mean
            sizes = np.linalg.lstsq(design, np.abs([row for _, row in rows]), rcond=None)[0][0]
            fitted[:, 2:5:2] *= sizes[2:5:2] / np.abs(fitted[0, 2:5:2])
        elif name in ARM_CURVES:
            # people's swing is a lognormal factor about the geometric mean
            size, growth = np.linalg.lstsq(design, np.log(np.abs([row[1] for _, row in rows])), rcond=None)[0]
            fitted[:, 1] = np.exp(size) * fitted[0, 1] / np.abs(fitted[0, 1]) * np.array([1, growth])
        if name in ("pelvic_list", "pelvic_torsion", "thorax_torsion"):  # the sides are opposite
            fitted[:, ::2] = 0
        turns = np.exp(2j * np.pi / 20 * np.outer(np.arange(n_phases), np.arange(N_HARMONICS + 1)))
        tables[name] = ((turns @ fitted[0]).real, (turns @ fitted[1]).real)
    return tables


def main() -> None:
    """Read the tuning half and print its tables."""
    folder = make_parser(__doc__, motion_folder="folder of the motion recordings").parse_args().motion_folder
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
        speeds = np.array([cycle.dimensionless_speed for cycle in found])
        middle = 1 / np.mean(1 / speeds)
        print(f"{gait}: {len(found)} clips, V/sqrt(gl) {speeds.min():.2f}, mean {middle:.3f}, {speeds.max():.2f}")
        tipped = [cycle for cycle in found if "own_tip" in cycle.speed]
        shares = [lifting_phase(cycle) - landing_phase(cycle) for cycle in tipped]
        slope, share = np.polyfit([1 / cycle.dimensionless_speed - 1 / middle for cycle in tipped], shares, 1)
        print(f"  share on the ground: {share:.3f}, slope {slope:.3f}")
        for name, table in fit_tables(found).items():
            for kind, row in zip(("mean", "slope"), table, strict=True):
                print(f"{name}.{kind} = [" + ", ".join(f"{value:.{DECIMALS[name]}f}" for value in row) + "]")


if __name__ == "__main__":
    main()
