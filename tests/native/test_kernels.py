"""Splines, images by reflection, antenna patterns and fluctuations against SciPy, NumPy and the literal equations."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from doppelgait._core import native
from doppelgait.radar.antenna import compute_cosine_exponent, rotate_to_boresight

STEP_S = 1 / 120


@pytest.mark.parametrize("n_frames", [4, 5, 6, 7, 50, 600])
def test_values_and_slopes_are_those_of_the_not_a_knot_spline(n_frames):
    rng = np.random.default_rng(n_frames)
    values = rng.standard_normal((n_frames, 9))
    times = np.concatenate([[0.0], rng.uniform(0, (n_frames - 1) * STEP_S, 200), [(n_frames - 1) * STEP_S]])
    moments = np.empty_like(values)
    native.spline_moments(values, STEP_S, moments)
    value, slope = np.empty((times.size, 9)), np.empty((times.size, 9))
    native.positions_and_velocities(values, moments, STEP_S, times, value, slope)

    oracle = CubicSpline(np.arange(n_frames) * STEP_S, values)
    np.testing.assert_allclose(value, oracle(times), atol=1e-11)
    np.testing.assert_allclose(slope, oracle(times, 1), atol=1e-10 * np.abs(oracle(times, 1)).max())
    native.values_between(values, moments, STEP_S, times, slope)
    np.testing.assert_allclose(slope, value, atol=1e-14)


@pytest.mark.parametrize("n_points", [1, 2, 7, 19])
def test_ranges_approach_speeds_angles_of_sight_and_aspect(n_points):
    rng = np.random.default_rng(n_points)
    values = np.cumsum(rng.standard_normal((40, 3 * n_points)), axis=0)
    moments = np.empty_like(values)
    native.spline_moments(values, STEP_S, moments)
    times, origin = np.linspace(0, 39 * STEP_S, 300), np.array([1.0, -2.0, 0.5])
    azimuth_rad, elevation_rad, aspect_rad = np.empty((3, 300, n_points))
    angles = azimuth_rad, elevation_rad
    native.angles_of_sight(values, moments, STEP_S, times, origin, *angles, 200.0, aspect_rad)

    oracle = CubicSpline(np.arange(40) * STEP_S, values.reshape(40, n_points, 3))
    sight, velocity = oracle(times) - origin, oracle(times, 1)
    distance, speed = np.linalg.norm(sight, axis=-1), np.linalg.norm(velocity, axis=-1)
    np.testing.assert_allclose(azimuth_rad, np.arctan2(sight[..., 1], sight[..., 0]), atol=1e-11)
    np.testing.assert_allclose(elevation_rad, np.arcsin(sight[..., 2] / distance), atol=1e-11)
    range_m, approach_mps = np.empty((2, 300, n_points))
    native.ranges_and_velocities(values, moments, STEP_S, times, origin, range_m, approach_mps)
    np.testing.assert_allclose(range_m, distance, rtol=1e-12)
    np.testing.assert_allclose(approach_mps, -(sight * velocity).sum(axis=-1) / distance, rtol=1e-9, atol=1e-9)
    expected = np.arccos(-(sight * velocity).sum(axis=-1) / (distance * speed))
    np.testing.assert_allclose(aspect_rad, np.where(speed >= 200.0, expected, np.nan), atol=1e-7)
    assert np.isfinite(aspect_rad).any()
    assert np.isnan(aspect_rad).any()
    only = np.empty_like(azimuth_rad), np.empty_like(elevation_rad)
    native.angles_of_sight(values, moments, STEP_S, times, origin, *only, 200.0, None)
    np.testing.assert_array_equal(only, angles)


@pytest.mark.parametrize("n_points", [1, 33])
def test_angles_of_all_directions(n_points):
    turn = np.concatenate([np.linspace(-np.pi, np.pi, 984), [0.0, np.pi / 2, np.pi / 4, -np.pi / 4, 1e-9, 0.3927]])
    for scale in (1e-3, 1.0, 1e5):
        points = scale * np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=-1)
        values, times = points.reshape(-1, 3 * n_points), np.arange(990.0 / n_points)
        azimuth_rad, elevation_rad = np.empty((2, times.size, n_points))
        native.angles_of_sight(values, 0.0 * values, 1.0, times, np.zeros(3), azimuth_rad, elevation_rad, 1.0, None)
        np.testing.assert_allclose(azimuth_rad, np.arctan2(values[:, 1::3], values[:, 0::3]), rtol=1e-15, atol=4e-16)
        assert not elevation_rad.any()
    origin = np.zeros((4, 3 * n_points))
    azimuth_rad, elevation_rad = np.empty((2, 4, n_points))
    native.angles_of_sight(origin, origin, 1.0, np.arange(4.0), np.zeros(3), azimuth_rad, elevation_rad, 1.0, None)
    assert not azimuth_rad.any()
    assert not elevation_rad.any()


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
