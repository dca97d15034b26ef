"""Range-Doppler maps and gated signature (E-22 to E-27)."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.core.errors import AnalysisError
from doppelgait.core.labels import (
    BASEBAND,
    RANGE_DOPPLER,
    SIGNATURE,
    Signal,
    check_signal,
    make_array,
    read_axis,
    replace_array_values,
    sampling_rate_hz,
    take_columns,
)
from doppelgait.core.lazy import LONG_PULSES, read_pulses
from doppelgait.core.samples import Planes, Samples
from doppelgait.core.units import doppler_axis_hz, doppler_to_velocity_mps
from doppelgait.processing.config import Analysis, Transform, find_lossless_hop, plan_transform
from doppelgait.processing.gate import Gate, compute_bin_share


def plan_for(baseband: xr.DataArray, analysis: Analysis) -> tuple[Transform, float]:
    """Plan a recording's transform; also return its frame rate in Hz."""
    check_signal(baseband, BASEBAND)
    return _plan(read_axis(baseband, "slow_time"), analysis)


def _plan(slow_time_s: Any, analysis: Analysis) -> tuple[Transform, float]:
    prf_hz = sampling_rate_hz(slow_time_s)
    return plan_transform(analysis, n_pulses=slow_time_s.size, prf_hz=prf_hz), prf_hz


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
    >>> scene = dg.Scene([dg.Target({"kind": "boulic", "speed_mps": 1.2}, label="human")], duration_s=3.0)
    >>> recording = dg.simulate(scene, dg.Radar.preset("x4", prf_hz=640.0))
    >>> maps = dg.processing.range_doppler(
    ...     recording.baseband, dg.Analysis(), wavelength_m=recording.radar.wavelength_m
    ... )
    >>> power = abs(next(maps)).isel(time=0) ** 2
    >>> round(float(power.max("doppler").idxmax("range")), 1)  # range of the strongest cell, m
    6.8
    """
    from scipy import fft

    transform, prf_hz = plan_for(baseband, analysis)
    wanted = np.arange(transform.n_columns) if columns is None else np.asarray(columns)
    window = transform.window.astype(np.float32)
    doppler_hz = doppler_axis_hz(transform.n_doppler_bins, prf_hz)
    frames_of = _make_frame_reader(baseband, transform.half_window if analysis.zero_padded else 0, window.size)
    for start in range(0, wanted.size, block):
        part = wanted[start : start + block]
        frames = frames_of(part * transform.hop) * window[None, :, None]
        spectrum = fft.fftshift(fft.fft(frames, transform.n_doppler_bins, axis=1), axes=1)
        coords = {
            "time": read_axis(baseband, "slow_time")[0] + transform.compute_centre_pulses()[part] / prf_hz,
            "doppler": doppler_hz,
            "velocity": ("doppler", doppler_to_velocity_mps(doppler_hz, wavelength_m)),
            "range": read_axis(baseband, "range"),
        }
        power = (spectrum.real**2 + spectrum.imag**2).astype(np.float32)
        yield make_array(RANGE_DOPPLER, power, coords, {"window_energy": float((transform.window**2).sum())})


def _make_frame_reader(baseband: xr.DataArray, pad: int, size: int) -> Callable[[Any], Any]:
    """Return a function that reads ``size`` pulses from each first pulse.
    The baseband is zero-padded by ``pad`` pulses at both ends.
    """
    count = baseband.sizes["slow_time"]
    if count <= LONG_PULSES:
        padded = np.pad(baseband.values, ((pad, pad), (0, 0))) if pad else baseband.values
        return lambda first: padded[first[:, None] + np.arange(size)]

    def of_long(first: npt.NDArray[np.int64]) -> npt.NDArray[np.complex64]:
        frames = np.zeros((first.size, size, baseband.sizes["range"]), dtype=np.complex64)
        for frame, start in zip(frames, (first - pad).tolist(), strict=True):
            low, high = max(start, 0), min(start + size, count)
            frame[low - start : high - start] = read_pulses(baseband, low, high)
        return frames

    return of_long


def signature(baseband: xr.DataArray, gate: Gate, analysis: Analysis, *, wavelength_m: float) -> xr.DataArray:
    """Compute the micro-Doppler signature mu (E-27).

    The signature is the range-Doppler power summed over the gate.

    Parameters
    ----------
    baseband : DataArray (slow_time, range)
    gate : Gate
    analysis : Analysis
    wavelength_m : float
        For the velocity axis.

    Returns
    -------
    DataArray (time, doppler)
        float32, V^2. The coordinate ``gate_share`` is the part of the gate that lies inside the frame. The attributes
        are the window energy sum(w^2), the number of gate bins N_g (not an integer for fractional edges), hop, M and
        the gate's source, so that levels and the noise floor can be computed from the signature alone.

    Raises
    ------
    AnalysisError
        If the gate lies outside the frame all the time.

    See Also
    --------
    burst_signature : signature of a recording in bursts.

    Examples
    --------
    >>> import doppelgait as dg
    >>> scene = dg.Scene([dg.Target({"kind": "boulic", "speed_mps": 1.2}, label="human")], duration_s=3.0)
    >>> recording = dg.simulate(scene, dg.Radar.preset("x4", prf_hz=640.0))
    >>> gate = dg.Gate.fixed(0.5, 5.0, time_s=[0.0, 3.0])
    >>> signature = dg.processing.signature(
    ...     recording.baseband, gate, dg.Analysis(), wavelength_m=recording.radar.wavelength_m
    ... )
    >>> round(float(signature.sum("time").idxmax("doppler")))  # strongest Doppler, Hz
    48
    """
    check_signal(baseband, BASEBAND)
    cut = make_gated_transform(
        gate,
        read_axis(baseband, "slow_time"),
        read_axis(baseband, "range"),
        analysis,
        bin_share=compute_bin_share(baseband),
    )
    if cut.n_pulses > LONG_PULSES:
        return compute_tiled_signature(partial(_read_tile, baseband), cut, wavelength_m=wavelength_m)
    planes, first_bin = Samples(baseband.values).read(cut.find_needed_pulses(), cut.margin_pulses)
    return compute_plane_signature(planes[0], planes[1], first_bin, cut, wavelength_m=wavelength_m)


def _read_tile(baseband: xr.DataArray, pulses: slice, columns: slice) -> Planes:
    values = read_pulses(baseband, pulses.start, pulses.stop)
    return Samples(values).read_tile(slice(0, values.shape[0]), columns)


@dataclass(frozen=True)
class GatedTransform:
    """Gate and transform of one recording.
    Shapes: range_m (N,); time_s (J,); low, high (J,).
    """

    gate: Gate
    transform: Transform
    prf_hz: float
    n_pulses: int
    range_m: npt.NDArray[np.float64]
    time_s: npt.NDArray[np.float64]
    low: npt.NDArray[np.float64]
    high: npt.NDArray[np.float64]
    bin_share: float = 1.0

    @property
    def n_bins(self) -> int:
        """Range bins of the recording, N."""
        return self.range_m.size

    @property
    def margin_pulses(self) -> int:
        """Number of pulses that are read after the needed ones.
        Their weight is zero, and their values must be finite.
        """
        return self.transform.n_doppler_bins - self.transform.window.size + 2 * self.transform.hop

    def find_needed_pulses(self) -> npt.NDArray[np.int64]:
        """Return the pulses that the signature needs per range bin.
        Each row, shape (N, 2), is the first pulse and one past the last pulse; (I, 0) for none.
        """
        self.gate.touched_bins(self.low, self.high, self.range_m)
        columns = np.arange(0, self.time_s.size, NEED_BLOCK)
        first = np.maximum(np.floor(np.minimum.reduceat(self.low, columns) - 0.5).astype(int) + 1, 0)
        stop = np.minimum(np.ceil(np.maximum.reduceat(self.high, columns) + 0.5).astype(int), self.n_bins)
        last = np.minimum(columns + NEED_BLOCK, self.time_s.size) - 1
        begin = np.maximum(self.transform.first_pulse + self.transform.hop * columns, 0)
        end = self.transform.first_pulse + self.transform.hop * last + self.transform.window.size
        spans = np.empty((self.n_bins, 2), dtype=np.int64)
        spans[:] = (self.n_pulses, 0)
        for n in range(columns.size):
            bins = spans[first[n] : max(stop[n], first[n])]
            np.minimum(bins[:, 0], begin[n], out=bins[:, 0])
            np.maximum(bins[:, 1], min(end[n], self.n_pulses), out=bins[:, 1])
        return spans


NEED_BLOCK = 32
"""Number of columns that :meth:`GatedTransform.find_needed_pulses` processes together."""


def make_gated_transform(
    gate: Gate, slow_time_s: Any, range_m: Any, analysis: Analysis, *, bin_share: float = 1.0
) -> GatedTransform:
    """Prepare a recording's gate and transform."""
    transform, prf_hz = _plan(slow_time_s, analysis)
    time_s = slow_time_s[0] + transform.compute_centre_pulses() / prf_hz
    low, high = gate.edges(range_m, time_s, sharp=analysis.sharp_edges)
    return GatedTransform(gate, transform, prf_hz, slow_time_s.size, range_m, time_s, low, high, bin_share)


def compute_plane_signature(
    plane_re: npt.NDArray[np.float32],
    plane_im: npt.NDArray[np.float32],
    first_bin: int,
    cut: GatedTransform,
    *,
    wavelength_m: float,
) -> xr.DataArray:
    """Compute the signature from planes of some range bins.
    The planes are the real and imaginary parts; the rest is as for :func:`signature`.
    """
    from doppelgait.core.kernels.signature import gated_signature

    transform = cut.transform
    out = np.empty((transform.n_columns, transform.n_doppler_bins), dtype=np.float32)
    gated_signature(
        plane_re,
        plane_im,
        cut.n_pulses,
        transform.first_pulse,
        transform.hop,
        _pad_window(transform),
        cut.low - first_bin,
        cut.high - first_bin,
        out,
    )
    return _label_signature(out, cut, wavelength_m)


TILE_PULSES = 1 << 10
"""Number of pulses in a tile of a long recording."""
ReadTile = Callable[[slice, slice], Planes]
LANES = 16
"""Number of columns that the kernel transforms together; tiles of whole groups give the same bytes as one pass."""


def compute_tiled_signature(read_tile: ReadTile, cut: GatedTransform, *, wavelength_m: float) -> xr.DataArray:
    """Compute a long recording's signature tile by tile.
    The bytes are the same as those of :func:`compute_plane_signature`.
    """
    from doppelgait.core.kernels.signature import gated_signature

    cut.gate.touched_bins(cut.low, cut.high, cut.range_m)
    transform, window = cut.transform, _pad_window(cut.transform)
    out = np.zeros((transform.n_columns, transform.n_doppler_bins), dtype=np.float32)
    step = max(TILE_PULSES // transform.hop // LANES, 1) * LANES
    for start in range(0, transform.n_columns, step):
        columns = slice(start, min(start + step, transform.n_columns))
        low, high = cut.low[columns], cut.high[columns]
        bins = slice(max(int(np.floor(low.min() - 0.5)) + 1, 0), min(int(np.ceil(high.max() + 0.5)), cut.n_bins))
        if bins.start >= bins.stop:
            continue
        first = transform.first_pulse + transform.hop * start
        after = transform.first_pulse + transform.hop * (columns.stop - 1) + window.size + 2 * transform.hop
        pulses = slice(max(first, 0), min(after, cut.n_pulses))
        tile = read_tile(pulses, bins)
        gated_signature(
            tile[0],
            tile[1],
            tile.shape[2],
            first - pulses.start,
            transform.hop,
            window,
            low - bins.start,
            high - bins.start,
            out[columns],
        )
    return _label_signature(out, cut, wavelength_m)


def _pad_window(transform: Transform) -> npt.NDArray[np.float32]:
    window = np.zeros(transform.n_doppler_bins, dtype=np.float32)
    window[: transform.window.size] = transform.window
    return window


def _label_signature(out: npt.NDArray[np.float32], cut: GatedTransform, wavelength_m: float) -> xr.DataArray:
    doppler_hz = doppler_axis_hz(cut.transform.n_doppler_bins, cut.prf_hz)
    cut.gate.close_doppler_band(out, doppler_hz)
    inside = np.minimum(cut.high, cut.n_bins - 0.5) - np.maximum(cut.low, -0.5)
    coords = {
        "time": cut.time_s,
        "doppler": doppler_hz,
        "velocity": ("doppler", doppler_to_velocity_mps(doppler_hz, wavelength_m)),
        "centre_range": ("time", cut.gate.centre_at(cut.time_s), {"units": "m"}),
        "gate_share": ("time", np.clip(inside / (cut.high - cut.low), 0.0, 1.0), {"units": "1"}),
    }
    attrs = {
        "prf_hz": cut.prf_hz,
        "wavelength_m": wavelength_m,
        "cpi_pulses": cut.transform.window.size,
        "hop": cut.transform.hop,
        "window_energy": float((cut.transform.window**2).sum()),
        "n_gate_bins": float(cut.high[0] - cut.low[0]) * cut.bin_share,
        "gate": json.dumps(cut.gate.facts),
    }
    return make_array(SIGNATURE, out, coords, attrs)


def decimate(signature: Signal) -> Signal:
    """Decimate a signature to the lossless hop.

    Every n-th column is kept if the hop is finer than the lossless hop; otherwise all are kept. The columns between
    can be interpolated from the kept ones (E-23), so features do not depend on them. If the lossless hop is a multiple
    of the hop, the features are those of the lossless hop; otherwise they are those of the largest multiple below.

    Examples
    --------
    >>> import doppelgait as dg
    >>> scene = dg.Scene([dg.Target({"kind": "boulic", "speed_mps": 1.2}, label="human")], duration_s=3.0)
    >>> recording = dg.simulate(scene, dg.Radar.preset("x4", prf_hz=640.0))
    >>> result = dg.analyze(recording, gate="truth", analysis=dg.Analysis(hop=1))[0]
    >>> result.signature.sizes["time"], dg.processing.decimate(result.signature).sizes["time"]
    (1856, 372)
    """
    every = find_lossless_hop(signature.attrs["cpi_pulses"]) // signature.attrs["hop"]
    if every <= 1:
        return signature
    kept = take_columns(signature, slice(None, None, every))
    return replace_array_values(kept, np.ascontiguousarray(kept.values), attrs={"hop": signature.attrs["hop"] * every})


MIN_SHARE = 0.5
"""Smallest part of a column's gate inside the frame; columns with less are removed."""
MIN_COLUMNS = 8


def crop_to_frame(signature: Signal) -> tuple[Signal, float]:
    """Crop a signature to the time inside the frame.

    The time in which the gate is mostly outside is removed.

    Parameters
    ----------
    signature : DataArray (time, doppler)
        Signature with the coordinate ``gate_share``.

    Returns
    -------
    signature : DataArray (time, doppler)
        Longest run of columns with half of the gate or more inside. A column with a part of its gate outside is divided
        by the part inside, so that its noise has the level of a whole gate.
    share : float
        Mean part of the gate that was inside, over the whole recording; 1 if the gate was always inside.

    Raises
    ------
    AnalysisError
        If fewer than 8 columns remain.

    Examples
    --------
    >>> import doppelgait as dg
    >>> scene = dg.Scene([dg.Target({"kind": "boulic", "speed_mps": 1.2}, label="human")], duration_s=3.0)
    >>> recording = dg.simulate(scene, dg.Radar.preset("x4", prf_hz=640.0))
    >>> result = dg.analyze(recording, gate="truth")[0]
    >>> kept, share = dg.processing.crop_to_frame(result.signature)
    >>> kept.sizes["time"], share
    (372, 1.0)
    """
    check_signal(signature, SIGNATURE)
    share = read_axis(signature, "gate_share")
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
            f"the gate lies outside the recorded frame for all but {stop - first} of {share.size} columns; move the "
            "gate, or record with another range_start_m and range_stop_m"
        )
    kept = take_columns(signature, slice(int(first), int(stop)))
    scaled = kept.values / read_axis(kept, "gate_share")[:, None].astype(np.float32)
    return replace_array_values(kept, scaled), float(share.mean())
