"""Measured mean curves of walking and running people.

Trunk, ankle and foot over a cycle, against speed.

Means of recorded people, of half of them by subject: 34 walks and 5 runs (``studies/motion_curves.py`` makes the
tables; the other half tests them). Each is a straight line in the dimensionless speed V / sqrt(g l) with the leg length
l, and keeps its ends outside the measured speeds. The foot lands at phase 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
Curve = Literal["pelvis_speed", "neck_speed", "ankle_speed", "ankle_height", "foot_pitch"]

MEASURED = {"walk": (0.18, 0.385, 0.59), "run": (0.93, 1.122, 1.22)}
"""Lowest, mean and highest dimensionless speed of the recordings."""
DUTY = (0.603, -0.155)
"""Share of a walker's cycle on the ground at the mean speed, and its slope."""

CURVES: dict[tuple[str, str], tuple[tuple[float, ...], tuple[float, ...]]] = {
    ("walk", "pelvis_speed"): (
        (0.115, 0.195, 0.146, 0.013, -0.071, -0.101, -0.116, -0.106, -0.073, -0.001),
        (-0.189, -0.226, -0.401, -0.326, -0.102, 0.061, 0.265, 0.335, 0.427, 0.155),
    ),
    ("walk", "neck_speed"): (
        (0.082, 0.150, 0.109, 0.028, -0.021, -0.092, -0.112, -0.077, -0.057, -0.010),
        (-0.051, -0.326, -0.334, -0.279, -0.251, -0.002, 0.254, 0.376, 0.382, 0.231),
    ),
    ("walk", "ankle_speed"): (
        (-0.22, -0.68, -0.86, -1.01, -0.97, -0.99, -0.97, -0.98, -0.96, -0.95,
         -0.84, -0.60, -0.01, 0.58, 1.08, 1.45, 1.87, 2.19, 2.08, 1.18),
        (0.02, 0.15, 0.05, -0.15, -0.13, -0.10, -0.02, -0.01, -0.09, 0.03,
         0.25, 1.21, 2.32, 2.01, 0.83, -0.53, -1.95, -2.83, -2.42, -0.93),
    ),
    ("walk", "ankle_height"): (
        (0.087, 0.071, 0.071, 0.070, 0.070, 0.070, 0.071, 0.072, 0.074, 0.081,
         0.094, 0.118, 0.154, 0.201, 0.237, 0.234, 0.193, 0.137, 0.098, 0.096),
        (0.038, 0.010, 0.033, 0.032, 0.038, 0.038, 0.046, 0.053, 0.069, 0.097,
         0.162, 0.247, 0.331, 0.402, 0.378, 0.258, 0.149, 0.085, 0.052, 0.074),
    ),
    ("walk", "foot_pitch"): (
        (23.7, 11.8, 2.7, 1.1, 0.5, 0.5, -0.3, -1.0, -2.5, -4.3,
         -8.3, -16.2, -34.7, -56.2, -60.3, -49.4, -31.4, -11.2, 6.8, 21.0),
        (68.9, 41.7, 13.0, 5.4, 3.3, 2.5, -1.4, -5.7, -14.2, -22.2,
         -36.7, -67.7, -139.4, -158.5, -78.7, -16.5, 6.2, 20.1, 35.7, 57.8),
    ),
    ("run", "pelvis_speed"): (
        (-0.014, -0.027, -0.078, -0.101, -0.057, 0.008, 0.084, 0.101, 0.064, 0.019),
        (0.044, -0.067, -0.051, -0.011, 0.060, 0.041, 0.091, -0.064, -0.143, 0.101),
    ),
    ("run", "neck_speed"): (
        (0.010, -0.003, -0.029, -0.055, -0.043, -0.010, 0.027, 0.038, 0.035, 0.030),
        (-0.045, -0.094, -0.093, -0.052, 0.054, 0.110, 0.099, 0.066, -0.015, -0.030),
    ),
    ("run", "ankle_speed"): (
        (-0.25, -0.74, -0.95, -0.97, -0.93, -0.79, -0.55, -0.35, -0.31, -0.16,
         0.15, 0.42, 0.60, 0.69, 0.67, 0.71, 0.83, 0.92, 0.82, 0.34),
        (-0.01, -0.11, -0.09, -0.00, 0.09, 0.33, 0.17, 0.06, 0.25, 0.44,
         0.49, 0.51, 0.18, -0.06, -0.42, -0.50, -0.33, -0.47, 0.11, 0.24),
    ),
    ("run", "ankle_height"): (
        (0.109, 0.084, 0.072, 0.067, 0.072, 0.104, 0.153, 0.199, 0.250, 0.309,
         0.360, 0.399, 0.416, 0.408, 0.376, 0.325, 0.258, 0.193, 0.143, 0.121),
        (-0.033, -0.027, 0.001, -0.008, -0.005, 0.016, 0.041, 0.079, 0.144, 0.216,
         0.300, 0.386, 0.455, 0.470, 0.443, 0.391, 0.303, 0.197, 0.089, 0.020),
    ),
    ("run", "foot_pitch"): (
        (11.4, 4.1, 0.7, -0.5, -3.5, -9.1, -22.6, -46.0, -67.1, -75.2,
         -84.2, -95.7, -98.5, -93.3, -78.6, -57.2, -37.1, -17.5, -1.0, 9.8),
        (4.3, 17.4, 6.5, -2.5, -1.2, -1.7, -9.0, -16.9, -12.6, -34.1,
         -66.6, -92.0, -96.9, -89.6, -77.1, -60.1, -57.4, -46.1, -27.9, -12.1),
    ),
}  # fmt: skip
"""Mean and slope against the dimensionless speed, at equal steps of phase over a cycle (20) or a step (10).

Speeds are those forward over V less 1, the height is that of the ankle over the leg, the pitch that of the line from
ankle to toe against standing, degrees, toe up positive.
"""


@dataclass(frozen=True)
class CycleCurve:
    """Periodic curve from the phase in cycles, as a sum of harmonics.

    Parameters
    ----------
    coefficients : ndarray, complex
        c_k of Re(sum of c_k exp(2 pi j k phase)), from k = 0.
    """

    coefficients: npt.NDArray[np.complex128]

    def __call__(self, phase: FloatArray) -> FloatArray:
        """Values at phases, shaped like them."""
        turn = np.exp(2j * np.pi * phase)
        total = np.full_like(turn, self.coefficients[-1])
        for coefficient in self.coefficients[-2::-1]:
            total *= turn
            total += coefficient
        return np.asarray(total.real)


def measured_curve(gait: str, name: Curve, dimensionless_speed: float, *, integral: bool = False) -> CycleCurve:
    """Make a measured curve, or its integral over the phase.

    Parameters
    ----------
    gait : {"walk", "run"}
    name : str
    dimensionless_speed : float
        V / sqrt(g l); taken as the nearest measured one outside of :data:`MEASURED`.
    integral : bool
        Integrate the curve less its mean.
    """
    low, middle, high = MEASURED[gait]
    mean, slope = _harmonics(gait, name)
    harmonics = mean + slope * (min(max(dimensionless_speed, low), high) - middle)
    if integral:
        orders = np.arange(1, harmonics.size)
        harmonics = np.concatenate([[0.0], harmonics[1:] / (2j * np.pi * orders)])
    return CycleCurve(harmonics)


def walk_duty(dimensionless_speed: float) -> float:
    """Return the share of a walker's cycle with a foot down."""
    low, middle, high = MEASURED["walk"]
    return DUTY[0] + DUTY[1] * (min(max(dimensionless_speed, low), high) - middle)


@cache
def _harmonics(gait: str, name: Curve) -> tuple[npt.NDArray[np.complex128], npt.NDArray[np.complex128]]:
    """Return harmonics of a table's mean and slope.

    Those at half the sampling rate are left out.
    """
    found = []
    for samples in CURVES[gait, name]:
        values = np.tile(samples, 20 // len(samples))
        harmonics = np.fft.rfft(values)[:10] / 10
        harmonics[0] /= 2
        found.append(harmonics)
    return found[0], found[1]
