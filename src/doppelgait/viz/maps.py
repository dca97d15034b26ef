"""Maps in decibels: levels, limits and axes."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import Any, TypedDict

import numpy as np
import numpy.typing as npt
import xarray as xr
from matplotlib import colormaps, rcParams, rcParamsDefault
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure

from doppelgait.core.errors import AnalysisError
from doppelgait.core.labels import NORMALISED_SIGNATURE, SIGNATURE, Schema, check_signal
from doppelgait.core.units import FloatArray, doppler_to_velocity_mps, power_to_db, velocity_to_doppler_hz
from doppelgait.viz import style

NO_DATA = "#bdbdbd"
AUTO_DB_RANGE = (20.0, 40.0)
"""Smallest and largest dynamic range of a map if the caller sets none."""


def check_array(array: Any, schema: Schema) -> xr.DataArray:
    """Return ``array`` if it has values and conforms to ``schema``."""
    if hasattr(array, schema.name) and not isinstance(array, xr.DataArray):
        kind = type(array).__name__
        raise AnalysisError(f"{schema.name}: {kind} is not allowed; give the {schema.name} of this {kind}")
    if check_signal(array, schema).size == 0:
        raise AnalysisError(f"{schema.name}: nothing to plot, its shape is {array.shape}")
    return array  # type: ignore[no-any-return]


def check_signature(array: xr.DataArray) -> xr.DataArray:
    """Check a signature, raw (V^2) or normalised (1)."""
    raw = getattr(array, "attrs", {}).get("units") == SIGNATURE.units
    return check_array(array, SIGNATURE if raw else replace(NORMALISED_SIGNATURE, name=SIGNATURE.name))


def check_wavelength(wavelength_m: float) -> None:
    """Check that a wavelength is positive and finite."""
    if not (np.isfinite(wavelength_m) and wavelength_m > 0):
        raise AnalysisError(f"wavelength_m is {wavelength_m}; it must be positive")


def check_db_range(db_range: float) -> float:
    """Check that a dynamic range is positive and finite."""
    if not (isinstance(db_range, int | float | np.number) and 0 < db_range < math.inf):
        raise AnalysisError(f"db_range is {db_range}; the dynamic range must be a positive number of dB")
    return float(db_range)


def compute_level_db(power: npt.ArrayLike) -> FloatArray:
    """Convert powers to dB; 0 or less, without a floor, gives -inf."""
    return np.asarray(power_to_db(np.maximum(np.asarray(power, dtype=np.float64), 0.0)), dtype=np.float64)


def amplitude_to_db(amplitude: npt.ArrayLike) -> FloatArray:
    """Convert magnitudes to dB; 0 gives -inf without a warning."""
    return 2.0 * compute_level_db(np.abs(np.asarray(amplitude)))


def level_limits_db(level_db: FloatArray, db_range: float | tuple[float, float] | None) -> tuple[float, float]:
    """Return the lower and upper end of the colour scale."""
    if isinstance(db_range, tuple):
        if len(db_range) != 2 or not db_range[0] < db_range[1]:
            raise AnalysisError(f"db_range is {db_range}; two limits in dB must rise, as (-75, -45)")
        return db_range
    finite = level_db[np.isfinite(level_db)]
    top = float(finite.max()) if finite.size else 0.0
    if db_range is not None:
        return top - check_db_range(db_range), top
    noise = float(np.median(finite)) - 3.0 if finite.size else -np.inf
    return top - float(np.clip(top - noise, *AUTO_DB_RANGE)), top


def wavelength_m(array: xr.DataArray) -> float:
    """Return an array's wavelength, 2 v / f_d."""
    doppler_hz = array.coords["doppler"].values
    furthest = int(np.abs(doppler_hz).argmax())
    if doppler_hz[furthest] == 0:
        raise AnalysisError(f"{array.name}: the Doppler axis has only 0 Hz, so the wavelength cannot be computed")
    return float(2.0 * array.coords["velocity"].values[furthest] / doppler_hz[furthest])


ROWS_AT_ONCE = 16
"""Number of Doppler rows that are processed together."""


def occupied_rows(power: FloatArray) -> npt.NDArray[np.bool_]:
    """Select three or more adjacent Doppler rows above the noise."""
    occupied = np.zeros(power.shape[1], dtype=bool)
    means, peaks = np.empty((2, power.shape[1]))
    for first in range(0, power.shape[1], ROWS_AT_ONCE):  # the map of a long recording needs 100 MB
        part = slice(first, first + ROWS_AT_ONCE)
        known = np.maximum(np.nan_to_num(np.asarray(power[:, part], dtype=np.float64)), 0.0)
        means[part], peaks[part] = known.mean(axis=0), np.quantile(known, 0.97, axis=0, overwrite_input=True)
    for rows in (means, peaks):
        level_db = compute_level_db(np.maximum(rows, 1e-9 * rows.max()))
        quiet, floor = (float(np.quantile(level_db, share, method="lower")) for share in (0.02, 0.2))
        threshold = max(floor + max(3.0, 2.5 * (floor - quiet)), float(level_db.max()) - 40.0)
        occupied |= level_db > threshold
    padded: npt.NDArray[np.bool_] = np.pad(occupied, 2)
    runs = padded[:-2] & padded[1:-1] & padded[2:]
    return runs[:-2] | runs[1:-1] | runs[2:]


def doppler_limits_hz(array: xr.DataArray, *, lines_hz: npt.ArrayLike = ()) -> tuple[float, float]:
    """Return the occupied part of the Doppler axis with marked lines, 0 Hz and a margin."""
    doppler_hz = np.asarray(array.coords["doppler"].values, dtype=np.float64)
    whole = float(doppler_hz.min()), float(doppler_hz.max())
    lines = np.asarray(lines_hz, dtype=np.float64).ravel()
    rows_hz = doppler_hz[occupied_rows(array.values)]
    shown = np.concatenate([rows_hz, lines[np.isfinite(lines)], [0.0]])
    margin = 0.1 * float(np.ptp(shown)) + 2.0 * (whole[1] - whole[0]) / doppler_hz.size
    low, high = float(shown.min()) - margin, float(shown.max()) + margin
    if not rows_hz.size or high - low > 0.7 * (whole[1] - whole[0]):
        return whole
    return max(low, whole[0]), min(high, whole[1])


def compute_cell_edges(axis: npt.ArrayLike) -> tuple[float, float] | None:
    """Return cell edges of a uniform axis."""
    values = np.asarray(axis, dtype=np.float64)
    if values.size == 1:
        return float(values[0]) - 0.5, float(values[0]) + 0.5
    steps = np.diff(values)
    if not np.allclose(steps, steps.mean(), rtol=1e-3, atol=0.0):
        return None
    half = float(steps.mean()) / 2.0
    return float(values[0]) - half, float(values[-1]) + half


def plot_map(
    axes: Axes,
    x: npt.ArrayLike,
    y: npt.ArrayLike,
    level_db: FloatArray,
    db_range: tuple[float, float] | float | None,
    cmap: str | None = None,
    colours: str = style.MAP_COLOURS,
) -> ScalarMappable:
    """Plot levels of shape (y, x), clipped to limits or to a dynamic range."""
    limits_db = level_limits_db(level_db, db_range)
    clipped = np.clip(level_db, *limits_db)
    of_user, usual = rcParams["image.cmap"], rcParamsDefault["image.cmap"]
    chosen = cmap or (colours if of_user == usual else of_user)
    if isinstance(chosen, str) and chosen not in colormaps:
        raise AnalysisError(f"cmap = {chosen!r}: Matplotlib has no such colour map, such as magma")
    palette = colormaps.get_cmap(chosen).with_extremes(bad=NO_DATA)
    settings: dict[str, Any] = {"cmap": palette, "vmin": limits_db[0], "vmax": limits_db[1]}
    x_edges, y_edges = compute_cell_edges(x), compute_cell_edges(y)
    if x_edges and y_edges:
        return axes.imshow(clipped, origin="lower", aspect="auto", extent=(*x_edges, *y_edges), **settings)
    return axes.pcolormesh(x, y, clipped, shading="nearest", **settings)


class Shown(TypedDict, total=False):
    """Parts of a figure that may be left out."""

    colorbar: bool
    velocity_axis: bool
    legend: bool


def finish_axes(
    axes: Axes,
    ax: Axes | None,
    title: str,
    x: str,
    y: str,
    *,
    image: ScalarMappable | None = None,
    quantity: str = "power",
    reference: str = "",
    wavelength_m: float | None = None,
    above: bool = False,
    colorbar: bool = True,
    velocity_axis: bool = True,
    legend: bool = True,
    velocity_label: str = style.VELOCITY_LABEL,
) -> Figure:
    """Name axes and add velocity axis, colour bar and legend; ``ax`` are those of the user."""
    style.name_axes(axes, title=title, x=x, y=y)
    if image is None:
        style.draw_grid(axes)
    if wavelength_m is not None and velocity_axis:
        add_velocity_axis(axes, wavelength_m, velocity_label, above=above)
    if image is not None and colorbar:
        add_colour_bar(image, axes, quantity=quantity, reference=reference)
    if legend:
        style.place_legend(axes, "figure" if ax is None else "inside")
    style.fit_labels(axes)
    return style.make_axes(axes)[0]


def add_colour_bar(image: ScalarMappable, *axes: Axes, quantity: str, reference: str = "") -> None:
    """Add a colour bar with quantity, level and range."""
    low, high = image.get_clim()
    bar = axes[0].figure.colorbar(image, ax=list(axes), pad=0.02, fraction=0.06, aspect=28)
    words = f"{quantity} (dB re {reference})" if reference else f"normalised {quantity} (dB)"
    bar.set_label(f"{words}, {high - low:.0f} dB shown")
    style.fit_labels(bar.ax)


def add_velocity_axis(axes: Axes, wavelength: float, label: str = style.VELOCITY_LABEL, *, above: bool = False) -> None:
    """Add a second axis in m/s, f lambda / 2."""
    check_wavelength(wavelength)
    turns = doppler_to_velocity_mps, velocity_to_doppler_hz
    both: Any = tuple(partial(turn, wavelength_m=wavelength) for turn in turns)
    if above:
        axes.secondary_xaxis("top", functions=both).set_xlabel(label)
    else:
        axes.secondary_yaxis("right", functions=both).set_ylabel(label)
