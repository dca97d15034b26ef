"""Fit sensor models to recordings.

One recording of an empty room gives a sensor, several recordings give a kind of sensors with its spread.
"""

from doppelgait.radar.fit.kind import kind_preset, kind_rows
from doppelgait.radar.fit.measure import Measured, measure_recording
from doppelgait.radar.fit.model import SensorFit, estimate_rows, fit_sensor, sensor_as_dict
from doppelgait.radar.fit.pool import SensorKind, fit_kind
from doppelgait.radar.fit.population import Pooled, pool
from doppelgait.radar.fit.preset import calibrated_preset, calibrated_radar
from doppelgait.radar.fit.static import Estimate

__all__ = [
    "Estimate",
    "Measured",
    "Pooled",
    "SensorFit",
    "SensorKind",
    "calibrated_preset",
    "calibrated_radar",
    "estimate_rows",
    "fit_kind",
    "fit_sensor",
    "kind_preset",
    "kind_rows",
    "measure_recording",
    "pool",
    "sensor_as_dict",
]
