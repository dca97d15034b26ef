"""Samples of TI sensors as the DCA1000 board stores them, written here number by number."""

import json
from contextlib import nullcontext

import numpy as np
import pytest

from beat import approaching, beat
from doppelgait.core.errors import DoppelgaitWarning, RecordingError
from doppelgait.radar import read_recording
from doppelgait.radar.readers import find_formats
from doppelgait.radar.readers.dca1000 import read_config

C_MPS = 299_792_458.0
TABLE = {
    "device": "xwr16xx", "output": "complex1x", "receivers": [0, 1], "n_samples": 64, "sample_rate_hz": 2e6,
    "start_hz": 77e9, "slope_hz_per_s": 20e12, "idle_s": 50e-6, "adc_start_s": 5e-6, "ramp_s": 50e-6,
    "chirps_per_loop": 1, "loops": 16, "frames": 0, "frame_period_s": 1.6e-3,
}  # fmt: skip
SWEEP = {"carrier_hz": 77e9 + 20e12 * (5e-6 + 16e-6), "bandwidth_hz": 20e12 * 32e-6, "sweep_s": 32e-6, "n_samples": 64}
SPACING_M = C_MPS / (2 * SWEEP["bandwidth_hz"])
CFG = """% Created for SDK ver:03.06
% Platform:xWR18xx
sensorStop
dfeDataOutputMode 1
channelCfg 3 1 0
adcCfg 2 1
adcbufCfg -1 0 {swap} 1 1
profileCfg 0 77 50 5 50 0 0 20 1 64 2000 0 0 30
chirpCfg 0 0 0 0 0 0 0 1
frameCfg 0 0 16 0 1.6 1 0
sensorStart
"""


def toml(table):
    return "".join(f"{key} = {json.dumps(value)}\n" for key, value in table.items())


def numbers_of(samples, *, device, output, receivers, q_first=False):
    """The order of SWRA581B: samples (chirps, receivers, samples), one number after the other."""
    blocks = []  # samples whose real parts, then whose imaginary parts follow each other
    for chirp in samples:
        if device in ("xwr12xx", "xwr14xx"):
            lanes = np.zeros((4, chirp.shape[1]), complex)
            lanes[receivers] = chirp
            blocks += list(lanes.T)
        else:
            blocks += list(chirp.reshape(-1, 2))
    out = []
    for block in blocks:
        parts = [block.real, block.imag]
        out += parts[:1] if output == "real" else [parts[q_first], parts[not q_first]]
    return np.round(np.concatenate(out)).astype("<i2")


def write(folder, samples, table, name="walk"):
    keys = {key: table[key] for key in ("device", "output", "receivers", "q_first") if key in table}
    numbers_of(samples, **keys).tofile(folder / f"{name}.bin")
    (folder / f"{name}.toml").write_text(toml(table))
    return folder / f"{name}.bin"


def point(n_chirps, prf_hz, table=TABLE, *, start_m=1.5, speed_mps=1.0):
    """A point that approaches, 1000 steps of the converter in receiver 0, 500 with another phase in the others."""
    one = beat(*approaching(n_chirps, prf_hz, start_m, speed_mps), **SWEEP) * 1000
    return np.stack([one, *[0.5j * one for _ in table["receivers"][1:]]], axis=1)


@pytest.mark.parametrize("device", ["xwr14xx", "xwr16xx", "xwr18xx", "xwr68xx"])
@pytest.mark.parametrize("output", ["complex1x", "complex2x", "real"])
@pytest.mark.parametrize("q_first", [False, True])
def test_every_order_of_the_numbers(tmp_path, device, output, q_first):
    if output == "real" and q_first:
        return
    table = TABLE | {"device": device, "output": output, "q_first": q_first, "receivers": [0, 2, 3]}
    path = write(tmp_path, point(512, 1e4, table), table)
    assert find_formats(path) == ["dca1000"]
    recording = read_recording(path)
    values, bins = recording.baseband.values, 64 if output == "complex1x" else 32
    assert recording.range_m == pytest.approx(SPACING_M * np.arange(bins))
    assert recording.slow_time_s == pytest.approx(np.arange(512) * 1e-4)  # the frames follow without a pause
    assert "burst_pulses" not in recording.facts
    assert recording.radar.carrier_hz == pytest.approx(SWEEP["carrier_hz"])
    # closed form: R and v at the middle; range-Doppler coupling - f_c v T_c / B
    row, column = np.unravel_index(np.abs(np.fft.fft(values, axis=0)).argmax(), values.shape)
    assert np.fft.fftfreq(512, 1e-4)[row] == pytest.approx(2 * 1.0 * SWEEP["carrier_hz"] / C_MPS, abs=20)
    coupling_m = -SWEEP["carrier_hz"] * 32e-6 / SWEEP["bandwidth_hz"]
    profile = np.abs(values[256])
    near = profile[column - 1 : column + 2]
    place_m = (column + 1.5 * (near[2] - near[0]) / near.sum()) * SPACING_M
    assert place_m == pytest.approx(1.5 - 256e-4 + coupling_m, abs=0.02)
    # receivers 2 and 3 are half as strong and 90 degrees ahead: conjugated, values as of the text book's beat
    for receiver in (2, 3):
        other = read_recording(path, rx=receiver).baseband.values[:, column]
        ratio = other / values[:, column]
        if output != "real":
            assert ratio == pytest.approx(np.full(512, -0.5j), abs=0.01)
        else:
            assert np.abs(ratio) == pytest.approx(np.full(512, 0.5), abs=0.02)
    total = read_recording(path, rx="sum").baseband.values[:, column]
    if output != "real":
        assert total / values[:, column] == pytest.approx(np.full(512, 1 - 1j), abs=0.01)


def test_amplitude(tmp_path):
    table = TABLE | {"receivers": [0]}
    still = {name: beat(np.full((16, 1), 10 * SPACING_M), np.zeros((16, 1)), **SWEEP)[:, None] * 1000 for name in "ab"}
    complex_values = read_recording(write(tmp_path, still["a"], table)).baseband.values
    assert np.abs(complex_values[:, 10]) == pytest.approx(1000 / 2**15, rel=1e-3)
    real = read_recording(write(tmp_path, still["b"], table | {"output": "real"}, "real")).baseband.values
    assert real[:, 10] == pytest.approx(complex_values[:, 10], rel=2e-3)


def test_settings_in_toml_json_and_ti_text(tmp_path):
    path = write(tmp_path, point(32, 1e4), TABLE)
    expected = read_recording(path)
    (tmp_path / "walk.toml").unlink()
    with pytest.raises(RecordingError, match="no radar settings next to it; give config=FILE"):
        read_recording(path, format="dca1000")
    (tmp_path / "walk.json").write_text(json.dumps(TABLE))
    assert read_recording(path).baseband.identical(expected.baseband)
    (tmp_path / "walk.json").unlink()
    (tmp_path / "profile.cfg").write_text(CFG.format(swap=0))
    found = read_recording(path)
    assert found.baseband.values == pytest.approx(expected.baseband.values)
    assert found.radar.name == "TI xwr18xx by DCA1000"
    (tmp_path / "profile.cfg").rename(tmp_path / "elsewhere.txt")
    assert read_recording(path, config="elsewhere.txt").baseband.identical(found.baseband)
    assert read_recording(path, config=str(tmp_path / "elsewhere.txt")).baseband.identical(found.baseband)
    (tmp_path / "elsewhere.txt").write_text(CFG.format(swap=1))
    assert read_config(tmp_path / "elsewhere.txt").q_first
    (tmp_path / "elsewhere.txt").write_text(CFG.replace("adcbufCfg -1 0", "adcbufCfg 0").format(swap=1))
    assert read_config(tmp_path / "elsewhere.txt").q_first  # as older kits write it, without the subframe
    (tmp_path / "elsewhere.txt").write_text(CFG.format(swap=0).replace("% Platform:xWR18xx", ""))
    with pytest.raises(RecordingError, match="does not state the device; give the option device"):
        read_recording(path, config="elsewhere.txt")
    assert read_recording(path, config="elsewhere.txt", device="xwr18xx").baseband.identical(found.baseband)


def test_transmitters_in_turn_and_pauses(tmp_path):
    # two chirps a loop, 8 loops in 1.6 ms of a frame of 5 ms
    table = TABLE | {"chirps_per_loop": 2, "loops": 8, "frame_period_s": 5e-3, "receivers": [1]}
    times_s = (5e-3 * np.arange(40)[:, None] + 1e-4 * np.arange(16)).ravel()
    range_m = 2.0 - 1.5 * times_s[:, None]
    samples = beat(range_m, np.full_like(range_m, 1.5), **SWEEP)[:, None] * 1000
    samples[1::2] *= 0.1
    path = write(tmp_path, samples, table)
    recording = read_recording(path)
    assert recording.facts["burst_pulses"] == 8
    assert recording.radar.prf_hz == pytest.approx(1 / 2e-4)
    assert recording.slow_time_s == pytest.approx(times_s[::2])
    other = read_recording(path, chirp=1)
    assert np.abs(other.baseband.values).max() == pytest.approx(0.1 * np.abs(recording.baseband.values).max(), rel=0.02)
    single = write(tmp_path, samples[:16], table, "one")
    assert "burst_pulses" not in read_recording(single).facts
    chirps = write(tmp_path, samples[:80:2], table | {"chirps_per_loop": 1, "loops": 1}, "slow")
    assert read_recording(chirps).slow_time_s == pytest.approx(5e-3 * np.arange(40))


STUDIO = {
    "mmWaveDevices": [{
        "rfConfig": {
            "rlChanCfg_t": {"rxChannelEn": "0x3", "txChannelEn": "0x1"},
            "rlAdcOutCfg_t": {"fmt": {"b2AdcBits": 2, "b2AdcOutFmt": 1}},
            "rlProfiles": [{"rlProfileCfg_t": {
                "profileId": n, "startFreqConst_GHz": 77.0, "idleTimeConst_usec": 50.0, "adcStartTimeConst_usec": 5.0,
                "rampEndTime_usec": 50.0, "freqSlopeConst_MHz_usec": 20.0 + n, "numAdcSamples": 64,
                "digOutSampleRate": 2000.0}} for n in range(2)],
            "rlChirps": [{"rlChirpCfg_t": {"chirpStartIdx": 0, "chirpEndIdx": 0, "profileId": 0}}],
            "rlFrameCfg_t": {"chirpStartIdx": 0, "chirpEndIdx": 0, "numLoops": 16, "numFrames": 0,
                             "framePeriodicity_msec": 1.6},
        },
        "rawDataCaptureConfig": {"rlDevDataFmtCfg_t": {"iqSwapSel": 1}},
    }]
}  # fmt: skip


def test_the_settings_of_mmwave_studio_are_those_of_the_toml_file(tmp_path):
    table = TABLE | {"q_first": True, "device": "xwr2243"}
    wanted = read_recording(write(tmp_path, point(64, 1e4), table))
    (tmp_path / "walk.toml").unlink()
    (tmp_path / "other.mmwave.json").write_text(json.dumps(STUDIO))
    again = read_recording(tmp_path / "walk.bin", device="xwr2243")
    assert again.baseband.identical(wanted.baseband)
    (tmp_path / "other.setup.json").write_text('{"mmWaveDevice": "awr2243"}')
    assert read_recording(tmp_path / "walk.bin").radar == wanted.radar
    for damage in (("rlProfileCfg_t", "x"), ("mmWaveDevices", 'mmWaveDevices": [], "x'), ("numLoops", "loops")):
        (tmp_path / "other.mmwave.json").write_text(json.dumps(STUDIO).replace(*damage))
        with pytest.raises(RecordingError, match=r"other\.mmwave\.json: "):
            read_recording(tmp_path / "walk.bin", config="other.mmwave.json")


@pytest.mark.parametrize(
    ("lost", "frames", "zeros", "said"),
    [
        ((), 0, 0, None),
        ((20_000,), 0, 0, r"chirps break inside in \d+ of \d+ frames, first seen in frame 4"),
        ((70_000, 90_000), 0, 0, r"chirps break inside"),
        ((), 0, -64, r"a part of \d of 512 chirps is exactly 0, first of chirp 300"),
        ((), 40, 0, "holds 32 of the 40 frames of walk.toml"),
        ((), 0, 256, "the last 50 % of the pulses are exactly 0 .from pulse 256"),
    ],
)
def test_lost_samples_are_noticed(tmp_path, lost, frames, zeros, said):
    samples = point(512, 1e4)
    samples[512 - max(zeros, 0) :] = 0
    path = write(tmp_path, samples, TABLE | {"frames": frames})
    numbers = np.fromfile(path, "<i2")
    if zeros < 0:
        numbers[300 * 256 + 40 : 300 * 256 + 768] = 0  # a packet that is filled
    for at in lost:
        numbers = np.delete(numbers, slice(at, at + 728))  # a packet of the board
    numbers[: len(numbers) // 4096 * 4096].tofile(path)
    with pytest.warns(DoppelgaitWarning, match=said) if said else nullcontext():
        read_recording(path)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("frameCfg 0 0 16 0 1.6 1 0\n", "", "lacks the command frameCfg"),
        ("adcbufCfg -1 0 0 1 1", "adcbufCfg 0 1 1", "adcbufCfg has 3 numbers; 5 are read, or 4"),
        ("adcbufCfg -1 0 0 1 1", "adcbufCfg -1 0 0 0 1", "receivers that alternate are not allowed for xwr18xx"),
        ("frameCfg", "chirpComnCfg 15 0 0 128 4 30 0\nframeCfg", "settings of xWRL parts"),
        ("adcCfg 2 1", "adcCfg 2 7", "adcCfg: output format 7"),
        ("adcCfg 2 1", "adcCfg 2", "line 6, adcCfg: has 1 numbers; it must have 2"),
        ("channelCfg 3 1 0", "channelCfg 3 one 0", "line 5, channelCfg: holds a word that is no number"),
        ("channelCfg 3 1 0", "channelCfg 0 1 0", "receivers"),
        ("frameCfg 0 0", "frameCfg 0 1", "takes chirps 0 to 1, of which each needs a chirpCfg"),
        ("chirpCfg 0 0 0 0 0", "chirpCfg 0 0 0 0 0.5", "line 9, chirpCfg: changes slope of the profile"),
        ("chirpCfg 0 0 0", "chirpCfg 0 0 1", "has 0 profileCfg of number 1"),
        ("chirpCfg 0 0 0 0", "chirpCfg 0 900 0 0", "line 9, chirpCfg: chirps must be 0 to 511"),
        ("chirpCfg 0 0 0 0", "frameCfg 0 0 8 0 1.6 1 0\nchirpCfg 0 0 0 0", "frameCfg in lines 9, 11"),
    ],
)
def test_ti_text_that_is_wrong(tmp_path, old, new, message):
    path = write(tmp_path, point(32, 1e4), TABLE)
    (tmp_path / "walk.toml").unlink()
    text = CFG.format(swap=0)
    assert old in text
    (tmp_path / "walk.cfg").write_text(text.replace(old, new))
    with pytest.raises(RecordingError, match=message):
        read_recording(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"n_samples": None}, "n_samples"),
        ({"n_samples": 63}, r"n_samples \(line 4\): 63 is not allowed; it must be even"),
        ({"receivers": [0, 0]}, "receivers"),
        ({"ramp_s": 30e-6}, r"ramp_s \(line 10\): 3e-05 is shorter than adc_start_s and 64 samples"),
        ({"frame_period_s": 1e-3}, r"frame_period_s \(line 14\): 0.001 is shorter than 16 loops of 1 chirps, 0.0016 s"),
        ({"slope": "x" * 2**20}, r"walk\.toml: has .* bytes, at most 1,048,576 are read"),
        ({"frames": 1}, "2 frames and 0 bytes more; by walk.toml it has 1"),
        ({"loops": 15}, "2 frames and 1,024 bytes more; by walk.toml it has any number of frames, each of 15 loops"),
        ({"rx": 2}, "on are 0, 1, and sum"),
        ({"chirp": 1}, "give chirp = 0 to 0 of a loop"),
        ({"config": "none.toml"}, "no such file of radar settings"),
        ({"range_stop_m": 99}, "the ranges end at 14.99"),
        (slice(-6), "shorten it to 8,192 bytes"),
    ],
)
def test_settings_options_and_sizes_that_are_wrong(tmp_path, change, message):
    path, options = write(tmp_path, point(32, 1e4), TABLE), {}
    if isinstance(change, slice):
        path.write_bytes(path.read_bytes()[change])
    elif set(change) & {"rx", "chirp", "config", "range_stop_m"}:
        options = change
    else:
        table = {key: value for key, value in (TABLE | change).items() if value is not None}
        (tmp_path / "walk.toml").write_text(toml(table))
    with pytest.raises(RecordingError, match=message) as caught:
        read_recording(path, format="dca1000", **options)
    assert str(tmp_path) in str(caught.value)
