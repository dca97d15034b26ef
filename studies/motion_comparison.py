"""Recorded targets compared with the models at equal speed and size.

    python studies/motion_comparison.py MOTION_FOLDER --page

Question: by how many standard deviations do the features of recorded people and animals differ from those of models?

Every clip is repeated to 3 s and walks head-on to the same radar without noise; so do three models of the same speed
and leg length (dogs: withers). Speeds are over the mean speed. People are divided by subject: the curves of the model
were made of the tuning half, so the held half counts. Dogs are one animal a data set: the curves are those of MANN.
One horse on a treadmill with seven marked points is description only. Differences are recorded minus model, over the
pooled standard deviation, which forgives a model that spreads too widely, and over that of the recordings alone. Clips
with a gait frequency that is read more than 25 % off are counted and left out. It takes about 3 minutes of one core.

Not shown: other aspects, curves and stops, and more than two dogs.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from dog_curves import DOGS
from harness import finish, make_parser, markdown, quiet, run_jobs
from recorded_dogs import find_dogs
from recorded_motion import find_clips, is_tuning, measure_cycle
from step_variation import clean_deviations, measure_steps

from doppelgait.core.errors import DoppelgaitError
from doppelgait.motion.gait import measure_gait
from doppelgait.motion.loop import loop
from doppelgait.motion.models import human_gait, quadruped_gait, sample_dog, sample_person
from doppelgait.motion.models.quadruped_gaits import BUILDS, froude_number, hip_height_m
from doppelgait.motion.motion import Motion
from doppelgait.motion.readers import read
from doppelgait.pipeline import analyze, simulate
from doppelgait.radar import Radar
from doppelgait.scene import Scene, Target

OBSERVATION_S = 3.0
RADAR = Radar.preset("x4-long", prf_hz=1600)
"""Unambiguous to 16 m/s: a paw in a gallop at 4.5 m/s comes near 12."""
LEG_OF_STATURE = 0.491
SHORTEST_S = 1.1
DRAWS = 3
"""Models of each recorded person and dog: chance of the drawn ones moves an entry of few clips by half a deviation."""
MISREAD = 0.25
"""A clip whose gait frequency is read further than this from the target's own is counted and left out."""
HORSE = "horse"
HORSE_WITHERS_M = 1.28
HORSE_POINTS = ("head", "withers", "rump", "left_fore_paw", "right_fore_paw", "left_hind_paw", "right_hind_paw")
"""The points that are marked on the recorded horse."""
FEATURES = (
    "forward_envelope", "backward_envelope", "torso_ripple_gait", "torso_ripple", "bandwidth", "limb_torso_ratio",
    "alternate_steps", "stance_share", "gait_frequency_hz", "step_length_m",
)  # fmt: skip
OTHERS = ("duty_factor", "step_time_sd", "step_length_sd")
"""Shown, but no part of the means."""


def measure(motion: Motion, label: str) -> dict[str, Any]:
    """Measure the features of a target that comes head-on, speeds over its mean speed."""
    scene = Scene([Target(motion, label=label, range_m=14.0)], duration_s=OBSERVATION_S)
    recording = simulate(scene, RADAR, angles=False)
    result = analyze(recording, gate="truth")[0]
    further, speed_mps = result.extended, recording.truth[0].ground_speed_mps
    values = {
        "forward_envelope": further["forward_envelope_range_mps"],
        "backward_envelope": further["backward_envelope_range_mps"],
        "torso_ripple_gait": further["torso_ripple_gait_mps"],
        "torso_ripple": further["torso_ripple_mps"],
        "bandwidth": (result.features.doppler_bandwidth_hz or np.nan) * RADAR.wavelength_m / 2,
    }
    return {
        "speed_mps": speed_mps,
        **{name: np.nan if value is None else value / speed_mps for name, value in values.items()},
        "limb_torso_ratio": result.features.limb_torso_ratio,
        "alternate_steps": further["alternate_likeness"],
        "stance_share": further["stance_share"],
        "gait_frequency_hz": result.gait_frequency_hz,
        "step_length_m": result.features.step_length_m,
        "own_frequency_hz": recording.truth[0].gait_frequency_hz,
    }


def measure_variation(motion: Motion) -> dict[str, float]:
    """Measure how a person's steps differ, relative to their mean; nothing of too few steps."""
    steps = measure_steps(motion)
    if steps is None:
        return {}
    found = {}
    for name in ("time", "length"):
        deviation, sides = clean_deviations(getattr(steps, name), steps.left)
        found[f"step_{name}_sd"] = float(np.sqrt((deviation**2).mean(axis=0).sum() / (steps.left.size - 2)))
        found[f"{name}_asymmetry"] = float(sides.mean())
    return found


def label_rows(found: Sequence[tuple[str, dict[str, Any], Motion]], **names: str) -> Iterator[dict[str, Any]]:
    """Yield the rows of a recorded target and of its models, with their names and duty factors."""
    for source, values, target in found:
        yield {**names, "source": source, **values, "duty_factor": measure_gait(target).duty_factor}


def compare_people(folder: Path) -> Iterator[dict[str, Any]]:
    """Yield rows of recorded people and of their models, which are healthy; patients are movers of their own."""
    with (folder / "clinic" / "manifest.csv").open() as file:
        patients = {row["file"] for row in csv.DictReader(file) if row["group"] != "Healthy"}
    for number, clip in enumerate(find_clips(folder)):
        if clip.start_s is not None and clip.stop_s is not None and clip.stop_s - clip.start_s < SHORTEST_S:
            continue
        try:
            motion = clip.read(folder)
            cycle = measure_cycle(motion)
            if cycle is None or not np.isfinite(cycle.leg_m):
                continue
            found = [("recorded", measure(loop(motion, duration_s=OBSERVATION_S), "human"), motion)]
            for draw in range(DRAWS):
                rng = np.random.default_rng([number, draw])
                size = {
                    "speed_mps": found[0][1]["speed_mps"],
                    "height_m": cycle.leg_m / LEG_OF_STATURE,
                    "body": "adult",
                }
                person = sample_person(rng).parameters(**size, gait=clip.gait, start_phase=float(rng.uniform()))
                model = human_gait(**person, duration_s=OBSERVATION_S, rng=rng)
                found.append(("model", measure(model, "human"), model))
        except DoppelgaitError as error:
            print(f"left out: {error}")
            continue
        half = "tuning" if is_tuning(clip, folder) else "held"
        mover = "clinical" if clip.file in patients else clip.gait
        if clip.gait == "walk":  # runs are too short
            found = [(source, values | measure_variation(target), target) for source, values, target in found]
        yield from label_rows(found, clip=f"{clip.file} {clip.start_s}", mover=mover, half=half)


def compare_dogs(folder: Path) -> Iterator[dict[str, Any]]:
    """Yield rows of recorded dogs and of their models; gallops take the gallop that their speed allows."""
    for number, clip in enumerate(find_dogs(folder)):
        gaits = ("canter", "gallop") if clip.gait == "canter" else (clip.gait,)
        if gaits == ("",):
            continue
        try:
            motion = clip.read(folder)
            recorded = measure(loop(motion, duration_s=OBSERVATION_S), "dog")
            found = [("recorded", recorded, motion)]
            for draw in range(DRAWS):
                rng = np.random.default_rng([number, draw])
                model = make_dog(gaits, recorded["speed_mps"], motion.facts.height_m, rng)
                found.append(("model", measure(model, "dog"), model))
        except DoppelgaitError as error:
            print(f"left out: {error}")
            continue
        half = next(name for name, part in DOGS.items() if part in clip.file)
        yield from label_rows(found, clip=f"{clip.file} {clip.start_s}", mover="/".join(gaits), half=half)


def compare_horse(folder: Path) -> Iterator[dict[str, Any]]:
    """Yield rows of the recorded horse and of its model, which keeps the marked points only."""
    for path in sorted((folder / HORSE).rglob("*.csv")):
        gait = next((gait for gait in ("walk", "trot") if gait in path.name), None)
        if gait is None:
            continue
        try:
            motion = read(path, units="mm", treadmill=True, segment="longest")
            recorded = measure(loop(motion, duration_s=OBSERVATION_S), HORSE)
            model = quadruped_gait(
                build=HORSE, gait=gait, speed_mps=recorded["speed_mps"], withers_m=HORSE_WITHERS_M,
                duration_s=OBSERVATION_S,
            )  # fmt: skip
            kept = [model.markers.index(point) for point in HORSE_POINTS]
            marked = model.with_points(model.position_m[:, kept], HORSE_POINTS, [model.parts[k] for k in kept])
            compared = measure(marked, HORSE)
        except DoppelgaitError as error:
            print(f"left out: {error}")
            continue
        found = [("recorded", recorded, motion), ("model", compared, marked)]
        yield from label_rows(found, clip=path.name, mover=f"{HORSE} {gait}", half=HORSE)


def make_dog(gaits: tuple[str, ...], speed_mps: float, withers_m: float, rng: np.random.Generator) -> Motion:
    """Make a dog in the first of some gaits that its speed allows."""
    froude = froude_number(speed_mps, hip_height_m(BUILDS["standard"], withers_m))
    for gait in gaits:
        try:
            dog = sample_dog(rng, gait=gait, froude=froude).parameters(
                build="standard", speed_mps=speed_mps, withers_m=withers_m, start_phase=float(rng.uniform())
            )
            return quadruped_gait(**dog, duration_s=OBSERVATION_S, rng=rng)
        except DoppelgaitError:
            if gait == gaits[-1]:
                raise
    raise AssertionError


def is_misread(rows: pd.DataFrame) -> pd.Series:
    """Return which rows have a gait frequency that is not the target's own; False where either is unknown."""
    off = rows["gait_frequency_hz"].astype(float) / rows["own_frequency_hz"].astype(float) - 1
    return off.abs() > MISREAD


def summarise(rows: pd.DataFrame) -> pd.DataFrame:
    """Return means and differences in standard deviations, by target, half and feature."""
    found = []
    for (target, half), group in rows.groupby(["mover", "half"], sort=False):
        recorded, model = (group[group["source"] == source] for source in ("recorded", "model"))
        for name in FEATURES + OTHERS:
            if name not in group:
                continue
            real, ours = (part[name].astype(float).dropna() for part in (recorded, model))
            if min(real.size, ours.size) < 3:
                continue
            pooled = float(np.sqrt((real.var() + ours.var()) / 2))
            difference = real.mean() - ours.mean()
            found.append(
                {
                    "mover": target, "half": half, "feature": name, "clips": real.size, "recorded": real.mean(),
                    "model": ours.mean(), "difference_sd": difference / pooled,
                    "difference_recorded_sd": difference / real.std(),
                }
            )  # fmt: skip
    return pd.DataFrame(found)


def tabulate_sizes(table: pd.DataFrame) -> pd.DataFrame:
    """Average the sizes of the differences of a target and half."""
    counted = table[table["feature"].isin(FEATURES) & (table["half"] != HORSE)]
    sizes = counted.assign(pooled=counted["difference_sd"].abs(), alone=counted["difference_recorded_sd"].abs())
    found = sizes.groupby(["mover", "half"], sort=False)[["pooled", "alone"]].agg(["mean", "max"])
    found.columns = [f"{kind} sd: {statistic}" for kind, statistic in found.columns]
    return found.reset_index()


def compare_kind(job: tuple[str, str]) -> list[dict[str, Any]]:
    """Return the rows of people, dogs or the horse of a folder."""
    quiet()
    kind, folder = job
    compare = {"people": compare_people, "dogs": compare_dogs, "horse": compare_horse}[kind]
    return list(compare(Path(folder)))


def main() -> None:
    """Compare all targets and write the tables."""
    parser = make_parser(__doc__, motion_folder="folder of the motion recordings")
    options = parser.parse_args()
    jobs = [(kind, str(options.motion_folder)) for kind in ("people", "dogs", "horse")]
    rows = pd.DataFrame(run_jobs(compare_kind, jobs, rows=options.rows, processes=options.processes))
    misread = is_misread(rows)
    counts = misread.groupby([rows["mover"], rows["half"], rows["source"]], sort=False).agg(["sum", "size"])
    table = summarise(rows[~misread])
    sections = {
        "Mean size of the differences": tabulate_sizes(table),
        "By feature": markdown(table, digits=3),
        "Clips that are misread, of all": counts.reset_index(),
    }
    finish(__file__, __doc__, sections, page=options.page)


if __name__ == "__main__":
    main()
