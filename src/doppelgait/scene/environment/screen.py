"""Screen in front of the targets: sofa, table, half-open door."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import numpy as np
import xarray as xr
from pydantic import Field, model_validator

from doppelgait.core.config import FrozenModel
from doppelgait.core.labels import replace_values
from doppelgait.core.plugins import plugin
from doppelgait.core.units import db_to_power
from doppelgait.scene.environment.reflections import FloatArray, make_direct_rays
from doppelgait.scene.environment.registry import Setting

Place = tuple[Annotated[float, Field(ge=-1e5, le=1e5)], Annotated[float, Field(ge=-1e5, le=1e5)]]


class Screen(FrozenModel):
    """Thin vertical screen on the floor, such as furniture.

    Parameters
    ----------
    from_m : [x, y]
        One end on the floor.
    to_m : [x, y]
        The other end on the floor, at least 1 cm from the first.
    height_m : float
        Height above the floor, above 0, up to 20 m.
    loss_db : float
        One-way loss through the screen, 0 to 300 dB; at 7 GHz it is 2 to 3 dB for a wooden board,
        and metal blocks all power.
    """

    kind: Literal["screen"] = "screen"
    from_m: Place
    to_m: Place
    height_m: float = Field(gt=0, le=20)
    loss_db: float = Field(ge=0, le=300)

    @model_validator(mode="after")
    def _has_width(self) -> Screen:
        if math.dist(self.from_m, self.to_m) < 0.01:
            raise ValueError("the distance of from_m and to_m must be at least 0.01 m")
        return self


@plugin("environment", parameters=Screen, needs_angles=True, is_smooth=True)
def apply_screen(scatterers: xr.Dataset, spec: Screen, setting: Setting) -> xr.Dataset:
    """Attenuate the scatterers behind a screen.

    Parameters
    ----------
    scatterers : Dataset (slow_time, scatterer)
        With angles.
    spec : Screen
    setting : Setting

    Returns
    -------
    Dataset
        Table with ``path_gain`` reduced by twice the one-way loss: the minimum of ``loss_db`` and the knife-edge losses
        over the top and around both ends (:func:`knife_edge_db`). Scatterers in front of the screen are unchanged.

    Raises
    ------
    ConfigError
        If the table lacks angles, or is bistatic.

    Notes
    -----
    Images in the floor are attenuated by the screen's own image below the floor. Images in a side
    wall are attenuated by the screen, not by its image in that wall. The longer paths around the
    edges are not modelled: the range remains that of the straight line.
    """
    direct = make_direct_rays(scatterers, effect=spec.kind)
    radar_x_m, radar_y_m, radar_z_m = setting.radar_position_m
    x_m, y_m = spec.from_m[0] - radar_x_m, spec.from_m[1] - radar_y_m
    along_x_m, along_y_m = spec.to_m[0] - spec.from_m[0], spec.to_m[1] - spec.from_m[1]
    level_m = np.maximum(np.hypot(direct.x_m, direct.y_m), 1e-9)
    # radar + share * (place - radar) = from_m + part * (to_m - from_m), seen from above
    across_m2 = direct.x_m * along_y_m - direct.y_m * along_x_m
    across_m2 = np.where(np.abs(across_m2) < 1e-12, 1e-12, across_m2)
    share = (x_m * along_y_m - y_m * along_x_m) / across_m2
    part = (x_m * direct.y_m - y_m * direct.x_m) / across_m2
    between = (share > 0) & (share < 1)
    share = np.where(between, share, 0.5)
    length_m = np.maximum(direct.range_m, 1e-9)
    per_m = np.sqrt(2.0 / (setting.wavelength_m * length_m * share * (1.0 - share)))
    seen_width_m = np.abs(across_m2) / level_m
    below_top_m = (spec.height_m - np.abs(radar_z_m + share * direct.z_m)) * level_m / length_m
    loss_db = np.full(share.shape, spec.loss_db)
    for inside_m in (below_top_m, part * seen_width_m, (1.0 - part) * seen_width_m):
        loss_db = np.minimum(loss_db, knife_edge_db(inside_m * per_m))
    loss_db = np.where(between, loss_db, 0.0)
    return replace_values(scatterers, path_gain=scatterers["path_gain"].values * db_to_power(-2.0 * loss_db))


def knife_edge_db(v: FloatArray) -> FloatArray:
    """Compute the loss over a knife edge, dB (ITU-R P.526-15, equation 31)."""
    # v is the depth h of the straight line in the shadow times sqrt(2 / lambda (1/d1 + 1/d2)). For
    # v >= 0 the loss is within 0.7 dB of Fresnel's integral.
    deep = np.maximum(v, -0.78) - 0.1
    return np.where(v > -0.78, 6.9 + 20.0 * np.log10(np.sqrt(deep * deep + 1.0) + deep), 0.0)
