"""Breathing in real X4 recordings: a person who sits, two empty rooms, a person who keeps still at first."""

import numpy as np
import pytest
from scipy.signal import butter, find_peaks, sosfiltfilt

from doppelgait.core.frames import Frames
from doppelgait.processing.breathing import find_breathing
from doppelgait.radar import read_recording

pytestmark = pytest.mark.shared

SITS = "rf_breathing_20220303_131324.mat"
EMPTY = "rf_empty_room_two_radars_20220222_143239.mat"
MOVES = "xethru_recording_20170913_150437_baseband_recording/xethru_baseband_iq_20170913_150437.dat"


@pytest.fixture(scope="module")
def radar_folder(shared):
    return shared / "data" / "radar"


def found_in(recording, **chosen):
    part = recording.baseband.sel(slow_time=slice(*chosen["between_s"])) if chosen else recording.baseband
    return find_breathing(Frames.of(part), wavelength_m=recording.radar.wavelength_m)


def breaths_hz(recording):
    """Times and rates from peak to peak of the phase near 1.73 m, band-passed: no spectrum, no circle."""
    range_m, times = (recording.baseband[name].values for name in ("range", "slow_time"))
    phase = np.unwrap(np.angle(recording.baseband.values[:, np.abs(range_m - 1.73).argmin()]))
    band = butter(4, [0.1, 0.7], "band", fs=recording.radar.prf_hz, output="sos")
    peaks = times[find_peaks(sosfiltfilt(band, phase), prominence=0.3)[0]]
    return (peaks[1:] + peaks[:-1]) / 2, 1 / np.diff(peaks)


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


@pytest.mark.parametrize("matrix", ["Data_Matrix_1", "Data_Matrix_2"])
def test_nobody_is_in_the_empty_room(radar_folder, matrix):
    assert found_in(read_recording(radar_folder / "x4_rf_giraffe_yin" / EMPTY, matrix=matrix)) == []


def test_who_breathes_for_twelve_seconds_and_then_moves_is_found_at_first(radar_folder):
    """Peaks of the phase near 0.55 m, counted by eye: 0.32 Hz until 12 s, then irregular motion by centimetres."""
    (person,) = found_in(read_recording(radar_folder / "x4_baseband_iq_novelda" / MOVES))
    assert person.range_m == pytest.approx(0.55, abs=0.06)
    assert person.rate_hz == pytest.approx(0.32, abs=0.02)
    assert person.start_s == 0.0
    assert person.stop_s == pytest.approx(12.0, abs=1.5)
    later = read_recording(radar_folder / "x4_baseband_iq_novelda" / MOVES)
    assert found_in(later, between_s=(13, 30)) == []
