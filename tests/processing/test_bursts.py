"""Signature of data in bursts, against closed forms and against the signature of evenly spaced data."""

import numpy as np
import pytest

from doppelgait.core.errors import AnalysisError, DoppelgaitWarning
from doppelgait.core.labels import BASEBAND, make_array
from doppelgait.processing import Analysis, Gate, burst_signature, find_burst_pulses, get_burst_pulses, signature

PRF_HZ = 3000.0
M = 128
PERIOD_S = 0.2
LAMBDA_M = 0.0124


def burst_times(count=6, pulses=M, prf_hz=PRF_HZ, period_s=PERIOD_S):
    return (period_s * np.arange(count)[:, None] + np.arange(pulses) / prf_hz).ravel()


def labelled(values, slow_time_s, range_m=None, **attrs):
    values = np.asarray(values, dtype=np.complex64).reshape(slow_time_s.size, -1)
    range_m = np.array([5.0]) if range_m is None else range_m
    return make_array(BASEBAND, values, {"slow_time": slow_time_s, "range": range_m}, attrs)


def gaussian(n, steepness=0.4):
    h = (n - 1) / 2
    return np.exp(-0.5 * ((np.arange(n) - h) / (steepness * h)) ** 2)


def test_a_tone_has_its_velocity_and_its_level():
    # a whole number of turns in a burst, so that its mean is 0 and its bin is exact: 11 of 128 bins
    doppler_hz = 11 * PRF_HZ / M
    times = burst_times()
    mu = burst_signature(
        labelled(3.0 * np.exp(2j * np.pi * doppler_hz * times), times), None, Analysis(), wavelength_m=LAMBDA_M
    )
    assert mu.shape == (6, 128)
    peak = mu.values.argmax(axis=1)
    np.testing.assert_allclose(mu.doppler.values[peak], doppler_hz)
    np.testing.assert_allclose(mu.velocity.values[peak], doppler_hz * LAMBDA_M / 2)
    np.testing.assert_allclose(mu.values.max(axis=1), 9.0 * gaussian(M).sum() ** 2, rtol=1e-5)
    np.testing.assert_allclose(mu.time.values, PERIOD_S * np.arange(6) + 63.5 / PRF_HZ)


@pytest.mark.parametrize("remove_mean", [False, True])
def test_noise_has_the_window_energy_less_what_the_mean_takes(remove_mean):
    rng = np.random.default_rng(2)
    times = burst_times(count=3000)
    noise = (rng.normal(size=times.size) + 1j * rng.normal(size=times.size)) / np.sqrt(2)
    mu = burst_signature(labelled(noise, times), None, Analysis(), wavelength_m=LAMBDA_M, remove_mean=remove_mean)
    w = gaussian(M)
    k = np.arange(M) - M // 2
    transform = np.abs(np.exp(-2j * np.pi * np.outer(k, np.arange(M)) / M) @ w) ** 2
    expected = (w**2).sum() - (transform / M if remove_mean else 0.0)
    np.testing.assert_allclose(mu.values.mean(axis=0), expected, rtol=0.12, atol=0.05)
    assert mu.attrs["window_energy"] == pytest.approx((w**2).sum())
    assert mu.values.mean() == pytest.approx(np.mean(expected), rel=0.01)


@pytest.mark.parametrize("edges", ["fractional", "sharp"])
def test_a_burst_is_one_column_of_the_plain_signature(edges):
    # 101 pulses at 1 kHz and T_d = 0.1 s: the same M, window and K; the middle of the recording is one column
    rng = np.random.default_rng(3)
    times = np.arange(101) / 1000.0
    ranges = 1.0 + 0.25 * np.arange(12)
    values = rng.normal(size=(101, 12)) + 1j * rng.normal(size=(101, 12))
    gate = Gate.around(times, np.linspace(2.0, 2.3, 101), span_m=1.1, doppler_hz=(-200.0, 300.0), source="given")
    analysis = Analysis(gate_edges=edges, doppler_bins=160)
    plain = signature(labelled(values, times, ranges), gate, analysis, wavelength_m=LAMBDA_M)
    burst = burst_signature(
        labelled(values, times, ranges), gate, analysis, wavelength_m=LAMBDA_M, burst_pulses=101, remove_mean=False
    )
    np.testing.assert_allclose(burst.values, plain.values, rtol=2e-4, atol=1e-3)
    for name in ("time", "doppler", "velocity", "centre_range", "gate_share"):
        np.testing.assert_allclose(burst.coords[name].values, plain.coords[name].values, err_msg=name)
    assert set(burst.attrs) == set(plain.attrs)
    for name in ("prf_hz", "wavelength_m", "cpi_pulses", "window_energy", "n_gate_bins"):
        assert burst.attrs[name] == pytest.approx(plain.attrs[name]), name
    assert burst.attrs["gate"] == plain.attrs["gate"]


def test_data_without_range_lie_inside_any_gate():
    times = burst_times()
    baseband = labelled(np.exp(2j * np.pi * 300.0 * times), times)
    gate = Gate.around([0.0], [80.0], span_m=1.0, doppler_hz=(0.0, 500.0), source="given")
    gated, whole = (burst_signature(baseband, one, Analysis(), wavelength_m=LAMBDA_M) for one in (gate, None))
    inside = (whole.doppler.values >= 0) & (whole.doppler.values <= 500)
    assert np.array_equal(gated.values, np.where(inside, whole.values, 0.0))
    np.testing.assert_allclose(gated.gate_share.values, 1.0)


def test_bursts_are_found_from_the_pauses():
    assert find_burst_pulses(burst_times()) == M
    assert find_burst_pulses(burst_times(pulses=2)) == 2
    assert find_burst_pulses(burst_times()[:-5]) == M
    assert find_burst_pulses(np.arange(50) / 10.0) is None
    assert find_burst_pulses([0.0]) is None
    times = burst_times()
    assert get_burst_pulses(labelled(np.ones(times.size), times, burst_pulses=64)) == 64
    assert get_burst_pulses(labelled(np.ones(times.size), times)) == M
    assert find_burst_pulses(np.delete(times, slice(M, M + 5))) is None  # a reader leaves the incomplete one out
    assert find_burst_pulses(burst_times(count=2)) is None  # a pause is no burst


def test_a_last_burst_that_is_not_whole_is_left_out():
    times = burst_times()[:-5]
    assert burst_signature(labelled(np.ones(times.size), times), None, Analysis(), wavelength_m=1.0).sizes["time"] == 5


def test_missing_bursts_are_told():
    times = np.delete(burst_times(count=8), slice(3 * M, 4 * M))
    with pytest.warns(DoppelgaitWarning, match="1 of 6 periods"):
        mu = burst_signature(labelled(np.ones(times.size), times), None, Analysis(), wavelength_m=LAMBDA_M)
    np.testing.assert_allclose(np.diff(mu.time.values), [0.2, 0.2, 0.4, 0.2, 0.2, 0.2])


OUTSIDE = Gate.around([0.0], [50.0], span_m=1.0, source="given")


@pytest.mark.parametrize(
    ("times", "change", "message"),
    [
        (burst_times()[40:], {}, "bursts of 128 evenly spaced"),
        (burst_times(), {"burst_pulses": 4}, "a burst has 4 pulses, at least 5"),
        (burst_times(), {"burst_pulses": 100}, "bursts of 100 evenly spaced"),
        (burst_times(), {"burst_pulses": 10_000}, "less than one burst"),
        (burst_times(), {"analysis": Analysis(doppler_bins=100)}, "doppler_bins is 100, but a burst has 128"),
        (np.arange(500) / 1000.0, {"burst_pulses": None}, "no bursts"),
        (burst_times(), {"gate": OUTSIDE}, r"49\.5 to 50\.5 m: lies outside the recorded frame, 0\.50 to 3\.50"),
    ],
)
def test_what_cannot_be_done_is_refused(times, change, message):
    options = {"gate": None, "analysis": Analysis(), "burst_pulses": M, **change}
    baseband = labelled(np.ones((times.size, 3)), times, np.array([1.0, 2.0, 3.0]))
    with pytest.raises(AnalysisError, match=message):
        burst_signature(baseband, **options, wavelength_m=LAMBDA_M)
