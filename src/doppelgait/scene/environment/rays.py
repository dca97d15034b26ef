"""Direct and reflected paths of scatterers: their table rows, geometry and rates."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.core.errors import ConfigError
from doppelgait.core.labels import SCATTERER_VARIABLES, axis
from doppelgait.radar.link import MIN_RANGE_M

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]

DIMS = ("slow_time", "scatterer")
ONE_REFLECTION, TWO_REFLECTIONS = ":bounce", ":double_bounce"
ONE_GHOST, TWO_GHOSTS = ":ghost_mixed", ":ghost"
IMAGE_ENDINGS = (ONE_REFLECTION, TWO_REFLECTIONS, ONE_GHOST, TWO_GHOSTS)
"""Endings of marker and part names of added rows: one reflection on the way there or back, or one on both."""


@dataclass(frozen=True)
class Rays:
    """Paths from the radar to points, every array (slow_time, scatterer): length, approach speed, place from the radar.

    Of a mixed path the place gives the direction only.
    """

    range_m: FloatArray
    velocity_mps: FloatArray
    x_m: FloatArray
    y_m: FloatArray
    z_m: FloatArray

    def along(self, azimuth_rad: float) -> FloatArray:
        """How far the points lie from the radar in a level direction."""
        return np.asarray(self.x_m * math.cos(azimuth_rad) + self.y_m * math.sin(azimuth_rad))


def direct_rays(scatterers: xr.Dataset, *, effect: str) -> Rays:
    """Direct paths of a table.

    Raises
    ------
    ConfigError
        If the table has no angles, or is bistatic: places cannot be found from a sum of two ranges and one direction.
    """
    if scatterers.attrs.get("bistatic", False):
        raise ConfigError(
            f"environment effect {effect!r} needs a radar with transmitter and receiver in one place; leave "
            "receiver_position_m out of the scene, or this effect"
        )
    if "azimuth" not in scatterers or "elevation" not in scatterers:
        raise ConfigError(
            f"environment effect {effect!r} needs azimuth and elevation in the scatterer table; make it with "
            "assemble(scene, times, angles=True)"
        )
    names = ("range", "radial_velocity", "azimuth", "elevation")
    range_m, velocity_mps, azimuth_rad, elevation_rad = (
        np.asarray(scatterers[name].values, dtype=np.float64) for name in names
    )
    level_m = range_m * np.cos(elevation_rad)
    return Rays(
        range_m,
        velocity_mps,
        level_m * np.cos(azimuth_rad),
        level_m * np.sin(azimuth_rad),
        range_m * np.sin(elevation_rad),
    )


def rate_per_s(values: FloatArray, slow_time_s: FloatArray) -> FloatArray:
    """Time derivative along the first axis by central differences, error T^2/6 of the third derivative.

    Heights of a walking person at 1 kHz: 3e-6 m/s in the median, 2e-3 m/s at the jerks of a footfall. A single pulse
    has no rate: 0.
    """
    if slow_time_s.size < 2:
        return np.zeros_like(values)
    return np.asarray(np.gradient(values, slow_time_s, axis=0, edge_order=2 if slow_time_s.size > 2 else 1))


def image_length(
    rays: Rays, *, radar_distance_m: float, target_distance_m: FloatArray, target_rate_mps: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Length of the once reflected way to points, and its approach speed.

    Parameters
    ----------
    rays : Rays
        The direct paths R, R'.
    radar_distance_m : float
        Distance h_r of the radar from the plane.
    target_distance_m, target_rate_mps : ndarray
        Distance h of every point from the plane and its time derivative.

    Returns
    -------
    ndarray, ndarray
        g = sqrt(R^2 + 4 h_r h), the distance of the mirror image, and -g' = -(R R' + 2 h_r h') / g, exact as far as
        h' is.
    """
    length_m = np.sqrt(rays.range_m**2 + 4.0 * radar_distance_m * target_distance_m)
    rate = -rays.range_m * rays.velocity_mps + 2.0 * radar_distance_m * target_rate_mps
    return length_m, -rate / np.maximum(length_m, 1e-12)


def originals(scatterers: xr.Dataset) -> npt.NDArray[np.intp]:
    """Indices of the rows that are no images: images of images are left out."""
    names = np.char.endswith(axis(scatterers, "marker").astype(str)[:, None], np.array(IMAGE_ENDINGS)).any(axis=1)
    return np.flatnonzero(~(names & (axis(scatterers, "target") == -1)))


def take(rays: Rays, columns: npt.NDArray[np.intp]) -> Rays:
    """Some of the paths, in their order."""
    if columns.size == rays.range_m.shape[1]:  # in order and without repetition, so all of them
        return rays
    parts = (rays.range_m, rays.velocity_mps, rays.x_m, rays.y_m, rays.z_m)
    return Rays(*(part[:, columns] for part in parts))


def add_images(
    scatterers: xr.Dataset,
    columns: npt.NDArray[np.intp],
    *,
    direct: Rays,
    image: Rays,
    reflection: ComplexArray,
    endings: tuple[str, str],
) -> xr.Dataset:
    """Table with the echoes by one and by two reflections after its rows.

    Parameters
    ----------
    scatterers : Dataset (slow_time, scatterer)
    columns : ndarray of int
        Its rows that have an image.
    direct, image : Rays
        Direct and reflected paths of those, R and g.
    reflection : ndarray of complex
        Coefficient c of each reflection.
    endings : (str, str)
        For marker and part names: one reflection, two reflections.

    Returns
    -------
    Dataset
        One reflection, there or back (two equal paths: twice the amplitude): apparent range (R + g)/2, field
        2 c / (R g). Two: apparent range g, field c^2 / g^2. ``path_gain`` makes up for what the radar equation takes
        the spreading to be, so that all paths sum to (exp(-jkR)/R + c exp(-jkg)/g)^2. The direction of the echo by one
        reflection is midway between those of its two ways. Radar cross section as on the direct way; no aspect.
    """
    from doppelgait.core.kernels.images import fill_images

    table = with_phase(scatterers)
    n_rows, n_images = table.sizes["scatterer"], columns.size
    first, second = slice(n_rows, n_rows + n_images), slice(n_rows + n_images, None)
    values: dict[str, FloatArray] = {}
    for name, variable in table.data_vars.variables.items():
        values[str(name)] = whole = np.empty((variable.shape[0], n_rows + 2 * n_images))
        whole[:, :n_rows] = variable.values
        whole[:, first] = whole[:, second] = np.nan if name == "aspect" else variable.values[:, columns]
    paths: list[Any] = [np.ascontiguousarray(part) for rays in (direct, image) for part in vars(rays).values()]
    new: list[Any] = [
        values[name] for name in ("range", "radial_velocity", "azimuth", "elevation", "path_gain", "path_phase")
    ]
    fill_images(*paths, np.ascontiguousarray(reflection), MIN_RANGE_M, n_rows, *new)  # type: ignore[call-arg]
    coords = dict(table.coords.variables)
    for name, variable in table.coords.variables.items():
        if variable.dims != ("scatterer",):
            continue
        added = variable.values[columns]
        if name == "target":
            rows = [np.full(n_images, -1)] * 2
        elif name in ("marker", "part"):
            rows = [np.char.add(added.astype(str), ending) for ending in endings]
        else:
            rows = [added, added]
        coords[name] = xr.Variable("scatterer", np.concatenate([variable.values, *rows]), variable.attrs)
    variables = {name: xr.Variable(DIMS, array, table[name].attrs) for name, array in values.items()}
    return xr.Dataset(variables, coords=coords, attrs=table.attrs)


def with_phase(scatterers: xr.Dataset) -> xr.Dataset:
    """The table with ``path_phase``; 0 where it had none."""
    if "path_phase" in scatterers:
        return scatterers
    shape = tuple(scatterers.sizes[dim] for dim in DIMS)
    return with_values(scatterers, path_phase=np.zeros(shape))


def with_values(scatterers: xr.Dataset, **values: FloatArray) -> xr.Dataset:
    """The table with some of its variables replaced or added."""
    return scatterers.assign(
        {name: (DIMS, array, {"units": SCATTERER_VARIABLES[name]}) for name, array in values.items()}
    )


def phase_of(scatterers: xr.Dataset) -> FloatArray | float:
    """``path_phase`` of the table, 0 where it has none."""
    return np.asarray(scatterers["path_phase"].values) if "path_phase" in scatterers else 0.0
