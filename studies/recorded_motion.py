"""Recorded walkers and runners: clips, halves by subject, and mean curves over a cycle.

``motion_curves.py`` makes the tables of the person's model of one half of the people; ``motion_comparison.py`` compares
the model with the recordings of the other half.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from harness import FloatArray
from scipy.signal import find_peaks, savgol_filter

from doppelgait.motion.motion import Motion
from doppelgait.motion.readers import read

SPEED_WINDOW_S = 0.06
"""Length of the local cubic that speeds are taken from."""
CYCLE = np.arange(100) / 100
TUNING = ("expmap", "cmu_07", "btk_pig", "ezc3d_bts", "c3dorg_ist", "opensim_walking2", "bmc_walk1")
"""Recordings of the half that the model was made of; of the clinical walkers it is every second subject."""
POINTS = {
    "pelvis": ("root", "hips", "base", "[lr][fb]wt", "[lr]ias|[lr]ips", "[lr]asis|[lr]psis"),
    "neck": ("lowerneck", "neck1", "neck", "c7", "cv7", "spine1"),
    "head": ("head", "headend", "[lr]bhd|[lr]fhd", "[lr]hdf|[lr]hdb"),
}
SIDED_POINTS = {
    "hip": ("{s}hipjoint", "{l}hip", "{l}upleg", "upperleg{s}", "{s}ftc", "{s}gtr"),
    "knee": ("{s}femur", "{l}knee", "{l}leg", "lowerleg{s}", "{s}kne", "{s}fle", "{s}knee"),
    "ankle": ("{s}tibia", "{l}ankle", "{l}foot", "foot{s}", "{s}ank", "{s}fal", "{s}ankle"),
    "toe": ("{s}foot", "{l}toebase", "{l}toe", "toes{s}", "{l}toes", "{s}toe", "{s}fm1", "{s}mt1"),
    "tip": ("{s}toes", "{l}toebaseend", "{l}toeend", "{l}toesend"),
    "shoulder": ("{s}clavicle", "{l}arm", "upperarm{s}", "{l}shoulder", "{s}sho", "{s}ac"),
    "elbow": ("{s}humerus", "{l}forearm", "lowerarm{s}", "{l}elbow", "{s}elb", "{s}hle"),
    "hand": ("{s}wrist", "{l}hand", "hand{s}", "{l}wrist", "{s}fin", "{s}wra", "{s}hm2"),
}
"""Points of the body and the plain names that markers and joints have for them; {l} is left or right, {s} l or r."""


@dataclass(frozen=True)
class Clip:
    """A straight segment of a person or a dog, or a whole recording."""

    file: str
    gait: str
    start_s: float | None = None
    stop_s: float | None = None

    def read(self, folder: Path) -> Motion:
        """Read the motion below a folder."""
        part = {} if self.start_s is None else {"start_s": self.start_s, "stop_s": self.stop_s}
        return read(folder / self.file, **part)


@dataclass(frozen=True)
class Cycle:
    """Mean curves of one clip over the cycle of a leg, phase 0 where its foot is furthest ahead of the pelvis."""

    speed_mps: float
    stride_s: float
    leg_m: float
    speed: dict[str, FloatArray] = field(default_factory=dict)
    height_m: dict[str, FloatArray] = field(default_factory=dict)
    ahead_m: dict[str, FloatArray] = field(default_factory=dict)

    @property
    def dimensionless_speed(self) -> float:
        """V / sqrt(g l)."""
        return self.speed_mps / float(np.sqrt(9.81 * self.leg_m))


def read_segments(folder: Path, kind: str) -> Iterator[tuple[dict[str, str], float, float]]:
    """Yield the rows of the table of segments of people or dogs, with start and stop."""
    with (folder / "segments.csv").open() as file:
        for row in csv.DictReader(file):
            if row["class"] == kind:
                rate_hz = float(row["frame_rate_hz"])
                yield row, int(row["start_frame"]) / rate_hz, int(row["end_frame"]) / rate_hz


def find_clips(folder: Path) -> Iterator[Clip]:
    """Yield straight segments of people and the clinical walkers."""
    for row, start_s, stop_s in read_segments(folder, "human"):
        yield Clip(row["file"], "walk" if row["action_label"] == "walk" else "run", start_s, stop_s)
    for path in sorted((folder / "clinic").glob("*.bvh")):
        yield Clip(f"clinic/{path.name}", "walk")


def is_tuning(clip: Clip, folder: Path) -> bool:
    """Return True for a clip of the half that the model was made of."""
    name = clip.file.rpartition("/")[2]
    if clip.file.startswith("clinic/"):
        subjects = sorted({path.name.partition("_")[0] for path in (folder / "clinic").glob("*.bvh")})
        return subjects.index(name.partition("_")[0]) % 2 == 0
    return any(part in clip.file for part in TUNING)


def find_points(names: list[str]) -> dict[str, list[int]]:
    """Find markers or joints of the body's points; sides start with ``l_`` and ``r_``."""
    plain = [re.sub(r"[^a-z0-9]", "", name.lower()) for name in names]
    wanted = {point: patterns for point, patterns in POINTS.items()}
    for short, side in (("l", "left"), ("r", "right")):
        for point, patterns in SIDED_POINTS.items():
            wanted[f"{short}_{point}"] = tuple(pattern.format(s=short, l=side) for pattern in patterns)
    found = {}
    for point, patterns in wanted.items():
        for pattern in patterns:
            if hits := [number for number, name in enumerate(plain) if re.fullmatch(pattern, name)]:
                found[point] = hits
                break
    return found


def measure_cycle(motion: Motion) -> Cycle | None:
    """Measure the mean curves of a motion; None without feet, pelvis or a whole stride."""
    times_s, found = motion.time_s, find_points(list(motion.markers))
    if any(point not in found for point in ("pelvis", "l_ankle", "r_ankle", "l_toe", "r_toe")):
        return None
    rate_hz = 1 / float(times_s[1] - times_s[0])
    place = {point: np.nanmean(motion.position_m[:, markers], axis=1) for point, markers in found.items()}
    way = place["pelvis"][-1, :2] - place["pelvis"][0, :2]
    speed_mps = float(np.linalg.norm(way)) / float(times_s[-1] - times_s[0])
    forward = way / np.linalg.norm(way)
    x = {point: at[:, :2] @ forward for point, at in place.items()}
    window = max(5, round(SPEED_WINDOW_S * rate_hz) | 1)
    speed = {point: savgol_filter(at, window, 3, deriv=1, delta=1 / rate_hz) / speed_mps for point, at in x.items()}
    floor_m = min(float(np.nanpercentile(place[f"{side}_toe"][:, 2], 3)) for side in "lr")
    found_curves: dict[str, list[list[FloatArray]]] = {}
    strides_s = []
    for side in "lr":
        ahead_m = x[f"{side}_ankle"] - x["pelvis"]
        peaks, _ = find_peaks(ahead_m, prominence=0.25 * np.ptp(ahead_m), distance=max(int(0.35 * rate_hz), 1))
        for first_s, last_s in zip(times_s[peaks][:-1], times_s[peaks][1:], strict=True):
            if not 0.5 < last_s - first_s < 2.2:
                continue
            strides_s.append(last_s - first_s)
            at_s = first_s + CYCLE * (last_s - first_s)
            for point in x:
                sided = point[1] == "_"
                name = f"{'own' if point[0] == side else 'other'}_{point[2:]}" if sided else point
                rows = (speed[point], place[point][:, 2] - floor_m, x[point] - x["pelvis"])
                found_curves.setdefault(name, []).append([np.interp(at_s, times_s, row) for row in rows])
    if not strides_s:
        return None
    means = {name: np.mean(curves, axis=0) for name, curves in found_curves.items()}
    leg_m = float("nan")
    if {"l_hip", "l_knee"} <= place.keys():
        bones = (place["l_hip"] - place["l_knee"], place["l_knee"] - place["l_ankle"])
        leg_m = float(np.nanmedian(sum(np.linalg.norm(bone, axis=1) for bone in bones)))
    return Cycle(
        speed_mps, float(np.mean(strides_s)), leg_m,
        *({name: mean[row] for name, mean in means.items()} for row in range(3)),
    )  # fmt: skip
