"""Time and phase of all gait models.

The module has sample times, the stride clock, footfalls, varying steps and cubic curves. SciPy's cubic curves are not
used, because its module of interpolation takes as long to load as xarray without pandas.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import ConfigError
from doppelgait.core.rng import RandomSource, as_generator

FloatArray = npt.NDArray[np.float64]


def stack_columns(first: FloatArray, *others: FloatArray | float) -> FloatArray:
    """Stack columns to shape (n, number of columns)."""
    # a number is a constant column. First columns of shape (k, n) result in (k, n, number of
    # columns).
    found = np.empty((1 + len(others), *first.shape))
    found[0] = first
    for number, other in enumerate(others, 1):
        found[number] = other
    return found.transpose(*range(1, found.ndim), 0)


def stack_xyz(x: FloatArray, y: FloatArray | float, z: FloatArray | float) -> FloatArray:
    """Stack coordinates to points, shape (n, 3). A number is a constant coordinate."""
    return np.stack([np.broadcast_to(part, x.shape) for part in (x, y, z)], axis=1)


_STEPS = 60
"""Maximum number of steps to a root. Newton's method needs four; bisection to the last digit needs 52."""
_LAST_STEP = 1e-9
"""Length of a final step of Newton's method relative to the knots' distance. The error is then about its square."""


@dataclass(frozen=True)
class Curve:
    """Piecewise cubic curve between knots. The outermost cubics are extrapolated beyond the ends.
    Shapes: knots (K,); coefficients (4, K - 1).
    """

    knots: FloatArray
    coefficients: FloatArray

    def __call__(self, x: npt.ArrayLike, order: int = 0) -> FloatArray:
        """Return values (``order`` 0) or first derivatives (1)."""
        at = np.asarray(x, dtype=float)
        place = self.knots[1:-1].searchsorted(at, side="right")
        u = at - self.knots[place]
        c_0, c_1, c_2, c_3 = self.coefficients.take(place, axis=1)
        if order == 1:
            return np.asarray(c_1 + u * (2.0 * c_2 + u * (3.0 * c_3)))
        return np.asarray(c_0 + u * (c_1 + u * (c_2 + u * c_3)))

    def where(self, values: npt.ArrayLike) -> FloatArray:
        """Invert a curve with rising knots."""
        # the values must be between those of its first and its last knot
        wanted = np.asarray(values, dtype=float)
        heights = np.append(self.coefficients[0], self(self.knots[-1]))
        place = np.clip(heights.searchsorted(wanted, side="right") - 1, 0, self.knots.size - 2)
        low, high = self.knots[place], self.knots[place + 1]
        width = high - low
        x = low + (wanted - heights[place]) / (heights[place + 1] - heights[place]) * width
        for _ in range(_STEPS):
            error = self(x) - wanted
            low, high = np.where(error <= 0, x, low), np.where(error >= 0, x, high)
            tried = x - error / self(x, 1)
            following = np.where((tried >= low) & (tried <= high), tried, (low + high) / 2.0)
            x, step = following, np.abs(following - x)
            if (step <= _LAST_STEP * width).all():
                break
        return np.asarray(x)


def fit_cubic_hermite(knots: FloatArray, heights: FloatArray, slopes: FloatArray) -> Curve:
    """Return cubics from heights and slopes at the knots."""
    step = knots[1:] - knots[:-1]  # np.diff takes three times as long for the few knots of a motion
    chord = (heights[1:] - heights[:-1]) / step
    found = np.empty((4, step.size))
    found[0], found[1] = heights[:-1], slopes[:-1]
    bend = found[1] + slopes[1:] - 2.0 * chord
    found[2] = (chord - found[1] - bend) / step
    found[3] = bend / step**2
    return Curve(knots, found)


def fit_cubic_spline(knots: npt.ArrayLike, heights: npt.ArrayLike) -> Curve:
    r"""Return a C2 cubic spline with not-a-knot ends. Shapes: knots (K,); heights (K,)."""
    x, y = np.asarray(knots, dtype=float), np.asarray(heights, dtype=float)
    h = x[1:] - x[:-1]
    m = (y[1:] - y[:-1]) / h
    first, last = x[2] - x[0], x[-1] - x[-3]
    lower = [0.0, *h[1:].tolist(), float(last)]
    diagonal = [float(h[1]), *(2.0 * (h[:-1] + h[1:])).tolist(), float(h[-2])]
    upper = [float(first), *h[:-1].tolist()]
    right = np.empty(x.size)
    right[1:-1] = 3.0 * (h[1:] * m[:-1] + h[:-1] * m[1:])
    right[0] = ((h[0] + 2.0 * first) * h[1] * m[0] + h[0] ** 2 * m[1]) / first
    right[-1] = (h[-1] ** 2 * m[-2] + (2.0 * last + h[-1]) * h[-2] * m[-1]) / last
    # elimination; all pivots of a spline's system are positive
    slopes = right.tolist()
    for i in range(1, len(slopes)):
        factor = lower[i] / diagonal[i - 1]
        diagonal[i] -= factor * upper[i - 1]
        slopes[i] -= factor * slopes[i - 1]
    slopes[-1] /= diagonal[-1]
    for i in range(len(slopes) - 2, -1, -1):
        slopes[i] = (slopes[i] - upper[i] * slopes[i + 1]) / diagonal[i]
    return fit_cubic_hermite(x, y, np.array(slopes))


def fit_periodic_pchip(knots: npt.ArrayLike, heights: npt.ArrayLike) -> Curve:
    """Return a shape-preserving cubic through periodic knots."""
    # the phase is from 0 to 1 (Fritsch and Carlson 1980). A slope is 0 if the chords on both sides
    # differ in sign or one is level, otherwise it is their weighted harmonic mean (Fritsch and
    # Butland 1984).
    around = np.arange(-2, np.size(knots) + 2)  # slopes depend only on the neighbours
    x, y = np.asarray(knots, dtype=float), np.asarray(heights, dtype=float)
    x, y = x[around % x.size] + around // x.size, y[around % y.size]
    step = np.diff(x)
    chord = np.diff(y) / step
    before, after = chord[:-1], chord[1:]
    weight_before, weight_after = 2.0 * step[1:] + step[:-1], step[1:] + 2.0 * step[:-1]
    level = before * after <= 0.0
    safe = (np.where(level, 1.0, before), np.where(level, 1.0, after))
    mean = (weight_before + weight_after) / (weight_before / safe[0] + weight_after / safe[1])
    return fit_cubic_hermite(x[1:-1], y[1:-1], np.where(level, 0.0, mean))


STRIDE_CORRELATION = 0.5
"""Lag-one correlation of successive stride times (assumed)."""
PACE_CORRELATION = 0.95
"""Lag-one correlation of a walker's speed, which drifts over 20 steps (assumed). In the model, the
steps themselves are independent; recorded ones have a correlation of 0.3 (-0.4 to 0.95) in time and
-0.3 (-0.6 to 0.5) in length."""
LARGEST_DEVIATION = 3.0
"""Maximum deviation of stride times in standard deviations, so that time always increases."""
_MARGIN = 2
"""Number of strides before the first and after the last sample, so that the ends of the spline have no effect."""


def sample_times_s(duration_s: float, rate_hz: float) -> FloatArray:
    """Return the frame times up to ``duration_s``."""
    if not (math.isfinite(duration_s) and duration_s > 0):
        raise ConfigError(f"duration_s: {duration_s!r} is not allowed: must be a number above 0 s")
    return np.arange(math.ceil(duration_s * rate_hz - 1e-9) + 1) / rate_hz


def make_stride_clock(
    duration_s: float,
    *,
    period_s: float,
    start_phase: float = 0.0,
    variation: float = 0.0,
    rng: RandomSource | None = None,
) -> Curve:
    """Return the stride clock: phase in cycles as function of time."""
    # it is a cubic spline, so that the rate is continuous
    ahead = math.ceil(duration_s / (period_s * (1 - LARGEST_DEVIATION * variation))) + _MARGIN
    deviation = np.zeros(_MARGIN + ahead)
    if variation > 0:
        if rng is None:
            raise ConfigError(f"stride_variation: {variation!r} needs a random generator (rng=dg.rng(seed)), or set 0")
        deviation = variation * sample_autoregressive(deviation.size, as_generator(rng, "motion"))
    lengths_s = period_s * (1 + deviation)
    times_s = np.concatenate([-np.cumsum(lengths_s[_MARGIN - 1 :: -1])[::-1], [0.0], np.cumsum(lengths_s[_MARGIN:])])
    return fit_cubic_spline(times_s, start_phase + np.arange(-_MARGIN, ahead + 1.0))


def sample_autoregressive(count: int, rng: np.random.Generator, correlation: float = STRIDE_CORRELATION) -> FloatArray:
    """Draw autoregressive numbers of unit variance, within :data:`LARGEST_DEVIATION`."""
    noise = rng.standard_normal(count)
    values = np.empty(count)
    values[0] = noise[0]
    fresh = math.sqrt(1 - correlation**2)
    for k in range(1, count):
        values[k] = correlation * values[k - 1] + fresh * noise[k]
    return np.clip(values, -LARGEST_DEVIATION, LARGEST_DEVIATION)


def footfall_times_s(clock: Curve, touchdown_phase: Mapping[str, float], end_s: float) -> dict[str, list[float]]:
    """Return each foot's landing times before ``end_s``."""
    # touchdown_phase is in cycles, by name of the foot
    first, last = (float(p) for p in clock([0.0, end_s]))
    phases = {
        foot: offset + np.arange(math.ceil(first - offset - 1e-9), math.floor(last - offset + 1e-9) + 1)
        for foot, offset in touchdown_phase.items()
    }
    return landing_times_s(clock, phases, end_s)


def landing_times_s(
    clock: Curve, phases: Mapping[str, npt.NDArray[np.floating[Any]]], end_s: float
) -> dict[str, list[float]]:
    """Return the times of each foot's landing phases."""
    every_s = np.clip(clock.where(np.concatenate([*phases.values()])), 0.0, end_s) if phases else np.empty(0)
    times_s = np.split(every_s, np.cumsum([phase.size for phase in phases.values()])[:-1])
    return {foot: times.tolist() for foot, times in zip(phases, times_s, strict=True)}


def mean_stride_frequency_hz(times_s: FloatArray, phase: FloatArray) -> float:
    """Return the strides per second over a whole motion."""
    return float((phase[-1] - phase[0]) / (times_s[-1] - times_s[0]))


Steps = tuple[FloatArray, FloatArray, FloatArray]
"""Touchdowns: times in s, phases in cycles (left at every half, right at every whole number) and distances in m."""

_STEP_MARGIN = 5
"""Number of touchdowns before the first and after the last frame, so that the ends of the splines have no effect."""


def step_series(
    duration_s: float,
    *,
    stride_s: float,
    stride_m: float,
    start_phase: float = 0.0,
    time_sd: float = 0.0,
    length_sd: float = 0.0,
    pace_sd: float = 0.0,
    time_asymmetry: float = 0.0,
    rng: RandomSource | None = None,
) -> Steps:
    """Sample the touchdowns of both feet."""
    # they start well before time 0 and end well after duration_s
    if rng is None and (time_sd > 0 or length_sd > 0 or pace_sd > 0):
        raise ConfigError(
            f"step_time_sd = {time_sd:g}, step_length_sd = {length_sd:g}, pace_sd = {pace_sd:g} need a random "
            "generator (rng=dg.rng(seed)), or set all 0"
        )
    source = None if rng is None else as_generator(rng, "motion")
    shortest = 1 - LARGEST_DEVIATION * (time_sd + pace_sd / 2) - abs(time_asymmetry) / 2
    count = 2 * _STEP_MARGIN + math.ceil(2 * duration_s / (stride_s * shortest)) + 1
    first = math.floor(2 * start_phase) - _STEP_MARGIN
    left = np.where(np.arange(first + 1, first + count) % 2, 0.5, -0.5)
    time, length = (_sample_deviations(sd, count - 1, source, 0.0) for sd in (time_sd, length_sd))
    pace = _sample_deviations(pace_sd, count - 1, source, PACE_CORRELATION) / 2
    times = _sum_steps(stride_s / 2 * (1 + time_asymmetry * left + time - pace))
    distance = _sum_steps(stride_m / 2 * (1 + length + pace))
    phases = (first + np.arange(count)) / 2
    start_s = fit_cubic_spline(times, phases).where(start_phase)
    start_m = fit_cubic_spline(phases, distance)(start_phase)
    return times - float(start_s), phases, distance - float(start_m)


def _sum_steps(steps: FloatArray) -> FloatArray:
    return np.concatenate([[0.0], np.cumsum(steps)])


def _sample_deviations(sd: float, count: int, rng: np.random.Generator | None, correlation: float) -> FloatArray:
    if sd == 0 or rng is None:
        return np.zeros(count)
    return sd * sample_autoregressive(count, rng, correlation)
