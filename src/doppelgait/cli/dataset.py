"""``doppelgait dataset``: plan, build and look after datasets."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from doppelgait.cli.output import print_json, print_table, progress, say

app = typer.Typer(help="Plan, build, check and use labelled datasets.", no_args_is_help=True, rich_markup_mode=None)

PlanName = Annotated[str, typer.Argument(help="Plan file (TOML) or built-in name: home-alarm, liland2018.")]
Changes = Annotated[
    list[str] | None,
    typer.Option("--set", help="Change the plan, for example dataset.examples_per_class=1000; repeatable."),
]
MotionFolder = Annotated[
    Path | None,
    typer.Option("--motion-folder", help="Where the motion files of the plan are; by default beside the plan file."),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]
LEAKS_LOOKED_AT = 1000
"""From this many examples a plan is judged whether its nuisance parameters tell the class."""
ALL_CHECKED = 20_000
"""Up to this many examples are drawn in full by ``dataset plan``; of larger plans as many, evenly spread."""


@app.callback()
def options() -> None:
    """Plan, build, check and use labelled datasets."""


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
        Path | None, typer.Option("--specs", help="Write every resolved example to this file, one JSON a line.")
    ] = None,
    pilot: Annotated[int, typer.Option("--pilot", min=0, help="Examples made to estimate time and size.")] = 8,
    as_json: AsJson = False,
) -> None:
    """Say what a plan will make, how large and how long, and whether it is allowed; nothing is built.

    Example: doppelgait dataset plan home-alarm --set dataset.examples_per_class=50000
    """
    import numpy as np

    from doppelgait.dataset.finish import dataset_id
    from doppelgait.dataset.plan import check_examples, plan_dataset, spread
    from doppelgait.dataset.summary import summarise, write_specs
    from doppelgait.dataset.verify.leakage import refuse_leaks

    loaded, folder = _load(plan, changes, motion_folder)
    with progress("reading motion files", quiet=as_json) as on_progress:
        laid_out = plan_dataset(loaded, folder=folder, on_progress=on_progress)
    checked = check_examples(laid_out, most=ALL_CHECKED)
    refuse_leaks(list(spread(laid_out, LEAKS_LOOKED_AT)), np.random.default_rng(0))
    summary = summarise(laid_out, dataset_id(laid_out.config, folder), n_checked=checked, pilot=pilot)
    if specs is not None:
        write_specs(laid_out, specs)
        say(f"{specs}: {summary.n_examples} resolved examples")
    if as_json:
        print_json(summary.as_dict())
    else:
        _print_summary(summary)


def _print_summary(summary: Any) -> None:
    print_table(summary.counts)
    print()
    print_table(summary.subjects)
    if summary.files:
        print()
        print_table(summary.files)
    print()
    print(
        f"{summary.name}: {summary.n_examples} examples in {summary.n_shards} shards, id {summary.dataset_id}; "
        f"{summary.n_checked} were drawn in full, their values are allowed and do not tell the class"
    )
    if summary.estimate:
        from doppelgait.cli.output import duration_text

        e = summary.estimate
        print(
            f"about {e['total_bytes'] / 1e9:.2g} GB and {duration_text(e['total_seconds'])} on {e['processors']} "
            f"processors ({1e3 * e['seconds_per_example']:.0f} ms and {e['bytes_per_example'] / 1e3:.0f} kB each, "
            f"measured on {e['pilot_examples']})"
        )
        if e["pilot_failures"]:
            say(f"warning: {e['pilot_failures']} examples of the pilot failed; build a few to see why")


@app.command("build")
def build(
    plan: PlanName,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Folder; the plan's name by default.")] = None,
    changes: Changes = None,
    motion_folder: MotionFolder = None,
    workers: Annotated[int | None, typer.Option("--workers", min=1, help="Processes; one per processor.")] = None,
    executor: Annotated[
        str, typer.Option("--executor", help="serial, processes, dask, or dask://HOST:PORT.")
    ] = "processes",
    part: Annotated[str | None, typer.Option("--part", help="I/N: only this part, for job arrays.")] = None,
    max_failed: Annotated[
        float, typer.Option("--max-failed-share", min=0, max=1, help="Share of examples that may fail.")
    ] = 0.0,
    as_json: AsJson = False,
) -> None:
    """Build a dataset, or finish one that was begun.

    Example: doppelgait dataset build home-alarm -o home-alarm
    """
    from doppelgait.dataset import build_dataset, open_dataset
    from doppelgait.dataset.card import counts_table, feature_table

    loaded, folder = _load(plan, changes, motion_folder)
    target = output or Path(loaded.dataset.name)
    with progress(f"building {loaded.dataset.name}", quiet=as_json) as on_progress:
        report = build_dataset(
            loaded, target, folder=folder, executor=executor, workers=workers, part=part,
            max_failed_share=max_failed, on_progress=on_progress,
        )  # fmt: skip
    counts: list[dict[str, Any]] = []
    if report.missing == 0:
        index = open_dataset(target).index
        counts = [{str(k): v for k, v in row.items()} for row in counts_table(index).to_dict("records")]
        if not as_json:
            print_table(counts)
            print()
            print_table([{str(k): v for k, v in row.items()} for row in feature_table(index).to_dict("records")])
            print()
    if as_json:
        print_json({**_report_document(report), "counts": counts})
    else:
        print(_outcome(target, report))
    if report.failures:
        first, severity = report.failures[0], "error" if report.too_many_failed else "warning"
        say(
            f"{severity}: {report.n_failed} examples failed and are left out (the next build tries them again); "
            f"the first is {first['id']}: {first['reason']}"
        )
    if report.too_many_failed:
        raise typer.Exit(1)


def _report_document(report: Any) -> dict[str, Any]:
    names = ("n_examples", "n_built", "n_reused", "n_rows", "n_failed", "failures", "missing", "bytes", "seconds")
    values = {name: getattr(report, name) for name in names}
    return {"directory": str(report.directory), "id": report.dataset_id, **values}


def _outcome(target: Path, report: Any) -> str:
    made = f"{report.n_built} made in {report.seconds:.1f} s, {report.n_reused} were there"
    if report.missing:
        return f"{target}: this part is done, {made}; {report.missing} shards of other parts are missing"
    return f"{target}: {report.n_examples} examples, {report.bytes / 1e6:.1f} MB, id {report.dataset_id}; {made}"
