"""Limits that a plan foresees, against the warnings and flags of the dataset that is built from it."""

import json
import tomllib
from types import SimpleNamespace

import numpy as np
import pytest

from command import run
from doppelgait.core.config import validate
from doppelgait.dataset import open_dataset
from doppelgait.dataset.build import build_dataset
from doppelgait.dataset.config import PlanConfig
from doppelgait.dataset.feasibility import LIMITS, assess, find_limits, list_limit_keys
from doppelgait.dataset.plan import plan_dataset, sample_examples
from doppelgait.dataset.verify import verify_dataset
from doppelgait.dataset.verify.leakage import tabulate_nuisances
from doppelgait.radar import Radar

PLAN = """
[dataset]
name = "wall"
examples_per_class = 14
fields = []

[dataset.fractions]
train = 1.0

[scene]
duration_s = 1.6

[target]
range_m = { uniform = [2, 7] }
aspect_deg = { uniform = [-180, 180] }
rcs = { total_m2 = 0.5 }

[radar]
preset = "x4"
prf_hz = 500
range_stop_m = 8

[[background]]
choice = [{ motion = { kind = "fan" }, range_m = 4.0 }, {}]

[[classes]]
label = "human"
motion = { kind = "human", speed_mps = { uniform = [0.6, 1.9] } }

[[classes]]
label = "dog"
motion = { kind = "quadruped", gait = "auto", froude = { uniform = [0.1, 1.5] } }
"""


@pytest.fixture(scope="module")
def plan_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("wall") / "wall.toml"
    path.write_text(PLAN)
    return path


@pytest.fixture(scope="module")
def planned(plan_file):
    return plan_dataset(validate(PlanConfig, tomllib.loads(plan_file.read_text()), where="plan"))


@pytest.fixture(scope="module")
def wall(planned, tmp_path_factory):
    folder = tmp_path_factory.mktemp("built") / "wall"
    build_dataset(planned.config, folder, executor="serial", max_failed_share=0.5)
    return open_dataset(folder)


@pytest.mark.parametrize("pulses", [4096, 300])
def test_every_row_has_the_warnings_and_flags_of_its_simulation(planned, wall, monkeypatch, pulses):
    monkeypatch.setattr("doppelgait.dataset.feasibility.BLOCK_PULSES", pulses)
    rows = wall.index.set_index("id")
    found = [row for e in sample_examples(planned) for row in find_limits(e, planned.folder) if row.id in rows.index]
    assert len(found) == len(rows) >= 24
    for row in found:
        stated = [name for name in LIMITS if name in rows.warnings[row.id].split(";")]
        stated += ["gate cut off"] if "gate_leaves_frame" in rows.quality_flags[row.id].split(";") else []
        assert list(row.limits) == stated
        assert row.range_m == pytest.approx(rows.truth_range_m[row.id], rel=1e-6)
    for name in ("aliasing", "outside the frame", "gate cut off"):
        assert 0 < sum(name in row.limits for row in found) < len(found)


def test_the_expected_snr_is_that_of_the_frame_within_a_few_db(planned, wall):
    stated = wall.index.set_index("id")["snr_frame_db"]
    found = {row.id: row.snr_db for example in sample_examples(planned) for row in find_limits(example, planned.folder)}
    error_db = np.array([found[name] - stated[name] for name in stated.index])
    assert abs(np.median(error_db)) < 2.5
    assert np.abs(error_db).max() < 6


def test_the_leakage_test_has_the_cross_section_of_the_plan_or_that_of_the_bodies(planned, wall):
    examples = [one for one in sample_examples(planned) if {row.id for row in one.rows} <= {*wall.index["id"]}]
    names = tabulate_nuisances(wall.index, examples).columns
    assert "target.rcs.total_m2" in names
    assert "index.rcs_total_m2" not in names  # over the other it shows the shape of the body, which is no nuisance
    free = planned.config.model_copy(update={"target": {**planned.config.target, "rcs": {"kind": "surfaces"}}})
    names = tabulate_nuisances(wall.index, list(sample_examples(plan_dataset(free)))[: len(examples)]).columns
    assert "index.rcs_total_m2" in names


def test_counts_of_the_plan_are_in_card_description_and_verification(planned, wall):
    plan = assess(sample_examples(planned), planned.folder)
    counts = {row["class"]: row for row in wall.description["limits"]}
    left_out = len(planned.examples) - len(wall.index)
    for row in plan.limits:
        assert all(0 <= row[name] - counts[row["class"]][name] <= left_out for name in LIMITS)
    card = (wall.directory / "README.md").read_text()
    human = counts["human"]
    assert f"| human | {human['rows']} | {human['aliasing']} | {human['outside the frame']} |" in card
    assert "Keys of the plan to change: aliasing: radar.prf_hz; outside the frame: target.range_m" in card
    check = verify_dataset(wall.directory, share=0.0, rng=np.random.default_rng(0)).check("feasibility")
    assert check.status == "warning"
    dog = counts["dog"]
    stated = ", ".join(f"{name} {dog[name]}" for name in LIMITS if dog[name])
    assert f"dog: {stated} of {dog['rows']} rows" in check.summary
    assert check.numbers["human"]["gate cut off"] == human["gate cut off"]


def test_gates_of_tracks_are_left_to_the_build(plan_file, planned):
    plan = assess(sample_examples(planned, 4), planned.folder, gate="track")
    assert all(row["gate cut off"] is None for row in plan.limits)
    change = ["--set", "dataset.gate=track", "--set", "dataset.examples_per_class=2", "--pilot", "0"]
    done = run("dataset", "plan", str(plan_file), *change)
    heading = next(line for line in done.stdout.splitlines() if "aliasing" in line)
    assert "gate cut off" not in heading
    note = 'gate cut off: counted by the build, since the gates are those of tracks (dataset.gate = "track")'
    assert note in done.stdout


def test_plan_prints_the_table_and_reports_progress(plan_file, planned, monkeypatch):
    monkeypatch.setattr("doppelgait.cli.output.PROGRESS_DELAY_S", 0.0)
    expected = assess(sample_examples(planned), planned.folder)
    done = run("dataset", "plan", str(plan_file), "--pilot", "0")
    assert "drawing examples: 28 of 28" in done.stderr
    assert "checking ranges and speeds: 28 of 28" in done.stderr
    assert "pilot" not in run("dataset", "plan", str(plan_file), "--pilot", "2").stderr  # of a pipe
    monkeypatch.setattr("typer.get_text_stream", lambda name: SimpleNamespace(isatty=lambda: name == "stderr"))
    assert "simulating the pilot: 2 of 2" in run("dataset", "plan", str(plan_file), "--pilot", "2").stderr
    answer = run("dataset", "plan", str(plan_file), "--pilot", "0", "--json")
    assert answer.stderr == ""
    found = json.loads(answer.stdout)["feasibility"]
    assert found["limits"] == expected.limits
    assert [part["rows"] for part in found["snr"]] == [7, 7, 7, 7]


def test_the_keys_to_change_are_those_of_the_radar():
    keys = {name: [list_limit_keys(limit, Radar.preset(name)) for limit in LIMITS[2:4]] for name in ("x4", "ti-60")}
    assert keys["x4"] == [["target.range_m", "radar.pulse_rate_hz"], ["radar.decimation", "radar.sample_rate_hz"]]
    assert keys["ti-60"] == [["target.range_m", "radar.sample_rate_hz"], ["radar.sample_rate_hz"]]


def test_a_plan_with_targets_beyond_the_frame_has_its_tables(tmp_path):
    beyond = PLAN.replace("uniform = [2, 7]", "uniform = [14, 30]").replace("range_stop_m = 8", "range_stop_m = 9.6")
    path = tmp_path / "beyond.toml"
    path.write_text(beyond)
    done = run("dataset", "plan", str(path), "--pilot", "2")
    lines = [line.split() for line in done.stdout.splitlines()]
    assert ["class", "rows", "aliasing", "outside", "the", "frame", "folding", "gate", "cut", "off"] in lines
    human = next(line for line in lines if line[:1] == ["human"] and len(line) == 6)
    assert human[3:] == ["14", "14", "14"]
    assert "outside the frame: target.range_m, radar.range_stop_m" in done.stdout
    assert "folding: target.range_m, radar.pulse_rate_hz\n" in done.stdout  # and no sampling rate, which sweeps have
    first = lines.index(["range", "(m)", "rows", "without", "echo", "SNR_frame", "(dB)"]) + 1
    assert [line[-2:] for line in lines[first : first + 4]] == [["7", "7"]] * 4
    assert "2 of 2 examples of the pilot failed; the first is human-000000: gate" in done.stderr
