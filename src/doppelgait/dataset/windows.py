"""Windows of a recording: cut, analysed and linked to tracks.

A window is analysed like a separate recording, so that a stream and its file give the same result,
and an overlap of two bodies affects only its own windows. A target continues the track with the
same path where the windows overlap, or with a path that leads to it across a gap. One pass of the
tracker over the whole recording would smooth backwards, so that a stream could not have its tracks.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.core.errors import AnalysisError
from doppelgait.core.labels import read_axis
from doppelgait.core.units import FloatArray
from doppelgait.pipeline.analyze import analyze
from doppelgait.pipeline.result import Result
from doppelgait.pipeline.tracking import Tracking
from doppelgait.processing import Analysis
from doppelgait.radar.recording import Recording

TOLERANCE = 0.01
"""Tolerance of limits, as a fraction of the period of pulses (or bursts)."""
LINK_M, LINK_GROWS_MPS = 0.6, 0.4
"""Maximum distance at which a target continues a path, and its growth with the time without a detection."""
LINK_MPS = 1.5  # largest jump of the radial speed across a gap
COAST_S, LOST_S = 2.0, 6.0
"""Time for which a path is extrapolated (as long as two bodies share a detection), and time after which it is lost."""
LEAST_COMMON_S, STEP_S = 0.3, 0.1
TIMES = (
    "start_s",
    "stop_s",
    "track_start_s",
    "track_stop_s",
    "track_confirmed_at_s",
    "still_start_s",
    "still_stop_s",
)
"""Times among the diagnostics of a result."""


class Window(NamedTuple):
    """Part of a recording, with times that start at 0."""

    start_s: float
    stop_s: float
    recording: Any


@dataclass(frozen=True)
class _Blocks:
    """Pulses, or bursts of pulses, which are never split."""

    starts_s: npt.NDArray[np.float64]
    pulses: int
    period_s: float

    @property
    def duration_s(self) -> float:
        return self.starts_s.size * self.period_s

    def between(self, start_s: float, stop_s: float) -> slice:
        # pulses of blocks that begin in [start_s, stop_s)
        margin_s = TOLERANCE * self.period_s
        first, last = np.searchsorted(self.starts_s, [start_s - margin_s, stop_s - margin_s])
        return slice(int(first) * self.pulses, int(last) * self.pulses)


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
    block_starts_s = times_s[: times_s.size // pulses * pulses : pulses] - times_s[0]
    if block_starts_s.size < 2:
        raise AnalysisError(f"has {block_starts_s.size} {'pulses' if pulses == 1 else 'bursts'}, at least 2 are needed")
    blocks = _Blocks(block_starts_s, pulses, float(block_starts_s[-1] / (block_starts_s.size - 1)))
    duration_s = blocks.duration_s
    margin_s = TOLERANCE * blocks.period_s
    begin, end = start_s or 0.0, duration_s if stop_s is None else stop_s
    for name, value in (("start_s", begin + blocks.period_s), ("stop_s", end)):
        if value > duration_s + margin_s:
            limit_s = begin if name == "start_s" else end
            raise AnalysisError(f"{name} = {limit_s:g}: the recording lasts {duration_s:.6g} s")
    if window_s is None or step_s is None:
        return iter([_make_window(recording, blocks, begin, end)])
    n_windows = int(np.floor((end - begin - window_s + margin_s) / step_s)) + 1
    if n_windows < 1:
        raise AnalysisError(f"lasts {end - begin:.6g} s, less than a window of {window_s:g} s")
    starts_s = (begin + n * step_s for n in range(n_windows))
    return (_make_window(recording, blocks, at, min(at + window_s, end)) for at in starts_s)  # one in memory


def _make_window(recording: Recording | xr.DataArray, blocks: _Blocks, start_s: float, stop_s: float) -> Window:
    pulses = blocks.between(start_s, stop_s)
    if isinstance(recording, xr.DataArray):
        cropped = recording.isel(time=pulses)
        times = ("time", read_axis(cropped, "time") - read_axis(cropped, "time")[:1], cropped["time"].attrs)
        return Window(start_s, stop_s, cropped.assign_coords(time=times))
    frames = recording.frames.take_pulses(pulses)
    times_s = frames.slow_time.time_s
    if times_s.size < 2:
        raise AnalysisError(f"{start_s:g} to {stop_s:g} s: holds {times_s.size} pulses, at least 2 are needed")
    frames = replace(frames, slow_time=replace(frames.slow_time, time_s=times_s - times_s[0]))
    return Window(start_s, stop_s, recording.with_frames(frames, truth=()))


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
) -> list[Result]:
    """Analyse a window; times refer to the recording."""
    results = analyze(window.recording, gate=gate, analysis=analysis, tracking=tracking)
    return [_delay_result(result, window.start_s) for result in results]


def _delay_result(result: Result, by_s: float) -> Result:
    quality = {name: v + by_s if name in TIMES and v is not None else v for name, v in result.quality.items()}
    return replace(result, quality=quality, segments=tuple(_delay_result(one, by_s) for one in result.segments))


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
        self._paths: dict[int, Path] = {}
        self._numbers = count()

    def add(self, window: Window, results: Sequence[Result]) -> list[int]:
        """Return the track of every target: the nearest pairs first."""
        new = [Path.of(result, window) for result in results]
        pairs = sorted(
            (distance_m, number, n)
            for number, path in self._paths.items()
            for n, later in enumerate(new)
            if (distance_m := path.measure_distance_m(later)) < math.inf
        )
        found: dict[int, int] = {}
        for _, number, n in pairs:
            if n not in found and number not in found.values():
                found[n] = number
        numbers = [found[n] if n in found else next(self._numbers) for n in range(len(new))]
        self._paths.update(zip(numbers, new, strict=True))
        self._paths = {n: path for n, path in self._paths.items() if window.stop_s - path.time_s[-1] <= LOST_S}
        return numbers

    @property
    def kept(self) -> set[int]:
        """Tracks that can be continued."""
        return set(self._paths)
