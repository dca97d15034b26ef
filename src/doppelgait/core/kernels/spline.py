"""Cubic spline through uniform frames, and ranges from it (E-02 to E-04)."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from doppelgait.core.kernels.compiled import kernel

FloatArray = npt.NDArray[np.float64]


@kernel()
def spline_moments(values: FloatArray, step: float, moments: FloatArray) -> None:
    r"""Compute second derivatives of the C2 not-a-knot cubic spline.
    Shapes: values (T, C); moments (T, C).
    """
    n_frames, n_columns = values.shape
    scale = 6.0 / (step * step)
    pivot = np.empty(n_frames)
    for i in range(1, n_frames - 1):
        for c in range(n_columns):
            moments[i, c] = scale * (values[i - 1, c] - 2.0 * values[i, c] + values[i + 1, c])
    for c in range(n_columns):
        moments[1, c] /= 6.0
        moments[n_frames - 2, c] /= 6.0
    if n_frames > 4:
        pivot[2] = 4.0
        for c in range(n_columns):
            moments[2, c] -= moments[1, c]
            moments[n_frames - 3, c] -= moments[n_frames - 2, c]
        for i in range(3, n_frames - 2):
            factor = 1.0 / pivot[i - 1]
            pivot[i] = 4.0 - factor
            for c in range(n_columns):
                moments[i, c] -= factor * moments[i - 1, c]
        for c in range(n_columns):
            moments[n_frames - 3, c] /= pivot[n_frames - 3]
        for i in range(n_frames - 4, 1, -1):
            for c in range(n_columns):
                moments[i, c] = (moments[i, c] - moments[i + 1, c]) / pivot[i]
    for c in range(n_columns):
        moments[0, c] = 2.0 * moments[1, c] - moments[2, c]
        moments[n_frames - 1, c] = 2.0 * moments[n_frames - 2, c] - moments[n_frames - 3, c]


@kernel()
def spline_at(
    values: FloatArray, moments: FloatArray, step: float, time: float, value: FloatArray, slope: FloatArray
) -> None:
    """Evaluate value and slope of the spline at one time.
    The time counts from the first frame; both outputs have shape (C,) and are overwritten.
    """
    i = min(max(math.floor(time / step), 0), values.shape[0] - 2)
    b = time / step - i
    a = 1.0 - b
    value_low, value_high = (a * a * a - a) * step * step / 6.0, (b * b * b - b) * step * step / 6.0
    slope_low, slope_high = (1.0 - 3.0 * a * a) * step / 6.0, (3.0 * b * b - 1.0) * step / 6.0
    y0, y1, m0, m1 = values[i], values[i + 1], moments[i], moments[i + 1]
    for c in range(value.shape[0]):
        value[c] = a * y0[c] + b * y1[c] + value_low * m0[c] + value_high * m1[c]
        slope[c] = (y1[c] - y0[c]) / step + slope_low * m0[c] + slope_high * m1[c]


@kernel()
def positions_and_velocities(
    values: FloatArray, moments: FloatArray, step: float, times: FloatArray, value: FloatArray, slope: FloatArray
) -> None:
    """Evaluate spline values and slopes at all times.
    ``value`` and ``slope`` of shape (I, C) are overwritten.
    """
    for i in range(times.shape[0]):
        spline_at(values, moments, step, times[i], value[i], slope[i])


@kernel(fastmath=("contract",), apart=True)
def values_between(values: FloatArray, moments: FloatArray, step: float, times: FloatArray, out: FloatArray) -> None:
    """Evaluate spline values alone at all times.
    ``out`` of shape (I, C) is overwritten.
    """
    for j in range(times.shape[0]):
        i = min(max(math.floor(times[j] / step), 0), values.shape[0] - 2)
        b = times[j] / step - i
        a = 1.0 - b
        low, high = (a * a * a - a) * step * step / 6.0, (b * b * b - b) * step * step / 6.0
        here, there, to = np.uint64(i), np.uint64(i + 1), np.uint64(j)
        for c in range(out.shape[1]):
            k = np.uint64(c)
            out[to, k] = a * values[here, k] + b * values[there, k] + low * moments[here, k] + high * moments[there, k]


@kernel(fastmath=("contract",), apart=True)
def ranges_and_velocities(
    values: FloatArray,
    moments: FloatArray,
    step: float,
    times: FloatArray,
    origin: FloatArray,
    range_m: FloatArray,
    approach_mps: FloatArray,
) -> None:
    """Compute range and approach speed of points on splines (E-03, E-04).
    The range is from ``origin``, the speed -dR/dt.
    """
    per_s, at_x, at_y, at_z = 1.0 / step, origin[0], origin[1], origin[2]
    for j in range(times.shape[0]):
        i = min(max(math.floor(times[j] / step), 0), values.shape[0] - 2)
        b = times[j] / step - i
        a = 1.0 - b
        low, high = (a * a * a - a) * step * step / 6.0, (b * b * b - b) * step * step / 6.0
        slope_low, slope_high = (1.0 - 3.0 * a * a) * step / 6.0, (3.0 * b * b - 1.0) * step / 6.0
        # written out for three coordinates, so that points go side by side through vector instructions
        here, there, to = np.uint64(i), np.uint64(i + 1), np.uint64(j)
        for p in range(range_m.shape[1]):
            n, nx, ny, nz = np.uint64(p), np.uint64(3 * p), np.uint64(3 * p + 1), np.uint64(3 * p + 2)
            x = a * values[here, nx] + b * values[there, nx] + low * moments[here, nx] + high * moments[there, nx]
            y = a * values[here, ny] + b * values[there, ny] + low * moments[here, ny] + high * moments[there, ny]
            z = a * values[here, nz] + b * values[there, nz] + low * moments[here, nz] + high * moments[there, nz]
            u = (values[there, nx] - values[here, nx]) * per_s
            v = (values[there, ny] - values[here, ny]) * per_s
            w = (values[there, nz] - values[here, nz]) * per_s
            u += slope_low * moments[here, nx] + slope_high * moments[there, nx]
            v += slope_low * moments[here, ny] + slope_high * moments[there, ny]
            w += slope_low * moments[here, nz] + slope_high * moments[there, nz]
            x, y, z = x - at_x, y - at_y, z - at_z
            distance = math.sqrt(x * x + y * y + z * z)
            range_m[to, n] = distance
            approach_mps[to, n] = -(x * u + y * v + z * w) / max(distance, 1e-12)


@kernel()
def angles_of_sight(
    values: FloatArray,
    moments: FloatArray,
    step: float,
    times: FloatArray,
    origin: FloatArray,
    azimuth_rad: FloatArray,
    elevation_rad: FloatArray,
    least_mps: float,
    aspect_rad: FloatArray | None = None,
) -> None:
    """Compute azimuth, elevation and aspect angle of points (E-04).
    The points lie on splines and are seen from ``origin``.
    """
    value, slope = np.empty(values.shape[1]), np.empty(values.shape[1])
    for i in range(times.shape[0]):
        spline_at(values, moments, step, times[i], value, slope)
        for p in range(azimuth_rad.shape[1]):
            x, y, z = value[3 * p] - origin[0], value[3 * p + 1] - origin[1], value[3 * p + 2] - origin[2]
            u, v, w = slope[3 * p], slope[3 * p + 1], slope[3 * p + 2]
            distance = max(math.sqrt(x * x + y * y + z * z), 1e-12)
            azimuth_rad[i, p] = math.atan2(y, x)
            elevation_rad[i, p] = math.asin(min(max(z / distance, -1.0), 1.0))
            if aspect_rad is not None:
                speed = math.sqrt(u * u + v * v + w * w)
                aspect_rad[i, p] = math.nan
                if speed >= least_mps:
                    cosine = -(x * u + y * v + z * w) / (distance * speed)
                    aspect_rad[i, p] = math.acos(min(max(cosine, -1.0), 1.0))


@kernel(fastmath=("contract",), apart=True)
def turn_and_move(
    points: FloatArray,
    cos: float,
    sin: float,
    pivot_x: float,
    pivot_y: float,
    to_x: float,
    to_y: float,
    moved: FloatArray,
) -> None:
    """Turn points about an upright axis and move them level.
    Shapes: points, moved (N, 3).
    """
    for n in range(points.shape[0]):
        k = np.uint64(n)
        x, y = points[k, 0] - pivot_x, points[k, 1] - pivot_y
        moved[k, 0] = x * cos - y * sin + to_x
        moved[k, 1] = x * sin + y * cos + to_y
        moved[k, 2] = points[k, 2]
