"""``doppelgait classify`` and ``evaluate``: train, score and use classifiers."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from doppelgait.classify.options import Options, name_flag, takes_options
from doppelgait.cli.analyze import Changes, ReaderOptions, make_option, open_recording, parse_analysis, takes_windows
from doppelgait.cli.dataset import LABEL_HELP, NAMES_HELP
from doppelgait.cli.output import (
    AsJson,
    FigureFormat,
    PageFigureOption,
    check_output,
    format_number,
    print_json,
    print_message,
    print_table,
    print_tables,
    print_text,
    report_progress,
)
from doppelgait.core.errors import ConfigError, DatasetError

if TYPE_CHECKING:
    from doppelgait.classify.model import Model
    from doppelgait.classify.timeline import TrackDecision

ALARM = {None: "-", True: "yes", False: "no"}
MODEL_HELP = "Model of 'evaluate --save', .npz, or the name of one that comes with doppelgait"
ModelOption = Annotated[
    str | None, typer.Option("--model", help=f"{MODEL_HELP}; by default the one that fits the radar.")
]


@takes_windows()
def classify(
    recording: Annotated[
        Path, typer.Argument(help="Recording in any format of 'radar formats', or result file of 'analyze -o'.")
    ],
    model: ModelOption = None,
    changes: Changes = None,
    options: ReaderOptions = None,
    as_json: AsJson = False,
    **windows: Any,
) -> None:
    """Classify a recording's targets with calibrated probabilities.

    Where the model does not decide, the reason is printed. A model with a network of tracks decides
    in windows: a table of tracks, and a timeline of the decisions about them. Any model does so by
    --window-s or --hop-s; else every target is decided by its longest segment, as are recordings
    shorter than two windows, results, and other gates than tracks.

    Example: doppelgait classify walk.h5

    Example: doppelgait classify evening.h5 --model home-alarm-model.npz --window-s 4 --hop-s 1
    """
    from doppelgait.classify.decide import choose_model
    from doppelgait.classify.decide import classify as run_classification
    from doppelgait.classify.model_file import open_model
    from doppelgait.pipeline.result_files import is_result_file, read_results

    loaded = None if model is None else open_model(model)
    if is_result_file(recording):
        stated = {"set": changes or None, "option": options or None, **windows}
        if refused := [name_flag(key) for key, one in stated.items() if one not in (None, "track")]:
            raise ConfigError(
                f"{', '.join(refused)}: the file holds results, which cannot be changed; name the recording"
            )
        results = read_results(recording).targets
        loaded = loaded or (choose_model(results) if results else None)
        decisions = run_classification(recording, loaded)
    else:
        from doppelgait.classify.timeline import check_window, classify_over_time
        from doppelgait.processing import Gate

        # resolve the path: a reader uses the name, and "." has none
        read = open_recording(recording.resolve() if recording.is_dir() else recording, options)
        loaded, choice = loaded or choose_model(read), Gate.parse(windows.pop("gate"), where="--gate")
        in_windows = any(value is not None for value in windows.values())
        if choice == "track" and loaded.track is not None:
            duration_s = read.slow_time_s[-1] - read.slow_time_s[0] + 1.5 / read.radar.prf_hz
            in_windows = in_windows or duration_s > sum(check_window(None, None, loaded))
            loaded = loaded.of_tracks if in_windows else loaded
        settings, tracking = parse_analysis(loaded.facts.analysis, changes)
        if in_windows:
            windows["window_s"], windows["hop_s"] = check_window(**windows, model=loaded)
            used = {"gate": choice, "analysis": settings, "tracking": tracking}
            over_time = classify_over_time(read, loaded, **windows, **used)
            head = {"file": str(recording), "model": describe_model(loaded, model), **windows}
            _print_over_time(over_time, head, as_json=as_json)
            if over_time and not as_json:
                explain_model(loaded, model, "in two windows in succession, ")
                print_message("note: a decision stays until another is sure, its probability changes")
            return
        decisions = run_classification(read, loaded, gate=choice, analysis=settings, tracking=tracking)
    if as_json:
        about = None if loaded is None else describe_model(loaded, model)
        print_json({"file": str(recording), "model": about, "targets": [decision.as_dict() for decision in decisions]})
    else:
        rows: list[dict[str, Any]] = [
            {
                "target": found.target,
                "range (m)": format_number(found.quality.get("track_range_m"), 2),
                "decision": "none" if found.abstained else found.label,
                "likeliest": found.label,
                "probability": format_number(found.probability),
                "alarm": ALARM[found.alarm],
                "why no decision": found.reason,
            }
            for found in decisions
        ]
        print_table(rows) if rows else print_text("no target found")
        if loaded is not None and decisions:
            explain_model(loaded, model)


def describe_model(model: Model, file: str | None) -> dict[str, Any]:
    """Describe a model for JSON."""
    kept = model.facts.model_dump(include={"name", "alarm_threshold", "alarm_people", "alarm_missed"})
    classes, calibrated = list(model.facts.classes), model.calibration.n_rows > 0
    return {"file": file, "dataset": model.facts.dataset_name, "classes": classes, "calibrated": calibrated, **kept}


def _print_over_time(decisions: list[TrackDecision], head: dict[str, Any], *, as_json: bool) -> None:
    """Print tracks and timeline, with every window as JSON."""
    from doppelgait.classify.timeline import join_decisions

    spans = join_decisions(decisions)
    tracks: list[dict[str, Any]] = [
        {
            "track": track,
            "start_s": ones[0].start_s,
            "stop_s": ones[-1].stop_s,
            "decision": ones[-1].label,
            "probability": ones[-1].probability,
            "alarm": None if all(one.alarm is None for one in ones) else any(one.alarm for one in ones),
            "windows": len(ones),
            "evidence": sum(not one.window.blocked for one in ones),
        }
        for track in sorted({one.track for one in decisions})
        for ones in [[one for one in decisions if one.track == track]]
    ]
    if as_json:
        windows = [found.as_dict() for found in decisions]
        print_json({**head, "tracks": tracks, "timeline": [span._asdict() for span in spans], "windows": windows})
        return
    if not tracks:
        print_text("no target found")
        return
    times = {"start_s": "start (s)", "stop_s": "stop (s)"}
    for rows in (tracks, [{**span._asdict(), "decision": span.label} for span in spans]):
        shown = ("track", "start_s", "stop_s", "decision", "probability", "alarm", "windows", "evidence", "reason")
        print_table(
            [{times.get(name, name): _format_cell(name, row[name]) for name in shown if name in row} for row in rows]
        )
        if rows is tracks:
            print_text("\ntimeline")


def _format_cell(name: str, value: Any) -> Any:
    if name == "alarm":
        return ALARM[value]
    if name == "decision":
        return value or "none"
    return format_number(value, 3 if name == "probability" else 2) if isinstance(value, float) else value


def explain_model(model: Model, name: str | None, windows: str = "") -> None:
    """Print notes on the alarm and on the training data."""
    facts = model.facts
    if name is None:
        print_message(f"model: one that comes with doppelgait and fits this radar, trained on {facts.dataset_name}")
    if facts.alarm is None or facts.alarm_threshold is None:
        print_message("note: alarm: this model has no alarm threshold")
    else:
        print_message(
            f"note: alarm: yes if the probability of {facts.alarm} is {facts.alarm_threshold:.2g} or more, {windows}"
            "also without a decision; -: not known, for the reason beside it"
        )
    if not model.calibration.n_rows:
        print_message(f"note: {name or facts.dataset_name}: its probabilities are not calibrated")


@takes_options(Options, make_option)
def evaluate(
    dataset: Annotated[Path, typer.Argument(help="Folder of the dataset to train on.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for the report.")],
    figure_format: PageFigureOption = FigureFormat.png,
    names: Annotated[
        str | None, typer.Option("--names", help=f"With --test, which is then a folder of recordings. {NAMES_HELP}")
    ] = None,
    classes: Annotated[list[str] | None, typer.Option("--label", help=f"With --names. {LABEL_HELP}")] = None,
    of_reader: Annotated[
        list[str] | None, typer.Option("--option", help="With --names: reader option KEY=VALUE; repeatable.")
    ] = None,
    alarm: Annotated[
        bool, typer.Option("--alarm", help="Score the kept model as an alarm over simulated days; this takes minutes.")
    ] = False,
    save: Annotated[
        Path | None,
        typer.Option("--save", help="Save the ensemble, or of the named models the best on the validation set, .npz."),
    ] = None,
    as_json: AsJson = False,
    **options: Any,
) -> None:
    """Train classifiers on a dataset and write a report.

    The report has scores, figures and the plan of the data; with --answers those of your own network.

    Example: doppelgait evaluate home-alarm -o report --save home-alarm-model.npz; or doppelgait
    evaluate home-alarm -o report --answers mine.csv; or doppelgait
    evaluate home-alarm --test glasgow --names glasgow --label walking=human --label '*=' -o report
    """
    from doppelgait.classify.c_code import find_obstacle
    from doppelgait.classify.evaluation import evaluate as run_evaluation
    from doppelgait.classify.model_file import save_model
    from doppelgait.classify.report import REPORT, list_sections, write_report
    from doppelgait.core.files import check_out

    if save is not None:
        _check_save(save, output)
    check_out(output, **REPORT)
    if names is not None or classes or of_reader:
        if clash := [name_flag(key) for key in ("n_folds", "left_out", "own") if options[key] is not None]:
            raise ConfigError(f"--names and {clash[0]}: use one of them; --names already reads the folder of --test")
        options["other"] = _import_test(dataset, options["other"], names, classes or [], of_reader or [], output)
    with report_progress("training", quiet=as_json) as on_progress:
        day = "home-alarm-day" if alarm else None
        found = run_evaluation(dataset, keep=save is not None, day=day, on_progress=on_progress, **options)
        page = write_report(found, output, figure_format=figure_format)[-1]
        if save is not None and found.best is not None:
            save_model(found.models[found.best], save)
    if as_json:
        print_json(found.document)
        return
    print_tables([*list_sections(found.document).values()])
    for note in found.document["notes"]:
        print_message(f"note: {note}")
    print_message(f"report: {page}")
    if save is not None and found.best is not None:
        n_own = found.models[found.best].facts.n_own
        adapted = f", adapted to {n_own} rows of {options['own']}" if n_own else ""
        print_message(f"model: {save}: {found.best}{adapted}")
        if obstacle := find_obstacle(found.models[found.best].of_tracks):
            print_message(f"note: it has no C form ('model export --form c'): {obstacle}, on a plan of episodes")


def _import_test(
    dataset: Path, folder: Path | None, names: str | None, classes: list[str], options: list[str], output: Path
) -> Path:
    """Import recordings as a dataset next to the report."""
    from doppelgait.core.config import apply_overrides, validate
    from doppelgait.dataset import open_dataset
    from doppelgait.dataset.importing import ImportConfig, import_dataset
    from doppelgait.dataset.labels import label_entries

    if folder is None or names is None:
        raise ConfigError("--names, --label and --option need --test FOLDER and --names")
    target = output.with_name(f"{output.name}-test")
    description = open_dataset(dataset).description
    planned = description.get("config") or {}
    config = validate(ImportConfig, {"analysis": planned.get("analysis") or {}}, where=str(dataset))
    entries = label_entries(folder, None, names, classes, gate="track", options=apply_overrides({}, options))
    if not isinstance(entries, Path):
        further = sorted({entry.label for entry in entries} - set(description["classes"]))
        if further:  # check before the recordings are read, which is slow
            raise ConfigError(
                f"{folder}: has the labels {', '.join(further)}, which {dataset} does not have; rename them to one of "
                f"{', '.join(description['classes'])} (--label {further[0]}=CLASS), or leave them out "
                f"(--label {further[0]}=)"
            )
    try:
        with report_progress("importing") as on_progress:
            report = import_dataset(folder, entries, target, config=config, on_progress=on_progress)
    except DatasetError as error:
        if (target / "dataset.json").is_file():
            raise DatasetError(
                f"{error}; {target} belongs to an earlier run: remove it, or choose another report folder"
            ) from None
        raise
    failed = f"; {report.n_failed} failed, the first: {report.failures[0]['reason']}" if report.n_failed else ""
    print_message(f"{target}: {report.n_rows} rows of {report.n_recordings} recordings{failed}")
    return target


def _check_save(save: Path, output: Path) -> None:
    """Refuse a model path that cannot be written."""
    from doppelgait.classify.model_file import SUFFIX

    folder = save.resolve().parent
    if save.suffix.lower() == SUFFIX and output.resolve() in (folder, *folder.parents):
        raise ConfigError(
            f"--save {save}: lies in the report folder, which a later report replaces; choose a path outside it"
        )
    check_output(save, SUFFIX, option="--save")
    if save.is_dir():
        raise ConfigError(f"--save {save}: is a folder; name a file")
