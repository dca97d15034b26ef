"""Scene -> scatterer table at the radar's pulse times: ranges, radial velocities and aspects (E-03 to E-05)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.core.labels import SCATTERER_VARIABLES, axis
from doppelgait.motion.retime import check_times, fit_centre, fit_spline, resample
from doppelgait.scene.scatterers import scatterers_of
from doppelgait.scene.target import Scene, Target, placed_motion

FloatArray = npt.NDArray[np.float64]

ASPECT_MIN_SPEED_MPS = 0.05
"""Below this speed a scatterer has no direction of motion, hence no aspect angle (E-04)."""


@dataclass(frozen=True)
class LineOfSight:
    """Geometry of points seen from the radar; every array has the shape of the points' leading axes."""

    range_m: FloatArray
    radial_velocity_mps: FloatArray
    aspect_rad: FloatArray
    azimuth_rad: FloatArray
    elevation_rad: FloatArray


def line_of_sight(position_m: FloatArray, velocity_mps: FloatArray, radar_position_m: npt.ArrayLike) -> LineOfSight:
    """Range, radial velocity and angles of moving points as seen from the radar.

    Parameters
    ----------
    position_m, velocity_mps : ndarray, shape (..., 3)
    radar_position_m : array_like, shape (3,)

    Returns
    -------
    LineOfSight
        Range R = |x - p| (E-03); radial velocity -dR/dt = -v . u, positive when approaching (E-04); aspect angle from
        cos(psi) = -(v . u) / |v|, 0 = approaching, NaN below 0.05 m/s; azimuth from +x towards +y; elevation up.
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
        aspect_rad=np.arccos(np.clip(cosine, -1.0, 1.0)),
        azimuth_rad=np.arctan2(sight[..., 1], sight[..., 0]),
        elevation_rad=np.arcsin(np.clip(unit[..., 2], -1.0, 1.0)),
    )


def assemble(
    scene: Scene, slow_time_s: npt.ArrayLike, *, angles: bool = True, rng: np.random.Generator | None = None
) -> xr.Dataset:
    """Scatterer table of all targets of a scene.

    Parameters
    ----------
    scene : Scene
    slow_time_s : array_like, shape (I,)
        Pulse times from the start of the scene.
    angles : bool
        Whether aspect, azimuth and elevation are in the table; they cost most of its time.
    rng : numpy.random.Generator, optional
        Needed where a target's radar cross section fluctuates or has a spread; not touched by those that do not.

    Returns
    -------
    Dataset (slow_time, scatterer)
        The variables of :data:`doppelgait.core.labels.SCATTERER_VARIABLES`, with ``target`` (number), ``marker`` and
        ``part`` of every scatterer.

    Raises
    ------
    MotionError
        If a motion does not cover the times.
    ConfigError
        If a radar cross section needs ``rng`` or joints that are not there.
    """
    return observe(scene, slow_time_s, angles=angles, rng=rng)[0]


def observe(
    scene: Scene, slow_time_s: npt.ArrayLike, *, angles: bool = True, rng: np.random.Generator | None = None
) -> tuple[xr.Dataset, list[LineOfSight]]:
    """Scatterer table of all targets (:func:`assemble`) and the line of sight of every target's body centre."""
    times = np.asarray(slow_time_s, dtype=float)
    motions = [placed_motion(target, scene) for target in scene.targets]
    tables = [_target_table(m, n, scene, times, angles, rng) for n, m in enumerate(motions)]
    table = tables[0] if len(tables) == 1 else xr.concat(tables, dim="scatterer", combine_attrs="override")
    return table, [_centre_track(motion, scene, times) for motion in motions]


def _target_table(
    motion: xr.DataArray, number: int, scene: Scene, times: FloatArray, angles: bool, rng: np.random.Generator | None
) -> xr.Dataset:
    scatterers = scatterers_of(motion, scene.targets[number].rcs_spec, times, scene.radar_position_m, rng=rng)
    range_m, approach_mps = ranges_and_velocities(scatterers.motion, times, scene.radar_position_m)
    parts = [str(part) for part in axis(scatterers.motion, "part")]
    values = {
        "range": range_m,
        "radial_velocity": approach_mps,
        "rcs": np.broadcast_to(scatterers.rcs_m2, range_m.shape),
        "path_gain": np.broadcast_to(scatterers.path_gain, range_m.shape),
    }
    if angles:
        sight = line_of_sight(*resample(scatterers.motion, times), scene.radar_position_m)
        values |= {"aspect": sight.aspect_rad, "azimuth": sight.azimuth_rad, "elevation": sight.elevation_rad}
    dims = ("slow_time", "scatterer")
    return xr.Dataset(
        {name: (dims, values[name], {"units": unit}) for name, unit in SCATTERER_VARIABLES.items() if name in values},
        coords={
            "slow_time": ("slow_time", times, {"units": "s"}),
            "target": ("scatterer", np.full(len(parts), number)),
            "marker": ("scatterer", axis(scatterers.motion, "marker").astype(str)),
            "part": ("scatterer", np.array(parts)),
        },
    )


def ranges_and_velocities(
    motion: xr.DataArray, time_s: npt.ArrayLike, radar_position_m: npt.ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Range and radial velocity (positive approaching) of every point at the given times, both (I, P) (E-03, E-04).

    Raises
    ------
    MotionError
        If the motion does not cover the times.
    """
    from doppelgait.core.kernels import spline as kernel

    spline, times = fit_spline(motion), check_times(motion, time_s)
    range_m = np.empty((times.size, motion.sizes["marker"]))
    approach_mps = np.empty_like(range_m)
    origin = np.asarray(radar_position_m, dtype=np.float64)
    kernel.ranges_and_velocities(spline.values, spline.moments, spline.step_s, times, origin, range_m, approach_mps)
    return range_m, approach_mps


def body_track(target: Target, scene: Scene, slow_time_s: npt.ArrayLike) -> LineOfSight:
    """Line of sight of the target's body centre at the pulse times, each array of shape (I,)."""
    return _centre_track(placed_motion(target, scene), scene, np.asarray(slow_time_s, dtype=float))


def _centre_track(motion: xr.DataArray, scene: Scene, times: FloatArray) -> LineOfSight:
    return line_of_sight(*fit_centre(motion).at(check_times(motion, times)), scene.radar_position_m)
