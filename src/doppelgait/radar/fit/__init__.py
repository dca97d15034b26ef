"""Fit sensor models to recordings.

One recording of an empty room is fitted to a sensor; several recordings are fitted to a sensor kind with its spread.
"""

from doppelgait.radar.fit.measure import SensorMeasurement, measure_recording
from doppelgait.radar.fit.model import SensorFit, estimate_rows, fit_sensor, sensor_as_dict
from doppelgait.radar.fit.pool import PooledQuantity, SensorKind, fit_kind, pool
from doppelgait.radar.fit.preset import calibrate_radar, format_calibrated_preset, format_kind_preset, kind_rows
from doppelgait.radar.fit.room import Estimate

__all__ = [
    "Estimate",
    "PooledQuantity",
    "SensorFit",
    "SensorKind",
    "SensorMeasurement",
    "calibrate_radar",
    "estimate_rows",
    "fit_kind",
    "fit_sensor",
    "format_calibrated_preset",
    "format_kind_preset",
    "kind_rows",
    "measure_recording",
    "pool",
    "sensor_as_dict",
]
