"""From the points of a file to a motion: which ones are kept, unit, upward axis, report."""

from __future__ import annotations

import re
import warnings
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import DoppelgaitWarning, MotionError
from doppelgait.motion.axes import body_extent, find_up_axis, metres_per_unit, turn_z_up
from doppelgait.motion.clean import MIN_MARKERS
from doppelgait.motion.motion import Motion, make_motion
from doppelgait.motion.skeleton import bare_name, complete_set, part_of, parts_of

FloatArray = npt.NDArray[np.float64]

_OUTPUT_LISTS = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS", "MODELED_MARKERS", "MODELLED_MARKERS", "REACTIONS")
_OUTPUT_NAME = re.compile(
    r"(?i)(angles?|forces?|moments?|powers?|grf|centreofmass(floor)?|centerofmass(floor)?|com(floor)?)$"
)
_UNLABELLED = re.compile(r"(?i)^(\*\s*\d+|#|u(name)?\*?\d+|new \d+|unlabell?ed.*|unidentified.*)$")
_GHOST = re.compile(r"^(.+)-\d+$")
_SEGMENTS = (
    "PEL",
    "TRX",
    "HED",
    *(side + name for side in "LR" for name in ("FE", "TI", "FO", "TO", "CL", "HU", "RA", "HN")),
)
MIN_SUBJECT_POINTS = 8


def sort_points(labels: Sequence[str], texts: Mapping[str, Sequence[str]]) -> dict[int, str]:
    """Reason why a point is no physical marker, by index; points that are markers have no entry.

    Parameters
    ----------
    labels : sequence of str
        All labels of the file.
    texts : mapping
        Text parameters by ``"GROUP:NAME"``.
    """
    reasons = _model_outputs(labels, texts)
    reasons |= _outside_complete_set(labels, reasons)
    named = [i for i, label in enumerate(labels) if i not in reasons and not _UNLABELLED.match(bare_name(label))]
    if len(named) >= 3:
        reasons |= {
            i: "unlabelled point"
            for i, label in enumerate(labels)
            if i not in reasons and _UNLABELLED.match(bare_name(label))
        }
    for i in named:
        ghost = _GHOST.match(labels[i])
        if ghost and ghost[1] in labels:
            reasons[i] = f"ghost of marker {bare_name(ghost[1])}"
    return reasons


def is_measured(reason: str) -> bool:
    """Whether a dropped point was seen by cameras all the same: a ghost or an unlabelled point is, an angle is not."""
    return not reason.startswith("model output")


def _model_outputs(labels: Sequence[str], texts: Mapping[str, Sequence[str]]) -> dict[int, str]:
    kinds = dict.fromkeys(_OUTPUT_LISTS) | dict.fromkeys(name.upper() for name in texts.get("POINT:TYPE_GROUPS", ()))
    listed = {
        bare_name(label): kind.lower()
        for kind in kinds
        for n in ("", *range(2, 6))
        for label in texts.get(f"POINT:{kind}{n}", ())
    }
    bare = [bare_name(label) for label in labels]
    names = set(bare)
    # Plug-in Gait writes every segment as origin and three axis ends
    segments = {s + end for s in _SEGMENTS if {s + end for end in "OALP"} <= names for end in "OALP"}
    reasons = {}
    for i, name in enumerate(bare):
        if name in listed:
            reasons[i] = f"model output ({listed[name]})"
        elif name in segments:
            reasons[i] = "model output (segment axes)"
        elif _OUTPUT_NAME.search(name) and not part_of(name):
            reasons[i] = "model output (by its name)"
    return reasons


def _outside_complete_set(labels: Sequence[str], reasons: Mapping[int, str]) -> dict[int, str]:
    """A whole known set among many more points: the others are what the capture program computed from it."""
    rest = [i for i in range(len(labels)) if i not in reasons]
    known = complete_set(labels[i] for i in rest)
    others = [i for i in rest if bare_name(labels[i]).upper() not in known and not _GHOST.match(labels[i])]
    if not known or len(others) < len(known):
        return {}
    return dict.fromkeys(others, "model output (not a marker of the set that the file holds)")


def pick_subject(path: Path, labels: Sequence[str], kept: Sequence[int], subject: str | None) -> tuple[str, list[int]]:
    """The one subject whose markers are wanted, and the indices of its points.

    Parameters
    ----------
    path : Path
        For messages.
    labels : sequence of str
        All labels; a subject stands before the colon.
    kept : sequence of int
        Indices of physical markers.
    subject : str or None
        Wanted subject; None takes the only one that is no prop.

    Raises
    ------
    MotionError
        If the wanted subject is absent, or several could be meant.
    """
    counts = Counter(_prefix(labels[i]) for i in kept)
    named = ", ".join(f"{name or '(no prefix)'} ({count} points)" for name, count in counts.most_common())
    if subject is not None:
        if subject not in counts:
            raise MotionError(f"{path}: holds no subject {subject!r}; allowed are {named}")
        return subject, [i for i in kept if _prefix(labels[i]) == subject]
    bodies = [name for name, count in counts.items() if len(counts) == 1 or count >= MIN_SUBJECT_POINTS]
    if len(bodies) != 1:
        raise MotionError(f"{path}: holds several subjects: {named}. Name the one to read: subject='...'.")
    return bodies[0], [i for i in kept if _prefix(labels[i]) == bodies[0]]


def _prefix(label: str) -> str:
    return label.rsplit(":", 1)[0].strip() if ":" in label else ""


def unique_names(labels: Sequence[str]) -> list[str]:
    """Marker names without subject, numbered where they repeat (T8, T8_2), ``point_7`` where there is none."""
    names: list[str] = []
    taken: set[str] = set()
    for i, label in enumerate(labels):
        name = base = bare_name(label) or f"point_{i + 1}"
        number = 2
        while name in taken:
            name, number = f"{base}_{number}", number + 1
        taken.add(name)
        names.append(name)
    return names


MIN_FRAMES = 3


def check_amount(path: Path, n_frames: int, n_points: int) -> None:
    """Refuse what is too little for a motion.

    Raises
    ------
    MotionError
        If there are fewer than 3 frames or 3 points.
    """
    if n_frames < MIN_FRAMES:
        raise MotionError(
            f"{path}: holds {n_frames} frame(s); a motion needs {MIN_FRAMES} or more, because a velocity cannot be "
            "formed from fewer"
        )
    if n_points < MIN_MARKERS:
        raise MotionError(f"{path}: holds {n_points} point(s); a body needs {MIN_MARKERS} or more")


def unit_or_guess(path: Path, name: str, position: FloatArray) -> str:
    """The named unit; without a name mm or m, whichever makes the body less than 10 m large, with a warning.

    Parameters
    ----------
    path : Path
        For the warning.
    name : str
        ``""`` when neither file nor user names a unit.
    position : ndarray, shape (T, P, 3)
        In file units, NaN where missing.
    """
    if name:
        return name
    span = float(np.nan_to_num(body_extent(position)).max())
    guess = "m" if span < 10.0 else "mm"
    warnings.warn(
        f"{path}: names no length unit; its points span {span:.3g}, so {guess} is taken. "
        "If that is wrong, give the unit: units='mm', 'cm' or 'm'.",
        DoppelgaitWarning,
        stacklevel=4,
    )
    return guess


def points_to_motion(
    path: Path,
    position_m: FloatArray,
    labels: Sequence[str],
    *,
    file_format: str,
    rate_hz: float,
    length_unit: str,
    up_axis: str | None,
    usual_up: str = "z",
    subject: str | None = None,
    known_parts: Mapping[str, str] | None = None,
    notes: Sequence[str] = (),
) -> Motion:
    """Motion of the physical points of one subject, not cleaned.

    Parameters
    ----------
    path : Path
        The file, for messages.
    position_m : ndarray, shape (T, P, 3)
        All points of the file in m, in its own axes; NaN in any coordinate is a gap.
    labels : sequence of str, length P
        As in the file, subject before a colon.
    file_format : str
        For the report.
    rate_hz : float
        Frames per second.
    length_unit : str
        Unit of most points in the file, for the report.
    up_axis : str or None
        One of :data:`~doppelgait.motion.axes.AXES`; None finds it.
    usual_up : str
        ``"x"``, ``"y"`` or ``"z"``: taken, with a warning, where the points do not show what is up.
    subject : str, optional
        Prefix of the wanted labels.
    known_parts : mapping, optional
        Body part by lower-case name, before those of :mod:`doppelgait.motion.skeleton`.
    notes : sequence of str
        What was worked around, for the report.

    Returns
    -------
    Motion
        Motion (time, marker, space) in m, z up, NaN for gaps.

    Raises
    ------
    MotionError
        If too few points or frames are there, no one subject can be told, or an option is not allowed.
    """
    check_amount(path, *position_m.shape[:2])
    reasons = sort_points(labels, {})
    kept = [i for i in range(len(labels)) if i not in reasons]
    if not kept:
        kinds = ", ".join(sorted(set(reasons.values())))
        raise MotionError(f"{path}: holds no marker positions: its {len(reasons)} points are {kinds}")
    name, chosen = pick_subject(path, labels, kept, subject)
    measured = len(kept) + sum(is_measured(reason) for reason in reasons.values())
    reasons |= {i: "belongs to another subject or prop" for i in kept if i not in chosen}
    names, extra = unique_names([labels[i] for i in chosen]), known_parts or {}
    named = parts_of([labels[i] for i in chosen])
    parts = [extra.get(bare_name(labels[i]).lower()) or part for i, part in zip(chosen, named, strict=True)]
    position = position_m[:, chosen].copy()
    position[np.isnan(position).any(axis=2)] = np.nan
    axis_facts = _axis(path, position, parts, up_axis, usual_up)
    report = {
        "format": file_format,
        "frame_rate_hz": rate_hz,
        "n_frames": int(position.shape[0]),
        "points_in_file": len(labels),
        "points_measured": measured,
        "length_unit": length_unit,
        "metres_per_unit": metres_per_unit(length_unit, where=str(path)),
        **axis_facts,
        "dropped": by_reason(labels, reasons),
        "notes": list(notes),
    }
    return make_motion(
        turn_z_up(position, axis_facts["up_axis"]),
        rate_hz=rate_hz,
        markers=names,
        parts=parts,
        facts={"source": path.name, "kind": "recording", "subject": name},
        report=report,
    )


def _axis(path: Path, position: FloatArray, parts: list[str], up_axis: str | None, usual: str) -> dict[str, Any]:
    if up_axis is not None:
        return {"up_axis": up_axis, "up_axis_from": "option"}
    facts = find_up_axis(position, parts)
    if facts["up_axis_from"] == "assumed":
        # asked again only for the sign of the usual axis
        facts = {**find_up_axis(position, parts, declared=usual), "up_axis_from": "assumed"}
        warnings.warn(
            f"{path}: neither names nor shows which axis points up; {facts['up_axis']} is taken. If that is wrong, "
            "give it: up_axis='x', 'y', 'z', '-x', '-y' or '-z'.",
            DoppelgaitWarning,
            stacklevel=5,
        )
    return facts


def by_reason(labels: Sequence[str], reasons: Mapping[int, str]) -> dict[str, list[str]]:
    """Names of the points left out, by the reason for it."""
    table: dict[str, list[str]] = {}
    for i in sorted(reasons):
        table.setdefault(reasons[i], []).append(labels[i] or f"point_{i + 1}")
    return table
