"""Echoes by one and by two reflections of every scatterer."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from doppelgait.core.kernels.compiled import kernel

Float64Array = npt.NDArray[np.float64]


@kernel()
def fill_images(
    direct_m: Float64Array,
    direct_mps: Float64Array,
    direct_x: Float64Array,
    direct_y: Float64Array,
    direct_z: Float64Array,
    image_m: Float64Array,
    image_mps: Float64Array,
    image_x: Float64Array,
    image_y: Float64Array,
    image_z: Float64Array,
    reflection: npt.NDArray[np.complex128],
    least_m: float,
    place: int,
    range_m: Float64Array,
    velocity_mps: Float64Array,
    azimuth_rad: Float64Array,
    elevation_rad: Float64Array,
    path_gain: Float64Array,
    path_phase: Float64Array,
) -> None:
    """Write the images of n scatterers into a table.
    Columns from ``place`` on hold n images by one reflection, then n by two.
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


@kernel(fastmath=("contract",), apart=True)
def image_ranges(
    height_m: Float64Array,
    moments: Float64Array,
    step: float,
    times: Float64Array,
    direct_m: Float64Array,
    direct_mps: Float64Array,
    source: int,
    radar_m: float,
    one: int,
    two: int,
    range_m: Float64Array,
    velocity_mps: Float64Array,
) -> None:
    r"""Write ranges and approach speeds of images into a table."""
    per_s = 1.0 / step
    for j in range(times.shape[0]):
        i = min(max(math.floor(times[j] / step), 0), height_m.shape[0] - 2)
        b = times[j] / step - i
        a = 1.0 - b
        low, high = (a * a * a - a) * step * step / 6.0, (b * b * b - b) * step * step / 6.0
        slope_low, slope_high = (1.0 - 3.0 * a * a) * step / 6.0, (3.0 * b * b - 1.0) * step / 6.0
        here, there, to = np.uint64(i), np.uint64(i + 1), np.uint64(j)
        for p in range(height_m.shape[1]):
            k, n = np.uint64(p), np.uint64(source + p)
            y0, y1, m0, m1 = height_m[here, k], height_m[there, k], moments[here, k], moments[there, k]
            above = a * y0 + b * y1 + low * m0 + high * m1
            rate = (y1 - y0) * per_s + slope_low * m0 + slope_high * m1
            rate = rate if above > 0.0 else 0.0
            near, speed = direct_m[to, n], direct_mps[to, n]
            far = math.sqrt(near * near + 4.0 * radar_m * max(above, 0.0))
            approach = (near * speed - 2.0 * radar_m * rate) / max(far, 1e-12)
            range_m[to, np.uint64(one + p)] = 0.5 * (near + far)
            range_m[to, np.uint64(two + p)] = far
            velocity_mps[to, np.uint64(one + p)] = 0.5 * (speed + approach)
            velocity_mps[to, np.uint64(two + p)] = approach
