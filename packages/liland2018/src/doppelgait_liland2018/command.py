"""``doppelgait reproduce``: Liland's (2018) figures and tables, judged."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from doppelgait.cli.output import FigureFormat, PageFigureOption, print_message, print_table, report_progress


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
    figure_format: PageFigureOption = FigureFormat.png,
    quiet: Annotated[bool, typer.Option("--quiet", help="No progress.")] = False,
) -> None:
    """Reproduce the figures and tables of Liland (2018).

    Every value is shown next to the value of the report.

    Example: doppelgait reproduce liland

    Example: doppelgait reproduce report --motion-folder MOCAP

    Example: doppelgait reproduce some --only fig-4.13 --only table-3.2
    """
    from doppelgait_liland2018.run import reproduce as make_all

    with report_progress("figures and tables", quiet=quiet) as on_progress:
        outcomes = make_all(
            output,
            only=only or (),
            motion_folder=motion_folder,
            seed=seed,
            figure_format=figure_format,
            progress=on_progress,
        )
    print_table(
        [
            {
                "number": one.entry.number,
                "agree": one.count_kind("agrees"),
                "set": one.count_kind("set"),
                "differ": one.count_kind("differs"),
                "not stated": one.count_kind("not stated"),
                "seconds": f"{one.seconds:.1f}",
                "title": one.entry.title if one.made else f"NOT MADE: {one.error}",
            }
            for one in outcomes
        ]
    )
    print_message(f"page: {output / 'index.html'}")
    failed = [one.entry.number for one in outcomes if one.made is None]
    if failed:
        print_message(
            f"error: {', '.join(failed)} could not be reproduced from these motions; the page has the reasons"
        )
        raise typer.Exit(1)
