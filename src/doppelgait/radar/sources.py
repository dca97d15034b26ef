"""Sources of live frames: files, standard input and sockets."""

from __future__ import annotations

import math
import os
import select
import socket
import sys
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np

from doppelgait.core.errors import ConfigError, RecordingError
from doppelgait.core.lazy import read_tiles
from doppelgait.core.readers import list_options
from doppelgait.radar.frames import CHUNK_BYTES, Frame, FrameParser, Header, make_header
from doppelgait.radar.parameters import Radar
from doppelgait.radar.readers import find_formats, read_recording
from doppelgait.radar.recording import Recording
from doppelgait.radar.streams import POLL_S, Stream
from doppelgait.radar.xethru.convert import CONVERTIBLE, OPTIONS, Records, convert_records, read_xethru_recording
from doppelgait.radar.xethru.records import META_NAME, find_data_type_by_file, parse_records

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
    yield make_header(recording.radar, recording.range_m, recording.facts, times_s)
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
