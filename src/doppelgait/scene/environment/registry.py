"""How an environment effect is declared, and the names that a scene file can give."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import xarray as xr

from doppelgait.core.config import FrozenModel
from doppelgait.core.registry import Registry


@dataclass(frozen=True)
class EnvironmentEffect:
    """Something between the targets and the radar that changes the scatterer table.

    Parameters
    ----------
    model : type
        Parameters of the effect; ``kind`` among them is its name.
    apply : callable
        ``apply(scatterers, spec, setting) -> scatterers``: pure, originals first, added rows after them.
    needs_angles : callable
        ``needs_angles(spec) -> bool``: whether the table must have azimuth and elevation.
    makes_images : bool
        Whether it adds echoes by reflected paths. Such effects take places from ranges, so they come before those that
        lengthen or attenuate paths.
    """

    model: type[FrozenModel]
    apply: Callable[[xr.Dataset, Any, Any], xr.Dataset]
    needs_angles: Callable[[Any], bool]
    makes_images: bool = False


ENVIRONMENT: Registry[EnvironmentEffect] = Registry("doppelgait.environment", "environment effect")
"""Environment effects by ``kind``."""
