"""Noise of swept-threshold counters (E-18b) against means over all thresholds."""

import math

import numpy as np
import pytest
from scipy.stats import norm

from doppelgait.radar import Radar
from doppelgait.radar.impairments import ThermalNoise
from doppelgait.radar.impairments.additive import noise_power_per_sample_v2
from doppelgait.radar.link import comparator_noise_v, compute_counter_noise_ratio, make_noise_taps, noise_power_v2

SHAPE = {
    "carrier_hz": 7.29e9, "prf_hz": 500.0, "sample_rate_hz": 23.328e9, "decimation": 8, "range_stop_m": 5.0,
    "bandwidth_hz": 1.4e9, "pulse_rate_hz": 16e6, "sweep_levels": 200,
}  # fmt: skip
N = 160  # 16 MHz / (500 Hz x 200 levels)


def counter_with_noise_of(steps: float, **changes) -> Radar:
    """Return a counter whose input noise is this many threshold steps."""
    averaging = Radar(**SHAPE, **changes)
    return Radar(**SHAPE, **changes, threshold_step_v=comparator_noise_v(averaging) / steps)


@pytest.mark.parametrize("steps", [0.05, 0.4, 1.0, 2.5, 20.0])
def test_the_closed_form_is_the_mean_over_all_places_between_two_thresholds(steps):
    place = (np.arange(2000) + 0.5) / 2000
    thresholds = np.arange(-200, 201)
    above = norm.cdf((place[:, None] - thresholds) / steps)
    variance = (above * (1 - above)).sum(axis=1).mean() / N  # steps^2
    radar = counter_with_noise_of(steps)
    formula = compute_counter_noise_ratio(radar) * comparator_noise_v(radar) ** 2 / N / radar.threshold_step_v**2
    assert formula == pytest.approx(variance, rel=1e-3)


def test_noise_of_a_counter_rises_with_the_root_of_the_noise_figure_wherever_it_is_given():
    step_v = counter_with_noise_of(2.5).threshold_step_v
    six, twelve = (Radar(**SHAPE, threshold_step_v=step_v, noise_figure_db=db) for db in (6.0, 12.0))
    ratio_db = 10 * math.log10(noise_power_v2(twelve) / noise_power_v2(six))
    assert ratio_db == pytest.approx(3.0)
    assert noise_power_per_sample_v2(ThermalNoise(noise_figure_db=12.0), six) == pytest.approx(noise_power_v2(twelve))
    # more pulses lower it in proportion, as the vendor states: 3 dB for twice as many
    half = Radar(**{**SHAPE, "prf_hz": 250.0}, threshold_step_v=step_v)
    assert noise_power_v2(half) / noise_power_v2(six) == pytest.approx(0.5)


def test_independent_bins_follow_the_correlation():
    radar = Radar(**SHAPE, noise_correlation=[0.6, 0.2])
    share = radar.waveform.independent_bins(radar)
    assert share == pytest.approx(1 / (1 + 2 * (0.36 + 0.04)))
    assert Radar(**SHAPE).waveform.independent_bins(Radar(**SHAPE)) == 1.0
    # the spread of a mean power over many bins of moving-average noise, by simulation
    rng = np.random.default_rng(4)
    white = (rng.standard_normal((4000, 402)) + 1j * rng.standard_normal((4000, 402))) / math.sqrt(2)
    noise = (white[:, 2:] + white[:, 1:-1] + white[:, :-2]) / math.sqrt(3)  # rho 2/3, 1/3
    boxcar = Radar(**SHAPE, noise_correlation=[2 / 3, 1 / 3])
    independent = 1 / np.var((np.abs(noise) ** 2).mean(axis=1)) / noise.shape[1]
    assert boxcar.waveform.independent_bins(boxcar) == pytest.approx(independent, rel=0.1)


@pytest.mark.parametrize(
    "correlation", [(), (0.633, 0.141, 0.006), (0.0, 0.0, 0.3), (-0.4, 0.1), (0.5,), (2 / 3, 1 / 3), (0.1,) * 5]
)
def test_the_factor_over_range_has_the_stated_correlation_and_is_minimum_phase(correlation):
    taps = make_noise_taps(Radar(**SHAPE, noise_correlation=correlation)).astype(float)
    assert taps.dtype == float
    assert taps.size == len(correlation) + 1
    np.testing.assert_allclose(np.correlate(taps, taps, "full")[taps.size - 1 :], [1.0, *correlation], atol=2e-6)
    assert np.abs(np.roots(taps)).max(initial=0.0) < 1.0
