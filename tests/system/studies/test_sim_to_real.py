"""The parts of the sim-to-real studies whose answers are known: movers, images, what is learnt from and what is not."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from scipy.stats import binomtest

SECONDS = 3.0


@pytest.fixture(scope="module")
def movers() -> ModuleType:
    return import_module("sim_to_real_movers")


@pytest.fixture(scope="module")
def images() -> ModuleType:
    return import_module("sim_to_real_xband_images")


@pytest.fixture(scope="module")
def models() -> ModuleType:
    return import_module("sim_to_real_models")


def walk(movers: ModuleType) -> Any:
    return movers.model_mover("human", 1.2, SECONDS, np.random.default_rng(1), varied=False).motion


def test_at_its_own_pace_a_motion_is_itself(movers: ModuleType) -> None:
    motion = walk(movers)
    same = movers.hurried(motion, SECONDS, np.ones_like)
    assert np.abs(same.position_m - motion.position_m[: same.time_s.size]).max() < 1e-9


def test_at_half_the_pace_it_goes_half_as_far(movers: ModuleType) -> None:
    motion = walk(movers)
    slow = movers.hurried(motion, SECONDS, lambda times_s: np.full_like(times_s, 0.5))
    whole, half = (one.position_m[450].mean(axis=0)[0] - one.position_m[0].mean(axis=0)[0] for one in (motion, slow))
    assert half / whole == pytest.approx(0.5, abs=0.05)
    frame = 300
    assert slow.position_m[frame] == pytest.approx(motion.position_m[frame // 2], abs=1e-9)


def test_large_animals_are_large_and_as_fast_as_asked(movers: ModuleType) -> None:
    for seed in range(3):
        found = movers.model_mover("dog", 1.1, SECONDS, np.random.default_rng(seed), large=True)
        assert 1.2 <= found.motion.facts.height_m <= 1.7
        assert movers.speed_of(found, SECONDS) == pytest.approx(1.1, rel=0.1)
        withers = found.motion.markers.index("withers")
        assert found.motion.position_m[:, withers, 2].mean() > 1.0


def test_speed_and_place_do_not_know_the_class(images: ModuleType) -> None:
    """The same numbers are drawn for an example whatever its class; the classes alternate."""
    assert [images.label_of(number) for number in range(4)] == ["human", "dog", "human", "dog"]
    for seed in range(5):
        assert images.draw_place(np.random.default_rng(seed)) == images.draw_place(np.random.default_rng(seed))


def tone(images: ModuleType, velocity_mps: float) -> np.ndarray:
    wavelength_m = 299_792_458.0 / 9.7e9
    sweeps_s = images.measures.PRI_S * np.arange(images.measures.N_SWEEPS)
    return np.exp(4j * np.pi * velocity_mps / wavelength_m * sweeps_s)


def test_noise_is_as_far_below_the_maximum_as_drawn(images: ModuleType) -> None:
    """The maximum that is shown holds some noise too: by up to the peak of 1e5 cells, a few tenths of a dB."""
    signal = tone(images, 1.2)
    for noise_db in (-34.0, -28.0):
        shown = images.levels_of(signal, 0 * signal, noise_db, images.Display(), 3)
        assert noise_db - 1.2 < images.measures.noise_db(shown) < noise_db + 0.1
    silent = images.levels_of(signal, 0 * signal, -28.0, images.Display(noise=False), 3)
    assert (silent[200:] == images.measures.FLOOR_DB).all()


def test_ground_and_clipping_can_be_left_out(images: ModuleType) -> None:
    signal, ground = tone(images, 1.2), 3.0 * tone(images, 0.1)
    rows = np.abs(images.measures.VELOCITY_MPS - 0.1) < 0.05
    seen = images.levels_of(signal, ground, -40.0, images.Display(), 3)
    bare = images.levels_of(signal, ground, -40.0, images.Display(ground=False), 3)
    assert seen[rows].max() == images.measures.CEILING_DB
    assert bare[rows].max() < -25.0
    whole = images.levels_of(signal, ground, -40.0, images.Display(clipped=False), 3)
    assert whole.max() == 0.0
    assert whole.min() < -50.0


def test_few_samples_and_slow_ground_change_no_echo(images: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    """72 samples a sweep against the radar's 1008, and ground at 100 sweeps/s against all 595: the same echoes."""
    quick = images.echoes_of(images.Plan(), 2)
    monkeypatch.setattr(images, "RADAR", images.twin.RADAR)
    monkeypatch.setattr(images, "GROUND_RADAR", images.twin.RADAR.model_copy(update={"sample_rate_hz": 50e3}))
    full = images.echoes_of(images.Plan(), 2)
    for name, least in (("mover", 0.99), ("ground", 0.99)):
        likeness = abs(np.vdot(quick[name], full[name])) / np.linalg.norm(quick[name]) / np.linalg.norm(full[name])
        assert likeness > least, name


def test_an_example_is_fixed_by_its_number(images: ModuleType) -> None:
    one, again, other = (images.echoes_of(images.Plan(), number) for number in (5, 5, 7))
    assert np.array_equal(one["mover"], again["mover"])
    assert not np.array_equal(one["mover"], other["mover"])


def some_inputs(models: ModuleType, count: int, *, prefix: str = "model-") -> Any:
    store = import_module("sim_to_real_inputs")
    rng = np.random.default_rng(4)
    labels = np.array(["human", "dog"] * (count // 2))
    columns = {name: rng.standard_normal(count) + (labels == "dog") for name in store.SIX}
    groups = np.array([f"{prefix}{number}" for number in range(count)])
    return store.Inputs(columns, np.empty(count, dtype=object), labels, groups, 0.03)


def test_a_fifth_of_the_movers_is_held_back(models: ModuleType) -> None:
    inputs = some_inputs(models, 60)
    held = models.held_rows(inputs)
    assert held.sum() == 12
    assert (inputs.labels[held] == "human").sum() == 6
    twice = inputs.take(np.random.default_rng(2).permutation(np.repeat(np.arange(60), 2)))
    rows = models.held_rows(twice)
    assert not set(twice.groups[rows]) & set(twice.groups[~rows])


def test_real_recordings_are_refused_as_teachers(models: ModuleType) -> None:
    kind = models.MODELS["six, logistic"]
    patch = import_module("sim_to_real_xband_images").PATCH
    assert models.train(kind, some_inputs(models, 40), patch).held_accuracy > 0.5
    with pytest.raises(ValueError, match="is a real recording"):
        models.train(kind, some_inputs(models, 40, prefix=models.REAL), patch)


def test_features_that_are_always_unknown_are_left_out(models: ModuleType) -> None:
    inputs = some_inputs(models, 40)
    inputs.columns["step_length_m"][:] = np.nan
    fitted = models.train(models.MODELS["six, boosting"], inputs, import_module("sim_to_real_xband_images").PATCH)
    assert "step_length_m" not in fitted.names
    assert fitted.of_person(inputs).shape == (40,)


@pytest.mark.parametrize(("hits", "count"), [(11, 11), (10, 11), (16, 21), (0, 2)])
def test_intervals_are_exact(models: ModuleType, hits: int, count: int) -> None:
    interval = binomtest(hits, count).proportion_ci(0.95, method="exact")
    assert str(models.Share(hits, count)) == (
        f"{hits}/{count} ({100 * interval.low:.0f} to {100 * interval.high:.0f} %)"
    )


def test_domains_that_are_one_are_not_told_apart(models: ModuleType) -> None:
    inputs = some_inputs(models, 400)
    rows = np.random.default_rng(1).permutation(400)
    assert models.domain_auc(inputs.take(rows[:300]), inputs.take(rows[300:]), features="six") == pytest.approx(
        0.5, abs=0.12
    )
    moved = inputs.take(rows[300:])
    moved.columns["step_length_m"][:] += 10.0
    assert models.domain_auc(inputs.take(rows[:300]), moved, features="six") > 0.99
