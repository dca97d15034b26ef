"""Motion models: parameters and functions, registered by kind."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Mapping, Sequence
from functools import cache
from inspect import Parameter, Signature, cleandoc, signature
from typing import Any

from doppelgait.core.config import FrozenModel, validate
from doppelgait.core.errors import ConfigError, list_choices
from doppelgait.core.plugins import Group
from doppelgait.core.rng import RandomSource, as_generator
from doppelgait.motion.motion import Motion

Generate = Callable[..., Any]
"""Model of a batch, ``generate(parameters, durations_s, rngs) -> motions`` (sequences of equal length),
or of an example, ``generate(parameters, duration_s, rng) -> motion``, distinguished by these names. The
fact ``alike`` of a plug-in is a function of its parameters with equal values for a batch."""
LONGEST_BATCH_S = 100.0
"""Maximum sum of the durations of motions that are generated together, to limit their arrays."""

MOTION_MODELS: Group[Generate] = Group(
    "motion_model",
    built_in=tuple(f"doppelgait.motion.models.{name}" for name in ("boulic", "human", "primitives", "quadruped")),
)
"""Motion models by the ``kind`` of a scene file. Every parameter has a default."""


def get_parameters(kind: str) -> type[FrozenModel]:
    """Return a motion model's parameter model."""
    return MOTION_MODELS[kind].parameters  # type: ignore[return-value]  # there are none without


class MotionTable(dict[str, Any]):
    """Table of a model's motion with its checked parameters."""

    checked: str
    parameters: FrozenModel


def check_table(table: Mapping[str, Any], **location: Any) -> MotionTable:
    """Check the table of a model's motion; a checked one only after a change."""
    if (kind := str(table["kind"])) not in MOTION_MODELS:
        raise ConfigError(f"unknown kind {kind!r}; known are: file, {list_choices(MOTION_MODELS, kind)}")
    model = get_parameters(kind)
    made = MotionTable(table)
    made.checked = repr(table)  # it tells nested values that were changed in place, and True from 1.0
    if isinstance(table, MotionTable) and made.checked == table.checked and type(table.parameters) is model:
        made.parameters = table.parameters
    else:
        made.parameters = validate(model, {name: table[name] for name in table if name != "kind"}, **location)
    return made


ModelFunction = Callable[..., Motion]
"""Public function of a model, of duration, generator and parameters by name."""

_SECTIONS = """

Parameters
----------
duration_s : float
    Duration of the motion, {duration_s:g} s by default; the last frame is at or just after it.
rng : numpy.random.Generator or Streams, optional
    Source of random numbers, needed if a parameter makes strides or steps vary.
{parameters}
Returns
-------
Motion
    Motion (time, marker, space) of the points in m, z up, floor at z = 0.

Raises
------
ConfigError
    If a parameter is outside its range.

Examples
--------
"""


def model_function(model: type[FrozenModel], *, duration_s: float = 5.0) -> Callable[[Generate], ModelFunction]:
    """Make the public function of a model from its generator."""
    # types, limits and defaults are those of the fields; descriptions are in the model's docstring
    described = (model.__doc__ or "").partition("Parameters\n----------\n")[2]
    fields = {name: field for name, field in model.model_fields.items() if name != "kind"}
    default_s = duration_s

    def wrap(run: Generate) -> ModelFunction:
        name = run.__name__

        def make(*, duration_s: float = default_s, rng: RandomSource | None = None, **parameters: Any) -> Motion:
            # unlike a scene file, the function has a duration and no kind
            for key in parameters:
                if key not in model.model_fields:
                    allowed = sorted({*fields, "duration_s", "rng"})
                    raise ConfigError(f"{name}: {key}: unknown parameter; allowed are {', '.join(allowed)}")
            return generate(validate(model, parameters, where=name), duration_s=duration_s, rng=rng)

        text, _, example = cleandoc(run.__doc__ or "").partition("\n\n>>> ")
        make.__doc__ = text + _SECTIONS.format(duration_s=default_s, parameters=described) + ">>> " + example
        make.__name__ = make.__qualname__ = name
        make.__module__ = run.__module__
        common = Parameter("duration_s", Parameter.KEYWORD_ONLY, default=default_s, annotation=float)
        own = [Parameter(key, common.kind, default=f.default, annotation=f.annotation) for key, f in fields.items()]
        chance = Parameter("rng", common.kind, default=None, annotation="RandomSource | None")
        make.__signature__ = Signature([common, chance, *own], return_annotation=Motion)  # type: ignore[attr-defined]
        return make

    return wrap


def generate(
    model: FrozenModel | Mapping[str, Any] | str, *, duration_s: float, rng: RandomSource | None = None
) -> Motion:
    """Generate the motion of a model.

    Parameters
    ----------
    model : parameter model, table or str
        ``BoulicConfig(speed_mps=1.2)``, ``{"kind": "boulic", "speed_mps": 1.2}``, ``"boulic"``, ...
        A kind or parameter that is not allowed raises ConfigError.
    duration_s : float
        Duration of the motion; the last frame is at or just after it.
    rng : numpy.random.Generator or Streams, optional
        Source of random numbers, needed if the model draws any.

    Examples
    --------
    >>> import doppelgait as dg
    >>> dg.motion.generate({"kind": "fan", "blades": 4}, duration_s=2.0).facts.gait_frequency_hz
    60.0
    """
    return generate_all([model], durations_s=[duration_s], rngs=[rng])[0]


def generate_all(
    models: Sequence[FrozenModel | Mapping[str, Any] | str],
    *,
    durations_s: Sequence[float],
    rngs: Sequence[RandomSource | None],
) -> list[Motion]:
    """Generate many motions as :func:`generate` does; no two may share a generator."""
    parameters = [MOTION_MODELS.parse(model) for model in models]
    sources = [None if rng is None else as_generator(rng, "motion") for rng in rngs]
    keys: list[Hashable] = []
    sums_s: dict[Hashable, float] = {}
    for model, duration_s in zip(parameters, durations_s, strict=True):
        plugin = MOTION_MODELS.of(model)
        # a batch is padded to its longest motion: durations are within a factor of two
        key = plugin.run, plugin.facts.get("alike", type)(model), math.frexp(duration_s)[1]
        sums_s[key] = sums_s.get(key, 0.0) + duration_s
        keys.append((key, sums_s[key] // LONGEST_BATCH_S))
    made: dict[int, Motion] = {}
    for batch in dict.fromkeys(keys):
        rows = [row for row, key in enumerate(keys) if key == batch]
        run = MOTION_MODELS.of(parameters[rows[0]]).run
        arguments = [[values[row] for row in rows] for values in (parameters, durations_s, sources)]
        made |= zip(rows, run(*arguments) if _takes_batches(run) else map(run, *arguments), strict=True)
    return [made[row] for row in range(len(keys))]


@cache
def _takes_batches(run: Generate) -> bool:
    try:
        return list(signature(run).parameters)[1:] == ["durations_s", "rngs"]
    except ValueError:  # a builtin states no parameters
        return False
