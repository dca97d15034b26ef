"""Chapter 3, fast time: pulse, range bins, down-conversion."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from doppelgait.radar import Radar, echo_amplitude_v, synthesise, synthesise_rf
from doppelgait_liland2018.entry import EntryResult, Reading, entry, judge
from doppelgait_liland2018.material import Material, make_point_table
from doppelgait_liland2018.measures import power_to_db
from doppelgait_liland2018.style import ACCENT, LINE, legend_under, make_figure, name_axes, place_legend_below

FloatArray = npt.NDArray[np.float64]

PULSE_S = 1e-9
CARRIER_HZ = 7.2e9
TRAIN = {"pulses": 8, "pulse_s": 0.1, "interval_s": 1.0}
"""An illustration: pulse and repetition interval in units of the interval."""


def compute_spectrum(values: npt.ArrayLike, rate_hz: float, *, points: int) -> tuple[FloatArray, FloatArray]:
    """Return frequencies and normalised power of a zero-padded signal."""
    power = np.abs(np.fft.fftshift(np.fft.fft(np.asarray(values), points))) ** 2
    return np.fft.fftshift(np.fft.fftfreq(points, 1.0 / rate_hz)), np.asarray(power / power.max())


def measure_half_power_width(axis: FloatArray, power: FloatArray) -> float:
    """Return the highest peak's width at half height."""
    peak, level = int(power.argmax()), power.max() / 2.0
    left, right = peak, peak
    while power[left] > level:
        left -= 1
    while power[right] > level:
        right += 1
    low = np.interp(level, power[left : left + 2], axis[left : left + 2])
    high = np.interp(level, power[right - 1 : right + 1][::-1], axis[right - 1 : right + 1][::-1])
    return float(high - low)


def measure_first_null(axis: FloatArray, power: FloatArray) -> float:
    """Return the distance from peak to next minimum."""
    peak = int(power.argmax())
    rising = np.flatnonzero(np.diff(power[peak:]) > 0)
    return float(axis[peak + rising[0]] - axis[peak])


@entry(
    "fig-3.4",
    "A rectangular pulse and its spectrum",
    "The spectrum of a pulse of duration τ has its main lobe between -1/τ and 1/τ. The bandwidth is called 1/τ, "
    "and the half-power bandwidth A τ/√2.",
)
def make_3_4(material: Material) -> EntryResult:
    rate_hz, points = 1000.0 / PULSE_S, 1 << 18
    time_s = (np.arange(4000) - 1999.5) / rate_hz
    pulse = (np.abs(time_s) < PULSE_S / 2).astype(float)
    frequency_hz, power = compute_spectrum(pulse, rate_hz, points=points)
    figure = make_figure(width_in=11.0, height_in=4.5)
    left, right = figure.subplots(1, 2)
    left.plot(time_s / PULSE_S, pulse, color=LINE)
    name_axes(left, title="(a) rectangular pulse", x="time (pulse durations)", y="amplitude (re maximum)")
    shown = np.abs(frequency_hz) < 4.5 / PULSE_S
    right.plot(frequency_hz[shown] * PULSE_S, np.sqrt(power[shown]), color=LINE)
    right.axhline(np.sqrt(0.5), color="gray", ls="--", lw=1)
    name_axes(right, title="(b) magnitude spectrum", x="frequency (1 / pulse duration)", y="magnitude (re maximum)")
    null = measure_first_null(frequency_hz, power) * PULSE_S
    beyond = power[frequency_hz > null / PULSE_S * 1.01]
    readings = [
        Reading("first null, in 1 / pulse duration", null, "1", 1.0, 0.01),
        Reading(
            "half-power width, in 1 / pulse duration",
            measure_half_power_width(frequency_hz, power) * PULSE_S,
            "1",
            1.0,
            0.05,
            "1 / τ is half the width between the nulls; the half-power width is 0.886 / τ (E-09)",
        ),
        Reading("highest side lobe", float(power_to_db(beyond.max())), "dB"),
    ]
    text = (
        f"the main lobe ends at ±{null:.2f}/τ. The report then gives the half-power bandwidth twice: as 1/τ, "
        "which is 13 % too much, and as A τ / √2, which is the level of the spectrum there and no bandwidth."
    )
    return judge(figure, readings, text)


@entry(
    "fig-3.5",
    "A finite train of pulses on a carrier",
    "Four scales: period of the carrier, duration of the pulse, repetition interval, coherent processing interval; "
    "each has its inverse in the spectrum.",
)
def make_3_5(material: Material) -> EntryResult:
    count, pulse_s, interval_s = int(TRAIN["pulses"]), TRAIN["pulse_s"], TRAIN["interval_s"]
    rate_hz, carrier_hz = 1000.0, 100.0
    time_s = np.arange(round(count * interval_s * rate_hz)) / rate_hz
    gate = (np.mod(time_s, interval_s) < pulse_s).astype(float)
    train = gate * np.cos(2 * np.pi * carrier_hz * time_s)
    frequency_hz, power = compute_spectrum(gate, rate_hz, points=1 << 19)
    figure = make_figure(width_in=11.0, height_in=6.5)
    above, below = figure.subplots(2, 1)
    above.plot(time_s, train, color=LINE, lw=0.6)
    name_axes(above, title="pulse train on a carrier", x="time (repetition intervals)", y="amplitude (re maximum)")
    shown = np.abs(frequency_hz) < 2.2 / pulse_s
    below.plot(frequency_hz[shown], np.sqrt(power[shown]), color=LINE, lw=0.7)
    name_axes(
        below,
        title="spectrum about the carrier",
        x="frequency less carrier (1 / repetition interval)",
        y="magnitude (re maximum)",
    )
    # Frequencies of the maxima that stand above all others within half a repetition frequency.
    within = 0.9 / pulse_s
    from scipy.signal import find_peaks

    apart = round(0.7 / TRAIN["interval_s"] / (frequency_hz[1] - frequency_hz[0]))
    found = frequency_hz[find_peaks(power, distance=apart)[0]]
    lines = np.asarray(found[np.abs(found) < within])
    readings = [
        Reading("spacing of the spectral lines, in f_p", float(np.diff(lines).mean()) * interval_s, "1", 1.0, 0.01),
        Reading(
            "peak of a line to its first null, in 1 / T_d",
            measure_first_null(frequency_hz, power) * count * interval_s,
            "1",
            1.0,
            0.01,
        ),
        Reading(
            "half-power width of a line, in 1 / T_d",
            measure_half_power_width(frequency_hz, power) * count * interval_s,
            "1",
            note="the report: proportional to 1 / T_d",
        ),
    ]
    text = f"lines lie {readings[0].ours:.2f} f_p apart, {readings[1].ours:.2f} / T_d from peak to null."
    return judge(figure, readings, text)


@entry(
    "fig-3.8",
    "The Gaussian pulse and its spectrum",
    "With τ = 1 ns on 7.2 GHz the spectrum is Gaussian too; its half-power bandwidth is said to be 1/τ = 1 GHz.",
)
def make_3_8(material: Material) -> EntryResult:
    radar = material.radar()
    sigma_s, rate_hz = radar.sigma_s, 100e9
    time_s = (np.arange(4096) - 2047.5) / rate_hz
    envelope = np.exp(-0.5 * (time_s / sigma_s) ** 2)
    signal = envelope * np.cos(2 * np.pi * CARRIER_HZ * time_s)
    frequency_hz, power = compute_spectrum(signal, rate_hz, points=1 << 17)
    above = frequency_hz > 0
    frequency_hz, power = frequency_hz[above], power[above]
    figure = make_figure(width_in=11.0, height_in=4.5)
    left, right = figure.subplots(1, 2)
    left.plot(time_s * 1e9, signal, color=LINE, lw=0.8, label="pulse on the carrier")
    left.plot(time_s * 1e9, envelope, color=ACCENT, ls=":", lw=2, label="envelope")
    left.set_xlim(-4, 4)
    name_axes(left, title="(a) transmitted pulse, 1 ns", x="time (ns)", y="amplitude (re maximum)")
    legend_under(left, columns=2)
    right.plot(frequency_hz / 1e9, power_to_db(np.maximum(power, 1e-9)), color=LINE)
    right.axhline(-3.01, color="gray", ls="--", lw=1, label="half power")
    right.set(xlim=(5.7, 8.7), ylim=(-60, 3))
    name_axes(right, title="(b) power spectrum", x="frequency (GHz)", y="power (dB re maximum)")
    legend_under(right)
    width_hz = measure_half_power_width(frequency_hz, power)
    readings = [
        Reading("highest power, at frequency", float(frequency_hz[power.argmax()]) / 1e9, "GHz", 7.2, 0.01, fixed=True),
        Reading(
            "half-power bandwidth",
            width_hz / 1e9,
            "GHz",
            1.0,
            0.05,
            "the printed pulse exp(-t²/2τ²) has √ln2 / (π τ) = 0.265 / τ (E-11)",
        ),
        Reading("pulse width that gives 1 GHz", sigma_s * width_hz, "ns", note="an X4 has 0.345 ns"),
        Reading("half-power width in range of an echo", radar.range_resolution_m, "m"),
    ]
    text = (
        "with the pulse as printed and τ = 1 ns it is 265 MHz, a quarter of the 1 GHz stated, so the report's range "
        "resolution is 25 cm and not 7 cm."
    )
    return judge(figure, readings, text)


RANGE_M = 2.0
SPEED_OF_LIGHT = 299_792_458.0
MARGIN = 512


def _make_full_rate_radar(material: Material) -> Radar:
    return material.radar(decimation=1, range_start_m=1.0, range_stop_m=3.0)


@entry(
    "fig-3.9", "Range bins of a frame", "A frame from r_min to r_max holds N samples, c t_s/2 apart: the range bins."
)
def make_3_9(material: Material) -> EntryResult:
    full = _make_full_rate_radar(material)
    kept = full.model_copy(update={"decimation": 8})
    table = make_point_table(full, 2, range_m=RANGE_M, velocity_mps=0.0)
    figure = make_figure(width_in=11.0, height_in=4.5)
    axes = figure.add_subplot()
    for radar, colour, size in ((full, "#b0b0b0", 3), (kept, LINE, 6)):
        baseband = synthesise(table, radar)
        level = np.abs(baseband.values[0]) / np.abs(baseband.values).max()
        label = f"every {radar.bin_spacing_m * 100:.2f} cm: {radar.n_range_bins} range bins"
        axes.plot(baseband.coords["range"].values, level, "o", color=colour, ms=size, label=label)
    axes.axvline(RANGE_M, color="black", lw=0.8, ls=":")
    axes.grid(color="#e0e0e0", lw=0.6)
    name_axes(axes, title="One frame from 1 to 3 m, a point at 2 m", x="range (m)", y="magnitude (re maximum)")
    place_legend_below(figure, axes)
    peak_m = float(synthesise(table, full).pipe(abs).isel(slow_time=0).idxmax("range"))
    apart_m = float(np.diff(synthesise(table, full).coords["range"].values).mean())
    readings = [
        Reading(
            "distance of the samples at 23.328 GS/s",
            apart_m * 1000,
            "mm",
            SPEED_OF_LIGHT / 2 / 23.328e6,
            1e-3,
            "the report's Eq. 3.21, c t_s / 2",
            fixed=True,
        ),
        Reading("length of chapter 4's frame of 1189 bins at 23 GS/s", 1189 * SPEED_OF_LIGHT / 2 / 23e9, "m"),
        Reading(
            "strongest bin less true range",
            (peak_m - RANGE_M) * 1000,
            "mm",
            note=f"half a bin is {full.bin_spacing_m * 500:.2f} mm",
        ),
        Reading("bins after keeping every 8th", kept.n_range_bins, "1"),
    ]
    text = (
        "two repairs are made: a frame lasts 2 r_span/c, not r_span/c (E-10), and the first sample lies at r_min, "
        "not one sample later (E-15). All other recordings here keep every 8th sample, which changes no signature."
    )
    return judge(figure, readings, text)


@entry(
    "fig-3.10",
    "Spectrum before and after down-conversion",
    "Before, the echo lies about the carrier frequency; after multiplying with the carrier it lies about 0 Hz.",
)
def make_3_10(material: Material) -> EntryResult:
    radar = _make_full_rate_radar(material)
    table = make_point_table(radar, 2, range_m=RANGE_M, velocity_mps=0.0)
    closed, sampled = synthesise(table, radar).values, synthesise_rf(table, radar).values
    # The received frame, sample by sample (E-16): the pulse on the carrier, delayed by 2 R / c.
    time_s = np.arange(radar.n_range_bins + 2 * MARGIN) / radar.sample_rate_hz
    since_s = time_s + (2 * radar.range_start_m - 2 * RANGE_M) / SPEED_OF_LIGHT - MARGIN / radar.sample_rate_hz
    carrier = np.cos(2 * np.pi * radar.carrier_hz * since_s + radar.transmit_phase_rad)
    amplitude_v = echo_amplitude_v(radar, range_m=RANGE_M, rcs_m2=1.0)
    received = amplitude_v * np.exp(-0.5 * (since_s / radar.sigma_s) ** 2) * carrier
    literal = received * np.cos(2 * np.pi * radar.carrier_hz * time_s)
    figure = make_figure(width_in=13.0, height_in=4.2)
    panels = figure.subplots(1, 3, sharey=True)
    signals = {
        "(a) received frame": received,
        "(b) down-converted, complex and filtered": sampled[0],
        "as printed: real part only, no filter": literal,
    }
    found = {}
    for panel, (title, values) in zip(panels, signals.items(), strict=True):
        frequency_hz, power = compute_spectrum(values, radar.sample_rate_hz, points=1 << 15)
        found[title] = frequency_hz, power
        panel.plot(frequency_hz / 1e9, power_to_db(np.maximum(power, 1e-12)), color=LINE, lw=1)
        panel.set(ylim=(-100, 5))
        panel.tick_params(labelleft=True)
        name_axes(panel, title=title, x="frequency (GHz)", y="power (dB re maximum)")
    (before_hz, before), (after_hz, after), (_, printed) = found.values()
    positive = before_hz > 0
    image = np.abs(after_hz) > 7e9
    readings = [
        Reading(
            "highest power before, at frequency",
            _highest_ghz(before_hz[positive], before[positive]),
            "GHz",
            radar.carrier_hz / 1e9,
            0.01,
            "the carrier",
            fixed=True,
        ),
        Reading("highest power after, at frequency", _highest_ghz(after_hz, after), "GHz", 0.0, 0.01),
        Reading("highest power left beyond 7 GHz", float(power_to_db(after[image].max())), "dB"),
        Reading("the same as printed, without a filter", float(power_to_db(printed[image].max())), "dB"),
        Reading(
            "down-converted frame against the closed form, largest error",
            float(np.abs(closed - sampled).max() / np.abs(closed).max()),
            "1",
            note="of the highest sample",
        ),
    ]
    text = (
        "the echo is shifted to 0 Hz. As printed (Eq. 3.27a) the product is with the real part only: the spectrum "
        "stays symmetrical, so approaching and receding could not be distinguished, and an image stays at 8.7 GHz; the "
        "complex product and a low-pass (E-17) give what the report's Eq. 3.28 assumes."
    )
    return judge(figure, readings, text)


def _highest_ghz(frequency_hz: FloatArray, power: FloatArray) -> float:
    return float(frequency_hz[power.argmax()]) / 1e9
