"""From a track to the gate that the analysis reads the data through."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.core.errors import AnalysisError
from doppelgait.core.labels import axis
from doppelgait.processing.gate import make_gate
from doppelgait.processing.track.live import Track


def gate_of(
    track: Track, *, span_m: float, slow_time_s: npt.ArrayLike, cpi_s: float = 0.1,
    doppler_hz: tuple[float, float] | None = None,
) -> xr.Dataset:  # fmt: skip
    """Gate around a track, of the same kind as any other, over the pulses that the track speaks for.

    Parameters
    ----------
    track : Track
    span_m : float
        Range extent of the gate (E-26): the same for every body.
    slow_time_s : array_like, shape (I,)
        Pulse times of the recording. Kept are those from half a processing interval before the first detection to as
        much after the last: a scan rests on the pulses so near to its time.
    cpi_s : float
        Processing interval of the scans.
    doppler_hz : (float, float), optional
        Doppler band of the gate; all Doppler frequencies by default.

    Returns
    -------
    Dataset (time)
        As of :func:`doppelgait.processing.make_gate`, ``source = "track"``. It may start after the recording and end
        before it; :func:`crop` cuts the recording to it.

    Raises
    ------
    AnalysisError
        If fewer than two pulses lie in the time of the track.
    """
    times_s = np.asarray(slow_time_s, dtype=float)
    slack_s = 1e-9
    first_s, last_s = track.first_s - cpi_s / 2 - slack_s, track.last_s + cpi_s / 2 + slack_s
    times_s = times_s[(times_s >= first_s) & (times_s <= last_s)]
    if times_s.size < 2:
        raise AnalysisError(
            f"track from {track.first_s:g} to {track.last_s:g} s: the recording has {times_s.size} pulses in that time"
        )
    before_s, after_s = np.minimum(times_s - track.first_s, 0.0), np.maximum(times_s - track.last_s, 0.0)
    centre_m = np.interp(times_s, track.times_s, track.range_m)
    centre_m -= before_s * track.velocity_mps[0] + after_s * track.velocity_mps[-1]  # dR/dt = -v
    return make_gate(times_s, centre_m, span_m=span_m, doppler_hz=doppler_hz, source="track")


def crop(baseband: xr.DataArray, gate: xr.Dataset) -> xr.DataArray:
    """The part of a recording that a gate speaks for: its pulses from the gate's first to its last time."""
    times_s, inside = axis(baseband, "slow_time"), axis(gate, "time")
    first = int(np.searchsorted(times_s, inside[0] - 1e-9))
    stop = int(np.searchsorted(times_s, inside[-1] + 1e-9))
    return baseband.isel(slow_time=slice(first, stop))
