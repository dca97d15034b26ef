"""Text files of Ancortek radars, made here from the equation of the beat."""

import numpy as np
import pytest

from beat import approaching, beat, write_glasgow
from doppelgait.core.errors import DoppelgaitWarning, RecordingError
from doppelgait.radar import read_recording
from doppelgait.radar.readers import find_formats

SWEEP = {"carrier_hz": 5.8e9, "bandwidth_hz": 400e6, "sweep_s": 1e-3, "n_samples": 128}
SPACING_M = 299_792_458 / (2 * 400e6)


def test_amplitude_and_phase_at_the_middle_of_a_bin(tmp_path):
    range_m = 16 * SPACING_M
    samples = beat(np.full((4, 1), range_m), np.zeros((4, 1)), **SWEEP)
    path = write_glasgow(tmp_path / "1P36A01R01.dat", samples, step=1000.0)
    assert find_formats(path) == ["glasgow"]
    recording = read_recording(path)
    assert recording.radar.waveform.kind == "fmcw"
    assert (recording.radar.carrier_hz, recording.radar.prf_hz) == (5.8e9, 1000.0)
    assert recording.range_m == pytest.approx(SPACING_M * np.arange(64))
    assert recording.slow_time_s == pytest.approx(np.arange(4) / 1000)
    value = recording.baseband.values[0, 16]
    # an echo of 1000 codes keeps its amplitude; the phase is -4 pi R / lambda, but for the video phase of 0.02 rad
    assert abs(value) == pytest.approx(1000 / 4096, rel=1e-3)
    expected = np.exp(-4j * np.pi * range_m * 5.8e9 / 299_792_458)
    assert np.angle(value / abs(value) / expected) == pytest.approx(0, abs=0.03)
    assert np.abs(recording.baseband.values[:, 3:14]).max() < 1e-3  # the converter's mean is in bins 0 and 1 only


def test_options(tmp_path):
    path = write_glasgow(tmp_path / "a.dat", beat(*approaching(8, 1000, 6, 1), **SWEEP))
    plain, mirrored = read_recording(path), read_recording(path, conjugate=False, range_stop_m=10)
    assert mirrored.n_range_bins == np.ceil(10 / SPACING_M)
    assert not np.allclose(np.abs(mirrored.baseband.values), np.abs(plain.baseband.values[:, : mirrored.n_range_bins]))
    assert any("4096" in note or "0.0002441 V" in note for note in plain.notes)
    for wrong in (0, -1, 25.0, "far", True):
        with pytest.raises(RecordingError, match="range_stop_m"):
            read_recording(path, range_stop_m=wrong)


@pytest.mark.parametrize(
    ("line", "text", "message"),
    [
        (1, "x", "line 1 holds 'x'; it must be the centre frequency in Hz"),
        (2, "0", "line 2 holds '0'; it must be the sweep time in ms"),
        (3, "12.5", "line 3 holds '12.5'; it must be the samples per sweep"),
        (3, "1e9", "line 3"),
        (4, "-4", "line 4 holds '-4'; it must be the bandwidth in Hz"),
        (4, "0", "continuous wave"),
        (1, "nan", "line 1"),
        (2, "20000", "line 2"),
        (90, "20481998i", None),
        (91, "2048+19 98i", "line 91 holds '2048\\+19'"),
        (92, "spam", "line 92 holds 'spam'"),
        (93, "nan+3i", "NaN"),
    ],
)
def test_a_wrong_line_is_named(tmp_path, line, text, message):
    path = write_glasgow(tmp_path / "1P36A01R01.dat", beat(*approaching(4, 1000, 6, 1), **SWEEP))
    lines = path.read_text().split("\n")
    lines[line - 1] = text
    path.write_text("\n".join(lines))
    if message is None:
        assert read_recording(path).n_pulses == 4
        return
    with pytest.raises(RecordingError, match=message) as caught:
        read_recording(path, format="glasgow")
    assert str(path) in str(caught.value)


def test_a_sweep_that_is_cut_off(tmp_path):
    path = write_glasgow(tmp_path / "a.dat", beat(*approaching(5, 1000, 6, 1), **SWEEP))
    lines = path.read_text().splitlines()
    path.write_text("\n".join(lines[:-28]))
    with pytest.warns(DoppelgaitWarning, match="100 of 128"):
        assert read_recording(path).n_pulses == 4
    path.write_text("\n".join(lines[: 4 + 200]))
    with pytest.raises(RecordingError, match="200 samples, less than 2 sweeps of 128"):
        read_recording(path)


@pytest.mark.parametrize(
    "text", ["", "1\n2\n3\n4\n", "1\n2\n3\n4\n5\n", "a\n2\n3\n4\n5+2i", "1\n2\n3\n4\nhi", "1 2 3 4 \xff\xfei"]
)
def test_what_is_not_recognised(tmp_path, text):
    (tmp_path / "other.dat").write_text(text, encoding="latin-1")
    assert "glasgow" not in find_formats(tmp_path / "other.dat")
