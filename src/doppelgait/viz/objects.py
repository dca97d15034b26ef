"""Plots of recordings, results, scenes, radars, datasets and models."""

from __future__ import annotations

import base64
import io
import math
import textwrap
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from doppelgait.core.errors import ConfigError
from doppelgait.core.notebook import DRAWINGS
from doppelgait.core.plugins import plugin
from doppelgait.viz import ranges, spectra, style
from doppelgait.viz.maps import check_signature, doppler_limits_hz

LEFT = "text-align:left"
PICTURE_IN = (5.2, 3.2)  # width and height of the picture of an object


def overview(recording: Any, result: Any = None, *, title: str | None = None, **arrays: Any) -> Figure:
    """Plot a recording and one of its results on a page.

    The page has range-time map, signature, cadence-velocity diagram, cadence spectrum and features.

    Parameters
    ----------
    recording : Recording or DataArray (slow_time, range)
    result : Result, optional
        One target of :func:`doppelgait.analyze`. Without a result, ``recording`` must be a baseband
        and ``arrays`` are required.
    title : str, optional
        Title; by default the label of the result.
    **arrays
        Without a result: ``signature``, ``cadence_map``, ``cadence_spectrum`` and ``features``
        (values by name), and optionally ``gate``, ``main_line_hz``, ``gait_frequency_hz``,
        ``amplitude`` and ``flags``.

    Raises
    ------
    AnalysisError
        If an array does not have the required dimensions and coordinates.
    ConfigError
        If there is neither a result nor the arrays.

    Examples
    --------
    >>> import doppelgait as dg
    >>> recording = dg.data.sample()
    >>> results = dg.analyze(recording, gate="truth")
    >>> figure = dg.viz.overview(recording, results[0])
    >>> figure.axes[0].get_title(loc="left"), figure.axes[0].get_xlabel()
    ('Range against time', 'time (s)')
    """
    baseband = recording if isinstance(recording, xr.DataArray) else getattr(recording, "baseband", None)
    if baseband is None:
        kind = type(recording).__name__
        raise ConfigError(f"recording: {kind} is not allowed; give a Recording, for example of doppelgait.simulate")
    if result is None:
        if "signature" not in arrays:
            raise ConfigError("result: is missing; give one of doppelgait.analyze(recording), for example results[0]")
        return plot_overview(baseband, title=title or "Overview", **arrays)
    if isinstance(result, Sequence):
        raise ConfigError("result: a list is not allowed; give one of its results, for example results[0]")
    name = title or result.label or "target"
    found: dict[str, Any] = {
        "signature": result.signature,
        "cadence_map": result.cadence_map,
        "cadence_spectrum": result.cadence_spectrum,
        "features": result.shown_features,
        "gate": None if result.gate_limits is None else {name: result.gate.limits},
        "main_line_hz": result.main_line_hz,
        "gait_frequency_hz": result.gait_frequency_hz,
        "amplitude": result.analysis.method == "liland2018",
        "flags": result.flags,
        "doubtful": result.doubtful,
    }
    return plot_overview(baseband, **{**found, **arrays, "title": name})


@plugin("drawing", "recording")
def plot_recording(recording: Any, *, ax: Axes | None = None, **settings: Any) -> Axes:
    """Plot the range-time map of a recording."""
    ax = style.make_axes(ax)[1]
    ranges.range_time(recording.baseband, ax=ax, **settings)
    return ax


@plugin("drawing", "result")
def plot_result(result: Any, *, ax: Axes | None = None, **settings: Any) -> Axes:
    """Plot the signature of a result with its main line."""
    ax = style.make_axes(ax)[1]
    ranges.signature(result.signature, ax=ax, **{"main_line_hz": result.arrays.get("main_line_hz"), **settings})
    return ax


@plugin("drawing", "scene")
def plot_scene(scene: Any, *, ax: Axes | None = None) -> Axes:
    """Plot a scene from above: radar, starts and headings."""
    ax = style.make_axes(ax)[1]
    radar_m = tuple(scene.radar_position_m[:2])
    ax.plot(*radar_m, marker="^", color=style.ACCENT, ms=9, ls="none")
    ax.annotate("radar", radar_m, xytext=(6, 6), textcoords="offset points", fontsize=9, color=style.ACCENT)
    names = [target.label or "target" for target in scene.targets]
    colours = style.choose_class_colours(names)
    for name, target in zip(names, scene.targets, strict=True):
        heading_deg = target.heading_deg
        if target.start_position_m is not None:
            place_m = target.start_position_m[:2]
        elif target.range_m is None or target.path is not None:
            continue
        else:
            bearing = math.radians(target.bearing_deg)
            place_m = [radar_m[n] + target.range_m * turn(bearing) for n, turn in enumerate((math.cos, math.sin))]
            heading_deg = target.bearing_deg + 180.0 + target.aspect_deg
        ax.plot(*place_m, marker="o", color=colours[name], ms=7, ls="none")
        ax.annotate(name, place_m, xytext=(6, 6), textcoords="offset points", fontsize=9, color=colours[name])
        if heading_deg is not None:
            turn = math.radians(heading_deg)
            tip_m = (place_m[0] + 0.8 * math.cos(turn), place_m[1] + 0.8 * math.sin(turn))
            ax.annotate("", tip_m, xytext=place_m, arrowprops={"arrowstyle": "->", "color": colours[name]})
    style.name_axes(ax, title="Scene from above", x="x (m)", y="y (m)")
    ax.set_aspect("equal", adjustable="datalim")
    ax.margins(0.2)
    ax.grid(color="#e0e0e0", lw=0.6)
    return ax


@plugin("drawing", "radar")
def plot_radar(radar: Any, *, ax: Axes | None = None) -> Axes:
    """Plot the unambiguous ranges and velocities of a radar."""
    ax = style.make_axes(ax)[1]
    ranged = radar.waveform.kind != "cw"
    start_m, stop_m = (radar.range_start_m, radar.range_stop_m) if ranged else (0.0, 1.0)
    reach_mps = radar.unambiguous_velocity_mps
    ax.fill_between([start_m, stop_m], -reach_mps, reach_mps, color="#9ecae1", alpha=0.6, lw=0)
    style.name_axes(
        ax, title="Unambiguous range and velocity", x="range (m)" if ranged else "no range", y="velocity (m/s)"
    )
    if not ranged:
        ax.set_xticks([])
    ax.axhline(0.0, color="#606060", lw=0.8)
    ax.margins(0.1)
    return ax


SPLITS = ("train", "validation", "test", "trained on", "held out", "own recordings")
"""Order of the bars."""


def plot_counts(
    counts: Mapping[str, Mapping[str, int]], *, ax: Axes | None = None, title: str = "Rows by class"
) -> Axes:
    """Plot rows by class, stacked by split."""
    ax = style.make_axes(ax)[1]
    names = {split: None for by_split in counts.values() for split in by_split}
    splits = [split for split in SPLITS if split in names] + sorted(set(names) - set(SPLITS))
    left = np.zeros(len(counts))
    for split, colour in zip(splits, ("#1f3b57", "#56b4e9", "#e69f00", "#b79f00"), strict=False):
        n_rows = np.array([by_split.get(split, 0) for by_split in counts.values()])
        ax.barh(list(counts), n_rows, left=left, color=colour, label=split)
        left = left + n_rows
    style.name_axes(ax, title=title, x="rows", y="")
    ax.margins(y=0.6 if len(counts) == 1 else 0.05)
    ax.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2, frameon=False)  # covers no bar
    return ax


@plugin("drawing", "dataset")
def plot_dataset(dataset: Any, *, ax: Axes | None = None) -> Axes:
    """Plot the rows of a dataset by class and split."""
    counts = dataset.index.groupby(["label", "split"]).size()
    labels = sorted(dataset.index["label"].unique())
    return plot_counts({str(label): counts[label].to_dict() for label in labels}, ax=ax)


@plugin("drawing", "model")
def plot_model(model: Any, *, ax: Axes | None = None) -> Axes:
    """Plot the rows that a model was trained on."""
    facts = model.facts
    rows = {"trained on": facts.n_train, "held out": facts.n_held, "own recordings": facts.n_own}
    return plot_counts({facts.name: {name: n for name, n in rows.items() if n}}, ax=ax, title="Training data")


def plot_overview(
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
    """Plot one target on one page."""
    figure = style.make_figure(width_in=13.0, height_in=8.6)
    figure.suptitle(title, fontsize=13, x=0.01, ha="left")
    above, below = figure.subfigures(2, 1, height_ratios=(1.1, 1.0), squeeze=False)[:, 0]
    limits_hz = doppler_limits_hz(check_signature(signature))
    left, right = above.subplots(1, 2)
    ranges.range_time(baseband, tracks=gate, ax=left)
    ranges.signature(signature, main_line_hz=main_line_hz, doppler_hz=limits_hz, ax=right)
    style.place_legend(left, "panel")
    style.place_legend(right, "panel", columns=1)
    right.child_axes[0].set_ylabel(style.SHORT_VELOCITY_LABEL)
    left, middle, right = below.subplots(1, 3, width_ratios=(1.15, 1.15, 0.9))
    ratios = [features.get(f"harmonic_ratio_{number}") for number in (2, 3)]
    marks: dict[str, Any] = {
        "gait_frequency_hz": gait_frequency_hz,
        "harmonics_hz": [
            None if gait_frequency_hz is None or ratio is None else ratio * gait_frequency_hz for ratio in ratios
        ],
        "doubtful": "gait_frequency_hz" in doubtful,
    }
    spectra.cadence_map(cadence_map, ax=left, **marks)
    if left.get_ylabel() == style.DOPPLER_LABEL:
        left.set_ylim(limits_hz)
    left.child_axes[0].set_ylabel(style.SHORT_VELOCITY_LABEL)
    spectra.cadence_spectrum(cadence_spectrum, amplitude=amplitude, ax=middle, **marks)
    for axes in (left, middle):
        style.place_legend(axes, "panel", columns=1)
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
        axes.text(0.0, height, style.describe_quantity(name)[0], fontsize=10, va="center")
        axes.text(
            1.0,
            height,
            format_value(name, value) + " ?" * (name in doubtful and value is not None),
            fontsize=10,
            va="center",
            ha="right",
        )
        axes.plot([0.0, 1.0], [height - step / 2] * 2, color=style.GRID, lw=0.8)
    axes.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0))
    shown = [flag for flag in flags if flag != "low_confidence" or not doubtful]  # else explained by the question mark
    text = "\n".join(textwrap.fill(style.describe_flag(flag), 44) for flag in shown)
    text = "? low confidence\n" * bool(doubtful) + text
    axes.text(0.0, 1.0 - (len(values) + 0.4) * step, text, fontsize=8.5, va="top", color=style.ACCENT)


def format_value(name: str, value: float | None) -> str:
    """Format a value with its unit in about three digits."""
    if value is None or not np.isfinite(value):
        return "not determined"
    unit = style.describe_quantity(name)[1]
    digits = 0 if abs(value) >= 100 else 1 if abs(value) >= 20 else 2
    sign = "+" if unit == "m/s" and value > 0 else ""
    return f"{sign}{value:.{digits}f}" + ("" if unit == "1" else f" {unit}")


@plugin("drawing", "html")
def format_object(title: str, facts: Mapping[str, str], name: str, value: Any) -> str:
    """Format an object as a small table and, if its plot has a name, an inline PNG."""
    rows = "".join(
        f'<tr><th style="{LEFT}">{escape(key)}</th><td style="{LEFT}">{escape(text)}</td></tr>'
        for key, text in facts.items()
        if text
    )
    picture = ""
    if name:
        figure = DRAWINGS[name].run(value).figure
        figure.set_size_inches(*PICTURE_IN)
        image = io.BytesIO()
        figure.savefig(image, format="png", dpi=80, metadata={"Software": None})
        content = base64.b64encode(image.getvalue()).decode()
        picture = f'<img alt="{escape(title)}" src="data:image/png;base64,{content}">'
    return (
        f"<div><strong>{escape(title)}</strong>"
        f'<div style="display:flex;gap:1em;align-items:flex-start"><table>{rows}</table>'
        f"{picture}</div></div>"
    )
