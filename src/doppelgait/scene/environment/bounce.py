"""Echoes by way of the floor: one bounce on the way there or back, or one on both (image method)."""

from __future__ import annotations

from typing import Literal

import numpy as np
import xarray as xr
from pydantic import Field

from doppelgait.core.config import FrozenModel
from doppelgait.core.errors import ConfigError
from doppelgait.core.labels import axis
from doppelgait.core.plugins import plugin
from doppelgait.scene.environment.materials import Material, relative_permittivity
from doppelgait.scene.environment.rays import (
    ONE_REFLECTION,
    TWO_REFLECTIONS,
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
from doppelgait.scene.environment.slab import Mode, Polarisation, interface_reflection, sampled


class GroundBounce(FrozenModel):
    """A flat floor at z = 0 that reflects.

    Parameters
    ----------
    material : str or table
        Name of a material of Recommendation ITU-R P.2040, or ``{ permittivity, conductivity_s_per_m }``; its
        thickness is taken as infinite.
    roughness_m : float
        Standard deviation of the floor's height, 0 (smooth) to 1 m.
    polarisation : {"vertical", "horizontal"}
        Of the radar's field.
    """

    kind: Literal["ground_bounce"] = "ground_bounce"
    material: Material = "concrete"
    roughness_m: float = Field(default=0.0, ge=0, le=1)
    polarisation: Polarisation = "vertical"


@plugin("environment", parameters=GroundBounce, needs_angles=True, makes_images=True)
def apply_ground_bounce(scatterers: xr.Dataset, spec: GroundBounce, setting: Setting) -> xr.Dataset:
    """Table with two echoes by the floor added for every scatterer.

    Parameters
    ----------
    scatterers : Dataset (slow_time, scatterer)
        With angles. Rows that are images already get none.
    spec : GroundBounce
    setting : Setting
        The radar stands above the floor.

    Returns
    -------
    Dataset
        With rows ``...:bounce`` at apparent range (R + g)/2, direct one way and by the floor the other, and
        ``...:double_bounce`` at g; g = sqrt(R^2 + 4 h_r h), h_r and h the heights of radar and scatterer (below the
        floor: 0). Every bounce multiplies the field by Gamma exp(-2 (k s sin gamma)^2): Fresnel's coefficient
        at the grazing angle gamma, sin gamma = (h_r + h)/g, and the coherent part of what a floor of roughness s
        reflects (Ament 1953). Radial velocities are -d(range)/dt, the rate of h by :func:`rays.rate_per_s`.

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
    columns = originals(scatterers)
    direct = take(direct_rays(scatterers, effect=spec.kind), columns)
    image, sin_grazing = _below_the_floor(direct, height_m, axis(scatterers, "slow_time"))
    return add_images(
        scatterers,
        columns,
        direct=direct,
        image=image,
        reflection=floor_reflection(sin_grazing, spec, setting.wavelength_m),
        endings=(ONE_REFLECTION, TWO_REFLECTIONS),
    )


def floor_reflection(sin_grazing: FloatArray, spec: GroundBounce, wavelength_m: float) -> ComplexArray:
    """Coefficient of a bounce at the sine of the grazing angle, 0 to 1: Fresnel's times that of the roughness."""
    permittivity = relative_permittivity(spec.material, wavelength_m=wavelength_m)
    mode: Mode = "tm" if spec.polarisation == "vertical" else "te"
    smooth = sampled(lambda sine: interface_reflection(sine, permittivity=permittivity, mode=mode), sin_grazing)
    swing = 2.0 * np.pi / wavelength_m * spec.roughness_m * sin_grazing
    return np.asarray(smooth * np.exp(-2.0 * swing**2))


def _below_the_floor(direct: Rays, radar_height_m: float, slow_time_s: FloatArray) -> tuple[Rays, FloatArray]:
    """Mirror images, and the sines of their grazing angles."""
    height_m = np.maximum(radar_height_m + direct.z_m, 0.0)
    length_m, velocity_mps = image_length(
        direct,
        radar_distance_m=radar_height_m,
        target_distance_m=height_m,
        target_rate_mps=rate_per_s(height_m, slow_time_s),
    )
    down_m = radar_height_m + height_m
    return Rays(length_m, velocity_mps, direct.x_m, direct.y_m, -down_m), np.minimum(down_m / length_m, 1.0)
