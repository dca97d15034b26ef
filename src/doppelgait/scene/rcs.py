"""Radar cross section: total and shares of points.

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
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field, field_validator

from doppelgait._core import native
from doppelgait.core.config import FrozenModel
from doppelgait.core.errors import ConfigError, warn_caller
from doppelgait.core.plugins import Group
from doppelgait.motion.motion import Motion
from doppelgait.motion.skeleton import BODY_CENTRE_PARTS, DOG_PARTS, HUMAN_PARTS
from doppelgait.scene.bodies import TABLES, name_sides

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


RCS: Group[Any] = Group("rcs", built_in=("doppelgait.scene.scatterers",), noun="rcs")
"""Kinds of radar cross section by name: :class:`doppelgait.scene.scatterers.RcsKind` and parameters
that extend :class:`RcsSpec`."""


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
