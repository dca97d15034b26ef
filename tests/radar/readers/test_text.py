"""Text files of continuous-wave modules in pairs, and of Ancortek radars from the equation of the beat."""

import numpy as np
import pytest

from beat import approaching, beat, write_glasgow
from doppelgait.core.errors import DoppelgaitWarning, RecordingError
from doppelgait.radar import read_recording
from doppelgait.radar.readers import find_formats


def write_pair(folder, re, im, name="walk"):
    for part, values in (("RE", re), ("IM", im)):
        (folder / f"{name}_{part}.txt").write_text("".join(f"{int(v)}\n" for v in values))
    return folder / f"{name}_RE.txt"


def codes(count, seed=0):
    return np.random.default_rng(seed).integers(1, 4095, size=(2, count))


def test_values_and_times(tmp_path):
    re, im = codes(3 * 128)
    recording = read_recording(write_pair(tmp_path, re, im))
    values = recording.baseband.values[:, 0]
    assert recording.baseband.shape == (384, 1)
    np.testing.assert_allclose(values.real, (re - 2048) / 4096, atol=1e-7)
    # RE + j IM turns backwards while the range falls: conjugated, approaching is positive
    np.testing.assert_allclose(values.imag, -(im - 2048) / 4096, atol=1e-7)
    times = recording.baseband.slow_time.values
    assert times[[0, 1, 127, 128, 383]] == pytest.approx([0, 1 / 3000, 127 / 3000, 0.2, 0.4 + 127 / 3000])
    assert recording.baseband.attrs["burst_pulses"] == 128
    assert recording.baseband.range.values.tolist() == recording.radar.range_axis_m().tolist() == [5.0]
    assert recording.radar.waveform.kind == "cw"
    assert (recording.radar.carrier_hz, recording.radar.prf_hz) == (24.1e9, 3000.0)
    assert recording.source == "walk_RE.txt"
    assert any("24.1 GHz" in note for note in recording.notes)


def test_options(tmp_path):
    re, im = codes(40)
    recording = read_recording(
        write_pair(tmp_path, re, im), carrier_hz=10.525e9, sample_rate_hz=1000, burst_pulses=20, burst_period_s=0.5,
        conjugate=False, full_scale_v=3.3,
    )  # fmt: skip
    np.testing.assert_allclose(
        recording.baseband.values[:, 0], ((re - 2048) + 1j * (im - 2048)) * 3.3 / 4096, atol=1e-6
    )
    assert recording.baseband.slow_time.values[20] == 0.5
    assert recording.radar.volts_per_unit == pytest.approx(3.3 / 4096)
    even = read_recording(write_pair(tmp_path, re, im), burst_pulses=20, burst_period_s=20 / 3000)
    assert "burst_pulses" not in even.baseband.attrs
    np.testing.assert_allclose(even.baseband.slow_time.values, np.arange(40) / 3000)


def test_clipping_and_a_last_burst_that_is_not_whole_are_noted(tmp_path):
    re, im = codes(300)
    re[:10], im[5:20] = 4095, 0  # samples 0 to 19
    with (
        pytest.warns(DoppelgaitWarning, match="the last burst has 44 of 128"),
        pytest.warns(DoppelgaitWarning, match="6.7 % of the samples are clipped") as caught,
    ):
        recording = read_recording(write_pair(tmp_path, re, im))
    assert {one.filename for one in caught} == {__file__}
    assert recording.n_pulses == 256


WHOLE = "2040\n" * 256


@pytest.mark.parametrize(
    ("re", "im", "options", "message"),
    [
        ("1\n" * 128, "1\n" * 127, {}, "walk_RE.txt holds 128 values and walk_IM.txt 127"),
        ("1\n" * 64, "1\n" * 64, {}, "64 samples, less than 1 bursts of 128"),
        ("1\n" * 3 + "4096\n", "1\n" * 4, {}, "walk_RE.txt: line 4 holds '4096'; every line must hold an integer"),
        ("1\n2.5\n", "1\n1\n", {}, "line 2 holds '2.5'"),
        ("1\n99999999999999999999999\n", "1\n1\n", {}, "line 2 holds '99999999999999999999"),
        ("\n \n", "1\n", {}, "holds no values"),
        ("1\n", None, {}, "walk_IM.txt: no such file"),
        (WHOLE, WHOLE, {"burst_pulses": 12.5}, "burst_pulses = 12.5"),
        (WHOLE, WHOLE, {"burst_period_s": 0.01}, "burst_period_s = 0.01 is shorter than a burst of 128 samples"),
        (WHOLE, WHOLE, {"carrier_hz": 5.0}, "carrier_hz"),
        (None, None, {}, r"no such recording; give NAME_RE\.txt"),
    ],
)
def test_damage_and_wrong_options_are_named(tmp_path, re, im, options, message):
    for part, text in (("RE", re), ("IM", im)):
        if text is not None:
            (tmp_path / f"walk_{part}.txt").write_text(text)
    with pytest.raises(RecordingError, match=message):
        read_recording(tmp_path / ("walk" if re is None else "walk_RE.txt"), format="cw-text", **options)


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


def test_options_of_sweeps(tmp_path):
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
        (3, "12.5", "line 3 holds '12.5'; it must be the samples per sweep"),
        (4, "0", "continuous wave"),
        (90, "20481998i", None),
        (91, "2048+19 98i", "line 91 holds '2048\\+19'"),
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
    ("name", "text"),
    [
        ("notes.txt", "12\n13\n"),
        ("a_RE.txt", "time,value\n1,2\n"),
        ("a.dat", "1\n2\n3\n4\n5\n"),
        ("a.dat", "a\n2\n3\n4\n5+2i"),
    ],
)
def test_files_of_other_programs_are_not_recognised(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    assert not {"cw-text", "glasgow"} & set(find_formats(tmp_path / name))
