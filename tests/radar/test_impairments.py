"""Impairments: declaration, order and streams, and every one against its closed form."""

import math
import warnings
from typing import Literal

import numpy as np
import pytest
from scipy import integrate, signal

from doppelgait.core.config import FrozenModel
from doppelgait.core.errors import AnalysisError, ConfigError, DoppelgaitWarning
from doppelgait.radar import Radar
from doppelgait.radar import impairments as impair
from doppelgait.radar.impairments.receiver import residual_phase_rad

C = 299_792_458.0

X4 = Radar.preset("x4", volts_per_unit=0.4)
RADARS = {
    "impulse": X4,
    "rectangular": Radar(
        waveform="rectangular", carrier_hz=10e9, prf_hz=1000, sample_rate_hz=1e9, range_stop_m=9, sweep_s=4e-9
    ),
    "lfm": Radar(
        waveform="lfm", carrier_hz=10e9, prf_hz=1000, sample_rate_hz=1e9, range_stop_m=9, sweep_s=1e-6, bandwidth_hz=4e8
    ),
    "fmcw": Radar(
        waveform="fmcw", carrier_hz=60e9, prf_hz=1000, sample_rate_hz=2e6, range_stop_m=9, sweep_s=64e-6,
        bandwidth_hz=1e9,
    ),
    "stepped": Radar(
        waveform="stepped", carrier_hz=6e9, prf_hz=100, sample_rate_hz=2e4, range_stop_m=9, sweep_s=5e-3,
        bandwidth_hz=1e9,
    ),
    "cw": Radar(waveform="cw", carrier_hz=24.1e9, prf_hz=1000, sample_rate_hz=3000, range_stop_m=9),
}  # fmt: skip
CW = RADARS["cw"]
FMCW = Radar.model_validate({**RADARS["fmcw"].model_dump(), "range_start_m": 1})
AVERAGING = Radar.preset("x4", threshold_step_v=None, noise_bandwidth_hz=None, noise_correlation=())


def random_samples(shape, seed=3):
    rng = np.random.default_rng(seed)
    return (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)).astype(np.complex64)


def only(samples, spec, radar=X4, seed=1):
    return impaired(samples, [spec], radar=radar, seed=seed)


def impaired(samples, specs, radar=X4, seed=7):
    return impair.apply_impairments(samples, specs, radar=radar, rng=np.random.default_rng(seed)).matrix


def zeros(n_pulses, radar=X4):
    return np.zeros((n_pulses, radar.waveform.n_samples(radar)), np.complex64)


def bins(samples, radar):
    return radar.waveform.compress(samples, radar)


def power(values, **kwargs):
    return np.mean(np.abs(values).astype(np.float64) ** 2, **kwargs)


def db(ratio):
    return 10 * np.log10(ratio)


class Hum(FrozenModel):
    kind: Literal["hum"] = "hum"


@pytest.mark.parametrize(
    ("returned", "text"),
    [
        (lambda samples: None, "returns nothing; it must return the samples"),
        (lambda samples: samples.matrix[0], r": receiver samples must be complex, .*, not complex64 of shape \(5,\)"),
        (lambda samples: [[1j, 2j], [3j]], ": .*inhomogeneous"),
        (lambda samples: samples.matrix[1:], r"returns samples of shape \(3, 5\) instead of \(4, 5\)"),
    ],
)
def test_an_impairment_of_a_plugin_that_returns_no_samples_is_named(register, returned, text):
    register("impairment", parameters=Hum)(lambda samples, parameters, radar, rng: returned(samples))
    with pytest.raises(AnalysisError, match=f"^impairment 'hum' of tests ?{text}"):
        only(random_samples((4, 5)), Hum())


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"kind": "echo"}, r"kind 'echo' is not allowed: known are adc, coloured_noise, dc_leak"),
        (X4, "unknown impairment 'None'"),
        ({"kind": "coloured_noise", "levels": [[10, -60], [5, -70]]}, "must rise"),
        ({"kind": "dropped_frames"}, "exactly one of probability and frames"),
        ({"kind": "dropped_frames", "probability": 0.8, "mean_length": 2}, r"0\.8 needs longer bursts.*0\.6667"),
        ({"kind": "dropped_frames", "frames": [-1]}, "counted from 0; -1 is not allowed"),
        ({"kind": "leakage", "level_db": 0, "isolation_db": 3}, "level_db or isolation_db, not both"),
        ({"kind": "static_clutter", "levels": [[3, -50], [2, -60]]}, "entry to entry, but 2 follows 3"),
        ({"kind": "x4_counts", "dac_max": 900}, "dac_max 900 must be larger than dac_min 949"),
    ],
)
def test_impairments_that_cannot_be_are_refused(table, message):
    with pytest.raises(ConfigError, match=message):
        impair.make_impairment(table)


def test_samples_of_another_shape_or_type_are_refused():
    with pytest.raises(AnalysisError, match="must be complex"):
        only(np.zeros((3, 188)), impair.Adc())
    for spec in (impair.Leakage(), impair.StaticClutter(rcs_per_metre_m2=1), impair.PhaseNoise(density_dbc_per_hz=-80)):
        with pytest.raises(AnalysisError, match="has 188 samples, but these have 5"):
            only(np.zeros((3, 5), np.complex64), spec)


def test_jitter_moves_the_pulses_and_not_the_samples():
    nominal = np.arange(20_000) / X4.prf_hz
    specs = [impair.IqImbalance(), impair.FrameJitter(sd_s=3e-5), impair.FrameJitter(sd_s=4e-5)]
    times = impair.shift_pulse_times(nominal, specs, radar=X4, rng=np.random.default_rng(2))
    error = (times - nominal)[1:-1]
    assert error.std() == pytest.approx(5e-5, rel=0.03)  # 3-4-5: independent errors
    assert abs(error.mean()) < 4 * 5e-5 / math.sqrt(error.size)
    for seed in range(5):  # else one of them would leave it at either end
        ends = impair.shift_pulse_times(nominal[:9], specs, radar=X4, rng=np.random.default_rng(seed))
        assert ends[0] >= nominal[0]
        assert ends[-1] <= nominal[8]
    again = impair.shift_pulse_times(nominal, specs, radar=X4, rng=np.random.default_rng(2))
    np.testing.assert_array_equal(times, again)
    np.testing.assert_array_equal(
        impair.shift_pulse_times(nominal, [impair.Adc()], radar=X4, rng=np.random.default_rng(2)), nominal
    )

    with pytest.raises(ConfigError, match=r"sd_s = 0\.001.*prf_hz = 1000.*0\.0001 s"):
        impair.shift_pulse_times(
            np.arange(3) / 1000, [impair.FrameJitter(sd_s=1e-3)], radar=X4, rng=np.random.default_rng(2)
        )


@pytest.mark.parametrize(("probability", "mean_length"), [(0.05, 1.0), (0.2, 5.0), (0.6, 20.0)])
def test_lost_frames_have_the_share_and_the_length_asked_for(probability, mean_length):
    n = 400_000
    samples = np.ones((n, 1), np.complex64)
    spec = impair.DroppedFrames(probability=probability, mean_length=mean_length, fill="zero")
    lost = only(samples, spec, CW)[:, 0] == 0
    begins = np.count_nonzero(np.diff(lost.astype(int)) == 1)
    # runs are independent, so that the share's error is that of their number
    tolerance = 5 * probability * math.sqrt(2 * mean_length / (n * probability))
    assert lost.mean() == pytest.approx(probability, abs=tolerance)
    assert lost.sum() / begins == pytest.approx(mean_length, rel=5 / math.sqrt(begins) + 1e-4)


def test_lost_frames_repeat_the_last_that_arrived():
    samples = random_samples((10, 188))
    out = only(samples, impair.DroppedFrames(frames=(0, 1, 4, 7, 8, 9)))
    wanted = [2, 2, 2, 3, 3, 5, 6, 6, 6, 6]
    np.testing.assert_array_equal(out, samples[wanted])
    zeros = only(samples, impair.DroppedFrames(frames=(3,), fill="zero"))
    assert not zeros[3].any()
    np.testing.assert_array_equal(np.delete(zeros, 3, 0), np.delete(samples, 3, 0))
    assert not only(samples, impair.DroppedFrames(frames=tuple(range(10)))).any()
    with pytest.raises(ConfigError, match="frame 10 is not in a recording of 10 frames"):
        only(samples, impair.DroppedFrames(frames=(10,)))


def test_quadrature_channel_has_the_gain_and_angle_and_the_other_is_untouched():
    samples = random_samples((20, 188))
    out = only(samples, impair.IqImbalance(gain_db=2.0, phase_deg=10.0))
    np.testing.assert_allclose(out.real, samples.real, atol=1e-6)
    turn = math.radians(10.0)
    channel = 10**0.1 * (samples.imag * math.cos(turn) + samples.real * math.sin(turn))
    np.testing.assert_allclose(out.imag, channel, atol=1e-6)


def test_leak_is_a_constant_of_the_level_and_phase():
    out = only(zeros(5), impair.DcLeak(level_db=-40.0, phase_deg=90.0, walk_per_sqrt_min=0.0))
    np.testing.assert_allclose(out, 0.01j, atol=1e-8)
    units = only(zeros(1), impair.DcLeak(level_db=0.0, in_units=True, phase_deg=0.0))
    np.testing.assert_allclose(units, 0.4, rtol=1e-6)


def test_leak_walks_as_far_in_a_minute_as_asked():
    radar = CW.model_copy(update={"prf_hz": 10.0})
    spec = impair.DcLeak(level_db=0.0, phase_deg=0.0, walk_per_sqrt_min=0.3)
    zero = np.zeros((601, 1), np.complex64)
    ends = np.array([only(zero, spec, radar, seed)[[0, 300, 600], 0] for seed in range(1500)])
    np.testing.assert_allclose(ends[:, 0], 1.0)
    powers = np.mean(np.abs(ends - 1.0) ** 2, axis=0)
    assert powers[2] == pytest.approx(0.09, rel=0.12)
    assert powers[1] == pytest.approx(0.045, rel=0.12)
    walk = ends[:, 2] - 1.0
    assert abs(np.mean(walk**2)) < 0.012  # circular


def test_other_noise_figure_and_level():
    own, other = (only(zeros(100), impair.ThermalNoise(noise_figure_db=figure), AVERAGING) for figure in (6.0, 9.0))
    np.testing.assert_array_equal(own, only(zeros(100), impair.ThermalNoise(), AVERAGING))
    np.testing.assert_allclose(other, own * 10**0.15, rtol=1e-5, atol=0)
    units = only(zeros(1000), impair.ThermalNoise(level_db=-105.0, in_units=True))
    assert db(power(units)) == pytest.approx(-105 + 20 * math.log10(0.4), abs=0.05)


@pytest.mark.parametrize("spec", [impair.ThermalNoise(level_db=-80.0), impair.ColouredNoise(levels=((0.0, -80.0),))])
@pytest.mark.parametrize("radar", [FMCW, Radar.preset("ti-77")])
def test_level_is_that_of_a_range_bin_whatever_the_waveform(spec, radar):
    noise = only(zeros(2000, radar), spec, radar)
    assert power(bins(noise, radar)) == pytest.approx(1e-8, rel=0.02)
    assert power(noise) > 1e-7  # compression averages


@pytest.mark.parametrize("sigma_rad", [0.03, 0.3])
def test_residue_of_static_clutter_is_the_phase_s_variance(sigma_rad):
    clutter = np.full((40_000, 1), 0.5j, np.complex64)
    turned = only(clutter, impair.PhaseNoise(white_rad=sigma_rad), CW)
    residue = power(turned - turned.mean(axis=0)) / 0.25
    assert residue == pytest.approx(1 - math.exp(-(sigma_rad**2)), rel=0.04)
    np.testing.assert_allclose(np.abs(turned), 0.5, rtol=1e-5)


def test_linear_drift_has_its_rate_and_starts_at_zero():
    radar = CW.model_copy(update={"prf_hz": 10.0})
    turned = only(np.ones((601, 1), np.complex64), impair.PhaseNoise(white_rad=0, drift_rad_per_min=0.7), radar)
    np.testing.assert_allclose(np.angle(turned[:, 0]), 0.7 * np.arange(601) / 600, atol=1e-6)


def test_walk_spreads_as_the_root_of_time():
    radar = CW.model_copy(update={"prf_hz": 10.0})
    spec = impair.PhaseNoise(white_rad=0, walk_rad_per_sqrt_min=0.2)
    one = np.ones((601, 1), np.complex64)
    phase = np.array([np.angle(only(one, spec, radar, seed)[[0, 150, 600], 0]) for seed in range(1500)])
    assert not phase[:, 0].any()
    np.testing.assert_allclose(phase.std(axis=0)[1:], [0.1, 0.2], rtol=0.08)


RANGING = Radar(carrier_hz=1e9, prf_hz=1e6, sample_rate_hz=3e6, range_stop_m=299, pulse_sigma_s=1e-7, fold_echoes=False)


@pytest.mark.parametrize("slope_db_per_decade", [0.0, -30.0])
def test_oscillator_noise_has_the_density_of_range_correlation(slope_db_per_decade):
    spec = impair.PhaseNoise(
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
    n_frames, spec = 400, impair.PhaseNoise(density_dbc_per_hz=-60.0, slope_db_per_decade=0.0)
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
    out = only(zeros(3), impair.Leakage(delay_m=delay_m, level_db=-40.0))
    assert np.ptp(out, axis=0).max() == 0
    sigma_m = X4.sigma_s * C / 2
    wanted = 0.01 * np.exp(-((X4.range_axis_m() - delay_m) ** 2) / (2 * sigma_m**2))
    np.testing.assert_allclose(np.abs(out[0]), wanted, atol=1e-6)
    peak = int(np.argmax(np.abs(out[0])))
    turn = np.exp(-4j * np.pi * delay_m / X4.wavelength_m)
    assert abs(out[0, peak] / abs(out[0, peak]) - turn) < 1e-3


def test_leakage_from_isolation_and_in_units():
    by_isolation = only(zeros(1), impair.Leakage(delay_m=0.0, isolation_db=50.0, phase_deg=90.0))
    # 0 dBm is sqrt(2 50 1e-3) V; 10 dB receiver gain
    np.testing.assert_allclose(by_isolation[0, 0], 1j * math.sqrt(0.1) * 10**-2.0, rtol=1e-4)
    in_units = only(zeros(1), impair.Leakage(delay_m=0.0, level_db=-24.4, in_units=True))
    assert abs(in_units[0, 0]) == pytest.approx(0.4 * 10**-1.22, rel=1e-4)


N_ROOMS = 250


def rooms(spec, radar):
    values = [bins(only(zeros(1, radar), spec, radar, seed), radar)[0] for seed in range(N_ROOMS)]
    return np.array(values)


@pytest.mark.parametrize("radar", [X4, FMCW, CW], ids=lambda radar: radar.waveform.kind)
def test_clutter_has_the_profile_asked_for(radar):
    levels = ((2.0, -60.0), (6.0, -70.0))
    values = rooms(impair.StaticClutter(levels=levels), radar)
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
    found = power(rooms(impair.StaticClutter(rcs_per_metre_m2=0.2), X4), axis=0)
    range_m = X4.range_axis_m()[20:]
    one_m2_v2 = 2 * 50 * 1e-3 * 10**0.8 * X4.wavelength_m**2 / ((4 * np.pi) ** 3 * range_m**4) * 10
    sigma_m = X4.sigma_s * C / 2
    wanted_db = db(0.2 * one_m2_v2 * sigma_m * math.sqrt(math.pi))  # the integral of exp(-r^2 / sigma^2)
    np.testing.assert_allclose(db(found[20:]), wanted_db, atol=5 * 4.34 / math.sqrt(N_ROOMS))
    assert np.mean(db(found[20:]) - wanted_db) == pytest.approx(0, abs=0.15)


def test_clutter_in_units_is_that_in_volts_times_the_unit():
    levels = ((1.0, -50.0),)
    units, volts = (only(zeros(4), impair.StaticClutter(levels=levels, in_units=own)) for own in (True, False))
    np.testing.assert_allclose(units, 0.4 * volts, rtol=1e-5)


@pytest.mark.parametrize(
    ("spec", "said"),
    [
        (impair.DcLeak(in_units=True), "dc_leak: level_db is in the sensor's own unit.*volts_per_unit"),
        (
            impair.StaticClutter(levels=((1.0, -50.0),), in_units=True),
            "static_clutter: levels is in the sensor's own unit",
        ),
        (impair.X4Counts(), "x4_counts is in the sensor's own unit"),
    ],
)
def test_levels_in_units_need_a_unit(spec, said):
    with pytest.raises(ConfigError, match=said):
        only(zeros(1), spec, X4.model_copy(update={"volts_per_unit": None}))


def test_levels_are_whole_steps_from_minus_to_plus_full_scale():
    ramp = np.linspace(-3, 3, 601)
    samples = (ramp + 0.5j * ramp).astype(np.complex64)[:, None]
    with pytest.warns(DoppelgaitWarning, match=r"2 V full scale: 17 % of the values are clipped") as caught:
        out = only(samples, impair.Adc(bits=3, full_scale_v=2.0), CW)[:, 0]
    assert caught[0].filename == __file__
    np.testing.assert_array_equal(np.unique(out.real), np.arange(-4, 4) * 0.5)
    assert out[300] == 0
    inside = np.abs(ramp) < 1.7
    np.testing.assert_allclose(out.real[inside], samples[inside, 0].real, atol=0.25 + 1e-6)
    assert not only(zeros(3), impair.Adc()).any()


def test_x4_baseband_is_in_whole_counts():
    spec = impair.X4Counts(iterations=16, pulses_per_step=5)
    count_v = 0.4 / (1024 * 16 * 5 * 306)
    samples = (np.array([[0.0, 0.4, 0.6, -2.3, 1e4 + 0.4j]]) * count_v).astype(np.complex64)
    out = only(samples, spec) / count_v
    np.testing.assert_allclose(out, [[0, 0, 1, -2, 1e4]], atol=1e-3)
    high = Radar.preset("x4", carrier_hz=8.748e9, volts_per_unit=1.0)
    count_v = 2 / (1024 * 16 * 5 * 316)
    out = only(
        np.array([[0.6j, 1.4j]], np.complex64) * np.float32(count_v),
        impair.X4Counts(pulses_per_step=5, dac_step=2),
        high,
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
        out = only(np.array([[sample_v]], np.complex64), impair.X4Counts(pulses_per_step=5))[0, 0]
    assert out == pytest.approx(0.4 * 0.78 * fundamental * np.exp(1j), rel=1e-4)


def test_x4_settings_that_cannot_be_are_told():
    with pytest.warns(DoppelgaitWarning, match=r"16 iterations of 10 pulses allow 593\.\d frames/s.*prf_hz is 1000"):
        only(zeros(1), impair.X4Counts())
    with pytest.raises(ConfigError, match=r"carrier_hz = 2\.41e\+10 is not an X4's"):
        only(zeros(1, CW), impair.X4Counts(), CW.model_copy(update={"volts_per_unit": 1.0}))


@pytest.mark.parametrize("duration_s", [1e-5, 0.02])
def test_share_of_pulses_hit_is_that_of_a_poisson_process(duration_s):
    rate_hz, n = 8.0, 200_000
    out = only(zeros(n, CW), impair.Interference(rate_hz=rate_hz, duration_s=duration_s, level_db=-60), CW)[:, 0]
    hit = out != 0
    # a pulse is hit if a burst begins within its interval or up to a duration before
    share = 1 - math.exp(-rate_hz * (duration_s + 1 / 1000))
    n_bursts = rate_hz * n / 1000
    assert hit.mean() == pytest.approx(share, rel=5 * math.sqrt(2 / n_bursts))
    assert db(power(out[hit])) == pytest.approx(-60, abs=5 * 4.34 / math.sqrt(hit.sum()))


def test_interference_hits_one_run_of_neighbours_and_nothing_else():
    samples = np.ones((3000, 188), np.complex64)
    out = only(samples, impair.Interference(rate_hz=50, duration_s=1e-3, level_db=-20, hit_share=0.05))
    places = [np.flatnonzero(row) for row in (out != samples)]
    hit = [place for place in places if place.size]
    assert 0.05 < len(hit) / 3000 < 0.2
    assert {place.size for place in hit} == {9}
    assert {int(np.ptp(place)) for place in hit} == {8}
    starts = np.array([place[0] for place in hit])
    assert starts.min() < 20  # anywhere in range
    assert starts.max() > 160


def test_bursts_that_began_before_the_recording_count():
    spec = impair.Interference(rate_hz=5.0, duration_s=0.05)
    hit = np.array([only(zeros(5, CW), spec, CW, seed)[:, 0] != 0 for seed in range(2000)])
    share = 1 - math.exp(-5.0 * (0.05 + 1 / 1000))
    np.testing.assert_allclose(hit.mean(axis=0), share, atol=5 * math.sqrt(share * (1 - share) / 2000))


def test_the_density_is_that_of_white_noise_of_the_stated_level():
    spec = impair.ColouredNoise(levels=((0.0, -60.0), (100.0, -60.0), (200.0, -80.0)))
    noise = only(zeros(8192), spec)
    f_hz, density = signal.welch(noise, fs=X4.prf_hz, nperseg=512, axis=0, return_onesided=False)
    level_db = 10 * np.log10(density.mean(axis=1) * X4.prf_hz)
    for at_hz, expected in ((50, -60), (-50, -60), (150, -70), (-150, -70), (300, -80), (-400, -80)):
        assert level_db[np.argmin(np.abs(f_hz - at_hz))] == pytest.approx(expected, abs=0.4)
    both = noise[:, 3].conj() @ noise[:, 4] / np.linalg.norm(noise[:, 3]) / np.linalg.norm(noise[:, 4])
    assert abs(both) < 0.08


def test_its_end_knows_nothing_of_its_beginning():
    """A Fourier series repeats, so that the last pulses would go on in the first."""
    noise = only(zeros(1024), impair.ColouredNoise(levels=((0.0, -60.0), (5.0, -60.0), (10.0, -120.0))))
    steps = [np.mean(np.abs(noise[pulse] - noise[pulse - 1]) ** 2) for pulse in (512, 0)]  # neighbours, and both ends
    assert steps[1] > 20 * steps[0]
    both = np.abs(np.sum(noise[0].conj() * noise[-1])) / np.linalg.norm(noise[0]) / np.linalg.norm(noise[-1])
    assert both < 3 / np.sqrt(noise.shape[1])


def test_its_change_over_range():
    noise = only(zeros(4096), impair.ColouredNoise(levels=((0.0, -60.0),), range_db=((2.0, 0.0), (6.0, -20.0))))
    level_db = 10 * np.log10(np.mean(np.abs(noise) ** 2, axis=0))
    for at_m, expected in ((1.0, -60), (4.0, -70), (8.0, -80)):
        assert level_db[np.argmin(np.abs(X4.range_axis_m() - at_m))] == pytest.approx(expected, abs=0.6)


def test_a_line_has_its_frequency_and_amplitude_in_all_bins():
    line, other = (only(zeros(800), impair.Spur(frequency_hz=-125.0, level_db=-80.0), seed=seed) for seed in (1, 2))
    assert np.ptp(np.abs(line)) < 1e-9
    assert np.abs(line[0, 0]) == pytest.approx(1e-4, rel=1e-4)
    assert np.allclose(line, line[:, :1])
    assert np.angle(line[1:, 0] / line[:-1, 0]) == pytest.approx(-2 * np.pi * 125 / 1000, abs=1e-4)
    assert abs(np.angle(other[0, 0] / line[0, 0])) > 1e-3  # a phase of its own
