"""Plots shared by chapters 4, 5 and the appendix."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt
import xarray as xr
from matplotlib.axes import Axes

from doppelgait.pipeline import Result
from doppelgait_liland2018 import style
from doppelgait_liland2018.material import THRESHOLD
from doppelgait_liland2018.measures import read_axis

FloatArray = npt.NDArray[np.float64]

MAX_CADENCE_HZ = 20.0
AMPLITUDE_LABEL = "amplitude"


def plot_cadence_amplitude(
    axes: Axes,
    spectrum: xr.DataArray,
    found_hz: Sequence[float | None],
    *,
    true_hz: float | None = None,
    max_cadence_hz: float = MAX_CADENCE_HZ,
    title: str = "",
) -> None:
    """Plot D_g over cadence with f_m, f_2 and f_3."""
    cadence_hz, values = read_axis(spectrum, "cadence"), np.asarray(spectrum.values, dtype=np.float64)
    axes.plot(cadence_hz, values, color=style.LINE, lw=1.3, marker=".", ms=3)
    axes.set(xlim=(0.0, min(max_cadence_hz, float(cadence_hz[-1]))), ylim=(0.0, 1.22 * float(values.max())))
    if true_hz is not None and np.isfinite(true_hz):
        for harmonic in (1, 2, 3):
            label = "true step frequency and harmonics" if harmonic == 1 else None
            axes.axvline(harmonic * true_hz, color=style.GREEN, lw=1.0, ls=":", zorder=0, label=label)
    style.mark_harmonics(axes, found_hz, cadence_hz, values)
    style.draw_grid(axes)
    style.name_axes(axes, title=title, x=style.CADENCE_LABEL, y=AMPLITUDE_LABEL)
    style.legend_under(axes, columns=2)


def plot_mean_doppler(axes: Axes, result: Result, *, bandwidth: bool = False, title: str = "") -> None:
    """Plot D_1 over Doppler with the torso's peak, or normalised with the bandwidth."""
    level = np.asarray(result.mean_doppler_spectrum, dtype=np.float64)
    frequency = np.asarray(read_axis(result.signature, "doppler"), dtype=np.float64)
    peak_hz = None if bandwidth else result.torso_doppler_hz
    if bandwidth:
        level = level / level.max()
    axes.plot(frequency, level, color=style.LINE, lw=1.3)
    # Part of the Doppler axis that holds more than 0.3 % of the maximum, 0 Hz and a margin.
    occupied_first, occupied_last = band_hz(level, frequency, 0.003)
    margin = 0.15 * (occupied_last - occupied_first) + 30.0
    axes.set(
        xlim=(
            max(min(occupied_first, 0.0) - margin, float(frequency[0])),
            min(max(occupied_last, 0.0) + margin, float(frequency[-1])),
        ),
        ylim=(0.0, 1.2 * float(level.max())),
    )
    if peak_hz is not None:
        height = float(np.interp(peak_hz, frequency, level))
        axes.plot([peak_hz], [height], marker="o", color=style.ACCENT, ms=5, ls="none")
        axes.annotate(
            f"torso {peak_hz:.0f} Hz, height {height:.2f}",
            (peak_hz, height),
            xytext=(0, 6),
            textcoords="offset points",
            ha="center",
            fontsize=9,
            color=style.ACCENT,
        )
    if bandwidth:
        first, last = band_hz(level, frequency, THRESHOLD)
        axes.axhline(THRESHOLD * float(level.max()), color=style.REFERENCE, lw=1.0, ls="--")
        axes.axvspan(first, last, color=style.SHADE, alpha=0.35, lw=0, zorder=0)
        axes.annotate(
            f"bandwidth {last - first:.0f} Hz",
            ((first + last) / 2, 1.1 * float(level.max())),
            ha="center",
            fontsize=9,
            color=style.LINE,
        )
    style.draw_grid(axes)
    level_label = "amplitude (re maximum)" if bandwidth else AMPLITUDE_LABEL
    style.name_axes(axes, title=title, x=style.DOPPLER_LABEL, y=level_label)


def band_hz(level: FloatArray, doppler_hz: FloatArray, threshold: float) -> tuple[float, float]:
    """Return Doppler limits above a share of the maximum."""
    above = np.flatnonzero(level >= threshold * level.max())
    return float(doppler_hz[above[0]]), float(doppler_hz[above[-1]])


def plot_numbered_marks(axes: Axes, places: Mapping[str, tuple[float, float]]) -> None:
    """Draw numbers in circles at places in data coordinates."""
    for name, place in places.items():
        axes.annotate(
            name,
            place,
            fontsize=10,
            ha="center",
            va="center",
            color="black",
            bbox={"boxstyle": "circle,pad=0.25", "fc": "white", "ec": style.ACCENT, "lw": 1.4, "alpha": 0.9},
        )
