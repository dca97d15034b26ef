"""The spline kernel against SciPy's cubic spline."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from doppelgait._core import native

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
