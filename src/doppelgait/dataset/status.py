"""Status of a dataset."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from doppelgait.core.documents import parse_json, read_document
from doppelgait.core.files import hash_file
from doppelgait.dataset.config import SPLITS
from doppelgait.dataset.finish import list_shard_names, read_description
from doppelgait.dataset.lock import PATTERN, list_running_builds, read_lock


@dataclass(frozen=True)
class ShardStatus:
    """State of one shard."""

    name: str
    state: Literal["done", "missing", "damaged"]
    n_examples: int = 0
    n_failed: int = 0


@dataclass(frozen=True)
class Status:
    """State of a dataset's folder."""

    directory: Path
    dataset_id: str
    name: str
    complete: bool
    planned: int
    shards: tuple[ShardStatus, ...]
    running: tuple[str, ...]
    partial: tuple[str, ...]
    removed: tuple[str, ...]

    def count(self, state: str) -> int:
        """Count the shards in a state."""
        return sum(shard.state == state for shard in self.shards)

    @property
    def n_examples(self) -> int:
        """Examples in shards that are done."""
        return sum(shard.n_examples for shard in self.shards)

    @property
    def n_failed(self) -> int:
        """Examples that failed, in shards that are done."""
        return sum(shard.n_failed for shard in self.shards)


def read_dataset_status(directory: str | Path, *, quick: bool = False) -> Status:
    """Report the status of a dataset."""
    folder = Path(directory)
    description = read_description(folder)
    running = list_running_builds(folder)
    counts = description.get("shards")
    if not counts:  # from the names of the shards that are there
        found = (path.stem.split("-") for path in sorted((folder / "shards").glob("*-*-of-*.h5")))
        named = (parts for parts in found if len(parts) == 4 and parts[0] in SPLITS and parts[3].isdecimal())
        counts = {split: int(count) for split, _, _, count in named}
    identity = description.get("id") if description.get("schema_version", 0) >= 3 else None
    removed = []
    for path in () if running else sorted([*folder.rglob("*.partial"), *folder.glob(PATTERN)]):
        holder = read_lock(path) if path.suffix == ".lock" else None
        if (holder is None or not holder.alive) and not path.is_dir():
            path.unlink(missing_ok=True)
            removed.append(str(path.relative_to(folder)))
    return Status(
        directory=folder,
        dataset_id=str(description.get("id")),
        name=str(description.get("name")),
        complete=bool(description.get("complete")),
        planned=int(description.get("n_examples", 0)),
        shards=tuple(_read_shard_status(folder, name, identity, quick=quick) for name in list_shard_names(counts)),
        running=tuple(str(holder) for holder in running),
        partial=tuple(str(path.relative_to(folder)) for path in sorted(folder.rglob("*.partial"))),
        removed=tuple(removed),
    )


def _read_shard_status(folder: Path, name: str, identity: str | None, *, quick: bool) -> ShardStatus:
    path = folder / "shards" / f"{name}.h5"
    try:
        record = parse_json(read_document(path.with_suffix(".json")))
        whole = path.stat().st_size == record["bytes"] and identity in (None, record.get("dataset"))
        whole = whole and (quick or hash_file(path) == record["sha256"])
        counts = (len({row["scene_id"] for row in record["rows"]}), len(record["failures"]))
    except FileNotFoundError as error:
        return ShardStatus(name, "damaged" if str(error.filename) == str(path) else "missing")
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        whole = False
    return ShardStatus(name, "done", *counts) if whole else ShardStatus(name, "damaged")
