"""Cadence-velocity diagram and cadence spectra (E-30 to E-32)."""

from __future__ import annotations

import math
from functools import lru_cache
from threading import local
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.core.labels import (
    CADENCE_MAP,
    CADENCE_SPECTRUM,
    NORMALISED_SIGNATURE,
    axis,
    check_signal,
    make_array,
    sampling_rate_hz,
    with_values,
)

FloatArray = npt.NDArray[np.float64]

WIDTH = 14
"""Length of the interpolation kernel in grid steps; with the rates below it leaves an error of 1e-13."""
LOWEST_OVERSAMPLING = 2.0
BLOCK = 16
"""Outputs of a kernel that one small matrix product forms."""
GROUP = 64
"""Rows that are worked on together, so that all buffers stay in the second-level cache."""

_buffers = local()


def magnitudes(rows: FloatArray, weights: FloatArray, length: int, n_kept: int) -> FloatArray:
    r"""Compute the first magnitudes of every row's zero-padded transform.

    .. math:: X_{q,k} = \left| \sum_j a_j v_{j,k}\, e^{-2 \pi i q j / L} \right|, \quad q = 0 \ldots Q - 1

    A padded transform repeats what it knows, and a fast column rate adds unwanted lines. So (1) the rows
    are smeared onto a coarser time grid by a kernel whose transform vanishes (1e-13) where its aliases fall on the
    lines wanted; (2) a transform with little padding gives every d-th line; (3) the lines between are interpolated
    by the same kernel in frequency, exactly for a record of finite length. Both smears are divided out: (1) after the
    transform, (3) before it. This is the non-uniform fast Fourier transform (Kaiser-Bessel kernel) on uniform grids.

    Parameters
    ----------
    rows : ndarray, shape (J, K)
    weights : ndarray, shape (J,)
        a, of every column.
    length : int
        L, J or more.
    n_kept : int
        Q, at most L / 2 + 1.

    Returns
    -------
    ndarray, shape (Q, K)
    """
    from scipy import fft

    # the largest whole step by which the column rate may fall and stay 2.5 times the two-sided band
    steps = (d for d in range(1, length // (5 * n_kept) + 1) if length % d == 0)
    step = max((d for d in steps if rows.shape[0] / d + WIDTH + 1 <= length / d), default=1)
    if step > 1:
        # (1): the kernel at every step-th column only, in blocks of small matrix products
        n_columns, n_rows = rows.shape
        n_coarse = -(-n_columns // step) + WIDTH
        n_blocks = -(-n_coarse // BLOCK)
        band, shape_factor = _time_band(step, length / step / (2.0 * n_kept))
        padded = np.empty((step * (n_blocks * BLOCK + WIDTH), n_rows))
        before = step * WIDTH - 1
        padded[:before] = padded[before + n_columns :] = 0.0
        np.multiply(rows, weights[:, None], out=padded[before : before + n_columns])
        blocks = np.empty((n_blocks, BLOCK, n_rows))
        for block in range(n_blocks):
            start = block * BLOCK * step
            np.matmul(band, padded[start : start + band.shape[1]], out=blocks[block])
        coarse = blocks.reshape(-1, n_rows)[:n_coarse]
        response = _kernel_transform(np.arange(n_kept) * step / length, shape_factor)
        return magnitudes(coarse, np.ones(n_coarse), length // step, n_kept) / response[:, None]
    for between in (4, 3, 2):
        fewer = length // between
        fits = fewer >= LOWEST_OVERSAMPLING * rows.shape[0] and fewer // 2 > n_kept / between + WIDTH + 1
        if length % between == 0 and fits:
            return _interpolate_lines(rows, weights, length // between, between, n_kept)
    lines = fft.rfft(np.ascontiguousarray((rows * weights[:, None]).T), length, axis=1)[:, :n_kept]
    return np.ascontiguousarray(np.abs(lines).T)


def _interpolate_lines(rows: FloatArray, weights: FloatArray, length: int, between: int, n_kept: int) -> FloatArray:
    """Apply steps (2) and (3) of :func:`magnitudes`.

    A transform of ``length``, and ``between`` lines for each of its own.
    """
    from doppelgait.core.kernels.cadence import magnitudes_of_parts

    n_columns, n_rows = rows.shape
    centre, half = n_columns // 2, WIDTH // 2 - 1
    band, shape_factor = _line_band(between, length / n_columns)
    # the kernel needs time 0 in the middle of the record; magnitudes do not care
    sharper = weights / _kernel_transform((np.arange(n_columns) - centre) / length, shape_factor)
    n_blocks = -(-n_kept // (between * BLOCK))
    found = np.empty((n_kept, n_rows))
    n_grid = n_blocks * BLOCK + WIDTH
    for first in range(0, n_rows, GROUP):
        few = slice(first, min(first + GROUP, n_rows))
        size = few.stop - first
        # (2): rows side by side, time 0 in their middle; their transforms take half the time
        circular = _buffer("circular", (size, length))
        np.multiply(rows[centre:, few].T, sharper[centre:], out=circular[:, : n_columns - centre])
        circular[:, n_columns - centre : length - centre] = 0.0
        np.multiply(rows[:centre, few].T, sharper[:centre], out=circular[:, length - centre :])
        lines = _buffer("lines", (size, length // 2 + 1), np.complex128)
        np.fft.rfft(circular, axis=1, out=lines)
        # from line -(W / 2 - 1) on, zero beyond the end; real parts, then imaginary parts: the kernel is real
        kept = lines[:, : n_grid - half].T
        grid = _buffer("grid", (n_grid, 2 * size))
        grid[half : half + kept.shape[0], :size] = kept.real
        grid[half : half + kept.shape[0], size:] = kept.imag
        grid[half + kept.shape[0] :] = 0.0
        np.copyto(grid[:half, :size], kept.real[half:0:-1])
        np.negative(kept.imag[half:0:-1], out=grid[:half, size:])
        # (3): the lines between
        overlapping = np.lib.stride_tricks.as_strided(
            grid, (n_blocks, BLOCK + WIDTH, grid.shape[1]), (BLOCK * grid.strides[0], *grid.strides), writeable=False
        )
        fine = _buffer("fine", (n_blocks, between * BLOCK, grid.shape[1]))
        np.matmul(band, overlapping, out=fine)
        magnitudes_of_parts(fine.reshape(-1, grid.shape[1]), found[:, few])
    return found


def _buffer(name: str, shape: tuple[int, ...], dtype: type = np.float64) -> npt.NDArray[Any]:
    """Return memory of this thread for repeated use.

    The first touch of fresh memory takes longer than the transforms.
    """
    held, size = getattr(_buffers, name, None), math.prod(shape)
    if held is None or held.size < size:
        held = np.empty(size, dtype=dtype)
        setattr(_buffers, name, held)
    return np.asarray(held[:size].reshape(shape))


@lru_cache(maxsize=16)
def _time_band(step: int, oversampling: float) -> tuple[FloatArray, float]:
    """Compute the kernel of BLOCK coarse columns over fine ones.

    It has the shape (BLOCK, step (BLOCK + WIDTH)); its shape factor is returned, too.
    """
    shape_factor = math.pi * WIDTH * (1.0 - 0.5 / oversampling)
    fine = np.arange(step * (BLOCK + WIDTH))
    distance = (fine[None, :] + 1.0) / step - WIDTH / 2 - np.arange(BLOCK)[:, None]
    return _kernel(distance, shape_factor), shape_factor


@lru_cache(maxsize=16)
def _line_band(between: int, oversampling: float) -> tuple[FloatArray, float]:
    """Compute the kernel of fine lines over coarse ones.

    ``between`` BLOCK fine lines, shape (between BLOCK, BLOCK + WIDTH); also returns its shape factor.
    """
    shape_factor = math.pi * WIDTH * (1.0 - 0.5 / oversampling)
    fine = np.arange(between * BLOCK) / between
    coarse = np.arange(BLOCK + WIDTH) - (WIDTH // 2 - 1)
    return _kernel(fine[:, None] - coarse[None, :], shape_factor), shape_factor


def _kernel(distance: FloatArray, shape_factor: float) -> FloatArray:
    """Compute the Kaiser-Bessel kernel within W / 2.

    I_0(b sqrt(1 - (2 s / W)^2)), scaled so that nothing overflows.
    """
    inside = 1.0 - (2.0 * distance / WIDTH) ** 2
    values = np.i0(shape_factor * np.sqrt(np.maximum(inside, 0.0))) * math.exp(-shape_factor)
    return np.where(inside > 0, values, 0.0)


def _kernel_transform(cycles_per_step: FloatArray, shape_factor: float) -> FloatArray:
    """Compute the Fourier transform of the kernel.

    W sinh(r) / r, r^2 = b^2 - (pi W f)^2.
    """
    root = np.sqrt(shape_factor**2 - (math.pi * WIDTH * cycles_per_step) ** 2)
    return np.asarray(WIDTH * np.exp(root - shape_factor) * -np.expm1(-2.0 * root) / (2.0 * root))


MAX_CADENCE_HZ = 20.0
"""Cadences above are dropped: no gait has content there."""
TAPER_FROM_S = 4.0
PADDING = 8
"""Zero padding of the cadence transform: a bin of 1 / T_o alone is coarser than 10 % below five periods (E-30)."""


def observation_s(signature: xr.DataArray) -> float:
    """Compute the observed time T_o of a signature.

    T_o is columns times their spacing.
    """
    return signature.sizes["time"] / sampling_rate_hz(axis(signature, "time"))


def detrend_order(seconds: float) -> int:
    """Compute the order of the detrending polynomial (E-31).

    round(1.2 T_o), 1 to 6.
    """
    return int(np.clip(round(1.2 * seconds), 1, 6))


def detrend(normalised: xr.DataArray, *, order: int) -> xr.DataArray:
    """Remove every Doppler row's least-squares polynomial in time (E-31).

    Order 0 removes the mean.

    Parameters
    ----------
    normalised : DataArray (time, doppler)
        From :func:`doppelgait.processing.normalise.normalise`.
    order : int
        0 or more; 0 is the report's mu_0.
    """
    check_signal(normalised, NORMALISED_SIGNATURE)
    values = normalised.values
    basis = _orthonormal_basis(values.shape[0], order)
    trend = basis @ (basis.T @ values)
    return with_values(normalised, np.subtract(values, trend, out=trend))


@lru_cache(maxsize=4)
def _orthonormal_basis(n_columns: int, order: int) -> npt.NDArray[np.float64]:
    """Compute orthonormal polynomials over the observation.

    The result has the shape (J, order + 1) and is read only.
    """
    basis = np.linalg.qr(np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, n_columns), order))[0]
    basis.flags.writeable = False
    return np.asarray(basis, dtype=np.float64)


def cadence_map(rows: xr.DataArray, *, padded: bool = True, tapered: bool | None = None) -> xr.DataArray:
    """Compute the cadence-velocity diagram D (E-30).

    The magnitude of the Fourier transform of every Doppler row over time.

    Parameters
    ----------
    rows : DataArray (time, doppler)
        Normalised signature (D with its constant column), or detrended (D_0).
    padded : bool
        Zero-pad eightfold; without, the bin is 1 / T_o as in the report.
    tapered : bool, optional
        Hann taper; by default from 4 s on.

    Returns
    -------
    DataArray (cadence, doppler)
        ``D[q,k] = |sum_j a_j v[j,k] e^{-j 2 pi q j / J_fft}| / sum(a)``, cadence 0 to 20 Hz.
    """
    from scipy import fft

    check_signal(rows, NORMALISED_SIGNATURE)
    n_columns = rows.sizes["time"]
    taper = taper_weights(n_columns, observation_s(rows) > TAPER_FROM_S - 1e-9 if tapered is None else tapered)
    length = fft.next_fast_len(PADDING * n_columns, real=True) if padded else n_columns
    cadence_hz = np.arange(length // 2 + 1) * sampling_rate_hz(axis(rows, "time")) / length
    cadence_hz = cadence_hz[: np.searchsorted(cadence_hz, MAX_CADENCE_HZ, side="right")]
    magnitude = magnitudes(rows.values, taper / taper.sum(), length, cadence_hz.size)
    return make_array(CADENCE_MAP, magnitude, {"cadence": cadence_hz}, like=rows)


def taper_weights(n_columns: int, tapered: bool) -> npt.NDArray[np.float64]:
    """Compute the Hann taper without zero ends, or ones.

    The result has the shape (J,).
    """
    if not tapered:
        return np.ones(n_columns)
    return np.asarray(0.5 - 0.5 * np.cos(2.0 * np.pi * (np.arange(n_columns) + 1) / (n_columns + 1)))


def mean_doppler_spectrum(normalised: xr.DataArray) -> npt.NDArray[np.float64]:
    """Average every Doppler row over time (E-30).

    D_1, the constant column of the cadence-velocity diagram, shape (K,).
    """
    check_signal(normalised, NORMALISED_SIGNATURE)
    return np.asarray(normalised.values.mean(axis=0))


def cadence_spectrum(step_doppler: xr.DataArray, *, power: bool = True) -> xr.DataArray:
    """Sum the cadence-velocity diagram over Doppler.

    Parameters
    ----------
    step_doppler : DataArray (cadence, doppler)
    power : bool
        True: S[q] = sum D^2, in which noise rows weigh less (E-32). False: the report's D_g = sum D.

    Returns
    -------
    DataArray (cadence)
    """
    check_signal(step_doppler, CADENCE_MAP)
    values = step_doppler.values
    summed = np.einsum("qk,qk->q", values, values) if power else values.sum(axis=1)
    return make_array(CADENCE_SPECTRUM, summed, {}, like=step_doppler)
