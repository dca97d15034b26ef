"""Range-Doppler maps at about 10 Hz, with detections."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import AnalysisError
from doppelgait.core.frames import Frames
from doppelgait.core.lazy import xr
from doppelgait.core.units import FloatArray, db_to_power
from doppelgait.processing.clutter import remove_common_phase, remove_from_frames
from doppelgait.processing.detect.cfar import (
    MIN_TRAINING,
    count_training_cells,
    make_range_window,
    mark_above_ca,
    mark_above_os,
)
from doppelgait.processing.detect.config import Detector
from doppelgait.processing.detect.maps import Maps, compute_maps, estimate_residue_map, noise_factor
from doppelgait.processing.track.live import Detection, Scan

Mask = npt.NDArray[np.bool_]

RANGE_SD_M, RANGE_SPREAD_SHARE = 0.045, 0.3
VELOCITY_SD_MPS, VELOCITY_SPREAD_SHARE = 0.05, 0.25
"""Error of a centre: a constant, and a share of its power's spread (limbs move between scans)."""
NO_RANGE_SD_M = 1000.0
"""Standard deviation of the range of a radar without range resolution; such a range carries no information."""


def find_scans(
    baseband: xr.DataArray, settings: Detector | None = None, *, wavelength_m: float, in_phase: bool = False
) -> list[Scan]:
    """Find bodies in every interval of a recording.

    The common phase of the frames and static clutter are removed, and range-Doppler maps are
    computed (E-24). Cells above the threshold are joined to clusters, and clusters of one body are
    joined to one detection. A radar without range resolution (one range bin) gives one detection
    per cluster in Doppler, with the range of its bin and a standard deviation of 1 km.

    Parameters
    ----------
    baseband : DataArray (slow_time, range)
        At a constant frame rate, or in bursts, each of which is a scan.
    settings : Detector, optional
    wavelength_m : float
    in_phase : bool
        True if the common phase has been removed already
        (:func:`doppelgait.processing.clutter.remove_common_phase`).

    Returns
    -------
    list of Scan
        Scans in the order of time; a scan without bodies has no detections. Velocities lie within +-lambda f_p / 4 (a
        faster body is detected at its aliased velocity); boxes may extend beyond.

    Raises
    ------
    AnalysisError
        If the recording or a burst is too short or too slow for a processing interval, or the range
        frame too short for the CFAR window.

    Examples
    --------
    >>> import doppelgait as dg
    >>> recording = dg.data.sample()
    >>> scans = dg.processing.find_scans(recording.baseband, wavelength_m=recording.radar.wavelength_m)
    >>> [round(body.range_m, 1) for body in scans[10].detections]  # ranges of the bodies, m
    [3.5, 6.0]
    """
    frames = Frames.of(baseband).find_bursts()
    return detect_bodies(frames, settings or Detector(), wavelength_m=wavelength_m, in_phase=in_phase)


def detect_bodies(frames: Frames, chosen: Detector, *, wavelength_m: float, in_phase: bool = False) -> list[Scan]:
    """Find bodies in every interval of frames."""
    steady = frames if in_phase or chosen.clutter == "none" else remove_common_phase(frames)
    moving = remove_from_frames(steady, kind=chosen.clutter)
    scans: list[Scan] = []
    for maps in compute_maps(moving, chosen, wavelength_m=wavelength_m):
        mask, peak = find_cells(maps, chosen)
        cells = find_clusters(
            mask,
            join_bins=_round_to_odd(chosen.join_range_m / maps.bin_spacing_m),
            join_doppler_bins=_round_to_odd(chosen.join_doppler_hz / float(maps.doppler_hz[1] - maps.doppler_hz[0])),
        )
        # neighbouring bins that share noise exceed a threshold together: their sum is higher
        cells = keep_bodies(cells, peak, maps.power_v2, maps.floor_v2, min_snr=chosen.min_snr / frames.bin_share)
        # clusters of one body are merged, and bodies with too few cells are removed
        shape = measure_shapes(cells, maps.power_v2, maps.floor_v2, box_quantile=chosen.box_quantile)
        group = merge_groups(
            shape,
            range_bins=chosen.merge_range_m / maps.bin_spacing_m,
            gap_bins=chosen.merge_velocity_mps / maps.velocity_spacing_mps,
            limb_gap_bins=chosen.limb_velocity_mps / maps.velocity_spacing_mps,
            n_doppler=maps.velocity_mps.size,
        )
        sizes = np.bincount(group, shape.n_cells, group.size)
        cells = cells.merge(np.where(sizes[group] >= chosen.min_cells, group, -1))
        shape = measure_shapes(cells, maps.power_v2, maps.floor_v2, box_quantile=chosen.box_quantile)
        found: list[list[Detection]] = [[] for _ in maps.time_s]
        to_m, to_mps = maps.bin_spacing_m if maps.range_m.size > 1 else 0.0, maps.velocity_spacing_mps
        for n, scan in enumerate(shape.scan):
            low_m, high_m = maps.range_m[0] + to_m * shape.range_box[n]
            low_mps, high_mps = maps.velocity_mps[0] + to_mps * shape.doppler_box[n]
            snr, spread_mps = max(float(shape.snr[n]), 1.0), to_mps * shape.doppler_spread[n]
            range_sd_m = _compute_centre_sd(to_m * shape.range_spread[n], to_m, snr, RANGE_SD_M, RANGE_SPREAD_SHARE)
            body = Detection(
                range_m=float(maps.range_m[0] + to_m * shape.range_bin[n]),
                velocity_mps=float(maps.velocity_mps[0] + to_mps * shape.doppler_bin[n]),
                power_v2=float(shape.power[n]),
                range_sd_m=range_sd_m if to_m else NO_RANGE_SD_M,
                velocity_sd_mps=_compute_centre_sd(spread_mps, to_mps, snr, VELOCITY_SD_MPS, VELOCITY_SPREAD_SHARE),
                range_low_m=float(low_m),
                range_high_m=float(high_m),
                velocity_low_mps=float(low_mps),
                velocity_high_mps=float(high_mps),
                n_cells=int(shape.n_cells[n]),
            )
            found[scan].append(body)
        scans += [Scan(float(t), tuple(detections)) for t, detections in zip(maps.time_s, found, strict=True)]
        del maps, mask, peak  # before the next block is computed
    return scans


def find_cells(maps: Maps, settings: Detector) -> tuple[Mask, Mask]:
    """Find the cells of bodies, and the peaks that make a cluster a body, (J, K, N)."""
    power = maps.power_v2
    least = power.max(axis=1, keepdims=True) * np.float32(1.0 / db_to_power(settings.dynamic_range_db))
    above = power > np.maximum(least, np.finfo(np.float32).tiny)
    if maps.range_m.size > 1:
        above &= maps.range_m >= settings.near_m
    slow = np.abs(maps.velocity_mps) < settings.slow_mps
    residue = estimate_residue_map(power[:, slow])
    window = make_range_window(
        bin_spacing_m=maps.bin_spacing_m,
        window_m=settings.window_m,
        guard_m=settings.guard_m,
        resolution_m=settings.resolution_m,
    )
    if settings.method != "noise_map" and count_training_cells(window, maps.range_m.size).min() < MIN_TRAINING:
        raise AnalysisError(
            f"method {settings.method!r} compares cells along range, and a frame of {maps.range_m.size} range bins "
            f"has no room for a window from {settings.guard_m:g} to {settings.window_m:g} m; use method 'noise_map'"
        )
    masks = []
    for pfa in (settings.pfa, settings.peak_pfa):
        if settings.method == "noise_map":
            mask = power > (noise_factor(pfa) * maps.floor_v2).astype(np.float32)
        elif settings.method == "os_cfar":
            mask = mark_above_os(power, window, pfa, rank_share=settings.rank)
        else:
            mask = mark_above_ca(power, window, pfa)
        mask &= above
        mask[:, slow] &= power[:, slow] > noise_factor(pfa) * residue
        masks.append(mask)
    return masks[0], masks[1] & masks[0]


def _round_to_odd(size_bins: float) -> int:
    """Round to an odd number of at least 3, to join neighbours."""
    return max(3, 2 * round((size_bins - 1.0) / 2.0) + 1)


def _compute_centre_sd(spread: float, cell: float, snr: float, always: float, share: float) -> float:
    # a constant, the motion of limbs, and noise relative to a cell's width (Cramer-Rao bound)
    return math.sqrt(always**2 + (share * spread) ** 2 + cell**2 / snr)


IntArray = npt.NDArray[np.int64]

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
            # 0 or less: the boxes overlap
            gap = float(np.maximum(other[0] + turns - one[1], one[0] - other[1] - turns).min())
            same_way = (shape.doppler_bin[leader] - still) * (shape.doppler_bin[number] - still) > 0
            is_limb = same_way and shape.power[number] < LIMB_SHARE * shape.power[leader]
            near = abs(shape.range_bin[leader] - shape.range_bin[number]) < range_bins
            if near and gap <= (limb_gap_bins if is_limb else gap_bins):
                group[number] = leader
                break
        else:
            leaders.append(int(number))
    return group
