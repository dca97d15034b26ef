"""The ground under a body: tilted floors, slopes, and treadmills with their belt speed."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from doppelgait.core.errors import MotionError
from doppelgait.core.units import FloatArray
from doppelgait.motion.motion import Motion
from doppelgait.motion.skeleton import FOOT_PARTS, reduce_word, strip_subject

LOW = 0.1
"""Share of a foot's height range (5th to 95th percentile) in which it is on the ground."""
SLOWEST_BELT_MPS = 0.2
DISAGREEMENT = 0.15
"""Maximum difference of the feet's velocities relative to the belt speed (1 % for the horse of the Vienna data)."""
DRIFT = 0.2
"""Maximum speed of the body relative to the belt speed."""


def belt_velocity_mps(position: FloatArray, parts: Sequence[str], *, rate_hz: float) -> FloatArray | None:
    """Measure the velocity of a treadmill belt, shape (2,)."""
    # the median velocity of the feet while they are low, if all agree and the body stays in place
    named = dict.fromkeys(part for part in parts if part in FOOT_PARTS)
    feet = [[i for i, own in enumerate(parts) if own == part] for part in named]
    if len(feet) < 2 or len(position) < 3:
        return None
    on_belt = []
    for points in feet:
        path = position[:, points].mean(axis=1)
        low, high = np.percentile(path[:, 2], (5, 95))
        velocity = np.gradient(path[:, :2], 1.0 / rate_hz, axis=0)
        on_belt.append(np.median(velocity[path[:, 2] <= low + LOW * (high - low)], axis=0))
    belt = np.mean(on_belt, axis=0)
    speed = float(np.hypot(*belt))
    net = position[-1, :, :2].mean(axis=0) - position[0, :, :2].mean(axis=0)
    drift = float(np.hypot(*net)) * rate_hz / (len(position) - 1)
    apart = float(np.linalg.norm(np.array(on_belt) - belt, axis=1).max())
    is_belt = speed >= SLOWEST_BELT_MPS and apart < DISAGREEMENT * speed and drift < DRIFT * speed
    return belt if is_belt else None


def move_over_ground(motion: Motion) -> Motion:
    """Return a treadmill motion as motion over the ground."""
    # the measured velocity of the belt is subtracted from all points
    position, rate = motion.position_m, motion.rate_hz
    belt = belt_velocity_mps(position, motion.parts, rate_hz=rate)
    if belt is None:
        raise MotionError(
            f"{motion.label}: its feet show no treadmill belt (named feet of both sides that move back together at "
            f"{SLOWEST_BELT_MPS:g} m/s or more while the body keeps its place); leave out treadmill = true"
        )
    elapsed_s = np.arange(len(position))[:, np.newaxis] / rate
    moved = position.copy()
    moved[:, :, :2] -= (elapsed_s * belt)[:, np.newaxis]
    notes = [note for note in motion.report.get("notes", []) if note != format_belt_note(belt)]
    return motion.with_positions(moved).with_report(belt_speed_mps=math.hypot(*belt), notes=notes)


def format_belt_note(belt: FloatArray) -> str:
    """Return the note that a motion is from a treadmill."""
    return (
        f"walks on a treadmill: the feet on the belt move back at {math.hypot(*belt):.2f} m/s while the body keeps its "
        "place; treadmill = true reads it as motion over the ground"
    )


STANDS, STANDS_MPS = 0.2, 0.1
"""A foot's point stands while slower than this share of the body's median speed, or than 0.1 m/s."""
PLANE_M = 0.025
"""Largest deviation (rms) of standing feet from a plane; a stair is 0.17 m high."""
RISES_M = 0.15
"""Range of the heights of standing feet on ground that rises; it is less on a level floor."""
SPREAD_M = (0.4, 0.03)
"""Standard deviation of standing places along and across the path that a slope needs."""
MIN_TILT_DEG = 6.0
"""Markers of both feet that differ by 1 cm, 0.1 m apart, make a smaller tilt."""
LEAN_DEG, RUNNING_LEAN_DEG, RUNS_MPS = 1.5, 12.0, 2.1
"""Uncertainty of the lean of a walking and of a running body. At 2.1 m/s, people start to run."""


@dataclass(frozen=True)
class Floor:
    """Floor under standing feet: z rises by slope (2,) times x, y; NaN if it is no plane."""

    tilt_deg: float
    slope: FloatArray
    follows_body: bool = False
    is_certain: bool = False
    range_m: float = 0.0

    def remove_slope(self, position: FloatArray, parts: Sequence[str]) -> FloatArray:
        """Return positions over the ground under the body if it rises."""
        feet = [i for i, part in enumerate(parts) if part in FOOT_PARTS]
        if self.kind == "tilted axes" or self.range_m < RISES_M:
            return position
        raised = position.copy()
        raised[..., 2] -= position[:, feet, 2].min(axis=1)[:, np.newaxis]
        return raised

    def describe(self) -> dict[str, Any]:
        """Return entries for the report of a motion."""
        tilt_deg = self.tilt_deg if math.isfinite(self.tilt_deg) else None
        return {"floor": self.kind, "floor_tilt_deg": tilt_deg, "floor_range_m": self.range_m}

    @property
    def kind(self) -> str:
        """Return what the floor is; of "tilted axes", the recording is tilted, not the ground."""
        if not self.tilt_deg >= MIN_TILT_DEG:
            return "uneven" if math.isnan(self.tilt_deg) and self.range_m >= RISES_M else "level"
        if self.is_certain:
            return "tilted axes" if self.follows_body else "slope"
        return "unclear"


def measure_floor(position: FloatArray, names: Sequence[str], parts: Sequence[str], *, rate_hz: float) -> Floor | None:
    """Fit a plane to the feet that stand, or return None."""
    feet = [i for i, part in enumerate(parts) if part in FOOT_PARTS]
    if len({parts[i] for i in feet}) < 2 or len(position) < 3:
        return None
    velocity = np.gradient(position, 1.0 / rate_hz, axis=0)
    pace_mps = float(np.median(np.linalg.norm(velocity.mean(axis=1), axis=1)))
    stands = np.linalg.norm(velocity[:, feet], axis=2) < max(STANDS * pace_mps, STANDS_MPS)
    place = position[:, feet][stands]
    # equal markers of both feet are equally high over the floor
    kinds = [re.sub("^(left|right|l|r)", "", reduce_word(strip_subject(names[i]))) for i in feet]
    kind = np.unique(kinds, return_inverse=True)[1][np.nonzero(stands)[1]]
    if len(place) < 3:
        return None
    # heights and places relative to the mean of their kind
    count = np.maximum(np.bincount(kind), 1)
    rest = place - np.stack([np.bincount(kind, place[:, k]) / count for k in range(3)], axis=1)[kind]
    _, spread, axes = np.linalg.svd(rest[:, :2], full_matrices=False)
    spread_m = spread / math.sqrt(len(rest))
    if spread_m[0] < SPREAD_M[0]:
        return None
    lever = np.maximum(spread**2, 1e-12)
    slopes = [along * float((rest[:, :2] @ along) @ rest[:, 2]) / lever[k] for k, along in enumerate(axes)]
    range_m = float(np.ptp(np.percentile(rest[:, 2], (5, 95))))
    # on a slope a person is upright; in a tilted frame, the body is at right angles to the floor. Animals show neither
    upper = [i for i, part in enumerate(parts) if part in ("head", "torso") and "trunk" not in parts]
    lower = dict.fromkeys(part for part in parts if part.endswith(("_shank", "_foot")))
    legs = [[i for i, part in enumerate(parts) if part == leg] for leg in lower]
    under = np.mean([position[:, points].mean(axis=(0, 1)) for points in legs or [feet]], axis=0)
    body = position[:, upper].mean(axis=(0, 1)) - under if upper else np.zeros(3)
    whole = slopes[0] + slopes[1] if spread_m[1] >= SPREAD_M[1] else slopes[0]
    follows = _measure_lean_deg(body, whole) > math.degrees(math.atan(float(np.hypot(*whole)))) / 2
    # feet are near each other across the path: only the body can confirm that it slopes sideways
    slope = whole if follows else slopes[0]
    deviation_m = float(np.sqrt(np.mean((rest[:, 2] - rest[:, :2] @ slope) ** 2)))
    tilt_deg = math.degrees(math.atan(float(np.hypot(*slope)))) if deviation_m <= PLANE_M else math.nan
    margin_deg = abs(_measure_lean_deg(body, slope) - tilt_deg / 2)
    certain = bool(upper) and margin_deg > (RUNNING_LEAN_DEG if pace_mps > RUNS_MPS else LEAN_DEG)
    return Floor(tilt_deg, slope, follows, certain, range_m)


def _measure_lean_deg(body: FloatArray, slope: FloatArray) -> float:
    """Return how far a body leans down a slope, degrees."""
    return math.degrees(math.atan2(float(-body[:2] @ slope), float(body[2] * np.hypot(*slope)))) if slope.any() else 0.0


def level_floor(position: FloatArray, floor: Floor) -> FloatArray:
    """Rotate positions so that the floor's normal is vertical."""
    # Rodrigues: the shortest rotation of the normal to z, about their common perpendicular
    x, y, z = np.array([*-floor.slope, 1.0]) / math.sqrt(1.0 + float(floor.slope @ floor.slope))
    turn = np.array(
        [[z + y * y / (1 + z), -x * y / (1 + z), -x], [-x * y / (1 + z), z + x * x / (1 + z), -y], [x, y, z]]
    )
    middle = position.mean(axis=(0, 1))
    return np.asarray((position - middle) @ turn.T + middle)
