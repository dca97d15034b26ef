"""``doppelgait evaluate``: train classifiers on a dataset, score them, keep one."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from doppelgait.cli.output import check_output, print_json, print_table, progress, say


def evaluate(
    dataset: Annotated[Path, typer.Argument(help="Folder of the dataset to learn from.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for the report.")],
    test: Annotated[Path | None, typer.Option("--test", help="Another dataset to test on instead.")] = None,
    models: Annotated[
        list[str] | None,
        typer.Option(
            "--models",
            help="six-logistic, six-boosting, extended-logistic, extended-boosting or signature-network (needs torch); "
            "repeatable; all by default.",
        ),
    ] = None,
    cv: Annotated[int | None, typer.Option("--cv", help="Cross-validate over all rows in so many folds.")] = None,
    left_out: Annotated[
        str | None,
        typer.Option("--leave-out", help="Leave one value of this column out at a time: source, subject, ..."),
    ] = None,
    save: Annotated[
        Path | None, typer.Option("--save", help="Keep the best model (by rows held back, not tested), .npz.")
    ] = None,
    motion_folder: Annotated[
        Path | None, typer.Option("--motion-folder", help="Where the motion files of the plan are.")
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of folds, training and intervals.")] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Train classifiers on a dataset's own splits and write a report: scores, figures, the plan of the data.

    Example: doppelgait evaluate home-alarm -o report --save home-alarm-model.npz
    """
    from doppelgait.classify.evaluate import evaluate as run_evaluation
    from doppelgait.classify.model_file import SUFFIX, save_model
    from doppelgait.classify.report import alarm_table, check_folder, score_table, write_report
    from doppelgait.dataset import open_dataset

    if save is not None:
        check_output(save, SUFFIX)
    check_folder(output)
    with progress("training", quiet=as_json) as on_progress:
        found = run_evaluation(
            open_dataset(dataset), other=None if test is None else open_dataset(test), models=models, n_folds=cv,
            left_out=left_out, motion_folder=motion_folder, seed=seed, keep=save is not None, on_progress=on_progress,
        )  # fmt: skip
    page = write_report(found, output)[-1]
    if save is not None:
        save_model(found.models[found.best], save)
    if as_json:
        print_json(found.document)
        return
    print_table(score_table(found.document))
    print()
    print_table(alarm_table(found.document))
    for note in found.document["notes"]:
        say(f"note: {note}")
    say(f"report: {page}")
    if save is not None:
        say(f"model: {save}: {found.best}, the best on the rows held back")
