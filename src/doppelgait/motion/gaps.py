"""Samples that a recording lacks or should lack: spikes, gaps and what fills them."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

SPIKE_M = 0.05
SPIKE_ACCELERATION_MPS2 = 400.0
"""A point that leaves its neighbours in time by more than 5 cm and by more than this acceleration explains."""


def remove_spikes(position: FloatArray, *, rate_hz: float) -> int:
    """Turn single frames and pairs of frames that jump away from a point's path into gaps, in place.

    Parameters
    ----------
    position : ndarray, shape (T, P, 3)
        In m; changed.
    rate_hz : float
        Frames per second.

    Returns
    -------
    int
        Number of samples removed.
    """
    if position.shape[0] < 5:
        return 0
    limit = max(SPIKE_M, SPIKE_ACCELERATION_MPS2 / rate_hz**2)
    padded = np.pad(position, ((2, 2), (0, 0), (0, 0)), mode="reflect", reflect_type="odd")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 5, axis=0)
    # a gap inside the window makes the median NaN; there nothing is judged
    away = np.linalg.norm(position - np.median(windows, axis=-1), axis=2)
    spiky = away > limit
    position[spiky] = np.nan
    return int(spiky.sum())


def fill_linear(position: FloatArray) -> FloatArray:
    """Every gap bridged by a straight line, the ends by the nearest value; points never seen stay NaN.

    Parameters
    ----------
    position : ndarray, shape (T, P, 3)
        NaN where missing.
    """
    filled = position.copy()
    frames = np.arange(position.shape[0])
    for p in range(position.shape[1]):
        seen = np.asarray(np.isfinite(position[:, p]).all(axis=1))
        if seen.any() and not seen.all():
            for k in range(3):
                filled[:, p, k] = np.interp(frames, frames[seen], position[seen, p, k])
    return filled


def fill_gaps(position: FloatArray, *, gap_limit: int) -> tuple[FloatArray, dict[str, Any]]:
    """Gaps inside a point's path filled by a cubic spline through its samples.

    Parameters
    ----------
    position : ndarray, shape (T, P, 3)
        NaN where missing.
    gap_limit : int
        Longest gap to fill, in frames.

    Returns
    -------
    filled : ndarray, shape (T, P, 3)
    facts : dict
        ``gaps_filled``, ``samples_filled``, ``longest_gap_filled`` in frames.
    """
    from scipy.interpolate import CubicSpline

    filled = position.copy()
    lengths: list[int] = []
    for p in range(position.shape[1]):
        seen = np.asarray(np.isfinite(position[:, p]).all(axis=1))
        gaps = [(a, b) for a, b in runs(~seen) if a > 0 and b < len(seen) and b - a <= gap_limit]
        filled[~seen, p] = np.nan
        if not gaps or seen.sum() < 4:
            continue
        spline = CubicSpline(np.flatnonzero(seen), position[seen, p])
        for a, b in gaps:
            filled[a:b, p] = spline(np.arange(a, b))
            lengths.append(b - a)
    return filled, {
        "gaps_filled": len(lengths),
        "samples_filled": sum(lengths),
        "longest_gap_filled": max(lengths, default=0),
    }


def runs(mask: BoolArray) -> list[tuple[int, int]]:
    """First and past-the-last index of every run of true values."""
    edges = np.flatnonzero(np.diff(np.r_[False, mask, False].astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
