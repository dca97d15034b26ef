"""Datasets in other forms: Parquet, CSV, Hugging Face, WebDataset, Zarr, xarray, SigMF."""

from __future__ import annotations

import io
import json
import math
import shutil
import tarfile
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal
from urllib.parse import quote

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr
from pydantic import Field

from doppelgait.core.config import FrozenModel, convert_to_json
from doppelgait.core.errors import DatasetError
from doppelgait.core.labels import COORDINATE_UNITS
from doppelgait.core.plugins import Group, plugin
from doppelgait.dataset.card import list_blocked_recordings
from doppelgait.dataset.config import SPLITS, Progress, list_some
from doppelgait.dataset.example import parse_unit, read_radar
from doppelgait.dataset.lock import write_new_folder
from doppelgait.dataset.open import PATCH, PICTURE, Dataset
from doppelgait.dataset.shard_files import AXIS_UNITS, name_axis
from doppelgait.radar.readers.sigmf import write_sigmf
from doppelgait.radar.recording import Recording, TargetTruth

if TYPE_CHECKING:
    import pyarrow as pa

Fields = tuple[str, ...]
Done = Callable[[int], None]
Exporter = Callable[[Dataset, Path, Fields, Any, Done], None]
"""Writer, called with (dataset, empty folder, fields, parameters, done). It calls ``done`` with the
number of rows written since the last call."""

EXPORTERS: Group[Exporter] = Group("exporter", built_in=("doppelgait.dataset.export",), noun="form")
"""Export formats of datasets. Facts of an exporter: ``allowed``, the fields that it supports (by default
all); ``default``, those that are written if none are named (all stored ones); ``least``, their minimum number (0)."""

PICTURE_FIELD = {"dims": ["picture_velocity", "picture_time"], "units": "1", "dtype": "float32", "hop": 1}
PICTURE_FIELD |= {"patch": PATCH.model_dump()}  # of every dataset with signatures


@dataclass(frozen=True)
class ExportReport:
    """Report of an export: rows of the dataset, files written and their size."""

    directory: Path
    form: str
    n_rows: int
    n_files: int
    bytes: int


def export_dataset(
    dataset: Dataset,
    destination: str | Path,
    *,
    form: str | Mapping[str, Any] | FrozenModel,
    fields: Sequence[str] | None = None,
    release: bool = False,
    on_progress: Progress | None = None,
) -> ExportReport:
    """Write a dataset, or part of it, in another form."""
    # Next to the data are dataset.json, with what was exported, and source-card.md, the card of the dataset.
    # The form is an exporter's name, or a table of its parameters: {"kind": "webdataset", "examples_per_tar": 500}.
    target = Path(destination)
    parameters = EXPORTERS.parse(form)
    exporter = EXPORTERS.of(parameters)
    name, allowed, known = exporter.name, exporter.facts.get("allowed"), dataset.description["fields"]
    if fields is None:
        fields = exporter.facts.get("default", tuple(known))
    for field in fields:
        if allowed is not None and field not in allowed:
            raise DatasetError(f"fields: {name} holds {' and '.join(allowed) or 'no arrays'} only, not {field!r}")
    if PICTURE in fields and "signature" in known:
        known = {**known, PICTURE: PICTURE_FIELD}
        dataset = replace(dataset, description={**dataset.description, "fields": known})
    dataset.check_fields(fields)
    chosen = tuple(dict.fromkeys(fields))
    if len(chosen) < exporter.facts.get("least", 0):
        raise DatasetError(f"fields: {name} needs {' and '.join(allowed or known)}")
    if len(dataset) == 0:
        raise DatasetError(f"{dataset.directory}: no row is selected, so there is nothing to export")
    if release:
        refuse_unreleasable(dataset)
    done = 0

    def count(rows: int) -> None:
        nonlocal done
        done += rows
        if on_progress is not None:
            on_progress(done, len(dataset))

    if target.exists():
        raise DatasetError(f"{target}: exists already; nothing is overwritten; choose another folder")
    with write_new_folder(target, "export") as partial:
        exporter.run(dataset, partial, chosen, parameters, count)
        counts = {str(split): int(n) for split, n in dataset.index["split"].value_counts().sort_index().items()}
        export = {"form": name, "fields": chosen, "rows": counts}
        text = json.dumps({**dataset.description, "export": export}, indent=2)
        (partial / "dataset.json").write_text(text + "\n", encoding="utf-8")
        card = dataset.directory / "README.md"
        if card.is_file():
            shutil.copyfile(card, partial / "source-card.md")
    files = [path for path in target.rglob("*") if path.is_file()]
    return ExportReport(target, name, len(dataset), len(files), sum(path.stat().st_size for path in files))


def refuse_unreleasable(dataset: Dataset) -> None:
    """Raise a :class:`DatasetError` if a licence blocks the release."""
    # all targets of a scene count, because the arrays contain the echoes of all of them
    whole = pd.read_parquet(dataset.directory / "index.parquet")
    names = list_blocked_recordings(whole[whole["scene_id"].isin(dataset.index["scene_id"])])
    if names:
        raise DatasetError(
            f"{dataset.directory}: cannot be released, because recordings have a non-commercial or unknown licence: "
            f"{list_some(names, 8)}; state their licences under [[sources]], or leave them out"
        )


PLACES = ("shard", "row", "shard_sha256")
"""Columns with the position of a row's arrays in the dataset."""


def iterate_splits(dataset: Dataset) -> Iterator[tuple[str, npt.NDArray[np.int64]]]:
    """Yield every split that has rows, with its rows."""
    rows: dict[Any, Any] = dataset.index.groupby("split").indices
    return ((split, rows[split]) for split in SPLITS if split in rows)


def flatten_index(dataset: Dataset) -> pd.DataFrame:
    """Return the index with ``class_number``, without positions in shard files."""
    table = dataset.index.drop(columns=list(PLACES), errors="ignore")
    table.insert(list(table.columns).index("label") + 1, "class_number", dataset.class_numbers())
    return table


def read_arrays(dataset: Dataset, row: int, fields: Fields) -> dict[str, npt.NDArray[np.generic]]:
    """Return a row's arrays in linear units, with axes if stored."""
    arrays: dict[str, npt.NDArray[np.generic]] = {}
    for name in fields:
        arrays[name] = dataset.array(name, row)
        for dim in dataset.description["fields"][name]["dims"]:
            axis = name_axis(name, dim)
            if axis is not None and (values := dataset.stored(row, axis)) is not None:
                arrays[axis] = values
    return arrays


def make_file_name(example_id: str) -> str:
    """Return a file name for an example's id, escaping other characters."""
    return quote(example_id, safe="").replace(".", "%2E").replace("~", "%7E")


VALUES = "_values"


def _name_array(dataset: Dataset, field: str) -> str:
    return f"{field}{VALUES}" if field in dataset.index else field


class Form(FrozenModel):
    """Form without parameters."""

    kind: Literal["csv", "huggingface", "xarray", "sigmf"]


class Parquet(FrozenModel):
    """One Parquet file per split.

    rows_per_group: Rows in one row group of a file with arrays; they are in memory together.
    """

    kind: Literal["parquet"] = "parquet"
    rows_per_group: int = Field(default=100, ge=1, le=1_000_000)


class WebDataset(FrozenModel):
    """Tar files with consecutive, equally named files per example.

    examples_per_tar: Examples in one tar file.
    """

    kind: Literal["webdataset"] = "webdataset"
    examples_per_tar: int = Field(default=1000, ge=1, le=1_000_000)


class Zarr(FrozenModel):
    """A Zarr store, version 3 of the format.

    examples_per_file: Examples in one file (a Zarr shard); each example is one chunk of the file.
    """

    kind: Literal["zarr"] = "zarr"
    examples_per_file: int = Field(default=64, ge=1, le=1_000_000)


@plugin("exporter", "csv", parameters=Form, allowed=(), default=())
def write_csv(dataset: Dataset, folder: Path, fields: Fields, parameters: Form, done: Done) -> None:
    """Write ``index.csv``: a header and a line per row, exact numbers, empty for unknown ones."""
    table = flatten_index(dataset)
    table.to_csv(folder / "index.csv", index=False, lineterminator="\n")
    done(len(table))


@plugin("exporter", parameters=Parquet, default=())
def write_parquet(dataset: Dataset, folder: Path, fields: Fields, parameters: Parquet, done: Done) -> None:
    """Write one ``SPLIT.parquet`` per split: the index and all fields, ``FIELD_values`` with ``FIELD_shape``."""
    _write_tables(dataset, folder, fields, parameters.rows_per_group, done)


@plugin("exporter", "huggingface", parameters=Form)
def write_huggingface(dataset: Dataset, folder: Path, fields: Fields, parameters: Form, done: Done) -> None:
    """Write one ``SPLIT.parquet`` per split, arrays as nested lists, and ``README.md``, which names their features.
    An array without values, of a target without a track, is null.
    """
    import pyarrow as pa

    schemas = _write_tables(dataset, folder, fields, Parquet().rows_per_group, done, nested=True)
    classes = {str(number): label for label, number in dataset.description["classes"].items()}
    features: list[dict[str, Any]] = [{"name": "label", "dtype": {"class_label": {"names": classes}}}]
    for column in pa.unify_schemas(list(schemas.values())):
        kind, rank = column.type, 0
        while pa.types.is_list(kind):
            kind, rank = kind.value_type, rank + 1
        name = {"double": "float64", "float": "float32"}.get(str(kind), str(kind))
        feature: dict[str, Any] = {"dtype": name}
        field = column.name.removesuffix(VALUES)
        shapes = {dataset.shape(row, field) for row in range(len(dataset)) if rank > 1} - {None, (0, 0)}
        if len(shapes) == 1:
            shape = [*(shapes.pop() or ()), 2][:rank]  # complex numbers are pairs
            feature, rank = {"dtype": {f"array{rank}_d": {"shape": shape, "dtype": name}}}, 0
        for _ in range(rank):
            feature = {"list": feature}
        features += [{"name": column.name, **feature}] if column.name != "label" else []
    card = dataset.directory / "README.md"
    front, _, rest = (card.read_text(encoding="utf-8") if card.is_file() else "---\n").partition("configs:\n")
    files = [{"split": split, "path": f"{split}.parquet"} for split in schemas]
    # JSON is YAML
    front += f"configs: {json.dumps([{'config_name': 'default', 'data_files': files}])}\n"
    front += f"dataset_info: {json.dumps({'features': features})}\n---\n"
    (folder / "README.md").write_text(front + rest.partition("---\n")[2], encoding="utf-8")


def _write_tables(
    dataset: Dataset, folder: Path, fields: Fields, rows_per_group: int, done: Done, *, nested: bool = False
) -> dict[str, pa.Schema]:
    # the schemas by split
    import pyarrow as pa
    import pyarrow.parquet as pq

    table, schemas = flatten_index(dataset), {}
    # use the whole index: a column that is empty in one split keeps its type
    schema = pa.Schema.from_pandas(table, preserve_index=False)

    def make_group(rows: npt.NDArray[np.int64]) -> pa.Table:
        group = pa.Table.from_pandas(table.iloc[rows], schema=schema, preserve_index=False)
        for name, column in _make_array_columns(dataset, rows, fields, nested=nested).items():
            group = group.append_column(name, column)
        return _add_units(group, dataset)

    size = rows_per_group if fields else len(table)
    for split, rows in iterate_splits(dataset):
        groups = (make_group(rows[first : first + size]) for first in range(0, rows.size, size))
        first_group = next(groups)
        schemas[split] = first_group.schema
        with pq.ParquetWriter(folder / f"{split}.parquet", first_group.schema, compression="zstd") as writer:
            for group in chain([first_group], groups):
                writer.write_table(group)
                done(len(group))
    return schemas


def _make_array_columns(
    dataset: Dataset, rows: npt.NDArray[np.int64], fields: Fields, *, nested: bool
) -> dict[str, pa.ListArray]:
    import pyarrow as pa

    found = [read_arrays(dataset, int(row), fields) for row in rows] if fields else []
    columns: dict[str, Any] = {}
    for name in dict.fromkeys(name for arrays in found for name in arrays):
        values = [arrays.get(name, np.empty(0)) for arrays in found]
        rank = len(dataset.description["fields"][name]["dims"]) if nested and name in fields else 1
        if values[0].dtype.kind == "c":  # complex numbers as pairs along a new last axis
            values = [np.ascontiguousarray(v)[..., None].view(v.real.dtype) for v in values]
            rank += nested
        kind = pa.from_numpy_dtype(values[0].dtype)
        for _ in range(rank):
            kind = pa.list_(kind)
        if nested:
            columns[_name_array(dataset, name)] = pa.array([_nest(v) for v in values], type=kind)
            continue
        columns[f"{name}{VALUES}" if name in fields else name] = pa.array([v.ravel() for v in values], type=kind)
        if name in fields:
            columns[f"{name}_shape"] = pa.array([v.shape for v in values], type=pa.list_(pa.int64()))
    return columns


def _nest(values: npt.NDArray[Any]) -> Any:
    if values.ndim == 1 and values.size:
        return values
    return [_nest(part) for part in values] if values.size else None


def _add_units(table: pa.Table, dataset: Dataset) -> pa.Table:
    """Store the unit of every numeric column in its metadata."""
    import pyarrow as pa

    fields = dataset.description["fields"]
    columns = []
    for column in table.schema:
        array = pa.types.is_list(column.type) and column.name.removesuffix("_shape") not in fields
        stem = column.name.removesuffix(VALUES)
        unit = fields[stem]["units"] if stem in fields and pa.types.is_list(column.type) else parse_unit(column.name)
        columns.append(column.with_metadata({"unit": unit}) if array or pa.types.is_floating(column.type) else column)
    facts = json.dumps({"id": dataset.description["id"], "classes": dataset.description["classes"], "fields": fields})
    return table.cast(pa.schema(columns, metadata={**(table.schema.metadata or {}), b"doppelgait": facts.encode()}))


@plugin("exporter", parameters=WebDataset)
def write_webdataset(dataset: Dataset, folder: Path, fields: Fields, parameters: WebDataset, done: Done) -> None:
    """Write ``SPLIT-NNNNNN.tar`` files in the WebDataset format.
    Every example has ``ID.FIELD.npy``, its axes, ``ID.json`` (its row) and ``ID.cls``.
    """
    table, numbers = flatten_index(dataset), dataset.class_numbers()
    for split, rows in iterate_splits(dataset):
        for tar_number, first in enumerate(range(0, rows.size, parameters.examples_per_tar)):
            with tarfile.open(folder / f"{split}-{tar_number:06d}.tar", "w", format=tarfile.PAX_FORMAT) as tar:
                for row in rows[first : first + parameters.examples_per_tar]:
                    key = make_file_name(str(table["id"].iat[row]))
                    for name, values in read_arrays(dataset, int(row), fields).items():
                        buffer = io.BytesIO()
                        np.save(buffer, values, allow_pickle=False)
                        _add(tar, f"{key}.{name}.npy", buffer.getvalue())
                    facts = convert_to_json(table.iloc[row].to_dict())
                    _add(tar, f"{key}.json", json.dumps(facts, allow_nan=False).encode())
                    _add(tar, f"{key}.cls", str(numbers[row]).encode())
                    done(1)


def _add(tar: tarfile.TarFile, name: str, content: bytes) -> None:
    entry = tarfile.TarInfo(name)  # time 0, no user and no group
    entry.size = len(content)
    tar.addfile(entry, io.BytesIO(content))


@plugin("exporter", parameters=Zarr)
def write_zarr(dataset: Dataset, folder: Path, fields: Fields, parameters: Zarr, done: Done) -> None:
    """Write ``dataset.zarr`` with the groups ``SPLIT/index``, an array for every column, and ``SPLIT/FIELD``."""
    root, table = _create_store(folder), flatten_index(dataset)
    for split, rows in iterate_splits(dataset):
        index = root.create_group(f"{split}/index")
        for name in table.columns:
            _write_column(index, str(name), table[name].iloc[rows])
        for name in fields:
            group = root.create_group(f"{split}/{name}")
            if len({dataset.shape(int(row), name) for row in rows}) == 1:
                _write_column(group, "id", table["id"].iloc[rows])
                _write_stacked(group, dataset, name, rows, parameters.examples_per_file, name)
                continue
            facts = dataset.description["fields"][name]
            for row in map(int, rows):
                own = group.create_group(make_file_name(str(dataset.index["id"].iat[row])))
                dims = tuple(_write_axis(own, dataset, name, dim, np.array([row])) for dim in facts["dims"])
                _write_whole(own, name, dataset.array(name, row), dims, facts["units"])
        done(rows.size)


@plugin("exporter", "xarray", parameters=Form, least=1)
def write_xarray(dataset: Dataset, folder: Path, fields: Fields, parameters: Form, done: Done) -> None:
    """Write ``dataset.zarr``, one group: fields (example, ...) with their axes; columns are coordinates.
    Shorter arrays, and those of a target without a track, are filled with NaN.
    """
    root, table = _create_store(folder), flatten_index(dataset)
    import zarr

    rows, named = np.arange(len(dataset)), {name: _name_array(dataset, name) for name in fields}
    for column in table.columns:
        _write_column(root, str(column), table[column])
    for field, name in named.items():
        _write_stacked(root, dataset, field, rows, Zarr().examples_per_file, name)
    root.attrs["coordinates"] = " ".join(sorted(set(root) - set(named.values())))
    with warnings.catch_warnings(action="ignore"):  # version 3 of the format does not specify it yet
        zarr.consolidate_metadata(root.store)
    done(len(dataset))


def _create_store(folder: Path) -> Any:
    try:
        import zarr
    except ImportError:
        raise DatasetError("zarr is not installed; install it with pip install 'doppelgait[zarr]'") from None
    return zarr.create_group(folder / "dataset.zarr", zarr_format=3)


def _write_column(group: Any, name: str, values: pd.Series[Any]) -> None:
    if pd.api.types.is_numeric_dtype(values):
        unit = parse_unit(name) if pd.api.types.is_float_dtype(values) else None
        _write_whole(group, name, values.to_numpy(), ("example",), unit)
    else:
        texts = values.fillna("").to_numpy(dtype=object).astype(np.dtypes.StringDType())
        _write_whole(group, name, texts, ("example",))


def _write_stacked(
    group: Any, dataset: Dataset, field: str, rows: npt.NDArray[np.int64], examples_per_file: int, name: str
) -> None:
    facts = dataset.description["fields"][field]
    shapes = [shape for row in rows if math.prod(shape := dataset.shape(int(row), field) or (0,))]
    shape = tuple(np.max([[1] * len(facts["dims"]), *shapes], axis=0).tolist())
    dims = [_write_axis(group, dataset, field, dim, rows) for dim in facts["dims"]]
    target: Any = None
    for first in range(0, rows.size, examples_per_file):
        arrays = [dataset.array(field, int(row)) for row in rows[first : first + examples_per_file]]
        block = np.stack([_pad(values, shape) for values in arrays])
        if target is None:
            target = group.create_array(
                name,
                shape=(rows.size, *shape),
                dtype=block.dtype,
                chunks=(1, *shape),
                shards=(examples_per_file, *shape),
                dimension_names=("example", *dims),
                attributes={"units": facts["units"]},
            )
        target[first : first + len(block)] = block


def _write_axis(group: Any, dataset: Dataset, field: str, dim: str, rows: npt.NDArray[np.int64]) -> str:
    # its name: with the field if another field has other values
    stored = name_axis(field, dim)
    axes = [None if stored is None else dataset.stored(int(row), stored) for row in rows]
    known = [values for values in axes if values is not None and values.size]
    if not known:
        return dim  # scatterers have no axis
    dims: tuple[str, ...] = (dim,)
    name, whole = dim, known[0]
    if not all(np.array_equal(values, whole) for values in known):
        size = max(values.size for values in known)
        whole = np.stack([_pad(np.empty(0) if values is None else values, (size,)) for values in axes])
        name, dims = f"{dim}_{AXIS_UNITS[dim]}", ("example", dim)
    if name in group and np.array_equal(group[name][:], whole, equal_nan=True):
        return dim
    prefix = f"{field}_" if {dim, f"{dim}_{AXIS_UNITS[dim]}"} & set(group) else ""
    _write_whole(group, prefix + name, whole, (*dims[:-1], prefix + dim), COORDINATE_UNITS[dim])
    return prefix + dim


def _pad(values: npt.NDArray[Any], shape: tuple[int, ...]) -> npt.NDArray[Any]:
    padded = np.full(shape, np.nan, values.dtype)
    if values.size:
        padded[tuple(map(slice, values.shape))] = values
    return padded


def _write_whole(group: Any, name: str, values: Any, dims: tuple[str, ...], unit: str | None = None) -> None:
    """Write a small array as one chunk."""
    chunks, attributes = tuple(max(1, n) for n in values.shape), {} if unit is None else {"units": unit}
    names = dims if len(dims) == values.ndim else None  # an empty array has two axes
    group.create_array(name, data=values, chunks=chunks, dimension_names=names, attributes=attributes)


@plugin("exporter", "sigmf", parameters=Form, allowed=("baseband",), default=("baseband",), least=1)
def write_sigmf_folder(dataset: Dataset, folder: Path, fields: Fields, parameters: Form, done: Done) -> None:
    """Write the baseband of every scene as a SigMF recording.
    Files are ``SPLIT/SCENE.sigmf-meta`` and ``.sigmf-data``; targets are annotations.
    """
    description, axes = dataset.description, ("centre_range_m", "centre_velocity_mps", "centre_aspect_rad")
    unknown: dict[str, Any] = dict.fromkeys(axes, np.empty(0))
    for split, rows in iterate_splits(dataset):
        (folder / split).mkdir()
        scenes = dataset.index["scene_id"].iloc[rows]
        for scene_id, members in scenes.groupby(scenes, sort=False).groups.items():
            examples = [dataset.example(int(number)) for number in members]
            first = examples[0]
            if not {"slow_time", "range"} <= set(first.baseband.coords):
                raise DatasetError(f"{first.id}: the baseband has no axes; build the dataset again with this version")
            annotated = [  # target facts that SigMF stores: label, gait, subject and kind of motion
                TargetTruth(
                    label=example.label,
                    scatterers=xr.Dataset(),
                    **unknown,
                    gait=example.row.get("truth_gait") or "",
                    subject=example.row.get("subject") or "",
                    motion=example.row.get("motion_kind") or "",
                )
                for example in examples
            ]
            recording = Recording.from_baseband(
                first.baseband,
                read_radar(description, first.row),
                truth=annotated,
                snr_frame_db=float(np.nan if first.row.get("snr_frame_db") is None else first.row["snr_frame_db"]),
                seed=description["config"]["dataset"]["seed"],
                source=f"dataset {description['name']} {description['id']}, {scene_id}",
            )
            write_sigmf(recording, folder / split / make_file_name(str(scene_id)))
            done(len(examples))
