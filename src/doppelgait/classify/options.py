"""Options of commands and of the functions behind them: names, kinds, help and clashes.

No library is imported, so that the help of a command needs none.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import wraps
from inspect import Parameter, cleandoc, formatannotation, signature
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_type_hints

from doppelgait.core.errors import ConfigError

FLAGS = {"other": "--test", "n_folds": "--cv", "left_out": "--leave-out", "own": "--adapt", "directory": "--output -o"}
"""Options that have another name on the command line."""
KINDS = {"analysis": "Analysis, optional", "tracking": "Tracking, optional", "gate": "as for analyze"} | {
    "answers": "path, DataFrame or function, optional"
}
"""Kinds of options that need a library; the others of any kind are datasets or their folders."""

Function = TypeVar("Function", bound=Callable[..., Any])


def name_flag(name: str) -> str:
    """Return the flag of an option."""
    return FLAGS.get(name, f"--{name.replace('_', '-')}")


@dataclass(frozen=True, kw_only=True)
class CheckedOptions:
    """Options whose values are checked and converted."""

    def __post_init__(self) -> None:
        from pydantic import TypeAdapter, ValidationError

        for name, hint in get_type_hints(type(self), include_extras=True).items():
            kind, (_, *least), value = hint.__origin__, hint.__metadata__, getattr(self, name)
            try:
                strict = not {"Path", "list"} & {*re.findall(r"\w+", str(kind))}  # else "3" and True are numbers
                object.__setattr__(self, name, TypeAdapter(kind).validate_python(value, strict=strict))
            except ValidationError:
                raise ConfigError(f"{name}: {value!r:.80} is not allowed; must be {formatannotation(kind)}") from None
            if least and value is not None and value < least[0]:
                raise ConfigError(f"{name_flag(name)} {value}: must be {least[0]} or more")


@dataclass(frozen=True, kw_only=True)
class Options(CheckedOptions):
    """Options of an evaluation; ``Any`` is a dataset or its folder."""

    other: Annotated[
        Any, "Another dataset to test on instead: all rows except those of targets in the training data."
    ] = None
    models: Annotated[
        list[str] | None,
        "ensemble, six-logistic, six-boosting, extended-logistic, extended-boosting, "
        "signature-network (needs torch) or track-network; repeatable; by default the ensemble, "
        "its members and six-logistic, as far as the dataset has the inputs.",
    ] = None
    n_folds: Annotated[
        int | None, "Cross-validate over all rows with this number of folds; a target is in one of them."
    ] = None
    left_out: Annotated[
        str | None, "Cross-validate by leaving out one value of this column at a time: source, subject, ..."
    ] = None
    own: Annotated[
        Any, "A dataset of your own recordings, of every class, to test on and to adapt the saved model to."
    ] = None
    unknown: Annotated[
        Any, "A dataset with further classes, which the models should abstain from; they are scored separately."
    ] = None
    answers: Annotated[
        Any,
        "Probabilities of your own network for the tested rows, to score like those of a model: a table "
        "(CSV, Parquet) with the column id and a column for every class; of two classes one is enough. "
        "Only --models are trained then.",
    ] = None
    alarm_class: Annotated[str | None, "Class that triggers the alarm; human by default."] = None
    motion_folder: Annotated[Path | None, "Folder of the plan's motion files."] = None
    seed: Annotated[int, "Seed of folds, training and confidence intervals, 0 or more.", 0] = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        exclusive = ("other", "n_folds", "left_out", "own", "unknown")
        given = [name_flag(name) for name in exclusive if getattr(self, name) is not None]
        for flag in ("--adapt", "--unknown"):
            if flag in given and {"--cv", "--leave-out"} & {*given}:
                raise ConfigError(f"{flag}: needs one model for all rows; leave --cv and --leave-out out")
        if self.answers is not None and (clash := [flag for flag in given if flag != "--test"]):
            raise ConfigError(
                f"--answers and {clash[0]}: use one of them; answers are scored on the split test or --test"
            )
        if len(clash := [flag for flag in given if flag != "--unknown"]) > 1:
            raise ConfigError(f"{' and '.join(sorted(clash))}: use one of them")


@dataclass(frozen=True, kw_only=True)
class WindowOptions(CheckedOptions):
    """Options of decisions about a recording, its windows, or a stream."""

    gate: Annotated[Any, "Range gate of the targets: track, truth, or FROM:TO in m."] = "track"
    window_s: Annotated[
        float | None,
        "Length of the windows, s, across which tracks are linked; by default that of the model, or "
        "1.5 times its shortest observation.",
    ] = None
    hop_s: Annotated[float | None, "Step between windows, s; by default a fifth of the window."] = None
    analysis: Annotated[Any, "Of recordings; by default the analysis of the training data."] = None
    tracking: Annotated[Any, "Parameters of the gate track."] = None


@dataclass(frozen=True, kw_only=True)
class AlarmOptions(CheckedOptions):
    """Options of an alarm over simulated days."""

    day: Annotated[Any, "Plan of episodes, name or file; by default home-alarm-day."] = None
    repeats: Annotated[int | None, "Recordings of each kind, 1 or more; by default the plan's.", 1] = None
    directory: Annotated[Path | None, "Folder to keep the windows of the day, to go on with."] = None


@dataclass(frozen=True, kw_only=True)
class BenchmarkOptions(CheckedOptions):
    """Options of the benchmark."""

    classifier: Annotated[list[str] | None, "Baseline, FILE.py:FUNCTION, or model by name or file; repeatable."] = None
    recordings: Annotated[Path | None, "Folder of motion files, for the part 'recorded'."] = None
    rehearse: Annotated[bool, "Try it on a recording of each kind, in FOLDER/rehearsal; its figures mean nothing."] = (
        False
    )


Annotate = Callable[[str, Any, str], Any]


def takes_options(
    of: type, annotate: Annotate = lambda *facts: facts[1], *, but: Sequence[str] = ()
) -> Callable[[Function], Function]:
    """Give a function with ``**options`` the parameters of a model, described, without some."""
    hints = get_type_hints(of, include_extras=True).items()
    fields = {name: (hint.__origin__, hint.__metadata__[0]) for name, hint in hints if name not in but}

    def wrap(function: Function) -> Function:
        given = signature(function, eval_str=True)
        *first, _ = given.parameters.values()
        own = [
            Parameter(name, Parameter.KEYWORD_ONLY, default=getattr(of, name), annotation=annotate(name, *facts))
            for name, facts in fields.items()
        ]
        taken = given.replace(parameters=[*first, *own])
        lines = [
            f"{name} : {KINDS.get(name, 'Dataset or path, optional') if kind is Any else formatannotation(kind)}\n"
            f"    {text}"
            for name, (kind, text) in fields.items()
        ]

        @wraps(function)
        def call(*values: Any, **stated: Any) -> Any:
            taken.bind(*values, **stated)  # an option that it does not take is a TypeError
            return function(*values, **stated)

        call.__signature__ = taken  # type: ignore[attr-defined]
        call.__doc__ = cleandoc(function.__doc__ or "").replace("**options", "\n".join(lines))
        return call  # type: ignore[return-value]

    return wrap
