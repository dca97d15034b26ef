"""Detections of one scan above the noise."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Detection:
    """One cluster of range-Doppler cells.

    Parameters
    ----------
    range_m, velocity_mps : float
        Centre; the radial velocity is positive when approaching.
    power_v2 : float
        Power above the noise, summed over all cells.
    range_sd_m, velocity_sd_mps : float
        Standard deviations of the centre as a measurement of the body's range and velocity, above 0.
    range_low_m, range_high_m, velocity_low_mps, velocity_high_mps : float
        Limits of the box that contains nearly all of its power.
    n_cells : int
        Cells above the threshold.
    """

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
    """Detections of one coherent processing interval.

    Parameters
    ----------
    time_s : float
        Middle of the interval.
    detections : tuple of Detection
    """

    time_s: float
    detections: tuple[Detection, ...] = ()
