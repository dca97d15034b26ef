"""One run of the reproduction: every entry made, judged and put on one page."""

from __future__ import annotations

import json
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from doppelgait import __version__
from doppelgait.core.errors import DoppelgaitError, DoppelgaitWarning
from doppelgait.core.own_folder import PAGE, check_out, complete_folder
from doppelgait.reproduce.catalogue import all_entries, pick
from doppelgait.reproduce.entry import Entry, Made
from doppelgait.reproduce.material import Material
from doppelgait.reproduce.outcome import Outcome
from doppelgait.reproduce.page import page
from doppelgait.viz.style import save_figure

FORMAT, FORMAT_VERSION = "doppelgait-reproduction", 1
READINGS = "readings.json"


def reproduce(
    out: Path, *, only: Sequence[str] = (), motion_folder: Path | None = None, seed: int = 2018,
    progress: Callable[[int, int], None] | None = None,
) -> list[Outcome]:  # fmt: skip
    """Make the report's figures and tables and the page that judges them.

    Parameters
    ----------
    out : Path
        Folder to make, or one of an earlier run to replace: ``index.html``, ``readings.json``, ``figures/*.png`` and
        ``tables/*.csv``.
    only : sequence of str
        Numbers to make, such as "fig-4.13"; all by default.
    motion_folder : Path, optional
        Folder with ``human/`` and ``dog/``: real recordings in place of the models.
    seed : int
        Root of what is random in the study of scenarios.
    progress : callable, optional
        Called with (entries made, entries in total).

    Returns
    -------
    list of Outcome
        In the order of the report. An entry that cannot be made of the given motions says so; the others are made.

    Raises
    ------
    ConfigError
        If ``out`` holds something else, a number is not known, or the motion folder has no people and no dogs.
    OutputError
        If the folder cannot be written; what was there before is untouched.
    """
    check_out(out, listing=READINGS, file_format=FORMAT, command="reproduce")
    entries = pick(all_entries(), only)
    material = Material(seed=seed, motion_folder=motion_folder)
    outcomes = []
    with complete_folder(out) as folder:
        for name in ("figures", "tables"):
            (folder / name).mkdir()
        for number, entry in enumerate(entries, start=1):
            outcomes.append(_outcome(entry, material, folder))
            if progress is not None:
                progress(number, len(entries))
        _write_summary(outcomes, material, folder)
    return outcomes


def _outcome(entry: Entry, material: Material, folder: Path) -> Outcome:
    """Make an entry and write its figure and table; a fault of its motion is said, not raised."""
    began = time.perf_counter()
    made, error = None, ""
    material.begin_entry()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", DoppelgaitWarning)
        try:
            made = entry.make(material)
        except DoppelgaitError as fault:
            error = str(fault)
    outcome = Outcome(entry, made, material.used(), _remarks(caught), error=error)
    if made is not None:
        _write(outcome, made, folder)
    return replace(outcome, seconds=time.perf_counter() - began)


def _remarks(caught: Sequence[warnings.WarningMessage]) -> list[str]:
    """Our own warnings as texts, each once; others are said again, they are for whoever runs this."""
    for one in caught:
        if not issubclass(one.category, DoppelgaitWarning):
            warnings.warn_explicit(one.message, one.category, one.filename, one.lineno)
    return list(dict.fromkeys(str(one.message) for one in caught if issubclass(one.category, DoppelgaitWarning)))


def _write(outcome: Outcome, made: Made, folder: Path) -> None:
    if made.figure is not None and outcome.figure_path:
        save_figure(made.figure, folder / outcome.figure_path)
    if made.table is not None and outcome.table_path:
        made.table.to_csv(folder / outcome.table_path, index=False)


def _write_summary(outcomes: Sequence[Outcome], material: Material, folder: Path) -> None:
    document = {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "doppelgait": __version__,
        "seed": material.seed,
        "recordings": material.motion_folder is not None,
        "entries": [outcome.as_dict() for outcome in outcomes],
        "files": sorted(path for one in outcomes for path in (one.figure_path, one.table_path) if path),
    }
    text = json.dumps(document, indent=2, allow_nan=False)
    (folder / READINGS).write_text(text + "\n", encoding="utf-8")
    (folder / PAGE).write_text(page(outcomes, recordings=material.motion_folder is not None), encoding="utf-8")
