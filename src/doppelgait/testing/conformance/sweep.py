"""Checks of the response in range: profile, beat frequency and range-Doppler coupling."""

from __future__ import annotations

import numpy as np

from doppelgait.radar.parameters import Radar
from doppelgait.testing.conformance import theory
from doppelgait.testing.conformance.bench import Bench, bins_of, complex_of
from doppelgait.testing.conformance.tables import place_m, speed_mps, table

LOWEST_DB = -40.0
"""Levels of the profile below this are left out: near a null dB mean nothing."""
CELLS = 2.0


def range_profile(bench: Bench, radar: Radar) -> float:
    """Deviation of the range profile from the transform of the spectrum, dB, within two cells (equivalence i).

    Echoes stand at several places between two bins; levels are relative to the strongest bin of the same frame, which
    leaves the radar equation out.
    """
    axis_m = theory.range_axis_m(radar)
    middle_m, step_m = place_m(radar, 0.6), axis_m[1] - axis_m[0]
    range_m = middle_m + step_m * np.linspace(-0.5, 0.5, 9)
    shown_m, bins = bins_of(bench, table(range_m), radar)
    offset_m = shown_m[None, :] - range_m[:, None]
    near = np.abs(offset_m) <= CELLS * theory.half_power_width_m(radar)
    wanted = np.zeros(bins.shape)
    wanted[near] = theory.profile(radar, offset_m[near])
    strongest = np.abs(bins).argmax(axis=1)[:, None]
    wanted_db = _relative_db(wanted, strongest)
    compared = near & (wanted_db > LOWEST_DB)
    return float(np.abs(_relative_db(np.abs(bins), strongest)[compared] - wanted_db[compared]).max())


def _relative_db(amplitude: np.ndarray, column: np.ndarray) -> np.ndarray:
    reference = np.take_along_axis(amplitude, column, axis=1)
    return np.asarray(20.0 * np.log10(amplitude / reference))


def beat_frequency(bench: Bench, radar: Radar) -> float:
    """Deviation of the beat from S 2 R / c - 2 v f_c / c, %, at rest and moving; its sign is a convention."""
    assert bench.sweep is not None
    range_m, velocity_mps = place_m(radar, 0.3), speed_mps(radar) * np.array([0.0, 1.0, -1.0])
    scene = table(np.full(3, range_m), radial_velocity=velocity_mps)
    size, interval_s = theory.n_sweep(radar), 1.0 / radar.sample_rate_hz
    samples = complex_of(bench.sweep(scene, radar), (3, size), what="the sweep's samples")
    steps = np.arange(size) - (size - 1) / 2.0
    phase_rad = np.unwrap(np.angle(samples), axis=1)
    beat_hz = np.abs(phase_rad @ steps / (steps @ steps)) / (2.0 * np.pi * interval_s)
    slope = (radar.bandwidth_hz or np.nan) / theory.sweep_time_s(radar)
    wanted_hz = (slope * range_m - radar.carrier_hz * velocity_mps) * 2.0 / theory.C_MPS
    return float(100.0 * np.abs(beat_hz / wanted_hz - 1.0).max())


def range_doppler_coupling(bench: Bench, radar: Radar) -> float:
    """Deviation of the range shift of a moving scatterer from -f_c v T / B, %; v makes it 0.3 cells.

    The scatterer stands at many places around a bin; the one at which this bin is strongest tells the shift. Half the
    difference between approaching and receding leaves out everything that does not depend on velocity.
    """
    cell_m = theory.half_power_width_m(radar)
    velocity_mps = -0.3 * cell_m / theory.coupling_s(radar)
    place = [_strongest_place_m(bench, radar, speed, cell_m) for speed in (velocity_mps, -velocity_mps)]
    shift_m = -0.5 * (place[0] - place[1])
    return float(100.0 * abs(shift_m / (theory.coupling_s(radar) * velocity_mps) - 1.0))


def _strongest_place_m(bench: Bench, radar: Radar, velocity_mps: float, cell_m: float) -> float:
    """Place, relative to the bin that shows a scatterer at rest, at which a moving one is strongest there."""
    middle_m = place_m(radar, 0.6)
    _, resting = bins_of(bench, table(np.array([middle_m])), radar)
    offset_m = np.linspace(-0.7, 0.7, 141) * cell_m
    _, bins = bins_of(bench, table(middle_m + offset_m, radial_velocity=velocity_mps), radar)
    level = np.abs(bins[:, np.abs(resting[0]).argmax()])
    top = slice(max(int(level.argmax()) - 10, 0), int(level.argmax()) + 11)
    curve, slope, _ = np.polyfit(offset_m[top], level[top], 2)
    return float(-slope / (2.0 * curve))
