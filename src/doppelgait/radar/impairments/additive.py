"""Impairments that add to samples: receiver noise, lines, interference, the direct path and the room."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field, field_validator, model_validator

from doppelgait.core.config import FrozenModel
from doppelgait.core.plugins import plugin
from doppelgait.core.rng import draw_key
from doppelgait.core.samples import Samples
from doppelgait.core.units import db_to_amplitude, dbm_to_watt, watt_to_volt
from doppelgait.radar.impairments.apply import (
    Level,
    check_rising,
    check_width,
    convert_level_to_volt,
    exclude,
    find_volts_per_unit,
    make_static_samples,
    sample_range_m,
)
from doppelgait.radar.link import echo_amplitude_v, make_noise_taps, sample_noise_v2
from doppelgait.radar.parameters import Radar

Change = tuple[Annotated[float, Field(ge=0, le=1e6)], Annotated[float, Field(ge=-200, le=200)]]


class ThermalNoise(FrozenModel):
    """Complex Gaussian noise of the receiver (E-18).

    By default it has the noise level of the radar; the correlation over range is the radar's ``noise_correlation``.

    noise_figure_db: Noise figure F, instead of that of the radar.
    level_db: Root mean square of the complex noise in a range bin, dB re 1 V, instead of F.
    in_units: ``level_db`` is re one unit of the sensor's own files (``radar.volts_per_unit``).
    """

    kind: Literal["thermal_noise"] = "thermal_noise"
    noise_figure_db: float | None = Field(default=None, ge=0, le=100)
    level_db: float | None = Field(default=None, ge=-400, le=100)
    in_units: bool = False

    _check_level = model_validator(mode="after")(exclude("level_db", "noise_figure_db"))


def noise_power_per_sample_v2(spec: ThermalNoise, radar: Radar) -> float:
    """Return the mean square noise of a sample, V^2, by E-18 or from ``level_db`` in a bin."""
    if spec.level_db is not None:
        return convert_level_to_volt(spec, radar) ** 2 / radar.waveform.noise_gain(radar)
    if spec.noise_figure_db is not None:
        radar = radar.model_copy(update={"noise_figure_db": spec.noise_figure_db})
    return sample_noise_v2(radar)


@plugin("impairment", parameters=ThermalNoise)
def add_thermal_noise(samples: Samples, parameters: ThermalNoise, radar: Radar, rng: np.random.Generator) -> Samples:
    """Add receiver noise, whose value in a sample is a function of (key, pulse, sample) only."""
    power_v2 = noise_power_per_sample_v2(parameters, radar)
    return samples.with_noise(draw_key(rng), power_v2, make_noise_taps(radar)).add_pending_noise()


class Interference(FrozenModel):
    """Bursts of another transmitter with its own clock.

    Bursts start at random times (Poisson). In every pulse that overlaps a burst, one run of neighbouring samples at a
    random position is hit: range bins of a pulse radar, or ADC samples of a sweep, where two chirps cross. Complex
    white Gaussian noise is added to these samples. Other pulses do not change.

    rate_hz: Mean number of bursts per second.
    duration_s: Duration of a burst; a burst shorter than a pulse interval hits one or two pulses.
    level_db: Root mean square in a sample hit, dB re 1 V, after the averaging of a frame.
    in_units: ``level_db`` is re one unit of the sensor's own files (``radar.volts_per_unit``).
    hit_share: Share of a pulse's samples that are hit, 0 to 1, at least one sample.
    """

    kind: Literal["interference"] = "interference"
    rate_hz: float = Field(default=0.2, ge=0, le=1e5)
    duration_s: float = Field(default=0.01, gt=0, le=60)
    level_db: float = Field(default=-90.0, ge=-400, le=100)
    in_units: bool = False
    hit_share: float = Field(default=0.05, ge=0, le=1)


@plugin("impairment", parameters=Interference)
def add_interference(samples: Samples, parameters: Interference, radar: Radar, rng: np.random.Generator) -> Samples:
    """Add noise bursts to the pulses that interference hits."""
    level_v = convert_level_to_volt(parameters, radar)
    n_pulses, n_samples = samples.shape
    # pulses i that overlap a burst, from i/f_p to (i+1)/f_p; bursts may have begun before the recording
    duration_s, record_s = parameters.duration_s, n_pulses / radar.prf_hz
    n_bursts = rng.poisson(parameters.rate_hz * (record_s + duration_s))
    start_s = rng.uniform(-duration_s, record_s, size=n_bursts)
    begin = np.clip(np.floor(start_s * radar.prf_hz), 0, n_pulses - 1).astype(np.int64)
    last = np.clip(np.floor((start_s + duration_s) * radar.prf_hz), 0, n_pulses - 1).astype(np.int64)
    edges = np.bincount(begin, minlength=n_pulses + 1) - np.bincount(last + 1, minlength=n_pulses + 1)
    pulses = np.flatnonzero(np.cumsum(edges[:n_pulses]) > 0)
    width = max(1, round(parameters.hit_share * n_samples))
    first = rng.integers(0, n_samples - width + 1, size=pulses.size)
    columns = first[:, None] + np.arange(width)
    parts = rng.standard_normal((pulses.size, width, 2)) * (level_v / np.sqrt(2.0))
    return samples.add_at(pulses[:, None], columns, parts[..., 0] + 1j * parts[..., 1])


class ColouredNoise(FrozenModel):
    r"""Gaussian noise with a shape over Doppler and range, in addition to white noise.

    Its density at the frequency :math:`f` in the bin at :math:`R` is that of white noise with the root mean square
    :math:`L(|f|)\,G(R)` in a range bin: :math:`S(f, R) = L^2(|f|)\,G^2(R) / f_p`, the flicker noise of a homodyne
    receiver for example. It is independent from sample to sample along range.

    levels: Level L at rising frequencies, dB re 1 V; linear in dB between them, constant outside.
    range_db: Change G of the level at rising ranges, dB; 0 everywhere by default.
    in_units: Levels are re one unit of the sensor's own files (``radar.volts_per_unit``).
    """

    kind: Literal["coloured_noise"] = "coloured_noise"
    levels: tuple[Level, ...] = Field(default=((10.0, -100.0), (100.0, -110.0)), min_length=1, max_length=10_000)
    range_db: tuple[Change, ...] = Field(default=(), max_length=10_000)
    in_units: bool = False

    _check_rising = field_validator("levels", "range_db")(check_rising)


@plugin("impairment", parameters=ColouredNoise)
def add_coloured_noise(samples: Samples, parameters: ColouredNoise, radar: Radar, rng: np.random.Generator) -> Samples:
    """Add noise of a set density over Doppler."""
    from scipy import fft

    n_pulses, n_samples = samples.shape
    unit_v = find_volts_per_unit(radar, wanted_by="coloured_noise: levels") if parameters.in_units else 1.0
    gain_v = np.full(n_samples, unit_v / math.sqrt(radar.waveform.noise_gain(radar)))
    if parameters.range_db:
        check_width(samples, radar)
        knots_m, changes_db = np.array(parameters.range_db).T
        gain_v = gain_v * db_to_amplitude(np.interp(sample_range_m(radar), knots_m, changes_db))
    length = fft.next_fast_len(2 * n_pulses)  # its Fourier series is periodic: half of a period is used
    f_hz = np.abs(fft.fftfreq(length, 1.0 / radar.prf_hz))
    knots_hz, levels_db = np.array(parameters.levels).T
    shape = db_to_amplitude(np.interp(f_hz, knots_hz, levels_db)) * math.sqrt(length / 2.0)
    noise: npt.NDArray[np.complex64] = np.empty((n_pulses, n_samples), dtype=np.complex64)
    for column in range(n_samples):
        parts = rng.standard_normal((2, length))
        noise[:, column] = fft.ifft((parts[0] + 1j * parts[1]) * shape)[:n_pulses] * gain_v[column]
    samples += noise
    return samples


class Spur(FrozenModel):
    """Line in Doppler, for example mains hum.

    It has the same amplitude and phase in all samples of a pulse; the phase at the start is random.

    frequency_hz: Doppler frequency of the line. Beyond half the frame rate it aliases; negative is
        receding.
    level_db: Amplitude of the line, dB re 1 V.
    in_units: ``level_db`` is re one unit of the sensor's own files (``radar.volts_per_unit``).
    """

    kind: Literal["spur"] = "spur"
    frequency_hz: float = Field(default=50.0, ge=-1e6, le=1e6)
    level_db: float = Field(default=-100.0, ge=-400, le=100)
    in_units: bool = False


@plugin("impairment", parameters=Spur)
def add_spur(samples: Samples, parameters: Spur, radar: Radar, rng: np.random.Generator) -> Samples:
    """Add the line to every sample of a pulse."""
    level_v = convert_level_to_volt(parameters, radar)
    turns = parameters.frequency_hz / radar.prf_hz * np.arange(samples.shape[0]) + rng.random()
    samples += (level_v * np.exp(2j * np.pi * turns)).astype(np.complex64)[:, None]
    return samples


CELLS_BEYOND = 3
"""Resolution cells before and behind the frame with clutter, which extends into it."""
SCATTERERS_PER_CELL = 4
"""Scatterers per half-power width; their sum is then a smooth Gaussian process."""
MAX_SCATTERERS = 200_000


class Leakage(FrozenModel):
    """Direct path from transmitter to receiver: one static echo with the width of the waveform.

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

    _check_level = model_validator(mode="after")(exclude("level_db", "isolation_db"))


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
    r"""Static scatterers of the room at all ranges, sampled once per recording.

    Every resolution cell has several scatterers with random
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

    _check_choice = model_validator(mode="after")(exclude("levels", "rcs_per_metre_m2", needed=True))


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
