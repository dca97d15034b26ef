"""Range-Doppler maps at about 10 Hz, with detections."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import AnalysisError
from doppelgait.core.frames import Frames
from doppelgait.core.lazy import xr
from doppelgait.core.units import db_to_power
from doppelgait.processing.clutter import remove_from_frames
from doppelgait.processing.common_phase import remove_common_phase
from doppelgait.processing.detect.cfar import (
    MIN_TRAINING,
    count_training_cells,
    make_range_window,
    mark_above_ca,
    mark_above_os,
)
from doppelgait.processing.detect.cluster import find_clusters, keep_bodies, measure_shapes, merge_groups
from doppelgait.processing.detect.config import Detector
from doppelgait.processing.detect.maps import Maps, compute_maps, estimate_residue_map, noise_factor
from doppelgait.processing.detections import Detection, Scan

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
        (:func:`doppelgait.processing.common_phase.remove_common_phase`).

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
    least = np.maximum(
        power.max(axis=1, keepdims=True) * np.float32(1.0 / db_to_power(settings.dynamic_range_db)),
        np.finfo(np.float32).tiny,
    )
    above = power > least
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
