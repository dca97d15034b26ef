"""Chapter 5 of the report: its galloping dog (Figs. 5.2 and 5.7)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from doppelgait import viz
from doppelgait.core.labels import axis
from doppelgait.core.units import doppler_to_velocity_mps
from doppelgait.motion.models import quadruped_gait
from doppelgait.motion.retime import travel_speed_mps
from doppelgait.reproduce.chapter4_features import bin_hz, found_hz
from doppelgait.reproduce.chapter5 import number
from doppelgait.reproduce.drawing import draw_cadence_amplitude, draw_mean_doppler
from doppelgait.reproduce.entry import Entry, Made, Reading, judged
from doppelgait.reproduce.material import RUNS, THRESHOLD
from doppelgait.reproduce.movers import Mover
from doppelgait.viz.body import draw_part_lines, part_lines
from doppelgait.viz.cadence import draw_step_doppler
from doppelgait.viz.maps import DOPPLER_LABEL
from doppelgait.viz.signatures import draw_signature
from doppelgait.viz.style import name_axes, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from doppelgait.pipeline import TargetResult
    from doppelgait.radar.recording import Recording
    from doppelgait.reproduce.material import Material

REPORT_DOPPLER_HZ = 263.0
DOG_WITHERS_M = 0.5
SECONDS = 1.3
PRF_HZ = 1491.0
"""The report's 1938 frames in 1.3 s (its Fig. 3.14)."""


def fast_dog(material: Material) -> Mover:
    """The fastest galloping dog at hand; else a model at the speed that the report's f_d = 263 Hz tells, 5.41 m/s."""
    recorded = [one for one in material.dogs() if one.real and one.gait in RUNS]
    if recorded:
        return material.use(max(recorded, key=lambda one: travel_speed_mps(one.motion)))
    speed_mps = float(doppler_to_velocity_mps(REPORT_DOPPLER_HZ, material.radar().wavelength_m))

    def make() -> Mover:
        motion = quadruped_gait(gait="gallop", speed_mps=speed_mps, withers_m=DOG_WITHERS_M, duration_s=SECONDS)
        return Mover(f"galloping dog, {DOG_WITHERS_M} m, {speed_mps:.2f} m/s", "dog", motion)

    return material.use(material.once("fast dog", make))


def make_ranges(material: Material) -> Made:
    """Fig. 5.2."""
    dog = material.galloping_dog()
    recording = material.recording(dog, prf_hz=PRF_HZ)
    truth = recording.truth[0]
    figure = viz.range_lines(truth.scatterers, title="Range of every point of a galloping dog")
    line = np.polyfit(np.arange(truth.centre_range_m.size) / PRF_HZ, truth.centre_range_m, 1)
    off_m = truth.centre_range_m - np.polyval(line, np.arange(truth.centre_range_m.size) / PRF_HZ)
    readings = [
        Reading("gait cycles in it", truth.stride_frequency_hz * dog.seconds, "1",
                note="the report's recording holds 2; this one is as long as it is"),
        Reading("radial speed", float(-line[0]), "m/s", note="the report: about 3 m/s read off its Fig. 2.20"),
        Reading("largest departure of the body from a straight line", float(np.abs(off_m).max()), "m"),
    ]  # fmt: skip
    return Made(
        figure, readings,
        judged(readings, f"the body keeps to a straight line within {readings[2].ours:.2f} m. It is another dog than "
               "the report's, so there is no number to compare."),
    )  # fmt: skip


def make_features(material: Material) -> Made:
    """Fig. 5.7."""
    dog = fast_dog(material)
    recording, result = material.recording(dog, prf_hz=PRF_HZ), material.result(dog, prf_hz=PRF_HZ)
    ours = material.result(dog, prf_hz=PRF_HZ, method="standard")
    figure = _five_panels(recording, result)
    stride_hz = recording.truth[0].stride_frequency_hz
    first, second, _ = found_hz(result)
    other = "another dog" if dog.real else "a model stands in for the dog"
    readings = [
        Reading("f_m by the report's method", number(first), "Hz",
                note=f"the report: 2.98 Hz; true stride frequency {stride_hz:.2f} Hz, a bin is {bin_hz(result):.2f} "
                     f"Hz; {other}"),
        Reading("f_2 by the report's method", number(second), "Hz", note="the report: 6.05 Hz"),
        Reading("f_m by ours", number(ours.gait_frequency_hz), "Hz"),
        Reading("f_m over the stride frequency", number(first) / stride_hz, "1",
                note="1: what was found is the stride"),
        Reading("B_mu", number(result.features.doppler_bandwidth_hz), "Hz", note="the report: 607 Hz"),
        Reading("A_fd", float(result.quality["torso_amplitude"]), "1", note="the report: 0.79"),
        Reading("f_d", number(result.torso_doppler_hz), "Hz",
                note="the report: 263 Hz; " + ("another dog at another speed" if dog.real else "the speed was taken "
                                               "from it")),
        Reading("speed that 263 Hz stand for",
                float(doppler_to_velocity_mps(REPORT_DOPPLER_HZ, recording.radar.wavelength_m)), "m/s", 3.0, 0.5,
                "the report reads about 3 m/s off its Fig. 2.20 for the same dog: its numbers contradict each other"),
    ]  # fmt: skip
    return Made(figure, readings, judged(readings, _whose_peak(number(first), stride_hz, bin_hz(result))))


def _whose_peak(found: float, stride_hz: float, width_hz: float) -> str:
    """What the highest peak here says, and does not say, about the report's 2.98 Hz."""
    if math.isclose(found, stride_hz, abs_tol=0.6 * width_hz):
        return (
            "another dog, hence its f_m, f_2, B_mu, A_fd and f_d are not compared. The highest peak here is at the "
            "stride frequency, with which a gallop repeats. The report calls its 2.98 Hz an error for 6.05 Hz; by "
            "this dog it may be the stride, and 6.05 Hz its second harmonic, but the report's recording is not at "
            "hand to tell."
        )
    return (
        f"another dog, hence its f_m, f_2, B_mu, A_fd and f_d are not compared. The highest peak here, {found:.2f} "
        f"Hz, is not at the stride frequency of {stride_hz:.2f} Hz, so this dog does not tell whether the 2.98 Hz "
        "that the report calls an error is the stride of its own."
    )


def _five_panels(recording: Recording, result: TargetResult) -> Figure:
    figure = new_figure(width_in=13.0, height_in=8.0)
    grid = figure.add_gridspec(2, 6)
    wavelength_m = recording.radar.wavelength_m
    lines = viz.scatterer_doppler(recording.truth[0].scatterers, wavelength_m=wavelength_m)
    true_hz = recording.truth[0].doppler_hz(wavelength_m)
    limits_hz = float(true_hz.min()) - 40.0, float(true_hz.max()) + 40.0
    upper = [figure.add_subplot(grid[0, 2 * n : 2 * n + 2]) for n in range(3)]
    lower = [figure.add_subplot(grid[1, 2 * n : 2 * n + 2]) for n in range(3)]
    draw_part_lines(upper[0], part_lines(lines), bold=1.6)
    times_s = axis(lines, "slow_time")
    upper[0].set(xlim=(times_s[0], times_s[-1]), ylim=limits_hz)
    name_axes(upper[0], title="(a) true Doppler", x="time (s)", y=DOPPLER_LABEL)
    draw_signature(upper[1], result.normalised_signature, db_range=30.0, doppler_hz=limits_hz)
    name_axes(upper[1], title="(b) signature, 30 dB", x="time (s)", y="")
    draw_step_doppler(
        upper[2], result.cadence_map, gait_frequency_hz=None, max_cadence_hz=20.0, db_range=30.0, doppler_hz=limits_hz
    )
    name_axes(upper[2], title="(c) step-Doppler map, 30 dB", x="step frequency (Hz)", y="")
    draw_cadence_amplitude(lower[0], result.cadence_spectrum, found_hz(result),
                           true_hz=recording.truth[0].gait_frequency_hz, title="D_g, sum of (c)")  # fmt: skip
    doppler_hz = axis(result.signature, "doppler")
    draw_mean_doppler(lower[1], result.mean_doppler_spectrum, doppler_hz, threshold=THRESHOLD, normalised=True,
                      title="(d) D_1 over its maximum")  # fmt: skip
    draw_mean_doppler(lower[2], result.mean_doppler_spectrum, doppler_hz, peak_hz=result.torso_doppler_hz,
                      title="(e) D_1")  # fmt: skip
    return figure


ENTRIES = (
    Entry(
        "fig-5.2", "Range of every point of the galloping dog",
        "The one usable recording of a dog: two gait cycles of gallop in a straight line.", make_ranges,
    ),
    Entry(
        "fig-5.7", "Features of the galloping dog",
        "f_m comes out at 2.98 Hz, which the report takes for an error, since it expects about 6 Hz; f_2 is 6.05 Hz, "
        "B_mu 607 Hz, the height 0.79 and f_d 263 Hz.", make_features,
    ),
)  # fmt: skip
