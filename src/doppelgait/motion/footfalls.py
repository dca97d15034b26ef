"""When each foot lands and leaves the ground, from the paths of feet and paws."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from doppelgait.motion.clean import body_centre
from doppelgait.motion.gaps import fill_linear, runs
from doppelgait.motion.motion import Motion
from doppelgait.motion.skeleton import FOOT_PARTS
from doppelgait.motion.travel import smooth_path

FloatArray = npt.NDArray[np.float64]

SWING_PEAK, SHORTEST_SWING_S = 1.4, 0.04
"""A foot swings while it goes faster than the body; what does not reach 1.4 body speeds or is shorter is no swing."""
STILL = 0.01
"""A foot that has slowed down to this part of its highest speed in swing has landed."""
STANCE_SPEED = 0.5
"""A foot bears weight while its slowest point goes at less than half the body's speed."""
SLOWEST_BODY_MPS = 0.2
"""A body slower than this stands: a foot must outrun this speed to be in swing."""
LOW_POINTS = 0.15
"""Without named feet, points whose 5th percentile of height is in the lowest 15 % of the body's are taken for feet."""


@dataclass(frozen=True)
class Steps:
    """What one foot does.

    Parameters
    ----------
    touchdown_s : ndarray
        Times at which it lands.
    overtaken_s : ndarray
        Times at which its speed falls through that of the body, just before: less exact as a contact, more exact as a
        clock, because the speed falls steeply there.
    duty_factor : float
        Share of the time between two mid-swings for which it bears weight, 0 to 1; NaN with fewer than two swings.
    """

    touchdown_s: FloatArray
    overtaken_s: FloatArray
    duty_factor: float


def is_quadruped(motion: Motion) -> bool:
    """Whether a motion has paws, or names a species other than human."""
    paws = any(part.endswith("_paw") for part in motion.parts)
    return paws or motion.facts.species not in ("", "human")


def find_feet(motion: Motion) -> dict[str, list[int]]:
    """Numbers of the points of each foot: ``left_foot``, ``right_foot``, or ``left_hind``, ``left_fore``, ...

    By body part where parts name feet; otherwise the lowest points, left and right of the centre (and before and behind
    it for a quadruped). Empty where neither gives feet on both sides.
    """
    feet: dict[str, list[int]] = {}
    for n, part in enumerate(motion.parts):
        if part in FOOT_PARTS:
            feet.setdefault(part.removesuffix("_paw"), []).append(n)
    return feet or _lowest_points(motion)


def _lowest_points(motion: Motion) -> dict[str, list[int]]:
    position = fill_linear(motion.position_m)
    path = smooth_path(position, rate_hz=motion.rate_hz)
    if len(path) < 2 or not np.isfinite(path).all():
        return {}
    ahead = path[-1] - path[0]
    # comparisons with a point that was never seen are false: it is no foot
    offset = np.median(position[:, :, :2] - body_centre(position)[:, np.newaxis, :2], axis=0)
    left = offset @ np.array([-ahead[1], ahead[0]]) > 0
    hind = offset @ ahead < 0
    low = np.percentile(position[:, :, 2], 5, axis=0)
    near = low <= np.nanmin(low) + LOW_POINTS * (np.nanmax(position[:, :, 2]) - np.nanmin(low))
    four = is_quadruped(motion)
    feet: dict[str, list[int]] = {}
    for n in np.flatnonzero(near):
        end = ("hind" if hind[n] else "fore") if four else "foot"
        feet.setdefault(f"{'left' if left[n] else 'right'}_{end}", []).append(int(n))
    return feet if len(feet) == (4 if four else 2) else {}


def find_steps(motion: Motion, feet: Mapping[str, list[int]] | None = None) -> dict[str, Steps]:
    """Touchdowns and duty factor of each foot of a mover.

    A foot swings forward faster than the body goes and is nearly still on the ground. It lands where, after a swing,
    its forward speed stops falling or reaches 1 % of its highest value in that swing. Speeds are those over the ground
    along the smoothed path of the body, so that a turning walk has footfalls, too.

    Parameters
    ----------
    motion : Motion
        Motion (time, marker, space) in m, z up; gaps are bridged by straight lines.
    feet : mapping, optional
        Numbers of the points of each foot, by default those of :func:`find_feet`.

    Returns
    -------
    dict of str to Steps
        Times on the motion's time axis; empty for a body that has no known feet.
    """
    feet = find_feet(motion) if feet is None else feet
    position = motion.position_m
    rate, times = motion.rate_hz, motion.time_s
    path = smooth_path(position, rate_hz=rate)
    if len(path) < 5 or not np.isfinite(path).all():
        return {}
    velocity = np.gradient(path, 1.0 / rate, axis=0)
    body_mps = np.maximum(np.linalg.norm(velocity, axis=1), SLOWEST_BODY_MPS)
    ahead = velocity / body_mps[:, np.newaxis]
    found = {}
    for foot, points in feet.items():
        filled = fill_linear(position[:, points])
        filled = filled[:, np.isfinite(filled).all(axis=(0, 2)), :2]
        if filled.shape[1]:
            forward = np.einsum("tpk,tk->tp", np.gradient(filled, 1.0 / rate, axis=0), ahead)
            found[foot] = _steps(forward, body_mps, times, rate)
    return found


def _steps(forward_mps: FloatArray, body_mps: FloatArray, times_s: FloatArray, rate_hz: float) -> Steps:
    """Steps of one foot from the forward speeds of its points, shape (T, P)."""
    speed, slowest = forward_mps.mean(axis=1), forward_mps.min(axis=1)
    touchdown, overtaken, peaks = [], [], []
    for first, stop in runs(speed > body_mps):
        peak = first + int(np.argmax(speed[first:stop]))
        if speed[peak] < SWING_PEAK * body_mps[peak] or stop - first < SHORTEST_SWING_S * rate_hz:
            continue
        peaks.append(peak)
        landed = _landing(speed, stop, STILL * speed[peak])
        if landed is not None:
            touchdown.append(times_s[landed])
            excess = (speed - body_mps)[stop - 1 : stop + 1]
            overtaken.append(times_s[stop - 1] + excess[0] / (excess[0] - excess[1]) / rate_hz)
    bears = slowest < STANCE_SPEED * body_mps
    duty = float(bears[peaks[0] : peaks[-1]].mean()) if len(peaks) > 1 else float("nan")
    return Steps(np.array(touchdown), np.array(overtaken), duty)


def _landing(speed: FloatArray, after: int, still_mps: float) -> int | None:
    """First frame from ``after`` on at which the speed is low or stops falling; None where the motion ends before."""
    for n in range(after, len(speed) - 1):
        if speed[n] <= still_mps or speed[n + 1] >= speed[n]:
            return n
    return None
