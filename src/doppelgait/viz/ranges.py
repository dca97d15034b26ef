"""Maps over range, time and Doppler, and levels of fitted sensors."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Unpack

import numpy as np
import numpy.typing as npt
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.patheffects import withStroke

from doppelgait.core.errors import AnalysisError
from doppelgait.core.labels import BASEBAND, Schema
from doppelgait.core.lazy import LONG_PULSES, take_every_row
from doppelgait.core.units import FloatArray
from doppelgait.viz import style
from doppelgait.viz.maps import (
    Shown,
    amplitude_to_db,
    check_array,
    check_signature,
    compute_level_db,
    doppler_limits_hz,
    finish_axes,
    plot_map,
    wavelength_m,
)
from doppelgait.viz.motion import plot_part_lines

Limits = tuple[float, float]

MAIN_LINE = (style.LINE_COLOURS[0], style.YELLOW)
"""Colour of the main line on the coloured and on the grey map."""
OUTLINED: dict[str, Any] = {"lw": 1.6, "path_effects": [withStroke(linewidth=3.0, foreground="black", alpha=0.6)]}
"""Lines on a map."""
ONE_MAP = Schema("range_doppler", ("doppler", "range"), "V^2", extra={"velocity": "doppler"})
GATE_RANGES = ("range_low", "range_high")
GATE_BAND = ("doppler_low", "doppler_high")
MOST_COLUMNS = 4096
"""Approximate number of columns in the map of a long recording; a page cannot show more."""


def check_gate(gate: xr.Dataset, *names: str) -> xr.Dataset:
    """Return ``gate`` if it has these time variables."""
    wrong = not isinstance(gate, xr.Dataset) or "time" not in gate.coords
    missing = list(names) if wrong else [name for name in names if name not in gate or gate[name].dims != ("time",)]
    if missing:
        raise AnalysisError(
            f"a gate must be a Dataset over time with {', '.join(names)}; missing: {', '.join(missing)}"
        )
    return gate


def range_time(
    baseband: xr.DataArray,
    *,
    tracks: xr.Dataset | Mapping[str, xr.Dataset] | None = None,
    db_range: float | None = None,
    cmap: str | None = None,
    title: str | None = None,
    ax: Axes | None = None,
    **shown: Unpack[Shown],
) -> Figure:
    """Plot the data matrix, dB (report's Fig. 3.14b, 3.15).

    Parameters
    ----------
    baseband : DataArray (slow_time, range)
        Complex, V. For more than 32,768 pulses, about 4,096 equally spaced pulses are plotted.
        One bin, of a radar without range, is plotted as a level over time.
    tracks : Dataset (time) or mapping of str to Dataset, optional
        Gate limits ``range_low`` and ``range_high`` in m, of one target or of several by label.
    db_range : float, optional
        Dynamic range below the strongest cell in dB; by default down to the noise, at most 40 dB.
    cmap, **shown
        Colour map of Matplotlib; ``colorbar``, ``legend``, False to leave it out.

    Raises
    ------
    AnalysisError
        If an array does not conform to its schema.
    """
    axes = style.make_axes(ax)[1]
    check_array(baseband, BASEBAND)
    count = baseband.sizes["slow_time"]
    every = math.ceil(count / MOST_COLUMNS) if count > LONG_PULSES else 1
    level_db, range_m = amplitude_to_db(take_every_row(baseband, every)).T, baseband.coords["range"].values
    time_s = baseband["slow_time"].values[::every]
    if range_m.size == 1:  # a radar without range
        axes.plot(time_s, level_db[0], color=style.LINE, lw=0.7)
        words = "Level against time" if title is None else title
        return finish_axes(axes, ax, words, style.TIME_LABEL, "level (dB re 1 V)", **shown)
    image = plot_map(axes, time_s, range_m, level_db, db_range, cmap)
    limits = axes.get_xlim(), axes.get_ylim()
    named = {"gate": tracks} if isinstance(tracks, xr.Dataset) else dict(tracks or {})
    for (label, gate), (colour, dash) in zip(named.items(), style.map_lines(list(named)), strict=True):
        check_gate(gate, *GATE_RANGES)
        for name in GATE_RANGES:
            words = label if label == "gate" else f"gate: {label}"
            look: Any = {"color": colour, "ls": dash, "label": words if name == "range_low" else None, **OUTLINED}
            axes.plot(gate.coords["time"].values, gate[name].values, **look)
    axes.set(xlim=limits[0], ylim=limits[1])
    words = "Range against time" if title is None else title
    bar: Any = {"image": image, "quantity": "magnitude", "reference": "1 V", **shown}
    return finish_axes(axes, ax, words, style.TIME_LABEL, style.RANGE_LABEL, **bar)


def range_doppler_map(
    power: xr.DataArray,
    *,
    gate: xr.Dataset | None = None,
    db_range: float | None = None,
    cmap: str | None = None,
    title: str = "Range-Doppler map",
    ax: Axes | None = None,
    **shown: Unpack[Shown],
) -> Figure:
    """Plot a range-Doppler map with gate (report's Fig. 4.5).

    Parameters
    ----------
    power : DataArray (doppler, range)
        V^2, with the coordinate ``velocity`` and, if known, the scalar coordinate ``time``.
    gate : Dataset (time), optional
        ``range_low`` and ``range_high`` in m, ``doppler_low`` and ``doppler_high`` in Hz, which may
        be infinite. The limits are those at the time of the map, or at the middle of the gate if
        the map has no time.
    db_range : float, optional
        Dynamic range below the strongest cell in dB; by default down to the noise, at most 40 dB.
    cmap, **shown
        Colour map; ``colorbar``, ``velocity_axis``, ``legend``, False to leave it out.

    Raises
    ------
    AnalysisError
        If an array does not conform to its schema.

    Examples
    --------
    >>> import doppelgait as dg
    >>> recording = dg.data.sample()
    >>> maps = dg.processing.range_doppler(
    ...     recording.baseband, dg.Analysis(), wavelength_m=recording.radar.wavelength_m
    ... )
    >>> figure = dg.viz.range_doppler_map(abs(next(maps)).isel(time=0) ** 2)
    >>> figure.axes[0].get_title(loc="left"), figure.axes[0].get_xlabel()
    ('Range-Doppler map at 0.05 s', 'range (m)')
    """
    check_array(power, ONE_MAP)
    axes = style.make_axes(ax)[1]
    range_m, doppler_hz = power.coords["range"].values, power.coords["doppler"].values
    image = plot_map(axes, range_m, doppler_hz, compute_level_db(power.values), db_range, cmap)
    time_s = float(power.coords["time"]) if "time" in power.coords else None
    if gate is not None:
        gates = check_gate(gate, *GATE_RANGES, *GATE_BAND)
        times_s = gates.coords["time"].values
        at = float(times_s.mean()) if time_s is None else time_s
        nearest = int(np.abs(times_s - at).argmin())
        r_low, r_high, d_low, d_high = (float(gates[name].values[nearest]) for name in (*GATE_RANGES, *GATE_BAND))
        bottom, top = axes.get_ylim()
        margin = 0.004 * (top - bottom)
        d_low, d_high = max(d_low, bottom + margin), min(d_high, top - margin)
        look: Any = {"fill": False, "ec": style.LINE_COLOURS[0], "lw": 1.8, "label": "gate"}
        axes.add_patch(Rectangle((r_low, d_low), r_high - r_low, d_high - d_low, **look))
    if range_m.size == 1:  # a radar without range
        axes.set_xticks([])
    words = title if time_s is None or not title else f"{title} at {time_s:.2f} s"
    label = style.RANGE_LABEL if range_m.size > 1 else ""
    scale: Any = {"image": image, "reference": "1 V²", "wavelength_m": wavelength_m(power)}
    return finish_axes(axes, ax, words, label, style.DOPPLER_LABEL, **scale, **shown)


def signature(
    signature: xr.DataArray,
    *,
    truth_doppler: xr.DataArray | None = None,
    main_line_hz: npt.ArrayLike | None = None,
    db_range: float | Limits | None = None,
    doppler_hz: float | Limits | None = None,
    cmap: str | None = None,
    title: str = "Micro-Doppler signature",
    ax: Axes | None = None,
    **shown: Unpack[Shown],
) -> Figure:
    """Plot a signature, dB (report's Fig. 4.10, 4.11).

    Parameters
    ----------
    signature : DataArray (time, doppler)
        Raw (V^2) or normalised (1).
    truth_doppler : DataArray (slow_time, scatterer), optional
        True Doppler of every scatterer in Hz with the coordinate ``part``
        (:func:`doppelgait.viz.scatterer_doppler`); plotted as thin lines in the colours of the
        parts over a grey map.
    main_line_hz : array_like, shape (J,) or scalar, optional
        Main Doppler line at the signature's times, Hz.
    db_range : float or (float, float), optional
        Dynamic range below the strongest cell in dB, or lowest and highest level; by default down
        to the noise, at most 40 dB.
    doppler_hz : float or (float, float), optional
        Doppler limits, or both; by default the occupied part of the axis with 0 Hz and a margin.
    cmap, **shown
        Colour map; ``colorbar``, ``velocity_axis``, ``legend``, False to leave it out.

    Raises
    ------
    AnalysisError
        If an array does not conform to its schema or the main line has a different length.

    Examples
    --------
    >>> import doppelgait as dg
    >>> recording = dg.data.sample()
    >>> result = dg.analyze(recording, gate="truth")[0]
    >>> figure = dg.viz.range_time(recording.baseband, cmap="viridis", db_range=30.0)
    >>> figure = dg.viz.signature(result.signature)
    >>> figure.axes[0].get_title(loc="left"), figure.axes[0].get_xlabel()
    ('Micro-Doppler signature', 'time (s)')
    """
    wavelength = wavelength_m(check_signature(signature))
    axes = style.make_axes(ax)[1]
    if doppler_hz is not None and np.ndim(doppler_hz) == 0:
        doppler_hz = (-float(doppler_hz), float(doppler_hz))  # type: ignore[arg-type]
    limits_hz = doppler_hz or doppler_limits_hz(
        signature, lines_hz=() if truth_doppler is None else truth_doppler.values
    )
    image = plot_map(
        axes,
        signature.coords["time"].values,
        signature.coords["doppler"].values,
        compute_level_db(signature.values).T,
        db_range,
        cmap,
        style.MAP_COLOURS if truth_doppler is None else style.OVERLAY_COLOURS,
    )
    width_s = axes.get_xlim()
    if truth_doppler is not None:
        plot_part_lines(axes, truth_doppler, width=0.8, bold=0.0)
    if main_line_hz is not None:
        values = np.asarray(main_line_hz, dtype=np.float64)
        count = signature.sizes["time"]
        if values.shape not in ((), (count,)):
            raise AnalysisError(
                f"main_line_hz has shape {values.shape}; it must be one number or ({count},), one per column"
            )
        look: Any = {"color": MAIN_LINE[truth_doppler is not None], "ls": "--", "label": "main line", **OUTLINED}
        axes.plot(signature.coords["time"].values, np.broadcast_to(values, (count,)), **look)
    axes.set(xlim=width_s, ylim=limits_hz)
    scale: Any = {"reference": choose_reference(signature), "wavelength_m": wavelength, **shown}
    return finish_axes(axes, ax, title, style.TIME_LABEL, style.DOPPLER_LABEL, image=image, **scale)


def choose_reference(signature: xr.DataArray) -> str:
    """Return the reference of the levels."""
    return "1 V²" if signature.attrs["units"] == "V^2" else ""


def plot_sensor_fit(
    *,
    range_m: FloatArray,
    static_db: FloatArray,
    noise_db: FloatArray,
    knots_m: FloatArray,
    knots_db: FloatArray,
    time_s: FloatArray,
    phase_rad: FloatArray,
    gain_db: FloatArray,
    title: str = "Fitted sensor model",
) -> Figure:
    """Plot levels over range, and common phase over time."""
    figure = style.make_figure(width_in=10.5, height_in=7.5)
    grid = figure.add_gridspec(2, 2, height_ratios=(3, 2))
    levels = figure.add_subplot(grid[0, :])
    levels.plot(range_m, static_db, color=style.LINE, lw=1.0, label="static echo")
    levels.plot(knots_m, knots_db, color=style.ACCENT, lw=1.6, marker="o", ms=3.5, label="clutter profile")
    levels.plot(range_m, noise_db, color=style.SKY, lw=1.2, label="noise per frame")
    style.name_axes(levels, title=title, x=style.RANGE_LABEL, y="level (dB re 1 V)")
    style.draw_grid(levels)
    for column, (values, words) in enumerate(((phase_rad, "common phase (rad)"), (gain_db, "common gain (dB)"))):
        axes = figure.add_subplot(grid[1, column])
        axes.plot(time_s, values, color=style.LINE, lw=0.7)
        style.name_axes(axes, title="", x=style.TIME_LABEL, y=words)
        style.draw_grid(axes)
    style.place_legend(levels)
    return figure
