"""Displacement from the phase of one range bin: arctangent demodulation about the centre of the arc."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

ComplexArray = npt.NDArray[np.complex128]
FloatArray = npt.NDArray[np.float64]

LEAST_RADIUS_SD = 4.0
"""Radius over the spread about it below which noise would break the phase's thread."""
RADIUS_ERROR = 0.2
"""Relative error of an arc's radius up to which its displacement is told."""


def circle_of(values: ComplexArray) -> tuple[complex, float]:
    """Centre and radius of the circle through points of the complex plane (Taubin, IEEE PAMI 13, 1991).

    Parameters
    ----------
    values : ndarray, shape (I,)
        Four or more points.

    Returns
    -------
    centre : complex
    radius : float
        inf for points on a line; the centre is then their mean.
    """
    mean = complex(values.mean())
    moved = values - mean
    square = np.abs(moved) ** 2
    level = float(square.mean())
    if level <= 0.0:
        return mean, math.inf
    columns = np.stack([(square - level) / (2.0 * math.sqrt(level)), moved.real, moved.imag], axis=1)
    normal = np.linalg.svd(columns, full_matrices=False)[2][2]
    bend = normal[0] / (2.0 * math.sqrt(level))
    if abs(bend) * math.sqrt(level) < 1e-9:
        return mean, math.inf
    centre = complex(-normal[1], -normal[2]) / (2.0 * bend)
    return mean + centre, math.sqrt(abs(centre) ** 2 + level)


def displacement_of(values: ComplexArray, *, wavelength_m: float) -> tuple[FloatArray, bool]:
    r"""Displacement along the range against its mean, positive away, and whether its scale is known.

    An echo that moves by d turns by :math:`-4 \pi d / \lambda` on a circle about the static part of the bin (E-18):
    centre and radius come from the points, the phase is unwrapped. Where the arc is too short or too noisy for that
    (radius below four times the spread about it, or the radius' error :math:`\sigma \sqrt{720 / I} / (r\, \alpha^2)`
    for an arc of angle alpha above 20 %), the points are projected on their main direction; that has the right shape,
    but sign and scale are not known.

    Parameters
    ----------
    values : ndarray, shape (I,)
        One bin, static part in it.
    wavelength_m : float

    Returns
    -------
    displacement_m : ndarray, shape (I,)
        Relative to the strongest swing if the scale is not known.
    known : bool
    """
    centre, radius = circle_of(values)
    if math.isfinite(radius):
        about = values - centre
        phase = np.unwrap(np.angle(about))
        noise = float(np.std(np.abs(about)))
        arc = float(np.ptp(np.quantile(phase, [0.02, 0.98])))
        told = noise * math.sqrt(720.0 / values.size) < RADIUS_ERROR * radius * arc**2
        if told and radius > LEAST_RADIUS_SD * noise:
            return np.asarray(-(phase - phase.mean()) * wavelength_m / (4.0 * math.pi)), True
    moved = values - values.mean()
    plane = np.stack([moved.real, moved.imag])
    line = np.linalg.eigh(plane @ plane.T)[1][:, -1] @ plane
    return np.asarray(line / max(float(np.abs(line).max()), 1e-300)), False
