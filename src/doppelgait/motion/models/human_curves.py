"""Measured mean curves of walking and running people.

The curves describe trunk, ankle and foot over a cycle, as a function of speed. They are means of 34 recorded walks and
5 runs, of half of the subjects (``studies/motion_curves.py`` makes the tables and tests them on the other half). Each
value is linear in the inverse of the dimensionless speed V / sqrt(g l) with the leg length l (if linear in the speed,
feet are a tenth too fast at 1 m/s), and constant outside the measured speeds. The foot lands at phase 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
Curve = Literal["pelvis_speed", "neck_speed", "ankle_speed", "ankle_height", "foot_pitch"]

MEASURED = {"walk": (0.18, 0.350, 0.59), "run": (0.93, 1.111, 1.22)}
"""Minimum, harmonic mean and maximum dimensionless speed of the recordings."""
DUTY = (0.571, 0.013)
"""Share of a walker's cycle with a foot at rest or rolling, and its slope. Force plates measure the toe up to 0.62."""

CURVES: dict[tuple[str, str], tuple[tuple[float, ...], tuple[float, ...]]] = {
    ("walk", "pelvis_speed"): (
        (0.171, 0.200, 0.088, -0.041, -0.097, -0.112, -0.113, -0.098, -0.049, 0.051),
        (0.030, 0.033, 0.045, 0.025, 0.003, -0.013, -0.030, -0.045, -0.048, 0.000),
    ),
    ("walk", "neck_speed"): (
        (0.134, 0.159, 0.076, -0.009, -0.070, -0.112, -0.091, -0.068, -0.049, 0.029),
        (0.032, 0.046, 0.036, 0.022, 0.013, -0.006, -0.031, -0.050, -0.050, -0.013),
    ),
    ("walk", "ankle_speed"): (
        (
            -0.53,
            -0.76,
            -0.95,
            -0.99,
            -0.99,
            -0.98,
            -0.97,
            -0.97,
            -0.96,
            -0.91,
            -0.76,
            -0.36,
            0.29,
            0.83,
            1.28,
            1.64,
            2.05,
            2.16,
            1.74,
            0.53,
        ),
        (
            -0.00,
            -0.02,
            0.01,
            0.01,
            0.01,
            0.00,
            -0.00,
            0.00,
            0.01,
            -0.01,
            -0.06,
            -0.19,
            -0.28,
            -0.17,
            -0.04,
            0.12,
            0.28,
            0.33,
            0.19,
            0.05,
        ),
    ),
    ("walk", "ankle_height"): (
        (
            0.078,
            0.070,
            0.071,
            0.070,
            0.070,
            0.070,
            0.071,
            0.073,
            0.077,
            0.086,
            0.104,
            0.133,
            0.176,
            0.220,
            0.240,
            0.217,
            0.166,
            0.116,
            0.095,
            0.093,
        ),
        (
            -0.001,
            -0.000,
            -0.002,
            -0.002,
            -0.002,
            -0.002,
            -0.003,
            -0.004,
            -0.006,
            -0.011,
            -0.019,
            -0.028,
            -0.039,
            -0.044,
            -0.037,
            -0.023,
            -0.013,
            -0.006,
            -0.005,
            -0.005,
        ),
    ),
    ("walk", "foot_pitch"): (
        (
            18.8,
            6.7,
            1.8,
            0.8,
            0.6,
            0.2,
            -0.5,
            -1.5,
            -3.2,
            -5.9,
            -11.5,
            -23.8,
            -46.3,
            -60.9,
            -55.9,
            -41.0,
            -21.6,
            -2.3,
            13.8,
            23.8,
        ),
        (
            -6.5,
            -2.8,
            -0.9,
            -0.4,
            -0.3,
            -0.0,
            0.4,
            0.9,
            1.8,
            2.9,
            4.9,
            9.9,
            16.9,
            14.7,
            6.0,
            1.1,
            -0.6,
            -2.1,
            -4.5,
            -7.1,
        ),
    ),
    ("run", "pelvis_speed"): (
        (-0.018, -0.051, -0.102, -0.081, -0.023, 0.054, 0.105, 0.082, 0.037, -0.004),
        (0.049, 0.062, 0.041, -0.043, -0.043, -0.072, -0.027, 0.182, -0.019, -0.130),
    ),
    ("run", "neck_speed"): (
        (0.002, -0.016, -0.049, -0.054, -0.027, 0.013, 0.038, 0.037, 0.035, 0.019),
        (0.089, 0.110, 0.080, -0.007, -0.112, -0.114, -0.098, -0.019, 0.041, 0.030),
    ),
    ("run", "ankle_speed"): (
        (
            -0.55,
            -0.90,
            -0.97,
            -0.96,
            -0.87,
            -0.66,
            -0.42,
            -0.33,
            -0.25,
            0.02,
            0.31,
            0.53,
            0.67,
            0.68,
            0.68,
            0.78,
            0.89,
            0.91,
            0.58,
            -0.00,
        ),
        (
            0.01,
            0.12,
            0.00,
            -0.01,
            -0.27,
            -0.26,
            -0.02,
            -0.18,
            -0.41,
            -0.47,
            -0.54,
            -0.34,
            -0.01,
            0.26,
            0.61,
            0.38,
            0.54,
            0.18,
            -0.40,
            -0.19,
        ),
    ),
    ("run", "ankle_height"): (
        (
            0.095,
            0.074,
            0.069,
            0.067,
            0.088,
            0.131,
            0.180,
            0.227,
            0.284,
            0.340,
            0.384,
            0.412,
            0.414,
            0.392,
            0.349,
            0.288,
            0.220,
            0.162,
            0.127,
            0.117,
        ),
        (
            0.046,
            0.009,
            0.006,
            0.011,
            0.001,
            -0.023,
            -0.056,
            -0.116,
            -0.187,
            -0.273,
            -0.369,
            -0.460,
            -0.511,
            -0.498,
            -0.461,
            -0.383,
            -0.280,
            -0.156,
            -0.060,
            0.017,
        ),
    ),
    ("run", "foot_pitch"): (
        (
            7.5,
            1.5,
            0.3,
            -2.1,
            -6.1,
            -15.5,
            -35.1,
            -59.5,
            -72.6,
            -79.4,
            -91.6,
            -98.5,
            -96.4,
            -86.1,
            -66.6,
            -45.5,
            -25.9,
            -7.4,
            5.9,
            12.0,
        ),
        (
            -17.1,
            -16.1,
            1.4,
            1.6,
            1.7,
            3.1,
            12.2,
            12.3,
            26.0,
            60.2,
            91.8,
            105.5,
            99.1,
            92.7,
            74.6,
            66.1,
            60.8,
            42.3,
            22.3,
            5.1,
        ),
    ),
}
"""Mean and slope against the inverse of the dimensionless speed, at equal steps of phase of a cycle (20) or step (10).

Speeds are forward speeds over V, less 1. The height is that of the ankle over the leg length. The pitch is that of the
line from ankle to toe relative to standing, in degrees, positive with the toe up.
"""


@dataclass(frozen=True)
class CycleCurve:
    """Periodic curves of phase, as sums of harmonics.
    Shapes: coefficients (K,).
    """

    coefficients: npt.NDArray[np.complex128]

    def __call__(self, phase: FloatArray) -> FloatArray:
        """Values at phases (n,), of the same shape or (curves, n)."""
        angle = 2.0 * np.pi * phase
        turn = np.empty(angle.shape, dtype=complex)
        np.cos(angle, out=turn.real)  # the exponential of an imaginary number takes three times as long
        np.sin(angle, out=turn.imag)
        highest, *lower = self.coefficients.T[::-1, ..., None]
        total = np.empty(self.coefficients.shape[:-1] + turn.shape, dtype=complex)
        total[...] = highest
        for coefficient in lower:
            total *= turn
            total += coefficient
        return np.asarray(total.real)


def join_curves(*curves: CycleCurve) -> CycleCurve:
    """Join curves of equal numbers of harmonics, to save time."""
    return CycleCurve(np.stack([curve.coefficients for curve in curves]))


def make_measured_curve(
    gait: str, name: Curve, dimensionless_speed: float, *, integral: bool = False, asymmetry: float = 0.0
) -> CycleCurve:
    """Make a measured curve or its phase integral."""
    mean, slope = _find_harmonics(gait, name)
    harmonics = mean + slope * _compute_slowness(gait, dimensionless_speed)
    if asymmetry:
        beside = asymmetry / 4j * harmonics
        harmonics = np.append(harmonics, 0.0)
        harmonics[1:] += beside
        harmonics[:-2] -= beside[1:]
    if integral:
        orders = np.arange(1, harmonics.size)
        harmonics = np.concatenate([[0.0], harmonics[1:] / (2j * np.pi * orders)])
    return CycleCurve(harmonics)


def walk_duty(dimensionless_speed: float) -> float:
    """Return the duty factor of a walker's foot."""
    return DUTY[0] + DUTY[1] * _compute_slowness("walk", dimensionless_speed)


def _compute_slowness(gait: str, dimensionless_speed: float) -> float:
    """Return the mean speed divided by this speed."""
    low, middle, high = MEASURED[gait]
    return 1 / min(max(dimensionless_speed, low), high) - 1 / middle


@cache
def _find_harmonics(gait: str, name: Curve) -> tuple[npt.NDArray[np.complex128], npt.NDArray[np.complex128]]:
    """Return harmonics of a table's mean and slope.
    Harmonics at half the sampling rate are left out.
    """
    found = []
    for samples in CURVES[gait, name]:
        values = np.tile(samples, 20 // len(samples))
        harmonics = np.fft.rfft(values)[:10] / 10
        harmonics[0] /= 2
        found.append(harmonics)
    return found[0], found[1]
