"""Ground curves of lines and arcs, and the distance gone along them when the mover stops on its way."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

HEADING_WINDOW_M = 0.5
"""The body turns over this distance where the curvature of its path jumps: about a step, assumed."""
SETTLE_S = 0.6
"""Time from the freeze in double support to standing, and back, assumed."""
_HALVINGS = 80


@dataclass(frozen=True)
class Piece:
    """A stretch of a curve.

    Parameters
    ----------
    length_m : float
        Positive; infinite only in the last piece.
    curvature_per_m : float
        1 / radius, positive to the left; 0 for a line.
    turn_rad : float
        Turn on the spot before it.
    """

    length_m: float
    curvature_per_m: float = 0.0
    turn_rad: float = 0.0


@dataclass(frozen=True)
class Curve:
    """Pieces joined end to end; arrays have one entry per piece.

    Parameters
    ----------
    start_m : ndarray, shape (n,)
        Distance at which each piece starts; the first is 0.
    point_m : ndarray, shape (n, 2)
        Where it starts.
    heading_rad : ndarray, shape (n,)
        Tangent there, from +x towards +y, without the turns on the spot before it.
    curvature_per_m, spot_rad : ndarray, shape (n,)
        Curvature, and the sum of all turns on the spot so far.
    length_m : float
        Length of all pieces, perhaps infinite.
    """

    start_m: FloatArray
    point_m: FloatArray
    heading_rad: FloatArray
    curvature_per_m: FloatArray
    spot_rad: FloatArray
    length_m: float

    def pieces_at(self, distance_m: FloatArray) -> tuple[npt.NDArray[np.intp], FloatArray]:
        """Number of the piece at each distance, and the distance gone in it; the end pieces go on for ever."""
        number = np.clip(np.searchsorted(self.start_m, distance_m, side="right") - 1, 0, None)
        return number, distance_m - self.start_m[number]


def join(pieces: Sequence[Piece], *, start_m: tuple[float, float], heading_rad: float) -> Curve:
    """Curve of pieces that starts at a ground point with a heading."""
    lengths = np.array([piece.length_m for piece in pieces])
    bends = np.array([piece.curvature_per_m for piece in pieces])
    spots = np.cumsum([piece.turn_rad for piece in pieces])
    headings = heading_rad + np.concatenate([[0.0], np.cumsum(lengths[:-1] * bends[:-1])])
    points = [np.array(start_m, dtype=float)]
    for number in range(len(pieces) - 1):
        points.append(points[-1] + _chord_m(lengths[number], headings[number] + spots[number], bends[number]))
    return Curve(
        start_m=np.concatenate([[0.0], np.cumsum(lengths[:-1])]),
        point_m=np.stack(points),
        heading_rad=headings,
        curvature_per_m=bends,
        spot_rad=spots,
        length_m=float(lengths.sum()),
    )


def _chord_m(length_m: npt.ArrayLike, heading_rad: npt.ArrayLike, curvature_per_m: npt.ArrayLike) -> FloatArray:
    """Vector from the start of an arc to a point at ``length_m`` on it, shape (..., 2); a line at curvature 0."""
    half = np.asarray(length_m) * np.asarray(curvature_per_m) / 2
    chord = np.asarray(length_m) * np.sinc(half / np.pi)
    middle = np.asarray(heading_rad) + half
    return np.stack([chord * np.cos(middle), chord * np.sin(middle)], axis=-1)


def point_at(curve: Curve, distance_m: FloatArray) -> FloatArray:
    """Points of the curve, shape (n, 2)."""
    number, gone_m = curve.pieces_at(distance_m)
    tangent = curve.heading_rad[number] + curve.spot_rad[number]
    return np.asarray(curve.point_m[number] + _chord_m(gone_m, tangent, curve.curvature_per_m[number]))


def smooth_heading_rad(curve: Curve, distance_m: FloatArray) -> FloatArray:
    """Tangent averaged over :data:`HEADING_WINDOW_M` about each distance, turns on the spot left out; shape (n,).

    The tangent is piecewise linear in the distance, so its mean is exact, has a continuous rate and is the tangent
    itself wherever the window lies in one piece.
    """
    half_m = HEADING_WINDOW_M / 2
    whole = _heading_integral(curve, distance_m + half_m) - _heading_integral(curve, distance_m - half_m)
    return np.asarray(whole / HEADING_WINDOW_M)


def _heading_integral(curve: Curve, distance_m: FloatArray) -> FloatArray:
    lengths = np.diff(curve.start_m)
    per_piece = curve.heading_rad[:-1] * lengths + curve.curvature_per_m[:-1] * lengths**2 / 2
    before = np.concatenate([[0.0], np.cumsum(per_piece)])
    number, gone_m = curve.pieces_at(distance_m)
    return np.asarray(
        before[number] + curve.heading_rad[number] * gone_m + curve.curvature_per_m[number] * gone_m**2 / 2
    )


@dataclass(frozen=True)
class Stop:
    """A halt: where, how long the body stands, and how far it turns meanwhile."""

    at_m: float
    pause_s: float
    turn_rad: float = 0.0


@dataclass(frozen=True)
class Pace:
    """Speed along a curve: constant but for stops.

    Parameters
    ----------
    speed_mps : float
        Cruising speed v.
    ramp_s : float
        Time T to come to rest and to set off again, on a half cosine: highest acceleration pi v / (2 T).
    stops : tuple of Stop
        In order, at least v T apart, the first at v T / 2 or later.
    """

    speed_mps: float
    ramp_s: float = 0.0
    stops: tuple[Stop, ...] = ()

    def rest_s(self, number: int) -> float:
        """Time at which the mover comes to rest at a stop."""
        lost_s = sum(self.ramp_s + stop.pause_s for stop in self.stops[:number])
        return self.stops[number].at_m / self.speed_mps + lost_s + self.ramp_s / 2

    @property
    def pause_s(self) -> float:
        """Sum of all pauses."""
        return sum(stop.pause_s for stop in self.stops)


def distance_m(pace: Pace, time_s: FloatArray) -> FloatArray:
    """Distance gone: v t less what each stop costs; its speed and acceleration are continuous."""
    lost_s = np.zeros_like(time_s)
    for number, stop in enumerate(pace.stops):
        rest_s = pace.rest_s(number)
        lost_s += _ramp_up(time_s - rest_s + pace.ramp_s, pace.ramp_s)
        lost_s += np.clip(time_s - rest_s, 0.0, stop.pause_s)
        after_s = time_s - rest_s - stop.pause_s
        lost_s += np.clip(after_s, 0.0, pace.ramp_s) - _ramp_up(after_s, pace.ramp_s)
    return np.asarray(pace.speed_mps * (time_s - lost_s))


def _ramp_up(time_s: FloatArray, ramp_s: float) -> FloatArray:
    """Integral of the share (1 - cos(pi t / T)) / 2 over the ramp, constant outside it."""
    t = np.clip(time_s, 0.0, ramp_s)
    return np.asarray(t / 2 - ramp_s / (2 * np.pi) * np.sin(np.pi * t / ramp_s))


def spot_turn_rad(pace: Pace, time_s: FloatArray) -> FloatArray:
    """Sum of all turns on the spot so far; a turn fills its pause but for settling before and after it."""
    turned = np.zeros_like(time_s)
    for number, stop in enumerate(pace.stops):
        settle_s = _settle_s(stop)
        first_s, lasts_s = pace.rest_s(number) + settle_s, max(stop.pause_s - 2 * settle_s, 1e-9)
        turned += stop.turn_rad * _half_cosine((time_s - first_s) / lasts_s)
    return turned


def stillness(pace: Pace, number: int, time_s: FloatArray) -> FloatArray:
    """How far the posture has faded from the frozen stride (0) to standing (1) at a stop.

    A pause shorter than two settling times fades in part, so that limbs do not move faster in it.
    """
    rest_s, stop = pace.rest_s(number), pace.stops[number]
    settle_s = _settle_s(stop)
    if settle_s <= 0:
        return np.zeros_like(time_s)
    rise = _half_cosine((time_s - rest_s) / settle_s)
    fall = _half_cosine((time_s - rest_s - stop.pause_s + settle_s) / settle_s)
    return np.asarray(settle_s / SETTLE_S * (rise - fall))


def _settle_s(stop: Stop) -> float:
    return min(SETTLE_S, stop.pause_s / 2)


def _half_cosine(share: FloatArray) -> FloatArray:
    return np.asarray((1 - np.cos(np.pi * np.clip(share, 0.0, 1.0))) / 2)


def first_time_s(progress: Callable[[FloatArray], FloatArray], wanted: npt.ArrayLike, *, stop_s: float) -> FloatArray:
    """First times in [0, ``stop_s``] at which a progress that never falls reaches wanted values, by bisection."""
    goal = np.atleast_1d(np.asarray(wanted, dtype=float))
    low, high = np.zeros_like(goal), np.full_like(goal, stop_s)
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        reached = progress(middle) >= goal
        low, high = np.where(reached, low, middle), np.where(reached, middle, high)
    return high


def arc(radius_m: float, turn_rad: float) -> Piece:
    """Arc of a radius, to the left for a positive turn."""
    return Piece(radius_m * abs(turn_rad), math.copysign(1 / radius_m, turn_rad))
