"""``doppelgait model``: export trained models and score them as alarms."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from doppelgait.cli.classify import MODEL_HELP
from doppelgait.cli.output import AsJson, print_json, print_message, print_table, print_tables, report_progress

ModelArgument = Annotated[str, typer.Argument(help=f"{MODEL_HELP}.")]

app = typer.Typer(
    help="Export trained models to other programs and devices.", no_args_is_help=True, rich_markup_mode=None
)


@app.command("export")
def export(
    model: ModelArgument,
    form: Annotated[str, typer.Option("--form", help="Form: onnx, c, or numpy (a scorer that needs only NumPy).")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder to write.")],
    integers: Annotated[bool, typer.Option("--int8", help="C: network in 8-bit integers instead of float32.")] = False,
    prf_hz: Annotated[
        float | None, typer.Option("--prf-hz", help="C: pulse rate; by default that of the training data.")
    ] = None,
    carrier_hz: Annotated[
        float | None, typer.Option("--carrier-hz", help="C: carrier; by default that of the training data.")
    ] = None,
    window_s: Annotated[
        float | None,
        typer.Option("--window-s", help="C: observation of one decision; by default the training data's shortest."),
    ] = None,
    bins: Annotated[int, typer.Option("--bins", min=1, max=1024, help="C: number of range bins in the gate.")] = 1,
    still_s: Annotated[
        float,
        typer.Option(
            "--still-s", min=0, help="C: time constant of the mean that removes static echoes, s; 0 removes nothing."
        ),
    ] = 2.0,
    data: Annotated[
        Path | None,
        typer.Option(
            "--data", help="C: dataset with signatures that calibrate the integers; by default simulated examples."
        ),
    ] = None,
    n_examples: Annotated[int, typer.Option("--examples", min=1, max=10_000, help="C: number of golden vectors.")] = 16,
    seed: Annotated[int, typer.Option("--seed", min=0, help="C: seed of the simulated examples.")] = 0,
    as_json: AsJson = False,
) -> None:
    """Write a trained model for other programs.

    Example: doppelgait model export model.npz --form onnx -o exported;
    or doppelgait model export x4 --form c --int8 --prf-hz 500 -o firmware/model
    """
    from doppelgait.classify import CSettings, export_model
    from doppelgait.classify.model_file import open_model

    settings = CSettings(
        integers=integers,
        prf_hz=prf_hz,
        carrier_hz=carrier_hz,
        window_s=window_s,
        bins=bins,
        still_time_s=still_s or None,
        data=data,
        n_examples=n_examples,
        seed=seed,
    )
    made = export_model(open_model(model), form, output, None if settings == CSettings() and form != "c" else settings)
    if as_json:
        print_json({"folder": str(made.folder), "files": list(made.files), **made.facts})
        return
    print_table([{"": name.replace("_", " "), "number": value} for name, value in made.facts.items()])
    print_message(f"{made.folder}: {', '.join(made.files)}")


@app.command("alarm")
def alarm(
    model: ModelArgument,
    day: Annotated[
        str | None, typer.Option("--day", help="Plan of episodes, built-in name or file; by default home-alarm-day.")
    ] = None,
    repeats: Annotated[
        int | None,
        typer.Option("--repeats", min=1, help="Recordings of each kind of episode; by default those of the plan."),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", help="Folder that keeps the windows of the day; a second run goes on with them."
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Score a model as an alarm over simulated days.

    The table has false alarms per day and per animal-hour, missed entries and detection time for every threshold.

    Example: doppelgait model alarm x4 --repeats 50
    """
    from doppelgait.classify.alarm import format_day, format_episodes, load_day, run_day, score_day
    from doppelgait.classify.model_file import open_model

    chosen, folder = load_day(day, repeats)
    loaded = open_model(model)
    with report_progress("days", quiet=as_json) as on_progress:
        found = score_day(
            chosen, run_day(chosen, loaded, folder=folder, directory=output, on_progress=on_progress), loaded
        )
    if as_json:
        print_json(found)
        return
    print_tables([format_day(found), format_episodes(found)])
