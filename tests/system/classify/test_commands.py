"""``evaluate`` and ``classify`` as commands."""

import json
import sys
from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pandas as pd
import pytest

from command import run
from doppelgait.classify import network, save_model
from doppelgait.classify.evaluation import evaluate
from doppelgait.classify.learned import LabelledRows
from doppelgait.classify.report import make_figures
from doppelgait.core.errors import ConfigError, DatasetError
from doppelgait.pipeline import parse_run, run_simulation
from doppelgait.radar import read_recording, write_recording
from export_models import export_model_of, model_of_tracks, random_track_network, require
from figure_faults import faults


def text_of(*words):
    return run(*words).stdout


@pytest.fixture(scope="module")
def own(tmp_path_factory, folder):
    """A report, a kept model, and a recording of somebody who walks up to the radar."""
    target = tmp_path_factory.mktemp("classify")
    text = text_of("evaluate", folder, "-o", target / "report", "--models", "six-boosting", "--save", target / "m.npz")
    assert "six-boosting" in text
    assert "nuisance" in text
    recording = run_simulation(parse_run({
        "seed": 1, "duration_s": 3.0, "radar": {"preset": "x4"},
        "targets": [{"label": "human", "motion": {"kind": "boulic", "speed_mps": 1.2}, "start_position_m": [6, 0],
                     "heading_deg": 180}],
    }, where="test"))  # fmt: skip
    write_recording(recording, target / "walk.h5")
    return target


def test_figures_of_the_report_have_no_faults(own):
    assert {"index.html", "scores.json", "answers.csv", "plan.json"} <= {p.name for p in (own / "report").iterdir()}
    document = json.loads((own / "report" / "scores.json").read_text())
    found = {name: faults(figure) for name, _, figure in make_figures(document)}
    assert {"scores", "confusion", "reliability", "roc-human"} <= set(found)
    assert {name: words for name, words in found.items() if words} == {}


def test_own_answers_are_scored_by_the_command_too(own, folder, tmp_path):
    answers = pd.read_csv(own / "report" / "answers.csv").rename(
        columns=lambda name: name.removeprefix("six-boosting:")
    )
    answers[["id", "label", "human", "dog"]].to_csv(tmp_path / "mine.csv", sep=";")
    shown = run("evaluate", folder, "-o", tmp_path / "r", "--answers", tmp_path / "mine.csv")
    assert "mine has your own probabilities" in shown.stderr
    scores = [json.loads((path / "scores.json").read_text())["models"] for path in (own / "report", tmp_path / "r")]
    assert scores[1]["mine"]["confusion"] == scores[0]["six-boosting"]["confusion"]
    shown = run("evaluate", folder, "-o", tmp_path / "r", "--models", "six-boosting", "--save", tmp_path / "m.npz")
    assert "no C form" in shown.stderr
    with pytest.raises(ConfigError, match="no model to save"):
        run("evaluate", folder, "-o", tmp_path / "r", "--answers", tmp_path / "mine.csv", "--save", tmp_path / "m.npz")


def test_json_is_the_document(own, folder, tmp_path):
    words = ["--models", "six-logistic", "--json", "--format", "svg"]
    document = json.loads(text_of("evaluate", folder, "-o", tmp_path / "r", *words))
    assert document == json.loads((tmp_path / "r" / "scores.json").read_text())
    assert {"scores.png", "scores.svg"} <= {path.name for path in (tmp_path / "r").iterdir()}
    assert set(document["models"]) == {"chance", "nuisance", "speed", "six-logistic"}


def test_a_recording_is_classified(own):
    found = json.loads(text_of("classify", own / "walk.h5", "--model", own / "m.npz", "--gate", "truth", "--json"))
    assert found["model"]["classes"] == ["human", "dog"]
    assert len(found["targets"]) == 1
    target = found["targets"][0]
    assert target["label"] in ("human", "dog")
    assert target["abstained"] == bool(target["reason"])
    assert sum(target["probabilities"].values()) == pytest.approx(1)
    shown = run("classify", own / "walk.h5", "--model", own / "m.npz", "--gate", "truth")
    assert target["label"] in shown.stdout
    assert "likeliest" in shown.stdout
    assert "note: alarm: " in shown.stderr


def test_a_recording_is_classified_in_windows(own):
    options = ("--model", own / "m.npz", "--window-s", 2.4, "--hop-s", 0.3)
    arguments = ("classify", own / "walk.h5", *options)
    found = json.loads(text_of(*arguments, "--json"))
    assert (found["window_s"], found["hop_s"]) == (2.4, 0.3)
    (track,) = found["tracks"]
    assert [one["start_s"] for one in found["windows"]] == pytest.approx([0.0, 0.3, 0.6])
    assert track["windows"] == 3
    assert [found["timeline"][0]["start_s"], found["timeline"][-1]["stop_s"]] == pytest.approx([0.0, 3.0])
    text = text_of(*arguments)
    assert text.index("evidence") < text.index("timeline") < text.index("reason")


def test_an_included_model_decides_over_tracks(own, tmp_path):
    found = json.loads(text_of("classify", own / "walk.h5", "--json"))
    assert [found["window_s"], len(found["tracks"]), len(found["windows"])] == [2.5, 1, 2]
    write_recording(read_recording(own / "walk.h5").between(0.0, 2.4), tmp_path / "short.h5")
    assert "targets" in json.loads(text_of("classify", tmp_path / "short.h5", "--json"))


def test_features_of_windows_are_rows(own):
    arguments = ("analyze", own / "walk.h5", "--window-s", 2.4, "--hop-s", 0.6)
    found = json.loads(text_of(*arguments, "--json"))
    assert [(one["track"], one["start_s"]) for one in found["targets"]] == [(0, 0.0), (0, 0.6)]
    assert found["targets"][1]["features"]["torso_velocity_mps"] == pytest.approx(1.2, abs=0.1)
    assert text_of(*arguments).count("\n") == 3
    with pytest.raises(ConfigError, match="-o: not allowed with --window-s"):
        text_of(*arguments, "-o", own / "r.h5")


def test_mistakes_are_one_clear_error(own, folder, tmp_path):
    for name, says in (("m.pkl", r"must end in \.npz"), ("no/m.npz", "does not exist"), ("r/m.npz", "the report")):
        with pytest.raises(ConfigError, match=rf"^--save .*{says}"):
            text_of("evaluate", folder, "-o", tmp_path / "r", "--save", tmp_path / name)
    with pytest.raises(ConfigError, match=r"the folder .* does not exist"):
        text_of("evaluate", folder, "-o", tmp_path / "a" / "b")
    with pytest.raises(DatasetError, match="not a model of doppelgait"):
        text_of("classify", own / "walk.h5", "--model", own / "walk.h5")
    assert not list(tmp_path.iterdir())
    text_of("analyze", own / "walk.h5", "-o", tmp_path / "r.h5")
    with pytest.raises(ConfigError, match=r"^--hop-s: the file holds results"):
        text_of("classify", tmp_path / "r.h5", "--hop-s", 0)


def export(*words):
    return run("model", "export", *words).stdout


@pytest.fixture
def file(tmp_path):
    track = model_of_tracks(3, random_track_network(np.random.default_rng(1), 2))[0]
    facts = track.facts.model_copy(update={"alarm": "a", "alarm_threshold": 0.7})
    model = export_model_of("ensemble", alarm="a", alarm_threshold=0.7)
    return save_model(replace(model, track=replace(track, facts=facts)), tmp_path / "model.npz")


@pytest.mark.parametrize(
    ("form", "files"),
    [
        ("c", {"doppelgait_model.h", "doppelgait_model.c", "selftest.c", "golden.bin"}),
        ("numpy", {"model.npz", "scorer.py"}), ("onnx", {"model.onnx"}),
    ],
)  # fmt: skip
def test_every_form_is_a_folder_with_the_facts_of_the_model(file, tmp_path, form, files):
    if form == "onnx":
        require(find_spec("onnx"), "onnx: pip install 'doppelgait[export]'")
    radar = ["--radar", "x4", "--prf-hz", "500"] if form == "c" else []
    found = json.loads(export(file, "--form", form, *radar, "-o", tmp_path / "out", "--json"))
    assert set(found["files"]) == files
    assert {path.name for path in (tmp_path / "out").iterdir()} == {*files, "export.json"}
    facts = json.loads((tmp_path / "out" / "export.json").read_text(encoding="utf-8"))
    assert facts["form"] == form
    assert facts["model"]["classes"] == ["a", "b"]
    export(file, "--form", form, *radar, "-o", tmp_path / "out")  # an earlier export is replaced


def test_sizes_are_printed(file, tmp_path):
    radar = ["--radar", "x4", "--prf-hz", "500"]
    text = export(file, "--form", "c", "--int8", *radar, "--still-s", "0", "-o", tmp_path / "out")
    for words in ("flash table bytes", "int8", "left out"):
        assert words in text


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--form", "tflite"], "allowed are c, numpy, onnx"),
        (["--form", "onnx", "--radar", "x4"], "are for --form c"),
        (["--form", "numpy", "--int8"], "are for --form c"),
    ],
)
def test_what_cannot_be_exported_is_refused(file, tmp_path, arguments, words):
    with pytest.raises(ConfigError, match=words):
        export(file, *arguments, "-o", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_other_files_are_not_replaced(file, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "firmware.c").write_text("int main(void) { return 0; }")
    with pytest.raises(ConfigError, match=r"firmware\.c"):
        export(file, "--form", "numpy", "-o", tmp_path / "out")


@pytest.fixture
def _no_torch(monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    monkeypatch.setattr(network, "is_torch_installed", lambda: False)


@pytest.mark.usefixtures("_no_torch")
def test_all_others_run_and_the_line_says_what_to_do(dataset):
    found = evaluate(dataset)
    document = found.document
    assert "signature-network" not in document["models"]
    assert "extended-boosting" in document["models"]
    assert found.best == "ensemble"
    assert any("pip install 'doppelgait[torch]'" in note for note in document["notes"])
    with pytest.raises(DatasetError, match="pip install 'doppelgait"):
        evaluate(dataset, models=["signature-network"])
    with pytest.raises(DatasetError, match="pip install 'doppelgait"):
        network.train_network(LabelledRows(np.empty(0, dtype=object), np.empty(0, int)), None, n_classes=2, seed=0)
