"""Treadmill recordings: belt speed and motion over the ground."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import MotionError
from doppelgait.motion.motion import Motion
from doppelgait.motion.skeleton import FOOT_PARTS

FloatArray = npt.NDArray[np.float64]

LOW = 0.1
"""Share of a foot's height range (5th to 95th percentile) in which it is on the ground."""
SLOWEST_BELT_MPS = 0.2
DISAGREEMENT = 0.15
"""Maximum difference of the feet's velocities relative to the belt speed (1 % for the horse of the Vienna data)."""
DRIFT = 0.2
"""Maximum speed of the body relative to the belt speed."""


def belt_velocity_mps(position: FloatArray, parts: Sequence[str], *, rate_hz: float) -> FloatArray | None:
    """Measure the velocity of a treadmill belt, shape (2,)."""
    # it is the median velocity of the feet while they are low, if all feet agree and the body stays
    # in place
    feet: dict[str, list[int]] = {}
    for i, part in enumerate(parts):
        if part in FOOT_PARTS:
            feet.setdefault(part, []).append(i)
    if len(feet) < 2 or len(position) < 3:
        return None
    on_belt = []
    for points in feet.values():
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
