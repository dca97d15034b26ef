"""Decisions over time: windows, links, fused evidence."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from doppelgait.classify import classify, timeline
from doppelgait.classify.decide import Decision, TargetInputs
from doppelgait.classify.timeline import CHANGE_PER_S, Tracks, _ClassEvidence, check_window, join_decisions
from doppelgait.core.errors import AnalysisError, ConfigError
from doppelgait.core.rng import rng
from doppelgait.dataset.windows import Links, Path, Window, analyze_window, cut_windows
from doppelgait.motion import boulic_walk
from doppelgait.pipeline import Result, simulate
from doppelgait.processing import Analysis, Gate
from doppelgait.radar import Radar
from doppelgait.scene import Scene, Target
from export_models import ALARM_MODEL as MODEL
from export_models import a_signature, model_of_tracks


def window(start_s, length_s=4.0):
    return Window(start_s, start_s + length_s, None)


def target(start_m, speed_mps, *, length_s=4.0, start_s=0.0, segment=None):
    """A result whose range changes evenly; times from the start of its window."""
    times_s = np.linspace(start_s, length_s, 50)
    gate = Gate.around(times_s, start_m + speed_mps * (times_s - start_s), span_m=1.6, source="track")
    quality = {} if segment is None else {"start_s": segment[0], "stop_s": segment[1]}
    return Result(Analysis(), gate_limits=gate, arrays={"signature": None}, quality=quality)


def said(human, *, blocked=False, alarm=None):
    return Decision(
        target=0, label="human" if human > 0.5 else "dog", probability=max(human, 1 - human),
        probabilities={"human": human, "dog": 1 - human}, abstained=blocked, reason="flag x" if blocked else "",
        blocked=blocked, alarm=alarm, flags=(), quality={},
    )  # fmt: skip


def decisions(monkeypatch, windows):
    """Decisions about one standing target: (probability of human, further facts) per window of 4 s, hop 4 s."""
    answers = iter(windows)
    monkeypatch.setattr(timeline, "decide", lambda *_: next(answers))
    tracks = Tracks(MODEL)
    return [tracks.add(window(4.0 * n), [target(3.0, 0.0)])[0] for n in range(len(windows))]


@pytest.fixture(scope="module")
def walk():
    scene = Scene([Target(boulic_walk(speed_mps=1.2, duration_s=5.0), range_m=5.0)])
    return simulate(scene, Radar.preset("x4", prf_hz=700.0), rng=rng(3), snr_db=20.0)


def test_windows_begin_every_hop_and_look_at_nothing_else(walk):
    found = list(cut_windows(walk, 3.0, 0.75))
    assert [one.start_s for one in found] == [0.0, 0.75, 1.5]
    part = walk.between(0.75, 3.75)
    np.testing.assert_array_equal(found[1].recording.baseband.values, part.baseband.values)
    assert found[1].recording.slow_time_s[0] == 0.0
    np.testing.assert_array_equal(found[1].recording.truth[0].centre_range_m, part.truth[0].centre_range_m)


def test_times_of_a_window_are_those_of_the_recording(walk):
    first, _, last = (analyze_window(one, Analysis()) for one in cut_windows(walk, 3.0, 0.75))
    for name in ("start_s", "stop_s", "track_start_s", "track_confirmed_at_s"):
        assert last[0].quality[name] == pytest.approx(first[0].quality[name] + 1.5, abs=0.3)
    assert last[0].segments[0].quality["stop_s"] > 3.5


def test_windows_of_a_simulation_take_the_true_gate(walk):
    last = list(cut_windows(walk, 3.0, 0.75))[-1]
    (result,) = analyze_window(last, Analysis(), gate="truth")
    path = Path.of(result, last)
    inside = path.time_s <= walk.slow_time_s[-1]
    true_m = np.interp(path.time_s, walk.slow_time_s, walk.truth[0].centre_range_m)
    np.testing.assert_allclose(path.range_m[inside], true_m[inside], atol=0.02)
    assert path.time_s[0] == pytest.approx(1.5)


def test_a_recording_shorter_than_a_window_says_so(walk):
    with pytest.raises(AnalysisError, match=r"lasts 5 s, less than a window of 6 s"):
        list(cut_windows(walk, 6.0, 1.0))
    with pytest.raises(ConfigError, match="window_s: '3' is not allowed; must be float"):
        timeline.classify_over_time(walk, window_s="3")
    with pytest.raises(TypeError, match="window_s"):
        classify(walk, window_s=3.0)


def test_window_and_hop_have_defaults_of_the_model():
    assert check_window(None, None, MODEL) == (3.0, 0.6)
    assert check_window(None, None) == (4.0, 0.8)
    assert check_window(5.0, 1.0, MODEL) == (5.0, 1.0)


@pytest.mark.parametrize(("window_s", "hop_s"), [(2.0, 3.0), (2.0, 0.0), (-1.0, None), (float("nan"), None)])
def test_a_hop_is_above_zero_and_no_longer_than_the_window(window_s, hop_s):
    with pytest.raises(ConfigError, match="0 < hop <= window"):
        check_window(window_s, hop_s)


def test_who_pass_each_other_keep_their_numbers():
    """Ranges 2 + t and 8 - t cross at t = 3."""
    links, hop_s, numbers = Links(), 1.0, []
    for n in range(5):
        pair = [target(2.0 + n * hop_s, 1.0), target(8.0 - n * hop_s, -1.0)]
        numbers.append(links.add(window(n * hop_s), pair[:: 1 if n % 2 else -1])[:: 1 if n % 2 else -1])
    assert numbers == [[1, 0]] * 5


def test_a_path_leads_across_a_gap_but_not_to_another_place_or_for_long():
    links = Links()
    assert links.add(window(0.0), [target(2.0, 1.0)]) == [0]  # at 6 m after 4 s
    assert links.add(window(4.0), []) == []
    later = target(7.5, 1.0, start_s=1.5)
    assert Links.add(links, window(4.0), [later]) == [0]
    assert links.add(window(4.0), [target(2.0, 1.0)]) == [1]
    assert links.add(window(30.0), [target(7.5, 1.0)]) == [2]


def test_a_network_of_tracks_remembers_what_may_be_decided():
    model, rows = model_of_tracks()
    signature, tracks, probabilities = a_signature(7.29e9, 500.0), Tracks(model), []
    seen = [((), 1.0), (("gates_overlap",), 1.0), ((), 9.0), ((), -1.0)]
    for row, (flags, speed_mps) in zip(rows.values[:4], seen, strict=True):
        names = {name: f"feature_{name}" for name in model.facts.names} | {"gait_frequency_hz": "gait_frequency_hz"}
        columns = {names[name]: value for name, value in zip(model.facts.names, row[:-1], strict=True)}
        columns |= {"feature_torso_velocity_mps": row[0], "feature_doppler_bandwidth_hz": row[1] / 0.0411 * 2}
        columns |= {"quality_observation_s": 2.0, "quality_track_velocity_mps": speed_mps}
        stop_s = 2.5 + 0.7 * len(probabilities)
        alone, belief, _ = tracks.follow(
            0, TargetInputs(columns, signature, row[-1].pictures / 255.0, flags), (stop_s - 2.5, stop_s)
        )
        probabilities.append(belief.probability)
        assert alone.blocked == bool(flags or speed_mps > 3.3), alone.reason
    assert probabilities[0].tolist() == probabilities[1].tolist() == probabilities[2].tolist()
    # what another body in the gate adds is forgotten when it has gone, and known while it is there
    values, belief = rows.values[[0, 1, 3]], tracks._beliefs[0]
    values[:, -1] = [
        one._replace(track=0, stop_s=stop_s, shared=shared)
        for one, stop_s, shared in zip(values[:, -1], (0.0, 0.7, 2.1), (False, True, False), strict=True)
    ]
    expected = model.probability(values)
    assert np.allclose(probabilities[3], expected[2], atol=1e-3)
    assert np.allclose(expected[2], model.probability(values[[0, 2]])[1])
    assert not np.allclose(expected[1], model.probability(values[1:2]), atol=1e-3)
    shared = belief.remember(model, values[1:2], 5.3, shared=True)
    values[1, -1] = values[1, -1]._replace(stop_s=2.8)
    assert np.allclose(shared, model.probability(values[[0, 2, 1]])[2], atol=1e-3)


def test_the_alarm_rings_for_a_shared_gate_while_it_is_shared():
    model, rows = model_of_tracks()
    facts = model.facts.model_copy(update={"alarm": "a", "alarm_threshold": 0.0, "conditions": {}})
    tracks, signature, rings = Tracks(replace(model, facts=facts)), a_signature(7.29e9, 500.0), []
    names = {name: f"feature_{name}" for name in facts.names} | {"gait_frequency_hz": "gait_frequency_hz"}
    columns = dict(zip(names.values(), rows.values[0][:-1], strict=True))
    columns |= {"feature_torso_velocity_mps": 1.0, "feature_doppler_bandwidth_hz": 90.0}
    shared = ("gates_overlap",)
    for number, flags in enumerate((shared, shared, (), shared, (), (), shared)):
        seen = TargetInputs(columns, signature, rows.values[0][-1].pictures / 255.0, flags)
        alone, belief, ringing = tracks.follow(0, seen, (0.7 * number, 2.5 + 0.7 * number))
        rings.append(ringing)
        assert alone.blocked == bool(flags)
        assert belief.alarm == (number > 3)
    assert rings == [False, True, False, True, True, True, True]


def test_gates_that_are_no_tracks_are_decided_by_the_model_of_windows(walk):
    for gate in ("truth", (3.0, 7.0)):
        assert {len(one.probabilities) for one in timeline.classify_over_time(walk, window_s=2.5, gate=gate)} == {2}
    assert {len(one.probabilities) for one in timeline.classify_over_time(walk)} == {3}


def test_memory_of_links_and_beliefs_does_not_grow(monkeypatch):
    monkeypatch.setattr(timeline, "decide", lambda *_: said(0.9))
    tracks = Tracks(MODEL)
    for n in range(200):
        tracks.add(window(n * 1.0), [target(1.0 + 30.0 * n, 0.0, length_s=0.5)])
    assert 1 < len(tracks.links.paths) <= 10
    assert set(tracks._beliefs) <= set(tracks.links.paths)


def test_the_belief_is_that_of_all_histories():
    """Sum over every sequence of three classes, with the transition matrix as a matrix exponential."""
    rows = np.array([[0.7, 0.2, 0.1], [0.1, 0.6, 0.3], [0.5, 0.3, 0.2], [0.2, 0.2, 0.6]])
    times_s = np.array([4.0, 8.0, 13.0, 30.0])
    belief = _ClassEvidence(np.full(3, 1 / 3), 4.0)
    for row, at_s in zip(rows, times_s, strict=True):
        belief.hand_over(at_s)
        belief.add_evidence(row, at_s - 4.0, at_s, 97)
    rates = CHANGE_PER_S / 2 * np.ones((3, 3))
    np.fill_diagonal(rates, -CHANGE_PER_S)
    steps = [expm(rates * dt) for dt in np.diff(times_s)]
    total = np.zeros(3)
    for states in itertools.product(range(3), repeat=4):
        chance = np.prod([rows[n, state] for n, state in enumerate(states)]) / 3
        total[states[-1]] += chance * np.prod([steps[n][states[n], states[n + 1]] for n in range(3)])
    np.testing.assert_allclose(belief.probability, total / total.sum(), rtol=1e-12)


def test_overlapping_windows_count_by_what_is_new():
    """Ten windows of 4 s, hop 0.4 s, with the same log odds: 1 + 9 / 10 of one, without the passing of time."""
    belief = _ClassEvidence(np.full(2, 0.5), 0.0)
    for n in range(10):
        belief.add_evidence(np.array([0.8, 0.2]), 0.4 * n, 0.4 * n + 4.0, 98)
    odds = belief.probability[0] / belief.probability[1]
    assert np.log(odds) == pytest.approx(1.9 * np.log(4.0))


def test_only_the_segment_that_was_looked_at_counts(monkeypatch):
    answers = [said(0.7), said(0.7)]
    monkeypatch.setattr(timeline, "decide", lambda *_: answers.pop())
    tracks = Tracks(MODEL)
    (first,) = tracks.add(window(0.0), [target(3.0, 0.0, segment=(1.0, 3.0))])
    (second,) = tracks.add(window(1.0), [target(3.0, 0.0, segment=(1.0, 3.0))])  # the same two seconds again
    assert first.probability == pytest.approx(0.7)
    assert 0.69 < second.probability < 0.7


def test_a_decision_stays_until_the_other_class_is_sure(monkeypatch):
    found = decisions(monkeypatch, [said(0.7), said(0.7), said(0.3), said(0.3), said(0.1), said(0.4)])
    assert [one.label for one in found] == [None, "human", "human", "human", "dog", "dog"]
    assert found[0].reason == "probability 0.70 is below 0.8"
    assert found[2].probability < 0.8
    assert found[2].reason == ""
    spans = join_decisions(found)
    assert [(s.start_s, s.stop_s, s.label) for s in spans] == [(0, 4, None), (4, 16, "human"), (16, 24, "dog")]


def test_what_may_not_be_decided_is_no_evidence_and_what_is_not_sure_is(monkeypatch):
    found = decisions(monkeypatch, [said(0.9), said(0.01, blocked=True), said(0.01, blocked=True), said(0.6)])
    assert [one.label for one in found] == ["human"] * 4
    assert [one.reason for one in found] == ["", "flag x", "flag x", ""]
    kept = np.exp(-2 * CHANGE_PER_S * 4.0)
    assert found[2].probability == pytest.approx(0.5 + 0.4 * kept**2)
    assert found[3].probability > found[2].probability


def test_no_window_says_more_than_the_rows_of_its_calibration(monkeypatch):
    (found,) = decisions(monkeypatch, [said(1.0)])
    assert found.probability == pytest.approx(1 / 1.01)


def test_the_alarm_needs_evidence_and_stays(monkeypatch):
    windows = [said(0.5, blocked=True, alarm=True), *[said(0.7, alarm=True)] * 2, said(0.01, blocked=True), said(0.2)]
    assert [one.alarm for one in decisions(monkeypatch, windows)] == [False, False, True, True, True]
