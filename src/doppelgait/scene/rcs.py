"""Radar cross section of the scatterers of a target.

Total: 0.01 m^2 per kilogram of body mass, that is 0.8 m^2 for 80 kg (E-08b; measured 0.37 to 1.9 m^2 for a person of
91 kg at 4.8 and 9.4 GHz). The same law for people and animals, so that the class is not in the power.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field

from doppelgait.core.config import FrozenModel
from doppelgait.core.errors import ConfigError

RCS_PER_MASS_M2_PER_KG = 0.8 / 80.0
ASSUMED_MASS_KG = 80.0

PART_WEIGHTS = {
    "torso": 0.50, "head": 0.10,
    "left_thigh": 0.07, "right_thigh": 0.07, "left_shank": 0.055, "right_shank": 0.055,
    "left_foot": 0.015, "right_foot": 0.015, "left_upper_arm": 0.03, "right_upper_arm": 0.03,
    "left_forearm": 0.02, "right_forearm": 0.02, "left_hand": 0.01, "right_hand": 0.01,
    "trunk": 0.65, "neck": 0.06, "tail": 0.01,
    "left_fore_upper": 0.03, "right_fore_upper": 0.03, "left_fore_lower": 0.015, "right_fore_lower": 0.015,
    "left_fore_paw": 0.005, "right_fore_paw": 0.005,
    "left_hind_upper": 0.04, "right_hind_upper": 0.04, "left_hind_lower": 0.015, "right_hind_lower": 0.015,
    "left_hind_paw": 0.005, "right_hind_paw": 0.005,
}  # fmt: skip
"""Share of the total by body part (E-08 for people; assumed for dogs, by area); normalised over the parts present."""

HEIRS = {
    f"{side}_{part}": f"{side}_{heir}"
    for side in ("left", "right")
    for part, heir in (
        ("forearm", "hand"), ("hand", "forearm"), ("foot", "shank"), ("shank", "foot"),
        ("fore_paw", "fore_lower"), ("fore_lower", "fore_paw"), ("hind_paw", "hind_lower"), ("hind_lower", "hind_paw"),
    )
} | {"neck": "trunk", "tail": "trunk"}  # fmt: skip
"""Part that takes the share of one that has no point of its own."""


class RcsSpec(FrozenModel):
    """How a target's radar cross section is split over its scatterers.

    Parameters
    ----------
    kind : {"auto", "body_parts", "equal"}
        ``auto``: by body part where every point's part is known, else equal.
    total_m2 : float, optional
        Sum over the scatterers (sigma), m^2; by default 0.01 m^2 per kilogram of body mass.
    """

    kind: Literal["auto", "body_parts", "equal"] = "auto"
    total_m2: float | None = Field(default=None, gt=0, le=1e4)


def part_weights(parts: Sequence[str]) -> npt.NDArray[np.float64]:
    """Weights by body part, shared equally by the points of a part, so that the marker set does not matter (E-08).

    Parameters
    ----------
    parts : sequence of str, length L
        Body part of every scatterer. Points without a known part get the mean weight of the others.

    Returns
    -------
    ndarray, shape (L,)
        Non-negative, sum 1.

    Raises
    ------
    ConfigError
        If no part is known.
    """
    known = np.array([part in PART_WEIGHTS for part in parts])
    if not known.any():
        raise ConfigError("rcs kind 'body_parts' needs points with known body parts; use 'equal'")
    counts = {part: sum(p == part for p in parts) for part in set(parts)}
    shares = {part: PART_WEIGHTS.get(part, 0.0) for part in counts}
    for part, heir in HEIRS.items():
        if part not in counts and heir in counts:
            shares[heir] += PART_WEIGHTS[part]
    weights = np.array([shares[p] / counts[p] for p in parts])
    weights[~known] = weights[known].mean()
    return np.asarray(weights / weights.sum(), dtype=np.float64)


def scatterer_rcs_m2(spec: RcsSpec, parts: Sequence[str], mass_kg: float) -> npt.NDArray[np.float64]:
    """Mean radar cross section of every scatterer, sigma_l = sigma w_l; shape (L,), m^2."""
    by_part = spec.kind == "body_parts" or (spec.kind == "auto" and all(p in PART_WEIGHTS for p in parts))
    weights = part_weights(parts) if by_part else np.full(len(parts), 1.0 / len(parts))
    mass = mass_kg if mass_kg > 0 else ASSUMED_MASS_KG
    total = RCS_PER_MASS_M2_PER_KG * mass if spec.total_m2 is None else spec.total_m2
    return total * weights
