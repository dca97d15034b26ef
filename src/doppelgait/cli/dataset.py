"""``doppelgait dataset``: plan, build, check, export and import datasets."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from doppelgait.cli.analyze import ReaderOptions, takes_windows
from doppelgait.cli.output import (
    AsJson,
    FigureFormat,
    FigureOption,
    format_duration,
    print_json,
    print_message,
    print_table,
    print_tables,
    print_text,
    report_progress,
)

app = typer.Typer(help="Plan, build, check and use labelled datasets.", no_args_is_help=True, rich_markup_mode=None)

PlanName = Annotated[
    str,
    typer.Argument(
        help="Plan (TOML) or home-alarm, home-alarm-day, home-alarm-life, home-alarm-recorded, home-alarm-test, "
        "home-alarm-wide, liland2018, liland2018-fair."
    ),
]
Changes = Annotated[
    list[str] | None,
    typer.Option("--set", help="Change the plan, for example dataset.examples_per_class=1000; repeatable."),
]
MotionFolder = Annotated[
    Path | None,
    typer.Option("--motion-folder", help="Folder of the plan's motion files; by default the folder of the plan file."),
]
LEAKS_LOOKED_AT = 1000  # examples that the leakage test of a plan uses
FEASIBILITY_LOOKED_AT = 500  # examples that are compared with the limits of the radar
ALL_CHECKED = 20_000  # most examples that a plan samples, evenly spread over a larger one


def _load(plan: str, changes: list[str] | None, motion_folder: Path | None) -> tuple[Any, Path]:
    from doppelgait.dataset import load_plan

    loaded, folder = load_plan(plan, overrides=changes or [])
    return loaded, motion_folder or folder


@app.command("plan")
def plan_command(
    plan: PlanName,
    changes: Changes = None,
    motion_folder: MotionFolder = None,
    specs: Annotated[
        Path | None,
        typer.Option("--specs", help="Write every resolved example to this file, one JSON document per line."),
    ] = None,
    pilot: Annotated[
        int, typer.Option("--pilot", min=0, help="Number of examples to simulate for the estimate of time and size.")
    ] = 8,
    as_toml: Annotated[bool, typer.Option("--toml", help="Print the plan as a file, to be changed and used.")] = False,
    as_json: AsJson = False,
) -> None:
    """Check a plan and estimate its size and duration.

    The command prints the numbers of examples, subjects and files. It also prints how many rows
    alias in Doppler, leave the radar frame or have a gate that the frame truncates.

    Example: doppelgait dataset plan home-alarm --set dataset.examples_per_class=50000; or doppelgait
    dataset plan home-alarm --toml > my-plan.toml
    """
    import numpy as np

    from doppelgait.core.config import as_table, write_toml
    from doppelgait.dataset.config import PLANS
    from doppelgait.dataset.feasibility import assess, format_limit_keys, summarise, write_specs
    from doppelgait.dataset.finish import compute_dataset_id
    from doppelgait.dataset.plan import plan_dataset, sample_examples
    from doppelgait.dataset.resolve import warn_of_equal_bodies, warn_of_recordings, warn_of_unused_snr
    from doppelgait.dataset.verify.leakage import refuse_leaks, warn_of_default_rcs

    loaded, folder = _load(plan, changes, motion_folder)
    if as_toml:  # as it was written, with its comments, where nothing is changed
        path = Path(plan) if Path(plan).is_file() else PLANS / f"{plan}.toml"
        print_text(write_toml(as_table(loaded)) if changes else path.read_text(encoding="utf-8"), end="")
        return
    with report_progress("reading motion files", quiet=as_json) as on_progress:
        planned = plan_dataset(loaded, folder=folder, on_progress=on_progress)
    with report_progress("drawing examples", quiet=as_json) as on_progress:
        checked = sum(1 for _ in sample_examples(planned, ALL_CHECKED, on_progress=on_progress))
    examples, leaks = list(sample_examples(planned, LEAKS_LOOKED_AT)), loaded.dataset.leaks
    refuse_leaks(examples, np.random.default_rng(0), leaks=leaks)
    warn_of_default_rcs(examples, np.random.default_rng(0), folder=folder, leaks=leaks)
    warn_of_equal_bodies(examples)
    warn_of_recordings(examples, folder=folder)
    warn_of_unused_snr(loaded.noise)
    with report_progress("checking ranges and speeds", quiet=as_json) as on_progress:
        looked_at = sample_examples(planned, FEASIBILITY_LOOKED_AT, on_progress=on_progress)
        feasibility = assess(looked_at, folder, gate=loaded.dataset.gate)
    identity = compute_dataset_id(planned.config, folder)
    on_pipe = not typer.get_text_stream("stderr").isatty()
    with report_progress("simulating the pilot", quiet=as_json or on_pipe) as on_progress:
        summary = summarise(planned, identity, n_checked=checked, pilot=pilot, on_progress=on_progress)
    if specs is not None:
        write_specs(planned, specs)
        print_message(f"{specs}: {summary['n_examples']} resolved examples")
    if as_json:
        print_json({**summary, "feasibility": asdict(feasibility)})
        return
    print_tables([summary["counts"], summary["subjects"], summary["files"], *feasibility.tables()])
    print_text()
    if feasibility.keys:
        print_text("keys to change: " + format_limit_keys(feasibility.keys).replace("; ", "\n                "))
    if not feasibility.judges_gate:
        print_text('gate cut off: counted by the build, since the gates are those of tracks (dataset.gate = "track")')
    if feasibility.n_examples < summary["n_examples"]:
        print_text(f"radar limits: computed from {feasibility.n_examples} of {summary['n_examples']} examples")
    print_text(
        "{name}: {n_examples} examples in {n_shards} shards, id {dataset_id}; {n_checked} were sampled in full, "
        "their values are allowed and do not predict the class".format(**summary)
    )
    if e := summary["estimate"]:
        if e["pilot_failures"] < e["pilot_examples"]:
            print_text(
                f"about {e['total_bytes'] / 1e9:.2g} GB and {format_duration(e['total_seconds'])} on {e['processors']} "
                f"processors ({1e3 * e['seconds_per_example']:.0f} ms and {e['bytes_per_example'] / 1e3:.0f} kB each, "
                f"measured on {e['pilot_examples']})"
            )
        if e["pilot_failures"]:
            print_message(
                f"warning: {e['pilot_failures']} of {e['pilot_examples']} examples of the pilot failed; the first is "
                f"{e['pilot_failure']}"
            )


@app.command("build")
def build(
    plan: PlanName,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Folder of the dataset; the plan's name by default.")
    ] = None,
    changes: Changes = None,
    motion_folder: MotionFolder = None,
    workers: Annotated[
        int | None, typer.Option("--workers", min=1, help="Number of processes; by default one per processor.")
    ] = None,
    executor: Annotated[
        str, typer.Option("--executor", help="Executor: serial, processes, dask, or dask://HOST:PORT.")
    ] = "processes",
    part: Annotated[str | None, typer.Option("--part", help="Build only part I of N, for job arrays: I/N.")] = None,
    max_failed: Annotated[
        float,
        typer.Option("--max-failed-share", min=0, max=1, help="Share of examples that may fail in a complete dataset."),
    ] = 0.0,
    as_json: AsJson = False,
) -> None:
    """Build a dataset, or resume an interrupted build.

    Example: doppelgait dataset build home-alarm -o home-alarm
    """
    from doppelgait.dataset import build_dataset, open_dataset
    from doppelgait.dataset.card import count_examples, tabulate_features
    from doppelgait.dataset.feasibility import LIMIT_KEYS, LIMITS, format_limit_keys, limits_of_index

    loaded, folder = _load(plan, changes, motion_folder)
    target = output or Path(loaded.dataset.name)
    with report_progress(f"building {loaded.dataset.name}", quiet=as_json) as on_progress:
        report = build_dataset(
            loaded,
            target,
            folder=folder,
            executor=executor,
            workers=workers,
            part=part,
            max_failed_share=max_failed,
            on_progress=on_progress,
        )
    counts, limits = list[dict[str, Any]](), list[dict[str, Any]]()
    if report.missing == 0:
        index = open_dataset(target).index
        limits = limits_of_index(index)
        counts = [{str(k): v for k, v in row.items()} for row in count_examples(index).to_dict("records")]
        if not as_json:
            features = [{str(k): v for k, v in row.items()} for row in tabulate_features(index).to_dict("records")]
            print_tables([counts, features])
            print_text()
    if as_json:
        names = ("n_examples", "n_built", "n_reused", "n_rows", "n_failed", "failures", "missing", "bytes", "seconds")
        values = {name: getattr(report, name) for name in names}
        print_json({"directory": str(report.directory), "id": report.dataset_id, **values, "counts": counts})
    else:
        made = f"{report.n_built} built in {report.seconds:.1f} s, {report.n_reused} reused"
        if report.missing:
            print_text(f"{target}: this part is done, {made}; {report.missing} shards of other parts are missing")
        else:
            size = f"{report.n_examples} examples, {report.bytes / 1e6:.1f} MB"
            print_text(f"{target}: {size}, id {report.dataset_id}; {made}")
    if reached := {name: n for name in LIMITS if (n := sum(row[name] for row in limits))}:
        words = ", ".join(f"{name} {count}" for name, count in reached.items())
        words += f" (of {report.n_rows}); see the card; keys to change: "
        words += format_limit_keys({name: LIMIT_KEYS[name] for name in reached})
        print_message(f"warning: rows that reach a limit of the radar: {words}")
    if report.failures:
        first, severity = report.failures[0], "error" if report.too_many_failed else "warning"
        print_message(
            f"{severity}: {report.n_failed} examples failed and are left out (the next build tries them again); "
            f"the first is {first['id']}: {first['reason']}"
        )
    if report.too_many_failed:
        raise typer.Exit(1)


Directory = Annotated[Path, typer.Argument(help="Folder of a dataset.")]
SHOWN_FAILURES = 10


def card(directory: Directory) -> None:
    """Print the card of a dataset.

    The card of an incomplete dataset describes the shards that exist.

    Example: doppelgait dataset card home-alarm
    """
    from doppelgait.dataset.finish import make_card

    print_text(make_card(directory))


def status(
    directory: Directory,
    quick: Annotated[bool, typer.Option("--quick", help="Compare file sizes only, without hashes.")] = False,
    as_json: AsJson = False,
) -> None:
    """Report a dataset's progress and damaged shards.

    Leftovers of builds that were killed are removed.

    Example: doppelgait dataset status home-alarm
    """
    from doppelgait.dataset.build import read_dataset_status

    found = read_dataset_status(directory, quick=quick)
    bad = [name for name, state in found.shards.items() if state == "damaged"]
    counts = {state: list(found.shards.values()).count(state) for state in ("done", "missing", "damaged")}
    if as_json:
        print_json({**vars(found), "directory": str(found.directory), "shards": counts, "damaged": bad})
    else:
        print_table([{"shards": state, "number": count} for state, count in counts.items()])
        print_text(
            f"{directory}: {found.name}, id {found.id}: {found.n_examples} of {found.n_planned} examples, "
            f"{found.n_failed} failed; {'complete' if found.complete else 'not complete'}"
        )
        damaged = "damaged, the same 'dataset build' makes them again"
        for text, names in ((damaged, bad), ("building now", found.running), ("leftovers removed", found.removed)):
            if names:
                print_message(f"{text}: {', '.join(names)}")
    if bad:
        raise typer.Exit(1)


def verify(
    directory: Directory,
    motion_folder: MotionFolder = None,
    resimulate: Annotated[
        float, typer.Option("--resimulate", min=0, max=1, help="Share of the examples to simulate again.")
    ] = 0.01,
    figures: Annotated[
        Path | None, typer.Option("--figures", help="Folder for one page of signatures per class.")
    ] = None,
    figure_format: FigureOption = FigureFormat.png,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the random samples.")] = 0,
    as_json: AsJson = False,
) -> None:
    """Verify a dataset: hashes, repeated simulation, truth, and leaks.

    A share of the examples is simulated again and compared. Features are compared with the truth.
    Leaks between splits and leaks through nuisance parameters are searched.

    Example: doppelgait dataset verify home-alarm --figures pages
    """
    import numpy as np

    from doppelgait.dataset.verify import verify_dataset

    with report_progress("verifying", quiet=as_json) as on_progress:
        found = verify_dataset(
            directory,
            folder=motion_folder,
            share=resimulate,
            rng=np.random.default_rng(seed),
            on_progress=on_progress,
            figures=figures,
            figure_format=figure_format,
        )
    if as_json:
        print_json(found.as_dict())
    else:
        print_table([{"check": c.name, "result": c.status, "found": c.summary} for c in found.checks])
        skipped = sum(check.status == "skipped" for check in found.checks)
        rest = f", {skipped} checks were skipped" if skipped else ""
        verdict = found.verdict if found.passed else found.verdict.upper()
        print_text(f"{directory}: {verdict}{rest}, {found.seconds:.1f} s")
        if found.figures:
            print_message(f"{figures}: {', '.join(path.name for path in found.figures)}")
    if not found.passed:
        raise typer.Exit(1)


def export(
    directory: Directory,
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder to write.")],
    form: Annotated[
        str, typer.Option("--form", help="Form, one of 'dataset forms': parquet, csv, zarr, ...")
    ] = "parquet",
    changes: Annotated[
        list[str] | None, typer.Option("--set", help="Parameter of the form, for example examples_per_tar=500.")
    ] = None,
    fields: Annotated[
        list[str] | None,
        typer.Option("--field", help="Array to write, repeatable; by default the arrays that the form supports."),
    ] = None,
    select: Annotated[
        str | None, typer.Option("--select", help="Export only rows that fulfil this condition on index columns.")
    ] = None,
    release: Annotated[
        bool, typer.Option("--release", help="Refuse the export if a source licence forbids redistribution.")
    ] = False,
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
    with report_progress("exporting", quiet=as_json) as on_progress:
        table = {**apply_overrides({}, changes or []), "kind": form}
        report = export_dataset(chosen, output, form=table, fields=fields, release=release, on_progress=on_progress)
    if as_json:
        print_json({**vars(report), "directory": str(report.directory)})
    else:
        print_text(f"{output}: {report.n_rows} rows as {form}, {report.n_files} files, {report.bytes / 1e6:.1f} MB")


def forms(as_json: AsJson = False) -> None:
    """List the export formats with their parameters.

    Example: doppelgait dataset forms
    """
    from doppelgait.dataset.export import EXPORTERS

    rows = []
    for exporter in EXPORTERS.values():
        fields = {} if exporter.parameters is None else exporter.parameters.model_fields
        parameters = [f"{name}={field.default}" for name, field in fields.items() if name != "kind"]
        allowed = exporter.facts.get("allowed")
        arrays = "all" if allowed is None else ", ".join(allowed) or "none"
        rows.append(
            {"form": exporter.name, "arrays": arrays, "parameters": ", ".join(parameters), "package": exporter.package}
        )
    print_json(rows) if as_json else print_table(rows)


NAMES_HELP = (
    "Instead of --labels: template of file names with label and subject, glasgow or for example "
    "'{label}/{subject}_*.dat'."
)
LABEL_HELP = "LABEL=CLASS: rename a label, or leave its recordings out with LABEL=; '*' matches any label; repeatable."


@takes_windows("gate")
def import_recordings(
    folder: Annotated[Path, typer.Argument(help="Folder of recordings.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder of the dataset.")],
    labels: Annotated[
        Path | None, typer.Option("--labels", help="Labels of the recordings: CSV with file, label and more.")
    ] = None,
    names: Annotated[str | None, typer.Option("--names", help=NAMES_HELP)] = None,
    classes: Annotated[list[str] | None, typer.Option("--label", help=LABEL_HELP)] = None,
    gate: Annotated[str, typer.Option("--gate", help="Gate of lines without one: track, or FROM:TO in m.")] = "track",
    split: Annotated[
        str | None,
        typer.Option(
            "--split", help="Split of all rows: train, validation or test; by default the column split, or test."
        ),
    ] = None,
    changes: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            help="Change a setting, for example analysis.cpi_s=0.2, tracking.detector.pfa=1e-4, split.train=0.8.",
        ),
    ] = None,
    options: ReaderOptions = None,
    as_json: AsJson = False,
    **windows: Any,
) -> None:
    """Make a dataset of your own radar recordings.

    Example: doppelgait dataset import recordings --labels labels.csv -o garden-test; or doppelgait
    dataset import glasgow --names glasgow --label walking=human --label '*=' -o glasgow-test
    """
    from doppelgait.core.config import apply_overrides, validate
    from doppelgait.dataset.importing import ImportConfig, import_dataset
    from doppelgait.dataset.labels import label_entries

    named = {"gate": gate, **windows, "split": split}
    table = apply_overrides({key: value for key, value in named.items() if value is not None}, changes or [])
    config = validate(ImportConfig, table, where="import")
    reader = apply_overrides({}, options or [])
    entries = label_entries(folder, labels, names, classes or [], gate=config.gate, options=reader)
    with report_progress("importing", quiet=as_json) as on_progress:
        report = import_dataset(folder, entries, output, config=config, on_progress=on_progress)
    if as_json:
        print_json({**vars(report), "directory": str(report.directory)})
    else:
        print_table([{"label": label, "rows": rows} for label, rows in report.counts.items()])
        print_text(
            f"{output}: {report.n_rows} rows of {report.n_recordings} recordings, {report.n_not_tracked} without a "
            f"target, id {report.dataset_id}" + ("; the dataset already existed" if report.was_there else "")
        )
    if report.n_failed:
        reasons = "".join(f"\n  {f['id']}: {f['reason']}" for f in report.failures[:SHOWN_FAILURES])
        print_message(f"error: {report.n_failed} recordings failed and are left out:{reasons}")
        raise typer.Exit(1)
