"""``doppelgait evaluate``: train classifiers on a dataset, score them, keep one."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from doppelgait.cli.output import print_json, print_table, progress, say


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
        Path | None,
        typer.Option("--save", help="Keep the best model (by rows held back, not tested), .npz."),
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
    from doppelgait.classify.model_file import save_model
    from doppelgait.classify.report import alarm_table, check_folder, score_table, write_report
    from doppelgait.classify.training import BASELINES
    from doppelgait.dataset import open_dataset

    if save is not None:
        _check_save(save, output)
    check_folder(output)
    with progress("training", quiet=as_json) as on_progress:
        found = run_evaluation(
            open_dataset(dataset), other=None if test is None else open_dataset(test), models=models, n_folds=cv,
            left_out=left_out, motion_folder=motion_folder, seed=seed, keep=save is not None, on_progress=on_progress,
        )  # fmt: skip
    page = write_report(found, output)[-1]
    if save is not None and found.best is not None:
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
    if save is not None and found.best is not None:
        chosen = "the best on the rows held back" if len(found.models) - len(BASELINES) > 1 else "the one trained"
        say(f"model: {save}: {found.best}, {chosen}")


def _check_save(save: Path, output: Path) -> None:
    """Refuse, before any work is done, a name for the model that cannot be written."""
    from doppelgait.classify.model_file import SUFFIX
    from doppelgait.core.errors import ConfigError

    folder = save.resolve().parent
    if save.suffix.lower() != SUFFIX:
        raise ConfigError(f"--save {save}: must end in {SUFFIX}")
    if folder == output.resolve() or output.resolve() in folder.parents:
        raise ConfigError(f"--save {save}: lies in the folder of the report, which a later one replaces; put it beside")
    if not folder.is_dir():
        raise ConfigError(f"--save {save}: the folder {save.parent} does not exist; make it first")
    if save.is_dir():
        raise ConfigError(f"--save {save}: is a folder; give a file")
