"""Checks of receiver (noise, SNR, quantisation), wall and floor."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import xarray as xr

from doppelgait.radar import Radar
from doppelgait_conformance import theory
from doppelgait_conformance.bench import Bench, Complex, check_complex, simulate_baseband
from doppelgait_conformance.radars import change_radar, make_table, place_m

NOISE_VALUES = 200_000
SEED = 20180
MIN_PULSES = 2000


def noise_power(bench: Bench, radar: Radar) -> float:
    """Compare a range bin's noise power with E-18, dB."""
    power_v2 = float((np.abs(_sample_noise(bench, radar)) ** 2).mean())
    return abs(10.0 * math.log10(power_v2 / theory.bin_noise_v2(radar))) if power_v2 > 0 else math.inf


def noise_whiteness(bench: Bench, radar: Radar) -> float:
    """Return the larger of pulse correlation and non-circularity of noise."""
    noise = _sample_noise(bench, radar)
    power_v2 = (np.abs(noise) ** 2).mean()
    pair = np.abs((noise[1:] * np.conj(noise[:-1])).mean())
    return float(max(pair, np.abs((noise**2).mean())) / power_v2)


NOISE_STEPS = (1.0, 5.0, 20.0)
"""Input noise of the compared counters, in steps of their threshold."""
CORRELATION = (0.6, 0.15)
"""Noise correlation of radars that state none; the value behind the filter of an X4."""
LAGS = 4


def counter_noise(bench: Bench, radar: Radar) -> float:
    """Compare the noise of swept-threshold counters with E-18b, dB."""
    pulses = {"pulse_rate_hz": 165.0 * 4.0 * radar.prf_hz, "sweep_levels": 4, "integration_share": 0.9}
    errors = []
    for steps in NOISE_STEPS:
        step_v = theory.input_noise_v(radar) / steps
        errors.append(noise_power(bench, change_radar(radar, **pulses, threshold_step_v=step_v)))
    return max(errors)


def noise_correlation(bench: Bench, radar: Radar) -> float:
    """Compare the noise correlation over range with its statement."""
    radar = change_radar(radar, noise_correlation=radar.noise_correlation or CORRELATION)
    noise = _sample_noise(bench, radar)
    power_v2 = (np.abs(noise) ** 2).mean()
    wanted = [*radar.noise_correlation, *[0.0] * LAGS][:LAGS]
    found = [(noise[:, lag:] * np.conj(noise[:, :-lag])).mean() / power_v2 for lag in range(1, LAGS + 1)]
    return float(np.abs(np.array(found) - wanted).max())


def matched_snr(bench: Bench, radar: Radar) -> float:
    """Compare the matched SNR with E / N0, dB."""
    from scipy.signal import fftconvolve

    impulse = radar.waveform.kind == "impulse"
    if impulse:
        bins_hz = radar.sample_rate_hz / radar.decimation
        radar = change_radar(radar, noise_bandwidth_hz=bins_hz, noise_correlation=(), threshold_step_v=None)
    else:
        window = {"range_window": "none"} if radar.waveform.kind in theory.SWEPT else {}
        radar = change_radar(radar, noise_bandwidth_hz=None, **window)
    range_m = place_m(radar, 0.5)
    axis_m, bins = simulate_baseband(bench, make_table(np.array([range_m])), radar)
    shape = np.ones(1)
    if impulse:  # the pulse's shape to 5 sigma
        spread_bins = theory.C_MPS * theory.pulse_sigma_s(radar) / 2.0 / (axis_m[1] - axis_m[0])
        half = math.ceil(5.0 * spread_bins)
        shape = np.exp(-0.5 * (np.arange(-half, half + 1) / spread_bins) ** 2)
    noise_v2 = float((np.abs(fftconvolve(_sample_noise(bench, radar), shape[None], mode="valid")) ** 2).mean())
    signal_v2 = float((np.abs(fftconvolve(bins, shape[None], mode="same")) ** 2).max())
    wanted = theory.compute_energy_ratio(radar, range_m=range_m, gain_m2=1.0)
    return abs(10.0 * math.log10(signal_v2 / noise_v2 / wanted)) if signal_v2 * noise_v2 > 0 else math.inf


def _sample_noise(bench: Bench, radar: Radar) -> Complex:
    assert bench.noise is not None
    n_bins = theory.range_axis_m(radar).size
    n_pulses = max(NOISE_VALUES // n_bins, MIN_PULSES)
    noise = bench.noise(radar, n_pulses=n_pulses, rng=np.random.default_rng(SEED))
    return check_complex(noise, (n_pulses, n_bins), what=f"noise of waveform {radar.waveform.kind!r}")


def quantisation_snr(bench: Bench, radar: Radar) -> float:
    """Compare the quantisation SNR of a tone with theory, dB."""
    del radar
    errors = [_quantisation_error_db(bench, bits, backoff_db) for bits in (8, 10, 12) for backoff_db in (1.0, 12.0)]
    return max(errors)


def _quantisation_error_db(bench: Bench, bits: int, backoff_db: float) -> float:
    assert bench.quantise is not None
    turns = np.arange(65_536) * (math.sqrt(5.0) - 1.0) / 2.0  # an incommensurate frequency, so that no phase repeats
    tone = (10.0 ** (-backoff_db / 20.0) * np.exp(2j * np.pi * turns)).astype(np.complex64)[:, None]
    converted = check_complex(bench.quantise(tone, bits=bits, full_scale_v=1.0), tone.shape, what="quantised samples")
    error_v2 = float((np.abs(converted - tone) ** 2).mean())
    if not error_v2 > 0:
        return math.inf
    found_db = 10.0 * math.log10(float((np.abs(tone) ** 2).mean()) / error_v2)
    wanted_db = 20.0 * bits * math.log10(2.0) + 10.0 * math.log10(1.5) - backoff_db
    return abs(found_db - wanted_db)


def quantisation_bias(bench: Bench, radar: Radar) -> float:
    """Return the largest mean error between two codes, in steps (Widrow and Kollar, Quantization Noise, 2008)."""
    del radar
    assert bench.quantise is not None
    bits, n = 8, 100_000
    step_v = 2.0 / 2**bits
    level = np.linspace(0.0, 1.0, 9)
    rng = np.random.default_rng(SEED)
    dither = rng.normal(size=(n, 9)) + 1j * rng.normal(size=(n, 9))
    samples = (step_v * (level * (1 + 1j) + 0.5 * dither)).astype(np.complex64)
    converted = check_complex(
        bench.quantise(samples, bits=bits, full_scale_v=1.0), samples.shape, what="quantised samples"
    )
    error = (converted - samples).mean(axis=0) / step_v
    return float(max(np.abs(error.real).max(), np.abs(error.imag).max()))


WALLS = (
    {"permittivity": 2.73, "conductivity_s_per_m": 0.055, "thickness_m": 0.0125},
    {"permittivity": 3.91, "conductivity_s_per_m": 0.033, "thickness_m": 0.115},
    {"permittivity": 5.24, "conductivity_s_per_m": 0.22, "thickness_m": 0.2},
)
"""Plasterboard, brick and concrete as at 7.29 GHz (ITU-R P.2040)."""
AZIMUTHS_RAD = (0.0, 0.5, -0.9)
RANGE_M = 5.0

FLOOR = {"permittivity": 5.24, "conductivity_s_per_m": 0.22}
RADAR_HEIGHT_M = 1.0
LOWEST_FIELD = 10.0 ** (-30.0 / 20.0)
"""Fraction of the maximum below which fields are left out of a comparison in dB."""


def wall_loss(bench: Bench, radar: Radar) -> float:
    """Compare a wall's two-way loss with a slab's, dB."""
    return max(abs(10.0 * math.log10(gain)) for gain, _, _, _ in _measure_walls(bench, radar))


def wall_delay(bench: Bench, radar: Radar) -> float:
    """Compare the added range with (sqrt(eps' - sin^2) - cos) d."""
    return max(1e3 * abs(later_m - wanted_m) for _, (later_m, _), _, wanted_m in _measure_walls(bench, radar))


def wall_phase(bench: Bench, radar: Radar) -> float:
    """Compare the phase of range and ``path_phase`` with T^2."""
    per_metre = 4.0 * np.pi / theory.wavelength_m(radar)
    turns = [(extra_rad - per_metre * later_m, t) for _, (later_m, extra_rad), t, _ in _measure_walls(bench, radar)]
    return max(abs(float(np.angle(np.exp(1j * turn) / t**2))) for turn, t in turns)


def _measure_walls(bench: Bench, radar: Radar) -> list[tuple[float, tuple[float, float], complex, float]]:
    """Measure every wall at every angle."""
    assert bench.wall is not None
    results = []
    for wall, azimuth_rad in product(WALLS, AZIMUTHS_RAD):
        before = make_table(np.full(2, RANGE_M), azimuth=azimuth_rad, elevation=0.0)
        after = bench.wall(before, carrier_hz=radar.carrier_hz, **wall)
        later_m = float(after["range"].values[0, 0]) - RANGE_M
        eps = theory.compute_permittivity(
            permittivity=wall["permittivity"],
            conductivity_s_per_m=wall["conductivity_s_per_m"],
            carrier_hz=radar.carrier_hz,
        )
        cosine, thickness_m = math.cos(azimuth_rad), wall["thickness_m"]
        t = theory.compute_slab_insertion(
            cosine, permittivity=eps, thickness_m=thickness_m, wavelength_m=theory.wavelength_m(radar)
        )
        wanted_m = (math.sqrt(eps.real - 1.0 + cosine**2) - cosine) * thickness_m
        # the radar equation takes the delayed range; a bundle of rays spreads with the path
        echo = float(after["path_gain"].values[0, 0]) * (RANGE_M / (RANGE_M + later_m)) ** 4
        radii_m = theory.refracted_radii_m(RANGE_M, azimuth_rad, index=math.sqrt(eps.real), thickness_m=thickness_m)
        gain = echo * (radii_m[0] * radii_m[1] / RANGE_M**2) ** 2 / abs(t) ** 4
        results.append((gain, (later_m, float(_phase_rad(after)[0, 0])), t, wanted_m))
    return results


def _phase_rad(scatterers: xr.Dataset) -> np.ndarray:
    if "path_phase" in scatterers:
        return np.asarray(scatterers["path_phase"].values, dtype=float)
    return np.zeros(scatterers["range"].shape)


def two_ray_pattern(bench: Bench, radar: Radar) -> float:
    """Compare a floor's field with the two-ray formula, dB."""
    assert bench.two_ray is not None
    height_m, ground_m = (side.ravel() for side in np.meshgrid(np.linspace(0.05, 1.8, 36), np.linspace(2.0, 8.0, 25)))
    direct_m = np.hypot(ground_m, height_m - RADAR_HEIGHT_M)
    image_m = np.hypot(ground_m, height_m + RADAR_HEIGHT_M)
    before = make_table(direct_m, azimuth=0.0, elevation=np.arcsin((height_m - RADAR_HEIGHT_M) / direct_m))
    after = bench.two_ray(before, radar_height_m=RADAR_HEIGHT_M, carrier_hz=radar.carrier_hz, **FLOOR)
    wave = 2.0 * np.pi / theory.wavelength_m(radar)
    level = np.sqrt(after["rcs"].values * after["path_gain"].values) / after["range"].values ** 2
    found = (level * np.exp(1j * (_phase_rad(after) - 2.0 * wave * after["range"].values))).sum(axis=1)
    eps = theory.compute_permittivity(carrier_hz=radar.carrier_hz, **FLOOR)
    gamma = theory.compute_floor_reflection((height_m + RADAR_HEIGHT_M) / image_m, permittivity=eps)
    wanted = (np.exp(-1j * wave * direct_m) / direct_m + gamma * np.exp(-1j * wave * image_m) / image_m) ** 2
    seen = np.abs(wanted) * direct_m**2 > LOWEST_FIELD * (np.abs(wanted) * direct_m**2).max()
    return float(np.abs(20.0 * np.log10(np.abs(found) / np.abs(wanted)))[seen].max())
