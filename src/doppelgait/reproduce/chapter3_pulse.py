"""Chapter 3, one pulse and its spectrum: Figures 3.4, 3.5 and 3.8."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from doppelgait.core.units import power_to_db
from doppelgait.reproduce.entry import Entry, Made, Reading, judged
from doppelgait.reproduce.material import Material
from doppelgait.viz.style import ACCENT, legend_below, name_axes, new_figure

FloatArray = npt.NDArray[np.float64]

PULSE_S = 1e-9
CARRIER_HZ = 7.2e9
TRAIN = {"pulses": 8, "pulse_s": 0.1, "interval_s": 1.0}
"""An illustration: pulse and repetition interval in units of the interval."""


def spectrum(values: npt.ArrayLike, rate_hz: float, *, points: int) -> tuple[FloatArray, FloatArray]:
    """Frequencies and power of a signal relative to its highest, zero padded to ``points``."""
    power = np.abs(np.fft.fftshift(np.fft.fft(np.asarray(values), points))) ** 2
    return np.fft.fftshift(np.fft.fftfreq(points, 1.0 / rate_hz)), np.asarray(power / power.max())


def half_power_width(axis: FloatArray, power: FloatArray) -> float:
    """Width of the highest peak at half its height, with straight lines between the samples."""
    peak, level = int(power.argmax()), power.max() / 2.0
    left, right = peak, peak
    while power[left] > level:
        left -= 1
    while power[right] > level:
        right += 1
    low = np.interp(level, power[left : left + 2], axis[left : left + 2])
    high = np.interp(level, power[right - 1 : right + 1][::-1], axis[right - 1 : right + 1][::-1])
    return float(high - low)


def first_null(axis: FloatArray, power: FloatArray) -> float:
    """Distance from the peak to the first minimum above it."""
    peak = int(power.argmax())
    rising = np.flatnonzero(np.diff(power[peak:]) > 0)
    return float(axis[peak + rising[0]] - axis[peak])


def make_3_4(material: Material) -> Made:
    """A rectangular pulse and its spectrum."""
    rate_hz, points = 1000.0 / PULSE_S, 1 << 18
    time_s = (np.arange(4000) - 1999.5) / rate_hz
    pulse = (np.abs(time_s) < PULSE_S / 2).astype(float)
    frequency_hz, power = spectrum(pulse, rate_hz, points=points)
    figure = new_figure(width_in=11.0, height_in=4.5)
    left, right = figure.subplots(1, 2)
    left.plot(time_s / PULSE_S, pulse, color=ACCENT)
    name_axes(left, title="(a) rectangular pulse", x="time (pulse durations)", y="amplitude (A)")
    shown = np.abs(frequency_hz) < 4.5 / PULSE_S
    right.plot(frequency_hz[shown] * PULSE_S, np.sqrt(power[shown]), color=ACCENT)
    right.axhline(np.sqrt(0.5), color="gray", ls="--", lw=1)
    name_axes(right, title="(b) magnitude spectrum", x="frequency (1 / pulse duration)", y="magnitude (A τ)")
    null = first_null(frequency_hz, power) * PULSE_S
    beyond = power[frequency_hz > null / PULSE_S * 1.01]
    readings = [
        Reading("first null, in 1 / pulse duration", null, "1", 1.0, 0.01),
        Reading("half-power width, in 1 / pulse duration", half_power_width(frequency_hz, power) * PULSE_S, "1", 1.0,
                0.05, "1 / τ is half the width between the nulls; the half-power width is 0.886 / τ (E-09)"),
        Reading("highest side lobe", float(power_to_db(beyond.max())), "dB"),
    ]  # fmt: skip
    text = (
        f"the main lobe ends at ±{null:.2f}/τ. The report then gives the half-power bandwidth twice: as 1/τ, "
        "which is 13 % too much, and as A τ / √2, which is the level of the spectrum there and no bandwidth."
    )
    return Made(figure, readings, judged(readings, text))


def make_3_5(material: Material) -> Made:
    """A finite train of rectangular pulses on a carrier, and the three scales of its spectrum."""
    count, pulse_s, interval_s = int(TRAIN["pulses"]), TRAIN["pulse_s"], TRAIN["interval_s"]
    rate_hz, carrier_hz = 1000.0, 100.0
    time_s = np.arange(round(count * interval_s * rate_hz)) / rate_hz
    gate = (np.mod(time_s, interval_s) < pulse_s).astype(float)
    train = gate * np.cos(2 * np.pi * carrier_hz * time_s)
    frequency_hz, power = spectrum(gate, rate_hz, points=1 << 19)
    figure = new_figure(width_in=11.0, height_in=6.5)
    above, below = figure.subplots(2, 1)
    above.plot(time_s, train, color=ACCENT, lw=0.6)
    name_axes(above, title="pulse train on a carrier", x="time (repetition intervals)", y="amplitude (A)")
    shown = np.abs(frequency_hz) < 2.2 / pulse_s
    below.plot(frequency_hz[shown], np.sqrt(power[shown]), color=ACCENT, lw=0.7)
    name_axes(
        below, title="spectrum about the carrier", x="frequency less carrier (1 / repetition interval)", y="magnitude"
    )
    lines = _line_places(frequency_hz, power, within=0.9 / pulse_s)
    readings = [
        Reading("spacing of the spectral lines, in f_p", float(np.diff(lines).mean()) * interval_s, "1", 1.0, 0.01),
        Reading("peak of a line to its first null, in 1 / T_d", first_null(frequency_hz, power) * count * interval_s,
                "1", 1.0, 0.01),
        Reading("half-power width of a line, in 1 / T_d", half_power_width(frequency_hz, power) * count * interval_s,
                "1", note="the report: proportional to 1 / T_d"),
    ]  # fmt: skip
    text = f"lines lie {readings[0].ours:.2f} f_p apart, {readings[1].ours:.2f} / T_d from peak to null."
    return Made(figure, readings, judged(readings, text))


def _line_places(frequency_hz: FloatArray, power: FloatArray, *, within: float) -> FloatArray:
    """Frequencies of the maxima that stand above all others within half a repetition frequency."""
    from scipy.signal import find_peaks

    apart = round(0.7 / TRAIN["interval_s"] / (frequency_hz[1] - frequency_hz[0]))
    found = frequency_hz[find_peaks(power, distance=apart)[0]]
    return np.asarray(found[np.abs(found) < within])


def make_3_8(material: Material) -> Made:
    """The Gaussian pulse on its carrier and its spectrum."""
    radar = material.radar()
    sigma_s, rate_hz = radar.sigma_s, 100e9
    time_s = (np.arange(4096) - 2047.5) / rate_hz
    envelope = np.exp(-0.5 * (time_s / sigma_s) ** 2)
    signal = envelope * np.cos(2 * np.pi * CARRIER_HZ * time_s)
    frequency_hz, power = spectrum(signal, rate_hz, points=1 << 17)
    above = frequency_hz > 0
    frequency_hz, power = frequency_hz[above], power[above]
    figure = new_figure(width_in=11.0, height_in=4.5)
    left, right = figure.subplots(1, 2)
    left.plot(time_s * 1e9, signal, color=ACCENT, lw=0.8, label="s(t)")
    left.plot(time_s * 1e9, envelope, color="#0072b2", ls=":", lw=2, label="p(t)")
    left.set_xlim(-4, 4)
    name_axes(left, title="(a) transmitted pulse, τ = 1 ns", x="time (ns)", y="amplitude (A)")
    left.legend(fontsize=9)
    right.plot(frequency_hz / 1e9, power_to_db(np.maximum(power, 1e-9)), color=ACCENT)
    right.axhline(-3.01, color="gray", ls="--", lw=1, label="half power")
    right.set(xlim=(5.7, 8.7), ylim=(-60, 3))
    name_axes(right, title="(b) power spectrum", x="frequency (GHz)", y="power (dB)")
    legend_below(figure, right)
    width_hz = half_power_width(frequency_hz, power)
    readings = [
        Reading("highest power, at frequency", float(frequency_hz[power.argmax()]) / 1e9, "GHz", 7.2, 0.01, given=True),
        Reading("half-power bandwidth", width_hz / 1e9, "GHz", 1.0, 0.05,
                "the printed pulse exp(-t²/2τ²) has √ln2 / (π τ) = 0.265 / τ (E-11)"),
        Reading("pulse width that gives 1 GHz", sigma_s * width_hz, "ns", note="an X4 has 0.345 ns"),
        Reading("half-power width in range of an echo", radar.range_resolution_m, "m"),
    ]  # fmt: skip
    text = (
        "with the pulse as printed and τ = 1 ns it is 265 MHz, a quarter of the 1 GHz stated, so the report's range "
        "resolution is 25 cm and not 7 cm."
    )
    return Made(figure, readings, judged(readings, text))


ENTRIES = (
    Entry(
        "fig-3.4", "A rectangular pulse and its spectrum",
        "The spectrum of a pulse of duration τ has its main lobe between -1/τ and 1/τ. The bandwidth is called 1/τ, "
        "and the half-power bandwidth A τ/√2.",
        make_3_4,
    ),
    Entry(
        "fig-3.5", "A finite train of pulses on a carrier",
        "Four scales: period of the carrier, duration of the pulse, repetition interval, coherent processing interval; "
        "each has its inverse in the spectrum.",
        make_3_5,
    ),
    Entry(
        "fig-3.8", "The Gaussian pulse and its spectrum",
        "With τ = 1 ns on 7.2 GHz the spectrum is Gaussian too; its half-power bandwidth is said to be 1/τ = 1 GHz.",
        make_3_8,
    ),
)  # fmt: skip
"""Figures of single pulses in chapter 3."""
