"""Clutter removal against closed forms of its filters."""

import numpy as np
import pytest

from doppelgait.core.errors import AnalysisError
from doppelgait.core.frames import Frames
from doppelgait.core.labels import BASEBAND, make_array
from doppelgait.processing import Analysis, Gate, clutter, remove_clutter
from doppelgait.processing.clutter import (
    clutter_gain,
    measure_share_removed,
    predict_torso_share_removed,
    remove_static_clutter,
    sum_pulses,
)

PRF_HZ = 100.0
TIME_S = np.arange(4000) / PRF_HZ


def remove_common_phase(baseband):
    return clutter.remove_common_phase(Frames.of(baseband)).label()


def tone(doppler_hz, clutter=3.0 - 1.0j):
    values = (clutter + np.exp(2j * np.pi * doppler_hz * TIME_S))[:, None] * np.array([1.0, 0.5])
    return make_array(BASEBAND, values.astype(np.complex64), {"slow_time": TIME_S, "range": [1.0, 1.1]})


def test_exponential_is_the_high_pass_of_its_time_constant():
    doppler_hz = np.array([1 / (2 * np.pi * 2.0), 0.02, 0.3, 5.0])
    alpha = 1 - np.exp(-1 / (PRF_HZ * 2.0))
    z = np.exp(2j * np.pi * doppler_hz / PRF_HZ)
    expected = abs(1 - alpha / (1 - (1 - alpha) / z))  # one-pole running mean taken off
    np.testing.assert_allclose(clutter_gain(doppler_hz, kind="exponential", prf_hz=PRF_HZ, time_s=2.0), expected)
    assert expected[0] == pytest.approx(1 / np.sqrt(2), rel=0.02)


def test_exponential_starts_without_a_transient_from_zero():
    kept = remove_clutter(tone(5.0, clutter=1000.0), Analysis(clutter="exponential")).values
    assert np.abs(kept[:, 0]).max() < 1.1


@pytest.mark.parametrize("doppler_hz", [0.01, 0.0625, 0.4, 3.0, 14.6, 33.0, -3.0])
@pytest.mark.parametrize("kind", ["none", "mean", "exponential", "mti"])
def test_the_gain_of_a_tone_is_the_closed_form(kind, doppler_hz):
    expected = clutter_gain(doppler_hz, kind=kind, prf_hz=PRF_HZ, n_pulses=TIME_S.size)
    kept = remove_static_clutter(tone(doppler_hz, clutter=0.0), kind=kind).values[:, 0]
    gain = np.sqrt((np.abs(kept if kind == "mean" else kept[2400:]) ** 2).mean())
    assert gain == pytest.approx(float(expected), rel=2e-3, abs=1e-5)


@pytest.mark.parametrize("doppler_hz", [0.0025, 0.01, 0.0125, 0.02, 0.03, 0.0625, 0.4, 5.0, 33.0])
def test_the_median_is_a_notch_like_the_mean(doppler_hz):
    """Slower than one turn in the recording the median depends on where in the turn it began: mean over that."""
    starts = np.exp(1j * np.linspace(0, 2 * np.pi, 32, endpoint=False))
    values = (np.exp(2j * np.pi * doppler_hz * TIME_S)[:, None] * starts).astype(np.complex64)
    baseband = make_array(BASEBAND, values, {"slow_time": TIME_S, "range": np.arange(32) / 10})
    found = np.sqrt((np.abs(remove_static_clutter(baseband, kind="median").values) ** 2).mean())
    expected = clutter_gain(doppler_hz, kind="median", prf_hz=PRF_HZ, n_pulses=TIME_S.size)
    assert found == pytest.approx(float(expected), abs=0.04)


def room(phase_rad, clutter_v, body_v=0.0, seed=0):
    """Static echoes in every bin, noise of 1 V^2, a body that walks through, and the phase of the clock."""
    generator = np.random.default_rng(seed)
    range_m = 1.0 + 0.05 * np.arange(120)
    parts = generator.standard_normal((2, TIME_S.size, range_m.size)) / np.sqrt(2)
    place_m = 6.0 - 0.1 * TIME_S
    envelope = body_v * np.exp(-((range_m - place_m[:, None]) ** 2) / (2 * 0.05**2))
    body = envelope * np.exp(2j * np.pi * 4.87 * TIME_S)[:, None]
    still = clutter_v * np.exp(2j * np.pi * generator.random(range_m.size))
    values = (still + body + parts[0] + 1j * parts[1]) * np.exp(1j * np.broadcast_to(phase_rad, TIME_S.shape))[:, None]
    return make_array(BASEBAND, values.astype(np.complex64), {"slow_time": TIME_S, "range": range_m}), body


@pytest.mark.parametrize("drift_rad_per_min", [0.1, 1.0, 400.0])
def test_the_phase_of_a_clock_is_taken_out_down_to_the_noise(drift_rad_per_min):
    steps = 0.5 / np.sqrt(60 * PRF_HZ) * np.random.default_rng(9).standard_normal(TIME_S.size)
    baseband, _ = room(drift_rad_per_min * TIME_S / 60 + np.cumsum(steps), 100.0)
    steady = remove_common_phase(baseband)
    left_v2 = steady.values.var(axis=0)
    # 1 V^2 of noise, and the error of the phase: at least 75 bins are 0.75 m away or more, each with 40 dB
    assert left_v2.mean() == pytest.approx(1.0 + 0.5 / 75, abs=0.01)
    assert baseband.values.var(axis=0).mean() > 20
    assert np.abs(steady.values.mean(axis=0)) == pytest.approx(100.0, rel=0.01)


def test_a_weak_reference_is_summed_over_frames_and_spares_what_it_would_spoil():
    levels_v = np.full(120, 3.0)
    levels_v[:3], levels_v[3:6] = 300.0, 20.0
    baseband, _ = room(1.0 * TIME_S / 40, levels_v)
    steady = remove_common_phase(baseband).values
    # 105 bins far off hold 9 V^2 each: 5 frames of them are ten times the echo of 20 V, which gains 400 / 2 / 4700
    assert steady[:, 3:6].var(axis=0).mean() == pytest.approx(1.04, abs=0.06)
    assert baseband.values[:, 3:6].var(axis=0).mean() > 20
    np.testing.assert_array_equal(steady[:, :3], baseband.values[:, :3])  # 10 frames of them are nothing to 300 V


def test_a_body_is_never_its_own_reference():
    baseband, _ = room(0.0, 0.0, body_v=300.0)  # nothing stands still
    np.testing.assert_array_equal(remove_common_phase(baseband).values, baseband.values)
    baseband, _ = room(0.0, 300.0 * (np.arange(120) > 100), body_v=30.0)  # it walks away from the only thing that does
    beside = slice(100, 120)
    np.testing.assert_array_equal(remove_common_phase(baseband).values[:, beside], baseband.values[:, beside])
    near = baseband.isel(range=slice(0, 25))  # no bin is 1.5 m away
    frames = Frames.of(near)
    assert clutter.remove_common_phase(frames) is frames


def test_mti_is_the_butterworth_high_pass():
    f_hz = np.array([0.3, 3.0, 30.0])
    analogue = 1 / np.sqrt(1 + (3.0 / f_hz) ** 4)  # far below half the frame rate the bilinear transform is exact
    np.testing.assert_allclose(clutter_gain(f_hz, kind="mti", prf_hz=1e5), analogue, rtol=1e-3)
    assert clutter_gain(0.0, kind="mti", prf_hz=1e3) == 0.0


def test_a_gain_that_depends_on_the_recording_needs_its_length_and_mti_a_frame_rate():
    for kind in ("mean", "median"):
        with pytest.raises(AnalysisError, match=f"{kind}.*n_pulses"):
            clutter_gain(1.0, kind=kind, prf_hz=PRF_HZ)
    slow = make_array(BASEBAND, np.ones((50, 1), complex), {"slow_time": np.arange(50) / 5.0, "range": [1.0]})
    with pytest.raises(AnalysisError, match="more than 6 frames per second"):
        remove_static_clutter(slow, kind="mti")


def crossing(doppler_hz, clutter_v):
    """A body that moves through the bins at 0.2 m/s with a Doppler shift of its own, before clutter."""
    range_m = np.arange(0.0, 10.0, 0.05)
    place_m = 1.0 + 0.2 * TIME_S
    envelope = np.exp(-((range_m - place_m[:, None]) ** 2) / (2 * 0.05**2))
    body = envelope * np.exp(2j * np.pi * doppler_hz * TIME_S)[:, None]
    room = clutter_v * np.exp(1j * np.arange(range_m.size))
    values = (body + room).astype(np.complex64)
    baseband = make_array(BASEBAND, values, {"slow_time": TIME_S, "range": range_m})
    return baseband, Gate.around(TIME_S, place_m, span_m=1.0, source="track")


def test_the_mean_takes_nothing_from_a_body_that_moves_and_no_answer_is_given_for_one_that_stays():
    before, gate = crossing(5.0, 30.0)
    assert float(measure_share_removed(before, remove_static_clutter(before, kind="mean"), gate).max()) < 0.02
    stays = Gate.fixed(2.0, 3.0, time_s=TIME_S)
    assert np.isnan(measure_share_removed(before, remove_static_clutter(before, kind="mean"), stays).values).all()


def test_the_reference_is_every_pulse_when_the_gate_is_elsewhere_or_over():
    before, gate = crossing(4.0, 30.0)
    after = remove_static_clutter(before, kind="mti")
    part = gate.during(10.0, 20.0)
    range_m, values = before.coords["range"].values, before.values.astype(complex)
    at = np.arange(np.searchsorted(TIME_S, part.start_s - 1e-9), np.searchsorted(TIME_S, part.stop_s + 1e-9))
    first, count = part.whole_bins(TIME_S[at], first_bin_m=range_m[0], bin_spacing_m=range_m[1] - range_m[0])
    inside, bins = np.zeros(values.shape, dtype=bool), np.arange(range_m.size)
    inside[at] = (bins >= first[:, None]) & (bins < first[:, None] + count)
    reference = values.mean(axis=0, where=~inside)
    lost = (np.abs(after.values) ** 2).sum(axis=1, where=inside)[at]
    body = (np.abs(values - reference) ** 2).sum(axis=1, where=inside)[at]
    length = round(0.1 * PRF_HZ)
    blocks = [slice(k * length, (k + 1) * length) for k in range(at.size // length)]
    expected = [max(1 - lost[block].sum() / body[block].sum(), 0) for block in blocks]
    for total in (None, sum_pulses(Frames.of(before))):
        np.testing.assert_allclose(measure_share_removed(before, after, part, total=total), expected, atol=1e-5)


def test_a_crossing_torso_is_lost_where_its_range_stands_still():
    wavelength_m, times = 0.0411, np.linspace(0.0, 5.0, 501)
    range_m = np.hypot(5.0, 1.0 * (times - 2.5))  # 1 m/s at 90 degrees
    gate = Gate.around(times, range_m, span_m=1.6, source="track")
    found = predict_torso_share_removed(gate, [0.0, 2.5, 2.8], kind="mti", wavelength_m=wavelength_m, prf_hz=1000.0)
    doppler_hz = 2 / wavelength_m * np.array([2.5, 0.0, 0.3]) / np.hypot(5.0, [2.5, 0.0, 0.3])
    np.testing.assert_allclose(found, 1 / (1 + (doppler_hz / 3.0) ** 4), rtol=0.02, atol=1e-6)
    assert found[1] > 0.99
    slow = predict_torso_share_removed(gate, [2.8], kind="exponential", wavelength_m=wavelength_m, prf_hz=1000.0)
    assert slow < 0.01
