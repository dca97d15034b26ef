"""Motion models: parameters and functions, registered by kind."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import numpy as np

from doppelgait.core.config import FrozenModel, validate
from doppelgait.core.errors import ConfigError
from doppelgait.core.plugins import Group
from doppelgait.core.rng import Streams
from doppelgait.motion.motion import Motion

Parameters = TypeVar("Parameters", bound=FrozenModel)
Generate = Callable[[Any, float, np.random.Generator | None], Motion]
"""Type of ``generate(parameters, duration_s, rng) -> motion``; ``rng`` may be None if nothing is random."""

MOTION_MODELS: Group[Generate] = Group(
    "motion_model",
    built_in=tuple(
        f"doppelgait.motion.models.{name}"
        for name in ("boulic", "confusers", "crawl", "human", "primitives", "quadruped")
    ),
)
"""Motion models by the ``kind`` of a scene file. Every parameter has a default, so that the name is sufficient."""


def get_parameters(kind: str) -> type[FrozenModel]:
    """Return a motion model's parameter model."""
    found = MOTION_MODELS[kind].parameters
    if found is None:
        raise ConfigError(f"motion model {kind!r} is registered without parameters; it needs a model of them")
    return found


class MotionTable(dict[str, Any]):
    """Table of a model's motion with its checked parameters."""

    checked: str
    parameters: FrozenModel


def check_table(table: Mapping[str, Any], **location: Any) -> MotionTable:
    """Check the table of a model's motion; a checked one only after a change."""
    model = get_parameters(str(table["kind"]))
    made = MotionTable(table)
    made.checked = repr(table)  # it tells nested values that were changed in place, and True from 1.0
    if isinstance(table, MotionTable) and made.checked == table.checked and type(table.parameters) is model:
        made.parameters = table.parameters
    else:
        made.parameters = validate(model, {name: table[name] for name in table if name != "kind"}, **location)
    return made


def parse_parameters(model: type[Parameters], parameters: Mapping[str, Any], *, where: str) -> Parameters:
    """Check the keyword arguments of a model's function."""
    # unlike a scene file, the function has a duration and no kind
    for name in parameters:
        if name not in model.model_fields:
            allowed = sorted({*model.model_fields, "duration_s", "rng"} - {"kind"})
            raise ConfigError(f"{where}: {name}: unknown parameter; allowed are {', '.join(allowed)}")
    return validate(model, parameters, where=where)


def generate(
    model: FrozenModel | Mapping[str, Any] | str, *, duration_s: float, rng: np.random.Generator | Streams | None = None
) -> Motion:
    """Generate the motion of a model.

    Parameters
    ----------
    model : parameter model, table or str
        Model, for example ``BoulicConfig(speed_mps=1.2)``, ``{"kind": "boulic", "speed_mps": 1.2}`` or ``"boulic"``.
    duration_s : float
        Duration of the motion; the last frame is at or just after it.
    rng : numpy.random.Generator or Streams, optional
        Source of random numbers, needed if the model draws any.

    Raises
    ------
    ConfigError
        If the kind or a parameter is not allowed.

    Examples
    --------
    >>> import doppelgait as dg
    >>> dg.motion.generate({"kind": "fan", "blades": 4}, duration_s=2.0).facts.gait_frequency_hz
    60.0
    """
    parameters = MOTION_MODELS.parse(model)
    source = rng.generator("motion") if isinstance(rng, Streams) else rng
    return MOTION_MODELS.of(parameters).run(parameters, duration_s, source)
