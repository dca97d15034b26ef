"""Step-Doppler (cadence-velocity) map."""

from __future__ import annotations

import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure

from doppelgait.core.errors import AnalysisError
from doppelgait.core.labels import CADENCE_MAP
from doppelgait.viz.maps import (
    DOPPLER_LABEL,
    amplitude_to_db,
    checked,
    colour_bar,
    doppler_limits_hz,
    draw_map,
    level_limits_db,
    velocity_axis,
    wavelength_m,
)
from doppelgait.viz.style import LINE_COLOURS, name_axes, new_axes

CADENCE_LABEL = "cadence (Hz)"
FROM_LINE_LABEL = "Doppler from the main line (Hz)"


def step_doppler(
    cadence_map: xr.DataArray,
    *,
    gait_frequency_hz: float | None = None,
    max_cadence_hz: float | None = None,
    db_range: float | None = None,
    title: str = "Step-Doppler map",
) -> Figure:
    """Step-Doppler (cadence-velocity) map in dB (the report's Fig. 4.12).

    Parameters
    ----------
    cadence_map : DataArray (cadence, doppler)
        Magnitudes D.
    gait_frequency_hz : float, optional
        f_mu: marked above the map, with its second and third harmonic.
    max_cadence_hz : float, optional
        Right end of the cadence axis; by default what shows three harmonics, 8 to 20 Hz.
    db_range : float, optional
        Dynamic range shown below the strongest cell, dB; by default down to the noise, at most 40 dB.
    title : str

    Returns
    -------
    Figure

    Raises
    ------
    AnalysisError
        If the array does not keep its schema or has no cadence below ``max_cadence_hz``.
    """
    figure, axes = new_axes()
    image = draw_step_doppler(
        axes, cadence_map, gait_frequency_hz=gait_frequency_hz, max_cadence_hz=max_cadence_hz, db_range=db_range
    )
    name_axes(axes, title=title, x=CADENCE_LABEL, y=step_doppler_label(cadence_map))
    velocity_axis(axes, wavelength_m(cadence_map))
    colour_bar(image, axes, quantity="magnitude", reference="1")
    return figure


def step_doppler_label(cadence_map: xr.DataArray) -> str:
    """Name of a map's Doppler axis: columns that were moved onto the main line are measured from there."""
    return FROM_LINE_LABEL if from_main_line(cadence_map) else DOPPLER_LABEL


def from_main_line(cadence_map: xr.DataArray) -> bool:
    """Whether a map's Doppler is measured from the main line; maps of older result files do not tell."""
    return bool(cadence_map.attrs.get("aligned", False))


def draw_step_doppler(
    axes: Axes,
    cadence_map: xr.DataArray,
    *,
    gait_frequency_hz: float | None,
    max_cadence_hz: float | None,
    db_range: float | None,
    doppler_hz: tuple[float, float] | None = None,
) -> ScalarMappable:
    """The map of :func:`step_doppler` on given axes."""
    shown = below_cadence(checked(cadence_map, CADENCE_MAP), cadence_reach_hz(max_cadence_hz, gait_frequency_hz))
    level_db = amplitude_to_db(shown.values).T
    image = draw_map(
        axes,
        x=shown.coords["cadence"].values,
        y=shown.coords["doppler"].values,
        level_db=level_db,
        limits_db=level_limits_db(level_db, db_range),
    )
    limits_hz = doppler_hz or doppler_limits_hz(shown**2)
    axes.set(xlim=(0.0, float(shown.coords["cadence"].values[-1])), ylim=limits_hz)
    if gait_frequency_hz is not None:
        for number, name in ((1, "f"), (2, "2f"), (3, "3f")):
            cadence_hz = number * gait_frequency_hz
            if cadence_hz < axes.get_xlim()[1]:
                axes.axvline(cadence_hz, ymin=0.94, color=LINE_COLOURS[0], lw=1.6)
                axes.annotate(
                    name, (cadence_hz, 0.93), xycoords=("data", "axes fraction"), color=LINE_COLOURS[0], fontsize=9,
                    ha="center", va="top",
                )  # fmt: skip
    return image


def cadence_reach_hz(max_cadence_hz: float | None, gait_frequency_hz: float | None) -> float:
    """Right end of the cadence axis: as asked, or 3.6 times the gait frequency but 8 to 20 Hz."""
    if max_cadence_hz is not None:
        return max_cadence_hz
    return min(max(8.0, 3.6 * (gait_frequency_hz or 0.0)), 20.0)


def below_cadence(array: xr.DataArray, max_cadence_hz: float) -> xr.DataArray:
    """Part of an array (cadence, ...) up to a cadence; two values at least."""
    shown = array.isel(cadence=array.coords["cadence"].values <= max_cadence_hz + 1e-9)
    if shown.sizes["cadence"] < 2:
        raise AnalysisError(
            f"max_cadence_hz is {max_cadence_hz}: fewer than two cadences of the {array.name} lie below"
        )
    return shown
