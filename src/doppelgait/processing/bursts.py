"""Signature of pulse bursts: no processing interval may cross a pause, so every burst becomes one column."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import AnalysisError, warn_caller
from doppelgait.core.frames import PAUSE, Frames, SlowTime
from doppelgait.core.lazy import xr
from doppelgait.core.samples import Samples
from doppelgait.core.units import FloatArray
from doppelgait.processing.config import MIN_CPI_PULSES, Analysis, Transform, choose_doppler_bins, gaussian_window
from doppelgait.processing.gate import Gate

UNEVEN = 0.1
"""Largest relative deviation of a burst period from the usual period that causes no warning."""


def find_burst_pulses(slow_time_s: npt.ArrayLike) -> int | None:
    """Count the pulses per burst from pauses.

    The result is None if the pauses are not those between bursts: four or more of one length, at even times.

    Parameters
    ----------
    slow_time_s : array_like, shape (I,)
        Times of the pulses, ascending.

    Examples
    --------
    >>> import numpy as np
    >>> from doppelgait.processing import find_burst_pulses
    >>> burst_s = np.arange(8) * 0.001
    >>> find_burst_pulses(np.concatenate([burst_s + 0.1 * n for n in range(10)]))
    8
    """
    return SlowTime(np.asarray(slow_time_s, dtype=float)).find_bursts().burst_pulses


def get_burst_pulses(baseband: xr.DataArray) -> int | None:
    """Return the pulses per burst, as stated or from the pulse times; None without bursts."""
    return Frames.of(baseband).slow_time.find_bursts().burst_pulses


def average_bursts(frames: Frames) -> Frames:
    """Average the pulses of each burst, to observe slow motion."""
    pulses = frames.slow_time.burst_pulses
    if pulses is None:
        return frames
    times_s = frames.slow_time.split_bursts().mean(axis=1)
    values = frames.matrix[: times_s.size * pulses].reshape(times_s.size, pulses, -1).mean(axis=1)
    facts = {name: value for name, value in frames.facts.items() if name != "burst_pulses"}
    return replace(frames, samples=Samples(values), slow_time=SlowTime(times_s), facts=facts)


def make_frame_gate(frames: Frames) -> Gate:
    """Make the gate over every range bin."""
    range_m = frames.range_m
    spacing_m = float((range_m[-1] - range_m[0]) / max(range_m.size - 1, 1))
    ends_s = frames.slow_time.time_s[[0, -1]]
    return Gate(ends_s, np.full(2, range_m.mean()), spacing_m * range_m.size, None, "frame")


def split_bursts(slow_time: SlowTime, analysis: Analysis) -> tuple[Transform, float, FloatArray, int]:
    """Divide slow time into bursts; return transform, rate, times (J,) and period in pulses."""
    pulses = slow_time.burst_pulses or 0
    if pulses < MIN_CPI_PULSES:
        raise AnalysisError(
            f"a burst has {pulses} pulse{'s' * (pulses != 1)}, at least {MIN_CPI_PULSES} are needed to measure Doppler"
        )
    count = slow_time.size // pulses
    if not count:
        raise AnalysisError(f"the recording has {slow_time.size} pulses, less than one burst of {pulses}")
    times = slow_time.split_bursts()
    lengths_s, steps_s = times[:, -1] - times[:, 0], np.diff(times, axis=1)
    paused = steps_s.max() > PAUSE * np.median(steps_s)  # bursts do not begin where they are taken to
    if paused or not (steps_s > 0).all() or np.ptp(lengths_s) > 0.5 * lengths_s.mean() / (pulses - 1):
        raise AnalysisError(
            f"slow time does not fall into bursts of {pulses} evenly spaced pulses; pulses are missing, their rate is "
            "uneven or burst_pulses is wrong"
        )
    middle_s = times.mean(axis=1)
    periods_s = np.diff(middle_s)
    prf_hz = slow_time.pulse_rate_hz
    period_s = float(np.median(periods_s)) if count > 1 else pulses / prf_hz
    uneven = int((np.abs(periods_s - period_s) > UNEVEN * period_s).sum())
    if uneven:
        warn_caller(
            f"{uneven} of {periods_s.size} periods between bursts differ from the usual {period_s:.4g} s: bursts are "
            "missing or late, and cadence frequencies are inaccurate there"
        )
    window = gaussian_window(pulses, analysis.window_steepness)
    transform = Transform(window, choose_doppler_bins(analysis, pulses, "a burst"), pulses, 0, count)
    return transform, prf_hz, middle_s, max(1, round(period_s * prf_hz))
