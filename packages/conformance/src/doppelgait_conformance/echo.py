"""Checks of a point echo: level, phase, Doppler, range."""

from __future__ import annotations

import math

import numpy as np

from doppelgait.radar import Radar
from doppelgait_conformance import theory
from doppelgait_conformance.bench import Bench, check_complex, simulate_baseband
from doppelgait_conformance.radars import change_radar, make_approach, make_table, place_m, speed_mps

FRACTIONS = (0.12, 0.3, 0.5, 0.7, 0.9)


def radar_equation(bench: Bench, radar: Radar) -> float:
    """Compare an echo's level with the radar equation, dB."""
    range_m = np.array([place_m(radar, fraction) for fraction in FRACTIONS])
    rcs_m2, gain = np.array([0.1, 0.5, 1.0, 3.0, 10.0]), np.array([1.0, 0.25, 1.0, 0.01, 2.0])
    _, bins = simulate_baseband(bench, make_table(range_m, rcs=rcs_m2, path_gain=gain), radar)
    wanted_v = theory.echo_v(radar, range_m=range_m, gain_m2=rcs_m2 * gain)
    return worst_db(np.abs(bins).max(axis=1) / wanted_v)


def phase_linearity(bench: Bench, radar: Radar) -> float:
    """Compare the phase per metre with theory, rad."""
    offset_m = np.linspace(-0.25, 0.25, 17) * theory.wavelength_m(radar)
    _, bins = simulate_baseband(bench, make_table(place_m(radar, 0.5) + offset_m), radar)
    bins = bins[:, np.abs(bins[8]).argmax()]  # strongest in the middle row
    wanted = np.exp(-4j * np.pi * offset_m / theory.wavelength_m(radar))
    return float(np.abs(np.angle(bins / (wanted * bins[8]))).max())


def absolute_phase(bench: Bench, radar: Radar) -> float:
    """Compare the phase of an echo with theory, rad."""
    range_m = np.array([place_m(radar, fraction) for fraction in FRACTIONS])
    _, bins = simulate_baseband(bench, make_table(range_m), radar)
    strongest = bins[np.arange(range_m.size), np.abs(bins).argmax(axis=1)]
    wanted_rad = radar.transmit_phase_rad - 4.0 * np.pi * range_m / theory.wavelength_m(radar)
    return float(np.abs(np.angle(strongest * np.exp(-1j * wanted_rad))).max())


def path_phase(bench: Bench, radar: Radar) -> float:
    """Compare echoes with ``path_phase`` and rotated echoes, rad."""
    phase_rad = np.array([-3.0, -1.0, 0.0, 0.5, 2.0, 5.0])
    range_m = np.full(phase_rad.size, place_m(radar, 0.4))
    _, plain = simulate_baseband(bench, make_table(range_m), radar)
    _, turned = simulate_baseband(bench, make_table(range_m, path_phase=phase_rad), radar)
    n = int(np.abs(plain[0]).argmax())
    return float(np.abs(turned[:, n] / plain[:, n] - np.exp(1j * phase_rad)).max())


def doppler_sign(bench: Bench, radar: Radar) -> float:
    """Compare the Doppler shift with +2 v / lambda, %."""
    errors = []
    for velocity_mps in (speed_mps(radar), -speed_mps(radar)):
        step_m, middle_m = velocity_mps / radar.prf_hz, place_m(radar, 0.5)
        scene = make_approach(
            radar, start_m=middle_m + 32 * step_m, stop_m=middle_m - 32 * step_m, n_pulses=65, velocity_mps=velocity_mps
        )
        _, bins = simulate_baseband(bench, scene, radar)
        pair = (bins[1:] * np.conj(bins[:-1])).sum()
        doppler_hz = float(np.angle(pair)) * radar.prf_hz / (2.0 * np.pi)
        errors.append(abs(doppler_hz / (2.0 * velocity_mps / theory.wavelength_m(radar)) - 1.0))
    return 100.0 * max(errors)


def range_migration(bench: Bench, radar: Radar) -> float:
    """Compare the strongest bin with the true range, in bins."""
    start_m, stop_m = place_m(radar, 0.85), place_m(radar, 0.2)
    velocity_mps = speed_mps(radar)
    scene = make_approach(radar, start_m=start_m, stop_m=stop_m, n_pulses=301, velocity_mps=velocity_mps)
    axis_m, bins = simulate_baseband(bench, scene, radar)
    shown_m = scene["range"].values[:, 0] + theory.coupling_s(radar) * velocity_mps
    return float(np.abs(axis_m[np.abs(bins).argmax(axis=1)] - shown_m).max() / (axis_m[1] - axis_m[0]))


def superposition(bench: Bench, radar: Radar) -> float:
    """Compare three echoes together with their sum."""
    rng = np.random.default_rng(5)
    range_m = np.array([place_m(radar, fraction) for fraction in (0.3, 0.32, 0.6)]) + rng.uniform(-0.1, 0.1, (7, 3))
    together = make_table(
        range_m, rcs=rng.uniform(0.2, 1.0, (7, 3)), radial_velocity=rng.uniform(-1.0, 1.0, (7, 3)) * speed_mps(radar)
    )
    _, bins = simulate_baseband(bench, together, radar)
    single = sum(simulate_baseband(bench, together.isel(scatterer=[n]), radar)[1] for n in range(3))
    return float(np.abs(bins - single).max() / np.abs(single).max())


def frame_integration(bench: Bench, radar: Radar) -> float:
    """Compare a moving echo's loss with sinc(f_d T_i), dB."""
    share, turns = 0.8, np.array([0.1, -0.35, 0.6, 0.85, -1.4, 2.5])
    summing = change_radar(radar, integration_share=share)
    speed_of_turn = 0.5 * theory.wavelength_m(radar) * radar.prf_hz / share
    scene = make_table(np.full(7, place_m(radar, 0.5)), radial_velocity=speed_of_turn * np.append(turns, 0.0))
    _, bins = simulate_baseband(bench, scene, summing)
    n = np.abs(bins[-1]).argmax()
    loss = bins[:-1, n] / bins[-1, n]
    return worst_db(loss.real * np.pi * turns / np.sin(np.pi * turns))


def folding(bench: Bench, radar: Radar) -> float:
    """Compare earlier pulses' echoes with later frames, relative."""
    start_m = radar.range_start_m + 0.2 * (radar.range_stop_m - radar.range_start_m)
    pulse_m = 1.007 * (radar.range_stop_m - start_m)
    short = {"sweep_s": 20.0 / (radar.bandwidth_hz or math.nan)} if radar.waveform.kind == "lfm" else {}
    frame = {"range_start_m": start_m, "range_stop_m": radar.range_stop_m, **short}
    folding_radar = change_radar(radar, pulse_rate_hz=theory.C_MPS / (2.0 * pulse_m), **frame)
    beyond_m = np.array([-0.03, 0.01, 0.3, 0.55, 1.4]) * pulse_m
    scene = make_table(start_m + pulse_m + beyond_m)
    _, bins = simulate_baseband(bench, scene, folding_radar)
    wanted = np.zeros_like(bins)
    for k in range(4):
        later = {name: frame[name] + k * pulse_m for name in ("range_start_m", "range_stop_m")}
        alone = change_radar(radar, pulse_rate_hz=None, fold_echoes=False, **{**frame, **later})
        wanted += simulate_baseband(bench, scene, alone)[1][:, : bins.shape[1]]
    return float((np.abs(bins - wanted).max(axis=1) / np.abs(wanted).max(axis=1)).max())


def worst_db(ratio: np.ndarray) -> float:
    """Return the largest deviation of amplitude ratios from 1, dB."""
    smallest, largest = float(ratio.min()), float(ratio.max())
    return 20.0 * max(abs(math.log10(smallest)), abs(math.log10(largest))) if smallest > 0 else math.inf


LOWEST_DB = -40.0
"""Level, dB, below which the profile is left out, because decibels are meaningless near a null."""
CELLS = 2.0


def range_profile(bench: Bench, radar: Radar) -> float:
    """Compare range profile and transformed spectrum, dB."""
    axis_m = theory.range_axis_m(radar)
    middle_m, step_m = place_m(radar, 0.6), axis_m[1] - axis_m[0]
    range_m = middle_m + step_m * np.linspace(-0.5, 0.5, 9)
    shown_m, bins = simulate_baseband(bench, make_table(range_m), radar)
    offset_m = shown_m[None, :] - range_m[:, None]
    near = np.abs(offset_m) <= CELLS * theory.half_power_width_m(radar)
    wanted = np.zeros(bins.shape)
    wanted[near] = theory.compute_profile(radar, offset_m[near])
    strongest = np.abs(bins).argmax(axis=1)[:, None]
    wanted_db = _relative_db(wanted, strongest)
    compared = near & (wanted_db > LOWEST_DB)
    return float(np.abs(_relative_db(np.abs(bins), strongest)[compared] - wanted_db[compared]).max())


def _relative_db(amplitude: np.ndarray, column: np.ndarray) -> np.ndarray:
    reference = np.take_along_axis(amplitude, column, axis=1)
    return np.asarray(20.0 * np.log10(amplitude / reference))


def beat_frequency(bench: Bench, radar: Radar) -> float:
    """Compare the beat frequency with theory, %."""
    assert bench.sweep is not None
    range_m, velocity_mps = place_m(radar, 0.3), speed_mps(radar) * np.array([0.0, 1.0, -1.0])
    scene = make_table(np.full(3, range_m), radial_velocity=velocity_mps)
    size, interval_s = theory.count_sweep_samples(radar), 1.0 / radar.sample_rate_hz
    samples = check_complex(bench.sweep(scene, radar), (3, size), what="the sweep's samples")
    steps = np.arange(size) - (size - 1) / 2.0
    phase_rad = np.unwrap(np.angle(samples), axis=1)
    beat_hz = np.abs(phase_rad @ steps / (steps @ steps)) / (2.0 * np.pi * interval_s)
    slope = (radar.bandwidth_hz or np.nan) / theory.sweep_time_s(radar)
    wanted_hz = (slope * range_m - radar.carrier_hz * velocity_mps) * 2.0 / theory.C_MPS
    return float(100.0 * np.abs(beat_hz / wanted_hz - 1.0).max())


def range_doppler_coupling(bench: Bench, radar: Radar) -> float:
    """Compare a moving scatterer's range shift with theory, %."""
    cell_m = theory.half_power_width_m(radar)
    velocity_mps = -0.3 * cell_m / theory.coupling_s(radar)
    place = [_strongest_place_m(bench, radar, speed, cell_m) for speed in (velocity_mps, -velocity_mps)]
    shift_m = -0.5 * (place[0] - place[1])
    return float(100.0 * abs(shift_m / (theory.coupling_s(radar) * velocity_mps) - 1.0))


def _strongest_place_m(bench: Bench, radar: Radar, velocity_mps: float, cell_m: float) -> float:
    """Find where a moving scatterer is strongest in a bin."""
    middle_m = place_m(radar, 0.6)
    _, resting = simulate_baseband(bench, make_table(np.array([middle_m])), radar)
    offset_m = np.linspace(-0.7, 0.7, 141) * cell_m
    _, bins = simulate_baseband(bench, make_table(middle_m + offset_m, radial_velocity=velocity_mps), radar)
    level = np.abs(bins[:, np.abs(resting[0]).argmax()])
    top = slice(max(int(level.argmax()) - 10, 0), int(level.argmax()) + 11)
    curve, slope, _ = np.polyfit(offset_m[top], level[top], 2)
    return float(-slope / (2.0 * curve))
