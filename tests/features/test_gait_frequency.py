"""Posterior, octave and exact frequency of f_mu against closed forms."""

import numpy as np
import pytest
from scipy.stats import chi2

from doppelgait._core import native
from doppelgait.core.labels import NORMALISED_SIGNATURE, Signal, make_array
from doppelgait.features import gait_frequency
from doppelgait.features.gait_frequency import Rows, average_columns, limb_rows, torso_line_hz

RATE_HZ, N_DOPPLER, PRF_HZ = 125.0, 128, 1000.0
WAVELENGTH_M = 0.0411
DOPPLER_HZ = (np.arange(N_DOPPLER) - N_DOPPLER // 2) * PRF_HZ / N_DOPPLER


def make_signature(*, stride_hz, alike, seconds=5.0, sway_hz=18.0, noise=0.0, torso=1.0, at_hz=60.0, seed=0):
    """Draw a torso that sways once a stride and two limbs.

    Every line is 14 Hz wide. A limb stands for half a stride at -40 Hz of the torso and swings up to 220 Hz above it in
    the other half. ``alike``: the second limb does the same half a stride later (f_mu is twice the stride rate); else
    both swing at once (f_mu is the stride rate).
    """
    t = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    sway = sway_hz * np.cos(2 * np.pi * stride_hz * t + 0.7)
    lines = [(at_hz + sway, torso)]
    for lag in (0.0, 0.5 if alike else 0.0):
        swing = np.sin(2 * np.pi * (stride_hz * t - lag))
        lines.append((at_hz + sway - 40.0 + 260.0 * np.maximum(swing, 0.0), 0.15))
    mu = sum(power * np.exp(-0.5 * ((DOPPLER_HZ - line[:, None]) / 6.0) ** 2) for line, power in lines)
    if noise:
        mu = mu + noise * (np.random.default_rng(seed).gamma(32.0, 1 / 32.0, mu.shape) - 1.0)
    coords = {"time": t, "doppler": DOPPLER_HZ, "velocity": ("doppler", DOPPLER_HZ * WAVELENGTH_M / 2)}
    positive = np.maximum(mu, 0.0)
    normalised = make_array(NORMALISED_SIGNATURE, positive / positive.sum(axis=1, keepdims=True), coords)
    excess = normalised.copy(data=mu)
    excess.attrs = {**normalised.attrs, "n_gate_bins": 32.0}
    return normalised, excess


def estimate(noise=0.0, velocity_mps=1.2, **kwargs):
    normalised, excess = make_signature(noise=noise, **kwargs)
    return gait_frequency.estimate_gait_frequency(normalised, excess, noise, velocity_mps=velocity_mps)


@pytest.mark.parametrize("seconds", [3.0, 5.0, 8.0])
@pytest.mark.parametrize(
    ("stride_hz", "alike", "sway_hz"),
    [(0.8, True, 18.0), (1.05, True, 18.0), (1.6, True, 18.0), (1.6, False, 0.0), (2.3, False, 18.0)],
)
def test_a_sway_hides_no_steps_and_limbs_that_swing_together_keep_the_stride(stride_hz, alike, sway_hz, seconds):
    found = estimate(stride_hz=stride_hz, alike=alike, sway_hz=sway_hz, seconds=seconds)
    assert found.frequency_hz == pytest.approx((1 + alike) * stride_hz, rel=0.01)
    assert found.n_periods == pytest.approx((1 + alike) * stride_hz * seconds, rel=0.02)


@pytest.mark.parametrize("stride_hz", [1.2, 1.7])
def test_steps_that_are_already_the_strongest_are_kept(stride_hz):
    found = estimate(stride_hz=stride_hz, alike=True, sway_hz=0.0)
    assert found.frequency_hz == pytest.approx(2 * stride_hz, rel=0.01)
    assert found.confidence > 0.9
    assert found.half_probability + found.double_probability < 0.1


def test_limbs_that_are_noise_double_nothing():
    # a torso that sways at 1 Hz with noise about it: the rows beyond it repeat at no period
    normalised, excess = make_signature(stride_hz=1.0, alike=True, noise=0.05)
    blank = np.abs(DOPPLER_HZ - 60.0) > 45.0
    for seed in range(5):
        noise = np.random.default_rng(seed).gamma(32.0, 1 / 32.0, (normalised.sizes["time"], int(blank.sum())))
        excess.values[:, blank] = 0.05 * (noise - 1.0)
        normalised.values[:, blank] = np.maximum(excess.values[:, blank], 0.0)
        found = gait_frequency.estimate_gait_frequency(normalised, excess, 0.05, velocity_mps=0.8)
        assert found.frequency_hz == pytest.approx(1.0, rel=0.02) or found.confidence < 0.9


def test_nothing_that_changes_has_no_frequency():
    normalised, excess = make_signature(stride_hz=1.0, alike=True)
    still = normalised.copy(data=np.zeros(normalised.shape))
    found = gait_frequency.estimate_gait_frequency(still, excess.copy(data=still.values), 0.0, velocity_mps=1.0)
    assert (found.frequency_hz, found.confidence, found.n_periods) == (None, None, None)


def test_a_record_of_one_period_has_none_below_its_own_rate():
    found = estimate(stride_hz=0.5, alike=True, seconds=1.0)
    assert found.frequency_hz > 1.05


def rhythms(seed=0, n_columns=150, rate_hz=40.0):
    rng = np.random.default_rng(seed)
    t = np.arange(n_columns) / rate_hz
    waves = [np.cos(2 * np.pi * 1.9 * t[:, None] + rng.uniform(0, 6, 5)) + rng.standard_normal((n_columns, 5))]
    waves.append(np.cos(2 * np.pi * 3.8 * t[:, None] + rng.uniform(0, 6, 7)) + rng.standard_normal((n_columns, 7)))
    return gait_frequency.measure_rhythms([[*waves, waves[0][:, :1]]], rate_hz)


def test_the_posterior_is_the_weighted_sum_of_its_terms():
    (found,), ((evidence,), (prior,)) = (
        f(rhythms(), np.array([-1.3])) for f in (gait_frequency.compute_posterior, gait_frequency.compute_terms)
    )
    assert found.sum() == pytest.approx(1.0)
    place = np.array([70, 120])  # ratio of two frequencies, term by term
    logs = [
        sum(gait_frequency.WEIGHTS[s, n] * evidence[s, n, p] for s in range(6) for n in range(9))
        + sum(gait_frequency.PRIOR_WEIGHTS[n] * prior[n, p] for n in range(5))
        for p in place
    ]
    assert np.log(found[70] / found[120]) == pytest.approx(logs[0] - logs[1], rel=1e-9)
    f = gait_frequency.GRID_HZ[place]
    np.testing.assert_allclose(prior[2:4, place], [np.log(1.3 / f), np.log(1.3 / f) ** 2])
    np.testing.assert_allclose(prior[4, place], np.maximum(0, np.log(3 / (f * 3.75))))
    assert not found[gait_frequency.GRID_HZ * 3.75 < 1.1].any()


@pytest.mark.parametrize("seconds", [1.4, 3.75])
def test_confidence_is_the_mass_at_the_peak_and_counts_few_periods(seconds):
    normalised, excess = make_signature(stride_hz=1.05, alike=True, noise=0.3, seconds=seconds)
    found = gait_frequency.estimate_gait_frequency(normalised, excess, 0.3, velocity_mps=1.2)
    rhythms = gait_frequency.measure_target_rhythms(
        [(Signal.of(normalised, NORMALISED_SIGNATURE), Signal.of(excess, NORMALISED_SIGNATURE), 0.3)]
    )
    mass = np.convolve(gait_frequency.compute_posterior(rhythms, np.array([1.2]))[0], np.ones(7), "same").max()
    assert found.confidence == pytest.approx(mass * chi2.cdf((0.05 / 0.4 * found.n_periods**2) ** 2, 1))
    assert mass + found.half_probability + found.double_probability <= 1.0 + 1e-9
    assert abs(np.log(found.second_hz / found.frequency_hz)) > 0.08


def literal_likeness(values, lag, counted=(1,) * 150):
    """E-33 as it stands, over the pairs of counted columns."""
    pairs = [j for j in range(len(values) - lag) if counted[j] * counted[j + lag]]
    top = sum(2 * values[j] @ values[j + lag] for j in pairs)
    return top / sum(values[j] @ values[j] + values[j + lag] @ values[j + lag] for j in pairs)


@pytest.mark.parametrize("gap", [slice(0), slice(40, 65)])
@pytest.mark.parametrize("lag", [1, 17, 80])
def test_the_plain_rhythm_is_the_square_difference(lag, gap):
    values, counted = np.random.default_rng(2).standard_normal((150, 7)), np.ones(150)
    values[gap], counted[gap] = 0.0, 0.0
    found = gait_frequency.measure_rhythms([[values]], 50.0, counted).likeness[0, 0, lag]
    assert found == pytest.approx(literal_likeness(values, lag, counted), rel=1e-9)


def test_a_gap_leaves_the_spectrum_of_the_columns_that_exist():
    wave, counted = np.cos(2 * np.pi * 1.9 * np.arange(200) / 40.0)[:, None], np.ones(200)
    counted[70:110] = 0.0
    whole, cut = (
        gait_frequency.measure_rhythms([[wave * c[:, None]]], 40.0, c).share[0, 0] for c in (np.ones(200), counted)
    )
    assert np.abs(cut - whole).max() < 0.1 * whole.max()
    assert (
        np.abs(gait_frequency.measure_rhythms([[wave * counted[:, None]]], 40.0).share[0, 0] - whole).max()
        > 0.2 * whole.max()
    )


@pytest.mark.parametrize("lag", [1, 17, 80])
def test_the_whitened_rhythm_filters_and_equalises_every_row(lag):
    values = np.random.default_rng(2).standard_normal((150, 7)) * np.arange(1, 8)
    values[[0, -1]] = 0.0  # so that the filter starts and ends within the record
    white = values.copy()
    for j in range(1, 150):
        white[j] -= 0.7 * values[j - 1]
    energy = (white**2).sum(axis=0)
    white /= np.sqrt(energy + 1e-3 * energy.max())
    assert gait_frequency.measure_rhythms([[values]], 50.0).likeness[0, 1, lag] == pytest.approx(
        literal_likeness(white, lag), rel=1e-9
    )


def test_the_spectrum_is_that_of_the_windowed_autocorrelation():
    values = np.random.default_rng(2).standard_normal((150, 3)) + np.cos(np.arange(150) / 4.0)[:, None]
    plain = gait_frequency.measure_rhythms([[values]], 50.0).take(0)
    products = [sum(v[: 150 - lag] @ v[lag:] for v in values.T) for lag in range(150)]
    window = 0.5 + 0.5 * np.cos(np.pi * np.arange(150) / 150)
    frequency_hz = np.arange(plain.share.shape[1]) * plain.step_hz
    waves = np.cos(2 * np.pi * np.outer(frequency_hz, np.arange(150)) / 50.0)
    power = np.maximum(2 * waves @ (products * window) - products[0], 0.0)
    power /= power[frequency_hz > 0.5].sum() * plain.step_hz * 150 / 50.0
    np.testing.assert_allclose(plain.share[0], power, atol=1e-9 * power.max())


def test_limb_rows_leave_out_the_torso_and_noise():
    normalised, _ = make_signature(stride_hz=1.0, alike=True, sway_hz=0.0)
    slow = average_columns(Signal.of(normalised, NORMALISED_SIGNATURE))
    clean = limb_rows(slow, np.zeros(slow.values.shape[0]), torso_line_hz(slow))
    assert clean.rate_hz == pytest.approx(RATE_HZ / 3)
    assert np.abs(clean.doppler_hz).min() > 30.0
    assert (clean.values**2).sum(axis=0).max() > 0
    # no cell stands above noise as strong as the strongest limb cell
    assert not limb_rows(slow, np.full(slow.values.shape[0], 1.0), torso_line_hz(slow)).values.any()


def test_one_standard_deviation_of_noise_is_taken_off_every_limb_cell():
    values = np.zeros((200, N_DOPPLER))
    values[:, N_DOPPLER // 2] = 1.0  # a torso that stands still
    values[::2, N_DOPPLER // 2 + 20] = 0.1
    still = Rows(values, DOPPLER_HZ, 40.0)
    line = torso_line_hz(still)
    full, cleaned = (np.ptp(limb_rows(still, np.full(200, noise), line).values[80:120]) for noise in (0.0, 0.02))
    assert full == pytest.approx(np.sqrt(0.1), rel=0.01)  # away from the ends, which the polynomial bends
    assert cleaned == pytest.approx(np.sqrt(0.08), rel=0.01)


def test_a_parabola_is_met_between_its_samples():
    x = np.arange(30.0)
    place, found = np.array([3.25, 4.5, 6.9, 8.0]), np.empty(4)
    native.sum_harmonics(3.0 - 0.1 * (x - 7.3) ** 2, place, 3, found)
    np.testing.assert_allclose(found, sum(3.0 - 0.1 * (h * place - 7.3) ** 2 for h in (1, 2, 3)))


def squares(values, frequency_hz, rate_hz, n_harmonics):
    """Energy that a least-squares fit of harmonics explains."""
    t = np.arange(len(values)) / rate_hz
    turn = 2 * np.pi * frequency_hz * np.outer(t, np.arange(1, n_harmonics + 1))
    basis = np.concatenate([np.cos(turn), np.sin(turn)], axis=1)
    return ((basis @ np.linalg.lstsq(basis, values, rcond=None)[0]) ** 2).sum()


def refine(frequency_hz, values):
    rhythm = gait_frequency.measure_rhythms([[values]], 40.0)
    return gait_frequency.refine_on_harmonics(frequency_hz, rhythm.share[0, :1], rhythm.step_hz)


@pytest.mark.parametrize("frequency_hz", [0.93, 1.87, 2.3])
def test_harmonics_make_the_frequency_that_of_least_squares(frequency_hz):
    t = np.arange(200) / 40.0
    wave = sum(np.cos(2 * np.pi * h * frequency_hz * t + h) / h for h in range(1, 5))
    values = np.outer(wave, np.ones(12)) + np.random.default_rng(3).standard_normal((200, 12))
    found = refine(frequency_hz * 1.03, values)
    trials_hz = frequency_hz * np.linspace(0.97, 1.03, 241)
    direct_hz = trials_hz[np.argmax([squares(values, trial, 40.0, 6) for trial in trials_hz])]
    assert found == pytest.approx(direct_hz, rel=0.003)
    assert found == pytest.approx(frequency_hz, rel=0.004)


def test_a_frequency_outside_the_search_stays():
    t = np.arange(200) / 40.0
    assert refine(2.3, np.cos(2 * np.pi * 2.5 * t)[:, None]) == 2.3


def test_sets_of_rows_are_measured_together_as_alone_e33():
    rng = np.random.default_rng(1)
    sets = [rng.standard_normal((90, 5)), 30.0 * rng.standard_normal((90, 3))]
    together = gait_frequency.measure_rhythms([sets], 40.0)
    for n, values in enumerate(sets):
        alone, own = gait_frequency.measure_rhythms([[values]], 40.0), slice(2 * n, 2 * n + 2)
        np.testing.assert_allclose(together.likeness[:, own], alone.likeness, atol=1e-12)
        np.testing.assert_allclose(together.share[:, own], alone.share, atol=1e-12 * alone.share.max())
