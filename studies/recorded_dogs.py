"""Recorded dogs: clips and mean curves over a stride.

``dog_curves.py`` makes the tables of the dog's model of one dog; ``motion_comparison.py`` compares the model with both.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
from harness import FloatArray
from recorded_motion import SPEED_WINDOW_S, Clip, read_segments
from scipy.signal import savgol_filter

from doppelgait.motion.motion import Motion

SWINGS, SWING_PEAK = 0.5, 1.4
"""A paw swings while it is faster than half of V, if it reaches 1.4 V."""
BEFORE, AFTER = 0.14, 0.08
"""It leaves the ground this much of that time earlier, and comes to rest this much later (mean curves of both dogs)."""
N_PHASES = 50
N_SWING = 13
CYCLE = np.arange(N_PHASES) / N_PHASES
SIDED = {
    "top": ("{S}Shoulder", "b_{S}Clav", "{s}_ribs"),
    "shoulder": ("{S}Arm", "b_{S}Arm", "{s}_shoulder"),
    "elbow": ("{S}ForeArm", "b_{S}ForeArm", "{s}_elbow"),
    "carpus": ("{S}Hand", "b_{S}Hand", "{s}_carpus"),
    "fore_paw": ("{S}Hand_End", "b__{S}Finger", "b_{S}Finger", "{s}_fore_paw"),
    "hip": ("{S}UpLeg", "b_{S}LegUpper", "{s}_hip"),
    "knee": ("{S}Leg", "b_{S}Leg", "{s}_knee"),
    "hock": ("{S}Foot", "b_{S}Leg1", "{s}_hock"),
    "hind_paw": ("{S}Foot_End", "b_{S}Toe", "{s}_hind_paw"),
}
MIDDLE = {
    "pelvis": ("Hips", "b_Hips", "rump"),
    "withers": ("Spine1", "b_Spine3", "withers"),
    "neck_base": ("Neck", "b__Neck", "neck_base"),
    "neck": ("b__Neck1", "neck"),
    "head": ("Head", "b_Head", "head"),
    "nose": ("Head_End", "nose"),
    "tail_base": ("Tail", "b_Tail001", "tail"),
    "tail_middle": ("Tail1", "b_Tail005", "tail_middle"),
    "tail_tip": ("Tail1_End", "b_Tail009", "tail_tip"),
}
"""Points of the body and their names in the recordings and in the model."""


@dataclass(frozen=True)
class Strides:
    """Every stride of a clip, by limb."""

    speed_mps: float
    hip_m: float
    stride_s: FloatArray
    duty: dict[str, float]
    lag: dict[str, float]
    speed: dict[str, FloatArray] = field(default_factory=dict)
    height: dict[str, FloatArray] = field(default_factory=dict)
    ahead: dict[str, FloatArray] = field(default_factory=dict)
    aside: dict[str, FloatArray] = field(default_factory=dict)
    turn_deg: dict[str, FloatArray] = field(default_factory=dict)
    swing: dict[str, FloatArray] = field(default_factory=dict)


def find_dogs(folder: Path) -> Iterator[Clip]:
    """Yield steady segments of dogs with their gait, empty where it is not known."""
    for row, start_s, stop_s in read_segments(folder, "dog"):
        if not row["footfall_note"]:
            gait = "canter" if row["gait"].startswith("canter") else row["gait"]
            yield Clip(row["file"], gait, start_s, stop_s)


def find_points(names: list[str]) -> dict[str, int]:
    """Find the numbers of the body's points."""
    wanted = dict(MIDDLE)
    for side in ("left", "right"):
        for point, patterns in SIDED.items():
            wanted[f"{side}_{point}"] = tuple(p.format(S=side.title(), s=side) for p in patterns)
    found = {}
    for point, patterns in wanted.items():
        for pattern in patterns:
            if pattern in names:
                found[point] = names.index(pattern)
                break
    return found


def find_swings(speed: FloatArray, times_s: FloatArray) -> FloatArray:
    """Find the times between which a paw goes at more than half the body's speed, shape (n, 2)."""
    rises = np.flatnonzero((speed[:-1] < SWINGS) & (speed[1:] >= SWINGS))
    falls = np.flatnonzero((speed[:-1] >= SWINGS) & (speed[1:] < SWINGS))
    found = []
    for first in rises:
        if (last := falls[falls > first]).size and speed[first : last[0]].max() > SWING_PEAK:
            at = np.array([first, last[0]])
            share = (SWINGS - speed[at]) / (speed[at + 1] - speed[at])
            found.append(times_s[at] + share * (times_s[at + 1] - times_s[at]))
    return np.array(found).reshape(-1, 2)


def measure_strides(motion: Motion, *, zero: str = "left_hind") -> Strides | None:
    """Measure all strides of a motion; None without two touchdowns of a foot."""
    found, times_s = find_points(list(motion.markers)), motion.time_s
    rate_hz = motion.rate_hz
    place = {point: motion.position_m[:, number] for point, number in found.items()}
    body = (place["pelvis"] + place["withers"]) / 2
    way = body[-1, :2] - body[0, :2]
    speed_mps = float(np.linalg.norm(way)) / float(times_s[-1] - times_s[0])
    forward = way / np.linalg.norm(way)
    hip_m = 0.8 * motion.facts.height_m
    x = {point: at[:, :2] @ forward for point, at in place.items()}
    window = max(5, round(SPEED_WINDOW_S * rate_hz) | 1)
    speed = {p: savgol_filter(at, window, 3, deriv=1, delta=1 / rate_hz) / speed_mps - 1 for p, at in x.items()}
    centre = body[:, :2] @ forward
    feet = [f"{side}_{end}" for side in ("left", "right") for end in ("hind", "fore")]
    floor_m = float(min(np.nanpercentile(place[f"{foot}_paw"][:, 2], 5) for foot in feet))
    swings = {foot: find_swings(speed[f"{foot}_paw"] + 1, times_s) for foot in feet}
    touch = {foot: found_s[:, 1] + AFTER * (found_s[:, 1] - found_s[:, 0]) for foot, found_s in swings.items()}
    periods = np.concatenate([np.diff(t) for t in touch.values()]) if touch else np.empty(0)
    if not periods.size:
        return None
    usual_s = float(np.median(periods))
    base = touch.get("left_hind", np.empty(0))
    lag = {}
    for foot, t in touch.items():
        phases = [((v - base[np.argmin(np.abs(base - v))]) / usual_s) for v in t] if base.size else []
        if phases:
            z = np.exp(2j * np.pi * np.array(phases)).mean()
            lag[foot] = float(np.angle(z) / (2 * np.pi) % 1)

    def cut(foot: str, row: FloatArray, straight: bool = False) -> FloatArray:
        """Cut the values at all times into the strides of a foot, ``straight`` without the turn of a stride."""
        spans = np.array([s for s in pairwise(touch.get(foot, ())) if 0.75 < (s[1] - s[0]) / usual_s < 1.35])
        if not spans.size:
            return spans
        values = np.interp(spans[:, :1] + np.append(CYCLE, 1) * np.diff(spans), times_s, row)
        return np.asarray(values[:, :-1] - straight * CYCLE * (values[:, -1:] - values[:, :1]))

    left = np.array([-forward[1], forward[0]])
    mirror = -1 if zero.startswith("right") else 1
    curves: tuple[dict[str, FloatArray], ...] = ({}, {}, {}, {}, {})
    for point, at in place.items():
        side, _, name = point.partition("_")
        end = "fore" if name in ("top", "shoulder", "elbow", "carpus", "fore_paw") else "hind"
        foot = f"{side}_{end}" if side in ("left", "right") else zero
        aside = mirror * at[:, :2] @ left / hip_m
        rows = speed[point], (at[:, 2] - floor_m) / hip_m, (x[point] - centre) / hip_m, aside
        for table, row in zip(curves, rows, strict=False):
            if (strides := cut(foot, row, table is curves[3])).size:
                table[point] = strides
    for end, point in (("hind", "hip"), ("fore", "top")):
        if f"left_{point}" in place:
            line = place[f"left_{point}"] - place[f"right_{point}"]
            ahead, across = line[:, :2] @ forward, line[:, :2] @ left
            turns = np.arctan2(-ahead, across), np.arctan2(line[:, 2], np.hypot(ahead, across))
            for turn, values in zip(("yaw", "roll"), turns, strict=True):
                curves[4][f"{end}_{turn}"] = mirror * cut(zero, np.degrees(values), True)
    shapes = {}
    for foot, found_s in swings.items():
        width_s = found_s[:, 1:] - found_s[:, :1]
        at_s = found_s[:, :1] + width_s * np.linspace(-BEFORE, 1 + AFTER, N_SWING)
        whole = (at_s[:, 0] >= times_s[0]) & (at_s[:, -1] <= times_s[-1])
        shapes[foot] = np.interp(at_s[whole], times_s, speed[f"{foot}_paw"] + 1)
    share = 1 + BEFORE + AFTER
    duty = {f: 1 - share * float(np.diff(s).mean()) / usual_s if len(s) else np.nan for f, s in swings.items()}
    return Strides(speed_mps, hip_m, periods, duty, lag, *curves, shapes)
