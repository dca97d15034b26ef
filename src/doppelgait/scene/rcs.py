"""Radar cross section: total and shares of points; the scatterers of a placed motion.

The total is 0.01 m^2 per kilogram of body mass, that is 0.8 m^2 for 80 kg (E-08b; 0.37 to 1.9 m^2
were measured for a person of 91 kg at 4.8 and 9.4 GHz). It is the same at every carrier: averages
of people at 23-28 and 76-81 GHz are close to each other (Fortuny-Guasch and Chareau 2013), and 3GPP
uses 0.73 m^2 in all bands (TR 38.901, release 19). The same law applies to people and animals, so
that the power does not reveal the class.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, Protocol

import numpy as np
import numpy.typing as npt
from pydantic import Field, field_validator

from doppelgait._core import native
from doppelgait.core.config import FrozenModel
from doppelgait.core.errors import ConfigError, warn_caller
from doppelgait.core.plugins import Group, plugin
from doppelgait.motion.motion import Motion
from doppelgait.motion.retime import resample
from doppelgait.motion.skeleton import BODY_CENTRE_PARTS, DOG_PARTS, HUMAN_PARTS
from doppelgait.scene.bodies import (
    TABLES,
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
    name_sides,
    place_specular_points,
    see_ellipsoids,
)

FloatArray = npt.NDArray[np.float64]
Fluctuation = Literal["none", "swerling1", "swerling3"]

DEGREES_OF_FREEDOM = {"swerling1": 2, "swerling3": 4}
"""Degrees of freedom of the chi-square law: 2 for many equal scatterers, 4 for one dominant one (Swerling 1954)."""

REACH = 9
"""Half length of the smoothing window in steps of half a correlation time; its value is exp(-4.5^2) = 2e-9 there."""

RCS_PER_MASS_M2_PER_KG = 0.8 / 80.0
ASSUMED_MASS_KG = 80.0

TYPICAL_RCS_M2 = {"human": 0.8, "dog": 0.2, "cat": 0.045}
"""Mean total cross section of a person of 80 kg, a dog of 20 kg and a cat of 4.5 kg (E-08b), m^2.

The person's value is in the middle of the measurements of a man of 91 kg over all aspects, 0.37 to
1.88 m^2 at 4.8 GHz and 0.50 to 1.22 m^2 at 9.4 GHz; the cross section is roughly proportional to
body mass (Schultz, Burgener and King 1958). No measurement of a dog or a cat at these frequencies
is known: the same proportion is assumed for them.
"""

MOST_NAMES = 8  # maximum number of point names in a warning

PART_WEIGHTS: dict[str, float] = {name: share for key, share in TABLES["shares"].items() for name in name_sides(key)}
"""Share of the total by body part (E-08)."""
HEIRS = {
    part: heir
    for key, heirs in TABLES["heirs"].items()
    for part, heir in zip(name_sides(key), name_sides(heirs), strict=True)
}
"""Part that gets the share of a part without points, by that part."""


RCS: Group[Any] = Group("rcs", built_in=("doppelgait.scene.rcs",), noun="rcs")
"""Kinds of radar cross section by name: :class:`RcsKind` and parameters that extend :class:`RcsSpec`."""


class RcsSpec(FrozenModel):
    """Parameters of a target's radar cross section.

    They set the total, its split among points and its change with time.

    kind: ``surfaces``: one scatterer per body segment, limbs as rough tapered cylinders that flash
        at broadside, the others as ellipsoids (:mod:`doppelgait.scene.bodies`); a draw, or the
        smooth middle of the law without random streams; needs a radar and known joints.
        ``body_parts``: points share the total by body part. ``equal``: points alike. ``auto``: surfaces
        if radar, joints and height are known, else by part if trunk or all are, else equal.
    total_m2: Sum over the scatterers (sigma), m^2; by default 0.01 m^2 per kilogram of body mass.
        For surfaces it is the mean of this sum over the motion's frames and all horizontal directions.
    total_spread_db: Standard deviation of a log-normal factor of mean 1 on the total, sampled once
        per target, 0 to 10 dB; 2 dB is usual between people.
    fluctuation: Slow independent fluctuation of every scatterer around its mean
        (:mod:`doppelgait.scene.rcs`).
    correlation_s: Correlation time of the fluctuation, 0.001 to 100 s.
    occlusion: Let the body's ellipsoids hide scatterers behind them; needs points with known
        joints.
    """

    kind: str = "auto"
    total_m2: float | None = Field(default=None, gt=0, le=1e4)
    total_spread_db: float = Field(default=0.0, ge=0, le=10)
    fluctuation: Fluctuation = "none"
    correlation_s: float = Field(default=0.1, ge=1e-3, le=100)
    occlusion: bool = False

    @field_validator("kind")
    @classmethod
    def _is_known(cls, kind: str) -> str:
        if kind not in RCS:
            raise ValueError(f"known are {', '.join(RCS)}")
        return kind

    @property
    def needs_rng(self) -> bool:
        """True if a parameter makes the cross section random."""
        return self.total_spread_db > 0 or self.fluctuation != "none"


def compute_part_weights(parts: Sequence[str]) -> npt.NDArray[np.float64]:
    """Compute the weights of points by body part (E-08).

    The points of a part share its weight, so that the marker set does not change the total of a part.

    Parameters
    ----------
    parts : sequence of str, length L
        Body part of every scatterer. Points without a known part share the weights of the parts
        that have no points; if all parts have points, their weight is 0.

    Returns
    -------
    ndarray, shape (L,)
        Weights, not negative, with the sum 1.

    Raises
    ------
    ConfigError
        If no part is known.

    See Also
    --------
    scatterer_rcs_m2 : radar cross section of every scatterer.

    Examples
    --------
    >>> from doppelgait.scene import compute_part_weights
    >>> compute_part_weights(["torso", "left_hand"]).round(2)
    array([0.94, 0.06])
    """
    known = np.array([part in PART_WEIGHTS for part in parts])
    if not known.any():
        raise ConfigError("rcs kind 'body_parts' needs points with known body parts; use 'equal'")
    counts = Counter(parts)
    shares = {part: PART_WEIGHTS.get(part, 0.0) for part in counts}
    for part, heir in HEIRS.items():
        if part not in counts and heir in counts:
            shares[heir] += PART_WEIGHTS[part]
    weights = np.array([shares[p] / counts[p] for p in parts])
    if not known.all():
        body = DOG_PARTS if "trunk" in counts else HUMAN_PARTS
        absent = [part for part in body if part not in counts and HEIRS.get(part) not in counts]
        weights[~known] = sum(PART_WEIGHTS[part] for part in absent) / (~known).sum()
    return np.asarray(weights / weights.sum(), dtype=np.float64)


def is_split_by_part(parts: Sequence[str]) -> bool:
    """Return True if ``auto`` splits by part: trunk or every point is known."""
    return any(part in BODY_CENTRE_PARTS for part in parts) or all(part in PART_WEIGHTS for part in parts)


def warn_of_unknown_parts(spec: RcsSpec, motion: Motion) -> None:
    """Warn of points without a known body part. The message states their cross sections."""
    unknown = [name for name, part in zip(motion.markers, motion.parts, strict=True) if part not in PART_WEIGHTS]
    is_body = motion.facts.kind == "recording" or len(unknown) < len(motion.parts)
    if spec.kind == "equal" or not unknown or not is_body:
        return
    shown = ", ".join(unknown[:MOST_NAMES]) + (", ..." if len(unknown) > MOST_NAMES else "")
    if spec.kind == "auto" and not is_split_by_part(motion.parts):
        warn_caller(
            f"{motion.label}: the trunk is unknown and these points have no known body part: {shown}. All points "
            "scatter equally, which makes limbs too strong. Name the points after body parts, or set rcs kind 'equal'."
        )
        return
    warn_caller(
        f"{motion.label}: points without a known body part: {shown}. They share the cross section of the parts that "
        "have no points, or have none. Name them after body parts, or remove them."
    )


def total_rcs_m2(spec: RcsSpec, mass_kg: float) -> float:
    """Compute the mean total sigma, m^2."""
    # it is the stated total, or 0.01 m^2 per kilogram (E-08b); an unknown mass is replaced by 80 kg
    mass = mass_kg if mass_kg > 0 else ASSUMED_MASS_KG
    return RCS_PER_MASS_M2_PER_KG * mass if spec.total_m2 is None else spec.total_m2


def scatterer_rcs_m2(spec: RcsSpec, parts: Sequence[str], mass_kg: float) -> npt.NDArray[np.float64]:
    """Compute every point's mean radar cross section, sigma w_l (E-08).

    The result has the shape (L,), m^2.

    See Also
    --------
    compute_part_weights : shares of the body parts.

    Examples
    --------
    >>> import doppelgait as dg
    >>> rcs_m2 = dg.scene.scatterer_rcs_m2(dg.scene.RcsSpec(total_m2=0.5), ["torso", "left_hand"], 70.0)
    >>> round(float(rcs_m2.sum()), 2)
    0.5
    """
    by_part = spec.kind == "body_parts" or (spec.kind == "auto" and is_split_by_part(parts))
    weights = compute_part_weights(parts) if by_part else np.full(len(parts), 1.0 / len(parts))
    return total_rcs_m2(spec, mass_kg) * weights


def sample_fluctuation(
    kind: Literal["swerling1", "swerling3"],
    time_s: npt.ArrayLike,
    n_scatterers: int,
    *,
    correlation_s: float,
    rng: np.random.Generator,
) -> FloatArray:
    r"""Draw slowly fluctuating factors of mean 1 (E-08d). Shapes: time_s (I,); returns (I, n_scatterers)."""
    # they are independent from scatterer to scatterer
    times = np.ascontiguousarray(time_s, dtype=np.float64)
    last_s = float(times.max()) if times.size else 0.0
    count = int(np.ceil(2.0 * last_s / correlation_s)) + 2 * REACH + 2
    own = np.random.default_rng(rng.integers(2**63))
    normal = own.standard_normal((count, n_scatterers, DEGREES_OF_FREEDOM[kind]))
    factor = np.empty((times.size, n_scatterers))
    native.smoothed_chi_square(normal.reshape(count, -1), times, correlation_s, REACH, factor)
    return factor


def sample_spread(spread_db: float, rng: np.random.Generator) -> float:
    """Draw a log-normal factor of mean 1 (E-08b)."""
    # its decibels have the standard deviation spread_db
    deviation = spread_db * math.log(10.0) / 10.0
    return math.exp(deviation * rng.standard_normal() - deviation**2 / 2.0)


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
