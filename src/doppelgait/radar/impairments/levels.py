"""Levels in volts, and unit echoes, whatever the waveform."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import ConfigError
from doppelgait.core.units import db_to_amplitude
from doppelgait.radar.impairments.registry import Samples
from doppelgait.radar.parameters import Radar


def volts_per_unit(radar: Radar, *, wanted_by: str) -> float:
    """Volts per unit of the sensor's own files.

    Raises
    ------
    ConfigError
        If the radar does not say it.
    """
    if radar.volts_per_unit is None:
        raise ConfigError(
            f"{wanted_by} is in the sensor's own unit, but the radar {radar.name!r} has no volts_per_unit: set "
            "radar.volts_per_unit, or give the level in dB re 1 V"
        )
    return radar.volts_per_unit


def level_to_volt(level_db: float, radar: Radar, *, in_units: bool, wanted_by: str) -> float:
    """Volts of a level in dB re 1 V, or re one unit of the sensor's own files."""
    unit_v = volts_per_unit(radar, wanted_by=wanted_by) if in_units else 1.0
    return float(db_to_amplitude(level_db)) * unit_v


def static_samples(range_m: npt.NDArray[np.float64], amplitude_v: npt.NDArray[np.float64], radar: Radar) -> Samples:
    """Receiver samples of scatterers at rest, each row of ``range_m`` a pulse.

    Parameters
    ----------
    range_m, amplitude_v : ndarray, shape (I, L)
        Range and echo amplitude at the receiver output, V, 0 or larger.
    radar : Radar

    Returns
    -------
    ndarray, shape (I, S), complex64
    """
    import xarray as xr

    from doppelgait.radar.link import echo_amplitude_v

    one_v = echo_amplitude_v(radar, range_m=range_m, rcs_m2=1.0)
    values = {
        "range": range_m,
        "radial_velocity": np.zeros_like(range_m),
        "rcs": np.ones_like(range_m),
        "path_gain": (amplitude_v / one_v) ** 2,
    }
    dims = ("slow_time", "scatterer")
    coords = {"slow_time": np.arange(range_m.shape[0]) / radar.prf_hz}
    table = xr.Dataset({name: (dims, value) for name, value in values.items()}, coords=coords)
    return radar.waveform.synthesise(table, radar)
