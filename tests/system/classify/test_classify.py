"""Models trained, scored, kept and used on small made-up datasets: who may see what, and what is refused."""

import json
import re
from dataclasses import replace
from unittest.mock import ANY

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from sklearn.ensemble import HistGradientBoostingClassifier
from sklearn.impute import SimpleImputer
from sklearn.linear_model import LogisticRegression
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer, StandardScaler
from threadpoolctl import threadpool_limits

from doppelgait.classify.data import ENVELOPE, ENVELOPE_WIDTH, collect_inputs, collect_rows
from doppelgait.classify.decide import TargetInputs, classify, decide
from doppelgait.classify.evaluation import Options, choose_folds, evaluate, hold_back
from doppelgait.classify.learned import LabelledRows
from doppelgait.classify.model import row_weights
from doppelgait.classify.model_file import load_model, save_model
from doppelgait.classify.report import ADAPTATION_TEXT, UNKNOWN_TEXT, list_sections, make_figures, write_report
from doppelgait.classify.training import BOOSTING, Kind, fit
from doppelgait.core.errors import AnalysisError, ConfigError, DatasetError, DoppelgaitWarning
from doppelgait.dataset.open import Dataset
from doppelgait.features import FEATURE_UNITS
from doppelgait.pipeline import analyze, parse_run, run_simulation, write_results
from doppelgait.processing import Analysis
from export_models import a_signature

SIX = tuple(FEATURE_UNITS)
C = 299_792_458.0
FEATURE_MODELS = ["six-logistic", "six-boosting"]


def made_up(
    n=240, *, seed=0, classes=("human", "dog"), apart=4.0, per_target=2, split=(0.6, 0.2), identity="a", **columns
):
    """A dataset of an index alone: the step length tells the classes, nothing else does, a tenth of it is unknown."""
    rng = np.random.default_rng(seed)
    bodies = rng.permutation(n // per_target)
    labels = np.repeat(np.array(classes)[np.arange(n // per_target) % len(classes)], per_target)
    share = np.repeat(bodies / (n // per_target), per_target)
    index = pd.DataFrame({
        "id": [f"e{k}" for k in range(n)],
        "scene_id": [f"e{k}" for k in range(n)],
        "label": labels,
        "split": np.where(share < split[0], "train", np.where(share < sum(split), "validation", "test")),
        "group": np.repeat([f"recording/{identity}-{k}" for k in range(n // per_target)], per_target),
        "source": "recording",
        "prf_hz": rng.uniform(900, 1300, n),
        "carrier_hz": 7.29e9,
        "observation_s": 2.5,
        "quality_flags": "",
        "gait_frequency_hz": rng.normal(2, 0.3, n),
        "quality_snr_mu_db": rng.uniform(0, 30, n),
        "truth_ground_speed_mps": labels == classes[0],
        "truth_seed": np.arange(n) + 1000.0 * (labels == classes[0]),
        **{f"feature_{name}": rng.normal(1, 0.3, n) for name in SIX},
        "extended_swing_duty": rng.normal(0, 1, n),
        **columns,
    })  # fmt: skip
    index["feature_step_length_m"] += apart * 0.3 * pd.factorize(index["label"])[0]
    index.loc[rng.random(n) < 0.1, "feature_step_length_m"] = np.nan
    numbers = {name: number for number, name in enumerate(classes)}
    description = {"id": identity, "name": "made-up", "origin": "imported", "classes": numbers, "fields": {},
                   "config": {"analysis": {"cpi_s": 0.1}}}  # fmt: skip
    return Dataset(None, description, index, None)


@pytest.fixture(scope="module")
def found():
    return evaluate(made_up(), models=[*FEATURE_MODELS, "extended-boosting"], keep=True)


def test_no_truth_and_no_seed_is_a_feature():
    rows = collect_rows(made_up())
    for features in ("six", "extended", "speed", "nuisance"):
        names = collect_inputs(rows, features).names
        assert names
        assert not [name for name in names if "truth" in name or "seed" in name or name in ("id", "group", "label")]
    assert collect_inputs(rows, "six").names == ("torso_speed_mps", "doppler_bandwidth_mps", *SIX[2:])
    assert collect_inputs(rows, "speed").names == ("torso_speed_mps",)


def test_who_comes_is_who_goes():
    one, other = made_up(), made_up()
    other.index["feature_torso_velocity_mps"] *= -1
    assert np.array_equal(
        collect_inputs(collect_rows(one), "six").values,
        collect_inputs(collect_rows(other), "six").values,
        equal_nan=True,
    )


def test_another_carrier_changes_nothing():
    """At 24 GHz the same body has Doppler bandwidths 24 / 7.29 times as wide, in hertz."""
    one, other = (made_up(**{ENVELOPE: np.linspace(100, 400, 240)}) for _ in range(2))
    for column in ("feature_doppler_bandwidth_hz", ENVELOPE):
        other.index[column] *= 24.0 / 7.29
    other.index["carrier_hz"] = 24e9
    tables = [collect_inputs(collect_rows(dataset), "extended") for dataset in (one, other)]
    assert np.allclose(*(table.values for table in tables), equal_nan=True, rtol=1e-12)
    for name in ("doppler_bandwidth", ENVELOPE.removesuffix("_hz")):
        in_hz = one.index[ENVELOPE if "envelope" in name else f"feature_{name}_hz"]
        assert np.allclose(tables[0].values[:, tables[0].names.index(f"{name}_mps")], in_hz * C / 7.29e9 / 2)


@pytest.mark.parametrize("classes", [("human", "dog"), ("human", "dog", "cat")])
def test_plain_form_answers_as_sklearn_does(classes):
    rows = collect_rows(made_up(classes=classes))
    values, labels = collect_inputs(rows, "six").values.copy(), rows.labels
    values[0] = np.nan
    values[:, 3] = np.nan  # never known
    train, no_rows = LabelledRows(values[:150], labels[:150]), LabelledRows(values[:0], labels[:0])
    weights = row_weights(train.labels, len(classes))
    boosting = HistGradientBoostingClassifier(**BOOSTING, random_state=4)
    known = [0, 1, 2, 4, 5]
    with threadpool_limits(1):
        boosting.fit(train.values[:, known], train.labels, sample_weight=weights)
        expected = boosting.predict_proba(values[:, known])
    with threadpool_limits(2):  # fit uses one
        found = fit(Kind("six", "boosting"), train, no_rows, n_classes=len(classes), seed=4)
    assert np.allclose(np.exp(found.log_probability(values)), expected, atol=1e-12)
    floor = 0.03 * np.nanmedian(train.values[:, known], axis=0)  # all of them are above 0
    assert np.nanmin(train.values[:, known]) > 0

    def logarithms(inputs):
        found = inputs.copy()
        found[:, known] = np.log(np.maximum(inputs[:, known], floor))
        return found

    logistic = make_pipeline(
        FunctionTransformer(logarithms),
        SimpleImputer(strategy="median", add_indicator=True, keep_empty_features=True),
        StandardScaler(),
        LogisticRegression(max_iter=2000),
    )
    logistic.fit(train.values, train.labels, logisticregression__sample_weight=weights)
    found = fit(Kind("six", "logistic"), train, no_rows, n_classes=len(classes), seed=4)
    assert np.allclose(np.exp(found.log_probability(values)), logistic.predict_proba(values), atol=1e-9)


def test_scores_of_a_dataset_that_can_be_told(found):
    models = found.document["models"]
    assert list(models) == ["chance", "nuisance", "speed", *FEATURE_MODELS, "extended-boosting"]
    assert models["chance"]["balanced_accuracy"]["value"] == 0.5
    for name in FEATURE_MODELS:
        assert models[name]["balanced_accuracy"]["value"] > 0.8
        assert models[name]["alarm"]["held"]["dog"]["value"] < 0.5
        assert next(iter(models[name]["importance"])) == "step_length_m"
    for name in ("nuisance", "speed"):
        bounds = models[name]["balanced_accuracy"]
        assert bounds["low"] <= 0.5 <= bounds["high"]
        assert models[name]["alarm"]["held"]["dog"]["value"] > 0.5
    assert found.best in [*FEATURE_MODELS, "extended-boosting"]
    index = made_up().index  # an alarm says how many people it rests on
    people = index[(index["split"] == "validation") & (index["label"] == "human")]["group"].nunique()
    assert found.models["six-logistic"].facts.alarm_people == people > 5
    json.dumps(found.document, allow_nan=False)


def test_answers_agree_with_the_scores(found):
    table, model = found.answers, found.document["models"]["six-logistic"]
    shares = (table["six-logistic:class"] == table["label"]).groupby(table["label"]).mean()
    assert model["balanced_accuracy"]["value"] == pytest.approx(shares.mean())
    assert model["decided"]["n"] == table["six-logistic:decided"].sum()
    best = table[["six-logistic:human", "six-logistic:dog"]].max(axis=1)
    decided = table["six-logistic:decided"]
    assert (best[decided] >= 0.8).all()
    assert ((best >= 0.8) & ~decided).sum() <= 3  # outside the training range


def test_shuffled_labels_give_chance():
    dataset = made_up(600)
    bodies = dataset.index["group"].unique()
    dealt = dict(zip(bodies, np.random.default_rng(5).permutation(["human", "dog"] * (len(bodies) // 2)), strict=True))
    dataset.index["label"] = dataset.index["group"].map(dealt)
    for model in evaluate(dataset, models=FEATURE_MODELS).document["models"].values():
        assert model["balanced_accuracy"]["low"] <= 0.5 <= model["balanced_accuracy"]["high"]


def test_a_plan_that_gives_the_class_away_is_seen():
    dataset = made_up()
    dataset.index["prf_hz"] += 500.0 * (dataset.index["label"] == "dog")
    document = evaluate(dataset, models=["six-logistic"]).document
    assert document["models"]["nuisance"]["balanced_accuracy"]["value"] > 0.95
    assert any(note.startswith("The nuisance parameters alone reach") for note in document["notes"])
    with pytest.raises(DatasetError, match="no model can be trained: "):
        evaluate(dataset, models=["chance"])


def test_nuisances_without_a_plan_are_those_of_the_index_and_it_is_said():
    dataset = made_up(gate_error_m=np.random.default_rng(0).normal(size=240))
    table = collect_inputs(collect_rows(dataset), "nuisance")
    assert table.names == ("index.prf_hz", "index.gate_error_m")  # the observation time is the same everywhere
    assert "only index.prf_hz, index.observation_s, index.gate_error_m (imported recordings have no plan)" in table.note
    both = collect_inputs(collect_rows(dataset, made_up(identity="b")), "nuisance")
    assert both.names == ("index.prf_hz",)
    assert len(both.values) == 480


def test_targets_stay_on_one_side():
    rows = collect_rows(made_up())
    crossed = choose_folds(rows, Options(n_folds=4))[0]
    for each in [*choose_folds(rows, Options())[0], *crossed]:
        sides = [set(rows.groups[part]) for part in (each.train, each.held, each.test)]
        assert all(sides)
        assert sum(map(len, sides)) == len(set.union(*sides))
    tested = np.sort(np.concatenate([fold.test for fold in crossed]))
    assert np.array_equal(tested, np.arange(len(rows)))


@pytest.mark.parametrize("crossed", [False, True])
def test_calibration_holds_back_kinds_of_episode_or_subjects_that_are_in_several(crossed):
    dataset = made_up()
    if not crossed:
        dataset.index["subject"] = dataset.index["group"] = [f"model/{k}" for k in range(len(dataset.index))]
    kinds = [f"{label}_{number % 12}" for number, label in enumerate(dataset.index["label"])]
    dataset.index["scene_id"] = [f"{kind}-{number:06d}" for number, kind in enumerate(kinds)]
    dataset.description["config"] = {"episodes": [{}]}
    rows = collect_rows(dataset)
    names = rows.groups if crossed else np.array(kinds)
    turns = list(hold_back(rows, np.arange(len(rows)), 0))
    assert np.array_equal(np.sort(np.concatenate([held for _, held in turns])), np.arange(len(rows)))
    assert not any({*names[train]} & {*names[held]} for train, held in turns)


def test_a_dataset_that_was_split_by_row_is_refused():
    dataset = made_up()
    dataset.index["split"] = np.resize(["train", "test"], len(dataset))
    with pytest.raises(DatasetError, match="is in the training and in the test data"):
        evaluate(dataset, models=["six-logistic"])


def test_cross_validation_and_leaving_out():
    dataset = made_up(200, subject=np.resize(["rex", "rex", "ada", "ada", "bo", "bo", "cy", "cy"], 200))
    document = evaluate(dataset, models=["six-logistic"], n_folds=4).document
    assert sum(document["tested"].values()) == 200
    assert len(document["folds"]) == 4
    rows = collect_rows(dataset)
    dataset.index["source"] = np.where(rows.labels == 0, "model", "recording")
    with pytest.raises(ConfigError, match="a class has nothing else to learn from"):
        choose_folds(collect_rows(dataset), Options(left_out="source"))
    dataset.index["source"] = np.resize(["model"] * 4 + ["recording"] * 4, 200)
    folds, notes = choose_folds(collect_rows(dataset), Options(left_out="source"))
    assert [fold.name for fold in folds] == ["without model", "without recording"]
    assert not notes
    kept = evaluate(dataset, models=["six-logistic"], left_out="source", keep=True)
    assert [fold["name"] for fold in kept.document["folds"]] == ["without model", "without recording"]
    assert kept.models["six-logistic"].facts.n_train + kept.models["six-logistic"].facts.n_held == 200


def test_another_dataset_to_test_on():
    dataset, other = made_up(identity="a"), made_up(seed=7, identity="b")
    document = evaluate(dataset, other=other, models=["six-logistic"]).document
    assert sum(document["tested"].values()) == len(other)
    assert document["models"]["six-logistic"]["balanced_accuracy"]["value"] > 0.8
    trained = dataset.index.loc[dataset.index["split"] == "train", "group"].iloc[0]
    other.index.loc[:9, "group"] = trained
    document = evaluate(dataset, other=other, models=["six-logistic"]).document
    assert sum(document["tested"].values()) == len(other) - 10
    assert "10 of 240 rows of the test dataset were left out" in document["notes"][0]


def test_the_same_motion_under_another_name_is_not_tested():
    dataset, other = (made_up(identity=name, motion=[f"{name}{k}" for k in range(240)]) for name in "ab")
    first = dataset.index.loc[dataset.index["split"] == "train", "motion"].iloc[0]
    other.index.loc[4:6, "motion"] = first
    (fold,), notes = choose_folds(collect_rows(dataset, other), Options())
    assert not set(fold.test) & {244, 245, 246}
    assert fold.test.size == 237
    assert "3 of 240 rows" in notes[0]


BLENDED = {
    "subject": "person/ann", "others": '["person/ben"]', "recording": "ann.bvh + ben.bvh",
    "motion": '{"hybrid":{"other":{"kind":"file","path":"ben.bvh"},"share":0.4},"kind":"file","path":"ann.bvh"}',
}  # fmt: skip


@pytest.mark.parametrize("known", [{"subject": "person/ben"}, {"recording": "ben.bvh"}])
@pytest.mark.parametrize("is_trained", [True, False])
def test_a_part_of_a_blended_motion_is_not_learnt_from_and_tested(known, is_trained):
    columns = {name: [f"{name} {k}" for k in range(240)] for name in ("subject", "recording", "motion")}
    dataset, other = (made_up(identity=name, others="", **columns) for name in "ab")
    for name in columns:  # nobody but whom the test is about is in both
        other.index[name] += " of b"
    trained = dataset.index.index[dataset.index["split"] == "train"][0]
    sides = ((dataset, trained), (other, 4))
    for (side, place), cells in zip(sides if is_trained else sides[::-1], (BLENDED, known), strict=True):
        side.index.loc[place, list(cells)] = list(cells.values())
    other.index.loc[5, "scene_id"] = other.index.loc[4, "scene_id"]
    (fold,), notes = choose_folds(collect_rows(dataset, other), Options())
    assert set(range(240, 480)) - set(fold.test) == {244, 245}
    assert "2 of 240 rows" in notes[0]


def test_bodies_of_models_are_others_in_another_dataset():
    dataset, other = (made_up(identity=name, subject=[f"model/{k}" for k in range(240)]) for name in "ab")
    (fold,), _ = choose_folds(collect_rows(dataset, other), Options())
    assert fold.test.size == 240


def test_without_validation_some_of_train_is_held_back():
    document = evaluate(made_up(split=(0.8, 0.0)), models=["six-logistic"]).document
    assert document["folds"][0]["held"]["n"] > 20
    assert "held back for calibration" in document["notes"][0]


def as_answers(dataset, model):
    """The answers of a model to rows, as a table of the user."""
    values = model.probability(collect_inputs(collect_rows(dataset), "six").values)
    return pd.DataFrame(values, columns=["human", "dog"]).assign(id=dataset.index["id"])


def test_own_answers_are_scored_as_those_of_the_model_that_gave_them(found, tmp_path):
    dataset, expected = made_up(), dict(found.document["models"]["six-logistic"])
    table = as_answers(dataset, found.models["six-logistic"])
    table.sample(frac=1.0, random_state=1)[["id", "human"]].to_csv(tmp_path / "mine.csv", index=False)
    one = evaluate(dataset, answers=tmp_path / "mine.csv")
    assert list(one.document["models"]) == ["mine", "chance", "nuisance", "speed"]
    assert (one.document["own"], one.best, set(one.models)) == ("mine", None, {"chance", "nuisance", "speed"})
    own = one.document["models"]["mine"]
    for name in ("balanced_accuracy", "recall", "confusion", "alarm", "roc"):
        assert own[name] == expected[name], name
    for name in ("brier", "expected_calibration_error", "held_log_loss"):
        assert own[name] == pytest.approx(expected[name]), name
    assert own["decided"]["n"] == (table["human"][dataset.index["split"] == "test"].sub(0.5).abs() >= 0.3).sum()
    page = write_report(one, tmp_path / "report")[-1].read_text()
    assert "cpi_s" not in page  # the plan is a file
    for answers in (table, lambda part: table[table["id"].isin(part.index["id"])]):
        again = evaluate(dataset, answers=answers).document["models"]
        assert again["own"]["brier"] == pytest.approx(own["brier"])
    assert evaluate(dataset, answers=table, models=["six-logistic"]).best == "six-logistic"


def test_own_answers_need_no_rows_to_train_on_and_may_be_about_another_dataset(found):
    other = made_up(seed=7, identity="b", split=(0.0, 0.0))
    table = as_answers(other, found.models["six-logistic"])
    alone = evaluate(other, answers=table).document
    assert list(alone["models"]) == ["own"]
    assert sum(alone["tested"].values()) == 240
    crossed = evaluate(made_up(), other=other, answers=table).document["models"]
    assert crossed["own"]["balanced_accuracy"] == alone["models"]["own"]["balanced_accuracy"]
    assert "nuisance" in crossed


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda t: t[:9], r"'e\d+' is a tested row without a line.* not scored \(\d+ such; 48 are"),
        (lambda t: pd.concat([t, t.iloc[:1]]), "'e0' has two lines"),
        (lambda t: t.assign(id="x" + t["id"]), r"'xe0' is no row of .*\(240 such"),
        (lambda t: t.rename(columns={"dog": "cat"}), "has the columns human, cat, id; it needs id and human, dog"),
        (lambda t: pd.concat([t, t["dog"]], axis=1), "has the columns human, dog, id, dog"),
        (lambda t: t.assign(dog=np.nan), r"'e0' has .*'dog': nan.*240 of 240 lines are wrong"),
        (lambda t: t.assign(dog=t["dog"] + 0.1), "with the sum 1, as of a softmax"),
        (lambda t: t.assign(human=t["human"] - 1, dog=t["dog"] + 1), "from 0 to 1"),
        (lambda t: t[["human", "dog"]].to_numpy(), "must be a DataFrame with the column id, not ndarray"),
        (lambda t: lambda part: np.zeros((len(part), 2)), "must be a DataFrame with the column id, not ndarray"),
        (lambda t: "no.csv", r"no\.csv: is no readable table"),
    ],
)  # fmt: skip
def test_own_answers_that_cannot_be_scored_are_one_clear_error(found, change, says):
    table = as_answers(made_up(), found.models["six-logistic"])
    with pytest.raises(DatasetError, match=says):
        evaluate(made_up(), answers=change(table))


def wrong_datasets():
    one = made_up(classes=("dog", "dog"))
    one.description["classes"] = {"dog": 0}
    untested, lacking, cats = made_up(split=(0.7, 0.3)), made_up(identity="b"), made_up(identity="b")
    del lacking.index["feature_limb_torso_ratio"]
    cats.index["label"] = cats.index["label"].replace("dog", "cat")
    own, people = (made_up(identity="own", seed=4, classes=classes) for classes in (("human", "dog"), ("human",)))
    return [
        (one, {}, "has the class 'dog' alone"),
        (untested, {}, "no rows in the split test"),
        (made_up(), {"other": lacking}, "has no feature 'limb_torso_ratio'"),
        (made_up(), {"other": cats}, "has the classes cat"),
        (made_up(), {"other": made_up()}, "is the training dataset"),
        (made_up(), {"models": ["six-net"]}, "model 'six-net' is not known; allowed are ensemble, extended"),
        (made_up(), {"n_folds": 1}, "must be from 2 to 60"),
        (made_up(), {"left_out": "colour"}, "no such column"),
        (made_up(), {"left_out": "source"}, "has 1 values"),
        (made_up(), {"left_out": "source", "n_folds": 3}, "use one of them"),
        (made_up(), {"n_folds": "x"}, r"n_folds: 'x' is not allowed; must be int \| None"),
        (made_up(), {"models": ["signature-network"]}, "torch|keeps no 'signature'"),
        (made_up(), {"own": own, "other": own}, "--adapt and --test: use one of them"),
        (made_up(), {"own": own, "n_folds": 3}, "--adapt: needs one model for all rows"),
        (made_up(), {"own": people}, "contains no dog; label recordings of every class"),
        (made_up(), {"unknown": own}, "--unknown .*: has only the classes human, dog, which the models are trained on"),
        (made_up(), {"answers": "a.csv", "n_folds": 3}, "--answers and --cv: use one of them"),
        (made_up(), {"unknown": cats, "n_folds": 3}, "--unknown: needs one model for all rows"),
    ]


@pytest.mark.parametrize(("dataset", "options", "says"), wrong_datasets())
def test_what_cannot_be_scored_is_one_clear_error(dataset, options, says):
    with pytest.raises((DatasetError, ConfigError), match=says):
        evaluate(dataset, **{"models": ["six-logistic"], **options})


def test_a_kept_model_answers_the_same(found, tmp_path):
    rows = collect_rows(made_up(seed=9))
    for name in ("chance", "speed", *FEATURE_MODELS, "extended-boosting"):
        model = found.models[name]
        again = load_model(save_model(model, tmp_path / "m.npz"))
        assert again.facts == model.facts
        values = collect_inputs(rows, model.facts.features).values
        assert np.array_equal(again.probability(values), model.probability(values))
        first = (tmp_path / "m.npz").read_bytes()
        save_model(again, tmp_path / "m.npz")
        assert (tmp_path / "m.npz").read_bytes() == first
    assert found.models["six-logistic"].facts.analysis == {"cpi_s": 0.1}


def rewritten(path, change):
    with np.load(path) as archive:
        arrays = dict(archive)
    change(arrays)
    np.savez(path, **arrays)


def put_text(arrays, change):
    document = json.loads(arrays["model"].tobytes())
    change(document)
    arrays["model"] = np.frombuffer(json.dumps(document).encode(), dtype=np.uint8)


def loop(arrays):
    inner = np.flatnonzero(arrays["feature"] >= 0)
    arrays["left"][inner[0]] = inner[0]


TREES = [
    (lambda a: a.update(threshold=np.array([print], dtype=object)), "pickle|Object"),
    (loop, "lead nowhere or back"),
    (lambda a: a["right"].__setitem__(0, 10**6), "lead nowhere or back"),
    (lambda a: a["feature"].__setitem__(0, 6), "do not exist"),
    (lambda a: a.update(value=a["value"][:-1]), "shape"),
    (lambda a: a.pop("start"), "start"),
    (lambda a: a.pop("model"), "model"),
    (lambda a: a.update(lowest=np.array(["a"] * 6)), "not numbers"),
    (lambda a: a.update({"calibration.slope": np.array([np.nan])}), "calibration"),
    (lambda a: a["value"].__setitem__(0, np.nan), "value holds NaN"),
    (lambda a: put_text(a, lambda d: d["facts"].update(names=["step", *d["facts"]["names"][1:]])), "'step'"),
    (lambda a: put_text(a, lambda d: d["facts"].update(alarm="cat")), "not one of its classes"),
    (lambda a: put_text(a, lambda d: d["facts"].update(alarm_threshold=float("nan"))), "alarm_threshold"),
    (lambda a: put_text(a, lambda d: d.update(learned="eval")), "not a model of doppelgait"),
    (lambda a: put_text(a, lambda d: d.update(format_version=99)), "newer doppelgait"),
    (lambda a: put_text(a, lambda d: d.update(format_version=3)), "train it again"),
    (lambda a: put_text(a, lambda d: d.update(format="other")), "states the format 'other'"),
    (lambda a: put_text(a, lambda d: d["facts"].update(abstain_below=7)), "abstain_below"),
    (lambda a: put_text(a, lambda d: d["facts"].update(classes=["human", "dog", "cat"])), "shape"),
]
LINEAR = [
    (lambda a, name=name, value=value: a[name].ravel().__setitem__(0, value), f"{name} holds")
    for name, value in (("weight", np.nan), ("scale", 0.0), ("scale", -1.0), ("bias", np.inf))
] + [
    (lambda a: a.update(bias=np.zeros(3)), "bias has the shape"),
    (lambda a: a.update(median=a["median"][1:]), "median has the shape"),
    (lambda a: a["told"].__setitem__(0, 6), "told names features"),
    (lambda a: a.update(floor=np.ones(2)), "floor has the shape"),
]
BROKEN = [(name, *case) for name, cases in (("six-boosting", TREES), ("six-logistic", LINEAR)) for case in cases]


@pytest.mark.parametrize(("name", "change", "says"), BROKEN)
def test_a_file_that_was_tampered_with_is_refused(found, tmp_path, name, change, says):
    path = save_model(found.models[name], tmp_path / "m.npz")
    rewritten(path, change)
    with pytest.raises(DatasetError, match=rf"m\.npz.*({says})"):
        load_model(path)


def test_a_model_of_nuisances_cannot_be_used(found, tmp_path):
    path = save_model(found.models["nuisance"], tmp_path / "m.npz")
    with pytest.raises(DatasetError, match=r"m\.npz.*uses the feature 'index\.prf_hz'"):
        load_model(path)


class Bomb:
    """What a pickle would run."""

    def __reduce__(self):
        return (exec, ("raise SystemExit('ran')",))


def test_foreign_and_truncated_files_are_refused(found, tmp_path):
    path = save_model(found.models["six-boosting"], tmp_path / "m.npz")
    whole = path.read_bytes()
    np.savez(tmp_path / "bomb.npz", model=np.array([Bomb()], dtype=object))
    (tmp_path / "pickle.npz").write_bytes(np.array([Bomb()], dtype=object).dumps())
    (tmp_path / "text.npz").write_text("model")
    np.savez(tmp_path / "other.npz", x=np.zeros(3))
    for size in (0, 10, len(whole) // 2, len(whole) - 30):
        (tmp_path / f"cut{size}.npz").write_bytes(whole[:size])
    for file in sorted(tmp_path.glob("*.npz")):
        if file != path:
            with pytest.raises(DatasetError, match="not a model of doppelgait, or is damaged"):
                load_model(file)
    with pytest.raises(DatasetError, match="cannot be read"):
        load_model(tmp_path / "missing.npz")
    np.savez_compressed(tmp_path / "large.npz", model=np.zeros(300_000_000, np.uint8))
    with pytest.raises(DatasetError, match="would take 2,400 MB of memory"):
        load_model(tmp_path / "large.npz")
    with pytest.raises(ConfigError, match="must end in"):
        save_model(found.models["six-boosting"], tmp_path / "m.pkl")


def a_target(*flags, **changes):
    columns = {f"feature_{name}": 1.0 for name in SIX} | {"gait_frequency_hz": 2.0, "quality_observation_s": 2.4}
    return TargetInputs(columns | changes, a_signature(7.29e9, 1100.0), flags=flags)


def test_decision_and_abstentions(found):
    assert decide(a_target(feature_step_length_m=None), found.models["six-boosting"], 0).label in ("human", "dog")
    with pytest.raises(AnalysisError, match="target 3: has no extended_swing_duty"):
        decide(a_target(), found.models["extended-boosting"], 3)
    model = found.models["six-logistic"]
    sure = decide(a_target(feature_step_length_m=2.2), model, 0)
    assert (sure.label, sure.abstained, sure.reason) == ("dog", False, "")
    assert sure.probability == max(sure.probabilities.values()) > 0.9
    assert not sure.alarm
    unsure = decide(a_target(feature_step_length_m=1.45), model, 1)
    assert unsure.abstained
    assert unsure.reason.startswith("probability 0.")
    for flag in (
        "no_signal", "aspect_beyond_75_deg:gait_is_hidden", "clutter_removal_took_30_per_cent:a_torso",
        "folded_echo_of:2", "not_a_moving_body:moves_like_a_thing", "unknown_target:x",
    ):  # fmt: skip
        blocked = decide(a_target("harmonic_ratio_3:none", flag, feature_step_length_m=2.2), model, 0)
        assert blocked.abstained
        assert blocked.reason == f"flag {flag}"
    far = decide(a_target(feature_step_length_m=9.0), model, 0)
    assert far.abstained
    assert far.reason.startswith("step_length_m 9 is outside the accepted range, ")
    lost = decide(a_target(feature_step_length_m=2.2, feature_limb_torso_ratio=None), model, 0)
    assert lost.reason == "limb_torso_ratio is unknown, unlike in the training data"
    low, high = (float(text) for text in re.findall(r"accepted range, (.+) to (.+) \(", far.reason)[0])
    for value, is_far in ((0.99 * high, False), (1.01 * high, True)):
        assert ("step_length_m" in decide(a_target(feature_step_length_m=value), model, 0).reason) is is_far
    assert low < 0.5 < high
    assert decide(a_target(feature_step_length_m=0.5), model, 0).alarm
    json.dumps(sure.as_dict(), allow_nan=False)
    assert (sure.quality["carrier_hz"], sure.quality["prf_hz"]) == pytest.approx((7.29e9, 1100))


def test_kinds_that_were_not_learnt_are_scored_apart():
    strangers = made_up(40, classes=("cat", "human"), identity="z")
    cats = strangers.index["label"] == "cat"
    strangers.index.loc[cats, "feature_limb_torso_ratio"] = strangers.index["feature_limb_torso_ratio"].max() + 20.0
    found = evaluate(made_up(), unknown=strangers, models=["six-logistic"])
    scores = found.document["models"]["six-logistic"]["unknown"]
    assert scores == {"cat": {"n": int(cats.sum()), "auc": 1.0, "auc_of_probability": ANY,
                              "decided": {"human": 0.0, "dog": 0.0}}}  # fmt: skip
    assert list_sections(found.document)[UNKNOWN_TEXT][0]["AUC of the distance"] == "1.000"
    assert "unknown" not in found.document["models"]["speed"]
    # people of another name are not told from people, and most are called so
    others = made_up(40, seed=3, identity="z")
    others.index["label"] = others.index["label"].replace("human", "cat")
    scores = evaluate(made_up(), unknown=others, models=["six-logistic"]).document["models"]["six-logistic"]
    assert 0.3 < scores["unknown"]["cat"]["auc"] < 0.7
    assert sum(scores["unknown"]["cat"]["decided"].values()) > 0.5


def test_models_are_adapted_to_own_recordings(tmp_path):
    own = made_up(160, identity="own", seed=4)
    own.index["feature_step_length_m"] += 0.6
    found = evaluate(made_up(), own=own, models=["six-logistic"], keep=True)
    curve = found.document["models"]["six-logistic"]["adaptation"]
    assert [point["n"] for point in curve] == [0, 1, 2, 5, 10, 20]
    assert curve[-1]["balanced_accuracy"] > curve[-1]["before"] + 0.04
    assert found.models["six-logistic"].facts.n_own > 140
    assert load_model(save_model(found.models["six-logistic"], tmp_path / "own.npz")).facts.n_own > 140
    assert list_sections(found.document)[ADAPTATION_TEXT][0]["own recordings of a class"] == "0"
    page = write_report(found, tmp_path / "report")[-1].read_text()
    assert "Adapted to own recordings" in page
    assert (tmp_path / "report" / "adaptation.png").is_file()


def test_own_recordings_of_no_decision_move_nothing():
    own = made_up(120, identity="own", seed=4)
    plain = evaluate(made_up(), own=own, models=["six-logistic"]).models["six-logistic"]
    flagged = own.index.iloc[:20].assign(quality_flags="no_signal", id=[f"x{k}" for k in range(20)], label="human")
    more = Dataset(None, own.description, pd.concat([own.index, flagged], ignore_index=True), None)
    found = evaluate(made_up(), own=more, models=["six-logistic"])
    assert any("own rows are not used, because the model makes no decision" in note for note in found.document["notes"])
    assert found.models["six-logistic"].calibration.shift == pytest.approx(plain.calibration.shift, abs=1e-9)
    elsewhere = made_up(120, identity="own", seed=4)
    elsewhere.index["carrier_hz"] = 24e9
    notes = evaluate(made_up(), own=elsewhere, models=["six-logistic"]).document["notes"]
    assert any("120 of 120 own rows are not used" in note and "carrier_hz outside" in note for note in notes)
    assert any("is not adapted, because a class has no own recording left." in note for note in notes)


def test_what_is_unlike_the_training_is_no_decision(found):
    model = found.models["six-logistic"]
    strict = replace(model, facts=model.facts.model_copy(update={"novel_below": 1.01}))
    decision = decide(a_target(feature_step_length_m=2.2), strict, 0)
    assert decision.abstained
    assert re.match(
        r"unlike the training data: \d+\.\d % of the held-out rows have the same or a larger distance", decision.reason
    )


@pytest.mark.parametrize("stated", [True, False])
def test_another_radar_is_no_decision_and_no_alarm(found, stated):
    """Of every model; where a signature does not state its carrier, its axes tell it."""
    for name in (*FEATURE_MODELS, "chance"):
        model = found.models[name]
        assert set(model.facts.conditions) == {"carrier_hz", "prf_hz", "observation_s"}
        other = TargetInputs(a_target(feature_step_length_m=0.5).columns, a_signature(24.1e9, 3000.0, stated=stated))
        said = decide(other, model, 0)
        assert said.abstained
        assert said.alarm is None
        assert "carrier_hz 2.41e+10 is outside the accepted range, 6.561e+09 to 8.019e+09" in said.reason
        assert "prf_hz 3000 is outside the accepted range, " in said.reason
    near = TargetInputs(other.columns, a_signature(7.4e9, 1300.0, stated=stated))
    assert "is outside" not in decide(near, model, 0).reason


def test_too_short_unknown_and_too_few_columns_are_no_decision(found):
    model = found.models["six-logistic"]
    short = decide(a_target(feature_step_length_m=2.2, quality_observation_s=1.5), model, 0)
    assert short.reason == "observation_s 1.5 is outside the accepted range, 2 to 10 (training range 2.5)"
    for seconds, far in zip((1.99, 2.01, 9.9, 10.1), (True, False, False, True), strict=True):
        seen = a_target(feature_step_length_m=2.2, quality_observation_s=seconds)
        assert ("observation_s" in decide(seen, model, 0).reason) is far
    unknown = TargetInputs(a_target().columns, xr.DataArray(np.ones((3, 3)), dims=("time", "doppler")))
    assert "carrier_hz is unknown; the training range is 7.29e+09" in decide(unknown, found.models["chance"], 0).reason
    flag = "gait_frequency:columns_do_not_overlap"
    older = replace(model, facts=model.facts.model_copy(update={"blocking": ("no_signal",)}))
    for each in (model, older):
        assert decide(a_target(flag, feature_step_length_m=2.2), each, 0).reason == f"flag {flag}"


@pytest.mark.parametrize("usual", [False, True])
def test_a_flag_that_the_radar_causes_is_no_reason_where_the_training_rows_had_it(usual, tmp_path):
    flag = "gait_frequency:columns_do_not_overlap"
    rows = made_up(quality_flags=np.where(np.arange(240) % 20 < (19 if usual else 10), f"{flag};other", ""))
    model = evaluate(rows, models=["six-logistic"]).models["six-logistic"]
    model = load_model(save_model(model, tmp_path / "m.npz"))
    sure = decide(a_target(flag, feature_step_length_m=2.2), model, 0)
    assert (sure.abstained, sure.reason) == ((False, "") if usual else (True, f"flag {flag}"))
    assert decide(a_target("no_signal", feature_step_length_m=2.2), model, 0).reason == "flag no_signal"


def test_a_test_on_another_radar_is_said_and_not_decided():
    other = made_up(seed=7, identity="b", carrier_hz=24.1e9)
    document = evaluate(made_up(), other=other, models=["six-logistic"]).document
    outside = document["outside_conditions"]["carrier_hz"]
    assert (outside["n"], outside["of"]) == (240, 240)
    assert (outside["learnt"], outside["tested"]) == (pytest.approx([7.29e9] * 2), pytest.approx([24.1e9] * 2))
    assert any("240 of 240 tested rows have a carrier_hz of 2.41e+10, outside" in note for note in document["notes"])
    assert document["models"]["six-logistic"]["decided"]["n"] == 0
    assert not evaluate(made_up(), models=["six-logistic"]).document["outside_conditions"]


def test_bandwidths_are_decided_on_in_metres_per_second():
    model = evaluate(made_up(**{ENVELOPE: np.linspace(100, 400, 240)}), models=["extended-logistic"]).models[
        "extended-logistic"
    ]
    assert {ENVELOPE, ENVELOPE_WIDTH} & {*model.facts.names} == {ENVELOPE_WIDTH}
    rest = {"extended_swing_duty": 0.0, "feature_step_length_m": 1.6}
    wide, narrow = (decide(a_target(**{ENVELOPE: wide_hz}, **rest), model, 0) for wide_hz in (300.0, 100.0))
    assert wide.probabilities != pytest.approx(narrow.probabilities, rel=1e-3)


@pytest.fixture(scope="module")
def recording():
    return run_simulation(parse_run({
        "seed": 3, "duration_s": 2.5, "radar": {"preset": "x4", "prf_hz": 1300},
        "targets": [{"label": "human", "motion": {"kind": "boulic", "speed_mps": 1.2}, "start_position_m": [6, 0],
                     "heading_deg": 180}],
    }, where="test"))  # fmt: skip


def test_a_report_of_a_built_dataset(dataset, tmp_path):
    result = evaluate(dataset, models=FEATURE_MODELS)
    files = {path.name for path in write_report(result, tmp_path / "out")}
    assert {"index.html", "scores.json", "answers.csv", "plan.json", "confusion.png", "roc-human.png"} <= files
    page = (tmp_path / "out" / "index.html").read_text()
    for name in [*FEATURE_MODELS, "chance", "nuisance", "speed"]:
        assert f"<td>{name}</td>" in page
    assert all(name in page for name in files if name.endswith(".png"))
    assert json.loads((tmp_path / "out" / "plan.json").read_text()) == dataset.description["config"]
    assert json.loads((tmp_path / "out" / "scores.json").read_text()) == result.document
    first = {p.name: p.read_bytes() for p in (tmp_path / "out").iterdir() if p.suffix != ".png"}
    write_report(evaluate(dataset, models=FEATURE_MODELS), tmp_path / "out")
    assert first == {p.name: p.read_bytes() for p in (tmp_path / "out").iterdir() if p.suffix != ".png"}
    (tmp_path / "out" / "mine.txt").write_text("mine")
    for folder in (dataset.directory, tmp_path / "out"):
        before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
        with pytest.raises(ConfigError, match="which no run of evaluate wrote"):
            write_report(result, folder)
        assert before == {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_report_has_vector_files_next_to_the_figures_of_its_page(dataset, tmp_path, monkeypatch):
    result, out = evaluate(dataset, models=["six-logistic"]), tmp_path / "out"
    figures = list(make_figures(result.document))[:1]
    monkeypatch.setattr("doppelgait.classify.report.make_figures", lambda _: figures)
    files = [path.name for path in write_report(result, out, figure_format="svg")]
    assert {"scores.png", "scores.svg"} <= set(files)
    assert sorted(path.name for path in out.iterdir()) == sorted(files)
    assert 'src="scores.png"' in (out / "index.html").read_text()
    write_report(result, out)  # replaces the earlier report
    assert not (out / "scores.svg").exists()


def test_a_report_that_fails_leaves_the_older_one(dataset, tmp_path, monkeypatch):
    result = evaluate(dataset, models=["six-logistic"])
    monkeypatch.setattr("doppelgait.classify.report.make_figures", lambda _: [])
    write_report(result, tmp_path / "out")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    monkeypatch.setattr("doppelgait.classify.report.make_page", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        write_report(result, tmp_path / "out")
    assert before == {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}


def test_one_class_tested_has_recalls_and_no_balanced_accuracy(tmp_path):
    other = made_up(seed=7, identity="b")
    other = replace(other, index=other.index[other.index["label"] == "dog"].reset_index(drop=True))
    found = evaluate(made_up(), other=other, models=["six-logistic"])
    model = found.document["models"]["six-logistic"]
    assert model["balanced_accuracy"] == {
        "value": None, "low": None, "high": None, "interval": "not all classes are tested"
    }  # fmt: skip
    assert model["recall"]["dog"]["value"] > 0.5
    assert all(entry["value"] is None for entry in found.document["conditions"]["snr"]["models"]["six-logistic"])
    assert "not all classes are tested" in write_report(found, tmp_path / "out")[-1].read_text()


def few_targets():
    """So few targets that none can be held back."""
    return made_up(8, per_target=1, split=(0.75, 0.0), seed=1)


def test_without_held_rows_nothing_is_the_best(tmp_path):
    with pytest.raises(ConfigError, match=r"--save: no rows are left to choose among six-logistic, six-boost"):
        evaluate(few_targets(), models=FEATURE_MODELS, keep=True)
    found = evaluate(few_targets(), models=FEATURE_MODELS)
    assert found.best is None
    assert found.document["kept"] is None
    notes = found.document["notes"]
    assert "six-logistic, six-boosting are not calibrated" in " ".join(notes)
    assert all(note.endswith(".") for note in notes)
    assert "not calibrated" in write_report(found, tmp_path / "out")[-1].read_text()
    assert evaluate(few_targets(), models=["six-logistic"], keep=True).best == "six-logistic"


def test_recording_results_and_file_give_the_same(found, recording, tmp_path):
    facts = found.models["six-boosting"].facts
    model = replace(found.models["six-boosting"], facts=facts.model_copy(update={"conditions": {}}))
    results = analyze(recording, gate="truth")
    write_results(tmp_path / "r.h5", recording, results)
    one = classify(recording, model, gate="truth")
    two, three = classify(results, model), classify(tmp_path / "r.h5", model)
    assert len(one) == 1
    for other in (two, three):
        assert other[0].probabilities == pytest.approx(one[0].probabilities)
        assert (other[0].reason, other[0].flags) == (one[0].reason, one[0].flags)
        assert other[0].quality["prf_hz"] == pytest.approx(1300)
    assert one[0].quality["observation_s"] == pytest.approx(2.4, abs=0.1)


def test_another_radar_or_analysis_is_warned_of(found, recording):
    model = found.models["six-boosting"]
    changed = model.facts.model_copy(update={"conditions": {"prf_hz": (200.0, 300.0)}, "analysis": {"cpi_s": 0.2}})
    with pytest.warns(DoppelgaitWarning) as said:
        decisions = classify(recording, replace(model, facts=changed), gate="truth", analysis=Analysis())
    assert "prf_hz 1300 is outside the accepted range, 180 to 330 (training range 200 to 300)" in decisions[0].reason
    texts = " ".join(str(entry.message) for entry in said)
    assert "cpi_s 0.1 instead of 0.2" in texts
