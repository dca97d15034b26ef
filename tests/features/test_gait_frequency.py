"""Step or stride, exact frequency and confidence of f_mu: drawn signatures whose answer is known by construction."""

from __future__ import annotations

import numpy as np
import pytest

from doppelgait.core.kernels.periodicity import add_between
from doppelgait.core.labels import NORMALISED_SIGNATURE, make_array
from doppelgait.features.gait_frequency import (
    GaitFrequency,
    decide,
    gait_frequency,
    near_lag,
    power_spectrum,
    refine_on_harmonics,
    settle,
)
from doppelgait.features.limbs import Rows, grouped, limb_rows, slowed, torso_line_hz
from doppelgait.features.measures import square_difference
from doppelgait.processing import cadence_map, cadence_spectrum, detrend, detrend_order

RATE_HZ, N_DOPPLER, PRF_HZ = 125.0, 128, 1000.0
WAVELENGTH_M = 0.0411
DOPPLER_HZ = (np.arange(N_DOPPLER) - N_DOPPLER // 2) * PRF_HZ / N_DOPPLER


def drawn(*, stride_hz, alike, seconds=5.0, sway_hz=18.0, noise=0.0, torso=1.0, at_hz=60.0, seed=0):
    """Normalised signature and excess of a torso that sways once a stride and two limbs, half a stride apart or not.

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


def first_estimate(normalised):
    rows = detrend(normalised, order=detrend_order(normalised.sizes["time"] / RATE_HZ))
    spectrum = cadence_spectrum(cadence_map(rows))
    return gait_frequency(spectrum, rows), spectrum


def estimate(noise=0.0, **kwargs):
    normalised, excess = drawn(noise=noise, **kwargs)
    first, spectrum = first_estimate(normalised)
    return first, settle(first, spectrum, normalised, excess, noise)


# --- Step or stride -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("stride_hz", [0.8, 1.05, 1.6, 2.3])
@pytest.mark.parametrize("seconds", [3.0, 5.0, 8.0])
def test_a_trunk_that_sways_once_a_stride_does_not_hide_the_steps(stride_hz, seconds):
    first, found = estimate(stride_hz=stride_hz, alike=True, seconds=seconds)
    assert first.frequency_hz == pytest.approx(stride_hz, rel=0.04), "the sway is the strongest repetition"
    assert found.frequency_hz == pytest.approx(2 * stride_hz, rel=0.01)
    assert found.decision == "doubled"
    assert found.n_periods == pytest.approx(2 * stride_hz * seconds, rel=0.01)


@pytest.mark.parametrize("stride_hz", [1.6, 2.3, 3.1])
@pytest.mark.parametrize("sway_hz", [0.0, 18.0])
def test_limbs_that_swing_together_keep_the_stride(stride_hz, sway_hz):
    _, found = estimate(stride_hz=stride_hz, alike=False, sway_hz=sway_hz)
    assert found.frequency_hz == pytest.approx(stride_hz, rel=0.01)
    assert found.decision == "as_found"


@pytest.mark.parametrize("stride_hz", [0.9, 1.7])
def test_steps_that_are_already_the_strongest_are_kept(stride_hz):
    _, found = estimate(stride_hz=stride_hz, alike=True, sway_hz=0.0)
    assert found.frequency_hz == pytest.approx(2 * stride_hz, rel=0.01)
    assert found.decision == "as_found"


def test_the_decision_holds_in_noise_and_says_how_clear_it_is():
    clean = estimate(stride_hz=1.05, alike=True)[1]
    noisy = [estimate(stride_hz=1.05, alike=True, noise=0.1, seed=seed)[1] for seed in range(5)]
    for found in noisy:  # the torso is 10 dB, a limb 2 dB above the noise floor
        assert found.frequency_hz == pytest.approx(2.1, rel=0.02)
        assert found.decision == "doubled"
        assert 0.0 < found.margin <= 1.0
    assert np.mean([found.confidence for found in noisy]) < clean.confidence


def test_the_candidates_are_half_once_and_twice_with_the_steps_ahead():
    _, found = estimate(stride_hz=1.05, alike=True)
    frequencies = [one.frequency_hz for one in found.candidates]
    assert frequencies == pytest.approx([0.525, 1.05, 2.1], rel=0.03)
    assert max(found.candidates, key=lambda one: one.score).frequency_hz == pytest.approx(2.1, rel=0.03)


def test_a_torso_without_limbs_decides_nothing():
    normalised, excess = drawn(stride_hz=1.0, alike=True, sway_hz=5.0)
    lone = normalised.copy(data=np.where(np.abs(DOPPLER_HZ - 60.0) < 20.0, normalised.values, 0.0))
    first, spectrum = first_estimate(lone)
    found = settle(first, spectrum, lone, excess.copy(data=lone.values), 0.05)
    assert found.decision == "no_limbs"
    assert found.frequency_hz == pytest.approx(first.frequency_hz, rel=0.05)


def test_without_a_first_estimate_there_is_none():
    normalised, excess = drawn(stride_hz=1.0, alike=True)
    nothing = GaitFrequency()
    assert settle(nothing, first_estimate(normalised)[1], normalised, excess, 0.0) is nothing


@pytest.mark.parametrize(("sign", "code", "hz"), [(1.0, "doubled", 4.0), (-1.0, "as_found", 2.0)])
def test_the_sign_at_half_a_period_decides(sign, code, hz):
    rate_hz, lag = 40.0, np.arange(200) / 40.0
    autocorrelation = 0.4 * np.cos(2 * np.pi * 2.0 * lag) + 0.5 * sign * np.cos(2 * np.pi * 4.0 * lag) * (sign > 0)
    found = decide(2.0, autocorrelation, rate_hz)
    assert (found.code, found.frequency_hz) == (code, pytest.approx(hz))
    # by hand: n(0.25 s) = -0.4 + 0.5 or -0.4 give or take the 5 % search; n(0.5 s) = 0.9 or 0.4
    assert found.half_period == pytest.approx(0.1 if sign > 0 else -0.4, abs=0.03)
    assert found.one_period == pytest.approx(0.9 if sign > 0 else 0.4, abs=0.02)


def test_twice_a_frequency_is_not_taken_beyond_the_search_band():
    autocorrelation = np.ones(100)
    assert decide(4.5, autocorrelation, 40.0).code == "as_found"
    assert decide(3.9, autocorrelation, 40.0).code == "doubled"


def test_a_record_shorter_than_half_a_period_is_not_decided():
    assert decide(0.5, np.ones(30), 40.0).code == "no_limbs"
    assert near_lag(np.ones(30), 29.5) is None


# --- Limbs relative to the torso ----------------------------------------------------------------------------------


@pytest.mark.parametrize("at_hz", [-130.0, 0.0, 60.0])
def test_the_torso_line_follows_the_torso(at_hz):
    normalised, _ = drawn(stride_hz=0.5, alike=True, at_hz=at_hz, torso=20.0)
    slow = slowed(normalised)
    t = (np.arange(slow.values.shape[0]) + 1 / 3) * 3 / RATE_HZ
    # a Gaussian of sd s takes exp(-(2 pi f s)^2 / 2) of a sine: 0.982 at 0.5 Hz and 60 ms
    wanted = at_hz + 0.982 * 18.0 * np.cos(2 * np.pi * 0.5 * t + 0.7)
    np.testing.assert_allclose(torso_line_hz(slow)[10:-10], wanted[10:-10], atol=0.8)


def test_limb_rows_leave_out_the_torso_and_noise():
    normalised, _ = drawn(stride_hz=1.0, alike=True, sway_hz=0.0)
    slow = slowed(normalised)
    clean = limb_rows(slow, np.zeros(slow.values.shape[0]))
    assert clean.rate_hz == pytest.approx(RATE_HZ / 3)
    assert np.abs(clean.doppler_hz).min() > 30.0
    assert (clean.values**2).sum(axis=0).max() > 0
    # no cell stands above noise as strong as the strongest limb cell
    assert not limb_rows(slow, np.full(slow.values.shape[0], 1.0)).values.any()


def test_one_standard_deviation_of_noise_is_taken_off_every_limb_cell():
    values = np.zeros((200, N_DOPPLER))
    values[:, N_DOPPLER // 2] = 1.0  # a torso that stands still
    values[::2, N_DOPPLER // 2 + 20] = 0.1
    still = Rows(values, DOPPLER_HZ, 40.0)
    full, cleaned = (np.ptp(limb_rows(still, np.full(200, noise)).values[80:120]) for noise in (0.0, 0.02))
    assert full == pytest.approx(np.sqrt(0.1), rel=0.01)  # away from the ends, which the polynomial bends
    assert cleaned == pytest.approx(np.sqrt(0.08), rel=0.01)


def test_groups_are_sums_and_drop_the_rest():
    np.testing.assert_array_equal(grouped(np.arange(8.0), 3), [3.0, 12.0])
    np.testing.assert_array_equal(grouped(np.arange(8.0).reshape(4, 2), 2), [[2, 4], [10, 12]])


# --- Exact frequency ----------------------------------------------------------------------------------------------


def test_the_power_spectrum_is_that_of_the_rows():
    values = np.random.default_rng(2).standard_normal((150, 7))
    frequency_hz, power = power_spectrum(Rows(values, np.arange(7.0), 50.0))
    literal = [sum(abs(v @ np.exp(-2j * np.pi * f * np.arange(150) / 50.0)) ** 2 for v in values.T) for f in (1.3, 7.0)]
    found = np.interp([1.3, 7.0], frequency_hz, power)
    np.testing.assert_allclose(found, literal, rtol=0.03)  # between bins of an eighth of 1 / T_o
    place = 211
    exact = sum(abs(v @ np.exp(-2j * np.pi * frequency_hz[place] * np.arange(150) / 50.0)) ** 2 for v in values.T)
    assert power[place] == pytest.approx(exact, rel=1e-9)


def test_a_parabola_is_met_between_its_samples():
    x = np.arange(30.0)
    place, found = np.array([3.25, 8.5, 20.9, 11.0]), np.ones(4)
    add_between(3.0 - 0.1 * (x - 7.3) ** 2, place, 0.5, found)
    np.testing.assert_allclose(found, 1.0 + 0.5 * (3.0 - 0.1 * (place - 7.3) ** 2))


@pytest.mark.parametrize("frequency_hz", [0.93, 1.87, 3.3])
def test_harmonics_make_the_frequency_exact(frequency_hz):
    t = np.arange(200) / 40.0
    wave = sum(np.cos(2 * np.pi * h * frequency_hz * t + h) / h for h in range(1, 5))
    noise = np.random.default_rng(3).standard_normal((200, 12))
    values = np.outer(wave, np.ones(12)) + noise
    one, _ = refine_on_harmonics(frequency_hz * 1.03, [power_spectrum(Rows(values, np.arange(12.0), 40.0))])
    assert one == pytest.approx(frequency_hz, rel=0.004)


def test_the_width_shrinks_with_the_time_observed():
    def width(seconds):
        t = np.arange(round(40 * seconds)) / 40.0
        rows = Rows(np.cos(2 * np.pi * 1.9 * t)[:, None] * np.ones((1, 4)), np.arange(4.0), 40.0)
        return refine_on_harmonics(1.9, [power_spectrum(rows)])[1]

    # both tapered: a line's width goes with 1 / T_o
    assert width(5.0) / width(8.0) == pytest.approx(1.6, rel=0.15)


def test_a_frequency_outside_the_search_stays():
    t = np.arange(200) / 40.0
    spectrum = power_spectrum(Rows(np.cos(2 * np.pi * 2.5 * t)[:, None], np.arange(1.0), 40.0))
    found, width_hz = refine_on_harmonics(2.3, [spectrum])
    assert found == 2.3
    assert np.isnan(width_hz)


def test_square_difference_of_a_cosine_is_its_own_cosine():
    t = np.arange(400) / 40.0
    values = np.stack([np.cos(2 * np.pi * 2 * t), np.sin(2 * np.pi * 2 * t)], axis=1)
    np.testing.assert_allclose(square_difference(values), np.cos(2 * np.pi * 2 * t), atol=1e-9)


# --- Limbs that repeat while the body as a whole does not ----------------------------------------------------------


@pytest.mark.parametrize(("periodicity", "by_limbs"), [(0.2, True), (0.39, True), (0.41, False), (0.8, False)])
@pytest.mark.parametrize("wrong", [0.27, 0.62, 1.4])
def test_limbs_replace_a_strongest_line_that_does_not_repeat(wrong, periodicity, by_limbs):
    normalised, excess = drawn(stride_hz=1.35, alike=True)
    _, spectrum = first_estimate(normalised)
    wrong_hz = wrong * 2.7
    first = GaitFrequency(frequency_hz=wrong_hz, periodicity=periodicity, n_periods=5 * wrong_hz)
    found = settle(first, spectrum, normalised, excess, 0.0)
    assert (found.decision == "limbs") == by_limbs
    assert (abs(found.frequency_hz / 2.7 - 1) < 0.02) == by_limbs


def test_limbs_that_are_noise_replace_nothing():
    normalised, excess = drawn(stride_hz=1.35, alike=True, noise=0.05, torso=1.0)
    blank = np.abs(DOPPLER_HZ - 60.0) > 45.0
    noise = np.random.default_rng(3).gamma(32.0, 1 / 32.0, (normalised.sizes["time"], int(blank.sum())))
    excess.values[:, blank] = 0.05 * (noise - 1.0)
    normalised.values[:, blank] = np.maximum(excess.values[:, blank], 0.0)
    _, spectrum = first_estimate(normalised)
    first = GaitFrequency(frequency_hz=1.0, periodicity=0.1, n_periods=5.0)
    assert settle(first, spectrum, normalised, excess, 0.05).decision != "limbs"
