"""The two files of a SigMF recording: metadata and samples."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.documents import parse_json
from doppelgait.core.errors import RecordingError, warn_caller

META = ".sigmf-meta"
DATA = ".sigmf-data"
HEAD_BYTES = 4096
MAX_META_BYTES = 2**28
DATATYPES = {
    "f32": "f4",
    "f64": "f8",
    "i32": "i4",
    "i16": "i2",
    "i8": "i1",
    "u32": "u4",
    "u16": "u2",
    "u8": "u1",
}
"""NumPy types by SigMF number type."""
MAX_NOTE_LABELS = 20


@dataclass(frozen=True)
class Metadata:
    """Metadata of a recording."""

    data_path: Path
    common: dict[str, Any]
    captures: list[dict[str, Any]]
    annotations: list[dict[str, Any]]
    number: np.dtype[Any]
    n_channels: int
    sample_rate_hz: float | None

    @property
    def own(self) -> dict[str, Any] | None:
        """Keys of doppelgait; None in a file of other software."""
        found = {key: value for key, value in self.common.items() if key.startswith("doppelgait:")}
        return found if "doppelgait:radar" in found else None

    @property
    def scale_v(self) -> Any:
        """Volts of one unit of the samples.
        It is the stated value, otherwise 1 V corresponds to the largest integer or to 1.
        """
        largest = float(2 ** (8 * self.number.itemsize - 1)) if self.number.kind in "iu" else 1.0
        return self.common.get("doppelgait:scale_v", 1.0 / largest)

    def notes(self) -> list[str]:
        """Return the labels of the annotations as a note."""
        labels = [str(one["core:label"])[:80] for one in self.annotations if "core:label" in one]
        shown = list(dict.fromkeys(labels))[:MAX_NOTE_LABELS]
        return [f"annotated: {', '.join(shown)}"] if shown else []


def find_sigmf_pair(path: Path) -> tuple[Path, Path]:
    """Return the paths of metadata and samples from either."""
    stem = path.name.removesuffix(META).removesuffix(DATA)
    return path.with_name(stem + META), path.with_name(stem + DATA)


def read_metadata(path: Path) -> Metadata:
    """Read the metadata of a recording, from either file."""
    meta_path, data_path = find_sigmf_pair(path)
    if path.name.endswith(".sigmf"):
        raise RecordingError(
            f"{path}: SigMF archives are not read; unpack it (it is a tar file) and pass the .sigmf-meta"
        )
    if not meta_path.is_file():
        raise RecordingError(f"{meta_path}: no such file; a SigMF recording is a pair NAME{META} and NAME{DATA}")
    if meta_path.stat().st_size > MAX_META_BYTES:
        raise RecordingError(
            f"{meta_path}: has {meta_path.stat().st_size:,} bytes, at most {MAX_META_BYTES:,} are read"
        )
    try:
        content = parse_json(meta_path.read_text(encoding="utf-8"))
        common, captures, annotations = (content[key] for key in ("global", "captures", "annotations"))
        return _parse_metadata(meta_path, data_path, dict(common), _list_objects(captures), _list_objects(annotations))
    except OSError as error:
        raise RecordingError(f"{meta_path}: cannot be read: {error.strerror or error}") from None
    except (ValueError, LookupError, TypeError) as error:
        raise RecordingError(f"{meta_path}: is damaged or no SigMF metadata: {error}") from None


def _list_objects(values: Any) -> list[dict[str, Any]]:
    if not isinstance(values, list) or not all(isinstance(value, dict) for value in values):
        raise ValueError("captures and annotations must be lists of objects")
    return values


def _parse_metadata(
    meta_path: Path,
    data_path: Path,
    common: dict[str, Any],
    captures: list[dict[str, Any]],
    annotations: list[dict[str, Any]],
) -> Metadata:
    version = str(common["core:version"]).removeprefix("v")
    if not version.startswith("1."):
        raise RecordingError(f"{meta_path}: is SigMF {version}; only 1.x is read")
    if "core:dataset" in common:
        # the samples are in a file with another name, which must be in the folder of the metadata
        name = str(common["core:dataset"])
        if not name or Path(name).name != name or "\\" in name or "\0" in name:
            raise RecordingError(
                f"{meta_path}: core:dataset is {name!r}; it must be the name of a file in the same folder"
            )
        data_path = meta_path.with_name(name)
    if common.get("core:trailing_bytes") or any(one.get("core:header_bytes") for one in captures):
        raise RecordingError(f"{meta_path}: its samples stand among other bytes (core:header_bytes), which is not read")
    channels = common.get("core:num_channels", 1)
    if isinstance(channels, bool) or not isinstance(channels, int) or not 1 <= channels <= 10_000:
        raise ValueError(f"core:num_channels is {channels!r}, must be 1 or more")
    rate = common.get("core:sample_rate")
    if rate is not None and (isinstance(rate, bool) or not 0 < float(rate) < math.inf):
        raise ValueError(f"core:sample_rate is {rate!r}, must be above 0")
    datatype = str(common["core:datatype"])
    kind, body = datatype[:1], datatype[1:]
    base, _, order = body.partition("_")
    if kind == "r" and base in DATATYPES:
        raise RecordingError(
            f"{meta_path}: core:datatype is {datatype!r}, real samples: they cannot separate approaching and receding. "
            "Give complex samples (I and Q)"
        )
    if kind != "c" or base not in DATATYPES or order not in ("", "le", "be"):
        raise ValueError(f"core:datatype is {datatype!r}, which is not a SigMF type")
    number = np.dtype((">" if order == "be" else "<") + DATATYPES[base])
    return Metadata(data_path, common, captures, annotations, number, channels, None if rate is None else float(rate))


def read_samples(
    path: Path, meta: Metadata, *, channel: int | None, ignore_checksum: bool
) -> npt.NDArray[np.complex64]:
    """Read the complex samples of one channel, shape (samples,).
    They are in units of the file.
    """
    chosen = 0 if channel is None and meta.n_channels == 1 else channel
    if isinstance(chosen, bool) or not isinstance(chosen, int) or not 0 <= chosen < meta.n_channels:
        said = f"holds {meta.n_channels} channels" if channel is None else f"channel = {channel!r} is not allowed"
        raise RecordingError(f"{path}: {said}; give channel = 0 to {meta.n_channels - 1}")
    if not meta.data_path.is_file():
        raise RecordingError(f"{meta.data_path}: no such file; it holds the samples of {path.name}")
    try:
        content = meta.data_path.read_bytes()
    except OSError as error:
        raise RecordingError(f"{meta.data_path}: cannot be read: {error.strerror or error}") from None
    stored = meta.common.get("core:sha512")
    if stored and not ignore_checksum and hashlib.sha512(content).hexdigest() != str(stored).lower():
        raise RecordingError(
            f"{meta.data_path}: its samples do not have the checksum that {path.name} states (core:sha512): the file "
            "was truncated or changed. Set ignore_checksum=True to read it anyway"
        )
    frame_bytes = 2 * meta.number.itemsize * meta.n_channels
    if len(content) < 2 * frame_bytes:
        raise RecordingError(f"{meta.data_path}: holds {len(content)} bytes, less than two samples of {frame_bytes}")
    if len(content) % frame_bytes:
        text = f"{meta.data_path}: its last sample is not whole and is left out; the file is cut off"
        warn_caller(text)
    values = np.frombuffer(
        content, dtype=meta.number, count=len(content) // frame_bytes * frame_bytes // meta.number.itemsize
    )
    # I and Q as complex numbers; unsigned ones have their zero in the middle
    pairs = values.reshape(-1, meta.n_channels, 2)[:, chosen]
    zero = 2.0 ** (8 * pairs.dtype.itemsize - 1) if pairs.dtype.kind == "u" else 0.0
    out = np.empty(pairs.shape[0], dtype=np.complex64)
    with np.errstate(over="ignore", invalid="ignore"):  # beyond single precision: found and refused afterwards
        out.real, out.imag = (pairs[:, part] - zero if zero else pairs[:, part] for part in (0, 1))
    return out
