"""Chapter 5: parameters of slow and fast walkers."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from doppelgait import viz
from doppelgait.pipeline import Result
from doppelgait.radar import Recording
from doppelgait_liland2018.chapter4 import ENVELOPE
from doppelgait_liland2018.chapter4_features import HARMONIC_NAMES, bin_hz, found_hz
from doppelgait_liland2018.drawing import plot_cadence_amplitude, plot_mean_doppler
from doppelgait_liland2018.entry import EntryResult, Reading, compare_statement, entry, format_judgement, judge
from doppelgait_liland2018.material import STEEPNESS, THRESHOLD, Material, NamedMotion
from doppelgait_liland2018.measures import (
    CLEAR_DB,
    HARMONICS,
    prominence_db,
    read_axis,
    side_lobe_of_cadence_db,
    travel_speed_mps,
)
from doppelgait_liland2018.style import make_panels, place_legend_below

PRF_HZ = 1300.0
"""Frame rate, Hz, of all four targets, the maximum in the report: nothing aliases, and all spectra have equal bins."""
SLOW_WALKER_MPS, FAST_WALKER_MPS = 0.8, 2.4
NAMES = ("person, slow", "person, fast", "walker, slow", "walker, fast")
SAME = 0.25
"""Relative difference up to which heights count as much the same."""
NAN = math.nan
REPORT_RADAR = {
    "carrier_hz": ("carrier frequency f_c", 7.29, "GHz", 1e9),
    "sample_rate_hz": ("sampling frequency f_s", 23.328, "GHz", 1e9),
    "receiver_gain_db": ("receiver gain G_rx", 10.0, "dB", 1.0),
    "tx_gain_dbi": ("transmit antenna gain G_t", 4.0, "dBi", 1.0),
    "rx_gain_dbi": ("receive antenna gain G_r", 4.0, "dBi", 1.0),
    "pulse_sigma_s": ("pulse duration tau", 1.0, "ns", 1e-9),
    "tx_power_dbm": ("peak transmit power P_t", 0.0, "dBm", 1.0),
    "transmit_phase_rad": ("phase theta of the pulse", 0.0, "rad", 1.0),
}
"""Its Table 5.1 by parameter: words, value, unit and that unit in ours."""


def format_number(value: float | None) -> float:
    """Return a feature as a number, NaN where unknown."""
    return NAN if value is None else float(value)


def analyze_four(material: Material) -> list[tuple[str, NamedMotion, Recording, Result]]:
    """Analyse slow and fast persons and walkers."""
    people = material.people()
    fast = material.use(max(people, key=lambda one: travel_speed_mps(one.motion)))
    bodies = [
        material.person(),
        fast,
        material.make_walker(SLOW_WALKER_MPS, cycles=5),
        material.make_walker(FAST_WALKER_MPS, cycles=6),
    ]
    return [
        (name, body, material.recording(body, prf_hz=PRF_HZ), material.result(body, prf_hz=PRF_HZ))
        for name, body in zip(NAMES, bodies, strict=True)
    ]


def _plot_four_panels(
    material: Material, draw: Callable[[Axes, Recording, Result], None], *, height_in: float = 7.6
) -> Figure:
    figure, axes = make_panels(2, 2, height_in=height_in)
    for letter, panel, (name, body, recording, result) in zip("abcd", axes, analyze_four(material), strict=True):
        draw(panel, recording, result)
        speed = f"{travel_speed_mps(body.motion):.1f} m/s"
        panel.set_title(f"({letter}) {name}, {speed}", fontsize=11, loc="left")
    return figure


def _plot_four_spectra(material: Material, *, bandwidth: bool = False) -> Figure:
    """Plot D_1 of the four, with the torso's peak or the bandwidth."""

    def draw(axes: Axes, recording: Recording, result: Result) -> None:
        plot_mean_doppler(axes, result, bandwidth=bandwidth)

    return _plot_four_panels(material, draw)


@entry(
    "table-5.1",
    "Parameters of the radar",
    "An X4: 7.29 GHz, 23.328 GS/s, 4 dBi antennas, 10 dB gain, 1 ns, 0 dBm; frame rates of 300 to 1300 Hz, chosen "
    "for each scenario as low as aliasing allows. 300 Hz are said to limit speeds to 6 m/s.",
)
def make_radar_table(material: Material) -> EntryResult:
    radar = material.radar()
    readings = [
        Reading(words, float(getattr(radar, name)) / scale, unit, value, 1e-9, fixed=True)
        for name, (words, value, unit, scale) in REPORT_RADAR.items()
    ]
    readings += [
        Reading(
            "highest speed that does not alias at 300 Hz",
            radar.model_copy(update={"prf_hz": 300.0}).unambiguous_velocity_mps,
            "m/s",
            6.0,
            0.5,
            "6.2 m/s is the whole span from -3.1 to +3.1 m/s; a walking foot exceeds it",
        ),
        Reading(
            "bandwidth at -3 dB of the pulse",
            radar.pulse_bandwidth_hz(3) / 1e9,
            "GHz",
            1.0,
            0.05,
            "a Gaussian of 1 ns standard deviation has 0.265 / tau; 1 GHz would take 0.265 ns",
        ),
    ]
    return judge(
        None,
        readings,
        f"the parameters themselves were set. Of what the report concludes from them, 300 Hz is "
        f"unambiguous to {readings[-2].ours:.1f} m/s, and a pulse of 1 ns has {readings[-1].ours:.3f} GHz.",
    )


@entry("table-5.2", "Parameters of the feature extraction", "T_d = 0.1 s, sigma_w = 0.4, t_mu = 0.04.")
def make_analysis_table(material: Material) -> EntryResult:
    result = analyze_four(material)[0][3]
    cpi_s = result.signature.attrs["cpi_pulses"] / PRF_HZ
    readings = [
        Reading(
            "coherent processing interval T_d", cpi_s, "s", 0.1, 1.0 / PRF_HZ, "an odd number of frames", fixed=True
        ),
        Reading("steepness sigma_w", STEEPNESS, "1", 0.4, 0.0, fixed=True),
        Reading("threshold t_mu", THRESHOLD, "1", 0.04, 0.0, fixed=True),
    ]
    return judge(None, readings, "these are the parameters of all figures of this chapter.")


@entry(
    "fig-5.1",
    "Range of every point: a recorded person and the walker",
    "Both look alike, with the same oscillations of arms and feet; recordings have 30 to 70 markers, the walker "
    "17, and so give a more diffuse signature.",
)
def make_ranges(material: Material) -> EntryResult:
    bodies = (material.person(), material.make_walker(SLOW_WALKER_MPS, cycles=5))
    figure, axes = make_panels(2, height_in=5.4)
    counts, swings = [], []
    for letter, panel, body in zip("ab", axes, bodies, strict=True):
        truth = material.recording(body, prf_hz=PRF_HZ).truth[0]
        scatterers = truth.scatterers
        viz.range_lines(scatterers, title=f"({letter}) {body.about}"[:80], ax=panel)
        panel.legend_ = None
        counts.append(scatterers.sizes["scatterer"])
        # Span of the distance of a foot ahead of the body centre; NaN where no foot is known.
        feet = [n for n, part in enumerate(read_axis(scatterers, "part")) if str(part).endswith("_foot")]
        ahead_m = truth.centre_range_m[:, None] - scatterers["range"].values[:, feet]
        swings.append(float((ahead_m.max(axis=0) - ahead_m.min(axis=0)).mean()) if feet else NAN)
    place_legend_below(figure, axes[0])
    stands_in = "" if bodies[0].real else "; a model of 17 points stands in"
    readings = [
        Reading("points of the recorded person", float(counts[0]), "1", 50.0, 20.0, "the report: 30 to 70" + stands_in),
        Reading("points of the walker", float(counts[1]), "1", 17.0, 0.0, fixed=True),
        *(
            Reading(f"swing of the feet about the body, {name}", swing, "m")
            for name, swing in zip(("person", "walker"), swings, strict=True)
        ),
    ]
    return EntryResult(
        figure,
        readings,
        format_judgement(
            readings, f"the feet swing about the body by {swings[0]:.2f} m (person) and {swings[1]:.2f} m (walker)."
        )
        + (
            ""
            if bodies[0].real
            else " Without recordings a model stands in for the person and has no more points than "
            "the walker; --motion-folder brings the dense bundle of lines of a real one."
        ),
    )


@entry(
    "fig-5.3",
    "Signatures of two people and two walkers, slow and fast",
    "The faster ones have their main line at a higher Doppler; the observation is as long as the recording.",
)
def make_signatures(material: Material) -> EntryResult:
    results = analyze_four(material)

    def draw(axes: Axes, recording: Recording, result: Result) -> None:
        viz.signature(result.normalised_signature, db_range=30.0, ax=axes)

    figure = _plot_four_panels(material, draw)
    panels = figure.axes[:4]
    low_hz, high_hz = (pick(axes.get_ylim()[end] for axes in panels) for end, pick in ((0, min), (1, max)))
    for axes in panels:
        axes.set_ylim(low_hz, high_hz)
    readings = []
    for name, _, recording, result in results:
        body_hz = float(2.0 * recording.truth[0].centre_velocity_mps.mean() / recording.radar.wavelength_m)
        note = f"true mean of the body {body_hz:.0f} Hz"
        readings.append(Reading(f"main line, {name}", format_number(result.torso_doppler_hz), "Hz", note=note))
    readings += [
        Reading(
            f"part of the signature above {ENVELOPE:g} of its column, {name}",
            float((result.normalised_signature.values >= ENVELOPE).mean()),
            "1",
        )
        for name, _, _, result in results
    ]
    readings += _compare_speeds(
        "main line at a higher Doppler for the faster", [reading.ours for reading in readings[:4]]
    )
    return judge(figure, readings, "the main lines of slow and fast are compared, pair by pair.")


def _compare_speeds(words: str, values: list[float]) -> list[Reading]:
    """Compare values of fast and slow walkers."""
    return [
        compare_statement(f"{words}, {kind}", values[slow + 1] > values[slow])
        for kind, slow in (("person", 0), ("walker", 2))
    ]


@entry(
    "fig-5.4",
    "Cadence spectra of the four",
    "The walkers have lower side lobes, for they are observed over more gait cycles; for the people the harmonics "
    "hardly stand out, least for the fast one. f_m is the same for both walkers, since the model is said to keep "
    "its step frequency.",
)
def make_step_spectra(material: Material) -> EntryResult:
    results = analyze_four(material)

    def draw(axes: Axes, recording: Recording, result: Result) -> None:
        true_hz = recording.truth[0].gait_frequency_hz
        plot_cadence_amplitude(axes, result.cadence_spectrum, found_hz(result), true_hz=true_hz, max_cadence_hz=12.0)

    figure = _plot_four_panels(material, draw)
    readings = []
    for name, _, recording, result in results:
        true_hz = recording.truth[0].gait_frequency_hz
        readings.append(
            Reading(
                f"f_m, {name}",
                format_number(found_hz(result)[0]),
                "Hz",
                note=f"true {true_hz:.2f} Hz; a bin is {bin_hz(result):.2f} Hz",
            )
        )
    sides = [side_lobe_of_cadence_db(one[3].cadence_spectrum, one[2].truth[0].gait_frequency_hz) for one in results]
    readings += [
        Reading(f"side lobes between f_m and f_2, {name}", side, "dB") for name, side in zip(NAMES, sides, strict=True)
    ]
    readings += [
        compare_statement(
            f"side lobes of the {NAMES[walker]} below those of the {NAMES[person]}", sides[walker] < sides[person]
        )
        for walker in (2, 3)
        for person in (0, 1)
    ]
    # Prominence of f_2 and f_3 of the fast person: the report finds both hidden.
    name, _, recording, result = results[1]
    for harmonic, words in list(zip(HARMONICS, HARMONIC_NAMES, strict=True))[1:]:
        level_db = prominence_db(result.cadence_spectrum, recording.truth[0].gait_frequency_hz, harmonic)
        readings += [
            Reading(f"prominence of {words}, {name}", level_db, "dB"),
            compare_statement(
                f"{words} hidden, {name}", level_db < CLEAR_DB, note=f"hidden: stands out by less than {CLEAR_DB:g} dB"
            ),
        ]
    slow, fast = (results[n][2].truth[0].gait_frequency_hz for n in (2, 3))
    readings.append(
        Reading(
            "step frequency of the fast walker over that of the slow one",
            fast / slow,
            "1",
            1.0,
            0.02,
            "the stride rate of the published model is proportional to the root of the speed; the "
            "report seems to have kept it constant",
        )
    )
    return judge(
        figure,
        readings,
        "a rectangular record has side lobes of -13.3 dB however long it is, what changes is how far "
        "off they are. In the published model the walkers' step frequency rises with speed.",
    )


@entry(
    "fig-5.5",
    "Doppler f_d and height A_fd of the torso for the four",
    "f_d is lower for the slow ones; A_fd is much the same for all, which is put down to equal cross sections.",
)
def make_torso_lines(material: Material) -> EntryResult:
    results = analyze_four(material)
    figure = _plot_four_spectra(material)
    readings = [Reading(f"f_d, {name}", format_number(result.torso_doppler_hz), "Hz") for name, _, _, result in results]
    heights = [float(result.quality["torso_amplitude"]) for *_, result in results]
    readings += [Reading(f"A_fd, {name}", height, "1") for name, height in zip(NAMES, heights, strict=True)]
    readings.append(
        Reading("largest over smallest A_fd", max(heights) / min(heights), "1", note="the report: much the same")
    )
    readings.append(
        compare_statement(
            f"A_fd much the same, within {100 * SAME:.0f} % of each other",
            max(heights) / min(heights) <= 1.0 + SAME,
            note="the report gives no number for it",
        )
    )
    readings += _compare_speeds("f_d higher for the faster", [reading.ours for reading in readings[:4]])
    return EntryResult(
        figure,
        readings,
        format_judgement(
            readings,
            f"the heights differ by a factor of {max(heights) / min(heights):.2f}; the report calls its "
            "own much the same.",
        )
        + " They measure the steadiness of the torso's line, because every column was divided by its maximum; "
        "the equal radar "
        "cross section that the report gives as the reason has no part in it.",
    )


@entry("fig-5.6", "Micro-Doppler bandwidth of the four", "The bandwidth grows with the speed of the target.")
def make_bandwidths(material: Material) -> EntryResult:
    results = analyze_four(material)
    figure = _plot_four_spectra(material, bandwidth=True)
    widths = [format_number(result.features.doppler_bandwidth_hz) for *_, result in results]
    readings = []
    for width, (name, _, recording, _) in zip(widths, results, strict=True):
        span_hz = float(np.ptp(recording.truth[0].doppler_hz(recording.radar.wavelength_m)))
        readings.append(Reading(f"B_mu, {name}", width, "Hz", note=f"true span of the points {span_hz:.0f} Hz"))
    readings += _compare_speeds("B_mu larger for the faster", widths)
    return judge(figure, readings, "the bandwidths of slow and fast are compared, pair by pair.")
