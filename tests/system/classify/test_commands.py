"""``evaluate`` and ``classify`` as commands."""

from __future__ import annotations

import json

import pytest
import typer
from typer.testing import CliRunner

from doppelgait.classify import classify as run_classification
from doppelgait.classify import load_model
from doppelgait.cli.analyze import analyze
from doppelgait.cli.classify import classify, evaluate
from doppelgait.core.errors import ConfigError, DatasetError, RecordingError
from doppelgait.pipeline import parse_run, run_simulation
from doppelgait.radar import read_recording, write_recording
from tiny_dataset import built, tiny_plan

APP = typer.Typer()
APP.command("evaluate")(evaluate)
APP.command("classify")(classify)
APP.command("analyze")(analyze)


def run(*arguments):
    done = CliRunner().invoke(APP, [str(a) for a in arguments])
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    assert done.exit_code == 0, done.output
    return done.stdout


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A report, a kept model, and a recording of somebody who walks up to the radar."""
    target = tmp_path_factory.mktemp("classify")
    dataset = built(tmp_path_factory, tiny_plan())
    text = run("evaluate", dataset, "-o", target / "report", "--models", "six-boosting", "--save", target / "m.npz")
    assert "six-boosting" in text
    assert "nuisance" in text
    recording = run_simulation(parse_run({
        "seed": 1, "duration_s": 3.0, "radar": {"preset": "x4"},
        "targets": [{"label": "human", "motion": {"kind": "boulic", "speed_mps": 1.2}, "start_position_m": [6, 0],
                     "heading_deg": 180}],
    }, where="test"))  # fmt: skip
    write_recording(recording, target / "walk.h5")
    return target


def test_the_report_is_there(folder):
    assert {"index.html", "scores.json", "answers.csv", "plan.json"} <= {p.name for p in (folder / "report").iterdir()}


def test_json_is_the_document(folder, tmp_path_factory, tmp_path):
    dataset = built(tmp_path_factory, tiny_plan())
    document = json.loads(run("evaluate", dataset, "-o", tmp_path / "r", "--models", "six-logistic", "--json"))
    assert document == json.loads((tmp_path / "r" / "scores.json").read_text())
    assert set(document["models"]) == {"chance", "nuisance", "speed", "six-logistic"}


def test_a_recording_is_classified(folder):
    found = json.loads(run("classify", folder / "walk.h5", "--model", folder / "m.npz", "--gate", "truth", "--json"))
    assert found["model"]["classes"] == ["human", "dog"]
    assert len(found["targets"]) == 1
    target = found["targets"][0]
    assert target["label"] in ("human", "dog")
    assert target["abstained"] == bool(target["reason"])
    assert sum(target["probabilities"].values()) == pytest.approx(1)
    text = run("classify", folder / "walk.h5", "--model", folder / "m.npz", "--gate", "truth")
    assert target["label"] in text
    assert "likeliest" in text


def test_a_recording_is_classified_in_windows(folder):
    """A window is what the same part of the recording is alone; the last line says what an alarm is."""
    arguments = ("classify", folder / "walk.h5", "--model", folder / "m.npz", "--window-s", 2.4, "--hop-s", 0.3)
    found = json.loads(run(*arguments, "--json"))
    assert (found["window_s"], found["hop_s"]) == (2.4, 0.3)
    (track,) = found["tracks"]
    assert [one["start_s"] for one in found["windows"]] == pytest.approx([0.0, 0.3, 0.6])
    assert track["windows"] == 3
    assert [found["timeline"][0]["start_s"], found["timeline"][-1]["stop_s"]] == pytest.approx([0.0, 3.0])
    part = read_recording(folder / "walk.h5").between(0.0, 2.4)
    (alone,) = run_classification(part, load_model(folder / "m.npz"))
    assert found["windows"][0]["window"] == alone.as_dict()
    text = run(*arguments)
    assert text.index("evidence") < text.index("timeline") < text.index("reason")


def test_features_of_windows_are_rows(folder):
    arguments = ("analyze", folder / "walk.h5", "--window-s", 2.4, "--hop-s", 0.6)
    found = json.loads(run(*arguments, "--json"))
    assert [(one["track"], one["start_s"]) for one in found["targets"]] == [(0, 0.0), (0, 0.6)]
    assert found["targets"][1]["features"]["torso_velocity_mps"] == pytest.approx(1.2, abs=0.1)
    assert run(*arguments).count("\n") == 3
    with pytest.raises(ConfigError, match="-o: not with --window-s"):
        run(*arguments, "-o", folder / "r.h5")


def test_an_alarm_is_explained(folder):
    done = CliRunner().invoke(APP, ["classify", str(folder / "walk.h5"), "--model", str(folder / "m.npz")])
    assert "note: alarm: " in done.stderr


def test_mistakes_are_one_clear_error(folder, tmp_path_factory, tmp_path):
    dataset = built(tmp_path_factory, tiny_plan())
    for name, says in (("m.pkl", r"must end in \.npz"), ("no/m.npz", "does not exist"), ("r/m.npz", "the report")):
        with pytest.raises(ConfigError, match=rf"^--save .*{says}"):
            run("evaluate", dataset, "-o", tmp_path / "r", "--save", tmp_path / name)
    with pytest.raises(ConfigError, match="which no run of evaluate wrote"):
        run("evaluate", dataset, "-o", dataset)
    with pytest.raises(ConfigError, match="--models: model 'six-net' is not known"):
        run("evaluate", dataset, "-o", tmp_path / "r", "--models", "six-net")
    with pytest.raises(ConfigError, match=r"the folder .* does not exist"):
        run("evaluate", dataset, "-o", tmp_path / "a" / "b")
    with pytest.raises(ConfigError, match="from 2 to 6"):
        run("evaluate", dataset, "-o", tmp_path / "r", "--cv", 7)
    with pytest.raises(DatasetError, match="no finished dataset"):
        run("evaluate", folder, "-o", tmp_path / "r")
    with pytest.raises(DatasetError, match="no model of doppelgait"):
        run("classify", folder / "walk.h5", "--model", folder / "walk.h5")
    with pytest.raises(RecordingError):
        run("classify", folder / "none.h5", "--model", folder / "m.npz")
    assert not list(tmp_path.iterdir())


def test_a_folder_that_is_no_recording_is_one_clear_error(folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(RecordingError):
        run("classify", ".", "--model", folder / "m.npz")


@pytest.mark.shared
def test_a_dog_before_another_radar_is_no_decision(folder, shared):
    """24 GHz, continuous wave: it was called human, decided, alarm."""
    recording = next((shared / "data/radar/cw24_kmkim036/211122").glob("*_RE.txt"))
    found = json.loads(run("classify", recording, "--model", folder / "m.npz", "--json"))
    (target,) = found["targets"]
    assert target["abstained"]
    assert target["alarm"] is None
    for words in ("columns_do_not_overlap", "carrier_hz 2.41e+10 is outside", "prf_hz 3000 is outside"):
        assert words in target["reason"]
    assert found["model"]["calibrated"] is False
    assert "alarm_people" in found["model"]
