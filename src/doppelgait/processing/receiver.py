"""Receivers: lines of the mains (hum, lamps, supplies), and a missing second output."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from doppelgait.core.frames import PAUSE, Frames
from doppelgait.core.labels import Coord, Signal
from doppelgait.core.units import FloatArray
from doppelgait.processing.clutter import sum_pulses

ComplexArray = npt.NDArray[np.complex128]

RECEIVER = "receiver"
"""Fact of frames and attribute of signatures: flags of the receiver, separated by ``;``."""
NO_DIRECTION = "no_direction"
"""Flag of frames in which I and Q were one real series. The sign of Doppler is unknown."""
MAX_SECOND_SHARE = 0.05
"""Largest ratio of the echoes' powers along the axes of I and Q for one output; 3 dB and 20 degrees
of imbalance of two outputs leave 0.37, 13 dB or 65 degrees 0.05."""
MAINS_HZ = (50.0, 60.0)
TOLERANCE = 0.002  # largest relative deviation of the mains frequency; large grids stay within it
FIRST_LINES_HZ = 260.0
"""Multiples up to this frequency prove the mains; their tolerance is at most 0.5 Hz, so few bodies are candidates."""
MAX_MULTIPLE = 20
FIRST_MULTIPLES = 2
"""Multiples of which one is a line of every mains: of the voltage, and of the power of a lamp."""
SEGMENT_S, MIN_SEGMENT_S = 4.0, 1.0
MIN_SEGMENTS, MAX_SEGMENTS = 4, 60
"""Fewest segments for a median over them, and the most that are used of a long recording."""
CELLS = 2.5
"""Half width of a line in the spectrum of a segment with Hann window, in cells of 1 / segment."""
AROUND_HZ = 7.0
"""Reach of the surroundings of a line; a gait has lines 1 to 5 Hz beside that of a body."""
AROUND_QUANTILE = 0.93
"""Quantile that is the level of the surroundings: one other line there is below it, the two of a gait are not."""
CONTRAST = 30.0
"""Smallest ratio of a line to its surroundings: noise does not reach it, and the lines of a gait have each other."""
MIRRORED = 0.1
"""Smallest power ratio of both sides of a line that no body makes: images of real receivers are 11 dB down or more."""
STEADY = 1.25
"""Largest change of a line's amplitude; a body at constant speed comes nearer, and its amplitude rises with 1/R^2."""
MAX_ROUNDS = 4
NEAR_ZERO_HZ = 1.0  # lines that alias to less are left to the removal of static clutter
KNOTS_PER_S = 8.0
SMOOTHED_KNOTS = 17
"""Length of the cubic smoothing of an amplitude, 2 s: the notch is 1 Hz wide on each side."""


class MainsLine(NamedTuple):
    """Line at a multiple of the mains frequency, where it folds to, and if both sides show it."""

    nominal_hz: float
    frequency_hz: float
    has_image: bool


@dataclass(frozen=True)
class Waves:
    """Waves of lines and their mirror images, with amplitudes that change slowly."""

    wave_hz: FloatArray  # (L,)
    rate_hz: float
    amplitude: Callable[[npt.NDArray[Any]], ComplexArray]  # of all bins together, (pulses, L)
    share: ComplexArray  # of each bin, (L, N)

    def subtract(self, values: npt.NDArray[Any], first: int) -> npt.NDArray[Any]:
        """Subtract the waves from some pulses."""
        pulses = first + np.arange(values.shape[0])
        turn = np.exp(2j * np.pi * np.outer(pulses, self.wave_hz / self.rate_hz))
        return np.asarray(values - (turn * self.amplitude(pulses)) @ self.share, dtype=values.dtype)


def remove_mains_lines(frames: Frames) -> Frames:
    """Remove the lines of the mains, and note them in the facts of the frames."""
    # a burst is too short to separate lines from bodies, a slow radar has no surroundings
    steps_s, rate_hz = np.diff(frames.slow_time.time_s), frames.slow_time.rate_hz
    slow = frames.slow_time.duration_s < MIN_SEGMENT_S or rate_hz < 4.0 * AROUND_HZ
    if slow or steps_s.max() > PAUSE * steps_s.mean():
        return frames
    # hum has one phase in every bin: the sum over the bins shows it best
    series = np.concatenate([values.sum(axis=1, dtype=np.complex128) for _, values in frames.read_tiles()])[:, None]
    series -= series.mean()
    removed: list[MainsLine] = []
    doubtful: list[MainsLine] = []
    mains_hz: dict[float, float] = {}
    for _ in range(MAX_ROUNDS):  # strong lines hide weak ones
        lines = find_mains_lines(series[:, 0], rate_hz, mains_hz)
        certain = _select_certain(series, lines, rate_hz, frames.n_bins > 1)
        if frames.n_bins > 1:  # a body may be steady for some seconds; the mains has a first line
            certain = [line for line in certain if line.has_image or line.nominal_hz <= FIRST_MULTIPLES * max(MAINS_HZ)]
        # further multiples of a mains frequency that is proven: with aliasing they beat with others
        proven = [hz for hz in MAINS_HZ for line in (*removed, *certain) if line.nominal_hz % hz == 0.0]
        certain = [line for line in lines if line in certain or any(line.nominal_hz % hz == 0.0 for hz in proven)]
        doubtful = [line for line in lines if line not in certain]
        if not certain:
            break
        removed += certain
        waves = fit_waves([series], certain, rate_hz)
        series = waves.subtract(series, 0)
        if frames.n_bins > 1:
            mean, tiles = sum_pulses(frames) / frames.n_pulses, frames.read_tiles(_count_block(rate_hz))
            waves = fit_waves((values - mean for _, values in tiles), certain, rate_hz)
        frames = frames.map_tiles(waves.subtract)
    if frames.n_bins == 1:  # hum and lamps are real and on both sides of two outputs
        doubtful += [line for line in removed if not line.has_image]
    flags = [
        f"{name}:{'_'.join(f'{hz:g}' for hz in sorted({line.nominal_hz for line in lines}))}_hz"
        for name, lines in (("mains_lines_removed", removed), ("mains_line_or_body", doubtful))
        if lines
    ]
    return add_flags(frames, *flags) if flags else frames


def _select_certain(series: ComplexArray, lines: list[MainsLine], rate_hz: float, ranged: bool) -> list[MainsLine]:
    """Select the lines that no body makes: alike on both sides of two outputs, else steady."""
    rest = np.diff(fit_waves([series], lines, rate_hz).subtract(series, 0)[:, 0]) if lines else series[:, 0]
    # along the axes of I and Q the variances are p + q and p - q: with one output, everything is on both sides
    p, q = float(np.mean(np.abs(rest) ** 2)), float(np.abs(np.mean(rest**2)))
    two_outputs = p - q > MAX_SECOND_SHARE * (p + q)
    certain = []
    for line in lines:
        level = np.abs(_demodulate([series], _mirror(line.frequency_hz, rate_hz), rate_hz)[:, :, 0])
        power = (level**2).mean(axis=0)
        # the image of a body is as unsteady as the body, which may hide the line on the other side
        shown = level[:, power.argmin()] if line.has_image else np.hypot(level[:, 0], level[:, -1])
        ends = [float(np.mean(part)) for part in np.array_split(shown, 3)[::2]]
        alike = power.min() > MIRRORED * power.max()
        # without range, a line on one side of two outputs may be a far body, which is steady for some seconds
        is_long = ranged or not two_outputs or series.size >= SEGMENT_S * rate_hz
        if (is_long and max(ends) < STEADY * min(ends)) or (alike and two_outputs):
            certain.append(line)
    return certain


def _mirror(frequency_hz: float, rate_hz: float) -> FloatArray:
    """Return a frequency and its mirror image, once if both are in one notch."""
    apart_hz = rate_hz - 2.0 * abs(frequency_hz)
    return np.array([frequency_hz] if apart_hz < NEAR_ZERO_HZ else [frequency_hz, -frequency_hz])


def find_mains_lines(series: ComplexArray, rate_hz: float, measured_hz: dict[float, float]) -> list[MainsLine]:
    """Find narrow lines at multiples of the mains frequency, of either sign."""
    # the measured frequency of a mains is added to measured_hz, for its higher multiples in this and later rounds
    spectra, cell_hz, width_hz = _average_spectra(series, rate_hz)
    lines: list[MainsLine] = []
    for mains_hz in MAINS_HZ:
        best = 0.0
        for multiple in range(1, MAX_MULTIPLE + 1):
            nominal_hz, reach_hz = mains_hz * multiple, TOLERANCE * mains_hz * multiple + cell_hz
            centre_hz = nominal_hz
            if nominal_hz > FIRST_LINES_HZ:
                if mains_hz not in measured_hz:
                    break
                centre_hz, reach_hz = measured_hz[mains_hz] * multiple, width_hz / 2.0
            both, weaker = (_measure_contrast(values, cell_hz, width_hz, centre_hz, reach_hz) for values in spectra)
            contrast, frequency_hz = max(both, weaker)
            alias_hz = (frequency_hz + rate_hz / 2.0) % rate_hz - rate_hz / 2.0
            if contrast < CONTRAST or abs(alias_hz) < NEAR_ZERO_HZ:
                continue
            if contrast > best and nominal_hz <= FIRST_LINES_HZ:
                best, measured_hz[mains_hz] = contrast, frequency_hz / multiple
            if all(abs(abs(alias_hz) - abs(line.frequency_hz)) >= width_hz for line in lines):
                lines.append(MainsLine(nominal_hz, alias_hz, weaker[0] >= CONTRAST))
    return lines


def _average_spectra(series: ComplexArray, rate_hz: float) -> tuple[FloatArray, float, float]:
    """Average spectra of both sides and the weaker one; return cell spacing and half width."""
    from scipy import fft

    size = min(round(SEGMENT_S * rate_hz), series.size)
    length = fft.next_fast_len(2 * size)
    window = np.hanning(size + 2)[1:-1]
    starts = np.arange(0, series.size - size + 1, max(size // 2, 1))
    starts = starts[:: -(-starts.size // MAX_SEGMENTS)]
    power = np.empty((starts.size, 2, length))
    for start, (both, weaker) in zip(starts, power, strict=True):
        part = series[start : start + size]
        spectrum = fft.fft((part - part.mean()) * window, length)
        side = spectrum.real**2 + spectrum.imag**2
        mirrored = np.roll(side[::-1], 1)
        both[:], weaker[:] = side + mirrored, np.minimum(side, mirrored)
    # a line lasts, a body comes and goes
    average = np.median if starts.size >= MIN_SEGMENTS else np.mean
    return average(power, axis=0), rate_hz / length, CELLS * rate_hz / size


def _measure_contrast(
    power: FloatArray, cell_hz: float, width_hz: float, centre_hz: float, reach_hz: float
) -> tuple[float, float]:
    """Measure a line's power over that of its surroundings, and its frequency, before aliasing."""
    cells = np.arange(round((centre_hz - reach_hz) / cell_hz), round((centre_hz + reach_hz) / cell_hz) + 1)
    peak = int(cells[power[cells % power.size].argmax()])
    low, top, high = np.sqrt(power[np.arange(peak - 1, peak + 2) % power.size])
    inner, outer = int(width_hz / cell_hz) + 1, int(AROUND_HZ / cell_hz)
    around = np.concatenate([np.arange(-outer, -inner), np.arange(inner + 1, outer + 1)])
    level = float(np.quantile(power[(peak + around) % power.size], AROUND_QUANTILE))
    bend = low - 2.0 * top + high
    if level <= 0.0 or bend >= 0.0 or top < max(low, high):  # the flank of a line beyond the reach
        return 0.0, peak * cell_hz
    return top**2 / level, (peak + 0.5 * (low - high) / bend) * cell_hz


def _count_block(rate_hz: float) -> int:
    """Return the number of pulses between two knots of an amplitude."""
    return max(round(rate_hz / KNOTS_PER_S), 1)


def _demodulate(tiles: Iterable[npt.NDArray[Any]], wave_hz: FloatArray, rate_hz: float) -> ComplexArray:
    """Measure the amplitudes of waves at the ends of blocks, (blocks - 1, waves, bins)."""
    block = _count_block(rate_hz)
    pulses = np.arange(block)
    rise = (0.5 - 0.5 * np.cos(np.pi * (pulses + 0.5) / block)) / block
    back = np.exp(-2j * np.pi * np.outer(wave_hz / rate_hz, pulses))
    rising, falling, first = [], [], 0
    for values in tiles:
        n_blocks = values.shape[0] // block
        blocks = values[: n_blocks * block].reshape(n_blocks, block, -1)
        starts = first + block * np.arange(n_blocks)
        turn = np.exp(-2j * np.pi * np.outer(starts, wave_hz / rate_hz))[:, :, None]
        rising.append(np.matmul(back * rise, blocks) * turn)
        falling.append(np.matmul(back * rise[::-1], blocks) * turn)
        first += values.shape[0]
    return np.asarray(np.concatenate(rising)[:-1] + np.concatenate(falling)[1:])


def fit_waves(tiles: Iterable[npt.NDArray[Any]], lines: Sequence[MainsLine], rate_hz: float) -> Waves:
    """Fit the amplitudes of lines, and of 0 Hz, to the tiles of a recording."""
    from scipy.interpolate import CubicSpline
    from scipy.signal import savgol_filter

    wave_hz = np.unique(np.concatenate([_mirror(line.frequency_hz, rate_hz) for line in lines]))
    knots = _demodulate(tiles, wave_hz, rate_hz)
    length = min(SMOOTHED_KNOTS, len(knots) - 1 + len(knots) % 2)
    total = savgol_filter(knots.sum(axis=2).view(np.float64), length, 3, axis=0).view(np.complex128)
    # a bin has a constant share of the line in all bins: a body that crosses a bin within a moment leaves no trace
    share = np.einsum("kl,kln->ln", total.conj(), knots) / np.maximum((np.abs(total) ** 2).sum(axis=0), 1e-300)[:, None]
    share = share if knots.shape[2] > 1 else np.ones_like(share)
    return Waves(wave_hz, rate_hz, CubicSpline(_count_block(rate_hz) * np.arange(1, len(total) + 1), total), share)


def add_flags(frames: Frames, *flags: str) -> Frames:
    """Add flags of the receiver to the facts."""
    return replace(frames, facts={**frames.facts, RECEIVER: ";".join([*read_flags(frames.facts), *flags])})


def read_flags(facts: Mapping[Any, Any]) -> list[str]:
    """Read the receiver's flags from facts of frames or of a signature."""
    return list(filter(None, facts.get(RECEIVER, "").split(";")))


def describe_receiver(frames: Frames, signature: Signal) -> Signal:
    """Add the receiver's flags to a signature; with one output, it has positive Doppler only."""
    flags = read_flags(frames.facts)
    if flags:
        signature.attrs[RECEIVER] = ";".join(flags)
    if NO_DIRECTION not in flags:
        return signature
    first = signature.sizes["doppler"] // 2  # 0 Hz
    coords: dict[str, Coord] = {
        name: (dims, values[first:] if dims == ("doppler",) else values, attrs)
        for name, (dims, values, attrs) in signature.coords.items()
    }
    return replace(signature, values=np.ascontiguousarray(2.0 * signature.values[:, first:]), coords=coords)
