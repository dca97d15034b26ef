"""Checks of a point echo: level, phase, Doppler, place and superposition."""

from __future__ import annotations

import math

import numpy as np

from doppelgait.radar.parameters import Radar
from doppelgait.testing.conformance import theory
from doppelgait.testing.conformance.bench import Bench, Complex, bins_of
from doppelgait.testing.conformance.tables import approach, place_m, speed_mps, table

FRACTIONS = (0.12, 0.3, 0.5, 0.7, 0.9)


def radar_equation(bench: Bench, radar: Radar) -> float:
    """Level of the strongest bin over sqrt(2 Z0 P_r G_rx), dB, for several ranges, cross sections and path gains."""
    range_m = np.array([place_m(radar, fraction) for fraction in FRACTIONS])
    rcs_m2, gain = np.array([0.1, 0.5, 1.0, 3.0, 10.0]), np.array([1.0, 0.25, 1.0, 0.01, 2.0])
    _, bins = bins_of(bench, table(range_m, rcs=rcs_m2, path_gain=gain), radar)
    wanted_v = theory.echo_v(radar, range_m=range_m, gain_m2=rcs_m2 * gain)
    return worst_db(np.abs(bins).max(axis=1) / wanted_v)


def phase_linearity(bench: Bench, radar: Radar) -> float:
    """Deviation of the strongest bin's phase from -4 pi / lambda per metre, over half a wavelength, rad."""
    offset_m = np.linspace(-0.25, 0.25, 17) * theory.wavelength_m(radar)
    bins = _column(bench, place_m(radar, 0.5) + offset_m, radar)
    wanted = np.exp(-4j * np.pi * offset_m / theory.wavelength_m(radar))
    return float(np.abs(np.angle(bins / (wanted * bins[8]))).max())


def absolute_phase(bench: Bench, radar: Radar) -> float:
    """Deviation of the phase of an echo in the middle of a bin from theta - 4 pi R / lambda, rad."""
    range_m = np.array([place_m(radar, fraction) for fraction in FRACTIONS])
    _, bins = bins_of(bench, table(range_m), radar)
    strongest = bins[np.arange(range_m.size), np.abs(bins).argmax(axis=1)]
    wanted_rad = radar.transmit_phase_rad - 4.0 * np.pi * range_m / theory.wavelength_m(radar)
    return float(np.abs(np.angle(strongest * np.exp(-1j * wanted_rad))).max())


def path_phase(bench: Bench, radar: Radar) -> float:
    """Deviation of an echo with ``path_phase`` from the one without, turned by it, rad."""
    phase_rad = np.array([-3.0, -1.0, 0.0, 0.5, 2.0, 5.0])
    range_m = np.full(phase_rad.size, place_m(radar, 0.4))
    _, plain = bins_of(bench, table(range_m), radar)
    _, turned = bins_of(bench, table(range_m, path_phase=phase_rad), radar)
    n = int(np.abs(plain[0]).argmax())
    return float(np.abs(turned[:, n] / plain[:, n] - np.exp(1j * phase_rad)).max())


def doppler_sign(bench: Bench, radar: Radar) -> float:
    """Deviation of the Doppler shift from +2 v / lambda, approaching and receding, % (pulse pairs over all bins)."""
    errors = []
    for velocity_mps in (speed_mps(radar), -speed_mps(radar)):
        step_m, middle_m = velocity_mps / radar.prf_hz, place_m(radar, 0.5)
        scene = approach(
            radar, start_m=middle_m + 32 * step_m, stop_m=middle_m - 32 * step_m, n_pulses=65, velocity_mps=velocity_mps
        )
        _, bins = bins_of(bench, scene, radar)
        pair = (bins[1:] * np.conj(bins[:-1])).sum()
        doppler_hz = float(np.angle(pair)) * radar.prf_hz / (2.0 * np.pi)
        errors.append(abs(doppler_hz / (2.0 * velocity_mps / theory.wavelength_m(radar)) - 1.0))
    return 100.0 * max(errors)


def range_migration(bench: Bench, radar: Radar) -> float:
    """Distance of the strongest bin from a scatterer that crosses the frame, in bins; half a bin is natural."""
    start_m, stop_m = place_m(radar, 0.85), place_m(radar, 0.2)
    velocity_mps = speed_mps(radar)
    scene = approach(radar, start_m=start_m, stop_m=stop_m, n_pulses=301, velocity_mps=velocity_mps)
    axis_m, bins = bins_of(bench, scene, radar)
    shown_m = scene["range"].values[:, 0] + theory.coupling_s(radar) * velocity_mps
    return float(np.abs(axis_m[np.abs(bins).argmax(axis=1)] - shown_m).max() / (axis_m[1] - axis_m[0]))


def superposition(bench: Bench, radar: Radar) -> float:
    """Deviation of three echoes together from the sum of them one by one, over the largest value."""
    rng = np.random.default_rng(5)
    range_m = np.array([place_m(radar, fraction) for fraction in (0.3, 0.32, 0.6)]) + rng.uniform(-0.1, 0.1, (7, 3))
    together = table(
        range_m, rcs=rng.uniform(0.2, 1.0, (7, 3)), radial_velocity=rng.uniform(-1.0, 1.0, (7, 3)) * speed_mps(radar)
    )
    _, bins = bins_of(bench, together, radar)
    single = sum(bins_of(bench, together.isel(scatterer=[n]), radar)[1] for n in range(3))
    return float(np.abs(bins - single).max() / np.abs(single).max())


def worst_db(ratio: np.ndarray) -> float:
    """Largest deviation of amplitude ratios from 1, dB; inf where one is 0."""
    smallest, largest = float(ratio.min()), float(ratio.max())
    return 20.0 * max(abs(math.log10(smallest)), abs(math.log10(largest))) if smallest > 0 else math.inf


def _column(bench: Bench, range_m: np.ndarray, radar: Radar) -> Complex:
    """The bin that is strongest in the middle row, in every row."""
    _, bins = bins_of(bench, table(range_m), radar)
    return np.asarray(bins[:, np.abs(bins[range_m.size // 2]).argmax()])
