"""Constants and conversions (E-05, E-06, E-10, E-14, E-21, E-25)."""

import numpy as np
import pytest

from doppelgait.core import units

WAVELENGTH_M = 299_792_458 / 7.29e9


def test_wavelength_and_doppler_of_one_metre_per_second_e05():
    assert units.carrier_to_wavelength_m(7.29e9) == pytest.approx(0.0411238, abs=5e-8)
    assert units.velocity_to_doppler_hz(1.0, WAVELENGTH_M) == pytest.approx(48.634, abs=5e-4)
    assert units.doppler_to_velocity_mps(1.0, WAVELENGTH_M) == pytest.approx(0.0205619, abs=5e-8)
    assert units.velocity_to_doppler_hz(-2.0, WAVELENGTH_M) == pytest.approx(-97.27, abs=5e-3)


def test_delay_is_two_way_e10():
    assert units.range_to_delay_s(299_792_458 / 2) == 1.0
    np.testing.assert_allclose(units.range_to_delay_s([1.5, 3.0]), [1.00069e-8, 2.00138e-8], rtol=1e-5)


def test_volts_of_watts_into_50_ohm_e14_and_noise_of_290_kelvin_e18():
    assert units.watt_to_volt([0.01, 0.25]) == pytest.approx([1.0, 5.0])
    assert pytest.approx(1.380649e-23 * 290, rel=1e-4) == units.NOISE_DENSITY_W_PER_HZ


def test_decibels():
    assert units.db_to_power(3.0103) == pytest.approx(2, rel=1e-6)
    assert units.db_to_amplitude(6.0206) == pytest.approx(2, rel=1e-6)
    assert units.power_to_db(1000.0) == pytest.approx(30)
    assert units.power_to_db(0.0) == -np.inf
    assert units.dbm_to_watt(30) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("cpi_s", "prf_hz", "m"),
    [(0.1, 1000, 101), (0.1, 300, 31), (0.1, 1300, 131), (0.3, 1000, 301), (0.05, 624, 31), (0.101, 1000, 101)],
)
def test_pulses_per_processing_interval_are_odd_e21(cpi_s, prf_hz, m):
    assert units.cpi_to_pulses(cpi_s, prf_hz) == m


@pytest.mark.parametrize("k", [3, 4, 31, 100, 101, 108, 128, 160, 255, 512])
def test_doppler_axis_holds_exactly_zero_and_is_the_shifted_fft_axis_e25(k):
    axis = units.doppler_axis_hz(k, 1000.0)
    assert axis[k // 2] == 0.0
    np.testing.assert_allclose(axis, np.fft.fftshift(np.fft.fftfreq(k, 1e-3)), rtol=0, atol=1e-10)


@pytest.mark.parametrize(("seconds", "prf_hz", "pulses"), [(5, 1000, 5000), (1.3, 1491, 1938), (0.29, 100, 29)])
def test_pulses_in_an_observation_and_their_times(seconds, prf_hz, pulses):
    assert units.duration_to_pulses(seconds, prf_hz) == pulses
    np.testing.assert_allclose(units.slow_time_axis_s(pulses, prf_hz)[[0, -1]], [0, (pulses - 1) / prf_hz], rtol=1e-15)
