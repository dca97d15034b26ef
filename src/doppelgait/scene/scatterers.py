"""Points of a placed motion -> scatterers with their radar cross sections: the one place where the kinds differ."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import ConfigError
from doppelgait.motion.motion import Motion
from doppelgait.motion.retime import resample
from doppelgait.scene.ellipsoids import (
    Ellipsoids,
    Skeleton,
    centres,
    ellipsoids_at,
    ellipsoids_of_frames,
    mean_rcs_m2,
    seen_rcs_m2,
    skeleton_of,
)
from doppelgait.scene.fluctuation import fluctuation_factor, spread_factor
from doppelgait.scene.merge import merge_close
from doppelgait.scene.occlusion import own_points, visible_power
from doppelgait.scene.rcs import RcsSpec, scatterer_rcs_m2, total_rcs_m2

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Scatterers:
    """Where a target scatters and how much.

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


def scatterers_of(
    motion: Motion,
    spec: RcsSpec,
    time_s: FloatArray,
    radar_position_m: npt.ArrayLike,
    *,
    rng: np.random.Generator | None = None,
) -> Scatterers:
    """Scatterers of one target (E-08).

    Parameters
    ----------
    motion : Motion
        In the scene's world frame.
    spec : RcsSpec
    time_s : ndarray, shape (I,)
        Pulse times after the motion's first frame.
    radar_position_m : array_like, shape (3,)
    rng : numpy.random.Generator, optional
        Touched only where ``spec`` draws something.

    Raises
    ------
    ConfigError
        If ``spec`` needs ``rng`` or joints that are not there.
    """
    if spec.needs_rng and rng is None:
        raise ConfigError(
            f"rcs: total_spread_db = {spec.total_spread_db:g}, fluctuation = {spec.fluctuation!r}: what is drawn needs "
            "rng: pass rng=doppelgait.rng(SEED)"
        )
    on_body = spec.kind == "ellipsoids" or spec.occlusion
    skeleton = skeleton_of(motion) if on_body else None
    body = ellipsoids_at(skeleton, time_s) if skeleton is not None else None
    if skeleton is not None and body is not None and spec.kind == "ellipsoids":
        points, rcs_m2 = _ellipsoid_scatterers(skeleton, body, spec, radar_position_m)
    else:
        points, rcs_m2 = _point_scatterers(motion, spec)
    gain = np.ones(())
    if skeleton is not None and body is not None and spec.occlusion:
        own = own_points(points.position_m, ellipsoids_of_frames(skeleton))
        gain = visible_power(resample(points, time_s)[0], body, own, radar_position_m)
    return Scatterers(points, _drawn(rcs_m2, spec, time_s, rng) if rng is not None else rcs_m2, gain)


def _point_scatterers(motion: Motion, spec: RcsSpec) -> tuple[Motion, FloatArray]:
    """The motion's points, or groups of them, with a constant share of the total each; (L,)."""
    rcs_m2 = scatterer_rcs_m2(spec, motion.parts, motion.facts.mass_kg)
    if spec.merge_closer_than_m is None:
        return motion, rcs_m2
    return merge_close(motion, rcs_m2, closer_than_m=spec.merge_closer_than_m)


def _ellipsoid_scatterers(
    skeleton: Skeleton, body: Ellipsoids, spec: RcsSpec, radar_position_m: npt.ArrayLike
) -> tuple[Motion, FloatArray]:
    """The ellipsoids' centres, and their cross sections (I, S) scaled so that their mean sum is the total (E-08c)."""
    total_m2 = total_rcs_m2(spec, skeleton.joints.facts.mass_kg)
    return centres(skeleton), seen_rcs_m2(body, radar_position_m) * (total_m2 / mean_rcs_m2(skeleton))


def _drawn(rcs_m2: FloatArray, spec: RcsSpec, time_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Cross sections around a drawn total, fluctuating as asked for."""
    if spec.total_spread_db > 0:
        rcs_m2 = rcs_m2 * spread_factor(spec.total_spread_db, rng)
    if spec.fluctuation != "none":
        factor = fluctuation_factor(
            spec.fluctuation, time_s, rcs_m2.shape[-1], correlation_s=spec.correlation_s, rng=rng
        )
        rcs_m2 = rcs_m2 * factor
    return rcs_m2
