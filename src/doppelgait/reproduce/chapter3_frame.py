"""Chapter 3, one frame: its range bins and the down-conversion, Figures 3.9 and 3.10."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from doppelgait.core.units import power_to_db
from doppelgait.radar import Radar, synthesise, synthesise_rf
from doppelgait.radar.rf import down_convert, sample_rf_frames
from doppelgait.reproduce.chapter3_pulse import spectrum
from doppelgait.reproduce.entry import Entry, Made, Reading, judged
from doppelgait.reproduce.material import Material
from doppelgait.reproduce.points import point_table
from doppelgait.viz.style import ACCENT, legend_below, name_axes, new_figure

FloatArray = npt.NDArray[np.float64]

RANGE_M = 2.0
SPEED_OF_LIGHT = 299_792_458.0
MARGIN = 512


def _full_rate(material: Material) -> Radar:
    return material.radar(decimation=1, range_start_m=1.0, range_stop_m=3.0)


def make_3_9(material: Material) -> Made:
    """Samples of one frame with an echo."""
    full = _full_rate(material)
    kept = full.model_copy(update={"decimation": 8})
    table = point_table(full, 2, range_m=RANGE_M, velocity_mps=0.0)
    figure = new_figure(width_in=11.0, height_in=4.5)
    axes = figure.add_subplot()
    for radar, colour, size in ((full, "#b0b0b0", 3), (kept, ACCENT, 6)):
        baseband = synthesise(table, radar)
        level = np.abs(baseband.values[0]) / np.abs(baseband.values).max()
        label = f"every {radar.bin_spacing_m * 100:.2f} cm: {radar.n_range_bins} range bins"
        axes.plot(baseband.coords["range"].values, level, "o", color=colour, ms=size, label=label)
    axes.axvline(RANGE_M, color="black", lw=0.8, ls=":")
    axes.grid(color="#e0e0e0", lw=0.6)
    name_axes(axes, title="One frame from 1 to 3 m, a point at 2 m", x="range (m)", y="magnitude (of the highest)")
    legend_below(figure, axes)
    peak_m = float(synthesise(table, full).pipe(abs).isel(slow_time=0).idxmax("range"))
    apart_m = float(np.diff(synthesise(table, full).coords["range"].values).mean())
    readings = [
        Reading("distance of the samples at 23.328 GS/s", apart_m * 1000, "mm", SPEED_OF_LIGHT / 2 / 23.328e6, 1e-3,
                "the report's Eq. 3.21, c t_s / 2", given=True),
        Reading("length of chapter 4's frame of 1189 bins at 23 GS/s", 1189 * SPEED_OF_LIGHT / 2 / 23e9, "m"),
        Reading("strongest bin less true range", (peak_m - RANGE_M) * 1000, "mm",
                note=f"half a bin is {full.bin_spacing_m * 500:.2f} mm"),
        Reading("bins after keeping every 8th", kept.n_range_bins, "1"),
    ]  # fmt: skip
    text = (
        "two repairs are made: a frame lasts 2 r_span/c, not r_span/c (E-10), and the first sample lies at r_min, "
        "not one sample later (E-15). All other recordings here keep every 8th sample, which changes no signature."
    )
    return Made(figure, readings, judged(readings, text))


def make_3_10(material: Material) -> Made:
    """Spectrum of a received frame before and after the down-conversion."""
    radar = _full_rate(material)
    table = point_table(radar, 2, range_m=RANGE_M, velocity_mps=0.0)
    frames = sample_rf_frames(table, radar, margin=MARGIN)
    baseband = down_convert(frames, radar, margin=MARGIN)
    time_s = np.arange(frames.shape[1]) / radar.sample_rate_hz
    literal = frames[0] * np.cos(2 * np.pi * radar.carrier_hz * time_s)
    figure = new_figure(width_in=13.0, height_in=4.2)
    panels = figure.subplots(1, 3, sharey=True)
    signals = {
        "(a) received frame": frames[0],
        "(b) down-converted, complex and filtered": baseband[0],
        "as printed: real part only, no filter": literal,
    }
    found = {}
    for panel, (title, values) in zip(panels, signals.items(), strict=True):
        frequency_hz, power = spectrum(values, radar.sample_rate_hz, points=1 << 15)
        found[title] = frequency_hz, power
        panel.plot(frequency_hz / 1e9, power_to_db(np.maximum(power, 1e-12)), color=ACCENT, lw=1)
        panel.set(ylim=(-100, 5))
        panel.tick_params(labelleft=True)
        name_axes(panel, title=title, x="frequency (GHz)", y="power (dB)")
    (before_hz, before), (after_hz, after), (_, printed) = found.values()
    positive = before_hz > 0
    image = np.abs(after_hz) > 7e9
    closed, sampled = synthesise(table, radar).values, synthesise_rf(table, radar).values
    readings = [
        Reading("highest power before, at frequency", _highest_ghz(before_hz[positive], before[positive]), "GHz",
                radar.carrier_hz / 1e9, 0.01, "the carrier", given=True),
        Reading("highest power after, at frequency", _highest_ghz(after_hz, after), "GHz", 0.0, 0.01),
        Reading("highest power left beyond 7 GHz", float(power_to_db(after[image].max())), "dB"),
        Reading("the same as printed, without a filter", float(power_to_db(printed[image].max())), "dB"),
        Reading("down-converted frame against the closed form, largest error",
                float(np.abs(closed - sampled).max() / np.abs(closed).max()), "1", note="of the highest sample"),
    ]  # fmt: skip
    text = (
        "the echo is shifted to 0 Hz. As printed (Eq. 3.27a) the product is with the real part only: the spectrum "
        "stays symmetrical, so approaching and receding could not be told apart, and an image stays at 8.7 GHz; the "
        "complex product and a low-pass (E-17) give what the report's Eq. 3.28 assumes."
    )
    return Made(figure, readings, judged(readings, text))


def _highest_ghz(frequency_hz: FloatArray, power: FloatArray) -> float:
    return float(frequency_hz[power.argmax()]) / 1e9


ENTRIES = (
    Entry(
        "fig-3.9", "Range bins of a frame",
        "A frame from r_min to r_max holds N samples, c t_s/2 apart: the range bins.",
        make_3_9,
    ),
    Entry(
        "fig-3.10", "Spectrum before and after down-conversion",
        "Before, the echo lies about the carrier frequency; after multiplying with the carrier it lies about 0 Hz.",
        make_3_10,
    ),
)  # fmt: skip
"""Figures of one frame in chapter 3."""
