"""C3D files (marker motion capture), in the byte orders of Intel, DEC and SGI.

A file is read only if its records are consistent and the declared samples fit into the file.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from doppelgait.core.errors import MotionError
from doppelgait.core.units import FloatArray
from doppelgait.motion.readers.text import Points, decode, note_frames, point_format

BLOCK = 512
MAGIC = 0x50
INTEL, DEC, SGI = 84, 85, 86
"""Byte of the processor: little-endian IEEE, little-endian VAX floats, big-endian IEEE."""
MAX_SIZE = 2**31
MAX_HEADER_FRAMES = 65535
LARGEST = 1e9  # maximum coordinate of a position, in any unit
TYPE_SIZES = {0: 0, -1: 1, 1: 1, 2: 2, 4: 4}
RESAVE = "Open it in the program that recorded it, or in a C3D editor, and export it again"

NUMBERS = tuple(
    (group, name)
    for group in ("POINT", "ANALOG", "ROTATION", "FORCE_PLATFORM")
    for name in ("USED", "RATE", "SCALE", "GEN_SCALE", "FRAMES", "DATA_START", "RATIO")
    if (group, name) != ("ANALOG", "SCALE")
)
"""Parameters that must be usable numbers if they exist."""


@dataclass(frozen=True)
class Record:
    """Values of a parameter, and the bytes of its pointer and ends. Kinds: -1 (text), 1 and 2 (integer), 4 (float)."""

    kind: int
    shape: tuple[int, ...]
    raw: bytes
    processor: int
    step_at: int
    end: int
    next_at: int

    def number(self) -> float | None:
        """Return the first value, or None without a number."""
        if self.kind == -1 or len(self.raw) < abs(self.kind):
            return None
        if self.kind == 4:
            return decode_float32(self.raw, self.processor)
        return float(int.from_bytes(self.raw[: self.kind], "big" if self.processor == SGI else "little", signed=True))

    def texts(self) -> tuple[str, ...]:
        """Return the texts without padding; numbers have none."""
        if self.kind != -1:
            return ()
        length, n_texts = self.shape[0], math.prod(self.shape[1:])
        return tuple(decode(self.raw[n * length : (n + 1) * length]).strip(" \0") for n in range(n_texts))


@dataclass(frozen=True)
class Layout:
    """Counts and byte positions that a file declares; ``header_analog`` is words per frame."""

    size: int
    section_at: int
    data_at: int
    processor: int
    is_float: bool
    header_scale: float
    header_points: int
    header_frames: int
    header_analog: int
    header_rate_hz: float
    records: dict[tuple[str, str], Record]

    def number(self, group: str, name: str) -> float | None:
        """Return the number in a parameter, or None without one."""
        record = self.records.get((group, name))
        return record.number() if record else None

    def _count_per_frame(self, group: str) -> float:
        """Return a group's samples per point frame."""
        point_rate = self.number("POINT", "RATE") or self.header_rate_hz
        return round((self.number(group, "RATE") or 0.0) / point_rate) if point_rate > 1e-3 else 0.0

    def count_declared_analog(self) -> float:
        """Return the declared analog words per frame. They are channels times samples per frame."""
        return (self.number("ANALOG", "USED") or 0.0) * self._count_per_frame("ANALOG")

    def count_declared_rotations(self) -> float:
        """Return the number of rotation matrices per frame."""
        ratio = self.number("ROTATION", "RATIO")
        per_frame = self._count_per_frame("ROTATION") if ratio is None else ratio
        return max(self.number("ROTATION", "USED") or 0.0, 1.0) * per_frame

    def count_bytes(self, points: int, analog: int) -> int:
        """Return the bytes of a frame."""
        return (4 * points + analog) * (4 if self.is_float else 2)


def decode_float32(raw: bytes, processor: int) -> float:
    """Decode one 32-bit float."""
    # DEC swaps the two words, and its exponent is two higher than that of IEEE
    if processor == DEC:
        return float(struct.unpack("<f", raw[2:4] + raw[0:2])[0]) / 4.0
    return float(struct.unpack(">f" if processor == SGI else "<f", raw[:4])[0])


def read_layout(path: Path) -> Layout:
    """Check header and parameter section of a C3D file."""
    size = path.stat().st_size
    if size > MAX_SIZE:
        raise MotionError(f"{path}: has {size} bytes; C3D files of up to {MAX_SIZE} bytes are read")
    with path.open("rb") as file:
        header = file.read(BLOCK)
        if len(header) < BLOCK or header[0] < 2 or header[1] != MAGIC:
            raise ValueError(
                f"is not a complete C3D file: it must start with a header of {BLOCK} bytes, and the second "
                f"byte must be 0x50"
            )
        section_at = (header[0] - 1) * BLOCK
        file.seek(section_at)
        processor = file.read(4)[3:4]
        if not processor or processor[0] not in (INTEL, DEC, SGI):
            found = processor[0] if processor else "nothing"
            raise ValueError(
                f"is truncated or damaged: the byte that names the processor is {found} (allowed: {INTEL} "
                f"Intel, {DEC} DEC, {SGI} SGI; {size} bytes)"
            )
        order = ">" if processor[0] == SGI else "<"
        points, analog, first, last, _, scale, data_block, _ = struct.unpack_from(f"{order}HHHHH4sHH", header, 2)
        data_at = (data_block - 1) * BLOCK
        if not 0 < section_at < data_at <= size:
            raise ValueError(
                f"is truncated or damaged: its header puts the parameters at byte {section_at} and the data "
                f"at byte {data_at}, but the file has {size} bytes"
            )
        file.seek(section_at)
        section = file.read(data_at - section_at)
    layout = Layout(
        size=size,
        section_at=section_at,
        data_at=data_at,
        processor=processor[0],
        is_float=decode_float32(scale, processor[0]) < 0,
        header_scale=decode_float32(scale, processor[0]),
        header_points=points,
        header_frames=last - first + 1,
        header_analog=analog,
        header_rate_hz=decode_float32(header[20:24], processor[0]),
        records=_walk_records(section, section_at, processor[0]),
    )
    for name in NUMBERS:
        value = layout.number(*name)
        if name in layout.records and (value is None or not abs(value) < 1e6 or (name[1] == "RATE" and value < 0)):
            raise ValueError(f"has a damaged parameter section: {':'.join(name)} is {value}, not a usable number")
    extra = layout.count_declared_analog() + 17 * layout.count_declared_rotations()
    if not 0 <= extra * 2 <= max(layout.size - layout.data_at, 0):
        raise ValueError(
            f"is truncated or damaged: its parameters declare {extra:.0f} analog and rotation values per "
            f"frame, which is more than the file holds"
        )
    return layout


def _walk_records(section: bytes, section_at: int, processor: int) -> dict[tuple[str, str], Record]:
    # names are in upper case. A record that does not fit raises an error.
    groups: dict[int, str] = {}
    found: list[tuple[int, str, Record]] = []
    at = 4
    # "no parameters at all" is declared by a section of zero blocks
    while section[2] and at < len(section) and section[at]:
        try:
            number, text, record = _read_record(section, at, processor)
        except (ValueError, IndexError, struct.error) as error:
            fault = str(error) if type(error) is ValueError else "runs beyond the end of the section"
            raise ValueError(f"has a damaged parameter section: the record at byte {section_at + at} {fault}") from None
        if number < 0:
            groups[-number] = text
        else:
            found.append((number, text, record))
        at = record.next_at
        if section[record.step_at : record.step_at + 2] == b"\0\0":
            break
    return {(groups.get(number, ""), name): record for number, name, record in found}


def _read_record(section: bytes, at: int, processor: int) -> tuple[int, str, Record]:
    """Read one parameter, or a group, whose number is negative."""
    length, number = struct.unpack_from("bb", section, at)
    step_at = at + 2 + abs(length)
    name = section[at + 2 : step_at]
    if number == 0 or any(byte < 32 for byte in name):
        raise ValueError("has no name or belongs to no group")
    text = name.decode("latin-1").strip().upper()
    kind, start = 0, step_at + 2
    shape: tuple[int, ...] = ()
    if number > 0:  # a parameter; groups have no values
        kind, n_dims = struct.unpack_from("bB", section, start)
        if kind == 0 or kind not in TYPE_SIZES or n_dims > 7 or (kind == -1 and n_dims == 0):
            raise ValueError(f"({text}) has the unknown type {kind} or {n_dims} dimensions (1 to 7)")
        shape, start = tuple(section[start + 2 : start + 2 + n_dims]), start + 2 + n_dims
    end = start + TYPE_SIZES[kind] * math.prod(shape)
    for order in (">", "<") if processor == SGI else ("<",):
        # some SGI files, samples of c3d.org among them, hold single pointers in Intel order
        step = struct.unpack_from(f"{order}H", section, step_at)[0]
        # some OptiTrack exports lack the length byte of a description
        described = step != end - step_at
        next_at = end + 1 + section[end] if described else end
        if next_at <= len(section) and (not step or step_at + step == next_at):
            break
    else:
        raise ValueError(f"({text}) is longer or shorter than it states")
    return number, text, Record(kind, shape, section[start:end], processor, step_at, end, next_at)


def _read_points(path: Path, layout: Layout) -> Points:
    # refuse a file without points, or with two different numbers of points
    declared = layout.number("POINT", "USED")
    points_n_points = layout.header_points if declared is None else int(declared) % 65536
    if points_n_points == 0:
        held = "rotation matrices but no points" if layout.number("ROTATION", "USED") else "no points"
        raise MotionError(
            f"{path}: holds {held}; a motion needs the positions of markers or joints. "
            "Export marker positions from the program that recorded it."
        )
    if points_n_points != layout.header_points:
        raise ValueError(f"its header declares {layout.header_points} points, its parameters {points_n_points}")
    analog, n_frames = _resolve_layout(layout)
    position = _decode_points(path, layout, analog, n_frames)
    notes = []
    if n_frames > MAX_HEADER_FRAMES:
        # without the empty frames at the end that fill the last block
        seen = np.flatnonzero(np.isfinite(position).any(axis=(1, 2)))
        position = position[: seen[-1] + 1] if seen.size else position
        notes.append(f"the header counts only to {MAX_HEADER_FRAMES} frames; the size of the file gave their number")
    elif layout.number("POINT", "USED") is None or analog != layout.count_declared_analog():
        notes.append("frames were read by the layout of the header, because the parameters do not describe it")
    if n_frames < layout.header_frames:
        notes += note_frames(path, str(layout.header_frames), n_frames)
    texts = {f"{group}:{name}": record.texts() for (group, name), record in layout.records.items() if record.kind == -1}
    n_points = position.shape[1]
    labels = [label for n in ("", *range(2, 12)) for label in texts.get(f"POINT:LABELS{n}", ())]
    # one unit for all points, or one for each
    units = texts.get("POINT:UNITS", ())
    usual = next(filter(None, units), "")
    # the axis plotted upwards on the screen; its sign is unreliable in practice
    screen = texts.get("POINT:Y_SCREEN", ())
    subjects = [name for name in texts.get("SUBJECTS:NAMES", ()) if name]
    return Points(
        (labels + [""] * n_points)[:n_points],
        position,
        unit=usual,
        each=[[unit or usual] for unit in units] if usual and len(units) == n_points > 1 else None,
        rate_hz=float(layout.number("POINT", "RATE") or layout.header_rate_hz),
        declared_up=screen[0].strip("+- ").lower()[:1] if screen else "",
        subject=subjects[0] if len(subjects) == 1 else "",
        texts=texts,
        notes=notes,
    )


def _resolve_layout(layout: Layout) -> tuple[int, int]:
    """Find analog words per frame and number of frames. Together they fill the data section."""
    frames, points = layout.header_frames, layout.header_points
    if frames < 1:
        raise ValueError(f"its header declares {frames} frames")
    candidates = list(dict.fromkeys((int(layout.count_declared_analog()), layout.header_analog)))
    n_bytes = layout.size - layout.data_at
    tight = [w for w in candidates if 0 <= n_bytes - frames * layout.count_bytes(points, w) <= BLOCK]
    if len(tight) == 1:
        return tight[0], frames
    held = n_bytes // layout.count_bytes(points, candidates[0])
    if len(candidates) == 1 and held >= 1:
        # the header counts only to 65535; beyond that, the size of the file is used
        return candidates[0], held if frames >= MAX_HEADER_FRAMES else min(frames, held)
    raise ValueError(
        f"header and parameters declare {layout.header_analog} and {candidates[0]} analog values per frame; "
        f"{frames} frames of {points} points fit the file with neither"
    )


def _decode_points(path: Path, layout: Layout, analog: int, n_frames: int) -> FloatArray:
    """Decode the positions (T, P, 3), NaN for gaps. They are in the units of the file."""
    width = 4 * layout.header_points + analog
    order, scale = ">" if layout.processor == SGI else "<", 1.0
    if not layout.is_float:
        stored = np.dtype(f"{order}i2")
        scale = abs(layout.number("POINT", "SCALE") or layout.header_scale)
        if not math.isclose(scale, abs(layout.header_scale), rel_tol=1e-3):
            raise ValueError(
                f"stores integers that its header scales by {abs(layout.header_scale):.6g}, its parameters by "
                f"{scale:.6g}"
            )
    else:
        stored = np.dtype(f"{order}u4" if layout.processor == DEC else f"{order}f4")
    words = np.fromfile(path, dtype=stored, count=n_frames * width, offset=layout.data_at).reshape(n_frames, width)
    words = words[:, : 4 * layout.header_points]
    if layout.is_float and layout.processor == DEC:
        words = ((words >> 16) | (words << 16)).view("<f4") / np.float32(4)
    samples = words.reshape(n_frames, layout.header_points, 4)
    position = samples[:, :, :3].astype(np.float64)
    position *= scale
    # a negative fourth word means not seen; several systems write exactly 0, 0, 0 instead, where no marker can be
    lost = ~(samples[:, :, 3] >= 0) | ~np.isfinite(position).all(axis=2) | (position == 0.0).all(axis=2)
    position[lost | (np.abs(position) > LARGEST).any(axis=2)] = np.nan
    return position


def sniff_c3d(path: Path, head: bytes) -> bool:
    """Return True if a file starts like C3D."""
    # the first bytes are the block number of the parameters and 0x50, and the rest is not text
    return len(head) >= 2 and head[0] >= 1 and head[1] == MAGIC and b"\0" in head[:512]


@point_format("c3d", sniff_c3d, (".c3d",))
def parse_c3d(path: Path) -> Points:
    """Read the points of a C3D file."""
    try:
        return _read_points(path, read_layout(path))
    except (ValueError, MemoryError) as error:
        raise MotionError(f"{path}: {error or 'does not fit into memory; is it damaged?'}. {RESAVE}.") from None
