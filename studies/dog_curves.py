"""Mean curves of recorded dogs, as the tables of the quadruped's model.

    python studies/dog_curves.py MOTION_FOLDER [--dog MANN]

Averages all strides of one dog by gait and prints the tables of ``doppelgait.motion.models.curves``. Gallops are those
in the rotary order; those with the other lead are mirrored. It takes half a minute of one core.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from harness import FloatArray, make_parser
from recorded_dogs import Strides, find_dogs, measure_strides

from doppelgait.core.errors import DoppelgaitError

DOGS = {"MANN": "mann", "Tencent": "tencent"}
"""Data sets, each of one dog, and the part of a file's path that names them."""
SYMMETRICAL = ("walk", "pace", "trot")
SEGMENTS = {"scapula": ("top", "shoulder"), "manus": ("carpus", "fore_paw"), "metatarsus": ("hock", "hind_paw")}
N_HARMONICS = {"scapula": 6, "manus": 6, "metatarsus": 6, "neck": 2, "tail": 2}
"""Those of the trunk are 4; neck and tail move too differently from stride to stride for more than two."""


def rotary_lead(strides: Strides) -> str:
    """Return the hind foot that lands second in a rotary gallop; empty for another order."""
    for first, second in (("right", "left"), ("left", "right")):
        zero = strides.lag.get(f"{second}_hind", np.nan)
        lags = [(strides.lag.get(f"{s}_{e}", np.nan) - zero) % 1 for s, e in
                ((first, "hind"), (second, "fore"), (first, "fore"))]  # fmt: skip
        if 0.7 < lags[0] < 0.95 and lags[1] < lags[2] < 0.5:
            return second
    return ""


def elevation_deg(strides: Strides, upper: str, lower: str) -> FloatArray:
    """Return the elevation of a segment, 0 hanging down, positive with its lower end ahead, in every stride."""
    ahead = strides.ahead[lower] - strides.ahead[upper]
    return np.degrees(np.arctan2(ahead, strides.height[upper] - strides.height[lower]))


def curves_of(strides: Strides) -> dict[str, list[FloatArray]]:
    """Return the curves that the model has, stride by stride."""
    found: dict[str, list[FloatArray]] = {}
    if "pelvis" in strides.speed:
        for end, point in (("hind", "pelvis"), ("fore", "neck_base")):
            found[f"{end}_surge"], found[f"{end}_heave"] = [strides.speed[point]], [strides.height[point]]
            found[f"{end}_sway"] = [strides.aside[point]]
        found |= {name: [turn] for name, turn in strides.turn_deg.items()}
        rise = strides.height["head"] - strides.height["neck_base"]
        found["neck"] = [np.degrees(np.arctan2(rise, strides.ahead["head"] - strides.ahead["neck_base"]))]
        rise = strides.height["tail_tip"] - strides.height["tail_base"]
        behind = strides.ahead["tail_base"] - strides.ahead["tail_tip"]
        found["tail"] = [np.degrees(np.arctan2(rise, behind))]
    for name, (upper, lower) in SEGMENTS.items():
        for side in ("left", "right"):
            if f"{side}_{lower}" in strides.ahead:
                found.setdefault(name, []).append(elevation_deg(strides, f"{side}_{upper}", f"{side}_{lower}"))
    return found


def mean_curve(rows: list[FloatArray], *, harmonics: int, left_out: slice) -> FloatArray:
    """Return the mean of all strides at 20 phases, without some harmonics."""
    each = np.fft.rfft(np.concatenate(rows), axis=1)[:, : harmonics + 1] / rows[0].shape[1] * 2
    terms = each.mean(axis=0)
    terms[0] /= 2
    terms[left_out] = 0
    turns = np.exp(2j * np.pi * np.outer(np.arange(20) / 20, np.arange(harmonics + 1)))
    return np.asarray((turns @ terms).real)


def read_strides(folder: Path, dog: str) -> Iterator[tuple[str, Strides]]:
    """Yield gait and strides of the clips of one dog; gallops begin with the second hind foot of a rotary order."""
    for clip in find_dogs(folder):
        if not clip.gait or DOGS[dog] not in clip.file:
            continue
        try:
            motion = clip.read(folder)
        except DoppelgaitError as error:
            print(f"left out: {error}")
            continue
        strides = measure_strides(motion)
        if strides is None or clip.gait != "canter":
            if strides is not None:
                yield clip.gait, strides
            continue
        lead = rotary_lead(strides)
        if lead == "right":
            strides = measure_strides(motion, zero="right_hind")
        if strides is not None and (lead or dog != "MANN"):
            yield "gallop", strides


def main() -> None:
    """Print the tables of one dog."""
    parser = make_parser(__doc__, motion_folder="folder of the motion recordings")
    parser.add_argument("--dog", default="MANN", choices=DOGS)
    arguments = parser.parse_args()
    rows: dict[str, dict[str, list[FloatArray]]] = {}
    for gait, strides in read_strides(arguments.motion_folder, arguments.dog):
        table = rows.setdefault(gait, {})
        for name, found in curves_of(strides).items():
            table.setdefault(name, []).extend(found)
        for foot, shape in strides.swing.items():
            end = foot.partition("_")[2]
            table.setdefault(f"duty_{end}", []).append(np.array([[strides.duty[foot]]]))
            if len(shape):
                table.setdefault(f"swing_{end}", []).append(shape)
    for gait, table in rows.items():
        for name, found in table.items():
            curve, digits = np.nanmean(np.concatenate(found), axis=0), 2
            if name.startswith("swing"):
                curve = curve - np.linspace(curve[0], curve[-1], curve.size)
                curve = curve / np.trapezoid(curve, dx=1 / (curve.size - 1))
            elif not name.startswith("duty"):
                trunk, sideways = name not in SEGMENTS, name.endswith(("sway", "roll", "yaw"))
                # half strides of a symmetrical gait are equal, and mirrored sideways
                same = slice(not sideways, None, 2) if gait in SYMMETRICAL and trunk else slice(0)
                curve = mean_curve(found, harmonics=N_HARMONICS.get(name, 4), left_out=same)
                digits = 3 if name.endswith(("surge", "heave", "sway")) else 1
                if trunk:
                    curve = (curve - curve.mean())[: 10 if gait in SYMMETRICAL and not sideways else 20]
            values = ", ".join(f"{value:.{digits}f}" for value in curve)
            print(f"{gait}: {name} = [{values}] # {sum(len(part) for part in found)}")


if __name__ == "__main__":
    main()
