"""Doppler rows of the limbs relative to the torso (E-33 step 4).

Steps show in them, and the body's sway does not.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.core.labels import NORMALISED_SIGNATURE, Plain, axis, check_signal, sampling_rate_hz

FloatArray = npt.NDArray[np.float64]

TORSO_BAND_HZ = 40.0
"""The torso line is the centroid of the cells within this of the main line."""
TORSO_SMOOTHING_S = 0.06
"""Standard deviation of the Gaussian that smooths the torso line."""
TORSO_WIDTH_HZ = 30.0
"""Rows nearer to the torso line than this show the torso: a single line is 14 Hz wide (E-35), swinging hips more."""
COLUMN_RATE_HZ = 40.0
"""Columns are averaged down to no less than this rate: a signature of T_d = 0.1 s holds nothing above 15 Hz."""
ROW_WIDTH_HZ = 16.0
CLIPPED_MEAN, CLIPPED_SD = 0.399, 0.584
"""Mean and standard deviation of max(x, 0) for a standard normal x: what noise leaves above the floor."""
OCCUPIED_SIGMAS = 3.0
INDEPENDENT_AFTER_S = 0.06


@dataclass(frozen=True)
class Rows:
    """Doppler rows over time, as plain numbers.

    Parameters
    ----------
    values : ndarray, shape (J, K)
    doppler_hz : ndarray, shape (K,)
    rate_hz : float
        Columns per second.
    """

    values: FloatArray
    doppler_hz: FloatArray
    rate_hz: float

    @property
    def bin_hz(self) -> float:
        """Spacing of the rows."""
        return float(self.doppler_hz[1] - self.doppler_hz[0])


def slowed(normalised: xr.DataArray | Plain) -> Rows:
    """Average columns of a normalised signature in groups.

    No less than 40 columns a second remain.
    """
    check_signal(normalised, NORMALISED_SIGNATURE)
    rate_hz = sampling_rate_hz(axis(normalised, "time"))
    group = group_size(rate_hz)
    return Rows(grouped(normalised.values, group) / group, axis(normalised, "doppler"), rate_hz / group)


def group_size(rate_hz: float) -> int:
    """Return the number of columns in one group of :func:`slowed`."""
    return max(1, int(rate_hz / COLUMN_RATE_HZ))


def grouped(values: FloatArray, size: int) -> FloatArray:
    """Sum groups along the first axis.

    An incomplete last group is dropped.
    """
    stop = values.shape[0] // size * size
    total = values[0:stop:size].copy()
    for first in range(1, size):  # strided views added up: faster than a sum over an axis of three
        total += values[first:stop:size]
    return total


def torso_line_hz(rows: Rows) -> FloatArray:
    """Follow the Doppler of the torso (E-33 step 4).

    In every column it is the power-squared centroid about the main line, smoothed.

    Parameters
    ----------
    rows : Rows
        Normalised signature without drift of its main line.

    Returns
    -------
    ndarray, shape (J,)
        ``t[j] = sum F u^2 / sum u^2`` over the cells within 40 Hz of the median column peak, circular in Doppler, then
        a Gaussian of 60 ms standard deviation. A column without power there has the median.
    """
    from scipy.ndimage import gaussian_filter1d

    middle = int(np.median(rows.values.argmax(axis=1)))
    reach = min(int(TORSO_BAND_HZ / rows.bin_hz), (rows.doppler_hz.size - 1) // 2)
    offset = np.arange(-reach, reach + 1)
    power = rows.values.take(middle + offset, axis=1, mode="wrap") ** 2
    total = power.sum(axis=1)
    centroid_hz = np.divide(power @ (offset * rows.bin_hz), total, out=np.zeros(total.size), where=total > 0)
    return np.asarray(rows.doppler_hz[middle] + gaussian_filter1d(centroid_hz, TORSO_SMOOTHING_S * rows.rate_hz))


def limb_rows(rows: Rows, noise: FloatArray) -> Rows:
    """Extract the rows beyond 30 Hz of the torso line.

    They are cleaned of noise, in amplitude, and detrended; Doppler is relative to the torso.

    Parameters
    ----------
    rows : Rows
        Normalised signature without drift of its main line.
    noise : ndarray, shape (J,)
        Standard deviation of the noise in one cell of each column, in the units of ``rows``.

    Returns
    -------
    Rows
        Every column shifted by its torso line; one standard deviation of noise subtracted from every cell; rows whose
        mean does not stand 3 standard deviations above what noise leaves are 0; neighbours summed to 16 Hz; square
        root, so that the weak echoes of fast limbs count next to the strong ones of slow ones.
    """
    from doppelgait.core.kernels.features import shift_columns
    from doppelgait.core.kernels.periodicity import limb_amplitudes

    zero, bin_hz = int(np.abs(rows.doppler_hz).argmin()), rows.bin_hz
    shift = torso_line_hz(rows) / bin_hz
    whole = np.floor(shift)
    moved = np.empty(rows.values.shape)
    shift_columns(
        np.ascontiguousarray(rows.values), whole.astype(np.int64) % rows.doppler_hz.size, shift - whole, moved
    )
    # rows that stand above the noise: as E-38, for cells that were clipped at the floor
    independent = max(1.0, noise.size / rows.rate_hz / INDEPENDENT_AFTER_S)
    spread = CLIPPED_SD * float(np.sqrt((noise**2).mean() / independent))
    occupied = np.asarray(moved.mean(axis=0) - CLIPPED_MEAN * noise.mean() > OCCUPIED_SIGMAS * spread)
    torso = int(TORSO_WIDTH_HZ / bin_hz)
    below = _groups(0, max(zero - torso, 0), bin_hz)
    above = _groups(min(zero + torso + 1, rows.doppler_hz.size), rows.doppler_hz.size, bin_hz)
    starts, stops = np.concatenate([below[0], above[0]]), np.concatenate([below[1], above[1]])
    amplitude = np.empty((noise.size, starts.size))
    limb_amplitudes(moved, occupied, noise, starts, stops, amplitude)
    centre_hz = (rows.doppler_hz[starts] + rows.doppler_hz[stops - 1]) / 2.0
    return Rows(detrended(amplitude, rows.rate_hz), centre_hz, rows.rate_hz)


def _groups(first: int, stop: int, bin_hz: float) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return the limits of groups of about 16 Hz.

    First row of every group and one past its last; an incomplete group is dropped.
    """
    size = min(_group_rows(bin_hz), max(stop - first, 1))
    starts = first + size * np.arange((stop - first) // size)
    return starts, starts + size


def _group_rows(bin_hz: float) -> int:
    return max(1, round(ROW_WIDTH_HZ / bin_hz))


def summed_rows(rows: Rows, bin_hz: float) -> Rows:
    """Sum neighbouring rows to about 16 Hz each."""
    size = min(_group_rows(bin_hz), max(rows.values.shape[1], 1))
    values = np.ascontiguousarray(grouped(rows.values.T, size).T)
    return Rows(values, grouped(rows.doppler_hz, size) / size, rows.rate_hz)


def detrended(values: FloatArray, rate_hz: float) -> FloatArray:
    """Remove every row's least-squares polynomial (E-31).

    The order is round(1.2 T_o), 1 to 6.
    """
    order = int(np.clip(round(1.2 * values.shape[0] / rate_hz), 1, 6))
    basis = _orthonormal_basis(values.shape[0], order)
    return np.asarray(values - basis @ (basis.T @ values))


@lru_cache(maxsize=4)
def _orthonormal_basis(n_columns: int, order: int) -> FloatArray:
    """Compute orthonormal polynomials over the observation.

    The result has the shape (J, order + 1) and is read only.
    """
    basis = np.linalg.qr(np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, n_columns), order))[0]
    basis.flags.writeable = False
    return np.asarray(basis, dtype=np.float64)
