"""Cadence map, cadence spectrum and mean Doppler spectrum."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Unpack

import numpy as np
import numpy.typing as npt
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from doppelgait.core.errors import AnalysisError
from doppelgait.core.labels import CADENCE_MAP, CADENCE_SPECTRUM
from doppelgait.core.units import FloatArray, power_to_db
from doppelgait.viz import style
from doppelgait.viz.maps import (
    Shown,
    amplitude_to_db,
    check_array,
    check_db_range,
    compute_level_db,
    doppler_limits_hz,
    finish_axes,
    plot_map,
    wavelength_m,
)


def cadence_spectrum(
    spectrum: xr.DataArray,
    *,
    gait_frequency_hz: float | None = None,
    harmonics_hz: Sequence[float | None] = (),
    max_cadence_hz: float | None = None,
    db_range: float = 40.0,
    amplitude: bool = False,
    doubtful: bool = False,
    title: str = "Cadence spectrum",
    ax: Axes | None = None,
    **shown: Unpack[Shown],
) -> Figure:
    """Plot a cadence spectrum in dB below its peak.

    Gait frequency and harmonics are marked (the report's Fig. 4.13).

    Parameters
    ----------
    spectrum : DataArray (cadence)
        Power sum S, or the report's amplitude sum D_g with ``amplitude=True``.
    gait_frequency_hz : float, optional
        f_mu.
    harmonics_hz : sequence of float or None
        Measured second, third, ... harmonic; None for a harmonic that was not found.
    max_cadence_hz : float, optional
        Right end of the cadence axis; by default 8 to 20 Hz, to show three harmonics.
    db_range : float
        Range of the level axis, dB.
    amplitude : bool
        True if the values are amplitudes (20 log10), False if they are powers (10 log10).
    doubtful : bool
        True if the frequencies have low confidence; they are then shown with a question mark.
    **shown : bool
        ``legend``, False to leave it out.

    Raises
    ------
    AnalysisError
        If the array does not conform to its schema or has no cadence below ``max_cadence_hz``.

    Examples
    --------
    >>> import doppelgait as dg
    >>> recording = dg.data.sample()
    >>> result = dg.analyze(recording, gate="truth")[0]
    >>> figure = dg.viz.cadence_map(result.cadence_map, cmap="gray")
    >>> figure = dg.viz.cadence_spectrum(result.cadence_spectrum)
    >>> figure.axes[0].get_title(loc="left"), figure.axes[0].get_xlabel()
    ('Cadence spectrum', 'cadence (Hz)')
    """
    axes = style.make_axes(ax, height_in=4.6)[1]
    cropped = _crop(check_array(spectrum, CADENCE_SPECTRUM), max_cadence_hz, gait_frequency_hz)
    cadence_hz = cropped.coords["cadence"].values
    power = np.asarray(cropped.values, dtype=np.float64) ** (2 if amplitude else 1)
    level_db = plot_levels(axes, cadence_hz, power, db_range)
    axes.set_xlim(0.0, float(cadence_hz[-1]))
    for number, value in enumerate([gait_frequency_hz, *harmonics_hz], start=1):
        if value is not None and np.isfinite(value) and value <= axes.get_xlim()[1]:
            words = f"{number}: {'gait frequency' if number == 1 else 'harmonic'}, {value:.2f} Hz" + " ?" * doubtful
            at = (value, float(np.interp(value, cadence_hz, level_db)))
            axes.plot(*at, marker="o", color=style.ACCENT, ms=5, ls="none", label=words)
            above: dict[str, Any] = {"xytext": (0, 5), "textcoords": "offset points"}
            style.write_note(axes, str(number), at, style.ACCENT, **above)
    if gait_frequency_hz is None:
        corner: dict[str, Any] = {"xycoords": "axes fraction", "ha": "right", "va": "top"}
        style.write_note(axes, "no gait frequency", (0.99, 0.96), style.ACCENT, **corner)
    return finish_axes(axes, ax, title, style.CADENCE_LABEL, style.LEVEL_LABEL, **shown)


def plot_levels(axes: Axes, x: FloatArray, values: npt.ArrayLike, db_range: float) -> FloatArray:
    """Plot powers in dB below their maximum, not far below the data; return the levels."""
    check_db_range(db_range)
    power = np.asarray(values, dtype=np.float64)
    top = float(np.nanmax(power)) if np.isfinite(power).any() else 0.0
    level_db = np.full(power.shape, -2.0 * db_range)
    if top > 0:
        level_db = np.maximum(compute_level_db(power / top), -2.0 * db_range)
    axes.plot(x, level_db, color=style.LINE, lw=1.3)
    lowest = 5.0 * float(np.floor(np.nanquantile(level_db, 0.05) / 5.0)) - 5.0
    bottom = max(-db_range, min(lowest, -15.0))
    axes.set_ylim(bottom, -0.2 * bottom)
    return level_db


def mean_doppler_spectrum(
    values: npt.ArrayLike,
    *,
    doppler_hz: npt.ArrayLike,
    wavelength_m: float,
    torso_doppler_hz: float | None = None,
    bandwidth_hz: float | tuple[float, float] | None = None,
    threshold: float | None = None,
    db_range: float = 40.0,
    title: str = "Mean Doppler spectrum",
    ax: Axes | None = None,
    **shown: Unpack[Shown],
) -> Figure:
    """Plot the mean Doppler spectrum below its peak, dB.

    These are the report's Fig. 4.14 and 4.15.

    Parameters
    ----------
    values : array_like, shape (K,)
        D_1, powers.
    doppler_hz : array_like, shape (K,)
        Ascending Doppler frequencies.
    wavelength_m : float
        For the axis in m/s.
    torso_doppler_hz : float, optional
        Main line, marked with its value.
    bandwidth_hz : float or (float, float), optional
        Micro-Doppler bandwidth B_mu, shaded: its two edges, or its width alone. A width is placed
        where it contains the most power.
    threshold : float, optional
        t_mu relative to the maximum, plotted as a level.
    db_range : float
        Range of the level axis, dB.
    **shown : bool
        ``velocity_axis``, ``legend``, False to leave it out.

    Raises
    ------
    AnalysisError
        If shapes differ, or the threshold does not lie between 0 and 1.

    Examples
    --------
    >>> from doppelgait import viz
    >>> axis_hz = [-50.0, 0.0, 50.0]
    >>> figure = viz.mean_doppler_spectrum([1.0, 4.0, 2.0], doppler_hz=axis_hz, wavelength_m=0.04)
    >>> figure.axes[0].get_title(loc="left"), figure.axes[0].get_xlabel()
    ('Mean Doppler spectrum', 'Doppler frequency (Hz)')
    """
    power, axis_hz = np.asarray(values, dtype=np.float64), np.asarray(doppler_hz, dtype=np.float64)
    if power.shape != axis_hz.shape or power.ndim != 1 or power.size < 2:
        raise AnalysisError(
            f"values and doppler_hz must be equally long rows; shapes are {power.shape} and {axis_hz.shape}"
        )
    if threshold is not None and not 0 < threshold < 1:
        raise AnalysisError(f"threshold is {threshold}; it is relative to the maximum, between 0 and 1")
    axes = style.make_axes(ax, height_in=4.6)[1]
    level_db = plot_levels(axes, axis_hz, power, db_range)
    axes.set_xlim(float(axis_hz[0]), float(axis_hz[-1]))
    if bandwidth_hz is not None:
        edges_hz = bandwidth_hz if isinstance(bandwidth_hz, tuple) else densest_band_hz(power, axis_hz, bandwidth_hz)
        words = f"bandwidth {edges_hz[1] - edges_hz[0]:.0f} Hz"
        axes.axvspan(*edges_hz, color=style.SHADE, alpha=0.45, lw=0, zorder=0, label=words)
    if threshold is not None:
        line_db = float(power_to_db(threshold))
        words = f"threshold {threshold:g} ({line_db:.1f} dB)"
        axes.axhline(line_db, color=style.REFERENCE, lw=1.0, ls="--", label=words)
    if torso_doppler_hz is not None:
        at = (torso_doppler_hz, float(np.interp(torso_doppler_hz, axis_hz, level_db)))
        axes.plot(*at, marker="o", color=style.ACCENT, ms=5, ls="none", label=f"torso {torso_doppler_hz:.1f} Hz")
    scale: Any = {"wavelength_m": wavelength_m, "above": True, **shown}
    return finish_axes(axes, ax, title, style.DOPPLER_LABEL, style.LEVEL_LABEL, **scale)


def densest_band_hz(power: FloatArray, doppler_hz: FloatArray, width_hz: float) -> tuple[float, float]:
    """Return the edges of the band of most power."""
    span = min(max(width_hz, 0.0), float(np.ptp(doppler_hz)))
    starts = np.linspace(doppler_hz[0], doppler_hz[-1] - span, 4 * doppler_hz.size)
    steps = np.diff(doppler_hz, prepend=doppler_hz[0])
    total = np.cumsum(np.nan_to_num(power) * steps)
    held = np.interp(starts + span, doppler_hz, total) - np.interp(starts, doppler_hz, total)
    best = starts[held >= 0.999 * held.max()]
    middle = float((best[0] + best[-1]) / 2.0)
    return middle, middle + span


def cadence_map(
    cadence_map: xr.DataArray,
    *,
    gait_frequency_hz: float | None = None,
    harmonics_hz: Sequence[float | None] | None = None,
    max_cadence_hz: float | None = None,
    db_range: float | None = None,
    cmap: str | None = None,
    doubtful: bool = False,
    title: str = "Cadence-velocity diagram",
    ax: Axes | None = None,
    **shown: Unpack[Shown],
) -> Figure:
    """Plot a cadence-velocity diagram in dB (the report's Fig. 4.12).

    Parameters
    ----------
    cadence_map : DataArray (cadence, doppler)
        Magnitudes D.
    gait_frequency_hz : float, optional
        f_mu, marked above the map with its second and third harmonic.
    harmonics_hz : sequence of float or None, optional
        Measured second and third harmonic, None for a harmonic that was not found; by default
        multiples of the gait frequency.
    max_cadence_hz : float, optional
        Right end of the cadence axis; by default 8 to 20 Hz, to show three harmonics.
    db_range : float, optional
        Dynamic range below the strongest cell in dB; by default down to the noise, at most 40 dB.
    doubtful : bool
        True if the gait frequency has low confidence; it is then shown with a question mark.
    cmap, **shown
        Colour map; ``colorbar``, ``velocity_axis``, ``legend``, False to leave it out.

    Raises
    ------
    AnalysisError
        If the array does not conform to its schema or has no cadence below ``max_cadence_hz``.
    """
    axes = style.make_axes(ax)[1]
    cropped = _crop(check_array(cadence_map, CADENCE_MAP), max_cadence_hz, gait_frequency_hz)
    level_db = amplitude_to_db(cropped.values).T
    cadence_hz = cropped.coords["cadence"].values
    image = plot_map(axes, cadence_hz, cropped.coords["doppler"].values, level_db, db_range, cmap)
    axes.set(xlim=(0.0, float(cadence_hz[-1])), ylim=doppler_limits_hz(cropped**2))
    if gait_frequency_hz is not None:
        higher_hz = (2.0 * gait_frequency_hz, 3.0 * gait_frequency_hz) if harmonics_hz is None else harmonics_hz
        marked_hz = {
            number: value
            for number, value in enumerate((gait_frequency_hz, *higher_hz), start=1)
            if value is not None and np.isfinite(value) and value < axes.get_xlim()[1]
        }
        label = f"1: gait frequency, {gait_frequency_hz:.2f} Hz" + " ?" * doubtful
        for number, value in marked_hz.items():
            axes.axvline(value, ymin=0.94, color=style.LINE_COLOURS[0], lw=1.6, label=label if number == 1 else None)
            below: dict[str, Any] = {"xycoords": ("data", "axes fraction"), "va": "top"}
            style.write_note(axes, str(number), (value, 0.93), style.LINE_COLOURS[0], **below)
    from_line = cadence_map.attrs.get("aligned", False)
    doppler_label = style.FROM_LINE_LABEL if from_line else style.DOPPLER_LABEL
    velocity_label = style.FROM_TORSO_LABEL if from_line else style.VELOCITY_LABEL
    scale: Any = {"quantity": "magnitude", "wavelength_m": wavelength_m(cadence_map), "velocity_label": velocity_label}
    scale |= shown
    return finish_axes(axes, ax, title, style.CADENCE_LABEL, doppler_label, image=image, **scale)


def _crop(array: xr.DataArray, max_cadence_hz: float | None, gait_frequency_hz: float | None) -> xr.DataArray:
    if max_cadence_hz is None:
        max_cadence_hz = min(max(8.0, 3.6 * (gait_frequency_hz or 0.0)), 20.0)
    shown = array.isel(cadence=array.coords["cadence"].values <= max_cadence_hz + 1e-9)
    if shown.sizes["cadence"] < 2:
        raise AnalysisError(
            f"max_cadence_hz is {max_cadence_hz}: fewer than two cadences of the {array.name} lie below"
        )
    return shown
