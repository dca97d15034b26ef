"""Losses and delays on the direct path: wall, screen and visibility by range."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, field_validator, model_validator

from doppelgait.core.config import FrozenModel
from doppelgait.core.errors import warn_caller
from doppelgait.core.labels import ScattererTable, maps_table
from doppelgait.core.plugins import plugin
from doppelgait.core.units import FloatArray, arctangent, db_to_power, decimal_logarithm
from doppelgait.radar.link import MIN_RANGE_M
from doppelgait.scene.environment.materials import (
    Material,
    Polarisation,
    compute_slab_spreading,
    compute_te_share,
    insertion_coefficient,
    interpolate_modes,
    relative_permittivity,
    slab_delay_m,
)
from doppelgait.scene.environment.reflections import (
    make_direct_rays,
    rate_per_s,
)
from doppelgait.scene.environment.registry import Setting


class Wall(FrozenModel):
    """Vertical, flat, infinite wall of a material or with measured loss.

    material: Name of a material of Recommendation ITU-R P.2040, or ``{ permittivity,
        conductivity_s_per_m }``; needs ``thickness_m``.
    thickness_m: Thickness of the material, above 0, up to 5 m.
    loss_db: Measured one-way loss at all angles, 0 to 300 dB, instead of material and thickness.
    delay_m: One-way increase of the path length, 0 (default) to 20 m; only with ``loss_db``.
    range_m: Distance of the wall from the radar along its normal; by default the wall is in front
        of all scatterers.
    normal_azimuth_deg: Azimuth of the normal, from +x towards +y; by default that of the boresight.
    polarisation: Polarisation of the radar's field.
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
    """Return True if the direction of a scatterer is needed."""
    # it is not needed for a measured wall in front of all scatterers
    return spec.range_m is not None or spec.material is not None


@plugin("environment", parameters=Wall, needs_angles=wall_needs_angles, is_smooth=True)
@maps_table
def apply_wall(scatterers: ScattererTable, spec: Wall, setting: Setting) -> ScattererTable:
    """Attenuate and delay the scatterers behind the wall.

    Parameters
    ----------
    scatterers : Dataset (slow_time, scatterer)
        Table with angles if :func:`wall_needs_angles` is true.

    Returns
    -------
    Dataset
        ``path_gain`` is multiplied by |T|^4, with the insertion coefficient T of the slab
        (:func:`insertion_coefficient`) at the angle of the straight line to the scatterer. The one-way delay
        (:func:`slab_delay_m`) is added to ``range``, and its rate is subtracted from ``radial_velocity``. The added
        range changes the phase of the echo by -4 pi / lambda times the delay; ``path_phase`` gets the remainder, so
        that the total phase is that of T^2. A measured wall has no remainder. Spreading follows the geometrical path,
        with a small reduction in the slab (:func:`compute_slab_spreading`): ``path_gain`` compensates for the delay,
        which the radar equation treats as distance. Scatterers in front of the wall are unchanged.

    Raises
    ------
    ConfigError
        If angles are needed, and the table has none or is bistatic.

    Notes
    -----
    T is evaluated at the carrier: multiple reflections inside the slab change the level, but do not
    appear as echoes at further ranges. The true ray to a scatterer is shifted by refraction; by
    Fermat's principle the effect is of second order in the ratio of thickness to range.
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
            f"wall at {spec.range_m} m: a scatterer crosses the wall, where its range and level jump; "
            "move the wall or the target"
        )
    if spec.material is None:
        return _apply_measured(scatterers, spec, behind)
    permittivity = relative_permittivity(spec.material, wavelength_m=setting.wavelength_m)
    cosine = np.minimum(np.abs(toward_m) / np.maximum(direct.range_m, 1e-12), 1.0)
    share = compute_te_share(toward_m, direct.along(normal_rad + math.pi / 2), direct.z_m)
    share = share if spec.polarisation == "vertical" else 1.0 - share
    thickness_m = spec.thickness_m or 0.0
    slab = {"thickness_m": thickness_m, "wavelength_m": setting.wavelength_m}
    te, tm = interpolate_modes(insertion_coefficient, cosine, permittivity=permittivity, **slab)
    through = te * share + tm * (1.0 - share)  # co-polar
    delay_m = slab_delay_m(cosine, permittivity=permittivity, thickness_m=thickness_m)
    rest_rad = arctangent(through.imag, through.real) + 2.0 * np.pi / setting.wavelength_m * delay_m
    rest_rad = 2.0 * ((rest_rad + np.pi) % (2.0 * np.pi) - np.pi)
    gain = (through.real**2 + through.imag**2) ** 2 * compute_slab_spreading(
        cosine, scatterers["range"], permittivity=permittivity, thickness_m=thickness_m
    )
    delayed = _lengthen(scatterers, delay_m, rate_per_s(delay_m, scatterers.slow_time_s), behind)
    return delayed.replace(
        path_gain=delayed["path_gain"] * np.where(behind, gain, 1.0),
        path_phase=scatterers.values.get("path_phase", 0.0) + np.where(behind, rest_rad, 0.0),
    )


def _apply_measured(scatterers: ScattererTable, spec: Wall, behind: np.ndarray | np.bool_) -> ScattererTable:
    gain = float(db_to_power(-2.0 * (spec.loss_db or 0.0)))
    delayed = _lengthen(scatterers, np.asarray(spec.delay_m or 0.0), np.asarray(0.0), behind)
    return delayed.replace(path_gain=delayed["path_gain"] * np.where(behind, gain, 1.0))


def _lengthen(
    scatterers: ScattererTable, delay_m: FloatArray, rate_mps: FloatArray, behind: np.ndarray | np.bool_
) -> ScattererTable:
    """Increase the delay of paths without changing their spreading."""
    before_m = scatterers["range"]
    after_m = before_m + np.where(behind, delay_m, 0.0)
    ratio = np.maximum(after_m, MIN_RANGE_M) / np.maximum(before_m, MIN_RANGE_M)
    squared = ratio * ratio
    return scatterers.replace(
        range=after_m,
        path_gain=scatterers["path_gain"] * (squared * squared),
        radial_velocity=scatterers["radial_velocity"] - np.where(behind, rate_mps, 0.0),
    )


RangeGain = tuple[Annotated[float, Field(ge=0, le=1e6)], Annotated[float, Field(ge=-300, le=300)]]


class Visibility(FrozenModel):
    """Receiver gain by range.

    gain_db: One or more pairs of range (m, rising, 0 to 1e6) and two-way power gain at that range
        (dB, -300 to 300). The gain is interpolated in dB between two pairs and constant beyond the
        ends. Two neighbouring pairs make a step: ``[[0.4, -200.0], [0.41, 0.0]]`` is a blind zone
        up to 0.4 m.
    """

    kind: Literal["visibility"] = "visibility"
    gain_db: tuple[RangeGain, ...] = Field(min_length=1, max_length=10_000)

    @field_validator("gain_db")
    @classmethod
    def _check_rising(cls, gain_db: tuple[RangeGain, ...]) -> tuple[RangeGain, ...]:
        for (range_m, _), (next_m, _) in pairwise(gain_db):
            if not next_m > range_m:
                raise ValueError(f"ranges must rise from pair to pair, but {next_m:g} m follows {range_m:g} m")
        return gain_db


@plugin("environment", parameters=Visibility)
@maps_table
def apply_visibility(scatterers: ScattererTable, spec: Visibility, setting: Setting) -> ScattererTable:
    """Apply the visibility gain at every echo's range.

    Parameters
    ----------
    scatterers : Dataset (slow_time, scatterer)
    setting : Setting
        Not used: the gain depends on range only.

    Returns
    -------
    Dataset
        Table with ``path_gain`` multiplied by 10^(gain_db / 10), where the gain is that of the apparent range (half the
        length of the echo's path). A wall increases the apparent range, so list ``visibility`` last.
    """
    ranges_m, gains_db = np.array(spec.gain_db).T
    gain = db_to_power(np.interp(scatterers["range"], ranges_m, gains_db))
    return scatterers.replace(path_gain=scatterers["path_gain"] * gain)


Place = tuple[Annotated[float, Field(ge=-1e5, le=1e5)], Annotated[float, Field(ge=-1e5, le=1e5)]]


class Screen(FrozenModel):
    """Thin vertical screen on the floor, such as furniture.

    from_m: One end on the floor.
    to_m: The other end on the floor, at least 1 cm from the first.
    height_m: Height above the floor, above 0, up to 20 m.
    loss_db: One-way loss through the screen, 0 to 300 dB; at 7 GHz it is 2 to 3 dB for a wooden
        board, and metal blocks all power.
    """

    kind: Literal["screen"] = "screen"
    from_m: Place
    to_m: Place
    height_m: float = Field(gt=0, le=20)
    loss_db: float = Field(ge=0, le=300)

    @model_validator(mode="after")
    def _has_width(self) -> Screen:
        if math.dist(self.from_m, self.to_m) < 0.01:
            raise ValueError("the distance of from_m and to_m must be at least 0.01 m")
        return self


@plugin("environment", parameters=Screen, needs_angles=True, is_smooth=True)
@maps_table
def apply_screen(scatterers: ScattererTable, spec: Screen, setting: Setting) -> ScattererTable:
    """Attenuate the scatterers behind a screen.

    Parameters
    ----------
    scatterers : Dataset (slow_time, scatterer)
        With angles.

    Returns
    -------
    Dataset
        Table with ``path_gain`` reduced by twice the one-way loss: the minimum of ``loss_db`` and the knife-edge losses
        over the top and around both ends (:func:`knife_edge_db`). Scatterers in front of the screen are unchanged.

    Raises
    ------
    ConfigError
        If the table lacks angles, or is bistatic.

    Notes
    -----
    Images in the floor are attenuated by the screen's own image below the floor. Images in a side
    wall are attenuated by the screen, not by its image in that wall. The longer paths around the
    edges are not modelled: the range remains that of the straight line.
    """
    direct = make_direct_rays(scatterers, effect=spec.kind)
    radar_x_m, radar_y_m, radar_z_m = setting.radar_position_m
    x_m, y_m = spec.from_m[0] - radar_x_m, spec.from_m[1] - radar_y_m
    along_x_m, along_y_m = spec.to_m[0] - spec.from_m[0], spec.to_m[1] - spec.from_m[1]
    level_m = np.maximum(np.hypot(direct.x_m, direct.y_m), 1e-9)
    # radar + share * (place - radar) = from_m + part * (to_m - from_m), seen from above
    across_m2 = direct.x_m * along_y_m - direct.y_m * along_x_m
    across_m2 = np.where(np.abs(across_m2) < 1e-12, 1e-12, across_m2)
    share = (x_m * along_y_m - y_m * along_x_m) / across_m2
    part = (x_m * direct.y_m - y_m * direct.x_m) / across_m2
    between = (share > 0) & (share < 1)
    share = np.where(between, share, 0.5)
    length_m = np.maximum(direct.range_m, 1e-9)
    per_m = np.sqrt(2.0 / (setting.wavelength_m * length_m * share * (1.0 - share)))
    seen_width_m = np.abs(across_m2) / level_m
    below_top_m = (spec.height_m - np.abs(radar_z_m + share * direct.z_m)) * level_m / length_m
    loss_db = np.full(share.shape, spec.loss_db)
    for inside_m in (below_top_m, part * seen_width_m, (1.0 - part) * seen_width_m):
        loss_db = np.minimum(loss_db, knife_edge_db(inside_m * per_m))
    loss_db = np.where(between, loss_db, 0.0)
    return scatterers.replace(path_gain=scatterers["path_gain"] * db_to_power(-2.0 * loss_db))


def knife_edge_db(v: FloatArray) -> FloatArray:
    """Compute the loss over a knife edge, dB (ITU-R P.526-15, equation 31)."""
    # v is the depth h of the straight line in the shadow times sqrt(2 / lambda (1/d1 + 1/d2)). For
    # v >= 0 the loss is within 0.7 dB of Fresnel's integral.
    deep = np.maximum(v, -0.78) - 0.1
    return np.where(v > -0.78, 6.9 + 20.0 * decimal_logarithm(np.sqrt(deep * deep + 1.0) + deep), 0.0)
