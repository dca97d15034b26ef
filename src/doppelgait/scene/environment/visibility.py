"""Visibility by range: time control, blind zone, end of display."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Literal

import numpy as np
import xarray as xr
from pydantic import Field, field_validator

from doppelgait.core.config import FrozenModel
from doppelgait.core.labels import replace_values
from doppelgait.core.plugins import plugin
from doppelgait.core.units import db_to_power
from doppelgait.scene.environment.registry import Setting

RangeGain = tuple[Annotated[float, Field(ge=0, le=1e6)], Annotated[float, Field(ge=-300, le=300)]]


class Visibility(FrozenModel):
    """Receiver gain by range.

    Parameters
    ----------
    gain_db : list of [range_m, gain_db]
        One or more pairs of range (m, rising, 0 to 1e6) and two-way power gain at that range (dB, -300 to 300). The
        gain is interpolated in dB between two pairs and constant beyond the ends. Two neighbouring pairs make a step:
        ``[[0.4, -200.0], [0.41, 0.0]]`` is a blind zone up to 0.4 m.
    """

    kind: Literal["visibility"] = "visibility"
    gain_db: tuple[RangeGain, ...] = Field(min_length=1, max_length=10_000)

    @field_validator("gain_db")
    @classmethod
    def _check_rising(cls, gain_db: tuple[RangeGain, ...]) -> tuple[RangeGain, ...]:
        for (range_m, _), (next_m, _) in pairwise(gain_db):
            if not next_m > range_m:
                raise ValueError(f"ranges must rise from pair to pair, but {next_m:g} m follows {range_m:g} m")
        return gain_db


@plugin("environment", parameters=Visibility)
def apply_visibility(scatterers: xr.Dataset, spec: Visibility, setting: Setting) -> xr.Dataset:
    """Apply the visibility gain at every echo's range.

    Parameters
    ----------
    scatterers : Dataset (slow_time, scatterer)
    spec : Visibility
    setting : Setting
        Not used: the gain depends on range only.

    Returns
    -------
    Dataset
        Table with ``path_gain`` multiplied by 10^(gain_db / 10), where the gain is that of the apparent range (half the
        length of the echo's path). A wall increases the apparent range, so list ``visibility`` last.
    """
    ranges_m, gains_db = np.array(spec.gain_db).T
    gain = db_to_power(np.interp(scatterers["range"].values, ranges_m, gains_db))
    return replace_values(scatterers, path_gain=scatterers["path_gain"].values * gain)
