"""Frames of a recording, which every step takes and returns: samples, slow time and range axis, read in tiles."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from doppelgait.core import lazy
from doppelgait.core.labels import BASEBAND, check_signal, make_array, read_axis, sampling_rate_hz
from doppelgait.core.lazy import LateRows, read_pulses, xr
from doppelgait.core.samples import Matrix, Samples
from doppelgait.core.units import FloatArray

SLACK_S = 1e-9  # tolerance for the rounding of pulse times
PAUSE = 1.5  # ratio of a slow-time step to the usual step above which the step is a pause
MIN_BURSTS, WHOLE_SHARE, PERIOD_OFF, RARE_SHARE = 3, 0.8, 0.1, 0.2
"""Proof of bursts: their number, the share of those alike, the deviation of their period, the pause in it."""
LONGEST_BURST_S, MIN_DUTY, SHORTEST_S = 0.15, 0.01, 1e-5
"""A longer burst would show motion alone; a shorter one, of uneven or faster pulses, is a packet."""
SAME_STEP, MAX_PIECES = 0.01, 64
"""Largest relative difference of the steps of a piece, and number of pieces above which the times only jitter."""


@dataclass(frozen=True, eq=False)
class SlowTime:
    """Times of the pulses, s, the owner of their rate; ``burst_pulses`` is None without bursts."""

    time_s: FloatArray
    burst_pulses: int | None = None

    @property
    def size(self) -> int:
        """Number of pulses."""
        return self.time_s.size

    @property
    def start_s(self) -> float:
        """Time of the first pulse."""
        return float(self.time_s[0])

    @property
    def duration_s(self) -> float:
        """Time from the first to the last pulse."""
        return float(self.time_s[-1] - self.time_s[0])

    @cached_property
    def rate_hz(self) -> float:
        """Mean pulse rate, pauses between bursts included."""
        return sampling_rate_hz(self.time_s)

    @cached_property
    def pulse_rate_hz(self) -> float:
        """Pulse rate within bursts, which sets the unambiguous velocity."""
        if self.burst_pulses is None or self.size < self.burst_pulses:
            return self.rate_hz
        bursts_s = self.split_bursts()
        return float((self.burst_pulses - 1) / (bursts_s[:, -1] - bursts_s[:, 0]).mean())

    def split_bursts(self) -> FloatArray:
        """Return the times of whole bursts, (burst, pulse)."""
        pulses = self.burst_pulses or 1
        return self.time_s[: self.size // pulses * pulses].reshape(-1, pulses)

    def find_bursts(self) -> SlowTime:
        """Count the pulses of a burst from the pauses, where no file or radar states them."""
        bursts = prove_bursts(self.time_s) if self.burst_pulses is None else None
        if bursts is None or not bursts[1][: -bursts[0]].all():
            return self
        return replace(self, burst_pulses=bursts[0])

    def find_pieces(self) -> list[slice]:
        """Divide the pulses at pauses, and where their rate changes; bursts are one piece."""
        whole, steps = slice(0, self.size), np.diff(self.time_s)
        if steps.size < 2 or self.find_bursts().burst_pulses is not None:
            return [whole]
        least = np.minimum(steps[1:], steps[:-1])
        changes = np.flatnonzero(np.abs(np.diff(steps)) > SAME_STEP * least) + 1
        if changes.size > 2 * MAX_PIECES:  # jitter
            changes = np.flatnonzero(steps > PAUSE * np.median(steps)) + 1
        # a pause is a change of the step, and at once another
        cuts = changes[np.append(np.diff(changes) != 1, True)] if changes.size else changes
        cuts[-1:] += cuts[-1:] == steps.size - 1  # a pause before the last pulse
        return [slice(int(a), int(b)) for a, b in zip([0, *cuts], [*cuts, self.size], strict=True)]

    def __getitem__(self, pulses: slice) -> SlowTime:
        return replace(self, time_s=self.time_s[pulses])

    def find_pulses(self, start_s: float, stop_s: float) -> slice:
        """Return the pulses from ``start_s`` to ``stop_s``, both included; bursts stay whole."""
        first, stop = np.searchsorted(self.time_s, [start_s - SLACK_S, stop_s + SLACK_S])
        pulses = self.burst_pulses or 1
        return slice(int(first) // pulses * pulses, min(-(-int(stop) // pulses) * pulses, self.size))


def prove_bursts(time_s: FloatArray) -> tuple[int, npt.NDArray[np.bool_]] | None:
    """Return the pulses of a burst, and which pulses are in whole bursts; None without proof."""
    # Bursts are alike and regular; pulses that a recorder lost are few, and a pause is rare.
    steps = np.diff(time_s)
    if steps.size < 2 or not (steps >= 0).all():
        return None
    # Pauses are the longest steps up to the largest drop of the sorted steps; at most every other step is a pause.
    ranked, mean_s = np.sort(steps)[::-1], float(steps.mean())
    few = slice(MIN_BURSTS - 2, (steps.size + 1) // 2)
    drops = ranked[few] / np.maximum(ranked[1:], 0.1 * mean_s)[few]
    if not drops.size or drops.max() < PAUSE:
        return None
    pause_s = ranked[few][int(np.argmax(drops))]
    starts = np.concatenate([[0], np.flatnonzero(steps >= pause_s) + 1])
    lengths = np.diff([*starts, time_s.size])
    length = int(np.median(lengths[:-1])) if lengths.size > 1 else 0
    alike = lengths == length
    periods_s = np.diff(time_s[starts])
    period_s = float(np.median(periods_s)) if periods_s.size else 0.0
    regular = np.abs(periods_s - period_s) <= PERIOD_OFF * period_s
    if length < 2 or lengths.size < MIN_BURSTS or min(alike[:-1].mean(), regular.mean()) < WHOLE_SHARE:
        return None
    inside_s = (period_s - float(np.median(steps[starts[1:] - 1]))) / (length - 1)
    is_lost = period_s < (length + PAUSE) * inside_s  # one pulse after each
    is_packet = length * inside_s < MIN_DUTY * period_s and np.ptp(np.delete(steps, starts[1:] - 1)) > inside_s
    is_long = length * inside_s > min((1.0 - RARE_SHARE) * period_s, LONGEST_BURST_S)
    if is_lost or is_packet or is_long or inside_s <= SHORTEST_S:
        return None
    return length, np.repeat(alike, lengths)


@dataclass(frozen=True, eq=False)
class Frames:
    """Complex samples (pulse, bin) with their slow time, range axis (N,) and further facts."""

    samples: Samples
    slow_time: SlowTime
    range_m: FloatArray
    facts: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, baseband: xr.DataArray | Frames) -> Frames:
        """Remove the labels of a baseband; frames are returned unchanged."""
        if isinstance(baseband, Frames):
            return baseband
        from xarray.core.indexing import LazilyIndexedArray

        check_signal(baseband, BASEBAND)
        shape = (baseband.shape[0], baseband.shape[1])
        stored = shape[0] > lazy.LONG_PULSES and isinstance(baseband.variable._data, LazilyIndexedArray)
        samples = Samples.stored(shape, partial(read_pulses, baseband)) if stored else Samples(baseband.values)
        facts = {name: value for name, value in baseband.attrs.items() if name != "units"}
        burst = facts.get("burst_pulses")
        slow_time = SlowTime(read_axis(baseband, "slow_time"), None if burst is None else int(burst))
        return cls(samples, slow_time, read_axis(baseband, "range"), facts)

    def label(self, facts: Mapping[str, Any] | None = None) -> xr.DataArray:
        """Make the labelled array; values that are not in memory are read at every access."""
        values = self.get_values()
        if isinstance(values, np.ndarray):
            values.flags.writeable = False
        coords = {"slow_time": self.slow_time.time_s, "range": self.range_m}
        return make_array(BASEBAND, values, coords, self.facts if facts is None else facts)

    def get_values(self) -> Matrix | LateRows:
        """Return a view of the values, or an array that reads them at every access."""
        return self.matrix.view() if self.samples.in_memory else LateRows(self.shape, self.samples.rows, np.complex64)

    @property
    def shape(self) -> tuple[int, int]:
        """Pulses and range bins."""
        return self.samples.shape

    @property
    def n_pulses(self) -> int:
        """Number of pulses, I."""
        return self.samples.shape[0]

    @property
    def n_bins(self) -> int:
        """Number of range bins, N."""
        return self.samples.shape[1]

    @property
    def bin_share(self) -> float:
        """Independent noise values per range bin; below 1 if a window correlates bins."""
        return float(self.facts.get("independent_bin_share", 1.0))

    @cached_property
    def matrix(self) -> Matrix:
        """All values as one matrix (pulse, bin)."""
        return self.samples.matrix

    def read(self, first: int, stop: int) -> Matrix:
        """Return the values of some pulses."""
        return self.matrix[first:stop] if self.samples.in_memory else self.samples.rows(first, stop)

    def read_tiles(self, multiple: int = 1) -> Iterator[tuple[int, Matrix]]:
        """Yield first pulse and values of every tile; all but the last have a multiple of ``multiple`` pulses."""
        size = self.count_tile_pulses(multiple)
        for first in range(0, self.n_pulses, size):
            yield first, self.read(first, min(first + size, self.n_pulses))

    def count_tile_pulses(self, multiple: int = 1) -> int:
        """Return the pulses of a tile, a multiple of ``multiple`` or the whole recording."""
        return self.n_pulses if self.is_short else max(lazy.LONG_PULSES // multiple, 1) * multiple

    @property
    def is_short(self) -> bool:
        """True if all pulses are one tile."""
        return self.n_pulses <= lazy.LONG_PULSES

    def find_bursts(self) -> Self:
        """Count the pulses of a burst from the pauses, where they are not stated."""
        return replace(self, slow_time=self.slow_time.find_bursts())

    def with_samples(self, samples: Samples) -> Self:
        """Return the frames with other samples of the same shape."""
        return replace(self, samples=samples)

    def map_tiles(self, change: Callable[[Matrix, int], Matrix]) -> Self:
        """Apply a function of values and first pulse; more than one tile is changed on demand."""
        if self.is_short:
            return self.with_samples(Samples(change(self.matrix, 0)))
        return self.with_samples(Samples.stored(self.shape, lambda first, stop: change(self.read(first, stop), first)))

    def take_pulses(self, pulses: slice) -> Self:
        """Return some pulses."""
        first, stop, _ = pulses.indices(self.n_pulses)
        stop = max(first, stop)
        if "matrix" in self.__dict__:  # it exists: a view costs nothing
            samples = Samples(self.matrix[first:stop])
        elif self.samples.in_memory or stop - first <= lazy.LONG_PULSES:
            samples = self.samples.take_pulses(first, stop)
        else:
            part = partial(_read_part, self.samples, first, slice(None))
            samples = Samples.stored((stop - first, self.n_bins), part)
        return replace(self, samples=samples, slow_time=self.slow_time[pulses])

    def take_bins(self, bins: slice) -> Self:
        """Return some range bins."""
        range_m = self.range_m[bins]
        if self.samples.in_memory:
            return replace(self, samples=Samples(self.matrix[:, bins]), range_m=range_m)
        samples = Samples.stored((self.n_pulses, range_m.size), partial(_read_part, self.samples, 0, bins))
        return replace(self, samples=samples, range_m=range_m)


def _read_part(samples: Samples, first_pulse: int, bins: slice, first: int, stop: int) -> Matrix:
    """Return some pulses of a part of stored samples; partials of it can be sent to processes."""
    return samples.rows(first_pulse + first, first_pulse + stop)[:, bins]
