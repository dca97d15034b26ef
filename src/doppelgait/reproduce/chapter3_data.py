"""Chapter 3, the radar data matrix and its tables: Figures 3.14 and 3.15, Tables 3.2 and 3.3."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from doppelgait.core.units import power_to_db
from doppelgait.pipeline import simulate
from doppelgait.radar import Recording
from doppelgait.reproduce.entry import Entry, Made, Reading, judged
from doppelgait.reproduce.material import RCS_M2, Material
from doppelgait.reproduce.movers import Mover
from doppelgait.scene import Scene, Target
from doppelgait.scene.rcs import RCS_PER_MASS_M2_PER_KG, RcsSpec
from doppelgait.viz.body import draw_part_lines, part_lines
from doppelgait.viz.maps import colour_bar
from doppelgait.viz.ranges import draw_range_time
from doppelgait.viz.style import name_axes, new_figure

FloatArray = npt.NDArray[np.float64]

FRAMES_3_14, SECONDS_3_14, BINS_3_14, START_M_3_14 = 1938, 1.3, 162, 14.0
PRF_3_14_HZ = FRAMES_3_14 / SECONDS_3_14
HIGHEST_PRF_HZ = 1300.0
"""Table 5.1: 300 to 1300 Hz."""
CROSSING_M = 5.0
BEARING_DEG = 5.0
ENDS_S = 0.2
"""Level at the start and at the end: mean over this time."""


def _two_panels(recording: Recording, title: str) -> Figure:
    """Range of every point, and the data matrix, on the same range axis."""
    figure = new_figure(width_in=13.0, height_in=5.0)
    left, right = figure.subplots(1, 2)
    for truth in recording.truth:
        draw_part_lines(left, part_lines(truth.scatterers["range"]))
    name_axes(left, title=f"(a) range of every point, {title}", x="time (s)", y="range (m)")
    image = draw_range_time(right, recording.baseband, tracks=None, db_range=None)
    name_axes(right, title="(b) radar data matrix", x="time (s)", y="range (m)")
    left.set(xlim=right.get_xlim(), ylim=right.get_ylim())
    colour_bar(image, right, quantity="magnitude", reference="1 V")
    return figure


def _gain_db(power: FloatArray, rate_hz: float) -> float:
    """Power over the last 0.2 s against the first 0.2 s."""
    ends = round(ENDS_S * rate_hz)
    return float(power_to_db(power[-ends:].mean() / power[:ends].mean()))


def _expected_db(range_m: FloatArray, rate_hz: float) -> float:
    """The same for an echo that goes with R^-4."""
    return _gain_db(range_m**-4.0, rate_hz)


def make_3_14(material: Material) -> Made:
    """A galloping dog from 14 m towards the radar."""
    dog = material.galloping_dog()
    seconds = min(SECONDS_3_14, dog.seconds)
    radar = material.radar(prf_hz=PRF_3_14_HZ, range_start_m=6.5, range_stop_m=14.8)
    target = Target(
        dog.motion, label="dog", rcs=RcsSpec(kind="equal", total_m2=RCS_M2["dog"]),
        start_position_m=(START_M_3_14, 0.0), heading_deg=180.0,
    )  # fmt: skip
    recording = simulate(Scene([target], duration_s=seconds), radar, angles=False)
    power = (np.abs(recording.baseband.values) ** 2).sum(axis=1)
    centre_m = recording.truth[0].centre_range_m
    rises_db = _gain_db(power, radar.prf_hz)
    speed_mps = float(recording.truth[0].centre_velocity_mps.mean())
    readings = [
        Reading("range at the start", float(centre_m[0]), "m", note="placed where the report has it"),
        Reading("frame rate: 1938 frames in 1.3 s", PRF_3_14_HZ, "Hz", HIGHEST_PRF_HZ, 60.0,
                "the report's Table 5.1 ends at 1300 Hz; 1.3 s is printed with two digits"),
        Reading("length of 162 bins at 23.328 GS/s", BINS_3_14 * radar.bin_spacing_m / radar.decimation, "m",
                note="too short for the dog's way: the report must have kept every 8th sample"),
        Reading("length of 162 bins, every 8th sample kept", BINS_3_14 * radar.bin_spacing_m, "m"),
        Reading("radial velocity, mean", speed_mps, "m/s",
                note="3 m/s in its Figure 2.20, 5.4 m/s in chapter 5; 8.3 m of bins have room for either"),
        Reading("echo at the end over that at the start", rises_db, "dB",
                note=f"R⁻⁴ alone: {_expected_db(centre_m, radar.prf_hz):.1f} dB; the points interfere"),
        Reading("stronger when nearer (1: yes)", float(rises_db > 0), "1", 1.0),
    ]  # fmt: skip
    text = (
        f"from {centre_m[0]:.1f} to {centre_m[-1]:.1f} m the echo changes by {rises_db:+.1f} dB. The report's numbers "
        "do not fit together: the frame rate is above the range of Table 5.1, and 162 bins reach far enough only if "
        "every 8th sample is kept."
    )
    return Made(_two_panels(recording, dog.gait or "dog"), readings, judged(readings, text))


def make_3_15(material: Material) -> Made:
    """Two people who walk at the radar and pass each other."""
    first = material.person()
    speed_mps = _speed_mps(first)
    others = [one for one in material.walkers() if one.name != first.name and one.seconds >= 2.0] or [first]
    second = material.use(max(others, key=lambda one: abs(_speed_mps(one) - speed_mps)))
    seconds = min(first.seconds, second.seconds, 4.0)
    targets = [
        Target(
            mover.motion, label="human", rcs=RcsSpec(kind="equal", total_m2=RCS_M2["human"]), range_m=CROSSING_M,
            bearing_deg=bearing_deg,
        )
        for mover, bearing_deg in ((first, -BEARING_DEG), (second, BEARING_DEG))
    ]  # fmt: skip
    radar = material.radar(range_stop_m=10.0)
    recording = simulate(Scene(targets, duration_s=seconds), radar, angles=False)
    ahead_m = recording.truth[0].centre_range_m - recording.truth[1].centre_range_m
    crossings = np.flatnonzero(np.diff(np.sign(ahead_m)))
    power = (np.abs(recording.baseband.values) ** 2).sum(axis=1)
    rises_db = _gain_db(power, radar.prf_hz)
    readings = [
        Reading("times that the ranges cross", float(crossings.size), "1", 1.0, note="placed so", given=True),
        Reading("they cross at", float(crossings[0] / radar.prf_hz) if crossings.size else float("nan"), "s"),
        *[Reading(f"radial velocity, {name}", float(truth.centre_velocity_mps.mean()), "m/s")
          for name, truth in zip(("first", "second"), recording.truth, strict=True)],
        Reading("echo at the end over that at the start", rises_db, "dB"),
        Reading("stronger when nearer (1: yes)", float(rises_db > 0), "1", 1.0),
    ]  # fmt: skip
    text = f"the two sets of lines cross {_times(crossings.size)}; the echo changes by {rises_db:+.0f} dB to the end."
    return Made(_two_panels(recording, "two people"), readings, judged(readings, text))


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"


def _speed_mps(mover: Mover) -> float:
    from doppelgait.motion.retime import travel_speed_mps

    return travel_speed_mps(mover.motion)


def make_table_3_2(material: Material) -> Made:
    """Radar cross sections: the report's, those of the scatterers here, and what datasets take."""
    import pandas as pd

    rows, readings = [], []
    for mover in (material.person(), material.galloping_dog()):
        scatterers = material.recording(mover, prf_hz=1491.0).truth[0].scatterers
        total_m2 = float(scatterers["rcs"].values.sum(axis=1).mean())
        mass_kg = float(mover.motion.attrs["mass_kg"])
        rows.append({
            "target": mover.label, "report (m²)": RCS_M2[mover.label], "sum of the scatterers (m²)": total_m2,
            "scatterers": scatterers.sizes["scatterer"], "mass (kg)": mass_kg,
            "in datasets (m²)": RCS_PER_MASS_M2_PER_KG * mass_kg,
        })  # fmt: skip
        readings.append(
            Reading(f"sum of the scatterers, {mover.label}", total_m2, "m²", RCS_M2[mover.label], 1e-9, given=True)
        )
    text = (
        "every scatterer takes an equal share of the report's total. As the totals are a label in disguise, "
        "datasets take 0.01 m² per kilogram for people and dogs alike, shared out by body part (E-08)."
    )
    return Made(None, readings, judged(readings, text), pd.DataFrame(rows))


def make_table_3_3(material: Material) -> Made:
    """The four scales of time and frequency, for the radar of Table 5.1."""
    import pandas as pd

    from doppelgait.reproduce.chapter3_doppler import POINTS, tones
    from doppelgait.reproduce.chapter3_pulse import half_power_width, spectrum

    radar, cpi_s = material.radar(), 0.1
    frames = round(cpi_s * radar.prf_hz)
    line_hz, line = spectrum(tones(radar, frames, 0.0), radar.prf_hz, points=POINTS)
    width_hz = half_power_width(line_hz, line)
    band_hz = radar.pulse_bandwidth_hz(3)
    table = pd.DataFrame(
        [
            ("carrier period", 1.0 / radar.carrier_hz, "carrier", radar.carrier_hz, 1.0),
            ("pulse", radar.sigma_s, "half-power bandwidth", band_hz, band_hz * radar.sigma_s),
            ("repetition interval", 1.0 / radar.prf_hz, "repetition frequency", radar.prf_hz, 1.0),
            ("processing interval", cpi_s, "half-power width of a line", width_hz, width_hz * cpi_s),
        ],
        columns=["time scale", "time (s)", "frequency scale", "frequency (Hz)", "product"],
    )
    readings = [
        Reading("bandwidth times pulse width τ", band_hz * radar.sigma_s, "1", 1.0, 0.05,
                "0.265 for the Gaussian pulse as printed (E-11), 0.886 for a rectangular one"),
        Reading("width of a line times T_d", width_hz * cpi_s, "1", note="the report: proportional; 0.886 unweighted"),
    ]  # fmt: skip
    text = (
        f"for the report's Gaussian pulse B = 1/τ is {1.0 / readings[0].ours:.1f} times too much; the other three "
        "scales are inverse to each other by definition."
    )
    return Made(None, readings, judged(readings, text), table)


ENTRIES = (
    Entry(
        "fig-3.14", "Range and data matrix of a galloping dog",
        "The dog starts at 14 m and keeps its velocity towards the radar for about 1.3 s: 1938 frames of 162 range "
        "bins. The nearer it is the stronger the echo.",
        make_3_14,
    ),
    Entry(
        "fig-3.15", "Range and data matrix of two people who cross",
        "Two recorded people approach and pass each other in range; the nearer they are the more power comes back.",
        make_3_15,
    ),
    Entry(
        "table-3.2", "Radar cross section of the targets",
        "1 m² for a person, 0.2 m² for a dog, in equal shares over the scatterers; only their ratio is said to matter.",
        make_table_3_2,
    ),
    Entry(
        "table-3.3", "Four scales of time and frequency",
        "Carrier period and frequency, pulse duration τ and bandwidth 1/τ, repetition interval and frequency, and a "
        "line width proportional to one over the processing interval.",
        make_table_3_3,
    ),
)  # fmt: skip
"""Figures and tables of the data matrix in chapter 3."""
