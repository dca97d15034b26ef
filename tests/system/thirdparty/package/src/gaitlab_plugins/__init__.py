"""Plug-ins of another laboratory: all that doppelgait needs to know is this module's name."""

from typing import Literal

import numpy as np
from pydantic import Field

import doppelgait as dg
from doppelgait.core.config import FrozenModel
from doppelgait.scene.rcs import scatterer_rcs_m2


class Hum(FrozenModel):
    """Mains hum on the receiver.

    Parameters
    ----------
    level_v : float
        Amplitude, V.
    frequency_hz : float
    """

    kind: Literal["hum"] = "hum"
    level_v: float = Field(default=1e-6, ge=0)
    frequency_hz: float = Field(default=50.0, gt=0)


@dg.plugin("impairment", parameters=Hum, version="2")
def add_hum(samples, parameters, radar, rng):
    """Add a sine of random phase to every pulse."""
    turn_rad = 2 * np.pi * parameters.frequency_hz * np.arange(samples.shape[0]) / radar.prf_hz
    hum_v = parameters.level_v * np.cos(turn_rad + rng.uniform(0, 2 * np.pi))
    return samples + hum_v[:, None].astype(np.float32)


class Backpack(dg.scene.RcsSpec):
    """A body by its parts, with a reflector on the torso.

    Parameters
    ----------
    reflector_gain : float
        Radar cross section of the reflector over that of the whole body, 1.
    """

    kind: Literal["gaitlab_backpack"] = "gaitlab_backpack"
    reflector_gain: float = Field(default=1.0, ge=0, le=100)


@dg.plugin("rcs", parameters=Backpack, version="3")
def scatter_backpack(view, parameters):
    """Share the body's total by its parts and add the reflector to the torso."""
    torso = np.isin(view.motion.parts, ["torso", "trunk"])
    body_m2 = scatterer_rcs_m2(dg.scene.RcsSpec(total_m2=parameters.total_m2), view.motion.parts, 80.0)
    return view.motion, body_m2 + parameters.reflector_gain * body_m2.sum() * torso / torso.sum()


@dg.plugin("feature", "gaitlab_peak_share", unit="1", source="gaitlab: share of the strongest cell")
def peak_share(observed):
    """Share of the signature's power in its strongest cell."""
    return float(observed.power_v2.max() / observed.power_v2.sum())
