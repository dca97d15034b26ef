"""Echoes by one and by two reflections of every scatterer."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from doppelgait.core.kernels.compiled import kernel

Float64Array = npt.NDArray[np.float64]


@kernel()
def fill_images(
    direct_m: Float64Array, direct_mps: Float64Array, direct_x: Float64Array, direct_y: Float64Array,
    direct_z: Float64Array, image_m: Float64Array, image_mps: Float64Array, image_x: Float64Array,
    image_y: Float64Array, image_z: Float64Array, reflection: npt.NDArray[np.complex128], least_m: float, place: int,
    range_m: Float64Array, velocity_mps: Float64Array, azimuth_rad: Float64Array, elevation_rad: Float64Array,
    path_gain: Float64Array, path_phase: Float64Array,
) -> None:  # fmt: skip
    """Write the images of n scatterers into a table.

    Columns from ``place`` on hold n images by one reflection, then n by two.

    By one reflection, there or back: range (R + g) / 2, power gain 4 |c|^2 (((R + g) / 2)^2 / (R g))^2, the phase of c,
    and the direction midway between those of its paths. By two: range g, gain |c|^4, twice the phase.

    Parameters
    ----------
    direct_m, direct_mps, direct_x, direct_y, direct_z, image_m, ... : ndarray, shape (I, n), float64
        Lengths R and g, approach speeds and places of direct and reflected paths.
    reflection : ndarray, shape (I, n), complex128
        Coefficient c of one reflection.
    least_m : float
        Lengths are taken as at least this in the gain.
    place : int
    range_m, velocity_mps, azimuth_rad, elevation_rad, path_gain, path_phase : ndarray, shape (I, place + 2 n)
        The table. ``path_gain`` and ``path_phase`` of the new columns hold those of the scatterers; the others are
        overwritten.
    """
    n_images = direct_m.shape[1]
    for i in range(direct_m.shape[0]):
        for n in range(n_images):
            near, far = 1.0 / max(direct_m[i, n], 1e-12), 1.0 / max(image_m[i, n], 1e-12)
            x = direct_x[i, n] * near + image_x[i, n] * far
            y = direct_y[i, n] * near + image_y[i, n] * far
            z = direct_z[i, n] * near + image_z[i, n] * far
            c = reflection[i, n]
            power, turn = c.real * c.real + c.imag * c.imag, math.atan2(c.imag, c.real)
            mean_m = 0.5 * (direct_m[i, n] + image_m[i, n])
            at_least = max(mean_m, least_m)
            spreading = at_least * at_least / (max(direct_m[i, n], least_m) * max(image_m[i, n], least_m))
            one, two = place + n, place + n_images + n
            range_m[i, one], range_m[i, two] = mean_m, image_m[i, n]
            velocity_mps[i, one] = 0.5 * (direct_mps[i, n] + image_mps[i, n])
            velocity_mps[i, two] = image_mps[i, n]
            azimuth_rad[i, one] = math.atan2(y, x)
            elevation_rad[i, one] = math.atan2(z, math.sqrt(x * x + y * y))
            x, y, z = image_x[i, n], image_y[i, n], image_z[i, n]
            azimuth_rad[i, two] = math.atan2(y, x)
            elevation_rad[i, two] = math.atan2(z, math.sqrt(x * x + y * y))
            path_gain[i, one] *= 4.0 * power * spreading * spreading
            path_gain[i, two] *= power * power
            path_phase[i, one] += turn
            path_phase[i, two] += 2.0 * turn
