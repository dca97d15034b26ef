"""Fit of a sensor twin: noise, clutter, phase drift and faults of a radar from a recording of an empty room."""

from doppelgait.radar.fit.estimate import Estimate
from doppelgait.radar.fit.report import estimate_rows, twin_as_dict
from doppelgait.radar.fit.twin import TwinFit, fit_twin
from doppelgait.radar.fit.twin_file import twin_radar, twin_toml

__all__ = ["Estimate", "TwinFit", "estimate_rows", "fit_twin", "twin_as_dict", "twin_radar", "twin_toml"]
