"""Parts of a recording."""

import numpy as np
import pytest

from doppelgait.core.errors import ConfigError
from doppelgait.core.rng import rng
from doppelgait.motion import generate
from doppelgait.pipeline import simulate
from doppelgait.radar import Radar, Recording
from doppelgait.scene import Scene, Target


@pytest.fixture(scope="module")
def walk() -> Recording:
    motion = generate("human", duration_s=3.0)
    return simulate(Scene(targets=[Target(motion=motion)]), Radar.preset("x4", prf_hz=500.0), rng=rng(1))


def test_a_part_has_the_pulses_from_start_to_just_before_stop(walk):
    part = walk.between(0.5, 1.25)
    np.testing.assert_array_equal(part.slow_time_s, np.arange(250, 625) / 500.0)
    np.testing.assert_array_equal(part.baseband.values, walk.baseband.values[250:625])
    assert part.radar == walk.radar
    assert part.noise_power_v2 == walk.noise_power_v2
    assert np.isnan(part.snr_frame_db)
    assert np.isfinite(walk.snr_frame_db)


def test_truth_of_a_part_is_that_of_its_pulses(walk):
    part, whole = walk.between(0.5, 1.25).truth[0], walk.truth[0]
    np.testing.assert_array_equal(part.centre_range_m, whole.centre_range_m[250:625])
    np.testing.assert_array_equal(part.scatterers["range"].values, whole.scatterers["range"].values[250:625])
    assert part.label == whole.label
    assert part.ground_speed_mps == whole.ground_speed_mps
    times_s = part.body["time"].values
    assert times_s.min() >= 0.5
    assert times_s.max() < 1.25
    assert times_s.size == round(0.75 * 500 / 9)


def test_all_of_a_recording_is_itself(walk):
    part = walk.between(-1.0, 99.0)
    np.testing.assert_array_equal(part.baseband.values, walk.baseband.values)
    assert part.snr_frame_db == walk.snr_frame_db


def test_bursts_stay_whole(walk):
    bursts = walk.with_baseband(walk.baseband.assign_attrs(burst_pulses=100), truth=())
    np.testing.assert_array_equal(bursts.between(0.1, 0.95).slow_time_s, np.arange(100, 400) / 500.0)
    assert bursts.between(0.0, 9.0).n_pulses == walk.n_pulses
    with pytest.raises(ConfigError, match=r"between 0\.1 and 0\.3 s are 0 pulses"):
        bursts.between(0.1, 0.3)


@pytest.mark.parametrize(("start_s", "stop_s"), [(2.0, 1.0), (1.0, 1.0), (float("nan"), 1.0)])
def test_times_must_rise(walk, start_s, stop_s):
    with pytest.raises(ConfigError, match=r"give two rising times in s, for example 2 and 6"):
        walk.between(start_s, stop_s)


def test_a_part_outside_says_where_the_recording_is(walk):
    with pytest.raises(ConfigError, match=r"between 5 and 6 s are 0 pulses, .* 1500 from 0 to 2\.998 s"):
        walk.between(5.0, 6.0)
