"""Environment effects: walls, reflections by floor and walls, and visibility.

Every effect is a parameter model with a ``kind`` and a pure function from scatterer table to
scatterer table. A scene file lists them as ``[[environment]]`` tables; they act in that order.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import AfterValidator

from doppelgait.core.config import FrozenModel
from doppelgait.core.errors import AnalysisError, ConfigError
from doppelgait.core.labels import ScattererTable, maps_table, takes_arrays
from doppelgait.core.lazy import xr
from doppelgait.scene.environment.effects import (
    ENVIRONMENT,
    Apply,
    GroundBounce,
    Screen,
    Setting,
    Visibility,
    Wall,
    WallGhost,
    apply_visibility,
    apply_wall,
)
from doppelgait.scene.environment.materials import MATERIALS, Dielectric, Material, relative_permittivity

__all__ = [
    "ENVIRONMENT",
    "MATERIALS",
    "Apply",
    "Dielectric",
    "Environment",
    "GroundBounce",
    "Material",
    "Screen",
    "Setting",
    "Visibility",
    "Wall",
    "WallGhost",
    "apply_environment",
    "apply_visibility",
    "apply_wall",
    "make_effect",
    "needs_angles",
    "relative_permittivity",
]


def make_effect(table: Mapping[str, Any]) -> FrozenModel:
    """Make the environment effect of an ``[[environment]]`` table.

    Raises
    ------
    ConfigError
        If the kind or a parameter is not allowed.
    """
    return ENVIRONMENT.parse(table)


@maps_table
def apply_environment(scatterers: ScattererTable, effects: Sequence[FrozenModel], setting: Setting) -> ScattererTable:
    """Apply all environment effects to a scatterer table, in order.

    Parameters
    ----------
    scatterers : Dataset (slow_time, scatterer)
        Table from :func:`doppelgait.scene.assemble`, with angles if :func:`needs_angles` is true.
    effects : sequence of FrozenModel
        Specifications such as :class:`Wall`; a field of type :data:`Environment` holds them.

    Returns
    -------
    Dataset
        The original rows come first, in their order; added rows have the ``target``
        -1, or -2 of a background body. Without effects, the table itself is returned.

    Raises
    ------
    ConfigError
        If a value is not an effect, the order is not allowed, or an effect cannot be applied to this table.
    AnalysisError
        If an effect does not return a table with the same pulses and columns.
    """
    for spec in check_order(effects):
        item, before = ENVIRONMENT.of(spec), scatterers
        owner = f"environment effect {item.name!r} of {item.package}"
        after: Any = item.run(before if takes_arrays(item.run) else before.label(), spec, setting)
        if not isinstance(after, ScattererTable) and not isinstance(after, xr.Dataset):
            raise AnalysisError(f"{owner} returns {type(after).__name__}, not a scatterer table")
        scatterers = ScattererTable.of(after)
        if missing := [name for name in (*before.values, *before.columns) if name not in scatterers]:
            raise AnalysisError(f"{owner} returns a table without {', '.join(missing)}")
        n_before, n_after = before.slow_time_s.size, scatterers.slow_time_s.size
        if n_after != n_before:
            raise AnalysisError(f"{owner} returns {n_after} pulses instead of {n_before}; it must keep the pulses")
    return scatterers


def needs_angles(effects: Sequence[FrozenModel]) -> bool:
    """Return True if an effect needs azimuth and elevation."""
    wanted = [(ENVIRONMENT.of(spec).facts.get("needs_angles", False), spec) for spec in effects]
    return any(bool(needs(spec)) if callable(needs) else bool(needs) for needs, spec in wanted)


def check_order(effects: Sequence[FrozenModel]) -> tuple[FrozenModel, ...]:
    """Check and return the effects in their order."""
    # A ConfigError is raised if a reflection follows an effect that changes ranges or levels
    floors = [spec for spec in effects if isinstance(spec, GroundBounce)]
    if len(floors) > 1:
        raise ConfigError("environment: 'ground_bounce' is listed twice, but there is one floor; remove one entry")
    changed = ""
    for spec in effects:
        kind = str(getattr(spec, "kind", ""))
        try:
            makes_images = ENVIRONMENT.of(spec).facts.get("makes_images")
        except ConfigError:
            raise ConfigError(
                f"{spec!r} is not an environment effect; make one with make_effect({{'kind': ...}}), kinds are "
                f"{', '.join(ENVIRONMENT)}"
            ) from None
        if not makes_images:
            changed = changed or kind
        elif changed:
            raise ConfigError(
                f"environment: {kind!r} is listed after {changed!r}, but reflections must be listed first, so that "
                f"walls and losses apply to them too; move {kind!r} before {changed!r}"
            )
    return tuple(effects)


def _validate_order(effects: tuple[FrozenModel, ...]) -> tuple[FrozenModel, ...]:
    try:
        return check_order(effects)
    except ConfigError as error:
        raise ValueError(str(error)) from None


if TYPE_CHECKING:
    Environment = tuple[FrozenModel, ...]
else:
    Environment = Annotated[tuple[ENVIRONMENT.field(), ...], AfterValidator(_validate_order)]
"""Type of a model's field that takes environment effects, as tables or as their models."""
