"""Clutter removal against closed forms of its filters."""

from __future__ import annotations

import numpy as np
import pytest

from doppelgait.core.labels import BASEBAND, make_array
from doppelgait.processing import Analysis, remove_clutter

PRF_HZ = 100.0
TIME_S = np.arange(4000) / PRF_HZ


def tone(doppler_hz, clutter=3.0 - 1.0j):
    values = (clutter + np.exp(2j * np.pi * doppler_hz * TIME_S))[:, None] * np.array([1.0, 0.5])
    return make_array(BASEBAND, values.astype(np.complex64), {"slow_time": TIME_S, "range": [1.0, 1.1]})


def test_nothing_is_done_unless_asked_for():
    baseband = tone(5.0)
    assert remove_clutter(baseband, Analysis()) is baseband


def test_mean_takes_off_the_constant_and_nothing_else():
    kept = remove_clutter(tone(5.0), Analysis(clutter="mean")).values
    np.testing.assert_allclose(kept[:, 0], np.exp(2j * np.pi * 5.0 * TIME_S), atol=1e-5)
    np.testing.assert_allclose(kept[:, 1], 0.5 * kept[:, 0], atol=1e-6)


@pytest.mark.parametrize("doppler_hz", [0.02, 1 / (2 * np.pi * 2.0), 0.3, 5.0])
def test_exponential_is_the_high_pass_of_its_time_constant(doppler_hz):
    alpha = 1 - np.exp(-1 / (PRF_HZ * 2.0))
    z = np.exp(2j * np.pi * doppler_hz / PRF_HZ)
    expected = abs(1 - alpha / (1 - (1 - alpha) / z))  # one-pole running mean taken off
    kept = remove_clutter(tone(doppler_hz), Analysis(clutter="exponential", clutter_time_s=2.0)).values
    settled = kept[2400:, 0]  # 12 time constants after the start
    assert np.abs(settled).mean() == pytest.approx(expected, rel=2e-3)
    if doppler_hz == pytest.approx(0.0796, rel=1e-2):
        assert expected == pytest.approx(1 / np.sqrt(2), rel=0.02)


def test_exponential_follows_a_drift_that_the_mean_leaves():
    drift = 50.0 * np.exp(1j * 2 * np.pi * TIME_S / 4000.0)  # 0.09 rad/min
    values = np.repeat(drift[:, None], 2, axis=1).astype(np.complex64)
    baseband = make_array(BASEBAND, values, {"slow_time": TIME_S, "range": [1.0, 1.1]})
    residue = {
        kind: np.abs(remove_clutter(baseband, Analysis(clutter=kind, clutter_time_s=2.0)).values[1000:]).max()
        for kind in ("mean", "exponential")
    }
    slope = 50.0 * 2 * np.pi / 4000.0
    assert residue["exponential"] == pytest.approx(slope * 2.0, rel=0.02)  # a ramp lags by its slope times tau
    assert residue["mean"] > 5 * residue["exponential"]


def test_exponential_starts_without_a_transient_from_zero():
    kept = remove_clutter(tone(5.0, clutter=1000.0), Analysis(clutter="exponential")).values
    assert np.abs(kept[:, 0]).max() < 1.1
