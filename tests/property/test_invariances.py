"""What must not change, whatever the numbers (hypothesis, the same examples every time)."""

import numpy as np
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

from doppelgait.core.labels import BASEBAND, make_array
from doppelgait.motion.models.boulic import boulic_walk
from doppelgait.pipeline import analyze, simulate
from doppelgait.processing import Analysis, Gate, align, normalise, range_doppler, signature
from doppelgait.radar import Radar, synthesise
from doppelgait.scene import RcsSpec, Scene, Target
from echo_table import range_table


def always(*strategies, examples=20):
    """Property test with the same few examples in every run."""

    def wrap(test):
        return settings(derandomize=True, deadline=None, max_examples=examples)(given(*strategies)(test))

    return wrap


RADAR = Radar.preset("x4", range_start_m=1.0, range_stop_m=9.0)
WAVELENGTH_M = RADAR.wavelength_m
seeds = st.integers(0, 2**32 - 1)


def close(found, wanted, relative):
    return np.abs(found - wanted).max() <= relative * np.abs(wanted).max()


def wide_gate(baseband):
    t = baseband.coords["slow_time"].values
    axis = baseband.coords["range"].values
    return Gate.around(t, np.full(t.size, axis.mean()), span_m=float(np.ptp(axis)), source="given")


def signature_of(baseband, **analysis):
    return signature(baseband, wide_gate(baseband), Analysis(**analysis), wavelength_m=WAVELENGTH_M)


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
