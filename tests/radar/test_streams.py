"""Live streams: every transport end to end, and what goes wrong on the way."""

import json
import os
import socket
import struct
import threading
import warnings
import zlib
from contextlib import ExitStack, nullcontext, suppress
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from doppelgait.core.errors import ConfigError, DoppelgaitWarning, RecordingError
from doppelgait.radar import Radar, Recording, open_stream, read_recording, write_arrays, write_recording
from doppelgait.radar import frames as dgf
from doppelgait.radar.simulate import label_baseband
from doppelgait.radar.streams import Stream
from doppelgait.radar.xethru.writer import write_xethru_recording
from processes import join, wait_until

N_FRAMES, PRF_HZ = 400, 500.0
SESSION = {"session_id": "a", "start_time": datetime(2020, 5, 1, 12, tzinfo=UTC)}


def make_recording(n_frames: int = N_FRAMES, **changes: object) -> Recording:
    radar = Radar.preset("x4", **{"prf_hz": PRF_HZ, "range_stop_m": 1.0, **changes})
    rng = np.random.default_rng(7)
    shape = (n_frames, radar.n_range_bins)
    rows = (rng.normal(size=shape) + 1j * rng.normal(size=shape)).astype(np.complex64)
    return Recording.from_baseband(label_baseband(rows, radar.frame_time_s(np.arange(n_frames)), radar), radar)


RECORDING = make_recording()
ROWS = RECORDING.samples.matrix
OPENING = dgf.encode_header(dgf.make_recording_header(RECORDING))


def frames(first: int = 0, stop: int = N_FRAMES, *, clock_s: float = 0.0) -> bytes:
    return b"".join(dgf.encode_frame(i, clock_s + i / PRF_HZ, ROWS[i]) for i in range(first, stop))


def take(stream: Stream, *, closes: bool = True) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Everything of a stream: times, rows, messages."""
    with stream if closes else nullcontext(), warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        items = list(stream)
    texts = [str(one.message) for one in caught if one.category is DoppelgaitWarning]
    rows = np.stack([row for _, row in items]) if items else np.empty((0, 0))
    return np.array([time_s for time_s, _ in items]), rows, texts


def play(folder: Path, *records: bytes) -> tuple[Stream, np.ndarray, np.ndarray, list[str]]:
    """Stream a file of these records, and take everything of it."""
    path = folder / "walk.dgf"
    path.write_bytes(OPENING + b"".join(records) + dgf.END_RECORD)
    stream = open_stream(path, timeout_s=0)
    return stream, *take(stream)


def connect(stream: Stream) -> socket.socket:
    kind, _, address = stream.source.partition("://")
    made = socket.socket(socket.AF_INET, socket.SOCK_STREAM if kind == "tcp" else socket.SOCK_DGRAM)
    made.settimeout(10)
    made.connect((address.split(":")[0], int(address.split(":")[1])))
    return made


def send_all(stream: Stream, *records: bytes) -> None:
    """Send records as datagrams, or one after the other, and close."""
    with connect(stream) as sender:
        for record in records:
            sender.sendall(record)


def assert_whole(times_s: np.ndarray, rows: np.ndarray) -> None:
    np.testing.assert_array_equal(times_s, RECORDING.slow_time_s)
    np.testing.assert_array_equal(rows, ROWS)


@pytest.mark.parametrize(("counters", "kept", "text"), [
    ([5, 6, 6, 7, 8], [5, 6, 7, 8], "1 frames came out of order or twice"),
    ([105, 106, 107, 0, 1], [105, 106, 107, 0, 1], "1 places, first from 107 to 0: another start of the sender"),
])  # fmt: skip
def test_a_counter_that_does_not_go_on_is_said_and_time_goes_on(tmp_path, counters, kept, text):
    path = tmp_path / "twice.dgf"
    path.write_bytes(OPENING + b"".join(dgf.encode_frame(counter, 0.0, ROWS[counter]) for counter in counters))
    with pytest.warns(DoppelgaitWarning, match=text):
        back = read_recording(path)
    np.testing.assert_array_equal(back.samples.matrix, ROWS[kept])
    np.testing.assert_allclose(back.slow_time_s, np.arange(len(kept)) / PRF_HZ, atol=1e-12)


@pytest.mark.parametrize("base", [2**53, 2**63 - 2, 2**64 - 40])
def test_large_counters_are_exact(tmp_path, base):
    sent = [*range(8), *range(9, 40)]
    _, times_s, rows, _ = play(tmp_path, *(dgf.encode_frame(base + n, n / PRF_HZ, ROWS[n]) for n in sent))
    np.testing.assert_allclose(times_s, np.array(sent) / PRF_HZ, atol=1e-12)
    np.testing.assert_array_equal(rows, ROWS[sent])
    with pytest.warns(DoppelgaitWarning, match="1 of 40 pulses are missing"):
        back = read_recording(tmp_path / "walk.dgf")
    np.testing.assert_allclose(back.slow_time_s, np.arange(40) / PRF_HZ, atol=1e-12)


@pytest.mark.parametrize(
    ("clock_s", "said"),
    [
        (np.arange(3000) / PRF_HZ + 0.5 * (np.arange(3000) > 500), "the sender's times are uneven"),
        (np.cumsum(np.where(np.arange(12_000) < 3000, 1.0, 1.02)) / PRF_HZ, "the rate is 49"),
    ],
)
def test_a_clock_that_is_set_or_changes_later_does_not_overrule_the_header(tmp_path, clock_s, said):
    _, times_s, _, texts = play(tmp_path, *(dgf.encode_frame(n, time_s, ROWS[0]) for n, time_s in enumerate(clock_s)))
    np.testing.assert_allclose(np.diff(times_s), 1 / PRF_HZ, rtol=1e-9)
    assert any(said in text for text in texts)


@pytest.mark.parametrize("true_hz", [90.0, 502.0, 625.0])
def test_the_rate_of_the_senders_clock_is_taken_where_the_header_is_wrong(tmp_path, true_hz):
    content = [dgf.encode_frame(n, n / true_hz, ROWS[n % N_FRAMES]) for n in range(2000)]
    (tmp_path / "slow.dgf").write_bytes(OPENING + b"".join(content) + dgf.END_RECORD)
    stream = open_stream(tmp_path / "slow.dgf")
    expected_hz = PRF_HZ if true_hz == 502.0 else true_hz  # within 0.5 %
    assert stream.radar.prf_hz == pytest.approx(expected_hz, rel=1e-6)
    times_s, rows, texts = take(stream)
    np.testing.assert_allclose(times_s, np.arange(2000) / expected_hz, rtol=1e-6)
    assert len(rows) == 2000
    assert [f"the sender's times {true_hz:g} Hz" in text for text in texts] == [True] * (true_hz != 502.0)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        assert read_recording(tmp_path / "slow.dgf").radar.prf_hz == pytest.approx(expected_hz, rel=1e-6)
    assert len(caught) == len(texts)


def test_a_rate_that_a_socket_does_not_allow_is_not_taken_from_the_clock(monkeypatch):
    monkeypatch.setattr("doppelgait.radar.streams.MAX_RATE", 8 * ROWS.shape[1] * 600)
    stream = open_stream("tcp://:0")
    sent = b"".join(dgf.encode_frame(i, i / 800.0, ROWS[i % N_FRAMES]) for i in range(1800))
    send_all(stream, OPENING + sent + dgf.END_RECORD)
    assert any("800 Hz, too many" in text for text in take(stream)[2])
    assert stream.radar.prf_hz == PRF_HZ


def test_a_file_of_frames_is_read_and_streamed_as_written(tmp_path):
    path = tmp_path / "walk.dgf"
    dgf.write_frames(RECORDING, path)
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


def test_any_recording_is_streamed(tmp_path):
    for name, write in (("walk.h5", write_recording), ("walk.npz", write_arrays)):
        write(RECORDING, tmp_path / name)
        assert_whole(*take(open_stream(tmp_path / name, timeout_s=0))[:2])
    folder = write_xethru_recording(RECORDING, tmp_path, data_type="radar_baseband_float", **SESSION)
    for path in (folder, folder / "xethru_recording_meta.dat"):
        assert len(take(open_stream(path, timeout_s=0))[0]) == N_FRAMES


def test_a_file_of_something_else_is_refused(tmp_path):
    (tmp_path / "notes.txt").write_text("nothing that a radar said")
    with pytest.raises(RecordingError, match=r"without a header; .*no record"):
        _ = open_stream(tmp_path / "notes.txt", timeout_s=0).radar


def test_the_format_is_the_documented_one():
    payload = struct.pack("<Qd", 5, 0.25) + np.array([1 + 2j, 3 - 4j], "<c8").tobytes()
    checked = struct.pack("<BBHI", 1, 2, 0, len(payload)) + payload
    literal = b"DGfr" + checked + struct.pack("<I", zlib.crc32(checked))
    assert dgf.encode_frame(5, 0.25, np.array([1 + 2j, 3 - 4j])) == literal
    assert dgf.END_RECORD[5] == 3


def test_tcp_listens_on_this_machine_and_takes_all_frames():
    stream = open_stream("tcp://:0")
    assert stream.source.startswith("tcp://127.0.0.1:")
    threading.Thread(target=send_all, args=(stream, OPENING + frames() + dgf.END_RECORD)).start()
    assert_whole(*take(stream)[:2])


def test_standard_input_takes_all_frames(monkeypatch):
    read_end, write_end = os.pipe()
    with os.fdopen(read_end, "rb") as source:
        monkeypatch.setattr("sys.stdin", source)
        stream = open_stream("-", queue_s=0.1)  # far shorter than the stream: the pipe waits

        def send() -> None:
            with os.fdopen(write_end, "wb") as pipe:
                pipe.write(OPENING + frames() + dgf.END_RECORD)

        threading.Thread(target=send).start()
        assert_whole(*take(stream)[:2])
        assert stream.counts.dropped == 0


def grow(path: Path, content: bytes, parts: int = 5) -> threading.Thread:
    """Append to a file in parts that end anywhere."""
    path.write_bytes(b"")
    edges = np.linspace(0, len(content), parts + 1).astype(int)

    def write() -> None:
        with path.open("ab", buffering=0) as file:
            for first, stop in pairwise(edges):
                file.write(content[first:stop])

    thread = threading.Thread(target=write)
    thread.start()
    return thread


def write_xethru_data(folder: Path, n_frames: int) -> Path:
    """Write a recording as XeThru files; the data file."""
    options = {"data_type": "radar_baseband_float", **SESSION}
    (data,) = write_xethru_recording(make_recording(n_frames), folder, **options).glob("xethru_radar_baseband_*.dat")
    return data


def test_a_growing_xethru_file_gives_what_its_reader_gives(tmp_path):
    data = write_xethru_data(tmp_path, 60)
    wanted = read_recording(data.parent)
    grown = tmp_path / data.name
    grow(grown, data.read_bytes())
    stream = open_stream(grown, timeout_s=1.0)
    times_s, rows, texts = take(stream)
    np.testing.assert_array_equal(rows, wanted.samples.matrix)
    np.testing.assert_allclose(times_s, wanted.slow_time_s, rtol=0, atol=1e-9)
    np.testing.assert_allclose(stream.range_m, wanted.range_m, rtol=0, atol=1e-9)
    assert stream.radar == wanted.radar
    assert not texts
    data.write_bytes(data.read_bytes()[:-7])
    stream = open_stream(data, timeout_s=0)
    _, rows, texts = take(stream)
    assert len(rows) == 59
    assert stream.counts.malformed == 1
    assert "bytes are no whole record" in texts[0]


def test_a_xethru_record_that_declares_gigabytes_is_refused(tmp_path):
    data = write_xethru_data(tmp_path, 3)
    content = bytearray(data.read_bytes())
    struct.pack_into("<I", content, 4, 2**31)
    data.write_bytes(content)
    stream = open_stream(data, timeout_s=0)
    with pytest.raises(RecordingError, match="declares 2,147,483,648 values"):
        list(stream)


def oracle(content: bytes, n_bins: int) -> list[int]:
    """Counters of the whole frames in damaged bytes, by looking at every byte."""
    size, found, at = 16 + 8 * n_bins, [], 0
    while at + 16 + size <= len(content):
        head = content[at : at + 12]
        whole = content[at + 4 : at + 12 + size]
        (check,) = struct.unpack_from("<I", content, at + 12 + size)
        if head == b"DGfr" + struct.pack("<BBHI", 1, 2, 0, size) and check == zlib.crc32(whole):
            found.append(struct.unpack_from("<Q", content, at + 12)[0])
            at += 16 + size
        else:
            at += 1
    return found


@pytest.mark.parametrize("seed", range(3))
def test_damaged_bytes_cost_only_their_frames(tmp_path, seed):
    rng = np.random.default_rng(seed)
    content = bytearray(frames())
    for _ in range(12):
        at = int(rng.integers(len(content)))
        kind = rng.integers(4)
        if kind == 0:
            content[at] ^= 1 << int(rng.integers(8))
        elif kind == 1:
            del content[at : at + int(rng.integers(1, 3000))]
        elif kind == 2:
            content[at:at] = rng.integers(0, 256, int(rng.integers(1, 3000)), dtype=np.uint8).tobytes()
        else:
            content[at:at] = b"DGfr\x01\x02\x00\x00\xff\xff\xff\xff"
    wanted = oracle(bytes(content), ROWS.shape[1])
    stream, times_s, rows, texts = play(tmp_path, content)
    np.testing.assert_array_equal(rows, ROWS[wanted])
    np.testing.assert_allclose(times_s, RECORDING.slow_time_s[wanted], rtol=0, atol=1e-12)
    counts = stream.counts
    assert counts.received == len(wanted)
    assert counts.missing == wanted[-1] - wanted[0] + 1 - len(wanted)
    assert 0 < counts.malformed <= 24
    assert sum("malformed" in text for text in texts) == 1
    assert sum("missing" in text for text in texts) == 1


def test_frames_of_another_radar_are_refused_with_both_values(tmp_path):
    other = dgf.encode_header(dgf.make_recording_header(make_recording(2, carrier_hz=8.748e9)))
    path = tmp_path / "walk.dgf"
    path.write_bytes(OPENING + frames(0, 5) + other + frames(5, 10) + dgf.END_RECORD)
    stream = open_stream(path)
    assert len([next(stream) for _ in range(5)]) == 5
    with pytest.raises(RecordingError, match=r"refused: carrier_hz is 8\.748e\+09, expected is 7\.29e"):
        next(stream)
    with pytest.raises(RecordingError, match=r"has frames of two radars: carrier_hz is 8\.748e"):
        read_recording(path)
    stream = open_stream(path, expect=Radar.preset("x4", prf_hz=250.0))
    with pytest.raises(RecordingError, match="prf_hz is 500, expected is 250"):
        _ = stream.radar


def test_a_clock_that_jumps_is_counted_and_the_counter_decides(tmp_path):
    late = frames(100, 200, clock_s=3600.0), frames(200, 400, clock_s=-50.0)
    stream, times_s, rows, texts = play(tmp_path, frames(0, 100), *late)
    assert_whole(times_s, rows)
    assert stream.counts.jumps == 2
    assert len(texts) == 1
    assert "clock jumps from 0.198 to 3600.2 s at frame 100" in texts[0]


N = N_FRAMES
AS_SENT = list(range(N))
ORDERS = {  # counters as they come, how many are left out, how many are put back into their places
    "each twice": ([n for n in AS_SENT for _ in range(2)], N, 0),
    "neighbours exchanged": ([n ^ 1 for n in AS_SENT], 0, N // 2),
    "backwards in twenties": ([n + 19 - 2 * (n % 20) for n in AS_SENT], 0, N - N // 20),
    "half a second again": ([*range(300), *range(50, 300), *range(300, N)], 250, 0),
    "one from far ahead": ([*range(100), 350, *range(100, N)], 1, 1),
    "twice and exchanged": ([n ^ 1 for n in AS_SENT for _ in range(2)], N, N // 2),
}


@pytest.mark.parametrize("kind", ORDERS)
def test_frames_come_in_order_and_once_however_they_are_sent(tmp_path, kind):
    counters, repeated, late = ORDERS[kind]
    stream, times_s, rows, _ = play(tmp_path, *(dgf.encode_frame(n, n / PRF_HZ, ROWS[n]) for n in counters))
    assert_whole(times_s, rows)
    counts = stream.counts
    assert (counts.repeated, counts.late, counts.jumps, counts.missing) == (repeated, late, 0, 0)


CLOCKS = {  # counters and clocks from frame 100 on, the time that goes on there, and what is missing
    "counter far ahead, clock not": (5100, 100 / PRF_HZ, 1 / PRF_HZ, 0),
    "both ahead": (1100, 1100 / PRF_HZ, 1001 / PRF_HZ, 1000),
    "restart, clock goes on": (0, 3.0, 3.0 - 99 / PRF_HZ, 0),
    "restart of both": (0, 0.0, 1 / PRF_HZ, 0),
}


@pytest.mark.parametrize("kind", CLOCKS)
def test_the_senders_clock_is_compared_with_the_counter(tmp_path, kind):
    counter, clock_s, gap_s, missing = CLOCKS[kind]
    later = (dgf.encode_frame(counter + n, clock_s + n / PRF_HZ, ROWS[n]) for n in range(100))
    stream, times_s, _, _ = play(tmp_path, frames(0, 100), *later)
    assert len(times_s) == 200
    assert times_s[100] - times_s[99] == pytest.approx(gap_s)
    assert (stream.counts.missing, stream.counts.jumps) == (missing, int(kind != "both ahead"))


def head(kind: int, length: int) -> bytes:
    return b"DGfr" + struct.pack("<BBHI", 1, kind, 0, length)


LONG = Radar.preset("x4-long", range_stop_m=5139.0)  # 99,972 bins
WIDE = dgf.encode_header(dgf.Header(LONG, LONG.range_axis_m()))
DAMAGE = {  # what the stream begins with, and what is repeated
    "heads of headers": (b"", head(1, 65_000)),
    "heads of short headers": (OPENING, head(1, 12) + b"{"),
    "heads of frames": (OPENING, head(2, 16 + 8 * ROWS.shape[1])),
    "heads of long frames": (WIDE, head(2, 16 + 8 * LONG.n_range_bins)),
    "heads of ends": (OPENING, head(3, 0)),
    "heads of nothing": (OPENING, head(7, 0)),
    "starts of heads": (OPENING, b"DGfr"),
    "whole frames between": (OPENING, frames(0, 1) + 16 * head(1, 65_000)),
}


@pytest.mark.parametrize("last", [False, True], ids=["stream", "datagrams"])
@pytest.mark.parametrize("kind", DAMAGE)
def test_the_work_on_damaged_bytes_is_bounded(kind, last, monkeypatch):
    """Checksums of 0.3 ns a byte and 2 us a call: 0.05 s of processor a megabyte are far above this."""
    work = [0, 0]

    def count(content: bytes, *start: int) -> int:
        work[:] = work[0] + 1, work[1] + len(content)
        return zlib.crc32(content, *start)

    opening, damage = DAMAGE[kind]
    content = opening + damage * (2_000_000 // len(damage))
    parser = dgf.FrameParser("test")
    monkeypatch.setattr("doppelgait.radar.frames.zlib", SimpleNamespace(crc32=count))
    for at in range(0, len(content), 60_000):
        list(parser.feed(content[at : at + 60_000], last=last))
    assert parser.malformed
    calls, checked = work
    assert calls < 12_000
    assert checked < 90e6


def test_of_a_slow_consumer_the_oldest_frames_are_dropped():
    stream = open_stream("tcp://:0", queue_s=0.1)
    send_all(stream, OPENING + frames() + dgf.END_RECORD)
    wait_until(lambda: stream.counts.received >= N_FRAMES)  # the consumer has not begun yet
    times_s, rows, texts = take(stream)
    np.testing.assert_array_equal(rows, ROWS[-50:])
    np.testing.assert_allclose(times_s, RECORDING.slow_time_s[-50:], rtol=0, atol=1e-12)
    assert stream.counts.dropped == N_FRAMES - 50
    assert sum("too slow" in text for text in texts) == 1


OTHER = dgf.encode_header(dgf.make_recording_header(make_recording(2, prf_hz=250.0)))
STRANGERS = {  # what a client sends before the sensor comes, and while it sends
    "nothing": b"",
    "garbage": b"GET / HTTP/1.0\r\n\r\n",
    "much garbage": bytes(200_000),
    "a frame without a header": frames(0, 1),
    "a damaged header": OPENING[:-1] + b"x",
    "a header of nothing": dgf.encode_record(1, b"{}"),
    "another version": b"DGfr\x07" + OPENING[5:],
    "an end": dgf.END_RECORD,
}


def send(client: socket.socket, *records: bytes) -> None:
    """Send without minding that the receiver has closed the connection."""
    for record in records:
        for at in range(0, len(record), 60_000):
            with suppress(ConnectionError):
                client.send(record[at : at + 60_000])


@pytest.mark.parametrize("ends", [False, True], ids=["stays", "closes"])
@pytest.mark.parametrize("sent", STRANGERS)
@pytest.mark.parametrize("transport", ["tcp", "udp"])
def test_strangers_end_nothing_and_the_sensor_comes_back(transport, sent, ends):
    stream = open_stream(f"{transport}://:0", timeout_s=2.0, once=False)
    with ExitStack() as clients:
        for first in (0, 100, 200):
            early, sensor, late = (clients.enter_context(connect(stream)) for _ in range(3))
            send(early, STRANGERS[sent])
            if ends:
                early.close()
            send(sensor, OPENING, frames(first, first + 60))
            wait_until(lambda stream=stream: stream.waiting)
            send(late, STRANGERS[sent], OTHER, OPENING + frames(300, 301), dgf.END_RECORD)
            with suppress(ConnectionError):  # by TCP, the receiver closes the connection
                assert transport == "udp" or late.recv(1) == b""
            wait_until(lambda stream=stream: stream.counts.refused)
            send(sensor, frames(first + 60, first + 90), dgf.END_RECORD)
            _, rows, texts = take(stream, closes=False)
            np.testing.assert_array_equal(rows, ROWS[first : first + 90])
            assert stream.complete
            said = [text.partition(" are refused: ")[2] for text in texts if " are refused: " in text]
            assert 0 < len(said) == len(set(said)) <= 3  # each once
            assert stream.counts.refused >= (1 if transport == "tcp" else 3)
            stream = stream.next_run()
        stream.close()


@pytest.mark.parametrize("transport", ["tcp", "udp"])
def test_a_sensor_that_is_silent_gives_its_place_to_one_that_sends(transport):
    stream = open_stream(f"{transport}://:0", timeout_s=100.0, once=False)
    done = threading.Event()
    with connect(stream) as lost, connect(stream) as again:
        send(lost, OPENING, frames(0, 60))
        wait_until(lambda: stream.waiting)
        sending = threading.Thread(
            target=lambda: [done.wait(0.1) or send(again, OPENING + frames(60, 61)) for _ in range(30)]
        )
        sending.start()
        _, rows, texts = take(stream, closes=False)
        assert (len(rows), stream.complete) == (60, False)
        assert any("stopped without an end record after 60 frames" in text for text in texts)
        following = stream.next_run()
        done.set()
        send(again, dgf.END_RECORD)
        np.testing.assert_array_equal(take(following, closes=False)[1][0], ROWS[60])
        join(sending)
        following.next_run().close()


REFUSALS = {
    b"": "closed before its first frame",
    b"DGfr\x07" + OPENING[5:]: "has version 7 of the format; only 1 is read",
    dgf.encode_record(1, b"{}"): "the header must have the keys carrier_hz",
    WIDE: "a second or a burst (range_bins x prf_hz x 8 bytes) has more than 16,777,216 bytes",
}


@pytest.mark.parametrize("again_s", [60.0, 0.0])
def test_every_different_refusal_is_said_once_and_later_with_its_number(monkeypatch, again_s):
    monkeypatch.setattr("doppelgait.radar.streams.AGAIN_S", again_s)
    stream = open_stream("tcp://:0", timeout_s=5.0, once=False)
    for number, sent in enumerate([*REFUSALS, *REFUSALS]):
        send_all(stream, sent)
        wait_until(lambda number=number: stream.counts.refused > number)
    send_all(stream, OPENING + frames(0, 2) + dgf.END_RECORD)
    said = [text for text in take(stream)[2] if "connections of 127.0.0.1:" in text]
    assert len(said) == (4 if again_s else 8)
    for text, reason in zip(said, [*REFUSALS.values(), *REFUSALS.values()], strict=False):
        assert f" are refused: {reason}" in text
    assert all("(2 times by now)" in text for text in said[4:])


@pytest.mark.parametrize("sent", [b"", OPENING])
def test_the_17th_client_takes_the_place_of_the_oldest_without_a_frame(sent):
    stream = open_stream("tcp://:0", timeout_s=100.0, once=False)
    with ExitStack() as clients:
        oldest, *others = [clients.enter_context(connect(stream)) for _ in range(16)]
        for client in (oldest, *others):
            send(client, sent)
        send(clients.enter_context(connect(stream)), OPENING + frames())
        with suppress(ConnectionResetError):  # where its header was not read yet
            assert oldest.recv(1) == b""
        wait_until(lambda: stream.waiting)
        stream.close()
        assert [text for text in take(stream)[2] if text.endswith("are refused: there are 16 others")]


@pytest.mark.parametrize("transport", ["tcp", "udp"])
def test_of_a_client_without_a_frame_one_header_is_kept(transport, monkeypatch):
    read, parse_header = [], dgf.parse_header
    monkeypatch.setattr(dgf, "parse_header", lambda *given: read.append(given) or parse_header(*given))
    headers = [dgf.Header(RECORDING.radar, RECORDING.range_m + 1e-10 * number) for number in range(200)]
    stream = open_stream(f"{transport}://:0", timeout_s=100.0, once=False)
    with stream, connect(stream) as client:
        send(client, *map(dgf.encode_header, headers))
        wait_until(lambda: stream.counts.refused == (1 if transport == "tcp" else 199))
        assert len(read) == 2


def test_clients_that_send_nothing_are_dropped_and_counted():
    stream = open_stream("tcp://:0", timeout_s=1.0, once=False)
    with ExitStack() as clients:
        silent = [clients.enter_context(connect(stream)) for _ in range(20)]
        assert [client.recv(1) for client in silent] == [b""] * 20
        wait_until(lambda: stream.counts.refused == 20)
        stream.close()
        take(stream)
        with pytest.raises(RecordingError, match="ended without a header"):
            _ = stream.radar


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"range_bins": 2**31}, "range_bins of the header = 2147483648 is not allowed"),
        ({"carrier_hz": float("nan")}, "carrier_hz of the header = nan"),
        ({"radar": "/etc/radar.toml"}, "neither a table nor one of the presets"),
        ({"radar": "x4", "carrier_hz": 60e9}, "is that of another radar than x4"),
        ({"radar": {"path": 1}}, "radar"),
        ({"prf_hz": 400.0}, "states prf_hz = 400, its radar 500"),
        ({"extra": 1}, "must have the keys"),
        ({"range_bins": 21}, "the header states 21 range bins, its radar 20"),
    ],
)
def test_a_header_that_is_not_allowed_is_refused(tmp_path, change, message):
    header = dgf.make_recording_header(RECORDING)
    table = {**header.facts, "range_bins": 20, "radar": header.radar.model_dump(mode="json"), **change}
    path = tmp_path / "walk.dgf"
    path.write_bytes(dgf.encode_record(1, json.dumps(table).encode()))
    with pytest.raises(RecordingError, match=message):
        _ = open_stream(path, timeout_s=0).radar


def test_a_header_with_a_preset_needs_no_table(tmp_path):
    table = {"carrier_hz": 7.29e9, "prf_hz": 400.0, "range_start_m": 0.4, "bin_spacing_m": 0.0514, "range_bins": 20}
    path = tmp_path / "walk.dgf"
    path.write_bytes(dgf.encode_record(1, json.dumps({**table, "radar": "x4"}).encode()))
    with open_stream(path, timeout_s=0) as stream:
        assert stream.radar.name == Radar.preset("x4").name
        assert stream.radar.prf_hz == 400.0
        np.testing.assert_allclose(stream.range_m, 0.4 + 0.0514 * np.arange(20))


@pytest.mark.parametrize("length", [5, 20, 100])
def test_whole_frames_behind_one_that_was_cut_off_are_kept(tmp_path, length):
    cut = dgf.encode_frame(399, 0.0, np.zeros(20))[:length]
    stream, _, rows, texts = play(tmp_path, frames(0, 5), cut)
    np.testing.assert_array_equal(rows, ROWS[:5])
    assert stream.counts.malformed == 1
    assert not any("end record" in text for text in texts)
    wide = dgf.encode_header(dgf.Header(LONG, np.arange(200) * 0.05))  # a frame as long as what follows it
    long = [dgf.encode_frame(i, i / PRF_HZ, np.full(200, i)) for i in range(8)]
    path = tmp_path / "walk.dgf"
    path.write_bytes(wide + b"".join(long[:5]) + long[5][:length] + long[6] + long[7])
    with pytest.warns(DoppelgaitWarning):
        assert read_recording(path).n_pulses == 8  # the lost one is filled in


@pytest.mark.parametrize(
    ("source", "error", "message"),
    [
        ("tcp://localhost", ConfigError, "give tcp://HOST:PORT"),
        ("udp://:99999", ConfigError, "give udp://HOST:PORT"),
        ("tcp://203.0.113.7:5", RecordingError, "cannot be opened"),
        ("absent.dgf", RecordingError, "is no file and no recording"),
    ],
)
def test_sources_that_cannot_be_opened(source, error, message):
    with pytest.raises(error, match=message):
        open_stream(source)


def test_a_sensor_in_bursts_begins_with_a_whole_one():
    recording = make_recording(64, burst_pulses=16, burst_period_s=0.1)
    rows, stream = recording.samples.matrix, open_stream("udp://:0")
    late = [dgf.encode_frame(i, 3.0 + float(recording.slow_time_s[i]), rows[i]) for i in range(5, 64)]
    send_all(stream, dgf.encode_header(dgf.make_recording_header(recording)), *late, dgf.END_RECORD)
    times_s, found, texts = take(stream)
    np.testing.assert_array_equal(found, rows[16:])
    np.testing.assert_allclose(times_s, 3.0 + recording.radar.frame_time_s(np.arange(16, 64)), rtol=0, atol=1e-12)
    assert (texts, stream.counts.missing) == ([], 0)
