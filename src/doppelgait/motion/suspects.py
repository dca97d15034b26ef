"""Points that jump, swap names, coincide or lie far away."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int_]

JUMP_M, JUMP_JERK_MPS3 = 0.05, 6_000.0
"""Limits of a jump between two frames: more than 5 cm and more than this jerk explains."""
SWAP_M, SWAP_JERK_MPS3 = 0.02, 1_300.0
"""Limits of the two simultaneous steps of a swap. They are smaller than for one jump, since matching steps are unlikely
to be noise."""
SWAP_RATIO = 0.3
"""Maximum ratio of the steps of two points after and before an exchange."""
MAX_BRIDGE_S = 0.1
"""Longest gap across which a path is continued."""
MAX_SWAPS = 200
SAME_PLACE_M, NEARLY_SAME_PLACE_M = 0.005, 0.02
"""Distances below which two points are the same: in half of the frames, and in 95 % of them."""
MOVING_M = 0.03
FAR_M, FAR_FACTOR = 1.5, 4.0
SHORT_LIVED = 0.2
N_LOOKS = 200
"""Number of evenly spaced frames at which distances between points are compared."""


def repair_swaps(position: FloatArray, names: Sequence[str], *, rate_hz: float) -> list[dict[str, Any]]:
    """Exchange the paths of swapped names, in place. Shapes: position (T, P, 3)."""
    swaps: list[dict[str, Any]] = []
    step, limit = find_steps(position, rate_hz=rate_hz, floor_m=SWAP_M, jerk_mps3=SWAP_JERK_MPS3)
    frame = 0
    while len(swaps) < MAX_SWAPS:
        pair, frame = _find_next_swap(position, step, limit, first=frame, rate_hz=rate_hz)
        if not pair:
            break
        position[frame:, pair] = position[frame:, pair[::-1]]
        step[:, pair], limit[:, pair] = find_steps(
            position[:, pair], rate_hz=rate_hz, floor_m=SWAP_M, jerk_mps3=SWAP_JERK_MPS3
        )
        swaps.append({"frame": frame, "points": sorted(names[i] for i in pair)})
    return swaps


def _find_next_swap(
    position: FloatArray, step: FloatArray, limit: FloatArray, *, first: int, rate_hz: float
) -> tuple[list[int], int]:
    """Find the next swap and its frame."""
    # if several pairs have swapped, those with the largest reduction are returned
    stepping = step[first:] > limit[first:]
    for frame in (int(k) + first for k in np.flatnonzero(stepping.sum(axis=1) >= 2)):
        points = np.flatnonzero(stepping[frame - first])
        # remaining step [i, j] if the path of point i continues as that of point j from this frame on
        start = max(0, frame - 2 - max(1, round(MAX_BRIDGE_S * rate_hz)))
        near = position[start : frame + 2, points]
        last, arriving, leaving, gap = (values[frame - start] for values in _find_paths(near, rate_hz))
        predicted = last[:, np.newaxis] + gap[:, np.newaxis, np.newaxis] * (arriving[:, np.newaxis] + leaving) / 2
        rest, before = np.linalg.norm(near[frame - start] - predicted, axis=2), step[frame, points]
        least = np.minimum(before[:, np.newaxis], before)
        fits = np.maximum(rest, rest.T) < SWAP_RATIO * least
        gain = np.where(fits, before[:, np.newaxis] + before - rest - rest.T, 0.0)
        np.fill_diagonal(gain, 0.0)
        if gain.max() > 0.0:
            i, j = np.unravel_index(int(np.argmax(gain)), gain.shape)
            return [int(points[i]), int(points[j])], frame
    return [], len(step)


def find_jumps(position: FloatArray, names: Sequence[str], *, rate_hz: float) -> list[dict[str, Any]]:
    """Find steps off a smooth path. The positions are not changed. Shapes: position (T, P, 3)."""
    step, limit = find_steps(position, rate_hz=rate_hz, floor_m=JUMP_M, jerk_mps3=JUMP_JERK_MPS3)
    edge = np.full((1, step.shape[1]), -1.0)
    known = np.concatenate([edge, np.nan_to_num(step, nan=-1.0), edge])
    # a jump disturbs the adjacent velocities: the frames before and after have apparent steps of half the size
    peak = (step > limit) & (known[1:-1] > known[:-2]) & (known[1:-1] >= known[2:])
    found = [{"frame": int(k), "point": names[p], "step_m": round(float(step[k, p]), 4)} for k, p in np.argwhere(peak)]
    return sorted(found, key=lambda jump: (jump["frame"], jump["point"]))


def find_steps(
    position: FloatArray, *, rate_hz: float, floor_m: float, jerk_mps3: float
) -> tuple[FloatArray, FloatArray]:
    """Measure every step against its prediction."""
    # the prediction is the sample before, continued with the mean of the velocities before and
    # after
    last, before, after, gap = _find_paths(position, rate_hz)
    step = np.linalg.norm(position - last - gap[..., np.newaxis] * (before + after) / 2, axis=2)
    return step, np.maximum(floor_m, jerk_mps3 * (gap / rate_hz) ** 3 / 2)


def _find_paths(position: FloatArray, rate_hz: float) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return each point's last sample, velocity and gap."""
    # velocities are per frame, at the last sample and from the current frame on. The gap is in
    # frames.
    n_frames, n_points = position.shape[:2]
    seen, point = np.isfinite(position).all(axis=2), np.arange(n_points)
    frames = np.arange(n_frames)[:, np.newaxis]
    latest = np.maximum.accumulate(np.where(seen, frames, 0), axis=0)
    previous = np.concatenate([np.zeros((1, n_points), dtype=int), latest[:-1]])
    gap = (frames - previous).astype(np.float64)
    gap[(gap > max(1, round(MAX_BRIDGE_S * rate_hz))) | (gap < 1)] = np.nan
    none = np.full((1, n_points, 3), np.nan)
    velocity = np.concatenate([none, np.diff(position, axis=0), none])
    return position[previous, point], velocity[previous, point], velocity[1:], gap


def find_useless_points(position: FloatArray, names: Sequence[str], parts: Sequence[str]) -> dict[int, str]:
    """Find short-lived, duplicate and distant points. Shapes: position (T, P, 3)."""
    n_seen = np.isfinite(position).all(axis=2).sum(axis=0)
    usual = float(np.median(n_seen[n_seen > 0])) if (n_seen > 0).any() else 0.0
    reasons = {
        i: "short-lived unknown point"
        for i, part in enumerate(parts)
        if not part and 0 < n_seen[i] < SHORT_LIVED * usual
    }
    n_frames = len(position)
    frames = np.unique(np.linspace(0, max(0, n_frames - 1), min(n_frames, N_LOOKS)).round().astype(int))
    position = position[frames]
    # points far from the middle of the body
    occupied = position[np.asarray(np.isfinite(position).all(axis=2)).any(axis=1)]
    if occupied.size:
        distance = np.linalg.norm(occupied - np.nanmedian(occupied, axis=1, keepdims=True), axis=2)
        seen = np.asarray(np.isfinite(distance).sum(axis=0) > 0)
        typical = np.full(len(seen), np.nan)
        typical[seen] = np.nanmedian(distance[:, seen], axis=0)
        limit = max(FAR_M, FAR_FACTOR * float(np.nanmedian(typical)))
        far = (int(i) for i in np.flatnonzero(typical > limit))
        reasons |= {i: "far away from the body" for i in far if i not in reasons}
    # points of lower rank at the place of one of higher rank
    rank = sorted(range(len(names)), key=lambda i: (i in reasons, -n_seen[i], not parts[i], names[i]))
    doubles: dict[int, str] = {}
    for n, i in enumerate(rank):
        others = np.array([j for j in rank[n + 1 :] if j not in doubles], dtype=int)
        if i in doubles or not others.size:
            continue
        distance = np.linalg.norm(position[:, others] - position[:, [i]], axis=2)
        for k in np.flatnonzero((distance < SAME_PLACE_M).sum(axis=0) >= 2):
            seen = np.isfinite(distance[:, k])
            median, nearly_all = np.percentile(distance[seen, k], (50, 95))
            # points at rest are not compared
            moves = float(np.linalg.norm(np.ptp(position[seen, others[k]], axis=0))) > MOVING_M
            if moves and median < SAME_PLACE_M and nearly_all < NEARLY_SAME_PLACE_M:
                doubles[int(others[k])] = f"at the place of {names[i]}"
    return reasons | {i: why for i, why in doubles.items() if i not in reasons}
