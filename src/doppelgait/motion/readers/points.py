"""Points of one body, markers or joints: selection by name, length unit, size and upward axis."""

from __future__ import annotations

import math
import re
import warnings
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from doppelgait.core.errors import MotionError, warn_caller
from doppelgait.core.units import FloatArray
from doppelgait.motion.clean import MIN_MARKERS, MOVING_BODY_M, SHORT_LIVED, find_body_centre, find_stationary_points
from doppelgait.motion.gait import find_principal_direction
from doppelgait.motion.skeleton import FOOT_PARTS, complete_set, find_part, find_parts, guess_species, strip_subject

_METRES = {"mm": 1e-3, "cm": 1e-2, "dm": 1e-1, "m": 1.0, "in": 0.0254, "ft": 0.3048}
# files spell units in several languages, and some truncate the word to four letters
_WORDS = {"mill": "mm", "cent": "cm", "mete": "m", "metr": "m", "inch": "in", "foot": "ft", "feet": "ft"}


def convert_unit_to_metres(path: Path, name: str) -> float:
    """Return the conversion factor from a length unit to metres."""
    word = name.strip().lower()
    factor = _METRES.get(_WORDS.get(word[:4], word))
    if factor is None:
        allowed = ", ".join(_METRES)
        raise MotionError(f"{path}: the unit {name!r} is not a known unit of length; set units to one of {allowed}")
    return factor


AXES = ("x", "y", "z", "-x", "-y", "-z")  # allowed names of the upward direction

_ROTATIONS = {
    "z": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "y": ((1, 0, 0), (0, 0, -1), (0, 1, 0)),
    "x": ((0, 1, 0), (0, 0, 1), (1, 0, 0)),
    "-z": ((1, 0, 0), (0, -1, 0), (0, 0, -1)),
    "-y": ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
    "-x": ((0, 1, 0), (0, 0, -1), (-1, 0, 0)),
}
"""Rotation matrix by upward axis. The rows are the new x, y and z in the old axes; none of them mirrors the body."""


def turn_z_up(position: FloatArray, up_axis: str) -> FloatArray:
    """Rotate positions so that ``up_axis`` becomes z. Shapes: position (T, P, 3)."""
    if up_axis not in _ROTATIONS:
        raise MotionError(f"up_axis={up_axis!r} is not allowed; use one of {', '.join(AXES)}")
    return np.asarray(position @ np.array(_ROTATIONS[up_axis], dtype=float).T)


def find_up_axis(position: FloatArray, parts: Sequence[str], *, declared: str = "") -> dict[str, Any]:
    """Find the upward axis of a body. Shapes: position (T, P, 3)."""
    # what never moves while the body does is no part of it, nor what has no name next to its points
    own = ~find_stationary_points(position)
    own &= [bool(part) for part in parts] if {*FOOT_PARTS} & {*parts} else True
    if own.sum() >= MIN_BODY:
        position, parts = position[:, own], [part for part, is_own in zip(parts, own, strict=True) if is_own]
    typical = _compute_median(position, axis=0)
    feet, body, head = (
        [i for i, part in enumerate(parts) if part in names]
        for names in (FOOT_PARTS, ("head", "torso", "trunk"), ("head",))
    )
    extent, travel = np.nan_to_num(measure_body_extent(position)), np.zeros(3)
    centre = _compute_median(position, axis=1)
    seen = centre[np.isfinite(centre).all(axis=1)]
    if seen.size:  # travel along each axis, without the outermost 2 % of the frames at either end
        travel = np.percentile(seen, 98, axis=0) - np.percentile(seen, 2, axis=0)
    # along the vertical, a body does not move farther than along the others and than its size
    ahead = int(np.argmax(travel))
    level = np.arange(3) != (ahead if travel[ahead] > extent[ahead] else -1)
    # from what bears the body to the rest; a head is above an upright body, but ahead of an animal
    every = list(range(len(parts)))
    ends = [(body or every, feet)] if feet else []
    ends += [(head, every)] if head and not feet and "trunk" not in parts else []
    lifts = [(_compute_median(typical[a], axis=0) - _compute_median(typical[b], axis=0), "body parts") for a, b in ends]
    if not declared:
        lifts.insert(0, (_find_resting_lift(position), "body parts" if feet else "points at rest"))
    for lift, source in ((np.where(level, np.nan_to_num(lift), 0.0), source) for lift, source in lifts):
        order = np.argsort(-np.abs(lift))
        if abs(lift[order[0]]) > 1.5 * abs(lift[order[1]]):
            return {"up_axis": _name(int(order[0]), lift[order[0]]), "up_axis_from": source}
    # z is preferred if axes are equal, since most systems use it
    other, axis = sorted(
        sorted((2, 1, 0), key=lambda k: round(float(travel[k]), 9))[:2], key=lambda k: float(extent[k])
    )
    stated = "xyz".find(declared) if declared else -1
    if stated >= 0 and not (extent[axis] > 2.0 * extent[stated] and travel[axis] <= travel[stated]):
        return {"up_axis": _name(stated, _find_height_sign(position, typical, stated)), "up_axis_from": "file"}
    if stated < 0 and extent[axis] < 1.3 * extent[other]:
        return {"up_axis": "z", "up_axis_from": "assumed"}
    return {"up_axis": _name(axis, _find_height_sign(position, typical, axis)), "up_axis_from": "motion"}


RESTS, RESTING_SHARE, MOVES_M, TRAVELS, MIN_BODY = 0.15, 0.1, 0.03, 0.3, 6
"""A point rests while it moves by less than this share of the body's step, over as many frames as the body needs for
3 cm. Points must rest in this share of the frames, of a body of 6 points that travels by this share of its path."""


def _find_resting_lift(position: FloatArray) -> FloatArray:
    """Return the vector from resting points to a travelling body's middle, or NaN."""
    # feet, paws, knees and hands that bear weight are at rest, whatever their names; on a treadmill, the trunk is
    unknown = np.full(3, np.nan)
    step_m = _compute_median(np.linalg.norm(np.diff(position, axis=0), axis=2), axis=1)
    usual_m, centre = float(np.nan_to_num(_compute_median(step_m, axis=0))), _compute_median(position, axis=1)
    n = max(1, min(math.ceil(MOVES_M / max(usual_m, 1e-6)), len(position) // 10))
    centre = centre[np.isfinite(centre).all(axis=1)]
    if position.shape[1] < MIN_BODY or not len(centre):
        return unknown
    step = np.linalg.norm(position[n:] - position[:-n], axis=2)
    pace_m = _compute_median(step, axis=1)[:, np.newaxis]
    rests = (step < RESTS * pace_m) & (pace_m >= 0.9 * MOVES_M)
    count = rests.sum(axis=1)[:, np.newaxis]
    travels = float(np.linalg.norm(centre[-1] - centre[0])) > TRAVELS * float(np.nansum(step_m))
    if not travels or (count > 0).mean() < RESTING_SHARE or rests.any(axis=0).sum() < 2:
        return unknown
    inner = (position[n:] + position[:-n]) / 2
    resting = np.where(rests[..., np.newaxis], inner, 0.0).sum(axis=1) / np.maximum(count, 1)
    middle = (np.fmin.reduce(inner, axis=1) + np.fmax.reduce(inner, axis=1)) / 2
    return _compute_median((middle - resting)[count[:, 0] > 0], axis=0)


def _name(axis: int, sign: float) -> str:
    return ("" if sign >= 0 else "-") + "xyz"[axis]


def _compute_median(values: FloatArray, axis: int) -> FloatArray:
    # as nanmedian of NumPy, which takes five times as long for few values and warns of NaN
    ordered = np.sort(values, axis=axis)
    last = np.maximum(np.isfinite(values).sum(axis=axis, keepdims=True) - 1, 0)
    low, high = (np.take_along_axis(ordered, n, axis) for n in (last // 2, (last + 1) // 2))
    return np.asarray((low + high) / 2).squeeze(axis)


def measure_body_extent(position: FloatArray) -> FloatArray:
    """Return the body's typical extent per axis. Shapes: position (T, P, 3)."""
    # it is the median over time of the distance between the outermost points, shape (3,)
    return _compute_median(np.fmax.reduce(position, axis=1) - np.fmin.reduce(position, axis=1), axis=0)


def _find_height_sign(position: FloatArray, typical: FloatArray, axis: int) -> float:
    """Return +1 for an upward or unknown axis, else -1."""
    # the floor of most laboratories is at 0; else, points that rest at times are taken for feet
    height = typical[:, axis][np.isfinite(typical[:, axis])]
    if height.size < 3:
        return 1.0
    low, high = float(height.min()), float(height.max())
    if low > -0.15 * (high - low):
        return 1.0
    if high < 0.15 * (high - low):
        return -1.0
    speed = np.linalg.norm(np.diff(position, axis=0), axis=2)
    seen = np.isfinite(speed).sum(axis=0) >= 10
    if seen.sum() < 3:
        return 1.0
    slowest = np.nanpercentile(speed[:, seen], 15, axis=0)
    still = slowest < 0.25 * np.nanmedian(speed[:, seen])
    if not still.any() or still.all():
        return 1.0
    return float(np.sign(typical[seen, axis][~still].mean() - typical[seen, axis][still].mean())) or 1.0


_OUTPUT_LISTS = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS", "MODELED_MARKERS", "MODELLED_MARKERS", "REACTIONS")
_OUTPUT_NAME = re.compile(
    r"(?i)((angles?|forces?|moments?|powers?|torques?|accelerations?|velocit(y|ies)|grf|"
    r"cent(re|er)[ _.-]?of[ _.-]?(mass|gravity|pressure)|com|cog|cop)([ _.-]?(floor|[xyzlr]|left|right|\d+))?$)"
    r"|^virtual|^v_(?=\w)"
)
"""Names of computed points: angles, forces, centres of mass and pressure, virtual points."""
_UNLABELLED = re.compile(r"(?i)^(\*\s*\d+|#|u(name)?\*?\d+|new \d+|unlabell?ed.*|unidentified.*)$")
_GHOST = re.compile(r"^(.+)-\d+$")
_SEGMENT_END = re.compile("(PEL|TRX|HED|[LR](FE|TI|FO|TO|CL|HU|RA|HN))[OALP]")
MIN_SUBJECT_POINTS = 8


def _sort_points(labels: Sequence[str], texts: Mapping[str, Sequence[str]]) -> dict[int, str]:
    """Return the reasons why points are not physical markers."""
    kinds = dict.fromkeys(_OUTPUT_LISTS) | dict.fromkeys(name.upper() for name in texts.get("POINT:TYPE_GROUPS", ()))
    listed = {
        strip_subject(label): kind.lower()
        for kind in kinds
        for n in ("", *range(2, 6))
        for label in texts.get(f"POINT:{kind}{n}", ())
    }
    bare = [strip_subject(label) for label in labels]
    # Plug-in Gait writes every segment as origin and three axis ends
    reasons, every = {}, set(bare)
    for i, name in enumerate(bare):
        if name in listed:
            reasons[i] = f"model output ({listed[name]})"
        elif _SEGMENT_END.fullmatch(name) and {name[:-1] + end for end in "OALP"} <= every:
            reasons[i] = "model output (segment axes)"
        elif _OUTPUT_NAME.search(name) and not find_part(name):
            reasons[i] = "model output (by its name)"
    # if many points include a complete known set, the capture program computed the others from it
    rest = [i for i in range(len(labels)) if i not in reasons]
    known = complete_set(labels[i] for i in rest)
    others = [i for i in rest if bare[i].upper() not in known and not _GHOST.match(labels[i])]
    if known and len(others) >= len(known):
        reasons |= dict.fromkeys(others, "model output (not a marker of the set that the file holds)")
    unlabelled = {i for i, name in enumerate(bare) if i not in reasons and _UNLABELLED.match(name)}
    named = [i for i in range(len(labels)) if i not in reasons and i not in unlabelled]
    if len(named) >= 3:
        reasons |= dict.fromkeys(unlabelled, "unlabelled point")
    for i in named:
        ghost = _GHOST.match(labels[i])
        if ghost and ghost[1] in labels:
            reasons[i] = f"ghost of marker {strip_subject(ghost[1])}"
    return reasons


def is_unlabelled(label: str) -> bool:
    """Return True if a label is the number of a point, no name."""
    return not label or _UNLABELLED.match(strip_subject(label)) is not None


def _find_prefix(label: str) -> str:
    return label.rsplit(":", 1)[0].strip() if ":" in label else ""


MAX_POINTS = 20_000
MAX_LABEL = 400


def check_labels(path: Path, labels: Sequence[str]) -> None:
    """Refuse too many points and very long names."""
    if len(labels) > MAX_POINTS:
        raise MotionError(f"{path}: holds {len(labels):,} points; up to {MAX_POINTS:,} are read")
    long = max(labels, key=len, default="")
    if len(long) > MAX_LABEL:
        raise MotionError(
            f"{path}: a point has a name of {len(long):,} characters, {long[:20]!r} ...; up to {MAX_LABEL} are read"
        )


def make_names_unique(names: Sequence[str]) -> list[str]:
    """Make names unique (T8, T8_2); a missing name is ``point_7``."""
    found: list[str] = []
    taken: set[str] = set()
    numbers: dict[str, int] = {}  # by name, the next number that may be free
    for i, wanted in enumerate(names):
        name = base = wanted or f"point_{i + 1}"
        number = numbers.get(base, 2)
        while name in taken:
            name, number = f"{base}_{number}", number + 1
        numbers[base] = number
        taken.add(name)
        found.append(name)
    return found


@dataclass(frozen=True)
class BodyPoints:
    """Points of one body among those of a file."""

    labels: Sequence[str]
    kept: list[int]
    names: list[str]
    parts: list[str]
    reasons: Mapping[int, str]
    measured: int | None = None
    subject: str = ""
    species: str = ""
    is_skeleton: bool = False
    wanted: str | None = None  # subject to take by positions; "" if taken by its prefix


def pick_markers(
    path: Path,
    labels: Sequence[str],
    position: FloatArray,
    notes: list[str],
    *,
    subject: str | None,
    texts: Mapping[str, Sequence[str]],
    known_parts: Mapping[str, str],
) -> BodyPoints:
    """Select the physical markers of one subject. Shapes: position (T, P, 3)."""
    check_labels(path, labels)
    reasons = _sort_points(labels, texts)
    markers = [i for i in range(len(labels)) if i not in reasons]
    if not markers:
        kinds = ", ".join(sorted(set(reasons.values())))
        raise MotionError(f"{path}: holds no marker positions: its {len(reasons)} points are {kinds}")
    # ghosts and unlabelled points were also measured by cameras
    measured = len(labels) - sum(reason.startswith("model output") for reason in reasons.values())
    counts = Counter(_find_prefix(labels[i]) for i in markers)
    named = ", ".join(f"{name or '(no prefix)'} ({count} points)" for name, count in counts.most_common())
    wanted = subject
    if subject is not None and set(counts) == {""}:  # there are no prefixes: positions are needed
        subject = None
    elif subject is not None:
        wanted = ""
    if subject is not None and subject not in counts:
        raise MotionError(f"{path}: holds no subject {subject!r}; allowed are {named}")
    bodies = [name for name, count in counts.items() if len(counts) == 1 or count >= MIN_SUBJECT_POINTS]
    if subject is None and len(bodies) > 1:
        # trackers also see bodies in furniture and shadows, for a moment
        is_seen = np.asarray(np.isfinite(position).all(axis=2))
        n_seen = {
            name: max(int(is_seen[:, i].sum()) for i in markers if _find_prefix(labels[i]) == name) for name in bodies
        }
        brief = [name for name in bodies if n_seen[name] < SHORT_LIVED * max(n_seen.values())]
        notes += [f"subject {name!r}, seen in {n_seen[name]} of {len(position)} frames, was left out" for name in brief]
        bodies = [name for name in bodies if name not in brief]
    if subject is None and len(bodies) != 1:
        raise MotionError(f"{path}: holds several subjects: {named}. Name the one to read: subject='...'.")
    name = bodies[0] if subject is None else subject
    kept = [i for i in markers if _find_prefix(labels[i]) == name]
    for i in set(markers) - set(kept):
        owner = f"subject or prop {_find_prefix(labels[i])!r}" if ":" in labels[i] else "no subject"
        reasons[i] = f"belongs to {owner}"
    bare = [strip_subject(labels[i]) for i in kept]
    parts = [known_parts.get(word.lower()) or part for word, part in zip(bare, find_parts(bare), strict=True)]
    return BodyPoints(labels, kept, make_names_unique(bare), parts, reasons, measured, name, wanted=wanted)


_FIRST_WORD = re.compile(r"(?P<body>[^_ .-]+)[_ .-]+(?P<name>.+)")
_LAST_WORD = re.compile(r"(?P<name>.+?)(?:[_ .-]+|(?=\d+$))(?P<body>[^_ .-]+)")
APART_M = 0.25  # least distance of two bodies' middles; markers 1 and 2 of segments are closer
LINK_M, LINK_SWAY_M = 1.0, 0.15
"""Mean distance of two points of one body without names, and standard deviation of it, below which they are linked."""
MAX_LINKED, MAX_LOOKS = 300, 64


def _list_name_groups(labels: Sequence[str]) -> list[dict[str, dict[int, str]]]:
    """Divide names into those of bodies: by first word, last word or repetition."""
    divisions: list[dict[str, dict[int, str]]] = [{}, {}, {}]
    seen: Counter[str] = Counter()
    for i, label in enumerate(labels):
        seen[label] += 1
        words = [pattern.fullmatch(label) for pattern in (_FIRST_WORD, _LAST_WORD)]
        keys = [(word["body"], word["name"]) if word else ("1", label) for word in words] + [(str(seen[label]), label)]
        for groups, (body, name) in zip(divisions, keys, strict=True):
            groups.setdefault(body, {})[i] = name
    return [{body: names for body, names in groups.items() if _is_body(list(names.values()))} for groups in divisions]


def _is_body(names: Sequence[str]) -> bool:
    parts = find_parts(names) if len(names) >= MIN_SUBJECT_POINTS else []
    sides = {part.partition("_")[0] for part in parts}
    return {"left", "right"} <= sides and sum(map(bool, parts)) >= len(parts) / 2


def _find_moving_clusters(position_m: FloatArray) -> dict[str, dict[int, str]]:
    """Return points of each moving body, from distances alone."""
    from scipy.sparse.csgraph import connected_components

    n_points = position_m.shape[1]
    if n_points > MAX_LINKED:
        return {}
    some = position_m[:: max(1, len(position_m) // MAX_LOOKS)]
    distance = np.linalg.norm(some[:, :, np.newaxis] - some[:, np.newaxis], axis=-1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of points that are never seen together
        linked = (np.nanmean(distance, axis=0) < LINK_M) & (np.nanstd(distance, axis=0) < LINK_SWAY_M)
    _, number = connected_components(linked, directed=False)
    clusters = [np.flatnonzero(number == n) for n in range(number.max(initial=-1) + 1)]
    large = [c for c in clusters if len(c) >= MIN_SUBJECT_POINTS]
    moving = [c for c in large if not find_stationary_points(some[:, c], limit_m=0.5).all()]
    return {str(n): dict.fromkeys(map(int, points), "") for n, points in enumerate(moving, start=1)}


BAND_M, BAND_FRAMES, BAND_HEIGHT = 0.35, 0.1, 0.7
"""Width of the empty band between people side by side, share of the frames in which it may be narrower, and smallest
height of both relative to that of all points. The sides of one body are joined at the feet."""


def _find_bodies_abreast(position_m: FloatArray, points: list[int]) -> list[list[int]]:
    """Divide points where a band along the path is empty."""
    position = position_m[:, points]
    walks = ~find_stationary_points(position, limit_m=MOVING_BODY_M)
    if walks.sum() < MIN_SUBJECT_POINTS:
        return [points]
    position = turn_z_up(position, find_up_axis(position[:, walks], [""] * int(walks.sum()))["up_axis"])
    path = find_body_centre(position[:, walks])[:, :2]
    if not np.isfinite(path).all() or np.linalg.norm(np.ptp(path, axis=0)) < MOVING_BODY_M:
        return [points]
    along = find_principal_direction(path)
    across = position[..., :2] @ [-along[1], along[0]]
    typical = _compute_median(across, axis=0)
    order = np.argsort(typical)
    n = int(np.nan_to_num(np.diff(typical[order])).argmax()) + 1
    sides = order[:n], order[n:]
    right, left = (across[:, side] for side in sides)
    band_m = np.fmin.reduce(left, axis=1) - np.fmax.reduce(right, axis=1)
    band_m = np.append(band_m[np.isfinite(band_m)], 0.0)
    whole_m, *height_m = (measure_body_extent(position[:, k])[2] for k in (slice(None), *sides))
    is_empty = np.quantile(band_m, BAND_FRAMES) >= BAND_M and min(map(len, sides)) >= MIN_SUBJECT_POINTS
    if not (is_empty and min(height_m) >= BAND_HEIGHT * whole_m):
        return [points]
    return [body for side in sides for body in _find_bodies_abreast(position_m, [points[k] for k in np.sort(side)])]


def _are_apart(position_m: FloatArray, groups: Mapping[str, Mapping[int, str]]) -> bool:
    """Return True if points of different groups are of several bodies."""
    for a, b in combinations(groups.values(), 2):
        # points with equal names are compared, else the middles of all points
        ends = {name: i for i, name in b.items()}
        shared = [([i], [ends[name]]) for i, name in a.items() if name and name in ends] or [(list(a), list(b))]
        middles = ([_compute_median(position_m[:, points], axis=1) for points in pair] for pair in shared)
        apart_m = [_compute_median(np.linalg.norm(first - second, axis=1), axis=0) for first, second in middles]
        if not float(np.median(apart_m)) > APART_M:
            return False
    return len(groups) > 1


def take_subject(path: Path, position_m: FloatArray, body: BodyPoints) -> tuple[list[int], BodyPoints]:
    """Return the points of one body, and refuse several. Shapes: position_m (T, K, 3)."""
    every = list(range(len(body.kept)))
    if body.is_skeleton or body.wanted == "":
        return every, body
    labels = [strip_subject(body.labels[i]) for i in body.kept]
    divisions = [groups for groups in _list_name_groups(labels) if _are_apart(position_m, groups)]
    groups = divisions[0] if divisions else _find_moving_clusters(position_m)
    several = _are_apart(position_m, groups)
    if not several and sum(map(bool, body.parts)) < len(every) / 2:
        bodies = _find_bodies_abreast(position_m, every)
        groups, several = {str(n): dict.fromkeys(k, "") for n, k in enumerate(bodies, start=1)}, len(bodies) > 1
    named = ", ".join(f"{name} ({len(points)} points)" for name, points in groups.items()) if several else "(no prefix)"
    if body.wanted is not None and not (several and body.wanted in groups):
        raise MotionError(f"{path}: holds no subject {body.wanted!r}; allowed are {named}")
    if not several:
        return every, body
    if body.wanted is None:
        raise MotionError(f"{path}: holds several subjects: {named}. Name the one to read: subject='...'.")
    chosen = groups[body.wanted]
    names = [chosen[k] or body.names[k] for k in chosen]
    reasons = {body.kept[k]: f"does not belong to subject {body.wanted!r}" for k in every if k not in chosen}
    return list(chosen), replace(
        body,
        kept=[body.kept[k] for k in chosen],
        names=make_names_unique(names),
        parts=find_parts(names) if divisions else [body.parts[k] for k in chosen],
        reasons={**body.reasons, **reasons},
        subject=body.wanted,
    )


MIN_FRAMES = 3
MIN_RATE_HZ, MAX_RATE_HZ = 1.0, 10_000.0


def check_amount(path: Path, n_frames: int, n_points: int = MIN_MARKERS) -> None:
    """Refuse too few frames or points for a motion."""
    if n_frames < MIN_FRAMES:
        raise MotionError(
            f"{path}: holds {n_frames} frame(s), a static pose; a motion needs {MIN_FRAMES} or more, because a "
            "velocity cannot be formed from fewer"
        )
    if n_points < MIN_MARKERS:
        raise MotionError(f"{path}: holds {n_points} point(s); a body needs {MIN_MARKERS} or more")


def check_rate(path: Path, rate_hz: float | str | None, *, said: str) -> float:
    """Check a frame rate and return it in Hz."""
    rate = np.nan
    with suppress(TypeError, ValueError):
        rate = float(rate_hz) if rate_hz is not None and not isinstance(rate_hz, bool) else np.nan
    if not MIN_RATE_HZ <= rate <= MAX_RATE_HZ:
        shown = f"{rate:g}" if np.isfinite(rate) else repr(rate_hz)
        raise MotionError(
            f"{path}: {said} a frame rate of {shown} Hz; it must be {MIN_RATE_HZ:g} to {MAX_RATE_HZ:g}. "
            "Give the true one: rate_hz=..."
        )
    return rate


def find_unit(path: Path, name: str, position: FloatArray) -> str:
    """Return the named unit, or guess mm or m. Shapes: position (T, P, 3)."""
    if name:
        return name
    span = float(np.nan_to_num(measure_body_extent(position)).max())
    guess = "m" if span < 10.0 else "mm"
    warn_caller(
        f"{path}: names no length unit; its points span {span:.3g}, so {guess} is assumed. "
        "If that is wrong, give the unit: units='mm', 'cm' or 'm'."
    )
    return guess


FARTHEST_M, FAR_M, MOST_FAR = 1e4, 1e3, 0.01
"""Maximum distance from the origin and from the others, and share of samples beyond it: damage, not a wrong unit."""
MOST_WIDE = 0.1  # share of frames in which the points may span more than a body
BODY_M = (0.05, 15.0)  # extent of a body, or of its recorded part


def remove_implausible(path: Path, position_m: FloatArray) -> list[str]:
    """Remove implausible positions and check the body's size. Shapes: position_m (T, P, 3)."""
    with np.errstate(invalid="ignore"):
        far = ~(np.abs(position_m) <= FARTHEST_M) & ~np.isnan(position_m)
        wide = (np.fmax.reduce(position_m, axis=1) - np.fmin.reduce(position_m, axis=1)).max(axis=1) > FAR_M
        middle = np.nanmedian(position_m[wide], axis=1, keepdims=True)
        far[wide] |= np.abs(position_m[wide] - middle) > FAR_M
    seen = int(np.count_nonzero(~np.isnan(position_m).any(axis=2)))
    n_far = int(np.count_nonzero(far.any(axis=2)))
    notes: list[str] = []
    if n_far > max(1, MOST_FAR * seen):
        largest = float(np.abs(position_m[far]).max())
        raise MotionError(
            f"{path}: {n_far:,} of {seen:,} positions are up to {largest:.3g} m from the origin; a body is within "
            f"{FARTHEST_M:g} m. Is the unit wrong? Give it: units='mm', 'cm' or 'm'; else the file is damaged"
        )
    if n_far:
        position_m[far] = np.nan
        notes.append(f"{n_far:,} positions far from the origin or the others were treated as gaps")
        warn_caller(f"{path}: {notes[-1]}; the file is damaged")
    if seen <= n_far:
        return notes  # cleaning reports that nothing was seen
    spans_m = (np.fmax.reduce(position_m, axis=1) - np.fmin.reduce(position_m, axis=1)).max(axis=1)
    spans_m = spans_m[np.isfinite(spans_m)]
    least_m, most_m = np.quantile(spans_m, (0.5, 1.0 - MOST_WIDE)) if spans_m.size else (BODY_M[1], BODY_M[1])
    size_m = most_m if most_m > BODY_M[1] else least_m
    if spans_m.size and not BODY_M[0] <= size_m <= BODY_M[1]:
        raise MotionError(
            f"{path}: its points span {size_m:.3g} m; allowed are {BODY_M[0]:g} to {BODY_M[1]:g} m. Is the unit wrong? "
            "Give it: units='mm', 'cm' or 'm'; else the file is damaged or holds no body"
        )
    return notes


def choose_up_axis(
    path: Path, position_m: FloatArray, body: BodyPoints, *, up_axis: str | None, declared: str, usual: str
) -> dict[str, Any]:
    """Return the upward axis as given, as declared or as shown. Shapes: position_m (T, P, 3)."""
    if up_axis is not None:
        return {"up_axis": up_axis, "up_axis_from": "option"}
    # the parts of a dog that sits or lies do not indicate the upward axis
    shown = [""] * len(body.parts) if body.is_skeleton and body.species != "human" else body.parts
    facts = find_up_axis(position_m, shown, declared=declared)
    if facts["up_axis_from"] == "assumed":
        # only the sign of the usual axis is needed
        facts = {**find_up_axis(position_m, shown, declared=usual), "up_axis_from": "assumed"}
        warn_caller(
            f"{path}: neither names nor shows which axis points up; {facts['up_axis']} is assumed. If that is "
            "wrong, give it: up_axis='x', 'y', 'z', '-x', '-y' or '-z'."
        )
    elif body.is_skeleton and facts["up_axis_from"] == "file":
        facts["up_axis_from"] = "convention"
    return facts


def has_rest_pose(root_rotation: FloatArray, position: FloatArray) -> bool:
    """Return True if a rest pose is first. Shapes: root_rotation (T, k); position (T, J, 3)."""
    # conversions of the CMU database have one
    if len(position) < 3 or root_rotation[0].any() or not root_rotation[1].any():
        return False
    step = np.linalg.norm(np.diff(position, axis=0), axis=2).max(axis=1)
    return bool(step[0] > 5.0 * np.median(step[1:]))


CMU_METRES = 0.0254 / 0.45  # unit of the CMU skeletons, 1/0.45 inch: their ASF files state 0.45
SAME_PLACE = 1e-4  # maximum distance of nodes that are one point, relative to the skeleton's size
STILL = 1e-3  # minimum movement of a root that moves, relative to the skeleton's size
METRIC = {"m": 1.0, "cm": 0.01, "mm": 0.001}
INCHES = {"in": 0.0254, "cmu": CMU_METRES}  # units that only skeletons of people have
SIZES_M = {"human": ((1.2, 3.0), 2.1), "dog": ((0.4, 3.2), 1.4), "": ((0.4, 3.2), 2.0)}
"""Usual and typical size of a skeleton: its longest chain of bones, from hand to toe or from nose to hind paw."""
_HELPER = re.compile(r"(?i)(nub|footsteps?|helper|dummy|effector|locator)(_end)?$")
_ROOT = re.compile(r"(?i)^(joint[_ ]?)?(root|reference|world|scene|armature)$")
_BONE = re.compile(r"^b_")


def pick_joints(path: Path, names: Sequence[str], parents: Sequence[int], position: FloatArray) -> BodyPoints:
    """Select the joints that are points of the body. Shapes: position (T, J, 3)."""
    check_labels(path, names)
    check_amount(path, len(position))
    if not (np.abs(position) < 1e100).all():  # squares of larger ones overflow
        raise MotionError(f"{path}: holds offsets or positions that are too large to be those of a body")
    # reasons to leave out a node
    size = measure_skeleton(parents, _measure_bone_lengths(parents, position))
    reasons = {j: "rig helper (by its name)" for j, name in enumerate(names) if _HELPER.search(name)}
    bones = [j for j, name in enumerate(names) if _BONE.match(name)]
    # bones of the body are named b_... in 3ds Max rigs; other nodes control them or are attached
    if 2 * len(bones) > len(names):
        others = set(range(len(names))) - set(bones)
        reasons |= {j: "rig helper (no b_ bone)" for j in sorted(others - set(reasons))}
    # the root, if no joint of the body: one child at a distance, and it never moves or is so named
    children = [j for j, parent in enumerate(parents) if parent == 0 and j not in reasons]
    if len(children) == 1 and len(names) >= 3 and 0 not in reasons:
        root, child = position[:, 0], position[:, children[0]]
        if np.linalg.norm(child - root, axis=1).max() >= SAME_PLACE * size:
            still = np.linalg.norm(np.ptp(root, axis=0)) < STILL * size
            if _ROOT.match(names[0]):
                reasons[0] = "root node, no joint of the body (by its name)"
            elif still and np.linalg.norm(np.ptp(child, axis=0)) >= STILL * size:
                reasons[0] = "root node, no joint of the body (it never moves)"
    # nodes that coincide with an earlier one in every frame
    rest = [j for j in range(len(names)) if j not in reasons]
    for n, j in enumerate(rest):
        near = np.linalg.norm(position[0, rest[:n]] - position[0, j], axis=1) <= SAME_PLACE * size
        for i in (i for i, close in zip(rest, near, strict=False) if close and i not in reasons):
            if np.linalg.norm(position[:, i] - position[:, j], axis=1).max() <= SAME_PLACE * size:
                reasons[j] = f"same place as {names[i]}"
                break
    kept = [j for j in range(len(names)) if j not in reasons]
    if not kept:
        raise MotionError(f"{path}: holds no joints of a body: {', '.join(sorted(set(reasons.values())))}")
    points = make_names_unique([names[j].strip() or f"point_{j + 1}" for j in kept])
    species = guess_species(names)
    if species == "dog" and not any(re.search(r"(?i)(^|[^a-z])dog([^a-z]|$)", name) for name in names):
        species = ""  # joint names of animals fit several species; those of people are unambiguous
    return BodyPoints(names, kept, points, find_parts(points), reasons, species=species, is_skeleton=True)


def _measure_bone_lengths(parents: Sequence[int], position: FloatArray) -> FloatArray:
    """Return each node's median distance from its parent in the file's unit; 0 for the root."""
    above = np.array([max(parent, 0) for parent in parents])
    lengths = np.median(np.linalg.norm(position - position[:, above], axis=2), axis=0)
    return np.where(np.array(parents) < 0, 0.0, lengths)


def measure_skeleton(parents: Sequence[int], lengths: FloatArray) -> float:
    """Return the longest path along the bones. Shapes: lengths (J,)."""
    # the path is from one end to another and does not depend on the pose
    depth = np.zeros(len(parents))
    size = 0.0
    for j in range(len(parents) - 1, -1, -1):
        parent = parents[j]
        if parent >= 0:
            length = float(depth[j] + lengths[j])
            size = max(size, float(depth[parent]) + length)
            depth[parent] = max(float(depth[parent]), length)
    return size


def connect_kept(parents: Sequence[int], kept: Sequence[int]) -> list[int]:
    """Return the next kept ancestor of each kept node, or the first."""
    number = {j: n for n, j in enumerate(kept)}
    above: list[int] = []
    for n, j in enumerate(kept):
        parent = parents[j]
        while parent >= 0 and parent not in number:
            parent = parents[parent]
        above.append(number[parent] if parent >= 0 else min(n, 1) - 1)
    return above


def find_skeleton_unit(
    path: Path, body: BodyPoints, parents: Sequence[int], position: FloatArray, unit: str | float | None, unit_from: str
) -> tuple[str, float, str]:
    """Return name, metres and source of the stated unit, or guess it. Shapes: position (T, J, 3)."""
    above = connect_kept(parents, body.kept)
    size = measure_skeleton(above, _measure_bone_lengths(above, position[:, body.kept]))
    species = guess_species(body.labels)
    (low, high), typical = SIZES_M[species]
    if unit is not None:
        if isinstance(unit, str):
            name, metres = unit, CMU_METRES if unit.lower() == "cmu" else convert_unit_to_metres(path, unit)
        else:
            name, metres = f"{unit:.6g} m", float(unit)
        if not low / 2.0 < size * metres < 2.0 * high:
            warn_caller(
                f"{path}: with {name} ({unit_from}) the skeleton measures {size * metres:.3g} m along its bones; usual "
                f"are {low:g} to {high:g} m. If that is wrong, give the unit: units='cm', 'm', 'in', 'mm' or 'cmu'."
            )
        return name, metres, unit_from
    known = METRIC if species == "dog" else METRIC | INCHES
    fits = [name for name, metres in known.items() if low <= size * metres <= high]
    best = min(known, key=lambda name: abs(np.log(max(size, 1e-300) * known[name] / typical)))
    if fits != [best] or not species:
        others = f"; {' or '.join(name for name in fits if name != best)} also fits" if set(fits) - {best} else ""
        warn_caller(
            f"{path}: names no length unit and its skeleton measures {size:.4g} along its bones; {best} is assumed"
            f"{others}. If that is wrong, give the unit: units='cm', 'm', 'in', 'mm' or 'cmu' (1/0.45 inch)."
        )
    return best, known[best], "size of the skeleton"
