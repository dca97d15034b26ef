"""The time axis of measured pulses: stamps become even times, lost pulses are filled, pauses divide.

A piece is a run of pulses at one rate. Its times are a straight line through the stamps, so that coarse clocks, jitter
and late deliveries do not move the pulses; only holes and changes of the rate do.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import chain, pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import RecordingError
from doppelgait.core.frames import PAUSE, prove_bursts
from doppelgait.core.units import FloatArray, arctangent

IntArray = npt.NDArray[np.int64]

EVEN = 1e-3
"""Largest deviation of even stamps from a straight line, in steps."""
ON_RASTER, RASTER_SHARE = 0.25, 0.95
"""Largest deviation of a step from a multiple of the usual one, and the share of such steps of a precise clock."""
ROUGH = 0.5
"""Deviation of the stamps from even times, in steps, above which it is stated."""
USUAL_STEPS, USUAL_SHARE = 101, 30
"""Steps about a pulse whose median, or lower third (in %) with every second pulse lost, is the usual step."""
MAX_DISORDER = 64
"""Largest number of pulses by which one comes too late; more show a clock that was set back."""
MAX_HOLE_S, MAX_HOLE_PULSES = 0.1, 3
"""Longest hole that is filled: part of a scan, or a few pulses of a slow radar."""
RATE_CHANGE, MIN_RATE_S, MIN_PIECE_PULSES = 0.02, 1.0, 16
"""Smallest relative difference of the rates of two pieces, their shortest time, and the fewest pulses of a piece."""
SAME_RATE = 0.05
"""Largest relative deviation of the rate of a short piece that is one raster with the others."""
MIN_BLOCKS, REGULAR = 8, 0.02
"""Smallest number of holes, and the spread of the pulses between them, that may be those of stamped blocks."""
TICKS_S = (16e-3, 1 / 64, 15.6e-3, 10e-3, 1e-3)
"""Ticks of the clocks of operating systems."""
TICK_SLACK, SLACK = 1.1, 0.1
"""Largest spread of stamps about a line without lost pulses: ticks of the clock, and steps."""
BLOCK, MAX_BLOCKS, MAX_LOSS, MAX_TICK = 512, 32, 3.2, 1.1
"""Raster: pulses of a block, blocks that show it, its largest ratio to the mean rate, and longest tick in its steps."""
MEAN_NOISE, FAR_NOISE, LOWEST, MAX_PEAKS = 1.1, 2.8, 0.5, 8
"""Share in phase of random stamps under a Hann window and 5 standard deviations, times the root of
their number; share of the highest peak from which others are tried, and their number."""
MAX_OFF, EQUAL_OFF, MIN_SINGLE = 0.27, 0.02, 0.2
"""Largest mean deviation from a raster, in steps (that of random stamps is 0.29), one that is as
good as none, and the smallest share of steps without a lost pulse."""
LATE, SURE = 1.5, 0.35
"""Steps from those about it beyond which a stamp does not count; deviation up to which one lost at an end is sure."""
IRREGULAR = 0.6
"""Spread of the distances of double ticks, relative to their mean, from which they are lost pulses:
those of a coarse clock are regular."""
CLOCK_STEP_S = 1e-3
"""Usual step of a recorder's clock."""
SHARE_S = 3.0
"""Time over which the largest share of filled pulses is stated."""
UNIT_OFF = 0.2  # largest relative difference of the rates in another unit of time
SPIKES, DRIFT = 0.02, 0.02
"""Largest share of single stamps that are wrong, and smallest change of a drifting rate from third to third."""
GAIN = 25.0  # least gain in squared error, in variances of the stamps, that divides a piece
FASTEST_S, SLOWEST_S = 1e-6, 0.25
"""Times from pulse to pulse of radars that show motion; beyond them, times are in another unit, or are steps."""
EPOCH_S, LATEST_S = 1e8, 1e11
"""Times from the first on count from an epoch, not from the start of the recording; above the second they are no s."""


@dataclass(frozen=True)
class Placed:
    """Pulses on even times; ``row`` is the number of the row of a pulse, -1 for a filled one. Shapes: (I,)."""

    row: IntArray
    time_s: FloatArray
    rate_hz: float
    facts: dict[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def fill(self, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return the values (I, N) of the pulses; those of a hole are on the line between its neighbours."""
        if self.row.size == len(values) and (self.row == np.arange(self.row.size)).all():
            return values
        kept = np.flatnonzero(self.row >= 0)
        lost = np.flatnonzero(self.row < 0)
        after = np.searchsorted(kept, lost)
        before, following = kept[after - 1], kept[after]
        share = ((lost - before) / (following - before))[:, np.newaxis]
        filled = values[np.maximum(self.row, 0)]
        first, last = values[self.row[before]], values[self.row[following]]
        filled[lost] = ((1.0 - share) * first + share * last).astype(filled.dtype)
        return filled


def place_pulses(
    stamps_s: FloatArray, *, where: str, burst_pulses: int | None = None, stated_hz: float | None = None
) -> Placed:
    """Place measured pulses on even times by their stamps; ``burst_pulses`` declares bursts."""
    stamps = np.asarray(stamps_s, dtype=np.float64)
    steps = np.diff(stamps) if np.isfinite(stamps).all() else np.zeros(1)
    said = f"{where}: its times are not finite, all equal, falling or too large ({stamps[0]:g} to {stamps[-1]:g} s)"
    wrong = RecordingError(f"{said}; correct them, or leave them out and give prf_hz")
    if (steps > 0).sum() < min(2, steps.size) or (steps < 0).mean() > 0.5:
        raise wrong
    facts: dict[str, Any] = {}
    if abs(stamps[0]) > LATEST_S:
        unit = "ms" if abs(stamps[0]) < 1e3 * LATEST_S else "us" if abs(stamps[0]) < 1e6 * LATEST_S else "ns"
        raise RecordingError(f"{where}: its times begin at {stamps[0]:.6g}: they are in {unit} since 1970; give s")
    if abs(stamps[0]) > EPOCH_S:
        facts["epoch_s"] = float(stamps[0])
        stamps = stamps - stamps[0]
    row = np.arange(stamps.size)
    if burst_pulses is not None or (_is_even(stamps) and FASTEST_S < stamps[1] - stamps[0] <= SLOWEST_S):
        if not (rate_hz := measure_rate_hz(stamps, burst_pulses)) < 1.0 / FASTEST_S:
            raise wrong
        return Placed(row, stamps, rate_hz, facts)
    stamps, notes = _remove_spikes(stamps)
    if np.ptp(stamps) > LATEST_S:
        raise wrong
    row, stamps, order = _order(stamps)
    notes += order
    if not _has_rate(stamps, stated_hz) and (bursts := prove_bursts(stamps)) is not None:
        return _place_bursts(row, stamps, *bursts, facts, notes)
    pulse, cuts = _locate(stamps, stated_hz)
    cuts, steps_s, times = _fit_lines(pulse, stamps, cuts)
    step_s = steps_s[int(np.argmax(np.diff([0, *cuts, stamps.size])))]
    if stated_hz is not None:  # the rate of any piece may be stated
        nearest_s = min(steps_s, key=lambda piece_s: abs(piece_s * stated_hz - 1.0))
        step_s = nearest_s if abs(nearest_s * stated_hz - 1.0) < RATE_CHANGE else step_s
    units = (("ms", 1e3), ("us", 1e6), ("ns", 1e9), ("minutes", 1 / 60), ("days", 1 / 86_400))
    unit = next((name for name, per_s in units if abs(step_s * (stated_hz or 0.0) / per_s - 1.0) < UNIT_OFF), "")
    if unit or not FASTEST_S < step_s <= SLOWEST_S:
        raise RecordingError(
            f"{where}: its times say {1.0 / step_s:.3g} pulses a second, too slow or too fast to show motion: they "
            + (f"are in {unit}; give s" if unit else "must be in s (not in ms, us or days) since one start")
        )
    off_s = float(np.abs(times - stamps).max())
    if cuts.size:
        rates = ", ".join(f"{1.0 / one:.4g}" for one in steps_s)
        notes.append(f"the rate of the pulses changes: {rates} Hz; the parts are analysed on their own")
    elif (drift := _describe_drift(stamps, pulse)) and off_s > ROUGH * step_s:
        notes.append(drift)
    elif off_s > ROUGH * step_s:
        notes.append(f"its times are up to {1e3 * off_s:.3g} ms from even ones, which are taken: {1.0 / step_s:.6g} Hz")
    return _fill_holes(row, pulse, _keep_even(stamps, times, step_s), cuts, step_s, facts, notes)


def _place_bursts(
    row: IntArray,
    stamps: FloatArray,
    burst_pulses: int,
    whole: npt.NDArray[np.bool_],
    facts: dict[str, Any],
    notes: list[str],
) -> Placed:
    """Place bursts where their stamps say on average, and their pulses at one step."""
    from scipy.stats import trim_mean

    if not whole.all():
        notes.append(f"{int((~whole).sum())} pulses of incomplete bursts are left out")
    each = stamps[whole].reshape(-1, burst_pulses)
    ahead = np.arange(burst_pulses) - (burst_pulses - 1) / 2.0
    step_s = float(trim_mean(each @ ahead / (ahead @ ahead), 0.1))
    period_s = float(np.median(np.diff(each[:, 0])))
    notes.append(
        f"its times show {len(each)} bursts of {burst_pulses} pulses at {1.0 / step_s:.5g} Hz, one each "
        f"{period_s:.4g} s; if they are packets of even pulses, give prf_hz = {burst_pulses / period_s:.5g}"
    )
    times = _keep_even(stamps[whole], (each.mean(axis=1, keepdims=True) + step_s * ahead).ravel(), step_s)
    return Placed(row[whole], times, 1.0 / step_s, facts | {"burst_pulses": burst_pulses}, tuple(notes))


def _fit_lines(pulse: IntArray, stamps: FloatArray, cuts: IntArray) -> tuple[IntArray, list[float], FloatArray]:
    """Fit a line to every piece; neighbours of nearly one rate, and short ones, are one piece."""

    def fit(first: int, stop: int) -> float:
        return 1.0 / min(measure_clock_rate_hz(stamps[first:stop], pulse[first:stop]) or 1e300, 1e300)

    kept = [int(cut) for cut in cuts]
    while kept:
        pieces = list(_pair(np.array(kept), stamps.size))
        steps_s = [fit(*piece) for piece in pieces]
        changes = [abs(after / before - 1.0) for before, after in pairwise(steps_s)]
        shortest = [min(stamps[b - 1] - stamps[a] for a, b in pair) for pair in pairwise(pieces)]
        weakest = min(range(len(kept)), key=lambda n: changes[n] if shortest[n] >= MIN_RATE_S else 0.0)
        if shortest[weakest] >= MIN_RATE_S and changes[weakest] > RATE_CHANGE:
            break
        del kept[weakest]
    steps_s, times = [], np.empty(stamps.size)
    for first, stop in _pair(np.array(kept, dtype=np.int64), stamps.size):
        step_s = fit(first, stop)
        line = step_s * pulse[first:stop]
        times[first:stop] = line + np.median(stamps[first:stop] - line)
        if first:  # a late first delivery must not overlap the piece before
            times[first:stop] += max(times[first - 1] + step_s - times[first], 0.0)
        steps_s.append(step_s)
    return np.array(kept, dtype=np.int64), steps_s, times


def measure_clock_rate_hz(clock_s: npt.NDArray[Any], numbers: IntArray) -> float | None:
    """Measure the rate of numbered pulses by a coarse clock; None without a rising one."""
    n = min(clock_s.size, numbers.size)
    times, at = clock_s[:n].astype(float), numbers[:n].astype(float)
    lag = n // 2
    slope = float(np.median((times[lag:] - times[:-lag]) / (at[lag:] - at[:-lag]))) if n > 1 else 0.0
    if not slope > 0.0:
        return None
    distance = times - slope * at
    distance = np.abs(distance - np.median(distance))
    near = distance <= max(CLOCK_STEP_S, 3.0 * float(np.median(distance)))
    if np.count_nonzero(near) > 2:
        fitted = float(np.polyfit(at[near] - at[near].mean(), times[near], 1)[0])
        slope = fitted if fitted > 0.0 else slope
    return 1.0 / slope


def _keep_even(stamps: FloatArray, times: FloatArray, step_s: float) -> FloatArray:
    """Return the stamps where they are the fitted times up to rounding."""
    return stamps if np.abs(times - stamps).max() <= EVEN * step_s else times


def measure_rate_hz(stamps_s: FloatArray, burst_pulses: int | None = None) -> float:
    """Return the rate of the pulses, in bursts that within a burst."""
    if burst_pulses is None or burst_pulses < 2:
        return (stamps_s.size - 1) / float(np.ptp(stamps_s))
    inside = np.arange(1, stamps_s.size) % burst_pulses != 0
    return 1.0 / max(float(np.median(np.diff(stamps_s)[inside])), 1e-300)


def _is_even(stamps: FloatArray) -> bool:
    line, step_s = np.linspace(stamps[0], stamps[-1], stamps.size, retstep=True)
    return bool(step_s > 0 and np.abs(stamps - line).max() <= EVEN * step_s + 8 * np.spacing(np.abs(stamps[-1])))


def _pair(cuts: IntArray, size: int) -> Iterator[tuple[int, int]]:
    return pairwise([0, *(int(cut) for cut in cuts), size])


def _has_rate(stamps: FloatArray, stated_hz: float | None) -> bool:
    """Return True if pulses have the stated rate on average: bursts are packets then."""
    return stated_hz is not None and abs(measure_rate_hz(stamps) / stated_hz - 1.0) < RATE_CHANGE


def _remove_spikes(stamps: FloatArray) -> tuple[FloatArray, list[str]]:
    """Replace single stamps far from those about them by these."""
    from scipy.ndimage import median_filter

    usual = median_filter(stamps, 5, mode="nearest")
    spikes = np.abs(stamps - usual) > MAX_DISORDER * np.median(np.abs(np.diff(stamps)))
    said = f"{int(spikes.sum())} times are far from those about them and are not used"
    return (np.where(spikes, usual, stamps), [said]) if 0 < spikes.mean() < SPIKES else (stamps, [])


def _describe_drift(stamps: FloatArray, pulse: IntArray) -> str:
    """Describe a rate that rises or falls all the time, or return ""."""
    thirds = np.array_split(np.arange(stamps.size), 3)
    rates_hz = [measure_clock_rate_hz(stamps[part], pulse[part]) or 0.0 for part in thirds]
    if min(rates_hz) <= 0.0:
        return ""
    changes = [after / before - 1.0 for before, after in pairwise(rates_hz)]
    if min(np.abs(changes)) < DRIFT or changes[0] * changes[1] < 0.0:
        return ""
    shown = " to ".join(f"{rate_hz:.5g}" for rate_hz in rates_hz[::2])
    return f"the rate drifts from {shown} Hz: velocities are uncertain by {50 * abs(sum(changes)):.2g} %"


def _order(stamps: FloatArray) -> tuple[IntArray, FloatArray, list[str]]:
    """Sort pulses that came out of order; a clock that was set back continues."""
    row = np.arange(stamps.size)
    back = np.flatnonzero(np.diff(stamps) < 0)
    if not back.size:
        return row, stamps, []
    steps = np.diff(stamps)
    order = np.argsort(stamps, kind="stable")
    usual_s = float(np.median(np.diff(stamps[order])))
    small = [int((np.abs(some) < usual_s / 2).sum()) for some in (np.diff(stamps[order]), steps)]
    near = int(np.abs(order - row).max()) <= MAX_DISORDER
    if near and _is_precise(np.diff(stamps[order])) and small[0] <= small[1]:
        moved = f"{int((order != row).sum())} of {row.size} pulses came out of order"
        return order, stamps[order], [f"{moved}; they are sorted by their stamps"]
    jumps = back[steps[back] < -3.0 * float(np.quantile(np.abs(steps), 0.99))]
    steps[jumps] = float(np.median(steps))
    said = f"the clock was set back {jumps.size} times; time continues there" if jumps.size else ""
    return row, np.concatenate([[0.0], np.cumsum(steps)]) + stamps[0], [said] if said else []


def _is_precise(steps: FloatArray, usual: FloatArray | None = None) -> bool:
    """Return True if nearly all steps are multiples of the usual step."""
    usual = _find_usual(steps) if usual is None else usual
    if (np.abs(np.diff(usual)) > RATE_CHANGE * usual[:-1]).sum() > max(2, (1.0 - RASTER_SHARE) * steps.size):
        return False  # every second pulse is lost, or another
    ratio = steps / np.maximum(usual, 1e-300)
    return bool((np.abs(ratio - np.round(ratio)) < ON_RASTER).mean() >= RASTER_SHARE and (ratio > 0.5).mean() > 0.5)


def _find_usual(steps: FloatArray, share: int = 50) -> FloatArray:
    """Return the usual step about each: a quantile (%) of those about it."""
    from scipy.ndimage import percentile_filter

    return np.asarray(percentile_filter(steps, share, min(USUAL_STEPS, steps.size), mode="mirror"))


def _locate(stamps: FloatArray, stated_hz: float | None) -> tuple[IntArray, IntArray]:
    """Return the number of every pulse, holes counted, and where the rate changes."""
    none, size = np.empty(0, dtype=np.int64), stamps.size
    tick_s = _find_tick_s(stamps, stated_hz)
    if _has_none_lost(stamps, tick_s):
        return np.arange(size), none
    if (number := _count_on_raster(stamps, tick_s)) is not None:
        return number, none
    steps = np.diff(stamps)
    holes, is_even = np.flatnonzero(steps > PAUSE * tick_s), _has_rate(stamps, stated_hz)
    is_clock = holes.size < 2 or np.std(np.diff(holes)) < IRREGULAR * np.mean(np.diff(holes))
    least_s = max(MAX_TICK * tick_s if is_clock else 0.0, 0.5 / stated_hz if stated_hz and is_even else 0.0)
    tries = (_find_usual(steps, share) for share in (50, USUAL_SHARE))
    usual = next((one for one in tries if one.min() > least_s and _is_precise(steps, one)), None)
    if usual is None:
        return _locate_roughly(stamps)
    step_s = float(np.median(usual))
    if (steps < step_s / 2).any() and abs((stamps[-1] - stamps[0]) / step_s - steps.size) <= 1.0:
        return np.arange(size), none  # deliveries were late for some time, and none was lost
    number = _number(np.concatenate([[0], np.cumsum(np.round(steps / usual) - 1.0)]))
    cuts: list[int] = []
    for cut in (np.flatnonzero(np.abs(np.diff(usual)) > RATE_CHANGE * usual[:-1]) + 1).tolist():
        before_s, after_s = usual[max(cut - USUAL_STEPS, 0)], usual[min(cut + USUAL_STEPS, usual.size - 1)]
        changes = abs(after_s - before_s) > RATE_CHANGE * before_s
        if changes and cut - (cuts[-1] if cuts else 0) >= MIN_PIECE_PULSES and size - cut >= MIN_PIECE_PULSES:
            cuts.append(int(cut))
    return number, np.array(cuts, dtype=np.int64)


def _number(lead: FloatArray) -> IntArray:
    """Return the number of each pulse from its lead on the index, in steps; late ones lead for a short time."""
    from scipy.ndimage import median_filter
    from scipy.optimize import isotonic_regression

    usual = median_filter(lead, min(2 * MAX_DISORDER + 1, lead.size), mode="nearest")
    near = np.where(np.abs(lead - usual) > LATE, usual, lead)
    lost = np.round(isotonic_regression(near).x).astype(np.int64)
    if np.quantile(np.abs(lead - lost), 0.9) > SURE:  # a step at an end may be only the error of some stamps
        end = min(MIN_PIECE_PULSES, lost.size // 8)
        for few, inner in ((lost[:end], lost[end]), (lost[-end:], lost[-end - 1])):
            few[np.abs(few - inner) == 1] = inner
    return np.asarray(np.arange(lead.size) + lost - lost[0])


def _find_tick_s(stamps: FloatArray, stated_hz: float | None) -> float:
    """Return the tick of an operating system's clock, else 0; the stated step is no tick."""
    since_s = stamps - stamps[0]
    for tick_s in TICKS_S:
        off_s = np.abs(since_s - tick_s * np.round(since_s / tick_s)).max()
        if off_s <= max(0.02 * tick_s, min(0.1 * tick_s, 1.1e-3)):  # a tick may be rounded to ms
            return 0.0 if stated_hz is not None and abs(tick_s * stated_hz - 1.0) < RATE_CHANGE else tick_s
    return 0.0


def _has_none_lost(stamps: FloatArray, tick_s: float) -> bool:
    """Return True if the stamps are within a tick of a line."""
    index = np.arange(stamps.size)
    line = np.polynomial.Polynomial.fit(index, stamps, 1)
    return bool(np.ptp(stamps - line(index)) <= TICK_SLACK * tick_s + SLACK * line.deriv()(0.0))


def _count_on_raster(stamps: FloatArray, tick_s: float) -> IntArray | None:
    """Count the pulses on the raster that most stamps are near; None without one."""
    # the frequency at which the stamps of each block are most in phase; jitter and losses do not move the peak
    from scipy import fft
    from scipy.ndimage import maximum_filter1d

    lag = min(BLOCK // 8, stamps.size // 4)
    step_s = float(np.median(stamps[lag:] - stamps[:-lag])) / lag if lag > 1 else 0.0
    pauses = np.flatnonzero(np.diff(stamps) > BLOCK // 8 * step_s) + 1
    runs = [(first, stop) for first, stop in _pair(pauses, stamps.size) if stop - first >= BLOCK // 8]
    if not runs or not step_s > 0.0:
        return None
    edges = [np.linspace(first, stop, max((stop - first) // BLOCK, 1) + 1, dtype=int) for first, stop in runs]
    blocks = [[stamps[a:b] for a, b in pairwise(edge)] for edge in edges]
    every = list(chain.from_iterable(blocks))
    shown = every[:: -(-len(every) // MAX_BLOCKS)]
    mean_hz = float(np.median([(block.size - 1) / max(np.ptp(block), step_s) for block in every]))
    bin_s = 1.0 / (8.0 * MAX_LOSS * mean_hz)
    size = fft.next_fast_len(4 * int(max(map(np.ptp, shown)) / bin_s + 1))
    bins = [np.round((block - block.min()) / bin_s).astype(int) for block in shown]
    shares = [np.bincount(each, np.hanning(each.size)) / (0.5 * each.size) for each in bins]
    share = np.mean([np.abs(fft.rfft(each, size)) for each in shares], axis=0)
    raster_hz = np.arange(share.size) / (size * bin_s)
    highest_hz = min(MAX_LOSS * mean_hz, MAX_TICK / tick_s if tick_s else np.inf)
    share[(raster_hz < 0.985 * mean_hz) | (raster_hz > highest_hz)] = 0.0
    if tick_s:  # at its rate every stamp of a coarse clock is in phase
        share[np.abs(raster_hz - 1.0 / tick_s) < 12.0 * raster_hz[1]] = 0.0
    noise = (MEAN_NOISE + FAR_NOISE / np.sqrt(len(shown))) / np.sqrt(np.mean([block.size for block in shown]))
    # even pulses are in phase at multiples of their rate, too, and those of a coarse clock at its mirror images
    peaks = np.flatnonzero((share >= max(noise, LOWEST * share.max())) & (share == maximum_filter1d(share, 17)))
    tried = [_number_on(float(raster_hz[peak]), stamps, runs, blocks, tick_s) for peak in peaks[:MAX_PEAKS]]
    least = min((off for _, off in tried), default=np.inf)
    return next(number for number, off in tried if off <= 1.2 * least + EQUAL_OFF) if least <= MAX_OFF else None


def _number_on(
    raster_hz: float, stamps: FloatArray, runs: list[tuple[int, int]], blocks: list[list[FloatArray]], tick_s: float
) -> tuple[IntArray, float]:
    """Count the pulses on a raster in phase with every block; return the mean deviation, too."""
    centres = [np.array([block.mean() for block in each]) for each in blocks]
    phases = [np.array([np.exp(2j * np.pi * raster_hz * block).mean() for block in each]) for each in blocks]
    shares = np.abs(np.concatenate(phases))
    if np.quantile(shares, 0.05) < 0.5 * shares.mean():
        return np.arange(stamps.size), np.inf  # another rate in some of the blocks
    cycles = [np.unwrap(arctangent(each.imag, each.real)) / (2.0 * np.pi) for each in phases]
    drifts_hz = [
        np.diff(cycle) / np.maximum(np.diff(centre), 1.0 / raster_hz)
        for cycle, centre in zip(cycles, centres, strict=True)
    ]
    drift_hz = float(np.median(np.concatenate([*drifts_hz, [0.0]])))
    lead = (raster_hz - drift_hz) * stamps - np.arange(stamps.size)
    for (first, stop), centre, cycle in zip(runs, centres, cycles, strict=True):
        lead[first:stop] -= np.interp(stamps[first:stop], centre, cycle - drift_hz * centre)
    lead -= np.round(lead[0])
    number = _number(lead)
    off = lead - (number - np.arange(number.size))
    for block in chain.from_iterable(blocks):  # a block without a lost pulse at another rate
        first = int(np.searchsorted(stamps, block[0]))
        last = first + block.size - 1
        lost = number[last] - number[first] - (last - first)
        if lost > RATE_CHANGE * block.size and _has_none_lost(block, tick_s):
            return number, np.inf
    is_multiple = np.mean(np.diff(number) == 1) < MIN_SINGLE
    return number, np.inf if is_multiple else float(np.minimum(np.abs(off - np.median(off)), 1.0).mean())


def _locate_roughly(stamps: FloatArray) -> tuple[IntArray, IntArray]:
    """Divide imprecise stamps by lines: those of one slope are one raster with a hole between."""
    index = np.arange(stamps.size)
    pieces = list(_pair(np.array(sorted(_divide(stamps, 0, stamps.size)), dtype=np.int64), stamps.size))
    lines = [np.polyfit(index[a:b], stamps[a:b], 1) for a, b in pieces]
    step_s = float(lines[max(range(len(pieces)), key=lambda n: pieces[n][1] - pieces[n][0])][0])
    # a piece that is short and of another slope is a delivery that is late for some time
    steady = [
        n
        for n, (a, b) in enumerate(pieces)
        if abs(lines[n][0] / step_s - 1.0) < SAME_RATE or stamps[b - 1] - stamps[a] >= MIN_RATE_S
    ]
    number, changes = index.copy(), []
    for one, other in pairwise(steady):
        before, after, first, stop = lines[one], lines[other], pieces[one][1], pieces[other][0]
        if abs(after[0] / before[0] - 1.0) > RATE_CHANGE and other == one + 1:
            changes.append(stop)
            continue
        missing = round(float(np.polyval(after, stop - 0.5) - np.polyval(before, stop - 0.5)) / step_s)
        hole = first + int(np.argmax(np.diff(stamps[first - 1 : stop + 1]))) if stop > first else stop
        number[hole:] += max(missing, 0)
    return number, np.array(changes, dtype=np.int64)


def _divide(stamps: FloatArray, first: int, stop: int) -> list[int]:
    """Return where two lines describe the stamps clearly better than one, again for both parts."""
    size = stop - first
    if size < 2 * MIN_PIECE_PULSES:
        return []
    x, y = np.arange(size, dtype=np.float64), stamps[first:stop] - stamps[first]
    y = y - x * (y[-1] / max(size - 1, 1))
    sums = [np.concatenate([[0.0], np.cumsum(values)]) for values in (np.ones(size), x, y, x * x, x * y, y * y)]

    def miss(part: list[FloatArray]) -> FloatArray:
        n, sx, sy, sxx, sxy, syy = part
        xx, xy, yy = sxx - sx * sx / n, sxy - sx * sy / n, syy - sy * sy / n
        return np.asarray(np.maximum(yy - xy * xy / np.maximum(xx, 1e-12), 0.0))

    at = np.arange(MIN_PIECE_PULSES, size - MIN_PIECE_PULSES + 1)
    left, right = miss([values[at] for values in sums]), miss([values[-1] - values[at] for values in sums])
    whole = float(miss([values[-1:] for values in sums])[0])
    best = int(np.argmin(left + right))
    # the variance of the stamps about the lines; stamps in steps of a coarse clock are no independent errors
    rest = float(left[best] + right[best]) / size
    step = float(np.median(np.abs(np.diff(y - np.convolve(y, np.ones(9) / 9, mode="same")))))
    if whole - (left[best] + right[best]) < GAIN * max(rest, step**2) * 2 or whole < 1.5 * (left[best] + right[best]):
        return []
    near = slice(max(int(at[best]) - 3, 1), int(at[best]) + 4)
    cut = first + near.start + int(np.argmax(np.diff(stamps[first + near.start - 1 : first + near.stop])))
    return [*_divide(stamps, first, cut), cut, *_divide(stamps, cut, stop)]


def _suggest_rate(missing: IntArray, times: FloatArray) -> str:
    """Return the rate without holes where these are alike and regular, as where each block of a file has a stamp."""
    at = np.flatnonzero(missing)
    if at.size < MIN_BLOCKS or np.ptp(missing[at]) > 1 or np.ptp(np.diff(at)) > REGULAR * np.median(np.diff(at)):
        return ""
    first, last = at[0] + 1, at[-1] + 1
    rate_hz = (last - first) / (times[last] - times[first])
    return f"; alike and regular as they are, the true rate may be {rate_hz:.5g} Hz without them (prf_hz=...)"


def _fill_holes(
    row: IntArray,
    pulse: IntArray,
    times: FloatArray,
    cuts: IntArray,
    usual_s: float,
    facts: dict[str, Any],
    notes: list[str],
) -> Placed:
    """Insert the pulses of short holes."""
    missing = np.diff(pulse) - 1
    missing[cuts - 1] = 0
    steps_s = np.diff(times) / (missing + 1)
    short = (missing * steps_s <= MAX_HOLE_S) | (missing <= MAX_HOLE_PULSES)
    lost = np.where(short, missing, 0)
    at = np.arange(row.size) + np.concatenate([[0], np.cumsum(lost)])
    every_row = np.full(at[-1] + 1, -1)
    every_row[at] = row
    every_time = np.interp(np.arange(every_row.size), at, times)
    if lost.any():
        # the share in the worst time, so that a long recording does not hide a bad part
        filled = np.concatenate([[0], np.cumsum(every_row < 0)])
        first = np.searchsorted(every_time, every_time - SHARE_S)
        span = np.maximum(np.arange(1, filled.size) - first, min(filled.size - 1, SHARE_S / usual_s))
        facts["lost_frame_share"] = float(((filled[1:] - filled[first]) / span).max())
        notes.append(
            f"{int(lost.sum())} of {every_row.size} pulses are missing at {int((lost > 0).sum())} places and filled in "
            f"between their neighbours{_suggest_rate(missing, times)}"
        )
    pauses = missing[~short]
    if pauses.size:
        notes.append(
            f"{pauses.size} pause{'s' * (pauses.size > 1)} of up to {float((missing * steps_s)[~short].max()):.3g} s; "
            "the parts between are analysed on their own"
        )
    return Placed(every_row, every_time, 1.0 / usual_s, facts, tuple(notes))
