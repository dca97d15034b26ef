"""Records of XeThru data files: what each type holds, as structured NumPy types, and how a file is cut into them.

All records are little endian, follow each other without padding, and say themselves how many values they hold.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import RecordingError

Field = tuple[str, str]

_APPLICATION: tuple[Field, ...] = (("content_id", "<u4"), ("info", "<u4"), ("count", "<u4"))
_PROFILE: tuple[Field, ...] = (
    ("frame_counter", "<u4"), ("count", "<u4"), ("bin_length_m", "<f4"), ("sample_rate_hz", "<f4"),
    ("carrier_hz", "<f4"), ("range_start_m", "<f4"),
)  # fmt: skip
_RADAR: tuple[Field, ...] = (*_PROFILE[:5], ("frame_rate_hz", "<f4"), ("range_start_m", "<f4"))
_BASEBAND: tuple[Field, ...] = (
    *_RADAR, ("decimation", "<u4"), ("correction_bin", "<u4"), ("correction_i", "<f4"), ("correction_q", "<f4"),
)  # fmt: skip
_MATRIX: tuple[Field, ...] = (
    ("frame_counter", "<u4"), ("matrix_counter", "<u4"), ("range_index", "<u4"), ("range_bins", "<u4"),
    ("count", "<u4"), ("instance", "<u4"),
)  # fmt: skip
_RATES: tuple[Field, ...] = (
    ("frame_rate_hz", "<f4"), ("frame_rate_decimated_hz", "<f4"), ("frequency_start_hz", "<f4"),
    ("frequency_step_hz", "<f4"), ("range_m", "<f4"),
)  # fmt: skip
_STEPS: tuple[Field, ...] = (("level_start_db", "<f4"), ("level_step_db", "<f4"))


@dataclass(frozen=True)
class DataType:
    """One data type of a XeThru recording.

    Parameters
    ----------
    name : str
        Without the prefix ``xethru_`` that its files carry.
    bit : int
        Number of its bit in the meta file, 0 to 22.
    header : tuple of (field, NumPy type)
        Fixed part of a record; the field ``count`` says how many values follow. Empty where the layout is not known.
    payload : tuple of (field, NumPy type)
        What follows: one array of ``count`` values for each.
    text : bool
        The files are semicolon-separated text (``.csv``).
    """

    name: str
    bit: int
    header: tuple[Field, ...] = ()
    payload: tuple[Field, ...] = ()
    text: bool = False

    @property
    def mask(self) -> int:
        """Its bit as the meta file writes it."""
        return 1 << self.bit

    @property
    def suffix(self) -> str:
        """Ending of its files."""
        return ".csv" if self.text else ".dat"

    @property
    def base_name(self) -> str:
        """First part of the names of its files."""
        return f"xethru_{self.name}"


_TYPES = (
    DataType("baseband_ap", 0, _PROFILE, (("amplitude", "<f4"), ("phase_rad", "<f4"))),
    DataType("baseband_iq", 1, _PROFILE, (("i", "<f4"), ("q", "<f4"))),
    DataType("sleep", 2, text=True),
    DataType("respiration", 3),
    DataType("perf", 4),
    DataType("datastring", 5, text=True),
    DataType("pulsedoppler_float", 6, (*_MATRIX, *_RATES), (("power", "<f4"),)),
    DataType("pulsedoppler_byte", 7, (*_MATRIX, *_STEPS, *_RATES), (("level", "u1"),)),
    DataType("noisemap_float", 8, (*_MATRIX, *_RATES), (("power", "<f4"),)),
    DataType("noisemap_byte", 9, (*_MATRIX, *_STEPS, *_RATES), (("level", "u1"),)),
    DataType("datafloat", 10, _APPLICATION, (("values", "<f4"),)),
    DataType("databyte", 11, _APPLICATION, (("values", "u1"),)),
    DataType("presence_single", 12),
    DataType("presence_movinglist", 13),
    DataType("respiration_detectionlist", 14),
    DataType("respiration_movinglist", 15),
    DataType("vitalsigns", 16),
    DataType("sleepstage", 17),
    DataType("respiration_normalizedmovementlist", 18),
    DataType("radar_rf", 19, _RADAR, (("counts", "<u4"),)),
    DataType("radar_rf_normalized", 20, _RADAR, (("values", "<f4"),)),
    DataType("radar_baseband_float", 21, _BASEBAND, (("i", "<f4"), ("q", "<f4"))),
    DataType("radar_baseband_q15", 22, (*_BASEBAND, ("scale", "<f4")), (("i", "<i2"), ("q", "<i2"))),
)
DATA_TYPES: dict[str, DataType] = {entry.name: entry for entry in _TYPES}
"""Data types by name."""
_BY_MASK = {entry.mask: entry for entry in _TYPES}


def data_type(name: str) -> DataType:
    """Data type by its name; an unknown one is a :class:`RecordingError` that lists them."""
    if name not in DATA_TYPES:
        raise RecordingError(f"unknown XeThru data type {name!r}; known are: {', '.join(DATA_TYPES)}")
    return DATA_TYPES[name]


def data_type_of_mask(mask: int) -> DataType | None:
    """Data type by its bit mask, None if there is no such type."""
    return _BY_MASK.get(mask)


def data_type_of_file(file_name: str) -> DataType | None:
    """Data type that the name of a data file tells, None if it is no such name."""
    for entry in sorted(_TYPES, key=lambda one: -len(one.name)):
        if file_name.startswith(entry.base_name + "_") and file_name.endswith(entry.suffix):
            return entry
    return None


def record_dtype(kind: DataType, *, count: int) -> np.dtype[np.void]:
    """Structured type of a record with ``count`` values in each of its arrays.

    Raises
    ------
    RecordingError
        If the layout of this type is not known.
    """
    if not kind.header:
        raise RecordingError(
            f"records of the XeThru data type {kind.name} have no layout that is known; read its bytes"
        )
    return np.dtype([*kind.header, *((name, code, (count,)) for name, code in kind.payload)])


def record_bytes(kind: DataType, *, count: int) -> int:
    """Length of a record with ``count`` values, without building its type (a damaged count can be absurd)."""
    head = np.dtype(list(kind.header)).itemsize
    return head + count * sum(np.dtype(code).itemsize for _, code in kind.payload)


def make_records(name: str, **fields: Any) -> npt.NDArray[np.void]:
    """Records of one type from their fields; ``count`` follows from the arrays.

    Parameters
    ----------
    name : str
        Data type.
    **fields
        One value per field, or one per record: scalars or shape (n,) for the header, shape (n, count) or (count,) for
        the arrays.

    Returns
    -------
    ndarray, shape (n,)
        Structured array; ``records.tobytes()`` is what a data file holds.

    Raises
    ------
    RecordingError
        If a field is missing or unknown, or the arrays do not fit each other.
    """
    kind = data_type(name)
    names = {field for field, _ in (*kind.header, *kind.payload)} - {"count"}
    if wrong := sorted(names ^ set(fields)):
        raise RecordingError(
            f"records of {name}: the fields are {', '.join(sorted(names))}; wrong are {', '.join(wrong)}"
        )
    arrays = {field: np.atleast_2d(np.asarray(fields[field])) for field, _ in kind.payload}
    counts = {array.shape[1] for array in arrays.values()}
    lengths = {array.shape[0] for array in arrays.values()} | {np.size(fields[f]) for f in names - set(arrays)}
    if len(counts) > 1 or len(lengths - {1}) > 1:
        raise RecordingError(
            f"records of {name}: the arrays have different lengths {sorted(counts)}, {sorted(lengths)}"
        )
    count = counts.pop()
    records = np.zeros(max(lengths), dtype=record_dtype(kind, count=count))
    records["count"] = count
    for field in names:
        records[field] = arrays.get(field, fields[field])
    return records


def parse_records(content: bytes | memoryview, kind: DataType) -> tuple[list[npt.NDArray[np.void]], int]:
    """Cut the content of a data file into records.

    Neighbours of one size come as one array that shares the memory of ``content``, whatever their number.

    Parameters
    ----------
    content : bytes
        Records, one after the other.
    kind : DataType

    Returns
    -------
    blocks : list of ndarray
        Structured arrays in the order of the file.
    used : int
        Bytes that they take; less than the length of ``content`` if it ends in, or holds, something that is no record.
    """
    blocks, offset = [], 0
    while (found := _next_block(content, kind, offset)) is not None:
        blocks.append(found)
        offset += found.nbytes
    return blocks, offset


def _next_block(content: bytes | memoryview, kind: DataType, offset: int) -> npt.NDArray[np.void] | None:
    """As many records from ``offset`` on as have the size of the first; None if there is no whole one."""
    head = np.dtype(list(kind.header))
    left = len(content) - offset
    if left < head.itemsize:
        return None
    count = int(np.frombuffer(content, head, 1, offset)["count"][0])
    size = record_bytes(kind, count=count)
    if size > left:
        return None
    at = head.fields["count"][1] if head.fields else 0
    whole, same = left // size, 1
    while same < whole:
        ahead = min(2 * same, whole) - same
        counts = np.ndarray(ahead, "<u4", content, offset + same * size + at, (size,))
        different = np.flatnonzero(counts != count)
        if different.size:
            same += int(different[0])
            break
        same += ahead
    return np.frombuffer(content, record_dtype(kind, count=count), same, offset)


def iterate(blocks: list[npt.NDArray[np.void]]) -> Iterator[np.void]:
    """Every record of the blocks, in order."""
    for block in blocks:
        yield from block
