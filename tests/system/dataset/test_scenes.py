"""Scenes of a plan beyond one target in its truth gate: companions, nobody, tracks, folders of recordings."""

from collections import Counter
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pandas as pd
import pytest

from dataset_plans import dataset_hash
from doppelgait.core.config import validate
from doppelgait.core.errors import ConfigError, DatasetError, DoppelgaitWarning
from doppelgait.dataset import motions, open_dataset
from doppelgait.dataset.build import build_dataset
from doppelgait.dataset.config import PlanConfig, load_plan
from doppelgait.dataset.motions import expand_folders
from doppelgait.dataset.plan import plan_dataset
from doppelgait.dataset.shard import BuildContext, build_planned
from doppelgait.dataset.shard_files import decode
from doppelgait.dataset.verify import verify_dataset
from doppelgait.features import measure_columns
from doppelgait.motion import boulic_walk
from doppelgait.pipeline import run_simulation
from doppelgait.radar import Radar


def plan(**changes):
    dataset = {"name": "scenes", "examples_per_class": 8, "fractions": {"train": 1.0}, **changes.pop("dataset", {})}
    table = {
        "dataset": dataset,
        "classes": [{"label": "human", "motion": {"kind": "human", "speed_mps": {"uniform": [0.8, 1.5]}}}],
        "scene": {"duration_s": 2.5},
        "target": {"range_m": 5.0},
        "radar": {"preset": "x4"},
        **changes,
    }
    return validate(PlanConfig, table, where="plan")


def rows_of(config, number=0, folder=Path()):
    laid_out = plan_dataset(config, folder=folder)
    context = BuildContext(laid_out.config, str(folder), "")
    return list(build_planned([laid_out.examples[number]], context)[0])


def test_targets_of_one_scene_are_rows_with_their_own_label_signature_and_truth():
    dog = {"label": "dog", "motion": {"kind": "quadruped", "gait": "trot"}, "range_m": 8.0, "aspect_deg": 180.0}
    (person, mine), (other, its) = rows_of(plan(companions=[dog]))
    assert [person["label"], other["label"]] == ["human", "dog"]
    assert person["scene_id"] == other["scene_id"] == person["id"]
    assert person["split"] == other["split"]
    assert person["truth_gait"] == "walk"
    assert other["truth_gait"] == "trot"
    assert person["feature_torso_velocity_mps"] > 0.5  # the person comes
    assert other["feature_torso_velocity_mps"] < -0.5  # the dog goes
    assert not np.array_equal(mine["signature"], its["signature"])


def test_nobody_gives_a_row_of_noise_without_features_or_truth():
    empty = plan(classes=[{"label": "empty", "motion": "none"}], noise={"kind": "thermal"})
    ((row, stored),) = rows_of(empty)
    assert (row["source"], row["motion_kind"], row["motion"]) == ("none", "none", "")
    assert row["truth_ground_speed_mps"] is None
    assert row["truth_gait_frequency_hz"] is None
    assert row["snr_frame_db"] is None
    assert row["gait_frequency_hz"] is None
    levels = stored["signature"]
    # of independent exponential cells over a few range bins, the largest is nowhere far above the mean
    assert levels.max() / levels.mean() < 10
    assert np.corrcoef(levels[:-12].ravel(), levels[12:].ravel())[0, 1] < 0.05  # and nothing lasts


def test_a_track_gate_gives_the_features_of_the_body_without_its_truth():
    truth = rows_of(plan(noise={"kind": "snr", "snr_db": 20.0}))[0][0]
    tracked = rows_of(plan(dataset={"gate": "track"}, noise={"kind": "snr", "snr_db": 20.0}))[0][0]
    assert (truth["gate"], tracked["gate"]) == ("truth", "track")
    assert tracked["feature_torso_velocity_mps"] == pytest.approx(truth["feature_torso_velocity_mps"], rel=0.05)
    assert tracked["gait_frequency_hz"] == pytest.approx(truth["gait_frequency_hz"], rel=0.05)


def test_kept_arrays_have_axes_and_equal_the_simulation():
    fields = [
        {"name": "signature", "dtype": "half", "hop": 2}, "cadence_map", "baseband",
        {"name": "truth_range_m", "hop": 10}, "truth_radial_velocity_mps",
    ]  # fmt: skip
    config = plan(dataset={"fields": fields})
    ((_, stored),) = rows_of(config)
    recording = run_simulation(plan_dataset(config).example(0).run)
    assert np.array_equal(stored["baseband"], recording.baseband.values)
    scatterers = recording.truth[0].scatterers
    assert np.array_equal(stored["truth_range_m"], scatterers["range"].values[::10].astype("f4"))
    assert np.array_equal(stored["truth_radial_velocity_mps"], scatterers["radial_velocity"].values.astype("f4"))
    assert stored["truth_range_m_slow_time_s"].size == stored["truth_range_m"].shape[0]
    assert stored["signature_time_s"].size == stored["signature"].shape[0]
    ((_, full),) = rows_of(plan(dataset={"fields": [{"name": "signature", "dtype": "full"}]}))
    half = decode(stored["signature"], {"scale": "db"})
    assert np.allclose(half, full["signature"][::2], rtol=0.015)


def folder_plan(path="walks", **options):
    return plan(
        classes=[{"label": "human", "motion": {"kind": "folder", "path": path, **options}}],
        dataset={"examples_per_class": 6},
    )


@pytest.mark.release
def test_the_report_plan_names_its_leaks_and_verifies(walks):
    """On models' takes; the rates are those of packages/liland2018."""
    (walks / "dog").mkdir()
    (walks / "walks" / "take_2.csv").rename(walks / "dog" / "take_2.csv")
    changes = ["dataset.examples_per_class=2", "classes.0.motion.path=walks", "classes.0.motion.pattern=*.csv"]
    config, _ = load_plan("liland2018", overrides=[*changes, "classes.0.examples=5", "classes.2.examples=4"])
    for name in ("one", "two"):
        assert build_dataset(config, walks / name, folder=walks, workers=1).n_failed == 0
    assert dataset_hash(walks / "one") == dataset_hash(walks / "two")
    index = pd.read_parquet(walks / "one" / "index.parquet").set_index("id")
    assert index["label"].value_counts().to_dict() == {"human": 5, "walker": 4, "dog": 1}
    assert index.loc["human-000000", "observation_s"] == pytest.approx(6.0, abs=0.1)
    assert index.loc["human-000001", "observation_s"] == pytest.approx(3.0, abs=0.1)
    assert (index["truth_radial_velocity_mps"] < 0).tolist() == (index["truth_aspect_deg"].abs() > 90).tolist()
    assert index.loc[["human-000002", "walker-000002"], "truth_radial_velocity_mps"].max() < -0.4
    card = (walks / "one" / "README.md").read_text()
    for leak in ("radar.prf_hz", "scene.duration_s", "target.height_m", "target.rcs"):
        assert f"\n- `{leak}`: " in card
    checks = verify_dataset(walks / "one", folder=walks, rng=np.random.default_rng(0))
    assert checks.passed
    assert checks.check("nuisance").summary.endswith("leaks that the plan names: " + ", ".join(config.dataset.leaks))


def test_the_fair_report_plan_passes_verify(tmp_path):
    for place, name in enumerate(("human", "dog")):
        (tmp_path / name).mkdir()
        for number in range(4):
            write_take(tmp_path / name / f"{name}_{number}.csv", speed_mps=1.0 + 0.1 * number + 0.05 * place)
    counts = [f"classes.{number}.examples=4" for number in range(3)]
    config, _ = load_plan("liland2018-fair", overrides=counts)
    assert build_dataset(config, tmp_path / "fair", folder=tmp_path, executor="serial").n_failed == 0
    found = verify_dataset(tmp_path / "fair", folder=tmp_path, rng=np.random.default_rng(0))
    assert {c.name: c.summary for c in found.checks if c.status in ("failed", "skipped")} == {}
    assert found.check("feasibility").summary == "no row reaches a limit of the radar"


def write_take(path, *, speed_mps, duration_s=5.0):
    motion = boulic_walk(speed_mps=speed_mps, duration_s=duration_s)
    names = [f"{m}_{a}_m" for m in motion.markers for a in "xyz"]
    table = np.column_stack([motion.time_s, motion.position_m.reshape(motion.time_s.size, -1)])
    np.savetxt(path, table, delimiter=",", header=",".join(["time_s", *names]), comments="")


@pytest.fixture
def walks(tmp_path):
    """Three takes of a model written as tables: 6 s, 3 s and 1.4 s, and a file that is no motion."""
    (tmp_path / "walks").mkdir()
    for number, seconds in enumerate((6.0, 3.0, 1.4)):
        write_take(tmp_path / "walks" / f"take_{number}.csv", speed_mps=1.2 + 0.1 * number, duration_s=seconds)
    (tmp_path / "walks" / "notes.txt").write_text("no motion")
    return tmp_path


def test_a_folder_gives_its_straight_stretches_in_turn_and_loops_short_ones(walks, monkeypatch):
    find = Mock(wraps=motions.find_segments)
    monkeypatch.setattr(motions, "find_segments", find)
    with pytest.warns(DoppelgaitWarning, match=r"1 of 4 files are left out: walks/notes\.txt"):
        expanded = expand_folders(folder_plan(), walks)
    tables = expanded.classes[0].motion["cycle"]
    assert [t["path"] for t in tables] == [f"walks/take_{n}.csv" for n in range(3)]
    assert ["loop_to_s" in t for t in tables] == [False, False, True]
    with pytest.warns(DoppelgaitWarning):
        unlooped = expand_folders(folder_plan(loop=False, pattern="*"), walks)
    assert len(unlooped.classes[0].motion["cycle"]) == 2
    laid_out = plan_dataset(folder_plan(pattern="*.csv"), folder=walks)
    assert [e.subjects[0] for e in laid_out.examples] == 2 * [f"file/walks/take_{n}.csv" for n in range(3)]
    assert find.call_count == 3  # once for three plans
    ((row, _),) = rows_of(folder_plan(pattern="*.csv"), number=1, folder=walks)
    assert row["truth_ground_speed_mps"] == pytest.approx(1.3, rel=0.03)
    assert row["recording"] == "walks/take_1.csv"


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"path": "runs"}, r"classes\.0\.motion\.path: 'runs' is not allowed: there is no such folder"),
        ({"patern": "*"}, r"patern: unknown key; allowed are .*pattern"),
        ({"pattern": "*.txt"}, r"has no straight segment of gait .* in 1 files: .*no known motion format"),
        ({"min_duration_s": 50}, r"has no straight segment of gait"),
        ({"scene": {}}, r"scene\.duration_s: null is not allowed with a folder"),
    ],
)
def test_wrong_folders_are_refused(walks, options, says):
    config = folder_plan(**{key: value for key, value in options.items() if key != "scene"})
    config = config.model_copy(update={key: value for key, value in options.items() if key == "scene"})
    with pytest.raises((ConfigError, DatasetError), match=says):
        plan_dataset(config, folder=walks)


@pytest.mark.shared
@pytest.mark.release
def test_the_report_plan_has_the_170_scenarios_of_its_chapter_5(shared):
    config, _ = load_plan("liland2018")
    with pytest.warns(DoppelgaitWarning, match="files are left out"):
        laid_out = plan_dataset(config, folder=shared / "data" / "mocap")
    assert len(laid_out.examples) == 170
    found = Counter()
    for number in range(170):
        example = laid_out.example(number)
        (target,) = example.run.scene.targets
        assert (example.run.radar.pulse_sigma_s, example.run.auto_prf) == (1e-9, True)
        assert example.run.scene.duration_s is None
        assert "loop_to_s" not in target.motion
        found[example.label, target.aspect_deg, target.height_m, target.rcs.kind, target.rcs.total_m2] += 1
    assert found == {
        ("human", 0.0, 1.8, "equal", 1.0): 99, ("human", 180.0, 1.8, "equal", 1.0): 49,
        ("dog", 0.0, 0.2, "equal", 0.2): 1,
        ("walker", 0.0, 1.8, "equal", 1.0): 14, ("walker", 180.0, 1.8, "equal", 1.0): 7,
    }  # fmt: skip


@pytest.mark.parametrize("preset", ["infineon-24-burst", "ti-60-burst"])
def test_sensors_in_bursts_make_rows_that_verify(tmp_path, preset):
    fields = [{"name": "signature", "dtype": "full"}, "ti_frames"]
    config = plan(radar={"preset": preset}, dataset={"examples_per_class": 2, "fields": fields})
    build_dataset(config, tmp_path / "bursts", executor="serial")
    dataset = open_dataset(tmp_path / "bursts")
    radar = Radar.preset(preset)
    last_s = radar.pulse_times_s(2.5)[-1]
    np.testing.assert_allclose(dataset.index["observation_s"], last_s + 1 / radar.prf_hz, rtol=1e-12)
    assert dataset.index["feature_torso_velocity_mps"].between(0.5, 1.8).all()
    times_s = dataset.result(0).signature["time"]
    np.testing.assert_allclose(np.diff(times_s), radar.burst_period_s, rtol=1e-5)
    floor_v2 = float(dataset.index["quality_noise_floor_v2"][0])
    wanted = measure_columns(dataset.result(0).signature, noise_floor_v2=floor_v2)
    np.testing.assert_allclose(dataset.example(0).arrays["ti_frames"], wanted, rtol=1e-5)
    found = verify_dataset(tmp_path / "bursts", share=1.0, rng=np.random.default_rng(1))
    assert {check.name for check in found.checks if check.status == "failed"} == set(), found
