"""Elementary functions against long double, within 3 units of the last digit, and their values at the ends."""

import numpy as np
import pytest

from doppelgait.core import units

RNG = np.random.default_rng(1)
TINY = 10.0 ** RNG.uniform(-300, 0, 20_000)
ANGLES = np.concatenate([RNG.uniform(-1e6, 1e6, 20_000), np.arange(-2000, 2001) * np.pi / 2, TINY, [1e22, 2.0**900]])
SHARES = np.concatenate([RNG.uniform(-1, 1, 20_000), 1 - TINY, TINY])
ABOVE_0 = np.concatenate([RNG.uniform(0.5, 2, 20_000), TINY, 1 / TINY, [5e-324, 1e-310]])
ENDS = np.array([0.0, -0.0, np.inf, -np.inf, np.nan, 1.0, -1.0, 5e-324])
CASES = {
    "sine": (np.sin, ANGLES), "cosine": (np.cos, ANGLES), "arcsine": (np.arcsin, SHARES),
    "arccosine": (np.arccos, SHARES), "exponential": (np.exp, RNG.uniform(-745, 709, 20_000)),
    "logarithm": (np.log, ABOVE_0), "decimal_logarithm": (np.log10, ABOVE_0),
    "power_of_ten": (lambda x: x.dtype.type(10) ** x, RNG.uniform(-320, 308, 20_000)),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_values_are_exact_to_the_last_digits(name):
    exact, numbers = CASES[name]
    function, expected = getattr(units, name), exact(numbers.astype(np.longdouble))
    assert np.abs((function(numbers) - expected) / np.spacing(np.abs(expected).astype(float))).max() < 3
    np.testing.assert_array_equal(function(numbers[::3]), function(numbers)[::3])  # strided, in other lanes
    np.testing.assert_array_equal(function(ENDS), exact(ENDS))


def test_angles_of_points_and_bessel_function():
    y, x = RNG.uniform(-1, 1, (2, 5000)), RNG.uniform(-1, 1, (2, 5000)).round(1)
    np.testing.assert_allclose(units.arctangent(y, x), np.arctan2(y, x), rtol=1e-15, atol=0)
    np.testing.assert_allclose(units.modified_bessel(np.linspace(0, 60, 99)), np.i0(np.linspace(0, 60, 99)), rtol=1e-14)
