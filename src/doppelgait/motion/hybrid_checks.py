"""Checks of lengths, feet and joints of hybrids of clips."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import MotionError
from doppelgait.motion.gait import STANCE_SPEED, find_feet
from doppelgait.motion.motion import Motion
from doppelgait.motion.retime import travel_speed_mps
from doppelgait.motion.rigid import find_bones, measure_pair_lengths

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int32]

FREE_PARTS = ("head", "neck", "tail", "left_hand", "right_hand")
"""Body parts without limits of their joints. A head turned left and one turned right blend to a straight neck."""

LONGER = 0.005
"""Largest relative error of the distance between two points; an absolute error of :data:`LONGER_M` is also allowed."""
LONGER_M = 1e-3
JERKS = 1.5
"""Factor by which the restoration of lengths may raise the largest acceleration. More indicates a leg that snaps
straight."""
SLIDES = 0.02
"""Allowed increase of the sliding speed of feet on the ground, as a share of the body's speed: the maximum that looping
adds to a shared recording."""
BENDS_DEG = 14.0
"""Angle by which a joint may bend further than in the recordings: two standard deviations of the minimum and maximum
angle of a joint between recordings of one gait and skeleton (7 degrees: root mean square over nine sets, 4 to 11)."""


def measure_foot_slide(motion: Motion) -> float:
    """Measure the sliding speed of feet that bear weight."""
    # it is the horizontal speed of the slowest point of a foot, relative to the body's speed
    rate, speed_mps = motion.rate_hz, travel_speed_mps(motion)
    found = []
    for points in find_feet(motion).values():
        velocity = np.gradient(motion.position_m[:, points, :2], 1.0 / rate, axis=0)
        slowest = np.linalg.norm(velocity, axis=2).min(axis=1)
        found.append(slowest[slowest < STANCE_SPEED * speed_mps] / speed_mps)
    every = np.concatenate(found) if found else np.empty(0)
    return float(every.mean()) if every.size else math.nan


def check_hybrid(
    made: Motion,
    sources: Sequence[Motion],
    pairs: IntArray,
    wanted: FloatArray,
    loose: FloatArray,
    entries: Mapping[str, Any],
) -> Motion:
    """Check lengths, feet and joints of a hybrid."""
    # the report is added to the motion. loose holds the positions before the lengths were restored.
    position = made.position_m
    error = np.abs(measure_pair_lengths(position, pairs) - wanted)
    beyond_m = error - np.maximum(LONGER_M, LONGER * wanted)
    worst = np.unravel_index(int(np.argmax(beyond_m)), error.shape)
    if beyond_m[worst] > 0:
        names = " and ".join(made.markers[n] for n in pairs[worst[1]])
        raise MotionError(
            f"{made.label}: cannot be made: {names} would be {1e3 * error[worst]:.1f} mm nearer or further than in the "
            "recording; change less"
        )
    jerks = [float(np.abs(np.diff(values, n=2, axis=0)).max()) for values in (position, loose)]
    if jerks[0] > JERKS * jerks[1]:
        raise MotionError(
            f"{made.label}: cannot be made: to keep its lengths the body would accelerate {jerks[0] / jerks[1]:.1f} "
            f"times as much; allowed are {JERKS:g}; change less"
        )
    slides, recorded = measure_foot_slide(made), [measure_foot_slide(source) for source in sources]
    before = max(filter(math.isfinite, recorded), default=math.nan)
    if math.isfinite(before) and not math.isfinite(slides):
        raise MotionError(
            f"{made.label}: cannot be made: no foot would rest on the ground, as feet do in the recordings; change less"
        )
    if slides > before + SLIDES:
        raise MotionError(
            f"{made.label}: cannot be made: feet on the ground slide at {slides:.3f} of the speed, {before:.3f} in the "
            f"recordings; allowed are {SLIDES:g} more; change less"
        )
    free = [n for n, part in enumerate(made.parts) if part in FREE_PARTS]
    joints = _find_joints(pairs, sources[0].position_m)
    joints = joints[~np.isin(joints, free).any(axis=1)]
    angles = [_angles_deg(motion.position_m, joints) for motion in (made, *sources)]
    if joints.size:
        low = np.min([angle.min(axis=0) for angle in angles[1:]], axis=0) - angles[0].min(axis=0)
        high = angles[0].max(axis=0) - np.max([angle.max(axis=0) for angle in angles[1:]], axis=0)
        beyond = np.maximum(low, high)
        if beyond.max() > BENDS_DEG:
            at = made.markers[joints[int(np.argmax(beyond)), 1]]
            raise MotionError(
                f"{made.label}: cannot be made: the joint at {at} would bend {beyond.max():.0f} degrees further than "
                f"in the recordings; allowed are {BENDS_DEG:g}; change less"
            )
        further = max(0.0, float(beyond.max()))
    else:
        further = 0.0
    report = {
        **made.report.get("hybrid", {}),
        **entries,
        "length_error_m": float(error.max()),
        "foot_slide": slides,
        "foot_slide_recorded": before,
        "bends_further_deg": further,
    }
    if not math.isfinite(slides):
        report["note"] = "no foot is seen to rest on the ground: whether feet slide was not checked"
    return made.with_report(hybrid=report)


def _find_joints(pairs: IntArray, position: FloatArray) -> IntArray:
    """Find the joints of a body, shape (J, 3)."""
    # a joint is three points a, b, c with bones a-b and b-c that are not in one rigid segment
    bones = {(int(a), int(b)) for a, b in find_bones(position)}
    rigid = {(int(a), int(b)) for a, b in pairs}
    by_end: dict[int, list[int]] = {}
    for a, b in bones:
        by_end.setdefault(a, []).append(b)
        by_end.setdefault(b, []).append(a)
    found = [
        (a, middle, c)
        for middle, ends in sorted(by_end.items())
        for a in sorted(ends)
        for c in sorted(ends)
        if a < c and (a, c) not in rigid
    ]
    return np.array(found, dtype=np.int32).reshape(-1, 3)


def _angles_deg(position: FloatArray, joints: IntArray) -> FloatArray:
    """Return joint angles over time, shape (T, J)."""
    arms = [position[:, joints[:, end]] - position[:, joints[:, 1]] for end in (0, 2)]
    lengths = np.maximum(np.linalg.norm(arms[0], axis=2) * np.linalg.norm(arms[1], axis=2), 1e-12)
    return np.asarray(np.degrees(np.arccos(np.clip((arms[0] * arms[1]).sum(axis=2) / lengths, -1.0, 1.0))))
