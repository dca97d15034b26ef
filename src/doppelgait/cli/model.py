"""``doppelgait model``: trained models in forms for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from doppelgait.cli.output import say

app = typer.Typer(help="Export trained models to other programs and devices.", no_args_is_help=True,
                  rich_markup_mode=None)  # fmt: skip


@app.callback()
def _group() -> None:
    """Export trained models to other programs and devices."""


@app.command("export")
def export(
    model: Annotated[Path, typer.Argument(help="Model of 'evaluate --save', .npz.")],
    form: Annotated[str, typer.Option("--form", help="onnx, or numpy (a scorer that needs NumPy alone).")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder to write.")],
) -> None:
    """Write a trained model in a form for other programs.

    Example: doppelgait model export model.npz --form onnx -o exported
    """
    from doppelgait.classify.export.write import export_model
    from doppelgait.classify.model_file import load_model

    made = export_model(load_model(model), form, output)
    say(f"{made.folder}: {', '.join(made.files)}")
