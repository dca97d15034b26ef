"""Range-Doppler maps and the gated micro-Doppler signature (E-22 to E-27)."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.core.errors import AnalysisError
from doppelgait.core.labels import BASEBAND, RANGE_DOPPLER, SIGNATURE, check_signal, make_array, sampling_rate_hz
from doppelgait.core.units import doppler_axis_hz, doppler_to_velocity_mps
from doppelgait.processing.config import Analysis, Transform, plan_transform
from doppelgait.processing.gate import gate_centre_m, gate_edges_bins


def plan_for(baseband: xr.DataArray, analysis: Analysis) -> tuple[Transform, float]:
    """Transform of a baseband recording and its frame rate in Hz."""
    check_signal(baseband, BASEBAND)
    return _plan(baseband.coords["slow_time"].values, analysis)


def _plan(slow_time_s: Any, analysis: Analysis) -> tuple[Transform, float]:
    prf_hz = sampling_rate_hz(slow_time_s)
    return plan_transform(analysis, n_pulses=slow_time_s.size, prf_hz=prf_hz), prf_hz


def range_doppler(
    baseband: xr.DataArray, analysis: Analysis, *, wavelength_m: float, columns: npt.ArrayLike | None = None,
    block: int = 64,
) -> Iterator[xr.DataArray]:  # fmt: skip
    """Range-Doppler maps of the recording, in blocks of time so that the whole cube never exists (E-24).

    Parameters
    ----------
    baseband : DataArray (slow_time, range)
    analysis : Analysis
    wavelength_m : float
        For the velocity axis.
    columns : array_like of int, optional
        Which columns (processing intervals); all by default.
    block : int
        Columns in one block.

    Yields
    ------
    DataArray (time, doppler, range)
        ``|sum_m w_m Y_{i+m-h,n} e^{-j 2 pi k m / K}|^2``, float32, V^2; divide by sum(w^2) for power per cell.
    """
    from scipy import fft

    transform, prf_hz = plan_for(baseband, analysis)
    wanted = np.arange(transform.n_columns) if columns is None else np.asarray(columns)
    padded = _zero_pad(baseband.values, transform.half_window if analysis.zero_padded else 0)
    window = transform.window.astype(np.float32)
    doppler_hz = doppler_axis_hz(transform.n_doppler_bins, prf_hz)
    offsets = np.arange(window.size)
    for start in range(0, wanted.size, block):
        part = wanted[start : start + block]
        frames = padded[(part * transform.hop)[:, None] + offsets] * window[None, :, None]
        spectrum = fft.fftshift(fft.fft(frames, transform.n_doppler_bins, axis=1), axes=1)
        coords = {
            "time": baseband.coords["slow_time"].values[0] + transform.centre_pulses()[part] / prf_hz,
            "doppler": doppler_hz,
            "velocity": ("doppler", doppler_to_velocity_mps(doppler_hz, wavelength_m)),
            "range": baseband.coords["range"].values,
        }
        power = (spectrum.real**2 + spectrum.imag**2).astype(np.float32)
        yield make_array(RANGE_DOPPLER, power, coords, {"window_energy": float((transform.window**2).sum())})


def _zero_pad(values: npt.NDArray[Any], count: int) -> npt.NDArray[Any]:
    return np.pad(values, ((count, count), (0, 0))) if count else values


def signature(baseband: xr.DataArray, gate: xr.Dataset, analysis: Analysis, *, wavelength_m: float) -> xr.DataArray:
    """Micro-Doppler signature mu: range-Doppler power summed over the gate (E-27).

    Parameters
    ----------
    baseband : DataArray (slow_time, range)
    gate : Dataset (time)
        From :func:`doppelgait.processing.gate.make_gate` or a tracker.
    analysis : Analysis
    wavelength_m : float
        For the velocity axis.

    Returns
    -------
    DataArray (time, doppler)
        float32, V^2; coordinate ``gate_share`` is the part of the gate that lies inside the frame. Attributes hold the
        window energy sum(w^2), the number of gate bins N_g (a fraction where edges are), hop, M and the gate's source,
        so that levels and the noise floor can be computed from it alone.

    Raises
    ------
    AnalysisError
        If the gate lies outside the frame all the time.
    """
    check_signal(baseband, BASEBAND)
    slow_time_s, range_m = baseband.coords["slow_time"].values, baseband.coords["range"].values
    span = gate_span_bins(gate, slow_time_s, range_m, analysis)
    used = np.ascontiguousarray(baseband.values[:, span].T)
    planes = (np.ascontiguousarray(used.real), np.ascontiguousarray(used.imag))
    return signature_of_planes(
        *planes, span.start, gate, analysis, slow_time_s=slow_time_s, range_m=range_m, wavelength_m=wavelength_m
    )


def gate_span_bins(gate: xr.Dataset, slow_time_s: Any, range_m: Any, analysis: Analysis) -> slice:
    """Range bins that the gate ever touches; an :class:`AnalysisError` if none."""
    transform, prf_hz = _plan(slow_time_s, analysis)
    low, high = _edges(gate, slow_time_s, range_m, analysis, transform, prf_hz)
    first, stop = max(math.floor(low.min()), 0), min(math.ceil(high.max()) + 1, range_m.size)
    if first >= stop:
        raise AnalysisError(
            f"the gate ({gate['range_low'].values.min():.2f} to {gate['range_high'].values.max():.2f} m) lies outside "
            f"the frame of {range_m[0]:.2f} to {range_m[-1]:.2f} m: nothing to analyse"
        )
    return slice(first, stop)


def needed_pulses(gate: xr.Dataset, slow_time_s: Any, range_m: Any, analysis: Analysis) -> npt.NDArray[np.int64]:
    """First and one past the last pulse that the signature reads of every range bin, shape (N, 2); (I, 0) for none."""
    transform, prf_hz = _plan(slow_time_s, analysis)
    low, high = _edges(gate, slow_time_s, range_m, analysis, transform, prf_hz)
    first, stop = np.floor(low - 0.5).astype(int) + 1, np.ceil(high + 0.5).astype(int)
    spans = np.empty((range_m.size, 2), dtype=np.int64)
    spans[:] = (slow_time_s.size, 0)
    starts = transform.first_pulse + transform.hop * np.arange(transform.n_columns)
    for n in range(max(int(first.min()), 0), min(int(stop.max()), range_m.size)):
        columns = np.flatnonzero((first <= n) & (n < stop))
        if columns.size:
            spans[n] = max(starts[columns[0]], 0), min(starts[columns[-1]] + transform.window.size, slow_time_s.size)
    return spans


def _edges(
    gate: xr.Dataset, slow_time_s: Any, range_m: Any, analysis: Analysis, transform: Transform, prf_hz: float
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    time_s = slow_time_s[0] + transform.centre_pulses() / prf_hz
    spacing_m = float((range_m[-1] - range_m[0]) / (range_m.size - 1))
    return gate_edges_bins(
        gate, time_s, first_bin_m=float(range_m[0]), bin_spacing_m=spacing_m, sharp=analysis.sharp_edges
    )


def signature_of_planes(
    plane_re: npt.NDArray[np.float32], plane_im: npt.NDArray[np.float32], first_bin: int, gate: xr.Dataset,
    analysis: Analysis, *, slow_time_s: Any, range_m: Any, wavelength_m: float,
) -> xr.DataArray:  # fmt: skip
    """Micro-Doppler signature as :func:`signature`, from the real and imaginary planes of some range bins.

    Parameters
    ----------
    plane_re, plane_im : ndarray, shape (bins, I or more), float32
        Rows are range bins ``first_bin`` and up; at least those of :func:`gate_span_bins`.
    first_bin : int
    gate : Dataset (time)
    analysis : Analysis
    slow_time_s, range_m : ndarray, shape (I,), (N,)
        Axes of the whole recording.
    wavelength_m : float
    """
    from doppelgait.core.kernels.signature import gated_signature, stage_radices, twiddle_table

    transform, prf_hz = _plan(slow_time_s, analysis)
    low, high = _edges(gate, slow_time_s, range_m, analysis, transform, prf_hz)
    time_s = slow_time_s[0] + transform.centre_pulses() / prf_hz
    window = np.zeros(transform.n_doppler_bins, dtype=np.float32)
    window[: transform.window.size] = transform.window
    out = np.empty((transform.n_columns, transform.n_doppler_bins), dtype=np.float32)
    gated_signature(
        plane_re[:, : slow_time_s.size], plane_im[:, : slow_time_s.size], transform.first_pulse, transform.hop,
        window, low - first_bin, high - first_bin, stage_radices(transform.n_doppler_bins),
        *twiddle_table(transform.n_doppler_bins), out,
    )  # fmt: skip
    mu = _label(out, time_s, prf_hz, gate, transform, float(high[0] - low[0]), wavelength_m)
    inside = np.minimum(high, range_m.size - 0.5) - np.maximum(low, -0.5)
    return mu.assign_coords(gate_share=("time", np.clip(inside / (high - low), 0.0, 1.0), {"units": "1"}))


def _label(
    values: npt.NDArray[np.float32], time_s: npt.NDArray[np.float64], prf_hz: float, gate: xr.Dataset,
    transform: Transform, n_bins: float, wavelength_m: float,
) -> xr.DataArray:  # fmt: skip
    doppler_hz = doppler_axis_hz(transform.n_doppler_bins, prf_hz)
    _close_doppler_band(values, doppler_hz, time_s, gate)
    coords = {
        "time": time_s,
        "doppler": doppler_hz,
        "velocity": ("doppler", doppler_to_velocity_mps(doppler_hz, wavelength_m)),
        "centre_range": ("time", gate_centre_m(gate, time_s), {"units": "m"}),
    }
    attrs = {
        "prf_hz": prf_hz,
        "wavelength_m": wavelength_m,
        "cpi_pulses": transform.window.size,
        "hop": transform.hop,
        "window_energy": float((transform.window**2).sum()),
        "n_gate_bins": n_bins,
        "gate": json.dumps({key: _plain(gate.attrs[key]) for key in ("source", "span_m", "doppler_limited")}),
    }
    return make_array(SIGNATURE, values, coords, attrs)


def _plain(value: Any) -> Any:
    return value.item() if hasattr(value, "item") else value


def _close_doppler_band(
    values: npt.NDArray[np.float32], doppler_hz: npt.NDArray[np.float64], time_s: Any, gate: xr.Dataset
) -> None:
    if not gate.attrs["doppler_limited"]:
        return
    times = gate.coords["time"].values
    low = np.interp(time_s, times, gate["doppler_low"].values)
    high = np.interp(time_s, times, gate["doppler_high"].values)
    values[(doppler_hz[None, :] < low[:, None]) | (doppler_hz[None, :] > high[:, None])] = 0.0
