"""Polynomials over an observation, and goodness of fit of straight, steady motion."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

ERROR_MEMORY_S = 0.5  # correlation time of range errors, set by the stride and by the memory of a tracker's smoother
SPEED_WANDER = 0.004
"""Standard deviation of the range of steady walkers from constant velocity, as a share of the path
along the range. In recordings, the speed varies by about 5 per cent over several seconds."""
PARABOLA, LINE = 3, 2  # number of parameters of straight motion in general, and towards or away from the radar


def compute_straight_probability(
    square_m2: float, *, range_sd_m: float, duration_s: float, way_m: float, n_parameters: int
) -> float:
    """Compute the probability of residuals with a larger mean square in straight, steady motion."""
    from scipy.special import chdtrc

    n_errors = duration_s / ERROR_MEMORY_S
    square = square_m2 / (range_sd_m**2 + (SPEED_WANDER * way_m) ** 2)
    return float(chdtrc(max(n_errors - n_parameters, 0.5), n_errors * square))


@lru_cache(maxsize=16)
def make_orthonormal_basis(n_columns: int, order: int, counted: bytes = b"") -> npt.NDArray[np.float64]:
    """Compute orthonormal polynomials over the counted columns, read-only, (J, order + 1)."""
    basis = np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, n_columns), order)
    basis = np.linalg.qr(basis * np.frombuffer(counted, bool)[:, np.newaxis] if counted else basis)[0]
    basis.flags.writeable = False
    return np.asarray(basis, dtype=np.float64)
