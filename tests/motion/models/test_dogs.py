"""Sampled dogs: spreads, and that the model accepts them."""

import numpy as np
import pytest

from doppelgait.motion.models import quadruped_gait, sample_dog
from doppelgait.motion.models.dogs import DOG_BUILDS, GAIT_SHARES
from doppelgait.motion.models.quadruped_gaits import GAITS


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
    assert min(dog.withers_m for dog in dogs) == 0.2
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
