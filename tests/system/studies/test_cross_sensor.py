"""Plans, rows and tables of the study between sensors."""

import numpy as np
import pandas as pd
import pytest
from sklearn.metrics import balanced_accuracy_score, f1_score, roc_auc_score

C = 299_792_458.0
SENSORS = ("X4, 7.29 GHz", "24 GHz", "60 GHz", "77 GHz")


@pytest.fixture(scope="module")
def seen(study, tmp_path_factory):
    """Six targets as two radars see them."""
    return {name: study.examples(name, 3, 3, tmp_path_factory.mktemp("rows")) for name in SENSORS[:2]}


def test_plans_differ_in_the_radar_alone_and_see_the_same_velocities(study):
    plans = {name: study.plan_of(name, 3)[0] for name in SENSORS}
    carriers_hz = {name: study.radar_of(name).carrier_hz for name in SENSORS}
    for name, plan in plans.items():
        assert plan.radar["prf_hz"] * C / carriers_hz[name] / 4 == pytest.approx(8.0, abs=0.01)
        first = plans[SENSORS[0]].model_dump(exclude={"radar"})
        assert plan.model_dump(exclude={"radar"}) == first
        assert first["dataset"]["seed"] == 3
        assert "vary" not in plan.target
        assert not any([plan.environment, plan.impairments, plan.background])


def test_radars_see_the_same_targets_and_others_are_refused(study, seen):
    study.check_same(seen)
    one, other = seen.values()
    assert one["label"].tolist() == ["human", "dog"] * 3
    assert not np.allclose(one["extended_torso_share"], other["extended_torso_share"], equal_nan=True)
    label = {"human": "dog", "dog": "human"}
    changes = {"label": other["label"].map(label), "truth_ground_speed_mps": other["truth_ground_speed_mps"] + 0.1}
    for column, values in changes.items():
        with pytest.raises(ValueError, match=column):
            study.check_same({**seen, "changed": other.assign(**{column: values})})


def test_features_do_not_depend_on_the_carrier(study, seen):
    """In hertz the bandwidths of the same targets are as the carriers; as inputs they are not."""
    in_hz = [rows["extended_doppler_bandwidth_envelope_hz"].to_numpy() for rows in seen.values()]
    inputs = [study.features_of(rows) for rows in seen.values()]
    in_mps = [each["extended_doppler_bandwidth_envelope_mps"] for each in inputs]
    assert in_hz[1] / in_hz[0] == pytest.approx(in_mps[1] / in_mps[0] * 24 / 7.29, rel=1e-6, nan_ok=True)
    assert set(inputs[0]) == set(inputs[1])
    assert not [name for name in inputs[0] if name.endswith("bandwidth_hz") and "doppler" in name]


def test_targets_are_shared_out_in_pairs_once_each(study):
    parts = [pd.DataFrame({"number": np.arange(4000, 4024), "radar": radar}) for radar in "abc"]
    rows = study.shared_out(parts)
    assert sorted(rows["number"]) == list(range(4000, 4024))
    assert rows["radar"].value_counts().tolist() == [8, 8, 8]
    assert (rows.groupby(rows["number"] // 2)["radar"].nunique() == 1).all()


def test_scores_are_those_of_scikit_learn(study):
    rng = np.random.default_rng(0)
    rows = pd.DataFrame({"label": rng.choice(["human", "dog"], 60, p=[0.3, 0.7]), "p": rng.random(60)})
    person, called = rows["label"] == "human", rows["p"] > 0.5
    found = study.scores(rows)
    assert found["accuracy"] == pytest.approx(balanced_accuracy_score(person, called))
    assert found["f1"] == pytest.approx(f1_score(person, called, average="macro"))
    assert found["auc"] == pytest.approx(roc_auc_score(person, rows["p"]))


def test_one_ensemble_for_every_network(study, seen):
    pytest.importorskip("torch")
    rows = pd.concat([rows.assign(number=np.arange(n, n + 6)) for n, rows in zip((0, 6), seen.values(), strict=True)])
    models = study.train(rows, {"quick": study.Training(most_epochs=1)}, 0)
    given = seen["24 GHz"]
    found = models.of_person(given)
    assert list(found) == ["extended-logistic", "extended-boosting", "network, quick", "ensemble, quick"]
    assert models.models["ensemble, quick"][0].members == tuple(model for model, _ in list(models.models.values())[:3])
