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
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from doppelgait.core.errors import ConfigError
from doppelgait.core.notebook import DRAWINGS
from doppelgait.core.plugins import plugin
from doppelgait.viz import ranges, spectra, style
from doppelgait.viz.maps import check_signature

LEFT = "text-align:left"
PICTURE_IN = (5.2, 3.2)  # width and height of the picture of an object


def overview(
    recording: Any, result: Any = None, *, title: str | None = None, doppler_hz: Any = None, **look: Any
) -> Figure:
    """Plot a recording and one of its results on a page.

    The page has range-time map, signature, cadence-velocity diagram, cadence spectrum and features.

    Parameters
    ----------
    recording : Recording or DataArray (slow_time, range)
    result : Result
        One target of :func:`doppelgait.analyze`.
    title : str, optional
        Title; by default the label of the result.
    doppler_hz, **look
        As of :func:`signature`; ``db_range`` and ``cmap`` are those of all maps.

    Raises
    ------
    AnalysisError
        If an array does not have the required dimensions and coordinates.
    ConfigError
        If there is no result.

    Examples
    --------
    >>> import doppelgait as dg
    >>> recording = dg.data.sample()
    >>> results = dg.analyze(recording, gate="truth")
    >>> figure = dg.viz.overview(recording, results[0])
    >>> figure.axes[0].get_title(loc="left"), figure.axes[0].get_xlabel()
    ('Range against time', 'time (s)')
    """
    if not hasattr(result, "signature"):
        kind = type(result).__name__
        raise ConfigError(f"result: {kind} is not allowed; give one of doppelgait.analyze(recording), as results[0]")
    name, features, f_mu_hz = title or result.label or "target", result.shown_features, result.gait_frequency_hz
    gate = None if result.gate_limits is None else {name: result.gate.limits}
    figure = style.make_figure(width_in=13.0, height_in=9.5)
    figure.suptitle(name, x=0.01, ha="left")
    above, below = figure.subfigures(2, 1, squeeze=False)[:, 0]
    parts = (*above.subfigures(1, 2), *below.subfigures(1, 3, width_ratios=(1.3, 1.0, 1.1)))
    panels = [part.subplots() for part in parts]
    ranges.range_time(getattr(recording, "baseband", recording), tracks=gate, ax=panels[0], legend=False, **look)
    lines: Any = {"main_line_hz": result.main_line_hz, "doppler_hz": doppler_hz, "legend": False}
    ranges.signature(check_signature(result.signature), ax=panels[1], **lines, **look)
    ratios = [features.get(f"harmonic_ratio_{number}") for number in (2, 3)]
    marks: Any = {
        "gait_frequency_hz": f_mu_hz,
        "harmonics_hz": [None if f_mu_hz is None or ratio is None else ratio * f_mu_hz for ratio in ratios],
        "doubtful": "gait_frequency_hz" in result.doubtful,
        "legend": False,
    }
    spectra.cadence_map(result.cadence_map, ax=panels[2], **marks, **look)
    if panels[2].get_ylabel() == style.DOPPLER_LABEL:
        panels[2].set_ylim(panels[1].get_ylim())
    amplitude = result.analysis.method == "liland2018"
    spectra.cadence_spectrum(result.cadence_spectrum, amplitude=amplitude, ax=panels[3], **marks)
    for axes in panels[:4]:
        style.place_legend(axes)
    _plot_features(panels[4], {**features, "gait_frequency_hz": f_mu_hz}, result.flags, result.doubtful)
    return figure


@plugin("drawing", "axes")
def make_pyplot_axes() -> Axes:
    """Make axes in a figure of pyplot, which a notebook shows."""
    from matplotlib import pyplot

    return style.keep_size(pyplot.figure(figsize=(10.5, 5.5), layout="constrained")).add_subplot()


@plugin("drawing", "recording")
def plot_recording(recording: Any, *, ax: Axes, **settings: Any) -> Axes:
    """Plot the range-time map of a recording."""
    ranges.range_time(recording.baseband, ax=ax, **settings)
    return ax


@plugin("drawing", "result")
def plot_result(result: Any, *, ax: Axes, **settings: Any) -> Axes:
    """Plot the signature of a result with its main line."""
    ranges.signature(result.signature, ax=ax, **{"main_line_hz": result.arrays.get("main_line_hz"), **settings})
    return ax


@plugin("drawing", "scene")
def plot_scene(scene: Any, *, ax: Axes) -> Axes:
    """Plot a scene from above: radar, starts and headings."""
    radar_m = tuple(scene.radar_position_m[:2])
    ax.plot(*radar_m, marker="^", color=style.ACCENT, ms=9, ls="none")
    ax.annotate("radar", radar_m, xytext=(6, 6), textcoords="offset points", color=style.ACCENT)
    names = [target.label or "target" for target in scene.targets]
    colours = style.choose_class_colours(names)
    for name, target in zip(names, scene.targets, strict=True):
        heading_deg = target.heading_deg
        if target.start_position_m is not None:
            place_m = target.start_position_m[:2]
        elif target.path is not None:
            continue
        else:
            bearing, range_m = math.radians(target.bearing_deg), target.range_m or 5.0  # by default that or more
            place_m = [radar_m[n] + range_m * turn(bearing) for n, turn in enumerate((math.cos, math.sin))]
            heading_deg = target.bearing_deg + 180.0 + target.aspect_deg
        ax.plot(*place_m, marker="o", color=colours[name], ms=7, ls="none")
        turn = math.radians(heading_deg or 0.0)
        ahead = (math.cos(turn), math.sin(turn))
        behind: Any = {"xytext": (0, -8), "va": "top"} if ahead[1] > 0 else {"xytext": (0, 8), "va": "bottom"}
        ax.annotate(name, place_m, textcoords="offset points", ha="center", color=colours[name], **behind)
        if heading_deg is not None:
            tip_m = (place_m[0] + 0.8 * ahead[0], place_m[1] + 0.8 * ahead[1])
            ax.update_datalim([tip_m])
            ax.annotate("", tip_m, xytext=place_m, arrowprops={"arrowstyle": "->", "color": colours[name]})
    ax.set_aspect("equal", adjustable="datalim")
    ax.margins(0.3)
    style.draw_grid(ax)
    style.name_axes(ax, title="Scene from above", x="x (m)", y="y (m)")
    return ax


@plugin("drawing", "radar")
def plot_radar(radar: Any, *, ax: Axes) -> Axes:
    """Plot the frame and the unambiguous velocities of a radar."""
    ranged = radar.waveform.kind != "cw"
    start_m, stop_m = (radar.range_start_m, radar.range_stop_m) if ranged else (0.0, 1.0)
    reach_mps = radar.unambiguous_velocity_mps
    ax.fill_between([start_m, stop_m], -reach_mps, reach_mps, color=style.SHADE, alpha=0.6, lw=0)
    words = ("Frame and unambiguous velocity", "range of the frame (m)") if ranged else ("Unambiguous velocity", "")
    style.name_axes(ax, title=words[0], x=words[1], y="velocity (m/s)")
    if not ranged:
        ax.set_xticks([])
    ax.axhline(0.0, color=style.REFERENCE, lw=0.8)
    ax.margins(0.1)
    return ax


SPLITS = ("train", "validation", "test", "trained on", "held out", "own recordings")
"""Order of the bars."""


def plot_counts(counts: Mapping[str, Mapping[str, int]], *, ax: Axes, title: str = "Rows by class") -> Axes:
    """Plot rows by class, stacked by split."""
    names = {split: None for by_split in counts.values() for split in by_split}
    splits = [split for split in SPLITS if split in names] + sorted(set(names) - set(SPLITS))
    left = np.zeros(len(counts))
    for split, colour in zip(splits, ("#1f3b57", "#56b4e9", "#e69f00", "#b79f00"), strict=False):
        n_rows = np.array([by_split.get(split, 0) for by_split in counts.values()])
        ax.barh(list(counts), n_rows, left=left, color=colour, label=split)
        left = left + n_rows
    style.name_axes(ax, title=title, x="rows", y="")
    ax.margins(y=0.6 if len(counts) == 1 else 0.05)
    style.place_legend(ax)
    return ax


@plugin("drawing", "dataset")
def plot_dataset(dataset: Any, *, ax: Axes) -> Axes:
    """Plot the rows of a dataset by class and split."""
    counts = dataset.index.groupby(["label", "split"]).size()
    labels = sorted(dataset.index["label"].unique())
    return plot_counts({str(label): counts[label].to_dict() for label in labels}, ax=ax)


@plugin("drawing", "model")
def plot_model(model: Any, *, ax: Axes) -> Axes:
    """Plot the rows that a model was trained on."""
    facts = model.facts
    rows = {"trained on": facts.n_train, "held out": facts.n_held, "own recordings": facts.n_own}
    return plot_counts({facts.name: {name: n for name, n in rows.items() if n}}, ax=ax, title="Training data")


def _plot_features(
    axes: Axes, values: Mapping[str, float | None], flags: Sequence[str], doubtful: Sequence[str]
) -> None:
    axes.set_axis_off()
    axes.set_title("Features", loc="left")
    shown = [flag for flag in flags if flag != "low_confidence" or not doubtful]  # else explained by the question mark
    text = "\n".join(textwrap.fill(style.describe_flag(flag), 32) for flag in shown)
    text = "? low confidence\n" * bool(doubtful) + text
    step = 1.0 / max(len(values) + 1 + text.count("\n") + 1, 11)
    for row, (name, value) in enumerate(values.items()):
        height = 1.0 - (row + 0.6) * step
        words = format_value(name, value) + " ?" * (name in doubtful and value is not None)
        words = words.removeprefix("+") if "no_direction" in flags else words
        axes.text(0.0, height, style.describe_quantity(name)[0], va="center")
        axes.text(1.0, height, words, va="center", ha="right")
        axes.plot([0.0, 1.0], [height - step / 2] * 2, color=style.GRID, lw=0.8)
    axes.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0))
    axes.text(0.0, 1.0 - (len(values) + 0.4) * step, text, fontsize="small", va="top", color=style.ACCENT)


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
        figure, axes = style.make_axes(width_in=PICTURE_IN[0], height_in=PICTURE_IN[1])
        DRAWINGS[name].run(value, ax=axes)
        image = io.BytesIO()
        figure.savefig(image, format="png", dpi=80, metadata={"Software": None})
        content = base64.b64encode(image.getvalue()).decode()
        picture = f'<img alt="{escape(title)}" src="data:image/png;base64,{content}">'
    return (
        f"<div><strong>{escape(title)}</strong>"
        f'<div style="display:flex;gap:1em;align-items:flex-start"><table>{rows}</table>'
        f"{picture}</div></div>"
    )
