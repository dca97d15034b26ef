"""Low-pass of positions without delay and with sound ends."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

MIN_RATE_PER_CUTOFF = 3.0
FILTER_ORDER = 4
MOST_GROWTH = 1.5
MEMORY_S, FIT_S, PREDICTION_NOISE_M = 0.1, 1.0, 1e-3
"""Ends are continued for twice the memory of the prediction, which is fitted to the last second as if it had 1 mm of
noise: that keeps it from growing."""


def can_lowpass(rate_hz: float, cutoff_hz: float | None) -> bool:
    """Whether a recording has three frames per period of the cutoff, enough for the filter; None is no filter."""
    return cutoff_hz is not None and rate_hz >= MIN_RATE_PER_CUTOFF * cutoff_hz


def lowpass(position: FloatArray, *, rate_hz: float, cutoff_hz: float | None) -> FloatArray:
    """Zero-phase low-pass: a fourth-order Butterworth, forwards and backwards, half power at the cutoff (E-02).

    Before filtering, the ends are continued by linear prediction. The usual point reflection alone bends the path at
    the ends and spoils the velocity there by a tenth of its peak.

    Parameters
    ----------
    position : ndarray, shape (T, P, 3)
        In m, no NaN.
    rate_hz : float
        Frames per second, more than twice the cutoff.
    cutoff_hz : float or None
        Frequency at which half the power is left, in Hz; None for no filter.
    """
    from scipy.signal import butter, sosfiltfilt

    if cutoff_hz is None:
        return position
    # two passes lose 3 dB together where each loses 1.5 dB: pre-warped bilinear corner of one pass
    widening = (math.sqrt(2.0) - 1.0) ** (-1.0 / (2 * FILTER_ORDER))
    corner = 2.0 / math.pi * math.atan(math.tan(math.pi * cutoff_hz / rate_hz) * widening)
    sections = butter(FILTER_ORDER, corner, output="sos")
    n_edge, memory = round(2 * MEMORY_S * rate_hz), max(4, round(MEMORY_S * rate_hz))
    flat = position.reshape(len(position), -1)
    recent = round(FIT_S * rate_hz)
    before = _continue(flat[::-1][-recent:], n_edge, memory)[::-1]
    longer = np.concatenate([before, flat, _continue(flat[-recent:], n_edge, memory)])
    smooth = sosfiltfilt(sections, longer, axis=0, padlen=min(memory, len(longer) - 1))
    return np.asarray(smooth[n_edge : n_edge + len(flat)], dtype=np.float64).reshape(position.shape)


def _continue(recent: FloatArray, n_frames: int, memory: int) -> FloatArray:
    """Next ``n_frames`` of each column: its straight trend plus the linear prediction of what remains.

    A jump among the recent frames can make the prediction grow: where it leaves the span of what it was made from, the
    column is continued by point reflection instead.
    """
    steps = np.arange(len(recent) + n_frames) - (len(recent) - 1.0)
    trend = np.polynomial.polynomial.polyval(steps, np.polynomial.polynomial.polyfit(steps[: len(recent)], recent, 1)).T
    rest = recent - trend[: len(recent)]
    memory = min(memory, len(recent) // 3)
    windows = np.lib.stride_tricks.sliding_window_view(rest, memory + 1, axis=0)
    past, now = windows[..., :memory], windows[..., memory]
    normal = np.einsum("tci,tcj->cij", past, past) + len(past) * PREDICTION_NOISE_M**2 * np.eye(memory)
    weights = np.linalg.solve(normal, np.einsum("tci,tc->ci", past, now)[..., np.newaxis])[..., 0]
    ahead = list(rest[len(rest) - memory :])
    for _ in range(n_frames):
        ahead.append(np.einsum("ic,ci->c", np.array(ahead[-memory:]), weights))
    predicted = np.array(ahead[memory:])
    reflected = 2.0 * rest[-1] - rest[::-1][1 : n_frames + 1]
    grows = np.abs(predicted).max(axis=0) > MOST_GROWTH * np.abs(rest).max(axis=0)
    return np.asarray(np.where(grows, reflected, predicted) + trend[len(recent) :], dtype=np.float64)
