"""What reaches the receiver: the scene seen through its environment and the antenna, and the frame times."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
import numpy.typing as npt
import xarray as xr
from pydantic import Field

from doppelgait.core.config import FrozenModel
from doppelgait.core.labels import axis
from doppelgait.core.rng import Streams
from doppelgait.radar.antenna import apply_antenna
from doppelgait.radar.impairments import Impairments, pulse_times
from doppelgait.radar.parameters import Radar
from doppelgait.scene import LineOfSight, PlacedScene, assemble, body_track
from doppelgait.scene.environment import Environment, Setting, apply_environment, needs_angles

FloatArray = npt.NDArray[np.float64]


class Noise(FrozenModel):
    """Receiver noise, added before every impairment.

    Parameters
    ----------
    kind : {"thermal", "snr", "none"}
        ``thermal``: from the radar's noise figure and bandwidth (E-18), unless the list of impairments has an entry
        ``thermal_noise`` of its own. ``snr``: as much as gives ``snr_db``.
    snr_db : float
        Wanted SNR_frame: time mean of the strongest bin's power over the noise power.
    """

    kind: Literal["thermal", "snr", "none"] = "thermal"
    snr_db: float = Field(default=20.0, ge=-100, le=200)


class Conditions(FrozenModel):
    """What stands between an ideal recording and a real one.

    Parameters
    ----------
    noise : Noise
        Receiver noise; thermal by default.
    environment : sequence of models or tables
        Walls, bounces and the like (:mod:`doppelgait.scene.environment`), reflections first.
    impairments : sequence of models or tables
        What the receiver does to its samples (:mod:`doppelgait.radar.impairments`), in order.

    Raises
    ------
    ConfigError
        If a kind or a parameter is not allowed.
    """

    noise: Noise = Noise()
    environment: Environment = ()
    impairments: Impairments = ()

    def has_impairment(self, kind: str) -> bool:
        """Whether an impairment of this kind is among them."""
        return any(getattr(spec, "kind", "") == kind for spec in self.impairments)


def received(
    placed: PlacedScene, radar: Radar, slow_time_s: FloatArray, conditions: Conditions, *, angles: bool,
    streams: Streams | None,
) -> tuple[xr.Dataset, list[LineOfSight]]:  # fmt: skip
    """Scatterer table as the receiver gets it, and the centre tracks of the targets.

    Parameters
    ----------
    placed : PlacedScene
    radar : Radar
    slow_time_s : ndarray, shape (I,)
        Nominal frame times; the table is labelled with them even where the frames are jittered.
    conditions : Conditions
    angles : bool
        Whether the table must hold angles; environment and antenna have them made where they need them.
    streams : Streams or None
        Of the radar cross sections (``scene``) and of the frame times (``impairments``).
    """
    times_s = slow_time_s
    if conditions.impairments and streams is not None:
        timing_rng, _ = streams.generator("impairments").spawn(2)
        times_s = pulse_times(slow_time_s, conditions.impairments, radar=radar, rng=timing_rng)
    patterned = radar.antenna.kind != "isotropic"
    angles = angles or patterned or needs_angles(conditions.environment)
    scene_rng = None if streams is None else streams.generator("scene")
    scene, scatterers = placed.scene, assemble(placed, times_s, angles=angles, rng=scene_rng)
    tracks = [body_track(target, scene, times_s) for target in placed.observed]
    if conditions.environment:
        azimuth_rad = math.radians(scene.radar_azimuth_deg)
        setting = Setting(radar.wavelength_m, scene.radar_position_m, azimuth_rad)
        scatterers = apply_environment(scatterers, conditions.environment, setting)
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


def split_targets(scatterers: xr.Dataset) -> tuple[xr.Dataset, xr.Dataset | None]:
    """Rows of the table that belong to targets, and the ghosts and background movers, if there are any."""
    own = axis(scatterers, "target") >= 0
    if own.all():
        return scatterers, None
    count = int(own.sum())
    if own[:count].all():  # targets first, as is usual: a view of the table
        return scatterers.isel(scatterer=slice(count)), scatterers.isel(scatterer=slice(count, None))
    return scatterers.isel(scatterer=np.flatnonzero(own)), scatterers.isel(scatterer=np.flatnonzero(~own))
