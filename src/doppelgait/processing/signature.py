"""Range-Doppler maps and gated signature (E-22 to E-27)."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from doppelgait._core import native
from doppelgait.core import lazy
from doppelgait.core.errors import AnalysisError
from doppelgait.core.frames import Frames, SlowTime
from doppelgait.core.labels import RANGE_DOPPLER, SIGNATURE, AnySignal, Coord, Signal, make_array, maps_signal
from doppelgait.core.lazy import xr
from doppelgait.core.samples import Samples
from doppelgait.core.units import FloatArray, doppler_axis_hz, doppler_to_velocity_mps
from doppelgait.processing.bursts import make_frame_gate, split_bursts
from doppelgait.processing.config import Analysis, Transform, find_lossless_hop, plan_transform
from doppelgait.processing.gate import Gate
from doppelgait.processing.receiver import describe_receiver

Plane = npt.NDArray[np.float32]


def plan_for(slow_time: SlowTime, analysis: Analysis) -> Transform:
    """Plan a recording's transform."""
    return plan_transform(analysis, n_pulses=slow_time.size, prf_hz=slow_time.rate_hz)


class Columns(NamedTuple):
    """Transform of a recording; times, Doppler axis and distance of its columns in pulses."""

    transform: Transform
    time_s: FloatArray
    doppler_hz: FloatArray
    prf_hz: float
    hop: int


def plan_columns(slow_time: SlowTime, analysis: Analysis) -> Columns:
    """Plan the columns of a recording; in bursts, every burst is one."""
    if slow_time.burst_pulses is not None:
        transform, prf_hz, times_s, hop = split_bursts(slow_time, analysis)
    else:
        transform, prf_hz = plan_for(slow_time, analysis), slow_time.rate_hz
        times_s, hop = slow_time.start_s + transform.compute_centre_pulses() / prf_hz, transform.hop
    return Columns(transform, times_s, doppler_axis_hz(transform.n_doppler_bins, prf_hz), prf_hz, hop)


def range_doppler(
    baseband: xr.DataArray,
    analysis: Analysis,
    *,
    wavelength_m: float,
    columns: npt.ArrayLike | None = None,
    block: int = 64,
) -> Iterator[xr.DataArray]:
    """Compute range-Doppler maps in blocks of time (E-24).

    Only one block is in memory at a time.

    Parameters
    ----------
    baseband : DataArray (slow_time, range)
    analysis : Analysis
    wavelength_m : float
        For the velocity axis.
    columns : array_like of int, optional
        Numbers of the columns (processing intervals); all by default.
    block : int
        Number of columns in one block.

    Yields
    ------
    DataArray (time, doppler, range)
        ``|sum_m w_m Y_{i+m-h,n} e^{-j 2 pi k m / K}|^2``, float32, V^2; divide by sum(w^2) for power per cell.

    Examples
    --------
    >>> import doppelgait as dg
    >>> recording = dg.data.sample()
    >>> maps = dg.processing.range_doppler(
    ...     recording.baseband, dg.Analysis(), wavelength_m=recording.radar.wavelength_m
    ... )
    >>> power = abs(next(maps)).isel(time=0) ** 2
    >>> round(float(power.max("doppler").idxmax("range")), 1)  # range of the strongest cell, m
    1.9
    """
    frames = Frames.of(baseband)
    transform, times_s, doppler_hz, *_ = plan_columns(frames.slow_time, analysis)
    wanted = np.arange(transform.n_columns) if columns is None else np.asarray(columns)
    if wanted.size and not 0 <= wanted.min() <= wanted.max() < transform.n_columns:
        raise AnalysisError(
            f"columns must be from 0 to {transform.n_columns - 1}; these reach from {wanted.min()} to {wanted.max()}"
        )
    for start in range(0, wanted.size, block):
        chosen = wanted[start : start + block]
        coords = {
            "time": times_s[chosen],
            "doppler": doppler_hz,
            "velocity": ("doppler", doppler_to_velocity_mps(doppler_hz, wavelength_m)),
            "range": frames.range_m,
        }
        power_v2 = compute_cell_power(frames, transform, transform.window, chosen)
        yield make_array(RANGE_DOPPLER, power_v2, coords, {"window_energy": float((transform.window**2).sum())})


TOGETHER = 64  # number of columns that are transformed together, to keep the complex spectra small


def compute_cell_power(
    frames: Frames, transform: Transform, window: FloatArray, columns: npt.NDArray[np.int64]
) -> npt.NDArray[np.float32]:
    """Compute the power of range-Doppler cells, (J, K, N), 0 outside the recording (E-24)."""
    from scipy import fft

    n_doppler, weight = transform.n_doppler_bins, window.astype(np.float32)[:, None]
    power = np.empty((columns.size, n_doppler, frames.n_bins), dtype=np.float32)
    for start in range(0, columns.size, TOGETHER):
        pulses = transform.first_pulse + transform.hop * columns[start : start + TOGETHER]
        intervals = np.zeros((pulses.size, n_doppler, frames.n_bins), dtype=np.complex64)
        for interval, pulse in zip(intervals, pulses.tolist(), strict=True):
            low, high = max(pulse, 0), min(pulse + window.size, frames.n_pulses)
            inside = slice(low - pulse, high - pulse)
            np.multiply(frames.read(low, high), weight[inside], out=interval[inside])
        spectrum = fft.fft(intervals, axis=1, overwrite_x=True)
        middle, out = n_doppler // 2, power[start : start + pulses.size]
        for cells, values in (
            (out[:, middle:], spectrum[:, : n_doppler - middle]),
            (out[:, :middle], spectrum[:, n_doppler - middle :]),
        ):
            np.multiply(values.real, values.real, out=cells)
            cells += values.imag**2
    return power


def signature(baseband: xr.DataArray, gate: Gate, analysis: Analysis, *, wavelength_m: float) -> xr.DataArray:
    """Compute the micro-Doppler signature mu (E-27).

    The signature is the range-Doppler power summed over the gate.

    Parameters
    ----------
    baseband : DataArray (slow_time, range)
        With the attribute ``burst_pulses``, every burst is a column, as in :func:`burst_signature`.
    gate : Gate
    analysis : Analysis
    wavelength_m : float
        For the velocity axis.

    Returns
    -------
    DataArray (time, doppler)
        float32, V^2. The coordinate ``gate_share`` is the part of the gate that lies inside the
        frame. The attributes are the window energy sum(w^2), the number of gate bins N_g (not an
        integer for fractional edges), hop, M and the gate's source, so that levels and the noise
        floor can be computed from the signature alone.

    Raises
    ------
    AnalysisError
        If the gate lies outside the frame all the time.

    Examples
    --------
    >>> import doppelgait as dg
    >>> recording = dg.data.sample()
    >>> gate = dg.Gate.fixed(0.5, 5.0, time_s=[0.0, 3.0])
    >>> signature = dg.processing.signature(
    ...     recording.baseband, gate, dg.Analysis(), wavelength_m=recording.radar.wavelength_m
    ... )
    >>> round(float(signature.sum("time").idxmax("doppler")))  # strongest Doppler, Hz
    55
    """
    return compute_signature(Frames.of(baseband), gate, analysis, wavelength_m=wavelength_m).label()


def burst_signature(
    baseband: xr.DataArray,
    gate: Gate | None,
    analysis: Analysis,
    *,
    wavelength_m: float,
    burst_pulses: int | None = None,
    remove_mean: bool = True,
) -> xr.DataArray:
    """Compute the micro-Doppler signature with one column per burst.

    The signature follows E-23 to E-27 with M equal to the pulses of a burst:

    ``mu[j, k] = sum_n g[j, n] |sum_m w[m] (Y[jM + m, n] - mean_m) e^{-j 2 pi k m / K}|^2``,

    where g is the share of range bin n inside the gate. Cadences above half the burst rate alias.

    Parameters
    ----------
    baseband : DataArray (slow_time, range)
        V.
    gate : Gate, optional
        None selects every range bin. Data without range (one bin) are inside any gate.
    analysis : Analysis
        ``window_steepness``, ``doppler_bins`` (K >= M), ``gate_edges`` and ``method`` (K = M by default for
        ``liland2018``) are used. ``cpi_s`` and ``hop`` are not used: the burst is the processing interval.
    wavelength_m : float
        For the velocity axis.
    burst_pulses : int, optional
        Pulses per burst, 5 or more; by default the attribute of the recording, or derived from its times.
    remove_mean : bool
        Subtract the mean of every burst and range bin first. This removes static echoes and the receiver's offset.

    Returns
    -------
    DataArray (time, doppler)
        float32, V^2, with the coordinates and attributes of :func:`doppelgait.processing.signature`. ``prf_hz`` is
        the rate within a burst, ``cpi_pulses`` is M, and ``hop`` is the burst period in pulses at that rate.

    Raises
    ------
    AnalysisError
        If there are no bursts, they have fewer than 5 pulses, K < M, or the gate lies outside the frame.

    Examples
    --------
    >>> import doppelgait as dg
    >>> scene = dg.Scene([dg.Target({"kind": "boulic", "speed_mps": 1.2})], duration_s=2.0)
    >>> recording = dg.simulate(scene, dg.Radar.preset("ti-60-burst"))
    >>> gate = dg.Gate.fixed(0.5, 5.0, time_s=[0.0, 2.0])
    >>> signature = dg.processing.burst_signature(
    ...     recording.baseband, gate, dg.Analysis(), wavelength_m=recording.radar.wavelength_m
    ... )
    >>> signature.sizes["time"]  # one column per burst
    37
    """
    frames = Frames.of(baseband)
    pulses = burst_pulses or frames.slow_time.find_bursts().burst_pulses
    if pulses is None:
        raise AnalysisError("the recording has no bursts: its pulses are evenly spaced; use the plain signature")
    frames = replace(frames, slow_time=replace(frames.slow_time, burst_pulses=pulses))
    if gate is None:
        gate = make_frame_gate(frames)
    return compute_signature(frames, gate, analysis, wavelength_m=wavelength_m, remove_mean=remove_mean).label()


def compute_signature(
    frames: Frames, gate: Gate, analysis: Analysis, *, wavelength_m: float, remove_mean: bool = True
) -> Signal:
    """Compute the signature of frames; in bursts, every burst is a column."""
    cut = make_gated_transform(gate, frames.slow_time, frames.range_m, analysis, bin_share=frames.bin_share)
    in_bursts = frames.slow_time.burst_pulses is not None
    power = cut.sum_bursts(frames, remove_mean=remove_mean) if in_bursts else cut.sum_power(frames.samples)
    return describe_receiver(frames, cut.make_signature(power, wavelength_m=wavelength_m))


TILE_PULSES = 1 << 10  # number of pulses in a tile of a long recording
LANES = 16
"""Number of columns that the kernel transforms together; tiles of whole groups give the same bytes as one pass."""


@dataclass(frozen=True)
class GatedTransform:
    """Gate and transform of one recording; ``hop`` is the distance of columns in pulses."""

    gate: Gate
    transform: Transform
    prf_hz: float
    n_pulses: int
    range_m: npt.NDArray[np.float64]
    time_s: npt.NDArray[np.float64]
    low: npt.NDArray[np.float64]
    high: npt.NDArray[np.float64]
    hop: int
    bin_share: float = 1.0

    def find_needed_pulses(self) -> npt.NDArray[np.int64]:
        """Return the needed pulses per range bin, first and last + 1; (I, 0) for none."""
        columns, bins = np.arange(0, self.time_s.size, NEED_BLOCK), np.arange(self.range_m.size)[:, None]
        first = np.floor(np.minimum.reduceat(self.low, columns) - 0.5).astype(int) + 1
        stop = np.ceil(np.maximum.reduceat(self.high, columns) + 0.5).astype(int)
        last = np.minimum(columns + NEED_BLOCK, self.time_s.size) - 1
        begin = np.maximum(self.transform.first_pulse + self.transform.hop * columns, 0)
        end = self.transform.first_pulse + self.transform.hop * last + self.transform.window.size
        touched = (first <= bins) & (bins < stop)
        latest = columns.size - 1 - touched[:, ::-1].argmax(axis=1)
        spans = np.stack([begin[touched.argmax(axis=1)], np.minimum(end[latest], self.n_pulses)], axis=1)
        spans[~touched.any(axis=1)] = (self.n_pulses, 0)
        return spans

    def sum_power(self, samples: Samples) -> npt.NDArray[np.float32]:
        """Sum the power over the gate's bins, (J, K) (E-27)."""
        transform, hop = self.transform, self.transform.hop
        self.gate.touched_bins(self.low, self.high, self.range_m)
        window = np.zeros(transform.n_doppler_bins, dtype=np.float32)
        window[: transform.window.size] = transform.window
        power = np.empty((transform.n_columns, transform.n_doppler_bins), dtype=np.float32)
        # the pulses after the needed ones have no weight, but must be finite
        margin = transform.n_doppler_bins - transform.window.size + 2 * hop
        is_short = self.n_pulses <= lazy.LONG_PULSES
        step = transform.n_columns if is_short else max(TILE_PULSES // hop // LANES, 1) * LANES
        for start in range(0, transform.n_columns, step):
            columns = slice(start, min(start + step, transform.n_columns))
            first = transform.first_pulse + hop * columns.start
            low, high = self.low[columns], self.high[columns]
            if is_short:
                planes, first_bin = samples.read(self.find_needed_pulses(), margin)
                n_pulses = self.n_pulses
            else:
                lowest, highest = int(np.floor(low.min() - 0.5)) + 1, int(np.ceil(high.max() + 0.5))
                bins = slice(max(lowest, 0), min(highest, self.range_m.size))
                if bins.start >= bins.stop:
                    power[columns] = 0.0
                    continue
                after = transform.first_pulse + hop * (columns.stop + 1) + window.size
                pulses = slice(max(first, 0), min(after, self.n_pulses))
                planes, first_bin = samples.read_tile(pulses, bins), bins.start
                first, n_pulses = first - pulses.start, planes.shape[2]
            edges = low - first_bin, high - first_bin
            sum_columns(planes[0], planes[1], n_pulses, first, hop, window, *edges, power[columns])
        return power

    def sum_bursts(self, frames: Frames, *, remove_mean: bool) -> npt.NDArray[np.float32]:
        """Sum the power over the gate's bins, a column a burst, (J, K)."""
        from scipy import fft

        self.gate.touched_bins(self.low, self.high, self.range_m)
        transform, size = self.transform, self.transform.window.size
        cube = frames.matrix[: transform.n_columns * size].reshape(transform.n_columns, size, -1)
        power = np.zeros((transform.n_columns, transform.n_doppler_bins), dtype=np.float32)
        for n in range(cube.shape[2]):
            share = np.clip(np.minimum(self.high, n + 0.5) - np.maximum(self.low, n - 0.5), 0.0, 1.0)
            if not share.any():
                continue
            pulses = cube[:, :, n].astype(np.complex128)
            if remove_mean:
                pulses -= pulses.mean(axis=1, keepdims=True)
            spectrum = fft.fftshift(fft.fft(pulses * transform.window, transform.n_doppler_bins, axis=1), axes=1)
            power += (share[:, None] * (spectrum.real**2 + spectrum.imag**2)).astype(np.float32)
        return power

    def make_signature(self, power: npt.NDArray[np.float32], *, wavelength_m: float) -> Signal:
        """Add axes and facts to the power of the gate."""
        doppler_hz = doppler_axis_hz(self.transform.n_doppler_bins, self.prf_hz)
        self.gate.close_doppler_band(power, doppler_hz)
        inside = np.minimum(self.high, self.range_m.size - 0.5) - np.maximum(self.low, -0.5)
        coords: dict[str, Coord] = {
            "time": (("time",), self.time_s, {}),
            "doppler": (("doppler",), doppler_hz, {}),
            "velocity": (("doppler",), np.asarray(doppler_to_velocity_mps(doppler_hz, wavelength_m)), {}),
            "centre_range": (("time",), self.gate.centre_at(self.time_s), {"units": "m"}),
            "gate_share": (("time",), np.clip(inside / (self.high - self.low), 0.0, 1.0), {"units": "1"}),
        }
        attrs = {
            "units": SIGNATURE.units,
            "prf_hz": self.prf_hz,
            "wavelength_m": wavelength_m,
            "cpi_pulses": self.transform.window.size,
            "hop": self.hop,
            "window_energy": float((self.transform.window**2).sum()),
            "n_gate_bins": float(self.high[0] - self.low[0]) * self.bin_share,
            "gate": json.dumps(self.gate.facts),
        }
        return Signal(SIGNATURE, power, coords, attrs)


def sum_columns(
    plane_re: Plane,
    plane_im: Plane,
    n_pulses: int,
    first_pulse: int,
    hop: int,
    window: Plane,
    low: npt.NDArray[np.float64],
    high: npt.NDArray[np.float64],
    out: Plane,
) -> None:
    """Sum the power of a moving gate over range, column by column (E-24, E-27)."""
    # mu[j, k] = sum_n g[j, n] |sum_m w[m] Y[i_j + m - h, n] e^{-j 2 pi k m / K}|^2, with the
    # Doppler bins in ascending order (zero Doppler at k = K // 2) and g[j, n] the share of bin n's
    # cell (n - 1/2 to n + 1/2) between low[j] and high[j]. Pulses outside 0..I-1 and parts of the
    # gate outside the frame count as zero; the first pulse i_0 - h, at which the window of column 0
    # starts, may be negative. Shapes: planes (N, I or more), one contiguous row a range bin; window
    # (K,), with zeros up to the transform length; low, high (J,), in bins; out (J, K), overwritten.
    if native.has_passes(window.size):
        native.gated_signature(plane_re, plane_im, n_pulses, first_pulse, hop, window, low, high, out)
        return
    from scipy import fft

    for block in range(0, out.shape[0], LANES):
        columns = slice(block, block + LANES)
        start, stop = low[columns], high[columns]
        bins = np.arange(max(0, math.floor(start.min() - 0.5) + 1), min(plane_re.shape[0], math.ceil(stop.max() + 0.5)))
        pulses = first_pulse + hop * np.arange(block, block + start.size)[:, None] + np.arange(window.size)
        inside = (pulses >= 0) & (pulses < n_pulses)
        at = np.where(inside, pulses, 0)
        share = np.minimum(stop[:, None], bins + 0.5) - np.maximum(start[:, None], bins - 0.5)
        frames = np.empty((bins.size, *pulses.shape), dtype=np.complex64)
        frames.real, frames.imag = (np.where(inside, plane[bins][:, at], 0.0) for plane in (plane_re, plane_im))
        spectrum = fft.fftshift(fft.fft(frames * window, axis=-1), axes=-1)
        power = spectrum.real**2 + spectrum.imag**2
        out[columns] = np.einsum("jn,njk->jk", np.maximum(share, 0.0).astype(np.float32), power)


NEED_BLOCK = 32
"""Number of columns that :meth:`GatedTransform.find_needed_pulses` processes together."""


def make_gated_transform(
    gate: Gate,
    slow_time: SlowTime,
    range_m: npt.NDArray[np.float64],
    analysis: Analysis,
    *,
    bin_share: float = 1.0,
) -> GatedTransform:
    """Prepare a recording's gate and transform."""
    transform, time_s, _, prf_hz, hop = plan_columns(slow_time, analysis)
    low, high = gate.edges(range_m, time_s, sharp=analysis.sharp_edges)
    return GatedTransform(gate, transform, prf_hz, slow_time.size, range_m, time_s, low, high, hop, bin_share)


@maps_signal(SIGNATURE)
def decimate(signature: Signal) -> Signal:
    """Decimate a signature to the lossless hop.

    Every n-th column is kept if the hop is finer than the lossless hop; otherwise all are kept. The
    columns between can be interpolated from the kept ones (E-23), so features do not depend on
    them. If the lossless hop is a multiple of the hop, the features are those of the lossless hop;
    otherwise they are those of the largest multiple below.

    Examples
    --------
    >>> import doppelgait as dg
    >>> recording = dg.data.sample()
    >>> result = dg.analyze(recording, gate="truth", analysis=dg.Analysis(hop=1))[0]
    >>> result.signature.sizes["time"], dg.processing.decimate(result.signature).sizes["time"]
    (3900, 488)
    """
    every = find_lossless_hop(signature.attrs["cpi_pulses"]) // signature.attrs["hop"]
    if every <= 1:
        return signature
    kept = signature.take_columns(slice(None, None, every))
    return kept.replace(np.ascontiguousarray(kept.values), attrs={"hop": signature.attrs["hop"] * every})


MIN_SHARE = 0.5  # smallest part of a column's gate inside the frame; columns with less are removed
MIN_COLUMNS = 8


def crop_to_frame(signature: AnySignal) -> tuple[AnySignal, float]:
    """Crop a signature to the time inside the frame.

    The time in which the gate is mostly outside is removed.

    Parameters
    ----------
    signature : DataArray (time, doppler)
        Signature with the coordinate ``gate_share``.

    Returns
    -------
    signature : DataArray (time, doppler)
        Longest run of columns with half of the gate or more inside. A column with a part of its
        gate outside is divided by the part inside, so that its noise has the level of a whole gate.
    share : float
        Mean part of the gate that was inside, over the whole recording; 1 if the gate was always inside.

    Raises
    ------
    AnalysisError
        If fewer than 8 columns remain.
    """
    if not isinstance(signature, Signal):
        given = Signal.of(signature, SIGNATURE)
        kept, inside = crop_to_frame(given)
        return (signature if kept is given else kept.label()), inside
    share = signature.axis("gate_share")
    if share.size < MIN_COLUMNS:
        raise AnalysisError(
            f"the signature has {share.size} column{'s' * (share.size > 1)}, at least {MIN_COLUMNS} are needed; "
            "record longer, or lower hop where it is coarser than the lossless one"
        )
    if share.min() >= 1.0:
        return signature, 1.0
    edges = np.flatnonzero(np.diff(np.concatenate([[0], share >= MIN_SHARE, [0]]).astype(int)))
    runs = edges.reshape(-1, 2)
    first, stop = max(runs, key=lambda run: run[1] - run[0]) if runs.size else (0, 0)
    if stop - first < MIN_COLUMNS:
        raise AnalysisError(
            f"the gate lies outside the recorded frame for all but {stop - first} of {share.size} columns; move or "
            "narrow the gate, or record with another range_start_m and range_stop_m"
        )
    kept = signature.take_columns(slice(int(first), int(stop)))
    scaled = kept.values / kept.axis("gate_share")[:, None].astype(np.float32)
    return kept.replace(scaled), float(share.mean())
