"""Antenna patterns and fluctuations in native code against the literal equations in NumPy."""

import numpy as np
import pytest

from doppelgait._core import native
from doppelgait.radar.antenna import compute_cosine_exponent, rotate_to_boresight


def random(*shape, low=0.0, high=1.0, seed=0):
    return np.random.default_rng(seed).uniform(low, high, shape)


@pytest.mark.parametrize("n", [1, 3, 41])
@pytest.mark.parametrize("tilt_rad", [0.0, 0.4, -np.pi / 2])
# narrow beams, and directions near 90 degrees, amplify the rounding of the angles
@pytest.mark.parametrize(("hpbw_deg", "rtol"), [(1.0, 1e-8), (65.0, 1e-12), (170.0, 1e-9)])
def test_cosine_pattern_in_every_direction(n, tilt_rad, hpbw_deg, rtol):
    azimuth, elevation = random(60, n, low=-9.0, high=9.0), random(60, n, low=-np.pi / 2, high=np.pi / 2, seed=1)
    azimuth[:5, 0], elevation[:5, 0] = [0.3, 0.3, 0.3, np.pi, 0.0], [np.pi / 2, -np.pi / 2, 0.0, 0.0, tilt_rad]
    path_gain, out = random(60, n, seed=2), np.full((60, n), np.nan)
    exponent = compute_cosine_exponent(hpbw_deg)
    native.apply_cosine_pattern(azimuth, elevation, 0.3, tilt_rad, exponent, exponent, 1e-3, path_gain, out)
    cosines = np.maximum(np.cos(rotate_to_boresight(azimuth, elevation, 0.3, tilt_rad)), 0.0)
    expected = path_gain * np.maximum((cosines**exponent).prod(axis=0), 1e-3) ** 2
    np.testing.assert_allclose(out, expected, rtol=rtol)
    largest_floor = 1.0 + 1e-15
    native.apply_cosine_pattern(azimuth, elevation, 0.3, tilt_rad, exponent, exponent, largest_floor, path_gain, out)
    np.testing.assert_allclose(out, path_gain)


def test_directions_that_are_no_numbers_get_the_floor():
    angles = np.array([[0.1, np.nan, np.inf]])
    out = np.zeros((1, 3))
    native.apply_cosine_pattern(angles, np.zeros((1, 3)), 0.0, 0.0, 2.0, 2.0, 0.5, np.ones((1, 3)), out)
    np.testing.assert_allclose(out, [[np.cos(0.1) ** 4, 0.25, 0.25]])


@pytest.mark.parametrize("n", [1, 3, 17])
@pytest.mark.parametrize("n_squares", [1, 2, 4])
def test_fluctuation_is_a_mean_of_squares_of_smoothed_numbers_e08d(n, n_squares):
    times, correlation = random(33, high=2.0), 0.3
    times[:2] = 0.0, 0.075
    normal, out = np.random.default_rng(1).standard_normal((36, n, n_squares)), np.full((33, n), np.nan)
    native.smoothed_chi_square(normal.reshape(36, -1), times, correlation, 9, out)
    place = 2.0 * times / correlation + 9.0
    first = np.floor(place + 0.5).astype(int) - 9
    near = first[:, None] + np.arange(19)
    weights = np.exp(-(((place[:, None] - near) / 2.0) ** 2))
    values = np.einsum("ij,ijpd->ipd", weights, normal[near])
    expected = (values**2).mean(axis=2) / (weights**2).sum(axis=1)[:, None]
    np.testing.assert_allclose(out, expected, rtol=1e-12)
