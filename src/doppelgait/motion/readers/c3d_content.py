"""Points and parameters of a C3D file: read by ezc3d where that is safe and right, checked against the file's size."""

from __future__ import annotations

import math
import os
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import DoppelgaitWarning, MotionError
from doppelgait.motion.readers.c3d_layout import INTEL, RESAVE, Layout, read_layout, without_descriptions

FloatArray = npt.NDArray[np.float64]

MAX_HEADER_FRAMES = 65535


@dataclass(frozen=True)
class C3dContent:
    """What the 3D part of a C3D file holds, in the units of the file.

    Parameters
    ----------
    position : ndarray, shape (T, P, 3)
        NaN where a point was not seen.
    labels : tuple of str, length P
        As in the file, ``""`` where it names none.
    rate_hz : float
        0 when the file names none.
    units : tuple of str
        One for all points, or one each, or none.
    texts : dict
        Text parameters by ``"GROUP:NAME"``.
    notes : tuple of str
        Faults of the file that were worked around.
    """

    position: FloatArray
    labels: tuple[str, ...]
    rate_hz: float
    units: tuple[str, ...]
    texts: dict[str, tuple[str, ...]]
    notes: tuple[str, ...] = ()


def read_content(path: Path) -> C3dContent:
    """Read a C3D file.

    Raises
    ------
    MotionError
        If the file is damaged, holds no points, or says two things about its layout that the data do not settle.
    """
    layout = read_layout(path)
    n_points = _point_count(path, layout)
    analog, n_frames = _settle_layout(path, layout)
    with _readable_copy(path, layout) as (source, notes):
        raw = _call_ezc3d(path, source)
    if n_frames > MAX_HEADER_FRAMES:
        position = _trim_padding(_positions_of_data_block(path, layout, analog, n_frames))
        notes += (f"the header counts to {MAX_HEADER_FRAMES} frames only; the size of the file gave their number",)
    elif layout.number("POINT", "USED") is not None and analog == layout.declared_analog():
        position = _positions_of_ezc3d(path, raw, n_points, n_frames)
    else:
        position = _positions_of_data_block(path, layout, analog, n_frames)
        notes += ("frames were read by the layout of the header, because the parameters do not describe it",)
    if n_frames < layout.header_frames:
        notes += (f"declares {layout.header_frames} frames but holds {n_frames}",)
        warnings.warn(f"{path}: {notes[-1]}; is it cut off? Those are read.", DoppelgaitWarning, stacklevel=4)
    return _content(raw, layout, position, notes)


def _point_count(path: Path, layout: Layout) -> int:
    declared = layout.number("POINT", "USED")
    n_points = layout.header_points if declared is None else int(declared) % 65536
    if n_points == 0:
        held = "rotation matrices but no points" if layout.number("ROTATION", "USED") else "no points"
        raise MotionError(
            f"{path}: holds {held}; a motion needs the positions of markers or joints. "
            "Export marker positions from the program that recorded it."
        )
    if n_points != layout.header_points:
        raise MotionError(
            f"{path}: its header declares {layout.header_points} points, its parameters {n_points}. {RESAVE}."
        )
    return n_points


def _settle_layout(path: Path, layout: Layout) -> tuple[int, int]:
    """Analog words per frame and number of frames that fill the data section."""
    frames, points = layout.header_frames, layout.header_points
    if frames < 1:
        raise MotionError(f"{path}: its header declares {frames} frames. {RESAVE}.")
    candidates = list(dict.fromkeys((int(layout.declared_analog()), layout.header_analog)))
    tight = [words for words in candidates if layout.is_tight(frames, points, words)]
    if len(tight) == 1:
        return tight[0], frames
    held = math.floor(layout.frames_that_fit(points, candidates[0]))
    if len(candidates) == 1 and held >= 1:
        # the header counts to 65535 only; beyond that the size of the file counts
        return candidates[0], held if frames >= MAX_HEADER_FRAMES else min(frames, held)
    raise MotionError(
        f"{path}: header and parameters declare {layout.header_analog} and {candidates[0]} analog values per frame; "
        f"{frames} frames of {points} points fit the file with neither. {RESAVE}."
    )


@contextmanager
def _readable_copy(path: Path, layout: Layout) -> Iterator[tuple[Path, tuple[str, ...]]]:
    """The file, or a copy without two faults at which ezc3d stops or runs for ever."""
    offset = layout.records.get(("ANALOG", "OFFSET"))
    floats = offset is not None and offset.kind == 4 and len(offset.shape) == 1 and offset.shape[0] < 128
    readable = all(span.is_readable for span in layout.spans)
    if readable and not floats:
        yield path, ()
        return
    data = path.read_bytes()
    section = bytearray(data[layout.section_at : layout.data_at])
    notes = []
    if offset is not None and floats:
        # declared as twice as many 16-bit integers: offsets of analog channels are not used here
        section[offset.span.step + 2] = 2
        section[offset.span.step + 4] *= 2
        notes.append("ANALOG:OFFSET is stored as floats, not as integers; it was left out")
    if not readable:
        section = bytearray(_drop_descriptions(path, bytes(section), layout))
        notes.append("descriptions of parameters are missing or too long; they were left out")
    handle, name = tempfile.mkstemp(suffix=".c3d")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data[: layout.section_at] + section + data[layout.data_at :])
        yield Path(name), tuple(notes)
    finally:
        os.unlink(name)


def _drop_descriptions(path: Path, section: bytes, layout: Layout) -> bytes:
    try:
        return without_descriptions(section, layout.spans)
    except ValueError:
        raise MotionError(f"{path}: has a damaged parameter section without room for a repair. {RESAVE}.") from None


def _call_ezc3d(path: Path, source: Path) -> Any:
    import ezc3d

    try:
        return ezc3d.c3d(os.fspath(source))
    except MemoryError:
        raise MotionError(f"{path}: does not fit into memory; is it damaged? {RESAVE}.") from None
    except Exception as error:  # ezc3d raises whatever its C++ threw
        reason = str(error).split(". ")[0].strip() or type(error).__name__
        raise MotionError(f"{path}: is no standard C3D file, ezc3d refuses it ({reason}). {RESAVE}.") from None


def _positions_of_ezc3d(path: Path, raw: Any, n_points: int, n_frames: int) -> FloatArray:
    values = np.asarray(raw["data"]["points"], dtype=np.float64)
    if values.ndim != 3 or values.shape[1] != n_points or values.shape[2] < n_frames:
        raise MotionError(
            f"{path}: declares {n_points} points x {n_frames} frames, ezc3d found "
            f"{' x '.join(str(n) for n in values.shape[1:])}. {RESAVE}."
        )
    residual = np.asarray(raw["data"]["meta_points"]["residuals"], dtype=float)[0]
    position = np.moveaxis(values[:3], 0, 2).swapaxes(0, 1).copy()
    position[residual.T < 0] = np.nan
    return _zeros_to_nan(position[:n_frames])


def _positions_of_data_block(path: Path, layout: Layout, analog: int, n_frames: int) -> FloatArray:
    """Frames as the header lays them out; for Intel floats only, the one form in which this fault is known."""
    if not (layout.is_float and layout.processor == INTEL):
        raise MotionError(
            f"{path}: its parameters do not describe its {n_frames} frames with {analog} analog values each. {RESAVE}."
        )
    width = 4 * layout.header_points + analog
    words = np.fromfile(path, dtype="<f4", count=n_frames * width, offset=layout.data_at).reshape(n_frames, width)
    samples = words[:, : 4 * layout.header_points].reshape(n_frames, layout.header_points, 4).astype(np.float64)
    position = samples[:, :, :3].copy()
    position[~(samples[:, :, 3] >= 0)] = np.nan
    return _zeros_to_nan(position)


def _trim_padding(position: FloatArray) -> FloatArray:
    """Without the empty frames at the end that fill the last block."""
    seen = np.flatnonzero(np.isfinite(position).any(axis=(1, 2)))
    return position[: seen[-1] + 1] if seen.size else position


def _zeros_to_nan(position: FloatArray) -> FloatArray:
    """Exact 0, 0, 0 is how several systems write "not seen"; no marker sits there to the last bit."""
    lost = ~np.isfinite(position).all(axis=2) | (position == 0.0).all(axis=2) | (np.abs(position) > 1e9).any(axis=2)
    position[lost] = np.nan
    return position


def _content(raw: Any, layout: Layout, position: FloatArray, notes: tuple[str, ...]) -> C3dContent:
    texts = _texts(raw)
    labels = [label for n in ("", *range(2, 12)) for label in texts.get(f"POINT:LABELS{n}", ())]
    n_points = position.shape[1]
    labels = (labels + [""] * n_points)[:n_points]
    rate = layout.number("POINT", "RATE") or layout.header_rate_hz
    units = tuple(unit for unit in texts.get("POINT:UNITS", ()))
    return C3dContent(position, tuple(labels), float(rate), units, texts, notes)


def _texts(raw: Any) -> dict[str, tuple[str, ...]]:
    found = {}
    for group, parameters in raw["parameters"].items():
        for name, parameter in parameters.items():
            value = parameter.get("value") if isinstance(parameter, dict) else None
            if isinstance(value, list) and all(isinstance(text, str) for text in value):
                found[f"{group}:{name}".upper()] = tuple(text.strip(" \0") for text in value)
    return found
