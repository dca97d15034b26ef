"""Time and phase of all gait models, and columns of their parameters.

SciPy's cubic curves are not used: its module takes as long to load as xarray without pandas.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, is_dataclass
from itertools import islice
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait._core import native
from doppelgait.core.errors import ConfigError
from doppelgait.core.units import FloatArray
from doppelgait.motion.motion import Motion, make_motion

Values = FloatArray | float
"""Value of a single example, or column (B, 1) of the values of a batch."""
Rngs = Sequence[np.random.Generator | None]


def make_column(values: Sequence[float]) -> FloatArray:
    """Return the numbers of examples as a column, (B, 1)."""
    return np.array(values, dtype=float)[:, None]


class Columns:
    """Attributes of the examples of a batch: columns of numbers, columns of dataclasses, lists."""

    def __init__(self, examples: Sequence[Any]) -> None:
        self._examples = examples

    def __getattr__(self, name: str) -> Any:
        values: Any = [getattr(example, name) for example in self._examples]
        if isinstance(values[0], float | int):
            values = make_column(values)
        elif is_dataclass(values[0]):
            values = Columns(values)
        setattr(self, name, values)  # made once
        return values


def stack_columns(first: FloatArray, *others: Values) -> FloatArray:
    """Stack columns (..., n), or numbers after the first, to (..., n, number of columns)."""
    found = np.empty((1 + len(others), *first.shape))
    for row, values in zip(found, (first, *others), strict=True):
        row[...] = values
    return found.transpose(*range(1, found.ndim), 0)


def solve_two_links(start: FloatArray, end: FloatArray, first: Values, second: Values, *, bend: float) -> FloatArray:
    """Return the joint of two links between start and end, (..., 3)."""
    line = end - start
    x, y, z = line[..., 0], line[..., 1], line[..., 2]
    level = x * x + z * z
    square = level + y * y
    first_2, second_2 = first**2, second**2
    along = (square + (first_2 - second_2)) / (2 * square)  # share of the line
    # The bend is in the plane of the limb and the direction of travel, perpendicular to the chain.
    across = bend * np.sqrt(np.maximum(first_2 - along * along * square, 0.0) / level)
    return np.asarray(start + stack_columns(x * along - z * across, y * along, z * along + x * across))


_STEPS = 60
"""Maximum number of steps to a root: Newton's method needs 4, bisection to the last digit 52."""
_LAST_STEP = 1e-9
"""Final step of Newton's method relative to the knots' distance; the error is about its square."""


@dataclass(frozen=True)
class Curve:
    """Piecewise cubics between knots, extrapolated beyond the ends."""

    # shapes: knots (K,) or (B, K), each row used up to its size (B,); coefficients (4, K - 1) or
    # (4, B, K - 1); values of any shape for a single curve, and (..., B, n) for B curves

    knots: FloatArray
    coefficients: FloatArray
    sizes: npt.NDArray[np.intp]

    def __call__(self, x: npt.ArrayLike, order: int = 0) -> FloatArray:
        """Return values (``order`` 0) or first derivatives (1)."""
        at = np.asarray(x, dtype=float)
        rows = (1, at.size) if self.knots.ndim == 1 else (math.prod(at.shape[:-1]), at.shape[-1])
        found = np.empty(rows)
        curves = np.atleast_2d(self.knots), self.sizes.reshape(-1), self.coefficients.reshape(4, -1)
        native.evaluate_cubics(*curves, order, at.reshape(rows), found)
        return found.reshape(at.shape)

    def where(self, values: npt.ArrayLike) -> FloatArray:
        """Invert curves with rising knots at values between those of the ends."""
        wanted = np.asarray(values, dtype=float)
        heights = np.zeros(self.knots.shape)
        heights[..., :-1] = self.coefficients[0]
        size = self.knots.shape[-1]
        last = np.arange(self.sizes.size) * size + self.sizes.ravel() - 1
        ends = self.knots.ravel()[last].reshape(*self.sizes.shape, 1)
        heights.reshape(-1)[last] = self(ends).ravel()
        # pieces of the values, counted through all curves
        piece = np.empty(wanted.shape, dtype=np.intp)
        if heights.ndim == 1:
            piece[...] = heights[1:-1].searchsorted(wanted, side="right")
        else:
            for row, (own, own_size) in enumerate(zip(heights, self.sizes.tolist(), strict=True)):
                piece[..., row, :] = own[1 : own_size - 1].searchsorted(wanted[..., row, :], side="right")
            piece += np.arange(len(heights))[:, None] * (size - 1)
        low, high = (self.knots[..., ends].ravel().take(piece) for ends in (slice(None, -1), slice(1, None)))
        below, above = (heights[..., ends].ravel().take(piece) for ends in (slice(None, -1), slice(1, None)))
        width = high - low
        x = low + (wanted - below) / (above - below) * width
        done: npt.NDArray[np.bool_] = np.zeros((), dtype=bool)
        for _ in range(_STEPS):
            error = self(x) - wanted
            low, high = np.where(error <= 0, x, low), np.where(error >= 0, x, high)
            tried = x - error / self(x, 1)
            following = np.where((tried >= low) & (tried <= high), tried, (low + high) / 2.0)
            close = np.abs(following - x) <= _LAST_STEP * width
            x = np.where(done, x, following)  # a curve's values do not depend on how long others take
            done = done | close.all(axis=None if self.knots.ndim == 1 else -1, keepdims=True)
            if done.all():
                break
        return np.asarray(x)


def fit_cubic_hermite(
    knots: FloatArray, heights: FloatArray, slopes: FloatArray, sizes: npt.ArrayLike | None = None
) -> Curve:
    """Return cubics from heights and slopes at the knots."""
    step = knots[..., 1:] - knots[..., :-1]  # np.diff takes three times as long for the few knots of a motion
    chord = (heights[..., 1:] - heights[..., :-1]) / step
    found = np.empty((4, *step.shape))
    found[0], found[1] = heights[..., :-1], slopes[..., :-1]
    bend = found[1] + slopes[..., 1:] - 2.0 * chord
    found[2] = (chord - found[1] - bend) / step
    found[3] = bend / step**2
    return Curve(knots, found, np.broadcast_to(knots.shape[-1] if sizes is None else sizes, knots.shape[:-1]))


def fit_cubic_spline(knots: npt.ArrayLike, heights: npt.ArrayLike, sizes: npt.ArrayLike | None = None) -> Curve:
    r"""Return C2 cubic splines with not-a-knot ends. Shapes: those of :class:`Curve`."""
    # knots beyond the size of a row rise, too, and have no effect
    knots, heights = np.asarray(knots, dtype=float), np.asarray(heights, dtype=float)
    x, y = np.atleast_2d(knots).T.copy(), np.atleast_2d(heights).T.copy()  # a row is the same knot of all curves
    h = x[1:] - x[:-1]
    m = (y[1:] - y[:-1]) / h
    row, end = np.arange(x.shape[1]), np.broadcast_to(len(x) if sizes is None else sizes, x.shape[1])
    h_1, h_2, m_1, m_2 = h[end - 2, row], h[end - 3, row], m[end - 2, row], m[end - 3, row]
    first, last = x[2] - x[0], x[end - 1, row] - x[end - 3, row]
    lower, diagonal, upper, slopes = np.zeros_like(x), np.ones_like(x), np.zeros_like(x), np.zeros_like(x)
    lower[1:-1], diagonal[1:-1], upper[1:-1] = h[1:], 2.0 * (h[:-1] + h[1:]), h[:-1]
    slopes[1:-1] = 3.0 * (h[1:] * m[:-1] + h[:-1] * m[1:])
    diagonal[0], upper[0] = h[1], first
    slopes[0] = ((h[0] + 2.0 * first) * h[1] * m[0] + h[0] ** 2 * m[1]) / first
    lower[end - 1, row], diagonal[end - 1, row], upper[end - 1, row] = last, h_2, 0.0
    slopes[end - 1, row] = (h_1**2 * m_2 + (2.0 * last + h_1) * h_2 * m_1) / last
    # elimination; all pivots are positive. A row is a number or an array for all curves.
    systems = (lower, diagonal, upper, slopes)
    low, pivots, high, found = (rows[:, 0].tolist() if row.size == 1 else [*rows] for rows in systems)
    for i in range(1, len(x)):
        factor = low[i] / pivots[i - 1]
        pivots[i] = pivots[i] - factor * high[i - 1]
        found[i] = found[i] - factor * found[i - 1]
    found[-1] = found[-1] / pivots[-1]
    for i in range(len(x) - 2, -1, -1):
        found[i] = (found[i] - high[i] * found[i + 1]) / pivots[i]
    return fit_cubic_hermite(knots, heights, np.array(found).T.reshape(knots.shape), sizes)


def fit_periodic_pchip(knots: npt.ArrayLike, heights: npt.ArrayLike) -> Curve:
    """Return shape-preserving cubics through periodic knots (Fritsch and Carlson 1980)."""
    # slopes are 0 at a level chord or a change of sign, else the chords' weighted harmonic mean
    x, y = np.asarray(knots, dtype=float), np.asarray(heights, dtype=float)
    count = x.shape[-1]
    around = np.arange(-2, count + 2)  # slopes depend only on the neighbours
    x, y = x[..., around % count] + around // count, y[..., around % count]
    step = np.diff(x)
    chord = np.diff(y) / step
    before, after = chord[..., :-1], chord[..., 1:]
    weight_before, weight_after = 2.0 * step[..., 1:] + step[..., :-1], step[..., 1:] + 2.0 * step[..., :-1]
    level = before * after <= 0.0
    safe = (np.where(level, 1.0, before), np.where(level, 1.0, after))
    mean = (weight_before + weight_after) / (weight_before / safe[0] + weight_after / safe[1])
    return fit_cubic_hermite(x[..., 1:-1], y[..., 1:-1], np.where(level, 0.0, mean))


STRIDE_CORRELATION = 0.5
"""Lag-one correlation of successive stride times (assumed)."""
PACE_CORRELATION = 0.56  # of the speed of strides, lag one; recorded dogs 0.58, people 0.46
STEP_PACE_CORRELATION, STEP_PACE = 0.67, 1.094  # of steps, so that strides have it and the stated sd
PACE_IN_LENGTH = 0.85
"""Share of a person's change of speed in the length of steps; recorded 0.86 (dogs 0.54: half)."""
LENGTH_WITH_TIME = 0.4
"""Correlation of length and time of a step; recorded 0.3 to 0.4. It keeps the trunk steadier than the steps."""
LARGEST_DEVIATION = 3.0
"""Maximum deviation of stride times in standard deviations, so that time always increases."""
_MARGIN = 2  # strides before the first and after the last sample: the spline's ends have no effect
_PACE_MARGIN = 3
"""Further strides of a known pace: paws are placed ahead of the frames and behind them."""


def sample_times_s(durations_s: Sequence[float], rates_hz: Values) -> tuple[FloatArray, list[int]]:
    """Return the frame times of examples, (B, T), and their numbers."""
    # shorter examples repeat their last time: a minimum over frames does not depend on others
    for duration_s in durations_s:
        if not (math.isfinite(duration_s) and duration_s > 0):
            raise ConfigError(f"duration_s: {duration_s!r} is not allowed: must be a number above 0 s")
    counts = (np.ceil(make_column(durations_s) * rates_hz - 1e-9) + 1).astype(int)
    return np.minimum(np.arange(counts.max()), counts - 1) / rates_hz, counts[:, 0].tolist()


def sample_autoregressive(count: int, rng: np.random.Generator, correlation: float = STRIDE_CORRELATION) -> FloatArray:
    """Draw autoregressive numbers of unit variance, within :data:`LARGEST_DEVIATION`."""
    values: list[float] = rng.standard_normal(count).tolist()
    fresh = math.sqrt(1 - correlation**2)
    for k in range(1, count):
        values[k] = correlation * values[k - 1] + fresh * values[k]
    return np.array([min(max(value, -LARGEST_DEVIATION), LARGEST_DEVIATION) for value in values])


def evaluate_laws(laws: Mapping[str, Mapping[str, float]], deviates: Sequence[float]) -> dict[str, float]:
    """Return the values of normal or lognormal laws at standard deviates."""
    values = {}
    for (name, law), x in zip(laws.items(), deviates, strict=True):
        value = law["median"] * math.exp(law["spread"] * x) if "median" in law else law["mean"] + law["sd"] * x
        values[name] = float(min(max(value, law.get("low", value)), law.get("high", value)))
    return values


Kind = tuple[str, FloatArray, npt.NDArray[np.integer[Any]], float]
"""Parameter that varies steps: name, values (B, 1), numbers of steps (B,) and correlation."""


def sample_series(kinds: Sequence[Kind], rngs: Rngs) -> list[FloatArray]:
    """Sample unit series (B, n) of parameters; 0 where the parameter is 0."""
    made = [np.zeros((sizes.size, sizes.max())) for _, _, sizes, _ in kinds]
    for row, rng in enumerate(rngs):
        for (name, spread, sizes, correlation), series in zip(kinds, made, strict=True):
            if spread[row, 0] > 0:
                if rng is None:
                    raise ConfigError(
                        f"{name} = {spread[row, 0]:g} needs a random generator (rng=dg.rng(seed)), or set it to 0"
                    )
                series[row, : sizes[row]] = sample_autoregressive(int(sizes[row]), rng, correlation)
    return made


@dataclass(frozen=True)
class Timing:
    """Frames of a batch: times and phases (B, T), the rows' counts, and a clock of B curves."""

    times_s: FloatArray
    counts: Sequence[int]
    clock: Curve
    phase: FloatArray


def time_even_strides(
    durations_s: Sequence[float], columns: Columns, period_s: FloatArray, rngs: Rngs
) -> tuple[Timing, Curve]:
    """Time frames by stride clocks; also return the drift from equal strides, by phase."""
    # it is exactly 0 without pace_sd; stride_variation and pace_sd need not be parameters
    times_s, counts = sample_times_s(durations_s, columns.rate_hz)
    none = np.zeros_like(period_s)
    variation, pace_sd = (getattr(columns, name, none) for name in ("stride_variation", "pace_sd"))
    shortest_s = period_s * (1 - LARGEST_DEVIATION * (variation + pace_sd / 2))
    sizes = (np.ceil(times_s[:, -1:] / shortest_s) + (2 * _MARGIN + 1)).astype(int)[:, 0]
    kinds = [("stride_variation", variation, sizes - 1, STRIDE_CORRELATION)]
    kinds += [("pace_sd", pace_sd, sizes - 1 + 2 * _PACE_MARGIN, PACE_CORRELATION)]
    series, pace = sample_series(kinds, rngs)
    longer = pace_sd / 2 * pace  # half of a faster stride is in its length, half in its time
    lengths_s = period_s * (1 + variation * series - longer[:, _PACE_MARGIN:-_PACE_MARGIN])
    before_s = -np.cumsum(lengths_s[:, _MARGIN - 1 :: -1], axis=1)[:, ::-1]
    knots_s = np.concatenate([before_s, sum_steps(lengths_s[:, _MARGIN:])], axis=1)
    strides = np.arange(-_MARGIN, sizes.max() - _MARGIN)
    clock = fit_cubic_spline(knots_s, columns.start_phase + strides, sizes)
    knots = columns.start_phase + np.arange(longer.shape[1] + 1) - (_MARGIN + _PACE_MARGIN)
    drift = fit_cubic_spline(knots, sum_steps(longer), sizes + 2 * _PACE_MARGIN)
    return Timing(times_s, counts, clock, clock(times_s)), drift


Landings = Mapping[str, npt.NDArray[np.floating[Any]]]
"""Phases in cycles at which feet land, by name."""


def scale_points(points: Sequence[FloatArray], scale_m: FloatArray) -> FloatArray:
    """Return scaled points as positions, (B, T, P, 3). Shapes: points (B, T, 3), scale_m (B, 1)."""
    planes = np.empty((len(points), 3, *points[0].shape[:-1]))
    for plane, point in zip(planes, points, strict=True):
        np.multiply(point.transpose(2, 0, 1), scale_m, out=plane)
    return np.ascontiguousarray(planes.transpose(2, 3, 0, 1))


def make_gait_motions(
    position_m: FloatArray,
    timing: Timing,
    parameters: Sequence[Any],
    landings: Sequence[Landings],
    parts: Mapping[str, str],
    facts: Sequence[Mapping[str, Any]],
    reports: Sequence[Mapping[str, str]],
) -> list[Motion]:
    """Make the motions of walkers from positions, (B, T, P, 3); facts have the harmonic of f_mu."""
    position_m = np.ascontiguousarray(position_m)
    times_s, phase = timing.times_s, timing.phase
    strides_hz = ((phase[:, -1] - phase[:, 0]) / (times_s[:, -1] - times_s[:, 0])).tolist()
    # phases of all landings; a row is filled with the value of its first knot, inverted at once
    sizes = [sum(phases.size for phases in feet.values()) for feet in landings]
    wanted = np.repeat(timing.clock.coefficients[0, :, :1], max(sizes), axis=1)
    for landed, size, feet in zip(wanted, sizes, landings, strict=True):
        landed[:size] = np.concatenate([*feet.values()])
    landed_s = np.clip(timing.clock.where(wanted), 0.0, times_s[:, -1:]).tolist()
    motions = []
    for row, (config, stride_hz, count) in enumerate(zip(parameters, strides_hz, timing.counts, strict=True)):
        own = {**facts[row]}
        harmonic = own.pop("harmonic")
        due_s = iter(landed_s[row])
        footfalls = {foot: [*islice(due_s, phases.size)] for foot, phases in landings[row].items()}
        own |= {"source": config.kind, "kind": config.kind, "footfalls": footfalls}
        own |= {"stride_frequency_hz": stride_hz, "gait_frequency_hz": harmonic * stride_hz}
        own |= {"step_frequency_hz": 2 * stride_hz} if harmonic == 2 else {}
        names: dict[str, Any] = {"markers": tuple(parts), "parts": tuple(parts.values())}
        motions.append(
            make_motion(position_m[row, :count], rate_hz=config.rate_hz, facts=own, report=reports[row], **names)
        )
    return motions


Steps = tuple[FloatArray, FloatArray, FloatArray, npt.NDArray[np.intp]]
"""Touchdowns: times in s, phases in cycles (left at every half, right at every whole number) and
distances in m, each (B, K), and the number of touchdowns of each example."""

_STEP_MARGIN = 5
"""Touchdowns before the first and after the last frame: the splines' ends have no effect."""


def step_series(durations_s: FloatArray, columns: Any, stride_s: FloatArray, stride_m: FloatArray, rngs: Rngs) -> Steps:
    """Sample the touchdowns of varied steps, from before time 0 to after the durations."""
    deviating = [columns.step_time_sd, columns.step_length_sd, columns.pace_sd]
    in_time = STEP_PACE * deviating[2] * (1 - PACE_IN_LENGTH)
    shortest = 1 - LARGEST_DEVIATION * (deviating[0] + in_time) - np.abs(columns.time_asymmetry) / 2
    sizes = (np.ceil(2 * durations_s / (stride_s * shortest)) + (2 * _STEP_MARGIN + 1)).astype(int)[:, 0]
    memory = (0.0, 0.0, STEP_PACE_CORRELATION)
    kinds = zip(("step_time_sd", "step_length_sd", "pace_sd"), deviating, memory, strict=True)
    series = sample_series([(name, spread, sizes - 1, correlation) for name, spread, correlation in kinds], rngs)
    together = np.where(deviating[0] > 0, LENGTH_WITH_TIME, 0.0)
    series[1] = together * series[0] + np.sqrt(1 - together**2) * series[1]
    deviating[2] = STEP_PACE * deviating[2]
    time, length, pace = (spread * values for spread, values in zip(deviating, series, strict=True))
    start = columns.start_phase
    numbers = np.floor(2 * start) - _STEP_MARGIN + np.arange(sizes.max())
    left = np.where(numbers[:, 1:] % 2, 0.5, -0.5)
    quicker = (1 - PACE_IN_LENGTH) * pace
    times = sum_steps(stride_s / 2 * (1 + columns.time_asymmetry * left + time - quicker))
    distance = sum_steps(stride_m / 2 * (1 + length + PACE_IN_LENGTH * pace))
    phases = numbers / 2
    start_s = fit_cubic_spline(times, phases, sizes).where(start)
    start_m = fit_cubic_spline(phases, distance, sizes)(start)
    return times - start_s, phases, distance - start_m, sizes


def sum_steps(steps: FloatArray) -> FloatArray:
    """Return the sums up to each step, from 0. Shapes: steps (B, n); returns (B, n + 1)."""
    return np.concatenate([np.zeros((len(steps), 1)), np.cumsum(steps, axis=1)], axis=1)
