"""What a C3D file declares about itself, checked record by record before the C3D library sees the file.

The library is native code that trusts the parameter section: one wrong length byte can end the whole process, and a
truncated file can keep it busy for ever. So header and section are walked here first, and only a file whose records
fit exactly into each other and whose declared samples fit into the file is handed on.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from pathlib import Path

from doppelgait.core.errors import MotionError

BLOCK = 512
MAGIC = 0x50
INTEL, DEC, SGI = 84, 85, 86
MAX_SIZE = 2**31
TYPE_SIZES = {0: 0, -1: 1, 1: 1, 2: 2, 4: 4}
RESAVE = "Open it in the program that recorded it, or in a C3D editor, and export it again"

NUMBERS = tuple(
    (group, name)
    for group in ("POINT", "ANALOG", "ROTATION", "FORCE_PLATFORM")
    for name in ("USED", "RATE", "SCALE", "GEN_SCALE", "FRAMES", "DATA_START", "RATIO")
    if (group, name) != ("ANALOG", "SCALE")
)
"""Parameters whose first value the library takes without a look at how many there are."""


@dataclass(frozen=True)
class Span:
    """Where in the section a record stands: its start, its pointer to the next, the end of its values, the next."""

    start: int
    step: int
    end: int
    next: int

    @property
    def is_readable(self) -> bool:
        """Whether ezc3d can read its description: a length byte and at most 127 characters."""
        return 1 <= self.next - self.end <= 128


@dataclass(frozen=True)
class Record:
    """One parameter: its type (-1 text, 1 or 2 integer, 4 float), dimensions, values and place."""

    kind: int
    shape: tuple[int, ...]
    raw: bytes
    processor: int
    span: Span

    def count(self) -> int:
        """How many values the parameter holds; texts of one length count as rows."""
        return math.prod(self.shape[1:] if self.kind == -1 else self.shape)

    def number(self) -> float | None:
        """First value as a number, None for text and for an empty parameter."""
        if self.kind == -1 or len(self.raw) < abs(self.kind):
            return None
        if self.kind == 4:
            return float32(self.raw, self.processor)
        return float(int.from_bytes(self.raw[: self.kind], "little", signed=True))


@dataclass(frozen=True)
class Layout:
    """Counts and places that header and parameters of a C3D file declare; ``analog`` is in words per frame."""

    size: int
    section_at: int
    data_at: int
    processor: int
    is_float: bool
    header_points: int
    header_frames: int
    header_analog: int
    header_rate_hz: float
    records: dict[tuple[str, str], Record]
    spans: tuple[Span, ...]

    def number(self, group: str, name: str) -> float | None:
        """Number in a parameter, None when it is absent or holds text."""
        record = self.records.get((group, name))
        return record.number() if record else None

    def count(self, group: str, name: str) -> int:
        """How many values a parameter holds, 0 when it is absent."""
        record = self.records.get((group, name))
        return record.count() if record else 0

    def _per_frame(self, group: str) -> float:
        """Samples per point frame of a group, from its own rate."""
        point_rate = self.number("POINT", "RATE") or self.header_rate_hz
        return round((self.number(group, "RATE") or 0.0) / point_rate) if point_rate > 1e-3 else 0.0

    def declared_analog(self) -> float:
        """Analog words per frame as the parameters have it: channels times samples per frame."""
        return (self.number("ANALOG", "USED") or 0.0) * self._per_frame("ANALOG")

    def declared_rotations(self) -> float:
        """Rotation matrices per frame."""
        ratio = self.number("ROTATION", "RATIO")
        return max(self.number("ROTATION", "USED") or 0.0, 1.0) * (
            self._per_frame("ROTATION") if ratio is None else ratio
        )

    def frames_that_fit(self, points: int, analog: int) -> float:
        """How many frames of that many points and analog words the data section can hold."""
        stride = (4 * points + analog) * (4 if self.is_float else 2)
        return (self.size - self.data_at) / stride if stride else math.inf

    def is_tight(self, frames: int, points: int, analog: int) -> bool:
        """Whether that many frames fill the data section but for the padding of its last block."""
        stride = (4 * points + analog) * (4 if self.is_float else 2)
        return 0 <= self.size - self.data_at - frames * stride <= BLOCK


def float32(raw: bytes, processor: int) -> float:
    """One stored 32-bit float; DEC keeps its two words swapped and its exponent two higher than IEEE."""
    if processor == DEC:
        return float(struct.unpack("<f", raw[2:4] + raw[0:2])[0]) / 4.0
    return float(struct.unpack("<f", raw[:4])[0])


def read_layout(path: Path) -> Layout:
    """Check header and parameter section of a C3D file.

    Parameters
    ----------
    path : Path
        An existing file.

    Raises
    ------
    MotionError
        If the file is truncated, damaged or in a byte order that cannot be read.
    """
    size = path.stat().st_size
    if size > MAX_SIZE:
        raise MotionError(f"{path}: has {size} bytes; C3D files of up to {MAX_SIZE} bytes are read")
    with path.open("rb") as file:
        header = file.read(BLOCK)
        if len(header) < BLOCK or header[0] < 2 or header[1] != MAGIC:
            raise MotionError(
                f"{path}: is no complete C3D file: it must start with a header of {BLOCK} bytes whose second is "
                f"0x50. {RESAVE}."
            )
        section_at = (header[0] - 1) * BLOCK
        file.seek(section_at)
        processor = file.read(4)[3:4]
        _check_processor(path, processor, size)
        points, analog, first, last, _, scale, data_block, _ = struct.unpack_from("<HHHHH4sHH", header, 2)
        data_at = (data_block - 1) * BLOCK
        if not 0 < section_at < data_at <= size:
            raise MotionError(
                f"{path}: is truncated or damaged: its header puts the parameters at byte {section_at} and the data "
                f"at byte {data_at}, the file has {size} bytes. {RESAVE}."
            )
        file.seek(section_at)
        section = file.read(data_at - section_at)
    records, spans = _walk(path, section, section_at, processor[0])
    layout = Layout(
        size=size,
        section_at=section_at,
        data_at=data_at,
        processor=processor[0],
        is_float=float32(scale, processor[0]) < 0,
        header_points=points,
        header_frames=last - first + 1,
        header_analog=analog,
        header_rate_hz=float32(header[20:24], processor[0]),
        records=records,
        spans=spans,
    )
    _check_tables(path, layout)
    return layout


def _check_processor(path: Path, processor: bytes, size: int) -> None:
    if processor and processor[0] == SGI:
        raise MotionError(
            f"{path}: holds numbers in SGI/MIPS (big-endian) byte order, which is not read; allowed are Intel and DEC. "
            f"{RESAVE} for Intel (PC)."
        )
    if not processor or processor[0] not in (INTEL, DEC):
        found = processor[0] if processor else "nothing"
        raise MotionError(
            f"{path}: is truncated or damaged: the byte that names the processor is {found} (allowed: {INTEL} Intel, "
            f"{DEC} DEC; {size} bytes). {RESAVE}."
        )


def _check_tables(path: Path, layout: Layout) -> None:
    """Refuse tables that are shorter than their count, and counts beyond the file: the library runs off their end."""
    for name in NUMBERS:
        value = layout.number(*name)
        if name in layout.records and (value is None or not abs(value) < 1e6 or (name[1] == "RATE" and value < 0)):
            raise MotionError(
                f"{path}: has a damaged parameter section: {':'.join(name)} is {value}, no usable number. {RESAVE}."
            )
    channels = min(layout.number("ANALOG", "USED") or 0, 255)
    if channels > 0 and layout.number("ANALOG", "RATE"):
        for key in ("SCALE", "OFFSET"):
            if layout.count("ANALOG", key) < channels:
                raise MotionError(
                    f"{path}: has a damaged parameter section: ANALOG:{key} holds {layout.count('ANALOG', key)} "
                    f"values for {channels:.0f} channels. {RESAVE}."
                )
    extra = layout.declared_analog() + 17 * layout.declared_rotations()
    if not 0 <= extra * 2 <= max(layout.size - layout.data_at, 0):
        raise MotionError(
            f"{path}: is truncated or damaged: its parameters declare {extra:.0f} analog and rotation values per "
            f"frame, more than the file holds. {RESAVE}."
        )


def _walk(
    path: Path, section: bytes, section_at: int, processor: int
) -> tuple[dict[tuple[str, str], Record], tuple[Span, ...]]:
    """All parameters by (group, name), upper case, and all records; a record that does not fit is an error."""
    groups: dict[int, str] = {}
    found: list[tuple[int, str, Record]] = []
    spans: list[Span] = []
    at = 4
    # "no parameters at all" is declared by a section of zero blocks
    while section[2] and at < len(section) and section[at]:
        try:
            spans.append(_read_record(section, at, processor, groups, found))
        except (ValueError, IndexError, struct.error) as error:
            fault = str(error) if type(error) is ValueError else "runs beyond the end of the section"
            raise MotionError(
                f"{path}: has a damaged parameter section: the record at byte {section_at + at} {fault}. {RESAVE}."
            ) from None
        at = spans[-1].next
        if section[spans[-1].step : spans[-1].step + 2] == b"\0\0":
            break
    return {(groups.get(number, ""), name): record for number, name, record in found}, tuple(spans)


def _read_record(
    section: bytes, at: int, processor: int, groups: dict[int, str], found: list[tuple[int, str, Record]]
) -> Span:
    """Read one group or parameter."""
    length, number = struct.unpack_from("bb", section, at)
    step_at = at + 2 + abs(length)
    name = section[at + 2 : step_at]
    if number == 0 or any(byte < 32 for byte in name):
        raise ValueError("has no name or belongs to no group")
    text = name.decode("latin-1").strip().upper()
    step = struct.unpack_from("<H", section, step_at)[0]
    kind, shape, start = (0, (), step_at + 2) if number < 0 else _read_shape(section, step_at + 2, text)
    end = start + TYPE_SIZES[kind] * math.prod(shape)
    # some OptiTrack exports lack the length byte of a description
    described = step != end - step_at
    next_at = end + 1 + section[end] if described else end
    if next_at > len(section) or (step and step_at + step != next_at):
        raise ValueError(f"({text}) is longer or shorter than it says")
    span = Span(at, step_at, end, next_at)
    if number < 0:
        groups[-number] = text
    else:
        found.append((number, text, Record(kind, shape, section[start:end], processor, span)))
    return span


def _read_shape(section: bytes, at: int, text: str) -> tuple[int, tuple[int, ...], int]:
    """Type, dimensions and place of the values of a parameter."""
    kind, n_dims = struct.unpack_from("bB", section, at)
    if kind == 0 or kind not in TYPE_SIZES or n_dims > 7 or (kind == -1 and n_dims == 0):
        raise ValueError(f"({text}) has the unknown type {kind} or {n_dims} dimensions (1 to 7)")
    start = at + 2 + n_dims
    return kind, tuple(section[at + 2 : start]), start


def without_descriptions(section: bytes, spans: tuple[Span, ...]) -> bytes:
    """The same parameter section, each record with an empty description; as long as before.

    Raises
    ------
    ValueError
        If it does not fit.
    """
    records = [
        section[s.start : s.step] + struct.pack("<H", s.end - s.step + 1) + section[s.step + 2 : s.end] + b"\0"
        for s in spans
    ]
    shorter = section[:4] + b"".join(records)
    if len(shorter) > len(section):
        raise ValueError("no room for empty descriptions")
    return shorter.ljust(len(section), b"\0")
