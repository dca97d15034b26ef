"""Receiver: phase noise, quadrature imbalance, constant leakage, converters, timing errors and lost frames."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator

from doppelgait.core.config import FrozenModel
from doppelgait.core.errors import ConfigError, warn_caller
from doppelgait.core.plugins import plugin
from doppelgait.core.samples import Samples
from doppelgait.core.units import arcsine, cosine, db_to_amplitude, decimal_logarithm, range_to_delay_s, sine
from doppelgait.radar.impairments.apply import (
    Times,
    check_width,
    convert_level_to_volt,
    exclude,
    find_volts_per_unit,
    sample_range_m,
)
from doppelgait.radar.parameters import Radar

INTERPOLATION_ERROR = 1e-9
"""Maximum relative interpolation error of the residual phase between its delay nodes."""
WARN_CLIPPED = 0.01
"""Minimum share of clipped values for a warning."""
DEFAULT_BACKOFF_DB = 12.0


class PhaseNoise(FrozenModel):
    r"""Phase noise of the oscillator: white, drift, random walk, and what the delay leaves of it.

    Sample n of frame i becomes :math:`y_{i,n} e^{j(\varphi_i + \psi_{i,n})}`. One oscillator serves
    transmitter and receiver, so that only the change of its phase over the delay has an effect:
    :math:`\psi(t) = \varphi_0(t) - \varphi_0(t - 2R/c)`, with the spectral density

    .. math:: S_\psi(f) = 4 \sin^2(2 \pi f R / c)\, S_{\varphi_0}(f), \qquad S_{\varphi_0}(f) = 2 \mathcal{L}(f)

    (one-sided; Budge and Burt 1993). The absolute phase noise never reaches the samples.

    Start jitter with standard deviation s is a common phase with standard deviation :math:`2 \pi f_c s`. It also
    shifts the echo by c s / 2 in range. The residual of a static echo from this shift is smaller than the residual from
    the phase by the factor :math:`0.61 \lambda / (4 \pi \sigma_R)` for all s (sigma_R: standard deviation of the pulse
    in range; -28 dB for the X4), and is neglected.

    white_rad: Standard deviation of the common phase, independent from frame to frame. The default
        is 0.004: 0.003 and 0.005 were measured with two X4 at 25 frames/s in an empty room.
    jitter_s: Start jitter of the frames at the receiver after averaging; it is added to
        ``white_rad`` in power.
    drift_rad_per_min: Rate of a linear drift; 0.1 to 1 in size is usual.
    walk_rad_per_sqrt_min: Random walk of the common phase: its standard deviation after one minute.
    density_dbc_per_hz: Single-sideband phase noise L of the oscillator at ``offset_hz``; none by
        default. Only offsets up to f_p / 2 have an effect: higher ones average out within a frame.
    offset_hz: Offset from the carrier at which the density applies.
    slope_db_per_decade: Slope of L against the offset, -40 to 0: -20 white and -30 flickering
        frequency noise.
    """

    kind: Literal["phase_noise"] = "phase_noise"
    white_rad: float = Field(default=0.004, ge=0, le=10)
    jitter_s: float = Field(default=0.0, ge=0, le=1e-6)
    drift_rad_per_min: float = Field(default=0.0, ge=-1000, le=1000)
    walk_rad_per_sqrt_min: float = Field(default=0.0, ge=0, le=1000)
    density_dbc_per_hz: float | None = Field(default=None, ge=-250, le=0)
    offset_hz: float = Field(default=1000.0, gt=0, le=1e9)
    slope_db_per_decade: float = Field(default=-20.0, ge=-40, le=0)


@plugin("impairment", parameters=PhaseNoise)
def add_phase_noise(samples: Samples, parameters: PhaseNoise, radar: Radar, rng: np.random.Generator) -> Samples:
    """Rotate samples by a phase per frame and, with a density, per range."""
    n_frames = samples.shape[0]
    # common phase of each frame: white noise and jitter, drift, and a random walk from 0
    sd_rad = math.hypot(parameters.white_rad, 2.0 * math.pi * radar.carrier_hz * parameters.jitter_s)
    minutes = np.arange(n_frames) / (60.0 * radar.prf_hz)
    step_rad = parameters.walk_rad_per_sqrt_min / math.sqrt(60.0 * radar.prf_hz)
    white_rad = sd_rad * rng.standard_normal(n_frames)
    steps_rad = step_rad * rng.standard_normal(n_frames)
    walk_rad = np.cumsum(steps_rad) - steps_rad[:1]
    phase_rad = white_rad + parameters.drift_rad_per_min * minutes + walk_rad
    if parameters.density_dbc_per_hz is not None:
        check_width(samples, radar)
        residual_rad, weights = residual_phase_rad(n_frames, parameters, radar=radar, rng=rng)
        if len(weights) > 1:
            return samples.rotate(phase_rad / (2.0 * math.pi), residual_rad / (2.0 * math.pi), weights)
        phase_rad = phase_rad + weights[0] @ residual_rad
    turn = np.empty((phase_rad.size, 1), dtype=np.complex64)
    turn.real, turn.imag = cosine(phase_rad)[:, None], sine(phase_rad)[:, None]
    samples *= turn
    return samples


def residual_phase_rad(
    n_frames: int, spec: PhaseNoise, *, radar: Radar, rng: np.random.Generator
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return the oscillator phase at reception minus that at transmission, rad."""
    from scipy import fft

    length = fft.next_fast_len(2 * n_frames, real=True)
    f_hz = np.arange(1, length // 2 + 1) * (radar.prf_hz / length)
    level_db = float(spec.density_dbc_per_hz or 0.0) + spec.slope_db_per_decade * decimal_logarithm(
        f_hz / spec.offset_hz
    )
    size = db_to_amplitude(level_db) * math.sqrt(2.0 * radar.prf_hz * length)  # S = 2 L, one-sided, rad^2/Hz
    parts = rng.standard_normal((2, f_hz.size))
    node_s, weights = make_delay_nodes(range_to_delay_s(sample_range_m(radar)), radar.prf_hz / 2.0)
    seen = np.zeros((node_s.size, f_hz.size + 1), dtype=np.complex128)  # without the mean, which is part of the drift
    angle = np.pi * f_hz * node_s[:, None]
    sin, cos = sine(angle), cosine(angle)
    size = size * sin  # 1 - exp(-2 j a) = 2 sin(a) (sin(a) + j cos(a))
    seen.real[:, 1:] = size * (parts[0] * sin - parts[1] * cos)
    seen.imag[:, 1:] = size * (parts[0] * cos + parts[1] * sin)
    return np.ascontiguousarray(fft.irfft(seen, n=length)[:, :n_frames]), weights


def make_delay_nodes(
    delay_s: npt.NDArray[np.float64], highest_hz: float
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    r"""Return delays to interpolate the residual phase from, and weights."""
    middle_s, half_s = (delay_s.max() + delay_s.min()) / 2.0, (delay_s.max() - delay_s.min()) / 2.0
    if not half_s:
        return delay_s[:1], np.ones((delay_s.size, 1))
    reach, n_nodes = 2.0 * math.pi * highest_hz * half_s, 1
    error = reach / 2.0
    while error > INTERPOLATION_ERROR:
        n_nodes += 1
        error *= reach / (2.0 * (n_nodes + 1))
    node = cosine(np.pi * (np.arange(n_nodes) + 0.5) / n_nodes)
    node_s = middle_s + half_s * node
    distance = (delay_s[:, None] - node_s) / half_s
    columns = [
        np.prod(np.delete(distance, k, axis=1), axis=1) / np.prod(np.delete(node[k] - node, k)) / node_s[k]
        for k in range(n_nodes)
    ]
    weights = np.stack(columns, axis=1)
    return node_s, weights * delay_s[:, None]


class IqImbalance(FrozenModel):
    r"""Quadrature channel of unequal gain, and of a phase that is not exactly 90 degrees.

    .. math:: y' = \mathrm{Re}\,y + j g\,\mathrm{Im}(y e^{j \varphi}) = \alpha y + \beta y^*, \qquad
        \alpha = \frac{1 + g e^{j \varphi}}{2}, \quad \beta = \frac{1 - g e^{-j \varphi}}{2}

    The second term is an image at the opposite Doppler. The defaults are those of a usual analogue mixer (image at
    -28 dB, assumed); a 24 GHz CW sensor showed about -11 dB, and the X4 mixes digitally (-55 dB or less).

    gain_db: Gain g of the quadrature channel over the in-phase channel.
    phase_deg: Error phi of the angle between the channels.
    """

    kind: Literal["iq_imbalance"] = "iq_imbalance"
    gain_db: float = Field(default=0.5, ge=-40, le=40)
    phase_deg: float = Field(default=3.0, ge=-90, le=90)


@plugin("impairment", parameters=IqImbalance)
def add_image(samples: Samples, parameters: IqImbalance, radar: Radar, rng: np.random.Generator) -> Samples:
    """Add the mirror image of unequal I and Q."""
    return samples.apply_imbalance(float(db_to_amplitude(parameters.gain_db)), math.radians(parameters.phase_deg))


class DcLeak(FrozenModel):
    """Constant in every sample, with a slow random walk: the oscillator's self-mixing product.

    level_db: Modulus of the constant, dB re 1 V.
    in_units: ``level_db`` is re one unit of the sensor's own files (``radar.volts_per_unit``).
    phase_deg: Phase of the constant; random by default.
    walk_per_sqrt_min: Change after one minute (root mean square of a complex random walk) over the
        constant.
    """

    kind: Literal["dc_leak"] = "dc_leak"
    level_db: float = Field(default=-80.0, ge=-400, le=100)
    in_units: bool = False
    phase_deg: float | None = Field(default=None, ge=-360, le=360)
    walk_per_sqrt_min: float = Field(default=0.01, ge=0, le=100)


@plugin("impairment", parameters=DcLeak)
def add_dc(samples: Samples, parameters: DcLeak, radar: Radar, rng: np.random.Generator) -> Samples:
    """Add the constant of every pulse."""
    level_v = convert_level_to_volt(parameters, radar)
    random_rad = rng.uniform(0.0, 2.0 * math.pi)
    phase_rad = random_rad if parameters.phase_deg is None else math.radians(parameters.phase_deg)
    parts = rng.standard_normal((2, samples.shape[0]))
    steps = (parts[0] + 1j * parts[1]) * parameters.walk_per_sqrt_min / math.sqrt(2.0 * 60.0 * radar.prf_hz)
    walk = np.cumsum(steps) - steps[:1]
    constant_v = level_v * complex(math.cos(phase_rad), math.sin(phase_rad)) * (1.0 + walk)
    samples += constant_v.astype(np.complex64)[:, None]
    return samples


class Adc(FrozenModel):
    r"""Two's complement converter for I and for Q, each with 2^bits levels up to full scale.

    A sine that reaches full scale less the back-off has the signal-to-quantisation-noise ratio
    6.02 bits + 1.76 - back-off, dB.

    bits: Bits of the converter.
    full_scale_v: Maximum voltage of I or Q. Set either this or ``backoff_db``.
    backoff_db: Distance of the maximum of I or Q in the recording from full scale, as set by a gain
        control; 12 dB if neither is set. Negative values clip.
    """

    kind: Literal["adc"] = "adc"
    bits: int = Field(default=12, ge=2, le=24)
    full_scale_v: float | None = Field(default=None, gt=0, le=1e6)
    backoff_db: float | None = Field(default=None, ge=-60, le=120)

    _check_scale = model_validator(mode="after")(exclude("full_scale_v", "backoff_db"))


@plugin("impairment", parameters=Adc)
def quantise(samples: Samples, parameters: Adc, radar: Radar, rng: np.random.Generator) -> Samples:
    """Round the samples to the converter's levels; warn of 1 % clipped values."""
    backoff_db = DEFAULT_BACKOFF_DB if parameters.backoff_db is None else parameters.backoff_db
    samples = samples.add_pending_noise()
    full_scale_v = parameters.full_scale_v or samples.find_largest_part() * float(db_to_amplitude(backoff_db))
    if full_scale_v == 0.0:
        return samples
    half = 2 ** (parameters.bits - 1)
    coded, n_clipped = samples.quantise(full_scale_v / half, -half, half - 1, full_scale_v)
    if n_clipped:
        text = f"adc: {full_scale_v:.3g} V full scale"
        _warn_clipped(n_clipped / (2 * math.prod(samples.shape)), text, "raise full_scale_v or backoff_db")
    return coded


def _warn_clipped(share: float, what: str, cure: str) -> None:
    if share > WARN_CLIPPED:
        warn_caller(f"{what}: {100 * share:.0f} % of the values are clipped; {cure}")


X4_CLOCK_HZ = 243e6
X4_DUTY = 0.95
"""Share of a frame's time in which the X4 sends (user guide)."""
X4_BANDS = {7.29e9: (306, 0.78), 8.748e9: (316, 0.77)}
"""Sum of the down-conversion filter's tap magnitudes and its gain for an RF sinusoid, by carrier (X4 driver)."""


class X4Counts(FrozenModel):
    r"""Counters of the XeThru X4 chip.

    The chip compares the signal with a swept threshold and counts.

    One count is :math:`d / (1024\,i\,p)` units in RF (i iterations of p pulses per step d of the threshold DAC) and
    :math:`d / (1024\,i\,p\,\sum|h|)` units in I and Q after the chip's down-conversion filter h. RF stays within
    +-L, L = (dac_max - dac_min + 1) / 2048 units. The envelope A of a larger RF sinusoid becomes
    the fundamental of the clipped sinusoid,

    .. math:: A' = \frac{2}{\pi} \left(A \arcsin\frac{L}{A} + L \sqrt{1 - L^2 / A^2}\right),

    and its phase does not change. ``radar.volts_per_unit`` converts volts to units.

    iterations: Sweeps of the threshold per frame.
    pulses_per_step: Pulses per threshold.
    dac_min: Lowest threshold.
    dac_max: Highest threshold, above ``dac_min``, up to 2047.
    dac_step: Step from threshold to threshold: 1, 2, 4 or 8.
    prf_div: Divisor from 243 MHz to the pulse rate.
    """

    kind: Literal["x4_counts"] = "x4_counts"
    iterations: int = Field(default=16, ge=1, le=255)
    pulses_per_step: int = Field(default=10, ge=1, le=65535)
    dac_min: int = Field(default=949, ge=0, le=2047)
    dac_max: int = Field(default=1100, ge=0, le=2047)
    dac_step: Literal[1, 2, 4, 8] = 1
    prf_div: int = Field(default=16, ge=4, le=255)

    @model_validator(mode="after")
    def _check_window(self) -> X4Counts:
        if self.dac_max <= self.dac_min:
            raise ValueError(f"dac_max {self.dac_max} must be larger than dac_min {self.dac_min}")
        return self


def x4_frame_rate_hz(spec: X4Counts) -> float:
    """Return the highest frame rate of an X4, 0.95 PRF / (iterations pulses_per_step levels)."""
    levels = (spec.dac_max - spec.dac_min) // spec.dac_step + 1
    return X4_DUTY * X4_CLOCK_HZ / spec.prf_div / (spec.iterations * spec.pulses_per_step * levels)


@plugin("impairment", parameters=X4Counts)
def count(samples: Samples, parameters: X4Counts, radar: Radar, rng: np.random.Generator) -> Samples:
    """Convert samples to whole counts; warn of impossible rates and saturation."""
    unit_v = find_volts_per_unit(radar, wanted_by="x4_counts")
    band = [band for carrier_hz, band in X4_BANDS.items() if math.isclose(carrier_hz, radar.carrier_hz, rel_tol=0.01)]
    if not band:
        raise ConfigError(
            f"x4_counts: radar.carrier_hz = {radar.carrier_hz:g} is not an X4's: it transmits at 7.29e9 or 8.748e9 Hz; "
            'use kind = "adc" for other radars'
        )
    taps, baseband_gain = band[0]
    highest_hz = x4_frame_rate_hz(parameters)
    if radar.prf_hz > highest_hz:
        warn_caller(
            f"x4_counts: {parameters.iterations} iterations of {parameters.pulses_per_step} pulses allow "
            f"{highest_hz:.1f} frames/s, but radar.prf_hz is {radar.prf_hz:g}; lower one of them"
        )
    limit = baseband_gain * (parameters.dac_max - parameters.dac_min + 1) / 2048.0
    samples = samples.add_pending_noise()
    if samples.find_largest_part() / unit_v > limit / math.sqrt(2.0):  # otherwise no magnitude reaches the limit
        values = samples.matrix / np.float32(unit_v)
        size = np.abs(values)
        over = size > limit
        # the envelope of a clipped sinusoid
        ratio = limit / size[over].astype(np.float64)
        gain = 2.0 / math.pi * (arcsine(ratio) + ratio * np.sqrt(1.0 - ratio**2))
        values[over] *= gain.astype(np.float32)
        text = f"x4_counts: thresholds {parameters.dac_min} to {parameters.dac_max}"
        _warn_clipped(float(over.mean()), text, "widen dac_min to dac_max")
        samples = Samples(values) * np.float32(unit_v)
    step_v = unit_v * parameters.dac_step / (1024.0 * parameters.iterations * parameters.pulses_per_step * taps)
    return samples.quantise(step_v, -math.inf, math.inf)[0]


LARGEST_JITTER = 0.1
"""Maximum ratio of jitter to pulse interval: pulses change order once in 1e12."""


class FrameJitter(FrozenModel):
    """Independent timing errors of the pulses, as of a host that requests each frame.

    The jitter changes the times at which the scene is observed
    (:func:`doppelgait.radar.impairments.shift_pulse_times`), not the samples.

    sd_s: Standard deviation of a pulse's time, at most a tenth of the pulse interval.
    """

    kind: Literal["frame_jitter"] = "frame_jitter"
    sd_s: float = Field(default=1e-5, ge=0, le=10)


def add_jitter(times_s: Times, parameters: FrameJitter, radar: Radar, rng: np.random.Generator) -> Times:
    """Add independent normal errors to the pulse times (:class:`ConfigError` above the limit)."""
    largest_s = LARGEST_JITTER / radar.prf_hz
    if parameters.sd_s > largest_s:
        raise ConfigError(
            f"frame_jitter: sd_s = {parameters.sd_s:g} is not allowed with prf_hz = {radar.prf_hz:g}: pulses could "
            f"change order; the maximum is a tenth of the pulse interval, {largest_s:.3g} s"
        )
    return times_s + rng.normal(0.0, parameters.sd_s, size=times_s.shape)


@plugin("impairment", parameters=FrameJitter, shift_times=add_jitter)
def keep_samples(samples: Samples, parameters: FrameJitter, radar: Radar, rng: np.random.Generator) -> Samples:
    """Return the samples unchanged: the jitter is in the times at which the scene was observed."""
    return samples


class DroppedFrames(FrozenModel):
    """Frames lost between sensor and recorder, alone or in bursts.

    The model is a two-state Markov chain (Gilbert 1960): the length of lost runs is geometric with
    the mean ``mean_length``, and the expected share of lost frames is ``probability``.

    probability: Share of lost frames, at most mean_length / (1 + mean_length). Set either this or
        ``frames``.
    frames: Numbers of the lost frames, counted from 0.
    mean_length: Mean number of frames lost in a row, 1 or more.
    fill: Content that the recorder stores instead: the last received frame (at the start, the first
        received frame), or 0.
    """

    kind: Literal["dropped_frames"] = "dropped_frames"
    probability: float | None = Field(default=None, ge=0, lt=1)
    frames: tuple[int, ...] | None = Field(default=None, max_length=1_000_000)
    mean_length: float = Field(default=1.0, ge=1, le=1e6)
    fill: Literal["repeat", "zero"] = "repeat"

    @model_validator(mode="after")
    def _check_choice(self) -> DroppedFrames:
        exclude("probability", "frames", needed=True)(self)
        if self.frames is not None:
            if self.mean_length != 1:
                raise ValueError("mean_length belongs to probability; a list of frames needs none")
            if self.frames and min(self.frames) < 0:
                raise ValueError(f"frames are counted from 0; {min(self.frames)} is not allowed")
        largest = self.mean_length / (1.0 + self.mean_length)
        if self.probability is not None and self.probability > largest:
            raise ValueError(
                f"probability {self.probability:g} needs longer bursts than mean_length {self.mean_length:g}: at most "
                f"{largest:.4g} can be lost; raise mean_length"
            )
        return self


@plugin("impairment", parameters=DroppedFrames)
def drop_frames(samples: Samples, parameters: DroppedFrames, radar: Radar, rng: np.random.Generator) -> Samples:
    """Fill lost frames as the recorder does (:class:`ConfigError` for a frame beyond the end)."""
    lost = sample_lost_frames(samples.shape[0], parameters, rng=rng)
    if not lost.any():
        return samples
    if parameters.fill == "zero" or lost.all():
        samples *= (~lost)[:, None]
        return samples
    arrived = np.flatnonzero(~lost)
    missing = np.flatnonzero(lost)
    latest = np.searchsorted(arrived, missing) - 1
    return samples.repeat(missing, arrived[np.maximum(latest, 0)])


def sample_lost_frames(n_frames: int, spec: DroppedFrames, *, rng: np.random.Generator) -> npt.NDArray[np.bool_]:
    """Return a mask of the lost frames of ``n_frames``."""
    lost = np.zeros(n_frames, dtype=bool)
    if spec.frames is not None:
        if spec.frames and max(spec.frames) >= n_frames:
            raise ConfigError(
                f"dropped_frames: frame {max(spec.frames)} is not in a recording of {n_frames} frames, counted from 0; "
                "leave it out of frames"
            )
        lost[list(spec.frames)] = True
        return lost
    if not spec.probability:
        return lost
    begin_chance = spec.probability / ((1.0 - spec.probability) * spec.mean_length)
    state, place = bool(rng.random() < spec.probability), 0
    while place < n_frames:
        run = int(rng.geometric(1.0 / spec.mean_length if state else begin_chance))
        lost[place : place + run] = state
        state, place = not state, place + run
    return lost
