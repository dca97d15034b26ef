"""The folder of an imported dataset: shards as they come, then what makes it a dataset."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from doppelgait import __version__
from doppelgait.core.errors import DatasetError
from doppelgait.core.files import file_sha256, write_atomically
from doppelgait.dataset.config import SPLITS
from doppelgait.dataset.finish import (
    DATA_VERSION,
    SCHEMA_VERSION,
    Totals,
    contents_sha256,
    count_shards,
    read_records,
    tally,
    write_description,
    write_index,
    write_splits,
)
from doppelgait.dataset.importing.card import import_card
from doppelgait.dataset.importing.config import ImportConfig
from doppelgait.dataset.importing.examples import Imported
from doppelgait.dataset.importing.splits import PlannedEntry
from doppelgait.dataset.shard import write_shard
from doppelgait.dataset.shard_files import facts_of
from doppelgait.features import FEATURE_UNITS


@contextmanager
def new_folder(target: Path) -> Iterator[Path]:
    """Folder to fill; it takes its name when the block ends well, and is gone if not.

    Raises
    ------
    DatasetError
        If the target holds something, or another import is at work on it.
    OSError
        If it cannot be written.
    """
    if target.is_dir() and any(target.iterdir()):
        raise DatasetError(f"{target}: is not empty; import into another folder")
    partial = target.with_name(target.name + ".partial")
    try:
        partial.mkdir(parents=True)
    except FileExistsError:
        raise DatasetError(f"{partial}: another import runs here or was interrupted; delete it and try again") from None
    try:
        yield partial
        if target.is_dir():
            target.rmdir()
        partial.rename(target)
    except BaseException:
        shutil.rmtree(partial, ignore_errors=True)
        raise


class ShardWriter:
    """Rows and arrays into shards of one split each, in the order in which they come.

    A recording's rows are in one shard. Names tell how many shards there are, so files get theirs at the end.

    Parameters
    ----------
    folder : Path
    size : int
        Recordings in a shard.
    """

    def __init__(self, folder: Path, size: int) -> None:
        self.folder = folder / "shards"
        self.folder.mkdir()
        self.size = size
        self._waiting: dict[str, list[Imported]] = {split: [] for split in SPLITS}
        self._records: dict[str, list[dict[str, Any]]] = {split: [] for split in SPLITS}

    def add(self, split: str, made: Imported) -> None:
        """Take what became of a recording; a full shard is written."""
        waiting = self._waiting[split]
        waiting.append(made)
        if len(waiting) >= self.size:
            self._write(split)

    def _write(self, split: str) -> None:
        waiting, self._waiting[split] = self._waiting[split], []
        rows = [row for made in waiting for row in made.rows]
        arrays = [stored for made in waiting for stored in made.arrays]
        path = self.folder / f"{split}-{len(self._records[split]):05d}.h5"
        write_shard(path, split, [row["id"] for row in rows], arrays)
        record = {
            "sha256": file_sha256(path),
            "bytes": path.stat().st_size,
            "rows": [{**row, "row": number} for number, row in enumerate(rows)],
            "failures": [failure for made in waiting for failure in made.failures],
        }
        path.with_suffix(".json").write_text(json.dumps(record, allow_nan=False))
        self._records[split].append({"path": path})

    def close(self) -> list[str]:
        """Write what waits and give all shards their names, which are returned."""
        names = []
        for split in SPLITS:
            if self._waiting[split]:
                self._write(split)
            count = len(self._records[split])
            for number, one in enumerate(self._records[split]):
                names.append(f"{split}-{number:05d}-of-{count:05d}")
                self._name(one["path"], names[-1])
        return names

    def _name(self, path: Path, name: str) -> None:
        record = json.loads(path.with_suffix(".json").read_text())
        rows = [{**row, "shard": name} for row in record.pop("rows")]
        path.rename(self.folder / f"{name}.h5")
        write_atomically(self.folder / f"{name}.json", json.dumps({"shard": name, **record, "rows": rows}).encode())
        path.with_suffix(".json").unlink()


def finish(
    folder: Path, names: Sequence[str], planned: Sequence[PlannedEntry], *, name: str, identity: str,
    config: ImportConfig, labels: str,
) -> Totals:  # fmt: skip
    """Write index, split lists, card and, last, the description.

    Parameters
    ----------
    folder : Path
    names : sequence of str
        Shards, from :meth:`ShardWriter.close`.
    planned : sequence of PlannedEntry
    name, identity : str
        Of the dataset.
    config : ImportConfig
    labels : str
        Name of the file of labels.

    Raises
    ------
    DatasetError
        If there is not one row.
    """
    import pandas as pd

    totals = tally(read_records(folder, names))
    if not totals.rows:
        first = totals.failures[0]
        raise DatasetError(
            f"{labels}: none of {len(planned)} recordings can be imported; the first, {first['id']}: {first['reason']}"
        )
    write_index(folder / "index.parquet", read_records(folder, names), totals.columns)
    index = pd.read_parquet(folder / "index.parquet")
    write_splits(folder / "splits", index)
    card = import_card(index, name=name, identity=identity, config=config, labels=labels, n_failed=totals.n_failed)
    write_atomically(folder / "README.md", card.encode())
    description = _describe(names, planned, name, identity, config, totals)
    write_description(folder, {**description, "contents_sha256": contents_sha256(folder, names)})
    return totals


def _describe(
    names: Sequence[str],
    planned: Sequence[PlannedEntry],
    name: str,
    identity: str,
    config: ImportConfig,
    totals: Totals,
) -> Mapping[str, Any]:
    labels = dict.fromkeys(one.entry.label for one in planned)
    return {
        "id": identity,
        "name": name,
        "complete": totals.n_failed == 0,
        "origin": "imported",
        "schema_version": SCHEMA_VERSION,
        "data_version": DATA_VERSION,
        "classes": {label: number for number, label in enumerate(labels)},
        "features": FEATURE_UNITS,
        "fields": facts_of(config.fields),
        "shards": count_shards(names),
        "n_examples": len(planned),
        "config": config_as_dict(config),
        "doppelgait_version": __version__,
    }


def config_as_dict(config: ImportConfig) -> dict[str, Any]:
    """Configuration as JSON; of the analysis what was given by hand, because that can mean more than its value."""
    return {**config.model_dump(mode="json"), "analysis": config.analysis.model_dump(mode="json", exclude_unset=True)}


def log(folder: Path, entry: Mapping[str, Any]) -> None:
    """Add a line to ``build.jsonl``."""
    stamp = {"time": datetime.now(UTC).isoformat(timespec="seconds")}
    with (folder / "build.jsonl").open("a") as handle:
        handle.write(json.dumps({**stamp, **entry}) + "\n")
