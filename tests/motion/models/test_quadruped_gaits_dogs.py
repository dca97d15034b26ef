"""Sampled dogs: spreads, and that the model accepts them."""

from collections import Counter

import numpy as np
import pytest

import doppelgait as dg
from doppelgait.core.errors import ConfigError
from doppelgait.motion.models import quadruped_gait, sample_dog
from doppelgait.motion.models.quadruped_gaits import BUILDS, DOG_BUILDS, GAIT_SHARES, GAITS


def test_every_sampled_dog_can_move():
    for seed in range(150):
        rng = np.random.default_rng(seed)
        dog = sample_dog(rng)
        motion = quadruped_gait(**dog.parameters(), duration_s=1.0, rate_hz=100, rng=rng)
        assert (motion.facts.gait, motion.facts.height_m) == (dog.gait, dog.withers_m)
        assert np.isfinite(motion.position_m).all()


def test_dogs_are_sampled_as_stated():
    rng = np.random.default_rng(0)
    dogs = [sample_dog(rng) for _ in range(4000)]
    for gait, share in GAIT_SHARES.items():
        assert np.mean([dog.gait == gait for dog in dogs]) == pytest.approx(share, abs=0.03)
    assert {dog.build for dog in dogs} == set(DOG_BUILDS)
    assert np.std([np.log(dog.trunk_ripple) for dog in dogs]) == pytest.approx(0.4, rel=0.1)
    assert np.std([np.log(dog.stride_ratio) for dog in dogs]) == pytest.approx(0.07, rel=0.1)
    assert np.std([dog.fore_swing_peak for dog in dogs]) == pytest.approx(0.1, rel=0.1)
    assert np.std([dog.length_asymmetry * dog.froude**0.5 for dog in dogs]) == pytest.approx(0.04, rel=0.1)
    assert np.corrcoef([[dog.hind_swing_peak, dog.fore_swing_peak] for dog in dogs], rowvar=False)[
        0, 1
    ] == pytest.approx(0, abs=0.05)


def test_gait_and_speed_can_be_given_and_the_seed_decides():
    assert sample_dog(np.random.default_rng(9)) == sample_dog(np.random.default_rng(9))
    slow = sample_dog(np.random.default_rng(9), gait="walk", froude=0.15)
    assert (slow.gait, slow.froude) == ("walk", 0.15)
    assert slow.build == sample_dog(np.random.default_rng(9)).build
    low, high, _ = GAITS["canter"].froude
    assert all(low < sample_dog(np.random.default_rng(n), gait="canter").froude < high for n in range(50))
    named = slow.parameters(speed_mps=0.8, withers_m=0.5)
    assert "froude" not in named
    motion = quadruped_gait(**named, duration_s=1.0, rng=np.random.default_rng(1))
    assert motion.facts.height_m == 0.5


def test_heights_of_a_breed_spread_within_its_limits_without_a_pile_at_one():
    rng = np.random.default_rng(4)
    heights_m = {build: [] for build in DOG_BUILDS}
    for _ in range(6000):
        dog = sample_dog(rng)
        heights_m[dog.build].append(dog.withers_m)
    for build, found_m in heights_m.items():
        low_m, high_m = BUILDS[build].withers_range_m
        assert low_m <= min(found_m) < max(found_m) <= high_m, build
        assert max(Counter(found_m).values()) == 1, build
    assert np.std(heights_m["chihuahua"]) / 0.2 == pytest.approx(0.08, rel=0.15)
    assert min(heights_m["chihuahua"]) < 0.18
    assert 0.85 < max(heights_m["great_dane"]) <= 0.9


@pytest.mark.parametrize("froude", [0.05, 0.2, 1.1, 3.0, 8.0])
def test_a_dog_of_a_given_froude_number_has_a_gait_that_goes_so_fast(froude):
    fits = {
        gait: share for gait, share in GAIT_SHARES.items() if GAITS[gait].froude[0] <= froude <= GAITS[gait].froude[1]
    }
    rng = np.random.default_rng(1)
    dogs = [sample_dog(rng, froude=froude) for _ in range(2000)]
    counted = Counter(dog.gait for dog in dogs)
    assert set(counted) == set(fits)
    for gait, share in fits.items():
        assert counted[gait] / 2000 == pytest.approx(share / sum(fits.values()), abs=0.04)
    for dog in dogs[:5]:
        quadruped_gait(**dog.parameters(), duration_s=0.5, rate_hz=100, rng=rng)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"gait": "fly"}, "gait: 'fly' is not allowed; it must be one of walk, pace, trot"),
        ({"gait": "auto"}, "gait: 'auto' is not allowed; it must be one of walk, pace, trot"),
        ({"froude": -3}, "froude: -3 is not allowed; it must be a number from 0.05 to 10"),
        ({"froude": float("nan")}, "froude: nan is not allowed"),
        ({"froude": "fast"}, "froude: str is not allowed; give a number"),
        ({"gait": "walk", "froude": 3.0}, "froude: 3.0 is not allowed; it must be a number from 0.05 to 0.5 in a walk"),
    ],
)
def test_what_no_dog_does_is_refused_with_the_value_and_what_is_allowed(options, says):
    with pytest.raises(ConfigError) as caught:
        sample_dog(np.random.default_rng(1), **options)
    assert says in str(caught.value)


def test_streams_are_a_source_of_chance_as_for_the_models():
    dog = sample_dog(dg.rng(1))
    assert dog == sample_dog(dg.rng(1)) != sample_dog(dg.rng(2))
    quadruped_gait(**dog.parameters(), duration_s=0.5, rng=dg.rng(1))
