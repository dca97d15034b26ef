"""Chapter 4 of the report: cadence map and features."""

from __future__ import annotations

import numpy as np

from doppelgait import viz
from doppelgait.pipeline import Result
from doppelgait.processing import cadence_map
from doppelgait_liland2018.chapter4 import TORSO_HZ, TORSO_READ_HZ, walk
from doppelgait_liland2018.drawing import MAX_CADENCE_HZ, plot_cadence_amplitude, plot_mean_doppler
from doppelgait_liland2018.entry import EntryResult, Reading, compare_statement, entry, format_judgement, judge
from doppelgait_liland2018.material import THRESHOLD, Material
from doppelgait_liland2018.measures import HARMONICS, doppler_to_velocity_mps, prominence_db, read_axis
from doppelgait_liland2018.style import make_axes, make_panels

HARMONIC_NAMES = ("f_m", "f_2", "f_3")
RATIO_BIN = 0.1
"""Bin of 1 / T_o over f_m in the report's five gait cycles, which are ten steps."""


def found_hz(result: Result) -> list[float | None]:
    """Return f_m, f_2 and f_3 of a result."""
    fundamental, ratios = result.gait_frequency_hz, result.features
    if fundamental is None:
        return [None, None, None]
    higher = (ratios.harmonic_ratio_2, ratios.harmonic_ratio_3)
    return [fundamental, *(None if ratio is None else ratio * fundamental for ratio in higher)]


def bin_hz(result: Result) -> float:
    """Return the cadence spectrum's bin, 1 / T_o."""
    return float(read_axis(result.cadence_spectrum, "cadence")[1])


@entry(
    "fig-4.12",
    "Cadence-velocity diagram up to 20 Hz",
    "The mean Doppler is about +100 Hz, hence v_m about 2 m/s. The constant part is far stronger than the step "
    "frequency f_m and its harmonics f_2 and f_3.",
)
def make_step_doppler(material: Material) -> EntryResult:
    recording, result = walk(material)
    with_constant = cadence_map(result.normalised_signature, padded=False, tapered=False)
    figure = viz.cadence_map(
        with_constant,
        gait_frequency_hz=result.gait_frequency_hz,
        max_cadence_hz=MAX_CADENCE_HZ,
        db_range=40.0,
        title="Cadence-velocity diagram, 0 Hz included",
    )
    constant = with_constant.values[0]
    torso_hz = float(read_axis(with_constant, "doppler")[int(constant.argmax())])
    wavelength_m = recording.radar.wavelength_m
    step_hz = recording.truth[0].gait_frequency_hz
    at_step = with_constant.values[abs(read_axis(with_constant, "cadence") - step_hz).argmin()]
    readings = [
        Reading("Doppler of the strongest constant row", torso_hz, "Hz", TORSO_HZ, TORSO_READ_HZ),
        Reading(
            "v_m from it",
            float(doppler_to_velocity_mps(torso_hz, wavelength_m)),
            "m/s",
            note="the report: about 2 m/s, the same number as its 100 Hz; true mean "
            f"{recording.truth[0].centre_velocity_mps.mean():.2f} m/s; a row is "
            f"{float(doppler_to_velocity_mps(recording.radar.prf_hz / constant.size, wavelength_m)):.2f} m/s wide",
        ),
        Reading(
            "largest value at 0 Hz over the largest at the step frequency",
            float(constant.max() / at_step.max()),
            "1",
            note="the report: much higher; it gives no number",
        ),
        compare_statement("constant part above the step frequency", constant.max() > at_step.max()),
    ]
    return judge(
        figure,
        readings,
        f"the constant part stands at {torso_hz:+.0f} Hz and is {readings[2].ours:.1f} times as high "
        "as what there is at the step frequency.",
    )


@entry(
    "fig-4.13",
    "Cadence spectrum D_g with f_m, f_2 and f_3",
    "Summed over Doppler and without the mean of every row, the spectrum has peaks at the step frequency and at "
    "twice and three times it.",
)
def make_cadence_spectrum(material: Material) -> EntryResult:
    recording, result = walk(material)
    true_hz = recording.truth[0].gait_frequency_hz
    figure, axes = make_axes(height_in=4.6)
    plot_cadence_amplitude(axes, result.cadence_spectrum, found_hz(result), true_hz=true_hz, title="Cadence spectrum")
    step = found_hz(result)[0]
    readings = [
        Reading(
            "f_m",
            float("nan") if step is None else step,
            "Hz",
            note=f"true {true_hz:.3f} Hz, a bin is {bin_hz(result):.3f} Hz",
        ),
        *(
            Reading(
                f"{name} / f_m",
                float("nan") if value is None or step is None else value / step,
                "1",
                float(h),
                RATIO_BIN,
                "within a bin of 1 / T_o",
            )
            for h, name, value in zip(HARMONICS[1:], HARMONIC_NAMES[1:], found_hz(result)[1:], strict=True)
        ),
        *(
            Reading(f"prominence of {name}", prominence_db(result.cadence_spectrum, true_hz, h), "dB")
            for h, name in zip(HARMONICS, HARMONIC_NAMES, strict=True)
        ),
    ]
    return judge(
        figure,
        readings,
        f"the peaks stand out by {', '.join(f'{one.ours:.0f}' for one in readings[-3:])} dB. Once the "
        "mean is taken off every row there is no peak of f_0 left, unlike what the report's text says of its "
        "figure.",
    )


@entry(
    "fig-4.14",
    "Constant part D_1 with the Doppler f_d of the torso",
    "The highest value A_fd of the first column lies at the torso's Doppler f_d.",
)
def make_first_column(material: Material) -> EntryResult:
    recording, result = walk(material)
    figure, (axes,) = make_panels(1, width_in=10.5)
    plot_mean_doppler(axes, result, title="Mean Doppler spectrum")
    ours = material.result(material.make_walker(), method="standard", prf_hz=1000.0)
    true_mps = float(recording.truth[0].centre_velocity_mps.mean())
    readings = [
        Reading("f_d", float(result.torso_doppler_hz or float("nan")), "Hz", TORSO_HZ, TORSO_READ_HZ),
        Reading("A_fd", float(result.quality["torso_amplitude"]), "1"),
        Reading(
            "v_m by the report's method",
            float(result.features.torso_velocity_mps or float("nan")),
            "m/s",
            note=f"true {true_mps:.2f} m/s",
        ),
        Reading(
            "v_m by ours",
            float(ours.features.torso_velocity_mps or float("nan")),
            "m/s",
            note=f"true {true_mps:.2f} m/s; equal cross sections of all 17 points hide the torso, by body part it "
            "is the strongest",
        ),
    ]
    return EntryResult(
        figure,
        readings,
        f"{format_judgement(readings, '')}the highest value lies at {readings[0].ours:.0f} Hz. Its height is below 1 "
        f"because "
        "the torso is not the strongest part in every column; the report's heights (0.79 for its dog) fit this "
        "normalisation only.",
    )


@entry(
    "fig-4.15",
    "Micro-Doppler bandwidth from D_1",
    "The bandwidth goes from the first to the last crossing of 0.04 of the maximum, a threshold found best by trial.",
)
def make_bandwidth(material: Material) -> EntryResult:
    recording, result = walk(material)
    figure, (axes,) = make_panels(1, width_in=10.5)
    title = f"Mean Doppler spectrum, normalised; dashed: threshold {THRESHOLD:g}"
    plot_mean_doppler(axes, result, bandwidth=True, title=title)
    doppler_hz = recording.truth[0].doppler_hz(recording.radar.wavelength_m)
    ours = material.result(material.make_walker(), method="standard", prf_hz=1000.0)
    readings = [
        Reading("threshold t_mu", THRESHOLD, "1", 0.04, 0.0, fixed=True),
        Reading(
            "B_mu by the report's method",
            float(result.features.doppler_bandwidth_hz or float("nan")),
            "Hz",
            note=f"true span of all points {doppler_hz.max() - doppler_hz.min():.0f} Hz",
        ),
        Reading(
            "B_mu by ours (edges of the signature)", float(ours.features.doppler_bandwidth_hz or float("nan")), "Hz"
        ),
    ]
    return judge(
        figure,
        readings,
        f"the band of {readings[1].ours:.0f} Hz compares with a true span of {np.ptp(doppler_hz):.0f} "
        "Hz; all 17 points are equally strong here, and what a foot reaches for moments only is averaged away.",
    )
