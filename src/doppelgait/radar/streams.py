"""Live frames: their sources (files, standard input, sockets), order and times, and a bounded queue.

A thread fills the queue of a :class:`Stream`; :func:`open_stream` opens the source.
"""

from __future__ import annotations

import math
import os
import select
import socket
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from itertools import chain
from pathlib import Path
from typing import Any, Self
from urllib.parse import urlsplit

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import ConfigError, RecordingError, warn_caller
from doppelgait.core.lazy import read_tiles
from doppelgait.core.readers import list_options
from doppelgait.radar.frames import (
    CHUNK_BYTES,
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

POLL_S = 0.05
"""Polling interval, s, of a file that does not grow, and of the closed state of a stream."""
MAX_QUEUE_BYTES, FRAME_BYTES, MAX_RATE = 1 << 28, 400, 1 << 24
"""Bytes of waiting frames, of one without its samples, and of the samples of a second."""
MAX_KINDS = 50
"""Different messages of a run, after which further refusals share one."""
HOLD_S, RESTART_S, MAX_LOW = 0.1, 1.0, 2000
"""Time, s, for which frames wait for an earlier one that is on its way; time, s, and frames for
which a lower frame counter stays low before it counts as a restart."""
FAR_S = 1.0
"""Minimum difference, s, of sender's clock and frame counter that is a jump of the clock."""
RECENT_S, MAX_RECENT = 10.0, 250
"""Time over which the rate of arriving frames is compared with that of the radar, and number of frames that are."""
CREDIBLE_START = 2.0
"""Ratio to the frames of this time after which a start ends, also if the clock does not advance."""
EXPECTED, EXPECTED_TOLERANCE = ("carrier_hz", "prf_hz", "bin_spacing_m"), 5e-3
"""Relative tolerance to an expected radar: drivers use c = 3e8 m/s and measure their rates."""


@dataclass
class Counts:
    """Numbers of received, missing and faulty frames of a stream."""

    received: int = 0
    missing: int = 0
    repeated: int = 0
    late: int = 0
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
    reason : str
        Why the stream ended.
    complete : bool
        False if a sender stopped without an end record.
    """

    def __init__(
        self, source: str, expect: Radar | None, timeout_s: float, queue_s: float, listener: _Listener | None
    ) -> None:
        self.source, self.counts, self.timeout_s = source, Counts(), timeout_s
        self.reason, self.complete = "the source ended", True
        self.closing = threading.Event()
        self._expect, self.listener = expect, listener
        self._queue_s, self._size = queue_s, 1
        self._header: Header | None = None
        self._opening: Header | None = None  # as sent
        self.waiting: list[Frame] = []  # until their times show the true rate
        self._sorter: _Sorter | None = None
        self._clock: _Clock | None = None
        self._queue: deque[tuple[float, npt.NDArray[np.complex64]]] = deque()
        self._changed = threading.Condition()
        self._said: dict[str, tuple[int, float]] = {}  # number and time
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
        while self._header is None and not self._ended:
            with self._changed:
                self._changed.wait(POLL_S)
            if self.listener is not None:  # the error of a file has its messages
                self._say()
        if self._header is None:
            fault = "".join(f"; {text}" for text in self._unsaid)
            error = RecordingError(self._error or f"{self.source}: ended without a header{fault}")
            error.exit_code = 2 if self.listener is None else 1  # a sensor failed
            raise error
        return self._header

    def _say(self) -> None:
        while self._unsaid:
            warn_caller(f"{self.source}: {self._unsaid.popleft()}")

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> tuple[float, npt.NDArray[np.complex64]]:
        with self._changed:
            while not self._queue and not self._ended:
                self._changed.wait(POLL_S)
            item = self._queue.popleft() if self._queue else None
            self._changed.notify_all()
        self._say()
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
            if self._ended and self.listener is not None:
                self.listener.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def next_run(self) -> Stream:
        """End this sender; return the stream of the next one (``once=False``)."""
        listener, self.listener = self.listener, None
        assert listener is not None
        self.close()
        with self._changed:
            while not self._ended:
                self._changed.wait(POLL_S)
        following = Stream(self.source, self._expect, self.timeout_s, self._queue_s, listener)
        following.start(listener.receive(following), holds=False)
        return following

    def start(self, items: Generator[Header | Frame], holds: bool) -> None:
        """Receive in a thread."""
        threading.Thread(target=self.receive, args=(items, holds), daemon=True).start()

    def pass_message(self, kind: str, text: str, again_s: float = math.inf) -> None:
        """Pass a message to the consumer, once per kind, or once per time with its number."""
        with self._changed:
            if again_s < math.inf and kind not in self._said and len(self._said) >= MAX_KINDS:
                kind = "further ones"
            count, said_s = self._said.get(kind, (0, -math.inf))
            is_due = not count or time.monotonic() - said_s >= again_s
            self._said[kind] = count + 1, time.monotonic() if is_due else said_s
            if is_due:
                self._unsaid.append(f"{text} ({count + 1:,} times by now)" if count else text)

    def difference(self, header: Header) -> str:
        """Return how a header differs from the expected one, or from any radar."""
        rows = max(header.radar.prf_hz, header.radar.burst_pulses or 1)
        if self.listener is not None and 8 * header.range_m.size * rows > MAX_RATE:
            return f"a second or a burst (range_bins x prf_hz x 8 bytes) has more than {MAX_RATE:,} bytes"
        if self._opening is not None:
            return self._opening.difference(header)
        if self._expect is None:
            return ""
        expected = Header(self._expect, self._expect.range_axis_m())
        return expected.difference(header, keys=EXPECTED, tolerance=EXPECTED_TOLERANCE)

    def receive(self, items: Generator[Header | Frame], holds: bool) -> None:
        """Move frames into the queue; a source that ``holds`` waits while it is full."""
        error = ""
        try:
            for item in items:
                if isinstance(item, Frame):
                    for frame in self._sorter.add(item) if self._sorter else ():
                        self._take(frame, holds)
                elif said := self.difference(item):
                    raise RecordingError(f"{self.source}: frames of another radar are refused: {said}")
                elif self._opening is None:
                    self._opening, self._sorter = item, _Sorter(item.radar.prf_hz, self)
                if self.closing.is_set():
                    break
        except RecordingError as found:
            error = str(found)
        except OSError as found:
            error = f"{self.source}: cannot be read: {found.strerror or found}"
        finally:
            items.close()
            for frame in self._sorter.finish() if self._sorter else ():
                self._take(frame, holds)
            if self._opening is not None and self._clock is None:
                self._open(self._opening, holds)
            if not self.complete and not self.closing.is_set():
                self.reason = f"the sender stopped without an end record after {self.counts.received:,} frames"
                self.pass_message("killed", self.reason)
            with self._changed:
                self._error, self._ended = error, True
                self._changed.notify_all()

    def _take(self, frame: Frame, holds: bool) -> None:
        """Put a frame into the queue, or let it wait until the rate is known."""
        assert self._opening is not None
        if self._clock is not None:
            self._put(frame, holds)
            return
        self.waiting.append(frame)
        first, radar = self.waiting[0], self._opening.radar
        numbered = None not in (first.counter, frame.counter) and radar.burst_pulses is None
        ahead = (frame.counter or 0) - (first.counter or 0)
        if (
            not numbered
            or not frame.clock_s - first.clock_s <= SETTLE_S
            or not 0 <= ahead < CREDIBLE_START * SETTLE_S * radar.prf_hz
            or len(self.waiting) * (frame.row.nbytes + FRAME_BYTES) > MAX_QUEUE_BYTES
        ):
            self._open(self._opening, holds)

    def _open(self, header: Header, holds: bool) -> None:
        """Set the radar with the rate that the first frames show, and pass them on."""
        stamps = [(frame.counter or 0, frame.clock_s) for frame in self.waiting]
        (rate_hz, doubt), stated_hz = find_rate_hz(header.radar, stamps), header.radar.prf_hz
        if self.listener is not None and 8 * header.range_m.size * rate_hz > MAX_RATE:
            doubt, rate_hz = f"{rate_hz:.6g} Hz, too many, by the times: {stated_hz:g} Hz is used", stated_hz
        if doubt:
            self.pass_message("clock", doubt)
        if rate_hz != stated_hz:
            self.pass_message("rate", f"the header states prf_hz = {stated_hz:g}, the sender's times {rate_hz:.6g} Hz")
            header = replace(header, radar=header.radar.model_copy(update={"prf_hz": rate_hz}))
        with self._changed:
            most = MAX_QUEUE_BYTES // (8 * header.range_m.size + FRAME_BYTES)
            self._size = max(2, min(math.ceil(self._queue_s * rate_hz), most))
            self._clock, self._header = _Clock(header.radar), header
            self._changed.notify_all()
        for frame in self.waiting:
            self._put(frame, holds)
        self.waiting = []

    def _put(self, frame: Frame, holds: bool) -> None:
        assert self._clock is not None
        assert self._header is not None
        if not self.counts.received and (frame.counter or 0) % (self._header.radar.burst_pulses or 1):
            return  # not the start of a burst
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
            if len(self._queue) >= self._size:
                self._queue.popleft()
                self.counts.dropped += 1
                self.pass_message(
                    "dropped", f"the consumer is too slow: the oldest of {self._size:,} frames are dropped"
                )
            self._queue.append((time_s, frame.row))
            self._changed.notify_all()


class _Sorter:
    """Order frames by their counter; one that stays low is a restart of the sender."""

    def __init__(self, prf_hz: float, stream: Stream) -> None:
        self._stream = stream
        self._depth = min(max(2, round(HOLD_S * prf_hz)), MAX_DISORDER)
        self._patience = max(MAX_DISORDER, min(round(RESTART_S * prf_hz), MAX_LOW))
        self._held: dict[int, Frame] = {}
        self._low: list[Frame] = []
        self._last: Frame | None = None

    def add(self, frame: Frame) -> Iterator[Frame]:
        """Yield the frames that are next."""
        number, last = frame.counter, -1 if self._last is None else self._last.counter
        if number is None or last is None:  # a recording: without counters
            yield frame
        elif self._last is not None and number <= last:
            self._low.append(frame)
            if len(self._low) > (MAX_DISORDER if frame.clock_s > self._last.clock_s else self._patience):
                yield from self._restart()
        else:
            self._leave_out(self._low)
            if number in self._held:
                self._leave_out([frame])
            elif number + 1 in self._held:
                self._stream.counts.late += 1
            self._held.setdefault(number, frame)
            while len(self._held) > self._depth or (self._last is not None and last + 1 in self._held):
                released = self._release()
                last = released.counter or 0
                yield released

    def finish(self) -> Iterator[Frame]:
        """Yield what is held at the end."""
        if len(self._low) > MAX_DISORDER:
            yield from self._restart()
        self._leave_out(self._low)
        while self._held:
            yield self._release()

    def _release(self) -> Frame:
        self._last = self._held.pop(min(self._held))
        return self._last

    def _restart(self) -> Iterator[Frame]:
        """Yield what is held, then the frames since the restart."""
        low, self._low = self._low, []
        yield from self.finish()
        self._last = None
        for frame in low:
            yield from self.add(frame)

    def _leave_out(self, frames: list[Frame]) -> None:
        if frames:
            self._stream.counts.repeated += len(frames)
            self._stream.pass_message("repeated", f"frame {frames[0].counter} came late or twice and is left out")
        self._low = []


class _Clock:
    """Frame times from counters, checked by the sender's clock."""

    def __init__(self, radar: Radar) -> None:
        self._radar = radar
        self._ahead_s = self._time_s = 0.0
        self._zero = 0  # counter of time 0: an integer, as floats are too short
        self._last: tuple[int, float] | None = None
        self._every = max(1, round(RECENT_S * radar.prf_hz / MAX_RECENT))
        self._recent: deque[tuple[int, float]] = deque(maxlen=max(2, round(RECENT_S * radar.prf_hz / self._every)))

    def find_other_rate_hz(self, frame: Frame) -> float | None:
        """Return the rate of the last 10 s if the radar's differs; checked now and then."""
        if frame.counter is None or frame.counter % self._every:
            return None
        self._recent.append((frame.counter, frame.clock_s))
        if len(self._recent) < (self._recent.maxlen or 0):
            return None
        rate_hz, _ = find_rate_hz(self._radar, self._recent)
        self._recent.clear()
        return None if rate_hz == self._radar.prf_hz else rate_hz

    def time_s(self, frame: Frame) -> tuple[float, int, str]:
        """Return time, number of missing frames, and a jump as text."""
        if frame.counter is None:
            return frame.clock_s, 0, ""
        last, self._last = self._last, (frame.counter, frame.clock_s)
        step = 0 if last is None else frame.counter - last[0]
        if is_new := not 0 < step <= LARGEST_GAP:
            self._zero = frame.counter - frame.counter % (self._radar.burst_pulses or 1)
        by_counter_s = float(self._radar.frame_time_s(frame.counter - self._zero))
        if last is None:
            self._time_s = frame.clock_s if math.isfinite(frame.clock_s) else 0.0
            self._ahead_s = self._time_s - by_counter_s
            return self._time_s, 0, ""
        clock_step_s, jump = frame.clock_s - last[1], ""
        if is_new:
            jump = f"the frame counter jumps from {last[0]:,} to {frame.counter:,}; time continues there"
            later_s = clock_step_s if math.isfinite(clock_step_s) else 0.0
            self._ahead_s = self._time_s + max(later_s, 1.0 / self._radar.prf_hz) - by_counter_s
            step = 1
        elif 0.0 < clock_step_s < step / self._radar.prf_hz - FAR_S:
            jump = (
                f"the frame counter jumps from {last[0]:,} to {frame.counter:,}, the sender's clock by "
                f"{clock_step_s:.3g} s only; the clock is used"
            )
            step = max(1, round(clock_step_s * self._radar.prf_hz))
            self._ahead_s = self._time_s + step / self._radar.prf_hz - by_counter_s
        elif not 0 < clock_step_s <= by_counter_s + self._ahead_s - self._time_s + FAR_S:
            jump = (
                f"the sender's clock jumps from {last[1]:.9g} to {frame.clock_s:.9g} s at frame {frame.counter:,}; "
                "the frame counter is used"
            )
        self._time_s = by_counter_s + self._ahead_s
        return self._time_s, step - 1, jump


LOCAL = "127.0.0.1"
SILENT_S = 1.0
"""Time without a frame, s, after which another sender may take the place of a sensor."""
MAX_CLIENTS, AGAIN_S = 16, 60.0
"""Clients at once; time, s, after which a refusal that goes on is stated again."""
MAX_RF_VALUES = 1_000_000
"""Maximum number of values that a record may declare."""


def open_stream(
    source: str | os.PathLike[str],
    *,
    expect: Radar | None = None,
    timeout_s: float = 10.0,
    queue_s: float = 5.0,
    once: bool = True,
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
        Duration of the frames that the queue holds; if full, files wait, sockets drop the oldest.
    once : bool
        For sockets. True ends with the first TCP connection, or with the first sender of datagrams. False drops who
        sends no header or no frame for ``timeout_s``, and takes the next; after the end of a sender, ``next_run()`` of
        the stream returns the stream of the next one.
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
        If a file does not exist, or a socket cannot be opened; later, for another radar's frames.
        Lost and damaged frames and jumps are counted: one :class:`DoppelgaitWarning` each.
    ConfigError
        If the source or a time is not allowed.
    """
    text = os.fspath(source)
    if not timeout_s >= 0 or not queue_s > 0:
        raise ConfigError(f"timeout_s = {timeout_s} and queue_s = {queue_s}: must be at least 0, and above 0")
    name = urlsplit(text).scheme
    listener = _Listener(text, name, once) if name in ("tcp", "udp") else None
    stream = Stream(text, expect, timeout_s, queue_s, listener)
    items: Generator[Header | Frame]
    if text == "-":
        stream.source = "standard input"
        items = _parse(_input_bytes(stream), stream)
    elif listener is not None:
        stream.source, items = listener.source, listener.receive(stream)
    else:
        path = Path(text)
        if path.is_dir() or path.name == META_NAME:
            folder = path if path.is_dir() else path.parent
            files = [file for file in folder.glob("xethru_*") if _is_xethru_data(file)]
            path = files[0] if len(files) == 1 else path
        kinds = find_formats(path)
        if _is_xethru_data(path) and path.is_file():
            known = {*list_options(read_xethru_recording)} - {"data_type"}
            own = {name: options.pop(name) for name in known & options.keys()}
            items = _follow_xethru_frames(path, stream, own)
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
        raise ConfigError(f"{stream.source}: takes no option {', '.join(options)}; see doppelgait radar formats")
    stream.start(items, holds=listener is None)
    return stream


def _replay_frames(recording: Recording) -> Generator[Header | Frame]:
    times_s = recording.slow_time_s
    yield make_header(recording)
    for first, rows in read_tiles(recording.frames.get_values()):
        for time_s, row in zip(times_s[first : first + len(rows)].tolist(), rows, strict=True):
            yield Frame(None, time_s, row)


def _is_xethru_data(path: Path) -> bool:
    kind = find_data_type_by_file(path.name)
    return kind is not None and kind.name in CONVERTIBLE


def _parse(chunks: Iterator[bytes], stream: Stream) -> Generator[Header | Frame]:
    """Yield headers and frames of a byte stream."""
    parser = FrameParser(stream.source)
    for chunk in chain(chunks, [b""]):
        yield from parser.feed(chunk, last=not chunk)
        _count_malformed(parser, stream)
        if parser.ended:
            return
    stream.complete = False


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


def _follow_xethru_frames(path: Path, stream: Stream, options: dict[str, Any]) -> Generator[Header | Frame]:
    """Yield frames of a growing XeThru data file."""
    kind = find_data_type_by_file(path.name)
    assert kind is not None
    stated = {key: options.pop(key, None) for key in OPTIONS}
    content, first = b"", None
    for chunk in _file_bytes(path, stream):
        content += chunk
        blocks, used = parse_records(content, kind)
        if len(content) - used >= kind.header.itemsize:
            count = int(np.frombuffer(content, kind.header, 1, used)["count"][0])
            if count > MAX_RF_VALUES:
                raise RecordingError(f"{path}: a record declares {count:,} values, at most {MAX_RF_VALUES:,} are read")
        for block in blocks:
            if not block["count"][0]:
                raise RecordingError(f"{path}: a record declares no values")
            source = Records(path, kind.name, block, stated)
            volts, radar, range_m = convert_records(source, **options)
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


@dataclass(eq=False)
class _Client:
    """Connection or address of datagrams that is, or may become, the sender."""

    parser: FrameParser
    heard_s: float = field(default_factory=time.monotonic)
    items: list[Header | Frame] = field(default_factory=list)  # until it is the sensor
    is_ready: bool = False  # a frame came

    def is_silent(self, time_s: float) -> bool:
        return time.monotonic() - self.heard_s >= time_s


class _Listener:
    """Socket, by default of the loopback interface, that receives one sender after the other."""

    def __init__(self, text: str, name: str, once: bool) -> None:
        try:
            parts = urlsplit(text)
            port = parts.port
        except ValueError:
            port = None
        if port is None or parts.path not in ("", "/"):
            raise ConfigError(
                f"source {text}: is not allowed; give {name}://HOST:PORT, for example {name}://{LOCAL}:7290"
            )
        self._is_tcp, self._once = name == "tcp", once
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_STREAM if self._is_tcp else socket.SOCK_DGRAM)
        self._clients: dict[Any, _Client] = {}  # by connection, or address
        self._barred: dict[Any, float] = {}  # addresses of faulty headers, since when
        try:
            option = (socket.SO_REUSEADDR, 1) if self._is_tcp else (socket.SO_RCVBUF, 1 << 22)
            self._socket.setsockopt(socket.SOL_SOCKET, *option)
            self._socket.bind((parts.hostname or LOCAL, port))
            if self._is_tcp:
                self._socket.listen()
        except OSError as error:
            self._socket.close()
            failure = RecordingError(f"{text}: cannot be opened: {error.strerror or error}")
            failure.exit_code = 1  # may succeed later
            raise failure from None
        self._socket.settimeout(POLL_S)
        self.source = "{}://{}:{}".format(name, *self._socket.getsockname())

    def close(self) -> None:
        for key in list(self._clients):
            self._drop(key)
        self._socket.close()

    def receive(self, stream: Stream) -> Generator[Header | Frame]:
        """Yield what one sender sends until its end, or until another one replaces it."""
        own: Any = None
        try:
            while not stream.closing.is_set():
                sender = self._clients.get(own)
                ready = [
                    key for key, one in self._clients.items() if one is not sender and (one.is_ready or self._once)
                ]
                if sender is None and ready:
                    own, sender = ready[0], self._clients[ready[0]]
                    if self._once and self._is_tcp:
                        self._socket.close()
                    yield from sender.items
                elif sender is not None and (
                    sender.parser.ended or sender.is_silent(SILENT_S if ready else stream.timeout_s)
                ):
                    stream.complete = sender.parser.ended
                    return
                for key, content in self._read(sender, stream):
                    if sender is None or key != own:
                        self._meet(key, content, sender, stream)
                        continue
                    for item in sender.parser.feed(content, last=not (content and self._is_tcp)):
                        sender.heard_s = time.monotonic()
                        yield item
                    _count_malformed(sender.parser, stream)
                    if self._is_tcp and not content:
                        sender.heard_s = -math.inf
                for key, one in list(self._clients.items()):
                    if one is not sender and one.is_silent(max(stream.timeout_s, SILENT_S)):
                        reason = "another one sends" if one.is_ready else f"no frame for {stream.timeout_s:g} s"
                        self._refuse(key, reason, stream)
        finally:
            self._drop(own)
            if self._once or (stream.closing.is_set() and stream.listener is self):
                self.close()

    def _read(self, sender: _Client | None, stream: Stream) -> Iterator[tuple[Any, bytes]]:
        """Yield new bytes of every client, none for a connection that was closed."""
        if not self._is_tcp:
            with suppress(TimeoutError, ConnectionError):
                content, address = self._socket.recvfrom(CHUNK_BYTES)
                yield address, content
            return
        listening = [] if self._socket.fileno() < 0 else [self._socket]
        unheard = [key for key, one in self._clients.items() if one is sender or not one.is_ready]
        for one in select.select([*listening, *unheard], [], [], POLL_S)[0]:
            try:
                if one is not self._socket:
                    yield one, one.recv(CHUNK_BYTES)
                    continue
                connection, address = one.accept()
                connection.setblocking(False)
                self._add(connection, address, sender, stream)
            except BlockingIOError:
                continue
            except OSError:
                if one is not self._socket:
                    yield one, b""
                stream.closing.wait(POLL_S)

    def _add(self, key: Any, address: tuple[str, int], sender: _Client | None, stream: Stream) -> None:
        if len(self._clients) >= MAX_CLIENTS:  # the oldest without a frame, never the sensor
            oldest = min(self._clients.items(), key=lambda of: (of[1] is sender, of[1].is_ready))
            self._refuse(oldest[0], f"there are {MAX_CLIENTS} others", stream)
        self._clients[key] = _Client(FrameParser("{}:{}".format(*address)))

    def _meet(self, key: Any, content: bytes, sender: _Client | None, stream: Stream) -> None:
        """Take what comes from another client than the sender; a header makes it the next one."""
        speaks = not self._is_tcp and sender is not None and not sender.is_silent(SILENT_S)
        if time.monotonic() - self._barred.get(key, -math.inf) < SILENT_S:
            stream.counts.refused += 1
            return
        if key not in self._clients and not self._is_tcp:
            self._add(key, key, sender, stream)
        if (client := self._clients.get(key)) is None:
            return
        reason = "" if content else "closed before its first frame"
        try:
            for item in client.parser.feed(b"" if speaks else content):
                if isinstance(item, Header):
                    reason = "they have two headers" if client.items else stream.difference(item)
                if reason:
                    raise RecordingError(reason)
                client.items.append(item)
            client.is_ready = len(client.items) > 1
        except RecordingError as error:
            reason, now_s = str(error), time.monotonic()
            recent = {one: at_s for one, at_s in self._barred.items() if now_s - at_s < SILENT_S}
            self._barred = {**recent, key: now_s}
        if client.parser.header is None and not speaks and not self._is_tcp:
            reason = reason or "they do not begin with a header"
        if reason or speaks:
            self._refuse(key, reason or "another one sends", stream)

    def _refuse(self, key: Any, reason: str, stream: Stream) -> None:
        """Count a client, and end its connection."""
        stream.counts.refused += 1
        where, kind = self._clients[key].parser.where, "connections" if self._is_tcp else "datagrams"
        reason = reason.removeprefix(f"{where}: ")
        stream.pass_message(where.rpartition(":")[0] + reason, f"{kind} of {where} are refused: {reason}", AGAIN_S)
        self._drop(key)

    def _drop(self, key: Any) -> None:
        if self._clients.pop(key, None) is not None and self._is_tcp:
            key.close()
