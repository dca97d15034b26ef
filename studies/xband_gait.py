"""Gait from real spectrograms, torso speeds of real 24 GHz recordings.

The spectrograms are compared with values read by eye.

    python studies/xband_gait.py RADAR_DATA OUT_FOLDER

RADAR_DATA holds ``fmcw_xband_manga/decoded_levels.npz`` (what these images are: :mod:`xband_measures`) and
``cw24_kmkim036``. Writes a figure of every image with what was measured drawn over it, and ``xband-gait.md``.

The images enter at the signature: levels between -30 and -10 dB, a column every 8 sweeps of 1.68 ms. (The source prints
7 s for what by its own velocity axis are 8.4 s: frequencies here are 1.2 times lower than on the printed axis.) Rows
within 0.4 m/s of zero, the ground, are emptied; the features get nothing else. One image is cut before the dog
brakes, and of the runner, whose Doppler wraps, the axis is turned so that it starts at -0.6 m/s; both are stated below.
"""

from __future__ import annotations

import argparse
import re
import time
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr
import xband_measures as measures
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from xband_readings import IMAGES, Image

from doppelgait import viz
from doppelgait.core.errors import DoppelgaitWarning
from doppelgait.core.labels import read_axis
from doppelgait.core.units import carrier_to_wavelength_m
from doppelgait.pipeline import Result, analyze
from doppelgait.pipeline.analyze import analyze_signature
from doppelgait.pipeline.spectrogram import convert_levels_to_signature, make_level_gate
from doppelgait.processing import Analysis
from doppelgait.radar.readers.cw_text import read_cw_text
from doppelgait.viz.style import make_figure, name_axes

DATA_FILE = Path("fmcw_xband_manga") / "decoded_levels.npz"
CW_FOLDER = "cw24_kmkim036"
HIGHEST_DB = 0.0
"""Levels are below the image's maximum."""
RANGE_M = (0.0, 120.0)
"""Not stated by the source; no feature depends on it."""
ANALYSIS = Analysis(cpi_s=measures.WINDOW_SWEEPS * measures.PRI_S, window_steepness=0.37)
"""A Gaussian window of this steepness has the 3 dB width of the Hann window of the images."""
TIME_S: measures.FloatArray = np.asarray(
    measures.PRI_S * (measures.WINDOW_SWEEPS / 2 + measures.HOP_SWEEPS * np.arange(measures.N_COLUMNS)),
    dtype=np.float64,
)


def levels_of(data: Path) -> dict[str, measures.FloatArray]:
    """Read the levels of the images in dB by key."""
    return measures.read_levels(data / DATA_FILE, [image.key for image in IMAGES])


@dataclass(frozen=True)
class Entry:
    """Conversion of an image to a signature, with variants.

    Parameters
    ----------
    highest_db : float or None
        Top of the domes put on clipped lines.
    blank_below_mps : float
        Half width of the emptied ground line.
    one_sided : bool
        Empty the side on which the target is not, as a detector's Doppler gate would; the side is that of the torso
        velocity found without.
    clipped : bool
        Whether the levels end where the display ends; only simulated ones can do without.
    """

    highest_db: float | None = HIGHEST_DB
    blank_below_mps: float = measures.SLOWEST_MPS
    one_sided: bool = False
    clipped: bool = True


ENTRIES = {
    "as described": Entry(),
    "clipped lines left flat": Entry(highest_db=None),
    "ground left in": Entry(blank_below_mps=0.0),
    "target's side only": Entry(one_sided=True),
}


def signature_of(image: Image, level_db: measures.FloatArray, entry: Entry = ENTRIES["as described"]) -> xr.DataArray:
    """Convert an image to a signature.

    Cut and mirrored as its reading requires.
    """
    velocity_mps = measures.VELOCITY_MPS
    if image.from_mps is not None:
        below = int((velocity_mps < image.from_mps).sum())
        velocity_mps = np.r_[velocity_mps[-below:] + 2 * measures.EDGE_MPS, velocity_mps[:-below]]
        level_db = np.roll(level_db, below, axis=0)
    shown = (image.until_s or np.inf) >= TIME_S
    return displayed_signature(level_db[:, shown], entry, time_s=TIME_S[shown], velocity_mps=velocity_mps)


def displayed_signature(
    level_db: measures.FloatArray, entry: Entry = ENTRIES["as described"], *, time_s: measures.FloatArray = TIME_S,
    velocity_mps: measures.FloatArray = measures.VELOCITY_MPS,
) -> xr.DataArray:  # fmt: skip
    """Convert displayed levels (velocity, time) to a signature."""
    return convert_levels_to_signature(
        level_db.T, time_s=time_s, velocity_mps=velocity_mps,
        wavelength_m=carrier_to_wavelength_m(9.7e9), prf_hz=1.0 / measures.PRI_S, cpi_pulses=measures.WINDOW_SWEEPS,
        hop=measures.HOP_SWEEPS, range_m=RANGE_M, floor_db=measures.FLOOR_DB if entry.clipped else None,
        ceiling_db=measures.CEILING_DB if entry.clipped else None,
        highest_db=entry.highest_db if entry.clipped else None, blank_below_mps=entry.blank_below_mps,
    )  # fmt: skip


def gait_of(image: Image, level_db: measures.FloatArray, entry: Entry = ENTRIES["as described"]) -> Result:
    """Measure the features of one image."""
    mu = signature_of(image, level_db, entry)
    found = analyze_signature(mu, make_level_gate(mu), ANALYSIS, label=image.label)
    if not entry.one_sided:
        return found
    own_side = read_axis(mu, "velocity") * (found.features.torso_velocity_mps or 0.0) > 0
    return analyze_signature(mu * own_side.astype(np.float32), make_level_gate(mu), ANALYSIS, label=image.label)


def step_times_s(result: Result) -> measures.FloatArray:
    """Return times one gait period apart, at the fastest limbs.

    Relative to the torso.
    """
    if result.gait_frequency_hz is None:
        return np.empty(0)
    mu = result.normalised_signature
    times_s = read_axis(mu, "time")
    apart_hz = np.abs(read_axis(mu, "doppler") - (result.torso_doppler_hz or 0.0))
    turn = 2.0 * np.pi * result.gait_frequency_hz
    swing = mu.values @ apart_hz
    phase = float(np.angle(((swing - swing.mean()) * np.exp(-1j * turn * times_s)).sum()))
    first = np.ceil((turn * times_s[0] + phase) / (2.0 * np.pi))
    last = np.floor((turn * times_s[-1] + phase) / (2.0 * np.pi))
    return np.asarray((2.0 * np.pi * np.arange(first, last + 1) - phase) / turn)


def draw(image: Image, result: Result) -> Figure:
    """Plot an image with torso line, steps and cadence spectrum.

    Values read by eye are dotted.
    """
    figure = make_figure(width_in=15.0, height_in=6.0)
    left, right = figure.subplots(1, 2, width_ratios=(3, 1))
    mu = result.signature
    times_s, velocity_mps = read_axis(mu, "time"), read_axis(mu, "velocity")
    level_db = 10.0 * np.log10(np.maximum(mu.values.T, 1e-3))
    extent = (times_s[0], times_s[-1], velocity_mps[0], velocity_mps[-1])
    shown = left.imshow(level_db, origin="lower", aspect="auto", extent=extent, cmap="magma", vmin=-30, vmax=-5)
    line_mps = result.main_line_hz * float(mu.attrs["wavelength_m"]) / 2.0
    left.plot(times_s, line_mps, color="#3fd0ff", lw=1.6, label="torso line")
    left.axhline(image.eye_mps, color="white", ls=":", lw=1.4, label="torso by eye")
    for number, step_s in enumerate(step_times_s(result)):
        left.axvline(step_s, color="#7dff7a", lw=0.8, alpha=0.8, label="one period each" if number == 0 else None)
    name_axes(left, title=image.key.replace("__", " "), x="time (s)", y="velocity (m/s)")
    left.legend(loc="lower right", fontsize=9, facecolor="#303030", labelcolor="white")
    figure.colorbar(shown, ax=left, label="level (dB below the maximum)", pad=0.01)
    draw_cadence(right, image, result)
    return figure


def draw_cadence(panel: Axes, image: Image, result: Result) -> None:
    """Plot the cadence spectrum with measured, read and known frequencies."""
    spectrum = result.cadence_spectrum
    cadence_hz, power = read_axis(spectrum, "cadence"), spectrum.values
    shown = cadence_hz <= 8.0
    panel.plot(cadence_hz[shown], power[shown] / power[shown].max(), color="black", lw=1.2)
    for name, frequency_hz, colour, dash in (
        ("gait frequency", result.gait_frequency_hz, "#1a9c18", "-"),
        ("by eye", image.eye_hz, "#c03028", ":"),
        ("known", image.known_hz, "#3060c0", "--"),
    ):
        if frequency_hz is not None:
            panel.axvline(frequency_hz, color=colour, ls=dash, lw=1.6, label=f"{name}: {frequency_hz:.2f} Hz")
    name_axes(panel, title="Cadence spectrum", x="cadence (Hz)", y="power (1 = strongest)")
    panel.legend(loc="upper right", fontsize=9)


def shown_number(value: float | None, digits: int = 2) -> str:
    """Format a number; a dash for None."""
    return "-" if value is None or not np.isfinite(value) else f"{value:.{digits}f}"


def short_flags(result: Result) -> str:
    """Return the flags without those of missing harmonics."""
    return ", ".join(flag for flag in result.flags if not flag.startswith("harmonic_ratio")) or "-"


def gait_table(results: dict[str, Result]) -> str:
    """Tabulate measured, read and known values of every image."""
    lines = [
        "| image | v_m | by eye | known | f_mu Hz | second | by eye | known | B_mu m/s | fast limbs by eye "
        "| step length m | rho | n | confidence | SNR dB | eye | flags |",
        "| --- |" + " ---: |" * 14 + " --- | --- |",
    ]
    for image in IMAGES:
        found = results[image.key]
        features, quality = found.features, found.quality
        wide_hz, half_m = features.doppler_bandwidth_hz, float(found.signature.attrs["wavelength_m"]) / 2.0
        numbers = (
            features.torso_velocity_mps, image.eye_mps, image.known_mps, found.gait_frequency_hz,
            quality.get("second_candidate_hz"), image.eye_hz, image.known_hz,
            None if wide_hz is None else wide_hz * half_m, image.eye_limb_mps, features.step_length_m,
            features.limb_torso_ratio, quality.get("periodicity"), quality.get("gait_confidence"),
            quality["snr_mu_db"],
        )  # fmt: skip
        cells = " | ".join(shown_number(value) for value in numbers)
        words = f"{image.sure} | {short_flags(found)}"
        lines.append(f"| {image.key.replace('__', ' ')} | {cells} | {words} |")
    return "\n".join(lines)


@dataclass
class Tally:
    """Counts of agreeing values."""

    count: int = 0
    within_5: int = 0
    within_10: int = 0
    octave: int = 0

    def add(self, found: float | None, wanted: float | None) -> None:
        """Count one pair; none without a value read by eye."""
        if wanted is None:
            return
        ratio = (found or 0.0) / wanted
        self.count += 1
        self.within_5 += abs(ratio - 1.0) <= 0.05
        self.within_10 += abs(ratio - 1.0) <= 0.10
        self.octave += min(abs(ratio / 2.0 - 1.0), abs(ratio * 2.0 - 1.0)) <= 0.10

    def cells(self) -> str:
        """Format the counts for a table."""
        return f"{self.within_5}/{self.count} | {self.within_10}/{self.count} | {self.octave}/{self.count}"


GROUPS: dict[str, tuple[str, ...]] = {"people": ("human",), "dogs": ("dog",), "horses and cows": ("horse", "cow")}


def agreement_table(results: dict[str, Result]) -> str:
    """Tabulate the agreement with read and known values by class."""
    lines = ["| | within 5 % | within 10 % | twice or half |", "| --- | ---: | ---: | ---: |"]
    for name, labels in GROUPS.items():
        tallies = {text: Tally() for text in ("v_m, eye", "v_m, known", "f_mu, eye", "f_mu, known")}
        for image in IMAGES:
            if image.label in labels:
                found = results[image.key]
                speed_mps, rate_hz = found.features.torso_velocity_mps, found.gait_frequency_hz
                tallies["v_m, eye"].add(speed_mps, image.eye_mps)
                tallies["v_m, known"].add(speed_mps, image.known_mps)
                tallies["f_mu, eye"].add(rate_hz, image.eye_hz)
                tallies["f_mu, known"].add(rate_hz, image.known_hz)
        lines += [f"| {name}: {text} | {tally.cells()} |" for text, tally in tallies.items()]
    by_chance = Tally()
    for image in IMAGES:
        for other in IMAGES:
            if other is not image and other.eye_hz is not None:
                by_chance.add(results[image.key].gait_frequency_hz, other.eye_hz)
    return "\n".join([*lines, f"| by chance: f_mu of one image, eye of another | {by_chance.cells()} |"])


def trust_table(results: dict[str, Result]) -> str:
    """Tabulate the accuracy by confidence and by flag."""
    lines = ["| f_mu with | within 5 % of the eye | 10 % | twice or half |", "| --- | ---: | ---: | ---: |"]
    kinds = {name: Tally() for name in ("confidence 0.9 or more", "less", "no low_confidence", "low_confidence")}
    for image in IMAGES:
        found = results[image.key]
        confidence = found.quality.get("gait_confidence")
        names = ["low_confidence" if "low_confidence" in found.flags else "no low_confidence"]
        if confidence is not None:
            names.append("confidence 0.9 or more" if confidence >= 0.9 else "less")
        for name in names:
            kinds[name].add(found.gait_frequency_hz, image.eye_hz)
    return "\n".join([*lines, *(f"| {name} | {tally.cells()} |" for name, tally in kinds.items())])


def variants_table(levels: dict[str, measures.FloatArray], first: dict[str, Result]) -> str:
    """Tabulate the effect of each choice of the conversion."""
    lines = [
        "| | v_m within 5 % | 10 % | twice or half | f_mu within 5 % | 10 % | twice or half "
        "| f_mu flagged low_confidence | median distance of B_mu + 0.4 m/s from the eye's fast limbs, m/s |",
        "| --- |" + " ---: |" * 8,
    ]
    for name, entry in ENTRIES.items():
        speed, rate, apart, low = Tally(), Tally(), [], 0
        for image in IMAGES:
            found = first[image.key] if name == "as described" else gait_of(image, levels[image.key], entry)
            speed.add(found.features.torso_velocity_mps, image.eye_mps)
            rate.add(found.gait_frequency_hz, image.eye_hz)
            low += "low_confidence" in found.flags
            wide_hz = found.features.doppler_bandwidth_hz
            if wide_hz is not None and image.eye_limb_mps is not None:
                wide_mps = wide_hz * float(found.signature.attrs["wavelength_m"]) / 2.0
                apart.append(abs(wide_mps + entry.blank_below_mps - image.eye_limb_mps))
        cells = f"{speed.cells()} | {rate.cells()} | {low}/{len(IMAGES)} | {np.median(apart):.2f}"
        lines.append(f"| {name} | {cells} |")
    return "\n".join(lines)


MOTIONS = {"3": "creep", "0": "walk", "2": "stride", "1": "run"}
KNOWN_CW_MPS = {"creep": "0.69", "walk": "0.98", "stride": "1.24", "run": "1.69"}
"""Medians over recordings of the median over bursts of the strongest line: people gather speed and stop in them."""


def cw_torso_mps(path: Path) -> float:
    """Measure the torso velocity of one 24 GHz recording.

    By the whole analysis; the gate holds its one range bin.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DoppelgaitWarning)  # nearly all clip near the radar
        found = analyze(read_cw_text(path), gate=(0.0, 1.0))[0].features.torso_velocity_mps
    return np.nan if found is None else found


def cw_speeds(folder: Path) -> dict[str, measures.FloatArray]:
    """Measure torso velocities by motion, slowest first.

    And away and toward of one session.
    """
    groups: dict[str, list[float]] = {name: [] for name in MOTIONS.values()}
    for path in sorted(folder.glob("22*/*_RE.txt")):
        match = re.fullmatch(r"22\d{4}_\d_(\d)_\d+_RE", path.stem)
        if match:
            groups[MOTIONS[match[1]]].append(cw_torso_mps(path))
    for name, motion in (("walk away, other session", "1"), ("walk toward, other session", "2")):
        groups[name] = [cw_torso_mps(p) for p in sorted(folder.glob(f"211118/211118_*_{motion}_[123]_RE.txt"))]
    for name, person in (("dog", "3"), ("person, same set-up", "4")):
        groups[name] = [cw_torso_mps(folder / "211109" / f"211109_{person}_{n}_RE.txt") for n in (2, 3)]
    return {name: np.array(values) for name, values in groups.items()}


def cw_table(speeds: dict[str, measures.FloatArray]) -> str:
    """Tabulate torso velocities by motion.

    And how often a recording is faster than one of the motion before it.
    """
    lines = [
        "| 24 GHz | recordings | torso m/s, median (10-90 %) | known | toward | faster than the one above |",
        "| --- | ---: | ---: | ---: | ---: | ---: |",
    ]
    before: measures.FloatArray | None = None
    for name, values in speeds.items():
        low, middle, high = np.percentile(values, (10, 50, 90))
        faster = None if before is None or name not in KNOWN_CW_MPS else 100.0 * (values[:, None] > before).mean()
        lines.append(
            f"| {name} | {values.size} | {middle:.2f} ({low:.2f} to {high:.2f}) | {KNOWN_CW_MPS.get(name, '-')} "
            f"| {int((values > 0).sum())} | {shown_number(faster, 0)}{'' if faster is None else ' %'} |"
        )
        before = values
    return "\n".join(lines)


def eye_table() -> str:
    """Tabulate the counts in every image."""
    lines = ["| image | counted | eye | notes |", "| --- | --- | --- | --- |"]
    for image in IMAGES:
        cut = "" if image.until_s is None else f"only to {image.until_s} s"
        turned = "" if image.from_mps is None else f"axis from {image.from_mps} m/s"
        lines.append(f"| {image.key.replace('__', ' ')} | {image.read} | {image.sure} | {cut or turned or '-'} |")
    return "\n".join(lines)


def main(data: Path, out: Path) -> None:
    """Read, measure, plot and write."""
    begun_s = time.perf_counter()
    levels = levels_of(data)
    out.mkdir(parents=True, exist_ok=True)
    results = {image.key: gait_of(image, levels[image.key]) for image in IMAGES}
    for image in IMAGES:
        name = f"xband-gait-{image.key.replace('__', '-')}.png"
        viz.save_figure(draw(image, results[image.key]), out / name)
    parts = [
        gait_table(results), agreement_table(results), trust_table(results), variants_table(levels, results),
        eye_table(), cw_table(cw_speeds(data / CW_FOLDER)),
    ]  # fmt: skip
    text = "\n\n".join(parts) + "\n"
    (out / "xband-gait.md").write_text(text, encoding="utf-8")
    print(text + f"\n{time.perf_counter() - begun_s:.0f} s")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, help=f"folder with {DATA_FILE} and {CW_FOLDER}")
    parser.add_argument("out", type=Path, help="folder for figures and table; made if missing")
    arguments = parser.parse_args()
    main(arguments.data, arguments.out)
