"""Windows of a recording: cut, analysed and linked to tracks.

A window is analysed like a separate recording, so that a stream and its file give the same result:
one pass of the tracker over the whole recording would smooth backwards.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import count, product
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.core.errors import AnalysisError
from doppelgait.core.labels import BASEBAND, make_array, read_axis
from doppelgait.core.units import FloatArray
from doppelgait.pipeline.analyze import analyze
from doppelgait.pipeline.result import Result, TargetList
from doppelgait.pipeline.tracking import Tracking
from doppelgait.processing import Analysis
from doppelgait.radar.parameters import Radar
from doppelgait.radar.recording import Recording, make_baseband_facts
from doppelgait.radar.slow_time import MAX_HOLE_PULSES, MAX_HOLE_S

TOLERANCE = 0.01  # tolerance of limits, as a fraction of the period of pulses (or bursts)
LINK_M, LINK_GROWS_MPS = 0.6, 0.4
"""Maximum distance at which a target continues a path, and its growth with the time without a detection."""
LINK_MPS = 1.5  # largest jump of the radial speed across a gap
COAST_S, LOST_S = 2.0, 6.0
"""Time for which a path is extrapolated (as long as two bodies share a detection), and time after which it is lost."""
LEAST_COMMON_S, STEP_S = 0.3, 0.1
TIMES = ("track_confirmed_at_s", *map("".join, product(("", "track_", "still_"), ("start_s", "stop_s"))))
"""Times among the diagnostics of a result."""


class Window(NamedTuple):
    """Part of a recording, with times that start at 0."""

    start_s: float
    stop_s: float
    recording: Any


def cut(
    recording: Recording | xr.DataArray,
    *,
    start_s: float | None = None,
    stop_s: float | None = None,
    window_s: float | None = None,
    step_s: float | None = None,
) -> Iterator[Window]:
    """Split a recording into windows; times count from its start."""
    if isinstance(recording, xr.DataArray):
        times_s, pulses = read_axis(recording, "time"), 1
    else:
        times_s = recording.slow_time_s.astype(np.float64)
        pulses = recording.frames.slow_time.find_bursts().burst_pulses or 1
    blocks_s = times_s[: times_s.size // pulses * pulses : pulses] - times_s[0]  # bursts are never split
    if blocks_s.size < 2:
        raise AnalysisError(f"has {blocks_s.size} {'pulses' if pulses == 1 else 'bursts'}, at least 2 are needed")
    period_s = float(blocks_s[-1] / (blocks_s.size - 1))
    duration_s, margin_s = blocks_s.size * period_s, TOLERANCE * period_s
    begin, end = start_s or 0.0, duration_s if stop_s is None else stop_s
    for name, limit_s, value in (("start_s", begin, begin + period_s), ("stop_s", end, end)):
        if value > duration_s + margin_s:
            raise AnalysisError(f"{name} = {limit_s:g}: the recording lasts {duration_s:.6g} s")

    def make_window(start_s: float, stop_s: float) -> Window:
        # pulses of blocks that begin in [start_s, stop_s)
        first, last = np.searchsorted(blocks_s, [start_s - margin_s, stop_s - margin_s])
        part = slice(int(first) * pulses, int(last) * pulses)
        if isinstance(recording, xr.DataArray):
            cropped = recording.isel(time=part)
            times = ("time", read_axis(cropped, "time") - read_axis(cropped, "time")[:1], cropped["time"].attrs)
            return Window(start_s, stop_s, cropped.assign_coords(time=times))
        frames = recording.frames.take_pulses(part)
        times_s = frames.slow_time.time_s
        if times_s.size < 2:
            raise AnalysisError(f"{start_s:g} to {stop_s:g} s: holds {times_s.size} pulses, at least 2 are needed")
        frames = replace(frames, slow_time=replace(frames.slow_time, time_s=times_s - times_s[0]))
        return Window(start_s, stop_s, recording.with_frames(frames, truth=()))

    if window_s is None or step_s is None:
        return iter([make_window(begin, end)])
    n_windows = int(np.floor((end - begin - window_s + margin_s) / step_s)) + 1
    if n_windows < 1:
        raise AnalysisError(f"lasts {end - begin:.6g} s, less than a window of {window_s:g} s")
    starts_s = (begin + n * step_s for n in range(n_windows))
    return (make_window(at, min(at + window_s, end)) for at in starts_s)  # one in memory


def cut_windows(recording: Recording, window_s: float, hop_s: float) -> Iterator[Window]:
    """Split a recording into windows that start every hop, with its own times and truth."""
    first_s = float(recording.slow_time_s[0])
    for window in cut(recording, window_s=window_s, step_s=hop_s):
        start_s, content = first_s + window.start_s, window.recording
        if recording.truth:
            margin_s = TOLERANCE / recording.radar.prf_hz
            first = int(np.searchsorted(recording.slow_time_s, start_s - margin_s))
            pulses = slice(first, first + content.n_pulses)
            content = replace(
                content, truth=[one.during(pulses, start_s, start_s + window_s) for one in recording.truth]
            )
        yield Window(start_s, start_s + window_s, content)


def analyze_window(
    window: Window, analysis: Analysis, tracking: Tracking | None = None, gate: Any = "track"
) -> TargetList:
    """Analyse a window; times refer to the recording."""
    results = analyze(window.recording, gate=gate, analysis=analysis, tracking=tracking)
    return TargetList((_delay_result(result, window.start_s) for result in results), reason=results.reason)


def _delay_result(result: Result, by_s: float) -> Result:
    quality = {name: v + by_s if name in TIMES and v is not None else v for name, v in result.quality.items()}
    return replace(result, quality=quality, segments=tuple(_delay_result(one, by_s) for one in result.segments))


# Streams -------------------------------------------------------------------------------------------------------------

LATE_S = 1.0
"""Maximum delay, s, of a frame that counts as out of order; at a larger delay the source's clock has jumped."""
FOLLOWED = 0.05
"""Gain of the time tracking: fraction of a frame's time deviation that corrects the next expected
time. The clocks of radar and receiver differ by 1e-4, and jitter is less than half a frame."""


@dataclass
class LiveCounts:
    """Frames and windows of a stream, by outcome."""

    frames: int = 0
    filled: int = 0
    malformed: int = 0
    late: int = 0
    jumps: int = 0
    windows: int = 0
    skipped: int = 0
    failed: int = 0


RECEIVED, FILLED, ABSENT = 0, 1, 2  # origins of a row: a frame, a short gap, a pause


class Ring:
    """Last window of a stream on even times, with short gaps filled in."""

    def __init__(self, radar: Radar, range_m: npt.NDArray[np.float64], window_s: float, hop_s: float) -> None:
        self.radar, self.range_m, self.window_s, self.hop_s = radar, range_m, window_s, hop_s
        self.counts = LiveCounts()
        # windows start between blocks, as in files: a block is a frame or a burst
        self._block_rows, self._block_hz = 1, radar.prf_hz
        if radar.burst_pulses is not None and radar.burst_period_s is not None:
            self._block_rows, self._block_hz = radar.burst_pulses, 1.0 / radar.burst_period_s
        n_rows = (math.ceil(window_s * self._block_hz) + 1) * self._block_rows
        self._rows = np.zeros((n_rows, range_m.size), dtype=np.complex64)
        self._origin = np.zeros(n_rows, dtype=np.int8)  # RECEIVED, FILLED or ABSENT
        self._last = self._rows[0].copy()
        self._start_s, self._due_s, self._ahead_s = 0.0, math.nan, 0.0
        self._n_rows, self._n_windows = 0, 0

    def windows(self, frames: Iterable[tuple[float, npt.ArrayLike]]) -> Iterator[Window]:
        """Yield every window when its last frame has arrived."""
        prf_hz, counts = self.radar.prf_hz, self.counts
        for told_s, values in frames:
            counts.frames += 1
            row = np.array(values, dtype=np.complex64)
            if row.shape != self.range_m.shape or not np.isfinite(row).all():
                counts.malformed += 1
                continue
            time_s = float(told_s) + self._ahead_s
            if not math.isfinite(time_s):
                time_s = self._due_s if self._n_rows else 0.0
            missing = self._count_missing(time_s) if self._n_rows else 0
            if missing < 0:
                if self._due_s - time_s <= LATE_S:
                    counts.late += 1
                    continue
                counts.jumps += 1
                self._ahead_s += self._due_s - time_s
                time_s, missing = self._due_s, 0
            if missing > self._rows.shape[0]:
                if (self._n_rows + missing) % self._block_rows:  # restart with a complete burst
                    continue
                counts.jumps += 1
                self._n_rows = self._n_windows = missing = 0
            if self._n_rows == 0:
                self._start_s = self._due_s = time_s
            if self._block_rows > 1:
                self._due_s = self._start_s + float(self.radar.frame_time_s(self._n_rows + missing + 1))
            else:
                self._due_s += (missing + 1) / prf_hz
                self._due_s += FOLLOWED * (time_s + 1 / prf_hz - self._due_s)
            counts.filled += missing
            is_short = missing <= max(MAX_HOLE_PULSES, MAX_HOLE_S * prf_hz)
            for number in range(1, missing + 1):
                share = np.float64(number / (missing + 1))
                yield from self._push((1 - share) * self._last + share * row, FILLED if is_short else ABSENT)
            self._last = row
            yield from self._push(row, RECEIVED)

    def _count_missing(self, time_s: float) -> int:
        """Count frames missing before a time, negative if late."""
        prf_hz, period_s = self.radar.prf_hz, self.radar.burst_period_s
        if period_s is None:
            return round((time_s - self._due_s) * prf_hz)
        since_s = time_s - self._start_s
        burst = math.floor((since_s + 0.5 / prf_hz) / period_s)
        place = min(round((since_s - burst * period_s) * prf_hz), self._block_rows - 1)
        return burst * self._block_rows + place - self._n_rows

    def _push(self, row: npt.NDArray[Any], came_from: int) -> Iterator[Window]:
        """Add a row and start windows at the positions used for files."""
        self._rows[self._n_rows % self._rows.shape[0]] = row
        self._origin[self._n_rows % self._rows.shape[0]] = came_from
        self._n_rows += 1
        begin_s = self._n_windows * self.hop_s
        first, stop = (
            math.ceil(time_s * self._block_hz - TOLERANCE) * self._block_rows
            for time_s in (begin_s, begin_s + self.window_s)
        )
        if self._n_rows < stop:
            return
        self._n_windows += 1
        pulses = np.arange(first, self._n_rows)
        times_s = self.radar.frame_time_s(pulses)
        origin = self._origin[pulses % self._rows.shape[0]]
        there = np.flatnonzero((origin != ABSENT) | (self._block_rows > 1))  # bursts stay whole
        there = there if there.size > 1 else np.arange(origin.size)
        coords = {"slow_time": (times_s - times_s[0])[there], "range": self.range_m}
        rows = self._rows[pulses[there] % self._rows.shape[0]]
        facts = make_baseband_facts(self.radar) | {"lost_frame_share": float((origin[there] != RECEIVED).mean())}
        baseband = make_array(BASEBAND, rows, coords, facts)
        start_s = self._start_s + begin_s
        yield Window(start_s, start_s + self.window_s, Recording.from_baseband(baseband, self.radar, source="live"))


# Linking -------------------------------------------------------------------------------------------------------------


class Path(NamedTuple):
    """Ranges of a target in one window, every tenth of a second."""

    time_s: FloatArray
    range_m: FloatArray

    @classmethod
    def of(cls, result: Result, window: Window) -> Path:
        """Return a target's path from its gate."""
        gate = result.gate
        n_steps = max(math.ceil((gate.stop_s - gate.start_s) / STEP_S), 1)
        own_s = np.linspace(gate.start_s, gate.stop_s, n_steps + 1)
        return cls(own_s + window.start_s, gate.centre_at(own_s))

    def approach_mps(self, *, at_end: bool) -> float:
        """Return the radial speed at one end."""
        part = slice(-6, None) if at_end else slice(None, 6)
        times_s, range_m = self.time_s[part], self.range_m[part]
        return -float((range_m[-1] - range_m[0]) / max(times_s[-1] - times_s[0], STEP_S))

    def measure_distance_m(self, later: Path) -> float:
        """Return the distance to a later path, m."""
        common = later.time_s[(later.time_s >= self.time_s[0]) & (later.time_s <= self.time_s[-1])]
        if common.size * STEP_S >= LEAST_COMMON_S:
            apart = np.interp(common, self.time_s, self.range_m) - np.interp(common, later.time_s, later.range_m)
            distance_m = float(np.abs(apart).mean())
            return distance_m if distance_m <= LINK_M else math.inf
        gap_s = max(float(later.time_s[0] - self.time_s[-1]), 0.0)
        before_mps, after_mps = self.approach_mps(at_end=True), later.approach_mps(at_end=False)
        distance_m = abs(float(later.range_m[0] - self.range_m[-1]) + before_mps * min(gap_s, COAST_S))
        linked = distance_m <= LINK_M + LINK_GROWS_MPS * gap_s and abs(after_mps - before_mps) <= LINK_MPS
        return distance_m if linked and gap_s <= LOST_S else math.inf


class Links:
    """Numbers of tracks for the targets of successive windows."""

    def __init__(self) -> None:
        self.paths: dict[int, Path] = {}  # of the tracks that can be continued
        self._numbers = count()

    def add(self, window: Window, results: Sequence[Result]) -> list[int]:
        """Return the track of every target: the nearest pairs first."""
        new = [Path.of(result, window) for result in results]
        pairs = sorted(
            (distance_m, number, n)
            for number, path in self.paths.items()
            for n, later in enumerate(new)
            if (distance_m := path.measure_distance_m(later)) < math.inf
        )
        found: dict[int, int] = {}
        for _, number, n in pairs:
            if n not in found and number not in found.values():
                found[n] = number
        numbers = [found[n] if n in found else next(self._numbers) for n in range(len(new))]
        self.paths.update(zip(numbers, new, strict=True))
        self.paths = {n: path for n, path in self.paths.items() if window.stop_s - path.time_s[-1] <= LOST_S}
        return numbers
