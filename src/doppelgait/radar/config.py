"""The radar: every parameter, checked, and what follows from them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from copy import deepcopy
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np
import numpy.typing as npt
from pydantic import Field, field_validator, model_validator

from doppelgait.core.config import FrozenModel, read_toml, validate
from doppelgait.core.errors import ConfigError
from doppelgait.core.units import carrier_to_wavelength_m, unambiguous_velocity_mps
from doppelgait.radar.antenna import Antenna

if TYPE_CHECKING:
    from doppelgait.radar.waveforms import Waveform

GAUSSIAN_WIDTH = {3: math.sqrt(math.log(2)) / math.pi, 10: math.sqrt(math.log(10)) / math.pi}
"""Two-sided bandwidth times sigma of a Gaussian pulse, by the level in dB below the peak (E-11)."""

PULSE_SIGMA_S = (1e-11, 1e-6)
"""Shortest and longest Gaussian pulse (standard deviation of its envelope)."""
MAX_RANGE_BINS = 100_000
BESIDE = ("environment", "impairments")
"""Keys of a preset's file beside the radar's parameters."""


class Radar(FrozenModel):
    """A coherent radar (the report's Table 5.1 and what it leaves out).

    Parameters
    ----------
    name : str
        For people; no effect.
    waveform : str
        ``impulse`` (Gaussian pulse), ``rectangular``, ``lfm`` (chirped pulse behind a matched filter), ``fmcw``
        (de-chirped), ``stepped`` (stepped frequency) or ``cw``; what each needs is in
        :mod:`doppelgait.radar.waveforms`.
    carrier_hz : float
        Centre frequency f_c of what is transmitted.
    prf_hz : float
        Frame rate f_p: slow-time samples per second. On swept-threshold chips one frame holds many pulses.
    sample_rate_hz : float
        Sampling rate f_s of the receiver: along fast time, along the sweep (fmcw) or steps per second (stepped). A
        cw radar averages its samples over the frame; there it has no effect and is prf_hz when left out.
    decimation : int
        Baseband samples kept: every D-th (impulse, rectangular, lfm).
    range_start_m, range_stop_m : float
        Frame limits r_min, r_max.
    bandwidth_hz, bandwidth_level_db : float, {3, 10}
        Two-sided bandwidth B: of the Gaussian pulse, with the level below the peak at which it is meant; of lfm, fmcw
        and stepped the band swept in sweep_s.
    pulse_sigma_s : float
        impulse: instead of the bandwidth the standard deviation tau of the pulse's amplitude envelope.
    sweep_s : float
        Duration: of the pulse (rectangular, lfm), of the part of a chirp that is sampled (fmcw), of all steps
        (stepped). fmcw and stepped have round(sweep_s * sample_rate_hz) samples or steps a frame.
    range_window : {"none", "hann", "hamming", "blackman"}
        Window before the transform to range (fmcw, stepped).
    volts_per_unit : float, optional
        Volts at the receiver output per unit of the numbers in the sensor's own files.
    tx_power_dbm : float
        Peak power P_t of the transmitted envelope.
    tx_gain_dbi, rx_gain_dbi : float
        Peak gains G_t, G_r of the antennas.
    antenna : Antenna
        Their pattern relative to the peak (:mod:`doppelgait.radar.antenna`); the same in all directions by default.
    receiver_gain_db : float
        G_rx; multiplies signal and noise alike.
    noise_figure_db : float
        Noise figure F of the receiver.
    noise_bandwidth_hz : float, optional
        Noise bandwidth B_n of a receiver sample; by default the pulse's 10 dB bandwidth (impulse), 1 / sweep_s
        (rectangular, lfm), sample_rate_hz (fmcw, stepped) or prf_hz (cw).
    pulse_rate_hz, sweep_levels : float, int
        Pulses (sweeps) per second and levels of the threshold sweep; a frame averages pulse_rate / (prf * sweep_levels)
        of them.
    transmit_phase_rad : float
        Phase theta of the transmitted pulse.
    hypothetical : bool
        True for settings that no real device has.
    """

    name: str = "custom"
    waveform: str = "impulse"
    carrier_hz: float = Field(gt=1e6, lt=1e12)
    prf_hz: float = Field(ge=1e-3, le=1e6)
    sample_rate_hz: float = Field(gt=0, lt=1e13)
    decimation: int = Field(default=1, ge=1, le=1024)
    range_start_m: float = Field(default=0.0, ge=0)
    range_stop_m: float = Field(gt=0, le=1e6)
    bandwidth_hz: float | None = Field(default=None, gt=0)
    bandwidth_level_db: Literal[3, 10] = 10
    pulse_sigma_s: float | None = Field(default=None, gt=0)
    sweep_s: float | None = Field(default=None, gt=0, le=10)
    range_window: Literal["none", "hann", "hamming", "blackman"] = "hann"
    volts_per_unit: float | None = Field(default=None, gt=0)
    tx_power_dbm: float = Field(default=0.0, ge=-200, le=200)
    tx_gain_dbi: float = Field(default=0.0, ge=-100, le=100)
    rx_gain_dbi: float = Field(default=0.0, ge=-100, le=100)
    antenna: Antenna = Antenna()
    receiver_gain_db: float = Field(default=0.0, ge=-100, le=100)
    noise_figure_db: float = Field(default=6.0, ge=0, le=100)
    noise_bandwidth_hz: float | None = Field(default=None, gt=0, le=1e13)
    pulse_rate_hz: float | None = Field(default=None, gt=0)
    sweep_levels: int = Field(default=1, ge=1)
    transmit_phase_rad: float = 0.0
    hypothetical: bool = False

    @model_validator(mode="before")
    @classmethod
    def _fill(cls, data: Any) -> Any:
        if (
            isinstance(data, dict)
            and data.get("waveform") == "cw"
            and "sample_rate_hz" not in data
            and "prf_hz" in data
        ):
            return {**data, "sample_rate_hz": data["prf_hz"]}
        return data

    @field_validator("waveform")
    @classmethod
    def _check_waveform(cls, name: str) -> str:
        from doppelgait.radar.waveforms import WAVEFORMS

        if name not in WAVEFORMS:
            raise ValueError(f"known are {', '.join(WAVEFORMS)}")
        return name

    @model_validator(mode="after")
    def _check(self) -> Self:
        from doppelgait.radar.waveforms import check_given

        check_given(self, self._form)
        self._form.check(self)
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

    @property
    def _form(self) -> Waveform:
        from doppelgait.radar.waveforms import waveform_of

        return waveform_of(self)

    @classmethod
    def preset(cls, preset_name: str | Path, /, **changes: Any) -> Radar:
        """Radar by the name of a preset or the path of such a file, with single parameters changed.

        Parameters
        ----------
        preset_name : str or Path
            A name of ``doppelgait radar list``, or a path that ends in ``.toml``. What such a file says about
            ``environment`` and ``impairments`` is no parameter of the radar; :func:`preset_table` returns it.
        **changes
            Parameters that replace the preset's.

        Raises
        ------
        ConfigError
            If the preset is unknown, its file cannot be read or a parameter is not allowed.
        """
        return validate(cls, changed_preset(preset_name, changes), where=f"radar (preset {preset_name})")

    @property
    def wavelength_m(self) -> float:
        """Wavelength lambda."""
        return carrier_to_wavelength_m(self.carrier_hz)

    @property
    def sigma_s(self) -> float:
        """Standard deviation tau of an impulse radar's amplitude envelope (E-11)."""
        if self.waveform != "impulse":
            raise ConfigError(f"a radar of waveform {self.waveform!r} has no Gaussian pulse, hence no sigma")
        if self.pulse_sigma_s is not None:
            return self.pulse_sigma_s
        return GAUSSIAN_WIDTH[self.bandwidth_level_db] / float(self.bandwidth_hz or math.nan)

    def pulse_bandwidth_hz(self, level_db: Literal[3, 10]) -> float:
        """Two-sided bandwidth of an impulse radar's pulse at 3 or 10 dB below its peak (E-11)."""
        return GAUSSIAN_WIDTH[level_db] / self.sigma_s

    @property
    def range_resolution_m(self) -> float:
        """Half-power width in range of one echo; of a cw radar the frame's span."""
        return self._form.resolution_m(self)

    @property
    def bin_spacing_m(self) -> float:
        """Spacing of the range bins: D c / (2 f_s) (E-15), or c / (2 B) where they come out of a transform."""
        return self._form.bin_spacing_m(self)

    @property
    def n_range_bins(self) -> int:
        """Number of range bins N of a frame (E-15)."""
        return self._form.n_range_bins(self)

    def range_axis_m(self) -> npt.NDArray[np.float64]:
        """Range of every bin, ascending (E-15); of a cw radar the middle of the frame."""
        return self._form.range_axis_m(self)

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
        """Noise bandwidth B_n of a receiver sample: as given, else the waveform's own."""
        return self.noise_bandwidth_hz if self.noise_bandwidth_hz is not None else self._form.noise_bandwidth_hz(self)

    def derived(self) -> dict[str, float]:
        """Derived quantities by name, for ``doppelgait radar show``; without those that the waveform does not have."""
        from doppelgait.radar.derived import derived_quantities

        return derived_quantities(self)


def preset_names() -> list[str]:
    """Names of all presets."""
    return list(_built_in_names())


@lru_cache(maxsize=1)
def _built_in_names() -> tuple[str, ...]:
    folder = resources.files("doppelgait.radar.presets")
    return tuple(sorted(e.name.removesuffix(".toml") for e in folder.iterdir() if e.name.endswith(".toml")))


def changed_preset(name: str | Path, changes: Mapping[str, Any]) -> dict[str, Any]:
    """Parameters of a preset with some changed; a changed pulse form replaces the preset's."""
    table = {key: value for key, value in preset_table(name).items() if key not in BESIDE}
    table.update(changes)
    if table.get("waveform", "impulse") == "impulse":
        for given, other in (("pulse_sigma_s", "bandwidth_hz"), ("bandwidth_hz", "pulse_sigma_s")):
            if given in changes and other not in changes:
                table.pop(other, None)
    return table


def preset_table(name: str | Path) -> dict[str, Any]:
    """Everything that a preset's file says, lists of environment and impairments among it.

    Parameters
    ----------
    name : str or Path
        A name of :func:`preset_names`, or a path that ends in ``.toml``.

    Raises
    ------
    ConfigError
        If the name is unknown, or the file is missing or no TOML.
    """
    if str(name).lower().endswith(".toml"):
        return read_toml(name)[0]
    if str(name) not in preset_names():
        raise ConfigError(
            f"unknown radar preset {str(name)!r}; known are: {', '.join(preset_names())}; or give the path of a file "
            "that ends in .toml"
        )
    return deepcopy(_built_in(str(name)))


@lru_cache(maxsize=64)
def _built_in(name: str) -> dict[str, Any]:
    """Table of a preset that comes with the package, parsed once: planning asks for it for every example."""
    with resources.as_file(resources.files("doppelgait.radar.presets") / f"{name}.toml") as path:
        return read_toml(path)[0]
