"""Body of a person: 17 points, lengths and sampled persons.

Points follow from joint angles. Persons are sampled from population statistics.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from doppelgait.core.config import check_choice, read_toml
from doppelgait.core.rng import RandomSource, as_generator
from doppelgait.core.units import FloatArray, cosine, sine
from doppelgait.motion.models.strides import (
    Timing,
    Values,
    evaluate_laws,
    make_column,
    make_gait_motions,
)
from doppelgait.motion.motion import Motion
from doppelgait.motion.skeleton import BOULIC_PARTS

Limbs = dict[str, FloatArray]
Curves = Callable[[FloatArray], Limbs]
"""Function of leg phases, left and right (2, B, n), that returns flexions in degrees by joint."""
Sizes = Mapping[str, Values]
"""Segment lengths in m by name."""
Hands = Literal["free", "pockets", "carrying", "bag", "phone", "pushing"]

PEOPLE: dict[str, Any] = read_toml(Path(__file__).with_name("people.toml"))[0]
LENGTHS: dict[str, float] = PEOPLE["lengths"]
"""Segment lengths as fractions of the stature."""

_CYCLE = np.arange(200) / 200


def swing_arms(
    curves: Curves, *, factors: tuple[FloatArray, FloatArray], hands: tuple[Sequence[Hands], Sequence[Hands]]
) -> Curves:
    """Change the arm swing of joint curves of a batch. Factors are columns, (B, 1)."""
    own = (factors[0] == 1.0) & (factors[1] == 1.0)
    own &= np.array([both == ("free", "free") for both in zip(*hands, strict=True)])[:, None]
    if own.all():
        return curves
    cycle = curves(np.broadcast_to(_CYCLE, (len(own), _CYCLE.size)))
    held = [[PEOPLE["held"].get(hand) for hand in side] for side in hands]
    means = {joint: cycle[joint].mean(axis=-1, keepdims=True) for joint in ("shoulder", "elbow")}

    def changed(phase: FloatArray) -> Limbs:
        limbs = curves(phase)
        for number, joint in enumerate(("shoulder", "elbow")):
            for side, factor, values in zip(held, factors, limbs[joint], strict=True):
                mean = means[joint].copy()
                for row, hand in enumerate(side):
                    if hand:
                        mean[row] = hand[number]
                share = make_column([hand[2] if hand else 1.0 for hand in side])
                changed_deg = mean + factor * share * (values - means[joint])
                values[...] = np.where(own, values, changed_deg)
        return limbs

    return changed


Place = tuple[Values, Values, Values]

POINTS = tuple(BOULIC_PARTS)
"""Names of the points in the published order."""

_SIDES = ("left", "right")
_LOWER = [POINTS.index(n) for n in ("base", *(f"{s}_{p}" for s in _SIDES for p in ("hip", "knee", "ankle", "toe")))]
_UPPER = [
    POINTS.index(n) for n in ("neck", "head", *(f"{s}_{p}" for s in _SIDES for p in ("shoulder", "elbow", "hand")))
]
"""Points that rotate with the pelvis and with the upper body, in the order of computation."""


def compute_figure_points(
    trunk_rad: Mapping[str, FloatArray], limbs_rad: Mapping[str, FloatArray], size_m: Sizes
) -> FloatArray:
    """Return points about the spine's base (Chen 2011), (17, 3, ..., n)."""
    lower = place_lower_body(trunk_rad, limbs_rad, size_m)
    result = np.empty((len(POINTS), *lower.shape[1:]))
    result[_LOWER], result[_UPPER] = lower, _place_upper_body(trunk_rad, limbs_rad, size_m)
    return result


def place_lower_body(
    trunk_rad: Mapping[str, FloatArray], limbs_rad: Mapping[str, FloatArray], size_m: Sizes
) -> FloatArray:
    """Return base of the spine, then hip, knee, ankle and toe of both sides."""
    shank = limbs_rad["hip"] - limbs_rad["knee"]
    # at an ankle angle of 0, the foot is a rod at right angles to the shank
    foot = shank + limbs_rad["ankle"] + np.pi / 2
    links = ((limbs_rad["hip"], size_m["thigh"]), (shank, size_m["shank"]), (foot, size_m["foot"]))
    lower = _place_limbs([0.0], size_m["half_hip"], links)
    _rotate(lower, trunk_rad["pelvic_list"], axis=0)
    _rotate(lower, -trunk_rad["pelvic_torsion"], axis=2)
    return lower


def _place_upper_body(
    trunk_rad: Mapping[str, FloatArray], arms_rad: Mapping[str, FloatArray], size_m: Sizes
) -> FloatArray:
    """Return neck, head, then shoulder, elbow and hand of both sides."""
    forearm = arms_rad["shoulder"] + arms_rad["elbow"]
    links = ((arms_rad["shoulder"], size_m["upper_arm"]), (forearm, size_m["forearm"]))
    heights = [size_m["torso"], size_m["torso"] + size_m["head"]]
    upper = _place_limbs(heights, size_m["half_shoulder"], links)
    _rotate(upper, -trunk_rad["trunk_pitch"], axis=1)
    _rotate(upper, -trunk_rad["thorax_torsion"], axis=2)
    return upper


def _place_limbs(heights: Sequence[Values], half_m: Values, links: Sequence[tuple[FloatArray, Values]]) -> FloatArray:
    """Return points of the spine, then both limbs from the first one's height, (k, 3, ..., n)."""
    # links hang down at angle 0; forward is positive
    points: list[Place] = [(0.0, 0.0, height) for height in heights]
    for side, y in enumerate((half_m, -half_m)):
        points.append((0.0, y, heights[0]))
        for angle_rad, length in links:
            x, _, z = points[-1]
            points.append((x + length * sine(angle_rad[side]), y, z - length * cosine(angle_rad[side])))
    found = np.empty((len(points), 3, *links[0][0].shape[1:]))
    for rows, point in zip(found, points, strict=True):
        for row, values in zip(rows, point, strict=True):
            row[...] = values
    return found


def place_left_hip(pelvis_rad: Mapping[str, FloatArray], size_m: Sizes) -> FloatArray:
    """Return the left hip relative to the spine's base, (3, ..., n); the right is opposite."""
    tilt, turn = pelvis_rad["pelvic_list"], pelvis_rad["pelvic_torsion"]
    aside = size_m["half_hip"] * cosine(tilt)
    return np.stack([sine(turn) * aside, cosine(turn) * aside, size_m["half_hip"] * sine(tilt)])


def place_legless_points(
    base_m: FloatArray,
    left_m: FloatArray,
    trunk_rad: Mapping[str, FloatArray],
    arms_rad: Mapping[str, FloatArray],
    size_m: Sizes,
) -> FloatArray:
    """Return a figure without knees, ankles and toes, (17, 3, ..., n)."""
    found = np.zeros((len(POINTS), *base_m.shape))
    found[_UPPER] = _place_upper_body(trunk_rad, arms_rad, size_m)
    found[POINTS.index("left_hip")], found[POINTS.index("right_hip")] = left_m, -left_m
    found += base_m
    return found


def _rotate(points: FloatArray, angle_rad: FloatArray, *, axis: int) -> None:
    """Rotate points (k, 3, ..., n) about a coordinate axis by angles (..., n), in place."""
    first, second = (axis + 1) % 3, (axis + 2) % 3
    cos, sin = cosine(angle_rad), sine(angle_rad)
    turned = cos * points[:, first] - sin * points[:, second]
    points[:, second] = sin * points[:, first] + cos * points[:, second]
    points[:, first] = turned


AgeClass = Literal["child", "adult", "senior"]
Body = Literal["adult", "child"]

ADULT_M = 1.75
"""Stature of the reference adult of speeds and times."""
CHILD_M = (0.9, 1.6)
"""Range of statures of the child's figure. At the upper limit, it has an adult's proportions."""
_SMALLEST = {"leg": 0.885, "head": 1.38}
"""Relative lengths of legs and head of a child of 0.9 m over those of an adult (sitting height
0.575 H instead of 0.52 H, head height H/5 instead of H/7.5; assumed)."""
Load = Literal["free", "pockets", "bag", "phone", "pushing"]
Complaint = Literal["none", "weak", "joint", "neurological"]
_NO_PARAMETERS = ("sex", "age_class", "complaint", "age_years")


@dataclass(frozen=True)
class Person:
    """Person sampled by :func:`sample_person`. The speed is the preferred walking speed."""

    sex: str
    age_class: AgeClass
    complaint: Complaint
    left_hand: Hands
    right_hand: Hands
    age_years: float
    height_m: float
    mass_kg: float
    speed_mps: float
    walk_ratio: float
    trunk_ripple: float
    trunk_asymmetry: float
    swing_peak: float
    arm_swing: float
    arm_asymmetry: float
    lean_deg: float
    step_time_sd: float
    step_length_sd: float
    pace_sd: float
    time_asymmetry: float
    length_asymmetry: float

    def parameters(self, **changes: Any) -> dict[str, Any]:
        """Return the person's parameters of ``human_gait``, with some replaced."""
        own = {key: value for key, value in asdict(self).items() if key not in _NO_PARAMETERS}
        return {**own, "body": self.body, **changes}

    @property
    def body(self) -> Body:
        """Proportions of the figure: a child's within the child's statures."""
        return "child" if self.age_class == "child" and self.height_m <= CHILD_M[1] else "adult"


def find_segment_lengths(body: Body, height_m: float) -> dict[str, float]:
    """Return segment lengths as fractions of the stature; those of a child change with it."""
    if body == "adult":
        return dict(LENGTHS)
    young = (CHILD_M[1] - height_m) / (CHILD_M[1] - CHILD_M[0])
    leg, head = (1 + young * (_SMALLEST[part] - 1) for part in ("leg", "head"))
    factors = {"head": head, "thigh": leg, "shank": leg, "foot": leg}
    child = LENGTHS | {part: LENGTHS[part] * factor for part, factor in factors.items()}
    spine = ("head", "torso", "thigh", "shank")
    torso = sum(LENGTHS[part] for part in spine) - sum(child[part] for part in spine if part != "torso")
    return child | {"torso": torso}


def sample_person(
    rng: RandomSource, *, age_class: AgeClass = "adult", complaint: Complaint = "none", load: Load = "free"
) -> Person:
    """Sample a person from population statistics.

    Stature, mass and speed: adults (20 to 65 years) and seniors (65 to 85) after Bohannon (1997) and
    Bohannon and Andrews (2011), children (3 to 12) by Weech's rules with an adult's Froude number.
    Gait and steps: measured on recorded walkers, within 3 deviations. ``people.toml`` has the laws.

    Parameters
    ----------
    rng : Streams or numpy.random.Generator
        Source of random numbers; always eighteen draws. The same streams result in the same person.
    age_class : str
        ``"child"``, ``"adult"`` or ``"senior"``.
    complaint : str
        ``"none"``, ``"weak"`` (muscles: short, fast steps), ``"joint"`` (a limp: one step lasts
        longer) or ``"neurological"`` (irregular steps). Complaints reduce the speed.
    load : str
        State of the hands: ``"free"``, ``"pockets"`` or ``"pushing"`` (a pram) for both hands,
        ``"bag"`` or ``"phone"`` for one at random. Who pushes leans forward by 5 degrees more.

    Raises
    ------
    ConfigError
        If ``age_class``, ``complaint`` or ``load`` is not one of these.

    Examples
    --------
    >>> import doppelgait as dg
    >>> person = dg.motion.sample_person(dg.rng(1))
    >>> round(person.height_m, 2)
    1.63
    """
    check_choice(age_class, get_args(AgeClass), "age_class")
    check_choice(complaint, get_args(Complaint), "complaint")
    check_choice(load, get_args(Load), "load")
    chance = as_generator(rng, "plan")  # the model draws from the streams' "motion"
    male, old, hand = chance.random(3)
    size, weight, pace, ratio = np.clip(chance.standard_normal(4), -3.0, 3.0)
    sex = "male" if male < 0.5 else "female"
    if age_class == "child":  # Weech's rules; the spreads are assumed
        age_years = 3.0 + 9.0 * old
        height_m = max(CHILD_M[0], (0.77 + 0.06 * age_years) * (1 + 0.045 * size))
        mean_kg = 2 * age_years + 8 if age_years <= 6 else (7 * age_years - 5) / 2
        mass_kg, scale = mean_kg * math.exp(0.12 * weight), math.sqrt(height_m / ADULT_M)
    else:
        # the body mass index is lognormal about 24 kg/m^2 with 13 % (assumed)
        age_years = 20 + 45 * old if age_class == "adult" else 65 + 20 * old
        mean_m, sd_m = PEOPLE["stature_m"][sex]
        height_m = mean_m + sd_m * size
        mass_kg, scale = 24.0 * math.exp(0.13 * weight) * height_m**2, 1.0
    mean_mps, sd_mps = PEOPLE["speed_mps"].get(complaint) or PEOPLE["speed_mps"][age_class]
    speed_mps = scale * float(np.clip(mean_mps + sd_mps * pace, 0.4, 2.0))
    laws = {name: law | PEOPLE["laws"][complaint].get(name, {}) for name, law in PEOPLE["laws"]["none"].items()}
    values = evaluate_laws(laws, [ratio, *np.clip(chance.standard_normal(11), -3.0, 3.0)])
    values["lean_deg"] += 5.0 if load == "pushing" else 0.0
    one_handed = load in ("bag", "phone")
    left, right = (load if not one_handed or (hand < 0.5) == is_left else "free" for is_left in (True, False))
    body = age_years, height_m, mass_kg, speed_mps
    return Person(sex, age_class, complaint, left, right, *map(float, body), **values)


BODY_MASS_INDEX = 23.0
FOOT_TOUCHDOWN = {"left_foot": 0.5, "right_foot": 0.0}
"""Phases in cycles at which the feet land."""


def make_person_motions(
    position_m: FloatArray,
    timing: Timing,
    parameters: Sequence[Any],
    gaits: Sequence[str],
    touchdown: Mapping[str, float] = FOOT_TOUCHDOWN,
    report: Mapping[str, str] | None = None,
) -> list[Motion]:
    """Make the motions of modelled persons with symmetrical steps from (B, T, 17, 3)."""
    facts, reports, feet = [], [], touchdown.items()
    for config, gait in zip(parameters, gaits, strict=True):
        mass_kg = getattr(config, "mass_kg", None)
        reports.append({**(report or {}), **({} if mass_kg else {"mass_kg": "assumed: body mass index 23 kg/m^2"})})
        mass_kg = mass_kg or BODY_MASS_INDEX * config.height_m**2
        body = {"height_m": config.height_m, "mass_kg": mass_kg}
        facts.append({"species": "human", "gait": gait, "harmonic": 2, **body})
    landings = [
        {foot: at + np.arange(math.ceil(first - at - 1e-9), math.floor(last - at + 1e-9) + 1) for foot, at in feet}
        for first, last in timing.phase[:, [0, -1]].tolist()
    ]
    return make_gait_motions(position_m, timing, parameters, landings, BOULIC_PARTS, facts, reports)
