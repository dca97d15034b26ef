"""The range-Doppler gate: where in the data a target is, whoever says so (truth, tracker or user)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.core.errors import AnalysisError
from doppelgait.core.labels import axis

GATE_UNITS = {"range_low": "m", "range_high": "m", "doppler_low": "Hz", "doppler_high": "Hz"}


def make_gate(
    slow_time_s: npt.ArrayLike,
    centre_range_m: npt.ArrayLike,
    *,
    span_m: float,
    doppler_hz: tuple[float, float] | None = None,
    source: str,
) -> xr.Dataset:
    """Gate of constant span around a range track (E-26).

    Parameters
    ----------
    slow_time_s, centre_range_m : array_like, shape (T,)
        The track of the body: any times, ranges R_c.
    span_m : float
        Range extent g: R_c - g/2 to R_c + g/2.
    doppler_hz : (float, float), optional
        Doppler band B_L to B_H; all Doppler frequencies by default.
    source : str
        Where the track comes from: ``"truth"``, ``"track"`` or ``"given"``; kept in every result.

    Returns
    -------
    Dataset (time)
        ``range_low``, ``range_high`` in m; ``doppler_low``, ``doppler_high`` in Hz.
    """
    times = np.asarray(slow_time_s, dtype=float)
    centre = np.asarray(centre_range_m, dtype=float)
    if times.shape != centre.shape or times.ndim != 1 or not np.isfinite(centre).all():
        raise AnalysisError(f"a gate needs one finite range per time; got shapes {times.shape} and {centre.shape}")
    low, high = doppler_hz if doppler_hz is not None else (-np.inf, np.inf)
    values = {
        "range_low": centre - span_m / 2,
        "range_high": centre + span_m / 2,
        "doppler_low": np.full(times.shape, float(low)),
        "doppler_high": np.full(times.shape, float(high)),
    }
    return xr.Dataset(
        {name: ("time", array, {"units": GATE_UNITS[name]}) for name, array in values.items()},
        coords={"time": ("time", times, {"units": "s"})},
        attrs={"source": source, "span_m": float(span_m), "doppler_limited": doppler_hz is not None},
    )


def gate_centre_m(gate: xr.Dataset, time_s: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Range at the middle of the gate at the given times, by linear interpolation."""
    middle = (gate["range_low"].values + gate["range_high"].values) / 2
    return np.asarray(np.interp(np.asarray(time_s, dtype=float), axis(gate, "time"), middle))


def fixed_gate(slow_time_s: npt.ArrayLike, low_m: float, high_m: float) -> xr.Dataset:
    """Gate that stays where the user says, from ``low_m`` to ``high_m``, for the whole recording.

    Raises
    ------
    AnalysisError
        If the limits are not two rising numbers.
    """
    if not -np.inf < low_m < high_m < np.inf:
        raise AnalysisError(f"gate {low_m:g} to {high_m:g} m: give two rising ranges in m, for example 1.2 to 2.8")
    times = np.asarray(slow_time_s, dtype=float)[[0, -1]]
    return make_gate(times, np.full(2, (low_m + high_m) / 2), span_m=high_m - low_m, source="given")


def gate_edges_in(
    range_m: npt.NDArray[np.float64], gate: xr.Dataset, time_s: npt.ArrayLike, *, sharp: bool
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Edges of the gate in bins of a range axis; a recording without range (one bin) is inside it as a whole."""
    if range_m.size == 1:
        low = np.full(np.shape(time_s), -0.5)
        return low, low + 1.0
    spacing_m = float((range_m[-1] - range_m[0]) / (range_m.size - 1))
    return gate_edges_bins(gate, time_s, first_bin_m=float(range_m[0]), bin_spacing_m=spacing_m, sharp=sharp)


def gate_edges_bins(
    gate: xr.Dataset, time_s: npt.ArrayLike, *, first_bin_m: float, bin_spacing_m: float, sharp: bool
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Lower and upper edge of the gate at the given times in bins; a bin's cell reaches half a bin to either side.

    Sharp edges are put between bins, so that every cell is inside or outside (:func:`gate_bins`).
    """
    if sharp:
        first, count = gate_bins(gate, time_s, first_bin_m=first_bin_m, bin_spacing_m=bin_spacing_m)
        low = first.astype(np.float64) - 0.5
        return low, low + count
    low = np.asarray((gate_centre_m(gate, time_s) - gate.attrs["span_m"] / 2 - first_bin_m) / bin_spacing_m)
    return low, low + gate.attrs["span_m"] / bin_spacing_m


def gate_bins(
    gate: xr.Dataset, time_s: npt.ArrayLike, *, first_bin_m: float, bin_spacing_m: float
) -> tuple[npt.NDArray[np.int64], int]:
    """First range bin of the gate at the given times and the (constant) number of bins (E-27).

    Returns
    -------
    first_bin : ndarray of int64
        ``ceil((R_L - r_min) / dR)``; may lie outside the frame.
    n_bins : int
        ``floor(g / dR) + 1``.
    """
    low = gate_centre_m(gate, time_s) - gate.attrs["span_m"] / 2
    first = np.ceil((low - first_bin_m) / bin_spacing_m - 1e-9).astype(np.int64)
    return first, int(np.floor(gate.attrs["span_m"] / bin_spacing_m + 1e-9)) + 1


def bin_share(baseband: xr.DataArray) -> float:
    """Independent noise values per range bin, as the radar's recording tells; 1 where it tells nothing."""
    return float(baseband.attrs.get("independent_bin_share", 1.0))
