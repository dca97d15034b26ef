"""Gain by range: blind zone, sensitivity time control, end of the display."""

import numpy as np
import pytest
import xarray as xr

from doppelgait.scene.environment.effects import Setting, Visibility, apply_visibility

SETTING = Setting(wavelength_m=0.04, radar_position_m=(0.0, 0.0, 1.0), radar_azimuth_rad=0.0)


def table(range_m, path_gain):
    dims = ("slow_time", "scatterer")
    values = np.atleast_2d(np.asarray(range_m, dtype=float))
    return xr.Dataset(
        {
            "range": (dims, values, {"units": "m"}),
            "path_gain": (dims, np.broadcast_to(path_gain, values.shape), {"units": "1"}),
        }
    )


def test_every_echo_at_every_time_by_its_own_range():
    ranges, gains = np.random.default_rng(0).uniform(0, 10, (50, 7)), np.random.default_rng(1).uniform(0, 1, (50, 7))
    points = [(0.5, -200.0), (0.6, -3.0), (8.0, 0.0)]
    before = table(ranges, gains)
    seen = apply_visibility(before, Visibility(gain_db=points), SETTING)
    for i, k in np.ndindex(ranges.shape):
        r = ranges[i, k]
        if r <= 0.5:
            level_db = -200.0
        elif r <= 0.6:
            level_db = -200.0 + 197.0 * (r - 0.5) / 0.1
        elif r <= 8.0:
            level_db = -3.0 + 3.0 * (r - 0.6) / 7.4
        else:
            level_db = 0.0
        assert seen["path_gain"].values[i, k] == pytest.approx(gains[i, k] * 10 ** (level_db / 10), rel=1e-9)
    np.testing.assert_array_equal(before["path_gain"].values, gains)
    np.testing.assert_array_equal(seen["range"].values, ranges)


def test_one_pair_is_the_same_gain_everywhere():
    seen = apply_visibility(table([0.0, 50.0], 1.0), Visibility(gain_db=[[2.0, 6.0]]), SETTING)
    np.testing.assert_allclose(seen["path_gain"].values, 10**0.6)
