"""MATLAB files: X4 RF frames, down-converted, and complex samples.

Some damaged files of versions 5 to 7 crash SciPy's reader (segmentation fault). This module therefore reads numeric
matrices itself and checks all lengths. The layout is described in "MAT-File Format", The MathWorks, level 5.
"""

from __future__ import annotations

import math
import re
import struct
import zlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from doppelgait.core.documents import check_cost
from doppelgait.core.errors import RecordingError
from doppelgait.core.own_hdf5 import open_hdf5
from doppelgait.core.units import slow_time_axis_s
from doppelgait.radar.measured import check_finite, check_number, check_shape, label_measured
from doppelgait.radar.readers.arrays import NAMES, Parsed, array_reader
from doppelgait.radar.recording import Recording

HEADER_BYTES = 128
MATRIX_ELEMENT, COMPRESSED_ELEMENT = 14, 15
CLASSES = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"}
"""NumPy types by class of matrix; cells, structures, text and sparse matrices are not read."""
STORED = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
"""NumPy types by type of data element; small integers may be stored in a shorter type than their class."""
COMPLEX_FLAG = 0x0800
FRONT_BYTES = 4096
"""Number of bytes that contain the flags, shape and name of a matrix."""


class Held(NamedTuple):
    """Variable of a file: shape, whether it is complex (None for text, cells, ...), and how to load it."""

    shape: tuple[int, ...]
    is_complex: bool | None
    load: Callable[[], npt.NDArray[Any]]
    packed_bytes: int = 0


@dataclass(frozen=True)
class Variable:
    """A variable of versions 5 to 7, not loaded."""

    name: str
    shape: tuple[int, ...]
    kind: int
    is_complex: bool
    packed: memoryview
    is_packed: bool
    n_bytes: int
    data_at: int
    order: str


def list_variables(path: Path, *, max_bytes: int) -> dict[str, Held]:
    """List the variables of a file by name. The file is read, but no variable is unpacked."""
    if path.stat().st_size > max_bytes:
        raise ValueError(f"the file has {path.stat().st_size:,} bytes; up to {max_bytes:,} are read")
    content = memoryview(path.read_bytes())
    marks = {b"IM": "<", b"MI": ">"}
    if len(content) < HEADER_BYTES or (mark := bytes(content[126:128])) not in marks:
        raise ValueError("the header of 128 bytes is incomplete")
    found: dict[str, Held] = {}
    at = HEADER_BYTES
    while at < len(content):
        kind, n_bytes = _unpack(content, at, f"{marks[mark]}II")
        body = content[at + 8 : at + 8 + n_bytes]
        if kind not in (MATRIX_ELEMENT, COMPRESSED_ELEMENT) or len(body) < n_bytes:
            raise ValueError(f"the element at byte {at} is of type {kind} and has {len(body)} of its {n_bytes} bytes")
        # flags, shape and name of the matrix
        is_packed = kind == COMPRESSED_ELEMENT
        order = marks[mark]
        front = zlib.decompressobj().decompress(body, FRONT_BYTES) if is_packed else bytes(body[:FRONT_BYTES])
        whole_bytes, start = len(body), 0
        if is_packed:
            inner, whole_bytes = _unpack(front, 0, f"{order}II")
            start = 8
            if inner != MATRIX_ELEMENT:
                raise ValueError(f"a compressed element holds type {inner}, not a matrix")
        flags, data_at = _read_element(front, start, order)
        sizes, data_at = _read_element(front, data_at, order)
        name, data_at = _read_element(front, data_at, order)
        word = int(_unpack(flags, 0, f"{order}I")[0])
        shape = tuple(int(n) for n in np.frombuffer(sizes, f"{order}i4"))
        if len(shape) < 2 or min(shape) < 0:
            raise ValueError(f"a matrix has the shape {shape}")
        text = bytes(name).decode("latin-1")
        variable = Variable(
            text, shape, word & 0xFF, bool(word & COMPLEX_FLAG), body, is_packed, whole_bytes + start, data_at, order
        )
        is_complex = variable.is_complex if variable.kind in CLASSES else None
        found[text] = Held(shape, is_complex, partial(_load_variable, variable), variable.n_bytes)
        at += 8 + n_bytes
    return found


def _unpack(content: memoryview | bytes, at: int, layout: str) -> tuple[Any, ...]:
    try:
        return struct.unpack_from(layout, content, at)
    except struct.error:
        raise ValueError(f"an element is cut off at byte {at}") from None


def _read_element(content: bytes, at: int, order: str) -> tuple[bytes, int]:
    """Return the bytes of one element, and the next position."""
    kind, n_bytes = _unpack(content, at, f"{order}II")
    if kind >> 16:  # at most 4 bytes, packed into the second word
        n_bytes, start, after = kind >> 16, at + 4, at + 8
    else:
        start, after = at + 8, at + 8 + -(-n_bytes // 8) * 8
    if start + n_bytes > len(content) or (kind >> 16 and n_bytes > 4):
        raise ValueError(f"an element of {n_bytes} bytes is cut off")
    return content[start : start + n_bytes], after


def _load_variable(variable: Variable) -> npt.NDArray[Any]:
    """Load a numeric variable in its class's type."""
    if variable.kind not in CLASSES:
        raise ValueError(f"{variable.name} is of class {variable.kind}, which holds no plain numbers")
    content = bytes(variable.packed)
    if variable.is_packed:
        worst = variable.data_at + 2 * (8 + 8 * math.prod(variable.shape))
        if variable.n_bytes > worst:
            raise ValueError(f"{variable.name} claims {variable.n_bytes} bytes for the shape {variable.shape}")
        unpacker = zlib.decompressobj()
        content = unpacker.decompress(variable.packed, variable.n_bytes)
        rest = unpacker.decompress(unpacker.unconsumed_tail, 1)
        if len(content) < variable.n_bytes or rest or not unpacker.eof:
            raise ValueError(f"{variable.name} unpacks to less or more than its {variable.n_bytes} bytes")
    real, at = _read_numbers(content, variable.data_at, variable)
    if not variable.is_complex:
        return real
    return np.asarray(real + 1j * _read_numbers(content, at, variable)[0])


def _read_numbers(content: bytes, at: int, variable: Variable) -> tuple[npt.NDArray[Any], int]:
    kind = int(_unpack(content, at, f"{variable.order}I")[0])
    data, after = _read_element(content, at, variable.order)
    stored = STORED.get(kind & 0xFFFF)
    if stored is None:
        raise ValueError(f"{variable.name} holds numbers of the unknown type {kind & 0xFFFF}")
    values = np.frombuffer(data, variable.order + stored)
    if values.size != math.prod(variable.shape):
        raise ValueError(f"{variable.name} holds {values.size} numbers for the shape {variable.shape}")
    return values.reshape(variable.shape, order="F").astype(CLASSES[variable.kind]), after


HEADERS = (b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file")
MATRIX = "Data_Matrix"
AXES = ("range_axis", "range_vector")
FACTS = ("actual_fps", "bin_length", "frame_start", "baseband", *AXES)
MAX_VALUES = 1 << 28
"""Maximum number of RF samples: 2 GiB of doubles."""
MAX_BINS = 1_000_000
SMALLEST = 1e-6
"""Exclusive minimum of a rate in Hz or a bin length in m."""
CARRIER_HZ = 7.29e9


def list_matrices(path: Path) -> list[dict[str, Any]]:
    """List a file's frame matrices as reader options; none of a damaged file."""
    try:
        return [{"matrix": name} for name in _find_frame_matrices(_list_held(path))]
    except Exception:  # the libraries raise nearly anything at damaged bytes
        return []


def _list_held(path: Path) -> dict[str, Held]:
    with path.open("rb") as file:
        head = file.read(len(HEADERS[1]))
    if head == HEADERS[1]:
        # version 7.3 is HDF5 with the axes of every matrix reversed
        with open_hdf5(path, soft_links=True) as hdf5:
            sets = {name: hdf5[name] for name in hdf5 if hasattr(hdf5[name], "shape")}
            return {
                name: Held(one.shape[::-1], _is_complex(one), partial(_load_dataset, path, name))
                for name, one in sets.items()
            }
    if head in HEADERS:
        return list_variables(path, max_bytes=8 * MAX_VALUES)
    from scipy.io import loadmat

    check_cost(path, 8 * path.stat().st_size, RecordingError)
    stored = {name: values for name, values in loadmat(path).items() if not name.startswith("__")}
    return {name: Held(one.shape, np.iscomplexobj(one), partial(np.asarray, one)) for name, one in stored.items()}


def _is_complex(dataset: Any) -> bool | None:
    # text is stored as uint16, and only an attribute, which may be damaged, tells it from numbers
    if dataset.dtype.kind not in "fiucV" or dataset.dtype == "u2":
        return None
    return dataset.dtype.names is not None or bool(dataset.dtype.kind == "c")


def _load_dataset(path: Path, name: str) -> npt.NDArray[Any]:
    with open_hdf5(path, soft_links=True) as hdf5:
        values = np.asarray(hdf5[name][()]).T
    return values if values.dtype.names is None else np.asarray(values["real"] + 1j * values["imag"])


def _load(path: Path, held: Mapping[str, Held], names: Iterable[str]) -> dict[str, npt.NDArray[Any]]:
    """Load variables by name; missing ones are left out."""
    loaded = {name: held[name] for name in names if name in held}
    packed = [one for one in loaded.values() if one.packed_bytes]
    check_cost(path, sum(8 * math.prod(one.shape) + one.packed_bytes for one in packed), RecordingError)
    return {name: one.load() for name, one in loaded.items()}


def _find_frame_matrices(shapes: Mapping[str, Any]) -> list[str]:
    return [name for name in shapes if re.fullmatch(rf"{MATRIX}(_\d+)?", name)]


@array_reader(
    "matlab-rf",
    sniff=lambda path, head: head.startswith(HEADERS),
    suffixes=(".mat",),
    by_name=(".mat",),
    parts=list_matrices,
)
def parse_matlab(
    path: Path,
    *,
    matrix: str | None = None,
    filter: Literal["hamming", "chip"] = "hamming",
    time_first: bool = True,
    **options: Any,
) -> Parsed | Recording:
    """Read X4 RF frames (E-17), or complex samples, of a MATLAB file of version 4, 5, 7 or 7.3."""
    content = _read_content(path, matrix)
    if isinstance(content, Parsed):
        return content
    given = {name: value for name, value in options.items() if value is not None}
    if unused := [name for name in ("conjugate", "scale_v") if name in given]:
        raise RecordingError(f"{path}: holds RF frames, which have no {', '.join(unused)}; leave it out")
    carrier_hz = check_number(path, "carrier_hz", given.get("carrier_hz", CARRIER_HZ), above=0.0)
    radar, frames = given.get("radar", "x4"), content[MATRIX]
    rate_hz, spacing_m = (_read_fact(path, content, name, given.get(name)) for name in ("prf_hz", "bin_spacing_m"))
    start_m = given.get("range_start_m")
    for key in (name for name in AXES if name in content and start_m is None):
        axis_m = np.asarray(content[key], dtype=np.float64).ravel()
        wanted = axis_m[:1] + spacing_m * np.arange(frames.shape[1])
        if axis_m.size != wanted.size or not np.allclose(axis_m, wanted, rtol=0.0, atol=0.5 * spacing_m):
            raise RecordingError(
                f"{path}: {key} has {axis_m.size} values that are not the ranges of {wanted.size} bins, "
                f"{spacing_m:g} m apart; give range_start_m=... and bin_spacing_m=..."
            )
        start_m = float(axis_m[0])
    start_m = _read_fact(path, content, "range_start_m", start_m)
    from doppelgait.radar.xethru import downconvert

    facts = {"carrier_hz": carrier_hz, "prf_hz": rate_hz}
    facts |= {"range_start_m": start_m, "bin_spacing_m": spacing_m}
    volts, range_m, made, notes = downconvert.convert_rf_frames(path, frames, facts, filter, radar)
    return label_measured(
        path,
        volts,
        radar=made,
        slow_time_s=slow_time_axis_s(len(volts), rate_hz),
        range_m=range_m,
        notes=[
            f"frames: {content['name']}, real RF samples, down-converted on reading",
            f"carrier_hz = {carrier_hz:g}: not in the file",
            *notes,
        ],
    )


OPTIONS = {"prf_hz": ("actual_fps",), "bin_spacing_m": ("bin_length",), "range_start_m": (*AXES, "frame_start")}
"""Names of the facts of RF frames that an option replaces."""


def _read_fact(path: Path, content: Mapping[str, Any], option: str, value: float | None) -> float:
    above = -1e3 if option == "range_start_m" else SMALLEST
    if value is not None:
        return check_number(path, option, value, above=above, most=1e6)
    for key in (name for name in OPTIONS[option] if name in content):
        stored = content[key]
        number = stored.ravel()[0].item() if stored.size == 1 else stored.tolist()
        return check_number(path, key, number, above=above, most=1e6)
    raise RecordingError(f"{path}: has no {' or '.join(OPTIONS[option])}; give it: {option}=...")


def _read_content(path: Path, matrix: str | None) -> dict[str, Any] | Parsed:
    """Load the frames (``MATRIX``), their name and the facts, or samples at baseband."""
    try:
        held = _list_held(path)
        name = _pick(path, held, matrix)
        is_frames = name in _find_frame_matrices(held) or (matrix is not None and min(held[name].shape) > 1)
        if held[name].is_complex or not is_frames:
            return _parse_baseband(path, held, name)
        for fact in (fact for fact in FACTS if fact in held):  # short, before they are loaded
            size, most = math.prod(held[fact].shape), MAX_BINS if fact in AXES else 1
            if not 1 <= size <= most:
                raise RecordingError(f"{path}: {fact} has {size:,} values; allowed are 1 to {most:,}")
        content: dict[str, Any] = _load(path, held, (name, *FACTS))
        content |= {MATRIX: content.pop(name), "name": name}
    except RecordingError:
        raise
    except Exception as error:  # the libraries raise nearly anything at damaged bytes
        reason = " ".join(str(error).split()) or type(error).__name__
        raise RecordingError(f"{path}: is a damaged or unusual MATLAB file ({reason}); save it again") from None
    frames = content[MATRIX]
    if frames.ndim != 2 or frames.dtype.kind not in "fiu":
        raise RecordingError(
            f"{path}: {content['name']} holds {frames.dtype} values of shape {frames.shape}; RF frames are a matrix of "
            "real numbers (frames, bins), samples at baseband are complex"
        )
    for fact in (fact for fact in FACTS if fact in content and content[fact].dtype.kind not in "fiub"):
        raise RecordingError(f"{path}: {fact} holds {content[fact].dtype} values; it must hold real numbers")
    check_shape(path, frames)
    check_finite(path, frames)
    if np.any(np.asarray(content.get("baseband", 0)) != 0):
        raise RecordingError(f"{path}: states baseband = 1, but RF frames are read; save baseband as .npz ('arrays')")
    content[MATRIX] = np.asarray(frames, dtype=np.float64)
    return content


USUAL = NAMES["matlab"]
BASEBAND_FACTS = {name for names in USUAL.values() for name in names}


def _parse_baseband(path: Path, held: Mapping[str, Held], name: str) -> Parsed:
    """Load complex samples, or I and Q, or one real output, and facts of the usual names where there is one."""
    pair = [one for one in held if one.lower() == "q"] if name.lower() == "i" else []
    facts = [one for one in held if one.lower() in BASEBAND_FACTS and one != name]
    loaded = _load(path, held, (name, *pair, *facts))
    values = [np.squeeze(loaded[one]) for one in (name, *pair)]
    joined = values[0] if not pair else np.stack(values, axis=-1)
    axes: dict[str, Any] = {}
    stated: dict[str, Any] = {}
    rates = USUAL["rates"] + (USUAL["sample_rates"] if values[0].ndim == 1 else [])
    groups = {"prf_hz": rates, "carrier_hz": USUAL["carriers"]}
    for key, names in groups.items():
        numbers = {
            float(loaded[one].real.ravel()[0]) for one in facts if one.lower() in names and loaded[one].size == 1
        }
        stated |= {key: numbers.pop()} if len(numbers) == 1 else {}
    for along, key in enumerate(("slow_time_s", "range_m")):
        sizes = values[0].shape[along : along + 1]
        matches = [one for one in facts if one.lower() in USUAL[key] and sizes == (loaded[one].size,) and sizes != (1,)]
        axes |= {key: loaded[matches[0]].ravel()} if len(matches) == 1 else {}
    if "slow_time_s" in axes:
        stated.pop("prf_hz", None)
    used = ", ".join([name, *pair, *(f"{key} = {value:g}" for key, value in stated.items()), *axes])
    return Parsed(joined, axes, stated, [f"variables: {used}"])


def _pick(path: Path, held: Mapping[str, Held], wanted: str | None) -> str:
    """Return the name of the samples: RF frames, the only complex variable, I of I and Q, or the only vector."""
    if wanted is not None and wanted not in held:
        raise RecordingError(f"{path}: has no matrix {wanted!r}; it holds {', '.join(held) or 'nothing'}")
    frames = _find_frame_matrices(held)
    large = {name: one for name, one in held.items() if one.is_complex is not None and math.prod(one.shape) > 1}
    in_phase = [name for name in large if name.lower() == "i" and {"q", "Q"} & set(large)]
    others = [name for name in large if name.lower() not in BASEBAND_FACTS and name not in FACTS]
    vectors = [name for name in others if min(held[name].shape, default=1) == 1]
    candidates = frames or [name for name in large if large[name].is_complex] or in_phase or vectors
    if wanted is None and len(candidates) != 1:
        fault = f"holds {' and '.join(frames)}" if frames else f"has no {MATRIX} and not one complex variable"
        listed = "" if frames else f"; it holds {', '.join(held) or 'nothing'}"
        raise RecordingError(f"{path}: {fault}{listed}; give matrix='{(candidates or ['NAME'])[0]}' for the samples")
    name = candidates[0] if wanted is None else wanted
    if (size := math.prod(held[name].shape)) > MAX_VALUES:
        raise RecordingError(f"{path}: {name} has {size:,} values; up to {MAX_VALUES:,} are read. Save a part of it.")
    return name
