"""Oscillator and mixer: phase noise, quadrature imbalance, constant leakage."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field

from doppelgait.core.config import FrozenModel
from doppelgait.core.plugins import plugin
from doppelgait.core.samples import Samples
from doppelgait.core.units import cosine, db_to_amplitude, decimal_logarithm, range_to_delay_s, sine
from doppelgait.radar.impairments.apply import check_width, convert_level_to_volt, sample_range_m
from doppelgait.radar.parameters import Radar

INTERPOLATION_ERROR = 1e-9
"""Maximum relative interpolation error of the residual phase between its delay nodes."""


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


def image_ratio_db(spec: IqImbalance) -> float:
    """Return image over signal, dB: 10 lg((1 + g^2 - 2 g cos phi) / (1 + g^2 + 2 g cos phi))."""
    g, phi = float(db_to_amplitude(spec.gain_db)), math.radians(spec.phase_deg)
    turn = complex(math.cos(phi), math.sin(phi))
    signal, image = (1.0 + g * turn) / 2.0, (1.0 - g * turn.conjugate()) / 2.0
    return 20.0 * math.log10(abs(image) / abs(signal)) if image else -math.inf


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
