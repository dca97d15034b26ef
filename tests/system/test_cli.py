"""The command as a user meets it."""

import io
import json
import re
import subprocess
import sys
import warnings
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest

import doppelgait.cli.app as cli_app
import processes
from doppelgait.cli.app import main
from doppelgait.dataset import load_plan, plan_names
from doppelgait.dataset.config import PLANS

START = processes.COMMAND[-1]
SCENE = """
seed = 5
duration_s = 2.0

[radar]
preset = "x4"

[noise]
kind = "snr"
snr_db = 20

[[targets]]
label = "human"
motion = { kind = "boulic", speed_mps = 1.2 }

[[targets]]
label = "dog"
motion = { kind = "quadruped", gait = "trot" }
start_position_m = [2.0, -1.0]
heading_deg = 0
"""


def run(*arguments, cwd=None, code=0):
    """The same in this process, which has the libraries loaded: the second or two of a start are not paid each time."""
    out, err = io.StringIO(), io.StringIO()
    argv = ["doppelgait", *map(str, arguments)]
    with pytest.MonkeyPatch.context() as patched, warnings.catch_warnings():
        warnings.resetwarnings()
        patched.setattr(sys, "argv", argv)
        patched.setenv("COLUMNS", "200")
        patched.chdir(cwd or Path.cwd())
        with redirect_stdout(out), redirect_stderr(err):
            status = _exit_status()
    assert status == code, err.getvalue() + out.getvalue()
    return subprocess.CompletedProcess(argv, status, out.getvalue(), err.getvalue())


def _exit_status():
    """Exit status of the command; anything but a way out fails the test with its traceback."""
    try:
        main()
    except SystemExit as end:
        return end.code or 0
    return 0


@pytest.mark.parametrize("text", ["Unable to allocate 74.5 GiB for an array with shape (100000000, 100)", ""])
def test_a_lack_of_memory_is_one_line(monkeypatch, capsys, text):
    def no_memory():
        raise MemoryError(text)

    monkeypatch.setattr(cli_app, "app", no_memory)
    assert _exit_status() == 1
    said = capsys.readouterr().err
    assert said.strip() == f"error: this computer does not have enough memory: {text or 'no memory is left'}"


def test_in_a_process_of_its_own_the_command_says_the_same(recorded):
    for arguments, code in ((("radar", "show", "x4"), 0), (("radar", "show", "x9"), 2)):
        alone, here = (
            processes.python(START, *arguments, cwd=recorded, code=code, COLUMNS="200"),
            run(*arguments, cwd=recorded, code=code),
        )
        assert (alone.stdout, alone.stderr) == (here.stdout, here.stderr)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cli")
    (folder / "scene.toml").write_text(SCENE)
    (folder / "file.toml").write_text('targets = [{ motion = { kind = "file", path = "a.c3d" } }]')
    run("simulate", "scene.toml", "-o", "rec.h5", cwd=folder)
    return folder


def test_help_loads_no_science():
    done = run("--help")
    assert "simulate" in done.stdout
    script = (
        "import sys, doppelgait.cli.app as a, typer.main as m; m.get_command(a.app); "
        "heavy = {'numpy', 'scipy', 'xarray', 'pandas', 'matplotlib', 'h5py', 'sklearn', 'pydantic'}; "
        "print(sorted(heavy & set(sys.modules)))"
    )
    assert processes.python(script).stdout.strip() == "[]"


@pytest.mark.parametrize(
    "command",
    [
        ["motion", "info"], ["simulate"], ["analyze"], ["dataset", "build"], ["demo"], ["evaluate"], ["classify"],
        ["reproduce"], ["live"],
    ],
)  # fmt: skip
def test_every_command_has_help_with_an_example(command):
    said = run(*command, "--help").stdout
    assert "Example: doppelgait" in said
    assert ("Paths are relative to the scene file" in said) == (command == ["simulate"])


def test_the_recording_has_the_documented_layout(recorded):
    with h5py.File(recorded / "rec.h5") as file:
        assert file["baseband"].dtype == np.complex64
        assert file["baseband"].shape == (2000, 188)
        assert file["slow_time_s"].shape == (2000,)
        assert [file[name].attrs["units"] for name in ("baseband", "slow_time_s", "range_m")] == ["V", "s", "m"]
        assert file.attrs["seed"] == 5
        assert json.loads(file.attrs["radar"])["carrier_hz"] == 7.29e9
        assert file["truth/0"].attrs["label"] == "human"
        assert file["truth/1"].attrs["gait"] == "trot"
        assert file["truth/0/range_m"].shape == file["truth/0/radial_velocity_mps"].shape == (2000, 20)
        assert file["truth/0"].attrs["gait_frequency_hz"] == pytest.approx(
            2 * file["truth/0"].attrs["stride_frequency_hz"]
        )


def test_analyze_prints_the_documented_json(recorded):
    done = run("analyze", "rec.h5", "--gate", "truth", "--json", "-o", "res.h5", cwd=recorded)
    document = json.loads(done.stdout)
    assert [t["label"] for t in document["targets"]] == ["human", "dog"]
    human = document["targets"][0]
    assert list(human["features"]) == [
        "torso_velocity_mps", "doppler_bandwidth_hz", "step_length_m",
        "harmonic_ratio_2", "harmonic_ratio_3", "limb_torso_ratio",
    ]  # fmt: skip
    assert human["features"]["torso_velocity_mps"] == pytest.approx(1.2, abs=0.06)
    assert document["targets"][1]["features"]["torso_velocity_mps"] < 0
    assert human["gate"] == "truth"
    assert {"quality", "flags", "n_periods", "torso_doppler_hz", "gait_frequency_hz"} <= set(human)
    with h5py.File(recorded / "res.h5") as file:
        group = file["targets/0"]
        assert group.attrs["gate"] == "truth"
        assert group["signature"].shape == (group["time_s"].size, group["doppler_hz"].size)
        assert group["cadence_map"].shape == (group["cadence_hz"].size, group["doppler_hz"].size)
        assert group.attrs["torso_velocity_mps"] == pytest.approx(human["features"]["torso_velocity_mps"])


def test_analyze_draws_figures(recorded):
    run("simulate", "--motion", "boulic", "--label", "human", "--duration", "2", "-o", "one.h5", cwd=recorded)
    run("analyze", "one.h5", "--gate", "truth", "--figures", "figures", cwd=recorded)
    names = {p.name for p in (recorded / "figures").glob("*.png")}
    assert {"range-time.png", "0-human-signature.png", "0-human-truth-doppler.png"} <= names
    assert all(p.stat().st_size > 5000 for p in (recorded / "figures").glob("*.png"))


def test_models_can_be_simulated_without_a_file(tmp_path):
    run("simulate", "--motion", "boulic", "--label", "human", "--speed", "1.4", "--height", "1.6", "--aspect", "180",
        "--duration", "2", "--snr-db", "inf", "-o", "r.h5", cwd=tmp_path)  # fmt: skip
    with h5py.File(tmp_path / "r.h5") as file:
        truth = file["truth/0"]
        assert truth.attrs["height_m"] == pytest.approx(1.6)
        assert truth["centre_velocity_mps"][:].mean() == pytest.approx(-1.4, abs=0.05)
        assert file.attrs["noise_power_v2"] == 0


def test_options_change_the_scene_file_too(recorded):
    run("simulate", "scene.toml", "-o", "changed.h5", "--radar", "x4-long", "--label", "child", "--speed", "0.8",
        "--set", "radar.prf_hz=900", cwd=recorded)  # fmt: skip
    with h5py.File(recorded / "changed.h5") as file:
        radar = json.loads(file.attrs["radar"])
        assert (radar["range_stop_m"], radar["prf_hz"]) == (40.0, 900.0)
        assert [file[f"truth/{n}"].attrs["label"] for n in (0, 1)] == ["child", "dog"]
        assert file["truth/0"].attrs["ground_speed_mps"] == pytest.approx(0.8, rel=0.05)


@pytest.mark.parametrize(("radar", "prf_hz"), [("x4", 1000.0), ("r.toml", 650.0)])
def test_a_radar_option_replaces_the_whole_radar_and_is_relative_to_the_working_folder(tmp_path, radar, prf_hz):
    (tmp_path / "scenes").mkdir()
    (tmp_path / "scenes" / "s.toml").write_text(SCENE.replace('preset = "x4"', 'preset = "x4"\nprf_hz = 700'))
    (tmp_path / "r.toml").write_text('preset = "x4"\nprf_hz = 650.0\n')
    run("simulate", "scenes/s.toml", "-o", "x.h5", "--radar", radar, cwd=tmp_path)
    with h5py.File(tmp_path / "x.h5") as file:
        assert json.loads(file.attrs["radar"])["prf_hz"] == prf_hz


def test_the_same_warning_is_said_once():
    script = (
        "import warnings; from doppelgait.cli.output import show_warnings_plainly as s; "
        "from doppelgait.core.errors import DoppelgaitWarning as W; s(); "
        "[warnings.warn(t, W) for t in ('no unit', 'no unit', 'other')]"
    )
    assert processes.python(script).stderr.splitlines() == ["warning: no unit", "warning: other"]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["simulate", "file.toml", "-o", "x.h5", "--speed", "2"], r"--speed 2.0: a recording \(a.c3d\)"),
        (["simulate", "scene.toml", "-o", "x.h5", "--radar", "x9"], "'x9'; known are.*x4"),
        (["simulate", "scene.toml", "-o", "x.h5", "--radar", "r.toml"], "error: --radar: .*r.toml: cannot be read"),
        (["simulate", "-o", "x.h5"], "either a scene file or --motion"),
        (["simulate", "nothing.toml", "-o", "x.h5"], "nothing.toml: cannot be read"),
        (["simulate", "scene.toml", "-o", "x.mat"], r"must end in \.dgf, \.h5"),
        (["simulate", "scene.toml", "-o", "no/x.h5"], "does not exist"),
        (["simulate", "scene.toml", "-o", "x.h5", "--set", "radar.prf=900"], "prf.*unknown key.*prf_hz"),
        (["simulate", "scene.toml", "-o", "x.h5", "--set", "targets.0.motion.speed_mps=9"], "targets.0.*speed_mps"),
        (["simulate", "--motion", "nobody.c3d", "-o", "x.h5"], "nobody.c3d: neither a file nor a model"),
        (["analyze", "scene.toml"], "no known recording format"),
        (["analyze", "missing.h5"], "no such file"),
        (["analyze", "rec.h5", "--gate", "magic"], "'magic' is not allowed"),
        (["analyze", "rec.h5", "--gate", "truth", "--set", "cpi_s=30"], "cpi_s"),
        (["radar", "show", "x9"], "unknown radar preset 'x9'"),
        (["dataset", "build", "no-plan"], "built-in plans are: home-alarm"),
    ],
)  # fmt: skip
def test_mistakes_get_one_clear_error_and_exit_status_2(recorded, arguments, says):
    done = run(*arguments, cwd=recorded, code=2)
    assert done.stdout == ""
    message = done.stderr.strip()
    assert message.startswith("error: ")
    assert len(message.splitlines()) == 1
    assert re.search(says, message)


def test_debug_shows_the_traceback():
    done = processes.run([*processes.COMMAND, "--debug", "radar", "show", "x9"], capture_output=True, text=True)
    assert "Traceback" in done.stderr


def test_radar_show_prints_derived_quantities():
    document = json.loads(run("radar", "show", "x4", "--set", "prf_hz=300", "--json").stdout)
    assert document["derived"]["unambiguous_velocity_mps"] == pytest.approx(3.084, abs=1e-3)
    assert document["derived"]["bin_spacing_m"] == pytest.approx(0.0514047, abs=1e-7)
    assert json.loads(run("radar", "list", "--json").stdout)["x4"]["carrier_hz"] == 7.29e9


def test_dataset_build_prints_a_report_and_resumes(tmp_path):
    small = ["--set", "dataset.examples_per_class=4", "--set", "dataset.fractions={train=0.5, test=0.5}"]
    first = json.loads(run("dataset", "build", "home-alarm", "-o", "d", "--json", *small, cwd=tmp_path).stdout)
    assert (first["n_examples"], first["n_built"]) == (8, 8)
    again = run("dataset", "build", "home-alarm", "-o", "d", *small, cwd=tmp_path)
    assert "0 built" in again.stdout
    assert "torso_velocity_mps [m/s]" in again.stdout
    assert len(pd.read_parquet(tmp_path / "d" / "index.parquet")) == 8


def test_an_empty_room_needs_no_target(tmp_path):
    (tmp_path / "room.toml").write_text('duration_s = 1\n[radar]\npreset = "x4"\n')
    run("simulate", "room.toml", "-o", "room.h5", "--seed", "2", cwd=tmp_path)
    assert "no target found: 0 of" in run("analyze", "room.h5", cwd=tmp_path).stdout
    assert json.loads(run("analyze", "room.h5", "--json", cwd=tmp_path).stdout)["reason"].startswith("0 of")
    assert (
        "needs at least one" in run("simulate", "room.toml", "--speed", "1", "-o", "x.h5", cwd=tmp_path, code=2).stderr
    )


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("analyze", "x.h5", "--format", "gif"), "Invalid value for '--format': 'gif' is not one of"),
        (("dataset", "plan", "home-alarm", "--pilot", "-3"), "'--pilot': must be greater than or equal to 0"),
        (("dataset", "plan", "home-alarm", "--set", "dataset.name=a/b"), "must begin with a letter or digit"),
        (("dataset", "plan", "liland2018-fair"), "there is no such folder in .* --motion-folder"),
    ],
)
def test_wrong_values_are_refused_in_plain_words(tmp_path, arguments, says):
    said = run(*arguments, cwd=tmp_path, code=2).stderr
    assert re.search(says, said), said
    assert "Value error" not in said


def test_a_built_in_plan_is_printed_to_be_changed(tmp_path):
    text = run("dataset", "plan", "home-alarm", "--toml").stdout
    assert text == (PLANS / "home-alarm.toml").read_text(encoding="utf-8")  # with its comments
    changed = run("dataset", "plan", "home-alarm", "--toml", "--set", "dataset.examples_per_class=3").stdout
    (tmp_path / "mine.toml").write_text(changed, encoding="utf-8")
    assert (
        load_plan(tmp_path / "mine.toml")[0] == load_plan("home-alarm", overrides=["dataset.examples_per_class=3"])[0]
    )


def test_the_help_of_a_plan_names_all_built_in_plans():
    said = " ".join(run("dataset", "plan", "--help").stdout.split())
    assert ", ".join(plan_names()) in said.replace("- ", "-")  # a line may end within a name
