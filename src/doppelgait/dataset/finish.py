"""Finish a dataset: identity, description, index, split lists, card."""

from __future__ import annotations

import hashlib
import json
import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TextIO

from pydantic import BaseModel, NonNegativeInt, ValidationError

from doppelgait import __version__
from doppelgait.core.config import format_canonical_json, validate
from doppelgait.core.documents import parse_json, read_document, stat_regular
from doppelgait.core.errors import ConfigError, DatasetError
from doppelgait.core.files import FileKind, hash_file, open_atomically, write_atomically
from doppelgait.core.interrupt import raise_if_stopped
from doppelgait.core.plugins import identify_plugins
from doppelgait.dataset.card import format_card
from doppelgait.dataset.config import MAX_SHARDS, SPLITS, FieldSpec, PlanConfig, list_differences, list_some, shorten
from doppelgait.dataset.feasibility import limits_of_index
from doppelgait.dataset.motions import list_labels, list_motion_files, list_motions
from doppelgait.dataset.resolve import replace_radar_files, store_radar_files
from doppelgait.dataset.shard_files import INDEX_NAMES, describe_fields
from doppelgait.features import FEATURE_UNITS
from doppelgait.pipeline.radar_table import RadarFile

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa


SCHEMA_VERSION = 3
"""Schema version of the files of a dataset. 2: one row per target with scene, group, licence; axes by field; half
precision. 3: the id of the dataset in every record, shard and index; a list of the hashes of all files."""

DATASET = FileKind(
    "doppelgait-dataset", SCHEMA_VERSION, "a dataset", DatasetError, oldest=SCHEMA_VERSION, remedy="make it again"
)

SUMS = "SHA256SUMS"
"""File with the hash of every file of a finished dataset, in the format of ``sha256sum -c``. It is written last."""
LOG, LOG_SUM = "build.jsonl", "build.jsonl.sha256"
"""Log of the build, and its hash: two builds of a plan differ in these files only."""
SINGLE_FILES = ("README.md", "dataset.json", "index.parquet", *(f"splits/{s}.txt" for s in SPLITS))

DATA_VERSION = 15
"""Version of the bytes that a configuration produces. It is part of every dataset's identity and is
raised by hand when the same configuration gives other bytes (a random draw, a kernel, a stored
type), so that a dataset never mixes examples of two versions. 15: bodies of surfaces; lines of the
changelog that begin with **data** describe the changes."""


def plan_plugins(plan: PlanConfig, folder: Path) -> list[dict[str, Any]]:
    """Identify the plug-ins of other packages that a plan uses."""
    tables = [store_radar_files(plan, folder).model_dump(mode="json")]
    return identify_plugins(
        tables, {"motion_reader": [folder / path for path in list_motion_files(list_motions(plan))]}
    )


def compute_dataset_id(plan: PlanConfig, folder: Path) -> str:
    """Compute the identity of a dataset, 16 hex digits."""
    plan = store_radar_files(plan, folder)
    contents: dict[str, bytes] = {}
    for path in list_motion_files(list_motions(plan)):
        try:
            contents[path] = bytes.fromhex(hash_file(folder / path))
        except OSError as error:
            raise ConfigError(f"motion file {path}: cannot be read: {error}") from None

    def replace_by_hash(file: RadarFile) -> str:  # comments and file names have no effect
        plain = json.dumps(file.values, sort_keys=True)
        contents[file.file] = hashlib.sha256(plain.encode()).digest()
        return contents[file.file].hex()

    table = plan.model_dump(mode="json")
    table["radar"] = replace_radar_files(table["radar"], replace_by_hash)
    digest = hashlib.sha256(f"{DATA_VERSION}\n{format_canonical_json(table)}\n".encode())
    for content in contents.values():
        digest.update(content)
    for item in plan_plugins(plan, folder):
        digest.update(format_canonical_json(item).encode())
    return digest.hexdigest()[:16]


Record = Mapping[str, Any]

ROWS_AT_A_TIME = 4096
"""Number of rows in a row group of the index file, which bounds the memory for it."""
FAILURES_KEPT = 100
LONG_COLUMNS = ("motion", "environment", "impairments", "shard_sha256")
"""Columns with long texts that neither card nor lists need."""
TEXT, NUMBER, INTEGER = "string", "float64", "int64"
TEXT_COLUMNS = ("truth_gait", "quality_verdict")  # columns that are text even if every row is empty


@dataclass
class Totals:
    """Totals of the finished shards."""

    rows: int = 0
    bytes: int = 0
    n_failed: int = 0
    failures: list[dict[str, Any]] = field(default_factory=list)
    columns: dict[str, str] = field(default_factory=dict)
    counts: Counter[str] = field(default_factory=Counter)  # rows by label
    n_not_tracked: int = 0
    hashes: dict[str, str] = field(default_factory=dict)
    contents_sha256: str = ""


@dataclass(frozen=True)
class Header:
    """Identity and configuration of a dataset, simulated or imported."""

    id: str
    name: str
    origin: Literal["simulated", "imported"]
    labels: tuple[str, ...]
    fields: tuple[FieldSpec, ...]
    n_examples: int
    config: Mapping[str, Any]
    card: Callable[[pd.DataFrame, int], str]
    plugins: Sequence[Mapping[str, Any]] = ()

    def describe(self, shards: Mapping[str, int], *, complete: bool, labels: Iterable[str] = ()) -> dict[str, Any]:
        """Return the content of ``dataset.json``."""
        return {
            "id": self.id,
            "name": self.name,
            "complete": complete,
            "origin": self.origin,
            "schema_version": SCHEMA_VERSION,
            "data_version": DATA_VERSION,
            "classes": {label: n for n, label in enumerate([*self.labels, *sorted(set(labels) - set(self.labels))])},
            "features": FEATURE_UNITS,
            "fields": describe_fields(self.fields),
            "shards": dict(shards),
            "n_examples": self.n_examples,
            "config": dict(self.config),
            **({"plugins": list(self.plugins)} if self.plugins else {}),
            "doppelgait_version": __version__,
        }


def plan_header(plan: PlanConfig, identity: str, folder: Path) -> Header:
    """Return the header of a planned dataset."""
    return Header(
        id=identity,
        name=plan.dataset.name,
        origin="simulated",
        labels=tuple(list_labels(plan)),
        fields=plan.dataset.fields,
        n_examples=plan.count_examples(),
        config=plan.model_dump(mode="json"),
        card=lambda index, n_failed: format_card(plan, identity, index),
        plugins=plan_plugins(plan, folder),
    )


def finish_dataset(target: Path, header: Header, names: Sequence[str], *, max_failed_share: float = 0.0) -> Totals:
    """Write a folder's index, splits, card, description and hashes."""
    import pandas as pd

    totals = tally(read_records(target, names))
    if header.origin == "imported" and not totals.rows:
        words, first = f"none of {header.n_examples} recordings can be imported", totals.failures[0]
        raise DatasetError(f"{header.name}: {words}; the first, {first['id']}: {first['reason']}")
    write_index(target / "index.parquet", read_records(target, names), totals.columns, header.id)
    kept = [INDEX_NAMES.get(name, name) for name in totals.columns if name not in LONG_COLUMNS]
    index = pd.read_parquet(target / "index.parquet", columns=kept)
    write_splits(target / "splits", index)
    write_atomically(target / "README.md", header.card(index, totals.n_failed).encode())
    complete = totals.n_failed <= max_failed_share * header.n_examples
    description = header.describe(count_shards(names), complete=complete, labels=totals.counts)
    facts = {"limits": limits_of_index(index), "contents_sha256": totals.contents_sha256}
    write_description(target, {**description, **facts})
    write_sums(target, totals.hashes)
    return totals


def open_log(target: Path) -> TextIO:
    """Open the build log to append."""

    def open_regular(name: str, mode: int) -> int:  # no link or pipe, however new
        flags = mode | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
        stat_regular(number := os.open(name, flags, 0o666))
        return number

    return open(target / LOG, "a", opener=open_regular)


def write_sums(target: Path, shards: Mapping[str, str]) -> None:
    """Write the list of the hashes of all files."""
    hashes = {f"shards/{name}.h5": sha256 for name, sha256 in shards.items()}
    for name in (*SINGLE_FILES, *(f"shards/{name}.json" for name in shards)):
        hashes[name] = hash_file(target / name)
    open_log(target).close()  # empty if it was lost
    log_sum = ""
    # another part may write to the log meanwhile
    while log_sum != (log_sum := format_checksums({LOG: hash_file(target / LOG)})):
        write_atomically(target / LOG_SUM, log_sum.encode())
    write_atomically(target / SUMS, format_checksums(hashes).encode())


def format_checksums(hashes: Mapping[str, str]) -> str:
    """Format the hashes of files by their names."""
    return "".join(f"{hashes[name]}  {name}\n" for name in sorted(hashes))


def make_card(directory: str | Path) -> str:
    """Return the card of a dataset, complete or not."""
    folder = Path(directory)
    description = read_description(folder)
    written = folder / "README.md"
    if description.get("complete") and written.is_file():
        return read_document(written).decode()
    if description.get("origin") != "simulated":
        raise DatasetError(f"{folder}: has no card and was not simulated; import it again")
    config = validate(PlanConfig, description["config"], where=str(folder / "dataset.json"))
    names = [name for name in list_shard_names(description["shards"]) if (folder / "shards" / f"{name}.json").is_file()]
    return format_card(config, str(description["id"]), make_index(read_records(folder, names)))


class FieldFacts(BaseModel, strict=True):
    """Description of a stored array."""

    dims: list[str]
    units: str
    dtype: str


class Description(BaseModel, strict=True):
    """Content of ``dataset.json`` that readers rely on."""

    name: str
    id: str
    schema_version: int
    classes: dict[str, int]
    fields: dict[str, FieldFacts]
    n_examples: int = 0
    origin: str = "simulated"
    config: dict[str, Any] | None = None


class _Section(BaseModel, strict=True):
    label: str
    examples: NonNegativeInt | None = None


class _Numbers(BaseModel, strict=True):
    examples_per_class: NonNegativeInt
    seed: NonNegativeInt


class StatedPlan(BaseModel, strict=True):
    """Plan, as far as readers rely on it; the rest serves to simulate an example again."""

    dataset: _Numbers
    classes: list[_Section] = []
    episodes: list[_Section] = []


def read_description(folder: Path) -> dict[str, Any]:
    """Read ``dataset.json`` of a folder."""
    try:
        description = parse_json(read_document(folder / "dataset.json"))
        known = validate(Description, description, where="dataset.json")
        if known.config and known.origin == "simulated":
            validate(StatedPlan, known.config, where="config")
    except NotADirectoryError:
        raise DatasetError(f"{folder}: is a file; name the folder of a dataset") from None
    except FileNotFoundError:
        raise DatasetError(f"{folder}: contains no dataset; dataset.json is missing") from None
    except (OSError, ValueError, TypeError, RecursionError, ConfigError) as error:
        raise DatasetError(f"{folder}: is damaged: dataset.json: {str(error).removeprefix('dataset.json: ')}") from None
    DATASET.check_version(folder, known.schema_version)
    return dict(description)


def find_dataset(target: Path, header: Header, *, ignored: Sequence[str] = ()) -> dict[str, Any] | None:
    """Return the description of this dataset if it is in the folder; refuse any other content than ``ignored``."""
    if not (target / "dataset.json").is_file():
        if target.is_dir() and not all(any(map(inner.match, ignored)) for inner in target.iterdir()):
            raise DatasetError(f"{target}: is not empty and contains no dataset; choose another folder")
        return None
    described = read_description(target)
    stated, config = described["id"], described.get("config") or {}
    if stated == header.id:
        return described
    imported = header.origin == "imported"
    if (version := described.get("data_version")) != DATA_VERSION:
        again = "import RECORDINGS --labels LABELS" if imported else "build PLAN"
        raise DatasetError(
            f"{target}: was made with data version {version}, this doppelgait has {DATA_VERSION} and makes other "
            f"bytes; make the dataset again in another folder: doppelgait dataset {again} -o FOLDER"
        )
    origin, what = described.get("origin", "another"), "other recordings, labels or settings"
    if not imported:
        changes = list(list_differences(config, dict(header.config)))
        what = f"another configuration ({list_some(changes, 6, '; ') or 'other motion files or plug-ins'})"
    raise DatasetError(
        f"{target}: holds {origin} dataset {stated} of {what}; choose another folder, or delete this one"
    )


def write_description(target: Path, description: Mapping[str, Any]) -> None:
    """Write ``dataset.json``."""
    write_atomically(target / "dataset.json", (json.dumps(description, indent=2) + "\n").encode())


def write_splits(folder: Path, index: pd.DataFrame) -> None:
    """Write the ids of every split, one per line."""
    folder.mkdir(exist_ok=True)
    for split in SPLITS:
        ids: Iterable[str] = index["id"][index["split"] == split] if len(index) else ()
        write_atomically(folder / f"{split}.txt", "".join(f"{name}\n" for name in ids).encode())


def count_shards(names: Iterable[str]) -> dict[str, int]:
    """Count the shards of every split by their names."""
    return dict(Counter(name.partition("-")[0] for name in names))


def list_shard_names(counts: Mapping[str, int]) -> list[str]:
    """List all shards by the number of every split."""
    known = isinstance(counts, Mapping) and set(counts) <= set(SPLITS)
    if not known or not all(type(n) is int and n >= 0 for n in counts.values()) or sum(counts.values()) > MAX_SHARDS:
        raise DatasetError(
            f"dataset.json: shards = {shorten(counts)} is not allowed; it must be the number of "
            f"shards of {', '.join(SPLITS)}, up to {MAX_SHARDS} in all"
        )
    return [f"{split}-{n:05d}-of-{count:05d}" for split, count in counts.items() for n in range(count)]


class _Failure(BaseModel, strict=True):
    id: str = ""
    scene_id: str = ""
    reason: str = ""


class _Row(_Failure):
    label: str


class StatedRecord(BaseModel, strict=True):
    """Record of a shard, as far as every reader relies on it."""

    shard: str
    sha256: str
    rows: list[_Row]
    bytes: int
    failures: list[_Failure]
    contents_sha256: str = ""  # datasets of version 0.1 have none


def read_records(target: Path, names: Iterable[str]) -> Iterator[Record]:
    """Yield shard records, reading one at a time."""
    for name in names:
        raise_if_stopped()
        yield read_record(target / "shards" / f"{name}.json")


def read_record(path: Path) -> Record:
    """Read the record of a shard."""
    record = parse_json(read_document(path))
    try:
        StatedRecord.model_validate(record)
    except ValidationError as error:
        fault = next(iter(error.errors()[0]["loc"]), "record")
        raise DatasetError(
            f"{path}: {fault} is missing or damaged; remove the shard and build the dataset again"
        ) from None
    return {"contents_sha256": "", **record}


def find_shard(
    folder: Path, name: str, identity: str | None, *, quick: bool = False
) -> tuple[Literal["done", "missing", "damaged"], Record]:
    """Return the state of a shard, and its record if it is done; ``quick``: without its hash."""
    raise_if_stopped()
    path = folder / "shards" / f"{name}.h5"
    try:
        record = read_record(path.with_suffix(".json"))
        stated = (record["shard"], record["bytes"], identity and record.get("dataset"))
        if stated == (name, path.stat().st_size, identity) and (quick or hash_file(path) == record["sha256"]):
            return "done", record
    except FileNotFoundError as error:
        return "damaged" if str(error.filename) == str(path) else "missing", {}
    except (OSError, ValueError, RecursionError, DatasetError):
        pass
    return "damaged", {}


def tally(records: Iterable[Record]) -> Totals:
    """Count rows and failures of records, and find columns."""
    totals, contents = Totals(), hashlib.sha256()
    for record in records:
        totals.hashes[record["shard"]] = record["sha256"]
        contents.update(record["contents_sha256"].encode())
        totals.rows += len(record["rows"])
        totals.bytes += record["bytes"]
        totals.n_failed += len(record["failures"])
        totals.failures += record["failures"][: FAILURES_KEPT - len(totals.failures)]
        for row in record["rows"]:
            totals.counts[row["label"]] += 1
            totals.n_not_tracked += "not_tracked" in str(row.get("flags")).split(";")
            for name, value in row.items():
                if isinstance(value, str) or name in TEXT_COLUMNS:
                    totals.columns[name] = TEXT
                else:
                    totals.columns.setdefault(name, INTEGER if name == "row" else NUMBER)
    totals.columns["shard_sha256"] = TEXT
    totals.contents_sha256 = contents.hexdigest()
    return totals


def make_index(records: Iterable[Record]) -> pd.DataFrame:
    """Make the index table, one row per target."""
    kept = list(records)
    frame: pd.DataFrame = _make_table(_iterate_rows(kept), tally(kept).columns).to_pandas()
    return frame


def write_index(path: Path, records: Iterable[Record], columns: Mapping[str, str], identity: str) -> None:
    """Write the index as Parquet, block by block."""
    import pyarrow.parquet as pq

    rows, schema = _iterate_rows(records), _make_table([], columns).schema.with_metadata({"dataset": identity})
    with open_atomically(path, os_errors=True) as partial, pq.ParquetWriter(partial, schema) as writer:
        while block := list(islice(rows, ROWS_AT_A_TIME)):
            writer.write_table(_make_table(block, columns).cast(schema))


def _iterate_rows(records: Iterable[Record]) -> Iterator[dict[str, Any]]:
    return ({**row, "shard_sha256": record["sha256"]} for record in records for row in record["rows"])


def _make_table(rows: Iterable[Mapping[str, Any]], columns: Mapping[str, str]) -> pa.Table:
    import pyarrow as pa

    block, arrays = list(rows), {}
    for name, kind in columns.items():
        values = [row.get(name) for row in block]
        try:
            if kind == NUMBER:
                values = [None if value is None else float(value) for value in values]
            arrays[INDEX_NAMES.get(name, name)] = pa.array(values, type=pa.type_for_alias(kind))
        except (TypeError, ValueError, OverflowError) as error:
            raise DatasetError(f"a record's {name} is damaged: {error}; build its shard again") from None
    return pa.table(arrays)
