"""Mean curves of people and dogs over a cycle. Measured on recordings (``curves.toml``).

People: means of half of the recorded subjects (``studies/motion_curves.py`` tests them on the other
half). Each value is linear in the inverse of V / sqrt(g l) with the leg length l (if linear in the
speed, feet are a tenth too fast at 1 m/s), and constant outside the measured speeds. The foot lands
at phase 0. Dogs: means over the strides of one dog (``studies/dog_curves.py`` tests them on another).
Canter, transverse gallop and bound use the gallop's, shifted to the phases of their footfalls.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from doppelgait._core import native
from doppelgait.core.config import read_toml
from doppelgait.core.units import FloatArray
from doppelgait.motion.models.strides import Curve, Values, fit_cubic_hermite, make_column

ArmCurve = Literal["shoulder", "elbow", "thorax_torsion"]
ARM_CURVES: tuple[ArmCurve, ...] = get_args(ArmCurve)
PelvisCurve = Literal["pelvis_speed", "pelvis_height", "pelvic_list", "pelvic_torsion"]
PersonCurve = Literal["neck_speed", "ankle_speed", "ankle_height", "foot_pitch"] | PelvisCurve | ArmCurve
Segment = Literal["scapula", "manus", "metatarsus"]
RecordedGait = Literal["walk", "pace", "trot", "gallop"]


@cache
def load_tables() -> dict[str, Any]:
    """Return the measured samples of ``people`` and ``dogs`` by gait and curve."""
    return read_toml(Path(__file__).with_name("curves.toml"))[0]


@dataclass(frozen=True)
class CycleCurve:
    """Periodic curves of phase, as sums of harmonics. Shapes: coefficients (..., K)."""

    coefficients: npt.NDArray[np.complex128]

    def __call__(self, phase: FloatArray) -> FloatArray:
        """Values at phases (..., n), whose leading axes are broadcast to those of the curves."""
        count, n_terms = phase.shape[-1], self.coefficients.shape[-1]
        lead = np.broadcast_shapes(self.coefficients.shape[:-1], phase.shape[:-1])
        terms = np.broadcast_to(self.coefficients, (*lead, n_terms)).reshape(-1, n_terms)
        turns = np.broadcast_to(phase, (*lead[len(lead) - phase.ndim + 1 :], count)).reshape(-1, count)
        sums = np.empty((*lead, count))
        native.evaluate_harmonics(np.ascontiguousarray(terms, complex).view(float), turns, sums.reshape(-1, count))
        return sums


def join_curves(*curves: CycleCurve) -> CycleCurve:
    """Join curves of equal numbers of harmonics, to save time."""
    return CycleCurve(np.stack([curve.coefficients for curve in curves]))


MEASURED_SPEEDS = {"walk": (0.18, 0.350, 0.59), "run": (0.93, 1.111, 1.22)}
"""Minimum, harmonic mean and maximum dimensionless speed of the recordings."""
SLOWEST_ARMS = 0.3
"""Dimensionless speed below which the arms swing alike."""
DUTY = (0.533, 0.021)
"""Share of a walker's cycle with a foot on the floor (force plates, with toe: 0.62), and slope."""


def make_measured_curve(
    gait: str, name: PersonCurve, dimensionless_speed: Values, *, integral: bool = False, asymmetry: Values = 0.0
) -> CycleCurve:
    """Make measured curves or their phase integrals, of a batch by columns."""
    mean, slope = _find_harmonics(gait, name)
    harmonics = mean + slope * _compute_slowness(gait, dimensionless_speed)
    if np.any(asymmetry):
        beside = asymmetry / 4j * harmonics
        harmonics = np.concatenate([harmonics, np.zeros_like(harmonics[..., :1])], axis=-1)
        harmonics[..., 1:] += beside
        harmonics[..., :-2] -= beside[..., 1:]
    if integral:
        harmonics[..., 1:] /= 2j * np.pi * np.arange(1, harmonics.shape[-1])
        harmonics[..., 0] = 0.0
    return CycleCurve(harmonics)


def walk_duty(dimensionless_speed: Values) -> Any:
    """Return the duty factor of a walker's foot."""
    return DUTY[0] + DUTY[1] * _compute_slowness("walk", dimensionless_speed)


def _compute_slowness(gait: str, dimensionless_speed: Values) -> Any:
    """Return the mean speed divided by this speed."""
    low, middle, high = MEASURED_SPEEDS[gait]
    return 1 / np.clip(dimensionless_speed, low, high) - 1 / middle


@cache
def _find_harmonics(gait: str, name: PersonCurve) -> tuple[npt.NDArray[np.complex128], npt.NDArray[np.complex128]]:
    # of the mean and the slope of a table; those at half the sampling rate are left out
    samples = load_tables()["people"][gait][name]
    return _transform(samples["mean"], 10), _transform(samples["slope"], 10)


def _transform(samples: list[float], count: int) -> npt.NDArray[np.complex128]:
    """Return the first harmonics of samples over a cycle. 20 samples, or 10 over half of it."""
    harmonics = np.fft.rfft(np.tile(samples, 20 // len(samples)))[:count] / 10
    harmonics[0] /= 2
    return harmonics


N_HARMONICS = {"scapula": 6, "manus": 6, "metatarsus": 6, "neck": 2, "tail": 2}
"""Number of harmonics by curve. Curves of the trunk have 4."""


def find_trunk_curve(gait: RecordedGait, name: str, touchdown: Mapping[str, float]) -> tuple[CycleCurve, float]:
    """Return a trunk curve and its first phase."""
    # the phases of neck and front are relative to the fore feet, the others to the hind feet
    fore = name == "neck" or name.startswith("fore")
    left, right = (touchdown[f"{side}_{'fore' if fore else 'hind'}"] for side in ("left", "right"))
    table, curve, landing = load_tables()["dogs"][gait], _make_curve(gait, name), left
    if gait == "gallop":
        landing = cmath.phase(cmath.exp(2j * math.pi * left) + cmath.exp(2j * math.pi * right)) / (2 * math.pi)
        if name.endswith(("sway", "roll", "yaw")):  # nothing if both feet land together, mirrored in the other order
            turned = math.sin(2 * math.pi * (left - right)) / math.sin(2 * math.pi * table["lag"][fore])
            curve = CycleCurve(curve.coefficients * turned)
    return curve, landing - table["landing"][fore]


_GIRDLE_CURVES = ("surge", "sway", "roll", "yaw", "heave")
TRUNK_CURVES = *(f"{end}_{name}" for end in ("hind", "fore") for name in _GIRDLE_CURVES), "neck", "tail"


def join_trunk_curves(gaits: Sequence[RecordedGait], touchdowns: Sequence[Mapping[str, float]]) -> CycleCurve:
    """Join the trunk curves of a batch, each at its first phase: coefficients (12, B, 5)."""
    terms, begins = np.zeros((len(TRUNK_CURVES), len(gaits), 5), complex), np.empty((len(TRUNK_CURVES), len(gaits), 1))
    for row, name in enumerate(TRUNK_CURVES):
        for number, (gait, touchdown) in enumerate(zip(gaits, touchdowns, strict=True)):
            curve, begins[row, number] = find_trunk_curve(gait, name, touchdown)
            terms[row, number, : curve.coefficients.size] = curve.coefficients
    return CycleCurve(terms * np.exp(-2j * np.pi * begins * np.arange(5)))


def segment_elevation_rad(
    gaits: Sequence[RecordedGait], segments: Sequence[Segment], cycles: FloatArray, duty: Values
) -> FloatArray:
    """Return measured elevations of segments, with stance and swing scaled to the duty."""
    of_recording = make_column([load_tables()["dogs"][gait]["duty"]["metatarsus" not in segments] for gait in gaits])
    own = cycles - np.floor(cycles)
    # a cubic on both sides of lift-off with equal slopes at the knots: the speed is continuous
    stance, swing = of_recording / duty, (1 - of_recording) / (1 - duty)
    slope = 2 * stance * swing / (stance + swing)
    swings = own >= duty
    width = np.where(swings, 1 - duty, duty)
    share = np.where(swings, own - duty, own) / width
    rise = np.where(swings, 1 - of_recording, of_recording)
    eased = share * share * (3 - 2 * share)
    bow = slope * width * share * (1 - share) * (1 - 2 * share)
    at = np.where(swings, of_recording, 0.0) + rise * eased + bow
    terms = np.array([[_make_curve(gait, name).coefficients for gait in gaits] for name in segments])
    return np.radians(CycleCurve(terms[:, None])(at))


def find_swing_curve(gaits: Sequence[RecordedGait], end: str, peak: Values) -> Curve:
    """Return the path of a swinging paw, 0 to 1, over the share of the swing."""
    speed = np.array([load_tables()["dogs"][gait]["swings"][end] for gait in gaits])
    squared = speed**2
    peaked = squared / squared.mean(axis=-1, keepdims=True) * speed.mean(axis=-1, keepdims=True)
    highest = speed.max(axis=-1, keepdims=True)
    speed = speed + (peak - 1) * highest / (peaked.max(axis=-1, keepdims=True) - highest) * (peaked - speed)
    count = speed.shape[-1]
    step = 1 / (count - 1)
    ways = step / 2 * (speed[..., :-1] + speed[..., 1:])
    bend = np.diff(np.gradient(speed, step, axis=-1))
    ways[..., 1:-1] -= step**2 / 12 * bend[..., 1:-1]  # for a smooth speed, except at the ends
    way = np.concatenate([np.zeros_like(ways[..., :1]), np.cumsum(ways, axis=-1)], axis=-1)
    knots = np.broadcast_to(np.linspace(0, 1, count), way.shape)
    return fit_cubic_hermite(knots, way / way[..., -1:], speed / way[..., -1:])


@cache
def _make_curve(gait: str, name: str) -> CycleCurve:
    count = N_HARMONICS.get(name, 4)
    terms = _transform(load_tables()["dogs"][gait][name], count + 1)
    if name.endswith("surge"):
        terms = np.concatenate([[0.0], terms[1:] / (2j * np.pi * np.arange(1, count + 1))])
    return CycleCurve(terms)
