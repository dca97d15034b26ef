"""Clusters of cells above the threshold, one per body."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

LIMB_SHARE = 0.3
"""Largest power of a limb that is separate from its torso in Doppler, as a share of that."""
IN_PLANE = np.zeros((3, 3, 3), dtype=bool)
IN_PLANE[1] = True
"""Cells are connected within a scan, also diagonally, and never between scans."""


@dataclass(frozen=True)
class Cells:
    """Cells of clusters, with one entry per cell."""

    scan: IntArray
    doppler: IntArray
    range_bin: IntArray
    cluster: IntArray

    @property
    def n_clusters(self) -> int:
        """Number of clusters."""
        return int(self.cluster.max(initial=-1)) + 1

    def merge(self, group: IntArray) -> Cells:
        """Merge cluster i into ``group[i]``, or remove it if that is -1."""
        wanted = group[self.cluster]
        kept = wanted >= 0
        _, numbers = np.unique(wanted[kept], return_inverse=True)
        return Cells(self.scan[kept], self.doppler[kept], self.range_bin[kept], numbers.astype(np.int64))


def find_clusters(mask: Mask, *, join_bins: int, join_doppler_bins: int) -> Cells:
    """Find connected groups of cells (J, K, N) after dilation; Doppler is circular."""
    from scipy import ndimage
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    grown = ndimage.maximum_filter1d(mask.view(np.uint8), join_bins, axis=2, mode="constant")
    grown = ndimage.maximum_filter1d(grown, join_doppler_bins, axis=1, mode="wrap")
    labels, count = ndimage.label(grown, structure=IN_PLANE)
    scan, doppler, range_bin = np.nonzero(mask)
    group = np.arange(count + 1)
    first, last = labels[:, 0], labels[:, -1]
    both = (first > 0) & (last > 0)
    if both.any():  # labels in contact across the ends of the Doppler axis are one group
        pairs = (first[both], last[both])
        graph = coo_array((np.ones(pairs[0].size), pairs), shape=(count + 1, count + 1))
        group = np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)
    cells = Cells(scan, doppler, range_bin, group[labels[scan, doppler, range_bin]])
    return cells.merge(np.arange(count + 1))


def keep_bodies(
    cells: Cells, peak: Mask, power_v2: npt.NDArray[np.floating[Any]], floor_v2: FloatArray, *, min_snr: float
) -> Cells:
    """Keep clusters with a peak, or with power over noise of ``min_snr``."""
    place = (cells.scan, cells.doppler, cells.range_bin)
    snr = power_v2[place] / np.maximum(floor_v2[cells.range_bin], 1e-300)
    kept = _sum_weights(cells.cluster, snr, cells.n_clusters) >= min_snr
    kept[cells.cluster[peak[place]]] = True
    return cells.merge(np.where(kept, np.arange(kept.size), -1))


@dataclass(frozen=True)
class Shape:
    """Centre, size and power of every cluster, positions in bins; boxes (n, 2)."""

    scan: IntArray
    power: FloatArray
    snr: FloatArray
    range_bin: FloatArray
    doppler_bin: FloatArray
    range_spread: FloatArray
    doppler_spread: FloatArray
    range_box: FloatArray
    doppler_box: FloatArray
    n_cells: IntArray


def measure_shapes(
    cells: Cells, power_v2: npt.NDArray[np.floating[Any]], floor_v2: FloatArray, *, box_quantile: float
) -> Shape:
    """Measure centre, box and power of every cluster. Shapes: power_v2 (J, K, N); floor_v2 (N,)."""
    n, (_, n_doppler, n_bins) = cells.n_clusters, power_v2.shape
    level = power_v2[cells.scan, cells.doppler, cells.range_bin].astype(np.float64)
    noise = floor_v2[cells.range_bin]
    weight = np.maximum(level - noise, 1e-3 * level)
    along_range = _sum_profile(cells.cluster, cells.range_bin, weight, n, n_bins)
    along_doppler = _sum_profile(cells.cluster, cells.doppler, weight, n, n_doppler)
    range_bin, range_spread, range_box = _compute_moments(along_range, box_quantile)
    start = np.zeros(n)  # profiles that reach both ends of the axis are unrolled where they have the least power
    for row in np.flatnonzero((along_doppler[:, 0] > 0) & (along_doppler[:, -1] > 0)):
        profile = along_doppler[row]
        start[row] = np.argmin(profile + np.roll(profile, 1) + np.roll(profile, -1))
        along_doppler[row] = np.roll(profile, -int(start[row]))
    doppler_bin, doppler_spread, doppler_box = _compute_moments(along_doppler, box_quantile)
    turns = n_doppler * np.floor((start + doppler_bin + 0.5) / n_doppler)
    scan = np.zeros(n, dtype=np.int64)
    scan[cells.cluster] = cells.scan
    return Shape(
        scan=scan,
        power=_sum_weights(cells.cluster, weight, n),
        snr=_sum_weights(cells.cluster, weight / np.maximum(noise, 1e-300), n),
        range_bin=range_bin,
        doppler_bin=start + doppler_bin - turns,
        range_spread=range_spread,
        doppler_spread=doppler_spread,
        range_box=range_box,
        doppler_box=doppler_box + (start - turns)[:, None],
        n_cells=np.bincount(cells.cluster, minlength=n),
    )


def _sum_profile(cluster: IntArray, place: IntArray, weight: FloatArray, n: int, size: int) -> FloatArray:
    """Sum the power of every cluster along one axis. The result has the shape (n, size)."""
    return _sum_weights(cluster * size + place, weight, n * size).reshape(n, size)


def _sum_weights(number: IntArray, weight: FloatArray, n: int) -> FloatArray:
    return np.asarray(np.bincount(number, weight, n), dtype=np.float64)


def _compute_moments(profile: FloatArray, quantile: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    bins = np.arange(profile.shape[1])
    share = profile / profile.sum(axis=1, keepdims=True)
    centre = share @ bins
    spread = np.sqrt(np.maximum(share @ bins**2 - centre**2, 0.0))
    below = np.cumsum(share, axis=1)
    low = (below <= quantile).sum(axis=1) - 0.5
    high = (below < 1.0 - quantile - 1e-12).sum(axis=1) + 0.5
    return centre, spread, np.stack([low, high], axis=1)


def merge_groups(shape: Shape, *, range_bins: float, gap_bins: float, limb_gap_bins: float, n_doppler: int) -> IntArray:
    """Return the strongest cluster of each cluster's body in the scan, maybe itself."""
    group = np.arange(shape.power.size)
    order = np.lexsort((-shape.power, shape.scan))
    still, turns = n_doppler // 2, n_doppler * np.arange(-1, 2)
    leaders: list[int] = []
    for number in order:
        if leaders and shape.scan[leaders[0]] != shape.scan[number]:
            leaders = []
        for leader in leaders:
            one, other = shape.doppler_box[leader], shape.doppler_box[number]
            gap = float(
                np.maximum(other[0] + turns - one[1], one[0] - other[1] - turns).min()
            )  # 0 or less: the boxes overlap
            same_way = (shape.doppler_bin[leader] - still) * (shape.doppler_bin[number] - still) > 0
            is_limb = same_way and shape.power[number] < LIMB_SHARE * shape.power[leader]
            near = abs(shape.range_bin[leader] - shape.range_bin[number]) < range_bins
            if near and gap <= (limb_gap_bins if is_limb else gap_bins):
                group[number] = leader
                break
        else:
            leaders.append(int(number))
    return group
