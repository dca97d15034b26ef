"""Contract checks of radar readers and writers: every built-in passes, and a broken one is caught."""

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest

from doppelgait.core.errors import RecordingError
from doppelgait.radar import RADAR_READERS, RADAR_WRITERS, Radar, Recording, write_recording
from doppelgait.radar.measured import label_measured
from doppelgait.testing import check_radar_reader, check_radar_writer
from recording_files import WRITERS, make_recording, sample_options, write_sample


@pytest.mark.parametrize("name", RADAR_READERS)
def test_every_radar_reader_keeps_its_contract(name, tmp_path):
    check_radar_reader(name, write_sample(name, tmp_path / "data"), **sample_options(name))


def test_a_file_in_the_current_folder_is_checked(tmp_path, monkeypatch):
    place = write_sample("doppelgait", tmp_path / "data")
    monkeypatch.chdir(place.parent)
    check_radar_reader("doppelgait", place.name)


@pytest.mark.parametrize("name", RADAR_WRITERS)
def test_every_radar_writer_keeps_its_contract(name):
    check_radar_writer(name, make_recording(), **WRITERS[name])


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
        (lambda path, prf_hz=100.0: _read_safely(path, prf_hz=prf_hz), {}, r"are not keyword-only"),
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
        check_radar_writer("own", make_recording())
