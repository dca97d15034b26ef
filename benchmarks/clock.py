"""Interleaved timing: every round runs every measured function once, so that a slow spell of the machine hits all."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterable, Mapping
from typing import Any

Work = Callable[[], Any]
Timing = dict[str, float]
"""``min`` and ``median`` over the measurements, s, or what follows from the one and from the other."""

SHORT_S = 0.02
MOST_REPEATS = 8


def measure(stages: Mapping[str, Work], rounds: int) -> dict[str, Timing]:
    """Least and median seconds of every stage over interleaved rounds, after one call to warm up.

    Work of less than 20 ms is repeated within a round, at most 8 times in a row; the median of these is what the round
    counts, so that short work has no more chances at a lucky minimum than long work.
    """
    for work in stages.values():
        work()
    seconds: dict[str, list[float]] = {name: [] for name in stages}
    for _ in range(rounds):
        for name, work in stages.items():
            once = timed(work)
            again = min(int(SHORT_S / once), MOST_REPEATS - 1)
            seconds[name].append(statistics.median([once, *(timed(work) for _ in range(again))]))
    return {name: timing(values) for name, values in seconds.items()}


def timed(work: Work) -> float:
    """Seconds of one call."""
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def timing(seconds: Iterable[float]) -> Timing:
    """Least and median of some measurements."""
    values = list(seconds)
    return {"min": min(values), "median": statistics.median(values)}


def combine(function: Callable[..., float], *timings: Timing) -> Timing:
    """Return a quantity from minima, and from medians."""
    return {key: function(*(timing[key] for timing in timings)) for key in ("min", "median")}


def ratio(slow: Timing, *fast: Timing) -> Timing:
    """How many times ``fast`` (several: one after the other) goes into ``slow``."""
    return combine(lambda numerator, *parts: numerator / sum(parts), slow, *fast)


def total(*parts: Timing) -> Timing:
    """Sum of parts."""
    return combine(lambda *seconds: sum(seconds), *parts)
