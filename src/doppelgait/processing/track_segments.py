"""Segments of steady motion, by the least-cost partition."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from pydantic import Field

from doppelgait.core.config import FrozenModel
from doppelgait.core.errors import AnalysisError
from doppelgait.core.straight import LINE, PARABOLA, compute_straight_probability
from doppelgait.core.units import FloatArray

TYPICAL_SPEED_MPS = 3.0
"""Standard deviation of a segment's unknown radial velocity and ground speed: a weak prior."""
UNKNOWN_SD = 1e3
"""Prior standard deviation of the squared range at a change point, in measurement errors."""
ENVELOPE_SPAN_SD = 6.0
ENVELOPE_POINTS = 25  # number of values around the measured range at which histories are compared
REFERENCE_STEP_S = 0.1
HOPELESS = 1e3
"""Cost above the lowest one plus a change point at which a start is dropped: one range with an error of 30 sd."""
GIVE_UP_EVERY = 64  # number of samples between two searches for starts that can be dropped
LONGEST_S = 60.0
"""Age at which a start is dropped, so that the search is linear in time; neighbours of one speed are merged later."""
MOST_PLACES = 512  # number of samples up to which every one is tried as the place of a split


def find_best_knots(
    time_s: FloatArray,
    range_m: FloatArray,
    *,
    range_sd_m: float,
    smooth_mps2: float,
    penalty: float,
    min_segment_s: float,
) -> tuple[list[int], float]:
    """Find change points of least cost in s = R^2 (E-34b; Fearnhead et al., J. Comput. Graph. Stat. 28, 2019)."""
    n = time_s.size
    value, noise = range_m**2, 2.0 * range_m * range_sd_m
    histories, filters = _Histories(value[0], noise[0]), _Filters(n)
    for j in range(1, n):
        filters.start(j - 1, value[j - 1], noise[j - 1], range_m[j - 1])
        filters.step(time_s[j] - time_s[j - 1], value[j], noise[j], 2.0 * range_m[j] * smooth_mps2)
        last_start = int(np.searchsorted(time_s, time_s[j] - min_segment_s + 1e-9, side="right")) - 1
        room_left = j == n - 1 or time_s[-1] - time_s[j] >= min_segment_s - 1e-9
        if last_start >= 0 and room_left:
            histories.extend(j, last_start, filters, penalty, (value[j], noise[j]))
            if j % GIVE_UP_EVERY == 0:
                oldest = int(np.searchsorted(time_s, time_s[j] - LONGEST_S))
                filters.keep(histories.drop_hopeless(penalty, min(oldest, last_start)))
    return histories.knots(n - 1)


class _Histories:
    """Parabolas a (x - b)^2 + c per change point, of the histories that were not dropped."""

    def __init__(self, value: float, noise: float) -> None:
        self.abc = np.array([[noise**-2], [value], [0.0]])
        self.at = np.zeros(1, dtype=np.int64)
        self.number = np.zeros(1, dtype=np.int64)
        self.ancestry = [(0, -1)]  # change point and number of the history before, of all histories by number
        self.least = np.zeros(0)  # costs of the histories that may end at the last sample
        self.more = 0.0

    def extend(self, j: int, last_start: int, filters: _Filters, penalty: float, measured: tuple[float, float]) -> None:
        """Add the histories that are lowest at sample j for some value."""
        able = int(np.searchsorted(self.at, last_start, side="right"))
        at, (a, b, c) = self.at[:able], self.abc[:, :able]
        column = filters.select_column(at)
        first, cross, last = (filters.covariance[p, q, column] for p, q in ((0, 0), (0, 1), (1, 1)))
        variance = first + 1.0 / a
        surprise = b - filters.mean[0, column]
        least = c + filters.cost[column] + surprise**2 / variance + penalty * (at > 0)
        centre = filters.mean[1, column] + cross / variance * surprise
        steep = 1.0 / (last - cross**2 / variance)
        x = measured[0] + measured[1] * np.linspace(-ENVELOPE_SPAN_SD, ENVELOPE_SPAN_SD, ENVELOPE_POINTS)
        best = int(least.argmin())
        self.least, self.more = least, float((steep[best] * (x - centre[best]) ** 2).max())
        hopeful = np.flatnonzero(least <= least[best] + self.more)
        cost = steep[hopeful, None] * (x - centre[hopeful, None]) ** 2 + least[hopeful, None]
        kept = np.unique(np.append(hopeful[cost.argmin(axis=0)], best))
        self.abc = np.hstack([self.abc, np.stack([steep[kept], centre[kept], least[kept]])])
        self.at = np.append(self.at, np.full(kept.size, j))
        before, first_new = self.number[kept].tolist(), len(self.ancestry)
        self.ancestry += [(j, number) for number in before]
        self.number = np.append(self.number, np.arange(first_new, len(self.ancestry)))

    def drop_hopeless(self, penalty: float, oldest: int) -> npt.NDArray[np.int64]:
        """Drop costly histories and those that start before the oldest; return the other starts."""
        hopeful = np.ones(self.at.size, dtype=np.bool_)
        hopeful[: self.least.size] = self.least <= self.least.min() + self.more + penalty + HOPELESS
        hopeful &= self.at >= oldest
        self.abc, self.at, self.number = self.abc[:, hopeful], self.at[hopeful], self.number[hopeful]
        return np.unique(self.at)

    def knots(self, last: int) -> tuple[list[int], float]:
        """Return change points and cost of the cheapest history."""
        ends = np.flatnonzero(self.at == last)
        if not ends.size:
            return [], float("inf")
        cheapest = ends[self.abc[2, ends].argmin()]
        knots, (_, number) = [], self.ancestry[self.number[cheapest]]
        while number > 0:
            at, number = self.ancestry[number]
            knots.append(at)
        return knots[::-1], float(self.abc[2, cheapest])


class _Filters:
    """Kalman filters (s_i, s, s', s'') of every start i at one sample, along axis -1."""

    def __init__(self, n: int) -> None:
        self.count = 0
        self.starts = np.zeros(n, dtype=np.int64)
        self.mean = np.zeros((4, n))
        self.covariance = np.zeros((4, 4, n))
        self.cost = np.zeros(n)

    def start(self, i: int, value: float, noise: float, range_m: float) -> None:
        """Start a segment at sample i. Its initial value is determined by the segment before."""
        new = self.count
        self.starts[new] = i
        self.mean[:2, new] = value
        self.covariance[:2, :2, new] = (UNKNOWN_SD * noise) ** 2
        self.covariance[2, 2, new] = (2.0 * range_m * TYPICAL_SPEED_MPS) ** 2
        self.covariance[3, 3, new] = (2.0 * TYPICAL_SPEED_MPS**2) ** 2
        self.count += 1

    def select_column(self, starts: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
        """Return the columns of the filters of some starts."""
        has_gaps = self.starts[self.count - 1] >= self.count
        return np.searchsorted(self.starts[: self.count], starts) if has_gaps else starts

    def keep(self, starts: npt.NDArray[np.int64]) -> None:
        """Keep only the filters of these starts."""
        own = self.starts[: self.count]
        columns = np.flatnonzero(np.isin(own, starts) | (own > starts[-1]))
        for values in (self.starts, self.mean, self.covariance, self.cost):
            values[..., : columns.size] = values[..., columns]
            values[..., columns.size : self.count] = 0
        self.count = columns.size

    def step(self, dt: float, value: float, noise: float, drive: float) -> None:
        """Predict over dt, then update with one value."""
        count = self.count
        mean, covariance = self.mean[:, :count], self.covariance[:, :, :count]
        for moved in (mean, covariance, covariance.swapaxes(0, 1)):  # F m, then the rows and the columns of F P F^T
            moved[1] += dt * moved[2] + dt * dt / 2.0 * moved[3]
            moved[2] += dt * moved[3]
        push = np.array([0.0, dt / 2.0, 1.0, 0.0]) * drive * np.sqrt(REFERENCE_STEP_S * dt)
        covariance += np.outer(push, push)[:, :, None]
        seen = covariance[1].copy()
        variance = seen[1] + noise**2
        surprise = value - mean[1]
        self.cost[:count] += surprise**2 / variance
        mean += seen * (surprise / variance)
        covariance -= seen[:, None] * (seen / variance)[None]


RANGE_SD_M = 0.065
"""Error of one range; the penalty is then 0.06 m^2 for 110 ranges, the value of the studies."""


class SegmentationSettings(FrozenModel):
    """Parameters of the segmentation of a range track.

    penalty_factor: Factor of the cost of a change point: the cost is this times sd^2 ln n, for n
        ranges in the track.
    min_piece_s: Shortest time between change points.
    drop_s: Time that is removed on either side of a change point.
    same_speed_mps: Neighbouring segments are merged if the radial velocity at their change point
        changes by less than this.
    smooth_mps2: Standard deviation of a steady walker's acceleration along the range, averaged over
        0.1 s and independent between intervals of 0.1 s. Slow changes of speed stay within a
        segment, sudden changes start a new one.
    straight_level: A segment is divided further if the probability that its ranges are straight
        motion at constant velocity is below this. If it is too short for that, it is not usable for
        gait. 0 switches this off.
    min_usable_s: Shortest segment, without the removed time, that is used for gait.
    still_mps: The target stands still in a segment if the radial speed, the mean of both ends and
        the middle, is below this.
    longest_gap_s: Longest gap in the track that a segment may span.
    """

    penalty_factor: float = Field(default=3.0, gt=0, le=1000)
    min_piece_s: float = Field(default=0.8, gt=0, le=60)
    drop_s: float = Field(default=0.25, ge=0, le=10)
    same_speed_mps: float = Field(default=0.15, ge=0, le=10)
    smooth_mps2: float = Field(default=0.45, gt=0, le=100)
    straight_level: float = Field(default=1e-3, ge=0, lt=1)
    min_usable_s: float = Field(default=2.0, ge=0, le=600)
    still_mps: float = Field(default=0.15, ge=0, le=10)
    longest_gap_s: float = Field(default=0.5, gt=0, le=60)


@dataclass(frozen=True)
class TrackSegment:
    """One segment of a range track."""

    start_s: float
    stop_s: float
    radial_velocity_mps: float
    curvature_mps2: float
    residual_m: float
    straight_probability: float = float("nan")
    reason: str = ""

    @property
    def usable(self) -> bool:
        """True if the segment is usable for gait."""
        return not self.reason


@dataclass(frozen=True)
class _Fit:
    """Parabola a + b t + c t^2 through R^2."""

    middle_s: float
    coefficients: FloatArray
    times: FloatArray
    ranges: FloatArray

    def residuals_m(self) -> FloatArray:
        t = self.times - self.middle_s
        a, b, c = self.coefficients
        return np.asarray(self.ranges - np.sqrt(np.maximum(a + b * t + c * t * t, 1e-12)))

    def straight_probability(self, range_sd_m: float) -> float:
        """Compute the probability of larger residuals for straight motion."""
        # the range of straight motion has no negative curvature
        residual_m, n_parameters = self.residuals_m(), PARABOLA
        if self.curvature_mps2() < 0:
            t = self.times - self.middle_s
            residual_m, n_parameters = self.ranges - np.polynomial.Polynomial.fit(t, self.ranges, 1)(t), LINE
        return compute_straight_probability(
            float(residual_m @ residual_m) / residual_m.size,
            range_sd_m=range_sd_m,
            duration_s=float(self.times[-1] - self.times[0]),
            way_m=float(np.ptp(self.ranges)),
            n_parameters=n_parameters,
        )

    def range_m(self, time_s: float) -> float:
        a, b, c = self.coefficients
        t = time_s - self.middle_s
        return math.sqrt(max(a + b * t + c * t * t, 1e-12))

    def velocity_mps(self, time_s: float) -> float:
        _, b, c = self.coefficients
        return float(-(b / 2.0 + c * (time_s - self.middle_s)) / self.range_m(time_s))

    def curvature_mps2(self) -> float:
        speed = self.velocity_mps(self.middle_s)
        return float((self.coefficients[2] - speed**2) / self.range_m(self.middle_s))


def find_track_segments(
    time_s: npt.ArrayLike,
    range_m: npt.ArrayLike,
    *,
    range_sd_m: float = RANGE_SD_M,
    settings: SegmentationSettings | None = None,
) -> tuple[TrackSegment, ...]:
    """Divide a track where its ground velocity changes."""
    # straight motion at constant velocity is a parabola R^2(t) at any aspect angle (E-34b)
    options = settings or SegmentationSettings()
    times, ranges = np.asarray(time_s, dtype=np.float64), np.asarray(range_m, dtype=np.float64)
    if times.ndim != 1 or times.shape != ranges.shape:
        raise AnalysisError(
            f"a range track needs as many times as ranges, in one-dimensional arrays; these have shapes {times.shape} "
            f"and {ranges.shape}"
        )
    if not (np.isfinite(times).all() and np.isfinite(ranges).all() and (np.diff(times) > 0).all()):
        raise AnalysisError("a range track needs finite ranges at finite, rising times; remove missing values")
    if ranges.size and ranges.min() <= 0:
        raise AnalysisError(f"a range track needs ranges above 0 m; the smallest of these is {ranges.min():g} m")
    if not (math.isfinite(range_sd_m) and range_sd_m > 0):
        raise AnalysisError(f"range_sd_m = {range_sd_m:g} is not allowed: it must be above 0 m")
    if times.size < 3:
        return ()
    gaps = np.flatnonzero(np.diff(times) > options.longest_gap_s)
    edges = [0, *(gaps + 1).tolist(), times.size]
    found: list[TrackSegment] = []
    for start, stop in pairwise(edges):
        if stop - start >= 3:
            penalty = options.penalty_factor * math.log(times.size)
            part_s, part_m = times[start:stop], ranges[start:stop]
            inner, _ = find_best_knots(
                part_s,
                part_m,
                range_sd_m=range_sd_m,
                smooth_mps2=options.smooth_mps2,
                penalty=penalty,
                min_segment_s=options.min_piece_s,
            )
            knots = _merge_similar([0, *inner, part_s.size - 1], part_s, part_m, options)
            knots = _split_bent(knots, part_s, part_m, range_sd_m, options)
            found += [
                _make_segment(part_s, part_m, (low, high), (number > 0, number < len(knots) - 2), range_sd_m, options)
                for number, (low, high) in enumerate(pairwise(knots))
            ]
    return tuple(found)


def _merge_similar(
    knots: list[int], times: FloatArray, ranges: FloatArray, settings: SegmentationSettings
) -> list[int]:
    """Remove knots where the velocity hardly changes. The smallest change is removed first."""
    fits = [_fit(times[low : high + 1], ranges[low : high + 1]) for low, high in pairwise(knots)]
    while len(fits) > 1:
        changes = [
            abs(left.velocity_mps(times[knot]) - right.velocity_mps(times[knot]))
            for (left, right), knot in zip(pairwise(fits), knots[1:-1], strict=True)
        ]
        least = int(np.argmin(changes))
        if changes[least] >= settings.same_speed_mps:
            break
        del knots[least + 1]
        low, high = knots[least : least + 2]
        fits[least : least + 2] = [_fit(times[low : high + 1], ranges[low : high + 1])]
    return knots


def _split_bent(
    knots: list[int], times: FloatArray, ranges: FloatArray, range_sd_m: float, settings: SegmentationSettings
) -> list[int]:
    """Divide segments until each is straight and steady."""
    low, *rest = knots
    kept, waiting = [low], rest
    while waiting:
        low, high = kept[-1], waiting[0]
        inner = np.arange(low + 1, high)
        left_s, right_s = times[inner] - times[low], times[high] - times[inner]
        places = inner[np.minimum(left_s, right_s) >= settings.min_piece_s - 1e-9]
        whole = _fit(times[low : high + 1], ranges[low : high + 1])
        if not places.size or whole.straight_probability(range_sd_m) >= settings.straight_level:
            kept.append(waiting.pop(0))
            continue
        every = math.ceil(places.size / MOST_PLACES)
        split = _find_split(times, ranges, (low, high), places[::every])
        if every > 1:
            split = _find_split(times, ranges, (low, high), places[np.abs(places - split) <= every])
        waiting.insert(0, split)
    return kept


def _find_split(times: FloatArray, ranges: FloatArray, ends: tuple[int, int], splits: npt.NDArray[np.int64]) -> int:
    """Return the sample at which two parabolas fit a segment best."""
    low, high = ends
    costs = [
        sum(
            float(np.sum(_fit(times[a : b + 1], ranges[a : b + 1]).residuals_m() ** 2))
            for a, b in ((low, split), (split, high))
        )
        for split in splits
    ]
    return int(splits[int(np.argmin(costs))])


def _make_segment(
    times: FloatArray,
    ranges: FloatArray,
    ends: tuple[int, int],
    cut: tuple[bool, bool],
    range_sd_m: float,
    settings: SegmentationSettings,
) -> TrackSegment:
    """Make one segment, trimmed at change points."""
    start_s = float(times[ends[0]] + settings.drop_s * cut[0])
    stop_s = float(times[ends[1]] - settings.drop_s * cut[1])
    if stop_s < start_s:
        start_s = stop_s = (start_s + stop_s) / 2.0
    inside = (times >= start_s - 1e-9) & (times <= stop_s + 1e-9)
    nan = float("nan")
    if inside.sum() < 3:
        return TrackSegment(start_s, stop_s, nan, nan, nan, nan, "too_short")
    fit = _fit(times[inside], ranges[inside])
    probability, reason = fit.straight_probability(range_sd_m), ""
    if stop_s - start_s < settings.min_usable_s - 1e-9:
        reason = "too_short"
    elif np.mean([abs(fit.velocity_mps(t)) for t in (start_s, fit.middle_s, stop_s)]) < settings.still_mps:
        reason = "stands_still"
    elif probability < settings.straight_level:
        reason = "not_straight"
    velocity_mps = fit.velocity_mps(fit.middle_s)
    residual_m = math.sqrt(float(np.mean(fit.residuals_m() ** 2)))
    return TrackSegment(start_s, stop_s, velocity_mps, fit.curvature_mps2(), residual_m, probability, reason)


def _fit(times: FloatArray, ranges: FloatArray) -> _Fit:
    """Fit a parabola to R^2 with weights 1 / R. The fit to three ranges is a straight line."""
    middle = (times[0] + times[-1]) / 2.0
    t = times - middle
    order = 3 if times.size > 3 else 2
    basis = np.stack([np.ones_like(t), t, t * t], axis=1)[:, :order]
    solution = np.linalg.lstsq(basis / ranges[:, None], ranges, rcond=None)[0]
    coefficients = np.zeros(3)
    coefficients[:order] = solution
    return _Fit(float(middle), coefficients, times, ranges)
