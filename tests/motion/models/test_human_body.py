"""Sampled people and dogs: spreads, and that the models accept them."""

from collections import Counter

import numpy as np
import pytest

import doppelgait as dg
from doppelgait.core.errors import ConfigError
from doppelgait.motion.models import human_gait, quadruped_gait, sample_dog, sample_person
from doppelgait.motion.models.quadruped_gaits import BUILDS, DOG_BUILDS, GAIT_SHARES, GAITS


def test_people_are_drawn_as_cited():
    rng = np.random.default_rng(3)
    adults = [sample_person(rng) for _ in range(4000)]
    for sex, mean, sd in (("male", 1.75, 0.07), ("female", 1.62, 0.065)):
        heights = np.array([p.height_m for p in adults if p.sex == sex])
        assert (heights.mean(), heights.std()) == (pytest.approx(mean, abs=0.006), pytest.approx(sd, abs=0.004))
    speeds = np.array([p.speed_mps for p in adults])
    assert (speeds.mean(), speeds.std()) == (pytest.approx(1.35, abs=0.01), pytest.approx(0.18, abs=0.01))
    seniors = [sample_person(rng, age_class="senior") for _ in range(2000)]
    assert np.mean([p.speed_mps for p in seniors]) == pytest.approx(1.15, abs=0.02)
    children = [sample_person(rng, age_class="child") for _ in range(2000)]
    six = [p.height_m for p in children if 5.5 < p.age_years < 6.5]
    assert np.mean(six) == pytest.approx(1.13, abs=0.02)
    assert min(p.height_m for p in children) >= 0.9
    for key, mean, sd in (("trunk_ripple", 0.0, 0.2), ("arm_swing", 0.0, 0.4), ("walk_ratio", 0.0, 0.16)):
        logs = np.log([getattr(p, key) for p in adults])
        assert (np.median(logs), logs.std()) == (pytest.approx(mean, abs=0.02), pytest.approx(sd, rel=0.06))
    for key, mean, sd in (
        ("swing_peak", 1.0, 0.24), ("time_asymmetry", 0.0, 0.02), ("length_asymmetry", 0.0, 0.06),
        ("arm_asymmetry", 0.15, 0.28), ("trunk_asymmetry", 0.0, 0.4),
    ):  # fmt: skip
        values = [getattr(p, key) for p in adults]
        assert (np.mean(values), np.std(values)) == (pytest.approx(mean, abs=0.1 * sd), pytest.approx(sd, rel=0.06))
    for key, middle, sd in (("step_time_sd", 0.025, 0.3), ("step_length_sd", 0.014, 0.7), ("pace_sd", 0.035, 0.5)):
        logs = np.log([getattr(p, key) for p in adults])
        assert (np.median(logs), logs.std()) == (pytest.approx(np.log(middle), abs=0.05), pytest.approx(sd, rel=0.08))
    for person in [*adults[:25], *seniors[:25], *children[:25]]:
        motion = human_gait(**person.parameters(), duration_s=0.5, rng=rng)
        assert np.isfinite(motion.position_m).all()
        assert motion.facts.mass_kg == person.mass_kg


def test_complaints_and_loads_change_a_person_as_measured():
    def people(**options):
        return [sample_person(np.random.default_rng(n), **options) for n in range(600)]

    well, weak, joint, nerves = (people(complaint=name) for name in ("none", "weak", "joint", "neurological"))
    median = lambda key, found: np.median([getattr(p, key) for p in found])  # noqa: E731
    assert median("walk_ratio", weak) == pytest.approx(0.73, abs=0.02)
    for found, speed_mps, time_sd in ((weak, 0.91, 0.041), (joint, 0.81, 0.034), (nerves, 0.82, 0.046)):
        assert median("speed_mps", found) == pytest.approx(speed_mps, abs=0.03)
        assert median("step_time_sd", found) == pytest.approx(time_sd, rel=0.08)
    assert np.std([p.time_asymmetry for p in joint]) > 4 * np.std([p.time_asymmetry for p in well])
    hands = {load: {(p.left_hand, p.right_hand) for p in people(load=load)} for load in ("pockets", "phone", "pushing")}
    assert hands == {
        "pockets": {("pockets", "pockets")}, "phone": {("phone", "free"), ("free", "phone")},
        "pushing": {("pushing", "pushing")},
    }  # fmt: skip


@pytest.mark.parametrize("age", ["adult", "senior", "child"])
@pytest.mark.parametrize("complaint", ["none", "weak", "joint", "neurological"])
@pytest.mark.parametrize("load", ["free", "bag", "phone", "pushing"])
def test_every_person_can_walk(age, complaint, load):
    rng = np.random.default_rng(5)
    person = sample_person(rng, age_class=age, complaint=complaint, load=load)
    motion = human_gait(**person.parameters(), duration_s=1.0, rng=rng)
    names = ("left_hand", "head", "left_shoulder")
    hand, ear, shoulder = (motion.position_m[:, motion.markers.index(name)] for name in names)
    if person.left_hand == "phone":
        assert np.linalg.norm(hand - ear, axis=1).max() < 0.2 * person.height_m
    if load == "pushing":
        assert np.ptp((hand - shoulder)[:, 0]) < 0.08 * person.height_m


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
    ("sample", "options", "says"),
    [
        (sample_person, {"complaint": "limp"}, "complaint: 'limp' is not allowed; it must be one of none, weak, joint"),
        (sample_person, {"age_class": "baby"}, "age_class: 'baby' is not allowed; it must be one of child, adult"),
        (sample_person, {"load": "crutch"}, "load: 'crutch' is not allowed; it must be one of free, pockets, bag"),
        (sample_person, {"load": ["bag"]}, "load: ['bag'] is not allowed"),
        (sample_dog, {"gait": "fly"}, "gait: 'fly' is not allowed; it must be one of walk, pace, trot"),
        (sample_dog, {"gait": "auto"}, "gait: 'auto' is not allowed; it must be one of walk, pace, trot"),
        (sample_dog, {"froude": -3}, "froude: -3 is not allowed; it must be a number from 0.025 to 10"),
        (sample_dog, {"froude": float("nan")}, "froude: nan is not allowed"),
        (sample_dog, {"froude": "fast"}, "froude: str is not allowed; give a number"),
        (
            sample_dog,
            {"gait": "walk", "froude": 3.0},
            "froude: 3.0 is not allowed; it must be a number from 0.025 to 0.5 in",
        ),
    ],
)
def test_what_nobody_is_or_does_is_refused_with_what_is_allowed(sample, options, says):
    with pytest.raises(ConfigError) as caught:
        sample(np.random.default_rng(1), **options)
    assert says in str(caught.value)


@pytest.mark.parametrize(("sample", "make"), [(sample_person, human_gait), (sample_dog, quadruped_gait)])
def test_a_seed_decides_and_streams_are_a_source_of_chance_too(sample, make):
    for source in (dg.rng, np.random.default_rng):
        own = sample(source(1))
        assert own == sample(source(1)) != sample(source(2))
        height_m = own.height_m if sample is sample_person else own.withers_m
        assert make(**own.parameters(), duration_s=0.5, rng=source(1)).facts.height_m == height_m
    slow = sample_dog(np.random.default_rng(9), gait="walk", froude=0.15)
    assert (slow.gait, slow.froude, slow.build) == ("walk", 0.15, sample_dog(np.random.default_rng(9)).build)
    low, high, _ = GAITS["canter"].froude
    assert all(low < sample_dog(np.random.default_rng(n), gait="canter").froude < high for n in range(50))
    assert "froude" not in slow.parameters(speed_mps=0.8, withers_m=0.5)
