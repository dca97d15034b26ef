"""Micro-Doppler signatures: one, or before and after normalisation."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from doppelgait.core.errors import AnalysisError
from doppelgait.viz.maps import (
    add_colour_bar,
    add_velocity_axis,
    check_signature,
    compute_level_db,
    doppler_limits_hz,
    level_limits_db,
    plot_map,
    wavelength_m,
)
from doppelgait.viz.motion import group_lines, plot_part_lines
from doppelgait.viz.style import (
    DOPPLER_LABEL,
    LINE_COLOURS,
    MAP_COLOURS,
    OVERLAY_COLOURS,
    TIME_LABEL,
    YELLOW,
    make_axes,
    make_figure,
    name_axes,
    place_legend_below,
)

Limits = tuple[float, float]

MAIN_LINE = (LINE_COLOURS[0], YELLOW)
"""Colour of the main line on the coloured and on the grey map."""


def signature(
    signature: xr.DataArray,
    *,
    truth_doppler: xr.DataArray | None = None,
    main_line_hz: npt.ArrayLike | None = None,
    db_range: float | None = None,
    doppler_hz: Limits | None = None,
    title: str = "Micro-Doppler signature",
    ax: Axes | None = None,
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
    db_range : float, optional
        Dynamic range below the strongest cell in dB; by default down to the noise, at most 40 dB.
    doppler_hz : (float, float), optional
        Doppler limits; by default the occupied part of the axis with 0 Hz and a margin.
    title : str
    ax : Axes, optional
        Axes for the plot; by default those of a new figure.

    Returns
    -------
    Figure

    Raises
    ------
    AnalysisError
        If an array does not conform to its schema or the main line has a different length.

    See Also
    --------
    signature_normalisation : the signature before and after normalisation.

    Examples
    --------
    >>> import doppelgait as dg
    >>> scene = dg.Scene([dg.Target({"kind": "boulic"}, label="human")], duration_s=3.0)
    >>> recording = dg.simulate(scene, dg.Radar.preset("x4", prf_hz=640.0))
    >>> result = dg.analyze(recording, gate="truth")[0]
    >>> from doppelgait import viz
    >>> figure = viz.signature(result.signature)
    >>> figure.axes[0].get_title(loc="left"), figure.axes[0].get_xlabel()
    ('Micro-Doppler signature', 'time (s)')
    """
    wavelength = wavelength_m(check_signature(signature))
    figure, axes = make_axes(ax)
    image = plot_signature(
        axes,
        signature,
        truth_doppler=truth_doppler,
        main_line_hz=main_line_hz,
        db_range=db_range,
        doppler_hz=doppler_hz,
    )
    name_axes(axes, title=title, x=TIME_LABEL, y=DOPPLER_LABEL)
    add_velocity_axis(axes, wavelength)
    add_colour_bar(image, axes, quantity="power", reference=choose_reference(signature))
    place_legend_below(figure, axes, inside=ax is not None)
    return figure


def choose_reference(signature: xr.DataArray) -> str:
    """Return the reference of the levels."""
    return "1 V²" if signature.attrs["units"] == "V^2" else ""


def plot_signature(
    axes: Axes,
    signature: xr.DataArray,
    *,
    truth_doppler: xr.DataArray | None = None,
    main_line_hz: npt.ArrayLike | None = None,
    db_range: float | None = None,
    doppler_hz: Limits | None = None,
    limits_db: Limits | None = None,
) -> ScalarMappable:
    """Plot map and lines of :func:`signature` on existing axes."""
    check_signature(signature)
    level_db = compute_level_db(signature.values).T
    limits_hz = doppler_hz or doppler_limits_hz(
        signature, lines_hz=() if truth_doppler is None else truth_doppler.values
    )
    image = plot_map(
        axes,
        x=signature.coords["time"].values,
        y=signature.coords["doppler"].values,
        level_db=level_db,
        limits_db=limits_db or level_limits_db(level_db, db_range),
        colours=MAP_COLOURS if truth_doppler is None else OVERLAY_COLOURS,
    )
    width_s = axes.get_xlim()
    if truth_doppler is not None:
        plot_part_lines(axes, group_lines(truth_doppler), width=0.8, bold=0.0)
    if main_line_hz is not None:
        values = np.asarray(main_line_hz, dtype=np.float64)
        count = signature.sizes["time"]
        if values.shape not in ((), (count,)):
            raise AnalysisError(
                f"main_line_hz has shape {values.shape}; it must be one number or ({count},), one per column"
            )
        axes.plot(
            signature.coords["time"].values,
            np.broadcast_to(values, (count,)),
            color=MAIN_LINE[truth_doppler is not None],
            lw=1.6,
            ls="--",
            label="main line",
            path_effects=[withStroke(linewidth=3.0, foreground="black", alpha=0.6)],
        )
    axes.set(xlim=width_s, ylim=limits_hz)
    return image


def signature_normalisation(
    signature: xr.DataArray,
    *,
    normalised: xr.DataArray,
    db_range: float | None = None,
    doppler_hz: Limits | None = None,
) -> Figure:
    """Plot a signature before and after normalisation (report's Fig. 4.9).

    Parameters
    ----------
    signature : DataArray (time, doppler)
        Raw, V^2.
    normalised : DataArray (time, doppler)
        The same signature, normalised.
    db_range : float, optional
        Dynamic range of both maps in dB; by default down to the noise of each, at most 40 dB.
    doppler_hz : (float, float), optional
        Doppler limits of both maps; by default those of the normalised signature.

    Returns
    -------
    Figure

    Raises
    ------
    AnalysisError
        If an array does not conform to its schema.

    See Also
    --------
    signature : the signature alone.

    Examples
    --------
    >>> import doppelgait as dg
    >>> scene = dg.Scene([dg.Target({"kind": "boulic"}, label="human")], duration_s=3.0)
    >>> recording = dg.simulate(scene, dg.Radar.preset("x4", prf_hz=640.0))
    >>> result = dg.analyze(recording, gate="truth")[0]
    >>> from doppelgait import viz
    >>> figure = viz.signature_normalisation(
    ...     result.signature, normalised=dg.processing.normalise(result.signature, 0.0)
    ... )
    >>> figure.axes[0].get_title(loc="left"), figure.axes[0].get_xlabel()
    ('(a) signature', 'time (s)')
    """
    check_signature(signature)
    limits_hz = doppler_hz or doppler_limits_hz(check_signature(normalised))
    figure = make_figure(width_in=12.5, height_in=5.0)
    pair = figure.subplots(1, 2, sharey=True)
    titles = ("(a) signature", "(b) columns normalised")
    for axes, array, title in zip(pair, (signature, normalised), titles, strict=True):
        image = plot_signature(axes, array, db_range=db_range, doppler_hz=limits_hz)
        name_axes(axes, title=title, x=TIME_LABEL, y=DOPPLER_LABEL if axes is pair[0] else "")
        add_colour_bar(image, axes, quantity="power", reference=choose_reference(array))
    add_velocity_axis(pair[1], wavelength_m(normalised))
    return figure
