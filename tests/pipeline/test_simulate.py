"""Simulated pulses: in bursts, in tiles, and of rooms that are seen less often than pulses."""

import importlib
import pickle
from dataclasses import replace

import h5py
import numpy as np
import pytest

import doppelgait as dg
from doppelgait.core.errors import ConfigError, DoppelgaitWarning, OutputError
from doppelgait.pipeline import Conditions, parse_run, run_simulation
from doppelgait.radar import Radar, Recording, open_stream, read_recording, write_recording
from doppelgait.radar.frames import write_frames
from doppelgait.scene.environment import make_effect

WALK = dg.motion.human_gait(speed_mps=1.2, duration_s=3.0)
SCENE = dg.Scene(targets=[dg.Target(WALK, range_m=4.0)], duration_s=2.0)


def simulate(radar: Radar, **options: object) -> Recording:
    return dg.simulate(SCENE, radar, **options)


@pytest.mark.parametrize(
    ("preset", "changes", "pulses", "period"),
    [
        ("infineon-24", {}, 128, 600),
        ("ti-60", {"prf_hz": 5000.0, "range_stop_m": 6.0}, 96, 275),
        ("x4", {"range_stop_m": 6.0}, 32, 100),
    ],
)
def test_bursts_are_the_same_pulses_as_without_pauses(preset, changes, pulses, period):
    whole = simulate(Radar.preset(preset, **changes))
    prf_hz = whole.radar.prf_hz
    radar = Radar.preset(preset, **changes, burst_pulses=pulses, burst_period_s=period / prf_hz)
    bursts = simulate(radar)
    taken = (np.arange(0, whole.n_pulses - pulses + 1, period)[:, None] + np.arange(pulses)).ravel()
    np.testing.assert_allclose(bursts.slow_time_s, whole.slow_time_s[taken], rtol=0, atol=1e-12)
    wanted = whole.samples.matrix[taken]
    assert np.abs(bursts.samples.matrix - wanted).max() < 1e-6 * np.abs(wanted).max()
    assert bursts.facts["burst_pulses"] == pulses
    np.testing.assert_allclose(bursts.truth[0].centre_range_m, whole.truth[0].centre_range_m[taken], rtol=0, atol=1e-9)


@pytest.mark.parametrize("preset", ["infineon-60-burst", "ti-60-burst"])
def test_targets_are_tracked_in_bursts_as_without_pauses(preset):
    gaits = dg.motion.human_gait(speed_mps=1.2, duration_s=6.0), dg.motion.boulic_walk(speed_mps=0.9, duration_s=6.0)
    targets = [dg.Target(gaits[0], range_m=4.0), dg.Target(gaits[1], range_m=3.0, aspect_deg=180.0)]
    scene, radar = dg.Scene(targets=targets, duration_s=5.0), Radar.preset(preset)
    even = radar.model_copy(update={"burst_pulses": None, "burst_period_s": None})
    recording, whole = (dg.simulate(scene, one, rng=dg.rng(5), snr_db=15) for one in (radar, even))
    found, wanted = ({np.sign(one.torso_doppler_hz): one for one in dg.analyze(each)} for each in (recording, whole))
    assert set(found) == set(wanted) == {-1.0, 1.0}
    for side, one in found.items():
        truth = recording.truth[0 if side > 0 else 1]
        assert one.signature.attrs["cpi_pulses"] == radar.burst_pulses
        error_m = one.gate.centre_m - np.interp(one.gate.time_s, recording.slow_time_s, truth.centre_range_m)
        assert np.median(np.abs(error_m)) < 0.2
        velocity_mps = wanted[side].features.torso_velocity_mps
        assert one.features.torso_velocity_mps == pytest.approx(velocity_mps, abs=0.1)


def test_frames_in_bursts_are_streamed_with_their_times(tmp_path):
    made = simulate(Radar.preset("infineon-24-burst"))
    # as a reader of a measured recording makes it: the bursts are a fact of the samples alone
    plain = made.radar.model_copy(update={"burst_pulses": None, "burst_period_s": None})
    recorded = replace(made, radar=plain, facts={"burst_pulses": made.radar.burst_pulses}, truth=())
    write_recording(recorded, tmp_path / "walk.h5")
    write_frames(recorded, tmp_path / "walk.dgf")
    back = read_recording(tmp_path / "walk.dgf")
    np.testing.assert_allclose(back.slow_time_s, made.slow_time_s, rtol=0, atol=1e-12)
    assert back.facts["burst_pulses"] == 128
    for name in ("walk.h5", "walk.dgf"):
        with open_stream(tmp_path / name, timeout_s=0) as stream:
            items = list(stream)
            assert (stream.radar.burst_pulses, stream.radar.burst_period_s) == (128, pytest.approx(0.2))
        np.testing.assert_allclose([time_s for time_s, _ in items], made.slow_time_s, rtol=0, atol=1e-12)
        np.testing.assert_array_equal(np.stack([row for _, row in items]), made.samples.matrix)


def test_of_a_file_with_lost_frames_whole_bursts_are_kept_at_their_times(tmp_path):
    made = simulate(Radar.preset("infineon-24-burst"))
    write_frames(made, tmp_path / "walk.dgf")
    content = (tmp_path / "walk.dgf").read_bytes()
    size = 16 + 16 + 8
    start = len(content) - 16 - size * made.n_pulses
    lost = start + size * 300, start + size * 310  # in the third burst
    (tmp_path / "walk.dgf").write_bytes(content[: lost[0]] + content[lost[1] :])
    with pytest.warns(DoppelgaitWarning, match="1 incomplete bursts are ignored"):
        back = read_recording(tmp_path / "walk.dgf")
    kept = np.delete(np.arange(made.n_pulses), np.s_[256:384])
    np.testing.assert_array_equal(back.samples.matrix, made.samples.matrix[kept])
    np.testing.assert_allclose(back.slow_time_s, made.slow_time_s[kept], rtol=0, atol=1e-12)


def test_only_whole_bursts_are_simulated():
    radar = Radar.preset("infineon-24-burst")
    times_s = radar.pulse_times_s(1.0 + 127 / 3000)
    assert times_s.size == 5 * 128
    assert radar.pulse_times_s(1.0 + 128 / 3000).size == 6 * 128
    assert radar.pulse_times_s(0.04).size == 0
    with pytest.raises(ConfigError, match="less than a burst of 128 frames"):
        dg.simulate(SCENE.model_copy(update={"duration_s": 0.04}), radar)


def test_radars_without_bursts_are_stored_as_before():
    assert not {key for key in Radar.preset("x4").model_dump(mode="json") if key.startswith("burst")}
    radar = Radar.preset("ti-60-burst")
    assert Radar.model_validate(radar.model_dump(mode="json")) == radar


TILE = 300


def scene(rcs=None, **further):
    targets = [
        {"label": "human", "motion": {"kind": "human"}, "range_m": 4.0, **({"rcs": rcs} if rcs else {})},
        {"label": "dog", "motion": {"kind": "quadruped"}, "range_m": 3.0},
        {"background": True, "motion": {"kind": "fan"}, "range_m": 5.0},
    ]
    return {"duration_s": 2.03, "seed": 5, "targets": targets, "radar": X4, **further}


X4 = {"preset": "x4", "prf_hz": 500.0}
BEAM = {"kind": "cosine", "hpbw_azimuth_deg": 60.0, "hpbw_elevation_deg": 60.0}
CASES = {
    "impulse": scene(),
    "fmcw": scene(radar={"preset": "ti-77", "prf_hz": 600.0}),
    "cw": scene(radar={"preset": "xband-cw", "prf_hz": 500.0}),
    "no noise": scene(noise={"kind": "none"}),
    "a wanted SNR": scene(noise={"kind": "snr", "snr_db": 3.0}),
    "an environment": scene(environment=[{"kind": "ground_bounce"}]),
    "an antenna": scene(radar={**X4, "antenna": BEAM}),
    "gains of every pulse": scene({"kind": "surfaces", "occlusion": True}),
    "one target": scene(targets=scene()["targets"][:1]),
}


def make(table, **options):
    return run_simulation(parse_run(table, where="test", text="", folder=None), **options)


@pytest.mark.filterwarnings("ignore::doppelgait.core.errors.DoppelgaitWarning")
@pytest.mark.parametrize("case", CASES)
def test_tiles_give_the_bytes_of_the_whole(case, tmp_path, monkeypatch):
    make(CASES[case], path=tmp_path / "whole.h5")
    monkeypatch.setattr("doppelgait.core.lazy.LONG_PULSES", TILE)
    monkeypatch.setattr("doppelgait.radar.recordings.STORED_BYTES", 0)
    stored, tiled = make(CASES[case], path=tmp_path / "tiled.h5"), make(CASES[case])
    assert (tmp_path / "tiled.h5").read_bytes() == (tmp_path / "whole.h5").read_bytes()
    assert not stored.samples.in_memory
    assert tiled.samples.in_memory
    np.testing.assert_array_equal(stored.samples.rows(7, 9), tiled.samples.matrix[7:9])
    with h5py.File(tmp_path / "tiled.h5") as file:
        np.testing.assert_array_equal(file["baseband"][:], tiled.samples.matrix)
        np.testing.assert_array_equal(file["truth/0/aspect_rad"][:], tiled.truth[0].scatterers["aspect"].values)


@pytest.mark.filterwarnings("ignore::doppelgait.core.errors.DoppelgaitWarning")
@pytest.mark.parametrize(("case", "kind"), [("fmcw", "dc_leak"), ("impulse", "phase_noise")])
def test_impairments_of_tiles_are_those_of_the_whole(case, kind, monkeypatch):
    table = {**CASES[case], "impairments": [{"kind": kind}, {"kind": "frame_jitter", "sd_s": 1e-5}]}
    whole = make(table)
    monkeypatch.setattr("doppelgait.core.lazy.LONG_PULSES", TILE)
    tiled = pickle.loads(pickle.dumps(make(table)))
    np.testing.assert_array_equal(tiled.samples.matrix, whole.samples.matrix)
    for seen, there in zip(tiled.truth, whole.truth, strict=True):
        assert seen.scatterers.identical(there.scatterers)
        assert seen.scatterers.slow_time.values.tobytes() == tiled.slow_time_s.tobytes()


def test_a_file_that_cannot_be_made_is_refused_before_the_work(tmp_path, monkeypatch):
    module = importlib.import_module("doppelgait.pipeline.simulate")
    monkeypatch.setattr(module, "observe_scene", lambda *_, **__: pytest.fail("the scene was observed before"))
    for path, message in (("", "names no file"), (tmp_path / "none" / "a.h5", "no such folder")):
        with pytest.raises(OutputError, match=message):
            make(CASES["impulse"], path=path)


def test_only_one_tile_of_a_long_recording_is_computed_at_a_time(tmp_path, monkeypatch):
    monkeypatch.setattr("doppelgait.core.lazy.LONG_PULSES", TILE)
    module, sizes = importlib.import_module("doppelgait.pipeline.simulate"), []
    synthesise = module.synthesise_echoes

    def counted(scatterers, radar, *, compressed):
        sizes.append(scatterers.shape[0])
        return synthesise(scatterers, radar, compressed=compressed)

    monkeypatch.setattr(module, "synthesise_echoes", counted)
    scene = dg.Scene([dg.Target({"kind": "human"})], duration_s=2.03)
    radar = dg.Radar.preset("x4", prf_hz=500.0)
    recording = dg.simulate(scene, radar, rng=dg.rng(1), path=tmp_path / "a.h5")
    assert sum(sizes) == 2 * recording.n_pulses  # once for the level, once for the file
    assert max(sizes) == TILE
    sizes.clear()
    dg.simulate(scene, radar, rng=dg.rng(1))
    assert sum(sizes) == recording.n_pulses


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
