"""Chapter 3, slow time: Doppler, resolution, data matrix."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import xarray as xr
from matplotlib.figure import Figure
from scipy.signal import find_peaks

from doppelgait import Streams, viz
from doppelgait.pipeline import simulate
from doppelgait.radar import Radar, Recording, add_noise, noise_power_v2, synthesise
from doppelgait.scene import Scene
from doppelgait_liland2018.chapter3_frame import compute_spectrum, measure_first_null
from doppelgait_liland2018.entry import EntryResult, Reading, compare_statement, entry, judge
from doppelgait_liland2018.material import Material, make_point_table, make_target, simulate_slow_time_signal
from doppelgait_liland2018.measures import doppler_to_velocity_mps, power_to_db, travel_speed_mps
from doppelgait_liland2018.scenarios import RCS_M2
from doppelgait_liland2018.style import ACCENT, LINE, make_figure, make_panels, name_axes, place_legend_below

FloatArray = npt.NDArray[np.float64]

PRF_HZ = 300.0
CARRIER_HZ = 7.2e9
CPI_FRAMES = 31
RANGE_M = 5.0
SHIFT_3_11_HZ = 24.0
TARGETS_3_12 = {-90.0: 0.02, -45.0: 0.005, 70.0: 0.01}
"""Shift in Hz and radar cross section in m^2 of the targets of Figure 3.12."""
WALL_M2 = 0.2
SPACINGS_3_13_HZ = {"a": 72.0, "b": 24.0, "c": 14.0, "d": 5.0}
PEAK_LEVEL_DB = -6.0
"""Maxima above this level below the highest count as targets; side lobes lie at -13 dB."""
POINTS = 1 << 15


def _make_radar(material: Material) -> Radar:
    return material.radar(carrier_hz=CARRIER_HZ, prf_hz=PRF_HZ, range_start_m=3.0, range_stop_m=7.0)


def simulate_tones(radar: Radar, n_frames: int, shifts_hz: npt.ArrayLike) -> npt.NDArray[np.complex128]:
    """Simulate equal points at Doppler shifts."""
    speeds = doppler_to_velocity_mps(np.atleast_1d(np.asarray(shifts_hz, dtype=float)), radar.wavelength_m)
    return simulate_slow_time_signal(
        radar, make_point_table(radar, n_frames, range_m=RANGE_M, velocity_mps=speeds), range_m=RANGE_M
    )


@entry(
    "fig-3.11",
    "Slow-time signal of one point, over 10 and over 31 frames",
    "A point with a shift of 24 Hz at 300 frames a second: 10 frames are too short for one period, 31 hold two.",
)
def make_3_11(material: Material) -> EntryResult:
    radar = _make_radar(material)
    figure = make_figure(width_in=11.0, height_in=4.2)
    periods = {}
    for panel, (letter, frames) in zip(figure.subplots(1, 2), (("a", 10), ("b", CPI_FRAMES)), strict=True):
        signal = simulate_tones(radar, frames, SHIFT_3_11_HZ)
        time_s = np.arange(frames) / PRF_HZ
        for part, colour, name in ((signal.real, LINE, "real part"), (signal.imag, ACCENT, "imaginary part")):
            panel.plot(time_s * 1e3, part / np.abs(signal).max(), "o-", color=colour, ms=4, label=name)
        panel.grid(color="#e0e0e0", lw=0.6)
        name_axes(panel, title=f"({letter}) {frames} frames", x="time (ms)", y="amplitude (re maximum)")
        periods[frames] = float(np.ptp(np.unwrap(np.angle(signal))) / (2 * np.pi))
    place_legend_below(figure, figure.axes[0])
    measured_hz = periods[CPI_FRAMES] * PRF_HZ / (CPI_FRAMES - 1)
    readings = [
        Reading("Doppler shift by the phase steps", measured_hz, "Hz", SHIFT_3_11_HZ, 0.05, fixed=True),
        Reading("periods in 10 frames", periods[10], "1", note="the report: less than one"),
        compare_statement("less than one period in 10 frames", periods[10] < 1),
        Reading("periods in 31 frames", periods[CPI_FRAMES], "1", 2.0, 0.5, "the report: about two"),
    ]
    text = f"of 24 Hz 10 frames at 300 Hz hold {periods[10]:.2f} periods, 31 frames {periods[CPI_FRAMES]:.2f}."
    return judge(figure, readings, text)


@entry(
    "fig-3.12",
    "What a Doppler spectrum holds",
    "Noise spread evenly, static objects at 0 Hz, two receding targets on the left, an approaching one on the "
    "right. The spectrum is said to be periodic with half the frame rate.",
)
def make_3_12(material: Material) -> EntryResult:
    radar, frames = _make_radar(material), 300
    shifts_hz = np.array([0.0, *TARGETS_3_12])
    table = make_point_table(
        radar,
        frames,
        range_m=RANGE_M,
        rcs_m2=[WALL_M2, *TARGETS_3_12.values()],
        velocity_mps=doppler_to_velocity_mps(shifts_hz, radar.wavelength_m),
    )
    rng = Streams(material.seed).generator("noise", "fig-3.12")
    baseband = add_noise(synthesise(table, radar), noise_power_v2=noise_power_v2(radar), rng=rng)
    signal = baseband.sel(range=RANGE_M, method="nearest").values * np.hanning(frames)
    shown_hz = np.linspace(-PRF_HZ, PRF_HZ, 4001)
    power = _measure_power_at(signal, shown_hz)
    level_db = power_to_db(power / power.max())
    figure = make_figure(width_in=11.0, height_in=4.5)
    axes = figure.add_subplot()
    axes.plot(shown_hz, level_db, color=LINE, lw=0.9)
    for edge_hz in (-PRF_HZ / 2, PRF_HZ / 2):
        axes.axvline(edge_hz, color="gray", ls="--", lw=1)
    for shift_hz, name in zip(shifts_hz, ("wall", "receding", "receding", "approaching"), strict=True):
        top_db = level_db[np.abs(shown_hz - shift_hz).argmin()]
        axes.annotate(name, xy=(shift_hz, top_db), xytext=(0, 5), textcoords="offset points", ha="center", fontsize=9)
    axes.set_ylim(float(np.median(level_db)) - 25, 8)
    name_axes(
        axes,
        title="Doppler spectrum of one range bin, two periods",
        x="Doppler frequency (Hz)",
        y="power (dB re maximum)",
    )
    fine_hz = np.arange(-PRF_HZ / 2, PRF_HZ / 2, 0.05)
    own = _measure_power_at(signal, fine_hz)
    near = [np.abs(fine_hz - shift_hz) < 5.0 for shift_hz in shifts_hz]
    places = [float(fine_hz[around][own[around].argmax()]) for around in near]
    # Smallest shift, from 50 Hz on in steps of 1 Hz, at which the spectrum is itself again.
    grid_hz, trial_hz = np.linspace(-60.0, 60.0, 61), np.arange(50.0, 2 * PRF_HZ + 1)
    own_hz = _measure_power_at(signal, grid_hz)
    shifted = _measure_power_at(signal, (trial_hz[:, None] + grid_hz).ravel()).reshape(trial_hz.size, grid_hz.size)
    unlike = np.abs(shifted - own_hz).sum(axis=1) / own_hz.sum()
    readings = [
        Reading("wall, at shift", places[0], "Hz", 0.0, 0.5, fixed=True),
        Reading(
            "targets, largest error of the shift",
            float(np.abs(np.array(places) - shifts_hz).max()),
            "Hz",
            note="against 2 v / λ; half a bin of 1 / T_d is 0.5 Hz",
        ),
        Reading(
            "period of the spectrum",
            float(trial_hz[np.flatnonzero(unlike < 1e-6)[0]]),
            "Hz",
            PRF_HZ / 2,
            1.0,
            "the report's text: periodic with f_p / 2; half of the period lies on either side of 0 (E-06)",
        ),
        Reading("wall over the median of the noise", float(-np.median(level_db)), "dB"),
    ]
    text = (
        "noise is everywhere, the wall at 0 Hz, receding targets at negative and approaching targets "
        "at positive shifts. The spectrum repeats after f_p = 300 Hz, not after f_p/2."
    )
    return judge(figure, readings, text)


def _measure_power_at(signal: npt.ArrayLike, frequency_hz: FloatArray) -> FloatArray:
    values = np.asarray(signal, dtype=np.complex128)
    carriers = np.exp(-2j * np.pi * np.outer(frequency_hz, np.arange(values.size)) / PRF_HZ)
    return np.asarray(np.abs(carriers @ values) ** 2)


@entry(
    "fig-3.13",
    "Doppler resolution: two points at four spacings",
    "31 frames at 300 Hz, 0.1 s, resolve 10 Hz. At 72 and 24 Hz the two are obvious, at 14 Hz they begin to blend, "
    "at 5 Hz they cannot be distinguished.",
)
def make_3_13(material: Material) -> EntryResult:
    radar = _make_radar(material)
    figure = make_figure(width_in=11.0, height_in=7.0)
    panels = figure.subplots(2, 2, sharex=True, sharey=True)
    seen: dict[str, tuple[int, float]] = {}
    for panel, (letter, spacing_hz) in zip(panels.flat, SPACINGS_3_13_HZ.items(), strict=True):
        shifts_hz = np.array([-spacing_hz / 2, spacing_hz / 2])
        for shift_hz in shifts_hz:
            alone_hz, alone = compute_spectrum(simulate_tones(radar, CPI_FRAMES, shift_hz), PRF_HZ, points=POINTS)
            panel.plot(alone_hz, np.sqrt(alone), color="#b0b0b0", lw=1)
            panel.axvline(shift_hz, color=LINE, ls=":", lw=1.2)
        frequency_hz, power = compute_spectrum(simulate_tones(radar, CPI_FRAMES, shifts_hz), PRF_HZ, points=POINTS)
        panel.plot(frequency_hz, np.sqrt(power), color="black", lw=1.4)
        name_axes(
            panel, title=f"({letter}) {spacing_hz:.0f} Hz apart", x="Doppler frequency (Hz)", y="magnitude (re maximum)"
        )
        panel.tick_params(labelleft=True, labelbottom=True)
        seen[letter] = count_and_dip(power)
    panels[0, 0].set_xlim(-110, 110)
    null_hz = measure_first_null(*compute_spectrum(simulate_tones(radar, CPI_FRAMES, 0.0), PRF_HZ, points=POINTS))
    stated = {"a": 2.0, "b": 2.0, "c": None, "d": 1.0}
    readings = [
        Reading("resolution: peak to first null", null_hz, "Hz", 10.0, 0.5, "f_p / M = 9.68 Hz; 10 Hz is 1 / 0.1 s"),
        *[
            Reading(f"({letter}) peaks at {spacing:.0f} Hz", seen[letter][0], "1", stated[letter])
            for letter, spacing in SPACINGS_3_13_HZ.items()
        ],
        *[
            Reading(
                f"({letter}) dip between them",
                seen[letter][1],
                "dB",
                note="the report: they begin to blend" if letter == "c" else "a null",
            )
            for letter in ("b", "c")
        ],
        Reading(
            "smallest spacing with two peaks, in phase",
            smallest_spacing_hz(radar),
            "Hz",
            note="in phase in the middle, as plotted here; the report does not say where its phase is zero",
        ),
    ]
    counts = ", ".join(f"{seen[letter][0]} at {spacing:.0f} Hz" for letter, spacing in SPACINGS_3_13_HZ.items())
    text = (
        f"peaks are {counts}; at 14 Hz they run into each other (a dip of {seen['c'][1]:.1f} dB). Two points in phase "
        "need more than the 10 Hz of the Rayleigh criterion, which is for powers added."
    )
    return judge(figure, readings, text)


def count_and_dip(power: FloatArray) -> tuple[int, float]:
    """Count maxima within 6 dB and their dip."""
    peaks = find_peaks(power, height=float(power.max()) * 10 ** (PEAK_LEVEL_DB / 10))[0]
    if peaks.size < 2:
        return int(peaks.size), 0.0
    between = power[peaks[0] : peaks[-1]].min()
    return int(peaks.size), float(power_to_db(power[peaks].min() / between))


def smallest_spacing_hz(radar: Radar) -> float:
    """Return the smallest spacing with two peaks, 0.1 Hz steps."""
    for spacing_hz in np.arange(5.0, 30.0, 0.1):
        both = simulate_tones(radar, CPI_FRAMES, [-spacing_hz / 2, spacing_hz / 2])
        if count_and_dip(compute_spectrum(both, PRF_HZ, points=POINTS)[1])[0] == 2:
            return float(spacing_hz)
    return float("nan")


FRAMES_3_14, SECONDS_3_14, BINS_3_14, START_M_3_14 = 1938, 1.3, 162, 14.0
PRF_3_14_HZ = FRAMES_3_14 / SECONDS_3_14
HIGHEST_PRF_HZ = 1300.0
"""Table 5.1: 300 to 1300 Hz."""
CROSSING_M = 5.0
BEARING_DEG = 5.0
ENDS_S = 0.2
"""Averaging time, s, of the level at the start and at the end."""


def _plot_two_panels(recording: Recording, title: str) -> Figure:
    """Plot all points' ranges next to the data matrix."""
    figure, (left, right) = make_panels(2, width_in=13.0, height_in=5.0)
    scatterers = xr.concat([truth.scatterers for truth in recording.truth], "scatterer")
    viz.range_lines(scatterers, title=f"(a) range of every point, {title}", ax=left)
    viz.range_time(recording.baseband, title="(b) radar data matrix", ax=right)
    left.set(xlim=right.get_xlim(), ylim=right.get_ylim())
    place_legend_below(figure, left)
    return figure


def _gain_db(power: FloatArray, rate_hz: float) -> float:
    """Return the last 0.2 s power over the first, dB."""
    ends = round(ENDS_S * rate_hz)
    return float(power_to_db(power[-ends:].mean() / power[:ends].mean()))


@entry(
    "fig-3.14",
    "Range and data matrix of a galloping dog",
    "The dog starts at 14 m and keeps its velocity towards the radar for about 1.3 s: 1938 frames of 162 range "
    "bins. The nearer it is the stronger the echo.",
)
def make_3_14(material: Material) -> EntryResult:
    dog = material.find_galloping_dog()
    seconds = min(SECONDS_3_14, dog.seconds)
    radar = material.radar(prf_hz=PRF_3_14_HZ, range_start_m=6.5, range_stop_m=14.8)
    target = make_target(dog, start_position_m=(START_M_3_14, 0.0), heading_deg=180.0)
    recording = simulate(Scene([target], duration_s=seconds), radar, angles=False)
    power = (np.abs(recording.baseband.values) ** 2).sum(axis=1)
    centre_m = recording.truth[0].centre_range_m
    rises_db = _gain_db(power, radar.prf_hz)
    speed_mps = float(recording.truth[0].centre_velocity_mps.mean())
    readings = [
        Reading("range at the start", float(centre_m[0]), "m", note="placed where the report has it"),
        Reading(
            "frame rate: 1938 frames in 1.3 s",
            PRF_3_14_HZ,
            "Hz",
            HIGHEST_PRF_HZ,
            60.0,
            "the report's Table 5.1 ends at 1300 Hz; 1.3 s is printed with two digits",
        ),
        Reading(
            "length of 162 bins at 23.328 GS/s",
            BINS_3_14 * radar.bin_spacing_m / radar.decimation,
            "m",
            note="too short for the dog's path: the report must have kept every 8th sample",
        ),
        Reading("length of 162 bins, every 8th sample kept", BINS_3_14 * radar.bin_spacing_m, "m"),
        Reading(
            "radial velocity, mean",
            speed_mps,
            "m/s",
            note="3 m/s in its Figure 2.20, 5.4 m/s in chapter 5; 8.3 m of bins have room for either",
        ),
        Reading(
            "echo at the end over that at the start",
            rises_db,
            "dB",
            note=f"R⁻⁴ alone: {_gain_db(centre_m**-4.0, radar.prf_hz):.1f} dB; the points interfere",
        ),
        compare_statement("stronger when nearer", rises_db > 0),
    ]
    text = (
        f"from {centre_m[0]:.1f} to {centre_m[-1]:.1f} m the echo changes by {rises_db:+.1f} dB. The report's numbers "
        "do not fit together: the frame rate is above the range of Table 5.1, and 162 bins reach far enough only if "
        "every 8th sample is kept."
    )
    return judge(_plot_two_panels(recording, dog.gait or "dog"), readings, text)


@entry(
    "fig-3.15",
    "Range and data matrix of two people who cross",
    "Two recorded people approach and pass each other in range; the nearer they are the more power comes back.",
)
def make_3_15(material: Material) -> EntryResult:
    first = material.person()
    speed_mps = travel_speed_mps(first.motion)
    others = [one for one in material.make_walkers() if one.name != first.name and one.seconds >= 2.0] or [first]
    second = material.use(max(others, key=lambda one: abs(travel_speed_mps(one.motion) - speed_mps)))
    seconds = min(first.seconds, second.seconds, 4.0)
    targets = [
        make_target(body, range_m=CROSSING_M, bearing_deg=bearing_deg)
        for body, bearing_deg in ((first, -BEARING_DEG), (second, BEARING_DEG))
    ]
    radar = material.radar(range_stop_m=10.0)
    recording = simulate(Scene(targets, duration_s=seconds), radar, angles=False)
    ahead_m = recording.truth[0].centre_range_m - recording.truth[1].centre_range_m
    crossings = np.flatnonzero(np.diff(np.sign(ahead_m)))
    power = (np.abs(recording.baseband.values) ** 2).sum(axis=1)
    rises_db = _gain_db(power, radar.prf_hz)
    readings = [
        Reading("times that the ranges cross", float(crossings.size), "1", 1.0, note="placed so", fixed=True),
        Reading("they cross at", float(crossings[0] / radar.prf_hz) if crossings.size else float("nan"), "s"),
        *[
            Reading(f"radial velocity, {name}", float(truth.centre_velocity_mps.mean()), "m/s")
            for name, truth in zip(("first", "second"), recording.truth, strict=True)
        ],
        Reading("echo at the end over that at the start", rises_db, "dB"),
        compare_statement("stronger when nearer", rises_db > 0),
    ]
    times = "once" if crossings.size == 1 else f"{crossings.size} times"
    text = f"the two sets of lines cross {times}; the echo changes by {rises_db:+.0f} dB to the end."
    return judge(_plot_two_panels(recording, "two people"), readings, text)


@entry(
    "table-3.2",
    "Radar cross section of the targets",
    "1 m² for a person, 0.2 m² for a dog, in equal shares over the scatterers; only their ratio is said to matter.",
)
def make_table_3_2(material: Material) -> EntryResult:
    import pandas as pd

    rows, readings = [], []
    for body in (material.person(), material.find_galloping_dog()):
        scatterers = material.recording(body, prf_hz=1491.0).truth[0].scatterers
        total_m2 = float(scatterers["rcs"].values.sum(axis=1).mean())
        mass_kg = body.motion.facts.mass_kg
        rows.append(
            {
                "target": body.label,
                "report (m²)": RCS_M2[body.label],
                "sum of the scatterers (m²)": total_m2,
                "scatterers": scatterers.sizes["scatterer"],
                "mass (kg)": mass_kg,
                "in datasets (m²)": 0.01 * mass_kg,
            }
        )
        readings.append(
            Reading(f"sum of the scatterers, {body.label}", total_m2, "m²", RCS_M2[body.label], 1e-9, fixed=True)
        )
    text = (
        "every scatterer takes an equal share of the report's total. As the totals reveal the label, "
        "datasets take 0.01 m² per kilogram for people and dogs alike, divided by body part (E-08)."
    )
    return judge(None, readings, text, pd.DataFrame(rows))


@entry(
    "table-3.3",
    "Four scales of time and frequency",
    "Carrier period and frequency, pulse duration τ and bandwidth 1/τ, repetition interval and frequency, and a "
    "line width proportional to one over the processing interval.",
)
def make_table_3_3(material: Material) -> EntryResult:
    import pandas as pd

    from doppelgait_liland2018.chapter3_frame import compute_spectrum, measure_half_power_width

    radar, cpi_s = material.radar(), 0.1
    frames = round(cpi_s * radar.prf_hz)
    line_hz, line = compute_spectrum(simulate_tones(radar, frames, 0.0), radar.prf_hz, points=POINTS)
    width_hz = measure_half_power_width(line_hz, line)
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
        Reading(
            "bandwidth times pulse width τ",
            band_hz * radar.sigma_s,
            "1",
            1.0,
            0.05,
            "0.265 for the Gaussian pulse as printed (E-11), 0.886 for a rectangular one",
        ),
        Reading("width of a line times T_d", width_hz * cpi_s, "1", note="the report: proportional; 0.886 unweighted"),
    ]
    text = (
        f"for the report's Gaussian pulse B = 1/τ is {1.0 / readings[0].ours:.1f} times too much; the other three "
        "scales are inverse to each other by definition."
    )
    return judge(None, readings, text, table)
