"""People as they come: sex, age, stature, mass, preferred speed and proportions."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from doppelgait.motion.models.boulic import LENGTHS
from doppelgait.motion.models.human_run import ADULT_M

AgeClass = Literal["child", "adult", "senior"]
Body = Literal["adult", "child"]

CHILD_M = (0.9, 1.6)
"""Statures of the child's figure; at the upper end it has an adult's proportions."""
_SMALLEST = {"leg": 0.885, "head": 1.38}
"""Legs and head of a child of 0.9 m relative to an adult's, as shares of the stature (sitting height 0.575 H against
0.52 H, a head height in 5 against 7.5; assumed)."""
_STATURE_M = {"male": (1.75, 0.07), "female": (1.62, 0.065)}
_SPEED_MPS: dict[AgeClass, tuple[float, float]] = {
    "adult": (1.35, 0.18), "senior": (1.15, 0.20), "child": (1.35, 0.18)
}  # fmt: skip


@dataclass(frozen=True)
class Person:
    """Someone drawn by :func:`sample_person`; the speed is the preferred one in a walk."""

    sex: str
    age_class: AgeClass
    age_years: float
    height_m: float
    mass_kg: float
    speed_mps: float
    walk_ratio: float

    @property
    def body(self) -> Body:
        """Proportions of the figure: a child's where the stature is within their range."""
        return "child" if self.age_class == "child" and self.height_m <= CHILD_M[1] else "adult"


def segment_lengths(body: Body, height_m: float) -> dict[str, float]:
    """Segment lengths as fractions of the stature.

    A child has shorter legs and a larger head, by straight lines in the stature from 1.6 m down to 0.9 m; the trunk
    takes the difference, so that head, trunk and leg add up as in the adult.

    Parameters
    ----------
    body : str
        ``"adult"`` (those of Chen 2011 at any stature) or ``"child"``.
    height_m : float
        Stature; a child's 0.9 to 1.6.
    """
    if body == "adult":
        return dict(LENGTHS)
    young = (CHILD_M[1] - height_m) / (CHILD_M[1] - CHILD_M[0])
    leg, head = (1 + young * (_SMALLEST[part] - 1) for part in ("leg", "head"))
    child = (
        LENGTHS | {part: LENGTHS[part] * leg for part in ("thigh", "shank", "foot")} | {"head": LENGTHS["head"] * head}
    )
    spine = ("head", "torso", "thigh", "shank")
    return child | {
        "torso": sum(LENGTHS[part] for part in spine) - sum(child[part] for part in spine if part != "torso")
    }


def sample_person(rng: np.random.Generator, *, age_class: AgeClass = "adult") -> Person:
    """Draw a person.

    Adults (20 to 65 years) and seniors (65 to 85): stature normal, men 1.75 +- 0.07 m, women 1.62 +- 0.065 m; body mass
    index lognormal about 24 kg/m^2 with 13 % (assumed); preferred speed normal, 1.35 +- 0.18 m/s, seniors
    1.15 +- 0.2 m/s, within 0.4 to 2.0 (after Bohannon 1997; Bohannon and Andrews 2011). Children (3 to 12 years):
    Weech's rules, H = 0.77 m + 0.06 m a with 4.5 % (assumed), mass (2 a + 8) kg to 6 years, then (7 a - 5)/2 kg, with
    12 % (assumed); an adult's speed at equal Froude number. Walk ratio relative to the model's: lognormal, 8 %, within
    3 deviations.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of chance; always six draws.
    age_class : str
        ``"child"``, ``"adult"`` or ``"senior"``.

    Returns
    -------
    Person
    """
    male, old = rng.random(2)
    size, weight, pace, ratio = np.clip(rng.standard_normal(4), -3.0, 3.0)
    sex = "male" if male < 0.5 else "female"
    if age_class == "child":
        age_years = 3.0 + 9.0 * old
        height_m = max(CHILD_M[0], (0.77 + 0.06 * age_years) * (1 + 0.045 * size))
        mean_kg = 2 * age_years + 8 if age_years <= 6 else (7 * age_years - 5) / 2
        mass_kg, scale = mean_kg * math.exp(0.12 * weight), math.sqrt(height_m / ADULT_M)
    else:
        age_years = 20 + 45 * old if age_class == "adult" else 65 + 20 * old
        mean_m, sd_m = _STATURE_M[sex]
        height_m = mean_m + sd_m * size
        mass_kg, scale = 24.0 * math.exp(0.13 * weight) * height_m**2, 1.0
    mean_mps, sd_mps = _SPEED_MPS[age_class]
    speed_mps = scale * float(np.clip(mean_mps + sd_mps * pace, 0.4, 2.0))
    person = {"age_years": age_years, "height_m": height_m, "mass_kg": mass_kg, "speed_mps": speed_mps}
    return Person(sex, age_class, walk_ratio=math.exp(0.08 * ratio), **{k: float(v) for k, v in person.items()})
