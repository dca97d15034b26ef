"""Fit sensor models to recordings.

A recording of an empty room is fitted to a sensor; several recordings are fitted to a sensor kind with its spread.
"""

from doppelgait.radar.fit.measure import SensorMeasurement, measure_recording
from doppelgait.radar.fit.pool import PooledQuantity, SensorKind, fit_sensor, pool
from doppelgait.radar.fit.preset import describe_sensor, format_preset
from doppelgait.radar.fit.room import Estimate

__all__ = [
    "Estimate",
    "PooledQuantity",
    "SensorKind",
    "SensorMeasurement",
    "describe_sensor",
    "fit_sensor",
    "format_preset",
    "measure_recording",
    "pool",
]
