"""Surroundings: walls, reflections by floor and walls, and what the radar sees of the rest.

Every effect is a parameter model with a ``kind`` and a pure function from scatterer table to scatterer table. A scene
file lists them as ``[[environment]]`` tables; they act in that order.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any

import xarray as xr
from pydantic import AfterValidator, BeforeValidator, SerializeAsAny

from doppelgait.core.config import FrozenModel, validate
from doppelgait.core.errors import ConfigError
from doppelgait.scene.environment.bounce import GroundBounce, apply_ground_bounce
from doppelgait.scene.environment.ghost import WallGhost, apply_wall_ghost
from doppelgait.scene.environment.materials import MATERIALS, Dielectric, Material, relative_permittivity
from doppelgait.scene.environment.registry import ENVIRONMENT, EnvironmentEffect
from doppelgait.scene.environment.setting import Setting
from doppelgait.scene.environment.visibility import Visibility, apply_visibility
from doppelgait.scene.environment.wall import Wall, apply_wall

__all__ = [
    "ENVIRONMENT", "MATERIALS", "Dielectric", "Environment", "EnvironmentEffect", "GroundBounce", "Material", "Setting",
    "Visibility", "Wall", "WallGhost", "apply_environment", "apply_ground_bounce", "apply_visibility", "apply_wall",
    "apply_wall_ghost", "make_effect", "needs_angles", "relative_permittivity",
]  # fmt: skip

ENVIRONMENT.add("visibility", EnvironmentEffect(Visibility, apply_visibility, lambda _: False))


def make_effect(table: Mapping[str, Any]) -> FrozenModel:
    """Environment effect of an ``[[environment]]`` table.

    Raises
    ------
    ConfigError
        If the kind or a parameter is not allowed.
    """
    kind = table.get("kind")
    if not isinstance(kind, str) or kind not in ENVIRONMENT:
        raise ConfigError(f"environment kind {kind!r} is not allowed: known are {', '.join(ENVIRONMENT)}")
    return validate(ENVIRONMENT[kind].model, table, where=f"environment kind {kind!r}")


def apply_environment(scatterers: xr.Dataset, effects: Sequence[FrozenModel], setting: Setting) -> xr.Dataset:
    """Scatterer table after all effects, in the order of the list.

    Parameters
    ----------
    scatterers : Dataset (slow_time, scatterer)
        As :func:`doppelgait.scene.assemble` makes it; with angles where :func:`needs_angles`.
    effects : sequence of FrozenModel
        Specifications such as :class:`Wall`; a field of type :data:`Environment` holds them.
    setting : Setting

    Returns
    -------
    Dataset
        Originals first, in their order; added rows belong to no target (``target`` -1). Without effects the table
        itself.

    Raises
    ------
    ConfigError
        If something is no effect, the order is not allowed, or an effect cannot work on this table.
    """
    for spec in check_order(effects):
        scatterers = _effect_of(spec).apply(scatterers, spec, setting)
    return scatterers


def needs_angles(effects: Sequence[FrozenModel]) -> bool:
    """Whether one of the effects needs azimuth and elevation in the table."""
    return any(_effect_of(spec).needs_angles(spec) for spec in effects)


def check_order(effects: Sequence[FrozenModel]) -> tuple[FrozenModel, ...]:
    """The effects; a :class:`ConfigError` where reflections come after something that changes ranges or levels.

    Images are made from the places of the scatterers, which a wall's delay would falsify, and they cross walls and
    fade with range themselves.
    """
    floors = [spec for spec in effects if isinstance(spec, GroundBounce)]
    if len(floors) > 1:
        raise ConfigError("environment: 'ground_bounce' is there twice, but there is one floor; leave one out")
    changed = ""
    for spec in effects:
        if not _effect_of(spec).makes_images:
            changed = changed or str(getattr(spec, "kind", ""))
        elif changed:
            kind = str(getattr(spec, "kind", ""))
            raise ConfigError(
                f"environment: {kind!r} comes after {changed!r}, but reflections must come first, so that they cross "
                f"walls and lose level too; move {kind!r} before {changed!r}"
            )
    return tuple(effects)


def _effect_of(spec: FrozenModel) -> EnvironmentEffect:
    kind = getattr(spec, "kind", None)
    if not isinstance(kind, str) or kind not in ENVIRONMENT or not isinstance(spec, ENVIRONMENT[kind].model):
        raise ConfigError(
            f"{spec!r} is no environment effect; make one with make_effect({{'kind': ...}}), kinds are "
            f"{', '.join(ENVIRONMENT)}"
        )
    return ENVIRONMENT[kind]


def _from_table(value: Any) -> Any:
    try:
        effect = make_effect(value) if isinstance(value, Mapping) else value
        if isinstance(effect, FrozenModel):
            _effect_of(effect)
    except ConfigError as error:
        raise ValueError(str(error)) from None
    return effect


def _in_order(effects: tuple[FrozenModel, ...]) -> tuple[FrozenModel, ...]:
    try:
        return check_order(effects)
    except ConfigError as error:
        raise ValueError(str(error)) from None


Environment = Annotated[
    tuple[Annotated[SerializeAsAny[FrozenModel], BeforeValidator(_from_table)], ...], AfterValidator(_in_order)
]
"""Type of a model's field that takes a list of environment effects, as tables or as their models."""
