"""Live decisions on arriving frames, in fixed memory.

A thread reads frames from their source into a ring buffer of one window. Every hop it copies the
ring into a slot of one window. The caller takes the window from the slot, analyses it and decides
(:mod:`doppelgait.classify.timeline`). If the slot is still full at the next hop, the analysis is
too slow: the source waits (a file), or the newer window replaces the window in the slot and the hop
counts as skipped (a sensor). At most three windows are therefore in memory for any length of the
stream, and the age of the newest decision is at most one hop and two analyses.

Frames are placed on even times. A short gap is filled in between its neighbours, a longer one is a pause, as in files;
the analysis flags targets with many filled frames.
"""

from __future__ import annotations

import math
import queue
import threading
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.classify.decide import read_training_analysis
from doppelgait.classify.model import Model
from doppelgait.classify.model_file import load_model_for_radar
from doppelgait.classify.timeline import TrackDecision, Tracks, check_window
from doppelgait.core.errors import AnalysisError, ConfigError, warn_caller
from doppelgait.core.interrupt import raise_if_stopped
from doppelgait.core.labels import BASEBAND, make_array
from doppelgait.dataset.windows import TOLERANCE, Window, analyze_window
from doppelgait.pipeline import Result, Tracking
from doppelgait.processing import Analysis
from doppelgait.radar import Radar, Recording
from doppelgait.radar.recording import make_baseband_facts
from doppelgait.radar.slow_time import MAX_HOLE_PULSES, MAX_HOLE_S

POLL_S = 0.1  # interval, s, at which the other thread is checked
LATE_S = 1.0
"""Maximum delay, s, of a frame that counts as out of order; at a larger delay the source's clock has jumped."""
FOLLOWED = 0.05
"""Gain of the time tracking: fraction of a frame's time deviation that corrects the next expected time. The clocks of
radar and receiver differ by 1e-4, and jitter is less than half a frame."""
MANY = 0.2  # share of frames of the first window with the wrong rate at which a warning is issued


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

    def as_dict(self) -> dict[str, int]:
        """Return the counts by name."""
        return asdict(self)


RECEIVED, FILLED, ABSENT = 0, 1, 2  # origins of a row: a frame, a short gap, a pause


class _Ring:
    """Last window of a stream on even times."""

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


class Live:
    """Decisions of a stream, an iterator; made by :func:`live`."""

    def __init__(
        self,
        ring: _Ring,
        frames: Iterable[tuple[float, npt.ArrayLike]],
        tracks: Tracks,
        analysis: Analysis,
        tracking: Tracking | None,
        skip: bool,
    ) -> None:
        self._ring, self._tracks, self._analysis, self._tracking, self._skip = ring, tracks, analysis, tracking, skip
        self.window_s, self.hop_s = ring.window_s, ring.hop_s
        self._slot: queue.Queue[Window | Exception | None] = queue.Queue(1)
        self._closed = threading.Event()
        threading.Thread(target=self._receive, args=(frames,), daemon=True, name="frames of live").start()

    @property
    def counts(self) -> LiveCounts:
        """Frames and windows up to now."""
        return replace(self._ring.counts)

    def close(self) -> None:
        """Stop receiving frames."""
        self._closed.set()

    def __iter__(self) -> Iterator[TrackDecision]:
        for _, decisions, _ in self.windows():
            yield from decisions

    def windows(self) -> Iterator[tuple[Window, list[TrackDecision], list[Result]]]:
        """Yield every window with decisions and results."""
        try:
            while not self._closed.is_set():
                raise_if_stopped()
                try:
                    window = self._slot.get(timeout=POLL_S)
                except queue.Empty:
                    continue
                if isinstance(window, Exception):
                    raise window
                if window is None:
                    return
                counts = self._ring.counts
                counts.windows += 1
                if counts.windows == 1 and counts.filled + counts.late > MANY * counts.frames:
                    warn_caller(
                        f"of the first {counts.frames:,} frames {counts.late:,} were late, and {counts.filled:,} were "
                        f"missing: prf_hz = {self._ring.radar.prf_hz:g} does not match their times, or these are bursts"
                    )
                try:
                    results = analyze_window(window, self._analysis, self._tracking)
                except AnalysisError as error:
                    counts.failed += 1
                    if counts.failed == 1:
                        warn_caller(f"a window from {window.start_s:g} s on cannot be analysed: {error}")
                    continue
                yield window, self._tracks.add(window, results), results
        finally:
            self.close()

    def _receive(self, frames: Iterable[tuple[float, npt.ArrayLike]]) -> None:
        """Put windows into the slot; the receiving thread runs this."""
        try:
            for window in self._ring.windows(frames):
                if self._skip and self._slot.full():
                    try:
                        self._slot.get_nowait()
                        self._ring.counts.skipped += 1
                    except queue.Empty:  # the caller has just taken it
                        pass
                if not self._put(window):
                    return
            self._put(None)
        except Exception as error:
            self._put(error)

    def _put(self, item: Window | Exception | None) -> bool:
        """Wait until the slot is free; return False when closed."""
        while not self._closed.is_set():
            try:
                self._slot.put(item, timeout=POLL_S)
            except queue.Full:
                continue
            return True
        return False


def live(
    frames: Iterable[tuple[float, npt.ArrayLike]],
    radar: Radar,
    model: Model | None = None,
    *,
    window_s: float | None = None,
    hop_s: float | None = None,
    range_m: npt.ArrayLike | None = None,
    analysis: Analysis | None = None,
    tracking: Tracking | None = None,
    skip: bool = False,
) -> Live:
    """Classify targets while the frames of a radar arrive.

    The same frames as a file give the same decisions
    (:func:`doppelgait.classify.classify_over_time`). Memory does not grow with the length of the
    stream.

    Parameters
    ----------
    frames : iterable of (float, array_like of shape (N,), complex)
        Time in s and range bins in V of every frame, for example of
        :func:`doppelgait.radar.open_stream`. Times may jitter by less than half a frame. For a
        radar in bursts the first frame must be the start of a burst. A missing frame is filled in
        between its neighbours; after a gap longer than a window, the windows start again.
    model : Model, optional
        By default the included model that fits the radar.
    window_s, hop_s : float, optional
        As for :func:`doppelgait.classify.classify_over_time`.
    range_m : array_like, shape (N,), optional
        Ranges of the bins; those of the radar by default.
    analysis, tracking
        As for :func:`doppelgait.classify.classify`.
    skip : bool
        If the analysis is slower than the frames: True skips hops, so that decisions are not late
        (for a sensor); False makes the source wait (for a file).

    Returns
    -------
    Live
        An iterator of :class:`doppelgait.classify.TrackDecision`; its ``counts`` has the numbers of
        frames and windows up to now. It passes on every error that ``frames`` raises.

    Raises
    ------
    ConfigError
        If window, hop or ranges are not allowed, or no shipped model fits.

    See Also
    --------
    doppelgait.classify.classify_over_time : the same for a recording.

    Examples
    --------
    >>> import doppelgait as dg
    >>> scene = dg.Scene([dg.Target({"kind": "boulic"}, label="human")], duration_s=3.0)
    >>> recording = dg.simulate(scene, dg.Radar.preset("x4", prf_hz=640.0))
    >>> frames = zip(recording.slow_time_s, recording.baseband.values, strict=True)
    >>> [(decision.stop_s, decision.label) for decision in dg.live(frames, recording.radar, window_s=3.0)]
    [(3.0, 'human')]
    """
    model = model or load_model_for_radar(radar)
    window_s, hop_s = check_window(window_s, hop_s, model)
    ranges = radar.range_axis_m() if range_m is None else np.asarray(range_m, dtype=np.float64)
    if ranges.ndim != 1 or not ranges.size or not np.isfinite(ranges).all():
        raise ConfigError(f"range_m: must be finite, of shape (N,), not of shape {ranges.shape}")
    ring = _Ring(radar, ranges, window_s, hop_s)
    return Live(ring, frames, Tracks(model), analysis or read_training_analysis(model), tracking, skip)
