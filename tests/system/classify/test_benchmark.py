"""The benchmark: the same data in two processes, and any classifier is scored on it."""

import json
import sys
import warnings

import numpy as np
import pytest

from doppelgait.classify import benchmark as bench
from doppelgait.classify.benchmark import Part
from doppelgait.core.errors import ConfigError, DatasetError
from doppelgait.dataset import open_dataset
from processes import run

PLAN = """
[dataset]
name = "tiny"
seed = 3
examples_per_class = 5
fields = ["pictures", "ti_frames"]
fractions = { test = 1.0 }

[noise]
kind = "thermal"

[[episodes]]
label = "a person"
should_trigger = true
hours_per_day = 1
duration_s = 4
targets = [{ label = "human", motion = { kind = "human" }, range_m = 4.0 }]

[[episodes]]
label = "a dog"
animals = 1
hours_per_day = 1
duration_s = 4
targets = [{ label = "animal", motion = { kind = "quadruped", gait = "walk" }, range_m = 4.0 }]
"""
OUTSIDE = '''
def answer(train, test):
    """The wider the torso line against that of the training data, the likelier a person."""
    name = "extended_torso_bandwidth_mps"
    spread = test.index[name].fillna(0.5) / train.index[name].mean()
    return (spread / (1 + spread)).to_numpy()
'''


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The benchmark with tiny parts, made by the command of a process of its own."""
    folder = tmp_path_factory.mktemp("bench")
    (folder / "tiny.toml").write_text(PLAN)
    (folder / "mine.py").write_text(OUTSIDE)
    return folder


def make(folder, out, *words):
    program = (
        "from doppelgait.classify import benchmark as bench; from doppelgait.cli.app import main; "
        f"bench.PARTS = {{n: bench.Part({str(folder / 'tiny.toml')!r}, '', o, matched=n == 'matched') for n, o in "
        "[('train', ('dataset.seed=1',)), ('life', ()), ('matched', ())]}; main()"
    )
    done = run([sys.executable, "-c", program, "benchmark", str(out), *words, "--json"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_two_processes_make_the_same_benchmark_and_score_any_classifier(folder, tmp_path):
    mine = f"{folder / 'mine.py'}:answer"
    first = make(folder, tmp_path / "a", "--classifier", mine, "--classifier", "four-numbers")
    second = make(folder, tmp_path / "b", "--classifier", mine)
    assert first["parts"] == second["parts"]
    assert len({part["contents"] for part in first["parts"]}) == len(first["parts"]) == 3
    assert first["scores"][mine] == second["scores"][mine]
    life = first["scores"][mine]["life"]
    assert life["tracks"] == 10
    assert life["alarm"]["entries"] == 5
    make(folder, tmp_path / "a", "--classifier", mine, "--rehearse")
    assert open_dataset(tmp_path / "a" / "rehearsal" / "life").plan_config.dataset.examples_per_class == 1
    train, part = (open_dataset(tmp_path / "a" / name) for name in ("train", "life"))
    for name in ("brightness", "six-features", "track"):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # without torch the network is smaller
            answers = bench.answer_baseline(name, train, part)
        assert np.isfinite(answers).sum() >= 10, name
        row = bench.format_scores(name, {"life": bench.score_part(part, answers)})
        assert set(row) == {"classifier", "life: AUC", "life: ECE", "life: false/h"}


def test_a_perfect_classifier_has_perfect_scores_and_a_blind_one_none(folder, tmp_path, monkeypatch):
    monkeypatch.setattr(bench, "PARTS", {"life": Part(str(folder / "tiny.toml"), "")})
    dataset = bench.build_part("life", tmp_path / "life")
    human = (dataset.index["label"] == "human").to_numpy(dtype=float)
    found = bench.score_part(dataset, 0.01 + 0.98 * human)
    assert (found["auc"]["value"], found["alarm"]["missed"]) == (1, 0)
    assert found["alarm"]["false_per_animal_hour"]["value"] == 0
    assert found["expected_calibration_error"] == pytest.approx(0.01)
    assert bench.score_part(dataset, np.full(human.size, 0.3))["auc"]["value"] == 0.5
    for wrong in (np.full(human.size, np.nan), ["yes", *human[1:]], human[1:], human + 1):
        with pytest.raises(ConfigError, match="a classifier must answer"):
            bench.score_part(dataset, wrong)
    (tmp_path / "cheat.py").write_text("def answer(train, test):\n    return test.index")
    seen = bench.open_classifier(f"{tmp_path / 'cheat.py'}:answer")(dataset, dataset)
    assert {"motion", "subject", "rcs_total_m2", "snr_frame_db", "truth_range_m"} <= {*dataset.index} - {*seen}
    assert (set(seen["label"]), seen["id"].tolist()) == ({"hidden"}, [str(n) for n in range(len(seen))])


def test_levels_are_matched_for_people_and_animals_alone(folder, monkeypatch):
    part = Part(str(folder / "tiny.toml"), "", matched=True)
    monkeypatch.setattr(bench, "PARTS", {"matched": part})
    plan = bench.load_part("matched")
    assert [body["rcs"] for one in plan.episodes for body in one.targets] == [bench.LAW, bench.LAW]
    nested = [{"label": "thing"}, {"choice": [[{"label": "animal"}, {"label": "human", "rcs": 3}]]}]
    kept, choice = bench.match_levels(nested)
    assert kept == {"label": "thing"}
    assert [body["rcs"] for body in choice["choice"][0]] == [bench.LAW, bench.LAW]


def test_other_data_and_unknown_classifiers_are_told(folder, monkeypatch):
    monkeypatch.setattr(bench, "PARTS", {"life": Part(str(folder / "tiny.toml"), "0" * 16)})
    with pytest.raises(ConfigError, match=r"life: identity .* cannot be compared"):
        bench.load_part("life")
    monkeypatch.setattr(bench, "is_torch_installed", lambda: False)
    with pytest.raises(DatasetError, match="torch is not installed"):
        bench.open_classifier("spectrogram")
    for name in ("nothing.py:answer", f"{folder / 'mine.py'}:nothing"):
        with pytest.raises(ConfigError, match="no such file or function"):
            bench.open_classifier(name)
