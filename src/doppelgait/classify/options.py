"""Options of training, evaluation and adaptation, for Python and for the command line.

No library is imported, so that the help of a command needs none.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from inspect import Parameter, cleandoc, formatannotation, signature
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_type_hints

from doppelgait.core.errors import ConfigError

FLAGS = {"other": "--test", "n_folds": "--cv", "left_out": "--leave-out", "own": "--adapt", "unknown": "--unknown"}
"""Options that exclude each other, as the command line names them."""

Function = TypeVar("Function", bound=Callable[..., Any])


@dataclass(frozen=True, kw_only=True)
class Options:
    """Options of an evaluation; ``Any`` is a dataset or its folder."""

    other: Annotated[
        Any,
        "Another dataset to test on instead: all rows except those of targets in the training data.",
    ] = None
    models: Annotated[
        list[str] | None,
        "ensemble, six-logistic, six-boosting, extended-logistic, extended-boosting, "
        "signature-network (needs torch) or track-network; repeatable; by default the ensemble, "
        "its members and six-logistic, as far as the dataset has the inputs.",
    ] = None
    n_folds: Annotated[
        int | None,
        "Cross-validate over all rows with this number of folds; a target is in one of them.",
    ] = None
    left_out: Annotated[
        str | None,
        "Cross-validate by leaving out one value of this column at a time: source, subject, ...",
    ] = None
    own: Annotated[
        Any,
        "A dataset of your own recordings, of every class, to test on and to adapt the saved model to.",
    ] = None
    unknown: Annotated[
        Any,
        "A dataset with further classes, which the models should abstain from; they are scored separately.",
    ] = None
    alarm_class: Annotated[str | None, "Class that triggers the alarm; human by default."] = None
    motion_folder: Annotated[Path | None, "Folder of the plan's motion files."] = None
    seed: Annotated[int, "Seed of folds, training and confidence intervals, 0 or more."] = 0

    def __post_init__(self) -> None:
        from pydantic import TypeAdapter, ValidationError

        for name, kind in get_type_hints(Options).items():
            try:
                object.__setattr__(self, name, TypeAdapter(kind).validate_python(value := getattr(self, name)))
            except ValidationError:
                raise ConfigError(f"{name}: {value!r:.80} is not allowed; must be {formatannotation(kind)}") from None
        given = [flag for name, flag in FLAGS.items() if getattr(self, name) is not None]
        for flag in ("--adapt", "--unknown"):
            if flag in given and {"--cv", "--leave-out"} & {*given}:
                raise ConfigError(f"{flag}: needs one model for all rows; leave --cv and --leave-out out")
        if len(clash := [flag for flag in given if flag != "--unknown"]) > 1:
            raise ConfigError(f"{' and '.join(sorted(clash))}: use one of them")
        if self.seed < 0:
            raise ConfigError(f"--seed {self.seed}: must be 0 or more")


Annotate = Callable[[str, Any, str], Any]


def takes_options(annotate: Annotate = lambda *facts: facts[1]) -> Callable[[Function], Function]:
    """Give a function with ``**options`` the parameters of :class:`Options`, described."""
    hints = get_type_hints(Options, include_extras=True)
    fields = {name: (hint.__origin__, hint.__metadata__[0]) for name, hint in hints.items()}

    def wrap(function: Function) -> Function:
        given = signature(function, eval_str=True)
        *first, _ = given.parameters.values()
        own = [
            Parameter(name, Parameter.KEYWORD_ONLY, default=getattr(Options, name), annotation=annotate(name, *facts))
            for name, facts in fields.items()
        ]
        function.__signature__ = given.replace(parameters=[*first, *own])  # type: ignore[attr-defined]
        kinds = {
            name: "Dataset or path, optional" if kind is Any else formatannotation(kind)
            for name, (kind, _) in fields.items()
        }
        described = "\n".join(f"{name} : {kinds[name]}\n    {text}" for name, (_, text) in fields.items())
        function.__doc__ = cleandoc(function.__doc__ or "").replace("**options", described)
        return function

    return wrap
