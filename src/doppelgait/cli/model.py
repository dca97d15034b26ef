"""``doppelgait model``: export trained models and score them as alarms."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from doppelgait.cli.classify import MODEL_HELP
from doppelgait.cli.output import AsJson, print_json, print_message, print_table, print_tables, report_progress
from doppelgait.core.errors import ConfigError

ModelArgument = Annotated[str, typer.Argument(help=f"{MODEL_HELP}.")]

app = typer.Typer(
    help="Export trained models to other programs and devices.", no_args_is_help=True, rich_markup_mode=None
)


@app.command("export")
def export(
    model: ModelArgument,
    form: Annotated[str, typer.Option("--form", help="Form: onnx, c, or numpy (a scorer that needs only NumPy).")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder to write.")],
    radar: Annotated[str | None, typer.Option("--radar", help="C: preset or file of the radar.")] = None,
    prf_hz: Annotated[float | None, typer.Option("--prf-hz", help="C: pulse rate; by default the radar's.")] = None,
    integers: Annotated[bool, typer.Option("--int8", help="C: 8-bit weights instead of float32.")] = False,
    still_s: Annotated[
        float, typer.Option("--still-s", min=0, help="C: time constant of the removal of static echoes, s; 0: none.")
    ] = 2.0,
    as_json: AsJson = False,
) -> None:
    """Write a trained model for other programs.

    Example: doppelgait model export model.npz --form onnx -o exported;
    or doppelgait model export x4 --form c --int8 --radar x4 -o firmware/model
    """
    from doppelgait.classify import CSettings, export_model
    from doppelgait.classify.model_file import open_model
    from doppelgait.radar import Radar

    settings = None
    if radar is None and (integers or prf_hz is not None or still_s != 2.0):
        raise ConfigError("--int8, --prf-hz and --still-s: are for --form c, with --radar")
    if radar is not None:
        changes = {} if prf_hz is None else {"prf_hz": prf_hz}
        settings = CSettings(Radar.preset(radar, **changes), integers=integers, still_time_s=still_s or None)
    made = export_model(open_model(model), form, output, settings)
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
        Path | None, typer.Option("-o", "--output", help="Folder that keeps the windows of the day, to go on with.")
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
        episodes = run_day(chosen, loaded, folder=folder, directory=output, on_progress=on_progress)
        found = score_day(chosen, episodes, loaded)
    print_json(found) if as_json else print_tables([format_day(found), format_episodes(found)])


def benchmark(
    folder: Annotated[Path, typer.Argument(help="Folder of the parts; what is missing is built.")],
    classifier: Annotated[
        list[str] | None,
        typer.Option("--classifier", help="Baseline, FILE.py:FUNCTION, or model by name or file; repeatable."),
    ] = None,
    recordings: Annotated[
        Path | None, typer.Option("--recordings", help="Folder of motion files, for the part 'recorded'.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Score classifiers on doppelgait-bench-1.

    Example: doppelgait benchmark bench --classifier x4 --classifier mine.py:answer
    """
    from doppelgait.classify import benchmark as bench
    from doppelgait.core.config import convert_to_json

    answers = {name: bench.open_classifier(name) for name in classifier or bench.BASELINES}
    built, identities = {}, []
    used = [name for name, part in bench.PARTS.items() if recordings or not part.recorded]
    for name in used if any(name in bench.BASELINES or ".py:" in name for name in answers) else used[1:]:
        with report_progress(name, quiet=as_json) as on_progress:
            one = built[name] = bench.build_part(name, folder / name, folder=recordings, on_progress=on_progress)
        identities.append({"part": name, "identity": one.description["id"], "contents": bench.identify_contents(one)})
    train = built.pop("train", next(iter(built.values())))
    scores = {
        name: {part: bench.score_part(dataset, answer(train, dataset)) for part, dataset in built.items()}
        for name, answer in answers.items()
    }
    shown = [identities, [bench.format_scores(name, found) for name, found in scores.items()]]
    document = {"benchmark": bench.NAME, "parts": identities, "scores": scores}
    print_json(convert_to_json(document)) if as_json else print_tables(shown)
