"""Environment effects: walls, screens, visibility, and echoes reflected by floor and walls.

Reflections are those of the image method: each scatterer gets two added echoes, one with a single
reflection (on the outward or the return path), and one with a reflection on both paths.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Any, Literal, Protocol

import numpy as np
import numpy.typing as npt
from pydantic import Field, field_validator, model_validator

from doppelgait._core import native
from doppelgait.core.config import FrozenModel
from doppelgait.core.errors import ConfigError, warn_caller
from doppelgait.core.labels import AnyTable, ScattererTable, maps_table
from doppelgait.core.plugins import Group, plugin
from doppelgait.core.units import FloatArray, arctangent, cosine, db_to_power, decimal_logarithm, exponential, sine
from doppelgait.radar.link import MIN_RANGE_M
from doppelgait.scene.environment.materials import (
    ComplexArray,
    Material,
    Mode,
    Polarisation,
    compute_slab_spreading,
    compute_te_share,
    insertion_coefficient,
    interface_reflection,
    interpolate_coefficient,
    interpolate_modes,
    relative_permittivity,
    slab_delay_m,
    slab_reflection,
)


@dataclass(frozen=True)
class Setting:
    """Wavelength, position and azimuth of the radar.

    Parameters
    ----------
    wavelength_m : float
        Wavelength of the carrier, above 0.
    radar_position_m : tuple of float
        Position (x, y, z) of the antenna; z is its height above the floor.
    radar_azimuth_rad : float
        Azimuth of the boresight, from +x towards +y.
    """

    wavelength_m: float
    radar_position_m: tuple[float, float, float]
    radar_azimuth_rad: float = 0.0


class Apply(Protocol):
    """Environment effect: returns a new scatterer table, leaving its input unchanged.

    The original rows come first, then the added rows, of ``target`` -1, or -2 of a background body. A plug-in has the
    facts ``needs_angles`` (bool, or a function of the parameters) if the table must have azimuth and elevation, and
    ``makes_images=True`` if it adds echoes by reflected paths. Such effects compute positions from ranges and are
    therefore listed before those that lengthen or attenuate paths. With ``is_smooth=True``, gains, phases and delays
    change no faster than directions, and every added row is an image in a
    :class:`~doppelgait.scene.environment.effects.Mirror`: the effect is then evaluated only 80 times a second.

    A function whose first parameter is annotated as ``ScattererTable`` gets plain arrays. Others,
    such as those written for version 0.2, get and return a Dataset.
    """

    def __call__(self, scatterers: Any, parameters: Any, setting: Setting, /) -> AnyTable:
        """Return the scatterer table (slow_time, scatterer) after the effect."""


ENVIRONMENT: Group[Apply] = Group("environment", built_in=("doppelgait.scene.environment.effects",))
"""Environment effects by the ``kind`` of a scene file's ``[[environment]]``."""

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
    x_m, y_m = level_m * cosine(azimuth_rad), level_m * sine(azimuth_rad)
    return Rays(range_m, velocity_mps, x_m, y_m, range_m * sine(elevation_rad))


def rate_per_s(values: FloatArray, slow_time_s: FloatArray) -> FloatArray:
    """Differentiate along the first axis by central differences."""
    # the error is T^2/6 times the third derivative: for the heights of a walking person at 1 kHz it
    # has a median of 3e-6 m/s and reaches 2e-3 m/s at footfalls
    if slow_time_s.size < 2:
        return np.zeros_like(values)
    return np.asarray(np.gradient(values, slow_time_s, axis=0, edge_order=2 if slow_time_s.size > 2 else 1))


def compute_image_length(
    rays: Rays, radar_distance_m: float, target_distance_m: FloatArray, slow_time_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Compute length and approach speed of paths with one reflection."""
    length_m = np.sqrt(rays.range_m**2 + 4.0 * radar_distance_m * target_distance_m)
    rate = -rays.range_m * rays.velocity_mps + 2.0 * radar_distance_m * rate_per_s(target_distance_m, slow_time_s)
    return length_m, -rate / np.maximum(length_m, 1e-12)


def find_originals(scatterers: ScattererTable) -> npt.NDArray[np.intp]:
    """Return indices of the rows that are not images. Images of images are not modelled."""
    rows = zip(scatterers["target"].tolist(), scatterers["marker"].tolist(), strict=True)
    return np.flatnonzero([target >= 0 or not str(marker).endswith(IMAGE_ENDINGS) for target, marker in rows])


def take(rays: Rays, columns: npt.NDArray[np.intp]) -> Rays:
    """Select some of the paths, in their order."""
    if columns.size == rays.range_m.shape[1]:  # sorted and without repetition: all columns
        return rays
    return Rays(*(part[:, columns] for part in vars(rays).values()))


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
    length_m, velocity_mps = compute_image_length(direct, height_m, above_m, scatterers.slow_time_s)
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
    length_m, velocity_mps = compute_image_length(direct, radar_distance_m, from_wall_m, scatterers.slow_time_s)
    x_m = direct.x_m + 2.0 * math.cos(normal_rad) * from_wall_m
    y_m = direct.y_m + 2.0 * math.sin(normal_rad) * from_wall_m
    image = Rays(length_m, velocity_mps, x_m, y_m, direct.z_m)
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
    azimuth_deg = spec.normal_azimuth_deg
    normal_rad = setting.radar_azimuth_rad if azimuth_deg is None else math.radians(azimuth_deg)
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
