"""Hybrids of recorded clips compared with plain loops.

    python studies/hybrid_motion.py MOTION_FOLDER --page

Question: do hybrids keep feet and lengths, and do they widen the spread of their recordings?

Each clip has three hybrids with partners of its half. People are divided by subject; hybrids of one half are compared
with recordings of the other half, next to plain loops of the first half. Dogs are one animal a data set: the
recordings of each are divided in turn. Every target walks head-on to the same radar for 3 s without noise. Spread and
difference are medians over ten features and the speed: spread over that of the other half, difference of the means in
pooled standard deviations, share of the other half's recordings inside the range. It takes about 4 minutes of one
core.

Not shown: whether classifiers learn more from hybrids than from loops.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
from harness import finish, make_parser, markdown, quiet, run_jobs
from motion_comparison import FEATURES, OBSERVATION_S, SHORTEST_S, measure
from recorded_motion import find_clips, is_tuning

from doppelgait.core.config import validate
from doppelgait.core.draws import resolve
from doppelgait.core.errors import DoppelgaitError
from doppelgait.core.rng import Streams
from doppelgait.dataset.hybrids import add_hybrids
from doppelgait.motion.gait import add_gait_facts
from doppelgait.motion.hybrid import Hybrid, make_hybrid, measure_foot_slide
from doppelgait.motion.loop import loop
from doppelgait.motion.motion import Motion
from doppelgait.motion.readers import read
from doppelgait.motion.rigid import RIGID_M, find_rigid_pairs, measure_pair_lengths

FloatArray = npt.NDArray[np.float64]
SPREAD_FEATURES = (*FEATURES, "speed_mps")


def read_clips(folder: Path) -> Iterator[tuple[str, str, str, Motion]]:
    """Yield target, half, subject and motion of every straight clip."""
    for clip in find_clips(folder):
        short = clip.start_s is not None and clip.stop_s is not None and clip.stop_s - clip.start_s < SHORTEST_S
        try:
            motion = add_gait_facts(clip.read(folder))
        except DoppelgaitError:
            continue
        if not short:
            # a clinical walker has two clips
            subject = clip.file.rpartition("_")[0] if clip.file.startswith("clinic/") else clip.file
            yield clip.gait, "tuning" if is_tuning(clip, folder) else "held", subject, motion
    with (folder / "segments.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["class"] == "dog" and not row["footfall_note"]]
    files = sorted({row["file"] for row in rows})
    for row in rows:
        start_s, stop_s = (int(row[key]) / float(row["frame_rate_hz"]) for key in ("start_frame", "end_frame"))
        try:
            motion = add_gait_facts(read(folder / row["file"], start_s=start_s, stop_s=stop_s))
        except DoppelgaitError:
            continue
        half = f"{'MANN' if 'mann' in row['file'] else 'Tencent'} {'ab'[files.index(row['file']) % 2]}"
        yield f"dog {motion.facts.gait}", half, row["file"], motion


def length_error(motion: Motion, pairs: npt.NDArray[np.int32]) -> float:
    """Return the rms deviation of the lengths of rigid pairs from their means, as a share of these."""
    length = measure_pair_lengths(motion.position_m, pairs)
    return float(np.sqrt(np.mean((length / length.mean(axis=0) - 1.0) ** 2)))


def stiff_pairs(motion: Motion) -> npt.NDArray[np.int32]:
    """Return the pairs of neighbours whose distance the recording keeps."""
    pairs = find_rigid_pairs(np.asarray(motion.position_m))
    length = measure_pair_lengths(motion.position_m, pairs)
    return pairs[(length.std(axis=0) < RIGID_M) & (length.mean(axis=0) > 0.03)]


def compare(folder: Path, draws: int) -> Iterator[dict[str, Any]]:
    """Yield a row per plain loop and per hybrid, the refused ones with a reason."""
    entries = list(read_clips(folder))
    for half in dict.fromkeys(entry[1] for entry in entries):
        mine = [entry for entry in entries if entry[1] == half]
        motions = [entry[3] for entry in mine]
        for motion in motions:
            motion.position_m.setflags(write=False)
        plain = [{"kind": "file", "path": str(number)} for number in range(len(mine))]
        tables = add_hybrids(plain, motions, [entry[2] for entry in mine], "blend")
        for number, ((body, _, _, motion), table) in enumerate(zip(mine, tables, strict=True)):
            about = {"mover": body, "half": half, "clip": f"{motion.label} {motion.facts.file_time_s:.2f}"}
            pairs = stiff_pairs(motion)
            for draw in range(-1, draws):
                row: dict[str, Any] = {**about, "source": "recorded" if draw < 0 else "hybrid", "draw": draw}
                rng = Streams(1, number * 1000 + draw + 1).generator("motion")
                made = motion
                try:
                    if draw >= 0:
                        if "hybrid" not in table:
                            yield {**row, "refused": "clip"}
                            continue
                        sampled = resolve(table["hybrid"], seed=1, example=number * 1000 + draw, key=half)
                        hybrid = validate(Hybrid, sampled, where="hybrid")
                        made = make_hybrid(motion, hybrid, lambda other, all_of=motions: all_of[int(other["path"])])
                        row["blended"] = hybrid.other is not None
                    looped = loop(made, duration_s=OBSERVATION_S, rng=rng)
                    row |= {"slide": measure_foot_slide(looped), "clip_slide": measure_foot_slide(made)}
                    if made.markers == motion.markers and len(pairs):
                        row |= {"length": length_error(looped, pairs), "clip_length": length_error(made, pairs)}
                    yield row | measure(looped, body.partition(" ")[0] if body.startswith("dog") else "human")
                except DoppelgaitError as error:
                    yield {**row, "refused": str(error)}


def summarise(rows: pd.DataFrame) -> pd.DataFrame:
    """Return feet, lengths and refusals by target and half."""
    found = []
    for (body, half), group in rows.groupby(["mover", "half"], sort=False):
        for source, part in group.groupby("source", sort=False):
            refused = part["refused"].notna()
            good = part[~refused]
            found.append(
                {
                    "mover": body, "half": half, "source": source, "n": len(good), "refused": refused.mean(),
                    "clip_refused": (part["refused"] == "clip").mean(),
                    "blended": good["blended"].astype(float).mean(), "slide": good["slide"].mean(),
                    "length_percent": 100 * good["length"].mean(),
                    "clip_length_percent": 100 * good["clip_length"].mean(),
                    "speed_sd": good["speed_mps"].std(),
                }
            )  # fmt: skip
    return pd.DataFrame(found)


def compare_spread(rows: pd.DataFrame) -> pd.DataFrame:
    """Return difference and spread of one half's loops and hybrids against the recordings of the other half."""
    found = []
    kept = rows[rows["refused"].isna()]
    for body, group in kept.groupby("mover", sort=False):
        halves = list(dict.fromkeys(group["half"]))
        for half, other in [(a, b) for a in halves for b in halves if a != b]:
            target = group[(group["half"] == other) & (group["source"] == "recorded")]
            for source in ("recorded", "hybrid"):
                mine = group[(group["half"] == half) & (group["source"] == source)]
                for name in SPREAD_FEATURES:
                    real, ours = target[name].astype(float).dropna(), mine[name].astype(float).dropna()
                    if min(real.size, ours.size) < 4:
                        continue
                    pooled = float(np.sqrt((real.var() + ours.var()) / 2))
                    found.append(
                        {
                            "mover": body, "of": half, "against": other, "source": source, "feature": name,
                            "difference_sd": (real.mean() - ours.mean()) / pooled,
                            "spread_ratio": ours.std() / real.std(),
                            "covered": float(((real >= ours.min()) & (real <= ours.max())).mean()),
                        }
                    )  # fmt: skip
    return pd.DataFrame(found)


def compare_all(job: tuple[str, int]) -> list[dict[str, Any]]:
    """Return the rows of a folder."""
    quiet()
    folder, draws = job
    return list(compare(Path(folder), draws))


def main() -> None:
    """Compare all clips and write the tables."""
    parser = make_parser(__doc__, motion_folder="folder of the motion recordings")
    parser.add_argument("--draws", type=int, default=3, help="hybrids per clip")
    options = parser.parse_args()
    rows = pd.DataFrame(run_jobs(compare_all, [(str(options.motion_folder), options.draws)], rows=options.rows))
    spread = compare_spread(rows)
    sizes = spread.assign(difference_sd=spread["difference_sd"].abs())
    numbers = ["difference_sd", "spread_ratio", "covered"]
    table = sizes.groupby(["mover", "of", "source"], sort=False)[numbers].median().reset_index()
    sections = {
        "Feet, lengths and refusals": markdown(summarise(rows), digits=3),
        "Difference and spread, median over features": table,
    }
    finish(__file__, __doc__, sections, page=options.page)


if __name__ == "__main__":
    main()
