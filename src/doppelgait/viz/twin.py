"""What a sensor twin was fitted from: static echoes and noise over range, phase and gain over time."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from doppelgait.viz.style import ACCENT, legend_below, name_axes, new_figure

FloatArray = npt.NDArray[np.float64]

STATIC = "#1f3b57"
NOISE = "#56b4e9"


def twin_figure(
    *,
    range_m: FloatArray,
    static_db: FloatArray,
    noise_db: FloatArray,
    knots_m: FloatArray,
    knots_db: FloatArray,
    time_s: FloatArray,
    phase_rad: FloatArray,
    gain_db: FloatArray,
    title: str = "Sensor twin",
) -> Figure:
    """Levels over range above, common phase and gain of the frames below.

    Parameters
    ----------
    range_m, static_db, noise_db : ndarray, shape (N,)
        Range, level of the static echo and of the noise per frame, dB re 1 V; NaN where unknown.
    knots_m, knots_db : ndarray, shape (M,)
        Fitted clutter profile.
    time_s, phase_rad, gain_db : ndarray, shape (I,)
        Common phase and gain of every frame.
    title : str
    """
    figure = new_figure(width_in=10.5, height_in=7.5)
    grid = figure.add_gridspec(2, 2, height_ratios=(3, 2))
    levels = figure.add_subplot(grid[0, :])
    levels.plot(range_m, static_db, color=STATIC, lw=1.0, label="static echo")
    levels.plot(knots_m, knots_db, color=ACCENT, lw=1.6, marker="o", ms=3.5, label="clutter profile")
    levels.plot(range_m, noise_db, color=NOISE, lw=1.2, label="noise per frame")
    name_axes(levels, title=title, x="range (m)", y="level (dB re 1 V)")
    for column, (values, words) in enumerate(((phase_rad, "common phase (rad)"), (gain_db, "common gain (dB)"))):
        axes = figure.add_subplot(grid[1, column])
        axes.plot(time_s, values, color=STATIC, lw=0.7)
        name_axes(axes, title="", x="time (s)", y=words)
    legend_below(figure, levels)
    return figure
