"""Ellipsoids seen from the radar: nearest points, cross sections, occlusion."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from doppelgait.core.kernels.compiled import kernel

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

NEWTON_STEPS = 30
"""At most; 2 to 4 are needed from a few radii on, more only near the surface."""


@kernel(inline="numba")
def ramp(x: float) -> float:
    """Evaluate a smooth step from 0 to 1.
    Between them it is the polynomial of degree 5 with two continuous derivatives.
    """
    x = min(max(x, 0.0), 1.0)
    return x * x * x * (10.0 + x * (6.0 * x - 15.0))


@kernel(inline="numba")
def _in_own_axes(
    centre: FloatArray, along: FloatArray, across: FloatArray, radar: FloatArray
) -> tuple[float, float, float]:
    """Return the radar's place along the axes of one ellipsoid.
    They are across, the square of upright, and along.
    """
    wide, long, square = 0.0, 0.0, 0.0
    for k in range(3):
        y = radar[k] - centre[k]
        wide += y * across[k]
        long += y * along[k]
        square += y * y
    return wide, max(square - wide * wide - long * long, 0.0), long


@kernel(inline="numba")
def _root(wide2: float, up2: float, long2: float, first: float, second: float, third: float) -> float:
    """Find t of the nearest point."""
    weight = first + second + third
    root = math.sqrt(weight) - (first * wide2 + second * up2 + third * long2) / max(weight, 1e-300)
    root = max(root, 0.0)
    for _ in range(NEWTON_STEPS):
        p, q, r = 1.0 / (wide2 + root), 1.0 / (up2 + root), 1.0 / (long2 + root)
        one, two, three = first * p * p, second * q * q, third * r * r
        step = (one + two + three - 1.0) / (2.0 * (one * p + two * q + three * r) + 1e-300)
        root = max(root + step, 0.0)
        if abs(step) <= 1e-9 * root:  # the next one would be of the order of its square
            break
    return root


@kernel()
def nearest_points(
    centre: FloatArray,
    along: FloatArray,
    across: FloatArray,
    semi_axes: FloatArray,
    radar: FloatArray,
    points: FloatArray,
) -> None:
    """Find the point of every ellipsoid that is nearest to the radar.
    Shapes: centre, along, across (I, S, 3); semi_axes (S, 3); radar (3,); points (I, S, 3).
    """
    for i in range(centre.shape[0]):
        for s in range(centre.shape[1]):
            wide2, up2, long2 = semi_axes[s, 0] ** 2, semi_axes[s, 1] ** 2, semi_axes[s, 2] ** 2
            y_wide, up_square, y_long = _in_own_axes(centre[i, s], along[i, s], across[i, s], radar)
            root = _root(wide2, up2, long2, wide2 * y_wide * y_wide, up2 * up_square, long2 * y_long * y_long)
            plain = up2 / (up2 + root)
            more_wide, more_long = wide2 / (wide2 + root) - plain, long2 / (long2 + root) - plain
            for k in range(3):
                y = radar[k] - centre[i, s, k]
                off = plain * y + more_wide * y_wide * across[i, s, k] + more_long * y_long * along[i, s, k]
                points[i, s, k] = centre[i, s, k] + off


@kernel()
def seen_rcs(
    centre: FloatArray,
    along: FloatArray,
    across: FloatArray,
    semi_axes: FloatArray,
    radar: FloatArray,
    rcs: FloatArray,
) -> None:
    """Compute the cross section of every ellipsoid at the radar's distance.
    Shapes: centre, along, across (I, S, 3); semi_axes (S, 3); radar (3,); rcs (I, S).
    """
    for i in range(centre.shape[0]):
        for s in range(centre.shape[1]):
            wide2, up2, long2 = semi_axes[s, 0] ** 2, semi_axes[s, 1] ** 2, semi_axes[s, 2] ** 2
            y_wide, up_square, y_long = _in_own_axes(centre[i, s], along[i, s], across[i, s], radar)
            first, second, third = wide2 * y_wide * y_wide, up2 * up_square, long2 * y_long * y_long
            root = _root(wide2, up2, long2, first, second, third)
            p, q, r = 1.0 / (wide2 + root), 1.0 / (up2 + root), 1.0 / (long2 + root)
            gradient2 = y_wide * y_wide * p * p + up_square * q * q + y_long * y_long * r * r  # 1 / h^2
            bent = first * p * p * p + second * q * q * q + third * r * r * r
            far = root * gradient2
            rcs[i, s] = math.pi * far * far * (wide2 * p) * (up2 * q) * (long2 * r) / (bent + 1e-300)


@kernel()
def sight_amplitudes(
    points: FloatArray,
    centre: FloatArray,
    along: FloatArray,
    across: FloatArray,
    semi_axes: FloatArray,
    passes: BoolArray,
    radar: FloatArray,
    edge: float,
    amplitude: FloatArray,
) -> None:
    """Compute amplitudes past the ellipsoids from every point to the radar."""
    n_times, n_points = points.shape[0], points.shape[1]
    n_bodies = centre.shape[1]
    sight, offset = np.empty(3), np.empty(3)
    for i in range(n_times):
        for p in range(n_points):
            for k in range(3):
                sight[k] = radar[k] - points[i, p, k]
            length = math.sqrt(sight[0] ** 2 + sight[1] ** 2 + sight[2] ** 2)
            for k in range(3):
                sight[k] /= max(length, 1e-12)
            through = 1.0
            for s in range(n_bodies):
                if passes[p, s] or through == 0.0:
                    continue
                ahead, apart = 0.0, 0.0
                for k in range(3):
                    offset[k] = points[i, p, k] - centre[i, s, k]
                    ahead -= offset[k] * sight[k]
                    apart += offset[k] * offset[k]
                reach = max(semi_axes[s, 0], semi_axes[s, 1], semi_axes[s, 2]) + 2.0 * edge
                if ahead < -reach or apart - ahead * ahead > reach * reach:
                    continue
                through *= _amplitude_past(offset, sight, length, along[i, s], across[i, s], semi_axes[s], edge)
            amplitude[i, p] = through


@kernel()
def _amplitude_past(
    offset: FloatArray,
    sight: FloatArray,
    length: float,
    along: FloatArray,
    across: FloatArray,
    semi_axes: FloatArray,
    edge: float,
) -> float:
    """Compute the amplitude past one ellipsoid.
    It follows from the point of the line of sight where the ellipsoid's quadratic form is smallest.
    """
    base = 1.0 / semi_axes[1] ** 2
    wide, long = 1.0 / semi_axes[0] ** 2 - base, 1.0 / semi_axes[2] ** 2 - base
    offset_wide = offset[0] * across[0] + offset[1] * across[1] + offset[2] * across[2]
    offset_long = offset[0] * along[0] + offset[1] * along[1] + offset[2] * along[2]
    sight_wide = sight[0] * across[0] + sight[1] * across[1] + sight[2] * across[2]
    sight_long = sight[0] * along[0] + sight[1] * along[1] + sight[2] * along[2]
    both = offset[0] * sight[0] + offset[1] * sight[1] + offset[2] * sight[2]
    square = base + wide * sight_wide * sight_wide + long * sight_long * sight_long
    linear = base * both + wide * offset_wide * sight_wide + long * offset_long * sight_long
    way = min(-linear / square, length)
    if way <= 0.0:
        return 1.0
    near_wide, near_long = offset_wide + way * sight_wide, offset_long + way * sight_long
    form, steepness = 0.0, 0.0
    for k in range(3):
        near = offset[k] + way * sight[k]
        slope = base * near + wide * near_wide * across[k] + long * near_long * along[k]
        form += near * slope
        steepness += slope * slope
    clearance = (form - 1.0) / max(2.0 * math.sqrt(steepness), 1e-12)
    passed: float = 1.0 - ramp(way / edge) * (1.0 - ramp((clearance + edge) / (2.0 * edge)))
    return passed
