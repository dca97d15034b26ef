"""``doppelgait classify``: recording -> a class, its probability or an abstention, per target."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from doppelgait.cli.analyze import ReaderOptions
from doppelgait.cli.output import number, print_json, print_table, reader_options, say

if TYPE_CHECKING:
    from doppelgait.classify.decide import Decision
    from doppelgait.classify.model import Model


def classify(
    recording: Annotated[
        Path, typer.Argument(help="Recording of any format of 'radar formats', or results of 'analyze -o'.")
    ],
    model: Annotated[Path, typer.Option("--model", help="Model of 'evaluate --save', .npz.")],
    gate: Annotated[
        str, typer.Option("--gate", help="Where the targets are: track, truth, or FROM:TO in m.")
    ] = "track",
    changes: Annotated[
        list[str] | None,
        typer.Option("--set", help="Change a parameter of the model's analysis, or tracking...; repeatable."),
    ] = None,
    options: ReaderOptions = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Say what every target of a recording is: class and calibrated probability, or an abstention with its reason.

    Example: doppelgait classify walk.h5 --model home-alarm-model.npz
    """
    from doppelgait.classify.decide import classify as run_classification
    from doppelgait.classify.model import rests_on
    from doppelgait.classify.model_file import load_model
    from doppelgait.classify.result_file import is_result_file

    loaded = load_model(model)
    facts = loaded.facts
    if is_result_file(recording):
        _refuse_settings(gate, changes, options)
        decisions = run_classification(recording, loaded)
    else:
        decisions = _of_recording(recording, loaded, gate, changes or [], options or [])
    if as_json:
        about = {"file": str(model), "name": facts.name, "classes": list(facts.classes), "dataset": facts.dataset_name,
                 "calibrated": loaded.calibration.n_rows > 0, "alarm_threshold": facts.alarm_threshold,
                 "alarm_people": facts.alarm_people}  # fmt: skip
        print_json({"file": str(recording), "model": about, "targets": [decision.as_dict() for decision in decisions]})
    else:
        _print(decisions)
        if decisions and not loaded.calibration.n_rows:
            say(f"note: {model}: its probabilities are not calibrated")
        if decisions and rests_on(facts):
            say(f"note: {rests_on(facts)}")


def _of_recording(path: Path, model: Model, gate: str, changes: list[str], options: list[str]) -> list[Decision]:
    from doppelgait.classify.decide import classify as run_classification
    from doppelgait.core.config import apply_overrides, validate
    from doppelgait.pipeline import Tracking
    from doppelgait.processing import Analysis, Gate
    from doppelgait.radar import read_recording

    table = apply_overrides(model.facts.analysis, changes)
    tracking = validate(Tracking, table.pop("tracking", {}), where="tracking")
    settings = validate(Analysis, table, where="analysis")
    # resolved: a reader looks at the name, and "." has none
    with reader_options():
        loaded = read_recording(path.resolve() if path.is_dir() else path, **apply_overrides({}, options))
    for note in loaded.notes:
        say(f"note: {note}")
    choice = Gate.parse(gate, where="--gate")
    return run_classification(loaded, model, gate=choice, analysis=settings, tracking=tracking)


def _refuse_settings(gate: str, changes: list[str] | None, options: list[str] | None) -> None:
    from doppelgait.core.errors import ConfigError

    given = [name for name, value in (("--set", changes), ("--option", options)) if value]
    if gate != "track":
        given.append("--gate")
    if given:
        raise ConfigError(f"{', '.join(given)}: the file holds results, which are as they are; give the recording")


def _print(decisions: list[Decision]) -> None:
    if not decisions:
        print("no target found")
        return
    rows: list[dict[str, Any]] = []
    for found in decisions:
        rows.append({
            "target": found.target,
            "range (m)": number(found.quality.get("track_range_m"), 2),
            "decision": "none" if found.abstained else found.label,
            "likeliest": found.label,
            "probability": number(found.probability),
            "alarm": {None: "-", True: "yes", False: "no"}[found.alarm],
            "why no decision": found.reason,
        })  # fmt: skip
    print_table(rows)
