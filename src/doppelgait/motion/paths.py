"""Paths over the ground as configuration: straight, arc, polyline, stop and go, turn around.

Coordinates of a path are those of its mover at the start: origin there, x in its heading, y to its left.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from pydantic import Field, field_validator, model_validator

from doppelgait.core.config import FrozenModel
from doppelgait.core.errors import ConfigError
from doppelgait.core.plugins import Group, plugin
from doppelgait.motion.course import SETTLE_S, Piece, Stop, arc

TURN_S, ACCELERATION_MPS2 = 2.0, 1.0
"""Usual time of a half turn on the spot, and highest acceleration where a walker stops or sets off; assumed."""
_SHORTEST_M = 1e-3
ENDLESS = Piece(math.inf)


@dataclass(frozen=True)
class Layout:
    """Geometry of a path: pieces, stops and the acceleration about them, and where and how it starts."""

    pieces: tuple[Piece, ...]
    stops: tuple[Stop, ...] = ()
    acceleration_mps2: float = ACCELERATION_MPS2
    start_m: tuple[float, float] = (0.0, 0.0)
    heading_rad: float = 0.0


class Path(FrozenModel):
    """What every path takes; a kind of path adds ``kind`` and its shape.

    Parameters
    ----------
    speed_mps : float, optional
        Speed along the path, within 30 % of the motion's own, which it is by default.
    side_m, ahead_m : float
        The mover keeps this far to the left of the path's point and this much further along the path, as somebody
        does who accompanies another.
    """

    kind: str
    speed_mps: float | None = Field(default=None, gt=0, le=30)
    side_m: float = Field(default=0.0, ge=-10, le=10)
    ahead_m: float = Field(default=0.0, ge=-10, le=10)


class StraightPath(Path):
    """Straight ahead for as long as the motion lasts."""

    kind: Literal["straight"] = "straight"


class ArcPath(Path):
    """Part of a circle, or several rounds of it.

    Parameters
    ----------
    radius_m : float
        0.3 or more.
    turn_deg : float
        Change of heading from start to end, positive to the left; not 0, at most ten rounds.
    """

    kind: Literal["arc"] = "arc"
    radius_m: float = Field(ge=0.3, le=1e4)
    turn_deg: float = Field(ge=-3600, le=3600)

    @field_validator("turn_deg")
    @classmethod
    def _turns(cls, turn_deg: float) -> float:
        if turn_deg == 0:
            raise ValueError('must not be 0; for a line take kind = "straight"')
        return turn_deg


class PolylinePath(Path):
    """From point to point, corners rounded.

    Parameters
    ----------
    points_m : list of (float, float)
        Two or more; the path starts at the first.
    corner_radius_m : float
        0.1 or more; the arc touches both legs of a corner and must fit between its neighbours.
    """

    kind: Literal["polyline"] = "polyline"
    points_m: tuple[tuple[float, float], ...] = Field(min_length=2, max_length=1000)
    corner_radius_m: float = Field(default=0.5, ge=0.1, le=1e4)

    @model_validator(mode="after")
    def _corners_fit(self) -> PolylinePath:
        lay_polyline(self)
        return self


class StopSpec(FrozenModel):
    """A stop: distance from the start, and time at rest there, 0.1 to 120 s."""

    at_m: float = Field(gt=0, le=1e5)
    pause_s: float = Field(ge=0.1, le=120)


class StopAndGoPath(Path):
    """Straight ahead with stops.

    Parameters
    ----------
    stops : list of StopSpec
        In order, at most 20.
    acceleration_mps2 : float
        Highest acceleration on stopping and setting off.
    """

    kind: Literal["stop_and_go"] = "stop_and_go"
    stops: tuple[StopSpec, ...] = Field(min_length=1, max_length=20)
    acceleration_mps2: float = Field(default=ACCELERATION_MPS2, ge=0.1, le=20)

    @field_validator("stops")
    @classmethod
    def _in_order(cls, stops: tuple[StopSpec, ...]) -> tuple[StopSpec, ...]:
        for one, other in pairwise(stops):
            if other.at_m <= one.at_m:
                raise ValueError(f"at_m must rise from stop to stop, not go from {one.at_m:g} to {other.at_m:g}")
        return stops


class TurnAroundPath(Path):
    """Out, half a turn to the left, and back for as long as the motion lasts.

    Parameters
    ----------
    out_m : float
        Distance out.
    radius_m : float, optional
        Turn in a U of this radius, 0.3 or more, at full speed; without it on the spot, after stopping.
    turn_s : float, optional
        Time of the turn on the spot, 2 s by default; the body settles before and after it.
    acceleration_mps2 : float, optional
        Highest acceleration about the turn on the spot, 1 by default.
    """

    kind: Literal["turn_around"] = "turn_around"
    out_m: float = Field(gt=0, le=1e5)
    radius_m: float | None = Field(default=None, ge=0.3, le=1e4)
    turn_s: float | None = Field(default=None, ge=0.5, le=60)
    acceleration_mps2: float | None = Field(default=None, ge=0.1, le=20)

    @model_validator(mode="after")
    def _one_way_to_turn(self) -> TurnAroundPath:
        on_the_spot = self.turn_s is not None or self.acceleration_mps2 is not None
        if self.radius_m is not None and on_the_spot:
            raise ValueError("turn_s and acceleration_mps2 belong to a turn on the spot: leave them or radius_m out")
        if self.radius_m is None and (self.side_m != 0 or self.ahead_m != 0):
            raise ValueError("a turn on the spot has no side_m and ahead_m: give radius_m to turn in a U")
        return self


@plugin("path", parameters=StraightPath)
def lay_straight(path: StraightPath) -> Layout:
    """Go straight ahead without end."""
    return Layout((ENDLESS,))


@plugin("path", parameters=ArcPath)
def lay_arc(path: ArcPath) -> Layout:
    """Go round a part of a circle."""
    return Layout((arc(path.radius_m, math.radians(path.turn_deg)),))


@plugin("path", parameters=StopAndGoPath)
def lay_stops(path: StopAndGoPath) -> Layout:
    """Go straight ahead and rest at the stops."""
    stops = tuple(Stop(stop.at_m, stop.pause_s) for stop in path.stops)
    return Layout((ENDLESS,), stops, path.acceleration_mps2)


@plugin("path", parameters=TurnAroundPath)
def lay_turn(path: TurnAroundPath) -> Layout:
    """Go out, turn in a U or on the spot, and come back."""
    if path.radius_m is not None:
        return Layout((Piece(path.out_m), arc(path.radius_m, math.pi), ENDLESS))
    stop = Stop(path.out_m, 2 * SETTLE_S + (path.turn_s or TURN_S), math.pi)
    return Layout((ENDLESS,), (stop,), path.acceleration_mps2 or ACCELERATION_MPS2)


@plugin("path", parameters=PolylinePath)
def lay_polyline(path: PolylinePath) -> Layout:
    """Legs and corner arcs of a polyline; a ValueError where they do not fit."""
    legs = np.diff(np.array(path.points_m), axis=0)
    lengths = np.hypot(legs[:, 0], legs[:, 1])
    if lengths.min() < _SHORTEST_M:
        number = int(lengths.argmin())
        raise ValueError(f"points_m: {number} and {number + 1} are at the same place; leave one out")
    headings = np.arctan2(legs[:, 1], legs[:, 0])
    turns = (np.diff(headings) + np.pi) % (2 * np.pi) - np.pi
    if turns.size and np.abs(turns).max() > math.radians(175):
        number = int(np.abs(turns).argmax()) + 1
        raise ValueError(f'points_m: the path turns back at point {number}; use kind = "turn_around"')
    cut = np.concatenate([[0.0], path.corner_radius_m * np.tan(np.abs(turns) / 2), [0.0]])
    left = lengths - cut[:-1] - cut[1:]
    if left.min() < -1e-9:
        number = int(left.argmin())
        raise ValueError(
            f"points_m: the corners at {number} and {number + 1} take {cut[number] + cut[number + 1]:.3g} m of the "
            f"{lengths[number]:.3g} m between them; lower corner_radius_m = {path.corner_radius_m:g} or move them apart"
        )
    pieces = []
    for number, length in enumerate(left):
        pieces += [Piece(float(length))] if length > 1e-9 else []
        bends = number < turns.size and abs(turns[number]) > 1e-9
        pieces += [arc(path.corner_radius_m, float(turns[number]))] if bends else []
    return Layout(tuple(pieces), start_m=path.points_m[0], heading_rad=float(headings[0]))


PATHS: Group[Callable[[Any], Layout]] = Group("path", built_in=("doppelgait.motion.paths",))
"""Paths by the ``kind`` of a scene file: a model derived from :class:`Path` and a function that lays it out."""


def make_path(table: Mapping[str, Any] | Path) -> Path:
    """Path of a ``path = { kind = ... }`` table.

    Raises
    ------
    ConfigError
        If the kind or a parameter is not allowed.

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


def layout_of(path: Path) -> Layout:
    """Pieces and stops of a path; turns on the spot are in its stops alone."""
    return PATHS.of(path).run(path)
