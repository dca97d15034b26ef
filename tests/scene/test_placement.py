"""Scenes as TOML and back; every motion made, scaled and placed once per simulation."""

from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import doppelgait as dg
from doppelgait.core.errors import AnalysisError, ConfigError
from doppelgait.dataset.windows import cut_windows
from doppelgait.motion.retime import Variation
from doppelgait.pipeline import Run, run_simulation
from doppelgait.scene import RcsSpec, Scene, Target, place, placement, side_by_side
from doppelgait.scene.placement import place_all

START = {"start_position_m": (7.0, 1.0), "heading_deg": 170.0}
TARGETS = [
    lambda x: {"motion": {"kind": "boulic", "speed_mps": x, "stride_variation": 0.02}, "range_m": x, "aspect_deg": -x},
    lambda x: {"motion": {"kind": "quadruped", "gait": "trot"}, "rcs": "surfaces", "height_m": x, "background": True},
    lambda x: {
        "motion": {"kind": "human", "start_phase": x / 2},
        "rcs": RcsSpec(total_m2=x, fluctuation="swerling3", total_spread_db=x, occlusion=True),
        "path": {"kind": "arc", "radius_m": x, "turn_deg": 50 * x},
    },
    lambda x: {
        "motion": {"kind": "file", "path": "walk.c3d", "start_s": x, "segment": "longest"},
        "rcs": "body_parts",
        "path": {"kind": "polyline", "points_m": [(0, 0), (2 * x, 0), (2 * x, 3)]},
    },
    lambda x: {"motion": "fan", "path": {"kind": "turn_around", "out_m": x, "radius_m": 0.5, "side_m": 0.3}},
    lambda x: {"motion": "boulic", "rcs": "equal", "path": {"kind": "straight", "speed_mps": x}},
]


@st.composite
def scenes(draw):
    chosen = st.tuples(st.sampled_from(TARGETS), st.floats(1.1, 1.5), st.text(max_size=8))
    tables = [{"label": label, **make(number)} for make, number, label in draw(st.lists(chosen, max_size=3))]
    targets = [Target(**table, **(START if "path" in table else {})) for table in tables]
    if draw(st.booleans()):
        first = Target({"kind": "boulic", "speed_mps": 1.3}, label="human", **START)
        targets += side_by_side(first, Target({"kind": "quadruped", "speed_mps": 1.3}, label="dog"))
    metres, degrees = st.floats(-50, 50), st.floats(-90, 90)
    places = dict.fromkeys(["radar_position_m", "receiver_position_m"], st.tuples(metres, metres, metres))
    options = {**places, "radar_azimuth_deg": degrees, "radar_tilt_deg": degrees}
    return Scene(targets, duration_s=draw(st.floats(0.1, 99)), **draw(st.fixed_dictionaries({}, optional=options)))


@settings(max_examples=25, deadline=None)
@given(scene=scenes(), seed=st.integers(0, 2**40), snr_db=st.floats(-100, 200), auto=st.booleans())
def test_a_run_is_equal_after_toml(scene, seed, snr_db, auto, tmp_path_factory):
    room = [{"kind": "ground_bounce", "roughness_m": 0.01}, {"kind": "wall", "loss_db": 3.0}]
    path = tmp_path_factory.mktemp("runs") / "run.toml"
    run = Run(
        scene=scene, radar=dg.Radar.preset("x4"), auto_prf=auto, seed=seed, example=3,
        noise={"kind": "snr", "snr_db": snr_db}, environment=room, impairments=[{"kind": "phase_noise"}],
        analysis=dg.Analysis(hop=4),
    )  # fmt: skip
    path.write_text(run.to_toml(), encoding="utf-8")
    read = Run.from_toml(path)
    assert read.replace(scene=scene) == run
    assert read.scene == Scene.from_toml(path)


def test_a_motion_in_memory_has_no_toml_form():
    walk = Target(dg.motion.boulic_walk(speed_mps=1.2, duration_s=1.0))
    with pytest.raises(ConfigError, match=r"targets\.1\.motion: boulic is in memory and has no TOML form"):
        Scene([Target({"kind": "boulic"}), walk]).to_toml()


def test_models_are_frozen_and_changed_ones_are_checked():
    scene = Scene([Target({"kind": "boulic"}, range_m=4.0)], duration_s=1.0)
    with pytest.raises(ConfigError, match="frozen"):
        scene.duration_s = 2.0
    assert scene.replace(duration_s=2.0).targets == scene.targets
    with pytest.raises(ConfigError, match=r"Target: range_m: -1\.0 is not allowed"):
        scene.targets[0].replace(range_m=-1.0)


STEPS = ("_check_model", "scale_to_height", "follow", "place_motion")


def test_every_motion_is_made_scaled_and_placed_once_per_simulation(monkeypatch):
    done = Counter()

    def counted(name, step):
        def call(motion, *arguments, **options):
            done[name] += 1
            return step(motion, *arguments, **options)

        return call

    for name in STEPS:
        monkeypatch.setattr(placement, name, counted(name, getattr(placement, name)))
    start = {"start_position_m": (6.0, 0.0), "heading_deg": 180.0}
    scene = Scene(
        [
            Target({"kind": "boulic"}, label="human", height_m=1.6, path={"kind": "straight"}, **start),
            Target({"kind": "quadruped"}, label="dog", height_m=0.5),
            Target({"kind": "fan"}, background=True, start_position_m=(4.0, 1.0), heading_deg=0.0),
        ],
        duration_s=0.5,
        receiver_position_m=(1.0, 0.0, 1.0),
    )
    once = {"_check_model": 3, "scale_to_height": 2, "follow": 1, "place_motion": 2}
    run = Run(scene=scene, radar=dg.Radar.preset("x4", prf_hz=900), auto_prf=True)
    recording = run_simulation(run)
    assert recording.truth[0].body is not None
    assert done == once
    done.clear()
    dg.simulate(place(scene), run.radar)
    assert done == once


def test_scenes_placed_together_are_those_placed_alone():
    walker = {"kind": "human", "step_time_sd": 0.02}
    dog = {"kind": "quadruped", "stride_variation": 0.02, "footfall_sd": 0.01}
    beside = Target(dog, range_m=6.0, vary=Variation(pace=1.1))
    scenes = [
        Scene([Target(walker, range_m=4.0), beside], duration_s=1.0),
        Scene([Target({"kind": "fan"}, range_m=3.0), Target(walker, range_m=5.0)], duration_s=0.5),
        Scene([beside, Target(walker | {"gait": "run", "speed_mps": 3.0}, range_m=4.0)], duration_s=0.7),
    ]
    streams = [dg.rng(seed) for seed in (1, 2, 3)]
    for scene, own, placed in zip(scenes, streams, place_all(scenes, streams), strict=True):
        for alone, together in zip(place(scene, own).targets, placed.targets, strict=True):
            assert alone.motion.position_m.tobytes() == together.motion.position_m.tobytes()
            assert repr(alone.motion.facts) == repr(together.motion.facts)
            assert alone.ground_speed_mps == together.ground_speed_mps


def test_a_refused_target_of_many_scenes_is_named():
    scenes = [Scene([Target({"kind": kind}, range_m=4.0)] * 2, duration_s=1.0) for kind in ("boulic", "human")]
    scenes[1] = scenes[1].replace(
        targets=(scenes[1].targets[0], Target({"kind": "human", "pace_sd": 0.02}, range_m=4.0))
    )
    with pytest.raises(ConfigError, match=r"targets\.1\.motion: .*pace_sd = 0\.02 needs a random generator"):
        next(place_all(scenes, [None, None]))


def visitor(**changes):
    """A walker towards the radar from 6 m who is there from 1 s to 4 s of 6 s."""
    table = {"start_position_m": (6.0, 0.0), "heading_deg": 180.0, "enter_s": 1.0, "leave_s": 4.0, **changes}
    return Target({"kind": "boulic", "speed_mps": 1.2}, "human", **table)


def test_a_body_that_comes_later_moves_as_it_would_from_the_start():
    walk = dg.motion.boulic_walk(speed_mps=1.2, duration_s=3.0)
    late = place(Scene([visitor().model_copy(update={"motion": walk})], duration_s=6.0)).targets[0]
    early = place(Scene([Target(walk, start_position_m=(6.0, 0.0), heading_deg=180.0)], duration_s=3.0)).targets[0]
    rate_hz, stays = late.motion.rate_hz, early.motion.position_m
    first = round(1.0 * rate_hz)
    np.testing.assert_array_equal(late.motion.position_m[first : first + len(stays)], stays)
    away = late.motion.position_m[: first - 8], late.motion.position_m[first + len(stays) + 7 :]
    assert all((part == part[:1]).all() for part in away)  # in its first or last posture, up to a few frames
    assert all(np.abs(part[0] - at).max() < 0.1 for part, at in zip(away, stays[[0, -1]], strict=True))
    assert late.motion.duration_s >= 6.0
    assert late.ground_speed_mps == pytest.approx(early.ground_speed_mps)
    left, moved = (next(iter(one.motion.facts.footfalls.values())) for one in (early, late))
    assert np.array(moved) == pytest.approx(np.array(left) + 1.0)


def test_the_middle_of_the_stay_is_where_a_body_with_a_range_is():
    target = Target({"kind": "boulic", "speed_mps": 1.2}, range_m=4.0, enter_s=2.0, leave_s=4.0)
    placed = place(Scene([target], duration_s=6.0))
    track = dg.scene.compute_body_track(placed.targets[0], placed.scene, [2.0, 3.0, 4.0])
    assert np.hypot(track.range_m, 0) == pytest.approx([5.2, 4.0, 2.8], abs=0.1)


RADAR = dg.Radar.preset("x4", prf_hz=600.0)


@pytest.fixture(scope="module")
def visit():
    return dg.simulate(Scene([visitor()], duration_s=6.0), RADAR)


def test_a_body_is_seen_while_it_is_there_and_appears_without_a_click(visit):
    power = np.square(np.abs(visit.samples.matrix)).sum(axis=1)
    time_s, (truth,) = visit.slow_time_s, visit.truth
    there = (time_s >= 1.0) & (time_s <= 4.0)
    assert (power[~there] == 0).all()
    assert (power[(time_s > 1.05) & (time_s < 3.95)] > 0).all()
    np.testing.assert_array_equal(np.isfinite(truth.centre_range_m), there)
    assert truth.centre_velocity_mps[there].mean() == pytest.approx(1.2, abs=0.05)
    assert np.abs(truth.centre_velocity_mps[there] - 1.2).max() < 0.3  # its own ripple, also where it comes and goes
    assert np.isnan(truth.doppler_hz(0.04)[~there]).all()
    assert len(truth.body["time"]) == pytest.approx(3.0 * 60, abs=2)
    # at once, a body would be as bright beyond all speeds of limbs as a hundredth of itself
    edge = np.abs(np.fft.fft(visit.samples.matrix[550:650] * np.hanning(100)[:, None], axis=0)) ** 2
    assert edge[40:60].sum() < 1e-5 * edge.sum()


def test_a_recording_of_a_visit_is_read_as_it_was_written(tmp_path, visit):
    dg.radar.write_recording(visit, tmp_path / "visit.h5")
    again = dg.radar.read_recording(tmp_path / "visit.h5").truth[0]
    np.testing.assert_array_equal(again.centre_range_m, visit.truth[0].centre_range_m)


def test_the_gate_of_the_truth_is_that_of_the_stay(visit):
    (result,) = dg.analyze(visit, gate="truth")
    (alone,) = dg.analyze(dg.simulate(Scene([visitor(enter_s=0.0, leave_s=None)], duration_s=3.0), RADAR), gate="truth")
    assert (result.gate.start_s, result.gate.stop_s) == pytest.approx((1.0, 4.0), abs=0.01)
    assert result.features.torso_velocity_mps == pytest.approx(alone.features.torso_velocity_mps, abs=0.05)
    (empty, *_) = cut_windows(visit, 0.9, 0.9)
    with pytest.raises(AnalysisError, match="has no truth of a body"):
        dg.analyze(empty.recording, gate="truth")


def test_who_leaves_after_the_end_does_not_fade():
    recordings = [
        dg.simulate(Scene([visitor(enter_s=0.0, leave_s=leave_s)], duration_s=3.0), RADAR) for leave_s in (None, 50.0)
    ]
    np.testing.assert_array_equal(*(one.samples.matrix for one in recordings))


def test_a_recording_may_be_shorter_than_the_scene_if_it_leaves():
    motion = dg.motion.boulic_walk(duration_s=3.0)
    with pytest.raises(ConfigError, match=r"lasts 3\.000 s, but the body is in the scene for 4 s; lower leave_s"):
        place(Scene([Target(motion, enter_s=1.0, leave_s=5.0)], duration_s=6.0))
    assert place(Scene([Target(motion, enter_s=2.0, leave_s=5.0)], duration_s=6.0)).observation_s == 6.0


@pytest.mark.parametrize(
    ("times", "duration_s", "message"),
    [
        ({"enter_s": 3.0}, None, "need the duration_s"),
        ({"enter_s": 3.0, "leave_s": 3.2}, 6.0, "from 3 to 3.2 s"),
        ({"enter_s": 7.0}, 6.0, "stays for 0.6 s or more, within duration_s"),
    ],
)
def test_a_stay_that_is_none_is_refused(times, duration_s, message):
    with pytest.raises(ConfigError, match=message):
        Scene([Target("boulic", **times)], duration_s=duration_s)
