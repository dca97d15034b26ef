"""Height of a recorded body (E-01).

It is the stature of a person or the withers height of an animal.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from doppelgait.motion.skeleton import name_bones, reduce_word, strip_subject

FloatArray = npt.NDArray[np.float64]

LEG_SHARE = 0.245 + 0.246
"""Length from hip to knee and from knee to ankle over stature (Drillis and Contini 1966, as in Winter 2009, figure
4.1)."""
SKULL_SHARE = 0.93
"""Height of the eyes over stature (Drillis and Contini 1966). A skeleton's head that ends lower lacks the skull."""
PERSON_M = (0.6, 2.4)
UPRIGHT = 0.75
"""Minimum height of an animal's withers, relative to their 95th percentile, in the frames in which it stands, and
minimum height of a person's hips relative to the length of the leg (those of a rat are lower)."""
MARKERS_OF_JOINTS = (
    "hip hjc hipjoint grt gtr ftc trochanter greatertrochanter",
    "kne knee kjc kneelat kneelateral kneemed kneemedial kneein knm fle fme lfc mfc",
    "ank ankle ajc anklelat anklelateral anklemed anklemedial ankin anm lma mma mall lmal mmal fal tam",
)
"""Names of hip, knee and ankle without the side: of markers, and of joints with the name of the joint."""
JOINTS_OF_BONES = ("upleg upperleg legupper thigh", "leg lowerleg calf shin", "foot")
"""Names of hip, knee and ankle without the side, if joints have the name of the bone that starts there."""


def measure_height(position: FloatArray, names: Sequence[str], parts: Sequence[str]) -> tuple[float, str]:
    """Measure the height of a body. Shapes: position (T, P, 3)."""
    # the height of a person with a head is that of its highest point
    z = position[:, :, 2]
    if "trunk" in parts:
        return _measure_withers(z, names, parts), ""
    head = [i for i, part in enumerate(parts) if part == "head"]
    leg_m, hip_m = measure_leg_length(position, names)
    height_m = leg_m / LEG_SHARE
    if head:
        top_m = float(np.median(z[:, head].max(axis=1)))
        is_skeleton = name_bones({reduce_word(strip_subject(name)) for name in names})
        if not (is_skeleton and top_m < SKULL_SHARE * height_m < PERSON_M[1] and hip_m > UPRIGHT * leg_m):
            return top_m, ""
        return height_m, (
            f"the joints of the head end at {top_m:.2f} m, below the top of the head of a person with legs of "
            f"{leg_m:.2f} m: height_m = {height_m:.2f} m is estimated from the legs"
        )
    if PERSON_M[0] < height_m < PERSON_M[1] and hip_m > UPRIGHT * leg_m:
        return height_m, (
            f"no head among the points: height_m = {height_m:.2f} m is estimated from the legs, {leg_m:.2f} m from hip "
            "to ankle"
        )
    return float("nan"), "no head among the points, and no hips, knees and ankles: the height is unknown"


def measure_leg_length(position: FloatArray, names: Sequence[str]) -> tuple[float, float]:
    """Measure leg length and hip height, m."""
    # the leg is from hip over knee to ankle. Values are means of both legs, or NaN if the names
    # include no whole leg.
    words = [reduce_word(strip_subject(name)) for name in names]
    joints = JOINTS_OF_BONES if name_bones(set(words)) else MARKERS_OF_JOINTS
    words = [word.rstrip("0123456789") for word in words]
    lengths, hips = [], []
    for side in ("left", "right"):
        sided = [{start + name for name in one.split() for start in (side, side[0])} for one in joints]
        points = [[i for i, word in enumerate(words) if word in allowed] for allowed in sided]
        if all(points):
            hip, knee, ankle = (position[:, these].mean(axis=1) for these in points)
            bones = (np.linalg.norm(hip - knee, axis=1), np.linalg.norm(knee - ankle, axis=1))
            lengths.append(sum(float(np.median(bone)) for bone in bones))
            hips.append(float(np.median(hip[:, 2])))
    return (float(np.mean(lengths)), float(np.mean(hips))) if lengths else (float("nan"), float("nan"))


def _measure_withers(z: FloatArray, names: Sequence[str], parts: Sequence[str]) -> float:
    """Return the withers height above the lower fore paw."""
    # it is the median over the frames in which the animal stands
    trunk = [i for i, part in enumerate(parts) if part == "trunk"]
    named = [i for i in trunk if "withers" in reduce_word(strip_subject(names[i]))]
    fore = [i for i, part in enumerate(parts) if part.endswith("_fore_paw")]
    above = z[:, named or trunk].max(axis=1) - (z[:, fore].min(axis=1) if fore else 0.0)
    return float(np.median(above[above >= UPRIGHT * np.percentile(above, 95)]))
