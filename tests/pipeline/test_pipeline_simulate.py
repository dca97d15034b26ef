"""The chain from a scene to features: what the gates need, at which hop, and what is refused."""

import csv
import os
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import doppelgait as dg
from doppelgait.core.errors import (
    AnalysisError,
    ConfigError,
    DoppelgaitWarning,
    MotionError,
    OutputError,
    RecordingError,
)
from doppelgait.core.files import open_atomically
from doppelgait.core.frames import SlowTime
from doppelgait.core.rng import rng
from doppelgait.core.samples import Samples
from doppelgait.motion import boulic_walk, quadruped_gait, read
from doppelgait.pipeline import Conditions, analyze, parse_run, run_simulation, simulate
from doppelgait.processing import Analysis, Gate
from doppelgait.processing.signature import make_gated_transform
from doppelgait.radar import Radar, write_recording
from doppelgait.radar.simulate import warn_of_limits
from doppelgait.scene import RcsSpec, Scene, Target, assemble
from doppelgait.scene.placement import build_motion

WALK = boulic_walk(speed_mps=1.3, height_m=1.7, duration_s=3.0)
TROT = quadruped_gait(gait="trot", withers_m=0.4, duration_s=3.0)

X4 = Radar.preset("x4")
SCENES = {
    "one": Scene([Target(WALK, label="human", aspect_deg=20.0)]),
    "receding": Scene([Target(TROT, label="dog", aspect_deg=180.0, range_m=4.0)]),
    "passing": Scene([Target(WALK, label="human", range_m=5.0), Target(TROT, range_m=5.0, aspect_deg=180.0)]),
}


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("analysis", [Analysis(), Analysis(hop=1), Analysis(method="liland2018", hop=10)])
@pytest.mark.parametrize(("snr_db", "gate_error_m"), [(None, 0.0), (10.0, 0.25), (float("inf"), -0.2)])
def test_noise_made_for_the_gates_alone_is_that_of_the_whole_matrix(scene, analysis, snr_db, gate_error_m):
    recording = simulate(SCENES[scene], X4, rng=rng(4), snr_db=snr_db, angles=False)
    found = analyze(recording, gate="truth", analysis=analysis, gate_error_m=gate_error_m)
    whole = recording.with_baseband(recording.baseband)
    expected = analyze(whole, gate="truth", analysis=analysis, gate_error_m=gate_error_m)
    for one, other in zip(found, expected, strict=True):
        assert one.signature.values.tobytes() == other.signature.values.tobytes()
        assert one.features == other.features
        assert one.quality == other.quality
        assert one.flags == other.flags


def test_a_data_matrix_that_cannot_fit_is_refused():
    radar = Radar.preset("x4-long", range_stop_m=5000.0, prf_hz=9000)
    with pytest.raises(ConfigError, match=r"more than 2e\+09 samples"):
        simulate(Scene([Target(boulic_walk(speed_mps=1.0, duration_s=30.0))]), radar)


def test_noise_reaches_every_cell_that_the_signature_reads():
    """Of all pulses and bins, those not declared needed may hold anything."""
    slow_time_s, range_m = np.arange(700) / 1000.0, 1.0 + 0.05 * np.arange(60)
    gate = Gate.around(slow_time_s, 3.5 - 1.7 * slow_time_s, span_m=0.9, source="given")
    for analysis in (Analysis(), Analysis(hop=1), Analysis(method="liland2018")):
        cut = make_gated_transform(gate, SlowTime(slow_time_s), range_m, analysis)
        needed, plan = cut.find_needed_pulses(), cut.transform
        margin = plan.n_doppler_bins - plan.window.size + 2 * plan.hop
        planes = np.random.default_rng(0).standard_normal((2, 60, 700)).astype(np.float32)
        expected = cut.sum_power(Samples.from_planes(planes, 700))
        for n, (first, stop) in enumerate(needed):
            planes[:, n, :first] = planes[:, n, max(stop, first) :] = 1e6
            planes[:, n, :first] = planes[:, n, max(stop + margin, first) :] = np.nan
        np.testing.assert_array_equal(cut.sum_power(Samples.from_planes(planes, 700)), expected)
        assert (needed[:, 1] - needed[:, 0]).clip(0).sum() < 0.9 * 60 * 700


def test_a_cropped_signature_is_thinned_from_the_same_columns():
    """Where the gate leaves the frame the first columns go: before that, hop 1 must pick the columns of hop 8."""
    radar = Radar.preset("x4", range_start_m=3.0, range_stop_m=6.0)
    with pytest.warns(match="outside the frame"):
        recording = simulate(SCENES["one"], radar, rng=rng(2), angles=False)
    found = {hop: analyze(recording, gate="truth", analysis=Analysis(hop=hop))[0] for hop in (1, 2, 8)}
    assert "gate_leaves_frame" in found[8].flags
    for hop in (1, 2):
        assert found[hop].features == found[8].features
        assert found[hop].main_line_hz.size == found[hop].signature.sizes["time"]


def test_a_body_that_is_never_in_the_frame_has_no_snr():
    radar = Radar.preset("x4-long", range_start_m=50.0, range_stop_m=55.0)
    with pytest.warns(match="outside the frame"):
        recording = simulate(SCENES["one"], radar, rng=rng(0))
    assert recording.snr_frame_db == -np.inf


def test_a_radar_by_name_is_that_of_the_command(tmp_path, monkeypatch):
    own = tmp_path / "own.toml"
    own.write_text('preset = "x4"\nprf_hz = { uniform = [600, 640] }\n[[impairments]]\nkind = "adc"\nbits = 8\n')
    scene = {"duration_s": 0.5, "seed": 7, "targets": [{"motion": {"kind": "boulic"}, "range_m": 4.0}]}
    expected = run_simulation(parse_run({**scene, "radar": {"preset": str(own)}}), angles=False)
    placed = parse_run(scene).scene
    for radar in (own, str(own)):
        found = simulate(placed, radar, rng=rng(7), angles=False)
        assert found.radar == expected.radar
        assert found.baseband.values.tobytes() == expected.baseband.values.tobytes()
    assert expected.radar.prf_hz not in (600.0, 620.0), "the rate was not drawn"
    plain = simulate(placed, own, rng=rng(7), conditions=Conditions(), angles=False)
    assert plain.baseband.values.tobytes() != expected.baseband.values.tobytes()
    assert simulate(SCENES["one"], "x4", angles=False).radar == X4


def test_a_recording_by_path_is_read(tmp_path):
    recording = simulate(SCENES["one"], Radar.preset("x4", prf_hz=640.0), angles=False)
    write_recording(recording, tmp_path / "walk.h5")
    expected = analyze(recording, gate="truth")
    for path in (tmp_path / "walk.h5", str(tmp_path / "walk.h5")):
        assert analyze(path, gate="truth") == expected
    with pytest.raises(RecordingError, match=r"^nothing\.h5: no such file$"):
        analyze("nothing.h5")
    with pytest.raises(ConfigError, match=r"^recording: Radar is not allowed; give a path"):
        analyze(X4)


def test_a_motion_by_path_is_that_of_the_table():
    assert Target("walk.c3d").motion == Target({"kind": "file", "path": "walk.c3d"}).motion
    assert Target(Path("walks") / "walk.c3d").motion["path"] == str(Path("walks") / "walk.c3d")
    assert Target("boulic").motion == {"kind": "boulic"}
    with pytest.raises(MotionError, match=r"walk\.c3d"):
        simulate(Scene([Target("walk.c3d", range_m=3.0)], duration_s=1.0), X4)


FRAME_RATE_HZ = 120.0
WALKS = {
    "human/c3d/cmu_07_01.c3d": {},
    "human/c3d/cmu_02_01.c3d": {},
    # the straight stretch of a recording in which the person first stands for eight seconds
    "human/c3d/cmu_82_08.c3d": {"start_s": 1158 / FRAME_RATE_HZ, "stop_s": 1596 / FRAME_RATE_HZ},
}


@pytest.fixture(scope="module")
def segments(shared):
    with (shared / "data" / "mocap" / "segments.csv").open() as handle:
        return {row["file"]: row for row in csv.DictReader(handle) if row["file"] in WALKS}


@pytest.fixture(scope="module", params=list(WALKS))
def recorded(request, shared, segments):
    motion = read(shared / "data" / "mocap" / request.param, **WALKS[request.param])
    recording = simulate(Scene([Target(motion, label="human")]), Radar.preset("x4"))
    return recording, analyze(recording, gate="truth")[0], segments[request.param]


def torso_speed_mps(recording, result):
    """Approach of the mean range of the torso markers over the observed frames: the way over the time."""
    rows = recording.truth[0].scatterers
    torso = rows["range"].values[:, rows.coords["part"].values == "torso"].mean(axis=1)
    times = rows.coords["slow_time"].values
    observed = result.signature.coords["time"].values
    first_m, last_m = np.interp(observed[[0, -1]], times, torso)
    return (first_m - last_m) / (observed[-1] - observed[0])


@pytest.mark.shared
def test_torso_velocity_follows_the_torso_markers(recorded):
    recording, result, segment = recorded
    velocity = result.features.torso_velocity_mps
    assert velocity == pytest.approx(torso_speed_mps(recording, result), rel=0.03)
    assert velocity == pytest.approx(float(segment["speed_mps"]), rel=0.05)


@pytest.mark.shared
def test_gait_frequency_is_the_step_frequency(recorded):
    _, result, segment = recorded
    assert result.gait_frequency_hz == pytest.approx(2 * float(segment["stride_hz"]), rel=0.05)


NAN = float("nan")


@pytest.fixture(scope="module")
def walk():
    return boulic_walk(speed_mps=1.2, duration_s=1.0)


TARGET, SCENE = partial(Target, {"kind": "boulic"}), partial(Scene, [Target({"kind": "boulic"})])


@pytest.mark.parametrize(
    ("make", "options", "says"),
    [
        (TARGET, {"height_m": -1}, r"Target: height_m: -1 is not allowed.*greater than 0"),
        (TARGET, {"range_m": "near"}, "range_m: 'near'.*must be a number"),
        (TARGET, {"start_position_m": (NAN, 1.0), "heading_deg": 0.0}, "start_position_m.0: nan.*finite"),
        (TARGET, {"bearing_deg": 1000.0}, "bearing_deg: 1000.0.*less than or equal to 360"),
        (TARGET, {"rcs": "foo"}, r"rcs.kind: 'foo'.*known are auto, body_parts, equal, surfaces"),
        (TARGET, {"rcs": 3.0}, "rcs: 3.0"),
        (SCENE, {"radar_position_m": (0, 0, NAN)}, "radar_position_m.2: nan"),
        (SCENE, {"duration_s": NAN}, "duration_s: nan"),
    ],
)
def test_targets_and_scenes_are_checked_as_strictly_as_in_a_file(make, options, says):
    with pytest.raises(ConfigError, match=says):
        make(**options)


def test_a_target_takes_arrays_and_the_name_of_a_cross_section(walk):
    target = Target(walk, start_position_m=np.array([3.0, 1.0]), heading_deg=90, rcs="equal")
    assert target.start_position_m == (3.0, 1.0)
    assert target.rcs == RcsSpec(kind="equal")


def test_a_scene_holds_targets_only(walk):
    with pytest.raises(ConfigError, match=r"targets\.0: .*must be a table, or Target"):
        Scene([walk])
    with pytest.raises(ConfigError, match=r"targets: .*must be a list of Target"):
        Scene(Target(walk))


def test_range_bins_wider_than_two_echoes_are_warned_of(walk):
    sparse = Radar.preset("x4", decimation=32)
    assert sparse.bin_spacing_m > 2 * sparse.range_resolution_m
    table = assemble(Scene([Target(walk)]), np.arange(100) / 1000)
    with pytest.warns(DoppelgaitWarning, match=r"sparse range bins: their spacing is 0.206 m.*radar.decimation \(32\)"):
        warn_of_limits(table, sparse)
    warn_of_limits(table, Radar.preset("x4"))


@pytest.mark.parametrize(("duration_s", "hop"), [(0.101, None), (0.15, None), (0.5, 100_000)])
def test_too_few_columns_are_refused(walk, duration_s, hop):
    recording = simulate(Scene([Target(walk)], duration_s=duration_s), Radar.preset("x4"))
    with pytest.raises(AnalysisError, match=r"columns?, at least 8 are needed; record longer, or lower hop"):
        dg.analyze(recording, gate="truth", analysis=Analysis(hop=hop))


SETTINGS = {"gate_span_m": 1.6, "gate_edges": "fractional", "gate_doppler_hz": (-9.0, 9.0), "normalisation": "sum"}


@pytest.mark.parametrize("key", SETTINGS)
def test_the_reports_method_does_not_take_what_it_ignores(key):
    with pytest.raises(ConfigError, match=rf"method 'liland2018' fixes {key}"):
        Analysis(method="liland2018", **{key: SETTINGS[key]})


def test_a_faulty_target_is_not_called_a_missing_one_too():
    with pytest.raises(ConfigError) as caught:
        parse_run({"targets": [{"motion": {"kind": "boulic"}, "colour": 1}]})
    assert "targets.0.colour: unknown key" in str(caught.value)
    assert "at least 1 item" not in str(caught.value)
    with pytest.raises(ConfigError, match=r"targets: .*at least 1 item"):
        parse_run({"targets": []})


def test_motions_are_kept_up_to_a_number_of_bytes(monkeypatch, walk, tmp_path):
    import doppelgait.motion.readers as readers
    from doppelgait.scene import placement

    asked = []
    monkeypatch.setattr(readers, "read", lambda path, **options: asked.append(options["segment"]) or walk)
    monkeypatch.setattr(placement, "KEPT_BYTES", 2 * walk.positions.nbytes)
    monkeypatch.setattr(placement, "_read_before", type(placement._read_before)())
    (tmp_path / "walk.c3d").write_bytes(b"x")
    for segment in (1, 2, 1, 3, 1, 2):  # 3 drops 2, the one that was not used for longest; 2 drops 3
        build_motion({"kind": "file", "path": "walk.c3d", "segment": segment}, duration_s=1.0, folder=tmp_path)
    assert asked == [1, 2, 3, 2]
    assert len(placement._read_before) == 2


def test_every_scene_gets_the_warnings_of_a_motion_file(tmp_path):
    """Else a row of a dataset would depend on what its worker read before."""
    short = boulic_walk(speed_mps=1.2, duration_s=1.7)
    header = ",".join(["time_s", *(f"{m}_{a}_m" for m in short.markers for a in "xyz")])
    rows = np.column_stack([short.time_s, short.position_m.reshape(short.n_frames, -1)])
    np.savetxt(tmp_path / "short.csv", rows, delimiter=",", header=header, comments="")
    for _ in range(2):
        with pytest.warns(DoppelgaitWarning, match="strides, fewer than 2"):
            build_motion({"kind": "file", "path": "short.csv", "loop_to_s": 4.0}, duration_s=1.0, folder=tmp_path)


def strides(motion, until_s, foot="left_foot"):
    times = np.array(motion.facts.footfalls[foot])
    times = times[times <= until_s]
    return (times.size - 1) / (times[-1] - times[0])


def test_truth_frequencies_are_those_of_the_observation():
    table = {"kind": "boulic", "speed_mps": 1.2, "stride_variation": 0.08}
    motion = build_motion(table, duration_s=30.0, rng=dg.rng(5))
    truth = simulate(Scene([Target(motion, range_m=6.0)], duration_s=4.0), Radar.preset("x4")).truth[0]
    wanted = np.mean([strides(motion, 4.0, foot) for foot in ("left_foot", "right_foot")])
    assert truth.stride_frequency_hz == pytest.approx(wanted, rel=1e-12)
    assert abs(wanted / motion.facts.stride_frequency_hz - 1) > 0.01
    assert truth.step_frequency_hz == pytest.approx(2 * wanted)
    assert truth.gait_frequency_hz == pytest.approx(2 * wanted)


def write_half(target, fails):
    with open_atomically(target) as partial:
        partial.write_text("half")
        raise fails


@pytest.mark.parametrize(("fails", "raises"), [(OSError("disk full"), OutputError), (ValueError("bug"), ValueError)])
def test_a_failed_write_leaves_the_older_file(tmp_path, fails, raises):
    target = tmp_path / "a.txt"
    target.write_text("old")
    with pytest.raises(raises, match=r"^bug|a\.txt: cannot be written: disk full"):
        write_half(target, fails)
    assert os.listdir(tmp_path) == ["a.txt"]
    assert target.read_text() == "old"
