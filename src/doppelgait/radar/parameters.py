"""Parameters of a radar, and the interface of its waveform, which depend on each other."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self, cast

import numpy as np
import numpy.typing as npt
from pydantic import (
    BeforeValidator,
    Field,
    PlainSerializer,
    SerializationInfo,
    SerializerFunctionWrapHandler,
    model_serializer,
    model_validator,
)

from doppelgait.core.config import FrozenModel, InnerError, validate
from doppelgait.core.errors import ConfigError
from doppelgait.core.labels import AnyTable
from doppelgait.core.notebook import show_html, show_text
from doppelgait.core.plugins import Group
from doppelgait.core.samples import Matrix, Samples
from doppelgait.core.units import (
    SPEED_OF_LIGHT_MPS,
    carrier_to_wavelength_m,
    duration_to_pulses,
    unambiguous_velocity_mps,
)
from doppelgait.radar.antenna import Antenna
from doppelgait.radar.presets import change_preset

GAUSSIAN_WIDTH = {3: math.sqrt(math.log(2)) / math.pi, 10: math.sqrt(math.log(10)) / math.pi}
"""Product of two-sided bandwidth and sigma of a Gaussian pulse, by the level in dB below the peak (E-11)."""

PULSE_SIGMA_S = (1e-11, 1e-6)
"""Limits of the standard deviation of a Gaussian pulse's envelope, s."""
MAX_RANGE_BINS = 100_000
MAX_CORRELATED_BINS = 16


class Waveform(FrozenModel):
    """Waveform of a radar: from scatterers to receiver samples, and from these to range bins.

    A waveform is a subclass with a default of ``kind``, fields for its own parameters, and at least the methods
    :meth:`synthesise` and :meth:`resolution_m`; ``plugin("waveform")`` registers it. The other methods have the
    defaults of a pulse whose receiver samples along fast time are the range bins (E-15). The
    argument ``radar`` of the methods is the radar with this ``waveform``.

    Attributes
    ----------
    needs, takes : tuple of str
        Required and allowed parameters of the radar among those that only some waveforms use.
    ranged : bool
        True if the range bins measure range; False for a radar with all ranges in one bin.
    """

    needs: ClassVar[tuple[str, ...]] = ()
    takes: ClassVar[tuple[str, ...]] = (
        "decimation",
        "noise_bandwidth_hz",
        "noise_correlation",
        "pulse_rate_hz",
        "integration_share",
        "fold_echoes",
    )
    ranged: ClassVar[bool] = True

    kind: str

    def fill(self, table: Mapping[str, Any]) -> Mapping[str, Any]:
        """Add the defaults of optional radar parameters."""
        return table

    def check(self, radar: Radar) -> None:
        """Check that the radar is valid for this waveform (``ValueError``)."""

    def synthesise(self, scatterers: AnyTable, radar: Radar) -> Matrix:
        """Return noise-free receiver samples, V, shape (I, S)."""
        raise NotImplementedError(f"waveform {self.kind!r} has no method synthesise")

    def synthesise_planes(self, scatterers: AnyTable, radar: Radar) -> Samples:
        """Return the samples of :meth:`synthesise` in the fastest layout, for :func:`simulate`."""
        return Samples.own(self.synthesise(scatterers, radar))

    def compress(self, samples: npt.NDArray[Any], radar: Radar) -> Matrix:
        """Compress receiver samples to range bins, V, shape (I, N).

        A point echo in the middle of a bin keeps its amplitude a and has the phase theta - 4 pi R / lambda.
        """
        return np.asarray(samples, dtype=np.complex64)

    def synthesise_bins(self, scatterers: AnyTable, radar: Radar) -> Matrix:
        """Return noise-free range bins, V, shape (I, N); a waveform may use a faster method."""
        return self.compress(self.synthesise(scatterers, radar), radar)

    def resolution_m(self, radar: Radar) -> float:
        """Return the half-power width in range of one echo."""
        raise NotImplementedError(f"waveform {self.kind!r} has no method resolution_m")

    def reach_m(self, radar: Radar) -> float:
        """Return the half length of an echo in range: 4 widths, a Gaussian's -190 dB."""
        return 4.0 * self.resolution_m(radar)

    def n_samples(self, radar: Radar) -> int:
        """Return the number of receiver samples S of one frame."""
        return self.n_range_bins(radar)

    def n_range_bins(self, radar: Radar) -> int:
        """Return the number of range bins of one frame, ceil(r_span / bin spacing) (E-15)."""
        return math.ceil((radar.range_stop_m - radar.range_start_m) / self.bin_spacing_m(radar) - 1e-9)

    def first_bin_m(self, radar: Radar) -> float:
        """Return the range of the first bin (E-15). It is the start of the frame."""
        return radar.range_start_m

    def bin_spacing_m(self, radar: Radar) -> float:
        """Return the spacing of the range bins (E-15). It is D c / (2 f_s)."""
        return radar.decimation * SPEED_OF_LIGHT_MPS / (2.0 * radar.sample_rate_hz)

    def noise_bandwidth_hz(self, radar: Radar) -> float:
        """Return the noise bandwidth of one receiver sample: the sampling rate for white noise."""
        return radar.sample_rate_hz

    def noise_gain(self, radar: Radar) -> float:
        """Return the noise power ratio of bin to sample, for white noise in the samples."""
        return 1.0

    def independent_bins(self, radar: Radar) -> float:
        """Return the independent noise values per range bin, 1 / (1 + 2 sum rho_l^2) (E-18c)."""
        return 1.0 / (1.0 + 2.0 * math.fsum(rho**2 for rho in radar.noise_correlation))

    def unambiguous_range_m(self, radar: Radar) -> float:
        """Return the range at which echoes fold back to 0: inf, or c / (2 pulse rate)."""
        return SPEED_OF_LIGHT_MPS / (2.0 * (radar.pulse_rate_hz or radar.prf_hz))

    def coupling_s(self, radar: Radar) -> float:
        """Return the range shift per radial velocity: -f_c T_c / B for a sweep, otherwise 0."""
        return 0.0

    def figures(self, radar: Radar) -> dict[str, float]:
        """Return further derived quantities by name."""
        return {}

    @property
    def samples_are_bins(self) -> bool:
        """True if the receiver samples are the range bins."""
        return type(self).compress is Waveform.compress

    def check_parameters(self, radar: Radar) -> None:
        """Check for missing or unused parameters of the waveform (``ValueError``)."""
        is_set = {name: getattr(radar, name) != type(radar).model_fields[name].default for name in OPTIONAL}
        missing = [name for name in self.needs if not is_set[name]]
        if missing:
            raise ValueError(f"waveform {self.kind!r} needs {' and '.join(missing)}")
        own = {*self.needs, *self.takes}
        idle = [name for name in OPTIONAL if name not in own and is_set[name]]
        if idle:
            raise ValueError(
                f"{' and '.join(idle)} {'is' if len(idle) == 1 else 'are'} not used by waveform {self.kind!r}; remove "
                f"unused parameters (it uses {', '.join(sorted(own)) or 'none of these'})"
            )


IMPULSE = ("bandwidth_hz", "bandwidth_level_db", "pulse_sigma_s", "sweep_levels", "threshold_step_v")
OPTIONAL = (*IMPULSE, *Waveform.takes, "sweep_s", "range_window")
"""Parameters of a radar that only some waveforms use; their defaults count as unset."""

WAVEFORMS: Group[type[Waveform]] = Group(
    "waveform", built_in=("doppelgait.radar.waveforms.pulses", "doppelgait.radar.waveforms.sweep")
)
"""Waveforms by name; each is a subclass of :class:`Waveform`."""


def _parse_waveform(value: Any) -> Any:
    """Return the waveform of a name or a table with ``kind``."""
    if isinstance(value, str) and value not in WAVEFORMS:
        raise ValueError(f"known are {', '.join(WAVEFORMS)}")
    try:
        return WAVEFORMS.parse(value)
    except ConfigError as error:
        raise InnerError(error) from None


def _serialise_waveform(waveform: Waveform, info: SerializationInfo) -> Any:
    """Return a waveform as its name, or as a table if it has parameters of its own."""
    if set(type(waveform).model_fields) == {"kind"}:
        return waveform.kind
    return waveform.model_dump(mode=info.mode, exclude_none=info.exclude_none)


class Radar(FrozenModel):
    """Coherent radar (the report's Table 5.1, and more).

    name: Name shown to the user; it has no effect.
    waveform: ``impulse`` (Gaussian pulse), ``rectangular``, ``lfm`` (chirped pulse with a matched
        filter), ``fmcw`` (de-chirped), ``stepped`` (stepped frequency), ``cw``, or that of another
        package; the name is short for ``{ kind = "NAME" }`` with the parameters of the waveform.
    carrier_hz: Centre frequency f_c of the transmitted signal.
    prf_hz: Frame rate f_p: slow-time samples per second. A frame may be a mean of many pulses.
    burst_pulses: Number of frames in a burst, at the rate prf_hz; None: frames without pauses.
        Impairments that vary over slow time do not change during the pauses.
    burst_period_s: Time from the start of one burst to the start of the next.
    sample_rate_hz: Sampling rate f_s of the receiver: along fast time, along the sweep (fmcw) or
        steps per second (stepped). For cw it has no effect and is prf_hz by default.
    decimation: Decimation factor D of the baseband samples (impulse, rectangular, lfm).
    range_start_m: Lower limit r_min of the frame.
    range_stop_m: Upper limit r_max of the frame.
    bandwidth_hz: Two-sided bandwidth B. Gaussian pulse: bandwidth at ``bandwidth_level_db`` below
        the peak. lfm, fmcw and stepped: bandwidth swept in sweep_s.
    bandwidth_level_db: Level below the peak at which the bandwidth of a Gaussian pulse is measured.
    pulse_sigma_s: impulse: standard deviation tau of the amplitude envelope; replaces bandwidth_hz.
    sweep_s: Duration of the pulse (rectangular, lfm), of the sampled part of a chirp (fmcw), or of
        all steps (stepped). A sweep has round(sweep_s * sample_rate_hz) samples or steps.
    range_window: Window before the transform to range (fmcw, stepped).
    volts_per_unit: Volts at the receiver output per unit of the numbers in the sensor's own files.
    tx_power_dbm: Peak power P_t of the transmitted envelope.
    tx_gain_dbi: Peak gain G_t of the transmit antenna.
    rx_gain_dbi: Peak gain G_r of the receive antenna.
    antenna: Pattern of the antennas relative to the peak, the same in all directions by default.
    receiver_gain_db: Receiver gain G_rx, which multiplies signal and noise.
    noise_figure_db: Noise figure F of the receiver.
    noise_bandwidth_hz: Noise bandwidth B_n of a receiver sample; by default the pulse's 10 dB
        bandwidth (impulse), 1 / sweep_s (rectangular, lfm), sample_rate_hz (fmcw, stepped) or
        prf_hz (cw).
    noise_correlation: Noise correlation rho_1, rho_2, ... (E-18c) at lags of 1, 2, ... bins, at most
        16, for waveforms with samples that are the range bins; 1 + 2 sum rho_l cos(l w) >= 0.
    pulse_rate_hz: Pulses (sweeps) per second; a frame averages pulse_rate / (prf * sweep_levels)
        pulses, times integration_share if that is not 0.
    sweep_levels: Number of levels of the threshold sweep; 1 without one.
    threshold_step_v: Spacing d of the thresholds of an impulse radar with a threshold sweep, at the
        receiver output; the receiver then has the noise of a counter (E-18b) and not of a mean.
    integration_share: Share of the frame time over which the samples of one frame are summed: the
        amplitude of a moving echo is multiplied by sinc(f_d T_i), T_i = integration_share / prf_hz
        (E-13b), and pulses outside this time are not averaged. 0 if it is negligible, and for fmcw
        and stepped, which model the motion within a frame.
    fold_echoes: For pulsed radars: echoes from beyond c / (2 pulse rate) appear in the frame of a
        later pulse (E-10b). False for a hypothetical radar. Sweeps always fold.
    transmit_phase_rad: Phase theta of the transmitted pulse.
    hypothetical: True for parameters of no real device.

    Examples
    --------
    >>> import doppelgait as dg
    >>> radar = dg.Radar.preset("x4", prf_hz=500.0)
    >>> round(radar.wavelength_m, 4)
    0.0411
    """

    name: str = "custom"
    waveform: Annotated[Waveform, BeforeValidator(_parse_waveform), PlainSerializer(_serialise_waveform)] = Field(
        default=cast(Waveform, "impulse"), validate_default=True
    )
    carrier_hz: float = Field(gt=1e6, lt=1e12)
    prf_hz: float = Field(ge=1e-3, le=1e6)
    burst_pulses: int | None = Field(default=None, ge=2, le=1_000_000)
    burst_period_s: float | None = Field(default=None, gt=0, le=3600)
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
    noise_correlation: tuple[Annotated[float, Field(ge=-1, le=1)], ...] = Field(
        default=(), max_length=MAX_CORRELATED_BINS
    )
    pulse_rate_hz: float | None = Field(default=None, gt=0)
    sweep_levels: int = Field(default=1, ge=1)
    threshold_step_v: float | None = Field(default=None, gt=0, le=1e3)
    integration_share: float = Field(default=0.0, ge=0, le=1)
    fold_echoes: bool = True
    transmit_phase_rad: float = 0.0
    hypothetical: bool = False

    if TYPE_CHECKING:  # else a type checker rejects short forms, such as a waveform's name

        def __init__(self, **parameters: Any) -> None: ...

    @model_validator(mode="before")
    @classmethod
    def _fill(cls, data: Any) -> Any:
        if not isinstance(data, Mapping) or "waveform" not in data:
            return data
        try:
            waveform = _parse_waveform(data["waveform"])
        except ValueError:  # the field's own check names the key
            return data
        return waveform.fill({**data, "waveform": waveform})

    @model_validator(mode="after")
    def _check(self) -> Self:
        self.waveform.check_parameters(self)
        self.waveform.check(self)
        if self.range_stop_m <= self.range_start_m:
            raise ValueError(f"range_stop_m {self.range_stop_m} must be larger than range_start_m {self.range_start_m}")
        if not 1 <= self.n_range_bins <= MAX_RANGE_BINS:
            raise ValueError(
                f"range_start_m {self.range_start_m} to range_stop_m {self.range_stop_m} makes {self.n_range_bins:,} "
                f"range bins of {self.bin_spacing_m:.3g} m; 1 to {MAX_RANGE_BINS:,} are allowed: change the frame, "
                "sample_rate_hz or decimation"
            )
        pulse_m = self.waveform.unambiguous_range_m(self)
        # 1 %: whole frames of the X4 last a pulse interval, and their files state ranges with c = 3e8 m/s
        if self.folds_pulses and self.range_stop_m - self.range_start_m > 1.01 * pulse_m:
            raise ValueError(
                f"range_start_m {self.range_start_m:g} to range_stop_m {self.range_stop_m:g} is longer than the "
                f"{pulse_m:.4g} m from one pulse to the next, so that echoes would appear in it more than once: "
                f"shorten the frame, lower {'prf_hz' if self.pulse_rate_hz is None else 'pulse_rate_hz'}, or set "
                "fold_echoes = false for a hypothetical radar (as in preset x4-long)"
            )
        if self.averages_per_frame < 1:
            raise ValueError(
                f"prf_hz {self.prf_hz} leaves no whole pulse to average: at most {self.pulse_rate_hz}"
                f" * {self.integration_share or 1.0:g} of the frame / {self.sweep_levels} levels"
            )
        if self.threshold_step_v is not None and self.sweep_levels == 1:
            raise ValueError(
                f"threshold_step_v {self.threshold_step_v:g} is the spacing of a threshold sweep, but sweep_levels is "
                "1: set the number of thresholds, or remove threshold_step_v for a receiver that averages"
            )
        least = _find_least_density(self.noise_correlation)
        if least < -1e-9:
            raise ValueError(
                f"noise_correlation {list(self.noise_correlation)} is impossible: its spectrum "
                f"1 + 2 sum rho_l cos(l w) has the minimum {least:.3g}, below 0; lower the values, or add further "
                "values (a truncated correlation can have a negative spectrum)"
            )
        if (self.burst_pulses is None) != (self.burst_period_s is None):
            raise ValueError("burst_pulses and burst_period_s belong together: set both, or neither without bursts")
        if self.burst_pulses and self.burst_period_s and self.burst_period_s * self.prf_hz < self.burst_pulses - 1e-6:
            raise ValueError(
                f"burst_period_s {self.burst_period_s:g} is shorter than a burst of {self.burst_pulses} frames at "
                f"prf_hz {self.prf_hz:g}, {self.burst_pulses / self.prf_hz:.4g} s"
            )
        return self

    @model_serializer(mode="wrap")
    def _dump(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Omit unset bursts, so that files without bursts do not change."""
        table: dict[str, Any] = handler(self)
        return {k: v for k, v in table.items() if v is not None or k not in ("burst_pulses", "burst_period_s")}

    @classmethod
    def preset(cls, preset_name: str | Path, /, **changes: Any) -> Radar:
        """Make a radar from a preset, with some parameters changed.

        Parameters
        ----------
        preset_name : str or Path
            A name of ``doppelgait radar list``, or a path that ends in ``.toml``. The keys ``environment`` and
            ``impairments`` of the file are not parameters of the radar; :func:`read_full_preset` returns them.
        **changes
            Parameters that replace the preset's.

        Raises
        ------
        ConfigError
            If the preset is unknown, its file cannot be read or a parameter is not allowed.
        """
        return validate(cls, change_preset(preset_name, changes), where=f"radar (preset {preset_name})")

    @classmethod
    def from_toml(cls, path: str | Path) -> Radar:
        """Read a radar from a TOML file, as :meth:`preset` does."""
        return cls.preset(Path(path))

    def __repr__(self) -> str:
        return show_text("Radar", self._shown())

    def _repr_html_(self) -> str:
        return show_html("Radar", self._shown(), "radar", self)

    def _shown(self) -> dict[str, str]:
        ranged = self.waveform.kind != "cw"
        return {
            "name": self.name,
            "waveform": self.waveform.kind,
            "carrier": f"{self.carrier_hz / 1e9:.6g} GHz",
            "frame rate": f"{self.prf_hz:g} Hz",
            "unambiguous velocity": f"{self.unambiguous_velocity_mps:.3g} m/s",
            "range": f"{self.range_start_m:g} to {self.range_stop_m:g} m" if ranged else "",
            "range resolution": f"{self.range_resolution_m:.3g} m" if ranged else "",
        }

    @property
    def wavelength_m(self) -> float:
        """Wavelength lambda."""
        return carrier_to_wavelength_m(self.carrier_hz)

    @property
    def sigma_s(self) -> float:
        """Standard deviation tau of an impulse radar's amplitude envelope (E-11)."""
        if "pulse_sigma_s" not in self.waveform.takes:
            raise ConfigError(f"a radar of waveform {self.waveform.kind!r} has no Gaussian pulse, hence no sigma")
        if self.pulse_sigma_s is not None:
            return self.pulse_sigma_s
        return GAUSSIAN_WIDTH[self.bandwidth_level_db] / float(self.bandwidth_hz or math.nan)

    def pulse_times_s(self, observation_s: float) -> npt.NDArray[np.float64]:
        """Return the times of the frames in an observation, ascending; bursts are complete."""
        if self.burst_pulses is None or self.burst_period_s is None:
            return self.frame_time_s(np.arange(duration_to_pulses(observation_s, self.prf_hz)))
        bursts = math.floor((observation_s - self.burst_pulses / self.prf_hz) / self.burst_period_s + 1e-9) + 1
        return self.frame_time_s(np.arange(max(bursts, 0) * self.burst_pulses))

    def frame_time_s(self, number: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Return frame times by number i: i / f_p, or floor(i / M) T_b + (i mod M) / f_p."""
        if self.burst_pulses is None or self.burst_period_s is None:
            return np.asarray(number) / self.prf_hz
        burst, frame = np.divmod(number, self.burst_pulses)
        return np.asarray(burst * self.burst_period_s + frame / self.prf_hz, dtype=np.float64)

    def pulse_bandwidth_hz(self, level_db: Literal[3, 10]) -> float:
        """Return the two-sided bandwidth of an impulse radar's pulse, 3 or 10 dB down (E-11)."""
        return GAUSSIAN_WIDTH[level_db] / self.sigma_s

    @property
    def range_resolution_m(self) -> float:
        """Half-power width in range of one echo. For a cw radar it is the span of the frame."""
        return self.waveform.resolution_m(self)

    @property
    def bin_spacing_m(self) -> float:
        """Spacing of the range bins: D c / (2 f_s), or c / (2 B) from a transform (E-15)."""
        return self.waveform.bin_spacing_m(self)

    @property
    def n_range_bins(self) -> int:
        """Number of range bins N of a frame (E-15)."""
        return self.waveform.n_range_bins(self)

    def range_axis_m(self) -> npt.NDArray[np.float64]:
        """Return the range of every bin, ascending; for cw the middle of the frame (E-15)."""
        steps = np.arange(self.n_range_bins)
        return np.asarray(self.waveform.first_bin_m(self) + self.bin_spacing_m * steps, dtype=np.float64)

    @property
    def unambiguous_velocity_mps(self) -> float:
        """Largest radial speed without aliasing: lambda f_p / 4 (E-06)."""
        return unambiguous_velocity_mps(self.prf_hz, self.wavelength_m)

    @property
    def averages_per_frame(self) -> int:
        """Number of pulses averaged into one frame, floor(pulse rate * share / (f_p levels)) (E-18)."""
        if self.pulse_rate_hz is None:
            return 1
        return math.floor(self.pulse_rate_hz * (self.integration_share or 1.0) / (self.prf_hz * self.sweep_levels))

    @property
    def folds_pulses(self) -> bool:
        """True if earlier pulses' echoes appear (E-10b); False for sweeps and without range."""
        return self.fold_echoes and self.waveform.samples_are_bins and self.waveform.ranged

    @property
    def receiver_bandwidth_hz(self) -> float:
        """Noise bandwidth B_n of a receiver sample, as stated or that of the waveform."""
        return self.noise_bandwidth_hz or self.waveform.noise_bandwidth_hz(self)


def find_possible_correlation(estimate: Iterable[float]) -> tuple[float, ...]:
    """Return an estimated correlation, shrunk to a possible one."""
    found = np.asarray(tuple(estimate)[:MAX_CORRELATED_BINS], dtype=np.float64)
    while True:
        values = tuple(float(rho) for rho in np.round(found, 4))
        least = _find_least_density(values)
        if least >= 0.0:
            return values
        found = found * (1.0 - 1e-4) / (1.0 - least)


@lru_cache(maxsize=256)
def _find_least_density(noise_correlation: tuple[float, ...]) -> float:
    """Return the minimum of 1 + 2 sum rho_l cos(l w)."""
    angle = np.linspace(0.0, np.pi, 64 * len(noise_correlation) + 1)
    lags = np.arange(1, len(noise_correlation) + 1)
    return 1.0 + 2.0 * float((np.cos(np.outer(angle, lags)) @ np.asarray(noise_correlation)).min())


def check_band(radar: Radar, bandwidth_hz: float) -> None:
    """Check that the band does not extend below 0 Hz."""
    if radar.carrier_hz < bandwidth_hz / 2.0:
        raise ValueError(
            f"carrier_hz {radar.carrier_hz:g} is below half of the signal's bandwidth, {bandwidth_hz:.4g} Hz: the band "
            "would extend below 0 Hz; raise carrier_hz, the centre of the band, or use a longer pulse or less bandwidth"
        )


def check_sweep_fits(radar: Radar, duration_s: float) -> None:
    """Check that a sweep or pulse fits into the frame time."""
    if duration_s * radar.prf_hz > 1.0 + 1e-9:
        raise ValueError(
            f"sweep_s {duration_s:g} is longer than a frame at prf_hz {radar.prf_hz:g}, {1 / radar.prf_hz:.4g} s; "
            "shorten the sweep or lower prf_hz"
        )
