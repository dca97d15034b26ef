"""Search for the longest straight segment of constant velocity in a path."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from doppelgait.core.kernels.compiled import kernel

FloatArray = npt.NDArray[np.float64]


@kernel()
def longest_stretch(
    path: FloatArray,
    speed: FloatArray,
    step_s: float,
    lateral_m: float,
    speed_deviation: float,
    min_length_m: float,
    min_speed_mps: float,
    shortest: int,
) -> tuple[int, int]:
    """Find the first longest segment of a path within the limits.
    Its ends are inclusive. Shapes: path (T, 2); speed (T,).
    """
    best_first, best_last = -1, -1
    for first in range(path.shape[0]):
        if path.shape[0] - first <= shortest:
            break
        steps = _steps_allowed(
            path[first:], speed[first:], step_s, lateral_m, speed_deviation, min_length_m, min_speed_mps
        )
        if steps >= shortest:
            best_first, best_last, shortest = first, first + steps, steps + 1
    return best_first, best_last


@kernel()
def _steps_allowed(path, speed, step_s, lateral_m, deviation, min_length_m, min_speed_mps):  # type: ignore[no-untyped-def]
    """Count the steps after which a segment may end; -1 if none."""
    spread = (1.0 + deviation) / (1.0 - deviation)
    high, low, total = -math.inf, math.inf, 0.0
    left, right = math.inf, -math.inf
    before, turned, last = 0.0, 0.0, -1
    for step in range(path.shape[0]):
        high, low, total = max(high, speed[step]), min(low, speed[step]), total + speed[step]
        x, y = path[step, 0] - path[0, 0], path[step, 1] - path[0, 1]
        length, raw = math.sqrt(x * x + y * y), math.atan2(y, x)
        turned -= 2.0 * math.pi * np.rint((raw - before) / (2.0 * math.pi))  # no jump from pi to -pi
        before, angle = raw, raw + turned
        if length > lateral_m:  # a nearer sample allows every direction
            half = math.asin(lateral_m / length)
            left, right = min(left, angle + half), max(right, angle - half)
        if left < right or high > spread * low:
            break  # neither gets better later
        mean = total / (step + 1)
        steady = high <= (1.0 + deviation) * mean and low >= (1.0 - deviation) * mean
        if steady and right <= angle <= left and length >= max(min_length_m, min_speed_mps * step_s * step):
            last = step
    return last
