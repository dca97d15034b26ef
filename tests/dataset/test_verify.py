"""Parts of the verification on tables made by hand."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.stats import pearsonr
from sklearn.metrics import balanced_accuracy_score

from doppelgait.dataset.verify import integrity, leakage, truth
from doppelgait.dataset.verify.contents import Contents
from doppelgait.dataset.verify.integrity import check_groups
from doppelgait.dataset.verify.leakage import round_values
from doppelgait.dataset.verify.truth import check_visible_targets


def contents(index, **description):
    described = {"fields": {}, "classes": {}, "config": {}, **description}
    return Contents(Path("nowhere"), described, pd.DataFrame(index))


def walkers(n=40, **changes):
    speed = np.linspace(0.5, 2.0, n)
    table = {
        "label": ["human", "dog"] * (n // 2),
        "truth_radial_velocity_mps": speed,
        "feature_torso_velocity_mps": speed + 0.02,
        "truth_gait_frequency_hz": 1.0 + speed,
        "gait_frequency_hz": 1.01 * (1.0 + speed),
        "quality_snr_mu_db": np.full(n, 15.0),
        "quality_flags": [""] * n,
        "source": ["model"] * n,
    }
    return pd.DataFrame({**table, **changes})


def test_honest_features_pass_and_their_rms_is_right():
    found = truth.check_velocity(contents(walkers()))
    assert found.status == "passed"
    assert found.numbers["dog"]["rms"] == pytest.approx(0.02)
    assert found.numbers["dog"] == {"rows": 20, "share_inside": 1.0, "rms": pytest.approx(0.02)}
    assert truth.check_gait_frequency(contents(walkers())).status == "passed"


def test_single_wrong_estimates_do_not_fail_a_class():
    table = walkers()
    table.loc[:7, "gait_frequency_hz"] *= 2
    assert truth.check_gait_frequency(contents(table)).status == "passed"
    table["gait_frequency_hz"] *= 0.5
    assert truth.check_gait_frequency(contents(table)).status == "failed"


def test_flagged_and_noisy_gait_frequencies_are_not_judged():
    table = walkers(gait_frequency_hz=np.full(40, 9.0), quality_flags=["x;low_confidence"] * 40)
    assert truth.check_gait_frequency(contents(table)).status == "not applicable"
    noisy = contents(table.assign(quality_flags="", quality_snr_mu_db=9.9))
    assert truth.check_gait_frequency(noisy).status == "not applicable"
    assert truth.check_gait_frequency(contents(table.assign(quality_flags=""))).status == "failed"


@pytest.mark.parametrize(("hits", "rows", "off"), [(0, 6, False), (0, 7, True), (20, 40, False), (15, 40, True)])
def test_off_as_a_whole_is_the_binomial_tail_below_a_thousandth(hits, rows, off):
    from math import comb

    tail = sum(comb(rows, k) * (2 / 3) ** k * (1 / 3) ** (rows - k) for k in range(hits + 1))
    assert (tail < 1e-3) == off
    assert truth.has_too_few_hits(hits, rows) == off


def test_an_empty_class_may_be_noise_and_one_with_a_target_is_a_warning():
    untracked = walkers(quality_snr_mu_db=np.full(40, np.nan))
    assert check_visible_targets(contents(untracked)).status == "failed"
    table = walkers()
    table.loc[table["label"] == "dog", ["source", "quality_snr_mu_db"]] = ["none", -2.0]
    assert check_visible_targets(contents(table)).status == "passed"
    table["quality_snr_mu_db"] = 15.0
    found = check_visible_targets(contents(table))
    assert found.status == "warning"
    assert "dog is an empty scene, but something moves in 100 %" in found.summary
    table["feature_torso_velocity_mps"] = 0.0  # a wall, not a target
    assert check_visible_targets(contents(table)).status == "passed"


def people(**changes):
    table = {
        "scene_id": ["a", "b", "c", "d"],
        "subject": ["person/1", "person/2", "person/3", "person/4"],
        "group": ["person/1", "person/2", "person/3", "person/4"],
        "recording": ["1.bvh", "2.bvh", "3.bvh", "4.bvh"],
        "split": ["train", "train", "test", "test"],
        "source": ["recording"] * 4,
        "motion": ["{}"] * 4,
    }
    return pd.DataFrame({**table, **changes})


@pytest.mark.parametrize("key", ["subject", "group", "recording", "scene_id"])
def test_whoever_is_in_two_splits_is_named(key):
    table = people()
    table.loc[2, key] = table.loc[0, key]
    found = check_groups(contents(table))
    assert found.status == "failed"
    assert f"{table.loc[0, key]} (test, train)" in found.summary


@pytest.mark.parametrize(
    ("key", "found_name"), [("subject", "person/3 (test, train)"), ("recording", "3.bvh (test, train)")]
)
def test_a_part_of_a_blended_motion_in_two_splits_is_named(key, found_name):
    table = people(others="")
    blended = {
        "subject": {"others": '["person/3"]'},
        "recording": {
            "recording": "1.bvh + 3.bvh",
            "motion": '{"kind":"file","path":"1.bvh","hybrid":{"other":{"kind":"file","path":"3.bvh"}}}',
        },
    }[key]
    table.loc[0, list(blended)] = list(blended.values())
    found = check_groups(contents(table))
    assert found.status == "failed"
    assert found.numbers["in_two_splits"] == {key: [found_name]}


def test_model_walkers_with_the_same_parameters_in_two_splits_are_a_warning():
    found = check_groups(contents(people(source="model", recording="", motion=["x", "y", "x", "z"])))
    assert found.status == "warning"
    assert found.numbers["same_walkers"] == 2


def test_a_picture_ignores_level_and_tells_shapes_apart():
    rng = np.random.default_rng(0)
    power = rng.exponential(size=(200, 130))
    power[:, 60:64] += 500 * (1 + np.sin(np.arange(200) / 9))[:, None]
    one = integrity.make_picture(power)
    assert one @ one == pytest.approx(1, abs=1e-5)
    assert one @ integrity.make_picture(7.0 * power) == pytest.approx(1, abs=1e-5)
    other = power.copy()
    other[:, 60:64] = rng.exponential(size=(200, 4))
    assert one @ integrity.make_picture(other) < 0.5
    assert integrity.make_picture(np.zeros((3, 5))) @ one == 0


def test_averages_are_those_of_the_parts():
    values = np.arange(20.0).reshape(10, 2)
    expected = [part.mean(axis=0) for part in np.array_split(values, 5)]
    assert np.allclose(integrity._average(values, 5), expected)
    assert np.allclose(integrity._average(values[:2], 4)[:, 0], [0, 0, 2, 2])


def test_the_search_finds_the_nearest_of_a_brute_force(monkeypatch):
    monkeypatch.setattr(integrity, "CANDIDATE", -1.0)
    rng = np.random.default_rng(1)
    pictures = {n: integrity._scale_to_unit(rng.normal(size=12)) for n in range(60)}
    rows, others = np.arange(40, 60), np.arange(40)
    found = {second: (value, first) for value, first, second in integrity._find_nearest(rows, others, pictures)}
    for row in rows:
        likeness = [pearsonr(pictures[int(row)], pictures[int(n)])[0] for n in others]
        assert found[row][1] == int(np.argmax(likeness))
        assert found[row][0] == pytest.approx(max(likeness), abs=1e-5)


def test_equal_features_in_two_splits_are_found_where_no_signature_is_kept():
    rng = np.random.default_rng(2)
    names = [f"feature_{name}" for name in integrity.FEATURE_UNITS]
    table = pd.DataFrame(rng.normal(size=(6, 6)), columns=names)
    table["split"], table["id"], table["source"] = ["train"] * 3 + ["test"] * 3, list("abcdef"), "model"
    assert integrity.check_duplicates(contents(table)).status == "passed"
    table.loc[1, names] = table.loc[0, names]  # both in train: no leak
    assert integrity.check_duplicates(contents(table)).status == "passed"
    table.loc[4, names] = table.loc[0, names]
    found = integrity.check_duplicates(contents(table))
    assert found.status == "failed"
    assert "a (train) and e (test) identical" in found.summary


def parameters(n, *, leak=0.0, seed=0, per_group=1):
    rng = np.random.default_rng(seed)
    label = rng.integers(0, 2, n // per_group).repeat(per_group)
    table = pd.DataFrame({"a": rng.normal(size=n) + leak * label, "b": rng.normal(size=n)})
    table["c"] = rng.choice(["wall", "door"], n)
    groups = np.arange(n // per_group).repeat(per_group)
    return table.assign(label=np.where(label, "dog", "human"), group=[f"g{n}" for n in groups])


def test_parameters_that_know_no_class_are_at_chance():
    found = [leakage.guess_classes(parameters(80, seed=n), np.random.default_rng(n)) for n in range(6)]
    assert not any(guess.leaks for guess in found)
    assert np.mean([guess.accuracy for guess in found]) == pytest.approx(0.5, abs=0.07)


def test_a_telling_parameter_is_found_and_named():
    found = leakage.guess_classes(parameters(160, leak=3.0), np.random.default_rng(0))
    assert found.leaks
    assert found.accuracy > 0.85
    assert found.telling[0][0] == "a"
    assert found.telling[0][1] > 0.85 > 0.7 > found.telling[1][1]


def test_rows_of_one_group_are_one_observation(monkeypatch):
    """Each group has values of its own: rows of a group in two folds would give its class away."""
    monkeypatch.setattr(leakage, "MAX_PERMUTATIONS", leakage.PERMUTATIONS)  # the accuracy is looked at
    together, apart = [], []
    for seed in range(6):
        values = np.random.default_rng(seed).normal(size=(2, 20)).repeat(6, axis=1)
        table = parameters(120, per_group=6, seed=seed).assign(a=values[0], b=values[1])
        together.append(leakage.guess_classes(table, np.random.default_rng(seed)).accuracy)
        split_up = table.assign(group=[f"g{n}" for n in range(len(table))])
        apart.append(leakage.guess_classes(split_up, np.random.default_rng(seed)).accuracy)
    assert np.mean(together) < 0.58
    assert np.mean(apart) > 0.7


def test_too_few_groups_are_not_judged():
    found = leakage.guess_classes(parameters(16, per_group=4), np.random.default_rng(0))
    assert "5 are needed" in found.reason
    assert not found.leaks
    assert found.as_dict()["accuracy"] is None


def test_permutations_keep_groups_together_and_counts():
    rng = np.random.default_rng(0)
    groups = np.array([0, 0, 1, 2, 2, 2, 3, 3])
    labels = np.array([0, 0, 1, 1, 1, 1, 0, 1])  # the last group has both
    seen = set()
    for _ in range(200):
        permuted = leakage.permute_labels(labels, groups, rng)
        pure = [permuted[groups == n] for n in range(3)]
        assert all(len(set(part)) == 1 for part in pure)
        assert sorted(part[0] for part in pure) == [0, 1, 1]
        assert sorted(permuted[6:]) == [0, 1]
        seen.add(tuple(permuted))
    assert len(seen) == 6


def test_balanced_accuracy_is_that_of_scikit_learn():
    rng = np.random.default_rng(0)
    labels, guesses = rng.integers(0, 3, (50, 4)), rng.integers(0, 3, (50, 4))
    labels[:, 3] = rng.integers(0, 2, 50)  # the third class does not occur
    guesses[:, 3] = rng.integers(0, 2, 50)
    expected = [balanced_accuracy_score(labels[:, n], guesses[:, n]) for n in range(4)]
    assert leakage.balanced_accuracy(labels, guesses, 3) == pytest.approx(expected)


def test_many_columns_of_labels_are_scored_as_each_alone():
    table = parameters(60, leak=1.0)
    cells = leakage.make_cells([table[name] for name in "abc"])
    rng = np.random.default_rng(0)
    folds, labels = rng.integers(0, 5, 60), rng.integers(0, 2, (60, 7))
    together = leakage.score_folds(cells, folds, labels)
    assert together == pytest.approx([leakage.score_folds(cells, folds, labels[:, [n]])[0] for n in range(7)])


def test_likelihoods_of_one_parameter_are_those_counted_by_hand():
    column = pd.Series(["x"] * 6 + ["y"] * 4 + ["x", "y"])
    labels = np.array([0, 0, 0, 0, 0, 1, 1, 1, 1, 0])
    test = np.array([False] * 10 + [True] * 2)
    levels = leakage._compute_log_ratios(leakage.make_cells([column]), test, labels[:, None], 2)[:, :, 0]
    in_x, in_y = np.array([5, 1]), np.array([1, 3])  # of class 0, of class 1
    n, share = np.array([6, 4]), np.array([0.6, 0.4])
    ratio_x = np.log((in_x + 2 * share[0]) / (n + 2) / share[0])
    ratio_y = np.log((in_y + 2 * share[1]) / (n + 2) / share[1])
    g = 2 * (in_x @ ratio_x + in_y @ ratio_y)
    weight = max(0.0, 1 - 2 / g)
    assert weight > 0
    assert levels[:, 0] == pytest.approx(weight * ratio_x, abs=1e-4)
    assert levels[:, 1] == pytest.approx(weight * ratio_y, abs=1e-4)


def test_two_parameters_that_tell_only_together_are_found():
    rng = np.random.default_rng(0)
    table = parameters(200).assign(a=rng.normal(size=200))
    table["b"] = np.where((table["label"] == "dog") == (table["a"] > 0), 1.0, -1.0) * rng.uniform(size=200)
    found = leakage.guess_classes(table, np.random.default_rng(1))
    assert found.leaks
    assert max(value for _, value in found.telling) < 0.65


def test_bins_are_quantiles_and_missing_values_have_their_own():
    column = pd.Series([*np.arange(99.0), np.nan])
    codes = leakage.bin_values(column, 3)
    assert np.bincount(codes).tolist() == [1, 33, 33, 33]
    assert leakage.bin_values(pd.Series(["b", None, "a", "b"]), 3).tolist() == [2, 0, 1, 2]
    assert leakage.bin_values(pd.Series([5.0, 5.0, 7.0]), 6).tolist() == [1, 1, 2]


@pytest.mark.release
def test_chance_is_called_chance_as_often_as_it_should(monkeypatch):
    """P-values of tables without a leak are uniform or, for ties, larger."""
    monkeypatch.setattr(leakage, "PERMUTATIONS", 49)
    monkeypatch.setattr(leakage, "MAX_PERMUTATIONS", 49)
    p = np.array([leakage.guess_classes(parameters(50, seed=n), np.random.default_rng(n)).p_value for n in range(200)])
    assert np.mean(p <= 0.1) < 0.17  # 0.1 + 3.3 standard deviations
    assert np.mean(p <= 0.5) < 0.62
    assert np.mean(p <= 0.5) > 0.2


def test_rounding_of_a_level_tells_no_class():
    values = pd.Series([0.5, 0.5 * (1 + 1e-7), -1234567.0, 0.0, np.nan, 1e-30])
    found = round_values(values)
    assert found[0] == found[1]
    assert found[2] == pytest.approx(-1234600.0, rel=1e-12)
    assert found[3] == 0
    assert np.isnan(found[4])
    assert found[5] == pytest.approx(1e-30, rel=1e-12)
    assert round_values(pd.Series([0.5, 0.5001])).nunique() == 2
