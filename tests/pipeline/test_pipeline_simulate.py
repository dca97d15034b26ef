"""The chain from a scene to features: what the gates need, at which hop, and what is refused."""

import csv
from pathlib import Path

import numpy as np
import pytest

from doppelgait.core.errors import ConfigError, MotionError, RecordingError
from doppelgait.core.frames import SlowTime
from doppelgait.core.rng import rng
from doppelgait.core.samples import Samples
from doppelgait.motion import boulic_walk, quadruped_gait, read
from doppelgait.pipeline import Conditions, analyze, parse_run, run_simulation, simulate
from doppelgait.processing import Analysis, Gate
from doppelgait.processing.signature import make_gated_transform
from doppelgait.radar import Radar, write_recording
from doppelgait.scene import Scene, Target

WALK = boulic_walk(speed_mps=1.3, height_m=1.7, duration_s=3.0)
TROT = quadruped_gait(gait="trot", withers_m=0.4, duration_s=3.0)

X4 = Radar.preset("x4")
SCENES = {
    "one": Scene([Target(WALK, label="human", aspect_deg=20.0)]),
    "receding": Scene([Target(TROT, label="dog", aspect_deg=180.0, range_m=4.0)]),
    "passing": Scene([Target(WALK, label="human", range_m=5.0), Target(TROT, range_m=5.0, aspect_deg=180.0)]),
}


def example(scene, analysis, radar=X4, seed=2):
    return analyze(simulate(scene, radar, rng=rng(seed), angles=False), gate="truth", analysis=analysis)


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


def test_two_recordings_share_no_memory_and_cannot_be_changed():
    one, other = (simulate(SCENES["one"], X4, rng=rng(1), angles=False) for _ in range(2))
    assert not np.shares_memory(one.samples.planes, other.samples.planes)
    before = one.baseband.values.copy()
    changed = one.samples
    changed += 1.0
    changed = one.samples.add_pending_noise()
    changed *= 0.0
    np.testing.assert_array_equal(one.samples.matrix, before)
    with pytest.raises(ValueError, match="read-only"):
        one.baseband.values[0, 0] = 0


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
    found = {}
    for hop in (1, 2, 8):
        with pytest.warns(match="outside the frame"):
            found[hop] = example(SCENES["one"], Analysis(hop=hop), radar)[0]
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
def walk(request, shared, segments):
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
def test_torso_velocity_follows_the_torso_markers(walk):
    recording, result, segment = walk
    velocity = result.features.torso_velocity_mps
    assert velocity == pytest.approx(torso_speed_mps(recording, result), rel=0.03)
    assert velocity == pytest.approx(float(segment["speed_mps"]), rel=0.05)


@pytest.mark.shared
def test_gait_frequency_is_the_step_frequency(walk):
    _, result, segment = walk
    assert result.gait_frequency_hz == pytest.approx(2 * float(segment["stride_hz"]), rel=0.05)


@pytest.mark.shared
def test_the_signature_reaches_the_fastest_foot_and_no_further(walk):
    recording, result, _ = walk
    fastest_hz = recording.truth[0].doppler_hz(recording.radar.wavelength_m).max()
    mu = result.signature.values
    doppler_hz = result.signature.coords["doppler"].values
    assert mu[:, doppler_hz > fastest_hz + 40].max() < 1e-3 * mu.max()
    assert mu[:, np.abs(doppler_hz - 0.9 * fastest_hz) < 20].max() > 1e-4 * mu.max()


@pytest.mark.shared
def test_a_receding_person_has_negative_velocity(shared):
    motion = read(shared / "data" / "mocap" / "human/c3d/cmu_07_01.c3d")
    recording = simulate(Scene([Target(motion, aspect_deg=180.0)]), Radar.preset("x4"))
    result = analyze(recording, gate="truth")[0]
    assert result.features.torso_velocity_mps == pytest.approx(-1.366, rel=0.05)
    assert result.features.step_length_m > 0
