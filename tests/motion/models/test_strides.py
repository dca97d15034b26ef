"""Curves through a few knots, against SciPy's."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline, PchipInterpolator

from doppelgait.motion.models.strides import fit_cubic_spline, fit_periodic_pchip


@pytest.mark.parametrize("count", [4, 5, 9, 40, 30_000])  # dense, the last would take 7 GB
def test_spline_is_the_not_a_knot_spline_and_holds_beyond_its_ends(count: int) -> None:
    rng = np.random.default_rng(count)
    knots, heights = np.cumsum(rng.uniform(0.2, 2.0, count)), rng.normal(size=count)
    x = np.linspace(knots[0] - 1, knots[-1] + 1, 501)
    oracle, found = CubicSpline(knots, heights), fit_cubic_spline(knots, heights)
    for order in (0, 1):
        np.testing.assert_allclose(found(x, order), oracle(x, order), rtol=1e-11, atol=1e-11)


def test_where_a_rising_curve_takes_a_value() -> None:
    rng = np.random.default_rng(3)
    knots = np.cumsum(rng.uniform(0.6, 1.4, 12))
    oracle, found = CubicSpline(knots, np.arange(12.0)), fit_cubic_spline(knots, np.arange(12.0))
    values = np.array([0.0, 0.3, 1.0, 4.999999999, 5.0, 7.25, 10.999, 11.0])
    roots = [oracle.solve(value, extrapolate=False)[0] for value in values[1:-1]]
    np.testing.assert_allclose(found.where(values)[1:-1], roots, rtol=1e-13)
    np.testing.assert_allclose(found.where(values)[[0, -1]], knots[[0, -1]], rtol=1e-13)


def test_where_a_curve_is_level_at_the_value() -> None:
    """Newton's method alone would leave the interval: the slope vanishes at the root."""
    knots = np.array([-1.0, -0.4, 0.5, 1.0])
    assert abs(float(fit_cubic_spline(knots, knots**3).where(0.0))) < 1e-5


@pytest.mark.parametrize("count", [2, 3, 5])
def test_periodic_curve_is_that_of_many_periods(count: int) -> None:
    rng = np.random.default_rng(count)
    for _ in range(20):
        knots, heights = np.sort(rng.uniform(0, 1, count)), rng.normal(size=count).round(1)
        turns = np.arange(-3, 4)[:, None]
        oracle = PchipInterpolator((knots + turns).ravel(), np.tile(heights, 7))
        x = np.linspace(0, 1, 301)
        np.testing.assert_allclose(fit_periodic_pchip(knots, heights)(x), oracle(x), rtol=1e-11, atol=1e-11)
