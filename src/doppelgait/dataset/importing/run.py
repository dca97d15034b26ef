"""Import: recordings and labels in, a dataset out."""

from __future__ import annotations

import hashlib
import json
import re
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from doppelgait.core.config import canonical_json
from doppelgait.core.errors import ConfigError, DatasetError, OutputError
from doppelgait.dataset.finish import DATA_VERSION, Totals, read_records, shard_names, tally
from doppelgait.dataset.importing.config import ImportConfig
from doppelgait.dataset.importing.examples import import_entry, make_reader
from doppelgait.dataset.importing.folder import ShardWriter, config_as_dict, finish, log, new_folder
from doppelgait.dataset.importing.labels import read_labels, recording_sha256
from doppelgait.dataset.importing.splits import PlannedEntry, plan_entries

Progress = Callable[[int, int], None]

NOT_IN_A_NAME = re.compile(r"[^A-Za-z0-9._-]+")


@dataclass(frozen=True)
class ImportReport:
    """What an import did.

    Parameters
    ----------
    directory : Path
    dataset_id : str
    n_recordings : int
        Recordings, or parts of them, that the labels name.
    n_rows : int
        Rows of the index: one per recording or window.
    n_not_tracked : int
        Rows without features, because nobody was found where somebody should be.
    n_failed : int
        Recordings or windows that could not be read or analysed; they are not in the dataset.
    failures : list of dict
        The first 100 of them: ``id``, ``reason``, ``spec`` (line, file).
    counts : dict
        Rows of every class.
    bytes : int
        Size of the shards.
    seconds : float
    was_there : bool
        Whether the folder held the very same import, which then was left as it is.
    """

    directory: Path
    dataset_id: str
    n_recordings: int
    n_rows: int
    n_not_tracked: int
    n_failed: int
    failures: list[dict[str, Any]]
    counts: dict[str, int]
    bytes: int
    seconds: float
    was_there: bool


def import_dataset(
    folder: str | Path, labels: str | Path, directory: str | Path, *, config: ImportConfig | None = None,
    name: str | None = None, on_progress: Progress | None = None,
) -> ImportReport:  # fmt: skip
    """Make a dataset from a folder of radar recordings and a file that says what they show.

    Each recording, part of one or window is a row: the target that is found in it gets the label. Where several are
    found it is the one that was followed longest and surest; ``n_tracks`` and a flag tell. Where none is found the row
    has no features and the flag ``not_tracked``, so that a score counts it.

    Parameters
    ----------
    folder : path
        Recordings of any format that :func:`doppelgait.radar.read_recording` reads.
    labels : path
        See :func:`doppelgait.dataset.importing.read_labels`.
    directory : path
        Folder of the dataset; it appears when it is complete. Importing the same into it again changes nothing.
    config : ImportConfig, optional
    name : str, optional
        Of the dataset; that of the folder by default.
    on_progress : callable, optional
        Called with (recordings done, recordings in total).

    Returns
    -------
    ImportReport
        A recording that cannot be read or analysed is a failure with its reason; the others are imported.

    Raises
    ------
    ConfigError
        If a line of the labels is wrong, or a parameter is not allowed.
    DatasetError
        If the folder holds something else, not one recording can be imported, or the splits asked for are impossible.
    OutputError
        If the folder cannot be written or the disk is full; nothing is left of it then.
    """
    began = time.monotonic()
    settings = config or ImportConfig()
    source, target, table = Path(folder), Path(directory).absolute(), Path(labels)
    if not source.is_dir():
        raise ConfigError(f"{source}: no such folder of recordings")
    entries = read_labels(table, source, gate=settings.gate)
    planned = plan_entries(entries, settings, table.name)
    hashes = {one.entry.recording: "" for one in planned}
    hashes = {recording: recording_sha256(source, recording) for recording in hashes}
    identity = import_id(table, hashes, settings)
    there = _same_import(target, identity)
    if there is not None:
        return _report(target, identity, planned, there, began, was_there=True)
    title = NOT_IN_A_NAME.sub("-", name or target.name).strip("-.") or "imported"
    try:
        with new_folder(target) as partial:
            names = _import_all(partial, source, planned, hashes, settings, on_progress)
            finish(partial, names, planned, name=title, identity=identity, config=settings, labels=table.name)
    except (OSError, RuntimeError) as error:  # HDF5 says RuntimeError where a file cannot be closed
        raise OutputError(
            f"{target}: cannot be written: {' '.join(str(error).split())}; nothing is left of it"
        ) from None
    return _report(target, identity, planned, names, began, was_there=False)


def import_id(labels: Path, hashes: dict[str, str], config: ImportConfig) -> str:
    """Identity of an import: hash of labels, recordings, configuration and data version; 16 hex digits.

    Parameters
    ----------
    labels : Path
        The file.
    hashes : dict
        SHA-256 of every recording by its path in the folder.
    config : ImportConfig
    """
    settings = canonical_json(config_as_dict(config) | {"defaults": config.analysis.model_dump(mode="json")})
    digest = hashlib.sha256(f"import {DATA_VERSION}\n{settings}\n{canonical_json(hashes)}\n".encode())
    digest.update(labels.read_bytes())
    return digest.hexdigest()[:16]


def _same_import(target: Path, identity: str) -> list[str] | None:
    """Shards of the same import if the folder holds it, None if it holds nothing; anything else is an error."""
    description = target / "dataset.json"
    if not description.is_file():
        return None
    try:
        found = json.loads(description.read_text())
        if found["id"] == identity:
            return shard_names(found["shards"])
        what = f"{found.get('origin', 'another')} dataset {found['id']}"
    except (ValueError, KeyError, TypeError) as error:
        raise DatasetError(f"{description}: is damaged: {error}; delete the folder or choose another") from None
    raise DatasetError(
        f"{target}: holds {what} of other recordings, labels or settings; import into another folder, or delete it"
    )


def _import_all(
    partial: Path, source: Path, planned: Sequence[PlannedEntry], hashes: dict[str, str], config: ImportConfig,
    on_progress: Progress | None,
) -> list[str]:  # fmt: skip
    """Import every recording; names of the shards."""
    writer, read = ShardWriter(partial, config.shard_size), make_reader(source)
    for number, one in enumerate(planned, start=1):
        began = time.monotonic()
        made = import_entry(one, read, source, config, hashes[one.entry.recording])
        writer.add(one.split, made)
        seconds = round(time.monotonic() - began, 3)
        facts = {"id": one.id, "file": one.entry.recording, "rows": len(made.rows), "seconds": seconds}
        log(partial, {**facts, "failures": [failure["reason"] for failure in made.failures]})
        if on_progress is not None:
            on_progress(number, len(planned))
    return writer.close()


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
