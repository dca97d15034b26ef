"""Overview of one target on one page."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from doppelgait.viz.maps import (
    add_colour_bar,
    add_velocity_axis,
    check_signature,
    doppler_limits_hz,
    wavelength_m,
)
from doppelgait.viz.ranges import plot_range_time
from doppelgait.viz.signatures import choose_reference, plot_signature
from doppelgait.viz.spectra import (
    from_main_line,
    label_cadence_map,
    plot_cadence_map,
    plot_cadence_spectrum,
)
from doppelgait.viz.style import (
    ACCENT,
    CADENCE_LABEL,
    DOPPLER_LABEL,
    GRID,
    LEVEL_LABEL,
    RANGE_LABEL,
    SHORT_VELOCITY_LABEL,
    TIME_LABEL,
    describe_flag,
    describe_quantity,
    legend_under,
    make_figure,
    name_axes,
)


def overview(
    baseband: xr.DataArray,
    *,
    signature: xr.DataArray,
    cadence_map: xr.DataArray,
    cadence_spectrum: xr.DataArray,
    features: Mapping[str, float | None],
    gate: xr.Dataset | Mapping[str, xr.Dataset] | None = None,
    main_line_hz: npt.ArrayLike | None = None,
    gait_frequency_hz: float | None = None,
    amplitude: bool = False,
    flags: Sequence[str] = (),
    doubtful: Sequence[str] = (),
    title: str = "Overview",
) -> Figure:
    """Plot one target on one page.
    The page has range-time map, signature, cadence-velocity diagram, cadence spectrum and features.
    """
    figure = make_figure(width_in=13.0, height_in=8.6)
    figure.suptitle(title, fontsize=13, x=0.01, ha="left")
    above, below = figure.subfigures(2, 1, height_ratios=(1.1, 1.0), squeeze=False)[:, 0]
    limits_hz = doppler_limits_hz(check_signature(signature))
    left, right = above.subplots(1, 2)
    image = plot_range_time(left, baseband, tracks=gate, db_range=None)
    name_axes(left, title="Range against time", x=TIME_LABEL, y=RANGE_LABEL)
    add_colour_bar(image, left, quantity="magnitude", reference="1 V")
    legend_under(left, columns=6)
    signature_image = plot_signature(right, signature, main_line_hz=main_line_hz, doppler_hz=limits_hz)
    name_axes(right, title="Micro-Doppler signature", x=TIME_LABEL, y=DOPPLER_LABEL)
    add_velocity_axis(right, wavelength_m(signature), label=SHORT_VELOCITY_LABEL)
    legend_under(right)
    add_colour_bar(signature_image, right, quantity="power", reference=choose_reference(signature))
    left, middle, right = below.subplots(1, 3, width_ratios=(1.15, 1.15, 0.9))
    ratios = [features.get(f"harmonic_ratio_{number}") for number in (2, 3)]
    harmonics_hz = [
        None if gait_frequency_hz is None or ratio is None else ratio * gait_frequency_hz for ratio in ratios
    ]
    cadence_image = plot_cadence_map(
        left,
        cadence_map,
        gait_frequency_hz=gait_frequency_hz,
        harmonics_hz=harmonics_hz,
        max_cadence_hz=None,
        db_range=None,
        doppler_hz=None if from_main_line(cadence_map) else limits_hz,
        doubtful="gait_frequency_hz" in doubtful,
    )
    name_axes(left, title="Cadence-velocity diagram", x=CADENCE_LABEL, y=label_cadence_map(cadence_map))
    add_velocity_axis(left, wavelength_m(cadence_map), label=SHORT_VELOCITY_LABEL)
    add_colour_bar(cadence_image, left, quantity="magnitude")
    plot_cadence_spectrum(
        middle,
        cadence_spectrum,
        gait_frequency_hz=gait_frequency_hz,
        harmonics_hz=harmonics_hz,
        max_cadence_hz=None,
        db_range=40.0,
        amplitude=amplitude,
        doubtful="gait_frequency_hz" in doubtful,
    )
    name_axes(middle, title="Cadence spectrum", x=CADENCE_LABEL, y=LEVEL_LABEL)
    for axes in (left, middle):
        legend_under(axes)
    _plot_features(right, {**features, "gait_frequency_hz": gait_frequency_hz}, flags, doubtful)
    return figure


def _plot_features(
    axes: Axes, values: Mapping[str, float | None], flags: Sequence[str], doubtful: Sequence[str]
) -> None:
    axes.set_axis_off()
    axes.set_title("Features", fontsize=11.5, loc="left")
    step = 1.0 / max(len(values) + 4, 11)
    for row, (name, value) in enumerate(values.items()):
        height = 1.0 - (row + 0.6) * step
        axes.text(0.0, height, describe_quantity(name)[0], fontsize=10, va="center")
        axes.text(
            1.0,
            height,
            format_value(name, value) + " ?" * (name in doubtful and value is not None),
            fontsize=10,
            va="center",
            ha="right",
        )
        axes.plot([0.0, 1.0], [height - step / 2] * 2, color=GRID, lw=0.8)
    axes.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0))
    shown = [flag for flag in flags if flag != "low_confidence" or not doubtful]  # else explained by the question mark
    text = "\n".join(textwrap.fill(describe_flag(flag), 44) for flag in shown)
    text = "? low confidence\n" * bool(doubtful) + text
    axes.text(0.0, 1.0 - (len(values) + 0.4) * step, text, fontsize=8.5, va="top", color=ACCENT)


def format_value(name: str, value: float | None) -> str:
    """Format a value with its unit in about three digits."""
    if value is None or not np.isfinite(value):
        return "not determined"
    unit = describe_quantity(name)[1]
    digits = 0 if abs(value) >= 100 else 1 if abs(value) >= 20 else 2
    sign = "+" if unit == "m/s" and value > 0 else ""
    return f"{sign}{value:.{digits}f}" + ("" if unit == "1" else f" {unit}")
