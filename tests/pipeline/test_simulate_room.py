"""Rooms seen 80 times a second against every pulse."""

import importlib

import numpy as np
import pytest

import doppelgait as dg
from doppelgait.pipeline import Conditions
from doppelgait.scene.environment import make_effect

simulation = importlib.import_module("doppelgait.pipeline.simulate")

FLOOR = {"kind": "ground_bounce"}
GHOSTS = {"kind": "wall_ghost", "material": "concrete", "thickness_m": 0.1, "side_m": 0.5, "side": "right"}
WALL = {"kind": "wall", "material": "plasterboard", "thickness_m": 0.0125}
NARROW = {"kind": "cosine", "hpbw_azimuth_deg": 55, "hpbw_elevation_deg": 55}


@pytest.fixture(scope="module")
def bodies():
    return {
        "sprinter": dg.motion.human_gait(speed_mps=6.0, gait="run", duration_s=1.6),
        "gallop": dg.motion.quadruped_gait(gait="gallop", speed_mps=6.0, duration_s=1.6),
        "walker": dg.motion.human_gait(speed_mps=1.3, duration_s=1.6),
    }


def seen(monkeypatch, motion, effects, *, every_pulse, antenna=NARROW, prf_hz=1000.0, **place):
    """The samples, and whether a look at every pulse was needed."""
    found = []
    through_room = simulation.apply_room

    def watched(*args):
        table = None if every_pulse else through_room(*args)
        found.append(table is None)
        return table

    with monkeypatch.context() as patch:
        patch.setattr(simulation, "apply_room", watched)
        target = dg.Target(motion, label="target", **place)
        scene = dg.Scene([target], duration_s=1.2, radar_position_m=(0.0, 0.0, 1.2))
        conditions = Conditions(environment=[make_effect(effect) for effect in effects], noise={"kind": "none"})
        radar = dg.Radar.preset("x4", prf_hz=prf_hz, antenna=antenna)
        recording = dg.simulate(scene, radar, conditions=conditions, angles=False)
    return recording.baseband.values, found == [True]


@pytest.mark.filterwarnings("ignore::doppelgait.core.errors.DoppelgaitWarning")
@pytest.mark.parametrize("effects", [[], [FLOOR], [GHOSTS], [FLOOR, GHOSTS, WALL]])
@pytest.mark.parametrize(
    ("body", "place"),
    [
        ("sprinter", {"range_m": 2.5, "aspect_deg": 90, "bearing_deg": 40}),
        ("gallop", {"range_m": 1.2, "aspect_deg": 90, "bearing_deg": 30}),
        ("gallop", {"range_m": 6.0, "aspect_deg": 0, "bearing_deg": 30}),
        ("walker", {"range_m": 2.0, "aspect_deg": 30, "bearing_deg": 20}),
    ],
)
def test_looks_are_close_enough_for_the_fastest_target_and_the_nearest_wall(monkeypatch, bodies, body, place, effects):
    found, _ = seen(monkeypatch, bodies[body], effects, every_pulse=False, **place)
    wanted, _ = seen(monkeypatch, bodies[body], effects, every_pulse=True, **place)
    assert np.abs(found - wanted).max() < 1e-4 * np.abs(wanted).max()


def test_a_walker_in_a_room_is_looked_at_less_often_than_pulses(monkeypatch, bodies):
    place = {"range_m": 4.0, "bearing_deg": 10}
    found, every_pulse = seen(monkeypatch, bodies["walker"], [FLOOR, GHOSTS, WALL], every_pulse=False, **place)
    wanted, _ = seen(monkeypatch, bodies["walker"], [FLOOR, GHOSTS, WALL], every_pulse=True, **place)
    assert not every_pulse
    assert np.linalg.norm(found - wanted) < 1e-5 * np.linalg.norm(wanted)


@pytest.mark.filterwarnings("ignore::doppelgait.core.errors.DoppelgaitWarning")
@pytest.mark.parametrize(
    ("effects", "options"),
    [
        ([{"kind": "visibility", "gain_db": [[0.4, -200.0], [0.41, 0.0]]}], {}),
        ([FLOOR], {"prf_hz": 150.0}),
        ([{**GHOSTS, "side": "left", "side_m": 0.3}], {}),  # through a scatterer's path
        ([{"kind": "wall", "loss_db": 6, "range_m": 3.5, "normal_azimuth_deg": 0}], {}),
    ],
)
def test_every_pulse_counts_where_something_jumps_or_pulses_are_rare(monkeypatch, bodies, effects, options):
    place = {"range_m": 4.0, "bearing_deg": 3, "aspect_deg": 20}
    _, every_pulse = seen(monkeypatch, bodies["walker"], effects, every_pulse=False, **place, **options)
    assert every_pulse


@pytest.mark.parametrize("angles", [False, True])
def test_samples_do_not_depend_on_the_angles_in_the_truth(bodies, angles):
    scene = dg.Scene([dg.Target(bodies["walker"], label="human")], duration_s=1.2)
    conditions = Conditions(environment=[make_effect(FLOOR)], noise={"kind": "none"})
    radar = dg.Radar.preset("x4", prf_hz=1000.0, antenna=NARROW)
    found = dg.simulate(scene, radar, conditions=conditions, angles=angles)
    assert found.baseband.values.tobytes() == dg.simulate(scene, radar, conditions=conditions).baseband.values.tobytes()
    if angles:
        assert np.isfinite(found.truth[0].scatterers["azimuth"].values).all()
