"""Signature of pulse bursts with pauses.

Two kinds of sensor record in bursts: sensors that sleep between frames, and microcontrollers that alternate between
sampling and sending. A processing interval must not cross a pause, so every burst becomes one column.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.core.errors import AnalysisError, warn_caller
from doppelgait.core.labels import BASEBAND, SIGNATURE, check_signal, make_array, read_axis
from doppelgait.core.units import doppler_axis_hz, doppler_to_velocity_mps
from doppelgait.processing.config import MIN_CPI_PULSES, Analysis, find_fast_length, gaussian_window
from doppelgait.processing.gate import Gate, compute_bin_share

FloatArray = npt.NDArray[np.float64]

PAUSE = 1.5
"""Ratio of a slow-time step to the usual step above which the step is a pause between bursts."""
UNEVEN = 0.1
"""Largest relative deviation of a burst period from the usual period that causes no warning."""


def find_burst_pulses(slow_time_s: npt.ArrayLike) -> int | None:
    """Count the pulses per burst from pauses.

    The result is None if there is no pause.

    Parameters
    ----------
    slow_time_s : array_like, shape (I,)
        Times of the pulses, ascending.

    Returns
    -------
    int or None

    Raises
    ------
    AnalysisError
        If the bursts have different lengths; a shorter last one is allowed.

    See Also
    --------
    get_burst_pulses : the stored number.

    Examples
    --------
    >>> import numpy as np
    >>> from doppelgait.processing import find_burst_pulses
    >>> burst_s = np.arange(8) * 0.001
    >>> find_burst_pulses(np.concatenate([burst_s + 0.1 * n for n in range(10)]))
    8
    """
    times = np.asarray(slow_time_s, dtype=float)
    steps = np.diff(times)
    if steps.size < 2 or not (steps > 0).all():
        return None
    # The usual step is the shortest third: with two pulses in a burst every other step is a pause.
    usual = float(np.quantile(steps, 0.3, method="lower"))
    ends = np.flatnonzero(steps > PAUSE * usual) + 1
    if not ends.size:
        return None
    lengths = np.diff([0, *ends])
    if (lengths != lengths[0]).any() or times.size - ends[-1] > lengths[0]:
        found = sorted({int(n) for n in (*lengths, times.size - ends[-1])})
        raise AnalysisError(
            f"the bursts of this recording have different lengths ({', '.join(map(str, found))} pulses); pulses are "
            "missing or burst_pulses must be given"
        )
    return int(lengths[0])


def get_burst_pulses(baseband: xr.DataArray) -> int | None:
    """Return the number of pulses per burst of a recording.

    The number is the attribute ``burst_pulses`` if it is set, and is otherwise derived from the pulse times. It is
    None for a recording without bursts.

    See Also
    --------
    find_burst_pulses : find the number from the pulse times.

    Examples
    --------
    >>> import doppelgait as dg
    >>> scene = dg.Scene([dg.Target({"kind": "boulic", "speed_mps": 1.2}, label="human")], duration_s=2.0)
    >>> recording = dg.simulate(scene, dg.Radar.preset("ti-60-burst"))
    >>> dg.processing.get_burst_pulses(recording.baseband)
    96
    """
    stated = baseband.attrs.get("burst_pulses")
    return int(stated) if stated is not None else find_burst_pulses(read_axis(baseband, "slow_time"))


def average_bursts(baseband: xr.DataArray) -> xr.DataArray:
    """Average the pulses of each burst, to observe slow motion."""
    pulses = get_burst_pulses(baseband)
    if pulses is None:
        return baseband
    count = baseband.sizes["slow_time"] // pulses
    values = baseband.values[: count * pulses].reshape(count, pulses, -1).mean(axis=1)
    times_s = read_axis(baseband, "slow_time")[: count * pulses].reshape(count, pulses).mean(axis=1)
    attrs = {name: value for name, value in baseband.attrs.items() if name != "burst_pulses"}
    return make_array(BASEBAND, values, {"slow_time": times_s, "range": read_axis(baseband, "range")}, attrs)


@dataclass(frozen=True)
class _Bursts:
    """Slow time in bursts.
    Shapes: time_s (J,).
    """

    count: int
    pulses: int
    prf_hz: float
    period_s: float
    time_s: FloatArray


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

    See Also
    --------
    signature : signature of a recording without pauses.

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
    from scipy import fft

    check_signal(baseband, BASEBAND)
    bursts = _split_bursts(read_axis(baseband, "slow_time"), burst_pulses or get_burst_pulses(baseband))
    wanted = analysis.doppler_bins or (
        bursts.pulses if analysis.method == "liland2018" else find_fast_length(bursts.pulses)
    )
    if wanted < bursts.pulses:
        raise AnalysisError(f"doppler_bins is {wanted}, but a burst has {bursts.pulses} pulses: K >= M")
    ranges_m = read_axis(baseband, "range")
    if gate is None:
        spacing_m = float((ranges_m[-1] - ranges_m[0]) / max(ranges_m.size - 1, 1))
        low = np.full(bursts.time_s.size, -0.5)
        high = low + ranges_m.size
        middle_m = np.full(bursts.count, ranges_m.mean())
        facts: dict[str, Any] = {"source": "frame", "span_m": spacing_m * ranges_m.size, "doppler_limited": False}
    else:
        low, high = gate.edges(ranges_m, bursts.time_s, sharp=analysis.sharp_edges)
        gate.touched_bins(low, high, ranges_m)
        middle_m, facts = gate.centre_at(bursts.time_s), gate.facts
    window = gaussian_window(bursts.pulses, analysis.window_steepness)
    cube = baseband.values[: bursts.count * bursts.pulses].reshape(bursts.count, bursts.pulses, -1)
    power = np.zeros((bursts.count, wanted), dtype=np.float32)
    for n in range(cube.shape[2]):
        share = np.clip(np.minimum(high, n + 0.5) - np.maximum(low, n - 0.5), 0.0, 1.0)
        if not share.any():
            continue
        pulses = cube[:, :, n].astype(np.complex128)
        if remove_mean:
            pulses -= pulses.mean(axis=1, keepdims=True)
        spectrum = fft.fftshift(fft.fft(pulses * window, wanted, axis=1), axes=1)
        power += (share[:, None] * (spectrum.real**2 + spectrum.imag**2)).astype(np.float32)
    doppler_hz = doppler_axis_hz(wanted, bursts.prf_hz)
    if gate is not None:
        gate.close_doppler_band(power, doppler_hz)
    inside = np.minimum(high, ranges_m.size - 0.5) - np.maximum(low, -0.5)
    coords = {
        "time": bursts.time_s,
        "doppler": doppler_hz,
        "velocity": ("doppler", doppler_to_velocity_mps(doppler_hz, wavelength_m)),
        "centre_range": ("time", middle_m, {"units": "m"}),
        "gate_share": ("time", np.clip(inside / (high - low), 0.0, 1.0), {"units": "1"}),
    }
    attrs = {
        "prf_hz": bursts.prf_hz,
        "wavelength_m": wavelength_m,
        "cpi_pulses": bursts.pulses,
        "hop": max(1, round(bursts.period_s * bursts.prf_hz)),
        "window_energy": float((window**2).sum()),
        "n_gate_bins": float(high[0] - low[0]) * compute_bin_share(baseband),
        "gate": json.dumps(facts),
    }
    return make_array(SIGNATURE, power, coords, attrs)


def _split_bursts(slow_time_s: FloatArray, pulses: int | None) -> _Bursts:
    if pulses is None:
        raise AnalysisError("the recording has no bursts: its pulses are evenly spaced; use the plain signature")
    if pulses < MIN_CPI_PULSES:
        raise AnalysisError(
            f"a burst has {pulses} pulse{'s' * (pulses != 1)}, at least {MIN_CPI_PULSES} are needed to measure Doppler"
        )
    count = slow_time_s.size // pulses
    if not count:
        raise AnalysisError(f"the recording has {slow_time_s.size} pulses, less than one burst of {pulses}")
    times = slow_time_s[: count * pulses].reshape(count, pulses)
    lengths_s = times[:, -1] - times[:, 0]
    if not (np.diff(times, axis=1) > 0).all() or np.ptp(lengths_s) > 0.5 * lengths_s.mean() / (pulses - 1):
        raise AnalysisError(
            f"slow time does not fall into bursts of {pulses} evenly spaced pulses; pulses are missing or burst_pulses "
            "is wrong"
        )
    middle_s = times.mean(axis=1)
    periods_s = np.diff(middle_s)
    prf_hz = float((pulses - 1) / lengths_s.mean())
    period_s = float(np.median(periods_s)) if count > 1 else pulses / prf_hz
    uneven = int((np.abs(periods_s - period_s) > UNEVEN * period_s).sum())
    if uneven:
        warn_caller(
            f"{uneven} of {periods_s.size} periods between bursts differ from the usual {period_s:.4g} s: bursts are "
            "missing or late, and cadence frequencies are inaccurate there"
        )
    return _Bursts(count, pulses, prf_hz, period_s, middle_s)
