"""Goodness of fit of straight, steady motion."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

ERROR_MEMORY_S = 0.5
"""Errors of ranges that are nearer in time than this are alike: a stride, and the memory of a tracker's smoother."""
SPEED_WANDER = 0.004
"""What ranges of recorded people who walk steadily depart from constant velocity, of the way: their speed wanders by
some 5 per cent over several seconds."""
PARABOLA, LINE = 3, 2
"""Parameters of straight motion, and of motion straight towards or away from the radar."""


def compute_straight_probability(
    residual_m: FloatArray, *, range_sd_m: float, duration_s: float, way_m: float, n_parameters: int
) -> float:
    r"""Compute the chance of larger residuals in straight, steady motion.

    With :math:`\nu = T / 0.5\,\mathrm{s}` independent errors, :math:`\nu \overline{r^2} / \sigma^2` is chi-squared with
    :math:`\nu` less the fitted parameters degrees of freedom (one half or more). The variance is that of a range and
    of a steady walker's speed, 0.004 of the way.

    Parameters
    ----------
    residual_m : ndarray
        Ranges less those of the motion that fits best.
    range_sd_m, duration_s, way_m, n_parameters
        As in :func:`compute_straight_probability_of_square`.
    """
    return compute_straight_probability_of_square(
        float(residual_m @ residual_m) / residual_m.size, range_sd_m=range_sd_m, duration_s=duration_s, way_m=way_m,
        n_parameters=n_parameters,
    )  # fmt: skip


def compute_straight_probability_of_square(
    square_m2: float, *, range_sd_m: float, duration_s: float, way_m: float, n_parameters: int
) -> float:
    """Compute :func:`compute_straight_probability` from the residuals' mean square.

    Parameters
    ----------
    square_m2 : float
    range_sd_m : float
        Standard deviation of a range.
    duration_s : float
        From the first range to the last.
    way_m : float
        Way along the range.
    n_parameters : int
        Fitted parameters.
    """
    from scipy.special import chdtrc

    n_errors = duration_s / ERROR_MEMORY_S
    square = square_m2 / (range_sd_m**2 + (SPEED_WANDER * way_m) ** 2)
    return float(chdtrc(max(n_errors - n_parameters, 0.5), n_errors * square))
