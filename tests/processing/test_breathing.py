"""Breathing found in slow-time phase: rate, place, amplitude; noise, drift and jitter that must not breathe."""

import numpy as np
import pytest
from scipy.signal import butter, find_peaks, sosfiltfilt

from doppelgait.core.errors import AnalysisError, ConfigError
from doppelgait.core.frames import Frames, SlowTime
from doppelgait.core.labels import BASEBAND, make_array
from doppelgait.processing.breathing import (
    BreathingSettings,
    compute_breath_spectrum,
    compute_displacement,
    explain_no_breathing,
    find_breathing,
    fit_circle,
    remove_common_gain,
)
from doppelgait.radar import read_recording

WAVE_M = 0.0411
RATE_HZ = 17.0
RANGE_M = 0.4 + 0.0514 * np.arange(60)


def noise(source, pulses, bins=60):
    """Complex white noise of mean power 1."""
    return (source.standard_normal((pulses, bins)) + 1j * source.standard_normal((pulses, bins))) / np.sqrt(2)


def labelled(values, rate_hz=RATE_HZ):
    coords = {"slow_time": np.arange(values.shape[0]) / rate_hz, "range": RANGE_M[: values.shape[1]]}
    return make_array(BASEBAND, values.astype(np.complex64), coords)


def echo(times, *, range_m, amplitude_v, rate_hz, swing_m, phase=0.0):
    """One point that breathes, through a pulse of 5.2 cm; E-18."""
    displacement = swing_m * np.sin(2 * np.pi * rate_hz * times + phase)
    shape = np.exp(-((RANGE_M - range_m) ** 2) / (2 * 0.052**2))
    return amplitude_v * np.exp(-4j * np.pi * displacement / WAVE_M)[:, None] * shape


def room(source, level_v=1000.0):
    """Static echoes, falling with range."""
    return level_v * noise(source, 1) * np.exp(-np.arange(60) / 8)


def find(values, **settings):
    return find_breathing(Frames.of(labelled(values)), wavelength_m=WAVE_M, settings=BreathingSettings(**settings))


@pytest.mark.parametrize(("seconds", "rate_hz"), [(20, 0.3), (40, 0.15), (60, 0.25), (60, 0.55)])
def test_one_person_before_a_room(seconds, rate_hz):
    times = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    source = np.random.default_rng(1)
    body = echo(times, range_m=1.75, amplitude_v=30, rate_hz=rate_hz, swing_m=0.003)
    values = room(source) + body + noise(source, times.size)
    (person,) = find(values)
    assert not find(values, low_hz=0.69)
    assert person.rate_hz == pytest.approx(rate_hz, rel=0.01)
    assert person.range_m == pytest.approx(1.75, abs=0.03)
    assert person.displacement_m == pytest.approx(0.003, rel=0.05)
    assert person.confidence > 0.9
    assert (person.start_s, person.stop_s) == pytest.approx((0, times[-1]), abs=0.2)


def test_a_large_swing_is_one_breath_at_its_rate_and_not_its_double():
    """12 mm at 7.29 GHz turn the phase by 3.7 rad either way: J_2 > J_1, the spectrum's strongest line is not at f."""
    times = np.arange(round(60 * RATE_HZ)) / RATE_HZ
    body = echo(times, range_m=1.75, amplitude_v=30, rate_hz=0.22, swing_m=0.012)
    (person,) = find(body + noise(np.random.default_rng(2), times.size))
    assert person.rate_hz == pytest.approx(0.22, rel=0.01)
    assert person.displacement_m == pytest.approx(0.012, rel=0.05)


def test_two_people_are_two_also_at_nearly_one_rate():
    times = np.arange(round(90 * RATE_HZ)) / RATE_HZ
    near = echo(times, range_m=1.2, amplitude_v=30, rate_hz=0.25, swing_m=0.004)
    far = echo(times, range_m=2.6, amplitude_v=10, rate_hz=0.27, swing_m=0.002, phase=1.0)
    people = find(near + far + noise(np.random.default_rng(3), times.size))
    assert [round(person.range_m, 1) for person in people] == [1.2, 2.6]
    assert [person.rate_hz for person in people] == pytest.approx([0.25, 0.27], rel=0.02)


def test_an_echo_by_a_second_way_is_no_second_person():
    times = np.arange(round(60 * RATE_HZ)) / RATE_HZ
    direct = echo(times, range_m=1.2, amplitude_v=30, rate_hz=0.25, swing_m=0.002)
    detour = echo(times, range_m=2.9, amplitude_v=8, rate_hz=0.25, swing_m=0.002)
    (person,) = find(direct + detour + noise(np.random.default_rng(4), times.size))
    assert person.range_m == pytest.approx(1.2, abs=0.03)


@pytest.mark.parametrize("begins_s", [0.0, 11.0, 28.0])
def test_a_person_who_keeps_still_for_a_third_of_the_time_is_found_then(begins_s):
    """Long windows hold more of the motion by centimetres than of the breath; the interval is that of the breath."""
    times = np.arange(round(42 * RATE_HZ)) / RATE_HZ
    source = np.random.default_rng(6)
    body = echo(times, range_m=1.75, amplitude_v=30, rate_hz=0.32, swing_m=0.002)
    still = (times >= begins_s) & (times <= begins_s + 14)
    wander = np.cumsum(np.where(still, 0.0, source.normal(0, 0.01, times.size)))[:, None]
    (person,) = find(room(source) + body * np.exp(-4j * np.pi * wander / WAVE_M) + noise(source, times.size))
    assert person.rate_hz == pytest.approx(0.32, rel=0.03)
    assert person.range_m == pytest.approx(1.75, abs=0.05)
    assert person.start_s >= begins_s - 3
    assert person.stop_s <= begins_s + 14 + 3


def test_white_noise_and_a_static_room_do_not_breathe():
    for seed in range(12):
        source = np.random.default_rng(seed)
        assert find(noise(source, 510) + (seed % 2) * room(source)) == []


def test_common_drift_and_jitter_are_no_breath_in_any_bin():
    """The clock's phase turns all static echoes alike, here even at a breath's rate."""
    times = np.arange(round(40 * RATE_HZ))[:, None] / RATE_HZ
    for seed in range(2):
        source = np.random.default_rng(seed)
        jitter = 0.004 * source.standard_normal(times.shape)
        walk = np.cumsum(0.3 / np.sqrt(60 * RATE_HZ) * source.standard_normal(times.shape), axis=0)
        for phase in (jitter, walk, 0.05 * np.sin(2 * np.pi * 0.25 * times) + 0.3 * times / 60):
            assert find(room(source) * np.exp(1j * phase) + noise(source, times.size)) == []


def test_a_walk_through_the_room_and_a_wide_swing_are_no_breath():
    times = np.arange(round(40 * RATE_HZ)) / RATE_HZ
    walk = 20 * np.exp(-4j * np.pi * (3 - 0.06 * times) / WAVE_M)[:, None]
    walk = walk * np.exp(-((RANGE_M - (3 - 0.06 * times)[:, None]) ** 2) / (2 * 0.052**2))
    assert find(walk + noise(np.random.default_rng(7), times.size)) == []
    swing = echo(times, range_m=1.75, amplitude_v=30, rate_hz=0.3, swing_m=0.05)
    assert find(swing + noise(np.random.default_rng(8), times.size)) == []


def test_what_cannot_be_looked_at_is_refused():
    with pytest.raises(AnalysisError, match=r"10 s or more at 3 Hz or more; this recording has 5 s at 17 Hz"):
        find(noise(np.random.default_rng(0), 85))
    with pytest.raises(AnalysisError, match="wavelength_m = 0"):
        find_breathing(Frames.of(labelled(noise(np.random.default_rng(0), 340))), wavelength_m=0.0)
    assert explain_no_breathing(SlowTime(np.arange(41) / 2)).startswith("2 frames/s are too few")
    broken = noise(np.random.default_rng(0), 340)
    broken[3, 3] = np.nan
    with pytest.raises(AnalysisError, match="not finite"):
        find(broken)
    with pytest.raises((ConfigError, ValueError), match=r"low_hz 0\.7 must be below high_hz 0\.2"):
        BreathingSettings(low_hz=0.7, high_hz=0.2)


def test_circle_of_a_short_arc():
    angle = np.linspace(0.2, 1.0, 200)
    centre, radius = fit_circle(3 - 2j + 1.7 * np.exp(1j * angle))
    assert centre == pytest.approx(3 - 2j, abs=1e-9)
    assert radius == pytest.approx(1.7, abs=1e-9)
    assert fit_circle(np.linspace(0, 1, 9) * (1 + 2j) + 0)[1] == np.inf


def test_displacement_is_positive_away_and_in_metres():
    times = np.arange(600) / 20
    true = 0.004 * np.sin(2 * np.pi * 0.2 * times)
    values = 5 + 2j + 1.5 * np.exp(1j * (0.4 - 4 * np.pi * true / WAVE_M))
    found, known = compute_displacement(values, wavelength_m=WAVE_M)
    assert known
    np.testing.assert_allclose(found, true - true.mean(), atol=1e-9)
    found, known = compute_displacement(values + 3 * noise(np.random.default_rng(1), 600, 1)[:, 0], wavelength_m=WAVE_M)
    assert not known


def test_the_common_gain_leaves_a_body_alone_and_takes_the_clock_out():
    times = np.arange(600) / RATE_HZ
    source = np.random.default_rng(2)
    body = echo(times, range_m=1.75, amplitude_v=30, rate_hz=0.25, swing_m=0.004)
    alone = body + noise(source, 600)
    np.testing.assert_array_equal(remove_common_gain(alone, RANGE_M), alone)
    gain = (1 + 0.01 * source.standard_normal(600)) * np.exp(0.05j * source.standard_normal(600))
    still = room(source) + noise(source, 600)
    fixed = remove_common_gain(still * gain[:, None], RANGE_M)
    assert np.std(still[:, 2] * gain) > 10 * np.std(still[:, 2])
    static = np.abs(still.mean(axis=0))
    reference = (static[RANGE_M - RANGE_M[2] > 0.75] ** 2).sum()  # noise of power 1 in each of the bins elsewhere
    assert np.std(fixed[:, 2]) == pytest.approx(np.sqrt(1 + static[2] ** 2 / reference), rel=0.1)


SITS = "rf_breathing_20220303_131324.mat"


@pytest.fixture(scope="module")
def radar_folder(shared):
    return shared / "data" / "radar"


def found_in(recording, **chosen):
    part = recording.baseband.sel(slow_time=slice(*chosen["between_s"])) if chosen else recording.baseband
    return find_breathing(Frames.of(part), wavelength_m=recording.radar.wavelength_m)


def test_windows_overlap_by_half_and_cover_the_recording():
    spectrum = compute_breath_spectrum(noise(np.random.default_rng(4), 1200, 2), 10.0, BreathingSettings())
    assert spectrum.starts.tolist() == [0, 150, 300, 450, 600, 750, 900]
    assert spectrum.window_s == 30
    assert compute_breath_spectrum(noise(np.random.default_rng(4), 400, 2), 10.0, BreathingSettings()).window_s == 40


def breaths_hz(recording):
    """Times and rates from peak to peak of the phase near 1.73 m, band-passed: no spectrum, no circle."""
    range_m, times = (recording.baseband[name].values for name in ("range", "slow_time"))
    phase = np.unwrap(np.angle(recording.baseband.values[:, np.abs(range_m - 1.73).argmin()]))
    band = butter(4, [0.1, 0.7], "band", fs=recording.radar.prf_hz, output="sos")
    peaks = times[find_peaks(sosfiltfilt(band, phase), prominence=0.3)[0]]
    return (peaks[1:] + peaks[:-1]) / 2, 1 / np.diff(peaks)


@pytest.mark.shared
def test_the_person_who_sits_is_the_only_one(radar_folder):
    recording = read_recording(radar_folder / "x4_rf_giraffe_yin" / SITS)
    (person,) = found_in(recording)
    assert person.range_m == pytest.approx(1.73, abs=0.05)
    assert person.rate_hz == pytest.approx(0.24, abs=0.015)
    assert 0.002 < person.displacement_m < 0.008
    assert person.start_s > 20  # moves before
    at_s, rates = breaths_hz(recording)
    for start_s in (40, 60, 80, 100):
        (person,) = found_in(recording, between_s=(start_s, start_s + 20))
        assert person.range_m == pytest.approx(1.73, abs=0.05)
        counted = np.mean(rates[(at_s > start_s) & (at_s < start_s + 20)])
        assert person.rate_hz == pytest.approx(counted, abs=0.01)
