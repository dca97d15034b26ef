"""``doppelgait dataset``: look after a dataset that is there, hand it on, and make one of real recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from doppelgait.cli.output import print_json, print_table, progress, say

Directory = Annotated[Path, typer.Argument(help="Folder of a dataset.")]
SHOWN_FAILURES = 10
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]


def card(directory: Directory) -> None:
    """Print the card of a dataset; of a half-built one, of what is there.

    Example: doppelgait dataset card home-alarm
    """
    from doppelgait.dataset.finish import card_of

    print(card_of(directory))


def status(
    directory: Directory,
    quick: Annotated[bool, typer.Option("--quick", help="Compare sizes only, hash nothing.")] = False,
    as_json: AsJson = False,
) -> None:
    """Say how far a dataset is, and what is missing or damaged; leftovers of dead builds are removed.

    Example: doppelgait dataset status home-alarm
    """
    from doppelgait.dataset.status import dataset_status

    found = dataset_status(directory, quick=quick)
    bad = [shard.name for shard in found.shards if shard.state == "damaged"]
    if as_json:
        print_json(_status_document(found, bad))
    else:
        print_table([{"shards": state, "number": found.count(state)} for state in ("done", "missing", "damaged")])
        print(
            f"{directory}: {found.name}, id {found.dataset_id}: {found.n_examples} of {found.planned} examples, "
            f"{found.n_failed} failed; {'complete' if found.complete else 'not complete'}"
        )
        for text, names in (("damaged", bad), ("building now", found.running), ("leftovers removed", found.removed)):
            if names:
                say(f"{text}: {', '.join(names)}")
    if bad:
        raise typer.Exit(1)


def _status_document(found: Any, bad: list[str]) -> dict[str, Any]:
    return {
        "directory": str(found.directory),
        "id": found.dataset_id,
        "name": found.name,
        "complete": found.complete,
        "n_examples": found.n_examples,
        "n_planned": found.planned,
        "n_failed": found.n_failed,
        "shards": {state: found.count(state) for state in ("done", "missing", "damaged")},
        "damaged": bad,
        "running": list(found.running),
        "removed": list(found.removed),
    }


def verify(
    directory: Directory,
    motion_folder: Annotated[
        Path | None, typer.Option("--motion-folder", help="Where the motion files of the plan are.")
    ] = None,
    resimulate: Annotated[
        float, typer.Option("--resimulate", min=0, max=1, help="Share of the examples to make again.")
    ] = 0.01,
    figures: Annotated[Path | None, typer.Option("--figures", help="Folder for a page of signatures a class.")] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of the samples that are taken.")] = 0,
    as_json: AsJson = False,
) -> None:
    """Prove a dataset: hashes, a part made again, truth against features, leaks between splits and by nuisances.

    Example: doppelgait dataset verify home-alarm --figures pages
    """
    import numpy as np

    from doppelgait.dataset.verify import verify_dataset

    with progress("verifying", quiet=as_json) as on_progress:
        found = verify_dataset(
            directory,
            folder=motion_folder,
            share=resimulate,
            rng=np.random.default_rng(seed),
            on_progress=on_progress,
            figures=figures,
        )
    if as_json:
        print_json(found.as_dict())
    else:
        print_table([{"check": c.name, "result": c.status, "found": c.summary} for c in found.checks])
        skipped = sum(check.status == "skipped" for check in found.checks)
        rest = f", {skipped} checks skipped: not proven by them" if skipped else ""
        print(f"{directory}: {'passed' if found.passed else 'FAILED'}{rest}, {found.seconds:.1f} s")
        if found.figures:
            say(f"{figures}: {', '.join(path.name for path in found.figures)}")
    if not found.passed:
        raise typer.Exit(1)


def export(
    directory: Directory,
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder to make.")],
    form: Annotated[str, typer.Option("--form", help="One of dataset forms: parquet, csv, zarr, ...")] = "parquet",
    changes: Annotated[
        list[str] | None, typer.Option("--set", help="Parameter of the form, for example examples_per_tar=500.")
    ] = None,
    fields: Annotated[
        list[str] | None, typer.Option("--field", help="Array to write, repeatable; by default what the form holds.")
    ] = None,
    select: Annotated[str | None, typer.Option("--select", help="Only rows that fulfil this query.")] = None,
    release: Annotated[bool, typer.Option("--release", help="Refuse what licences keep from being handed on.")] = False,
    as_json: AsJson = False,
) -> None:
    """Write a dataset in another form.

    Example: doppelgait dataset export home-alarm -o tars --form webdataset --select "split == 'train'"
    """
    from doppelgait.core.config import apply_overrides
    from doppelgait.dataset import open_dataset
    from doppelgait.dataset.export import export_dataset

    chosen = open_dataset(directory)
    if select is not None:
        chosen = chosen.select(select)
    with progress("exporting", quiet=as_json) as on_progress:
        table = {**apply_overrides({}, changes or []), "kind": form}
        report = export_dataset(chosen, output, form=table, fields=fields, release=release, on_progress=on_progress)
    if as_json:
        print_json({**vars(report), "directory": str(report.directory)})
    else:
        print(f"{output}: {report.n_rows} rows as {form}, {report.n_files} files, {report.bytes / 1e6:.1f} MB")


def forms(as_json: AsJson = False) -> None:
    """List the forms that a dataset can be exported in, with their parameters.

    Example: doppelgait dataset forms
    """
    from doppelgait.dataset.export import EXPORTERS

    rows = []
    for exporter in EXPORTERS.values():
        fields = {} if exporter.parameters is None else exporter.parameters.model_fields
        parameters = [f"{name}={field.default}" for name, field in fields.items() if name != "kind"]
        allowed = exporter.facts.get("allowed")
        arrays = "all" if allowed is None else ", ".join(allowed) or "none"
        rows.append({"form": exporter.name, "arrays": arrays, "parameters": ", ".join(parameters),
                     "package": exporter.package})  # fmt: skip
    print_json(rows) if as_json else print_table(rows)


def import_recordings(
    folder: Annotated[Path, typer.Argument(help="Folder of recordings.")],
    labels: Annotated[Path, typer.Option("--labels", help="What they show: CSV with file, label and more.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder of the dataset.")],
    gate: Annotated[str, typer.Option("--gate", help="track, or FROM:TO in m, where a line does not say.")] = "track",
    window_s: Annotated[float | None, typer.Option("--window-s", help="Cut recordings into windows of this.")] = None,
    hop_s: Annotated[float | None, typer.Option("--hop-s", help="Step from window to window.")] = None,
    split: Annotated[
        str | None, typer.Option("--split", help="train, validation or test for all; else the column, else test.")
    ] = None,
    changes: Annotated[
        list[str] | None,
        typer.Option("--set", help="For example analysis.cpi_s=0.2, tracking.detector.pfa=1e-4, split.train=0.8."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Make a dataset of your own radar recordings.

    Example: doppelgait dataset import recordings --labels labels.csv -o garden-test
    """
    from doppelgait.core.config import apply_overrides, validate
    from doppelgait.dataset.importing import ImportConfig, import_dataset

    given = {"gate": gate, "window_s": window_s, "hop_s": hop_s, "split": split}
    table = apply_overrides({key: value for key, value in given.items() if value is not None}, changes or [])
    config = validate(ImportConfig, table, where="import")
    with progress("importing", quiet=as_json) as on_progress:
        report = import_dataset(folder, labels, output, config=config, on_progress=on_progress)
    if as_json:
        print_json({**vars(report), "directory": str(report.directory)})
    else:
        print_table([{"label": label, "rows": rows} for label, rows in report.counts.items()])
        print(
            f"{output}: {report.n_rows} rows of {report.n_recordings} recordings, {report.n_not_tracked} without a "
            f"target, id {report.dataset_id}" + ("; it was there already" if report.was_there else "")
        )
    if report.n_failed:
        reasons = "".join(f"\n  {f['id']}: {f['reason']}" for f in report.failures[:SHOWN_FAILURES])
        say(f"error: {report.n_failed} recordings failed and are left out:{reasons}")
        raise typer.Exit(1)
