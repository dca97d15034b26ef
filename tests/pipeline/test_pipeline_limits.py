"""What a user may give: every mistake is a DoppelgaitError with a clear text, every limit is held."""

import os
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import doppelgait as dg
from doppelgait.core.errors import AnalysisError, ConfigError, DoppelgaitWarning, OutputError
from doppelgait.core.files import open_atomically
from doppelgait.motion.models.boulic import boulic_walk
from doppelgait.pipeline import parse_run, run_simulation, simulate
from doppelgait.processing import Analysis
from doppelgait.radar import Radar
from doppelgait.radar.simulate import warn_of_limits
from doppelgait.scene import RcsSpec, Scene, Target, assemble
from doppelgait.scene.placement import build_motion

INF, NAN = float("inf"), float("nan")


@pytest.fixture(scope="module")
def walk():
    return boulic_walk(speed_mps=1.2, duration_s=1.0)


TARGET, SCENE = partial(Target, {"kind": "boulic"}), partial(Scene, [Target({"kind": "boulic"})])


@pytest.mark.parametrize(
    ("make", "options", "says"),
    [
        (TARGET, {"height_m": -1}, r"Target: height_m: -1 is not allowed.*greater than 0"),
        (TARGET, {"range_m": INF}, "range_m: inf.*"),
        (TARGET, {"range_m": "near"}, "range_m: 'near'.*must be a number"),
        (TARGET, {"start_position_m": (NAN, 1.0), "heading_deg": 0.0}, "start_position_m.0: nan.*finite"),
        (TARGET, {"start_position_m": (1.0, 1.0), "heading_deg": NAN}, "heading_deg: nan"),
        (TARGET, {"aspect_deg": INF}, "aspect_deg: inf"),
        (TARGET, {"bearing_deg": 1000.0}, "bearing_deg: 1000.0.*less than or equal to 360"),
        (TARGET, {"label": 3}, "label: 3"),
        (TARGET, {"rcs": "foo"}, r"rcs.kind: 'foo'.*known are auto, body_parts, equal, surfaces"),
        (TARGET, {"rcs": 3.0}, "rcs: 3.0"),
        (SCENE, {"radar_position_m": (0, 0)}, "Scene: radar_position_m.2: is required"),
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


def test_a_small_share_outside_the_frame_is_not_called_0_percent(walk):
    table = assemble(Scene([Target(walk)]), np.arange(500) / 1000)
    table["range"].values[0, 0] = 50.0
    with pytest.warns(DoppelgaitWarning, match=r"outside the frame: less than 1 % of all"):
        warn_of_limits(table, Radar.preset("x4", fold_echoes=False))


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


def test_a_motion_file_is_read_once(monkeypatch, walk):
    import doppelgait.motion.readers as readers

    asked = []
    monkeypatch.setattr(readers, "read", lambda path, **options: asked.append(path.name) or walk)
    targets = [{"motion": {"kind": "file", "path": "walk.c3d"}}, {"motion": {"kind": "boulic"}, "bearing_deg": 40}]
    recording = run_simulation(parse_run({"targets": targets}))
    assert asked == ["walk.c3d"]
    assert recording.n_pulses == 1000  # as long as the file's motion, not the model's default


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


def uneven_walk(duration_s):
    table = {"kind": "boulic", "speed_mps": 1.2, "stride_variation": 0.08}
    return build_motion(table, duration_s=duration_s, rng=dg.rng(5))


def strides(motion, until_s, foot="left_foot"):
    times = np.array(motion.facts.footfalls[foot])
    times = times[times <= until_s]
    return (times.size - 1) / (times[-1] - times[0])


def test_truth_frequencies_are_those_of_the_observation():
    motion = uneven_walk(30.0)
    truth = simulate(Scene([Target(motion, range_m=6.0)], duration_s=4.0), Radar.preset("x4")).truth[0]
    wanted = np.mean([strides(motion, 4.0, foot) for foot in ("left_foot", "right_foot")])
    assert truth.stride_frequency_hz == pytest.approx(wanted, rel=1e-12)
    assert abs(wanted / motion.facts.stride_frequency_hz - 1) > 0.01
    assert truth.step_frequency_hz == pytest.approx(2 * wanted)
    assert truth.gait_frequency_hz == pytest.approx(2 * wanted)


def test_an_observation_of_less_than_a_stride_takes_the_touchdowns_around_it():
    motion = uneven_walk(10.0)
    truth = simulate(Scene([Target(motion)], duration_s=0.3), Radar.preset("x4")).truth[0]
    feet = [np.array(times) for times in motion.facts.footfalls.values()]
    early = [1 / (t[1] - t[0]) for t in feet] + [2 / (t[2] - t[0]) for t in feet]
    assert min(early) <= truth.stride_frequency_hz <= max(early)


def test_a_motion_without_footfalls_keeps_what_is_known(walk):
    bare = walk.with_facts(footfalls={}, stride_frequency_hz=NAN, step_frequency_hz=NAN, gait_frequency_hz=NAN)
    truth = simulate(Scene([Target(bare)]), Radar.preset("x4")).truth[0]
    assert np.isnan([truth.stride_frequency_hz, truth.step_frequency_hz, truth.gait_frequency_hz]).all()


def test_a_file_appears_when_it_is_complete(tmp_path: Path) -> None:
    with open_atomically(tmp_path / "a.txt") as partial:
        partial.write_text("new")
        assert not (tmp_path / "a.txt").exists()
    assert os.listdir(tmp_path) == ["a.txt"]
    assert (tmp_path / "a.txt").read_text() == "new"


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
