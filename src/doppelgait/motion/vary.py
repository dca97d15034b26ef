"""Variation of motions, with the same method for all bodies.

Bodies of a model resemble each other more than recorded bodies do. A motion is therefore separated into its path, the
ripple of its trunk and the swing of every point about the trunk. Each component is changed, and the components are
added again. A plan samples the changes from the same distributions for all classes, so that they do not predict the
class.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt
from pydantic import Field

from doppelgait.core.config import FrozenModel
from doppelgait.core.errors import MotionError
from doppelgait.core.labels import MOTION, SPACE, make_array
from doppelgait.motion.motion import Motion
from doppelgait.motion.retime import body_centre_m, resample
from doppelgait.motion.skeleton import BODY_CENTRE_PARTS

FloatArray = npt.NDArray[np.float64]

ARM_PARTS = ("_upper_arm", "_forearm", "_hand")
FORE_PARTS = ("_fore_upper", "_fore_lower", "_fore_paw")
TURN_MARGIN = 0.35
"""Maximum lead of a clock over an even one, in strides: the timing and three standard deviations of the noise."""

SLOWEST_STRIDE_S = 2.5


class Variation(FrozenModel):
    """Change of a body's motion from its model or recording.

    Parameters
    ----------
    limb_swing : float
        Factor of the swing of the legs about the trunk, including the forelegs of an animal; 1 leaves it unchanged.
    arm_swing : float
        Factor of the swing of a person's arms.
    trunk_ripple : float
        Factor of the deviations of the trunk from uniform motion.
    ripple_once_m : float
        Amplitude of a movement of the whole body at the stride frequency, in a random direction and phase.
    ripple_twice_m : float
        Amplitude of such a movement at twice the stride frequency.
    pitch_deg : float
        Amplitude of the pitch of trunk, head and arms about the body's centre, at twice the stride frequency.
    yaw_deg : float
        Amplitude of the yaw of trunk, head and arms about the body's centre, at the stride frequency.
    pace : float
        Factor of the stride frequency at equal speed. The swing of the legs becomes shorter by the same factor.
    swing_timing : float
        Share of a stride by which the swing of all limbs leads and lags in every stride, which changes the stance time.
    fore_timing : float
        Share of a stride by which the forelimbs (a person's arms) are delayed.
    phase_noise : float
        Standard deviation of the stride clock from stride to stride, in strides.
    """

    limb_swing: float = Field(default=1.0, ge=0.3, le=2.0)
    arm_swing: float = Field(default=1.0, ge=0.0, le=2.5)
    trunk_ripple: float = Field(default=1.0, ge=0.0, le=3.0)
    ripple_once_m: float = Field(default=0.0, ge=0.0, le=0.05)
    ripple_twice_m: float = Field(default=0.0, ge=0.0, le=0.05)
    pitch_deg: float = Field(default=0.0, ge=0.0, le=15.0)
    yaw_deg: float = Field(default=0.0, ge=0.0, le=15.0)
    pace: float = Field(default=1.0, ge=0.6, le=1.6)
    swing_timing: float = Field(default=0.0, ge=-0.12, le=0.12)
    fore_timing: float = Field(default=0.0, ge=-0.12, le=0.12)
    phase_noise: float = Field(default=0.0, ge=0.0, le=0.05)

    def needed_s(self, duration_s: float) -> float:
        """Return the duration of the motion that a varied one needs."""
        return duration_s * self.pace + 2.0 * TURN_MARGIN * SLOWEST_STRIDE_S


def vary(motion: Motion, variation: Variation, rng: np.random.Generator) -> Motion:
    """Vary a motion."""
    stride_hz = motion.facts.stride_frequency_hz
    if not stride_hz > 0:
        raise MotionError(f"{motion.label}: cannot be varied, since its stride frequency is unknown; omit target.vary")
    margin_s = TURN_MARGIN / stride_hz
    lasts_s = (motion.duration_s - 2.0 * margin_s) / variation.pace
    if lasts_s * motion.rate_hz < 4:
        raise MotionError(
            f"{motion.label}: {motion.duration_s:.2f} s are too short to be varied; the lead of the clocks needs "
            f"{2.0 * margin_s:.2f} s more than the scene"
        )
    times_s = np.arange(math.floor(lasts_s * motion.rate_hz + 1e-6) + 1) / motion.rate_hz
    new_hz = stride_hz * variation.pace
    turns = 2.0 * np.pi * rng.random(6)
    limb_s = _make_clock(times_s, new_hz, variation, turns[0], rng) / stride_hz + margin_s
    trunk_s = limb_s - variation.swing_timing * np.sin(2 * np.pi * new_hz * times_s + turns[0]) / stride_hz
    # the path: even motion from the first to the last position of the centre
    centre_m, old_s = body_centre_m(motion), motion.time_s - motion.time_s[0]
    slope = np.polynomial.polynomial.polyfit(old_s, centre_m, 1)

    def about_way(at_s: FloatArray) -> FloatArray:
        even_m: FloatArray = slope[0] + slope[1] * at_s[:, None]
        return np.asarray(resample(motion, at_s)[0] - even_m[:, None])

    parts = motion.parts
    fore = np.array([part.endswith(FORE_PARTS + ARM_PARTS) for part in parts])
    arms = np.array([part.endswith(ARM_PARTS) for part in parts])
    central = np.array([part in (*BODY_CENTRE_PARTS, "head", "neck", "tail") for part in parts])
    found = about_way(limb_s)
    found[:, fore] = about_way(limb_s + variation.fore_timing / stride_hz)[:, fore]
    still = about_way(trunk_s)
    found[:, central] = still[:, central]
    trunk = [n for n, part in enumerate(parts) if part in BODY_CENTRE_PARTS] or list(range(len(parts)))
    ripple_m = still[:, trunk].mean(axis=1)
    rest_m = found - ripple_m[:, None]
    place_m = rest_m.mean(axis=0)
    swing_m = rest_m - place_m
    factor = np.where(arms, variation.arm_swing, np.where(central, 1.0, variation.limb_swing))
    along = slope[1] / max(float(np.linalg.norm(slope[1])), 1e-9)
    legs = ~arms & ~central
    shorter = np.where(legs, 1.0 / variation.pace - 1.0, 0.0)
    swing_m += shorter[None, :, None] * (swing_m @ along)[..., None] * along
    body_m = place_m + factor[None, :, None] * swing_m
    upper = arms | central
    for degrees, times, turn, pivot in (
        (variation.pitch_deg, 2, turns[3], np.array([-along[1], along[0], 0.0])),
        (variation.yaw_deg, 1, turns[4], np.array([0.0, 0.0, 1.0])),
    ):
        angle_rad = math.radians(degrees) * np.sin(2.0 * np.pi * times * new_hz * times_s + turn)
        body_m[:, upper] = _rotate_points(body_m[:, upper], pivot, angle_rad[:, None, None])
    mean_m = ripple_m.mean(axis=0)
    ripple_m = mean_m + variation.trunk_ripple * (ripple_m - mean_m)
    for times, size_m, turn in ((1, variation.ripple_once_m, turns[1]), (2, variation.ripple_twice_m, turns[2])):
        way = rng.normal(size=3)
        wave = np.sin(2.0 * np.pi * times * new_hz * times_s + turn)
        ripple_m = ripple_m + size_m * wave[:, None] * way / np.linalg.norm(way)
    position_m = slope[0] + slope[1] * (times_s[:, None] + margin_s) + ripple_m
    coords = {"time": times_s, "marker": motion.markers, "space": list(SPACE), "part": ("marker", parts)}
    positions = make_array(MOTION, position_m[:, None] + body_m, coords, {"rate_hz": motion.rate_hz})
    footfalls = {
        foot: np.interp(np.asarray(falls), limb_s, times_s, left=np.nan, right=np.nan)
        for foot, falls in motion.facts.footfalls.items()
    }
    facts = motion.facts.with_frequencies(lambda hz: hz * variation.pace)
    kept = {foot: falls[np.isfinite(falls)].tolist() for foot, falls in footfalls.items()}
    return replace(motion, positions=positions, facts=replace(facts, footfalls=kept))


def _make_clock(
    times_s: FloatArray, stride_hz: float, variation: Variation, turn: float, rng: np.random.Generator
) -> FloatArray:
    """Return a clock of strides with timing and noise."""
    # the timing varies within a stride, the noise from stride to stride
    strides = stride_hz * times_s
    deviations = variation.phase_noise * np.clip(rng.normal(size=math.ceil(strides[-1]) + 2), -2.0, 2.0)
    noise = np.interp(strides, np.arange(deviations.size), deviations)
    return np.asarray(strides + variation.swing_timing * np.sin(2.0 * np.pi * strides + turn) + noise)


def _rotate_points(points_m: FloatArray, pivot: FloatArray, angle_rad: FloatArray) -> FloatArray:
    """Rotate points about an axis through the origin (Rodrigues)."""
    across = np.cross(np.broadcast_to(pivot, points_m.shape), points_m)
    along = (points_m @ pivot)[..., None] * pivot
    return np.asarray(points_m * np.cos(angle_rad) + across * np.sin(angle_rad) + along * (1.0 - np.cos(angle_rad)))
