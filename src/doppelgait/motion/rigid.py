"""Bones and rigid segments of bodies: the distances between points of one segment are constant."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from doppelgait.core.units import FloatArray

RIGID_M = 0.008
"""Maximum spread of the distance between two points of one segment. Skin movement is smaller."""
SWAY_WEIGHT = 40.0
"""Weight of a distance's variation relative to its mean: points across a joint are no bone."""
FEWEST_FRAMES, MOST_FRAMES = 2, 64
TIES = 9
"""Number of decimals to which costs and lengths in m are compared."""


def find_bones(position_m: npt.ArrayLike) -> npt.NDArray[np.int32]:
    """Return the bones of a moving body: a tree of short branches of constant length."""
    # the minimum spanning tree of mean(d) + 40 sd(d) with the distance d of two points over time
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
"""Number of rigid neighbours of each point with distances that are kept, besides the bones."""


def find_rigid_pairs(position: FloatArray) -> npt.NDArray[np.int32]:
    """Return bones and neighbouring points of one segment, shape (B, 2)."""
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
    """Move points as little as possible to wanted pair distances, by Newton's method."""
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
