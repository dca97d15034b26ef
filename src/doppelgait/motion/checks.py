"""Checks of cleaned motions: what no body can do is a wrong unit, rate, axis or name."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from doppelgait.core.errors import warn_caller
from doppelgait.motion.clean import NOISE_MPS, velocity_error_mps
from doppelgait.motion.gait import is_quadruped, measure_gait, measure_travel
from doppelgait.motion.motion import GRAVITY_MPS2, Motion
from doppelgait.motion.segments import crop, find_segments
from doppelgait.motion.skeleton import (
    LEG_SHARE,
    guess_species,
    list_spellings,
    load_markers,
    measure_leg_length,
    strip_subject,
)

PERSON_M, ANIMAL_M = (0.5, 2.8), (0.04, 2.2)
"""Stature, from a standing infant to the tallest person; height, from a rat to a draught horse."""
TALLER = 1.4
"""Largest ratio of the height of the head to the stature that belongs to the legs."""
LIES = 0.3
"""Smallest height of the head of a person who stands, sits or crawls, relative to the stature."""
UNITS_M = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254, "ft": 0.3048}
HIP_SHARE, WITHERS_SHARE = 0.53, 0.8
"""Height of the hips over stature (Drillis and Contini 1966), and over that of the withers."""
SIMILARITY, SIMILARITY_POWER = 2.5, 0.3
"""Stride length over hip height is 2.5 Fr^0.3 in people and cursorial animals (Alexander 1976, and Jayes 1983)."""
TIME_FACTOR, PERSON_TIME_FACTOR, UNSURE_TIME_FACTOR = 2.5, 1.8, 3.0
"""Animals scatter by 20 % about that law: three times as much is a factor of 1.7 in stride length, 2.5 in time. People
scatter by 10 %: 3.5 times as much is 1.4, and 1.8. Without footfalls, a stride may be two, or half of one."""
MOST_NAMES = 6
STRAIGHT = 0.9
TRIED_FACTORS = (1.0, 2.0, 4.0, 8.0, 0.5, 0.25)
SPREAD_M = {"torso": 1.3, "trunk": 3.0}
OTHER_SPREAD_M = 1.0
"""Largest distance of two points of one part: the trunk of the largest person with the arms' width, and a limb."""
STRETCH = 0.3
"""Largest standard deviation of a bone's length over its mean. Skin moves by a tenth."""
JUMPS_M = 0.2
"""Smallest step off a smooth path that is reported as a jump: more than a limb that starts or stops makes."""


@dataclass(frozen=True)
class Check:
    """One check of a cleaned motion: its message, or an empty text."""

    name: str
    find: Callable[[Motion], str]
    refuses: bool = False
    warns: bool = True


def check_motion(motion: Motion) -> Motion:
    """Warn of what no body can do, and note it in the report."""
    messages: dict[Check, str] = {}
    for check in CHECKS:
        # of a body that is impossible, one reason is enough
        if check.refuses and any(other.refuses for other in messages):
            continue
        if text := check.find(motion):
            messages[check] = text
            if check.warns:
                warn_caller(f"{motion.label}: {text}")
    notes = list(motion.report.get("notes", []))
    return motion.with_report(
        notes=[*notes, *(text for text in messages.values() if text not in notes)],
        implausible=[text for check, text in messages.items() if check.refuses],
        has_jumps=any(check.name == "jumps" for check in messages),
    )


HUMAN_PELVIS = re.compile("(left|right|l|r)?(asi|asis|psi|psis|ias|ips|sacr|sacral|hjc)")
"""Names that a set of legs has only if they are a person's."""


def _find_species(motion: Motion) -> str:
    if is_quadruped(motion):
        return "animal"
    words = [word for name in motion.markers for word in list_spellings(strip_subject(name))]
    return "human" if any(map(HUMAN_PELVIS.fullmatch, words)) else guess_species(motion.markers)


def _check_size(motion: Motion) -> str:
    species, height_m = _find_species(motion), motion.facts.height_m
    leg_m, hip_m = measure_leg_length(motion.position_m, motion.markers)
    if species == "human":
        size_m = leg_m / LEG_SHARE if math.isfinite(leg_m) else height_m
        if size_m > 0 and not PERSON_M[0] <= size_m <= PERSON_M[1]:
            in_file = size_m / motion.report.get("metres_per_unit", 1.0)
            units = [f"units='{unit}'" for unit, metres in UNITS_M.items() if 1.3 <= in_file * metres <= 2.1]
            remedy = f"Try {' or '.join(units)}" if units else "Give it: units=..."
            return f"a person of {size_m:.2g} m, by the names of its points: is the unit wrong? {remedy}"
        if hip_m > leg_m / 2 and height_m > TALLER * size_m:
            return f"its head is {height_m:.2f} m above its feet, but its legs of {leg_m:.2f} m are of a smaller person"
    elif species and height_m > 0 and not ANIMAL_M[0] <= height_m <= ANIMAL_M[1]:
        return f"an animal of {height_m:.2g} m, by the names of its points: is the unit or the upward axis wrong?"
    return ""


def _check_lying(motion: Motion) -> str:
    size_m = measure_leg_length(motion.position_m, motion.markers)[0] / LEG_SHARE
    if _find_species(motion) == "human" and motion.facts.height_m < LIES * size_m:
        return (
            f"its head is only {motion.facts.height_m:.2f} m above its feet, but its legs belong to a person of "
            f"{size_m:.2f} m, who lies, or another axis points up: give up_axis='x', 'y', 'z', '-x', '-y' or '-z'"
        )
    return ""


def _check_stride(motion: Motion) -> str:
    leg_m, hips_at_m = measure_leg_length(motion.position_m, motion.markers)
    hip_m = HIP_SHARE * (leg_m / LEG_SHARE if math.isfinite(leg_m) else motion.facts.height_m)
    hip_m = WITHERS_SHARE * motion.facts.height_m if is_quadruped(motion) else hip_m
    if not hip_m > 0 or hips_at_m < leg_m / 2:  # a person who crawls
        return ""
    travel = measure_travel(motion.position_m, rate_hz=motion.rate_hz)
    part = motion
    if not (travel.get("straightness") or 0.0) > STRAIGHT:
        segments = find_segments(motion)
        if not segments:
            return ""
        part = crop(motion, max(segments, key=lambda segment: segment.duration_s))
        travel = measure_travel(part.position_m, rate_hz=part.rate_hz)
    speed_mps = travel["net_displacement_m"] / part.duration_s
    if travel["net_displacement_m"] < 2 * hip_m:
        return ""
    # at a rate that is wrong by a factor of several, no steps are measured; segments have the speeds of gaits
    for tried in TRIED_FACTORS if part is motion else (1.0,):
        gait = measure_gait(part.remake(part.position_m, part.facts, rate_hz=tried * part.rate_hz))
        stride_hz = gait.stride_frequency_hz / tried
        if stride_hz > 0 and (tried == 1.0 or gait.gait):
            break
    else:
        return ""
    usual = SIMILARITY * (speed_mps**2 / (GRAVITY_MPS2 * hip_m)) ** SIMILARITY_POWER
    factor = (speed_mps / stride_hz / hip_m / usual) ** (0.5 / SIMILARITY_POWER)
    most = PERSON_TIME_FACTOR if _find_species(motion) == "human" else TIME_FACTOR
    most = most if tried == 1.0 or gait.measured_from == "footfalls" else UNSURE_TIME_FACTOR
    if 1 / most <= factor <= most:
        return ""
    ratio = f"{factor:.1f} times higher" if factor > 1 else f"{1 / factor:.1f} times lower"
    return (
        f"strides of {speed_mps / stride_hz:.2f} m at {stride_hz:.2f} Hz do not belong to hips {hip_m:.2f} m high: the "
        f"frame rate of {motion.rate_hz:.4g} Hz is probably {ratio}, about {motion.rate_hz * factor:.0f} Hz; give the "
        "true one: rate_hz=..."
    )


def _describe_floor(motion: Motion, *kinds: str) -> str:
    tilt_deg, range_m = motion.report.get("floor_tilt_deg") or 0.0, motion.report.get("floor_range_m", 0.0)
    texts = {
        "tilted axes": f"the floor under its feet was tilted by {tilt_deg:.0f} degrees, with the body; it was levelled",
        "unclear": f"its feet stand on a plane that rises by {tilt_deg:.0f} degrees: a slope, or tilted axes",
        "slope": f"moves on a slope of {tilt_deg:.0f} degrees: the body is upright",
        "uneven": f"stands at heights that differ by {range_m:.2f} m: stairs or jumps",
    }
    return next((texts[kind] for kind in kinds if kind == motion.report.get("floor")), "")


def _check_noise(motion: Motion) -> str:
    noise_m, cutoff_hz, rate_hz = motion.report.get("noise_m"), motion.report.get("lowpass_hz"), motion.rate_hz
    if not noise_m or not cutoff_hz or velocity_error_mps(noise_m, cutoff_hz, rate_hz=rate_hz) < 0.99 * NOISE_MPS:
        return ""
    before_mps = velocity_error_mps(noise_m, rate_hz / 2, rate_hz=rate_hz)
    return (
        f"its positions have noise of {1e3 * noise_m:.0f} mm per coordinate, {before_mps:.2g} m/s in the velocities of "
        f"trunk and limbs; a low-pass of {cutoff_hz:.1f} Hz leaves {NOISE_MPS:g} m/s"
    )


def _check_jumps(motion: Motion) -> str:
    least_m = max(JUMPS_M, 6 * motion.report.get("noise_m", 0.0))
    jumps = [jump for jump in motion.report.get("jumps", []) if jump["step_m"] > least_m]
    if not jumps:
        return ""
    largest = max(jumps, key=lambda jump: jump["step_m"])
    points = list_few(jump["point"] for jump in jumps)
    return (
        f"{len(jumps)} jump(s) of points ({points}), up to {largest['step_m']:.2f} m at frame {largest['frame']}: "
        "faults of the recording, no speeds; correct them, or give start_s and stop_s"
    )


def list_few(names: Iterable[str]) -> str:
    """List the first of some names."""
    names = list(dict.fromkeys(names))
    return ", ".join(names[:MOST_NAMES]) + (", ..." if len(names) > MOST_NAMES else "")


def _check_held(motion: Motion) -> str:
    count, dropped = motion.report.get("samples_held", 0), motion.report.get("dropped", {})
    lost = [name for reason, names in dropped.items() if reason.startswith("not seen throughout") for name in names]
    text = f"{count} samples repeat the position before and end in a jump: they are gaps"
    return text * bool(count) + f"; {list_few(lost)} cannot be filled and are left out" * bool(count and lost)


def _check_spread(motion: Motion) -> str:
    if _find_species(motion) != "human":
        return ""
    for part in dict.fromkeys(filter(None, motion.parts)):
        points = [i for i, other in enumerate(motion.parts) if other == part]
        limit_m = SPREAD_M.get(part, OTHER_SPREAD_M)
        size_m = np.median(np.linalg.norm(np.ptp(motion.position_m[:, points], axis=1), axis=1))
        if size_m > limit_m:
            names = ", ".join(motion.markers[i] for i in points[:4])
            return f"the points of its {part.replace('_', ' ')} ({names}) are {size_m:.1f} m apart: several bodies?"
    words = [list_spellings(strip_subject(name)) for name in motion.markers]
    for side in ("left", "right"):
        for ends in load_markers()["limbs"]["bones"]:
            allowed = [{start + name for name in end.split() for start in (side, side[0])} for end in ends]
            joints = [[i for i, spellings in enumerate(words) if names.intersection(spellings)] for names in allowed]
            if all(joints):
                a, b = (motion.position_m[:, points].mean(axis=1) for points in joints)
                length_m = np.linalg.norm(a - b, axis=1)
                if length_m.std() > STRETCH * length_m.mean():
                    pair = " and ".join(motion.markers[points[0]] for points in joints)
                    return (
                        f"the distance of {pair} changes from {length_m.min():.2f} to {length_m.max():.2f} m: no bone"
                    )
    return ""


CHECKS = (
    Check("treadmill", lambda motion: next((n for n in motion.report.get("notes", []) if "treadmill" in n), "")),
    Check("size", _check_size, refuses=True),
    Check("lying", _check_lying),
    Check("stride", _check_stride, refuses=True),
    Check("spread", _check_spread, refuses=True),
    Check("floor", lambda motion: _describe_floor(motion, "tilted axes", "unclear")),
    Check("slope", lambda motion: _describe_floor(motion, "slope", "uneven"), warns=False),
    Check("noise", _check_noise),
    Check("held", _check_held),
    Check("jumps", _check_jumps),
)
"""Checks of a cleaned motion. A folder of motions leaves out files that a check refuses."""
