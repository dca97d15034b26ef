"""Which points of a body to join by lines when it is drawn, for any set of markers."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

SWAY_WEIGHT = 40.0
"""How much a change of distance counts against its length: what a joint moves apart is no bone."""
FEWEST_FRAMES, MOST_FRAMES = 2, 64


def bones_of(position_m: npt.ArrayLike) -> npt.NDArray[np.int32]:
    """Bones of a moving body: the tree through all of its points whose branches are short and keep their length.

    A minimum spanning tree (Kruskal 1956) of ``mean(d) + 40 sd(d)``, d being the distance of two points over time: the
    two ends of a bone keep theirs, a hand and the thigh it passes do not. No names are needed.

    Parameters
    ----------
    position_m : array_like, shape (T, P, 3)
        Points over time, m; points that are NaN now and then are judged by the rest, those that always are get no bone.

    Returns
    -------
    ndarray, shape (B, 2)
        int32 pairs of points, the lower number first, in order; none for a single point.
    """
    from scipy.sparse.csgraph import minimum_spanning_tree

    points = np.asarray(position_m, dtype=np.float64)
    points = points[:: max(1, points.shape[0] // MOST_FRAMES)]
    known = np.flatnonzero(np.isfinite(points).all(axis=-1).sum(axis=0) >= min(FEWEST_FRAMES, points.shape[0]))
    distance = np.linalg.norm(points[:, known, None] - points[:, None, known], axis=-1)
    cost = _cost(distance)
    tree = minimum_spanning_tree(np.triu(cost, k=1)).tocoo()
    pairs = np.sort(known[np.stack([tree.row, tree.col], axis=1)], axis=1)
    return pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))].astype(np.int32)


def _cost(distance: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Cost of joining each two points, above 0; pairs never seen together are left apart (0)."""
    seen = np.isfinite(distance)
    count = np.maximum(seen.sum(axis=0), 1)
    mean = np.where(seen, distance, 0.0).sum(axis=0) / count
    spread = np.sqrt(np.where(seen, (distance - mean) ** 2, 0.0).sum(axis=0) / count)
    return np.where(seen.any(axis=0), np.maximum(mean + SWAY_WEIGHT * spread, 1e-9), 0.0)
