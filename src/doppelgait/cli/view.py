"""``doppelgait view``: local page of a recording, result or dataset."""

from __future__ import annotations

import os
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from doppelgait.cli.analyze import Changes, ReaderOptions, parse_analysis
from doppelgait.cli.classify import ModelOption
from doppelgait.cli.output import explain_reader_options, print_message
from doppelgait.core.errors import ConfigError


def view(
    path: Annotated[
        Path | None,
        typer.Argument(
            help="Recording of any format, result of 'analyze -o', or dataset; without it the page shows only 'Try it'."
        ),
    ] = None,
    other: Annotated[
        Path | None, typer.Argument(help="Second recording, shown below the first on the same time axis.")
    ] = None,
    gate: Annotated[
        str | None,
        typer.Option(
            "--gate",
            help="Range gate of the targets: track, truth, or FROM:TO in m; track by default, all ranges if a "
            "recording cannot be tracked.",
        ),
    ] = None,
    changes: Changes = None,
    options: ReaderOptions = None,
    motion_folder: Annotated[
        Path | None,
        typer.Option(
            "--motion-folder",
            help="Folder of the motion files of a dataset's plan; without it no motion file is opened.",
        ),
    ] = None,
    model: ModelOption = None,
    port: Annotated[int, typer.Option("--port", min=0, max=65535, help="Port; 0 for any free one.")] = 0,
    no_browser: Annotated[
        bool, typer.Option("--no-browser", help="Print the address without opening the browser.")
    ] = False,
) -> None:
    """View a recording, result or dataset in the browser.

    Ctrl-C ends the server. The page is accessible from this computer only, under the printed address.

    Example: doppelgait view walk.h5

    Example: doppelgait view home-alarm --no-browser
    """
    from doppelgait.classify.model_file import open_model
    from doppelgait.core.config import apply_overrides
    from doppelgait.processing import Gate
    from doppelgait.viewer.server import check_installed, open_in_browser, serve
    from doppelgait.viewer.settings import Settings
    from doppelgait.viewer.source import add_other, open_path

    check_installed()
    if motion_folder is not None and not motion_folder.is_dir():
        raise ConfigError(f"--motion-folder {motion_folder}: no such folder")
    settings = Settings(
        *parse_analysis({}, changes),
        gate=Gate.parse(gate or "track", where="--gate"),
        gate_asked=gate is not None,
        options=apply_overrides({}, options or []),
        motion_folder=motion_folder,
        model=None if model is None else open_model(model),
    )
    with explain_reader_options():
        opened = None if path is None else open_path(path, settings)
        if opened is not None and other is not None:
            opened = add_other(opened, other, settings)
    for run in () if opened is None else (opened.run, opened.other):
        for note in (*run.notes, *run.recording.notes) if run is not None and run.recording is not None else ():
            print_message(f"note: {note}")

    with ExitStack() as ends:

        def on_ready(url: str) -> None:
            print(url, flush=True)
            if not no_browser:
                ends.enter_context(open_in_browser(url))

        serve(opened, settings=settings, port=port, on_ready=on_ready)
    # End the process without waiting for a running analysis: it has nothing to save.
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)
