"""Models that come with the package: made for this version, small, chosen by the radar."""

import pytest

import doppelgait as dg
from doppelgait.classify import classify, find_shipped_model, load_shipped_model, model_file, read_model_cards
from doppelgait.classify.decide import choose_model, read_training_analysis
from doppelgait.classify.model_file import FOLDER
from doppelgait.core.errors import ConfigError, DatasetError
from doppelgait.dataset.finish import DATA_VERSION

NAMES = sorted(read_model_cards())


@pytest.mark.parametrize("name", NAMES)
def test_a_model_is_of_this_data_version_and_its_card_tells_what_it_is(name):
    card, model = read_model_cards()[name], load_shipped_model(name)
    assert card["data_version"] == DATA_VERSION, "rebuild: python tools/train_models.py"
    assert card["dataset"] == model.facts.dataset_id
    assert tuple(card["classes"]) == model.facts.classes == ("human", "animal")
    assert card["conditions"] == {key: list(span) for key, span in model.facts.conditions.items()}
    assert "synthetic" in card["trained_on"]
    assert set(card["recorded_movers"]) == {"all", "held", "tuning", "by_gait"}
    assert (FOLDER / f"{name}.npz").stat().st_size < 700_000
    assert card["synthetic_test"]["balanced_accuracy"]["value"] > 0.85
    assert len(model.learned.members) == 3  # with its network
    assert model.track.facts.alarm == model.facts.alarm == "human"
    assert card["track"]["conditions"] == {key: list(span) for key, span in model.track.facts.conditions.items()}


@pytest.mark.parametrize(
    ("carrier_hz", "prf_hz", "name"),
    [
        (7.29e9, 500, "x4"),
        (7.29e9, 1740, "x4"),
        (24e9, 1000, "fmcw-24"),
        (61e9, 5434, "fmcw-60"),
    ],
)
def test_the_radar_chooses(carrier_hz, prf_hz, name):
    assert find_shipped_model(carrier_hz, prf_hz) == name


@pytest.mark.parametrize(("carrier_hz", "prf_hz"), [(7.29e9, 17), (7.29e9, 3000), (9.7e9, 1000), (77e9, 3200)])
def test_a_radar_that_none_knows_is_told_so(carrier_hz, prf_hz):
    with pytest.raises(ConfigError, match=r"no shipped model .*; there are .*x4 \(7.29 GHz, 500"):
        find_shipped_model(carrier_hz, prf_hz)


def test_a_changed_model_is_refused(tmp_path, monkeypatch):
    (tmp_path / "x4.npz").write_bytes((FOLDER / "x4.npz").read_bytes()[:-1] + b"x")
    (tmp_path / "x4.json").write_bytes((FOLDER / "x4.json").read_bytes())
    monkeypatch.setattr(model_file, "FOLDER", tmp_path)
    with pytest.raises(DatasetError, match=r"x4\.npz: is not the model that came with this version"):
        load_shipped_model.__wrapped__("x4")


def test_no_shipped_model_is_for_bursts():
    radar = dg.Radar.preset("ti-60-burst")
    recording = dg.simulate(dg.Scene([], duration_s=0.6), radar)
    with pytest.raises(ConfigError, match="no shipped model is for frames in bursts"):
        choose_model(recording)


@pytest.mark.parametrize(
    ("motion", "label"),
    [(lambda: dg.motion.boulic_walk(speed_mps=1.2, height_m=1.75, duration_s=3.0), "human"),
     (lambda: dg.motion.quadruped_gait(gait="trot", withers_m=0.5, speed_mps=1.6, duration_s=3.0), "animal")],
)  # fmt: skip
def test_who_goes_is_decided_without_naming_a_model(motion, label):
    scene = dg.Scene([dg.Target(motion(), range_m=5.0, aspect_deg=0.0)], radar_position_m=(0, 0, 1), duration_s=3.0)
    recording = dg.simulate(scene, dg.Radar.preset("x4"), rng=dg.Streams(3))
    assert choose_model(recording) is load_shipped_model("x4")
    decision = classify(recording, gate="truth")[0]
    assert (decision.label, decision.abstained) == (label, False), decision.reason
    results = dg.analyze(recording, gate="truth", analysis=read_training_analysis(load_shipped_model("x4")))
    assert choose_model(results) is load_shipped_model("x4")
    assert classify(results)[0].probabilities == pytest.approx(decision.probabilities)
