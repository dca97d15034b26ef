"""Ranges of images by one and by two reflections against NumPy."""

import numpy as np
import pytest

from doppelgait._core import native


@pytest.mark.parametrize("n", [1, 3, 8, 13])
def test_ranges_of_images_are_those_of_mirrored_points(n):
    rng = np.random.default_rng(n)
    step_s, radar_m = 0.05, 0.9
    knots = np.cumsum(rng.normal(size=(30, n)), axis=0) * 0.1 + 0.2  # also below the plane, where there is no image
    moments = np.empty_like(knots)
    native.spline_moments(knots, step_s, moments)
    times = np.linspace(0.0, 29 * step_s, 200)
    height, rate = np.empty((2, 200, n))
    native.positions_and_velocities(knots, moments, step_s, times, height, rate)
    range_m, velocity_mps = np.full((2, 200, 3 * n + 1), np.nan)
    near_m, near_mps = rng.uniform(2.0, 5.0, (200, n)), rng.normal(size=(200, n))
    range_m[:, :n], velocity_mps[:, :n] = near_m, near_mps
    native.image_ranges(knots, moments, step_s, times, 0, radar_m, n, 2 * n + 1, range_m, velocity_mps)
    rate, height = np.where(height > 0.0, rate, 0.0), np.maximum(height, 0.0)
    level_2 = near_m**2 - (height - radar_m) ** 2  # squared distance along the plane
    far_m = np.sqrt(level_2 + (height + radar_m) ** 2)
    far_mps = (near_m * near_mps - 2.0 * radar_m * rate) / far_m
    one, two = slice(n, 2 * n), slice(2 * n + 1, None)
    np.testing.assert_allclose(range_m[:, one], (near_m + far_m) / 2.0, rtol=1e-13)
    np.testing.assert_allclose(range_m[:, two], far_m, rtol=1e-13)
    np.testing.assert_allclose(velocity_mps[:, one], (near_mps + far_mps) / 2.0, atol=1e-12)
    np.testing.assert_allclose(velocity_mps[:, two], far_mps, atol=1e-12)
    assert (height == 0.0).any()
    assert (range_m[:, :n] == near_m).all()
    assert np.isnan(range_m[:, 2 * n]).all()
