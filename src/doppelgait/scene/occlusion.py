"""Self-occlusion: scatterers hidden from the radar by the body's own ellipsoids."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from doppelgait.scene.ellipsoids import Ellipsoids

FloatArray = npt.NDArray[np.float64]

EDGE_M = 0.05
"""Half width of the border between light and shadow, m: the Fresnel scale sqrt(lambda d / 2) of a shadow that falls
d = 0.12 m behind its edge at 7.29 GHz. The border is smooth, so that a limb that passes behind the trunk fades over
0.1 m of its way instead of clicking."""

OWN_REACH = 1.1
"""An ellipsoid never hides points that it contains, up to a tenth beyond its surface: they stand for that surface."""


def visible_power(
    point_m: FloatArray,
    body: Ellipsoids,
    own: npt.NDArray[np.bool_],
    radar_position_m: npt.ArrayLike,
    *,
    edge_m: float = EDGE_M,
) -> FloatArray:
    r"""Two-way power gain of the lines of sight past the body's ellipsoids (E-08e): 1 in sight, 0 hidden.

    At the point of the line of sight where the ellipsoid's form :math:`q = x^T K x` is smallest its clearance is, to
    first order, :math:`d = (q - 1) / (2 |K x|)` (negative inside). The amplitude rises from 0 at d = -edge to 1 at
    d = +edge with two continuous derivatives; an ellipsoid counts only as far as it lies before the point, by the same
    ramp over the first ``edge`` of the way. Amplitudes past several ellipsoids multiply; the gain is the square. Waves
    that creep round the body or pass through it are left out.

    Parameters
    ----------
    point_m : ndarray, shape (I, P, 3)
    body : Ellipsoids
        At the same I times.
    own : ndarray of bool, shape (P, S)
        Ellipsoids that never hide a point (:func:`own_points`).
    radar_position_m : array_like, shape (3,)
    edge_m : float
        Positive.

    Returns
    -------
    ndarray, shape (I, P)
        0 to 1.
    """
    from doppelgait.core.kernels.occlusion import sight_amplitudes

    points = np.ascontiguousarray(point_m, dtype=np.float64)
    amplitude = np.empty(points.shape[:2])
    sight_amplitudes(
        points, body.centre_m, body.along, body.across, body.semi_axes_m, np.ascontiguousarray(own),
        np.asarray(radar_position_m, dtype=np.float64), edge_m, amplitude,
    )  # fmt: skip
    return amplitude * amplitude


def own_points(point_m: FloatArray, body: Ellipsoids) -> npt.NDArray[np.bool_]:
    """Whether an ellipsoid contains a point (to a tenth beyond its surface) half of the time or more, shape (P, S)."""
    step = -(-point_m.shape[0] // 100)
    offset = point_m[::step, :, None] - body.centre_m[::step, None]
    across, upright, along = body.semi_axes_m.T
    wide = (offset * body.across[::step, None]).sum(axis=-1) ** 2 * (across**-2.0 - upright**-2.0)
    long = (offset * body.along[::step, None]).sum(axis=-1) ** 2 * (along**-2.0 - upright**-2.0)
    form = (offset**2).sum(axis=-1) * upright**-2.0 + wide + long
    return np.asarray(np.median(form, axis=0) <= OWN_REACH**2)
