"""Detections of one scan above the noise."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Detection:
    """One cluster of range-Doppler cells."""

    range_m: float
    velocity_mps: float
    power_v2: float
    range_sd_m: float
    velocity_sd_mps: float
    range_low_m: float
    range_high_m: float
    velocity_low_mps: float
    velocity_high_mps: float
    n_cells: int


@dataclass(frozen=True)
class Scan:
    """Detections of one coherent processing interval."""

    time_s: float
    detections: tuple[Detection, ...] = ()
