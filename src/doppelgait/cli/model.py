"""``doppelgait model``: export trained models and score them as alarms."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from doppelgait.classify.options import AlarmOptions, BenchmarkOptions, takes_options
from doppelgait.cli.analyze import make_option
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
@takes_options(AlarmOptions, make_option)
def alarm(model: ModelArgument, as_json: AsJson = False, **options: Any) -> None:
    """Score a model as an alarm over simulated days.

    The table has false alarms per day and per animal-hour, missed entries and detection time for every threshold.

    Example: doppelgait model alarm x4 --repeats 50
    """
    from doppelgait.classify.alarm import format_day, format_episodes, score_alarm
    from doppelgait.classify.model_file import open_model

    with report_progress("days", quiet=as_json) as on_progress:
        found = score_alarm(open_model(model), on_progress=on_progress, **options)
    print_json(found) if as_json else print_tables([format_day(found), format_episodes(found)])


@takes_options(BenchmarkOptions, make_option)
def benchmark(
    folder: Annotated[Path, typer.Argument(help="Folder of the parts; what is missing is built.")],
    as_json: AsJson = False,
    **options: Any,
) -> None:
    """Score classifiers on doppelgait-bench-1.

    Example: doppelgait benchmark bench --classifier x4 --classifier mine.py:answer
    """
    from doppelgait.classify.benchmark import format_scores, score_classifiers
    from doppelgait.core.config import convert_to_json

    found = score_classifiers(folder, report=partial(report_progress, quiet=as_json), **options)
    if options["rehearse"]:
        print_message("note: a rehearsal: the figures show that it runs, and nothing else")
    shown = [found["parts"], [format_scores(*each) for each in found["scores"].items()]]
    print_json(convert_to_json(found)) if as_json else print_tables(shown)
