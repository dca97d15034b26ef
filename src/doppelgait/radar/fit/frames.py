"""Faulty frames: repeated, blank, lost, hit by transmitters."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from doppelgait.radar.fit.static import Estimate

ComplexArray = npt.NDArray[np.complex128]
FloatArray = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

MEDIAN_FRAMES = 9
"""Length of the running median, frames; bursts of up to four frames stand out of it."""
FALSE_ALARMS = 1e-3
"""Expected number of noise cells above the threshold in a whole recording."""
BUSY_SHARE = 0.03
"""Share of frames above the threshold from which a bin has a target."""


@dataclass(frozen=True)
class FrameFaults:
    """Faulty frames of a recording.
    Shapes: dropped (I,).
    """

    dropped: Mask
    blank: int
    lost: int
    probability: Estimate
    mean_length: float


def find_frame_faults(samples_v: ComplexArray, *, slow_time_s: FloatArray) -> FrameFaults:
    """Find dropped and lost frames.
    A dropped frame repeats exactly or is zero (noise never repeats); a lost frame is a gap of the time axis.
    """
    blank = ~samples_v.any(axis=1)
    repeated = np.concatenate([[False], (samples_v[1:] == samples_v[:-1]).all(axis=1)])
    dropped = blank | repeated
    steps = np.diff(slow_time_s)
    lost = int(np.sum(np.maximum(np.round(steps / np.median(steps)) - 1, 0)))
    runs = int(np.sum(dropped & ~np.concatenate([[False], dropped[:-1]])))
    length = float(dropped.sum() / runs) if runs else 0.0
    total, faulty = len(samples_v) + lost, int(dropped.sum()) + lost
    share = (faulty + 1) / (total + 2)
    sd = math.sqrt(share * (1 - share) / total * max(length, 1.0))
    return FrameFaults(dropped, int(blank.sum()), lost, Estimate(faulty / total, sd), length)


@dataclass(frozen=True)
class Bursts:
    """Interference in an otherwise good recording.
    Shapes: frames (I,).
    """

    frames: Mask
    level_db: float
    mean_length: float
    share: float


def find_bursts(rest_v: ComplexArray, *, noise_power_v2: float, quiet: Mask) -> Bursts:
    """Find frames with interference.
    Such frames have cells far above the noise after a running median has removed slow motion.
    """
    nothing = np.zeros(len(rest_v), dtype=bool)
    if not noise_power_v2 > 0 or not quiet.any():
        return Bursts(nothing, math.nan, 0.0, 0.0)
    rest = rest_v[:, quiet]
    power = np.abs(rest - _compute_running_median(rest.real) - 1j * _compute_running_median(rest.imag)) ** 2
    floor = np.maximum(np.median(power, axis=0) / math.log(2.0), noise_power_v2)
    hit: Mask = np.asarray(power > floor * math.log(power.size / FALSE_ALARMS))
    hit[: MEDIAN_FRAMES // 2] = hit[len(hit) - MEDIAN_FRAMES // 2 :] = False
    hit &= hit.mean(axis=0) <= BUSY_SHARE
    frames: Mask = np.asarray(hit.any(axis=1))
    if not frames.any():
        return Bursts(nothing, math.nan, 0.0, 0.0)
    runs = int(np.sum(frames & ~np.concatenate([[False], frames[:-1]])))
    level = float(10.0 * np.log10(np.mean(power[hit])))
    return Bursts(frames, level, float(frames.sum() / runs), float(hit[frames].mean()))


def _compute_running_median(values: FloatArray) -> FloatArray:
    """Return the running median of nine frames per bin.
    The first and last frame are repeated beyond the ends.
    """
    half = MEDIAN_FRAMES // 2
    padded = np.pad(values, ((half, half), (0, 0)), mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, MEDIAN_FRAMES, axis=0)
    return np.asarray(np.partition(windows, half, axis=-1)[..., half])
