"""Noise floor of a signature, and its normalisation (E-28)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait._core import native
from doppelgait.core.errors import AnalysisError
from doppelgait.core.labels import NORMALISED_SIGNATURE, SIGNATURE, Signal, maps_signal, measures_signal
from doppelgait.processing.config import Normalisation

INDEPENDENT_AFTER_S = 0.06  # columns this far apart are nearly independent for T_d = 0.1 s (E-23)
QUIET_SHARE = 1.0 / 3.0
LEAST_QUIET_ROWS = 12
COUNTED_EVERY = 4
"""Every fourth column is used: neighbouring columns share most of their pulses and add no information on the noise."""


@measures_signal(SIGNATURE)
def noise_floor_v2(signature: Signal) -> float:
    """Estimate the mean noise of a signature (E-28).

    The estimate uses the Doppler rows of least power. The third of the rows with the least mean
    power gives a first value; all rows that agree with it give the second. A cell of pure noise
    sums N_g exponential variables, and its median is (1 - 1/(9 N_g))^3 times its mean (ln 2 times
    for N_g <= 1; if a gate of about one bin moves across bin edges, the estimate is then up to 12 %
    too high).

    Parameters
    ----------
    signature : DataArray (time, doppler)
        Not normalised, V^2.

    Returns
    -------
    float
        nu = s^2 sum(w^2) N_g in V^2; practically 0 for a noise-free simulation.
    """
    values = np.ascontiguousarray(signature.values)
    row_power = np.empty(values.shape[1])
    native.row_means(values, row_power)
    open_rows = np.flatnonzero(row_power > 0)
    if not open_rows.size:
        return 0.0
    n_gate = max(1.0, float(signature.attrs["n_gate_bins"]))  # below one bin it is one variable
    to_mean = math.log(2.0) if n_gate == 1.0 else compute_median_over_mean(n_gate)
    ordered = open_rows[np.argsort(row_power[open_rows], kind="stable")]
    quiet = ordered[: max(3, int(QUIET_SHARE * ordered.size))]
    floor = compute_median(copy_rows(values, quiet)) / to_mean
    spread = 1.0 / math.sqrt(n_gate * count_independent_columns(signature))
    agreeing = open_rows[row_power[open_rows] < floor * (1.0 + 3.0 * spread)]
    return compute_median(copy_rows(values, agreeing)) / to_mean if agreeing.size > quiet.size else floor


def copy_rows(values: npt.NDArray[Any], rows: npt.NDArray[np.int64]) -> npt.NDArray[Any]:
    """Copy Doppler rows, (time, rows)."""
    values = values if values.dtype.char in "fd" else values.astype(np.float64)
    chosen = np.empty((values.shape[0], rows.size), values.dtype)
    native.copy_rows(values, rows, chosen)
    return chosen


@measures_signal(SIGNATURE)
def count_independent_bins(signature: Signal, floor_v2: float) -> float:
    """Estimate the number of independent range bins (E-27).

    The number is the squared mean over the variance of the cells in the Doppler rows of least power, at least 1. It is
    smaller than the number of bins if range bins share noise, for example because of a filter after the sampler. If
    there are fewer than 12 such rows, the signature's ``n_gate_bins`` is returned.
    """
    values, stated = np.ascontiguousarray(signature.values), max(1.0, float(signature.attrs["n_gate_bins"]))
    row_power = np.empty(values.shape[1])
    native.row_means(values, row_power)
    highest_v2 = floor_v2 * (1.0 + 3.0 / math.sqrt(stated * count_independent_columns(signature)))
    quiet = (row_power > 0) & (row_power < highest_v2)
    n_quiet = np.count_nonzero(quiet)
    if n_quiet < LEAST_QUIET_ROWS:
        return stated
    mean_v2 = float(row_power @ quiet) / n_quiet
    return max(1.0, mean_v2**2 / float(native.variance_of_rows(values, quiet, COUNTED_EVERY)))


def compute_median_over_mean(count: float) -> float:
    """Compute the median over the mean of ``count`` summed exponential variables."""
    return float((1.0 - 1.0 / (9.0 * count)) ** 3)


def compute_median(cells: npt.NDArray[np.floating[Any]]) -> float:
    """Compute the median of cells without NaN, which it reorders."""
    # several times faster than np.median, which partitions around two values
    middle, ordered = cells.size // 2, cells.reshape(-1)
    ordered.partition(middle)
    if cells.size % 2:
        return float(ordered[middle])
    return float(ordered[:middle].max() + ordered[middle]) / 2.0


@measures_signal(SIGNATURE)
def count_independent_columns(signature: Signal) -> float:
    """Count the practically independent columns, J_eff = T_o / 60 ms, at least 1 (E-38)."""
    times = signature.axis("time")
    return max(1.0, float(times[-1] - times[0]) / INDEPENDENT_AFTER_S)


@maps_signal(SIGNATURE)
def normalise(signature: Signal, floor_v2: float, *, mode: Normalisation = "sum") -> Signal:
    """Remove the noise floor and scale every column (E-28).

    Parameters
    ----------
    signature : DataArray (time, doppler)
        V^2.
    floor_v2 : float
        Noise floor; 0 subtracts nothing.
    mode : {"sum", "max", "r4"}
        ``sum``: each column sums to 1. ``max``: the maximum of each column is 1. ``r4``: each column is multiplied by
        (range / mean range)^4 of the gate, which compensates the radar equation.

    Returns
    -------
    DataArray (time, doppler)
        float64, dimensionless; a column with no power above the floor is 0.

    Examples
    --------
    >>> import doppelgait as dg
    >>> recording = dg.data.sample()
    >>> result = dg.analyze(recording, gate="truth")[0]
    >>> floor_v2 = dg.processing.noise_floor_v2(result.signature)
    >>> normalised = dg.processing.normalise(result.signature, floor_v2)
    >>> normalised.sum("doppler").values[:2].round(2)  # sum of every column
    array([1., 1.])
    """
    power, floor = np.ascontiguousarray(signature.values), float(floor_v2)
    values, (sums, highest) = np.empty(power.shape), np.empty((2, power.shape[0]))
    native.sum_excess(power, floor, sums, highest)
    if mode == "sum":
        scale = sums
    elif mode == "max":
        scale = highest
    elif mode == "r4":
        centre = np.maximum(signature.axis("centre_range"), float(signature.attrs.get("wavelength_m", 0.0)))
        scale = ((centre.mean() / centre) ** 2) ** 2 * sums.mean()
    else:
        raise AnalysisError(f"normalisation {mode!r} is not known; allowed are sum, max and r4")
    native.scale_excess(power, floor, np.divide(1.0, scale, out=np.zeros_like(scale), where=scale > 0), values)
    return signature.replace(values, schema=NORMALISED_SIGNATURE, attrs={"normalisation": mode})
