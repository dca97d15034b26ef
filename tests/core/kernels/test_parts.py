"""Compiled passes over in-phase and quadrature values against the literal equations in NumPy."""

import numpy as np
import pytest

from doppelgait.core.kernels.parts import LANES, largest_bits, quantise_parts, rotate_parts


def random(*shape, seed=0):
    return np.random.default_rng(seed).standard_normal(shape)


def test_quantised_values_are_those_of_the_equation_to_the_bit_and_padding_does_not_count():
    values = random(7, 300).astype(np.float32)
    values[:, 290:] = np.inf
    out = values.copy()
    n_beyond = quantise_parts(out, 290, 2.0**-9, -512.0, 511.0, 1.0, out)
    used = values[:, :290].astype(float)
    expected = np.clip(np.rint(used * 512), -512, 511) / 512
    np.testing.assert_array_equal(out[:, :290], expected.astype(np.float32))
    assert np.isinf(out[:, 290:]).all()
    assert n_beyond == (np.abs(used) > 1).sum()


def test_largest_size_is_that_of_the_columns_used():
    values = random(7, 300).astype(np.float32)
    values[3, 11], values[2, 299] = -9.0, 50.0
    assert np.int32(largest_bits(values.view(np.int32), 299)).view(np.float32) == 9.0


@pytest.mark.parametrize("n_phases", [1, 2, 5])
@pytest.mark.parametrize("in_place", [False, True])
def test_rotation_is_the_exponential_of_the_sum(n_phases, in_place):
    n_pulses = 2 * LANES + 13
    planes = random(2, 3, n_pulses + 5).astype(np.float32)
    common, phases, weights = random(n_pulses) * 100, random(n_phases, n_pulses), random(3, n_phases, seed=1)
    common[:9] = np.arange(-4, 5) / 8  # where the eighths meet
    phases[:, :9] = 0.0
    before = planes.copy()
    out = planes if in_place else np.full_like(planes, np.nan)
    rotate_parts(*planes, common, phases, weights, np.empty(LANES), np.empty(LANES, np.float32), *out)
    y = (before[0] + 1j * before[1].astype(float))[:, :n_pulses]
    expected = y * np.exp(2j * np.pi * (common + weights @ phases))
    found = (out[0] + 1j * out[1].astype(float))[:, :n_pulses]
    assert (np.abs(found - expected) / np.abs(y)).max() < 4e-7
    if in_place:
        np.testing.assert_array_equal(planes[:, :, n_pulses:], before[:, :, n_pulses:])
