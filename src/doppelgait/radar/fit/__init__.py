"""Fit a sensor model to a recording of an empty room.

The model has noise, clutter, phase drift and faults of the radar.
"""

from doppelgait.radar.fit.model import SensorFit, estimate_rows, fit_sensor, sensor_as_dict
from doppelgait.radar.fit.preset import calibrated_preset, calibrated_radar
from doppelgait.radar.fit.static import Estimate

__all__ = [
    "Estimate",
    "SensorFit",
    "calibrated_preset",
    "calibrated_radar",
    "estimate_rows",
    "fit_sensor",
    "sensor_as_dict",
]
