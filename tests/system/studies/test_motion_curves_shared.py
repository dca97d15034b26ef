"""Studies of recorded targets against the models: curves, halves, table."""

import numpy as np
import pandas as pd
import pytest

from doppelgait.motion.models import human_gait
from doppelgait.motion.models.curves import load_tables, make_measured_curve
from doppelgait.motion.models.strides import sample_autoregressive


@pytest.fixture
def mocap(shared):
    return shared / "data" / "mocap"


def test_a_model_read_as_a_recording_gives_its_own_curves():
    from motion_curves import fit_tables
    from recorded_motion import measure_cycle

    walks = [human_gait(gait="walk", speed_mps=speed, duration_s=6.0) for speed in (0.8, 1.1, 1.4, 1.6)]
    cycles = [measure_cycle(walk) for walk in walks]
    for walk, cycle in zip(walks, cycles, strict=True):
        assert cycle.stride_s == pytest.approx(1 / walk.facts.stride_frequency_hz, rel=0.002)
        assert cycle.leg_m == pytest.approx(0.491 * 1.75, rel=1e-3)
    tables = fit_tables(cycles)
    middle = np.mean([cycle.dimensionless_speed for cycle in cycles])
    for name in ("pelvis_speed", "neck_speed"):
        mean, _ = tables[name]
        own = make_measured_curve("walk", name, middle)(np.arange(10) / 20)
        shift = min(
            np.abs(np.roll(own, step) - mean).max() for step in (0, 1)
        )  # the ankle passes 0.75 V a little later
        assert shift < 0.05


def test_steps_of_a_model_are_measured_as_they_were_asked_for():
    from step_variation import clean_deviations, correct_correlation, lag_one, lognormal_sd, measure_steps

    rng = np.random.default_rng(2)
    walk = human_gait(
        speed_mps=1.3, duration_s=90, rate_hz=120, step_time_sd=0.025, step_length_sd=0.014, time_asymmetry=0.04,
        length_asymmetry=0.08, rng=rng,
    )  # fmt: skip
    steps = measure_steps(walk)
    free = np.array([steps.left.size - 2.0])
    for values, sd, asymmetry in ((steps.time, 0.025, 0.04), (steps.length, 0.014, 0.08)):
        deviation, sides = clean_deviations(values, steps.left)
        variance = np.array([deviation[0] @ deviation[1]]) / free
        assert np.sqrt(variance[0]) == pytest.approx(sd, rel=0.25)
        np.testing.assert_allclose(sides, asymmetry, atol=0.008)
    # people with 4 steps each whose deviations differ by 0.5: chance alone makes logarithms of variances scatter
    sds = 0.02 * np.exp(0.5 * rng.standard_normal(4000))
    clips = [clean_deviations(sd * rng.standard_normal((1, 6)), np.arange(6) % 2 == 0)[0][0] for sd in sds]
    middle, spread = lognormal_sd(np.array([clip @ clip for clip in clips]) / 4, np.full(4000, 4.0))
    assert (middle, spread) == (pytest.approx(0.02, rel=0.05), pytest.approx(0.5, rel=0.1))
    left, shown = np.arange(6) % 2 == 0, []
    for _ in range(2000):
        values = sample_autoregressive(200, rng, 0.6)[-6:]
        shown.append(lag_one(clean_deviations(values[None], left)[0][0]))
    assert np.mean(shown) < 0.45, "six steps look less alike than they are"
    assert correct_correlation(np.array([np.mean(shown)]), [6] * 30)[0] == pytest.approx(0.6, abs=0.15)


@pytest.mark.shared
def test_halves_split_people_and_not_clips(mocap):
    from recorded_motion import find_clips, is_tuning

    halves = {}
    for clip in find_clips(mocap):
        if clip.file.startswith("clinic/"):
            halves.setdefault(clip.file.split("/")[1].split("_")[0], set()).add(is_tuning(clip, mocap))
    assert len(halves) == 23
    assert all(len(half) == 1 for half in halves.values())


@pytest.mark.shared
def test_the_tables_of_the_model_are_those_of_the_tuning_half(mocap):
    from motion_curves import fit_tables, is_tuning
    from recorded_motion import find_clips, measure_cycle

    from doppelgait.core.errors import DoppelgaitError

    cycles = []
    for clip in find_clips(mocap):
        if clip.gait == "run" and is_tuning(clip, mocap):
            try:
                cycles.append(measure_cycle(clip.read(mocap)))
            except DoppelgaitError:
                continue
    found = fit_tables([cycle for cycle in cycles if cycle is not None])
    for name, table in load_tables()["people"]["run"].items():
        stored = np.array(table["mean"])
        assert np.abs(found[name][0] - stored).max() <= 0.03 * np.abs(stored).max()


def test_the_table_gives_differences_in_pooled_and_in_recorded_standard_deviations():
    from motion_comparison import FEATURES, summarise

    rng = np.random.default_rng(1)
    rows = [
        {"mover": "walk", "half": "held", "source": source, **{name: rng.normal(mean, sd) for name in FEATURES}}
        for source, mean, sd in (("recorded", 2.0, 0.5), ("model", 1.0, 1.0))
        for _ in range(4000)
    ]
    table = summarise(pd.DataFrame(rows))
    assert set(table["feature"]) == set(FEATURES)
    np.testing.assert_allclose(table["difference_recorded_sd"], 2.0, atol=0.1)
    np.testing.assert_allclose(table["difference_sd"], 1 / np.sqrt(0.625), atol=0.1)


def test_clips_whose_gait_frequency_is_read_wrongly_are_found_by_the_targets_own():
    from motion_comparison import is_misread

    rows = pd.DataFrame({"gait_frequency_hz": [2.0, 1.0, 2.6, np.nan, 1.0], "own_frequency_hz": [2.1, 2, 2, 2, np.nan]})
    assert is_misread(rows).tolist() == [False, True, True, False, False]


@pytest.mark.shared
@pytest.mark.filterwarnings("ignore:.*each other's side")  # one file: head-on it makes no difference
def test_the_horse_is_compared_with_a_model_of_the_same_marked_points(mocap):
    from motion_comparison import compare_horse

    rows = pd.DataFrame(compare_horse(mocap))
    assert rows.groupby(["mover", "source"]).size().min() >= 6
    assert (rows["gait_frequency_hz"] / rows["own_frequency_hz"] - 1).abs().max() < 0.05
    means = rows.groupby(["mover", "source"])["bandwidth"].mean()
    for target in ("horse walk", "horse trot"):
        assert means[target, "model"] == pytest.approx(means[target, "recorded"], rel=0.15)
