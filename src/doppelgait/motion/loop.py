"""A short clip of a gait repeated over whole strides, without a seam in position or velocity."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import MotionError
from doppelgait.motion.gait import find_steps, with_gait_facts
from doppelgait.motion.motion import Motion, make_motion, require_motion
from doppelgait.motion.retime import Spline, fit_spline, travel_speed_mps

FloatArray = npt.NDArray[np.float64]

OVERLAP_STRIDES = 0.15
"""The end of a cycle fades into its beginning over this part of a stride."""
SEARCH = 0.12
"""The cycle may be longer or shorter than whole strides by this part of one."""
GRID_PER_STRIDE, MOST_STRIDES = 60, 12
"""Cuts are tried at this spacing, for cycles of up to so many strides: they hold all the variation that shows."""
UNSEEN_M = 1e-3
"""A seam below a millimetre is as good as none."""
PRECISION_FRAMES = 1e-6


@dataclass(frozen=True)
class Seam:
    """Where a clip is cut, and how well its ends fit.

    Parameters
    ----------
    start : float
        First frame of the cycle.
    lag : float
        Length of the cycle in frames.
    strides : int
        Whole strides in it.
    position_m, velocity_mps : float
        Root mean square over points and overlap of what is left between the two cuts once the advance is taken off.
    """

    start: float
    lag: float
    strides: int
    position_m: float
    velocity_mps: float


def loop(motion: Motion, *, duration_s: float) -> Motion:
    """Repeat a clip of straight gait over whole strides for as long as asked.

    The clip is cut where pose and velocity after n strides are nearest to those before, n as large as it can be with
    neither differing more than is usual (the median) between neighbouring strides. With cycle time L and advance D
    (the mean displacement of all points over one cycle, in the ground plane) the motion is
    x(t) = q(t mod L) + D t / L, where q is the clip without its advance. At the start of each cycle q fades from what
    follows the last cycle into the first one, with a weight that has no slope or curvature at its ends: position,
    velocity and acceleration go on through the seam, and every cycle is the same. What a point does not come back by,
    and what the body gains in speed, are taken off evenly along the cycle before.

    Parameters
    ----------
    motion : Motion
        Motion (time, marker, space) in m, z up, no gaps: one segment at constant velocity, at least 1.2 strides long.
    duration_s : float
        Time to cover, above 0; the last frame is at or just after it.

    Returns
    -------
    Motion
        Motion with the same points, frame rate and facts, from time 0. ``stride_frequency_hz`` is that of the cycle,
        exactly; footfalls are repeated; ``report["loop"]`` holds the cut and its residuals beside the median
        difference of neighbouring strides.

    Raises
    ------
    MotionError
        If the motion has gaps, no known gait cycle, or is shorter than 1.2 strides.
    """
    require_motion(motion)
    where = motion.label
    if not (math.isfinite(duration_s) and duration_s > 0):
        raise MotionError(f"duration_s: {duration_s!r} is not allowed: must be a number above 0 s")
    if not np.isfinite(motion.position_m).all():
        raise MotionError(f"{where}: has gaps, so it cannot be looped; clean it first")
    known = with_gait_facts(motion)
    rate = motion.rate_hz
    period = rate / known.facts.stride_frequency_hz
    overlap = OVERLAP_STRIDES * period
    if not math.isfinite(period):
        raise MotionError(
            f"{where}: shows no gait cycle, so it cannot be looped over whole strides; give a part in which the body "
            "walks, or state it: motion.with_facts(stride_frequency_hz=...)"
        )
    if motion.n_frames - 1 < period + overlap + 1:
        raise MotionError(
            f"{where}: lasts {(motion.n_frames - 1) / rate:.3g} s, but one stride takes {period / rate:.3g} s; a "
            f"loop needs {(period + overlap + 1) / rate:.3g} s or more"
        )
    seam, usual = _best_seam(motion, period, overlap)
    position = _repeat(motion, seam, overlap, math.ceil(duration_s * rate - 1e-9) + 1)
    stride_hz = seam.strides * rate / seam.lag
    facts = known.facts.with_frequencies(lambda hz: hz / known.facts.stride_frequency_hz * stride_hz)
    looped = make_motion(position, rate_hz=rate, markers=motion.markers, parts=motion.parts, facts=facts).with_report(
        **known.report,
        loop={
            "from_s": seam.start / rate,
            "to_s": (seam.start + seam.lag) / rate,
            "strides": seam.strides,
            "seam_position_m": seam.position_m,
            "seam_velocity_mps": seam.velocity_mps,
            "usual_position_m": usual.position_m,
            "usual_velocity_mps": usual.velocity_mps,
            "clip_speed_mps": travel_speed_mps(known),
        },
    )
    touchdowns = _cycle_touchdowns(motion, looped, seam, overlap)
    every_s, until_s = seam.lag / rate, (len(position) - 1) / rate
    turns = range(math.floor(until_s / every_s) + 1)
    footfalls = {
        foot: [t + turn * every_s for turn in turns for t in once if t + turn * every_s <= until_s]
        for foot, once in touchdowns.items()
    }
    return looped.with_facts(footfalls=footfalls)


def _best_seam(motion: Motion, period: float, overlap: float) -> tuple[Seam, Seam]:
    """The cut with the most strides that is no worse than usual, and the median seam after one stride.

    Cuts are tried on a grid of a sixtieth of a stride; the length of the best one is then refined between frames.
    """
    curve, rate = fit_spline(motion), motion.rate_hz
    step = max(1, round(period / GRID_PER_STRIDE))
    position = np.asarray(motion.position_m[::step], dtype=np.float64)
    velocity = np.gradient(position, step / rate, axis=0)
    stride, width = period / step, max(2, math.ceil(overlap / step) + 1)
    weight_s = period / rate / (2 * math.pi)
    usual = _median_seam(curve, motion.positions.shape, rate, period, step, width)
    best: list[Seam] = []
    for strides in range(1, min(MOST_STRIDES, max(1, int((len(position) - width) // stride))) + 1):
        lags = range(math.ceil((strides - SEARCH) * stride), math.floor((strides + SEARCH) * stride) + 1)
        seams = []
        for lag in (n for n in lags if n + width <= len(position)):
            until = len(position) - lag
            moved, change = position[lag:] - position[:until], velocity[lag:] - velocity[:until]
            apart_m, apart_mps = _apart(moved, change, width)
            n = int(np.argmin(np.hypot(apart_m, weight_s * apart_mps)))
            seams.append(Seam(float(n), float(lag), strides, float(apart_m[n]), float(apart_mps[n])))
        if seams:
            cut = min(seams, key=lambda seam: _cost(seam, weight_s))
            on_frames = replace(cut, start=cut.start * step, lag=cut.lag * step)
            best.append(_between_frames(curve, motion.positions.shape, rate, on_frames, step, overlap, weight_s))
    # neither pose nor velocity may differ more than is usual between neighbouring strides
    most_m, most_mps = max(usual.position_m, UNSEEN_M), max(usual.velocity_mps, UNSEEN_M / weight_s)
    fitting = [seam for seam in best if seam.position_m <= most_m and seam.velocity_mps <= most_mps]
    if fitting:
        return max(fitting, key=lambda seam: seam.strides), usual
    return min(best, key=lambda seam: _cost(seam, weight_s)), usual


def _cost(seam: Seam, weight_s: float) -> float:
    """Residual of position and velocity in m: a velocity weighs like the position of a swing at the stride rate."""
    return math.hypot(seam.position_m, weight_s * seam.velocity_mps)


def _median_seam(curve: Spline, shape: tuple[int, ...], rate_hz: float, period: float, step: int, width: int) -> Seam:
    """What is usual between neighbouring strides: the median over all cuts one stride apart."""
    frames = np.arange(0.0, shape[0] - 1 - period, step)
    before, after = (curve.at(at / rate_hz) for at in (frames, frames + period))
    moved, change = (
        b.reshape(frames.size, *shape[1:]) - a.reshape(frames.size, *shape[1:])
        for a, b in zip(before, after, strict=True)
    )
    apart_m, apart_mps = _apart(moved, change, min(width, frames.size))
    return Seam(0.0, period, 1, float(np.median(apart_m)), float(np.median(apart_mps)))


def _apart(moved: FloatArray, change: FloatArray, width: int) -> tuple[FloatArray, FloatArray]:
    """Root mean square over points and ``width`` frames, for every first frame.

    Of displacements less their ground advance, and of changes in velocity.
    """
    moved[..., :2] -= moved[..., :2].mean(axis=(0, 1))
    advance = _running_mean(moved[..., :2].mean(axis=1), width)
    squared = _running_mean((moved**2).sum(axis=2).mean(axis=1), width) - (advance**2).sum(axis=1)
    return np.sqrt(np.maximum(squared, 0.0)), np.sqrt(_running_mean((change**2).sum(axis=2).mean(axis=1), width))


def _running_mean(values: FloatArray, width: int) -> FloatArray:
    return np.asarray(np.lib.stride_tricks.sliding_window_view(values, width, axis=0).mean(axis=-1))


def _between_frames(
    curve: Spline, shape: tuple[int, ...], rate_hz: float, seam: Seam, step: int, overlap: float, weight_s: float
) -> Seam:
    """The same cut with its length refined to a fraction of a frame."""
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
        lambda lag: _cost(at(float(lag)), weight_s),
        bounds=bounds,
        method="bounded",
        options={"xatol": PRECISION_FRAMES},
    )
    return min(at(float(found.x)), at(min(seam.lag, latest)), key=lambda cut: _cost(cut, weight_s))


def _repeat(motion: Motion, seam: Seam, overlap: float, count: int) -> FloatArray:
    """Positions of ``count`` frames of the endless cycle, shape (count, P, 3)."""
    rate = motion.rate_hz
    curve = fit_spline(motion)

    def clip(frames: FloatArray) -> tuple[FloatArray, FloatArray]:
        found = curve.at(np.clip(frames, 0.0, motion.n_frames - 1.0) / rate)
        value, slope = (part.reshape(frames.size, *motion.positions.shape[1:]) for part in found)
        return value, slope / rate

    ends = np.linspace(0.0, overlap, max(3, math.ceil(overlap)))
    later, earlier = clip(seam.start + seam.lag + ends), clip(seam.start + ends)
    moved = (later[0] - earlier[0]).mean(axis=0)
    advance = moved.mean(axis=0) * (1.0, 1.0, 0.0)
    # what a point does not come back by, and what the body gains in speed, are taken off along the whole cycle: within
    # the overlap alone they would be a jerk
    astray, faster = moved - advance, (later[1] - earlier[1]).mean(axis=(0, 1)) * (1.0, 1.0, 0.0)

    def cycle(into: FloatArray) -> FloatArray:
        share = (into / seam.lag)[:, np.newaxis, np.newaxis]
        gained = faster * seam.lag * (share**2 - share) / 2.0
        return np.asarray(clip(seam.start + into)[0] - astray * (share - 0.5) - gained)

    total = np.arange(count, dtype=np.float64)
    into = np.mod(total, seam.lag)
    position = cycle(into) + advance * np.floor(total / seam.lag)[:, np.newaxis, np.newaxis]
    fading = into < overlap
    share = into[fading] / overlap
    # no slope and no curvature at either end
    weight = (share**3 * (10.0 - 15.0 * share + 6.0 * share**2))[:, np.newaxis, np.newaxis]
    follows = cycle(seam.lag + into[fading])
    follows += advance * (np.floor(total[fading] / seam.lag) - 1.0)[:, np.newaxis, np.newaxis]
    position[fading] = weight * position[fading] + (1.0 - weight) * follows
    return np.asarray(position)


def _cycle_touchdowns(motion: Motion, looped: Motion, seam: Seam, overlap: float) -> dict[str, list[float]]:
    """Touchdowns of one cycle, in s after its beginning: as stated, else as found in the middle one of three cycles."""
    rate = motion.rate_hz
    lasts_s = seam.lag / rate
    if motion.facts.footfalls:
        begins_s = float(motion.time_s[0]) + seam.start / rate
        times = {foot: np.array(stated) - begins_s for foot, stated in motion.facts.footfalls.items()}
    else:
        three = make_motion(
            _repeat(motion, seam, overlap, math.ceil(3 * seam.lag) + 1),
            rate_hz=rate,
            markers=looped.markers,
            parts=looped.parts,
            facts={"species": looped.facts.species},
        )
        times = {foot: step.touchdown_s - lasts_s for foot, step in find_steps(three).items()}
    return {foot: [float(t) for t in found if 0.0 <= t < lasts_s - 1e-9] for foot, found in times.items()}
