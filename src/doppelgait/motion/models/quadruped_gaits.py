"""Gaits, builds and sampled dogs of the quadruped model.

Lengths are in units of the hip height h, a share of the withers height. Values of walk, pace, trot
and gallop are between those of two dogs in motion capture, a medium-sized one and a Labrador, if
both have the gait. The other gaits are assumed from the literature, with the limbs of the gallop.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from statistics import NormalDist
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import TypeAdapter

from doppelgait.core.config import check_choice, check_type, read_toml
from doppelgait.core.errors import ConfigError
from doppelgait.core.rng import RandomSource, as_generator
from doppelgait.motion.models.curves import RecordedGait
from doppelgait.motion.models.strides import Values, evaluate_laws
from doppelgait.motion.motion import GRAVITY_MPS2

GaitName = Literal["walk", "pace", "trot", "canter", "gallop", "transverse_gallop", "bound"]
GaitChoice = Literal["auto", GaitName]


@dataclass(frozen=True)
class Girdle:
    """Motion of the hind or fore limbs in a gait."""

    duty_offset: float
    clearance: float
    clearance_at: float
    reach: float
    swing_peak: float = 1.0
    swing: float = 1.0


@dataclass(frozen=True)
class Gait:
    """Gait of a quadruped (E-07)."""

    touchdown: dict[str, float]
    froude: tuple[float, float, float]
    stride_factor: float
    harmonic: int
    curves: RecordedGait
    hind: Girdle
    fore: Girdle
    ripple: float = 1.0
    stride_power: float = 0.3


TABLES = read_toml(Path(__file__).with_name("quadruped_gaits.toml"))[0]

GAITS = TypeAdapter(dict[str, Gait]).validate_python(TABLES["gaits"])
"""All gaits by name. A new one needs a table of ``quadruped_gaits.toml`` and a :data:`GaitName`."""

GAITS_BY_SPEED: tuple[GaitName, ...] = ("walk", "trot", "gallop")
"""Gaits of a dog in order of speed. Each is used up to the end of its range of Froude numbers."""


def pick_gait(froude: float) -> GaitName:
    """Return a dog's gait at a Froude number: the first whose range includes it."""
    fits = (name for name in GAITS_BY_SPEED if froude <= GAITS[name].froude[1] * (1 + 1e-9))
    return next(fits, GAITS_BY_SPEED[-1])


SWING_TIME_S, SWING_HEIGHT_M = 0.35, 0.46
"""Duration of a swing in all gaits, and the hip height at which it was measured."""
DUTY_LIMITS = (0.15, 0.75)


@dataclass(frozen=True)
class Build:
    """Size and proportions of an animal, relative to the standard dog of the same hip height."""

    withers_m: float
    mass_kg: float
    withers_range_m: Sequence[float] = (0.15, 0.9)
    species: str = "dog"
    hip: float = 0.8
    trunk: float = 1.0
    limbs: float = 1.0
    head: float = 1.0
    tail: float = 1.0
    stride: dict[str, float] = field(default_factory=dict)
    ripple: float = 1.0
    walk_lag: float = 0.17
    source: str = "assumed: height and mass in the middle of the breed standard, standard proportions"


BUILDS: dict[str, Build] = {name: Build(**table) for name, table in TABLES["builds"].items()}
"""All builds by name. A new one needs a table of ``quadruped_gaits.toml``."""

if TYPE_CHECKING:
    BuildName = str
else:
    BuildName = Literal[*BUILDS]


def hip_height_m(build: Build, withers_m: float) -> float:
    """Return the standing height h of the hip joint."""
    return build.hip * withers_m


def froude_speed_mps(froude: float, hip_m: float) -> float:
    """Return the speed of Froude number Fr = V^2/(g h)."""
    return math.sqrt(froude * GRAVITY_MPS2 * hip_m)


def froude_number(speed_mps: float, hip_m: float) -> float:
    """Return the Froude number Fr = V^2/(g h)."""
    return speed_mps**2 / (GRAVITY_MPS2 * hip_m)


def stride_length_m(gait: Gait, speed_mps: float, hip_m: float) -> float:
    """Return the stride length L = c h Fr^p (Alexander and Jayes 1983)."""
    return gait.stride_factor * hip_m * math.pow(froude_number(speed_mps, hip_m), gait.stride_power)


def duty_factor(girdle: Any, stride_frequency_hz: Values, hip_m: Values) -> Any:
    """Return a paw's duty factor, 1 - t_swing f plus the girdle's offset, within limits."""
    swing_s = girdle.swing * SWING_TIME_S * np.sqrt(hip_m / SWING_HEIGHT_M)
    return np.clip(1 - swing_s * stride_frequency_hz + girdle.duty_offset, *DUTY_LIMITS)


def fit_gait_to_build(
    name: str, build: Build, asymmetry: float = 0.0, ripple: float = 1.0, hind_peak: float = 1.0, fore_peak: float = 1.0
) -> Gait:
    """Return a gait adapted to a build. Its right feet are ``asymmetry`` strides late."""
    gait = GAITS[name]
    touchdown = dict(gait.touchdown)
    if name == "walk":
        touchdown |= {f"{side}_fore": touchdown[f"{side}_hind"] + build.walk_lag for side in ("left", "right")}
    touchdown |= {foot: phase + asymmetry for foot, phase in touchdown.items() if foot.startswith("right")}
    # the duty factor is a dog's at the same Froude number: who has shorter strides has shorter swings
    ratio = build.stride.get(name, 1.0)
    hind = replace(gait.hind, swing=ratio, swing_peak=hind_peak)
    fore = replace(gait.fore, swing=ratio, swing_peak=fore_peak)
    gait = replace(gait, stride_factor=gait.stride_factor * ratio, ripple=build.ripple * ripple)
    return replace(gait, touchdown=touchdown, hind=hind, fore=fore)


DOG_BUILDS: tuple[BuildName, ...] = tuple(name for name, build in BUILDS.items() if build.species == "dog")
GAIT_SHARES: dict[GaitName, float] = {"walk": 0.35, "pace": 0.1, "trot": 0.35, "canter": 0.1, "gallop": 0.1}
"""Probability of the gaits of a sampled dog (assumed)."""


@dataclass(frozen=True)
class Dog:
    """Dog sampled by :func:`sample_dog`, with gait and speed."""

    build: BuildName
    gait: GaitName
    withers_m: float
    froude: float
    stride_ratio: float
    trunk_ripple: float
    hind_swing_peak: float
    fore_swing_peak: float
    neck_deg: float
    tail_deg: float
    tail_frequency_hz: float
    tail_sweep_deg: float
    stride_variation: float
    pace_sd: float
    step_length_sd: float
    footfall_sd: float
    asymmetry: float
    length_asymmetry: float

    def parameters(self, **changes: Any) -> dict[str, Any]:
        """Return the dog's parameters of ``quadruped_gait``, with some replaced."""
        own = asdict(self)
        if "speed_mps" in changes:  # it replaces the Froude number
            del own["froude"]
        return {**own, **changes}


def sample_dog(rng: RandomSource, *, gait: GaitName | None = None, froude: float | None = None) -> Dog:
    """Sample a dog: breed, size, gait, speed and habits.

    Gaits have the shares :data:`GAIT_SHARES`, among those that exist at the Froude number, which is
    log-uniform about the gait's usual one (assumed). ``quadruped_gaits.toml`` has the other laws.

    Parameters
    ----------
    rng : Streams or numpy.random.Generator
        Source of random numbers; always eighteen draws. The same streams result in the same dog.
    gait : str, optional
        Fixed gait; sampled by default.
    froude : float, optional
        Fixed Froude number in the range of the gait (0.025 to 10 without one); sampled by default.

    Raises
    ------
    ConfigError
        If there is no such gait or the Froude number is outside its range.

    Examples
    --------
    >>> import numpy as np
    >>> from doppelgait.motion import sample_dog
    >>> dog = sample_dog(np.random.default_rng(3), gait="trot")
    >>> dog.gait, round(dog.withers_m, 2)  # height of the withers
    ('trot', 0.47)
    """
    gaits = _list_possible_gaits(gait, froude)
    chance = as_generator(rng, "plan")  # the model draws from the streams' "motion"
    breed, way, effort, wag, sweep, time, length, landing = chance.random(8)
    size, *others = chance.standard_normal(10)
    ripple, hind, fore, neck, tail, late, long, far, pace = np.clip(others, -2.5, 2.5)
    build = DOG_BUILDS[int(breed * len(DOG_BUILDS))]
    if gait is None:
        shares = np.array([GAIT_SHARES[name] for name in gaits])
        limits = np.cumsum(shares / shares.sum())
        gait = gaits[int(np.searchsorted(limits[:-1], way, side="right"))]
    slowest, fastest, usual = GAITS[gait].froude
    low, high = math.sqrt(slowest * usual), math.sqrt(usual * fastest)
    froude = low * (high / low) ** effort if froude is None else froude
    uneven = 1 / math.sqrt(max(froude, 0.1))
    # the heights are truncated at the breed's limits by rank, so that they do not accumulate there
    body, normal = BUILDS[build], NormalDist()
    spread_m = 0.08 * body.withers_m
    least, most = (
        normal.cdf(min(max((limit_m - body.withers_m) / spread_m, -2.5), 2.5)) for limit_m in body.withers_range_m
    )
    own = {
        "withers_m": body.withers_m + spread_m * normal.inv_cdf(least + normal.cdf(size) * (most - least)),
        "froude": froude,
        "step_length_sd": min((0.02 + 0.02 * length) * uneven, 0.15),
        "length_asymmetry": max(min(0.04 * uneven * long, 0.4), -0.4),
    }
    deviates = far, ripple, hind, fore, neck, tail, late, wag, sweep, time, landing, pace
    values = {name: float(value) for name, value in own.items()} | evaluate_laws(TABLES["laws"], deviates)
    return Dog(build, gait, **values)


def _list_possible_gaits(gait: GaitName | None, froude: float | None) -> list[GaitName]:
    """Return the gaits that a dog may have. A Froude number without a gait is refused."""
    if gait is not None:
        check_choice(gait, GAITS, "gait")
    named: list[GaitName] = [*GAIT_SHARES] if gait is None else [gait]
    if froude is None:
        return named
    check_type(froude, (int, float, np.number), "froude", "give a number or leave it out")
    ranges = {name: GAITS[name].froude[:2] for name in named}
    found = [name for name, (low, high) in ranges.items() if low <= froude <= high]
    if not found:
        low, high = min(low for low, _ in ranges.values()), max(high for _, high in ranges.values())
        where = "" if gait is None else f" in a {gait}"
        raise ConfigError(
            f"froude: {froude!r} is not allowed; it must be a number from {low:g} to {high:g}{where}, or left out"
        )
    return found
