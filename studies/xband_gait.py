"""Gait of real X-band spectrograms, and torso speeds of real 24 GHz recordings.

    python studies/xband_gait.py RADAR_DATA --page

Question: do torso velocity and gait frequency of real images agree with readings by eye, and are torso speeds of real
recordings in the expected order?

RADAR_DATA holds `fmcw_xband_manga/decoded_levels.npz` (what these images are: `studies/xband_measures.py`) and
`cw24_kmkim036`. The images enter at the signature: levels between -30 and -10 dB, a column every 8 sweeps of 1.68 ms.
(The source prints 7 s for what by its own velocity axis are 8.4 s.) Rows within 0.4 m/s of zero, the ground, are
emptied; the features get nothing else. One image is cut before the dog brakes, and of the runner, whose Doppler wraps,
the axis is turned so that it starts at -0.6 m/s. It takes about 1 minute of one core.

Not shown: the readings by eye were not blind, and the estimator was chosen with these images in view.
"""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr
import xband_measures as measures
from harness import finish, make_parser, markdown, quiet
from xband_readings import IMAGES, Image

from doppelgait.core.errors import DoppelgaitWarning
from doppelgait.core.units import carrier_to_wavelength_m
from doppelgait.pipeline import Result, analyze
from doppelgait.pipeline.spectrogram import convert_levels_to_signature, make_level_gate
from doppelgait.pipeline.target import analyze_signature
from doppelgait.processing import Analysis
from doppelgait.radar.readers.text import read_cw_text

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


def signature_of(image: Image, level_db: measures.FloatArray) -> xr.DataArray:
    """Convert an image to a signature. Cut and mirrored as its reading requires."""
    velocity_mps = measures.VELOCITY_MPS
    if image.from_mps is not None:
        below = int((velocity_mps < image.from_mps).sum())
        velocity_mps = np.r_[velocity_mps[-below:] + 2 * measures.EDGE_MPS, velocity_mps[:-below]]
        level_db = np.roll(level_db, below, axis=0)
    shown = (image.until_s or np.inf) >= TIME_S
    return displayed_signature(level_db[:, shown], time_s=TIME_S[shown], velocity_mps=velocity_mps)


def displayed_signature(
    level_db: measures.FloatArray,
    *,
    time_s: measures.FloatArray = TIME_S,
    velocity_mps: measures.FloatArray = measures.VELOCITY_MPS,
) -> xr.DataArray:
    """Convert displayed levels (velocity, time) to a signature."""
    return convert_levels_to_signature(
        measures.rebuild_peaks(level_db.T, HIGHEST_DB),
        time_s=time_s,
        velocity_mps=velocity_mps,
        wavelength_m=carrier_to_wavelength_m(9.7e9),
        prf_hz=1.0 / measures.PRI_S,
        cpi_pulses=measures.WINDOW_SWEEPS,
        hop=measures.HOP_SWEEPS,
        range_m=RANGE_M,
        blank_below_mps=measures.SLOWEST_MPS,
        floor_db=measures.FLOOR_DB,
    )


def gait_of(image: Image, level_db: measures.FloatArray) -> Result:
    """Measure the features of one image."""
    mu = signature_of(image, level_db)
    return analyze_signature(mu, make_level_gate(mu), ANALYSIS, label=image.label)


def gait_table(results: dict[str, Result]) -> str:
    """Tabulate measured and read values of every image."""
    rows = []
    for image in IMAGES:
        found = results[image.key]
        features, quality = found.features, found.quality
        wide_hz, half_m = features.doppler_bandwidth_hz, float(found.signature.attrs["wavelength_m"]) / 2.0
        flags = ", ".join(flag for flag in found.flags if not flag.startswith("harmonic_ratio")) or "-"
        numbers = (
            features.torso_velocity_mps,
            image.eye_mps,
            found.gait_frequency_hz,
            image.eye_hz,
            None if wide_hz is None else wide_hz * half_m,
            image.eye_limb_mps,
            features.step_length_m,
            features.limb_torso_ratio,
            quality.get("gait_confidence"),
            quality["snr_mu_db"],
        )
        notes = [image.read] + [f"only to {image.until_s} s"] * (image.until_s is not None)
        rows.append((image.key.replace("__", " "), *numbers, image.sure, flags, "; ".join(notes)))
    head = ("image", "v_m m/s", "by eye", "f_mu Hz", "by eye", "B_mu m/s", "fast limbs by eye", "step length m", "rho")
    return markdown((*head, "confidence", "SNR dB", "reading", "flags", "counted by eye"), rows)


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
    """Tabulate the agreement with values read by eye, by class."""
    lines = ["| | within 5 % | within 10 % | twice or half |", "| --- | ---: | ---: | ---: |"]
    for name, labels in GROUPS.items():
        tallies = {text: Tally() for text in ("v_m", "f_mu")}
        for image in IMAGES:
            if image.label in labels:
                found = results[image.key]
                tallies["v_m"].add(found.features.torso_velocity_mps, image.eye_mps)
                tallies["f_mu"].add(found.gait_frequency_hz, image.eye_hz)
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


MOTIONS = {"3": "creep", "0": "walk", "2": "stride", "1": "run"}


def cw_torso_mps(path: Path) -> float:
    """Measure the torso velocity of one 24 GHz recording. By the whole analysis; the gate holds its one range bin."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DoppelgaitWarning)  # nearly all clip near the radar
        found = analyze(read_cw_text(path), gate=(0.0, 1.0))[0].features.torso_velocity_mps
    return np.nan if found is None else found


def cw_speeds(folder: Path) -> dict[str, measures.FloatArray]:
    """Measure torso velocities by motion, slowest first. And away and toward of one session."""
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
    """Tabulate torso velocities by motion, and how often a recording is faster than one of the motion before it."""
    rows: list[tuple[object, ...]] = []
    before: measures.FloatArray | None = None
    for name, values in speeds.items():
        low, middle, high = np.percentile(values, (10, 50, 90))
        ordered = before is not None and name in MOTIONS.values()
        faster = f"{100.0 * (values[:, None] > before).mean():.0f} %" if ordered else "-"
        rows.append((name, values.size, f"{middle:.2f} ({low:.2f} to {high:.2f})", int((values > 0).sum()), faster))
        before = values
    head = ("24 GHz", "recordings", "torso m/s, median (10-90 %)", "toward", "faster than the one above")
    return markdown(head, rows)


def main() -> None:
    """Read, measure and write."""
    options = make_parser(__doc__, data=f"folder with {DATA_FILE} and {CW_FOLDER}").parse_args()
    quiet()
    levels = levels_of(options.data)
    results = {image.key: gait_of(image, levels[image.key]) for image in IMAGES}
    sections = {
        "Images": gait_table(results),
        "Agreement with readings by eye": agreement_table(results),
        "Agreement by confidence": trust_table(results),
        "24 GHz": cw_table(cw_speeds(options.data / CW_FOLDER)),
    }
    finish(__file__, __doc__, sections, page=options.page)


if __name__ == "__main__":
    main()
