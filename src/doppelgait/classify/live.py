"""Live decisions on arriving frames, in fixed memory.

A thread fills a ring of one window, and copies it into a slot at every hop. If the caller has not taken the window
before, the source waits (a file), or the newer window replaces it and the hop counts as skipped (a sensor).
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.classify.decide import read_training_analysis
from doppelgait.classify.model import Model
from doppelgait.classify.model_file import load_model_for_radar
from doppelgait.classify.options import WindowOptions, takes_options
from doppelgait.classify.timeline import TrackDecision, Tracks, check_window
from doppelgait.core.errors import AnalysisError, ConfigError, warn_caller
from doppelgait.core.interrupt import raise_if_stopped
from doppelgait.dataset.windows import LiveCounts, Ring, Window, analyze_window
from doppelgait.pipeline import Result, Tracking
from doppelgait.pipeline.tracking import OTHER_SIGN
from doppelgait.processing import Analysis
from doppelgait.radar import Radar

POLL_S = 0.1  # interval, s, at which the other thread is checked
MANY = 0.2  # share of frames of the first window with the wrong rate at which a warning is issued

Frames = Iterable[tuple[float, npt.ArrayLike]]  # times in s, and the range bins of every frame


class Live:
    """Decisions of a stream, an iterator; made by :func:`live`."""

    def __init__(
        self, ring: Ring, frames: Frames, tracks: Tracks, analysis: Analysis, tracking: Tracking | None, skip: bool
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
        said = ""
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
                if OTHER_SIGN in results.reason and OTHER_SIGN not in said:
                    warn_caller(said := f"from {window.start_s:g} s on: {results.reason}")
                yield window, self._tracks.add(window, results), results
        finally:
            self.close()

    def _receive(self, frames: Frames) -> None:
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
        while not self._closed.is_set():
            try:
                self._slot.put(item, timeout=POLL_S)
            except queue.Full:
                continue
            return True
        return False


@takes_options(WindowOptions, but=("gate",))
def live(
    frames: Frames,
    radar: Radar,
    model: Model | None = None,
    *,
    range_m: npt.ArrayLike | None = None,
    skip: bool = False,
    **options: Any,
) -> Live:
    """Classify targets while the frames of a radar arrive.

    The same frames as a file give the same decisions; memory does not grow with the stream.

    Parameters
    ----------
    frames : iterable of (float, array_like of shape (N,), complex)
        Time in s and range bins in V of every frame, for example of
        :func:`doppelgait.radar.open_stream`. Times may jitter by less than half a frame. For a
        radar in bursts the first frame must be the start of a burst. A missing frame is filled in
        between its neighbours; after a gap longer than a window, the windows start again.
    model : Model, optional
        By default the included model that fits the radar.
    range_m : array_like, shape (N,), optional
        Ranges of the bins; those of the radar by default.
    skip : bool
        If the analysis is slower than the frames: True skips hops, so that decisions are not late
        (for a sensor); False makes the source wait (for a file).
    **options

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
    >>> recording = dg.data.sample()
    >>> frames = zip(recording.slow_time_s, recording.baseband.values, strict=True)
    >>> [(decision.stop_s, decision.label) for decision in dg.live(frames, recording.radar, window_s=3.0)]
    [(3.0, 'human'), (3.0, 'animal'), (3.6, 'human'), (3.6, 'animal')]
    """
    model = model or load_model_for_radar(radar)
    chosen = WindowOptions(**options)
    window_s, hop_s = check_window(chosen.window_s, chosen.hop_s, model)
    ranges = radar.range_axis_m() if range_m is None else np.asarray(range_m, dtype=np.float64)
    if ranges.ndim != 1 or not ranges.size or not np.isfinite(ranges).all():
        raise ConfigError(f"range_m: must be finite, of shape (N,), not of shape {ranges.shape}")
    ring = Ring(radar, ranges, window_s, hop_s)
    analysis = chosen.analysis or read_training_analysis(model.of_tracks)
    return Live(ring, frames, Tracks(model), analysis, chosen.tracking, skip)
