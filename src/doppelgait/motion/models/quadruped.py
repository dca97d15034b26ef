"""A trotting or galloping dog from footfalls: paws that stay where they land, a heaving trunk, jointed limbs.

A gait is data (:mod:`doppelgait.motion.models.quadruped_gaits`); size and speed set stride length and timing by
dynamic similarity; the limbs follow from trunk and paws (:mod:`doppelgait.motion.models.quadruped_limbs`).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import xarray as xr
from pydantic import Field, model_validator

from doppelgait.core.config import FrozenModel, validate
from doppelgait.motion.models.quadruped_gaits import (
    GAITS,
    GaitName,
    duty_factor,
    froude_speed_mps,
    hip_height_m,
    mass_from_withers_kg,
    stride_length_m,
)
from doppelgait.motion.models.quadruped_limbs import all_points, crouch
from doppelgait.motion.models.registry import MOTION_MODELS, MotionModel
from doppelgait.motion.models.strides import (
    footfall_times_s,
    mean_stride_frequency_hz,
    phase_at,
    sample_times_s,
    stride_clock,
)
from doppelgait.motion.schema import make_motion

FloatArray = npt.NDArray[np.float64]

# A joint belongs to the bone that ends there; the shoulder is the lower end of the scapula, the hip part of the trunk.
PART_OF_POINT = {
    "nose": "head", "head": "head", "neck": "neck", "neck_base": "neck",
    "withers": "trunk", "chest": "trunk", "back": "trunk", "belly": "trunk", "rump": "trunk", "tail_base": "trunk",
    "tail_middle": "tail", "tail_tip": "tail",
} | {
    f"{side}_{joint}": "trunk" if part == "trunk" else f"{side}_{part}"
    for side in ("left", "right")
    for joint, part in (
        ("shoulder", "fore_upper"), ("elbow", "fore_upper"), ("carpus", "fore_lower"), ("fore_paw", "fore_paw"),
        ("hip", "trunk"), ("knee", "hind_upper"), ("hock", "hind_lower"), ("hind_paw", "hind_paw"),
    )
}  # fmt: skip
"""Points of the dog in their order, and the part that each belongs to."""
POINTS = tuple(PART_OF_POINT)


class QuadrupedConfig(FrozenModel):
    """Parameters of :func:`quadruped_gait`."""

    gait: GaitName = "trot"
    speed_mps: float | None = Field(None, gt=0)
    froude: float | None = Field(None, gt=0)
    withers_m: float = Field(0.5, ge=0.2, le=0.9)
    start_phase: float = Field(0.0, ge=0, lt=1)
    stride_variation: float = Field(0.0, ge=0, le=0.1)
    tail_frequency_hz: float = Field(1.7, ge=0, le=5)
    tail_sweep_deg: float = Field(30.0, ge=0, le=60)
    rate_hz: float = Field(250.0, ge=50, le=10_000)

    @model_validator(mode="after")
    def _speed_fits_gait_and_size(self) -> QuadrupedConfig:
        if self.speed_mps is not None and self.froude is not None:
            raise ValueError("give speed_mps or froude, not both")
        low, high, _ = GAITS[self.gait].froude
        slowest, fastest = (froude_speed_mps(fr, self.withers_m) for fr in (low, high))
        if not slowest * (1 - 1e-9) <= self.actual_speed_mps <= fastest * (1 + 1e-9):
            raise ValueError(
                f"speed_mps: {self.actual_speed_mps:.4g} is not allowed: a dog with withers_m = {self.withers_m:g} "
                f"goes at {slowest:.3g} to {fastest:.3g} m/s in a {self.gait} (Froude number {low:g} to {high:g})"
            )
        return self

    @property
    def actual_speed_mps(self) -> float:
        """The speed, or that of the Froude number, which is the gait's usual one where neither is given."""
        if self.speed_mps is not None:
            return self.speed_mps
        usual = GAITS[self.gait].froude[2]
        return froude_speed_mps(usual if self.froude is None else self.froude, self.withers_m)


def quadruped_gait(
    *,
    gait: GaitName = "trot",
    speed_mps: float | None = None,
    froude: float | None = None,
    withers_m: float = 0.5,
    duration_s: float = 5.0,
    start_phase: float = 0.0,
    stride_variation: float = 0.0,
    tail_frequency_hz: float = 1.7,
    tail_sweep_deg: float = 30.0,
    rate_hz: float = 250.0,
    rng: np.random.Generator | None = None,
) -> xr.DataArray:
    """Trotting or galloping dog.

    Stride length L = c h Fr^0.3 with Fr = V^2/(g h) and hip height h = 0.8 withers heights (Alexander and Jayes 1983;
    c from one measured dog, assumed for all); stride frequency f = V/L.

    Parameters
    ----------
    gait : str
        ``"trot"`` (Fr 0.3 to 2.5) or ``"gallop"`` (rotary, Fr 1.2 to 10).
    speed_mps : float, optional
        Mean forward speed V ...
    froude : float, optional
        ... or the Froude number that it follows from; without either Fr = 1 in trot and 4 in gallop.
    withers_m : float
        Height of the withers when standing, 0.2 to 0.9.
    duration_s : float
        Time to cover; the last frame is at or just after it.
    start_phase : float
        Strides, 0 (left hind foot lands) to below 1.
    stride_variation : float
        Standard deviation of the stride time relative to its mean, 0 to 0.1; 0.03 to 0.05 is usual. The length of a
        stride stays, so that the speed varies with it.
    tail_frequency_hz, tail_sweep_deg : float
        The tail swings sideways to this angle either way at its own frequency, 0 to 5 Hz and 0 to 60 degrees: the
        motion as a whole is periodic only where that fits the stride.
    rate_hz : float
        Frames per second, 50 to 10000.
    rng : numpy.random.Generator, optional
        Needed when ``stride_variation`` is above 0.

    Returns
    -------
    xarray.DataArray
        Motion (time, marker, space) of :data:`POINTS`: travels along +x from about x = 0, paws on z = 0 in stance.

    Raises
    ------
    ConfigError
        If a parameter is outside its range.
    """
    values = {
        "gait": gait, "speed_mps": speed_mps, "froude": froude, "withers_m": withers_m, "start_phase": start_phase,
        "stride_variation": stride_variation, "tail_frequency_hz": tail_frequency_hz,
        "tail_sweep_deg": tail_sweep_deg, "rate_hz": rate_hz,
    }  # fmt: skip
    return _generate(validate(QuadrupedConfig, values, where="quadruped_gait"), duration_s, rng)


def _generate(config: QuadrupedConfig, duration_s: float, rng: np.random.Generator | None) -> xr.DataArray:
    gait, speed_mps, hip_m = GAITS[config.gait], config.actual_speed_mps, hip_height_m(config.withers_m)
    stride_m = stride_length_m(gait, speed_mps, config.withers_m)
    duty = {end: duty_factor(getattr(gait, end), speed_mps / stride_m, hip_m) for end in ("hind", "fore")}
    times_s = sample_times_s(duration_s, config.rate_hz)
    clock = stride_clock(
        times_s[-1],
        period_s=stride_m / speed_mps,
        start_phase=config.start_phase,
        variation=config.stride_variation,
        rng=rng,
    )
    phase = phase_at(clock, times_s)
    wag_rad = np.radians(config.tail_sweep_deg) * np.sin(2 * np.pi * config.tail_frequency_hz * times_s)
    stride = stride_m / hip_m
    points = all_points(phase, gait, stride=stride, duty=duty, lowered=crouch(gait, stride, duty), wag_rad=wag_rad)
    position_m = hip_m * np.stack([points[name] for name in POINTS], axis=1)
    position_m[:, :, 0] -= stride_m * phase[0]
    facts = _facts(config, mean_stride_frequency_hz(times_s, phase))
    facts["footfalls"] = footfall_times_s(clock, gait.touchdown, times_s[-1])
    parts = list(PART_OF_POINT.values())
    return make_motion(position_m, rate_hz=config.rate_hz, markers=POINTS, parts=parts, facts=facts)


def _facts(config: QuadrupedConfig, stride_frequency_hz: float) -> dict[str, object]:
    gait = GAITS[config.gait]
    step = {"step_frequency_hz": 2 * stride_frequency_hz} if gait.harmonic == 2 else {}
    return {
        "source": "quadruped", "kind": "quadruped", "species": "dog", "gait": config.gait,
        "height_m": config.withers_m,
        "mass_kg": mass_from_withers_kg(config.withers_m),
        "stride_frequency_hz": stride_frequency_hz,
        "gait_frequency_hz": gait.fundamental * stride_frequency_hz,
        "report": {
            "mass_kg": "assumed: withers height = 0.175 m (mass / kg)^(1/3)",
            "proportions": "assumed: those of one measured dog and of breed standards",
        },
    } | step  # fmt: skip


MOTION_MODELS.add("quadruped", MotionModel(QuadrupedConfig, _generate))
