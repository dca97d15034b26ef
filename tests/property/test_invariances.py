"""What must not change, whatever the numbers (hypothesis, the same examples every time)."""

from dataclasses import replace

import numpy as np
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

from doppelgait.core import units
from doppelgait.core.labels import BASEBAND, make_array
from doppelgait.motion import make_motion
from doppelgait.motion.models.boulic import boulic_walk
from doppelgait.pipeline import analyze, simulate
from doppelgait.processing import Analysis, Gate, align, normalise, range_doppler, signature
from doppelgait.radar import Radar, received_power_w, synthesise
from doppelgait.scene import RcsSpec, Scene, Target, assemble, compute_part_weights
from doppelgait.scene.rcs import PART_WEIGHTS
from echo_table import range_table


def always(*strategies, examples=20):
    """Property test with the same few examples in every run."""

    def wrap(test):
        return settings(derandomize=True, deadline=None, max_examples=examples)(given(*strategies)(test))

    return wrap


RADAR = Radar.preset("x4", range_start_m=1.0, range_stop_m=9.0)
WAVELENGTH_M = RADAR.wavelength_m
T = np.arange(0, 0.5001, 0.01)

coordinate = st.floats(-50, 50)
angle = st.floats(-180, 180)
seeds = st.integers(0, 2**32 - 1)


def swarm(seed, n=4, speed=2.0):
    """Motion of n points that drift and swing, near the origin, 1 m up."""
    rng = np.random.default_rng(seed)
    start = rng.uniform(-0.5, 0.5, (1, n, 3)) + np.array([0.0, 0.0, 1.0])
    drift = rng.uniform(-speed, speed, (1, n, 3)) * T[:, None, None]
    swing = 0.05 * np.sin(2 * np.pi * 2 * T[:, None, None] + rng.uniform(0, 6, (1, n, 3)))
    names = [f"m{i}" for i in range(n)]
    return make_motion(start + drift + swing, rate_hz=100, markers=names, parts=["torso"] * n)


def scene_at(motion, start, heading_deg, radar_position_m, **options):
    target = Target(motion, start_position_m=start, heading_deg=heading_deg, **options)
    return Scene([target], radar_position_m=radar_position_m, duration_s=0.4)


def close(found, wanted, relative):
    return np.abs(found - wanted).max() <= relative * np.abs(wanted).max()


def wide_gate(baseband):
    t = baseband.coords["slow_time"].values
    axis = baseband.coords["range"].values
    return Gate.around(t, np.full(t.size, axis.mean()), span_m=float(np.ptp(axis)), source="given")


def signature_of(baseband, **analysis):
    return signature(baseband, wide_gate(baseband), Analysis(**analysis), wavelength_m=WAVELENGTH_M)


# --- Geometry -----------------------------------------------------------------------------------------------------


@always(seeds, coordinate, coordinate)
def test_translating_scene_and_radar_together_changes_nothing(seed, east, north):
    motion = swarm(seed)
    here = simulate(scene_at(motion, (5.0, 1.0), 30.0, (0.0, 0.0, 1.0)), RADAR)
    there = simulate(scene_at(motion, (5.0 + east, 1.0 + north), 30.0, (east, north, 1.0)), RADAR)
    # 1e-13 m of rounding at 50 m is 3e-11 rad of phase
    assert close(there.baseband.values, here.baseband.values, 1e-6)
    np.testing.assert_allclose(there.truth[0].centre_range_m, here.truth[0].centre_range_m, rtol=1e-12)
    np.testing.assert_allclose(
        there.truth[0].scatterers["radial_velocity"], here.truth[0].scatterers["radial_velocity"], atol=1e-9
    )


@always(seeds, angle)
def test_rotating_the_scene_about_the_radar_changes_nothing(seed, turn_deg):
    motion = swarm(seed)
    turn = np.radians(turn_deg)
    turned = (5.0 * np.cos(turn), 5.0 * np.sin(turn))
    here = simulate(scene_at(motion, (5.0, 0.0), 30.0, (0.0, 0.0, 1.0)), RADAR)
    there = simulate(scene_at(motion, turned, 30.0 + turn_deg if turn_deg < 150 else turn_deg - 330, (0, 0, 1)), RADAR)
    assert close(there.baseband.values, here.baseband.values, 1e-6)
    np.testing.assert_allclose(
        there.truth[0].centre_aspect_rad, here.truth[0].centre_aspect_rad, rtol=0, atol=1e-6, equal_nan=True
    )


@always(seeds, st.floats(-30, 30), angle)
def test_bearing_does_not_change_the_recording_of_an_isotropic_radar(seed, bearing_deg, aspect_deg):
    motion = swarm(seed)

    def recorded(bearing):
        target = Target(motion, range_m=4.0, bearing_deg=bearing, aspect_deg=aspect_deg)
        return simulate(Scene([target]), RADAR).baseband.values

    assert close(recorded(bearing_deg), recorded(0.0), 1e-6)


@always(seeds)
def test_permuting_the_markers_changes_nothing(seed):
    motion = swarm(seed, n=6)
    order = np.random.default_rng(seed).permutation(6)
    here = simulate(scene_at(motion, (5.0, 1.0), 0.0, (0.0, 0.0, 1.0)), RADAR).baseband.values
    there = simulate(
        scene_at(replace(motion, positions=motion.positions.isel(marker=order)), (5.0, 1.0), 0.0, (0.0, 0.0, 1.0)),
        RADAR,
    ).baseband.values
    assert close(there, here, 1e-6)


@always(seeds)
def test_radial_velocity_is_the_slope_of_range(seed):
    scene = scene_at(swarm(seed), (3.0, 1.0), 0.0, (0.0, 0.0, 1.0))
    t = 0.2 + np.array([-1e-5, 0, 1e-5])
    table = assemble(scene, t)
    slope = (table["range"].values[2] - table["range"].values[0]) / 2e-5
    np.testing.assert_allclose(table["radial_velocity"].values[1], -slope, atol=1e-6)


# --- Echo ---------------------------------------------------------------------------------------------------------


@always(st.floats(0.5, 40), st.floats(1e-3, 10))
def test_received_power_falls_with_the_fourth_power_of_range(range_m, rcs_m2):
    near = received_power_w(RADAR, range_m=range_m, rcs_m2=rcs_m2)
    far = received_power_w(RADAR, range_m=2 * range_m, rcs_m2=rcs_m2)
    np.testing.assert_allclose(near / far, 16, rtol=1e-12)


@always(st.lists(st.sampled_from(sorted(PART_WEIGHTS)), min_size=1, max_size=40))
def test_weights_sum_to_one_and_are_positive(parts):
    weights = compute_part_weights(parts)
    assert abs(weights.sum() - 1) < 1e-12
    assert (weights > 0).all()


# --- Transform ----------------------------------------------------------------------------------------------------


@always(seeds, st.sampled_from([101, 107, 128, 160]))
def test_reversing_time_mirrors_doppler(seed, k):
    ranges = 4.0 + np.cumsum(np.random.default_rng(seed).normal(0, 2e-3, (221, 3)), axis=0)
    y = synthesise(range_table(ranges), RADAR)
    # hop 10 and 221 pulses: the processing intervals are their own mirror images
    forth = signature_of(y, doppler_bins=k, hop=10)
    back = signature_of(y.copy(data=y.values[::-1]), doppler_bins=k, hop=10)
    index = (2 * (k // 2) - np.arange(k)) % k  # the bin of -F
    assert forth.shape[0] == 13
    assert close(back.values[::-1][:, index], forth.values, 3e-6)


@always(seeds, st.integers(1, 20))
def test_block_size_does_not_change_the_range_doppler_maps(seed, block):
    y = synthesise(range_table(np.random.default_rng(seed).uniform(2, 8, (200, 2))), RADAR)

    def maps(size):
        blocks = range_doppler(y, Analysis(hop=9), wavelength_m=WAVELENGTH_M, block=size)
        return xr.concat(list(blocks), dim="time")

    found, wanted = maps(block), maps(64)
    np.testing.assert_array_equal(found.coords["time"], wanted.coords["time"])
    assert close(found.values, wanted.values, 1e-6)


@always(seeds, st.lists(st.integers(0, 11), min_size=1, max_size=6))
def test_single_columns_equal_those_of_the_whole(seed, columns):
    y = synthesise(range_table(np.random.default_rng(seed).uniform(2, 8, (200, 2))), RADAR)
    whole = next(range_doppler(y, Analysis(hop=9), wavelength_m=WAVELENGTH_M))
    some = next(range_doppler(y, Analysis(hop=9), wavelength_m=WAVELENGTH_M, columns=columns))
    np.testing.assert_array_equal(some.coords["time"], whole.coords["time"].values[columns])
    assert close(some.values, whole.values[columns], 1e-6)


@always(seeds, st.floats(1e-3, 1e3))
def test_signature_scales_with_power_and_normalisation_removes_it(seed, factor):
    y = synthesise(range_table(np.random.default_rng(seed).uniform(2, 8, (150, 2))), RADAR)
    louder = y.copy(data=(y.values * np.float32(np.sqrt(factor))).astype(np.complex64))
    plain, loud = signature_of(y, hop=5), signature_of(louder, hop=5)
    assert close(loud.values.astype(float), factor * plain.values.astype(float), 3e-6)
    np.testing.assert_allclose(normalise(loud, 0.0).values, normalise(plain, 0.0).values, rtol=0, atol=1e-5)


@always(seeds, st.floats(-600, 600))
def test_a_shift_in_frequency_shifts_the_signature(seed, shift_hz):
    k = 128
    bins = round(shift_hz * k / 1000)
    y = synthesise(range_table(np.random.default_rng(seed).uniform(2, 8, (150, 2))), RADAR)
    turn = np.exp(2j * np.pi * bins / k * np.arange(150))[:, None]
    turned = y.copy(data=(y.values * turn).astype(np.complex64))
    plain, shifted = signature_of(y, doppler_bins=k), signature_of(turned, doppler_bins=k)
    assert close(shifted.values, np.roll(plain.values, bins, axis=1), 3e-6)
    back = align(shifted, np.full(shifted.sizes["time"], bins * 1000 / k))
    assert close(back.values, plain.values, 3e-6)


@always(seeds, st.floats(-np.pi, np.pi), st.floats(0.0, 10.0))
def test_a_common_phase_and_a_later_start_change_nothing(seed, phase_rad, start_s):
    ranges = np.random.default_rng(seed).uniform(2, 8, (150, 2))
    plain = synthesise(range_table(ranges), RADAR)
    other = synthesise(range_table(ranges), RADAR.model_copy(update={"transmit_phase_rad": phase_rad}))
    later = make_array(
        BASEBAND,
        other.values,
        {"slow_time": start_s + plain.coords["slow_time"].values, "range": plain.coords["range"].values},
    )
    found, wanted = signature_of(later, hop=5), signature_of(plain, hop=5)
    assert close(found.values, wanted.values, 3e-6)
    np.testing.assert_allclose(found.coords["time"].values - start_s, wanted.coords["time"], atol=1e-9)


@always(st.floats(0.01, 100.0), examples=8)
def test_features_do_not_depend_on_the_level(factor):
    motion = boulic_walk(speed_mps=1.2, height_m=1.75, duration_s=2.5)
    results = [
        analyze(simulate(Scene([Target(motion, rcs=RcsSpec(total_m2=total))]), RADAR), gate="truth")[0]
        for total in (1.0, factor)
    ]
    a, b = (result.features.vector() for result in results)
    np.testing.assert_allclose(b, a, rtol=1e-3)


# --- Units --------------------------------------------------------------------------------------------------------


@always(st.floats(-200, 200))
def test_decibels_round_trip(level_db):
    np.testing.assert_allclose(units.power_to_db(units.db_to_power(level_db)), level_db, atol=1e-9)
    np.testing.assert_allclose(units.db_to_amplitude(level_db) ** 2, units.db_to_power(level_db), rtol=1e-12)
    np.testing.assert_allclose(units.power_to_db(units.dbm_to_watt(level_db) / 1e-3), level_db, atol=1e-9)


@always(st.floats(-50, 50), st.floats(1e-3, 1.0))
def test_doppler_round_trip(velocity_mps, wavelength_m):
    doppler_hz = units.velocity_to_doppler_hz(velocity_mps, wavelength_m)
    np.testing.assert_allclose(units.doppler_to_velocity_mps(doppler_hz, wavelength_m), velocity_mps, rtol=1e-12)


@always(st.integers(3, 2000), st.floats(1.0, 1e5))
def test_doppler_axis_of_any_length_holds_zero_and_stays_in_band(k, prf_hz):
    axis = units.doppler_axis_hz(k, prf_hz)
    assert axis[k // 2] == 0
    assert axis.min() >= -prf_hz / 2 * (1 + 1e-15)  # the last digit may be rounded
    assert axis.max() < prf_hz / 2


@always(st.floats(1e-3, 1.0), st.floats(10, 1e4))
def test_pulses_of_an_interval_are_odd_and_as_long_as_asked(cpi_s, prf_hz):
    m = units.cpi_to_pulses(cpi_s, prf_hz)
    assert m % 2 == 1
    assert abs(m - cpi_s * prf_hz) <= 1 + 1e-6
