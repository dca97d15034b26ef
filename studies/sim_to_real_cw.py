"""Realism of simulated 24 GHz recordings, measured against real ones.

    python studies/sim_to_real_cw.py RADAR_DATA --mocap MOTION_FOLDER --page

Question: do simulated bursts of people have the Doppler profile of real ones, and can a classifier separate them?

RADAR_DATA holds `cw24_kmkim036`: people who start from rest towards a module that takes bursts of 128 samples at 3000
S/s, one about every 200 ms. Of the sessions of January 2022 person and motion of every recording are known. Persons 0
and 3 are the development half: levels, speeds, noise and I/Q errors of the sensor model are theirs. Persons 1, 2 and 4
are the reported half; nothing is chosen on it.

One function, `measure`, takes the strongest approaching line of a burst as the torso. It computes the energy around
1.5, 2, 2.5 and 3 times the velocity of the torso, in a band that is a quarter of that velocity wide, over the energy
around the torso, and leaves out clipped bursts and bursts less than 25 dB above the noise. The profile is the mean in
dB over bursts, and then over recordings. No constant of the sensor model is chosen by it. Simulated sets are made with
five seeds of 48 recordings; tables have mean and range over them. A domain classifier separates the reported half from
each set, tested on recordings that it has not seen; an AUC of 0.5 means no separation. It takes about 3 minutes of one
core.

Not shown: no class is recognised. The bursts show no steps, and there are only two recordings, of one dog.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import sim_to_real_cw_sensor as sensor
from harness import finish, make_parser, markdown, spread
from sim_to_real_cw_sensor import Plan
from xband_gait import CW_FOLDER, MOTIONS
from xband_measures import FloatArray

from doppelgait.classify.domain import Comparison, compare_recordings
from doppelgait.core.errors import DoppelgaitWarning
from doppelgait.core.labels import read_axis
from doppelgait.processing import Analysis, burst_signature
from doppelgait.radar import Recording
from doppelgait.radar.readers.text import read_cw_text

DEVELOPMENT, REPORTED = ("0", "3"), ("1", "2", "4")
"""Persons by the numbers in the names of files."""
RATIOS = (1.5, 2.0, 2.5, 3.0)
HALF_BAND = 0.125
"""Bands of the profile are a quarter of the torso's speed wide."""
SPEEDS_MPS = (0.5, 2.9)
"""Torso speeds between which the window resolves the bands and the highest is below the Doppler limit."""
NOISE_FROM_MPS = 7.5
LEAST_SNR_DB = 25.0
CLIPPED = 0.998
COUNT, SEEDS = 48, 5
SETS = {"recorded motion": Plan(), "models": Plan(motion="models")}


@dataclass(frozen=True)
class Seen:
    """A recording and what is known of it."""

    recording: Recording
    motion: str
    person: str


@dataclass(frozen=True)
class Bursts:
    """Measures of the bursts of a recording."""

    level_db: FloatArray
    noise_db: FloatArray
    clipped: FloatArray
    torso_mps: FloatArray
    profile_db: FloatArray


def measure(recording: Recording) -> Bursts:
    """Measure the bursts of a recording, real or simulated."""
    samples = recording.samples.matrix.reshape(-1, sensor.PULSES)
    mu = burst_signature(
        recording.baseband, None, Analysis(doppler_bins=1024), wavelength_m=recording.radar.wavelength_m
    )  # fmt: skip
    power, velocity = mu.values.astype(np.float64), read_axis(mu, "velocity")
    quiet = np.abs(velocity) > NOISE_FROM_MPS
    noise = np.median(power[:, quiet], axis=1) / np.log(2.0)  # the mean of an exponential law by its median
    approaching = np.where(velocity > SPEEDS_MPS[0] / 2.0, power, 0.0)
    torso_mps = velocity[approaching.argmax(axis=1)]
    full = np.maximum(np.abs(samples.real), np.abs(samples.imag)).max(axis=1)
    clipped = full > CLIPPED * sensor.FULL_SCALE_V
    seen = ~clipped & (torso_mps > SPEEDS_MPS[0]) & (torso_mps < SPEEDS_MPS[1])
    seen &= approaching.max(axis=1) > 10.0 ** (LEAST_SNR_DB / 10.0) * noise
    sums = np.concatenate([np.zeros((len(power), 1)), np.cumsum(power, axis=1)], axis=1)
    profile = np.full((len(power), len(RATIOS)), np.nan)
    for burst in np.flatnonzero(seen):
        edges = torso_mps[burst] * np.add.outer((1.0, *RATIOS), (-HALF_BAND, HALF_BAND))
        below = sums[burst][np.searchsorted(velocity, edges)]
        energy = below[:, 1] - below[:, 0]
        profile[burst] = 10.0 * np.log10(energy[1:] / energy[0])
    decibel = 10.0 * np.log10(
        np.stack([samples.var(axis=1), noise / mu.attrs["window_energy"]]) / sensor.FULL_SCALE_V**2
    )
    return Bursts(decibel[0], decibel[1], clipped, torso_mps, profile)


def profile_db(seen: Sequence[Seen]) -> FloatArray:
    """Average the profiles of recordings, dB, shape (4,). Each recording counts once."""
    rows = [found.profile_db for found in map(measure, (one.recording for one in seen))]
    known = [row[np.isfinite(row[:, 0])] for row in rows]
    return np.asarray(np.mean([row.mean(axis=0) for row in known if len(row)], axis=0))


def quartiles_db(seen: Sequence[Seen]) -> FloatArray:
    """Return the quartiles of all bursts, dB, shape (2, 4)."""
    rows = np.concatenate([measure(one.recording).profile_db for one in seen])
    return np.asarray(np.nanpercentile(rows, (25, 75), axis=0))


def real_people(data: Path, persons: Sequence[str], most: int | None = None) -> list[Seen]:
    """Read the recordings of some persons, or exit."""
    found = []
    for path in sorted((data / CW_FOLDER).glob("22*/*_RE.txt")):
        _, person, motion, *_ = path.stem.split("_")
        if person in persons:
            found.append((path, MOTIONS[motion], person))
    if not found:
        sys.exit(f"{data / CW_FOLDER}: has no recordings of persons {persons}; give the folder that holds {CW_FOLDER}")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DoppelgaitWarning)  # nearly all clip near the radar
        return [Seen(read_cw_text(path), motion, person) for path, motion, person in found[:most]]


def made_people(plan: Plan, seed: int, count: int, mocap: Path | None) -> list[Seen]:
    """Simulate recordings of a plan."""
    own = Plan(**{**plan.__dict__, "seed": seed})
    return [Seen(*sensor.recording_of(own, number, mocap)) for number in range(count)]


def format_row(name: str, real_db: FloatArray, profiles: FloatArray, judged: Sequence[Comparison]) -> list[str]:
    """Return the cells of a simulated set: profile, farthest miss and domain classifiers over seeds."""
    miss = np.abs(profiles.mean(axis=0) - real_db).max()
    aucs = [[one.auc[0] for one in judged], [one.auc_of_shape[0] for one in judged], [one.auc_linear for one in judged]]
    return [name, *(spread(column, 1) for column in profiles.T), f"{miss:.1f}", *map(spread, aucs)]


def compare(data: Path, mocap: Path | None, *, count: int, seeds: int, real: int | None = None) -> dict[str, str]:
    """Simulate, measure and compare; return the tables."""
    held, development = (real_people(data, persons, real) for persons in (REPORTED, DEVELOPMENT))
    real_db = profile_db(held)
    people = {person: [one for one in held if one.person == person] for person in REPORTED}
    known = {"real, reported half": held, "real, development half": development}
    known |= {f"person {person}": some for person, some in people.items() if some}
    rows = [[name, *(f"{value:.1f}" for value in profile_db(some)), "", "", "", ""] for name, some in known.items()]
    groups, far = {"real": held}, []
    for name, plan in SETS.items():
        if plan.motion == "recorded" and mocap is None:
            continue
        sets = [made_people(plan, seed, count, mocap) for seed in range(seeds)]
        judged = [compare_recordings([s.recording for s in held], [s.recording for s in made]) for made in sets]
        rows.append(format_row(name, real_db, np.array([profile_db(made) for made in sets]), judged))
        groups[name] = [one for made in sets for one in made]
        far += [[name, key, *value] for key, value in list(judged[0].distances.items())[:5]]
    middle = [[name, *(f"{low:.1f} to {high:.1f}" for low, high in quartiles_db(g).T)] for name, g in groups.items()]
    ratios = tuple(f"{ratio:g}" for ratio in RATIOS)
    head = ("times the torso's velocity", *ratios, "farthest miss, dB", "AUC", "AUC, shape", "AUC, linear")
    return {
        "Doppler profile, dB, and domain classifiers": markdown(head, rows),
        "Middle half of the bursts, dB": markdown(("", *ratios), middle),
        "Statistics that differ most": markdown(("simulated set", "statistic", "distance", "AUC of it alone"), far),
    }


def main() -> None:
    """Run the study and write its tables."""
    parser = make_parser(__doc__, data=f"folder with {CW_FOLDER}")
    parser.add_argument("--mocap", type=Path, help="folder with human and dog motion capture")
    parser.add_argument("--count", type=int, default=COUNT, help="simulated recordings of a seed")
    parser.add_argument("--seeds", type=int, default=SEEDS)
    options = parser.parse_args()
    sections = compare(options.data, options.mocap, count=options.count, seeds=options.seeds)
    finish(__file__, __doc__, sections, page=options.page)


if __name__ == "__main__":
    main()
