"""The spline kernel against SciPy's cubic spline."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from doppelgait.core.kernels.spline import (
    positions_and_velocities,
    ranges_and_velocities,
    spline_moments,
    turn_and_move,
)

STEP_S = 1 / 120


@pytest.mark.parametrize("n_frames", [4, 5, 6, 7, 50, 600])
def test_values_and_slopes_are_those_of_the_not_a_knot_spline(n_frames):
    rng = np.random.default_rng(n_frames)
    values = rng.standard_normal((n_frames, 9))
    times = np.concatenate([[0.0], rng.uniform(0, (n_frames - 1) * STEP_S, 200), [(n_frames - 1) * STEP_S]])
    moments = np.empty_like(values)
    spline_moments(values, STEP_S, moments)
    value, slope = np.empty((times.size, 9)), np.empty((times.size, 9))
    positions_and_velocities(values, moments, STEP_S, times, value, slope)

    oracle = CubicSpline(np.arange(n_frames) * STEP_S, values)
    np.testing.assert_allclose(value, oracle(times), atol=1e-11)
    np.testing.assert_allclose(slope, oracle(times, 1), atol=1e-10 * np.abs(oracle(times, 1)).max())


def test_ranges_and_approach_speeds_follow_from_position_and_velocity():
    rng = np.random.default_rng(1)
    values = np.cumsum(rng.standard_normal((40, 6)), axis=0) + 10
    moments = np.empty_like(values)
    spline_moments(values, STEP_S, moments)
    times, origin = np.linspace(0, 39 * STEP_S, 300), np.array([1.0, -2.0, 0.5])
    range_m, approach_mps = np.empty((300, 2)), np.empty((300, 2))
    ranges_and_velocities(values, moments, STEP_S, times, origin, range_m, approach_mps)

    oracle = CubicSpline(np.arange(40) * STEP_S, values.reshape(40, 2, 3))
    sight, velocity = oracle(times) - origin, oracle(times, 1)
    distance = np.linalg.norm(sight, axis=-1)
    np.testing.assert_allclose(range_m, distance, rtol=1e-12)
    np.testing.assert_allclose(approach_mps, -(sight * velocity).sum(axis=-1) / distance, rtol=1e-9, atol=1e-9)


def test_points_turn_about_an_upright_axis_and_move():
    rng = np.random.default_rng(4)
    points, moved, angle = rng.normal(size=(37, 3)), np.empty((37, 3)), 0.7
    turn_and_move(points, np.cos(angle), np.sin(angle), 1.0, -2.0, 0.5, 3.0, moved)
    turned = Rotation.from_euler("z", angle).apply(points - np.array([1.0, -2.0, 0.0])) + np.array([0.5, 3.0, 0.0])
    assert moved == pytest.approx(turned, abs=1e-13)
