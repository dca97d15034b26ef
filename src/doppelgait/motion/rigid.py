"""Bones and rigid segments of bodies, kept in motions made from recordings.

The distances between points of one segment are constant. A hybrid is refused if it changes them, or
if its feet slide or its joints bend too far.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import MotionError
from doppelgait.core.units import FloatArray, arccosine
from doppelgait.motion.gait import STANCE_SPEED, find_feet
from doppelgait.motion.motion import Motion
from doppelgait.motion.retime import travel_speed_mps

IntArray = npt.NDArray[np.int32]


RIGID_M = 0.008
"""Maximum spread of the distance between two points of one segment. Skin movement is smaller."""


SWAY_WEIGHT = 40.0
"""Weight of the variation of a distance relative to its mean. Two points that a joint separates are not a bone."""
FEWEST_FRAMES, MOST_FRAMES = 2, 64
TIES = 9
"""Number of decimals to which costs and lengths in m are compared."""


def find_bones(position_m: npt.ArrayLike) -> npt.NDArray[np.int32]:
    """Return the bones of a moving body."""
    # the bones are a tree through all points with short branches of constant length: the minimum
    # spanning tree (Kruskal 1956) of mean(d) + 40 sd(d), where d is the distance of two points over
    # time
    from scipy.sparse.csgraph import minimum_spanning_tree

    points = np.asarray(position_m, dtype=np.float64)
    points = points[:: max(1, points.shape[0] // MOST_FRAMES)]
    known = np.flatnonzero(np.isfinite(points).all(axis=-1).sum(axis=0) >= min(FEWEST_FRAMES, points.shape[0]))
    distance = np.linalg.norm(points[:, known, None] - points[:, None, known], axis=-1)
    seen = np.isfinite(distance)
    count = np.maximum(seen.sum(axis=0), 1)
    mean = np.where(seen, distance, 0.0).sum(axis=0) / count
    sway = np.sqrt(np.where(seen, (distance - mean) ** 2, 0.0).sum(axis=0) / count)
    # pairs that are never seen together have no cost, hence no branch
    cost = np.where(seen.any(axis=0), np.maximum(mean + SWAY_WEIGHT * sway, 1e-9), 0.0)
    cost = np.round(cost, TIES)  # both sides of a body have equal costs, whatever the heading
    tree = minimum_spanning_tree(np.triu(cost, k=1)).tocoo()
    pairs = np.sort(known[np.stack([tree.row, tree.col], axis=1)], axis=1)
    return pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))].astype(np.int32)


NEAR_POINTS = 2
"""Number of rigid neighbours of each point with distances that are kept, in addition to the bones."""


def find_rigid_pairs(position: FloatArray) -> npt.NDArray[np.int32]:
    """Return point pairs of constant distance."""
    # they are bones and neighbouring points of one segment, shape (B, 2)
    bones = find_bones(position)
    some = position[:: max(1, len(position) // MOST_FRAMES)]
    distance = np.linalg.norm(some[:, :, np.newaxis] - some[:, np.newaxis], axis=-1)
    near = np.where(np.round(distance.std(axis=0), TIES) < RIGID_M, np.round(distance.mean(axis=0), TIES), np.inf)
    np.fill_diagonal(near, np.inf)
    pairs = {(int(a), int(b)) for a, b in bones}
    for point in range(position.shape[1]):
        for neighbour in np.argsort(near[point], kind="stable")[:NEAR_POINTS]:
            if np.isfinite(near[point, neighbour]):
                pairs.add((min(point, int(neighbour)), max(point, int(neighbour))))
    return np.array(sorted(pairs), dtype=np.int32).reshape(-1, 2)


def restore_lengths(
    position: FloatArray,
    pairs: npt.NDArray[np.int32],
    wanted_m: FloatArray,
    weights: FloatArray,
    *,
    ridge: float,
    steps: int,
) -> FloatArray:
    """Move points as little as possible to wanted pair distances."""
    # Newton's method minimises the weighted sum of squared displacements in every frame
    if not len(pairs):
        return position
    ends = np.zeros((len(pairs), len(weights)))
    rows = np.arange(len(pairs))
    ends[rows, pairs[:, 0]], ends[rows, pairs[:, 1]] = 1.0, -1.0
    light = ends.T / weights[:, np.newaxis]
    coupling = ends @ light
    position = position.copy()
    for _ in range(steps):
        apart = position[:, pairs[:, 0]] - position[:, pairs[:, 1]]
        length = np.maximum(np.linalg.norm(apart, axis=2), 1e-9)
        along = apart / length[..., np.newaxis]
        normal = coupling * (along @ along.transpose(0, 2, 1))
        normal[:, rows, rows] += ridge
        pull = np.linalg.solve(normal, (wanted_m - length)[..., np.newaxis])
        position += light @ (pull * along)
    return position


def measure_pair_lengths(position: FloatArray, pairs: npt.NDArray[np.int32]) -> FloatArray:
    """Return the distances of point pairs over time."""
    return np.asarray(np.linalg.norm(position[:, pairs[:, 0]] - position[:, pairs[:, 1]], axis=2))


FREE_PARTS = ("head", "neck", "tail", "left_hand", "right_hand")
"""Body parts without limits of their joints. A head turned left and one turned right blend to a straight neck."""

LONGER = 0.005
"""Largest relative error of the distance between two points; an absolute error of :data:`LONGER_M` is also allowed."""
LONGER_M = 1e-3
JERKS = 1.5
"""Factor by which the restoration of lengths may raise the largest acceleration. More indicates a
leg that snaps straight."""
SLIDES = 0.02
"""Allowed increase of the sliding speed of feet on the ground, as a share of the body's speed: the
maximum that looping adds to a shared recording."""
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

    def refuse(why: str) -> None:
        raise MotionError(f"{made.label}: cannot be made: {why}; change less")

    error = np.abs(measure_pair_lengths(position, pairs) - wanted)
    beyond_m = error - np.maximum(LONGER_M, LONGER * wanted)
    worst = np.unravel_index(int(np.argmax(beyond_m)), error.shape)
    if beyond_m[worst] > 0:
        names = " and ".join(made.markers[n] for n in pairs[worst[1]])
        refuse(f"{names} would be {1e3 * error[worst]:.1f} mm nearer or further than in the recording")
    jerks = [float(np.abs(np.diff(values, n=2, axis=0)).max()) for values in (position, loose)]
    if jerks[0] > JERKS * jerks[1]:
        much = f"{jerks[0] / jerks[1]:.1f} times as much; allowed are {JERKS:g}"
        refuse(f"to keep its lengths the body would accelerate {much}")
    slides, recorded = measure_foot_slide(made), [measure_foot_slide(source) for source in sources]
    before = max(filter(math.isfinite, recorded), default=math.nan)
    if math.isfinite(before) and not math.isfinite(slides):
        refuse("no foot would rest on the ground, as feet do in the recordings")
    if slides > before + SLIDES:
        allowed = f"{before:.3f} in the recordings; allowed are {SLIDES:g} more"
        refuse(f"feet on the ground slide at {slides:.3f} of the speed, {allowed}")
    free = [n for n, part in enumerate(made.parts) if part in FREE_PARTS]
    joints = _find_joints(pairs, sources[0].position_m)
    joints = joints[~np.isin(joints, free).any(axis=1)]
    angles = []  # of the joints over time, (T, J), degrees
    for motion in (made, *sources):
        arms = [motion.position_m[:, joints[:, end]] - motion.position_m[:, joints[:, 1]] for end in (0, 2)]
        lengths = np.maximum(np.linalg.norm(arms[0], axis=2) * np.linalg.norm(arms[1], axis=2), 1e-12)
        angles.append(np.degrees(arccosine(np.clip((arms[0] * arms[1]).sum(axis=2) / lengths, -1.0, 1.0))))
    further = 0.0
    if joints.size:
        low = np.min([angle.min(axis=0) for angle in angles[1:]], axis=0) - angles[0].min(axis=0)
        high = angles[0].max(axis=0) - np.max([angle.max(axis=0) for angle in angles[1:]], axis=0)
        beyond = np.maximum(low, high)
        further = max(0.0, float(beyond.max()))
        if further > BENDS_DEG:
            at = made.markers[joints[int(np.argmax(beyond)), 1]]
            far = f"{further:.0f} degrees further than in the recordings; allowed are {BENDS_DEG:g}"
            refuse(f"the joint at {at} would bend {far}")
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
