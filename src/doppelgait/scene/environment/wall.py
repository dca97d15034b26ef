"""Wall before the targets: loss, delay and phase."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
import xarray as xr
from pydantic import Field, model_validator

from doppelgait.core.config import FrozenModel
from doppelgait.core.errors import warn_caller
from doppelgait.core.labels import read_axis, replace_values
from doppelgait.core.plugins import plugin
from doppelgait.core.units import db_to_power
from doppelgait.radar.link import MIN_RANGE_M
from doppelgait.scene.environment.materials import (
    Material,
    Polarisation,
    compute_slab_spreading,
    compute_te_share,
    insertion_coefficient,
    interpolate_coefficient,
    relative_permittivity,
    slab_delay_m,
)
from doppelgait.scene.environment.reflections import (
    ComplexArray,
    FloatArray,
    make_direct_rays,
    rate_per_s,
    read_path_phase,
)
from doppelgait.scene.environment.registry import Setting


class Wall(FrozenModel):
    """Upright, flat, endless wall, of a material or as measured.

    Parameters
    ----------
    material : str or table, optional
        Name of a material of Recommendation ITU-R P.2040, or ``{ permittivity, conductivity_s_per_m }``; needs
        ``thickness_m``.
    thickness_m : float, optional
        Thickness of the material, above 0, up to 5 m.
    loss_db : float, optional
        Measured loss of one crossing at any angle, 0 to 300 dB, instead of material and thickness.
    delay_m : float, optional
        Increase of the path length by one crossing, 0 (default) to 20 m; only with ``loss_db``.
    range_m : float, optional
        Distance of the wall from the radar along its normal; by default it is between the radar and everything.
    normal_azimuth_deg : float, optional
        Azimuth of the normal, from +x towards +y; by default that of the boresight.
    polarisation : {"vertical", "horizontal"}
        Polarisation of the radar's field.
    """

    kind: Literal["wall"] = "wall"
    material: Material | None = None
    thickness_m: float | None = Field(default=None, gt=0, le=5)
    loss_db: float | None = Field(default=None, ge=0, le=300)
    delay_m: float | None = Field(default=None, ge=0, le=20)
    range_m: float | None = Field(default=None, gt=0, le=1e5)
    normal_azimuth_deg: float | None = Field(default=None, ge=-360, le=360)
    polarisation: Polarisation = "vertical"

    @model_validator(mode="after")
    def _check_choice(self) -> Wall:
        made = self.material is not None or self.thickness_m is not None
        measured = self.loss_db is not None or self.delay_m is not None
        if made == measured:
            raise ValueError("give either material and thickness_m, or loss_db (with delay_m)")
        if made and (self.material is None or self.thickness_m is None):
            raise ValueError("material and thickness_m belong together: give both")
        if measured and self.loss_db is None:
            raise ValueError("delay_m needs loss_db, which may be 0")
        return self


def wall_needs_angles(spec: Wall) -> bool:
    """Return True if the direction of a scatterer matters.

    It does not for a measured wall in front of everything.
    """
    return spec.range_m is not None or spec.material is not None


@plugin("environment", parameters=Wall, needs_angles=wall_needs_angles, is_smooth=True)
def apply_wall(scatterers: xr.Dataset, spec: Wall, setting: Setting) -> xr.Dataset:
    """Weaken and delay the scatterers behind the wall.

    Parameters
    ----------
    scatterers : Dataset (slow_time, scatterer)
        With angles where :func:`wall_needs_angles`.
    spec : Wall
    setting : Setting

    Returns
    -------
    Dataset
        ``path_gain`` times |T|^4, T the insertion coefficient of the slab (:func:`insertion_coefficient`) at the
        angle of the straight line to the scatterer; ``range`` plus the delay of one crossing
        (:func:`slab_delay_m`), ``radial_velocity`` minus its rate. The range carries -4 pi / lambda times that
        delay into the phase of the echo; ``path_phase`` gets the rest, so that the whole phase is that of T^2.
        A measured wall has no rest. Spreading goes with the geometrical path, a little less in the slab
        (:func:`compute_slab_spreading`): ``path_gain`` makes up for the delay, which the radar equation takes for
        distance. Scatterers in front are as they were.

    Raises
    ------
    ConfigError
        If the table lacks angles that are needed, or is bistatic and they are needed.

    Notes
    -----
    T is taken at the carrier: echoes from inside the slab change the level, but do not show as further ranges. The ray
    that really reaches a scatterer is shifted by the refraction; by Fermat's principle that is of second order in
    thickness over range.
    """
    if not wall_needs_angles(spec):
        return _apply_measured(scatterers, spec, np.True_)
    direct = make_direct_rays(scatterers, effect=spec.kind)
    normal_rad = setting.radar_azimuth_rad
    if spec.normal_azimuth_deg is not None:
        normal_rad = math.radians(spec.normal_azimuth_deg)
    toward_m = direct.along(normal_rad)
    behind = toward_m > (spec.range_m if spec.range_m is not None else -math.inf)
    if (behind.any(axis=0) & ~behind.all(axis=0)).any():
        warn_caller(
            f"wall at {spec.range_m} m: a scatterer is in front of it at one time and behind it at another; its range "
            "and level jump there; move the wall or the target"
        )
    if spec.material is None:
        return _apply_measured(scatterers, spec, behind)
    permittivity = relative_permittivity(spec.material, wavelength_m=setting.wavelength_m)
    cosine = np.minimum(np.abs(toward_m) / np.maximum(direct.range_m, 1e-12), 1.0)
    share = compute_te_share(toward_m, direct.along(normal_rad + math.pi / 2), direct.z_m)
    through = compute_wall_insertion(
        cosine, vertical_te=share, permittivity=permittivity, spec=spec, wavelength_m=setting.wavelength_m
    )
    delay_m = slab_delay_m(cosine, permittivity=permittivity, thickness_m=spec.thickness_m or 0.0)
    rest_rad = np.angle(through) + 2.0 * np.pi / setting.wavelength_m * delay_m
    rest_rad = 2.0 * ((rest_rad + np.pi) % (2.0 * np.pi) - np.pi)
    gain = (through.real**2 + through.imag**2) ** 2 * compute_slab_spreading(
        cosine, scatterers["range"].values, permittivity=permittivity, thickness_m=spec.thickness_m or 0.0
    )
    delayed = _lengthen(scatterers, delay_m, rate_per_s(delay_m, read_axis(scatterers, "slow_time")), behind)
    return replace_values(
        delayed,
        path_gain=delayed["path_gain"].values * np.where(behind, gain, 1.0),
        path_phase=read_path_phase(scatterers) + np.where(behind, rest_rad, 0.0),
    )


def compute_wall_insertion(
    cos_incidence: FloatArray, *, vertical_te: FloatArray, permittivity: complex, spec: Wall, wavelength_m: float
) -> ComplexArray:
    """Compute the co-polar insertion coefficient of an upright slab.

    T_te w + T_tm (1 - w), w = ``vertical_te``.

    ``vertical_te`` is that of :func:`compute_te_share`. For horizontal polarisation w and 1 - w change places. What
    turns into the other polarisation is lost.
    """
    slab = {"thickness_m": spec.thickness_m or 0.0, "wavelength_m": wavelength_m}
    te = interpolate_coefficient(
        lambda c: insertion_coefficient(c, permittivity=permittivity, mode="te", **slab), cos_incidence, **slab
    )
    tm = interpolate_coefficient(
        lambda c: insertion_coefficient(c, permittivity=permittivity, mode="tm", **slab), cos_incidence, **slab
    )
    share = vertical_te if spec.polarisation == "vertical" else 1.0 - vertical_te
    return np.asarray(te * share + tm * (1.0 - share))


def _apply_measured(scatterers: xr.Dataset, spec: Wall, behind: np.ndarray | np.bool_) -> xr.Dataset:
    gain = float(db_to_power(-2.0 * (spec.loss_db or 0.0)))
    delayed = _lengthen(scatterers, np.asarray(spec.delay_m or 0.0), np.asarray(0.0), behind)
    return replace_values(delayed, path_gain=delayed["path_gain"].values * np.where(behind, gain, 1.0))


def _lengthen(
    scatterers: xr.Dataset, delay_m: FloatArray, rate_mps: FloatArray, behind: np.ndarray | np.bool_
) -> xr.Dataset:
    """Lengthen the delay of paths, not their spreading."""
    before_m = scatterers["range"].values
    after_m = before_m + np.where(behind, delay_m, 0.0)
    ratio = np.maximum(after_m, MIN_RANGE_M) / np.maximum(before_m, MIN_RANGE_M)
    squared = ratio * ratio
    return replace_values(
        scatterers,
        range=after_m,
        path_gain=scatterers["path_gain"].values * (squared * squared),
        radial_velocity=scatterers["radial_velocity"].values - np.where(behind, rate_mps, 0.0),
    )
