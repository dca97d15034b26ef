"""Constants, elementary functions, and conversions between index, physical unit and decibel.

Equation labels (E-nn) are those of ``docs/theory.md``. All functions take scalars or arrays and return float64.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait._core import native

SPEED_OF_LIGHT_MPS = 299_792_458.0
NOISE_DENSITY_W_PER_HZ = 4.004e-21  # Boltzmann's constant times the noise temperature T0 = 290 K
REFERENCE_IMPEDANCE_OHM = 50.0
"""Impedance Z0 of the signal voltages. An envelope of a volts has the power a^2 / (2 Z0) in watts (E-14)."""

FloatArray = npt.NDArray[np.float64]
# NumPy's last digits depend on the processor, these do not, for angles up to 2^20 rad.
Map = Callable[[npt.NDArray[Any]], FloatArray]
sine: Map = native.sine
cosine: Map = native.cosine
arcsine: Map = native.arcsine
arccosine: Map = native.arccosine
exponential: Map = native.exponential
power_of_ten: Map = native.power_of_ten
logarithm: Map = native.logarithm
decimal_logarithm: Map = native.decimal_logarithm
arctangent: Callable[[FloatArray, FloatArray], FloatArray] = native.arctangent  # of y and x of one shape


def modified_bessel(numbers: FloatArray) -> FloatArray:
    """Compute the modified Bessel function I0 of numbers up to 100."""
    terms = np.multiply.accumulate(numbers[..., None] / (2.0 * np.arange(1, 200)), axis=-1)
    return np.asarray(1.0 + (terms * terms).sum(axis=-1))


def db_to_power(level_db: npt.ArrayLike) -> Any:
    """Convert a level in dB to a power ratio."""
    return power_of_ten(np.asarray(level_db, dtype=float) / 10.0)[()]


def power_to_db(power: npt.ArrayLike) -> Any:
    """Convert a power ratio to dB; 0 gives -inf."""
    return 10.0 * decimal_logarithm(np.asarray(power, dtype=float))


def db_to_amplitude(level_db: npt.ArrayLike) -> Any:
    """Convert a level in dB to a voltage ratio."""
    return power_of_ten(np.asarray(level_db, dtype=float) / 20.0)[()]


def dbm_to_watt(level_dbm: npt.ArrayLike) -> Any:
    """Convert a level in dBm to watts."""
    return 1e-3 * db_to_power(level_dbm)


def watt_to_volt(power_w: npt.ArrayLike) -> Any:
    """Convert mean power to amplitude, sqrt(2 Z0 P) (E-14)."""
    return np.sqrt(2.0 * REFERENCE_IMPEDANCE_OHM * np.asarray(power_w, dtype=float))


def carrier_to_wavelength_m(carrier_hz: float) -> float:
    """Convert a carrier frequency to its wavelength."""
    return SPEED_OF_LIGHT_MPS / carrier_hz


def range_to_delay_s(range_m: npt.ArrayLike) -> Any:
    """Convert range to two-way delay, 2 R / c (E-10)."""
    return 2.0 * np.asarray(range_m, dtype=float) / SPEED_OF_LIGHT_MPS


def velocity_to_doppler_hz(velocity_mps: npt.ArrayLike, wavelength_m: float) -> Any:
    """Convert velocity to Doppler shift, 2 v_r / lambda; positive for approaching (E-05)."""
    return 2.0 * np.asarray(velocity_mps, dtype=float) / wavelength_m


def doppler_to_velocity_mps(doppler_hz: npt.ArrayLike, wavelength_m: float) -> Any:
    """Convert Doppler shift to velocity, f_d lambda / 2; positive for approaching (E-05)."""
    return np.asarray(doppler_hz, dtype=float) * wavelength_m / 2.0


def unambiguous_velocity_mps(prf_hz: float, wavelength_m: float) -> float:
    """Compute the largest unaliased speed, lambda f_p / 4 (E-06)."""
    return wavelength_m * prf_hz / 4.0


def cpi_to_pulses(cpi_s: float, prf_hz: float) -> int:
    """Compute the pulses in a coherent processing interval, 2 floor(T_d f_p / 2) + 1 (E-21)."""
    return 2 * math.floor(cpi_s * prf_hz / 2.0 + 1e-9) + 1


def doppler_axis_hz(n_bins: int, prf_hz: float) -> FloatArray:
    """Compute the Doppler axis of K points, f_p (k - floor(K/2)) / K (E-25)."""
    return prf_hz * (np.arange(n_bins) - n_bins // 2) / n_bins


def slow_time_axis_s(n_pulses: int, prf_hz: float) -> FloatArray:
    """Compute the pulse times, t_i = i / f_p."""
    return np.arange(n_pulses) / prf_hz


def duration_to_pulses(duration_s: float, prf_hz: float) -> int:
    """Count the pulses in an observation time, floor(T_o f_p)."""
    return math.floor(duration_s * prf_hz + 1e-9)
