"""``doppelgait dataset``: build datasets."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from doppelgait.cli.output import print_json, print_table, progress, say

app = typer.Typer(help="Build labelled datasets.", no_args_is_help=True, rich_markup_mode=None)


@app.callback()
def options() -> None:
    """Build labelled datasets."""


@app.command("build")
def build(
    plan: Annotated[str, typer.Argument(help="Plan file (TOML) or built-in name: home-alarm.")],
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Folder; the plan's name by default.")] = None,
    changes: Annotated[
        list[str] | None,
        typer.Option("--set", help="Change the plan, for example dataset.examples_per_class=1000; repeatable."),
    ] = None,
    workers: Annotated[int | None, typer.Option("--workers", min=1, help="Processes; one per processor.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Build a dataset, or finish one that was begun.

    Example: doppelgait dataset build home-alarm -o home-alarm
    """
    from doppelgait.dataset import build_dataset, load_plan, open_dataset
    from doppelgait.dataset.card import counts_table, feature_table

    loaded, folder = load_plan(plan, overrides=changes or [])
    target = output or Path(loaded.dataset.name)
    with progress(f"building {loaded.dataset.name}", quiet=as_json) as on_progress:
        report = build_dataset(loaded, target, folder=folder, workers=workers, on_progress=on_progress)
    index = open_dataset(target).index
    counts = [{str(k): v for k, v in row.items()} for row in counts_table(index).to_dict("records")]
    if as_json:
        print_json(_document(report, counts))
    else:
        print_table(counts)
        print()
        print_table([{str(k): v for k, v in row.items()} for row in feature_table(index).to_dict("records")])
        print()
        print(
            f"{target}: {report.n_examples} examples, {report.bytes / 1e6:.1f} MB, id {report.dataset_id}; "
            f"{report.n_built} made in {report.seconds:.1f} s, {report.n_reused} were there"
        )
    if report.failures:
        first = report.failures[0]
        say(
            f"error: {len(report.failures)} examples failed and are left out (the next build tries them again); the "
            f"first is {first['id']}: {first['reason']}"
        )
        raise typer.Exit(1)


def _document(report: Any, counts: list[dict[str, Any]]) -> dict[str, Any]:
    return {
        "directory": str(report.directory),
        "id": report.dataset_id,
        "n_examples": report.n_examples,
        "n_built": report.n_built,
        "n_reused": report.n_reused,
        "bytes": report.bytes,
        "seconds": report.seconds,
        "counts": counts,
        "failures": report.failures,
    }
