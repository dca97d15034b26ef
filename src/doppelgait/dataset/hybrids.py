"""Distributions of hybrid motion for the clips of a folder.

They stay within what each clip allows.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Literal

from doppelgait.core.errors import DoppelgaitError, DoppelgaitWarning
from doppelgait.motion.gait import is_quadruped
from doppelgait.motion.hybrid import (
    FACTOR,
    Hybrid,
    blend,
    find_speed_law,
    find_speed_limits,
    find_stride_limits,
    make_hybrid,
    retarget,
)
from doppelgait.motion.motion import Motion

STATURE_SD = 0.056
"""Stature range of adults relative to the mean: men 1.75 +-0.07 m, women 1.62 +-0.065 m, as in ``sample_person``."""
FAMILY = 2
"""Number of subjects that are blended with each other; they share a split."""
PARTNERS = 4
"""Maximum number of clips that one clip is blended with."""
MOST_SHARE = 0.5
"""Minimum weight of the first recording in a blended clip."""
SHRINK, TRIES = 0.6, 4


def add_hybrids(
    tables: Sequence[Mapping[str, Any]],
    clips: Sequence[Motion],
    subjects: Sequence[str],
    mode: Literal["retarget", "blend"],
) -> list[dict[str, Any]]:
    """Add distributions of speed, size, stride and blending to clips."""
    hybrids = [_make_factor_ranges(clip) for clip in clips]
    families = _group_families(clips, subjects) if mode == "blend" else []
    found = []
    for number, (table, clip, hybrid) in enumerate(zip(tables, clips, hybrids, strict=True)):
        partners: list[dict[str, Any]] = []
        for other in (n for family in families if number in family for n in family if n != number):
            if len(partners) < PARTNERS and hybrid and (narrower := _fit(clip, clips[other], hybrid)):
                hybrid = {**hybrid, "speed_factor": {"log_uniform": narrower}}
                partners.append({k: v for k, v in tables[other].items() if k not in ("loop_to_s", "loop_variation")})
        more = {"other": {"choice": partners}, "share": {"uniform": [0.0, MOST_SHARE]}} if partners else {}
        found.append({**table, **({"hybrid": {**hybrid, **more}} if hybrid else {})})
    return found


def _make_factor_ranges(clip: Motion) -> dict[str, Any]:
    """Return the three factors' distributions, {} if a clip cannot change."""
    law = find_speed_law(clip)
    speed, stride = (tuple(map(math.log, limits)) for limits in (find_speed_limits(clip), find_stride_limits(law)))
    reach: list[float] = []
    for side in (0, 1):
        part = 1.0
        for _ in range(TRIES):
            factors = {"speed_factor": math.exp(part * speed[side]), "stride_factor": math.exp(part * stride[side])}
            if _can(partial(retarget, clip, **factors)):
                break
            part *= SHRINK
        else:
            return {}
        reach.append(part)
    sizes = {"log_uniform": list(FACTOR)} if is_quadruped(clip) else {"normal": [1.0, STATURE_SD]}
    speeds, strides = (
        [round(math.exp(part * end), 6) for part, end in zip(reach, ends, strict=True)] for ends in (speed, stride)
    )
    return {"speed_factor": {"log_uniform": speeds}, "size_factor": sizes, "stride_factor": {"log_uniform": strides}}


def _group_families(clips: Sequence[Motion], subjects: Sequence[str]) -> list[list[int]]:
    """Group clips of equal gait and points whose subjects are blended."""
    alike: dict[tuple[Any, ...], dict[str, list[int]]] = {}
    for number, (clip, subject) in enumerate(zip(clips, subjects, strict=True)):
        key = (clip.facts.species, tuple(clip.markers))
        alike.setdefault(key, {}).setdefault(subject, []).append(number)
    found = []
    for members in alike.values():
        names = sorted(members)
        starts = list(range(0, max(1, len(names) - FAMILY + 1), FAMILY))
        for start, stop in zip(starts, [*starts[1:], len(names)], strict=True):
            numbers = sorted(n for name in names[start:stop] for n in members[name])
            by_gait: dict[str, list[int]] = {}
            for number in numbers:
                by_gait.setdefault(clips[number].facts.gait, []).append(number)
            found += [group for gait, group in by_gait.items() if gait and len(group) > 1]
    return found


def _fit(clip: Motion, other: Motion, hybrid: Mapping[str, Any]) -> list[float]:
    """Return a blended clip's range of speed factors, [] if impossible."""
    speeds = hybrid["speed_factor"]["log_uniform"]
    found: list[float] = []

    def make() -> None:
        low, high = find_speed_limits(blend(clip, other, share=MOST_SHARE))
        narrower = [max(speeds[0], low), min(speeds[1], high)]
        for speed, stride in zip(narrower, hybrid["stride_factor"]["log_uniform"], strict=True):
            ends = Hybrid(speed_factor=speed, stride_factor=stride, other={"kind": "file"}, share=MOST_SHARE)
            make_hybrid(clip, ends, lambda _: other)
        found.extend(round(speed, 6) for speed in narrower)

    return found if _can(make) else []


def _can(make: Callable[[], object]) -> bool:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DoppelgaitWarning)
        try:
            make()
        except DoppelgaitError:
            return False
    return True
