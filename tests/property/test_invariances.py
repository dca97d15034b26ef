"""What must not change, whatever the numbers (hypothesis, the same examples every time)."""

import numpy as np
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

from doppelgait.motion.models.boulic import boulic_walk
from doppelgait.pipeline import analyze, simulate
from doppelgait.processing import Analysis, range_doppler
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


@always(st.floats(0.01, 100.0), examples=8)
def test_features_do_not_depend_on_the_level(factor):
    motion = boulic_walk(speed_mps=1.2, height_m=1.75, duration_s=2.5)
    results = [
        analyze(simulate(Scene([Target(motion, rcs=RcsSpec(total_m2=total))]), RADAR), gate="truth")[0]
        for total in (1.0, factor)
    ]
    a, b = (result.features.vector() for result in results)
    np.testing.assert_allclose(b, a, rtol=1e-3)
