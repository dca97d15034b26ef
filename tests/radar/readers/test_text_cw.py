"""Pairs of text files of continuous-wave modules, written here by hand."""

import numpy as np
import pytest

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


def test_either_file_or_the_stem(tmp_path):
    path = write_pair(tmp_path, *codes(128))
    stem, other = tmp_path / "walk", tmp_path / "walk_IM.txt"
    first = read_recording(path)
    for one in (stem, other, str(path)):
        assert read_recording(one).baseband.identical(first.baseband)
    assert all(find_formats(one) == ["cw-text"] for one in (path, stem, other))


def test_what_it_is_not(tmp_path):
    assert not find_formats(tmp_path / "walk")
    (tmp_path / "notes.txt").write_text("12\n13\n")
    assert not find_formats(tmp_path / "notes.txt")
    (tmp_path / "a_RE.txt").write_text("time,value\n1,2\n")
    assert not find_formats(tmp_path / "a_RE.txt")
    assert not find_formats(tmp_path)


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
        ("1\n", "-3\n", {}, "walk_IM.txt: line 1 holds '-3'"),
        ("1\n2.5\n", "1\n1\n", {}, "line 2 holds '2.5'"),
        ("1\nabc\n", "1\n1\n", {}, "line 2 holds 'abc'"),
        ("1\n99999999999999999999999\n", "1\n1\n", {}, "line 2 holds '99999999999999999999"),
        ("00001\n", "1\n", {}, "line 1 holds '00001'"),
        ("\n \n", "1\n", {}, "holds no values"),
        ("1\n", None, {}, "walk_IM.txt: no such file"),
        (WHOLE, WHOLE, {"burst_pulses": 0}, "burst_pulses = 0"),
        (WHOLE, WHOLE, {"burst_pulses": 12.5}, "burst_pulses = 12.5"),
        (WHOLE, WHOLE, {"burst_period_s": 0.01}, "burst_period_s = 0.01 is shorter than a burst of 128 samples"),
        (WHOLE, WHOLE, {"sample_rate_hz": 0}, "sample_rate_hz = 0"),
        (WHOLE, WHOLE, {"carrier_hz": 5.0}, "carrier_hz"),
        (WHOLE, WHOLE, {"full_scale_v": float("nan")}, "full_scale_v = nan"),
        (None, None, {}, r"no such recording; give NAME_RE\.txt"),
    ],
)
def test_damage_and_wrong_options_are_named(tmp_path, re, im, options, message):
    for part, text in (("RE", re), ("IM", im)):
        if text is not None:
            (tmp_path / f"walk_{part}.txt").write_text(text)
    with pytest.raises(RecordingError, match=message):
        read_recording(tmp_path / ("walk" if re is None else "walk_RE.txt"), format="cw-text", **options)
