"""C3D files (marker motion capture): units, axes, gaps and the physical markers of one subject."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import DoppelgaitWarning, MotionError
from doppelgait.core.plugins import plugin
from doppelgait.motion.axes import find_up_axis, metres_per_unit, turn_z_up
from doppelgait.motion.motion import Motion, make_motion
from doppelgait.motion.readers.c3d_file import MAGIC, C3dContent, read_content
from doppelgait.motion.readers.points import (
    by_reason,
    is_measured,
    pick_subject,
    sort_points,
    unique_names,
    unit_or_guess,
)
from doppelgait.motion.skeleton import parts_of

FloatArray = npt.NDArray[np.float64]

MIN_FRAMES = 3
MAX_RATE_HZ = 10_000.0


def sniff_c3d(path: Path, head: bytes) -> bool:
    """Whether a file looks like C3D: 0x50 after the block number of its parameters, and no text."""
    return len(head) >= 2 and head[0] >= 1 and head[1] == MAGIC and b"\0" in head[:512]


@plugin("motion_reader", "c3d", sniff=sniff_c3d, suffixes=(".c3d",))
def read_c3d(
    path: Path,
    *,
    subject: str | None = None,
    units: str | None = None,
    up_axis: str | None = None,
    rate_hz: float | None = None,
) -> Motion:
    """Physical markers of one subject of a C3D file, not cleaned.

    Parameters
    ----------
    path : Path
        An existing file.
    subject : str, optional
        Prefix of the wanted labels; needed only when several subjects were recorded.
    units : str, optional
        ``"mm"``, ``"cm"``, ``"m"``, ``"in"`` or ``"ft"``; default: what the file says.
    up_axis : str, optional
        ``"x"``, ``"y"``, ``"z"``, ``"-x"``, ``"-y"`` or ``"-z"``; default: found.
    rate_hz : float, optional
        Frames per second, up to 10000; default: what the file says.

    Returns
    -------
    Motion
        Motion (time, marker, space) in m, z up, NaN for gaps; ``report`` tells what was read and left out.

    Raises
    ------
    MotionError
        If the file cannot be read right, or holds no usable markers.
    """
    content = read_content(path)
    rate = _rate(path, content, rate_hz)
    reasons = sort_points(content.labels, content.texts)
    kept = [i for i in range(len(content.labels)) if i not in reasons]
    _check_amount(path, content, kept, reasons)
    name, chosen = pick_subject(path, content.labels, kept, subject)
    reasons |= {i: f"belongs to {_who(content.labels[i])}" for i in kept if i not in chosen}
    names = unique_names([content.labels[i] for i in chosen])
    parts = parts_of([content.labels[i] for i in chosen])
    factor, unit_facts = _unit(path, content, chosen, units)
    position = content.position[:, chosen] * factor
    axis_facts = _axis(path, position, parts, content, up_axis)
    measured = len(kept) + sum(is_measured(reason) for i, reason in reasons.items() if i not in kept)
    report = {
        "format": "c3d",
        "frame_rate_hz": rate,
        "n_frames": int(position.shape[0]),
        "points_in_file": len(content.labels),
        "points_measured": measured,
        **unit_facts,
        **axis_facts,
        "dropped": by_reason(content.labels, reasons),
        "notes": list(content.notes),
    }
    return make_motion(
        turn_z_up(position, axis_facts["up_axis"]),
        rate_hz=rate,
        markers=names,
        parts=parts,
        facts={"source": path.name, "kind": "recording", "subject": name or _only_subject(content)},
        report=report,
    )


def _rate(path: Path, content: C3dContent, rate_hz: float | None) -> float:
    rate = content.rate_hz if rate_hz is None else float(rate_hz)
    if not 0.0 < rate <= MAX_RATE_HZ:
        given = "declares" if rate_hz is None else "was given"
        raise MotionError(
            f"{path}: {given} a frame rate of {rate:g} Hz; it must be above 0 and at most {MAX_RATE_HZ:g} Hz. "
            "Give the true one: rate_hz=..."
        )
    return rate


def _check_amount(path: Path, content: C3dContent, kept: list[int], reasons: dict[int, str]) -> None:
    if not kept:
        kinds = ", ".join(sorted(set(reasons.values())))
        raise MotionError(f"{path}: holds no marker positions: its {len(reasons)} points are {kinds}")
    if content.position.shape[0] < MIN_FRAMES:
        raise MotionError(
            f"{path}: holds {content.position.shape[0]} frame(s), a static pose; a motion needs {MIN_FRAMES} or more, "
            "because a velocity cannot be formed from fewer"
        )


def _unit(
    path: Path, content: C3dContent, chosen: list[int], units: str | None
) -> tuple[npt.NDArray[np.float64], dict[str, Any]]:
    """Metres per file unit for each point, shape (P, 1), and what to report about it."""
    names = [units] * len(chosen) if units is not None else _declared_units(content, chosen)
    if names is None:
        names = [unit_or_guess(path, "", content.position[:, chosen])] * len(chosen)
    factors = [metres_per_unit(name, where=str(path)) for name in names]
    first = max(set(names), key=names.count)
    facts = {"length_unit": first, "metres_per_unit": metres_per_unit(first, where=str(path))}
    return np.array(factors)[:, np.newaxis], facts


def _declared_units(content: C3dContent, chosen: list[int]) -> list[str] | None:
    units = [unit for unit in content.units if unit]
    if not units:
        return None
    if len(content.units) == len(content.labels) > 1:
        return [content.units[i] or units[0] for i in chosen]
    return [units[0]] * len(chosen)


def _axis(
    path: Path, position: FloatArray, parts: list[str], content: C3dContent, up_axis: str | None
) -> dict[str, Any]:
    if up_axis is not None:
        return {"up_axis": up_axis, "up_axis_from": "option"}
    facts = find_up_axis(position, parts, declared=_declared_axis(content))
    if facts["up_axis_from"] == "assumed":
        warnings.warn(
            f"{path}: neither names nor shows which axis points up; z is taken. If that is wrong, give it: "
            "up_axis='x', 'y', '-x', '-y' or '-z'.",
            DoppelgaitWarning,
            stacklevel=4,
        )
    return facts


def _declared_axis(content: C3dContent) -> str:
    """Axis letter drawn upwards on the screen; its sign is unreliable in practice."""
    screen = content.texts.get("POINT:Y_SCREEN", ("",))
    return screen[0].strip("+- ").lower()[:1] if screen else ""


def _only_subject(content: C3dContent) -> str:
    names = [name for name in content.texts.get("SUBJECTS:NAMES", ()) if name]
    return names[0] if len(names) == 1 else ""


def _who(label: str) -> str:
    return f"subject or prop {label.rsplit(':', 1)[0]!r}" if ":" in label else "no subject"
