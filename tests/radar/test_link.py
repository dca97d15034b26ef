"""Noise of swept-threshold counters (E-18b), and what integration and pulse repetition do to echoes."""

import math

import numpy as np
import pytest
from scipy.stats import norm

from doppelgait.core.rng import rng
from doppelgait.motion import make_motion
from doppelgait.pipeline import Conditions, simulate
from doppelgait.radar import Radar
from doppelgait.radar.impairments import ThermalNoise
from doppelgait.radar.impairments.additive import noise_power_per_sample_v2
from doppelgait.radar.link import (
    comparator_noise_v,
    compute_counter_noise_ratio,
    fold_scatterers,
    make_noise_taps,
    noise_power_v2,
)
from doppelgait.scene import Scene, Target
from doppelgait_conformance.radars import change_radar, make_table

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


C = 299_792_458.0
X4 = Radar.preset("x4")
PULSE_M = C / 2 / 15.1875e6
"""From one pulse of the X4 to the next."""


def test_noise_of_a_cw_radar_belongs_to_the_same_integration():
    plain = Radar.preset("xband-cw", integration_share=0.0)
    half = Radar.preset("xband-cw", integration_share=0.5)
    assert noise_power_v2(half) == pytest.approx(2 * noise_power_v2(plain))  # 1 / T_i in place of f_p


def test_reflections_beyond_the_next_pulse_fold_and_truth_does_not():
    """A body 8 m away, a wall 4 m to the side: its mirror image is 11.3 m away and appears at 1.44 m."""
    still = make_motion(np.tile([0.0, 0.0, 1.0], (20, 1, 1)), rate_hz=100, markers=["a"], parts=["torso"])
    scene = Scene([Target(still, range_m=8.0)], duration_s=0.1)
    wall = {"kind": "wall_ghost", "material": "concrete", "thickness_m": 0.2, "side_m": 4.0}
    conditions = Conditions(environment=[wall])
    for radar in (X4, change_radar(X4, fold_echoes=False)):
        recording = simulate(scene, radar, conditions=conditions, rng=rng(0), snr_db=np.inf)
        level = np.abs(recording.baseband.values[50])
        near = recording.range_m < 3.0
        assert bool(level[near].max() > 0) is radar.fold_echoes
        if radar.fold_echoes:
            assert recording.range_m[near][level[near].argmax()] == pytest.approx(np.hypot(8, 8) - PULSE_M, abs=0.03)
        assert recording.truth[0].centre_range_m == pytest.approx(8.0, abs=0.01)


def test_what_does_not_fold_is_not_touched():
    near = make_table(np.full((5, 3), [2.0, 5.0, 9.0]))
    far = make_table([[2.0, 12.0]], path_phase=0.3)
    assert fold_scatterers(near, X4) is near
    for radar in (Radar.preset("x4-long"), Radar.preset("liland2018"), Radar.preset("xband-cw"), Radar.preset("ti-77")):
        assert fold_scatterers(far, radar) is far
    folded = fold_scatterers(far, X4)
    assert folded["range"].values[0] == pytest.approx([2.0, 12.0 - PULSE_M])
    assert np.array_equal(folded["radial_velocity"], far["radial_velocity"])
    # 480 wavelengths of the carrier from pulse to pulse, and back
    assert np.mod(folded["path_phase"].values[0], 2 * np.pi) == pytest.approx([0.3, 0.3], abs=1e-6)


def test_a_frame_may_be_as_long_as_the_pulse_interval():
    assert Radar.preset("x4", range_stop_m=12.0, fold_echoes=False).n_range_bins == 234
    assert Radar.preset("x4", decimation=1, range_stop_m=1536 * 1.5e8 / 23.328e9).n_range_bins == 1538  # a whole frame
    assert Radar.preset("x4", range_start_m=5.0, range_stop_m=14.8).n_range_bins > 180  # a frame that starts later
