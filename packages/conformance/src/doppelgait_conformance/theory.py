"""Closed forms from first principles and radar parameters."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from doppelgait.radar import Radar

Complex = npt.NDArray[np.complex128]
Float = npt.NDArray[np.float64]

C_MPS = 299_792_458.0
NOISE_DENSITY_W_PER_HZ = 1.380649e-23 * 290.0
OHM = 50.0
VACUUM_F_PER_M = 8.8541878128e-12

SWEPT = ("fmcw", "stepped")
WAVEFORMS = ("impulse", "rectangular", "lfm", "fmcw", "stepped", "cw")


def wavelength_m(radar: Radar) -> float:
    """Return the wavelength c / f_c."""
    return C_MPS / radar.carrier_hz


def count_averages(radar: Radar) -> int:
    """Return the whole pulses per frame and threshold level (E-18)."""
    if not radar.pulse_rate_hz:
        return 1
    summed_s = (radar.integration_share if radar.integration_share > 0 else 1.0) / radar.prf_hz
    return int(summed_s * radar.pulse_rate_hz // radar.sweep_levels)


def pulse_sigma_s(radar: Radar) -> float:
    """Return the standard deviation of a Gaussian envelope."""
    if radar.pulse_sigma_s is not None:
        return radar.pulse_sigma_s
    # the level "3 dB" is half power
    ratio = 2.0 if radar.bandwidth_level_db == 3 else 10.0
    return math.sqrt(math.log(ratio)) / (math.pi * (radar.bandwidth_hz or math.nan))


def count_sweep_samples(radar: Radar) -> int:
    """Return the number of samples or steps of a sweep."""
    return round((radar.sweep_s or 0.0) * radar.sample_rate_hz)


def sweep_time_s(radar: Radar) -> float:
    """Return the duration of a sweep or pulse."""
    return (
        count_sweep_samples(radar) / radar.sample_rate_hz
        if radar.waveform.kind in SWEPT
        else float(radar.sweep_s or math.nan)
    )


def range_axis_m(radar: Radar) -> Float:
    """Return the range bins."""
    start_m, stop_m = radar.range_start_m, radar.range_stop_m
    if radar.waveform.kind == "cw":
        return np.array([(start_m + stop_m) / 2.0])
    if radar.waveform.kind in SWEPT:
        step_m = C_MPS / (2.0 * (radar.bandwidth_hz or math.nan))
        first = math.ceil(start_m / step_m - 1e-9)
        return np.asarray(step_m * np.arange(first, math.ceil(stop_m / step_m - 1e-9)))
    step_m = radar.decimation * C_MPS / (2.0 * radar.sample_rate_hz)
    return np.asarray(start_m + step_m * np.arange(math.ceil((stop_m - start_m) / step_m - 1e-9)))


def received_w(radar: Radar, *, range_m: Float, gain_m2: Float) -> Float:
    """Evaluate the radar equation, W."""
    sent_w = 10.0 ** ((radar.tx_power_dbm + radar.tx_gain_dbi + radar.rx_gain_dbi - 30.0) / 10.0)
    return np.asarray(sent_w * wavelength_m(radar) ** 2 * gain_m2 / ((4.0 * np.pi) ** 3 * range_m**4))


def compute_receiver_gain(radar: Radar) -> float:
    """Return the power gain of the receiver."""
    return float(10.0 ** (radar.receiver_gain_db / 10.0))


def echo_v(radar: Radar, *, range_m: Float, gain_m2: Float) -> Float:
    """Return the envelope of an echo into 50 ohm, V."""
    power_w = received_w(radar, range_m=range_m, gain_m2=gain_m2)
    return np.asarray(np.sqrt(2.0 * OHM * power_w * compute_receiver_gain(radar)))


def make_window(radar: Radar) -> Float:
    """Return the window along a sweep."""
    x = (np.arange(count_sweep_samples(radar)) + 0.5) / count_sweep_samples(radar)
    terms = {"none": (1.0,), "hann": (0.5, 0.5), "hamming": (0.54, 0.46), "blackman": (0.42, 0.5, 0.08)}
    shape = sum(c * (-1) ** k * np.cos(2.0 * np.pi * k * x) for k, c in enumerate(terms[radar.range_window]))
    return np.asarray(shape * np.ones_like(x))


def compute_noise_figure(radar: Radar) -> float:
    """Return the noise factor F."""
    return float(10.0 ** (radar.noise_figure_db / 10.0))


def bin_noise_v2(radar: Radar) -> float:
    """Return a bin's mean-square noise, V^2 (E-18, E-18b)."""
    own_hz = {
        "impulse": math.sqrt(math.log(10.0)) / (math.pi * pulse_sigma_s(radar))
        if radar.waveform.kind == "impulse"
        else 0.0,
        "rectangular": 1.0 / (radar.sweep_s or math.inf),
        "lfm": 1.0 / (radar.sweep_s or math.inf),
        "fmcw": radar.sample_rate_hz,
        "stepped": radar.sample_rate_hz,
        "cw": radar.prf_hz / (radar.integration_share or 1.0),
    }
    width_hz = radar.noise_bandwidth_hz or own_hz[radar.waveform.kind]
    level_v2 = (
        2.0 * OHM * NOISE_DENSITY_W_PER_HZ * compute_noise_figure(radar) * width_hz * compute_receiver_gain(radar)
    )
    if radar.waveform.kind in SWEPT:
        weights = make_window(radar)
        level_v2 *= float((weights**2).sum() / weights.sum() ** 2)
    if radar.threshold_step_v is not None:
        level_v2 *= radar.threshold_step_v / (math.sqrt(math.pi) * input_noise_v(radar))
    return level_v2 / count_averages(radar)


def input_noise_v(radar: Radar) -> float:
    """Return the rms of one pulse's real noise, V (E-18b)."""
    density_w = NOISE_DENSITY_W_PER_HZ * compute_noise_figure(radar) * compute_receiver_gain(radar)
    return math.sqrt(OHM * density_w * radar.sample_rate_hz / 2.0)


def compute_energy_ratio(radar: Radar, *, range_m: float, gain_m2: float) -> float:
    """Return E / N0 of N_eff averaged pulses."""
    if radar.waveform.kind == "impulse":
        length_s = math.sqrt(math.pi) * pulse_sigma_s(radar)
    else:
        length_s = (
            (radar.integration_share or 1.0) / radar.prf_hz if radar.waveform.kind == "cw" else sweep_time_s(radar)
        )
    power_w = received_w(radar, range_m=np.array(range_m), gain_m2=np.array(gain_m2))
    return float(power_w * length_s * count_averages(radar) / (NOISE_DENSITY_W_PER_HZ * compute_noise_figure(radar)))


def power_spectrum(radar: Radar) -> tuple[Float, Float]:
    """Return frequencies from the carrier, Hz, and the received spectrum."""
    if radar.waveform.kind == "impulse":
        tau = pulse_sigma_s(radar)
        frequency_hz = np.linspace(-1.5, 1.5, 2001) / tau
        return frequency_hz, np.exp(-2.0 * (np.pi * tau * frequency_hz) ** 2)
    if radar.waveform.kind in SWEPT:
        size = count_sweep_samples(radar)
        step_hz = (radar.bandwidth_hz or math.nan) / size
        return np.asarray(step_hz * (np.arange(size) - (size - 1) / 2.0)), make_window(radar)
    duration_s = sweep_time_s(radar)
    turns = 0.0 if radar.waveform.kind == "rectangular" else (radar.bandwidth_hz or 0.0) * duration_s
    size = max(4096, math.ceil(4.0 * turns))
    x = (np.arange(size) + 0.5) / size - 0.5
    pulse = np.exp(1j * np.pi * turns * x**2)
    spectrum = np.abs(np.fft.fftshift(np.fft.fft(pulse, 4 * size))) ** 2  # long enough for delays of two durations
    return np.asarray((np.arange(4 * size) - 2 * size) / (4.0 * duration_s)), np.asarray(spectrum)


def compute_profile(radar: Radar, offset_m: Float) -> Float:
    """Return the range profile at offsets from a point echo."""
    frequency_hz, weight = power_spectrum(radar)
    delay_s = 2.0 * offset_m.ravel() / C_MPS
    values = np.array([np.abs((weight * np.exp(2j * np.pi * frequency_hz * one)).sum()) for one in delay_s])
    return np.asarray(values / weight.sum()).reshape(offset_m.shape)


def half_power_width_m(radar: Radar) -> float:
    """Return the profile's half-power width, by bisection."""
    high = C_MPS * {"impulse": 2.0 * pulse_sigma_s(radar) if radar.waveform.kind == "impulse" else 0.0}.get(
        radar.waveform.kind, 1.0 / (radar.bandwidth_hz or 1.0 / sweep_time_s(radar))
    )
    low = 0.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if compute_profile(radar, np.array([middle]))[0] ** 2 > 0.5 else (low, middle)
    return 2.0 * low


def coupling_s(radar: Radar) -> float:
    """Return the range shift per approach speed of a sweep."""
    if radar.waveform.kind not in ("lfm", *SWEPT):
        return 0.0
    return -radar.carrier_hz * sweep_time_s(radar) / (radar.bandwidth_hz or math.nan)


def compute_permittivity(*, permittivity: float, conductivity_s_per_m: float, carrier_hz: float) -> complex:
    """Return the complex relative permittivity."""
    return complex(permittivity, -conductivity_s_per_m / (2.0 * math.pi * carrier_hz * VACUUM_F_PER_M))


def compute_slab_insertion(cosine: float, *, permittivity: complex, thickness_m: float, wavelength_m: float) -> complex:
    """Return the field ratio behind and without a slab."""
    inside = np.sqrt(permittivity - 1.0 + cosine**2)
    turn = 2.0 * np.pi * thickness_m / wavelength_m
    matrix = np.array(
        [
            [np.cos(turn * inside), 1j * np.sin(turn * inside) / inside],
            [1j * inside * np.sin(turn * inside), np.cos(turn * inside)],
        ]
    )
    front = matrix @ np.array([1.0, cosine])
    through = 2.0 * cosine / (cosine * front[0] + front[1])
    return complex(through * np.exp(1j * turn * cosine))


def refracted_radii_m(range_m: float, angle_rad: float, *, index: float, thickness_m: float) -> tuple[float, float]:
    """Return the principal radii of rays behind a slab."""
    depth_m = range_m * math.cos(angle_rad)

    def place_m(angle: float) -> float:
        return (depth_m - thickness_m) * math.tan(angle) + thickness_m * math.tan(math.asin(math.sin(angle) / index))

    step, angle_rad = 1e-5, max(abs(angle_rad), 1e-4)
    slope = (place_m(angle_rad + step) - place_m(angle_rad - step)) / (2.0 * step)
    return place_m(angle_rad) / math.sin(angle_rad), math.cos(angle_rad) * slope


def compute_floor_reflection(sin_grazing: Float, *, permittivity: complex) -> Complex:
    """Return the Fresnel coefficient of a half space, vertical polarisation."""
    root = np.sqrt(permittivity - 1.0 + sin_grazing**2)
    return np.asarray((permittivity * sin_grazing - root) / (permittivity * sin_grazing + root))
