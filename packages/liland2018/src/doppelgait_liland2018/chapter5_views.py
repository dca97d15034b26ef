"""Chapter 5: galloping dog and other directions."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pandas as pd
from matplotlib.figure import Figure

from doppelgait import Streams, viz
from doppelgait.motion import Motion, loop
from doppelgait.motion.models import quadruped_gait
from doppelgait.pipeline import Result, analyze, simulate
from doppelgait.processing import Analysis
from doppelgait.radar import Recording
from doppelgait.scene import RcsSpec, Scene, Target
from doppelgait_liland2018.chapter4 import ENVELOPE
from doppelgait_liland2018.chapter4_features import bin_hz, found_hz
from doppelgait_liland2018.chapter5 import format_number
from doppelgait_liland2018.drawing import plot_cadence_amplitude, plot_mean_doppler
from doppelgait_liland2018.entry import EntryResult, Reading, compare_statement, entry, judge
from doppelgait_liland2018.material import RUNS, Material, NamedMotion
from doppelgait_liland2018.measures import (
    doppler_to_velocity_mps,
    read_axis,
    torso_line_hz,
    travel_speed_mps,
    upper_envelope_hz,
)
from doppelgait_liland2018.scenarios import RCS_M2, WRONG
from doppelgait_liland2018.style import LINE_COLOURS, make_figure, make_panels, place_legend_below

REPORT_DOPPLER_HZ = 263.0
DOG_WITHERS_M = 0.5
SECONDS = 1.3
PRF_HZ = 1491.0
"""The report's 1938 frames in 1.3 s (its Fig. 3.14)."""


def find_fast_dog(material: Material) -> NamedMotion:
    """Return the fastest recorded galloping dog, or a model."""
    recorded = [one for one in material.dogs() if one.real and one.gait in RUNS]
    if recorded:
        return material.use(max(recorded, key=lambda one: travel_speed_mps(one.motion)))
    speed_mps = float(doppler_to_velocity_mps(REPORT_DOPPLER_HZ, material.radar().wavelength_m))

    def make() -> NamedMotion:
        motion = quadruped_gait(gait="gallop", speed_mps=speed_mps, withers_m=DOG_WITHERS_M, duration_s=SECONDS)
        return NamedMotion(f"galloping dog, {DOG_WITHERS_M} m, {speed_mps:.2f} m/s", "dog", motion)

    return material.use(material.compute_once("fast dog", make))


@entry(
    "fig-5.2",
    "Range of every point of the galloping dog",
    "The one usable recording of a dog: two gait cycles of gallop in a straight line.",
)
def make_ranges(material: Material) -> EntryResult:
    dog = material.find_galloping_dog()
    recording = material.recording(dog, prf_hz=PRF_HZ)
    truth = recording.truth[0]
    figure = viz.range_lines(truth.scatterers, title="Range of every point of a galloping dog")
    line = np.polyfit(np.arange(truth.centre_range_m.size) / PRF_HZ, truth.centre_range_m, 1)
    off_m = truth.centre_range_m - np.polyval(line, np.arange(truth.centre_range_m.size) / PRF_HZ)
    readings = [
        Reading(
            "gait cycles in it",
            truth.stride_frequency_hz * dog.seconds,
            "1",
            note="the report's recording holds 2; this one is as long as it is",
        ),
        Reading("radial speed", float(-line[0]), "m/s", note="the report: about 3 m/s read off its Fig. 2.20"),
        Reading("largest departure of the body from a straight line", float(np.abs(off_m).max()), "m"),
    ]
    return judge(
        figure,
        readings,
        f"the body keeps to a straight line within {readings[2].ours:.2f} m. It is another dog than "
        "the report's, so there is no number to compare.",
    )


@entry(
    "fig-5.7",
    "Features of the galloping dog",
    "f_m comes out at 2.98 Hz, which the report takes for an error, since it expects about 6 Hz; f_2 is 6.05 Hz, "
    "B_mu 607 Hz, the height 0.79 and f_d 263 Hz.",
)
def make_features(material: Material) -> EntryResult:
    dog = find_fast_dog(material)
    recording, result = material.recording(dog, prf_hz=PRF_HZ), material.result(dog, prf_hz=PRF_HZ)
    ours = material.result(dog, prf_hz=PRF_HZ, method="standard")
    figure = _plot_five_panels(recording, result)
    stride_hz = recording.truth[0].stride_frequency_hz
    first, second, _ = found_hz(result)
    other = "another dog" if dog.real else "a model stands in for the dog"
    readings = [
        Reading(
            "f_m by the report's method",
            format_number(first),
            "Hz",
            note=f"the report: 2.98 Hz; true stride frequency {stride_hz:.2f} Hz, a bin is {bin_hz(result):.2f} "
            f"Hz; {other}",
        ),
        Reading("f_2 by the report's method", format_number(second), "Hz", note="the report: 6.05 Hz"),
        Reading("f_m by ours", format_number(ours.gait_frequency_hz), "Hz"),
        Reading(
            "f_m over the stride frequency",
            format_number(first) / stride_hz,
            "1",
            note="1: what was found is the stride",
        ),
        Reading("B_mu", format_number(result.features.doppler_bandwidth_hz), "Hz", note="the report: 607 Hz"),
        Reading("A_fd", float(result.quality["torso_amplitude"]), "1", note="the report: 0.79"),
        Reading(
            "f_d",
            format_number(result.torso_doppler_hz),
            "Hz",
            note="the report: 263 Hz; "
            + ("another dog at another speed" if dog.real else "the speed was taken from it"),
        ),
        Reading(
            "speed that 263 Hz stand for",
            float(doppler_to_velocity_mps(REPORT_DOPPLER_HZ, recording.radar.wavelength_m)),
            "m/s",
            3.0,
            0.5,
            "the report reads about 3 m/s off its Fig. 2.20 for the same dog: its numbers contradict each other",
        ),
    ]
    return judge(figure, readings, _judge_peak(format_number(first), stride_hz, bin_hz(result)))


def _judge_peak(found: float, stride_hz: float, width_hz: float) -> str:
    """Judge the report's 2.98 Hz by the highest peak."""
    if math.isclose(found, stride_hz, abs_tol=0.6 * width_hz):
        return (
            "another dog, hence its f_m, f_2, B_mu, A_fd and f_d are not compared. The highest peak here is at the "
            "stride frequency, with which a gallop repeats. The report calls its 2.98 Hz an error for 6.05 Hz; by "
            "this dog it may be the stride, and 6.05 Hz its second harmonic, but the report's recording is not "
            "available to decide this."
        )
    return (
        f"another dog, hence its f_m, f_2, B_mu, A_fd and f_d are not compared. The highest peak here, {found:.2f} "
        f"Hz, is not at the stride frequency of {stride_hz:.2f} Hz, so this dog does not show whether the 2.98 Hz "
        "that the report calls an error is the stride of its own."
    )


def _plot_five_panels(recording: Recording, result: Result) -> Figure:
    figure = make_figure(width_in=15.0, height_in=8.6)
    grid = figure.add_gridspec(2, 6)
    wavelength_m = recording.radar.wavelength_m
    true_hz = recording.truth[0].doppler_hz(wavelength_m)
    limits_hz = float(true_hz.min()) - 40.0, float(true_hz.max()) + 40.0
    upper = [figure.add_subplot(grid[0, 2 * n : 2 * n + 2]) for n in range(3)]
    lower = [figure.add_subplot(grid[1, 2 * n : 2 * n + 2]) for n in range(3)]
    scatterers, title = recording.truth[0].scatterers, "(a) true Doppler frequencies"
    viz.doppler_lines(scatterers, wavelength_m=wavelength_m, title=title, ax=upper[0])
    upper[0].set_ylim(*limits_hz)
    place_legend_below(figure, upper[0])
    viz.signature(result.normalised_signature, db_range=30.0, doppler_hz=limits_hz, title="(b) signature", ax=upper[1])
    title = "(c) cadence-velocity diagram"
    viz.cadence_map(result.cadence_map, max_cadence_hz=20.0, db_range=30.0, title=title, ax=upper[2])
    upper[2].set_ylim(*limits_hz)
    plot_cadence_amplitude(
        lower[0],
        result.cadence_spectrum,
        found_hz(result),
        true_hz=recording.truth[0].gait_frequency_hz,
        title="sum of (c)",
    )
    plot_mean_doppler(lower[1], result, bandwidth=True, title="(d) mean Doppler spectrum, normalised")
    plot_mean_doppler(lower[2], result, title="(e) mean Doppler spectrum")
    return figure


VIEWS_PRF_HZ = 1000.0
ACROSS_RANGE_M = 8.0
LEG_M, LANE_M, CORNER_M = 4.0, 1.0, 0.4
START_M = (9.0, -1.5)
WALKED_SHARE = 0.9
"""Share of the path with sharp corners; rounded corners make it shorter."""
LEGS = 4
STILL_MPS = 0.3
SNR_DB = 20.0
"""SNR of the frames: the tracker needs a noise floor to detect a target."""


@entry(
    "fig-5.10",
    "The same walk across and along the line of sight",
    "At an aspect of 90 degrees the main line is near 0 Hz and the envelopes are far smaller than at 0 degrees.",
)
def make_aspect(material: Material) -> EntryResult:
    person = material.person()
    views = {
        90.0: material.result(person, prf_hz=VIEWS_PRF_HZ, aspect_deg=90.0, range_m=ACROSS_RANGE_M),
        0.0: material.result(person, prf_hz=VIEWS_PRF_HZ),
    }
    figure, axes = make_panels(2, height_in=5.0)
    highest_hz = float(upper_envelope_hz(views[0.0].normalised_signature, ENVELOPE).max()) + 60.0
    for letter, panel, (aspect, result) in zip("ab", axes, views.items(), strict=True):
        limits_hz, title = (-150.0, highest_hz), f"({letter}) aspect angle {aspect:.0f}°"
        viz.signature(result.normalised_signature, db_range=30.0, doppler_hz=limits_hz, title=title, ax=panel)
    widths = {aspect: format_number(result.features.doppler_bandwidth_hz) for aspect, result in views.items()}
    bin_hz = VIEWS_PRF_HZ / views[0.0].signature.sizes["doppler"]
    readings = [
        Reading("f_d across the line of sight", format_number(views[90.0].torso_doppler_hz), "Hz", 0.0, bin_hz),
        Reading("f_d along the line of sight", format_number(views[0.0].torso_doppler_hz), "Hz"),
        Reading("B_mu across", widths[90.0], "Hz"),
        Reading("B_mu along", widths[0.0], "Hz"),
        Reading("B_mu across over along", widths[90.0] / widths[0.0], "1", note="the report: far smaller envelopes"),
        compare_statement("B_mu smaller across than along", widths[90.0] < widths[0.0]),
    ]
    return judge(
        figure,
        readings,
        f"across the line of sight the main line is at {readings[0].ours:.0f} Hz and B_mu is "
        f"{readings[4].ours:.2f} of that along it. The report's caption repeats that of Fig. 5.1; its text says "
        "what is shown.",
    )


def to_and_fro(material: Material) -> tuple[Recording, Result, Result]:
    """Simulate and analyse a person on four parallel lanes."""
    person = material.person()

    def make() -> tuple[Recording, Result, Result]:
        scene, radar = make_lanes(person.motion), material.radar(prf_hz=VIEWS_PRF_HZ)
        noisy = simulate(scene, radar, rng=Streams(material.seed), snr_db=SNR_DB, angles=False)
        report = analyze(noisy, gate="truth", analysis=Analysis(method="liland2018", hop=5))[0]
        tracks = analyze(noisy, gate="track", analysis=Analysis(extended=False))
        ours = max(tracks, key=lambda one: one.gate.time_s.size)
        return noisy, report, ours

    return material.compute_once("to and fro", make)


def make_lanes(motion: Motion) -> Scene:
    """Make a scene of a walk along four lanes."""
    points = [(LEG_M * ((lane + end) % 2), LANE_M * lane) for lane in range(LEGS) for end in (0, 1)]
    way_m = LEGS * LEG_M + (LEGS - 1) * LANE_M
    walked = loop(motion, duration_s=2.0 * way_m / travel_speed_mps(motion), variation=0.0)
    seconds = WALKED_SHARE * way_m / travel_speed_mps(walked)
    target = Target(
        walked,
        label="human",
        rcs=RcsSpec(kind="equal", total_m2=RCS_M2["human"]),
        start_position_m=START_M,
        heading_deg=180.0,
        path={"kind": "polyline", "points_m": points, "corner_radius_m": CORNER_M},
    )
    return Scene([target], duration_s=seconds)


@entry(
    "fig-5.11",
    "Signature of a person who walks in several directions",
    "The main line changes sign, which makes it nearly impossible to find the step frequency; divided into four "
    "shorter observations it could be found, if they are not too short.",
)
def make_directions(material: Material) -> EntryResult:
    recording, report, ours = to_and_fro(material)
    true_hz = recording.truth[0].gait_frequency_hz
    figure = viz.signature(report.normalised_signature, db_range=25.0, title="A person who walks to and fro")
    segments = tabulate_segments(ours)
    for start_s, stop_s in zip(segments["from (s)"], segments["to (s)"], strict=True):
        figure.axes[0].axvspan(start_s, stop_s, ymin=0.97, color=LINE_COLOURS[0], lw=0)
    still_hz = STILL_MPS * 2.0 / recording.radar.wavelength_m
    line_hz = torso_line_hz(report.normalised_signature, reach_hz=VIEWS_PRF_HZ)
    changes = sign_changes(line_hz, still_hz)
    report_hz, error = format_number(report.gait_frequency_hz), (segments["f_m (Hz)"] / true_hz - 1.0).abs().max()
    readings = [
        Reading(
            "changes of direction that the main line shows",
            float(changes),
            "1",
            note=f"true {sign_changes(recording.truth[0].centre_velocity_mps, STILL_MPS)}",
        ),
        compare_statement("main line changes sign", changes > 0),
        Reading("f_m of the whole by the report's method", report_hz, "Hz", note=f"true {true_hz:.2f} Hz"),
        Reading("segments of steady motion found by ours", float(len(segments)), "1", note=f"{LEGS} lanes are walked"),
        Reading("segments with a known f_m", float(segments["f_m (Hz)"].notna().sum()), "1"),
        Reading("largest relative error of f_m in them", float(error), "1"),
    ]
    wrong = not abs(report_hz / true_hz - 1.0) < WRONG
    return judge(
        figure,
        readings,
        f"the main line changes sign {changes} times. The report's method takes the whole and finds "
        f"{report_hz:.2f} Hz, {'wrong' if wrong else 'right all the same'}; ours divides the observation by "
        "itself (bars at the top), as the report proposes, and without any truth.",
        segments,
    )


def tabulate_segments(result: Result) -> pd.DataFrame:
    """Tabulate the segments of steady motion of a track."""
    return pd.DataFrame(
        {
            "from (s)": float(read_axis(segment.signature, "time")[0]),
            "to (s)": float(read_axis(segment.signature, "time")[-1]),
            "v_m (m/s)": format_number(segment.features.torso_velocity_mps),
            "f_m (Hz)": format_number(segment.gait_frequency_hz),
        }
        for segment in result.segments or (result,)
    )


def sign_changes(values: npt.ArrayLike, still: float) -> int:
    """Count the sign changes of a curve."""
    curve = np.asarray(values, dtype=np.float64)
    return int(np.count_nonzero(np.diff(np.sign(curve[np.abs(curve) > still]))))
