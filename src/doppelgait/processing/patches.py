"""Signatures of any radar as comparable images, in dB over the noise floor, on a fixed grid of velocities."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt
from pydantic import Field

from doppelgait.core.config import FrozenModel
from doppelgait.core.errors import AnalysisError
from doppelgait.core.labels import read_axis
from doppelgait.core.lazy import xr
from doppelgait.core.units import FloatArray, decimal_logarithm

Levels = npt.NDArray[np.float32]

N_SLICES, N_COLUMNS, N_CELLS, MOST_PICTURES = 11, 32, 64, 64  # of a target: ranges, times and velocities of a picture
RANGE_DB = 45.0  # levels below the strongest cell of a target that its pictures show
QUIET_SHARE = 1.0 / 3.0
"""Share of the Doppler rows that give the noise floor: the rows with the least power."""


class Patch(FrozenModel):
    """Format of the input image of a neural network.

    velocity_mps: The rows cover radial velocities from minus to plus this value. 6.4 m/s includes
        the feet of a running person and most of those of a galloping dog.
    n_velocity: Number of rows; 64 rows of 0.2 m/s match the resolution of T_d = 0.1 s at 7.29 GHz.
    column_s: Time from column to column; 1/32 s represents cadences up to 16 Hz.
    n_time: Number of columns.
    range_db: Dynamic range that is mapped to 0 to 1. It starts at the noise floor, or at the peak
        minus this value if that is higher.
    """

    velocity_mps: float = Field(default=6.4, gt=0, le=100)
    n_velocity: int = Field(default=64, ge=16, le=1024, multiple_of=16)
    column_s: float = Field(default=1.0 / 32.0, gt=0, le=10)
    n_time: int = Field(default=64, ge=16, le=4096, multiple_of=16)
    range_db: float = Field(default=40.0, gt=0, le=120)

    @property
    def edges_mps(self) -> FloatArray:
        """Edges of the rows, shape (n_velocity + 1,)."""
        return np.linspace(-self.velocity_mps, self.velocity_mps, self.n_velocity + 1)


def patch(signature: xr.DataArray, spec: Patch | None = None) -> Levels:
    """Convert the middle of a signature to one image.

    Parameters
    ----------
    signature : DataArray (time, doppler)
        Power in any linear unit, with the coordinate ``velocity`` (m/s, approaching positive) along
        ``doppler``. It can be from :func:`doppelgait.analyze`, from a dataset, or from
        :func:`doppelgait.pipeline.spectrogram.convert_levels_to_signature`.
    spec : Patch, optional

    Returns
    -------
    ndarray of float32, shape (n_velocity, n_time)
        See :func:`levels`; a shorter signature is centred and padded with 0 (the noise floor).

    Raises
    ------
    AnalysisError
        If it is no signature with evenly spaced axes and known velocities.

    Examples
    --------
    >>> import doppelgait as dg
    >>> recording = dg.data.sample()
    >>> result = dg.analyze(recording, gate="truth")[0]
    >>> image = dg.classify.patch(result.signature)
    >>> image.shape, round(float(image.max()), 1)
    ((64, 64), 0.7)
    """
    spec = spec or Patch()
    whole = levels(signature, spec)
    return cut(whole, (whole.shape[1] - spec.n_time) // 2, spec)


def levels(signature: xr.DataArray, spec: Patch | None = None) -> Levels:
    """Convert a whole signature to levels on an image grid.

    The power is averaged over cells of velocity and time, so that finer or coarser axes, other
    pulse rates and other carriers give the same image. It is then converted to dB, relative to the
    noise floor or to ``range_db`` below the peak, whichever is higher, and divided by ``range_db``.
    The noise floor is the mean power of the third of the Doppler rows with the least power, without
    rows that are 0. The peak is the median over time of the strongest cell. The image does not
    depend on the gain.

    Parameters
    ----------
    signature : DataArray (time, doppler)
    spec : Patch, optional

    Returns
    -------
    ndarray of float32, shape (n_velocity, J)
        0 at the floor and at velocities that the radar cannot measure, 1 from ``range_db`` above the floor on.

    Raises
    ------
    AnalysisError
        As :func:`patch`.
    """
    spec = spec or Patch()
    if not isinstance(signature, xr.DataArray) or signature.dims != ("time", "doppler"):
        raise AnalysisError("a patch needs a signature: a DataArray with the dimensions (time, doppler)")
    if "velocity" not in signature.coords or "time" not in signature.coords:
        raise AnalysisError("a patch needs the coordinates time and velocity of its signature")
    power = np.asarray(signature.values, dtype=np.float64)
    times_s, rows_mps = (np.asarray(read_axis(signature, name), dtype=np.float64) for name in ("time", "velocity"))
    for name, values in (("time", times_s), ("velocity", rows_mps)):
        steps = np.diff(values)
        if values.size < 2 or not (np.isfinite(values).all() and steps.min() > 0):
            raise AnalysisError(f"a patch needs a {name} axis of two rising values or more; the carrier must be known")
        if steps.max() > 1.05 * steps.min():
            raise AnalysisError(
                f"a patch needs an evenly spaced {name} axis; its steps are {steps.min():.4g} to {steps.max():.4g}"
            )
    if not np.isfinite(power).all() or power.min() < 0:
        raise AnalysisError("a patch needs finite power of 0 or more in every cell; convert levels in dB to power")
    # Mean power of the rows with the least power, without rows that are 0.
    rows = np.sort(power.mean(axis=0))
    rows = rows[rows > 0]
    floor = float(rows[: max(1, int(QUIET_SHARE * rows.size))].mean()) if rows.size else 0.0
    over_velocity = _average(power, rows_mps, spec.edges_mps)
    column_s = float(times_s[-1] - times_s[0]) / (times_s.size - 1)
    begin_s = float(times_s[0]) - column_s / 2.0
    count = max(1, int(times_s.size * column_s / spec.column_s + 1e-6))
    edges_s: FloatArray = np.asarray(begin_s + spec.column_s * np.arange(count + 1), dtype=np.float64)
    cells = _average(over_velocity.T, times_s, edges_s)
    known = np.nan_to_num(cells)
    peak = float(np.median(known.max(axis=0)))
    lowest = max(floor, peak * 10.0 ** (-spec.range_db / 10.0))
    if not lowest > 0:
        return np.zeros(known.shape, dtype=np.float32)
    with np.errstate(divide="ignore"):
        level_db = 10.0 * decimal_logarithm(known / lowest)
    return np.asarray(np.clip(level_db / spec.range_db, 0.0, 1.0), dtype=np.float32)


def levels_of(signature: xr.DataArray | None, spec: Patch) -> Levels | None:
    """Return the levels of a signature, or None below two columns."""
    return None if signature is None or signature.sizes["time"] < 2 else levels(signature, spec)


def cut(whole: Levels, start: int, spec: Patch) -> Levels:
    """Select ``n_time`` columns from ``start`` on, padded with 0."""
    picture = np.zeros((spec.n_velocity, spec.n_time), dtype=np.float32)
    first, stop = max(start, 0), min(start + spec.n_time, whole.shape[1])
    if stop > first:
        picture[:, first - start : stop - start] = whole[:, first:stop]
    return picture


def draw_pictures(slices: FloatArray | Levels, approach_mps: FloatArray) -> Levels:
    """Draw the power of a target in dB, ahead upwards. Shapes: returns (pictures, slices, columns, cells)."""
    first = (N_SLICES - len(slices)) // 2  # without range, the middle one is all there is
    spare, top = max(slices.shape[1] - N_COLUMNS, 0), max(float(slices.max()), 1e-30)
    pictures = []
    for start in np.linspace(0, spare, min(1 + 2 * spare // N_COLUMNS, MOST_PICTURES)).astype(np.int64):
        columns = slice(start, start + N_COLUMNS)  # half of the next picture, or less
        level_db = 10.0 * decimal_logarithm(np.maximum(slices[:, columns] / top, 1e-30))
        own = np.maximum(1.0 + level_db / RANGE_DB, 0.0)[:, :, :: -1 if approach_mps[columns].sum() < 0.0 else 1]
        pictures.append(np.zeros((N_SLICES, N_COLUMNS, N_CELLS), dtype=np.float32))
        pictures[-1][first : first + len(slices), : own.shape[1]] = own
    return np.stack(pictures)


def convolve_and_pool(layer: npt.NDArray[Any], kernel: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Convolve images with 3 x 3 kernels, then take maxima of 2 x 2."""
    padded = np.pad(layer, ((0, 0), (0, 0), (1, 1), (1, 1)))
    windows = np.lib.stride_tricks.sliding_window_view(padded, (3, 3), axis=(2, 3))
    layer = np.moveaxis(np.tensordot(windows, kernel, axes=((1, 4, 5), (1, 2, 3))), -1, 1)
    n, channels, height, width = layer.shape
    return np.asarray(layer.reshape(n, channels, height // 2, 2, width // 2, 2).max(axis=(3, 5)))


def compute_layers(layer: Levels, layers: Iterable[tuple[Levels, Levels, Levels]]) -> Levels:
    """Compute the convolutional layers of a network: kernels, scales and biases of each."""
    for kernel, scale, bias in layers:
        layer = convolve_and_pool(layer, kernel)
        layer = np.maximum(layer * scale[:, None, None] + bias[:, None, None], 0.0)
    return layer


def _average(values: FloatArray, centres: FloatArray, edges: FloatArray) -> FloatArray:
    """Average along the last axis between edges, NaN where there are no cells."""
    # the values belong to cells around evenly spaced centres
    width = float(centres[-1] - centres[0]) / (centres.size - 1)
    place = np.clip((edges - centres[0]) / width + 0.5, 0.0, float(centres.size))  # in cells from the first one's edge
    summed = np.concatenate([np.zeros((*values.shape[:-1], 1)), np.cumsum(values, axis=-1)], axis=-1)
    below = np.minimum(place.astype(np.int64), centres.size - 1)
    total = summed[..., below] + (place - below) * values[..., below]
    covered = np.diff(place)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.where(covered > 1e-9, np.diff(total, axis=-1) / covered, np.nan))
