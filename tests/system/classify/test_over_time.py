"""Decisions over time, from simulated rooms to the shipped model's answers."""

import tomllib

import numpy as np
import pytest

from checkout import ROOT
from doppelgait.classify import classify_over_time
from doppelgait.core.rng import rng
from doppelgait.motion import generate
from doppelgait.pipeline import parse_run, run_simulation, simulate
from doppelgait.radar import Radar
from doppelgait.scene import Scene, Target

pytestmark = pytest.mark.filterwarnings("ignore::doppelgait.core.errors.DoppelgaitWarning")


def decided(found):
    """The labels that were decided about every track, without None."""
    tracks = {}
    for one in found:
        tracks.setdefault(one.track, []).append(one.label)
    return {track: {label for label in labels if label} for track, labels in tracks.items()}


def test_the_person_of_the_example_room_is_decided():
    run = parse_run(tomllib.loads((ROOT / "examples/room.toml").read_text(encoding="utf-8")), where="room")
    found = classify_over_time(run_simulation(run))
    assert {"human"} in decided(found).values()
    assert set.union(*decided(found).values()) == {"human"}


def test_person_and_dog_who_pass_each_other_are_decided():
    person = generate(
        {"kind": "human", "speed_mps": 0.8, "height_m": 1.75}, duration_s=9.0, rng=np.random.default_rng(1)
    )
    dog = generate(
        {"kind": "quadruped", "gait": "walk", "withers_m": 0.5, "froude": 0.15}, duration_s=9.0,
        rng=np.random.default_rng(2),
    )  # fmt: skip
    scene = Scene([
        Target(person, label="human", range_m=5.0, aspect_deg=10.0),
        Target(dog, label="dog", range_m=5.0, aspect_deg=170.0, bearing_deg=8.0),
    ])  # fmt: skip
    recording = simulate(scene, Radar.preset("x4", prf_hz=1000.0), rng=rng(7), snr_db=18.0)
    found = classify_over_time(recording)
    labels = decided(found)
    assert {"human"} in labels.values()
    assert {"animal"} in labels.values()
    assert all(len(one) <= 1 for one in labels.values())
    for one in found:
        if one.label is not None and not one.window.blocked:
            assert one.label == ("human" if one.approach_mps > 0 else "animal")
    person_m, dog_m = (truth.centre_range_m for truth in recording.truth)
    meet_s = float(recording.slow_time_s[np.abs(person_m - dog_m).argmin()])
    # overlap is judged per window: there is evidence before they meet and after
    evidence_s = [one.stop_s for one in found if not one.window.blocked]
    assert min(evidence_s) < meet_s + 0.1  # of the window that ends as they meet
    assert max(evidence_s) > meet_s + 3.0
