"""Common phase of frames, measured on static echoes."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.frames import Frames
from doppelgait.core.units import FloatArray, arctangent

Values = npt.NDArray[np.complex64]
ComplexArray = npt.NDArray[np.complex128]

ZONE_M = 0.75
ZONE_BINS = 5
"""Zones of range nearer than this are no reference for a zone: they may show the same body."""
LEAST_WEIGHT = 1e3
"""Smallest power of the static echoes over their fluctuation for a reference; the phase error is then 0.02 rad."""
MARGIN = 10.0
"""Smallest ratio of a reference's weight to that of a static echo; the phase error then adds 1/20 of its noise."""
BLOCK_S = 0.1  # time in which the phase of a clock hardly changes
LEAST_VARIANCE = 1e-14
"""Variance of |y| over its power that rounding errors cause in a constant echo."""
TINY = float(np.finfo(np.float32).tiny)


def remove_common_phase(frames: Frames) -> Frames:
    """Subtract the phase that the bins of other zones have in common."""
    range_m, count = frames.range_m, frames.n_pulses
    zone_m = max(ZONE_M, ZONE_BINS * float(range_m[1] - range_m[0])) if range_m.size > 1 else ZONE_M
    block = max(round(BLOCK_S * frames.slow_time.rate_hz), 1)
    if range_m[-1] - range_m[0] < 2 * zone_m or count < 2 * block:
        return frames
    tiles = partial(frames.read_tiles, block)
    zone = ((range_m - range_m[0]) / zone_m).astype(np.int64)
    member = (zone[:, None] == np.arange(zone[-1] + 1)).astype(np.float32)
    far = (np.abs(np.subtract.outer(np.arange(zone[-1] + 1), np.arange(zone[-1] + 1))) > 1).astype(np.float32)
    power, variance = _compute_moments(lambda: (np.abs(values) for _, values in tiles()), count)
    weight = 1.0 / np.maximum(variance, LEAST_VARIANCE * power + TINY)
    # mean of each bin over the blocks, after the far bins have aligned each with the one before
    blocks = average_blocks(frames, block)
    steps = (blocks[1:] * blocks[:-1].conj() * weight) @ (member @ far)[:, zone]
    phase_rad = np.cumsum(arctangent(steps.imag, steps.real), axis=0)
    static = (blocks[0] + (blocks[1:] * np.exp(-1j * phase_rad)).sum(axis=0)) / blocks.shape[0]
    own = weight * np.abs(static) ** 2
    wanted = np.maximum(LEAST_WEIGHT, MARGIN * own) / np.maximum(own @ member @ far, TINY)[zone]
    served = wanted <= block
    if not served.any():
        return frames
    pointing = ((weight / weight.max() * static.conj())[:, None] * member).astype(np.complex64)
    zones = np.unique(zone[served])
    turns = np.empty((count, zones.size), dtype=np.complex64)
    for first, values in tiles():
        turns[first : first + values.shape[0]] = (values @ pointing @ far)[:, zones]
    for column, number in enumerate(zones):  # the rotation that corrects a zone
        pointer, pulses = turns[:, column], math.ceil(wanted[served & (zone == number)].max())
        if pulses > 1:
            place = np.arange(count)
            total = np.concatenate([[0.0], np.cumsum(pointer, dtype=np.complex128)])
            stop = np.minimum(place + pulses - pulses // 2, count)
            pointer = np.asarray(total[stop] - total[np.maximum(place - pulses // 2, 0)], dtype=np.complex64)
        turns[:, column] = pointer.conj() / np.maximum(np.abs(pointer), TINY)
    place = np.searchsorted(zones, zone)

    def turned(bins: npt.NDArray[np.bool_], values: Values, first: int) -> Values:
        changed = values.copy()
        changed[:, bins] *= turns[first : first + values.shape[0], place[bins]]
        return changed

    trial = _compute_moments(lambda: (turned(served, values, first) for first, values in tiles()), count)[1]
    better = served & (trial < _compute_moments(lambda: (values for _, values in tiles()), count)[1])
    return frames.map_tiles(partial(turned, better)) if better.any() else frames


def average_blocks(frames: Frames, block_pulses: int) -> ComplexArray:
    """Average frames over whole blocks of pulses, (K, N)."""
    averages = np.empty((frames.n_pulses // block_pulses, frames.n_bins), dtype=np.complex128)
    for first, values in frames.read_tiles(block_pulses):
        n_blocks = values.shape[0] // block_pulses
        blocks = values[: n_blocks * block_pulses].reshape(n_blocks, block_pulses, frames.n_bins)
        blocks.mean(axis=1, dtype=np.complex128, out=averages[first // block_pulses :][:n_blocks])
    return averages


def _compute_moments(tiles: Callable[[], Iterator[npt.NDArray[Any]]], count: int) -> tuple[FloatArray, FloatArray]:
    """Compute each column's power of the mean and variance, in two passes."""
    mean = variance = np.zeros(())
    for values in tiles():
        mean = mean + values.sum(axis=0, dtype=np.complex128 if np.iscomplexobj(values) else np.float64)
    mean = mean / count
    for values in tiles():
        rest = values - mean.astype(values.dtype)
        variance = variance + (np.einsum("in,in->n", rest, rest.conj()).real / count).astype(np.float64)
    return np.abs(mean) ** 2, np.asarray(variance, dtype=np.float64)
