"""C3D files (marker motion capture).

The reader handles units, axes, gaps and the physical markers of one subject.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from doppelgait.core.plugins import plugin
from doppelgait.motion.axes import convert_unit_to_metres
from doppelgait.motion.motion import Motion
from doppelgait.motion.readers.c3d_file import MAGIC, read_content
from doppelgait.motion.readers.points import LengthUnit, check_rate, find_unit, make_point_motion, pick_markers


def sniff_c3d(path: Path, head: bytes) -> bool:
    """Return True if a file starts like C3D."""
    # the first bytes are the block number of the parameters and 0x50, and the rest is not text
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
    """Read a C3D file's physical markers, uncleaned."""
    content = read_content(path)
    rate = check_rate(
        path,
        content.rate_hz if rate_hz is None else rate_hz,
        said="declares" if rate_hz is None else "was given",
    )
    body = pick_markers(path, content.labels, subject=subject, texts=content.texts)
    if not body.subject:
        subjects = [name for name in content.texts.get("SUBJECTS:NAMES", ()) if name]
        body = replace(body, subject=subjects[0] if len(subjects) == 1 else "")
    # one unit for all points, or one for each
    declared = [unit for unit in content.units if unit]
    if units is not None or not declared:
        name = units if units is not None else find_unit(path, "", content.position[:, body.kept])
        names = [name] * len(body.kept)
    elif len(content.units) == len(content.labels) > 1:
        names = [content.units[i] or declared[0] for i in body.kept]
    else:
        names = [declared[0]] * len(body.kept)
    first = max(dict.fromkeys(names), key=names.count)
    each = np.array([convert_unit_to_metres(name, where=str(path)) for name in names])[:, np.newaxis]
    # the axis plotted upwards on the screen; its sign is unreliable in practice
    screen = content.texts.get("POINT:Y_SCREEN", ())
    return make_point_motion(
        path,
        content.position,
        body,
        file_format="c3d",
        rate_hz=rate,
        unit=LengthUnit(first, convert_unit_to_metres(first, where=str(path)), each=each),
        up_axis=up_axis,
        declared_up=screen[0].strip("+- ").lower()[:1] if screen else "",
        notes=content.notes,
    )
