"""Scatterer table: ranges, velocities and aspects (E-03 to E-05)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait._core import native
from doppelgait.core.labels import SCATTERER_VARIABLES, ScattererTable, Signal, describe_points
from doppelgait.core.lazy import LateRows, xr
from doppelgait.core.samples import borrow_memory
from doppelgait.core.units import FloatArray, arccosine, arcsine, arctangent, cosine
from doppelgait.motion.retime import Spline, check_times, fit_centre, fit_spline, resample
from doppelgait.radar.link import MIN_RANGE_M
from doppelgait.scene.bodies import LEAST_COSINE
from doppelgait.scene.placement import PlacedScene, PlacedTarget, as_placed
from doppelgait.scene.rcs import Scatterers, View, compute_scatterers
from doppelgait.scene.scene import Scene

FADE_S = 0.3
"""Time in which a body appears and vanishes, about that of a step through a door (assumed)."""
ASPECT_MIN_SPEED_MPS = 0.05
"""Minimum speed, m/s, at which a scatterer has a direction, and hence an aspect angle (E-04)."""


@dataclass(frozen=True)
class LineOfSight:
    """Geometry of points seen from the radar.

    Every array has the shape of the points' leading axes.
    """

    range_m: FloatArray
    radial_velocity_mps: FloatArray
    aspect_rad: FloatArray
    azimuth_rad: FloatArray
    elevation_rad: FloatArray


def line_of_sight(position_m: FloatArray, velocity_mps: FloatArray, radar_position_m: npt.ArrayLike) -> LineOfSight:
    """Compute range, radial velocity and angles of moving points.

    Parameters
    ----------
    position_m, velocity_mps : ndarray, shape (..., 3)
    radar_position_m : array_like, shape (3,)

    Returns
    -------
    LineOfSight
        Range R = |x - p| (E-03); radial velocity -dR/dt = -v . u, positive when approaching (E-04);
        aspect angle psi with cos(psi) = -(v . u) / |v|, 0 when approaching, NaN below 0.05 m/s;
        azimuth from +x towards +y; elevation up.

    See Also
    --------
    compute_body_track : the same for the body of a target.

    Examples
    --------
    >>> import numpy as np
    >>> from doppelgait.scene import line_of_sight
    >>> sight = line_of_sight(np.array([[3.0, 4.0, 0.0]]), np.array([[-1.0, 0.0, 0.0]]), (0.0, 0.0, 0.0))
    >>> sight.range_m
    array([5.])
    """
    sight = position_m - np.asarray(radar_position_m, dtype=float)
    range_m = np.sqrt((sight**2).sum(axis=-1))
    unit = sight / np.maximum(range_m, 1e-12)[..., None]
    approach = -(velocity_mps * unit).sum(axis=-1)
    speed = np.sqrt((velocity_mps**2).sum(axis=-1))
    cosine = np.full_like(approach, np.nan)
    np.divide(approach, speed, out=cosine, where=speed >= ASPECT_MIN_SPEED_MPS)
    return LineOfSight(
        range_m=range_m,
        radial_velocity_mps=approach,
        aspect_rad=arccosine(np.clip(cosine, -1.0, 1.0)),
        azimuth_rad=arctangent(sight[..., 1], sight[..., 0]),
        elevation_rad=arcsine(np.clip(unit[..., 2], -1.0, 1.0)),
    )


def bistatic_line_of_sight(
    position_m: FloatArray,
    velocity_mps: FloatArray,
    *,
    transmitter_position_m: npt.ArrayLike,
    receiver_position_m: npt.ArrayLike,
) -> LineOfSight:
    """Compute the bistatic geometry of moving points."""
    # range, radial velocity and angles for separate positions of transmitter and receiver
    sight = line_of_sight(position_m, velocity_mps, transmitter_position_m)
    back = line_of_sight(position_m, velocity_mps, receiver_position_m)
    return replace(
        sight,
        range_m=(sight.range_m + back.range_m) / 2.0,
        radial_velocity_mps=(sight.radial_velocity_mps + back.radial_velocity_mps) / 2.0,
    )


def compute_bistatic_spreading(transmitter_range_m: npt.ArrayLike, receiver_range_m: npt.ArrayLike) -> FloatArray:
    r"""Compute the two-way power gain from monostatic to bistatic radar (E-14)."""
    there, back = np.asarray(transmitter_range_m, dtype=float), np.asarray(receiver_range_m, dtype=float)
    mean = np.maximum((there + back) / 2.0, MIN_RANGE_M)
    ratio = mean * mean / (np.maximum(there, MIN_RANGE_M) * np.maximum(back, MIN_RANGE_M))
    return np.asarray(ratio * ratio)


def assemble(
    scene: Scene | PlacedScene,
    slow_time_s: npt.ArrayLike,
    *,
    angles: bool = True,
    directions: bool = False,
    wavelength_m: float | None = None,
    rng: np.random.Generator | None = None,
) -> xr.Dataset:
    """Assemble the scatterer table of all targets of a scene.

    Parameters
    ----------
    scene : Scene or PlacedScene
    slow_time_s : array_like, shape (I,)
        Pulse times from the start of the scene.
    angles : bool
        Include aspect, azimuth and elevation; they need most of the computing time.
    directions : bool
        Include azimuth and elevation even without ``angles``.
    wavelength_m : float, optional
        Needed for the rcs kind ``surfaces``; without it, bodies of the kind ``auto`` are points.
    rng : numpy.random.Generator, optional
        Needed if the radar cross section of a target fluctuates or has a spread; a body of surfaces is drawn with it.

    Returns
    -------
    Dataset (slow_time, scatterer)
        The variables of :data:`doppelgait.core.labels.SCATTERER_VARIABLES`, with ``target``,
        ``marker`` and ``part`` of every scatterer. ``target`` is the number among the scene's
        ``observed_targets``, -2 for background bodies. The table of an empty room has no
        scatterers.

        For a bistatic radar, ``range`` and ``radial_velocity`` are those of
        :func:`bistatic_line_of_sight`, ``path_gain`` contains :func:`compute_bistatic_spreading`
        and the occlusion of both paths, angles are those from the transmitter, and the attribute
        ``bistatic`` is set. The radar cross section is then the monostatic one along the bisector
        of the two paths to the body centre, which is exact for smooth convex bodies in the limit of
        short waves (Kell, Proc. IEEE 53, 1965); forward scattering is not modelled.

    Raises
    ------
    MotionError
        If a motion does not cover the times.
    ConfigError
        If a radar cross section needs ``rng``, or joints that the motion lacks.

    See Also
    --------
    place : make and place the motions alone.

    Examples
    --------
    >>> import doppelgait as dg
    >>> scene = dg.Scene([dg.Target({"kind": "boulic", "speed_mps": 1.2}, label="human")], duration_s=3.0)
    >>> table = dg.scene.assemble(scene, [0.0, 0.1, 0.2])
    >>> table.sizes["scatterer"], round(float(table["range"].mean()), 1)  # number, mean range in m
    (17, 6.7)
    """
    placed, times = as_placed(scene), np.asarray(slow_time_s, dtype=float)
    wanted = ("azimuth", "elevation", "aspect") if angles else ("azimuth", "elevation") if directions else ()
    return tabulate(placed, make_scatterers(placed, times, wavelength_m, rng), times, wanted).label()


def make_scatterers(
    placed: PlacedScene, times: FloatArray, wavelength_m: float | None, rng: np.random.Generator | None
) -> list[Scatterers]:
    """Make the scatterers of all targets, including random properties."""
    chance = {"wavelength_m": wavelength_m, "rng": rng}
    bodies = [_make_scatterers(target, placed.scene, times, chance) for target in placed.targets]
    return [
        _fade(body, target, times) if np.isfinite(target.stay_s).any() else body
        for body, target in zip(bodies, placed.targets, strict=True)
    ]


def _fade(body: Scatterers, target: PlacedTarget, times: FloatArray) -> Scatterers:
    # a body that appears or vanishes at once is a click at all frequencies
    since_s = np.minimum(times - target.stay_s[0], target.stay_s[1] - times)
    seen = 0.5 - 0.5 * cosine(np.pi * np.clip(since_s / FADE_S, 0.0, 1.0))
    return replace(body, rcs_m2=body.rcs_m2 * np.square(seen)[:, None])


def tabulate(
    placed: PlacedScene, bodies: Sequence[Scatterers], times: FloatArray, wanted: Sequence[str]
) -> ScattererTable:
    """Observe scatterers at some times as a table."""
    return make_table(placed, bodies, times, look(placed.scene, bodies, fit_splines(bodies), times, wanted))


def tabulate_later(
    placed: PlacedScene, bodies: Sequence[Scatterers], times: FloatArray, wanted: Sequence[str]
) -> ScattererTable:
    """Observe scatterers as :func:`tabulate`; ranges, velocities and angles on demand."""
    count = sum(len(body.motion.markers) for body in bodies)
    alike = [
        replace(body, rcs_m2=np.ones(1), path_gain=np.ones(1), phase_rad=None) for body in bodies
    ]  # gains are not needed here
    late = _Look(placed.scene, alike, fit_splines(bodies), times, tuple(wanted))
    values: dict[str, Any] = {
        name: LateRows((times.size, count), partial(late.read, name), np.float64)
        for name in ("range", "radial_velocity", *wanted)
    }
    values["rcs"] = _join_tables(bodies, times, [body.rcs_m2 for body in bodies])
    values["path_gain"] = _join_tables(bodies, times, [body.path_gain for body in bodies])
    values |= _join_phases(bodies, times)
    return make_table(placed, bodies, times, values)


@dataclass(frozen=True, eq=False)
class _Look:
    """View of some scatterers from the radar, computed when read; the last pulses are kept."""

    scene: Scene
    bodies: Sequence[Scatterers]
    splines: Sequence[Spline]
    times: FloatArray
    angles: tuple[str, ...]
    last: dict[Any, dict[str, FloatArray]] = field(default_factory=dict)

    def __reduce__(self) -> tuple[Any, ...]:
        return _Look, (self.scene, self.bodies, self.splines, self.times, self.angles)

    def read(self, name: str, first: int, stop: int) -> FloatArray:
        wanted = self.angles if name in self.angles else ()
        key = (first, stop, wanted)
        seen = self.last.get(key) or look(self.scene, self.bodies, self.splines, self.times[first:stop], wanted)
        self.last.clear()
        self.last[key] = seen  # a thread returns what it has seen, whatever others keep
        return seen[name]


def fit_splines(bodies: Sequence[Scatterers]) -> list[Spline]:
    """Fit the splines of all bodies."""
    return [fit_spline(body.motion) for body in bodies]


def look(
    scene: Scene,
    bodies: Sequence[Scatterers],
    splines: Sequence[Spline],
    times: FloatArray,
    wanted: Sequence[str],
    n_images: int = 0,
) -> dict[str, FloatArray]:
    """Observe all scatterers together, with undefined columns for images."""
    ends = np.cumsum([0, *(len(body.motion.markers) for body in bodies)])
    values = {
        name: borrow_memory((times.size, int(ends[-1]) + n_images), np.float64)
        for name in ("range", "radial_velocity", *wanted)
    }
    gains = []
    for number, (body, spline) in enumerate(zip(bodies, splines, strict=True)):
        columns = slice(ends[number], ends[number + 1])
        own = {name: array[:, columns] for name, array in values.items()}
        checked_s, gain = check_times(body.motion, times), body.path_gain
        range_m, approach_mps = own["range"], own["radial_velocity"]
        fill_ranges(spline, checked_s, scene.radar_position_m, range_m, approach_mps)
        if scene.receiver_position_m is not None:
            back_m, back_mps = np.empty((2, *range_m.shape))
            fill_ranges(spline, checked_s, scene.receiver_position_m, back_m, back_mps)
            gain = gain * compute_bistatic_spreading(range_m, back_m)
            range_m[:], approach_mps[:] = (range_m + back_m) / 2.0, (approach_mps + back_mps) / 2.0
        if "azimuth" in own:
            fill_angles(spline, checked_s, scene.radar_position_m, own)
        gains.append(gain)
    values["rcs"] = _join_tables(bodies, times, [body.rcs_m2 for body in bodies])
    return {**values, "path_gain": _join_tables(bodies, times, gains), **_join_phases(bodies, times)}


def make_table(
    placed: PlacedScene, bodies: Sequence[Scatterers], times: FloatArray, values: Mapping[str, Any]
) -> ScattererTable:
    """Make the table of observed values."""
    columns = {
        "target": np.array(
            [t.number for t, b in zip(placed.targets, bodies, strict=True) for _ in b.motion.markers], int
        ),
        "marker": np.array([marker for body in bodies for marker in body.motion.markers], dtype=str),
        "part": np.array([part for body in bodies for part in body.motion.parts], dtype=str),
    }
    ordered = {name: values[name] for name in SCATTERER_VARIABLES if name in values}
    return ScattererTable(
        times, ordered, columns, {} if placed.scene.receiver_position_m is None else {"bistatic": True}
    )


def _join_tables(bodies: Sequence[Scatterers], times: FloatArray, tables: Sequence[FloatArray]) -> FloatArray:
    shapes = [(times.size, len(body.motion.markers)) for body in bodies]
    parts = [np.broadcast_to(values, shape) for values, shape in zip(tables, shapes, strict=True)]
    if times.size and all(part.strides[0] == 0 for part in parts if part.shape[1]):
        row = np.concatenate([np.empty((1, 0)), *(part[:1] for part in parts)], axis=1)
        return np.broadcast_to(row, (times.size, row.shape[1]))
    return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)


def _join_phases(bodies: Sequence[Scatterers], times: FloatArray) -> dict[str, FloatArray]:
    if all(body.phase_rad is None for body in bodies):
        return {}
    phases = [np.zeros(1) if body.phase_rad is None else body.phase_rad for body in bodies]
    return {"path_phase": _join_tables(bodies, times, phases)}


def _make_scatterers(target: PlacedTarget, scene: Scene, times: FloatArray, chance: Mapping[str, Any]) -> Scatterers:
    # occlusion applies to the path from the transmitter and to the path to the receiver
    motion, rcs = target.motion, target.target.rcs
    if scene.receiver_position_m is None:
        return compute_scatterers(motion, rcs, times, scene.radar_position_m, **chance)
    # The bisector of an angle divides the opposite side in the ratio of the adjacent sides, R_t to R_r. This gives the
    # point between transmitter and receiver on the bisector at the body centre, for the mean ranges.
    centre_m = fit_centre(motion).at(check_times(motion, times))[0]
    ends = np.array([scene.radar_position_m, scene.receiver_position_m])
    there_m, back_m = np.sqrt(((centre_m - ends[:, None]) ** 2).sum(axis=-1)).mean(axis=-1)
    bisector_m = np.asarray(ends[0] + there_m / max(there_m + back_m, 1e-12) * (ends[1] - ends[0]))
    if chance["wavelength_m"] is not None:  # phases grow with 2 k cos(half the angle) along a limb (Kell 1965)
        square = ((there_m + back_m) ** 2 - np.square(ends[1] - ends[0]).sum()) / (4.0 * there_m * back_m)
        chance = {**chance, "wavelength_m": chance["wavelength_m"] / math.sqrt(max(square, LEAST_COSINE**2))}
    seen = compute_scatterers(motion, rcs.model_copy(update={"occlusion": False}), times, bisector_m, **chance)
    if not rcs.occlusion:
        return seen
    there, back = (View(motion, times, end).compute_sight_gain(seen.motion) for end in ends)
    return replace(seen, path_gain=np.sqrt(there * back))


def fill_ranges(
    spline: Spline, times: FloatArray, radar_position_m: npt.ArrayLike, range_m: FloatArray, approach_mps: FloatArray
) -> None:
    """Compute ranges and radial velocities of all points (E-03, E-04), both (I, P)."""
    origin = np.asarray(radar_position_m, dtype=np.float64)
    native.ranges_and_velocities(spline.values, spline.moments, spline.step_s, times, origin, range_m, approach_mps)


def fill_angles(
    spline: Spline, times: FloatArray, radar_position_m: npt.ArrayLike, values: Mapping[str, FloatArray]
) -> None:
    """Compute azimuth, elevation and, for an array, aspect of all points (E-04), (I, P)."""
    native.angles_of_sight(
        spline.values,
        spline.moments,
        spline.step_s,
        times,
        np.asarray(radar_position_m, dtype=np.float64),
        values["azimuth"],
        values["elevation"],
        ASPECT_MIN_SPEED_MPS,
        values.get("aspect"),
    )


def compute_body_track(target: PlacedTarget, scene: Scene, slow_time_s: npt.ArrayLike) -> LineOfSight:
    """Compute the line of sight of a target's body centre.

    It is evaluated at the pulse times; each array has the shape (I,), NaN while the body is away.

    Examples
    --------
    >>> import doppelgait as dg
    >>> scene = dg.Scene([dg.Target({"kind": "boulic", "speed_mps": 1.2}, label="human")], duration_s=3.0)
    >>> placed = dg.scene.place(scene)
    >>> track = dg.scene.compute_body_track(placed.targets[0], scene, [0.0, 1.0])
    >>> track.range_m.round(1)  # 1.2 m nearer after 1 s
    array([6.8, 5.6])
    """
    times = check_times(target.motion, np.asarray(slow_time_s, dtype=float))
    spline = fit_centre(target.motion)
    if scene.receiver_position_m is not None:
        seen = bistatic_line_of_sight(
            *spline.at(times),
            transmitter_position_m=scene.radar_position_m,
            receiver_position_m=scene.receiver_position_m,
        )
        return LineOfSight(*(np.where(target.is_there(times), part, np.nan) for part in vars(seen).values()))
    names = ("range", "radial_velocity", "aspect", "azimuth", "elevation")
    values = dict(zip(names, np.empty((len(names), times.size, 1)), strict=True))
    fill_ranges(spline, times, scene.radar_position_m, values["range"], values["radial_velocity"])
    fill_angles(spline, times, scene.radar_position_m, values)
    return LineOfSight(*(np.where(target.is_there(times), part[:, 0], np.nan) for part in values.values()))


def place_body_at(target: PlacedTarget, time_s: npt.ArrayLike) -> xr.DataArray:
    """Compute the points of a placed body at some times.

    Times count from the start of the scene; the result is float32 (time, marker, space), m.

    Examples
    --------
    >>> import doppelgait as dg
    >>> scene = dg.Scene([dg.Target({"kind": "boulic", "speed_mps": 1.2}, label="human")], duration_s=3.0)
    >>> target = dg.scene.place(scene).targets[0]
    >>> body = dg.scene.place_body_at(target, [0.0, 1.0])
    >>> body.sel(marker="head", space="z").values.round(1)  # height of the head, m
    array([1.7, 1.7], dtype=float32)
    """
    return place_points_at(target, time_s).label()


def place_points_at(target: PlacedTarget, time_s: npt.ArrayLike) -> Signal:
    """Compute the points of :func:`place_body_at` without labels."""
    times, motion = np.asarray(time_s, dtype=float), target.motion
    return describe_points(resample(motion, times)[0].astype(np.float32), times, motion.markers, motion.parts)
