"""Receiver noise, white and coloured, lines in Doppler, and bursts of another transmitter."""

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
from doppelgait.core.units import db_to_amplitude
from doppelgait.radar.impairments.apply import (
    Level,
    check_rising,
    check_width,
    convert_level_to_volt,
    find_volts_per_unit,
    sample_range_m,
)
from doppelgait.radar.link import make_noise_taps, sample_noise_v2
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

    @model_validator(mode="after")
    def _check_level(self) -> ThermalNoise:
        if self.noise_figure_db is not None and self.level_db is not None:
            raise ValueError("give noise_figure_db or level_db, not both")
        if self.in_units and self.level_db is None:
            raise ValueError("in_units belongs to level_db, which is not set")
        return self


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
    r"""Gaussian noise with a shape over Doppler and range.

    It is added to the receiver's white noise.

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
