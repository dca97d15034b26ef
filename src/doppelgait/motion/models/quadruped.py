"""Dog, cat, horse or cow from footfalls.

Paws do not slide, the trunk heaves, and the limbs have joints. A gait is data, and size and speed determine stride
length and timing by dynamic similarity (:mod:`doppelgait.motion.models.quadruped_gaits`). The limbs follow from trunk
and paws (:mod:`doppelgait.motion.models.quadruped_limbs`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from pydantic import Field, model_validator

from doppelgait.core.config import FrozenModel
from doppelgait.core.errors import ConfigError
from doppelgait.core.plugins import plugin
from doppelgait.core.units import FloatArray, sine
from doppelgait.motion.models.quadruped_gaits import (
    BUILDS,
    GAITS,
    BuildName,
    Gait,
    GaitChoice,
    GaitName,
    duty_factor,
    fit_gait_to_build,
    froude_number,
    froude_speed_mps,
    hip_height_m,
    mass_kg,
    pick_gait,
    stride_length_m,
)
from doppelgait.motion.models.quadruped_limbs import (
    FootfallCourse,
    compute_all_points,
    make_regular_course,
)
from doppelgait.motion.models.registry import model_function
from doppelgait.motion.models.strides import (
    Columns,
    Landings,
    Rngs,
    fit_cubic_spline,
    make_column,
    make_gait_motions,
    sample_autoregressive,
    scale_points,
    sum_steps,
    time_even_strides,
)
from doppelgait.motion.motion import Motion
from doppelgait.motion.skeleton import SIDES, list_points

# a joint belongs to the bone that ends there. The shoulder is the lower end of the scapula; the hip is on the trunk.
_SIDED = (
    "*_shoulder:*_fore_upper *_elbow:*_fore_upper *_carpus:*_fore_lower *_fore_paw:*_fore_paw *_hip:trunk "
    "*_knee:*_hind_upper *_hock:*_hind_lower *_hind_paw:*_hind_paw"
)
PART_OF_POINT = list_points(
    "nose:head head:head neck:neck neck_base:neck withers:trunk chest:trunk back:trunk belly:trunk rump:trunk "
    f"tail_base:trunk tail_middle:tail tail_tip:tail {' '.join(_SIDED.replace('*', side) for side in SIDES)}"
)
"""Points of the dog in order, and the body part of each."""
POINTS = tuple(PART_OF_POINT)


class QuadrupedConfig(FrozenModel):
    """Four-legged animal of :func:`quadruped_gait`, in one straight gait.

    gait: ``"walk"`` (lateral sequence, Froude number 0.05 to 0.5), ``"pace"`` (0.1 to 1),
        ``"trot"`` (0.3 to 2.5), ``"canter"`` (1 to 5), ``"gallop"`` (rotary, 1.2 to 10),
        ``"transverse_gallop"`` (1.2 to 10), ``"bound"`` (1 to 6), or ``"auto"``: walk up to a
        Froude number of 0.5, trot up to 2.5, then gallop.
    speed_mps: Mean forward speed V. Set either this or ``froude``.
    froude: Froude number that determines the speed. Without either key, it is the gait's usual one
        (trot 1, gallop 4).
    build: Proportions, mass and usual size, a key of
        :data:`doppelgait.motion.models.quadruped_gaits.BUILDS`: ``"standard"``, breeds of dog,
        ``"cat"``, ``"horse"``, ``"cow"``.
    withers_m: Height of the withers when standing: 0.15 to 0.9, for a horse 0.7 to 1.8, for a cow
        0.8 to 1.8. The default is that of the build (standard 0.5).
    start_phase: Phase at the start in strides, 0 (left hind foot lands) to below 1.
    stride_variation: Standard deviation of the stride time relative to its mean; 0.03 to 0.05 is
        usual.
    step_length_sd: Standard deviation of the length of half a stride over its mean.
    footfall_sd: Standard deviation of the landing time of a foot, in strides.
    asymmetry: Delay of the landing of both right feet in strides. The frequencies in the facts
        remain those of the gait (f_mu by E-07), although half strides then differ.
    length_asymmetry: (first - second) / mean of the half strides, starting at the landing of the
        left hind foot.
    trunk_ripple: Fore-aft motion of the trunk and swing of the neck within a stride, relative to
        the recorded ones.
    stride_ratio: Stride length relative to the gait's at this speed; two recorded dogs differ by 14
        %.
    hind_swing_peak: Maximum speed of a swinging hind paw relative to that of the recorded dog.
    fore_swing_peak: Maximum speed of a swinging fore paw relative to that of the recorded dog.
    neck_deg: Mean elevation of the neck, -40 to 80 degrees.
    tail_deg: Mean elevation of the tail, -80 to 80 degrees.
    tail_frequency_hz: Frequency of the sideways swing of the tail, 0 to 5 Hz. The motion repeats
        every stride only if this frequency is a multiple of the stride frequency.
    tail_sweep_deg: Maximum sideways angle of the tail to both sides, 0 to 60 degrees.
    rate_hz: Frames per second.
    """

    kind: Literal["quadruped"] = "quadruped"
    gait: GaitChoice = "trot"
    speed_mps: float | None = Field(None, gt=0)
    froude: float | None = Field(None, gt=0)
    build: BuildName = "standard"
    withers_m: float | None = Field(None, gt=0)
    start_phase: float = Field(0.0, ge=0, lt=1)
    stride_variation: float = Field(0.0, ge=0, le=0.1)
    step_length_sd: float = Field(0.0, ge=0, le=0.15)
    footfall_sd: float = Field(0.0, ge=0, le=0.04)
    asymmetry: float = Field(0.0, ge=-0.05, le=0.05)
    length_asymmetry: float = Field(0.0, ge=-0.4, le=0.4)
    trunk_ripple: float = Field(1.0, ge=0, le=2)
    stride_ratio: float = Field(1.0, ge=0.8, le=1.25)
    hind_swing_peak: float = Field(1.0, ge=0.8, le=1.2)
    fore_swing_peak: float = Field(1.0, ge=0.8, le=1.2)
    neck_deg: float = Field(42.0, ge=-40, le=80)
    tail_deg: float = Field(-35.0, ge=-80, le=80)
    tail_frequency_hz: float = Field(1.7, ge=0, le=5)
    tail_sweep_deg: float = Field(30.0, ge=0, le=60)
    rate_hz: float = Field(250.0, ge=50, le=10_000)

    @model_validator(mode="after")
    def _check_speed(self) -> QuadrupedConfig:
        if self.speed_mps is not None and self.froude is not None:
            raise ValueError("give speed_mps or froude, not both")
        if self.gait == "auto" and self.speed_mps is None and self.froude is None:
            raise ValueError("gait: 'auto' depends on the speed: give speed_mps or froude, or name the gait")
        lowest, highest = BUILDS[self.build].withers_range_m
        if not lowest <= self.actual_withers_m <= highest:
            raise ValueError(
                f"withers_m: {self.actual_withers_m:g} is not allowed: {lowest:g} to {highest:g} m "
                f"for a {BUILDS[self.build].species}"
            )
        low, high, _ = GAITS[self.actual_gait].froude
        slowest, fastest = (froude_speed_mps(fr, self.hip_m) for fr in (low, high))
        if not slowest * (1 - 1e-9) <= self.actual_speed_mps <= fastest * (1 + 1e-9):
            if self.froude is not None:
                hint = "" if self.gait == "auto" else '; set gait = "auto" to derive the gait from froude'
                raise ValueError(
                    f"froude: {self.froude:.4g} is not allowed: the Froude number of a {self.actual_gait} is "
                    f"{low:g} to {high:g}{hint}"
                )
            raise ValueError(
                f"speed_mps: {self.actual_speed_mps:.4g} is not allowed: a {BUILDS[self.build].species} with "
                f"withers_m = {self.actual_withers_m:g} moves at {slowest:.3g} to {fastest:.3g} m/s in a "
                f"{self.actual_gait} (Froude number {low:g} to {high:g})"
            )
        return self

    @property
    def actual_withers_m(self) -> float:
        """Withers height, by default that of the build."""
        return BUILDS[self.build].withers_m if self.withers_m is None else self.withers_m

    @property
    def hip_m(self) -> float:
        """Hip height."""
        return hip_height_m(BUILDS[self.build], self.actual_withers_m)

    @property
    def actual_gait(self) -> GaitName:
        """The gait; ``"auto"`` is resolved by speed."""
        if self.gait != "auto":
            return self.gait
        return pick_gait(froude_number(self.actual_speed_mps, self.hip_m))

    @property
    def actual_speed_mps(self) -> float:
        """The speed, or that of the Froude number; by default the gait's usual one."""
        if self.speed_mps is not None:
            return self.speed_mps
        froude = GAITS[self.actual_gait].froude[2] if self.froude is None else self.froude
        return froude_speed_mps(froude, self.hip_m)


def _is_varied(config: QuadrupedConfig) -> bool:
    return any((config.step_length_sd, config.footfall_sd, config.length_asymmetry))


@model_function(QuadrupedConfig)
@plugin("motion_model", parameters=QuadrupedConfig, alike=_is_varied)
def quadruped_gait(parameters: Sequence[QuadrupedConfig], durations_s: Sequence[float], rngs: Rngs) -> list[Motion]:
    """Generate a four-legged animal in one straight gait.

    Stride length L = c h Fr^p with Fr = V^2/(g h) and a dog's h = 0.8 withers heights (p = 0.3, Alexander and Jayes
    1983; in walk and pace 0.23; c between those of two measured dogs, assumed for all); stride frequency f = V/L. A paw
    is at rest on the ground for the share 1 - t_swing f of the stride plus an offset of the gait, with
    t_swing = 0.35 s (h/0.46 m)^0.5. Trunk, neck, tail, swinging paws and the segments of the limbs follow the mean
    curves of one recorded dog (:mod:`doppelgait.motion.models.curves`).

    The animal moves along +x from about x = 0, with its paws on z = 0 in stance. The points are those of
    :data:`POINTS`.

    >>> import doppelgait as dg
    >>> motion = dg.motion.quadruped_gait(duration_s=2.0)
    >>> motion.facts.species, motion.facts.gait, round(motion.facts.stride_frequency_hz, 2)
    ('dog', 'trot', 1.9)
    """
    columns, builds = Columns(parameters), [BUILDS[config.build] for config in parameters]
    gaits, hip_m = [_make_gait(config) for config in parameters], columns.hip_m
    paces = [*zip(gaits, columns.actual_speed_mps[:, 0].tolist(), hip_m[:, 0].tolist(), strict=True)]
    stride_m = columns.stride_ratio * make_column([stride_length_m(*pace) for pace in paces])
    timing = time_even_strides(durations_s, columns, stride_m / columns.actual_speed_mps, rngs)
    phase, gait = timing.phase, Columns(gaits)
    course = make_regular_course(phase, gait, stride_m / hip_m)
    if _is_varied(parameters[0]):
        course = _vary_course(course, columns, phase, gait, rngs)
    wag_rad = np.radians(columns.tail_sweep_deg) * sine(2 * np.pi * columns.tail_frequency_hz * timing.times_s)
    rates_hz = (columns.actual_speed_mps / stride_m)[:, 0].tolist()
    duty = {
        end: make_column(
            [duty_factor(getattr(own, end), hz, m) for (own, _, m), hz in zip(paces, rates_hz, strict=True)]
        )
        for end in ("hind", "fore")
    }
    points = compute_all_points(phase, gait, Columns(builds), course, duty, columns, wag_rad)
    position_m = scale_points([points[name] for name in POINTS], hip_m)
    position_m[..., 0] -= (hip_m * course.distance(phase[:, :1]))[..., None]
    landings: list[Landings] = []
    facts: list[dict[str, Any]] = []
    reports = []
    for row, (config, build, (first, last)) in enumerate(zip(parameters, builds, phase[:, [0, -1]], strict=True)):
        own = {foot: course.landings[foot][row, : course.sizes[row]] for foot in gaits[row].touchdown}
        landings.append({foot: at[(at >= first - 1e-9) & (at <= last + 1e-9)] for foot, at in own.items()})
        withers_m = config.actual_withers_m
        body = {"species": build.species, "height_m": withers_m, "mass_kg": mass_kg(build, withers_m)}
        facts.append({"gait": config.actual_gait, "harmonic": gaits[row].harmonic, **body})
        mass = f"assumed: {build.mass_kg:.3g} kg at withers_m = {build.withers_m:g}, with the cube of the height"
        reports.append({"mass_kg": mass, "proportions": build.source})
    return make_gait_motions(position_m, timing, parameters, landings, PART_OF_POINT, facts, reports)


def _make_gait(config: QuadrupedConfig) -> Gait:
    gait = fit_gait_to_build(config.actual_gait, BUILDS[config.build], config.asymmetry)
    hind = replace(gait.hind, swing_peak=config.hind_swing_peak)
    fore = replace(gait.fore, swing_peak=config.fore_swing_peak)
    return replace(gait, hind=hind, fore=fore, ripple=config.trunk_ripple)


def _vary_course(
    regular: FootfallCourse, columns: Columns, phase: FloatArray, gait: Columns, rngs: Rngs
) -> FootfallCourse:
    """Return courses with varying positions and times of the footfalls."""
    # half strides and landings vary as first-order autoregressive sequences
    first = np.floor(2 * phase[:, :1]) - 8
    sizes = (np.ceil(2 * phase[:, -1:]) + 8 - first)[:, 0].astype(int)
    halves = first + np.arange(sizes.max())
    longer, landings = np.zeros(halves.shape), {foot: phases.copy() for foot, phases in regular.landings.items()}
    spreads = np.concatenate([columns.step_length_sd, columns.footfall_sd], axis=1).tolist()
    for row, ((length_sd, landing_sd), rng) in enumerate(zip(spreads, rngs, strict=True)):
        if rng is None:
            if length_sd > 0 or landing_sd > 0:
                raise ConfigError(
                    f"step_length_sd = {length_sd:g}, footfall_sd = {landing_sd:g} need a random generator "
                    "(rng=dg.rng(seed)), or set both 0"
                )
            continue
        if length_sd > 0:
            longer[row, : sizes[row]] = sample_autoregressive(int(sizes[row]), rng)
        for foot in gait.touchdown[row] if landing_sd > 0 else ():
            size = int(regular.sizes[row])
            landings[foot][row, :size] += landing_sd * sample_autoregressive(size, rng)
    lengths = regular.stride / 2 * (1 + columns.length_asymmetry * np.where(halves % 2, -0.5, 0.5))
    lengths += regular.stride / 2 * columns.step_length_sd * longer
    way = fit_cubic_spline((first + np.arange(sizes.max() + 1)) / 2, sum_steps(lengths), sizes + 1)
    return replace(regular, landings=landings, advance=way)
