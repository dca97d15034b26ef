"""Impairments against closed forms: noise, phase, leakage, clutter, converters, interference."""

import math
import warnings

import numpy as np
import pytest
from scipy import integrate, signal

from doppelgait.core.errors import ConfigError, DoppelgaitWarning
from doppelgait.radar import Radar
from doppelgait.radar.impairments import (
    Adc,
    Interference,
    Leakage,
    PhaseNoise,
    StaticClutter,
    ThermalNoise,
    X4Counts,
    apply_impairments,
    x4_frame_rate_hz,
)
from doppelgait.radar.impairments.mixer import residual_phase_rad

C = 299_792_458.0
X4 = Radar.preset("x4", volts_per_unit=0.4)
AVERAGING = Radar.preset("x4", threshold_step_v=None, noise_bandwidth_hz=None, noise_correlation=())
FMCW = Radar(
    waveform="fmcw", carrier_hz=60e9, prf_hz=1000, sample_rate_hz=2e6, range_start_m=1, range_stop_m=9, sweep_s=64e-6,
    bandwidth_hz=1e9,
)  # fmt: skip
CW = Radar(waveform="cw", carrier_hz=24.1e9, prf_hz=1000, sample_rate_hz=3000, range_stop_m=9)


def only(samples, spec, radar=X4, seed=1):
    return apply_impairments(samples, [spec], radar=radar, rng=np.random.default_rng(seed)).matrix


def zeros(n_pulses, radar=X4):
    return np.zeros((n_pulses, radar.waveform.n_samples(radar)), np.complex64)


def bins(samples, radar):
    return radar.waveform.compress(samples, radar)


def power(values, **kwargs):
    return np.mean(np.abs(values).astype(np.float64) ** 2, **kwargs)


def db(ratio):
    return 10 * np.log10(ratio)


def test_thermal_noise_has_the_power_of_the_radar_equation_s_receiver():
    noise = only(zeros(4000), ThermalNoise(), AVERAGING)
    pulses_per_frame = math.floor(0.95 * 15.1875e6 / (1000 * 152))
    wanted = 2 * 50 * 4.004e-21 * 10**0.6 * 1.4e9 * 10**1.0 / pulses_per_frame
    assert power(noise) == pytest.approx(wanted, rel=5 / math.sqrt(noise.size))


def test_other_noise_figure_and_level():
    own, other = (only(zeros(100), ThermalNoise(noise_figure_db=figure), AVERAGING) for figure in (6.0, 9.0))
    np.testing.assert_array_equal(own, only(zeros(100), ThermalNoise(), AVERAGING))
    np.testing.assert_allclose(other, own * 10**0.15, rtol=1e-5, atol=0)
    units = only(zeros(1000), ThermalNoise(level_db=-105.0, in_units=True))
    assert db(power(units)) == pytest.approx(-105 + 20 * math.log10(0.4), abs=0.05)


def test_level_is_that_of_a_range_bin_whatever_the_waveform():
    noise = only(zeros(5000, FMCW), ThermalNoise(level_db=-80.0), FMCW)
    assert power(bins(noise, FMCW)) == pytest.approx(1e-8, rel=0.02)
    assert power(noise) > 1e-7  # compression averages


@pytest.mark.parametrize("sigma_rad", [0.03, 0.3])
def test_residue_of_static_clutter_is_the_phase_s_variance(sigma_rad):
    clutter = np.full((40_000, 1), 0.5j, np.complex64)
    turned = only(clutter, PhaseNoise(white_rad=sigma_rad), CW)
    residue = power(turned - turned.mean(axis=0)) / 0.25
    assert residue == pytest.approx(1 - math.exp(-(sigma_rad**2)), rel=0.04)
    np.testing.assert_allclose(np.abs(turned), 0.5, rtol=1e-5)


def test_one_picosecond_at_7_29_ghz():
    turned = only(np.ones((60_000, 1), np.complex64), PhaseNoise(white_rad=0, jitter_s=1e-12), CW)
    assert np.angle(turned).std() == pytest.approx(2 * np.pi * 24.1e9 * 1e-12, rel=0.02)
    turned = only(np.ones((20_000, 188), np.complex64), PhaseNoise(white_rad=0, jitter_s=1e-12))
    assert np.angle(turned[:, 0]).std() == pytest.approx(0.0458, rel=0.03)
    assert db(power(turned - turned.mean(axis=0))) == pytest.approx(-26.8, abs=0.15)
    assert np.ptp(turned, axis=1).max() == 0  # common to all ranges


def test_jitter_and_white_phase_add_in_power():
    jitter_s = 0.04 / (2 * np.pi * 24.1e9)
    turned = only(np.ones((60_000, 1), np.complex64), PhaseNoise(white_rad=0.03, jitter_s=jitter_s), CW)
    assert np.angle(turned).std() == pytest.approx(0.05, rel=0.02)


def test_linear_drift_has_its_rate_and_starts_at_zero():
    radar = CW.model_copy(update={"prf_hz": 10.0})
    turned = only(np.ones((601, 1), np.complex64), PhaseNoise(white_rad=0, drift_rad_per_min=0.7), radar)
    np.testing.assert_allclose(np.angle(turned[:, 0]), 0.7 * np.arange(601) / 600, atol=1e-6)


def test_walk_spreads_as_the_root_of_time():
    radar = CW.model_copy(update={"prf_hz": 10.0})
    spec = PhaseNoise(white_rad=0, walk_rad_per_sqrt_min=0.2)
    one = np.ones((601, 1), np.complex64)
    phase = np.array([np.angle(only(one, spec, radar, seed)[[0, 150, 600], 0]) for seed in range(1500)])
    assert not phase[:, 0].any()
    np.testing.assert_allclose(phase.std(axis=0)[1:], [0.1, 0.2], rtol=0.08)


RANGING = Radar(carrier_hz=1e9, prf_hz=1e6, sample_rate_hz=3e6, range_stop_m=299, pulse_sigma_s=1e-7, fold_echoes=False)


@pytest.mark.parametrize("slope_db_per_decade", [0.0, -30.0])
def test_oscillator_noise_has_the_density_of_range_correlation(slope_db_per_decade):
    spec = PhaseNoise(
        white_rad=0, density_dbc_per_hz=-100, offset_hz=2e5, slope_db_per_decade=slope_db_per_decade
    )  # fmt: skip
    phase = np.angle(only(np.ones((200_000, 6), np.complex64), spec, RANGING)).astype(np.float64)
    range_m = RANGING.range_axis_m()
    assert range_m[-1] > 240  # 1 / delay is near f_p / 2, so that sin^2 is far from its argument's square
    f_hz, found = signal.welch(phase, fs=1e6, nperseg=2000, axis=0)
    used = (f_hz > 1e4) & (f_hz < 4.8e5)
    oscillator = 2 * 10**-10 * (f_hz[used] / 2e5) ** (slope_db_per_decade / 10)
    for column in range(1, 6):
        wanted = oscillator * 4 * np.sin(2 * np.pi * f_hz[used] * range_m[column] / C) ** 2
        np.testing.assert_allclose(found[used, column], wanted, rtol=0.35, atol=wanted.max() * 1e-3)
        assert found[used, column].sum() == pytest.approx(wanted.sum(), rel=0.01)
    assert np.abs(phase[:, 0]).max() < 1e-6  # no delay, no phase


@pytest.mark.parametrize(("prf_hz", "farthest_m"), [(1000.0, 10.0), (20_000.0, 3000.0)])
def test_oscillator_phase_at_all_ranges_is_the_literal_filter(prf_hz, farthest_m):
    n_frames, spec = 400, PhaseNoise(density_dbc_per_hz=-60.0, slope_db_per_decade=0.0)
    radar = Radar(
        carrier_hz=7e9, prf_hz=prf_hz, sample_rate_hz=2e9, bandwidth_hz=1e9, range_stop_m=farthest_m, decimation=99
    )
    residual_rad, weights = residual_phase_rad(n_frames, spec, radar=radar, rng=np.random.default_rng(5))
    rng, length = np.random.default_rng(5), 2 * n_frames
    f_hz = np.arange(n_frames + 1) * prf_hz / length
    density = 2.0 * 10.0 ** (-60.0 / 10.0)
    parts = rng.standard_normal((2, n_frames))
    spectrum = (parts[0] + 1j * parts[1]) * np.sqrt(density * prf_hz * length) / 2.0
    delay_s = 2.0 * radar.range_axis_m() / C
    seen = np.append(0.0, spectrum) * (1.0 - np.exp(-2j * np.pi * f_hz * delay_s[:, None]))
    literal_rad = np.fft.irfft(seen, n=length)[:, :n_frames]
    assert len(residual_rad) < 12
    error = np.abs(weights @ residual_rad - literal_rad).max(axis=1)
    assert (error <= 1e-8 * literal_rad.std(axis=1)).all()


@pytest.mark.parametrize("delay_m", [0.0, 0.7, 4.2])
def test_leakage_is_a_static_echo_of_the_level(delay_m):
    out = only(zeros(3), Leakage(delay_m=delay_m, level_db=-40.0))
    assert np.ptp(out, axis=0).max() == 0
    sigma_m = X4.sigma_s * C / 2
    wanted = 0.01 * np.exp(-((X4.range_axis_m() - delay_m) ** 2) / (2 * sigma_m**2))
    np.testing.assert_allclose(np.abs(out[0]), wanted, atol=1e-6)
    peak = int(np.argmax(np.abs(out[0])))
    turn = np.exp(-4j * np.pi * delay_m / X4.wavelength_m)
    assert abs(out[0, peak] / abs(out[0, peak]) - turn) < 1e-3


def test_leakage_from_isolation_and_in_units():
    by_isolation = only(zeros(1), Leakage(delay_m=0.0, isolation_db=50.0, phase_deg=90.0))
    # 0 dBm is sqrt(2 50 1e-3) V; 10 dB receiver gain
    np.testing.assert_allclose(by_isolation[0, 0], 1j * math.sqrt(0.1) * 10**-2.0, rtol=1e-4)
    in_units = only(zeros(1), Leakage(delay_m=0.0, level_db=-24.4, in_units=True))
    assert abs(in_units[0, 0]) == pytest.approx(0.4 * 10**-1.22, rel=1e-4)


def test_leakage_of_a_sweep_is_a_tone_of_the_level():
    delay_m = float(FMCW.range_axis_m()[10])
    out = np.abs(bins(only(zeros(2, FMCW), Leakage(delay_m=delay_m, level_db=-40.0), FMCW), FMCW))
    assert out[0].argmax() == 10
    assert out[0].max() == pytest.approx(0.01, rel=0.01)


N_ROOMS = 250


def rooms(spec, radar):
    values = [bins(only(zeros(1, radar), spec, radar, seed), radar)[0] for seed in range(N_ROOMS)]
    return np.array(values)


@pytest.mark.parametrize("radar", [X4, FMCW, CW], ids=lambda radar: radar.waveform.kind)
def test_clutter_has_the_profile_asked_for(radar):
    levels = ((2.0, -60.0), (6.0, -70.0))
    values = rooms(StaticClutter(levels=levels), radar)
    found_db = db(power(values, axis=0))
    if radar is CW:  # one sum over all ranges
        range_m = np.linspace(0, 9, 9001)
        wanted_db = db(np.mean(10 ** (np.interp(range_m, [2, 6], [-60, -70]) / 10)))
    else:
        wanted_db = np.interp(radar.range_axis_m(), [2, 6], [-60, -70])
    # |y|^2 is exponential: relative error 1 / sqrt(n) per bin, 5 of it
    np.testing.assert_allclose(found_db, wanted_db, atol=5 * 4.34 / math.sqrt(N_ROOMS))
    assert np.mean(found_db - wanted_db) == pytest.approx(0, abs=0.6 if radar is CW else 0.15)
    kurtosis = np.mean(np.abs(values) ** 4, axis=0) / power(values, axis=0) ** 2
    assert kurtosis.mean() == pytest.approx(2.0, abs=0.5 if radar is CW else 0.1)  # Rayleigh
    assert np.abs(np.mean(values**2, axis=0) / power(values, axis=0)).max() < 5 / math.sqrt(N_ROOMS)  # circular


def test_clutter_by_cross_section_follows_the_radar_equation():
    found = power(rooms(StaticClutter(rcs_per_metre_m2=0.2), X4), axis=0)
    range_m = X4.range_axis_m()[20:]
    one_m2_v2 = 2 * 50 * 1e-3 * 10**0.8 * X4.wavelength_m**2 / ((4 * np.pi) ** 3 * range_m**4) * 10
    sigma_m = X4.sigma_s * C / 2
    wanted_db = db(0.2 * one_m2_v2 * sigma_m * math.sqrt(math.pi))  # the integral of exp(-r^2 / sigma^2)
    np.testing.assert_allclose(db(found[20:]), wanted_db, atol=5 * 4.34 / math.sqrt(N_ROOMS))
    assert np.mean(db(found[20:]) - wanted_db) == pytest.approx(0, abs=0.15)


def test_clutter_in_units_is_static_and_new_in_every_recording():
    spec = StaticClutter(levels=((1.0, -50.0),), in_units=True)
    one, other = only(zeros(4), spec, seed=1), only(zeros(4), spec, seed=2)
    assert np.ptp(one, axis=0).max() == 0
    assert abs(np.corrcoef(one[0], other[0])[0, 1]) < 0.5
    volts = only(zeros(4), StaticClutter(levels=((1.0, -50.0),)), seed=1)
    np.testing.assert_allclose(one, 0.4 * volts, rtol=1e-5)


def test_clutter_in_units_needs_a_unit():
    with pytest.raises(ConfigError, match="static_clutter: levels is in the sensor's own unit"):
        only(zeros(1, CW), StaticClutter(levels=((1.0, -50.0),), in_units=True), CW)


def full_scale_tone(n=65_536):
    return np.exp(2j * np.pi * 0.12345 * np.arange(n)).astype(np.complex64)[:, None]


@pytest.mark.parametrize("bits", [8, 10, 12, 14])
@pytest.mark.parametrize("backoff_db", [0.0, 12.0])
def test_signal_to_quantisation_noise_of_a_sine(bits, backoff_db):
    tone = full_scale_tone()
    error = only(tone, Adc(bits=bits, backoff_db=backoff_db), CW) - tone
    assert db(power(tone) / power(error)) == pytest.approx(6.02 * bits + 1.76 - backoff_db, abs=1.0)


def test_levels_are_whole_steps_from_minus_to_plus_full_scale():
    ramp = np.linspace(-3, 3, 601)
    samples = (ramp + 0.5j * ramp).astype(np.complex64)[:, None]
    with pytest.warns(DoppelgaitWarning, match=r"2 V full scale: 17 % of the values are clipped") as caught:
        out = only(samples, Adc(bits=3, full_scale_v=2.0), CW)[:, 0]
    assert caught[0].filename == __file__
    np.testing.assert_array_equal(np.unique(out.real), np.arange(-4, 4) * 0.5)
    assert out[300] == 0
    inside = np.abs(ramp) < 1.7
    np.testing.assert_allclose(out.real[inside], samples[inside, 0].real, atol=0.25 + 1e-6)
    assert not only(zeros(3), Adc()).any()


def test_clipping_of_one_percent_or_less_is_no_warning():
    tone = full_scale_tone(1000)
    tone[:4] *= 2
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        only(tone, Adc(full_scale_v=1.001), CW)


def test_x4_baseband_is_in_whole_counts():
    spec = X4Counts(iterations=16, pulses_per_step=5)
    count_v = 0.4 / (1024 * 16 * 5 * 306)
    samples = (np.array([[0.0, 0.4, 0.6, -2.3, 1e4 + 0.4j]]) * count_v).astype(np.complex64)
    out = only(samples, spec) / count_v
    np.testing.assert_allclose(out, [[0, 0, 1, -2, 1e4]], atol=1e-3)
    high = Radar.preset("x4", carrier_hz=8.748e9, volts_per_unit=1.0)
    count_v = 2 / (1024 * 16 * 5 * 316)
    out = only(
        np.array([[0.6j, 1.4j]], np.complex64) * np.float32(count_v), X4Counts(pulses_per_step=5, dac_step=2), high
    )
    np.testing.assert_allclose(out, [[1j * count_v, 1j * count_v]], rtol=1e-5)


@pytest.mark.parametrize("size_units", [0.03, 0.0741, 0.1, 0.3])
def test_x4_saturates_as_a_clipped_sinusoid_does(size_units):
    """RF sinusoid clipped at the threshold window: its fundamental by numerical Fourier integral."""
    limit = 152 / 2048
    fundamental = integrate.quad(
        lambda x: np.clip(size_units * np.cos(x), -limit, limit) * np.cos(x) * 2 / np.pi, 0, np.pi, limit=200
    )[0]
    sample_v = 0.4 * 0.78 * size_units * np.exp(1j)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        out = only(np.array([[sample_v]], np.complex64), X4Counts(pulses_per_step=5))[0, 0]
    assert out == pytest.approx(0.4 * 0.78 * fundamental * np.exp(1j), rel=1e-4)


def test_x4_frame_rates_of_the_user_guide():
    assert 17.0 <= x4_frame_rate_hz(X4Counts(iterations=64, pulses_per_step=87)) < 17.2
    assert x4_frame_rate_hz(X4Counts(iterations=64, pulses_per_step=88)) < 17.0
    assert x4_frame_rate_hz(X4Counts(iterations=64, pulses_per_step=5)) > 255
    assert x4_frame_rate_hz(X4Counts(iterations=64, pulses_per_step=6)) < 255


def test_x4_settings_that_cannot_be_are_told():
    with pytest.warns(DoppelgaitWarning, match=r"16 iterations of 10 pulses allow 593\.\d frames/s.*prf_hz is 1000"):
        only(zeros(1), X4Counts())
    with pytest.raises(ConfigError, match=r"carrier_hz = 2\.41e\+10 is not an X4's"):
        only(zeros(1, CW), X4Counts(), CW.model_copy(update={"volts_per_unit": 1.0}))
    with pytest.raises(ConfigError, match="x4_counts is in the sensor's own unit"):
        only(zeros(1), X4Counts(), X4.model_copy(update={"volts_per_unit": None}))


@pytest.mark.parametrize("duration_s", [1e-5, 0.02])
def test_share_of_pulses_hit_is_that_of_a_poisson_process(duration_s):
    rate_hz, n = 8.0, 200_000
    out = only(zeros(n, CW), Interference(rate_hz=rate_hz, duration_s=duration_s, level_db=-60), CW)[:, 0]
    hit = out != 0
    # a pulse is hit if a burst begins within its interval or up to a duration before
    share = 1 - math.exp(-rate_hz * (duration_s + 1 / 1000))
    n_bursts = rate_hz * n / 1000
    assert hit.mean() == pytest.approx(share, rel=5 * math.sqrt(2 / n_bursts))
    assert db(power(out[hit])) == pytest.approx(-60, abs=5 * 4.34 / math.sqrt(hit.sum()))


def test_interference_hits_one_run_of_neighbours_and_nothing_else():
    samples = np.ones((3000, 188), np.complex64)
    out = only(samples, Interference(rate_hz=50, duration_s=1e-3, level_db=-20, hit_share=0.05))
    places = [np.flatnonzero(row) for row in (out != samples)]
    hit = [place for place in places if place.size]
    assert 0.05 < len(hit) / 3000 < 0.2
    assert {place.size for place in hit} == {9}
    assert {int(np.ptp(place)) for place in hit} == {8}
    starts = np.array([place[0] for place in hit])
    assert starts.min() < 20  # anywhere in range
    assert starts.max() > 160


def test_bursts_that_began_before_the_recording_count():
    spec = Interference(rate_hz=5.0, duration_s=0.05)
    hit = np.array([only(zeros(5, CW), spec, CW, seed)[:, 0] != 0 for seed in range(2000)])
    share = 1 - math.exp(-5.0 * (0.05 + 1 / 1000))
    np.testing.assert_allclose(hit.mean(axis=0), share, atol=5 * math.sqrt(share * (1 - share) / 2000))
