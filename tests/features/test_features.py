"""Features (E-33 to E-39) and those beyond, on drawn signatures and on walkers with known truth."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

import doppelgait as dg
from doppelgait import processing
from doppelgait.core.errors import ConfigError
from doppelgait.core.labels import BASEBAND, CADENCE_MAP, CADENCE_SPECTRUM, SIGNATURE, Signal, make_array
from doppelgait.core.rng import Streams
from doppelgait.features import (
    FEATURE_UNITS,
    FEATURES,
    Extraction,
    GaitFeatures,
    harmonic_ratio,
    limb_torso_ratio,
    snr_mu_db,
)
from doppelgait.features import doppler as measures
from doppelgait.features.extended import list_features, measure_extended
from doppelgait.features.observed import Observation, compute_autocorrelation_at
from doppelgait.features.uncertainty import estimate_uncertainties
from doppelgait.motion.models import breathing_person, moving_point
from doppelgait.motion.models.boulic import boulic_walk
from doppelgait.pipeline import analyze, simulate
from doppelgait.pipeline.target import analyze_signature, observe
from doppelgait.processing import Analysis, Gate
from doppelgait.radar import Radar, Recording, add_noise
from doppelgait.scene import Scene, Target
from exact_signatures import RATE_HZ, T, block, evidence_of, extended_of, extraction_of, line_at, with_extraction

WAVELENGTH_M = 299_792_458 / 7.29e9


def doppler_coords(k, prf_hz=1000.0):
    doppler_hz = (np.arange(k) - k // 2) * prf_hz / k
    return {"doppler": doppler_hz, "velocity": ("doppler", doppler_hz * WAVELENGTH_M / 2)}


def walked(speed_mps, seconds, *, snr_db=18.0, seed=0, height_m=1.75, k=None, **place):
    motion = boulic_walk(speed_mps=speed_mps, height_m=height_m, duration_s=seconds)
    recording = simulate(
        Scene([Target(motion, label="human", **place)]), Radar.preset("x4"), rng=Streams(seed), snr_db=snr_db
    )
    return analyze(recording, gate="truth", analysis=Analysis(doppler_bins=k))[0], recording.truth[0]


@pytest.fixture(scope="module")
def walkers_of_3_s():
    cases = [(v, h) for h in (1.6, 1.75, 1.9) for v in (0.6, 0.9, 1.2, 1.5, 1.8)]
    return [walked(v, 3.0, height_m=h, seed=n) for n, (v, h) in enumerate(cases)]


def test_step_frequency_of_walkers_at_20_db_and_three_periods_e33(walkers_of_3_s):
    errors = []
    for result, truth in walkers_of_3_s:
        assert 14 < result.quality["snr_mu_db"] < 24
        assert result.n_periods >= 3
        assert "low_confidence" not in result.flags
        errors.append(result.gait_frequency_hz / truth.gait_frequency_hz - 1)
    assert np.sqrt(np.mean(np.square(errors))) < 0.013
    assert np.abs(errors).max() < 0.025


def test_torso_velocity_of_walkers_e34(walkers_of_3_s):
    errors = [r.features.torso_velocity_mps - t.centre_velocity_mps.mean() for r, t in walkers_of_3_s]
    assert np.sqrt(np.mean(np.square(errors))) <= 0.04


def test_bandwidth_follows_the_true_span_e35(walkers_of_3_s):
    found, true = [], []
    for result, truth in walkers_of_3_s:
        doppler = truth.doppler_hz(WAVELENGTH_M)
        found.append(result.features.doppler_bandwidth_hz)
        true.append(np.percentile(doppler.max(axis=1), 95) - np.percentile(doppler.min(axis=1), 5))
    assert np.corrcoef(found, true)[0, 1] > 0.89
    assert 0.45 < np.mean(np.array(found) / true) < 0.7  # of points 0.78: a limb shows its speeds only while it flashes


def test_occupied_rows_stand_three_standard_deviations_above_the_noise_e38():
    # N_g = 16 and 25 independent columns: std of a row's mean is nu / sqrt(16 * 25) = nu / 20
    mean = 1.0 + np.array([0.0, 0.14, 0.16, -0.2, 5.0])
    coords = {"time": np.arange(50) / RATE_HZ, **doppler_coords(5)}
    attrs = {"n_gate_bins": 16, "wavelength_m": 0.04}
    mu = Signal.of(make_array(SIGNATURE, np.tile(mean, (50, 1)), coords, attrs), SIGNATURE)
    evidence = observation_of(mu, 1.0, np.ones(50), make_excess=lambda: mu.replace(mu.values - 1.0))
    np.testing.assert_array_equal(evidence.occupied, [False, False, True, False, True])


def test_ratio_is_taken_over_the_occupied_rows_alone_e38(monkeypatch):
    monkeypatch.setattr(Observation, "occupied", np.zeros(128, dtype=bool))
    result, _ = walked(1.2, 2.0)
    assert result.features.limb_torso_ratio is None
    assert "limb_torso_ratio:no_doppler_row_above_the_noise" in result.flags


def test_drifting_aspect_is_aligned_e29():
    result, truth = walked(1.4, 3.0, aspect_deg=45.0, range_m=4.0)
    assert abs(result.quality["main_line_drift_hz"]) > 10
    assert result.gait_frequency_hz == pytest.approx(truth.gait_frequency_hz, rel=0.03)


def test_a_record_of_a_period_or_two_is_flagged_e33():
    result, _ = walked(0.7, 1.2)
    assert "low_confidence" in result.flags
    assert result.quality["gait_confidence"] < 0.7


@pytest.mark.parametrize("noise_power_v2", [0.0, 1e-9])
def test_an_empty_room_gives_no_features(noise_power_v2):
    coords = {"slow_time": np.arange(3000) / 1000, "range": np.arange(60) * 0.0514}
    y = make_array(BASEBAND, np.zeros((3000, 60), np.complex64), coords)
    y = add_noise(y, noise_power_v2=noise_power_v2, rng=np.random.default_rng(0))
    gate = Gate.around([0, 3], [1.5, 1.5], span_m=1.6, source="given")
    result = analyze(Recording.from_baseband(y, Radar.preset("x4")), gate=gate)[0]
    assert result.flags == ("no_signal",)
    assert np.isnan(result.features.vector()).all()
    assert result.to_json(arrays=False)["features"]["torso_velocity_mps"] is None


def test_width_of_a_single_tone_e35():
    wanted = measures.single_tone_width_hz(cpi_s=0.1, window_steepness=0.4, threshold=0.04)
    assert wanted == pytest.approx(28.55, abs=0.005)


def test_threshold_width_is_contiguous_from_the_peak_and_interpolated_e35():
    doppler_hz = np.arange(11.0)
    spectrum = np.array([0, 0, 0.5, 0, 0, 0.02, 1.0, 0.52, 0.001, 0.9, 0])
    # linear in dB, left between 5 (0.02) and 6 (1.0), right between 7 (0.52) and 8 (0.001), each to 0.04
    left = 6 - np.log(1.0 / 0.04) / np.log(1.0 / 0.02)
    right = 7 + np.log(0.52 / 0.04) / np.log(0.52 / 0.001)
    wanted = right - left
    assert measures.bandwidth_threshold_hz(spectrum, doppler_hz, threshold=0.04) == pytest.approx(wanted)
    assert measures.bandwidth_threshold_hz(np.ones(11), doppler_hz, threshold=0.04) == 10.0


def observation_of(mu, floor_v2, main_line_hz, make_excess=None):
    """A signature with what these tests ask for; nothing else is known of it."""
    return Observation(
        signature=mu, floor_v2=floor_v2, main_line_hz=main_line_hz, make_excess=make_excess, n_independent=25.0,
        aligned=None, cadence_parts=None, strongest_v2=None, peaks_hz=None, spectrum=None, observation_s=0.4,
    )  # fmt: skip


def block_signature(low, high, floor, k=200, n_columns=100):
    """Equal power in the rows low..high of every column, over a floor."""
    values = np.full((n_columns, k), floor)
    for j, (a, b) in enumerate(zip(np.resize(low, n_columns), np.resize(high, n_columns), strict=True)):
        values[j, a : b + 1] += 1.0
    coords = {"time": np.arange(n_columns) / RATE_HZ, **doppler_coords(k)}
    attrs = {"n_gate_bins": 16, "wavelength_m": WAVELENGTH_M}
    return Signal.of(make_array(SIGNATURE, values, coords, attrs), SIGNATURE)


def envelope_width_hz(mu, floor_v2):
    return observation_of(mu, floor_v2, np.zeros(mu.sizes["time"])).envelope_width_hz


@pytest.mark.parametrize("n_bins", [1.0, 1.37, 4.0])
def test_noise_passes_the_envelopes_threshold_as_seldom_with_few_bins_as_with_many(n_bins):
    noise = np.random.default_rng(5).gamma(n_bins, 1 / n_bins, 4_000_000)
    expected = 4_000_000 * stats.norm.sf(4.0)  # 127
    assert abs(
        (noise > measures.compute_noise_quantile(n_bins, measures.DETECTION_SHARE)).sum() - expected
    ) < 4 * np.sqrt(expected)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_envelopes_are_those_of_the_cumulative_power_e35(dtype):
    values = np.random.default_rng(3).exponential(1.0, (200, 63)).astype(dtype)
    values[7], values[8, :-1], values[9, 1:] = 0.0, 0.0, 0.0
    coords = {"time": np.arange(200) / RATE_HZ, **doppler_coords(63)}
    found = measures.envelopes_hz(Signal.of(make_array(SIGNATURE, values, coords, {"n_gate_bins": 16}), SIGNATURE), 0.3)
    threshold = 0.3 * stats.gamma.isf(stats.norm.sf(4.0), 16) / 16
    power = np.where(values > threshold, values.astype(float) - 0.3, 0.0)
    share = power.cumsum(axis=1) / np.maximum(power.sum(axis=1, keepdims=True), 1e-300)
    for limits, quantile in zip(found, (0.01, 0.99), strict=True):
        edge = [np.interp(quantile, [0.0, *row], np.arange(64)) if row[-1] else np.nan for row in share]
        np.testing.assert_allclose(limits, coords["doppler"][0] + (np.array(edge) - 0.5) * 1000 / 63, 0, 1e-9)


def test_bandwidth_is_between_the_95th_and_5th_percentiles_over_time_e35():
    # 100 columns: 3 of them reach far out and do not count, 10 reach half as far and do
    high = np.full(100, 109)
    high[:3], high[3:13] = 190, 150
    mu = block_signature(np.full(100, 100), high, 0.0)
    assert envelope_width_hz(mu, 0.0) == pytest.approx(50 * 5.0, abs=10.0)


def test_bandwidth_needs_signal_in_half_of_the_columns_e35():
    mu = block_signature(100, 109, 0.01)
    mu.values[:60] = 0.01
    assert envelope_width_hz(mu, 0.01) is None
    low, _ = measures.envelopes_hz(mu, 0.01)
    assert np.isnan(low[:60]).all()
    assert np.isfinite(low[60:]).all()


def test_width_is_that_of_the_run_about_the_largest_share_e35():
    share = np.array([0.3, 0.0, 0.02, 0.10, 0.6, 1.0, 0.4, 0.06, 0.01, 0.2, 0.0])
    # left: between 2 (0.02) and 3 (0.10) at 3 - 5/8; right: between 7 (0.06) and 8 (0.01) at 7 + 1/5
    assert measures.width_of_bins(share) == pytest.approx(7.2 - (3 - 5 / 8))
    assert measures.width_of_bins(np.full(9, 0.5)) == 8.0
    np.testing.assert_array_equal(
        measures.width_of_bins(np.stack([share, np.full(share.size, 0.01)])), [measures.width_of_bins(share), np.nan]
    )
    wide = np.convolve(np.ones(5), np.ones(3)) / 3  # symmetric
    assert measures.width_of_bins(wide) == pytest.approx(measures.width_of_bins(wide[::-1]))


def test_level_rises_by_the_noise_that_is_as_frequent_e35():
    rng = np.random.default_rng(8)
    for n_bins in (1.0, 4.0, 17.0):
        noise = 0.3 * (rng.gamma(n_bins, 1 / n_bins, 400_000) - 1.0)
        silent = measures.raised_by_noise_v2(np.zeros(1), 0.3, n_bins)
        assert (noise >= silent).mean() == pytest.approx(0.05, rel=0.03)
        np.testing.assert_allclose(measures.raised_by_noise_v2(np.full(1, 0.4), 0.3, n_bins), np.sqrt(0.16 + silent**2))


def test_level_of_the_width_is_a_share_of_the_median_strongest_cell_with_range_removed_e35():
    mu = block_signature(100, 109, 0.01)
    range_m = np.linspace(3.0, 6.0, 100)
    mu.values[:] = 0.01 + (mu.values - 0.01) * ((4.5 / range_m) ** 4)[:, None]  # the radar equation
    mu.values[:7] += 50.0 * (mu.values[:7] - 0.01)  # glints count little
    level = measures.width_level_v2(mu.values.max(axis=1), 0.01, (range_m / 4.5) ** 4)
    assert level == pytest.approx(0.03, rel=1e-5)


@pytest.mark.parametrize("snr_db", [20.0, 14.0, 10.0])
def test_noise_does_not_move_the_bandwidth_e35(snr_db):
    wanted = walked(1.2, 4.0)[0].features.doppler_bandwidth_hz
    found = walked(1.2, 4.0, snr_db=snr_db)[0].features.doppler_bandwidth_hz
    assert found == pytest.approx(wanted, rel=0.05)


def test_bandwidth_below_the_noise_is_null_with_a_flag_e35():
    result = walked(1.2, 4.0, snr_db=1.0)[0]
    assert result.features.doppler_bandwidth_hz is None
    assert "doppler_bandwidth:noise_above_its_level" in result.flags
    assert result.features.torso_velocity_mps == pytest.approx(1.2, rel=0.05)


def test_snr_of_a_signature():
    mu = block_signature(100, 109, 0.01)
    assert snr_mu_db(mu, 0.01) == pytest.approx(20.0, abs=0.01)
    assert snr_mu_db(mu, 0.0) == np.inf
    assert snr_mu_db(mu, 5.0) == -np.inf


CADENCE_HZ = np.arange(0, 20, 0.02)


def lines(*peaks, floor=0.01):
    values = np.full(CADENCE_HZ.size, floor)
    for frequency_hz, height in peaks:
        values += height * np.exp(-0.5 * ((CADENCE_HZ - frequency_hz) / 0.1) ** 2)
    return make_array(CADENCE_SPECTRUM, values, {"cadence": CADENCE_HZ})


def test_harmonic_ratios_are_where_the_peaks_are_e37():
    spectrum = lines((1.9, 1.0), (3.9, 0.5), (5.5, 0.3))
    assert harmonic_ratio(spectrum, 1.9, 2) == pytest.approx(3.9 / 1.9, rel=1e-3)
    assert harmonic_ratio(spectrum, 1.9, 3) == pytest.approx(5.5 / 1.9, rel=1e-3)


def test_harmonic_ratio_looks_within_15_per_cent_and_needs_6_db_e37():
    assert harmonic_ratio(lines((1.9, 1.0), (3.8 * 1.13, 0.5)), 1.9, 2) == pytest.approx(2.26, rel=1e-2)
    assert harmonic_ratio(lines((1.9, 1.0), (3.8 * 1.25, 0.5)), 1.9, 2) is None
    assert harmonic_ratio(lines((1.9, 1.0), (3.8, 0.02)), 1.9, 2) is None  # 4.8 dB over the floor of 0.01
    assert harmonic_ratio(lines((1.9, 1.0), (3.8, 0.06)), 1.9, 2) == pytest.approx(2, rel=1e-2)
    assert harmonic_ratio(lines((1.9, 1.0)), 1.9, 3) is None


def test_ratio_in_both_forms_by_hand_e38():
    """Two occupied rows, one of noise: D at f, 2f, 3f given."""
    values = np.zeros((CADENCE_HZ.size, 3))
    for h, heights in ((1, (0.20, 0.10)), (2, (0.08, 0.05)), (3, (0.02, 0.01))):
        at = np.abs(CADENCE_HZ - 2.0 * h).argmin()
        values[at, :2] = heights
    values[:, 2] = 9.0
    step_doppler = make_array(CADENCE_MAP, values, {"cadence": CADENCE_HZ, **doppler_coords(3)})
    base = np.array([0.6, 0.3, 0.1])
    occupied = np.array([True, True, False])
    found = limb_torso_ratio(step_doppler, base, 2.0, occupied)
    amplitude = 2 * (0.20 + 0.10 + 0.08 + 0.05 + 0.02 + 0.01) / 0.9
    energy = 4 * (0.20**2 + 0.10**2 + 0.08**2 + 0.05**2 + 0.02**2 + 0.01**2) / (0.6**2 + 0.3**2)
    assert found.amplitude_ratio == pytest.approx(amplitude)
    assert found.ratio == pytest.approx(np.sqrt(energy))
    nothing = limb_torso_ratio(step_doppler, base, 2.0, np.zeros(3, dtype=bool))
    assert nothing.ratio is None
    assert nothing.amplitude_ratio is None


def test_noise_between_the_harmonics_is_taken_off_the_energy_form_e38():
    rng = np.random.default_rng(0)
    power = rng.exponential(1e-3, (CADENCE_HZ.size, 400))
    step_doppler = make_array(CADENCE_MAP, np.sqrt(power), {"cadence": CADENCE_HZ, **doppler_coords(400)})
    base = np.full(400, 1 / 400)
    found = limb_torso_ratio(step_doppler, base, 2.0, np.ones(400, dtype=bool))
    # sum over h of max(max D^2 - 2 N2, 0): the maximum of about 25 to 37 exponential cells is near 4 N2
    plain = np.sqrt(4 * 3 * 400 * 4e-3 / (400 * (1 / 400) ** 2))
    assert found.ratio < 0.8 * plain


def test_the_limb_torso_ratio_searches_at_least_a_quarter_hertz_e38():
    # at 1 Hz, 6 % is 0.06 Hz: a line 0.2 Hz beside the fundamental still counts
    cadence_hz = np.arange(0, 20, 0.05)
    row = np.where(np.isclose(cadence_hz, 1.2), 0.5, 1e-9)
    coords = {"cadence": cadence_hz, "doppler": [0.0], "velocity": ("doppler", [0.0])}
    found = limb_torso_ratio(make_array(CADENCE_MAP, row[:, None], coords), np.array([1.0]), 1.0, np.array([True]))
    assert found.amplitude_ratio == pytest.approx(1.0, rel=1e-6)


@pytest.mark.parametrize("motion", [breathing_person(duration_s=6.0), moving_point(speed_mps=0.6)])
@pytest.mark.parametrize("snr_db", [5.0, 20.0, None])
def test_a_target_without_limb_motion_has_no_gait_frequency(motion, snr_db):
    recording = simulate(Scene([Target(motion)]), Radar.preset("x4"), rng=Streams(1), snr_db=snr_db)
    found = analyze(recording, gate="truth")[0]
    assert found.gait_frequency_hz is None
    assert found.features.step_length_m is None
    assert found.features.limb_torso_ratio is None
    assert "gait_frequency:no_modulation" in found.flags
    assert found.features.torso_velocity_mps is not None, "its speed stands"


@pytest.mark.parametrize("sense", [1, -1])
def test_envelope_statistics_of_a_swinging_block(sense):
    swing = np.sin(2 * np.pi * 2.0 * T)
    ahead, behind = 2.0 + 1.0 * swing, 1.0 + 0.2 * swing
    line = 1.5
    edges = (line - behind, line + ahead) if sense > 0 else (-line - ahead, -line + behind)
    found = extended_of(block(*edges), sense * line)
    # the quantiles leave 1 % of the block's power on either side
    width = ahead + behind
    ahead, behind = ahead - 0.01 * width, behind - 0.01 * width
    wanted = {
        "forward_envelope_mean_mps": ahead.mean(), "backward_envelope_mean_mps": behind.mean(),
        "forward_envelope_sd_mps": ahead.std(), "backward_envelope_sd_mps": behind.std(),
        "forward_envelope_range_mps": 2 * np.sin(0.45 * np.pi) * (1 - 0.012),
        "backward_envelope_range_mps": 2 * np.sin(0.45 * np.pi) * (0.2 - 0.012),
        "envelope_offset_mps": (2.0 - 1.0) / 2,
        "torso_bandwidth_mps": (3.0 - 1.2 * np.sin(0.45 * np.pi)) * 0.98,
    }  # fmt: skip
    for name, value in wanted.items():
        assert found[name] == pytest.approx(value, abs=0.015), name
    high, low = np.percentile(ahead, 95), np.percentile(behind, 95)
    assert found["envelope_asymmetry"] == pytest.approx((high - low) / (high + low), abs=0.01)
    assert found["swing_duty"] == pytest.approx(0.5, abs=0.02)
    assert found["envelope_periodicity"] == pytest.approx(1.0, abs=0.01)


def test_swing_duty_is_the_share_of_the_time_far_out():
    ahead = np.where((2.0 * T) % 1.0 < 0.3, 3.0, 1.0)
    assert extended_of(block(0.5, 1.5 + ahead), 1.5)["swing_duty"] == pytest.approx(0.3, abs=0.01)
    assert extended_of(block(0.5, 2.5), 1.5)["swing_duty"] is None


def test_envelope_periodicity_is_low_at_another_period():
    ahead = 2.0 + np.sin(2 * np.pi * 2.0 * T)
    values = block(0.5, 1.5 + ahead)
    assert extended_of(values, 1.5, 4.0)["envelope_periodicity"] == pytest.approx(-1.0, abs=0.05)


def test_strength_variation_takes_the_range_out():
    range_m = np.linspace(6.0, 3.0, T.size)
    swing = 1.0 + 0.5 * np.sin(2 * np.pi * 2.0 * T)
    values = line_at(1.0) * (swing / range_m**4)[:, None]
    assert extended_of(values, 1.0, range_m=range_m)["strength_variation"] == pytest.approx(0.5 / np.sqrt(2), rel=0.01)


def test_torso_ripple_and_its_parts_at_the_gait_and_half_of_it():
    swing = 0.3 * np.sin(2 * np.pi * 2.0 * T + 0.4) + 0.1 * np.sin(2 * np.pi * 1.0 * T + 1.0)
    found = extended_of(line_at(1.5 + swing), 1.5)
    whole, half = (a / np.sqrt(2) * np.exp(-0.5 * (2 * np.pi * f * 0.04) ** 2) for a, f in ((0.3, 2.0), (0.1, 1.0)))
    assert found["torso_ripple_gait_mps"] == pytest.approx(whole, rel=0.03)
    assert found["torso_ripple_half_mps"] == pytest.approx(half, rel=0.10)  # the removed polynomial takes some
    assert found["torso_ripple_mps"] == pytest.approx(np.hypot(whole, half), rel=0.03)


def test_torso_ripple_needs_three_periods_for_the_half_and_ignores_a_slow_drift():
    drifting = 1.5 + 0.2 * (T / T[-1] - 0.5) ** 2
    found = extended_of(line_at(drifting), 1.5, 0.55)
    assert found["torso_ripple_half_mps"] is None
    assert found["torso_ripple_mps"] < 0.002


def test_alternate_likeness_tells_steps_from_strides():
    rng = np.random.default_rng(1)
    left, right = np.kron(rng.random((2, 12, 40)), np.ones((1, 5, 1)))  # 60 columns a step, 12 shapes of 5 columns
    pad = np.zeros((60, 44))
    for pair, wanted in (((left, left), 1.0), ((left, right), None)):
        steps = [np.concatenate([pad, pair[n % 2], pad[:, :43]], axis=1) for n in range(11)]
        values = np.concatenate(steps)[: T.size] + 1e-9
        found = extended_of(values, 0.3, RATE_HZ / 60)["alternate_likeness"]
        if wanted is None:
            rows = values[:, 44:84] / values.sum(axis=1, keepdims=True)
            rows = rows - rows.mean(axis=0)
            a, b = rows[:-60], rows[60:]
            once = 2 * (a * b).sum() / (a**2 + b**2).sum()
            a, b = rows[:-120], rows[120:]
            wanted = once / (2 * (a * b).sum() / (a**2 + b**2).sum())
            assert wanted < 0.3
        assert found == pytest.approx(wanted, abs=0.01)


def test_likeness_between_whole_lags_and_beyond_the_record():
    wave = np.sin(2 * np.pi * np.arange(400) / 37.5)
    assert compute_autocorrelation_at(wave, 37.5) == pytest.approx(1.0, abs=0.005)
    assert compute_autocorrelation_at(wave, 37.5 / 2) == pytest.approx(-1.0, abs=0.02)
    assert compute_autocorrelation_at(wave, 399.5) is None
    assert compute_autocorrelation_at(wave, 0.5) is None


@pytest.mark.parametrize("line_mps", [1.3, -1.3])
def test_power_shares_by_velocity(line_mps):
    s = np.sign(line_mps)
    values = 0.5 * line_at(line_mps) + 0.3 * line_at(line_mps + s) + 0.15 * line_at(line_mps + 2.2 * s)
    values += 0.05 * line_at(0.0) + 0.01
    found = extended_of(values, line_mps, floor=0.01)
    wanted = {"torso_share": 0.5, "limb_share": 0.35, "far_limb_share": 0.15, "stance_share": 0.05}
    for name, value in wanted.items():
        assert found[name] == pytest.approx(value, abs=0.002), name
    assert extended_of(values, 0.5 * s, floor=0.01)["stance_share"] is None


@pytest.mark.parametrize("k", [127, 255, 1023])
def test_band_edges_cut_cells_in_part(k):
    found = extended_of(block(-1.5, 4.5, k), np.linspace(1.4, 1.6, T.size), None)
    assert found["torso_share"] == pytest.approx(0.8 / 6, rel=0.01)
    assert found["limb_share"] == pytest.approx(2.4 / 6, rel=0.01)


def test_entropy_width_of_an_even_spread_does_not_depend_on_the_transform():
    for k in (511, 2047):
        assert extended_of(block(0.5, 2.5, k), 1.5)["entropy_width_mps"] == pytest.approx(2.0, rel=0.02)


def lines_at(cadence_hz, powers, level=0.0):
    values = np.full(cadence_hz.size, level)
    for f, p in powers.items():
        values[np.abs(cadence_hz - f).argmin()] += p
    return values


def test_cadence_moments():
    found = extended_of(line_at(1.5), 1.5, spectrum=lambda f: lines_at(f, {0.2: 9.0, 2.0: 3.0, 4.0: 1.0}))
    assert found["cadence_centroid_hz"] == pytest.approx(2.5)
    assert found["cadence_bandwidth_hz"] == pytest.approx(np.sqrt(0.75 * 0.5**2 + 0.25 * 1.5**2))


def test_relative_harmonics_without_the_noise():
    spectrum = {2.0: 8.0, 4.05: 4.0, 6.0: 2.0, 7.7: 5.0}
    found = extended_of(line_at(1.5), 1.5, spectrum=lambda f: lines_at(f, spectrum, level=1.0))
    assert found["relative_harmonic_2"] == pytest.approx(0.5)
    assert found["relative_harmonic_3"] == pytest.approx(0.25)
    assert found["relative_harmonic_4"] == 0.0  # 7.7 is more than half a resolution cell (0.1 Hz) from 8
    assert extended_of(line_at(1.5), 1.5, 5.5)["relative_harmonic_4"] is None


def test_reasons_for_what_is_missing():
    evidence = evidence_of(line_at(0.1), 0.1)
    nothing = with_extraction(evidence, Extraction(GaitFeatures(), None, None, None))
    assert set(measure_extended(nothing).values()) == {None}
    assert nothing.describe_missing(()) == "no_signal"
    slow = with_extraction(evidence_of(line_at(0.1), 0.1), extraction_of(0.1, None))
    assert slow.describe_missing(("direction",)) == "slower_than_0.2_mps_towards_or_away"
    assert slow.describe_missing(("gait_frequency",)) == "needs_a_gait_frequency"
    values = measure_extended(slow)
    assert values["forward_envelope_mean_mps"] is values["alternate_likeness"] is None
    assert values["torso_ripple_mps"] is not None
    gone = np.where(T[:, None] < 3.0, 0.0, block(0.5, 2.5))
    found = with_extraction(evidence_of(gone + 1e-12, 1.5, floor=2e-12), extraction_of(1.5))
    assert measure_extended(found)["torso_ripple_mps"] is measure_extended(found)["envelope_offset_mps"] is None
    assert found.describe_missing(("envelope",)) == "signal_in_too_few_columns"
    assert found.describe_missing(("line",)) == "main_line_lost_in_noise"


@pytest.mark.parametrize(
    ("facts", "text"),
    [
        ({"needs": ("enveloppe",)}, r"needs \('enveloppe',\) is not allowed; it is a tuple of gait_frequency"),
        ({"needs": "envelope"}, "needs 'envelope' is not allowed"),
        ({"unit": None}, "unit None is not allowed"),
    ],
)
def test_a_feature_with_wrong_facts_is_refused(facts, text):
    with pytest.raises(ConfigError, match=f"feature 'wrong' of .*test_features: {text}"):
        dg.plugin("feature", "wrong", **{"unit": "1", "source": "here", **facts})(lambda observed: 1.0)
    assert "wrong" not in FEATURES


def test_the_set_f_is_part_of_the_registry_in_its_order_e39():
    features = GaitFeatures(1.0, 200.0, 0.6, 2.0, None, 0.9)
    np.testing.assert_array_equal(features.vector(), [1.0, 200.0, 0.6, 2.0, np.nan, 0.9])
    assert list(features.as_dict()) == list(FEATURE_UNITS)
    marked = sorted((item for item in FEATURES.values() if "set_f" in item.facts), key=lambda item: item.facts["set_f"])
    assert {item.name: item.facts["unit"] for item in marked} == FEATURE_UNITS
    assert [item.facts["set_f"] for item in marked] == list(range(6))
    assert len(FEATURES) == 6 + len(list_features())


def test_registered_features_are_in_results_rows_and_tables(register, walker_mu):
    with pytest.raises(ConfigError, match="torso_share"):
        register("feature", "torso_share", unit="1", source="here")(lambda observed: 1.0)
    register("feature", "broken", unit="1", source="here")(lambda observed: float("nan"))
    register("feature", "columns", unit="1", source="here")(lambda observed: float(observed.power_v2.shape[0]))
    gate = Gate.around([0, 4], [8, 3], span_m=1.6)
    result = analyze_signature(walker_mu, gate, Analysis(doppler_bins=127), label=None)
    assert result.extended["columns"] == walker_mu.sizes["time"] == result.to_row()["extended_columns"]
    assert ("columns", "1", "here") in list_features()
    assert result.extended["broken"] is None
    register("feature", "words", unit="1", source="here")(lambda observed: "many")
    with pytest.raises(ConfigError, match="feature 'words': 'many' is no number"):
        analyze_signature(walker_mu, gate, Analysis(doppler_bins=127), label=None)


@pytest.fixture(scope="module", params=["body_parts", "surfaces"])
def walker_mu(request):
    motion = boulic_walk(height_m=1.75, speed_mps=1.3, duration_s=4.1)
    scene = Scene([Target(motion, range_m=5.0, rcs=request.param)], duration_s=4.0)
    recording = simulate(scene, Radar.preset("x4"), rng=Streams(3), snr_db=20.0)
    return analyze(recording, gate="truth", analysis=Analysis(doppler_bins=127))[0].signature


def assessed(mu):
    observed = observe(processing.decimate(mu), Analysis(doppler_bins=127))
    return SimpleNamespace(
        extended=measure_extended(observed), standard_deviations=estimate_uncertainties([observed])[0]
    )


def test_power_direction_and_time_reversal_do_not_matter(walker_mu, request):
    wanted, points = assessed(walker_mu), request.node.callspec.params["walker_mu"] == "body_parts"
    assert None not in wanted.extended.values()
    assert all(v is not None for n, v in wanted.standard_deviations.items() if n != "harmonic_ratio_3")
    mirrored = walker_mu.values[:, ::-1]
    backwards = walker_mu.copy(data=mirrored[::-1])
    backwards = backwards.assign_coords(centre_range=("time", walker_mu.coords["centre_range"].values[::-1]))
    variants = {
        "power": (walker_mu.copy(data=walker_mu.values * np.float32(1e-3)), 1e-3),
        "direction": (walker_mu.copy(data=mirrored), 1e-3 if points else 6e-3),  # deviations of weak harmonics
        "played backwards": (backwards, 0.03),
    }
    for name, (mu, tolerance) in variants.items():
        found = assessed(mu)
        for feature, value in wanted.extended.items():
            assert found.extended[feature] == pytest.approx(value, rel=tolerance, abs=0.005), (name, feature)
        for feature, value in wanted.standard_deviations.items():
            if value is not None:
                spare = 2e-4 if feature == "gait_frequency_hz" else None  # it has the difference of two rates
                wanted_sd = pytest.approx(value, rel=10 * tolerance, abs=spare)
                assert found.standard_deviations[feature] == wanted_sd, (name, feature)
