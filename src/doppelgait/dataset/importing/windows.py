"""Parts of a recording: from one time to another, or cut into windows."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import AnalysisError
from doppelgait.core.labels import BASEBAND, axis, make_array
from doppelgait.processing import burst_pulses_of
from doppelgait.radar.recording import Recording

TOLERANCE = 0.01
"""Part of a pulse's (or burst's) period by which limits may be missed."""


@dataclass(frozen=True)
class Part:
    """A part of a recording, its times from 0.

    Parameters
    ----------
    start_s, stop_s : float
        In the time of the whole recording, from its first pulse.
    recording : Recording
        Without truth: an imported recording is analysed as a measured one.
    """

    start_s: float
    stop_s: float
    recording: Recording


@dataclass(frozen=True)
class _Blocks:
    """Pulses, or bursts of pulses, which are never cut.

    Parameters
    ----------
    starts_s : ndarray
        From the first.
    pulses : int
        In each.
    period_s : float
        From one to the next, in the mean.
    """

    starts_s: npt.NDArray[np.float64]
    pulses: int
    period_s: float

    @property
    def duration_s(self) -> float:
        return self.starts_s.size * self.period_s

    def between(self, start_s: float, stop_s: float) -> slice:
        """Pulses of the blocks that begin in [start_s, stop_s)."""
        margin_s = TOLERANCE * self.period_s
        first, last = np.searchsorted(self.starts_s, [start_s - margin_s, stop_s - margin_s])
        return slice(int(first) * self.pulses, int(last) * self.pulses)


def cut(
    recording: Recording, *, start_s: float | None = None, stop_s: float | None = None,
    window_s: float | None = None, step_s: float | None = None,
) -> list[Part]:  # fmt: skip
    """Parts of a recording.

    Parameters
    ----------
    recording : Recording
    start_s, stop_s : float, optional
        What is meant of it, from its first pulse; all by default.
    window_s, step_s : float, optional
        Length of a window, and from the start of one to that of the next. A rest shorter than a window is left out.

    Returns
    -------
    list of Part
        One without ``window_s``.

    Raises
    ------
    AnalysisError
        If the recording ends before ``stop_s``, or what is meant is shorter than a window.
    """
    blocks = _blocks(recording)
    duration_s = blocks.duration_s
    margin_s = TOLERANCE * blocks.period_s
    begin, end = start_s or 0.0, duration_s if stop_s is None else stop_s
    for name, value in (("start_s", begin + blocks.period_s), ("stop_s", end)):
        if value > duration_s + margin_s:
            given = begin if name == "start_s" else end
            raise AnalysisError(f"{name} = {given:g}: the recording lasts {duration_s:.6g} s")
    if window_s is None or step_s is None:
        return [_part(recording, blocks, begin, end)]
    count = int(np.floor((end - begin - window_s + margin_s) / step_s)) + 1
    if count < 1:
        raise AnalysisError(f"lasts {end - begin:.6g} s, less than a window of {window_s:g} s")
    starts_s = (begin + n * step_s for n in range(count))
    return [_part(recording, blocks, at, min(at + window_s, end)) for at in starts_s]


def _blocks(recording: Recording) -> _Blocks:
    times_s = axis(recording.baseband, "slow_time").astype(np.float64)
    pulses = burst_pulses_of(recording.baseband) or 1
    starts_s = times_s[: times_s.size // pulses * pulses : pulses] - times_s[0]
    if starts_s.size < 2:
        raise AnalysisError(f"has {starts_s.size} {'pulses' if pulses == 1 else 'bursts'}, at least 2 are needed")
    return _Blocks(starts_s, pulses, float(starts_s[-1] / (starts_s.size - 1)))


def _part(recording: Recording, blocks: _Blocks, start_s: float, stop_s: float) -> Part:
    """A recording of its own from a part of another."""
    whole = recording.baseband
    chosen = blocks.between(start_s, stop_s)
    times_s = axis(whole, "slow_time")[chosen]
    if times_s.size < 2:
        raise AnalysisError(f"{start_s:g} to {stop_s:g} s: holds {times_s.size} pulses, at least 2 are needed")
    coords = {"slow_time": times_s - times_s[0], "range": axis(whole, "range")}
    baseband = make_array(BASEBAND, whole.values[chosen], coords, whole.attrs)
    return Part(start_s, stop_s, replace(recording, baseband=baseband, truth=()))
