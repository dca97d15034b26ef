"""Main Doppler line and alignment to it (E-29)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait._core import native
from doppelgait.core.errors import AnalysisError
from doppelgait.core.labels import NORMALISED_SIGNATURE, SIGNATURE, Signal, maps_signal, measures_signal
from doppelgait.core.units import FloatArray
from doppelgait.processing.normalise import compute_median

ITERATIONS = 6
CAUCHY_TUNING = 2.385  # tuning constant of the Cauchy weights: 95 % efficiency on Gaussian errors
AGREEING_SHARE, DIFFERING_SHARE = 0.05, 0.1
"""Difference of main line and track, as a share of the track's velocity: agreement below, doubtful values above."""
LEAST_APART_MPS = 0.03
TRACK_ERROR_M = 0.15  # of a track's path; it reduces the weight of its velocity over a short time
UNFOLDED_SHARE = 0.8  # of half the pulse rate, above which a torso line may be folded and is not compared with a track
NEAR_TRACK_MPS = 0.4
BODY_SHARE = 0.1
RIDGE_REACH_MPS, RIDGE_COST, RIDGE_SMOOTH_S = 0.8, 2.0, 0.04
ALIGN_ABOVE_HZ = 10.0  # drift of the straight main line above which a signature is aligned (E-29)


def find_column_peaks(signature: Signal) -> tuple[npt.NDArray[Any], FloatArray]:
    """Find every column's strongest cell and its Doppler."""
    values, doppler_hz = np.ascontiguousarray(signature.values), signature.axis("doppler")
    strongest, place = np.empty(values.shape[0], values.dtype), np.empty(values.shape[0])
    native.column_peaks(values, strongest, place)
    place *= doppler_hz[1] - doppler_hz[0]
    place += doppler_hz[0]
    return strongest, place


@measures_signal(SIGNATURE, NORMALISED_SIGNATURE)
def main_line_hz(signature: Signal, *, order: int, tapered: bool = False) -> FloatArray:
    """Fit a robust polynomial to the strongest Doppler (E-29, E-34).

    Parameters
    ----------
    signature : DataArray (time, doppler)
    order : int
        Order of the Legendre polynomial, 0 or more.
    tapered : bool
        Weight the columns with a parabola in time, 0 at both ends. The mean of the straight line is then equivalent to
        the slope of a straight line fitted to the range, and incomplete steps at the ends hardly bias it.

    Returns
    -------
    ndarray, shape (J,)
        Main line m[j] in Hz, fitted by iteratively reweighted least squares. Cauchy weights reduce
        the influence of columns in which a leg or a stance foot is strongest.

    Examples
    --------
    >>> import doppelgait as dg
    >>> recording = dg.data.sample()
    >>> result = dg.analyze(recording, gate="truth")[0]
    >>> line_hz = dg.processing.main_line_hz(result.signature, order=1)
    >>> round(float(line_hz.mean()))  # Doppler of the torso, Hz
    59
    """
    peaks_hz = find_column_peaks(signature)[1]
    return fit_line(peaks_hz, bin_width_hz(signature), signature.counted, order=order, tapered=tapered)


def fit_line(
    peaks_hz: FloatArray, bin_hz: float, counted: npt.NDArray[np.bool_], *, order: int, tapered: bool = False
) -> FloatArray:
    """Fit the line of :func:`main_line_hz` through the peaks of counted columns, from their median."""
    whole, parabola, ones = _make_line_basis(peaks_hz.size, min(order, peaks_hz.size - 1))
    basis = whole if counted.all() else np.ascontiguousarray(whole[:, counted])
    taper, peaks_hz, ones = (parabola if tapered else ones)[counted], peaks_hz[counted], ones[counted]
    line, coefficients = np.full(peaks_hz.size, compute_median(peaks_hz.copy())), np.empty(whole.shape[0])
    native.robust_fit(basis, peaks_hz, taper, ones, bin_hz / 4.0, CAUCHY_TUNING, ITERATIONS, line, coefficients)
    return line if basis is whole else np.asarray(coefficients @ whole)


@lru_cache(maxsize=8)
def _make_line_basis(n_columns: int, order: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compute the Legendre basis (order + 1, J), parabolic taper and ones of a fit."""
    position = np.linspace(-1.0, 1.0, n_columns)
    basis = np.ascontiguousarray(np.polynomial.legendre.legvander(position, order).T, dtype=np.float64)
    parabola = 1.0 - position**2 + 1e-3
    return basis, parabola, np.ones(n_columns)


def bin_width_hz(signature: Signal) -> float:
    """Return the width of a Doppler bin."""
    doppler_hz = signature.axis("doppler")
    return float(doppler_hz[1] - doppler_hz[0])


def choose_line_order(observation_s: float) -> int:
    """Choose a line's order, below that of steps: 1, 2 from 1.3 s, 3 from 2.5 s (E-29)."""
    return 1 if observation_s < 1.3 else 2 if observation_s < 2.5 else 3


@measures_signal(SIGNATURE, NORMALISED_SIGNATURE)
def needs_alignment(signature: Signal) -> bool:
    """Return True if the main line drifts over 10 Hz."""
    return has_drift(main_line_hz(signature, order=1))


def has_drift(straight_hz: FloatArray) -> bool:
    """Return True if a straight line without taper drifts over 10 Hz."""
    return bool(abs(straight_hz[-1] - straight_hz[0]) > ALIGN_ABOVE_HZ)


@maps_signal(SIGNATURE, NORMALISED_SIGNATURE)
def align(array: Signal, line_hz: FloatArray) -> Signal:
    """Shift every column by minus the line (E-29).

    The shift is circular, with interpolation by cubic convolution between Doppler bins.

    Parameters
    ----------
    array : DataArray (time, doppler)
    line_hz : ndarray, shape (J,)

    Returns
    -------
    DataArray (time, doppler)
        Signature with the line at 0 Hz and unchanged column sums.

    Raises
    ------
    AnalysisError
        If the line has a different number of columns.

    Examples
    --------
    >>> import doppelgait as dg
    >>> recording = dg.data.sample()
    >>> result = dg.analyze(recording, gate="truth")[0]
    >>> aligned = dg.processing.align(result.signature, result.main_line_hz)
    >>> round(float(aligned.sum("time").idxmax("doppler")))  # the torso is near 0 Hz
    -8
    """
    if np.shape(line_hz) != (array.sizes["time"],):
        raise AnalysisError(
            f"line_hz has shape {np.shape(line_hz)}; it must be ({array.sizes['time']},), one frequency per column"
        )
    moved = np.empty(array.shape)
    centre_hz = float(array.axis("doppler")[array.sizes["doppler"] // 2])  # 0 Hz, unless the receiver has one output
    native.shift_columns(array.values, (line_hz - centre_hz) / bin_width_hz(array), moved)
    aligned = array.replace(moved)
    if centre_hz:
        aligned.coords = {
            name: (dims, values - values[values.size // 2] if dims == ("doppler",) else values, attrs)
            for name, (dims, values, attrs) in aligned.coords.items()
        }
    return aligned


@dataclass(frozen=True)
class TrackVelocity:
    """Radial velocity of a range track. Shapes: line_mps (J,)."""

    line_mps: FloatArray
    bend_mps: float
    mean_mps: float


def track_velocity(time_s: FloatArray, range_m: FloatArray) -> TrackVelocity:
    """Measure the radial velocity of a range track by a cubic (E-34)."""
    half_s = float(time_s[-1] - time_s[0]) / 2.0
    fit, position = _make_cubic_basis(time_s.size)
    a = fit @ range_m
    line_mps = -(a[1] + 3.0 * a[2] * position) / half_s
    return TrackVelocity(line_mps, -float(a[3]) / half_s, -float(a[1] + a[3]) / half_s)


@lru_cache(maxsize=8)
def _make_cubic_basis(n_columns: int) -> tuple[FloatArray, FloatArray]:
    position = np.linspace(-1.0, 1.0, n_columns)
    return np.asarray(np.linalg.pinv(np.polynomial.legendre.legvander(position, 3)), dtype=np.float64), position


def choose_velocity(
    signature: Signal, floor_v2: float, strongest_v2: npt.NDArray[Any], line_hz: FloatArray, track_hz: FloatArray
) -> tuple[FloatArray, bool]:
    """Choose between main line and track velocity (E-34). Shapes: line_hz, track_hz (J,)."""
    # the track's: if limbs are stronger than the trunk or if a person stops
    half_m = float(signature.attrs["wavelength_m"]) / 2.0
    time_s, n_columns = signature.axis("time"), track_hz.size
    seconds = float(time_s[-1] - time_s[0])
    line_mean_hz, track_mean_hz = float(line_hz.sum()) / n_columns, float(track_hz.sum()) / n_columns
    apart_mps, speed_mps = abs(line_mean_hz - track_mean_hz) * half_m, abs(track_mean_hz) * half_m
    band_hz = bin_width_hz(signature) * signature.sizes["doppler"]
    ambiguous = np.abs(track_hz).max() > UNFOLDED_SHARE * band_hz / 2.0
    if ambiguous:  # a line that far from the track is that of another fold
        return line_hz, apart_mps <= band_hz / 2.0 * half_m
    if apart_mps <= max(AGREEING_SHARE * speed_mps, LEAST_APART_MPS, TRACK_ERROR_M / seconds):
        return line_hz, True
    bin_hz, near = bin_width_hz(signature), np.empty_like(strongest_v2)
    centre = np.rint((track_hz - float(signature.axis("doppler")[0])) / bin_hz).astype(np.int64)
    reach = min(round(NEAR_TRACK_MPS / half_m / bin_hz), signature.sizes["doppler"] - 1)  # a slow radar's whole axis
    native.strongest_near(signature.values, centre, reach, near)
    near, strongest = (values[signature.counted].astype(np.float64) for values in (near, strongest_v2))
    if compute_median(near) - floor_v2 >= BODY_SHARE * (compute_median(strongest) - floor_v2):
        return track_hz, True
    return line_hz, apart_mps <= max(DIFFERING_SHARE * speed_mps, LEAST_APART_MPS, TRACK_ERROR_M / seconds)


def torso_velocity_mps(signature: Signal, floor_v2: float, line_hz: FloatArray) -> FloatArray:
    """Follow the torso's radial velocity over time (E-34c). Shapes: line_hz (J,)."""
    values, doppler_hz = signature.values, signature.axis("doppler")
    bin_hz, half_m = bin_width_hz(signature), float(signature.attrs["wavelength_m"]) / 2.0
    time_s, range_m = signature.axis("time"), signature.axis("centre_range")
    if range_m.max() > range_m.min() and time_s.size > 4:
        track = track_velocity(time_s, range_m)
        _, position = _make_cubic_basis(time_s.size)
        curve_hz = (track.line_mps + track.bend_mps * (7.5 * position**2 - 1.5)) / half_m
        if abs(float(curve_hz.sum() / time_s.size - line_hz.sum() / time_s.size)) * half_m <= RIDGE_REACH_MPS:
            line_hz = curve_hz
    path = np.empty(values.shape[0], np.int64)
    reach = min(max(1, round(RIDGE_REACH_MPS / half_m / bin_hz)), (values.shape[1] - 1) // 2)
    native.follow_ridge(values, float(floor_v2), (line_hz - doppler_hz[0]) / bin_hz, reach, RIDGE_COST, path)
    step_s, ridge = float(time_s[-1] - time_s[0]) / max(values.shape[0] - 1, 1), np.empty(values.shape[0])
    refined = np.empty(values.shape[0])
    native.refine_path(values, float(floor_v2), path, refined)
    native.smooth(refined, RIDGE_SMOOTH_S / step_s, False, ridge)
    ridge *= half_m * bin_hz
    ridge += half_m * float(doppler_hz[0])
    return ridge
