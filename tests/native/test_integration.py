"""The amplitude kernel against NumPy's sinc (E-13b, E-14)."""

import numpy as np
import pytest

from doppelgait._core import native


@pytest.mark.parametrize("shape", [(200, 7), (1, 7)])
@pytest.mark.parametrize("gain_shape", [(200, 7), (1, 7)])
def test_amplitude_is_that_of_the_distance_times_the_sinc(shape, gain_shape):
    rng = np.random.default_rng(0)
    range_m, velocity_mps = rng.uniform(0.01, 12.0, (200, 7)), rng.uniform(-30.0, 30.0, (200, 7))
    velocity_mps[:9, 0] = [0.0, 1e-12, 0.5, -0.5, 1.0, -1.0, 2.5, 1e3 + 0.25, -1e3 - 1.25]  # also in turns below
    rcs_m2, gain = rng.uniform(0.0, 2.0, shape), rng.uniform(0.0, 1.0, gain_shape)
    rcs_m2, gain = (np.broadcast_to(table, (200, 7)) for table in (rcs_m2, gain))
    one_metre = 3e-4 * np.sqrt(rcs_m2 * gain)
    out = np.full((200, 7), np.nan)
    native.integrate_echoes(range_m, velocity_mps, rcs_m2, gain, 3e-4, 0.2, 1.0, out)
    wanted = one_metre / np.maximum(range_m, 0.2) ** 2 * np.sinc(velocity_mps)
    assert np.abs(out - wanted).max() < 1e-11 * np.abs(one_metre / np.maximum(range_m, 0.2) ** 2).max()
    native.integrate_echoes(range_m, velocity_mps, rcs_m2, gain, 3e-4, 0.2, 0.0, out)
    assert out == pytest.approx(one_metre / np.maximum(range_m, 0.2) ** 2 * np.ones((200, 7)), rel=1e-11)
