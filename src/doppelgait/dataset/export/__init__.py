"""Datasets in other forms: tables, WebDataset, Zarr, SigMF."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from doppelgait.core.errors import DatasetError, OutputError
from doppelgait.dataset.export.sigmf_folder import write_sigmf_folder
from doppelgait.dataset.export.tables import write_csv, write_parquet
from doppelgait.dataset.export.webdataset import write_webdataset
from doppelgait.dataset.export.zarr_store import write_zarr
from doppelgait.dataset.licences import blocked_recordings
from doppelgait.dataset.open import Dataset

__all__ = ["FORMS", "ExportReport", "Form", "export_dataset", "refuse_unreleasable"]

Progress = Callable[[int, int], None]
Writer = Callable[[Dataset, Path, tuple[str, ...], Callable[[int], None]], None]
"""Writes a dataset and the fields asked for into an empty folder; calls back with the number of rows done since."""

SHOWN_FILES = 8


@dataclass(frozen=True)
class Form:
    """A form that datasets can be exported in.

    Parameters
    ----------
    write : callable
    allowed : sequence of str, optional
        Fields that it can hold; None for all.
    default : sequence of str, optional
        Fields where none are named; None for all that the dataset keeps.
    """

    write: Writer
    allowed: Sequence[str] | None = None
    default: Sequence[str] | None = None


FORMS: dict[str, Form] = {
    "parquet": Form(write_parquet, default=()),
    "csv": Form(write_csv, allowed=(), default=()),
    "webdataset": Form(write_webdataset),
    "zarr": Form(write_zarr),
    "sigmf": Form(write_sigmf_folder, allowed=("baseband",), default=("baseband",)),
}


@dataclass(frozen=True)
class ExportReport:
    """What an export wrote.

    Parameters
    ----------
    directory : Path
    form : str
    n_rows, n_files, bytes : int
        Rows of the dataset, files written and their size.
    """

    directory: Path
    form: str
    n_rows: int
    n_files: int
    bytes: int


def export_dataset(
    dataset: Dataset, destination: str | Path, *, form: str, fields: Sequence[str] | None = None,
    release: bool = False, on_progress: Progress | None = None,
) -> ExportReport:  # fmt: skip
    """Write a dataset, or a part of it, in another form; the folder appears complete or not at all.

    Beside the data stand ``dataset.json``, with what was exported under ``export``, and ``source-card.md``, the card of
    the dataset that it comes from. Arrays are in linear units and single precision.

    Parameters
    ----------
    dataset : Dataset
    destination : path-like
        Folder to make; it must not be there yet.
    form : {"parquet", "csv", "webdataset", "zarr", "sigmf"}
    fields : sequence of str, optional
        Arrays to write; by default none into tables, the baseband into SigMF and all into the others.
    release : bool
        The export is meant for others: refuse it where a licence of its sources does not allow that.
    on_progress : callable, optional
        Called with (rows done, rows in total).

    Raises
    ------
    DatasetError
        If the form or a field is not known, the destination is there, there is nothing to export, or ``release`` is
        asked for and a licence is non-commercial or unknown.
    OutputError
        If it cannot be written; nothing is left of it then.
    """
    target = Path(destination)
    if form not in FORMS:
        raise DatasetError(f"form: {form!r} is not allowed; known are {', '.join(FORMS)}")
    chosen = _chosen_fields(dataset, form, fields)
    if len(dataset) == 0:
        raise DatasetError(f"{dataset.directory}: nothing is selected, so there is nothing to export")
    if release:
        refuse_unreleasable(dataset)
    done = 0

    def count(rows: int) -> None:
        nonlocal done
        done += rows
        if on_progress is not None:
            on_progress(done, len(dataset))

    with _new_folder(target) as partial:
        FORMS[form].write(dataset, partial, chosen, count)
        _describe(dataset, partial, form, chosen)
    files = [path for path in target.rglob("*") if path.is_file()]
    return ExportReport(target, form, len(dataset), len(files), sum(path.stat().st_size for path in files))


def _chosen_fields(dataset: Dataset, form: str, fields: Sequence[str] | None) -> tuple[str, ...]:
    known, allowed, default = dataset.description["fields"], FORMS[form].allowed, FORMS[form].default
    if fields is None:
        fields = list(known) if default is None else default
    for name in fields:
        if allowed is not None and name not in allowed:
            raise DatasetError(f"fields: {form} holds {' and '.join(allowed) or 'no arrays'} only, not {name!r}")
    dataset.check_fields(fields)
    if form == "sigmf" and not fields:
        raise DatasetError("fields: sigmf needs the baseband")
    return tuple(dict.fromkeys(fields))


def refuse_unreleasable(dataset: Dataset) -> None:
    """A :class:`DatasetError` that names every recording of a dataset that its licence keeps from being handed on.

    Everybody who is in a scene counts, selected or not: the echoes of all are in its arrays.
    """
    whole = pd.read_parquet(dataset.directory / "index.parquet")
    names = blocked_recordings(whole[whole["scene_id"].isin(dataset.index["scene_id"])])
    if names:
        more = f" and {len(names) - SHOWN_FILES} more" if len(names) > SHOWN_FILES else ""
        raise DatasetError(
            f"{dataset.directory}: cannot be released, since recordings have a non-commercial or unknown licence: "
            f"{', '.join(names[:SHOWN_FILES])}{more}; state their licences under [[sources]], or leave them out"
        )


@contextmanager
def _new_folder(target: Path) -> Iterator[Path]:
    """Folder beside ``target`` that takes its name when the block ends well and is removed if not."""
    partial = target.with_name(target.name + ".partial")
    if target.exists():
        raise DatasetError(f"{target}: is there already; nothing is overwritten, choose another folder")
    try:
        partial.mkdir(parents=True)
    except FileExistsError:
        raise DatasetError(f"{partial}: another export runs here or was interrupted; delete it and try again") from None
    except OSError as error:
        raise OutputError(f"{target}: cannot be written: {error}") from None
    try:
        yield partial
        partial.rename(target)
    except (OSError, OutputError) as error:
        cause = (
            error.__context__ if isinstance(error, OutputError) else error
        )  # the writer of a form named its own file
        raise OutputError(f"{target}: cannot be written: {cause}; nothing is left of the export") from None
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def _describe(dataset: Dataset, folder: Path, form: str, fields: tuple[str, ...]) -> None:
    counts = {str(split): int(n) for split, n in dataset.index["split"].value_counts().sort_index().items()}
    export = {"form": form, "fields": fields, "rows": counts}
    text = json.dumps({**dataset.description, "export": export}, indent=2)
    (folder / "dataset.json").write_text(text + "\n", encoding="utf-8")
    card = dataset.directory / "README.md"
    if card.is_file():
        shutil.copyfile(card, folder / "source-card.md")
