"""The radar: every parameter, checked, and what follows from them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from importlib import resources
from typing import Any, Literal, Self

import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator

from doppelgait.core.config import FrozenModel, read_toml, validate
from doppelgait.core.errors import ConfigError
from doppelgait.core.units import (
    SPEED_OF_LIGHT_MPS,
    carrier_to_wavelength_m,
    unambiguous_velocity_mps,
)

GAUSSIAN_WIDTH = {3: math.sqrt(math.log(2)) / math.pi, 10: math.sqrt(math.log(10)) / math.pi}
"""Two-sided bandwidth times sigma of a Gaussian pulse, by the level in dB below the peak (E-11)."""

PULSE_SIGMA_S = (1e-11, 1e-6)
"""Shortest and longest pulse (standard deviation of its envelope)."""
MAX_RANGE_BINS = 100_000


class Radar(FrozenModel):
    """A monostatic pulse-Doppler radar (the report's Table 5.1 and what it leaves out).

    Parameters
    ----------
    name : str
        For people; no effect.
    carrier_hz : float
        Carrier frequency f_c.
    prf_hz : float
        Frame rate f_p: slow-time samples per second. On swept-threshold chips one frame holds many pulses.
    sample_rate_hz : float
        Fast-time sampling rate f_s of the receiver.
    decimation : int
        Baseband samples kept: every D-th.
    range_start_m, range_stop_m : float
        Frame limits r_min, r_max.
    bandwidth_hz, bandwidth_level_db : float, {3, 10}
        Two-sided bandwidth B of the Gaussian pulse and the level below the peak at which it is meant ...
    pulse_sigma_s : float
        ... or instead the standard deviation tau of its amplitude envelope. Give exactly one of the two.
    tx_power_dbm : float
        Peak power P_t of the transmitted envelope.
    tx_gain_dbi, rx_gain_dbi : float
        Antenna gains G_t, G_r.
    receiver_gain_db : float
        G_rx; multiplies signal and noise alike.
    noise_figure_db : float
        Noise figure F of the receiver.
    noise_bandwidth_hz : float, optional
        Bandwidth B_n of the down-conversion filter; the pulse's 10 dB bandwidth by default.
    pulse_rate_hz, sweep_levels : float, int
        Pulses per second and levels of the threshold sweep; a frame averages pulse_rate / (prf * sweep_levels) pulses.
    transmit_phase_rad : float
        Phase theta of the transmitted pulse.
    hypothetical : bool
        True for settings that no real device has.
    """

    name: str = "custom"
    carrier_hz: float = Field(gt=1e6, lt=1e12)
    prf_hz: float = Field(gt=0, le=1e6)
    sample_rate_hz: float = Field(gt=0, lt=1e13)
    decimation: int = Field(default=1, ge=1, le=1024)
    range_start_m: float = Field(default=0.0, ge=0)
    range_stop_m: float = Field(gt=0, le=1e6)
    bandwidth_hz: float | None = Field(default=None, gt=0)
    bandwidth_level_db: Literal[3, 10] = 10
    pulse_sigma_s: float | None = Field(default=None, gt=0)
    tx_power_dbm: float = Field(default=0.0, ge=-200, le=200)
    tx_gain_dbi: float = Field(default=0.0, ge=-100, le=100)
    rx_gain_dbi: float = Field(default=0.0, ge=-100, le=100)
    receiver_gain_db: float = Field(default=0.0, ge=-100, le=100)
    noise_figure_db: float = Field(default=6.0, ge=0, le=100)
    noise_bandwidth_hz: float | None = Field(default=None, gt=0, le=1e13)
    pulse_rate_hz: float | None = Field(default=None, gt=0)
    sweep_levels: int = Field(default=1, ge=1)
    transmit_phase_rad: float = 0.0
    hypothetical: bool = False

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.bandwidth_hz is None) == (self.pulse_sigma_s is None):
            raise ValueError("give exactly one of bandwidth_hz and pulse_sigma_s")
        self._check_pulse()
        if self.range_stop_m <= self.range_start_m:
            raise ValueError(f"range_stop_m {self.range_stop_m} must be larger than range_start_m {self.range_start_m}")
        if not 1 <= self.n_range_bins <= MAX_RANGE_BINS:
            raise ValueError(
                f"range_start_m {self.range_start_m} to range_stop_m {self.range_stop_m} makes {self.n_range_bins:,} "
                f"range bins of {self.bin_spacing_m:.3g} m; 1 to {MAX_RANGE_BINS:,} are allowed: change the frame, "
                "sample_rate_hz or decimation"
            )
        if self.averages_per_frame < 1:
            raise ValueError(
                f"prf_hz {self.prf_hz} leaves no whole pulse to average: at most {self.pulse_rate_hz}"
                f" / {self.sweep_levels} levels"
            )
        return self

    def _check_pulse(self) -> None:
        shortest_s, longest_s = PULSE_SIGMA_S
        if not shortest_s <= self.sigma_s <= longest_s:
            given = "bandwidth_hz" if self.pulse_sigma_s is None else "pulse_sigma_s"
            raise ValueError(
                f"{given} {getattr(self, given)} makes a pulse of sigma {self.sigma_s:.3g} s; allowed are "
                f"{shortest_s:g} to {longest_s:g} s"
            )
        half_band_hz = self.pulse_bandwidth_hz(10) / 2.0
        if self.carrier_hz < half_band_hz:
            raise ValueError(
                f"carrier_hz {self.carrier_hz:g} is below half the pulse's 10 dB bandwidth, {half_band_hz:.4g} Hz: the "
                "pulse would reach below 0 Hz; raise carrier_hz or take a longer pulse"
            )

    @classmethod
    def preset(cls, preset_name: str, /, **changes: Any) -> Radar:
        """Radar by the name of a preset (``doppelgait radar list``), with single parameters changed.

        Raises
        ------
        ConfigError
            If the preset is unknown or a changed parameter is not allowed.
        """
        return validate(cls, changed_preset(preset_name, changes), where=f"radar (preset {preset_name})")

    @property
    def wavelength_m(self) -> float:
        """Wavelength lambda."""
        return carrier_to_wavelength_m(self.carrier_hz)

    @property
    def sigma_s(self) -> float:
        """Standard deviation tau of the pulse's amplitude envelope (E-11)."""
        if self.pulse_sigma_s is not None:
            return self.pulse_sigma_s
        return GAUSSIAN_WIDTH[self.bandwidth_level_db] / float(self.bandwidth_hz or math.nan)

    def pulse_bandwidth_hz(self, level_db: Literal[3, 10]) -> float:
        """Two-sided bandwidth of the pulse at 3 or 10 dB below its peak (E-11)."""
        return GAUSSIAN_WIDTH[level_db] / self.sigma_s

    @property
    def range_resolution_m(self) -> float:
        """Half-power width in range of one echo: c sqrt(ln 2) tau (E-11)."""
        return SPEED_OF_LIGHT_MPS * math.sqrt(math.log(2)) * self.sigma_s

    @property
    def bin_spacing_m(self) -> float:
        """Spacing of the range bins: D c / (2 f_s) (E-15)."""
        return self.decimation * SPEED_OF_LIGHT_MPS / (2.0 * self.sample_rate_hz)

    @property
    def n_range_bins(self) -> int:
        """Number of range bins N = ceil(r_span / bin spacing) (E-15)."""
        return math.ceil((self.range_stop_m - self.range_start_m) / self.bin_spacing_m - 1e-9)

    def range_axis_m(self) -> npt.NDArray[np.float64]:
        """Range of every bin: r_min + n bin spacing, n = 0..N-1 (E-15)."""
        return np.asarray(self.range_start_m + self.bin_spacing_m * np.arange(self.n_range_bins), dtype=np.float64)

    @property
    def unambiguous_velocity_mps(self) -> float:
        """Largest radial speed without aliasing: lambda f_p / 4 (E-06)."""
        return unambiguous_velocity_mps(self.prf_hz, self.wavelength_m)

    @property
    def averages_per_frame(self) -> int:
        """Pulses averaged into one frame, N_eff: floor(pulse rate / (f_p levels)); 1 without a pulse rate (E-18)."""
        if self.pulse_rate_hz is None:
            return 1
        return math.floor(self.pulse_rate_hz / (self.prf_hz * self.sweep_levels))

    @property
    def receiver_bandwidth_hz(self) -> float:
        """Noise bandwidth B_n: as given, else the pulse's 10 dB bandwidth."""
        return self.noise_bandwidth_hz if self.noise_bandwidth_hz is not None else self.pulse_bandwidth_hz(10)

    def derived(self) -> dict[str, float]:
        """Derived quantities by name, for ``doppelgait radar show``."""
        from doppelgait.radar.link import noise_power_v2, received_power_w

        return {
            "wavelength_m": self.wavelength_m,
            "pulse_sigma_s": self.sigma_s,
            "pulse_bandwidth_3db_hz": self.pulse_bandwidth_hz(3),
            "pulse_bandwidth_10db_hz": self.pulse_bandwidth_hz(10),
            "range_resolution_m": self.range_resolution_m,
            "bin_spacing_m": self.bin_spacing_m,
            "n_range_bins": self.n_range_bins,
            "range_stop_m": self.range_stop_m,
            "unambiguous_velocity_mps": self.unambiguous_velocity_mps,
            "averages_per_frame": self.averages_per_frame,
            "noise_power_v2": noise_power_v2(self),
            "received_power_1m2_5m_dbm": float(10 * np.log10(1e3 * received_power_w(self, range_m=5.0, rcs_m2=1.0))),
        }


def preset_names() -> list[str]:
    """Names of all presets."""
    folder = resources.files("doppelgait.radar.presets")
    return sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml"))


def changed_preset(name: str, changes: Mapping[str, Any]) -> dict[str, Any]:
    """Parameters of a preset with some changed; a changed pulse form replaces the preset's."""
    table = {**preset_table(name), **changes}
    for given, other in (("pulse_sigma_s", "bandwidth_hz"), ("bandwidth_hz", "pulse_sigma_s")):
        if given in changes and other not in changes:
            table.pop(other, None)
    return table


def preset_table(name: str) -> dict[str, Any]:
    """Parameters of a preset as written in its file; an unknown name is a :class:`ConfigError`."""
    if name not in preset_names():
        raise ConfigError(f"unknown radar preset {name!r}; known are: {', '.join(preset_names())}")
    with resources.as_file(resources.files("doppelgait.radar.presets") / f"{name}.toml") as path:
        return read_toml(path)[0]
