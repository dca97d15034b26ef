"""Chance of residuals about straight motion."""

import numpy as np
import pytest

from doppelgait.core.straight import compute_straight_probability


def test_the_chance_of_residuals_is_chi_squared():
    """Independent errors half a second apart, three parameters fitted: the chances are uniform."""
    source, chances = np.random.default_rng(1), []
    times = np.arange(0, 10, 0.5)
    basis = np.stack([np.ones_like(times), times, times**2], axis=1)
    for _ in range(2000):
        errors = source.normal(0, 0.1, times.size)
        square = np.mean((errors - basis @ np.linalg.lstsq(basis, errors, rcond=None)[0]) ** 2)
        chances.append(compute_straight_probability(square, range_sd_m=0.1, duration_s=10.0, way_m=0.0, n_parameters=3))
    assert np.quantile(chances, [0.1, 0.5, 0.9]) == pytest.approx([0.1, 0.5, 0.9], abs=0.03)
