"""Live streams: every transport end to end, and what goes wrong on the way."""

from __future__ import annotations

import os
import socket
import struct
import threading
import warnings
import zlib

import numpy as np

import doppelgait as dg
from doppelgait.core.errors import DoppelgaitWarning
from doppelgait.radar import Radar, Recording, open_stream, read_recording, write_recording
from doppelgait.radar.frames import END_RECORD, frame_record, header_record, recording_header, write_frames
from doppelgait.radar.streams import Stream

N_FRAMES, PRF_HZ = 400, 500.0


def make_recording(n_frames: int = N_FRAMES, **changes: object) -> Recording:
    radar = Radar.preset("x4", **{"prf_hz": PRF_HZ, "range_stop_m": 1.0, **changes})
    rng = np.random.default_rng(7)
    shape = (n_frames, radar.n_range_bins)
    rows = (rng.normal(size=shape) + 1j * rng.normal(size=shape)).astype(np.complex64)
    coords = {"slow_time": np.arange(n_frames) / radar.prf_hz, "range": radar.range_axis_m()}
    return Recording.from_baseband(dg.core.labels.make_array(dg.core.labels.BASEBAND, rows, coords), radar)


RECORDING = make_recording()
ROWS = RECORDING.samples.matrix
OPENING = header_record(recording_header(RECORDING))


def frames(first: int = 0, stop: int = N_FRAMES, *, clock_s: float = 0.0) -> bytes:
    return b"".join(frame_record(i, clock_s + i / PRF_HZ, ROWS[i]) for i in range(first, stop))


def take(stream: Stream) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Everything of a stream: times, rows, messages."""
    with stream, warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        items = list(stream)
    texts = [str(one.message) for one in caught if one.category is DoppelgaitWarning]
    rows = np.stack([row for _, row in items]) if items else np.empty((0, 0))
    return np.array([time_s for time_s, _ in items]), rows, texts


def send_tcp(stream: Stream, content: bytes, *, reset: bool = False) -> None:
    host, port = stream.source.removeprefix("tcp://").split(":")
    with socket.create_connection((host, int(port)), timeout=10) as sender:
        if reset:  # as the system does for a process that is killed with data on the way
            sender.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        sender.sendall(content)


def send_udp(stream: Stream, datagrams: list[bytes], sender: socket.socket | None = None) -> None:
    host, port = stream.source.removeprefix("udp://").split(":")
    own = socket.socket(socket.AF_INET, socket.SOCK_DGRAM) if sender is None else sender
    for datagram in datagrams:
        own.sendto(datagram, (host, int(port)))
    if sender is None:
        own.close()


def assert_whole(times_s: np.ndarray, rows: np.ndarray) -> None:
    np.testing.assert_array_equal(times_s, RECORDING.slow_time_s)
    np.testing.assert_array_equal(rows, ROWS)


def test_a_file_of_frames_is_read_and_streamed_as_written(tmp_path):
    path = tmp_path / "walk.dgf"
    write_frames(RECORDING, path)
    back = read_recording(path)
    np.testing.assert_array_equal(back.samples.matrix, ROWS)
    np.testing.assert_array_equal(back.slow_time_s, RECORDING.slow_time_s)
    np.testing.assert_allclose(back.range_m, RECORDING.range_m, rtol=0, atol=1e-9)
    assert back.radar == RECORDING.radar
    stream = open_stream(path)
    assert stream.radar == RECORDING.radar
    times_s, rows, texts = take(stream)
    assert_whole(times_s, rows)
    assert not texts
    assert stream.counts.received == N_FRAMES
    assert stream.summary() == f"{path}: frames received 400"


def test_a_recording_in_hdf5_is_streamed_with_its_times(tmp_path):
    path = tmp_path / "walk.h5"
    write_recording(RECORDING, path)
    assert_whole(*take(open_stream(path, timeout_s=0))[:2])


def test_the_format_is_the_documented_one():
    payload = struct.pack("<Qd", 5, 0.25) + np.array([1 + 2j, 3 - 4j], "<c8").tobytes()
    checked = struct.pack("<BBHI", 1, 2, 0, len(payload)) + payload
    literal = b"DGfr" + checked + struct.pack("<I", zlib.crc32(checked))
    assert frame_record(5, 0.25, np.array([1 + 2j, 3 - 4j])) == literal
    assert END_RECORD[5] == 3


def test_tcp_listens_on_this_machine_and_takes_all_frames():
    stream = open_stream("tcp://:0")
    assert stream.source.startswith("tcp://127.0.0.1:")
    threading.Thread(target=send_tcp, args=(stream, OPENING + frames() + END_RECORD)).start()
    assert_whole(*take(stream)[:2])


def test_udp_takes_all_frames():
    stream = open_stream("udp://:0")
    datagrams = [OPENING, *(frames(i, i + 10) for i in range(0, N_FRAMES, 10)), END_RECORD]
    threading.Thread(target=send_udp, args=(stream, datagrams)).start()
    assert_whole(*take(stream)[:2])


def test_standard_input_takes_all_frames(monkeypatch):
    read_end, write_end = os.pipe()
    with os.fdopen(read_end, "rb") as source:
        monkeypatch.setattr("sys.stdin", source)
        stream = open_stream("-", queue_s=0.1)  # the queue is far shorter than the stream: the pipe waits

        def send() -> None:
            with os.fdopen(write_end, "wb") as pipe:
                pipe.write(OPENING + frames() + END_RECORD)

        threading.Thread(target=send).start()
        assert_whole(*take(stream)[:2])
        assert stream.counts.dropped == 0
