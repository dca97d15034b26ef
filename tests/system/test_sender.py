"""The example sender plays a recording over every transport."""

import subprocess
import sys
import time
from contextlib import AbstractContextManager
from typing import Any

import numpy as np
import pytest

from checkout import ROOT
from doppelgait.core.labels import BASEBAND, make_array
from doppelgait.radar import Radar, Recording, open_stream
from doppelgait.radar.frames import write_frames
from processes import LIMIT_S, started

N_FRAMES = 300


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> tuple[str, Recording]:
    radar = Radar.preset("x4", prf_hz=150.0, range_stop_m=3.0)
    rng = np.random.default_rng(5)
    rows = rng.normal(size=(N_FRAMES, radar.n_range_bins)).astype(np.complex64)
    coords = {"slow_time": np.arange(N_FRAMES) / radar.prf_hz, "range": radar.range_axis_m()}
    made = Recording.from_baseband(make_array(BASEBAND, rows, coords), radar)
    path = tmp_path_factory.mktemp("sender") / "walk.dgf"
    write_frames(made, path)
    return str(path), made


def start(path: str, target: str, speed: float = 10.0, **options: Any) -> AbstractContextManager[subprocess.Popen[Any]]:
    return started([sys.executable, str(ROOT / "examples/sender.py"), path, target, "--speed", str(speed)], **options)


@pytest.mark.parametrize("transport", ["tcp", "udp", "file", "-"])
def test_a_played_recording_arrives_whole(recording, transport, tmp_path, monkeypatch):
    path, made = recording
    (tmp_path / "grown.dgf").touch()
    source = {"-": "-", "file": str(tmp_path / "grown.dgf")}.get(transport, f"{transport}://:0")
    if transport == "-":
        with start(path, "-", stdout=subprocess.PIPE) as sender:
            monkeypatch.setattr("sys.stdin", sender.stdout)
            items, stream = _take(open_stream("-"))
    else:
        stream = open_stream(source, timeout_s=LIMIT_S)
        with start(path, stream.source) as sender:
            items, _ = _take(stream)
            assert sender.wait(timeout=LIMIT_S) == 0
    np.testing.assert_array_equal([time_s for time_s, _ in items], made.slow_time_s)
    np.testing.assert_array_equal(np.stack([row for _, row in items]), made.samples.matrix)
    assert (stream.counts.missing, stream.counts.malformed, stream.counts.jumps) == (0, 0, 0)


def _take(stream):
    with stream:
        return list(stream), stream


def test_a_sender_that_is_killed_ends_the_stream(recording):
    with open_stream("tcp://:0") as stream, start(recording[0], stream.source, speed=0.1) as sender:
        while not stream.waiting:  # the first frames wait until they show the sender's rate
            time.sleep(0.01)
        sender.kill()
        with pytest.warns(UserWarning, match="stopped without an end record"):
            assert 0 < len(list(stream)) < N_FRAMES
