"""How an environment effect is declared, and the names that a scene file can give."""

from __future__ import annotations

from typing import Any, Protocol

import xarray as xr

from doppelgait.core.plugins import Group
from doppelgait.scene.environment.setting import Setting


class Apply(Protocol):
    """An environment effect: the scatterer table after it, without a change to the one before.

    Originals come first, added rows after them; added rows belong to no target (``target`` -1). Facts of the plug-in:
    ``needs_angles`` (bool, or a function of the parameters) if the table must have azimuth and elevation, and
    ``makes_images=True`` if it adds echoes by reflected paths. Such effects take places from ranges, so they come
    before those that lengthen or attenuate paths.
    """

    def __call__(self, scatterers: xr.Dataset, parameters: Any, setting: Setting, /) -> xr.Dataset:
        """Scatterer table (slow_time, scatterer) after the effect."""


ENVIRONMENT: Group[Apply] = Group(
    "environment",
    built_in=tuple(f"doppelgait.scene.environment.{name}" for name in ("bounce", "ghost", "visibility", "wall")),
)
"""Environment effects by the ``kind`` of a scene file's ``[[environment]]``."""
