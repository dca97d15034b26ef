"""Realism of simulated 24 GHz recordings, measured against real ones.

    python studies/sim_to_real_cw.py RADAR_DATA OUT --mocap FOLDER [--count N] [--quick]

RADAR_DATA holds ``cw24_kmkim036``: people who set off towards a module that takes bursts of 128 samples at 3000 S/s,
one about every 200 ms. Of the sessions of January 2022 person and motion of every recording are known.

Protocol:

1. Persons 0 and 3 are the development half: levels, speeds, noise and I/Q errors of the sensor model are theirs.
   Persons 1, 2 and 4 are the reported half; nothing is chosen on it.
2. The Doppler profile is measured by one function, :func:`burst_profile`, of real and simulated recordings. No
   constant of the sensor model is chosen by it.
3. Every simulated set is made with several seeds; tables give mean and range over them. A domain classifier
   (:func:`doppelgait.classify.domain.compare_recordings`) separates the reported half from each simulated set, tested
   on recordings that it has not seen; 0.5 is not at all.

No class is recognised here: steps cannot be seen in columns at 5 Hz, and of a dog there are two recordings.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import sim_to_real_cw_sensor as sensor
import sim_to_real_tables as tables
from sim_to_real_cw_sensor import Plan
from xband_gait import CW_FOLDER, MOTIONS
from xband_measures import FloatArray

from doppelgait.classify.domain import Comparison, compare_recordings
from doppelgait.core.errors import DoppelgaitWarning
from doppelgait.core.labels import read_axis
from doppelgait.processing import Analysis
from doppelgait.processing.bursts import burst_signature
from doppelgait.radar import Recording
from doppelgait.radar.readers.cw_text import read_cw_text

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
REPORT = "sim-to-real-cw.md"
VARIANTS = {
    "recorded motion": Plan(),
    "models": Plan(motion="models"),
    "models, motion varied": Plan(motion="varied"),
}
ABLATIONS = {
    "nearest points of 16 ellipsoids": Plan(surface=False),
    "antenna narrow in elevation": Plan(wide=False),
    "noise drawn from -66 to -42 dB": Plan(fixed_noise=False),
    "at full speed, 0.5 to 2.5 m at the end": Plan(starts=False),
    "all four": Plan(surface=False, wide=False, fixed_noise=False, starts=False),
    "all four, models": Plan(motion="models", surface=False, wide=False, fixed_noise=False, starts=False),
}
ABLATION_SEEDS = 3


@dataclass(frozen=True)
class Seen:
    """A recording and what is known of it."""

    recording: Recording
    motion: str
    person: str


@dataclass(frozen=True)
class Bursts:
    """Measures of the bursts of a recording.

    Parameters
    ----------
    level_db, noise_db : ndarray, shape (J,)
        Power without the mean, and noise in the band of a burst, dB of full scale.
    clipped : ndarray of bool, shape (J,)
    torso_mps : ndarray, shape (J,)
        Strongest approaching line.
    profile_db : ndarray, shape (J, 4)
        Energy at 1.5, 2, 2.5 and 3 times the torso's speed over that at the torso's; NaN of a burst that is clipped,
        too slow, too fast or too weak.
    """

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
    """Average the profiles of recordings, dB, shape (4,).

    Each recording counts once.
    """
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


def ranged(values: Sequence[float], digits: int = 1) -> str:
    """Format the mean and range of values."""
    low, high = min(values), max(values)
    return f"{np.mean(values):.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


def conditions(seen: Sequence[Seen]) -> list[str]:
    """Return cells: noise, level by time, clipping, torso speeds by motion."""
    found = [measure(one.recording) for one in seen]
    noise_db = [np.median(one.noise_db[~one.clipped]) for one in found if not one.clipped.all()]
    level_db = np.array([one.level_db[: sensor.BURSTS] for one in found])
    clipped = np.array([one.clipped[: sensor.BURSTS] for one in found])
    cells = [f"{np.median(noise_db):.1f} ({np.percentile(noise_db, 10):.1f} to {np.percentile(noise_db, 90):.1f})"]
    cells += [f"{np.median(level_db[:, round(at_s / sensor.PERIOD_S)]):.0f}" for at_s in (0.0, 0.8, 1.6)]
    cells += [f"{100 * clipped.mean():.0f} %"]
    for motion in sensor.MOTIONS:
        known = [one for one, about in zip(found, seen, strict=True) if about.motion == motion]
        speeds = [np.median(one.torso_mps[np.isfinite(one.profile_db[:, 0])]) for one in known]
        cells.append(f"{np.nanmedian(speeds):.2f}" if speeds else "-")
    return cells


def format_row(name: str, real_db: FloatArray, profiles: FloatArray, judged: Sequence[Comparison]) -> list[str]:
    """Return the cells of the row of a simulated set.

    Profile, farthest miss and domain classifiers, mean and range over seeds.
    """
    miss = np.abs(profiles.mean(axis=0) - real_db).max()
    aucs = [[one.auc[0] for one in judged], [one.auc_of_shape[0] for one in judged], [one.auc_linear for one in judged]]
    return [name, *(ranged(column) for column in profiles.T), f"{miss:.1f}", *(ranged(values, 2) for values in aucs)]


def by_motion(groups: Mapping[str, Sequence[Seen]]) -> str:
    """Tabulate profiles by motion."""
    rows = []
    for motion in sensor.MOTIONS:
        for name, seen in groups.items():
            some = [one for one in seen if one.motion == motion]
            if some:
                rows.append([f"{motion}, {name}", *(f"{value:.1f}" for value in profile_db(some)), len(some)])
    return tables.markdown(("motion", *map(str, RATIOS), "recordings"), rows)


def main(
    data: Path, out: Path, mocap: Path | None, *, count: int, seeds: int, real: int | None = None,
    plans: Mapping[str, Plan] = {**VARIANTS, **ABLATIONS},
) -> str:  # fmt: skip
    """Simulate, measure, compare and write; return the report."""
    out.mkdir(parents=True, exist_ok=True)
    write = tables.Writer(out / REPORT)
    held, development = (real_people(data, persons, real) for persons in (REPORTED, DEVELOPMENT))
    real_db = profile_db(held)
    rows = [["real, reported half", *(f"{value:.1f}" for value in real_db), "", "", "", ""]]
    for person in REPORTED:
        some = [one for one in held if one.person == person]
        if some:
            rows.append([f"person {person}", *(f"{value:.1f}" for value in profile_db(some)), "", "", "", ""])
    own_db = profile_db(development)
    rows.append(["real, development half", *(f"{value:.1f}" for value in own_db), "", "", "", ""])
    groups: dict[str, list[Seen]] = {"real": held}
    far: list[list[object]] = []
    for name, plan in plans.items():
        if plan.motion == "recorded" and mocap is None:
            continue
        several = ABLATION_SEEDS if name in ABLATIONS else SEEDS
        sets = [made_people(plan, seed, count, mocap) for seed in range(min(seeds, several))]
        judged = [compare_recordings([s.recording for s in held], [s.recording for s in made]) for made in sets]
        rows.append(format_row(name, real_db, np.array([profile_db(made) for made in sets]), judged))
        if name in VARIANTS:
            groups[name] = [one for made in sets for one in made]
            far += [[name, key, *value] for key, value in list(judged[0].distances.items())[:5]]
        head = ("", *(f"{ratio:g}" for ratio in RATIOS), "farthest miss, dB", "AUC", "AUC, shape", "AUC, linear")
        write(["# Real and simulated people at 24 GHz", tables.markdown(head, rows)])
    bursts = {name: quartiles_db(seen) for name, seen in groups.items()}
    spread = [[name, *(f"{low:.1f} to {high:.1f}" for low, high in found.T)] for name, found in bursts.items()]
    times = ("at rest", "0.8 s", "1.6 s")
    place = ("noise, dB (10 to 90 %)", *(f"level, {at}" for at in times), "clipped bursts", *sensor.MOTIONS)
    parts = [
        "# Real and simulated people at 24 GHz",
        tables.markdown(head, rows),
        "Middle half of the bursts, dB:\n\n" + tables.markdown(("", *map(str, RATIOS)), spread),
        by_motion(groups),
        tables.markdown(("", *place), [[name, *conditions(seen)] for name, seen in groups.items()]),
        tables.markdown(("simulated set", "statistic that differs most", "distance", "AUC of it alone"), far),
    ]
    write(parts)
    return (out / REPORT).read_text(encoding="utf-8")


if __name__ == "__main__":
    parser = tables.make_parser(__doc__, CW_FOLDER, COUNT, "recordings")
    parser.add_argument("--mocap", type=Path, help="folder with human and dog motion capture")
    arguments = parser.parse_args()
    size = {"count": 4, "seeds": 1, "real": 6} if arguments.quick else {"count": arguments.count, "seeds": SEEDS}
    print(main(arguments.data, arguments.out, arguments.mocap, **size))
