"""Points that are too close to be scatterers of their own, merged into one."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from doppelgait.motion.motion import Motion
from doppelgait.scene.points import mean_points

FloatArray = npt.NDArray[np.float64]

MAX_FRAMES = 200
"""Frames, evenly spread over the motion, from which the median distance of two points is taken."""


def merge_close(motion: Motion, rcs_m2: npt.ArrayLike, *, closer_than_m: float) -> tuple[Motion, FloatArray]:
    """Merge points whose median distance over the motion is below a limit (E-08).

    Echoes of points within a quarter wavelength (1.03 cm at 7.29 GHz) add coherently: L of them send back up to L times
    what their cross sections add up to. Who is merged with whom is decided once for the whole motion, by complete
    linkage: any two points of a group are closer than the limit. Equal distances (a body that is its own mirror image)
    are taken in the order of the points.

    Parameters
    ----------
    motion : Motion
    rcs_m2 : array_like, shape (P,)
        Mean radar cross section of every point.
    closer_than_m : float
        Positive.

    Returns
    -------
    motion : Motion
        Groups at the mean position of their points, named ``"A+B"``, with the body part of the strongest; in
        the order of their first points. The report lists the groups as ``merged``.
    rcs_m2 : ndarray, shape (number of groups,)
        Sums over the groups, so that the total stays.
    """
    weights = np.asarray(rcs_m2, dtype=float)
    groups = close_groups(motion, closer_than_m)
    names, parts = motion.markers, motion.parts
    merged = motion.with_points(
        mean_points(motion, groups),
        ["+".join(names[n] for n in group) for group in groups],
        [parts[max(group, key=lambda n: weights[n])] for group in groups],
    ).with_report(merged=[[names[n] for n in group] for group in groups if len(group) > 1])
    return merged, np.array([weights[group].sum() for group in groups])


def close_groups(motion: Motion, closer_than_m: float) -> list[list[int]]:
    """Groups of points with every median distance within a group below the limit, in order of their first points."""
    from scipy.cluster.hierarchy import fcluster, linkage
    from scipy.spatial.distance import squareform

    n_points = len(motion.markers)
    if n_points < 2:
        return [[n] for n in range(n_points)]
    distance_m = np.round(median_distances_m(motion), 9)  # so that rounding does not decide between equal distances
    # fcluster joins what is at most t apart
    below = float(np.nextafter(closer_than_m, 0.0))
    labels = fcluster(linkage(squareform(distance_m, checks=False), "complete"), below, criterion="distance")
    groups: dict[int, list[int]] = {}
    for n, label in enumerate(labels.tolist()):
        groups.setdefault(label, []).append(n)
    return list(groups.values())


def median_distances_m(motion: Motion) -> FloatArray:
    """Median over time of the distance of any two points, shape (P, P), m."""
    step = -(-motion.n_frames // MAX_FRAMES)
    frames = motion.position_m[::step]
    result = np.zeros((len(motion.markers), len(motion.markers)))
    for n in range(len(motion.markers)):
        offset = frames - frames[:, n : n + 1]
        result[n] = np.median(np.sqrt((offset * offset).sum(axis=-1)), axis=0)
    return result
