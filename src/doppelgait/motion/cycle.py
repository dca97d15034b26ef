"""Conversion of a gait clip to an endless cycle."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import MotionError
from doppelgait.motion.gait import add_gait_facts
from doppelgait.motion.motion import Motion
from doppelgait.motion.retime import Spline, fit_spline

FloatArray = npt.NDArray[np.float64]

OVERLAP_STRIDES = 0.15
"""Share of a stride over which the end of a cycle fades into its beginning."""
SEARCH = 0.12
"""Largest difference of the cycle's length from whole strides, in strides."""
GRID_PER_STRIDE, MOST_STRIDES = 60, 12
"""Number of tried seams per stride, and largest number of strides of a cycle. More strides add no visible variation."""
UNSEEN_M = 1e-3
"""Mismatch of a seam that is negligible."""
PRECISION_FRAMES = 1e-6
SLOWEST = 0.05
"""Lower limit of a point's speed, as a share of the mean speed, so that its share of a correction is smooth at rest."""


@dataclass(frozen=True)
class Seam:
    """Seam of a cycle: its place in the clip and its mismatch."""

    start: float
    lag: float
    strides: int
    position_m: float
    velocity_mps: float


_fitted: WeakKeyDictionary[Motion, tuple[Motion, Cycle, Seam]] = WeakKeyDictionary()


def fit_cycle(motion: Motion) -> tuple[Motion, Cycle, Seam]:
    """Fit an endless cycle of whole strides to a clip."""
    # the function also returns the clip with its gait facts, and the median difference of
    # neighbouring strides
    if (before := _fitted.get(motion)) is not None:
        return before
    where = motion.label
    if not np.isfinite(motion.position_m).all():
        raise MotionError(f"{where}: has gaps, so it cannot be looped; clean it first")
    known = add_gait_facts(motion)
    rate = motion.rate_hz
    period = rate / known.facts.stride_frequency_hz
    overlap = OVERLAP_STRIDES * period
    if not math.isfinite(period):
        raise MotionError(
            f"{where}: shows no gait cycle, so it cannot be looped over whole strides; give a part in which the body "
            "walks, or state the cycle: motion.with_facts(stride_frequency_hz=...)"
        )
    if motion.n_frames - 1 < period + overlap + 1:
        raise MotionError(
            f"{where}: lasts {(motion.n_frames - 1) / rate:.3g} s, but one stride takes {period / rate:.3g} s; a "
            f"loop needs {(period + overlap + 1) / rate:.3g} s or more"
        )
    seam, usual = _find_best_seam(motion, period, overlap)
    fitted = known, _close_cycle(motion, seam, overlap), usual
    if not motion.position_m.flags.writeable:  # a clip that many examples of a dataset share
        _fitted[motion] = fitted
    return fitted


def _find_best_seam(motion: Motion, period: float, overlap: float) -> tuple[Seam, Seam]:
    """Find the best seam, and the median seam after one stride."""
    # the best seam has the largest number of strides with a mismatch no larger than that of the
    # median seam
    curve, rate = fit_spline(motion), motion.rate_hz
    step = max(1, round(period / GRID_PER_STRIDE))
    position = np.asarray(motion.position_m[::step], dtype=np.float64)
    velocity = np.gradient(position, step / rate, axis=0)
    stride, width = period / step, max(2, math.ceil(overlap / step) + 1)
    weight_s = period / rate / (2 * math.pi)
    # median mismatch of seams after one stride
    frames = np.arange(0.0, motion.positions.shape[0] - 1 - period, step)
    before, after = (curve.at(at / rate) for at in (frames, frames + period))
    stride_moved, stride_change = (
        b.reshape(frames.size, *motion.positions.shape[1:]) - a.reshape(frames.size, *motion.positions.shape[1:])
        for a, b in zip(before, after, strict=True)
    )
    stride_m, stride_mps = _measure_mismatch(stride_moved, stride_change, min(width, frames.size))
    usual = Seam(0.0, period, 1, float(np.median(stride_m)), float(np.median(stride_mps)))
    best: list[Seam] = []
    for strides in range(1, min(MOST_STRIDES, max(1, int((len(position) - width) // stride))) + 1):
        lags = range(math.ceil((strides - SEARCH) * stride), math.floor((strides + SEARCH) * stride) + 1)
        seams = []
        for lag in (n for n in lags if n + width <= len(position)):
            until = len(position) - lag
            moved, change = position[lag:] - position[:until], velocity[lag:] - velocity[:until]
            apart_m, apart_mps = _measure_mismatch(moved, change, width)
            n = int(np.argmin(np.hypot(apart_m, weight_s * apart_mps)))
            seams.append(Seam(float(n), float(lag), strides, float(apart_m[n]), float(apart_mps[n])))
        if seams:
            cut = min(seams, key=lambda seam: _combine_mismatch(seam, weight_s))
            on_frames = replace(cut, start=cut.start * step, lag=cut.lag * step)
            best.append(_refine_seam(curve, motion.positions.shape, rate, on_frames, step, overlap, weight_s))
    # neither pose nor velocity may differ by more than the median between neighbouring strides
    most_m, most_mps = max(usual.position_m, UNSEEN_M), max(usual.velocity_mps, UNSEEN_M / weight_s)
    fitting = [seam for seam in best if seam.position_m <= most_m and seam.velocity_mps <= most_mps]
    if fitting:
        return max(fitting, key=lambda seam: seam.strides), usual
    return min(best, key=lambda seam: _combine_mismatch(seam, weight_s)), usual


def _combine_mismatch(seam: Seam, weight_s: float) -> float:
    """Combine position and velocity mismatch in m."""
    # a velocity has the weight of the position amplitude of a swing at the stride rate
    return math.hypot(seam.position_m, weight_s * seam.velocity_mps)


def _measure_mismatch(moved: FloatArray, change: FloatArray, width: int) -> tuple[FloatArray, FloatArray]:
    """Return rms mismatches of position and velocity per first frame."""
    # the mean is over points and width frames, of displacements without the ground advance and of
    # velocity changes
    moved[..., :2] -= moved[..., :2].mean(axis=(0, 1))
    advance = _average_running(moved[..., :2].mean(axis=1), width)
    squared = _average_running((moved**2).sum(axis=2).mean(axis=1), width) - (advance**2).sum(axis=1)
    return np.sqrt(np.maximum(squared, 0.0)), np.sqrt(_average_running((change**2).sum(axis=2).mean(axis=1), width))


def _average_running(values: FloatArray, width: int) -> FloatArray:
    return np.asarray(np.lib.stride_tricks.sliding_window_view(values, width, axis=0).mean(axis=-1))


def _refine_seam(
    curve: Spline, shape: tuple[int, ...], rate_hz: float, seam: Seam, step: int, overlap: float, weight_s: float
) -> Seam:
    """Refine the length of a cycle to a fraction of a frame."""
    from scipy.optimize import minimize_scalar

    frames = seam.start + np.linspace(0.0, overlap, max(3, math.ceil(overlap)))
    before = [values.reshape(-1, *shape[1:]) for values in curve.at(frames / rate_hz)]

    def at(lag: float) -> Seam:
        after = [values.reshape(-1, *shape[1:]) for values in curve.at((frames + lag) / rate_hz)]
        moved = after[0] - before[0]
        moved[..., :2] -= moved[..., :2].mean(axis=(0, 1))
        change = after[1] - before[1]
        apart = [float(np.sqrt((values**2).sum(axis=2).mean())) for values in (moved, change)]
        return replace(seam, lag=lag, position_m=apart[0], velocity_mps=apart[1])

    latest = shape[0] - 1 - float(frames[-1])
    bounds = (seam.lag - step, min(seam.lag + step, latest))
    found = minimize_scalar(
        lambda lag: _combine_mismatch(at(float(lag)), weight_s),
        bounds=bounds,
        method="bounded",
        options={"xatol": PRECISION_FRAMES},
    )
    return min(at(float(found.x)), at(min(seam.lag, latest)), key=lambda cut: _combine_mismatch(cut, weight_s))


@dataclass(frozen=True)
class Cycle:
    """Endless cycle of a clip. Times are in frames."""

    curve: Spline
    shape: tuple[int, ...]
    rate_hz: float
    seam: Seam
    overlap: float
    advance: FloatArray
    astray: FloatArray
    faster: FloatArray
    travel: Spline

    def at(self, total: FloatArray, points: list[int] | None = None) -> FloatArray:
        """Return positions at times in frames, shape (I, P, 3)."""
        # by default, all points are returned
        chosen = list(range(self.shape[1])) if points is None else points
        numbers = np.array(chosen)
        curve = _select_columns(self.curve, np.add.outer(3 * numbers, np.arange(3)).ravel())
        lag, turns = self.seam.lag, np.floor(total / self.seam.lag)
        into = total - turns * lag
        travel = _select_columns(self.travel, np.concatenate([numbers, self.shape[1] + numbers]))
        astray = self.astray[chosen]

        def once(frames: FloatArray) -> FloatArray:
            share, gained = np.moveaxis(travel.at(frames)[0].reshape(frames.size, 2, len(chosen), 1), 1, 0)
            within = np.clip(self.seam.start + frames, 0.0, self.shape[0] - 1.0)
            value = curve.at(within / self.rate_hz)[0].reshape(frames.size, len(chosen), 3)
            return np.asarray(value - astray * share - self.faster * gained)

        position = once(into) + self.advance * turns[:, np.newaxis, np.newaxis]
        fading = into < self.overlap
        share = into[fading] / self.overlap
        # no slope and no curvature at either end
        weight = (share**3 * (10.0 - 15.0 * share + 6.0 * share**2))[:, np.newaxis, np.newaxis]
        follows = once(lag + into[fading]) + self.advance * (turns[fading] - 1.0)[:, np.newaxis, np.newaxis]
        position[fading] = weight * position[fading] + (1.0 - weight) * follows
        return np.asarray(position)

    def count_strides(self, total: FloatArray, points: list[int]) -> FloatArray:
        """Count strides since time 0, shape (I, P)."""
        # the counts of the points differ only slightly
        turns = np.floor(total / self.seam.lag)
        travel = _select_columns(self.travel, np.array(points))
        share = travel.at(total - turns * self.seam.lag)[0] + 0.5
        return np.asarray((turns[:, np.newaxis] + share) * self.seam.strides)


def _select_columns(curve: Spline, columns: npt.NDArray[np.int64]) -> Spline:
    values, moments = (np.ascontiguousarray(part[:, columns]) for part in (curve.values, curve.moments))
    return Spline(values, moments, curve.step_s)


def _close_cycle(motion: Motion, seam: Seam, overlap: float) -> Cycle:
    """Return the endless cycle of a clip with a seam."""
    from doppelgait.core.kernels.spline import spline_moments

    rate, curve = motion.rate_hz, fit_spline(motion)
    ends = seam.start + np.linspace(0.0, overlap, max(3, math.ceil(overlap)))

    def clip(frames: FloatArray) -> list[FloatArray]:
        found = curve.at(np.clip(frames, 0.0, motion.n_frames - 1.0) / rate)
        return [part.reshape(frames.size, *motion.positions.shape[1:]) for part in found]

    later, earlier = clip(ends + seam.lag), clip(ends)
    moved = (later[0] - earlier[0]).mean(axis=0)
    advance = moved.mean(axis=0) * (1.0, 1.0, 0.0)
    # the closing error of a point and the body's gain of speed are removed along the whole cycle (within the overlap
    # alone they would cause a jerk), in proportion to the speed of the point: a foot on the ground stays
    faster = (later[1] - earlier[1]).mean(axis=(0, 1)) / rate * (1.0, 1.0, 0.0)
    lasts = seam.lag + overlap + 1.0
    grid = np.linspace(0.0, lasts, max(64, math.ceil(lasts)))
    step = float(grid[1])
    speed = np.linalg.norm(clip(seam.start + grid)[1][..., :2], axis=2)
    speed = np.hypot(speed, SLOWEST * speed.mean())

    def integrate(values: FloatArray) -> FloatArray:
        sums = np.cumsum((values[1:] + values[:-1]) / 2.0 * step, axis=0)
        return np.concatenate([np.zeros((1, values.shape[1])), sums])

    def at_end(values: FloatArray) -> FloatArray:
        return np.array([np.interp(seam.lag, grid, column) for column in values.T])

    path = integrate(speed)
    whole = at_end(path)
    share = path / whole
    gained = integrate((grid / seam.lag - 0.5)[:, np.newaxis] * speed * seam.lag / whole)
    gained -= at_end(gained) * share
    within = grid < seam.lag
    values = np.concatenate([share - share[within].mean(axis=0), gained], axis=1)
    moments = np.empty_like(values)
    spline_moments(values, step, moments)
    travel = Spline(values, moments, step)
    return Cycle(curve, motion.positions.shape, rate, seam, overlap, advance, moved - advance, faster, travel)
