"""Limb rows of Doppler relative to the torso (E-33).

The limb rows contain the steps and exclude the sway of the body.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from doppelgait._core import native
from doppelgait.core.labels import Signal, sampling_rate_hz
from doppelgait.core.straight import make_orthonormal_basis
from doppelgait.core.units import FloatArray
from doppelgait.features.doppler import compute_quantile

TORSO_BAND_HZ = 40.0
"""Half width of the band around the main line in which the torso line is the centroid of the cells."""
TORSO_SMOOTHING_S = 0.06  # standard deviation of the Gaussian that smooths the torso line
TORSO_WIDTH_HZ = 30.0
"""Half width of the torso's band around the torso line; a single line has 14 Hz (E-35), swinging hips more."""
COLUMN_RATE_HZ = 40.0
"""Lowest rate of averaged columns; a signature with T_d = 0.1 s contains no modulation above 15 Hz."""
ROW_WIDTH_HZ = 16.0
CLIPPED_MEAN, CLIPPED_SD = 0.399, 0.584
"""Mean and standard deviation of max(x, 0) for a standard normal x: noise that is clipped at the floor."""
OCCUPIED_SIGMAS = 3.0
INDEPENDENT_AFTER_S = 0.06


@dataclass(frozen=True)
class Rows:
    """Doppler rows over time, without labels. Shapes: values (J, K); doppler_hz (K,)."""

    values: FloatArray
    doppler_hz: FloatArray
    rate_hz: float

    @property
    def bin_hz(self) -> float:
        """Spacing of the rows."""
        return float(self.doppler_hz[1] - self.doppler_hz[0])


def average_columns(normalised: Signal) -> Rows:
    """Average groups of columns of a normalised signature."""
    # the result has at least 40 columns per second
    rate_hz = sampling_rate_hz(normalised.axis("time"))
    group = group_size(rate_hz)
    return Rows(sum_groups(normalised.values, group) / group, normalised.axis("doppler"), rate_hz / group)


def group_size(rate_hz: float) -> int:
    """Return the columns per group of :func:`average_columns`."""
    return max(1, int(rate_hz / COLUMN_RATE_HZ))


def sum_groups(values: FloatArray, n_columns: int, n_rows: int = 1) -> FloatArray:
    """Sum groups of columns and of rows. Incomplete groups at the end are dropped."""
    found = np.empty((values.shape[0] // n_columns, values.shape[1] // n_rows))
    native.sum_groups(values, n_columns, n_rows, found)
    return found


def torso_line_hz(rows: Rows) -> FloatArray:
    """Smooth the centroid of squared power around the main line, by column (E-33 step 4)."""
    reach, line = min(int(TORSO_BAND_HZ / rows.bin_hz), (rows.doppler_hz.size - 1) // 2), np.empty(len(rows.values))
    middle, centroid = find_torso(rows.values, reach)
    native.smooth(centroid, TORSO_SMOOTHING_S * rows.rate_hz, True, line)
    line *= rows.bin_hz
    line += rows.doppler_hz[middle]
    return line


def find_torso(values: FloatArray, reach: int) -> tuple[int, FloatArray]:
    """Find the median peak, and the centroid of the squared power around it (J,)."""
    peaks, distance = values.argmax(axis=1).astype(np.float64), np.arange(-reach, reach + 1)
    middle = int(compute_quantile(peaks, 0.5))
    square = values.take((middle + distance) % values.shape[1], axis=1) ** 2
    total = square.sum(axis=1)
    return middle, np.divide(square @ distance, total, out=np.zeros(total.size), where=total > 0.0)


def limb_rows(rows: Rows, noise: FloatArray, torso_hz: FloatArray) -> Rows:
    """Extract noise-free amplitudes beyond 30 Hz of the torso's line. Shapes: noise, torso_hz (J,)."""
    zero, bin_hz = int(np.abs(rows.doppler_hz).argmin()), rows.bin_hz
    moved = np.empty(rows.values.shape)
    native.shift_columns(rows.values, torso_hz / bin_hz, moved)
    # rows above the noise, as in E-38, for cells that were clipped at the floor
    independent = max(1.0, noise.size / rows.rate_hz / INDEPENDENT_AFTER_S)
    spread = CLIPPED_SD * math.sqrt(float(noise @ noise) / noise.size / independent)
    starts, stops, centre_hz = _make_limb_groups(rows.doppler_hz.size, zero, float(rows.doppler_hz[zero]), bin_hz)
    amplitude = np.empty((noise.size, starts.size))
    mean = CLIPPED_MEAN * (float(noise.sum()) / noise.size)
    native.limb_amplitudes(moved, noise, mean, OCCUPIED_SIGMAS * spread, starts, stops, amplitude)
    return Rows(amplitude, centre_hz, rows.rate_hz)


@lru_cache(maxsize=8)
def _make_limb_groups(
    n_rows: int, zero: int, zero_hz: float, bin_hz: float
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], FloatArray]:
    # Returns the first row of each group, one past its last row, and the Doppler of its middle
    torso, size = int(TORSO_WIDTH_HZ / bin_hz), _group_rows(bin_hz)
    starts, stops = [], []
    for first, stop in ((0, max(zero - torso, 0)), (min(zero + torso + 1, n_rows), n_rows)):
        some = min(size, max(stop - first, 1))
        starts.append(first + some * np.arange((stop - first) // some))
        stops.append(starts[-1] + some)
    low, high = np.concatenate(starts), np.concatenate(stops)
    return low, high, zero_hz + bin_hz * ((low + high - 1) / 2.0 - zero)


def _group_rows(bin_hz: float) -> int:
    return max(1, round(ROW_WIDTH_HZ / bin_hz))


def sum_rows(rows: Rows) -> FloatArray:
    """Sum neighbouring rows to about 16 Hz each."""
    return sum_groups(rows.values, 1, min(_group_rows(rows.bin_hz), max(rows.values.shape[1], 1)))


def detrend_rows(values: FloatArray, rate_hz: float, counted: npt.NDArray[np.bool_]) -> FloatArray:
    """Remove every row's least-squares polynomial (E-31); columns that do not count are 0."""
    # the order is round(1.2 T_o), 1 to 6; the values of counted columns are overwritten
    if values.shape[0] < counted.size:
        values, compact = np.zeros((counted.size, values.shape[1])), values
        values[counted] = compact
    order = min(max(round(1.2 * counted.size / rate_hz), 1), 6)
    basis = make_orthonormal_basis(counted.size, order, counted.tobytes())
    native.remove_trend(values, basis)
    return values
