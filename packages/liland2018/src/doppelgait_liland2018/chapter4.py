"""Chapter 4 of the report up to the signature."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes

from doppelgait import viz
from doppelgait.pipeline import Result
from doppelgait.processing import Analysis, gaussian_window, range_doppler
from doppelgait.radar import Recording
from doppelgait_liland2018.drawing import plot_numbered_marks
from doppelgait_liland2018.entry import EntryResult, Reading, compare_statement, entry, judge, summarise_readings
from doppelgait_liland2018.material import Material
from doppelgait_liland2018.measures import (
    column_level_rise_db,
    find_peaks,
    half_power_width_bins,
    main_frequency_hz,
    make_printed_window,
    measure_column_rate_hz,
    read_axis,
    share_near_lines,
    side_lobe_db,
    torso_line_hz,
    upper_envelope_hz,
)
from doppelgait_liland2018.style import (
    ACCENT,
    LINE,
    LINE_COLOURS,
    make_axes,
    make_panels,
    name_axes,
    place_legend_below,
)

WINDOW_PULSES, WINDOW_STEEPNESS = 40, 0.3
"""Window of Fig. 4.3."""
DOG_PRF_HZ = 1300.0
"""Upper end of the report's frame rates: paws in a gallop do not alias."""
SPANS_M = {"human": 1.0, "dog": 1.5}
"""R_t of the report's Table 4.1."""
SHOWN_M = 2.0
ENVELOPE = 0.04
"""Share of a column's maximum that belongs to the signature: the report's t_mu."""
SHOWN_HZ = -250.0, 450.0
STEP_COLUMNS = 24
"""Maps over which the strongest cell is averaged: one whole step of the walk."""
TORSO_HZ, TORSO_READ_HZ = 100.0, 15.0
"""The report's torso line, "around 100 Hz": bins of 10 Hz on both sides, read off an axis."""


def walk(material: Material) -> tuple[Recording, Result]:
    """Simulate and analyse the scenario of chapter 4."""
    walker = material.make_walker()
    return material.recording(walker, prf_hz=1000.0), material.result(walker, prf_hz=1000.0)


@entry(
    "fig-4.3",
    "Gaussian window over the frames of a CPI, and its spectrum",
    "With M = 40 frames and a steepness of 0.3 the side lobes lie 65.4 dB below the main lobe.",
)
def make_window(material: Material) -> EntryResult:
    window = gaussian_window(WINDOW_PULSES, WINDOW_STEEPNESS)
    figure, (left, right) = make_panels(2)
    left.plot(np.arange(1, window.size + 1), window, color=LINE, marker=".")
    name_axes(left, title="(a) window", x="number of the frame", y="weight")
    magnitude = np.abs(np.fft.fftshift(np.fft.fft(window, 8192)))
    level_db = 20.0 * np.log10(np.maximum(magnitude / magnitude.max(), 1e-6))
    right.plot(np.linspace(-0.5, 0.5, 8192, endpoint=False), level_db, color=LINE)
    lobe_db = side_lobe_db(window)
    right.axhline(lobe_db, color=ACCENT, ls="--", lw=1.0)
    right.set(ylim=(-100.0, 5.0), xlim=(-0.5, 0.5))
    name_axes(
        right,
        title=f"(b) magnitude, side lobes {lobe_db:.1f} dB",
        x="Doppler frequency (relative to frame rate)",
        y="level (dB re maximum)",
    )
    readings = [
        Reading("highest side lobe, M = 40, sigma_w = 0.3", lobe_db, "dB", -65.4, 0.05),
        Reading(
            "the same of the window as Eq. 4.4 prints it",
            side_lobe_db(make_printed_window(40, 0.3)),
            "dB",
            note="half a sample off its centre: the report's figure was made with the centred window",
        ),
        Reading("main lobe, full width at half power", half_power_width_bins(window), "1/T_d"),
    ]
    return judge(
        figure,
        readings,
        f"with the centred window the side lobes lie at {lobe_db:.1f} dB; the printed formula is half "
        f"a sample off its centre and gives {readings[1].ours - lobe_db:.1f} dB more.",
    )


def _map_at_backward_foot(material: Material) -> tuple[xr.DataArray, Result, float]:
    """Return the map of fastest backward motion, with Doppler."""
    recording, result = walk(material)
    doppler_hz = recording.truth[0].doppler_hz(recording.radar.wavelength_m)
    fifth = doppler_hz.shape[0] // 5
    frame = fifth + int(doppler_hz[fifth : 4 * fifth].min(axis=1).argmin())

    def make() -> xr.DataArray:
        analysis = Analysis(method="liland2018")
        blocks = range_doppler(recording.baseband, analysis, wavelength_m=recording.radar.wavelength_m, columns=[frame])
        return next(iter(blocks)).isel(time=0)

    return material.compute_once(("range-Doppler map", frame), make), result, float(doppler_hz[frame].min())


def _crop(power: xr.DataArray, centre_m: float) -> xr.DataArray:
    return power.isel(range=np.abs(read_axis(power, "range") - centre_m) <= SHOWN_M)


def _centre_m(result: Result, time_s: float) -> float:
    return float(result.gate.centre_at(time_s))


@entry(
    "fig-4.5",
    "Range-Doppler map of a walking person",
    "The person approaches: torso and head are the two strongest clusters near 100 Hz, the limbs smaller ones; a "
    "single point has a negative Doppler, an arm or foot that swings back.",
)
def make_range_doppler(material: Material) -> EntryResult:
    power, result, lowest_hz = _map_at_backward_foot(material)
    shown = _crop(power, _centre_m(result, float(power.coords["time"])))
    strongest = shown.values.max(axis=1)
    torso_hz = float(read_axis(shown, "doppler")[int(strongest.argmax())])
    below = read_axis(shown, "doppler") < min(lowest_hz / 2.0, 0.0)
    foot_db = 10.0 * np.log10(strongest[below].max() / strongest.max()) if below.any() else float("nan")
    # Doppler of the strongest cell of range-Doppler maps, mean over one whole step in the middle of the walk.
    recording, _ = walk(material)
    middle = recording.n_pulses // 2
    step_frames = recording.radar.prf_hz / recording.truth[0].gait_frequency_hz
    frames = [middle + round(step_frames * n / STEP_COLUMNS) for n in range(STEP_COLUMNS)]

    def make() -> float:
        analysis = Analysis(method="liland2018")
        blocks = range_doppler(recording.baseband, analysis, wavelength_m=recording.radar.wavelength_m, columns=frames)
        found = [read_axis(block, "doppler")[block.values.max(axis=2).argmax(axis=1)] for block in blocks]
        return float(np.concatenate(found).mean())

    readings = [
        Reading(
            "Doppler of the strongest cell, mean over a whole step",
            material.compute_once("strongest cell over a step", make),
            "Hz",
            TORSO_HZ,
            TORSO_READ_HZ,
            "the report's moment is not known, hence a mean",
        ),
        Reading("Doppler of the strongest cell in the map shown", torso_hz, "Hz"),
        compare_statement(
            "part of the walker below 0 Hz in the map shown",
            lowest_hz < 0.0,
            note="the moment is chosen so",
            fixed=True,
        ),
        Reading("true Doppler of the part that moves back", lowest_hz, "Hz"),
        Reading("level of the part that moves back, below the strongest cell", float(foot_db), "dB"),
        Reading(
            "Doppler bins K = M", float(power.sizes["doppler"]), "1", 101.0, 1.0, "there M = 100, not odd", fixed=True
        ),
    ]
    figure = viz.range_doppler_map(shown, db_range=40.0, title="Range-Doppler map of a walking person")
    figure.axes[0].set_ylim(SHOWN_HZ)
    return judge(
        figure,
        readings,
        f"the strongest cell lies at {torso_hz:.0f} Hz in the map shown and at {readings[0].ours:.0f} "
        f"Hz over a step; a part of the walker has {lowest_hz:.0f} Hz, where a foot or arm moves back.",
    )


@entry(
    "fig-4.7",
    "Range-Doppler map with the gate of the tracker",
    "The gate is put around the target from the simulation's own truth; a real system would need a tracker.",
)
def make_gate_figure(material: Material) -> EntryResult:
    power, result, _ = _map_at_backward_foot(material)
    time_s = float(power.coords["time"])
    shown = _crop(power, _centre_m(result, time_s))
    gate, band_hz = result.gate, result.gate.doppler_hz or (-np.inf, np.inf)
    ranges = np.abs(read_axis(power, "range") - _centre_m(result, time_s)) <= gate.span_m / 2.0
    rows = (read_axis(power, "doppler") >= band_hz[0]) & (read_axis(power, "doppler") <= band_hz[1])
    inside = float(power.values[np.ix_(rows, ranges)].sum() / power.values.sum())
    readings = [
        Reading("range span R_t of the gate", gate.span_m, "m", 1.0, 0.0, fixed=True),
        Reading("Doppler band of the gate", band_hz[1] - band_hz[0], "Hz"),
        Reading("share of the map's power inside", inside, "1"),
    ]
    figure = viz.range_doppler_map(shown, gate=gate.limits, db_range=40.0, title="Gate on the range-Doppler map")
    figure.axes[0].set_ylim(SHOWN_HZ)
    return judge(
        figure,
        readings,
        f"the gate from the truth holds {100.0 * inside:.0f} % of the map's power. As in the report "
        "it knows class and Doppler of the target, which a tracker would not; our own method takes one span "
        "for all classes and no Doppler limits.",
    )


@entry("table-4.1", "Range span of the gate by target", "1 m for a person, 1.5 m for a dog.")
def make_span_table(material: Material) -> EntryResult:
    bodies = {"human": [material.make_walker(), material.person()], "dog": [material.find_galloping_dog()]}
    readings, too_long = [], []
    for label, several in bodies.items():
        for body in several:
            prf_hz = DOG_PRF_HZ if label == "dog" else 1000.0
            range_m = material.recording(body, prf_hz=prf_hz).truth[0].scatterers["range"].values
            extent_m = range_m.max(axis=1) - range_m.min(axis=1)
            note = f"R_t = {SPANS_M[label]:g} m; median over time {np.median(extent_m):.2f} m"
            readings.append(Reading(f"largest span, {body.about}", float(extent_m.max()), "m", note=note))
            too_long += [label] if extent_m.max() > SPANS_M[label] else []
    words = f"at full stride the points of a {' and of a '.join(dict.fromkeys(too_long))} spread further than the gate"
    held = "both hold all points of their target at all times"
    return EntryResult(
        None,
        readings,
        f"{summarise_readings(readings)}: the spans are a choice, not a measurement; {words if too_long else held}. "
        f"Taking "
        "the span by class reveals the class to the signature.",
        pd.DataFrame({"target": list(SPANS_M), "R_t (m)": list(SPANS_M.values())}),
    )


@entry(
    "fig-4.8",
    "Doppler limits of the gate",
    "The limits are the highest and lowest Doppler of all points, constant over the observation.",
)
def make_doppler_limits(material: Material) -> EntryResult:
    recording, result = walk(material)
    wavelength_m = recording.radar.wavelength_m
    figure = viz.doppler_lines(
        recording.truth[0].scatterers, wavelength_m=wavelength_m, title="Doppler limits of the gate"
    )
    low_hz, high_hz = result.gate.doppler_hz or (-np.inf, np.inf)
    for name, value in (("upper limit", high_hz), ("lower limit", low_hz)):
        figure.axes[0].axhline(value, color=ACCENT, ls="--", lw=1.4)
        figure.axes[0].annotate(
            f"{name} {value:.0f} Hz",
            (0.5, value),
            xycoords=("axes fraction", "data"),
            xytext=(0, 4 if value > 0 else -4),
            va="bottom" if value > 0 else "top",
            textcoords="offset points",
            color=ACCENT,
            ha="center",
        )
    figure.axes[0].margins(y=0.1)
    doppler_hz = recording.truth[0].doppler_hz(wavelength_m)
    readings = [
        Reading("B_H", high_hz, "Hz", note=f"highest of all points: {doppler_hz.max():.1f} Hz"),
        Reading("B_L", low_hz, "Hz", note=f"lowest of all points: {doppler_hz.min():.1f} Hz"),
    ]
    return judge(
        figure,
        readings,
        "the gate takes its limits from all true Doppler lines over the whole observation, so that "
        "the measured bandwidth is bounded by the truth; our own method does without such limits.",
    )


@entry(
    "fig-4.9",
    "Signature of a dog before and after the columns are normalised",
    "Without it the signal is much stronger on the right than on the left; dividing every column removes that.",
)
def make_normalisation(material: Material) -> EntryResult:
    dog = material.find_galloping_dog()
    recording = material.recording(dog, prf_hz=DOG_PRF_HZ)
    result = material.result(dog, prf_hz=DOG_PRF_HZ)
    figure = viz.signature_normalisation(result.signature, normalised=result.normalised_signature, db_range=40.0)
    range_m = recording.truth[0].centre_range_m
    tenth = max(1, range_m.size // 10)
    expected_db = 10.0 * np.log10((range_m[-tenth:] ** -4).mean() / (range_m[:tenth] ** -4).mean())
    rise_db = column_level_rise_db(result.signature)
    readings = [
        Reading(
            "rise from the first to the last tenth of the columns",
            rise_db,
            "dB",
            note=f"the fourth power of the range alone gives {expected_db:.1f} dB",
        ),
        compare_statement("stronger on the right before normalisation", rise_db > 0.0),
        Reading(
            "the same after normalisation",
            column_level_rise_db(result.normalised_signature),
            "dB",
            0.0,
            0.01,
            "by its definition",
            fixed=True,
        ),
    ]
    return judge(
        figure,
        readings,
        f"the signature changes by {rise_db:+.1f} dB towards the right, {expected_db:+.1f} dB of it "
        "by the radar equation, and is even once every column is divided by its maximum.",
    )


FloatArray = npt.NDArray[np.float64]

LINE_REACH_HZ = 15.0
"""Half width of a line: the window's full half-power width is 13.7 Hz, its full width at t_mu 28.6 Hz."""
SMOOTHING_S = 0.03


@entry(
    "fig-4.10",
    "True Doppler of all points, and the signature of the same walk",
    "The signature should resemble the true lines as closely as possible; the torso is strongest and "
    "varies least, the saw "
    "teeth above and below are the legs, the ankle of which reaches about 300 Hz (Fig. 2.16).",
)
def make_lines_and_signature(material: Material) -> EntryResult:
    recording, result = walk(material)
    lines = viz.scatterer_doppler(recording.truth[0].scatterers, wavelength_m=recording.radar.wavelength_m)
    stride_s = 1.0 / recording.truth[0].stride_frequency_hz
    first_s, last_s = stride_s, 2.0 * stride_s
    doppler_hz = recording.truth[0].doppler_hz(recording.radar.wavelength_m)
    limits_hz = float(doppler_hz.min()) - 50.0, float(doppler_hz.max()) + 50.0
    figure, (left, right) = make_panels(2, height_in=5.6)
    title = "(a) true Doppler frequency of every point"
    wavelength_m = recording.radar.wavelength_m
    viz.doppler_lines(recording.truth[0].scatterers, wavelength_m=wavelength_m, title=title, ax=left)
    left.set(xlim=(first_s, last_s), ylim=limits_hz)
    place_legend_below(figure, left)
    title = "(b) micro-Doppler signature"
    viz.signature(result.normalised_signature, db_range=30.0, doppler_hz=limits_hz, title=title, ax=right)
    right.set_xlim(first_s, last_s)
    top_hz = upper_envelope_hz(result.normalised_signature, ENVELOPE)
    inside = slice(100, -100)  # ends are zero-padded
    true_top_hz = doppler_hz.max(axis=1)
    ankle = read_axis(recording.truth[0].scatterers, "marker").tolist().index("right_ankle")
    readings = [
        Reading("peak Doppler of the right ankle", float(doppler_hz[:, ankle].max()), "Hz", 300.0, 15.0),
        Reading(
            "share of the signature's power within 15 Hz of a true line",
            share_near_lines(
                result.normalised_signature, doppler_hz, read_axis(lines, "slow_time"), reach_hz=LINE_REACH_HZ
            ),
            "1",
        ),
        Reading(
            "upper edge of the signature over the true highest line, median",
            float(np.median((top_hz - true_top_hz)[inside])),
            "Hz",
            note="a single line is 28.6 Hz wide at t_mu, so up to 14 Hz belong to the window",
        ),
    ]
    return judge(
        figure,
        readings,
        f"{100.0 * readings[1].ours:.0f} % of the signature's power lies within {LINE_REACH_HZ:g} Hz "
        "of a true line, about the width of the window.",
    )


@entry(
    "fig-4.11",
    "Signature of five gait cycles with its parts named",
    "Five gait cycles are ten steps, one peak each; the main line oscillates at twice the gait frequency.",
)
def make_five_cycles(material: Material) -> EntryResult:
    recording, result = walk(material)
    mu, truth = result.normalised_signature, recording.truth[0]
    rate_hz = measure_column_rate_hz(mu)
    top_hz, bottom_hz = (
        upper_envelope_hz(mu, ENVELOPE),
        -upper_envelope_hz(
            mu.isel(doppler=slice(None, None, -1)).assign_coords(doppler=-read_axis(mu, "doppler")[::-1]), ENVELOPE
        ),
    )
    steps = find_peaks(top_hz, rate_hz, smoothing_s=SMOOTHING_S)
    torso_hz = torso_line_hz(mu, reach_hz=40.0)
    figure, axes = make_axes()
    viz.signature(mu, db_range=30.0, title="Five gait cycles", ax=axes)
    axes.plot(read_axis(mu, "time"), torso_hz, color=LINE_COLOURS[0], lw=1.2)
    _mark_parts(axes, read_axis(mu, "time")[steps], torso_hz, float(np.quantile(top_hz, 0.98)), float(bottom_hz.min()))
    observed_s = mu.sizes["time"] / rate_hz
    swing = main_frequency_hz(torso_hz, rate_hz)
    readings = [
        Reading("steps: peaks of the upper edge", float(steps.size), "1", 10.0, 0.0),
        Reading("gait cycles in the observation", observed_s * truth.stride_frequency_hz, "1", 5.0, 0.01, fixed=True),
        Reading(
            "oscillation of the main line over the gait frequency",
            swing / truth.stride_frequency_hz,
            "1",
            2.0,
            0.1,
            "a line oscillates at whole multiples; a tenth is what a record of five cycles resolves",
        ),
        Reading("mean of the main line", float(torso_hz.mean()), "Hz", TORSO_HZ, TORSO_READ_HZ),
        Reading("from the highest to the lowest edge (label 4)", float(top_hz.max() - bottom_hz.min()), "Hz"),
    ]
    return judge(
        figure,
        readings,
        f"{steps.size} steps in {readings[1].ours:.0f} gait cycles, and a main line that oscillates "
        f"{readings[2].ours:.1f} times a cycle. Labels as in the report: 1 main line, 2 gait cycle, 3 step, "
        "4 bandwidth, 5 width of the main line, 6 zero Doppler.",
    )


def _mark_parts(axes: Axes, step_s: FloatArray, torso_hz: FloatArray, top_hz: float, bottom_hz: float) -> None:
    """Draw the labels (1) to (6) of the report."""
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
    plot_numbered_marks(axes, marks)
