"""Chapter 4 of the report: the signature beside the true Doppler, and its parts (Figs. 4.10 and 4.11)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait import viz
from doppelgait.core.labels import axis
from doppelgait.reproduce.chapter4 import ENVELOPE, TORSO_HZ, TORSO_READ_HZ, walk
from doppelgait.reproduce.drawing import numbered_marks, panels
from doppelgait.reproduce.entry import Entry, Made, Reading, judged
from doppelgait.reproduce.measures import (
    columns_per_second,
    find_peaks,
    main_frequency_hz,
    share_near_lines,
    torso_line_hz,
    upper_envelope_hz,
)
from doppelgait.viz.body import draw_part_lines, part_lines
from doppelgait.viz.maps import DOPPLER_LABEL, velocity_axis
from doppelgait.viz.signatures import draw_signature
from doppelgait.viz.style import LINE_COLOURS, legend_below, name_axes, new_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from doppelgait.radar.recording import Recording
    from doppelgait.reproduce.material import Material

FloatArray = npt.NDArray[np.float64]

LINE_REACH_HZ = 15.0
"""Half width of a line: the window's full half-power width is 13.7 Hz, its full width at t_mu 28.6 Hz."""
SMOOTHING_S = 0.03


def _second_cycle_s(recording: Recording) -> tuple[float, float]:
    stride_s = 1.0 / recording.truth[0].stride_frequency_hz
    return stride_s, 2.0 * stride_s


def make_lines_and_signature(material: Material) -> Made:
    """Fig. 4.10."""
    recording, result = walk(material)
    lines = viz.scatterer_doppler(recording.truth[0].scatterers, wavelength_m=recording.radar.wavelength_m)
    first_s, last_s = _second_cycle_s(recording)
    doppler_hz = recording.truth[0].doppler_hz(recording.radar.wavelength_m)
    limits_hz = float(doppler_hz.min()) - 50.0, float(doppler_hz.max()) + 50.0
    figure, (left, right) = panels(2, height_in=5.6)
    draw_part_lines(left, part_lines(lines), bold=1.8)
    left.set(xlim=(first_s, last_s), ylim=limits_hz)
    name_axes(left, title="(a) true Doppler of every point", x="time (s)", y=DOPPLER_LABEL)
    draw_signature(right, result.normalised_signature, db_range=30.0, doppler_hz=limits_hz)
    right.set_xlim(first_s, last_s)
    name_axes(right, title="(b) micro-Doppler signature, 30 dB", x="time (s)", y="")
    velocity_axis(right, recording.radar.wavelength_m)
    legend_below(figure, left)
    top_hz = upper_envelope_hz(result.normalised_signature, ENVELOPE)
    inside = slice(100, -100)  # ends are zero-padded
    true_top_hz = doppler_hz.max(axis=1)
    ankle = axis(recording.truth[0].scatterers, "marker").tolist().index("right_ankle")
    readings = [
        Reading("peak Doppler of the right ankle", float(doppler_hz[:, ankle].max()), "Hz", 300.0, 15.0),
        Reading(
            "share of the signature's power within 15 Hz of a true line",
            share_near_lines(result.normalised_signature, doppler_hz, axis(lines, "slow_time"), reach_hz=LINE_REACH_HZ),
            "1",
        ),
        Reading("upper edge of the signature over the true highest line, median",
                float(np.median((top_hz - true_top_hz)[inside])), "Hz",
                note="a single line is 28.6 Hz wide at t_mu, so up to 14 Hz belong to the window"),
    ]  # fmt: skip
    return Made(
        figure, readings,
        judged(readings, f"{100.0 * readings[1].ours:.0f} % of the signature's power lies within {LINE_REACH_HZ:g} Hz "
               "of a true line, about the width of the window."),
    )  # fmt: skip


def make_five_cycles(material: Material) -> Made:
    """Fig. 4.11."""
    recording, result = walk(material)
    mu, truth = result.normalised_signature, recording.truth[0]
    rate_hz = columns_per_second(mu)
    top_hz, bottom_hz = upper_envelope_hz(mu, ENVELOPE), -upper_envelope_hz(_mirrored(mu), ENVELOPE)
    steps = find_peaks(top_hz, rate_hz, smoothing_s=SMOOTHING_S)
    torso_hz = torso_line_hz(mu, reach_hz=40.0)
    figure, axes = new_axes()
    draw_signature(axes, mu, db_range=30.0)
    name_axes(axes, title="Five gait cycles; 30 dB", x="time (s)", y=DOPPLER_LABEL)
    velocity_axis(axes, recording.radar.wavelength_m)
    axes.plot(axis(mu, "time"), torso_hz, color=LINE_COLOURS[0], lw=1.2)
    _mark_parts(axes, axis(mu, "time")[steps], torso_hz, float(np.quantile(top_hz, 0.98)), float(bottom_hz.min()))
    observed_s = mu.sizes["time"] / rate_hz
    swing = main_frequency_hz(torso_hz, rate_hz)
    readings = [
        Reading("steps: peaks of the upper edge", float(steps.size), "1", 10.0, 0.0),
        Reading("gait cycles in the observation", observed_s * truth.stride_frequency_hz, "1", 5.0, 0.01, given=True),
        Reading("oscillation of the main line over the gait frequency", swing / truth.stride_frequency_hz, "1", 2.0,
                0.1, "a line oscillates at whole multiples; a tenth is what a record of five cycles resolves"),
        Reading("mean of the main line", float(torso_hz.mean()), "Hz", TORSO_HZ, TORSO_READ_HZ),
        Reading("from the highest to the lowest edge (label 4)", float(top_hz.max() - bottom_hz.min()), "Hz"),
    ]  # fmt: skip
    return Made(
        figure, readings,
        judged(readings, f"{steps.size} steps in {readings[1].ours:.0f} gait cycles, and a main line that oscillates "
               f"{readings[2].ours:.1f} times a cycle. Labels as in the report: 1 main line, 2 gait cycle, 3 step, "
               "4 bandwidth, 5 width of the main line, 6 zero Doppler."),
    )  # fmt: skip


def _mirrored(mu: xr.DataArray) -> xr.DataArray:
    return mu.isel(doppler=slice(None, None, -1)).assign_coords(doppler=-axis(mu, "doppler")[::-1])


def _mark_parts(axes: Axes, step_s: FloatArray, torso_hz: FloatArray, top_hz: float, bottom_hz: float) -> None:
    """The labels (1) to (6) of the report."""
    both = {"arrowstyle": "<->", "color": "white", "lw": 1.3}
    low, high = axes.get_ylim()
    above = min(top_hz + 25.0, high - 0.12 * (high - low))
    middle_hz = float(torso_hz.mean())
    marks = {"1": (float(step_s[0]) * 0.5, middle_hz), "6": (float(step_s[0]) * 0.5, 0.0)}
    if step_s.size >= 8:
        two_s, one_s = (float(step_s[2]), float(step_s[4])), (float(step_s[5]), float(step_s[6]))
        for name, (start, stop) in (("2", two_s), ("3", one_s)):
            axes.annotate("", (start, above), (stop, above), arrowprops=both)
            marks[name] = ((start + stop) / 2.0, above + 0.06 * (high - low))
        at_s = float(step_s[7]) + 0.1
        axes.annotate("", (at_s, bottom_hz), (at_s, top_hz), arrowprops=both)
        marks["4"] = (at_s + 0.08, (top_hz + middle_hz) / 2.0 + 30.0)
        wide_hz = float(torso_hz.min()) - 14.0, float(torso_hz.max()) + 14.0
        late_s = float(step_s[-1])
        axes.annotate("", (late_s, wide_hz[0]), (late_s, wide_hz[1]), arrowprops=both)
        marks["5"] = (late_s + 0.08, wide_hz[1] + 15.0)
    axes.axhline(0.0, color="white", lw=0.8, ls=":")
    numbered_marks(axes, marks)


ENTRIES = (
    Entry(
        "fig-4.10", "True Doppler of all points, and the signature of the same walk",
        "The signature should be as like the true lines as possible; the torso is strongest and varies least, the saw "
        "teeth above and below are the legs, the ankle of which reaches about 300 Hz (Fig. 2.16).",
        make_lines_and_signature,
    ),
    Entry(
        "fig-4.11", "Signature of five gait cycles with its parts named",
        "Five gait cycles are ten steps, one peak each; the main line oscillates at twice the gait frequency.",
        make_five_cycles,
    ),
)  # fmt: skip
