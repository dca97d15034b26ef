"""A body of ellipsoids: where they are, and the radar cross section that each shows in a direction (E-08c)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import ConfigError
from doppelgait.motion.motion import Motion
from doppelgait.motion.retime import resample
from doppelgait.scene.bodies import Segment, body_of
from doppelgait.scene.points import mean_points

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Ellipsoids:
    """Ellipsoids at I times.

    Parameters
    ----------
    centre_m : ndarray, shape (I, S, 3)
    along, across : ndarray, shape (I, S, 3)
        Unit vectors of the long axis and from side to side; ``across`` is zero for ellipsoids of revolution.
    semi_axes_m : ndarray, shape (S, 3)
        Across, upright and along, constant in time.
    """

    centre_m: FloatArray
    along: FloatArray
    across: FloatArray
    semi_axes_m: FloatArray


@dataclass(frozen=True)
class Skeleton:
    """Joints of one motion as a motion table, its segments and their semi-axes (S, 3), m: across, upright, along."""

    joints: Motion
    segments: tuple[Segment, ...]
    semi_axes_m: FloatArray

    def numbers(self, end: str) -> list[int]:
        """Numbers of the joints where the segments ``"start"`` or ``"end"``."""
        number = {name: n for n, name in enumerate(self.joints.markers)}
        return [number[getattr(segment, end)] for segment in self.segments]


def ellipsoid_rcs_m2(semi_axes_m: npt.ArrayLike, direction: npt.ArrayLike) -> FloatArray:
    r"""Backscatter of a perfectly conducting ellipsoid in the optical limit (E-08c; Mahafza 2003, Chen 2011).

    .. math:: \sigma = \pi (a b c)^2 / (a^2 u_1^2 + b^2 u_2^2 + c^2 u_3^2)^2

    with :math:`u = (\sin\theta\cos\phi, \sin\theta\sin\phi, \cos\theta)`; :math:`\pi r^2` for a sphere, frequency
    independent.

    Parameters
    ----------
    semi_axes_m : array_like, shape (..., 3)
        a, b, c, positive.
    direction : array_like, shape (..., 3)
        Unit vector to the radar, in the axes of the ellipsoid.

    Returns
    -------
    ndarray, shape (...)
        m^2, positive.
    """
    squares = np.asarray(semi_axes_m, dtype=float) ** 2
    form = _dot(squares, np.asarray(direction, dtype=float) ** 2)
    return np.asarray(np.pi * squares.prod(axis=-1) / (form * form))


def horizontal_mean_rcs_m2(body: Ellipsoids) -> FloatArray:
    r"""Mean of :func:`ellipsoid_rcs_m2` over all horizontal directions, shape (I, S), m^2.

    With N the horizontal 2 x 2 block of :math:`\sum_k s_k^2 e_k e_k^T` (semi-axes s, axes e) the mean over azimuth is
    :math:`\pi (a b c)^2 \, \mathrm{tr} N / (2 (\det N)^{3/2})`.
    """
    across, upright, along = body.semi_axes_m.T
    wide, long = across**2 - upright**2, along**2 - upright**2
    x, y = body.along[..., 0], body.along[..., 1]
    side_x, side_y = body.across[..., 0], body.across[..., 1]
    xx = upright**2 + wide * side_x**2 + long * x**2
    yy = upright**2 + wide * side_y**2 + long * y**2
    xy = wide * side_x * side_y + long * x * y
    return np.asarray(np.pi * (across * upright * along) ** 2 * (xx + yy) / (2.0 * (xx * yy - xy**2) ** 1.5))


def skeleton_of(motion: Motion) -> Skeleton:
    """Joints and ellipsoids of a motion.

    Parameters
    ----------
    motion : Motion
        With the points of one of :data:`doppelgait.scene.bodies.BODIES` and a known ``height_m``.

    Raises
    ------
    ConfigError
        If the joints or the height are unknown, or two joints of a segment coincide.
    """
    source, height_m = motion.facts.source, motion.facts.height_m
    body, points = body_of(motion.markers, source)
    if not height_m > 0:
        raise ConfigError(f"{source}: the height is unknown, so ellipsoids have no size; use another rcs kind")
    joints = motion.with_points(mean_points(motion, list(points.values())), list(points), [""] * len(points))
    skeleton = Skeleton(joints, body.segments, np.empty(0))
    start, end = (joints.position_m[:, skeleton.numbers(which)] for which in ("start", "end"))
    half_m = np.median(np.sqrt(((end - start) ** 2).sum(axis=-1)), axis=0) / 2.0
    if not half_m.min() > 0:
        raise ConfigError(f"{source}: segment {body.segments[int(half_m.argmin())].name} has no length")
    sizes = [
        (s.across * height_m, s.upright * height_m, float(half) if s.along is None else s.along * height_m)
        for s, half in zip(body.segments, half_m, strict=True)
    ]
    return Skeleton(joints, body.segments, np.array(sizes))


def centres(skeleton: Skeleton) -> Motion:
    """Motion of the ellipsoids' centres, one point per segment with its name and body part."""
    pairs = list(zip(skeleton.numbers("start"), skeleton.numbers("end"), strict=True))
    names, parts = ([getattr(s, key) for s in skeleton.segments] for key in ("name", "part"))
    return skeleton.joints.with_points(mean_points(skeleton.joints, pairs), names, parts)


def ellipsoids_at(skeleton: Skeleton, time_s: FloatArray) -> Ellipsoids:
    """The ellipsoids at times after the first frame (spline of E-02)."""
    return _ellipsoids(skeleton, resample(skeleton.joints, time_s)[0])


def ellipsoids_of_frames(skeleton: Skeleton) -> Ellipsoids:
    """The ellipsoids at the frames of the motion."""
    return _ellipsoids(skeleton, skeleton.joints.position_m)


def _ellipsoids(skeleton: Skeleton, joint_m: FloatArray) -> Ellipsoids:
    names = skeleton.joints.markers
    start, end = joint_m[:, skeleton.numbers("start")], joint_m[:, skeleton.numbers("end")]
    along = _unit(end - start)
    across = np.zeros_like(along)
    for n, segment in enumerate(skeleton.segments):
        if segment.sideways is not None:
            left, right = (joint_m[:, names.index(joint)] for joint in segment.sideways)
            line = left - right
            across[:, n] = _unit(line - _dot(line, along[:, n])[:, None] * along[:, n])
    return Ellipsoids((start + end) / 2.0, along, across, skeleton.semi_axes_m)


def _unit(vector: FloatArray) -> FloatArray:
    length = np.sqrt(_dot(vector, vector))
    return np.asarray(vector / np.maximum(length, 1e-12)[..., None])


def _dot(first: FloatArray, second: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("...k,...k->...", first, second))  # a third of the time of a product and a sum


def mean_rcs_m2(skeleton: Skeleton) -> float:
    """Sum over the ellipsoids of their mean over all frames of the motion and all horizontal directions, m^2."""
    return float(horizontal_mean_rcs_m2(ellipsoids_of_frames(skeleton)).mean(axis=0).sum())


def seen_rcs_m2(body: Ellipsoids, radar_position_m: npt.ArrayLike) -> FloatArray:
    """RCS of every ellipsoid towards the radar (E-08c), not scaled to a total; shape (I, S), m^2."""
    sight = _unit(np.asarray(radar_position_m, dtype=float) - body.centre_m)
    along, across = _dot(sight, body.along), _dot(sight, body.across)
    upright = np.sqrt(np.maximum(1.0 - along**2 - across**2, 0.0))
    return ellipsoid_rcs_m2(body.semi_axes_m, np.stack([across, upright, along], axis=-1))
