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
    build_skeleton,
    compute_ellipsoids,
    compute_visible_power,
    draw_surface,
    find_joints,
    find_nearest_points,
    find_own_points,
    make_limbs,
    mean_rcs_m2,
    place_specular_points,
    see_ellipsoids,
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
BLOCK_PULSES = 8192  # of which a body is computed at a time


@dataclass(frozen=True)
class Scatterers:
    """Positions and radar cross sections of a target's scatterers.

    Parameters
    ----------
    motion : Motion
        One point per scatterer, L of them.
    rcs_m2, path_gain : ndarray, broadcastable to (I, L)
        Radar cross section (m^2) and two-way power gain of the path (1) at the I pulse times.
    phase_rad : ndarray (I, L), optional
        Phase of the reflection, against that of a point.
    """

    motion: Motion
    rcs_m2: FloatArray
    path_gain: FloatArray
    phase_rad: FloatArray | None = None


@dataclass(frozen=True)
class View:
    """Arguments of a radar cross section. Shapes: time_s (I,); radar_position_m (3,)."""

    motion: Motion
    time_s: FloatArray
    radar_position_m: FloatArray
    wavelength_m: float | None = None
    rng: np.random.Generator | None = None

    @cached_property
    def skeleton(self) -> Skeleton:
        """Joints and ellipsoids of the body."""
        # A ConfigError is raised if its joints or height are unknown
        return build_skeleton(self.motion)

    @cached_property
    def frames(self) -> Ellipsoids:
        """Ellipsoids at the frames of the motion."""
        return compute_ellipsoids(self.skeleton)

    def compute_sight_gain(self, points: Motion) -> FloatArray:
        """Compute the two-way gain past the body, (I, L)."""
        own, body = find_own_points(points.position_m, self.frames), compute_ellipsoids(self.skeleton, self.time_s)
        return compute_visible_power(resample(points, self.time_s)[0], body, own, self.radar_position_m)


class RcsKind(Protocol):
    """Kind of radar cross section: points of the placed motion and their means."""

    def __call__(self, view: View, parameters: Any, /) -> tuple[Motion, FloatArray] | tuple[Motion, FloatArray, Any]:
        """Return L points, their cross sections in m^2, (L,) or (I, L), and phases in rad, (I, L), if they have any."""


def compute_scatterers(
    motion: Motion,
    spec: RcsSpec,
    time_s: FloatArray,
    radar_position_m: npt.ArrayLike,
    *,
    wavelength_m: float | None = None,
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
    wavelength_m : float, optional
        Positive; needed for ``surfaces``.
    rng : numpy.random.Generator, optional
        Needed if ``spec.needs_rng``. A body of surfaces is a draw; without it, the middle of the law.

    Raises
    ------
    ConfigError
        If ``spec`` needs ``rng`` or ``wavelength_m``, or joints that the motion lacks.

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
    view = View(motion, time_s, np.asarray(radar_position_m, dtype=float), wavelength_m, rng)
    points, rcs_m2, *phases = RCS.of(spec).run(view, spec)
    gain = view.compute_sight_gain(points) if spec.occlusion else np.ones(())
    if rng is not None and spec.total_spread_db > 0:
        rcs_m2 = rcs_m2 * sample_spread(spec.total_spread_db, rng)
    if rng is not None and spec.fluctuation != "none":
        rcs_m2 = rcs_m2 * sample_fluctuation(
            spec.fluctuation, time_s, rcs_m2.shape[-1], correlation_s=spec.correlation_s, rng=rng
        )
    return Scatterers(points, rcs_m2, gain, *phases)


@plugin("rcs", "auto", parameters=RcsSpec)
def scatter_auto(view: View, spec: RcsSpec) -> tuple[Motion, FloatArray] | tuple[Motion, FloatArray, FloatArray]:
    """Return surfaces before a radar, if the body's joints and height are known; else points."""
    known = view.motion.facts.height_m > 0 and not find_joints(view.motion)[2]
    if known and view.wavelength_m is not None:
        return scatter_surfaces(view, spec)
    return scatter_points(view, spec)


@plugin("rcs", "body_parts", parameters=RcsSpec)
@plugin("rcs", "equal", parameters=RcsSpec)
def scatter_points(view: View, spec: RcsSpec) -> tuple[Motion, FloatArray]:
    """Return the motion's points and their constant cross sections (L,)."""
    warn_of_unknown_parts(spec, view.motion)
    return view.motion, scatterer_rcs_m2(spec, view.motion.parts, view.motion.facts.mass_kg)


@plugin("rcs", "surfaces", parameters=RcsSpec)
def scatter_surfaces(view: View, spec: RcsSpec) -> tuple[Motion, FloatArray, FloatArray]:
    """Return ellipsoid points and the specular points of limbs, with the limbs' phases (E-08c, E-08f to E-08h)."""
    # far from the radar, the mean sum of the cross sections (I, S) is the stated total
    if view.wavelength_m is None:
        raise ConfigError(
            "rcs kind 'surfaces' depends on the carrier: pass wavelength_m, for example 0.0411 m, or use rcs kind "
            "'body_parts'"
        )
    skeleton, radar_m, frames = view.skeleton, view.radar_position_m, view.frames
    surface = draw_surface(skeleton, view.rng)
    points = find_nearest_points(skeleton, frames, radar_m)
    limbs, mean_m2 = make_limbs(skeleton, surface, view.motion.facts.height_m), mean_rcs_m2(frames)
    position_m, (rcs_m2, phase_rad) = points.position_m.copy(), np.zeros((2, view.time_s.size, mean_m2.size))
    for first in range(0, view.time_s.size, BLOCK_PULSES):  # a body at all pulses of an hour would not fit
        block = slice(first, first + BLOCK_PULSES)
        body = compute_ellipsoids(skeleton, view.time_s[block])
        rcs_m2[block] = see_ellipsoids(body, radar_m)[1]
        for n, limb in limbs.items():
            sight_m = radar_m - body.centre_m[:, n]
            range_m = np.maximum(np.sqrt(np.square(sight_m).sum(axis=1)), 1e-9)
            along = (sight_m * body.along[:, n]).sum(axis=1) / range_m
            size_m, phase_rad[block, n] = limb.compute_field(along, range_m, view.wavelength_m)
            rcs_m2[block, n] = size_m * size_m
    for n, limb in limbs.items():
        position_m[:, n] = place_specular_points(frames, n, limb, radar_m)
        mean_m2[n] = limb.compute_mean_rcs_m2(frames.along[:, n], view.wavelength_m)
    share = surface.power * (total_rcs_m2(spec, view.motion.facts.mass_kg) / float(mean_m2 @ surface.power))
    rcs_m2 *= share
    return points.with_points(position_m, points.markers, points.parts), rcs_m2, phase_rad
