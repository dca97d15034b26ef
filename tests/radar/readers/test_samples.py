"""Sound files, interleaved numbers, tables of text: the same samples written in any way are the same recording."""

import struct
import wave

import numpy as np
import pytest
from scipy.io import wavfile

from doppelgait.core.errors import DoppelgaitWarning, RecordingError
from doppelgait.radar import read_recording

RATE_HZ, CARRIER_HZ, DOPPLER_HZ = 500.0, 24.15e9, 60.0
TIME_S = np.arange(1000) / RATE_HZ
IQ = 0.5 * np.exp(2j * np.pi * DOPPLER_HZ * TIME_S) + 0.1
"""An approaching target, and a mean."""
PAIRS = np.stack([IQ.real, IQ.imag], axis=-1)


def write_24_bit(path, values):
    with wave.open(str(path), "wb") as file:
        file.setnchannels(values.shape[1])
        file.setsampwidth(3)
        file.setframerate(int(RATE_HZ))
        file.writeframes(b"".join(struct.pack("<i", int(v * 2**23))[:3] for v in values.ravel()))


def write_table(path, header, *, delimiter=",", comma=False, time=None, swap=False, before=""):
    rows = PAIRS[:, ::-1] if swap else PAIRS
    columns = [] if time is None else [time]
    cells = np.column_stack([*columns, rows])
    lines = [delimiter.join(f"{value:.6f}" for value in row) for row in cells]
    text = "\n".join(line.replace(".", ",") if comma else line for line in lines)
    path.write_text(f"{before}{header}\n{text}\n", encoding="utf-8")


WAYS = {
    "a8.wav": lambda p: wavfile.write(p, 500, np.round(PAIRS * 128 + 128).astype(np.uint8)),
    "a16.wav": lambda p: wavfile.write(p, 500, np.round(PAIRS * 2**15).astype(np.int16)),
    "a24.wav": lambda p: write_24_bit(p, PAIRS),
    "af.wav": lambda p: wavfile.write(p, 500, PAIRS.astype(np.float32)),
    "renamed.sound": lambda p: wavfile.write(p, 500, PAIRS.astype(np.float64)),
    "a.cs8": lambda p: np.round(PAIRS * 128).astype(np.int8).tofile(p),
    "a.cu8": lambda p: np.round(PAIRS * 128 + 128).astype(np.uint8).tofile(p),
    "a.cs16": lambda p: np.round(PAIRS * 2**15).astype("<i2").tofile(p),
    "a.cfile": lambda p: PAIRS.astype("<f4").tofile(p),
    "a.iq ci16_be": lambda p: np.round(PAIRS * 2**15).astype(">i2").tofile(p),
    "a.bin cf64": lambda p: PAIRS.astype("<f8").tofile(p),
    "a.csv": lambda p: write_table(p, "time,I,Q", time=TIME_S),
    "b.csv": lambda p: write_table(p, "Q;I;t [ms]"[:3], delimiter=";", comma=True, swap=True),
    "c.csv": lambda p: write_table(p, "t_ms\tre\tim", delimiter="\t", comma=True, time=1e3 * TIME_S),
    "d.txt": lambda p: write_table(p, "timestamp_us real imag", delimiter=" ", time=1e6 * TIME_S),
    "e.csv": lambda p: write_table(p, "Time (s),I [V],Q [V]", time=1.7e9 + TIME_S, before="# logger 1\n# room 3\n\n"),
    "g.csv": lambda p: write_table(p, "Seconds  ADC_I   ADC_Q", delimiter="  ", time=TIME_S),
    "f.csv": lambda p: write_table(p, "sample,in-phase,quadrature", time=np.arange(1000)),
}


@pytest.mark.parametrize("way", WAYS)
def test_the_same_samples_are_the_same_recording(tmp_path, way):
    name, _, dtype = way.partition(" ")
    WAYS[way](tmp_path / name)
    stamped = name in ("a.csv", "c.csv", "d.txt", "e.csv", "g.csv")
    options = {} if stamped or name.endswith((".wav", ".sound")) else {"prf_hz": RATE_HZ}
    recording = read_recording(tmp_path / name, carrier_hz=CARRIER_HZ, **options, **({"dtype": dtype} if dtype else {}))
    assert recording.samples.shape == (1000, 1)
    assert recording.radar.prf_hz == pytest.approx(RATE_HZ, rel=1e-6)
    np.testing.assert_allclose(np.diff(recording.slow_time_s), 1 / RATE_HZ, rtol=2e-3)
    np.testing.assert_allclose(recording.samples.matrix[:, 0], IQ, atol=0.012 if "8" in way else 2e-4)
    assert "one_output" not in recording.facts
    assert np.argmax(np.abs(np.fft.fft(recording.samples.matrix[:, 0] - 0.1))) == 120  # 60 Hz: approaching
    swapped = read_recording(
        tmp_path / name, carrier_hz=CARRIER_HZ, conjugate=True, **options, **({"dtype": dtype} if dtype else {})
    )
    np.testing.assert_array_equal(swapped.samples.matrix, recording.samples.matrix.conj())


@pytest.mark.parametrize(
    ("name", "write", "options"),
    [
        ("a.wav", lambda p: wavfile.write(p, 500, IQ.real.astype(np.float32)), {}),
        ("b.wav", lambda p: wavfile.write(p, 500, PAIRS.astype(np.float32)), {"channel": 0}),
        ("d.csv", lambda p: np.savetxt(p, np.column_stack([TIME_S, IQ.real]), "%.9f", ",", header="t,adc"), {}),
        ("e.npy", lambda p: np.save(p, IQ.real), {"prf_hz": RATE_HZ}),
    ],
)
def test_one_real_output_has_no_direction(tmp_path, name, write, options):
    write(tmp_path / name)
    recording = read_recording(tmp_path / name, carrier_hz=CARRIER_HZ, **options)
    assert recording.facts["one_output"] is True
    np.testing.assert_allclose(recording.samples.matrix[:, 0], IQ.real, atol=1e-6)


def test_a_sound_file_is_decimated_on_request(tmp_path):
    time_s = np.arange(48_000) / 48_000.0
    wavfile.write(tmp_path / "a.wav", 48_000, (0.5 * np.cos(2 * np.pi * 300 * time_s)).astype(np.float32))
    whole = read_recording(tmp_path / "a.wav", carrier_hz=CARRIER_HZ)
    assert whole.radar.prf_hz == 48_000
    assert any("decimate=13" in note for note in whole.notes)
    part = read_recording(tmp_path / "a.wav", carrier_hz=CARRIER_HZ, decimate=12)
    assert (part.radar.prf_hz, part.n_pulses) == (4000.0, 4000)
    np.testing.assert_allclose(
        part.samples.matrix[200:-200, 0], 0.5 * np.cos(2 * np.pi * 300 * time_s[::12])[200:-200], atol=2e-3
    )


def save(path, text):
    path.write_text(text)


@pytest.mark.parametrize(
    ("name", "write", "options", "said"),
    [
        ("a.wav", lambda p: wavfile.write(p, 500, PAIRS), {}, "carrier_hz is stated nowhere"),
        ("a.cs16", lambda p: p.write_bytes(bytes(80)), {}, "prf_hz, carrier_hz are stated nowhere"),
        ("a.raw", lambda p: p.write_bytes(bytes(80)), {}, "give dtype .*prf_hz and carrier_hz"),
        ("a.bin", lambda p: p.write_bytes(b"x" * 80), {}, "could be dca1000 .*config.* or raw .*dtype"),
        ("a.raw", lambda p: p.write_bytes(bytes(80)), {"dtype": "c16"}, "dtype = 'c16' is not allowed"),
        ("a.cs16", lambda p: p.write_bytes(bytes(4)), {}, "holds 1 samples, less than 2 pulses of 1"),
        ("a.wav", lambda p: wavfile.write(p, 500, PAIRS[:, [0, 1, 0]]), {}, "holds 3 channels; give channel = 0 to 2"),
        ("a.wav", lambda p: p.write_bytes(b"RIFF\1\0\0\0WAVE"), {}, "damaged or unusual WAV"),
        ("a.csv", lambda p: save(p, "t,a,b\n0,1,2\n1,2,3\n"), {}, r"has the columns t, a, b.*columns='time_ms,i,q'"),
        ("a.csv", lambda p: save(p, "0,1,2\n1,2,3\n"), {}, "has no names of columns"),
        ("a.csv", lambda p: save(p, "time,i,q\n0,1,2\n5,2,3\n"), {}, "steps by 5 and states no unit"),
        ("a.csv", lambda p: save(p, "time_ms,i,q\n0,1,2\n5,x,3\n"), {}, "column 'i' holds cells that are no numbers"),
        ("a.csv", lambda p: save(p, "time_ms,i,q\n0,1,2\n5,,3\n"), {"carrier_hz": 24e9}, "values are NaN"),
        ("a.csv", lambda p: save(p, "nothing here\n"), {}, "holds no row of numbers"),
    ],
)
def test_what_is_missing_is_named_with_its_option(tmp_path, name, write, options, said):
    write(tmp_path / name)
    with pytest.raises(RecordingError, match=said):
        read_recording(tmp_path / name, **options)


@pytest.mark.parametrize(
    ("column", "stamp"),
    [
        ("time", lambda t: f"2026-01-01T00:00:{t:09.6f}Z"),
        ("time", lambda t: f"23:59:{59 + t:09.6f}" if t < 1 else f"0:00:{t - 1:06.3f}"),  # on past midnight
        ("millis", lambda t: f"{1e3 * t:.0f}"),
    ],
)
def test_columns_are_named_by_an_option_and_stamps_of_any_kind_are_times(tmp_path, column, stamp):
    save(tmp_path / "a.csv", "\n".join(f"{stamp(t)},{v.real},{v.imag}" for t, v in zip(TIME_S, IQ, strict=True)))
    recording = read_recording(tmp_path / "a.csv", columns=f"{column},i,q", carrier_hz=CARRIER_HZ)
    assert recording.radar.prf_hz == pytest.approx(RATE_HZ, rel=1e-4)
    np.testing.assert_allclose(recording.slow_time_s - recording.slow_time_s[0], TIME_S, atol=1e-3)
    np.testing.assert_allclose(recording.samples.matrix[:, 0], IQ, atol=1e-6)


@pytest.mark.parametrize(("name", "wrap"), [("frame", 2**16), ("seq", 256)])
def test_rows_that_a_counter_misses_are_lost_frames(tmp_path, name, wrap):
    rows = [f"{7 + n % wrap},{v.real},{v.imag}" for n, v in enumerate(IQ) if not 320 <= n < 325 and n % 97 != 50]
    save(tmp_path / "a.csv", "\n".join([f"{name},i,q", *rows]))
    with pytest.warns(DoppelgaitWarning):
        recording = read_recording(tmp_path / "a.csv", carrier_hz=CARRIER_HZ, prf_hz=RATE_HZ)
    assert recording.radar.prf_hz == pytest.approx(RATE_HZ)
    np.testing.assert_allclose(recording.slow_time_s, TIME_S, atol=1e-9)
    np.testing.assert_allclose(recording.samples.matrix[330:340, 0], IQ[330:340], atol=1e-6)
    with pytest.warns(DoppelgaitWarning, match="a counter has gaps: rows are lost; give prf_hz"):
        read_recording(tmp_path / "a.csv", radar="infineon-24")
