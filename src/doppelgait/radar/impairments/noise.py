"""Receiver noise, and bursts of another transmitter."""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator

from doppelgait.core.config import FrozenModel
from doppelgait.core.plugins import plugin
from doppelgait.core.samples import Samples
from doppelgait.radar.impairments.apply import convert_level_to_volt
from doppelgait.radar.link import make_noise_taps, sample_noise_v2
from doppelgait.radar.parameters import Radar


class ThermalNoise(FrozenModel):
    """Complex Gaussian noise of the receiver (E-18).

    By default it has the noise level of the radar; the correlation over range is the radar's ``noise_correlation``.

    Parameters
    ----------
    noise_figure_db : float, optional
        Noise figure F, instead of that of the radar.
    level_db : float, optional
        Root mean square of the complex noise in a range bin, dB re 1 V, instead of F.
    in_units : bool
        ``level_db`` is re one unit of the sensor's own files (``radar.volts_per_unit``).
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
    """Return the mean square of the noise in a receiver sample, V^2.

    It follows from E-18, or from ``level_db`` in a range bin divided by the noise gain of compression.
    """
    if spec.level_db is not None:
        level_v = convert_level_to_volt(
            spec.level_db, radar, in_units=spec.in_units, wanted_by="thermal_noise: level_db"
        )
        return level_v**2 / radar.waveform.noise_gain(radar)
    if spec.noise_figure_db is not None:
        radar = radar.model_copy(update={"noise_figure_db": spec.noise_figure_db})
    return sample_noise_v2(radar)


@plugin("impairment", parameters=ThermalNoise)
def add_thermal_noise(samples: Samples, parameters: ThermalNoise, radar: Radar, rng: np.random.Generator) -> Samples:
    """Add receiver noise to samples.
    The noise value of a sample is a function of (key, pulse, sample) only.
    """
    from doppelgait.core.kernels.noise import draw_key

    power_v2 = noise_power_per_sample_v2(parameters, radar)
    return samples.with_noise(draw_key(rng), power_v2, make_noise_taps(radar)).add_pending_noise()


Pulses = npt.NDArray[np.int64]


class Interference(FrozenModel):
    """Bursts of another transmitter with its own clock.

    Bursts start at random times (Poisson). In every pulse that overlaps a burst, one run of neighbouring samples at a
    random position is hit: range bins of a pulse radar, or ADC samples of a sweep, where two chirps cross. Complex
    white Gaussian noise is added to these samples. Other pulses do not change.

    Parameters
    ----------
    rate_hz : float
        Mean number of bursts per second.
    duration_s : float
        Duration of a burst; a burst shorter than a pulse interval hits one or two pulses.
    level_db : float
        Root mean square in a sample hit, dB re 1 V, after the averaging of a frame.
    in_units : bool
        ``level_db`` is re one unit of the sensor's own files (``radar.volts_per_unit``).
    hit_share : float
        Share of a pulse's samples that are hit, 0 to 1, at least one sample.
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
    where = "interference: level_db"
    level_v = convert_level_to_volt(parameters.level_db, radar, in_units=parameters.in_units, wanted_by=where)
    n_pulses, n_samples = samples.shape
    pulses = find_hit_pulses(n_pulses, parameters, radar=radar, rng=rng)
    width = max(1, round(parameters.hit_share * n_samples))
    first = rng.integers(0, n_samples - width + 1, size=pulses.size)
    columns = first[:, None] + np.arange(width)
    parts = rng.standard_normal((pulses.size, width, 2)) * (level_v / np.sqrt(2.0))
    return samples.add_at(pulses[:, None], columns, parts[..., 0] + 1j * parts[..., 1])


def find_hit_pulses(n_pulses: int, spec: Interference, *, radar: Radar, rng: np.random.Generator) -> Pulses:
    """Return the numbers of the pulses that bursts hit.
    The numbers rise; pulse i is hit if the interval from i/f_p to (i+1)/f_p overlaps a burst.
    """
    record_s = n_pulses / radar.prf_hz
    n_bursts = rng.poisson(spec.rate_hz * (record_s + spec.duration_s))  # includes earlier bursts
    start_s = rng.uniform(-spec.duration_s, record_s, size=n_bursts)
    first = np.clip(np.floor(start_s * radar.prf_hz), 0, n_pulses - 1).astype(np.int64)
    last = np.clip(np.floor((start_s + spec.duration_s) * radar.prf_hz), 0, n_pulses - 1).astype(np.int64)
    edges = np.bincount(first, minlength=n_pulses + 1) - np.bincount(last + 1, minlength=n_pulses + 1)
    return np.asarray(np.flatnonzero(np.cumsum(edges[:n_pulses]) > 0), dtype=np.int64)
