"""Noise that is not white, and lines in Doppler."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Annotated, Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field, field_validator

from doppelgait.core.config import FrozenModel
from doppelgait.core.plugins import plugin
from doppelgait.core.samples import Samples
from doppelgait.core.units import db_to_amplitude
from doppelgait.radar.impairments.apply import check_width, convert_level_to_volt, sample_range_m
from doppelgait.radar.parameters import Radar

Level = tuple[Annotated[float, Field(ge=0, le=1e6)], Annotated[float, Field(ge=-400, le=100)]]
Change = tuple[Annotated[float, Field(ge=0, le=1e6)], Annotated[float, Field(ge=-200, le=200)]]


class ColouredNoise(FrozenModel):
    r"""Gaussian noise with a shape over Doppler and range.

    It is added to the receiver's white noise.

    Its density at the frequency :math:`f` in the bin at :math:`R` is that of white noise with the root mean square
    :math:`L(|f|)\,G(R)` in a range bin: :math:`S(f, R) = L^2(|f|)\,G^2(R) / f_p`, the flicker noise of a homodyne
    receiver for example. It is independent from sample to sample along range.

    Parameters
    ----------
    levels : list of (frequency_hz, level_db)
        Level L at rising frequencies, dB re 1 V; linear in dB between them, constant outside.
    range_db : list of (range_m, change_db)
        Change G of the level at rising ranges, dB; 0 everywhere by default.
    in_units : bool
        Levels are re one unit of the sensor's own files (``radar.volts_per_unit``).
    """

    kind: Literal["coloured_noise"] = "coloured_noise"
    levels: tuple[Level, ...] = Field(default=((10.0, -100.0), (100.0, -110.0)), min_length=1, max_length=10_000)
    range_db: tuple[Change, ...] = Field(default=(), max_length=10_000)
    in_units: bool = False

    @field_validator("levels", "range_db")
    @classmethod
    def _check_rising(cls, knots: tuple[Level, ...]) -> tuple[Level, ...]:
        for (one, _), (other, _) in pairwise(knots):
            if other <= one:
                raise ValueError(f"the first numbers must rise from entry to entry, but {other:g} follows {one:g}")
        return knots


@plugin("impairment", parameters=ColouredNoise)
def add_coloured_noise(samples: Samples, parameters: ColouredNoise, radar: Radar, rng: np.random.Generator) -> Samples:
    """Add noise of a set density over Doppler."""
    from scipy import fft

    n_pulses, n_samples = samples.shape
    unit_v = convert_level_to_volt(0.0, radar, in_units=parameters.in_units, wanted_by="coloured_noise: levels")
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

    Parameters
    ----------
    frequency_hz : float
        Doppler frequency of the line. Beyond half the frame rate it aliases; negative is receding.
    level_db : float
        Amplitude of the line, dB re 1 V.
    in_units : bool
        ``level_db`` is re one unit of the sensor's own files (``radar.volts_per_unit``).
    """

    kind: Literal["spur"] = "spur"
    frequency_hz: float = Field(default=50.0, ge=-1e6, le=1e6)
    level_db: float = Field(default=-100.0, ge=-400, le=100)
    in_units: bool = False


@plugin("impairment", parameters=Spur)
def add_spur(samples: Samples, parameters: Spur, radar: Radar, rng: np.random.Generator) -> Samples:
    """Add the line to every sample of a pulse."""
    level_v = convert_level_to_volt(
        parameters.level_db, radar, in_units=parameters.in_units, wanted_by="spur: level_db"
    )
    turns = parameters.frequency_hz / radar.prf_hz * np.arange(samples.shape[0]) + rng.random()
    samples += (level_v * np.exp(2j * np.pi * turns)).astype(np.complex64)[:, None]
    return samples
