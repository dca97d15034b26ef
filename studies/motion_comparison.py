"""Recorded movers against the models at equal speed and size: features in pooled standard deviations.

    python studies/motion_comparison.py MOTION_FOLDER [--out ROWS.csv]

Every clip is repeated to the same time and walked head-on to the same radar without noise; so is the model of the same
speed and leg length (dogs: withers). People are split by subject: the model's curves were made of the tuning half, the
held half is the headline. Dogs are one animal a data set, each shown alone.
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from recorded_motion import find_clips, is_tuning, measure_cycle
from step_variation import clean_deviations, measure_steps

from doppelgait.core.errors import DoppelgaitError
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
"""Models of each recorded person: chance of the drawn persons moves an entry of few clips by half a deviation."""
FEATURES = (
    "forward_envelope", "backward_envelope", "torso_ripple_gait", "torso_ripple", "bandwidth", "limb_torso_ratio",
    "alternate_steps", "stance_share", "gait_frequency_hz", "step_length_m",
)  # fmt: skip


def measure(motion: Motion, label: str) -> dict[str, Any]:
    """Measure the features of a mover that comes head-on, speeds over its mean speed."""
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


def compare_people(folder: Path) -> Iterator[dict[str, Any]]:
    """Yield rows of recorded people and of their models."""
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
        for source, values, mover in found:
            variation = measure_variation(mover) if clip.gait == "walk" else {}  # runs are too short
            names = {"clip": f"{clip.file} {clip.start_s}", "mover": clip.gait, "half": half, "source": source}
            yield {**names, **values, **variation}


def compare_dogs(folder: Path) -> Iterator[dict[str, Any]]:
    """Yield rows of recorded dogs and of their models; gallops take the gallop that their speed allows."""
    with (folder / "segments.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["class"] == "dog" and not row["footfall_note"]]
    for number, row in enumerate(rows):
        rate_hz = float(row["frame_rate_hz"])
        gaits = ("canter", "gallop") if row["gait"].startswith("canter") else (row["gait"],)
        if gaits == ("",):
            continue
        try:
            start_s, stop_s = (int(row[key]) / rate_hz for key in ("start_frame", "end_frame"))
            motion = read(folder / row["file"], start_s=start_s, stop_s=stop_s)
            recorded = measure(loop(motion, duration_s=OBSERVATION_S), "dog")
            model = make_dog(gaits, recorded["speed_mps"], motion.facts.height_m, number)
        except DoppelgaitError as error:
            print(f"left out: {error}")
            continue
        half = "MANN" if "mann" in row["file"] else "Tencent"
        for source, values in (("recorded", recorded), ("model", measure(model, "dog"))):
            clip = f"{row['file']} {row['start_frame']}"
            yield {"clip": clip, "mover": "/".join(gaits), "half": half, "source": source, **values}


def make_dog(gaits: tuple[str, ...], speed_mps: float, withers_m: float, number: int) -> Motion:
    """Make a dog in the first of some gaits that its speed allows."""
    for gait in gaits:
        rng = np.random.default_rng(number)
        froude = froude_number(speed_mps, hip_height_m(BUILDS["standard"], withers_m))
        dog = sample_dog(rng, gait=gait, froude=froude).parameters(
            build="standard", speed_mps=speed_mps, withers_m=withers_m, start_phase=float(rng.uniform())
        )
        try:
            return quadruped_gait(**dog, duration_s=OBSERVATION_S, rng=rng)
        except DoppelgaitError:
            if gait == gaits[-1]:
                raise
    raise AssertionError


def summarise(rows: pd.DataFrame) -> pd.DataFrame:
    """Return means and the difference in pooled standard deviations, by mover, half and feature."""
    found = []
    for (mover, half), group in rows.groupby(["mover", "half"], sort=False):
        recorded, model = (group[group["source"] == source] for source in ("recorded", "model"))
        for name in FEATURES:
            real, ours = (part[name].astype(float).dropna() for part in (recorded, model))
            if min(real.size, ours.size) < 3:
                continue
            pooled = float(np.sqrt((real.var() + ours.var()) / 2))
            found.append(
                {
                    "mover": mover, "half": half, "feature": name, "clips": real.size, "recorded": real.mean(),
                    "model": ours.mean(), "difference_sd": (real.mean() - ours.mean()) / pooled,
                }
            )  # fmt: skip
    return pd.DataFrame(found)


def main() -> None:
    """Compare all movers and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("motion_folder", type=Path)
    parser.add_argument("--out", type=Path, help="all rows, as CSV")
    arguments = parser.parse_args()
    rows = pd.DataFrame([*compare_people(arguments.motion_folder), *compare_dogs(arguments.motion_folder)])
    if arguments.out is not None:
        rows.to_csv(arguments.out, index=False)
    table = summarise(rows)
    print(table.round({"recorded": 3, "model": 3, "difference_sd": 2}).to_string(index=False))
    for (mover, half), group in table.groupby(["mover", "half"], sort=False):
        sizes = group["difference_sd"].abs()
        print(f"{mover}, {half}: mean {sizes.mean():.2f} sd, largest {sizes.max():.2f}")


if __name__ == "__main__":
    main()
