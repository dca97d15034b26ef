"""The parts of the sim-to-real studies whose answers are known: motions, images, training and held-out data."""

from importlib import import_module
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from scipy.spatial.distance import mahalanobis

from doppelgait.motion.retime import travel_speed_mps
from export_models import random_network

SECONDS = 3.0


@pytest.fixture(scope="module")
def motions() -> ModuleType:
    return import_module("sim_to_real_motions")


@pytest.fixture(scope="module")
def models() -> ModuleType:
    return import_module("sim_to_real_models")


def test_at_half_the_pace_it_goes_half_as_far(motions: ModuleType) -> None:
    motion = motions.make_model_motion("human", 1.2, SECONDS, np.random.default_rng(1))
    slow = motions.hurried(motion, SECONDS, lambda times_s: np.full_like(times_s, 0.5))
    whole, half = (one.position_m[450].mean(axis=0)[0] - one.position_m[0].mean(axis=0)[0] for one in (motion, slow))
    assert half / whole == pytest.approx(0.5, abs=0.05)
    frame = 300
    assert slow.position_m[frame] == pytest.approx(motion.position_m[frame // 2], abs=1e-9)


@pytest.mark.parametrize(("label", "speed_mps"), [("human", 1.2), ("dog", 1.2), ("large", 0.6), ("large", 1.1)])
def test_motions_are_as_fast_as_asked_and_long_enough(motions: ModuleType, label: str, speed_mps: float) -> None:
    for seed in range(3):
        found = motions.make_model_motion(label, speed_mps, SECONDS, np.random.default_rng(seed))
        assert travel_speed_mps(found, first_s=SECONDS) == pytest.approx(speed_mps, rel=0.2)  # it drifts
        assert found.duration_s >= SECONDS - 1.0 / motions.RATE_HZ
        assert (found.facts.height_m >= 1.2) == (label != "dog")


def test_speed_does_not_know_the_class(images: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: dict[str, list[float]] = {"human": [], "dog": [], "large": []}

    def record(label: str, speed_mps: float, seconds: float, rng: Any) -> Any:
        asked[label].append(speed_mps)
        raise StopIteration

    monkeypatch.setattr(images.motions, "make_model_motion", record)
    for label in asked:
        for number in range(20):
            with pytest.raises(StopIteration):
                images.draw_target(images.Plan(kinds=(label,)), number, np.random.default_rng(number))
    assert asked["human"] == asked["dog"] == asked["large"]


def tone(images: ModuleType, velocity_mps: float) -> np.ndarray:
    wavelength_m = 299_792_458.0 / 9.7e9
    sweeps_s = images.measures.PRI_S * np.arange(images.measures.N_SWEEPS)
    return np.exp(4j * np.pi * velocity_mps / wavelength_m * sweeps_s)


def test_noise_is_as_far_below_the_maximum_as_drawn(images: ModuleType) -> None:
    """The maximum that is shown holds some noise too: by up to the peak of 1e5 cells, a few tenths of a dB."""
    signal = tone(images, 1.2)
    for noise_db in (-34.0, -28.0):
        shown = images.levels_of(signal, 0 * signal, noise_db, 3)
        assert noise_db - 1.2 < images.measures.noise_db(shown) < noise_db + 0.1


def test_few_samples_and_slow_ground_change_no_echo(images: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    """72 samples a sweep against the radar's 1008, and ground at 100 sweeps/s against all 595: the same echoes."""
    quick = images.echoes_of(images.Plan(), 2)
    monkeypatch.setattr(images, "RADAR", images.FULL_RADAR)
    monkeypatch.setattr(images, "GROUND_RADAR", images.FULL_RADAR.model_copy(update={"sample_rate_hz": 50e3}))
    full = images.echoes_of(images.Plan(), 2)
    for name, least in (("mover", 0.99), ("ground", 0.99)):
        likeness = abs(np.vdot(quick[name], full[name])) / np.linalg.norm(quick[name]) / np.linalg.norm(full[name])
        assert likeness > least, name


def some_inputs(models: ModuleType, count: int, *, prefix: str = "model-") -> Any:
    store = import_module("sim_to_real_inputs")
    rng = np.random.default_rng(4)
    labels = np.array(["human", "dog"] * (count // 2))
    columns = {name: rng.standard_normal(count) + (labels == "dog") for name in store.SIX}
    groups = np.array([f"{prefix}{number}" for number in range(count)])
    return store.Inputs(columns, np.empty(count, dtype=object), labels, groups, 0.03)


def test_a_fifth_of_the_targets_is_held_back(models: ModuleType) -> None:
    inputs = some_inputs(models, 60)
    held = models.held_rows(inputs)
    assert held.sum() == 12
    assert (inputs.labels[held] == "human").sum() == 6
    twice = inputs.take(np.random.default_rng(2).permutation(np.repeat(np.arange(60), 2)))
    rows = models.held_rows(twice)
    assert not set(twice.groups[rows]) & set(twice.groups[~rows])


def trained(models: ModuleType, inputs: Any, classes: tuple[str, ...] = ("human", "dog")) -> Any:
    return models.train_all(inputs, import_module("sim_to_real_xband_images").PATCH, classes=classes, network=False)


def test_real_recordings_are_refused_as_teachers(models: ModuleType) -> None:
    assert trained(models, some_inputs(models, 40))["six, logistic"].held_accuracy > 0.5
    with pytest.raises(ValueError, match="is a real recording"):
        trained(models, some_inputs(models, 40, prefix=models.REAL))


def test_distance_is_that_of_mahalanobis(models: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(models, "SHRINKAGE", 0.0)
    rng = np.random.default_rng(2)
    columns = rng.standard_normal((300, 3)) @ rng.standard_normal((3, 3))
    labels = np.repeat([0, 1], 150)
    columns[labels == 1] += 4.0
    rest = np.concatenate([columns[labels == n] - columns[labels == n].mean(axis=0) for n in (0, 1)])
    inverse = np.linalg.inv(np.cov(rest.T, bias=True))
    asked = rng.standard_normal((20, 3)) * 5
    wanted = [min(mahalanobis(x, columns[labels == n].mean(axis=0), inverse) ** 2 for n in (0, 1)) for x in asked]
    assert models.class_distance(columns, labels)(asked) == pytest.approx(wanted)


def test_novelty_is_calibrated_on_held_rows(models: ModuleType) -> None:
    """Of fresh rows of the same law one in twenty is beyond the threshold; rows that are far away are."""
    inputs = some_inputs(models, 4000)
    rows = np.arange(4000)
    learn, held, fresh = (inputs.take(rows[part]) for part in (slice(1000), slice(1000, 2000), slice(2000, None)))
    judge = models.novelty_of(trained(models, learn), learn, held)
    threshold = np.quantile(judge(held), 0.95)
    assert (judge(fresh) > threshold).mean() == pytest.approx(0.05, abs=0.02)
    fresh.columns["step_length_m"][:] += 20.0
    assert (judge(fresh) > threshold).all()


def test_the_last_layer_gives_the_scores(models: ModuleType) -> None:
    """By the network's own weights, the last layer makes its log-odds."""
    patch = import_module("sim_to_real_xband_images").PATCH
    rng = np.random.default_rng(5)
    network = random_network(rng, 2, patch, (4, 6, 6, 5))
    weight, bias = network.arrays["weight"], network.arrays["bias"]
    levels = np.empty(3, dtype=object)
    levels[:] = [rng.random((64, 48 + 10 * n), dtype=np.float32) for n in range(3)]
    scores = models.last_layer(network, levels) @ weight.T + bias
    found = np.diff(network.log_probability(levels))[:, 0]
    assert found == pytest.approx(np.diff(scores)[:, 0], rel=1e-3)


def test_rules_abstain_as_they_are_named() -> None:
    study = import_module("sim_to_real_xband")
    held = np.column_stack([np.linspace(0, 1, 101), 1 - np.linspace(0, 1, 101), np.arange(101.0)])
    real = np.array([[0.97, 0.03, 3.0], [0.9, 0.1, 99.0], [0.7, 0.3, 3.0], [0.1, 0.9, 3.0]])
    scored = study.Scored({}, {}, {"held": held, "real": real}, np.ones(101, dtype=int))
    found = {rule: scored.decide("real", rule).tolist() for rule in study.RULES}
    away = study.ABSTAINED
    assert list(found.values()) == [[0, 0, 0, 1], [0, 0, away, 1], [0, away, 0, 1], [0, away, away, 1]]


def test_domains_that_are_one_are_not_told_apart(models: ModuleType) -> None:
    inputs = some_inputs(models, 400)
    rows = np.random.default_rng(1).permutation(400)
    assert models.domain_auc(inputs.take(rows[:300]), inputs.take(rows[300:]), features="six") == pytest.approx(
        0.5, abs=0.12
    )
    moved = inputs.take(rows[300:])
    moved.columns["step_length_m"][:] += 10.0
    assert models.domain_auc(inputs.take(rows[:300]), moved, features="six") > 0.99
