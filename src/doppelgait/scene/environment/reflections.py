"""Echoes reflected by floor and wall (image method).

Each scatterer gets two added echoes: one with a single reflection (on the outward or the return
path), and one with a reflection on both paths.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator

from doppelgait._core import native
from doppelgait.core.config import FrozenModel
from doppelgait.core.errors import ConfigError, warn_caller
from doppelgait.core.labels import ScattererTable, maps_table
from doppelgait.core.plugins import plugin
from doppelgait.core.units import FloatArray, cosine, exponential, sine
from doppelgait.radar.link import MIN_RANGE_M
from doppelgait.scene.environment.materials import (
    Material,
    Mode,
    Polarisation,
    compute_te_share,
    interface_reflection,
    interpolate_coefficient,
    interpolate_modes,
    relative_permittivity,
    slab_reflection,
)
from doppelgait.scene.environment.registry import Setting

ComplexArray = npt.NDArray[np.complex128]

ONE_REFLECTION, TWO_REFLECTIONS = ":bounce", ":double_bounce"
ONE_GHOST, TWO_GHOSTS = ":ghost_mixed", ":ghost"
IMAGE_ENDINGS = (ONE_REFLECTION, TWO_REFLECTIONS, ONE_GHOST, TWO_GHOSTS)
"""Endings of marker and part names of added rows: a single reflection, or one on the outward and the return path."""


@dataclass(frozen=True)
class Mirror:
    """Reflecting plane, and the table rows that are images."""

    normal: tuple[float, float, float]
    radar_distance_m: float
    sources: tuple[int, ...]
    first: int


@dataclass(frozen=True)
class Rays:
    """Paths from the radar to points, relative to the radar; arrays (slow_time, scatterer)."""

    range_m: FloatArray
    velocity_mps: FloatArray
    x_m: FloatArray
    y_m: FloatArray
    z_m: FloatArray

    def along(self, azimuth_rad: float) -> FloatArray:
        """Project the points' positions on a horizontal direction."""
        return np.asarray(self.x_m * math.cos(azimuth_rad) + self.y_m * math.sin(azimuth_rad))


def make_direct_rays(scatterers: ScattererTable, *, effect: str) -> Rays:
    """Return the direct paths of a table."""
    if scatterers.attrs.get("bistatic", False):
        raise ConfigError(
            f"environment effect {effect!r} needs a monostatic radar; remove receiver_position_m from the scene, or "
            "remove this effect"
        )
    if "azimuth" not in scatterers or "elevation" not in scatterers:
        raise ConfigError(
            f"environment effect {effect!r} needs azimuth and elevation in the scatterer table; make it with "
            "assemble(scene, times, angles=True)"
        )
    names = ("range", "radial_velocity", "azimuth", "elevation")
    range_m, velocity_mps, azimuth_rad, elevation_rad = (
        np.asarray(scatterers[name], dtype=np.float64) for name in names
    )
    level_m = range_m * cosine(elevation_rad)
    return Rays(
        range_m,
        velocity_mps,
        level_m * cosine(azimuth_rad),
        level_m * sine(azimuth_rad),
        range_m * sine(elevation_rad),
    )


def rate_per_s(values: FloatArray, slow_time_s: FloatArray) -> FloatArray:
    """Differentiate along the first axis by central differences."""
    # the error is T^2/6 times the third derivative: for the heights of a walking person at 1 kHz it
    # has a median of 3e-6 m/s and reaches 2e-3 m/s at footfalls
    if slow_time_s.size < 2:
        return np.zeros_like(values)
    return np.asarray(np.gradient(values, slow_time_s, axis=0, edge_order=2 if slow_time_s.size > 2 else 1))


def compute_image_length(
    rays: Rays, *, radar_distance_m: float, target_distance_m: FloatArray, target_rate_mps: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Compute length and approach speed of paths with one reflection."""
    length_m = np.sqrt(rays.range_m**2 + 4.0 * radar_distance_m * target_distance_m)
    rate = -rays.range_m * rays.velocity_mps + 2.0 * radar_distance_m * target_rate_mps
    return length_m, -rate / np.maximum(length_m, 1e-12)


def find_originals(scatterers: ScattererTable) -> npt.NDArray[np.intp]:
    """Return indices of the rows that are not images. Images of images are not modelled."""
    rows = zip(scatterers["target"].tolist(), scatterers["marker"].tolist(), strict=True)
    return np.flatnonzero([target >= 0 or not str(marker).endswith(IMAGE_ENDINGS) for target, marker in rows])


def take(rays: Rays, columns: npt.NDArray[np.intp]) -> Rays:
    """Select some of the paths, in their order."""
    if columns.size == rays.range_m.shape[1]:  # sorted and without repetition: all columns
        return rays
    parts = (rays.range_m, rays.velocity_mps, rays.x_m, rays.y_m, rays.z_m)
    return Rays(*(part[:, columns] for part in parts))


def add_images(
    scatterers: ScattererTable,
    columns: npt.NDArray[np.intp],
    *,
    direct: Rays,
    image: Rays,
    reflection: ComplexArray,
    endings: tuple[str, str],
    plane: tuple[tuple[float, float, float], float],
) -> ScattererTable:
    """Append the echoes with one and with two reflections."""
    if "path_phase" not in scatterers:
        scatterers = scatterers.replace(path_phase=np.zeros(scatterers.shape))
    (n_pulses, n_rows), n_images = scatterers.shape, columns.size
    first, second = slice(n_rows, n_rows + n_images), slice(n_rows + n_images, None)
    values: dict[str, FloatArray] = {}
    for name, before in scatterers.values.items():
        values[name] = whole = np.empty((n_pulses, n_rows + 2 * n_images))
        whole[:, :n_rows] = before
        whole[:, first] = whole[:, second] = np.nan if name == "aspect" else before[:, columns]
    rays = [list(vars(part).values()) for part in (direct, image)]
    new = [values[name] for name in ("range", "radial_velocity", "azimuth", "elevation", "path_gain", "path_phase")]
    native.fill_images(*rays, reflection.real, reflection.imag, MIN_RANGE_M, n_rows, new)
    named = {}
    for name, column in scatterers.columns.items():
        rows = [column[columns]] * 2
        if name == "target":
            rows = [np.minimum(column[columns], -1)] * 2  # a background body's images stay in the background
        elif name in ("marker", "part"):
            rows = [np.char.add(column[columns].astype(str), ending) for ending in endings]
        named[name] = np.concatenate([column, *rows])
    mirrors = (*scatterers.attrs.get("mirrors", ()), Mirror(*plane, tuple(columns.tolist()), n_rows))
    return ScattererTable(scatterers.slow_time_s, values, named, {**scatterers.attrs, "mirrors": mirrors})


class GroundBounce(FrozenModel):
    """Flat reflecting floor at z = 0.

    material: Name of a material of Recommendation ITU-R P.2040, or ``{ permittivity,
        conductivity_s_per_m }``; the thickness is assumed infinite.
    roughness_m: Standard deviation of the floor's height, 0 (smooth) to 1 m.
    polarisation: Polarisation of the radar's field.
    """

    kind: Literal["ground_bounce"] = "ground_bounce"
    material: Material = "concrete"
    roughness_m: float = Field(default=0.0, ge=0, le=1)
    polarisation: Polarisation = "vertical"


@plugin("environment", parameters=GroundBounce, needs_angles=True, makes_images=True, is_smooth=True)
@maps_table
def apply_ground_bounce(scatterers: ScattererTable, spec: GroundBounce, setting: Setting) -> ScattererTable:
    """Add two floor echoes for every scatterer.

    Parameters
    ----------
    scatterers : Dataset (slow_time, scatterer)
        With angles. Rows that are images already get none.
    setting : Setting
        Position of the radar, above the floor.

    Returns
    -------
    Dataset
        The rows ``...:bounce`` are added at the apparent range (R + g)/2 (one path direct, the other by the floor), and
        ``...:double_bounce`` at g, with g = sqrt(R^2 + 4 h_r h) and the heights h_r and h of radar and scatterer (0
        below the floor). Every bounce multiplies the field by Gamma exp(-2 (k s sin gamma)^2): Fresnel's coefficient
        at the grazing angle gamma, sin gamma = (h_r + h)/g, and the coherent reflection of a floor with roughness s
        (Ament 1953). Radial velocities are -d(range)/dt; the rate of h is that of :func:`rate_per_s`.

    Raises
    ------
    ConfigError
        If the table has no angles or is bistatic, or the radar does not stand above the floor.
    """
    height_m = float(setting.radar_position_m[2])
    if not height_m > 0:
        raise ConfigError(
            f"environment effect {spec.kind!r}: the radar is at a height of {height_m:g} m; it must be above the floor "
            "at z = 0: raise radar_position_m[2]"
        )
    columns = find_originals(scatterers)
    direct = take(make_direct_rays(scatterers, effect=spec.kind), columns)
    above_m = np.maximum(height_m + direct.z_m, 0.0)
    length_m, velocity_mps = compute_image_length(
        direct,
        radar_distance_m=height_m,
        target_distance_m=above_m,
        target_rate_mps=rate_per_s(above_m, scatterers.slow_time_s),
    )
    down_m = height_m + above_m
    return add_images(
        scatterers,
        columns,
        direct=direct,
        image=Rays(length_m, velocity_mps, direct.x_m, direct.y_m, -down_m),
        reflection=compute_floor_reflection(np.minimum(down_m / length_m, 1.0), spec, setting.wavelength_m),
        endings=(ONE_REFLECTION, TWO_REFLECTIONS),
        plane=((0.0, 0.0, 1.0), height_m),
    )


def compute_floor_reflection(sin_grazing: FloatArray, spec: GroundBounce, wavelength_m: float) -> ComplexArray:
    """Compute the coefficient of a bounce off a rough floor."""
    # it is Fresnel's coefficient at the sine of the grazing angle (0 to 1) times the roughness
    # factor
    permittivity = relative_permittivity(spec.material, wavelength_m=wavelength_m)
    mode: Mode = "tm" if spec.polarisation == "vertical" else "te"
    smooth = interpolate_coefficient(
        lambda sine: interface_reflection(sine, permittivity=permittivity, mode=mode), sin_grazing
    )
    swing = 2.0 * np.pi / wavelength_m * spec.roughness_m * sin_grazing
    return np.asarray(smooth * exponential(-2.0 * swing**2))


class WallGhost(FrozenModel):
    """Vertical, flat, infinite reflecting wall.

    Its position is either ``side_m``, or ``position_m`` and ``normal_azimuth_deg``.

    material: Name of a material of Recommendation ITU-R P.2040, or ``{ permittivity,
        conductivity_s_per_m }``.
    thickness_m: Thickness of the wall, above 0, up to 5 m.
    side_m: Distance from the radar of a wall parallel to the boresight. Set either this, or
        ``position_m`` and ``normal_azimuth_deg``.
    side: Side of the wall at ``side_m``, looking along the boresight.
    position_m: Ground position of any point of the wall.
    normal_azimuth_deg: Azimuth of either normal of the wall at ``position_m``, from +x towards +y.
    polarisation: Polarisation of the radar's field.
    """

    kind: Literal["wall_ghost"] = "wall_ghost"
    material: Material
    thickness_m: float = Field(gt=0, le=5)
    side_m: float | None = Field(default=None, gt=0, le=1e5)
    side: Literal["left", "right"] = "left"
    position_m: tuple[float, float] | None = None
    normal_azimuth_deg: float | None = Field(default=None, ge=-360, le=360)
    polarisation: Polarisation = "vertical"

    @model_validator(mode="after")
    def _check_place(self) -> WallGhost:
        if (self.position_m is None) != (self.normal_azimuth_deg is None):
            raise ValueError("position_m and normal_azimuth_deg belong together: give both or neither")
        if (self.side_m is None) == (self.position_m is None):
            raise ValueError("set either side_m (with side), or position_m and normal_azimuth_deg")
        return self


@plugin("environment", parameters=WallGhost, needs_angles=True, makes_images=True, is_smooth=True)
@maps_table
def apply_wall_ghost(scatterers: ScattererTable, spec: WallGhost, setting: Setting) -> ScattererTable:
    """Add two wall echoes for every scatterer.

    Only scatterers on the radar's side of the wall have wall echoes.

    Parameters
    ----------
    scatterers : Dataset (slow_time, scatterer)
        With angles. Rows that are images already get none.

    Returns
    -------
    Dataset
        The rows ``...:ghost_mixed`` are added at the apparent range (R + g)/2 (one path direct, the
        other by the wall), and ``...:ghost`` at g, the distance of the mirror image: g = sqrt(R^2 +
        4 h_r h), with the distances h_r and h of radar and scatterer from the wall. Every
        reflection multiplies the field by the slab's coefficient at its angle of incidence, cos =
        (h_r + h)/g. Radial velocities are -d(range)/dt; the rate of h is that of
        :func:`rate_per_s`. While a scatterer is behind the wall, the gain of its ghosts is 0.

    Raises
    ------
    ConfigError
        If the table has no angles or is bistatic, or the wall passes through the radar.

    Warns
    -----
    DoppelgaitWarning
        If a scatterer crosses the wall.
    """
    normal_rad, radar_distance_m = find_wall_plane(spec, setting)
    rows = find_originals(scatterers)
    direct = take(make_direct_rays(scatterers, effect=spec.kind), rows)
    from_wall_m = radar_distance_m - direct.along(normal_rad)
    seen = (from_wall_m > 0).any(axis=0)
    crosses = seen & ~(from_wall_m > 0).all(axis=0)
    if crosses.any():
        number = int(np.flatnonzero(crosses)[0])
        first = int(np.flatnonzero((from_wall_m[:, number] > 0) != (from_wall_m[0, number] > 0))[0])
        name = scatterers["marker"][rows[number]]
        warn_caller(
            f"wall_ghost: {int(crosses.sum())} of {crosses.size} scatterers cross the wall, first {name} at "
            f"{float(scatterers.slow_time_s[first]):.2f} s; they have no ghost while they are behind it. "
            "Move the wall or the target"
        )
    rows, direct, from_wall_m = rows[seen], take(direct, np.flatnonzero(seen)), from_wall_m[:, seen]
    length_m, velocity_mps = compute_image_length(
        direct,
        radar_distance_m=radar_distance_m,
        target_distance_m=from_wall_m,
        target_rate_mps=rate_per_s(from_wall_m, scatterers.slow_time_s),
    )
    image = Rays(
        length_m,
        velocity_mps,
        x_m=direct.x_m + 2.0 * math.cos(normal_rad) * from_wall_m,
        y_m=direct.y_m + 2.0 * math.sin(normal_rad) * from_wall_m,
        z_m=direct.z_m,
    )
    toward_m = image.along(normal_rad)
    cosine = np.clip(toward_m / np.maximum(image.range_m, 1e-12), 0.0, 1.0)
    permittivity = relative_permittivity(spec.material, wavelength_m=setting.wavelength_m)
    slab = {"thickness_m": spec.thickness_m, "wavelength_m": setting.wavelength_m}
    te, tm = interpolate_modes(slab_reflection, cosine, permittivity=permittivity, **slab)
    share = compute_te_share(toward_m, image.along(normal_rad + math.pi / 2), image.z_m)
    reflection = te * share - tm * (1.0 - share) if spec.polarisation == "vertical" else tm * share - te * (1.0 - share)
    reflection = np.where(from_wall_m > 0, reflection, 0.0)
    normal = (-math.cos(normal_rad), -math.sin(normal_rad), 0.0)
    return add_images(
        scatterers,
        rows,
        direct=direct,
        image=image,
        reflection=reflection,
        endings=(ONE_GHOST, TWO_GHOSTS),
        plane=(normal, radar_distance_m),
    )


def find_wall_plane(spec: WallGhost, setting: Setting) -> tuple[float, float]:
    """Compute a wall's normal azimuth (rad) and distance (m)."""
    if spec.side_m is not None:
        turn = math.pi / 2 if spec.side == "left" else -math.pi / 2
        return setting.radar_azimuth_rad + turn, spec.side_m
    normal_rad = math.radians(spec.normal_azimuth_deg or 0.0)
    x_m, y_m = spec.position_m or (0.0, 0.0)
    place = (x_m - setting.radar_position_m[0], y_m - setting.radar_position_m[1])
    distance_m = place[0] * math.cos(normal_rad) + place[1] * math.sin(normal_rad)
    if abs(distance_m) < 1e-3:
        raise ConfigError(
            f"environment effect {spec.kind!r}: the wall at position_m = [{x_m:g}, {y_m:g}] with normal_azimuth_deg = "
            f"{spec.normal_azimuth_deg:g} passes through the radar; move one of them"
        )
    return (normal_rad, distance_m) if distance_m > 0 else (normal_rad + math.pi, -distance_m)
