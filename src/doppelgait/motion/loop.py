"""Longer motions from a short clip, without a visible seam.

A clip becomes an endless cycle of whole strides. Successive strides vary about the recorded ones.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from doppelgait._core import native
from doppelgait.core.errors import MotionError, warn_caller
from doppelgait.core.rng import RandomSource, Streams, as_generator
from doppelgait.core.units import FloatArray
from doppelgait.motion.gait import add_gait_facts, find_feet, find_steps, is_quadruped
from doppelgait.motion.models.curves import load_tables
from doppelgait.motion.models.strides import fit_cubic_spline, sample_autoregressive
from doppelgait.motion.motion import Motion, MotionFacts, require_motion
from doppelgait.motion.retime import Spline, fit_spline, travel_speed_mps
from doppelgait.motion.skeleton import BODY_CENTRE_PARTS, find_rigid_pairs, measure_pair_lengths, restore_lengths

OVERLAP_STRIDES = 0.15
"""Share of a stride over which the end of a cycle fades into its beginning."""
SEARCH = 0.12
"""Largest difference of the cycle's length from whole strides, in strides."""
GRID_PER_STRIDE, MOST_STRIDES = 60, 12
"""Number of tried seams per stride, and of strides of a cycle; more add no visible variation."""
UNSEEN_M = 1e-3
"""Mismatch of a seam that is negligible."""
PRECISION_FRAMES = 1e-6
SLOWEST = 0.05
"""Lower limit of a point's share of the mean speed: its share of a correction is smooth at rest."""


@dataclass(frozen=True)
class Seam:
    """Seam of a cycle: its place in the clip and its mismatch."""

    start: float
    lag: float
    strides: int
    position_m: float
    velocity_mps: float


_known: WeakKeyDictionary[Motion, Motion] = WeakKeyDictionary()
_fitted: WeakKeyDictionary[Motion, tuple[Motion, Cycle, Seam]] = WeakKeyDictionary()
"""Gait facts and cycles of clips that cannot change: many examples of a dataset share a clip."""


def require_gait(motion: Motion, change: str) -> Motion:
    """Return a motion without gaps with its gait facts."""
    if (before := _known.get(motion)) is not None:
        return before
    if not np.isfinite(motion.position_m).all():
        raise MotionError(f"{motion.label}: has gaps, so it cannot be {change}; clean it first")
    known = add_gait_facts(motion)
    if not motion.position_m.flags.writeable:
        _known[motion] = known
    return known


def fit_cycle(motion: Motion) -> tuple[Motion, Cycle, Seam]:
    """Fit an endless cycle of whole strides to a clip."""
    # with the clip's gait facts, and the median difference of neighbouring strides
    if (before := _fitted.get(motion)) is not None:
        return before
    where = motion.label
    known, rate = require_gait(motion, "looped"), motion.rate_hz
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
    if not motion.position_m.flags.writeable:
        _fitted[motion] = fitted
    return fitted


def _find_best_seam(motion: Motion, period: float, overlap: float) -> tuple[Seam, Seam]:
    """Find the best seam, and the median seam after one stride."""
    curve, rate = fit_spline(motion), motion.rate_hz
    step = max(1, round(period / GRID_PER_STRIDE))
    position = np.asarray(motion.position_m[::step], dtype=np.float64)
    velocity = np.gradient(position, step / rate, axis=0)
    stride, width = period / step, max(2, math.ceil(overlap / step) + 1)
    weight_s = period / rate / (2 * math.pi)
    # median mismatch of seams after one stride
    frames = np.arange(0.0, motion.position_m.shape[0] - 1 - period, step)
    before, after = (curve.points(at / rate) for at in (frames, frames + period))
    stride_moved, stride_change = (b - a for a, b in zip(before, after, strict=True))
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
            best.append(_refine_seam(curve, motion, on_frames, step, overlap, weight_s))
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
    # over points and width frames, of displacements without the advance and of velocity changes
    moved[..., :2] -= moved[..., :2].mean(axis=(0, 1))
    advance = _average_running(moved[..., :2].mean(axis=1), width)
    squared = _average_running((moved**2).sum(axis=2).mean(axis=1), width) - (advance**2).sum(axis=1)
    return np.sqrt(np.maximum(squared, 0.0)), np.sqrt(_average_running((change**2).sum(axis=2).mean(axis=1), width))


def _average_running(values: FloatArray, width: int) -> FloatArray:
    return np.asarray(np.lib.stride_tricks.sliding_window_view(values, width, axis=0).mean(axis=-1))


def _refine_seam(curve: Spline, motion: Motion, seam: Seam, step: int, overlap: float, weight_s: float) -> Seam:
    """Refine the length of a cycle to a fraction of a frame."""
    from scipy.optimize import minimize_scalar

    frames = seam.start + np.linspace(0.0, overlap, max(3, math.ceil(overlap)))
    before = curve.points(frames / motion.rate_hz)

    def at(lag: float) -> Seam:
        after = curve.points((frames + lag) / motion.rate_hz)
        moved = after[0] - before[0]
        moved[..., :2] -= moved[..., :2].mean(axis=(0, 1))
        change = after[1] - before[1]
        apart = [float(np.sqrt((values**2).sum(axis=2).mean())) for values in (moved, change)]
        return replace(seam, lag=lag, position_m=apart[0], velocity_mps=apart[1])

    latest = motion.n_frames - 1 - float(frames[-1])
    bounds = (seam.lag - step, min(seam.lag + step, latest))
    found = minimize_scalar(
        lambda lag: _combine_mismatch(at(float(lag)), weight_s), bounds=bounds, options={"xatol": PRECISION_FRAMES}
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
        """Return positions at times in frames, shape (I, P, 3), by default of all points."""
        numbers = np.arange(self.shape[1]) if points is None else np.array(points)
        curve = _select_columns(self.curve, np.add.outer(3 * numbers, np.arange(3)).ravel())
        lag, turns = self.seam.lag, np.floor(total / self.seam.lag)
        into = total - turns * lag
        travel = _select_columns(self.travel, np.concatenate([numbers, self.shape[1] + numbers]))
        astray = self.astray[numbers]

        def once(frames: FloatArray) -> FloatArray:
            share, gained = np.moveaxis(travel.at(frames)[0].reshape(frames.size, 2, numbers.size, 1), 1, 0)
            within = np.clip(self.seam.start + frames, 0.0, self.shape[0] - 1.0)
            value = curve.points(within / self.rate_hz)[0]
            return np.asarray(value - astray * share - self.faster * gained)

        position = once(into) + self.advance * turns[:, np.newaxis, np.newaxis]
        fading = into < self.overlap
        share = into[fading] / self.overlap
        # no slope and no curvature at either end
        weight = (share**2 * share * (10.0 - 15.0 * share + 6.0 * share**2))[:, np.newaxis, np.newaxis]
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
    rate, curve = motion.rate_hz, fit_spline(motion)
    ends = seam.start + np.linspace(0.0, overlap, max(3, math.ceil(overlap)))

    def clip(frames: FloatArray) -> tuple[FloatArray, FloatArray]:
        return curve.points(np.clip(frames, 0.0, motion.n_frames - 1.0) / rate)

    later, earlier = clip(ends + seam.lag), clip(ends)
    moved = (later[0] - earlier[0]).mean(axis=0)
    advance = moved.mean(axis=0) * (1.0, 1.0, 0.0)
    # closing errors of points and the body's gain of speed are removed along the whole cycle (in
    # the overlap alone they would jerk), in proportion to the point's speed: a standing foot stays
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
    moments = np.empty(values.shape)
    native.spline_moments(values, step, moments)
    travel = Spline(values, moments, step)
    return Cycle(curve, motion.position_m.shape, rate, seam, overlap, advance, moved - advance, faster, travel)


FEW_STRIDES = 2.0
"""Minimum number of strides of a clip that shows their variation."""
POSES_PER_STRIDE = 2
"""Number of random deviations of the pose per stride."""
SHARE_OF_SWING = 2.0
"""Maximum factor on a swing; the minimum is 0."""
FOOT_WEIGHT = 100.0
"""Weight of a point of a foot relative to others when the lengths of a body are restored."""
RIDGE, STEPS = 2.0, 3
"""Ridge and steps of the restoration of lengths, soft: feet may deviate beyond a leg's reach."""
KNOT_MARGIN = 3
"""Strides before the first and after the last frame: the splines' ends have no effect."""


def loop(motion: Motion, *, duration_s: float, variation: float = 1.0, rng: RandomSource | None = None) -> Motion:
    """Lengthen a clip of straight gait over whole strides.

    The seam is the frame in which pose and velocity after n strides are closest to those before,
    with the largest n for which neither differs by more than the median of neighbouring strides. It
    is continuous up to the acceleration, and the mean speed is that of the clip. Strides vary as in
    recordings of people or dogs; feet on the ground stay in place, and lengths are restored.

    Parameters
    ----------
    motion : Motion
        Motion without gaps: one segment at constant velocity, 1.2 strides or longer.
    duration_s : float
        Duration of the result, above 0; the last frame is at or just after it.
    variation : float
        Factor on the spreads, 0 to 2; with 0, all cycles are equal.
    rng : Streams or numpy.random.Generator, optional
        Source of the variation; by default derived from source, subject and start time of the clip.

    Returns
    -------
    Motion
        The same points, frame rate and facts, from time 0. ``stride_frequency_hz`` is exactly the
        mean over the duration. Footfalls are repeated. ``report["loop"]`` holds seam, residuals,
        variation and the correction of the stride length.

    Raises
    ------
    MotionError
        If the motion has gaps, no known gait cycle, or is shorter than 1.2 strides.

    Warns
    -----
    DoppelgaitWarning
        If the clip has fewer than two strides.

    Examples
    --------
    >>> import doppelgait as dg
    >>> motion = dg.motion.boulic_walk(speed_mps=1.2, duration_s=4.0)
    >>> round(dg.motion.loop(motion, duration_s=10.0, variation=0.0).duration_s, 1)
    10.0
    """
    where = require_motion(motion).label
    if not (math.isfinite(duration_s) and duration_s > 0):
        raise MotionError(f"duration_s: {duration_s!r} is not allowed: must be a number above 0 s")
    if not 0.0 <= variation <= 2.0:
        raise MotionError(f"variation: {variation!r} is not allowed: must be a number from 0 to 2")
    known, cycle, usual = fit_cycle(motion)
    seam, rate = cycle.seam, motion.rate_hz
    period = rate / known.facts.stride_frequency_hz
    count = math.ceil(duration_s * rate - 1e-9) + 1
    clip = f"loop {known.facts.source} {known.facts.subject} {known.facts.file_time_s:.3f}"
    source = Streams(0).generator("motion", clip) if rng is None else as_generator(rng, "motion")
    spread = load_tables()["variation"]["quadruped" if is_quadruped(known) else "person"]
    share = variation / math.sqrt(seam.strides)
    cycle_mps = float(np.hypot(*cycle.advance[:2])) / seam.lag * rate
    # the mean speed of the clip, from the ratio of its travel to that of the cycle
    ends = np.array([0.0, motion.n_frames - 1.0])
    central = [n for n, part in enumerate(known.parts) if part in BODY_CENTRE_PARTS] or list(range(cycle.shape[1]))
    clip_m, repeated_m = known.position_m[ends.astype(int)][:, central], cycle.at(ends - seam.start, central)
    gone, would = (float((values[1] - values[0]).mean(axis=0) @ cycle.advance) for values in (clip_m, repeated_m))
    speed_mps = cycle_mps * (gone / would if gone > 0 and would > 0 else 1.0)
    position, clocks, length_factor = _vary(cycle, known, count, speed_mps, spread, share, source)
    if share:  # limbs vary independently, which would separate them from their joints
        pairs = find_rigid_pairs(np.asarray(motion.position_m, dtype=np.float64))
        wanted_m = measure_pair_lengths(cycle.at(clocks[""]), pairs)
        position = restore_lengths(position, pairs, wanted_m, weigh_feet(motion), ridge=RIDGE, steps=STEPS)
    stride_hz = seam.strides * rate / seam.lag
    has_strides = (motion.n_frames - 1) / period
    if has_strides < FEW_STRIDES:
        varied = f"their times vary by {100 * share * spread['time']:.2g} %, as in recordings"
        warn_caller(
            f"{where}: has {has_strides:.2g} strides, fewer than {FEW_STRIDES:g}: the strides of the loop repeat one "
            f"recorded stride ({varied if share else 'all are the same'}); take a longer part of the recording"
        )
    facts = known.facts.with_frequencies(lambda hz: hz / known.facts.stride_frequency_hz * stride_hz)
    looped = known.remake(position, facts).with_report(
        loop={
            "from_s": seam.start / rate,
            "to_s": (seam.start + seam.lag) / rate,
            "strides": seam.strides,
            "clip_strides": has_strides,
            "seam_position_m": seam.position_m,
            "seam_velocity_mps": seam.velocity_mps,
            "usual_position_m": usual.position_m,
            "usual_velocity_mps": usual.velocity_mps,
            "clip_speed_mps": travel_speed_mps(known),
            "cycle_speed_mps": cycle_mps,
            "speed_mps": speed_mps,
            "stride_length_factor": length_factor,
            "stride_time_sd": share * spread["time"],
            "stride_length_sd": share * spread["length"],
        },
    )
    # touchdowns in s after a cycle's start: the stated ones, or those of the middle of three cycles
    every_s, until_s = seam.lag / rate, (count - 1) / rate
    if motion.facts.footfalls:
        begins_s = float(motion.time_s[0]) + seam.start / rate
        times = {foot: np.array(stated) - begins_s for foot, stated in motion.facts.footfalls.items()}
    else:
        position = cycle.at(np.arange(math.ceil(3 * seam.lag) + 1.0))
        three = motion.remake(position, MotionFacts(species=facts.species))
        times = {foot: step.touchdown_s - every_s for foot, step in find_steps(three).items()}
    turns, half_s = range(-1, math.floor(until_s / every_s) + 2), every_s / seam.strides / 2
    footfalls = {}
    for foot, landed_s in times.items():
        once = [float(t) for t in landed_s if 0.0 <= t < every_s - 1e-9]
        # a landing at the seam is at both ends of a cycle that is a little longer than its strides
        once = [t for t in once if t < once[0] + every_s - half_s]
        clock_s = clocks.get(_find_limb(foot), clocks[""]) / rate
        due_s = np.array([t + turn * every_s for turn in turns for t in once])
        due_s = due_s[(due_s >= clock_s[0] - 1e-12) & (due_s <= clock_s[-1] + 1e-12)]
        footfalls[foot] = [float(t) for t in np.interp(due_s, clock_s, np.arange(count) / rate)]
    return looped.with_facts(footfalls=footfalls)


def weigh_feet(motion: Motion) -> FloatArray:
    """Return large weights for feet, for :func:`~doppelgait.motion.skeleton.restore_lengths`."""
    weights = np.ones(len(motion.markers))
    for points in find_feet(motion).values():
        weights[points] = FOOT_WEIGHT
    return weights


def _find_limb(part: str) -> str:
    """Return the limb (with head and tail) of a body part or foot, ``""`` for others."""
    side, _, rest = part.partition("_")
    if side not in ("left", "right"):
        return {"neck": "head", "head": "head", "tail": "tail"}.get(part, "")
    end = rest.partition("_")[0]
    if end in ("fore", "hind"):
        return f"{side}_{end}"
    return f"{side}_{'leg' if end in ('foot', 'shank', 'thigh') else 'arm'}"


def _vary(
    cycle: Cycle,
    motion: Motion,
    count: int,
    speed_mps: float,
    spread: Mapping[str, Any],
    share: float,
    rng: np.random.Generator,
) -> tuple[FloatArray, dict[str, FloatArray], float]:
    seam = cycle.seam
    stride = seam.lag / seam.strides
    frames = np.arange(count, dtype=np.float64)
    strides = math.ceil((count - 1) / stride * 1.5) + 2 * KNOT_MARGIN + 2
    number = np.arange(strides) - KNOT_MARGIN
    shorter = sample_autoregressive(strides, rng)
    # time of the cycle as a function of that of the motion; their totals are equal
    starts = np.cumsum(stride * (1.0 + share * spread["time"] * shorter))
    starts -= starts[KNOT_MARGIN]
    clock = fit_cubic_spline(starts, number * stride)
    ends = float(clock.where(float(count - 1))) if share else float(count - 1)
    body = clock(frames * (ends / (count - 1)))

    def series(sd: float, values: FloatArray | None = None) -> FloatArray:
        deviations = sample_autoregressive(strides, rng) if values is None else values
        return np.asarray(fit_cubic_spline(number * stride, share * sd * deviations)(body))

    common = spread["length_with_time"]
    longer = common * shorter + math.sqrt(1.0 - common**2) * sample_autoregressive(strides, rng)
    length = 1.0 + series(spread["length"], longer)
    # speed: the stride length corrects the speed of the cycle
    per_frame = cycle.advance / seam.lag
    way = np.concatenate([[0.0], np.cumsum((length[1:] + length[:-1]) / 2.0 * np.diff(body))])
    cycle_m, clip_m = float(np.hypot(*per_frame[:2])) * way[-1], speed_mps * (count - 1) / cycle.rate_hz
    length_factor = float(clip_m / cycle_m) if cycle_m > 0 else 1.0
    ahead = per_frame / np.hypot(*per_frame[:2]) if cycle_m > 0 else np.zeros(3)
    # mean position of each point, about which it swings
    grid = np.linspace(0.0, seam.lag, max(64, math.ceil(seam.lag)), endpoint=False)
    limbs: dict[str, list[int]] = {}
    for point, part in enumerate(motion.parts):
        limbs.setdefault(_find_limb(part), []).append(point)
    aside = np.array([-ahead[1], ahead[0], 0.0])
    stride_m = length_factor * float(np.hypot(*per_frame[:2])) * stride
    poses = POSES_PER_STRIDE * strides
    knots = np.arange(poses) / POSES_PER_STRIDE - KNOT_MARGIN
    position, clocks = np.empty((count, *cycle.shape[1:])), {"": body}
    for limb in sorted(limbs):
        points = limbs[limb]
        lead = stride * series(spread["limb_phase"]) if limb else np.zeros(count)
        kind = limb.rpartition("_")[2] or "trunk"
        # points without a part may be feet: their swing scales with the stride length only
        known = np.array([bool(motion.parts[point]) for point in points])[np.newaxis, :, np.newaxis]
        own = np.clip(1.0 + series(spread["swing"].get(kind, 0.0)), 0.0, SHARE_OF_SWING)[:, np.newaxis, np.newaxis]
        at = clocks[limb] = body + lead
        middle = (cycle.at(grid, points) - np.multiply.outer(grid, per_frame)[:, np.newaxis]).mean(axis=0)
        swing = cycle.at(at, points) - np.multiply.outer(at, per_frame)[:, np.newaxis] - middle
        swing = np.where(known, own, 1.0) * swing
        forward = (swing @ ahead)[..., np.newaxis] * ahead
        moved = middle + swing + (length_factor * length[:, np.newaxis, np.newaxis] - 1.0) * forward
        sds = spread["pose"].get("leg" if kind in ("fore", "hind") else kind, (0.0, 0.0, 0.0))
        # counted along the travel of each point, so that a foot on the ground stays in place
        step = cycle.count_strides(at, points)
        for sd, direction in zip(sds, (ahead, aside, np.array([0.0, 0.0, 1.0])), strict=True):
            pose = fit_cubic_spline(knots, share * sd * stride_m * sample_autoregressive(poses, rng))(step)
            moved += np.where(known, pose[..., np.newaxis], 0.0) * direction
        position[:, points] = moved + length_factor * np.multiply.outer(way, per_frame)[:, np.newaxis]
    return position, clocks, length_factor
