"""Contract checks of radar readers and writers: every built-in passes, and a broken one is caught."""

import json
from contextlib import nullcontext
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest
from scipy.io import savemat, wavfile

from acconeer_file import write_a111
from acconeer_file import write_file as write_acconeer
from beat import write_glasgow
from damage import outcomes
from doppelgait.core.errors import RecordingError
from doppelgait.radar import RADAR_READERS, RADAR_WRITERS, Radar, Recording, read_recording, write_recording
from doppelgait.radar.measured import label_measured
from doppelgait.radar.simulate import label_baseband
from doppelgait.testing import check_radar_reader, check_radar_writer


def _recording(n_bins=6, prf_hz=25.0):
    rng = np.random.default_rng(4)
    radar = Radar.preset("x4", prf_hz=prf_hz, range_start_m=0.5, range_stop_m=0.5 + n_bins * 0.0514)
    values = (rng.normal(size=(30, n_bins)) + 1j * rng.normal(size=(30, n_bins))).astype(np.complex64)
    return Recording.from_baseband(label_baseband(values, np.arange(30) / prf_hz, radar), radar, seed=3)


XETHRU = {"start_time": datetime(2020, 5, 1, 12, tzinfo=UTC), "session_id": "a"}
WRITERS = {"doppelgait": {}, "arrays": {}, "frames": {}, "sigmf": {}, "xethru": {**XETHRU, "rtol": 1e-5}}


CHIRPS = {"device": "xwr18xx", "receivers": [0], "n_samples": 64, "sample_rate_hz": 2e6, "start_hz": 60e9,
          "slope_hz_per_s": 20e12, "idle_s": 1e-4, "ramp_s": 5e-5, "loops": 8, "frame_period_s": 0.01}  # fmt: skip


INFINEON = {"device_config": {"fmcw_single_shape": {
    "start_frequency_Hz": 60e9, "end_frequency_Hz": 61e9, "num_chirps_per_frame": 4, "num_samples_per_chirp": 64,
    "chirp_repetition_time_s": 5e-4, "frame_repetition_time_s": 2e-3, "sample_rate_Hz": 2e6}}}  # fmt: skip
PAIRS = np.random.default_rng(2).normal(scale=0.1, size=(200, 2))
FRAMES = np.random.default_rng(1).normal(size=(20, 256))
MATLAB = {"Data_Matrix": FRAMES, "actual_fps": 25.0, "bin_length": 0.00643, "frame_start": 0.4}
PLAIN = ("wav", "raw", "csv")
FILES = {
    "acconeer": ("walk.h5", write_acconeer),
    "acconeer-a111": ("walk.h5", write_a111),
    "glasgow": ("1P36A01R01.dat", lambda path: write_glasgow(path, np.ones((20, 64)))),
    "matlab-rf": ("walk.mat", lambda path: savemat(path, MATLAB)),
    "wav": ("walk.wav", lambda path: wavfile.write(path, 100, PAIRS)),
    "raw": ("walk.cfile", lambda path: PAIRS.astype("<f4").tofile(path)),
    "csv": ("walk.csv", lambda path: np.savetxt(path, PAIRS, delimiter=",", header="i,q", comments="")),
}


def _sample_file(name, folder):
    """A good file of a reader's format, alone in its folder."""
    folder.mkdir()
    if name in WRITERS:
        options = {key: value for key, value in WRITERS[name].items() if key != "rtol"}
        path = folder / f"walk{RADAR_WRITERS[name].facts['suffix']}"
        return RADAR_WRITERS[name].run(_recording(), path, **options) or path
    if name == "infineon":
        (folder / "config.json").write_text(json.dumps(INFINEON))
        np.save(folder / "radar.npy", np.random.default_rng(1).uniform(size=(20, 3, 4, 64)).astype(np.float32))
        return folder / "radar.npy"
    if name == "cw-text":
        for part in ("RE", "IM"):
            (folder / f"walk_{part}.txt").write_text("\n".join(str(2000 + n % 90) for n in range(512)))
        return folder / "walk_RE.txt"
    if name == "dca1000":
        (folder / "walk.json").write_text(json.dumps(CHIRPS))
        np.arange(4 * 8 * 64 * 2, dtype="<i2").tofile(folder / "walk.bin")
        return folder / "walk.bin"
    file_name, write = FILES[name]
    write(folder / file_name)
    return folder / file_name


def _options(name):
    return {"carrier_hz": 24e9, **({} if name == "wav" else {"prf_hz": 100.0})} if name in PLAIN else {}


@pytest.mark.parametrize("name", RADAR_READERS)
def test_every_radar_reader_keeps_its_contract(name, tmp_path):
    check_radar_reader(name, _sample_file(name, tmp_path / "data"), **_options(name))


@pytest.mark.parametrize("name", RADAR_READERS)
def test_any_damage_to_a_file_of_a_recording_is_read_or_refused_by_its_folder(name, tmp_path):
    place, options = _sample_file(name, tmp_path / "data"), _options(name)
    files = [one for one in sorted((tmp_path / "data").rglob("*")) if one.is_file()]
    counts = [
        outcomes(lambda _: read_recording(place, format=name, **options), file, count=150 // len(files), seed=3)
        for file in files
    ]
    n_read, n_refused = (sum(column) for column in zip(*counts, strict=True))
    assert n_read > 0
    assert n_refused > 0


def test_a_file_in_the_current_folder_is_checked(tmp_path, monkeypatch):
    place = _sample_file("doppelgait", tmp_path / "data")
    monkeypatch.chdir(place.parent)
    check_radar_reader("doppelgait", place.name)


@pytest.mark.parametrize("name", RADAR_WRITERS)
def test_every_radar_writer_keeps_its_contract(name):
    check_radar_writer(name, _recording(), **WRITERS[name])


def _read_walk(path, *, prf_hz=100.0):
    content = path.read_bytes()
    values = np.frombuffer(content[4:], np.complex64)
    radar = Radar(waveform="cw", name="walk", carrier_hz=24e9, prf_hz=prf_hz, range_stop_m=10.0)
    times_s = np.arange(values.size) / prf_hz
    return label_measured(path, values[:, None], radar=radar, slow_time_s=times_s, range_m=radar.range_axis_m())


def _read_safely(path, *, prf_hz=100.0):
    try:
        return _read_walk(path, prf_hz=prf_hz)
    except ValueError as error:
        raise RecordingError(f"{path}: {error}") from None


RATES_HZ = iter(range(100, 200))
SNIFF = {"sniff": lambda path, head: head[:4] == b"WALK"}


@pytest.mark.parametrize(
    ("read", "facts", "message"),
    [
        (_read_safely, {}, None),
        (_read_walk, {}, r"damaged file \(half\) raises ValueError|damaged file \(noise\)|not a RecordingError"),
        (
            lambda path, prf_hz=100.0: _read_safely(path, prf_hz=prf_hz),
            {},
            r"are not keyword-only",
        ),
        (lambda path: _read_safely(path, prf_hz=float(next(RATES_HZ))), {}, "gives another recording"),
        (_read_safely, {"sniff": lambda path, head: False}, "recognised by no reader"),
        (_read_safely, {"sniff": lambda path, head: True}, "not its own"),
        (_read_safely, {"sniff": lambda path, head: head[0] == b"W"[0]}, "sniff raises"),
    ],
)
def test_a_broken_radar_reader_is_caught(register, tmp_path, read, facts, message):
    register("radar_reader", "walk", suffixes=(".walk",), **{**SNIFF, **facts})(read)
    (tmp_path / "data").mkdir()
    path = tmp_path / "data" / "a.walk"
    path.write_bytes(b"WALK" + np.arange(65, dtype=np.complex64).tobytes())
    with pytest.raises(AssertionError, match=message) if message else nullcontext():
        check_radar_reader("walk", path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("scale", "the baseband differs"),
        ("clock", "gives other bytes"),
        ("open", "not an OutputError"),
        ("suffix", "suffix '.h5' is taken by"),
        ("nothing", "makes no file"),
    ],
)
def test_a_broken_radar_writer_is_caught(register, change, message):
    count = iter(range(9))

    def write(recording, path):
        if change == "nothing":
            return
        if change == "open":
            path.open("wb").close()
        if change == "scale":
            recording = Recording.from_baseband(recording.baseband * np.complex64(1.01), recording.radar)
        if change == "clock":
            recording = replace(recording, notes=[str(next(count))])
        write_recording(recording, path)

    register("radar_writer", "own", suffix=".h5" if change == "suffix" else ".own")(write)
    with pytest.raises(AssertionError, match=message):
        check_radar_writer("own", _recording())
