"""Scatterers of a placed motion with their radar cross sections.

The kinds of radar cross section differ in this module only.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import ConfigError
from doppelgait.core.plugins import plugin
from doppelgait.motion.motion import Motion
from doppelgait.motion.retime import resample
from doppelgait.scene.bodies import (
    Ellipsoids,
    Skeleton,
    average_points,
    build_skeleton,
    compute_ellipsoids_at,
    compute_frame_ellipsoids,
    compute_visible_power,
    find_nearest_points,
    find_own_points,
    mean_rcs_m2,
    seen_rcs_m2,
)
from doppelgait.scene.rcs import (
    RCS,
    RcsSpec,
    sample_fluctuation,
    sample_spread,
    scatterer_rcs_m2,
    total_rcs_m2,
    warn_of_unknown_parts,
)

FloatArray = npt.NDArray[np.float64]

MAX_FRAMES = 200
"""Maximum number of frames, evenly spaced in time, for the median distance of two points."""


@dataclass(frozen=True)
class Scatterers:
    """Positions and radar cross sections of a target's scatterers.

    Parameters
    ----------
    motion : Motion
        One point per scatterer, L of them.
    rcs_m2, path_gain : ndarray, broadcastable to (I, L)
        Radar cross section (m^2) and two-way power gain of the path (1) at the I pulse times.
    """

    motion: Motion
    rcs_m2: FloatArray
    path_gain: FloatArray


@dataclass(frozen=True)
class View:
    """Arguments of a radar cross section. Shapes: time_s (I,); radar_position_m (3,)."""

    motion: Motion
    time_s: FloatArray
    radar_position_m: FloatArray

    @cached_property
    def skeleton(self) -> Skeleton:
        """Joints and ellipsoids of the body."""
        # A ConfigError is raised if its joints or height are unknown
        return build_skeleton(self.motion)

    @cached_property
    def frames(self) -> Ellipsoids:
        """Ellipsoids at the frames of the motion."""
        return compute_frame_ellipsoids(self.skeleton)

    @cached_property
    def body(self) -> Ellipsoids:
        """Ellipsoids at the pulse times."""
        return compute_ellipsoids_at(self.skeleton, self.time_s)

    def compute_sight_gain(self, points: Motion) -> FloatArray:
        """Compute the two-way gain past the body, (I, L)."""
        own = find_own_points(points.position_m, self.frames)
        return compute_visible_power(resample(points, self.time_s)[0], self.body, own, self.radar_position_m)


class RcsKind(Protocol):
    """Kind of radar cross section: points of the placed motion and their means."""

    def __call__(self, view: View, parameters: Any, /) -> tuple[Motion, FloatArray]:
        """Return L points and their cross sections in m^2, shape (L,) or (I, L)."""


def compute_scatterers(
    motion: Motion,
    spec: RcsSpec,
    time_s: FloatArray,
    radar_position_m: npt.ArrayLike,
    *,
    rng: np.random.Generator | None = None,
) -> Scatterers:
    """Compute the scatterers of one target (E-08).

    Parameters
    ----------
    motion : Motion
        Motion in the scene's world frame.
    time_s : ndarray, shape (I,)
        Pulse times after the motion's first frame.
    radar_position_m : array_like, shape (3,)
    rng : numpy.random.Generator, optional
        Used only if ``spec.needs_rng``.

    Raises
    ------
    ConfigError
        If ``spec`` needs ``rng``, or joints that the motion lacks.

    Examples
    --------
    >>> import doppelgait as dg
    >>> import numpy as np
    >>> motion = dg.motion.boulic_walk(duration_s=2.0)
    >>> scatterers = dg.scene.compute_scatterers(motion, dg.scene.RcsSpec(), np.array([0.0, 1.0]), (5.0, 0.0, 1.0))
    >>> scatterers.rcs_m2.size, round(float(scatterers.rcs_m2.sum()), 2)  # number and total
    (17, 0.7)
    """
    if spec.needs_rng and rng is None:
        raise ConfigError(
            f"rcs: total_spread_db = {spec.total_spread_db:g}, fluctuation = {spec.fluctuation!r}: a random value "
            "needs rng: pass rng=doppelgait.rng(SEED)"
        )
    view = View(motion, time_s, np.asarray(radar_position_m, dtype=float))
    points, rcs_m2 = RCS.of(spec).run(view, spec)
    if spec.merge_closer_than_m is not None:
        if rcs_m2.ndim != 1:
            raise ConfigError(f"rcs kind {spec.kind!r} changes with time; remove merge_closer_than_m")
        points, rcs_m2 = merge_close(points, rcs_m2, closer_than_m=spec.merge_closer_than_m)
    gain = view.compute_sight_gain(points) if spec.occlusion else np.ones(())
    if rng is not None and spec.total_spread_db > 0:
        rcs_m2 = rcs_m2 * sample_spread(spec.total_spread_db, rng)
    if rng is not None and spec.fluctuation != "none":
        rcs_m2 = rcs_m2 * sample_fluctuation(
            spec.fluctuation, time_s, rcs_m2.shape[-1], correlation_s=spec.correlation_s, rng=rng
        )
    return Scatterers(points, rcs_m2, gain)


@plugin("rcs", "auto", parameters=RcsSpec)
@plugin("rcs", "body_parts", parameters=RcsSpec)
@plugin("rcs", "equal", parameters=RcsSpec)
def scatter_points(view: View, spec: RcsSpec) -> tuple[Motion, FloatArray]:
    """Return the motion's points and their constant cross sections (L,)."""
    warn_of_unknown_parts(spec, view.motion)
    return view.motion, scatterer_rcs_m2(spec, view.motion.parts, view.motion.facts.mass_kg)


@plugin("rcs", "ellipsoids", parameters=RcsSpec)
def scatter_ellipsoids(view: View, spec: RcsSpec) -> tuple[Motion, FloatArray]:
    """Return the ellipsoid points facing the radar (E-08c, E-08f, E-08g)."""
    # far from the radar, the mean sum of their cross sections (I, S) is the stated total
    total_m2 = total_rcs_m2(spec, view.motion.facts.mass_kg)
    seen_m2 = seen_rcs_m2(view.body, view.radar_position_m)
    points = find_nearest_points(view.skeleton, view.frames, view.radar_position_m)
    return points, seen_m2 * (total_m2 / mean_rcs_m2(view.frames))


def merge_close(motion: Motion, rcs_m2: npt.ArrayLike, *, closer_than_m: float) -> tuple[Motion, FloatArray]:
    """Merge points with a median distance below a limit (E-08).

    Echoes of points within a quarter wavelength (1.03 cm at 7.29 GHz) add coherently: the cross
    section of L points can be up to L times the sum of their cross sections. The groups are
    constant over the motion. They are found by complete linkage: any two points of a group are
    closer than the limit. Ties between equal distances (of a symmetric body) are resolved by the
    order of the points.

    Parameters
    ----------
    rcs_m2 : array_like, shape (P,)
        Mean radar cross section of every point.
    closer_than_m : float
        Positive.

    Returns
    -------
    motion : Motion
        Groups at the mean position of their points, named ``"A+B"``, with the body part of the
        strongest point, in the order of their first points. The report lists the groups as
        ``merged``.
    rcs_m2 : ndarray, shape (number of groups,)
        Sums over the groups; the total does not change.

    Examples
    --------
    >>> import doppelgait as dg
    >>> import numpy as np
    >>> motion = dg.motion.boulic_walk(duration_s=2.0)
    >>> merged, rcs_m2 = dg.scene.merge_close(motion, np.full(17, 0.01), closer_than_m=0.2)
    >>> rcs_m2.size, round(float(rcs_m2.sum()), 2)  # fewer scatterers of the same total
    (15, 0.17)
    """
    weights = np.asarray(rcs_m2, dtype=float)
    groups = close_groups(motion, closer_than_m)
    names, parts = motion.markers, motion.parts
    merged = motion.with_points(
        average_points(motion, groups),
        ["+".join(names[n] for n in group) for group in groups],
        [parts[max(group, key=lambda n: weights[n])] for group in groups],
    ).with_report(merged=[[names[n] for n in group] for group in groups if len(group) > 1])
    return merged, np.array([weights[group].sum() for group in groups])


def close_groups(motion: Motion, closer_than_m: float) -> list[list[int]]:
    """Group points with median distances below the limit."""
    # all pairs of a group are below the limit; groups are in the order of their first points
    from scipy.cluster.hierarchy import fcluster, linkage
    from scipy.spatial.distance import squareform

    n_points = len(motion.markers)
    if n_points < 2:
        return [[n] for n in range(n_points)]
    distance_m = np.round(median_distances_m(motion), 9)  # rounding errors must not break ties
    # fcluster joins points with a distance of at most t
    below = float(np.nextafter(closer_than_m, 0.0))
    labels = fcluster(linkage(squareform(distance_m, checks=False), "complete"), below, criterion="distance")
    groups: dict[int, list[int]] = {}
    for n, label in enumerate(labels.tolist()):
        groups.setdefault(label, []).append(n)
    return list(groups.values())


def median_distances_m(motion: Motion) -> FloatArray:
    """Compute median distances over time between all points. The result has the shape (P, P), m."""
    step = -(-motion.n_frames // MAX_FRAMES)
    frames = motion.position_m[::step]
    result = np.zeros((len(motion.markers), len(motion.markers)))
    for n in range(len(motion.markers)):
        offset = frames - frames[:, n : n + 1]
        result[n] = np.median(np.sqrt((offset * offset).sum(axis=-1)), axis=0)
    return result
