"""Compiled passes over in-phase and quadrature values against the literal equations in NumPy."""

import numpy as np
import pytest

from doppelgait._core import native


def random(*shape, seed=0):
    return np.random.default_rng(seed).standard_normal(shape)


def test_quantised_values_are_those_of_the_equation_to_the_bit_and_padding_does_not_count():
    values = random(7, 300).astype(np.float32)
    values[:, 290:] = np.inf
    out = values.copy()
    n_beyond = native.quantise_parts(out, 290, 2.0**-9, -512.0, 511.0, 1.0, out)
    used = values[:, :290].astype(float)
    expected = np.clip(np.rint(used * 512), -512, 511) / 512
    np.testing.assert_array_equal(out[:, :290], expected.astype(np.float32))
    assert np.isinf(out[:, 290:]).all()
    assert n_beyond == (np.abs(used) > 1).sum()


def test_largest_size_is_that_of_the_columns_used():
    values = random(7, 300).astype(np.float32)
    values[3, 11], values[2, 299] = -9.0, 50.0
    assert native.find_largest_part(values, 299) == 9.0


@pytest.mark.parametrize("limit", [0.1, 1.0, np.nextafter(1.0, 0), np.nextafter(1.0, 2), np.inf])
def test_values_beyond_a_limit_are_counted_in_double_precision(limit):
    above = np.nextafter(np.float32(1.0), np.float32(2.0))
    values = np.array([[0.1, -1.0, 1.0, above, -np.inf, np.nan] * 9], np.float32)
    counted = native.quantise_parts(values, 53, 0.5, -8.0, 8.0, limit, np.zeros_like(values))
    assert counted == (np.abs(values[0, :53].astype(float)) > limit).sum()


@pytest.mark.parametrize("n_phases", [1, 2, 5])
@pytest.mark.parametrize("in_place", [False, True])
def test_rotation_is_the_exponential_of_the_sum(n_phases, in_place):
    n_pulses = 2 * 512 + 13
    planes = random(2, 3, n_pulses + 5).astype(np.float32)
    common, phases, weights = random(n_pulses) * 100, random(n_phases, n_pulses), random(3, n_phases, seed=1)
    common[:9] = np.arange(-4, 5) / 8  # where the eighths meet
    phases[:, :9] = 0.0
    before = planes.copy()
    out = planes if in_place else np.full_like(planes, np.nan)
    native.rotate_parts(*planes, common, phases, weights, *out)
    y = (before[0] + 1j * before[1].astype(float))[:, :n_pulses]
    expected = y * np.exp(2j * np.pi * (common + weights @ phases))
    found = (out[0] + 1j * out[1].astype(float))[:, :n_pulses]
    assert (np.abs(found - expected) / np.abs(y)).max() < 4e-7
    if in_place:
        np.testing.assert_array_equal(planes[:, :, n_pulses:], before[:, :, n_pulses:])


@pytest.mark.parametrize("n_factors", [1, 3])
@pytest.mark.parametrize("n", [1, 15, 33, 300])
def test_products_with_complex_factors(n_factors, n):
    planes, factors = random(2, 3, n).astype(np.float32), random(2, n_factors, n, seed=1).astype(np.float32)
    expected = (planes[0] + 1j * planes[1]) * (factors[0] + 1j * factors[1])
    native.turn_planes(*planes, *factors)
    np.testing.assert_allclose(planes[0] + 1j * planes[1], expected, rtol=0, atol=2e-6)


def test_strongest_power_of_every_column():
    planes, strongest = random(2, 7, 133).astype(np.float32), np.full(130, np.nan, np.float32)
    native.strongest_power(*planes, strongest)
    np.testing.assert_array_equal(strongest, (planes[0] ** 2 + planes[1] ** 2).max(axis=0)[:130])
