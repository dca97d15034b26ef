"""Many signatures on one page."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from doppelgait.core.errors import AnalysisError
from doppelgait.viz.maps import (
    DOPPLER_LABEL,
    checked_signature,
    colour_bar,
    doppler_limits_hz,
    level_db_of,
    level_limits_db,
    velocity_axis,
    wavelength_m,
)
from doppelgait.viz.signatures import Limits, draw_signature, reference_of
from doppelgait.viz.style import new_figure


def contact_sheet(
    signatures: Sequence[xr.DataArray],
    *,
    titles: Sequence[str],
    db_range: float | None = None,
    columns: int | None = None,
    doppler_hz: Limits | None = None,
) -> Figure:
    """Many signatures on one page, all with the same axes and the same dB scale.

    Parameters
    ----------
    signatures : sequence of DataArray (time, doppler)
        1 to 64, all raw or all normalised.
    titles : sequence of str
        One each.
    db_range : float, optional
        Dynamic range shown below the strongest cell of all, dB; by default down to the noise, at most 40 dB.
    columns : int, optional
        Signatures in a row; about square by default.
    doppler_hz : (float, float), optional
        Doppler limits; by default what holds the occupied part of each.

    Returns
    -------
    Figure

    Raises
    ------
    AnalysisError
        If there are none or too many, titles do not match, or units differ.
    """
    arrays = _checked_sheet(signatures, titles, columns)
    levels = np.concatenate([level_db_of(array.values).ravel() for array in arrays])
    limits_db = level_limits_db(levels, db_range)
    across = min(columns or math.ceil(math.sqrt(len(arrays))), len(arrays))
    down = math.ceil(len(arrays) / across)
    figure = new_figure(width_in=12.0, height_in=1.4 + 2.1 * down)
    grid = figure.subplots(down, across, sharex=True, sharey=True, squeeze=False)
    panels = list(grid.flat)
    occupied = np.array([doppler_limits_hz(array) for array in arrays])
    limits_hz = doppler_hz or (float(occupied[:, 0].min()), float(occupied[:, 1].max()))
    ends_s = []
    for axes, array, title in zip(panels, arrays, titles, strict=False):
        image = draw_signature(axes, array, db_range=db_range, doppler_hz=limits_hz, limits_db=limits_db)
        ends_s += axes.get_xlim()
        axes.set_title(title, fontsize=9, loc="left")
        axes.tick_params(labelsize=8)
        axes.set_facecolor("#eeeeee")
    panels[0].set_xlim(min(ends_s), max(ends_s))
    for number, axes in enumerate(panels):
        axes.set_visible(number < len(arrays))
        axes.tick_params(labelbottom=number + across >= len(arrays))
    figure.supxlabel("time (s)", fontsize=10)
    figure.supylabel(DOPPLER_LABEL, fontsize=10)
    for number in range(across - 1, len(arrays), across):
        velocity_axis(panels[number], wavelength_m(arrays[0]), label="(m/s)")
    colour_bar(image, *panels, quantity="power", reference=reference_of(arrays[0]))
    return figure


def _checked_sheet(
    signatures: Sequence[xr.DataArray], titles: Sequence[str], columns: int | None
) -> list[xr.DataArray]:
    arrays = [checked_signature(array) for array in signatures]
    if not 1 <= len(arrays) <= 64 or len(titles) != len(arrays):
        raise AnalysisError(
            f"a contact sheet takes 1 to 64 signatures and one title each; got {len(arrays)} and {len(titles)}"
        )
    if columns is not None and columns < 1:
        raise AnalysisError(f"columns is {columns}; a row holds at least one signature")
    units = sorted({str(array.attrs["units"]) for array in arrays})
    if len(units) > 1:
        raise AnalysisError(f"signatures in units {units} cannot share one dB scale; pass all raw or all normalised")
    return arrays
