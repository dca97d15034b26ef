"""Static echoes: the direct path and the room."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field, field_validator, model_validator

from doppelgait.core.config import FrozenModel
from doppelgait.core.plugins import plugin
from doppelgait.core.samples import Samples
from doppelgait.core.units import db_to_amplitude, dbm_to_watt, watt_to_volt
from doppelgait.radar.impairments.apply import (
    Level,
    check_rising,
    check_width,
    convert_level_to_volt,
    find_volts_per_unit,
    make_static_samples,
)
from doppelgait.radar.link import echo_amplitude_v
from doppelgait.radar.parameters import Radar

CELLS_BEYOND = 3
"""Resolution cells before and behind the frame with clutter, which extends into it."""
SCATTERERS_PER_CELL = 4
"""Scatterers per half-power width; their sum is then a smooth Gaussian process."""
MAX_SCATTERERS = 200_000


class Leakage(FrozenModel):
    """Direct path from transmitter to receiver.

    It is one static echo with the width of the waveform.

    An X4 has about 0.06 units at 0 m and a tail of 1.3e-2 units at 0.7 m, which two such tables model.

    delay_m: Range at which the direct path appears: half its length.
    level_db: Amplitude of the peak in range, dB re 1 V. Set either this or ``isolation_db``.
    in_units: ``level_db`` is re one unit of the sensor's own files (``radar.volts_per_unit``).
    isolation_db: Loss from the transmit power to the receiver's input; 34 dB if no level is set
        (assumed, as for an X4).
    phase_deg: Phase added to that of the direct path.
    """

    kind: Literal["leakage"] = "leakage"
    delay_m: float = Field(default=0.05, ge=0, le=1e5)
    level_db: float | None = Field(default=None, ge=-400, le=100)
    in_units: bool = False
    isolation_db: float | None = Field(default=None, ge=-100, le=400)
    phase_deg: float = Field(default=0.0, ge=-360, le=360)

    @model_validator(mode="after")
    def _check_level(self) -> Leakage:
        if self.level_db is not None and self.isolation_db is not None:
            raise ValueError("give level_db or isolation_db, not both")
        if self.in_units and self.level_db is None:
            raise ValueError("in_units belongs to level_db, which is not set")
        return self


DEFAULT_ISOLATION_DB = 34.0


@plugin("impairment", parameters=Leakage)
def add_leakage(samples: Samples, parameters: Leakage, radar: Radar, rng: np.random.Generator) -> Samples:
    """Add the direct path to every pulse."""
    check_width(samples, radar)
    if parameters.level_db is not None:
        level_v = convert_level_to_volt(parameters, radar)
    else:  # sqrt(2 Z0 P_t) 10^((G_rx - isolation) / 20)
        loss_db = DEFAULT_ISOLATION_DB if parameters.isolation_db is None else parameters.isolation_db
        sent_v = float(watt_to_volt(dbm_to_watt(radar.tx_power_dbm)))
        level_v = sent_v * float(db_to_amplitude(radar.receiver_gain_db - loss_db))
    row = make_static_samples(np.array([[parameters.delay_m]]), np.array([[level_v]]), radar)
    phase_rad = math.radians(parameters.phase_deg)
    samples += row * np.complex64(complex(math.cos(phase_rad), math.sin(phase_rad)))
    return samples


class StaticClutter(FrozenModel):
    r"""Static scatterers of the room at all ranges.

    They are sampled once per recording. Every resolution cell has several scatterers with random
    phase and exponential power, so that |y| is Rayleigh distributed over realisations with the mean
    square

    .. math:: E|y(R)|^2 = \sum_k E a_k^2\, |p(R - R_k)|^2 \approx \overline{a^2}(R)\, \frac{1}{d} \int |p(r)|^2\,dr

    (p: range response of one echo with peak 1; d: spacing of the scatterers). An X4 measured -51 dB
    (re one unit) at 0.85 m and -60 to -88 dB at up to 8 m in an empty room.

    levels: Root mean square of the samples at rising ranges, dB re 1 V; linear in dB between them,
        constant outside.
    in_units: Levels are re one unit of the sensor's own files (``radar.volts_per_unit``).
    rcs_per_metre_m2: Mean radar cross section per metre of range, m^2, instead of levels
        (furniture: 0.03 to 0.3); the level follows from the radar equation.
    """

    kind: Literal["static_clutter"] = "static_clutter"
    levels: tuple[Level, ...] | None = Field(default=None, min_length=1, max_length=10_000)
    in_units: bool = False
    rcs_per_metre_m2: float | None = Field(default=None, ge=0, le=1e6)

    _check_rising = field_validator("levels")(check_rising)

    @model_validator(mode="after")
    def _check_choice(self) -> StaticClutter:
        if (self.levels is None) == (self.rcs_per_metre_m2 is None):
            raise ValueError("give exactly one of levels and rcs_per_metre_m2")
        if self.in_units and self.levels is None:
            raise ValueError("in_units belongs to levels, which are not set")
        return self


@plugin("impairment", parameters=StaticClutter)
def add_static_clutter(samples: Samples, parameters: StaticClutter, radar: Radar, rng: np.random.Generator) -> Samples:
    """Add one realisation of the room to every pulse."""
    check_width(samples, radar)
    range_m, spacing_m = make_clutter_ranges(radar)
    if parameters.levels is None:
        one_m2_v = echo_amplitude_v(radar, range_m=range_m, rcs_m2=1.0)
        rms_v = one_m2_v * math.sqrt(float(parameters.rcs_per_metre_m2 or 0.0) * echo_energy_m(radar))
    else:
        knots_m, levels_db = np.array(parameters.levels).T
        unit_v = find_volts_per_unit(radar, wanted_by="static_clutter: levels") if parameters.in_units else 1.0
        rms_v = db_to_amplitude(np.interp(range_m, knots_m, levels_db)) * unit_v
    amplitude_v = rms_v * np.sqrt(rng.standard_exponential(range_m.size) * spacing_m / echo_energy_m(radar))
    # a random shift of up to a quarter wavelength in both directions makes the phase uniform
    range_m = range_m + rng.uniform(-0.25, 0.25, size=range_m.size) * radar.wavelength_m
    samples += make_static_samples(range_m[None], amplitude_v[None], radar)
    return samples


def echo_energy_m(radar: Radar) -> float:
    """Return the energy of a compressed unit echo, m."""
    bin_m = radar.bin_spacing_m
    n_places = int(np.clip(math.ceil(4.0 * bin_m / radar.range_resolution_m), 8, 512))
    middle_m = radar.range_start_m + (radar.n_range_bins // 2) * bin_m
    range_m = middle_m + bin_m * (np.arange(n_places) + 0.5)[:, None] / n_places
    response = radar.waveform.compress(make_static_samples(range_m, np.ones_like(range_m), radar), radar)
    return bin_m * float((np.abs(response).astype(np.float64) ** 2).sum()) / n_places


def make_clutter_ranges(radar: Radar) -> tuple[npt.NDArray[np.float64], float]:
    """Return the ranges and the spacing of clutter scatterers, m; they may begin before 0."""
    cell_m = radar.range_resolution_m
    span_m = radar.range_stop_m - radar.range_start_m
    if cell_m < span_m:
        beyond_m = CELLS_BEYOND * cell_m
    else:  # one cell holds the whole frame
        cell_m, beyond_m = span_m / SCATTERERS_PER_CELL, 0.0
    n_scatterers = math.ceil((span_m + 2.0 * beyond_m) / cell_m * SCATTERERS_PER_CELL)
    n_scatterers = min(n_scatterers, MAX_SCATTERERS)
    spacing_m = (span_m + 2.0 * beyond_m) / n_scatterers
    range_m = radar.range_start_m - beyond_m + spacing_m * (np.arange(n_scatterers) + 0.5)
    end_m = radar.waveform.unambiguous_range_m(radar)
    if not radar.waveform.samples_are_bins and math.isfinite(end_m):
        # a transform is periodic: without those that would fold into the frame from its other end
        reach_m = CELLS_BEYOND * radar.range_resolution_m
        appears_m = range_m % end_m
        near = (appears_m > radar.range_start_m - reach_m) & (appears_m < radar.range_stop_m + reach_m)
        range_m = range_m[((range_m >= 0) & (range_m < end_m)) | ~near]
    return np.asarray(range_m, dtype=np.float64), spacing_m
