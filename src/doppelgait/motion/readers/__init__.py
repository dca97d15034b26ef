"""Motion files: a reader per format, selected by content.

A reader is a function ``(path, **options) -> Motion`` under ``plugin("motion_reader", ...)``, with the protocol of
:mod:`doppelgait.core.readers`. It returns every physical marker in metres, z up, NaN for gaps; cleaning is the same for
all.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

from doppelgait.core.config import read_toml
from doppelgait.core.errors import MotionError, explain_memory
from doppelgait.core.plugins import Group
from doppelgait.core.readers import Limits, OtherFile, check_options, check_reader, choose_reader, read_other_files
from doppelgait.motion.motion import Motion

__all__ = ["MOTION_READERS", "check_types", "cut_part", "read", "take_part"]

MOTION_READERS: Group[Callable[..., Motion]] = Group(
    "motion_reader",
    built_in=tuple(f"doppelgait.motion.readers.{name}" for name in ("amc", "arrays", "bvh", "c3d", "table")),
    check=check_reader,
)
"""Readers of motion files by name."""


@cache
def list_other_files() -> tuple[OtherFile, ...]:
    """Return the files that are no motions, but that people have."""
    return read_other_files(read_toml(Path(__file__).with_name("others.toml"))[0])


@explain_memory
def read(
    path: str | os.PathLike[str],
    *,
    clean: bool = True,
    start_s: float | None = None,
    stop_s: float | None = None,
    segment: int | Literal["longest"] | None = None,
    loop_to_s: Annotated[float, Limits(0.0, 3600.0)] | None = None,
    loop_variation: float = 1.0,
    treadmill: bool = False,
    format: str | None = None,
    **options: Any,
) -> Motion:
    """Read a motion recording.

    Parameters
    ----------
    path : path-like
        The file. Its format is detected from the content.
    clean : bool
        Fill gaps, drop unusable markers, low-pass the positions and put the floor at z = 0
        (:func:`~doppelgait.motion.clean.clean_motion`).
    start_s, stop_s : float, optional
        Start and end of the part to keep, in s from the first frame of the recording. It is selected before cleaning.
        The time axis of the result starts at 0. The height of the body is measured in the whole recording.
    segment : int or "longest", optional
        Keep one straight segment at constant velocity (:func:`~doppelgait.motion.segments.find_segments`): its number,
        1 for the first, as ``motion info`` lists them, or the longest. Needs ``clean``.
    loop_to_s : float, optional
        Extend the kept part to this duration, with strides that vary about the recorded ones
        (:func:`~doppelgait.motion.loop.loop`). Needs ``clean``.
    loop_variation : float
        Factor on the variation of the strides in the loop, 0 (exact repetition) to 2.
    treadmill : bool
        The recording was made on a treadmill: move the body over the ground at the measured belt
        speed (:func:`~doppelgait.motion.ground.move_over_ground`). Needs ``clean``.
    format : str, optional
        Name of the reader, for a file that none or several recognise.
    **options
        Options of the reader, for example ``units``, ``up_axis``, ``rate_hz`` and ``subject`` for C3D.

    Returns
    -------
    Motion
        Motion (time, marker, space) in m, z up.

    Raises
    ------
    MotionError
        If the file does not exist, no reader accepts it, an option is not allowed, or the file is invalid.

    See Also
    --------
    find_segments : find the straight segments at constant velocity.

    Examples
    --------
    >>> import doppelgait as dg
    >>> import numpy as np
    >>> walk = dg.motion.boulic_walk(speed_mps=1.2, duration_s=3.0)
    >>> np.savez("walk.npz", positions=walk.position_m, names=walk.markers, rate_hz=walk.rate_hz, units="m")
    >>> motion = dg.motion.read("walk.npz")
    >>> len(motion.markers), motion.rate_hz, motion.duration_s
    (17, 250.0, 3.0)
    """
    file = Path(path)
    kept: dict[str, Any] = {"segment": segment, "loop_to_s": loop_to_s, "loop_variation": loop_variation}
    own = {"clean": clean, "start_s": start_s, "stop_s": stop_s, **kept, "treadmill": treadmill}
    reader = choose_reader(
        MOTION_READERS,
        file,
        options,
        noun="motion",
        error=MotionError,
        others=list_other_files(),
        format=format,
        further=tuple(own),
    )
    check_types(file, own)
    try:
        whole = reader.run(file, **options)
    except OSError as error:
        raise MotionError(f"{file}: cannot be read: {error.strerror or error}") from None
    motion = cut_part(file, whole, start_s, stop_s)
    if not clean:
        if segment is not None or loop_to_s is not None or treadmill:
            raise MotionError(
                f"{file}: segment, loop_to_s and treadmill need a cleaned motion; leave out clean = false"
            )
        return motion
    from doppelgait.motion.clean import clean_motion

    return take_part(file, clean_motion(motion, whole=None if motion is whole else whole), treadmill=treadmill, **kept)


def cut_part(path: Path, motion: Motion, start_s: float | None, stop_s: float | None) -> Motion:
    """Return the part of a recording from start to stop."""
    if start_s is None and stop_s is None:
        return motion
    rate = motion.rate_hz
    last_s = (motion.n_frames - 1) / rate
    start, stop = 0.0 if start_s is None else float(start_s), last_s if stop_s is None else float(stop_s)
    if not 0.0 <= start < stop <= last_s + 0.5 / rate:
        raise MotionError(
            f"{path}: the part from {start:g} s to {stop:g} s is not in the recording; allowed is a start below "
            f"the stop, both in 0 to {last_s:.4g} s"
        )
    first = round(start * rate)
    part = motion.cut(first, round(stop * rate) + 1)
    return part.with_report(read_from_s=first / rate, read_to_s=(first + part.n_frames - 1) / rate)


def take_part(
    path: Path,
    motion: Motion,
    *,
    segment: int | Literal["longest"] | None,
    loop_to_s: float | None,
    loop_variation: float = 1.0,
    treadmill: bool = False,
) -> Motion:
    """Return a segment of a cleaned motion, looped if requested."""
    from doppelgait.motion.checks import check_motion
    from doppelgait.motion.gait import add_gait_facts
    from doppelgait.motion.ground import move_over_ground
    from doppelgait.motion.loop import loop
    from doppelgait.motion.segments import crop, find_segments

    motion = check_motion(move_over_ground(motion) if treadmill else motion)
    if segment is not None:
        found = find_segments(motion)
        if not found:
            raise MotionError(f"{path}: has no straight segment at constant velocity; give start_s and stop_s instead")
        if segment == "longest":
            wanted = max(found, key=lambda one: one.duration_s)
        elif isinstance(segment, bool) or not isinstance(segment, int) or not 1 <= segment <= len(found):
            raise MotionError(
                f"{path}: segment = {segment!r} is not allowed; allowed are 'longest' and 1 to {len(found)}"
            )
        else:
            wanted = found[segment - 1]
        motion = add_gait_facts(crop(motion, wanted))
    return motion if loop_to_s is None else loop(motion, duration_s=loop_to_s, variation=loop_variation)


def check_types(path: Path, options: dict[str, Any]) -> None:
    """Raise an error for an option of :func:`read` that is not allowed."""
    check_options(path, read, options, error=MotionError)
    if not 0.0 <= (variation := options.get("loop_variation", 1.0)) <= 2.0:
        raise MotionError(f"{path}: loop_variation = {variation!r} is not allowed; it must be 0 to 2")
