"""``doppelgait reproduce``: Liland's (2018) figures and tables, judged."""

from __future__ import annotations

import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer


class FigureFormat(StrEnum):
    """Formats of figure files."""

    png = "png"
    svg = "svg"
    pdf = "pdf"


def reproduce(
    output: Annotated[Path, typer.Argument(help="Folder to write; the folder of an earlier run is replaced.")],
    only: Annotated[
        list[str] | None,
        typer.Option("--only", help="Reproduce only this figure or table, for example fig-4.13; repeatable."),
    ] = None,
    motion_folder: Annotated[
        Path | None,
        typer.Option(
            "--motion-folder", help="Folder with human/ and dog/: motion recordings to use instead of models."
        ),
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the random numbers in the scenarios.")] = 2018,
    figure_format: Annotated[
        FigureFormat,
        typer.Option("--format", help="Format of the figures; svg and pdf are in addition to the page's png."),
    ] = FigureFormat.png,
    quiet: Annotated[bool, typer.Option("--quiet", help="No progress.")] = False,
) -> None:
    """Reproduce the figures and tables of Liland (2018).

    Every value is shown next to the value of the report.

    Example: doppelgait reproduce liland

    Example: doppelgait reproduce report --motion-folder MOCAP

    Example: doppelgait reproduce some --only fig-4.13 --only table-3.2
    """
    from doppelgait_liland2018.entry import KINDS
    from doppelgait_liland2018.run import reproduce as make_all

    def show(done: int, total: int) -> None:
        if 10 * done // total > 10 * (done - 1) // total:  # every tenth
            print(f"figures and tables: {done} of {total}", file=sys.stderr)

    outcomes = make_all(
        output,
        only=only or (),
        motion_folder=motion_folder,
        seed=seed,
        figure_format=figure_format,
        progress=None if quiet else show,
    )
    cells: list[tuple[str, ...]] = [("number", "agree", "set", "differ", "not stated", "seconds", "title")]
    for outcome in outcomes:
        counts = [str(outcome.count_kind(kind)) for kind in KINDS]
        title = outcome.entry.title if outcome.made else f"NOT MADE: {outcome.error}"
        cells.append((outcome.entry.number, *counts, f"{outcome.seconds:.1f}", title))
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    for line in cells:
        print("  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip())
    print(f"page: {output / 'index.html'}", file=sys.stderr)
    failed = [outcome.entry.number for outcome in outcomes if outcome.made is None]
    if failed:
        reason = "could not be reproduced from these motions; the page has the reasons"
        print(f"error: {', '.join(failed)} {reason}", file=sys.stderr)
        raise typer.Exit(1)
