"""``evaluate`` and ``classify`` as commands."""

import json
from dataclasses import replace

import pytest

from command import run
from doppelgait.classify import classify as run_classification
from doppelgait.classify import load_model
from doppelgait.classify.report import make_figures
from doppelgait.core.errors import ConfigError, DatasetError, DoppelgaitWarning, RecordingError
from doppelgait.pipeline import parse_run, run_simulation
from doppelgait.radar import Radar, read_recording, write_recording
from doppelgait.radar.frames import write_frames
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
    """A window is what the same part of the recording is alone; the last line says what an alarm is."""
    arguments = (
        "classify",
        own / "walk.h5",
        "--model",
        own / "m.npz",
        "--window-s",
        2.4,
        "--hop-s",
        0.3,
    )
    found = json.loads(text_of(*arguments, "--json"))
    assert (found["window_s"], found["hop_s"]) == (2.4, 0.3)
    (track,) = found["tracks"]
    assert [one["start_s"] for one in found["windows"]] == pytest.approx([0.0, 0.3, 0.6])
    assert track["windows"] == 3
    assert [found["timeline"][0]["start_s"], found["timeline"][-1]["stop_s"]] == pytest.approx([0.0, 3.0])
    part = read_recording(own / "walk.h5").between(0.0, 2.4)
    (alone,) = run_classification(part, load_model(own / "m.npz"))
    assert found["windows"][0]["window"] == alone.as_dict()
    text = text_of(*arguments)
    assert text.index("evidence") < text.index("timeline") < text.index("reason")


def test_a_stream_gives_the_decisions_of_its_file_and_keeps_a_log(own, tmp_path):
    write_frames(read_recording(own / "walk.h5"), tmp_path / "walk.dgf")
    options = ("--model", own / "m.npz", "--window-s", 2.4, "--hop-s", 0.3)
    text = text_of("live", tmp_path / "walk.dgf", *options, "--timeout-s", 0, "--log", tmp_path / "log.jsonl")
    lines = [json.loads(line) for line in text.splitlines()]
    assert (tmp_path / "log.jsonl").read_text() == text
    assert (lines[0]["kind"], lines[-1]["kind"], lines[-1]["reason"]) == ("start", "end", "the source ended")
    assert lines[0]["model"]["classes"] == ["human", "dog"]
    assert lines[-1]["frames"] == lines[-1]["stream"]["received"] == 3000
    found = [{name: value for name, value in line.items() if name != "kind"} for line in lines[1:]]
    found = [line for line, told in zip(found, lines[1:], strict=True) if told["kind"] == "decision"]
    assert found == json.loads(text_of("classify", own / "walk.h5", *options, "--json"))["windows"]


def test_lost_frames_are_told_in_the_stream_and_a_wrong_radar_ends_it(own, tmp_path):
    recording = read_recording(own / "walk.h5")
    write_frames(recording, tmp_path / "walk.dgf")
    content = bytearray((tmp_path / "walk.dgf").read_bytes())
    content[len(content) // 2] ^= 1
    (tmp_path / "walk.dgf").write_bytes(content)
    options = ("--model", own / "m.npz", "--window-s", 2.4, "--timeout-s", 0)
    with pytest.warns(DoppelgaitWarning, match="malformed"), pytest.warns(DoppelgaitWarning, match="are missing"):
        lines = [json.loads(line) for line in text_of("live", tmp_path / "walk.dgf", *options).splitlines()]
    assert lines[-1]["filled"] == lines[-1]["stream"]["malformed"] == 1
    write_frames(replace(recording, radar=Radar.preset("x4", carrier_hz=8.7e9)), tmp_path / "other.dgf")
    both = [(tmp_path / name).read_bytes() for name in ("walk.dgf", "other.dgf")]
    (tmp_path / "both.dgf").write_bytes(both[0][: len(both[0]) - 100] + both[1])
    with pytest.raises(RecordingError, match="another radar"), pytest.warns(DoppelgaitWarning):
        text_of("live", tmp_path / "both.dgf", *options, "--log", tmp_path / "log.jsonl")
    assert "another radar" in json.loads((tmp_path / "log.jsonl").read_text().splitlines()[-1])["reason"]


def test_features_of_windows_are_rows(own):
    arguments = ("analyze", own / "walk.h5", "--window-s", 2.4, "--hop-s", 0.6)
    found = json.loads(text_of(*arguments, "--json"))
    assert [(one["track"], one["start_s"]) for one in found["targets"]] == [(0, 0.0), (0, 0.6)]
    assert found["targets"][1]["features"]["torso_velocity_mps"] == pytest.approx(1.2, abs=0.1)
    assert text_of(*arguments).count("\n") == 3
    with pytest.raises(ConfigError, match="-o: not allowed with --window-s"):
        text_of(*arguments, "-o", own / "r.h5")


def test_mistakes_are_one_clear_error(own, folder, tmp_path, monkeypatch):
    for name, says in (("m.pkl", r"must end in \.npz"), ("no/m.npz", "does not exist"), ("r/m.npz", "the report")):
        with pytest.raises(ConfigError, match=rf"^--save .*{says}"):
            text_of("evaluate", folder, "-o", tmp_path / "r", "--save", tmp_path / name)
    with pytest.raises(ConfigError, match="which no run of evaluate wrote"):
        text_of("evaluate", folder, "-o", folder)
    with pytest.raises(ConfigError, match="--models: model 'six-net' is not known"):
        text_of("evaluate", folder, "-o", tmp_path / "r", "--models", "six-net")
    with pytest.raises(ConfigError, match=r"the folder .* does not exist"):
        text_of("evaluate", folder, "-o", tmp_path / "a" / "b")
    with pytest.raises(ConfigError, match="from 2 to 6"):
        text_of("evaluate", folder, "-o", tmp_path / "r", "--cv", 7)
    with pytest.raises(DatasetError, match="no finished dataset"):
        text_of("evaluate", own, "-o", tmp_path / "r")
    with pytest.raises(DatasetError, match="not a model of doppelgait"):
        text_of("classify", own / "walk.h5", "--model", own / "walk.h5")
    with pytest.raises(RecordingError):
        text_of("classify", own / "none.h5", "--model", own / "m.npz")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(RecordingError):
        text_of("classify", ".", "--model", own / "m.npz")
    assert not list(tmp_path.iterdir())


@pytest.mark.shared
def test_a_dog_before_another_radar_is_no_decision(own, shared):
    """24 GHz, continuous wave: it was called human, decided, alarm."""
    recording = next((shared / "data/radar/cw24_kmkim036/211122").glob("*_RE.txt"))
    found = json.loads(text_of("classify", recording, "--model", own / "m.npz", "--json"))
    (target,) = found["targets"]
    assert target["abstained"]
    assert target["alarm"] is None
    for words in ("columns_do_not_overlap", "carrier_hz 2.41e+10 is outside", "prf_hz 3000 is outside"):
        assert words in target["reason"]
    assert found["model"]["calibrated"] is False
    assert "alarm_people" in found["model"]
