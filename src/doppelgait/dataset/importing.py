"""Datasets from the user's recordings."""

from __future__ import annotations

import hashlib
import re
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from doppelgait.core.config import format_canonical_json
from doppelgait.core.documents import parse_json
from doppelgait.core.errors import ConfigError, DatasetError, OutputError
from doppelgait.core.files import hash_file
from doppelgait.core.plugins import identify_plugins
from doppelgait.dataset.build import log_entry
from doppelgait.dataset.card import import_card
from doppelgait.dataset.config import ImportConfig, Progress
from doppelgait.dataset.finish import (
    DATA_VERSION,
    SCHEMA_VERSION,
    Header,
    Totals,
    finish_dataset,
    list_shard_names,
    read_records,
    tally,
)
from doppelgait.dataset.labels import LabelEntry, hash_recording, read_labels
from doppelgait.dataset.lock import write_new_folder
from doppelgait.dataset.plan import Shard, split_into_shards
from doppelgait.dataset.recorded import RecordedExamples
from doppelgait.dataset.shard import ExampleData, build_shard
from doppelgait.dataset.splits import PlannedEntry, plan_entries

__all__ = ["ImportConfig", "ImportReport", "LabelEntry", "import_dataset", "import_id", "read_labels"]

NOT_IN_A_NAME = re.compile(r"[^A-Za-z0-9._-]+")


@dataclass(frozen=True)
class ImportReport:
    """Report of an import."""

    directory: Path
    dataset_id: str
    n_recordings: int  # recordings, or parts of them, that the labels name
    n_rows: int  # of the index: one per recording or window
    n_not_tracked: int  # rows without features, because an expected target was not found
    n_failed: int  # recordings or windows that could not be read or analysed; they are not in the dataset
    failures: list[dict[str, Any]]  # the first 100 of them: ``id``, ``reason``, ``spec`` (line, file)
    counts: dict[str, int]  # rows of every class
    bytes: int  # size of the shards
    seconds: float
    was_there: bool  # the folder already contained the same import, which is then unchanged


def import_dataset(
    folder: str | Path,
    labels: str | Path | Sequence[LabelEntry],
    directory: str | Path,
    *,
    config: ImportConfig | None = None,
    name: str | None = None,
    on_progress: Progress | None = None,
) -> ImportReport:
    """Make a dataset from recordings and a label file."""
    # Each recording, part of a recording or window is a row. The detected target gets the label. If
    # there are several, it is the track with the longest duration weighted by confidence;
    # ``n_tracks`` and a flag record this. If there is none, the row has no features and the flag
    # ``not_tracked``, so that scores count it. A recording that cannot be read or analysed is a
    # failure with its reason; the others are imported. The folder appears when it is complete, and
    # repeating the same import changes nothing.
    began = time.monotonic()
    settings = config or ImportConfig()
    source, target = Path(folder), Path(directory).absolute()
    if not source.is_dir():
        raise ConfigError(f"{source}: no such folder of recordings")
    named = Path(labels).name if isinstance(labels, str | Path) else "names of files"
    entries = read_labels(labels, source, gate=settings.gate) if isinstance(labels, str | Path) else list(labels)
    planned = plan_entries(entries, settings, named)
    hashes = {one.entry.recording: "" for one in planned}
    hashes = {recording: hash_recording(source, recording) for recording in hashes}
    plugins = identify_plugins(settings.model_dump(mode="json"), {"radar_reader": [source / name for name in hashes]})
    described: dict[str, str] = {}
    for entry in entries:
        if isinstance(config_name := entry.options.get("config"), str):  # settings files that a reader uses
            beside = (source / entry.recording).parent / config_name
            used = next((path for path in (Path(config_name), beside) if path.is_file()), None)
            described[f"option.config={config_name}"] = "" if used is None else hash_file(used)
    identity = import_id(labels, hashes | described, settings, plugins)
    there = _find_same_import(target, identity)
    if there is not None:
        return _report(target, identity, planned, there, began, was_there=True)
    title = NOT_IN_A_NAME.sub("-", name or target.name).strip("-.") or "imported"
    header = Header(
        id=identity,
        name=title,
        origin="imported",
        labels=tuple(dict.fromkeys(one.entry.label for one in planned)),
        fields=settings.fields,
        n_examples=len(planned),
        config=settings.model_dump(mode="json"),
        card=lambda index, n_failed: import_card(
            index, name=title, identity=identity, config=settings, labels=named, n_failed=n_failed
        ),
        plugins=plugins,
    )
    shards = list(split_into_shards(planned, settings.shard_size))
    names = [shard.name for shard in shards]
    try:
        if target.is_dir() and any(target.iterdir()):
            raise DatasetError(f"{target}: is not empty; import into another folder")
        with write_new_folder(target) as partial:
            _build(partial, shards, RecordedExamples(settings, source, str(partial), hashes, identity), on_progress)
            totals = tally(read_records(partial, names))
            if not totals.rows:
                first = totals.failures[0]
                raise DatasetError(
                    f"{named}: none of {len(planned)} recordings can be imported; the first, {first['id']}: "
                    f"{first['reason']}"
                )
            finish_dataset(partial, header, names)
    except (OSError, RuntimeError) as error:  # HDF5 raises RuntimeError if a file cannot be closed
        raise OutputError(
            f"{target}: cannot be written: {' '.join(str(error).split())}; no partial dataset remains"
        ) from None
    return _report(target, identity, planned, names, began, was_there=False)


def _build(folder: Path, shards: Sequence[Shard], maker: RecordedExamples, on_progress: Progress | None) -> None:
    (folder / "shards").mkdir()
    total = sum(len(shard.examples) for shard in shards)
    done, last = 0, time.monotonic()

    def tick(entry: PlannedEntry, made: ExampleData) -> None:
        nonlocal done, last
        done, now = done + 1, time.monotonic()
        facts = {"id": entry.id, "file": entry.entry.recording, "rows": len(made.rows), "seconds": round(now - last, 3)}
        log_entry(folder, {**facts, "failures": [failure["reason"] for failure in made.failures]})
        last = now
        if on_progress is not None:
            on_progress(done, total)

    for shard in shards:
        build_shard(shard, maker, tick=tick)


def import_id(
    labels: str | Path | Sequence[LabelEntry],
    hashes: dict[str, str],
    config: ImportConfig,
    plugins: Sequence[Mapping[str, Any]] = (),
) -> str:
    """Compute an import's identity: labels, recordings, configuration and data version."""
    settings = format_canonical_json(config)
    digest = hashlib.sha256(f"import {DATA_VERSION}\n{settings}\n{format_canonical_json(hashes)}\n".encode())
    if isinstance(labels, str | Path):
        digest.update(Path(labels).read_bytes())
    else:
        digest.update(format_canonical_json({"labels": [asdict(entry) for entry in labels]}).encode())
    for item in plugins:
        digest.update(format_canonical_json(item).encode())
    return digest.hexdigest()[:16]


def _find_same_import(target: Path, identity: str) -> list[str] | None:
    """Return the shards of the same import, None for an empty folder."""
    description = target / "dataset.json"
    if not description.is_file():
        return None
    try:
        found = parse_json(description.read_text())
        if (schema := found.get("schema_version")) == SCHEMA_VERSION and found["id"] == identity:
            return list_shard_names(found["shards"])
        version = found.get("data_version")
        what = f"{found.get('origin', 'another')} dataset {found['id']}"
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise DatasetError(f"{description}: is damaged: {error}; delete the folder or choose another") from None
    if schema != SCHEMA_VERSION:
        raise DatasetError(
            f"{target}: has schema version {schema}, this doppelgait writes {SCHEMA_VERSION}; import into "
            "another folder"
        )
    if version != DATA_VERSION:
        raise DatasetError(
            f"{target}: was made with data version {version}, this doppelgait has {DATA_VERSION} and makes "
            "other bytes; "
            "make the dataset again in another folder: doppelgait dataset import RECORDINGS --labels LABELS -o FOLDER"
        )
    raise DatasetError(
        f"{target}: holds {what} of other recordings, labels or settings; import into another folder, or delete it"
    )


def _report(
    target: Path, identity: str, planned: Sequence[PlannedEntry], names: Sequence[str], began: float, *, was_there: bool
) -> ImportReport:
    try:
        totals: Totals = tally(read_records(target, names))
        rows = [row for record in read_records(target, names) for row in record["rows"]]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise DatasetError(f"{target}: is damaged: {error}; delete the folder and import again") from None
    return ImportReport(
        directory=target,
        dataset_id=identity,
        n_recordings=len(planned),
        n_rows=totals.rows,
        n_not_tracked=sum("not_tracked" in row["flags"].split(";") for row in rows),
        n_failed=totals.n_failed,
        failures=totals.failures,
        counts=dict(Counter(row["label"] for row in rows)),
        bytes=totals.bytes,
        seconds=time.monotonic() - began,
        was_there=was_there,
    )
