"""Which points of a C3D file are physical markers of the subject, and why the others are not."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from doppelgait.core.errors import MotionError
from doppelgait.motion.skeleton import bare_name, complete_set, part_of

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
