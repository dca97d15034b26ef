"""Live frames from files, standard input and sockets, received by a thread into a bounded queue."""

from __future__ import annotations

import inspect
import math
import os
import select
import socket
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Self
from urllib.parse import urlsplit

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import ConfigError, RecordingError, warn_caller
from doppelgait.core.lazy import read_tiles
from doppelgait.radar.frames import (
    LARGEST_GAP,
    SETTLE_S,
    Frame,
    FrameParser,
    Header,
    find_rate_hz,
    make_header,
)
from doppelgait.radar.parameters import Radar
from doppelgait.radar.readers import find_formats, read_recording
from doppelgait.radar.recording import Recording
from doppelgait.radar.slow_time import MAX_DISORDER
from doppelgait.radar.xethru.convert import CONVERTIBLE, OPTIONS, Records, convert_records, read_xethru_recording
from doppelgait.radar.xethru.records import META_NAME, find_data_type_by_file, parse_records

LOCAL = "127.0.0.1"
CHUNK_BYTES = 1 << 16
POLL_S = 0.05
"""Polling interval, s, of a file that does not grow, and of the closed state of a stream."""
MAX_QUEUE_BYTES = 1 << 28
MAX_RF_VALUES = 1_000_000
"""Maximum number of values that a record may declare."""
FAR_S = 1.0
"""Minimum difference, s, of the sender's clock and the frame counter that counts as a jump of the clock."""
RECENT_S, MAX_RECENT = 10.0, 250
"""Time over which the rate of arriving frames is compared with that of the radar, and number of frames that are."""
CREDIBLE_START = 2.0
"""Ratio to the frames of this time after which a start ends, also if the clock does not advance."""
EXPECTED = ("carrier_hz", "prf_hz", "bin_spacing_m")
EXPECTED_TOLERANCE = 5e-3
"""Relative tolerance to an expected radar; drivers use c = 3e8 m/s for ranges and measure their frame rates."""


@dataclass
class Counts:
    """Numbers of received, missing and faulty frames of a stream."""

    received: int = 0
    missing: int = 0
    repeated: int = 0
    dropped: int = 0
    malformed: int = 0
    jumps: int = 0
    refused: int = 0


class Stream:
    """Iterate over frames as they arrive.

    A frame is (time in s, complex64 row in V). :func:`open_stream` makes the stream; as a context manager it closes its
    file or socket. The time follows from the frame counter: it is evenly spaced, with gaps for missing frames.

    Attributes
    ----------
    source : str
        Name of the source; for a socket it includes the chosen port.
    counts : Counts
    waiting : list of Frame
        First frames, until their times show the sender's rate.
    """

    def __init__(self, source: str, *, expect: Radar | None, timeout_s: float, queue_s: float) -> None:
        self.source, self.counts, self.timeout_s = source, Counts(), timeout_s
        self.closing = threading.Event()
        self.expected = None if expect is None else Header(expect, expect.range_axis_m())
        self._queue_s, self._size = queue_s, 1
        self._header: Header | None = None
        self._opening: Header | None = None
        self.waiting: list[Frame] = []  # until their times show the true rate
        self._clock: _Clock | None = None
        self._queue: deque[tuple[float, npt.NDArray[np.complex64]]] = deque()
        self._changed = threading.Condition()
        self._said: dict[str, str] = {}
        self._unsaid: deque[str] = deque()
        self._ended, self._error = False, ""

    @property
    def radar(self) -> Radar:
        """Radar of the frames; waits for the header (:class:`RecordingError` without one)."""
        return self._wait_for_header().radar

    @property
    def range_m(self) -> npt.NDArray[np.float64]:
        """Ranges of the bins, shape (N,); waits for the header."""
        return self._wait_for_header().range_m

    def _wait_for_header(self) -> Header:
        with self._changed:
            while self._header is None and not self._ended:
                self._changed.wait(POLL_S)
            if self._header is None:
                fault = "".join(f"; {text}" for text in self._unsaid)
                raise RecordingError(self._error or f"{self.source}: ended without a header{fault}")
            return self._header

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> tuple[float, npt.NDArray[np.complex64]]:
        with self._changed:
            while not self._queue and not self._ended:
                self._changed.wait(POLL_S)
            unsaid, item = list(self._unsaid), self._queue.popleft() if self._queue else None
            self._unsaid.clear()
            self._changed.notify_all()
        for text in unsaid:
            warn_caller(f"{self.source}: {text}")
        if item is not None:
            return item
        if self._error:
            error, self._error = self._error, ""
            raise RecordingError(error)
        raise StopIteration

    def summary(self) -> str:
        """Return the counts as one line."""
        counts = {name: count for name, count in asdict(self.counts).items() if count or name == "received"}
        return f"{self.source}: frames " + ", ".join(f"{name} {count:,}" for name, count in counts.items())

    def close(self) -> None:
        """Stop receiving; queued frames can still be read."""
        self.closing.set()
        with self._changed:
            self._changed.notify_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def pass_message(self, kind: str, text: str) -> None:
        """Pass a message to the consumer, once per kind."""
        with self._changed:
            if kind not in self._said:
                self._said[kind] = text
                self._unsaid.append(text)

    def report_killed(self) -> None:
        """Report that the sender stopped, unless the consumer closed the stream."""
        if not self.closing.is_set():
            self.pass_message(
                "killed",
                f"the sender stopped without an end record after {self.counts.received + len(self.waiting):,} frames",
            )

    def difference(self, header: Header) -> str:
        """Return how a header differs from the expected one."""
        if self._opening is not None:
            return self._opening.difference(header)
        return self.expected.difference(header, keys=EXPECTED, tolerance=EXPECTED_TOLERANCE) if self.expected else ""

    def receive(self, items: Iterator[Header | Frame], holds: bool) -> None:
        """Move frames into the queue; a source that ``holds`` waits while it is full."""
        error = ""
        try:
            for item in items:
                if isinstance(item, Frame):
                    if self._clock is not None:
                        self._put(item, holds)
                    elif self._opening is not None:
                        self.waiting.append(item)
                        if _shows_rate(self.waiting, self._opening.radar):
                            self._open(self._opening, holds)
                elif said := self.difference(item):
                    raise RecordingError(f"{self.source}: frames of another radar are refused: {said}")
                else:
                    self._opening = self._opening or item
                if self.closing.is_set():
                    break
        except RecordingError as found:
            error = str(found)
        except OSError as found:
            error = f"{self.source}: cannot be read: {found.strerror or found}"
        finally:
            if self._opening is not None and self._clock is None:
                self._open(self._opening, holds)
            with self._changed:
                self._error, self._ended = error, True
                self._changed.notify_all()

    def _open(self, header: Header, holds: bool) -> None:
        """Set the radar with the rate that the first frames show, and pass them on."""
        stamps = ((frame.counter or 0, frame.clock_s) for frame in self.waiting)
        (rate_hz, doubt), stated_hz = _measure_stamped_rate_hz(stamps, header.radar), header.radar.prf_hz
        if doubt:
            self.pass_message("clock", doubt)
        if rate_hz != stated_hz:
            self.pass_message("rate", f"the header states prf_hz = {stated_hz:g}, the sender's times {rate_hz:.6g} Hz")
            header = replace(header, radar=header.radar.model_copy(update={"prf_hz": rate_hz}))
        with self._changed:
            row_bytes = 8 * header.range_m.size
            self._size = max(2, min(math.ceil(self._queue_s * rate_hz), MAX_QUEUE_BYTES // row_bytes))
            self._clock = _Clock(header.radar)
            self._header = header
            self._changed.notify_all()
        waiting, self.waiting = self.waiting, []
        for frame in waiting:
            self._put(frame, holds)

    def _put(self, frame: Frame, holds: bool) -> None:
        assert self._clock is not None
        if not self._clock.start_with(frame):
            return
        if self._clock.repeats(frame):
            self.counts.repeated += 1
            self.pass_message("repeated", f"frame {frame.counter} came late or twice and is left out (frame counter)")
            return
        time_s, missing, jump = self._clock.time_s(frame)
        if rate_hz := self._clock.find_other_rate_hz(frame):
            self.pass_message("later rate", f"the rate is {rate_hz:.6g} Hz now; velocities are wrong by as much")
        if missing:
            self.pass_message("missing", f"{missing:,} frames are missing before frame {frame.counter} (frame counter)")
        if jump:
            self.pass_message("jump", jump)
        with self._changed:
            self.counts.received += 1
            self.counts.missing += missing
            self.counts.jumps += bool(jump)
            while holds and len(self._queue) >= self._size and not self.closing.is_set():
                self._changed.wait(POLL_S)
            full = len(self._queue) >= self._size
            if full:
                self._queue.popleft()
                self.counts.dropped += 1
            self._queue.append((time_s, frame.row))
            self._changed.notify_all()
        if full:
            self.pass_message(
                "dropped", f"the consumer is too slow: the oldest of {self._size:,} waiting frames are dropped"
            )


def _shows_rate(frames: Sequence[Frame], radar: Radar) -> bool:
    """Return True if the first frames suffice to check the stated rate."""
    counter, start = frames[-1].counter, frames[0].counter
    if counter is None or start is None or radar.burst_pulses is not None or not math.isfinite(frames[-1].clock_s):
        return True
    return not 0 <= counter - start < CREDIBLE_START * SETTLE_S * radar.prf_hz or (
        frames[-1].clock_s - frames[0].clock_s > SETTLE_S
    )


def _measure_stamped_rate_hz(stamps: Iterable[tuple[int, float]], radar: Radar) -> tuple[float, str]:
    """Return the rate of frames by their numbers and the sender's clock, or the stated one, and doubts."""
    table = np.array(list(stamps), dtype=np.float64).reshape(-1, 2)
    return find_rate_hz(radar, table[:, 0].astype(np.int64), table[:, 1])


class _Clock:
    """Frame times from counters, checked by the sender's clock."""

    def __init__(self, radar: Radar) -> None:
        self._radar = radar
        self._ahead_s = self._time_s = 0.0
        self._last: tuple[int, float] | None = None
        self._every = max(1, round(RECENT_S * radar.prf_hz / MAX_RECENT))
        self._recent: deque[tuple[int, float]] = deque(maxlen=max(2, round(RECENT_S * radar.prf_hz / self._every)))

    def repeats(self, frame: Frame) -> bool:
        """Return True for a frame that was there or is late; a lower counter is another start."""
        if frame.counter is None or self._last is None:
            return False
        return -MAX_DISORDER < frame.counter - self._last[0] <= 0

    def find_other_rate_hz(self, frame: Frame) -> float | None:
        """Return the rate of the last 10 s if the radar's differs; checked now and then."""
        if frame.counter is None or frame.counter % self._every:
            return None
        self._recent.append((frame.counter, frame.clock_s))
        if len(self._recent) < (self._recent.maxlen or 0):
            return None
        rate_hz, _ = _measure_stamped_rate_hz(self._recent, self._radar)
        self._recent.clear()
        return None if rate_hz == self._radar.prf_hz else rate_hz

    def start_with(self, frame: Frame) -> bool:
        """Return whether frames, or complete bursts, have started."""
        return self._last is not None or frame.counter is None or frame.counter % (self._radar.burst_pulses or 1) == 0

    def time_s(self, frame: Frame) -> tuple[float, int, str]:
        """Return time, number of missing frames, and a jump as text."""
        if frame.counter is None:
            return frame.clock_s, 0, ""
        last, self._last = self._last, (frame.counter, frame.clock_s)
        by_counter_s = float(self._radar.frame_time_s(frame.counter))
        if last is None:
            self._time_s = frame.clock_s if math.isfinite(frame.clock_s) else 0.0
            self._ahead_s = self._time_s - by_counter_s
            return self._time_s, 0, ""
        step, jump = frame.counter - last[0], ""
        if not 0 < step <= LARGEST_GAP:
            jump = f"the frame counter jumps from {last[0]:,} to {frame.counter:,}; time continues by one frame"
            self._ahead_s = self._time_s + 1.0 / self._radar.prf_hz - by_counter_s
            step = 1
        elif not 0 < frame.clock_s - last[1] <= by_counter_s + self._ahead_s - self._time_s + FAR_S:
            jump = (
                f"the sender's clock jumps from {last[1]:.9g} to {frame.clock_s:.9g} s at frame {frame.counter:,}; "
                "the frame counter is used"
            )
        self._time_s = by_counter_s + self._ahead_s
        return self._time_s, step - 1, jump


def open_stream(
    source: str | os.PathLike[str],
    *,
    expect: Radar | None = None,
    timeout_s: float = 10.0,
    queue_s: float = 5.0,
    **options: Any,
) -> Stream:
    """Open a live source of radar frames.

    Parameters
    ----------
    source : str or path-like
        ``-`` (standard input), ``tcp://HOST:PORT`` or ``udp://HOST:PORT`` (listens on this address; 127.0.0.1 without
        HOST, a free port for port 0), each with frames in the format of :mod:`doppelgait.radar.frames`; a file with
        such frames or a XeThru data file (``.dat``, or its folder), which may still grow; or any readable recording.
    expect : Radar, optional
        Expected radar. Frames with another carrier, frame rate or bin spacing are refused.
    timeout_s : float
        Time without new data after which a file or sender counts as stopped; 0 reads a file to its
        present end. The wait for the first sender is not limited.
    queue_s : float
        Duration of the frames that the queue holds. If it is full, files and standard input wait;
        for sockets the oldest frames are dropped and counted.
    **options
        Options for recordings, as of :func:`read_recording`; ``prf_hz`` of XeThru files without one.

    Examples
    --------
    >>> from doppelgait.radar import open_stream
    >>> stream = open_stream("tcp://:0")
    >>> stream.source.startswith("tcp://127.0.0.1:")
    True
    >>> stream.close()

    Raises
    ------
    RecordingError
        If the file does not exist, or the socket cannot be opened. Damaged and missing frames,
        jumps of the clock and dropped frames are counted and cause one :class:`DoppelgaitWarning`
        of each kind; frames of another radar raise a :class:`RecordingError` during the iteration.
    ConfigError
        If the source or a time is not allowed.
    """
    text = os.fspath(source)
    if not timeout_s >= 0 or not queue_s > 0:
        raise ConfigError(f"timeout_s = {timeout_s} and queue_s = {queue_s}: must be at least 0, and above 0")
    stream = Stream(text, expect=expect, timeout_s=timeout_s, queue_s=queue_s)
    holds, name = True, urlsplit(text).scheme
    items: Iterator[Header | Frame]
    if text == "-":
        stream.source = "standard input"
        items = _parse(_input_bytes(stream), stream)
    elif name in ("tcp", "udp"):
        holds = False
        listener = _listen(text, name)
        host, port = listener.getsockname()[:2]
        stream.source = f"{name}://{host}:{port}"
        items = _parse(_tcp_bytes(listener, stream), stream) if name == "tcp" else _receive_udp_frames(listener, stream)
    else:
        path = Path(text)
        if path.is_dir() or path.name == META_NAME:
            folder = path if path.is_dir() else path.parent
            files = [file for file in folder.glob("xethru_*") if _is_xethru_data(file)]
            path = files[0] if len(files) == 1 else path
        kinds = find_formats(path)
        if _is_xethru_data(path) and path.is_file():
            allowed = set(inspect.signature(read_xethru_recording).parameters) - {"path", "data_type"}
            if unknown := sorted(set(options) - allowed):
                has = ", ".join(sorted(allowed))
                raise ConfigError(f"{path}: has no option {', '.join(unknown)}; allowed are {has}")
            options, items = {}, _follow_xethru_frames(path, stream, options)
        elif kinds and kinds != ["frames"]:
            recording = read_recording(path, **options)
            options, items = {}, _replay_frames(recording)
        elif path.is_file():
            items = _parse(_file_bytes(path, stream), stream)
        else:
            raise RecordingError(
                f"{path}: is no file and no recording; a source is one of these, -, tcp://HOST:PORT or udp://HOST:PORT"
            )
    if options:
        raise ConfigError(f"{stream.source}: takes no option {', '.join(options)}; only recordings have some")
    threading.Thread(target=stream.receive, args=(items, holds), daemon=True, name=f"frames of {text}").start()
    return stream


def _replay_frames(recording: Recording) -> Iterator[Header | Frame]:
    times_s = recording.slow_time_s
    yield make_header(recording.radar, recording.range_m, recording.facts, times_s)
    for first, rows in read_tiles(recording.frames.get_values()):
        for time_s, row in zip(times_s[first : first + len(rows)].tolist(), rows, strict=True):
            yield Frame(None, time_s, row)


def _is_xethru_data(path: Path) -> bool:
    kind = find_data_type_by_file(path.name)
    return kind is not None and kind.name in CONVERTIBLE


def _parse(chunks: Iterator[bytes], stream: Stream) -> Iterator[Header | Frame]:
    """Yield headers and frames of a byte stream."""
    parser = FrameParser(stream.source)
    for chunk in chunks:
        yield from parser.feed(chunk)
        _count_malformed(parser, stream)
        if parser.ended:
            return
    yield from parser.finish()
    _count_malformed(parser, stream)
    if not parser.ended:
        stream.report_killed()


def _count_malformed(parser: FrameParser, stream: Stream) -> None:
    if parser.malformed > stream.counts.malformed:
        stream.counts.malformed = parser.malformed
        stream.pass_message("malformed", f"malformed data are passed over: {parser.fault}")


def _poll(
    read: Callable[[], bytes | None], stream: Stream, *, pause_s: float = 0.0, is_patient: bool = False
) -> Iterator[bytes]:
    """Yield what a source reads, until b"" or the timeout, which may begin with the first frame."""
    heard = time.monotonic()
    while not stream.closing.is_set():
        content = read()
        is_late = time.monotonic() - heard >= stream.timeout_s
        if content:
            yield content
            heard = time.monotonic()
        elif content is not None or (is_late and (stream.counts.received or not is_patient)):
            return
        else:
            stream.closing.wait(pause_s)


def _input_bytes(stream: Stream) -> Iterator[bytes]:
    number = sys.stdin.fileno()

    def read() -> bytes | None:
        return os.read(number, CHUNK_BYTES) if select.select([number], [], [], POLL_S)[0] else None

    yield from _poll(read, stream, is_patient=True)


def _file_bytes(path: Path, stream: Stream) -> Iterator[bytes]:
    with path.open("rb", buffering=0) as file:
        yield from _poll(lambda: file.read(CHUNK_BYTES) or None, stream, pause_s=POLL_S)


def _listen(text: str, name: str) -> socket.socket:
    """Bind a socket, by default to the loopback interface only."""
    try:
        parts = urlsplit(text)
        port = parts.port
    except ValueError:
        port = None
    if port is None or parts.path not in ("", "/"):
        raise ConfigError(f"source {text}: is not allowed; give {name}://HOST:PORT, for example {name}://{LOCAL}:7290")
    kind = socket.SOCK_STREAM if name == "tcp" else socket.SOCK_DGRAM
    listener = socket.socket(socket.AF_INET, kind)
    try:
        option = (socket.SO_REUSEADDR, 1) if name == "tcp" else (socket.SO_RCVBUF, 1 << 22)
        listener.setsockopt(socket.SOL_SOCKET, *option)
        listener.bind((parts.hostname or LOCAL, port))
        if name == "tcp":
            listener.listen(1)
    except OSError as error:
        listener.close()
        raise RecordingError(f"{text}: cannot be opened: {error.strerror or error}") from None
    listener.settimeout(POLL_S)
    return listener


def _tcp_bytes(listener: socket.socket, stream: Stream) -> Iterator[bytes]:
    """Yield the bytes of the first sender that connects."""
    sender = None
    with listener:
        while sender is None:
            if stream.closing.is_set():
                return
            with suppress(TimeoutError):
                sender, _ = listener.accept()

    def read() -> bytes | None:
        try:
            return sender.recv(CHUNK_BYTES)
        except TimeoutError:
            return None
        except ConnectionError:
            return b""

    with sender:
        sender.settimeout(POLL_S)
        yield from _poll(read, stream)


def _receive_udp_frames(listener: socket.socket, stream: Stream) -> Iterator[Header | Frame]:
    """Yield the frames of one sender of datagrams; one with the same header replaces it."""
    parser, sender, heard = FrameParser(stream.source), None, math.inf
    with listener:
        while not stream.closing.is_set():
            try:
                content, address = listener.recvfrom(CHUNK_BYTES)
            except TimeoutError:
                if time.monotonic() - heard > stream.timeout_s:
                    stream.report_killed()
                    return
                continue
            if address != sender:
                probe = FrameParser(stream.source)
                try:
                    header = next((item for item in probe.feed(content) if isinstance(item, Header)), None)
                    reason = stream.difference(header) if header else "they do not begin with a header"
                except RecordingError as error:
                    reason = str(error)
                if reason:
                    stream.counts.refused += 1
                    stream.pass_message("refused", f"datagrams of {address[0]}:{address[1]} are refused: {reason}")
                    continue
                sender = address
            heard = time.monotonic()
            yield from parser.feed(content)
            yield from parser.finish()
            _count_malformed(parser, stream)
            if parser.ended:
                return


def _follow_xethru_frames(path: Path, stream: Stream, options: Mapping[str, Any]) -> Iterator[Header | Frame]:
    """Yield frames of a growing XeThru data file."""
    kind = find_data_type_by_file(path.name)
    assert kind is not None
    stated = {key: options.get(key) for key in OPTIONS}
    further = {key: value for key, value in options.items() if key not in OPTIONS}
    head = kind.header
    content, first = b"", None
    for chunk in _file_bytes(path, stream):
        content += chunk
        blocks, used = parse_records(content, kind)
        if len(content) - used >= head.itemsize:
            count = int(np.frombuffer(content, head, 1, used)["count"][0])
            if count > MAX_RF_VALUES:
                raise RecordingError(f"{path}: a record declares {count:,} values, at most {MAX_RF_VALUES:,} are read")
        for block in blocks:
            if not block["count"][0]:
                raise RecordingError(f"{path}: a record declares no values")
            source = Records(path, kind.name, block, np.empty(0, dtype=np.int64), stated)
            volts, radar, range_m = convert_records(source, **further)
            yield Header(radar, range_m)
            for counter, row in zip(source.counters.tolist(), volts, strict=True):
                first = counter if first is None else first
                if np.isfinite(row).all():
                    yield Frame(counter, (counter - first) / radar.prf_hz, row)
                else:
                    stream.counts.malformed += 1
                    stream.pass_message("malformed", f"frame {counter:,} holds NaN or infinite values")
        content = content[used:]
    if content:
        stream.counts.malformed += 1
        stream.pass_message("malformed", f"the last {len(content)} bytes are no whole record")
