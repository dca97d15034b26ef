"""Verdicts against mirror images and folded ranges that are computed here, and against simulated rooms."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from doppelgait.cli.analyze import print_features
from doppelgait.core.rng import rng
from doppelgait.motion import boulic_walk
from doppelgait.motion.models import crawling_person, robot_vacuum
from doppelgait.pipeline import Conditions, Result, analyze, describe_results, simulate, verdicts
from doppelgait.pipeline.result import TargetList
from doppelgait.pipeline.verdicts import TrackStrip, judge, judge_body, judge_fold, judge_reflection, mark_result
from doppelgait.processing import Analysis, Gate
from doppelgait.processing.patches import draw_pictures
from doppelgait.radar import Radar
from doppelgait.scene import Scene, Target

TIME_S = np.arange(0.0, 4.0, 0.05)
VELOCITY_MPS = np.linspace(-4.0, 4.0, 161)
X4 = Radar.preset("x4")
BODY_DB, RHYTHM_HZ = -20.0, 1.8


def seen(range_m, *, level_db=BODY_DB, time_s=TIME_S, rhythm_hz=RHYTHM_HZ, parts=((0.0, 0.2, 1.0),)):
    """Make a target whose power at 1 m is the level; its parts are offset, width in m/s and share.

    The first part swings with the rhythm.
    """
    approach_mps = -np.gradient(range_m, time_s)
    swing_mps = 0.3 * np.sin(2 * np.pi * rhythm_hz * time_s)
    width = 0.2 + 0.08 * np.sin(2 * np.pi * rhythm_hz * time_s + 1.0)
    power = np.zeros((time_s.size, VELOCITY_MPS.size))
    for number, (offset, spread, share) in enumerate(parts):
        centre = approach_mps + offset + (swing_mps if number == 0 else 0.0)
        broad = width if number == 0 and rhythm_hz else np.full(time_s.size, spread)
        shape = np.exp(-(((VELOCITY_MPS - centre[:, None]) / broad[:, None]) ** 2))
        power += share * shape / shape.sum(axis=1, keepdims=True)
    power *= (10 ** (level_db / 10) / range_m**4)[:, None]
    return TrackStrip(time_s, range_m, approach_mps, power, VELOCITY_MPS)


def walk(x_m, y_m, wall_m=2.0):
    """Return range of a body and distance of its mirror image in the wall y = wall_m."""
    return np.hypot(x_m, y_m), np.hypot(x_m, 2 * wall_m - y_m)


X_M, Y_M = 7.0 - 1.3 * TIME_S, 0.2 + 0.05 * TIME_S
DIRECT_M, IMAGE_M = walk(X_M, Y_M)


@pytest.mark.parametrize("path", ["one way", "both ways"])
def test_a_mirror_image_is_a_reflection(path):
    range_m = IMAGE_M if path == "both ways" else (DIRECT_M + IMAGE_M) / 2
    found = judge_reflection(seen(range_m, level_db=BODY_DB - 12), seen(DIRECT_M), 3, (1.8, 1.81))
    assert found is not None
    assert (found.kind, found.flags) == ("reflection", ("reflection_of:3",))
    evidence = dict(found.evidence)
    assert evidence["mirror_level_db"] == pytest.approx(-12.0, abs=0.3)
    assert evidence["mirror_product_m2"] == pytest.approx(2.0 * (2.0 - Y_M.mean()), rel=0.05)  # radar and body to wall
    assert evidence["mirror_error_m"] < 0.01


@pytest.mark.parametrize("ranges_m", [(DIRECT_M, IMAGE_M), (IMAGE_M, DIRECT_M)], ids=["first", "second"])
def test_a_verdict_marks_its_target_and_not_the_body(ranges_m, monkeypatch):
    def observe(gate, *settings, span_m=0.5):
        return seen(gate.centre_m, level_db=BODY_DB - 12 * np.array_equal(gate.centre_m, IMAGE_M))

    monkeypatch.setattr(verdicts, "observe_strip", observe)
    monkeypatch.setattr(verdicts, "load_network", lambda: network(body=4.0))
    monkeypatch.setattr(Gate, "crop", lambda gate, frames: frames)
    gates = [Gate.around(TIME_S, range_m, span_m=1.6, source="track") for range_m in ranges_m]
    results = [Result(Analysis(), gate_limits=gate, quality={"track_start_s": 0.0}) for gate in gates]
    clean = SimpleNamespace(range_m=np.linspace(0.4, 9.4, 180), samples=SimpleNamespace(in_memory=False))
    marked = judge(results, clean, Analysis(), X4)
    body, ghost = marked if ranges_m[0] is DIRECT_M else marked[::-1]
    assert (body.verdict, body.flags, ghost.verdict) == ("body", (), "reflection")
    assert ghost.flags == (f"reflection_of:{marked.index(body)}",)
    assert ghost.quality["mirror_error_m"] < 0.01


def test_a_strong_reflection_needs_the_same_rhythm():
    ghost_m, body = (DIRECT_M + IMAGE_M) / 2, seen(DIRECT_M)
    assert judge_reflection(seen(ghost_m), body, 0, None) is not None
    assert judge_reflection(seen(ghost_m, rhythm_hz=2.3), body, 0, None) is None


def weak(range_m):
    return seen(range_m, level_db=BODY_DB - 12)


BODY, IN_STEP = seen(DIRECT_M), (1.8, 1.8)
SLOWLY_M = 9.0 - 0.75 * TIME_S
CLOSE_M, CLOSE_IMAGE_M = walk(X_M, 1.5 + 0.0 * TIME_S)  # 0.3 to 0.7 m apart


@pytest.mark.parametrize(
    ("ghost", "body", "rhythms"),
    [
        pytest.param(weak(DIRECT_M + 1.2), BODY, IN_STEP, id="follows in step"),
        pytest.param(weak(DIRECT_M + 1.2 + 0.6 * TIME_S), BODY, IN_STEP, id="falls behind"),
        pytest.param(weak(IMAGE_M), BODY, (2.4, 1.8), id="own rhythm"),
        pytest.param(weak(DIRECT_M - 0.9 + 0.02 * TIME_S), BODY, IN_STEP, id="nearer"),
        pytest.param(weak(SLOWLY_M + 1.2), seen(SLOWLY_M), None, id="slow"),
        pytest.param(weak(SLOWLY_M + 1.2 + 0.6 * TIME_S), seen(SLOWLY_M), None, id="slow, behind"),
        pytest.param(weak(CLOSE_IMAGE_M), seen(CLOSE_M), None, id="within the body"),
        pytest.param(seen(IMAGE_M, level_db=BODY_DB - 5, rhythm_hz=2.1), BODY, None, id="strong"),
        pytest.param(weak(IMAGE_M), BODY.between(0.0, 2.0), None, id="outlasts"),
    ],
)
def test_what_is_no_reflection(ghost, body, rhythms):
    assert judge_reflection(ghost, body, 0, rhythms) is None


FOLDING_M = X4.waveform.unambiguous_range_m(X4)


def leaving(speed_mps=1.4, *, beyond_m=FOLDING_M, level_db=BODY_DB):
    """Return the track up to the end of the frame and the one of the folded echo from 0.4 m on."""
    long_s = np.arange(0.0, 9.0, 0.05)
    range_m = 3.0 + speed_mps * long_s
    first, second = range_m < 9.5, range_m > FOLDING_M + 0.4
    own = seen(range_m[second], time_s=long_s[second], level_db=level_db)  # the level of its true range
    folded = TrackStrip(own.time_s, own.range_m - beyond_m, own.approach_mps, own.power_v2, VELOCITY_MPS)
    return seen(range_m[first], time_s=long_s[first]), folded


def test_a_body_that_leaves_goes_on_as_its_folded_echo():
    body, echo = leaving()
    found = judge_fold(echo, body, 0, folding_m=FOLDING_M, frame_stop_m=9.66)
    assert found is not None
    assert (found.kind, found.flags) == ("folded", ("folded_echo_of:0",))
    evidence = dict(found.evidence)
    assert evidence["fold_error_m"] == pytest.approx(0.0, abs=0.02)
    assert evidence["fold_level_db"] == pytest.approx(0.0, abs=0.1)


def test_another_body_near_the_radar_is_no_folded_echo():
    body, _ = leaving()
    _, elsewhere = leaving(beyond_m=FOLDING_M - 0.5)
    _, strong = leaving(level_db=BODY_DB + 30)  # as one who really is there
    faster = [leaving(2.0, beyond_m=FOLDING_M + shift_m)[1] for shift_m in np.arange(-6.0, 6.0, 0.2)]
    for other in (elsewhere, strong, *faster):
        assert judge_fold(other, body, 0, folding_m=FOLDING_M, frame_stop_m=9.66) is None


def test_a_picture_shows_the_power_about_the_own_velocity():
    """Cells of 0.125 m/s, columns of 0.1 s: on the own velocity, 1.5 m/s ahead of it, and nothing 2 m/s behind."""
    approach = np.linspace(0.5, 1.5, TIME_S.size)
    rows, power = np.arange(TIME_S.size), np.zeros((TIME_S.size, VELOCITY_MPS.size))
    for ahead_mps, share in ((0.0, 1.0), (1.5, 0.1)):
        power[rows, np.rint((approach + ahead_mps + 4.0) / 0.05).astype(int)] = share
    one = TrackStrip(TIME_S, 7.0 - TIME_S, approach, power, VELOCITY_MPS)
    aligned = verdicts.align_power(one)
    np.testing.assert_allclose(aligned[:, 31:33].sum(axis=1), 1.0, rtol=1e-5)
    np.testing.assert_allclose(aligned[:, 43:45].sum(axis=1), 0.1, rtol=1e-5)

    levels = np.array([0.0, 0.1, 0.1, 0.1, 0.1, 0.1, 1.0, 0.0, 0.0, 0.0, 0.0])
    pictures = draw_pictures(levels[:, None, None] * aligned, approach[::2])
    assert pictures.shape == (1, 11, 32, 64)
    assert pictures[0, 5].max() == pytest.approx(1.0 - 10.0 / 45.0, abs=1e-6)
    assert pictures[0, 6, :, 17:20].max() == 0.0

    receding = TrackStrip(TIME_S, 3.0 + TIME_S, -approach, power[:, ::-1], VELOCITY_MPS)
    mirrored = draw_pictures(verdicts.align_power(receding)[np.newaxis], -approach[::2])
    assert mirrored[0, 5] == pytest.approx(pictures[0, 6], abs=1e-5)  # ahead is upwards
    assert [len(draw_pictures(np.ones((1, n, 64)), np.ones(n))) for n in (5, 48, 36_000)] == [1, 2, 64]


def test_a_way_is_its_length_its_speed_and_its_turns():
    back = np.where(TIME_S < 2.0, 1.0, -1.0)
    found = verdicts.measure_way(TrackStrip(TIME_S, 7.0 - np.cumsum(back) * 0.05, back, back, VELOCITY_MPS))
    assert (found["net_way"], found["turns_per_s"]) == (pytest.approx(0.0), pytest.approx(0.25))
    assert 10 ** found["range_span"] == pytest.approx(2.0, abs=0.06)


PICTURES = np.zeros((2, 11, 32, 64), np.float32)
PICTURES[1, 5] = 1.0


def network(*, body=0.0, several=-4.0, values=(0.0, 0.0)):
    """Make a network of two values and one layer, which sums the middle slice; it counts only in the second logit."""
    kernel = np.zeros((1, 11, 3, 3), np.float32)
    kernel[0, 5, 1, 1] = 1.0
    layer = {"kernel_0": kernel, "scale_0": np.full(1, 2.0), "bias_0": np.full(1, 0.5)}
    rest = {"hidden": np.array([[0.0, 0.0, *values], [0.0, 1.0, 0.0, 0.0]]), "offsets": np.array([0.5, 0.0])}
    rest |= {"output": np.array([[2.0, 0.0], [0.0, 1.0]]), "shifts": np.array([body - 1.0, several])}
    return {"names": ["way", "bend"], "mean": [2.0, 1.0], "sd": [0.5, 2.0], **layer, **rest}


def test_probabilities_are_those_of_the_network_and_what_is_missing_counts_as_its_mean(monkeypatch):
    monkeypatch.setattr(verdicts, "load_network", lambda: network(values=(1.5, -1.0)))
    body, several = verdicts.compute_probabilities({"way": 3.0, "bend": float("nan")}, PICTURES)
    assert body == pytest.approx(1 / (1 + np.exp(-(2.0 * (0.5 + 1.5 * 2.0) - 1.0))), abs=1e-4)
    assert several == pytest.approx(1 / (1 + np.exp(4.0 - (0.5 + 2.5) / 2)), abs=1e-4)  # mean of both pictures
    assert verdicts.compute_probabilities({"way": -5.0}, PICTURES)[0] == pytest.approx(1 / (1 + np.exp(1.0)), abs=1e-4)


@pytest.mark.parametrize(
    ("logit", "kind", "flags"),
    [
        (4.0, "body", ()),
        (0.8, "unknown", ("unknown_target:body_or_thing",)),  # 69 %
        (-4.0, "thing", ("not_a_moving_body:moves_like_a_thing",)),
    ],
)
def test_a_target_of_middling_evidence_is_unknown(logit, kind, flags, monkeypatch):
    monkeypatch.setattr(verdicts, "load_network", lambda: network(body=logit))
    found = judge_body(Result(Analysis()), seen(DIRECT_M), PICTURES[0])
    assert (found.kind, found.flags) == (kind, flags)
    results = TargetList(2 * [mark_result(Result(Analysis()), found)])
    assert (results.n_bodies, results.n_unknown) == (2 * (kind == "body"), 2 * (kind == "unknown"))


def test_every_weight_has_its_value():
    facts = analyze(recorded(Target(boulic_walk(duration_s=5.0), label="human", range_m=4.5)))[0]
    known = {*verdicts.measure_way(seen(DIRECT_M)), *facts.extended, *facts.quality, "without_range"}
    assert {*verdicts.load_network()["names"]} <= known


def recorded(*targets, seed=1, environment=()):
    conditions = Conditions(environment=environment, impairments=[{"kind": "phase_noise", "white_rad": 0.002}])
    return simulate(Scene(list(targets)), X4, rng=rng(seed), snr_db=20.0, conditions=conditions)


VACUUM = Target(
    robot_vacuum(speed_mps=0.3, brush_hz=2.0, duration_s=6.0), label="vacuum", range_m=4.5, rcs={"total_m2": 0.05}
)


def test_a_vacuum_is_a_thing_and_not_counted(capsys):
    recording = recorded(VACUUM)
    results = analyze(recording)
    assert [one.verdict for one in results] == ["thing"]
    assert not results[0].is_body
    document = describe_results(recording, results)
    assert document["n_bodies"] == 0
    assert document["targets"][0]["quality"]["verdict"] == "thing"
    print_features(results)
    shown = capsys.readouterr().out
    assert "0: thing" in shown
    assert "bodies: 0 in 1 targets" in shown
    back = Result.from_json(json.loads(json.dumps(results[0].to_json())))
    assert back.verdict == "thing"
    assert Result.from_row(results[0].to_row(), results[0].analysis).verdict == "thing"


@pytest.mark.parametrize(
    "motion",
    [boulic_walk(speed_mps=1.2, height_m=1.75, duration_s=5.0), crawling_person(speed_mps=0.4, duration_s=6.0)],
)
def test_a_walker_and_a_crawler_are_bodies_without_a_flag(motion):
    (found,) = analyze(recorded(Target(motion, label="human", range_m=4.5)))
    assert found.verdict == "body"
    assert found.is_body
    assert not [flag for flag in found.flags if flag.startswith(("not_a", "reflection", "folded"))]


def test_results_without_tracking_have_no_verdict():
    (found,) = analyze(recorded(VACUUM), gate="truth")
    assert found.verdict is None
    assert found.is_body
