"""Ghosts: echoes by way of an upright wall beside the scene (image method)."""

from __future__ import annotations

import math
import warnings
from typing import Literal

import numpy as np
import xarray as xr
from pydantic import Field, model_validator

from doppelgait.core.config import FrozenModel
from doppelgait.core.errors import ConfigError, DoppelgaitWarning
from doppelgait.core.labels import axis
from doppelgait.core.plugins import plugin
from doppelgait.scene.environment.materials import Material, relative_permittivity
from doppelgait.scene.environment.rays import (
    ONE_GHOST,
    TWO_GHOSTS,
    ComplexArray,
    FloatArray,
    Rays,
    add_images,
    direct_rays,
    image_length,
    originals,
    rate_per_s,
    take,
)
from doppelgait.scene.environment.registry import Setting
from doppelgait.scene.environment.slab import Polarisation, sampled, slab_reflection, te_share


class WallGhost(FrozenModel):
    """An upright, flat, endless wall that reflects. Either ``side_m``, or ``position_m`` and ``normal_azimuth_deg``.

    Parameters
    ----------
    material : str or table
        Name of a material of Recommendation ITU-R P.2040, or ``{ permittivity, conductivity_s_per_m }``.
    thickness_m : float
        Above 0, up to 5 m.
    side_m : float, optional
        Distance of a wall along the boresight from the radar ...
    side : {"left", "right"}
        ... and the side on which it is, looking along the boresight.
    position_m : (float, float), optional
        Ground position of any point of the wall ...
    normal_azimuth_deg : float, optional
        ... and azimuth of its normal, from +x towards +y; which of the two normals does not matter.
    polarisation : {"vertical", "horizontal"}
        Of the radar's field.
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
    def _one_place(self) -> WallGhost:
        if (self.position_m is None) != (self.normal_azimuth_deg is None):
            raise ValueError("position_m and normal_azimuth_deg belong together: give both or neither")
        if (self.side_m is None) == (self.position_m is None):
            raise ValueError("give either side_m (with side), or position_m and normal_azimuth_deg")
        return self


@plugin("environment", parameters=WallGhost, needs_angles=True, makes_images=True)
def apply_wall_ghost(scatterers: xr.Dataset, spec: WallGhost, setting: Setting) -> xr.Dataset:
    """Table with two echoes by the wall added for every scatterer on the radar's side of it.

    Parameters
    ----------
    scatterers : Dataset (slow_time, scatterer)
        With angles. Rows that are images already get none.
    spec : WallGhost
    setting : Setting

    Returns
    -------
    Dataset
        With rows ``...:ghost_mixed`` at apparent range (R + g)/2, direct one way and by the wall the other, and
        ``...:ghost`` at g, the distance of the mirror image: g = sqrt(R^2 + 4 h_r h), h_r and h the distances of radar
        and scatterer from the wall. Every reflection multiplies the field by the slab's coefficient at its
        angle of incidence, cos = (h_r + h)/g. Radial velocities are -d(range)/dt, the rate of h by
        :func:`rays.rate_per_s`. While a scatterer is behind the wall, its ghosts have no gain.

    Raises
    ------
    ConfigError
        If the table has no angles or is bistatic, or the wall goes through the radar.

    Warns
    -----
    DoppelgaitWarning
        If a scatterer crosses the wall.
    """
    normal_rad, radar_distance_m = wall_plane(spec, setting)
    rows = originals(scatterers)
    direct = take(direct_rays(scatterers, effect=spec.kind), rows)
    from_wall_m = radar_distance_m - direct.along(normal_rad)
    seen = (from_wall_m > 0).any(axis=0)
    _warn_of_crossing(scatterers, rows, from_wall_m)
    rows, direct, from_wall_m = rows[seen], take(direct, np.flatnonzero(seen)), from_wall_m[:, seen]
    image = _mirror(direct, normal_rad, radar_distance_m, from_wall_m, axis(scatterers, "slow_time"))
    reflection = wall_reflection(image, normal_rad, spec, setting.wavelength_m)
    reflection = np.where(from_wall_m > 0, reflection, 0.0)
    return add_images(
        scatterers, rows, direct=direct, image=image, reflection=reflection, endings=(ONE_GHOST, TWO_GHOSTS)
    )


def wall_plane(spec: WallGhost, setting: Setting) -> tuple[float, float]:
    """Azimuth in rad of the normal from the radar to the wall, and the distance between them in m.

    Raises
    ------
    ConfigError
        If the wall goes through the radar.
    """
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
            f"{spec.normal_azimuth_deg:g} goes through the radar; move one of them"
        )
    return (normal_rad, distance_m) if distance_m > 0 else (normal_rad + math.pi, -distance_m)


def wall_reflection(image: Rays, normal_rad: float, spec: WallGhost, wavelength_m: float) -> ComplexArray:
    """Co-polar coefficient of the wall for the paths to mirror images.

    The share w of the power that meets the wall in te mode (:func:`slab.te_share`) gives r_te w - r_tm (1 - w) for
    vertical polarisation and r_tm w - r_te (1 - w) for horizontal, whose field is counted along rising azimuth; what
    turns into the other polarisation is lost.
    """
    permittivity = relative_permittivity(spec.material, wavelength_m=wavelength_m)
    toward_m = image.along(normal_rad)
    cosine = np.clip(toward_m / np.maximum(image.range_m, 1e-12), 0.0, 1.0)
    slab = {"thickness_m": spec.thickness_m, "wavelength_m": wavelength_m}
    te = sampled(lambda c: slab_reflection(c, permittivity=permittivity, mode="te", **slab), cosine, **slab)
    tm = sampled(lambda c: slab_reflection(c, permittivity=permittivity, mode="tm", **slab), cosine, **slab)
    share = te_share(toward_m, image.along(normal_rad + math.pi / 2), image.z_m)
    return te * share - tm * (1.0 - share) if spec.polarisation == "vertical" else tm * share - te * (1.0 - share)


def _mirror(
    direct: Rays, normal_rad: float, radar_distance_m: float, from_wall_m: FloatArray, slow_time_s: FloatArray
) -> Rays:
    length_m, velocity_mps = image_length(
        direct,
        radar_distance_m=radar_distance_m,
        target_distance_m=from_wall_m,
        target_rate_mps=rate_per_s(from_wall_m, slow_time_s),
    )
    return Rays(
        range_m=length_m,
        velocity_mps=velocity_mps,
        x_m=direct.x_m + 2.0 * math.cos(normal_rad) * from_wall_m,
        y_m=direct.y_m + 2.0 * math.sin(normal_rad) * from_wall_m,
        z_m=direct.z_m,
    )


def _warn_of_crossing(scatterers: xr.Dataset, rows: np.ndarray, from_wall_m: FloatArray) -> None:
    before = from_wall_m > 0
    crosses = before.any(axis=0) & ~before.all(axis=0)
    if not crosses.any():
        return
    number = int(np.flatnonzero(crosses)[0])
    time_s = float(axis(scatterers, "slow_time")[int(np.flatnonzero(before[:, number] != before[0, number])[0])])
    name = axis(scatterers, "marker")[rows[number]]
    warnings.warn(
        f"wall_ghost: {int(crosses.sum())} of {crosses.size} scatterers cross the wall, {name} first seen to at "
        f"{time_s:.2f} s; they have no ghost while they are behind it. Move the wall or the target",
        DoppelgaitWarning,
        stacklevel=3,
    )
