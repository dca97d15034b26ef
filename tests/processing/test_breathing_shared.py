"""Breathing in real X4 recordings: a person who sits, two empty rooms, a person who moves a little."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, find_peaks, sosfiltfilt

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
    return find_breathing(part, wavelength_m=recording.radar.wavelength_m)


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


def test_little_movements_are_not_called_a_breath(radar_folder):
    """Half a minute of irregular motion: nothing steady enough to be told from it."""
    assert found_in(read_recording(radar_folder / "x4_baseband_iq_novelda" / MOVES)) == []
