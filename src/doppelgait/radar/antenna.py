"""Antenna pattern: relative gain by direction."""

from __future__ import annotations

import math
from typing import Literal, Self

import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator

from doppelgait._core import native
from doppelgait.core.config import FrozenModel
from doppelgait.core.errors import ConfigError
from doppelgait.core.labels import ScattererTable, maps_table
from doppelgait.core.units import FloatArray, arcsine, arctangent, cosine, db_to_power, sine

FIELDS_OF_KIND = {
    "isotropic": (),
    "cosine": ("hpbw_azimuth_deg", "hpbw_elevation_deg", "floor_db"),
    "table": ("angle_deg", "azimuth_db", "elevation_db"),
}
"""Parameters of each kind of pattern; those without a default are required."""


class Antenna(FrozenModel):
    r"""Pattern of the antenna relative to its peak gain, for transmission and reception.

    The peak gains are ``tx_gain_dbi`` and ``rx_gain_dbi`` of the radar; an echo gets the square of the one-way pattern.
    Directions are off-boresight angles: the azimuth :math:`\phi` in the plane of the antenna's horizontal axis and the
    elevation :math:`\epsilon` out of that plane, as of a point at :math:`(\cos\epsilon \cos\phi, \cos\epsilon
    \sin\phi, \sin\epsilon)` with the boresight along the first axis.

    kind: ``isotropic``: the same in all directions. ``cosine``: a main lobe with set widths.
        ``table``: two measured cuts.
    hpbw_azimuth_deg: ``cosine``: full half-power beam width in azimuth, about 65 degrees in both
        planes for a small patch antenna like those of X4 modules (assumed).
    hpbw_elevation_deg: ``cosine``: full half-power beam width in elevation.
    floor_db: ``cosine``: one-way level of the side and back lobes, the minimum of the
        pattern; the default is assumed.
    angle_deg: ``table``: angles of the two cuts, rising, -180 to 180 degrees. Gains are
        interpolated in dB between them, and behind the antenna from the last angle to the first.
    azimuth_db: ``table``: one-way gain of the horizontal cut relative to the peak, -300 to 0 dB.
    elevation_db: ``table``: one-way gain of the vertical cut relative to the peak, -300 to 0 dB.

    Notes
    -----
    ``cosine``: :math:`G = \cos^{q_a}\!\phi \, \cos^{q_e}\!\epsilon` for :math:`|\phi| < 90` degrees (Balanis,
    Antenna Theory), with :math:`q = -3 / (10 \log_{10} \cos(\mathrm{HPBW} / 2))`, 3 dB down at half
    the beam width. Equal widths give a rotationally symmetric pattern.

    ``table``: the two cuts are added in dB, as in 3GPP TR 38.901 (7.3), an approximation outside
    the two planes, and a rough one far from both (nearly straight up or down).
    """

    kind: Literal["isotropic", "cosine", "table"] = "isotropic"
    hpbw_azimuth_deg: float | None = Field(default=None, ge=1, le=179)
    hpbw_elevation_deg: float | None = Field(default=None, ge=1, le=179)
    floor_db: float = Field(default=-20.0, ge=-100, le=0)
    angle_deg: tuple[float, ...] | None = Field(default=None, min_length=2, max_length=10_000)
    azimuth_db: tuple[float, ...] | None = None
    elevation_db: tuple[float, ...] | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        needed = FIELDS_OF_KIND[self.kind]
        missing = [name for name in needed if getattr(self, name) is None]
        if missing:
            raise ValueError(f"antenna kind {self.kind!r} needs {' and '.join(missing)}")
        others = {name: field for name, field in type(self).model_fields.items() if name not in ("kind", *needed)}
        foreign = [name for name, field in others.items() if getattr(self, name) != field.default]
        if foreign:
            raise ValueError(f"antenna kind {self.kind!r} has no {', '.join(foreign)}: remove it, or change the kind")
        if self.angle_deg is None:
            return self
        angles = np.array(self.angle_deg)
        if not (np.diff(angles) > 0).all() or angles[0] < -180 or angles[-1] > 180:
            raise ValueError("angle_deg must rise from one angle to the next, within -180 to 180")
        for name in ("azimuth_db", "elevation_db"):
            cut_db = np.array(getattr(self, name))
            if cut_db.size != angles.size:
                raise ValueError(f"{name} has {cut_db.size} values, angle_deg {angles.size}; set one for every angle")
            if cut_db.min() < -300 or cut_db.max() > 0:
                raise ValueError(
                    f"{name} reaches from {cut_db.min():g} to {cut_db.max():g} dB; allowed are -300 to 0 dB relative "
                    "to the peak; set the peak gain with tx_gain_dbi and rx_gain_dbi"
                )
            if angles[-1] - angles[0] == 360 and cut_db[0] != cut_db[-1]:
                raise ValueError(f"{name}: {cut_db[0]:g} dB at -180 and {cut_db[-1]:g} dB at 180 must be equal")
        return self


def interpolate_cuts(antenna: Antenna, azimuth_rad: npt.ArrayLike, elevation_rad: npt.ArrayLike) -> FloatArray:
    """Return a direction's one-way power gain from two measured cuts, relative to peak."""
    cuts = ((azimuth_rad, antenna.azimuth_db), (elevation_rad, antenna.elevation_db))
    angle_deg = np.array(antenna.angle_deg, dtype=float)
    last = -1 if angle_deg[-1] - angle_deg[0] == 360 else None  # -180 and 180 are one direction
    gains_db = [
        np.interp(np.degrees(angle_rad), angle_deg[:last], np.array(cut_db, dtype=float)[:last], period=360.0)
        for angle_rad, cut_db in cuts
    ]
    return np.asarray(db_to_power(sum(gains_db)))


def compute_cosine_exponent(hpbw_deg: float) -> float:
    """Return the cosine exponent of a half-power beam width."""
    return -3.0 / (10.0 * math.log10(math.cos(math.radians(hpbw_deg) / 2.0)))


def rotate_to_boresight(
    azimuth_rad: npt.ArrayLike, elevation_rad: npt.ArrayLike, boresight_azimuth_rad: float, boresight_tilt_rad: float
) -> tuple[FloatArray, FloatArray]:
    """Rotate directions into the frame of an antenna: tilted up, then about the vertical axis."""
    turn = np.asarray(azimuth_rad, dtype=float) - boresight_azimuth_rad
    elevation = np.asarray(elevation_rad, dtype=float)
    cos_tilt, sin_tilt = math.cos(boresight_tilt_rad), math.sin(boresight_tilt_rad)
    level, up = cosine(elevation), sine(elevation)
    ahead, left = level * cosine(turn), level * sine(turn)
    forward = ahead * cos_tilt + up * sin_tilt
    above = up * cos_tilt - ahead * sin_tilt
    return arctangent(left, forward)[()], arcsine(np.clip(above, -1.0, 1.0))[()]


@maps_table
def apply_antenna(
    scatterers: ScattererTable, antenna: Antenna, *, boresight_azimuth_rad: float = 0.0, boresight_tilt_rad: float = 0.0
) -> ScattererTable:
    """Multiply path gains by the two-way antenna pattern."""
    if antenna.kind == "isotropic":
        return scatterers
    missing = [name for name in ("azimuth", "elevation") if name not in scatterers]
    if missing:
        raise ConfigError(
            f"radar.antenna.kind = {antenna.kind!r} needs the direction of every scatterer, but the scatterer table "
            f"has no {' and no '.join(missing)}; assemble it with angles=True, or use antenna kind 'isotropic'"
        )
    path_gain = scatterers["path_gain"]
    directions = scatterers["azimuth"], scatterers["elevation"], boresight_azimuth_rad, boresight_tilt_rad
    if antenna.kind == "cosine":
        gains = np.empty(path_gain.shape)
        widths_deg = antenna.hpbw_azimuth_deg, antenna.hpbw_elevation_deg
        exponents = (compute_cosine_exponent(width_deg or math.nan) for width_deg in widths_deg)
        floor = float(db_to_power(antenna.floor_db))
        native.apply_cosine_pattern(*directions, *exponents, floor, path_gain, gains)
    else:
        gains = path_gain * interpolate_cuts(antenna, *rotate_to_boresight(*directions)) ** 2
    return scatterers.replace(path_gain=gains)
