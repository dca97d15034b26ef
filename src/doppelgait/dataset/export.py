"""Datasets in other forms: tables, WebDataset, Zarr, SigMF."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import numpy.typing as npt
import pandas as pd

from doppelgait.core.config import FrozenModel
from doppelgait.core.errors import DatasetError
from doppelgait.core.plugins import Group
from doppelgait.dataset.card import list_blocked_recordings
from doppelgait.dataset.config import SPLITS, Progress, list_some
from doppelgait.dataset.lock import write_new_folder
from doppelgait.dataset.open import Dataset
from doppelgait.dataset.shard_files import name_axis

__all__ = ["EXPORTERS", "ExportReport", "export_dataset", "refuse_unreleasable"]

Exporter = Callable[["Dataset", Path, tuple[str, ...], Any, Callable[[int], None]], None]
"""Writer, called with (dataset, empty folder, fields, parameters, done). It calls ``done`` with the number of rows
written since the last call."""

EXPORTERS: Group[Exporter] = Group("exporter", built_in=("doppelgait.dataset.exporters",), noun="form")
"""Export formats of datasets.
Facts of an exporter: ``allowed``, the fields that it supports (by default all); ``default``, the
fields that are written if none are named (by default all stored fields); ``least``, the minimum
number of fields (by default 0).
"""

SHOWN_FILES = 8


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
    # Next to the data are ``dataset.json``, with what was exported under ``export``, and ``source-card.md``, the card
    # of the source dataset. Arrays are in linear units and single precision. The form is the name of an exporter, or a
    # table of its parameters: {"kind": "webdataset", "examples_per_tar": 500}.
    target = Path(destination)
    parameters = EXPORTERS.parse(form)
    exporter = EXPORTERS.of(parameters)
    name, allowed, known = exporter.name, exporter.facts.get("allowed"), dataset.description["fields"]
    if fields is None:
        fields = exporter.facts.get("default", tuple(known))
    for field in fields:
        if allowed is not None and field not in allowed:
            raise DatasetError(f"fields: {name} holds {' and '.join(allowed) or 'no arrays'} only, not {field!r}")
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
            f"{list_some(names, SHOWN_FILES)}; state their licences under [[sources]], or leave them out"
        )


PLACES = ("shard", "row", "shard_sha256")
"""Columns with the position of a row's arrays in the dataset."""


def iterate_splits(dataset: Dataset) -> Iterator[tuple[str, npt.NDArray[np.int64]]]:
    """Yield every split that has rows, with its rows."""
    for split in SPLITS:
        rows = np.flatnonzero((dataset.index["split"] == split).to_numpy(dtype=bool))
        if rows.size:
            yield split, rows


def flatten_index(dataset: Dataset) -> pd.DataFrame:
    """Return the index with ``class_number``, without positions in shard files."""
    table = dataset.index.drop(columns=list(PLACES), errors="ignore")
    table.insert(list(table.columns).index("label") + 1, "class_number", dataset.class_numbers())
    return table


def read_arrays(dataset: Dataset, row: int, fields: tuple[str, ...]) -> dict[str, npt.NDArray[np.generic]]:
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
