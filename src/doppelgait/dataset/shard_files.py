"""Stored arrays of a dataset: fields, encoding, and shard files."""

from __future__ import annotations

import hashlib
import io
import math
import os
from collections import OrderedDict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from threading import local
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr
from deflate import zlib_compress

from doppelgait.core.config import format_canonical_json
from doppelgait.core.documents import describe_excess_memory, limit_bytes
from doppelgait.core.errors import DatasetError
from doppelgait.core.labels import Signal, read_axis
from doppelgait.core.own_hdf5 import get_own_member, open_hdf5
from doppelgait.core.units import decimal_logarithm, power_of_ten
from doppelgait.dataset.config import FieldSpec

Array = npt.NDArray[Any]
Arrays = Mapping[str, Array]

FIELDS: dict[str, dict[str, Any]] = {
    "signature": {"dims": ["time", "doppler"], "units": "V^2", "dtype": "float32"},
    "cadence_map": {"dims": ["cadence", "doppler"], "units": "1", "dtype": "float32"},
    "ti_frames": {"dims": ["time", "number"], "units": "m/s, m/s, V^2, 1", "dtype": "float32"},
    "pictures": {"dims": ["picture", "slice", "column", "cell"], "units": "1", "dtype": "uint8", "scale": "byte"},
    "baseband": {"dims": ["slow_time", "range"], "units": "V", "dtype": "complex64"},
    "truth_range_m": {"dims": ["slow_time", "scatterer"], "units": "m", "dtype": "float32"},
    "truth_radial_velocity_mps": {"dims": ["slow_time", "scatterer"], "units": "m/s", "dtype": "float32"},
}
"""Fields in full precision; their axes are stored as ``FIELD_AXIS_UNIT``, for example ``signature_time_s``."""

AXIS_UNITS = {"time": "s", "doppler": "hz", "cadence": "hz", "slow_time": "s", "range": "m"}

DB_FLOOR = -400.0  # stored level of zero power, dB


def describe_fields(specs: Sequence[FieldSpec]) -> dict[str, dict[str, Any]]:
    """Describe each field: dims, units, dtype, scale and hop."""
    facts: dict[str, dict[str, Any]] = {}
    for spec in specs:
        kept = {"scale": FIELDS[spec.name].get("scale", "linear")}
        if spec.is_half:
            kept = {"dtype": "float16", "scale": "db"}
        facts[spec.name] = {**FIELDS[spec.name], **kept, "hop": spec.hop}
    return facts


def encode(values: npt.ArrayLike, spec: FieldSpec) -> Array:
    """Encode an array in its field's precision."""
    kept = np.asarray(values)[:: spec.hop]
    if FIELDS[spec.name].get("scale") == "byte":
        return np.round(255.0 * kept).astype(np.uint8)
    if not spec.is_half:
        return np.ascontiguousarray(kept.astype(np.dtype(FIELDS[spec.name]["dtype"]).newbyteorder("<"), copy=False))
    return np.maximum(10.0 * decimal_logarithm(kept), DB_FLOOR).astype("<f2")


def decode(values: npt.ArrayLike, facts: Mapping[str, Any]) -> Array:
    """Decode a stored array to linear units."""
    stored = np.asarray(values)
    if facts.get("scale", "linear") == "linear":
        return stored
    if facts["scale"] == "byte":
        return np.asarray(stored, dtype=np.float32) / np.float32(255.0)
    power = power_of_ten(stored.astype(np.float64) / 10.0)
    return np.where(stored <= DB_FLOOR, 0.0, power).astype(np.float32)


def name_axis(field: str, dim: str) -> str | None:
    """Return the name of a field's axis in a shard."""
    return f"{field}_{dim}_{AXIS_UNITS[dim]}" if dim in AXIS_UNITS else None


def encode_arrays(fields: Sequence[FieldSpec], signals: Mapping[str, xr.DataArray | Signal | Array | None]) -> Arrays:
    """Encode one row's arrays with axes, empty for None."""
    stored: dict[str, Array] = {}
    for spec in fields:
        signal = signals[spec.name]
        if signal is None or isinstance(signal, np.ndarray):  # pictures have no axes
            stored[spec.name] = encode(np.empty((0, 0)) if signal is None else signal, spec)
            continue
        stored[spec.name] = encode(signal.values, spec)
        for place, dim in enumerate(FIELDS[spec.name]["dims"]):
            name = name_axis(spec.name, dim)
            if name is not None:
                values = read_axis(signal, dim)
                stored[name] = values[:: spec.hop] if place == 0 else values
    return stored


def write_shard(path: Path, split: str, ids: list[str], arrays: Sequence[Arrays], *, identity: str = "") -> None:
    """Write one dataset per field, one chunk per row."""
    # where shapes differ every row has a dataset of its own
    import h5py

    image = io.BytesIO()  # a full disk then fails in one plain write and not inside HDF5
    with h5py.File(image, "w", track_order=True) as file:
        file.attrs["dataset"] = identity
        file.attrs["split"] = split
        file.create_dataset("id", data=np.array(ids, dtype=h5py.string_dtype()), track_times=False)
        file.flush()
        for name in dict.fromkeys(name for entry in arrays for name in entry):
            values = {number: entry[name] for number, entry in enumerate(arrays) if name in entry}
            if len(values) == len(arrays) and len({v.shape for v in values.values()}) == 1:
                _write_chunks(file, name, [v[np.newaxis] for v in values.values()])
                continue
            for number, value in values.items():
                _write_chunks(file, f"{name}/{number}", [value])
    path.write_bytes(image.getbuffer())


INDEX_NAMES = {"flags": "quality_flags"}
"""Columns of the index by their name in a record, where it is another: ``index.flags`` is an attribute of pandas."""

MEASURED_TEXTS = ("flags", "warnings", "notes", "quality_verdict")
"""Columns of text that an analysis writes."""


def hash_contents(rows: Sequence[Mapping[str, Any]], arrays: Iterable[Arrays]) -> str:
    """Hash specification, whole numbers and arrays of rows (SHA-256)."""
    # measured numbers are left out: their last bits depend on the processor and libraries
    digest = hashlib.sha256()
    for row, stored in zip(rows, arrays, strict=True):
        exact = {name: value for name, value in row.items() if isinstance(value, str | int)}
        digest.update(
            format_canonical_json({name: exact[name] for name in exact.keys() - set(MEASURED_TEXTS)}).encode()
        )
        for name in sorted(stored):
            values = stored[name]
            digest.update(f"\n{name} {values.dtype.str} {values.shape}\n".encode())
            digest.update(np.ascontiguousarray(values).data if values.size else b"")
    return digest.hexdigest()


LEVEL = 1
"""Compression level; higher levels take several times as long and save only a few per cent."""


def _write_chunks(file: Any, name: str, chunks: Sequence[Array]) -> None:
    """Write equally shaped arrays as chunks of one dataset."""
    first = chunks[0]
    shape = (len(chunks) * first.shape[0], *first.shape[1:])
    options: dict[str, Any] = {"chunks": first.shape, "compression": "gzip", "compression_opts": LEVEL, "shuffle": True}
    if 0 in shape:
        options = {}
    dataset = file.create_dataset(name, shape, first.dtype, track_times=False, **options)
    if options:
        for number, values in enumerate(chunks):
            by_byte = np.ascontiguousarray(values).view(np.uint8).reshape(-1, first.itemsize).T  # the shuffle filter
            place = (number * first.shape[0], *(0,) * (first.ndim - 1))
            dataset.id.write_direct_chunk(place, zlib_compress(by_byte.tobytes(), LEVEL))
    file.flush()  # close in this order, so that the bytes are reproducible


MAX_OPEN = 128  # shard files that one reader keeps open


class ShardFiles:
    """Reader of a folder of shard files."""

    def __init__(self, folder: Path, identity: str | None = None) -> None:
        self.folder, self.identity = folder, identity
        self._local = local()

    def __reduce__(self) -> tuple[type[ShardFiles], tuple[Path, str | None]]:
        return ShardFiles, (self.folder, self.identity)

    def read(self, shard: str, name: str, row: int) -> npt.NDArray[Any] | None:
        """Read array ``name`` of a shard's row, as stored."""
        with self._name_faults(shard, name, row):
            found, one_row = self._find(shard, name, row)
            if found is None:
                return None
            n_bytes = found.dtype.itemsize * math.prod(found.shape[1:] if one_row else found.shape)
            if n_bytes > limit_bytes(size := self._make_path(shard).stat().st_size):
                raise ValueError(describe_excess_memory(n_bytes, size, "it"))
            return np.asarray(found[row] if one_row else found[:])

    def shape(self, shard: str, name: str, row: int) -> tuple[int, ...] | None:
        """Return the shape of the result of :meth:`read`."""
        with self._name_faults(shard, name, row):
            found, one_row = self._find(shard, name, row)
            return None if found is None else tuple(found.shape[1:] if one_row else found.shape)

    @contextmanager
    def _name_faults(self, shard: str, name: str, row: int) -> Iterator[None]:
        try:
            yield
        except (OSError, LookupError, ValueError, TypeError, RuntimeError, MemoryError) as error:
            self.close()
            raise DatasetError(
                f"{self._make_path(shard)}: {name} of row {row} cannot be read: {error}; check the "
                "folder with dataset verify, build it again to replace what is missing or damaged"
            ) from None

    def _find(self, shard: str, name: str, row: int) -> tuple[Any, bool]:
        """Find an array's HDF5 dataset, and whether it is one row."""
        import h5py

        files = self._get_files()
        if shard in files:
            files.move_to_end(shard)
        else:
            # Refuse a shard that an index or a link places outside the folder. The folder of shards
            # must not be a link either; the folder of the dataset may be one.
            if self._make_path(shard).resolve().parent != self.folder.parent.resolve() / self.folder.name:
                raise ValueError("it lies outside the folder of the dataset")
            opened = open_hdf5(self._make_path(shard), members=False, rdcc_nbytes=0)  # rows are rarely read twice
            files[shard] = (opened, {})
            if self.identity is not None and opened.attrs.get("dataset") != self.identity:
                raise ValueError(f"it is of dataset {opened.attrs.get('dataset')!r}, not of {self.identity}")
            if len(files) > MAX_OPEN:
                files.popitem(last=False)[1][0].close()
        file, known = files[shard]
        if name not in known:
            known[name] = get_own_member(file, name)
        found = known[name]
        if found is None or isinstance(found, h5py.Dataset):
            return found, True
        return get_own_member(found, str(row)), False

    def _get_files(self) -> OrderedDict[str, tuple[Any, dict[str, Any]]]:
        # after a fork the parent's files are left to the parent
        if getattr(self._local, "pid", None) != os.getpid():
            self._local.pid = os.getpid()
            self._local.files = OrderedDict()
        files: OrderedDict[str, tuple[Any, dict[str, Any]]] = self._local.files
        return files

    def read_row(self, shard: str, row: int) -> dict[str, Array]:
        """Read all arrays and axes of one row."""
        with self._name_faults(shard, "list", row):
            self._find(shard, "id", row)
            names = [name for name in self._get_files()[shard][0] if name != "id"]
        found = {name: self.read(shard, name, row) for name in names}
        return {name: values for name, values in found.items() if values is not None}

    def _make_path(self, shard: str) -> Path:
        return self.folder / f"{shard}.h5"

    def close(self) -> None:
        """Close the files of this process and thread."""
        files = self._get_files()
        while files:
            files.popitem()[1][0].close()
