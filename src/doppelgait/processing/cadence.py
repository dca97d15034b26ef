"""Cadence-velocity diagram and cadence spectra (E-30 to E-32)."""

from __future__ import annotations

import math
from functools import lru_cache, partial
from threading import local
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait._core import native
from doppelgait.core.labels import (
    CADENCE_MAP,
    CADENCE_SPECTRUM,
    NORMALISED_SIGNATURE,
    SIGNATURE,
    Signal,
    maps_signal,
    measures_signal,
    sampling_rate_hz,
)
from doppelgait.core.straight import make_orthonormal_basis
from doppelgait.core.units import FloatArray, exponential, modified_bessel
from doppelgait.processing.normalise import copy_rows

WIDTH = 18  # of the interpolation kernel in grid steps; at the rates used here the error is 1e-13
LOWEST_OVERSAMPLING = 2.0
GROUP = 64  # rows that are processed together, so that all buffers stay in the second-level cache

SPARE_PAIRS = 4
"""Unused values between columns: if these are a power of two apart, a transform over them takes twice the time."""
LARGEST_BUFFER = 1 << 20  # number of values in a buffer that a thread keeps; a larger buffer is freed after use

_buffers = local()


def compute_magnitudes(rows: FloatArray, weights: FloatArray, length: int, n_kept: int) -> FloatArray:
    """Compute the first magnitudes of every row's zero-padded transform."""
    step = _find_coarsest_step(rows.shape[0], length, n_kept)
    if step > 1:
        coarse, response = _smear(rows, weights, length, n_kept, step)
        return compute_magnitudes(coarse, np.ones(coarse.shape[0]), length // step, n_kept) / response[:, None]
    for between in (4, 3, 2):
        fewer = length // between
        fits = fewer >= LOWEST_OVERSAMPLING * rows.shape[0] and fewer // 2 > n_kept / between + WIDTH + 1
        if length % between == 0 and fits:
            return _interpolate_lines(rows, weights, length // between, between, n_kept)
    lines = np.fft.rfft(np.ascontiguousarray((rows * weights[:, None]).T), length, axis=1)[:, :n_kept]
    return np.ascontiguousarray(np.abs(lines).T)


def sum_powers(rows: FloatArray, weights: FloatArray, length: int, n_kept: int) -> FloatArray:
    """Sum :func:`compute_magnitudes` squared over all rows, (Q,)."""
    # the sum is the transform of the rows' summed autocorrelation
    from scipy import fft

    step = _find_coarsest_step(rows.shape[0], length, n_kept)
    if step > 1:
        coarse, response = _smear(rows, weights, length, n_kept, step)
        return np.asarray(sum_powers(coarse, np.ones(coarse.shape[0]), length // step, n_kept) / response**2)
    n_columns, n_rows = rows.shape
    padded, n_pairs = fft.next_fast_len(2 * n_columns, real=True), (n_rows + 1) // 2
    # two real rows form one complex row; the even part of its power spectrum is the sum of both rows' power spectra
    pairs = _get_buffer("pairs", (padded, n_pairs + SPARE_PAIRS), np.complex128)[:, :n_pairs]
    parts = pairs.view(np.float64)
    np.multiply(rows, weights[:, None], out=parts[:n_columns, :n_rows])
    parts[:n_columns, n_rows:] = 0.0
    parts[n_columns:] = 0.0
    np.fft.fft(pairs, axis=0, out=pairs)
    powers = np.einsum("qk,qk->q", parts, parts)
    both = powers[: padded // 2 + 1].copy()
    both[1:] += powers[: -both.size : -1]  # the opposite lines
    both[0] += powers[0]
    products = np.fft.irfft(0.5 * both, padded)[:n_columns]
    found = np.fft.rfft(products, length)[:n_kept].real
    return np.asarray(np.maximum(2.0 * found - products[0], 0.0))


@lru_cache(maxsize=256)
def _find_coarsest_step(n_columns: int, length: int, n_kept: int) -> int:
    """Find the largest allowed decimation of the column rate."""
    # the decimated rate is at least 1.5 times the two-sided band
    steps = (d for d in range(1, length // (3 * n_kept) + 1) if length % d == 0)
    return max((d for d in steps if n_columns / d + WIDTH + 1 <= length / d), default=1)


def _smear(rows: FloatArray, weights: FloatArray, length: int, n_kept: int, step: int) -> tuple[FloatArray, FloatArray]:
    """Apply step 1 of :func:`compute_magnitudes`; also return the kernel's response."""
    taps, shape_factor = _time_taps(step, length / step / (2.0 * n_kept))
    coarse = np.empty((-(-rows.shape[0] // step) + WIDTH, rows.shape[1]))
    native.smear(rows, weights, taps, step, coarse)
    return coarse, _transform_kernel(n_kept, 0, length // step, shape_factor)


def _interpolate_lines(rows: FloatArray, weights: FloatArray, length: int, between: int, n_kept: int) -> FloatArray:
    """Apply steps 2 and 3 of :func:`compute_magnitudes`."""
    n_columns, n_rows = rows.shape
    taps, shape_factor = _compute_line_taps(between, length / n_columns)
    # the kernel needs time 0 in the middle of the record; this does not change magnitudes
    sharper = weights / _transform_kernel(n_columns, n_columns // 2, length, shape_factor)
    rows, found = np.ascontiguousarray(rows), np.empty((n_kept, n_rows))
    group = min(max(LARGEST_BUFFER // length, 1), GROUP)  # long rows would fill the memory
    for first in range(0, n_rows, group):
        size = min(group, n_rows - first)
        circular = _get_buffer("circular", (size, length))
        native.lay_circular(rows, sharper, first, circular)  # step 2: transforms of contiguous rows take half the time
        lines = _get_buffer("lines", (size, length // 2 + 1), np.complex128)
        np.fft.rfft(circular, axis=1, out=lines)
        native.fine_magnitudes(lines, taps, first, found)  # step 3: the lines between
    return found


def _get_buffer(name: str, shape: tuple[int, ...], dtype: type = np.float64) -> npt.NDArray[Any]:
    # the first access to new memory takes longer than the transforms
    size = math.prod(shape)
    if size > LARGEST_BUFFER:
        return np.empty(shape, dtype=dtype)
    held = getattr(_buffers, name, None)
    if held is None or held.size < size:
        held = np.empty(size, dtype=dtype)
        setattr(_buffers, name, held)
    return np.asarray(held[:size].reshape(shape))


@lru_cache(maxsize=256)  # there are as many as highest cadences
def _time_taps(step: int, oversampling: float) -> tuple[FloatArray, float]:
    """Compute the kernel at fine columns, (step WIDTH - 1,), and its shape factor."""
    return _evaluate_kernel(np.arange(1, step * WIDTH) / step - WIDTH / 2, oversampling)


@lru_cache(maxsize=256)
def _compute_line_taps(between: int, oversampling: float) -> tuple[FloatArray, float]:
    """Compute the kernel between coarse lines, (between, WIDTH), and its shape factor."""
    coarse = np.arange(WIDTH) - (WIDTH // 2 - 1)
    return _evaluate_kernel(np.arange(between)[:, None] / between - coarse, oversampling)


def _evaluate_kernel(distance: FloatArray, oversampling: float) -> tuple[FloatArray, float]:
    """Compute the Kaiser-Bessel kernel within W / 2, and its shape factor."""
    shape_factor = math.pi * WIDTH * (1.0 - 0.5 / oversampling)
    inside = 1.0 - (2.0 * distance / WIDTH) ** 2
    values = modified_bessel(shape_factor * np.sqrt(np.maximum(inside, 0.0))) * math.exp(-shape_factor)
    return np.where(inside > 0, values, 0.0), shape_factor


@lru_cache(maxsize=256)
def _transform_kernel(count: int, centre: int, length: int, shape_factor: float) -> FloatArray:
    # W sinh(r) / r, r^2 = b^2 - (pi W f)^2, at f = (n - centre) / length
    cycles_per_step = (np.arange(count) - centre) / length
    root = np.sqrt(shape_factor**2 - (math.pi * WIDTH * cycles_per_step) ** 2)
    found: FloatArray = WIDTH * exponential(root - shape_factor) * (1.0 - exponential(-2.0 * root)) / (2.0 * root)
    found.flags.writeable = False
    return found


MAX_CADENCE_HZ = 20.0  # highest cadence that is kept; no gait has content above it
TAPER_FROM_S = 4.0
PADDING = 8
"""Zero-padding factor of the cadence transform.
Without padding, a bin of 1 / T_o is coarser than 10 % for fewer than five periods (E-30)."""


@measures_signal(SIGNATURE, NORMALISED_SIGNATURE)
def observation_s(signature: Signal) -> float:
    """Compute the observed time T_o, the number of columns times their spacing."""
    return signature.sizes["time"] / sampling_rate_hz(signature.axis("time"))


def detrend_order(seconds: float) -> int:
    """Compute the order of the detrending polynomial, round(1.2 T_o) from 1 to 6 (E-31)."""
    return min(max(round(1.2 * seconds), 1), 6)


@maps_signal(NORMALISED_SIGNATURE)
def detrend(normalised: Signal, *, order: int) -> Signal:
    """Remove every Doppler row's least-squares polynomial in time (E-31).

    Order 0 removes the mean.

    Parameters
    ----------
    normalised : DataArray (time, doppler)
        From :func:`doppelgait.processing.normalise.normalise`.
    order : int
        0 or more; 0 is the report's mu_0.
    """
    basis = make_orthonormal_basis(normalised.shape[0], order, normalised.counted.tobytes())
    trend = basis @ _project_rows(normalised.values, basis)
    return normalised.replace(np.subtract(normalised.values, trend, out=trend))


def _project_rows(values: FloatArray, basis: FloatArray) -> FloatArray:
    found = np.empty((basis.shape[1], values.shape[1]))
    native.project(values, basis, found)
    return found


@maps_signal(NORMALISED_SIGNATURE)
def cadence_map(rows: Signal, *, padded: bool = True, tapered: bool | None = None) -> Signal:
    """Compute the cadence-velocity diagram D (E-30).

    D is the magnitude of the Fourier transform of each Doppler row over time.

    Parameters
    ----------
    rows : DataArray (time, doppler)
        Normalised signature (D with its constant column), or detrended (D_0).
    padded : bool
        Zero-pad by a factor of 8. If False, the bin is 1 / T_o as in the report.
    tapered : bool, optional
        Apply a Hann taper; by default for observations of 4 s or more.

    Returns
    -------
    DataArray (cadence, doppler)
        ``D[q,k] = |sum_j a_j v[j,k] e^{-j 2 pi q j / J_fft}| / sum(a)`` for cadences of 0 to 20 Hz.

    Examples
    --------
    >>> import doppelgait as dg
    >>> recording = dg.data.sample()
    >>> result = dg.analyze(recording, gate="truth")[0]
    >>> rows = dg.processing.detrend(dg.processing.normalise(result.signature, 0.0), order=3)
    >>> diagram = dg.processing.cadence_map(rows)
    >>> round(float(diagram.sum("doppler").idxmax("cadence")), 1)  # gait frequency, Hz
    1.8
    """
    weights, length, cadence_hz = _weigh_columns(rows, padded=padded, tapered=tapered)
    magnitude = compute_magnitudes(rows.values, weights, length, cadence_hz.size)
    return rows.with_axes(CADENCE_MAP, magnitude, cadence=cadence_hz)


class CadenceParts:
    """Spectrum S and single rows of the diagram D (E-31)."""

    # the rows are spread onto a coarser time grid once: step 1 of compute_magnitudes

    def __init__(self, rows: Signal, order: int) -> None:
        self._like, self._values, self._order = rows, rows.values, order
        n_columns, self._response = rows.shape[0], np.ones(1)
        self._weights, self._length, self.cadence_hz = _weigh_columns(rows)
        step = _find_coarsest_step(n_columns, self._length, self.cadence_hz.size)
        if step == 1 or not rows.counted.all():
            self._values = self.detrend().values
            return
        basis = make_orthonormal_basis(n_columns, order)
        smear = partial(_smear, weights=self._weights, length=self._length, n_kept=self.cadence_hz.size, step=step)
        trend = smear(basis)[0] @ _project_rows(self._values, basis)
        self._values, self._response = smear(self._values)
        self._values -= trend
        self._weights, self._length = np.ones(self._values.shape[0]), self._length // step

    def detrend(self) -> Signal:
        """Remove the polynomials in time from the rows (E-31)."""
        return detrend(self._like, order=self._order)

    def spectrum(self) -> Signal:
        """Compute the power spectrum S (E-32)."""
        # equals cadence_spectrum of cadence_map within 1e-12 of the largest value
        powers = sum_powers(self._values, self._weights, self._length, self.cadence_hz.size) / self._response**2
        return self._like.with_axes(CADENCE_SPECTRUM, powers, cadence=self.cadence_hz)

    def rows(self, wanted: npt.NDArray[np.int64], highest_hz: float) -> tuple[FloatArray, FloatArray]:
        """Compute Doppler rows of D up to a cadence: cadences (Q,), magnitudes (Q, R)."""
        n_kept = min(int(np.searchsorted(self.cadence_hz, highest_hz, side="right")) + 1, self.cadence_hz.size)
        found = compute_magnitudes(copy_rows(self._values, wanted), self._weights, self._length, n_kept)
        return self.cadence_hz[:n_kept], np.divide(found, self._response[:n_kept, None], out=found)


def _weigh_columns(rows: Signal, **options: bool | None) -> tuple[FloatArray, int, FloatArray]:
    return _make_grid(rows.shape[0], sampling_rate_hz(rows.axis("time")), rows.counted.tobytes(), **options)


@lru_cache(maxsize=8)
def _make_grid(
    n_columns: int, rate_hz: float, counted: bytes, *, padded: bool = True, tapered: bool | None = None
) -> tuple[FloatArray, int, FloatArray]:
    # weights of the counted columns with sum 1, transform length and cadences
    from scipy import fft

    taper = np.ones(n_columns)
    if n_columns / rate_hz > TAPER_FROM_S - 1e-9 if tapered is None else tapered:  # Hann, without zero ends
        taper = 0.5 - 0.5 * np.cos(2.0 * np.pi * (np.arange(n_columns) + 1) / (n_columns + 1))
    taper *= np.frombuffer(counted, bool)
    length = fft.next_fast_len(PADDING * n_columns, real=True) if padded else n_columns
    cadence_hz = np.arange(length // 2 + 1) * rate_hz / length
    cadence_hz = cadence_hz[: np.searchsorted(cadence_hz, MAX_CADENCE_HZ, side="right")].copy()
    weights = taper / taper.sum()
    weights.flags.writeable = cadence_hz.flags.writeable = False
    return weights, length, cadence_hz


@measures_signal(NORMALISED_SIGNATURE)
def mean_doppler_spectrum(normalised: Signal) -> npt.NDArray[np.float64]:
    """Average every Doppler row over time: D_1, shape (K,) (E-30)."""
    return np.asarray(normalised.values.mean(axis=0))


@maps_signal(CADENCE_MAP)
def cadence_spectrum(step_doppler: Signal, *, power: bool = True) -> Signal:
    """Sum the cadence-velocity diagram over Doppler.

    Parameters
    ----------
    step_doppler : DataArray (cadence, doppler)
    power : bool
        If True, S[q] = sum D^2, in which noise rows have less weight (E-32). If False, D_g = sum D as in the report.

    Returns
    -------
    DataArray (cadence)

    Examples
    --------
    >>> import doppelgait as dg
    >>> recording = dg.data.sample()
    >>> result = dg.analyze(recording, gate="truth")[0]
    >>> spectrum = dg.processing.cadence_spectrum(result.cadence_map)
    >>> round(float(spectrum.idxmax("cadence")), 1)  # gait frequency, Hz
    1.8
    """
    values = step_doppler.values
    summed = np.einsum("qk,qk->q", values, values) if power else values.sum(axis=1)
    return step_doppler.with_axes(CADENCE_SPECTRUM, summed)
