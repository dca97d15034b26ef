"""What the study of everyday scenes counts as true, near enough, flagged and silently wrong."""

import math
from dataclasses import replace
from importlib import import_module
from types import ModuleType

import numpy as np
import pytest

import doppelgait as dg
from doppelgait.pipeline import analyze, simulate
from doppelgait.radar import Radar
from doppelgait.scene import Scene, Target
from doppelgait.scene.placement import place

SPEED_MPS = 1.2


def walker(study: ModuleType, **where: object) -> object:
    """An even walker as the study knows the bodies of a scene, the radar at the origin."""
    motion = {"kind": "human", "speed_mps": SPEED_MPS}
    placed = place(Scene([Target(motion, **where)], radar_position_m=(0.0, 0.0, 1.0), duration_s=6.0))
    return study.Body(placed.observed[0], None, (0.0, 0.0, 1.0), 6.0)  # the scatterers give B_mu alone


def test_truth_of_an_interval_is_that_of_the_straight_line(study: ModuleType) -> None:
    """At y = 3 m from x = 6 m in -x: closed forms of radial velocity, speed and aspect from 1 to 5 s."""
    body = walker(study, start_position_m=(6.0, 3.0), heading_deg=180.0)
    true = body.during(1.0, 5.0)
    first_m, last_m = math.hypot(6 - SPEED_MPS, 3), math.hypot(6 - 5 * SPEED_MPS, 3)
    assert true["v"] == pytest.approx((first_m - last_m) / 4, rel=0.02)
    assert true["ground"] == pytest.approx(SPEED_MPS, rel=0.02)
    assert true["aspect"] == pytest.approx(math.degrees(math.atan2(3, 6 - 3 * SPEED_MPS)), abs=3.0)
    facts = body.placed.motion.facts
    assert true["f"] == pytest.approx(facts.step_frequency_hz, rel=1e-6)
    assert true["L"] == pytest.approx(true["v"] / facts.step_frequency_hz)


def test_a_pause_does_not_slow_the_steps(study: ModuleType) -> None:
    path = {"kind": "stop_and_go", "stops": [{"at_m": 2.5, "pause_s": 1.5}], "acceleration_mps2": 10.0}
    body = walker(study, start_position_m=(8.0, 0.0), heading_deg=180.0, path=path)
    even = walker(study, start_position_m=(8.0, 0.0), heading_deg=180.0)
    assert body.during(0.0, 6.0)["f"] == pytest.approx(even.during(0.0, 6.0)["f"], rel=0.03)
    assert body.during(0.0, 6.0)["ground"] < 0.8 * SPEED_MPS
    assert body.during(2.5, 3.2)["f"] is None


def test_bandwidth_of_a_target_is_that_of_it_alone(study: ModuleType) -> None:
    """Two people 5 m apart: each has the width of a recording of nobody else."""
    radar = Radar.preset("x4", prf_hz=500)
    both = [
        Target({"kind": "human", "speed_mps": mps}, rcs="body_parts", start_position_m=(x_m, 0.0), heading_deg=180.0)
        for mps, x_m in ((0.8, 4.0), (1.2, 9.0))
    ]
    scenes = [study.Setup(Scene(chosen, duration_s=3.0), radar) for chosen in (both, both[1:])]
    (recording, bodies), (_, (alone,)) = (study.observe(one, dg.rng(3)) for one in scenes)
    lone = simulate(scenes[1].scene, radar, angles=False)
    (result,) = analyze(lone, gate="truth")
    named = replace(result, quality={**result.quality, "start_s": 0.0, "stop_s": 3.0})
    wanted_hz = result.features.doppler_bandwidth_hz
    assert study.true_bandwidth_hz(bodies[1], recording, named) == pytest.approx(wanted_hz, rel=1e-3)
    assert study.true_bandwidth_hz(bodies[0], recording, named) < 0.9 * wanted_hz
    assert study.true_bandwidth_hz(alone, recording, named) == pytest.approx(wanted_hz, rel=1e-3)


def test_only_who_travels_in_the_frame_is_a_target(study: ModuleType) -> None:
    radar = Radar.preset("x4")
    assert walker(study, start_position_m=(8.0, 0.0), heading_deg=180.0).moves(radar)
    assert not walker(study, start_position_m=(12.0, 0.0), heading_deg=0.0).moves(radar)


@pytest.mark.parametrize(
    ("quantity", "found", "true", "right"),
    [
        ("v", 1.1, 1.01, True), ("v", 1.12, 1.01, False), ("v", -1.0, 1.0, False), ("v", 0.04, 0.0, True),
        ("aspect", -14.0, 0.0, True), ("aspect", 47.0, 0.0, False), ("B", 88.0, 100.0, False), ("f", 1.0, None, False),
        ("L", 0.02, 0.0, True), ("L", 0.04, 0.0, False),
    ],
)  # fmt: skip
def test_near_enough(study: ModuleType, quantity: str, found: float, true: float | None, right: bool) -> None:
    assert study.is_right(quantity, found, true, 2.0) is right


def test_flags_excuse_what_they_concern(study: ModuleType) -> None:
    assert study.concerns("low_confidence") == {"f", "L"}
    assert study.concerns("doppler_bandwidth_hz:uncertain_by_more_than_20_per_cent") == {"B"}
    assert study.concerns("step_length,harmonic_ratios,limb_torso_ratio:need_a_gait_frequency") == {"L"}
    assert study.concerns("no_steady_piece:too_short") == set(study.QUANTITIES)
    assert study.concerns("harmonic_ratio_2:no_peak_6_db_above_its_surroundings") == set()
    truths = [{"f": 2.0}, {"f": 1.5}]
    assert study.state("f", 1.52, truths, set()) == "right"
    assert study.state("f", 1.52, truths, {"f"}) == "cautious"
    assert study.state("f", 4.0, truths, {"B"}) == "silent"
    assert study.state("f", 4.0, truths, {"f"}) == "flagged"
    assert study.state("f", None, truths, set()) == "null"


@pytest.mark.parametrize(
    ("distances_m", "targets", "state", "wrong"),
    [
        ([[0.1]], 1, "right", (0, 0, 0)),
        ([[0.1, 0.5]], 2, "silent", (1, 0, 0)),
        ([[0.1, 0.5], [0.2, 0.3]], 2, "right", (0, 0, 0)),
        ([[0.1], [2.0]], 1, "silent", (0, 1, 0)),
        ([[0.1], [0.2]], 1, "silent", (0, 0, 1)),
        ([[3.0]], 1, "silent", (1, 1, 0)),
        (np.zeros((1, 0)), 0, "silent", (0, 1, 0)),
        (np.zeros((0, 2)), 2, "silent", (2, 0, 0)),
        (np.zeros((0, 0)), 0, "right", (0, 0, 0)),
    ],
)
def test_number_of_targets(
    study: ModuleType, distances_m: object, targets: int, state: str, wrong: tuple[int, int, int]
) -> None:
    found = study.number_state(np.array(distances_m, dtype=float), targets, flagged=False)
    assert found == (state, dict(zip(("missing", "false", "twice"), wrong, strict=True)))
    assert study.number_state(np.array(distances_m, dtype=float), targets, flagged=True)[0] in ("cautious", "flagged")


def test_every_scene_can_be_drawn_and_is_drawn_alike(study: ModuleType) -> None:
    scenes = import_module("everyday_scenes").SCENES
    assert len(scenes) >= 60
    for kind in (scenes["walk, aspect 45"], scenes["fan"], scenes["CW 10 GHz, sitter"]):
        one, other = (kind(np.random.default_rng(7)) for _ in range(2))
        assert one.scene.duration_s == other.scene.duration_s
        assert [impairment["kind"] for impairment in one.impairments] == ["static_clutter", "phase_noise"]
