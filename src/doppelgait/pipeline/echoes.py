"""What reaches the receiver: the scene seen through its environment and the antenna, and the frame times."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.core.config import FrozenModel, validate
from doppelgait.core.labels import axis
from doppelgait.radar.antenna import apply_antenna
from doppelgait.radar.config import Radar
from doppelgait.radar.impairments import Impairments, pulse_times
from doppelgait.scene import LineOfSight, Scene, observe
from doppelgait.scene.environment import Environment, Setting, apply_environment, needs_angles

FloatArray = npt.NDArray[np.float64]


class _Lists(FrozenModel):
    environment: Environment = ()
    impairments: Impairments = ()


@dataclass(frozen=True)
class Conditions:
    """What stands between an ideal recording and a real one.

    Parameters
    ----------
    environment : sequence of models or tables
        Walls, bounces and the like (:mod:`doppelgait.scene.environment`), reflections first.
    impairments : sequence of models or tables
        What the receiver does to its samples (:mod:`doppelgait.radar.impairments`), in order.

    Raises
    ------
    ConfigError
        If a kind or a parameter is not allowed.
    """

    environment: Sequence[FrozenModel | Mapping[str, Any]] = ()
    impairments: Sequence[FrozenModel | Mapping[str, Any]] = ()

    def __post_init__(self) -> None:
        lists = {"environment": self.environment, "impairments": self.impairments}
        checked = validate(_Lists, lists, where="conditions")
        for name in lists:
            object.__setattr__(self, name, getattr(checked, name))

    @property
    def effects(self) -> tuple[FrozenModel, ...]:
        """The environment as models, whichever way it was given."""
        return cast("tuple[FrozenModel, ...]", self.environment)

    @property
    def faults(self) -> tuple[FrozenModel, ...]:
        """The impairments as models, whichever way they were given."""
        return cast("tuple[FrozenModel, ...]", self.impairments)

    def names(self, kind: str) -> bool:
        """Whether an impairment of this kind is among them."""
        return any(getattr(spec, "kind", "") == kind for spec in self.faults)


def received(
    scene: Scene, radar: Radar, slow_time_s: FloatArray, conditions: Conditions, *, angles: bool,
    scene_rng: np.random.Generator | None, timing_rng: np.random.Generator | None,
) -> tuple[xr.Dataset, list[LineOfSight]]:  # fmt: skip
    """Scatterer table as the receiver gets it, and the centre tracks of the targets.

    Parameters
    ----------
    scene : Scene
    radar : Radar
    slow_time_s : ndarray, shape (I,)
        Nominal frame times; the table is labelled with them even where the frames are jittered.
    conditions : Conditions
    angles : bool
        Whether the table must hold angles; environment and antenna have them made where they need them.
    scene_rng, timing_rng : numpy.random.Generator or None
        Sources of what the scene and the frame times draw.
    """
    times_s = _frame_times_s(slow_time_s, radar, conditions, timing_rng)
    patterned = radar.antenna.kind != "isotropic"
    angles = angles or patterned or needs_angles(conditions.effects)
    scatterers, tracks = observe(scene, times_s, angles=angles, rng=scene_rng)
    if conditions.effects:
        azimuth_rad = math.radians(scene.radar_azimuth_deg)
        setting = Setting(radar.wavelength_m, scene.radar_position_m, azimuth_rad)
        scatterers = apply_environment(scatterers, conditions.effects, setting)
    if patterned:
        scatterers = apply_antenna(
            scatterers,
            radar.antenna,
            boresight_azimuth_rad=math.radians(scene.radar_azimuth_deg),
            boresight_tilt_rad=math.radians(scene.radar_tilt_deg),
        )
    if times_s is not slow_time_s:
        scatterers = scatterers.assign_coords(slow_time=("slow_time", slow_time_s, {"units": "s"}))
    return scatterers, tracks


def _frame_times_s(
    slow_time_s: FloatArray, radar: Radar, conditions: Conditions, rng: np.random.Generator | None
) -> FloatArray:
    if not conditions.faults or rng is None:
        return slow_time_s
    return pulse_times(slow_time_s, conditions.faults, radar=radar, rng=rng)


def of_targets(scatterers: xr.Dataset) -> xr.Dataset:
    """Rows of the table that belong to a target: no ghosts, no background movers."""
    own = axis(scatterers, "target") >= 0
    return scatterers if own.all() else scatterers.isel(scatterer=np.flatnonzero(own))
