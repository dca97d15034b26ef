"""Paths over the ground: lines, arcs and stops.

The origin is the target's position at the start. x is its heading, and y points to its left.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Any, Literal, Self

import numpy as np
import numpy.typing as npt
from pydantic import AfterValidator, Field, field_validator, model_validator

from doppelgait.core.config import FrozenModel
from doppelgait.core.errors import ConfigError
from doppelgait.core.plugins import Group, plugin
from doppelgait.core.rng import Streams
from doppelgait.core.units import FloatArray, arctangent, cosine, sine

HEADING_WINDOW_M = 0.5
"""Distance over which the body turns where the curvature jumps: about a step (assumed)."""
TRANSITION_S = 0.6
"""Time of the transition from double support to standing, and of that back (assumed)."""
_HALVINGS = 80


@dataclass(frozen=True)
class CurveElement:
    """A line or an arc of a curve."""

    length_m: float
    curvature_per_m: float = 0.0
    turn_rad: float = 0.0


@dataclass(frozen=True)
class Curve:
    """Joined lines and arcs, one array entry per element. Shapes: point_m (n, 2), others (n,)."""

    start_m: FloatArray
    point_m: FloatArray
    heading_rad: FloatArray
    curvature_per_m: FloatArray
    spot_rad: FloatArray
    length_m: float

    def locate_elements(self, distance_m: FloatArray) -> tuple[npt.NDArray[np.intp], FloatArray]:
        """Return the element at each distance, and the remainder."""
        # the first and the last element are extended without limit
        number = np.clip(np.searchsorted(self.start_m, distance_m, side="right") - 1, 0, None)
        return number, distance_m - self.start_m[number]


def join(elements: Sequence[CurveElement], *, start_m: tuple[float, float], heading_rad: float) -> Curve:
    """Join elements to a curve from a start and heading."""
    lengths = np.array([element.length_m for element in elements])
    bends = np.array([element.curvature_per_m for element in elements])
    spots = np.cumsum([element.turn_rad for element in elements])
    headings = heading_rad + np.concatenate([[0.0], np.cumsum(lengths[:-1] * bends[:-1])])
    points = [np.array(start_m, dtype=float)]
    for number in range(len(elements) - 1):
        points.append(points[-1] + _chord_m(lengths[number], headings[number] + spots[number], bends[number]))
    starts_m = np.concatenate([[0.0], np.cumsum(lengths[:-1])])
    return Curve(starts_m, np.stack(points), headings, bends, spots, float(lengths.sum()))


def _chord_m(length_m: npt.ArrayLike, heading_rad: npt.ArrayLike, curvature_per_m: npt.ArrayLike) -> FloatArray:
    """Return the vectors from an arc's start to lengths on it, (..., 2)."""
    half = np.asarray(length_m) * np.asarray(curvature_per_m) / 2
    chord = np.asarray(length_m) * np.sinc(half / np.pi)
    middle = np.asarray(heading_rad) + half
    return np.stack([chord * cosine(middle), chord * sine(middle)], axis=-1)


def find_points(curve: Curve, distance_m: FloatArray) -> FloatArray:
    """Return points of the curve, shape (n, 2)."""
    number, gone_m = curve.locate_elements(distance_m)
    tangent = curve.heading_rad[number] + curve.spot_rad[number]
    return np.asarray(curve.point_m[number] + _chord_m(gone_m, tangent, curve.curvature_per_m[number]))


def smooth_heading_rad(curve: Curve, distance_m: FloatArray) -> FloatArray:
    """Return the tangent averaged over :data:`HEADING_WINDOW_M`, without turns on the spot."""
    half_m = HEADING_WINDOW_M / 2
    whole = _integrate_heading(curve, distance_m + half_m) - _integrate_heading(curve, distance_m - half_m)
    return np.asarray(whole / HEADING_WINDOW_M)


def _integrate_heading(curve: Curve, distance_m: FloatArray) -> FloatArray:
    lengths = np.diff(curve.start_m)
    per_element = curve.heading_rad[:-1] * lengths + curve.curvature_per_m[:-1] * lengths**2 / 2
    before = np.concatenate([[0.0], np.cumsum(per_element)])
    number, gone_m = curve.locate_elements(distance_m)
    return np.asarray(
        before[number] + curve.heading_rad[number] * gone_m + curve.curvature_per_m[number] * gone_m**2 / 2
    )


@dataclass(frozen=True)
class Stop:
    """A stop: distance, pause, and turn on the spot."""

    at_m: float
    pause_s: float
    turn_rad: float = 0.0


@dataclass(frozen=True)
class Pace:
    """Speed along a curve: constant except at stops."""

    speed_mps: float
    ramp_s: float = 0.0
    stops: tuple[Stop, ...] = ()

    def rest_s(self, number: int) -> float:
        """Return the time of rest at a stop."""
        lost_s = sum(self.ramp_s + stop.pause_s for stop in self.stops[:number])
        return self.stops[number].at_m / self.speed_mps + lost_s + self.ramp_s / 2


def distance_m(pace: Pace, time_s: FloatArray) -> FloatArray:
    """Return the distance travelled at each time."""
    # it is v t less the loss at each stop
    lost_s = np.zeros_like(time_s)
    for number, stop in enumerate(pace.stops):
        rest_s = pace.rest_s(number)
        lost_s += _integrate_ramp(time_s - rest_s + pace.ramp_s, pace.ramp_s)
        lost_s += np.clip(time_s - rest_s, 0.0, stop.pause_s)
        after_s = time_s - rest_s - stop.pause_s
        lost_s += np.clip(after_s, 0.0, pace.ramp_s) - _integrate_ramp(after_s, pace.ramp_s)
    return np.asarray(pace.speed_mps * (time_s - lost_s))


def _integrate_ramp(time_s: FloatArray, ramp_s: float) -> FloatArray:
    """Return the integral of the ramp (1 - cos(pi t / T)) / 2."""
    t = np.clip(time_s, 0.0, ramp_s)
    return np.asarray(t / 2 - ramp_s / (2 * np.pi) * sine(np.pi * t / ramp_s))


def spot_turn_rad(pace: Pace, time_s: FloatArray) -> FloatArray:
    """Return the sum of all turns on the spot."""
    # a turn takes its whole pause, except the transitions to standing before and after it
    turned = np.zeros_like(time_s)
    for number, stop in enumerate(pace.stops):
        transition_s = _get_transition_s(stop)
        first_s, lasts_s = pace.rest_s(number) + transition_s, max(stop.pause_s - 2 * transition_s, 1e-9)
        turned += stop.turn_rad * _ramp_half_cosine((time_s - first_s) / lasts_s)
    return turned


def compute_stillness(pace: Pace, number: int, time_s: FloatArray) -> FloatArray:
    """Return the share of standing posture at a stop, 0 for the frozen stride."""
    rest_s, stop = pace.rest_s(number), pace.stops[number]
    transition_s = _get_transition_s(stop)
    if transition_s <= 0:
        return np.zeros_like(time_s)
    rise = _ramp_half_cosine((time_s - rest_s) / transition_s)
    fall = _ramp_half_cosine((time_s - rest_s - stop.pause_s + transition_s) / transition_s)
    return np.asarray(transition_s / TRANSITION_S * (rise - fall))


def _get_transition_s(stop: Stop) -> float:
    return min(TRANSITION_S, stop.pause_s / 2)


def _ramp_half_cosine(share: FloatArray) -> FloatArray:
    return np.asarray((1 - cosine(np.pi * np.clip(share, 0.0, 1.0))) / 2)


def first_time_s(progress: Callable[[FloatArray], FloatArray], wanted: npt.ArrayLike, *, stop_s: float) -> FloatArray:
    """Find the times in [0, stop_s] at which a rising progress reaches values."""
    goal = np.atleast_1d(np.asarray(wanted, dtype=float))
    low, high = np.zeros_like(goal), np.full_like(goal, stop_s)
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        reached = progress(middle) >= goal
        low, high = np.where(reached, low, middle), np.where(reached, middle, high)
    return high


def make_arc(radius_m: float, turn_rad: float) -> CurveElement:
    """Return an arc; positive turns are to the left."""
    return CurveElement(radius_m * abs(turn_rad), math.copysign(1 / radius_m, turn_rad))


TURN_S, ACCELERATION_MPS2 = 2.0, 1.0
"""Default time of a half turn on the spot and acceleration on stopping and starting (assumed)."""
CORNER_M, MAX_CORNER_RAD, CORNERS_TAKE = 0.5, math.radians(150.0), 1.4
"""Largest radius of the corners of a walk about, their largest turn, and the legs' length over that of the walk."""
REST_APART_M, REST_MPS2 = 4.0, 2.0  # least distance of rests of a walk about; acceleration at them
_ATTEMPTS = 60  # at a leg that stays in the room
_SHORTEST_M = 1e-3
ENDLESS = CurveElement(math.inf)


@dataclass(frozen=True)
class Layout:
    """Geometry of a path. Open-ended: some stops may not be reached."""

    elements: tuple[CurveElement, ...]
    stops: tuple[Stop, ...] = ()
    acceleration_mps2: float = ACCELERATION_MPS2
    start_m: tuple[float, float] = (0.0, 0.0)
    heading_rad: float = 0.0
    open_ended: bool = False


class Path(FrozenModel):
    """Parameters of every path; each kind adds its shape.

    speed_mps: Speed along the path, within 30 % of the motion's own speed, which is the default.
    side_m: Distance of the body to the left of the path, for a person who accompanies another.
    ahead_m: Distance of the body ahead of the point on the path, along the path.
    """

    kind: str
    speed_mps: float | None = Field(default=None, gt=0, le=30)
    side_m: float = Field(default=0.0, ge=-10, le=10)
    ahead_m: float = Field(default=0.0, ge=-10, le=10)


class StopSpec(FrozenModel):
    """Stop on a path: distance from start and pause.

    at_m: Distance along the path from its start to the stop.
    pause_s: Time that the body stands at the stop.
    """

    at_m: float = Field(gt=0, le=1e5)
    pause_s: float = Field(ge=0.1, le=120)


def _check_order(stops: tuple[StopSpec, ...]) -> tuple[StopSpec, ...]:
    for one, other in pairwise(stops):
        if other.at_m <= one.at_m:
            raise ValueError(f"at_m must rise from stop to stop, but {other.at_m:g} follows {one.at_m:g}")
    return stops


class StraightPath(Path):
    """Straight line that lasts as long as the motion."""

    kind: Literal["straight"] = "straight"


class ArcPath(Path):
    """Arc of a circle, or several rounds of it.

    radius_m: Radius of the circle, 0.3 or more.
    turn_deg: Change of heading from start to end, positive to the left; not 0, at most ten rounds.
    """

    kind: Literal["arc"] = "arc"
    radius_m: float = Field(ge=0.3, le=1e4)
    turn_deg: float = Field(ge=-3600, le=3600)

    @field_validator("turn_deg")
    @classmethod
    def _check_turn(cls, turn_deg: float) -> float:
        if turn_deg == 0:
            raise ValueError('must not be 0; for a line take kind = "straight"')
        return turn_deg


class PolylinePath(Path):
    """Polyline through points, with rounded corners.

    points_m: Two or more corners; the path starts at the first.
    corner_radius_m: Radius of the corners, 0.1 or more. Each arc must fit between its neighbours.
    stops: Places and times of stops in order, at most 20.
    acceleration_mps2: Maximum acceleration on stopping and starting.
    """

    kind: Literal["polyline"] = "polyline"
    points_m: tuple[tuple[float, float], ...] = Field(min_length=2, max_length=1000)
    corner_radius_m: float = Field(default=0.5, ge=0.1, le=1e4)
    stops: Annotated[tuple[StopSpec, ...], AfterValidator(_check_order)] = Field(default=(), max_length=20)
    acceleration_mps2: float = Field(default=ACCELERATION_MPS2, ge=0.1, le=20)

    @model_validator(mode="after")
    def _check_corners(self) -> PolylinePath:
        lay_out_polyline(self)
        return self


class StopAndGoPath(Path):
    """Straight ahead with stops.

    stops: Places and times of the stops in order, at most 20.
    acceleration_mps2: Maximum acceleration on stopping and starting.
    """

    kind: Literal["stop_and_go"] = "stop_and_go"
    stops: Annotated[tuple[StopSpec, ...], AfterValidator(_check_order)] = Field(min_length=1, max_length=20)
    acceleration_mps2: float = Field(default=ACCELERATION_MPS2, ge=0.1, le=20)


class WanderPath(Path):
    """Walk about in a room: random legs and corners, with rests.

    Up to 2 m/s the body can stop within the least distance between two rests, 4 m.

    room_m: Rectangle that corners stay in: x from, x to, y from, y to.
    door_m: Point where the path starts, which may be outside; by default anywhere in the room.
    leg_m: Shortest and longest leg.
    rest_share: Share of the legs with a rest in their middle.
    rest_s: Shortest and longest rest.
    length_m: Length of the walk; a longer motion is refused.
    acceleration_mps2: Maximum acceleration before and after a rest.
    way: Number from 0 to 1 that the path is drawn from, so that a plan samples it: ``{ uniform = [0, 1] }``.
    """

    kind: Literal["wander"] = "wander"
    room_m: tuple[float, float, float, float]
    door_m: tuple[float, float] | None = None
    leg_m: tuple[float, float] = (1.0, 4.0)
    rest_share: float = Field(default=0.0, ge=0, le=1)
    rest_s: tuple[float, float] = (1.0, 4.0)
    length_m: float = Field(default=200.0, ge=1, le=2000)
    acceleration_mps2: float = Field(default=REST_MPS2, ge=0.1, le=20)
    way: float = Field(default=0.0, ge=0, le=1)

    @model_validator(mode="after")
    def _check_room(self) -> Self:
        x0_m, x1_m, y0_m, y1_m = self.room_m
        if not 0.5 <= self.leg_m[0] <= self.leg_m[1] <= 100:
            raise ValueError(f"leg_m: must be 0.5 or more, the shortest first, not {list(self.leg_m)}")
        if min(x1_m - x0_m, y1_m - y0_m) < 2 * self.leg_m[0]:
            raise ValueError(
                f"room_m: {list(self.room_m)} is x from, x to, y from, y to, {2 * self.leg_m[0]:g} m or more each way, "
                "two of the shortest legs"
            )
        if not 0.1 <= self.rest_s[0] <= self.rest_s[1] <= 120:
            raise ValueError(f"rest_s: must be from 0.1 to 120, the shortest first, not {list(self.rest_s)}")
        return self


class TurnAroundPath(Path):
    """Straight out, half a turn to the left, and back, as long as the motion.

    out_m: Distance from the start to the turn.
    radius_m: Radius of a U-turn at full speed, 0.3 or more; by default the body turns on the spot.
    turn_s: Duration of the turn on the spot, 2 s by default; the body stands before and after it.
    acceleration_mps2: Maximum acceleration before and after the turn on the spot, 1 by default.
    """

    kind: Literal["turn_around"] = "turn_around"
    out_m: float = Field(gt=0, le=1e5)
    radius_m: float | None = Field(default=None, ge=0.3, le=1e4)
    turn_s: float | None = Field(default=None, ge=0.5, le=60)
    acceleration_mps2: float | None = Field(default=None, ge=0.1, le=20)

    @model_validator(mode="after")
    def _check_turn(self) -> TurnAroundPath:
        on_the_spot = self.turn_s is not None or self.acceleration_mps2 is not None
        if self.radius_m is not None and on_the_spot:
            raise ValueError("turn_s and acceleration_mps2 belong to a turn on the spot: leave them or radius_m out")
        if self.radius_m is None and (self.side_m != 0 or self.ahead_m != 0):
            raise ValueError("a turn on the spot has no side_m and ahead_m: give radius_m to turn in a U")
        return self


@plugin("path", parameters=StraightPath)
def lay_out_straight(path: StraightPath) -> Layout:
    """Return an endless straight line."""
    return Layout((ENDLESS,))


@plugin("path", parameters=ArcPath)
def lay_out_arc(path: ArcPath) -> Layout:
    """Return an arc of a circle."""
    return Layout((make_arc(path.radius_m, math.radians(path.turn_deg)),))


@plugin("path", parameters=StopAndGoPath)
def lay_out_stops(path: StopAndGoPath) -> Layout:
    """Return a straight line with stops."""
    stops = tuple(Stop(stop.at_m, stop.pause_s) for stop in path.stops)
    return Layout((ENDLESS,), stops, path.acceleration_mps2)


@plugin("path", parameters=TurnAroundPath)
def lay_out_turn(path: TurnAroundPath) -> Layout:
    """Return a path out, a turn and the path back. The turn is a U-turn or a turn on the spot."""
    if path.radius_m is not None:
        return Layout((CurveElement(path.out_m), make_arc(path.radius_m, math.pi), ENDLESS))
    stop = Stop(path.out_m, 2 * TRANSITION_S + (path.turn_s or TURN_S), math.pi)
    return Layout((ENDLESS,), (stop,), path.acceleration_mps2 or ACCELERATION_MPS2)


@plugin("path", parameters=PolylinePath)
def lay_out_polyline(path: PolylinePath) -> Layout:
    """Return legs and corner arcs of a polyline. If they do not fit, ValueError is raised."""
    lengths, headings, turns = _measure_legs(np.array(path.points_m))
    if lengths.min() < _SHORTEST_M:
        number = int(lengths.argmin())
        raise ValueError(f"points_m: {number} and {number + 1} are at the same place; leave one out")
    if turns.size and np.abs(turns).max() > math.radians(175):
        number = int(np.abs(turns).argmax()) + 1
        raise ValueError(f'points_m: the path turns back at point {number}; use kind = "turn_around"')
    radii_m = np.full(turns.size, path.corner_radius_m)
    left, cut = _cut_corners(lengths, turns, radii_m)
    if left.min() < -1e-9:
        number = int(left.argmin())
        raise ValueError(
            f"points_m: the corners at {number} and {number + 1} take {cut[number] + cut[number + 1]:.3g} m of the "
            f"{lengths[number]:.3g} m between them; lower corner_radius_m = {path.corner_radius_m:g} or move them apart"
        )
    stops = tuple(Stop(stop.at_m, stop.pause_s) for stop in path.stops)
    elements, start_m = _join_legs(left, turns, radii_m), path.points_m[0]
    return Layout(elements, stops, path.acceleration_mps2, start_m, float(headings[0]))


def _measure_legs(points_m: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    # lengths and headings of legs, and the turns between them
    legs = np.diff(points_m, axis=0)
    headings = arctangent(legs[:, 1], legs[:, 0])
    return np.hypot(legs[:, 0], legs[:, 1]), headings, (np.diff(headings) + np.pi) % (2 * np.pi) - np.pi


def _cut_corners(lengths: FloatArray, turns: FloatArray, radii_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    # what arcs leave of the legs, and what they take on either side of a corner
    cut = np.concatenate([[0.0], radii_m * sine(np.abs(turns) / 2) / cosine(turns / 2), [0.0]])
    return lengths - cut[:-1] - cut[1:], cut


def _join_legs(left: FloatArray, turns: FloatArray, radii_m: FloatArray) -> tuple[CurveElement, ...]:
    elements = []
    for number, length in enumerate(left):
        elements += [CurveElement(float(length))] if length > 1e-9 else []
        bends = number < turns.size and abs(turns[number]) > 1e-9
        elements += [make_arc(float(radii_m[number]), float(turns[number]))] if bends else []
    return tuple(elements)


@plugin("path", parameters=WanderPath)
def lay_out_wander(path: WanderPath) -> Layout:
    """Return random legs and corners in a room, the sharp ones tighter."""
    rng = Streams(int(path.way * 2**53)).generator("motion", "wander")
    low_m, high_m = np.array(path.room_m).reshape(2, 2).T
    points_m = [rng.uniform(low_m, high_m) if path.door_m is None else np.array(path.door_m)]
    heading_rad, total_m = math.nan, 0.0
    while total_m < CORNERS_TAKE * path.length_m:
        for attempt in range(1, _ATTEMPTS):
            leg_m = rng.uniform(*path.leg_m) if attempt % 10 else path.leg_m[0]
            turn = rng.uniform(-1.0, 1.0)
            toward_rad = math.pi * turn if math.isnan(heading_rad) else heading_rad + MAX_CORNER_RAD * turn
            next_m = points_m[-1] + leg_m * cosine(np.array([toward_rad, toward_rad - np.pi / 2]))
            if (next_m >= low_m).all() and (next_m <= high_m).all():
                break
        else:  # through the door, or out of a narrow corner
            next_m = rng.uniform(low_m, high_m)
        heading_rad = float(_measure_legs(np.array([points_m[-1], next_m]))[1][0])
        total_m += math.dist(next_m, points_m[-1])
        points_m.append(next_m)
    lengths, headings, turns = _measure_legs(np.array(points_m))
    tangent = np.abs(sine(turns / 2)) / np.maximum(cosine(turns / 2), 1e-3)
    radii_m = np.minimum(CORNER_M, 0.45 * np.minimum(lengths[:-1], lengths[1:]) / np.maximum(tangent, 1e-9))
    left, _ = _cut_corners(lengths, turns, radii_m)
    middles_m = np.cumsum(left) - left / 2 + np.concatenate([[0.0], np.cumsum(radii_m * np.abs(turns))])
    rests: list[Stop] = []
    for at_m in middles_m[rng.random(left.size) < path.rest_share]:
        if at_m - (rests[-1].at_m if rests else 0.0) >= REST_APART_M:
            rests.append(Stop(float(at_m), float(rng.uniform(*path.rest_s))))
    elements, start_m = _join_legs(left, turns, radii_m), (float(points_m[0][0]), float(points_m[0][1]))
    return Layout(elements, tuple(rests), path.acceleration_mps2, start_m, float(headings[0]), open_ended=True)


PATHS: Group[Callable[[Any], Layout]] = Group("path", built_in=("doppelgait.motion.paths",))
"""Plug-ins by ``kind``: a model derived from :class:`Path` and a function that returns a layout."""


def make_path(table: Mapping[str, Any] | Path) -> Path:
    """Make a path from its scene table; a kind or parameter that is not allowed raises ConfigError.

    Examples
    --------
    >>> import doppelgait as dg
    >>> dg.motion.make_path({"kind": "arc", "radius_m": 2.0, "turn_deg": 90.0}).radius_m
    2.0
    """
    path = PATHS.parse(table)
    if not isinstance(path, Path):
        raise ConfigError(f"path {type(path).__name__}: its parameters must be a model derived from motion.paths.Path")
    return path


def lay_out(path: Path) -> Layout:
    """Return the layout of a path. Turns on the spot are only in its stops."""
    return PATHS.of(path).run(path)
