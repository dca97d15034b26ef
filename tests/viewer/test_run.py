"""Which body a target is compared with, over which times, and how segments and bursts are shown."""

from dataclasses import replace
from itertools import count
from types import SimpleNamespace

import numpy as np
import pytest

from doppelgait.classify.timeline import classify_over_time
from doppelgait.core.errors import AnalysisError, ConfigError
from doppelgait.core.frames import Frames
from doppelgait.pipeline import analyze, parse_run, run_simulation, write_results
from doppelgait.processing import Analysis, Gate
from doppelgait.processing.signature import compute_signature
from doppelgait.processing.sound import make_doppler_sound
from doppelgait.radar import Radar, read_recording, write_recording
from doppelgait.radar.recording import TargetTruth
from doppelgait.radar.recordings import StoredRows
from doppelgait.viewer import panels
from doppelgait.viewer.run import MOST_ANALYSES, Run, compute_true_values, find_true_values, match_truths
from doppelgait.viewer.settings import Settings, parse_changes
from doppelgait.viewer.source import RunCache, add_other, all_ranges_m, describe_session, open_path, parse_reference
from viewer_client import unpack

TIMES_S = np.arange(0.0, 10.0, 0.01)
WAVELENGTH_M = 0.04


def body(range_m, velocity_mps=1.0, **facts):
    known = {"label": "human", "gait": "walk", "gait_frequency_hz": 2.0, **facts}
    line_m, line_mps = (np.broadcast_to(values, TIMES_S.shape) for values in (range_m, velocity_mps))
    return TargetTruth(
        scatterers=None, centre_range_m=line_m, centre_velocity_mps=line_mps, centre_aspect_rad=0 * line_m, **known
    )


def found(range_m, start_s=0.0, stop_s=9.99, gate="track"):
    """What matching looks at of a result whose gate has its middle at these ranges."""
    middle_m = np.broadcast_to(range_m, TIMES_S.shape)
    chosen = (start_s <= TIMES_S) & (stop_s >= TIMES_S)
    limits = Gate.around(TIMES_S[chosen], middle_m[chosen], span_m=1.0, source=gate)
    return SimpleNamespace(gate=limits, quality={"start_s": start_s, "stop_s": stop_s})


def truths(bodies, results):
    """Truth of every result over its own times."""
    recording = SimpleNamespace(slow_time_s=TIMES_S, radar=SimpleNamespace(wavelength_m=WAVELENGTH_M), truth=bodies)
    spans = [(one.quality["start_s"], one.quality["stop_s"]) for one in results]
    matched = zip(match_truths(recording, results), results, spans, strict=True)
    return [find_true_values(recording, truth, result, span) for truth, result, span in matched]


def labels(bodies, results):
    return [None if one is None else one["label"] for one in truths(bodies, results)]


def test_tracks_are_compared_with_the_body_that_they_follow():
    human, dog = body(7.0 - 0.4 * TIMES_S), body(2.0 + 0.3 * TIMES_S, label="dog")
    # the dog's track comes first; one ghost lies 2 m behind the human, another nearer to him than 0.8 m
    tracks = [found(2.1 + 0.3 * TIMES_S), found(7.1 - 0.4 * TIMES_S), found(9.0 - 0.4 * TIMES_S)]
    assert labels([human, dog], tracks) == ["dog", "human", None]
    assert labels([human], tracks) == [None, "human", None]
    assert labels([human], [found(7.6 - 0.4 * TIMES_S), found(6.9 - 0.4 * TIMES_S)]) == [None, "human"]
    assert labels([human], [found(7.9 - 0.4 * TIMES_S)]) == [None]
    # a body that was lost and found again has two tracks, one after the other
    lost = [found(7.1 - 0.4 * TIMES_S, 0.0, 4.0), found(7.2 - 0.4 * TIMES_S, 5.0, 9.9)]
    assert labels([human, dog], lost) == ["human", "human"]


def test_other_gates_are_of_their_body():
    human, dog = body(3.0), body(3.1, label="dog")
    assert labels([human, dog], [found(3.0, gate="truth"), found(3.1, gate="truth")]) == ["human", "dog"]
    assert labels([human, body(7.0)], [found(3.3, gate="given")]) == ["human"]
    assert labels([human, dog], [found(3.3, gate="given")]) == [None]
    assert labels([human], [found(6.0, gate="given")]) == [None]


def test_truth_is_that_of_the_times_shown():
    velocity_mps = np.where(TIMES_S < 4.0, 1.0, -2.0)
    human = body(5.0, velocity_mps)
    early, late = truths([human], [found(5.0, 0.0, 3.9)]), truths([human], [found(5.0, 4.5, 9.0)])
    assert (early[0]["torso_velocity_mps"], late[0]["torso_velocity_mps"]) == (1.0, -2.0)
    assert (early[0]["step_length_m"], late[0]["step_length_m"]) == (0.5, 1.0)
    assert late[0]["torso_doppler_hz"] == pytest.approx(2 * -2.0 / WAVELENGTH_M)
    assert late[0]["harmonic_ratio_3"] == 3.0


@pytest.mark.parametrize("gait", ["", "stand"])
def test_what_does_not_step_has_no_truth_of_a_gait(gait):
    values = compute_true_values(body(3.0, -1e-12, label="fan", gait=gait), WAVELENGTH_M, TIMES_S >= 0)
    assert (values["torso_velocity_mps"], values["torso_doppler_hz"]) == (0.0, 0.0)
    for name in ("step_length_m", "harmonic_ratio_2", "harmonic_ratio_3", "gait_frequency_hz"):
        assert values[name] is None


TURNS = {
    "seed": 5,
    "duration_s": 9.0,
    "radar": {"preset": "x4"},
    "noise": {"kind": "snr", "snr_db": 25.0},
    "targets": [
        {
            "label": "human",
            "path": {"kind": "polyline", "points_m": [[6.0, 0.5], [2.0, 0.5], [2.0, -2.0], [7.0, -3.0]]},
            "motion": {"kind": "boulic", "speed_mps": 1.1, "height_m": 1.75},
            "start_position_m": [0.0, 0.0],
            "heading_deg": 0.0,
        }
    ],
}


@pytest.fixture(scope="module")
def recording():
    return run_simulation(parse_run(TURNS, where="scene"))


@pytest.fixture(scope="module")
def run(recording):
    return Run("turns", "recording", load=lambda: recording)


def test_each_segment_can_be_shown(run, recording):
    (result,) = analyze(recording, gate="track")
    assert len(result.segments) > 1
    times_s = recording.baseband["slow_time"].values
    shown = unpack(panels.make_targets_payload(run, None))[0]["targets"][0]
    for number, segment in enumerate(result.segments):
        facts, _ = unpack(panels.make_targets_payload(run, None, segment=(0, number)))
        target = facts["targets"][0]
        span = segment.quality["start_s"], segment.quality["stop_s"]
        assert target["segments"][number] == list(span)
        assert target["segment"] == number
        assert target["features"]["torso_velocity_mps"] == segment.features.torso_velocity_mps
        assert target["quality"]["n_pieces"] == len(result.segments)
        columns = target["signature"]["x"]  # of the whole track, with the main line of every segment
        start_s, stop_s = columns["first"], columns["first"] + (columns["n"] - 1) * columns["step"]
        assert start_s < result.segments[0].quality["start_s"] + 0.2
        assert stop_s > result.segments[-1].quality["stop_s"] - 0.2
        assert len(target["main_lines"]) == len(result.segments)
        for line, (first_s, last_s) in zip(target["main_lines"], target["segments"], strict=True):
            axis = line["x"]
            assert first_s <= axis["first"] < axis["first"] + (axis["n"] - 1) * axis["step"] <= last_s + 1e-9
        inside = (times_s >= span[0]) & (times_s <= span[1])
        expected_mps = recording.truth[0].centre_velocity_mps[inside].mean()
        assert target["truth"]["torso_velocity_mps"] == pytest.approx(expected_mps, abs=1e-5)
        longest = span[1] - span[0] == max(stop - start for start, stop in target["segments"])
        assert (shown["segment"] == number) == longest
        assert (shown["features"] == target["features"]) == longest
    with pytest.raises(ConfigError, match=f"segments 0 to {len(result.segments) - 1}"):
        panels.make_targets_payload(run, None, segment=(0, len(result.segments)))


def test_map_of_moved_columns_says_so(run):
    """The line of the walker drifts in the second segment, where he walks past the radar, and not in the first."""
    for number in range(2):
        facts, arrays = unpack(panels.make_targets_payload(run, None, segment=(0, number)))
        target = facts["targets"][0]
        line_hz = arrays[target["main_lines"][number]["values"]]
        drifts = abs(line_hz[-1] - line_hz[0]) > 10.0
        assert (target["aligned"], drifts) == (number == 1, number == 1)
        image = target["cadence_map"]
        low_hz, high_hz = image["band_hz"]
        levels = arrays[image["array"]].max(axis=0)
        strongest_hz = image["y"]["first"] + int(levels.argmax()) * image["y"]["step"]
        assert low_hz <= strongest_hz <= high_hz


def test_only_the_last_two_analyses_are_kept(recording):
    run = Run("turns", "recording", Settings(gate=(1.0, 3.0)), load=lambda: recording)
    for low_m in (1.0, 2.0, 3.0, 4.0):
        run.targets((low_m, low_m + 1.0))
    assert MOST_ANALYSES == 2
    assert [gate for gate, _ in run._analyses] == [(3.0, 4.0), (4.0, 5.0)]


def test_bursts_last_until_the_last_one(recording):
    """16 of every 64 pulses, as of a sensor that sleeps in between."""
    chosen = np.flatnonzero(np.arange(recording.n_pulses) % 64 < 16)
    baseband = recording.baseband.isel(slow_time=chosen)
    rest = recording.with_baseband(baseband, truth=())
    facts, _ = unpack(panels.make_recording_payload(Run("bursts", "recording", load=lambda: rest), None))
    prf_hz, n_bursts = recording.radar.prf_hz, -(-recording.n_pulses // 64)
    assert facts["duration_s"] == pytest.approx((chosen[-1] + 1) / prf_hz)
    told = dict(facts["facts"])
    assert told["bursts"] == f"{n_bursts} of 16 frames"
    assert told["burst rate"] == f"{prf_hz / 64:.4g} Hz"
    assert "in bursts" in facts["no_sound"]
    with pytest.raises(AnalysisError, match="in bursts"):  # and nothing about a pitch that a mean rate would not allow
        make_doppler_sound(Frames.of(baseband), Gate.fixed(1.0, 3.0, time_s=baseband["slow_time"]), pitch=4000.0)
    facts, _ = unpack(panels.make_recording_payload(Run("all", "recording", load=lambda: recording), None))
    assert facts["no_sound"] is None


@pytest.mark.parametrize(
    ("kind", "own", "requested", "used"),
    [
        ("recording", None, None, "median"), ("recording", None, "none", "none"),
        ("try", None, None, "none"), ("try", None, "mean", "mean"),
        ("recording", "mti", None, "mti"), ("recording", "mti", "median", "median"),
        ("recording", "none", None, "none"), ("recording", "none", "median", "median"),
    ],
)  # fmt: skip
def test_clutter_is_what_the_user_asked_for(recording, kind, own, requested, used):
    run = Run("a", kind, Settings(analysis=Analysis(clutter=own) if own else Analysis()), load=lambda: recording)
    for gate in ("truth", "track", (1.0, 3.0)):
        assert run.analysis(gate, (("clutter", requested),) if requested else ()).clutter == used


def test_a_request_changes_parameters_of_the_analysis(recording):
    run = Run("a", "recording", Settings(analysis=Analysis(gate_span_m=1.2)), load=lambda: recording)
    changes = parse_changes({"cpi_s": "0.2", "hop": "16", "window_steepness": "0.3", "other": "x"})
    done = run.analysis("track", changes)
    assert (done.cpi_s, done.hop, done.window_steepness, done.gate_span_m) == (0.2, 16, 0.3, 1.2)
    assert done.clutter == "median"
    facts, _ = unpack(panels.make_recording_payload(run, None, changes=changes))
    assert facts["analysis"] == {"clutter": "median", "cpi_s": 0.2, "window_steepness": 0.3, "hop": 16}
    standard, _ = unpack(panels.make_recording_payload(run, None))
    assert standard["analysis"]["hop"] == 8  # what loses nothing, from 0.1 s at 1000 Hz
    columns = [
        unpack(panels.make_targets_payload(run, (1.0, 5.0), one))[0]["targets"][0]["signature"]["x"]
        for one in ((), changes)
    ]
    assert [one["step"] for one in columns] == pytest.approx([0.008, 0.016])
    for name, text, limit in (
        ("cpi_s", "30", "10"),
        ("hop", "0", "1"),
        ("hop", "2.5", "int"),
        ("cpi_s", "x", "number"),
    ):
        with pytest.raises(ConfigError, match=f"^{name}: .*{limit}"):
            parse_changes({name: text})


def test_a_change_of_the_analysis_keeps_one_baseband_and_reads_its_levels_once(recording, monkeypatch):
    run = Run("a", "recording", load=lambda: recording)
    looked = []
    find = panels.find_strongest_v
    monkeypatch.setattr(panels, "find_strongest_v", lambda baseband: looked.append(1) or find(baseband))
    for cpi_s in (0.1, 0.15, 0.2):
        panels.make_range_doppler_payload(run, None, start=0, count=1, changes=(("cpi_s", cpi_s),))
    assert len(looked) == 1
    first = run.clean_frames(None)
    assert run.clean_frames(None, (("cpi_s", 0.3),)) is first
    run.clean_frames(None, (("clutter", "mean"),))
    assert run.clean_frames(None) is not first


def test_the_sound_of_a_long_recording_is_made_tile_by_tile(tmp_path, monkeypatch):
    """The same sound, and never more of the samples in memory than a tile."""
    person = {"label": "human", "motion": {"kind": "boulic", "speed_mps": 0.5}, "range_m": 4.0, "aspect_deg": 0}
    scene = {"seed": 5, "duration_s": 4.0, "radar": {"preset": "x4", "prf_hz": 1000}, "targets": [person]}
    recording = run_simulation(parse_run(scene))
    write_recording(recording, tmp_path / "walk.h5")
    monkeypatch.setattr("doppelgait.radar.recordings.STORED_BYTES", 0)
    stored = read_recording(tmp_path / "walk.h5")
    assert not stored.samples.in_memory
    gate = Gate.from_truth(recording.truth[0], recording.slow_time_s, Analysis())
    analysis = Analysis(clutter="median")
    monkeypatch.setattr("doppelgait.processing.sound.BLOCK_PULSES", 1500)
    whole = make_doppler_sound(Frames.of(recording.baseband), gate, analysis)
    monkeypatch.setattr("doppelgait.core.lazy.LONG_PULSES", 1500)
    monkeypatch.setattr("doppelgait.processing.sound.READ_PULSES", 700)
    read, rows = [], StoredRows.__call__
    monkeypatch.setattr(
        StoredRows, "__call__", lambda self, first, stop: read.append(stop - first) or rows(self, first, stop)
    )
    found = make_doppler_sound(Frames.of(stored.baseband), gate, analysis)
    assert max(read) <= 1500
    assert found[0] == whole[0]
    np.testing.assert_allclose(found[1], whole[1], atol=2)


def test_a_second_recording_is_one_to_compare_with(recording, tmp_path):
    for name in ("a.h5", "b.h5"):
        write_recording(recording, tmp_path / name)
    write_results(tmp_path / "result.h5", recording, analyze(recording, gate=(1.0, 4.0)))
    first = open_path(tmp_path / "a.h5", Settings())
    opened = add_other(first, tmp_path / "b.h5", Settings())
    shelf = RunCache(opened)
    assert shelf.run(parse_reference([("run", "2")])) is opened.other
    assert shelf.run(parse_reference([])) is opened.run
    assert describe_session(opened, Settings())["other"] == "b.h5"
    result, changed = (
        open_path(tmp_path / "result.h5", Settings()).run,
        replace(recording, range_m=recording.range_m + 1),
    )
    runs = (first.run, opened.other, result, Run("a.h5", "recording", load=lambda: changed))
    assert len({panels.identify_content(run) for run in runs}) == 3, "equal content has one key, equal names have not"
    with pytest.raises(ConfigError, match=r"result\.h5: is a result; two recordings"):
        add_other(first, tmp_path / "result.h5", Settings())
    with pytest.raises(ConfigError, match="no second recording"):
        RunCache(first).run(parse_reference([("run", "2")]))
    with pytest.raises(ConfigError, match="run: must be 2"):
        parse_reference([("run", "3")])


def read_signature(payload):
    """Time axis of the signature of a payload, and its levels in dB."""
    facts, arrays = unpack(payload)
    low, high = facts["signature"]["db"]
    return facts["signature"]["x"], low + arrays["signature"] / 65535 * (high - low)


def expect_db(run, recording, target, hop):
    """Times and levels of a target's signature, None for all ranges, straight from the processing layer."""
    gate = Gate.fixed(*all_ranges_m(recording), time_s=recording.slow_time_s, range_m=recording.range_m)
    gate = gate if target is None else run.targets(None)[target].result.gate
    analysis, wavelength_m = run.analysis(None).model_copy(update={"hop": hop}), recording.radar.wavelength_m
    found = compute_signature(gate.crop(run.clean_frames(None)), gate, analysis, wavelength_m=wavelength_m)
    return found.axis("time"), 10 * np.log10(found.values)


def test_the_first_picture_is_that_of_all_ranges_on_a_coarse_grid(run, recording, monkeypatch):
    monkeypatch.setattr(panels.payload, "MOST", (500, 600))
    time, levels_db = read_signature(panels.make_recording_payload(run, None))
    _, expected_db = expect_db(run, recording, None, -(-recording.n_pulses // 500))
    assert (time["n"], time["block"]) == (len(expected_db), 1)  # nothing between the columns is computed
    np.testing.assert_allclose(levels_db, np.maximum(expected_db, levels_db.min()), atol=0.02)


@pytest.mark.parametrize("target", [None, 0])
def test_a_part_is_computed_again_on_a_finer_grid(run, recording, target):
    further = {"from": "4.0", "to": "4.5", **({} if target is None else {"target": str(target)})}
    empty = panels.make_detail_payload(run, None, {**further, "from": "400", "to": "405"})  # of a longer recording
    assert b'"range_time": null' in empty or b'"range_time":null' in empty
    time, levels_db = read_signature(panels.make_detail_payload(run, None, further))
    assert time["step"] == pytest.approx(1 / recording.radar.prf_hz)  # of the whole: 0.008 s
    assert time["first"] == pytest.approx(4.0, abs=2e-3)
    assert time["n"] == pytest.approx(0.5 * recording.radar.prf_hz, abs=2)
    times_s, expected_db = expect_db(run, recording, target, 1)
    first = int(np.abs(times_s - time["first"]).argmin())
    expected_db = np.maximum(expected_db[first : first + time["n"]], levels_db.min())
    np.testing.assert_allclose(levels_db, expected_db, atol=0.02)


def test_the_decisions_are_those_of_the_command_and_come_in_parts(recording, monkeypatch):
    run = Run("turns", "recording", load=lambda: recording)
    expected = classify_over_time(recording)
    assert any(one.alarm for one in expected)
    times_s = count(step=0.3)
    monkeypatch.setattr(panels, "monotonic", lambda: next(times_s))
    parts = []
    while not parts or not parts[-1]["complete"]:
        parts.append(panels.make_decisions(run, None, sum(len(part["marks"]) for part in parts)))
    assert len(parts) > 3
    assert [part["stop_s"] for part in parts] == sorted(part["stop_s"] for part in parts)
    marks = [mark for part in parts for mark in part["marks"]]
    assert [(mark["track"], mark["time_s"], mark["label"], mark["alarm"], mark["evidence"]) for mark in marks] == [
        (one.track, one.stop_s, one.label, one.alarm, one.probabilities["human"]) for one in expected
    ]
    assert (parts[-1]["alarm_class"], parts[-1]["shown_class"], parts[-1]["reason"]) == ("human", "human", "")
    slow = replace(recording, radar=Radar.preset("x4-255fps"))
    answer = panels.make_decisions(Run("slow", "recording", load=lambda: slow), None, 0)
    assert answer["complete"]
    assert "no shipped model" in answer["reason"]
