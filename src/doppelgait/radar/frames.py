"""The format of frames in live streams and their files.

``docs/howto/stream.md`` lists its records. All numbers are little endian; every record has a magic, version, kind,
length and CRC-32. A stream starts with a header, which may be repeated; each datagram contains whole records.
"""

from __future__ import annotations

import math
import re
import struct
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.config import format_canonical_json, validate
from doppelgait.core.documents import parse_json
from doppelgait.core.errors import ConfigError, RecordingError, warn_caller
from doppelgait.core.files import open_atomically
from doppelgait.core.plugins import plugin
from doppelgait.radar.measured import RATE_OFF, adapt_preset, check_number, label_measured
from doppelgait.radar.parameters import MAX_RANGE_BINS, Radar
from doppelgait.radar.presets import list_preset_names
from doppelgait.radar.recording import Recording
from doppelgait.radar.slow_time import MAX_DISORDER, measure_clock_rate_hz

MAGIC = b"DGfr"
VERSION = 1
HEADER, FRAME, END = 1, 2, 3
HEAD = struct.Struct("<4sBBHI")
STAMP = struct.Struct("<Qd")
CHECK = struct.Struct("<I")
CHUNK_BYTES = 1 << 16
EFFORT, CHECK_COST, MAX_CREDIT = 32, 8192, 1 << 24
"""Bytes of checksums of damaged records that a received byte pays for, the further cost of each such record in the same
unit (0.3 ns), and what is saved up: damage costs at most 0.05 s of processor per megabyte."""
LARGEST_GAP, LARGEST_CLOCK_S, LARGEST_V = 1_000_000, 1e10, 1e30
"""Maximum gap of the frame counter; a larger jump is a restart of the counter. Times beyond the second count as
unknown, frames with samples beyond the third as malformed."""
FACTS = ("carrier_hz", "prf_hz", "bin_spacing_m", "range_start_m", "range_bins")
SAME = 1e-6
"""Maximum relative difference of equal values in two headers."""


@dataclass(frozen=True, eq=False)
class Header:
    """Radar of a stream, and its range bins. Shapes: range_m (N,)."""

    radar: Radar
    range_m: npt.NDArray[np.float64]

    @property
    def facts(self) -> dict[str, float]:
        """Carrier, frame rate and range bins, by format key."""
        spacing_m = self.range_m[1] - self.range_m[0] if self.range_m.size > 1 else self.radar.bin_spacing_m
        values = (self.radar.carrier_hz, self.radar.prf_hz, spacing_m, self.range_m[0], self.range_m.size)
        return {key: float(value) for key, value in zip(FACTS, values, strict=True)}

    def difference(self, other: Header, *, keys: Iterable[str] = FACTS, tolerance: float = SAME) -> str:
        """Return the first differing fact of two headers with both values, or ""."""
        for key in keys:
            mine, theirs = self.facts[key], other.facts[key]
            if not math.isclose(mine, theirs, rel_tol=tolerance, abs_tol=1e-9):
                return f"{key} is {theirs:.9g}, expected is {mine:.9g}"
        return ""


@dataclass(frozen=True, eq=False)
class Frame:
    """Frame as received: counter, if any, sender's time, samples in V."""

    counter: int | None
    clock_s: float
    row: npt.NDArray[np.complex64]


def encode_record(kind: int, payload: bytes) -> bytes:
    """Return one record of the format."""
    head = HEAD.pack(MAGIC, VERSION, kind, 0, len(payload))
    return head + payload + CHECK.pack(zlib.crc32(payload, zlib.crc32(head[4:])))


def encode_header(header: Header) -> bytes:
    """Return the record that opens a stream."""
    facts = {**header.facts, "range_bins": header.range_m.size}
    facts_and_radar = {**facts, "radar": header.radar.model_dump(mode="json")}
    return encode_record(HEADER, format_canonical_json(facts_and_radar).encode())


def encode_frame(counter: int, clock_s: float, row: npt.NDArray[Any]) -> bytes:
    """Return the record of one frame. Shapes: row (N,)."""
    return encode_record(FRAME, STAMP.pack(counter, clock_s) + np.asarray(row, dtype="<c8").tobytes())


END_RECORD = encode_record(END, b"")
"""Record that ends a stream regularly; without it, the sender was killed."""


def parse_header(payload: bytes, where: str) -> Header:
    """Check the content of a header."""
    try:
        table = parse_json(payload.decode())
    except ValueError:
        raise RecordingError(f"{where}: the header is not JSON in UTF-8") from None
    keys = (*FACTS, "radar")
    if not isinstance(table, dict) or set(table) != set(keys):
        held = ", ".join(map(str, table)) if isinstance(table, dict) else type(table).__name__
        raise RecordingError(f"{where}: the header must have the keys {', '.join(keys)}; it has {held[:200]}")
    place = Path(where)
    limits = {"carrier_hz": (0, 1e12), "prf_hz": (0, 1e6), "bin_spacing_m": (0, 1e6), "range_start_m": (-10, 1e6)}
    facts = {
        key: check_number(place, f"{key} of the header", table[key], above=above, most=most)
        for key, (above, most) in limits.items()
    }
    n_bins = table["range_bins"]
    if isinstance(n_bins, bool) or not isinstance(n_bins, int) or not 1 <= n_bins <= MAX_RANGE_BINS:
        raise RecordingError(f"{where}: range_bins of the header = {n_bins!r} is not allowed; 1 to {MAX_RANGE_BINS:,}")
    stated: dict[str, Any] = {"carrier_hz": facts["carrier_hz"], "prf_hz": facts["prf_hz"]}
    named = table["radar"]
    if not isinstance(named, dict) and named not in list_preset_names():  # never the path of a file
        raise RecordingError(
            f"{where}: radar of the header = {str(named)[:80]!r} is neither a table nor one of the presets "
            f"{', '.join(list_preset_names())}"
        )
    try:
        radar = validate(Radar, named, where="radar") if isinstance(named, dict) else Radar.preset(named, **stated)
    except ConfigError as error:
        raise RecordingError(f"{where}: {error}") from None
    if isinstance(named, str) and radar.waveform.ranged:
        radar = adapt_preset(place, named, n_range_bins=n_bins, range_start_m=facts["range_start_m"], **stated)
    if n_bins > radar.n_range_bins:
        raise RecordingError(f"{where}: the header states {n_bins:,} range bins, its radar {radar.n_range_bins:,}")
    header = Header(radar, facts["range_start_m"] + facts["bin_spacing_m"] * np.arange(n_bins, dtype=np.float64))
    for key in ("carrier_hz", "prf_hz"):
        if not math.isclose(facts[key], header.facts[key], rel_tol=SAME):
            raise RecordingError(f"{where}: the header states {key} = {facts[key]:g}, its radar {header.facts[key]:g}")
    return header


class FrameParser:
    """Parse bytes into headers and frames, skipping other content."""

    def __init__(self, where: str) -> None:
        self.where, self.malformed, self.fault, self.ended = where, 0, "", False
        self.header: Header | None = None
        self._buffer, self._lost, self._credit = bytearray(), False, MAX_CREDIT
        self._header_payload, self._plausible = b"", compile_heads(0)

    def feed(self, content: bytes, *, last: bool = False) -> Iterator[Header | Frame]:
        """Yield the headers and frames that further bytes complete."""
        self._buffer += content
        self._credit = min(self._credit + EFFORT * len(content), MAX_CREDIT)
        version = self._buffer[4] if self._buffer.startswith(MAGIC) and len(self._buffer) > 4 else VERSION
        if version != VERSION and self.header is None and not self.malformed:
            raise RecordingError(f"{self.where}: has version {version} of the format; only {VERSION} is read")
        at = 0
        try:
            while found := self._plausible.search(self._buffer, at):
                start = found.start()
                self._skip(at, start)
                at = start
                _, _, kind, _, length = HEAD.unpack_from(self._buffer, start)
                stop = start + HEAD.size + length
                if len(self._buffer) < stop + CHECK.size:
                    if not last:
                        break
                    self._count(f"a record that ends after {len(self._buffer) - start} bytes")
                    at = self._pay(start, length)
                    continue
                with memoryview(self._buffer) as view:
                    checked = bytes(view[start + len(MAGIC) : stop])
                if CHECK.unpack_from(self._buffer, stop)[0] != zlib.crc32(checked):
                    self._count("a record of a wrong checksum")
                    at = self._pay(start, length)
                    continue
                at, self._lost = stop + CHECK.size, False
                yield from self._decode(kind, checked[HEAD.size - len(MAGIC) :])
            else:
                end = len(self._buffer)
                open_head = self._buffer.find(MAGIC, max(at, end - HEAD.size + 1))
                rest = end if last else open_head if open_head >= 0 else max(at, end - len(MAGIC) + 1)
                self._skip(at, rest)
                at = rest
        finally:
            del self._buffer[:at]

    def _decode(self, kind: int, payload: bytes) -> Iterator[Header | Frame]:
        """Yield the content of a whole record; a header that is repeated is not yielded again."""
        if kind == END:
            self.ended = True
        elif kind == FRAME:
            row = np.frombuffer(payload, dtype="<c8", offset=STAMP.size)
            if (np.abs(row.view("<f4")) <= LARGEST_V).all():
                counter, clock_s = STAMP.unpack_from(payload)
                yield Frame(counter, clock_s if abs(clock_s) <= LARGEST_CLOCK_S else math.nan, row)
            else:
                self._count(f"a frame with values that are NaN or above {LARGEST_V:g} V")
        elif payload != self._header_payload:
            self.header, self._header_payload = parse_header(payload, self.where), payload
            self._plausible = compile_heads(self.header.range_m.size)
            yield self.header

    def _skip(self, start: int, stop: int) -> None:
        """Count bytes that are no record, and heads among them that no record has."""
        skipped = self._buffer[start:stop]
        heads = 0 if self.header is None else skipped.count(MAGIC)
        if heads and len(skipped) - (at := skipped.rfind(MAGIC)) >= HEAD.size:
            _, version, kind, _, length = HEAD.unpack_from(skipped, at)
            self._count(f"a record of version {version}, kind {kind} and {length:,} bytes", heads)
        elif skipped:
            self._count(f"{len(skipped)} bytes that are no record", max(heads, not self._lost))

    def _pay(self, start: int, length: int) -> int:
        """Return where to search after a damaged record; too much work skips all bytes."""
        self._credit -= length + CHECK_COST
        return start + 1 if self._credit >= 0 else len(self._buffer)

    def _count(self, fault: str, number: int = 1) -> None:
        """Count malformed records; their remaining bytes are skipped."""
        if number:
            self.malformed, self.fault = self.malformed + number, fault
        self._lost = True


def compile_heads(n_bins: int) -> re.Pattern[bytes]:
    """Return the pattern of the heads of records; frames need a header first."""
    frame = re.escape(struct.pack("<I", STAMP.size + 8 * n_bins))
    kinds = [rb"\x01..(?:..\x00\x00|\x00\x00\x01\x00)", rb"\x03..\x00\x00\x00\x00", rb"\x02.." + frame]
    return re.compile(MAGIC + rb"\x01(?:" + b"|".join(kinds[: 3 if n_bins else 2]) + rb")", re.DOTALL)


@plugin("radar_writer", "frames", suffix=".dgf")
def write_frames(recording: Recording, path: str | Path) -> None:
    """Write a recording as frames, without its truth."""
    header = make_recording_header(recording)
    with open_atomically(path) as place, place.open("wb") as file:
        file.write(encode_header(header))
        for number, (time_s, row) in enumerate(zip(recording.slow_time_s, recording.samples.matrix, strict=True)):
            file.write(encode_frame(number, float(time_s), row))
        file.write(END_RECORD)


def make_recording_header(recording: Recording) -> Header:
    """Return the header of a recording's frames."""
    header = make_header(recording)
    facts = header.facts
    even_m = facts["range_start_m"] + facts["bin_spacing_m"] * np.arange(recording.n_range_bins)
    if not np.allclose(recording.range_m, even_m, rtol=0, atol=1e-3 * abs(facts["bin_spacing_m"])):
        raise RecordingError(f"{recording.source}: its range bins are not evenly spaced; frames need that")
    if recording.n_range_bins > recording.radar.n_range_bins:
        raise RecordingError(f"{recording.source}: has more range bins than its radar")
    return header


def make_header(recording: Recording) -> Header:
    """Return radar and ranges of a recording; bursts that only its facts state are added."""
    radar, pulses = recording.radar, int(recording.facts.get("burst_pulses", 1))
    if pulses > 1 and radar.burst_pulses is None and recording.n_pulses > pulses:
        period_s = max(float(np.median(np.diff(recording.slow_time_s[::pulses]))), pulses / radar.prf_hz)
        radar = radar.model_copy(update={"burst_pulses": pulses, "burst_period_s": period_s})
    return Header(radar, recording.range_m)


SETTLE_S, CREDIBLE, AGREE = 2.0, 100.0, 0.01
"""Shortest time that shows the rate of a sender, the ratio to the stated one above which its clock is not in s, and the
agreement of both halves without which the clock was set, or stands for blocks of frames."""


def find_rate_hz(radar: Radar, stamps: Iterable[tuple[int, float]]) -> tuple[float, str]:
    """Return the rate that a radar states, or that of the sender's clock where it differs over seconds, and doubts."""
    stated_hz, pairs = radar.prf_hz, list(stamps)
    table = np.array([(number - pairs[0][0], time_s) for number, time_s in pairs], dtype=np.float64).reshape(-1, 2)
    numbers, clock_s = table[:, 0].clip(-1e15, 1e15).astype(np.int64), table[:, 1]
    if radar.burst_pulses is not None or clock_s.size < 8 or not np.isfinite(clock_s).all():
        return stated_hz, ""
    if np.ptp(clock_s) < SETTLE_S or (np.diff(numbers) < 1).any():
        return stated_hz, ""
    half = clock_s.size // 2
    parts = [slice(None), slice(None, half), slice(half, None)]
    rates_hz = [measure_clock_rate_hz(clock_s[part], numbers[part]) or 0.0 for part in parts]
    off = rates_hz[0] / stated_hz
    if abs(off - 1.0) <= RATE_OFF and max(abs(one / stated_hz - 1.0) for one in rates_hz[1:]) <= AGREE:
        return stated_hz, ""
    if max(abs(one / max(rates_hz[0], 1e-9) - 1.0) for one in rates_hz[1:]) > AGREE:
        shown = " and ".join(f"{one:.4g}" for one in rates_hz[1:])
        return stated_hz, f"the sender's times are uneven ({shown} Hz in both halves): prf_hz = {stated_hz:g} is used"
    if not 1.0 / CREDIBLE < off < CREDIBLE:
        shown = f"the sender's times say {rates_hz[0]:.4g} Hz and are not in s"
        return stated_hz, f"{shown}: prf_hz = {stated_hz:g} is used"
    return rates_hz[0], ""


@plugin("radar_reader", "frames", sniff=lambda path, head: head.startswith(MAGIC), suffixes=(".dgf",))
def read_frames(path: Path) -> Recording:
    """Read frames that were saved as a file."""
    if not path.is_file():
        raise RecordingError(f"{path}: no such file")
    parser, header, start_s = FrameParser(str(path)), None, 0.0
    counters: list[int] = []
    clocks_s: list[float] = []
    rows: list[npt.NDArray[np.complex64]] = []
    with path.open("rb") as file:
        chunks = iter(partial(file.read, CHUNK_BYTES), b"")
        for item in chain(chain.from_iterable(map(parser.feed, chunks)), parser.feed(b"", last=True)):
            if isinstance(item, Frame):
                start_s = item.clock_s if not rows else start_s
                counters.append(item.counter or 0)
                clocks_s.append(item.clock_s)
                rows.append(item.row)
            elif header is None:
                header = item
            elif said := header.difference(item):
                raise RecordingError(f"{path}: has frames of two radars: {said}")
    if header is None or len(rows) < 2:
        raise RecordingError(f"{path}: holds {'no header' if header is None else f'{len(rows)} frames, 2 are needed'}")
    if parser.malformed:
        warn_caller(f"{path}: {parser.malformed:,} malformed frames are left out, the last is {parser.fault}")
    numbers, values, clock_s = np.array(counters, dtype=np.uint64), np.stack(rows), np.array(clocks_s)
    order = np.argsort(numbers, kind="stable")
    again = np.concatenate([[False], np.diff(numbers[order]) == 0])
    repeated = bool((values[order][again] == values[order][np.flatnonzero(again) - 1]).all())
    moved = int((order != np.arange(order.size)).sum() + again.sum())
    if moved and repeated and np.diff(numbers).view(np.int64).min() > -MAX_DISORDER:
        warn_caller(f"{path}: {moved:,} frames came out of order or twice; they are sorted by the frame counter")
        numbers, values, clock_s = (array[order[~again]] for array in (numbers, values, clock_s))
    pulses, steps = header.radar.burst_pulses, np.diff(numbers).view(np.int64)
    places = (numbers % (pulses or 1)).astype(np.int64)
    jumps = (steps < 1) | (steps > LARGEST_GAP)
    if jumps.any():  # as in a stream, but a burst starts again
        first = int(np.argmax(jumps))
        warn_caller(
            f"{path}: the frame counter jumps at {jumps.sum():,} places, first from {numbers[first]:,} to "
            f"{numbers[first + 1]:,}: another start of the sender; time continues there"
        )
        steps[jumps] = (pulses or 1) - places[:-1][jumps] + places[1:][jumps]
    numbers = places[0] + np.concatenate([[0], np.cumsum(steps)])
    if pulses is not None:  # bursts keep their times; incomplete bursts are ignored
        burst, counts = np.unique(numbers // pulses, return_counts=True)
        whole = np.isin(numbers // pulses, burst[counts == pulses])
        if not whole.any():
            raise RecordingError(f"{path}: has no complete burst of {pulses} frames")
        values, numbers, clock_s = values[whole], numbers[whole], clock_s[whole]
        if not whole.all():
            warn_caller(f"{path}: {np.sum(counts < pulses):,} incomplete bursts are ignored")
    slow_time_s = header.radar.frame_time_s(numbers)
    clock_hz, doubt = find_rate_hz(header.radar, zip(numbers, clock_s, strict=True))
    if doubt:
        warn_caller(f"{path}: {doubt}")
    if clock_hz != header.radar.prf_hz:
        slow_time_s = numbers / clock_hz
    slow_time_s += (start_s if math.isfinite(start_s) else 0.0) - slow_time_s[0]
    return label_measured(path, values, radar=header.radar, slow_time_s=slow_time_s, range_m=header.range_m)
