"""Stride period from the repetition of the limb motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

PERIOD_S = (0.25, 2.5)
OVERLAP_S = 0.25
"""Minimum overlap of the motion and its shifted copy."""
LIKENESS = 0.7
"""Minimum normalised autocorrelation of a repetition; 1 is an exact repetition."""
FIRST = 0.1
"""Tolerance from the highest peak within which the first peak is used, since multiples of the period are as high."""


def repetition_hz(swing: FloatArray, *, rate_hz: float) -> float:
    r"""Measure the repetition frequency of a motion, Hz. Shapes: swing (T, P, C)."""
    velocity = np.gradient(swing, axis=0)
    return _first_peak_hz(velocity, velocity, rate_hz, PERIOD_S)


def mirrored_repetition_hz(swing: FloatArray, parts: Sequence[str], *, rate_hz: float) -> float:
    """Measure the stride frequency from mirrored half strides, Hz."""
    # in a walk, run, pace or trot, each left part repeats the motion of the right part after half a
    # stride
    sides = []
    for part in dict.fromkeys(parts):
        other = part.replace("left_", "right_", 1)
        if part.startswith("left_") and other in parts:
            both = [[i for i, one in enumerate(parts) if one == name] for name in (part, other)]
            sides.append([swing[:, points].mean(axis=1) for points in both])
    if not sides:
        return float("nan")
    left, right = (np.gradient(np.stack([pair[k] for pair in sides], axis=1), axis=0) for k in (0, 1))
    here, there = np.concatenate([left, right], axis=1), np.concatenate([right, left], axis=1)
    return _first_peak_hz(here, there, rate_hz, (PERIOD_S[0] / 2, PERIOD_S[1] / 2)) / 2.0


def _first_peak_hz(here: FloatArray, there: FloatArray, rate_hz: float, period_s: tuple[float, float]) -> float:
    """Return the frequency of the first high correlation peak."""
    n = len(here)
    first, stop = int(period_s[0] * rate_hz), min(n - int(OVERLAP_S * rate_hz), int(period_s[1] * rate_hz))
    if first < 1 or stop - first < 3:
        return float("nan")
    likeness = np.empty(stop - first)
    for k in range(first, stop):
        a, b = here[: n - k].ravel(), there[k:].ravel()
        power = float(a @ a + b @ b)
        likeness[k - first] = 2.0 * float(a @ b) / power if power > 0.0 else 0.0
    before, now, after = likeness[:-2], likeness[1:-1], likeness[2:]
    peaks = np.flatnonzero((now >= before) & (now > after) & (now > LIKENESS))
    if not peaks.size:
        return float("nan")
    i = int(peaks[now[peaks] > now[peaks].max() - FIRST][0])
    # a parabola through the peak and its neighbours
    shift = 0.5 * (before[i] - after[i]) / (before[i] - 2.0 * now[i] + after[i])
    return float(rate_hz / (first + 1 + i + shift))
